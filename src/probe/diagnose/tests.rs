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
