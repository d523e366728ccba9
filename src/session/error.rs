//! How far a lit surface is from exact light transport, from the check points of its store.

use super::textures::{Groups, radiance_of_bricks};
use super::{Lighting, Lit, Member, Part};
use crate::error::Result;
use crate::geom::Up;
use crate::probe::LatLong;
use crate::relight::{ErrorTerm, LookupReport, Lookups, Scene, TotalError, TriangleIndex, total_error};
use crate::transfer::checks::CheckPoints;
use crate::transfer::{BRICK, Lattice, Selection};
use glam::Vec3;

/// Pixels across of the image that truncation is measured against: about 6°, the spacing of some hundreds of directions.
const PIXELS: usize = 64;
/// Check points nearest in isovalue that count, of those of all isovalues.
const NEAREST: usize = 256;

impl Lit<'_> {
    /// The same with [`Lit::total_error`]: how far the colours are from exact light transport on the surface, estimated from the
    /// check points of the store, without a ray. There is none where the store has no check points: it is of another
    /// estimator, a draft, or older. Lamps that are lit apart have no part in it but by their noise.
    ///
    /// # Errors
    /// When check points are damaged or a texture cannot be read.
    pub fn with_total_error(mut self) -> Result<Self> {
        self.total = self.estimate_total_error()?;
        Ok(self)
    }

    /// What [`Lit::with_total_error`] keeps, for who wants it later.
    ///
    /// # Errors
    /// As [`Lit::with_total_error`].
    #[doc(hidden)]
    pub fn estimate_total_error(&self) -> Result<Option<TotalError>> {
        let texels = &self.texels;
        let parts = texels.surface.parts.iter().zip(texels.surface.session.members());
        let mut first = 0;
        let mut found: Vec<(f64, TotalError)> = Vec::new();
        for (number, (part, member)) in parts.enumerate() {
            let range = first..first + part.isosurface.mesh().normals.len();
            first = range.end;
            let radiance = &self.radiance[range];
            let Some(error) = self.of_part((number, part), member, radiance)? else { return Ok(None) };
            found.push((radiance.len() as f64, error));
        }
        Ok(together(&found))
    }

    /// The error of one volume, over the mean radiance of all.
    fn of_part(
        &self,
        (number, part): (usize, &Part),
        member: &Member<'_>,
        radiance: &[[f32; 3]],
    ) -> Result<Option<TotalError>> {
        let texels = &self.texels;
        let (lighting, material) = (texels.lighting, &texels.material);
        let isovalue = part.isosurface.isovalue();
        let transfer = part.isosurface.transfer();
        let source = transfer.unwrap_or(member.store());
        let checks = match source.checks(Some(isovalue))? {
            Some(checks) => checks,
            None => match source.checks(None)? {
                Some(all) => nearest(&all, isovalue),
                None => return Ok(None),
            },
        };
        if checks.is_empty() || radiance.is_empty() {
            return Ok(None);
        }
        let mut report = LookupReport::default();
        let light = &lighting.light;
        let places = checks.positions_in_grid.iter().zip(&checks.normals);
        let contracted = &texels.members[number];
        // Of the transfer alone, as what is looked up at the check points.
        let own = match transfer {
            Some(_) => contracted.vertex_errors(radiance.len()),
            None => contracted.look_up_errors(&part.isosurface.mesh().positions_in_grid),
        };
        let (found, stated): (Vec<[f32; 3]>, Vec<f32>) = match (transfer, part.triangles()) {
            (Some(_), Some(index)) => places
                .map(|(&position, &normal)| {
                    let found = contracted.between_vertices(&index, position, normal, light, material, &mut report);
                    (found, error_between(&index, position, &own))
                })
                .unzip(),
            _ => {
                let bricks = bricks_around(source.layout().lattice, &checks.positions_in_grid);
                let (contracted, _) = radiance_of_bricks(source, &bricks, lighting, material, &texels.luminaires)?;
                let stated = contracted.look_up_errors(&checks.positions_in_grid);
                let looked_up = places
                    .map(|(&position, &normal)| contracted.radiance_at(position, normal, light, material, &mut report));
                (looked_up.collect(), stated)
            }
        };
        let count = radiance.len() as f64;
        let mean =
            self.radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * self.radiance.len() as f64);
        let vertex_noise = (own.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / count).sqrt();
        let lamp_noise = texels.suns[number].as_ref().map_or(0.0, |suns| suns.noise(&lighting.suns, material));
        let at_vertices = transfer.is_some();
        let lookups = Lookups { radiance: &found, errors: &stated, vertex_noise, lamp_noise, mean, at_vertices };
        let groups = Groups::open(source, &texels.luminaires)?;
        let scene =
            source.identity().scene.as_ref().map(|_| Scene { luminaires: groups.factors().map(|(_, f)| f).collect() });
        let image = Blurred::new(lighting, texels.surface.session.up())?;
        let seen = |direction: Vec3| image.seen(direction);
        let layers = &source.layout().layers;
        Ok(total_error(layers, &checks, &lookups, (light, material), scene.as_ref(), Some(&seen)))
    }
}

