//! What accuracy costs: one surface under one light, baked in many ways, each compared with the same reference.
//!
//! A [`Study`] fixes volume, isovalue, light, albedo and points of the surface. Its reference is made once: paths at the
//! points under the whole light and under the light cut to each number of bands, and texels of many paths on each
//! lattice. A texture baked with any [`Setting`] is then [measured](Study::measure) against it, without the clock: who
//! calls knows what the bake took.
//!
//! # The chain
//! As in [`crate::compare`], with two links more, so that each choice of a setting has a row of its own:
//!
//! | from | to | row |
//! |---|---|---|
//! | paths under the whole light | paths under the light cut to the setting's bands | truncation |
//! | those | exact texels of all layers and bands, interpolated | interpolation, and the noise of the reference |
//! | those | the setting's layers, the bands of each, and the tail | layers |
//! | those | what the bake stored, before rounding (`path`: its texels once more) | noise, bias |
//! | those | the stored numbers | rounding |
//!
//! Bias of an estimator is told from its noise by a second bake of another seed: the mean product of the errors of two
//! independent bakes is the mean square of what they share. For `path` it is 0 by construction and not looked for. The
//! cross terms are a row, so that the rows sum to the mean square of the whole difference. Numbers kept in more or fewer
//! bits than a store's ([`Study::measure_kept_as`]) change the last row alone.

pub mod figure;
pub mod front;
pub mod model;
pub mod placements;
mod storage;

#[cfg(test)]
mod tests;

use crate::compare::slow::{between, radiance_of, trilinear};
use crate::compare::{BandLimited, BudgetRow, Distance, distance, mean_square};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::relight::{Light, Material, Textures, contract};
use crate::sampling::DirectionalSource;
use crate::sampling::hash::key;
use crate::sh::Coefficients;
use crate::transfer::texels_of_isosurface;
use crate::transfer::{BrickSource, Lattice, Layers, Layout, Precision, Selection};
use crate::transport::{Bake, DirectSettings, Radiance, Settings, SurfacePoint, direct, estimates};
use crate::volume::Volume;
use std::collections::BTreeMap;

/// What every bake of a study has in common.
pub struct Study<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// In the file's values.
    pub isovalue: f64,
    /// Where radiance is compared.
    pub points: &'a [SurfacePoint],
    /// The whole light.
    pub light: &'a dyn DirectionalSource,
    /// Its coefficients in world axes, of as many bands as any setting has.
    pub coefficients: &'a [Coefficients; 3],
    /// Diffuse reflectance of each channel.
    pub albedo: [f32; 3],
    /// Paths of the reference at each point, a power of two.
    pub paths: u32,
    /// Paths of each exact texel.
    pub texel_rays: u32,
    /// Layers of the exact texels: more than any setting has.
    pub layers: usize,
    /// Seed of the references.
    pub seed: u64,
}

/// How a texture is baked.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// `path`, `gather` or `photon`.
    pub estimator: &'static str,
    /// Paths for each texel.
    pub rays: u32,
    /// Bands of each layer.
    pub bands: Vec<usize>,
    /// Texels for each sample along an axis.
    pub ratio: f64,
    /// How its coefficients are kept; a store has [`Precision::Half`].
    pub kept_as: Precision,
}

/// The references of a study.
pub struct References {
    whole: Vec<Radiance>,
    by_bands: BTreeMap<usize, Vec<Radiance>>,
    // Of each lattice, by its texels along the axes.
    exact: BTreeMap<[usize; 3], Exact>,
    layers: Layers,
    /// Rays they took.
    pub rays: u64,
}

/// Transfer of the texels around the points, from many paths.
type Exact = BTreeMap<[usize; 3], Vec<f32>>;

/// How exact one texture is.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Against paths under the whole light.
    pub whole: Distance,
    /// Against paths under the light cut to the setting's bands.
    pub band_limited: Distance,
    /// truncation, interpolation, noise of the reference, layers, noise, bias, rounding, cross terms; over the squared
    /// mean of the reference.
    pub budget: Vec<BudgetRow>,
}

impl Measured {
    /// The mean square of a row of the budget; 0 for a row that is not there.
    pub fn row(&self, name: &str) -> f64 {
        self.budget.iter().find(|row| row.name == name).map_or(0.0, |row| row.mean_square)
    }
}

