//! How a photon goes through a scene, from surface to surface, until it is gone.
//!
//! Power is reflected by the albedo of walls and level sets and split by Fresnel's equations at glass; the factor of radiance on
//! the ratio of the indices is none of its business. Russian roulette by the largest channel ends photons at walls, and at
//! level sets where it is asked for: what goes on keeps the power of its largest channel, so that photons stay alike.

use super::energy::{PhotonEnergy, tally};
use super::map::PhotonSettings;
use crate::geom::{Frame, Normal};
use crate::level::{CellPoint, Counts, Start};
use crate::sampling::{PathSampler, warp};
use crate::scene::geometry::Finish;
use crate::transport::scene_path::{Met, Origin, Place, SceneCounts, World, glass, specular_chain};
use crate::volume::Sample;
use glam::DVec3;

/// Pairs of random numbers of the first reflection; two for each. Those before it are of the source.
const REFLECTIONS: u32 = 4;
/// Reflections by walls and level sets after which a photon is cut.
const MOST_TURNS: u32 = 4096;

/// A photon as it leaves its source.
pub(super) struct Sent {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
    pub(super) flux: [f64; 3],
}

/// A photon where it meets the level set of the volume.
pub(super) struct Landing {
    pub(super) cell: CellPoint,
    /// As the map searches them.
    pub(super) normal: Normal,
    pub(super) flux: [f64; 3],
    pub(super) history: History,
}

/// What a photon has been through.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct History {
    /// Reflections by level sets.
    pub(super) bounces: u32,
    /// Reflections by level sets and diffuse walls.
    pub(super) turns: u32,
    /// Whether a mirror or glass was the first that it met.
    pub(super) began_specular: bool,
}

/// One photon on its way.
pub(super) struct Flight<'a, 'w, T> {
    pub(super) world: &'a World<'w, T>,
    pub(super) settings: &'a PhotonSettings,
    pub(super) sampler: &'a PathSampler,
    pub(super) index: u32,
    pub(super) isovalues: &'a [f32],
}

/// A place from which a photon goes on diffusely.
#[derive(Clone, Copy)]
enum Surface {
    /// A level set: its number, and where on it.
    Level(usize, CellPoint),
    Wall,
}

