//! Pixel data of a DICOM file: plain, run-length, JPEG (baseline, lossless) and JPEG 2000. JPEG by the crate jpeg-decoder, JPEG
//! 2000 by hayro-jpeg2000; JPEG-LS, High-Throughput JPEG 2000, 12-bit lossy JPEG and videos have no decoder in Rust and are
//! refused by name.

use super::super::decode::{self, Data, Endian, Type};
use super::super::source::Source;
use super::NAME;
use super::dataset::{Head, Pixels, damaged};
use crate::error::{Error, Result};

/// How the samples of a file are stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Format {
    pub(super) columns: u64,
    pub(super) rows: u64,
    pub(super) allocated: u16,
    pub(super) stored: u16,
    pub(super) high: u16,
    pub(super) is_signed: bool,
}

impl Format {
    /// The type of the samples; bits become bytes.
    pub(super) fn sample_type(&self) -> Type {
        match (self.allocated, self.is_signed) {
            (1 | 8, false) => Type::U8,
            (1 | 8, true) => Type::I8,
            (16, false) => Type::U16,
            (16, true) => Type::I16,
            (_, false) => Type::U32,
            (_, true) => Type::I32,
        }
    }

    fn count(&self) -> usize {
        (self.columns * self.rows) as usize
    }

    /// Bytes of a frame, unpacked, at most.
    fn bytes(&self) -> u64 {
        self.columns * self.rows * u64::from(self.allocated.max(8)) / 8
    }

    /// Samples in the bits in which they are stored, others (overlays) taken out, their sign extended.
    pub(super) fn clean(&self, data: Data) -> Data {
        let (allocated, stored) = (u32::from(self.allocated), u32::from(self.stored));
        let low = u32::from(self.high) + 1 - stored;
        if stored == allocated || self.allocated == 1 {
            return data;
        }
        // Up to the top, then down, which takes the sign along.
        let up = allocated - stored - low;
        macro_rules! shifted {
            ($($variant:ident),*) => {
                match data {
                    $(Data::$variant(v) => Data::$variant(v.into_iter().map(|s| (s << up) >> (up + low)).collect()),)*
                    other => other,
                }
            };
        }
        shifted!(U8, I8, U16, I16, U32, I32)
    }
}

/// What packs the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Packing {
    Plain,
    RunLength,
    Jpeg,
    Jpeg2000,
}

/// How a transfer syntax packs, or its name where it is not read (PS3.6, annex A).
fn packing(syntax: &str) -> Result<Packing> {
    let name = match syntax.strip_prefix("1.2.840.10008.1.2").unwrap_or(syntax) {
        "" | ".1" | ".1.99" | ".2" | ".1.98" => return Ok(Packing::Plain),
        ".5" => return Ok(Packing::RunLength),
        ".4.50" | ".4.51" | ".4.57" | ".4.70" => return Ok(Packing::Jpeg),
        ".4.90" | ".4.91" => return Ok(Packing::Jpeg2000),
        ".4.80" => "JPEG-LS (lossless)",
        ".4.81" => "JPEG-LS (near-lossless)",
        ".4.201" => "High-Throughput JPEG 2000 (lossless)",
        ".4.202" => "High-Throughput JPEG 2000 (lossless, RPCL)",
        ".4.203" => "High-Throughput JPEG 2000",
        ".4.100" | ".4.101" | ".4.102" | ".4.103" | ".4.104" | ".4.105" | ".4.106" | ".4.107" | ".4.108" => "a video",
        _ => "unknown",
    };
    Err(refused(&format!("the transfer syntax {syntax} ({name})")))
}

fn refused(found: &str) -> Error {
    let remedy = "unpack the files first:\n  gdcmconv --raw FILE OUT\nor with dcmtk: dcmdjpls, dcmdjpeg";
    Error::format(NAME, found, "uncompressed, RLE, JPEG baseline or lossless, JPEG 2000", remedy)
}

/// Refuses what could not be unpacked.
pub(super) fn check_syntax(syntax: &str) -> Result<()> {
    packing(syntax).map(drop)
}

