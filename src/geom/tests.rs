use super::*;

#[test]
fn up_rotations_are_proper_and_take_the_axis_to_y() {
    let all = [
        (Up::X, DVec3::X),
        (Up::Y, DVec3::Y),
        (Up::Z, DVec3::Z),
        (Up::NegX, -DVec3::X),
        (Up::NegY, -DVec3::Y),
        (Up::NegZ, -DVec3::Z),
        (Up::Anatomical, DVec3::Z),
    ];
    for (up, axis) in all {
        let r = up.gltf_from_world();
        assert_eq!(r.determinant(), 1.0);
        assert_eq!(r * axis, DVec3::Y, "{up:?}");
        assert_eq!(up.axis(), axis);
    }
    assert_eq!(Up::Z.gltf_from_world() * DVec3::new(1., 2., 3.), DVec3::new(1., 3., -2.));
    // Of a patient (RAS+): left is glTF +X, superior +Y, anterior +Z.
    let [left, superior, anterior] = [-DVec3::X, DVec3::Z, DVec3::Y].map(|v| Up::Anatomical.gltf_from_world() * v);
    assert_eq!([left, superior, anterior], [DVec3::X, DVec3::Y, DVec3::Z]);
}

#[test]
fn a_normal_stays_orthogonal_to_the_surface_under_anisotropic_maps() {
    // The plane x + y = 0 in grid space holds the displacements (1, −1, 0) and (0, 0, 1).
    let map = Affine::new(
        DMat3::from_cols(DVec3::new(1., 0.2, 0.), DVec3::new(0., 100., 3.), DVec3::new(-0.5, 0., -7.)),
        DVec3::splat(1e6),
    )
    .unwrap();
    let normal = Normal::down_gradient(map.gradient_matrix() * Vec3::new(1., 1., 0.)).unwrap();
    for displacement in [DVec3::new(1., -1., 0.), DVec3::Z] {
        let in_world = map.vector(displacement).normalize();
        assert!(in_world.dot(normal.vec().as_dvec3()).abs() < 1e-6);
    }
    assert!(map.is_left_handed());
    assert!((map.inverse().point(map.point(DVec3::ONE)) - DVec3::ONE).length() < 1e-8);
}

#[test]
fn frames_are_orthonormal_and_right_handed() {
    for v in [Vec3::Z, -Vec3::Z, Vec3::X, -Vec3::Y, Vec3::new(1., 2., -3.), Vec3::new(1e-20, -1e-20, -1e-20)] {
        let f = Frame::around(Normal::down_gradient(-v).unwrap());
        assert!((f.tangent.cross(f.bitangent) - f.normal).length() < 1e-6);
        assert!(f.tangent.dot(f.normal).abs() < 1e-6);
    }
    assert!(Normal::down_gradient(Vec3::ZERO).is_none());
    assert!(Direction::new(Vec3::splat(f32::NAN)).is_none());
}
