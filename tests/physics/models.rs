//! Implicit models through files and meshes: radii, volumes, topology and bakes whose answers are known.

use glam::DVec3;
use isolume::geom::Bounds;
use isolume::model::{Falloff, Leaf, Node, Op, Shape, Skeletal, Tree};
use isolume::scene::Member;
use isolume::surface::{Mesh, extract};
use isolume::volume::{Samples, Volume};
use std::collections::BTreeSet;

fn points(centres: &[DVec3], falloff: Falloff) -> Tree {
    let leaf = |c: &DVec3| {
        Node::leaf(Leaf::Skeletal(Skeletal { shape: Shape::Point(*c), reach: [1.0; 2], falloff, weight: 1.0 }))
    };
    Tree::new(Node::of(Op::Sum, centres.iter().map(leaf).collect())).unwrap()
}

fn sampled(tree: &Tree, bounds: Bounds, dims: [usize; 3]) -> Volume {
    let mut values = Vec::new();
    tree.sample(&bounds, dims, true, &mut values);
    let spacing = bounds.size() / DVec3::from_array(dims.map(|n| (n - 1) as f64));
    let map = isolume::geom::Affine::from_spacing(spacing, bounds.min).unwrap();
    Volume::new(dims, Samples::F32(values), map).unwrap()
}

fn positions(volume: &Volume, mesh: &Mesh) -> Vec<DVec3> {
    let place = |p: &[f32; 3]| volume.world_from_grid().point(DVec3::from_array(p.map(f64::from)));
    mesh.positions_in_grid.iter().map(place).collect()
}

/// V − E + F.
fn euler(mesh: &Mesh) -> i64 {
    let edges: BTreeSet<[u32; 2]> = mesh
        .triangles
        .iter()
        .flat_map(|t| (0..3).map(|i| (t[i].min(t[(i + 1) % 3]), t[i].max(t[(i + 1) % 3]))))
        .map(|e| [e.0, e.1])
        .collect();
    mesh.positions_in_grid.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64
}

fn enclosed(volume: &Volume, mesh: &Mesh) -> f64 {
    let p = positions(volume, mesh);
    mesh.triangles.iter().map(|t| t.map(|i| p[i as usize])).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

/// Radii of one point at isovalue ½, from the table of fall-offs: within 0.02 voxel of linear interpolation.
#[test]
fn one_point_is_a_ball_of_the_radius_that_its_falloff_says() {
    let bounds = Bounds { min: DVec3::splat(-0.7), max: DVec3::splat(0.7) };
    for (falloff, radius) in [
        (Falloff::Soft, 0.5),
        (Falloff::Metaball, 1.0 - 1.0 / 3f64.sqrt()),
        (Falloff::Wyvill, 0.454_202_0),
        (Falloff::Gaussian(4.0), (2f64.ln() / 4.0).sqrt()),
    ] {
        let volume = sampled(&points(&[DVec3::ZERO], falloff), bounds, [128; 3]);
        let mesh = extract(&volume, 0.5).unwrap();
        let voxel = 1.4 / 127.0;
        let off = positions(&volume, &mesh).iter().map(|p| (p.length() - radius).abs() / voxel).fold(0.0, f64::max);
        assert!(off < 0.02, "{falloff:?}: {off} voxels");
        assert_eq!(euler(&mesh), 2);
    }
}

/// Two points merge where each is ¼ in the middle: two spheres become one within ± 1 %.
#[test]
fn two_points_merge_at_their_separation() {
    let bounds = Bounds { min: DVec3::new(-1.4, -0.7, -0.7), max: DVec3::new(1.4, 0.7, 0.7) };
    for (falloff, separation) in [
        (Falloff::Soft, 1.329_950),
        (Falloff::Metaball, 1.183_503),
        (Falloff::Wyvill, 1.216_617),
        (Falloff::Gaussian(4.0), 1.177_410),
    ] {
        let euler_at = |factor: f64| {
            let x = 0.5 * factor * separation * DVec3::X;
            // 129 along x: the middle is a sample.
            let volume = sampled(&points(&[x, -x], falloff), bounds, [129, 65, 65]);
            euler(&extract(&volume, 0.5).unwrap())
        };
        assert_eq!((euler_at(0.99), euler_at(1.01)), (2, 4), "{falloff:?}");
    }
}

/// Volumes at isovalue ½ by quadrature: one soft point π/6, two at distances of 1, 1.2 and 1.32. The mesh is within ½ %.
#[test]
fn blends_enclose_the_volume_that_quadrature_says() {
    let bounds = Bounds { min: DVec3::new(-1.3, -0.7, -0.7), max: DVec3::new(1.3, 0.7, 0.7) };
    for (separation, volume) in
        [(0.0, std::f64::consts::PI / 6.0), (1.0, 1.200_044), (1.2, 1.141_059), (1.32, 1.073_987)]
    {
        let x = 0.5 * separation * DVec3::X;
        let centres = if separation == 0.0 { vec![x] } else { vec![x, -x] };
        let samples = sampled(&points(&centres, Falloff::Soft), bounds, [157, 85, 85]);
        let found = enclosed(&samples, &extract(&samples, 0.5).unwrap());
        assert!((found / volume - 1.0).abs() < 0.005, "{separation}: {found} for {volume}");
    }
}

/// A convex model says so: nothing is traced, and the transfer of every texel is the clamped cosine.
#[test]
fn convex_models_take_no_ray() {
    let folder = tempfile::tempdir().unwrap();
    let open = |name: &str, body: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, format!("[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\n{body}")).unwrap();
        Member::open(&format!("{}:17", path.display()), &Default::default()).unwrap()
    };
    let ball = open("ball.toml", "[model.point.a]\ncentre = [0, 0, 0]\nradius = 1.5\n");
    assert!(ball.volume.is_convex() && ball.default_isovalue == Some(0.5) && ball.volume.name == "ball");
    let texels: Vec<[usize; 3]> = isolume::grid3::all([17; 3]).collect();
    let baked = crate::common::bake_texels(&ball.volume, &crate::common::settings(&[3], 16, 1), &texels);
    assert_eq!((baked.summary.counts.rays, baked.summary.paths), (0, 0));
    let two = open("two.toml", "[model.points.a]\nat = [[-0.4, 0, 0], [0.4, 0, 0]]\nradius = 0.8\n");
    assert!(!two.volume.is_convex());
    let baked = crate::common::bake_texels(&two.volume, &crate::common::settings(&[3], 16, 1), &texels);
    assert!(baked.summary.counts.rays > 0);
}
