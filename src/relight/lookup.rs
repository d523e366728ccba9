//! Trilinear lookup of contracted radiance, over the texels that have any.

use super::{Contracted, Light, Material};
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
        let mut radiance = vec![[0.0; 3]; positions_in_grid.len()];
        let reports: Vec<LookupReport> = radiance
            .par_chunks_mut(TASK)
            .zip(positions_in_grid.par_chunks(TASK).zip(normals_in_world.par_chunks(TASK)))
            .map(|(out, (positions, normals))| {
                let mut report = LookupReport::default();
                for i in 0..out.len() {
                    out[i] = self.radiance_at(positions[i], normals[i], light, material, &mut report);
                }
                report
            })
            .collect();
        let mut report = LookupReport::default();
        reports.into_iter().for_each(|r| report += r);
        VertexRadiance { radiance, report }
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
        let m = self.lattice.texels();
        let mut base = [0usize; 3];
        let mut t = [0.0f32; 3];
        for a in 0..3 {
            let p = (f64::from(position_in_grid[a]) / self.lattice.step(a)).clamp(0.0, (m[a] - 1) as f64);
            base[a] = (p as usize).min(m[a].saturating_sub(2));
            t[a] = (p - base[a] as f64) as f32;
        }
        let mut sum = [0.0f32; 3];
        let (mut weights, mut missing, mut unbaked) = (0.0f32, false, false);
        for corner in 0..8 {
            let pick = [corner & 1, corner >> 1 & 1, corner >> 2];
            let mut w = 1.0;
            for a in 0..3 {
                w *= if pick[a] == 1 { t[a] } else { 1.0 - t[a] };
            }
            if w <= 0.0 {
                continue;
            }
            let [r, g, b, valid] = self.texel(std::array::from_fn(|a| (base[a] + pick[a]).min(m[a] - 1)));
            if valid > 0.0 {
                sum[0] += w * r;
                sum[1] += w * g;
                sum[2] += w * b;
                weights += w;
            } else {
                missing = true;
                unbaked |= valid < 0.0;
            }
        }
        report.unbaked += u64::from(unbaked);
        if weights > 0.0 {
            report.renormalised += u64::from(missing);
            return if missing { sum.map(|v| v / weights) } else { sum };
        }
        if let Some(mean) = self.neighbourhood_mean(base) {
            report.neighbourhood += 1;
            return mean;
        }
        report.unoccluded += 1;
        let open = light.unoccluded(normal_in_world);
        std::array::from_fn(|c| material.albedo[c] * open[c] + material.emission[c])
    }

    /// Mean of the valid texels of the 4³ around the cell at `base`.
    fn neighbourhood_mean(&self, base: [usize; 3]) -> Option<[f32; 3]> {
        let m = self.lattice.texels();
        let span = |a: usize| base[a].saturating_sub(1)..(base[a] + 3).min(m[a]);
        let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
        for z in span(2) {
            for y in span(1) {
                for x in span(0) {
                    let [r, g, b, valid] = self.texel([x, y, z]);
                    if valid > 0.0 {
                        sum = [sum[0] + r, sum[1] + g, sum[2] + b];
                        count += 1.0;
                    }
                }
            }
        }
        (count > 0.0).then(|| sum.map(|v| v / count))
    }
}
