//! The volume argument: a file or an analytic field by name.

use crate::geom::Up;
use crate::scene::{Front, VolumeOptions};
use crate::volume::{Channel, Choice, Level, Region, Solid, Spacing};

/// How a volume is to be understood.
#[derive(clap::Args, Clone, Debug, Default)]
pub(in crate::cli) struct VolumeArgs {
    /// Which side of the isovalue is solid [default: above]
    #[arg(long, value_enum, value_name = "SIDE")]
    pub(in crate::cli) solid: Option<Solid>,
    /// The world axis that points up: x, y, z, -x, -y, -z [default: z]
    #[arg(long, value_parser = |axis: &str| Up::named(axis).ok_or("give one of x, y, z, -x, -y, -z"), allow_hyphen_values = true, value_name = "AXIS")]
    pub(in crate::cli) up: Option<Up>,
    /// Distance of the samples along x, y, z in place of the file's, perhaps with a unit: mm, um, nm, A, bohr
    #[arg(long, value_name = "X,Y,Z[UNIT]")]
    pub(in crate::cli) spacing: Option<Spacing>,
    /// The channel of a file that has several (OME-Zarr, OME-TIFF, ImageJ, NIfTI, NRRD, MetaImage; a component of VTI), counted from
    /// 0, or its name
    #[arg(long, value_name = "N|NAME")]
    pub(in crate::cli) channel: Option<Channel>,
    /// The time point of a file that has several, counted from 0 [default: the first]
    #[arg(long, value_name = "N")]
    pub(in crate::cli) timepoint: Option<usize>,
    /// The array of a file that names several (VTI, .npz, Zarr) [default: the one that the file names, or the only one]
    #[arg(long, value_name = "NAME")]
    pub(in crate::cli) array: Option<String>,
    /// The series of a folder of DICOM files that holds several, counted from 0, or its UID
    #[arg(long, value_name = "N|UID")]
    pub(in crate::cli) series: Option<String>,
    /// The level of a pyramid (OME-Zarr, OME-TIFF), 0 the finest, or auto: the finest of at most 2^28 samples [default: 0]
    #[arg(long, value_name = "N|auto")]
    pub(in crate::cli) level: Option<Level>,
    /// Read this box of samples only, ends not included, an empty one the first or last: 100:228,0:128,:
    #[arg(long, value_name = "X0:X1,Y0:Y1,Z0:Z1")]
    pub(in crate::cli) region: Option<Region>,
    /// Interpolate slices that are missing between others (DICOM, folders of pictures) instead of refusing
    #[arg(long)]
    pub(in crate::cli) allow_gaps: bool,
    /// Drop all parts of the solid but the largest, such as the table below a head: at the isovalue asked for, of several at
    /// the outermost. The volume is masked before the bake, so what is dropped casts no shadow either
    #[arg(long)]
    pub(in crate::cli) keep_largest: bool,
    /// Read files that lie outside the folder of the file that names them (NRRD `data file`, raw sidecars)
    #[arg(long)]
    pub(in crate::cli) allow_outside: bool,
    /// Read the whole volume into memory where its samples could be read in a file (its own, or one that a store names), which must not change
    #[arg(long)]
    pub(in crate::cli) no_map: bool,
    /// Front of views and of glTF: -y of the file where z is up, or anterior [default: anatomical for NIfTI with a
    /// transform code and for NRRD with a patient's space, else grid]
    #[arg(long, value_enum, value_name = "FRAME")]
    pub(in crate::cli) frame_of: Option<Front>,
}

impl VolumeArgs {
    /// The same for the library; all shadows count.
    pub(in crate::cli) fn options(&self) -> VolumeOptions {
        let choice = Choice {
            channel: self.channel.clone(),
            timepoint: self.timepoint,
            array: self.array.clone(),
            series: self.series.clone(),
            level: self.level,
            region: self.region,
            spacing: self.spacing,
            allow_gaps: self.allow_gaps,
            allow_outside: self.allow_outside,
            map: !self.no_map,
            any_channel: false,
        };
        VolumeOptions {
            solid: self.solid,
            up: self.up,
            front: self.frame_of,
            choice,
            keep_largest: self.keep_largest,
            ..VolumeOptions::default()
        }
    }
}
