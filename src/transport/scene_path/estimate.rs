//! Paths of one texel through the level set, walls and luminaires.
//!
//! A path carries a weight W in red, green and blue: the albedos of the walls it met, without that of the level set.
//! While it has met its level set k times after the texel, whatever it finds belongs to layer k: the environment along ω
//! adds W·Y(ω) to T_k, light of a luminaire adds to that luminaire's G_k. So exitant radiance is
//! Σ_k ρ^(k+1) (⟨T_k, L⟩ + Σ_l s_l G_k,l) for every albedo ρ of the level set and every factor s_l on the power of a luminaire.
//! Meeting the level set for the (k+1)th time adds W to the group of emission.
//!
//! Level sets of partners count as the level set: its albedo is ρ times a fixed factor of each volume, which W carries, and
//! its emission is theirs, too.
//!
//! Every ray from a diffuse turn has the control variate of [`super::super::path`]: it adds −β W (Y(ω) − A(n)), β the share
//! of such rays of the other replicates that met nothing, by weight, of those of layer 0 and of all above.
//!
//! In media a path turns by the phase function, with W times the albedo of the medium; between turns W stays as it is where
//! they are grey, since the flight takes the light with its own probability, and follows [`super::scatter::InMedia`] elsewhere.
//! What a medium sends out belongs to the group of its luminaire.
//!
//! Luminaires are found in two ways, by sampling them and by the cosine, combined by the balance heuristic (Veach and Guibas
//! 1995, eq. 9). After a mirror or glass only the path itself finds them; points and parallel light are found by their images
//! in flat mirrors. Paths end after the last stored layer, or between
//! walls by Russian roulette on the largest channel of W. With a cache ([`Ahead`]) they end where they meet their own level set.

use super::super::REPLICATES;
use super::super::gather::{Ahead, Read};
use super::super::path::Settings;
use super::super::replay::{On, PathEnd, ReplayedPath};
use super::super::sums::clamped_cosine;
use super::body::Arrival;
use super::glass;
use super::images::Images;
use super::media::Collision;
use super::scatter::{Ended, InMedia, MOST_COLLISIONS, Scatter};
use super::specular_chain;
use super::world::{Met, Origin, Place, SceneCounts, World};
use crate::geom::{Affine, Normal};
use crate::level::{CellPoint, Counts, Site, Start};
use crate::sampling::PathSampler;
use crate::scene::geometry::{Finish, WallHit};
use crate::sh;
use crate::transfer::Layers;
use crate::volume::Sample;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Meetings with walls after which roulette begins.
const SURE_WALLS: u32 = 3;
/// A path between white walls would never end: after this many turns it is cut, and counted as lost.
pub const MOST_TURNS: u32 = 512;

/// What a texel's paths found: sums.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct Found {
    // [replicate][coefficient of the coloured layers].
    pub(super) environment: Vec<f64>,
    // Σ W (Y(ω) − A(n)) over all rays from diffuse turns, in the same order: 0 in the mean.
    pub(super) controls: Vec<f64>,
    // [replicate][in layer 0, above it]: Σ W over those rays, and over those that met nothing; means of the channels.
    pub(super) rays: [[[f64; 2]; 2]; REPLICATES],
    // [group: emission, then luminaires][replicate][3·layer + channel].
    pub(super) groups: Vec<f64>,
    pub(super) lost: u32,
    pub(super) trapped: u32,
    /// What was looked up of a cache.
    pub(in super::super) read: Read,
    /// The paths step by step, where they are replayed.
    pub(super) record: Option<Record>,
}

impl Found {
    pub(super) fn reset(&mut self, layers: &Layers, luminaires: usize) {
        for sums in [&mut self.environment, &mut self.controls] {
            sums.clear();
            sums.resize(REPLICATES * layers.coefficients(), 0.0);
        }
        self.rays = Default::default();
        self.groups.clear();
        self.groups.resize((1 + luminaires) * REPLICATES * 3 * layers.len(), 0.0);
        (self.lost, self.trapped) = (0, 0);
    }
}

