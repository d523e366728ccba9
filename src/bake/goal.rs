//! Where texels stop: at a standard error that was asked for, or at the one that a given time allows.

use super::observer::Observer;
use super::request::Request;
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::sh::Coefficients;
use crate::transfer::store::{Baked, ErrorTarget, Store};
use crate::transfer::{Layers, Selection};
use crate::transport::{ErrorHistogram, Settings, Target, noise_picked, pilot, radiance_weights, trial};
use serde_json::json;

/// An environment that errors are measured by.
#[derive(Clone, Debug)]
pub struct ForLight {
    /// Its name, for messages.
    pub name: String,
    /// How it is named in stores: with whatever else tells it from others, such as how it stands.
    pub name_in_store: String,
    /// Red, green and blue in world axes.
    pub light: [Coefficients; 3],
    /// What is left of it where lamps are lit apart, by rays and paths and not by transfer; all of it, if `None`.
    pub rest: Option<[Coefficients; 3]>,
    /// Albedo of the surface under it.
    pub albedo: f32,
}

impl ForLight {
    /// The same radiance from everywhere, on a surface of albedo 0.7.
    pub fn white() -> Self {
        let light = [1.0; 3].map(|radiance| Coefficients::constant(1, radiance));
        let name = "white light".to_owned();
        Self { name_in_store: name.clone(), name, light, rest: None, albedo: ALBEDO }
    }
}

/// What the user wants reached.
#[derive(Clone, Debug, Default)]
pub struct Goal {
    /// Root mean square over the texels of the standard error of the radiance, over its mean.
    pub error: Option<f32>,
    /// Under which lights, in each of them; if there is none under white light, and that of the luminaires.
    pub lights: Vec<ForLight>,
    /// Most paths over all texels: where they do not suffice the goal is missed.
    pub most_paths: Option<u64>,
    /// Seconds from the start of the command ([`Observer::seconds`]); trials find the error that they allow.
    pub seconds: Option<f64>,
}

/// The error that is aimed at where nothing is asked for, and the most paths that it may take.
const USUAL_ERROR: f32 = 0.02;
const USUAL_PATHS: u64 = 1 << 28;
/// Fewest paths of a texel, whatever most_paths says.
const FEWEST: u32 = 64;

impl Goal {
    /// What is aimed at where nothing is asked for: 2 % under some lights, or white light if there is none, by at most 2^28
    /// paths.
    pub fn usual(lights: Vec<ForLight>) -> Self {
        Self { error: Some(USUAL_ERROR), lights, most_paths: Some(USUAL_PATHS), seconds: None }
    }

    /// Most paths of each of so many texels: `rays`, or the largest power of two that [`Self::most_paths`] allows.
    pub(super) fn rays(&self, rays: u32, texels: u64) -> u32 {
        let allowed = self.most_paths.map_or(u64::from(u32::MAX), |most| most / texels.max(1));
        let allowed = u32::try_from(allowed).unwrap_or(u32::MAX).max(FEWEST);
        rays.min(1 << allowed.ilog2())
    }

    /// Refuses errors and times that no bake can have, and an albedo that is none.
    pub(super) fn check(&self) -> Result<()> {
        let given = [("error", self.error.map(f64::from)), ("seconds", self.seconds)];
        for (name, value) in given {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                let remedy = if name == "error" { "give for example 0.01" } else { "give for example 60" };
                return Err(Error::argument(name, value, "a finite number above 0", remedy));
            }
        }
        match self.lights.iter().find(|light| !(0.0..=1.0).contains(&light.albedo)) {
            Some(light) => {
                Err(Error::argument("albedo", light.albedo, "0 to 1", "give that of the surface under this light"))
            }
            None => Ok(()),
        }
    }
}

/// What the error of a bake without an environment was of in older stores: a standard error of every texel.
pub const ESCAPE: &str = "sum of a_k, and a_0";
const ALBEDO: f32 = 0.7;
/// Texels and rays of the trial that gives the mean radiance under an environment.
const MEAN_TEXELS: u64 = 4096;
const MEAN_RAYS: u32 = 64;
/// Texels of the trial that tells how much of the noise the lights pick.
const PICKED_TEXELS: u64 = 2048;
/// Variance over what standard errors say of it, at least and at most.
const LEAST_PICKED: f64 = 0.5;
const MOST_PICKED: f64 = 4.0;
/// Part of the time that is kept for writing and for what the trial misjudges.
const RESERVE: f64 = 0.1;
/// Part of the time that one trial may take, and the number of trials.
const TRIAL: f64 = 0.03;
const TRIALS: usize = 5;
/// Range of the errors that a time may buy.
const LARGEST_ERROR: f64 = 0.5;
const SMALLEST_ERROR: f64 = 1e-4;

