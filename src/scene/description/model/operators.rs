//! Operators.

use super::super::read::{Item, Section};
use super::super::surroundings::{required, rotation, vector};
use super::Reading;
use super::leaves::number_above;
use crate::error::Result;
use crate::geom::{Affine, Bounds};
use crate::model::{Between, Contact, Crease, Grid, Kind, Leaf, Node, Op, Pasko, Show, Tree, Warp, grid};
use glam::{DMat3, DVec3};

/// Points at which the error of a cached subtree is estimated.
const PROBES: u64 = 4096;
/// Fastest twist in radians per unit: beyond it nothing is left of a shape, and angles overflow.
const MOST_RATE: f64 = 1e6;
/// Most samples of a cached subtree along a side.
const MOST_CACHED: u64 = 512;

/// The node of a kind that has children.
pub(super) fn read<'a>(kind: &str, item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let iso = reading.context.iso;
    let one = |node: Vec<Node>, op: Op| Node::of(op, node);
    Ok(match kind {
        "blend" | "sum" => {
            let section = item.section(if kind == "blend" { &["of", "ricci"] } else { &["of"] })?;
            let of = reading.children(&section, item, 1..=usize::MAX)?;
            match section.get("ricci") {
                Some(n) => Node::of(Op::Ricci(exponent(&n)?), of),
                None => Node::of(Op::Sum, of),
            }
        }
        "union" | "intersection" | "difference" => boolean(kind, item, reading)?,
        "pasko" => pasko(item, reading)?,
        "affine" => {
            let section = item.section(&["of", "scale", "rotate", "translate"])?;
            let map = affine(&section, item)?;
            one(reading.children(&section, item, 1..=1)?, Op::Warp(Warp::affine(map)))
        }
        "instance" => instance(item, reading)?,
        "repeat" => repeat(item, reading)?,
        "twist" => {
            let section = item.section(&["of", "axis", "per_unit"])?;
            let per_unit = required(&section, item, "per_unit", "write per_unit = 0.8, radians per unit")?;
            let rate = per_unit.number()?;
            if rate.abs() > MOST_RATE {
                return Err(per_unit.refuse("at most a million radians per unit", "such as 0.8"));
            }
            let warp = Warp { axes: axes(&section, "z", 2)?, kind: Kind::Twist { rate } };
            one(reading.children(&section, item, 1..=1)?, Op::Warp(warp))
        }
        "taper" => {
            let section = item.section(&["of", "axis", "from", "to", "scale"])?;
            let of = |key: &str| required(&section, item, key, &format!("write {key} = 1"))?.number();
            let range = [of("from")?, of("to")?];
            if range[0] >= range[1] {
                return Err(item.refuse("from below to", "the scale is 1 up to `from`, and `scale` from `to` on"));
            }
            let scale = number_above(&required(&section, item, "scale", "write scale = 0.5")?)?;
            let warp = Warp { axes: axes(&section, "y", 1)?, kind: Kind::Taper { range, scale } };
            one(reading.children(&section, item, 1..=1)?, Op::Warp(warp))
        }
        "bend" => bend(item, reading)?,
        "contact" => contact(item, reading)?,
        "cache" => cache(item, reading)?,
        "round" | "offset" => {
            let section = item.section(&["of", "by"])?;
            let by = required(&section, item, "by", "write by = 0.1, in the unit of the field")?;
            let by = if kind == "round" { number_above(&by)? } else { by.number()? };
            one(reading.children(&section, item, 1..=1)?, Op::Offset(by))
        }
        "weight" => {
            let section = item.section(&["of", "by"])?;
            let by = required(&section, item, "by", "write by = 0.5")?.number()?;
            one(reading.children(&section, item, 1..=1)?, Op::Weight(by))
        }
        "invert" => {
            let section = item.section(&["of"])?;
            one(reading.children(&section, item, 1..=1)?, Op::Complement(iso))
        }
        _ => {
            let section = item.section(&["of", "thickness"])?;
            let thickness = number_above(&required(&section, item, "thickness", "write thickness = 0.1")?)?;
            one(reading.children(&section, item, 1..=1)?, Op::Shell(iso, thickness))
        }
    })
}

pub(super) fn exponent(item: &Item<'_>) -> Result<f64> {
    let n = item.number()?;
    if n.abs() >= 1e-3 && n.abs() <= 1e3 {
        Ok(n)
    } else {
        Err(item.refuse("an exponent other than 0", "1 is the sum, 20 nearly the union"))
    }
}

