//! Closed forms where nothing can block: what is proven open casts no ray, has no error, and is met by no ray.

use crate::common::{Baked, bake_texels, cases, clamped_cosine, settings, voxels, with_field};
use glam::{DVec3, Vec3};
use isolume::geom::{Frame, Normal};
use isolume::level::{CellPoint, Counts, Horizon, LevelField, Outcome, Pyramid, Site, Start};
use isolume::sampling::{PathSampler, warp};
use isolume::volume::field::by_name;
use isolume::volume::{Sample, SamplesView, Shadowing, Solid, Volume};

fn all_texels(volume: &Volume) -> Vec<[usize; 3]> {
    let [nx, ny, nz] = volume.dims();
    (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny]).collect()
}

/// All texels of the bake are the closed form for their normals, to the rounding of f16: 2⁻¹¹ of a value, and half of
/// the smallest normal number's last bit, 2⁻²⁵; f32 arithmetic before it adds far less than the 10 % allowed for it.
fn assert_closed_form(volume: &Volume, baked: &Baked, normal_at: impl Fn([usize; 3]) -> Option<[f64; 3]>) {
    for texel in all_texels(volume) {
        let Some(normal) = normal_at(texel) else {
            assert!(!baked.is_valid(texel), "{texel:?}");
            continue;
        };
        // All in layer 0.
        let mut closed_form = clamped_cosine(baked.layers().bands()[0], normal);
        closed_form.resize(baked.layers().coefficients(), 0.0);
        for (found, expected) in baked.transfer(texel).iter().zip(closed_form) {
            let allowed = 1.1 * expected.abs() / 2048.0 + 2e-7;
            assert!((found - expected).abs() <= allowed, "{texel:?}: {found} for {expected}");
        }
        assert!(baked.stderr(texel).iter().all(|&e| e == 0.0) && baked.rays(texel) == 0, "{texel:?}");
    }
}

#[test]
fn a_plane_takes_no_ray_and_has_no_error() {
    for normal in [DVec3::Z, DVec3::new(1.0, 2.0, 2.0) / 3.0, DVec3::new(0.6, -0.48, 0.64)] {
        let volume = voxels([14, 11, 13], [-5.0, 3.0, -6.0], |p| 3.0 - 2.0 * p.dot(normal));
        let baked = bake_texels(&volume, &settings(&[5, 3], 16, 1), &all_texels(&volume));
        assert_eq!((baked.summary.counts.rays, baked.summary.paths, baked.summary.lost), (0, 0, 0), "{normal}");
        assert_eq!((baked.summary.open, baked.summary.valid), (14 * 11 * 13, 14 * 11 * 13));
        // Normals of f32 samples: 13 samples of magnitude 60 differ by 2 a step, so 60·2⁻²⁴/2 each.
        let normal = with_field(&volume, |field| field.site([6.0, 5.0, 6.0]).expect("a site").normal.vec().as_dvec3());
        assert_closed_form(&volume, &baked, |texel| {
            let own = with_field(&volume, |field| field.site(texel.map(|t| t as f64)))?.normal.vec().as_dvec3();
            assert!((own - normal).length() < 1e-4);
            Some(own.to_array())
        });
        // Turned round it is a plane as well.
        let mut below = volume;
        below.solid = Solid::Below;
        assert_eq!(bake_texels(&below, &settings(&[2], 16, 1), &all_texels(&below)).summary.counts.rays, 0);
    }
}

#[test]
fn a_sphere_that_declares_itself_convex_takes_no_ray_on_that_side_alone() {
    let mut volume = by_name("sphere:17").unwrap().unwrap().sample().unwrap();
    assert!(volume.is_convex());
    let texels = all_texels(&volume);
    let baked = bake_texels(&volume, &settings(&[5, 4, 3], 16, 1), &texels);
    assert_eq!((baked.summary.counts.rays, baked.summary.open), (0, baked.summary.valid));
    let own = |texel: [usize; 3]| with_field(&volume, |field| field.site(texel.map(|t| t as f64)));
    assert_closed_form(&volume, &baked, |texel| Some(own(texel)?.normal.vec().as_dvec3().to_array()));
    // Its hollow side sees itself.
    volume.solid = Solid::Below;
    let hollow = bake_texels(&volume, &settings(&[2, 2], 16, 1), &texels[..1000]);
    assert!(hollow.summary.counts.rays > 0 && hollow.summary.open < hollow.summary.valid / 2);
    // Told to, everything is traced.
    (volume.solid, volume.shadowing) = (Solid::Above, Shadowing::Traced);
    assert_eq!(bake_texels(&volume, &settings(&[2], 4, 1), &texels[..50]).summary.open, 0);
}

