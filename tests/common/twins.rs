//! Tracers as they are usually written, for comparison: cell by cell with accumulated parameters (Amanatides
//! & Woo 1987), a cubic in powers of the parameter solved in closed form (Parker et al. 1998, Schwarze 1990
//! "Cubic and quartic roots", Graphics Gems), and an ε against hits at the start. Written from the
//! definitions, in f32 but for the roots that are meant to be exact.
#![allow(dead_code)] // Every program that uses it uses its own part.

use super::rays::Ray;
use glam::Vec3;
use isolume::volume::Volume;

/// The cubic and its roots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solver {
    /// Coefficients about the origin of the ray, f32.
    AboutOrigin,
    /// Coefficients about the entry into the cell, f32.
    AboutEntry,
    /// About the entry, f64 throughout: what is left is the fault of the ε alone.
    Double,
}

/// What keeps a ray from its own start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Guard {
    /// The origin is moved this part of the longest side along the normal.
    Offset(f32),
    /// Hits nearer than this part of the longest side do not count.
    Least(f32),
}

/// A tracer of the usual kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twin {
    pub name: &'static str,
    pub solver: Solver,
    pub guard: Guard,
}

/// Position budget that twins are judged by, in voxels: a hundred times ours, since an offset ray is another ray.
pub const TWIN_BUDGET: f64 = 0.1;

/// The twins of the stability table.
pub const TWINS: [Twin; 11] = [
    Twin { name: "offset 1e-3, cubic about entry", solver: Solver::AboutEntry, guard: Guard::Offset(1e-3) },
    Twin { name: "offset 1e-4, cubic about entry", solver: Solver::AboutEntry, guard: Guard::Offset(1e-4) },
    Twin { name: "t_min 1e-3, cubic about entry", solver: Solver::AboutEntry, guard: Guard::Least(1e-3) },
    Twin { name: "t_min 1e-4, cubic about entry", solver: Solver::AboutEntry, guard: Guard::Least(1e-4) },
    Twin { name: "offset 1e-3, cubic about origin", solver: Solver::AboutOrigin, guard: Guard::Offset(1e-3) },
    Twin { name: "offset 1e-4, cubic about origin", solver: Solver::AboutOrigin, guard: Guard::Offset(1e-4) },
    Twin { name: "t_min 1e-3, cubic about origin", solver: Solver::AboutOrigin, guard: Guard::Least(1e-3) },
    Twin { name: "t_min 1e-4, cubic about origin", solver: Solver::AboutOrigin, guard: Guard::Least(1e-4) },
    Twin { name: "offset 1e-3, double precision", solver: Solver::Double, guard: Guard::Offset(1e-3) },
    Twin { name: "t_min 1e-3, double precision", solver: Solver::Double, guard: Guard::Least(1e-3) },
    Twin { name: "t_min 1e-4, double precision", solver: Solver::Double, guard: Guard::Least(1e-4) },
];

/// What a twin needs of a volume.
pub struct TwinField {
    samples: Vec<f32>,
    dims: [usize; 3],
    longest: f32,
}

/// What a twin says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TwinSaid {
    Escaped,
    /// A hit at this point of the grid.
    Hit(Vec3),
    NotANumber,
}

impl TwinField {
    pub fn new(volume: &Volume) -> Self {
        let samples = (0..volume.samples().len()).map(|i| volume.samples().raw(i)).collect();
        let longest = volume.dims().into_iter().max().unwrap_or(2) as f32 - 1.0;
        Self { samples, dims: volume.dims(), longest }
    }

    fn corner(&self, cell: [i32; 3], k: usize) -> f32 {
        let at = [0, 1, 2].map(|a| cell[a] as usize + (k >> a & 1));
        self.samples[at[0] + self.dims[0] * (at[1] + self.dims[1] * at[2])]
    }

    /// Follows a ray; `normal_in_grid` points to the lit side, in grid space.
    pub fn trace(&self, twin: &Twin, ray: &Ray, normal_in_grid: Vec3) -> TwinSaid {
        let direction = ray.direction / ray.direction.abs().max_element();
        let direction = direction / direction.length();
        let mut origin = ray.start.at.in_grid();
        let mut least = 0.0;
        match twin.guard {
            Guard::Offset(part) => origin += normal_in_grid * (part * self.longest),
            Guard::Least(part) => least = part * self.longest,
        }
        let last = self.dims.map(|n| n as i32 - 2);
        let inside = |p: Vec3| (0..3).all(|a| p[a] >= 0.0 && p[a] <= (last[a] + 1) as f32);
        if !inside(origin) {
            return TwinSaid::Escaped;
        }
        let mut cell = [0, 1, 2].map(|a| (origin[a] as i32).clamp(0, last[a]));
        let step = [0, 1, 2].map(|a| if direction[a] < 0.0 { -1 } else { 1 });
        let delta = [0, 1, 2].map(|a| (1.0 / direction[a]).abs());
        let mut next: [f32; 3] = std::array::from_fn(|a| match direction[a] {
            0.0 => f32::INFINITY,
            d => ((cell[a] + i32::from(d > 0.0)) as f32 - origin[a]) / d,
        });
        let mut from = 0.0f32;
        loop {
            let axis = (0..3).fold(0, |best, a| if next[a] < next[best] { a } else { best });
            let to = next[axis];
            match self.root(twin.solver, cell, ray.isovalue, origin, direction, from, to, least) {
                Some(t) if t.is_finite() => return TwinSaid::Hit(origin + direction * t),
                Some(_) => return TwinSaid::NotANumber,
                None => {}
            }
            cell[axis] += step[axis];
            if cell[axis] < 0 || cell[axis] > last[axis] {
                return TwinSaid::Escaped;
            }
            from = to;
            next[axis] += delta[axis];
        }
    }

