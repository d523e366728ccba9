//! The level set along a ray by definition, in f64: the trilinear field looked at in at least 64
//! points of every cell the ray crosses and at the extremes of the cubic, the start rule applied
//! literally, crossings by bisection. Shares no arithmetic with the tracer.

use super::*;

/// Looks per cell.
const DENSE: usize = 64;

/// What f64 can tell from 0, in slacks of f32.
const TOLD: f64 = 1e-6;

/// A field in f64.
pub(super) struct Twin {
    samples: Vec<f64>,
    dims: [usize; 3],
    sign: f64,
}

/// A point of a ray that was looked at: parameter in voxels, f, and the rounding the tracer is
/// allowed there, in units of f.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    pub t: f64,
    pub f: f64,
    pub slack: f64,
    /// Cells left before this point.
    pub exits: u32,
}

impl Look {
    /// Whether f64 can tell f from 0 here.
    pub(super) fn tells(&self) -> bool {
        self.f.abs() > TOLD * self.slack
    }
}

/// What f does along one ray up to the border of the box.
pub(super) struct Profile {
    pub looks: Vec<Look>,
    pieces: Vec<Piece>,
    pub origin: DVec3,
    pub direction: DVec3,
}

/// The part of a ray in one cell: a cubic over [from, to] through its values at thirds.
struct Piece {
    from: f64,
    to: f64,
    thirds: [f64; 4],
    slack: f64,
}

impl Piece {
    /// Lagrange's interpolation, which the cubic equals.
    fn value(&self, t: f64) -> f64 {
        let u = 3.0 * (t - self.from) / (self.to - self.from);
        let [a, b, c, d] = self.thirds;
        (a * -(u - 1.0) * (u - 2.0) * (u - 3.0) + 3.0 * b * u * (u - 2.0) * (u - 3.0)
            - 3.0 * c * u * (u - 1.0) * (u - 3.0)
            + d * u * (u - 1.0) * (u - 2.0))
            / 6.0
    }

    /// Where the derivative may vanish inside.
    fn extremes(&self) -> Vec<f64> {
        let [a, b, c, d] = self.thirds;
        // Derivative in u: A u² + B u + C.
        let third = (d - 3.0 * c + 3.0 * b - a) / 2.0;
        let second = 2.0 * a - 5.0 * b + 4.0 * c - d;
        let first = (-11.0 * a + 18.0 * b - 9.0 * c + 2.0 * d) / 6.0;
        let root = second * second - 4.0 * third * first;
        if root < 0.0 {
            return vec![];
        }
        let q = -0.5 * (second + second.signum() * root.sqrt());
        let mut out: Vec<f64> =
            [q / third, first / q].into_iter().filter(|u| u.is_finite() && *u > 0.0 && *u < 3.0).collect();
        out.sort_by(f64::total_cmp);
        out.into_iter().map(|u| self.from + u / 3.0 * (self.to - self.from)).collect()
    }
}

impl Twin {
    pub(super) fn new(volume: &Volume) -> Self {
        let samples = (0..volume.samples().len()).map(|i| f64::from(volume.samples().raw(i))).collect();
        Self { samples, dims: volume.dims(), sign: f64::from(volume.solid_sign()) }
    }

    fn sample(&self, cell: [usize; 3], corner: usize) -> f64 {
        let at = [cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2)];
        self.samples[at[0] + self.dims[0] * (at[1] + self.dims[1] * at[2])]
    }

    /// The trilinear field in `cell`, which may be extrapolated.
    fn value_in(&self, cell: [usize; 3], p: DVec3) -> f64 {
        let u = p - DVec3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64);
        (0..8)
            .map(|k| {
                let w = |bit: usize, x: f64| if k >> bit & 1 == 1 { x } else { 1.0 - x };
                w(0, u.x) * w(1, u.y) * w(2, u.z) * self.sample(cell, k)
            })
            .sum()
    }

    /// The raw trilinear field at a grid position.
    pub(super) fn value(&self, p: DVec3) -> f64 {
        self.value_in(std::array::from_fn(|a| (p[a].max(0.0) as usize).min(self.dims[a] - 2)), p)
    }

    /// f along a ray.
    pub(super) fn profile(&self, c: f32, start: &Start, direction: Vec3) -> Profile {
        let origin = start.at.cell.as_dvec3() + start.at.local.as_dvec3();
        let direction = as_traced(direction).as_dvec3().normalize();
        let (mut crossings, mut end) = (vec![0.0], f64::INFINITY);
        for a in 0..3 {
            let last = (self.dims[a] - 1) as f64;
            if direction[a] != 0.0 {
                end = end.min(((if direction[a] > 0.0 { last } else { 0.0 }) - origin[a]) / direction[a]);
                crossings.extend((0..self.dims[a]).map(|k| (k as f64 - origin[a]) / direction[a]));
            }
        }
        crossings.retain(|&t| (0.0..=end).contains(&t));
        crossings.push(end.max(0.0));
        crossings.sort_by(f64::total_cmp);
        crossings.dedup();
        let mut profile = Profile { looks: vec![], pieces: vec![], origin, direction };
        for (exits, pair) in crossings.windows(2).enumerate() {
            self.look(&mut profile, f64::from(c), start.on_surface, exits as u32, pair[0], pair[1]);
        }
        profile
    }

    fn look(&self, out: &mut Profile, c: f64, on_surface: bool, exits: u32, from: f64, to: f64) {
        let middle = out.origin + out.direction * (0.5 * (from + to));
        let cell: [usize; 3] = std::array::from_fn(|a| (middle[a].max(0.0) as usize).min(self.dims[a] - 2));
        let f = |t: f64| self.sign * (self.value_in(cell, out.origin + out.direction * t) - c);
        let at = |i: usize| from + (to - from) * i as f64 / 3.0;
        let mut thirds = [0, 1, 2, 3].map(|i| f(at(i)));
        if out.pieces.is_empty() && on_surface {
            // f is 0 at the start by definition: the Bernstein term of the start is taken out.
            let b0 = thirds[0];
            thirds = [0, 1, 2, 3].map(|i| thirds[i] - b0 * (1.0 - i as f64 / 3.0).powi(3));
            thirds[0] = 0.0;
        }
        // What f32 may do: 16 roundings of the numbers that go in, and positions that are off
        // by 2⁻²² of the way gone.
        let corners = (0..8).map(|k| self.sample(cell, k));
        let (low, high) = corners.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let scale = low.abs().max(high.abs()) + c.abs();
        let slack = 16.0 * 2f64.powi(-24) * scale + 3.0 * (high - low) * (to + 1.0) * 2f64.powi(-22);
        let piece = Piece { from, to, thirds, slack };
        let all_lit = self.sign * (if self.sign > 0.0 { high } else { low } - c) <= 0.0;
        let mut times: Vec<f64> = if all_lit && !out.pieces.is_empty() {
            vec![from, to]
        } else {
            (0..=DENSE).map(|i| from + (to - from) * i as f64 / DENSE as f64).chain(piece.extremes()).collect()
        };
        times.sort_by(f64::total_cmp);
        out.looks.extend(times.into_iter().map(|t| Look { t, f: piece.value(t), slack, exits }));
        out.pieces.push(piece);
    }
}

