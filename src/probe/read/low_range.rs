//! PNG and JPEG: sRGB values of limited range, decoded to linear radiance. Colour profiles and
//! `gAMA` chunks are ignored, as are the alpha channel and the turn noted by a camera.
//!
//! Profiles and texts of a PNG are deflated, and half a megabyte becomes half a gigabyte: they are skipped, not inflated
//! and dropped. So PNG is read by the crate `png` itself; `image` has no such switch.

use super::{Note, Raw, ReadOptions, check_size, damaged};
use crate::error::Result;
use crate::srgb::linear_from_srgb;
use image::{ImageDecoder, ImageFormat, ImageReader, Limits};
use png::{BitDepth, ColorType, Transformations};
use std::io::Cursor;

/// What decoders may allocate besides the pixels.
const BESIDES: usize = 1 << 26;

pub(super) fn read_jpeg(bytes: &[u8], options: &ReadOptions) -> Result<Raw> {
    const FORMAT: &str = "JPEG";
    let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Jpeg);
    // The size is checked below, in pixels; this cap is for what else a decoder may allocate.
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some((options.max_pixels as u64).saturating_mul(16).saturating_add(BESIDES as u64));
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| damaged(FORMAT, e))?;
    let (width, height) = decoder.dimensions();
    check_size(FORMAT, u64::from(width), u64::from(height), options)?;
    let image = image::DynamicImage::from_decoder(decoder).map_err(|e| damaged(FORMAT, e))?;
    let table = linear_table();
    let pixels = image.into_rgb8().pixels().map(|p| p.0.map(|v| table[usize::from(v) * 257])).collect();
    Ok(raw(FORMAT, width, height, pixels, false))
}

pub(super) fn read_png(bytes: &[u8], options: &ReadOptions) -> Result<Raw> {
    const FORMAT: &str = "PNG";
    let limits = png::Limits { bytes: options.max_pixels.saturating_mul(8).saturating_add(BESIDES) };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_ignore_text_chunk(true);
    // Palettes and less than 8 bits become 8 bits a channel.
    decoder.set_transformations(Transformations::EXPAND);
    let (width, height) = decoder.read_header_info().map_err(|e| damaged(FORMAT, e))?.size();
    check_size(FORMAT, u64::from(width), u64::from(height), options)?;
    let mut reader = decoder.read_info().map_err(|e| damaged(FORMAT, e))?;
    let size = reader.output_buffer_size().ok_or_else(|| damaged(FORMAT, "its size"))?;
    let mut values = vec![0; size];
    let info = reader.next_frame(&mut values).map_err(|e| damaged(FORMAT, e))?;
    // A frame of an animation may be smaller than the image.
    if (info.width, info.height) != (width, height) {
        return Err(damaged(FORMAT, "a first frame of another size"));
    }
    let (channels, alpha) = match info.color_type {
        ColorType::Grayscale => (1, false),
        ColorType::GrayscaleAlpha => (2, true),
        ColorType::Rgb => (3, false),
        ColorType::Rgba => (4, true),
        ColorType::Indexed => return Err(damaged(FORMAT, "a palette that was not applied")),
    };
    let wide = info.bit_depth == BitDepth::Sixteen;
    let table = linear_table();
    let value = |pixel: &[u8], channel: usize| match wide {
        true => table[usize::from(u16::from_be_bytes([pixel[2 * channel], pixel[2 * channel + 1]]))],
        false => table[usize::from(pixel[channel]) * 257],
    };
    let pixels = values.chunks_exact(channels * if wide { 2 } else { 1 });
    let pixels = pixels.map(|pixel| std::array::from_fn(|c| value(pixel, if channels < 3 { 0 } else { c })));
    Ok(raw(FORMAT, width, height, pixels.collect(), alpha))
}

/// Linear values of all 16-bit values; 8 bits are 257 times as much.
fn linear_table() -> Vec<f32> {
    (0..=u16::MAX).map(|v| linear_from_srgb(f64::from(v) / 65535.0) as f32).collect()
}

fn raw(format: &'static str, width: u32, height: u32, pixels: Vec<[f32; 3]>, alpha: bool) -> Raw {
    let mut notes =
        vec![Note::new("not an HDR image: sRGB was decoded to linear, lights brighter than white are clipped at 1", 1)];
    if alpha {
        notes.push(Note::new("the alpha channel was ignored", 1));
    }
    Raw { format, width: width as usize, height: height as usize, pixels, layout: None, notes }
}
