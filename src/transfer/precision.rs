//! How precisely a coefficient is kept, and what its number is when it is read back.

use super::Layers;
use half::f16;

/// How coefficients are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32-bit floats, as they are computed.
    Single,
    /// 16-bit floats, as stores hold them: 11 digits, so within 2⁻¹¹ of each number (and within 2⁻²⁵ near 0).
    Half,
    /// Whole multiples of a step, which every coefficient has of its own.
    Steps(Steps),
}

/// Signed whole numbers: code c stands for c/most times the largest magnitude that the coefficient has in any texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    bits: u32, // Invariant: 2…16.
}

impl Steps {
    /// What the page in one file holds.
    pub const BYTE: Self = Self { bits: 8 };
    /// Half as much again.
    pub const TWELVE: Self = Self { bits: 12 };

    /// The largest code: 127 for 8 bits.
    pub fn most(self) -> i32 {
        (1 << (self.bits - 1)) - 1
    }

    /// The nearest code of a number that is at most `largest` in magnitude.
    pub fn code(self, value: f32, largest: f32) -> i32 {
        let most = self.most() as f32;
        if largest > 0.0 { (value / largest * most).round().clamp(-most, most) as i32 } else { 0 }
    }

    /// The number that a code stands for.
    pub fn value(self, code: i32, largest: f32) -> f32 {
        code as f32 * largest / self.most() as f32
    }
}

impl Precision {
    /// Bits of a coefficient.
    pub fn bits(self) -> usize {
        match self {
            Self::Single => 32,
            Self::Half => 16,
            Self::Steps(steps) => steps.bits as usize,
        }
    }

    /// Such as `f16` or `8 bits`.
    pub fn name(self) -> String {
        match self {
            Self::Single => "f32".into(),
            Self::Half => "f16".into(),
            Self::Steps(steps) => format!("{} bits", steps.bits),
        }
    }

    /// What is read back of a number that is at most `largest` in magnitude.
    pub fn read_back(self, value: f32, largest: f32) -> f32 {
        match self {
            Self::Single => value,
            Self::Half => f16::from_f32(value).to_f32(),
            Self::Steps(steps) => steps.value(steps.code(value, largest), largest),
        }
    }

    /// How far what is read back may be from a number that is at most `largest` in magnitude.
    pub fn largest_error(self, largest: f32) -> f32 {
        match self {
            Self::Single => 0.0,
            Self::Half => largest * libm::exp2f(-11.0) + libm::exp2f(-25.0),
            Self::Steps(steps) => 0.5 * largest / steps.most() as f32,
        }
    }
}

/// Raises each of `largest` to the magnitude of the coefficient in one texel.
pub fn include_magnitudes(largest: &mut [f32], transfer: impl IntoIterator<Item = f32>) {
    largest.iter_mut().zip(transfer).for_each(|(l, t)| *l = l.max(t.abs()));
}

/// Bytes that a texel takes with its coefficients kept so, packed: standard errors, validity and rays as in a store.
pub fn bytes_of_texel(layers: &Layers, kept_as: Precision) -> f64 {
    (kept_as.bits() * layers.coefficients()) as f64 / 8.0 + (2 * layers.errors() + 1 + 4) as f64
}