impl Profile {
    /// f and its slack at a parameter, in the first piece that holds it.
    pub(super) fn at(&self, t: f64) -> (f64, f64) {
        let piece = self.pieces.iter().find(|p| t <= p.to).or(self.pieces.last()).unwrap();
        (piece.value(t.clamp(piece.from, piece.to)), piece.slack)
    }

    /// Parameter of the border.
    pub(super) fn end(&self) -> f64 {
        self.pieces.last().map_or(0.0, |p| p.to)
    }

    /// Largest f/slack over [from, to].
    pub(super) fn highest(&self, from: f64, to: f64) -> f64 {
        let ends = [from, to].into_iter().filter(|_| to >= from).map(|t| self.at(t));
        let inner = self.looks.iter().filter(|l| (from..=to).contains(&l.t)).map(|l| (l.f, l.slack));
        ends.chain(inner).fold(f64::NEG_INFINITY, |m, (f, slack)| m.max(ratio(f, slack)))
    }

    /// Smallest f/slack over [from, to].
    pub(super) fn lowest(&self, from: f64, to: f64) -> f64 {
        let ends = [from, to].into_iter().filter(|_| to >= from).map(|t| self.at(t));
        let inner = self.looks.iter().filter(|l| (from..=to).contains(&l.t)).map(|l| (l.f, l.slack));
        ends.chain(inner).fold(f64::INFINITY, |m, (f, slack)| m.min(ratio(f, slack)))
    }

    /// The first parameter ≥ `from` at which f changes to > 0 (`rise`) or to ≤ 0, as far as f64 can tell, from a
    /// state of the other kind at `from`; refined by bisection.
    pub(super) fn change(&self, from: f64, rise: bool) -> Option<f64> {
        self.change_through(from, rise, TOLD)
    }

    /// As [`Self::change`] to > 0, but at 0 itself, which lies well before what can be told where f grazes.
    pub(super) fn rise_through_zero(&self, from: f64) -> Option<f64> {
        self.change_through(from, true, 0.0)
    }

    fn change_through(&self, from: f64, rise: bool, slacks: f64) -> Option<f64> {
        let after = self.looks.iter().position(|l| l.t >= from && (l.f > TOLD * l.slack) == rise)?;
        let (mut low, mut high) =
            (from.max(if after > 0 { self.looks[after - 1].t } else { 0.0 }), self.looks[after].t);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            let (f, slack) = self.at(middle);
            if (f > slacks * slack) == rise { high = middle } else { low = middle }
        }
        Some(high)
    }
}

/// f in units of the slack; a flat field of zeros has no slack and no f.
fn ratio(f: f64, slack: f64) -> f64 {
    if f == 0.0 { 0.0 } else { f / slack }
}

#[test]
fn the_cubic_of_a_piece_is_the_trilinear_field() {
    for (name, volume) in gallery() {
        let twin = Twin::new(&volume);
        let range = volume.raw_range().1 - volume.raw_range().0;
        with_field!(volume, field => {
            for item in 0..300 {
                let (start, c) = any_start(&field, 90, item);
                let profile = twin.profile(c, &Start::beside(start.at), on_sphere(90, item));
                for look in &profile.looks {
                    let by_field = twin.sign * (twin.value(profile.origin + profile.direction * look.t) - f64::from(c));
                    let error = (look.f - by_field).abs() / f64::from(range);
                    assert!(error < 1e-9, "{name} {item}: {error} at {look:?}");
                }
            }
        });
    }
}
