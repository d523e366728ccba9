//! What must hold of every extracted surface.

use glam::DVec3;
use isolume::surface::{Mesh, extract, mesh_statistics};
use isolume::volume::Volume;
use std::collections::HashMap;

/// Least area of a triangle in voxel², promised by the extraction: crossings keep 2⁻¹⁴ from grid points,
/// so that two sides of a triangle are at least that long; the third power of it covers the angle.
const LEAST_AREA: f64 = 1e-9;

/// Extracts and judges: finite, inside the box, open on its faces only, oriented, no degenerate triangle,
/// unit normals.
pub fn check(volume: &Volume, isovalue: f64, what: &str) -> Mesh {
    let mesh = extract(volume, isovalue).unwrap_or_else(|e| panic!("{what}: {e}"));
    let last = volume.dims().map(|d| (d - 1) as f32);
    for p in &mesh.positions_in_grid {
        assert!((0..3).all(|a| (0.0..=last[a]).contains(&p[a])), "{what}: a vertex at {p:?}");
    }
    for n in &mesh.normals {
        let length = n.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-6, "{what}: a normal {n:?}");
    }
    let s = mesh_statistics(&mesh);
    assert_eq!((s.non_manifold_edges, s.non_manifold_vertices, s.unused_vertices), (0, 0, 0), "{what}: {s:?}");
    assert!(least_area(&mesh) > LEAST_AREA, "{what}: a triangle of {}", least_area(&mesh));
    assert_open_on_the_box_only(&mesh, last, what);
    assert_eq!(mesh, extract(volume, isovalue).unwrap(), "{what}: not the same twice");
    mesh
}

/// Smallest area of a triangle, in voxel².
pub fn least_area(mesh: &Mesh) -> f64 {
    let point = |v: u32| DVec3::from_array(mesh.positions_in_grid[v as usize].map(f64::from));
    let areas = mesh.triangles.iter().map(|t| t.map(point)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length());
    areas.fold(f64::INFINITY, f64::min)
}

fn assert_open_on_the_box_only(mesh: &Mesh, last: [f32; 3], what: &str) {
    let mut uses: HashMap<(u32, u32), i32> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *uses.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    // Both directions cancel; what is left over lies on a face of the box.
    for ((a, b), _) in uses.into_iter().filter(|(_, sum)| *sum != 0) {
        let [p, q] = [a, b].map(|v| mesh.positions_in_grid[v as usize]);
        let on_a_face = (0..3).any(|k| p[k] == q[k] && (p[k] == 0.0 || p[k] == last[k]));
        assert!(on_a_face, "{what}: a hole at {p:?} {q:?}");
    }
}
