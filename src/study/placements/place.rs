//! Where samples lie.

use crate::error::Result;
use crate::sampling::hash::{key, uniform};
use crate::surface::extract;
use crate::transfer::Lattice;
use crate::volume::Volume;
use glam::DVec3;

/// A way to place samples in a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// Anywhere in the box, independently.
    Uniform,
    /// One anywhere in each of n³ equal boxes, n³ the cube nearest to the number asked for.
    Stratified,
    /// ⌈f · max⌉ anywhere in each cell, f its extent (highest minus lowest sample) over the largest of any cell; none in cells
    /// without extent. The cells are blocks of b³ cells of the grid, b the least for which there are two samples for each, and
    /// max the largest for which there are not more samples than asked for.
    Extent,
    /// On [`LEVEL_SETS`] level sets, as many on each, evenly by area; their isovalues are random, one in each equal part of the
    /// range of the samples. What repeated extraction of isosurfaces gives: more samples make them denser, not more.
    LevelSets,
    /// As before on n level sets, n³ the cube nearest to the number asked for: as dense across as along.
    ManyLevelSets,
    /// On the level sets [`THE_NINE`] of the thesis, as many on each that has a surface, evenly by area within each.
    NineLevelSets,
    /// On [`PLANES`] planes x + z = const of the unit box, at equal distances and evenly by area: deliberately bad. The thesis has "a
    /// small set"; ten is our guess.
    DiagonalPlanes,
    /// Anywhere on the diagonal line of the box, from its first sample to its last: worse still.
    DiagonalLine,
    /// On each texel, however many that are.
    Texels,
}

/// Isosurfaces of [`Placement::LevelSets`]; the fewer, the larger the error at isovalues between them.
pub const LEVEL_SETS: u32 = 10;

/// Isovalues of the level sets that the thesis samples, of values up to 255 (Beason 2005, section 4.6).
pub const THE_NINE: [f64; 9] = [0.01, 6.4744, 13.17, 19.3451, 24.8489, 29.5883, 39.0118, 56.6704, 160.873];

/// Planes of [`Placement::DiagonalPlanes`].
pub const PLANES: u32 = 10;

impl Placement {
    /// All, in the order of tables.
    pub const ALL: [Self; 9] = [
        Self::Texels,
        Self::Extent,
        Self::Stratified,
        Self::Uniform,
        Self::ManyLevelSets,
        Self::LevelSets,
        Self::NineLevelSets,
        Self::DiagonalPlanes,
        Self::DiagonalLine,
    ];

    /// A short name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Stratified => "stratified",
            Self::Extent => "cell extent",
            Self::LevelSets => "level sets",
            Self::ManyLevelSets => "many level sets",
            Self::NineLevelSets => "level sets 9",
            Self::DiagonalPlanes => "diagonal planes",
            Self::DiagonalLine => "diagonal line",
            Self::Texels => "texels",
        }
    }

    /// RMS % that Beason (2005) found on the bump box in his box at isovalue 47, with 10⁶ samples and a texture of 100³
    /// (table 4.2).
    pub fn of_the_thesis(self) -> Option<f64> {
        match self {
            Self::Uniform => Some(1.29),
            Self::NineLevelSets => Some(3.59),
            Self::DiagonalPlanes => Some(9.55),
            Self::DiagonalLine
            | Self::LevelSets
            | Self::Stratified
            | Self::Extent
            | Self::ManyLevelSets
            | Self::Texels => None,
        }
    }
}

/// About so many positions in grid space.
///
/// # Errors
/// When the volume has no cells.
pub fn place(
    volume: &Volume,
    lattice: Lattice,
    placement: Placement,
    samples: u32,
    seed: u64,
) -> Result<Vec<[f64; 3]>> {
    volume.check_cells()?;
    let last = volume.dims().map(|n| (n - 1) as f64);
    let seed = key(seed, 0x706c_6163);
    // Two words, for more than 2²⁴ different places along an axis.
    let unit = |i: u32, a: u32| {
        let [high, low] = [0, 1].map(|d| f64::from(uniform(seed, u64::from(i), d, a)));
        high + low / f64::from(1u32 << 24)
    };
    let units = |i: u32| [0, 1, 2].map(|a| unit(i, a));
    Ok(match placement {
        Placement::Uniform => (0..samples).map(units).map(|u| std::array::from_fn(|a| u[a] * last[a])).collect(),
        Placement::Stratified => {
            let n = cube_root(samples);
            let box_of = |i: u32| [i % n, i / n % n, i / n / n].map(f64::from);
            let at = |i: u32, a: usize| (box_of(i)[a] + units(i)[a]) / f64::from(n) * last[a];
            (0..n * n * n).map(|i| [0, 1, 2].map(|a| at(i, a))).collect()
        }
        Placement::DiagonalPlanes => (0..samples).map(|i| on_planes(units(i))).map(|p| scaled(p, last)).collect(),
        Placement::DiagonalLine => (0..samples).map(|i| last.map(|l| unit(i, 0) * l)).collect(),
        Placement::Texels => {
            let [mx, my, mz] = lattice.texels();
            (0..mx * my * mz).map(|i| lattice.grid_from_texel([i % mx, i / mx % my, i / mx / my])).collect()
        }
        Placement::Extent => by_extent(volume, samples, &units),
        Placement::LevelSets => on_level_sets(volume, &random_isovalues(volume, LEVEL_SETS, &units), samples, &units)?,
        Placement::ManyLevelSets => {
            on_level_sets(volume, &random_isovalues(volume, cube_root(samples), &units), samples, &units)?
        }
        Placement::NineLevelSets => on_level_sets(volume, &THE_NINE, samples, &units)?,
    })
}

