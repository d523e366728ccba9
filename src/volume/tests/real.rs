//! Real files. Figures come from nibabel 5, mrcfile 1.5, pynrrd 1.1 and VTK 9, by hand.

use super::*;
use std::path::PathBuf;

/// A file of the data folder, or `None` with the reason printed.
fn data(name: &str) -> Option<Volume> {
    path(name).map(|path| open(path).unwrap())
}

fn path(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("ISOLUME_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = folder.join("volumes").join(name);
    if !path.exists() {
        println!("skipped: {} is absent (set ISOLUME_DATA)", path.display());
        return None;
    }
    Some(path)
}

fn sum(volume: &Volume) -> f64 {
    (0..volume.samples().len()).map(|i| f64::from(volume.samples().raw(i))).sum()
}

fn raw(volume: &Volume, x: usize, y: usize, z: usize) -> f32 {
    volume.samples().raw(volume.index(x, y, z))
}

/// Where the largest sample sits.
fn argmax(volume: &Volume) -> (usize, usize, usize) {
    let high = volume.raw_range().1;
    points(volume.dims()).find(|&(x, y, z)| raw(volume, x, y, z) == high).unwrap()
}

#[test]
fn brain() {
    let Some(v) = data("mni152_t1.nii.gz") else { return };
    assert_eq!((v.dims(), v.samples().type_name(), v.value_range()), ([197, 233, 189], "uint8", (0.0, 255.0)));
    assert_eq!(sum(&v), 333_468_829.0);
    assert_eq!((raw(&v, 98, 116, 94), raw(&v, 60, 70, 50)), (198.0, 146.0));
    assert_eq!(v.world_from_grid().point(DVec3::ZERO), DVec3::new(-98.0, -134.0, -72.0));
    assert_eq!(v.world_from_grid().linear(), glam::DMat3::IDENTITY);
    assert_eq!((v.name.as_str(), v.slope(), v.inter()), ("mni152_t1", 1.0, 0.0));
    // xyzt_units is 0: the file does not say millimetres.
    assert_eq!(v.unit, LengthUnit::Unknown);

    let Some(half) = data("mni152_t1_2mm.nii.gz") else { return };
    assert_eq!((half.dims(), half.value_range(), sum(&half)), ([98, 116, 94], (0.0, 243.0), 41_683_619.0));
    assert_eq!(half.world_from_grid().point(DVec3::ONE), DVec3::new(-95.5, -131.5, -69.5));
}

#[test]
fn permuted_crystal_map() {
    let Some(v) = data("rna_1jzv.ccp4") else { return };
    // In the file: 96×76×70 along y, x, z, starting at −4, −23, 102 of 84, 84, 160 intervals.
    assert_eq!((v.dims(), v.samples().type_name()), ([76, 96, 70], "float32"));
    assert_eq!(v.raw_range(), (-0.993_094_2, 9.050_404));
    assert!((sum(&v) - -296.273_270_333_865_9).abs() < 1e-6);
    assert_eq!(raw(&v, 2, 1, 3), 0.031_597_458); // mrcfile's data[3, 2, 1]
    assert_eq!(argmax(&v), (29, 21, 10)); // and its argmax [10, 29, 21]
    let spacing = DVec3::new(45.8 / 84.0, 45.8 / 84.0, 89.65 / 160.0);
    // The cell is stored in f32.
    assert_close(v.world_from_grid().spacing(), spacing, 1e-6);
    assert_close(v.world_from_grid().offset(), spacing * DVec3::new(-23.0, -4.0, 102.0), 1e-4);
    assert_eq!(v.unit, LengthUnit::Metres(1e-10));
}

#[test]
fn cryo_em_map() {
    let Some(v) = data("emd_3197.map") else { return };
    assert_eq!((v.dims(), v.raw_range()), ([20, 20, 20], (-4.133_745_7, 5.576_737)));
    assert_close(v.world_from_grid().spacing(), DVec3::splat(11.4), 1e-9);
    assert_close(v.world_from_grid().offset(), DVec3::new(-22.8, 0.0, 0.0), 1e-9);
    assert_eq!((argmax(&v), raw(&v, 1, 2, 3)), ((1, 6, 6), -2.780_306));
}

#[test]
fn caffeine_agrees_between_nrrd_and_cube() {
    let (Some(nrrd), Some(cube)) = (data("caffeine_density.nrrd"), data("caffeine_density.cube.gz")) else { return };
    assert_eq!((nrrd.dims(), cube.dims()), ([97, 88, 58], [97, 88, 58]));
    assert_eq!(nrrd.raw_range(), (1.854_24e-23, 64.5321));
    assert!((sum(&nrrd) - 6_371.607_408_341_173).abs() < 1e-6);
    assert_eq!((argmax(&nrrd), raw(&nrrd, 10, 20, 30)), ((22, 45, 30), 0.000_286_606));
    // The same digits through float text and through f64 text rounded once.
    assert_eq!(nrrd.samples(), cube.samples());
    assert_close(nrrd.world_from_grid().spacing(), cube.world_from_grid().spacing(), 1e-12);
    assert_eq!(cube.world_from_grid().offset(), DVec3::new(-11.326389, -10.144247, -7.057862));
    assert_eq!(cube.unit, LengthUnit::Metres(5.29177210903e-11));
    // C8H10N4O2 holds 102 electrons; the grid resolves the cores of C, N and O poorly, hence 3 %.
    let cell = cube.world_from_grid().linear().determinant();
    assert!((sum(&cube) * cell / 102.0 - 1.0).abs() < 0.03, "{}", sum(&cube) * cell);
}

#[test]
fn neuron_and_water_are_turned_from_lps_to_ras() {
    if let Some(v) = data("purkinje_neuron.nrrd") {
        assert_eq!((v.dims(), v.value_range(), sum(&v)), ([256, 256, 50], (23.75, 255.0), 100_170_130.75));
        assert_eq!(v.world_from_grid().point(DVec3::ONE), DVec3::new(-1.0, -1.0, 1.0));
        assert!(!v.world_from_grid().is_left_handed());
    }
    if let Some(v) = data("nachr_m2_water.nrrd") {
        assert_eq!((v.dims(), v.raw_range()), ([46, 46, 78], (0.0, 11.555_668)));
        assert!((sum(&v) - 89_179.141_076_596_34).abs() < 1e-6);
        assert_eq!(argmax(&v), (19, 29, 51));
        // The same map as a gOpenMol file: 44 bytes of header, then float32, x fastest.
        if let Some(plt) = path("nachr_m2_water.plt") {
            let samples = &std::fs::read(plt).unwrap()[44..];
            assert!(v.samples().bytes() == samples);
        }
        assert_close(v.world_from_grid().vector(DVec3::ONE), DVec3::new(-1.0222222, -1.0222222, 1.0129870), 1e-6);
    }
}

#[test]
fn iron_protein() {
    let Some(v) = data("ironprot.vtk") else { return };
    assert_eq!((v.dims(), v.samples().type_name(), v.value_range()), ([68; 3], "uint8", (0.0, 255.0)));
    assert_eq!((sum(&v), v.world_from_grid().linear()), (4_131_089.0, glam::DMat3::IDENTITY));
}