/// A target and its name in the store.
pub(super) struct Quality {
    pub(super) target: Option<Target>,
    pub(super) name: Option<ErrorTarget>,
}

/// Makes targets of one kind for any error.
struct Kind {
    of: String,
    /// Weights of the lights over their mean radiance.
    weights: Vec<Vec<f32>>,
    /// Of each luminaire and layer, over the mean radiance.
    luminaires: Vec<Vec<f32>>,
    /// Errors of a few texels at the fewest paths, what the target names.
    errors: ErrorHistogram,
}

impl Kind {
    fn new(job: &Request<'_>, pyramid: &Pyramid) -> Result<Self> {
        let layers = &job.layout.layers;
        // The mean over all isosurfaces, whichever were asked for, so that those asked for later agree.
        let settings = Settings { rays: MEAN_RAYS, target: None, ..job.settings.clone() };
        let selection = match job.points {
            Some(_) => job.selection(),
            None => Selection::of_all_isosurfaces(job.layout.lattice, job.volume),
        };
        let found = pilot(&job.bake(pyramid, &settings, &selection), MEAN_TEXELS)?;
        let exponents = job.geometry.map_or(Vec::new(), |geometry| geometry.exponents(job.volume));
        let powers: Vec<f64> = exponents.iter().map(|&e| libm::ldexp(1.0, e)).collect();
        let mean_of_luminaires = |albedo: f32| -> f64 {
            powers.iter().enumerate().map(|(l, power)| power * found.mean_of_luminaire(l, f64::from(albedo))).sum()
        };
        let white = [ForLight::white()];
        let lights = if job.goal.lights.is_empty() { &white } else { job.goal.lights.as_slice() };
        let (mut weights, mut names, mut luminaires) = (Vec::new(), Vec::new(), Vec::new());
        let is_usual = job.goal.most_paths.is_some();
        for light in lights {
            let albedo = light.albedo;
            let of_transfer = light.rest.as_ref().unwrap_or(&light.light);
            let each: Vec<Vec<f32>> = of_transfer.iter().map(|light| weights_of(layers, light, albedo)).collect();
            // Over all that the surface sends out: with the lamps that are lit apart.
            let of_whole = |whole| found.mean_of(&weights_of(layers, whole, albedo));
            let mean = light.light.iter().map(of_whole).sum::<f64>() / 3.0 + mean_of_luminaires(albedo);
            if mean.is_nan() || mean <= 0.0 {
                // A light that was not asked for as a measure may be dark.
                if is_usual {
                    continue;
                }
                let found = format!("{}, which lights no texel (mean radiance {mean:.3e})", light.name);
                let remedy = "give another one, or measure errors without an environment";
                return Err(Error::argument("environment", found, "one that lights the volume", remedy));
            }
            weights.extend(each.into_iter().map(|w| w.iter().map(|v| v / mean as f32).collect::<Vec<f32>>()));
            names.push(format!("{}, albedo {albedo}", light.name_in_store));
            let of_layers = |power: f64| -> Vec<f32> {
                let each = std::iter::successors(Some(power * f64::from(albedo)), |w| Some(w * f64::from(albedo)));
                each.take(layers.len()).map(|w| (w / mean) as f32).collect()
            };
            let own: Vec<Vec<f32>> = powers.iter().map(|&power| of_layers(power)).collect();
            // Of several lights the darkest shows the most of their errors.
            luminaires = match luminaires.is_empty() {
                true => own,
                false => larger(&luminaires, &own),
            };
        }
        if job.geometry.is_none() {
            let picked = noise_picked(&job.bake(pyramid, &settings, &selection), PICKED_TEXELS, &weights)?;
            let factor = picked.clamp(LEAST_PICKED, MOST_PICKED).sqrt() as f32;
            weights.iter_mut().flatten().for_each(|weight| *weight *= factor);
        }
        let mut hash = blake3::Hasher::new();
        for weight in weights.iter().flatten() {
            hash.update(&weight.to_le_bytes());
        }
        let digits = &hash.finalize().to_hex()[..16];
        let near = if powers.is_empty() { "" } else { ", and the luminaires" };
        let of = format!("RMS of the radiance over its mean under {}{near} ({digits})", names.join("; "));
        let mut kind = Self { of, weights, luminaires, errors: ErrorHistogram::default() };
        let settings = Settings { target: Some(kind.target(f32::MAX)), ..settings };
        kind.errors = pilot(&job.bake(pyramid, &settings, &selection), MEAN_TEXELS)?.errors;
        Ok(kind)
    }

