//! Putting together what was baked apart: the chunks of one store taken over into another of the same identity.

use super::joint::expects;
use super::{Store, StoreOptions};
use crate::error::{Error, Result};
use crate::grid3;
use crate::transfer::{BRICK_TEXELS, Brick, Group, Layers, validity};
use std::path::Path;

/// What a merge did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MergeReport {
    /// Chunks that were new or changed.
    pub taken: usize,
    /// Chunks of the other store that brought nothing.
    pub kept: usize,
}

impl StoreOptions {
    /// Puts the chunks of several stores of one bake together in the store at `path`, volume by volume; it is made if there is
    /// none. What each of the stores brought, over all volumes. Stores may be of an older format.
    ///
    /// # Errors
    /// When there is no store to read, their identities differ (before anything is written), a chunk is damaged, or the
    /// system refuses.
    pub fn merge(self, sources: &[Store], path: impl AsRef<Path>) -> Result<(Store, Vec<MergeReport>)> {
        let path = path.as_ref();
        let [first, ..] = sources else {
            return Err(Error::argument("stores", "none", "at least one store to read", "name the shares of a bake"));
        };
        let mut names: Vec<String> = Vec::new();
        for store in sources {
            store.check_not_packed()?;
            names.extend(store.volumes()?.into_iter().filter(|name| !names.contains(name)).collect::<Vec<_>>());
        }
        // The parts of each volume, with the store that they come from.
        let mut all: Vec<Vec<(usize, Store)>> = Vec::new();
        for name in &names {
            let mut parts: Vec<(usize, Store)> = Vec::new();
            for (i, store) in sources.iter().enumerate() {
                if store.volumes()?.contains(name) {
                    parts.push((i, store.of_volume(name)?));
                }
            }
            // Every store must fit before one is touched.
            for (_, store) in parts.iter().skip(1) {
                let [one, other] = [&parts[0].1, store].map(|store| store.identity().in_current_format());
                if let Some((field, stored, asked)) = one.first_difference(&other) {
                    return Err(Error::Mismatch {
                        path: store.path().into(),
                        field: field.into(),
                        stored: asked,
                        asked: stored,
                        remedy: format!("merge only shares of one bake; {} was the first", first.path().display()),
                    });
                }
            }
            all.push(parts);
        }
        // Volumes of different names only go together where they were baked together.
        let firsts: Vec<&Store> = all.iter().filter_map(|parts| Some(&parts.first()?.1)).collect();
        for (i, one) in firsts.iter().enumerate() {
            if let Some(other) = firsts[..i].iter().find(|other| !expects(other, one.identity())) {
                return Err(Error::Mismatch {
                    path: one.path().into(),
                    field: "volume".into(),
                    stored: one.node().into(),
                    asked: other.node().into(),
                    remedy: format!("merge only shares of one bake; {} was the first", first.path().display()),
                });
            }
        }
        let mut reports = vec![MergeReport::default(); sources.len()];
        let mut lock = None;
        let mut merged = None;
        for parts in &all {
            let [(_, part), ..] = parts.as_slice() else { continue };
            // A file that is named is believed no more than a copy: the new store vouches for it.
            let (volume, identity) = (part.volume_verified(true)?, part.identity().in_current_format());
            let is_coupled = identity.scene.as_ref().is_some_and(|scene| scene.coupling.is_some());
            let target = match is_coupled {
                true => self.open_or_add(path, &volume, &identity, part.provenance().clone())?,
                false => self.open_or_create(path, &volume, &identity, part.provenance().clone())?,
            };
            if lock.is_none() {
                lock = Some(target.lock()?);
            }
            for (i, part) in parts {
                let report = target.take_from(part)?;
                reports[*i].taken += report.taken;
                reports[*i].kept += report.kept;
            }
            merged.get_or_insert(target);
        }
        match merged {
            Some(merged) => Ok((merged, reports)),
            None => Err(Error::format("store", "no volume", "one at least", "bake into it").in_file(first.path())),
        }
    }
}

