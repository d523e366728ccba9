//! From linear radiance to display-referred linear colour in [0, 1].

use crate::error::{Error, Result};
use crate::probe::latlong::LUMINANCE;

/// How radiance is scaled before it is clamped to [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// The 99th percentile over the vertices of max(R, G, B) maps to 1.
    Percentile,
    /// Radiance times 2^EV.
    Stops(f64),
}

impl Exposure {
    /// Refuses stops that are no number.
    ///
    /// # Errors
    /// When they are not finite.
    pub fn check(&self) -> Result<()> {
        match *self {
            Self::Stops(ev) if !ev.is_finite() => Err(Error::argument(
                "exposure",
                ev,
                "a finite number of stops",
                "leave it out for the brightest 1 % white",
            )),
            _ => Ok(()),
        }
    }

    /// The factor for a set of radiances; 1 when there is none or all are black.
    pub fn factor(&self, radiance: &[[f32; 3]]) -> f32 {
        match *self {
            Self::Stops(ev) => libm::exp2(ev) as f32,
            Self::Percentile => {
                let mut largest: Vec<f32> =
                    radiance.iter().map(|c| c[0].max(c[1]).max(c[2])).filter(|v| v.is_finite()).collect();
                if largest.is_empty() {
                    return 1.0;
                }
                let rank = ((largest.len() - 1) as f64 * 0.99).round() as usize;
                let (_, value, _) = largest.select_nth_unstable_by(rank, f32::total_cmp);
                if *value > 0.0 { 1.0 / *value } else { 1.0 }
            }
        }
    }

    /// Scales and clamps to [0, 1]; negative channels as [`without_negative`] says.
    pub fn apply(factor: f32, radiance: &[[f32; 3]]) -> Vec<[f32; 3]> {
        radiance.iter().map(|c| without_negative(*c).map(|v| (v * factor).clamp(0.0, 1.0))).collect()
    }
}

/// Radiance as it can be shown: what has a negative channel, by ringing or noise, moves towards the grey of its luminance
/// until no channel is negative; black where the luminance itself is not positive. Without negative channels nothing
/// changes.
///
/// Channels set to 0 one by one turn hues and brighten: of a warm light that rings below 0 in shadow red goes first, and
/// what is left is a blue blotch. Here luminance stays and so does hue (the ratio of the differences of the channels), as
/// gamuts are mapped for display, and the result is continuous in the radiance. It needs nothing but the three numbers, so
/// that vertices, pixels, and readers of files do the same.
pub fn without_negative(rgb: [f32; 3]) -> [f32; 3] {
    let least = rgb[0].min(rgb[1]).min(rgb[2]);
    if least >= 0.0 || !rgb.iter().all(|v| v.is_finite()) {
        return rgb;
    }
    let grey = luminance(rgb);
    if grey <= 0.0 {
        return [0.0; 3];
    }
    let kept = grey / (grey - least);
    rgb.map(|v| (grey + kept * (v - grey)).max(0.0))
}

/// Of linear sRGB.
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    let [of_red, of_green, of_blue] = LUMINANCE.map(|w| w as f32);
    of_red * r + of_green * g + of_blue * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::uniform;

    #[test]
    fn channels_below_0_leave_luminance_and_hue_and_nothing_else_changes() {
        let mut moved = 0;
        for i in 0..10_000 {
            let rgb: [f32; 3] = std::array::from_fn(|c| 2.0 * uniform(1, 2, i, c as u32) - 0.6);
            let shown = without_negative(rgb);
            assert!(shown.iter().all(|v| *v >= 0.0), "{rgb:?} {shown:?}");
            if rgb.iter().all(|v| *v >= 0.0) {
                assert_eq!(shown, rgb);
                continue;
            }
            if luminance(rgb) <= 0.0 {
                assert_eq!(shown, [0.0; 3]);
                continue;
            }
            moved += 1;
            assert!((luminance(shown) - luminance(rgb)).abs() < 1e-6, "{rgb:?} {shown:?}");
            // Differences keep their ratio: their cross product vanishes.
            let [d, e] = [rgb, shown].map(|v| [v[0] - v[1], v[1] - v[2]]);
            assert!((d[0] * e[1] - d[1] * e[0]).abs() < 1e-6, "{rgb:?} {shown:?}");
            assert!(shown.iter().fold(1.0f32, |m, v| m.min(*v)) < 1e-6, "no farther than needed: {shown:?}");
        }
        assert!(moved > 1000);
        let bright = [f32::INFINITY, -1.0, 0.0];
        assert_eq!(without_negative(bright), bright);
    }
}
