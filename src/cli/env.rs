//! `isolume env`: environments by themselves.

use super::console::Console;
use super::light::parse_layout;
use super::{Failure, Outcome, text};
use crate::error::{Error, Result};
use crate::export::atomic;
use crate::export::inputs::Inputs;
use crate::export::target::check_file;
use crate::probe::{LatLong, Layout, Orientation, Probe, Report, report};
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
pub(super) struct Env {
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
    pub(super) fn run(&self, console: &Console) -> Outcome {
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
    let mut rows = vec![
        vec!["name".into(), r.name.clone()],
        vec![
            "image".into(),
            format!(
                "{} {}, {} × {}; light {} × {}",
                r.format, r.layout, r.stored_size[0], r.stored_size[1], r.width, r.height
            ),
        ],
        vec![
            "range".into(),
            format!(
                "{} to {} (r, g, b), {:.1} stops",
                triple(r.minimum.map(f64::from)),
                triple(r.maximum.map(f64::from)),
                r.range_ev
            ),
        ],
        vec![
            "mean".into(),
            format!("{} over the sphere, luminance {}", triple(r.mean), text::number(r.mean_luminance, 5)),
        ],
    ];
    for (name, lobe) in [("brightest", r.brightest_pixel), ("most light", r.lobe)] {
        let text = lobe.map_or("from nowhere in particular".into(), |l| {
            format!(
                "from azimuth {:.1}°, elevation {:.1}°, luminance {}",
                l.azimuth_degrees,
                l.elevation_degrees,
                text::number(l.luminance, 5)
            )
        });
        rows.push(vec![name.into(), text]);
    }
    rows.push(vec!["energy".into(), energy(&r)]);
    let frame = "the image's centre (azimuth 0°) is glTF +X, +Z is three quarters from the left (azimuth -90°)";
    rows.push(vec!["frame".into(), frame.into()]);
    let bad = &r.bad_pixels;
    rows.push(vec![
        "bad pixels".into(),
        format!(
            "{} NaN, {} infinite, {} negative",
            text::count(bad.nan),
            text::count(bad.infinite),
            text::count(bad.negative)
        ),
    ]);
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
    let [r, g, b] = probe.coefficients(bands);
    let rows: Vec<[f64; 3]> = (0..bands * bands).map(|i| [r.values()[i], g.values()[i], b.values()[i]]).collect();
    let value = json!({
        "name": probe.name,
        "bands": bands,
        "convention": "real orthonormal, no Condon-Shortley sign, index l(l+1)+m; glTF frame: y up, the image's centre is +x, +z three quarters from the left; linear Rec.709",
        "rgb": rows,
    });
    match output {
        Some(path) => {
            let text = format!("{value:#}\n");
            atomic::write(path, |w| {
                std::io::Write::write_all(w, text.as_bytes()).map_err(|e| Error::io("", "write", e))
            })?;
            console.summary(text::file_line(path, &format!("{} coefficients", bands * bands)));
            console.print_json(&value);
        }
        None if console.is_json() => console.print_json(&value),
        None => console.print(format!("{value:#}")),
    }
    Ok(())
}

/// The image turned counter-clockwise about up; each pixel takes the value at its centre.
fn turned(image: &LatLong, degrees: f64) -> Result<LatLong> {
    let probe_from_turned = Orientation::new(crate::geom::Up::Y, degrees)?.probe_from_world();
    let (width, height) = (image.width(), image.height());
    let pixel = |i: usize| {
        let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        image.radiance(probe_from_turned * image.direction_from_pixel(x, y))
    };
    LatLong::new(width, height, (0..width * height).map(pixel).collect())
}

fn rotate(probe: &Probe, degrees: f64, output: &Path, console: &Console) -> Outcome {
    check_hdr(output)?;
    let image = turned(&probe.image, degrees)?;
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
    let (width, height) = (image.width(), image.height());
    Ok(atomic::write(output, |w| {
        let pixels: Vec<image::Rgb<f32>> = image.pixels().iter().map(|p| image::Rgb(*p)).collect();
        let encoder = image::codecs::hdr::HdrEncoder::new(w);
        encoder.encode(&pixels, width, height).map_err(|e| Error::io("", "write", std::io::Error::other(e)))
    })?)
}

/// Fewer stops than this between the brightest pixel and the mean is no high dynamic range.
const FEWEST_STOPS: f64 = 1.0;
fn reasons(r: &Report) -> Vec<String> {
    let mut reasons: Vec<String> = r.notes.iter().map(|n| format!("{} ({})", n.text, text::count(n.count))).collect();
    let bad = &r.bad_pixels;
    let impossible = bad.nan + bad.infinite + bad.negative;
    if impossible > 0 && reasons.is_empty() {
        reasons.push(format!("{} pixels that no light can have", text::count(impossible)));
    }
    if r.mean_luminance <= 0.0 {
        reasons.push("it is black".into());
    } else if r.format != "formula" {
        let stops = r.brightest_pixel.map_or(0.0, |p| (p.luminance / r.mean_luminance).log2());
        if stops < FEWEST_STOPS {
            reasons.push(format!("the brightest pixel is only {stops:.1} stops above the mean: was it clipped?"));
        }
        if r.layout == "latlong" && r.stored_size[0] != 2 * r.stored_size[1] {
            reasons.push(format!("{} × {} is not 2:1", r.stored_size[0], r.stored_size[1]));
        }
    }
    reasons
}

fn check(probe: &Probe, console: &Console) -> Outcome {
    let r = report(probe, 5);
    let reasons = reasons(&r);
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
