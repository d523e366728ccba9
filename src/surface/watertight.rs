//! The mesh itself against the trilinear level set: topology cell by cell, distance, agreement with rays.

use super::reference::{Refined, Uniform};
use super::*;
use crate::geom::Affine;
use crate::level::{Counts, LevelField, Outcome, Pyramid, Start, cell::trilinear};
use crate::volume::{Samples, Solid};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// A volume whose sample at grid point p is `field(p)`.
fn sampled(dims: [usize; 3], map: Affine, field: impl Fn(DVec3) -> f64) -> Volume {
    let [nx, ny, nz] = dims;
    let at = |i: usize| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64);
    let samples = (0..nx * ny * nz).map(|i| field(at(i)) as f32).collect();
    Volume::new(dims, Samples::F32(samples), map).unwrap()
}

/// The trilinear function of one cell as a volume of 2³ samples.
fn one_cell(d: &[f64; 8]) -> Volume {
    sampled([2; 3], Affine::IDENTITY, |p| d[p.x as usize + 2 * p.y as usize + 4 * p.z as usize])
}

/// Euler characteristic and number of pieces of the mesh of one cell.
fn meshed(d: &[f64; 8], isovalue: f64) -> (i64, u64) {
    let mesh = extract(&one_cell(d), isovalue).unwrap();
    let s = mesh_statistics(&mesh);
    assert_eq!((s.non_manifold_edges, s.non_manifold_vertices, s.unused_vertices), (0, 0, 0), "{d:?}");
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| Vec3::from(mesh.positions_in_grid[v as usize]).as_dvec3());
        assert!((b - a).cross(c - a).length() > 2e-9, "{d:?}");
    }
    (s.euler_characteristic, s.components)
}

/// The same from the definition, on n³ samples. Each piece of the surface parts the cell once more, and every part
/// holds a corner, since the function has no extremes inside.
fn by_definition(d: &[f64; 8], n: usize) -> (i64, u64) {
    let refined = Refined::new(d, n);
    let mut names = refined.corner_components();
    names.sort_unstable();
    let parts = 1 + names.windows(2).filter(|w| w[0] != w[1]).count() as u64;
    (refined.euler_characteristic(), parts - 1)
}

#[test]
fn the_mesh_of_a_random_ambiguous_cell_is_the_trilinear_level_set() {
    const CELLS: u64 = 12_000;
    let counts: Vec<[u64; 3]> = (0..CELLS)
        .into_par_iter()
        .map(|case| {
            let mut uniform = Uniform(case.wrapping_mul(0x5851_F42D_4C95_7F2D));
            // Two diagonal corners of some face solid, the two others lit, the rest of either side; every third
            // cell alternates throughout. Corners are up to 16 times larger on one diagonal, which makes tunnels.
            let boost = 1.0 + 15.0 * uniform.next() * f64::from(u8::from(case % 2 == 0));
            let large = (4.0 * uniform.next()) as usize;
            let d: [f64; 8] = std::array::from_fn(|k| {
                let alternating = k.count_ones() % 2 == 0;
                let solid = if case % 3 == 0 || k < 4 { alternating } else { uniform.next() < 0.5 };
                let magnitude = (0.05 + uniform.next()) * if k == large || k == 7 - large { boost } else { 1.0 };
                // As f32, so that the cell of the reference is the cell of the mesh.
                f64::from((if solid { magnitude } else { -magnitude }) as f32)
            });
            let found = meshed(&d, 0.0);
            let right = [7, 15, 31, 63, 120].into_iter().any(|n| by_definition(&d, n) == found);
            // A neck that closes within 0.002 of the isovalue is too thin for the reference.
            let thin = !right && [-0.002, 0.002].into_iter().any(|shift| meshed(&d, shift) != found);
            assert!(right || thin, "{d:?}: {found:?}, not {:?}", by_definition(&d, 120));
            [u64::from(right), u64::from(thin), u64::from(found.0 != found.1 as i64)]
        })
        .collect();
    let total = counts.iter().fold([0; 3], |sum, c| [0, 1, 2].map(|i| sum[i] + c[i]));
    // Enough tunnels (an annulus has characteristic 0) to be worth something, next to no cell too thin to tell.
    assert!(total[1] * 1000 < CELLS && total[2] > 100, "{total:?}");
}

