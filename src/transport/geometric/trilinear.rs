//! A level set of the trilinear field, in double precision, without the tracer of [`crate::level`].
//!
//! In each cell the field is a polynomial of eight terms, along a ray a cubic. Its coefficients are formed in the power
//! basis about the place where the ray enters the cell: in f64 the cancellation that costs an f32 tracer its root there
//! leaves ten digits.

use crate::volume::Volume;
use glam::{DVec3, IVec3};

/// A place in a cell, and the field there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct InCell {
    /// Index of the lowest corner.
    pub(super) cell: IVec3,
    /// In [0, 1]³.
    pub(super) local: DVec3,
}

impl InCell {
    pub(super) fn in_grid(&self) -> DVec3 {
        self.cell.as_dvec3() + self.local
    }
}

/// f = s·(raw − c) in a cell, positive in the solid: k0 + k·p + mixed·(yz, zx, xy) + all·xyz.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellField {
    constant: f64,
    linear: DVec3,
    mixed: DVec3,
    all: f64,
}

/// Σ c_i s^i.
type Cubic = [f64; 4];

fn value(c: &Cubic, s: f64) -> f64 {
    c[0] + s * (c[1] + s * (c[2] + s * c[3]))
}

impl CellField {
    /// From the values at the corners, x fastest.
    fn new(v: [f64; 8]) -> Self {
        let linear = DVec3::new(v[1] - v[0], v[2] - v[0], v[4] - v[0]);
        let mixed = DVec3::new(v[6] - v[2] - v[4] + v[0], v[5] - v[1] - v[4] + v[0], v[3] - v[1] - v[2] + v[0]);
        let all = v[7] - v[6] - v[5] - v[3] + v[1] + v[2] + v[4] - v[0];
        Self { constant: v[0], linear, mixed, all }
    }

    fn value(&self, p: DVec3) -> f64 {
        let pairs = DVec3::new(p.y * p.z, p.z * p.x, p.x * p.y);
        self.constant + self.linear.dot(p) + self.mixed.dot(pairs) + self.all * p.x * p.y * p.z
    }

    /// The gradient in grid space.
    pub(super) fn gradient(&self, p: DVec3) -> DVec3 {
        let m = self.mixed;
        self.linear
            + DVec3::new(m.z * p.y + m.y * p.z, m.z * p.x + m.x * p.z, m.y * p.x + m.x * p.y)
            + self.all * DVec3::new(p.y * p.z, p.z * p.x, p.x * p.y)
    }

    /// f(p + s·d) as a cubic in s.
    fn along(&self, p: DVec3, d: DVec3) -> Cubic {
        let second = DVec3::new(d.y * d.z, d.z * d.x, d.x * d.y).dot(self.mixed + self.all * p);
        [self.value(p), self.gradient(p).dot(d), second, self.all * d.x * d.y * d.z]
    }

    /// The place nearest to a point of the cell along a direction, both ways, where f is 0.
    pub(super) fn zero_near(&self, p: DVec3, direction: DVec3) -> Option<DVec3> {
        let forward = self.zero_along(p, direction);
        let back = self.zero_along(p, -direction);
        [forward, back].into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
    }

    fn zero_along(&self, p: DVec3, d: DVec3) -> Option<(f64, DVec3)> {
        let room = |a: usize| match d[a] {
            0.0 => f64::INFINITY,
            v if v > 0.0 => (1.0 - p[a]) / v,
            v => -p[a] / v,
        };
        let end = room(0).min(room(1)).min(room(2)).max(0.0);
        let cubic = self.along(p, d);
        let s = if cubic[0] > 0.0 { first_rise(&cubic.map(|c| -c), 0.0, end) } else { first_rise(&cubic, 0.0, end) }?;
        Some((s, (p + s * d).clamp(DVec3::ZERO, DVec3::ONE)))
    }
}

/// Where a cubic that is not above 0 at `from` comes above 0 for the first time up to `to`.
fn first_rise(c: &Cubic, from: f64, to: f64) -> Option<f64> {
    let [one, other] = quadratic_roots(c[1], 2.0 * c[2], 3.0 * c[3]);
    let mut low = from;
    // Between the stationary points it is monotone.
    for end in [one, other, to] {
        if !(end > low && end <= to) {
            continue;
        }
        if value(c, end) > 0.0 {
            let mut high = end;
            // Halved until nothing of f64 is left between.
            loop {
                let middle = 0.5 * (low + high);
                if middle <= low || middle >= high {
                    return Some(high);
                }
                if value(c, middle) > 0.0 { high = middle } else { low = middle }
            }
        }
        low = end;
    }
    None
}

