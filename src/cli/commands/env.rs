//! `isolume env`: environments by themselves.

use crate::cli::args::light::parse_layout;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::{Error, Result};
use crate::export::inputs::Inputs;
use crate::export::target::check_file;
use crate::export::{atomic, hdr};
use crate::probe::{LatLong, Layout, Lobe, Probe, Report, report};
use crate::scene::open_probe;
use clap::Subcommand;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Look at environment images: show, project, rotate, convert, check
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume env show courtyard
  isolume env project sunset.exr --bands 3 -o sunset.json
  isolume env rotate studio --env-rotate 90 -o turned.hdr
  isolume env convert room.exr -o room.hdr
  isolume env check studio.exr")]
pub(in crate::cli) struct Env {
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Args, Clone)]
struct Source {
    /// Image file, courtyard, studio, sunset, or a sky: constant, gradient, overcast, sky, sun:AZ,EL
    #[arg(value_name = "PROBE")]
    probe: String,
    /// Layout of the image [default: from the file and its shape]
    #[arg(long, value_name = "LAYOUT", value_parser = parse_layout)]
    layout: Option<Layout>,
    /// Keep negative pixels
    #[arg(long)]
    keep_negative: bool,
}

#[derive(Subcommand)]
enum Action {
    /// Print size, range, mean, where the light comes from, energy by degree, coefficients, bad pixels
    #[command(after_help = "Example:\n  isolume env show sunset.exr --bands 3")]
    Show {
        #[command(flatten)]
        source: Source,
        /// Bands of the coefficients that are printed
        #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=11))]
        bands: u8,
    },
    /// Write the spherical harmonic coefficients as JSON
    #[command(after_help = "Example:\n  isolume env project courtyard --bands 5 -o courtyard.json")]
    Project {
        #[command(flatten)]
        source: Source,
        /// Bands
        #[arg(long, default_value_t = 5, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=11))]
        bands: u8,
        /// File to write [default: standard output]
        #[arg(short, long, value_name = "FILE.json")]
        output: Option<PathBuf>,
    },
    /// Turn an environment about up and write it as a lat-long image
    #[command(after_help = "Example:\n  isolume env rotate studio --env-rotate 90 -o turned.hdr")]
    Rotate {
        #[command(flatten)]
        source: Source,
        /// Counter-clockwise about up, seen from above, in degrees
        #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_hyphen_values = true)]
        env_rotate: f64,
        /// File to write, .hdr
        #[arg(short, long, value_name = "FILE.hdr")]
        output: PathBuf,
    },
    /// Write an environment of any format and layout as a lat-long .hdr
    ///
    /// For programs that do not read all OpenEXR files, such as a page in one file, which reads no DWAA and DWAB.
    #[command(after_help = "Example:\n  isolume env convert room.exr -o room.hdr")]
    Convert {
        #[command(flatten)]
        source: Source,
        /// File to write, .hdr
        #[arg(short, long, value_name = "FILE.hdr")]
        output: PathBuf,
    },
    /// Exit with 1 and say why if the environment is unusual
    #[command(after_help = "Example:\n  isolume env check studio.exr")]
    Check {
        #[command(flatten)]
        source: Source,
    },
}

impl Source {
    fn open(&self) -> Result<Probe> {
        open_probe(&self.probe, self.keep_negative, self.layout)
    }

    /// Refuses an output that is the image.
    fn refuse(&self, output: &Path) -> Result<()> {
        Inputs::new([&self.probe]).refuse(output)
    }
}

impl Env {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        match &self.action {
            Action::Show { source, bands } => show(&source.open()?, usize::from(*bands), console),
            Action::Project { source, bands, output } => {
                output.as_deref().map_or(Ok(()), |output| source.refuse(output))?;
                project(&source.open()?, usize::from(*bands), output.as_deref(), console)
            }
            Action::Rotate { source, env_rotate, output } => {
                source.refuse(output)?;
                rotate(&source.open()?, *env_rotate, output, console)
            }
            Action::Convert { source, output } => {
                source.refuse(output)?;
                convert(&source.open()?, output, console)
            }
            Action::Check { source } => check(&source.open()?, console),
        }
    }
}

