//! The level set along a ray by definition, in f64, and the judge of what a tracer says of it. Works from
//! the public interface and shares no arithmetic with the tracer.
//!
//! In each cell that the ray crosses, the trilinear function is a cubic in the way gone. It is taken
//! from its values at thirds (eight weights each), looked at in its ends and extremes, between which it is
//! monotone, and followed with the start rule applied literally.
//!
//! # Budget
//! A hit must lie within [`BUDGET`] of the first rise of f and of the ray, unless f *grazes*: stays within the
//! slack of f32 from there to the hit. The slack is 16 roundings of the numbers in the cell plus the slope
//! times the rounding of the position, and 64 steps of the subnormal numbers.
#![allow(dead_code)] // Every program that uses it uses its own part.

use glam::{DVec3, Vec3};
use isolume::level::trace::MAX_BURIED_CELLS;
use isolume::level::{Outcome, Start};
use isolume::volume::Volume;

/// Position budget in voxels.
pub const BUDGET: f64 = 1e-3;

/// A field in f64.
pub struct Oracle {
    samples: Vec<f64>,
    dims: [usize; 3],
    sign: f64,
}

/// A point of a ray: way gone in voxels, f, the rounding allowed there in units of f, and cells left before it:
/// all, and without those that are no longer than rounding, which a tracer may or may not see.
#[derive(Clone, Copy, Debug)]
struct Look {
    t: f64,
    f: f64,
    slack: f64,
    exits: [u32; 2],
}

/// The part of a ray in one cell: a cubic over [from, to] through its values at thirds.
struct Piece {
    from: f64,
    to: f64,
    thirds: [f64; 4],
    slack: f64,
}

/// What f does along one ray.
pub struct Profile {
    looks: Vec<Look>,
    pieces: Vec<Piece>,
    pub origin: DVec3,
    pub direction: DVec3,
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

    /// Where the derivative may vanish inside, ascending.
    fn extremes(&self) -> [Option<f64>; 2] {
        let [a, b, c, d] = self.thirds;
        let third = (d - 3.0 * c + 3.0 * b - a) / 2.0;
        let second = 2.0 * a - 5.0 * b + 4.0 * c - d;
        let first = (-11.0 * a + 18.0 * b - 9.0 * c + 2.0 * d) / 6.0;
        let root = second * second - 4.0 * third * first;
        if root < 0.0 {
            return [None; 2];
        }
        let q = -0.5 * (second + second.signum() * root.sqrt());
        let at = |u: f64| (u > 0.0 && u < 3.0).then(|| self.from + u / 3.0 * (self.to - self.from));
        match (at(q / third), at(first / q)) {
            (Some(x), Some(y)) => [Some(x.min(y)), Some(x.max(y))],
            (x, y) => [x.or(y), None],
        }
    }
}

/// A direction as the tracer takes it: components below 2⁻¹⁰⁰ of the largest count as 0; unit length.
pub fn as_traced(direction: Vec3) -> DVec3 {
    let d = direction.as_dvec3() / f64::from(direction.abs().max_element());
    DVec3::from_array(d.to_array().map(|v| if v.abs() < 2f64.powi(-101) { 0.0 } else { v })).normalize()
}

impl Oracle {
    pub fn new(volume: &Volume) -> Self {
        let samples = (0..volume.samples().len()).map(|i| f64::from(volume.samples().raw(i))).collect();
        Self { samples, dims: volume.dims(), sign: f64::from(volume.solid_sign()) }
    }

    fn corners(&self, cell: [usize; 3]) -> [f64; 8] {
        std::array::from_fn(|k| {
            let at = [cell[0] + (k & 1), cell[1] + (k >> 1 & 1), cell[2] + (k >> 2)];
            self.samples[at[0] + self.dims[0] * (at[1] + self.dims[1] * at[2])]
        })
    }

