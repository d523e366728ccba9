//! Which isovalues of several volumes are shown together.
//!
//! A ray carries one isovalue for life. Where several volumes light each other it carries one for each, and those must
//! be functions of each other: the coupling says which. Beason (2005) shows two fields lit together; the same fraction of
//! each range, chosen pairs, and equal isovalues, for volumes whose values mean the same, are ours.

use crate::error::{Error, Result};

/// Which isovalues belong together.
#[derive(Clone, Debug, PartialEq)]
pub enum Coupling {
    /// The same fraction of each volume's own range of values.
    Normalised,
    /// The same value.
    Equal,
    /// Rows of isovalues, one for each volume in their order, strictly rising or falling in every column. Between two
    /// rows isovalues are interpolated; beyond the first and the last one there is none.
    Rows(Vec<Vec<f64>>),
}

/// A volume as the coupling sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct Coupled {
    /// For messages.
    pub name: String,
    /// Smallest and largest value.
    pub range: (f64, f64),
}

/// The isovalue of one volume that belongs to that of another: piecewise linear between knots.
#[derive(Clone, Debug, PartialEq)]
pub struct IsovalueMap {
    // Ascending in the first number; empty for the identity.
    knots: Vec<[f64; 2]>,
}

impl IsovalueMap {
    /// From knots, as a store keeps them; none for the identity.
    pub fn from_knots(mut knots: Vec<[f64; 2]>) -> Self {
        knots.sort_by(|x, y| x[0].total_cmp(&y[0]));
        Self { knots }
    }

    /// The partner's isovalue, in the values of its file. Before the first knot and after the last that of the knot:
    /// texels beside a surface have isovalues a little beyond its own.
    pub fn at(&self, isovalue: f64) -> f64 {
        let [first, .., last] = self.knots.as_slice() else {
            return self.knots.first().map_or(isovalue, |knot| knot[1]);
        };
        if isovalue <= first[0] {
            return first[1];
        }
        if isovalue >= last[0] {
            return last[1];
        }
        let next = self.knots.partition_point(|knot| knot[0] <= isovalue).clamp(1, self.knots.len() - 1);
        let ([a, b], [c, d]) = (self.knots[next - 1], self.knots[next]);
        b + (isovalue - a) / (c - a) * (d - b)
    }

    /// The knots; none for the identity.
    pub fn knots(&self) -> &[[f64; 2]] {
        &self.knots
    }
}

impl Coupling {
    /// A short name for tables.
    #[doc(hidden)]
    pub fn describe(&self) -> String {
        match self {
            Self::Normalised => "the same normalised isovalue".into(),
            Self::Equal => "equal isovalues".into(),
            Self::Rows(rows) if rows.len() == 1 => "one chosen pair of isovalues".into(),
            Self::Rows(rows) => format!("{} chosen pairs of isovalues", rows.len()),
        }
    }

    /// Checks the coupling against the volumes it couples.
    ///
    /// # Errors
    /// When there are fewer than two volumes or two of one name, a volume is constant, ranges do not overlap where values
    /// are to be equal, or rows are not as [`Self::Rows`] says.
    pub fn check(&self, volumes: &[Coupled]) -> Result<()> {
        if volumes.len() < 2 {
            let found = format!("{} of them", volumes.len());
            let remedy = "write volume = \"…\" for one volume alone, or add another [[volumes]]";
            return Err(Error::argument("volumes", found, "two volumes or more", remedy));
        }
        for (i, volume) in volumes.iter().enumerate() {
            if volumes[..i].iter().any(|other| other.name == volume.name) {
                let remedy = "give each its own, as in name = \"inner\"";
                return Err(Error::argument("volumes", &volume.name, "names that differ", remedy));
            }
            let (low, high) = volume.range;
            if low >= high {
                let found = format!("{}, all of whose values are {low}", volume.name);
                return Err(Error::argument("volumes", found, "volumes with surfaces", "take it out"));
            }
        }
        match self {
            Self::Normalised => Ok(()),
            Self::Equal => overlap(volumes).map(drop),
            Self::Rows(rows) => check_rows(rows, volumes),
        }
    }

    /// From an isovalue of volume `from` to that of volume `to`; of volumes that were checked.
    #[doc(hidden)]
    pub fn between(&self, volumes: &[Coupled], from: usize, to: usize) -> IsovalueMap {
        let ((a, b), (c, d)) = (volumes[from].range, volumes[to].range);
        IsovalueMap::from_knots(match self {
            Self::Normalised => vec![[a, c], [b, d]],
            Self::Equal => Vec::new(),
            Self::Rows(rows) => rows.iter().map(|row| [row[from], row[to]]).collect(),
        })
    }

    /// Refuses an isovalue of volume `of` that belongs to none of another.
    ///
    /// # Errors
    /// When rows or equal values leave it without a partner.
    #[doc(hidden)]
    pub fn check_isovalue(&self, volumes: &[Coupled], of: usize, isovalue: f64) -> Result<()> {
        let (low, high) = match self {
            Self::Normalised => volumes[of].range,
            Self::Equal => overlap(volumes)?,
            Self::Rows(rows) => {
                let column = rows.iter().map(|row| row[of]);
                column.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)))
            }
        };
        if (low..=high).contains(&isovalue) {
            return Ok(());
        }
        let name = &volumes[of].name;
        let expected = if low == high {
            format!("{low}, the one of {name} that has a partner")
        } else {
            format!("{low} to {high}, where isovalues of {name} have partners")
        };
        let remedy = "choose one of these, or give the pair in `coupling` and bake anew";
        Err(Error::argument("isovalue", format!("{name}={isovalue}, which has no partner"), expected, remedy))
    }
}

