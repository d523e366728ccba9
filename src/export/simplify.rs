//! Meshes of fewer triangles: edges collapse where shape and colours change least (crate `meshopt`, after Garland and
//! Heckbert 1998, "Simplifying surfaces with color and texture using quadric error metrics").
//!
//! Every vertex that stays is one of the mesh, with its own position, colour and transfer: nothing is looked up again. Edges
//! that only one triangle has, those on the faces of the volume's box, stay as they are, so that levels of detail of
//! one surface, and surfaces cut by one box, meet.
//!
//! What simplifying costs is measured, not taken from the collapses: see [`SimplificationError`].

use super::nearest::Nearest;
use super::{ExportMesh, Selection};
use crate::error::{Error, Result};
use crate::srgb;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::str::FromStr;

/// How many triangles are to be left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lod {
    /// So many.
    Triangles(u32),
    /// So many of each, in (0, 1].
    Share(f64),
}

impl Lod {
    /// How many of `all` triangles that is: at least one, at most all.
    pub fn of(self, all: usize) -> usize {
        let wanted = match self {
            Self::Triangles(count) => count as usize,
            Self::Share(share) => (share * all as f64).round() as usize,
        };
        wanted.max(1).min(all)
    }
}

impl FromStr for Lod {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if let Some(percent) = text.strip_suffix('%') {
            return match percent.trim().parse::<f64>() {
                Ok(p) if p > 0.0 && p <= 100.0 => Ok(Self::Share(p / 100.0)),
                _ => Err("expected more than 0% and at most 100% of the triangles, such as 25%".into()),
            };
        }
        match text.trim().parse::<u32>() {
            Ok(count) if count > 0 => Ok(Self::Triangles(count)),
            _ => Err("expected a number of triangles, such as 20000, or a share of them, such as 25%".into()),
        }
    }
}

impl std::fmt::Display for Lod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Triangles(count) => write!(f, "{count}"),
            // What was typed, not its rounding.
            Self::Share(share) => write!(f, "{}%", (share * 1e10).round() / 1e8),
        }
    }
}

/// How far a simplified mesh is off, measured at all vertices of the mesh that it was made of, but for those of pieces that are
/// left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SimplificationError {
    /// Largest distance to the simplified surface, in world units.
    pub largest: f64,
    /// Root mean square of the distances, in world units.
    pub rms: f64,
    /// The largest over the longest side of the box around the mesh.
    pub relative: f64,
    /// Root mean square difference between a channel of the colours and what the simplified mesh shows at the nearest point,
    /// in display signal (sRGB), from 0 to 1.
    pub colour_rms: f64,
    /// Pieces of the surface, apart from all others, of which nothing is left.
    pub pieces_left_out: usize,
    /// Longest side of the box around the largest of them, in world units.
    pub largest_piece_left_out: f64,
}

/// A mesh of fewer triangles.
#[derive(Clone, Debug)]
pub struct Simplified {
    /// What is left of the mesh.
    pub selection: Selection,
    /// What leaving out the rest costs.
    pub error: SimplificationError,
}

/// Weight of a display signal of 1 against a distance of the extent of the mesh. Of a brain at 2 mm, lit by an image, of which a
/// quarter of the triangles is left, weights of 0, 0.3, 1 and 3 give an RMS distance of 0.18, 0.18, 0.20 and 0.30 mm, and RMS colours of
/// 5.5, 4.9, 4.0 and 3.2 of 255.
#[cfg(feature = "meshopt")]
const COLOUR_WEIGHT: f32 = 0.5;

