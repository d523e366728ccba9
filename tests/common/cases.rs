//! The case library: the volumes of VALIDATION section 5 that break isosurface programs, each with
//! the property that must hold and why. Public API only; every sample is a pure function of its index.
#![allow(dead_code)] // Every program that uses the library uses its own part of it.

use glam::{DMat3, DVec3};
use isolume::Result;
use isolume::geom::Affine;
use isolume::sampling::hash::uniform;
use isolume::volume::{ReadHint, Samples, Solid, Volume, read};

/// What must come of a case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expect {
    /// Everything runs to the end: finite and bounded.
    Solved,
    /// As `Solved`, and no surface exists at any of the levels.
    Empty,
    /// As `Solved`, but no gradient is a number: no texel is valid, surfaces are lit as if unoccluded.
    NoTexels,
    /// The volume is refused, in words that hold these.
    Refused(&'static str),
    /// The volume stands but has no cells: the estimators refuse in these words, extraction is empty.
    NoCells(&'static str),
}

/// An isovalue, told by what makes it hard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// In the file's values.
    Value(f64),
    /// The smallest value of the volume.
    Minimum,
    /// The largest.
    Maximum,
    /// A part of the range.
    Part(f64),
    /// The value of the sample with this index, modulo their number.
    Sample(usize),
}

impl Level {
    /// The isovalue in a volume.
    pub fn of(self, volume: &Volume) -> f64 {
        let (low, high) = volume.value_range();
        let value = |i: usize| volume.value_from_raw(f64::from(volume.samples().raw(i)));
        match self {
            Self::Value(v) => v,
            Self::Minimum => low,
            Self::Maximum => high,
            Self::Part(p) => low + p * (high - low),
            Self::Sample(i) => value(i % volume.samples().len()),
        }
    }
}

/// One hard volume.
pub struct Case {
    pub name: String,
    /// What must hold beyond "finite and bounded", and why the case is here.
    pub why: &'static str,
    pub volume: Result<Volume>,
    pub levels: Vec<Level>,
    pub expect: Expect,
}

fn random(stream: u64, i: usize) -> f64 {
    f64::from(uniform(stream, i as u64, 0, 0))
}

/// Samples of `value` at grid points, x fastest.
pub fn samples(dims: [usize; 3], value: impl Fn([usize; 3]) -> f64) -> Vec<f64> {
    let [nx, ny, nz] = dims;
    (0..nx * ny * nz).map(|i| value([i % nx, i / nx % ny, i / (nx * ny)])).collect()
}

/// A volume of floats with spacing 1.
pub fn floats(dims: [usize; 3], value: impl Fn([usize; 3]) -> f64) -> Result<Volume> {
    placed(dims, Affine::IDENTITY, value)
}

/// A volume of floats under a map.
pub fn placed(dims: [usize; 3], map: Affine, value: impl Fn([usize; 3]) -> f64) -> Result<Volume> {
    Volume::new(dims, Samples::F32(samples(dims, value).into_iter().map(|v| v as f32).collect()), map)
}

/// A volume of bytes with spacing 1.
pub fn bytes(dims: [usize; 3], value: impl Fn([usize; 3]) -> f64) -> Result<Volume> {
    let samples = samples(dims, value).into_iter().map(|v| v.round().clamp(0.0, 255.0) as u8).collect();
    Volume::new(dims, Samples::U8(samples), Affine::IDENTITY)
}

/// Distance of a grid point from the middle of the grid, 1 at half the shortest side.
fn radius(dims: [usize; 3], at: [usize; 3]) -> f64 {
    let half = |a: usize| (dims[a] - 1) as f64 / 2.0;
    let shortest = half(0).min(half(1)).min(half(2));
    (0..3).map(|a| ((at[a] as f64 - half(a)) / shortest).powi(2)).sum::<f64>().sqrt()
}

/// A closed ball of radius 0.7 with a dimple, solid inside; values of order 1.
fn dimpled(dims: [usize; 3], at: [usize; 3]) -> f64 {
    let top = (dims[2] - 1) as f64;
    let (u, v) = (at[0] as f64 / (dims[0] - 1) as f64 - 0.5, at[1] as f64 / (dims[1] - 1) as f64 - 0.5);
    let dimple = 0.5 / (1.0 + 40.0 * (u * u + v * v) + 0.5 * (at[2] as f64 - 0.8 * top).powi(2));
    0.7 - radius(dims, at) - dimple
}