impl Study<'_> {
    /// Makes the references for light cut to each of `bands`, and for each of these lattices.
    ///
    /// # Errors
    /// When there are no points or more bands than the light has coefficients of; as [`direct`] and [`estimates`].
    pub fn references(&self, bands: &[usize], lattices: &[Lattice]) -> Result<References> {
        if self.points.is_empty() {
            return Err(Error::argument("points", 0, "at least one point of a surface", "give another isovalue"));
        }
        let most = self.coefficients[0].bands();
        if let Some(more) = bands.iter().find(|&&b| b > most) {
            let expected = format!("at most {most}, which the light was projected to");
            return Err(Error::argument("bands", more, expected, "project the light to more bands"));
        }
        let cut: Vec<[Coefficients; 3]> = bands.iter().map(|&b| self.cut_to(b)).collect();
        let limited: Vec<BandLimited<'_>> = cut.iter().map(BandLimited).collect();
        let mut lights: Vec<&dyn DirectionalSource> = vec![self.light];
        lights.extend(limited.iter().map(|l| l as &dyn DirectionalSource));
        let settings = DirectSettings { paths: self.paths, albedo: self.albedo, seed: self.seed };
        let (mut found, counts) = direct(self.volume, self.pyramid, self.isovalue, self.points, &lights, &settings)?;
        let by_bands = bands.iter().copied().zip(found.drain(1..)).collect();
        let whole = found.swap_remove(0);
        let layers = Layers::uniform(self.layers, most)?;
        let mut exact = BTreeMap::new();
        for lattice in lattices {
            exact.insert(lattice.texels(), self.exact(*lattice, &layers)?);
        }
        Ok(References { whole, by_bands, exact, layers, rays: counts.rays })
    }

    /// The light cut to some bands.
    pub fn cut_to(&self, bands: usize) -> [Coefficients; 3] {
        std::array::from_fn(|c| self.coefficients[c].truncated(bands))
    }

    fn exact(&self, lattice: Lattice, layers: &Layers) -> Result<Exact> {
        let seed = key(self.seed, 0x0065_7861_6374);
        let settings = Settings { layers: layers.clone(), rays: self.texel_rays, seed, target: None, positive: false };
        self.texels(&Layout { lattice, layers: layers.clone() }, &settings)
    }

    /// The texels around the points as `path` makes them, unrounded.
    fn texels(&self, layout: &Layout, settings: &Settings) -> Result<Exact> {
        let around = self.points.iter().flat_map(|p| trilinear(layout.lattice, p.position_in_grid));
        let distinct: BTreeMap<[usize; 3], ()> = around.map(|(texel, _)| (texel, ())).collect();
        let wanted: Vec<([usize; 3], u32)> = distinct.into_keys().map(|texel| (texel, settings.rays)).collect();
        let selection = Selection::empty(layout.lattice);
        let (volume, pyramid) = (self.volume, self.pyramid);
        let found = estimates(&Bake::new(volume, pyramid, layout, settings, &selection), &wanted)?;
        let valid =
            wanted.iter().zip(found).filter_map(|((texel, _), found)| Some((*texel, found?.swap_remove(0).transfer)));
        Ok(valid.collect())
    }

    /// Radiance at the points from texels laid out as `layers`, of which `kept` are used; `otherwise` where none is valid.
    fn interpolated(
        &self,
        lattice: Lattice,
        texels: &Exact,
        layers: &Layers,
        kept: &Layers,
        light: &[Coefficients; 3],
        otherwise: &[[f64; 3]],
    ) -> Vec<[f64; 3]> {
        let lit: BTreeMap<[usize; 3], [f64; 3]> =
            texels.iter().map(|(t, v)| (*t, radiance_of(layers, v, kept, light, self.albedo))).collect();
        let at = |p: &SurfacePoint| between(&trilinear(lattice, p.position_in_grid), &lit);
        self.points.iter().zip(otherwise).map(|(p, other)| at(p).unwrap_or(*other)).collect()
    }

    /// What a user sees at the points.
    fn looked_up(&self, texture: &dyn BrickSource, light: &[Coefficients; 3]) -> Result<Vec<[f64; 3]>> {
        let light = Light::from_channels(light)?;
        let material = Material::new(self.albedo, [0.0; 3])?;
        let bricks = texels_of_isosurface(self.volume, texture.layout().lattice, self.isovalue).bricks();
        let contracted = contract(&Textures::of_volume(texture)?, &bricks, &light, &material)?;
        let positions: Vec<[f32; 3]> = self.points.iter().map(|p| p.position_in_grid).collect();
        let normals: Vec<[f32; 3]> = self.points.iter().map(|p| p.normal).collect();
        let lit = contracted.look_up(&positions, &normals, &light, &material);
        if lit.report.unbaked > 0 {
            let found =
                format!("{} of {} lookups meet texels that were never baked", lit.report.unbaked, lit.report.lookups);
            return Err(Error::argument("texture", found, "all texels of the isovalue", "bake it whole"));
        }
        Ok(lit.radiance.iter().map(|v| v.map(f64::from)).collect())
    }

    /// Holds a texture against the references. `baked_by` are the settings of `path`, whose texels are made again;
    /// `second` is a texture of the same setting and another seed, for an estimator that may be biased.
    ///
    /// # Errors
    /// When the references lack the texture's lattice or bands; as [`contract`] and [`estimates`].
    pub fn measure(
        &self,
        references: &References,
        texture: &dyn BrickSource,
        baked_by: Option<&Settings>,
        second: Option<&dyn BrickSource>,
    ) -> Result<Measured> {
        let basis = self.basis(references, texture.layout())?;
        let stored = self.looked_up(texture, &basis.light)?;
        let again = match baked_by {
            Some(settings) => {
                let texels = self.texels(texture.layout(), settings)?;
                basis.radiance(&texels, &stored)
            }
            None => stored.clone(),
        };
        let shared = match second {
            Some(second) => mean_product(&again, &self.looked_up(second, &basis.light)?, &basis.kept(&stored)),
            None => 0.0,
        };
        basis.budget(&stored, &again, shared)
    }

    /// What holding any texture of this layout against the references needs.
    fn basis<'s>(&'s self, references: &'s References, layout: &'s Layout) -> Result<Basis<'s>> {
        let Layout { lattice, layers } = layout;
        let bands = layers.max_bands();
        let (Some(limited), Some(exact)) = (references.by_bands.get(&bands), references.exact.get(&lattice.texels()))
        else {
            let found = format!("{bands} bands on {:?} texels", lattice.texels());
            let expected = "bands and a lattice with a reference";
            return Err(Error::argument("texture", found, expected, "ask for them first"));
        };
        Ok(Basis { study: self, references, layout, limited, exact, light: self.cut_to(bands) })
    }
}

