//! Every configuration of a cell and its triangles, generated from the contours of its faces.
//!
//! A *pattern* is the set of solid corners. A face whose corners alternate is *ambiguous*; its two
//! contour segments cut off either the two solid corners or the two lit ones. A pattern with one
//! such decision for each of its ambiguous faces is a *configuration*: the segments of all six
//! faces chain into oriented cycles on the boundary of the cell. The cycles cut that sphere into
//! *regions*, solid and lit by turns. Each cycle bounds a disk, except that two cycles which
//! border a common region may bound an annulus, the wall of a tunnel between the two regions
//! beyond them (see [`super::decide`]).
//!
//! Differences to Chernyaev 1995 ("Marching Cubes 33", CERN CN/95-17) and to Lewiner et al. 2003:
//! no list of cases and no symmetry reduction; all 256 patterns with all decisions are built from
//! one rule, so there is no table that could hold a misprint.

use super::cell::{edge_between, edge_corners, face_corners};
use super::triangulate::{Patch, annulus, disk};
use std::sync::LazyLock;

/// What a pattern needs to know before its configuration is found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pattern {
    /// The ambiguous faces, one bit each.
    pub ambiguous: u8,
    /// Configurations start here; the decisions of the ambiguous faces in ascending order are
    /// the bits (1: the solid corners join) of the offset.
    pub first: u16,
    /// No ambiguous face and a single cycle: the first configuration's disks are the answer.
    pub settled: bool,
}

/// A pattern with its faces decided.
#[derive(Clone, Debug)]
pub(super) struct Configuration {
    /// The region of each corner.
    pub regions: [u8; 8],
    /// The plan without a tunnel.
    pub disks: u16,
    /// For each pair of regions (smaller number first) that a tunnel can join, the plan with it.
    pub tunnels: Vec<([u8; 2], u16)>,
}

/// The triangles of a cell: ranges in [`Table::triangles`] and [`Table::inner`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plan {
    first_triangle: u32,
    first_inner: u32,
    /// Number of triangles.
    pub triangles: u8,
    /// Number of vertices inside the cell.
    pub inner: u8,
}

/// All patterns, configurations and plans.
pub(super) struct Table {
    pub patterns: [Pattern; 256],
    pub configurations: Vec<Configuration>,
    pub plans: Vec<Plan>,
    triangles: Vec<[u8; 3]>,
    inner: Vec<u16>,
}

/// The one table; building it takes a few milliseconds.
pub(super) static TABLE: LazyLock<Table> = LazyLock::new(Table::build);

impl Table {
    /// The triangles of a plan over local vertices; right-handed in grid space about a normal
    /// that points to the lit side.
    #[inline]
    pub fn triangles(&self, plan: Plan) -> &[[u8; 3]] {
        &self.triangles[plan.first_triangle as usize..][..plan.triangles.into()]
    }

    /// For each inner vertex of a plan, the edges whose crossings it is the mean of.
    #[inline]
    pub fn inner(&self, plan: Plan) -> &[u16] {
        &self.inner[plan.first_inner as usize..][..plan.inner.into()]
    }

    fn build() -> Self {
        let mut table = Self {
            patterns: [Pattern::default(); 256],
            configurations: Vec::new(),
            plans: Vec::new(),
            triangles: Vec::new(),
            inner: Vec::new(),
        };
        for solid in 0..=255u8 {
            let ambiguous = (0..6).filter(|&f| is_ambiguous(solid, f)).fold(0u8, |set, f| set | 1 << f);
            let first = table.configurations.len() as u16;
            for decisions in 0..1u8 << ambiguous.count_ones() {
                let cycles = cycles(solid, &spread(decisions, ambiguous));
                let regions = regions(solid, &spread(decisions, ambiguous));
                table.add_configuration(solid, &cycles, regions);
            }
            let settled = ambiguous == 0 && table.configurations[usize::from(first)].tunnels.is_empty();
            table.patterns[usize::from(solid)] = Pattern { ambiguous, first, settled };
        }
        table
    }

