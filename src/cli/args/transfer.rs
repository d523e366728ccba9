//! What a bake computes, as options: shared by `plan`, `bake` and the lazy bake of `relight`.

use crate::bake::{Estimator, Quality};
use crate::cli::args::volume::VolumeArgs;
pub(in crate::cli) use crate::quantity::{parse_bytes, parse_time};
use crate::scene::{EffectSwitch, Effects, Fog, SceneOptions, TextureSize, Translucent, VolumeOptions};
use crate::sh::MAX_BANDS;
use crate::transfer::MAX_LAYERS;
use crate::transport::REPLICATES;
use crate::volume::Isovalue;

/// Quality of a transfer texture.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct TransferArgs {
    /// Rays per texel or vertex, a power of two: 16 preview, 64 draft, 256 final, 4096 reference [default: as many as
    /// --error 2% needs, at most 4096; 2^28 in all where nothing is asked for]
    #[arg(long, value_name = "N", value_parser = parse_rays)]
    pub(in crate::cli) rays: Option<u32>,
    /// Stop when the standard error of the radiance is this small, such as 1%: RMS over texels or vertices, over the mean
    /// radiance, under the light at hand (of bake: --for-env, else white light)
    #[arg(long, value_name = "E", value_parser = parse_error)]
    pub(in crate::cli) error: Option<f32>,
    /// Stored layers of light: 1 = direct only, N = N−1 bounces and the tail beyond [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=MAX_LAYERS as i64))]
    pub(in crate::cli) layers: Option<u8>,
    /// Transfer that stays non-negative under non-negative light, at more noise
    #[arg(long)]
    pub(in crate::cli) positive: bool,
    /// Bake a texture of this resolution, for all isovalues: a ratio to the data such as 0.5, 1 or 2, 128x128x96, or
    /// adaptive:2%, which leaves out texels that can be interpolated with this error, and is finer than the data where that needs it
    /// [default: isovalues that are named are baked at the vertices of their surfaces; else 1]
    #[arg(long, value_name = "RATIO|XxYxZ|adaptive:E")]
    pub(in crate::cli) texture: Option<TextureSize>,
    /// Switch effects of the plan on or off by hand, such as -interreflection or +shadowing,-emission (see `isolume plan`)
    #[arg(long, value_name = "+NAME|-NAME[,…]", value_delimiter = ',', allow_hyphen_values = true)]
    pub(in crate::cli) effects: Vec<EffectSwitch>,
    /// Fill the box of the volume, outside the solid, with fog of this extinction per world unit, albedo [1] and mean cosine of its
    /// scattering [0], such as 0.02,0.9,0.5
    #[arg(long, value_name = "SIGMA[,ALBEDO[,G]]", allow_hyphen_values = true)]
    pub(in crate::cli) fog: Option<Fog>,
    /// Let light through the solid: extinction per world unit, albedo of its medium (or free, for relight --medium-albedo), mean cosine
    /// of its scattering [0] and index of refraction [1], such as 0.1,0.95,0.5,1.4
    #[arg(long, value_name = "SIGMA[,ALBEDO|free[,G[,INDEX]]]", allow_hyphen_values = true)]
    pub(in crate::cli) translucent: Option<Translucent>,
    /// Move vertices of isosurfaces of a model onto the model itself, with its normals, instead of leaving them on its samples
    #[arg(long)]
    pub(in crate::cli) exact_vertices: bool,
    /// Refuse to use more memory, such as 2GB [default: 80 % of what machine, ulimit -v and control group allow]
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub(in crate::cli) memory_limit: Option<u64>,
}

/// A whole bake.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct BakeArgs {
    #[command(flatten)]
    pub(in crate::cli) transfer: TransferArgs,
    /// Spherical harmonic bands: one count, or one for each layer such as 5,4,3,3 [default: 8,5,4 and then 3; with --positive 5]
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',',
        value_parser = clap::value_parser!(u8).range(1..=MAX_BANDS as i64))]
    pub(in crate::cli) bands: Vec<u8>,
    /// Bake only these isosurfaces, at their vertices (with --texture: at the texels around them): numbers, 40%, 1.5sigma, 1.5rms, enclosed:5%, 300HU, bone,
    /// skin, otsu, auto
    #[arg(long, visible_alias = "isovalue", value_name = "C[,C…]", value_delimiter = ',', allow_hyphen_values = true)]
    pub(in crate::cli) isovalues: Vec<Isovalue>,
    /// Estimator of the transfer
    #[arg(long, value_enum, default_value = "path")]
    pub(in crate::cli) estimator: Estimator,
}

pub(in crate::cli) fn parse_rays(text: &str) -> Result<u32, String> {
    let rays: u32 = text.parse().map_err(|_| "give a power of two such as 64".to_string())?;
    if rays.is_power_of_two() && (REPLICATES as u32..=1 << 20).contains(&rays) {
        Ok(rays)
    } else {
        Err("give a power of two from 4 to 1048576: 16 is a preview, 64 a draft, 256 final".into())
    }
}

fn parse_error(text: &str) -> Result<f32, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |percent| (percent, 100.0));
    match number.trim().parse::<f64>().map(|n| (n / unit) as f32) {
        Ok(error) if error > 0.0 && error < 1.0 => Ok(error),
        _ => Err("give a standard error between 0 and 1, such as 0.02 or 2%".into()),
    }
}

impl TransferArgs {
    /// What is asked of the library, with bands as given: none, one, or one a layer.
    pub(in crate::cli) fn quality(&self, bands: &[u8], seed: u64) -> Quality {
        Quality {
            rays: self.rays,
            error: self.error,
            seconds: None,
            layers: self.layers.map(usize::from),
            bands: bands.iter().map(|&b| usize::from(b)).collect(),
            texture: self.texture,
            positive: self.positive,
            effects: self.effects(),
            estimator: Estimator::Path,
            memory_limit: self.memory_limit,
            seed,
        }
    }

    /// What was switched by hand.
    pub(in crate::cli) fn effects(&self) -> Effects {
        Effects::new(self.effects.iter().copied())
    }

    /// How what is baked is opened, with what these options put around it.
    pub(in crate::cli) fn scene(&self, volume: &VolumeArgs) -> SceneOptions {
        let effects = self.effects();
        let (shadowing, exact_vertices) = (effects.shadowing(), self.exact_vertices);
        let volume = VolumeOptions { shadowing, exact_vertices, ..volume.options() };
        SceneOptions { volume, effects, fog: self.fog, translucent: self.translucent }
    }
}

impl BakeArgs {
    /// What is asked of the library.
    pub(in crate::cli) fn quality(&self, seed: u64) -> Quality {
        Quality { estimator: self.estimator, ..self.transfer.quality(&self.bands, seed) }
    }
}

/// Reads the indices of a texel.
pub(in crate::cli) fn parse_texel(text: &str) -> Result<[usize; 3], String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok([x, y, z]),
        _ => Err("give three indices such as 90,120,80".into()),
    }
}
