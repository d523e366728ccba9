//! The bake itself: what is damaged is mended, what is missing is computed and written chunk by chunk.

use super::deal::{Dealt, deal};
use super::observer::{Observer, Task};
use super::pending::{Part, Pending, texels_in};
use super::report::{GoalRecord, PhotonReport, Report};
use super::request::{Estimator, Request};
use super::{checks, repair};
use crate::error::{Error, Result};
use crate::grid3;
use crate::level::Pyramid;
use crate::surface::{Mesh, isosurface};
use crate::transfer::store::{Baked, ChunkExtent, Store, StoreLock, StoreOptions};
use crate::transfer::{Brick, Lattice, Octants, Selection};
use crate::transport::{
    ChunkBricks, PhotonMap, Progress, Settings, Summary, SurfacePoints, Target, Tolerance, bake, gather,
    photon_bake_from, photon_bake_map,
};
use serde_json::Value;
use std::path::Path;
use std::sync::atomic::Ordering;

/// Bakes what is missing or damaged into the store at `path`, which is made if there is none.
///
/// # Errors
/// When the request cannot be done ([`Request::check`]), the store is of something else, is filled by another process or cannot
/// be mended, or the system refuses; [`Error::Stopped`] when the observer wanted to stop before it was done.
pub fn run(request: &Request<'_>, path: impl AsRef<Path>, observer: &dyn Observer) -> Result<(Store, Report)> {
    let (job, path) = (request, path.as_ref());
    job.check()?;
    // Of shares the first hashes the file that a store names; a bake alone looks at all of it, as it does at a copy.
    if job.share.is_some() && !job.writing.repair {
        Store::recognise(path, job.volume);
    }
    let pyramid = Pyramid::new(job.volume);
    let is_joint = job.geometry.is_some_and(|geometry| geometry.among().is_some());
    let provenance = match StoreOptions::knows(path, job.volume) {
        true => Value::Null,
        false => job.provenance(&pyramid)?,
    };
    let mut report = Report { albedo: job.hints.albedo, ..Report::default() };
    if job.hints.shown {
        let plan = job.plan(&pyramid)?;
        observer.plan(&plan);
        report.plan = Some(plan);
    }
    let share = job.share.map(|share| (share.index, share.of));
    // Before the first look at what is there: nobody else mends or replaces it meanwhile.
    let early = if path.is_dir() { Some(StoreLock::take(path, share)?) } else { None };
    let options = StoreOptions::default().sync(job.writing.sync).repair(job.writing.repair);
    let mut store = match is_joint {
        true => options.open_or_add(path, job.volume, &job.identity(), provenance)?,
        false => options.open_or_create(path, job.volume, &job.identity(), provenance)?,
    };
    store = store.map_samples(job.volume.samples().place().is_some());
    {
        let _lock = match early {
            Some(lock) => lock,
            None => StoreLock::take(path, share)?,
        };
        store.mended().iter().for_each(|what| observer.note(what));
        report.mended = store.mended().len();
        store.keeps_otherwise(job.volume).iter().for_each(|text| observer.note(text));
        report.prepare_seconds = observer.seconds();
        report.goal = GoalRecord::of(&job.goal);
        report.at_vertices = job.surfaces;
        match job.surfaces() {
            None => {
                let photons = job.specular_photons(&pyramid)?;
                let dealt = job.share.and_then(|_| dealt(job, &[job.selection()]).pop());
                let job = &Request { specular: photons.as_ref(), dealt: dealt.as_ref(), ..job.clone() };
                fill(job, &pyramid, &store, observer, &mut report)?;
                check_texture(job, &pyramid, &store)?;
            }
            Some(isovalues) => fill_surfaces(job, &pyramid, &store, &isovalues, observer, &mut report)?,
        }
    }
    store.refresh();
    Ok((store, report))
}

/// What the share of a job has to do of each of some selections; nothing where there is no share.
fn dealt(job: &Request<'_>, selections: &[Selection]) -> Vec<Dealt> {
    let Some(share) = job.share else { return Vec::new() };
    // The cache of `gather` is of all texels at once: there a chunk is not divided.
    // What an adaptive texture leaves out is decided chunk by chunk.
    let divides = job.estimator == Estimator::Path && job.adaptive.is_none();
    let draws = job.estimator == Estimator::Path && job.settings.rays >= FEWEST_CHECKED;
    let points: usize = match (&job.isovalues, selections) {
        _ if !draws => 0,
        (None, _) => checks::OF_ALL,
        // A surface crosses about half as many cells as its texels are.
        (Some(list), [one]) if !one.lattice().is_of_vertices() => {
            list.len() * checks::count_of(one.len() as usize / 2 / list.len().max(1))
        }
        (Some(_), surfaces) => surfaces.iter().map(|surface| checks::count_of(surface.len() as usize)).sum(),
    };
    let rays = job.settings.rays.clamp(1, USUAL_RAYS);
    deal(selections, share, divides, points as u64 * u64::from(checks::PATHS / rays))
}