/// Roots of a + b s + c s² in rising order; NaN where there are none.
fn quadratic_roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let discriminant = b * b - 4.0 * a * c;
    if discriminant < 0.0 {
        return [f64::NAN; 2];
    }
    // The pair without cancellation.
    let q = -0.5 * (b + discriminant.sqrt().copysign(b));
    let (r, s) = (if c != 0.0 { q / c } else { f64::NAN }, if q != 0.0 { a / q } else { f64::NAN });
    if s < r || r.is_nan() { [s, r] } else { [r, s] }
}

/// What becomes of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fate {
    Escaped,
    Hit(InCell),
    /// It does not leave its start towards the lit side.
    Lost,
}

/// The level set.
pub(super) struct TrilinearSurface<'a> {
    volume: &'a Volume,
    isovalue: f64,
    // Cells along each axis.
    cells: IVec3,
    // By cell, x fastest: distance to the nearest one with a corner in the solid, in cells, largest component.
    distances: Vec<u8>,
}

impl<'a> TrilinearSurface<'a> {
    /// The level set of an isovalue in raw samples of a volume that has cells.
    pub(super) fn new(volume: &'a Volume, isovalue: f64) -> Self {
        let cells = IVec3::from_array(volume.dims().map(|d| d as i32 - 1));
        let mut surface = Self { volume, isovalue, cells, distances: Vec::new() };
        surface.distances = surface.distances_to_solid();
        surface
    }

    fn sample(&self, [x, y, z]: [usize; 3]) -> f64 {
        let raw = f64::from(self.volume.samples().raw(self.volume.index(x, y, z)));
        f64::from(self.volume.solid_sign()) * (raw - self.isovalue)
    }

