//! What lies between an eye and what it sees: how media dim a ray up to there, and what they scatter into it.

use super::reference::{SceneReference, Tracer, refuse_body};
use super::world::{Origin, Place, SceneCounts, World};
use crate::error::Result;
use crate::level::{Counts, LevelField, Pyramid};
use crate::sampling::DirectionalSource;
use crate::scene::geometry::Geometry;
use crate::volume::{Volume, with_samples};
use glam::DVec3;
use rayon::prelude::*;

/// Media along a ray up to what it meets first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Airlight {
    /// e^(−τ), exact.
    pub transmittance: [f32; 3],
    /// How far the ray goes; infinite where it meets nothing.
    pub distance: f64,
    /// Radiance scattered and sent into the ray, by as many paths as were asked for; 0 of none.
    pub scattered: [f32; 3],
}

/// Media along rays (origin and direction in world); `isovalue` in the file's values. Of scattered light all orders count, with
/// what walls and level set reflect. Without paths transmittance and distance alone are found.
///
/// # Errors
/// As [`super::scene_radiance`], where paths are asked for.
pub fn airlight(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: &Geometry,
    isovalue: f64,
    rays: &[(DVec3, DVec3)],
    environment: Option<&dyn DirectionalSource>,
    settings: Option<&SceneReference>,
) -> Result<Vec<Airlight>> {
    volume.check_cells()?;
    if let Some(settings) = settings {
        settings.check()?;
        refuse_body(Some(geometry))?;
    }
    let raw = volume.raw_from_value(isovalue) as f32;
    with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let world = &World::new(volume, &field, geometry);
        let isovalues = world.isovalues(raw);
        let environments = environment.as_slice();
        let tracer = settings.map(|settings| Tracer { world, isovalues: isovalues.clone(), environments, settings });
        let along = |(i, &(origin, direction)): (usize, &(DVec3, DVec3))| {
            let mut counts = SceneCounts::default();
            let direction = direction.normalize_or(DVec3::Z);
            let from = Origin { place: Place::Free, in_world: origin };
            let met = world.meet(&isovalues, &from, direction, &mut Counts::default(), &mut counts);
            let distance = world.distance_to(&met, &from, direction);
            let transmittance = world.media.transmittance(origin, direction, distance, &mut counts).map(|t| t as f32);
            let scattered = tracer.as_ref().map(|tracer| tracer.scattered(from, direction, i as u64, &mut counts));
            let scattered = scattered.map_or([0.0; 3], |light| light.mean.map(|v| v as f32));
            Airlight { transmittance, distance, scattered }
        };
        Ok(rays.par_iter().enumerate().map(along).collect())
    })
}
