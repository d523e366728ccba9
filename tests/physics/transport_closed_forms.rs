//! VALIDATION 8, 10, 11, 12, 14: scenes whose transfer is known in closed form.

use crate::common::{self, Baked, bake_texels, clamped_cosine, pick, settings, voxels};
use glam::DVec3;
use isolume::sampling::statistics::{T_QUANTILE_95_3, rms};
use isolume::sh;
use isolume::sh::project::gauss_legendre;
use isolume::volume::Solid;
use isolume::volume::field::{Gyroid, SphereOverPlane, sample};
use std::f64::consts::PI;

#[test]
fn a_convex_sphere_has_the_transfer_of_the_clamped_cosine_at_every_radius_and_scale() {
    const N: usize = 65;
    let from_centre = |t: [usize; 3]| DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - 32.0;
    let variants = [
        ("-|x|", 1.0, Solid::Above),
        ("|x|, solid below", -1.0, Solid::Below),
        ("-1e-30 |x|", 1e-30, Solid::Above),
        ("-1e30 |x|", 1e30, Solid::Above),
    ];
    for (name, factor, solid) in variants {
        let mut volume = voxels([N; 3], [-32.0; 3], |p| -p.length() * factor);
        volume.solid = solid;
        for radius in [8.0, 16.0, 24.0] {
            let texels = pick([N; 3], 120, 3, |t| (from_centre(t).length() - radius).abs() < 0.5);
            let baked = bake_texels(&volume, &settings(&[5], 64, 1), &texels);
            let (mut error, mut norm) = (0.0, 0.0);
            for &t in &texels {
                let exact = clamped_cosine(5, from_centre(t).normalize().to_array());
                for (a, b) in baked.transfer(t).iter().zip(&exact) {
                    error += (a - b).powi(2);
                    norm += b * b;
                }
            }
            let error = (error / norm).sqrt();
            println!(
                "{name}, radius {radius}: RMS of T {:.4} %, lost {:.5}",
                100.0 * error,
                baked.summary.lost_share()
            );
            // The facets: samples lie on the sphere, the trilinear surface between them up to
            // (1/8)·Σ h_aa = 1/(4R) voxel inside it, so from a sample the surface only falls away
            // and nothing is hidden. What remains is the tilt of the normal. The B-spline without
            // prefilter smooths with an isotropic second moment, which keeps a radial field radial;
            // the first term with a direction of its own is of fourth order, R⁻⁴ radian, and T
            // changes by about its norm per radian. Rounding to f16 adds 2⁻¹¹ at most.
            let tilt = radius.powi(-4);
            assert!(error <= tilt + 4.9e-4, "{name}, radius {radius}: {error}");
        }
    }
}

/// π T_l0 of a point of a plane under a sphere that hides all directions within asin(s) of the zenith,
/// where s = R/H: ∫ over µ from 0 to cos of 2π µ Y_l0(µ).
fn under_a_sphere(l: usize, s: f64) -> f64 {
    let top = (1.0 - s * s).sqrt();
    let y = |mu: f64| {
        let mut values = vec![0.0; (l + 1) * (l + 1)];
        let sine = (1.0 - mu * mu).sqrt();
        sh::basis::evaluate(l + 1, [sine, 0.0, mu], &mut values);
        values[l * l + l]
    };
    gauss_legendre(16)
        .iter()
        .map(|&(x, w)| {
            let mu = 0.5 * top * (x + 1.0);
            0.5 * top * w * 2.0 * PI * mu * y(mu)
        })
        .sum()
}

#[test]
fn the_point_under_a_sphere_sees_what_the_sphere_leaves() {
    // The table of VALIDATION 10 against the quadrature used below.
    for (s, table) in [
        (0.5, [0.664670, 0.664670, 0.092890, -0.380738, -0.420612]),
        (0.8, [0.319042, 0.221039, -0.164082, -0.324136, -0.106241]),
    ] {
        for l in 0..5 {
            assert!((under_a_sphere(l, s) - table[l]).abs() < 1e-6, "{s} {l}: {}", under_a_sphere(l, s));
        }
    }
    // 32 voxels to the height; the plane z = v of isovalue −v is a layer of samples, and every
    // texel of the column under the centre lies on a level set of its own.
    for (radius, height) in [(0.5, 1.0), (0.8, 1.0)] {
        let scene = SphereOverPlane::new(radius, height).unwrap();
        let volume = sample(&scene, [97, 97, 97]).unwrap();
        let steps = [-4i32, -2, 0, 2, 4];
        let texels: Vec<[usize; 3]> =
            steps.iter().map(|&v| [48, 48, (32 + v) as usize]).filter(|t| radius < 0.6 || t[2] <= 34).collect();
        let baked = bake_texels(&volume, &settings(&[5], 1 << 16, 4), &texels);
        for &t in &texels {
            let v = t[2] as f64 - 32.0;
            let (r, h) = (radius * 32.0 + v, height * 32.0 - v);
            let s = r / h;
            let (found, errors) = (baked.transfer(t), baked.stderr(t));
            let openness = common::ROOT_FOUR_PI * found[0];
            println!(
                "R/H {s:.3} ({r} voxels): openness {openness:.5} ± {:.5}, exact {:.5}",
                common::ROOT_FOUR_PI * errors[0],
                1.0 - s * s
            );
            // The trilinear sphere lies up to δ = 1/(4R) voxel inside the true one: openness is
            // too large by at most 2 s²·δ/R. For T_l the ring that opens has the width of the same
            // solid angle, and |Y_l0| ≤ sqrt((2l+1)/4π) there.
            let ring = 2.0 * s * s / (4.0 * r * r);
            for l in 0..5 {
                for m in 0..2 * l + 1 {
                    let exact = if m == l { under_a_sphere(l, s) / PI } else { 0.0 };
                    let bound = ring * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
                    let noise = 3.0 * T_QUANTILE_95_3 / 2.0 * errors[l];
                    let off = found[l * l + m] - exact;
                    // 2⁻¹¹: rounding to f16.
                    assert!(
                        off.abs() <= bound + noise + exact.abs() * 4.9e-4 + 1e-6,
                        "R/H {s} l {l} m {m}: {off} of {exact}, bound {bound} noise {noise}"
                    );
                }
            }
        }
    }
}

