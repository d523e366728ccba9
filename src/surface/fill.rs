//! The two passes of the extraction: count every layer, then fill every slab into its own piece
//! of the output.
//!
//! # Order
//! Layer k is the plane of samples z = k and the cells between it and plane k + 1. Its vertices
//! are, in this order: for each row y of the plane the crossings of its x edges, then of its y
//! edges; the crossings of the z edges by row; the vertices inside cells by cell. Layers follow
//! each other. Triangles follow the cells, x fastest. The order knows nothing of slabs and
//! threads.

use super::cell::edge_corners;
use super::decide::{face_decisions, tunnel};
use super::signs::Signs;
use super::table::{Plan, TABLE, Table};
use super::triangulate::FIRST_INNER;
use crate::error::{Error, Result};
use crate::volume::Sample;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Layers that one task fills. Short enough to spread over the threads, long enough that the
/// plane numbered twice (once on either side of a slab border) costs little.
const LAYERS_PER_SLAB: usize = 8;

/// The least distance of a crossing from the ends of its edge, in voxels: 2⁻¹⁴ = 6.1e-5.
///
/// A sample that equals the isovalue puts the crossings of all its edges on one grid point, and
/// triangles of no area between them. Held apart, the vertices of a cell are three or more
/// points on different edges, none at a corner; a line meets the surface of a cube in two points
/// or lies in a face, and no triangle has its three vertices in one face, so *every* triangle has
/// an area, of at least about δ² = 4e-9 voxel². The price is an error of the position of at most
/// δ, below the 1e-4 voxel that is promised. A larger δ moves vertices visibly; a smaller one is
/// lost when positions are rounded to f32, whose step is 2⁻¹⁴ for coordinates from 512 to 1024.
const LEAST_PARAMETER: f64 = 1.0 / 16384.0;

/// The longest axis in samples: beyond it f32 coordinates cannot tell the crossings of an edge.
const LONGEST_AXIS: usize = 1 << 22;

/// A level set in grid space.
pub(super) struct Surface {
    pub positions: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// Vertices and triangles before each layer, and at the end the totals.
    pub layers: Vec<[usize; 2]>,
}

/// What both passes read.
struct Grid<'a, S> {
    dims: [usize; 3],
    samples: &'a [S],
    c: f64,
    sign: f64,
    least: f64,
    flip: bool,
    signs: Signs,
    table: &'static Table,
}

/// The surface of {solid_sign·(raw − c_raw) > 0}; `flip` turns every triangle, and `most_vertices`
/// is the limit on their number.
pub(super) fn level_set<S: Sample>(
    dims: [usize; 3],
    samples: &[S],
    c_raw: f64,
    solid_sign: f32,
    flip: bool,
    most_vertices: u64,
) -> Result<Surface> {
    let longest = dims.into_iter().max().unwrap_or(0);
    if longest > LONGEST_AXIS {
        return Err(Error::Limit {
            what: "an isosurface of this grid".into(),
            needed: format!("{longest} samples along an axis"),
            limit: format!("{LONGEST_AXIS} samples, for positions in single precision"),
            remedy: "crop the volume or extract it in parts".into(),
        });
    }
    if dims.into_iter().min().unwrap_or(0) < 2 {
        return Ok(Surface { positions: Vec::new(), triangles: Vec::new(), layers: vec![[0, 0]; dims[2] + 1] });
    }
    let signs = Signs::new(dims, samples, c_raw, solid_sign);
    let (sign, least) = (f64::from(solid_sign), least_parameter(longest));
    let grid = Grid { dims, samples, c: c_raw, sign, least, flip, signs, table: &TABLE };
    let layers = grid.count(most_vertices)?;
    let [vertices, triangles] = layers[dims[2]];
    let mut surface = Surface { positions: vec![[0.0; 3]; vertices], triangles: vec![[0; 3]; triangles], layers };
    let (mut positions, mut triangles) = (&mut surface.positions[..], &mut surface.triangles[..]);
    let mut slabs = Vec::new();
    for start in (0..dims[2]).step_by(LAYERS_PER_SLAB) {
        let range = start..(start + LAYERS_PER_SLAB).min(dims[2]);
        let [first, end] = [surface.layers[range.start], surface.layers[range.end]];
        let (own_positions, own_triangles);
        (own_positions, positions) = positions.split_at_mut(end[0] - first[0]);
        (own_triangles, triangles) = triangles.split_at_mut(end[1] - first[1]);
        slabs.push((range, own_positions, own_triangles));
    }
    let layers = &surface.layers;
    let slabs = slabs.into_par_iter().with_max_len(1);
    slabs.for_each(|(range, positions, triangles)| grid.fill_slab(range, layers, positions, triangles));
    Ok(surface)
}

