use super::*;

#[test]
fn one_bright_pixel_per_axis() {
    // 8 x 4: the bright pixel is set by hand from the definition (left edge π, centre 0 = +x, +z three quarters from the
    // left), the axis is asked a little off so that it falls inside the pixel: columns grow from +x towards +z.
    let cases: [(usize, usize, DVec3); 6] = [
        (4, 1, DVec3::new(1.0, 0.1, 0.1)),   // just right of the centre, towards +z
        (0, 1, DVec3::new(-1.0, 0.1, -0.1)), // just right of the left edge, towards -z
        (6, 1, DVec3::new(-0.1, 0.1, 1.0)),  // just right of three quarters
        (2, 1, DVec3::new(0.1, 0.1, -1.0)),  // just right of a quarter
        (4, 0, DVec3::new(0.2, 1.0, 0.05)),  // top row, just right of the centre
        (4, 3, DVec3::new(0.2, -1.0, 0.05)),
    ];
    for (x, y, direction) in cases {
        let image = LatLong::from_fn(8, 4, |i, j| if (i, j) == (x, y) { [1.0, 2.0, 3.0] } else { [0.0; 3] });
        assert_eq!(image.radiance(direction), [1.0, 2.0, 3.0], "{direction}");
    }
    let image = LatLong::from_fn(8, 4, |_, _| [0.0; 3]);
    for (x, y, axis) in [(4.0, 2.0, DVec3::X), (6.0, 2.0, DVec3::Z), (2.0, 2.0, -DVec3::Z), (1.0, 0.0, DVec3::Y)] {
        assert!((image.direction_from_pixel(x, y) - axis).length() < 1e-15, "{axis}");
    }
    assert!((image.direction_from_pixel(0.0, 2.0) + DVec3::X).length() < 1e-15);
    assert!((image.direction_from_pixel(8.0, 2.0) + DVec3::X).length() < 1e-15);
}

/// `equirectUv` of three.js (src/renderers/shaders/ShaderChunk/common.glsl.js), v = 1 at the top row.
#[test]
fn positions_are_those_of_three_js() {
    let image = LatLong::from_fn(64, 32, |_, _| [0.0; 3]);
    for i in 0..200u64 {
        let variate = |k| f64::from(crate::sampling::hash::uniform(9, i, 0, k));
        let d = direction_from_angles(2.0 * PI * variate(0) - PI, (2.0 * variate(1) - 1.0).asin());
        let (u, v) = (d.z.atan2(d.x) / (2.0 * PI) + 0.5, d.y.clamp(-1.0, 1.0).asin() / PI + 0.5);
        let [x, y] = image.pixel_from_direction(d);
        assert!((x / 64.0 - u).abs() < 1e-12 && (1.0 - y / 32.0 - v).abs() < 1e-12, "{d}");
    }
}

#[test]
fn positions_and_directions_are_inverse() {
    let image = LatLong::from_fn(7, 3, |_, _| [0.0; 3]);
    for j in 0..30 {
        for i in 0..70 {
            let (x, y) = ((i as f64 + 0.5) / 10.0, (j as f64 + 0.5) / 10.0);
            let [bx, by] = image.pixel_from_direction(image.direction_from_pixel(x, y) * 1e-3);
            assert!((bx - x).abs() < 1e-12 && (by - y).abs() < 1e-12, "{x} {y} -> {bx} {by}");
        }
    }
    for d in [DVec3::ZERO, DVec3::Y, -DVec3::Y, -DVec3::Z, DVec3::new(-0.0, 0.0, -1.0)] {
        let (x, y) = image.pixel_at(d);
        assert!(x < 7 && y < 3);
    }
}

#[test]
fn solid_angles_sum_to_the_sphere() {
    for (w, h) in [(1, 1), (7, 3), (64, 32), (1024, 512), (20, 10_000)] {
        let image = LatLong::from_fn(w, h, |_, _| [1.0; 3]);
        let sum: f64 = (0..h).map(|y| image.pixel_solid_angle(y) * w as f64).sum();
        assert!((sum / (4.0 * PI) - 1.0).abs() < 1e-13, "{w}x{h}: {sum}");
        for c in image.mean() {
            assert!((c - 1.0).abs() < 1e-13);
        }
    }
}

#[test]
fn the_constructor_refuses_impossible_images() {
    assert!(LatLong::new(0, 1, vec![]).is_err());
    assert!(LatLong::new(2, 2, vec![[0.0; 3]; 3]).is_err());
    assert!(LatLong::new(usize::MAX, 2, vec![[0.0; 3]; 3]).is_err());
    assert!(LatLong::new(1, 1, vec![[0.0, f32::NAN, 0.0]]).is_err());
    assert!(LatLong::new(1, 1, vec![[0.0; 3]]).is_ok());
}
