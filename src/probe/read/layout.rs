//! From angular maps and cube faces to lat-long.
//!
//! All layouts are read as seen from the inside, unmirrored, with the middle of the picture in
//! the direction of the middle of the lat-long image: forward +z, up +y, right −x (see
//! [`crate::probe::latlong`]).

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
mod tests {
    use super::*;
    use crate::probe::latlong::luminance;

    /// Marks the middle of each face of a layout and looks where it lands.
    #[test]
    fn faces_land_on_their_axes() {
        let n = 8;
        // Cells in words: the definition of each layout, apart from the code above.
        type Cells = [(DVec3, [usize; 2]); 6];
        let expected: [(Layout, Cells); 3] = [
            (
                Layout::VerticalCross,
                [
                    (DVec3::Y, [1, 0]),
                    (DVec3::X, [0, 1]), // left of forward +z is +x
                    (DVec3::Z, [1, 1]),
                    (DVec3::NEG_X, [2, 1]),
                    (DVec3::NEG_Y, [1, 2]),
                    (DVec3::NEG_Z, [1, 3]),
                ],
            ),
            (
                Layout::HorizontalCross,
                [
                    (DVec3::Y, [1, 0]),
                    (DVec3::X, [0, 1]),
                    (DVec3::Z, [1, 1]),
                    (DVec3::NEG_X, [2, 1]),
                    (DVec3::NEG_Z, [3, 1]),
                    (DVec3::NEG_Y, [1, 2]),
                ],
            ),
            (
                Layout::CubeStrip,
                [
                    (DVec3::X, [0, 0]),
                    (DVec3::NEG_X, [0, 1]),
                    (DVec3::Y, [0, 2]),
                    (DVec3::NEG_Y, [0, 3]),
                    (DVec3::Z, [0, 4]),
                    (DVec3::NEG_Z, [0, 5]),
                ],
            ),
        ];
        for (layout, cells) in expected {
            let (across, down) = match layout {
                Layout::VerticalCross => (3, 4),
                Layout::HorizontalCross => (4, 3),
                _ => (1, 6),
            };
            for (axis, cell) in cells {
                let mut pixels = vec![[0.0; 3]; across * down * n * n];
                for y in 3..5 {
                    for x in 3..5 {
                        pixels[(cell[1] * n + y) * across * n + cell[0] * n + x] = [1.0; 3];
                    }
                }
                let image = to_lat_long(layout, across * n, down * n, pixels).unwrap();
                assert_eq!((image.width(), image.height()), (32, 16));
                assert_eq!(image.radiance(axis), [1.0; 3], "{layout} {axis}");
                assert_eq!(image.radiance(-axis), [0.0; 3], "{layout} {axis}");
            }
        }
    }

    /// A linear function of direction painted into each layout by its definition comes back,
    /// seams included: a flipped or turned face would be wrong by O(1).
    #[test]
    fn faces_join_without_seams() {
        let paint = |d: DVec3| (0.5 + 0.3 * d.x + 0.15 * d.y - 0.05 * d.z) as f32;
        let n = 32;
        for (layout, width, height) in [
            (Layout::VerticalCross, 3 * n, 4 * n),
            (Layout::HorizontalCross, 4 * n, 3 * n),
            (Layout::CubeStrip, n, 6 * n),
            (Layout::Angular, 128, 128),
        ] {
            let mut pixels = vec![[9.0; 3]; width * height];
            for (i, pixel) in pixels.iter_mut().enumerate() {
                let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                let d = if layout == Layout::Angular {
                    // Debevec's text: rotate forward by φ = π r about up, then by θ about forward.
                    let (u, v) = (2.0 * x / width as f64 - 1.0, 1.0 - 2.0 * y / height as f64);
                    let (phi, theta) = (PI * u.hypot(v), v.atan2(u));
                    (phi <= PI + 0.05)
                        .then(|| FORWARD * phi.cos() + (RIGHT * theta.cos() + UP * theta.sin()) * phi.sin())
                } else {
                    let cell = [x as usize / n, y as usize / n];
                    faces(layout).iter().find(|f| f.cell == cell).map(|f| {
                        let a = 2.0 * (x / n as f64 - cell[0] as f64) - 1.0;
                        let b = 1.0 - 2.0 * (y / n as f64 - cell[1] as f64);
                        (f.forward + a * f.right + b * f.up).normalize()
                    })
                };
                if let Some(d) = d {
                    *pixel = [paint(d); 3];
                }
            }
            let image = to_lat_long(layout, width, height, pixels).unwrap();
            let mut worst: f64 = 0.0;
            for y in 0..image.height() {
                for x in 0..image.width() {
                    let d = image.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5);
                    worst = worst.max((luminance(image.row(y)[x]) - f64::from(paint(d))).abs());
                }
            }
            // A source pixel spans at most 2/32 rad and the slope is at most 0.34.
            assert!(worst < 0.34 * 2.0 / 32.0, "{layout}: {worst}");
        }
    }

    /// A lamp of one source pixel keeps its energy to what 256 samples a pixel resolve.
    #[test]
    fn small_lamps_keep_their_energy() {
        let n = 32usize;
        for i in 0..40 {
            let variate = |d| crate::sampling::hash::uniform(4, i, 0, d) as f64;
            let (x, y) = ((variate(0) * n as f64) as usize, (variate(1) * 6.0 * n as f64) as usize);
            let mut pixels = vec![[0.0; 3]; 6 * n * n];
            pixels[y * n + x] = [1000.0; 3];
            let image = to_lat_long(Layout::CubeStrip, n, 6 * n, pixels).unwrap();
            // Solid angle of [0, a] × [0, b] on the plane at distance 1: atan(ab / sqrt(1+a²+b²)).
            let corner = |a: f64, b: f64| (a * b / (1.0 + a * a + b * b).sqrt()).atan();
            let edge = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
            let (a, b, row) = (edge(x), edge(x + 1), y % n);
            let (c, d) = (edge(row), edge(row + 1));
            let solid_angle = corner(b, d) - corner(a, d) - corner(b, c) + corner(a, c);
            let error = image.mean()[0] * 4.0 * PI / (1000.0 * solid_angle) - 1.0;
            assert!(error.abs() < 0.03, "({x}, {y}): {error}");
        }
    }

    #[test]
    fn ratios_choose_layouts() {
        let raw = |width, height| Raw { format: "test", width, height, pixels: vec![], layout: None, notes: vec![] };
        let by_ratio = |w, h| choose(&mut raw(w, h), &ReadOptions::default()).unwrap();
        assert_eq!(by_ratio(1024, 512), Layout::LatLong);
        assert_eq!(by_ratio(1, 1), Layout::LatLong);
        assert_eq!(by_ratio(512, 512), Layout::Angular);
        assert_eq!(by_ratio(96, 128), Layout::VerticalCross);
        assert_eq!(by_ratio(128, 96), Layout::HorizontalCross);
        assert_eq!(by_ratio(7, 3), Layout::LatLong);
        assert_eq!(by_ratio(1, 6), Layout::LatLong);
        let forced = ReadOptions { layout: Some(Layout::CubeStrip), ..ReadOptions::default() };
        assert_eq!(choose(&mut raw(4, 24), &forced).unwrap(), Layout::CubeStrip);
        assert!(choose(&mut raw(4, 23), &forced).is_err());
        let mut named = Raw { layout: Some(Layout::CubeStrip), ..raw(8, 8) };
        assert_eq!(choose(&mut named, &ReadOptions::default()).unwrap(), Layout::Angular);
        assert_eq!(named.notes.len(), 2);
    }
}
