//! Triangulations of the contour cycles of one cell: a disk in one cycle, an annulus between two.
//!
//! A triangle edge between two crossings of the same face lies *in* that face. Unless it is a
//! contour segment, the neighbouring cell may draw the same edge for its own surface, and the
//! edge then has four triangles; it may also cross the other segment of the face. Such diagonals
//! are therefore never used. Where no triangulation is left without them, vertices inside the
//! cell are added.
//!
//! Among the triangulations left, the one with the smallest sum of squared diagonals wins, with
//! each crossing in the middle of its edge, the first found on a tie: integer arithmetic, so the
//! tables are the same on every machine.

use super::cell::{edge_middle, share_a_face};

/// Local numbers 12, 13, … name vertices inside the cell.
pub(super) const FIRST_INNER: u8 = 12;

/// Triangles over local vertices (0–11: the crossing of that edge; from [`FIRST_INNER`]: inner
/// vertices), and for each inner vertex the set of edges whose crossings it is the mean of.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Patch {
    pub triangles: Vec<[u8; 3]>,
    pub inner: Vec<u16>,
}

impl Patch {
    /// Adds another patch of the same cell, renumbering its inner vertices.
    pub fn append(&mut self, other: &Self) {
        let shift = self.inner.len() as u8;
        let renumber = |v: u8| if v >= FIRST_INNER { v + shift } else { v };
        self.triangles.extend(other.triangles.iter().map(|t| t.map(renumber)));
        self.inner.extend(&other.inner);
    }
}

fn squared_length(e: u8, f: u8) -> i32 {
    let (p, q) = (edge_middle(e.into()), edge_middle(f.into()));
    (0..3).map(|a| (p[a] - q[a]) * (p[a] - q[a])).sum()
}

fn may_join(e: u8, f: u8) -> bool {
    !share_a_face(e.into(), f.into())
}

fn edge_set(cycle: &[u8]) -> u16 {
    cycle.iter().fold(0, |set, &e| set | 1 << e)
}

/// A disk bounded by `cycle`, with the orientation of the cycle.
pub(super) fn disk(cycle: &[u8]) -> Patch {
    let n = cycle.len();
    // best[i][j]: cheapest triangulation of the chain i, i+1, …, j closed by the side (j, i), and
    // the apex of the triangle on that side. Costs of the side itself are counted by its user.
    let mut best = vec![vec![None::<(i32, usize)>; n]; n];
    let side = |i: usize, j: usize| -> Option<i32> {
        let outer = j - i == 1 || (i == 0 && j == n - 1);
        (outer || may_join(cycle[i], cycle[j])).then(|| if outer { 0 } else { squared_length(cycle[i], cycle[j]) })
    };
    for i in 0..n - 1 {
        best[i][i + 1] = Some((0, i));
    }
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            for apex in i + 1..j {
                let parts = (best[i][apex], best[apex][j], side(i, apex), side(apex, j));
                if let (Some((left, _)), Some((right, _)), Some(a), Some(b)) = parts {
                    let cost = left + right + a + b;
                    if best[i][j].is_none_or(|(least, _)| cost < least) {
                        best[i][j] = Some((cost, apex));
                    }
                }
            }
        }
    }
    let mut patch = Patch::default();
    if best[0][n - 1].is_none() {
        patch.inner.push(edge_set(cycle));
        patch.triangles.extend((0..n).map(|i| [cycle[i], cycle[(i + 1) % n], FIRST_INNER]));
        return patch;
    }
    let mut open = vec![(0, n - 1)];
    while let Some((i, j)) = open.pop() {
        if j - i < 2 {
            continue;
        }
        if let Some((_, apex)) = best[i][j] {
            patch.triangles.push([cycle[i], cycle[apex], cycle[j]]);
            open.extend([(apex, j), (i, apex)]);
        }
    }
    patch
}

/// An annulus between two cycles, each with the orientation of the surface on its boundary.
pub(super) fn annulus(a: &[u8], b: &[u8]) -> Patch {
    let mut best = None::<(i32, Vec<[u8; 3]>)>;
    for start in 0..b.len() {
        let mut walk = Walk { a, b, start, edges: vec![], triangles: vec![], best: &mut best };
        if may_join(a[0], b[start]) {
            walk.step(0, 0, squared_length(a[0], b[start]));
        }
    }
    match best {
        Some((_, triangles)) => Patch { triangles, inner: vec![] },
        None => ring(a, b),
    }
}

/// Depth-first search over the ways to walk once around both cycles at the same time, `a`
/// forwards and `b` backwards; each step makes one triangle and one more cross edge.
struct Walk<'a> {
    a: &'a [u8],
    b: &'a [u8],
    start: usize,
    edges: Vec<(u8, u8)>,
    triangles: Vec<[u8; 3]>,
    best: &'a mut Option<(i32, Vec<[u8; 3]>)>,
}

impl Walk<'_> {
    fn step(&mut self, i: usize, j: usize, cost: i32) {
        let (m, n) = (self.a.len(), self.b.len());
        if self.best.as_ref().is_some_and(|(least, _)| cost >= *least) {
            return;
        }
        let on_a = |i: usize| self.a[i % m];
        let on_b = |j: usize| self.b[(self.start + 2 * n - j) % n];
        if i == m && j == n {
            *self.best = Some((cost, self.triangles.clone()));
            return;
        }
        let here = (on_a(i), on_b(j));
        self.edges.push(here);
        let next = [
            (i < m).then(|| (i + 1, j, [here.0, on_a(i + 1), here.1])),
            (j < n).then(|| (i, j + 1, [on_b(j + 1), here.1, here.0])),
        ];
        for (i, j, triangle) in next.into_iter().flatten() {
            let edge = (self.a[i % m], self.b[(self.start + 2 * n - j) % n]);
            let last = i == m && j == n;
            // A fan all around one cycle would come back to its own first cross edge.
            if last || (may_join(edge.0, edge.1) && !self.edges.contains(&edge)) {
                self.triangles.push(triangle);
                let more = if last { 0 } else { squared_length(edge.0, edge.1) };
                self.step(i, j, cost + more);
                self.triangles.pop();
            }
        }
        self.edges.pop();
    }
}

/// An annulus through a ring of three inner vertices: every cross edge has an inner end.
fn ring(a: &[u8], b: &[u8]) -> Patch {
    let (m, n) = (a.len(), b.len());
    // The crossing of b that is nearest to a third of a; b runs backwards as a runs forwards.
    let start =
        (0..n).min_by_key(|&s| (0..3).map(|k| squared_length(a[k * m / 3], b[(s + n - k * n / 3) % n])).sum::<i32>());
    let start = start.unwrap_or(0);
    let mut patch = Patch::default();
    for k in 0..3 {
        let inner = [FIRST_INNER + k as u8, FIRST_INNER + (k as u8 + 1) % 3];
        let (a0, a1) = (k * m / 3, (k + 1) * m / 3);
        let (b0, b1) = (k * n / 3, (k + 1) * n / 3);
        let on_b = |j: usize| b[(start + 2 * n - j) % n];
        patch.inner.push(1 << a[a0] | 1 << on_b(b0));
        patch.triangles.extend((a0..a1).map(|i| [a[i], a[(i + 1) % m], inner[0]]));
        patch.triangles.push([a[a1 % m], inner[1], inner[0]]);
        patch.triangles.extend((b0..b1).map(|j| [on_b(j + 1), on_b(j), inner[0]]));
        patch.triangles.push([on_b(b1), inner[0], inner[1]]);
    }
    patch
}
