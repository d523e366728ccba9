//! What a ray meets: the level set of its isovalue, the walls, or the luminaires.
//!
//! The level set is followed inside the box of the volume by [`LevelField::trace`]; a ray that leaves the box never
//! comes back to it but by a wall. Walls and luminaires are met anywhere. Where a ray enters the box from outside in the
//! solid it meets the cut through it, which is black: the solid has no surface there.
//!
//! Walls flush with a face of the box count as outside: for walls, points of the level set lie at least [`INSIDE`] of a cell
//! within the box.

use crate::geom::{Affine, Normal};
use crate::level::{CellPoint, Counts, LevelField, Outcome, Start};
use crate::scene::geometry::{Geometry, LightHit, WallHit};
use crate::volume::{Sample, Volume};
use glam::DVec3;

/// Distance from the faces of the box within which points of the level set do not come for walls, in cells.
const INSIDE: f64 = 1.0 / 1024.0;

/// A place where paths turn.
#[derive(Clone, Copy)]
pub(super) enum Place {
    /// On the level set.
    Level(Start),
    /// On a part of a wall.
    Wall(u32),
    /// Anywhere else: luminaires, cameras.
    Free,
}

/// Where a ray starts.
#[derive(Clone, Copy)]
pub(super) struct Origin {
    pub(super) place: Place,
    pub(super) in_world: DVec3,
}

/// What a ray meets first.
pub(super) enum Met {
    /// The environment.
    Nothing,
    /// Its level set.
    Level(CellPoint, f64),
    /// The facet under a smoothed normal, or solid around a wall.
    Lost,
    /// A cut through the solid at the border of the box.
    Cut,
    Wall(WallHit),
    Luminaire(LightHit),
}

/// Work by kind of ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneCounts {
    /// Rays of paths.
    pub path_rays: u64,
    /// Rays to luminaires.
    pub light_rays: u64,
    /// Rays that were tried against walls, of both kinds.
    pub wall_rays: u64,
    /// Paths' meetings with diffuse walls from which they go on.
    pub wall_hits: u64,
    /// Paths' meetings with mirrors and glass.
    pub specular_hits: u64,
    /// Paths that ended on a luminaire.
    pub luminaire_hits: u64,
    /// Paths that ended on a cut through the solid, or inside it.
    pub cut: u64,
}

impl SceneCounts {
    /// Rays of paths that go on from walls.
    pub fn wall_rays_started(&self) -> u64 {
        self.wall_hits + self.specular_hits
    }
}

impl std::ops::AddAssign for SceneCounts {
    fn add_assign(&mut self, other: Self) {
        self.path_rays += other.path_rays;
        self.light_rays += other.light_rays;
        self.wall_rays += other.wall_rays;
        self.wall_hits += other.wall_hits;
        self.specular_hits += other.specular_hits;
        self.luminaire_hits += other.luminaire_hits;
        self.cut += other.cut;
    }
}

/// All that a ray can meet.
pub(super) struct World<'a, T> {
    pub(super) field: &'a LevelField<'a, T>,
    pub(super) geometry: &'a Geometry,
    world_from_grid: Affine,
    grid_from_world: Affine,
    last: DVec3,
}

impl<'a, T: Sample> World<'a, T> {
    pub(super) fn new(volume: &Volume, field: &'a LevelField<'a, T>, geometry: &'a Geometry) -> Self {
        let world_from_grid = *volume.world_from_grid();
        let last = DVec3::from_array(volume.dims().map(|d| (d - 1) as f64));
        Self { field, geometry, world_from_grid, grid_from_world: world_from_grid.inverse(), last }
    }

    /// A start on the level set and its place in world.
    pub(super) fn on_level(&self, start: Start) -> Origin {
        let in_grid = start.at.cell.as_dvec3() + start.at.local.as_dvec3();
        let within = in_grid.clamp(DVec3::splat(INSIDE), self.last - INSIDE);
        Origin { place: Place::Level(start), in_world: self.world_from_grid.point(within) }
    }

    /// Outward normal of a point of the level set.
    pub(super) fn normal(&self, at: &CellPoint) -> Option<Normal> {
        self.field.normal(at)
    }

