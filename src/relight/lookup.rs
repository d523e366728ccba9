//! Trilinear lookup of contracted radiance, over the texels that have any.

use super::contract::{UNBAKED, has_radiance};
use super::{Contracted, Light, Material};
use crate::error::Result;
use crate::relight::check_count;
use crate::transfer::Lattice;
use rayon::prelude::*;

/// Linear radiance per vertex and how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct VertexRadiance {
    /// Linear radiance, one entry a position.
    pub radiance: Vec<[f32; 3]>,
    /// How many lookups had to fall back.
    pub report: LookupReport,
}

impl VertexRadiance {
    /// Adds the direct light of a sun that was split off the environment: ρ/π · flux · lit, where `lit` is
    /// the mean over the sun's disk of visibility times clamped cosine at each position, and `flux` the sun's
    /// radiance times solid angle.
    ///
    /// # Panics
    /// When there are not as many `lit` as positions.
    pub fn add_sun(&mut self, lit: &[f32], flux: [f64; 3], material: &Material) {
        assert_eq!(lit.len(), self.radiance.len());
        let factor = material.sun_factor(flux);
        for (radiance, lit) in self.radiance.iter_mut().zip(lit) {
            for c in 0..3 {
                radiance[c] += factor[c] * lit;
            }
        }
    }

    /// Adds radiance, one entry a position.
    ///
    /// # Errors
    /// When there are not as many entries as positions.
    pub fn add(&mut self, more: &[[f32; 3]]) -> Result<()> {
        check_count("radiance", more.len(), self.radiance.len())?;
        for (radiance, more) in self.radiance.iter_mut().zip(more) {
            (0..3).for_each(|c| radiance[c] += more[c]);
        }
        Ok(())
    }
}

/// How many lookups had all they needed, and what the others did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LookupReport {
    /// Lookups.
    pub lookups: u64,
    /// Some of the eight texels had no level set; their weights went to the others.
    pub renormalised: u64,
    /// None of the eight had one: mean of the valid texels of the surrounding 4³.
    pub neighbourhood: u64,
    /// None of these either: the unoccluded radiance of the vertex normal.
    pub unoccluded: u64,
    /// Lookups that met a texel that was never baked (counted in the above too).
    pub unbaked: u64,
}

impl std::ops::AddAssign for LookupReport {
    fn add_assign(&mut self, other: Self) {
        self.lookups += other.lookups;
        self.renormalised += other.renormalised;
        self.neighbourhood += other.neighbourhood;
        self.unoccluded += other.unoccluded;
        self.unbaked += other.unbaked;
    }
}

/// Vertices looked up by one task.
const TASK: usize = 4096;

/// Radiance at `count` positions by their numbers, on all threads; what each lookup reports is summed in their order.
pub(super) fn each_position(
    count: usize,
    radiance_at: impl Fn(usize, &mut LookupReport) -> [f32; 3] + Sync,
) -> VertexRadiance {
    let mut radiance = vec![[0.0; 3]; count];
    let reports: Vec<LookupReport> = radiance
        .par_chunks_mut(TASK)
        .enumerate()
        .with_max_len(1)
        .map(|(task, out)| {
            let mut report = LookupReport::default();
            for (i, out) in out.iter_mut().enumerate() {
                *out = radiance_at(task * TASK + i, &mut report);
            }
            report
        })
        .collect();
    let mut report = LookupReport::default();
    reports.into_iter().for_each(|r| report += r);
    VertexRadiance { radiance, report }
}

/// Eight texels and a position between them.
pub(super) struct Cell {
    base: [usize; 3],
    next: [usize; 3],
    at: [f32; 3],
}

impl Cell {
    /// The cell of texels around a grid position.
    pub(super) fn around(lattice: Lattice, position_in_grid: [f32; 3]) -> Self {
        let m = lattice.texels();
        let mut cell = Self { base: [0; 3], next: [0; 3], at: [0.0; 3] };
        for a in 0..3 {
            let p = (f64::from(position_in_grid[a]) / lattice.step(a)).clamp(0.0, (m[a] - 1) as f64);
            cell.base[a] = (p as usize).min(m[a].saturating_sub(2));
            cell.next[a] = (cell.base[a] + 1).min(m[a] - 1);
            cell.at[a] = (p - cell.base[a] as f64) as f32;
        }
        cell
    }

    /// The 4³ texels around it, x fastest; fewer at the edges of the lattice.
    pub(super) fn surroundings(&self, lattice: Lattice) -> impl Iterator<Item = [usize; 3]> {
        let m = lattice.texels();
        let [xs, ys, zs] = [0, 1, 2].map(|a| self.base[a].saturating_sub(1)..(self.base[a] + 3).min(m[a]));
        zs.flat_map(move |z| {
            let xs = xs.clone();
            ys.clone().flat_map(move |y| xs.clone().map(move |x| [x, y, z]))
        })
    }

