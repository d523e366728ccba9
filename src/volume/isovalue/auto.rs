//! The program's choice of an isovalue, by the kind of data that the samples look like.
//!
//! Everything is decided so that the negative of a volume gives the same surface: rules that look to one side are
//! tried on h and on −h.

use super::super::{Sample, Solid, Volume, with_samples};
use super::statistics::{Statistics, solid_of_border};
use super::{Alternative, BONE, Chosen, Isovalue, Level, SKIN, number};

/// Most values of a label field.
const MOST_LABELS: usize = 32;
/// Share of the sum of squares that lobes enclose.
const LOBES: f64 = 0.8;
/// Standard deviations of the noise above which signal begins: a normal distribution has 0.02 % there.
const NOISE: f64 = 3.5;
/// Share of the border that is solid from which on the other side is what is meant, and above which a user is told.
const OPEN: f64 = 0.8;

/// What the samples look like, with h turned so that `sign`·h is what the rule is written for.
struct Found {
    /// On `sign`·h, scaled; the first is the main one.
    levels: Vec<f64>,
    sign: f64,
    /// Whether the rule knows that what is above its level, on `sign`·h, is matter.
    knows_side: bool,
    reason: String,
}

/// Chooses. `side`: what the user gave; `None` leaves it to the choice.
pub(super) fn choose(volume: &Volume, side: Option<Solid>) -> Chosen {
    let plain = Statistics::new(volume);
    let negated = plain.negated();
    let of = |sign: f64| if sign > 0.0 { &plain } else { &negated };
    let try_both =
        |rule: &dyn Fn(&Statistics, f64) -> Option<Found>| rule(&plain, 1.0).or_else(|| rule(&negated, -1.0));
    if let Some(chosen) = lobes(&plain, side) {
        return finish(volume, &plain, chosen, side);
    }
    let found = labels(volume, &plain)
        .or_else(|| try_both(&hounsfield))
        .or_else(|| signal_in_noise(&plain, &negated))
        .or_else(|| map_about_zero(of(leading(&plain)), leading(&plain)))
        .unwrap_or_else(|| {
            // Turned so that the border is dark.
            let sign = if plain.border_mean <= plain.mean { 1.0 } else { -1.0 };
            split(of(sign), sign)
        });
    let chosen = level_of(volume, &plain, &found, side);
    finish(volume, &plain, chosen, side)
}

/// From a rule's finding to levels in the file's values, with the side that is matter.
fn level_of(volume: &Volume, statistics: &Statistics, found: &Found, side: Option<Solid>) -> Chosen {
    let (low, high) = volume.value_range();
    let value = |level: f64| {
        let rounded = round(level, statistics.high - statistics.low) * found.sign;
        (rounded / statistics.scale).clamp(low, high)
    };
    let by_rule = if found.sign > 0.0 { Solid::Above } else { Solid::Below };
    let mut reason = found.reason.clone();
    let first = value(found.levels.first().copied().unwrap_or(0.0));
    let solid = match side {
        Some(side) => side,
        None if found.knows_side => by_rule,
        None => {
            let (inside, border) = solid_of_border(volume, first, Solid::Above);
            let share = inside as f64 / border.max(1) as f64;
            if (1.0 - OPEN..=OPEN).contains(&share) {
                // The negative volume has the other part of the border: nothing tells which side is meant.
                reason += &format!("; {:.0} % of the border is above it: --solid below is as likely", 100.0 * share);
            }
            if share > OPEN { Solid::Below } else { Solid::Above }
        }
    };
    if side.is_none() && solid == Solid::Below {
        reason += if found.knows_side { "; matter is below it" } else { "; matter is below it: the border lies above" };
    }
    let more = found.levels.iter().skip(1).map(|level| Level { value: value(*level), solid }).collect();
    Chosen { value: first, solid, reason: Some(reason), more, alternatives: Vec::new(), warning: None }
}

/// Adds the alternatives, and takes one of them where the choice shows nothing.
fn finish(volume: &Volume, statistics: &Statistics, mut chosen: Chosen, side: Option<Solid>) -> Chosen {
    chosen.alternatives = alternatives(volume, statistics, &chosen);
    let shows_nothing = |level: Level| warning(volume, level).is_some() || !super::crosses(volume, level);
    if shows_nothing(Level { value: chosen.value, solid: chosen.solid }) {
        // A side that was given is meant, even where it is open all round.
        let is_meant = side.is_some() && super::crosses(volume, Level { value: chosen.value, solid: chosen.solid });
        let better = chosen.alternatives.iter().find(|a| !is_meant && !shows_nothing(a.level));
        if let Some(Alternative { name, level }) = better {
            let reason = format!("{name}: {} shows no closed surface", number(chosen.value));
            chosen =
                Chosen { value: level.value, solid: level.solid, reason: Some(reason), more: Vec::new(), ..chosen };
        }
    }
    if chosen.more.iter().any(|level| level.solid == chosen.solid) {
        chosen.alternatives.clear(); // labels are no measure
    }
    chosen.warning = warning(volume, Level { value: chosen.value, solid: chosen.solid });
    chosen
}

