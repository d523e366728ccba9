//! What a store was baked from and how: the part that must not differ when a bake goes on.

use super::super::{Group, Lattice, Layers, Layout};
use super::estimator::{self, EstimatorIdentity};
use super::joint::{CouplingIdentity, coupling_text};
use super::zarr::{FORMAT, METADATA_REMEDY};
use crate::error::{Error, Result};
use crate::volume::{Solid, Volume};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the format that this program writes.
pub const FORMAT_VERSION: u32 = 3;
/// The oldest version that it reads.
pub const OLDEST_FORMAT_VERSION: u32 = 1;
/// From this version on the record of a chunk says which store it belongs to, and lies in the folder of `rays`.
pub(super) const STAMPED_VERSION: u32 = 3;

/// What decides the numbers in a store. Two bakes with equal identities fill one store; with
/// different ones they are refused ([`Error::Mismatch`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Version of the format: [`FORMAT_VERSION`], or that of an older store.
    pub format_version: u32,
    /// [`Volume::content_hash`].
    pub volume: String,
    /// Samples of the volume along x, y, z.
    pub grid: [usize; 3],
    /// Texels along x, y, z.
    pub texels: [usize; 3],
    /// Which side is matter: "above" or "below".
    pub solid: String,
    /// Bands of each layer.
    pub bands: Vec<usize>,
    /// The estimator, with all of its settings that decide numbers.
    #[serde(deserialize_with = "estimator::read")]
    pub estimator: EstimatorIdentity,
    /// [`EstimatorIdentity::revision`] of the program that began the store.
    #[serde(default = "estimator::first_revision", skip_serializing_if = "estimator::is_first_revision")]
    pub revision: u32,
    /// Whether the transfer is a sum with positive weights (no control variate).
    pub positive: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Of a texture that leaves out what can be interpolated: the error that this may have, relative to the root mean square of the
    /// transfer. Texels that were not baked are then the mean of others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adaptive: Option<f64>,
    /// The walls and luminaires around the volume; none for a volume alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<SceneIdentity>,
}

/// Walls and luminaires as an identity names them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneIdentity {
    /// BLAKE3 of all that decides what they do to light.
    pub fingerprint: String,
    /// Names of the luminaires, each of which has a group of its own.
    pub luminaires: Vec<String>,
    /// One a luminaire: its texture holds G_k / 2^exponent.
    pub exponents: Vec<i32>,
    /// The volumes beside this one whose level sets light it; none where it stands alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coupling: Option<CouplingIdentity>,
    /// Whether media lie between surfaces.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub media: bool,
    /// The solid of the volume, where light passes through it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<BodyIdentity>,
}

/// A translucent solid: what the layers of its transfer are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyIdentity {
    /// Its index of refraction.
    pub index: f64,
    /// The medium's albedo of each layer; of a single layer that of the bake, which is not listed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<f64>,
    /// The medium's albedo where none is chosen.
    pub albedo: [f32; 3],
}

impl Identity {
    /// The identity of a bake of `volume`; an estimator of another program may be given as text.
    pub fn new(
        volume: &Volume,
        layout: &Layout,
        estimator: impl Into<EstimatorIdentity>,
        positive: bool,
        seed: u64,
    ) -> Self {
        let estimator = estimator.into();
        Self {
            format_version: FORMAT_VERSION,
            revision: estimator.revision(),
            volume: volume.content_hash(),
            grid: layout.lattice.grid(),
            texels: layout.lattice.texels(),
            solid: solid_name(volume.solid).into(),
            bands: layout.layers.bands().to_vec(),
            estimator,
            positive,
            seed,
            adaptive: None,
            scene: None,
        }
    }

    /// Whether this program's estimator would give the same numbers for the same texel.
    pub fn can_be_made_again(&self) -> bool {
        self.revision == self.estimator.revision()
    }

    /// The same bake in a store of the format that is written today.
    #[must_use]
    pub fn in_current_format(&self) -> Self {
        Self { format_version: FORMAT_VERSION, ..self.clone() }
    }

    /// The groups of its store, the environment first.
    pub fn groups(&self) -> Vec<Group> {
        let Some(scene) = &self.scene else { return vec![Group::Environment] };
        let luminaires = scene.luminaires.iter().map(|name| Group::Luminaire(name.clone()));
        [Group::Environment, Group::Emission].into_iter().chain(luminaires).collect()
    }

