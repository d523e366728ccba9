use super::*;

#[test]
fn a_shard_gives_back_its_chunks_and_accounts_for_every_byte() {
    let payload: Vec<Vec<u8>> = (0..MOST_SLOTS).map(|s| vec![s as u8; 12]).collect();
    for present in [0u64, 1, 1 << 63, 0x8000_0010_0300_0001, u64::MAX] {
        let chunk = |s: usize| (present >> s & 1 == 1).then(|| (payload[s].as_slice(), checksum(&payload[s])));
        let chunks: Vec<Option<(&[u8], u32)>> = (0..MOST_SLOTS).map(chunk).collect();
        let mut file = Vec::new();
        write_shard(&mut file, &chunks, &[7; STAMP]).unwrap();
        assert_eq!(file.len(), shard_length(MOST_SLOTS, present.count_ones() as usize, 12));
        assert_eq!(read_tail(&file, MOST_SLOTS, 12).unwrap(), ShardTail { present, stamp: [7; STAMP] });
        for slot in (0..MOST_SLOTS).filter(|s| present >> s & 1 == 1) {
            let (bytes, sum) = inner_chunk(&file, rank(present, slot), 12);
            assert_eq!((bytes, little_u32(sum)), (payload[slot].as_slice(), checksum(bytes)));
        }
        // Every prefix, and a byte too many, is refused; so is another chunk length.
        assert!((0..file.len()).all(|n| read_tail(&file[..n], MOST_SLOTS, 12).is_err()));
        file.push(0);
        assert!(read_tail(&file, MOST_SLOTS, 12).is_err());
        file.pop();
        assert_eq!(read_tail(&file, MOST_SLOTS, 16).is_err(), present != 0);
    }
}

#[test]
fn the_checksum_is_crc32c() {
    assert_eq!(checksum(b"123456789"), 0xe306_9283); // RFC 3720, appendix B.4 family
}

#[test]
fn an_array_that_differs_is_named() {
    let array = Array {
        shape: vec![2, 3, 4],
        chunk: vec![32; 3],
        inner: Some(vec![8; 3]),
        data_type: "uint8",
        fill: json!(0),
        names: vec!["z", "y", "x"],
        codec: Codec::Plain,
    };
    let mut found = array.metadata(json!({ "anything": 1 }));
    array.check(&found).unwrap();
    found["shape"][1] = json!(5);
    let message = array.check(&found).unwrap_err().to_string();
    assert!(message.contains("`shape`: [2,5,4]") && message.contains("[2,3,4]"), "{message}");
}
