//! `isolume demo`: the whole way from a volume to lit surfaces, without any file.

use super::baking::{Told, fill, size_on_disk};
use super::console::Console;
use super::isovalue::Isovalue;
use super::relight::{Relight, Relit};
use super::{Cli, Command, Failure, Outcome, text};
use crate::bake::Request;
use crate::error::Error;
use crate::export::png::PngOptions;
use crate::export::sheet::{SheetStyle, Tile, contact_sheet};
use crate::export::{Image, atomic, png};
use crate::scene::Effects;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;
use crate::volume::{ReadHint, Volume, read};
use clap::Parser;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Bake and relight a small brain, without any file
///
/// The volume (the MNI152 template at 2 mm) and three small environments are inside the program. One surface is
/// lit by all three, another by one; the demo writes a transfer store, .glb files, pictures and a contact sheet.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  isolume demo --out isolume-demo")]
pub(super) struct Demo {
    /// Directory to write into; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "isolume-demo")]
    out: PathBuf,
}

/// See `examples/data/README.md` for its origin and licence.
const VOLUME: &[u8] = include_bytes!("../../examples/data/mni152_t1_2mm.nii.gz");
const VOLUME_NAME: &str = "mni152_t1_2mm";
/// The outside of the brain, and the border of white matter.
const ISOVALUES: [f64; 2] = [90.0, 160.0];
const ENVIRONMENTS: [&str; 3] = ["courtyard", "studio", "sunset"];
/// Rays a texel: a draft, so that the bake takes well below a minute on two cores.
const RAYS: u32 = 64;
/// From the front left and a little above.
const VIEW: &str = "30,15";
/// Brings the brightest part of the environments before the brain.
const ROTATE: &str = "240";
const SIZE: &str = "376x324";

impl Demo {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let start = Instant::now();
        std::fs::create_dir_all(&self.out).map_err(|e| Error::io(&self.out, "make the directory", e))?;
        let volume = read(VOLUME, &ReadHint { name: VOLUME_NAME.into(), ..ReadHint::default() })?;
        let d = volume.dims();
        let [outer, inner] = ISOVALUES;
        console.summary(format!(
            "1. A brain: {VOLUME_NAME}, {} × {} × {} samples, from inside the program (© Louis Collins, McConnell \
             Brain Imaging Centre, McGill University).",
            d[0], d[1], d[2]
        ));
        let store = self.out.join("brain.isolume");
        console.summary(format!(
            "\n2. Bake: the transfer of light at the texels that the isosurfaces {outer} and {inner} look up, {RAYS} rays \
             each, 4 layers (direct light and 3 bounces). No light is chosen yet."
        ));
        let (lines, json, seconds_bake) = bake(&volume, &store, seed, console)?;
        console.summary(indent(&lines));
        console
            .summary("\n3. Relight: environments multiplied with what is stored; nothing is traced but camera rays.");
        let mut lit = Vec::new();
        for (isovalue, environments) in [(outer, &ENVIRONMENTS[..]), (inner, &ENVIRONMENTS[2..])] {
            for suffix in ["glb", "png"] {
                let done = self.relight(&store, isovalue, environments, suffix, seed, console)?;
                lit.push(done);
            }
        }
        let mut rows = vec![["file", "isovalue", "light", "time", "noise"].map(String::from).to_vec()];
        for file in lit.iter().flat_map(|l| &l.files) {
            rows.push(vec![
                file.target.path.display().to_string(),
                text::number(file.isovalue, 6),
                file.env.clone(),
                text::duration(file.times.total()),
                text::percent(file.rms_over_mean),
            ]);
        }
        console.summary(indent(&text::table(&rows)));
        let transport_rays: u64 = lit.iter().map(|l| l.transport_rays).sum();
        console.summary(format!(
            "   transport rays: {transport_rays}; noise: standard error of the radiance, RMS over the vertices, over its mean"
        ));
        let sheet = self.out.join("sheet.png");
        write_sheet(&lit, &sheet)?;
        let seconds = start.elapsed();
        console.summary(format!(
            "\n4. All on one sheet: {}\n\nDone in {}. The .glb files open in any glTF viewer. Then your own volume:\n  \
             isolume info FILE\n  isolume relight FILE --isovalue auto --env courtyard -o surface.glb",
            sheet.display(),
            text::duration(seconds)
        ));
        console.print_json(&json!({
            "store": store.display().to_string(),
            "bake": json,
            "files": lit.iter().flat_map(|l| &l.files).map(|f| json!({
                "path": f.target.path.display().to_string(), "isovalue": f.isovalue, "environment": f.env,
                "error_rms_over_mean": f.rms_over_mean, "seconds": f.times.total().as_secs_f64(),
            })).collect::<Vec<_>>(),
            "sheet": sheet.display().to_string(),
            "transport_rays_of_relight": transport_rays,
            "seconds": { "bake": seconds_bake, "all": seconds.as_secs_f64() },
        }));
        Ok(())
    }

    /// Runs the command that a user would type, and shows it.
    fn relight(
        &self,
        store: &Path,
        isovalue: f64,
        environments: &[&str],
        suffix: &str,
        seed: u64,
        console: &Console,
    ) -> Outcome<Relit> {
        let isovalue = isovalue.to_string();
        let name = if environments.len() > 1 { "{env}" } else { environments[0] };
        let output = self.out.join(format!("brain-{isovalue}-{name}.{suffix}"));
        let (store, output) = (store.display().to_string(), output.display().to_string());
        let mut line = vec!["isolume", "relight", &store, "--isovalue", &isovalue];
        for environment in environments {
            line.extend(["--env", environment]);
        }
        line.extend(["--env-rotate", ROTATE]);
        if suffix == "png" {
            line.extend(["--view", VIEW, "--size", SIZE]);
        }
        line.extend(["-o", &output]);
        console.summary(format!("   $ {}", command_lines(&line)));
        let relight = parse(&line)?;
        relight.execute(seed, console)
    }
}