/// Sites of all samples, and which of them are proven open.
fn proven<'s, T: Sample>(field: &LevelField<'_, T>, sites: &'s [Site]) -> Vec<&'s Site> {
    let horizon = Horizon::new(field);
    sites.iter().filter(|site| horizon.proves_open(site)).collect()
}

/// Every sample's site; of the proven ones many rays are traced, and none may meet anything, near or far.
fn check<T: Sample>(name: &str, volume: &Volume, samples: &[T], rays: u32) -> (usize, usize) {
    let pyramid = Pyramid::new(volume);
    let field = LevelField::new(volume, samples, &pyramid);
    let at = |texel: [usize; 3]| field.site(texel.map(|t| t as f64));
    let sites: Vec<Site> = all_texels(volume).into_iter().filter_map(at).collect();
    let proven = proven(&field, &sites);
    for (i, site) in proven.iter().enumerate() {
        let sampler = PathSampler::new(3, i as u64, 0);
        for ray in 0..rays {
            let local = warp::square_to_cosine_hemisphere(sampler.pair(ray, 0));
            let in_grid = field.direction_in_grid(Frame::around(site.normal).from_local(local));
            let outcome = field.trace(site.isovalue, &site.start, in_grid, &mut Counts::default());
            assert_eq!(outcome, Outcome::Escaped, "{name}: {site:?} along {in_grid}");
        }
    }
    (proven.len(), sites.len())
}

fn check_any(name: &str, volume: &Volume, rays: u32) -> (usize, usize) {
    match volume.samples().view() {
        SamplesView::U8(s) => check(name, volume, s, rays),
        SamplesView::I8(s) => check(name, volume, s, rays),
        SamplesView::U16(s) => check(name, volume, s, rays),
        SamplesView::I16(s) => check(name, volume, s, rays),
        SamplesView::F32(s) => check(name, volume, s, rays),
    }
}

#[test]
fn no_ray_of_a_proven_texel_meets_anything() {
    let mut found = 0;
    for case in cases::volumes() {
        let Ok(volume) = case.volume else { continue };
        if volume.dims().iter().any(|&n| n < 2) || volume.samples().len() > 1 << 16 {
            continue;
        }
        found += check_any(&case.name, &volume, 32).0;
    }
    assert!(found > 100, "{found} texels of the case table were proven open: the test says nothing");
    // Fields whose level sets are smooth: a proof succeeds where they are convex, and seldom elsewhere.
    for (name, least, most) in
        [("sphere:25", 0.1, 1.0), ("bumpbox:25", 0.05, 0.9), ("torus:25", 0.001, 0.6), ("gyroid:25", 0.0, 0.2)]
    {
        let volume = by_name(name).unwrap().unwrap().sample().unwrap();
        let (open, sites) = check_any(name, &volume, 16);
        let share = open as f64 / sites as f64;
        assert!((least..=most).contains(&share), "{name}: {share}");
    }
}