/// The errors of several surfaces as one; all are over the same mean.
fn together(found: &[(f64, TotalError)]) -> Option<TotalError> {
    if let [(_, one)] = found {
        return Some(*one);
    }
    let all: f64 = found.iter().map(|(count, _)| count).sum();
    let rms = |of: &dyn Fn(&TotalError) -> f64| {
        (found.iter().map(|(count, error)| count * of(error).powi(2)).sum::<f64>() / all).sqrt()
    };
    let term =
        |of: &dyn Fn(&TotalError) -> ErrorTerm| ErrorTerm { rms: rms(&|e| of(e).rms), upper: rms(&|e| of(e).upper) };
    let mut error = found.first()?.1;
    error.rms = rms(&|e| e.rms);
    error.percentile_95 = found.iter().map(|(_, e)| e.percentile_95).fold(0.0, f64::max);
    (error.noise, error.texture) = (term(&|e| e.noise), term(&|e| e.texture));
    error.truncation = match found.iter().all(|(_, e)| e.truncation.is_some()) {
        true => Some(term(&|e| e.truncation.unwrap_or_default())),
        false => None,
    };
    error.points = found.iter().map(|(_, e)| e.points).sum();
    Some(error)
}

/// Of check points of all isovalues those nearest to one.
fn nearest(all: &CheckPoints, isovalue: f64) -> CheckPoints {
    let mut order: Vec<usize> = (0..all.len()).collect();
    let distance = |i: &usize| (all.isovalues[*i] - isovalue).abs();
    order.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
    order.truncate(NEAREST);
    order.sort_unstable();
    all.of(&order)
}

/// Standard error of the mean in a triangle, from those of its corners, which are independent.
fn error_between(index: &TriangleIndex<'_>, position: [f32; 3], errors: &[f32]) -> f32 {
    let Some((triangle, weights)) = index.nearest(position) else { return 0.0 };
    let variance = triangle.iter().zip(weights).map(|(&v, w)| (w * errors[v as usize]).powi(2)).sum::<f32>();
    variance.sqrt()
}

/// The bricks that lookups at some positions read, ascending.
fn bricks_around(lattice: Lattice, positions_in_grid: &[[f32; 3]]) -> Vec<[usize; 3]> {
    let mut selection = Selection::empty(lattice);
    for position in positions_in_grid {
        selection.insert_cell(std::array::from_fn(|a| {
            (position[a].max(0.0) as usize).min(lattice.grid()[a].saturating_sub(2))
        }));
    }
    debug_assert!(lattice.brick_shape() == [BRICK; 3]);
    selection.bricks()
}

/// The image of an environment, blurred, without the lamps that are lit apart.
struct Blurred {
    probe_from_world: glam::DMat3,
    rest: LatLong,
}

impl Blurred {
    fn new(lighting: &Lighting<'_>, up: Up) -> Result<Self> {
        Ok(Self {
            probe_from_world: lighting.options.orientation(up)?.probe_from_world(),
            rest: lighting.rest.as_ref().unwrap_or(lighting.probe).image.reduced(PIXELS),
        })
    }

    /// What a path sees that escapes along a direction.
    fn seen(&self, direction_in_world: Vec3) -> [f32; 3] {
        self.rest.radiance(self.probe_from_world * direction_in_world.as_dvec3())
    }
}