/// Samples of the frames of a file, one after the other.
pub(super) fn read(head: &mut Head, format: &Format, frames: usize) -> Result<Vec<Data>> {
    let packing = packing(&head.syntax)?;
    match (head.pixels, packing) {
        (Pixels::Missing, _) => Err(damaged("no pixel data", "PixelData (7FE0,0010)")),
        (Pixels::Real, _) => {
            let remedy = "convert it: dcm2niix -z y -o OUT FOLDER";
            Err(Error::format(NAME, "pixel data of floating-point numbers", "integers", remedy))
        }
        (Pixels::Plain(length), _) => plain(head, format, frames, length),
        (Pixels::Packed, packing) => {
            // No packing makes much more of what it cannot pack.
            let most = format.bytes().saturating_mul(frames as u64).saturating_mul(2).saturating_add(1 << 20);
            let pieces = head.pieces(most)?;
            let frames = of_frames(pieces, frames)?;
            frames.into_iter().map(|bytes| unpacked(&bytes, packing, format)).collect()
        }
    }
}

fn plain(head: &mut Head, format: &Format, frames: usize, length: u64) -> Result<Vec<Data>> {
    let bits = (format.columns * format.rows).saturating_mul(frames as u64).saturating_mul(format.allocated.into());
    if length < bits.div_ceil(8) {
        return Err(damaged(
            format!("{length} bytes of pixels"),
            &format!("{}, as rows, columns and frames say", bits.div_ceil(8)),
        ));
    }
    if format.allocated == 1 {
        // The first sample in the lowest bit; frames follow each other without gap.
        let bytes = decode::binary(&mut head.rest, NAME, Type::U8, Endian::Little, bits.div_ceil(8) as usize)?;
        let Data::U8(bytes) = bytes else { return Err(damaged("no bits", "bits")) };
        let bit = |i: usize| bytes.get(i / 8).map_or(0, |byte| byte >> (i % 8) & 1);
        let count = format.count();
        return Ok((0..frames).map(|f| Data::U8((f * count..(f + 1) * count).map(bit).collect())).collect());
    }
    (0..frames)
        .map(|_| decode::binary(&mut head.rest, NAME, format.sample_type(), head.endian, format.count()))
        .collect()
}

/// The bytes of each frame, of the pieces behind the table of where frames begin.
fn of_frames(pieces: Vec<Vec<u8>>, frames: usize) -> Result<Vec<Vec<u8>>> {
    let mut pieces = pieces.into_iter();
    let table = pieces.next().unwrap_or_default();
    let pieces: Vec<Vec<u8>> = pieces.collect();
    if pieces.len() == frames {
        return Ok(pieces);
    }
    if frames == 1 && !pieces.is_empty() {
        return Ok(vec![pieces.concat()]);
    }
    let starts: Vec<u64> = table.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b).into()).collect();
    if starts.len() != frames {
        let found = format!("{} pieces of packed pixels and {} places of frames", pieces.len(), starts.len());
        return Err(damaged(found, &format!("as many as frames, {frames}")));
    }
    // Places count from the first piece, the 8 bytes before each among them.
    let (mut out, mut at) = (vec![Vec::new(); frames], 0);
    for piece in &pieces {
        let frame = starts.partition_point(|start| *start <= at).saturating_sub(1);
        if let Some(frame) = out.get_mut(frame) {
            frame.extend_from_slice(piece);
        }
        at += 8 + piece.len() as u64;
    }
    Ok(out)
}

fn unpacked(bytes: &[u8], packing: Packing, format: &Format) -> Result<Data> {
    let (kind, count) = (format.sample_type(), format.count());
    let samples = |bytes: &[u8]| decode::binary(&mut Source::new(bytes, None), NAME, kind, Endian::Little, count);
    match packing {
        Packing::Plain => samples(bytes),
        Packing::RunLength => samples(&run_length(bytes, kind.size(), count)?),
        Packing::Jpeg => jpeg(bytes, format),
        Packing::Jpeg2000 => jpeg2000(bytes, format),
    }
}

