//! Bakes of scenes: the same steps as for a volume alone, with one texture a group.

use super::observer::Observer;
use super::pending::Part;
use super::request::{PILOT_RAYS, PILOT_TEXELS};
use super::{Estimator, Report, Request};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::scene;
use crate::scene::geometry::{Geometry, Partner};
use crate::transfer::store::{ChunkExtent, CouplingIdentity, PartnerIdentity, SceneIdentity, Store};
use crate::transfer::{Layers, Layout, Selection};
use crate::transport::{
    GroupBricks, Progress, SceneBake, SceneSettings, SceneSummary, Settings, bake_scene, needs_photons, pilot_scene,
};
use crate::volume::Solid;
use std::sync::atomic::Ordering;

/// The layout of a bake: in three channels where something stands around the volume.
pub fn layout_of_scene(plain: Layout, geometry: Option<&Geometry>) -> Layout {
    match geometry {
        Some(_) => Layout { layers: plain.layers.coloured(), ..plain },
        None => plain,
    }
}

impl Request<'_> {
    pub(super) fn scene_settings(&self, settings: &Settings) -> SceneSettings {
        SceneSettings {
            layers: settings.layers.clone(),
            rays: settings.rays,
            seed: settings.seed,
            caustics: self.effects.switched("caustics") != Some(false),
        }
    }

    fn scene_bake<'b>(
        &'b self,
        geometry: &'b Geometry,
        pyramid: &'b Pyramid,
        settings: &'b SceneSettings,
        selection: &'b Selection,
    ) -> SceneBake<'b> {
        SceneBake { volume: self.volume, pyramid, geometry, layout: &self.layout, settings, selection }
    }

    /// What a store of this scene is named by.
    pub(super) fn scene_identity(&self, geometry: &Geometry) -> SceneIdentity {
        SceneIdentity {
            fingerprint: geometry.fingerprint().into(),
            luminaires: geometry.luminaires().iter().map(|l| l.name.clone()).collect(),
            exponents: geometry.exponents(self.volume),
            coupling: geometry.among().map(|among| CouplingIdentity {
                coupling: among.coupling.clone(),
                name: among.name.clone(),
                place: among.place,
                tint: among.tint,
                partners: geometry.partners().iter().map(partner_identity).collect(),
            }),
        }
    }

    /// Refuses what bakes of scenes cannot do.
    pub(super) fn check_scene(&self, geometry: &Geometry) -> Result<()> {
        let refuse = |name: &str, remedy: &str| {
            let expected = "a volume without walls and luminaires";
            Err(Error::argument(name, "a scene that has them", expected, remedy))
        };
        if self.goal.error.is_some() || self.goal.seconds.is_some() {
            return refuse("an error or a time", "give a number of rays");
        }
        if self.estimator != Estimator::Path {
            return refuse("estimator", "leave it out: scenes are baked by path");
        }
        if self.effects.switched("shadowing").is_some() {
            return refuse("effects", "leave it out: among walls every texel is traced");
        }
        if self.scene_settings(&self.settings).caustics
            && let [first, ..] = needs_photons(geometry).as_slice()
        {
            let found = format!(
                "the luminaire {first}, a point or parallel light, beside glass, a curved mirror, or more than six flat ones"
            );
            let expected =
                "luminaires with an area, or flat mirrors: other caustics would need photons, which are not built";
            let remedy = "use a small sphere or rectangle, or leave its caustics out: --effects -caustics";
            return Err(Error::argument("caustics", found, expected, remedy));
        }
        Ok(())
    }

    /// The plan of a scene, from a trial of a few texels.
    pub(super) fn plan_of_scene(
        &self,
        geometry: &Geometry,
        pyramid: &Pyramid,
        selection: &Selection,
    ) -> Result<(scene::Pilot, scene::Surrounded)> {
        let photons = needs_photons(geometry);
        let settings = SceneSettings {
            rays: PILOT_RAYS,
            // The plan shall say what is wrong, not fail.
            caustics: photons.is_empty(),
            ..self.scene_settings(&self.settings)
        };
        let trial = pilot_scene(&self.scene_bake(geometry, pyramid, &settings, selection), PILOT_TEXELS)?;
        let s = &trial.summary;
        let mut before = 1.0;
        let escapes = (0..self.layout.layers.len()).map(|k| {
            let next = trial.mean_survival(k).min(before);
            let escaped = before - next;
            before = next;
            escaped
        });
        let pilot = scene::Pilot {
            texels: s.texels,
            valid: s.valid,
            paths: s.paths,
            rays: trial.counts.path_rays,
            escapes: escapes.collect(),
            lost_share: s.lost_share(),
            open: 0,
        };
        let surrounded = scene::Surrounded {
            parts: geometry.parts() as u64,
            luminaires: geometry.luminaires().iter().map(|l| l.name.clone()).collect(),
            specular: geometry.has_specular(),
            needs_photons: photons,
            path_rays: trial.counts.path_rays,
            wall_rays: trial.counts.wall_hits + trial.counts.specular_hits,
            light_rays: trial.counts.light_rays,
            partners: geometry.partners().iter().map(|p| p.name.clone()).collect(),
            coupling: geometry.among().map(|among| among.coupling.clone()).unwrap_or_default(),
            partner_rays: trial.counts.partner_rays,
            partner_hits: trial.counts.partner_hits,
            escape: s.mean_escapes().iter().sum(),
        };
        Ok((pilot, surrounded))
    }
}

fn partner_identity(partner: &Partner) -> PartnerIdentity {
    PartnerIdentity {
        name: partner.name.clone(),
        volume: partner.volume.content_hash(),
        solid: if partner.volume.solid == Solid::Above { "above" } else { "below" }.into(),
        tint: partner.tint,
        isovalues: partner.isovalue.knots().to_vec(),
    }
}

/// Bytes that the groups besides the environment add to a texel.
pub(super) fn bytes_of_groups(layers: &Layers, geometry: &Geometry) -> u64 {
    let groups = 1 + geometry.luminaires().len() as u64;
    groups * (layers.len() as u64 * (3 * 2 + 2) + 5)
}

pub(super) fn bake_part(
    job: &Request<'_>,
    geometry: &Geometry,
    pyramid: &Pyramid,
    store: &Store,
    settings: &Settings,
    part: &Part,
    progress: &Progress,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<()> {
    let settings = job.scene_settings(settings);
    let request = job.scene_bake(geometry, pyramid, &settings, &part.selection);
    // The environment last: a chunk is there when its texture is.
    let stores = request.groups().iter().map(|group| store.group(group)).collect::<Result<Vec<_>>>()?;
    let present = |chunk: [usize; 3]| {
        let mut all: GroupBricks = Vec::with_capacity(stores.len());
        for store in &stores {
            let Some((bricks, _)) = store.read_chunk(chunk)? else { return Ok(None) };
            all.push(bricks);
        }
        Ok(Some(all))
    };
    let (mut write, mut baked) = (0.0, 0);
    let mut sink = |chunk: [usize; 3], groups: GroupBricks| {
        let before = observer.seconds();
        let mut extent: ChunkExtent = store.chunk_extent(chunk)?.unwrap_or_default();
        part.claims.iter().for_each(|claim| extent.add(claim.clone()));
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
    let mut summary = SceneSummary::default();
    summary.add(&bake_scene(&request, &part.chunks, progress, &present, &mut sink)?);
    report.summary.add(&summary.summary);
    match &mut report.scene {
        Some(scene) => scene.add(&summary),
        None => report.scene = Some(summary),
    }
    report.write_seconds += write;
    report.chunks_baked += baked;
    Ok(())
}
