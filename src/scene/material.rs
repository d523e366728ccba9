//! Materials as functions of the isovalue. If albedo depends on the isovalue alone, every level set has one
//! albedo, and relighting and recolouring need no new transport (see [`crate::transport`]).

use super::{Colormap, nearest};
use crate::error::{Error, Result};

/// Linear RGB over the isovalue: straight lines between rows, constant beyond the first and the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    // Invariant: at least one row; isovalues finite and strictly ascending; colours finite and not negative.
    rows: Vec<(f64, [f32; 3])>,
}

impl Table {
    /// A table of (isovalue, colour) rows.
    ///
    /// # Errors
    /// When there is no row, an isovalue is not finite or not above the one before, or a colour is negative or not
    /// finite.
    pub fn new(rows: Vec<(f64, [f32; 3])>) -> Result<Self> {
        let refuse = |given: String, expected: &str| {
            Err(Error::argument(
                "table",
                given,
                expected,
                "give rows of an isovalue and its colour, lowest isovalue first",
            ))
        };
        if rows.is_empty() {
            return refuse("no row".into(), "at least one row");
        }
        if let Some((c, _)) = rows.iter().find(|(c, _)| !c.is_finite()) {
            return refuse(c.to_string(), "finite isovalues");
        }
        if let Some(pair) = rows.windows(2).find(|pair| pair[1].0 <= pair[0].0) {
            return refuse(format!("{} after {}", pair[1].0, pair[0].0), "ascending isovalues");
        }
        if let Some((c, colour)) = rows.iter().find(|(_, colour)| colour.iter().any(|v| !(v.is_finite() && *v >= 0.0)))
        {
            return refuse(format!("{colour:?} at {c}"), "finite colours that are not negative");
        }
        Ok(Self { rows })
    }

    /// The colour of an isovalue.
    pub fn at(&self, isovalue: f64) -> [f32; 3] {
        let above = self.rows.partition_point(|(c, _)| *c <= isovalue);
        match (above.checked_sub(1).map(|i| self.rows[i]), self.rows.get(above)) {
            (Some((low, from)), Some(&(high, to))) => {
                let t = ((isovalue - low) / (high - low)) as f32;
                std::array::from_fn(|i| from[i] + t * (to[i] - from[i]))
            }
            (Some((_, colour)), None) => colour,
            (None, Some(&(_, colour))) => colour,
            (None, None) => [0.0; 3],
        }
    }

    /// Isovalues, ascending, and their colours.
    pub fn rows(&self) -> &[(f64, [f32; 3])] {
        &self.rows
    }

    /// The largest number of any row and channel.
    pub fn largest(&self) -> f32 {
        self.rows.iter().flat_map(|(_, colour)| *colour).fold(0.0, f32::max)
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
    /// By a table.
    Table(Table),
}

/// Steps along a colour scale at which its largest channel is looked for.
const SCALE_STEPS: u32 = 256;

impl MaterialRule {
    /// The rule of a colour scale, `NAME` over the range of the volume or `NAME:LOW..HIGH`, times a grey albedo; without one that
    /// albedo for all isovalues.
    ///
    /// # Errors
    /// When there is no such scale, its ends do not rise, or the albedo is not grey.
    pub fn of_colours(spec: Option<&str>, albedo: [f32; 3], range: (f64, f64)) -> Result<Self> {
        let Some(spec) = spec else {
            return Ok(Self::Constant(albedo));
        };
        if albedo[0] != albedo[1] || albedo[1] != albedo[2] {
            let expected = "one number together with --colormap";
            return Err(Error::argument("--albedo", format!("{albedo:?}"), expected, "it is a factor on the colours"));
        }
        let (name, part) = spec.split_once(':').map_or((spec, None), |(n, p)| (n, Some(p)));
        let colormap = match (Colormap::named(name), nearest(name, Colormap::names())) {
            (Err(_), Some(near)) => {
                let known = Colormap::names().collect::<Vec<_>>().join(", ");
                let expected = format!("one of {known}");
                return Err(Error::argument("colormap", name, expected, format!("did you mean {near}?")));
            }
            (result, _) => result?,
        };
        let (low, high) = match part {
            None => range,
            Some(part) => {
                let ends =
                    part.split_once("..").and_then(|(l, h)| Some((l.parse::<f64>().ok()?, h.parse::<f64>().ok()?)));
                ends.filter(|(l, h)| l.is_finite() && h.is_finite() && l < h).ok_or_else(|| {
                    let expected = "two rising isovalues such as 0..255";
                    Error::argument("colormap", spec, expected, format!("write {name}:LOW..HIGH"))
                })?
            }
        };
        Ok(Self::Map { colormap, low, high, scale: albedo[0] })
    }

