//! What is wrong or unusual in a store, every checksum verified. Damage is a finding here and an
//! error elsewhere: a bake or a relight refuses the file that is damaged, this counts them all.
//!
//! | topic | what is counted |
//! |---|---|
//! | `damaged volume` | the copy of the volume, or the file that is named, that cannot be read or holds other samples |
//! | `samples elsewhere` | a store that names the file of its samples |
//! | `damaged chunks`, `torn chunks` | chunks with wrong checksums; chunks of two writings |
//! | `nothing baked`, `holes`, `missing bricks` | chunks and bricks that a lookup needs and are not there |
//! | `uneven` | chunks baked otherwise than most |
//! | `not finite` | texels with transfer that is not finite |
//! | `invalid texels`, `clamped texels` | texels without a level set; with one that was moved |
//! | `damaged metadata` | files that other programs read and that are not what the identity implies |
//! | `old format` | a store whose chunks do not say which store they belong to |
//! | `leftovers` | files of a run that was killed |
//! | `locked` | a lock file |

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::backing::Backing;
use super::chunk::examine::{ChunkState, Texels};
use super::{Baked, ChunkCheck, ChunkExtent, Holdings, Store, mend};
use crate::error::{Error, Result};
use crate::finding::Finding;
use crate::grid3;
use crate::transfer::Selection;
use crate::volume::Volume;
use std::path::Path;

/// Names of damaged files that one finding lists.
const MOST_NAMED: usize = 8;
/// Share of clamped texels worth a word; a store of all isosurfaces has more than one surface.
const MANY_CLAMPED: f64 = 0.25;

/// The state of a store.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// Chunks of the lattice.
    pub chunks: u64,
    /// Chunks that are there and sound.
    pub sound: u64,
    /// Bricks in these.
    pub bricks: u64,
    /// What the chunks say they hold.
    pub held: Holdings,
    /// What is unusual.
    pub findings: Vec<Finding>,
}

/// Reads all of a store. `selection` gives the texels that lookups on some isovalues of a volume read;
/// it decides what counts as a hole.
///
/// # Errors
/// When the system refuses to read a file; damage is a finding.
pub fn diagnose(store: &Store, selection: &dyn Fn(&Volume, &Holdings) -> Selection) -> Result<Diagnosis> {
    let mut findings = Vec::new();
    let volume = match store.volume_verified(true) {
        Ok(volume) => Some(volume),
        Err(error @ (Error::Format { .. } | Error::Argument { .. })) => {
            let handled = match store.samples_file() {
                None => {
                    "relight refuses this store; the bake that made it, run again, restores the samples from the volume's own file"
                }
                Some(_) => {
                    "relight looks at the length and the time of that file alone; a bake of a file of this name with these samples, or a \
                     copy of them, takes its place"
                }
            };
            findings.push(Finding::new("damaged volume", (1, 1, "volumes"), error.to_string(), handled).damage());
            None
        }
        Err(other) => return Err(other),
    };
    findings.extend(store.samples_file().map(|file| {
        let handled = "its bytes are compared here and by verify, elsewhere its length and time. Who gives the store away gives the file \
                       as well, or packs the store, which copies them";
        Finding::new("samples elsewhere", (1, 0, "items"), format!("samples are those of {}", file.display()), handled)
    }));
    // The extents first: only all together do they say what should be there.
    let mut tally = Tally::default();
    let extents = tally.readable(store);
    let held = Holdings::of(&extents);
    let selected = match &volume {
        Some(volume) if held.chunks > 0 => selection(volume, &held),
        _ => Selection::empty(store.layout.lattice),
    };
    tally.examine(store, &selected)?;
    tally.check_points(store)?;
    let mut extents = extents;
    let mut held = held;
    match store.surfaces() {
        Ok(isovalues) => {
            for isovalue in isovalues {
                let Some(surface) = tally.surface(store, isovalue)? else { continue };
                let more = tally.readable(&surface);
                tally.examine(&surface, &Selection::all(surface.layout.lattice))?;
                tally.check_points(&surface)?;
                surface.asked_damage()?.into_iter().for_each(|what| tally.add_damage(what));
                held.surfaces.extend((!more.is_empty()).then_some(isovalue));
                extents.extend(more);
            }
        }
        Err(error @ (Error::Format { .. } | Error::Limit { .. })) => tally.add_damage(error.to_string()),
        Err(other) => return Err(other),
    }
    let held = Holdings { in_texture: held.in_texture, surfaces: held.surfaces, ..Holdings::of(&extents) };
    let Tally { chunks, sound, texels, holes, torn, damaged, places } = tally;
    if damaged > 0 {
        let handled = "relight refuses such a chunk by name; the others stay usable, and a bake redoes what is damaged";
        findings.push(Finding::new("damaged chunks", (damaged, chunks, "chunks"), listed(&places), handled).damage());
    }
    if !torn.is_empty() {
        let handled = "a run was killed between two renames. The next bake takes such a chunk for not baked and \
                       writes it again; relight refuses it";
        let count = (torn.len() as u64, chunks, "chunks");
        findings.push(Finding::new("torn chunks", count, listed(&torn), handled).damage());
    }
    if extents.is_empty() && damaged == 0 && torn.is_empty() {
        let handled = "relight finds no transfer; bake with the same options to fill it";
        findings.push(Finding::new("nothing baked", (0, chunks, "chunks"), "no chunk is there", handled));
    }
    if holes > 0 {
        let handled = "vertices there cannot be lit, and relight counts them. Bake again with the same options: \
                       what is there is kept";
        findings.push(Finding::new(
            "holes",
            (holes, chunks, "chunks"),
            "chunks a lookup needs were not baked",
            handled,
        ));
    }
    findings.extend(metadata_findings(store)?);
    findings.extend(texel_findings(&texels));
    findings.extend(uneven(&extents));
    findings.extend(old_format(store));
    findings.extend(leftovers(store));
    Ok(Diagnosis { chunks, sound, bricks: texels.bricks, held, findings })
}