/// [`LEAST_PARAMETER`], or one f32 step of the largest coordinate where that is longer.
pub(super) fn least_parameter(longest_axis: usize) -> f64 {
    let largest_start = (longest_axis.max(2) - 2) as f32;
    LEAST_PARAMETER.max(f64::from(largest_start.next_up() - largest_start))
}

impl<S: Sample> Grid<'_, S> {
    fn raw(&self, x: usize, y: usize, z: usize) -> f64 {
        f64::from(self.samples[x + self.dims[0] * (y + self.dims[1] * z)].raw())
    }

    /// d = s·(raw − c) at the corners of a cell.
    fn corner_values(&self, x: usize, y: usize, z: usize) -> [f64; 8] {
        std::array::from_fn(|k| self.sign * (self.raw(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)) - self.c))
    }

    /// Where the surface crosses an edge, as a fraction of it. Bit-identical for h → −h, c → −c.
    fn parameter(&self, raw0: f64, raw1: f64) -> f64 {
        ((self.c - raw0) / (raw1 - raw0)).clamp(self.least, 1.0 - self.least)
    }

    fn plan(&self, pattern: u8, x: usize, y: usize, z: usize) -> Plan {
        plan_of(self.table, pattern, || self.corner_values(x, y, z))
    }

    /// Vertices and triangles before each layer.
    fn count(&self, most_vertices: u64) -> Result<Vec<[usize; 2]>> {
        let [_, ny, nz] = self.dims;
        let counts: Vec<[u64; 2]> = (0..nz)
            .into_par_iter()
            .map(|z| {
                let [mut vertices, mut triangles] = [0, 0];
                for y in 0..ny {
                    vertices += self.signs.count_crossings(0, y, z);
                    if y + 1 < ny {
                        vertices += self.signs.count_crossings(1, y, z);
                    }
                    if z + 1 < nz {
                        vertices += self.signs.count_crossings(2, y, z);
                    }
                    if y + 1 < ny && z + 1 < nz {
                        self.signs.for_each_crossed_cell(y, z, |x, pattern| {
                            let plan = self.plan(pattern, x, y, z);
                            vertices += u64::from(plan.inner);
                            triangles += u64::from(plan.triangles);
                        });
                    }
                }
                [vertices, triangles]
            })
            .collect();
        let total: u64 = counts.iter().map(|c| c[0]).sum();
        if total > most_vertices {
            return Err(Error::Limit {
                what: "this isosurface".into(),
                needed: format!("{total} vertices"),
                limit: format!("{most_vertices} vertices, for 32-bit indices"),
                remedy: "choose another isovalue, or crop or coarsen the volume".into(),
            });
        }
        let mut before = [0, 0];
        let mut layers = vec![before];
        layers.extend(counts.iter().map(|c| {
            before = [before[0] + c[0] as usize, before[1] + c[1] as usize];
            before
        }));
        Ok(layers)
    }

    fn fill_slab(
        &self,
        range: Range<usize>,
        layers: &[[usize; 2]],
        positions: &mut [[f32; 3]],
        triangles: &mut [[u32; 3]],
    ) {
        let [nx, ny, nz] = self.dims;
        let mut numbers = Numbers::new(nx, ny);
        let mut positions = positions.iter_mut();
        let mut put = |p: [f32; 3]| {
            if let Some(slot) = positions.next() {
                *slot = p;
            }
        };
        let mut triangles = triangles.iter_mut();
        let mut next = self.number_plane(range.start, layers[range.start][0], &mut numbers.lower);
        for z in range {
            self.for_each_in_plane(z, |axis, x, y| put(self.crossing(axis, x, y, z)));
            if z + 1 == nz {
                break;
            }
            for y in 0..ny {
                self.signs.for_each_crossing(2, y, z, |x| {
                    numbers.vertical[x + nx * y] = next;
                    next += 1;
                    put(self.crossing(2, x, y, z));
                });
            }
            let after_plane = self.number_plane(z + 1, layers[z + 1][0], &mut numbers.upper);
            for y in 0..ny - 1 {
                self.signs.for_each_crossed_cell(y, z, |x, pattern| {
                    let plan = self.plan(pattern, x, y, z);
                    let edges = numbers.of_cell(x, y);
                    let vertex = |v: u8| match v.checked_sub(FIRST_INNER) {
                        None => edges[usize::from(v)],
                        Some(inner) => next + u32::from(inner),
                    };
                    for (local, slot) in self.table.triangles(plan).iter().zip(triangles.by_ref()) {
                        let [a, b, c] = local.map(vertex);
                        *slot = if self.flip { [a, c, b] } else { [a, b, c] };
                    }
                    for &edges in self.table.inner(plan) {
                        put(self.inner_vertex(edges, x, y, z));
                        next += 1;
                    }
                });
            }
            debug_assert_eq!(next as usize, layers[z + 1][0], "the passes disagree in layer {z}");
            next = after_plane;
            std::mem::swap(&mut numbers.lower, &mut numbers.upper);
        }
        debug_assert!(positions.next().is_none() && triangles.next().is_none(), "the passes disagree");
    }

    /// Calls back with axis, x, y of each crossed edge in the plane z, in the order of vertices.
    #[inline(always)]
    fn for_each_in_plane(&self, z: usize, mut edge_at: impl FnMut(usize, usize, usize)) {
        for y in 0..self.dims[1] {
            self.signs.for_each_crossing(0, y, z, |x| edge_at(0, x, y));
            if y + 1 < self.dims[1] {
                self.signs.for_each_crossing(1, y, z, |x| edge_at(1, x, y));
            }
        }
    }

    /// Numbers the crossings of a plane from `first` on; returns the number after the last.
    fn number_plane(&self, z: usize, first: usize, plane: &mut [Vec<u32>; 2]) -> u32 {
        let (nx, mut next) = (self.dims[0], first as u32);
        self.for_each_in_plane(z, |axis, x, y| {
            plane[axis][x + nx * y] = next;
            next += 1;
        });
        next
    }

    /// The crossing of the edge along `axis` that starts at (x, y, z).
    fn crossing(&self, axis: usize, x: usize, y: usize, z: usize) -> [f32; 3] {
        let step = |a: usize| usize::from(a == axis);
        let t = self.parameter(self.raw(x, y, z), self.raw(x + step(0), y + step(1), z + step(2)));
        let mut position = [x as f32, y as f32, z as f32];
        position[axis] = ([x, y, z][axis] as f64 + t) as f32;
        position
    }

    /// A vertex inside the cell: the mean of the crossings of `edges`, moved onto the surface.
    fn inner_vertex(&self, edges: u16, x: usize, y: usize, z: usize) -> [f32; 3] {
        let local = inner_point(&self.corner_values(x, y, z), edges, self.least);
        (DVec3::new(x as f64, y as f64, z as f64) + local).as_vec3().to_array()
    }
}

