//! Texels whose rays cannot be blocked: the clamped cosine in closed form, and no ray.
//!
//! T_0,lm = (A_l/π) Y_lm(n), and all further layers are 0: what the estimator `path` converges to where V = 1. It is
//! taken where the solids are declared convex ([`Volume::is_convex`]), where the samples are those of a
//! linear function, and where [`Horizon::proves_open`] succeeds; see [`Shadowing`] for the ways to overrule that.

use super::path::{Settings, TexelEstimate};
use super::sums::clamped_cosine;
use crate::level::{Horizon, LevelField, Site};
use crate::sh;
use crate::volume::{Sample, Shadowing, Volume};

/// How it is decided which texels are open.
pub(super) enum Openness<'f, 'v, T> {
    /// All of them are.
    Everywhere,
    /// Those for which it is proven.
    Proven(Horizon<'f, 'v, T>),
    /// Not tested: every texel is traced.
    Unasked,
}

impl<'f, 'v, T: Sample> Openness<'f, 'v, T> {
    pub(super) fn of(volume: &Volume, field: &'f LevelField<'v, T>) -> Self {
        match volume.shadowing {
            Shadowing::Ignored => Self::Everywhere,
            Shadowing::Traced => Self::Unasked,
            Shadowing::Found => Self::found(volume, field),
        }
    }

    /// As [`Self::of`] for a pilot, which tells what a volume does to light: what is to be ignored it does not ignore.
    pub(super) fn of_pilot(volume: &Volume, field: &'f LevelField<'v, T>) -> Self {
        match volume.shadowing {
            Shadowing::Ignored => Self::found(volume, field),
            _ => Self::of(volume, field),
        }
    }

    /// No closed form.
    pub(super) fn unasked(_: &Volume, _: &'f LevelField<'v, T>) -> Self {
        Self::Unasked
    }

    fn found(volume: &Volume, field: &'f LevelField<'v, T>) -> Self {
        if volume.is_convex() || field.is_linear() { Self::Everywhere } else { Self::Proven(Horizon::new(field)) }
    }

    /// Whether nothing blocks the rays of a site.
    pub(super) fn admits(&self, site: &Site) -> bool {
        match self {
            Self::Everywhere => true,
            Self::Proven(horizon) => horizon.proves_open(site),
            Self::Unasked => false,
        }
    }
}

/// The transfer of a texel that nothing shades: no error and no rays.
pub(super) fn unoccluded(settings: &Settings, site: &Site, out: &mut TexelEstimate) {
    let layers = &settings.layers;
    let mut cosine = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
    clamped_cosine(layers.bands()[0], site.normal, &mut cosine);
    let direct = layers.bands()[0] * layers.bands()[0];
    let (mut transfer, mut stderr) = (std::mem::take(&mut out.transfer), std::mem::take(&mut out.stderr));
    transfer.clear();
    transfer.extend_from_slice(&cosine[..direct]);
    transfer.resize(layers.coefficients(), 0.0);
    stderr.clear();
    stderr.resize(layers.errors(), 0.0);
    *out = TexelEstimate { transfer, stderr, ..TexelEstimate::default() };
}
