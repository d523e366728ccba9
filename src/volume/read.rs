//! Reading a volume from a byte stream. The format is decided by content, never by a suffix;
//! gzip is recognised and unpacked.
//!
//! Nothing is allocated because a header says so: claims are checked against overflow, against
//! [`ReadHint::max_bytes`] and, where the length is known, against the bytes that are left;
//! without a known length memory grows with the bytes that arrive. Of a gzip stream no more is
//! unpacked than the header asks for, plus 64 KiB to verify its checksum.
//!
//! | format | read | not read (refused by name) |
//! |---|---|---|
//! | NIfTI-1, -2 | .nii, pairs; all integer and real types; one time point and channel | complex, RGB |
//! | NRRD | attached and detached; raw, gzip, ascii; one time point and channel | lists of files, hex, bzip2 |
//! | MetaImage | .mha, .mhd; binary, zlib and text; one time point and channel | lists of files |
//! | MRC, CCP4 | modes 0, 1, 2, 6, 12; any axis order and cell | complex and packed modes |
//! | Gaussian cube | density and orbital files (first value of a point) | |
//! | OpenDX | regular grids, text and binary, of positions or cells | other objects |
//! | gOpenMol .plt | either byte order | |
//! | legacy VTK | STRUCTURED_POINTS, ASCII and BINARY | other data sets, vectors |
//! | VTK XML | .vti and .pvti: points or cells, text, base64 and raw, ZLib, LZ4 and LZMA; one array and component | other data sets |
//! | TIFF | grey pages; OME-TIFF, its sets of files and levels, and ImageJ by their metadata, one time point and channel; folders of slices | colour |
//! | DICOM | series of slices and enhanced multi-frame files, segments; plain, deflated, RLE, JPEG, JPEG 2000 | JPEG-LS, HTJ2K, colour |
//! | OME-Zarr, Zarr | folders of versions 2 and 3; gzip, zlib, zstd, LZ4, Blosc, shards; one level, time point and channel | other codecs, zip |
//! | NumPy .npy, .npz | three axes [z, y, x], either memory order | bool, complex, structures |
//! | raw | with a JSON sidecar | |

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::choice::Has;
use super::dicom;
use super::foreign;
use super::format::{cube, dx, metaimage, mrc, nifti, npy, npz, nrrd, plt, raw, tiff, vti, vtk};
use super::source::Source;
use super::{Choice, Solid, Volume};
use crate::error::{Error, Result};
use std::io::Read;
use std::path::Path;

/// What a reader is told beside the bytes.
#[derive(Clone, Debug)]
pub struct ReadHint {
    /// The name that the volume gets, such as the stem of its file.
    pub name: String,
    /// Which side will be matter. NaN and infinite samples become the extreme of the lit side:
    /// the smallest value for [`Solid::Above`], the largest for [`Solid::Below`].
    pub solid: Solid,
    /// Most bytes of samples that a header may claim; 64 GiB by default.
    pub max_bytes: u64,
    /// Length of the stream in bytes where it is known, so that a short file is refused before
    /// it is read.
    pub length: Option<u64>,
    /// Which part of the file is the volume, and its spacing.
    pub choice: Choice,
}

impl Default for ReadHint {
    fn default() -> Self {
        Self {
            name: "volume".into(),
            solid: Solid::Above,
            max_bytes: 64 << 30,
            length: None,
            choice: Choice::default(),
        }
    }
}

/// Opens a file named by a header, given its name as written there.
pub(crate) type OpenBeside<'a> = &'a dyn Fn(&Path) -> Result<Source<'static>>;

/// Reads a volume from a stream. World coordinates, unit and scaling come from the file; up is
/// z and `solid` is the hint's.
///
/// # Errors
/// When the content is of no known format, is damaged or truncated, claims more than
/// [`ReadHint::max_bytes`], holds no finite sample, or refers to a second file (use
/// [`super::open::open`] for those). Errors do not name a file: see [`Error::in_file`].
pub fn read(source: impl Read, hint: &ReadHint) -> Result<Volume> {
    read_with(Source::new(source, hint.length), hint, None)
}

/// Bytes looked at to decide the format: enough for the magic of NIfTI at 344, an MRC header, and
/// a cube file's first six lines with long comments.
const LOOK_AHEAD: usize = 4096;

pub(crate) fn read_with(mut source: Source, hint: &ReadHint, beside: Option<OpenBeside>) -> Result<Volume> {
    let from_read = |e| Error::from_read("volume", "the first bytes of a volume file", e);
    if source.is_gzip().map_err(from_read)? {
        source = source.gunzip();
    }
    let head = source.peek(LOOK_AHEAD).map_err(from_read)?;
    let format = detect(head)?;
    if !matches!(format, Format::Nifti | Format::Nrrd | Format::MetaImage | Format::Tiff | Format::Vti | Format::Dicom)
    {
        // Of these a file holds one volume.
        hint.choice.of("volume", Vec::new(), 1, &mut Vec::new())?;
    }
    hint.choice.fits(Has {
        arrays: matches!(format, Format::Vti | Format::Npz),
        levels: format == Format::Tiff,
        scans: format == Format::Dicom,
    })?;
    match format {
        Format::Nifti => nifti::read(source, hint, beside),
        Format::Nrrd => nrrd::read(source, hint, beside),
        Format::MetaImage => metaimage::read(source, hint, beside),
        Format::Mrc => mrc::read(source, hint),
        Format::Cube => cube::read(source, hint),
        Format::Vtk => vtk::read(source, hint),
        Format::Vti => vti::read(source, hint, beside),
        Format::Tiff => tiff::read_stream(source, hint),
        Format::Npy => npy::read(source, hint),
        Format::Npz => npz::read_stream(source, hint),
        Format::Dx => dx::read(source, hint),
        Format::Plt => plt::read(source, hint),
        Format::Dicom => dicom::read_stream(source, hint),
        Format::Raw => raw::read(source, hint, beside),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Nifti,
    Nrrd,
    MetaImage,
    Mrc,
    Cube,
    Vtk,
    Vti,
    Tiff,
    Npy,
    Npz,
    Dx,
    Plt,
    Dicom,
    Raw,
}

/// The format of a file from its first bytes.
pub(crate) fn detect(head: &[u8]) -> Result<Format> {
    let at = |offset: usize, magic: &[u8]| head.get(offset..).is_some_and(|rest| rest.starts_with(magic));
    if dicom::is_dicom(head) {
        return Ok(Format::Dicom);
    }
    if at(0, b"NRRD") {
        return Ok(Format::Nrrd);
    }
    if at(0, b"# vtk DataFile") {
        return Ok(Format::Vtk);
    }
    if vti::is_xml(head) {
        return Ok(Format::Vti);
    }
    if at(0, b"\x93NUMPY") {
        return Ok(Format::Npy);
    }
    if [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| at(0, *magic)) {
        return Ok(Format::Tiff);
    }
    if nifti::is_nifti(head)? {
        return Ok(Format::Nifti);
    }
    if mrc::is_mrc(head) {
        return Ok(Format::Mrc);
    }
    if npz::is_npz(head) {
        return Ok(Format::Npz);
    }
    if plt::is_plt(head) {
        return Ok(Format::Plt);
    }
    if dx::is_dx(head) {
        return Ok(Format::Dx);
    }
    if metaimage::is_metaimage(head) {
        return Ok(Format::MetaImage);
    }
    let first = head.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(0);
    if at(first, b"{") {
        return Ok(Format::Raw);
    }
    if cube::is_cube(head) {
        return Ok(Format::Cube);
    }
    Err(foreign::refused(head))
}