    /// Linear albedo of the level set of an isovalue.
    pub fn albedo(&self, isovalue: f64) -> [f32; 3] {
        match self {
            Self::Constant(albedo) => *albedo,
            Self::Map { colormap, low, high, scale } => {
                let t = if high > low { (isovalue - low) / (high - low) } else { 0.5 };
                colormap.linear(t).map(|v| v * scale)
            }
            Self::Table(table) => table.at(isovalue),
        }
    }

    /// The largest albedo of any channel: of some isovalues, or of all.
    pub fn largest_albedo(&self, isovalues: Option<&[f64]>) -> f32 {
        if let Some(list) = isovalues {
            return list.iter().flat_map(|&c| self.albedo(c)).fold(0.0, f32::max);
        }
        match self {
            Self::Constant(albedo) => albedo.iter().copied().fold(0.0, f32::max),
            Self::Map { colormap, scale, .. } => {
                let colours = (0..=SCALE_STEPS).flat_map(|i| colormap.linear(f64::from(i) / f64::from(SCALE_STEPS)));
                scale * colours.fold(0.0, f32::max)
            }
            Self::Table(table) => table.largest(),
        }
    }
}

/// Emitted radiance as a function of the isovalue.
#[derive(Clone, Debug, PartialEq)]
pub enum EmissionRule {
    /// The same for every isovalue, linear.
    Constant([f32; 3]),
    /// By a table.
    Table(Table),
}

impl EmissionRule {
    /// Linear emitted radiance of the level set of an isovalue.
    pub fn at(&self, isovalue: f64) -> [f32; 3] {
        match self {
            Self::Constant(emission) => *emission,
            Self::Table(table) => table.at(isovalue),
        }
    }

    /// The largest emission of any channel: of some isovalues, or of all.
    pub fn largest(&self, isovalues: Option<&[f64]>) -> f32 {
        if let Some(list) = isovalues {
            return list.iter().flat_map(|&c| self.at(c)).fold(0.0, f32::max);
        }
        match self {
            Self::Constant(emission) => emission.iter().copied().fold(0.0, f32::max),
            Self::Table(table) => table.largest(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_straight_between_rows_and_constant_beyond() {
        let table =
            Table::new(vec![(10.0, [0.0, 0.5, 1.0]), (20.0, [1.0, 0.5, 0.0]), (40.0, [0.25; 3])]).expect("a table");
        assert_eq!(table.at(-5.0), [0.0, 0.5, 1.0]);
        assert_eq!(table.at(12.5), [0.25, 0.5, 0.75]);
        assert_eq!(table.at(20.0), [1.0, 0.5, 0.0]);
        assert_eq!(table.at(30.0), [0.625, 0.375, 0.125]);
        assert_eq!(table.at(99.0), [0.25; 3]);
        assert_eq!(table.largest(), 1.0);
        let rule = MaterialRule::Table(table);
        assert_eq!((rule.largest_albedo(None), rule.largest_albedo(Some(&[30.0, 99.0]))), (1.0, 0.625));
    }

    #[test]
    fn tables_that_make_no_sense_are_refused() {
        for rows in [
            vec![],
            vec![(1.0, [0.1; 3]), (1.0, [0.2; 3])],
            vec![(2.0, [0.1; 3]), (1.0, [0.2; 3])],
            vec![(f64::NAN, [0.1; 3])],
            vec![(1.0, [0.1, -0.1, 0.0])],
        ] {
            assert!(Table::new(rows.clone()).is_err(), "{rows:?}");
        }
    }
}