/// The triangles of a cell with these corners solid: where the pattern does not settle it, by the values d = s·(raw − c) there.
fn plan_of(table: &Table, pattern: u8, values: impl FnOnce() -> [f64; 8]) -> Plan {
    let entry = table.patterns[usize::from(pattern)];
    let first = &table.configurations[usize::from(entry.first)];
    let plan = if entry.settled {
        first.disks
    } else {
        let d = values();
        let offset = usize::from(face_decisions(&d, entry.ambiguous));
        let configuration = &table.configurations[usize::from(entry.first) + offset];
        let tunnel = if configuration.tunnels.is_empty() { None } else { tunnel(&d, &configuration.regions) };
        tunnel.and_then(|pair| configuration.tunnels.iter().find(|t| t.0 == pair)).map_or(configuration.disks, |t| t.1)
    };
    table.plans[usize::from(plan)]
}

/// A vertex inside a unit cell with the values `d` at its corners: the mean of the crossings of `edges`, moved onto the surface.
fn inner_point(d: &[f64; 8], edges: u16, least: f64) -> DVec3 {
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for edge in (0..12).filter(|e| edges >> e & 1 == 1) {
        let [low, high] = edge_corners(edge);
        let axis = edge / 4;
        let mut point = DVec3::from([0, 1, 2].map(|a| (low >> a & 1) as f64));
        point[axis] = (d[low] / (d[low] - d[high])).clamp(least, 1.0 - least);
        sum += point;
        count += 1.0;
    }
    onto_surface(d, sum / count)
}

