//! Check points: points of isosurfaces off the texels and vertices, with exact transfer and the directions in which their
//! paths escaped. What is looked up there is held against them, under any light and without a ray.

use crate::geom::{direction_from_octahedral, octahedral_from_direction};
use glam::Vec3;

/// Points of isosurfaces with transfer of their own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckPoints {
    /// Positions in grid space.
    pub positions_in_grid: Vec<[f32; 3]>,
    /// Unit normals in world that point to the lit side, smoothed as those of texels and vertices.
    pub normals: Vec<[f32; 3]>,
    /// The isovalue of each, in the file's values.
    pub isovalues: Vec<f64>,
    /// Transfer by two independent halves of the paths, each a vector a point in the order of
    /// [`Layers`](super::Layers): their mean is the best estimate, their difference its noise.
    pub halves: [Vec<f32>; 2],
    /// Paths of each point in [`Self::escapes`]; 0 where there are none.
    pub paths: u32,
    /// For each point and path where and after how many reflections it escaped, as [`escape`] packs it.
    pub escapes: Vec<u32>,
}

impl CheckPoints {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions_in_grid.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.positions_in_grid.is_empty()
    }

    /// Numbers of a transfer vector.
    pub fn coefficients(&self) -> usize {
        self.halves[0].len() / self.len().max(1)
    }

    /// Whether every list is as long as the points say: what was found and what is right, if not.
    pub(crate) fn check(&self) -> Result<(), (String, String)> {
        let (n, halves) = (self.len(), self.halves.each_ref().map(Vec::len));
        let numbers = self.coefficients() * n;
        let lengths = [
            ("normals", self.normals.len(), n),
            ("isovalues", self.isovalues.len(), n),
            ("numbers in the first half", halves[0], numbers),
            ("numbers in the second half", halves[1], numbers),
            ("escapes", self.escapes.len(), n * self.paths as usize),
        ];
        match lengths.into_iter().find(|(_, found, expected)| found != expected) {
            Some((what, found, expected)) => Err((format!("{found} {what}"), format!("{expected} of {n} points"))),
            None => Ok(()),
        }
    }

    /// Those of some points alone, in this order; points that are not there are left out.
    #[must_use]
    pub fn of(&self, points: &[usize]) -> Self {
        let points: Vec<usize> = points.iter().copied().filter(|&i| i < self.len()).collect();
        let (n, paths) = (self.coefficients(), self.paths as usize);
        let half = |h: &Vec<f32>| points.iter().flat_map(|&i| h[i * n..(i + 1) * n].iter().copied()).collect();
        Self {
            positions_in_grid: points.iter().map(|&i| self.positions_in_grid[i]).collect(),
            normals: points.iter().map(|&i| self.normals[i]).collect(),
            isovalues: points.iter().map(|&i| self.isovalues[i]).collect(),
            halves: [half(&self.halves[0]), half(&self.halves[1])],
            paths: self.paths,
            escapes: points.iter().flat_map(|&i| self.escapes[i * paths..(i + 1) * paths].iter().copied()).collect(),
        }
    }
}

/// A path that did not escape within the stored layers.
pub const NO_ESCAPE: u32 = u32::MAX;
/// Bits of each octahedral coordinate; the other four are the layer.
const BITS: u32 = 14;
const STEPS: f32 = ((1 << BITS) - 1) as f32;

/// Packs a direction of escape and its layer (at most 14) into 32 bits; the direction is off by at most 4e-4.
pub fn escape(direction: Vec3, layer: usize) -> u32 {
    let [x, y] = octahedral_from_direction(direction).map(|t| ((t * 0.5 + 0.5).clamp(0.0, 1.0) * STEPS + 0.5) as u32);
    (layer.min(14) as u32) << (2 * BITS) | x << BITS | y
}

/// Direction and layer of an escape; `None` of [`NO_ESCAPE`].
pub fn of_escape(code: u32) -> Option<(Vec3, usize)> {
    if code == NO_ESCAPE {
        return None;
    }
    let mask = (1 << BITS) - 1;
    let part = |bits: u32| (bits & mask) as f32 / STEPS * 2.0 - 1.0;
    Some((direction_from_octahedral([part(code >> BITS), part(code)]), (code >> (2 * BITS)) as usize))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::warp;

    #[test]
    fn an_escape_comes_back_within_its_error() {
        for i in 0..4000u32 {
            let place = [(i as f32 * 0.618_034).fract(), (i as f32 * 0.754_878).fract()];
            let direction = warp::square_to_uniform_cone(place, 2.0);
            let code = escape(direction, (i % 15) as usize);
            let (back, layer) = of_escape(code).unwrap();
            assert!((back - direction).length() < 4e-4 && layer == (i % 15) as usize, "{direction} {back}");
            assert_ne!(code, NO_ESCAPE);
        }
        assert_eq!(of_escape(NO_ESCAPE), None);
    }

    #[test]
    fn a_choice_of_points_has_their_numbers() {
        let all = CheckPoints {
            positions_in_grid: vec![[0.0; 3], [1.0; 3], [2.0; 3]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            isovalues: vec![1.0, 2.0, 3.0],
            halves: [(0..6).map(|v| v as f32).collect(), (6..12).map(|v| v as f32).collect()],
            paths: 2,
            escapes: (0..6).collect(),
        };
        let some = all.of(&[2, 0, 9]);
        assert_eq!((some.len(), some.coefficients(), &*some.isovalues), (2, 2, &[3.0, 1.0][..]));
        assert_eq!((&*some.halves[1], &*some.escapes), (&[10.0, 11.0, 6.0, 7.0][..], &[4, 5, 0, 1][..]));
    }
}
