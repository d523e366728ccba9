//! Packed chunks: coefficients as whole multiples of one step, in planes, compressed, with a stated error.
//!
//! # What is kept
//! X_ki = w_k T_ki with w_k = 0.7^(k+1): what a coefficient of layer k does to radiance at an albedo of 0.7. One step Δ serves all of
//! them, q = round(X / Δ), so that the error is white: light of any colour and direction gets the same. The number is read back as
//! T = q Δ / w_k in double precision, rounded to f16. Of standard errors two bits behind the point are kept (an eighth of each at most);
//! validity and numbers of rays are exact.
//!
//! # Where it lies
//! Arrays of blocks of 4096 places: `low` and `high` [block, coefficient, place] with q = 256 high + low, `stderr` [block, layer_band,
//! place], `rays` [block, place], in which the baked texels of a chunk stand one behind the other without gaps, and `validity` [block,
//! place] with all texels of the chunk, of which those with the flag [`BAKED`] are the ones. Texels of a chunk are ordered by brick,
//! then by place in the brick. A chunk of texels has eight blocks, one of vertices has one; a file is a chunk, its codecs `bytes`, `gzip`,
//! `crc32c`, all of them in the core of Zarr. Where every number of a chunk fits into 8 bits there is no file in `high`.
//!
//! # Why so
//! Planes of small whole numbers are what a byte coder compresses; per-coefficient scales, principal components and differences to
//! neighbours were measured and gain nothing (`probes/record/2026-11-30-xeon-2core-scale`). Deflate and not zstd: the encoders of
//! zstd that reach its ratio are C, and readers of Zarr know both.

use super::zarr::{self, Array, CHECKSUM, Codec, FORMAT};
use crate::error::{Error, Result};
use crate::transfer::{BRICK_TEXELS, Brick, Lattice, Layers, Layout};
use flate2::{Compression, GzBuilder, read::GzDecoder};
use half::f16;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::io::{Read, Write};

/// The arrays of a packed group; a chunk exists if its file in the first does. The last may be absent.
pub(super) const PACKED: [&str; 5] = ["low", "stderr", "validity", "rays", "high"];
/// Index of `high` in [`PACKED`].
const HIGH: usize = 4;
/// Flag of a place in `validity`: the texel was baked. The others are those of [`crate::transfer::validity`].
pub const BAKED: u8 = 16;
/// Places of a block.
const PLACES: usize = 4096;
/// Largest |q|: that of 256 · 127 + 127.
const LARGEST: f64 = 32639.0;
/// Bits of a standard error that are dropped.
const DROPPED: u16 = 8;

/// How the transfer of a group was packed, and how far it is from what it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Packing {
    /// Root mean square of the error of X over that of X, as asked for.
    pub asked: f64,
    /// The same as measured over all texels, when they are read back.
    pub measured: f64,
    /// Δ.
    pub step: f64,
    /// w_k of each layer.
    pub layer_weights: Vec<f64>,
    /// No light whose coefficients have the norm 1 (of a luminaire: no power 1) changes the radiance of any texel by more, at albedos
    /// up to 0.7; light of norm L by L times as much.
    pub bound: f64,
    /// The most that such a light does at the albedo 0.7, found texel by texel: at most `bound`.
    pub largest: f64,
}

/// q of a coefficient X; `None` beyond what two bytes hold.
fn quantized(x: f64, step: f64) -> Option<i32> {
    let q = (x / step).round_ties_even();
    (q.abs() <= LARGEST).then_some(q as i32)
}

/// The number that is read back for q.
fn restored(q: i32, step: f64, weight: f64) -> f16 {
    f16::from_f64(f64::from(q) * step / weight)
}

/// A standard error with the bits that are kept, rounded to the nearest.
fn rounded(error: f16) -> f16 {
    if error.is_nan() {
        return f16::NAN;
    }
    let bits = error.to_bits();
    let up = bits + (1 << (DROPPED - 1)) - 1 + (bits >> DROPPED & 1);
    let kept = f16::from_bits(up & !((1 << DROPPED) - 1));
    if kept.is_finite() || !error.is_finite() { kept } else { f16::from_bits(bits & !((1 << DROPPED) - 1)) }
}

