//! `isolume demo`: the whole way from a volume to lit surfaces, without any file.

use super::bake_report::Told;
use super::baking::fill;
use super::console::Console;
use super::isovalue::Isovalue;
use super::{Outcome, text};
use crate::bake::Request;
use crate::error::Error;
use crate::export::png::PngOptions;
use crate::export::sheet::{SheetStyle, Tile, contact_sheet};
use crate::export::{Image, atomic, png};
use crate::file::size_on_disk;
use crate::relight::Material;
use crate::render::View;
use crate::scene::{Effects, open_probe};
use crate::session::{LightOptions, LitOptions, MeshOptions, PictureOptions, Session};
use crate::transfer::store::Store;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;
use crate::volume::{ReadHint, Volume, read};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
const VIEW: [f64; 2] = [30.0, 15.0];
/// Brings the brightest part of the environments before the brain.
const ROTATE: f64 = 240.0;
const SIZE: [usize; 2] = [376, 324];

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
        let path = self.out.join("brain.isolume");
        console.summary(format!(
            "\n2. Bake: the transfer of light at the texels that the isosurfaces {outer} and {inner} look up, {RAYS} rays \
             each, 4 layers (direct light and 3 bounces). No light is chosen yet."
        ));
        let (store, lines, json, seconds_bake) = bake(&volume, &path, seed, console)?;
        console.summary(indent(&lines));
        console.summary(
            "\n3. Relight: environments multiplied with what is stored; rays go to their lamps and from the camera.",
        );
        let lit = self.relight(&store, console)?;
        let mut rows = vec![["file", "isovalue", "light", "time", "noise"].map(String::from).to_vec()];
        for file in &lit {
            rows.push(vec![
                file.path.display().to_string(),
                text::number(file.isovalue, 6),
                file.environment.into(),
                text::duration(file.time),
                text::percent(file.noise),
            ]);
        }
        console.summary(indent(&text::table(&rows)));
        console.summary(
            "   transport rays: 0; noise: standard error of the radiance, RMS over the vertices, over its mean",
        );
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
            "store": store.path().display().to_string(),
            "bake": json,
            "files": lit.iter().map(|f| json!({
                "path": f.path.display().to_string(), "isovalue": f.isovalue, "environment": f.environment,
                "error_rms_over_mean": f.noise, "seconds": f.time.as_secs_f64(),
            })).collect::<Vec<_>>(),
            "sheet": sheet.display().to_string(),
            "transport_rays_of_relight": 0,
            "seconds": { "bake": seconds_bake, "all": seconds.as_secs_f64() },
        }));
        Ok(())
    }

    /// Lights the surfaces and writes meshes and pictures of them.
    fn relight(&self, store: &Store, console: &Console) -> Outcome<Vec<File>> {
        let session = Session::open(store)?;
        let light = LightOptions { rotation_degrees: ROTATE, ..LightOptions::default() };
        let [azimuth, elevation] = VIEW;
        let [width, height] = SIZE;
        let view = View { azimuth, elevation };
        let picture = PictureOptions { width, height, view, ..PictureOptions::default() };
        let material = Material::new([0.7; 3], [0.0; 3])?;
        let mut files = Vec::new();
        for (isovalue, environments) in [(ISOVALUES[0], &ENVIRONMENTS[..]), (ISOVALUES[1], &ENVIRONMENTS[2..])] {
            let surface = session.surface(isovalue)?;
            for suffix in ["glb", "png"] {
                self.show_command(store.path(), isovalue, environments, suffix, console);
                for &environment in environments {
                    let probe = open_probe(environment, false, None)?;
                    let start = Instant::now();
                    let lighting = session.light(&probe, &light)?;
                    let lit = surface.lit(&lighting, &material, &LitOptions::default())?;
                    let path = self.out.join(format!("brain-{isovalue}-{environment}.{suffix}"));
                    let image = if suffix == "png" {
                        let still = lit.picture(&picture)?;
                        lit.write_png(&path, &still)?;
                        Some(still.image)
                    } else {
                        lit.write_gltf(&path, &MeshOptions::default())?;
                        None
                    };
                    let (time, noise) = (start.elapsed(), lit.rms_over_mean());
                    files.push(File { path, isovalue, environment, time, noise, image });
                }
            }
        }
        Ok(files)
    }

    /// The command that does the same.
    fn show_command(&self, store: &Path, isovalue: f64, environments: &[&str], suffix: &str, console: &Console) {
        let name = if environments.len() > 1 { "{env}" } else { environments[0] };
        let output = self.out.join(format!("brain-{isovalue}-{name}.{suffix}")).display().to_string();
        let (store, isovalue, rotate) = (store.display().to_string(), isovalue.to_string(), ROTATE.to_string());
        let (view, size) = (VIEW.map(|v| v.to_string()).join(","), SIZE.map(|v| v.to_string()).join("x"));
        let mut line = vec!["isolume", "relight", &store, "--isovalue", &isovalue];
        for environment in environments {
            line.extend(["--env", environment]);
        }
        line.extend(["--env-rotate", &rotate]);
        if suffix == "png" {
            line.extend(["--view", &view, "--size", &size]);
        }
        line.extend(["-o", &output]);
        console.summary(format!("   $ {}", command_lines(&line)));
    }
}

/// A file that was written.
struct File {
    path: PathBuf,
    isovalue: f64,
    environment: &'static str,
    /// From the light to the file.
    time: Duration,
    /// Root mean square of the standard errors over the mean radiance.
    noise: f64,
    /// The picture, where it is one.
    image: Option<Image>,
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

fn bake(volume: &Volume, path: &Path, seed: u64, console: &Console) -> Outcome<(Store, String, Value, f64)> {
    let start = Instant::now();
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: Layers::usual(4)? };
    let settings = Settings { layers: layout.layers.clone(), rays: RAYS, seed, target: None, positive: false };
    let isovalues: Vec<f64> = ISOVALUES
        .iter()
        .map(|&c| Isovalue::Value(c).resolve(volume, Some(volume.solid), None).map(|c| c.value))
        .collect::<Result<_, _>>()?;
    let effects = Effects::default();
    let job = Request { isovalues: Some(isovalues), ..Request::new(volume, VOLUME_NAME, layout, settings, &effects) };
    let (store, report) = fill(&job, path, start, console)?;
    let bytes = size_on_disk(path);
    Ok((store, report.summary_line(bytes), report.json(bytes), start.elapsed().as_secs_f64()))
}

fn write_sheet(lit: &[File], path: &Path) -> Outcome {
    let pictures: Vec<(&Image, String)> = lit
        .iter()
        .filter_map(|f| Some((f.image.as_ref()?, format!("isovalue {}, {}", f.isovalue, f.environment))))
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