/// Leaves about as many triangles as `lod` says; more where the shape or the border of the mesh allow no further collapse.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`Error::Argument`] where so few triangles leave nothing of the mesh, and where the crate was
/// built without the feature `meshopt`.
pub fn simplify(mesh: &ExportMesh<'_>, lod: Lod) -> Result<Simplified> {
    mesh.check()?;
    let centre = mesh.centre_in_world();
    // Over the longest side: squares of areas stay in range whatever the unit.
    let side = longest_side(mesh);
    let place = |v: usize| (mesh.positions.from_centre(v, centre).as_dvec3() / side).as_vec3();
    let positions: Vec<Vec3> = (0..mesh.positions.len()).map(place).collect();
    let signals: Vec<[f32; 3]> =
        mesh.colours.par_iter().map(|c| c.map(|x| srgb::srgb_from_linear(f64::from(x)) as f32)).collect();
    let wanted = lod.of(mesh.triangles.len());
    let triangles = if wanted < mesh.triangles.len() {
        collapse(&positions, &signals, mesh.triangles, wanted)?
    } else {
        mesh.triangles.to_vec()
    };
    if triangles.is_empty() && !mesh.triangles.is_empty() {
        let all = mesh.triangles.len();
        let remedy = format!("give a larger number: the mesh has {all}");
        return Err(Error::argument("lod", lod, "as many triangles as leave something of the surface", remedy));
    }
    let selection = Selection::of_triangles(&triangles, positions.len());
    let pieces = Pieces::new(&positions, mesh.triangles, &selection.vertices);
    let found = measure(&positions, &signals, &triangles, &pieces);
    let error = SimplificationError {
        largest: side * found.largest,
        rms: side * found.rms,
        largest_piece_left_out: side * found.largest_piece_left_out,
        ..found
    };
    Ok(Simplified { selection, error })
}

/// Of the box around a mesh, in world; 1 for a point.
pub(super) fn longest_side(mesh: &ExportMesh<'_>) -> f64 {
    let centre = mesh.centre_in_world();
    let all = (0..mesh.positions.len()).map(|v| mesh.positions.from_centre(v, centre).as_dvec3());
    let (low, high) = all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let side = (high - low).max_element();
    if side.is_normal() && side > 0.0 { side } else { 1.0 }
}

#[cfg(feature = "meshopt")]
fn collapse(positions: &[Vec3], signals: &[[f32; 3]], triangles: &[[u32; 3]], wanted: usize) -> Result<Vec<[u32; 3]>> {
    const STRIDE: usize = size_of::<[f32; 3]>();
    let places: Vec<[f32; 3]> = positions.iter().map(Vec3::to_array).collect();
    let adapter = meshopt::VertexDataAdapter::new(bytemuck::cast_slice(&places), STRIDE, 0).map_err(|e| {
        Error::argument("mesh", e, "a mesh that meshoptimizer takes", "report this: it should not happen")
    })?;
    let locked = vec![false; positions.len()];
    let left = meshopt::simplify_with_attributes_and_locks(
        triangles.as_flattened(),
        &adapter,
        signals.as_flattened(),
        &[COLOUR_WEIGHT; 3],
        STRIDE,
        &locked,
        3 * wanted,
        // Of the extent: the number of triangles alone decides.
        1.0,
        meshopt::SimplifyOptions::LockBorder,
        None,
    );
    Ok(left.as_chunks().0.to_vec())
}

#[cfg(not(feature = "meshopt"))]
fn collapse(_: &[Vec3], _: &[[f32; 3]], _: &[[u32; 3]], _: usize) -> Result<Vec<[u32; 3]>> {
    Err(super::without_meshopt("fewer triangles"))
}

/// Which pieces of a surface are left.
struct Pieces {
    /// For each vertex.
    is_left: Vec<bool>,
    left_out: usize,
    largest_left_out: f64,
}

impl Pieces {
    fn new(positions: &[Vec3], triangles: &[[u32; 3]], kept: &[u32]) -> Self {
        // The root of a piece is its vertex of the lowest number.
        let mut parent: Vec<u32> = (0..positions.len() as u32).collect();
        fn root(parent: &mut [u32], mut v: u32) -> u32 {
            while parent[v as usize] != v {
                parent[v as usize] = parent[parent[v as usize] as usize];
                v = parent[v as usize];
            }
            v
        }
        for [a, b, c] in triangles {
            for other in [b, c] {
                let (one, two) = (root(&mut parent, *a), root(&mut parent, *other));
                parent[one.max(two) as usize] = one.min(two);
            }
        }
        let roots: Vec<u32> = (0..positions.len() as u32).map(|v| root(&mut parent, v)).collect();
        let mut has_rest = vec![false; positions.len()];
        kept.iter().for_each(|&v| has_rest[roots[v as usize] as usize] = true);
        let is_left: Vec<bool> = roots.iter().map(|&root| has_rest[root as usize]).collect();
        let mut boxes: BTreeMap<u32, (Vec3, Vec3)> = BTreeMap::new();
        for &v in triangles.iter().flatten().filter(|&&v| !is_left[v as usize]) {
            let (low, high) = boxes.entry(roots[v as usize]).or_insert((Vec3::INFINITY, Vec3::NEG_INFINITY));
            let p = positions[v as usize];
            (*low, *high) = (low.min(p), high.max(p));
        }
        let largest = boxes.values().map(|(low, high)| (*high - *low).max_element()).fold(0.0, f32::max);
        Self { is_left, left_out: boxes.len(), largest_left_out: f64::from(largest) }
    }
}

