//! Environments, materials and exposure as options.

use super::{Outcome, text};
use crate::error::{Error, Result};
use crate::geom::Up;
use crate::probe::sun::{SunOptions, split_sun};
use crate::probe::{self, EMBEDDED, EnvFrame, Layout, Orientation, Probe, ReadOptions};
use crate::relight::{self, Exposure, Light, Material};
use crate::render::SunLight;
use crate::scene::{Colormap, MaterialRule};
use crate::sh::Window;
use crate::transfer::Layers;
use clap::ValueEnum;
use std::path::Path;

/// Names of the skies by formula, for suggestions.
const SKIES: [&str; 5] = ["constant", "gradient", "overcast", "sky", "sun:45,30"];

/// How environment images are read and how the light is prepared.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct LightArgs {
    /// Turn the light counter-clockwise about up, seen from above, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    pub(super) env_rotate: f64,
    /// Where the centre of environment images lies in glTF: at +X as in Blender and three.js, or at +Z as in OpenEXR
    #[arg(long, value_enum, value_name = "FRAME", default_value = "gltf")]
    pub(super) env_frame: FrameName,
    /// Soften the band-limited light, against ringing
    #[arg(long, value_enum, default_value = "none")]
    pub(super) window: WindowName,
    /// Light the dominant lamp apart from the environment, by visibility rays: sharp shadows, no ringing
    #[arg(long)]
    pub(super) sun_split: bool,
    /// Factor on the power of a luminaire of a scene, one number or three for red, green and blue, such as ceiling=2
    #[arg(long = "luminaire", value_name = "NAME=FACTOR", value_parser = super::scene_light::parse_factor)]
    pub(super) luminaires: Vec<super::scene_light::Factor>,
    /// Cut the light to this many bands [default: those of the store]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=crate::sh::MAX_BANDS as i64))]
    pub(super) bands: Option<u8>,
    /// Keep negative pixels of environment images
    #[arg(long)]
    pub(super) keep_negative: bool,
    /// Layout of environment images [default: from the file and its shape]
    #[arg(long, value_name = "LAYOUT", value_parser = parse_layout)]
    pub(super) layout: Option<Layout>,
}

/// Visibility rays for each surface point and sun.
const SUN_RAYS: u32 = 16;

/// A light ready to be contracted, and the suns that were split off it.
pub(super) struct Lighting {
    pub(super) light: Light,
    pub(super) suns: Vec<SunLight>,
    /// Whether the light is proven nowhere negative.
    pub(super) certified: bool,
    /// What was done, for the user.
    pub(super) notes: Vec<String>,
}

/// A window by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum WindowName {
    None,
    Lanczos,
    Hanning,
    /// Proven nowhere negative; costs contrast
    Certified,
}

impl WindowName {
    fn window(self) -> Window {
        match self {
            Self::None => Window::None,
            Self::Lanczos => Window::Lanczos,
            Self::Hanning => Window::Hanning,
            Self::Certified => Window::Certified,
        }
    }
}

/// A frame of environment images by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum FrameName {
    /// The image's centre is +X, +Z three quarters from the left
    #[default]
    Gltf,
    /// The image's centre is +Z, +X a quarter from the left
    Openexr,
}

impl From<FrameName> for EnvFrame {
    fn from(name: FrameName) -> Self {
        match name {
            FrameName::Gltf => Self::Gltf,
            FrameName::Openexr => Self::OpenExr,
        }
    }
}

pub(super) fn parse_layout(name: &str) -> std::result::Result<Layout, String> {
    name.parse().map_err(|e: Error| e.to_string())
}

/// Opens a probe by name or path; a misspelt one gets a suggestion.
pub(super) fn open_probe(argument: &str, keep_negative: bool, layout: Option<Layout>) -> Result<Probe> {
    let options = ReadOptions { layout, keep_negative, ..ReadOptions::default() };
    let unknown = probe::by_name(argument)?.is_none() && !Path::new(argument).exists();
    let word = argument.split(':').next().unwrap_or(argument);
    let known = EMBEDDED.into_iter().chain(SKIES.map(|s| s.split(':').next().unwrap_or(s)));
    match text::nearest(word, known).filter(|_| unknown) {
        Some(near) => {
            let expected =
                format!("an image file that exists, or one of {}, {}", EMBEDDED.join(", "), SKIES.join(", "));
            Err(Error::argument("environment", argument, expected, format!("did you mean {near}?")))
        }
        None => probe::open(argument, &options),
    }
}

impl LightArgs {
    /// How environments stand around a volume.
    pub(super) fn orientation(&self, up: Up) -> Result<Orientation> {
        Ok(Orientation::new(up, self.env_rotate)?.in_frame(self.env_frame.into()))
    }