/// What some texels lose.
#[derive(Clone, Debug, Default)]
pub(super) struct Loss {
    pub texels: u64,
    /// Sum of X² and of the squared error of X.
    pub squares: [f64; 2],
    /// Sum of the variance of X by the standard errors.
    pub noise: f64,
    /// Largest ‖T_k‖ of a texel in a channel, layer by layer.
    pub largest_layers: Vec<f64>,
    /// See [`Packing::largest`].
    pub largest: f64,
}

impl Loss {
    /// Adds that of other texels.
    pub fn add(&mut self, other: &Self) {
        self.texels += other.texels;
        self.squares[0] += other.squares[0];
        self.squares[1] += other.squares[1];
        self.noise += other.noise;
        self.largest = self.largest.max(other.largest);
        self.largest_layers.resize(self.largest_layers.len().max(other.largest_layers.len()), 0.0);
        self.largest_layers.iter_mut().zip(&other.largest_layers).for_each(|(a, b)| *a = a.max(*b));
    }

    /// Root mean square of the error over that of X; 0 where there is nothing.
    pub fn relative(&self) -> f64 {
        if self.squares[0] > 0.0 { (self.squares[1] / self.squares[0]).sqrt() } else { 0.0 }
    }

    /// That of a texel by a step; without one only what there is.
    fn of_texel(
        &mut self,
        transfer: &[f16],
        errors: &[f16],
        layers: &Layers,
        weights: &[f64],
        step: Option<f64>,
    ) -> Result<()> {
        self.texels += 1;
        self.largest_layers.resize(layers.len(), 0.0);
        let channels = layers.channels();
        let mut of_light = vec![0.0f64; channels * layers.max_bands().pow(2)];
        for (k, &bands) in layers.bands().iter().enumerate() {
            let (count, w) = (bands * bands, weights[k]);
            for channel in 0..channels {
                let start = layers.offset(k) + channel * count;
                let mut norm = 0.0;
                for (i, &t) in transfer[start..start + count].iter().enumerate() {
                    let value = t.to_f64();
                    if !value.is_finite() {
                        return Err(not_finite());
                    }
                    let x = w * value;
                    norm += value * value;
                    self.squares[0] += x * x;
                    if let Some(step) = step {
                        let q = quantized(x, step).ok_or_else(|| too_large(x, step))?;
                        let lost = w * (restored(q, step, w).to_f64() - value);
                        self.squares[1] += lost * lost;
                        of_light[channel * layers.max_bands().pow(2) + i] += lost;
                    }
                }
                self.largest_layers[k] = self.largest_layers[k].max(norm.sqrt());
            }
            for l in 0..bands {
                let error = errors[layers.error_offset(k) + l].to_f64();
                if error.is_finite() {
                    self.noise += (channels * (2 * l + 1)) as f64 * (w * error).powi(2);
                }
            }
        }
        for of_channel in of_light.chunks_exact(layers.max_bands().pow(2)) {
            self.largest = self.largest.max(of_channel.iter().map(|v| v * v).sum::<f64>().sqrt());
        }
        Ok(())
    }

    /// That of the baked texels of some bricks.
    ///
    /// # Errors
    /// When a coefficient is not finite, or needs more steps than two bytes count.
    pub fn of(bricks: &[Option<Brick>], layers: &Layers, step: Option<f64>) -> Result<Self> {
        let (n, e, weights) = (layers.coefficients(), layers.errors(), layers.weights());
        let mut loss = Self::default();
        for brick in bricks.iter().flatten() {
            for t in 0..BRICK_TEXELS {
                let transfer = &brick.transfer[t * n..(t + 1) * n];
                if !transfer[0].is_nan() {
                    loss.of_texel(transfer, &brick.stderr[t * e..(t + 1) * e], layers, &weights, step)?;
                }
            }
        }
        Ok(loss)
    }

    /// The packing that loses this by a step.
    pub fn packing(&self, layers: &Layers, asked: f64, step: f64) -> Packing {
        let weights = layers.weights();
        let of_layer = |k: usize| {
            let (bands, w) = (layers.bands()[k] as f64, weights[k]);
            let norm = self.largest_layers.get(k).copied().unwrap_or(0.0) + step / 2.0 * bands / w;
            // Half a step a coefficient, and the rounding to 11 digits, or 2⁻²⁵ near 0: both by Cauchy and Schwarz.
            step / 2.0 * bands + w * (norm / 2048.0 + bands / f64::from(1 << 25))
        };
        let bound = (0..layers.len()).map(of_layer).sum();
        Packing { asked, measured: self.relative(), step, layer_weights: weights, bound, largest: self.largest }
    }
}

