//! Packing a store: a copy whose transfer takes a fraction of the space, with an error that is stated.
//!
//! The copy is a store that everything reads and nothing bakes into, so nothing mends it either: samples that stay in a file of their own are
//! copied into it. Samples, meshes, check points and what was asked are copied byte for byte; the chunks of each group, of the texture and of each surface, are packed by a step of the group's own ([`super::packed`]).

use super::backing::{Backing, Directory};
use super::metadata::{arrays, arrays_of, required_json, sealed, unsealed};
use super::packed::{self, Loss, PACKED, Packing};
use super::surface::SURFACES;
use super::{Replacement, Store, StoreOptions};
use super::{volume, zarr};
use crate::error::{Error, Result};
use crate::file::size_on_disk;
use crate::grid3;
use crate::staging;
use crate::transfer::{Brick, Group};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

/// Chunks that the step is found on; the error is then measured on all.
const SAMPLED: usize = 24;
/// Rounds in which the step is adapted; three bring it within 1 % on what was measured.
const ROUNDS: usize = 6;
/// How far above what is asked the measured error may lie.
const SLACK: f64 = 1.005;
/// How far below it may lie, where a larger step would take less space.
const NEAR: f64 = 0.995;

/// How much packing may lose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PackError {
    /// Half of the noise: as much as the texels' own standard errors say.
    HalfOfNoise,
    /// Root mean square of the error of transfer over that of transfer, layers weighted as at the albedo 0.7.
    Relative(f64),
}

impl FromStr for PackError {
    /// What to give instead.
    type Err = String;

    /// Reads auto, or a share such as 0.5%.
    fn from_str(word: &str) -> std::result::Result<Self, String> {
        if word == "auto" {
            return Ok(PackError::HalfOfNoise);
        }
        let (number, unit) = word.strip_suffix('%').map_or((word, 1.0), |number| (number, 100.0));
        match number.trim().parse::<f64>() {
            Ok(value) if value > 0.0 && value < unit => Ok(PackError::Relative(value / unit)),
            _ => Err("give auto, or a share above 0 and below 100 % such as 0.5%".into()),
        }
    }
}

/// A group that was packed.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedGroup {
    /// Its place in the store.
    pub place: String,
    /// Baked texels or vertices.
    pub texels: u64,
    /// How, and how well.
    pub packing: Packing,
    /// Noise of transfer by its standard errors, over transfer: what `measured` compares with.
    pub noise: f64,
    /// Bytes of coefficients, and of all else in the files of chunks.
    pub bytes: [u64; 2],
    /// The same before.
    pub bytes_before: [u64; 2],
}

/// What packing did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackReport {
    /// The groups, each texture before the surfaces.
    pub groups: Vec<PackedGroup>,
}

impl PackReport {
    /// Bytes a texel of coefficients and of all else, before and after.
    pub fn bytes_a_texel(&self) -> [[f64; 2]; 2] {
        let texels = self.groups.iter().map(|g| g.texels).sum::<u64>().max(1) as f64;
        let sum = |of: fn(&PackedGroup) -> [u64; 2]| {
            [0, 1].map(|part| self.groups.iter().map(|g| of(g)[part]).sum::<u64>() as f64 / texels)
        };
        [sum(|g| g.bytes_before), sum(|g| g.bytes)]
    }

    /// For programs; `store` is its name, with the bytes of the store before and after.
    pub fn to_json(&self, store: &str, [before, after]: [u64; 2]) -> Value {
        let group = |g: &PackedGroup| {
            json!({
                "place": g.place, "texels": g.texels, "packing": g.packing, "noise": g.noise,
                "transfer_bytes": g.bytes[0], "other_bytes": g.bytes[1],
                "transfer_bytes_before": g.bytes_before[0], "other_bytes_before": g.bytes_before[1],
            })
        };
        json!({
            "store": store,
            "groups": self.groups.iter().map(group).collect::<Vec<_>>(),
            "store_bytes": after, "store_bytes_before": before,
        })
    }
}

