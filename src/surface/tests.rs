use super::cell::edge_corners;
use super::decide::{face_decisions, tunnel};
use super::reference::{Refined, Uniform};
use super::table::{TABLE, cycles, regions};
use super::*;
use crate::geom::Affine;
use crate::grid3;
use crate::volume::{Samples, Solid};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

fn volume(dims: [usize; 3], samples: Vec<f32>) -> Volume {
    Volume::new(dims, Samples::F32(samples), Affine::IDENTITY).unwrap()
}

/// A volume whose sample at grid point p is `field(p)`.
fn sampled(dims: [usize; 3], field: impl Fn(DVec3) -> f64) -> Volume {
    let mut samples = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            samples.extend((0..dims[0]).map(|x| field(DVec3::new(x as f64, y as f64, z as f64)) as f32));
        }
    }
    volume(dims, samples)
}

/// White noise in (−1, 1), inside one layer of samples at −1.
fn padded_noise(n: usize, seed: u64) -> Volume {
    let mut uniform = Uniform(seed);
    let last = (n + 1) as f64;
    let noise: Vec<f64> = (0..n * n * n).map(|_| 2.0 * uniform.next() - 1.0).collect();
    sampled([n + 2; 3], |p| {
        if p.min_element() < 1.0 || p.max_element() >= last {
            return -1.0;
        }
        let p = (p - 1.0).as_usizevec3();
        noise[p.x + n * (p.y + n * p.z)]
    })
}

fn assert_closed(mesh: &Mesh, what: &str) -> MeshStatistics {
    let s = mesh_statistics(mesh);
    assert_eq!(
        (s.boundary_edges, s.non_manifold_edges, s.non_manifold_vertices, s.unused_vertices),
        (0, 0, 0, 0),
        "{what}: {s:?}"
    );
    s
}

/// Six times the volume that the triangles enclose, in world space; positive when fronts look out.
fn signed_volume(volume: &Volume, mesh: &Mesh) -> f64 {
    let point = |v: u32| volume.world_from_grid().point(Vec3::from(mesh.positions_in_grid[v as usize]).as_dvec3());
    let origin = volume.world_bounds().centre();
    mesh.triangles.iter().map(|t| t.map(|v| point(v) - origin)).map(|[a, b, c]| a.dot(b.cross(c))).sum()
}

fn least_area(mesh: &Mesh) -> f64 {
    let point = |v: u32| Vec3::from(mesh.positions_in_grid[v as usize]).as_dvec3();
    let areas = mesh.triangles.iter().map(|t| t.map(point)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length());
    areas.fold(f64::INFINITY, f64::min)
}

/// All corner values of all cells.
fn cells(volume: &Volume, isovalue: f64) -> Vec<[f64; 8]> {
    let [nx, ny, nz] = volume.dims();
    let sign = f64::from(volume.solid_sign());
    let mut cells = Vec::new();
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            for x in 0..nx - 1 {
                cells.push(std::array::from_fn(|k| {
                    let i = volume.index(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2));
                    sign * (f64::from(volume.samples().raw(i)) - isovalue)
                }));
            }
        }
    }
    cells
}

/// What the extraction thinks of one cell: contour cycles less two for a tunnel, and the
/// component of each corner.
fn decided(d: &[f64; 8]) -> (i64, [u8; 8], usize) {
    let solid = (0..8).fold(0u8, |p, k| p | u8::from(d[k] > 0.0) << k);
    let ambiguous = TABLE.patterns[usize::from(solid)].ambiguous;
    let mut decisions = face_decisions(d, ambiguous);
    let joined: [bool; 6] = std::array::from_fn(|face| {
        let here = ambiguous >> face & 1 == 1;
        let joined = here && decisions & 1 == 1;
        decisions >>= u32::from(here);
        joined
    });
    let cycles = cycles(solid, &joined).len();
    let mut regions = regions(solid, &joined);
    let tunnel = tunnel(d, &regions);
    if let Some([r, s]) = tunnel {
        regions.iter_mut().filter(|region| **region == s).for_each(|region| *region = r);
    }
    (cycles as i64 - 2 * i64::from(tunnel.is_some()), regions, cycles)
}