const N: usize = 11;
const CUBE: [usize; 3] = [N; 3];

fn case(name: &str, volume: Result<Volume>, levels: &[Level], expect: Expect, why: &'static str) -> Case {
    Case { name: name.into(), why, volume, levels: levels.to_vec(), expect }
}

/// All volume cases of number 27.
pub fn volumes() -> Vec<Case> {
    let mut all = values();
    all.extend(grids());
    all.extend(frames());
    all.extend(ranges());
    all.extend(sample_types());
    all
}

/// Cases whose samples are the difficulty.
fn values() -> Vec<Case> {
    use Expect::{Empty, Refused, Solved};
    use Level::{Maximum, Minimum, Part, Sample, Value};
    let plateau = |[x, y, z]: [usize; 3]| if (3..8).contains(&x.max(y).max(z)) { 4.0 } else { (x + y + z) as f64 };
    let checkers = |[x, y, z]: [usize; 3]| ((x + y + z) % 2) as f64;
    let spike = |at: [usize; 3]| if at == [5; 3] { 9.0 } else { 0.0 };
    let shell = |at: [usize; 3]| if (at[0] + at[1] + at[2]) % 9 == 4 { 1.0 } else { 0.0 };
    let not_finite = |bad: f32| {
        let mut samples: Vec<f32> = samples(CUBE, |at| dimpled(CUBE, at)).into_iter().map(|v| v as f32).collect();
        (0..samples.len()).step_by(37).for_each(|i| samples[i] = bad);
        samples
    };
    let given = |bad| Volume::new(CUBE, Samples::F32(not_finite(bad)), Affine::IDENTITY);
    let read_in = |bad| read(&npy("<f4", CUBE, not_finite(bad).iter().flat_map(|v| v.to_le_bytes()))[..], &hint());
    let mut below = floats(CUBE, |at| -dimpled(CUBE, at));
    if let Ok(volume) = &mut below {
        volume.solid = Solid::Below;
    }
    vec![
        case(
            "constant volume",
            bytes(CUBE, |_| 7.0),
            &[Value(7.0), Value(6.5), Value(7.5)],
            Empty,
            "no gradient anywhere: no texel is valid, no surface exists, nothing divides by the range",
        ),
        case(
            "plateau at the isovalue",
            floats(CUBE, plateau),
            &[Value(4.0), Value(3.5), Part(0.5)],
            Solved,
            "f is 0 in whole cells: they are lit, a ray through them hits nothing, the mesh stays manifold",
        ),
        case(
            "zero-gradient texels",
            bytes(CUBE, |[x, _, _]| if x < 6 { 0.0 } else { (x - 6) as f64 * 20.0 }),
            &[Part(0.3), Value(0.0)],
            Solved,
            "half of the texels have no normal: they are invalid, lookups go round them",
        ),
        case(
            "zero gradient on the surface",
            floats(CUBE, |at| (at[0] as f64 - 5.0).powi(3)),
            &[Value(0.0)],
            Solved,
            "the gradient vanishes on the very level set: the facets give the normal",
        ),
        case("NaN given", given(f32::NAN), &[], Refused("not finite"), "a volume holds finite samples only"),
        case("infinity given", given(f32::INFINITY), &[], Refused("not finite"), "a volume holds finite samples only"),
        case(
            "NaN read",
            read_in(f32::NAN),
            &[Value(0.0), Part(0.5)],
            Solved,
            "readers put them on the lit side and say so",
        ),
        case(
            "infinity read",
            read_in(f32::INFINITY),
            &[Value(0.0)],
            Solved,
            "readers put them on the lit side and say so",
        ),
        case(
            "all NaN read",
            read(&npy("<f4", [2; 3], [f32::NAN; 8].iter().flat_map(|v| v.to_le_bytes()))[..], &hint()),
            &[],
            Refused("all NaN or infinite"),
            "no datum is left to stand in for the others",
        ),
        case(
            "isovalue equal to voxel values",
            bytes(CUBE, |at| 120.0 + 90.0 * dimpled(CUBE, at)),
            &[Sample(600), Sample(777), Value(130.0), Minimum, Maximum],
            Solved,
            "crossings fall on grid points: no triangle may vanish; at the maximum there is no solid, at the minimum \
             the least samples alone are lit",
        ),
        case(
            "single-voxel spike",
            floats(CUBE, spike),
            &[Value(4.0), Value(0.0), Value(8.999)],
            Solved,
            "one octahedron of a voxel; at 0 the plateau around it is lit",
        ),
        case(
            "single-voxel pit",
            floats(CUBE, |at| -spike(at)),
            &[Value(-4.0)],
            Solved,
            "a closed lit cavity: a leak would show",
        ),
        case(
            "checkerboard",
            floats(CUBE, checkers),
            &[Value(0.5), Value(0.25), Part(0.999)],
            Solved,
            "all faces of all cells are ambiguous, at 0.5 with a saddle exactly at the isovalue",
        ),
        case(
            "random signs",
            floats(CUBE, |[x, y, z]| random(3, x + N * (y + N * z)) - 0.5),
            &[Value(0.0), Part(0.9)],
            Solved,
            "every pattern of corners, every direction of a normal",
        ),
        case(
            "few values",
            bytes(CUBE, |[x, y, z]| (random(4, x + N * (y + N * z)) * 4.0).floor()),
            &[Value(1.0), Value(1.5)],
            Solved,
            "ties of samples with each other and with the isovalue",
        ),
        case(
            "shells thinner than a voxel",
            floats(CUBE, shell),
            &[Value(0.5), Value(0.9)],
            Solved,
            "a ray passes several surfaces in two cells",
        ),
        case(
            "thin shell of a sphere",
            floats(CUBE, |at| 0.04 - (radius(CUBE, at) - 0.6).abs()),
            &[Value(0.0), Value(-0.05)],
            Solved,
            "a fifth of a voxel thick: torn where no sample is solid, but never a hole of one cell",
        ),
        case("solid below", below, &[Value(0.0), Part(0.5)], Solved, "the sign is carried through everything"),
    ]
}