impl StoreOptions {
    /// Packs the store at `path` in its place; what was done, with the sizes before and after. `None` where it is packed already.
    ///
    /// # Errors
    /// As [`Self::pack`].
    #[doc(hidden)]
    pub fn pack_in_place(self, path: &Path, error: PackError) -> Result<Option<(PackReport, [u64; 2])>> {
        // Who names a file of samples in the bake has had it mapped there.
        let source = Store::open(path)?.map_samples(true);
        if source.packing().is_some() {
            return Ok(None);
        }
        let before = size_on_disk(path);
        let replacement = Replacement::begin(path)?;
        let (packed, report) = self.pack(&source, replacement.path(), error)?;
        drop((source, packed));
        replacement.commit()?;
        Ok(Some((report, [before, size_on_disk(path)])))
    }

    /// Makes a packed copy of a store at `path`, which appears when it is complete.
    ///
    /// # Errors
    /// When there is something at `path`, the store is packed already or of an older format, a chunk is damaged, the error asked for is
    /// not in (0, 1) or needs more steps than two bytes count, or the system refuses.
    pub fn pack(self, source: &Store, path: impl AsRef<Path>, error: PackError) -> Result<(Store, PackReport)> {
        let path = path.as_ref();
        if path.symlink_metadata().is_ok() {
            let remedy = "give another output with -o, or delete what is there";
            return Err(Error::argument("output", path.display(), "a path where nothing is yet", remedy));
        }
        if let PackError::Relative(asked) = error
            && !(asked > 0.0 && asked < 1.0)
        {
            return Err(Error::argument("error", asked, "a share of the transfer above 0 and below 1", "give 0.5%"));
        }
        let groups = packable(source)?;
        let failed = |e| Error::io(path, "create the store", e);
        let folder = staging::folder_of(path);
        let directory = staging::directory_in(folder).map_err(failed)?;
        let target = Backing::Directory(Directory::open(directory.path())?);
        let mut report = PackReport::default();
        for group in &groups {
            let packed = group.pack_into(&target, error)?;
            report.groups.push(packed);
        }
        copy_rest(source, &target, &groups, &report)?;
        if self.sync {
            staging::sync_tree(directory.path()).map_err(failed)?;
        }
        std::fs::rename(directory.path(), path).map_err(failed)?;
        let _ = directory.keep(); // It has moved: nothing to remove.
        if self.sync {
            staging::sync_directory(folder).map_err(failed)?;
        }
        Ok((Store::open(path)?, report))
    }
}

/// All groups of the volumes and surfaces of a store.
fn packable(source: &Store) -> Result<Vec<Store>> {
    let mut all = Vec::new();
    for name in source.volumes()? {
        let volume = source.of_volume(&name)?;
        if !volume.is_stamped() {
            let found = format!("{}, of format {}", source.path().display(), volume.identity().format_version);
            let remedy = "convert it first: isolume merge OLD.isolume -o NEW.isolume";
            return Err(Error::argument("store", found, "a store of the format of today", remedy));
        }
        volume.check_not_packed()?;
        let mut places = vec![volume.group(&Group::Environment)?];
        for isovalue in volume.surfaces()? {
            places.extend(volume.surface(isovalue)?);
        }
        for place in places {
            let groups = place.other_groups()?;
            all.push(place);
            all.extend(groups);
        }
    }
    Ok(all)
}

impl Store {
    /// Chunks that are there, x fastest.
    fn chunks_there(&self) -> Vec<[usize; 3]> {
        let all = grid3::all(self.layout.lattice.chunks());
        all.filter(|&chunk| self.backing.exists(&self.shard_key(0, chunk))).collect()
    }

    fn bricks_of(&self, chunk: [usize; 3]) -> Result<Vec<Option<Brick>>> {
        Ok(self.read_chunk(chunk)?.map(|(bricks, _)| bricks).unwrap_or_default())
    }

    /// What some chunks lose by a step, added in their order.
    fn loss(&self, chunks: &[[usize; 3]], step: Option<f64>) -> Result<Loss> {
        let of_chunk = |&chunk: &[usize; 3]| Loss::of(&self.bricks_of(chunk)?, &self.layout.layers, step);
        let all: Vec<Result<Loss>> = chunks.par_iter().with_max_len(1).map(of_chunk).collect();
        let mut sum = Loss::default();
        for loss in all {
            sum.add(&loss?);
        }
        Ok(sum)
    }