#[test]
fn every_pattern_is_closed_at_every_scale_in_every_frame() {
    let frames = [
        DMat3::IDENTITY,
        DMat3::from_diagonal(DVec3::new(1.0, -1.0, 100.0)),
        DMat3::from_cols(DVec3::new(0.9, 0.3, 0.0), DVec3::new(0.5, -2.0, 0.4), DVec3::new(0.0, 0.7, 3.0)),
    ];
    (0..256usize).into_par_iter().for_each(|pattern| {
        let mut uniform = Uniform(pattern as u64 + 5000);
        for (round, scale) in [1e-38, 1e-30, 1e-3, 1.0, 1e30].into_iter().enumerate() {
            let map = Affine::new(frames[round % 3], DVec3::splat(1e6)).unwrap();
            let magnitudes: [f64; 8] = std::array::from_fn(|_| 0.1 + uniform.next());
            let mut volume = sampled([4; 3], map, |p| {
                let q = p - 1.0;
                if q.min_element() < 0.0 || q.max_element() > 1.0 {
                    return -scale;
                }
                let k = q.x as usize + 2 * q.y as usize + 4 * q.z as usize;
                scale * if pattern >> k & 1 == 1 { magnitudes[k] } else { -magnitudes[k] }
            });
            for solid in [Solid::Above, Solid::Below] {
                volume.solid = solid;
                let mesh = extract(&volume, 0.0).unwrap();
                let s = mesh_statistics(&mesh);
                let bad = (s.boundary_edges, s.non_manifold_edges, s.non_manifold_vertices, s.unused_vertices);
                assert_eq!(bad, (0, 0, 0, 0), "{pattern:08b} at {scale:e}");
                assert_eq!(
                    (s.triangles == 0, s.euler_characteristic % 2),
                    (pattern == 0, 0),
                    "{pattern:08b} {scale:e}"
                );
                // Fronts look to the lit side: outward with the solid above, inward with it below.
                let point = |v: u32| {
                    let p = Vec3::from(mesh.positions_in_grid[v as usize]).as_dvec3();
                    volume.world_from_grid().vector(p - 1.5)
                };
                let enclosed: f64 =
                    mesh.triangles.iter().map(|t| t.map(point)).map(|[a, b, c]| a.dot(b.cross(c))).sum();
                let outward = if solid == Solid::Above { enclosed } else { -enclosed };
                assert!(pattern == 0 || outward > 0.0, "{pattern:08b} at {scale:e}: {enclosed}");
            }
        }
    });
}

/// Corners of the cell around a point, as [`trilinear`] takes them, and the point in it.
fn cell_at(volume: &Volume, inside: DVec3) -> ([f32; 4], [f32; 4], DVec3) {
    let d = volume.dims();
    let base: [usize; 3] = std::array::from_fn(|a| (inside[a] as usize).min(d[a] - 2));
    let raw = |x: usize, y: usize, z: usize| volume.samples().raw(volume.index(base[0] + x, base[1] + y, base[2] + z));
    let face = |x: usize| [raw(x, 0, 0), raw(x, 1, 0), raw(x, 0, 1), raw(x, 1, 1)];
    (face(0), face(1), DVec3::from_array(base.map(|v| v as f64)))
}

/// Largest Frobenius norm of the second derivatives of a trilinear function in its cell: mixed differences, each
/// linear in the third coordinate, so largest at an end.
fn bend(low: &[f32; 4], high: &[f32; 4]) -> f64 {
    let v = |x: usize, y: usize, z: usize| f64::from(if x == 0 { low[y + 2 * z] } else { high[y + 2 * z] });
    let xy = |z| (v(1, 1, z) - v(1, 0, z) - v(0, 1, z) + v(0, 0, z)).abs();
    let xz = |y| (v(1, y, 1) - v(1, y, 0) - v(0, y, 1) + v(0, y, 0)).abs();
    let yz = |x| (v(x, 1, 1) - v(x, 1, 0) - v(x, 0, 1) + v(x, 0, 0)).abs();
    let most = |f: &dyn Fn(usize) -> f64| f(0).max(f(1)).powi(2);
    (2.0 * (most(&xy) + most(&xz) + most(&yz))).sqrt()
}

/// Bounds |f| on a triangle and returns its bend and size: linear interpolation on a triangle within a circle of
/// radius R is off by at most M R²/2 (Waldron 1998, "The error in linear interpolation at the vertices of a
/// simplex"), R ≤ longest side/√3.
fn sag(low: &[f32; 4], high: &[f32; 4], corners: &[DVec3; 3]) -> f64 {
    let longest = (0..3).map(|k| corners[k].distance_squared(corners[(k + 1) % 3])).fold(0.0, f64::max);
    0.5 * bend(low, high) * longest / 3.0
}

