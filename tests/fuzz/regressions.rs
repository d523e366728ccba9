//! Inputs that once made a reader panic, hang or ask for too much, each by name.

use super::memory;
use super::targets::VOLUME_LIMIT;
use isolume::volume::ReadHint;

/// The decoder of TIFF reads the first directory before it can be told of limits: an entry of 524,289 values
/// in a file of 600 bytes took 16 MiB, one of eight million 256 MiB.
#[test]
fn a_tiff_whose_first_directory_claims_more_than_the_file_is_refused_before_memory_is_asked_for() {
    let _turn = super::turn();
    let (_, tiff) = super::seeds::tiff().swap_remove(0);
    for big in [false, true] {
        let mut file = tiff.clone();
        if big {
            // A BigTIFF of the same directory: 12 entries become 20 bytes each.
            let entries = u16::from_le_bytes([tiff[32], tiff[33]]);
            file = [&b"II+\0\x08\0\0\0"[..], &16u64.to_le_bytes(), &u64::from(entries).to_le_bytes()].concat();
            for entry in tiff[34..].chunks(12).take(entries.into()) {
                file.extend(&entry[..4]);
                file.extend([&entry[4..8], &[0; 4], &entry[8..12], &[0; 4]].concat());
            }
            file.extend([0; 8]);
        }
        // The count of StripByteCounts, tag 279 = 0x117, type 4.
        let at = file.windows(4).position(|w| w == [0x17, 1, 4, 0]).expect("the entry") + 4;
        file[at..at + 4].copy_from_slice(&8_000_000u32.to_le_bytes());
        let (read, bytes) = memory::peak_of(|| isolume::volume::read(&file[..], &ReadHint::default()));
        let message = read.expect_err("refused").to_string();
        assert!(message.contains("8000000 values of 4 bytes"), "{message}");
        assert!(bytes < VOLUME_LIMIT, "{bytes}");
    }
}
