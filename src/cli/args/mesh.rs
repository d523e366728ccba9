//! Options of mesh files: what is in them, for whom, and how many levels of detail.

use crate::export::lightmap::SIDES;
use crate::export::simplify::Lod;
use crate::session::MeshOptions;

#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct MeshArgs {
    /// Add the true linear radiance as attribute _RADIANCE, and its standard error as _STDERR
    #[arg(long)]
    radiance: bool,
    /// Store COLOR_0 as 32-bit floats
    #[arg(long)]
    float_color: bool,
    /// Store the transfer of each vertex in .glb files, for relighting elsewhere
    #[arg(long)]
    transfer: bool,
    /// glTF units (metres) to a world unit [default: 0.001 where the file's unit is mm; else the longest side of the
    /// volume becomes 1 m. The size in metres is printed]
    #[arg(long, value_name = "S")]
    pub(in crate::cli) scale: Option<f64>,
    /// Leave so many triangles, 20000 or 25%, where shape and colours change least; how far they change is printed.
    /// For several levels of detail: a name with {lod}
    #[arg(long, value_name = "N|P%[,…]", value_delimiter = ',')]
    pub(in crate::cli) lod: Vec<Lod>,
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
    /// What goes into a file.
    pub(in crate::cli) fn options(&self) -> MeshOptions {
        MeshOptions {
            radiance: self.radiance,
            float_colour: self.float_color,
            transfer: self.transfer,
            scale: self.scale,
            lod: None,
            lightmap: self.lightmap,
            for_web: self.purpose == Some(Use::Web),
        }
    }
}