fn show(probe: &Probe, bands: usize, console: &Console) -> Outcome {
    let r = report(probe, bands);
    let json = serde_json::to_value(&r).unwrap_or_default();
    console.print_json(&json);
    let triple = |v: [f64; 3]| v.map(|x| text::number(x, 5)).join(", ");
    let [least, most] = [r.minimum, r.maximum].map(|v| triple(v.map(f64::from)));
    let [stored_width, stored_height] = r.stored_size;
    let from = |lobe: &Option<Lobe>| {
        lobe.as_ref().map_or("from nowhere in particular".into(), |l| {
            let (azimuth, elevation, luminance) =
                (l.azimuth_degrees, l.elevation_degrees, text::number(l.luminance, 5));
            format!("from azimuth {azimuth:.1}°, elevation {elevation:.1}°, luminance {luminance}")
        })
    };
    let image =
        format!("{} {}, {stored_width} × {stored_height}; light {} × {}", r.format, r.layout, r.width, r.height);
    let [nan, infinite, negative] = [r.bad_pixels.nan, r.bad_pixels.infinite, r.bad_pixels.negative].map(text::count);
    let row = |name: &str, value: String| vec![name.to_string(), value];
    let mean = format!("{} over the sphere, luminance {}", triple(r.mean), text::number(r.mean_luminance, 5));
    let frame = "the image's centre (azimuth 0°) is glTF +X, +Z is three quarters from the left (azimuth -90°)";
    let mut rows = vec![
        row("name", r.name.clone()),
        row("image", image),
        row("range", format!("{least} to {most} (r, g, b), {:.1} stops", r.range_ev)),
        row("mean", mean),
        row("brightest", from(&r.brightest_pixel)),
        row("most light", from(&r.lobe)),
        row("energy", energy(&r)),
        row("frame", frame.into()),
        row("bad pixels", format!("{nan} NaN, {infinite} infinite, {negative} negative")),
    ];
    for note in &r.notes {
        rows.push(vec!["note".into(), note.text.clone()]);
    }
    console.print(text::table(&rows));
    console.print("coefficients in the glTF frame (y up), r g b:");
    for l in 0..bands {
        for i in l * l..(l + 1) * (l + 1) {
            let m = i as isize - (l * (l + 1)) as isize;
            let [r, g, b] = [0, 1, 2].map(|c| r.coefficients[c][i]);
            console.print(format!("  l {l} m {m:>2}  {r:>12.6} {g:>12.6} {b:>12.6}"));
        }
    }
    Ok(())
}

/// Energy by degree. Of small lamps all degrees together have too little to be told apart.
fn energy(r: &Report) -> String {
    let last = r.energy.len() - 1;
    if r.energy.iter().all(|e| e.fraction < 5e-4) && r.mean_luminance > 0.0 {
        return format!(
            "below 0.1 % in each of the degrees 0 to {last}: nearly all comes from small lamps, which a few bands blur \
             (relight lights the strongest directly)"
        );
    }
    let parts: Vec<String> = r.energy.iter().map(|e| format!("{:.1}", 100.0 * e.fraction)).collect();
    format!("{} % in degrees 0 to {last}", parts.join(" "))
}

fn project(probe: &Probe, bands: usize, output: Option<&Path>, console: &Console) -> Outcome {
    if let Some(path) = output {
        check_file(path)?;
    }
    let value = probe.projection_json(bands);
    match output {
        Some(path) => {
            atomic::write_bytes(path, format!("{value:#}\n").as_bytes())?;
            console.summary(text::file_line(path, &format!("{} coefficients", bands * bands)));
            console.print_json(&value);
        }
        None if console.is_json() => console.print_json(&value),
        None => console.print(format!("{value:#}")),
    }
    Ok(())
}

fn rotate(probe: &Probe, degrees: f64, output: &Path, console: &Console) -> Outcome {
    check_hdr(output)?;
    let image = probe.image.turned(degrees)?;
    write_hdr(&image, output)?;
    let (width, height) = (image.width(), image.height());
    console.summary(text::file_line(output, &format!("{width} × {height}, turned by {degrees}°")));
    console.print_json(
        &json!({ "path": output.display().to_string(), "width": width, "height": height, "degrees": degrees }),
    );
    Ok(())
}

fn convert(probe: &Probe, output: &Path, console: &Console) -> Outcome {
    check_hdr(output)?;
    write_hdr(&probe.image, output)?;
    let (width, height) = (probe.image.width(), probe.image.height());
    console.summary(text::file_line(output, &format!("{width} × {height}, 8-bit mantissas with a common exponent")));
    console.print_json(&json!({ "path": output.display().to_string(), "width": width, "height": height }));
    Ok(())
}

/// Refuses another format than the one that is written.
fn check_hdr(output: &Path) -> Outcome {
    if output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("hdr")) {
        let remedy = "the Radiance format is what is written";
        return Err(Error::argument("output", output.display(), "a name ending in .hdr", remedy).into());
    }
    Ok(check_file(output)?)
}

fn write_hdr(image: &LatLong, output: &Path) -> Outcome {
    Ok(atomic::write(output, |w| hdr::write(w, image.pixels(), [image.width(), image.height()]))?)
}

fn check(probe: &Probe, console: &Console) -> Outcome {
    let r = report(probe, 5);
    let reasons = r.unusual();
    console.print_json(&json!({ "name": r.name, "usual": reasons.is_empty(), "reasons": reasons }));
    if reasons.is_empty() {
        console.print(format!("{}: nothing unusual", r.name));
        return Ok(());
    }
    for reason in &reasons {
        console.print(format!("{}: {reason}", r.name));
    }
    Err(Failure::Message(format!("{} is unusual in {} way(s)", r.name, reasons.len())))
}