/// Which world axes are x, y, z of a deformation whose own axis is the one at `place`.
fn axes(section: &Section<'_>, usual: &'static str, place: usize) -> Result<[usize; 3]> {
    let word = section.get("axis").map_or(Ok(usual), |item| item.word(&["x", "y", "z"]))?;
    let world = ["x", "y", "z"].iter().position(|w| *w == word).unwrap_or(place);
    // A cyclic permutation keeps the handedness, and so the sense of turns.
    let shift = (world + 3 - place) % 3;
    Ok(std::array::from_fn(|axis| (axis + shift) % 3))
}

fn boolean<'a>(kind: &str, item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "smooth"])?;
    let crease = match section.get("smooth") {
        Some(item) => smooth(&item, reading.context.iso)?,
        None => None,
    };
    let iso = reading.context.iso;
    let of = reading.children(&section, item, 2..=usize::MAX)?;
    let Some(crease) = crease else {
        return Ok(match kind {
            "union" => Node::of(Op::Union, of),
            "intersection" => Node::of(Op::Intersection, of),
            _ => Node::difference(of, iso),
        });
    };
    // Binary; of more the result is taken with the next, in the order of the list.
    let mut of = of.into_iter();
    let Some(first) = of.next() else { return Err(item.refuse("at least two nodes", "name them in `of`")) };
    Ok(of.fold(first, |so_far, next| match kind {
        "union" => Node::of(Op::SmoothUnion(crease), vec![so_far, next]),
        "intersection" => Node::of(Op::SmoothIntersection(crease), vec![so_far, next]),
        _ => Node::of(Op::SmoothIntersection(crease), vec![so_far, Node::of(Op::Complement(iso), vec![next])]),
    }))
}

fn smooth(item: &Item<'_>, iso: f64) -> Result<Option<Crease>> {
    let mut crease = Crease { iso, m: 0.7, k: 0.3 };
    if item.entries().is_some() {
        let section = item.section(&["m", "k"])?;
        let share = |key: &str, usual: f64| match section.get(key) {
            Some(item) => {
                let value = item.number()?;
                if (0.0..=1.0).contains(&value) {
                    Ok(value)
                } else {
                    Err(item.refuse("0 to 1", "0.7 and 0.3 are usual"))
                }
            }
            None => Ok(usual),
        };
        (crease.m, crease.k) = (share("m", 0.7)?, share("k", 0.3)?);
    } else if !item.boolean()? {
        return Ok(None);
    }
    if iso > 0.0 {
        Ok(Some(crease))
    } else {
        Err(item.refuse("a model with a positive isovalue", "write isovalue = 0.5, with fall-offs"))
    }
}

fn pasko<'a>(item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "operation", "alpha", "m", "displacement"])?;
    let of_word = match section.get("operation") {
        Some(item) => Some(match item.word(&["union", "intersection", "sum"])? {
            "union" => 1.0,
            "intersection" => -1.0,
            _ => 0.0,
        }),
        None => None,
    };
    let alpha = match (section.get("alpha"), of_word) {
        (Some(both), Some(_)) => return Err(both.refuse("either operation or alpha", "take one out")),
        (Some(item), None) => {
            let alpha = item.number()?;
            if !(-1.0..=1.0).contains(&alpha) {
                return Err(item.refuse("-1 (intersection) to 1 (union)", "write operation = \"union\""));
            }
            alpha
        }
        (None, Some(alpha)) => alpha,
        (None, None) => return Err(item.refuse("the key `operation`", "write operation = \"union\"")),
    };
    let m = match section.get("m") {
        Some(item) => Some(item.number()?)
            .filter(|m| [0.0, 2.0].contains(m))
            .ok_or_else(|| item.refuse("0 or 2", "0 is usual"))?,
        None => 0.0,
    };
    let displacement = match section.get("displacement") {
        Some(item) => {
            let a = vector(&item)?;
            if a.y <= 0.0 || a.z <= 0.0 {
                return Err(item.refuse("a height and two positive widths", "write displacement = [0.2, 0.5, 0.5]"));
            }
            Some(a.to_array())
        }
        None => None,
    };
    let pasko = Pasko { iso: reading.context.iso, alpha, m, displacement };
    Ok(Node::of(Op::Pasko(pasko), reading.children(&section, item, 2..=2)?))
}