/// PackBits of each byte of the samples by itself, the highest first (PS3.5, annex G); little-endian samples.
fn run_length(bytes: &[u8], size: usize, count: usize) -> Result<Vec<u8>> {
    let number =
        |i: usize| bytes.get(4 * i..).and_then(|b| b.first_chunk::<4>()).map_or(0, |b| u32::from_le_bytes(*b) as usize);
    if number(0) != size {
        return Err(damaged(
            format!("{} run-length segments", number(0)),
            &format!("{size}, one for each byte of a sample"),
        ));
    }
    let mut out = vec![0; size * count];
    for segment in 0..size {
        let end = if segment + 1 < size { number(segment + 2) } else { bytes.len() };
        let packed =
            bytes.get(number(segment + 1)..end).ok_or_else(|| damaged("a run-length segment outside", "it inside"))?;
        let mut packed = packed.iter().copied();
        let mut plane = Vec::new();
        while plane.len() < count {
            let ends = || damaged("a run-length segment that ends early", &format!("{count} bytes in it"));
            let control = packed.next().ok_or_else(ends)?;
            match control {
                0..=127 => {
                    for _ in 0..=control {
                        plane.push(packed.next().ok_or_else(ends)?);
                    }
                }
                128 => {}
                _ => {
                    let byte = packed.next().ok_or_else(ends)?;
                    plane.extend(std::iter::repeat_n(byte, 257 - usize::from(control)));
                }
            }
        }
        let place = size - 1 - segment;
        out.iter_mut().skip(place).step_by(size).zip(plane).for_each(|(to, from)| *to = from);
    }
    Ok(out)
}

/// Refuses a picture of another size than the header says.
fn check_size(what: &str, width: u64, height: u64, format: &Format) -> Result<()> {
    if (width, height) == (format.columns, format.rows) {
        return Ok(());
    }
    Err(damaged(
        format!("{what} of {width} × {height}"),
        &format!("{} × {}, as columns and rows say", format.columns, format.rows),
    ))
}

/// Samples of unsigned numbers as the header has them: 16 bits of a pattern are signed or not.
fn of_unsigned(samples: impl Iterator<Item = u16>, format: &Format) -> Result<Data> {
    Ok(match format.sample_type() {
        Type::U8 => Data::U8(samples.map(|v| v as u8).collect()),
        Type::I8 => Data::I8(samples.map(|v| v as u8 as i8).collect()),
        Type::U16 => Data::U16(samples.collect()),
        Type::I16 => Data::I16(samples.map(|v| v as i16).collect()),
        _ => return Err(refused("JPEG of more than 16 bits")),
    })
}

fn jpeg(bytes: &[u8], format: &Format) -> Result<Data> {
    use jpeg_decoder::{Decoder, PixelFormat};
    let error = |e: jpeg_decoder::Error| match e {
        jpeg_decoder::Error::Unsupported(what) => refused(&format!("JPEG with {what:?}")),
        e => damaged(format!("a damaged JPEG ({e})"), "a whole one"),
    };
    let mut decoder = Decoder::new(bytes);
    decoder.set_max_decoding_buffer_size(usize::try_from(format.bytes()).unwrap_or(usize::MAX).saturating_mul(2));
    decoder.read_info().map_err(error)?;
    let info = decoder.info().ok_or_else(|| damaged("a JPEG without size", "it"))?;
    check_size("a JPEG", info.width.into(), info.height.into(), format)?;
    if !matches!(info.pixel_format, PixelFormat::L8 | PixelFormat::L16) {
        return Err(refused("JPEG in colour"));
    }
    let out = decoder.decode().map_err(error)?;
    match info.pixel_format {
        PixelFormat::L16 => of_unsigned(out.as_chunks::<2>().0.iter().map(|b| u16::from_ne_bytes(*b)), format),
        _ => of_unsigned(out.into_iter().map(u16::from), format),
    }
}

fn jpeg2000(bytes: &[u8], format: &Format) -> Result<Data> {
    use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};
    let wrong = |text: String| damaged(format!("a damaged JPEG 2000 ({text})"), "a whole one");
    let (width, height, components, depth, is_signed) = siz(bytes).ok_or_else(|| wrong("no size".into()))?;
    check_size("a JPEG 2000", width, height, format)?;
    if components != 1 || depth > 16 {
        return Err(refused(&format!("JPEG 2000 of {components} components of {depth} bits")));
    }
    let settings = DecodeSettings { resolve_palette_indices: false, strict: true, target_resolution: None };
    let image = Image::new(bytes, &settings).map_err(|e| wrong(e.to_string()))?;
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(|e| wrong(e.to_string()))?;
    let [component] = decoded.components() else { return Err(wrong("components".into())) };
    let samples = component.samples();
    if samples.len() != format.count() {
        return Err(wrong(format!("{} samples", samples.len())));
    }
    // The decoder takes all samples for unsigned ones, and adds half the range to them.
    let shift = if is_signed { f64::from(1u32 << (depth - 1)) } else { 0.0 };
    let whole = |v: &f32| libm::round(f64::from(*v) - shift).clamp(-32768.0, 65535.0) as i32 as u16;
    of_unsigned(samples.iter().map(whole), format)
}

