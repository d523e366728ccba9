//! The estimator of a volume among walls, luminaires and other volumes: a texture for the environment, one for emission, and
//! one a luminaire.
//!
//! # Where texels stop
//! With a target the standard error of each of its numbers is that of the environment, as [`Target`] says, and that of the
//! luminaires in quadrature. Light of a luminaire is sampled, so that its error is no matter of paths that by chance end
//! elsewhere, and is stated by the spread of the replicates alone. With three degrees of freedom that would let texels stop by
//! luck: see [`BY_LUCK`].

use super::super::REPLICATES;
use super::super::bake::Bake;
use super::super::control::escaping_shares;
use super::super::errors::Paths;
use super::super::estimator::{Estimator, Fate};
use super::super::gather::Ahead;
use super::super::path::{FIRST_POINTS, Settings, Target, TexelEstimate, expected_error, next_points};
use super::super::replay::ReplayedPath;
use super::super::summary::Summary;
use super::super::sums::{combine, defend_degenerate, target_stderr, variance_of_mean};
use super::estimate::{Found, Record, trace};
use super::world::World;
use crate::error::Result;
use crate::geom::Normal;
use crate::level::{LevelField, Site};
use crate::scene::geometry::Geometry;
use crate::transfer::Layers;
use crate::volume::Sample;
use glam::{DVec3, Vec3};

/// Factor on the standard error of luminaires' light before it is compared with a target.
///
/// The spread of four replicates, with three degrees of freedom, is less than half of the truth in one texel out of seven, and a
/// texel is asked again each time that its paths grow. With 1.6 texels of the bump box in its room stop at 0.72 of a target of
/// 10 % and at 0.92 of one of 4 %, in RMS (`tests/physics/scene_walls.rs`).
const BY_LUCK: f32 = 1.6;

/// A part of the light that only photons find.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The number of its luminaire.
    pub luminaire: usize,
    /// Reflections by level sets on the way.
    pub layer: usize,
    /// Exitant radiance at an albedo of 1.
    pub light: [f64; 3],
}

/// Light that a mirror or glass was the first to meet, of luminaires that no path finds so ([`super::needs_photons`]).
pub trait SpecularLight: Sync {
    /// Calls for each part of the light that arrives at a point of a level set, from the gradient of the raw samples there, in grid
    /// space, its isovalue in raw samples, and its normal in world.
    fn arriving(
        &self,
        in_grid: DVec3,
        raw_gradient: Vec3,
        raw_isovalue: f64,
        normal: Normal,
        add: &mut dyn FnMut(Arrival),
    );
}

/// A volume in its world.
pub(in super::super) struct Among<'a, T> {
    world: World<'a, T>,
    settings: &'a Settings,
    caustics: bool,
    specular: Option<&'a dyn SpecularLight>,
    ahead: Option<&'a Ahead<'a>>,
    // Of each group.
    layers: Vec<Layers>,
    // 2^-e of each group.
    factors: Vec<f64>,
}

impl<'a, T: Sample> Among<'a, T> {
    pub(in super::super) fn new(
        bake: &'a Bake<'_>,
        field: &'a LevelField<'a, T>,
        geometry: &'a Geometry,
    ) -> Result<Self> {
        let layers = bake.groups().iter().map(|g| Ok(g.layout(bake.layout)?.layers)).collect::<Result<Vec<_>>>()?;
        let of_luminaires = geometry.exponents(bake.volume).into_iter().map(|e| libm::ldexp(1.0, -e));
        let factors = [1.0, 1.0].into_iter().chain(of_luminaires).collect();
        let world = World::new(bake.volume, field, geometry);
        let specular = bake.specular.filter(|_| bake.caustics);
        Ok(Self { world, settings: bake.settings, caustics: bake.caustics, specular, ahead: None, layers, factors })
    }

    /// The same by paths that end where the cache knows what is ahead of them.
    pub(in super::super) fn with(self, ahead: &'a Ahead<'a>) -> Self {
        Self { ahead: Some(ahead), ..self }
    }

