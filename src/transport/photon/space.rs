//! The space of the photons: lengths in diagonals of the box from its centre, isovalues in ranges of the samples.

use crate::geom::Affine;
use crate::volume::Volume;
use glam::{DMat3, DVec3, Vec3};

/// Maps between grid and the space of the photons.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Space {
    grid_from_world: Affine,
    world_from_grid: Affine,
    centre: DVec3,
    diagonal: f64,
    /// From a gradient per sample step to one per diagonal, in world axes and ranges.
    gradient_from_grid: DMat3,
    /// Lowest raw sample and the range.
    lowest: f64,
    range: f64,
    last: DVec3,
}

impl Space {
    pub(super) fn new(volume: &Volume) -> Self {
        let bounds = volume.world_bounds();
        let diagonal = bounds.size().length();
        let (lowest, highest) = volume.raw_range();
        let range = f64::from(highest) - f64::from(lowest);
        let grid_from_world = volume.world_from_grid().inverse();
        Self {
            world_from_grid: *volume.world_from_grid(),
            centre: bounds.centre(),
            diagonal,
            gradient_from_grid: grid_from_world.linear().transpose() * (diagonal / range),
            grid_from_world,
            lowest: f64::from(lowest),
            range,
            last: DVec3::from_array(volume.dims().map(|d| (d - 1) as f64)),
        }
    }

    /// The raw sample of an isovalue in ranges.
    pub(super) fn raw_from_share(&self, share: f64) -> f32 {
        (self.lowest + share * self.range) as f32
    }

    /// An isovalue in ranges.
    pub(super) fn share_from_raw(&self, raw: f64) -> f64 {
        (raw - self.lowest) / self.range
    }

    /// Position in diagonals.
    pub(super) fn unit_from_grid(&self, position_in_grid: DVec3) -> DVec3 {
        (self.world_from_grid.point(position_in_grid) - self.centre) / self.diagonal
    }

    /// Position in grid of one in diagonals.
    pub(super) fn grid_from_unit(&self, position: DVec3) -> DVec3 {
        self.grid_from_world.point(self.centre + position * self.diagonal)
    }

    /// Whether a position in diagonals is in the box.
    pub(super) fn box_contains(&self, position: DVec3) -> bool {
        let p = self.grid_from_unit(position);
        p.cmpge(DVec3::ZERO).all() && p.cmple(self.last).all()
    }

    /// Whether a ball around a position in diagonals lies in the box.
    pub(super) fn holds_ball(&self, position: DVec3, radius: f64) -> bool {
        let p = self.grid_from_unit(position);
        let linear = self.grid_from_world.linear() * (radius * self.diagonal);
        // Half of the ball's extent along a grid axis is the length of that row.
        let rows = linear.transpose();
        let reach = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
        (p - reach).cmpge(DVec3::ZERO).all() && (p + reach).cmple(self.last).all()
    }

    /// The diagonal of the box in world units.
    pub(super) fn diagonal(&self) -> f64 {
        self.diagonal
    }

    /// Length of a gradient of the raw samples, in ranges per diagonal.
    pub(super) fn slope(&self, raw_gradient: Vec3) -> f64 {
        (self.gradient_from_grid * raw_gradient.as_dvec3()).length()
    }
}
