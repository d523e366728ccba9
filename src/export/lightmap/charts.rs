//! Cutting a surface into charts: pieces that projection onto a plane lays flat, without folding over or onto themselves.

use glam::{Vec2, Vec3};
use std::collections::{HashMap, VecDeque};

/// A connected piece of a mesh, and its projection.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    /// Numbers of its triangles in the mesh.
    pub(super) triangles: Vec<u32>,
    /// Their corners, as numbers among `vertices`.
    pub(super) corners: Vec<[u32; 3]>,
    /// Numbers of its vertices in the mesh.
    pub(super) vertices: Vec<u32>,
    /// Where they lie in the plane, in world units; the rectangle around them begins at 0.
    pub(super) places: Vec<Vec2>,
    /// Sides of that rectangle; the first is the longer one.
    pub(super) size: Vec2,
}

/// Least cosine between the normal of a triangle and that of its plane: it is then stretched by at most 2.
const LEAST_COSINE: f32 = 0.5;
/// The same for triangles of small charts, which join a large one beside them: a chart of few triangles is mostly gutter.
const LEAST_COSINE_OF_CRUMBS: f32 = 0.2;
/// Triangles of a small chart, at most.
const CRUMB: usize = 32;
/// Triangles around the first one whose mean normal is that of the plane.
const AROUND: usize = 48;
/// Longest side of a chart over the square root of the area of the mesh: rectangles of many charts pack better than those of a few
/// large ones, which are mostly empty.
const LONGEST: f32 = 0.2;
/// How far triangles may lie over each other, over the mean length of an edge: less than a tenth of a texel.
const SLACK: f32 = 0.01;

/// The charts of a mesh; each of its triangles is in one.
pub(super) fn cut(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Chart> {
    let corners = |t: usize| triangles[t].map(|v| positions[v as usize]);
    let twice_area: Vec<Vec3> = (0..triangles.len())
        .map(|t| {
            let [a, b, c] = corners(t);
            (b - a).cross(c - a)
        })
        .collect();
    let normals: Vec<Vec3> = twice_area.iter().map(|n| n.normalize_or_zero()).collect();
    let area = twice_area.iter().map(|n| 0.5 * f64::from(n.length())).sum::<f64>();
    let around = |[a, b, c]: [Vec3; 3]| f64::from(a.distance(b)) + f64::from(b.distance(c)) + f64::from(c.distance(a));
    let edges = (0..triangles.len()).map(|t| around(corners(t))).sum::<f64>();
    let edge = (edges / (3 * triangles.len()).max(1) as f64) as f32;
    let (low, high) = positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let longest_side = (high - low).max_element();
    let cutter = Cutter {
        positions,
        triangles,
        normals,
        neighbours: neighbours(triangles),
        longest: LONGEST * area.sqrt() as f32,
        // A triangle lies in a bounded number of cells, however small the others are.
        cell: (2.0 * edge).max(longest_side / 1024.0).max(f32::MIN_POSITIVE),
        slack: SLACK * edge,
    };
    let mut owner = vec![None; triangles.len()];
    let mut pieces: Vec<Piece> = Vec::new();
    for seed in 0..triangles.len() {
        if owner[seed].is_none() {
            pieces.push(cutter.grow(seed as u32, pieces.len(), &mut owner));
        }
    }
    cutter.join_crumbs(&mut pieces, &mut owner);
    pieces.into_iter().filter(|piece| !piece.triangles.is_empty()).map(|piece| cutter.chart(piece)).collect()
}

/// For each triangle those across its edges; none across an edge of one triangle, or of more than two.
fn neighbours(triangles: &[[u32; 3]]) -> Vec<[Option<u32>; 3]> {
    let mut edges: Vec<(u32, u32, u32, u8)> = Vec::with_capacity(3 * triangles.len());
    for (t, corners) in triangles.iter().enumerate() {
        for e in 0..3u8 {
            let (a, b) = (corners[e as usize], corners[(e as usize + 1) % 3]);
            edges.push((a.min(b), a.max(b), t as u32, e));
        }
    }
    edges.sort_unstable();
    let mut found = vec![[None; 3]; triangles.len()];
    for same in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        if let [(.., t, e), (.., u, f)] = *same {
            found[t as usize][e as usize] = Some(u);
            found[u as usize][f as usize] = Some(t);
        }
    }
    found
}

