//! Flights through media.
//!
//! On a segment within a cell the field is a cubic, and extinction, which is straight in the field between the rows of its
//! table, is one too: its optical depth is exact, and where a flight ends is the root of a quartic. Nothing is stepped. Rows
//! inside the range of a segment split it. In one channel a flight takes one variate; the depths of the others say how likely
//! it would have been in them.

use super::level_set::{Placement, Standing};
use super::world::SceneCounts;
use crate::geom::Bounds;
use crate::level::{LevelField, Pyramid};
use crate::scene::Table;
use crate::scene::geometry::Geometry;
use crate::scene::medium::{Medium, MediumField, MediumRegion, Phase};
use crate::volume::{Sample, Volume, with_samples};
use glam::DVec3;

/// Accuracy of a flight's end within a stretch of a cell: 2⁻²² of it.
const TOLERANCE: f64 = 1.0 / (1 << 22) as f64;
/// Steps to it, each at least a bisection.
const MOST_STEPS: usize = 48;

/// All media of a scene.
pub(in super::super) struct Media<'a> {
    each: Vec<InWorld<'a>>,
    grey: bool,
}

/// A medium where it lies.
struct InWorld<'a> {
    medium: &'a Medium,
    glow: Option<usize>,
    region: Region,
    field: Option<Field<'a>>,
    constant: [f64; 3],
    albedo: Curve,
}

enum Region {
    Grid(Box<Placement>),
    Within(Bounds),
    Ball(DVec3, f64),
}

/// The field of a table, the table over its raw samples, and the blocks where extinction is 0.
struct Field<'a> {
    walk: Box<dyn Walk + 'a>,
    extinction: Curve,
    is_empty: Vec<bool>,
}

/// Straight pieces over raw samples: α + β·raw between knots, constant beyond.
struct Curve {
    knots: Vec<f64>,
    pieces: Vec<[[f64; 2]; 3]>,
}

/// A part of a ray on which extinction is a cubic.
struct Stretch {
    from: f64,
    length: f64,
    /// Bernstein coefficients of the raw samples, and of the extinction in each channel.
    raw: [f64; 4],
    extinction: [[f64; 4]; 3],
}

/// Where a flight met a medium.
#[derive(Clone, Copy, Debug)]
pub(super) struct Collision {
    pub(super) distance: f64,
    pub(super) medium: usize,
    /// σ_t there, of that medium.
    pub(super) extinction: [f64; 3],
    pub(super) albedo: [f64; 3],
}

/// Where a flight within one medium met it: how far, and the extinction and the raw sample there.
type End = (f64, [f64; 3], f64);

/// A flight: to its collision or its end.
pub(super) struct Flown {
    /// Of all media; 0 where all are grey, which nobody asks for.
    pub(super) depth: [f64; 3],
    pub(super) collision: Option<Collision>,
}

impl<'a> Media<'a> {
    pub(super) fn new(media: &'a [Medium], volume: &'a Volume, pyramid: &'a Pyramid, geometry: &'a Geometry) -> Self {
        let each: Vec<InWorld<'a>> =
            media.iter().map(|medium| InWorld::new(medium, volume, pyramid, geometry)).collect();
        let grey = each.iter().all(|m| m.medium.is_grey());
        Self { each, grey }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.each.is_empty()
    }

    /// Whether one flight serves all channels.
    pub(super) fn is_grey(&self) -> bool {
        self.grey
    }

    pub(super) fn phase(&self, medium: usize) -> &Phase {
        &self.each[medium].medium.phase
    }

    /// The luminaire that carries what a medium sends out, and its radiance.
    pub(super) fn glow(&self, medium: usize) -> Option<(usize, [f64; 3])> {
        let InWorld { glow, medium, .. } = &self.each[medium];
        glow.map(|l| (l, medium.emission))
    }

