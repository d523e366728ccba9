//! Tone curves.

/// From exposed radiance to colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// Linear up to white.
    #[default]
    None,
    /// Reinhard and others 2002, equation 4, by luminance; four times white becomes white.
    Reinhard,
    /// Narkowicz's fit of the ACES curve (2016), by channel.
    Filmic,
}

impl Tone {
    /// Linear colour in [0, 1] of exposed radiance.
    #[doc(hidden)]
    pub fn apply(self, exposed: [f32; 3]) -> [f32; 3] {
        let exposed = exposed.map(|v| v.max(0.0));
        match self {
            Self::None => exposed.map(|v| v.min(1.0)),
            Self::Reinhard => {
                let [r, g, b] = exposed;
                let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
                let factor = (1.0 + luminance / 16.0) / (1.0 + luminance);
                exposed.map(|v| (v * factor).min(1.0))
            }
            Self::Filmic => exposed.map(|v| {
                let x = 0.6 * v;
                ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0)
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tone_curves_rise_and_stay_within_bounds() {
        for tone in [Tone::None, Tone::Reinhard, Tone::Filmic] {
            let mut before = -1.0;
            for i in 0..200 {
                let [r, g, b] = tone.apply([0.05 * i as f32; 3]);
                assert!(r == g && g == b && (0.0..=1.0).contains(&r) && r >= before, "{tone:?} {i}");
                before = r;
            }
            assert_eq!(tone.apply([-1.0; 3]), [0.0; 3], "{tone:?}");
        }
        // Four times white is where the curve of Reinhard reaches 1.
        assert!((Tone::Reinhard.apply([4.0; 3])[0] - 1.0).abs() < 1e-6);
    }
}
