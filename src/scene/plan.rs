//! The plan: which effects a scene calls for, decided before the bake, each with its reason and, where
//! something is dropped, a bound or an estimate of the error.
//!
//! The plan does not trace rays itself. What it must measure, a pilot of the transport measures for it
//! ([`Pilot`]).

use super::{Effects, MOST_SUNS, SUN_TOLERANCE, SunSplit};
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
    /// Valid texels of which it is declared or proven that nothing blocks their rays.
    pub open: u64,
}

impl Pilot {
    /// Mean chance to survive `k` hits.
    pub fn survival(&self, k: usize) -> f64 {
        (1.0 - self.escapes.iter().take(k).sum::<f64>()).max(0.0)
    }
}

/// What stands around the volume, and what a trial says of its share of the work. The pilot's `escapes` are then
/// differences of the chance to meet the level set again, so that its survival is that chance.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Surrounded {
    /// Triangles, rectangles and spheres of all walls.
    pub parts: u64,
    /// Names of the luminaires.
    pub luminaires: Vec<String>,
    /// Whether a wall is a mirror or glass.
    pub specular: bool,
    /// Why lamps of environments stay in these, if so.
    pub keeps_lamps: Option<&'static str>,
    /// Luminaires whose light through mirrors and glass would need photons.
    pub needs_photons: Vec<String>,
    /// Rays of paths, all of them.
    pub path_rays: u64,
    /// Those that start at walls.
    pub wall_rays: u64,
    /// Rays to luminaires.
    pub light_rays: u64,
    /// Names of other volumes whose level sets are met, and what couples their isovalues.
    pub partners: Vec<String>,
    /// Empty where there are none.
    pub coupling: String,
    /// What lies between surfaces.
    pub media: Vec<MediumForecast>,
    /// The solid, where light passes through it.
    pub body: Option<BodyForecast>,
    /// Meetings of the trial's paths with media.
    pub collisions: u64,
    /// Rays that came into their boxes, besides those above.
    pub partner_rays: u64,
    /// Paths' meetings with their level sets.
    pub partner_hits: u64,
    /// Mean chance of a path to reach the environment within the layers.
    pub escape: f64,
}

/// A medium of a plan.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MediumForecast {
    /// Its name.
    pub name: String,
    /// A bound of the optical depth of any free segment.
    pub depth_bound: f64,
}

/// A translucent solid of a plan.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BodyForecast {
    /// Its index of refraction.
    pub index: f64,
    /// A bound of the optical depth through it: the diagonal of the box times the largest extinction.
    pub depth: f64,
    /// Albedos at which transfer is stored; 0 where it is fixed.
    pub nodes: usize,
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
    /// Largest emission of any channel and isovalue; `None` = not chosen.
    pub emission: Option<f32>,
    /// Whether the volume's solids are declared convex.
    pub convex: bool,
    /// What was switched by hand.
    pub effects: &'a Effects,
    /// Which lamps of the environment are to be lit apart.
    pub sun_split: SunSplit,
    /// Accepted error of the radiance relative to the brightest light, 0.01 = 1 %.
    pub tolerance: f64,
    /// Bytes of one texel in the store.
    pub bytes_per_texel: u64,
    /// Share of the selected texels that are traced.
    pub traced_share: f64,
    /// What the trial found.
    pub pilot: &'a Pilot,
    /// What stands around the volume; `None` for a volume alone.
    pub surroundings: Option<&'a Surrounded>,
}

/// One row of the plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effect {
    /// One of [`EFFECTS`](super::EFFECTS).
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
    /// Share of the texels that an adaptive texture is predicted to trace; the others are interpolated.
    pub traced_share: f64,
    /// Bytes of the store predicted, before bricks that hold nothing are left out.
    pub bytes: f64,
}

impl Plan {
    /// What an adaptive texture is predicted to leave out, in words; nothing of other textures.
    #[doc(hidden)]
    pub fn left_out(&self) -> String {
        match self.traced_share {
            share if share < 1.0 => format!(" ({:.1} % of the texture, the rest is interpolated)", 100.0 * share),
            _ => String::new(),
        }
    }
}

