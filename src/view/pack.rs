//! The data of the page: a header as JSON and a payload of sections of numbers.
//!
//! Sections start at multiples of 8 bytes, little-endian; the header names each with offset and length:
//!
//! | section | holds |
//! |---|---|
//! | `samples`, `ranges` | the volume as a texture, and the smallest and largest number of each block of 8³ cells |
//! | `valid` | a bit to each texel of the lattice, x fastest, lowest bit first |
//! | `transfer` | for each coefficient a plane of the valid texels: 16-bit floats, or 8-bit signed with the header's scale |
//! | `error` | for each valid texel 255·sqrt(relative standard error under constant light, at most 1) |
//! | `picture.N` | probe N as a small lat-long image, three 16-bit floats a pixel |
//!
//! A package of a scene has a part `scene` in its header, and differs in these sections:
//!
//! | section | holds |
//! |---|---|
//! | `transfer` | coefficients of the environment in three channels, in the order of [`Layers`] |
//! | `surroundings` | planes of 16-bit floats in every coding: G_k of emission, then of each luminaire |
//! | `error` | where there are luminaires: under them alone |
//!
//! G_k stands layer by layer, and in a layer red, green, blue.
//! Near a luminaire G_k is hundreds of times what it is in a corner: in 8-bit steps of the largest, corners would be
//! black. It is a few numbers a texel. What a texture of a luminaire holds times the header's factor is G_k in W m⁻² sr⁻¹.

use super::samples::{self, BLOCK};
use super::texels::{Texels, reduced};
use crate::error::{Error, Result};
use crate::probe::{Orientation, Probe, SunOptions, split_sun};
use crate::relight::{Light, Material, Textures, contract};
use crate::scene::Colormap;
use crate::sh::{MAX_BANDS, Rotation};
use crate::srgb::byte_from_linear;
use crate::transfer::precision::include_magnitudes;
use crate::transfer::store::SceneIdentity;
use crate::transfer::{Lattice, Layers, Steps};
use crate::volume::{LengthUnit, Volume};
use half::f16;
use serde_json::{Map, Value, json};

/// How transfer coefficients are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// 16-bit floats, as in the store.
    Half,
    /// [`Steps::BYTE`]: 8-bit signed, each coefficient with the scale of its largest magnitude.
    Byte,
}

/// What the page shows.
pub struct Subject<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its transfer, with that of what stands around it.
    pub textures: &'a Textures<'a>,
    /// What stands around it; `None` for a volume alone.
    pub surrounded: Option<Surrounded<'a>>,
    /// Isovalues that were baked, in the file's values; `None` for all.
    pub isovalues: Option<Vec<f64>>,
    /// What the page says about the bake: names and texts.
    pub about: Vec<(String, String)>,
    /// What the page starts with, and its list of environments.
    pub probes: &'a [Probe],
    /// The isovalue that the page starts with.
    pub isovalue: f64,
}

/// What the page says of a scene, and begins with.
#[derive(Clone, Copy, Debug)]
pub struct Surrounded<'a> {
    /// Names of the luminaires, in the order of the textures, and the other volumes with their isovalues.
    pub identity: &'a SceneIdentity,
    /// Turn of the environment at the beginning, in degrees.
    pub rotation: f64,
}

/// How much of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Most texels along an axis.
    pub texture_side: usize,
    /// Most samples along an axis.
    pub volume_side: usize,
    /// How coefficients are stored.
    pub coding: Coding,
}

impl Options {
    /// What a page takes that is served, or written into one file; with other sides where they are given.
    pub fn new(in_one_file: bool, texture_side: Option<u32>, volume_side: Option<u32>) -> Self {
        let (texture, volume, coding) = if in_one_file { (96, 160, Coding::Byte) } else { (256, 512, Coding::Half) };
        let side = |given: Option<u32>, usual| given.map_or(usual, |n| n as usize);
        Self { texture_side: side(texture_side, texture), volume_side: side(volume_side, volume), coding }
    }
}

/// Data of the page.
pub struct Package {
    /// What the payload is, and everything that is not numbers.
    pub header: Value,
    /// The sections.
    pub payload: Vec<u8>,
    /// Texels that have a level set.
    pub valid_texels: u64,
    /// Texels along each axis.
    pub texels: [usize; 3],
    /// Samples along each axis.
    pub samples: [usize; 3],
}

