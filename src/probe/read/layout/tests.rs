use super::*;
use crate::probe::latlong::luminance;

/// Middle of the picture +z here, +x there; right of it −x here, +z there.
fn probe_from_layout(d: DVec3) -> DVec3 {
    DVec3::new(d.z, d.y, -d.x)
}

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
            let in_probe = probe_from_layout(axis);
            assert_eq!(image.radiance(in_probe), [1.0; 3], "{layout} {axis}");
            assert_eq!(image.radiance(-in_probe), [0.0; 3], "{layout} {axis}");
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
                (phi <= PI + 0.05).then(|| FORWARD * phi.cos() + (RIGHT * theta.cos() + UP * theta.sin()) * phi.sin())
            } else {
                let cell = [x as usize / n, y as usize / n];
                faces(layout).iter().find(|f| f.cell == cell).map(|f| {
                    let a = 2.0 * (x / n as f64 - cell[0] as f64) - 1.0;
                    let b = 1.0 - 2.0 * (y / n as f64 - cell[1] as f64);
                    (f.forward + a * f.right + b * f.up).normalize()
                })
            };
            if let Some(d) = d {
                *pixel = [paint(probe_from_layout(d)); 3];
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
