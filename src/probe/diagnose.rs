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
            "5 bands do not carry it: shadows soften, and dark places may ring below 0. --sun-split lights the lamp \
             itself by rays, --window certified removes the ringing",
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
            "no power is lost: the projection integrates over each pixel exactly. A few bands smear it, --sun-split \
             gives it sharp shadows; nothing is clamped",
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
mod tests {
    use super::super::{LatLong, by_name};
    use super::*;

    fn probe(width: usize, height: usize, radiance: impl Fn(usize, usize) -> f64) -> Probe {
        Probe::from_image("test", LatLong::from_fn(width, height, |x, y| [radiance(x, y); 3]))
    }

    fn topics(probe: &Probe) -> Vec<&'static str> {
        diagnose(probe).iter().map(|f| f.topic).collect()
    }

    #[test]
    fn a_plain_sky_has_nothing_unusual() {
        let sky = by_name("overcast").unwrap().unwrap();
        assert_eq!(topics(&sky), [] as [&str; 0]);
    }

    #[test]
    fn each_topic_is_found_where_it_is_planted() {
        assert_eq!(topics(&probe(16, 8, |_, _| 0.0)), ["black"]);
        assert_eq!(topics(&probe(16, 8, |_, _| 2.5)), ["constant"]);
        assert_eq!(topics(&probe(1, 1, |_, _| 2.5)), ["constant"]);
        // A gentle gradient that never rises a stop above its mean.
        assert_eq!(topics(&probe(16, 8, |x, _| 1.0 + 0.05 * x as f64)), ["low range"]);
        let image = probe(12, 8, |x, _| 1.0 + 0.05 * x as f64);
        assert_eq!(topics(&image), ["low range", "aspect"]);
        let sun = probe(64, 32, |x, y| if (x, y) == (10, 5) { 1e6 } else { 1.0 });
        assert_eq!(topics(&sun), ["dominating pixel", "fine light"]);
        let faint = probe(64, 32, |x, y| if (x, y) == (10, 5) { 1e8 } else { 1.0 });
        assert_eq!(topics(&faint), ["high range", "dominating pixel", "fine light"]);
        let floor = probe(64, 32, |x, y| if y < 16 { 0.1 } else { 1.0 + f64::from(x as u32 == 3 && y == 20) * 2.0 });
        assert!(topics(&floor).contains(&"upside down"), "{:?}", topics(&floor));
    }

    #[test]
    fn the_sun_is_placed_and_weighed() {
        // One pixel of 1e6 among ones, in row 5 of 32: its share is 1e6 Ω / (1e6 Ω + 4π − Ω).
        let sun = probe(64, 32, |x, y| if (x, y) == (10, 5) { 1e6 } else { 1.0 });
        let edge = |k: f64| (std::f64::consts::PI * k / 32.0).cos();
        let omega = 2.0 * std::f64::consts::PI / 64.0 * (edge(5.0) - edge(6.0));
        let share = 1e6 * omega / (1e6 * omega + 4.0 * std::f64::consts::PI - omega);
        let found = diagnose(&sun);
        let text = &found.iter().find(|f| f.topic == "dominating pixel").unwrap().found;
        assert!(text.contains(&format!("{:.1} %", 100.0 * share)), "{text}");
        // Column 10.5 of 64 from the left edge at 180°; row 5.5 of 32 from the zenith.
        assert!(text.contains("azimuth 120.9°, elevation 59.1°"), "{text}");
    }
}
