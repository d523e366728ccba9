//! Primitives and other nodes without children.

use super::super::read::{Item, Section};
use super::super::surroundings::{required, rotation, scale, vector};
use super::operators::exponent;
use super::sampled::at_file;
use super::{Context, molecule, sampled};
use crate::error::Result;
use crate::geom::{Affine, Bounds};
use crate::model::convolution::{gauss, lines_of_triangle};
use crate::model::{
    Convolution, Falloff, Formula, Kernel, Leaf, MeshDistance, Node, Op, Radial, Rbf, Round, Shape, Skeletal,
};
use glam::DVec3;
use std::sync::Arc;

/// Keys of how a field falls, of all skeletons.
const FALL: [&str; 5] = ["radius", "surface_radius", "falloff", "sharpness", "weight"];
/// Most points of a list.
const MOST_POINTS: usize = 1 << 16;
/// a of a Gaussian and k of a Cauchy kernel where nothing is said.
const SHARPNESS: f64 = 4.0;

/// How a field falls, as written.
struct Fall {
    reach: [f64; 2],
    how: How,
    weight: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum How {
    Falloff(Falloff),
    Distance,
    Ramp,
}

/// The node, where the kind is one of these.
pub(super) fn read(kind: &str, item: &Item<'_>, context: &mut Context<'_>) -> Result<Option<Node>> {
    let with = |own: &[&'static str]| own.iter().chain(&FALL).copied().collect::<Vec<_>>();
    Ok(Some(match kind {
        "point" => {
            let section = item.section(&with(&["centre"]))?;
            let shape = Shape::Point(place(&section, item, "centre")?);
            skeleton(&section, item, shape, context)?
        }
        "points" => return points(item, context).map(Some),
        "segment" => {
            let section = item.section(&with(&["from", "to"]))?;
            let ends = [place(&section, item, "from")?, place(&section, item, "to")?];
            check_apart(item, &ends)?;
            skeleton(&section, item, Shape::Segment(ends), context)?
        }
        "polyline" => {
            let section = item.section(&with(&["points", "closed"]))?;
            let mut list = corners(&section, item, 2)?;
            if flag(&section, "closed")? {
                list.push(list[0]);
            }
            check_apart(item, &list)?;
            skeleton(&section, item, Shape::Polyline(list), context)?
        }
        "polygon" | "triangle" => {
            let section = item.section(&with(&["points"]))?;
            let list = corners(&section, item, 3)?;
            if kind == "triangle" && list.len() != 3 {
                return Err(item.refuse("three points", "write [model.polygon.NAME] for more"));
            }
            let normal = plane_of(item, &list)?;
            skeleton(&section, item, Shape::Polygon(list, normal), context)?
        }
        "disc" | "circle" | "torus" => {
            let own = if kind == "disc" { "disc_radius" } else { "ring_radius" };
            let section = item.section(&with(&["centre", "normal", own]))?;
            let radius = positive(&section, item, own)?;
            let round = Round { centre: place(&section, item, "centre")?, normal: normal(&section, item)?, radius };
            let shape = if kind == "disc" { Shape::Disc(round) } else { Shape::Circle(round) };
            skeleton(&section, item, shape, context)?
        }
        "box" => {
            let section = item.section(&with(&["centre", "size"]))?;
            let size = place(&section, item, "size")?;
            if size.min_element() <= 0.0 {
                return Err(item.refuse("three positive sides", "write size = [1, 2, 0.5]"));
            }
            let shape = Shape::Box(place(&section, item, "centre")?, 0.5 * size);
            skeleton(&section, item, shape, context)?
        }
        "plane" => {
            let section = item.section(&with(&["point", "normal"]))?;
            let shape = Shape::HalfSpace(place(&section, item, "point")?, normal(&section, item)?);
            skeleton(&section, item, shape, context)?
        }
        "mesh" => mesh(item, &with(&["file", "sign", "scale", "rotate", "translate"]), context)?,
        "convolution" => convolution(item)?,
        "volume" => sampled::volume(item, context)?,
        "rbf" => rbf(item, context)?,
        "formula" => formula(item)?,
        _ => return Ok(None),
    }))
}

fn place(section: &Section<'_>, item: &Item<'_>, key: &str) -> Result<DVec3> {
    let value = required(section, item, key, &format!("write {key} = [0, 0, 0]"))?;
    let place = vector(&value)?;
    // Squares of squares stay finite.
    if place.abs().max_element() < 1e15 {
        Ok(place)
    } else {
        Err(value.refuse("coordinates below 1e15", "use another unit"))
    }
}

fn positive(section: &Section<'_>, item: &Item<'_>, key: &str) -> Result<f64> {
    let value = required(section, item, key, &format!("write {key} = 0.5"))?;
    number_above(&value)
}

/// A number above 0 of a magnitude whose powers are finite.
pub(super) fn number_above(item: &Item<'_>) -> Result<f64> {
    let value = item.number()?;
    if (1e-15..1e15).contains(&value) { Ok(value) } else { Err(item.refuse("a positive number", "such as 0.5")) }
}

fn flag(section: &Section<'_>, key: &str) -> Result<bool> {
    section.get(key).map_or(Ok(false), |item| item.boolean())
}

fn normal(section: &Section<'_>, item: &Item<'_>) -> Result<DVec3> {
    let value = required(section, item, "normal", "write normal = [0, 0, 1]")?;
    vector(&value)?.try_normalize().ok_or_else(|| value.refuse("a direction other than 0", "write [0, 0, 1]"))
}

fn corners(section: &Section<'_>, item: &Item<'_>, least: usize) -> Result<Vec<DVec3>> {
    let value = required(section, item, "points", "write points = [[0, 0, 0], [1, 0, 0]]")?;
    let list = list_of_points(&value)?;
    if list.len() < least {
        return Err(value.refuse(format!("at least {least} points (found {})", list.len()), "add some"));
    }
    Ok(list)
}

fn list_of_points(value: &Item<'_>) -> Result<Vec<DVec3>> {
    let refuse = || value.refuse("a list of points", "write [[0, 0, 0], [1, 0, 0]]");
    let list = value.list().ok_or_else(refuse)?;
    if list.len() > MOST_POINTS {
        return Err(value.refuse(format!("at most {MOST_POINTS} points (found {})", list.len()), "leave some out"));
    }
    list.iter().map(vector).collect()
}

fn check_apart(item: &Item<'_>, points: &[DVec3]) -> Result<()> {
    match points.windows(2).find(|w| (w[1] - w[0]).length_squared() < 1e-30) {
        None => Ok(()),
        Some(w) => Err(item.refuse(
            format!("neighbouring points that differ; two are at [{}, {}, {}]", w[0].x, w[0].y, w[0].z),
            "take one out; a point alone is [model.point.NAME]",
        )),
    }
}

/// The normal of a flat polygon.
fn plane_of(item: &Item<'_>, points: &[DVec3]) -> Result<DVec3> {
    let mut area = DVec3::ZERO;
    for i in 0..points.len() {
        area += (points[i] - points[0]).cross(points[(i + 1) % points.len()] - points[0]);
    }
    let size = points.iter().map(|p| (*p - points[0]).length()).fold(0.0, f64::max);
    let normal = area.try_normalize().filter(|_| area.length() > 1e-12 * size * size);
    let normal = normal.ok_or_else(|| item.refuse("points that span an area", "these lie on a line"))?;
    match points.iter().any(|p| (*p - points[0]).dot(normal).abs() > 1e-6 * size) {
        true => Err(item.refuse("points in one plane", "split the polygon into triangles")),
        false => Ok(normal),
    }
}

fn fall(section: &Section<'_>, item: &Item<'_>, shape: &Shape, context: &Context<'_>) -> Result<Fall> {
    let is_body = matches!(shape, Shape::Box(..) | Shape::HalfSpace(..) | Shape::Mesh(_));
    let usual = match shape {
        Shape::Mesh(_) => "distance",
        Shape::HalfSpace(..) => "density",
        _ => "soft",
    };
    let word = match section.get("falloff") {
        Some(item) => item.word(&["soft", "metaball", "wyvill", "gaussian", "distance", "density"])?,
        None => usual,
    };
    let sharpness = section.get("sharpness").map(|item| number_above(&item)).transpose()?;
    if let (Some(given), true) = (section.get("sharpness"), word != "gaussian") {
        return Err(given.refuse("falloff = \"gaussian\" beside it", "take it out"));
    }
    let how = match word {
        "metaball" => How::Falloff(Falloff::Metaball),
        "wyvill" => How::Falloff(Falloff::Wyvill),
        "gaussian" => How::Falloff(Falloff::Gaussian(sharpness.unwrap_or(SHARPNESS))),
        "distance" => How::Distance,
        "density" => How::Ramp,
        _ => How::Falloff(Falloff::Soft),
    };
    let weight = match section.get("weight") {
        Some(item) => {
            let weight = item.number()?;
            if weight == 0.0 || weight.abs() > 1e15 {
                return Err(item.refuse("a number other than 0", "negative weights carve"));
            }
            weight
        }
        None => 1.0,
    };
    let reach = reach(section, item, shape, how, weight, is_body, context)?;
    Ok(Fall { reach, how, weight })
}

fn reach(
    section: &Section<'_>,
    item: &Item<'_>,
    shape: &Shape,
    how: How,
    weight: f64,
    is_body: bool,
    context: &Context<'_>,
) -> Result<[f64; 2]> {
    let (given, is_surface) = match (section.get("radius"), section.get("surface_radius")) {
        (Some(_), Some(both)) => return Err(both.refuse("either radius or surface_radius", "take one out")),
        (Some(given), None) => (given, false),
        (None, Some(given)) => (given, true),
        (None, None) => match how {
            How::Distance if is_body => return Ok([0.0; 2]),
            // Qiu et al. 2007: two of the diagonals of a cubic voxel.
            How::Ramp if matches!(shape, Shape::Mesh(_)) => return Ok([2.0 * 3f64.sqrt() * context.voxel; 2]),
            _ => {
                let remedy =
                    "write radius = 1 (the reach, where the field ends) or surface_radius = 0.5 (of the surface)";
                return Err(item.refuse("the key `radius` or `surface_radius`", remedy));
            }
        },
    };
    let of = |value: &Item<'_>| -> Result<f64> {
        let radius = if how == How::Distance && is_body { value.number()? } else { number_above(value)? };
        if !is_surface {
            return Ok(radius);
        }
        match how {
            How::Distance => Ok(radius + context.iso),
            How::Ramp => {
                Err(value.refuse("radius: a density is ½ at the surface", "write radius, the half width of the ramp"))
            }
            How::Falloff(falloff) => falloff.radius_at(context.iso / weight).map(|r| radius / r).ok_or_else(|| {
                let expected = format!("radius: this field never is {} at a distance", context.iso);
                value.refuse(expected, "write radius, where the field ends")
            }),
        }
    };
    match (given.list(), shape) {
        (Some(list), Shape::Segment(_)) if list.len() == 2 && matches!(how, How::Falloff(_)) => {
            Ok([of(&list[0])?, of(&list[1])?])
        }
        (Some(_), _) => Err(given.refuse("one number; two are for a segment with a fall-off", "write radius = 1")),
        (None, _) => of(&given).map(|r| [r; 2]),
    }
}

fn skeleton(section: &Section<'_>, item: &Item<'_>, shape: Shape, context: &mut Context<'_>) -> Result<Node> {
    let fall = fall(section, item, &shape, context)?;
    Ok(made(shape, &fall))
}

fn made(shape: Shape, fall: &Fall) -> Node {
    let weighted = |leaf: Leaf| match fall.weight {
        1.0 => Node::leaf(leaf),
        weight => Node::of(Op::Weight(weight), vec![Node::leaf(leaf)]),
    };
    match fall.how {
        How::Falloff(falloff) => {
            Node::leaf(Leaf::Skeletal(Skeletal { shape, reach: fall.reach, falloff, weight: fall.weight }))
        }
        How::Distance => weighted(Leaf::Distance(shape, fall.reach[0])),
        How::Ramp => weighted(Leaf::Ramp(shape, fall.reach[0])),
    }
}

/// One point an atom, or one a point of a list, all blended.
fn points(item: &Item<'_>, context: &mut Context<'_>) -> Result<Node> {
    let own = ["file", "at", "radii", "ricci"];
    let section = item.section(&own.iter().chain(&FALL).copied().collect::<Vec<_>>())?;
    let op = match section.get("ricci") {
        Some(n) => Op::Ricci(exponent(&n)?),
        None => Op::Sum,
    };
    let radii = section.get("radii");
    let file = section.get("file");
    let (places, of_elements) = match (&file, section.get("at")) {
        (Some(file), None) => {
            let bytes = context.files.bytes(file.text()?)?;
            let atoms = molecule::read(&bytes).map_err(|e| e.in_file(file.text().unwrap_or_default()))?;
            (atoms.iter().map(|a| a.at).collect::<Vec<_>>(), atoms)
        }
        (None, Some(at)) => (list_of_points(&at)?, Vec::new()),
        _ => return Err(item.refuse("either `file` or `at`", "write file = \"molecule.xyz\" or at = [[0, 0, 0]]")),
    };
    if places.is_empty() {
        return Err(item.refuse("at least one point", "this is empty"));
    }
    let Some(radii) = radii else {
        let fall = fall(&section, item, &Shape::Point(places[0]), context)?;
        return Ok(Node::of(op, places.iter().map(|p| made(Shape::Point(*p), &fall)).collect()));
    };
    if section.get("radius").or(section.get("surface_radius")).is_some() {
        return Err(radii.refuse("either radii or radius", "take one out"));
    }
    let each = match (radii.as_text(), radii.list()) {
        (Some("vdw"), _) if !of_elements.is_empty() => {
            let of = |atom: &molecule::Atom| {
                molecule::van_der_waals(&atom.element).ok_or_else(|| {
                    let expected = format!("elements with a known radius; the file has `{}`", atom.element);
                    radii.refuse(expected, "write radii = 1.7, or a list of numbers")
                })
            };
            of_elements.iter().map(of).collect::<Result<Vec<_>>>()?
        }
        (_, Some(list)) if list.len() == places.len() => list.iter().map(number_above).collect::<Result<Vec<_>>>()?,
        (None, None) => vec![number_above(&radii)?; places.len()],
        _ => {
            let expected = format!("\"vdw\" (with a file), a number, or {} numbers", places.len());
            return Err(radii.refuse(expected, "radii are those of the surface of each alone"));
        }
    };
    let falloff = match section.get("falloff") {
        Some(item) => match item.word(&["soft", "metaball", "wyvill", "gaussian"])? {
            "metaball" => Falloff::Metaball,
            "wyvill" => Falloff::Wyvill,
            "gaussian" => Falloff::Gaussian(section.get("sharpness").map_or(Ok(SHARPNESS), |s| number_above(&s))?),
            _ => Falloff::Soft,
        },
        None => Falloff::Soft,
    };
    let weight = section.get("weight").map_or(Ok(1.0), |w| number_above(&w))?;
    let part = falloff.radius_at(context.iso / weight).ok_or_else(|| {
        radii.refuse(format!("a field that is {} at a distance", context.iso), "write radius, where the field ends")
    })?;
    let node = |(p, r): (&DVec3, f64)| {
        made(Shape::Point(*p), &Fall { reach: [r / part; 2], how: How::Falloff(falloff), weight })
    };
    Ok(Node::of(op, places.iter().zip(each).map(node).collect()))
}

fn mesh(item: &Item<'_>, keys: &[&str], context: &mut Context<'_>) -> Result<Node> {
    let section = item.section(keys)?;
    let file = required(&section, item, "file", "write file = \"part.stl\"")?;
    let winding = match section.get("sign") {
        Some(item) => item.word(&["normals", "winding"])? == "winding",
        None => false,
    };
    let translate = section.get("translate").map_or(Ok(DVec3::ZERO), |t| vector(&t))?;
    let map = Affine::new(rotation(&section)? * scale(&section)?, translate);
    let map = map.ok_or_else(|| item.refuse("a map with an inverse", "correct scale, rotate or translate"))?;
    let mesh = context.files.mesh(file.text()?)?;
    let positions: Vec<DVec3> = mesh.positions.iter().map(|p| map.point(*p)).collect();
    let distance = MeshDistance::new(&positions, &mesh.triangles, winding).map_err(|e| at_file(&file, e))?;
    skeleton(&section, item, Shape::Mesh(Arc::new(distance)), context)
}

fn convolution(item: &Item<'_>) -> Result<Node> {
    let section = item.section(&["points", "closed", "filled", "arc", "kernel", "sharpness", "radius", "weight"])?;
    let reach = positive(&section, item, "radius")?;
    let sharpness = section.get("sharpness").map_or(Ok(SHARPNESS), |s| number_above(&s))?;
    let kernel = match section.get("kernel") {
        Some(item) => match item.word(&["wyvill", "gaussian", "cauchy"])? {
            "gaussian" => Kernel::Gaussian(sharpness),
            "cauchy" => Kernel::Cauchy(sharpness),
            _ => Kernel::Wyvill,
        },
        None => Kernel::Wyvill,
    };
    let weight = section.get("weight").map_or(Ok(1.0), |w| number_above(&w))?;
    let leaf = |ends: [DVec3; 2], norm: f64| {
        Node::leaf(Leaf::Convolution(Convolution { ends, kernel, reach, norm: weight * norm }))
    };
    if let Some(arc) = section.get("arc") {
        if section.get("points").is_some() {
            return Err(arc.refuse("either points or an arc", "take one out"));
        }
        let norm = kernel.norm_of_line(reach);
        return Ok(Node::of(Op::Sum, pieces_of_arc(&arc, reach)?.into_iter().map(|ends| leaf(ends, norm)).collect()));
    }
    let mut list = corners(&section, item, 2)?;
    if flag(&section, "filled")? {
        let [a, b, c] = list[..] else {
            return Err(item.refuse("three points, where filled", "fill several triangles"));
        };
        plane_of(item, &list)?;
        let norm = kernel.norm_of_plane(reach);
        let lines = lines_of_triangle([a, b, c], gauss(16).len());
        // At the tip of the triangle a line has no length.
        let long = lines.into_iter().filter(|(ends, _)| (ends[1] - ends[0]).length_squared() > 1e-30);
        return Ok(Node::of(Op::Sum, long.map(|(ends, w)| leaf(ends, norm * w)).collect()));
    }
    if flag(&section, "closed")? {
        list.push(list[0]);
    }
    check_apart(item, &list)?;
    let norm = kernel.norm_of_line(reach);
    Ok(Node::of(Op::Sum, list.windows(2).map(|w| leaf([w[0], w[1]], norm)).collect()))
}

/// An arc as segments of at most a quarter of the reach.
fn pieces_of_arc(item: &Item<'_>, reach: f64) -> Result<Vec<[DVec3; 2]>> {
    let section = item.section(&["centre", "normal", "from", "angle"])?;
    let (centre, normal) = (place(&section, item, "centre")?, normal(&section, item)?);
    let from = place(&section, item, "from")? - centre;
    let degrees = required(&section, item, "angle", "write angle = 180, in degrees")?;
    let angle = degrees.number()?.to_radians();
    let radius = from.length();
    let is_plane = from.dot(normal).abs() <= 1e-6 * radius && radius > 0.0;
    if !is_plane || angle == 0.0 || angle.abs() > std::f64::consts::TAU + 1e-9 {
        let expected = "a start beside the axis, at the height of the centre, and an angle up to 360";
        return Err(
            item.refuse(expected, "write arc = { centre = [0,0,0], normal = [0,0,1], from = [1,0,0], angle = 180 }")
        );
    }
    let count = ((angle.abs() * radius / (0.25 * reach)).ceil() as usize).max(8);
    if count > MOST_POINTS {
        return Err(item.refuse("an arc of fewer pieces", "a larger radius makes fewer"));
    }
    let at = |i: usize| {
        let (sine, cosine) = libm::sincos(angle * i as f64 / count as f64);
        centre + from * cosine + normal.cross(from) * sine
    };
    Ok((0..count).map(|i| [at(i), at(i + 1)]).collect())
}

fn rbf(item: &Item<'_>, context: &mut Context<'_>) -> Result<Node> {
    let keys = ["points", "file", "normals", "offset", "kernel", "reach", "smoothing"];
    let section = item.section(&keys)?;
    let (points, normals) = match (section.get("points"), section.get("file")) {
        (Some(points), None) => {
            let normals = section.get("normals").map(|n| list_of_points(&n)).transpose()?.unwrap_or_default();
            (list_of_points(&points)?, normals)
        }
        (None, Some(file)) => {
            // Vertices of a mesh, with the normals of its triangles around them.
            let mesh = context.files.mesh(file.text()?)?;
            let mut normals = vec![DVec3::ZERO; mesh.positions.len()];
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                t.iter().for_each(|i| normals[*i as usize] += (b - a).cross(c - a));
            }
            (mesh.positions, normals)
        }
        _ => return Err(item.refuse("either `points` or `file`", "write points = [[…]] with normals = [[…]]")),
    };
    if normals.len() != points.len() {
        let expected = format!("normals, one a point: {} (found {})", points.len(), normals.len());
        return Err(item.refuse(expected, "they point out of the solid"));
    }
    let all = points.iter().fold(Bounds::EMPTY, |all, p| all.including(*p));
    let offset = match section.get("offset") {
        Some(item) => number_above(&item)?,
        None => 0.02 * all.size().length(),
    };
    let radial = match section.get("kernel") {
        Some(word) => match word.word(&["cubic", "linear", "thin-plate", "wendland"])? {
            "linear" => Radial::Linear,
            "thin-plate" => {
                context.notes.push(
                    "r² ln r is the thin plate of the plane, not of space: \"cubic\" has the least energy there".into(),
                );
                Radial::ThinPlate
            }
            "wendland" => {
                context.notes.push("Wendland's function adds false sheets at the rim of its support".into());
                Radial::Wendland(positive(&section, item, "reach")?)
            }
            _ => Radial::Cubic,
        },
        None => Radial::Cubic,
    };
    let smoothing = match section.get("smoothing") {
        Some(item) => {
            Some(item.number()?).filter(|s| *s >= 0.0).ok_or_else(|| item.refuse("0 or more", "0 meets every point"))?
        }
        None => 0.0,
    };
    let mut conditions = Vec::new();
    for (p, n) in points.iter().zip(&normals) {
        conditions.push((*p, 0.0));
        if let Some(n) = n.try_normalize() {
            conditions.push((*p + offset * n, -offset));
            conditions.push((*p - offset * n, offset));
        }
    }
    let rbf = Rbf::through(&conditions, radial, smoothing).map_err(|e| item.refuse(e.to_string(), "see the points"))?;
    context.notes.push(format!("rbf through {} centres, condition number {:.1e}", conditions.len(), rbf.condition));
    let iso = context.iso;
    Ok(Node::of(Op::Offset(iso), vec![Node::leaf(Leaf::Rbf(Arc::new(rbf)))]))
}

fn formula(item: &Item<'_>) -> Result<Node> {
    let section = item.section(&["f", "parameters"])?;
    let text = required(&section, item, "f", "write f = \"1 - x^2 - y^2 - z^2\"")?;
    let mut parameters = Vec::new();
    if let Some(table) = section.get("parameters") {
        let entries = table.entries().ok_or_else(|| table.refuse("a table", "write parameters = { r = 0.1 }"))?;
        for (name, value) in entries {
            if ["x", "y", "z", "pi"].contains(&name.as_str()) {
                return Err(value.refuse("names other than x, y, z and pi", "give it another name"));
            }
            parameters.push((name, value.number()?));
        }
    }
    let formula = Formula::parse(text.text()?, &parameters).map_err(|wrong| {
        text.refuse(
            format!("{} (found {})", wrong.expected, wrong.found),
            "operators are + - * / ^, functions have parentheses",
        )
    })?;
    Ok(Node::leaf(Leaf::Formula(Arc::new(formula))))
}
