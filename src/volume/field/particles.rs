//! Stand-ins for the two-field data of Beason (2005), which are not public: particles of two kinds in one box (for his nucleons),
//! and droplets thrown off a ball (for his spray). Each is a field of its own, so that two of them stand in one scene; values run
//! from 0 to about 255, as his do.

use super::Field;
use crate::geom::Bounds;
use crate::sampling::hash::uniform;
use glam::DVec3;

const UNIT_BOX: Bounds = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
/// Gaussians end here, in standard deviations: below 10⁻⁴ of their height.
const CUT: f64 = 4.3;

/// A sum of Gaussians.
#[derive(Clone, Debug)]
pub struct Blobs {
    name: &'static str,
    default_isovalue: f64,
    // Centre, standard deviation, height.
    blobs: Vec<(DVec3, f64, f64)>,
}

/// Particles of one kind.
const PARTICLES: u64 = 2000;
/// Droplets.
const DROPLETS: u64 = 600;

impl Blobs {
    /// 2000 particles of one of two kinds, 0 or 1, crowded towards the middle of the box, as one Gaussian each.
    pub fn nucleons(kind: u64) -> Self {
        let axis = |i: u64, a: u32| {
            // The mean of two uniform numbers: most in the middle.
            0.5 * [0, 1].map(|s| f64::from(uniform(0x6e75_636c + kind, i, s, a))).iter().sum::<f64>()
        };
        let blob = |i: u64| (DVec3::new(axis(i, 0), axis(i, 1), axis(i, 2)), 0.03, 55.0);
        let name = if kind == 0 { "nucleons" } else { "nucleons-2" };
        Self { name, default_isovalue: 79.0, blobs: (0..PARTICLES).map(blob).collect() }
    }

    /// Droplets that have left a ball in the middle of the box, smaller with the distance.
    pub fn droplets() -> Self {
        let blob = |i: u64| {
            let u = |s: u32| f64::from(uniform(0x7370_7261, i, s, 0));
            let height = 1.0 - 2.0 * u(0);
            let across = (1.0 - height * height).max(0.0).sqrt();
            let (sine, cosine) = libm::sincos(std::f64::consts::TAU * u(1));
            let far = 0.2 + 0.27 * u(2).sqrt();
            let size = 0.006 + 0.02 * (0.47 - far) / 0.27 * u(3);
            (DVec3::splat(0.5) + far * DVec3::new(across * cosine, across * sine, height), size, 250.0)
        };
        Self { name: "spray-2", default_isovalue: 116.0, blobs: (0..DROPLETS).map(blob).collect() }
    }
}

impl Field for Blobs {
    fn name(&self) -> &'static str {
        self.name
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        let mut sum = 0.0;
        for &(centre, size, height) in &self.blobs {
            let away = (point_in_world - centre).abs();
            if away.max_element() <= CUT * size {
                let [x, y, z] = away.to_array().map(|d| bell(d, size));
                sum += height * (x * y * z);
            }
        }
        sum
    }

    fn bounds(&self) -> Bounds {
        UNIT_BOX
    }

    fn default_isovalue(&self) -> f64 {
        self.default_isovalue
    }

    /// Blob by blob, in their order: the sums of [`Self::value`].
    fn fill(&self, coordinates: [&[f64]; 3], out: &mut Vec<f32>) {
        let dims = coordinates.map(<[f64]>::len);
        let mut sums = vec![0.0f64; dims.iter().product()];
        for &(centre, size, height) in &self.blobs {
            let along = |a: usize| -> Vec<(usize, f64)> {
                let each = coordinates[a].iter().map(|v| (v - centre[a]).abs()).enumerate();
                each.filter(|(_, d)| *d <= CUT * size).map(|(i, d)| (i, bell(d, size))).collect()
            };
            let [xs, ys, zs] = [along(0), along(1), along(2)];
            for &(k, z) in &zs {
                for &(j, y) in &ys {
                    let row = dims[0] * (j + dims[1] * k);
                    for &(i, x) in &xs {
                        sums[row + i] += height * (x * y * z);
                    }
                }
            }
        }
        out.extend(sums.iter().map(|&v| v as f32));
    }
}

fn bell(distance: f64, size: f64) -> f64 {
    libm::exp(-0.5 * (distance / size).powi(2))
}

/// A ball in the middle of the unit box: 255 in its middle, 116 at a radius of 0.1744, 0 at 0.32 and beyond.
#[derive(Clone, Copy, Debug, Default)]
pub struct Core;

impl Field for Core {
    fn name(&self) -> &'static str {
        "spray"
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        255.0 * (1.0 - (point_in_world - DVec3::splat(0.5)).length() / 0.32).max(0.0)
    }

    fn bounds(&self) -> Bounds {
        UNIT_BOX
    }

    fn default_isovalue(&self) -> f64 {
        116.0
    }
}
