//! What accuracy costs: one surface under one light, baked in many ways, each compared with the same reference.
//!
//! A [`Study`] fixes volume, what stands around it, isovalue, light, albedo and points of the surface. Its reference is
//! made once: paths at the points under the whole light and under the light cut to each number of bands, and texels of
//! many paths on each lattice. A texture baked with any [`Setting`] is then [measured](Study::measure) against it,
//! without the clock: who calls knows what the bake took.
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

mod bake;
pub mod figure;
pub mod forecast;
pub mod front;
pub mod model;
pub mod placements;
pub mod polygonizers;
mod storage;
pub mod sweep;
pub mod thesis;

#[cfg(test)]
mod tests;

pub use bake::{Baked, MemoryTextures};

use crate::bake::Estimator;
use crate::compare::slow::{between, radiance_of};
use crate::compare::{BandLimited, BudgetRow, Distance, LitSurface, Texels, distance, mean_square};
use crate::error::{Error, Result};
use crate::sampling::DirectionalSource;
use crate::sampling::hash::key;
use crate::sh::Coefficients;
use crate::transfer::{BrickSource, Lattice, Layers, Layout, Precision};
use crate::transport::{Radiance, Settings, SurfacePoint};
use std::collections::BTreeMap;

/// Wall-clock and processor seconds since some moment, from whoever may read the clock.
pub type Clock<'a> = dyn Fn() -> [f64; 2] + 'a;

/// What every bake of a study has in common.
pub struct Study<'a> {
    /// The surface, where it is looked at, and its light; coefficients of as many bands as any setting has.
    pub surface: LitSurface<'a>,
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
    /// What fills it; in a scene not [`Estimator::Photon`].
    pub estimator: Estimator,
    /// Paths for each texel.
    pub rays: u32,
    /// Bands of each layer.
    pub bands: Vec<usize>,
    /// Texels for each sample along an axis; at the vertices of the surface, if `None`.
    pub ratio: Option<f64>,
    /// How its coefficients are kept; a store has [`Precision::Half`].
    pub kept_as: Precision,
}

impl Setting {
    /// Where the texels of a surface sit.
    ///
    /// # Errors
    /// As [`Lattice::from_ratio`]; when it is to be at the vertices and the surface has none.
    pub fn lattice(&self, surface: &LitSurface<'_>) -> Result<Lattice> {
        match (self.ratio, surface.vertices) {
            (Some(ratio), _) => Lattice::from_ratio(surface.volume.dims(), ratio),
            (None, Some(vertices)) => Ok(vertices.lattice()),
            (None, None) => {
                let remedy = "give the mesh of the surface, or a ratio";
                Err(Error::argument("ratio", "none, of a surface without a mesh", "its vertices", remedy))
            }
        }
    }
}