/// The paths of a texel, step by step.
#[derive(Clone, Debug)]
pub(super) struct Record {
    pub(super) grid_from_world: Affine,
    pub(super) paths: Vec<ReplayedPath>,
}

impl Found {
    fn last(&mut self) -> Option<(&Affine, &mut ReplayedPath)> {
        let record = self.record.as_mut()?;
        Some((&record.grid_from_world, record.paths.last_mut()?))
    }

    fn began(&mut self, replicate: usize, path: u32, in_world: DVec3) {
        let Some(record) = &mut self.record else { return };
        let start = record.grid_from_world.point(in_world).as_vec3().to_array();
        record.paths.push(ReplayedPath::new(replicate, path, start));
    }

    fn aimed(&mut self, direction: DVec3) {
        if let Some((_, path)) = self.last() {
            path.last_direction_in_world = direction.as_vec3().to_array();
        }
    }

    pub(super) fn turned(&mut self, on: On, in_world: DVec3) {
        if let Some((grid_from_world, path)) = self.last() {
            path.vertices_in_grid.push(grid_from_world.point(in_world).as_vec3().to_array());
            path.on.push(on);
        }
    }

    pub(super) fn ended(&mut self, end: PathEnd) {
        if let Some((_, path)) = self.last() {
            path.ended = end;
        }
    }
}

/// A path at a point where it turns, diffusely or in a medium.
#[derive(Clone, Copy)]
struct Turn {
    origin: Origin,
    scatter: Scatter,
}

/// One path on its way.
pub(super) struct Path<'a, 'w, T> {
    pub(super) world: &'a World<'w, T>,
    settings: &'a Settings,
    caustics: bool,
    ahead: Option<&'a Ahead<'a>>,
    pub(super) isovalues: &'a [f32],
    pub(super) sampler: &'a PathSampler,
    replicate: usize,
    pub(super) index: u32,
    layer: usize,
    pub(super) weight: [f64; 3],
    walls: u32,
    pub(super) in_media: InMedia,
    pub(super) in_body: InMedia,
    // Collisions within the body, where its albedo is free.
    pub(super) orders: i32,
    // Steps within the body so far: which random numbers are next.
    pub(super) steps: u32,
}

/// Traces the paths `range` of every replicate from a site, and adds them to what was found.
pub(super) fn trace<T: Sample>(
    world: &World<'_, T>,
    site: &Site,
    isovalues: &[f32],
    item: u64,
    range: Range<usize>,
    settings: &Settings,
    caustics: bool,
    ahead: Option<&Ahead<'_>>,
    found: &mut Found,
    level: &mut Counts,
    counts: &mut SceneCounts,
) {
    let scatter = match world.body {
        Some(_) => Scatter::Body(site.normal),
        None => Scatter::Surface(site.normal),
    };
    let turn = Turn { origin: world.on_level(0, site.start), scatter };
    let tint = world.tint(0).map(f64::from);
    for replicate in 0..REPLICATES {
        let sampler = PathSampler::new(settings.seed, item, replicate as u32);
        for index in range.start as u32..range.end as u32 {
            let mut path = Path {
                world,
                settings,
                caustics,
                ahead,
                isovalues,
                sampler: &sampler,
                replicate,
                index,
                layer: 0,
                weight: tint,
                walls: 0,
                in_media: InMedia::new(&world.media, &sampler, index),
                in_body: InMedia::of_body(world.body.as_ref().map(|body| &body.media), &sampler, index),
                orders: 0,
                steps: 0,
            };
            found.began(replicate, index, turn.origin.in_world);
            path.run(turn, found, level, counts);
        }
    }
}

impl<T: Sample> Path<'_, '_, T> {
    /// Pairs of random numbers of one turn: the direction, one a luminaire, the roulette.
    fn pairs(&self) -> u32 {
        2 + self.world.geometry.luminaires().len() as u32
    }

    fn pair(&self, turn: u32, which: u32) -> [f32; 2] {
        self.sampler.pair(self.index, turn * self.pairs() + which)
    }

