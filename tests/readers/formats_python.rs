//! Files as other programs write them, against what those say of them: tifffile (OME-TIFF, ImageJ), SimpleITK and pynrrd
//! (4D NRRD), nibabel (4D NIfTI). Runs with the interpreter that ISOLUME_PYTHON names, `python3` otherwise, and skips
//! where it lacks one of them.

use super::python;
use isolume::volume::{Channel, Choice, LengthUnit, ReadHint, Volume, open_with};
use std::path::Path;
use std::process::Command;

/// The phantom: 5 × 7 × 9 samples, value = 100x + 10y + z, plus 1000 · channel + 2000 · time.
const SCRIPT: &str = r#"
import sys, numpy, tifffile, SimpleITK, nibabel, nrrd
out = sys.argv[1] + "/"
z, y, x = numpy.mgrid[0:9, 0:7, 0:5]
tczyx = numpy.array([[100*x + 10*y + z + 1000*c + 2000*t for c in range(2)] for t in range(3)], "u2")
sizes = dict(PhysicalSizeX=0.5, PhysicalSizeY=0.7, PhysicalSizeZ=1100, PhysicalSizeZUnit="nm")
for axes in ("TCZYX", "TZCYX", "CTZYX", "ZTCYX"):
    data = tczyx.transpose(["TCZYX".index(a) for a in axes])
    tifffile.imwrite(out + axes + ".ome.tif", data, metadata=dict(axes=axes, Channel=dict(Name=["DAPI", "GFP"]), **sizes))
with tifffile.TiffWriter(out + "pyramid.ome.tif") as tif:
    tif.write(tczyx[0, 0], subifds=1, metadata=dict(axes="ZYX", **sizes))
    for page in tczyx[0, 0][:, ::2, ::2]: tif.write(page, subfiletype=1)
tifffile.imwrite(out + "imagej.tif", tczyx.transpose(0, 2, 1, 3, 4), imagej=True, resolution=(2.0, 1/0.7),
                 metadata=dict(axes="TZCYX", spacing=1.1, unit="um"))
images = []
for t in range(3):
    image = SimpleITK.GetImageFromArray(tczyx[t, 0])
    image.SetSpacing((0.5, 0.7, 1.1)); image.SetOrigin((10, -20, 30))
    image.SetDirection((0, -1, 0, 1, 0, 0, 0, 0, 1))
    images.append(image)
SimpleITK.WriteImage(SimpleITK.JoinSeries(images), out + "series.nrrd")
SimpleITK.WriteImage(SimpleITK.Compose([SimpleITK.GetImageFromArray(tczyx[0, c]) for c in range(2)]), out + "vector.nrrd")
affine = numpy.array([[0, -.7, 0, 10], [.5, 0, 0, -20], [0, 0, 1.1, 30], [0, 0, 0, 1]])
nibabel.save(nibabel.Nifti1Image(tczyx.transpose(4, 3, 2, 0, 1).astype("i2"), affine), out + "series.nii.gz")
nrrd.write(out + "list.nrrd", tczyx.transpose(0, 4, 3, 2, 1)[:, :, :, :, 0], {"kinds": ["list", "domain", "domain", "domain"],
    "space dimension": 3, "space directions": numpy.array([[numpy.nan] * 3, [.5, 0, 0], [0, .7, 0], [0, 0, 1.1]])})
"#;

fn read(path: &Path, channel: Option<&str>, timepoint: usize) -> Volume {
    let channel = channel.map(|c| c.parse::<Channel>().expect("a channel"));
    let choice = Choice { channel, timepoint: Some(timepoint), ..Choice::default() };
    open_with(path, &ReadHint { choice, ..ReadHint::default() }).unwrap_or_else(|e| panic!("{e}"))
}

fn assert_phantom(volume: &Volume, shift: f32, what: &str) {
    assert_eq!(volume.dims(), [5, 7, 9], "{what}");
    for z in 0..9 {
        for y in 0..7 {
            for x in 0..5 {
                let expected = (100 * x + 10 * y + z) as f32 + shift;
                assert_eq!(volume.samples().raw(volume.index(x, y, z)), expected, "{what} at {x} {y} {z}");
            }
        }
    }
}

#[test]
fn files_of_other_programs_keep_their_planes_and_their_place() {
    let Some(python) = python("import tifffile, SimpleITK, nibabel, nrrd") else {
        println!("skipped: no Python with tifffile, SimpleITK, nibabel and pynrrd (set ISOLUME_PYTHON)");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let run = Command::new(python).arg("-c").arg(SCRIPT).arg(folder.path()).output().expect("Python");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let at = |name: &str| folder.path().join(name);

    for name in ["TCZYX.ome.tif", "TZCYX.ome.tif", "CTZYX.ome.tif", "ZTCYX.ome.tif", "imagej.tif"] {
        let refused = open_with(at(name), &ReadHint::default()).expect_err(name).to_string();
        assert!(refused.contains("2 channels"), "{refused}");
        for (channel, c) in [("0", 0), ("1", 1)] {
            for t in 0..3 {
                let volume = read(&at(name), Some(channel), t);
                assert_phantom(&volume, (1000 * c + 2000 * t) as f32, name);
                let spacing = volume.world_from_grid().spacing();
                // ImageJ's resolution is a fraction of 32-bit numbers.
                assert!((spacing - glam::DVec3::new(0.5, 0.7, 1.1)).length() < 1e-6, "{name}: {spacing}");
                assert_eq!(volume.unit, LengthUnit::Metres(1e-6), "{name}");
            }
        }
    }
    assert_phantom(&read(&at("ZTCYX.ome.tif"), Some("GFP"), 2), 5000.0, "by name");
    assert_phantom(&read(&at("pyramid.ome.tif"), None, 0), 0.0, "a pyramid in SubIFDs");

    // The world position of every sample, from the direction cosines that the script sets: NRRD of ITK is LPS, ours RAS.
    for t in 0..3 {
        for (name, sign) in [("series.nrrd", -1.0), ("series.nii.gz", 1.0)] {
            let channel = (name == "series.nii.gz").then_some("0");
            let volume = read(&at(name), channel, t);
            assert_phantom(&volume, 2000.0 * t as f32, name);
            for (x, y, z) in [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 6.0, 0.0), (4.0, 6.0, 8.0)] {
                let lps = glam::DVec3::new(10.0 - 0.7 * y, -20.0 + 0.5 * x, 30.0 + 1.1 * z);
                let expected = glam::DVec3::new(sign * lps.x, sign * lps.y, lps.z);
                let found = volume.world_from_grid().point(glam::DVec3::new(x, y, z));
                // NIfTI keeps 32-bit numbers.
                assert!((found - expected).length() < 1e-5, "{name}: {found} is not {expected}");
            }
        }
    }
    assert_phantom(&read(&at("vector.nrrd"), Some("1"), 0), 1000.0, "a vector image");
    assert_phantom(&read(&at("list.nrrd"), Some("2"), 0), 4000.0, "a list of volumes");
}
