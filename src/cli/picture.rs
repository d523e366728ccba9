//! Preview pictures as options, and from radiance to an image.

use super::surface::Surface;
use super::text;
use crate::error::{Error, Result};
use crate::export::Image;
use crate::geom::Up;
use crate::relight::Exposure;
use crate::render::{Camera, Picture, Projection, View};
use crate::scene::srgb;
use crate::volume::Volume;
use clap::ValueEnum;

/// How a preview looks.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct PictureArgs {
    /// Camera: front, back, left, right, top, bottom, iso, or AZIMUTH,ELEVATION in degrees
    #[arg(long, default_value = "iso", value_name = "VIEW", value_parser = parse_view, allow_hyphen_values = true)]
    pub(super) view: View,
    /// Perspective with this vertical field of view in degrees [default: parallel; 35 if no number is given]
    #[arg(long, value_name = "FOV", num_args = 0..=1, default_missing_value = "35", value_parser = parse_field_of_view)]
    pub(super) perspective: Option<f64>,
    /// Size of the picture
    #[arg(long, default_value = "960x720", value_name = "WxH", value_parser = parse_size)]
    pub(super) size: (usize, usize),
    /// Behind the surface: white, black, transparent or #rrggbb (sRGB)
    #[arg(long, default_value = "#2c3036", value_name = "COLOUR", value_parser = parse_background)]
    pub(super) background: [f32; 4],
    /// What the camera has in view: the surface, or the whole box of the volume, so that pictures of several isovalues
    /// stay in register
    #[arg(long, value_enum, default_value = "surface")]
    pub(super) frame: Frame,
    /// Rays along each side of a pixel
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=16))]
    pub(super) supersampling: u8,
}

/// What the camera has in view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Frame {
    Surface,
    Box,
}

const VIEWS: [&str; 7] = ["front", "back", "left", "right", "top", "bottom", "iso"];

fn parse_view(name: &str) -> std::result::Result<View, String> {
    if let Some(view) = View::named(name) {
        return Ok(view);
    }
    let angles = name.split_once(',').and_then(|(a, e)| Some((a.trim().parse().ok()?, e.trim().parse().ok()?)));
    match angles {
        Some((azimuth, elevation)) if f64::abs(azimuth) <= 3600.0 && f64::abs(elevation) <= 90.0 => {
            Ok(View { azimuth, elevation })
        }
        _ => Err(match text::nearest(name, VIEWS) {
            Some(near) => format!("did you mean {near}?"),
            None => format!("give one of {}, or AZIMUTH,ELEVATION in degrees", VIEWS.join(", ")),
        }),
    }
}

fn parse_field_of_view(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if (1.0..=150.0).contains(&degrees) => Ok(degrees),
        _ => Err("give degrees from 1 to 150".into()),
    }
}

fn parse_size(text: &str) -> std::result::Result<(usize, usize), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((w, h)) if (1..=16384).contains(&w) && (1..=16384).contains(&h) => Ok((w, h)),
        _ => Err("give a size such as 960x720, sides from 1 to 16384".into()),
    }
}

/// A colour as linear RGB and alpha.
fn parse_background(text: &str) -> std::result::Result<[f32; 4], String> {
    let hex = |i: usize| text.get(i..i + 2).and_then(|h| u8::from_str_radix(h, 16).ok()).map(srgb::linear_from_byte);
    match text {
        "white" => Ok([1.0; 4]),
        "black" => Ok([0.0, 0.0, 0.0, 1.0]),
        "transparent" => Ok([0.0; 4]),
        _ => match (text.len(), text.starts_with('#'), hex(1), hex(3), hex(5)) {
            (7, true, Some(r), Some(g), Some(b)) => Ok([r, g, b, 1.0]),
            _ => Err("give white, black, transparent, or #rrggbb".into()),
        },
    }
}

impl PictureArgs {
    /// The projection asked for.
    pub(super) fn projection(&self) -> Projection {
        self.perspective.map_or(Projection::Orthographic, Projection::Perspective)
    }

    /// The camera asked for.
    pub(super) fn camera(&self, surface: &Surface, volume: &Volume, up: Up) -> Camera {
        let aspect = self.size.0 as f64 / self.size.1 as f64;
        match self.frame {
            Frame::Surface => surface.camera(volume, up, self.view, self.projection(), aspect),
            Frame::Box => Camera::framing(&volume.world_bounds(), up, self.view, self.projection(), aspect),
        }
    }
}

/// Exposes a picture and lays it over a background.
pub(super) fn develop(picture: &Picture, factor: f32, background: [f32; 4]) -> Result<Image> {
    let pixels = picture.pixels.iter().map(|&[r, g, b, coverage]| {
        if coverage <= 0.0 {
            return background;
        }
        let straight = [[r / coverage, g / coverage, b / coverage]];
        let [colour] = Exposure::apply(factor, &straight)[..] else { return background };
        let alpha = coverage + background[3] * (1.0 - coverage);
        let mix = |c: usize| (colour[c] * coverage + background[c] * background[3] * (1.0 - coverage)) / alpha;
        [mix(0), mix(1), mix(2), alpha]
    });
    Image::new(picture.width, picture.height, pixels.collect())
}

/// Refuses a picture that is too large for its memory.
pub(super) fn check_size(size: (usize, usize), limit: Option<u64>) -> Result<()> {
    let needed = (size.0 * size.1 * 40) as u64;
    super::options::check_memory("the picture", needed, limit).map_err(|e| match e {
        Error::Limit { what, needed, limit, .. } => {
            Error::Limit { what, needed, limit, remedy: "give a smaller --size".into() }
        }
        other => other,
    })
}
