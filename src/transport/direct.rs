//! The reference without a texture: path tracing at each point of one surface under given lights.
//!
//! Exitant radiance of the Lambertian level set, L_o = ρ/π ∫ (V L + (1−V) L_o') (n·ω)⁺ dω, by paths that see only that
//! level set, and what stands around it. It shares with the bake what both are defined by (what a ray meets, normals,
//! the rule for rays lost in the solid) and nothing else: no spherical harmonics, no layers, no lookup. What shares
//! none of that is [`super::geometric()`].

use super::REPLICATES;
use super::scene_path::{SceneCounts, SceneReference, Tracer, World, refuse_body};
use crate::error::Result;
use crate::geom::Normal;
use crate::level::{LevelField, Pyramid, Start};
use crate::sampling::DirectionalSource;
use crate::scene::geometry::Geometry;
use crate::volume::{Volume, with_samples};
use glam::Vec3;
use rayon::prelude::*;

/// A point of a surface at which radiance is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where, in grid space; on the level set up to rounding.
    pub position_in_grid: [f32; 3],
    /// Unit normal in world axes, towards the lit side.
    pub normal: [f32; 3],
}

/// Exitant radiance at a point, with its standard error, per channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Radiance {
    /// Mean over the replicates.
    pub mean: [f64; 3],
    /// Standard error of the mean, three degrees of freedom.
    pub stderr: [f64; 3],
}

impl Radiance {
    /// From the sums of some independent replicates, each of so many paths.
    pub(super) fn of_replicates(sums: &[[f64; 3]; REPLICATES], paths: u32) -> Self {
        let mut out = Self::default();
        for c in 0..3 {
            let means = sums.each_ref().map(|sum| sum[c] / f64::from(paths));
            let mean = means.iter().sum::<f64>() / REPLICATES as f64;
            let spread: f64 = means.iter().map(|m| (m - mean).powi(2)).sum();
            let variance = spread / (REPLICATES * (REPLICATES - 1)) as f64;
            (out.mean[c], out.stderr[c]) = (mean, variance.sqrt());
        }
        out
    }
}

/// Radiance at `points` of the isosurface `isovalue` (in the file's values) under each of `environments`: one list an
/// environment, in the order of the points, and one where there is none. Luminaires of `geometry` and emission add to
/// each. All share the paths, so that differences between two of them have little noise. `settings.sees_through_backs`
/// does not matter.
///
/// # Errors
/// When the number of paths or an albedo is not as [`SceneReference`] says, or the volume has no cells.
pub fn direct(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: Option<&Geometry>,
    isovalue: f64,
    points: &[SurfacePoint],
    environments: &[&dyn DirectionalSource],
    settings: &SceneReference,
) -> Result<(Vec<Vec<Radiance>>, SceneCounts)> {
    settings.check()?;
    volume.check_cells()?;
    refuse_body(geometry)?;
    let nothing = Geometry::new(Vec::new(), Vec::new(), 1.0)?;
    let each: Vec<(Vec<Radiance>, SceneCounts)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let world = &World::new(volume, &field, geometry.unwrap_or(&nothing));
        let isovalues = world.isovalues(volume.raw_from_value(isovalue) as f32);
        let tracer = Tracer { world, isovalues, environments, settings };
        points
            .par_iter()
            .enumerate()
            .map(|(i, point)| {
                let mut counts = SceneCounts::default();
                let Some(normal) = Normal::down_gradient(-Vec3::from_array(point.normal)) else {
                    return (vec![Radiance::default(); environments.len().max(1)], counts);
                };
                let at = field.locate(point.position_in_grid.map(f64::from));
                (tracer.leaving(at, normal, i as u64, &mut counts), counts)
            })
            .collect()
    });
    let mut counts = SceneCounts::default();
    each.iter().for_each(|(_, c)| counts += *c);
    let under = |e: usize| each.iter().map(|(found, _)| found[e]).collect();
    Ok(((0..environments.len().max(1)).map(under).collect(), counts))
}

/// Which points of an isosurface lie in the solid of a volume beside it, where nobody sees them.
pub fn buried(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: &Geometry,
    isovalue: f64,
    points: &[SurfacePoint],
) -> Vec<bool> {
    with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let world = World::new(volume, &field, geometry);
        let isovalues = world.isovalues(volume.raw_from_value(isovalue) as f32);
        let is_buried = |p: &SurfacePoint| {
            let start = Start::on(field.locate(p.position_in_grid.map(f64::from)));
            world.is_buried(&isovalues, world.on_level(0, start).in_world)
        };
        points.iter().map(is_buried).collect()
    })
}