/// What the chunks of a store are found to be.
#[derive(Default)]
struct Tally {
    chunks: u64,
    sound: u64,
    texels: Texels,
    holes: u64,
    torn: Vec<String>,
    damaged: u64,
    places: Vec<String>,
}

impl Tally {
    fn add_damage(&mut self, what: String) {
        self.damaged += 1;
        self.places.push(what);
    }

    /// The records of the chunks of a texture or a surface that can be read.
    fn readable(&self, store: &Store) -> Vec<ChunkExtent> {
        let indices = grid3::all(store.layout.lattice.chunks());
        indices.filter_map(|i| store.chunk_extent(i).ok().flatten()).collect()
    }

    /// A surface with a mesh that is sound; what is damaged of it is counted.
    fn surface(&mut self, store: &Store, isovalue: f64) -> Result<Option<Store>> {
        let found = store.surface(isovalue).and_then(|surface| {
            surface.as_ref().map(Store::mesh).transpose()?;
            Ok(surface)
        });
        match found {
            Err(error @ (Error::Format { .. } | Error::Limit { .. })) => {
                self.add_damage(error.to_string());
                Ok(None)
            }
            found => found,
        }
    }

    /// Reads the check points of a texture or a surface.
    fn check_points(&mut self, store: &Store) -> Result<()> {
        let of_texture = || store.asked().map(|asked| asked.claims().iter().map(|claim| claim.isovalue).collect());
        let named: Vec<Option<f64>> = store.isovalue().map_or_else(of_texture, |isovalue| Ok(vec![Some(isovalue)]))?;
        for isovalue in named {
            match store.checks(isovalue) {
                Err(error @ (Error::Format { .. } | Error::Limit { .. })) => self.add_damage(error.to_string()),
                checks => drop(checks?),
            }
        }
        Ok(())
    }

    /// Reads every chunk of a texture or a surface, in all of its groups; `selected`: what should be baked.
    fn examine(&mut self, store: &Store, selected: &Selection) -> Result<()> {
        let groups = store.other_groups()?;
        let nothing = Selection::empty(store.layout.lattice);
        for index in grid3::all(store.layout.lattice.chunks()) {
            self.chunks += 1;
            let state = store.examine_chunk(index, selected)?;
            if !matches!(state, ChunkState::Absent) {
                for group in &groups {
                    match group.verify_one(index, &nothing)? {
                        ChunkCheck::Sound(_) => {}
                        ChunkCheck::Damaged(what) => self.add_damage(what),
                        ChunkCheck::Absent => {
                            let file = group.path().join(group.shard_key(0, index));
                            self.add_damage(format!("{}: missing", file.display()));
                        }
                    }
                }
            }
            match state {
                ChunkState::Absent => match store.orphan(index) {
                    Some(name) => {
                        self.torn.push(format!("{name}: missing, while other files of the chunk are there"));
                    }
                    None => self.holes += u64::from(selected.touches_chunk(index)),
                },
                ChunkState::Torn(name) => self.torn.push(name.display().to_string()),
                ChunkState::Damaged(errors) => {
                    self.damaged += 1;
                    self.places.extend(errors.into_iter().map(|e| e.to_string()));
                }
                ChunkState::Whole(found) => {
                    self.sound += 1;
                    self.texels.add(&found);
                }
            }
        }
        Ok(())
    }
}

/// Metadata that this program does not need to read the chunks, but others do.
fn metadata_findings(store: &Store) -> Result<Option<Finding>> {
    let mut wrong = mend::wrong_nodes(&store.backing, store.node(), &store.identity, &store.layout)?;
    if wrong.is_empty() {
        let copies = mend::wrong_copies(&store.backing, &store.volumes()?)?;
        wrong = copies.into_iter().map(|key| format!("zarr.json: its copy of the metadata of {key}")).collect();
    }
    wrong.extend(store.asked_damage()?);
    if wrong.is_empty() {
        return Ok(None);
    }
    let handled = "other programs may read wrong numbers; the bake that made the store, run again, writes it anew";
    Ok(Some(Finding::new("damaged metadata", (wrong.len() as u64, 0, "files"), listed(&wrong), handled).damage()))
}

