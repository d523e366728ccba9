//! The sRGB transfer function (IEC 61966-2-1:1999), stated once: linear light in [0, 1] to the
//! display signal in [0, 1] and back. Primaries are those of Rec.709, so no matrix is involved.
//!
//! Uses `libm`, not the platform, so that the same picture is the same file everywhere.

use std::sync::LazyLock;

/// Display signal in [0, 1] of linear light; clamps to [0, 1], NaN gives 0.
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear >= 1.0 {
        1.0
    } else if linear > 0.003_130_8 {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    } else if linear > 0.0 {
        12.92 * linear
    } else {
        0.0
    }
}

/// Linear light of a display signal; clamps to [0, 1], NaN gives 0.
pub fn linear_from_srgb(signal: f64) -> f64 {
    if signal >= 1.0 {
        1.0
    } else if signal > 0.040_45 {
        libm::pow((signal + 0.055) / 1.055, 2.4)
    } else if signal > 0.0 {
        signal / 12.92
    } else {
        0.0
    }
}

/// Entry k is the linear light whose signal is (k + ½)/255: where code k turns into k + 1.
static THRESHOLDS: LazyLock<[f32; 255]> =
    LazyLock::new(|| std::array::from_fn(|k| linear_from_srgb((k as f64 + 0.5) / 255.0) as f32));

/// The 8-bit code nearest in signal to linear light, clamped; NaN gives 0. A search in the 255
/// thresholds: about ten times cheaper than the power function, and as exact.
pub fn byte_from_linear(linear: f32) -> u8 {
    THRESHOLDS.partition_point(|&threshold| threshold <= linear) as u8
}

/// The linear light of an 8-bit code.
pub fn linear_from_byte(code: u8) -> f32 {
    linear_from_srgb(f64::from(code) / 255.0) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_points() {
        // IEC 61966-2-1: both pieces meet at 0.0031308 / 0.04045 to the digits it prints.
        assert!((srgb_from_linear(0.003_130_8) - 0.040_45).abs() < 1e-6);
        // VALIDATION 31: mid-grey 0.2140 linear is code 128 ± 1.
        assert!((127..=129).contains(&byte_from_linear(0.2140)));
        assert_eq!([0.0, 1.0, 7.0, -1.0, f32::NAN].map(byte_from_linear), [0, 255, 255, 0, 0]);
        assert_eq!((srgb_from_linear(f64::NAN), linear_from_srgb(f64::NAN)), (0.0, 0.0));
    }

    #[test]
    fn the_two_directions_are_inverse() {
        for step in 0..=10_000 {
            let x = f64::from(step) / 10_000.0;
            // The printed constants leave a jump of about 1e-8 between the pieces; its image under
            // the steeper inverse stays below 1e-6.
            assert!((linear_from_srgb(srgb_from_linear(x)) - x).abs() < 1e-6, "{x}");
        }
        for code in 0..=255 {
            assert_eq!(byte_from_linear(linear_from_byte(code)), code);
        }
    }

    #[test]
    fn codes_equal_the_rounded_formula() {
        // The slow twin: round(255 · signal), except within f32 rounding of a threshold.
        for step in 0..=100_000u32 {
            let linear = step as f32 / 100_000.0;
            let exact = 255.0 * srgb_from_linear(f64::from(linear));
            assert!((f64::from(byte_from_linear(linear)) - exact).abs() <= 0.5 + 1e-4, "{linear}");
        }
    }
}
