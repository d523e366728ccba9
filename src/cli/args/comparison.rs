//! Pictures of a comparison as options.

use crate::cli::args::picture;
use crate::compare::picture::{PictureLook, PicturePatterns};
use crate::error::Result;
use crate::export::inputs::Inputs;
use crate::geom::Up;
use std::path::PathBuf;

/// Which pictures to write.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Pictures")]
pub(in crate::cli) struct PictureOutput {
    /// Write a picture: store, reference, and their difference; {isovalue} and {env} in the name for several
    #[arg(long, value_name = "FILE.png")]
    png: Option<PathBuf>,
    /// Write the surface with the difference as vertex colours; store and reference are attributes beside them
    #[arg(long, value_name = "FILE.glb")]
    glb: Option<PathBuf>,
    /// Write the surface as the reference lights it, by paths or, with --against photon, by photons
    #[arg(long, value_name = "FILE.glb")]
    direct: Option<PathBuf>,
    #[command(flatten)]
    seen: picture::ViewArgs,
    /// Difference that shows in full colour, such as 10%, over the mean radiance [default: what 98 % of it is below]
    #[arg(long, value_name = "E", value_parser = parse_scale)]
    scale: Option<f64>,
}

impl PictureOutput {
    /// The files of some surfaces under some lights.
    pub(in crate::cli) fn files(&self) -> PicturePatterns<'_> {
        PicturePatterns { png: self.png.as_deref(), glb: self.glb.as_deref(), direct: self.direct.as_deref() }
    }

    /// How pictures look of what has `up` up.
    pub(in crate::cli) fn look(&self, up: Up) -> PictureLook {
        let seen = &self.seen;
        PictureLook { view: seen.view.view(up), projection: seen.projection(), size: seen.size, scale: self.scale }
    }

    /// Refuses files to write that are read.
    pub(in crate::cli) fn refuse(&self, inputs: &Inputs) -> Result<()> {
        self.png.iter().chain(&self.glb).chain(&self.direct).try_for_each(|path| inputs.refuse(path))
    }
}

fn parse_scale(text: &str) -> std::result::Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |percent| (percent, 100.0));
    match number.trim().parse::<f64>().map(|n| n / unit) {
        Ok(scale) if scale > 0.0 && scale.is_finite() => Ok(scale),
        _ => Err("give a positive number such as 0.1 or 10%".into()),
    }
}
