//! From angular maps and cube faces to lat-long.
//!
//! All layouts are read as seen from the inside, unmirrored, with the middle of the picture in
//! the direction of the middle of the lat-long image. Directions in this file are in the frame
//! that OpenEXR gives its cubes: forward +z, up +y, right −x. The probe frame has forward +x and
//! right +z ([`crate::probe::latlong`]): (x, y, z) here is (z, y, −x) there.

use super::{Layout, Note, Raw, ReadOptions};
use crate::error::{Error, Result};
use crate::probe::latlong::LatLong;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

const RIGHT: DVec3 = DVec3::NEG_X;
const UP: DVec3 = DVec3::Y;
const FORWARD: DVec3 = DVec3::Z;

/// The layout of an image: the caller's, else the file's, else by the ratio of its sides.
pub(super) fn choose(raw: &mut Raw, options: &ReadOptions) -> Result<Layout> {
    let (width, height) = (raw.width, raw.height);
    if let Some(layout) = options.layout {
        return if layout.face(width, height).is_some() {
            Ok(layout)
        } else {
            Err(Error::argument(
                "layout",
                format!("{layout} for an image of {width}x{height}"),
                match layout {
                    Layout::Angular => "a square image",
                    Layout::VerticalCross => "sides of 3 and 4 cube faces",
                    Layout::HorizontalCross => "sides of 4 and 3 cube faces",
                    _ => "sides of 1 and 6 cube faces",
                },
                "leave the layout out, or crop the image to its cells",
            ))
        };
    }
    if let Some(layout) = raw.layout {
        if layout.face(width, height).is_some() {
            return Ok(layout);
        }
        raw.notes.push(Note::new(
            format!("the file says {layout}, which a size of {width}x{height} cannot be; the side ratio decides"),
            1,
        ));
    }
    if width == 2 * height || (width == 1 && height == 1) {
        return Ok(Layout::LatLong);
    }
    for layout in [Layout::Angular, Layout::VerticalCross, Layout::HorizontalCross] {
        if layout.face(width, height).is_some() {
            raw.notes.push(Note::new(
                format!("taken as {layout} because of its size, {width}x{height}; a layout can be given instead"),
                1,
            ));
            return Ok(layout);
        }
    }
    raw.notes.push(Note::new(format!("the sides {width}x{height} are not 2:1; taken as lat-long all the same"), 1));
    Ok(Layout::LatLong)
}

/// One cube face: its forward, right and up direction and the cell of its upper left corner.
struct Face {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    cell: [usize; 2],
}

/// The faces of a cube layout, in the order +x −x +y −y +z −z of their forward directions.
fn faces(layout: Layout) -> [Face; 6] {
    let face = |forward: DVec3, up: DVec3, cell| Face { forward, right: forward.cross(up), up, cell };
    let cross = |back_up: DVec3, back_cell| {
        [
            face(-RIGHT, UP, [0, 1]),
            face(RIGHT, UP, [2, 1]),
            face(UP, -FORWARD, [1, 0]),
            face(-UP, FORWARD, [1, 2]),
            face(FORWARD, UP, [1, 1]),
            face(-FORWARD, back_up, back_cell),
        ]
    };
    match layout {
        Layout::VerticalCross => cross(-UP, [1, 3]),
        Layout::HorizontalCross => cross(UP, [3, 1]),
        // OpenEXR, `CubeMap::pixelPosition` in ImfEnvmap.cpp; there, too, the centres of the
        // border pixels lie on the edges of the cube, here the pixels tile the face.
        _ => [
            face(DVec3::X, DVec3::Y, [0, 0]),
            face(DVec3::NEG_X, DVec3::Y, [0, 1]),
            face(DVec3::Y, DVec3::Z, [0, 2]),
            face(DVec3::NEG_Y, DVec3::NEG_Z, [0, 3]),
            face(DVec3::Z, DVec3::Y, [0, 4]),
            face(DVec3::NEG_Z, DVec3::Y, [0, 5]),
        ],
    }
}

/// Index of the pixel of a cube layout that holds a direction.
fn cube_pixel(faces: &[Face; 6], face_size: usize, width: usize, d: DVec3) -> usize {
    let a = d.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    let face = &faces[2 * axis + usize::from(d[axis] < 0.0)];
    let along = d.dot(face.forward);
    let place = |t: f64| (((0.5 + 0.5 * t / along) * face_size as f64).max(0.0) as usize).min(face_size - 1);
    let x = face.cell[0] * face_size + place(d.dot(face.right));
    let y = face.cell[1] * face_size + place(-d.dot(face.up));
    y * width + x
}