    /// f along a ray, to the border or to the end of the cell in which `until` voxels are gone.
    pub fn profile(&self, c: f32, start: &Start, direction: Vec3, until: f64) -> Profile {
        let origin = start.at.cell.as_dvec3() + start.at.local.as_dvec3();
        let direction = as_traced(direction);
        let mut end = f64::INFINITY;
        for a in 0..3 {
            if direction[a] != 0.0 {
                let border = if direction[a] > 0.0 { (self.dims[a] - 1) as f64 } else { 0.0 };
                end = end.min((border - origin[a]) / direction[a]);
            }
        }
        let mut crossings = vec![0.0];
        for a in (0..3).filter(|&a| direction[a] != 0.0) {
            let planes = (0..self.dims[a]).map(|k| (k as f64 - origin[a]) / direction[a]);
            crossings.extend(planes.filter(|t| (0.0..=end).contains(t)));
        }
        crossings.sort_unstable_by(f64::total_cmp);
        let mut profile = Profile { looks: Vec::new(), pieces: Vec::new(), origin, direction };
        let mut exits = [0, 0];
        for pair in crossings.windows(2) {
            if pair[1] > pair[0] {
                let first = profile.pieces.is_empty();
                self.add_piece(c, start.on_surface && first, pair[0], pair[1], exits, &mut profile);
            }
            exits[0] += 1;
            exits[1] += u32::from(pair[1] - pair[0] > 2f64.powi(-21) * (1.0 + pair[1]));
            if pair[1] > until {
                break;
            }
        }
        profile
    }

    fn add_piece(&self, c: f32, on_surface: bool, from: f64, to: f64, exits: [u32; 2], out: &mut Profile) {
        let at = |t: f64| out.origin + out.direction * t;
        let middle = at(0.5 * (from + to));
        let cell: [usize; 3] = std::array::from_fn(|a| (middle[a].max(0.0) as usize).min(self.dims[a] - 2));
        let base = DVec3::from_array(cell.map(|v| v as f64));
        let corners = self.corners(cell);
        let c = f64::from(c);
        let f = |t: f64| {
            let u = at(t) - base;
            let along_x = [0, 2, 4, 6].map(|k| corners[k] * (1.0 - u.x) + corners[k + 1] * u.x - c);
            let low = along_x[0] * (1.0 - u.y) + along_x[1] * u.y;
            let high = along_x[2] * (1.0 - u.y) + along_x[3] * u.y;
            self.sign * (low * (1.0 - u.z) + high * u.z)
        };
        let mut thirds = [0.0, 1.0, 2.0, 3.0].map(|i| f(from + (to - from) * i / 3.0));
        if on_surface {
            // f(start) = 0 by definition: what is there is taken out.
            let b0 = thirds[0];
            thirds = [0, 1, 2, 3].map(|i| thirds[i] - b0 * (1.0 - i as f64 / 3.0).powi(3));
            thirds[0] = 0.0;
        }
        let (low, high) = corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
        let scale = low.abs().max(high.abs()) + c.abs();
        let slack = 16.0 * 2f64.powi(-24) * scale + 3.0 * (high - low) * (to + 1.0) * 2f64.powi(-22) + 2f64.powi(-143);
        let piece = Piece { from, to, thirds, slack };
        let inner = piece.extremes().into_iter().flatten();
        for t in [from].into_iter().chain(inner).chain([to]) {
            out.looks.push(Look { t, f: piece.value(t), slack, exits });
        }
        out.pieces.push(piece);
    }
}

/// f in units of the slack.
fn ratio(f: f64, slack: f64) -> f64 {
    if f == 0.0 { 0.0 } else { f / slack }
}

impl Profile {
    /// Whether the ray leaves its start on the lit side, by more than rounding, before anything else.
    pub fn leaves_lit(&self) -> bool {
        let told = self.looks.iter().find(|l| l.t > 0.0 && l.f.abs() > 1e-6 * l.slack);
        told.is_some_and(|l| l.f < 0.0) && self.looks.iter().find(|l| l.f.abs() > l.slack).is_some_and(|l| l.f < 0.0)
    }

