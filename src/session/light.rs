//! Environments made ready for a transfer: turned, cut to its bands, windowed, and without the suns that are lit apart.

use crate::error::{Error, Result};
use crate::geom::Up;
use crate::probe::SunSplit;
use crate::probe::sun::{NoSun, SunOptions, split_sun};
use crate::probe::{EnvFrame, Orientation, Probe};
use crate::quantity::{count, percent};
use crate::relight::{self, ClampReport, Light};
use crate::render::SunLight;
use crate::sh::Coefficients;
use crate::sh::kernel::{Kept, Window};
use crate::transfer::Layers;

/// How an environment lights.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct LightOptions {
    /// How far the light is turned counter-clockwise about up, seen from above, in degrees.
    pub rotation_degrees: f64,
    /// Where the centre of environment images lies in glTF.
    pub frame: EnvFrame,
    /// Bands that the light is cut to; those of the transfer, if `None` or more.
    pub bands: Option<usize>,
    /// What softens the light against ringing. [`Window::Certified`] makes it nowhere negative, and texels that come
    /// out below 0 by noise or rounding 0.
    pub window: Window,
    /// Which lamps are lit apart from the environment, by visibility rays: sharp shadows, no ringing.
    pub split_sun: SunSplit,
}

impl LightOptions {
    /// How the environment stands around what has this axis up.
    ///
    /// # Errors
    /// When the rotation is not finite.
    #[doc(hidden)]
    pub fn orientation(&self, up: Up) -> Result<Orientation> {
        Ok(Orientation::new(up, self.rotation_degrees)?.in_frame(self.frame))
    }

    /// When lobes are taken for lamps, if so.
    fn sun_options(&self, bands: usize) -> Option<SunOptions> {
        match (self.split_sun, self.window) {
            (SunSplit::Auto, window) if window != Window::None => None,
            (split, _) => SunOptions::of(split, bands),
        }
    }
}

/// What was done to light, for whom it may concern.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum LightNote {
    /// No sun was split off, and why.
    NoSun(NoSun),
    /// Lamps were split off and are lit apart.
    Suns {
        /// How many.
        count: usize,
        /// Their part of the environment's flux.
        share: f64,
        /// Half the angle across that of the strongest, in radians.
        angular_radius: f64,
        /// What radiance beside a shadow would lose if the environment were cut to the bands with them, and what it loses
        /// without them: root mean square over the mean.
        truncation: [f64; 2],
    },
    /// What a window kept of the layer that it took most of.
    Window(Kept),
    /// What was below 0 by noise or rounding under certified light, and is 0 now.
    Clamped(ClampReport),
}

impl LightNote {
    /// In a sentence about the environment of this name.
    #[doc(hidden)]
    pub fn sentence(&self, probe: &str) -> String {
        match self {
            LightNote::NoSun(why) => format!("{probe}: no sun was split off: {why}"),
            LightNote::Suns { count, share, angular_radius, truncation: [before, after] } => {
                let across = 2.0 * angular_radius.to_degrees();
                let lamps = match count {
                    1 => format!("a lamp {across:.1}° across with {} of the light is", percent(*share)),
                    n => format!(
                        "{n} lamps with {} of the light, the strongest {across:.1}° across, are",
                        percent(*share)
                    ),
                };
                let [before, after] = [before, after].map(|v| percent(*v));
                format!(
                    "{probe}: {lamps} lit apart: in bands beside a shadow {before} of the radiance would be lost, now {after}"
                )
            }
            LightNote::Window(kept) => format!(
                "{probe}: the window keeps {} of the energy and {} of the contrast",
                percent(kept.energy),
                percent(kept.contrast)
            ),
            LightNote::Clamped(clamped) => format!(
                "{probe}: {} of {} texels were below 0 by noise or rounding and are 0 now, {} of the energy",
                count(clamped.texels),
                count(clamped.of_texels),
                percent(clamped.energy)
            ),
        }
    }
}