/// Compares a cell with the refined reference. The reference converges to the truth, so a
/// difference at a coarse refinement must vanish at a finer one; false if it is still there at
/// 1/120 of the cell.
fn agrees(d: &[f64; 8]) -> bool {
    let (euler, components, _) = decided(d);
    [7, 15, 31, 63, 120].into_iter().any(|n| {
        let refined = Refined::new(d, n);
        refined.euler_characteristic() == euler && refined.corner_components() == components
    })
}

/// Whether the topology changes within 0.002 of the isovalue (values are of the order of 1): such
/// a cell has a neck too thin for the reference.
fn is_near_critical(d: &[f64; 8]) -> bool {
    [-0.002, 0.002].into_iter().any(|shift| decided(&d.map(|v| v + shift)) != decided(d))
}

/// Compares random cells with the reference; returns how many have a tunnel.
fn compare_cells(count: u64, cell: impl Fn(u64, &mut Uniform) -> [f64; 8] + Sync) -> usize {
    let results: Vec<(bool, bool, bool)> = (0..count)
        .into_par_iter()
        .map(|case| {
            let d = cell(case, &mut Uniform(case.wrapping_mul(0x1234_5677)));
            let (euler, _, cycles) = decided(&d);
            (agrees(&d), is_near_critical(&d), euler != cycles as i64)
        })
        .collect();
    let wrong = results.iter().filter(|r| !r.0 && !r.1).count();
    let thin = results.iter().filter(|r| !r.0 && r.1).count();
    assert_eq!(wrong, 0);
    assert!(thin as u64 * 1000 < count, "{thin} of {count} cells too thin to tell");
    results.iter().filter(|r| r.2).count()
}

#[test]
fn every_pattern_has_the_topology_of_the_refined_cell() {
    // Every second cell has two opposite corners made large, which makes tunnels.
    let tunnels = compare_cells(256 * 40, |case, uniform| {
        let boost = if case % 2 == 0 { 1.0 + 15.0 * uniform.next() } else { 1.0 };
        let corner = (4.0 * uniform.next()) as usize;
        std::array::from_fn(|k| {
            let magnitude = (0.05 + uniform.next()) * if k == corner || k == 7 - corner { boost } else { 1.0 };
            if (case / 40) >> k & 1 == 1 { magnitude } else { -magnitude }
        })
    });
    println!("{tunnels} tunnels");
    assert!(tunnels > 60, "{tunnels}");
}

#[test]
fn alternating_cells_have_the_topology_of_the_refined_cell() {
    // Chernyaev's case 13, all six faces ambiguous, where published tests err.
    let tunnels = compare_cells(8000, |_, uniform| {
        std::array::from_fn(|k| (0.05 + uniform.next()) * if k.count_ones() % 2 == 0 { 1.0 } else { -1.0 })
    });
    println!("{tunnels} tunnels");
    assert!(tunnels > 50, "{tunnels}");
}

#[test]
fn tunnels_do_not_depend_on_the_axis_of_the_slices() {
    // A cyclic permutation of the axes, and mirrors, must permute the components of the corners.
    let different: usize = (0..300_000u64)
        .into_par_iter()
        .map(|seed| {
            let mut uniform = Uniform(seed * 31337);
            let even: f64 = if seed % 2 == 0 { 1.0 } else { 0.3 };
            let d: [f64; 8] = std::array::from_fn(|k| {
                let alternating = if k.count_ones() % 2 == 0 { 1.0 } else { -1.0 };
                (uniform.next() - 0.5) * (1.0 - even) + alternating * even * uniform.next()
            });
            let (euler, components, _) = decided(&d);
            let moved = [1, 2].into_iter().flat_map(|turn| (0..8).map(move |mirror| (turn, mirror)));
            moved
                .filter(|&(turn, mirror)| {
                    let from = |k: usize| ((k << turn | k >> (3 - turn)) & 7) ^ mirror;
                    let (other_euler, other, _) = decided(&std::array::from_fn(|k| d[from(k)]));
                    let same = (0..64).all(|i| {
                        let (a, b) = (i / 8, i % 8);
                        (other[a] == other[b]) == (components[from(a)] == components[from(b)])
                    });
                    !(same && other_euler == euler)
                })
                .count()
        })
        .sum();
    assert_eq!(different, 0);
}

