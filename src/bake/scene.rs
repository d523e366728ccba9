//! What a scene adds to a request: its identity, what its estimator cannot do, and its plan.

use super::plan::{PILOT_RAYS, PILOT_TEXELS};
use super::{Estimator, Request, bytes_of_texel};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::scene::geometry::{Among, Geometry, Partner};
use crate::scene::{self, IsovalueMap, Scene};
use crate::transfer::store::{BodyIdentity, CouplingIdentity, PartnerIdentity, SceneIdentity, Store};
use crate::transfer::{Layers, Layout, Selection};
use crate::transport::{Bake, Settings, needs_photons, pilot, translucent};
use crate::volume::Solid;
use std::sync::Arc;

/// The layout of a bake: in three channels where something stands around the volume.
pub fn layout_of_scene(plain: Layout, geometry: Option<&Geometry>) -> Layout {
    match geometry {
        Some(geometry) => {
            let bands = plain.layers.bands();
            // One layer a node, all of the bands of the first.
            let nodes = geometry.body().and_then(|body| Layers::new(vec![bands[0]; body.layers()]).ok());
            Layout { layers: nodes.unwrap_or(plain.layers).coloured(), ..plain }
        }
        None => plain,
    }
}

impl Request<'_> {
    /// What a store of this scene is named by.
    pub(super) fn scene_identity(&self, geometry: &Geometry) -> SceneIdentity {
        SceneIdentity {
            fingerprint: geometry.fingerprint().into(),
            luminaires: geometry.luminaires().iter().map(|l| l.name.clone()).collect(),
            exponents: geometry.exponents(self.volume),
            media: !geometry.media().is_empty(),
            body: geometry.body().map(|body| BodyIdentity {
                index: body.index,
                nodes: body.nodes.clone(),
                albedo: body.medium.albedo.at(0.0),
            }),
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
        match self.estimator {
            Estimator::Photon => {
                let expected = "a volume alone: photons do not tell how often light meets the surface again, which a store of a \
                    scene holds for emission and for what lies beyond its layers";
                let remedy = "use path or gather; compare --against photon says what photons make of the surface";
                return Err(Error::argument("estimator photon", "a scene", expected, remedy));
            }
            Estimator::Gather if geometry.body().is_some() => return Err(translucent()),
            Estimator::Gather | Estimator::Path => {}
        }
        if self.effects.switched("shadowing").is_some() {
            let (found, expected) = ("a scene that has them", "a volume without walls and luminaires");
            let remedy = "leave it out: among walls every texel is traced";
            return Err(Error::argument("effects", found, expected, remedy));
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
        let settings = Settings { rays: PILOT_RAYS, target: None, ..self.settings.clone() };
        let bake = self.bake(pyramid, &settings, selection);
        // The plan shall say what is wrong, not fail.
        let trial = pilot(&Bake { caustics: photons.is_empty(), ..bake }, PILOT_TEXELS)?;
        let mut before = 1.0;
        let escapes = (1..=self.layout.layers.len()).map(|k| {
            let next = trial.mean_survival(k).min(before);
            let escaped = before - next;
            before = next;
            escaped
        });
        let pilot = scene::Pilot {
            texels: trial.texels,
            valid: trial.valid,
            paths: trial.paths,
            rays: trial.scene.path_rays,
            escapes: escapes.collect(),
            lost_share: trial.lost_share(),
            open: 0,
        };
        let surrounded = scene::Surrounded {
            parts: geometry.parts() as u64,
            luminaires: geometry.luminaires().iter().map(|l| l.name.clone()).collect(),
            keeps_lamps: geometry.keeps_lamps(),
            specular: geometry.has_specular(),
            needs_photons: photons,
            path_rays: trial.scene.path_rays,
            wall_rays: trial.scene.wall_hits + trial.scene.specular_hits,
            light_rays: trial.scene.light_rays,
            partners: geometry.partners().iter().map(|p| p.name.clone()).collect(),
            coupling: geometry.among().map(|among| among.coupling.clone()).unwrap_or_default(),
            media: geometry
                .media()
                .iter()
                .map(|m| scene::MediumForecast { name: m.name.clone(), depth_bound: m.depth_bound(self.volume) })
                .collect(),
            body: geometry.body().map(|body| scene::BodyForecast {
                index: body.index,
                depth: body.medium.depth_bound(self.volume),
                nodes: body.nodes.len(),
            }),
            collisions: trial.scene.collisions,
            partner_rays: trial.scene.partner_rays,
            partner_hits: trial.scene.partner_hits,
            escape: trial.mean_escapes().iter().sum(),
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

/// What stood around the volume of a store when it was baked; `None` for a volume alone.
///
/// A store holds what walls and luminaires do to light, not their shapes: these come from `scene`, the one that was
/// baked. Volumes beside each other are all in the store, and where nothing else stands there no scene is needed.
///
/// # Errors
/// When the store is of walls or luminaires and no scene is given; when the scene has others than the store was baked
/// with, or nothing; when the store lacks a volume of the scene, or is damaged.
pub fn surroundings(store: &Store, scene: Option<&Scene>) -> Result<Option<Geometry>> {
    let Some(identity) = &store.identity().scene else {
        let around = scene.and_then(|scene| scene.members().first()?.geometry.as_ref());
        return match around {
            None => Ok(None),
            Some(_) => {
                let remedy = "leave the scene out, or give the store that was baked of it";
                Err(Error::argument("scene", "walls, luminaires or volumes", "those of the store: none", remedy))
            }
        };
    };
    let found = match (scene, &identity.coupling) {
        (Some(scene), coupling) => {
            let place = coupling.as_ref().map_or(0, |coupling| coupling.place);
            scene.members().get(place).and_then(|member| member.geometry.clone())
        }
        (None, Some(coupling)) if identity.luminaires.is_empty() => Some(beside(store, coupling)?),
        (None, _) => None,
    };
    match (found, scene) {
        (Some(geometry), _) if geometry.fingerprint() == identity.fingerprint => Ok(Some(geometry)),
        (_, None) => {
            let remedy = "give the scene that it was baked of, as in --scene scene.toml";
            let found = "a store, which holds what walls and luminaires do to light and not their shapes";
            Err(Error::argument("scene", found, "the description of the walls and luminaires", remedy))
        }
        (found, Some(_)) => {
            let digits = |hash: &str| hash.get(..16).unwrap_or(hash).to_owned();
            let found = found.map_or("nothing around the volume".into(), |g| digits(g.fingerprint()));
            let expected =
                format!("the one that the store was baked of, fingerprint {}", digits(&identity.fingerprint));
            let remedy = "give that description as it was, with the same files; or bake the new one into another store";
            Err(Error::argument("scene", found, expected, remedy))
        }
    }
}

/// The volumes beside that of a store, from the same store.
fn beside(store: &Store, coupling: &CouplingIdentity) -> Result<Geometry> {
    let partner = |known: &PartnerIdentity| {
        let volume = store.of_volume(&known.name)?.volume()?;
        let pyramid = Arc::new(Pyramid::new(&volume));
        let isovalue = IsovalueMap::from_knots(known.isovalues.clone());
        Ok(Partner { name: known.name.clone(), volume: Arc::new(volume), pyramid, isovalue, tint: known.tint })
    };
    let partners = coupling.partners.iter().map(partner).collect::<Result<Vec<_>>>()?;
    let CouplingIdentity { coupling, name, place, tint, .. } = coupling.clone();
    Geometry::new(Vec::new(), Vec::new(), 1.0)?.with_partners(Among { name, place, coupling, tint }, partners)
}

/// Bytes of a texel in a store, with those of the groups that stand around the volume.
pub fn bytes_of_scene_texel(layers: &Layers, geometry: Option<&Geometry>) -> u64 {
    bytes_of_texel(layers) + geometry.map_or(0, |geometry| bytes_of_groups(layers, geometry))
}

/// Bytes that the groups besides the environment add to a texel.
pub(super) fn bytes_of_groups(layers: &Layers, geometry: &Geometry) -> u64 {
    let groups = 1 + geometry.luminaires().len() as u64;
    groups * (layers.len() as u64 * (3 * 2 + 2) + 5)
}