/// The values that all volumes have.
fn overlap(volumes: &[Coupled]) -> Result<(f64, f64)> {
    let low = volumes.iter().fold(f64::NEG_INFINITY, |low, v| low.max(v.range.0));
    let high = volumes.iter().fold(f64::INFINITY, |high, v| high.min(v.range.1));
    if low < high {
        return Ok((low, high));
    }
    let ranges: Vec<String> = volumes.iter().map(|v| format!("{} {} to {}", v.name, v.range.0, v.range.1)).collect();
    let remedy = "couple the normalised isovalues, or give pairs as in coupling = [[30, 0.5]]";
    Err(Error::argument("coupling", format!("equal isovalues of {}", ranges.join(", ")), "ranges that overlap", remedy))
}

fn check_rows(rows: &[Vec<f64>], volumes: &[Coupled]) -> Result<()> {
    let order = volumes.iter().map(|v| v.name.as_str()).collect::<Vec<_>>().join(", ");
    let refuse = |found: String, expected: &str| {
        let remedy = format!("give rows of isovalues of {order}");
        Err(Error::argument("coupling", found, expected, remedy))
    };
    if rows.is_empty() {
        return refuse("no row".into(), "at least one row");
    }
    for row in rows {
        if row.len() != volumes.len() {
            return refuse(format!("{row:?}"), "one isovalue for each volume");
        }
        for (value, volume) in row.iter().zip(volumes) {
            if !(volume.range.0..=volume.range.1).contains(value) {
                let (low, high) = volume.range;
                return refuse(format!("{value} of {}", volume.name), &format!("a value from {low} to {high}"));
            }
        }
    }
    for (column, volume) in volumes.iter().enumerate() {
        let values: Vec<f64> = rows.iter().map(|row| row[column]).collect();
        let rises = values.windows(2).all(|pair| pair[0] < pair[1]);
        let falls = values.windows(2).all(|pair| pair[0] > pair[1]);
        if !(rises || falls) {
            let found = format!("{values:?} of {}", volume.name);
            return refuse(found, "isovalues that rise, or fall, from row to row");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volumes(ranges: &[(f64, f64)]) -> Vec<Coupled> {
        let volume = |(i, range): (usize, &(f64, f64))| Coupled { name: format!("v{i}"), range: *range };
        ranges.iter().enumerate().map(volume).collect()
    }

    #[test]
    fn isovalues_go_there_and_back() {
        let two = volumes(&[(0.0, 200.0), (-1.5, 1.5)]);
        let rows = Coupling::Rows(vec![vec![10.0, 1.0], vec![50.0, 0.0], vec![60.0, -1.25]]);
        for coupling in [Coupling::Normalised, rows.clone()] {
            coupling.check(&two).expect("a coupling");
            let (there, back) = (coupling.between(&two, 0, 1), coupling.between(&two, 1, 0));
            for i in 0..=20 {
                let c = 10.0 + 2.5 * f64::from(i);
                assert!((back.at(there.at(c)) - c).abs() < 1e-12 * 60.0, "{c}");
            }
        }
        assert_eq!(Coupling::Normalised.between(&two, 0, 1).at(50.0), -0.75);
        assert_eq!(rows.between(&two, 0, 1).at(30.0), 0.5);
        // Knots are met exactly, and beyond the ends the last ones hold.
        for (c, expected) in [(10.0, 1.0), (50.0, 0.0), (60.0, -1.25), (0.0, 1.0), (99.0, -1.25)] {
            assert_eq!(rows.between(&two, 0, 1).at(c), expected);
        }
        assert_eq!(Coupling::Rows(vec![vec![47.0, 0.6]]).between(&two, 0, 1).at(46.2), 0.6);
        assert_eq!(Coupling::Equal.between(&two, 0, 1).at(0.3), 0.3);
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        let two = volumes(&[(0.0, 200.0), (-1.5, 1.5)]);
        let refusal = |coupling: &Coupling, volumes: &[Coupled]| coupling.check(volumes).expect_err("").to_string();
        assert!(refusal(&Coupling::Normalised, &two[..1]).contains("two volumes or more"));
        assert!(refusal(&Coupling::Normalised, &[two[0].clone(), two[0].clone()]).contains("names that differ"));
        assert!(refusal(&Coupling::Normalised, &volumes(&[(0.0, 1.0), (2.0, 2.0)])).contains("v1, all of whose"));
        let apart = volumes(&[(0.0, 1.0), (2.0, 3.0)]);
        assert!(refusal(&Coupling::Equal, &apart).contains("ranges that overlap"));
        for (rows, words) in [
            (vec![], "no row"),
            (vec![vec![1.0]], "one isovalue for each volume"),
            (vec![vec![1.0, 2.0]], "2 of v1"),
            (vec![vec![1.0, 0.0], vec![2.0, 0.0]], "rise, or fall"),
            (vec![vec![1.0, 0.0], vec![2.0, 1.0], vec![3.0, 0.5]], "rise, or fall"),
        ] {
            let message = refusal(&Coupling::Rows(rows), &two);
            assert!(message.contains(words), "{message}");
        }
        let pair = Coupling::Rows(vec![vec![47.0, 0.6]]);
        pair.check_isovalue(&two, 0, 47.0).expect("its isovalue");
        let message = pair.check_isovalue(&two, 0, 48.0).expect_err("no pair").to_string();
        assert!(message.contains("v0=48") && message.contains("47, the one of v0"), "{message}");
        assert!(Coupling::Equal.check_isovalue(&two, 0, 2.0).is_err());
        assert!(Coupling::Normalised.check_isovalue(&two, 1, 1.0).is_ok());
    }
}
