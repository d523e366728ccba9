//! `isolume relight`: light on surfaces, from a store, in milliseconds.

mod assets;
mod file;
mod joint;
mod lobes;
mod report;
mod work;

pub(super) use joint::resolve;

use super::console::Console;
use super::input::VolumeArgs;
use super::inputs::Inputs;
use super::isovalue::{Chosen, Isovalue, NamedIsovalue, check_count};
use super::light::{LightArgs, MaterialArgs, open_probe};
use super::options::TransferArgs;
use super::picture::PictureArgs;
use super::{Failure, Outcome, info, options, text};
use crate::error::Error;
use crate::probe::MOST_SUNS;
use crate::probe::{Probe, SunOptions, SunSplit, split_sun};
use crate::scene::geometry::Geometry;
use crate::scene::{EmissionRule, MaterialRule, Scene, SceneFile};
use crate::session::{LightNote, LightOptions, Part, Session};
use crate::sh::Window;
use crate::transfer::store::{FRONT_NOT_RECORDED, Store};
use crate::volume::Volume;
use crate::volume::isovalue::Level;
use assets::MeshArgs;
use file::Written;
use report::report;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use work::{Source, Work};

/// Light isosurfaces by environments and write them as .glb, .ply, .stl or .png
///
/// From a store transfer and light are multiplied; rays are traced to lamps that bands would blur, no others. A volume is baked first, for the
/// isovalues asked for, into a store in the user's cache folder; the next run finds it there. Where that takes
/// longer than a moment, a draft of 16 rays a texel is written first, then replaced.
#[derive(clap::Args, Clone)]
#[command(override_usage = "isolume relight [OPTIONS] -i <C[,…]> -e <PROBE> -o <FILE> <INPUT>")]
#[command(after_help = "Examples:
  isolume relight brain.isolume --isovalue 90 --env courtyard -o brain.glb
  isolume relight brain.isolume --isovalue 90,160 --env studio -o {isovalue}.png
  isolume relight brain.isolume --isovalue 90 --env sunset.exr --env sky -o out/
  isolume relight bumpbox:96 --isovalue auto --env sun:-45,30 -o bumps.png
  isolume relight orbital.cube --isovalue 0.03,-0.03 --env studio -o orbital.png   (both lobes)
  isolume relight brain.isolume --isovalue 90 --env courtyard --for web --lod 20000 -o brain.glb
  isolume relight head.nii.gz --isovalue bone --env studio --keep-largest -o skull.png
  isolume relight scene.toml --exposure -1")]
pub(in crate::cli) struct Relight {
    /// Store, or a volume file, field or scene (.toml) that is baked first
    #[arg(value_name = "X.isolume|VOLUME|SCENE")]
    input: String,
    /// Isovalues: numbers in the file's values, 40% of their range, 1.5sigma from the mean, 1.5rms from 0, enclosed:5% of
    /// the volume, 300HU, bone, skin, otsu, or auto. Two of opposite sign without {isovalue} in the output are the lobes of
    /// a field about 0, in one picture. Of several volumes baked together isovalues are those of the first; NAME=C is that
    /// of another, and all surfaces that belong to it are lit
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "[NAME=]C[,…]",
        value_delimiter = ',',
        required = true,
        allow_hyphen_values = true
    )]
    isovalue: Vec<NamedIsovalue>,
    /// Environment: an image file, courtyard, studio, sunset, or a sky: constant, gradient, overcast, sky, sun:AZ,EL
    /// (azimuth counter-clockwise from the centre of an image, glTF +X)
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// File to write, or several; the ending decides the format. For several surfaces: a name with {isovalue} and {env},
    /// or a directory
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Write an empty file, instead of an error, for an isovalue that no surface has
    #[arg(long)]
    allow_empty: bool,
    /// Light only this one of several volumes baked together; isovalues are then its own
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    #[command(flatten, next_help_heading = "Light")]
    light: LightArgs,
    #[command(flatten, next_help_heading = "Material")]
    material: MaterialArgs,
    #[command(flatten, next_help_heading = "Mesh files")]
    mesh: MeshArgs,
    #[command(flatten, next_help_heading = "Pictures")]
    picture: PictureArgs,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
    #[command(flatten, next_help_heading = "Bake of a volume")]
    transfer: TransferArgs,
    /// Where stores of volumes are kept [default: the user's cache folder; see isolume cache]
    #[arg(long, value_name = "DIR", help_heading = "Bake of a volume")]
    cache: Option<PathBuf>,
    /// Write no draft before the result
    #[arg(long, help_heading = "Bake of a volume")]
    no_draft: bool,
    #[arg(skip)]
    pub(in crate::cli) scene: Option<SceneFile>,
}

