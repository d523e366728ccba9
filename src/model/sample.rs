//! Sampling to a grid, in bricks: subtrees that cannot matter in a box are left out there.
//!
//! The slabs of eight layers are halved until they are bricks of 8³; at each step the tree of the larger box is pruned for
//! the smaller one by the ranges that its nodes can have there. What stays gives the bits that the whole tree gives: a
//! node is left out of a sum where it is exactly 0, and of a maximum where another is certainly larger.

use super::interval::Interval;
use super::operator::ricci;
use super::tree::{Flat, Op, Tree};
use super::warp::Region;
use crate::geom::Bounds;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Samples along each side of a brick.
pub const BRICK: usize = 8;

/// What was done, and found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Evaluations at points of what pruning left of the tree.
    pub points: u64,
    /// Evaluations of leaves at points.
    pub leaves: u64,
    /// Bricks.
    pub bricks: u64,
    /// Those that were filled with one number.
    pub filled: u64,
    /// Values that are not finite, which took the least of the others.
    pub mended: u64,
}

/// Points of a brick, by coordinate.
pub struct Points {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Points {
    /// Writes a function of each point.
    #[inline(always)]
    pub fn map(&self, out: &mut [f64], f: impl Fn([f64; 3]) -> f64) {
        let count = out.len();
        let (x, y, z) = (&self.x[..count], &self.y[..count], &self.z[..count]);
        for i in 0..count {
            out[i] = f([x[i], y[i], z[i]]);
        }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.x.len()
    }
}

/// What stays of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kept {
    Constant(f64),
    Step(u32),
}

/// A node that stays, with its place in the tree and the range of its children among the links.
#[derive(Clone, Debug)]
struct Step {
    node: u32,
    of: Range<u32>,
}

/// What stays of a tree in a box.
#[derive(Clone, Debug)]
struct Plan {
    steps: Vec<Step>,
    links: Vec<Kept>,
    root: Kept,
}

impl Plan {
    fn whole(tree: &Tree) -> Self {
        let mut plan = Self { steps: Vec::new(), links: Vec::new(), root: Kept::Step(tree.root()) };
        for (place, node) in tree.nodes.iter().enumerate() {
            let first = plan.links.len() as u32;
            plan.links.extend(node.of.iter().map(|&c| Kept::Step(c)));
            plan.steps.push(Step { node: place as u32, of: first..plan.links.len() as u32 });
        }
        plan
    }

    fn children(&self, step: &Step) -> &[Kept] {
        &self.links[step.of.start as usize..step.of.end as usize]
    }

    /// What stays in a smaller box.
    fn pruned(&self, tree: &Tree, region: &Region) -> Self {
        let mut out = Self { steps: Vec::new(), links: Vec::new(), root: Kept::Constant(0.0) };
        (out.root, _) = self.prune(tree, self.root, region, &mut out);
        out
    }

    fn prune(&self, tree: &Tree, kept: Kept, region: &Region, out: &mut Self) -> (Kept, Interval) {
        let at = match kept {
            Kept::Constant(value) => return (kept, Interval::at(value)),
            Kept::Step(at) => &self.steps[at as usize],
        };
        let op = &tree.nodes[at.node as usize].op;
        let inner = match op {
            Op::Leaf(leaf) => {
                let range = leaf.bounds(region);
                if range.low == range.high {
                    return (Kept::Constant(range.low), range);
                }
                return (out.push(at.node, &[]), range);
            }
            Op::Warp(warp) => warp.inverse_region(region),
            _ => *region,
        };
        let before = (out.steps.len(), out.links.len());
        let mut children: Vec<(Kept, Interval)> =
            self.children(at).iter().map(|&child| self.prune(tree, child, &inner, out)).collect();
        let range = op.bounds(&children.iter().map(|c| c.1).collect::<Vec<_>>());
        // A constant to the bit: no rounding lies between its parts.
        if range.low == range.high && children.iter().all(|c| matches!(c.0, Kept::Constant(_))) {
            out.steps.truncate(before.0);
            out.links.truncate(before.1);
            return (Kept::Constant(range.low), range);
        }
        leave_out(op, &mut children);
        if let ([(only, _)], true) = (&children[..], is_itself(op, &children)) {
            return (*only, range);
        }
        let links: Vec<Kept> = children.iter().map(|c| c.0).collect();
        (out.push(at.node, &links), range)
    }