    fn at(&self, t: f64) -> (f64, f64) {
        let i = self.pieces.partition_point(|p| p.to < t).min(self.pieces.len() - 1);
        let piece = &self.pieces[i];
        (piece.value(t.clamp(piece.from, piece.to)), piece.slack)
    }

    fn end(&self) -> f64 {
        self.pieces.last().map_or(0.0, |p| p.to)
    }

    /// Ratios of f to its slack over [from, to]: at the ends and at all looks between.
    fn ratios(&self, from: f64, to: f64) -> impl Iterator<Item = f64> + '_ {
        let ends = [from, to].into_iter().filter(move |_| to >= from).map(|t| self.at(t));
        let first = self.looks.partition_point(|l| l.t < from);
        let inner = self.looks[first..].iter().take_while(move |l| l.t <= to).map(|l| (l.f, l.slack));
        ends.chain(inner).map(|(f, slack)| ratio(f, slack))
    }

    fn highest(&self, from: f64, to: f64) -> f64 {
        self.ratios(from, to).fold(f64::NEG_INFINITY, f64::max)
    }

    fn lowest(&self, from: f64, to: f64) -> f64 {
        self.ratios(from, to).fold(f64::INFINITY, f64::min)
    }

    /// The first parameter > `from` at which f changes to > 0 (`rise`) or to ≤ 0, from a state of the other kind.
    fn change(&self, from: f64, rise: bool) -> Option<f64> {
        let after = self.looks.iter().position(|l| l.t > from && (l.f > 1e-6 * l.slack) == rise)?;
        let before = if after > 0 { self.looks[after - 1].t } else { 0.0 };
        let (mut low, mut high) = (from.max(before), self.looks[after].t);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if (self.at(middle).0 > 0.0) == rise { high = middle } else { low = middle }
        }
        Some(high)
    }
}

/// What a tracer says became of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Said {
    Escaped,
    Lost,
    /// A hit after so many voxels, and how far beside the ray.
    Hit(f64, f64),
    NotANumber,
}

impl Said {
    /// From an outcome of the library's tracer.
    pub fn of(outcome: Outcome, profile_origin: DVec3, direction: DVec3) -> Self {
        match outcome {
            Outcome::Escaped => Self::Escaped,
            Outcome::Lost => Self::Lost,
            Outcome::Hit(hit) => {
                let way = hit.at.cell.as_dvec3() + hit.at.local.as_dvec3() - profile_origin;
                let t = way.dot(direction);
                if way.is_finite() { Self::Hit(t, (way - direction * t).length()) } else { Self::NotANumber }
            }
        }
    }
}

/// What is wrong with an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It escaped, but the surface was there.
    Leak,
    /// It hit, but went through the surface before.
    Late,
    /// A hit where it starts.
    SelfHit,
    /// A hit where there is no surface, away from the start.
    Ghost,
    /// A hit beside the ray.
    Beside,
    NotANumber,
    /// Given up although it was out.
    LostOutside,
    /// Out of the solid after more cells than a ray may be inside.
    TooDeep,
}

/// The verdict on an answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// Right, to this many voxels.
    Exact(f64),
    /// Right or wrong by less than f32 can tell.
    Grazing,
    /// As `Grazing`, and a hit where the ray starts: it is tangent there to within rounding.
    GrazingStart,
    Wrong(Fault),
}

/// Hits before this many voxels count as self-hits.
const NEAR_START: f64 = 0.1;

/// Judges an answer by a position budget of [`BUDGET`] voxels.
pub fn judge(profile: &Profile, on_surface: bool, said: Said) -> Verdict {
    judge_within(BUDGET, profile, on_surface, said)
}