    fn add_configuration(&mut self, solid: u8, cycles: &[Vec<u8>], regions: [u8; 8]) {
        let disks: Vec<Patch> = cycles.iter().map(|c| disk(c)).collect();
        let mut all = Patch::default();
        disks.iter().for_each(|d| all.append(d));
        let all_disks = self.add_plan(&all);
        // The regions on the solid and the lit side of each cycle.
        let sides: Vec<[u8; 2]> = cycles.iter().map(|c| sides(solid, c, &regions)).collect();
        let mut tunnels = Vec::new();
        for i in 0..cycles.len() {
            for j in i + 1..cycles.len() {
                for side in 0..2 {
                    if sides[i][1 - side] == sides[j][1 - side] {
                        let mut patch = annulus(&cycles[i], &cycles[j]);
                        (0..cycles.len()).filter(|&k| k != i && k != j).for_each(|k| patch.append(&disks[k]));
                        let (r, s) = (sides[i][side], sides[j][side]);
                        tunnels.push(([r.min(s), r.max(s)], self.add_plan(&patch)));
                    }
                }
            }
        }
        self.configurations.push(Configuration { regions, disks: all_disks, tunnels });
    }

    fn add_plan(&mut self, patch: &Patch) -> u16 {
        self.plans.push(Plan {
            first_triangle: self.triangles.len() as u32,
            first_inner: self.inner.len() as u32,
            triangles: patch.triangles.len() as u8,
            inner: patch.inner.len() as u8,
        });
        self.triangles.extend(&patch.triangles);
        self.inner.extend(&patch.inner);
        (self.plans.len() - 1) as u16
    }
}

fn is_solid(solid: u8, corner: usize) -> bool {
    solid >> corner & 1 == 1
}

fn is_ambiguous(solid: u8, face: usize) -> bool {
    let [a, b, c, d] = face_corners(face).map(|c| is_solid(solid, c));
    a == c && b == d && a != b
}

/// The decisions of the ambiguous faces, each put at its face: whether the solid corners join.
fn spread(decisions: u8, ambiguous: u8) -> [bool; 6] {
    let mut next = 0;
    [0, 1, 2, 3, 4, 5].map(|face| {
        let here = ambiguous >> face & 1 == 1;
        let joined = here && decisions >> next & 1 == 1;
        next += u32::from(here);
        joined
    })
}

/// The contour cycles: crossed edges in the order in which the surface's boundary runs.
pub(super) fn cycles(solid: u8, joined: &[bool; 6]) -> Vec<Vec<u8>> {
    const NONE: u8 = u8::MAX;
    let mut next = [NONE; 12];
    for face in 0..6 {
        let corners = face_corners(face);
        // Walking the face counter-clockwise seen from outside, a segment runs from an edge that
        // enters the solid to one that leaves it: then the surface, whose boundary it is, turns
        // its front to the lit side (test `a_single_solid_corner_is_seen_from_the_lit_side`).
        for i in 0..4 {
            let enters = !is_solid(solid, corners[i]) && is_solid(solid, corners[(i + 1) % 4]);
            if !enters {
                continue;
            }
            let leaves = |k: usize| is_solid(solid, corners[k % 4]) && !is_solid(solid, corners[(k + 1) % 4]);
            // Forwards finds the end of the solid corners just entered and cuts them off; where
            // the solid joins across the face, backwards cuts off the lit ones.
            let other = if is_ambiguous(solid, face) && joined[face] {
                i + 3
            } else {
                (i + 1..i + 4).find(|&k| leaves(k)).unwrap_or(i)
            };
            let edge = |k: usize| edge_between(corners[k % 4], corners[(k + 1) % 4]);
            next[edge(i)] = edge(other) as u8;
        }
    }
    let mut cycles = Vec::new();
    for start in 0..12u8 {
        let mut cycle = Vec::new();
        let mut edge = start;
        while next[usize::from(edge)] != NONE {
            cycle.push(edge);
            edge = std::mem::replace(&mut next[usize::from(edge)], NONE);
        }
        if !cycle.is_empty() {
            cycles.push(cycle);
        }
    }
    cycles
}

