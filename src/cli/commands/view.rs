//! `isolume view`: the live page, served on this machine or written into one file.

use crate::cache::{Filled, InUse, MemberBakes};
use crate::cli::args::transfer::TransferArgs;
use crate::cli::args::volume::VolumeArgs;
use crate::cli::commands::cache::ready;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::lent::{details, filler};
use crate::cli::present::text;
use crate::error::Error;
use crate::export::atomic;
use crate::export::inputs::Inputs;
use crate::export::target::check_file;
use crate::probe::Probe;
use crate::scene::{ModelName, NamedIsovalue, SceneFile, TextureSize, open_probe};
use crate::transfer::store::{Store, check_store, is_store};
use crate::view::page::page_in_one_file;
use crate::view::server::{Coming, Server, Watched};
use crate::view::{Options, Package, package_of, page_probes, volume_shown};
use crate::volume::Isovalue;
use serde_json::json;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Instant;

/// Look at a store, a volume or a scene in the browser: every isosurface, relit interactively
///
/// Serves a page on 127.0.0.1 until Ctrl-C, for who has the address that is printed; or writes one file that opens
/// without a network. The page needs a browser with WebGL2. Environments (.hdr, .exr; up to 64 MB and 33 million
/// pixels) can be dropped onto it. A volume is baked first, for all its isovalues, into a store in the user's cache
/// folder, where the next run finds it; where that takes more than a moment, drafts are shown meanwhile. A scene is baked for those that it
/// lists, as by relight.
///
/// In a scene each luminaire has a slider, and where there are any the environment is dark at the beginning. What
/// walls do to the light is seen, the walls themselves are not drawn. Of several volumes one is shown, in the light of
/// all. The material is chosen on the page.
#[derive(clap::Args, Clone)]
#[command(after_help = "Examples:
  isolume view brain.isolume
  isolume view brain.isolume --html brain.html --texture-side 96 --env sunset.hdr
  isolume view brain.nii.gz --texture 0.5
  isolume view scene.toml
  isolume view mug.toml:64 --watch
  isolume view pair.isolume --volume gyroid")]
pub(in crate::cli) struct View {
    /// The store, or a volume file, field or scene (.toml) that is baked first
    #[arg(value_name = "X.isolume|VOLUME|SCENE")]
    input: String,
    /// Write the page with its data into one file instead: 8-bit coefficients, reduced resolution
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// The isovalue to begin with: a number, a percentage of the range, or auto; of several volumes that of the one
    /// shown
    #[arg(short, long, visible_alias = "isovalues", value_name = "C")]
    #[arg(default_value = "auto", allow_hyphen_values = true)]
    isovalue: Isovalue,
    /// Environments besides the embedded ones: image files or skies, as relight takes them
    #[arg(short, long, value_name = "PROBE")]
    env: Vec<String>,
    /// Which of several volumes baked together is shown [default: the first]
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    /// Most texels along an axis; more are reduced to their means [default: 256, in one file 96]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2048))]
    texture_side: Option<u32>,
    /// Most samples of the volume along an axis [default: 512, in one file 160]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2048))]
    volume_side: Option<u32>,
    /// Port to serve on [default: a free one]
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Accept a store whose bake is not finished: what is missing is filled from neighbours, or has no light
    #[arg(long)]
    partial: bool,
    /// Show a model or a scene (.toml) again whenever it is saved; with 16 rays a texel unless --rays or --error says more. What
    /// cannot be read meanwhile is told on the page
    #[arg(long, conflicts_with = "html")]
    watch: bool,
    /// Open the page in the browser of this system
    #[arg(long)]
    open: bool,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
    #[command(flatten, next_help_heading = "Bake of a volume")]
    transfer: TransferArgs,
    /// Where stores of volumes are kept [default: the user's cache folder; see isolume cache]
    #[arg(long, value_name = "DIR", help_heading = "Bake of a volume")]
    cache: Option<PathBuf>,
    /// Bake a scene for all isovalues, not only for those that it lists; of a volume all are baked
    #[arg(long, help_heading = "Bake of a volume")]
    all_isovalues: bool,
    #[arg(skip)]
    pub(in crate::cli) scene: Option<SceneFile>,
    #[arg(skip)]
    pub(in crate::cli) again: Option<(Vec<OsString>, ViewOf)>,
}

