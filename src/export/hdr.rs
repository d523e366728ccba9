//! Radiance pictures (.hdr): 8-bit mantissas with a common exponent.

use crate::error::{Error, Result};
use std::io::{self, Write};

/// Writes linear pixels, row by row from the top; `size` is width and height.
///
/// # Errors
/// [`Error::Io`] (path empty) from the stream.
pub fn write(w: &mut impl Write, pixels: &[[f32; 3]], [width, height]: [usize; 2]) -> Result<()> {
    let pixels: Vec<image::Rgb<f32>> = pixels.iter().map(|p| image::Rgb(*p)).collect();
    let encoder = image::codecs::hdr::HdrEncoder::new(w);
    encoder.encode(&pixels, width, height).map_err(|e| Error::io("", "write", io::Error::other(e)))
}