#[test]
fn noise_has_the_euler_characteristic_of_the_refined_trilinear_level_set() {
    // The surface is cut by the grid into points on edges (+1 each), open segments on faces
    // (−1 each) and its parts in open cells, whose characteristic is that of the closed part:
    // a cycle adds 0.
    let volume = padded_noise(33, 5);
    let mesh = extract(&volume, 0.0).unwrap();
    let statistics = assert_closed(&mesh, "noise");
    assert!(least_area(&mesh) > 1e-9, "{}", least_area(&mesh));
    let sign = |i: usize| volume.samples().raw(i) > 0.0;
    let n = 35;
    let (mut edges, mut segments) = (0, 0);
    for i in 0..n * n * n {
        let at = grid3::at([n, n], i);
        for (axis, step) in [1, n, n * n].into_iter().enumerate() {
            edges += i64::from(at[axis] + 1 < n && sign(i) != sign(i + step));
            let next = (axis + 1) % 3;
            if at[axis] + 1 < n && at[next] + 1 < n {
                let other = [1, n, n * n][next];
                let around = [sign(i), sign(i + step), sign(i + step + other), sign(i + other)];
                segments += (0..4).filter(|&k| around[k] != around[(k + 1) % 4]).count() as i64 / 2;
            }
        }
    }
    let cells = cells(&volume, 0.0);
    // Refined to n = 15, and where that differs from the extraction, on: see `agrees`.
    let refine = |d: &[f64; 8]| {
        let own = decided(d).0;
        let at = |n| (Refined::new(d, n).euler_characteristic(), n);
        [15, 31, 63].into_iter().map(at).find(|r| r.0 == own).unwrap_or_else(|| at(120))
    };
    let refined: Vec<(i64, usize)> = cells.par_iter().map(refine).collect();
    let reference = edges - segments + refined.iter().map(|r| r.0).sum::<i64>();
    let finer = |n| refined.iter().filter(|r| r.1 > n).count();
    println!("χ {reference}; {} cells, {} refined beyond 15, {} beyond 63", cells.len(), finer(15), finer(63));
    assert_eq!(statistics.euler_characteristic, reference);
    assert!(finer(63) * 1000 < cells.len());
}

#[test]
fn every_pattern_is_closed_and_manifold_in_lit_and_in_solid_surroundings() {
    (0..256usize).into_par_iter().for_each(|pattern| {
        let mut uniform = Uniform(pattern as u64);
        for round in 0..24 {
            for padding in [-1.0f32, 1.0] {
                let mut samples = vec![padding; 64];
                for k in 0..8 {
                    // Every third round has ties: magnitudes 1 only, lit corners at 0 or −1.
                    let magnitude = if round % 3 == 0 { 1.0 } else { uniform.next() as f32 };
                    let lit = if round % 6 == 0 && uniform.next() < 0.5 { 0.0 } else { -magnitude };
                    let (x, y, z) = (1 + (k & 1), 1 + (k >> 1 & 1), 1 + (k >> 2));
                    samples[x + 4 * (y + 4 * z)] = if pattern >> k & 1 == 1 { magnitude } else { lit };
                }
                let volume = volume([4; 3], samples);
                let mesh = extract(&volume, 0.0).unwrap();
                let statistics = assert_closed(&mesh, &format!("pattern {pattern:08b} round {round}"));
                assert_eq!(statistics.euler_characteristic % 2, 0);
                assert_eq!(statistics.triangles == 0, pattern == if padding > 0.0 { 255 } else { 0 });
                assert!(mesh.triangles.is_empty() || least_area(&mesh) > 1e-9, "{}", least_area(&mesh));
                let outside = signed_volume(&volume, &mesh) * f64::from(-padding);
                assert!(mesh.triangles.is_empty() || outside > 0.0, "{pattern:08b}");
            }
        }
    });
}

