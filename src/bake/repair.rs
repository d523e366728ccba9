//! Chunks that are damaged: found before a bake, set aside, and baked again with every isosurface that they had.

use super::observer::Observer;
use super::pending::Pending;
use super::run::parts;
use super::{Goal, Report, Request};
use crate::error::Result;
use crate::grid3;
use crate::level::Pyramid;
use crate::transfer::store::{Baked, ChunkCheck, ChunkExtent, ErrorTarget, Store};
use crate::transport::Settings;
use std::collections::BTreeSet;

/// Damaged chunks that are named one by one.
const MOST_NAMED: usize = 8;

/// Verifies what the job would keep and sets aside what is damaged; the linear indices of these chunks, and of those that an
/// earlier run set aside and did not bake again.
pub(super) fn set_damage_aside(job: &Request<'_>, store: &Store, observer: &dyn Observer) -> Result<BTreeSet<usize>> {
    let [cx, cy, cz] = job.layout.lattice.chunks();
    let linear = |[x, y, z]: [usize; 3]| grid3::index([cx, cy], [x, y, z]);
    let mut candidates: Vec<[usize; 3]> = match job.writing.verify_all {
        true => grid3::all([cx, cy, cz]).collect(),
        false => {
            let selection = job.selection();
            let all = grid3::all([cx, cy, cz]);
            all.filter(|&chunk| selection.touches_chunk(chunk)).collect()
        }
    };
    candidates.retain(|&chunk| job.dealt.is_none_or(|dealt| dealt.keeps(linear(chunk))));
    let mut damaged: BTreeSet<usize> = BTreeSet::new();
    let is_divided = |&chunk: &[usize; 3]| job.dealt.is_some_and(|dealt| dealt.is_divided(linear(chunk)));
    let (divided, own): (Vec<_>, Vec<_>) = candidates.into_iter().partition(is_divided);
    let mut turn = Vec::new();
    let mut found: Vec<_> = own.iter().copied().zip(store.verify_chunks(&own)?).collect();
    for chunk in divided {
        // Others write it too: nobody does while it is read, nor until it is set aside.
        let held = store.lock_chunk(chunk)?;
        let check = store.verify_chunks(&[chunk])?.pop().unwrap_or(ChunkCheck::Absent);
        if matches!(check, ChunkCheck::Damaged(_)) {
            turn.push(held);
        }
        found.push((chunk, check));
    }
    for (chunk, found) in found {
        let ChunkCheck::Damaged(what) = found else { continue };
        if damaged.len() < MOST_NAMED {
            let [x, y, z] = chunk;
            observer.note(&format!("chunk ({x}, {y}, {z}) is damaged, set aside, and baked again: {what}"));
        }
        store.set_aside(chunk)?;
        damaged.insert(linear(chunk));
    }
    drop(turn);
    if damaged.len() > MOST_NAMED {
        observer.note(&format!("{} more damaged chunks are baked again", damaged.len() - MOST_NAMED));
    }
    let awaited = store.awaited()?.into_iter().filter(|c| c.iter().zip([cx, cy, cz]).all(|(&i, n)| i < n)).map(linear);
    damaged.extend(awaited.filter(|&c| job.dealt.is_none_or(|dealt| dealt.keeps(c))));
    Ok(damaged)
}

/// Bakes into the chunks that were damaged what was asked of the store before and is not asked now, then removes what was
/// set aside.
pub(super) fn complete(
    job: &Request<'_>,
    pyramid: &Pyramid,
    store: &Store,
    asked: &ChunkExtent,
    damaged: &BTreeSet<usize>,
    quality: Option<&ErrorTarget>,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<()> {
    if damaged.is_empty() || observer.wants_stop() {
        return Ok(());
    }
    let now = job.claims(&quality.cloned());
    let mut left: Vec<Baked> = asked.claims().iter().filter(|c| !now.iter().any(|n| n.covers(c))).cloned().collect();
    while let Some(first) = left.first().cloned() {
        let alike = |claim: &Baked| claim.rays == first.rays && claim.target == first.target;
        let (these, others): (Vec<Baked>, Vec<Baked>) = left.into_iter().partition(alike);
        left = others;
        match job_for(job, &these, damaged, quality) {
            Some(job) => {
                let found = job.quality(pyramid, store, || job.selection(), observer)?;
                let mut pending = Pending::new(&job, store, these)?;
                let before = (report.chunks_baked, report.chunks_kept);
                if pending.missing > 0 {
                    (report.chunks_baked, report.chunks_kept) = (0, 0);
                    parts(&job, pyramid, store, &mut pending, found.target, observer, report)?;
                }
                (report.chunks_baked, report.chunks_kept) = before;
            }
            None => {
                let isovalues: Vec<String> =
                    these.iter().map(|c| c.isovalue.map_or("all".into(), |v| v.to_string())).collect();
                let of = first.target.map_or(String::new(), |t| format!(", {} of {}", t.error, t.of));
                observer.note(&format!(
                    "the damaged chunks also held isovalues {}{of}: bake these again with the options they had",
                    isovalues.join(", ")
                ));
            }
        }
    }
    let [cx, cy, _] = job.layout.lattice.chunks();
    for &c in damaged {
        store.clear_set_aside(grid3::at([cx, cy], c))?;
    }
    Ok(())
}

/// The job that makes some claims of an earlier bake good in the damaged chunks; `None` where it needs a light that is not
/// at hand.
fn job_for<'a>(
    job: &Request<'a>,
    claims: &[Baked],
    damaged: &BTreeSet<usize>,
    quality: Option<&ErrorTarget>,
) -> Option<Request<'a>> {
    let first = claims.first()?;
    let is_same = first.target.as_ref().zip(quality).is_some_and(|(t, q)| t.of == q.of);
    if first.target.is_some() && !is_same {
        return None;
    }
    let isovalues: Option<Vec<f64>> = claims.iter().map(|claim| claim.isovalue).collect();
    let goal = Goal {
        error: first.target.as_ref().map(|t| t.error as f32),
        lights: job.goal.lights.clone(),
        most_paths: None,
        seconds: None,
    };
    Some(Request {
        isovalues,
        goal,
        settings: Settings { rays: first.rays, ..job.settings.clone() },
        only: Some(damaged.clone()),
        ..job.clone()
    })
}
