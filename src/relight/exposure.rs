//! From linear radiance to display-referred linear colour in [0, 1].

/// How radiance is scaled before it is clamped to [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// The 99th percentile over the vertices of max(R, G, B) maps to 1.
    Percentile,
    /// Radiance times 2^EV.
    Stops(f64),
}

impl Exposure {
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

    /// Scales and clamps to [0, 1].
    pub fn apply(factor: f32, radiance: &[[f32; 3]]) -> Vec<[f32; 3]> {
        radiance.iter().map(|c| c.map(|v| (v * factor).clamp(0.0, 1.0))).collect()
    }
}
