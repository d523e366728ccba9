//! Several volumes that were baked together, lit together: one file or picture holds the surfaces of all.

use super::Relight;
use crate::bake::{Goal, Request, Writing, layout_of_scene};
use crate::cli::baking::{self, Told};
use crate::cli::cache::{Cache, InUse};
use crate::cli::console::Console;
use crate::cli::isovalue::{Chosen, Isovalue, NamedIsovalue};
use crate::cli::light::Lighting;
use crate::cli::scene;
use crate::cli::scene_light::{Factor, contracted};
use crate::cli::surface::Surface;
use crate::cli::{Failure, Outcome, options, text};
use crate::error::{Error, Result};
use crate::geom::Bounds;
use crate::level::Pyramid;
use crate::relight::{Contracted, Material};
use crate::render::{Camera, RenderOptions, Subject, radiance_along};
use crate::scene::geometry::Geometry;
use crate::scene::{IsovalueMap, Scene};
use crate::transfer::store::{CouplingIdentity, Store};
use crate::volume::Volume;
use glam::{DVec3, Vec3};
use std::path::PathBuf;
use std::time::Instant;

/// A volume of a store of several.
pub(in crate::cli) struct Member {
    pub(in crate::cli) store: Store,
    pub(in crate::cli) volume: Volume,
    pub(in crate::cli) pyramid: Pyramid,
    coupling: CouplingIdentity,
}

/// All volumes of a store; the first one's isovalues need no name.
pub(in crate::cli) struct Members(Vec<Member>);

impl Members {
    /// The volumes of a store; `None` where one stands alone.
    pub(in crate::cli) fn of(store: &Store) -> Outcome<Option<Self>> {
        let coupling = |store: &Store| store.identity().scene.as_ref().and_then(|scene| scene.coupling.clone());
        let Some(first) = coupling(store) else { return Ok(None) };
        let held = store.volumes()?;
        if let Some(missing) = first.partners.iter().find(|p| !held.contains(&p.name)) {
            let found = format!("{} without its partner {}", held.join(", "), missing.name);
            let remedy = "go on with the bake of the scene: the same command";
            return Err(Error::argument("store", found, "all volumes of the scene", remedy).into());
        }
        let mut all = Vec::new();
        for name in held {
            let store = store.of_volume(&name)?;
            let Some(coupling) = coupling(&store) else { continue };
            let volume = store.volume()?;
            all.push(Member { pyramid: Pyramid::new(&volume), store, volume, coupling });
        }
        Ok(Some(Self(all)))
    }

    /// The first, and the others.
    pub(super) fn split(&self) -> Option<(&Member, &[Member])> {
        self.0.split_first()
    }

    /// All of them, in their order.
    pub(in crate::cli) fn all(self) -> Vec<Member> {
        self.0
    }

    /// The one of a name.
    pub(super) fn take(self, name: &str) -> Outcome<Store> {
        let first = self.0.into_iter().next();
        match first {
            Some(member) => Ok(member.store.of_volume(name)?),
            None => Err(Failure::Message("a store without volumes".into())),
        }
    }

    /// The isovalue of each volume.
    pub(in crate::cli) fn resolve(&self, named: &NamedIsovalue) -> Result<(Chosen, Vec<f64>)> {
        let from = match &named.volume {
            None => 0,
            Some(name) => self.0.iter().position(|m| m.coupling.name == *name).ok_or_else(|| self.unknown(name))?,
        };
        let of = &self.0[from];
        let only = match named.isovalue {
            Isovalue::Auto => {
                let held = of.store.holdings()?;
                held.isovalues.first().copied().filter(|_| !held.all)
            }
            _ => None,
        };
        let chosen = match only {
            Some(value) => {
                Chosen { reason: Some("the store holds it".into()), ..Chosen::given(value, of.volume.solid) }
            }
            None => named.isovalue.resolve(&of.volume, Some(of.volume.solid), None)?,
        };
        let mut all = Vec::new();
        for member in &self.0 {
            let partner = of.coupling.partners.iter().find(|p| p.name == member.coupling.name);
            all.push(partner.map_or(Ok(chosen.value), |p| partnered(of, member, &p.isovalues, chosen.value))?);
        }
        let reason = all.iter().zip(&self.0).map(|(c, m)| format!("{} {}", m.coupling.name, text::number(*c, 6)));
        let reason = reason.collect::<Vec<_>>().join(", ");
        Ok((
            Chosen {
                reason: Some(chosen.reason.map_or(reason.clone(), |r| format!("{r}; {reason}"))),
                ..Chosen::given(all[0], self.0[0].volume.solid)
            },
            all,
        ))
    }