/// What a cell on its own consists of: triangles of vertices on edges (numbers below 12) or inside it, of which `inner` has the
/// places.
pub(crate) struct CellTriangles {
    /// Counter-clockwise as seen from the lit side.
    pub triangles: &'static [[u8; 3]],
    /// In the unit cell; the first is vertex 12.
    pub inner: Vec<DVec3>,
}

/// The triangles of one cell by the values d = s·(raw − c) at its corners, as the whole extraction has them.
pub(crate) fn triangles_of_cell(d: &[f64; 8]) -> CellTriangles {
    let pattern = (0..8).fold(0, |bits, k| bits | u8::from(d[k] > 0.0) << k);
    let table: &'static Table = &TABLE;
    let plan = plan_of(table, pattern, || *d);
    let inner = table.inner(plan).iter().map(|&edges| inner_point(d, edges, LEAST_PARAMETER)).collect();
    CellTriangles { triangles: table.triangles(plan), inner }
}

/// Moves a point of the unit cell towards {trilinear = 0} by Newton steps along the gradient, as
/// long as each step makes the value smaller and stays well inside the cell. It is an
/// improvement of the shape only: whatever it returns is inside the cell, which is all that
/// the topology needs.
fn onto_surface(d: &[f64; 8], start: DVec3) -> DVec3 {
    /// Distance kept from the faces of the cell; anything well above [`LEAST_PARAMETER`] and
    /// below a visible length.
    const MARGIN: f64 = 1.0 / 64.0;
    const MOST_STEPS: usize = 6;
    let mut point = start.clamp(DVec3::splat(MARGIN), DVec3::splat(1.0 - MARGIN));
    let (mut value, mut gradient) = trilinear(d, point);
    for _ in 0..MOST_STEPS {
        let next = point - gradient * (value / gradient.length_squared());
        let inside = next.cmpge(DVec3::splat(MARGIN)).all() && next.cmple(DVec3::splat(1.0 - MARGIN)).all();
        let (next_value, next_gradient) = trilinear(d, next);
        // A vanishing gradient gives NaN, which is neither inside nor smaller.
        if !(inside && next_value.abs() < value.abs()) {
            break;
        }
        (point, value, gradient) = (next, next_value, next_gradient);
    }
    point
}

/// The trilinear function with corner values `d`, and its gradient.
fn trilinear(d: &[f64; 8], p: DVec3) -> (f64, DVec3) {
    let (mut value, mut gradient) = (0.0, DVec3::ZERO);
    for (corner, &v) in d.iter().enumerate() {
        let high = [0, 1, 2].map(|a| corner >> a & 1 == 1);
        let weight: [f64; 3] = std::array::from_fn(|a| if high[a] { p[a] } else { 1.0 - p[a] });
        let sign = high.map(|h| if h { 1.0 } else { -1.0 });
        value += v * weight[0] * weight[1] * weight[2];
        gradient += v * DVec3::new(
            sign[0] * weight[1] * weight[2],
            sign[1] * weight[0] * weight[2],
            sign[2] * weight[0] * weight[1],
        );
    }
    (value, gradient)
}

/// Vertex numbers of the crossed edges of one layer, by the grid point at which the edge starts.
/// Only the entries of crossed edges are ever written or used; others hold leftovers.
struct Numbers {
    /// The x edges and the y edges of the lower plane.
    lower: [Vec<u32>; 2],
    /// The same in the upper plane.
    upper: [Vec<u32>; 2],
    vertical: Vec<u32>,
    nx: usize,
}

impl Numbers {
    fn new(nx: usize, ny: usize) -> Self {
        let plane = || vec![0; nx * ny];
        Self { lower: [plane(), plane()], upper: [plane(), plane()], vertical: plane(), nx }
    }

    /// The numbers of the twelve edges of the cell at (x, y).
    #[inline(always)]
    fn of_cell(&self, x: usize, y: usize) -> [u32; 12] {
        let i = x + self.nx * y;
        let j = i + self.nx;
        let ([x0, y0], [x1, y1], z) = (&self.lower, &self.upper, &self.vertical);
        [x0[i], x0[j], x1[i], x1[j], y0[i], y0[i + 1], y1[i], y1[i + 1], z[i], z[i + 1], z[j], z[j + 1]]
    }
}