fn not_finite() -> Error {
    let remedy = "bake it again: isolume doctor names the chunk";
    Error::argument("transfer", "a coefficient that is not finite", "numbers", remedy)
}

fn too_large(x: f64, step: f64) -> Error {
    Error::Limit {
        what: "packing".into(),
        needed: format!("{:.0} steps of {step:.3e} for a coefficient", (x / step).abs()),
        limit: format!("{LARGEST} steps"),
        remedy: "allow a larger --error".into(),
    }
}

/// The arrays of a packed group, in the order of [`PACKED`].
pub(super) fn arrays(layout: &Layout) -> Vec<(&'static str, Array)> {
    let lattice = &layout.lattice;
    let blocks = blocks(lattice);
    let chunks: usize = lattice.chunks().iter().product();
    let array = |data_type, fill, middle: Option<(usize, &'static str)>| {
        let extended = |n: usize| std::iter::once(n).chain(middle.map(|(m, _)| m)).chain([PLACES]).collect();
        let names = std::iter::once("block").chain(middle.map(|(_, name)| name)).chain(["place"]).collect();
        Array {
            shape: extended(chunks * blocks),
            chunk: extended(blocks),
            inner: None,
            data_type,
            fill,
            names,
            codec: Codec::Gzip,
        }
    };
    let coefficients = Some((layout.layers.coefficients(), "coefficient"));
    let all = [
        array("int8", json!(0), coefficients),
        array("float16", json!("NaN"), Some((layout.layers.errors(), "layer_band"))),
        array("uint8", json!(0), None),
        array("uint32", json!(0), None),
        array("int8", json!(0), coefficients),
    ];
    PACKED.into_iter().zip(all).collect()
}

/// Blocks of a chunk.
fn blocks(lattice: &Lattice) -> usize {
    lattice.bricks_of_chunk().iter().product::<usize>() * BRICK_TEXELS / PLACES
}

/// The key of the file of a chunk, by its linear index.
pub(super) fn key(place: &str, array: usize, chunk: usize) -> String {
    let last = if matches!(PACKED[array], "validity" | "rays") { 1 } else { 2 };
    zarr::chunk_key(&format!("{place}/{}", PACKED[array]), &[&[chunk][..], &[0, 0][..last]].concat())
}

/// The files of a chunk, in the order of [`PACKED`].
pub(super) type Files = [Option<Vec<u8>>; PACKED.len()];

/// Packs the bricks of a chunk.
///
/// # Errors
/// As [`Loss::of`].
pub(super) fn encode_chunk(packing: &Packing, layout: &Layout, bricks: &[Option<Brick>]) -> Result<Files> {
    let (n, e) = (layout.layers.coefficients(), layout.layers.errors());
    let places = blocks(&layout.lattice) * PLACES;
    let weights = layout.layers.weights_of_coefficients();
    let (mut low, mut high) = (vec![0i8; places * n], vec![0i8; places * n]);
    let mut stderr = vec![f16::ZERO; places * e];
    let (mut validity, mut rays) = (vec![0u8; places], vec![0u32; places]);
    let mut rank = 0;
    for (slot, brick) in bricks.iter().enumerate().filter_map(|(slot, brick)| Some((slot, brick.as_ref()?))) {
        for t in 0..BRICK_TEXELS {
            let transfer = &brick.transfer[t * n..(t + 1) * n];
            if transfer[0].is_nan() {
                continue;
            }
            let (block, place) = (rank / PLACES, rank % PLACES);
            for (i, value) in transfer.iter().enumerate() {
                let x = weights[i] * value.to_f64();
                if !x.is_finite() {
                    return Err(not_finite());
                }
                let q = quantized(x, packing.step).ok_or_else(|| too_large(x, packing.step))?;
                // The low byte is signed: q of up to 7 bits leaves the high one at 0.
                let at = (block * n + i) * PLACES + place;
                low[at] = q as i8;
                high[at] = ((q - i32::from(q as i8)) >> 8) as i8;
            }
            for (i, value) in brick.stderr[t * e..(t + 1) * e].iter().enumerate() {
                stderr[(block * e + i) * PLACES + place] = rounded(*value);
            }
            validity[slot * BRICK_TEXELS + t] = brick.validity[t] | BAKED;
            rays[rank] = brick.rays[t];
            rank += 1;
        }
    }
    let needs_high = high.iter().any(|&byte| byte != 0);
    let [low, high] = [low, high].map(|plane| compressed(bytemuck::cast_slice(&plane)));
    let [stderr, rays] = [bytemuck::cast_slice(&stderr), bytemuck::cast_slice(&rays)].map(compressed);
    Ok([Some(low), Some(stderr), Some(compressed(&validity)), Some(rays), needs_high.then_some(high)])
}

