//! The bump box: four bumps over a curved floor.

use super::Field;
use crate::geom::{Bounds, Up};
use glam::DVec3;

/// Least of F over the box, at its corners (0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1).
#[doc(hidden)]
pub const BUMP_MINIMUM: f64 = 0.33781847;
/// Greatest of F over the box, at (0.5, 0.901684949848…, 0.5): Newton's method with 50 digits,
/// rounded to f64. A test climbs to it again.
#[doc(hidden)]
pub const BUMP_MAXIMUM: f64 = 1.2092084165075023;

/// Weights, widths and centres of the five terms.
const WEIGHT: [f64; 5] = [0.0125, 0.02, 0.033, 0.167, 1.667];
const WIDTH: [f64; 5] = [0.036, 0.036, 0.036, 0.09, 1.35];
const CENTRE: [[f64; 3]; 5] =
    [[0.75, 0.60, 0.5], [0.60, 0.51, 0.5], [0.40, 0.50, 0.5], [0.50, 0.90, 0.5], [0.50, 1.50, 0.5]];

/// The exponent is −‖x − p‖²/(this·σ²) = −(‖x − p‖/2σ)². It is 4, not the 2 of a normal
/// distribution: only 4 gives the stated extremes 0.33781847 and 1.209 (2 gives 0.23166204
/// and 1.18666893), and so values of 0…255. A change needs new extremes, see the tests.
const SPREAD: f64 = 4.0;

/// F(x) = Σ a_i/(σ_i √(2π)) exp(−‖x − p_i‖²/(4σ_i²)) on \[0, 1\]³ (after Beason 2005), mapped to
/// 255·(F − [`BUMP_MINIMUM`])/([`BUMP_MAXIMUM`] − [`BUMP_MINIMUM`]): constants, so that an
/// isovalue means the same surface on every grid. The solid floor lies at y = 1: up is −y.
#[derive(Clone, Copy, Debug, Default)]
pub struct BumpBox;

/// The factor of term `i` along one axis. Both ways of evaluation go through this function and
/// [`combine`], in the same order, so that their bits agree.
fn factor(i: usize, axis: usize, coordinate: f64) -> f64 {
    let distance = coordinate - CENTRE[i][axis];
    libm::exp(-distance * distance / (SPREAD * WIDTH[i] * WIDTH[i]))
}

fn amplitude(i: usize) -> f64 {
    WEIGHT[i] / (WIDTH[i] * (2.0 * std::f64::consts::PI).sqrt())
}

fn to_value(sum: f64) -> f64 {
    255.0 * (sum - BUMP_MINIMUM) / (BUMP_MAXIMUM - BUMP_MINIMUM)
}

/// Σ (yz_i · x_i) in the order of i, where yz_i = (amplitude_i · z_i) · y_i.
fn combine(yz: &[f64; 5], x: &[f64; 5]) -> f64 {
    let mut sum = 0.0;
    for i in 0..5 {
        sum += yz[i] * x[i];
    }
    sum
}

impl BumpBox {
    /// F before it is mapped to 0…255.
    pub fn unmapped(&self, p: DVec3) -> f64 {
        let terms = [0, 1, 2, 3, 4];
        let yz = terms.map(|i| amplitude(i) * factor(i, 2, p.z) * factor(i, 1, p.y));
        combine(&yz, &terms.map(|i| factor(i, 0, p.x)))
    }
}

impl Field for BumpBox {
    fn name(&self) -> &'static str {
        "bumpbox"
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        to_value(self.unmapped(point_in_world))
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::ZERO, max: DVec3::ONE }
    }

    fn up(&self) -> Up {
        Up::NegY
    }

    fn default_isovalue(&self) -> f64 {
        30.0
    }

    fn fill(&self, coordinates: [&[f64]; 3], out: &mut Vec<f32>) {
        let terms = [0, 1, 2, 3, 4];
        let table = |axis: usize| -> Vec<[f64; 5]> {
            coordinates[axis].iter().map(|&c| terms.map(|i| factor(i, axis, c))).collect()
        };
        let (along_x, along_y, along_z) = (table(0), table(1), table(2));
        for z in &along_z {
            for y in &along_y {
                let yz = terms.map(|i| amplitude(i) * z[i] * y[i]);
                out.extend(along_x.iter().map(|x| to_value(combine(&yz, x)) as f32));
            }
        }
    }
}
