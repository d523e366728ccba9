use super::*;

#[test]
fn every_type_and_byte_order_decodes_its_extremes() {
    fn read(kind: Type, endian: Endian, bytes: &[u8]) -> Data {
        binary(&mut Source::new(bytes, None), "t", kind, endian, bytes.len() / kind.size()).unwrap()
    }
    macro_rules! check {
            ($variant:ident, $t:ty, $($v:expr),*) => {
                let values = [$($v as $t),*];
                let little: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
                assert_eq!(read(Type::$variant, Endian::Little, &little), Data::$variant(values.to_vec()));
                assert_eq!(read(Type::$variant, Endian::Big, &big), Data::$variant(values.to_vec()));
            };
        }
    check!(U8, u8, 0, 255, 7);
    check!(I8, i8, -128, 127, 3);
    check!(U16, u16, 0, 65535, 258);
    check!(I16, i16, -32768, 32767, 258);
    check!(U32, u32, 0, u32::MAX, 16909060);
    check!(I32, i32, i32::MIN, i32::MAX, 16909060);
    check!(U64, u64, 0, u64::MAX, 72623859790382856u64);
    check!(I64, i64, i64::MIN, i64::MAX, 72623859790382856i64);
    check!(F32, f32, -1.5, f32::MAX, 1e-40);
    check!(F64, f64, -1.5, f64::MAX, 5e-324);
    assert_eq!(read(Type::F16, Endian::Little, &[0x00, 0x3e]), Data::F32(vec![1.5]));
    assert_eq!(read(Type::F16, Endian::Big, &[0x3e, 0x00]), Data::F32(vec![1.5]));
}

#[test]
fn pieces_join_without_a_seam() {
    // More than two pieces, so that growth and the last short piece are exercised.
    let count = PIECE + PIECE / 2 + 13;
    let bytes: Vec<u8> = (0..count as u32).flat_map(|v| (v as u16).to_le_bytes()).collect();
    let data = binary(&mut Source::new(&bytes[..], None), "t", Type::U16, Endian::Little, count).unwrap();
    assert_eq!(data, Data::U16((0..count as u32).map(|v| v as u16).collect()));
    let data = binary(&mut Source::new(&bytes[..], None), "t", Type::U8, Endian::Little, bytes.len()).unwrap();
    assert_eq!(data, Data::U8(bytes));
}

#[test]
fn claims_are_checked_before_memory_is_asked_for() {
    let hint = ReadHint::default();
    assert_eq!(checked_count("t", [2, 3, 4], 8, Some(192), &hint).unwrap(), 24);
    for (dims, left) in [([0, 3, 4], None), ([2, 3, 4], Some(191))] {
        assert!(matches!(checked_count("t", dims, 8, left, &hint), Err(Error::Format { .. })), "{dims:?}");
    }
    for dims in [[1 << 20, 1 << 20, 1], [u64::MAX, u64::MAX, 2], [1 << 22, 1 << 21, 1 << 21]] {
        assert!(matches!(checked_count("t", dims, 8, None, &hint), Err(Error::Limit { .. })), "{dims:?}");
    }
    // A stream of unknown length that claims 8 GiB and holds three bytes: fails at once.
    let mut short = Source::new(&b"abc"[..], None);
    let error = binary(&mut short, "t", Type::F64, Endian::Little, 1 << 30).unwrap_err();
    assert!(error.to_string().contains("0 samples before the end"), "{error}");
}

#[test]
fn text_takes_fortran_numbers_and_refuses_words() {
    for (word, value) in
        [("1.5D-03", 1.5e-3), ("-2.5d2", -250.0), ("1.5-103", 1.5e-103), ("-1.5+10", -1.5e10), ("7", 7.0)]
    {
        assert_eq!(fortran_number(word), Some(value), "{word}");
    }
    assert_eq!(fortran_number("-"), None);
    assert_eq!(fortran_number("abc"), None);
    let mut source = Source::new(&b"1 2 300"[..], None);
    let error = text(&mut source, "t", Type::U8, 3).unwrap_err().to_string();
    assert!(error.contains("\"300\" as sample 2") && error.contains("uint8"), "{error}");
}