    fn push(&mut self, node: u32, children: &[Kept]) -> Kept {
        let first = self.links.len() as u32;
        self.links.extend_from_slice(children);
        self.steps.push(Step { node, of: first..self.links.len() as u32 });
        Kept::Step(self.steps.len() as u32 - 1)
    }
}

/// Takes out the children that cannot change the value.
fn leave_out(op: &Op, children: &mut Vec<(Kept, Interval)>) {
    let zero = Interval::at(0.0);
    match op {
        // At least one stays.
        Op::Sum if children.iter().any(|c| c.1 != zero) => children.retain(|c| c.1 != zero),
        Op::Ricci(n) if *n > 0.0 && children.iter().any(|c| c.1 != zero) => children.retain(|c| c.1 != zero),
        Op::Union => {
            let best = children.iter().map(|c| c.1.low).fold(f64::NEG_INFINITY, f64::max);
            let winner = children.iter().position(|c| c.1.low == best);
            let mut place = 0;
            children.retain(|c| {
                let stays = winner == Some(place) || c.1.high > best || !is_known(c.1);
                place += 1;
                stays
            });
        }
        Op::Intersection => {
            let best = children.iter().map(|c| c.1.high).fold(f64::INFINITY, f64::min);
            let winner = children.iter().position(|c| c.1.high == best);
            let mut place = 0;
            children.retain(|c| {
                let stays = winner == Some(place) || c.1.low < best || !is_known(c.1);
                place += 1;
                stays
            });
        }
        Op::SmoothUnion(crease) => {
            let [a, b] = [children[0], children[1]];
            if is_known(a.1) && is_known(b.1) {
                if crease.union_is_first(a.1, b.1) {
                    children.truncate(1);
                } else if crease.union_is_first(b.1, a.1) {
                    children.remove(0);
                }
            }
        }
        Op::SmoothIntersection(crease) => {
            let [a, b] = [children[0], children[1]];
            if is_known(a.1) && is_known(b.1) {
                if crease.intersection_is_first(a.1, b.1) {
                    children.truncate(1);
                } else if crease.intersection_is_first(b.1, a.1) {
                    children.remove(0);
                }
            }
        }
        _ => {}
    }
}

/// Whether its values are numbers: what may be NaN has no finite range.
fn is_known(range: Interval) -> bool {
    range.low.is_finite() && range.high.is_finite()
}

/// Whether an operator on what is left of its children is that child.
fn is_itself(op: &Op, children: &[(Kept, Interval)]) -> bool {
    match op {
        Op::Sum | Op::Union | Op::Intersection | Op::SmoothUnion(_) | Op::SmoothIntersection(_) => true,
        // Negative fields count as 0 there.
        Op::Ricci(_) => children[0].1.low >= 0.0,
        _ => false,
    }
}

/// Arrays that are used again.
#[derive(Default)]
struct Pool(Vec<Vec<f64>>);

impl Pool {
    fn take(&mut self, count: usize) -> Vec<f64> {
        let mut array = self.0.pop().unwrap_or_default();
        array.resize(count, 0.0);
        array
    }
}

struct Filler<'a> {
    tree: &'a Tree,
    pool: Pool,
    counters: Counters,
}