    /// Means and standard errors of all groups after `points` paths of each replicate.
    fn combine(&self, found: &Found, points: usize, out: &mut [TexelEstimate<f64>]) {
        let paths = points as f64;
        let betas: [[f64; 2]; REPLICATES] = std::array::from_fn(|r| shares_of_others(found, r));
        for (g, (layers, out)) in self.layers.iter().zip(out.iter_mut()).enumerate() {
            let coefficients = layers.coefficients();
            let value = |k: usize, r: usize, i: usize| {
                let sum = match g {
                    0 => {
                        found.environment[r * coefficients + i]
                            - betas[r][k.min(1)] * found.controls[r * coefficients + i]
                    }
                    _ => found.groups[((g - 1) * REPLICATES + r) * coefficients + i],
                };
                sum / paths * self.factors[g]
            };
            // A path adds one direction to the environment, and none to the others.
            // Nodes of a body share all directions.
            let is_known = g == 0 && self.world.body.is_none();
            let paths = if is_known { self.paths(found, points) } else { Paths::unknown() };
            combine(layers, &paths, value, out);
            (out.lost, out.trapped, out.rays) = (found.lost, found.trapped, (points * REPLICATES) as u32);
            if g == 0 && (1..REPLICATES).all(|r| same_first(layers, &value, r)) {
                defend_degenerate(layers, points * REPLICATES, out);
            }
        }
        if let Some((environment, _)) = out.split_first_mut() {
            let target = self.settings.target.as_ref();
            let of_environment = target_stderr(&self.layers[0], target, environment);
            let luminaires = target.map_or(0.0, |target| self.variance_of_luminaires(target, found, paths));
            environment.target_stderr = (of_environment * of_environment + BY_LUCK * BY_LUCK * luminaires).sqrt();
        }
    }

    /// The paths of all replicates: those on their way to layer k + 1 are what layer k of the group of emission holds.
    fn paths(&self, found: &Found, points: usize) -> Paths {
        let layers = self.settings.layers.len();
        let count = (points * REPLICATES) as f64;
        let met = |k: usize| (0..REPLICATES).flat_map(move |r| (0..3).map(move |c| 3 * (r * layers + k) + c));
        let arrived = |k: usize| met(k).map(|i| found.groups[i]).sum::<f64>() / 3.0;
        let arrived = std::array::from_fn(|k| match k {
            0 => count,
            _ if k < layers => arrived(k - 1),
            _ => 0.0,
        });
        // What is looked up adds more than one direction.
        let events = if self.ahead.is_some() { 1 } else { layers };
        Paths { events, count, arrived, controlled: !self.settings.positive }
    }

    /// The paths of a site, step by step; none inside another volume.
    pub(in super::super) fn replay(&self, site: &Site, item: u64) -> Vec<ReplayedPath> {
        let isovalues = self.world.isovalues(site.isovalue);
        if self.world.is_buried(&isovalues, self.world.on_level(0, site.start).in_world) {
            return Vec::new();
        }
        let record = Record { grid_from_world: self.world.grid_from_world(), paths: Vec::new() };
        let mut found = Found { record: Some(record), ..Found::default() };
        found.reset(&self.settings.layers, self.world.geometry.luminaires().len());
        let (mut level, mut counts) = (Default::default(), Default::default());
        let (world, settings, all) = (&self.world, self.settings, 0..self.settings.points());
        trace(
            world,
            site,
            &isovalues,
            item,
            all,
            settings,
            self.caustics,
            self.ahead,
            &mut found,
            &mut level,
            &mut counts,
        );
        found.record.map_or(Vec::new(), |record| record.paths)
    }

    /// Adds light that only photons find, and its noise.
    fn add_specular(&self, site: &Site, out: &mut [TexelEstimate<f64>]) {
        let Some(specular) = self.specular else { return };
        let at = &site.start.at;
        let (in_grid, gradient) = (at.in_grid().as_dvec3(), self.world.field.raw_gradient(at));
        let first = 2;
        let mut squares: Vec<f64> = vec![0.0; (out.len() - first) * self.settings.layers.len()];
        specular.arriving(in_grid, gradient, f64::from(site.isovalue), site.normal, &mut |arrival| {
            let Arrival { luminaire, layer, light } = arrival;
            let Some(group) = out.get_mut(first + luminaire).filter(|_| layer < self.settings.layers.len()) else {
                return;
            };
            let light = light.map(|v| v * self.factors[first + luminaire]);
            (0..3).for_each(|c| group.transfer[3 * layer + c] += light[c]);
            let square = light.iter().map(|v| v * v).sum::<f64>() / 3.0;
            squares[luminaire * self.settings.layers.len() + layer] += square;
        });
        for (group, squares) in out[first..].iter_mut().zip(squares.chunks_exact(self.settings.layers.len())) {
            for (stderr, square) in group.stderr.iter_mut().zip(squares) {
                *stderr = (*stderr * *stderr + square).sqrt();
            }
        }
    }