fn scaled(p: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| p[a] * by[a])
}

/// A point of the planes of the unit box: the plane x + z = s has the length √2 min(s, 2 − s) across, times 1 along y.
fn on_planes([u, v, w]: [f64; 3]) -> [f64; 3] {
    let place = |k: u32| (f64::from(k) + 0.5) * 2.0 / f64::from(PLANES);
    let width = |k: u32| place(k).min(2.0 - place(k));
    let all: f64 = (0..PLANES).map(width).sum();
    let mut left = u * all;
    let mut k = 0;
    while k + 1 < PLANES && left >= width(k) {
        left -= width(k);
        k += 1;
    }
    let s = place(k);
    let x = (s - 1.0).max(0.0) + width(k) * v;
    [x, w, s - x]
}

/// One isovalue anywhere in each equal part of the range.
fn random_isovalues(volume: &Volume, sets: u32, units: &dyn Fn(u32) -> [f64; 3]) -> Vec<f64> {
    let (low, high) = volume.value_range();
    // Items beyond those of the samples.
    let share = |k: u32| (f64::from(k) + units(u32::MAX - k)[0]) / f64::from(sets);
    (0..sets).map(|k| low + share(k) * (high - low)).collect()
}

fn cube_root(count: u32) -> u32 {
    (libm::cbrt(f64::from(count)).round() as u32).max(1)
}

/// Blocks of cells: first sample, last sample, extent.
fn blocks(volume: &Volume, side: usize) -> Vec<([usize; 3], [usize; 3], f32)> {
    let dims = volume.dims();
    let count = dims.map(|n| (n - 1).div_ceil(side));
    let block = |i: usize| {
        let low = [i % count[0], i / count[0] % count[1], i / count[0] / count[1]].map(|b| b * side);
        let high: [usize; 3] = std::array::from_fn(|a| (low[a] + side).min(dims[a] - 1));
        let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let raw = volume.samples().raw(volume.index(x, y, z));
                    (least, most) = (least.min(raw), most.max(raw));
                }
            }
        }
        (low, high, most - least)
    };
    (0..count.iter().product()).map(block).collect()
}

fn by_extent(volume: &Volume, samples: u32, units: &dyn Fn(u32) -> [f64; 3]) -> Vec<[f64; 3]> {
    let cells = |side: usize| volume.dims().iter().map(|n| (n - 1).div_ceil(side) as u64).product::<u64>();
    let longest = volume.dims().into_iter().fold(1, usize::max);
    let side = (1..longest).find(|&side| 2 * cells(side) <= u64::from(samples)).unwrap_or(longest);
    let blocks = blocks(volume, side);
    let largest = blocks.iter().fold(0.0f32, |m, b| m.max(b.2));
    let count = |extent: f32, most: f64| (f64::from(extent) / f64::from(largest) * most).ceil() as u64;
    let total = |most: f64| blocks.iter().filter(|b| b.2 > 0.0).map(|b| count(b.2, most)).sum::<u64>();
    // The number rises with `most`: halve between one that is allowed (each block with extent then has one, at least) and one
    // that is not, down to the least step that can change a block's count noticeably.
    let (mut low, mut high) = (0.0, 2.0 * f64::from(samples) + 1.0);
    for _ in 0..48 {
        let middle = 0.5 * (low + high);
        if total(middle) <= u64::from(samples) { low = middle } else { high = middle }
    }
    let mut out = Vec::with_capacity(samples as usize);
    for (first, last, extent) in blocks.into_iter().filter(|b| b.2 > 0.0) {
        for _ in 0..count(extent, low).max(1) {
            let u = units(out.len() as u32);
            out.push(std::array::from_fn(|a| first[a] as f64 + u[a] * (last[a] - first[a]) as f64));
        }
    }
    out
}

/// As many samples on each level set that has a surface, evenly by area.
fn on_level_sets(
    volume: &Volume,
    isovalues: &[f64],
    samples: u32,
    units: &dyn Fn(u32) -> [f64; 3],
) -> Result<Vec<[f64; 3]>> {
    let mut out = Vec::with_capacity(samples as usize);
    let meshes = isovalues.iter().map(|&c| extract(volume, c)).collect::<Result<Vec<_>>>()?;
    let meshes: Vec<_> = meshes.into_iter().filter(|mesh| !mesh.triangles.is_empty()).collect();
    let sets = meshes.len();
    for (k, mesh) in meshes.into_iter().enumerate() {
        let world = |v: u32| {
            let p = mesh.positions_in_grid[v as usize].map(f64::from);
            (DVec3::from_array(p), volume.world_from_grid().point(DVec3::from_array(p)))
        };
        let mut sums = Vec::with_capacity(mesh.triangles.len());
        let mut sum = 0.0;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|v| world(v).1);
            sum += (b - a).cross(c - a).length();
            sums.push(sum);
        }
        if sum <= 0.0 {
            continue;
        }
        for i in (samples as u64 * k as u64 / sets as u64)..(samples as u64 * (k as u64 + 1) / sets as u64) {
            let [u, v, w] = units(i as u32);
            let t = sums.partition_point(|s| *s <= u * sum).min(sums.len() - 1);
            let [a, b, c] = mesh.triangles[t].map(|v| world(v).0);
            // Uniform on a triangle (Turk 1990, "Generating random points in triangles").
            let root = v.sqrt();
            out.push(((1.0 - root) * a + root * (1.0 - w) * b + root * w * c).to_array());
        }
    }
    Ok(out)
}