    /// The first thing on a ray of unit direction.
    pub(super) fn meet(
        &self,
        isovalue: f32,
        from: &Origin,
        direction: DVec3,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Met {
        counts.path_rays += 1;
        let met = self.level_along(isovalue, from, direction, level);
        let limit = match &met {
            Met::Level(_, distance) => *distance,
            Met::Lost => return Met::Lost,
            Met::Cut => self.cut_distance(from.in_world, direction),
            _ => f64::INFINITY,
        };
        let own = if let Place::Wall(part) = from.place { Some(part) } else { None };
        let mut nearest = limit;
        let mut found = met;
        if self.geometry.parts() > 0 {
            counts.wall_rays += 1;
            if let Some(hit) = self.geometry.first_wall(from.in_world, direction, own, limit) {
                nearest = hit.distance;
                found = Met::Wall(hit);
            }
        }
        match self.geometry.first_luminaire(from.in_world, direction, nearest) {
            Some(hit) if hit.distance < limit => Met::Luminaire(hit),
            _ => found,
        }
    }

    /// Whether light of luminaire `l` reaches a point along a direction from a distance.
    pub(super) fn sees(
        &self,
        isovalue: f32,
        from: &Origin,
        l: usize,
        direction: DVec3,
        distance: f64,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> bool {
        counts.light_rays += 1;
        let own = if let Place::Wall(part) = from.place { Some(part) } else { None };
        if self.geometry.parts() > 0 {
            counts.wall_rays += 1;
            if self.geometry.is_walled(from.in_world, direction, own, distance) {
                return false;
            }
        }
        if self.geometry.is_shaded_by_luminaires(l, from.in_world, direction, distance) {
            return false;
        }
        match self.level_along(isovalue, from, direction, level) {
            Met::Nothing => true,
            Met::Level(_, hit) => hit >= distance,
            Met::Cut => self.cut_distance(from.in_world, direction) >= distance,
            _ => false,
        }
    }

    /// What the level set alone does to a ray.
    fn level_along(&self, isovalue: f32, from: &Origin, direction: DVec3, counts: &mut Counts) -> Met {
        let start = match from.place {
            Place::Level(start) => start,
            _ => match self.enter(isovalue, from.in_world, direction) {
                Ok(start) => start,
                Err(met) => return met,
            },
        };
        match self.field.trace(isovalue, &start, self.field.direction_in_grid(direction.as_vec3()), counts) {
            Outcome::Escaped => Met::Nothing,
            Outcome::Lost => Met::Lost,
            Outcome::Hit(hit) => {
                let in_grid = hit.at.cell.as_dvec3() + hit.at.local.as_dvec3();
                let distance = (self.world_from_grid.point(in_grid) - from.in_world).dot(direction);
                Met::Level(hit.at, distance.max(0.0))
            }
        }
    }

    /// Where a ray from outside the level set enters the box, or why it does not.
    fn enter(&self, isovalue: f32, origin: DVec3, direction: DVec3) -> Result<Start, Met> {
        let (enter, _) = self.span(origin, direction).ok_or(Met::Nothing)?;
        let (o, d) = (self.grid_from_world.point(origin), self.grid_from_world.vector(direction));
        let at = self.field.locate((o + enter * d).to_array());
        let is_solid = self.field.sign() * (self.field.raw_value(&at) - isovalue) > 0.0;
        match (is_solid, enter > 0.0) {
            (false, _) => Ok(Start::beside(at)),
            (true, true) => Err(Met::Cut),
            (true, false) => Err(Met::Lost),
        }
    }

    /// Distances at which a ray enters and leaves the box; `None` if it does not meet it.
    fn span(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (o, d) = (self.grid_from_world.point(origin), self.grid_from_world.vector(direction));
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            if d[a] == 0.0 {
                if o[a] < 0.0 || o[a] > self.last[a] {
                    return None;
                }
                continue;
            }
            let (t0, t1) = ((0.0 - o[a]) / d[a], (self.last[a] - o[a]) / d[a]);
            enter = enter.max(t0.min(t1));
            leave = leave.min(t0.max(t1));
        }
        (enter < leave).then_some((enter, leave))
    }

    fn cut_distance(&self, origin: DVec3, direction: DVec3) -> f64 {
        self.span(origin, direction).map_or(f64::INFINITY, |(enter, _)| enter)
    }
}
