//! What is unusual about a probe and what this program does about it.
//!
//! | topic | what is counted |
//! |---|---|
//! | `not finite`, `negative` | pixels that no light can have, as stored |
//! | `reader` | whatever else the reader noticed |
//! | `black`, `constant` | all pixels |
//! | `low range` | stops between the mean and the brightest pixel |
//! | `high range` | stops between the faintest and the brightest pixel |
//! | `dominating pixel` | the pixel that alone gives much of the light |
//! | `fine light` | percent of the energy above degree 4 |
//! | `aspect` | a lat-long image that is not 2:1 |
//! | `upside down` | percent of the light that comes from below |

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::latlong::{angles_from_direction, luminance};
use super::{Layout, Probe, report};
use crate::finding::Finding;

/// Part of all light in one pixel from which on it is the light.
const DOMINATING: f64 = 0.1;
/// Part of the energy above degree 4 that shows as lost shadows or ringing.
const FINE: f64 = 0.1;
/// Fewer stops than this from the mean to the brightest pixel: no lamp can have been in the picture
/// unclipped.
const FEWEST_STOPS: f64 = 1.0;
/// More stops than this from the faintest to the brightest pixel: more than cameras bracket.
const MOST_STOPS: f64 = 20.0;
/// Part of the light from below the horizon that a scene under a sky does not have.
const FROM_BELOW: f64 = 0.6;

/// What is unusual about a probe.
pub fn diagnose(probe: &Probe) -> Vec<Finding> {
    let image = &probe.image;
    let pixels = (image.width() * image.height()) as u64;
    let mut found = impossible(probe);
    let first = image.pixels().first().copied().unwrap_or_default();
    if image.pixels().iter().all(|p| *p == first) {
        let (topic, text, handled) = if first == [0.0; 3] {
            (
                "black",
                "every pixel is 0".into(),
                "surfaces under it are exactly black unless they emit light themselves",
            )
        } else {
            (
                "constant",
                format!("every pixel is {first:?}"),
                "a uniform light: openness alone shades. Right for ambient occlusion, unusual for a photograph",
            )
        };
        found.push(Finding::new(topic, (pixels, pixels, "pixels"), text, handled));
        found.extend(aspect(probe));
        return found;
    }
    let figures = report(probe, 5);
    let stops = figures
        .brightest_pixel
        .filter(|_| figures.mean_luminance > 0.0)
        .map(|p| libm::log2(p.luminance / figures.mean_luminance));
    if let Some(stops) = stops.filter(|s| *s < FEWEST_STOPS && probe.format != "formula") {
        found.push(Finding::new(
            "low range",
            (stops as u64, 0, "stops"),
            format!("the brightest pixel is only {stops:.2} stops above the mean"),
            "it is used as it is. If lamps or the sky were clipped, surfaces come out flat: use the HDR original",
        ));
    }
    if figures.range_ev > MOST_STOPS {
        found.push(Finding::new(
            "high range",
            (figures.range_ev as u64, 0, "stops"),
            "from the faintest pixel that is not black to the brightest",
            "sums run in 64 bits, nothing is lost; give --exposure if the automatic one follows the wrong part",
        ));
    }
    found.extend(dominating(probe));
    let lost = figures.energy.get(4).map_or(0.0, |e| e.lost_above);
    if lost > FINE {
        found.push(Finding::new(
            "fine light",
            ((100.0 * lost) as u64, 0, "% of the energy"),
            "above degree 4, beyond 5 bands",
            "5 bands do not carry it. relight lights lamps that would ring apart, by rays; with --sun-split off shadows \
             soften, and dark places may ring below 0, which --window certified removes",
        ));
    }
    found.extend(aspect(probe));
    found.extend(from_below(probe));
    found
}

/// Pixels that no light can have, and the rest of the notes.
fn impossible(probe: &Probe) -> Vec<Finding> {
    let [width, height] = probe.stored_size;
    let of = (width * height) as u64;
    let mut found = Vec::new();
    for note in &probe.notes {
        let is = |start: &str| note.text.starts_with(start);
        let (topic, handled) = if is("pixels with NaN") || is("infinite pixels") {
            ("not finite", "the other channels of the pixel keep their light")
        } else if is("negative pixels") {
            ("negative", "--keep-negative keeps them, but light with negative pixels cannot be certified")
        } else {
            found.push(Finding::new("reader", (note.count, 0, "items"), note.text.clone(), ""));
            continue;
        };
        found.push(Finding::new(topic, (note.count, of, "pixels"), note.text.clone(), handled));
    }
    found
}

/// The pixel with the most light (luminance times solid angle), where that is much of all.
fn dominating(probe: &Probe) -> Option<Finding> {
    let image = &probe.image;
    let (mut total, mut most) = (0.0, (0.0, 0, 0));
    for y in 0..image.height() {
        let solid_angle = image.pixel_solid_angle(y);
        for (x, pixel) in image.row(y).iter().enumerate() {
            let light = luminance(*pixel).max(0.0) * solid_angle;
            total += light;
            if light > most.0 {
                most = (light, x, y);
            }
        }
    }
    let (light, x, y) = most;
    let share = light / total;
    let pixels = (image.width() * image.height()) as u64;
    // Of a handful of pixels one always has much.
    (pixels >= 32 && total > 0.0 && share > DOMINATING).then(|| {
        let (azimuth, elevation) = angles_from_direction(image.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5));
        Finding::new(
            "dominating pixel",
            (1, pixels, "pixels"),
            format!(
                "one pixel has {:.1} % of the light, at azimuth {:.1}°, elevation {:.1}°: a sun, or a defect of the \
                 camera",
                100.0 * share,
                azimuth.to_degrees(),
                elevation.to_degrees()
            ),
            "no power is lost: the projection integrates over each pixel exactly. A few bands smear it, relight gives \
             it sharp shadows by rays; nothing is clamped",
        )
    })
}

fn aspect(probe: &Probe) -> Option<Finding> {
    let [width, height] = probe.stored_size;
    let odd = probe.layout == Layout::LatLong && width != 2 * height && (width, height) != (1, 1);
    (odd && probe.format != "formula").then(|| {
        Finding::new(
            "aspect",
            (1, 0, "image"),
            format!("{width} × {height} is not 2:1"),
            "it is stretched over the whole sphere. If it is a crop, pad it with black to 2:1; if it has another \
             layout, give --layout",
        )
    })
}

/// Light from below the horizon: an image that stands on its head, or a frame with z up.
fn from_below(probe: &Probe) -> Option<Finding> {
    let image = &probe.image;
    let (mut above, mut below) = (0.0, 0.0);
    for y in 0..image.height() {
        let light: f64 = image.row(y).iter().map(|p| luminance(*p).max(0.0)).sum();
        let light = light * image.pixel_solid_angle(y);
        match (2 * y + 1).cmp(&image.height()) {
            std::cmp::Ordering::Less => above += light,
            std::cmp::Ordering::Equal => (above, below) = (above + 0.5 * light, below + 0.5 * light),
            std::cmp::Ordering::Greater => below += light,
        }
    }
    let share = below / (above + below);
    (share > FROM_BELOW).then(|| {
        Finding::new(
            "upside down",
            ((100.0 * share) as u64, 0, "% of the light"),
            "comes from below the horizon",
            "it is used as it stands: the top row of a lat-long image is straight up, along --up in the world. If the \
             picture is upside down, flip it; if another axis is up, give --up",
        )
    })
}

#[cfg(test)]
mod tests;
