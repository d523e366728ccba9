//! What a file is, and what is unusual about it.

use crate::error::{Error, Result};
use crate::file::{self, size_on_disk};
use crate::finding::Finding;
use crate::level;
use crate::probe::{self, Layout, Probe, ReadOptions, Report};
use crate::scene::{Member, VolumeOptions};
use crate::transfer::store::{self, Diagnosis, Store, complete, is_store};
use crate::volume::{self, Isovalue, field};
use serde_json::{Value, json};
use std::io::Read;
use std::path::Path;

/// What a file turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A volume file or a field.
    Volume,
    /// An environment image or a sky.
    Probe,
    /// A transfer store.
    Store,
}

/// What was looked at.
pub enum Looked {
    /// A volume, at an isosurface.
    Volume {
        /// The volume.
        member: Box<Member>,
        /// The isovalue, if there is one.
        isovalue: Option<f64>,
        /// Why that one.
        reason: Option<String>,
    },
    /// An environment.
    Probe(Box<(Probe, Report)>),
    /// A store; what is unusual of its first volume, and bytes on the disk.
    Store(Box<Store>, Box<Diagnosis>, u64),
}

/// A file and what is unusual about it.
pub struct Diagnosed {
    /// What it is.
    pub looked: Looked,
    /// What was found, of all volumes of a store.
    pub findings: Vec<Finding>,
}

impl Diagnosed {
    /// Looks at a file. What it is, is decided by its content.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of(argument: &str, options: &VolumeOptions, isovalue: Isovalue, layout: Option<Layout>) -> Result<Self> {
        match kind_of(argument)? {
            Kind::Volume => Self::of_volume(Member::open(argument, options)?, isovalue),
            Kind::Probe => {
                let probe = match probe::by_name(argument)? {
                    Some(probe) => probe,
                    // Negative pixels are set to 0 with a note that counts them, as for relighting.
                    None => probe::open(argument, &ReadOptions { layout, ..ReadOptions::default() })?,
                };
                let (report, findings) = (probe::report(&probe, 5), probe::diagnose(&probe));
                Ok(Self { looked: Looked::Probe(Box::new((probe, report))), findings })
            }
            Kind::Store => {
                options.refuse_for("a store")?;
                let store = Store::open(argument)?.map_samples(options.choice.map);
                let bytes = size_on_disk(Path::new(argument));
                let mut all = diagnose_volumes(&store)?.into_iter();
                let Some(mut first) = all.next() else {
                    return Err(Error::argument("store", argument, "a store with a volume", "bake it again"));
                };
                let mut findings = std::mem::take(&mut first.findings);
                findings.extend(all.flat_map(|of_other| of_other.findings));
                Ok(Self { looked: Looked::Store(Box::new(store), Box::new(first), bytes), findings })
            }
        }
    }

    fn of_volume(mut member: Member, asked: Isovalue) -> Result<Self> {
        let (low, high) = member.volume.value_range();
        // An isovalue that was asked for and does not exist is a finding; `auto` finds one wherever there is one.
        let (isovalue, reason) = match member.choose(asked) {
            Ok(chosen) => {
                member.take_side(std::slice::from_ref(&chosen))?;
                (Some(chosen.value), chosen.reason)
            }
            Err(_) => match asked {
                Isovalue::Value(value) => (Some(value), None),
                Isovalue::Percent(part) => (Some(low + part / 100.0 * (high - low)), None),
                _ => (None, None),
            },
        };
        let mut findings = volume::diagnose::diagnose(&member.volume, isovalue);
        findings.extend(isovalue.into_iter().flat_map(|c| level::diagnose::diagnose(&member.volume, c)));
        Ok(Self { looked: Looked::Volume { member: Box::new(member), isovalue, reason }, findings })
    }

    /// What the file is, in a word.
    pub fn kind(&self) -> &'static str {
        match self.looked {
            Looked::Volume { .. } => "volume",
            Looked::Probe(_) => "probe",
            Looked::Store(..) => "store",
        }
    }

    /// What the file is, for programs.
    pub fn facts(&self) -> Value {
        match &self.looked {
            Looked::Volume { member, isovalue, reason } => {
                let volume = &member.volume;
                json!({
                    "name": volume.name, "dims": volume.dims(), "type": volume.samples().type_name(),
                    "range": volume.value_range(), "isovalue": isovalue, "isovalue_reason": reason,
                })
            }
            Looked::Probe(looked) => {
                let (probe, r) = &**looked;
                json!({
                    "name": probe.name, "format": probe.format, "layout": probe.layout.name(), "size": probe.stored_size,
                    "range_ev": r.range_ev, "mean_luminance": r.mean_luminance, "bad_pixels": r.bad_pixels,
                })
            }
            Looked::Store(store, found, bytes) => {
                let held = &found.held;
                json!({
                    "identity": store.identity(), "chunks": found.chunks, "sound": found.sound, "bricks": found.bricks,
                    "isovalues": held.isovalues_json(), "rays": held.rays, "error_targets": held.targets, "bytes": bytes,
                })
            }
        }
    }
}

/// What is unusual of each volume of a store, that of the store first.
///
/// # Errors
/// When a volume cannot be opened.
pub fn diagnose_volumes(store: &Store) -> Result<Vec<Diagnosis>> {
    let diagnose = |store: &Store| {
        let lattice = store.layout().lattice;
        store::diagnose(store, &|volume, held| complete::selection(lattice, volume, held))
    };
    let names = store.volumes()?;
    let mut all = vec![diagnose(store)?];
    for name in names.iter().skip(1) {
        all.push(diagnose(&store.of_volume(name)?)?);
    }
    Ok(all)
}

/// What an argument is: a name first, then a directory, then the first bytes of a file.
///
/// # Errors
/// When the file is empty or cannot be read.
pub fn kind_of(argument: &str) -> Result<Kind> {
    if field::by_name(argument)?.is_some() {
        return Ok(Kind::Volume);
    }
    if probe::by_name(argument)?.is_some() {
        return Ok(Kind::Probe);
    }
    let path = Path::new(argument);
    let Ok(metadata) = path.metadata() else { return Ok(Kind::Volume) }; // It says what is missing.
    if is_store(argument) {
        return Ok(Kind::Store);
    }
    if !metadata.is_file() {
        return Ok(Kind::Volume);
    }
    let mut head = Vec::new();
    let (file, _) = file::open(path)?;
    file.take(8).read_to_end(&mut head).map_err(|e| Error::io(path, "read", e))?;
    Ok(match head.as_slice() {
        b"" => return Err(empty(path)),
        [0x76, 0x2f, 0x31, 0x01, ..] | [b'#', b'?', ..] | [0x89, b'P', b'N', b'G', ..] | [0xff, 0xd8, 0xff, ..] => {
            Kind::Probe
        }
        [b'P', b'K', 3, 4, ..] => Kind::Store,
        _ => Kind::Volume,
    })
}

fn empty(path: &Path) -> Error {
    let expected = "a volume, an environment image or a store";
    Error::format("file", "an empty file", expected, "check how it was written or copied").in_file(path)
}