impl Filler<'_> {
    fn fill(&mut self, plan: &Plan, kept: Kept, points: &Points, out: &mut [f64]) {
        let step = match kept {
            Kept::Constant(value) => return out.fill(value),
            Kept::Step(at) => &plan.steps[at as usize],
        };
        let tree = self.tree;
        let Flat { op, of } = &tree.nodes[step.node as usize];
        let children = plan.children(step);
        match op {
            Op::Leaf(leaf) => {
                self.counters.leaves += out.len() as u64;
                leaf.fill(points, out);
            }
            Op::Warp(warp) => {
                let mut inner =
                    Points { x: self.pool.take(out.len()), y: self.pool.take(out.len()), z: self.pool.take(out.len()) };
                for i in 0..out.len() {
                    [inner.x[i], inner.y[i], inner.z[i]] = warp.inverse([points.x[i], points.y[i], points.z[i]]);
                }
                self.fill(plan, children[0], &inner, out);
                self.pool.0.extend([inner.x, inner.y, inner.z]);
            }
            Op::Contact(contact) => {
                self.counters.leaves += 2 * out.len() as u64;
                points.map(out, |p| contact.value(tree, [of[0], of[1]], p));
            }
            Op::Sum => self.fold(plan, children, points, out, |a, b| a + b),
            Op::Union => self.fold(plan, children, points, out, super::scalar::Scalar::larger),
            Op::Intersection => self.fold(plan, children, points, out, super::scalar::Scalar::smaller),
            Op::Ricci(n) => {
                let mut all = Vec::with_capacity(children.len());
                for &child in children {
                    let mut values = self.pool.take(out.len());
                    self.fill(plan, child, points, &mut values);
                    all.push(values);
                }
                let mut fields = vec![0.0; all.len()];
                for i in 0..out.len() {
                    for (field, values) in fields.iter_mut().zip(&all) {
                        *field = values[i];
                    }
                    out[i] = ricci(&fields, *n);
                }
                self.pool.0.extend(all);
            }
            op => {
                self.fill(plan, children[0], points, out);
                let mut second = self.pool.take(out.len());
                if let Some(&other) = children.get(1) {
                    self.fill(plan, other, points, &mut second);
                }
                for i in 0..out.len() {
                    out[i] = op.apply(out[i], || second[i]);
                }
                self.pool.0.push(second);
            }
        }
    }

    fn fold(&mut self, plan: &Plan, children: &[Kept], points: &Points, out: &mut [f64], f: impl Fn(f64, f64) -> f64) {
        let Some((&first, rest)) = children.split_first() else { return out.fill(0.0) };
        self.fill(plan, first, points, out);
        let mut other = self.pool.take(out.len());
        for &child in rest {
            self.fill(plan, child, points, &mut other);
            for (value, o) in out.iter_mut().zip(&other) {
                *value = f(*value, *o);
            }
        }
        self.pool.0.push(other);
    }
}

/// The coordinates of samples, the first and last on the faces of a box.
pub fn coordinates(bounds: &Bounds, dims: [usize; 3]) -> [Vec<f64>; 3] {
    let (low, size) = (bounds.min, bounds.size());
    std::array::from_fn(|a| {
        let intervals = dims[a].saturating_sub(1).max(1) as f64;
        (0..dims[a]).map(|i| low[a] + i as f64 * size[a] / intervals).collect()
    })
}

/// A part of a slab that is worked on: ranges of samples along x and y.
type Part = [Range<usize>; 2];

struct Slab<'a> {
    tree: &'a Tree,
    along: &'a [Vec<f64>; 3],
    z: Range<usize>,
    prunes: bool,
}