    /// The packing of its chunks, its loss, and what there is without one.
    fn packing_for(&self, chunks: &[[usize; 3]], error: PackError) -> Result<(Packing, Loss)> {
        let layers = &self.layout.layers;
        let every = chunks.len().div_ceil(SAMPLED).max(1);
        let sampled: Vec<[usize; 3]> = chunks.iter().copied().step_by(every).collect();
        let there = self.loss(&sampled, None)?;
        let asked = match error {
            PackError::Relative(asked) => asked,
            // Of a group without noise, such as one whose texels all have a closed form, a thousandth.
            PackError::HalfOfNoise if there.squares[0] > 0.0 => (there.noise / there.squares[0]).sqrt().max(2e-3) / 2.0,
            PackError::HalfOfNoise => 1e-3,
        };
        // White noise of a uniform step has the variance Δ²/12 in each number.
        let mean_square = there.squares[0] / (there.texels.max(1) as f64 * layers.coefficients() as f64);
        let mut step = asked * (12.0 * mean_square).sqrt();
        if !(step > 0.0 && step.is_finite()) {
            // Nothing, or nothing but 0, which any step keeps.
            step = 1.0;
        }
        // Small numbers become 0 with less error than that: the step may grow until the measured error is what was asked.
        for _ in 0..ROUNDS {
            let found = self.loss(&sampled, Some(step))?.relative();
            if found == 0.0 || (found / asked - 1.0).abs() < 0.005 {
                break;
            }
            step *= (asked / found).clamp(0.25, 4.0);
        }
        // The sample is a part: the same on all chunks, of which the last step that is good enough is taken.
        for round in 0..ROUNDS {
            let loss = self.loss(chunks, Some(step))?;
            let ratio = loss.relative() / asked;
            let is_near = ratio > NEAR && ratio <= SLACK || ratio == 0.0;
            if is_near || ratio <= SLACK && round + 1 >= ROUNDS / 2 {
                return Ok((loss.packing(layers, asked, step), loss));
            }
            step /= ratio;
        }
        let remedy = "allow a larger --error: numbers of 16 bits are rounded to 0.05 % themselves";
        Err(Error::argument("error", asked, "an error that packing can reach", remedy))
    }

    /// Packs all chunks into another directory, and writes the metadata of their arrays and of the group.
    fn pack_into(&self, target: &Backing, error: PackError) -> Result<PackedGroup> {
        let chunks = self.chunks_there();
        let (packing, loss) = self.packing_for(&chunks, error)?;
        let place = &self.env;
        let group = required_json(&self.backing, &format!("{place}/zarr.json"))?;
        put_json(target, place, &with_packing(group, &packing).map_err(|e| e.in_file(self.backing.name(place)))?)?;
        for (name, array) in arrays_of(&self.layout, Some(&packing)) {
            put_json(target, &format!("{place}/{name}"), &array.metadata(json!({})))?;
        }
        let write = |&chunk: &[usize; 3]| -> Result<[[u64; 2]; 2]> {
            let Some((bricks, extent)) = self.read_chunk(chunk)? else { return Ok([[0; 2]; 2]) };
            let files = packed::encode_chunk(&packing, &self.layout, &bricks)?;
            let record = self.record_of(chunk, &extent, bricks.iter().flatten().count(), &files);
            let linear = self.slot(chunk);
            let mut bytes = [0; 2];
            // The first array says that the chunk is there: it comes last.
            for (array, file) in files.iter().enumerate().rev() {
                let Some(file) = file else { continue };
                target.put(&packed::key(place, array, linear), false, file)?;
                bytes[usize::from(!matches!(PACKED[array], "low" | "high"))] += file.len() as u64;
            }
            target.put(&self.extent_key(chunk), false, format!("{record}\n").as_bytes())?;
            let length = |array: usize| self.backing.length(&self.shard_key(array, chunk)).unwrap_or(0);
            Ok([bytes, [length(0), (1..self.array_count()).map(length).sum()]])
        };
        let all: Vec<Result<[[u64; 2]; 2]>> = chunks.par_iter().with_max_len(1).map(write).collect();
        let (mut bytes, mut bytes_before) = ([0; 2], [0; 2]);
        for written in all {
            let [now, before] = written?;
            for part in 0..2 {
                bytes[part] += now[part];
                bytes_before[part] += before[part];
            }
        }
        let noise = if loss.squares[0] > 0.0 { (loss.noise / loss.squares[0]).sqrt() } else { 0.0 };
        Ok(PackedGroup { place: place.clone(), texels: loss.texels, packing, noise, bytes, bytes_before })
    }
}