    /// Lattice and layers.
    ///
    /// # Errors
    /// When the numbers are outside what a texture can be.
    pub fn layout(&self) -> Result<Layout> {
        let sensible = |n: &[usize; 3]| n.iter().all(|&m| (1..=1 << 24).contains(&m));
        if !(sensible(&self.grid) && sensible(&self.texels)) {
            return Err(Error::format(
                FORMAT,
                format!("grid {:?}, texels {:?}", self.grid, self.texels),
                "1 to 2^24 along each axis",
                METADATA_REMEDY,
            ));
        }
        if let Some(error) = self.adaptive.filter(|error| !(*error > 0.0 && *error < 1.0)) {
            let found = format!("an adaptive texture of error {error}");
            return Err(Error::format(FORMAT, found, "an error between 0 and 1", METADATA_REMEDY));
        }
        let legal =
            |name: &String| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
        if let Some(bad) = self.scene.iter().flat_map(|scene| &scene.luminaires).find(|name| !legal(name)) {
            let expected = "names of luminaires made of letters, digits, - and _";
            return Err(Error::format(FORMAT, format!("the luminaire {bad:?}"), expected, METADATA_REMEDY));
        }
        if let Some(scene) = self
            .scene
            .as_ref()
            .filter(|s| s.exponents.len() != s.luminaires.len() || s.exponents.iter().any(|e| e.unsigned_abs() > 1100))
        {
            let found = format!("exponents {:?} of {} luminaires", scene.exponents, scene.luminaires.len());
            return Err(Error::format(FORMAT, found, "one exponent of at most 1100 for each", METADATA_REMEDY));
        }
        let names = self.scene.iter().filter_map(|scene| scene.coupling.as_ref());
        let mut names = names.flat_map(|c| c.partners.iter().map(|p| &p.name).chain([&c.name]));
        if names.any(|name| name.is_empty() || *name != super::metadata::node_name(name)) {
            let found = "a name of a volume that is no node";
            return Err(Error::format(FORMAT, found, "names of letters, digits, - and _", METADATA_REMEDY));
        }
        let layers = Layers::new(self.bands.clone())?;
        let layers = if self.scene.is_some() { layers.coloured() } else { layers };
        Ok(Layout { lattice: Lattice::from_texels(self.grid, self.texels)?, layers })
    }

    /// BLAKE3 of the identity written as JSON, in hexadecimal digits.
    pub fn hash(&self) -> String {
        let text = serde_json::to_string(self).unwrap_or_default(); // A struct of plain values always is JSON.
        blake3::hash(text.as_bytes()).to_hex().to_string()
    }

    /// The first field that differs: its name, its value here and its value in `other`.
    pub fn first_difference(&self, other: &Self) -> Option<(&'static str, String, String)> {
        let list = |v: &[usize]| format!("{v:?}");
        let fields = |i: &Self| {
            [
                ("format_version", i.format_version.to_string()),
                ("volume", i.volume.clone()),
                ("grid", list(&i.grid)),
                ("texels", list(&i.texels)),
                ("solid", i.solid.clone()),
                ("bands", list(&i.bands)),
                ("estimator", estimator_text(i)),
                ("texture", i.adaptive.map_or("all texels".into(), |e| format!("adaptive:{e}"))),
                ("positive", i.positive.to_string()),
                ("seed", i.seed.to_string()),
                ("coupling", coupling_text(i)),
                ("scene", i.scene.as_ref().map_or("a volume alone".into(), |s| s.fingerprint.clone())),
                ("luminaires", i.scene.as_ref().map_or("none".into(), |s| s.luminaires.join(", "))),
            ]
        };
        let pairs = fields(self).into_iter().zip(fields(other));
        pairs.into_iter().find(|(a, b)| a != b).map(|((name, a), (_, b))| (name, a, b))
    }

    /// Refuses an identity that differs from that of the store at `path`. `names`: of the volume that it holds and of
    /// the one given, for people.
    pub(super) fn check(&self, asked: &Self, path: &Path, names: [&str; 2]) -> Result<()> {
        let other = asked;
        let Some((field, mut stored, mut asked)) = self.first_difference(other) else { return Ok(()) };
        let mut remedy = format!("give another output with -o, or --force to replace {}", path.display());
        if field == "volume" {
            let shown = |name: &str, hash: String| match names[0] == names[1] {
                true => format!("{name} with BLAKE3 {}…", hash.get(..12).unwrap_or(&hash)),
                false => name.to_owned(),
            };
            (stored, asked) = (shown(names[0], stored), shown(names[1], asked));
        }
        if field == "format_version" {
            remedy = format!(
                "it can be read, not extended: convert it with `isolume merge {} -o NEW.isolume`, or {remedy}",
                path.display()
            );
        }
        if field == "estimator" && self.estimator == other.estimator {
            remedy = format!("an older version baked it: it can be read, not extended; {remedy}");
        }
        Err(Error::Mismatch { path: path.into(), field: field.into(), stored, asked, remedy })
    }
}

/// The estimator and, where there is more than one, its revision.
fn estimator_text(identity: &Identity) -> String {
    match identity.revision == estimator::first_revision() {
        true => identity.estimator.to_string(),
        false => format!("{}, revision {}", identity.estimator, identity.revision),
    }
}

/// The name of a side in files.
pub(super) fn solid_name(solid: Solid) -> &'static str {
    match solid {
        Solid::Above => "above",
        Solid::Below => "below",
    }
}
