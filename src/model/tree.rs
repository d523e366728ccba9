//! Trees of leaves and operators.

use super::contact::Contact;
use super::interval::Interval;
use super::leaf::Leaf;
use super::operator::{Crease, Pasko, ricci, shell};
use super::scalar::{Dual, Point, Scalar};
use super::warp::{Kind, Region, Warp};
use crate::error::{Error, Result};
use crate::geom::Bounds;
use glam::DVec3;

/// Most nodes of a tree, counted where they are used: a node that two others use counts twice.
pub const MOST_NODES: usize = 100_000;
/// Deepest nesting, for the stack.
pub const DEEPEST: usize = 100;

/// What a node does with its children.
#[derive(Clone, Debug)]
pub enum Op {
    /// No children.
    Leaf(Leaf),
    /// Σ f_i.
    Sum,
    /// Ricci's blend.
    Ricci(f64),
    /// max f_i.
    Union,
    /// min f_i.
    Intersection,
    /// 2 iso − f, one child: what is outside of it.
    Complement(f64),
    /// Pasko's operators, two children.
    Pasko(Pasko),
    /// A union with a crease on its surface alone, two children.
    SmoothUnion(Crease),
    /// The intersection, two children.
    SmoothIntersection(Crease),
    /// f(w(p)), one child.
    Warp(Warp),
    /// f + this, one child.
    Offset(f64),
    /// f × this, one child.
    Weight(f64),
    /// A wall about the surface, one child: iso and thickness.
    Shell(f64, f64),
    /// Two bodies that touch.
    Contact(Box<Contact>),
}

/// A node with its children.
#[derive(Clone, Debug)]
pub struct Node {
    /// What it does.
    pub op: Op,
    /// The children.
    pub of: Vec<Node>,
}

impl Node {
    /// A leaf.
    pub fn leaf(leaf: Leaf) -> Self {
        Self { op: Op::Leaf(leaf), of: Vec::new() }
    }

    /// An operator on nodes.
    pub fn of(op: Op, of: Vec<Node>) -> Self {
        Self { op, of }
    }

    /// f_0 without f_1, f_2, …: min(f_0, 2 iso − f_j). (Not min(f_0, −f_j), as it is printed too: of fields that are not
    /// negative that is nowhere above iso.)
    pub fn difference(of: Vec<Node>, iso: f64) -> Self {
        let mut of = of.into_iter();
        let first = of.next();
        let rest = of.map(|node| Self::of(Op::Complement(iso), vec![node]));
        Self::of(Op::Intersection, first.into_iter().chain(rest).collect())
    }

    /// Counts its nodes, for [`MOST_NODES`].
    pub fn count(&self) -> usize {
        1 + self.of.iter().map(Self::count).sum::<usize>()
    }
}

/// A node of a tree, its children by their place.
#[derive(Clone, Debug)]
pub(super) struct Flat {
    pub(super) op: Op,
    pub(super) of: Vec<u32>,
}

/// A tree, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Tree {
    // Invariant: children stand before their parents, each has one; operators have as many as they need; the last is the root.
    pub(super) nodes: Vec<Flat>,
}

impl Tree {
    /// A tree from its root.
    ///
    /// # Errors
    /// When an operator has another number of children than it needs, the tree is too large or too deep, or one contact
    /// stands below another.
    pub fn new(root: Node) -> Result<Self> {
        let mut tree = Self { nodes: Vec::new() };
        tree.add(root, 0, false)?;
        Ok(tree)
    }

    fn add(&mut self, node: Node, depth: usize, in_contact: bool) -> Result<u32> {
        if depth > DEEPEST {
            return Err(too_large("nesting", DEEPEST));
        }
        let count = node.of.len();
        let fits = match &node.op {
            Op::Leaf(_) => count == 0,
            Op::Sum | Op::Ricci(_) | Op::Union | Op::Intersection => count >= 1,
            Op::Pasko(_) | Op::SmoothUnion(_) | Op::SmoothIntersection(_) | Op::Contact(_) => count == 2,
            Op::Complement(_) | Op::Warp(_) | Op::Offset(_) | Op::Weight(_) | Op::Shell(..) => count == 1,
        };
        if !fits {
            let given = format!("an operator of {count} nodes");
            return Err(Error::argument("model", given, "as many as it works on", "name them in `of`"));
        }
        let is_contact = matches!(node.op, Op::Contact(_));
        if is_contact && in_contact {
            let expected = "one contact on the way from the root to a leaf";
            return Err(Error::argument("model", "a contact below another", expected, "take one of them out"));
        }
        let of =
            node.of.into_iter().map(|n| self.add(n, depth + 1, in_contact || is_contact)).collect::<Result<_>>()?;
        if self.nodes.len() >= MOST_NODES {
            return Err(too_large("nodes", MOST_NODES));
        }
        self.nodes.push(Flat { op: node.op, of });
        Ok(self.nodes.len() as u32 - 1)
    }