/// Cases whose grid is the difficulty.
fn grids() -> Vec<Case> {
    use Expect::{NoCells, Solved};
    use Level::{Part, Value};
    let flat = "at least 2 samples along each axis";
    let ramp = |[x, y, z]: [usize; 3]| (x + 2 * y) as f64 - 1.5 * z as f64;
    let mut all = vec![
        case("2×2×2", floats([2; 3], ramp), &[Part(0.5), Part(0.1)], Solved, "one cell: every sample is at the border"),
        case(
            "2×2×2 corner",
            floats([2; 3], |at| f64::from(u8::from(at == [1; 3]))),
            &[Value(0.5)],
            Solved,
            "one triangle",
        ),
        case(
            "2×2×300",
            floats([2, 2, 300], |[x, y, z]| random(5, x + 2 * y + 4 * z) - 0.5),
            &[Value(0.0)],
            Solved,
            "a chain of cells, longer than the largest block of the pyramid",
        ),
        case(
            "33×9×2",
            floats([33, 9, 2], |[x, y, z]| random(6, x + 33 * (y + 9 * z)) - 0.5),
            &[Value(0.0)],
            Solved,
            "one layer of cells; texels just beyond a chunk",
        ),
    ];
    for dims in [[1, 7, 5], [7, 1, 5], [7, 5, 1], [1, 1, 9], [1, 1, 1]] {
        let name = format!("{}×{}×{}", dims[0], dims[1], dims[2]);
        all.push(case(&name, floats(dims, ramp), &[Part(0.5), Value(1.0)], NoCells(flat), "samples, but no cell"));
    }
    all
}