    /// The variate of a mirror or glass.
    fn chance(&self, turn: u32, in_a_row: u32) -> f64 {
        f64::from(self.sampler.pair(self.index, specular_chain::pair(turn, in_a_row))[0])
    }

    fn run(&mut self, mut at: Turn, found: &mut Found, level: &mut Counts, counts: &mut SceneCounts) {
        let most = if self.world.media.is_empty() { MOST_TURNS } else { MOST_TURNS + MOST_COLLISIONS };
        for turn in 0..most {
            self.sample_luminaires(&at, turn, found, level, counts);
            match self.follow(&at, turn, found, level, counts) {
                Some(next) => at = next,
                None => return,
            }
        }
        counts.lost_turns += 1;
        found.ended(PathEnd::TooLong);
    }

    /// Adds to a layer of a group: 0 for emission, 1 + l for luminaire l.
    fn add(&self, found: &mut Found, group: usize, value: [f64; 3], factor: f64) {
        let layers = self.settings.layers.len();
        let first = 3 * (group * REPLICATES + self.replicate) * layers;
        let weight = self.carried();
        self.each_layer(|layer, share| {
            for c in 0..3 {
                found.groups[first + 3 * layer + c] += weight[c] * value[c] * factor * share;
            }
        });
    }

    /// The layers that what the path finds belongs to: that of its reflections, or, of a body whose albedo is free, all nodes, each
    /// with the albedo of its node to the number of collisions.
    fn each_layer(&self, mut add: impl FnMut(usize, f64)) {
        match self.world.body.as_ref().map(|body| body.nodes()) {
            Some(nodes) if !nodes.is_empty() => {
                nodes.iter().enumerate().for_each(|(q, albedo)| add(q, albedo.powi(self.orders)));
            }
            _ => add(self.layer, 1.0),
        }
    }

    /// What the path is worth in each channel.
    pub(super) fn carried(&self) -> [f64; 3] {
        self.in_body.carried(self.in_media.carried(self.weight))
    }

    fn sample_luminaires(&self, at: &Turn, turn: u32, found: &mut Found, level: &mut Counts, counts: &mut SceneCounts) {
        if matches!(at.scatter, Scatter::Body(_)) {
            return;
        }
        for l in 0..self.world.geometry.luminaires().len() {
            if self.caustics {
                let images = Images { world: self.world, isovalues: self.isovalues, from: at.origin, luminaire: l };
                images.each(level, counts, &mut |direction, value| {
                    let density = at.scatter.density(&self.world.media, direction);
                    if density > 0.0 {
                        self.add(found, 1 + l, value, density);
                    }
                });
            }
            let u = self.pair(turn, 1 + l as u32);
            let Some(light) = self.world.geometry.arriving(l, at.origin.in_world, u) else { continue };
            let by_turn = at.scatter.density(&self.world.media, light.direction);
            if by_turn <= 0.0
                || !self.world.sees(self.isovalues, &at.origin, Some(l), light.direction, light.distance, level, counts)
            {
                continue;
            }
            let share = light.density.map_or(1.0, |density| density / (density + by_turn));
            let through = self.world.media.transmittance(at.origin.in_world, light.direction, light.distance, counts);
            self.add(found, 1 + l, std::array::from_fn(|c| light.value[c] * through[c]), by_turn * share);
        }
    }

