//! The field along a ray, cell by cell, whatever level set the ray may belong to.

use super::cell::{self, Cubic};
use super::march::{self, March, Steps};
use super::{BLOCK_SHIFT, CellPoint, LevelField};
use crate::volume::Sample;
use glam::Vec3;

impl<T: Sample> LevelField<'_, T> {
    /// Hands `visit` the field in each cell that a ray from `start` passes until the border of the box: the Bernstein
    /// coefficients of the raw samples along the ray in the cell ([`cell::along_segment`]), and where the ray enters and
    /// leaves it, in multiples of `direction` (grid space, not zero). Ends early once `visit` says `false`.
    ///
    /// Blocks for whose index `is_empty` holds ([`super::Pyramid::block_ranges`]) are passed over.
    pub fn each_cell(
        &self,
        start: &CellPoint,
        direction: Vec3,
        is_empty: &dyn Fn(usize) -> bool,
        visit: &mut dyn FnMut(&Cubic, f64, f64) -> bool,
    ) {
        let blocks = self.pyramid.blocks();
        let mut march = March::new(start, direction, self.dims);
        // From parameters of the march, whose direction is scaled by a power of two, to those of `direction`.
        let scale = f64::from(march.slope().max_element()) / f64::from(direction.abs().max_element());
        let octant = march.octant();
        let rows = self.shifted_rows();
        let first_sample = self.sample_index(&start.cell.to_array());
        let sample_steps = Steps::new([1, self.rows[1], self.rows[2]], octant);
        let block_steps = Steps::new([1, blocks.dims[0], blocks.dims[0] * blocks.dims[1]], octant);
        let mut sample = first_sample;
        let mut block = blocks.index(start.cell.to_array().map(|c| (c >> BLOCK_SHIFT) as usize));
        let mut empty = is_empty(block);
        loop {
            if empty {
                while empty {
                    let axis = march.cross_block();
                    if !march.next_block(axis) {
                        return;
                    }
                    block = block.wrapping_add(block_steps.along(axis));
                    empty = is_empty(block);
                }
                march.enter();
                sample = first_sample.wrapping_add(sample_steps.times(march.passed()));
            }
            let axis = march::first(march.far);
            let t = march.far.min_element();
            if t > march.entered_at {
                let (low, high) = rows.corners(sample);
                let cubic = cell::along_segment(low, high, march.entry(), march.exit_at(t, axis));
                if !visit(&cubic, f64::from(march.entered_at) * scale, f64::from(t) * scale) {
                    return;
                }
            }
            sample = sample.wrapping_add(sample_steps.along(axis));
            let left = march.cross(t, axis);
            if !march.next_block(left) {
                return;
            }
            block = block.wrapping_add(block_steps.along(left));
            empty = left.bitmask() & 7 != 0 && is_empty(block);
        }
    }
}