/// Index of the pixel of an angular map that holds a direction (Debevec, "Light Probe Image
/// Gallery": (u, v) = r (d·right, d·up), r = acos(d·forward) / (π sqrt(1 − (d·forward)²))).
fn angular_pixel(size: usize, d: DVec3) -> usize {
    let (x, y, z) = (d.dot(RIGHT), d.dot(UP), d.dot(FORWARD));
    let across = (x * x + y * y).sqrt();
    let scale = if across > 0.0 { libm::atan2(across, z) / (PI * across) } else { 0.0 };
    // Straight backwards the whole rim is one point; the right end of the rim stands for it.
    let (u, v) = if across > 0.0 || z > 0.0 { (x * scale, y * scale) } else { (1.0, 0.0) };
    let place = |t: f64| (((0.5 + 0.5 * t) * size as f64).max(0.0) as usize).min(size - 1);
    place(-v) * size + place(u)
}

/// (sqrt 5 − 1)/2, the step of a Fibonacci lattice.
const GOLDEN_SECTION: f64 = 0.618_033_988_749_895;
/// Directions per target pixel, as far as [`MAX_SAMPLES`] allows; at least 4.
const SAMPLES: usize = 256;
/// Most direction samples of one conversion: 2²⁴ take about half a second on one thread.
const MAX_SAMPLES: usize = 1 << 24;

/// The image as lat-long. Each target pixel is the mean of the source at 4 to 256 directions, a
/// Fibonacci lattice that is uniform in its solid angle, so constants stay exact and the energy
/// of a lamp of one source pixel is kept to 3 % with 256 and to 6 % with 64 (what it loses its
/// neighbours gain).
/// The target has the angular resolution of the source: a cube face of n pixels gives 4n × 2n,
/// an angular map of n pixels n × n/2.
pub(super) fn to_lat_long(layout: Layout, width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Result<LatLong> {
    let face_size = layout.face(width, height).unwrap_or(0);
    let target_height = match layout {
        Layout::LatLong => return LatLong::new(width, height, pixels),
        Layout::Angular => height.div_ceil(2),
        _ => 2 * face_size,
    };
    let target_width = 2 * target_height;
    let samples = (MAX_SAMPLES / (target_width * target_height)).clamp(4, SAMPLES);
    let cube = faces(layout);
    let source = |d: DVec3| match layout {
        Layout::Angular => pixels[angular_pixel(width, d)],
        _ => pixels[cube_pixel(&cube, face_size, width, d)],
    };
    // Sine and cosine of the longitude of each column's left edge.
    let columns: Vec<[f64; 2]> = (0..target_width)
        .map(|x| PI * (1.0 - 2.0 * x as f64 / target_width as f64))
        .map(|longitude| [libm::sin(longitude), libm::cos(longitude)])
        .collect();
    let edge = |y: usize| libm::cos(PI * y as f64 / target_height as f64);
    let row = |y: usize| -> Vec<[f32; 3]> {
        let (top, bottom) = (edge(y), edge(y + 1));
        let mut sums = vec![[0.0f64; 3]; target_width];
        for j in 0..samples {
            let down = (j as f64 + 0.5) / samples as f64;
            let across = (j as f64 * GOLDEN_SECTION + 0.5).fract();
            let height = top + (bottom - top) * down;
            let radius = (1.0 - height * height).max(0.0).sqrt();
            // Longitude falls to the right: the angle is subtracted from the left edge's.
            let shift = 2.0 * PI * across / target_width as f64;
            let (shift_sin, shift_cos) = (libm::sin(shift), libm::cos(shift));
            for (sum, [sin, cos]) in sums.iter_mut().zip(&columns) {
                let x = (sin * shift_cos - cos * shift_sin) * radius;
                let z = (cos * shift_cos + sin * shift_sin) * radius;
                let value = source(DVec3::new(x, height, z));
                for c in 0..3 {
                    sum[c] += f64::from(value[c]);
                }
            }
        }
        let weight = 1.0 / samples as f64;
        sums.into_iter().map(|s| s.map(|v| (v * weight) as f32)).collect()
    };
    // Each row writes its own slot: the same image for any number of threads.
    let rows: Vec<Vec<[f32; 3]>> = (0..target_height).into_par_iter().map(row).collect();
    LatLong::new(target_width, target_height, rows.concat())
}

#[cfg(test)]
mod tests;