/// The region of each corner: corners of one kind connected along edges or across a face.
pub(super) fn regions(solid: u8, joined: &[bool; 6]) -> [u8; 8] {
    let mut region = [0, 1, 2, 3, 4, 5, 6, 7u8];
    let mut merge = |a: usize, b: usize| {
        let (keep, drop) = (region[a].min(region[b]), region[a].max(region[b]));
        region.iter_mut().filter(|r| **r == drop).for_each(|r| *r = keep);
    };
    for edge in 0..12 {
        let [a, b] = edge_corners(edge);
        if is_solid(solid, a) == is_solid(solid, b) {
            merge(a, b);
        }
    }
    for face in (0..6).filter(|&f| is_ambiguous(solid, f)) {
        let [a, b, c, d] = face_corners(face);
        if is_solid(solid, a) == joined[face] { merge(a, c) } else { merge(b, d) }
    }
    region
}

/// The regions on the solid and on the lit side of a cycle.
fn sides(solid: u8, cycle: &[u8], regions: &[u8; 8]) -> [u8; 2] {
    let [a, b] = edge_corners(cycle[0].into());
    let (inside, outside) = if is_solid(solid, a) { (a, b) } else { (b, a) };
    [regions[inside], regions[outside]]
}

#[cfg(test)]
mod tests {
    use super::super::cell::{edge_middle, share_a_face};
    use super::super::triangulate::FIRST_INNER;
    use super::*;
    use glam::DVec3;
    use std::collections::{HashMap, HashSet};

    fn all_configurations() -> impl Iterator<Item = (u8, [bool; 6], &'static Configuration)> {
        (0..=255u8).flat_map(|solid| {
            let pattern = TABLE.patterns[usize::from(solid)];
            (0..1u8 << pattern.ambiguous.count_ones()).map(move |decisions| {
                let configuration = &TABLE.configurations[usize::from(pattern.first) + usize::from(decisions)];
                (solid, spread(decisions, pattern.ambiguous), configuration)
            })
        })
    }

    #[test]
    fn a_single_solid_corner_is_seen_from_the_lit_side() {
        for corner in 0..8 {
            let plan =
                TABLE.plans[usize::from(TABLE.configurations[usize::from(TABLE.patterns[1 << corner].first)].disks)];
            let [triangle] = TABLE.triangles(plan) else { panic!("one triangle") };
            let [p, q, r] = triangle.map(|e| DVec3::from(edge_middle(e.into()).map(f64::from)));
            let away = DVec3::ONE - DVec3::from([0, 1, 2].map(|a| 2.0 * (corner >> a & 1) as f64));
            assert!((q - p).cross(r - p).dot(away) > 0.0);
        }
    }

    #[test]
    fn cycles_hold_every_crossed_edge_once_and_cut_the_sphere_into_one_region_more() {
        for (solid, joined, configuration) in all_configurations() {
            let cycles = cycles(solid, &joined);
            let mut edges: Vec<u8> = cycles.concat();
            edges.sort_unstable();
            let crossed: Vec<u8> = (0..12u8)
                .filter(|&e| {
                    let [a, b] = edge_corners(e.into());
                    is_solid(solid, a) != is_solid(solid, b)
                })
                .collect();
            assert_eq!(edges, crossed);
            let distinct: HashSet<u8> = configuration.regions.into_iter().collect();
            assert_eq!(distinct.len(), cycles.len() + 1, "{solid:08b} {joined:?}");
            // The sides of a cycle are the same wherever one looks.
            for cycle in &cycles {
                for k in 0..cycle.len() {
                    assert_eq!(
                        sides(solid, &cycle[k..], &configuration.regions),
                        sides(solid, cycle, &configuration.regions)
                    );
                }
            }
        }
    }