    /// The texels with their trilinear weights; those of weight 0 are left out.
    pub(super) fn corners(&self) -> impl Iterator<Item = ([usize; 3], f32)> {
        (0..8).filter_map(|corner| {
            let pick = [corner & 1, corner >> 1 & 1, corner >> 2];
            let mut w = 1.0;
            for a in 0..3 {
                w *= if pick[a] == 1 { self.at[a] } else { 1.0 - self.at[a] };
            }
            let texel = std::array::from_fn(|a| if pick[a] == 1 { self.next[a] } else { self.base[a] });
            (w > 0.0).then_some((texel, w))
        })
    }
}

impl Contracted {
    /// Radiance at many positions. `normals_in_world` serve where no texel near a position is valid.
    ///
    /// # Panics
    /// When there are not as many normals as positions.
    pub fn look_up(
        &self,
        positions_in_grid: &[[f32; 3]],
        normals_in_world: &[[f32; 3]],
        light: &Light,
        material: &Material,
    ) -> VertexRadiance {
        assert_eq!(positions_in_grid.len(), normals_in_world.len());
        each_position(positions_in_grid.len(), |i, report| {
            self.radiance_at(positions_in_grid[i], normals_in_world[i], light, material, report)
        })
    }

    /// Radiance at one grid position.
    pub fn radiance_at(
        &self,
        position_in_grid: [f32; 3],
        normal_in_world: [f32; 3],
        light: &Light,
        material: &Material,
        report: &mut LookupReport,
    ) -> [f32; 3] {
        report.lookups += 1;
        let cell = Cell::around(self.lattice, position_in_grid);
        let mut sum = [0.0f32; 3];
        let (mut weights, mut missing, mut unbaked) = (0.0f32, false, false);
        for (texel, w) in cell.corners() {
            let [r, g, b, stderr] = self.texel(texel);
            if has_radiance(stderr) {
                sum[0] += w * r;
                sum[1] += w * g;
                sum[2] += w * b;
                weights += w;
            } else {
                missing = true;
                unbaked |= stderr == UNBAKED;
            }
        }
        report.unbaked += u64::from(unbaked);
        if weights > 0.0 {
            report.renormalised += u64::from(missing);
            return if missing { sum.map(|v| v / weights) } else { sum };
        }
        if let Some(mean) = self.neighbourhood_mean(&cell) {
            report.neighbourhood += 1;
            return mean;
        }
        report.unoccluded += 1;
        material.unoccluded(light, normal_in_world)
    }

    /// Standard errors of the mean of the channels at many positions.
    ///
    /// Texels are independent, so that of an interpolated radiance Σ w_i R_i is sqrt(Σ w_i² σ_i²): smaller than
    /// the texels' own. Where a lookup falls back, it is the root mean square over the contraction.
    pub fn look_up_errors(&self, positions_in_grid: &[[f32; 3]]) -> Vec<f32> {
        positions_in_grid.par_iter().with_min_len(TASK).with_max_len(2 * TASK).map(|&p| self.stderr_at(p)).collect()
    }

    fn stderr_at(&self, position_in_grid: [f32; 3]) -> f32 {
        let (mut variance, mut weights) = (0.0f32, 0.0f32);
        for (texel, w) in Cell::around(self.lattice, position_in_grid).corners() {
            let stderr = self.texel(texel)[3];
            if has_radiance(stderr) {
                let error = w * stderr;
                variance += error * error;
                weights += w;
            }
        }
        if weights > 0.0 { variance.sqrt() / weights } else { self.noise.rms as f32 }
    }

    /// Mean of the valid texels of the 4³ around a cell.
    fn neighbourhood_mean(&self, cell: &Cell) -> Option<[f32; 3]> {
        let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
        for texel in cell.surroundings(self.lattice) {
            let [r, g, b, stderr] = self.texel(texel);
            if has_radiance(stderr) {
                sum = [sum[0] + r, sum[1] + g, sum[2] + b];
                count += 1.0;
            }
        }
        (count > 0.0).then(|| sum.map(|v| v / count))
    }
}

/// How large the standard errors of a surface are, relative to its own radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceError {
    /// Half of the vertices are below.
    pub median: f64,
    /// 95 % of the vertices are below.
    pub percentile_95: f64,
}

impl SurfaceError {
    /// From radiance and its standard error (mean of the channels) at each vertex; black vertices without error
    /// count as 0, black ones with error as infinite.
    pub fn new(radiance: &[[f32; 3]], stderr: &[f32]) -> Self {
        let mut relative: Vec<f32> = radiance
            .iter()
            .zip(stderr)
            .map(|(c, &e)| {
                let mean = (c[0] + c[1] + c[2]) / 3.0;
                if e == 0.0 { 0.0 } else { (e / mean.abs()).min(f32::INFINITY) }
            })
            .collect();
        let mut quantile = |q: f64| {
            if relative.is_empty() {
                return 0.0;
            }
            let rank = ((relative.len() - 1) as f64 * q).round() as usize;
            f64::from(*relative.select_nth_unstable_by(rank, f32::total_cmp).1)
        };
        Self { median: quantile(0.5), percentile_95: quantile(0.95) }
    }
}