fn measure(positions: &[Vec3], signals: &[[f32; 3]], left: &[[u32; 3]], pieces: &Pieces) -> SimplificationError {
    let nearest = Nearest::new(positions, left);
    let off: Vec<[f64; 2]> = (0..positions.len())
        .into_par_iter()
        .filter(|&v| pieces.is_left[v])
        .filter_map(|v| {
            let foot = nearest.foot(positions[v])?;
            let corners = left[foot.triangle].map(|i| signals[i as usize]);
            let squares = (0..3).map(|c| {
                let shown: f32 = corners.iter().zip(foot.weights).map(|(signal, w)| w * signal[c]).sum();
                f64::from(shown - signals[v][c]).powi(2)
            });
            Some([f64::from(foot.squared), squares.sum::<f64>() / 3.0])
        })
        .collect();
    let largest = off.iter().fold(0.0, |most: f64, [squared, _]| most.max(*squared)).sqrt();
    let mean = |i: usize| (off.iter().map(|o| o[i]).sum::<f64>() / off.len().max(1) as f64).sqrt();
    let (low, high) = positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), &p| (l.min(p), h.max(p)));
    let side = f64::from((high - low).max_element());
    SimplificationError {
        largest,
        rms: mean(0),
        relative: if side > 0.0 { largest / side } else { 0.0 },
        colour_rms: mean(1),
        pieces_left_out: pieces.left_out,
        largest_piece_left_out: pieces.largest_left_out,
    }
}

#[cfg(test)]
#[cfg(feature = "meshopt")]
mod tests {
    use super::*;
    use crate::export::test_mesh::TestMesh;
    use std::collections::BTreeSet;

    fn smooth(mesh: &TestMesh, lod: Lod) -> Simplified {
        simplify(&mesh.mesh(), lod).expect("a sound mesh")
    }

    #[test]
    fn levels_of_detail_are_read_and_written() {
        for (text, lod) in [("20000", Lod::Triangles(20_000)), ("25%", Lod::Share(0.25)), ("0.3%", Lod::Share(0.003))] {
            assert_eq!(text.parse(), Ok(lod));
            assert_eq!(lod.to_string(), text);
        }
        for bad in ["", "0", "-3", "0.25", "0%", "101%", "NaN%", "many"] {
            assert!(bad.parse::<Lod>().is_err(), "{bad}");
        }
        let counts =
            [Lod::Share(0.25), Lod::Share(1e-9), Lod::Triangles(7), Lod::Triangles(5000)].map(|lod| lod.of(1000));
        assert_eq!((counts, Lod::Share(0.5).of(0)), ([250, 1, 7, 1000], 0));
    }

    #[test]
    fn a_plane_costs_nothing_and_keeps_its_border() {
        let n = 20;
        let sheet = TestMesh::sheet(n, |_, _| 0.0, |_, _| [0.5; 3]);
        let left = smooth(&sheet, Lod::Share(0.05));
        assert!(left.selection.triangles.len() < sheet.triangles.len() / 5, "{} left", left.selection.triangles.len());
        let error = left.error;
        assert!(error.largest < 1e-6 && error.rms <= error.largest && error.colour_rms < 1e-6, "{error:?}");
        let kept: BTreeSet<u32> = left.selection.vertices.iter().copied().collect();
        let border = (0..(n + 1) * (n + 1)).filter(|v| [v % (n + 1), v / (n + 1)].iter().any(|&i| i == 0 || i == n));
        assert!(border.into_iter().all(|v| kept.contains(&v)), "the border lost vertices");
    }