    /// The three claims on which watertightness rests, for every plan: the boundary is exactly
    /// the cycles in their direction, every other edge has two triangles in opposite directions,
    /// and no other edge lies in a face.
    #[test]
    fn plans_are_manifold_and_draw_nothing_but_segments_in_faces() {
        for (solid, joined, configuration) in all_configurations() {
            let cycles = cycles(solid, &joined);
            let segments: HashSet<(u8, u8)> =
                cycles.iter().flat_map(|c| (0..c.len()).map(|i| (c[i], c[(i + 1) % c.len()]))).collect();
            let plans = std::iter::once((configuration.disks, cycles.len() as i32))
                .chain(configuration.tunnels.iter().map(|t| (t.1, cycles.len() as i32 - 2)));
            for (plan, euler) in plans {
                let plan = TABLE.plans[usize::from(plan)];
                let mut half_edges = HashMap::new();
                let mut vertices = HashSet::new();
                for t in TABLE.triangles(plan) {
                    for i in 0..3 {
                        vertices.insert(t[i]);
                        let fresh = half_edges.insert((t[i], t[(i + 1) % 3]), ()).is_none();
                        assert!(fresh, "{solid:08b} {joined:?}: half edge twice");
                    }
                }
                let mut full = 0;
                for &(a, b) in half_edges.keys() {
                    if segments.contains(&(a, b)) {
                        assert!(!half_edges.contains_key(&(b, a)));
                        full += 2;
                    } else {
                        assert!(half_edges.contains_key(&(b, a)), "{solid:08b} {joined:?}: open at {a} {b}");
                        assert!(a >= FIRST_INNER || b >= FIRST_INNER || !share_a_face(a.into(), b.into()));
                        full += 1;
                    }
                }
                assert!(segments.iter().all(|s| half_edges.contains_key(s)));
                assert_eq!(vertices.len() as i32 - full / 2 + TABLE.triangles(plan).len() as i32, euler);
            }
        }
    }

    /// A tunnel between two regions connects the cycle that borders the one and faces the other
    /// with its counterpart, and no further cycle.
    #[test]
    fn tunnels_connect_the_cycles_between_their_regions() {
        for (solid, joined, configuration) in all_configurations() {
            let cycles = cycles(solid, &joined);
            for (pair, plan) in &configuration.tunnels {
                // Spread from the first edge of each cycle over triangles to the cycles reached.
                let triangles = TABLE.triangles(TABLE.plans[usize::from(*plan)]);
                let reached = |cycle: &[u8]| {
                    let mut seen = HashSet::from([cycle[0]]);
                    for _ in triangles {
                        for t in triangles.iter().filter(|t| t.iter().any(|v| seen.contains(v))).collect::<Vec<_>>() {
                            seen.extend(t);
                        }
                    }
                    seen
                };
                let mut merged = Vec::new();
                for c in &cycles {
                    let seen = reached(c);
                    let count = cycles.iter().filter(|other| seen.contains(&other[0])).count();
                    assert!(count <= 2);
                    if count == 2 {
                        merged.push(sides(solid, c, &configuration.regions));
                    }
                }
                let [a, b] = merged[..] else { panic!("{solid:08b} {joined:?}: {merged:?}") };
                let side = usize::from(a[0] == b[0]);
                assert_eq!(a[1 - side], b[1 - side]);
                assert_eq!([a[side].min(b[side]), a[side].max(b[side])], *pair);
            }
        }
    }

    #[test]
    fn census_of_the_table() {
        let inner = |n: u8| TABLE.plans.iter().filter(|p| p.inner == n).count();
        println!(
            "{} configurations, {} plans, inner vertices 0: {}, 1: {}, 2: {}, 3: {}, most triangles {}",
            TABLE.configurations.len(),
            TABLE.plans.len(),
            inner(0),
            inner(1),
            inner(2),
            inner(3),
            TABLE.plans.iter().map(|p| p.triangles).max().unwrap()
        );
        // A pair of regions has at most one tunnel.
        for (_, _, configuration) in all_configurations() {
            let pairs: HashSet<[u8; 2]> = configuration.tunnels.iter().map(|t| t.0).collect();
            assert_eq!(pairs.len(), configuration.tunnels.len());
        }
    }
}
