//! Radiance that leaves single points of a volume, each a point of its own level set: the samples of a texture route
//! ([`crate::transport::scatter`]), by the paths of the reference.

use super::reference::{SceneReference, Tracer};
use super::world::{SceneCounts, World};
use crate::error::Result;
use crate::level::{LevelField, Pyramid};
use crate::sampling::DirectionalSource;
use crate::scene::geometry::Geometry;
use crate::transport::Radiance;
use crate::volume::{Volume, with_samples};
use rayon::prelude::*;

/// A point with the isovalue of the level set that it is taken to lie on, and what that is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSite {
    /// Where, in grid space.
    pub position_in_grid: [f64; 3],
    /// Isovalue in the file's values; `None` for that of the field at the point.
    pub isovalue: Option<f64>,
    /// Diffuse reflectance of that level set, in [0, 1].
    pub albedo: [f32; 3],
    /// Radiance that it emits.
    pub emission: [f32; 3],
}

/// Radiance that leaves each site, with its standard error. `None` where the gradient vanishes: no level set passes there.
/// Albedo and emission are those of the sites, not of `settings`, nor does `sees_through_backs` matter. Where nothing stands
/// around the volume, `geometry` is empty.
///
/// # Errors
/// When the number of paths or an albedo is not as [`SceneReference`] says, or the volume has no cells.
pub fn site_radiance(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: &Geometry,
    sites: &[LevelSite],
    environment: Option<&dyn DirectionalSource>,
    settings: &SceneReference,
) -> Result<(Vec<Option<Radiance>>, SceneCounts)> {
    let of_site = |site: &LevelSite| {
        let (albedo, emission) = (site.albedo, site.emission);
        SceneReference { albedo, emission, ..settings.clone() }
    };
    sites.iter().try_for_each(|site| of_site(site).check())?;
    settings.check()?;
    volume.check_cells()?;
    super::refuse_body(Some(geometry))?;
    let each: Vec<(Option<Radiance>, SceneCounts)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let world = &World::new(volume, &field, geometry);
        sites
            .par_iter()
            .enumerate()
            .map(|(i, site)| {
                let mut counts = SceneCounts::default();
                let at = field.locate(site.position_in_grid);
                let Some(normal) = field.normal(&at) else { return (None, counts) };
                let isovalue = site.isovalue.map_or(field.raw_value(&at), |c| volume.raw_from_value(c) as f32);
                let isovalues = world.isovalues(isovalue);
                let (environments, settings) = (environment.as_slice(), &of_site(site));
                let tracer = Tracer { world, isovalues, environments, settings };
                (tracer.leaving(at, normal, i as u64, &mut counts).first().copied(), counts)
            })
            .collect()
    });
    let mut counts = SceneCounts::default();
    each.iter().for_each(|(_, c)| counts += *c);
    Ok((each.into_iter().map(|(radiance, _)| radiance).collect(), counts))
}