struct Cutter<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    // Unit, or 0 of triangles without area.
    normals: Vec<Vec3>,
    neighbours: Vec<[Option<u32>; 3]>,
    longest: f32,
    cell: f32,
    slack: f32,
}

/// A chart that grows.
struct Piece {
    // Of the plane.
    normal: Vec3,
    triangles: Vec<u32>,
    laid: Laid,
    low: Vec2,
    high: Vec2,
}

impl Piece {
    fn new(normal: Vec3, cutter: &Cutter<'_>) -> Self {
        let laid = Laid { cells: HashMap::new(), cell: cutter.cell, slack: cutter.slack, all: Vec::new() };
        Self { normal, triangles: Vec::new(), laid, low: Vec2::INFINITY, high: Vec2::NEG_INFINITY }
    }

    fn place(&self, p: Vec3) -> Vec2 {
        let (across, up) = self.normal.any_orthonormal_pair();
        Vec2::new(p.dot(across), p.dot(up))
    }

    /// Lays a triangle beside the others, if it is flat enough and has room there; the first always.
    fn try_lay(&mut self, t: u32, least_cosine: f32, cutter: &Cutter<'_>) -> bool {
        let own = cutter.normals[t as usize];
        let flat = cutter.triangles[t as usize].map(|v| self.place(cutter.positions[v as usize]));
        let (low, high) = flat.iter().fold((self.low, self.high), |(l, h), &p| (l.min(p), h.max(p)));
        // Those without area have no normal, and fit anywhere.
        let tilted = own != Vec3::ZERO && own.dot(self.normal) < least_cosine;
        let too_large = (high - low).max_element() > cutter.longest;
        if !self.triangles.is_empty() && (tilted || too_large || self.laid.meets(flat)) {
            return false;
        }
        self.laid.lay(flat);
        self.triangles.push(t);
        (self.low, self.high) = (low, high);
        true
    }
}

impl Cutter<'_> {
    /// The chart around a triangle: all that hangs together with it, has no owner, and lies flat beside the rest.
    fn grow(&self, seed: u32, number: usize, owner: &mut [Option<usize>]) -> Piece {
        let mut piece = Piece::new(self.mean_normal(seed, owner), self);
        let mut open = VecDeque::from([seed]);
        while let Some(t) = open.pop_front() {
            if owner[t as usize].is_some() || !piece.try_lay(t, LEAST_COSINE, self) {
                continue;
            }
            owner[t as usize] = Some(number);
            open.extend(self.neighbours[t as usize].iter().flatten().filter(|&&n| owner[n as usize].is_none()));
        }
        piece
    }

    /// Moves triangles of small charts into larger ones beside them, as far as they lie flat there.
    fn join_crumbs(&self, pieces: &mut [Piece], owner: &mut [Option<usize>]) {
        let mut crumbs: Vec<usize> = (0..pieces.len()).filter(|&i| pieces[i].triangles.len() <= CRUMB).collect();
        crumbs.sort_by_key(|&i| (pieces[i].triangles.len(), i));
        for from in crumbs {
            let mut left = std::mem::take(&mut pieces[from].triangles);
            loop {
                let before = left.len();
                left.retain(|&t| {
                    let beside = self.neighbours[t as usize].iter().flatten().filter_map(|&n| owner[n as usize]);
                    let larger = beside.filter(|&to| to != from && pieces[to].triangles.len() > before);
                    let to = larger.max_by_key(|&to| (pieces[to].triangles.len(), to));
                    let moved = to.is_some_and(|to| pieces[to].try_lay(t, LEAST_COSINE_OF_CRUMBS, self));
                    if moved {
                        owner[t as usize] = to;
                    }
                    !moved
                });
                if left.len() == before {
                    break;
                }
            }
            pieces[from].triangles = left;
        }
    }

    /// The mean normal of free triangles around one.
    fn mean_normal(&self, seed: u32, owner: &[Option<usize>]) -> Vec3 {
        let mut around = vec![seed];
        let mut next = 0;
        while next < around.len() && around.len() < AROUND {
            for &n in self.neighbours[around[next] as usize].iter().flatten() {
                let fits = self.normals[n as usize].dot(self.normals[seed as usize]) >= LEAST_COSINE;
                if fits && owner[n as usize].is_none() && !around.contains(&n) {
                    around.push(n);
                }
            }
            next += 1;
        }
        let own = self.normals[seed as usize];
        let mean = around.iter().map(|&t| self.normals[t as usize]).sum::<Vec3>().normalize_or_zero();
        let chosen = if mean.dot(own) >= LEAST_COSINE { mean } else { own };
        if chosen == Vec3::ZERO { Vec3::Z } else { chosen }
    }

    fn chart(&self, piece: Piece) -> Chart {
        let mut number: HashMap<u32, u32> = HashMap::new();
        let mut vertices = Vec::new();
        let corners: Vec<[u32; 3]> = (piece.triangles.iter())
            .map(|&t| {
                self.triangles[t as usize].map(|v| {
                    *number.entry(v).or_insert_with(|| {
                        vertices.push(v);
                        vertices.len() as u32 - 1
                    })
                })
            })
            .collect();
        let mut places: Vec<Vec2> = vertices.iter().map(|&v| piece.place(self.positions[v as usize])).collect();
        let size = turn(&mut places);
        Chart { triangles: piece.triangles, corners, vertices, places, size }
    }
}