/// Who shows a draft.
type Shown<'a> = dyn FnMut(Package) -> Outcome + 'a;
/// A store, the isovalue that its field or model has, and what keeps it in the cache.
type Source = (Store, Option<f64>, Option<InUse>);

/// What reads a line again, once its scene says other options.
pub(in crate::cli) type ViewOf = fn(Vec<OsString>) -> Outcome<Box<View>>;

impl View {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        if let Some(path) = &self.html {
            check_file(path)?;
            Inputs::new(self.env.iter().chain([&self.input])).refuse(path)?;
        }
        // What cannot be read is refused before a bake, which may take minutes.
        self.env.iter().try_for_each(|name| self.open_probe(name).map(drop))?;
        let stamp = self.scene.as_ref().and_then(SceneFile::stamp);
        let watched = if self.watch { Some(Watched::new(ModelName::asked(&self.input)?.path, stamp)) } else { None };
        let mut server: Option<Server> = None;
        let mut draft = |package| {
            match &server {
                Some(server) => server.take(Ok(package), Coming::Finer),
                None => server = Some(self.serve(package, Coming::Finer, console)?),
            }
            console.note("a draft is on the page; the bake goes on");
            Ok(())
        };
        let made = self.made(seed, &mut draft, console);
        match (&self.html, watched, server) {
            (Some(path), ..) => return write_page(path, &made?, console),
            (_, Some(file), _) => self.serve(made?, Coming::Saved, console)?.watch(file, || {
                let again = self.again.as_ref().map(|(line, parse)| parse(line.clone())).transpose();
                let view = again.map(|view| view.as_deref().unwrap_or(self).made(seed, &mut |_| Ok(()), console));
                or_message(view.and_then(|made| made), console)
            })?,
            (.., Some(server)) => {
                server.take(or_message(made, console)?, Coming::Nothing);
                server.wait();
            }
            _ => self.serve(made?, Coming::Nothing, console)?.wait(),
        }
        Ok(())
    }

    /// What is shown at last; `draft` shows what is there before.
    fn made(&self, seed: u64, draft: &mut Shown<'_>, console: &Console) -> Outcome<Package> {
        let (store, own, _use) = self.store(seed, draft, console)?;
        self.package(&store, own, self.partial, console)
    }

    /// The store of what is shown, baked where it is not in the cache.
    fn store(&self, seed: u64, draft: &mut Shown<'_>, console: &Console) -> Outcome<Source> {
        let (of_volume, note) = (self.of_volume.as_deref(), |text: &str| console.note(text));
        if is_store(&self.input) || self.input.ends_with(".isolume") {
            check_store(&self.input)?;
            if self.all_isovalues {
                let remedy = "leave it out: a store shows what it holds";
                return Err(Error::argument("--all-isovalues", "with a store", "a scene", remedy).into());
            }
            self.volume.options().refuse_for("a store")?;
            let store = Store::open_telling(&self.input, !self.volume.no_map, note)?;
            return Ok((volume_shown(store, of_volume, &note)?, None, None));
        }
        let mut scene = self.transfer.scene(&self.volume).open(&self.input, self.scene.as_ref())?;
        let shown = of_volume.map_or(Ok(0), |name| scene.member_named(name))?;
        let own = scene.members().get(shown).and_then(|member| member.default_isovalue);
        let isovalues = self.isovalues_of_scene()?;
        let cache = ready(self.cache.as_deref())?;
        let start = Instant::now();
        let bands = self.scene.as_ref().map(SceneFile::bands).unwrap_or_default();
        let mut quality = self.transfer.quality(&bands, seed);
        // The page looks up a texture, whichever isovalues are listed.
        quality.texture.get_or_insert(TextureSize::Ratio(1.0));
        if self.watch && quality.error.is_none() {
            quality.rays.get_or_insert(16);
        }
        let fill = filler(start, console);
        let mut bakes = MemberBakes::new(&cache, &quality, self.scene.as_ref(), &fill, &note);
        let has_drafts = self.html.is_none() && !self.watch;
        let mut look = |filled: &Filled| draft(self.package(&filled.store, own, true, console)?);
        let told = |filled: &Filled| details(filled, console);
        let filled = bakes.bake_all(&mut scene, &isovalues, &told, (has_drafts, &mut look))?;
        cache.tidy(&note);
        Ok((volume_shown(filled.store, of_volume, &note)?, own, Some(filled.in_use)))
    }

    /// The isovalues that the scene lists, and the one to begin with; none where all are baked.
    fn isovalues_of_scene(&self) -> Outcome<Vec<NamedIsovalue>> {
        let listed = self.scene.iter().filter(|_| !self.all_isovalues).flat_map(SceneFile::listed_isovalues);
        let listed = listed.map(|text| text.parse().map_err(Failure::Message));
        let mut all = listed.collect::<Outcome<Vec<NamedIsovalue>>>()?;
        if !all.is_empty() && self.isovalue != Isovalue::Auto {
            all.push(NamedIsovalue { volume: self.of_volume.clone(), isovalue: self.isovalue });
        }
        Ok(all)
    }

    /// Opens an environment; an error names the line of the scene that it stands in.
    fn open_probe(&self, name: &str) -> Result<Probe, Error> {
        let in_scene = |error| self.scene.iter().fold(error, |error, file| file.at_environment(name, error));
        open_probe(name, false, None).map_err(in_scene)
    }

    fn package(&self, store: &Store, own: Option<f64>, partial: bool, console: &Console) -> Outcome<Package> {
        let given = self.env.iter().map(|name| self.open_probe(name)).collect::<Result<Vec<_>, _>>()?;
        let probes = page_probes(given, store)?;
        let options = Options::new(self.html.is_some(), self.texture_side, self.volume_side);
        let rotation = self.scene.as_ref().and_then(|file| file.description.probe.as_ref()?.rotation);
        let package = package_of(store, &probes, ((self.isovalue, own), rotation.unwrap_or(0.0), partial), &options)?;
        console.note(format!("{}: {}", self.input, package.describe(store, &options)));
        Ok(package)
    }

    fn serve(&self, package: Package, coming: Coming, console: &Console) -> Outcome<Server> {
        let server = Server::new(self.port, package, coming)?;
        let address = server.address();
        console.print(format!("{address}  (Ctrl-C ends it)"));
        console.print_json(&json!({ "address": address }));
        console.finish()?;
        if self.open {
            open_browser(address, console);
        }
        console.tell_progress(server.listener());
        Ok(server)
    }
}

/// A message in the place of an error, but where the user wants to stop.
fn or_message(made: Outcome<Package>, console: &Console) -> Outcome<Result<Package, String>> {
    match made {
        Err(Failure::Library(stopped @ Error::Stopped { .. })) => Err(stopped.into()),
        made => Ok(made.map_err(|failure| failure.to_string()).inspect_err(|message| console.note(message))),
    }
}

fn write_page(path: &std::path::Path, package: &Package, console: &Console) -> Outcome {
    let document = page_in_one_file(package)?;
    let size = document.len();
    console.note(format!("{}: will be {}", path.display(), text::bytes(size as f64)));
    atomic::write_bytes(path, document.as_bytes())?;
    console.summary(format!("{}  {}", path.display(), text::bytes(size as f64)));
    console.print_json(&json!({
        "path": path.display().to_string(), "bytes": size, "texels": package.texels, "samples": package.samples,
        "valid_texels": package.valid_texels,
    }));
    Ok(())
}

/// Asks the system for its browser; where there is none, the address on the terminal has to do.
fn open_browser(address: &str, console: &Console) {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    if let Err(error) = std::process::Command::new(program).arg(address).spawn() {
        console.note(format!("{program} did not start ({error}): open the address by hand"));
    }
}