#[test]
fn whole_numbers_full_of_ties_stay_closed_and_without_degenerate_triangles() {
    let mut uniform = Uniform(77);
    let n = 24;
    for levels in [3.0, 6.0, 256.0] {
        let mut samples = vec![0u8; n * n * n];
        for z in 1..n - 1 {
            for y in 1..n - 1 {
                for x in 1..n - 1 {
                    samples[grid3::index([n, n], [x, y, z])] = (levels * uniform.next()) as u8;
                }
            }
        }
        let volume = Volume::new([n; 3], Samples::U8(samples), Affine::IDENTITY).unwrap();
        for isovalue in [0.0, 1.0, 1.5, 2.0, 127.0] {
            let mesh = extract(&volume, isovalue).unwrap();
            assert_closed(&mesh, &format!("{levels} levels at {isovalue}"));
            assert!(mesh.triangles.is_empty() || least_area(&mesh) > 1e-9, "{}", least_area(&mesh));
            for n in &mesh.normals {
                assert!((Vec3::from(*n).length() - 1.0).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn spheres_and_tori_have_their_characteristic_and_position() {
    let centre = DVec3::splat(15.3);
    let sphere = sampled([32; 3], |p| 10.0 - p.distance(centre));
    let mesh = extract(&sphere, 0.0).unwrap();
    let s = assert_closed(&mesh, "sphere");
    assert_eq!((s.euler_characteristic, s.components), (2, 1));
    // A chord of a sphere of radius 10 across a cell stays within 3/8/10 of it; normals differ from
    // the radius by at most about a cell's angle.
    for (p, n) in mesh.positions_in_grid.iter().zip(&mesh.normals) {
        let radius = Vec3::from(*p).as_dvec3() - centre;
        assert!((radius.length() - 10.0).abs() < 0.0375, "{}", radius.length());
        assert!(radius.normalize().dot(Vec3::from(*n).as_dvec3()) > 0.98);
    }
    let ball = 6.0 * 4.0 / 3.0 * std::f64::consts::PI * 1000.0;
    assert!((signed_volume(&sphere, &mesh) / ball - 1.0).abs() < 0.02);
    let torus = sampled([40, 40, 20], |p| {
        let q = p - DVec3::new(19.4, 19.6, 9.5);
        5.0 - (q.truncate().length() - 12.0).hypot(q.z)
    });
    let s = assert_closed(&extract(&torus, 0.0).unwrap(), "torus");
    assert_eq!((s.euler_characteristic, s.components), (0, 1));
}

#[test]
fn a_gyroid_is_open_on_the_box_only() {
    let n = 48;
    let gyroid = sampled([n; 3], |p| {
        let q = p * (std::f64::consts::TAU / 16.0);
        q.x.sin() * q.y.cos() + q.y.sin() * q.z.cos() + q.z.sin() * q.x.cos()
    });
    let mesh = extract(&gyroid, 0.1).unwrap();
    let s = mesh_statistics(&mesh);
    assert_eq!((s.non_manifold_edges, s.non_manifold_vertices), (0, 0));
    assert!(s.boundary_edges > 0);
    assert_open_on_the_box_only(&mesh, [n; 3]);
}

fn assert_open_on_the_box_only(mesh: &Mesh, dims: [usize; 3]) {
    let mut uses = std::collections::HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *uses.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    for ((a, b), _) in uses.into_iter().filter(|(_, count)| *count == 1) {
        let [p, q] = [a, b].map(|v| mesh.positions_in_grid[v as usize]);
        let on_a_face = (0..3).any(|k| p[k] == q[k] && (p[k] == 0.0 || p[k] == (dims[k] - 1) as f32));
        assert!(on_a_face, "boundary edge {p:?} {q:?}");
    }
}

/// Real scans, if they are there. Both files end with their samples, x fastest, so no reader is
/// needed here.
#[test]
fn scans_are_closed_up_to_the_box() {
    let root = std::env::var_os("ISOLUME_DATA")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), Into::into);
    let files = [
        ("ironprot.vtk", [68, 68, 68], &[40.0, 128.0, 220.0][..]),
        ("mni152_t1_2mm.nii.gz", [98, 116, 94], &[90.0, 160.0, 210.0]),
    ];
    for (name, dims, isovalues) in files {
        let Ok(mut bytes) = std::fs::read(root.join("volumes").join(name)) else {
            println!("skipped: no {name} in {}", root.display());
            continue;
        };
        if name.ends_with(".gz") {
            let mut plain = Vec::new();
            std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&bytes[..]), &mut plain).unwrap();
            bytes = plain;
        }
        let samples = bytes.split_off(bytes.len() - dims.iter().product::<usize>());
        let volume = Volume::new(dims, Samples::U8(samples), Affine::IDENTITY).unwrap();
        for &isovalue in isovalues {
            let mesh = extract(&volume, isovalue).unwrap();
            let s = mesh_statistics(&mesh);
            println!("{name} at {isovalue}: {s:?}");
            assert!(s.triangles > 1000);
            assert_eq!((s.non_manifold_edges, s.non_manifold_vertices, s.unused_vertices), (0, 0, 0));
            assert!(least_area(&mesh) > 1e-9);
            assert_open_on_the_box_only(&mesh, dims);
        }
    }
}

#[test]
fn vertices_on_edges_are_within_a_ten_thousandth_of_the_interpolant() {
    let volume = padded_noise(20, 9);
    let mesh = extract(&volume, 0.25).unwrap();
    let mut on_edges = 0;
    for p in &mesh.positions_in_grid {
        let whole = p.map(|v| v == v.floor());
        let Some(axis) = (0..3).find(|&a| !whole[a] && whole[(a + 1) % 3] && whole[(a + 2) % 3]) else {
            continue;
        };
        on_edges += 1;
        let low = p.map(|v| v.floor() as usize);
        let mut high = low;
        high[axis] += 1;
        let [a, b] = [low, high].map(|q| f64::from(volume.samples().raw(volume.index(q[0], q[1], q[2]))));
        let exact = low[axis] as f64 + (0.25 - a) / (b - a);
        assert!((f64::from(p[axis]) - exact).abs() < 1e-4, "{p:?} {exact}");
    }
    assert!(on_edges > 5000, "{on_edges}");
}

#[test]
fn the_mesh_does_not_depend_on_the_number_of_threads() {
    let volume = padded_noise(40, 3);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| extract(&volume, 0.1).unwrap())
    };
    let one = on(1);
    assert!(one.triangles.len() > 100_000);
    for threads in [2, 3, 7] {
        assert_eq!(on(threads), one, "{threads} threads");
    }
}