/// Makes the plan.
pub fn plan(input: &PlanInput<'_>) -> Plan {
    let pilot = input.pilot;
    let layers = input.bands.len();
    let albedo = f64::from(input.albedo.unwrap_or(DEFAULT_ALBEDO));
    let valid_share = pilot.valid as f64 / pilot.texels.max(1) as f64;
    let valid_texels = input.selected as f64 * input.traced_share * valid_share;
    let ignored = input.effects.switched("shadowing") == Some(false);
    let rays_per_texel = if ignored {
        0.0
    } else {
        pilot.rays as f64 / pilot.paths.max(1) as f64 * f64::from(input.rays) * (1.0 - open_share(pilot))
    };
    let rays_per_texel = match input.surroundings {
        Some(s) => {
            (s.path_rays + s.light_rays + s.partner_rays) as f64 / pilot.paths.max(1) as f64 * f64::from(input.rays)
        }
        None => rays_per_texel,
    };
    let needed = (0..layers).find(|&k| remainder(pilot, albedo, k) <= input.tolerance).map_or(layers, |k| k + 1);
    Plan {
        effects: vec![
            shadowing(input, albedo, ignored),
            interreflection(input, albedo, needed, ignored),
            colour_channels(input),
            emission(input),
            walls(input),
            coupling(input),
            luminaires(input),
            caustics(input),
            media(input, albedo),
            bands(input),
            sun_split(input),
            texels(input, valid_share),
        ],
        layers_needed: needed,
        rays: valid_texels * rays_per_texel,
        valid_texels,
        traced_share: input.traced_share,
        bytes: input.selected as f64 * input.traced_share * input.bytes_per_texel as f64,
    }
}

/// Albedo where none was chosen, that of relighting.
const DEFAULT_ALBEDO: f32 = 0.7;

/// Radiance that layers beyond the k-th can still add, over the brightest light: ρ^(k+2) S_(k+1).
fn remainder(pilot: &Pilot, albedo: f64, k: usize) -> f64 {
    albedo.powi(k as i32 + 2) * pilot.survival(k + 1)
}

fn open_share(pilot: &Pilot) -> f64 {
    pilot.open as f64 / pilot.valid.max(1) as f64
}

/// Share of the rays that are first rays. Rays of bounce k ∝ S_k.
fn first_ray_share(input: &PlanInput<'_>) -> f64 {
    if let Some(s) = input.surroundings {
        return share(input.pilot.paths, s);
    }
    let all: f64 = (0..input.bands.len()).map(|k| input.pilot.survival(k)).sum();
    if input.pilot.rays == 0 { 0.0 } else { 1.0 / all.max(1.0) }
}

/// An effect that a scene of this kind cannot have.
fn absent(name: &'static str, setting: &str, reason: &str) -> Effect {
    Effect {
        name,
        on: false,
        setting: setting.into(),
        reason: reason.into(),
        error: None,
        estimated: false,
        cost_share: 0.0,
    }
}

fn shadowing(input: &PlanInput<'_>, albedo: f64, ignored: bool) -> Effect {
    let pilot = input.pilot;
    let blocked = pilot.survival(1);
    let open = open_share(pilot);
    let traced = format!("{} paths a texel", input.rays);
    let always = input.effects.switched("shadowing") == Some(true);
    let mut row = Effect {
        on: !ignored,
        setting: traced.clone(),
        estimated: true,
        cost_share: first_ray_share(input),
        ..absent("shadowing", "", "")
    };
    if ignored {
        row.setting = "clamped cosine, no rays".into();
        row.reason = format!(
            "switched off; {:.1} % of the first rays of {} pilot texels are blocked, which is ignored, and with it all \
             interreflection",
            100.0 * blocked,
            pilot.valid
        );
        (row.error, row.cost_share) = (Some(albedo * blocked), 0.0);
    } else if input.convex && !always {
        row.on = false;
        row.setting = "clamped cosine, no rays".into();
        row.reason = "the solids are declared convex: nothing shades".into();
        (row.error, row.estimated) = (Some(0.0), false);
    } else if pilot.valid > 0 && pilot.open == pilot.valid {
        row.on = false;
        row.setting = format!("clamped cosine where proven, else {traced}");
        row.reason =
            format!("proven for all {} pilot texels: nothing of their level sets stands above them", pilot.valid);
    } else if blocked > 0.0 {
        row.reason = format!(
            "mean openness {:.3} in {} pilot texels: {:.1} % of first rays are blocked; {}",
            1.0 - blocked,
            pilot.valid,
            100.0 * blocked,
            if always {
                "proofs are switched off".into()
            } else if input.surroundings.is_some() {
                "among walls and other volumes every texel is traced".into()
            } else {
                format!("{:.1} % are proven open", 100.0 * open)
            }
        );
    } else {
        row.reason = format!(
            "no first ray was blocked in {} pilot texels, which proves nothing; a share below {:.2e} may be",
            pilot.valid,
            3.0 / (pilot.rays.max(1) as f64)
        );
    }
    row
}