    fn unknown(&self, name: &str) -> Error {
        let names: Vec<&str> = self.0.iter().map(|m| m.coupling.name.as_str()).collect();
        let remedy = match text::nearest(name, names.iter().copied()) {
            Some(near) => format!("did you mean {near}?"),
            None => "see `isolume info` of the store".into(),
        };
        Error::argument("--isovalue", format!("{name}=…"), format!("one of {}", names.join(", ")), remedy)
    }
}

/// The isovalue of a partner that belongs to one of a volume.
fn partnered(of: &Member, partner: &Member, knots: &[[f64; 2]], isovalue: f64) -> Result<f64> {
    let map = IsovalueMap::from_knots(knots.to_vec());
    let (low, high) = match (knots.first(), knots.last()) {
        (Some(first), Some(last)) => (first[0], last[0]),
        _ => {
            let (a, b) = (of.volume.value_range(), partner.volume.value_range());
            (a.0.max(b.0), a.1.min(b.1))
        }
    };
    if (low..=high).contains(&isovalue) {
        return Ok(map.at(isovalue));
    }
    let name = &of.coupling.name;
    let given = format!("{name}={}, which has no partner in {}", text::number(isovalue, 8), partner.coupling.name);
    let expected = match low == high {
        true => format!("{}, the one of {name} that has", text::number(low, 8)),
        false => format!("{} to {}", text::number(low, 8), text::number(high, 8)),
    };
    let remedy = "choose such a one, or give the pair in the `coupling` of the scene and bake anew";
    Err(Error::argument("--isovalue", given, expected, remedy))
}

/// The surface of another volume, with what lights it.
pub(in crate::cli) struct Companion<'a> {
    pub(super) member: &'a Member,
    pub(super) surface: Surface,
}

impl<'a> Companion<'a> {
    pub(super) fn new(member: &'a Member, isovalue: f64) -> Result<Self> {
        let surface = Surface::new(&member.volume, &member.pyramid, member.store.layout().lattice, isovalue)?;
        Ok(Self { member, surface })
    }

    /// Its texels under a light.
    pub(in crate::cli) fn contracted(
        &self,
        lighting: &Lighting,
        material: &Material,
        factors: &[Factor],
    ) -> Outcome<Contracted> {
        let mut found = contracted(&self.member.store, &self.surface.bricks, lighting, material, factors)?;
        if lighting.certified {
            found.clamp_negative();
        }
        Ok(found)
    }

    /// Points around which all of it lies, in world.
    pub(in crate::cli) fn points(&self) -> impl Iterator<Item = DVec3> {
        self.surface.seen(&self.member.volume)
    }

    /// The box of its volume in world.
    pub(in crate::cli) fn bounds(&self) -> Bounds {
        self.member.volume.world_bounds()
    }

    /// What a camera ray sees of it, and how far away.
    pub(in crate::cli) fn seen(
        &self,
        contracted: &Contracted,
        lighting: &Lighting,
        material: &Material,
        (camera, options): (&Camera, &RenderOptions),
        (origin, direction): (DVec3, DVec3),
    ) -> Option<([f32; 3], f64)> {
        let (volume, pyramid) = (&self.member.volume, &self.member.pyramid);
        let (isovalue, light) = (self.surface.isovalue, &lighting.light);
        // Its transfer has its own factor in it; what shows without transfer has not.
        let tint = self.member.coupling.tint;
        let material = &Material { albedo: std::array::from_fn(|c| material.albedo[c] * tint[c]), ..*material };
        let subject = Subject { volume, pyramid, isovalue, contracted, light, material };
        radiance_along(&subject, camera, options, origin, direction)
    }
}