    pub(super) fn root(&self) -> u32 {
        self.nodes.len() as u32 - 1
    }

    /// The value at a point.
    pub fn value(&self, p: DVec3) -> f64 {
        self.eval(self.root(), p.to_array())
    }

    /// The value and the gradient at a point, by the chain rule.
    pub fn value_and_gradient(&self, p: DVec3) -> (f64, DVec3) {
        let Dual { value, gradient } = self.eval(self.root(), Dual::variables(p));
        (value, gradient)
    }

    /// The value at a point that may carry derivatives.
    pub fn at<S: Scalar>(&self, p: Point<S>) -> S {
        self.eval(self.root(), p)
    }

    pub(super) fn eval<S: Scalar>(&self, node: u32, p: Point<S>) -> S {
        let Flat { op, of } = &self.nodes[node as usize];
        let child = |i: usize| self.eval(of[i], p);
        match op {
            Op::Leaf(leaf) => leaf.value(p),
            Op::Warp(warp) => self.eval(of[0], warp.inverse(p)),
            Op::Contact(contact) => contact.value(self, [of[0], of[1]], p),
            // Folded, so that long lists need no memory.
            Op::Sum => of.iter().map(|&c| self.eval(c, p)).reduce(|a, b| a + b).unwrap_or(S::of(0.0)),
            Op::Union => of.iter().map(|&c| self.eval(c, p)).reduce(S::larger).unwrap_or(S::of(0.0)),
            Op::Intersection => of.iter().map(|&c| self.eval(c, p)).reduce(S::smaller).unwrap_or(S::of(0.0)),
            Op::Ricci(n) => ricci(&of.iter().map(|&c| self.eval(c, p)).collect::<Vec<S>>(), *n),
            op => op.apply(child(0), || child(1)),
        }
    }

    /// The value range of a node in a box, without pruning.
    pub fn bounds_in(&self, region: &Region) -> Interval {
        self.bounds_of(self.root(), region)
    }

    fn bounds_of(&self, node: u32, region: &Region) -> Interval {
        let Flat { op, of } = &self.nodes[node as usize];
        let inner = match op {
            Op::Leaf(leaf) => return leaf.bounds(region),
            Op::Warp(warp) => warp.inverse_region(region),
            _ => *region,
        };
        let children: Vec<Interval> = of.iter().map(|&c| self.bounds_of(c, &inner)).collect();
        op.bounds(&children)
    }

    /// The box outside of which the root is 0, as far as it is known; infinite where it is not.
    pub fn support(&self) -> Bounds {
        self.support_of(self.root(), false)
    }

    /// The box outside of which nothing is solid, as far as it is known; infinite where it is not.
    pub fn body(&self) -> Bounds {
        self.support_of(self.root(), true)
    }

    fn support_of(&self, node: u32, of_body: bool) -> Bounds {
        let Flat { op, of } = &self.nodes[node as usize];
        let around = |a: Bounds, b: Bounds| Bounds { min: a.min.min(b.min), max: a.max.max(b.max) };
        let all = Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        match op {
            Op::Leaf(leaf) => leaf.support(of_body),
            Op::Complement(_) => all,
            Op::Offset(by) => {
                let inner = self.support_of(of[0], of_body);
                Bounds { min: inner.min - by.max(0.0), max: inner.max + by.max(0.0) }
            }
            Op::Shell(_, thickness) => {
                let inner = self.support_of(of[0], of_body);
                Bounds { min: inner.min - 0.5 * thickness, max: inner.max + 0.5 * thickness }
            }
            Op::Intersection | Op::SmoothIntersection(_) => of
                .iter()
                .map(|&c| self.support_of(c, of_body))
                .fold(all, |a, b| Bounds { min: a.min.max(b.min), max: a.max.min(b.max) }),
            Op::Warp(warp) => forward_box(warp, self.support_of(of[0], of_body)),
            _ => of.iter().map(|&c| self.support_of(c, of_body)).fold(Bounds::EMPTY, around),
        }
    }

    /// Whether {f > c} is convex for every c: of a leaf that is, moved perhaps, and of half-spaces cut with each other.
    pub fn is_convex(&self) -> bool {
        let mut node = self.root();
        loop {
            let Flat { op, of } = &self.nodes[node as usize];
            let is_half_space = |&c: &u32| matches!(&self.nodes[c as usize].op, Op::Leaf(leaf) if leaf.is_half_space());
            match op {
                Op::Leaf(leaf) => return leaf.is_convex(),
                Op::Intersection => return of.iter().all(is_half_space),
                Op::Warp(warp) if warp.is_convexity_kept() => node = of[0],
                _ => return false,
            }
        }
    }

