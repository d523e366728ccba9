//! Which lamps of an environment are lit apart from it.

use crate::error::Error;
use std::str::FromStr;

/// Most suns that are split off an environment: each costs visibility rays at every vertex and pixel.
#[doc(hidden)]
pub const MOST_SUNS: usize = 8;

/// Root mean square, over the mean, of what radiance beside a shadow may lose by the bands of the light before its lamps are
/// split off.
#[doc(hidden)]
pub const SUN_TOLERANCE: f64 = 0.02;

/// Which lamps are lit apart from an environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SunSplit {
    /// Those without which the band-limited light is as good as [`SUN_TOLERANCE`] asks, at most
    /// [`MOST_SUNS`]; none where a scene has walls or luminaires, and none under a window, which is there to take what
    /// rings.
    #[default]
    Auto,
    /// None: light and transfer are multiplied, no ray is traced.
    Off,
    /// The strongest, so many; fewer where the light has fewer.
    Lobes(usize),
}

impl FromStr for SunSplit {
    type Err = Error;

    /// Reads `auto`, `on` (the same), `off`, or a number from 1 to [`MOST_SUNS`].
    fn from_str(text: &str) -> Result<Self, Error> {
        match (text, text.parse()) {
            ("auto" | "on", _) => Ok(Self::Auto),
            ("off" | "0", _) => Ok(Self::Off),
            (_, Ok(count @ 1..=MOST_SUNS)) => Ok(Self::Lobes(count)),
            _ => {
                let expected = format!("auto, off, or a number of lamps from 1 to {MOST_SUNS}");
                Err(Error::argument("sun split", text, expected, "auto splits off as many as ring"))
            }
        }
    }
}

impl std::fmt::Display for SunSplit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Auto => write!(f, "auto"),
            Self::Off => write!(f, "off"),
            Self::Lobes(count) => write!(f, "{count}"),
        }
    }
}