    /// e^(−τ) along a ray up to a distance; 1 where there is no medium.
    pub(super) fn transmittance(
        &self,
        origin: DVec3,
        direction: DVec3,
        distance: f64,
        counts: &mut SceneCounts,
    ) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for medium in &self.each {
            let depth = medium.depth(origin, direction, distance, counts);
            (0..3).for_each(|c| sum[c] += depth[c]);
        }
        sum.map(|depth| libm::exp(-depth))
    }

    /// A flight in one channel up to a distance, with one variate in [0, 1) a medium: the nearest of the collisions counts.
    pub(super) fn fly(
        &self,
        origin: DVec3,
        direction: DVec3,
        distance: f64,
        channel: usize,
        variate: &dyn Fn(usize) -> f64,
        counts: &mut SceneCounts,
    ) -> Flown {
        let (mut limit, mut collision) = (distance, None);
        let mut depths = [[0.0; 3]; crate::scene::medium::MOST_MEDIA];
        let mut last = 0;
        for (m, medium) in self.each.iter().enumerate() {
            let target = -libm::log1p(-variate(m));
            let (depth, found) = medium.fly(origin, direction, limit, channel, target, counts);
            depths[m] = depth;
            if let Some((at, extinction, raw)) = found {
                let albedo = medium.albedo.at(raw);
                (limit, last) = (at, m);
                collision = Some(Collision { distance: at, medium: m, extinction, albedo });
            }
        }
        let mut depth = [0.0; 3];
        if !self.grey {
            for (m, medium) in self.each.iter().enumerate() {
                // Those before the last collision went further than that.
                if collision.is_some() && m < last {
                    depths[m] = medium.depth(origin, direction, limit, counts);
                }
                (0..3).for_each(|c| depth[c] += depths[m][c]);
            }
        }
        counts.collisions += u64::from(collision.is_some());
        Flown { depth, collision }
    }
}