    /// The first root in [from, to] beyond `least`; a root that is not a number passes as such.
    fn root(
        &self,
        solver: Solver,
        cell: [i32; 3],
        isovalue: f32,
        origin: Vec3,
        direction: Vec3,
        from: f32,
        to: f32,
        least: f32,
    ) -> Option<f32> {
        let base = Vec3::from_array(cell.map(|c| c as f32));
        match solver {
            Solver::Double => {
                let entry = (origin + direction * from - base).as_dvec3().to_array();
                let corners = std::array::from_fn(|k| f64::from(self.corner(cell, k)));
                let cubic = coefficients(&corners, f64::from(isovalue), entry, direction.as_dvec3().to_array());
                let roots = roots_f64(cubic);
                let length = f64::from(to - from);
                let fits = |t: &&f64| (0.0..=length).contains(*t) && from + **t as f32 > least;
                roots.iter().flatten().filter(fits).copied().reduce(f64::min).map(|t| from + t as f32)
            }
            _ => {
                let rebase = if solver == Solver::AboutEntry { from } else { 0.0 };
                let entry = (origin + direction * rebase - base).to_array();
                let corners = std::array::from_fn(|k| self.corner(cell, k));
                let cubic = coefficients_f32(&corners, isovalue, entry, direction.to_array());
                let roots = roots_f32(cubic);
                if roots.iter().flatten().any(|t| t.is_nan()) {
                    return Some(f32::NAN);
                }
                let fits = |t: &&f32| (from - rebase..=to - rebase).contains(*t) && rebase + **t > least;
                roots.iter().flatten().filter(fits).copied().reduce(f32::min).map(|t| rebase + t)
            }
        }
    }
}

/// Both precisions from one definition.
macro_rules! in_precision {
    ($t:ident, $coefficients:ident, $roots:ident) => {
        /// ρ(a + b t) − c in powers of t, highest first (Parker et al. 1998, section 3).
        fn $coefficients(corners: &[$t; 8], c: $t, a: [$t; 3], b: [$t; 3]) -> [$t; 4] {
            let mut sum = [0.0, 0.0, 0.0, -c];
            for k in 0..8 {
                // Weight of a corner along an axis: u_a + u_b t.
                let along =
                    |axis: usize| if k >> axis & 1 == 1 { (a[axis], b[axis]) } else { (1.0 - a[axis], -b[axis]) };
                let ((xa, xb), (ya, yb), (za, zb)) = (along(0), along(1), along(2));
                let v = corners[k];
                sum[0] += xb * yb * zb * v;
                sum[1] += (xa * yb * zb + xb * ya * zb + xb * yb * za) * v;
                sum[2] += (xb * ya * za + xa * yb * za + xa * ya * zb) * v;
                sum[3] += xa * ya * za * v;
            }
            sum
        }

        /// Real roots of a t³ + b t² + c t + d by Cardano's formulas, as in Schwarze 1990; leading terms below
        /// 1e-6 of the largest count as 0.
        fn $roots([a, b, c, d]: [$t; 4]) -> [Option<$t>; 3] {
            let tiny = 1e-6 * a.abs().max(b.abs()).max(c.abs()).max(d.abs());
            if a.abs() <= tiny {
                if b.abs() <= tiny {
                    return [(c != 0.0).then(|| -d / c), None, None];
                }
                let (p, q) = (c / (2.0 * b), d / b);
                let discriminant = p * p - q;
                if discriminant < 0.0 {
                    return [None; 3];
                }
                return [Some(-p - discriminant.sqrt()), Some(-p + discriminant.sqrt()), None];
            }
            let (b, c, d) = (b / a, c / a, d / a);
            let square = b * b;
            let p = (-square / 3.0 + c) / 3.0;
            let q = (2.0 / 27.0 * b * square - b * c / 3.0 + d) / 2.0;
            let cube = p * p * p;
            let discriminant = q * q + cube;
            let third = b / 3.0;
            if discriminant == 0.0 {
                let u = (-q).cbrt();
                return [Some(2.0 * u - third), Some(-u - third), None];
            }
            if discriminant < 0.0 {
                let phi = (-q / (-cube).sqrt()).acos() / 3.0;
                let t = 2.0 * (-p).sqrt();
                let turn = std::$t::consts::PI / 3.0;
                return [phi.cos() * t, -(phi + turn).cos() * t, -(phi - turn).cos() * t].map(|r| Some(r - third));
            }
            let root = discriminant.sqrt();
            [Some((root - q).cbrt() - (root + q).cbrt() - third), None, None]
        }
    };
}
in_precision!(f32, coefficients_f32, roots_f32);
in_precision!(f64, coefficients, roots_f64);
