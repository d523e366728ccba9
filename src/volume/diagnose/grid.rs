//! How the grid stands in the world.

use super::super::Volume;
use crate::finding::Finding;
use glam::DVec3;

/// Spacings that differ by more than this factor are called anisotropic: beyond it a texel of the
/// data's own lattice is a plate or a needle.
pub const ANISOTROPIC: f64 = 4.0;
/// Cosine of the angle between two axes that still counts as perpendicular: f32 headers round it.
const PERPENDICULAR: f64 = 1e-5;
/// A position must be good to this part of a voxel.
const POSITION: f64 = 1e-3;
const AXES: [&str; 3] = ["x", "y", "z"];

/// Axes with one sample.
pub(super) fn flat(volume: &Volume) -> Option<Finding> {
    let [x, y, z] = volume.dims();
    let flat = [x, y, z].iter().filter(|&&n| n < 2).count() as u64;
    (flat > 0).then(|| {
        Finding::new(
            "flat grid",
            (flat, 3, "axes"),
            format!("{x} × {y} × {z} samples: one sample along an axis leaves no cells"),
            "a slice has no isosurface and a bake refuses it; stack it with its neighbours",
        )
    })
}

pub(super) fn findings(volume: &Volume) -> Vec<Finding> {
    let affine = volume.world_from_grid();
    let (spacing, linear) = (affine.spacing(), affine.linear());
    let mut found = Vec::new();
    let shortest = spacing.min_element();
    let long = spacing.to_array().iter().filter(|s| **s > ANISOTROPIC * shortest).count() as u64;
    if long > 0 {
        let ratio = spacing.max_element() / shortest;
        found.push(Finding::new(
            "anisotropy",
            (long, 3, "axes"),
            format!("spacing {} × {} × {}, {ratio:.3} : 1", spacing.x, spacing.y, spacing.z),
            "rays, normals, areas and distances are measured in world, so nothing is stretched; texels are as long \
             as the voxels, though. --texture XxYxZ evens them out, resampling the data beforehand does it better",
        ));
    }
    if affine.is_left_handed() {
        found.push(Finding::new(
            "left-handed",
            (1, 0, "grid"),
            "the axes of the grid form a left-handed frame",
            "the surface is not mirrored: normals go through the inverse transpose, and triangles are turned so that \
             their fronts look to the lit side",
        ));
    }
    let unit = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::normalize);
    let pairs = [(0, 1), (0, 2), (1, 2)].map(|(a, b)| (a, b, unit[a].dot(unit[b])));
    let oblique = pairs.iter().filter(|p| p.2.abs() > PERPENDICULAR).count() as u64;
    if oblique > 0 {
        let worst = pairs.iter().copied().fold((0, 1, 0.0f64), |w, p| if p.2.abs() > w.2.abs() { p } else { w });
        let degrees = libm::acos(worst.2.clamp(-1.0, 1.0)).to_degrees();
        found.push(Finding::new(
            "oblique",
            (oblique, 3, "angles"),
            format!("axes that are not perpendicular: {} and {} stand at {degrees:.2}°", AXES[worst.0], AXES[worst.1]),
            "rays run in grid space along the mapped direction and gradients are mapped as covectors: exact for any \
             invertible affine",
        ));
    }
    let turned = unit.iter().filter(|u| u.abs().max_element() < 1.0 - PERPENDICULAR).count() as u64;
    if turned > 0 && oblique == 0 {
        found.push(Finding::new(
            "rotated",
            (turned, 3, "axes"),
            "the grid stands askew to the axes of the world",
            "meshes and light are in world axes: up is the world's, as --up says, not the grid's",
        ));
    }
    found.extend(far_origin(volume, shortest));
    found
}

fn far_origin(volume: &Volume, shortest: f64) -> Option<Finding> {
    let bounds = volume.world_bounds();
    let largest = bounds.min.abs().max(bounds.max.abs());
    // Rounding to f32 moves a coordinate by up to 2⁻²⁴ of it.
    let error = largest / f64::from(1 << 24) / shortest;
    let lost = error.to_array().iter().filter(|e| **e > POSITION).count() as u64;
    (lost > 0).then(|| {
        Finding::new(
            "far origin",
            (lost, 3, "axes"),
            format!(
                "coordinates up to {}: 32-bit world positions would be off by up to {:.3} voxels",
                largest.max_element(),
                error.max_element()
            ),
            "rays and meshes are computed in grid space, where nothing is lost; .glb stores positions about the \
             centre, the offset in the node and, in full, in its extras; .ply switches to doubles where it must",
        )
    })
}