impl<'a> InWorld<'a> {
    fn new(medium: &'a Medium, volume: &'a Volume, pyramid: &'a Pyramid, geometry: &Geometry) -> Self {
        let (volume, pyramid) = match &medium.field {
            MediumField::Lit => (volume, pyramid),
            MediumField::Other { volume, pyramid } => (&**volume, &**pyramid),
        };
        let region = match medium.region {
            MediumRegion::Box => Region::Grid(Box::new(Placement::new(volume))),
            MediumRegion::Within(bounds) => Region::Within(bounds),
            MediumRegion::Ball { centre, radius } => Region::Ball(centre, radius),
        };
        let field = (!medium.is_constant()).then(|| {
            let extinction = Curve::new(&medium.extinction, volume);
            let sign = f64::from(volume.solid_sign());
            let range = |(low, high): (f32, f32)| {
                let ends = [sign * f64::from(low), sign * f64::from(high)];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            };
            let is_empty = pyramid.block_ranges().map(|r| extinction.largest_within(range(r)) <= 0.0).collect();
            let walk: Box<dyn Walk + 'a> = with_samples!(volume.samples(), s => {
                Box::new(Standing { field: LevelField::new(volume, s, pyramid), placement: Placement::new(volume) })
            });
            Field { walk, extinction, is_empty }
        });
        Self {
            medium,
            glow: geometry.luminaire_of_medium(&medium.name).filter(|_| medium.emission != [0.0; 3]),
            region,
            field,
            constant: medium.extinction.at(0.0).map(f64::from),
            albedo: Curve::new(&medium.albedo, volume),
        }
    }

    /// The part of a ray within the region, up to a distance.
    fn part(&self, origin: DVec3, direction: DVec3, distance: f64, counts: &mut SceneCounts) -> Option<(f64, f64)> {
        let (enter, leave) = self.region.span(origin, direction)?;
        let (from, to) = (enter.max(0.0), leave.min(distance));
        let is_any = to > from && to.is_finite();
        counts.medium_rays += u64::from(is_any);
        is_any.then_some((from, to))
    }

    /// Hands over the stretches of a ray within a field, until it is told `false`.
    fn each_stretch(
        &self,
        field: &Field<'_>,
        (origin, direction): (DVec3, DVec3),
        (from, to): (f64, f64),
        counts: &mut SceneCounts,
        visit: &mut dyn FnMut(&Stretch) -> bool,
    ) {
        let is_empty = |block: usize| field.is_empty[block];
        field.walk.walk(origin, direction, [from, to], &is_empty, &mut |cubic, start, end| {
            counts.medium_cells += 1;
            field.extinction.each_stretch(cubic, start, end - start, visit)
        });
    }

    fn depth(&self, origin: DVec3, direction: DVec3, distance: f64, counts: &mut SceneCounts) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let Some(part) = self.part(origin, direction, distance, counts) else { return sum };
        let Some(field) = &self.field else { return self.constant.map(|v| v * (part.1 - part.0)) };
        self.each_stretch(field, (origin, direction), part, counts, &mut |stretch| {
            (0..3).for_each(|c| sum[c] += stretch.depth(c));
            true
        });
        sum
    }

    /// Depths up to the end of a flight of depth `target` in one channel or to the distance; where it met the medium, with the
    /// extinction and the raw sample there.
    fn fly(
        &self,
        origin: DVec3,
        direction: DVec3,
        distance: f64,
        channel: usize,
        target: f64,
        counts: &mut SceneCounts,
    ) -> ([f64; 3], Option<End>) {
        let (mut sum, mut rest, mut found) = ([0.0; 3], target, None);
        let Some(part) = self.part(origin, direction, distance, counts) else { return (sum, found) };
        let Some(field) = &self.field else {
            let length = target / self.constant[channel];
            if length < part.1 - part.0 {
                found = Some((part.0 + length, self.constant, 0.0));
            }
            let length = length.min(part.1 - part.0);
            return (self.constant.map(|v| v * length), found);
        };
        self.each_stretch(field, (origin, direction), part, counts, &mut |stretch| {
            let own = stretch.depth(channel);
            if own <= rest {
                rest -= own;
                (0..3).for_each(|c| sum[c] += stretch.depth(c));
                return true;
            }
            let t = stretch.end_of_flight(channel, rest);
            (0..3).for_each(|c| sum[c] += stretch.length * quartic(&stretch.extinction[c], t));
            let at = |b: &[f64; 4]| value(b, t);
            found = Some((stretch.from + t * stretch.length, stretch.extinction.each_ref().map(at), at(&stretch.raw)));
            false
        });
        (sum, found)
    }
}

impl Region {
    /// Distances at which a ray enters and leaves.
    fn span(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        match self {
            Self::Grid(placement) => placement.span(origin, direction),
            Self::Within(bounds) => {
                let (a, b) = ((bounds.min - origin) / direction, (bounds.max - origin) / direction);
                // A direction along a face: NaN where the origin lies on it, which counts as outside.
                let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
                (enter < leave).then_some((enter, leave))
            }
            Self::Ball(centre, radius) => {
                let to_centre = *centre - origin;
                let middle = to_centre.dot(direction);
                let across = to_centre - middle * direction;
                let square = radius * radius - across.length_squared();
                (square > 0.0).then(|| (middle - square.sqrt(), middle + square.sqrt()))
            }
        }
    }
}

impl Stretch {
    /// Optical depth of the whole.
    fn depth(&self, channel: usize) -> f64 {
        let b = &self.extinction[channel];
        self.length * 0.25 * (b[0] + b[1] + b[2] + b[3])
    }

    /// The parameter in [0, 1] up to which the depth is `rest`, below that of the whole: Newton's method within a bracket, for
    /// the quartic rises.
    fn end_of_flight(&self, channel: usize, rest: f64) -> f64 {
        let b = &self.extinction[channel];
        let (mut low, mut high) = (0.0, 1.0);
        let mut t = (rest / self.depth(channel)).clamp(0.0, 1.0);
        for _ in 0..MOST_STEPS {
            let excess = self.length * quartic(b, t) - rest;
            if excess > 0.0 {
                high = t
            } else {
                low = t
            }
            let next = t - excess / (self.length * value(b, t));
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            let step = (next - t).abs();
            t = next;
            if step <= TOLERANCE || high - low <= TOLERANCE {
                break;
            }
        }
        t
    }
}

