//! What is kept of a photon: 36 bytes.

use super::tree::Node;
use crate::geom::{direction_from_octahedral, octahedral_from_direction};
use glam::Vec3;
use half::f16;

/// A photon where it met its level set.
///
/// The order of a [`super::tree::Tree`] stands in two bits of `flags`, so that the tree itself takes no memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub(super) struct Photon {
    /// Position in diagonals of the box from its centre, and γ times the isovalue in ranges of the samples.
    pub(super) point: [f32; 4],
    /// Flux-height as it arrives, of the channel that has the most (of either sign).
    pub(super) flux: f32,
    // Octahedral.
    normal: u32,
    // Octahedral direction to where in the environment it came from, or the number of the luminaire.
    source: u32,
    // Share of the channel that has the most.
    channels: [f16; 3],
    /// Reflections by level sets before this hit, 255 for more.
    pub(super) bounce: u8,
    // The coordinate by which the tree splits here, and whether it is of a luminaire.
    flags: u8,
}

const _: () = assert!(size_of::<Photon>() == 36);

/// Bits of the coordinate by which the tree splits.
const AXIS: u8 = 0b11;
/// It is of a luminaire.
const LUMINAIRE: u8 = 1 << 2;

/// Where a photon set out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Origin {
    /// Towards there in the environment.
    Environment(Vec3),
    /// The luminaire of this number.
    Luminaire(u32),
}

impl Node for Photon {
    #[inline(always)]
    fn point(&self) -> &[f32; 4] {
        &self.point
    }

    #[inline(always)]
    fn axis(&self) -> u8 {
        self.flags & AXIS
    }

    fn split_by(&mut self, axis: u8) {
        self.flags = self.flags & !AXIS | axis;
    }
}

impl Photon {
    /// One that arrives with a flux-height at a hit with `normal`.
    pub(super) fn new(point: [f32; 4], flux: [f64; 3], normal: Vec3, origin: Origin, bounces: u32) -> Self {
        let most = flux.into_iter().fold(0.0f64, |m, f| if f.abs() > m.abs() { f } else { m });
        let share = |c: usize| f16::from_f64(if most != 0.0 { flux[c] / most } else { 0.0 });
        let (source, of_luminaire) = match origin {
            Origin::Environment(towards) => (octahedral(towards), 0),
            Origin::Luminaire(l) => (l, LUMINAIRE),
        };
        Self {
            point,
            flux: most as f32,
            normal: octahedral(normal),
            source,
            channels: [share(0), share(1), share(2)],
            bounce: bounces.min(255) as u8,
            flags: of_luminaire,
        }
    }

    /// Flux-height of each channel.
    pub(super) fn flux_of(&self) -> [f64; 3] {
        self.channels.map(|share| share.to_f64() * f64::from(self.flux))
    }

    /// Unit normal of the level set at the hit.
    pub(super) fn normal(&self) -> Vec3 {
        from_octahedral(self.normal)
    }

    /// Where it set out.
    pub(super) fn origin(&self) -> Origin {
        match self.flags & LUMINAIRE {
            0 => Origin::Environment(from_octahedral(self.source)),
            _ => Origin::Luminaire(self.source),
        }
    }
}

/// A unit vector in 32 bits, off by at most 1e-4 (Meyer et al. 2010, "On floating-point normal vectors": the octahedral
/// map, rounded to nearest).
fn octahedral(v: Vec3) -> u32 {
    let code = |t: f32| ((t.clamp(-1.0, 1.0) * 32767.0).round() as i16) as u16;
    let [x, y] = octahedral_from_direction(v).map(code);
    u32::from(x) << 16 | u32::from(y)
}

fn from_octahedral(code: u32) -> Vec3 {
    let part = |bits: u32| f32::from(bits as u16 as i16) * (1.0 / 32767.0);
    direction_from_octahedral([part(code >> 16), part(code)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::warp;

    #[test]
    fn directions_and_channels_come_back() {
        for i in 0..4000u32 {
            let u = [i as f32 / 4000.0, (i as f32 * 0.618_034).fract()];
            let v = warp::square_to_uniform_sphere(u);
            let back = from_octahedral(octahedral(v));
            assert!((back - v).length() < 1e-4, "{v} {back}");
        }
        for v in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
            assert!((from_octahedral(octahedral(v)) - v).length() < 1e-6, "{v}");
        }
        let away = Origin::Environment(Vec3::Y);
        let photon = Photon::new([0.0; 4], [1e-9, 3e-5, 1.5e-5], Vec3::X, away, 1000);
        let found = photon.flux_of();
        for (found, expected) in found.iter().zip([1e-9, 3e-5, 1.5e-5]) {
            // Half precision, and its smallest number of the largest channel.
            assert!((found - expected).abs() < expected * 2f64.powi(-11) + 3e-5 * 2f64.powi(-25), "{found:?}");
        }
        assert_eq!(photon.bounce, 255);
        // An environment whose negatives are kept.
        let negative = Photon::new([0.0; 4], [-4.0, 1.0, 0.0], Vec3::X, away, 0);
        assert_eq!(negative.flux_of(), [-4.0, 1.0, 0.0]);
        assert_eq!(Photon::new([0.0; 4], [0.0; 3], Vec3::X, away, 0).flux_of(), [0.0; 3]);
    }

    #[test]
    fn where_a_photon_set_out_survives_the_tree() {
        for origin in [Origin::Luminaire(31), Origin::Luminaire(0), Origin::Environment(Vec3::Z)] {
            let mut photon = Photon::new([0.0; 4], [1.0; 3], Vec3::X, origin, 0);
            for axis in [3, 0, 2, 1] {
                photon.split_by(axis);
                assert_eq!((photon.axis(), photon.origin()), (axis, origin));
            }
        }
    }
}