/// What a user should know of a surface before looking at it.
pub(super) fn warning(volume: &Volume, level: Level) -> Option<String> {
    let (inside, border) = solid_of_border(volume, level.value, level.solid);
    let share = inside as f64 / border.max(1) as f64;
    let (side, other) = match level.solid {
        Solid::Above => ("above", "below"),
        Solid::Below => ("below", "above"),
    };
    (share > OPEN).then(|| {
        format!(
            "the solid {side} {} reaches {:.0} % of the border of the box: the picture shows cut faces; \
             --solid {other} shows the other side",
            number(level.value),
            100.0 * share
        )
    })
}

/// Other isovalues, as they can be given.
fn alternatives(volume: &Volume, statistics: &Statistics, chosen: &Chosen) -> Vec<Alternative> {
    let is_hounsfield = hounsfield(statistics, 1.0).is_some();
    let is_signed = statistics.low < 0.0 && statistics.high > 0.0;
    let names = [
        ("bone", is_hounsfield),
        ("skin", is_hounsfield),
        ("1.5rms", is_signed),
        ("3sigma", true),
        ("enclosed:5%", true),
        ("enclosed:20%", true),
        ("otsu", true),
    ];
    let mut all: Vec<Alternative> = Vec::new();
    for (name, _) in names.into_iter().filter(|(_, fits)| *fits) {
        let Ok(isovalue) = name.parse::<Isovalue>() else { continue };
        let level = Level { value: isovalue.value_of(volume, statistics, chosen.solid), solid: chosen.solid };
        let is_new = level.value != chosen.value && all.iter().all(|a| a.level.value != level.value);
        if is_new && super::crosses(volume, level) {
            all.push(Alternative { name: name.into(), level });
        }
    }
    all
}

/// To four digits, and four digits of the range: what is printed is what is used.
fn round(level: f64, range: f64) -> f64 {
    if !(range > 0.0 && range.is_finite()) {
        return level;
    }
    // Next to 0 the digits of the level mean nothing.
    let least = level.abs().clamp(1e-6 * range, range);
    let step = libm::exp10(libm::floor(libm::log10(least)) - 3.0);
    let rounded = (level / step).round() * step;
    // The nearest decimal number: `12 · 0.001` has digits of its own.
    format!("{rounded:.12e}").parse().unwrap_or(level)
}

/// Values of both signs that vanish towards the border, smooth: an orbital. One level on either side of 0.
fn lobes(statistics: &Statistics, side: Option<Solid>) -> Option<Chosen> {
    let Statistics { low, high, rms, border_rms, roughness, .. } = *statistics;
    let (smaller, larger) = (high.min(-low), high.max(-low));
    let is_balanced = low < 0.0 && high > 0.0 && smaller > 0.2 * larger;
    if !is_balanced || roughness > 0.08 || border_rms > 0.25 * rms {
        return None;
    }
    let level = round(statistics.magnitude_enclosing(LOBES), high - low);
    if level <= 0.0 || level >= smaller {
        return None;
    }
    let lobe = |solid| {
        let sign = if solid == Solid::Above { 1.0 } else { -1.0 };
        Level { value: sign * level / statistics.scale, solid }
    };
    let (first, more) = match side {
        Some(side) => (lobe(side), Vec::new()),
        None => (lobe(Solid::Above), vec![lobe(Solid::Below)]),
    };
    let which = if more.is_empty() { "one lobe of" } else { "both lobes of" };
    let reason = format!(
        "{which} a field about 0: {:.0} % of the extreme, {:.0} % of the squares lie beyond",
        100.0 * level / larger,
        100.0 * LOBES
    );
    Some(Chosen {
        value: first.value,
        solid: first.solid,
        reason: Some(reason),
        more,
        alternatives: Vec::new(),
        warning: None,
    })
}

