//! A bake of a scene, set up call by call: the requests of its volumes from a few settings.

use super::{Estimator, ForLight, Observer, Quality, Report, Request, Share, Writing, run};
use crate::error::{Error, Result};
use crate::scene::{Effects, Member, Scene, TextureSize};
use crate::transfer::store::Store;
use crate::volume::Isovalue;
use std::path::Path;

/// A bake of all volumes of a scene: of all isovalues, 4 layers of 8, 5, 4 and 3 bands, as many texels as samples, as many rays as
/// [`Goal::usual`](super::Goal::usual) needs, unless told otherwise. Named isovalues are baked at the vertices of their isosurfaces. The same bake into the same store goes on where it stopped, and ends with the same bytes.
///
/// ```
/// use isolume::bake::{Bake, Silent};
/// use isolume::scene::Scene;
///
/// # fn main() -> isolume::Result<()> {
/// # let folder = tempfile::tempdir().map_err(|e| isolume::Error::io("", "make a folder", e))?;
/// let scene = Scene::open("bumpbox:12")?;
/// let bake = Bake::of(&scene).isovalues([47.0]).layers(2).bands(3).error(0.1);
/// let (store, reports) = bake.run(folder.path().join("bumps.isolume"), &Silent)?;
/// assert!(reports[0].summary.errors.quantile(0.5) <= 0.1 && store.holdings()?.surfaces == [47.0]);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
#[must_use = "nothing is baked before `run`"]
pub struct Bake<'a> {
    scene: &'a Scene,
    isovalues: Option<Vec<f64>>,
    quality: Quality,
    lights: Vec<ForLight>,
    share: Option<Share>,
    writing: Writing,
}

impl<'a> Bake<'a> {
    /// A bake of a scene.
    pub fn of(scene: &'a Scene) -> Self {
        Self {
            scene,
            isovalues: None,
            quality: Quality { layers: Some(4), ..Quality::default() },
            lights: Vec::new(),
            share: None,
            writing: Writing::default(),
        }
    }

    /// Only these isosurfaces, at their vertices, or with [`Self::texture`] the texels that they look up; in the values of the file (of the first volume, where there are several).
    /// [`Member::choose`] makes values of percentages, `auto` and others.
    pub fn isovalues(self, isovalues: impl IntoIterator<Item = f64>) -> Self {
        Self { isovalues: Some(isovalues.into_iter().collect()), ..self }
    }

    /// A texture of so many texels for each sample along an axis, such as 0.5 or 2, for named isovalues, too: it serves those
    /// that are not named, exports of volumes, and the slider of the page. 1 where all isovalues are baked. Of all isovalues also an
    /// adaptive one ([`TextureSize::Adaptive`]).
    pub fn texture(mut self, size: impl Into<TextureSize>) -> Self {
        self.quality.texture = Some(size.into());
        self
    }

    /// Stored layers: 1 is direct light alone, n has n − 1 reflections and the tail beyond.
    pub fn layers(mut self, layers: usize) -> Self {
        self.quality.layers = Some(layers);
        self
    }

    /// So many spherical-harmonic bands in each layer. Otherwise as [`Layers::usual`](crate::transfer::Layers::usual), or 5 where transfer stays positive.
    pub fn bands(mut self, bands: usize) -> Self {
        self.quality.bands = vec![bands];
        self
    }

    /// Rays per texel, a power of two; with an error or a time the most that a texel gets.
    pub fn rays(mut self, rays: u32) -> Self {
        self.quality.rays = Some(rays);
        self
    }

    /// Seed of all random numbers.
    pub fn seed(mut self, seed: u64) -> Self {
        self.quality.seed = seed;
        self
    }

    /// Transfer that stays non-negative under non-negative light, at more noise.
    pub fn positive(mut self, positive: bool) -> Self {
        self.quality.positive = positive;
        self
    }

    /// Stops at this root mean square over the texels of the standard error of the radiance, over its mean: under white light, or
    /// under [`Self::for_light`].
    pub fn error(mut self, error: f32) -> Self {
        self.quality.error = Some(error);
        self
    }

    /// Chooses the standard error such that the bake takes about this long by the observer's clock.
    pub fn seconds(mut self, seconds: f64) -> Self {
        self.quality.seconds = Some(seconds);
        self
    }

    /// Measures errors by the radiance under this environment; under each, where there are several.
    pub fn for_light(mut self, light: ForLight) -> Self {
        self.lights.push(light);
        self
    }

