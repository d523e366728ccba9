//! The section `[model]`: an implicit model, node by node, as `[model.KIND.NAME]`. The table of kinds with their keys is in
//! `examples/models/README.md`.

mod leaves;
mod molecule;
mod operators;
mod sampled;

#[cfg(test)]
mod tests;

use super::read::{Item, Section, Source};
use super::surroundings::{required, vector};
use super::{axis, side};
use crate::error::{Error, Result};
use crate::geom::{Bounds, Up};
use crate::model::tree::{DEEPEST, MOST_NODES};
use crate::model::{Node, Tree};
use crate::scene::geometry::TriangleMesh;
use crate::scene::nearest;
use crate::volume::{Choice, Solid, Volume};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use toml::de::DeTable;

/// Samples along the longest side where neither the name nor the model says.
pub const DEFAULT_SAMPLES: usize = 128;
/// Most samples along a side.
pub const MOST_SAMPLES: usize = 4096;

const SETTINGS: [&str; 4] = ["bounds", "isovalue", "root", "samples"];
const KINDS: [&str; 35] = [
    "point",
    "points",
    "segment",
    "polyline",
    "polygon",
    "triangle",
    "disc",
    "circle",
    "torus",
    "box",
    "plane",
    "mesh",
    "volume",
    "convolution",
    "rbf",
    "formula",
    "blend",
    "sum",
    "union",
    "intersection",
    "difference",
    "pasko",
    "affine",
    "instance",
    "repeat",
    "twist",
    "taper",
    "bend",
    "contact",
    "cache",
    "round",
    "offset",
    "shell",
    "weight",
    "invert",
];

/// Files that a model names, read from beside it.
pub trait Files {
    /// A mesh.
    ///
    /// # Errors
    /// When it cannot be read.
    fn mesh(&mut self, name: &str) -> Result<TriangleMesh>;

    /// A volume, or what is chosen of a file that holds several.
    ///
    /// # Errors
    /// When it cannot be read.
    fn volume(&mut self, name: &str, choice: Choice) -> Result<Volume>;

    /// The bytes of a file.
    ///
    /// # Errors
    /// When it cannot be read.
    fn bytes(&mut self, name: &str) -> Result<Vec<u8>>;
}

/// A model that can be sampled.
#[derive(Clone, Debug)]
pub struct ModelDescription {
    /// What is sampled.
    pub tree: Arc<Tree>,
    /// The box.
    pub bounds: Bounds,
    /// The isovalue at which nodes mean what they say.
    pub isovalue: f64,
    /// Samples along x, y, z.
    pub dims: [usize; 3],
    /// What the user should know of it.
    pub notes: Vec<String>,
    /// The world axis that points up, if the file says.
    pub up: Option<Up>,
    /// The side that is matter, if the file says.
    pub solid: Option<Solid>,
}

/// How many samples a name asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// So many along the longest side.
    Longest(usize),
    /// So many along x, y, z.
    Exactly([usize; 3]),
}

/// What all nodes need.
struct Context<'a> {
    bounds: Bounds,
    iso: f64,
    /// The spacing of the samples.
    voxel: f64,
    files: &'a mut dyn Files,
    notes: Vec<String>,
}

/// A node as written.
struct Entry<'a> {
    kind: &'static str,
    item: Item<'a>,
}

/// Nodes on their way to a tree.
struct Reading<'a, 'f> {
    entries: BTreeMap<String, Entry<'a>>,
    made: BTreeMap<String, (Node, usize)>,
    open: Vec<String>,
    context: Context<'f>,
}

