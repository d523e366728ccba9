//! Points and parallel light in flat mirrors: no path finds them by chance, but each mirror shows an image of them.
//!
//! Light that reaches x by mirrors 1, …, n (1 is the nearest to x) comes straight from the luminaire to the image of x in 1, then
//! in 2, and so on to n. So the ray from x is known; it is followed and every part of it must be free. Exact for one mirror;
//! of several that see each other, chains of up to [`MOST_IN_A_ROW`] count, and the rest is left out.

use super::world::{Origin, Place, SceneCounts, World};
use crate::level::Counts;
use crate::scene::geometry::{FlatMirror, Geometry, LuminaireShape};
use crate::volume::Sample;
use glam::DVec3;

/// Most flat mirrors whose images are tried.
pub(super) const MOST_MIRRORS: usize = 6;
/// Most mirrors in a row.
const MOST_IN_A_ROW: usize = 3;

/// Whether light comes from one point or direction, so that no ray meets it by chance.
fn is_delta(shape: &LuminaireShape) -> bool {
    matches!(shape, LuminaireShape::Point { .. } | LuminaireShape::Directional { .. })
}

/// Luminaires that only images or photons find behind mirrors and glass.
pub(super) fn of_no_area(geometry: &Geometry) -> Vec<usize> {
    (0..geometry.luminaires().len()).filter(|&l| is_delta(&geometry.luminaires()[l].shape)).collect()
}

/// The mirrors whose images count; none where no luminaire needs them, or they cannot be used.
pub(super) fn mirrors(geometry: &Geometry) -> Vec<FlatMirror> {
    let needed = !of_no_area(geometry).is_empty();
    if needed {
        geometry.flat_mirrors().filter(|all| all.len() <= MOST_MIRRORS).unwrap_or_default()
    } else {
        Vec::new()
    }
}

/// Light of one luminaire that comes to a point by mirrors.
pub(super) struct Images<'a, 'w, T> {
    pub(super) world: &'a World<'w, T>,
    pub(super) isovalues: &'a [f32],
    pub(super) from: Origin,
    pub(super) luminaire: usize,
}

impl<T: Sample> Images<'_, '_, T> {
    /// Hands each arriving light, as its direction from the point and its value, to `add`.
    pub(super) fn each(&self, level: &mut Counts, counts: &mut SceneCounts, add: &mut dyn FnMut(DVec3, [f64; 3])) {
        if self.world.mirrors.is_empty() || !is_delta(&self.world.geometry.luminaires()[self.luminaire].shape) {
            return;
        }
        let mut chain = Vec::with_capacity(MOST_IN_A_ROW);
        self.extend(&mut chain, self.from.in_world, level, counts, add);
    }

    fn extend(
        &self,
        chain: &mut Vec<FlatMirror>,
        image: DVec3,
        level: &mut Counts,
        counts: &mut SceneCounts,
        add: &mut dyn FnMut(DVec3, [f64; 3]),
    ) {
        for mirror in &self.world.mirrors {
            if chain.last().is_some_and(|last| last.part == mirror.part) {
                continue;
            }
            chain.push(*mirror);
            let image = image - 2.0 * (image - mirror.point).dot(mirror.normal) * mirror.normal;
            if let Some((direction, value)) = self.follow(chain, image, level, counts) {
                counts.specular_hits += chain.len() as u64;
                add(direction, value);
            }
            if chain.len() < MOST_IN_A_ROW {
                self.extend(chain, image, level, counts, add);
            }
            chain.pop();
        }
    }

    /// Follows the ray that the image asks for; `None` where it is not free or misses a mirror.
    fn follow(
        &self,
        chain: &[FlatMirror],
        image: DVec3,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Option<(DVec3, [f64; 3])> {
        let geometry = self.world.geometry;
        let light = geometry.arriving(self.luminaire, image, [0.5; 2])?;
        let reflected = |d: DVec3, mirror: &FlatMirror| d - 2.0 * d.dot(mirror.normal) * mirror.normal;
        let first = chain.iter().rev().fold(light.direction, reflected);
        let (mut origin, mut direction, mut rest) = (self.from, first, light.distance);
        // Where the ray meets the mirrors is cheap: visibility comes after.
        let mut parts = Vec::with_capacity(chain.len() + 1);
        for mirror in chain {
            let own = if let Place::Wall(part) = origin.place { Some(part) } else { None };
            let distance = geometry.distance_to_part(mirror.part, origin.in_world, direction, own)?;
            parts.push((origin, direction, distance));
            origin = Origin { place: Place::Wall(mirror.part), in_world: origin.in_world + distance * direction };
            (direction, rest) = (reflected(direction, mirror), rest - distance);
        }
        if rest <= 0.0 {
            return None;
        }
        parts.push((origin, direction, rest));
        let free = parts.iter().all(|(origin, direction, distance)| {
            self.world.sees(self.isovalues, origin, Some(self.luminaire), *direction, *distance, level, counts)
        });
        if !free {
            return None;
        }
        let value = |c: usize| chain.iter().fold(light.value[c], |v, mirror| v * mirror.reflectance[c]);
        let mut value: [f64; 3] = std::array::from_fn(value);
        for (origin, direction, distance) in &parts {
            let through = self.world.media.transmittance(origin.in_world, *direction, *distance, counts);
            (0..3).for_each(|c| value[c] *= through[c]);
        }
        Some((first, value))
    }
}
