//! Options of mesh files: what is in them, for whom, and how many levels of detail.

use crate::cli::Outcome;
use crate::cli::output::{Format, Target};
use crate::error::{Error, Result};
use crate::export::lightmap::SIDES;
use crate::export::simplify::Lod;
use crate::session::MeshOptions;
use std::path::{Path, PathBuf};

#[derive(clap::Args, Clone, Debug)]
pub(super) struct MeshArgs {
    /// Add the true linear radiance as attribute _RADIANCE, and its standard error as _STDERR
    #[arg(long)]
    radiance: bool,
    /// Store COLOR_0 as 32-bit floats
    #[arg(long)]
    float_color: bool,
    /// Store the transfer of each vertex in .glb files, for relighting elsewhere
    #[arg(long)]
    pub(super) transfer: bool,
    /// glTF units (metres) to a world unit [default: 0.001 where the file's unit is mm; else the longest side of the
    /// volume becomes 1 m. The size in metres is printed]
    #[arg(long, value_name = "S")]
    pub(super) scale: Option<f64>,
    /// Leave so many triangles, 20000 or 25%, where shape and colours change least; how far they change is printed.
    /// For several levels of detail: a name with {lod}
    #[arg(long, value_name = "N|P%[,…]", value_delimiter = ',')]
    lod: Vec<Lod>,
    /// Make .glb files small, a quarter of the bytes, for three.js, Babylon.js and what is built on them; Blender, VTK and
    /// trimesh refuse such files
    #[arg(long = "for", value_name = "USE")]
    purpose: Option<Use>,
    /// Put the colours of .glb files into a picture of so many texels a side, for readers that drop vertex colours: 1024 for
    /// 20,000 triangles. .usdz always has one, of 2048
    #[arg(long, value_name = "SIDE", value_parser = clap::value_parser!(u32).range(i64::from(*SIDES.start())..=i64::from(*SIDES.end())))]
    lightmap: Option<u32>,
}

/// Who opens a file.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq)]
enum Use {
    Web,
}

impl MeshArgs {
    /// Refuses what none of the files can have.
    pub(super) fn check(&self, files: &[Target]) -> Result<()> {
        let is_glb = |f: &Target| f.format == Format::Glb;
        if self.transfer && !files.iter().any(is_glb) {
            let remedy = "transfer is carried by glTF alone: add -o NAME.glb, or leave out --transfer";
            return Err(Error::argument("--transfer", "without a .glb", "an output that ends in .glb", remedy));
        }
        if self.purpose.is_some() && !files.iter().any(is_glb) {
            let remedy = "add -o NAME.glb, or leave out --for";
            return Err(Error::argument("--for", "web without a .glb", "an output that ends in .glb", remedy));
        }
        if self.purpose.is_some() && self.float_color {
            let remedy = "leave out --float-color: 16 bits are exact to 1/131,070";
            return Err(Error::argument("--float-color", "with --for web", "colours of 16 bits", remedy));
        }
        if self.lightmap.is_some() && !files.iter().any(|f| matches!(f.format, Format::Glb | Format::Usdz)) {
            let expected = "an output that ends in .glb or .usdz";
            let remedy = "add -o NAME.glb, or leave out --lightmap";
            return Err(Error::argument("--lightmap", "without a file that can hold it", expected, remedy));
        }
        if self.lightmap.is_some() && self.float_color {
            let remedy = "leave out --float-color: the picture has the colours";
            return Err(Error::argument("--float-color", "with --lightmap", "colours in a picture", remedy));
        }
        if !self.lod.is_empty() && files.iter().all(|f| f.format == Format::Png) {
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
    pub(super) fn levels(&self, output: &Path) -> Outcome<Vec<(Option<Lod>, PathBuf)>> {
        const PLACE: &str = "{lod}";
        let text = output.to_string_lossy();
        let is_picture = text.to_ascii_lowercase().ends_with(".png");
        if text.contains(PLACE) && (self.lod.is_empty() || is_picture) {
            let expected = if is_picture { "a name without {lod}" } else { "--lod with it" };
            let remedy = "pictures have no levels of detail; meshes have with --lod 50%,10%";
            return Err(Error::argument("output", output.display(), expected, remedy).into());
        }
        if self.lod.is_empty() || is_picture {
            return Ok(vec![(None, output.to_path_buf())]);
        }
        if self.lod.len() > 1 && !text.contains(PLACE) {
            let expected = format!("{PLACE} in the name for {} levels of detail", self.lod.len());
            let remedy = "write for example -o \"surface-{lod}.glb\"";
            return Err(Error::argument("output", output.display(), expected, remedy).into());
        }
        // A percent sign is a variable to some shells.
        let name = |lod: &Lod| text.replace(PLACE, &lod.to_string().replace('%', "pct"));
        Ok(self.lod.iter().map(|lod| (Some(*lod), name(lod).into())).collect())
    }

    /// What goes into a file.
    pub(super) fn options(&self, lod: Option<Lod>) -> MeshOptions {
        MeshOptions {
            radiance: self.radiance,
            float_colour: self.float_color,
            transfer: self.transfer,
            scale: self.scale,
            lod,
            lightmap: self.lightmap,
            for_web: self.purpose == Some(Use::Web),
        }
    }
}