    pub(super) fn field(&self, cell: IVec3) -> CellField {
        let [x, y, z] = cell.to_array().map(|c| c as usize);
        CellField::new(std::array::from_fn(|i| self.sample([x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)])))
    }

    /// The cell that holds a place of the grid.
    pub(super) fn cell_at(&self, in_grid: DVec3) -> IVec3 {
        in_grid.floor().as_ivec3().clamp(IVec3::ZERO, self.cells - 1)
    }

    /// f at a place: 0 on the level set, up to rounding.
    #[cfg(test)]
    pub(super) fn value(&self, at: &InCell) -> f64 {
        self.field(at.cell).value(at.local)
    }

    fn index(&self, cell: IVec3) -> usize {
        let [nx, ny] = [self.cells.x as usize, self.cells.y as usize];
        cell.x as usize + nx * (cell.y as usize + ny * cell.z as usize)
    }

    /// By two sweeps, forward and back, over the 13 neighbours that were there before (Rosenfeld and Pfaltz 1966; for the
    /// largest component it is exact).
    fn distances_to_solid(&self) -> Vec<u8> {
        let (nx, ny, nz) = (self.cells.x, self.cells.y, self.cells.z);
        let mut distances = vec![u8::MAX; nx as usize * ny as usize * nz as usize];
        let [sx, sy, sz] = self.volume.dims();
        for z in 0..sz {
            for y in 0..sy {
                for x in (0..sx).filter(|&x| self.sample([x, y, z]) > 0.0) {
                    for i in 0..8 {
                        let cell = IVec3::new(x as i32 - (i & 1), y as i32 - (i >> 1 & 1), z as i32 - (i >> 2));
                        if cell.cmpge(IVec3::ZERO).all() && cell.cmplt(self.cells).all() {
                            distances[self.index(cell)] = 0;
                        }
                    }
                }
            }
        }
        let before: Vec<IVec3> = (0..13).map(|i| IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)).collect();
        for way in [1, -1] {
            for place in 0..distances.len() {
                let place = if way == 1 { place } else { distances.len() - 1 - place };
                let (p, row) = (place as i64, i64::from(nx));
                let cell =
                    IVec3::new((p % row) as i32, (p / row % i64::from(ny)) as i32, (p / row / i64::from(ny)) as i32);
                for offset in &before {
                    let other = cell + way * *offset;
                    if other.cmpge(IVec3::ZERO).all() && other.cmplt(self.cells).all() {
                        distances[place] = distances[place].min(distances[self.index(other)].saturating_add(1));
                    }
                }
            }
        }
        distances
    }

    /// Follows a ray from a place on the level set along a direction in grid space.
    pub(super) fn trace(&self, start: &InCell, d: DVec3) -> Fate {
        let field = self.field(start.cell);
        // f is 0 at the start: its root is divided out, and a quadratic is left.
        let [_, a, b, c] = field.along(start.local, d);
        if a >= 0.0 {
            return Fate::Lost;
        }
        let (mut cell, origin) = (start.cell, start.local);
        let mut entered = 0.0f64;
        let mut reach = 1;
        loop {
            // The cells of this box but the first hold nothing solid.
            let planes = |axis: usize| -> f64 {
                let plane = match d[axis] {
                    0.0 => return f64::INFINITY,
                    v if v > 0.0 => cell[axis] + reach,
                    _ => cell[axis] - (reach - 1),
                };
                (f64::from(plane - start.cell[axis]) - origin[axis]) / d[axis]
            };
            let far = [planes(0), planes(1), planes(2)];
            let axis = (0..3).fold(0, |best, a| if far[a] < far[best] { a } else { best });
            let left = far[axis].max(entered);
            if cell == start.cell && entered == 0.0 {
                let roots = quadratic_roots(a, b, c);
                if let Some(&s) = roots.iter().find(|s| **s > 0.0 && **s <= left) {
                    return Fate::Hit(self.place(start, d, s, cell));
                }
            } else if self.distances[self.index(cell)] == 0 {
                let offset = (start.cell - cell).as_dvec3();
                let entry = (origin + entered * d + offset).clamp(DVec3::ZERO, DVec3::ONE);
                let cubic = self.field(cell).along(entry, d);
                let rise = if cubic[0] > 0.0 { Some(0.0) } else { first_rise(&cubic, 0.0, left - entered) };
                if let Some(s) = rise {
                    return Fate::Hit(self.place(start, d, entered + s, cell));
                }
            }
            let mut next = cell;
            for a in 0..3 {
                if a == axis {
                    next[a] += if d[a] > 0.0 { reach } else { -reach };
                } else if reach > 1 {
                    let at = (origin[a] + left * d[a]).floor() as i32 + start.cell[a];
                    next[a] = at.clamp(cell[a] - (reach - 1), cell[a] + (reach - 1));
                }
            }
            if next.cmplt(IVec3::ZERO).any() || next.cmpge(self.cells).any() {
                return Fate::Escaped;
            }
            (cell, entered) = (next, left);
            reach = i32::from(self.distances[self.index(cell)]).max(1);
        }
    }

    fn place(&self, start: &InCell, d: DVec3, t: f64, cell: IVec3) -> InCell {
        let local = start.local + t * d + (start.cell - cell).as_dvec3();
        InCell { cell, local: local.clamp(DVec3::ZERO, DVec3::ONE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_rise_is_the_first_root_upwards() {
        // (s − 0.2)(s − 0.5)(s − 0.7): up, down, up.
        let cubic = [-0.07, 0.59, -1.4, 1.0];
        let cases = [(0.0, 1.0, Some(0.2)), (0.0, 0.1, None), (0.5, 1.0, Some(0.7)), (0.5, 0.6, None)];
        for (from, to, expected) in cases {
            let found = first_rise(&cubic, from, to);
            match (found, expected) {
                (Some(found), Some(expected)) => assert!(f64::abs(found - expected) < 1e-14, "{found} {expected}"),
                other => assert_eq!(other.0, other.1),
            }
        }
        // A double root from below is no rise, a triple one is; a line is a cubic.
        assert_eq!(first_rise(&[-0.25, 1.0, -1.0, 0.0], 0.0, 0.4), None);
        assert!((first_rise(&[-0.125, 0.75, -1.5, 1.0], 0.0, 1.0).unwrap() - 0.5).abs() < 1e-5);
        assert_eq!(first_rise(&[-1.0, 4.0, 0.0, 0.0], 0.0, 1.0).map(|s| (s - 0.25).abs() < 1e-15), Some(true));
    }

    #[test]
    fn a_cubic_along_a_ray_is_the_field_along_it() {
        let field = CellField::new([0.3, -0.7, 0.9, 0.1, -0.4, 0.8, -0.2, 0.5]);
        let (p, d) = (DVec3::new(0.1, 0.7, 0.4), DVec3::new(0.5, -0.6, 0.3));
        let cubic = field.along(p, d);
        for i in 0..9 {
            let s = 0.125 * f64::from(i);
            assert!((value(&cubic, s) - field.value(p + s * d)).abs() < 1e-15);
        }
        for (i, corner) in [0.3, -0.7, 0.9, 0.1, -0.4, 0.8, -0.2, 0.5].into_iter().enumerate() {
            let at = DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
            assert!((field.value(at) - corner).abs() < 1e-15);
        }
    }
}