#[test]
fn a_negated_field_with_the_other_solid_gives_the_same_mesh() {
    let volume = padded_noise(16, 21);
    let Samples::F32(samples) = volume.samples() else { unreachable!() };
    let mut negated = self::volume([18; 3], samples.iter().map(|v| -v).collect());
    negated.solid = Solid::Below;
    assert_eq!(extract(&negated, -0.3).unwrap(), extract(&volume, 0.3).unwrap());
    // A negative slope does the same through the decoding.
    let mut scaled = volume.clone().with_scaling(-2.0, 1.0).unwrap();
    scaled.solid = Solid::Below;
    assert_eq!(extract(&scaled, 1.0 - 2.0 * 0.25).unwrap(), extract(&volume, 0.25).unwrap());
    // Solid below alone: the same vertices, seen from the other side.
    let mut below = volume.clone();
    below.solid = Solid::Below;
    let (inner, outer) = (extract(&below, 0.3).unwrap(), extract(&volume, 0.3).unwrap());
    assert_closed(&inner, "below");
    assert!(signed_volume(&below, &inner) < 0.0 && signed_volume(&volume, &outer) > 0.0);
}

#[test]
fn fronts_and_normals_look_to_the_lit_side_in_every_frame() {
    let centre = DVec3::splat(8.0);
    let base = sampled([17; 3], |p| 6.0 - p.distance(centre));
    let Samples::F32(samples) = base.samples() else { unreachable!() };
    let frames = [
        DMat3::from_diagonal(DVec3::new(0.5, 1.0, 3.0)),
        DMat3::from_diagonal(DVec3::new(-1e-3, 1e-3, 1e-3)),
        DMat3::from_cols(DVec3::new(0.0, 2.0, 0.3), DVec3::new(1.0, 0.1, 0.0), DVec3::new(0.0, 0.5, 1e3)),
    ];
    for frame in frames {
        let affine = Affine::new(frame, DVec3::splat(5.0)).unwrap();
        let volume = Volume::new([17; 3], Samples::F32(samples.clone()), affine).unwrap();
        let mesh = extract(&volume, 0.0).unwrap();
        assert!(signed_volume(&volume, &mesh) > 0.0, "{frame}");
        for (p, n) in mesh.positions_in_grid.iter().zip(&mesh.normals) {
            // −∇h in grid space, as a covector in world.
            let gradient = affine.gradient_matrix() * (Vec3::from(*p) - centre.as_vec3());
            assert!(gradient.normalize().dot(Vec3::from(*n)) > 0.97);
        }
    }
}