/// p → rotate(scale p) + translate.
fn affine(section: &Section<'_>, item: &Item<'_>) -> Result<Affine> {
    let scale = match section.get("scale") {
        Some(item) => match item.as_number() {
            Some(s) => DVec3::splat(s),
            None => vector(&item)?,
        },
        None => DVec3::ONE,
    };
    let translate = section.get("translate").map_or(Ok(DVec3::ZERO), |t| vector(&t))?;
    Affine::new(rotation(section)? * DMat3::from_diagonal(scale), translate)
        .ok_or_else(|| item.refuse("a map with an inverse", "no scale may be 0"))
}

/// Copies of nodes, as many as fit.
fn copies<'a>(
    item: &Item<'a>,
    reading: &mut Reading<'a, '_>,
    section: &Section<'a>,
    maps: impl Iterator<Item = Affine>,
    count: usize,
) -> Result<Node> {
    let op = match section.get("blend") {
        Some(item) => match item.word(&["union", "sum"])? {
            "sum" => Op::Sum,
            _ => Op::Union,
        },
        None => Op::Union,
    };
    let Some(node) = reading.children(section, item, 1..=1)?.pop() else {
        return Err(item.refuse("a node", "name it in `of`"));
    };
    reading.check_count(node.count().saturating_mul(count), item)?;
    Ok(Node::of(op, maps.map(|map| Node::of(Op::Warp(Warp::affine(map)), vec![node.clone()])).collect()))
}

fn instance<'a>(item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "at", "scale", "rotate", "blend"])?;
    let at = required(&section, item, "at", "write at = [[0, 0, 0], [1, 0, 0]]")?;
    let places = at.one_or_more()?.iter().map(vector).collect::<Result<Vec<_>>>()?;
    let map = affine(&section, item)?;
    let moved = |by: &DVec3| Affine::new(map.linear(), *by);
    let maps: Vec<Affine> = places.iter().filter_map(moved).collect();
    let count = maps.len();
    copies(item, reading, &section, maps.into_iter(), count)
}

fn repeat<'a>(item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "count", "scale", "rotate", "translate", "blend"])?;
    let count = required(&section, item, "count", "write count = 8")?.integer(1..=100_000)? as usize;
    let step = affine(&section, item)?;
    let mut maps = vec![Affine::IDENTITY];
    for _ in 1..count {
        let last = maps[maps.len() - 1];
        let next = Affine::new(step.linear() * last.linear(), step.point(last.offset()));
        maps.push(next.ok_or_else(|| item.refuse("copies of a finite size", "use fewer, or a scale nearer to 1"))?);
    }
    copies(item, reading, &section, maps.into_iter(), count)
}

fn bend<'a>(item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "along", "towards", "per_unit", "centre", "from", "to"])?;
    let word = |key: &str, usual: &'static str| section.get(key).map_or(Ok(usual), |i| i.word(&["x", "y", "z"]));
    let place = |word: &str| ["x", "y", "z"].iter().position(|w| *w == word).unwrap_or(0);
    let (along, towards) = (place(word("along", "x")?), place(word("towards", "y")?));
    if along == towards {
        return Err(item.refuse("two axes that differ", "the body lies `along` one and bends `towards` the other"));
    }
    let axes = [along, towards, 3 - along - towards];
    let rate_item = required(&section, item, "per_unit", "write per_unit = 0.8, radians per unit")?;
    let rate = rate_item.number()?;
    let number = |key: &str| required(&section, item, key, &format!("write {key} = 1"))?.number();
    let range = [number("from")?, number("to")?];
    let centre = match section.get("centre") {
        Some(item) => item.number()?,
        None => 0.5 * (range[0] + range[1]),
    };
    if range[0] >= range[1] {
        return Err(item.refuse("from below to", "between them the body is bent, beyond it goes on straight"));
    }
    if rate.abs() < 1e-9 || rate.abs() * (range[1] - range[0]) >= std::f64::consts::TAU {
        return Err(
            rate_item.refuse("a rate other than 0 that makes less than a turn", "shorten from … to, or bend less")
        );
    }
    let of = reading.children(&section, item, 1..=1)?;
    let warp = Warp { axes, kind: Kind::Bend { rate, centre, range } };
    // Beyond the axis of the bend there is no place for the body.
    let support = Tree::new(of[0].clone()).map(|tree| tree.body()).unwrap_or(Bounds::EMPTY);
    let ends = [support.min[towards], support.max[towards]];
    if ends.iter().any(|y| y.is_finite() && 1.0 - rate * y <= 0.0) {
        let expected = format!(
            "a body this side of the axis of the bend, {towards} = {:.4}",
            1.0 / rate,
            towards = ["x", "y", "z"][towards]
        );
        return Err(rate_item.refuse(expected, format!("it reaches from {:.4} to {:.4}: bend less", ends[0], ends[1])));
    }
    Ok(Node::of(Op::Warp(warp), of))
}

