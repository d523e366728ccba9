//! Isovalues as people give them: numbers in the file's values, parts of the range, standard deviations, shares of
//! the volume, Hounsfield units, tissues, or `auto`.
//!
//! [`Isovalue::resolve`] turns one into a value with the side that is matter. The program's own choice goes by the
//! kind of data and says why; the negative of a volume gives the same surface.

mod auto;
mod statistics;

#[cfg(test)]
mod tests;

pub use statistics::overview;
pub(super) use statistics::solid_of_border;

use super::{Solid, Volume};
use crate::error::{Error, Result};
use crate::quantity;
use statistics::Statistics;
use std::str::FromStr;

/// Hounsfield units from which on bone is dense.
pub const BONE: f64 = 300.0;
/// Hounsfield units between air (−1000) and skin (about 0).
pub const SKIN: f64 = -300.0;

/// An isovalue as written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Isovalue {
    /// A value of the file.
    Value(f64),
    /// A part of the range of values, 0 to 100: `40%`.
    Percent(f64),
    /// Standard deviations from the mean: `1.5sigma`, `1.5σ`.
    Sigma(f64),
    /// Root mean squares from 0: `1.5rms`.
    Rms(f64),
    /// The level that encloses a share of the samples, 0 to 1: `enclosed:5%`.
    Enclosed(f64),
    /// Hounsfield units of computed tomography: `300HU`, `bone`, `skin`.
    Hounsfield(f64),
    /// Otsu's threshold: `otsu`.
    Otsu,
    /// The program's choice.
    Auto,
}

/// A level and the side of it that is matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// In the file's values.
    pub value: f64,
    /// Which side is matter.
    pub solid: Solid,
}

/// An isovalue that could be given instead.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    /// As it is given.
    pub name: String,
    /// What it means here.
    pub level: Level,
}

/// An isovalue in the file's values, and why it was chosen if the program chose it.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// In the file's values.
    pub value: f64,
    /// Which side is matter.
    pub solid: Solid,
    /// Why the program chose it.
    pub reason: Option<String>,
    /// Further levels that belong to it: the other lobe, other labels.
    pub more: Vec<Level>,
    /// What could be given instead.
    pub alternatives: Vec<Alternative>,
    /// What a user should know of it.
    pub warning: Option<String>,
}

impl Chosen {
    /// A value that was given.
    pub fn given(value: f64, solid: Solid) -> Self {
        Self { value, solid, reason: None, more: Vec::new(), alternatives: Vec::new(), warning: None }
    }

    /// What the program chose, and what a user should know of it.
    #[doc(hidden)]
    pub fn notes(&self) -> Vec<String> {
        let value = quantity::number(self.value, 6);
        let reason = self.reason.as_ref().map(|reason| format!("isovalue {value}: {reason}"));
        reason.into_iter().chain(self.warning.clone()).collect()
    }
}

/// An isovalue from its amount.
type Made = fn(f64) -> Isovalue;

impl FromStr for Isovalue {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let refuse = || {
            let expected = "a number, 40%, 1.5sigma, 1.5rms, enclosed:5%, 300HU, bone, skin, otsu or auto";
            Error::argument("isovalue", text, expected, "numbers are in the file's values")
        };
        let number = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(refuse);
        let text = text.trim();
        match text.to_ascii_lowercase().as_str() {
            "auto" => return Ok(Self::Auto),
            "otsu" => return Ok(Self::Otsu),
            "bone" => return Ok(Self::Hounsfield(BONE)),
            "skin" => return Ok(Self::Hounsfield(SKIN)),
            _ => {}
        }
        if let Some(share) = text.strip_prefix("enclosed:") {
            let share = match share.strip_suffix('%') {
                Some(percent) => number(percent)? / 100.0,
                None => number(share)?,
            };
            return if share > 0.0 && share < 1.0 { Ok(Self::Enclosed(share)) } else { Err(refuse()) };
        }
        let units: [(&str, Made); 6] = [
            ("%", Self::Percent),
            ("sigma", Self::Sigma),
            ("σ", Self::Sigma),
            ("rms", Self::Rms),
            ("HU", Self::Hounsfield),
            ("hu", Self::Hounsfield),
        ];
        for (unit, made) in units {
            if let Some(amount) = text.strip_suffix(unit) {
                return number(amount).map(made);
            }
        }
        number(text).map(Self::Value)
    }
}