#[test]
fn given_normals_are_normalised_and_replaced_where_there_is_none() {
    let volume = sampled([12; 3], |p| 4.0 - p.distance(DVec3::splat(5.5)));
    let facets = extract(&volume, 0.0).unwrap();
    let given = extract_with_normals(&volume, 0.0, &|p| match p[0] {
        x if x < 4.0 => [0.0; 3],
        x if x < 7.0 => [f32::NAN, 0.0, 1.0],
        _ => [0.0, 0.0, 1e20],
    })
    .unwrap();
    assert_eq!(given.positions_in_grid, facets.positions_in_grid);
    for ((p, n), f) in given.positions_in_grid.iter().zip(&given.normals).zip(&facets.normals) {
        assert_eq!(*n, if p[0] < 7.0 { *f } else { [0.0, 0.0, 1.0] });
    }
}

#[test]
fn straddling_cells_are_those_with_triangles() {
    let mut volume = padded_noise(9, 4);
    for solid in [Solid::Above, Solid::Below] {
        volume.solid = solid;
        for isovalue in [-1.0, 0.0, 0.9, 2.0] {
            let straddling = straddling_cells(&volume, isovalue);
            let mesh = extract(&volume, isovalue).unwrap();
            let mut with_triangles = std::collections::BTreeSet::new();
            for t in &mesh.triangles {
                let corners = t.map(|v| Vec3::from(mesh.positions_in_grid[v as usize]));
                let cell = ((corners[0] + corners[1] + corners[2]) / 3.0).floor().as_usizevec3();
                with_triangles.insert((cell.z, cell.y, cell.x));
            }
            assert_eq!(straddling.dims(), [10; 3]);
            let mut listed = std::collections::BTreeSet::new();
            for z in 0..10 {
                straddling.for_each_in_slab(z, |x, y| {
                    assert!(straddling.contains(x, y, z) && listed.insert((z, y, x)));
                });
            }
            assert_eq!(straddling.count() as usize, listed.len());
            assert_eq!(count_straddling_cells(&volume, isovalue) as usize, listed.len());
            assert_eq!(listed, with_triangles);
        }
    }
}

#[test]
fn small_and_flat_grids() {
    for dims in [[1, 5, 6], [5, 1, 6], [5, 6, 1], [1, 1, 1]] {
        let volume = sampled(dims, |p| p.x + p.y + p.z - 2.5);
        assert_eq!(extract(&volume, 0.0).unwrap(), Mesh::default());
        assert_eq!((straddling_cells(&volume, 0.0).count(), count_straddling_cells(&volume, 0.0)), (0, 0));
    }
    let cell = sampled([2; 3], |p| 0.5 - p.x);
    let mesh = extract(&cell, 0.0).unwrap();
    assert_eq!((mesh.positions_in_grid.len(), mesh.triangles.len()), (4, 2));
    assert!(mesh.positions_in_grid.iter().all(|p| p[0] == 0.5));
    assert!(mesh.normals.iter().all(|n| *n == [1.0, 0.0, 0.0]));
    assert_eq!(extract(&cell, 7.0).unwrap(), Mesh::default());
    assert!(matches!(extract(&cell, f64::NAN), Err(Error::Argument { .. })));
}

#[test]
fn too_many_vertices_are_an_error() {
    let samples = [1.0f32, 0.0].repeat(4);
    assert!(fill::level_set([2; 3], &samples, 0.5, 1.0, false, 4).is_ok());
    let error = fill::level_set([2; 3], &samples, 0.5, 1.0, false, 3).err().unwrap();
    assert!(error.to_string().contains("4 vertices"), "{error}");
}