    fn target(&self, error: f32) -> Target {
        Target { weights: self.weights.clone(), luminaires: self.luminaires.clone(), error }
    }

    /// The error at which each texel may stop so that their root mean square is `error`: those that are better at the fewest
    /// paths make room for others.
    fn of_each(&self, error: f32) -> f32 {
        const QUANTILES: usize = 512;
        let fewest: Vec<f64> =
            (0..QUANTILES).map(|i| self.errors.quantile((i as f64 + 0.5) / QUANTILES as f64)).collect();
        let wanted = f64::from(error).powi(2) * QUANTILES as f64;
        let square = |stop: f64| fewest.iter().map(|e| e.min(stop).powi(2)).sum::<f64>();
        let (mut low, mut high) = (f64::from(error), f64::from(error) * MOST_ABOVE);
        if square(high) <= wanted {
            return high as f32;
        }
        for _ in 0..32 {
            let middle = 0.5 * (low + high);
            (low, high) = if square(middle) <= wanted { (middle, high) } else { (low, middle) };
        }
        low as f32
    }

    fn quality(&self, error: f32) -> Quality {
        let name = ErrorTarget { error: shortest(error), of: self.of.clone() };
        Quality { target: Some(self.target(self.of_each(error))), name: Some(name) }
    }
}

/// Weights of the transfer in the radiance of a channel under a light.
fn weights_of(layers: &Layers, light: &Coefficients, albedo: f32) -> Vec<f32> {
    let narrow: Vec<f32> = light.values().iter().map(|&v| v as f32).collect();
    radiance_weights(layers, &narrow, albedo, 1.0)
}

/// The larger of two weights each.
fn larger(a: &[Vec<f32>], b: &[Vec<f32>]) -> Vec<Vec<f32>> {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.max(*b)).collect()).collect()
}

/// How far above the error of all that of one texel may be.
const MOST_ABOVE: f64 = 3.0;

/// The decimal number that a user would write for it.
fn shortest(error: f32) -> f64 {
    error.to_string().parse().unwrap_or(f64::from(error))
}

impl Request<'_> {
    /// Where texels stop. With a time, trials decide, once: the store keeps the decision.
    pub(super) fn quality(
        &self,
        pyramid: &Pyramid,
        store: &Store,
        everything: impl FnOnce() -> Selection,
        observer: &dyn Observer,
    ) -> Result<Quality> {
        if self.goal.error.is_none() && self.goal.seconds.is_none() {
            return Ok(Quality { target: None, name: None });
        }
        let kind = Kind::new(self, pyramid)?;
        let mut error = self.goal.error;
        if let Some(seconds) = self.goal.seconds {
            let allowed = self.allocate(&kind, pyramid, store, everything, seconds, observer)?;
            error = Some(error.map_or(allowed, |error| error.max(allowed)));
        }
        Ok(kind.quality(error.unwrap_or(LARGEST_ERROR as f32)))
    }

    /// The error that a time allows, as the store recorded it or from trials.
    fn allocate(
        &self,
        kind: &Kind,
        pyramid: &Pyramid,
        store: &Store,
        everything: impl FnOnce() -> Selection,
        seconds: f64,
        observer: &dyn Observer,
    ) -> Result<f32> {
        let isovalues = self.isovalues.as_ref().map_or(json!("all"), |list| json!(list));
        let asked = json!({
            "seconds": seconds, "rays": self.settings.rays, "isovalues": isovalues, "error_of": kind.of,
        });
        if let Some(record) = store.record("allocation")?
            && record["asked"] == asked
            && let Some(error) = record["error"].as_f64()
        {
            observer.note(&format!("goes on with the standard error {error} that the first run allowed"));
            return Ok(error as f32);
        }
        let selection = everything();
        let error = self.search(kind, pyramid, &selection, seconds, observer)?;
        let record = json!({ "asked": asked, "error": shortest(error) });
        store.write_record("allocation", &record)?;
        observer.note(&format!(
            "{} s allow a standard error of {error} (RMS of the radiance, over its mean); the same store comes from \
             --error {error} --rays {}",
            seconds, self.settings.rays
        ));
        Ok(error)
    }

    /// Bakes a few bricks at growing numbers until the time that the whole would take is the time that is left.
    fn search(
        &self,
        kind: &Kind,
        pyramid: &Pyramid,
        selection: &Selection,
        seconds: f64,
        observer: &dyn Observer,
    ) -> Result<f32> {
        let bricks = selection.bricks();
        let all = selection.len() as f64;
        let total = all * self.share_traced(pyramid, selection)?;
        let measure = |error: f64, count: usize| -> Result<f64> {
            let picked: Vec<[usize; 3]> = spread(&bricks, count);
            let target = kind.target(kind.of_each(error as f32));
            let settings = Settings { target: Some(target), ..self.settings.clone() };
            let before = observer.seconds();
            let texels = trial(&self.bake(pyramid, &settings, selection), &picked)?.texels;
            Ok((observer.seconds() - before) / texels.max(1) as f64)
        };
        if bricks.is_empty() {
            return Ok(LARGEST_ERROR as f32);
        }
        // The cheapest first: what does not fit at all is found out soon.
        let (mut error, mut count) = (LARGEST_ERROR, 8);
        // Error and time per texel of the trials so far.
        let mut seen: Vec<(f64, f64)> = Vec::new();
        for _ in 0..TRIALS {
            let per_texel = measure(error, count)?;
            seen.push((error, per_texel));
            let left = self.time_share * (seconds * (1.0 - RESERVE) - observer.seconds()).max(1e-3);
            let allowed = left / total;
            let next = next_error(&seen, allowed);
            if per_texel > allowed && error >= LARGEST_ERROR {
                return Err(Error::Limit {
                    what: "the least that makes sense, 32 rays a texel,".into(),
                    needed: format!("about {:.0} s", (per_texel * total / (1.0 - RESERVE)).ceil()),
                    limit: format!("{seconds} s"),
                    remedy: "give more time, a coarser texture, or fewer isovalues".into(),
                });
            }
            error = next;
            let texels = TRIAL * seconds / allowed.max(per_texel);
            count = ((texels / all * bricks.len() as f64).min(1e9) as usize).max(8);
        }
        Ok(two_digits(error))
    }

    /// The claims that a bake of `quality` makes, one for each isosurface.
    pub(super) fn claims(&self, name: &Option<ErrorTarget>) -> Vec<Baked> {
        let claim = |isovalue| Baked { isovalue, rays: self.settings.rays, target: name.clone() };
        match &self.isovalues {
            None => vec![claim(None)],
            Some(list) => {
                let mut list = list.clone();
                list.sort_by(f64::total_cmp);
                list.dedup();
                list.into_iter().map(|c| claim(Some(c))).collect()
            }
        }
    }
}