#[test]
fn a_speck_above_the_horizon_is_not_overlooked() {
    // A floor, and one sample that stands out of it far away: seen from all the floor, from nowhere above itself.
    let speck = DVec3::new(28.0, 27.0, 9.0);
    let volume = voxels([32, 32, 20], [0.0; 3], |p| if p == speck { 30.0 } else { -p.z });
    with_field(&volume, |field| {
        let horizon = Horizon::new(field);
        let open = |x: f64, y: f64, z: f64| horizon.proves_open(&field.site([x, y, z]).expect("a site"));
        for (x, y) in [(1.0, 1.0), (0.0, 31.0), (15.0, 16.0), (24.0, 27.0)] {
            assert!(!(1..=7).any(|z| open(x, y, f64::from(z))), "{x} {y}");
            // Its cells end at z = 10.
            assert!((11..=18).all(|z| open(x, y, f64::from(z))), "{x} {y}");
        }
    });
    // A ceiling of one layer over half of the floor.
    let volume = voxels([32, 32, 20], [0.0; 3], |p| if p.z >= 18.0 && p.x >= 20.0 { 30.0 } else { -p.z });
    with_field(&volume, |field| {
        let horizon = Horizon::new(field);
        let floor = [[2.0, 5.0, 4.0], [18.0, 16.0, 8.0], [25.0, 16.0, 3.0]].map(|p| field.site(p).expect("a site"));
        assert!(floor.iter().all(|site| !horizon.proves_open(site)));
    });
}

#[test]
fn starts_in_the_solid_and_normals_that_point_into_it_prove_nothing() {
    let volume = voxels([16, 16, 16], [-7.5; 3], |p| -p.length());
    with_field(&volume, |field| {
        let horizon = Horizon::new(field);
        let open = |p: [f64; 3]| field.site(p).filter(|site| horizon.proves_open(site));
        let site = (0..16).find_map(|x| open([f64::from(x), 8.0, 8.0])).expect("a proven texel");
        let turned = Site { normal: Normal::down_gradient(site.normal.vec()).expect("a normal"), ..site };
        assert!(!horizon.proves_open(&turned), "the other way is the solid");
        // A cell deeper, with the side to be told by the field: in the solid.
        let inward = field.locate((site.start.at.in_grid() - 1.2 * site.normal.vec()).as_dvec3().to_array());
        assert!(!horizon.proves_open(&Site { start: Start::beside(inward), ..site }));
        // The same start said to be on the surface: everything around it is solid.
        assert!(!horizon.proves_open(&Site { start: Start::on(inward), ..site }));
        // Half-buried: the surface passes through the cell of the start.
        let half: CellPoint = field.locate((site.start.at.in_grid() - 0.4 * site.normal.vec()).as_dvec3().to_array());
        assert!(!horizon.proves_open(&Site { start: Start::on(half), ..site }));
        // Tilted normals leave part of the sphere above their plane.
        let tilted = site.normal.vec() + 0.6 * Frame::around(site.normal).from_local(Vec3::X);
        let tilted = Site { normal: Normal::down_gradient(-tilted).expect("a normal"), ..site };
        assert!(!horizon.proves_open(&tilted));
    });
}

#[test]
fn where_nothing_is_proven_no_byte_changes_and_partitions_agree() {
    let mut volume = by_name("bumpbox:20").unwrap().unwrap().sample().unwrap();
    let texels = all_texels(&volume);
    let how = settings(&[3, 2], 8, 5);
    let found = bake_texels(&volume, &how, &texels);
    let (open, valid) = (found.summary.open, found.summary.valid);
    assert!(open > valid / 50 && open < valid, "{open} of {valid}");
    let halves: Vec<Vec<[usize; 3]>> =
        [0, 1].map(|part| texels.iter().copied().filter(|t| (t[0] + t[1] + t[2]) % 2 == part).collect()).into();
    let parts: Vec<Baked> = halves.iter().map(|half| bake_texels(&volume, &how, half)).collect();
    volume.shadowing = Shadowing::Traced;
    let traced = bake_texels(&volume, &how, &texels);
    assert_eq!(traced.summary.open, 0);
    let mut closed = 0;
    for &texel in &texels {
        let part = &parts[(texel[0] + texel[1] + texel[2]) % 2];
        assert_eq!((part.transfer(texel), part.rays(texel)), (found.transfer(texel), found.rays(texel)), "{texel:?}");
        if found.is_valid(texel) && found.rays(texel) == 0 {
            closed += 1;
            // The rays that were saved saw nothing.
            assert_eq!(traced.escape(texel, 1), 0.0, "{texel:?}");
        } else {
            assert_eq!(found.transfer(texel), traced.transfer(texel), "{texel:?}");
            assert_eq!(found.stderr(texel), traced.stderr(texel), "{texel:?}");
        }
    }
    assert_eq!(closed, open);
}
