//! An isosurface of a model by continuation: from seeds on it, cell by cell, without sampling the whole box.

use super::CellKind;
use crate::geom::Bounds;
use crate::grid3;
use crate::model::sample::coordinates;
use crate::model::{RootFinder, Tree, root_on_segment};
use crate::surface::{edge_corners, face_corners, triangles_of_cell};
use crate::volume::Volume;
use glam::DVec3;
use std::collections::{HashMap, HashSet, VecDeque};

/// Rows of the grid that are searched for seeds where primitives have none: each fourth along y and z. Parts of a surface that
/// are thinner than that may be missed.
const SEARCHED: usize = 4;

/// The six tetrahedra around the diagonal of a cell from corner 0 to corner 7. Cells beside each other cut the face between them
/// along the same diagonal.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// Which side of the isovalue is solid, by the values that samples have: the same cells are crossed as of the volume.
#[derive(Clone, Copy, Debug)]
pub struct Sides {
    /// The isovalue.
    pub iso: f64,
    /// 1 where what is above is solid, −1 where what is below is.
    pub sign: f64,
    /// What samples have in the place of values that are no numbers.
    pub missing: f32,
}

impl Sides {
    /// Of the isosurface of a volume that is samples of a model.
    pub fn new(volume: &Volume, iso: f64) -> Self {
        Self { iso, sign: f64::from(volume.solid_sign()), missing: volume.value_range().0 as f32 }
    }

    /// Positive in the solid.
    fn of(&self, value: f64) -> f64 {
        let sample = Some(value as f32).filter(|v| v.is_finite()).unwrap_or(self.missing);
        self.sign * (f64::from(sample) - self.iso)
    }
}

/// A surface as it grows.
pub struct Continuation<'a> {
    tree: &'a Tree,
    sides: Sides,
    dims: [usize; 3],
    along: [Vec<f64>; 3],
    // f at corners.
    values: HashMap<u64, f64>,
    vertices: HashMap<(u64, u8), u32>,
    /// What came of it.
    pub found: Found,
}

/// A mesh, and what it took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// In grid space.
    pub positions: Vec<DVec3>,
    /// Counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Cells looked at.
    pub visited: u64,
    /// Those that the surface crosses.
    pub crossed: u64,
    /// Evaluations of the model.
    pub evaluations: u64,
    /// Whether rows of the grid were searched for seeds.
    pub searched: bool,
}

impl<'a> Continuation<'a> {
    /// Of a model, on the grid of its samples.
    pub fn new(tree: &'a Tree, bounds: &Bounds, dims: [usize; 3], sides: Sides) -> Self {
        let along = coordinates(bounds, dims);
        Self { tree, sides, dims, along, values: HashMap::new(), vertices: HashMap::new(), found: Found::default() }
    }

