//! Reflection and refraction at clear glass.

use glam::DVec3;

/// The next direction of a path that meets glass of an index, by one variate, and the factor on its radiance.
///
/// Fresnel's equations for unpolarised light decide between the two with their own probability. Radiance that enters a
/// denser medium grows by the square of the ratio of the indices; a path, which runs against the light, takes the
/// inverse (Veach 1997, section 5.2).
pub(in super::super) fn turn(direction: DVec3, front: DVec3, index: f64, u: f64) -> (DVec3, f64) {
    let enters = direction.dot(front) < 0.0;
    let normal = if enters { front } else { -front };
    // From the side the ray comes from to the other.
    let ratio = if enters { 1.0 / index } else { index };
    let cosine = (-direction.dot(normal)).clamp(0.0, 1.0);
    let reflected = direction + 2.0 * cosine * normal;
    let beyond = match fresnel(cosine, ratio) {
        Some((reflectance, beyond)) if u >= reflectance => beyond,
        _ => return (reflected.normalize_or(normal), 1.0),
    };
    let refracted = ratio * direction + (ratio * cosine - beyond) * normal;
    (refracted.normalize_or(-normal), ratio * ratio)
}

/// Reflectance of unpolarised light from the cosine on its side and the ratio of the index there to that beyond, and the cosine
/// beyond; `None` beyond the critical angle.
pub(super) fn fresnel(cosine: f64, ratio: f64) -> Option<(f64, f64)> {
    let square = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
    if square <= 0.0 {
        return None;
    }
    let beyond = square.sqrt();
    let across = (ratio * cosine - beyond) / (ratio * cosine + beyond);
    let along = (ratio * beyond - cosine) / (ratio * beyond + cosine);
    Some((0.5 * (across * across + along * along), beyond))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_reflectances() {
        // Straight on ((n−1)/(n+1))² = 0.04; at Brewster's angle atan(1.5) only the half across is reflected.
        let reflectance = |cosine: f64, ratio: f64| fresnel(cosine, ratio).map_or(1.0, |(reflectance, _)| reflectance);
        assert!((reflectance(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-12);
        let brewster = libm::atan(1.5f64);
        let (cosine, beyond) = (libm::cos(brewster), libm::sin(brewster));
        let across = ((1.0 / 1.5 * cosine - beyond) / (1.0 / 1.5 * cosine + beyond)).powi(2);
        assert!((reflectance(cosine, 1.0 / 1.5) - 0.5 * across).abs() < 1e-12);
    }

    #[test]
    fn the_way_back_is_the_way() {
        let front = DVec3::Z;
        let inward = DVec3::new(0.6, 0.0, -0.8);
        let (inside, factor) = turn(inward, front, 1.5, 0.999);
        // Snell: sin = 0.6/1.5.
        assert!((inside.x - 0.4).abs() < 1e-12 && inside.z < 0.0);
        let (back, inverse) = turn(-inside, front, 1.5, 0.999);
        assert!((back + inward).length() < 1e-12 && (factor * inverse - 1.0).abs() < 1e-12);
        // Beyond the critical angle all is reflected.
        let (kept, factor) = turn(DVec3::new(0.8, 0.0, 0.6), front, 1.5, 0.999);
        assert!(kept.z < 0.0 && factor == 1.0);
    }

    /// Means over the cosine, from outside and from inside: inside = 1 − (1 − outside)/n².
    #[test]
    fn fresnel_means() {
        for (n, outside) in [(1.0, 0.0), (1.33, 0.065931), (1.4, 0.076812), (1.5, 0.091778), (2.4, 0.210181)] {
            // ∫ R d(c²), by the midpoint rule.
            let mean = |ratio: f64| {
                let count = 2_000_000;
                let at = |i: usize| ((i as f64 + 0.5) / count as f64).sqrt();
                (0..count).map(|i| fresnel(at(i), ratio).map_or(1.0, |(r, _)| r)).sum::<f64>() / count as f64
            };
            let (found, within) = (mean(1.0 / n), mean(n));
            assert!((found - outside).abs() < 1e-6, "{n}: {found}");
            assert!((within - (1.0 - (1.0 - found) / (n * n))).abs() < 1e-5, "{n}: {within}");
        }
    }
}