    /// The estimator of the transfer.
    pub fn estimator(mut self, estimator: Estimator) -> Self {
        self.quality.estimator = estimator;
        self
    }

    /// Only share `index` (from 1) of `of` shares of the work ([`Share`]): several processes may fill one store so, or each its own for
    /// [`StoreOptions::merge`](crate::transfer::store::StoreOptions::merge).
    ///
    /// # Errors
    /// When there is no such share.
    pub fn share(self, index: usize, of: usize) -> Result<Self> {
        if index < 1 || index > of {
            let expected = "i of n with i from 1 to n";
            return Err(Error::argument("share", format!("{index} of {of}"), expected, "count shares from 1"));
        }
        Ok(Self { share: Some(Share { index, of }), ..self })
    }

    /// Refuses to use more bytes of memory.
    pub fn memory_limit(mut self, bytes: u64) -> Self {
        self.quality.memory_limit = Some(bytes);
        self
    }

    /// Effects switched on or off by hand.
    pub fn effects(mut self, effects: Effects) -> Self {
        self.quality.effects = effects;
        self
    }

    /// How the store is written and what of it is verified.
    pub fn writing(self, writing: Writing) -> Self {
        Self { writing, ..self }
    }

    /// The requests of the volumes, in their order.
    ///
    /// # Errors
    /// When no surface has an isovalue, or the texture or its layers make no sense.
    pub fn requests(&self) -> Result<Vec<Request<'_>>> {
        self.scene.members().iter().map(|member| self.request(member)).collect()
    }

    fn request<'b>(&'b self, member: &'b Member) -> Result<Request<'b>> {
        let choose = |c: &f64| Ok(member.choose(Isovalue::Value(*c))?.value);
        let isovalues = match &self.isovalues {
            Some(list) => Some(list.iter().map(choose).collect::<Result<Vec<f64>>>()?),
            None => None,
        };
        let request = self.quality.request(member, isovalues, self.lights.clone())?;
        Ok(Request { share: self.share, writing: self.writing, ..request })
    }

    /// Bakes what is missing or damaged into the store at `path`, which is made if there is none: the store of the first volume,
    /// and a report for each.
    ///
    /// # Errors
    /// Those of [`Self::requests`] and [`run()`]; [`Error::Stopped`] when the observer wanted to stop before all was done.
    pub fn run(&self, path: impl AsRef<Path>, observer: &dyn Observer) -> Result<(Store, Vec<Report>)> {
        let (path, requests) = (path.as_ref(), self.requests()?);
        requests.iter().try_for_each(Request::check)?;
        let mut reports = Vec::with_capacity(requests.len());
        for request in &requests {
            reports.push(run(request, path, observer)?.1);
        }
        Ok((Store::open(path)?, reports))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Silent;
    use super::*;
    use crate::volume::field;

    #[test]
    fn what_makes_no_sense_is_refused_by_name_and_leaves_no_store() {
        let volume = field::by_name("bumpbox:8").unwrap().unwrap().sample().unwrap();
        let scene = Scene::of(volume);
        let folder = tempfile::tempdir().unwrap();
        let bake = || Bake::of(&scene).isovalues([47.0]).rays(16);
        let light = |albedo| ForLight {
            name: "white".into(),
            name_in_store: "white".into(),
            light: [1; 3].map(crate::sh::Coefficients::zero),
            rest: None,
            albedo,
        };
        for (name, bake) in [
            ("bands", bake().layers(0)),
            ("bands", bake().bands(0)),
            ("rays", bake().rays(3)),
            ("texture", bake().texture(f64::NAN)),
            ("isovalue", bake().isovalues([f64::NAN])),
            ("isovalues", bake().isovalues([])),
            ("error", bake().error(0.0)),
            ("error", bake().error(-1.0)),
            ("error", bake().error(f32::NAN)),
            ("seconds", bake().seconds(-1.0)),
            ("seconds", bake().seconds(f64::INFINITY)),
            ("albedo", bake().error(0.1).for_light(light(f32::NAN))),
        ] {
            let path = folder.path().join("x.isolume");
            match bake.run(&path, &Silent).map(|_| ()) {
                Err(Error::Argument { name: found, .. }) => assert_eq!(found, name),
                other => panic!("{name}: {other:?}"),
            }
            assert!(!path.exists(), "{name}");
        }
        assert!([(0, 0), (0, 2), (3, 2)].iter().all(|&(i, n)| bake().share(i, n).is_err()));
    }
}
