//! Logarithmic axes and how numbers are written beside them.

/// A logarithmic axis from decade to decade, or to 2 and 5 of one.
pub(super) struct Axis {
    pub(super) from: f64,
    pub(super) to: f64,
    at_from: f64,
    at_to: f64,
}

impl Axis {
    pub(super) fn around(values: impl Iterator<Item = f64>, at_from: f64, at_to: f64) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low.is_finite() && high > 0.0 { (low.max(high * 1e-6), high) } else { (0.1, 1.0) };
        let below = ticks(low / 10.0, low / 1.05).pop().unwrap_or(low);
        let above = ticks(high * 1.05, high * 10.0).first().copied().unwrap_or(high);
        Self { from: below, to: above, at_from, at_to }
    }

    pub(super) fn place(&self, value: f64) -> f64 {
        let part = libm::log(value / self.from) / libm::log(self.to / self.from);
        self.at_from + part.clamp(0.0, 1.0) * (self.at_to - self.at_from)
    }
}

/// 1, 2 and 5 of every decade between two numbers.
pub(super) fn ticks(from: f64, to: f64) -> Vec<f64> {
    let decade = libm::floor(libm::log10(from)) as i32;
    let all = (decade..decade + 14).flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * libm::pow(10.0, f64::from(d))));
    all.filter(|t| (from * 0.999..=to * 1.001).contains(t)).collect()
}

/// A number without needless digits.
pub(super) fn short(value: f64) -> String {
    if value >= 100.0 { format!("{value:.0}") } else { format!("{}", (value * 1e4).round() / 1e4) }
}

/// Two digits that count, for narrow places.
pub(super) fn brief(value: f64) -> String {
    if value >= 10.0 {
        format!("{value:.0}")
    } else if value >= 1.0 {
        format!("{value:.1}")
    } else if value >= 0.1 {
        format!("{value:.2}")
    } else {
        format!("{value:.3}")
    }
}