impl ModelDescription {
    /// Reads the `[model]` of a scene.
    ///
    /// # Errors
    /// When there is none, or it makes no sense; each names file and line.
    pub fn read(text: &str, file: &str, size: Option<Size>, files: &mut dyn Files) -> Result<Self> {
        let source = Source { file, text };
        let document = source.table()?;
        let all = Section::new(source, document.get_ref(), "", &super::KEYS)?;
        let Some(item) = all.get("model") else {
            let remedy = format!("write [model] into it, or give the scene itself: {file}");
            return Err(source.error(0, "no section [model]", "a model", remedy));
        };
        let known: Vec<&str> = SETTINGS.iter().chain(&KINDS).copied().collect();
        let section = item.section(&known)?;
        let bounds = bounds(&section, &item)?;
        let isovalue = match section.get("isovalue") {
            Some(item) => item.number()?,
            None => 0.5,
        };
        let dims = dims(&section, &bounds, size)?;
        let longest = (0..3).fold(0, |best, a| if dims[a] > dims[best] { a } else { best });
        let voxel = bounds.size()[longest] / (dims[longest] - 1) as f64;
        let entries = entries(&section)?;
        if entries.is_empty() {
            let remedy = "write [model.point.NAME], centre = [0, 0, 0], radius = 1";
            return Err(item.refuse("at least one node", remedy));
        }
        let context = Context { bounds, iso: isovalue, voxel, files, notes: Vec::new() };
        let mut reading = Reading { entries, made: BTreeMap::new(), open: Vec::new(), context };
        let root = reading.root(&section, &item)?;
        let (node, _) = reading.node(&root.0, root.1.as_ref())?;
        reading.refuse_unused(&root.0)?;
        let tree = Tree::new(node).map_err(|e| item.refuse(e.to_string(), "see examples/models"))?;
        let mut notes = reading.context.notes;
        if tree.is_for_one_isovalue() {
            notes.push(format!(
                "its nodes mean what they say at isovalue {isovalue} alone; other isosurfaces are legal"
            ));
        }
        let up = all.get("up").map(|item| axis(&item)).transpose()?;
        let solid = all.get("solid").map(|item| side(&item)).transpose()?;
        Ok(Self { tree: Arc::new(tree), bounds, isovalue, dims, notes, up, solid })
    }
}

/// The files that nodes of a model name; none of what is no TOML.
pub(crate) fn files_of_nodes(text: &str) -> Vec<String> {
    let Ok(document) = DeTable::parse(text) else { return Vec::new() };
    let model = document.get_ref().get("model").and_then(|model| model.get_ref().as_table());
    let kinds = model.into_iter().flat_map(|model| model.values()).filter_map(|kind| kind.get_ref().as_table());
    let nodes = kinds.flat_map(|kind| kind.values()).filter_map(|node| node.get_ref().as_table());
    let files = nodes.filter_map(|node| node.get("file")?.get_ref().as_str().map(String::from));
    files.collect()
}

/// The line of `[model]` in a scene, and the samples that it asks for: all that a scene must know of it.
pub(super) fn glance(all: &Section<'_>) -> Result<Option<(usize, usize)>> {
    let Some(item) = all.get("model") else { return Ok(None) };
    let known: Vec<&str> = SETTINGS.iter().chain(&KINDS).copied().collect();
    let section = item.section(&known)?;
    Ok(Some((item.line(), samples(&section)?)))
}

fn samples(section: &Section<'_>) -> Result<usize> {
    match section.get("samples") {
        Some(item) => Ok(item.integer(2..=MOST_SAMPLES as u64)? as usize),
        None => Ok(DEFAULT_SAMPLES),
    }
}

fn bounds(section: &Section<'_>, of: &Item<'_>) -> Result<Bounds> {
    let item = required(section, of, "bounds", "write bounds = [[-1, -1, -1], [1, 1, 1]]")?;
    let refuse = || item.refuse("two corners, the first below the second", "write [[-1, -1, -1], [1, 1, 1]]");
    let list = item.list().ok_or_else(refuse)?;
    let [low, high] = &list[..] else { return Err(refuse()) };
    let bounds = Bounds { min: vector(low)?, max: vector(high)? };
    let size = bounds.size();
    let is_box = size.min_element() > 0.0 && bounds.min.abs().max(bounds.max.abs()).max_element() < 1e15;
    // Thinner than a sample in any grid that is allowed.
    if is_box && size.min_element() * 1e6 > size.max_element() { Ok(bounds) } else { Err(refuse()) }
}

/// Cubic voxels, or nearly so where a side is no whole number of them.
fn dims(section: &Section<'_>, bounds: &Bounds, size: Option<Size>) -> Result<[usize; 3]> {
    let longest = match size {
        Some(Size::Exactly(dims)) => return Ok(dims),
        Some(Size::Longest(n)) => n,
        None => samples(section)?,
    };
    let sides = bounds.size();
    Ok((sides / sides.max_element() * (longest - 1) as f64).to_array().map(|v| (v.round() as usize).max(1) + 1))
}

fn entries<'a>(section: &Section<'a>) -> Result<BTreeMap<String, Entry<'a>>> {
    let mut entries: BTreeMap<String, Entry<'a>> = BTreeMap::new();
    for kind in KINDS {
        let Some(group) = section.get(kind) else { continue };
        let named = group.entries().ok_or_else(|| {
            group.refuse("nodes with a name", format!("write [model.{kind}.NAME] on a line of its own"))
        })?;
        for (name, item) in named {
            if let Some(other) = entries.get(&name) {
                let expected = format!("names that differ: {name} is also that of line {}", other.item.line());
                return Err(item.refuse(expected, "give one of them another name"));
            }
            if entries.len() >= MOST_NODES {
                return Err(
                    item.refuse(format!("at most {MOST_NODES} nodes"), "sample parts of the model with `cache`")
                );
            }
            entries.insert(name, Entry { kind, item });
        }
    }
    Ok(entries)
}