impl Slab<'_> {
    fn region(&self, [x, y]: &Part) -> Region {
        let ends = |axis: usize, range: &Range<usize>| (self.along[axis][range.start], self.along[axis][range.end - 1]);
        let (x, y, z) = (ends(0, x), ends(1, y), ends(2, &self.z));
        let (low, high) = (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1));
        Region::of(&Bounds { min: low, max: high })
    }

    fn fill(&self, plan: &Plan, part: Part, filler: &mut Filler<'_>, out: &mut [f32]) {
        let pruned = self.prunes.then(|| plan.pruned(self.tree, &self.region(&part)));
        let plan = pruned.as_ref().unwrap_or(plan);
        let [x, y] = &part;
        let long = if x.len() >= y.len() { 0 } else { 1 };
        let is_constant = matches!(plan.root, Kept::Constant(_));
        if part[long].len() > BRICK && !is_constant {
            let range = &part[long];
            // At a whole number of bricks.
            let half = range.len().div_ceil(BRICK).div_ceil(2) * BRICK;
            let middle = range.start + half;
            for half in [range.start..middle, middle..range.end] {
                let mut smaller = part.clone();
                smaller[long] = half;
                self.fill(plan, smaller, filler, out);
            }
            return;
        }
        let bricks = (x.len().div_ceil(BRICK) * y.len().div_ceil(BRICK)) as u64;
        filler.counters.bricks += bricks;
        let row = |y: usize, z: usize| self.along[0].len() * (y + self.along[1].len() * (z - self.z.start));
        if let Kept::Constant(value) = plan.root {
            filler.counters.filled += bricks;
            for z in self.z.clone() {
                for y in y.clone() {
                    out[row(y, z) + x.start..row(y, z) + x.end].fill(stored(value));
                }
            }
            return;
        }
        let count = x.len() * y.len() * self.z.len();
        let mut points = Points { x: filler.pool.take(count), y: filler.pool.take(count), z: filler.pool.take(count) };
        let mut i = 0;
        for z in self.z.clone() {
            for y in y.clone() {
                for x in x.clone() {
                    (points.x[i], points.y[i], points.z[i]) = (self.along[0][x], self.along[1][y], self.along[2][z]);
                    i += 1;
                }
            }
        }
        let mut values = filler.pool.take(count);
        filler.counters.points += count as u64;
        filler.fill(plan, plan.root, &points, &mut values);
        let mut from = values.iter();
        for z in self.z.clone() {
            for y in y.clone() {
                for (to, value) in out[row(y, z) + x.start..row(y, z) + x.end].iter_mut().zip(&mut from) {
                    *to = stored(*value);
                }
            }
        }
        filler.pool.0.extend([values, points.x, points.y, points.z]);
    }
}

/// Rounded once; −0 becomes 0, since pruning does not keep the sign of zeros.
fn stored(value: f64) -> f32 {
    (value + 0.0) as f32
}

impl Tree {
    /// The values at the samples of a grid, x fastest, whose first and last lie on the faces of a box. `prunes` is false
    /// in tests and measurements alone: the values have the same bits.
    pub fn sample(&self, bounds: &Bounds, dims: [usize; 3], prunes: bool, out: &mut Vec<f32>) -> Counters {
        let [nx, ny, nz] = dims;
        out.clear();
        out.resize(nx * ny * nz, 0.0);
        if out.is_empty() {
            return Counters::default();
        }
        let along = coordinates(bounds, dims);
        let whole = Plan::whole(self);
        let slabs = out.par_chunks_mut(nx * ny * BRICK).enumerate().map(|(i, values)| {
            let z = i * BRICK..(i * BRICK + BRICK).min(nz);
            let slab = Slab { tree: self, along: &along, z, prunes };
            let mut filler = Filler { tree: self, pool: Pool::default(), counters: Counters::default() };
            slab.fill(&whole, [0..nx, 0..ny], &mut filler, values);
            filler.counters
        });
        let all: Vec<Counters> = slabs.collect();
        let mut sum = all.iter().fold(Counters::default(), |a, b| Counters {
            points: a.points + b.points,
            leaves: a.leaves + b.leaves,
            bricks: a.bricks + b.bricks,
            filled: a.filled + b.filled,
            mended: 0,
        });
        sum.mended = mend(out);
        sum
    }
}

/// Gives values that are not finite the least of the others; 0 where there are none.
fn mend(values: &mut [f32]) -> u64 {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    if values.iter().all(|v| v.is_finite()) {
        return 0;
    }
    let least = finite().reduce(f32::min).unwrap_or(0.0);
    let mut count = 0;
    for value in values.iter_mut().filter(|v| !v.is_finite()) {
        *value = least;
        count += 1;
    }
    count
}