/// Cases whose place in the world is the difficulty.
fn frames() -> Vec<Case> {
    use Level::Value;
    let slanted = DMat3::from_cols(DVec3::new(0.9, 0.3, 0.0), DVec3::new(0.5, -2.0, 0.4), DVec3::new(0.0, 0.7, 3.0));
    let maps = [
        ("spacing 1:1:100", DMat3::from_diagonal(DVec3::new(1.0, 1.0, 100.0)), DVec3::ZERO, "normals are covectors"),
        ("spacing 100:1:1", DMat3::from_diagonal(DVec3::new(100.0, 1.0, 1.0)), DVec3::ZERO, "normals are covectors"),
        ("oblique and left-handed", slanted, DVec3::ZERO, "fronts and normals look to the lit side all the same"),
        (
            "mirrored",
            DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
            DVec3::ZERO,
            "fronts and normals look to the lit side",
        ),
        ("origin at 1e6", DMat3::IDENTITY, DVec3::new(1e6, -1e6, 1e6), "f32 world positions would lose 1/16 voxel"),
        (
            "origin at 1e6, voxels of 1e-6",
            DMat3::from_diagonal(DVec3::splat(1e-6)),
            DVec3::splat(1e6),
            "neighbours differ in the twelfth digit of their coordinates",
        ),
        ("voxels of 1e-10", DMat3::from_diagonal(DVec3::splat(1e-10)), DVec3::ZERO, "molecules in metres"),
        ("voxels of 1e9", DMat3::from_diagonal(DVec3::splat(1e9)), DVec3::ZERO, "stars in metres"),
        ("voxels of 1e-17", DMat3::from_diagonal(DVec3::splat(1e-17)), DVec3::ZERO, "squares near the least of f32"),
        ("voxels of 1e16", DMat3::from_diagonal(DVec3::splat(1e16)), DVec3::ZERO, "squares near the largest of f32"),
        ("voxels of 1e-40", DMat3::from_diagonal(DVec3::splat(1e-40)), DVec3::ZERO, "positions below the range of f32"),
        ("voxels of 1e40", DMat3::from_diagonal(DVec3::splat(1e40)), DVec3::ZERO, "positions beyond the range of f32"),
    ];
    let make = |(name, linear, offset, why): (&'static str, DMat3, DVec3, &'static str)| {
        let Some(map) = Affine::new(linear, offset) else { panic!("{name} is a map") };
        let expect = if name.ends_with("40") { Expect::Refused("1e-18 to 1e18") } else { Expect::Solved };
        case(name, placed(CUBE, map, |at| dimpled(CUBE, at)), &[Value(0.0), Value(-0.2)], expect, why)
    };
    maps.map(make).into()
}

/// Cases whose range of values is the difficulty: as they are and through a reader.
fn ranges() -> Vec<Case> {
    use Level::{Part, Sample, Value};
    let mut all = Vec::new();
    for (scale, why) in [
        (1e-30, "products of samples are below f32"),
        (1e30, "products of samples are beyond f32"),
        (1e-40, "the samples themselves are subnormal"),
        (1e-44, "seven subnormal values in all"),
        (2.4e38, "differences of samples are beyond f32"),
    ] {
        let value = move |at| scale * dimpled(CUBE, at);
        let name = format!("range {scale:e}");
        let levels = [Value(0.0), Part(0.6), Sample(665)];
        let expect = match scale {
            s if s > 1e31 => Expect::Refused("2^122"),
            // Products with the weights of the gradient vanish; readers rescale such volumes.
            s if s < 1e-38 => Expect::NoTexels,
            _ => Expect::Solved,
        };
        all.push(case(&name, floats(CUBE, value), &levels, expect, why));
        let stored = samples(CUBE, value).into_iter().flat_map(|v| (v as f32).to_le_bytes());
        let volume = read(&npy("<f4", CUBE, stored)[..], &hint());
        all.push(case(&format!("range {scale:e} read"), volume, &levels, Expect::Solved, why));
    }
    let far = |at| 1e6 + dimpled(CUBE, at);
    all.push(case(
        "range 1 at 1e6",
        floats(CUBE, far),
        &[Part(0.6), Sample(665)],
        Expect::Solved,
        "f32 keeps sixteen steps of the range: plateaus and ties",
    ));
    all
}

fn hint() -> ReadHint {
    ReadHint { name: "case".into(), ..ReadHint::default() }
}

/// A NumPy file.
pub fn npy(descr: &str, dims: [usize; 3], data: impl IntoIterator<Item = u8>) -> Vec<u8> {
    let head =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}, {}, {}), }}\n", dims[2], dims[1], dims[0]);
    let mut file = b"\x93NUMPY\x01\0".to_vec();
    file.extend((head.len() as u16).to_le_bytes());
    file.extend(head.as_bytes());
    file.extend(data);
    file
}

