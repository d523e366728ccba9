//! What a file is that no reader takes: its name, and one way that works to a file that is read.
//!
//! The lines of Python were run, but for those of OpenVDB; `FILE` is the user's.

use crate::error::Error;

/// The formats that are read, for messages.
const READ: &str =
    "NIfTI, NRRD, MetaImage, DICOM, OME-Zarr, MRC, cube, OpenDX, VTK, VTI, TIFF, .npy, .npz, or raw with JSON";

/// Bytes that give a format away.
enum Mark {
    /// These, at a place.
    At(usize, &'static [u8]),
    /// The first word of a text, in any case.
    Word(&'static str),
}

use Mark::{At, Word};

const PICTURE: &str =
    "a volume is a folder of such pictures of one size, numbered from slice to slice:\n  isolume info FOLDER";
const MESH: &str = "a mesh has no values between its faces: give the volume that it was made from";
const BIOFORMATS: &str = "convert it with Bio-Formats:\n  bfconvert FILE FILE.ome.tif";
const UNPACK: &str = "unpack it first, or pack it with gzip";

/// Marks, name, and what to do. The first that fits counts.
const FORMATS: &[(&[Mark], &str, &str)] = &[
    (
        &[At(0, b"\x89HDF\r\n"), At(512, b"\x89HDF\r\n")],
        "HDF5 (also NetCDF-4, MINC 2, MATLAB 7.3)",
        "save the data set in Python, axes z, y, x:\n  import h5py, numpy\n  \
         numpy.save(\"FILE.npy\", h5py.File(\"FILE\")[\"NAME\"][...])\nand give --spacing X,Y,Z; MINC: mnc2nii FILE",
    ),
    (
        &[At(0, b"CDF\x01"), At(0, b"CDF\x02"), At(0, b"CDF\x05")],
        "NetCDF (also MINC 1)",
        "save the variable in Python, axes z, y, x:\n  import scipy.io, numpy\n  \
         numpy.save(\"FILE.npy\", scipy.io.netcdf_file(\"FILE\").variables[\"NAME\"][:])\nand give --spacing X,Y,Z",
    ),
    (
        &[At(0, b"SIMPLE  =")],
        "FITS",
        "save the cube in Python:\n  import numpy; from astropy.io import fits\n  \
         numpy.save(\"FILE.npy\", fits.getdata(\"FILE\"))\nand give --spacing X,Y,Z",
    ),
    (
        &[At(0, b" BDV\0\0\0\0")],
        "OpenVDB",
        "fill an array in Python and save it, axes z, y, x:\n  import numpy, openvdb\n  \
         grid = openvdb.read(\"FILE\", \"NAME\")\n  \
         lo, hi = grid.evalActiveVoxelBoundingBox()\n  \
         a = numpy.zeros([h - l + 1 for l, h in zip(lo, hi)], \"f4\")\n  \
         grid.copyToArray(a, lo); numpy.save(\"FILE.npy\", a.T)",
    ),
    (
        &[At(0, b"MATLAB 5.0")],
        "MATLAB",
        "save the array in Python, axes z, y, x:\n  import scipy.io, numpy\n  \
         numpy.save(\"FILE.npy\", scipy.io.loadmat(\"FILE\")[\"NAME\"].T)",
    ),
    (
        &[At(252, b"\xef\xff\xe9\xb0"), At(252, b"\x2a\xe3\x89\xb8")],
        "GIPL",
        "convert it in Python:\n  import SimpleITK as sitk\n  sitk.WriteImage(sitk.ReadImage(\"FILE\"), \"FILE.nrrd\")",
    ),
    (&[At(0, b"ZISRAWFILE")], "Zeiss CZI", BIOFORMATS),
    (&[At(0, b"\xda\xce\xbe\x0a")], "Nikon ND2", BIOFORMATS),
    (&[At(0, b"\xd0\xcf\x11\xe0")], "an OLE file, perhaps Olympus OIB or Zeiss ZVI", BIOFORMATS),
    (&[At(0, b"\x70\0\0\0")], "perhaps Leica LIF", BIOFORMATS),
    (&[At(0, b"\x89PNG"), At(0, b"\xff\xd8\xff"), At(0, b"BM"), At(0, b"GIF8")], "one picture", PICTURE),
    (
        &[At(0, b"\0\0\0\x0cjP"), At(0, b"\xff\x4f\xff\x51")],
        "JPEG 2000",
        "convert its slices to PNG; then: isolume info FOLDER",
    ),
    (
        &[At(0, b"\x76\x2f\x31\x01"), At(0, b"#?RADIANCE"), At(0, b"#?RGBE")],
        "an environment image",
        "it is light, not a volume: isolume relight VOLUME --env FILE …",
    ),
    (&[At(0, b"glTF"), At(0, b"ply\n"), At(0, b"ply\r"), Word("solid"), Word("v")], "a mesh", MESH),
    (&[At(257, b"ustar")], "a tar archive", "unpack it: tar xf FILE"),
    (&[At(0, b"\x1f\x8b")], "gzip within gzip", "unpack it once: gunzip FILE"),
    (&[At(0, b"BZh")], "bzip2", UNPACK),
    (&[At(0, b"\xfd7zXZ")], "xz", UNPACK),
    (&[At(0, b"\x28\xb5\x2f\xfd")], "zstd", UNPACK),
    (&[At(0, b"\x04\x22\x4d\x18")], "lz4", UNPACK),
    (&[At(0, b"Rar!"), At(0, b"7z\xbc\xaf")], "an archive", "unpack it first"),
    (&[At(0, b"%PDF")], "a PDF", "give the volume file"),
    (&[Word("<!doctype"), Word("<html")], "a web page", "the download did not give the file; fetch it again"),
];

/// The error for content of no format that is read.
pub(super) fn refused(head: &[u8]) -> Error {
    let (found, remedy) = named(head);
    Error::format("volume", found, READ, remedy)
}

/// Name and remedy.
fn named(head: &[u8]) -> (String, String) {
    if head.is_empty() {
        return ("an empty file".into(), "check how it was written or copied".into());
    }
    let text = String::from_utf8_lossy(head);
    // Comments come first in OpenDX.
    let line = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#')).unwrap_or("");
    let word = line.split(|c: char| c.is_whitespace() || c == '=' || c == '>').next().unwrap_or("");
    let fits = |mark: &Mark| match mark {
        At(at, bytes) => head.get(*at..).is_some_and(|rest| rest.starts_with(bytes)),
        Word(wanted) => word.eq_ignore_ascii_case(wanted),
    };
    if is_mgh(head) {
        let remedy = "convert it in Python:\n  import nibabel as nib\n  i = nib.load(\"FILE\")\n  \
                      nib.save(nib.Nifti1Image(i.dataobj, i.affine), \"FILE.nii.gz\")";
        return ("perhaps FreeSurfer's MGH (.mgz)".into(), remedy.into());
    }
    if let Some((_, name, remedy)) = FORMATS.iter().find(|(marks, ..)| marks.iter().any(&fits)) {
        return ((*name).into(), (*remedy).into());
    }
    if let Some(inside) = text.split_once("<VTKFile").map(|(_, inside)| inside) {
        return vtk_xml(inside);
    }
    if head.starts_with(b"PK\x03\x04") {
        return zip(&text);
    }
    if text.trim_start().starts_with("<?xml") {
        return ("XML, but not VTK's .vti".into(), "name the file with the samples".into());
    }
    let start: String = text.chars().take(24).collect();
    let remedy = "convert it to NRRD or .npy, or describe raw samples in a JSON sidecar:\n  \
                  {\"dims\": [X, Y, Z], \"type\": \"uint16\", \"data\": \"FILE\"}";
    (format!("a file that starts with {start:?}"), remedy.into())
}

/// Whether the first bytes look like FreeSurfer's: version 1, four sizes and a type from 0 to 10, all big-endian.
fn is_mgh(head: &[u8]) -> bool {
    let words = head.get(..24).map(|head| head.as_chunks::<4>().0).unwrap_or_default();
    let words: Vec<u32> = words.iter().map(|b| u32::from_be_bytes(*b)).collect();
    let is_size = |n: &u32| (1..1 << 20).contains(n);
    matches!(words.as_slice(), [1, sizes @ .., kind] if sizes.iter().all(is_size) && *kind <= 10)
}

/// VTK's formats in XML; `inside` follows `<VTKFile`.
fn vtk_xml(inside: &str) -> (String, String) {
    let kind = inside.split_once("type=").and_then(|(_, rest)| rest.split(['"', '\'']).nth(1)).unwrap_or("unknown");
    let remedy = match kind {
        "RectilinearGrid" | "StructuredGrid" | "UnstructuredGrid" | "PRectilinearGrid" | "PStructuredGrid"
        | "PUnstructuredGrid" => {
            "resample it to ImageData (ParaView: Resample To Image), in Python:\n  import pyvista\n  m = pyvista.read(\"FILE\")\n  \
             s = pyvista.create_grid(m, dimensions=(128, 128, 128)).sample(m)\n  \
             g = pyvista.ImageData(dimensions=s.dimensions, spacing=s.spacing)\n  \
             g[\"v\"] = s[\"NAME\"]; g.save(\"FILE.vti\")"
        }
        "PolyData" | "PPolyData" => MESH,
        _ => "save it as ImageData (.vti), for example in ParaView with Resample To Image",
    };
    (format!("VTK XML, {kind}"), remedy.into())
}

/// Zip archives by the first names in them.
fn zip(text: &str) -> (String, String) {
    if [".zattrs", ".zarray", ".zgroup", "zarr.json"].iter().any(|name| text.contains(name)) {
        return (
            "Zarr in a zip archive".into(),
            "unpack it: unzip FILE -d FILE.zarr; then: isolume info FILE.zarr".into(),
        );
    }
    ("a zip archive".into(), "unpack it: unzip FILE".into())
}

/// The error for a folder in which no slices lie, from the names in it.
pub(super) fn folder(names: &[String]) -> Error {
    let ends = |suffix: &str| names.iter().filter(|n| n.to_ascii_lowercase().ends_with(suffix)).count();
    let expected = "a volume file, a folder of slices (.tif, .png or DICOM), or OME-Zarr";
    let (found, remedy) = if names.is_empty() {
        ("an empty folder".into(), "name the volume file".into())
    } else {
        let pictures = ends(".jpg") + ends(".jpeg") + ends(".bmp") + ends(".gif");
        match pictures {
            0 => (format!("a folder of {} files", names.len()), "name the volume file in it".to_string()),
            n => (
                format!("a folder of {n} pictures"),
                "convert them to grey PNG: magick mogrify -format png -colorspace gray *.jpg".into(),
            ),
        }
    };
    Error::format("volume", found, expected, remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_named_with_a_way_out() {
        let at = |place: usize, bytes: &[u8]| [&vec![0; place], bytes].concat();
        let mut mgh = [0; 300];
        [3, 7, 11, 15, 19].into_iter().for_each(|at| mgh[at] = 1);
        let cases: [(Vec<u8>, &str, &str); 16] = [
            (b"<VTKFile type=\"PRectilinearGrid\" v".into(), "PRectilinearGrid", "Resample To Image"),
            (b"<?xml version=\"1.0\"?>\n<OME/>".into(), "XML", "name the file"),
            (b"<VTKFile type=\"UnstructuredGrid\" v".into(), "UnstructuredGrid", "resample"),
            (b"\x89HDF\r\n\x1a\n".into(), "HDF5", "h5py"),
            (b"CDF\x01".into(), "NetCDF", "netcdf_file"),
            (at(252, b"\xef\xff\xe9\xb0"), "GIPL", "SimpleITK"),
            (mgh.to_vec(), "MGH", "nibabel"),
            (b"PK\x03\x04....x/.zattrs".into(), "Zarr", "unzip"),
            (b"ZISRAWFILE\0\0".into(), "CZI", "bfconvert"),
            (b"\x70\0\0\0\x2a\0\0\0".into(), "LIF", "bfconvert"),
            (b"SIMPLE  =                    T".into(), "FITS", "astropy"),
            (b" BDV\0\0\0\0".into(), "OpenVDB", "openvdb"),
            (b"\x89PNG\r\n".into(), "one picture", "folder"),
            (b"\x1f\x8b\x08".into(), "gzip within gzip", "gunzip"),
            (at(257, b"ustar"), "tar", "tar xf"),
            (b"".into(), "an empty file", "copied"),
        ];
        for (head, name, remedy) in cases {
            let text = refused(&head).to_string();
            assert!(text.contains(name) && text.contains(remedy), "{text}");
        }
        assert!(refused(b"mystery").to_string().contains("\"mystery\""));
    }

    #[test]
    fn lines_of_remedies_fit_a_terminal() {
        for (.., remedy) in FORMATS {
            // The first line follows what was found.
            let long = remedy.lines().skip(1).find(|line| line.chars().count() > 80);
            assert_eq!(long, None);
        }
    }

    #[test]
    fn folders_are_named_for_what_they_are() {
        let text = |names: &[&str]| folder(&names.iter().map(|n| n.to_string()).collect::<Vec<_>>()).to_string();
        assert!(text(&["a.jpg", "b.jpg"]).contains("2 pictures"));
        assert!(text(&["a.npy"]).contains("1 files") && text(&[]).contains("empty"));
    }
}