/// Most coefficients of a texel: what a uniform block, and a texture of four to a layer, hold on every WebGL2.
pub const MOST_COEFFICIENTS: usize = 1000;
/// Size of the pictures of probes.
const PICTURE: [usize; 2] = [128, 64];
/// Entries of a colour scale; the page takes the nearest.
const COLORMAP_ENTRIES: usize = 256;
/// Intervals between the quantiles of the values.
const QUANTILES: usize = 256;
/// Albedo under which errors are stated.
const ALBEDO: f32 = 0.7;

struct Payload {
    bytes: Vec<u8>,
    sections: Map<String, Value>,
}

impl Payload {
    fn push(&mut self, name: &str, bytes: &[u8]) {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        self.sections.insert(name.into(), json!([self.bytes.len(), bytes.len()]));
        self.bytes.extend(bytes);
    }
}

/// Packs textures and their volume for the page.
///
/// # Errors
/// When the volume is flat, a texel has more than [`MOST_COEFFICIENTS`] of the environment or of all else, nothing is
/// baked, the textures are not those of the surroundings, or a source cannot be read.
pub fn pack(subject: &Subject<'_>, options: &Options) -> Result<Package> {
    let volume = subject.volume;
    let textures = subject.textures;
    let layout = textures.layout();
    let layers = &layout.layers;
    check_surroundings(subject)?;
    if volume.dims().contains(&1) {
        let found = format!("{:?} samples", volume.dims());
        return Err(Error::argument(
            "volume",
            found,
            "2 or more along each axis",
            "a flat volume has no surface to show",
        ));
    }
    let of_surroundings = textures.emission().map_or(0, |_| 3 * layers.len() * (1 + textures.luminaires().len()));
    let most = layers.coefficients().max(of_surroundings);
    if most > MOST_COEFFICIENTS {
        return Err(Error::Limit {
            what: "the page".into(),
            needed: format!("{most} coefficients a texel"),
            limit: format!("{MOST_COEFFICIENTS}"),
            remedy: match most == layers.coefficients() {
                true => "bake with fewer bands or layers, such as --bands 5,4,3,3".into(),
                false => "bake with fewer layers, or fewer luminaires".into(),
            },
        });
    }
    let lattice = Lattice::from_texels(layout.lattice.grid(), reduced(layout.lattice.texels(), options.texture_side))?;
    let texels = Texels::gather(textures)?;
    let mut payload = Payload { bytes: Vec::new(), sections: Map::new() };

    let volume_texture = samples::volume_texture(volume, reduced(volume.dims(), options.volume_side));
    payload.push("samples", volume_texture.numbers.little_endian());
    payload.push("ranges", samples::ranges(&volume_texture).little_endian());

    let Pushed { numbers, scales, means } = push_transfer(&mut payload, &texels, lattice, subject, options.coding);
    if numbers.is_empty() {
        let remedy = "bake it first: isolume bake VOLUME -o X.isolume";
        return Err(Error::argument("store", "no texel with a level set", "at least one that is baked", remedy));
    }
    let positions: Vec<[f32; 3]> = numbers.iter().map(|&n| position(lattice, n)).collect();
    let constant_error = push_errors(&mut payload, subject, &texels, &positions)?;
    let probes = push_probes(&mut payload, subject, &texels)?;

    let valid_texels = numbers.len() as u64;
    let mut header = json!({
        "format": 1,
        "name": volume.name,
        "about": subject.about.iter().map(|(k, v)| json!([k, v])).collect::<Vec<_>>(),
        "sections": payload.sections,
        "volume": {
            "grid": volume.dims(),
            "samples": volume_texture.dims,
            "coding": volume_texture.numbers.coding_name(),
            // raw = scale·t + offset, value = slope·raw + inter.
            "scale": volume_texture.scale, "offset": volume_texture.offset,
            "slope": volume.slope(), "inter": volume.inter(),
            "sign": volume.solid_sign(),
            "range": [volume.value_range().0, volume.value_range().1],
            "quantiles": samples::value_quantiles(volume, QUANTILES),
            "block": BLOCK, "blocks": samples::block_counts(volume_texture.dims),
            "world_from_grid": affine(volume),
            "unit": match volume.unit { LengthUnit::Unknown => Value::Null, LengthUnit::Metres(m) => json!(m) },
            "up": volume.up.name(),
            "gltf_from_world": volume.up.gltf_from_world().transpose().to_cols_array(),
        },
        "texture": {
            "texels": lattice.texels(), "stored_texels": layout.lattice.texels(),
            "valid": valid_texels, "bands": layers.bands(),
            "coding": match options.coding { Coding::Half => "half", Coding::Byte => "byte" },
            "scales": scales,
        },
        "isovalue": subject.isovalue,
        "isovalues": subject.isovalues,
        "world_from_upright": world_from_upright(volume, layers.max_bands())?,
        "probes": probes,
        "albedo": ALBEDO, "constant_error": constant_error,
        "colormaps": colormaps()?,
    });
    if let Some(surrounded) = &subject.surrounded {
        header["scene"] = scene(surrounded, textures, &means);
    }
    Ok(Package { header, payload: payload.bytes, valid_texels, texels: lattice.texels(), samples: volume_texture.dims })
}