/// A command on lines that fit, as a shell takes them.
fn command_lines(words: &[&str]) -> String {
    const INDENT: &str = "       ";
    let mut lines = vec![String::new()];
    for word in words {
        let option = word.starts_with('-');
        if let Some(line) = lines.last_mut() {
            // An option stays with its value.
            if option && line.chars().count() > text::WIDTH - 36 {
                lines.push(format!("{INDENT}{word}"));
            } else {
                line.push_str(if line.is_empty() { "" } else { " " });
                line.push_str(word);
            }
        }
    }
    lines.join(" \\\n")
}

fn parse(line: &[&str]) -> Outcome<Box<Relight>> {
    match Cli::try_parse_from(line) {
        Ok(Cli { command: Command::Relight(relight), .. }) => Ok(relight),
        Ok(_) => Err(Failure::Message("the demo's own command is not relight; please report this".into())),
        Err(e) => Err(Failure::Message(format!("the demo's own command is wrong, please report this: {e}"))),
    }
}

fn bake(volume: &Volume, store: &Path, seed: u64, console: &Console) -> Outcome<(String, serde_json::Value, f64)> {
    let start = Instant::now();
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: Layers::uniform(4, 5)? };
    let settings = Settings { layers: layout.layers.clone(), rays: RAYS, seed, target: None, positive: false };
    let isovalues: Vec<f64> = ISOVALUES
        .iter()
        .map(|&c| Isovalue::Value(c).resolve(volume, Some(volume.solid), None).map(|c| c.value))
        .collect::<Result<_, _>>()?;
    let effects = Effects::default();
    let job = Request { isovalues: Some(isovalues), ..Request::new(volume, VOLUME_NAME, layout, settings, &effects) };
    let (_, report) = fill(&job, store, start, console)?;
    let bytes = size_on_disk(store);
    Ok((report.summary_line(bytes), report.json(bytes), start.elapsed().as_secs_f64()))
}

fn write_sheet(lit: &[Relit], path: &Path) -> Outcome {
    let pictures: Vec<(&Image, String)> = lit
        .iter()
        .flat_map(|l| &l.files)
        .filter_map(|f| Some((f.image.as_ref()?, format!("isovalue {}, {}", f.isovalue, f.env))))
        .collect();
    let tiles: Vec<Tile<'_>> = pictures.iter().map(|(image, label)| Tile { image, label }).collect();
    let style = SheetStyle { columns: Some(2), margin: 16, ..SheetStyle::default() };
    let sheet = contact_sheet(&tiles, &style)?;
    let software = Some(concat!("isolume ", env!("CARGO_PKG_VERSION")).into());
    atomic::write(path, |w| png::write(w, &sheet, &PngOptions { software, ..PngOptions::default() }))?;
    Ok(())
}

fn indent(text: &str) -> String {
    text.lines().map(|line| format!("   {line}")).collect::<Vec<_>>().join("\n")
}