impl Isovalue {
    /// The isovalue for a volume. `side` is the side of it that is matter where that is decided already; `None` leaves
    /// it to the choice of the program, which else is the volume's. `of_field`: what belongs to an analytic field.
    ///
    /// # Errors
    /// When no surface can have it: it lies outside the range of values.
    pub fn resolve(self, volume: &Volume, side: Option<Solid>, of_field: Option<f64>) -> Result<Chosen> {
        let solid = side.unwrap_or(volume.solid);
        let chosen = match (self, of_field) {
            (Self::Auto, Some(value)) => {
                let reason = Some("the isovalue that belongs to this field".into());
                Chosen { reason, ..Chosen::given(value, solid) }
            }
            (Self::Auto, None) => auto::choose(volume, side),
            (Self::Value(value) | Self::Hounsfield(value), _) => Chosen::given(value, solid),
            (Self::Percent(part), _) => Chosen::given(percent(volume, part), solid),
            (other, _) => {
                let value = other.value_of(volume, &Statistics::new(volume), solid);
                Chosen { reason: other.describe(), ..Chosen::given(value, solid) }
            }
        };
        let level = Level { value: chosen.value, solid: chosen.solid };
        if !crosses(volume, level) {
            let (low, high) = volume.value_range();
            return Err(Error::argument(
                "isovalue",
                number(chosen.value),
                format!("a value in the range of {}, {} to {}", volume.name, number(low), number(high)),
                if low == high { "this volume is constant and has no surface" } else { "use `isolume info` to see it" },
            ));
        }
        let warning = if of_field.is_none() { auto::warning(volume, level) } else { None };
        Ok(Chosen { warning, ..chosen })
    }

    /// The value of what is measured by the samples; 0 for what is not.
    fn value_of(self, volume: &Volume, statistics: &Statistics, solid: Solid) -> f64 {
        let value = match self {
            Self::Sigma(k) => statistics.mean + k * statistics.deviation,
            Self::Rms(k) => k * statistics.rms,
            Self::Enclosed(share) => statistics.quantile(if solid == Solid::Above { 1.0 - share } else { share }),
            Self::Otsu => statistics.otsu(),
            Self::Value(value) | Self::Hounsfield(value) => return value,
            Self::Percent(part) => return percent(volume, part),
            Self::Auto => 0.0,
        };
        value / statistics.scale
    }

    fn describe(self) -> Option<String> {
        match self {
            Self::Sigma(k) => Some(format!("{k} standard deviations from the mean")),
            Self::Rms(k) => Some(format!("{k} root mean squares from 0")),
            Self::Enclosed(share) => Some(format!("encloses {} % of the samples", number(100.0 * share))),
            Self::Otsu => Some("Otsu's threshold of the samples".into()),
            _ => None,
        }
    }
}

/// A part of the range of values.
fn percent(volume: &Volume, part: f64) -> f64 {
    let (low, high) = volume.value_range();
    let range = high - low;
    if range.is_finite() { low + part / 100.0 * range } else { low * (1.0 - part / 100.0) + high * (part / 100.0) }
}

/// Whether a level has samples on both sides. One that equals it is lit.
fn crosses(volume: &Volume, Level { value, solid }: Level) -> bool {
    let (low, high) = volume.value_range();
    match solid {
        Solid::Above => low <= value && value < high,
        Solid::Below => low < value && value <= high,
    }
}

/// To eight digits.
pub(crate) fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.7e}").parse().unwrap_or(value);
    let is_plain = rounded == 0.0 || (1e-5..1e15).contains(&rounded.abs());
    if is_plain { rounded.to_string() } else { format!("{rounded:e}") }
}