fn position(lattice: Lattice, number: usize) -> [f32; 3] {
    let [mx, my, _] = lattice.texels();
    lattice.grid_from_texel([number % mx, number / mx % my, number / mx / my]).map(|v| v as f32)
}

/// Row-major 3×4.
fn affine(volume: &Volume) -> [f64; 12] {
    let (m, o) = (volume.world_from_grid().linear(), volume.world_from_grid().offset());
    [
        m.x_axis.x, m.y_axis.x, m.z_axis.x, o.x, m.x_axis.y, m.y_axis.y, m.z_axis.y, o.y, m.x_axis.z, m.y_axis.z,
        m.z_axis.z, o.z,
    ]
}

/// Refuses textures of other surroundings than those named.
fn check_surroundings(subject: &Subject<'_>) -> Result<()> {
    if subject.surrounded.is_some_and(|s| s.identity.body.is_some()) {
        let found = "a translucent solid, whose layers are no reflections";
        let remedy = "write .glb, .ply or .png of it with relight";
        return Err(Error::argument("view", found, "an opaque one", remedy));
    }
    let luminaires = |count: usize| format!("a scene of {count} luminaires");
    let alone = || "a volume alone".to_string();
    let named = subject.surrounded.map(|s| s.identity.luminaires.len());
    let found = subject.textures.emission().map(|_| subject.textures.luminaires().len());
    if named == found {
        return Ok(());
    }
    let (found, expected) = (found.map_or_else(alone, luminaires), named.map_or_else(alone, luminaires));
    Err(Error::argument("textures", found, expected, "take textures and surroundings from one store"))
}

/// What the page is told of a scene.
fn scene(surrounded: &Surrounded<'_>, textures: &Textures<'_>, means: &[f64]) -> Value {
    let SceneIdentity { luminaires, coupling, .. } = surrounded.identity;
    let lit = luminaires.iter().zip(textures.luminaires()).zip(means.iter().skip(1));
    let luminaires: Vec<Value> =
        lit.map(|((name, light), mean)| json!({ "name": name, "factor": light.factor, "mean": mean })).collect();
    let partners = coupling.iter().flat_map(|c| &c.partners);
    // No knots: the same isovalue.
    let partners: Vec<Value> = partners.map(|p| json!({ "name": p.name, "isovalues": p.isovalues })).collect();
    json!({
        "luminaires": luminaires,
        "volume": coupling.as_ref().map(|c| &c.name),
        // The factor on its albedo that the transfer has in it.
        "tint": coupling.as_ref().map_or([1.0; 3], |c| c.tint),
        "partners": partners,
        "rotation": surrounded.rotation,
    })
}

/// What [`push_transfer`] found.
struct Pushed {
    /// The valid texels by their number in the lattice.
    numbers: Vec<usize>,
    /// One a coefficient of the environment.
    scales: Vec<f32>,
    /// Mean of G_0 over texels and channels, as stored: of emission and of each luminaire.
    means: Vec<f64>,
}