#[test]
fn the_contours_of_a_face_are_the_same_from_both_sides() {
    // Two cells that share a face, with values that tie the decider in half of the cases: the
    // segments, as pairs of grid edges, must be equal with opposite directions.
    let mut uniform = Uniform(1);
    for round in 0..20_000 {
        let mut value = || if round % 2 == 0 { (uniform.next() * 5.0).floor() - 2.0 } else { uniform.next() - 0.5 };
        let middle: [f64; 4] = std::array::from_fn(|_| value());
        let outer: [f64; 8] = std::array::from_fn(|_| value());
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let on_face = |k: usize| (k >> u & 1) | (k >> v & 1) << 1;
            let below: [f64; 8] =
                std::array::from_fn(|k| if k >> axis & 1 == 1 { middle[on_face(k)] } else { outer[k] });
            let above: [f64; 8] =
                std::array::from_fn(|k| if k >> axis & 1 == 0 { middle[on_face(k)] } else { outer[k] });
            let segments = |d: &[f64; 8], side: usize, reverse: bool| {
                let solid = (0..8).fold(0u8, |p, k| p | u8::from(d[k] > 0.0) << k);
                let pattern = TABLE.patterns[usize::from(solid)];
                let offset = usize::from(face_decisions(d, pattern.ambiguous));
                let plan = TABLE.plans[usize::from(TABLE.configurations[usize::from(pattern.first) + offset].disks)];
                let place = |e: u8| {
                    (e < 12).then(|| edge_corners(e.into())).filter(|c| c.iter().all(|c| c >> axis & 1 == side))
                };
                let mut found = Vec::new();
                for t in TABLE.triangles(plan) {
                    for k in 0..3 {
                        if let (Some(a), Some(b)) = (place(t[k]), place(t[(k + 1) % 3])) {
                            let pair = [a.map(on_face), b.map(on_face)];
                            found.push(if reverse { [pair[1], pair[0]] } else { pair });
                        }
                    }
                }
                found.sort_unstable();
                found
            };
            assert_eq!(segments(&below, 1, false), segments(&above, 0, true));
        }
    }
}

/// A soft point of reach 1 has the isovalue ½ at the radius ½. Positions below 32 in single precision are within 2⁻²⁰ voxel,
/// those near the ends of an edge 2⁻¹⁴.
#[test]
fn exact_vertices_lie_on_the_model_with_its_normals_and_the_same_triangles() {
    use crate::model::{Falloff, Leaf, Node, Shape, Skeletal, Tree};
    let centre = DVec3::new(0.013, -0.021, 0.007);
    let shape = Shape::Point(centre);
    let leaf = Leaf::Skeletal(Skeletal { shape, reach: [1.0; 2], falloff: Falloff::Soft, weight: 1.0 });
    let tree = std::sync::Arc::new(Tree::new(Node::leaf(leaf)).unwrap());
    let n = 19;
    let voxel = 1.4 / (n - 1) as f64;
    let mut samples = Vec::new();
    tree.sample(&crate::geom::Bounds { min: DVec3::splat(-0.7), max: DVec3::splat(0.7) }, [n; 3], true, &mut samples);
    let world_from_grid = Affine::from_spacing(DVec3::splat(voxel), DVec3::splat(-0.7)).unwrap();
    for (solid, sign) in [(Solid::Above, 1.0), (Solid::Below, -1.0)] {
        let mut volume = Volume::new([n; 3], Samples::F32(samples.clone()), world_from_grid).unwrap();
        volume.solid = solid;
        let pyramid = Pyramid::new(&volume);
        let linear = isosurface(&volume, &pyramid, 0.5).unwrap();
        volume.exact = Some(std::sync::Arc::clone(&tree));
        let exact = isosurface(&volume, &pyramid, 0.5).unwrap();
        assert_eq!(exact.triangles, linear.triangles);
        let off = |mesh: &Mesh| {
            let from = |p: &[f32; 3]| volume.world_from_grid().point(DVec3::from_array(p.map(f64::from))) - centre;
            let radius = |p| (from(p).length() - 0.5).abs() / voxel;
            let bend =
                |(p, n): (_, &[f32; 3])| (from(p).normalize() - sign * DVec3::from_array(n.map(f64::from))).length();
            let far = mesh.positions_in_grid.iter().map(radius).fold(0.0, f64::max);
            (far, mesh.positions_in_grid.iter().zip(&mesh.normals).map(bend).fold(0.0, f64::max))
        };
        let ((before, bent), (after, straight)) = (off(&linear), off(&exact));
        assert!(before > 1e-3 && after < 1.1 / 16384.0, "{before:e} voxels, then {after:e}");
        assert!(bent > 1e-3 && straight < 1e-6, "normals {bent:e} off, then {straight:e}");
    }
}