/// A cubic at t, by de Casteljau.
fn value(b: &[f64; 4], t: f64) -> f64 {
    part(b, t, 1.0)[0]
}

/// ∫₀ᵗ of a cubic: the quartic with the coefficients 0, B₀/4, (B₀+B₁)/4, ….
fn quartic(b: &[f64; 4], t: f64) -> f64 {
    let [a, b, c, d] = *b;
    let coefficients = [0.0, 0.25 * a, 0.25 * (a + b), 0.25 * (a + b + c), 0.25 * (a + b + c + d)];
    let mut row = coefficients;
    for last in (1..5).rev() {
        for i in 0..last {
            row[i] += (row[i + 1] - row[i]) * t;
        }
    }
    row[0]
}

/// The part of a cubic on [from, to].
fn part(b: &[f64; 4], from: f64, to: f64) -> [f64; 4] {
    let mix = |x: f64, y: f64, t: f64| x + (y - x) * t;
    // The part before `to`, then of that the part behind `from`.
    let (b01, b12, b23) = (mix(b[0], b[1], to), mix(b[1], b[2], to), mix(b[2], b[3], to));
    let (b012, b123) = (mix(b01, b12, to), mix(b12, b23, to));
    let b = [b[0], b01, b012, mix(b012, b123, to)];
    let t = if to > 0.0 { from / to } else { 0.0 };
    let (b01, b12, b23) = (mix(b[0], b[1], t), mix(b[1], b[2], t), mix(b[2], b[3], t));
    let (b012, b123) = (mix(b01, b12, t), mix(b12, b23, t));
    [mix(b012, b123, t), b123, b23, b[3]]
}

impl Curve {
    /// A table over the values of a volume, as one over its raw samples.
    fn new(table: &Table, volume: &Volume) -> Self {
        let mut rows: Vec<(f64, [f64; 3])> = if table.rows().len() == 1 {
            vec![(0.0, table.at(0.0).map(f64::from))]
        } else {
            table.rows().iter().map(|(value, v)| (volume.raw_from_value(*value), v.map(f64::from))).collect()
        };
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let constant = |v: &[f64; 3]| v.map(|v| [v, 0.0]);
        let straight = |pair: &[(f64, [f64; 3])]| {
            let ((x, v), (y, w)) = (pair[0], pair[1]);
            std::array::from_fn(|c| {
                let slope = (w[c] - v[c]) / (y - x);
                [v[c] - slope * x, slope]
            })
        };
        let first = rows.first().map(|(_, v)| constant(v));
        let last = rows.last().map(|(_, v)| constant(v));
        let pieces = first.into_iter().chain(rows.windows(2).map(straight)).chain(last).collect();
        Self { knots: rows.iter().map(|r| r.0).collect(), pieces }
    }

    fn at(&self, raw: f64) -> [f64; 3] {
        let piece = &self.pieces[self.knots.partition_point(|k| *k <= raw)];
        piece.map(|[offset, slope]| (offset + slope * raw).max(0.0))
    }

    /// The largest value of any channel over a range of raw samples.
    fn largest_within(&self, [low, high]: [f64; 2]) -> f64 {
        let inside = self.knots.iter().copied().filter(|k| low < *k && *k < high);
        let all = [low, high].into_iter().chain(inside).map(|raw| self.at(raw));
        all.flatten().fold(0.0, f64::max)
    }