/// Form factor from an element of a floor to a wall of height `w` and half length `b` on both
/// sides at a distance `d` (Siegel & Howell, "Thermal Radiation Heat Transfer", configuration 5
/// twice): (1/π)(atan(b/d) − d/sqrt(d² + w²)·atan(b/sqrt(d² + w²))); b → ∞ gives
/// (1 − d/sqrt(d² + w²))/2.
fn wall(d: f64, w: f64, b: f64) -> f64 {
    let far = (d * d + w * w).sqrt();
    ((b / d).atan() - d / far * (b / far).atan()) / PI
}

#[test]
fn a_wall_hides_half_the_sky_at_its_foot_and_less_further_off() {
    assert!((wall(3.0, 4.0, 1e9) - 0.5 * (1.0 - 0.6)).abs() < 1e-8);
    assert!((wall(1e-9, 4.0, 1e9) - 0.5).abs() < 1e-8);
    // {max(−x, −z) > −v} is x < v or z < v: floor and wall of isovalue −v meet at (v, v).
    // Trilinear interpolation of the maximum is exact there, see the corner values: −v, −v, −v, −v−1.
    let (nx, ny, nz) = (41, 81, 41);
    let volume = voxels([nx, ny, nz], [0.0, -40.0, 0.0], |p| (-p.x).max(-p.z));
    let mut texels = Vec::new();
    for v in [4usize, 10] {
        for d in [1usize, 2, 4, 8, 16] {
            texels.push([v + d, 40, v]);
        }
    }
    let baked = bake_texels(&volume, &settings(&[3], 1 << 14, 9), &texels);
    for &[x, y, v] in &texels {
        let (d, w) = ((x - v) as f64, (nz - 1 - v) as f64);
        let exact = 1.0 - wall(d, w, 40.0);
        let (found, error) = (baked.escape([x, y, v], 0), baked.escape_error([x, y, v], 0));
        println!("isovalue -{v}, {d} voxels from the wall: {found:.5} ± {error:.5}, exact {exact:.5}");
        // At d = 1 the B-spline's normal still feels the wall: not the plane's. From 2 on exact.
        if d >= 2.0 {
            let noise = 3.0 * T_QUANTILE_95_3 / 2.0 * error;
            assert!((found - exact).abs() <= noise + 4.9e-4, "{d}: {found} {exact}");
        }
    }
}

#[test]
fn turning_the_field_and_the_lit_side_over_changes_no_bit() {
    let volume = sample(&Gyroid::default(), [33; 3]).unwrap();
    let isolume::volume::Samples::F32(samples) = volume.samples() else { unreachable!() };
    let negated = isolume::volume::Samples::F32(samples.iter().map(|v| -v).collect());
    let mut flipped = isolume::volume::Volume::new([33; 3], negated, *volume.world_from_grid()).unwrap();
    flipped.solid = Solid::Below;
    // A slope of −1 says the same in a third way.
    let turned = {
        let negated = isolume::volume::Samples::F32(samples.iter().map(|v| -v).collect());
        let v = isolume::volume::Volume::new([33; 3], negated, *volume.world_from_grid()).unwrap();
        v.with_scaling(-1.0, 0.0).unwrap()
    };
    let texels = pick([33; 3], 200, 5, |_| true);
    let bake = |v| -> Baked { bake_texels(v, &settings(&[5, 3], 64, 7), &texels) };
    let reference = bake(&volume);
    assert!(reference.same_bits(&bake(&flipped)));
    assert!(reference.same_bits(&bake(&turned)));
    // And the other side of the same field is another scene.
    let mut inside_out = volume.clone();
    inside_out.solid = Solid::Below;
    let other = bake(&inside_out);
    let difference = rms(texels.iter().map(|&t| reference.escape(t, 0) - other.escape(t, 0)));
    assert!(difference > 0.05, "{difference}");
}

#[test]
fn nothing_leaks_into_a_closed_sphere() {
    let volume = voxels([49; 3], [-24.0; 3], |p| p.length());
    let from_centre = |t: [usize; 3]| DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - 24.0;
    let texels = pick([49; 3], 400, 13, |t| (2.0..23.4).contains(&from_centre(t).length()));
    let baked = bake_texels(&volume, &settings(&[5, 4, 3, 3], 256, 2), &texels);
    println!("{} rays, lost {:.5}", baked.summary.counts.rays, baked.summary.lost_share());
    for &t in &texels {
        assert!(baked.is_valid(t));
        assert!(baked.transfer(t).iter().all(|&v| v == 0.0), "{t:?}: {:?}", &baked.transfer(t)[..4]);
    }
}
