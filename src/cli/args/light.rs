//! Environments, materials and exposure as options.

use crate::error::Error;
use crate::probe::{EnvFrame, Layout, SunSplit};
use crate::relight::Exposure;
use crate::session::{LightOptions, LuminaireFactor, MaterialChoice};
use crate::sh::Window;

/// How environment images are read and how the light is prepared.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct LightArgs {
    /// Turn the light counter-clockwise about up, seen from above, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    pub(in crate::cli) env_rotate: f64,
    /// Where the centre of environment images lies in glTF: at +X as in Blender and three.js, or at +Z as in OpenEXR
    #[arg(long, value_enum, value_name = "FRAME", default_value = "gltf")]
    pub(in crate::cli) env_frame: EnvFrame,
    /// Soften the band-limited light, against ringing
    #[arg(long, value_enum, default_value = "none")]
    pub(in crate::cli) window: Window,
    /// Lamps lit apart from the environment, by rays, with sharp shadows: as many as would ring otherwise,
    /// none (light and transfer are multiplied), or so many [default: auto; off among mirrors,
    /// glass and translucent solids, with --window and with --transfer]
    #[arg(long, value_name = "auto|off|N", num_args = 0..=1, default_missing_value = "auto", value_parser = parse_split)]
    pub(in crate::cli) sun_split: Option<SunSplit>,
    /// Factor on the power of a luminaire of a scene, one number or three for red, green and blue, such as ceiling=2
    #[arg(long = "luminaire", value_name = "NAME=FACTOR")]
    pub(in crate::cli) luminaires: Vec<LuminaireFactor>,
    /// Cut the light to this many bands [default: those of the store]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=crate::sh::MAX_BANDS as i64))]
    pub(in crate::cli) bands: Option<u8>,
    /// Keep negative pixels of environment images
    #[arg(long)]
    pub(in crate::cli) keep_negative: bool,
    /// Layout of environment images [default: from the file and its shape]
    #[arg(long, value_name = "LAYOUT", value_parser = parse_layout)]
    pub(in crate::cli) layout: Option<Layout>,
}

pub(in crate::cli) fn parse_split(text: &str) -> Result<SunSplit, String> {
    text.parse().map_err(|e: Error| e.to_string())
}

pub(in crate::cli) fn parse_layout(name: &str) -> Result<Layout, String> {
    name.parse().map_err(|e: Error| e.to_string())
}

impl LightArgs {
    /// How environments light; `split`: which lamps are apart.
    pub(in crate::cli) fn options(&self, split: SunSplit) -> LightOptions {
        LightOptions {
            rotation_degrees: self.env_rotate,
            frame: self.env_frame,
            bands: self.bands.map(usize::from),
            window: self.window,
            split_sun: split,
        }
    }
}

/// The library's refusal with the names of the options.
pub(in crate::cli) fn by_option(error: Error) -> Error {
    let Error::Argument { name, given, expected, remedy } = error else { return error };
    let (option, given, remedy) = match name.as_str() {
        "window" => ("--window", given, "leave out --keep-negative, or take another --window".into()),
        "luminaire" => ("--luminaire", given, remedy),
        "sun split" => ("--sun-split", given, remedy),
        "transfer" => ("--transfer", given, remedy),
        "scale bar" => ("--scale-bar", "with --perspective".into(), "leave out --perspective or the bar".into()),
        other => (other, given, remedy),
    };
    Error::argument(option, given, expected, remedy)
}

/// What the surface is made of.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct MaterialArgs {
    /// Diffuse reflectance, one number or r,g,b, linear; with --colormap a factor on its colours [default: 0.7]
    #[arg(long, value_name = "RHO|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    pub(in crate::cli) albedo: Option<Triple>,
    /// Albedo of the medium of a translucent solid that was baked with nodes (bake --translucent SIGMA,free), one number or three
    #[arg(long, value_name = "A[,G,B]", value_parser = parse_triple)]
    pub(in crate::cli) medium_albedo: Option<Triple>,
    /// Colour by isovalue: a colour scale, over the range of the volume or of LOW..HIGH
    #[arg(long, value_name = "NAME[:LOW..HIGH]")]
    pub(in crate::cli) colormap: Option<String>,
    /// Emitted radiance, one number or r,g,b, linear [default: 0]
    #[arg(long, value_name = "E|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    pub(in crate::cli) emission: Option<Triple>,
    /// Exposure in stops, or auto: the 99th percentile of the brightest channel becomes white
    #[arg(long, value_name = "EV|auto", default_value = "auto", value_parser = parse_exposure, allow_hyphen_values = true)]
    pub(in crate::cli) exposure: Exposure,
}

/// One number for three channels, or three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::cli) struct Triple(pub(in crate::cli) [f32; 3]);

pub(in crate::cli) fn parse_triple(text: &str) -> Result<Triple, String> {
    let numbers: Option<Vec<f32>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f32| v.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[one]) => Ok(Triple([one; 3])),
        Some(&[r, g, b]) => Ok(Triple([r, g, b])),
        _ => Err("give one number, or three such as 0.7,0.5,0.3".into()),
    }
}

fn parse_exposure(text: &str) -> Result<Exposure, String> {
    match text {
        "auto" => Ok(Exposure::Percentile),
        number => match number.parse::<f64>() {
            Ok(ev) if ev.abs() <= 100.0 => Ok(Exposure::Stops(ev)),
            _ => Err("give stops such as -1.5, or auto".into()),
        },
    }
}

impl MaterialArgs {
    /// The same for the library.
    pub(in crate::cli) fn choice(&self) -> MaterialChoice {
        MaterialChoice {
            albedo: self.albedo.map(|albedo| albedo.0),
            colormap: self.colormap.clone(),
            emission: self.emission.map(|emission| emission.0),
            medium_albedo: self.medium_albedo.map(|albedo| albedo.0),
            exposure: self.exposure,
        }
    }
}