    /// The light of a probe in world axes, cut and windowed at the band limit of each layer; `split`: without its
    /// dominant lamps.
    pub(super) fn prepare(&self, probe: &Probe, up: Up, layers: &Layers, split: bool) -> Result<Lighting> {
        if self.keep_negative && self.window == WindowName::Certified {
            let expected = "one of the two";
            let remedy = "light with negative pixels cannot be certified; leave one option out";
            return Err(Error::argument("--window certified", "--keep-negative as well", expected, remedy));
        }
        let most = layers.max_bands();
        let bands = self.bands.map_or(most, |b| usize::from(b).min(most));
        let orientation = self.orientation(up)?;
        let whole = probe.coefficients_in_world(bands, orientation);
        let mut notes = Vec::new();
        let mut suns = Vec::new();
        let mut direct = whole.clone();
        if split {
            let split = split_sun(probe, &SunOptions { bands, ..SunOptions::default() });
            if split.suns.is_empty() {
                notes.push(format!("{}: no sun was split off: {}", probe.name, split.stopped));
            } else {
                direct = split.rest.coefficients_in_world(bands, orientation);
            }
            for s in &split.suns {
                let (share, radius) = (text::percent(s.flux_share), s.sun.angular_radius.to_degrees());
                notes.push(format!(
                    "{}: a lamp of radius {radius:.2}° with {share} of the light is lit apart",
                    probe.name
                ));
                suns.push(SunLight::new(&s.sun, orientation, SUN_RAYS));
            }
        }
        let prepared = relight::prepare(&direct, &whole, layers, self.window.window())?;
        if self.window != WindowName::None {
            let kept = prepared.least_kept().kept;
            let (energy, contrast) = (text::percent(kept.energy), text::percent(kept.contrast));
            notes.push(format!(
                "{}: the window keeps {energy} of the energy and {contrast} of the contrast",
                probe.name
            ));
        }
        Ok(Lighting { light: prepared.light, suns, certified: self.window == WindowName::Certified, notes })
    }

    /// For the record of a file.
    pub(super) fn window_name(&self) -> &'static str {
        self.window.window().name()
    }
}

/// What the surface is made of.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct MaterialArgs {
    /// Diffuse reflectance, one number or r,g,b, linear; with --colormap a factor on its colours [default: 0.7]
    #[arg(long, value_name = "RHO|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    pub(super) albedo: Option<Triple>,
    /// Colour by isovalue: a colour scale, over the range of the volume or of LOW..HIGH
    #[arg(long, value_name = "NAME[:LOW..HIGH]")]
    pub(super) colormap: Option<String>,
    /// Emitted radiance, one number or r,g,b, linear [default: 0]
    #[arg(long, value_name = "E|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    pub(super) emission: Option<Triple>,
    /// Exposure in stops, or auto: the 99th percentile of the brightest channel becomes white
    #[arg(long, value_name = "EV|auto", default_value = "auto", value_parser = parse_exposure, allow_hyphen_values = true)]
    pub(super) exposure: Exposure,
}

/// One number for three channels, or three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triple(pub(super) [f32; 3]);

pub(super) fn parse_triple(text: &str) -> std::result::Result<Triple, String> {
    let numbers: Option<Vec<f32>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f32| v.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[one]) => Ok(Triple([one; 3])),
        Some(&[r, g, b]) => Ok(Triple([r, g, b])),
        _ => Err("give one number, or three such as 0.7,0.5,0.3".into()),
    }
}

fn parse_exposure(text: &str) -> std::result::Result<Exposure, String> {
    match text {
        "auto" => Ok(Exposure::Percentile),
        number => match number.parse::<f64>() {
            Ok(ev) if ev.abs() <= 100.0 => Ok(Exposure::Stops(ev)),
            _ => Err("give stops such as -1.5, or auto".into()),
        },
    }
}

impl MaterialArgs {
    /// Whether the albedo was given.
    pub(super) fn says_albedo(&self) -> bool {
        self.albedo.is_some() || self.colormap.is_some()
    }

    /// The material of each isovalue; `range` is that of the volume.
    pub(super) fn rule(&self, range: (f64, f64)) -> Outcome<MaterialRule> {
        let albedo = self.albedo.map_or([0.7; 3], |albedo| albedo.0);
        Material::new(albedo, self.emission.map_or([0.0; 3], |emission| emission.0))?;
        let Some(spec) = &self.colormap else {
            return Ok(MaterialRule::Constant(albedo));
        };
        if albedo[0] != albedo[1] || albedo[1] != albedo[2] {
            let expected = "one number together with --colormap";
            return Err(
                Error::argument("--albedo", format!("{albedo:?}"), expected, "it is a factor on the colours").into()
            );
        }
        let (name, part) = spec.split_once(':').map_or((spec.as_str(), None), |(n, p)| (n, Some(p)));
        let colormap = match (Colormap::named(name), text::nearest(name, Colormap::names())) {
            (Err(_), Some(near)) => {
                let known = Colormap::names().collect::<Vec<_>>().join(", ");
                let expected = format!("one of {known}");
                return Err(Error::argument("colormap", name, expected, format!("did you mean {near}?")).into());
            }
            (result, _) => result?,
        };
        let (low, high) = match part {
            None => range,
            Some(part) => {
                let ends =
                    part.split_once("..").and_then(|(l, h)| Some((l.parse::<f64>().ok()?, h.parse::<f64>().ok()?)));
                ends.filter(|(l, h)| l.is_finite() && h.is_finite() && l < h).ok_or_else(|| {
                    let expected = "two rising isovalues such as 0..255";
                    Error::argument("colormap", spec, expected, format!("write {name}:LOW..HIGH"))
                })?
            }
        };
        Ok(MaterialRule::Map { colormap, low, high, scale: albedo[0] })
    }
}