/// Turns a chart so that the rectangle around it is small and lies on its longer side, moves that to 0, and returns its size.
fn turn(places: &mut [Vec2]) -> Vec2 {
    const STEPS: u32 = 24;
    let turned = |step: u32, p: Vec2| {
        let angle = f64::from(step) / f64::from(STEPS) * std::f64::consts::FRAC_PI_2;
        let (sine, cosine) = (libm::sin(angle) as f32, libm::cos(angle) as f32);
        Vec2::new(cosine * p.x - sine * p.y, sine * p.x + cosine * p.y)
    };
    let around = |step: u32| {
        let start = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        places.iter().map(|&p| turned(step, p)).fold(start, |(low, high), p| (low.min(p), high.max(p)))
    };
    let area = |&(_, low, high): &(u32, Vec2, Vec2)| (high - low).element_product();
    let all = (0..STEPS).map(|step| (step, around(step))).map(|(step, (low, high))| (step, low, high));
    let Some((step, low, high)) = all.min_by(|a, b| area(a).total_cmp(&area(b))) else { return Vec2::ZERO };
    let size = high - low;
    for p in places.iter_mut() {
        let q = (turned(step, *p) - low).clamp(Vec2::ZERO, size);
        // A quarter turn, not a reflection: charts keep their orientation.
        *p = if size.y > size.x { Vec2::new(q.y, size.x - q.x) } else { q };
    }
    if size.y > size.x { Vec2::new(size.y, size.x) } else { size }
}

/// Triangles in a plane, by the cells of a grid.
struct Laid {
    cells: HashMap<[i32; 2], Vec<u32>>,
    cell: f32,
    slack: f32,
    all: Vec<[Vec2; 3]>,
}

impl Laid {
    fn cells_of(&self, [a, b, c]: [Vec2; 3]) -> impl Iterator<Item = [i32; 2]> + use<> {
        let [low, high] = [a.min(b).min(c), a.max(b).max(c)].map(|p| (p / self.cell).floor().as_ivec2());
        (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| [x, y]))
    }

    fn lay(&mut self, triangle: [Vec2; 3]) {
        let number = self.all.len() as u32;
        for cell in self.cells_of(triangle) {
            self.cells.entry(cell).or_default().push(number);
        }
        self.all.push(triangle);
    }

    /// Whether a triangle lies over one of them.
    fn meets(&self, triangle: [Vec2; 3]) -> bool {
        let near = self.cells_of(triangle).filter_map(|cell| self.cells.get(&cell)).flatten();
        near.into_iter().any(|&other| overlap(triangle, self.all[other as usize], self.slack))
    }
}

/// Whether two triangles share more than `slack`: no line along an edge of either parts them (separating axes).
fn overlap(a: [Vec2; 3], b: [Vec2; 3], slack: f32) -> bool {
    let parted_along = |from: Vec2, to: Vec2| {
        let axis = (to - from).perp().normalize_or_zero();
        let span = |t: [Vec2; 3]| {
            let along = t.map(|p| p.dot(axis));
            (
                along.iter().copied().fold(f32::INFINITY, f32::min),
                along.iter().copied().fold(f32::NEG_INFINITY, f32::max),
            )
        };
        let ((low_a, high_a), (low_b, high_b)) = (span(a), span(b));
        axis == Vec2::ZERO || high_a <= low_b + slack || high_b <= low_a + slack
    };
    ![a, b].iter().any(|t| (0..3).any(|i| parted_along(t[i], t[(i + 1) % 3])))
}