    /// Whether a node means what it says at one isovalue alone.
    pub fn is_for_one_isovalue(&self) -> bool {
        let one = |op: &Op| {
            matches!(
                op,
                Op::Complement(_)
                    | Op::Pasko(_)
                    | Op::SmoothUnion(_)
                    | Op::SmoothIntersection(_)
                    | Op::Shell(..)
                    | Op::Contact(_)
            )
        };
        self.nodes.iter().any(|node| one(&node.op))
    }
}

impl Op {
    /// An operator on one or two values.
    pub(super) fn apply<S: Scalar>(&self, first: S, second: impl FnOnce() -> S) -> S {
        match self {
            Self::Complement(iso) => S::of(2.0 * iso) - first,
            Self::Offset(by) => first.plus(*by),
            Self::Weight(by) => first.scaled(*by),
            Self::Shell(iso, thickness) => shell(first, *iso, *thickness),
            Self::Pasko(pasko) => pasko.of(first, second()),
            Self::SmoothUnion(crease) => crease.union(first, second()),
            Self::SmoothIntersection(crease) => crease.intersection(first, second()),
            _ => first,
        }
    }

    /// Where the values lie, from where those of the children lie.
    pub(super) fn bounds(&self, children: &[Interval]) -> Interval {
        let first = children.first().copied().unwrap_or(Interval::ALL);
        let second = children.get(1).copied().unwrap_or(first);
        let fold = |f: fn(Interval, Interval) -> Interval| children.iter().copied().reduce(f).unwrap_or(Interval::ALL);
        let of_ends = |f: &dyn Fn(&[f64]) -> f64| {
            let end = |pick: fn(&Interval) -> f64| f(&children.iter().map(pick).collect::<Vec<_>>());
            Interval::new(end(|i| i.low), end(|i| i.high)).widened()
        };
        match self {
            Self::Leaf(_) => Interval::ALL,
            Self::Sum => {
                let sum = fold(|a, b| a + b);
                // Zero stays exactly zero.
                if sum == Interval::at(0.0) { sum } else { sum.widened() }
            }
            Self::Union => fold(Interval::larger),
            Self::Intersection => fold(Interval::smaller),
            // These rise in each of their fields.
            Self::Ricci(n) => {
                let ends = of_ends(&|values| ricci(values, *n));
                if ends.high == 0.0 { Interval::at(0.0) } else { Interval::new(ends.low.max(0.0), ends.high) }
            }
            Self::SmoothUnion(crease) => of_ends(&|v| crease.union(v[0], v[1])).around(1e-9 * crease.iso),
            Self::SmoothIntersection(crease) => of_ends(&|v| crease.intersection(v[0], v[1])).around(1e-9 * crease.iso),
            Self::Complement(iso) => (-first + 2.0 * iso).around(1e-11 * iso.abs()),
            Self::Offset(by) => (first + *by).widened().around(1e-11 * by.abs()),
            Self::Weight(by) => (first * Interval::at(*by)).widened(),
            Self::Shell(iso, thickness) => {
                let around = 1e-11 * (iso.abs() + thickness);
                (-(first - *iso).magnitude() + (0.5 * thickness + iso)).widened().around(around)
            }
            Self::Pasko(pasko) => pasko.bounds(first, second),
            Self::Warp(_) => first,
            Self::Contact(contact) => contact.bounds(first, second),
        }
    }
}

/// The box around what a deformation makes of a box: its corners for a map, else with the margin of how far the
/// deformation moves anything, from points on a grid in the box.
fn forward_box(warp: &Warp, inner: Bounds) -> Bounds {
    let all = Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
    if !(inner.min.is_finite() && inner.max.is_finite()) {
        return all;
    }
    let steps = if matches!(warp.kind, Kind::Affine(_)) { 1 } else { 32 };
    let mut out = Bounds::EMPTY;
    let at = |i: usize, axis: usize| inner.min[axis] + inner.size()[axis] * i as f64 / steps as f64;
    for index in crate::grid3::all([steps + 1; 3]) {
        out = out.including(warp.forward(DVec3::new(at(index[0], 0), at(index[1], 1), at(index[2], 2))));
    }
    // The sagitta between neighbouring points: second order in the step.
    let margin = if steps == 1 { 1e-12 } else { 0.02 } * out.size().max_element();
    Bounds { min: out.min - margin, max: out.max + margin }
}

fn too_large(what: &str, limit: usize) -> Error {
    Error::Limit {
        what: "the model".into(),
        needed: format!("more than {limit} {what}"),
        limit: limit.to_string(),
        remedy: "use fewer, or sample parts with `cache`".into(),
    }
}