/// Few values in patches: one level between each two of them, from that of the border inwards.
fn labels(volume: &Volume, statistics: &Statistics) -> Option<Found> {
    if statistics.equal_neighbours < 0.7 {
        return None;
    }
    let mut raw = with_samples!(volume.samples(), s => distinct(s))?;
    raw.sort_unstable_by(f32::total_cmp);
    let scale = statistics.scale;
    let mut values: Vec<f64> = raw.iter().map(|&r| volume.value_from_raw(f64::from(r)) * scale).collect();
    values.sort_unstable_by(f64::total_cmp);
    // The background is what most of the border has.
    let sign = if statistics.border_mean <= 0.5 * (statistics.low + statistics.high) { 1.0 } else { -1.0 };
    let mut levels: Vec<f64> = values.windows(2).map(|pair| sign * 0.5 * (pair[0] + pair[1])).collect();
    levels.sort_unstable_by(f64::total_cmp);
    let reason = match values.len() {
        2 => "between the two values of a mask".to_string(),
        n => format!("{n} values in patches, labels: one level between each two"),
    };
    (!levels.is_empty()).then_some(Found { levels, sign, knows_side: true, reason })
}

/// All values, where there are few.
fn distinct<T: Sample>(samples: &[T]) -> Option<Vec<f32>> {
    let (mut values, mut last) = (Vec::new(), f32::NAN);
    for sample in samples {
        let raw = sample.raw();
        if raw != last && !values.contains(&raw) {
            if values.len() == MOST_LABELS {
                return None;
            }
            values.push(raw);
        }
        last = raw;
    }
    Some(values)
}

/// Computed tomography in Hounsfield units: air near −1000, tissue near 0, perhaps bone.
fn hounsfield(statistics: &Statistics, sign: f64) -> Option<Found> {
    let between = |from: f64, to: f64| statistics.share_above(from) - statistics.share_above(to);
    let in_range = (-4100.0..=-850.0).contains(&statistics.low) && statistics.high >= 100.0 && statistics.high < 4e4;
    // A tenth of a per cent of air and of tissue: bodies fill boxes, and boxes hold small things.
    let (air, tissue) = (between(-1150.0, -850.0), between(-200.0, 250.0));
    if statistics.scale != 1.0 || !in_range || air < 0.02 || tissue < 0.02 || air + tissue < 0.3 {
        return None;
    }
    let has_bone = statistics.share_above(BONE) > 2e-4;
    let of = if sign > 0.0 { "" } else { " with the sign turned" };
    let (level, what) = if has_bone { (BONE, "bone") } else { (SKIN, "skin") };
    let reason = format!("{what}, {level} HU: the samples look like a CT in Hounsfield units{of}");
    Some(Found { levels: vec![level], sign, knows_side: true, reason })
}

/// A bulk of samples that spreads evenly about its median, and a tail beyond: signal in noise.
fn signal_in_noise(plain: &Statistics, negated: &Statistics) -> Option<Found> {
    let sigma = plain.noise();
    let tail = |s: &Statistics| s.share_above(s.quantile(0.5) + NOISE * sigma);
    let (above, below) = (tail(plain), tail(negated));
    let (statistics, sign, tail) = if above >= below { (plain, 1.0, above) } else { (negated, -1.0, below) };
    let (lower, median, upper) = (statistics.quantile(0.159), statistics.quantile(0.5), statistics.quantile(0.841));
    let is_even = upper - median < 2.0 * (median - lower) && median - lower < 2.0 * (upper - median);
    let level = median + NOISE * sigma;
    // Of noise alone 0.02 % lie there.
    if sigma <= 0.0 || !is_even || !(7e-4..0.15).contains(&tail) || statistics.high < median + 5.0 * sigma {
        return None;
    }
    let reason =
        format!("{NOISE} standard deviations of the noise from its median {}", number(sign * median / plain.scale));
    Some(Found { levels: vec![level], sign, knows_side: true, reason })
}

/// The side on which a field reaches further from 0.
fn leading(statistics: &Statistics) -> f64 {
    if statistics.high >= -statistics.low { 1.0 } else { -1.0 }
}

/// A rough field of both signs about 0, as maps of electron microscopy and crystallography are.
fn map_about_zero(statistics: &Statistics, sign: f64) -> Option<Found> {
    let Statistics { low, high, mean, deviation, roughness, .. } = *statistics;
    let level = mean + 1.5 * deviation;
    let is_map = low < 0.0 && -low > 0.1 * high && statistics.quantile(0.5).abs() < 0.5 * deviation;
    (is_map && roughness > 0.03 && level < high).then(|| {
        let reason = "1.5 standard deviations from the mean: a rough field about 0, as density maps are".into();
        Found { levels: vec![level], sign, knows_side: true, reason }
    })
}

/// Two classes.
fn split(statistics: &Statistics, sign: f64) -> Found {
    let reason = "Otsu's threshold of the samples".into();
    Found { levels: vec![statistics.otsu()], sign, knows_side: false, reason }
}