/// Width, height, components, bits and sign as the codestream's marker SIZ has them (ISO/IEC 15444-1, A.5.1).
fn siz(bytes: &[u8]) -> Option<(u64, u64, u16, u8, bool)> {
    let at = bytes.windows(4).position(|w| w == [0xff, 0x4f, 0xff, 0x51])? + 4;
    let siz = bytes.get(at..)?.first_chunk::<39>()?;
    let long = |i: usize| siz.get(i..).and_then(|b| b.first_chunk::<4>()).map_or(0, |b| u32::from_be_bytes(*b));
    // Length, capabilities, size, offset, size and offset of tiles, components, depth of the first.
    let (width, height) = (long(4).checked_sub(long(12))?, long(8).checked_sub(long(16))?);
    let [.., high, low, depth] = *siz;
    Some((width.into(), height.into(), u16::from_be_bytes([high, low]), (depth & 0x7f) + 1, depth & 0x80 != 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(allocated: u16, stored: u16, high: u16, is_signed: bool) -> Format {
        Format { columns: 4, rows: 1, allocated, stored, high, is_signed }
    }

    #[test]
    fn overlays_are_taken_out_and_signs_extended() {
        let samples = vec![0xf005, 0x0fff, 0x1800, 0x0000];
        assert_eq!(format(16, 12, 11, false).clean(Data::U16(samples.clone())), Data::U16(vec![5, 0xfff, 0x800, 0]));
        let signed = samples.iter().map(|v: &u16| *v as i16).collect();
        assert_eq!(format(16, 12, 11, true).clean(Data::I16(signed)), Data::I16(vec![5, -1, -2048, 0]));
        // In the upper bits.
        assert_eq!(format(16, 12, 15, false).clean(Data::U16(vec![0x123f])), Data::U16(vec![0x123]));
    }

    #[test]
    fn run_lengths_are_undone() {
        // High bytes: 1 four times; low bytes: 5, 6, then 7 twice behind a control that says nothing.
        let mut packed = vec![2, 0, 0, 0, 64, 0, 0, 0, 66, 0, 0, 0];
        packed.resize(64, 0);
        packed.extend([253, 1, 1, 5, 6, 128, 255, 7]);
        assert_eq!(run_length(&packed, 2, 4).unwrap(), [5, 1, 6, 1, 7, 1, 7, 1]);
        for cut in 0..packed.len() {
            assert!(run_length(&packed[..cut], 2, 4).is_err(), "{cut}");
        }
    }

    #[test]
    fn frames_are_put_together_by_their_places() {
        let table = [0u32, 11].iter().flat_map(|v| v.to_le_bytes()).collect();
        let pieces = vec![table, vec![1, 2, 3], vec![4], vec![5]];
        assert_eq!(of_frames(pieces.clone(), 2).unwrap(), [vec![1, 2, 3], vec![4, 5]]);
        assert_eq!(of_frames(pieces.clone(), 3).unwrap(), [vec![1, 2, 3], vec![4], vec![5]]);
        assert_eq!(of_frames(pieces.clone(), 1).unwrap(), [vec![1, 2, 3, 4, 5]]);
        assert!(of_frames(pieces, 4).is_err());
    }

    #[test]
    fn what_is_not_unpacked_is_named() {
        for (syntax, name) in
            [("1.2.840.10008.1.2.4.80", "JPEG-LS"), ("1.2.840.10008.1.2.4.201", "High-Throughput"), ("1.2.3", "1.2.3")]
        {
            assert!(check_syntax(syntax).unwrap_err().to_string().contains(name));
        }
    }
}