fn interreflection(input: &PlanInput<'_>, albedo: f64, needed: usize, ignored: bool) -> Effect {
    let layers = input.bands.len();
    let dropped = remainder(input.pilot, albedo, layers - 1);
    let percent = |share: f64| 100.0 * share;
    let mut row = Effect {
        on: layers > 1 && albedo > 0.0,
        setting: format!("{layers} layers, {} bounces", layers - 1),
        error: Some(dropped),
        estimated: true,
        cost_share: match input.surroundings {
            Some(s) => share(s.path_rays.saturating_sub(s.wall_rays + input.pilot.paths), s),
            None if input.pilot.rays == 0 => 0.0,
            None => 1.0 - first_ray_share(input),
        },
        ..absent("interreflection", "", "")
    };
    row.reason = if albedo == 0.0 {
        "albedo 0: nothing is reflected twice".into()
    } else if ignored
        || input.pilot.valid > 0 && input.pilot.survival(1) <= 0.0 && input.pilot.open == input.pilot.valid
    {
        (row.on, row.cost_share) = (false, 0.0);
        (row.error, row.setting) =
            (if ignored { Some(remainder(input.pilot, albedo, 0)) } else { Some(0.0) }, "none".into());
        if ignored { "no ray meets anything: shadowing is switched off" } else { "no ray meets anything" }.into()
    } else if input.effects.switched("interreflection") == Some(false) {
        format!("switched off; direct light alone leaves out {:.2} % of the brightest light", percent(dropped))
    } else {
        format!(
            "albedo {albedo:.2}: what layer {} leaves out is {:.2} % of the brightest light, tolerance {:.2} %; {needed} of {layers} layers {}",
            layers - 1,
            percent(dropped),
            percent(input.tolerance),
            if dropped <= input.tolerance { "meet it" } else { "do not meet it" },
        )
    };
    row
}

fn colour_channels(input: &PlanInput<'_>) -> Effect {
    if input.surroundings.is_none() {
        let reason = "no wall or luminaire has a colour: one grey transfer serves every albedo exactly";
        return absent("colour-channels", "grey layers", reason);
    }
    let reason = "walls, luminaires and other volumes may have colours of their own; the albedo of the level set stays free \
        for relighting";
    Effect { on: true, ..absent("colour-channels", "red, green and blue layers", reason) }
}

/// What was switched off, as the reason of a row.
fn switched_off(name: &'static str, setting: &str, reason: &str) -> Effect {
    absent(name, setting, &format!("switched off: {reason}"))
}

fn walls(input: &PlanInput<'_>) -> Effect {
    if input.effects.switched("walls") == Some(false) {
        return switched_off(
            "walls",
            "no rays",
            "walls and objects of the scene are left out as if they were not there",
        );
    }
    match input.surroundings.filter(|s| s.parts > 0) {
        None => absent("walls", "no rays", "the scene has no geometry besides the volume"),
        Some(s) => Effect {
            on: true,
            estimated: true,
            cost_share: share(s.wall_rays, s),
            ..absent(
                "walls",
                &format!("{} parts, any number of reflections", s.parts),
                &format!("the scene has them; {:.1} % of the paths reach the environment", 100.0 * s.escape),
            )
        },
    }
}

