//! `isolume view`: the live page, served on this machine or written into one file.

mod http;
mod server;

use super::baking;
use super::cache::{Cache, Filled, InUse};
use super::console::Console;
use super::info::{self, check_store};
use super::input::VolumeArgs;
use super::inputs::Inputs;
use super::isovalue::Isovalue;
use super::light::open_probe;
use super::options::TransferArgs;
use super::output::check_file;
use super::{Outcome, text};
use crate::bake::{Goal, Request};
use crate::error::Error;
use crate::export::atomic;
use crate::probe::{EMBEDDED, Probe};
use crate::scene::Member;
use crate::transfer::store::Completeness;
use crate::transfer::store::Store;
use crate::view::page::page_in_one_file;
use crate::view::{Coding, Options, Package, Subject, pack};
use serde_json::json;
use server::Server;
use std::io::Write;
use std::path::PathBuf;

/// Look at a store or a volume in the browser: every isosurface, relit interactively
///
/// Serves a page on 127.0.0.1 until Ctrl-C, for who has the address that is printed; or writes one file that opens
/// without a network. The page needs a browser with WebGL2. Environments (.hdr, .exr; up to 64 MB and 33 million pixels)
/// can be dropped onto it. A volume is baked first, for all its isovalues, into a store in the user's cache folder, where
/// the next run finds it.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume view brain.isolume
  isolume view brain.isolume --html brain.html --texture-side 96 --env sunset.hdr
  isolume view brain.nii.gz --texture 0.5")]
pub(super) struct View {
    /// The store, or a volume file or field that is baked first
    #[arg(value_name = "X.isolume|VOLUME")]
    input: String,
    /// Write the page with its data into one file instead: 8-bit coefficients, reduced resolution
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// The isovalue to begin with: a number, a percentage of the range, or auto
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    isovalue: Isovalue,
    /// Environments besides the embedded ones: image files or skies, as relight takes them
    #[arg(short, long, value_name = "PROBE")]
    env: Vec<String>,
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
}

