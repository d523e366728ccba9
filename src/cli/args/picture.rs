//! Pictures as options.

use crate::geom::Up;
use crate::render::{Projection, Viewpoint};
use crate::session::{Background, Framing, PictureOptions, Tone, Turntable};
use clap::ValueEnum;

/// From where a surface is seen.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct ViewArgs {
    /// Camera: front, back, left, right, top, bottom, iso, or AZIMUTH,ELEVATION in degrees, counter-clockwise from
    /// the front. Of a patient the front is anterior, left and right are the patient's, iso is from the front left
    #[arg(long, default_value = "iso", value_name = "VIEW", allow_hyphen_values = true)]
    pub(in crate::cli) view: Viewpoint,
    /// Perspective with this vertical field of view in degrees [default: parallel; 35 if no number is given]
    #[arg(long, value_name = "FOV", num_args = 0..=1, default_missing_value = "35", value_parser = parse_field_of_view)]
    pub(in crate::cli) perspective: Option<f64>,
    /// Size of the picture
    #[arg(long, default_value = "960x720", value_name = "WxH", value_parser = parse_size)]
    pub(in crate::cli) size: (usize, usize),
}

/// How a preview looks.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct PictureArgs {
    #[command(flatten)]
    pub(in crate::cli) seen: ViewArgs,
    /// Behind the surface: white, black, transparent, environment, or #rrggbb (sRGB)
    #[arg(long, default_value = "#2c3036", value_name = "COLOUR")]
    pub(in crate::cli) background: Background,
    /// What the camera has in view: the surface, or the whole box of the volume, so that pictures of several isovalues
    /// stay in register
    #[arg(long, value_enum, default_value = "surface")]
    pub(in crate::cli) frame: Frame,
    /// Where the solid reaches the border of the box: a flat face over the cut, or nothing, as meshes have it
    #[arg(long, value_enum, default_value = "flat")]
    pub(in crate::cli) cap: Cap,
    /// Rays along each side of a pixel
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=16))]
    pub(in crate::cli) supersampling: u8,
    /// From exposed radiance to colour: cut at white, or bent towards it
    #[arg(long, value_enum, default_value = "none")]
    pub(in crate::cli) tone: Tone,
    /// Draw a bar of a round length
    #[arg(long)]
    pub(in crate::cli) scale_bar: bool,
    /// Write N pictures of a full turn: -o DIR/ or a name with {frame}
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub(in crate::cli) turntable: Option<u32>,
    /// What a turntable turns
    #[arg(long, value_enum, default_value = "view")]
    pub(in crate::cli) turn: Turn,
}

/// What is seen where the box cuts the solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Cap {
    /// A flat face
    Flat,
    /// Nothing: the surface ends with an open edge
    Open,
}

/// What a turntable turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Turn {
    View,
    Light,
}

/// What the camera has in view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Frame {
    Surface,
    Box,
}

fn parse_field_of_view(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if (1.0..=150.0).contains(&degrees) => Ok(degrees),
        _ => Err("give degrees from 1 to 150".into()),
    }
}

const MOST_SIDE: usize = PictureOptions::MOST_SIDE;

fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((w, h)) if (1..=MOST_SIDE).contains(&w) && (1..=MOST_SIDE).contains(&h) => Ok((w, h)),
        _ => Err(format!("give a size such as 960x720, sides from 1 to {MOST_SIDE}")),
    }
}

impl ViewArgs {
    /// The projection asked for.
    pub(in crate::cli) fn projection(&self) -> Projection {
        self.perspective.map_or(Projection::Orthographic, Projection::Perspective)
    }
}

impl PictureArgs {
    /// A picture, without the view. `wall_paths` is the most paths of what is seen of walls.
    pub(in crate::cli) fn options(&self, wall_paths: u32) -> PictureOptions {
        let framing = match self.frame {
            // On a turntable what is seen keeps its size.
            _ if self.turntable.is_some() => Framing::Turntable,
            Frame::Surface => Framing::Surface,
            Frame::Box => Framing::Box,
        };
        PictureOptions {
            width: self.seen.size.0,
            height: self.seen.size.1,
            view: self.seen.view.view(Up::default()),
            projection: self.seen.projection(),
            framing,
            cap: self.cap == Cap::Flat,
            supersampling: usize::from(self.supersampling),
            background: self.background,
            tone: self.tone,
            scale_bar: self.scale_bar,
            wall_paths,
        }
    }

    /// The turntable, if pictures are of one.
    pub(in crate::cli) fn turntable(&self) -> Option<Turntable> {
        self.turntable.map(|frames| Turntable { frames, turns_light: self.turn == Turn::Light })
    }
}