/// Share of the light of a lamp that dominates.
const DOMINANT: f64 = 0.15;

/// What a run of the command did.
struct Relit {
    surfaces: Vec<LitSurface>,
    files: Vec<Written>,
    read_time: Duration,
    transport_rays: u64,
    drafts: Vec<Draft>,
}

/// An isosurface in numbers.
struct LitSurface {
    isovalue: f64,
    vertices: u64,
    triangles: u64,
    bricks: u64,
    /// Whether its vertices have transfer of their own.
    at_vertices: bool,
    below_a_texel: f64,
    extract_time: Duration,
    select_time: Duration,
}

impl LitSurface {
    fn new(part: &Part, extract_time: Duration, select_time: Duration) -> Self {
        let mesh = part.isosurface().mesh();
        Self {
            isovalue: part.isosurface().isovalue(),
            vertices: mesh.positions_in_grid.len() as u64,
            triangles: mesh.triangles.len() as u64,
            bricks: part.bricks().len() as u64,
            at_vertices: part.isosurface().transfer().is_some(),
            below_a_texel: part.below_a_texel(),
            extract_time,
            select_time,
        }
    }
}

/// A first version of the files, written before the bake was done.
struct Draft {
    rays: u32,
    texture: [usize; 3],
    /// From the start of the command until all files were written.
    written_after: Duration,
}