impl View {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        if let Some(path) = &self.html {
            check_file(path)?;
            Inputs::new(self.env.iter().chain([&self.input])).refuse(path)?;
        }
        let (store, _use) = self.store(seed, console)?;
        let package = self.package(&store, console)?;
        match &self.html {
            Some(path) => write_page(path, &package, console),
            None => self.serve(package, console),
        }
    }

    /// The store, or that of the volume, baked where it is not in the cache.
    fn store(&self, seed: u64, console: &Console) -> Outcome<(Store, Option<InUse>)> {
        if info::is_store(&self.input) || self.input.ends_with(".isolume") {
            check_store(&self.input)?;
            return Ok((Store::open(&self.input)?, None));
        }
        if self.input.ends_with(".toml") {
            let (expected, remedy) =
                ("a store or a volume", "bake the scene and relight it; the page shows volumes alone");
            return Err(Error::argument("input", &self.input, expected, remedy).into());
        }
        let opened = Member::open(&self.input, &self.volume.options_with(self.transfer.shadowing()))?;
        opened.volume.check_cells()?;
        opened.volume.notes.iter().for_each(|note| console.note(&note.text));
        let layout = self.transfer.layout(&opened.volume, &[5])?;
        let settings = self.transfer.settings(&layout, seed, false);
        let effects = self.transfer.effects();
        let job = Request {
            goal: Goal { error: self.transfer.error, ..Goal::default() },
            memory_limit: self.transfer.memory_limit,
            ..Request::new(&opened.volume, &opened.label, layout, settings, &effects)
        };
        baking::check(&job)?;
        let cache = Cache::locate(self.cache.as_deref())?;
        cache.prepare()?;
        let path = cache.place(&job);
        let Filled { store, report, in_use } = cache.fill(&job, &path, std::time::Instant::now(), console)?;
        cache.tell(&report, None, &path, console);
        cache.tidy(console);
        Ok((store, Some(in_use)))
    }

    fn package(&self, store: &Store, console: &Console) -> Outcome<Package> {
        let volume = store.volume()?;
        Completeness::of(store, &volume)?.check(store, self.partial)?;
        let held = store.holdings()?;
        let isovalue = match held.isovalues.first() {
            Some(&first) if !held.all && self.isovalue == Isovalue::Auto => first,
            _ => self.isovalue.resolve(&volume, Some(volume.solid), None)?.value,
        };
        let names = self.env.iter().map(String::as_str).chain(EMBEDDED);
        let mut probes: Vec<Probe> = names.map(|name| open_probe(name, false, None)).collect::<Result<_, _>>()?;
        probes.dedup_by(|a, b| a.name == b.name);
        let one_file = self.html.is_some();
        let options = Options {
            texture_side: self.texture_side.map_or(if one_file { 96 } else { 256 }, |n| n as usize),
            volume_side: self.volume_side.map_or(if one_file { 160 } else { 512 }, |n| n as usize),
            coding: if one_file { Coding::Byte } else { Coding::Half },
        };
        let layout = store.layout();
        let identity = store.identity();
        let triple = |[x, y, z]: [usize; 3]| format!("{x} × {y} × {z}");
        let rays = if held.rays[0] == held.rays[1] {
            held.rays[0].to_string()
        } else {
            format!("{} to {}", held.rays[0], held.rays[1])
        };
        let about = [
            ("volume", format!("{}, {} samples", volume.name, triple(volume.dims()))),
            ("solid", format!("{} the isovalue", identity.solid)),
            ("texture", format!("{} texels", triple(layout.lattice.texels()))),
            ("layers", format!("{} with {:?} bands", layout.layers.len(), layout.layers.bands())),
            ("estimator", format!("{}, {rays} rays a texel, seed {}", identity.estimator, identity.seed)),
            ("isovalues", info::isovalues_text(&held)),
            ("store", identity.hash()[..16].to_string()),
            ("program", concat!("isolume ", env!("CARGO_PKG_VERSION")).into()),
        ];
        let subject = Subject {
            volume: &volume,
            source: store,
            isovalues: (!held.all).then(|| held.isovalues.clone()),
            about: about.map(|(name, text)| (name.to_string(), text)).to_vec(),
            probes: &probes,
            isovalue,
        };
        let package = pack(&subject, &options)?;
        let reduced = |from: [usize; 3], to: [usize; 3]| {
            if from == to { triple(to) } else { format!("{} (of {})", triple(to), triple(from)) }
        };
        let coding = match options.coding {
            Coding::Half => "16-bit floats",
            Coding::Byte => "8 bits with a scale to each coefficient",
        };
        console.note(format!(
            "{}: samples {}, texels {}; {} texels with a level set × {} coefficients in {coding}, {}",
            self.input,
            reduced(volume.dims(), package.samples),
            reduced(layout.lattice.texels(), package.texels),
            text::count(package.valid_texels),
            layout.layers.coefficients(),
            text::bytes(package.payload.len() as f64),
        ));
        Ok(package)
    }

    fn serve(&self, package: Package, console: &Console) -> Outcome {
        let server = Server::new(self.port, package)?;
        let address = server.address()?;
        console.print(format!("{address}  (Ctrl-C ends it)"));
        console.print_json(&json!({ "address": address }));
        console.finish()?;
        if self.open {
            open_browser(&address, console);
        }
        server.run();
        Ok(())
    }
}

fn write_page(path: &std::path::Path, package: &Package, console: &Console) -> Outcome {
    let document = page_in_one_file(package)?;
    let size = document.len();
    console.note(format!("{}: will be {}", path.display(), text::bytes(size as f64)));
    atomic::write(path, |w| w.write_all(document.as_bytes()).map_err(|e| Error::io(path, "write", e)))?;
    console.summary(format!("{}  {}", path.display(), text::bytes(size as f64)));
    console.print_json(&json!({
        "path": path.display().to_string(), "bytes": size, "texels": package.texels, "samples": package.samples,
        "valid_texels": package.valid_texels,
    }));
    Ok(())
}

/// Asks the system for its browser; where there is none, the address on the terminal has to do.
fn open_browser(address: &str, console: &Console) {
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        "xdg-open"
    };
    if let Err(error) = std::process::Command::new(program).arg(address).spawn() {
        console.note(format!("{program} did not start ({error}): open the address by hand"));
    }
}
