//! `isolume demo`: the whole way from a volume to lit surfaces, without any file.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::lent::filler;
use crate::cli::present::{baked, text};
use crate::demo;
use crate::error::Error;
use crate::file::size_on_disk;
use crate::session::Session;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Bake and relight a small brain, without any file
///
/// The volume (the MNI152 template at 2 mm) and three small environments are inside the program. One surface is
/// lit by all three, another by one; the demo writes a transfer store, .glb files, pictures and a contact sheet.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  isolume demo --out isolume-demo")]
pub(in crate::cli) struct Demo {
    /// Directory to write into; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "isolume-demo")]
    out: PathBuf,
}

impl Demo {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let start = Instant::now();
        std::fs::create_dir_all(&self.out).map_err(|e| Error::io(&self.out, "make the directory", e))?;
        let volume = demo::volume()?;
        let d = volume.dims();
        let [outer, inner] = demo::ISOVALUES;
        console.summary(format!(
            "1. A brain: {}, {} × {} × {} samples, from inside the program (© Louis Collins, McConnell \
             Brain Imaging Centre, McGill University).",
            demo::VOLUME_NAME,
            d[0],
            d[1],
            d[2]
        ));
        let path = self.out.join("brain.isolume");
        console.summary(format!(
            "\n2. Bake: the transfer of light at the texels that the isosurfaces {outer} and {inner} look up, {} rays \
             each, 4 layers (direct light and 3 bounces). No light is chosen yet.",
            demo::RAYS
        ));
        let before = Instant::now();
        let (store, report) = demo::bake(&volume, &path, seed, &filler(before, console))?;
        let (bytes, seconds_bake) = (size_on_disk(&path), before.elapsed().as_secs_f64());
        console.summary(indent(&baked::summary_line(&report, bytes)));
        console.summary(
            "\n3. Relight: environments multiplied with what is stored; rays go to their lamps and from the camera.",
        );
        let session = Session::open(&store)?;
        let mut lit = Vec::new();
        for task in demo::tasks() {
            self.show_command(store.path(), &task, console);
            lit.extend(demo::light(&session, &task, &self.out, &|| start.elapsed().as_secs_f64())?);
        }
        let mut rows = vec![text::row(["file", "isovalue", "light", "time", "noise"])];
        for file in &lit {
            rows.push(vec![
                file.path.display().to_string(),
                text::number(file.isovalue, 6),
                file.environment.into(),
                text::duration(Duration::from_secs_f64(file.seconds)),
                text::percent(file.noise),
            ]);
        }
        console.summary(indent(&text::table(&rows)));
        console.summary(
            "   transport rays: 0; noise: standard error of the radiance, RMS over the vertices, over its mean",
        );
        let sheet = self.out.join("sheet.png");
        demo::write_sheet(&lit, &sheet)?;
        let seconds = start.elapsed();
        console.summary(format!(
            "\n4. All on one sheet: {}\n\nDone in {}. The .glb files open in any glTF viewer. Then your own volume:\n  \
             isolume info FILE\n  isolume relight FILE --isovalue auto --env courtyard -o surface.glb",
            sheet.display(),
            text::duration(seconds)
        ));
        console.print_json(&json!({
            "store": store.path().display().to_string(),
            "bake": report.to_json(bytes),
            "files": lit.iter().map(|f| json!({
                "path": f.path.display().to_string(), "isovalue": f.isovalue, "environment": f.environment,
                "error_rms_over_mean": f.noise, "seconds": f.seconds,
            })).collect::<Vec<_>>(),
            "sheet": sheet.display().to_string(),
            "transport_rays_of_relight": 0,
            "seconds": { "bake": seconds_bake, "all": seconds.as_secs_f64() },
        }));
        Ok(())
    }

    /// The command that does the same.
    fn show_command(&self, store: &Path, task: &demo::Task, console: &Console) {
        let demo::Task { isovalue, environments, suffix } = *task;
        let name = if environments.len() > 1 { "{env}" } else { environments[0] };
        let output = self.out.join(format!("brain-{isovalue}-{name}.{suffix}")).display().to_string();
        let (store, isovalue, rotate) = (store.display().to_string(), isovalue.to_string(), demo::ROTATE.to_string());
        let (view, size) = (demo::VIEW.map(|v| v.to_string()).join(","), demo::SIZE.map(|v| v.to_string()).join("x"));
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

fn indent(text: &str) -> String {
    text.lines().map(|line| format!("   {line}")).collect::<Vec<_>>().join("\n")
}
