//! Ray families that break tracers (number 28): axis-aligned, diagonal, nearly so, grazing, through edges
//! and corners, from faces, edges and corners, and bounces. A ray is a pure function of (family, seed, item).
#![allow(dead_code)] // Every program that uses it uses its own part.

use glam::Vec3;
use isolume::geom::Frame;
use isolume::level::{Counts, LevelField, Outcome, Start};
use isolume::sampling::hash::uniform;
use isolume::volume::Sample;

/// How a ray is aimed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Along an axis of the grid.
    Axis,
    /// Along a diagonal of a face or of a cell.
    Diagonal,
    /// An axis or diagonal but for the last bits, or for components too small to matter.
    Nearly,
    /// Tangent to the level set at the start.
    Grazing,
    /// At the middle of an edge of the grid.
    Edge,
    /// At a grid point.
    Corner,
    /// Any direction.
    Uniform,
    /// From a hit of another ray, around the normal there.
    Bounce,
}

impl Family {
    pub const ALL: [Self; 8] = [
        Self::Axis,
        Self::Diagonal,
        Self::Nearly,
        Self::Grazing,
        Self::Edge,
        Self::Corner,
        Self::Uniform,
        Self::Bounce,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Axis => "axis",
            Self::Diagonal => "diagonal",
            Self::Nearly => "nearly axis or diagonal",
            Self::Grazing => "grazing",
            Self::Edge => "through edges",
            Self::Corner => "through corners",
            Self::Uniform => "uniform",
            Self::Bounce => "bounce",
        }
    }
}

/// A ray in grid space.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub start: Start,
    /// Raw.
    pub isovalue: f32,
    pub direction: Vec3,
}

/// Numbers of one ray.
struct Numbers {
    seed: u64,
    item: u64,
}

impl Numbers {
    fn at(&self, dimension: u32) -> f64 {
        f64::from(uniform(self.seed, self.item, dimension, 0))
    }

    fn below(&self, dimension: u32, count: usize) -> usize {
        ((self.at(dimension) * count as f64) as usize).min(count - 1)
    }

    fn direction(&self) -> Vec3 {
        let z = 2.0 * self.at(30) - 1.0;
        let (sine, cosine) = (std::f64::consts::TAU * self.at(31)).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new((r * cosine) as f32, (r * sine) as f32, z as f32)
    }
}

/// The ray of a family; `None` where it cannot be made (no gradient, nothing hit).
pub fn ray<T: Sample>(field: &LevelField<'_, T>, samples: &[T], family: Family, seed: u64, item: u64) -> Option<Ray> {
    let n = Numbers { seed: seed << 4 | family as u64, item };
    let (start, isovalue) = start(field, samples, &n);
    let sign = |d: u32| if n.at(d) < 0.5 { -1.0f32 } else { 1.0 };
    let direction = match family {
        Family::Axis => {
            let mut d = Vec3::ZERO;
            d[n.below(32, 3)] = sign(33);
            d
        }
        Family::Diagonal => {
            let mut d = Vec3::new(sign(33), sign(34), sign(35));
            if n.at(32) < 0.5 {
                d[n.below(36, 3)] = 0.0;
            }
            d
        }
        Family::Nearly => {
            let tiny = [1e-3, 1e-7, 1e-20, 1e-30, 1e-39, 1e-44, f32::EPSILON][n.below(36, 7)];
            let mut d = Vec3::new(sign(33), sign(34), sign(35));
            let axis = n.below(32, 3);
            match n.below(37, 3) {
                0 => d[axis] = tiny,
                1 => (d[axis], d[(axis + 1) % 3]) = (tiny, -tiny),
                _ => d[axis] += tiny,
            }
            d
        }
        Family::Grazing => {
            let gradient = field.raw_gradient(&start.at);
            let largest = gradient.abs().max_element();
            if largest < f32::MIN_POSITIVE {
                return None;
            }
            let tangent = (gradient / largest).cross(n.direction());
            // Exactly tangent to rounding, or off by a few parts in a thousand to either side.
            tangent + (gradient / largest) * [0.0, 1e-3, -1e-3, 1e-5][n.below(32, 4)]
        }
        Family::Edge | Family::Corner => {
            let dims = field.dims();
            let mut target = Vec3::from_array(std::array::from_fn(|a| n.below(32 + a as u32, dims[a]) as f32));
            if family == Family::Edge {
                let axis = n.below(36, 3);
                target[axis] = (target[axis] + 0.5).min((dims[axis] - 1) as f32);
            }
            target - start.at.in_grid()
        }
        Family::Uniform => field.direction_in_grid(n.direction()),
        Family::Bounce => return bounce(field, Ray { start, isovalue, direction: n.direction() }, &n),
    };
    (direction.abs().max_element() > 0.0).then_some(Ray { start, isovalue, direction })
}

/// One to six bounces around the normals of the hits.
fn bounce<T: Sample>(field: &LevelField<'_, T>, mut ray: Ray, n: &Numbers) -> Option<Ray> {
    for k in 0..=n.below(40, 6) as u32 {
        let Outcome::Hit(hit) = field.trace(ray.isovalue, &ray.start, ray.direction, &mut Counts::default()) else {
            return None;
        };
        let (radius, angle) = (n.at(50 + 2 * k).sqrt(), std::f64::consts::TAU * n.at(51 + 2 * k));
        let local = [radius * angle.cos(), radius * angle.sin(), (1.0 - radius * radius).max(0.0).sqrt()];
        let around = Frame::around(field.normal(&hit.at)?);
        let direction = field.direction_in_grid(around.from_local(Vec3::from_array(local.map(|v| v as f32))));
        ray = Ray { start: Start::on(hit.at), direction, ..ray };
    }
    Some(ray)
}

/// A start and its isovalue: grid points, points on edges, faces and inside, each under any of its names; on
/// its own level set, or beside one that runs through a sample of the volume.
fn start<T: Sample>(field: &LevelField<'_, T>, samples: &[T], n: &Numbers) -> (Start, f32) {
    let dims = field.dims();
    let whole = n.below(0, 8);
    let at: [f64; 3] = std::array::from_fn(|a| {
        let p = n.at(1 + a as u32) * (dims[a] - 1) as f64;
        if whole >> a & 1 == 1 { p.round() } else { p }
    });
    let mut point = field.locate(at);
    for a in 0..3 {
        // The same point, seen from the cell before.
        if point.local[a] == 0.0 && point.cell[a] > 0 && n.at(5 + a as u32) < 0.5 {
            point.local[a] = 1.0;
            point.cell[a] -= 1;
        }
    }
    match n.below(9, 8) {
        0 => (Start::beside(point), samples[n.below(10, samples.len())].raw()),
        1 => {
            // A texel, with the rule for its isovalue.
            let site = field.site(at.map(f64::round));
            site.map_or((Start::on(point), field.raw_value(&point)), |s| (s.start, s.isovalue))
        }
        _ => (Start::on(point), field.raw_value(&point)),
    }
}
