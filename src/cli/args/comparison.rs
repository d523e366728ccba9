//! Pictures of a comparison as options.

use crate::cli::args::picture;
use crate::cli::failure::Outcome;
use crate::compare::picture::Shown;
use crate::error::{Error, Result};
use crate::export::inputs::Inputs;
use crate::export::target;
use crate::export::target::Target;
use std::path::{Path, PathBuf};

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

/// The files of one surface under one light.
#[derive(Default)]
pub(in crate::cli) struct Files {
    png: Option<Target>,
    glb: Option<Target>,
    direct: Option<Target>,
}

impl Files {
    pub(in crate::cli) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.png.iter().chain(&self.glb).chain(&self.direct).map(|t| t.path.as_path())
    }
}

impl PictureOutput {
    /// The files to write, isovalue-major; each can be written.
    pub(in crate::cli) fn files(&self, name: &str, isovalues: &[f64], environments: &[String]) -> Outcome<Vec<Files>> {
        let of = |path: &Option<PathBuf>, suffix: &str| -> Outcome<Vec<Option<Target>>> {
            let Some(path) = path else { return Ok(vec![None; isovalues.len() * environments.len()]) };
            if path.extension().is_none_or(|e| e != suffix) {
                let expected = format!("a name ending in .{suffix}");
                return Err(Error::argument("output", path.display(), expected, "the ending decides the format").into());
            }
            Ok(target::targets(path, name, isovalues, environments)?.into_iter().map(Some).collect())
        };
        if let (Some(difference), Some(direct)) = (&self.glb, &self.direct)
            && difference == direct
        {
            let expected = "a file of its own, beside that of --glb";
            return Err(Error::argument("--direct", direct.display(), expected, "give another name").into());
        }
        let (pngs, glbs, directs) = (of(&self.png, "png")?, of(&self.glb, "glb")?, of(&self.direct, "glb")?);
        let all = pngs.into_iter().zip(glbs).zip(directs);
        Ok(all.map(|((png, glb), direct)| Files { png, glb, direct }).collect())
    }

    /// The files of several volumes: none.
    pub(in crate::cli) fn none(&self) -> Result<Vec<Files>> {
        match self.png.as_ref().or(self.glb.as_ref()).or(self.direct.as_ref()) {
            None => Ok(Vec::new()),
            Some(path) => {
                let expected = "one volume: a picture of a comparison shows one";
                Err(Error::argument("output", path.display(), expected, "add --volume NAME"))
            }
        }
    }

    /// Computes both answers anew at the pixels and at the vertices, and writes what is asked for.
    pub(in crate::cli) fn write(&self, files: &Files, shown: &Shown<'_>) -> Result<()> {
        if let Some(target) = &files.png {
            let seen = (self.seen.view.view(shown.question.surface.volume.up), self.seen.projection());
            shown.write_png(&target.path, seen, self.seen.size, self.scale)?;
        }
        if let Some(target) = &files.glb {
            shown.write_glb(&target.path, self.scale)?;
        }
        if let Some(target) = &files.direct {
            shown.write_direct(&target.path)?;
        }
        Ok(())
    }
}
