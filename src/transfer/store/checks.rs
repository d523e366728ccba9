//! The check points of a texture or a surface: beside the records of its chunks, where readers of Zarr do not look.
//!
//! `checks-NAME.json` is a sealed record (how many points, numbers and paths, and the BLAKE3 of what follows),
//! `checks-NAME.bin` holds little-endian numbers: positions and normals (f32), isovalues (f64), both halves (f32), escapes
//! (u32). The payload is written first.

use super::Store;
use super::metadata::{sealed, unsealed};
use super::surface::node_of;
use super::zarr::FORMAT;
use crate::error::{Error, Result};
use crate::transfer::Group;
use crate::transfer::checks::CheckPoints;
use serde_json::json;

/// What a user does about check points that cannot be used.
const REMEDY: &str = "run the bake that made the store again: it draws them anew";

impl Store {
    /// Where the check points of an isovalue, or of all isovalues, are kept.
    fn checks_key(&self, isovalue: Option<f64>) -> String {
        format!("{}/checks-{}", self.records_key(), isovalue.map_or_else(|| "all".to_owned(), node_of))
    }

    /// Keeps check points of an isovalue of the texture or surface, or of all isovalues; they replace those before.
    ///
    /// # Errors
    /// When the lists of the points do not belong together or their vectors are not those of the store's groups; when the store
    /// is an archive or the system refuses.
    #[doc(hidden)]
    pub fn write_checks(&self, isovalue: Option<f64>, checks: &CheckPoints) -> Result<()> {
        let expected = self.numbers_of_groups()?;
        let fits = match checks.coefficients() {
            n if n == expected || checks.is_empty() => checks.check(),
            n => Err((format!("{n} numbers a point"), format!("{expected}, those of the store's groups"))),
        };
        fits.map_err(|(found, expected)| Error::argument("check points", found, expected, "make them of one bake"))?;
        let mut bytes: Vec<u8> = Vec::new();
        bytes.extend_from_slice(bytemuck::cast_slice(&checks.positions_in_grid));
        bytes.extend_from_slice(bytemuck::cast_slice(&checks.normals));
        bytes.extend_from_slice(bytemuck::cast_slice(&checks.isovalues));
        checks.halves.iter().for_each(|half| bytes.extend_from_slice(bytemuck::cast_slice(half)));
        bytes.extend_from_slice(bytemuck::cast_slice(&checks.escapes));
        let record = json!({
            "of": self.identity_hash,
            "mesh": self.surface.as_ref().map(|mark| mark.mesh.clone()),
            "points": checks.len(), "coefficients": checks.coefficients(), "paths": checks.paths,
            "payload_blake3": blake3::hash(&bytes).to_hex().as_str(),
        });
        let key = self.checks_key(isovalue);
        self.backing.put(&format!("{key}.bin"), self.sync, &bytes)?;
        self.backing.put(&format!("{key}.json"), self.sync, format!("{:#}\n", sealed(record)).as_bytes())
    }

    /// Numbers of a transfer vector in all groups.
    fn numbers_of_groups(&self) -> Result<usize> {
        let of_group = |group: &Group| Ok(group.layout(&self.layout)?.layers.coefficients());
        self.identity.groups().iter().map(of_group).sum()
    }

    /// The check points of an isovalue of the texture or surface, or of all isovalues; `None` if there are none.
    ///
    /// # Errors
    /// When they are damaged, or of another store.
    #[doc(hidden)]
    pub fn checks(&self, isovalue: Option<f64>) -> Result<Option<CheckPoints>> {
        let key = self.checks_key(isovalue);
        let (header, payload) = (format!("{key}.json"), format!("{key}.bin"));
        let Some(sealed) = self.backing.json(&header)? else { return Ok(None) };
        let in_file = |key: &str, found: String, expected: &str| {
            Error::format(FORMAT, found, expected, REMEDY).in_file(self.backing.name(key))
        };
        let record = unsealed(&json!({ "attributes": sealed })).map_err(|e| e.in_file(self.backing.name(&header)))?;
        let number = |name: &str| record[name].as_u64().filter(|&n| n < 1 << 24).map(|n| n as usize);
        let Some(((points, coefficients), paths)) = number("points").zip(number("coefficients")).zip(number("paths"))
        else {
            return Err(in_file(&header, "a record without numbers".into(), "points, coefficients and paths"));
        };
        if record["of"] != json!(self.identity_hash)
            || record["mesh"] != json!(self.surface.as_ref().map(|mark| mark.mesh.clone()))
        {
            return Err(in_file(&header, "check points of another store".into(), "those of this one"));
        }
        let of_groups = self.numbers_of_groups()?;
        if points > 0 && coefficients != of_groups {
            let expected = format!("{of_groups}, those of the groups");
            return Err(in_file(&header, format!("{coefficients} numbers a point"), &expected));
        }
        let Some(bytes) = self.backing.bytes(&payload)? else {
            return Err(in_file(&payload, "no such file".into(), "the numbers of the check points"));
        };
        let expected = points * (12 + 12 + 8 + 2 * 4 * coefficients + 4 * paths);
        if bytes.len() != expected || record["payload_blake3"] != blake3::hash(&bytes).to_hex().as_str() {
            return Err(in_file(
                &payload,
                format!("{} bytes, or others than were written", bytes.len()),
                &format!("{expected} bytes"),
            ));
        }
        let mut rest: &[u8] = &bytes;
        let mut take = |count: usize| {
            let (here, after) = rest.split_at(count);
            rest = after;
            here
        };
        let triples = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, [f32; 3]>(bytes);
        let floats = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, f32>(bytes);
        Ok(Some(CheckPoints {
            positions_in_grid: triples(take(12 * points)),
            normals: triples(take(12 * points)),
            isovalues: bytemuck::pod_collect_to_vec(take(8 * points)),
            halves: [floats(take(4 * coefficients * points)), floats(take(4 * coefficients * points))],
            paths: paths as u32,
            escapes: bytemuck::pod_collect_to_vec(take(4 * paths * points)),
        }))
    }

    /// Takes over the check points of another store of the same identity where there are none here.
    pub(super) fn take_checks(&self, other: &Self) -> Result<()> {
        let named = match &other.surface {
            Some(mark) => vec![Some(mark.isovalue)],
            None => other.asked()?.claims().iter().map(|claim| claim.isovalue).collect(),
        };
        for isovalue in named {
            if let (None, Some(theirs)) = (self.checks(isovalue)?, other.checks(isovalue)?) {
                self.write_checks(isovalue, &theirs)?;
            }
        }
        Ok(())
    }
}
