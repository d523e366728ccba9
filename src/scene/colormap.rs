//! Colour scales by name.

use crate::error::{Error, Result};
use crate::srgb::linear_from_srgb;

/// A named colour scale.
#[derive(Clone, Copy)]
pub struct Colormap {
    name: &'static str,
    gradient: colorous::Gradient,
}

impl std::fmt::Debug for Colormap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Colormap").field(&self.name).finish()
    }
}

const COLORMAPS: [(&str, colorous::Gradient); 10] = [
    ("viridis", colorous::VIRIDIS),
    ("plasma", colorous::PLASMA),
    ("magma", colorous::MAGMA),
    ("inferno", colorous::INFERNO),
    ("cividis", colorous::CIVIDIS),
    ("turbo", colorous::TURBO),
    ("cool", colorous::COOL),
    ("warm", colorous::WARM),
    ("spectral", colorous::SPECTRAL),
    ("red-blue", colorous::RED_BLUE),
];

impl Colormap {
    /// The names that [`Colormap::named`] knows.
    pub fn names() -> impl Iterator<Item = &'static str> {
        COLORMAPS.iter().map(|(name, _)| *name)
    }

    /// A colour scale by name.
    ///
    /// # Errors
    /// When there is none of that name.
    pub fn named(name: &str) -> Result<Self> {
        COLORMAPS.iter().find(|(n, _)| *n == name).map(|&(name, gradient)| Self { name, gradient }).ok_or_else(|| {
            let known: Vec<&str> = Self::names().collect();
            Error::argument("colormap", name, format!("one of {}", known.join(", ")), "give one of these names")
        })
    }

    /// Linear Rec.709 colour at t ∈ [0, 1] (clamped). The scales are defined in sRGB.
    pub fn linear(&self, t: f64) -> [f32; 3] {
        let colour = self.gradient.eval_continuous(t.clamp(0.0, 1.0));
        [colour.r, colour.g, colour.b].map(|v| linear_from_srgb(f64::from(v) / 255.0) as f32)
    }
}