#[test]
fn vertices_lie_on_the_level_set_and_faces_within_their_curvature() {
    let wave = |p: DVec3| (0.5 * p.x).sin() * (0.4 * p.y).cos() + 0.02 * p.z * p.z - 0.3;
    let mut uniform = Uniform(11);
    let noise: Vec<f64> = (0..14 * 14 * 14).map(|_| uniform.next() - 0.5).collect();
    let volumes = [
        ("wave", sampled([20, 19, 18], Affine::IDENTITY, wave)),
        (
            "noise",
            sampled([14; 3], Affine::IDENTITY, |p| noise[p.x as usize + 14 * (p.y as usize + 14 * p.z as usize)]),
        ),
        ("checkers", sampled([9; 3], Affine::IDENTITY, |p| f64::from((p.x + p.y + p.z) as u32 % 2) - 0.3)),
    ];
    for (name, volume) in volumes {
        let mesh = extract(&volume, 0.0).unwrap();
        let (mut inner, mut off) = (0u32, 0u32);
        for t in &mesh.triangles {
            let corners = t.map(|v| Vec3::from(mesh.positions_in_grid[v as usize]).as_dvec3());
            let (low, high, base) = cell_at(&volume, (corners[0] + corners[1] + corners[2]) / 3.0);
            let values = low.iter().chain(&high);
            let (least, most) = values.fold((f32::MAX, f32::MIN), |(l, m), &v| (l.min(v), m.max(v)));
            let range = f64::from(most) - f64::from(least);
            let f = |p: DVec3| f64::from(trilinear(&low, &high, (p - base).as_vec3()));
            // A vertex on an edge is 2⁻¹⁴ voxel off at most, plus the steps of f32 at 20 (2⁻²⁰) and of f.
            let allowed = 1.1e-4 * range;
            let mut residue = allowed;
            for p in corners {
                let whole = p.to_array().iter().filter(|v| v.fract() == 0.0).count();
                if whole >= 2 {
                    assert!(f(p).abs() <= allowed, "{name}: {p}, f = {}", f(p));
                } else {
                    inner += 1;
                    off += u32::from(f(p).abs() > allowed);
                    residue = residue.max(f(p).abs());
                }
            }
            for k in 0..6 {
                let (u, v) = (f64::from(k % 3) / 3.0, f64::from(k / 3) / 3.0);
                let p = corners[0] * (1.0 - u - v).max(0.0) + corners[1] * u.min(1.0 - v) + corners[2] * v;
                let bound = residue + sag(&low, &high, &corners);
                assert!(f(p).abs() <= bound * 1.0001, "{name}: f = {} at {p}, bound {bound}", f(p));
            }
        }
        println!(
            "{name}: {} triangles, {inner} corners inside cells, {off} of them off the level set",
            mesh.triangles.len()
        );
        // Newton steps do not always succeed (35 of 605 on this noise); if they never did, all would be off.
        assert!(name != "noise" || (inner > 500 && off * 4 < inner), "{name}: {off} of {inner}");
    }
}

#[test]
fn rays_meet_the_surface_where_the_mesh_is() {
    let centre = DVec3::splat(15.3);
    let shapes: [(&str, f64, Volume); 2] = [
        ("sphere", 0.8, sampled([32; 3], Affine::IDENTITY, |p| 10.0 - p.distance(centre))),
        (
            "torus",
            0.8,
            sampled([40, 40, 20], Affine::IDENTITY, |p| {
                let q = p - DVec3::new(19.4, 19.6, 9.5);
                5.0 - (q.truncate().length() - 12.0).hypot(q.z)
            }),
        ),
    ];
    for (name, steepness, volume) in shapes {
        let Samples::F32(samples) = volume.samples() else { unreachable!() };
        let pyramid = Pyramid::new(&volume);
        let field = LevelField::new(&volume, samples, &pyramid);
        let mesh = extract(&volume, 0.0).unwrap();
        let mut worst = 0.0f64;
        for t in &mesh.triangles {
            let corners = t.map(|v| Vec3::from(mesh.positions_in_grid[v as usize]).as_dvec3());
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            let (low, high, _) = cell_at(&volume, middle);
            // From one voxel on the lit side straight at the triangle. f is at most `sag` there, and the distance
            // functions sampled here rise by 1 a voxel, by at least 0.8 after trilinear interpolation at these radii and
            // off the normal by a facet's angle. The surface found may lie in the next cell, as bent as this: twice.
            let allowed = (2.0 * sag(&low, &high, &corners) + 1.1e-4) / steepness + 1e-5;
            let start = Start::beside(field.locate((middle + normal).to_array()));
            let outcome = field.trace(0.0, &start, (-normal).as_vec3(), &mut Counts::default());
            let Outcome::Hit(hit) = outcome else { panic!("{name}: {outcome:?} at {middle}") };
            let distance = (hit.at.cell.as_dvec3() + hit.at.local.as_dvec3()).distance(middle);
            assert!(distance <= allowed, "{name}: {distance} from {middle}, allowed {allowed}");
            worst = worst.max(distance);
        }
        // A chord of a cell of a sphere of radius 10 sags by up to 3/8/10; of the tube of radius 5 by twice that.
        println!("{name}: {} triangles, mesh and rays at most {worst} voxels apart", mesh.triangles.len());
        assert!(worst > 1e-4 && worst < 0.075, "{name}: {worst}");
    }
}
