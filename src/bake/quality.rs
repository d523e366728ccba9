//! How well transfer is baked, as it is asked for: a few settings from which the request of each volume follows.

use super::{Estimator, ForLight, Goal, Hints, Request, layout_of_scene};
use crate::error::{Error, Result};
use crate::scene::geometry::Geometry;
use crate::scene::{Effects, Member, SceneFile, TextureSize};
use crate::transfer::strides::COARSEST;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;
use crate::volume::Volume;

/// Rays of a texel where nothing says how many of an estimator that has no goals, and the most where it stops at an error or a
/// time.
pub(super) const RAYS: u32 = 64;
const MOST_RAYS: u32 = 4096;
/// Bands of transfer that stays positive.
const POSITIVE_BANDS: usize = 5;

/// How well transfer is baked; what is not said is chosen.
#[derive(Clone, Debug, Default)]
pub struct Quality {
    /// Rays per texel or vertex; with an error or a time the most that one gets.
    pub rays: Option<u32>,
    /// Standard error to stop at.
    pub error: Option<f32>,
    /// Seconds to stop by.
    pub seconds: Option<f64>,
    /// Stored layers; 4, or as many as `bands` has numbers.
    pub layers: Option<usize>,
    /// Bands of all layers, or of each; as [`Layers::usual`], if none.
    pub bands: Vec<usize>,
    /// Resolution of a texture; of named isovalues the vertices of their surfaces are baked, if none.
    pub texture: Option<TextureSize>,
    /// Transfer that stays non-negative under non-negative light.
    pub positive: bool,
    /// Effects switched by hand.
    pub effects: Effects,
    /// What estimates the transfer.
    pub estimator: Estimator,
    /// Most bytes to use.
    pub memory_limit: Option<u64>,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// The lattice of a texture of this resolution on a volume.
///
/// # Errors
/// As [`Lattice::from_ratio`] and [`Lattice::from_texels`].
pub fn lattice_of(volume: &Volume, texture: TextureSize) -> Result<Lattice> {
    match texture {
        TextureSize::Ratio(ratio) => Lattice::from_ratio(volume.dims(), ratio),
        TextureSize::Adaptive { ratio, .. } => {
            // The last texel is one of the largest stride: before it nothing lacks a parent.
            let texels = Lattice::from_ratio(volume.dims(), ratio)?.texels();
            let whole = |m: usize| if m == 1 { 1 } else { (m - 1).next_multiple_of(COARSEST) + 1 };
            Lattice::from_texels(volume.dims(), texels.map(whole))
        }
        TextureSize::Texels(texels) => Lattice::from_texels(volume.dims(), texels.map(|n| n as usize)),
    }
}

impl Quality {
    /// Layout of the texture on a volume, with channels where something stands around it.
    ///
    /// # Errors
    /// When bands and layers do not fit together, or the texture makes no sense.
    pub fn layout(&self, volume: &Volume, geometry: Option<&Geometry>) -> Result<Layout> {
        let count = self.layers.unwrap_or(4);
        let bands = match (self.bands.as_slice(), self.layers) {
            (&[], _) if self.positive => vec![POSITIVE_BANDS; count],
            (&[], _) => Layers::usual(count)?.bands().to_vec(),
            (&[one], _) => vec![one; count],
            (list, Some(layers)) if list.len() != layers => {
                return Err(Error::argument(
                    "--bands",
                    format!("{} counts for --layers {layers}", list.len()),
                    "one count, or one for each layer",
                    "leave out --layers, or give as many counts",
                ));
            }
            (list, _) => list.to_vec(),
        };
        let direct_only = self.effects.switched("interreflection") == Some(false);
        let bands = if direct_only { bands[..1].to_vec() } else { bands };
        if self.positive && bands.windows(2).any(|w| w[0] != w[1]) {
            return Err(Error::argument(
                "--bands",
                format!("{bands:?}"),
                "the same number of bands in all layers together with --positive",
                "give one count",
            ));
        }
        let lattice = lattice_of(volume, self.texture.unwrap_or(TextureSize::Ratio(1.0)))?;
        Ok(layout_of_scene(Layout { lattice, layers: Layers::new(bands)? }, geometry))
    }

    /// Whether isovalues that are named are baked at the vertices of their isosurfaces.
    pub fn bakes_surfaces(&self) -> bool {
        self.texture.is_none() && self.estimator == Estimator::Path
    }

    /// Settings of the estimator, and what is to be reached under some lights; a target follows from the goal.
    pub fn settings(&self, layers: &Layers, lights: Vec<ForLight>) -> (Settings, Goal) {
        let goal = match (self.error, self.seconds, self.rays) {
            (None, None, None) if self.estimator == Estimator::Path => Goal::usual(lights),
            (error, seconds, _) => Goal { error, lights, most_paths: None, seconds },
        };
        let stops = goal.error.is_some() || goal.seconds.is_some();
        let rays = self.rays.unwrap_or(if stops { MOST_RAYS } else { RAYS });
        let settings =
            Settings { layers: layers.clone(), rays, seed: self.seed, target: None, positive: self.positive };
        (settings, goal)
    }

    /// The bake of a volume for some isovalues, or for all, whose errors are measured under some lights.
    ///
    /// # Errors
    /// As [`Self::layout`].
    pub fn request<'a>(
        &'a self,
        member: &'a Member,
        isovalues: Option<Vec<f64>>,
        lights: Vec<ForLight>,
    ) -> Result<Request<'a>> {
        let (volume, geometry) = (&*member.volume, member.geometry.as_ref());
        let layout = self.layout(volume, geometry)?;
        let (settings, goal) = self.settings(&layout.layers, lights);
        Ok(Request {
            goal,
            estimator: self.estimator,
            surfaces: isovalues.is_some() && self.bakes_surfaces(),
            isovalues,
            memory_limit: self.memory_limit,
            geometry,
            adaptive: match self.texture {
                Some(TextureSize::Adaptive { error, .. }) => Some(error),
                _ => None,
            },
            ..Request::new(volume, &member.label, layout, settings, &self.effects)
        })
    }
}

impl Hints {
    /// What a scene says of the light to come, of some isovalues or of all.
    #[doc(hidden)]
    pub fn of_scene(scene: Option<&SceneFile>, range: (f64, f64), isovalues: Option<&[f64]>) -> Self {
        let Some(file) = scene else { return Self::default() };
        let scene = &file.description;
        Self {
            albedo: scene.albedo.as_ref().map(|albedo| albedo.rule(range).largest_albedo(isovalues)),
            emission: Some(scene.emission.as_ref().map_or(0.0, |emission| emission.largest(isovalues))),
            sun_split: scene.probe.as_ref().and_then(|probe| probe.sun_split).unwrap_or_default(),
            shown: false,
        }
    }
}