fn coupling(input: &PlanInput<'_>) -> Effect {
    match input.surroundings.filter(|s| !s.partners.is_empty()) {
        None => absent("coupling", "no rays", "the scene has no other volume"),
        Some(s) => Effect {
            on: true,
            estimated: true,
            cost_share: share(s.partner_rays, s),
            ..absent(
                "coupling",
                &s.coupling,
                &format!(
                    "lit and shaded together with {}; {:.1} % of the rays meet them",
                    s.partners.join(", "),
                    100.0 * s.partner_hits as f64 / s.path_rays.max(1) as f64
                ),
            )
        },
    }
}

fn luminaires(input: &PlanInput<'_>) -> Effect {
    if input.effects.switched("luminaires") == Some(false) {
        return switched_off("luminaires", "distant light alone", "luminaires and walls that shine are dark");
    }
    match input.surroundings.filter(|s| !s.luminaires.is_empty()) {
        None => absent("luminaires", "distant light alone", "the scene has no light besides its distant environment"),
        Some(s) => Effect {
            on: true,
            estimated: true,
            cost_share: share(s.light_rays, s),
            ..absent(
                "luminaires",
                &format!("{}: one texture each, one ray each at every turn", s.luminaires.join(", ")),
                "their power is chosen at relight (--luminaire NAME=FACTOR) without rays",
            )
        },
    }
}

fn caustics(input: &PlanInput<'_>) -> Effect {
    let Some(s) = input.surroundings.filter(|s| s.specular) else {
        return absent("caustics", "no photons", "no part of the scene is mirror or glass, so nothing focuses light");
    };
    if input.effects.switched("caustics") == Some(false) {
        let reason = "light of luminaires that mirrors and glass send to diffuse surfaces is left out";
        return switched_off("caustics", "no photons", reason);
    }
    let how = if s.needs_photons.is_empty() { "by paths, no photons" } else { "by paths and photons" };
    let reason = if s.needs_photons.is_empty() {
        "mirrors or glass and diffuse surfaces see each other; luminaires with an area are met by the paths, with more noise, \
         others found by their images in up to 3 flat mirrors in a row"
            .into()
    } else {
        format!(
            "no path finds {} by way of glass, curved mirrors or more than six flat ones: photons bring that light, of which the stated \
             errors hold the noise, not the blur at its edges",
            s.needs_photons.join(", ")
        )
    };
    Effect { on: true, ..absent("caustics", how, &reason) }
}

/// What it would cost to leave media out, and parts of what they do.
///
/// A path with and one without the media share all numbers until the first collision, which comes on a segment with a chance of
/// at most p = 1 − e^(−t), where t bounds the depth of any free segment. It comes behind hit k, which the path survives with a
/// chance S_k ≤ 1, at a weight of ρ^(k+1); afterwards both values lie between 0 and the brightest light. So the media as a whole are
/// worth at most p A with A = Σ ρ^(k+1) = ρ/(1 − ρ), what they scatter a p A, and of orders above N no more than
/// p A a (a q)^N with q = min(1, p/(1 − ρ)): between two collisions a path may be reflected any number of times.
fn media(input: &PlanInput<'_>, albedo: f64) -> Effect {
    if input.effects.switched("media") == Some(false) {
        return switched_off("media", "transmittance 1", "what absorbs and scatters between surfaces is left out");
    }
    if let Some((s, body)) = input.surroundings.and_then(|s| Some((s, s.body.as_ref()?))) {
        let collisions = s.collisions as f64 / input.pilot.paths.max(1) as f64;
        let nodes = match body.nodes {
            0 => "the albedo of its medium is fixed".to_string(),
            n => format!("the albedo of its medium is free at relight, by {} nodes and one that checks them", n - 1),
        };
        let reason = format!(
            "light passes through the solid, index {}: optical depth up to {:.2}, {collisions:.2} collisions a path in the trial; {nodes}; \
             what leaves is averaged over its directions, which of a half-space is 5 to 21 % more than straight on",
            body.index, body.depth
        );
        let setting = "free flights by exact optical depth, Fresnel at the boundary; all orders of scattering";
        return Effect { on: true, estimated: true, ..absent("media", setting, &reason) };
    }
    let Some(s) = input.surroundings.filter(|s| !s.media.is_empty()) else {
        return absent("media", "transmittance 1", "the scene has no medium that absorbs or scatters");
    };
    let depth: f64 = s.media.iter().map(|m| m.depth_bound).sum();
    let chance = -libm::expm1(-depth);
    let worth = (chance * albedo / (1.0 - albedo).max(f64::MIN_POSITIVE)).min(1.0);
    let names: Vec<&str> = s.media.iter().map(|m| m.name.as_str()).collect();
    let collisions = s.collisions as f64 / input.pilot.paths.max(1) as f64;
    let orders = |n: i32| 100.0 * (worth * (chance / (1.0 - albedo).max(f64::MIN_POSITIVE)).min(1.0).powi(n)).min(1.0);
    let reason = format!(
        "{}: optical depth up to {depth:.3} on a free segment, {collisions:.2} collisions a path in the trial; without it the \
         radiance could be off by up to {:.2} % of the brightest light, and as much without its scattering or with another phase \
         function at a medium's albedo of 1; without orders above 1, 2 and 4 up to {:.2}, {:.2} and {:.2} %",
        names.join(", "),
        100.0 * worth,
        orders(1),
        orders(2),
        orders(4),
    );
    let setting = "free flights by exact optical depth; all orders of scattering";
    Effect { on: true, estimated: true, ..absent("media", setting, &reason) }
}