/// Positions, normals and triangles of several surfaces as one, around the centre of their boxes.
pub(super) struct Merged {
    pub(super) bounds: Bounds,
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Merged {
    pub(super) fn new(volume: &Volume, surface: &Surface, companions: &[Companion<'_>]) -> Self {
        let parts = || companions.iter().map(|c| (&c.member.volume, &c.surface));
        let all = || std::iter::once((volume, surface)).chain(parts());
        let bounds = all().fold(Bounds::EMPTY, |bounds, (volume, _)| {
            let own = volume.world_bounds();
            bounds.including(own.min).including(own.max)
        });
        let mut merged = Self { bounds, positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
        for (volume, surface) in all() {
            let first = merged.positions.len() as u32;
            let shift = volume.world_bounds().centre() - bounds.centre();
            merged.positions.extend(surface.positions().iter().map(|p| (p.as_dvec3() + shift).as_vec3()));
            merged.normals.extend(surface.normals());
            merged.triangles.extend(surface.mesh.triangles.iter().map(|t| t.map(|i| first + i)));
        }
        merged
    }
}

/// The store of a scene of several volumes, in the cache.
pub(super) struct Baked {
    pub(super) store: Store,
    /// What stands around the first of them.
    pub(super) geometry: Option<Geometry>,
    /// Rays that were traced.
    pub(super) rays: u64,
    pub(super) cache: Cache,
    pub(super) in_use: Option<InUse>,
}

/// Bakes what all volumes of a scene need for the isovalues asked for.
pub(super) fn bake(command: &Relight, scene: Scene, seed: u64, start: Instant, console: &Console) -> Outcome<Baked> {
    let transfer = &command.transfer;
    let cache = Cache::locate(command.cache.as_deref())?;
    cache.prepare()?;
    let (effects, mut path, mut found, mut rays): (_, Option<PathBuf>, _, _) = (transfer.effects(), None, None, 0);
    let mut in_use = None;
    let bands = command.scene.as_ref().and_then(scene::bands).unwrap_or(vec![5]);
    for (member, opened) in scene.members().iter().enumerate() {
        opened.volume.notes.iter().for_each(|note| console.note(&note.text));
        let volume = &*opened.volume;
        let resolve = |named: &NamedIsovalue| {
            let chosen = opened.choose_named(named.volume.as_deref(), named.isovalue);
            chosen.map_err(|e| options::in_scene(e, command.scene.as_ref(), &named.isovalue))
        };
        let isovalues = command.isovalue.iter().map(|i| Ok(resolve(i)?.value)).collect::<Result<Vec<f64>>>()?;
        let geometry = opened.geometry.as_ref();
        let layout = layout_of_scene(transfer.layout(volume, &bands)?, geometry);
        let settings = transfer.settings(&layout, seed, false);
        let job = Request {
            goal: Goal { error: transfer.error, ..Goal::default() },
            isovalues: Some(isovalues),
            memory_limit: transfer.memory_limit,
            writing: if path.is_none() { Writing::of_cache() } else { Writing::default() },
            geometry,
            ..Request::new(volume, &opened.label, layout, settings, &effects)
        };
        baking::check(&job)?;
        let path = path.get_or_insert_with(|| cache.place(&job));
        let filled = cache.fill(&job, path, start, console)?;
        rays += filled.report.summary.counts.rays;
        cache.tell(&filled.report, Some(&volume.name), path, console);
        if filled.report.chunks_baked > 0 {
            console.detail(filled.report.lines(baking::size_on_disk(path)));
        }
        in_use = Some(filled.in_use);
        if member == 0 {
            found = opened.geometry.clone();
        }
    }
    let Some(path) = path else { return Err(Failure::Message("a scene without volumes".into())) };
    Ok(Baked { store: Store::open(path)?, geometry: found, rays, cache, in_use })
}