    /// Hands over the parts of a segment on which the table is straight.
    fn each_stretch(&self, raw: &[f64; 4], from: f64, length: f64, visit: &mut dyn FnMut(&Stretch) -> bool) -> bool {
        let stretch = |piece: usize, raw: [f64; 4], from: f64, length: f64| {
            // Not below 0, where rounding of the split would have it so.
            let of = |[offset, slope]: [f64; 2]| raw.map(|raw| (offset + slope * raw).max(0.0));
            Stretch { from, length, raw, extinction: self.pieces[piece].map(of) }
        };
        let (low, high) = raw.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let (first, last) = (self.knots.partition_point(|k| *k <= low), self.knots.partition_point(|k| *k < high));
        if first >= last {
            return visit(&stretch(last, *raw, from, length));
        }
        let mut ends = Vec::with_capacity(8);
        self.knots[first..last].iter().for_each(|&knot| add_crossings(raw, knot, &mut ends));
        ends.sort_by(f64::total_cmp);
        ends.push(1.0);
        let mut start = 0.0;
        for end in ends {
            if end > start {
                let middle = value(raw, 0.5 * (start + end));
                let piece = self.knots.partition_point(|k| *k <= middle);
                let of_part = stretch(piece, part(raw, start, end), from + start * length, (end - start) * length);
                if !visit(&of_part) {
                    return false;
                }
                start = end;
            }
        }
        true
    }
}

/// The parameters in (0, 1) at which a cubic takes a value, by bisection between its stationary points.
fn add_crossings(b: &[f64; 4], at: f64, out: &mut Vec<f64>) {
    let (d0, d1, d2) = (b[1] - b[0], b[2] - b[1], b[3] - b[2]);
    let (a, h) = (d0 - 2.0 * d1 + d2, d1 - d0);
    let mut ends = [0.0, 1.0, 1.0, 1.0];
    let root = (h * h - a * d0).max(0.0).sqrt();
    let q = -(h + if h < 0.0 { -root } else { root });
    let mut stationary = [if a != 0.0 { q / a } else { 0.0 }, if q != 0.0 { d0 / q } else { 0.0 }];
    stationary.sort_by(f64::total_cmp);
    let mut count = 1;
    for t in stationary {
        if t > ends[count - 1] && t < 1.0 {
            (ends[count], count) = (t, count + 1);
        }
    }
    for i in 0..count {
        let (mut low, mut high) = (ends[i], if i + 1 < count { ends[i + 1] } else { 1.0 });
        let rises = value(b, high) > at;
        if (value(b, low) > at) == rises {
            continue;
        }
        while high - low > f64::EPSILON {
            let middle = 0.5 * (low + high);
            if (value(b, middle) > at) == rises { high = middle } else { low = middle }
        }
        out.push(high);
    }
}

/// A field along a ray in world.
trait Walk: Sync {
    /// Hands over the raw samples in each cell between two distances, as Bernstein coefficients, and where the part of it begins
    /// and ends, until it is told `false`.
    fn walk(
        &self,
        origin: DVec3,
        direction: DVec3,
        span: [f64; 2],
        is_empty: &dyn Fn(usize) -> bool,
        visit: &mut dyn FnMut(&[f64; 4], f64, f64) -> bool,
    );
}

impl<T: Sample> Walk for Standing<'_, T> {
    fn walk(
        &self,
        origin: DVec3,
        direction: DVec3,
        [from, to]: [f64; 2],
        is_empty: &dyn Fn(usize) -> bool,
        visit: &mut dyn FnMut(&[f64; 4], f64, f64) -> bool,
    ) {
        let Some((enter, leave)) = self.placement.span(origin, direction) else { return };
        let (from, to) = (from.max(enter), to.min(leave));
        if from >= to {
            return;
        }
        let (start, along) = self.placement.in_grid(origin + from * direction, direction);
        let start = self.field.locate(start.to_array());
        self.field.each_cell(&start, along.as_vec3(), is_empty, &mut |cubic, enter, leave| {
            let (enter, leave) = (from + enter, from + leave);
            if enter >= to {
                return false;
            }
            let raw = cubic.map(f64::from);
            if leave <= to {
                return visit(&raw, enter, leave);
            }
            visit(&part(&raw, 0.0, (to - enter) / (leave - enter)), enter, to);
            false
        });
    }
}