/// The bricks of a chunk whose files are these, as they stand on the disk.
///
/// # Errors
/// The array that is damaged, and how: found and expected.
pub(super) fn decode(
    packing: &Packing,
    layout: &Layout,
    files: &[Option<&[u8]>; PACKED.len()],
) -> std::result::Result<Vec<Option<Brick>>, (usize, String, String)> {
    let layers = &layout.layers;
    let (n, e) = (layers.coefficients(), layers.errors());
    let places = blocks(&layout.lattice) * PLACES;
    let read = |array: usize, bytes: usize| match files[array] {
        Some(file) => expanded(file, bytes).map_err(|(found, expected)| (array, found, expected)),
        None => Err((array, "no such file".to_owned(), "one file for each array".to_owned())),
    };
    let low = read(0, places * n)?;
    let stderr = read(1, places * e * 2)?;
    let validity = read(2, places)?;
    let rays = read(3, places * 4)?;
    let high = if files[HIGH].is_some() { Some(read(HIGH, places * n)?) } else { None };
    let weights = layers.weights_of_coefficients();
    // What the numbers of one byte stand for, for each weight.
    let tables: Vec<[f16; 256]> = (weights.iter())
        .map(|w| std::array::from_fn(|byte| restored(i32::from(byte as u8 as i8), packing.step, *w)))
        .collect();
    let mut rank = 0;
    let mut bricks = Vec::with_capacity(places / BRICK_TEXELS);
    let mut ranks = [0usize; BRICK_TEXELS];
    for flags in validity.chunks_exact(BRICK_TEXELS) {
        if flags.iter().all(|flags| flags & BAKED == 0) {
            bricks.push(None);
            continue;
        }
        let mut brick = Brick::unbaked(layers);
        let first = rank;
        for (t, &flags) in flags.iter().enumerate().filter(|(_, flags)| *flags & BAKED != 0) {
            ranks[rank - first] = t;
            brick.validity[t] = flags & !BAKED;
            brick.rays[t] = zarr::little_u32(&rays[4 * rank..4 * rank + 4]);
            rank += 1;
        }
        // Plane by plane: what is read lies side by side.
        for i in 0..n {
            for (r, &t) in (first..rank).zip(&ranks) {
                let at = (r / PLACES * n + i) * PLACES + r % PLACES;
                let above = high.as_ref().map_or(0, |high| high[at] as i8);
                brick.transfer[t * n + i] = match above {
                    0 => tables[i][usize::from(low[at])],
                    above => restored(256 * i32::from(above) + i32::from(low[at] as i8), packing.step, weights[i]),
                };
            }
        }
        for i in 0..e {
            for (r, &t) in (first..rank).zip(&ranks) {
                let at = 2 * ((r / PLACES * e + i) * PLACES + r % PLACES);
                brick.stderr[t * e + i] = f16::from_le_bytes([stderr[at], stderr[at + 1]]);
            }
        }
        bricks.push(Some(brick));
    }
    Ok(bricks)
}

/// Bytes behind `gzip` and `crc32c`; equal for equal bytes.
fn compressed(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzBuilder::new().mtime(0).write(Vec::new(), Compression::new(zarr::GZIP_LEVEL));
    // Writing into memory cannot fail.
    let _ = out.write_all(bytes);
    let mut all = out.finish().unwrap_or_default();
    all.extend(zarr::checksum(&all).to_le_bytes());
    all
}

/// The `length` bytes of a file; what was found and expected where it is damaged.
fn expanded(file: &[u8], length: usize) -> std::result::Result<Vec<u8>, (String, String)> {
    let Some(end) = file.len().checked_sub(CHECKSUM) else {
        return Err((format!("{} bytes", file.len()), "a compressed plane and its checksum".into()));
    };
    let (found, stored) = (zarr::checksum(&file[..end]), zarr::little_u32(&file[end..]));
    if found != stored {
        return Err((format!("bytes with crc32c {found:08x}"), format!("crc32c {stored:08x}")));
    }
    let mut bytes = Vec::with_capacity(length);
    // One more than there should be tells that there are more, and no bomb grows.
    match GzDecoder::new(&file[..end]).take(length as u64 + 1).read_to_end(&mut bytes) {
        Ok(read) if read == length => Ok(bytes),
        Ok(read) => Err((format!("{read} bytes or more, expanded"), format!("{length} bytes"))),
        Err(e) => Err((e.to_string(), "a complete gzip stream".into())),
    }
}

