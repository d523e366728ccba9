//! From a store, a volume or a scene to files of lit surfaces: what has no store is baked first, into the cache, with drafts
//! before a bake that takes long.

mod lobes;
mod meshes;
mod several;
mod work;

use crate::bake::Quality;
use crate::cache::{Cache, Filled, Filler, Note};
use crate::error::{Error, Result};
use crate::export::inputs::Inputs;
use crate::export::simplify::Lod;
use crate::probe::{MOST_SUNS, Probe, SunOptions, SunSplit, split_sun};
use crate::quantity::{number, percent};
use crate::render::Viewpoint;
use crate::scene::geometry::Geometry;
use crate::scene::{NamedIsovalue, SceneFile, SceneOptions, VolumeOptions, check_count};
use crate::session::{
    LightOptions, LuminaireFactor, MaterialChoice, MeshOptions, Part, PictureOptions, Session, Turntable, WrittenFile,
};
use crate::sh::Window;
use crate::transfer::store::{FRONT_NOT_RECORDED, Store, is_store};
use crate::volume::isovalue::{Chosen, Level};
use crate::volume::{Isovalue, Volume};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use work::{Source, Work};

/// What is to be lit, how, and into which files.
#[derive(Clone)]
pub struct Job<'a> {
    /// A store, a volume file, a field, or a scene.
    pub input: &'a str,
    /// The scene, where it was read already.
    pub scene: Option<&'a SceneFile>,
    /// Isovalues; of several volumes those of the first, where no other is named.
    pub isovalues: Vec<NamedIsovalue>,
    /// Only this one of several volumes; isovalues are then its own.
    pub of_volume: Option<&'a str>,
    /// The environments.
    pub probes: &'a [Probe],
    /// Files, or patterns of them with `{isovalue}`, `{env}` and, of turntables, `{frame}`; or folders.
    pub outputs: &'a [PathBuf],
    /// What is read, and so not written.
    pub inputs: &'a Inputs,
    /// Whether an isovalue that no surface has makes an empty file.
    pub allow_empty: bool,
    /// How what has no store is opened.
    pub how: SceneOptions,
    /// How what has no store is baked.
    pub quality: Quality,
    /// How environments light, but for lamps.
    pub light: LightOptions,
    /// Which lamps are lit apart, where that is said.
    pub sun_split: Option<SunSplit>,
    /// Factors on luminaires.
    pub luminaires: &'a [LuminaireFactor],
    /// What surfaces are made of.
    pub material: MaterialChoice,
    /// How meshes are written.
    pub mesh: MeshOptions,
    /// How many triangles are left in mesh files: a file for each; all of them, if there is none.
    pub lods: &'a [Lod],
    /// From where pictures are taken.
    pub view: Viewpoint,
    /// How pictures look, but for the view.
    pub picture: PictureOptions,
    /// Pictures of a turntable.
    pub turntable: Option<Turntable>,
    /// Whether drafts come before a bake that takes long.
    pub drafts: bool,
}

/// What a job needs of who runs it; `E` is that one's error.
#[derive(Clone, Copy)]
pub struct Host<'a, E> {
    /// The cache, made ready; asked where something is baked.
    pub cache: &'a dyn Fn() -> std::result::Result<Cache, E>,
    /// Who bakes.
    pub fill: &'a Filler<'a>,
    /// Who is told of a bake that is done.
    pub filled: &'a dyn Fn(&Filled),
    /// Who is told what the user should know.
    pub note: &'a Note<'a>,
    /// Seconds since the job was asked for.
    pub seconds: &'a dyn Fn() -> f64,
}

/// What a job did.
pub struct Relit {
    /// The isosurfaces.
    pub surfaces: Vec<LitSurface>,
    /// The files.
    pub files: Vec<WrittenFile>,
    /// What pictures are, in words.
    pub views: String,
    /// Seconds until light could begin.
    pub read_seconds: f64,
    /// Rays of bakes.
    pub transport_rays: u64,
    /// First versions of the files.
    pub drafts: Vec<Draft>,
}

/// An isosurface in numbers.
pub struct LitSurface {
    /// In the values of its volume.
    pub isovalue: f64,
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Bricks of the texture, or of its vertices.
    pub bricks: u64,
    /// Whether its vertices have transfer of their own.
    pub at_vertices: bool,
    /// Share of it that bends within a texel.
    pub below_a_texel: f64,
    /// Seconds of extraction.
    pub extract_seconds: f64,
    /// Seconds of finding its bricks.
    pub select_seconds: f64,
}

