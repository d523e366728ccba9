//! Operators on fields. Solid is {f > iso}: the iso of a node is that of the model.

use super::interval::Interval;
use super::scalar::Scalar;

/// Ricci's blend (Ricci 1973): (Σ f_iⁿ)^(1/n) of fields that are not negative; negative ones count as 0. n = 1 is the sum,
/// n → ∞ the maximum, n → −∞ the minimum. Scaled by the largest (for n < 0 the smallest), so that no power overflows.
pub fn ricci<S: Scalar>(fields: &[S], n: f64) -> S {
    let fields = || fields.iter().map(|f| f.larger(S::of(0.0)));
    let pick = |a: f64, b: f64| if n > 0.0 { a.larger(b) } else { a.smaller(b) };
    let scale = fields().map(Scalar::value).reduce(pick).unwrap_or(0.0);
    if scale == 0.0 || !scale.is_finite() {
        return fields().reduce(|a, b| if n > 0.0 { a.larger(b) } else { a.smaller(b) }).unwrap_or(S::of(0.0));
    }
    let sum = fields().map(|f| (f / S::of(scale)).power(n)).reduce(|a, b| a + b).unwrap_or(S::of(0.0));
    sum.power(1.0 / n).scaled(scale)
}

/// Pasko's operators on f − iso (Pasko, Adzhiev, Sourin and Savchenko 1995), two fields; not associative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pasko {
    /// The isovalue that fields are taken from.
    pub iso: f64,
    /// 1 is the union, −1 the intersection, 0 the sum.
    pub alpha: f64,
    /// The exponent of the factor (a² + b²)^(m/2), which leaves the surface where it is: 0 for none.
    pub m: f64,
    /// a₀, a₁, a₂ of the displacement a₀/(1 + (a/a₁)² + (b/a₂)²), which blends.
    pub displacement: Option<[f64; 3]>,
}

impl Pasko {
    /// The value from two fields.
    pub fn of<S: Scalar>(&self, first: S, second: S) -> S {
        let (a, b) = (first.plus(-self.iso), second.plus(-self.iso));
        let square = a * a + b * b;
        let mut value = a + b + square.root().scaled(self.alpha);
        if let Some([height, along_a, along_b]) = self.displacement {
            let below = (a.scaled(1.0 / along_a).squared() + b.scaled(1.0 / along_b).squared()).plus(1.0);
            value = value + S::of(height) / below;
        }
        if self.m != 0.0 {
            value = value * square.power(0.5 * self.m);
        }
        value.plus(self.iso)
    }

    /// Where the values lie: without displacement and factor the function rises in both.
    pub fn bounds(&self, first: Interval, second: Interval) -> Interval {
        let plain = Self { m: 0.0, displacement: None, ..*self };
        let at = |a: f64, b: f64| plain.of(a, b) - self.iso;
        let mut value = Interval::new(at(first.low, second.low), at(first.high, second.high)).widened();
        if let Some([height, ..]) = self.displacement {
            value = Interval::new(value.low + height.min(0.0), value.high + height.max(0.0));
        }
        if self.m != 0.0 {
            let (a, b) = ((first - self.iso).squared(), (second - self.iso).squared());
            let power = |v: f64| libm::pow(v, 0.5 * self.m);
            value = value * Interval::new(power(a.low + b.low), power(a.high + b.high)).widened();
        }
        (value + self.iso).widened()
    }
}

/// Unions and intersections that crease on their surface alone: everywhere else the level curves of max and min are
/// rounded by a quarter circle (the property of Barthe, Dodgson, Sabin, Wyvill and Gaildrat 2003; the construction is
/// ours, see the documentation of models).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crease {
    /// The level that keeps its crease; positive.
    pub iso: f64,
    /// How much levels below it are rounded, 0 to 1.
    pub m: f64,
    /// How much levels above it are not, 0 to 1.
    pub k: f64,
}

/// Most steps of the search of a root; each halves the bracket at least.
const MOST_STEPS: usize = 80;

impl Crease {
    /// The centre of the circle that rounds the level C of a union, and its slope.
    fn phi<S: Scalar>(&self, level: S) -> (S, S) {
        self.centre(level, -self.m, self.k)
    }

    /// The same of an intersection.
    fn psi<S: Scalar>(&self, level: S) -> (S, S) {
        self.centre(level, self.m, 1.0 + self.k)
    }

