use super::super::LatLong;
use super::*;
use glam::DVec3;

#[test]
fn up_z_follows_the_definition() {
    let m = Orientation::default().probe_from_world();
    assert_eq!(m * DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 3.0, -2.0));
    assert_eq!(m * DVec3::X, DVec3::X, "world +x is the centre of the image");
}

/// One bright pixel at the centre, at three quarters and at the zenith: where it shines from in world.
#[test]
fn a_bright_pixel_lights_from_the_side_that_gltf_gives_it() {
    let at = |u: f64, v: f64| {
        LatLong::new(64, 32, vec![[0.0; 3]; 64 * 32]).unwrap().direction_from_pixel(64.0 * u, 32.0 * v)
    };
    let (centre, three_quarters, zenith) = (at(0.5, 0.5), at(0.75, 0.5), at(0.5, 0.0));
    let cases = [
        // World in which z is up: +x, -y, +z.
        (Up::Z, EnvFrame::Gltf, [DVec3::X, DVec3::NEG_Y, DVec3::Z]),
        // A patient: left, anterior, superior, which are -x, +y, +z in RAS+.
        (Up::Anatomical, EnvFrame::Gltf, [DVec3::NEG_X, DVec3::Y, DVec3::Z]),
        (Up::Y, EnvFrame::Gltf, [DVec3::X, DVec3::Z, DVec3::Y]),
        // OpenEXR: the centre is +Z, and +X a quarter from the left.
        (Up::Y, EnvFrame::OpenExr, [DVec3::Z, DVec3::NEG_X, DVec3::Y]),
        (Up::Z, EnvFrame::OpenExr, [DVec3::NEG_Y, DVec3::NEG_X, DVec3::Z]),
    ];
    for (up, frame, expected) in cases {
        let world_from_probe = Orientation::new(up, 0.0).unwrap().in_frame(frame).world_from_probe();
        for (direction, expected) in [centre, three_quarters, zenith].into_iter().zip(expected) {
            assert!((world_from_probe * direction - expected).length() < 1e-15, "{up:?} {frame:?} {expected}");
        }
    }
}

#[test]
fn angles_must_be_finite() {
    assert!(Orientation::new(Up::Y, f64::NAN).is_err() && Orientation::new(Up::Y, f64::INFINITY).is_err());
}

#[test]
fn rotation_turns_the_light_counter_clockwise_seen_from_above() {
    // Counter-clockwise about +z, seen from above: x → y → −x. A lamp that shines from world
    // x must shine from world y after 90°.
    for (degrees, from, to) in [
        (90.0, DVec3::X, DVec3::Y),
        (180.0, DVec3::X, DVec3::NEG_X),
        (-90.0, DVec3::X, DVec3::NEG_Y),
        (450.0, DVec3::Y, DVec3::NEG_X),
        (90.0, DVec3::Z, DVec3::Z),
    ] {
        let lamp_in_probe = Orientation::default().probe_from_world() * from;
        let turned = Orientation::new(Up::Z, degrees).unwrap();
        assert_eq!(turned.world_from_probe() * lamp_in_probe, to, "{degrees}");
    }
    // The same rule about every axis: R(up, θ) by Rodrigues' formula.
    for up in [Up::X, Up::Y, Up::Z, Up::NegX, Up::NegY, Up::NegZ, Up::Anatomical] {
        let lamp = DVec3::new(0.3, -0.5, 0.8);
        let in_probe = up.gltf_from_world() * lamp;
        let turned = Orientation::new(up, 37.0).unwrap().world_from_probe() * in_probe;
        let expected = DMat3::from_axis_angle(up.axis(), 37f64.to_radians()) * lamp;
        assert!((turned - expected).length() < 1e-15, "{up:?}");
    }
}
