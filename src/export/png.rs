//! 8-bit sRGB PNG from linear light (W3C PNG, third edition). The `sRGB` chunk is set, with
//! relative colorimetric intent: the numbers are colours, not a photograph to be adapted.

use super::{Image, write_error};
use crate::error::{Error, Result};
use crate::memory;
use crate::srgb;
use std::io::Write;

/// What to write besides the colours.
#[derive(Clone, Debug, Default)]
pub struct PngOptions {
    /// Keep alpha (straight); otherwise the picture is written as it stands, alpha dropped.
    pub alpha: bool,
    /// Text for the keyword `Software`.
    pub software: Option<String>,
    /// Text for the keyword `Description`, such as the provenance as JSON.
    pub description: Option<String>,
}

/// Refuses a picture that is too large for its memory.
///
/// # Errors
/// [`Error::Limit`] with both amounts.
pub fn check_size(size: (usize, usize), limit: Option<u64>) -> Result<()> {
    let needed = (size.0 as u64).saturating_mul(size.1 as u64).saturating_mul(40);
    memory::check("the picture", needed, limit).map_err(|e| match e {
        Error::Limit { what, needed, limit, .. } => {
            Error::Limit { what, needed, limit, remedy: "give a smaller --size".into() }
        }
        other => other,
    })
}

/// Writes an image. Colours outside [0, 1] are clamped, as a display would; alpha is linear.
///
/// # Errors
/// [`Error::Argument`] for a pixel that is not finite, [`Error::Io`] (path empty) from the
/// stream.
pub fn write(w: &mut (impl Write + ?Sized), image: &Image, options: &PngOptions) -> Result<()> {
    if let Some(bad) = image.pixels().iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        let (x, y) = (bad % image.width(), bad / image.width());
        return Err(Error::argument(
            "image",
            format!("{:?} at column {x}, row {y}", image.pixels()[bad]),
            "finite pixels",
            "look for the division or overflow that made it",
        ));
    }
    // Both sides fit: an image's side is below 2³¹.
    let mut encoder = ::png::Encoder::new(w, image.width() as u32, image.height() as u32);
    encoder.set_color(if options.alpha { ::png::ColorType::Rgba } else { ::png::ColorType::Rgb });
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_source_srgb(::png::SrgbRenderingIntent::RelativeColorimetric);
    for (keyword, text) in [("Software", &options.software), ("Description", &options.description)] {
        if let Some(text) = text {
            // A NUL would end the text inside the chunk.
            encoder.add_itxt_chunk(keyword.into(), text.replace('\0', " ")).map_err(encoding_error)?;
        }
    }
    let channels = if options.alpha { 4 } else { 3 };
    let mut bytes = Vec::with_capacity(image.pixels().len() * channels);
    for &[r, g, b, a] in image.pixels() {
        bytes.extend([r, g, b].map(srgb::byte_from_linear));
        if options.alpha {
            bytes.push((a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        }
    }
    let mut writer = encoder.write_header().map_err(encoding_error)?;
    writer.write_image_data(&bytes).map_err(encoding_error)?;
    writer.finish().map_err(encoding_error)
}

fn encoding_error(error: ::png::EncodingError) -> Error {
    match error {
        ::png::EncodingError::IoError(source) => write_error(source),
        other => Error::argument("image", other, "an image that PNG can hold", "make it smaller"),
    }
}

#[cfg(test)]
mod tests;
