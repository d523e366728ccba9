//! The plan: which effects a scene calls for, decided before the bake, each with its reason and, where
//! something is dropped, a bound or an estimate of the error.
//!
//! The plan does not trace rays itself. What it must measure, a pilot of the transport measures for it
//! ([`Pilot`]).

use serde::Serialize;

/// What a small trial bake found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Pilot {
    /// Texels tried.
    pub texels: u64,
    /// Texels of these with a level set.
    pub valid: u64,
    /// Paths traced.
    pub paths: u64,
    /// Rays traced, one for each bounce of a path.
    pub rays: u64,
    /// Mean chance to escape after exactly k bounces.
    pub escapes: Vec<f64>,
    /// Share of the paths lost in the solid.
    pub lost_share: f64,
}

impl Pilot {
    /// Mean chance to survive `k` hits.
    pub fn survival(&self, k: usize) -> f64 {
        (1.0 - self.escapes.iter().take(k).sum::<f64>()).max(0.0)
    }
}

/// What the plan is made from.
#[derive(Clone, Debug)]
pub struct PlanInput<'a> {
    /// Texels of the texture.
    pub texels: u64,
    /// Texels that the asked isovalues need (all, if none was asked).
    pub selected: u64,
    /// Whether isovalues were asked for.
    pub isovalues: Option<&'a [f64]>,
    /// Paths per texel.
    pub rays: u32,
    /// Bands of each layer asked for.
    pub bands: &'a [usize],
    /// Largest albedo of any channel and isovalue; `None` = not chosen, take 0.7.
    pub albedo: Option<f32>,
    /// Whether any isovalue emits.
    pub emits: bool,
    /// Accepted error of the radiance relative to the brightest light, 0.01 = 1 %.
    pub tolerance: f64,
    /// Bytes of one texel in the store.
    pub bytes_per_texel: u64,
    /// What the trial found.
    pub pilot: &'a Pilot,
}

/// One row of the plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effect {
    /// Name: shadowing, interreflection, emission, bands, texels.
    pub name: &'static str,
    /// Whether it is simulated.
    pub on: bool,
    /// What is done, in short.
    pub setting: String,
    /// Why.
    pub reason: String,
    /// Error of what is dropped, relative to the brightest light; `None` where nothing is dropped.
    pub error: Option<f64>,
    /// Whether the error is an estimate from the pilot rather than a bound.
    pub estimated: bool,
    /// Share of the rays it costs.
    pub cost_share: f64,
}

/// The plan of a bake.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// The effects, in a fixed order.
    pub effects: Vec<Effect>,
    /// Layers that meet the tolerance, of those asked for.
    pub layers_needed: usize,
    /// Rays predicted.
    pub rays: f64,
    /// Valid texels predicted.
    pub valid_texels: f64,
    /// Bytes of the store predicted, before bricks that hold nothing are left out.
    pub bytes: f64,
}

/// Makes the plan.
pub fn plan(input: &PlanInput<'_>) -> Plan {
    let pilot = input.pilot;
    let layers = input.bands.len();
    let albedo = f64::from(input.albedo.unwrap_or(0.7));
    let valid_share = pilot.valid as f64 / pilot.texels.max(1) as f64;
    let valid_texels = input.selected as f64 * valid_share;
    let rays_per_path = pilot.rays as f64 / pilot.paths.max(1) as f64;
    // Rays of bounce k ∝ S_k; the first rays are the shadowing.
    let weights: Vec<f64> = (0..layers).map(|k| pilot.survival(k)).collect();
    let all: f64 = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);

    // Radiance that layers beyond the k-th can still add: ρ^(k+2) S_(k+1) max L.
    let remainder = |k: usize| albedo.powi(k as i32 + 2) * pilot.survival(k + 1);
    let needed = (0..layers).find(|&k| remainder(k) <= input.tolerance).map_or(layers, |k| k + 1);
    let dropped = remainder(layers - 1);

    let openness = pilot.escapes.first().copied().unwrap_or(1.0);
    let shadowing = Effect {
        name: "shadowing",
        on: true,
        setting: format!("{} paths a texel", input.rays),
        reason: if openness < 1.0 {
            format!(
                "mean openness {:.3} in {} pilot texels: {:.1} % of first rays are blocked",
                openness,
                pilot.valid,
                100.0 * (1.0 - openness)
            )
        } else {
            format!(
                "no first ray was blocked in {} pilot texels, which proves nothing; a share below {:.2e} may be",
                pilot.valid,
                3.0 / (pilot.rays.max(1) as f64)
            )
        },
        error: None,
        estimated: true,
        cost_share: weights[0] / all,
    };
    let bounces = Effect {
        name: "interreflection",
        on: layers > 1 && albedo > 0.0,
        setting: format!("{layers} layers, {} bounces", layers - 1),
        reason: if albedo == 0.0 {
            "albedo 0: nothing is reflected twice".into()
        } else {
            format!(
                "albedo {albedo:.2}: what layer {} leaves out is {:.2} % of the brightest light, tolerance {:.2} %; {needed} of {layers} layers meet it",
                layers - 1,
                100.0 * dropped,
                100.0 * input.tolerance
            )
        },
        error: Some(dropped),
        estimated: true,
        cost_share: 1.0 - weights[0] / all,
    };
    let emission = Effect {
        name: "emission",
        on: input.emits,
        setting: "from the stored chances to escape".into(),
        reason: if input.emits { "some isovalue emits".into() } else { "no isovalue emits".into() },
        error: None,
        estimated: false,
        cost_share: 0.0,
    };
    let bands = Effect {
        name: "bands",
        on: true,
        setting: format!(
            "{:?} bands a layer, {} coefficients",
            input.bands,
            input.bands.iter().map(|b| b * b).sum::<usize>()
        ),
        reason: "the environment is chosen at relight, which stops at the highest band that carries energy".into(),
        error: None,
        estimated: false,
        cost_share: 0.0,
    };
    let texels = Effect {
        name: "texels",
        on: true,
        setting: format!("{} of {}", input.selected, input.texels),
        reason: match input.isovalues {
            Some(list) => format!(
                "{} isovalue(s) asked; {:.1} % of the texels are looked up",
                list.len(),
                100.0 * input.selected as f64 / input.texels.max(1) as f64
            ),
            None => format!(
                "all isovalues; about {:.1} % of the texels have a level set with a normal",
                100.0 * valid_share
            ),
        },
        error: None,
        estimated: true,
        cost_share: 0.0,
    };
    Plan {
        effects: vec![shadowing, bounces, emission, bands, texels],
        layers_needed: needed,
        rays: valid_texels * f64::from(input.rays) * rays_per_path,
        valid_texels,
        bytes: input.selected as f64 * input.bytes_per_texel as f64,
    }
}