/// A first version of the files, written before the bake was done.
pub struct Draft {
    /// Rays a texel or vertex.
    pub rays: u32,
    /// Texels along the axes.
    pub texture: [usize; 3],
    /// Until all files were written.
    pub written_after_seconds: f64,
}

/// Share of the light of a lamp that dominates.
const DOMINANT: f64 = 0.15;

impl LitSurface {
    fn new(part: &Part, extract_seconds: f64, select_seconds: f64) -> Self {
        let mesh = part.isosurface().mesh();
        Self {
            isovalue: part.isosurface().isovalue(),
            vertices: mesh.positions_in_grid.len() as u64,
            triangles: mesh.triangles.len() as u64,
            bricks: part.bricks().len() as u64,
            at_vertices: part.isosurface().transfer().is_some(),
            below_a_texel: part.below_a_texel(),
            extract_seconds,
            select_seconds,
        }
    }
}

impl Relit {
    /// For programs.
    pub fn to_json(&self) -> Value {
        let surface = |s: &LitSurface| {
            json!({
                "isovalue": s.isovalue,
                "vertices": s.vertices,
                "triangles": s.triangles,
                "bricks": s.bricks,
                "at_vertices": s.at_vertices,
                "seconds": { "extract": s.extract_seconds, "select": s.select_seconds },
            })
        };
        let draft = |d: &Draft| {
            json!({
                "rays_per_texel": d.rays, "texels": d.texture, "written_after_seconds": d.written_after_seconds,
            })
        };
        json!({
            "surfaces": self.surfaces.iter().map(surface).collect::<Vec<_>>(),
            "files": self.files.iter().map(WrittenFile::to_json).collect::<Vec<_>>(),
            "seconds": { "read": self.read_seconds },
            "drafts": self.drafts.iter().map(draft).collect::<Vec<_>>(),
            "transport_rays": self.transport_rays,
            "camera_rays": self.files.iter().map(|w| w.camera.rays).sum::<u64>(),
            "sun_rays": self.files.iter().map(|w| w.sun_rays).sum::<u64>(),
        })
    }
}