/// What says of a chunk that its files belong together: which are there, and their checksums.
pub(super) fn digest(files: &[Option<&[u8]>; PACKED.len()]) -> String {
    let mut digest = blake3::Hasher::new();
    for file in files {
        digest.update(&[u8::from(file.is_some())]);
        digest.update(&file.map_or(0, zarr::checksum).to_le_bytes());
    }
    digest.finalize().to_hex()[..2 * zarr::STAMP].to_owned()
}

/// Reads what stands in the attributes of a group.
///
/// # Errors
/// When it makes no sense for its layers.
pub(super) fn from_attributes(attributes: &serde_json::Value, layers: &Layers) -> Result<Option<Packing>> {
    let found = &attributes["packing"];
    if found.is_null() {
        return Ok(None);
    }
    let remedy = "pack it again from the store that it was made of: isolume pack";
    let wrong = |what: String| Error::format(FORMAT, what, "step and weights of packed coefficients", remedy);
    let packing: Packing = serde_json::from_value(found.clone()).map_err(|e| wrong(format!("packing: {e}")))?;
    if !(packing.step.is_finite() && packing.step > 0.0) || packing.layer_weights != layers.weights() {
        return Err(wrong(format!("a step of {} and the weights {:?}", packing.step, packing.layer_weights)));
    }
    Ok(Some(packing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::validity;

    /// A number in 0…1 that looks random, of where it is used: SplitMix64.
    fn uniform(seed: u64, item: u64, i: u32, j: u32) -> f64 {
        let mut z = (seed << 48 ^ item << 16 ^ u64::from(i) << 4 ^ u64::from(j)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn layers() -> Layers {
        Layers::new(vec![3, 2]).unwrap()
    }

    /// Two bricks of which every third texel is baked; transfer of unit size that falls with the layer.
    fn bricks(slots: usize) -> Vec<Option<Brick>> {
        let layers = layers();
        let (n, e) = (layers.coefficients(), layers.errors());
        let mut all: Vec<Option<Brick>> = vec![None; slots];
        for slot in [0, slots - 1] {
            let mut brick = Brick::unbaked(&layers);
            for t in (slot % 2..BRICK_TEXELS).step_by(3) {
                for i in 0..n {
                    let u = uniform(3, (slot * 1000 + t) as u64, i as u32, 0);
                    brick.transfer[t * n + i] = f16::from_f64((u - 0.5) / (1 + i) as f64);
                }
                for i in 0..e {
                    brick.stderr[t * e + i] = f16::from_f64(0.01 * (1.0 + uniform(4, t as u64, i as u32, 0)));
                }
                brick.validity[t] = validity::VALID;
                brick.rays[t] = 64 + t as u32;
            }
            // One without a level set.
            let t = slot % 2;
            brick.transfer[t * n..(t + 1) * n].fill(f16::ZERO);
            brick.validity[t] = 0;
            all[slot] = Some(brick);
        }
        all
    }

    fn layout(of_vertices: bool) -> Layout {
        let lattice = if of_vertices { Lattice::of_vertices(4096) } else { Lattice::from_ratio([32; 3], 1.0).unwrap() };
        Layout { lattice, layers: layers() }
    }

    fn files(all: &Files) -> [Option<&[u8]>; PACKED.len()] {
        std::array::from_fn(|i| all[i].as_deref())
    }

    #[test]
    fn what_is_read_back_is_within_half_a_step_and_the_rest_is_kept() {
        for (of_vertices, slots) in [(false, 64), (true, 8)] {
            let (layout, bricks) = (layout(of_vertices), bricks(slots));
            // Of the smaller step most numbers need two bytes.
            for step in [0.01, 0.0005] {
                let packing =
                    Loss::of(&bricks, &layout.layers, Some(step)).unwrap().packing(&layout.layers, 0.01, step);
                let packed = encode_chunk(&packing, &layout, &bricks).unwrap();
                assert_eq!(packed[HIGH].is_some(), step < 0.001);
                let back = decode(&packing, &layout, &files(&packed)).unwrap();
                let weights = layout.layers.weights_of_coefficients();
                for (was, is) in bricks.iter().zip(&back) {
                    let (Some(was), Some(is)) = (was, is) else {
                        assert!(was.is_none() && is.is_none());
                        continue;
                    };
                    assert_eq!((&was.validity, &was.rays), (&is.validity, &is.rays));
                    for (i, (a, b)) in was.transfer.iter().zip(&is.transfer).enumerate() {
                        assert_eq!(a.is_nan(), b.is_nan());
                        if a.is_finite() {
                            let (a, b, w) = (a.to_f64(), b.to_f64(), weights[i % weights.len()]);
                            let most = step / 2.0 / w + b.abs() / 2048.0 + 2f64.powi(-25);
                            assert!((a - b).abs() <= most, "{a} became {b}, step {step}");
                        }
                    }
                    for (a, b) in was.stderr.iter().zip(&is.stderr).filter(|(a, _)| a.is_finite()) {
                        assert!((a.to_f64() - b.to_f64()).abs() <= a.to_f64() / 8.0);
                    }
                }
                // Equal bytes for equal numbers.
                assert_eq!(encode_chunk(&packing, &layout, &bricks).unwrap(), packed);
            }
        }
    }

    #[test]
    fn no_light_exceeds_what_is_stated() {
        let (layout, bricks) = (layout(false), bricks(64));
        let (layers, step) = (&layout.layers, 0.02);
        let packing = Loss::of(&bricks, layers, Some(step)).unwrap().packing(layers, 0.01, step);
        assert!(packing.largest <= packing.bound && packing.largest > 0.3 * packing.bound);
        let back = decode(&packing, &layout, &files(&encode_chunk(&packing, &layout, &bricks).unwrap())).unwrap();
        let (was, is) = (bricks[0].as_ref().unwrap(), back[0].as_ref().unwrap());
        let (n, t) = (layers.coefficients(), 3);
        for light in 0..10_000 {
            let random: Vec<f64> = (0..9).map(|i| uniform(9, light, i, 0) - 0.5).collect();
            let norm = random.iter().map(|v| v * v).sum::<f64>().sqrt();
            for albedo in [0.3, 0.7] {
                let radiance = |brick: &Brick| -> f64 {
                    let of = |offset: usize, count: usize| -> f64 {
                        (0..count).map(|i| brick.transfer[t * n + offset + i].to_f64() * random[i]).sum()
                    };
                    albedo * of(0, 9) + albedo * albedo * of(9, 4)
                };
                let error = (radiance(was) - radiance(is)).abs() / norm;
                assert!(error <= packing.largest * (1.0 + 1e-9), "light {light}: {error} above {}", packing.largest);
            }
        }
    }

    #[test]
    fn every_changed_byte_is_noticed_and_nothing_panics() {
        let (layout, bricks) = (layout(true), bricks(8));
        let packing = Loss::of(&bricks, &layout.layers, Some(0.01)).unwrap().packing(&layout.layers, 0.01, 0.01);
        let packed = encode_chunk(&packing, &layout, &bricks).unwrap();
        for array in 0..HIGH {
            let file = packed[array].clone().unwrap();
            for at in (0..file.len()).step_by(7) {
                let mut damaged = file.clone();
                damaged[at] ^= 0x20;
                let mut all = files(&packed);
                all[array] = Some(&damaged);
                assert_eq!(decode(&packing, &layout, &all).unwrap_err().0, array);
                all[array] = Some(&file[..at]);
                assert_eq!(decode(&packing, &layout, &all).unwrap_err().0, array);
            }
            // A checksum that is right of a stream that is too long.
            let longer = compressed(&vec![0; 1 << 22]);
            let mut all = files(&packed);
            all[array] = Some(&longer);
            assert!(decode(&packing, &layout, &all).unwrap_err().1.contains("or more"));
            all[array] = None;
            assert_eq!(decode(&packing, &layout, &all).unwrap_err().1, "no such file");
        }
    }

    #[test]
    fn what_no_step_fits_is_refused_by_name() {
        let (layers, mut bricks) = (layers(), bricks(8));
        assert!(Loss::of(&bricks, &layers, Some(1e-6)).unwrap_err().to_string().contains("--error"));
        bricks[0].as_mut().unwrap().transfer[1] = f16::INFINITY;
        assert!(Loss::of(&bricks, &layers, None).unwrap_err().to_string().contains("not finite"));
    }
}
