//! A level set where it stands in the world: how rays enter the box of its volume, and what becomes of them there.

use crate::geom::{Affine, Normal};
use crate::level::{CellPoint, Counts, LevelField, Outcome, Start};
use crate::volume::{Sample, Volume};
use glam::DVec3;

/// Distance from the faces of the box within which points of the level set do not come for others, in cells.
const INSIDE: f64 = 1.0 / 1024.0;

/// What one level set does to a ray.
pub(super) enum Along {
    Nothing,
    /// Where it is met, and how far from the origin.
    Hit(CellPoint, f64),
    /// The start is in the solid, or under a smoothed normal.
    Lost,
    /// The ray enters the box in the solid, this far from the origin.
    Cut(f64),
}

/// Where a ray starts, seen from a level set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum On {
    /// On it.
    Surface(Start),
    /// On its lit side, up to rounding: between surfaces, where a path turned in a medium.
    Lit,
    /// Anywhere.
    Anywhere,
}

/// The maps between a volume's grid and the world, in double precision.
pub(super) struct Placement {
    world_from_grid: Affine,
    grid_from_world: Affine,
    last: DVec3,
}

impl Placement {
    pub(super) fn new(volume: &Volume) -> Self {
        let world_from_grid = *volume.world_from_grid();
        let last = DVec3::from_array(volume.dims().map(|d| (d - 1) as f64));
        Self { world_from_grid, grid_from_world: world_from_grid.inverse(), last }
    }

    /// A point of the level set in world, within the box.
    pub(super) fn on_level(&self, start: &Start) -> DVec3 {
        let in_grid = start.at.cell.as_dvec3() + start.at.local.as_dvec3();
        self.world_from_grid.point(in_grid.clamp(DVec3::splat(INSIDE), self.last - INSIDE))
    }

    /// A point of the grid in world.
    pub(super) fn in_world(&self, at: &CellPoint) -> DVec3 {
        self.world_from_grid.point(at.cell.as_dvec3() + at.local.as_dvec3())
    }

    /// A point and a direction of the world in grid space.
    pub(super) fn in_grid(&self, point: DVec3, direction: DVec3) -> (DVec3, DVec3) {
        (self.grid_from_world.point(point), self.grid_from_world.vector(direction))
    }

    /// Distances at which a ray enters and leaves the box; `None` if it does not meet it.
    pub(super) fn span(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
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

    /// What the level set alone does to a ray before `limit`.
    pub(super) fn along<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        isovalue: f32,
        on: On,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        counts: &mut Counts,
    ) -> Along {
        let start = match on {
            On::Surface(start) => start,
            On::Anywhere | On::Lit => {
                let Some((enter, _)) = self.span(origin, direction).filter(|(enter, _)| *enter < limit) else {
                    return Along::Nothing;
                };
                let (o, d) = (self.grid_from_world.point(origin), self.grid_from_world.vector(direction));
                let at = field.locate((o + enter * d).to_array());
                let is_solid = field.sign() * (field.raw_value(&at) - isovalue) > 0.0;
                match (is_solid && (on != On::Lit || enter > 0.0), enter > 0.0) {
                    (false, _) => Start::beside(at),
                    (true, true) => return Along::Cut(enter),
                    (true, false) => return Along::Lost,
                }
            }
        };
        match field.trace(isovalue, &start, field.direction_in_grid(direction.as_vec3()), counts) {
            Outcome::Escaped => Along::Nothing,
            Outcome::Lost => Along::Lost,
            Outcome::Hit(hit) => {
                let in_grid = hit.at.cell.as_dvec3() + hit.at.local.as_dvec3();
                let distance = (self.world_from_grid.point(in_grid) - origin).dot(direction);
                Along::Hit(hit.at, distance.max(0.0))
            }
        }
    }

    /// Whether a point of the world lies in the box and in the solid.
    fn buries<T: Sample>(&self, field: &LevelField<'_, T>, isovalue: f32, point: DVec3) -> bool {
        let in_grid = self.grid_from_world.point(point);
        let inside = in_grid.cmpge(DVec3::ZERO).all() && in_grid.cmple(self.last).all();
        inside && field.sign() * (field.raw_value(&field.locate(in_grid.to_array())) - isovalue) > 0.0
    }
}

/// The level set of a partner, whatever the type of its samples.
pub(super) trait PartnerSet: Sync {
    fn place(&self) -> &Placement;
    fn meet_along(
        &self,
        isovalue: f32,
        on: On,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        counts: &mut Counts,
    ) -> Along;
    fn smoothed_normal_at(&self, at: &CellPoint) -> Option<Normal>;
    fn normal_at(&self, at: &CellPoint) -> Option<Normal>;
    fn is_buried(&self, isovalue: f32, point: DVec3) -> bool;
}

/// A field and where it stands.
pub(super) struct Standing<'a, T> {
    pub(super) field: LevelField<'a, T>,
    pub(super) placement: Placement,
}

impl<T: Sample> PartnerSet for Standing<'_, T> {
    fn place(&self) -> &Placement {
        &self.placement
    }

    fn meet_along(
        &self,
        isovalue: f32,
        on: On,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        counts: &mut Counts,
    ) -> Along {
        self.placement.along(&self.field, isovalue, on, origin, direction, limit, counts)
    }

    fn smoothed_normal_at(&self, at: &CellPoint) -> Option<Normal> {
        self.field.normal(at)
    }

    fn normal_at(&self, at: &CellPoint) -> Option<Normal> {
        self.field.hit_normal(at)
    }

    fn is_buried(&self, isovalue: f32, point: DVec3) -> bool {
        self.placement.buries(&self.field, isovalue, point)
    }
}