/// Visibility rays for each surface point and sun; [`crate::render::PENUMBRA`] times as many in the penumbra. Of 16 all agree
/// at many points where a twig hides a part of a lamp: on emd_3197 under the studio that left 1.3 % of direct light untold.
#[doc(hidden)]
pub const SUN_RAYS: u32 = 64;

/// An environment, ready to be multiplied with transfer.
#[derive(Clone, Debug)]
pub struct Lighting<'p> {
    pub(super) probe: &'p Probe,
    pub(super) options: LightOptions,
    pub(super) light: Light,
    pub(super) suns: Vec<SunLight>,
    // The environment without these.
    pub(super) rest: Option<Probe>,
    pub(super) notes: Vec<LightNote>,
}

impl<'p> Lighting<'p> {
    /// The light of a probe around what has `up` up, in world axes, cut and windowed at the band limit of each layer. A
    /// sun that is split off is missing from all of them: rays light what it shines on, and paths what it brings by reflection.
    ///
    /// # Errors
    /// When the rotation is not finite, no band is left, or light with negative pixels is to be certified.
    pub fn new(probe: &'p Probe, up: Up, layers: &Layers, options: &LightOptions) -> Result<Self> {
        let is_certified = options.window == Window::Certified;
        if is_certified && probe.image.pixels().iter().flatten().any(|&v| v < 0.0) {
            let remedy = "light with negative pixels cannot be certified: take another window, or set them to 0";
            return Err(Error::argument("window", "certified", "an environment without negative pixels", remedy));
        }
        let most = layers.max_bands();
        if options.bands == Some(0) {
            return Err(Error::argument(
                "bands",
                0,
                "at least 1",
                "1 band is light of the same strength from everywhere",
            ));
        }
        let bands = options.bands.map_or(most, |b| b.min(most));
        let orientation = options.orientation(up)?;
        let mut light = probe.coefficients_in_world(bands, orientation);
        let mut notes = Vec::new();
        let mut suns = Vec::new();
        let mut rest = None;
        if let Some(sun_options) = options.sun_options(layers.bands()[0].min(bands)) {
            let split = split_sun(probe, &sun_options);
            if let Some(strongest) = split.suns.first() {
                light = split.rest.coefficients_in_world(bands, orientation);
                notes.push(LightNote::Suns {
                    count: split.suns.len(),
                    share: split.suns.iter().map(|s| s.flux_share).sum(),
                    angular_radius: strongest.sun.angular_radius,
                    truncation: [split.truncation, split.truncation_of_rest],
                });
            } else {
                notes.push(LightNote::NoSun(split.stopped));
            }
            suns.extend(split.suns.iter().map(|s| SunLight::new(&s.sun, orientation, SUN_RAYS)));
            rest = (!split.suns.is_empty()).then_some(split.rest);
        }
        let prepared = relight::prepare(&light, layers, options.window)?;
        if options.window != Window::None {
            notes.push(LightNote::Window(prepared.least_kept().kept));
        }
        Ok(Self { probe, options: options.clone(), light: prepared.light, suns, rest, notes })
    }

    /// Its probe.
    pub fn probe(&self) -> &'p Probe {
        self.probe
    }

    /// How it was made ready.
    pub fn options(&self) -> &LightOptions {
        &self.options
    }

    /// The whole light in world axes, with the suns that are lit apart: at most `bands`, no window.
    ///
    /// # Errors
    /// When the rotation is not finite.
    pub(crate) fn whole(&self, up: Up, bands: usize) -> Result<[Coefficients; 3]> {
        Ok(self.probe.coefficients_in_world(bands, self.options.orientation(up)?))
    }

    /// The coefficients for each layer, without suns that are lit apart.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// The suns that are lit apart.
    pub fn suns(&self) -> &[SunLight] {
        &self.suns
    }

    /// Whether the light is proven nowhere negative.
    #[doc(hidden)]
    pub fn is_certified(&self) -> bool {
        self.options.window == Window::Certified
    }

    /// What was done.
    pub fn notes(&self) -> &[LightNote] {
        &self.notes
    }
}