    /// Variance of Σ_l Σ_k w_lk G_k,l, the mean of the channels, from the spread of the replicates.
    fn variance_of_luminaires(&self, target: &Target, found: &Found, paths: f64) -> f32 {
        let mut sums = [0.0; REPLICATES];
        for (l, weights) in target.luminaires.iter().enumerate() {
            let coefficients = 3 * weights.len();
            for (r, sum) in sums.iter_mut().enumerate() {
                let first = ((1 + l) * REPLICATES + r) * coefficients;
                let gains = found.groups[first..first + coefficients].chunks_exact(3);
                let each = gains.zip(weights).map(|(gain, &w)| f64::from(w) * gain.iter().sum::<f64>() / 3.0);
                *sum += each.sum::<f64>() / paths * self.factors[2 + l];
            }
        }
        variance_of_mean(&sums) as f32
    }
}

/// The weights of the control variate in layer 0 and above it: what the other replicates say.
fn shares_of_others(found: &Found, replicate: usize) -> [f64; 2] {
    let sum = |of: usize, above: usize| {
        let others = (0..REPLICATES).filter(|&r| r != replicate);
        others.map(|r| found.rays[r][above][of]).sum::<f64>()
    };
    escaping_shares([0, 1].map(|above| sum(0, above)), [0, 1].map(|above| sum(1, above)))
}

/// Whether replicate `r` has the same a_0 as the first, in every channel.
fn same_first(layers: &Layers, value: &impl Fn(usize, usize, usize) -> f64, r: usize) -> bool {
    let square = layers.bands()[0] * layers.bands()[0];
    (0..layers.channels()).all(|c| value(0, r, c * square) == value(0, 0, c * square))
}

impl<T: Sample> Estimator for Among<'_, T> {
    type Real = f64;
    type Scratch = Found;

    fn layers(&self) -> &[Layers] {
        &self.layers
    }

    fn site(&self, position_in_grid: [f64; 3]) -> Option<Site> {
        self.world.field.site(position_in_grid)
    }

    fn site_on(&self, position_in_grid: [f32; 3], normal: [f32; 3], isovalue: f32) -> Option<Site> {
        self.world.field.site_on(position_in_grid, normal, isovalue)
    }

    fn estimate(
        &self,
        site: &Site,
        item: u64,
        found: &mut Found,
        summary: &mut Summary,
        out: &mut [TexelEstimate<f64>],
    ) -> Fate {
        let isovalues = self.world.isovalues(site.isovalue);
        if self.world.is_buried(&isovalues, self.world.on_level(0, site.start).in_world) {
            summary.scene.buried += 1;
            return Fate::Buried;
        }
        found.reset(&self.settings.layers, self.world.geometry.luminaires().len());
        let most = self.settings.points();
        let (mut done, mut points) = (0, if self.settings.target.is_some() { FIRST_POINTS.min(most) } else { most });
        loop {
            let (level, counts) = (&mut summary.counts, &mut summary.scene);
            let (world, settings) = (&self.world, self.settings);
            trace(
                world,
                site,
                &isovalues,
                item,
                done..points,
                settings,
                self.caustics,
                self.ahead,
                found,
                level,
                counts,
            );
            self.combine(found, points, out);
            match &self.settings.target {
                Some(target) if expected_error(&out[0]) > target.error && points < most => {
                    let excess = expected_error(&out[0]) / target.error;
                    (done, points) = (points, next_points(points, excess, most));
                }
                _ => break,
            }
        }
        if let Some(ahead) = self.ahead {
            ahead.count(&mut found.read);
        }
        self.add_specular(site, out);
        Fate::Estimated
    }
}