/// Judges an answer by a position budget in voxels.
pub fn judge_within(budget: f64, profile: &Profile, on_surface: bool, said: Said) -> Verdict {
    use Verdict::{Exact, Wrong};
    let Some(first) = profile.looks.iter().find(|l| l.t > 0.0) else {
        // On the border and outward: no way to go, but a start beside the surface may be solid.
        let legal = said == Said::Escaped || (said == Said::Lost && !on_surface);
        return if legal { Exact(0.0) } else { Wrong(Fault::SelfHit) };
    };
    let told = profile.looks.iter().find(|l| l.f.abs() > 1e-6 * l.slack).unwrap_or(first);
    let certain = profile.looks.iter().find(|l| l.f.abs() > l.slack);
    let verdict = judge_from(told, budget, profile, on_surface, said);
    match (verdict, certain) {
        // It starts so flat that f32 cannot tell on which side: the other is right as well.
        (Wrong(_), Some(certain)) if (told.f > 0.0) != (certain.f > 0.0) => {
            judge_from(certain, budget, profile, on_surface, said)
        }
        _ => verdict,
    }
}

/// Judges an answer, the side of the start being that of `told`.
fn judge_from(told: &Look, budget: f64, profile: &Profile, on_surface: bool, said: Said) -> Verdict {
    use Verdict::{Exact, Grazing, GrazingStart, Wrong};
    let inside = told.f > 0.0;
    let t = match said {
        Said::NotANumber => return Wrong(Fault::NotANumber),
        Said::Lost => return judge_lost(profile),
        Said::Escaped => profile.end() + budget,
        Said::Hit(_, beside) if beside > budget => return Wrong(Fault::Beside),
        Said::Hit(t, _) if profile.highest(t - budget, t + budget) < -1.0 => {
            return Wrong(if t < NEAR_START { Fault::SelfHit } else { Fault::Ghost });
        }
        Said::Hit(t, _) => t,
    };
    // Up to here f must not have risen, once the ray was free.
    let before = t - budget;
    let mut free = 0.0;
    if inside && profile.highest(0.0, before) > 1.0 {
        free = profile.change(told.t, false).unwrap_or(profile.end());
        // A gap that f32 may not have seen: the next one.
        while let Some(rise) = profile.change(free, true)
            && rise < before
            && profile.lowest(free, rise) >= -1.0
            && let Some(next) = profile.change(rise, false)
        {
            free = next;
        }
        if t < free && profile.lowest(before, t + budget) <= 1.0 {
            // A touch: in f32 the ray was out for a moment there.
            free = t;
        }
        let allowed = profile.looks.iter().rfind(|l| l.exits[1] <= MAX_BURIED_CELLS).map_or(0.0, |l| l.t);
        if free > allowed && profile.lowest(told.t, allowed) > 1.0 {
            return Wrong(Fault::TooDeep);
        }
    }
    if before > free && profile.highest(free, before) > 1.0 {
        return Wrong(if said == Said::Escaped { Fault::Leak } else { Fault::Late });
    }
    let error = match (said, profile.change(free, true)) {
        (Said::Hit(..), Some(rise)) => (t - rise).abs(),
        (Said::Escaped, None) => 0.0,
        _ => f64::INFINITY,
    };
    match error <= budget {
        true => Exact(error),
        false if t < budget && on_surface => {
            // f32 decides cell by cell: whether the ray leaves its surface by more than rounding, within the
            // budget, before the end of the cell in which it hits.
            let cell_end = profile.pieces.iter().find(|p| p.to >= t).map_or(t, |p| p.to);
            let leaves = profile.lowest(0.0, (t + budget).min(cell_end)) < -1.0;
            if leaves { Wrong(Fault::SelfHit) } else { GrazingStart }
        }
        false => Grazing,
    }
}

/// In the solid for more cells than a ray may be, or to the border.
fn judge_lost(profile: &Profile) -> Verdict {
    let looks = || profile.looks.iter().take_while(|l| l.exits[0] <= MAX_BURIED_CELLS);
    let until = looks().last().map_or(0.0, |l| l.t);
    match profile.lowest(0.0, until) {
        depth if depth >= 0.0 => Verdict::Exact(0.0),
        depth if depth >= -1.0 => Verdict::Grazing,
        _ => Verdict::Wrong(Fault::LostOutside),
    }
}