/// Pushes `valid`, `transfer` and, of a scene, `surroundings`.
fn push_transfer(
    payload: &mut Payload,
    texels: &Texels<'_>,
    lattice: Lattice,
    subject: &Subject<'_>,
    coding: Coding,
) -> Pushed {
    let layers = &subject.textures.layout().layers;
    let n = layers.coefficients();
    let mut largest = vec![0.0f32; n];
    let mut numbers = Vec::new();
    texels.visit_valid(lattice, &mut |number, transfer| {
        numbers.push(number);
        include_magnitudes(&mut largest, transfer[..n].iter().copied());
    });
    let all: usize = lattice.texels().iter().product();
    let mut bits = vec![0u8; all.div_ceil(8)];
    numbers.iter().for_each(|&i| bits[i / 8] |= 1 << (i % 8));
    payload.push("valid", &bits);
    let count = numbers.len();
    let scales: Vec<f32> = match coding {
        Coding::Half => vec![1.0; n],
        Coding::Byte => largest,
    };
    let mut next = 0;
    match coding {
        Coding::Half => {
            let mut planes = vec![f16::ZERO; n * count];
            texels.visit_valid(lattice, &mut |_, transfer| {
                transfer[..n].iter().enumerate().for_each(|(i, &t)| planes[i * count + next] = f16::from_f32(t));
                next += 1;
            });
            payload.push("transfer", bytemuck::cast_slice(&planes));
        }
        Coding::Byte => {
            let mut planes = vec![0i8; n * count];
            texels.visit_valid(lattice, &mut |_, transfer| {
                for (i, &t) in transfer[..n].iter().enumerate() {
                    planes[i * count + next] = Steps::BYTE.code(t, scales[i]) as i8;
                }
                next += 1;
            });
            payload.push("transfer", bytemuck::cast_slice(&planes));
        }
    }
    let means = match subject.surrounded {
        Some(_) => push_surroundings(payload, texels, lattice, layers, count),
        None => Vec::new(),
    };
    Pushed { numbers, scales, means }
}

/// Pushes `surroundings` of `count` valid texels; gives the mean of G_0 of each texture.
fn push_surroundings(
    payload: &mut Payload,
    texels: &Texels<'_>,
    lattice: Lattice,
    layers: &Layers,
    count: usize,
) -> Vec<f64> {
    let (n, of_group) = (layers.coefficients(), 3 * layers.len());
    let mut planes: Vec<f16> = Vec::new();
    let mut sums: Vec<f64> = Vec::new();
    let mut next = 0;
    texels.visit_valid(lattice, &mut |_, transfer| {
        let stored = &transfer[n..];
        planes.resize(stored.len() * count, f16::ZERO);
        sums.resize(stored.len() / of_group, 0.0);
        stored.iter().enumerate().for_each(|(i, &g)| planes[i * count + next] = f16::from_f32(g));
        for (sum, group) in sums.iter_mut().zip(stored.chunks_exact(of_group)) {
            *sum += group[..3].iter().map(|&g| f64::from(g)).sum::<f64>() / 3.0;
        }
        next += 1;
    });
    payload.push("surroundings", bytemuck::cast_slice(&planes));
    sums.iter().map(|sum| sum / count.max(1) as f64).collect()
}

/// The light under which errors are stated besides those of the probes: constant, or that of the luminaires alone.
fn light_of_errors(textures: &Textures<'_>) -> Light {
    Light::constant(if textures.luminaires().is_empty() { [1.0; 3] } else { [0.0; 3] })
}

/// Pushes the relative standard error of each valid texel under [`light_of_errors`]; gives their root mean square over
/// the mean radiance.
fn push_errors(
    payload: &mut Payload,
    subject: &Subject<'_>,
    texels: &Texels<'_>,
    positions: &[[f32; 3]],
) -> Result<f64> {
    let (light, material) = (light_of_errors(subject.textures), Material::new([ALBEDO; 3], [0.0; 3])?);
    let contracted = contract(subject.textures, &texels.baked_bricks(), &light, &material)?;
    let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
    let lit = contracted.look_up(positions, &normals, &light, &material);
    let errors = contracted.look_up_errors(positions);
    let coloured = subject.surrounded.is_some();
    let code = |(rgb, error): (&[f32; 3], &f32)| {
        // Errors are of the mean of the channels; those of a volume alone are equal here.
        let level = if coloured { (rgb[0] + rgb[1] + rgb[2]) / 3.0 } else { rgb[1] }.abs();
        let relative = if level > 0.0 { (error / level).min(1.0) } else { 1.0 };
        (255.0 * relative.sqrt()).round() as u8
    };
    let codes: Vec<u8> = lit.radiance.iter().zip(&errors).map(code).collect();
    payload.push("error", &codes);
    Ok(contracted.noise.relative())
}

