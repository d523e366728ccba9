//! Which mesh files a job writes: levels of detail, and what none of the files can have.

use super::Job;
use crate::error::{Error, Result};
use crate::export::png::check_size;
use crate::export::simplify::Lod;
use crate::export::target::{Format, Target, make_folder};
use crate::session::USDZ_SIDE;
use std::path::{Path, PathBuf};

impl Job<'_> {
    /// Refuses what none of the files can have.
    pub(super) fn check_meshes(&self, files: &[Target]) -> Result<()> {
        let mesh = &self.mesh;
        let is_glb = |f: &Target| f.format == Format::Glb;
        if mesh.transfer && !files.iter().any(is_glb) {
            let remedy = "transfer is carried by glTF alone: add -o NAME.glb, or leave out --transfer";
            return Err(Error::argument("--transfer", "without a .glb", "an output that ends in .glb", remedy));
        }
        if mesh.for_web && !files.iter().any(is_glb) {
            let remedy = "add -o NAME.glb, or leave out --for";
            return Err(Error::argument("--for", "web without a .glb", "an output that ends in .glb", remedy));
        }
        if mesh.for_web && mesh.float_colour {
            let remedy = "leave out --float-color: 16 bits are exact to 1/131,070";
            return Err(Error::argument("--float-color", "with --for web", "colours of 16 bits", remedy));
        }
        if mesh.lightmap.is_some() && !files.iter().any(|f| matches!(f.format, Format::Glb | Format::Usdz)) {
            let expected = "an output that ends in .glb or .usdz";
            let remedy = "add -o NAME.glb, or leave out --lightmap";
            return Err(Error::argument("--lightmap", "without a file that can hold it", expected, remedy));
        }
        if mesh.lightmap.is_some() && mesh.float_colour {
            let remedy = "leave out --float-color: the picture has the colours";
            return Err(Error::argument("--float-color", "with --lightmap", "colours in a picture", remedy));
        }
        if !self.lods.is_empty() && files.iter().all(|f| f.format == Format::Png) {
            let remedy = "pictures show the isosurface itself: add -o NAME.glb, or leave out --lod";
            return Err(Error::argument(
                "--lod",
                "without a mesh file",
                "an output that ends in .glb, .ply, .stl or .usdz",
                remedy,
            ));
        }
        Ok(())
    }

    /// The outputs that a path stands for: one for each level of detail.
    pub(super) fn levels(&self, output: &Path) -> Result<Vec<(Option<Lod>, PathBuf)>> {
        const PLACE: &str = "{lod}";
        let text = output.to_string_lossy();
        let is_picture = text.to_ascii_lowercase().ends_with(".png");
        if text.contains(PLACE) && (self.lods.is_empty() || is_picture) {
            let expected = if is_picture { "a name without {lod}" } else { "--lod with it" };
            let remedy = "pictures have no levels of detail; meshes have with --lod 50%,10%";
            return Err(Error::argument("output", output.display(), expected, remedy));
        }
        if self.lods.is_empty() || is_picture {
            return Ok(vec![(None, output.to_path_buf())]);
        }
        if self.lods.len() > 1 && !text.contains(PLACE) {
            let expected = format!("{PLACE} in the name for {} levels of detail", self.lods.len());
            let remedy = "write for example -o \"surface-{lod}.glb\"";
            return Err(Error::argument("output", output.display(), expected, remedy));
        }
        // A percent sign is a variable to some shells.
        let name = |lod: &Lod| text.replace(PLACE, &lod.to_string().replace('%', "pct"));
        Ok(self.lods.iter().map(|lod| (Some(*lod), name(lod).into())).collect())
    }

    /// Makes the directories that outputs name, level by level of detail.
    pub(super) fn make_folders(&self) -> Result<()> {
        for output in self.outputs {
            self.levels(output)?.iter().try_for_each(|(_, path)| make_folder(path))?;
        }
        Ok(())
    }

    /// Refuses a picture of the colours that memory does not hold.
    pub(super) fn check_lightmap(&self, files: &[Target]) -> Result<()> {
        let side_of = |file: &Target| match file.format {
            Format::Glb => self.mesh.lightmap,
            Format::Usdz => Some(self.mesh.lightmap.unwrap_or(USDZ_SIDE)),
            _ => None,
        };
        let Some(side) = files.iter().filter_map(side_of).max() else { return Ok(()) };
        check_size((side as usize, side as usize), self.quality.memory_limit).map_err(|e| match e {
            Error::Limit { needed, limit, .. } => {
                let remedy = "give a smaller --lightmap".into();
                Error::Limit { what: format!("a lightmap of {side} × {side} texels"), needed, limit, remedy }
            }
            other => other,
        })
    }
}
