use super::*;
use glam::DVec3;

#[test]
fn up_z_follows_the_definition() {
    let m = Orientation::default().probe_from_world();
    assert_eq!(m * DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 3.0, -2.0));
    assert_eq!(m * DVec3::NEG_Y, DVec3::Z, "world -y is the centre of the image");
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
    for up in [Up::X, Up::Y, Up::Z, Up::NegX, Up::NegY, Up::NegZ] {
        let lamp = DVec3::new(0.3, -0.5, 0.8);
        let in_probe = up.gltf_from_world() * lamp;
        let turned = Orientation::new(up, 37.0).unwrap().world_from_probe() * in_probe;
        let expected = DMat3::from_axis_angle(up.axis(), 37f64.to_radians()) * lamp;
        assert!((turned - expected).length() < 1e-15, "{up:?}");
    }
}
