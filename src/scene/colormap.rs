//! Materials as functions of the isovalue. If albedo depends on the isovalue alone, every level set has one
//! albedo, and relighting and recolouring need no new transport (see [`crate::transport`]).

use super::srgb::linear_from_srgb;
use crate::error::{Error, Result};

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

/// Albedo as a function of the isovalue.
#[derive(Clone, Debug)]
pub enum MaterialRule {
    /// The same for every isovalue, linear.
    Constant([f32; 3]),
    /// A colour scale over a range of isovalues, times a factor.
    Map {
        /// The scale.
        colormap: Colormap,
        /// Isovalue of its lower end.
        low: f64,
        /// Isovalue of its upper end.
        high: f64,
        /// Factor on the colour, at most 1.
        scale: f32,
    },
}

impl MaterialRule {
    /// Linear albedo of the level set of an isovalue.
    pub fn albedo(&self, isovalue: f64) -> [f32; 3] {
        match self {
            Self::Constant(albedo) => *albedo,
            Self::Map { colormap, low, high, scale } => {
                let t = if high > low { (isovalue - low) / (high - low) } else { 0.5 };
                colormap.linear(t).map(|v| v * scale)
            }
        }
    }
}