/// Paths that a texel needs as a rule where it stops by a goal: they only weigh the check points, which the first share draws.
const USUAL_RAYS: u32 = 256;

/// Bakes the vertices of isosurfaces, one after the other.
fn fill_surfaces(
    job: &Request<'_>,
    pyramid: &Pyramid,
    store: &Store,
    isovalues: &[f64],
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<()> {
    let on_model = job.volume.exact.is_some();
    let mut meshes = Vec::with_capacity(isovalues.len());
    for &isovalue in isovalues {
        meshes.push((isovalue, isosurface(job.volume, pyramid, isovalue)?));
    }
    job.check_samples()?;
    store.check_surfaces(meshes.iter().map(|(isovalue, mesh)| (*isovalue, mesh)), on_model)?;
    let mut surfaces = Vec::with_capacity(isovalues.len());
    for (isovalue, mesh) in meshes {
        let surface = store.open_or_add_surface(isovalue, &mesh, job.volume.world_from_grid(), on_model)?;
        let Mesh { positions_in_grid, normals, triangles } = mesh;
        surfaces.push((surface, SurfacePoints { isovalue, positions_in_grid, normals, own: Vec::new() }, triangles));
    }
    let vertices = |points: &SurfacePoints| Selection::all(Lattice::of_vertices(points.positions_in_grid.len()));
    let selections: Vec<Selection> = surfaces.iter().map(|(_, points, _)| vertices(points)).collect();
    let mut dealt = dealt(job, &selections).into_iter();
    let mut left: usize = surfaces.iter().map(|(_, points, _)| points.positions_in_grid.len()).sum();
    for (surface, points, triangles) in surfaces {
        let count = points.positions_in_grid.len();
        let share = count as f64 / left.max(1) as f64;
        left -= count;
        let of_surface = job.of_surface(&points, share);
        let photons = of_surface.specular_photons(pyramid)?;
        let dealt = dealt.next();
        let of_surface = Request { specular: photons.as_ref(), dealt: dealt.as_ref(), ..of_surface };
        fill(&of_surface, pyramid, &surface, observer, report)?;
        let SurfacePoints { isovalue, positions_in_grid, normals, .. } = points;
        let mesh = Mesh { positions_in_grid, normals, triangles };
        let job = &Request { specular: photons.as_ref(), ..job.clone() };
        add_checks(job, pyramid, &surface, Some(isovalue), || Ok(mesh))?;
    }
    Ok(())
}

/// Draws the check points of a texture, of each isovalue asked for or of all.
fn check_texture(job: &Request<'_>, pyramid: &Pyramid, store: &Store) -> Result<()> {
    let Some(isovalues) = &job.isovalues else {
        return add_checks(job, pyramid, store, None, || Ok(Mesh::default()));
    };
    for &isovalue in isovalues {
        add_checks(job, pyramid, store, Some(isovalue), || isosurface(job.volume, pyramid, isovalue))?;
    }
    Ok(())
}

/// Draws check points where there are none that can be read; of a share of a bake the first draws them, and none is drawn for
/// a draft or for estimators other than by paths.
fn add_checks(
    job: &Request<'_>,
    pyramid: &Pyramid,
    store: &Store,
    isovalue: Option<f64>,
    mesh: impl FnOnce() -> Result<Mesh>,
) -> Result<()> {
    let is_other = job.share.is_some_and(|share| share.index != 1) || job.estimator != Estimator::Path;
    if is_other || job.settings.rays < FEWEST_CHECKED || matches!(store.checks(isovalue), Ok(Some(_))) {
        return Ok(());
    }
    let seed = job.settings.seed;
    let points = match isovalue {
        None => checks::draw_everywhere(job.volume, pyramid, seed),
        Some(isovalue) => {
            let mesh = mesh()?;
            let count = checks::count_of(mesh.positions_in_grid.len());
            checks::draw_on((job.volume, pyramid), &mesh, isovalue, count, seed)
        }
    };
    let checks = job.checks_at(pyramid, &points)?;
    job.check_samples()?;
    store.write_checks(isovalue, &checks)
}

/// Rays from which on a bake is no draft.
const FEWEST_CHECKED: u32 = 32;

/// Bakes what a texture, or the vertices of a surface, lack.
fn fill(
    job: &Request<'_>,
    pyramid: &Pyramid,
    store: &Store,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<()> {
    // An adaptive texture has about as many texels as the data have samples, whatever its finest stride.
    let finer = |a: usize| if job.adaptive.is_some() { job.layout.lattice.step(a).min(1.0) } else { 1.0 };
    let whole = if job.goal.most_paths.is_some() { job.selection().len() } else { 0 };
    let texels = (whole as f64 * finer(0) * finer(1) * finer(2)) as u64;
    let rays = job.goal.rays(job.settings.rays, texels);
    let job = &Request { settings: Settings { rays, ..job.settings.clone() }, ..job.clone() };
    let damaged = repair::set_damage_aside(job, store, observer)?;
    // Who finds a chunk damaged bakes all of it again, whoever had parts of it.
    let dealt = job.dealt.map(|dealt| dealt.with_whole(&damaged));
    let job = &Request { dealt: dealt.as_ref(), ..job.clone() };
    let quality = job.quality(pyramid, store, || job.selection(), observer)?;
    let claims = job.claims(&quality.name);
    let asked = store.asked()?;
    let wanted = claims.clone();
    let mut pending = Pending::new(job, store, claims)?;
    if pending.missing > 0 {
        store.check_not_packed()?;
        if job.share.is_some() {
            // Others ask the same: whoever watches knows from the start how much there is to do.
            store.ask(&asked_with(&asked, &wanted))?;
        }
    }
    let of = job.points.map_or(String::new(), |points| format!(" of isovalue {}", points.isovalue));
    let chunks = pending.kept + pending.missing;
    if let Some(share) = job.share {
        let what = match job.dealt.is_some_and(Dealt::is_empty) {
            true => "nothing: there is less to do than shares to do it".to_owned(),
            false => format!("{chunks} chunks or parts of them"),
        };
        observer.note(&format!("share {} of {}{of}: {what}", share.index, share.of));
    }
    if pending.kept > 0 {
        observer.note(&format!("{} of {chunks} chunks{of} are there already", pending.kept));
    }
    report.chunks_kept += pending.kept;
    report.target = quality.name.clone();
    report.rays = report.rays.max(rays);
    report.damaged += damaged.len();
    let tolerance = match job.adaptive.filter(|_| pending.missing > 0 || !damaged.is_empty()) {
        Some(error) => Some(Tolerance::new(&job.bake(pyramid, &job.settings, &job.selection()), error)?),
        None => None,
    };
    let job = &Request { tolerance: tolerance.as_ref(), ..job.clone() };
    observer.begin();
    parts(job, pyramid, store, &mut pending, quality.target, observer, report)?;
    repair::complete(job, pyramid, store, &asked, &damaged, quality.name.as_ref(), observer, report)?;
    // Chunks claim what they have; the note is for those that are lost one day.
    store.ask(&asked_with(&asked, &wanted))
}

/// What was asked before, and what is asked now.
fn asked_with(before: &ChunkExtent, now: &[Baked]) -> ChunkExtent {
    let mut all = before.clone();
    now.iter().for_each(|claim| all.add(claim.clone()));
    all
}

/// Bakes all parts of what is pending.
pub(super) fn parts(
    job: &Request<'_>,
    pyramid: &Pyramid,
    store: &Store,
    pending: &mut Pending<'_>,
    target: Option<Target>,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<()> {
    let settings = Settings { target, ..job.settings.clone() };
    let (start, write, before) = (observer.seconds(), report.write_seconds, report.chunks_baked);
    let map = if pending.len() > 0 { photon_map(job, pyramid, &settings, observer, report)? } else { None };
    for i in 0..pending.len() {
        if job.estimator == Estimator::Photon && map.is_none() {
            break;
        }
        let mut part = pending.part(i);
        let texels = texels_in(&part.selection, &part.chunks);
        if job.estimator == Estimator::Gather {
            part.selection = pending.everything();
        }
        let progress = Progress::default();
        let map = map.as_ref();
        let mut done = Ok(());
        observer.watch(Task::Texels, texels, &progress, &mut || {
            done = bake_part(job, pyramid, store, &settings, &part, map, &progress, observer, report);
        });
        done?;
        if observer.wants_stop() {
            break;
        }
    }
    report.trace_seconds += (observer.seconds() - start - (report.write_seconds - write)).max(0.0);
    let baked = report.chunks_baked - before;
    if baked < pending.missing {
        let (done, all) = (baked + pending.kept, pending.missing + pending.kept);
        return Err(Error::Stopped { done, all });
    }
    Ok(())
}

/// The map of the estimator `photon`, which all parts read; `None` for others, and when the user does not want to wait for it.
fn photon_map(
    job: &Request<'_>,
    pyramid: &Pyramid,
    settings: &Settings,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<Option<PhotonMap>> {
    if job.estimator != Estimator::Photon {
        return Ok(None);
    }
    let (asked, start, progress) = (job.photons(), observer.seconds(), Progress::default());
    let selection = Selection::empty(job.layout.lattice);
    let request = job.bake(pyramid, settings, &selection);
    let sent = u64::from(asked.photons);
    let mut made = Ok(None);
    observer.watch(Task::Photons, sent, &progress, &mut || made = photon_bake_map(&request, &asked, &progress));
    let made = made?;
    if let Some(map) = &made {
        report.summary.counts += map.counts();
        report.photons = Some(PhotonReport::new(map, observer.seconds() - start));
    }
    Ok(made)
}

/// Puts what other shares have written into a chunk meanwhile beside the octants that were baked here; what the chunk claims.
fn take_from_others(
    stores: &[Store],
    chunk: [usize; 3],
    own: Octants,
    groups: &mut [Vec<Option<Brick>>],
) -> Result<ChunkExtent> {
    let mut there = Vec::with_capacity(stores.len());
    for store in stores {
        there.push(store.read_chunk(chunk)?);
    }
    let there: Option<Vec<_>> = there.into_iter().collect();
    // A process that was killed while it wrote takes the claims of all with it: verification names what is to be baked again.
    let Some(there) = there else { return Ok(ChunkExtent::default()) };
    let mut extent = ChunkExtent::default();
    for (g, (store, (bricks, claimed))) in stores.iter().zip(there).enumerate() {
        if g == 0 {
            extent = claimed;
        }
        let lattice = store.layout().lattice;
        for (slot, (here, theirs)) in groups[g].iter_mut().zip(bricks).enumerate() {
            if !own.hold_slot(&lattice, slot) {
                *here = theirs;
            }
        }
    }
    Ok(extent)
}

fn bake_part(
    job: &Request<'_>,
    pyramid: &Pyramid,
    store: &Store,
    settings: &Settings,
    part: &Part,
    map: Option<&PhotonMap>,
    progress: &Progress,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<()> {
    let request = job.bake(pyramid, settings, &part.selection);
    // The environment last: a chunk is there when its texture is.
    let stores = request.groups().iter().map(|group| store.group(group)).collect::<Result<Vec<_>>>()?;
    let present = |chunk: [usize; 3]| {
        let mut all: ChunkBricks = Vec::with_capacity(stores.len());
        for store in &stores {
            let Some((bricks, _)) = store.read_chunk(chunk)? else { return Ok(None) };
            all.push(bricks);
        }
        Ok(Some(all))
    };
    let (mut write, mut baked) = (0.0, 0);
    let mut sink = |chunk: [usize; 3], mut groups: ChunkBricks| {
        let before = observer.seconds();
        let [cx, cy, _] = job.layout.lattice.chunks();
        let is_divided = job.dealt.is_some_and(|dealt| dealt.is_divided(grid3::index([cx, cy], chunk)));
        let _turn = if is_divided { Some(store.lock_chunk(chunk)?) } else { None };
        let mut extent = match is_divided {
            true => take_from_others(&stores, chunk, part.octants, &mut groups)?,
            false => store.chunk_extent(chunk)?.unwrap_or_default(),
        };
        for (i, claim) in part.claims.iter().enumerate() {
            // Where an isosurface has no texels there is nothing to do for it.
            let touched = part.touched.get(&chunk).and_then(|all| all.get(i)).copied().unwrap_or(Octants::ALL);
            extent.add_part(claim.clone(), part.octants.with(touched.others()));
        }
        job.check_samples()?;
        for (store, bricks) in stores.iter().zip(groups).rev() {
            store.write_chunk(chunk, bricks, &extent)?;
        }
        write += observer.seconds() - before;
        baked += 1;
        if observer.wants_stop() {
            progress.stop.store(true, Ordering::Relaxed);
        }
        Ok(())
    };
    let mut summary = Summary::default();
    match job.estimator {
        Estimator::Path | Estimator::Photon => {
            summary.add(&match map {
                Some(map) => photon_bake_from(&request, map, &part.chunks, progress, &present, &mut sink)?,
                None => bake(&request, &part.chunks, progress, &present, &mut sink)?,
            });
        }
        Estimator::Gather => {
            let gathered = gather(&request, &job.gather_settings(), &part.chunks, progress, &present, &mut sink)?;
            summary.add(&gathered.summary);
            report.bias = Some(gathered.bias);
        }
    }
    report.summary.add(&summary);
    report.write_seconds += write;
    report.chunks_baked += baked;
    Ok(())
}
