//! A bar of a round length in a picture.

use crate::export::{Image, font};
use crate::quantity::number;
use crate::render::Camera;
use crate::volume::LengthUnit;

/// Draws a bar of a round length, with its length in words, into a picture by a camera with parallel rays.
pub(super) fn draw(image: &mut Image, camera: &Camera, unit: LengthUnit) {
    let (width, height) = (image.width(), image.height());
    let aspect = width as f64 / height as f64;
    let units = (camera.ray(0.0, 1.0, aspect).0 - camera.ray(0.0, -1.0, aspect).0).length() / height as f64;
    let (name, in_named) = bar_unit(unit);
    let (length, pixels) = round_length(units * in_named, width as f64 * 0.2);
    let label = format!("{} {name}", number(length, 4));
    let scale = (height / 300).max(1);
    let (left, thick) = (width / 40 + 1, (height / 240).max(1));
    let bottom = height - (height / 30).max(thick + 1);
    let top = bottom.saturating_sub(font::height(&label, scale) + 2 * thick + scale);
    let ink = if brightness(image, left, top) > 0.2 { [0.0, 0.0, 0.0, 1.0] } else { [1.0; 4] };
    for x in 0..pixels as usize {
        for y in 0..thick {
            image.blend(left + x, bottom + y, ink);
        }
    }
    for y in 0..3 * thick {
        for x in 0..thick {
            image.blend(left + x, bottom + thick - y, ink);
            image.blend(left + pixels as usize - x, bottom + thick - y, ink);
        }
    }
    font::draw(image, left, top, &label, scale, ink);
}

/// The largest of 1, 2, 5 × 10^n units that `most` pixels hold, and its pixels.
fn round_length(units_per_pixel: f64, most: f64) -> (f64, f64) {
    let longest = units_per_pixel * most;
    let power = 10f64.powi(libm::log10(longest).floor() as i32);
    let length = [5.0, 2.0, 1.0].map(|f| f * power).into_iter().find(|l| *l <= longest).unwrap_or(power);
    (length, length / units_per_pixel)
}

/// The unit that a bar is labelled in, and how many of it are a world unit: the nearest of those with a name, so that
/// bohr (0.529 Å) are shown in Å.
fn bar_unit(unit: LengthUnit) -> (&'static str, f64) {
    const NAMES: [(f64, &str); 6] = [(1e-10, "Å"), (1e-9, "nm"), (1e-6, "µm"), (1e-3, "mm"), (1e-2, "cm"), (1.0, "m")];
    let LengthUnit::Metres(metres) = unit else { return ("units", 1.0) };
    let away = |m: f64| libm::log(metres / m).abs();
    let nearest = NAMES.into_iter().min_by(|a, b| away(a.0).total_cmp(&away(b.0)));
    nearest.map_or(("m", metres), |(m, name)| (name, if away(m) < 1e-9 { 1.0 } else { metres / m }))
}

/// Mean luminance of what lies under a label, transparent counted as white paper.
fn brightness(image: &Image, left: usize, top: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0f32);
    for y in (top..image.height()).step_by(2) {
        for x in (left..(left + image.width() / 5).min(image.width())).step_by(2) {
            let [r, g, b, a] = image.pixel(x, y);
            sum += (0.2126 * r + 0.7152 * g + 0.0722 * b) * a + 1.0 - a;
            count += 1.0;
        }
    }
    sum / count.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_round_and_fit() {
        for (units, most) in [(0.5, 200.0), (1e-6, 77.0), (3.0, 333.0)] {
            let (length, pixels) = round_length(units, most);
            assert!(pixels <= most && pixels > most / 2.51, "{length} {pixels}");
            let digit = length / 10f64.powf(length.log10().floor());
            assert!([1.0, 2.0, 5.0].iter().any(|d| (digit - d).abs() < 1e-9), "{length}");
        }
    }

    #[test]
    fn bars_are_labelled_in_units_with_a_name() {
        for (metres, name) in [(1e-10, "Å"), (1e-6, "µm"), (1e-3, "mm")] {
            assert_eq!(bar_unit(LengthUnit::Metres(metres)), (name, 1.0));
        }
        let (name, in_named) = bar_unit(LengthUnit::Metres(5.29177210903e-11));
        assert!(name == "Å" && (in_named - 0.529177210903).abs() < 1e-9, "{name} {in_named}");
        assert_eq!(bar_unit(LengthUnit::Unknown), ("units", 1.0));
    }
}
