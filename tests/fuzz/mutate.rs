//! Damage: what copying, writing, compilers and enemies do to a file. Everything is a function of the
//! numbers drawn.

use std::io::Write;

/// Numbers (Vigna 2015, splitmix64).
pub struct Numbers(pub u64);

impl Numbers {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let a = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let b = (a ^ a >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        b ^ b >> 31
    }

    /// 0 … n − 1; 0 for n = 0.
    pub fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { (self.next() % n as u64) as usize }
    }

    pub fn pick<'a, T>(&mut self, from: &'a [T]) -> &'a T {
        &from[self.below(from.len())]
    }

    /// A place in a file; three of four times among its first bytes, where headers are.
    fn place(&mut self, length: usize) -> usize {
        if self.below(4) > 0 { self.below(length.min(400)) } else { self.below(length) }
    }
}

/// Integers that overflow something, or nearly.
const INTEGERS: [u64; 20] = [
    0,
    1,
    2,
    3,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0x8000,
    0xffff,
    0x10000,
    1 << 20,
    1 << 24,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    1 << 32,
    1 << 40,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
];

const FLOATS: [f64; 12] = [0.0, -0.0, 1.0, -1.0, 1e-45, 1e-310, 1e30, 3.4e38, -3.4e38, 1e300, f64::INFINITY, f64::NAN];

const WORDS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "2",
    "3",
    "17",
    "65536",
    "2147483648",
    "4294967296",
    "1000000000000",
    "9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999999",
    "1e308",
    "-1e308",
    "1e-320",
    "nan",
    "inf",
    "",
    "none",
    "\u{fffd}",
    "0x10",
];

/// Damages a file once to four times; `other` is a file to take pieces from.
pub fn damage(numbers: &mut Numbers, bytes: &[u8], other: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..1 + numbers.below(4) {
        once(numbers, &mut out, other);
    }
    out
}

fn once(numbers: &mut Numbers, out: &mut Vec<u8>, other: &[u8]) {
    let at = numbers.place(out.len());
    match numbers.below(16) {
        0 => out.truncate(at),
        1 | 2 => {
            if let Some(byte) = out.get_mut(at) {
                *byte ^= 1 << numbers.below(8);
            }
        }
        3 => {
            if let Some(byte) = out.get_mut(at) {
                *byte = *numbers.pick(&[0, 1, 0x20, 0x2d, 0x39, 0x7f, 0x80, 0xff]);
            }
        }
        4..=6 => {
            let value = *numbers.pick(&INTEGERS);
            let width = *numbers.pick(&[1, 2, 4, 4, 8]);
            let mut field = value.to_le_bytes()[..width].to_vec();
            if numbers.below(2) == 0 {
                field.reverse();
            }
            // Headers keep their fields at multiples of their width.
            let at = if numbers.below(3) > 0 { at / width * width } else { at };
            overwrite(out, at, &field);
        }
        7 => {
            let value = *numbers.pick(&FLOATS);
            let field: Vec<u8> = match numbers.below(4) {
                0 => (value as f32).to_le_bytes().into(),
                1 => (value as f32).to_be_bytes().into(),
                2 => value.to_le_bytes().into(),
                _ => value.to_be_bytes().into(),
            };
            overwrite(out, at / 4 * 4, &field);
        }
        8 | 9 => replace_word(numbers, out, at),
        10 => {
            let length = numbers.below(64).min(out.len() - at);
            out.drain(at..at + length);
        }
        11 => {
            let length = numbers.below(64).min(out.len() - at);
            let piece = out[at..at + length].to_vec();
            let to = numbers.below(out.len() + 1);
            out.splice(to..to, piece);
        }
        12 => {
            let piece: Vec<u8> = (0..1 + numbers.below(24)).map(|_| numbers.next() as u8).collect();
            out.splice(at..at, piece);
        }
        13 => {
            // The head of one, the tail of the other.
            let from = numbers.below(other.len());
            out.truncate(at);
            out.extend_from_slice(&other[from..]);
        }
        14 => {
            let fill = *numbers.pick(&[0, b' ', b'9', 0xff]);
            let length = numbers.below(300);
            out.splice(at..at, std::iter::repeat_n(fill, length));
        }
        _ => swap_lines(numbers, out),
    }
}

fn overwrite(out: &mut [u8], at: usize, field: &[u8]) {
    for (byte, new) in out.iter_mut().skip(at).zip(field) {
        *byte = *new;
    }
}

/// Replaces the number (or word) nearest behind a place.
fn replace_word(numbers: &mut Numbers, out: &mut Vec<u8>, at: usize) {
    let is_word = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'-' | b'+');
    let Some(start) = out.iter().skip(at).position(is_word).map(|n| at + n) else { return };
    let end = out.iter().skip(start).position(|b| !is_word(b)).map_or(out.len(), |n| start + n);
    out.splice(start..end, numbers.pick(&WORDS).bytes());
}

fn swap_lines(numbers: &mut Numbers, out: &mut Vec<u8>) {
    let mut lines: Vec<Vec<u8>> = out.split_inclusive(|b| *b == b'\n').take(40).map(<[u8]>::to_vec).collect();
    let (a, b) = (numbers.below(lines.len()), numbers.below(lines.len()));
    if lines.len() < 2 {
        return;
    }
    let length: usize = lines.iter().map(Vec::len).sum();
    let rest = out.split_off(length);
    lines.swap(a, b);
    *out = lines.concat();
    out.extend(rest);
}

/// Packs as gzip.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}

/// A file followed by `zeros` zeros, packed: a gzip bomb.
pub fn bomb(bytes: &[u8], zeros: u64) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("memory");
    std::io::copy(&mut std::io::Read::take(std::io::repeat(0), zeros), &mut encoder).expect("memory");
    encoder.finish().expect("memory")
}

/// Gives every chunk of a PNG the checksum of what it holds now, so that damage reaches the decoder.
pub fn repair_png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let Some(end) = at.checked_add(8).and_then(|n| n.checked_add(length)).filter(|e| e + 4 <= bytes.len()) else {
            return;
        };
        let mut sum = flate2::Crc::new();
        sum.update(&bytes[at + 4..end]);
        bytes[end..end + 4].copy_from_slice(&sum.sum().to_be_bytes());
        at = end + 4;
    }
}
