//! The surface itself beside the store and the paths about smoothed normals: one more link at the head of the chain.

use super::{BudgetRow, Comparison, Distance, LitSurface, Question, distance, mean_square};
use crate::error::{Error, Result};
use crate::sampling::hash::key;
use crate::transport::{CellPoints, GeometricCounts, SceneReference, geometric};

/// What paths on the trilinear surface itself say ([`geometric()`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GeometryComparison {
    /// Their mean radiance.
    pub mean: f64,
    /// The store against them.
    pub store: Distance,
    /// The paths about smoothed normals against them, under the whole light: what smoothing does. Point by point that is
    /// what it is for; its mean is an error.
    pub normals: Distance,
    /// From them to the store: *normals*, then the rows of [`Comparison::budget`], over their mean; they sum to the mean
    /// square of `store`.
    pub budget: Vec<BudgetRow>,
    /// Root mean square of their standard error, over their mean.
    pub noise: f64,
    /// What their rays did.
    pub counts: GeometricCounts,
    /// Radiance at each point.
    pub at_points: Vec<[f64; 3]>,
}

/// Refuses what paths on the trilinear surface do not meet.
///
/// # Errors
/// Where something stands around the volume.
pub fn check_geometry(surface: &LitSurface<'_>) -> Result<()> {
    match surface.geometry {
        None => Ok(()),
        Some(_) => {
            let found = "a scene with walls, luminaires or other volumes";
            let remedy = "compare with paths, which meet all of it, or a store of the volume alone";
            Err(Error::argument("geometry", found, "a volume alone under an environment", remedy))
        }
    }
}

/// Puts paths on the surface itself beside what [`super::compare()`] found for the same question, at the points of which
/// `points` are the exact places.
///
/// # Errors
/// As [`check_geometry`] and [`geometric()`]; a comparison of other points.
pub fn compare_geometry(q: &Question<'_>, found: &Comparison, points: &CellPoints) -> Result<GeometryComparison> {
    let surface = &q.surface;
    check_geometry(surface)?;
    if surface.points != points.smoothed || found.at_points.len() != points.smoothed.len() {
        let expected = "those of the question, compared before";
        let remedy = "ask the question at the points that are given";
        return Err(Error::argument("points", format!("{} others", points.smoothed.len()), expected, remedy));
    }
    // Another seed than that of the paths: the noise of both is then known in their difference.
    let seed = key(q.seed, 0x6765_6f6d);
    let settings = SceneReference { emission: surface.emission, ..SceneReference::new(q.paths, surface.albedo, seed) };
    let (radiance, counts) = geometric(surface.volume, surface.isovalue, points, &[surface.light], &settings)?;
    let radiance = radiance.concat();
    let at_points: Vec<[f64; 3]> = radiance.iter().map(|r| r.mean).collect();
    let [stored, paths] = [0, 1].map(|i| found.at_points.iter().map(|p| p[i]).collect::<Vec<_>>());
    let values = (3 * at_points.len()) as f64;
    let variance = radiance.iter().flat_map(|r| r.stderr).map(|e| e * e).sum::<f64>() / values;
    let of_paths = (found.reference_noise * found.mean).powi(2);
    let mean = at_points.iter().flatten().sum::<f64>() / values;
    Ok(GeometryComparison {
        mean,
        store: distance(&stored, &at_points, variance),
        normals: distance(&paths, &at_points, variance + of_paths),
        budget: budget(found, mean, mean_square(&paths, &at_points), mean_square(&stored, &at_points)),
        noise: if mean > 0.0 { variance.sqrt() / mean } else { 0.0 },
        counts,
        at_points,
    })
}

/// The rows from mean squares of the first link and of the whole.
fn budget(found: &Comparison, mean: f64, normals: f64, whole: f64) -> Vec<BudgetRow> {
    let over = |square: f64| if mean > 0.0 { square / (mean * mean) } else { 0.0 };
    let mut rows = vec![BudgetRow { name: "normals", mean_square: over(normals) }];
    let known = found.budget.iter().filter(|row| row.name != super::CROSS_TERMS);
    rows.extend(known.map(|row| BudgetRow { mean_square: over(row.mean_square * found.mean * found.mean), ..*row }));
    let sum: f64 = rows.iter().map(|row| row.mean_square).sum();
    rows.push(BudgetRow { name: super::CROSS_TERMS, mean_square: over(whole) - sum });
    rows
}