    #[test]
    fn the_error_is_the_distance_to_the_surface_that_is_left() {
        // Of a paraboloid z = r² under chords: found again from the definition, at the vertices.
        let sheet = TestMesh::sheet(24, |x, y| (x - 0.5).powi(2) + (y - 0.5).powi(2), |_, _| [0.2; 3]);
        let left = smooth(&sheet, Lod::Share(0.3));
        let attributes = left.selection.attributes(&sheet.mesh());
        let mesh = attributes.mesh(&sheet.mesh());
        let centre = mesh.centre_in_world();
        let corner = |v: u32| mesh.positions.from_centre(v as usize, centre);
        let distance = |p: Vec3| {
            let to = |t: &[u32; 3]| {
                let corners = t.map(corner);
                crate::export::nearest::place(corners, crate::export::nearest::nearest_in_triangle(corners, p))
                    .distance(p)
            };
            mesh.triangles.iter().map(to).fold(f32::INFINITY, f32::min)
        };
        let all: Vec<f64> = sheet.positions.iter().map(|&p| f64::from(distance((p - centre).as_vec3()))).collect();
        let largest = all.iter().copied().fold(0.0, f64::max);
        assert!((left.error.largest - largest).abs() < 1e-6 && largest > 1e-5, "{:?}, not {largest}", left.error);
        let rms = (all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64).sqrt();
        assert!((left.error.rms - rms).abs() < 1e-6, "{:?}, not {rms}", left.error);
        assert!((left.error.relative - largest).abs() < 1e-6, "the longest side is 1");
    }

    #[test]
    fn colours_keep_triangles_where_the_shape_would_not() {
        let step = |x: f64, y: f64| if (x - 0.5).hypot(y - 0.5) < 0.25 { [0.8; 3] } else { [0.1; 3] };
        let sheet = TestMesh::sheet(32, |_, _| 0.0, step);
        let left = smooth(&sheet, Lod::Share(0.25));
        assert!(left.error.colour_rms < 0.03, "{:?}", left.error);
        // A closed surface stays closed: every edge twice, in opposite directions.
        let torus = TestMesh::torus(24);
        let left = smooth(&torus, Lod::Triangles(600));
        assert!(left.selection.triangles.len() <= 600);
        let edges = left.selection.triangles.iter().flat_map(|t| [0, 1, 2].map(|i| (t[i], t[(i + 1) % 3])));
        let edges: BTreeSet<(u32, u32)> = edges.collect();
        assert_eq!(edges.len(), 3 * left.selection.triangles.len());
        assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
    }

    #[test]
    fn pieces_that_vanish_are_told_apart_from_the_error() {
        // A tetrahedron of side 0.01 beside a torus.
        let mut both = TestMesh::torus(24);
        let first = both.positions.len() as u32;
        for corner in [[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]] {
            both.positions.push(DVec3::from_array(corner));
            both.normals.push(Vec3::Z);
            both.colours.push([0.5; 3]);
        }
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        both.triangles.extend(faces.map(|t: [u32; 3]| t.map(|v| first + v)));
        let positions: Vec<Vec3> = both.positions.iter().map(|p| p.as_vec3()).collect();
        let pieces = Pieces::new(&positions, &both.triangles, &[0]);
        assert_eq!((pieces.left_out, pieces.largest_left_out), (1, f64::from(0.01f32)));
        assert_eq!(pieces.is_left.iter().filter(|left| !**left).count(), 4);
        let left = smooth(&both, Lod::Triangles(800));
        let kept = left.selection.vertices.iter().any(|&v| v >= first);
        assert_eq!(left.error.pieces_left_out, usize::from(!kept));
        assert!(left.error.largest < 0.2, "{:?}", left.error);
    }

    #[test]
    fn all_triangles_are_the_mesh_itself() {
        let torus = TestMesh::torus(6);
        let left = smooth(&torus, Lod::Share(1.0));
        assert_eq!((left.selection.triangles, left.error.largest), (torus.triangles, 0.0));
    }
}
