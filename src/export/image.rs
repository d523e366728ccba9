//! A picture in linear light.

use crate::error::{Error, Result};

/// A picture: linear Rec.709 with straight (not premultiplied) alpha, row by row from the top
/// left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    // Invariant: pixels.len() == width·height > 0, and each side fits in 31 bits (PNG's limit).
    width: usize,
    height: usize,
    pixels: Vec<[f32; 4]>,
}

const LARGEST_SIDE: usize = i32::MAX as usize;

impl Image {
    /// An image from its pixels.
    ///
    /// # Errors
    /// When a side is 0 or above 2³¹ − 1, or the number of pixels is not width × height.
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 4]>) -> Result<Self> {
        let sides = 1..=LARGEST_SIDE;
        if !(sides.contains(&width) && sides.contains(&height)) || width.checked_mul(height) != Some(pixels.len()) {
            return Err(Error::argument(
                "image",
                format!("{} pixels for {width}×{height}", pixels.len()),
                "one pixel for each place, at least one",
                "check the size",
            ));
        }
        Ok(Self { width, height, pixels })
    }

    /// An opaque image from linear RGB.
    ///
    /// # Errors
    /// As [`Image::new`].
    pub fn from_rgb(width: usize, height: usize, pixels: &[[f32; 3]]) -> Result<Self> {
        Self::new(width, height, pixels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect())
    }

    /// An image of one colour.
    ///
    /// # Errors
    /// As [`Image::new`].
    pub fn filled(width: usize, height: usize, colour: [f32; 4]) -> Result<Self> {
        let count = width.checked_mul(height).filter(|&n| n <= isize::MAX as usize / 16).unwrap_or(0);
        Self::new(width, height, vec![colour; count])
    }

    /// Pixels to a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels, row by row from the top left.
    pub fn pixels(&self) -> &[[f32; 4]] {
        &self.pixels
    }

    /// The pixels, to change.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 4]] {
        &mut self.pixels
    }

    /// The pixel of column `x`, row `y`.
    ///
    /// # Panics
    /// When it is outside.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {}×{}", self.width, self.height);
        self.pixels[x + self.width * y]
    }

    /// Lays `colour` over a pixel (Porter and Duff 1984, "over", in linear light, straight
    /// alpha); outside the image it does nothing.
    pub fn blend(&mut self, x: usize, y: usize, colour: [f32; 4]) {
        if x < self.width && y < self.height {
            let pixel = &mut self.pixels[x + self.width * y];
            *pixel = over(colour, *pixel);
        }
    }

    /// Lays another image over this one with its top left corner at (`left`, `top`); what falls
    /// outside is cut off.
    pub fn paste(&mut self, other: &Self, left: usize, top: usize) {
        for y in 0..other.height {
            for x in 0..other.width {
                self.blend(left + x, top + y, other.pixels[x + other.width * y]);
            }
        }
    }

    /// The mean of each block of `factor` × `factor` pixels, weighted by alpha: what a picture
    /// rendered larger needs to lose its stairs. Rows and columns that do not fill a block are
    /// dropped.
    ///
    /// # Errors
    /// When the factor is 0 or larger than a side.
    pub fn reduced(&self, factor: usize) -> Result<Self> {
        if factor == 0 || factor > self.width.min(self.height) {
            let expected = format!("a factor from 1 to the shorter side of {}×{}", self.width, self.height);
            return Err(Error::argument("image reduction", factor, expected, "render a larger picture"));
        }
        let (width, height) = (self.width / factor, self.height / factor);
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0f32; 4];
                for row in 0..factor {
                    let start = x * factor + self.width * (y * factor + row);
                    for &[r, g, b, a] in &self.pixels[start..start + factor] {
                        sum = [sum[0] + r * a, sum[1] + g * a, sum[2] + b * a, sum[3] + a];
                    }
                }
                let [r, g, b, a] = sum;
                let inverse = if a > 0.0 { 1.0 / a } else { 0.0 };
                pixels.push([r * inverse, g * inverse, b * inverse, a / (factor * factor) as f32]);
            }
        }
        Self::new(width, height, pixels)
    }
}

fn over(front: [f32; 4], back: [f32; 4]) -> [f32; 4] {
    let rest = back[3] * (1.0 - front[3]);
    let alpha = front[3] + rest;
    if alpha <= 0.0 {
        return [0.0; 4];
    }
    let channel = |c: usize| (front[c] * front[3] + back[c] * rest) / alpha;
    [channel(0), channel(1), channel(2), alpha]
}

#[cfg(test)]
mod tests;