fn push_probes(payload: &mut Payload, subject: &Subject<'_>, texels: &Texels<'_>) -> Result<Vec<Value>> {
    let layers = &subject.textures.layout().layers;
    let bricks = texels.baked_bricks();
    let material = Material::new([ALBEDO; 3], [0.0; 3])?;
    let upright = Orientation::new(crate::geom::Up::Z, 0.0)?;
    let standing = Orientation::new(subject.volume.up, 0.0)?;
    let mut list = Vec::new();
    for (i, probe) in subject.probes.iter().enumerate() {
        let light = Light::from_channels(&probe.coefficients_in_world(layers.max_bands(), standing))?;
        let noise = contract(subject.textures, &bricks, &light, &material)?.noise;
        let channels = probe.coefficients_in_world(layers.max_bands(), upright);
        let coefficients: Vec<f64> =
            (0..channels[0].values().len()).flat_map(|k| [0, 1, 2].map(|c| channels[c].values()[k])).collect();
        payload.push(&format!("picture.{i}"), bytemuck::cast_slice(&picture(probe)));
        list.push(json!({
            "name": probe.name, "coefficients": coefficients, "size": PICTURE, "relative_error": noise.relative(),
            "lamps": lamps(subject, probe),
        }));
    }
    Ok(list)
}

/// The lamps that relight lights by rays, which the page does not trace.
fn lamps(subject: &Subject<'_>, probe: &Probe) -> Value {
    let bands = subject.textures.layout().layers.bands()[0];
    let split =
        (subject.surrounded.is_none()).then(|| split_sun(probe, &SunOptions { bands, ..SunOptions::default() }));
    let suns = split.map_or(Vec::new(), |split| split.suns);
    json!({ "count": suns.len(), "share": suns.iter().map(|s| s.flux_share).sum::<f64>() })
}

/// A small picture of a probe: means over the pixels of each part of the image.
fn picture(probe: &Probe) -> Vec<f16> {
    let image = &probe.image;
    let [width, height] = PICTURE;
    let part = |i: usize, n: usize, all: usize| i * all / n..((i + 1) * all / n).max(i * all / n + 1).min(all);
    let mut out = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
            for j in part(y, height, image.height()) {
                for i in part(x, width, image.width()) {
                    let pixel = image.row(j)[i];
                    sum = std::array::from_fn(|c| sum[c] + pixel[c]);
                    count += 1.0;
                }
            }
            out.extend(sum.map(|v| f16::from_f32((v / count.max(1.0)).min(60_000.0))));
        }
    }
    out
}

/// The blocks, one to a degree and row-major, that take coefficients from the upright frame into world.
fn world_from_upright(volume: &Volume, bands: usize) -> Result<Vec<Vec<f64>>> {
    let upright = Orientation::new(crate::geom::Up::Z, 0.0)?;
    let standing = Orientation::new(volume.up, 0.0)?;
    let rotation = Rotation::new(bands.min(MAX_BANDS), &(standing.world_from_probe() * upright.probe_from_world()))?;
    Ok((0..rotation.bands()).map(|l| rotation.block(l).to_vec()).collect())
}

/// Colour scales in sRGB, as hexadecimal digits.
fn colormaps() -> Result<Value> {
    let mut maps = Map::new();
    for name in Colormap::names() {
        let map = Colormap::named(name)?;
        let digits = |i: usize| {
            let [r, g, b] = map.linear(i as f64 / (COLORMAP_ENTRIES - 1) as f64).map(byte_from_linear);
            format!("{r:02x}{g:02x}{b:02x}")
        };
        maps.insert(name.into(), (0..COLORMAP_ENTRIES).map(digits).collect::<String>().into());
    }
    Ok(maps.into())
}
