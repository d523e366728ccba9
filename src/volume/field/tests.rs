use super::*;

#[test]
fn tables_give_the_bits_of_the_pointwise_values() {
    for name in NAMES {
        let named = by_name(&format!("{name}:9x6x11")).unwrap().unwrap();
        let volume = named.sample().unwrap();
        assert_eq!(volume.dims(), [9, 6, 11]);
        let bounds = named.field.bounds();
        for (x, y, z) in [(0, 0, 0), (8, 5, 10), (3, 2, 7), (8, 0, 1)] {
            let steps = DVec3::new(x as f64, y as f64, z as f64) * bounds.size() / DVec3::new(8.0, 5.0, 10.0);
            let expected = named.field.value(bounds.min + steps) as f32;
            assert_eq!(volume.samples().raw(volume.index(x, y, z)), expected, "{name} {x} {y} {z}");
        }
        let world = volume.world_bounds();
        assert!((world.min - bounds.min).length() + (world.max - bounds.max).length() < 1e-12, "{name}");
        assert_eq!((volume.up, volume.solid, volume.name.as_str()), (named.field.up(), named.field.solid(), name));
        let (low, high) = volume.value_range();
        let isovalue = named.field.default_isovalue();
        assert!(low < isovalue && isovalue < high, "{name}: {low} {isovalue} {high}");
    }
}

#[test]
fn the_bump_box_spans_0_to_255_by_constants_that_are_derived_again_here() {
    // The maximum by ascent: a step along each axis, halved when nothing improves.
    let field = BumpBox;
    let (mut best, mut step) = (DVec3::new(0.5, 0.9, 0.5), 0.01);
    while step > 1e-9 {
        let moves = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
        match moves.iter().map(|m| best + *m * step).find(|p| field.unmapped(*p) > field.unmapped(best)) {
            Some(better) => best = better,
            None => step *= 0.5,
        }
    }
    // At the maximum F is flat: a position error of 1e-8 costs 1e-14.
    assert!((field.unmapped(best) - BUMP_MAXIMUM).abs() < 1e-13, "{best} {}", field.unmapped(best));
    assert!((best - DVec3::new(0.5, 0.901684949848, 0.5)).length() < 1e-6, "{best}");
    // No other hill is higher, and the corner is the lowest point: seen on a grid.
    let (mut low, mut high) = (f64::MAX, f64::MIN);
    for i in 0..41 * 41 * 41 {
        let value = field.unmapped(DVec3::new((i % 41) as f64, (i / 41 % 41) as f64, (i / 1681) as f64) / 40.0);
        (low, high) = (low.min(value), high.max(value));
    }
    // The constant is given to eight digits.
    assert!((low - BUMP_MINIMUM).abs() < 5e-9 && high <= BUMP_MAXIMUM, "{low} {high}");
    assert_eq!(low, field.unmapped(DVec3::ZERO));
    assert!((field.value(best) - 255.0).abs() < 1e-9);
    assert!(field.value(DVec3::ZERO).abs() < 2e-6);
    // Larger values, the solid, at y = 1.
    assert!(field.value(DVec3::new(0.5, 1.0, 0.5)) > field.value(DVec3::new(0.5, 0.0, 0.5)));
}

#[test]
fn closed_forms_hold_at_chosen_points() {
    assert_eq!(Sphere.value(DVec3::new(0.6, 0.0, -0.8)), -1.0);
    assert_eq!(Bowl.value(DVec3::new(0.0, 0.3, -0.4)), 0.5);
    let torus = Torus::default();
    // On the ring, on the outer equator, in the centre: r, 0, r − R.
    assert!((torus.value(DVec3::new(0.0, 0.6, 0.0)) - 0.25).abs() < 1e-15);
    assert!(torus.value(DVec3::new(-0.85, 0.0, 0.0)).abs() < 1e-15);
    assert!((torus.value(DVec3::ZERO) - (0.25 - 0.6)).abs() < 1e-15);
    // The gyroid passes through the origin and has the symmetry h(−x) = −h(x).
    let gyroid = Gyroid::default();
    assert_eq!(gyroid.value(DVec3::ZERO), 0.0);
    let p = DVec3::new(0.11, 0.23, 0.37);
    assert!((gyroid.value(p) + gyroid.value(-p)).abs() < 1e-14);
    assert!((gyroid.value(p) - gyroid.value(p + DVec3::new(0.5, 0.0, 1.0))).abs() < 1e-13);
    let scene = SphereOverPlane::new(0.8, 1.0).unwrap();
    assert_eq!(scene.value(DVec3::new(0.0, 0.0, 1.0)), 0.8);
    assert_eq!(scene.value(DVec3::new(1.4, 0.0, -0.25)), 0.25);
    assert!(scene.value(DVec3::new(0.0, 0.0, 0.1)) < 0.0);
    for (r, h) in [(1.0, 1.0), (0.0, 1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
        assert!(SphereOverPlane::new(r, h).is_err(), "{r} {h}");
    }
}

#[test]
fn voxels_are_cubic_by_default() {
    for (spec, dims) in [
        ("bumpbox", [64, 64, 64]),
        ("bowl", [65, 65, 33]),
        ("bowl:129", [129, 129, 65]),
        ("sphere:32", [32, 32, 32]),
        ("sphere-over-plane:100", [100, 100, 100]),
        ("gyroid:256x256x128", [256, 256, 128]),
        ("torus:2", [2, 2, 2]),
    ] {
        let named = by_name(spec).unwrap().unwrap();
        assert_eq!(named.dims, dims, "{spec}");
        if dims[2] < 100 {
            let spacing = named.sample().unwrap().world_from_grid().spacing();
            assert!(spacing.max_element() - spacing.min_element() < 1e-12, "{spec} {spacing}");
        }
    }
}

#[test]
fn the_bytes_are_the_same_on_every_machine() {
    // Recorded once; they change only with a definition above. No platform libm is involved.
    let hash = |spec: &str| by_name(spec).unwrap().unwrap().sample().unwrap().content_hash();
    let all: Vec<String> = NAMES.iter().map(|n| hash(&format!("{n}:16x15x14"))[..16].to_string()).collect();
    assert_eq!(
        all,
        [
            "912ce1a1e37eafbc",
            "9c9080216d99f5d2",
            "3e73597a9f72746e",
            "6e1354548146a3e4",
            "deddf4a23f1845aa",
            "506a34af8d4f43d5",
            "306edc274ed5a2f4",
            "05a190d59fab58c2",
            "367673c6f7597796",
            "0e038ab9e362d735"
        ]
    );
}

#[test]
fn names_and_sizes_are_parsed_or_refused() {
    for other in ["head.nii.gz", "C:\\data\\bump", "", ":64", "bump", "Sphere"] {
        assert!(by_name(other).unwrap().is_none(), "{other}");
    }
    for bad in ["bumpbox:", "bumpbox:1", "bumpbox:4097", "bumpbox:x", "bumpbox:8x8", "bumpbox:8x8x8x8", "bowl:-3"] {
        let Err(error) = by_name(bad) else { panic!("{bad} was accepted") };
        assert!(error.to_string().contains("2 to 4096 samples"), "{error}");
    }
    assert!(sample(&Sphere, [1, 2, 2]).is_err());
    assert!(matches!(sample(&Sphere, [usize::MAX, 2, 2]), Err(Error::Limit { .. })));
}