/// The references of one layout.
struct Basis<'a> {
    study: &'a Study<'a>,
    references: &'a References,
    layout: &'a Layout,
    limited: &'a [Radiance],
    exact: &'a Exact,
    /// Cut to the bands of the layout.
    light: [Coefficients; 3],
}

impl Basis<'_> {
    /// Radiance at the points from texels of the layout; `otherwise` where none is valid.
    fn radiance(&self, texels: &Exact, otherwise: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let Layout { lattice, layers } = self.layout;
        self.study.interpolated(*lattice, texels, layers, layers, &self.light, otherwise)
    }

    /// The same from the exact texels, of which so many layers and bands are used.
    fn of_exact(&self, layers: &Layers, otherwise: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let all = &self.references.layers;
        self.study.interpolated(self.layout.lattice, self.exact, all, layers, &self.light, otherwise)
    }

    /// From the exact texels with the layers and bands of the layout.
    fn kept(&self, otherwise: &[[f64; 3]]) -> Vec<[f64; 3]> {
        self.of_exact(&self.layout.layers, otherwise)
    }

    /// Radiance under the light cut to the bands, by the paths.
    fn cut(&self) -> Vec<[f64; 3]> {
        means(self.limited)
    }

    /// Holds `stored` against the references; `again` is what was to be stored, `shared` the mean square of what two
    /// bakes of it err by together.
    fn budget(&self, stored: &[[f64; 3]], again: &[[f64; 3]], shared: f64) -> Result<Measured> {
        let (whole, cut) = (means(&self.references.whole), self.cut());
        let every = self.of_exact(&Layers::uniform(self.study.layers, self.layout.layers.max_bands())?, stored);
        let kept = self.kept(stored);
        let mean = whole.iter().flatten().sum::<f64>() / (3 * whole.len()) as f64;
        let over = |value: f64| if mean != 0.0 { value / (mean * mean) } else { 0.0 };
        let row = |name, value: f64| BudgetRow { name, mean_square: over(value) };
        let mut budget = vec![
            row("truncation", mean_square(&cut, &whole)),
            row("interpolation", mean_square(&every, &cut) - noise(self.limited)),
            row("noise of the reference", noise(self.limited)),
            row("layers", mean_square(&kept, &every)),
            row("noise", mean_square(again, &kept) - shared),
            row("bias", shared),
            row("rounding", mean_square(stored, again)),
        ];
        let sum: f64 = budget.iter().map(|r| r.mean_square).sum();
        budget.push(BudgetRow { name: "cross terms", mean_square: over(mean_square(stored, &whole)) - sum });
        Ok(Measured {
            whole: distance(stored, &whole, noise(&self.references.whole)),
            band_limited: distance(stored, &cut, noise(self.limited)),
            budget,
        })
    }
}

impl References {
    /// Root mean square of the standard error of the reference, over its mean.
    pub fn noise(&self) -> f64 {
        let mean = self.whole.iter().flat_map(|r| r.mean).sum::<f64>() / (3 * self.whole.len()) as f64;
        noise(&self.whole).sqrt() / mean
    }

    /// What cutting the light to each number of bands leaves out: RMS over the mean.
    pub fn truncation(&self) -> Vec<(usize, f64)> {
        let whole = means(&self.whole);
        let mean = whole.iter().flatten().sum::<f64>() / (3 * whole.len()) as f64;
        self.by_bands.iter().map(|(b, list)| (*b, mean_square(&means(list), &whole).sqrt() / mean)).collect()
    }
}

fn means(references: &[Radiance]) -> Vec<[f64; 3]> {
    references.iter().map(|r| r.mean).collect()
}

/// Mean square of the standard errors.
fn noise(references: &[Radiance]) -> f64 {
    references.iter().flat_map(|r| r.stderr).map(|e| e * e).sum::<f64>() / (3 * references.len()) as f64
}

/// Mean product of the differences of two lists from a third.
fn mean_product(a: &[[f64; 3]], b: &[[f64; 3]], from: &[[f64; 3]]) -> f64 {
    let all = a.iter().zip(b).zip(from).flat_map(|((a, b), f)| (0..3).map(|c| (a[c] - f[c]) * (b[c] - f[c])));
    all.sum::<f64>() / (3 * a.len()) as f64
}