impl Store {
    /// Takes over every texel of `other` that is better than the one here: a baked one over none, one of more rays
    /// over one of fewer. Claims of both hold afterwards. `other` may be of an older format. Shares of one bake give the same bytes in any order.
    ///
    /// # Errors
    /// When the identities differ, a chunk of either is damaged, or the system refuses.
    #[doc(hidden)]
    pub fn take_from(&self, other: &Self) -> Result<MergeReport> {
        // A store of an older format is taken over chunk by chunk: writing stamps it anew.
        let identity = other.identity.in_current_format();
        identity.check(&self.identity, other.path(), [other.node(), self.node()])?;
        self.check_surfaces_of(other)?;
        let is_whole = self.group == Group::Environment;
        for group in self.identity.groups().iter().skip(1).filter(|_| is_whole) {
            // Those first: a chunk counts as there when the environment's is.
            self.group(group)?.take_from(&other.group(group)?)?;
        }
        let asked = other.asked()?;
        if !asked.claims().is_empty() {
            self.ask(&asked)?;
        }
        self.take_checks(other)?;
        let [cx, cy, cz] = self.layout.lattice.chunks();
        let mut report = MergeReport::default();
        for c in 0..cx * cy * cz {
            let chunk = grid3::at([cx, cy], c);
            let Some((theirs, their_extent)) = other.read_chunk(chunk)? else { continue };
            let Some((mut ours, mut extent)) = self.read_chunk(chunk)? else {
                self.write_chunk(chunk, theirs, &their_extent)?;
                report.taken += 1;
                continue;
            };
            let before = extent.clone();
            extent.join(&their_extent);
            let mut changed = extent != before;
            for (slot, theirs) in ours.iter_mut().zip(theirs) {
                changed |= better(slot, theirs, &self.layout.layers);
            }
            if changed {
                self.write_chunk(chunk, ours, &extent)?;
            }
            report.taken += usize::from(changed);
            report.kept += usize::from(!changed);
        }
        let surfaces = other.surfaces()?;
        if surfaces.is_empty() {
            return Ok(report);
        }
        let world_from_grid = *self.volume()?.world_from_grid();
        for isovalue in surfaces {
            let Some(theirs) = other.surface(isovalue)? else { continue };
            let Some(mesh) = theirs.mesh()? else { continue };
            let more = self
                .open_or_add_surface(isovalue, &mesh, &world_from_grid, theirs.is_on_model())?
                .take_from(&theirs)?;
            report.taken += more.taken;
            report.kept += more.kept;
        }
        Ok(report)
    }
}

/// Replaces the texels of a brick by better ones of another; whether there were any.
fn better(ours: &mut Option<Brick>, theirs: Option<Brick>, layers: &Layers) -> bool {
    let Some(theirs) = theirs else { return false };
    let Some(ours) = ours else {
        *ours = Some(theirs);
        return true;
    };
    let (coefficients, errors) = (layers.coefficients(), layers.errors());
    let baked = |brick: &Brick, t: usize| !brick.transfer[t * coefficients].is_nan();
    let mut changed = false;
    for t in 0..BRICK_TEXELS {
        let is_new = baked(&theirs, t) && !baked(ours, t);
        let is_finer = theirs.rays[t] > ours.rays[t] && theirs.validity[t] & validity::VALID != 0;
        if !(is_new || is_finer) {
            continue;
        }
        let (own, new) = (t * coefficients..(t + 1) * coefficients, t * errors..(t + 1) * errors);
        ours.transfer[own.clone()].copy_from_slice(&theirs.transfer[own]);
        ours.stderr[new.clone()].copy_from_slice(&theirs.stderr[new]);
        (ours.validity[t], ours.rays[t]) = (theirs.validity[t], theirs.rays[t]);
        changed = true;
    }
    changed
}