/// The same ball in every sample type, little-endian and big-endian, through the reader.
fn sample_types() -> Vec<Case> {
    let values = samples(CUBE, |at| (60.0 + 80.0 * dimpled(CUBE, at)).round().clamp(0.0, 127.0));
    let mut all = Vec::new();
    macro_rules! kinds {
        ($($name:literal $t:ty),*) => {$(
            for (order, big) in [("<", false), (">", true)] {
                let one = |v: &f64| if big { (*v as $t).to_be_bytes() } else { (*v as $t).to_le_bytes() };
                let file = npy(&format!("{order}{}", $name), CUBE, values.iter().flat_map(one));
                let name = format!("samples {order}{}", $name);
                all.push(case(&name, read(&file[..], &hint()), &[Level::Value(60.0), Level::Value(45.5)],
                    Expect::Solved, "each type gives the surface of the same values"));
            }
        )*};
    }
    kinds!("u1" u8, "i1" i8, "u2" u16, "i2" i16, "u4" u32, "i4" i32, "u8" u64, "i8" i64, "f4" f32, "f8" f64);
    let nrrd = |endian: &str, data: Vec<u8>| {
        let head =
            format!("NRRD0004\ntype: short\ndimension: 3\nsizes: {N} {N} {N}\nendian: {endian}\nencoding: raw\n\n");
        [head.into_bytes(), data].concat()
    };
    let big = nrrd("big", values.iter().flat_map(|v| (*v as i16).to_be_bytes()).collect());
    let head = format!(
        "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {N} {N} {N}\nPOINT_DATA {}\n\
         SCALARS s float\nLOOKUP_TABLE default\n",
        N * N * N
    );
    let vtk = [head.into_bytes(), values.iter().flat_map(|v| (*v as f32).to_be_bytes()).collect()].concat();
    for (name, file) in [("samples of a big-endian NRRD", big), ("samples of a binary VTK", vtk)] {
        all.push(case(
            name,
            read(&file[..], &hint()),
            &[Level::Value(60.0), Level::Value(45.5)],
            Expect::Solved,
            "each type gives the surface of the same values",
        ));
    }
    all
}

/// Volumes for rays: every case with cells, and larger ones of the same kinds at scales of 1e-6 to 1e6.
pub fn ray_volumes() -> Vec<(String, Volume)> {
    let mut all: Vec<(String, Volume)> = volumes()
        .into_iter()
        .filter(|c| !c.name.starts_with("samples "))
        .filter_map(|c| Some((c.name, c.volume.ok()?)))
        .filter(|(_, v)| v.dims().iter().all(|&d| d >= 2))
        .collect();
    let wave = |[x, y, z]: [usize; 3]| {
        let (x, y, z) = (x as f64 / 8.0 - 2.0, y as f64 / 8.0 - 2.0, z as f64 / 8.0 - 2.0);
        (1.5 * x).sin() * (1.2 * y).cos() + 0.25 * z * z - 0.1 * x * y
    };
    let dims = [40, 33, 35];
    let count = move |[x, y, z]: [usize; 3]| x + dims[0] * (y + dims[1] * z);
    for scale in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
        let stretched = DMat3::from_diagonal(DVec3::new(scale, scale, 100.0 * scale));
        if let Some(map) = Affine::new(stretched, DVec3::splat(scale)) {
            all.extend(
                placed(dims, map, |at| scale * wave(at)).map(|v| (format!("wave, 1:1:100, scale {scale:e}"), v)),
            );
        }
    }
    let others = [
        ("wave in 8 bits", bytes(dims, |at| 100.0 + 60.0 * wave(at))),
        ("wave in 8 coarse levels", bytes(dims, |at| 4.0 + 2.0 * wave(at))),
        ("wave with noise", floats(dims, |at| wave(at) + 0.3 * random(7, count(at)))),
        ("wave at 1000", floats(dims, |at| 1000.0 + wave(at))),
        ("noise", floats(dims, |at| random(8, count(at)))),
        ("six values", bytes(dims, |at| (6.0 * random(9, count(at))).floor())),
    ];
    all.extend(others.into_iter().filter_map(|(name, volume)| Some((name.into(), volume.ok()?))));
    all
}