fn share(rays: u64, s: &Surrounded) -> f64 {
    rays as f64 / (s.path_rays + s.light_rays + s.partner_rays).max(1) as f64
}

fn emission(input: &PlanInput<'_>) -> Effect {
    let emits = input.emission.is_some_and(|e| e > 0.0);
    let off = input.effects.switched("emission") == Some(false);
    let mut row = absent("emission", "from the stored chances to escape, no rays", "");
    row.on = emits && !off;
    row.reason = match input.emission {
        Some(e) if emits && off => {
            row.error = Some(f64::from(e));
            format!("switched off; radiance {e} of its own and what it lights are left out")
        }
        Some(e) if emits => format!("some isovalue emits, at most {e}"),
        Some(_) => "no isovalue emits".into(),
        None => "chosen at relight".into(),
    };
    row
}

fn bands(input: &PlanInput<'_>) -> Effect {
    let coefficients = input.bands.iter().map(|b| b * b).sum::<usize>();
    let setting = format!("{:?} bands a layer, {coefficients} coefficients", input.bands);
    let reason = match input.surroundings {
        Some(s) if s.escape == 0.0 => "no path of the trial reached the environment: --bands 1 saves space",
        _ => "the environment is chosen at relight, which stops at the highest band that carries energy",
    };
    Effect { on: true, ..absent("bands", &setting, reason) }
}

fn sun_split(input: &PlanInput<'_>) -> Effect {
    let split = match input.effects.switched("sun-split") {
        Some(false) => SunSplit::Off,
        Some(true) if input.sun_split == SunSplit::Off => SunSplit::Auto,
        _ => input.sun_split,
    };
    let keeps = input.surroundings.and_then(|s| s.keeps_lamps);
    let tolerance = 100.0 * SUN_TOLERANCE;
    let (on, reason) = match split {
        _ if keeps.is_some() => {
            (false, format!("lamps stay in the environment of a scene with {}", keeps.unwrap_or_default()))
        }
        SunSplit::Off => (false, "not asked for: a small sun rings in the bands that are stored".into()),
        SunSplit::Auto => {
            let text = format!(
                "at relight, of each environment of which the bands lose more than {tolerance} % of the radiance beside a \
                 shadow: its lamps, at most {MOST_SUNS}, until they lose less; by rays and paths, none in the bake"
            );
            (true, text)
        }
        SunSplit::Lobes(count) => (true, format!("the {count} strongest lamps, at relight, by rays and paths")),
    };
    Effect { on, ..absent("sun-split", "no rays in the bake", &reason) }
}

fn texels(input: &PlanInput<'_>, valid_share: f64) -> Effect {
    let setting = format!("{} of {}", input.selected, input.texels);
    let reason = match input.isovalues {
        Some(list) => format!(
            "{} isovalue(s) asked; {:.1} % of the texels are looked up",
            list.len(),
            100.0 * input.selected as f64 / input.texels.max(1) as f64
        ),
        None => {
            format!("all isovalues; about {:.1} % of the texels have a level set with a normal", 100.0 * valid_share)
        }
    };
    Effect { on: true, estimated: true, ..absent("texels", &setting, &reason) }
}