    fn place(&self, corner: [usize; 3]) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|a| self.along[a][corner[a]]))
    }

    fn key(&self, corner: [usize; 3]) -> u64 {
        grid3::index([self.dims[0], self.dims[1]], corner) as u64
    }

    fn value(&mut self, corner: [usize; 3]) -> f64 {
        let key = self.key(corner);
        if let Some(&known) = self.values.get(&key) {
            return known;
        }
        self.found.evaluations += 1;
        let value = self.tree.value(self.place(corner));
        self.values.insert(key, value);
        value
    }

    /// Positive in the solid.
    fn side(&mut self, corner: [usize; 3]) -> f64 {
        let value = self.value(corner);
        self.sides.of(value)
    }

    /// Walks along the rows of the grid through a place in world, both ways along each axis, to the first cell in which the
    /// surface is crossed.
    fn walk(&mut self, from: DVec3) -> Vec<[usize; 3]> {
        let mut seeds = Vec::new();
        let start: [usize; 3] = std::array::from_fn(|a| {
            let [low, high] = [self.along[a][0], self.along[a][self.dims[a] - 1]];
            let t = (from[a] - low) / (high - low) * (self.dims[a] - 1) as f64;
            (t.max(0.0) as usize).min(self.dims[a] - 1)
        });
        for axis in 0..3 {
            for up in [true, false] {
                let mut here = start;
                let solid = self.side(here) > 0.0;
                while (up && here[axis] + 1 < self.dims[axis]) || (!up && here[axis] > 0) {
                    let before = here;
                    here[axis] = if up { here[axis] + 1 } else { here[axis] - 1 };
                    if (self.side(here) > 0.0) != solid {
                        let low: [usize; 3] = std::array::from_fn(|a| here[a].min(before[a]));
                        seeds.push(std::array::from_fn(|a| low[a].min(self.dims[a] - 2)));
                        break;
                    }
                }
            }
        }
        seeds
    }

    /// Seeds of the surface: from the skeletons of primitives; where one has none, or is nowhere near the surface, from rows of
    /// the grid.
    pub fn seeds(&mut self) -> Vec<[usize; 3]> {
        let skeletons = self.tree.skeletons();
        let (mut seeds, mut searches) = (Vec::new(), skeletons.without > 0);
        for &point in &skeletons.points {
            let found = self.walk(point);
            searches |= found.is_empty();
            seeds.extend(found);
        }
        if searches {
            self.found.searched = true;
            let [nx, ny, nz] = self.dims;
            for (z, y) in (0..nz).step_by(SEARCHED).flat_map(|z| (0..ny).step_by(SEARCHED).map(move |y| (z, y))) {
                for x in 1..nx {
                    if (self.side([x - 1, y, z]) > 0.0) != (self.side([x, y, z]) > 0.0) {
                        seeds.push([x - 1, y.min(ny - 2), z.min(nz - 2)]);
                    }
                }
            }
        }
        seeds
    }

    /// Goes on from seeds through all faces that the surface crosses.
    pub fn run(&mut self, seeds: Vec<[usize; 3]>, kind: CellKind, finder: RootFinder) {
        let mut queue = VecDeque::new();
        let mut visited = HashSet::new();
        for seed in seeds {
            if visited.insert(self.key(seed)) {
                queue.push_back(seed);
            }
        }
        while let Some(cell) = queue.pop_front() {
            let Some(values) = self.cell(cell, kind, finder) else { continue };
            for face in 0..6 {
                let solid = face_corners(face).map(|k| values[k] > 0.0);
                if solid.iter().all(|s| *s == solid[0]) {
                    continue;
                }
                let (axis, up) = (face / 2, face % 2 == 1);
                let mut next = cell;
                if (up && cell[axis] + 2 >= self.dims[axis]) || (!up && cell[axis] == 0) {
                    continue;
                }
                next[axis] = if up { cell[axis] + 1 } else { cell[axis] - 1 };
                if visited.insert(self.key(next)) {
                    queue.push_back(next);
                }
            }
        }
    }

    /// Adds the triangles of a cell; the values of its corners, positive in the solid, where the surface crosses it.
    pub fn cell(&mut self, cell: [usize; 3], kind: CellKind, finder: RootFinder) -> Option<[f64; 8]> {
        self.found.visited += 1;
        let corner = |k: usize| [0, 1, 2].map(|a| cell[a] + (k >> a & 1));
        let values: [f64; 8] = std::array::from_fn(|k| self.side(corner(k)));
        if values.iter().all(|v| (*v > 0.0) == (values[0] > 0.0)) {
            return None;
        }
        self.found.crossed += 1;
        match kind {
            CellKind::Cubes => {
                let triangles = triangles_of_cell(&values);
                let first = self.found.positions.len() as u32;
                let low = DVec3::from_array(cell.map(|v| v as f64));
                self.found.positions.extend(triangles.inner.iter().map(|p| low + *p));
                for triangle in triangles.triangles {
                    let vertex = |v: u8| match v.checked_sub(12) {
                        Some(inner) => first + u32::from(inner),
                        None => {
                            let [a, b] = edge_corners(usize::from(v));
                            self.vertex([corner(a), corner(b)], [values[a], values[b]], finder)
                        }
                    };
                    let triangle = triangle.map(vertex);
                    self.found.triangles.push(triangle);
                }
            }
            CellKind::Tetrahedra => {
                for tetrahedron in TETRAHEDRA {
                    self.tetrahedron(tetrahedron, &corner, &values, finder);
                }
            }
        }
        Some(values)
    }

    /// The vertex on an edge of the grid, a face or a cell, from its lower end to its upper.
    fn vertex(&mut self, [a, b]: [[usize; 3]; 2], [low, high]: [f64; 2], finder: RootFinder) -> u32 {
        let direction = (0..3).fold(0, |bits, axis| bits | u8::from(b[axis] > a[axis]) << axis);
        let key = (self.key(a), direction);
        if let Some(&known) = self.vertices.get(&key) {
            return known;
        }
        let ends = [a, b].map(|corner| self.place(corner));
        let found = match finder {
            RootFinder::Linear => None,
            _ => {
                let values = [a, b].map(|corner| self.value(corner));
                let root = root_on_segment(self.tree, self.sides.iso, ends, values, finder);
                self.found.evaluations += u64::from(root.evaluations);
                root.along
            }
        };
        // Linear between the samples; where rounding alone made a root, it is at the end that was rounded.
        let along = found.unwrap_or_else(|| (low / (low - high)).clamp(0.0, 1.0));
        let [start, end] = [a, b].map(|corner| DVec3::from_array(corner.map(|v| v as f64)));
        let number = self.found.positions.len() as u32;
        self.found.positions.push(start + (end - start) * along);
        self.vertices.insert(key, number);
        number
    }

    fn tetrahedron(
        &mut self,
        corners: [usize; 4],
        place: &dyn Fn(usize) -> [usize; 3],
        values: &[f64; 8],
        finder: RootFinder,
    ) {
        let (solid, lit): (Vec<usize>, Vec<usize>) = corners.iter().partition(|&&k| values[k] > 0.0);
        let mut on = |a: usize, b: usize| {
            // Ends in the order of the diagonal: the lower has fewer bits, all of them the upper's.
            let (low, high) = if a & b == a { (a, b) } else { (b, a) };
            self.vertex([place(low), place(high)], [values[low], values[high]], finder)
        };
        let at = |k: usize| DVec3::from_array([0, 1, 2].map(|a| (k >> a & 1) as f64));
        let is_right = |o: usize, [a, b, c]: [usize; 3]| {
            let [x, y, z] = [a, b, c].map(|k| at(k) - at(o));
            x.cross(y).dot(z) > 0.0
        };
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        match (solid.as_slice(), lit.as_slice()) {
            // Around the corner that is alone; seen from outside it turns the other way where that is the lit one.
            (&[one], &[a, b, c]) => {
                let turned = if is_right(one, [a, b, c]) { [a, b, c] } else { [a, c, b] };
                triangles.push(turned.map(|k| on(one, k)));
            }
            (&[a, b, c], &[one]) => {
                let turned = if is_right(one, [a, b, c]) { [a, c, b] } else { [a, b, c] };
                triangles.push(turned.map(|k| on(one, k)));
            }
            (&[a, b], &[c, d]) => {
                let (c, d) = if is_right(a, [b, c, d]) { (c, d) } else { (d, c) };
                let [ac, ad, bd, bc] = [on(a, c), on(a, d), on(b, d), on(b, c)];
                triangles.extend([[ac, ad, bd], [ac, bd, bc]]);
            }
            _ => {}
        }
        self.found.triangles.extend(triangles);
    }
}