    fn centre<S: Scalar>(&self, level: S, m: f64, above: f64) -> (S, S) {
        let c = level.value();
        if c <= 0.0 {
            (level, S::of(1.0))
        } else if c <= self.iso {
            let part = level.scaled(1.0 / self.iso);
            (level * (S::of(1.0) - part).scaled(m).plus(1.0), (S::of(1.0) - part.scaled(2.0)).scaled(m).plus(1.0))
        } else {
            (level.plus(-self.iso).scaled(above).plus(self.iso), S::of(above))
        }
    }

    /// The union.
    pub fn union<S: Scalar>(&self, a: S, b: S) -> S {
        let (most, least) = (a.larger(b), a.smaller(b));
        let (phi, _) = self.phi(most.value());
        let is_rounded = least.value() > phi;
        // Nor where one is NaN.
        if !is_rounded {
            return most;
        }
        // C − φ − |((a − φ)₊, (b − φ)₊)| rises in C.
        let (m, l) = (most.value(), least.value());
        let start = self.root(m, m + (l - phi), |c| self.excess(c, m, l));
        self.polished(start, |c| self.excess(c, most, least))
    }

    /// The intersection.
    pub fn intersection<S: Scalar>(&self, a: S, b: S) -> S {
        let (most, least) = (a.larger(b), a.smaller(b));
        let (psi, _) = self.psi(least.value());
        let is_rounded = most.value() < psi;
        if !is_rounded {
            return least;
        }
        let (m, l) = (most.value(), least.value());
        let start = self.root(l + (m - psi), l, |c| self.shortfall(c, m, l));
        self.polished(start, |c| self.shortfall(c, most, least))
    }

    fn excess<S: Scalar>(&self, c: S, a: S, b: S) -> [S; 2] {
        let (phi, slope) = self.phi(c);
        let (x, y) = ((a - phi).larger(S::of(0.0)), (b - phi).larger(S::of(0.0)));
        Self::circle(c - phi, x, y, slope)
    }

    fn shortfall<S: Scalar>(&self, c: S, a: S, b: S) -> [S; 2] {
        let (psi, slope) = self.psi(c);
        let (x, y) = ((psi - a).larger(S::of(0.0)), (psi - b).larger(S::of(0.0)));
        let [value, slope] = Self::circle(psi - c, x, y, slope);
        [-value, slope]
    }

    /// radius − |(x, y)| and 1 + φ′(cos α + sin α − 1), the slope of what rises.
    fn circle<S: Scalar>(radius: S, x: S, y: S, slope: S) -> [S; 2] {
        let length = (x * x + y * y).root();
        let turn = if length.value() > 0.0 { (x + y) / length } else { S::of(1.0) };
        [radius - length, slope * turn.plus(-1.0) + S::of(1.0)]
    }

    /// The root of a rising function in a bracket: Newton's method, bisection where that leaves the bracket.
    fn root(&self, mut low: f64, mut high: f64, f: impl Fn(f64) -> [f64; 2]) -> f64 {
        let mut c = 0.5 * (low + high);
        for _ in 0..MOST_STEPS {
            let [value, slope] = f(c);
            if value < 0.0 {
                low = c
            } else {
                high = c
            }
            let newton = c - value / slope;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - c).abs() <= 1e-15 * self.iso.max(c.abs()) {
                return next;
            }
            c = next;
        }
        c
    }

    /// Two more steps with derivatives: each doubles the order to which they are right.
    fn polished<S: Scalar>(&self, start: f64, f: impl Fn(S) -> [S; 2]) -> S {
        (0..2).fold(S::of(start), |c, _| {
            let [value, slope] = f(c);
            c - value / slope
        })
    }

    /// Whether the union is `a` alone where `a` and `b` lie in these ranges.
    pub fn union_is_first(&self, a: Interval, b: Interval) -> bool {
        let below = |v: f64| v - 1e-9 * v.abs();
        b.high <= below(self.phi(a.low).0) && b.high <= a.low
    }

    /// Whether the intersection is `a` alone.
    pub fn intersection_is_first(&self, a: Interval, b: Interval) -> bool {
        let above = |v: f64| v + 1e-9 * v.abs();
        b.low >= above(self.psi(a.high).0) && b.low >= a.high
    }
}

/// A wall about the surface: iso + t/2 − |f − iso|, t in the unit of the field.
pub fn shell<S: Scalar>(field: S, iso: f64, thickness: f64) -> S {
    (S::of(0.5 * thickness) - field.plus(-iso).magnitude()).plus(iso)
}