impl<'a> Reading<'a, '_> {
    /// The root: named, or the one node that no other uses.
    fn root(&self, section: &Section<'a>, model: &Item<'a>) -> Result<(String, Option<Item<'a>>)> {
        if let Some(item) = section.get("root") {
            return Ok((item.text()?.to_string(), Some(item)));
        }
        let mut used = BTreeSet::new();
        for entry in self.entries.values() {
            for child in entry.item.peek("of").iter().flat_map(|of| of.list().unwrap_or_else(|| vec![of.clone()])) {
                used.extend(child.as_text());
            }
        }
        let tops: Vec<&str> = self.entries.keys().map(String::as_str).filter(|name| !used.contains(name)).collect();
        match tops[..] {
            [one] => Ok((one.to_string(), None)),
            _ => {
                let found = match tops.len() {
                    0 => "none that no other uses".to_string(),
                    n => format!(
                        "{n} that no other uses: {}",
                        tops.iter().take(5).copied().collect::<Vec<_>>().join(", ")
                    ),
                };
                Err(model
                    .refuse(format!("one node at the top (found {found})"), "write root = \"NAME\", or blend them"))
            }
        }
    }

    /// The node with a name, and how many nodes it has; `by` is where it is used.
    fn node(&mut self, name: &str, by: Option<&Item<'a>>) -> Result<(Node, usize)> {
        if let Some(made) = self.made.get(name) {
            return Ok(made.clone());
        }
        let Some(entry) = self.entries.get(name) else {
            let near = nearest(name, self.entries.keys().map(String::as_str));
            let remedy =
                near.map_or("correct the name, or write the node".into(), |near| format!("did you mean {near}?"));
            let expected = "the name of a node of this model";
            return Err(match by {
                Some(item) => item.refuse(expected, remedy),
                None => Error::argument("model", name, expected, remedy),
            });
        };
        let (kind, item) = (entry.kind, entry.item.clone());
        if let Some(start) = self.open.iter().position(|open| open == name) {
            let around = self.open[start..].iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join(" → ");
            return Err(by
                .unwrap_or(&item)
                .refuse(format!("nodes that do not lead back to themselves: {around}"), "break the cycle"));
        }
        if self.open.len() >= DEEPEST {
            return Err(item.refuse(format!("at most {DEEPEST} nodes below each other"), "make the model flatter"));
        }
        self.open.push(name.to_string());
        let node = match leaves::read(kind, &item, &mut self.context)? {
            Some(leaf) => leaf,
            None => operators::read(kind, &item, self)?,
        };
        self.open.pop();
        let count = node.count();
        self.made.insert(name.to_string(), (node.clone(), count));
        Ok((node, count))
    }

    /// The nodes of the key `of`: at least `least`, at most `most`.
    fn children(
        &mut self,
        section: &Section<'a>,
        item: &Item<'a>,
        count: std::ops::RangeInclusive<usize>,
    ) -> Result<Vec<Node>> {
        let of = required(section, item, "of", "write of = \"NAME\" or of = [\"NAME\", …]")?;
        let names = of.one_or_more()?;
        if !count.contains(&names.len()) {
            let expected = match (count.start(), count.end()) {
                (a, b) if a == b => format!("{a} of them"),
                (a, _) => format!("at least {a}"),
            };
            return Err(of.refuse(format!("names of nodes, {expected} (found {})", names.len()), "name them in `of`"));
        }
        let mut nodes = Vec::new();
        let mut total = 0usize;
        for name in &names {
            let (node, size) = self.node(name.text()?, Some(name))?;
            total += size;
            self.check_count(total, name)?;
            nodes.push(node);
        }
        Ok(nodes)
    }

    fn check_count(&self, count: usize, at: &Item<'_>) -> Result<()> {
        if count <= MOST_NODES {
            return Ok(());
        }
        let expected = format!("at most {MOST_NODES} nodes, counted wherever they are used");
        Err(at.refuse(expected, "use fewer copies, or sample the part with `cache`"))
    }

    fn refuse_unused(&self, root: &str) -> Result<()> {
        let unused = self.entries.iter().filter(|(name, _)| !self.made.contains_key(*name));
        match unused.min_by_key(|(_, entry)| entry.item.line()) {
            None => Ok(()),
            Some((name, entry)) => {
                let expected = format!("nodes that the root `{root}` is made of; nothing uses `{name}`");
                Err(entry.item.refuse(expected, format!("name {name} in the `of` of another node, or take it out")))
            }
        }
    }
}