/// The first few of many lines.
fn listed(lines: &[String]) -> String {
    let mut text = lines.iter().take(MOST_NAMED).cloned().collect::<Vec<_>>().join("\n");
    if lines.len() > MOST_NAMED {
        text.push_str(&format!("\nand {} more", lines.len() - MOST_NAMED));
    }
    text
}

fn texel_findings(texels: &Texels) -> Vec<Finding> {
    let mut found = Vec::new();
    let Texels { bricks, bricks_absent, selected, invalid, clamped, not_finite } = *texels;
    if bricks_absent > 0 {
        let handled = "vertices there cannot be lit, and relight counts them. Bake again with the same options";
        let count = (bricks_absent, bricks + bricks_absent, "bricks");
        found.push(Finding::new("missing bricks", count, "bricks a lookup needs are not in their chunk", handled));
    }
    if not_finite > 0 {
        let text = "valid texels with transfer that is NaN or infinite";
        let handled = "this is a bug of the bake that wrote them: please report it with the store's provenance";
        found.push(Finding::new("not finite", (not_finite, selected, "texels"), text, handled));
    }
    if invalid > 0 {
        let text = "texels without a level set: the neighbourhood is flat";
        let handled = "a lookup gives their weights to the valid ones of the eight around it, then to those of the \
                       surrounding 4³; relight counts such lookups";
        found.push(Finding::new("invalid texels", (invalid, selected, "texels"), text, handled));
    }
    if clamped as f64 > MANY_CLAMPED * selected as f64 {
        let text = "texels near the end of the range of their 3³ neighbours: edges as sharp as the voxels, or noise";
        let handled = "they were baked for an isovalue clamped to the inner 60 % of that range";
        found.push(Finding::new("clamped texels", (clamped, selected, "texels"), text, handled));
    }
    found
}

/// Chunks in which some isosurface was baked otherwise than in most chunks that it crosses.
fn uneven(extents: &[ChunkExtent]) -> Option<Finding> {
    let mut kinds: Vec<(&Baked, u64)> = Vec::new();
    for claim in extents.iter().flat_map(ChunkExtent::claims) {
        match kinds.iter_mut().find(|(known, _)| *known == claim) {
            Some((_, n)) => *n += 1,
            None => kinds.push((claim, 1)),
        }
    }
    let mut other = 0;
    for (claim, n) in &kinds {
        other += u64::from(kinds.iter().any(|(c, m)| c.isovalue == claim.isovalue && m > n)) * n;
    }
    (other > 0).then(|| {
        let rays = Holdings::of(extents).rays;
        let text =
            format!("isosurfaces with {} to {} rays, or other error targets, from chunk to chunk", rays[0], rays[1]);
        let handled = "each chunk says how far it was baked, and lookups mix them: noise and coverage differ from \
                       place to place. One bake with the options wanted brings the rest up to it";
        Finding::new("uneven", (other, extents.len() as u64, "chunks"), text, handled)
    })
}

/// A store from before chunks were stamped with its identity.
fn old_format(store: &Store) -> Option<Finding> {
    let version = store.identity.format_version;
    (version < super::identity::STAMPED_VERSION).then(|| {
        let text = format!("format {version}: a whole chunk of another store would not be noticed in it");
        let handled =
            format!("it is read as it is; `isolume merge {} -o NEW.isolume` stamps it", store.path().display());
        Finding::new("old format", (1, 0, "items"), text, handled)
    })
}

/// What a killed run left.
fn leftovers(store: &Store) -> Vec<Finding> {
    let Backing::Directory(root) = &store.backing else { return Vec::new() };
    let root = root.path();
    let mut found = Vec::new();
    let mut partial = 0;
    count_partial(root, &mut partial);
    if partial > 0 {
        let handled = "they are not part of the store and no reader looks at them; the next bake removes those that \
                       are in its way or an hour old";
        let text = format!("files named {}…: a run was killed while it wrote", crate::staging::PARTIAL);
        found.push(Finding::new("leftovers", (partial, 0, "files"), text, handled));
    }
    if let Ok(holder) = std::fs::read_to_string(root.join(".lock")) {
        let handled = "the lock is the system's, not the file: a bake that was killed holds it no more, and the next \
                       one starts all the same";
        let text = format!("a lock file of {}", holder.lines().next().unwrap_or("nobody").trim());
        found.push(Finding::new("locked", (1, 0, "files"), text, handled));
    }
    found
}

fn count_partial(directory: &Path, count: &mut u64) {
    // What cannot be listed is found when it is read.
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(crate::staging::PARTIAL) {
            *count += 1;
        } else if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            count_partial(&entry.path(), count);
        }
    }
}
