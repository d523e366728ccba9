use super::*;

const DIMS: [usize; 3] = [2, 3, 4];

/// A cube file; z runs fastest.
fn cube(atoms: i64, counts: [i64; 3], more: &str, values: impl Fn(f64) -> String) -> String {
    let mut text = format!("title\nsecond\n{atoms} -1.0 2.5 0.25{more}\n");
    for (count, step) in counts.iter().zip(["0.5 0 0", "0.125 1.0D0 0", "0 0 2"]) {
        text += &format!("{count} {step}\n");
    }
    for _ in 0..atoms.abs() {
        text += "6 0.0 0.0 0.0 0.0\n";
    }
    if atoms < 0 {
        text += "2 7\n8\n";
    }
    for x in 0..DIMS[0] {
        for y in 0..DIMS[1] {
            for z in 0..DIMS[2] {
                text += &values(probe(x, y, z));
                text += if z % 3 == 2 { "\n" } else { " " };
            }
        }
    }
    text
}

#[test]
fn cube_files_are_transposed_and_their_unit_follows_the_sign() {
    let text = cube(1, [2, 3, 4], "", |v| format!("{v:.5E}"));
    for bytes in [text.clone().into_bytes(), text.replace('\n', "\r\n").into_bytes(), gzip(text.as_bytes())] {
        let v = load(&bytes).unwrap();
        assert_eq!(v.dims(), DIMS);
        assert_probe(&v);
        assert_eq!(v.unit, LengthUnit::Metres(5.29177210903e-11));
        assert_eq!(v.world_from_grid().point(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(-0.25, 4.5, 6.25));
    }
    let v = load(cube(1, [-2, -3, -4], "", |v| format!("{v:.1}")).as_bytes()).unwrap();
    assert_eq!((v.dims(), v.unit), (DIMS, LengthUnit::Metres(1e-10)));
    // Fortran's double precision exponents.
    assert_probe(&load(cube(0, [2, 3, 4], "", |v| format!("{v:.3}D+00")).as_bytes()).unwrap());
}

#[test]
fn orbital_files_give_their_first_value() {
    let v = load(cube(-1, [2, 3, 4], " 2", |v| format!("{v} -99")).as_bytes()).unwrap();
    assert_probe(&v);
    assert!(v.notes[0].text.contains("2 values"), "{:?}", v.notes);
    let v = load(cube(1, [2, 3, 4], " 3", |v| format!("{v} -99 -98")).as_bytes()).unwrap();
    assert_probe(&v);
}

#[test]
fn damaged_cube_files_are_named() {
    let good = cube(1, [2, 3, 4], "", |v| v.to_string());
    assert!(refusal(good.replacen("6 0.0", "6 0.0 \n6 0.0", 1).as_bytes()).contains("more numbers"));
    assert!(refusal(good.trim_end().rsplit_once(' ').unwrap().0.as_bytes()).contains("samples"));
    assert!(refusal(good.replace("111", "twelve").as_bytes()).contains("twelve"));
    assert!(refusal(cube(1, [0, 3, 4], "", |v| v.to_string()).as_bytes()).contains("0×3×4"));
    let huge = cube(1, [1_000_000, 1_000_000, 1_000_000], "", |v| v.to_string());
    assert!(refusal(huge.as_bytes()).contains("limit"));
}

fn vtk(binary: bool, kind: &str, more: &str, data: &[u8]) -> Vec<u8> {
    let encoding = if binary { "BINARY" } else { "ASCII" };
    let head = format!(
        "# vtk DataFile Version 3.0\ntitle\n{encoding}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 3 4\n\
         ORIGIN 1 -2 3\nSPACING 0.5 1 2\n\nPOINT_DATA 24\nSCALARS density {kind}\n{more}"
    );
    [head.as_bytes(), data].concat()
}

#[test]
fn legacy_vtk_in_text_and_in_big_endian_binary() {
    let table = "LOOKUP_TABLE default\n";
    let o = Order::Big;
    let all = |encode: &dyn Fn(f64) -> Vec<u8>| -> Vec<u8> {
        points(DIMS).flat_map(|(x, y, z)| encode(probe(x, y, z))).collect()
    };
    let words: Vec<String> = points(DIMS).map(|(x, y, z)| probe(x, y, z).to_string()).collect();
    for (kind, data, name) in [
        ("unsigned_short", all(&|v| o.u16(v as u16)), "uint16"),
        ("short 1", all(&|v| o.i16(v as i16)), "int16"),
        ("int", all(&|v| o.i32(v as i32)), "uint16"),
        ("unsigned_int", all(&|v| o.u32(v as u32)), "uint16"),
        ("unsigned_long", all(&|v| o.u64(v as u64)), "uint16"),
        ("vtktypeint64", all(&|v| o.i64(v as i64)), "uint16"),
        ("float", all(&|v| o.f32(v as f32)), "float32"),
        ("double", all(&|v| o.f64(v)), "float32"),
    ] {
        // VTK 9 writes METADATA after the samples.
        let tail = [&data[..], b"\nMETADATA\nINFORMATION 0\n"].concat();
        for bytes in [
            vtk(true, kind, table, &data),
            vtk(true, kind, "", &data),
            [b"# vtk DataFile Version 1.0\ntitle\n\n", &vtk(true, kind, table, &data)[33..]].concat(),
            vtk(true, kind, table, &tail),
            vtk(false, kind, table, words.join(" ").as_bytes()),
            gzip(&vtk(false, kind, "", words.join("\n").as_bytes())),
        ] {
            let v = load(&bytes).unwrap();
            assert_eq!((v.dims(), v.samples().type_name()), (DIMS, name), "{kind}");
            assert_probe(&v);
            assert_eq!(v.world_from_grid().point(DVec3::ONE), DVec3::new(1.5, -1.0, 5.0));
        }
    }
    // VTK's writer calls unsigned char colours, and prints their fractions of 255.
    let colours: Vec<u8> = (0..24).map(|i| i * 11).collect();
    let fractions: Vec<String> = colours.iter().map(|c| format!("{:.6}", f64::from(*c) / 255.0)).collect();
    for (binary, data) in [(true, &colours[..]), (false, fractions.join(" ").as_bytes())] {
        let bytes = vtk(binary, "@", "", data);
        let at = bytes.windows(17).position(|w| w == b"SCALARS density @").unwrap();
        let bytes = [&bytes[..at], b"COLOR_SCALARS density 1", &bytes[at + 17..]].concat();
        assert_eq!(load(&bytes).unwrap().samples(), &Samples::U8(colours.clone()));
    }
    let bytes: Vec<u8> = (0..24).map(|i| 250 + i % 6).collect();
    assert_eq!(load(&vtk(true, "unsigned_char", table, &bytes)).unwrap().samples(), &Samples::U8(bytes.clone()));
    let signed = bytes.iter().map(|b| *b as i8).collect();
    assert_eq!(load(&vtk(true, "char", table, &bytes)).unwrap().samples(), &Samples::I8(signed));
}

#[test]
fn other_vtk_files_are_refused_by_name() {
    let good = String::from_utf8(vtk(false, "float", "LOOKUP_TABLE default\n", "1 ".repeat(24).as_bytes())).unwrap();
    assert!(load(good.as_bytes()).is_ok());
    for (from, to, word) in [
        ("STRUCTURED_POINTS", "UNSTRUCTURED_GRID", "UNSTRUCTURED_GRID"),
        ("SCALARS", "VECTORS", "VECTORS"),
        ("POINT_DATA", "CELL_DATA", "CELL_DATA"),
        ("density float", "density float 3", "3"),
        ("density float", "density bit", "bit"),
        ("ASCII", "BASE64", "BASE64"),
        ("POINT_DATA 24", "POINT_DATA 23", "POINT_DATA 23"),
        ("DIMENSIONS 2 3 4", "DIMENSIONS 2 3", "DIMENSIONS 2 3"),
        ("DIMENSIONS 2 3 4\n", "", "DIMENSIONS"),
        ("SPACING 0.5", "SPACING 0", "axis vectors"),
        ("1 1 1", "1 x 1", "\"x\""),
    ] {
        let error = refusal(good.replacen(from, to, 1).as_bytes());
        assert!(error.contains(word), "{to}: {error}");
    }
}
