//! Radiance HDR (`.hdr`, `.pic`): run-length coded RGBE.
//!
//! The pixels are decoded by the crate `image`, which knows both run-length schemes but neither
//! applies EXPOSURE and COLORCORR nor looks at FORMAT; the header is therefore read here as well
//! (Ward, "Radiance file formats": the radiance is the pixel divided by the product of all
//! EXPOSURE values and, for each channel, of all COLORCORR values).

use super::{Note, Raw, ReadOptions, check_size, damaged};
use crate::error::{Error, Result};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;

const FORMAT: &str = "Radiance HDR";
/// A header longer than this is no header.
const MAX_HEADER: usize = 1 << 20;

struct Header {
    width: u64,
    height: u64,
    /// Product of all exposures and colour corrections, by channel.
    scale: [f64; 3],
}

fn numbers<const N: usize>(key: &str, value: &str) -> Result<[f64; N]> {
    let parsed: Vec<f64> = value.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    match <[f64; N]>::try_from(parsed) {
        Ok(v) if v.iter().all(|x| x.is_finite() && *x > 0.0) => Ok(v),
        _ => Err(Error::format(
            FORMAT,
            format!("{key}={value}"),
            format!("{N} positive number(s)"),
            "correct or delete that line of the header",
        )),
    }
}

fn header(bytes: &[u8]) -> Result<Header> {
    let mut scale = [1.0; 3];
    let mut lines = bytes[..bytes.len().min(MAX_HEADER)].split(|b| *b == b'\n');
    let ended = || damaged(FORMAT, "it ends within the header");
    loop {
        let line = String::from_utf8_lossy(lines.next().ok_or_else(ended)?);
        let line = line.trim_end_matches('\r');
        if line.is_empty() {
            break;
        }
        let Some((key, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) else { continue };
        match key.trim() {
            "EXPOSURE" => {
                let [exposure] = numbers(key, value)?;
                scale = scale.map(|s| s * exposure);
            }
            "COLORCORR" => {
                let correction: [f64; 3] = numbers(key, value)?;
                scale = std::array::from_fn(|c| scale[c] * correction[c]);
            }
            "FORMAT" if value.trim() != "32-bit_rle_rgbe" => {
                return Err(Error::format(
                    FORMAT,
                    format!("FORMAT={}", value.trim()),
                    "FORMAT=32-bit_rle_rgbe",
                    "convert it with `ra_xyze -r` of Radiance",
                ));
            }
            _ => {}
        }
    }
    let line = String::from_utf8_lossy(lines.next().ok_or_else(ended)?).into_owned();
    let words: Vec<&str> = line.split_whitespace().collect();
    let size = |word: &str| word.parse::<u64>().ok();
    match words[..] {
        ["-Y", height, "+X", width] if size(height).is_some() && size(width).is_some() => {
            Ok(Header { width: size(width).unwrap_or(0), height: size(height).unwrap_or(0), scale })
        }
        _ => Err(Error::format(
            FORMAT,
            format!("the resolution line {:?}", line.chars().take(60).collect::<String>()),
            "`-Y height +X width`, rows from the top, each from the left",
            "turn the image upright with `pflip` or `protate` of Radiance",
        )),
    }
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Raw> {
    let Header { width, height, scale } = header(bytes)?;
    check_size(FORMAT, width, height, options)?;
    let decoder = HdrDecoder::new_nonstrict(bytes).map_err(|e| damaged(FORMAT, e))?;
    let (w, h) = decoder.dimensions();
    if (u64::from(w), u64::from(h)) != (width, height) {
        return Err(damaged(FORMAT, format!("two readings of its size, {w}x{h} and {width}x{height}")));
    }
    let mut pixels = vec![[0.0f32; 3]; w as usize * h as usize];
    decoder.read_image(bytemuck::cast_slice_mut(&mut pixels)).map_err(|e| damaged(FORMAT, e))?;
    let mut notes = Vec::new();
    if scale != [1.0; 3] {
        for pixel in &mut pixels {
            *pixel = std::array::from_fn(|c| (f64::from(pixel[c]) / scale[c]) as f32);
        }
        notes.push(Note::new(
            format!("divided by EXPOSURE and COLORCORR of the header: {} {} {}", scale[0], scale[1], scale[2]),
            1,
        ));
    }
    Ok(Raw { format: FORMAT, width: w as usize, height: h as usize, pixels, layout: None, notes })
}