fn contact<'a>(item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "width", "attenuation", "show", "gap"])?;
    let iso = reading.context.iso;
    if iso <= 0.0 {
        return Err(item.refuse("a model with a positive isovalue", "contact works on fields with a fall-off"));
    }
    let width = number_above(&required(&section, item, "width", "write width = 0.2, of the bulge")?)?;
    let attenuation = match section.get("attenuation") {
        Some(item) => Some(item.number()?)
            .filter(|a| (0.0..=10.0).contains(a))
            .ok_or_else(|| item.refuse("0 to 10", "1 is usual"))?,
        None => 1.0,
    };
    let gap = section.get("gap").map(|item| number_above(&item)).transpose()?;
    let show_item = required(&section, item, "show", "write show = \"first\", \"second\", or \"both\" with a gap")?;
    let show = match (show_item.word(&["first", "second", "both"])?, gap) {
        ("first", None) => Show::First,
        ("second", None) => Show::Second,
        ("both", Some(gap)) => Show::Both(gap),
        ("both", None) => {
            let expected =
                "gap = 0.02 beside it: between the bodies lies a sheet without thickness, which no grid holds";
            return Err(show_item.refuse(expected, "write gap, the width of a slit in the field"));
        }
        _ => return Err(show_item.refuse("show = \"both\" beside gap", "take the gap out")),
    };
    let of = reading.children(&section, item, 2..=2)?;
    let trees = [Tree::new(of[0].clone())?, Tree::new(of[1].clone())?];
    // Where both are, as far as is known, inside of what is sampled or not: a warp may stand above.
    let mut meet = Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
    for tree in &trees {
        let support = tree.body();
        meet = Bounds { min: meet.min.max(support.min), max: meet.max.min(support.max) };
    }
    let whole = reading.context.bounds;
    if !(meet.min.is_finite() && meet.max.is_finite()) {
        meet = whole;
    }
    let apart = meet.size().min_element() <= 0.0;
    let contact =
        Contact::new(iso, width, attenuation, show, [&trees[0], &trees[1]], if apart { &whole } else { &meet });
    if !contact.is_touching() {
        reading.context.notes.push(format!("line {}: the two bodies of a contact do not meet", item.line()));
    }
    Ok(Node::of(Op::Contact(Box::new(contact)), of))
}

fn cache<'a>(item: &Item<'a>, reading: &mut Reading<'a, '_>) -> Result<Node> {
    let section = item.section(&["of", "samples"])?;
    let n = required(&section, item, "samples", "write samples = 64")?.integer(4..=MOST_CACHED)? as usize;
    let of = reading.children(&section, item, 1..=1)?;
    let tree = Tree::new(of[0].clone())?;
    let support = tree.support();
    let whole = reading.context.bounds;
    let is_finite = support.min.is_finite() && support.max.is_finite();
    let bounds = if is_finite && support.size().min_element() > 0.0 { support } else { whole };
    let sides = bounds.size();
    let dims = (sides / sides.max_element() * (n - 1) as f64).to_array().map(|v| (v.ceil() as usize).max(3) + 1);
    let mut samples = Vec::new();
    let counters = tree.sample(&bounds, dims, true, &mut samples);
    let range = samples.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let grid = Grid::new(dims, samples, bounds, Between::Cubic);
    let grid = grid.ok_or_else(|| item.refuse("a box with a volume", "see the bounds"))?;
    let [most, rms] = grid::difference(&bounds, PROBES, |p| tree.value(p), |p| grid.value(p.to_array()));
    let of_range = f64::from(range.1 - range.0).max(f64::MIN_POSITIVE);
    reading.context.notes.push(format!(
        "line {}: a grid of {} × {} × {} in place of its subtree, off by {:.2} % of its range (RMS; at most {:.2} % at {PROBES} points); \
         creases are rounded{}",
        item.line(),
        dims[0],
        dims[1],
        dims[2],
        100.0 * rms / of_range,
        100.0 * most / of_range,
        if counters.mended > 0 { "; values that are missing took the least" } else { "" }
    ));
    Ok(Node::leaf(Leaf::Grid(grid.into())))
}