/// The references of a study.
pub struct References {
    whole: Vec<Radiance>,
    by_bands: BTreeMap<usize, Vec<Radiance>>,
    // Of each lattice, by its texels along the axes.
    exact: BTreeMap<[usize; 3], Texels>,
    layers: Layers,
    /// Rays they took.
    pub rays: u64,
}

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
    /// When there are no points, no light reaches them, or there are more bands than the light has coefficients of; as
    /// [`crate::transport::direct`] and [`crate::transport::estimates`].
    pub fn references(&self, bands: &[usize], lattices: &[Lattice]) -> Result<References> {
        self.surface.check()?;
        let most = self.surface.coefficients[0].bands();
        if let Some(more) = bands.iter().find(|&&b| b > most) {
            let expected = format!("at most {most}, which the light was projected to");
            return Err(Error::argument("bands", more, expected, "project the light to more bands"));
        }
        let cut: Vec<[Coefficients; 3]> = bands.iter().map(|&b| self.cut_to(b)).collect();
        let limited: Vec<BandLimited<'_>> = cut.iter().map(BandLimited).collect();
        let mut lights: Vec<&dyn DirectionalSource> = vec![self.surface.light];
        lights.extend(limited.iter().map(|l| l as &dyn DirectionalSource));
        let (mut found, rays) = self.surface.by_paths(&lights, self.paths, self.seed)?;
        if found.iter().any(|list| list.iter().all(|r| r.mean == [0.0; 3])) {
            let remedy = "give another environment or isovalue";
            return Err(Error::argument("light", "none at the surface", "light that reaches it", remedy));
        }
        let by_bands = bands.iter().copied().zip(found.drain(1..)).collect();
        let whole = found.swap_remove(0);
        let layers = self.surface.layers_of(Layers::uniform(self.layers, most)?);
        let mut exact = BTreeMap::new();
        for lattice in lattices {
            exact.insert(lattice.texels(), self.exact(*lattice, &layers)?);
        }
        Ok(References { whole, by_bands, exact, layers, rays })
    }

    /// The light cut to some bands.
    pub fn cut_to(&self, bands: usize) -> [Coefficients; 3] {
        std::array::from_fn(|c| self.surface.coefficients[c].truncated(bands))
    }

    fn exact(&self, lattice: Lattice, layers: &Layers) -> Result<Texels> {
        let seed = key(self.seed, 0x0065_7861_6374);
        let settings = Settings { layers: layers.clone(), rays: self.texel_rays, seed, target: None, positive: false };
        self.texels(&Layout { lattice, layers: layers.clone() }, &settings)
    }

    /// The texels around the points as `path` makes them, unrounded.
    fn texels(&self, layout: &Layout, settings: &Settings) -> Result<Texels> {
        let around = self.surface.points.iter().flat_map(|p| self.surface.around(layout.lattice, p));
        let distinct: BTreeMap<[usize; 3], ()> = around.map(|(texel, _)| (texel, ())).collect();
        let wanted: Vec<([usize; 3], u32)> = distinct.into_keys().map(|texel| (texel, settings.rays)).collect();
        self.surface.texels(layout, settings, &wanted)
    }

    /// Radiance at the points from texels laid out as `layers`, of which `kept` are used; `otherwise` where none is valid.
    fn interpolated(
        &self,
        lattice: Lattice,
        texels: &Texels,
        layers: &Layers,
        kept: &Layers,
        light: &[Coefficients; 3],
        otherwise: &[[f64; 3]],
    ) -> Vec<[f64; 3]> {
        let light = self.surface.texel_light(light);
        let lit: BTreeMap<[usize; 3], [f64; 3]> =
            texels.iter().map(|(t, groups)| (*t, radiance_of(layers, groups, kept, &light))).collect();
        let at = |p: &SurfacePoint| between(&self.surface.around(lattice, p), &lit);
        self.surface.points.iter().zip(otherwise).map(|(p, other)| at(p).unwrap_or(*other)).collect()
    }

    /// Holds a bake against the references: its textures, one a group. `baked_by` are the settings of `path`, whose
    /// texels are made again; `second` is a bake of the same setting and another seed, for an estimator that may be
    /// biased.
    ///
    /// # Errors
    /// When the references lack the texture's lattice or bands; as [`LitSurface::by_textures`] and
    /// [`crate::transport::estimates`].
    pub fn measure(
        &self,
        references: &References,
        textures: &[&dyn BrickSource],
        baked_by: Option<&Settings>,
        second: Option<&[&dyn BrickSource]>,
    ) -> Result<Measured> {
        let layout = layout_of(textures)?;
        let basis = self.basis(references, layout)?;
        let (stored, _) = self.surface.by_textures(textures, &basis.light)?;
        let again = match baked_by {
            Some(settings) => {
                let texels = self.texels(layout, settings)?;
                basis.radiance(&texels, &stored)
            }
            None => stored.clone(),
        };
        let shared = match second {
            Some(second) => {
                let (second, _) = self.surface.by_textures(second, &basis.light)?;
                mean_product(&again, &second, &basis.kept(&stored))
            }
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

/// The layout of a bake.
fn layout_of<'t>(textures: &[&'t dyn BrickSource]) -> Result<&'t Layout> {
    let refuse = || Error::argument("textures", 0, "at least that of the environment", "give one a group");
    textures.first().map(|environment| environment.layout()).ok_or_else(refuse)
}

/// The references of one layout.
struct Basis<'a> {
    study: &'a Study<'a>,
    references: &'a References,
    layout: &'a Layout,
    limited: &'a [Radiance],
    exact: &'a Texels,
    /// Cut to the bands of the layout.
    light: [Coefficients; 3],
}

impl Basis<'_> {
    /// Radiance at the points from texels of the layout; `otherwise` where none is valid.
    fn radiance(&self, texels: &Texels, otherwise: &[[f64; 3]]) -> Vec<[f64; 3]> {
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