impl Job<'_> {
    /// Lights and writes.
    ///
    /// # Errors
    /// When something cannot be read, baked or written; [`Error::Unbaked`] when a store lacks texels.
    pub fn run<E: From<Error>>(&self, host: &Host<'_, E>) -> std::result::Result<Relit, E> {
        check_count(self.isovalues.len())?;
        if is_store(self.input) {
            return Ok(self.light_store(host)?);
        }
        let mut scene = self.how.open(self.input, self.scene)?;
        if scene.members().len() > 1 {
            return self.light_scene(&scene, host);
        }
        self.refuse_names("this is one volume alone")?;
        let Some(opened) = scene.members_mut().first_mut() else {
            return Err(Error::argument("scene", "no volume", "at least one", "give a volume").into());
        };
        let resolve = |i: &NamedIsovalue| {
            let resolved = self.or_empty(i.isovalue, &opened.volume, opened.choose(i.isovalue));
            resolved.map_err(|e| self.scene.iter().fold(e, |e, file| file.at_isovalue(i.isovalue, e)))
        };
        let chosen = self.isovalues.iter().map(resolve).collect::<Result<Vec<_>>>()?;
        if let Some(levels) = lobes::levels(self, opened, &chosen) {
            let [above, below] = levels.map(|level| number(level, 6));
            let reason = chosen[0].reason.as_ref().map(|r| format!(": {r}")).unwrap_or_default();
            (host.note)(&format!("two lobes, above {above} and below {below}{reason}; they light each other"));
            let (job, file) = lobes::scene(self, opened, levels)?;
            drop(scene);
            let scene = file.open(
                &VolumeOptions { shadowing: Default::default(), ..job.how.volume.clone() },
                &job.quality.effects,
            )?;
            return Job { scene: Some(&file), ..job }.light_scene(&scene, host);
        }
        let chosen = self.with_more(chosen, host.note);
        opened.take_side(&chosen)?;
        opened.volume.notes.iter().for_each(|note| (host.note)(&note.text));
        let mut work = Work::new(self, &opened.volume, &chosen, host.note, host.seconds)?;
        work.geometry = opened.geometry.as_ref();
        if opened.geometry.is_none() {
            self.tell_of_lamps(host.note);
        }
        work.bake_and_light(opened, host)
    }

    fn light_store<E>(&self, host: &Host<'_, E>) -> Result<Relit> {
        self.how.volume.refuse_for("a store")?;
        self.refuse_effects_of_bakes()?;
        let store = Store::open_telling(self.input, self.how.volume.choice.map, host.note)?;
        if store.identity().scene.as_ref().is_some_and(|scene| scene.coupling.is_some()) {
            self.how.volume.refuse_exact_of_several()?;
            return self.light_members(&store, None, 0, host);
        }
        self.refuse_names("the store holds one volume alone")?;
        let mut volume = store.volume()?;
        self.how.volume.exact_in_store(&mut volume)?;
        for note in volume.notes.iter().filter(|note| note.text == FRONT_NOT_RECORDED) {
            if self.how.volume.front.is_none() {
                (host.note)(&format!("{} (--frame-of anatomical)", note.text));
            }
        }
        if store.identity().scene.is_none() {
            self.tell_of_lamps(host.note);
        }
        let chosen = self.isovalues_of_store(&store, &volume)?;
        let work = Work::new(self, &volume, &chosen, host.note, host.seconds)?;
        work.light(&Source { store, transport_rays: 0 }, Vec::new())
    }

    /// Whether an output has a name of its own for each isovalue.
    fn tells_isovalues_apart(&self, output: &Path) -> bool {
        let text = output.to_string_lossy();
        text.contains("{isovalue}") || output.is_dir() || text.ends_with(['/', '\\'])
    }

    /// The isovalues with those that belong to them, such as further labels, where there is a file for each; else a note.
    fn with_more(&self, chosen: Vec<Chosen>, note: &Note<'_>) -> Vec<Chosen> {
        let has_files = self.outputs.iter().all(|output| self.tells_isovalues_apart(output));
        let mut all = Vec::new();
        for one in chosen {
            let (same, other): (Vec<Level>, Vec<Level>) = one.more.iter().partition(|level| level.solid == one.solid);
            let left_out: Vec<Level> = if has_files { other } else { one.more.clone() };
            let (solid, reason) = (one.solid, one.reason.clone());
            all.push(one);
            if has_files {
                all.extend(same.iter().map(|l| Chosen { reason: reason.clone(), ..Chosen::given(l.value, solid) }));
            }
            if !left_out.is_empty() {
                let list: Vec<String> = left_out.iter().map(|level| number(level.value, 6)).collect();
                note(&format!("not shown: {}; give them with --isovalue", list.join(", ")));
            }
        }
        all
    }

    /// Lights the volumes of a store together, or the one that is named.
    fn light_members<E>(
        &self,
        store: &Store,
        geometry: Option<&Geometry>,
        transport_rays: u64,
        host: &Host<'_, E>,
    ) -> Result<Relit> {
        if let Some(name) = self.of_volume {
            if let Some(other) = self.isovalues.iter().filter_map(|i| i.volume.as_ref()).find(|v| *v != name) {
                let remedy = "leave out one of them";
                return Err(Error::argument("--isovalue", format!("{other}=…"), format!("{name}=…"), remedy));
            }
            let store = store.of_volume(name)?;
            let volume = store.volume()?;
            let chosen = self.isovalues_of_store(&store, &volume)?;
            let work = Work::new(self, &volume, &chosen, host.note, host.seconds)?;
            return work.light(&Source { store, transport_rays }, Vec::new());
        }
        let session = Session::open(store)?.with_geometry(geometry);
        let up = self.how.volume.up_of(session.up())?;
        let session = session.with_up(up);
        let volume = session.members()[0].volume();
        let resolved = self.isovalues.iter().map(|i| session.choose(i)).collect::<Result<Vec<_>>>()?;
        let (chosen, isovalues): (Vec<Chosen>, Vec<Vec<f64>>) = resolved.into_iter().unzip();
        let work = Work::new(self, volume, &chosen, host.note, host.seconds)?;
        work.light_in(&session, &isovalues, transport_rays, Vec::new())
    }

    /// Names of volumes make sense only where there are several.
    fn refuse_names(&self, why: &str) -> Result<()> {
        let named =
            self.isovalues.iter().find_map(|i| i.volume.as_ref()).map(|name| ("--isovalue", format!("{name}=…")));
        match self.of_volume.map(|name| ("--volume", name.to_string())).or(named) {
            None => Ok(()),
            Some((option, given)) => {
                let expected = "a store or a scene of several volumes";
                Err(Error::argument(option, given, expected, format!("{why}: leave the name out")))
            }
        }
    }

    /// Says what a lamp that stays in light of a few bands does to it, and what helps.
    fn tell_of_lamps(&self, note: &Note<'_>) {
        let options = self.light_options(true);
        let why = match (options.split_sun, options.window) {
            (SunSplit::Off, _) if self.mesh.transfer && self.asked_split().is_none() => "--transfer carries no rays",
            (SunSplit::Auto, window) if window != Window::None => "--window leaves it there",
            _ => return,
        };
        for probe in self.probes {
            let split = split_sun(probe, &SunOptions::default());
            if let Some(lamp) = split.suns.first().filter(|lamp| lamp.flux_share > DOMINANT) {
                note(&format!(
                    "{}: a lamp {:.1}° across has {} of the light and stays in it ({why}): a few bands blur its shadows; \
                     --sun-split lights it directly",
                    probe.name,
                    2.0 * lamp.sun.angular_radius.to_degrees(),
                    percent(lamp.flux_share)
                ));
            }
        }
    }

    /// What a store holds cannot be switched any more.
    fn refuse_effects_of_bakes(&self) -> Result<()> {
        let effects = &self.quality.effects;
        let Some(name) = ["shadowing", "interreflection"].into_iter().find(|n| effects.switched(n).is_some()) else {
            return Ok(());
        };
        let given = format!("{name} with a store");
        let expected = "an effect that is not in the store already";
        let remedy = "switch it at the bake, or relight the volume itself";
        Err(Error::argument("--effects", given, expected, remedy))
    }

    /// Which lamps are lit apart, where that was asked for.
    fn asked_split(&self) -> Option<SunSplit> {
        match self.quality.effects.switched("sun-split") {
            Some(false) => Some(SunSplit::Off),
            Some(true) => Some(self.sun_split.filter(|split| *split != SunSplit::Off).unwrap_or_default()),
            None => self.sun_split,
        }
    }

    /// How environments light a volume alone, or a scene; `splits`: whether lamps can be lit apart there. Where they cannot they are
    /// only if that was asked for, and then refused.
    fn light_options(&self, splits: bool) -> LightOptions {
        let otherwise = if !splits || self.mesh.transfer { SunSplit::Off } else { SunSplit::Auto };
        let split = match self.asked_split() {
            Some(SunSplit::Auto) if !splits => SunSplit::Lobes(MOST_SUNS),
            asked => asked.unwrap_or(otherwise),
        };
        LightOptions { split_sun: split, ..self.light.clone() }
    }

    /// The isovalues asked for; `auto` is the one that the store holds, if it holds only some.
    fn isovalues_of_store(&self, store: &Store, volume: &Volume) -> Result<Vec<Chosen>> {
        if let Some(side) = self.how.volume.solid
            && side != volume.solid
        {
            let expected = format!("the side the store was baked for, {}", store.identity().solid);
            let given = format!("{side:?}").to_lowercase();
            return Err(Error::argument("--solid", given, expected, "bake the volume again with this --solid"));
        }
        let resolve = |i: &NamedIsovalue| self.or_empty(i.isovalue, volume, store.choose(volume, i.isovalue));
        self.isovalues.iter().map(resolve).collect()
    }

    /// An isovalue for a volume; where empty files are allowed one that no surface has, too.
    fn or_empty(&self, isovalue: Isovalue, volume: &Volume, resolved: Result<Chosen>) -> Result<Chosen> {
        match resolved {
            Err(_) if self.allow_empty => {
                let value = if let Isovalue::Value(value) = isovalue { value } else { volume.value_range().1 };
                let reason = Some("no surface has it; what is written is empty".into());
                Ok(Chosen { reason, ..Chosen::given(value, volume.solid) })
            }
            resolved => resolved,
        }
    }
}