/// The metadata of a group that says how it is packed.
fn with_packing(mut group: Value, packing: &Packing) -> Result<Value> {
    let mut attributes = unsealed(&group)?;
    attributes["packing"] = json!(packing);
    group["attributes"] = sealed(attributes);
    Ok(group)
}

fn put_json(target: &Backing, place: &str, value: &Value) -> Result<()> {
    target.put(&format!("{place}/zarr.json"), false, format!("{value:#}\n").as_bytes())
}

/// Copies samples that a store only names the file of; the metadata of their arrays.
fn copy_samples(source: &Store, target: &Backing) -> Result<BTreeMap<String, Value>> {
    let mut copied = BTreeMap::new();
    for name in source.volumes()? {
        let member = source.of_volume(&name)?;
        if member.samples_file().is_none() {
            continue;
        }
        let mut volume = member.volume_verified(true)?;
        volume.by_reference = false;
        let metadata = volume::metadata(&volume)?;
        put_json(target, &member.data, &metadata)?;
        volume::write(target, &member.data, &volume, false)?;
        copied.insert(member.data, metadata);
    }
    Ok(copied)
}

/// Copies what is not packed, and puts the metadata of all together in the root.
fn copy_rest(source: &Store, target: &Backing, groups: &[Store], report: &PackReport) -> Result<()> {
    let plain: Vec<&str> = groups.first().map(|g| arrays(&g.layout).map(|(name, _)| name).to_vec()).unwrap_or_default();
    // Of a packed group: its own metadata, its arrays, and the records of its chunks.
    let is_packed = |key: &str| {
        groups.iter().any(|group| {
            let Some(below) = key.strip_prefix(&group.env).and_then(|rest| rest.strip_prefix('/')) else {
                return false;
            };
            let first = below.split('/').next().unwrap_or_default();
            let is_record = below.starts_with("rays/") && below.ends_with(".json") && below != "rays/zarr.json";
            below == "zarr.json"
                || below.starts_with("rays/extent/")
                || plain.contains(&first) && !is_record && !below.ends_with(".bin")
        })
    };
    let copied = copy_samples(source, target)?;
    for key in source.backing.keys()? {
        let is_copied = key.strip_suffix("/zarr.json").is_some_and(|array| copied.contains_key(array));
        if key == "zarr.json" || is_packed(&key) || is_copied {
            continue;
        }
        let Some(bytes) = source.backing.bytes(&key)? else { continue };
        target.put(&key, false, &bytes)?;
    }
    let mut root = required_json(&source.backing, "zarr.json")?;
    let known = root["consolidated_metadata"]["metadata"].as_object().cloned().unwrap_or_default();
    let of_place: BTreeMap<&str, &Store> = groups.iter().map(|group| (group.env.as_str(), group)).collect();
    let mut nodes: Vec<(String, Value)> = Vec::new();
    for (key, value) in known {
        let value = copied.get(&key).cloned().unwrap_or(value);
        let above = key.rsplit_once('/').map_or("", |(above, _)| above);
        if of_place.contains_key(key.as_str()) {
            let stored = required_json(target, &format!("{key}/zarr.json"))?;
            let packing = report.groups.iter().find(|packed| packed.place == key).map(|packed| &packed.packing);
            let layout = of_place.get(key.as_str()).map(|group| &group.layout);
            nodes.push((key.clone(), stored));
            for (name, array) in layout.map(|layout| arrays_of(layout, packing)).unwrap_or_default() {
                nodes.push((format!("{key}/{name}"), array.metadata(json!({}))));
            }
        } else if !(of_place.contains_key(above) && plain.iter().any(|name| key.ends_with(&format!("/{name}")))) {
            nodes.push((key, value));
        }
    }
    zarr::consolidate(&mut root, &nodes, SURFACES);
    target.put("zarr.json", false, format!("{root:#}\n").as_bytes())
}
