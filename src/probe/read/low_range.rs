//! PNG and JPEG: sRGB values of limited range, decoded to linear radiance. Colour profiles and
//! `gAMA` chunks are ignored, as are the alpha channel and the turn noted by a camera.

use super::{Note, Raw, ReadOptions, check_size, damaged};
use crate::error::Result;
use crate::scene::srgb::linear_from_srgb;
use image::{ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::Cursor;

pub(super) fn read(bytes: &[u8], kind: ImageFormat, options: &ReadOptions) -> Result<Raw> {
    let format = if kind == ImageFormat::Png { "PNG" } else { "JPEG" };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), kind);
    // The size is checked below, in pixels; this cap is for what else a decoder may allocate.
    // Pixels take up to 4 × 16 bits and are copied once.
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some((options.max_pixels as u64).saturating_mul(16).saturating_add(1 << 26));
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| damaged(format, e))?;
    let (width, height) = decoder.dimensions();
    check_size(format, u64::from(width), u64::from(height), options)?;
    let alpha = decoder.color_type().has_alpha();
    let image = image::DynamicImage::from_decoder(decoder).map_err(|e| damaged(format, e))?;
    let table: Vec<f32> = (0..=u16::MAX).map(|v| linear_from_srgb(f64::from(v) / 65535.0) as f32).collect();
    let pixels = image.into_rgb16().pixels().map(|p| p.0.map(|v| table[usize::from(v)])).collect();
    let mut notes =
        vec![Note::new("not an HDR image: sRGB was decoded to linear, lights brighter than white are clipped at 1", 1)];
    if alpha {
        notes.push(Note::new("the alpha channel was ignored", 1));
    }
    Ok(Raw { format, width: width as usize, height: height as usize, pixels, layout: None, notes })
}