impl<T: Sample> Flight<'_, '_, T> {
    /// Follows a photon; calls for each meeting with the level set of the volume.
    pub(super) fn follow(
        &self,
        sent: Sent,
        energy: &mut PhotonEnergy,
        level: &mut Counts,
        land: &mut dyn FnMut(&mut PhotonEnergy, Landing),
    ) {
        let Sent { origin, mut direction, mut flux } = sent;
        let mut origin = Origin { place: Place::Free, in_world: origin };
        let (mut history, counts) = (History::default(), &mut SceneCounts::default());
        let (mut met_any, mut in_a_row) = (false, 0);
        let mut at: Option<(Surface, Normal)> = None;
        loop {
            let (surface, place, normal, albedo) =
                match self.world.meet(self.isovalues, &origin, direction, level, counts) {
                    Met::Nothing if met_any => return tally(&mut energy.escaped, flux),
                    Met::Nothing => return tally(&mut energy.missed, flux),
                    Met::Cut(_) => return tally(&mut energy.discarded, flux),
                    Met::Luminaire(_) => return tally(&mut energy.in_luminaires, flux),
                    // It meets the surface where it starts, as in the estimator `path`.
                    Met::Lost => match at {
                        Some((surface @ Surface::Level(set, _), normal)) => {
                            energy.lost += 1;
                            (surface, origin, normal, self.albedo(set))
                        }
                        _ => return tally(&mut energy.discarded, flux),
                    },
                    Met::Level(set, cell) => match self.world.normal(set, &cell) {
                        Some(normal) => {
                            let place = self.world.on_level(set, Start::on(cell));
                            (Surface::Level(set, cell), place, normal, self.albedo(set))
                        }
                        None => return tally(&mut energy.absorbed, flux),
                    },
                    Met::Wall(hit) => {
                        let in_world = origin.in_world + hit.distance * direction;
                        let place = Origin { place: Place::Wall(hit.part), in_world };
                        history.began_specular |= !met_any && hit.finish.is_specular();
                        met_any = true;
                        match hit.finish {
                            Finish::Diffuse(albedo) => {
                                let towards = if direction.dot(hit.normal) < 0.0 { hit.normal } else { -hit.normal };
                                match Normal::down_gradient(-towards.as_vec3()) {
                                    Some(normal) => (Surface::Wall, place, normal, albedo),
                                    None => return tally(&mut energy.in_walls, flux),
                                }
                            }
                            finish => {
                                let u = f64::from(
                                    self.sampler.pair(self.index, specular_chain::pair(history.turns, in_a_row))[0],
                                );
                                match finish {
                                    Finish::Glass(index) => direction = glass::turn(direction, hit.normal, index, u).0,
                                    _ => direction -= 2.0 * direction.dot(hit.normal) * hit.normal,
                                }
                                if let Finish::Mirror(share) = finish {
                                    let ends = specular_chain::survival(in_a_row, share);
                                    let after = std::array::from_fn(|c| match u < ends {
                                        true => flux[c] * f64::from(share[c]) / ends,
                                        false => 0.0,
                                    });
                                    tally(&mut energy.in_walls, std::array::from_fn(|c| flux[c] - after[c]));
                                    flux = after;
                                    if flux == [0.0; 3] {
                                        return;
                                    }
                                }
                                in_a_row += 1;
                                if in_a_row == specular_chain::MOST {
                                    return tally(&mut energy.cut, flux);
                                }
                                (origin, at) = (place, None);
                                continue;
                            }
                        }
                    }
                };
            met_any = true;
            let (mut is_level, mut survival) = (false, 1.0);
            if let Surface::Level(set, cell) = surface {
                is_level = true;
                if set == 0 {
                    // Searches compare it with smoothed ones.
                    let normal = self.world.smoothed_normal(0, &cell).unwrap_or(normal);
                    land(energy, Landing { cell, normal, flux, history });
                }
                if history.bounces == self.settings.most_bounces {
                    return tally(&mut energy.cut, flux);
                }
            }
            if history.turns == MOST_TURNS {
                return tally(&mut energy.cut, flux);
            }
            let pair = REFLECTIONS + 2 * history.turns;
            let mut after: [f64; 3] = std::array::from_fn(|c| flux[c] * f64::from(albedo[c]));
            if self.settings.roulette || !is_level {
                survival = largest(&after) / largest(&flux).max(f64::MIN_POSITIVE);
            }
            let survives = survival >= 1.0 || f64::from(self.sampler.pair(self.index, pair + 1)[0]) < survival;
            after = after.map(|f| if survives { f / survival } else { 0.0 });
            let taken = if is_level { &mut energy.absorbed } else { &mut energy.in_walls };
            tally(taken, std::array::from_fn(|c| flux[c] - after[c]));
            if !survives || after == [0.0; 3] {
                return;
            }
            flux = after;
            (history.turns, in_a_row) = (history.turns + 1, 0);
            history.bounces += u32::from(is_level);
            let local = warp::square_to_cosine_hemisphere(self.sampler.pair(self.index, pair));
            direction = Frame::around(normal).from_local(local).as_dvec3().normalize_or(DVec3::Z);
            (origin, at) = (place, Some((surface, normal)));
        }
    }

    /// Albedo of a level set.
    fn albedo(&self, set: usize) -> [f32; 3] {
        let tint = self.world.tint(set);
        std::array::from_fn(|c| self.settings.albedo[c] * tint[c])
    }
}

/// The largest channel, whatever its sign.
fn largest(flux: &[f64; 3]) -> f64 {
    flux.iter().fold(0.0, |m, f| m.max(f.abs()))
}