/// The error whose time per texel is `allowed`, by the power law through the last two trials (N ~ error^-4/3 after
/// one, the law of the estimator's stopping rule), at most a factor of 8 away.
fn next_error(seen: &[(f64, f64)], allowed: f64) -> f64 {
    const LAW: f64 = -0.75;
    let (error, time) = seen[seen.len() - 1];
    let slope = match seen {
        [.., (e0, t0), (e1, t1)] if libm::log(e1 / e0).abs() > 0.05 => {
            // d ln error / d ln time: steep near the least that a texel gets, where time hardly falls any more.
            let slope = libm::log(e1 / e0) / libm::log(t1 / t0);
            if slope.is_finite() { slope.clamp(-4.0, -0.4) } else { LAW }
        }
        _ => LAW,
    };
    let factor = libm::pow(allowed / time, slope).clamp(0.125, 8.0);
    (error * factor).clamp(SMALLEST_ERROR, LARGEST_ERROR)
}

/// Rounded up to two digits: what a user would type.
fn two_digits(error: f64) -> f32 {
    let scale = 10f64.powi(1 - libm::log10(error).floor() as i32);
    ((error * scale).ceil() / scale).to_string().parse().unwrap_or(error as f32)
}

/// `count` bricks at equal steps.
pub fn spread(bricks: &[[usize; 3]], count: usize) -> Vec<[usize; 3]> {
    let count = count.min(bricks.len());
    (0..count).map(|i| bricks[(2 * i + 1) * bricks.len() / (2 * count)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_finds_the_error_of_a_power_law_with_a_floor() {
        // Time per texel: 16 paths at least, then error^-4/3.
        let time = |error: f64| 1e-6 * (32.0 + 0.02 * error.powf(-4.0 / 3.0));
        for allowed in [4e-5, 1e-4, 1e-3] {
            let mut error = LARGEST_ERROR;
            let mut seen = Vec::new();
            for _ in 0..TRIALS {
                seen.push((error, time(error)));
                error = next_error(&seen, allowed);
            }
            let (error, reached) = (two_digits(error), time(f64::from(two_digits(error))));
            assert!((reached / allowed).ln().abs() < 0.2, "{allowed}: {error} takes {reached}");
        }
    }

    #[test]
    fn errors_are_rounded_up_to_what_one_would_type() {
        assert_eq!(two_digits(0.01234), 0.013);
        assert_eq!(two_digits(0.5), 0.5);
        assert_eq!(two_digits(0.000999), 0.001);
        assert_eq!(shortest(0.013), 0.013);
    }
}