    /// Follows a ray that the turn draws to the next one, diffuse or in a medium; `None` where the path ends.
    fn follow(
        &mut self,
        at: &Turn,
        turn: u32,
        found: &mut Found,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Option<Turn> {
        let (mut direction, by_turn) = at.scatter.sample(&self.world.media, self.pair(turn, 0));
        let controlled = if let Scatter::Surface(normal) = at.scatter {
            self.control(normal, direction.as_vec3(), found);
            true
        } else {
            false
        };
        // Density of the direction, while the path has met nothing specular since.
        let mut density = Some(by_turn);
        let mut origin = at.origin;
        if let (Scatter::Body(normal), Place::Level(_, start)) = (at.scatter, at.origin.place) {
            // It leaves along the direction: against the light it comes from there.
            let arrival = Arrival { start, normal: normal.vec().as_dvec3(), direction: -direction };
            (origin, direction) = self.at_body(arrival, found, level, counts)?;
            density = None;
        }
        for in_a_row in 0..specular_chain::MOST {
            found.aimed(direction);
            let met = self.world.meet(self.isovalues, &origin, direction, level, counts);
            if !self.world.media.is_empty() {
                let ray = (origin.in_world, direction, self.world.distance_to(&met, &origin, direction));
                let source = (self.sampler, self.index);
                if let Some(collision) = self.in_media.fly(&self.world.media, ray, source, (turn, in_a_row), counts) {
                    return self.in_medium(collision, &origin, direction, turn, found);
                }
            }
            match met {
                Met::Nothing => {
                    self.see_distant(density, direction, found);
                    self.escape(direction.as_vec3(), found);
                    if density.is_some() && controlled {
                        found.rays[self.replicate][self.layer.min(1)][1] += self.mean_weight();
                    }
                    found.ended(PathEnd::Escaped);
                    return None;
                }
                // The cut through a translucent solid is open.
                Met::Cut(distance) if self.world.body.is_some() => {
                    let point = origin.in_world + distance * direction;
                    (origin, direction) = self.within_body(point, None, direction, found, level, counts)?;
                    density = None;
                }
                Met::Cut(_) => {
                    counts.cut += 1;
                    found.ended(PathEnd::Cut);
                    return None;
                }
                Met::Luminaire(hit) => {
                    counts.luminaire_hits += 1;
                    found.ended(PathEnd::Luminaire(hit.luminaire));
                    let point = origin.in_world + hit.distance * direction;
                    let cosine = self.world.geometry.light_cosine(hit.luminaire, point, direction);
                    let share = self.share(density, hit.luminaire, &origin, hit.distance, cosine)?;
                    self.add(found, 1 + hit.luminaire, hit.radiance, share);
                    return None;
                }
                Met::Lost => {
                    found.lost += 1;
                    if self.world.body.is_some() {
                        found.ended(PathEnd::Lost);
                        return None;
                    }
                    let Place::Level(set, start) = origin.place else {
                        counts.cut += 1;
                        found.ended(PathEnd::Cut);
                        return None;
                    };
                    if set == 0 && self.ends_at(&start.at, found) {
                        return None;
                    }
                    found.turned(On::LevelSet(set), origin.in_world);
                    return self.on_level_again(set, found).then_some(*at);
                }
                Met::Level(0, cell) if self.world.body.is_some() => {
                    let Some(normal) = self.world.normal(0, &cell) else {
                        found.lost += 1;
                        found.ended(PathEnd::Lost);
                        return None;
                    };
                    found.turned(On::LevelSet(0), self.world.placement.in_world(&cell));
                    let arrival = Arrival { start: Start::on(cell), normal: normal.vec().as_dvec3(), direction };
                    (origin, direction) = self.at_body(arrival, found, level, counts)?;
                    density = None;
                }
                Met::Level(set, cell) => return self.at_level(set, cell, found),
                Met::Wall(hit) => {
                    let point = origin.in_world + hit.distance * direction;
                    self.shine(&hit, density, &origin, direction, found);
                    found.turned(On::Wall(hit.part), point);
                    match hit.finish {
                        Finish::Diffuse(albedo) => {
                            let next = self.at_wall(&hit, albedo, point, direction, turn);
                            counts.wall_hits += u64::from(next.is_some());
                            if next.is_none() {
                                found.ended(PathEnd::Absorbed);
                            }
                            return next;
                        }
                        Finish::Mirror(share) => {
                            let survival = specular_chain::survival(in_a_row, share);
                            if survival < 1.0 && self.chance(turn, in_a_row) >= survival {
                                found.ended(PathEnd::Absorbed);
                                return None;
                            }
                            direction -= 2.0 * direction.dot(hit.normal) * hit.normal;
                            (0..3).for_each(|c| self.weight[c] *= f64::from(share[c]) / survival);
                        }
                        Finish::Glass(index) => {
                            let u = self.chance(turn, in_a_row);
                            let (next, factor) = glass::turn(direction, hit.normal, index, u);
                            direction = next;
                            self.weight = self.weight.map(|w| w * factor);
                        }
                    }
                    counts.specular_hits += 1;
                    density = None;
                    origin = Origin { place: Place::Wall(hit.part), in_world: point };
                }
            }
        }
        counts.lost_specular += 1;
        found.ended(PathEnd::TooLong);
        None
    }

    /// Weight of light that the path itself found; `None` where it is left to others or switched off.
    fn share(&self, density: Option<f64>, l: usize, from: &Origin, distance: f64, cosine: f64) -> Option<f64> {
        match density {
            Some(by_cosine) => {
                let by_light = self.world.geometry.light_density(l, from.in_world, distance, cosine);
                (by_cosine > 0.0).then(|| by_cosine / (by_cosine + by_light))
            }
            None => self.caustics.then_some(1.0),
        }
    }

    /// Light of a wall that shines.
    fn shine(&self, hit: &WallHit, density: Option<f64>, from: &Origin, direction: DVec3, found: &mut Found) {
        let cosine = -direction.dot(hit.normal);
        let Some(l) = hit.luminaire.filter(|_| cosine > 0.0) else { return };
        if let Some(share) = self.share(density, l, from, hit.distance, cosine) {
            self.add(found, 1 + l, self.world.geometry.wall_radiance(l), share);
        }
    }

    /// Light of environments among the luminaires, where nothing is in the way.
    fn see_distant(&self, density: Option<f64>, direction: DVec3, found: &mut Found) {
        self.world.geometry.each_distant(direction, &mut |l, radiance, by_light| {
            let share = match density {
                Some(by_cosine) if by_cosine > 0.0 => by_cosine / (by_cosine + by_light),
                Some(_) => 0.0,
                None => f64::from(u8::from(self.caustics)),
            };
            self.add(found, 1 + l, radiance, share);
        });
    }

    fn escape(&self, direction: Vec3, found: &mut Found) {
        let bands = self.settings.layers.bands()[self.layer];
        let mut basis = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
        sh::basis::evaluate_f32(bands, direction, &mut basis);
        self.add_vector(&basis[..bands * bands], &mut found.environment);
    }

    /// Counts a ray along `direction` from a turn with `normal` for the control variate.
    fn control(&self, normal: Normal, direction: Vec3, found: &mut Found) {
        if self.settings.positive {
            return;
        }
        found.rays[self.replicate][self.layer.min(1)][0] += self.mean_weight();
        let bands = self.settings.layers.bands()[self.layer];
        let (mut basis, mut expected) =
            ([0.0f32; sh::MAX_BANDS * sh::MAX_BANDS], [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS]);
        sh::basis::evaluate_f32(bands, direction, &mut basis);
        clamped_cosine(bands, normal, &mut expected);
        for (y, expected) in basis.iter_mut().zip(&expected) {
            *y -= expected;
        }
        self.add_vector(&basis[..bands * bands], &mut found.controls);
    }

    /// Adds the path's weight times `values` to its layer of `sums`.
    fn add_vector(&self, values: &[f32], sums: &mut [f64]) {
        let (layers, carried) = (&self.settings.layers, self.carried());
        self.each_layer(|layer, share| {
            let first = self.replicate * layers.coefficients() + layers.offset(layer);
            for (sums, weight) in sums[first..].chunks_exact_mut(values.len()).zip(carried) {
                for (sum, y) in sums.iter_mut().zip(values) {
                    *sum += weight * share * f64::from(*y);
                }
            }
        });
    }

    fn mean_weight(&self) -> f64 {
        self.carried().iter().sum::<f64>() / 3.0
    }

    /// A meeting with a medium: what it sends out there, and how the path goes on.
    fn in_medium(
        &mut self,
        collision: Collision,
        from: &Origin,
        direction: DVec3,
        turn: u32,
        found: &mut Found,
    ) -> Option<Turn> {
        let Collision { distance, medium, albedo, .. } = collision;
        if let Some((l, radiance)) = self.world.media.glow(medium) {
            self.add(found, 1 + l, std::array::from_fn(|c| radiance[c] * (1.0 - albedo[c])), 1.0);
        }
        (0..3).for_each(|c| self.weight[c] *= albedo[c]);
        let largest = self.carried().into_iter().fold(0.0, f64::max);
        let point = from.in_world + distance * direction;
        found.turned(On::Medium(medium), point);
        let outcome = self.in_media.collided(largest, self.pair(turn, self.pairs() - 1)[1]);
        self.go_on(outcome, found)?;
        let origin = Origin { place: Place::Medium, in_world: point };
        Some(Turn { origin, scatter: Scatter::Medium { onward: direction, medium } })
    }

    /// Divides the weight by the chance to survive a collision; `None` where the path ended by it.
    pub(super) fn go_on(&mut self, outcome: Result<f64, Ended>, found: &mut Found) -> Option<()> {
        match outcome {
            Ok(survival) => {
                self.weight = self.weight.map(|w| w / survival);
                return Some(());
            }
            Err(Ended::Absorbed) => found.ended(PathEnd::Absorbed),
            Err(Ended::Trapped) => {
                found.trapped += 1;
                found.ended(PathEnd::Trapped);
            }
        }
        None
    }

    /// Counts a meeting with a level set; whether the path goes on in the next layer.
    fn on_level_again(&mut self, set: usize, found: &mut Found) -> bool {
        self.add(found, 0, [1.0; 3], 1.0);
        let tint = self.world.tint(set);
        (0..3).for_each(|c| self.weight[c] *= f64::from(tint[c]));
        self.layer += 1;
        let goes_on = self.layer < self.settings.layers.len();
        found.trapped += u32::from(!goes_on);
        if !goes_on {
            found.ended(PathEnd::Trapped);
        }
        goes_on
    }

    /// Ends the path at a point of the volume's level set where a cache says what it would find from there on.
    fn ends_at(&self, at: &CellPoint, found: &mut Found) -> bool {
        let Some(ahead) = self.ahead else { return false };
        let Found { environment, groups, read, .. } = found;
        let ends = ahead.add(at, (self.layer + 1, self.replicate), self.carried(), environment, groups, read);
        if ends {
            self.add(found, 0, [1.0; 3], 1.0);
        }
        ends
    }

    fn at_level(&mut self, set: usize, cell: CellPoint, found: &mut Found) -> Option<Turn> {
        if set == 0 && self.ends_at(&cell, found) {
            return None;
        }
        let Some(normal) = self.world.normal(set, &cell) else {
            found.lost += 1;
            found.ended(PathEnd::Lost);
            return None;
        };
        let start = Start::on(cell);
        if found.record.is_some() {
            found.turned(On::LevelSet(set), self.world.on_level(set, start).in_world);
        }
        self.on_level_again(set, found)
            .then(|| Turn { origin: self.world.on_level(set, start), scatter: Scatter::Surface(normal) })
    }

    fn at_wall(&mut self, hit: &WallHit, albedo: [f32; 3], point: DVec3, direction: DVec3, turn: u32) -> Option<Turn> {
        for c in 0..3 {
            self.weight[c] *= f64::from(albedo[c]);
        }
        let largest = self.carried().into_iter().fold(0.0, f64::max);
        if largest <= 0.0 {
            return None;
        }
        self.walls += 1;
        if self.walls > SURE_WALLS {
            let survive = largest.min(0.95);
            if f64::from(self.pair(turn, self.pairs() - 1)[0]) >= survive {
                return None;
            }
            self.weight = self.weight.map(|w| w / survive);
        }
        let towards = if direction.dot(hit.normal) < 0.0 { hit.normal } else { -hit.normal };
        // A normal points down a gradient.
        let normal = Normal::down_gradient(-towards.as_vec3())?;
        let origin = Origin { place: Place::Wall(hit.part), in_world: point };
        Some(Turn { origin, scatter: Scatter::Surface(normal) })
    }
}