impl Relight {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        report(console, &self.execute(seed, console)?);
        Ok(())
    }

    /// Lights and writes; prints no result.
    fn execute(&self, seed: u64, console: &Console) -> Outcome<Relit> {
        let start = Instant::now();
        if let Some(scale) = self.mesh.scale
            && !(scale.is_finite() && scale > 0.0)
        {
            return Err(Error::argument("--scale", scale, "a positive number", "give metres to a world unit").into());
        }
        let inputs = self.inputs();
        self.output.iter().try_for_each(|output| inputs.refuse(output))?;
        // Whatever can be wrong is refused before the bake, which may take minutes.
        self.material.rule((0.0, 1.0))?;
        let probes = self.open_probes(console)?;
        check_count(self.isovalue.len())?;
        if info::is_store(&self.input) {
            self.volume.options().refuse_for("a store")?;
            self.refuse_effects_of_bakes()?;
            let store = Store::open(&self.input)?;
            if store.identity().scene.as_ref().is_some_and(|scene| scene.coupling.is_some()) {
                return self.light_members(&store, None, 0, &probes, start, console);
            }
            self.refuse_names("the store holds one volume alone")?;
            let volume = store.volume()?;
            for note in volume.notes.iter().filter(|note| note.text == FRONT_NOT_RECORDED) {
                if self.volume.frame_of.is_none() {
                    console.note(format!("{} (--frame-of anatomical)", note.text));
                }
            }
            if store.identity().scene.is_none() {
                self.tell_of_lamps(&probes, console);
            }
            let chosen = self.isovalues_of_store(&store, &volume)?;
            let work = Work::new(self, &volume, &chosen, &probes, start, console)?;
            let source = Source { store, transport_rays: 0 };
            return work.light(&source, Vec::new());
        }
        let options = self.volume.options_with(self.transfer.shadowing());
        let scene = match &self.scene {
            Some(file) => file.open(&options, &self.transfer.effects())?,
            None => Scene::open_with(&self.input, &options, &self.transfer.effects())?,
        };
        let mut scene = options::add_media(scene, &self.transfer)?;
        if scene.members().len() > 1 {
            return self.light_scene(scene, &probes, seed, start, console);
        }
        self.refuse_names("this is one volume alone")?;
        let Some(opened) = scene.members_mut().first_mut() else {
            return Err(Failure::Message("a scene without volumes".into()));
        };
        let resolve = |i: &NamedIsovalue| {
            let resolved = self.or_empty(&i.isovalue, &opened.volume, opened.choose(i.isovalue));
            resolved.map_err(|e| options::in_scene(e, self.scene.as_ref(), &i.isovalue))
        };
        let chosen = self.isovalue.iter().map(resolve).collect::<Result<Vec<_>, Error>>()?;
        if let Some(levels) = lobes::levels(self, opened, &chosen) {
            let [above, below] = levels.map(|level| text::number(level, 6));
            let reason = chosen[0].reason.as_ref().map(|r| format!(": {r}")).unwrap_or_default();
            console.note(format!("two lobes, above {above} and below {below}{reason}; they light each other"));
            let (command, file) = lobes::scene(self, opened, levels)?;
            drop(scene);
            let scene = file.open(&command.volume.options(), &command.transfer.effects())?;
            return Relight { scene: Some(file), ..command }.light_scene(scene, &probes, seed, start, console);
        }
        let chosen = self.with_more(chosen, console);
        opened.take_side(&chosen)?;
        for note in &opened.volume.notes {
            console.note(&note.text);
        }
        let mut work = Work::new(self, &opened.volume, &chosen, &probes, start, console)?;
        work.geometry = opened.geometry.as_ref();
        if opened.geometry.is_none() {
            self.tell_of_lamps(&probes, console);
        }
        work.bake_and_light(&opened.label, seed)
    }

    /// What is read.
    fn inputs(&self) -> Inputs {
        Inputs::new(self.env.iter().chain([&self.input])).with_scene(self.scene.as_ref())
    }

    /// Bakes the volumes of a scene of several, and lights them.
    fn light_scene(
        &self,
        scene: Scene,
        probes: &[Probe],
        seed: u64,
        start: Instant,
        console: &Console,
    ) -> Outcome<Relit> {
        let baked = joint::bake(self, scene, probes, (seed, start), console)?;
        let done = self.light_members(&baked.store, baked.geometry.as_ref(), baked.rays, probes, start, console)?;
        baked.cache.tidy(console);
        drop(baked.in_use);
        Ok(done)
    }

    /// Whether an output has a name of its own for each isovalue.
    fn tells_isovalues_apart(&self, output: &Path) -> bool {
        let text = output.to_string_lossy();
        text.contains("{isovalue}") || output.is_dir() || text.ends_with(['/', '\\'])
    }

    /// The isovalues with those that belong to them, such as further labels, where there is a file for each; else a note.
    fn with_more(&self, chosen: Vec<Chosen>, console: &Console) -> Vec<Chosen> {
        let has_files = self.output.iter().all(|output| self.tells_isovalues_apart(output));
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
                let list: Vec<String> = left_out.iter().map(|level| text::number(level.value, 6)).collect();
                console.note(format!("not shown: {}; give them with --isovalue", list.join(", ")));
            }
        }
        all
    }

    /// Lights the volumes of a store together, or the one that is named.
    fn light_members(
        &self,
        store: &Store,
        geometry: Option<&Geometry>,
        transport_rays: u64,
        probes: &[Probe],
        start: Instant,
        console: &Console,
    ) -> Outcome<Relit> {
        if let Some(name) = &self.of_volume {
            if let Some(other) = self.isovalue.iter().filter_map(|i| i.volume.as_ref()).find(|v| *v != name) {
                let remedy = "leave out one of them";
                return Err(Error::argument("--isovalue", format!("{other}=…"), format!("{name}=…"), remedy).into());
            }
            let store = store.of_volume(name)?;
            let volume = store.volume()?;
            let chosen = self.isovalues_of_store(&store, &volume)?;
            let work = Work::new(self, &volume, &chosen, probes, start, console)?;
            return work.light(&Source { store, transport_rays }, Vec::new());
        }
        let session = Session::open(store)?.with_geometry(geometry);
        let up = self.volume.options().up_of(session.up())?;
        let session = session.with_up(up);
        let volume = session.members()[0].volume();
        let resolved = self.isovalue.iter().map(|i| resolve(&session, i)).collect::<Result<Vec<_>, Error>>()?;
        let (chosen, isovalues): (Vec<Chosen>, Vec<Vec<f64>>) = resolved.into_iter().unzip();
        let work = Work::new(self, volume, &chosen, probes, start, console)?;
        work.light_in(&session, &isovalues, transport_rays, Vec::new())
    }

    /// Names of volumes make sense only where there are several.
    fn refuse_names(&self, why: &str) -> Outcome {
        let named =
            self.isovalue.iter().find_map(|i| i.volume.as_ref()).map(|name| ("--isovalue", format!("{name}=…")));
        match self.of_volume.as_ref().map(|name| ("--volume", name.clone())).or(named) {
            None => Ok(()),
            Some((option, given)) => {
                let expected = "a store or a scene of several volumes";
                Err(Error::argument(option, given, expected, format!("{why}: leave the name out")).into())
            }
        }
    }

    fn open_probes(&self, console: &Console) -> Outcome<Vec<Probe>> {
        let mut probes = Vec::new();
        for argument in &self.env {
            let probe = open_probe(argument, self.light.keep_negative, self.light.layout)
                .map_err(|error| self.in_scene(error, argument))?;
            for note in &probe.notes {
                console.note(format!("{}: {} ({})", probe.name, note.text, text::count(note.count)));
            }
            probes.push(probe);
        }
        Ok(probes)
    }

    /// Says what a lamp that stays in light of a few bands does to it, and what helps.
    fn tell_of_lamps(&self, probes: &[Probe], console: &Console) {
        let options = self.light_options(false);
        let why = match (options.split_sun, options.window) {
            (SunSplit::Off, _) if self.mesh.transfer && self.sun_split().is_none() => "--transfer carries no rays",
            (SunSplit::Auto, window) if window != Window::None => "--window leaves it there",
            _ => return,
        };
        for probe in probes {
            let split = split_sun(probe, &SunOptions::default());
            if let Some(lamp) = split.suns.first().filter(|lamp| lamp.flux_share > DOMINANT) {
                console.note(format!(
                    "{}: a lamp {:.1}° across has {} of the light and stays in it ({why}): a few bands blur its shadows; \
                     --sun-split lights it directly",
                    probe.name,
                    2.0 * lamp.sun.angular_radius.to_degrees(),
                    text::percent(lamp.flux_share)
                ));
            }
        }
    }

    /// Names the line of the scene that an environment stands in.
    fn in_scene(&self, error: Error, environment: &str) -> Error {
        match &self.scene {
            Some(file) if file.environment().as_deref() == Some(environment) => {
                let line = file.description.probe.as_ref().map_or(1, |probe| probe.name.line);
                file.description.at_line(line, error)
            }
            _ => error,
        }
    }

    /// What a store holds cannot be switched any more.
    fn refuse_effects_of_bakes(&self) -> Outcome {
        let effects = self.transfer.effects();
        let Some(name) = ["shadowing", "interreflection"].into_iter().find(|n| effects.switched(n).is_some()) else {
            return Ok(());
        };
        let given = format!("{name} with a store");
        let expected = "an effect that is not in the store already";
        let remedy = "switch it at the bake, or relight the volume itself";
        Err(Error::argument("--effects", given, expected, remedy).into())
    }

    /// Albedo over the isovalue: as options say, else the scene.
    fn albedo_rule(&self, range: (f64, f64)) -> Outcome<MaterialRule> {
        match self.scene.as_ref().and_then(|file| file.description.albedo.as_ref()) {
            Some(albedo) if !self.material.says_albedo() => Ok(albedo.rule(range)),
            _ => self.material.rule(range),
        }
    }

    /// Emission over the isovalue: as options say, else the scene; none where it is switched off.
    fn emission_rule(&self) -> EmissionRule {
        if self.transfer.effects().switched("emission") == Some(false) {
            return EmissionRule::Constant([0.0; 3]);
        }
        let of_scene = self.scene.as_ref().and_then(|file| file.description.emission.clone());
        match self.material.emission {
            Some(emission) => EmissionRule::Constant(emission.0),
            None => of_scene.unwrap_or(EmissionRule::Constant([0.0; 3])),
        }
    }

    /// Which lamps are lit apart, where that was asked for.
    fn sun_split(&self) -> Option<SunSplit> {
        match self.transfer.effects().switched("sun-split") {
            Some(false) => Some(SunSplit::Off),
            Some(true) => Some(self.light.sun_split.filter(|split| *split != SunSplit::Off).unwrap_or_default()),
            None => self.light.sun_split,
        }
    }

    /// How environments light a volume alone, or a scene: there lamps are split off only where that was asked for, and
    /// then refused.
    fn light_options(&self, in_scene: bool) -> LightOptions {
        let otherwise = if in_scene || self.mesh.transfer { SunSplit::Off } else { SunSplit::Auto };
        let split = match self.sun_split() {
            Some(SunSplit::Auto) if in_scene => SunSplit::Lobes(MOST_SUNS),
            asked => asked.unwrap_or(otherwise),
        };
        self.light.options(split)
    }

    /// Whether a note is for who gave the command: that no lamp was split off is for who asked for it.
    fn tells(&self, note: &LightNote) -> bool {
        !matches!(note, LightNote::NoSun(_)) || self.sun_split().is_some()
    }

    /// The isovalues asked for; `auto` is the one that the store holds, if it holds only some.
    fn isovalues_of_store(&self, store: &Store, volume: &Volume) -> Outcome<Vec<Chosen>> {
        if let Some(side) = self.volume.solid
            && crate::volume::Solid::from(side) != volume.solid
        {
            let expected = format!("the side the store was baked for, {}", store.identity().solid);
            let given = format!("{side:?}").to_lowercase();
            return Err(Error::argument("--solid", given, expected, "bake the volume again with this --solid").into());
        }
        // Looks at every chunk, so only where it matters.
        let only = if self.isovalue.iter().any(|i| i.isovalue == Isovalue::Auto) {
            let held = store.holdings()?;
            held.isovalues.first().copied().filter(|_| !held.all)
        } else {
            None
        };
        let resolve = |i: &NamedIsovalue| match (&i.isovalue, only) {
            (Isovalue::Auto, Some(value)) => {
                Ok(Chosen { reason: Some("the store holds it".into()), ..Chosen::given(value, volume.solid) })
            }
            (isovalue, _) => self.or_empty(isovalue, volume, isovalue.resolve(volume, Some(volume.solid), None)),
        };
        Ok(self.isovalue.iter().map(resolve).collect::<Result<Vec<_>, Error>>()?)
    }

    /// An isovalue for a volume; with `--allow-empty` one that no surface has, too.
    fn or_empty(&self, isovalue: &Isovalue, volume: &Volume, resolved: Result<Chosen, Error>) -> Result<Chosen, Error> {
        match resolved {
            Err(_) if self.allow_empty => {
                let value = if let Isovalue::Value(value) = isovalue { *value } else { volume.value_range().1 };
                let reason = Some("no surface has it; what is written is empty".into());
                Ok(Chosen { reason, ..Chosen::given(value, volume.solid) })
            }
            resolved => resolved,
        }
    }
}
