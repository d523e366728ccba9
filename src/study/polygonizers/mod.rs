//! Polygonizers compared on a model: marching cubes on its samples, as every command has it, against continuation from seeds
//! (Wyvill, McPheeters and Wyvill 1986; Bloomenthal 1988) on the model itself, by cubes or six tetrahedra, with roots on edges
//! found in three ways.

mod continuation;
#[cfg(test)]
mod tests;

pub use continuation::{Continuation, Found, Sides};

use super::Clock;
use crate::error::Result;
use crate::export::atomic;
use crate::geom::Bounds;
use crate::level::Pyramid;
use crate::model::{RootFinder, Tree};
use crate::quantity::{count, number};
use crate::scene::{ModelDescription, sample_and_count};
use crate::surface::{isosurface_and_count, straddling_cells};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// What a crossed cell is cut into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKind {
    /// Itself, with the topology of the trilinear interpolant.
    Cubes,
    /// Six tetrahedra around one diagonal.
    Tetrahedra,
}

impl CellKind {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cubes => "cubes",
            Self::Tetrahedra => "tetrahedra",
        }
    }
}

/// How far vertices are from the model: |f − iso| / |∇f|, to first order the distance, in voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VertexErrors {
    /// Of the worst.
    pub most: f64,
    /// Root mean square.
    pub rms: f64,
}

/// A polygonizer and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct PolygonizerRow {
    /// Whether it goes on from seeds, or through all cells.
    pub continues: bool,
    /// What cells are cut into.
    pub cells: CellKind,
    /// How vertices are found on edges.
    pub roots: RootFinder,
    /// Cells looked at.
    pub visited: u64,
    /// Crossed cells that it did not find.
    pub missed: u64,
    /// Evaluations of the model at points, of what pruning left of it too; with its gradient, one.
    pub evaluations: u64,
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Distance of the vertices from the model.
    pub errors: VertexErrors,
    /// Seconds on the clock.
    pub seconds: f64,
}

/// All rows of a study.
#[derive(Clone, Debug)]
pub struct PolygonizerStudy {
    /// What each found.
    pub rows: Vec<PolygonizerRow>,
    /// Cells of the box.
    pub cells: u64,
    /// Whether rows of the grid were searched for seeds, besides skeletons.
    pub searched: bool,
    record: Value,
}

/// The largest and the mean distance of vertices in grid space; those where the gradient vanishes are left out.
pub fn vertex_errors(tree: &Tree, bounds: &Bounds, dims: [usize; 3], iso: f64, positions: &[DVec3]) -> VertexErrors {
    let voxel = bounds.size() / DVec3::from_array(dims.map(|n| (n - 1) as f64));
    let mut errors = VertexErrors::default();
    let mut measured = 0.0;
    for position in positions {
        let (value, gradient) = tree.value_and_gradient(bounds.min + *position * voxel);
        let error = (value - iso).abs() / (gradient * voxel).length();
        if error.is_finite() {
            errors.most = errors.most.max(error);
            errors.rms += error * error;
            measured += 1.0;
        }
    }
    errors.rms = (errors.rms / f64::max(measured, 1.0)).sqrt();
    errors
}

/// Compares the polygonizers on a model, on the grid of its samples.
///
/// # Errors
/// When the model cannot be sampled, or its surface has too many vertices.
pub fn compare_polygonizers(
    model: &ModelDescription,
    isovalue: f64,
    clock: &Clock<'_>,
    note: &dyn Fn(&str),
) -> Result<PolygonizerStudy> {
    let (tree, bounds, dims) = (&*model.tree, &model.bounds, model.dims);
    let cells = dims.iter().map(|&n| n as u64 - 1).product();
    let mut rows = Vec::new();
    let [start, _] = clock();
    let (mut volume, counters) = sample_and_count(model, "model".into())?;
    let pyramid = Pyramid::new(&volume);
    let sampled = clock()[0] - start;
    let crossed = straddling_cells(&volume, isovalue).count();
    for roots in [RootFinder::Linear, RootFinder::Newton] {
        volume.exact = (roots == RootFinder::Newton).then(|| Arc::clone(&model.tree));
        let [start, _] = clock();
        let (mesh, evaluations) = isosurface_and_count(&volume, &pyramid, isovalue)?;
        let seconds = sampled + clock()[0] - start;
        let positions: Vec<DVec3> =
            mesh.positions_in_grid.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
        rows.push(PolygonizerRow {
            continues: false,
            cells: CellKind::Cubes,
            roots,
            visited: cells,
            missed: 0,
            evaluations: counters.points + evaluations,
            vertices: positions.len() as u64,
            triangles: mesh.triangles.len() as u64,
            errors: vertex_errors(tree, bounds, dims, isovalue, &positions),
            seconds,
        });
    }
    let mut searched = false;
    for kind in [CellKind::Cubes, CellKind::Tetrahedra] {
        for roots in RootFinder::ALL {
            note(&format!("continuation by {}, {}", kind.name(), roots.name()));
            let [start, _] = clock();
            let mut surface = Continuation::new(tree, bounds, dims, Sides::new(&volume, isovalue));
            let seeds = surface.seeds();
            surface.run(seeds, kind, roots);
            let seconds = clock()[0] - start;
            let found = surface.found;
            searched |= found.searched;
            rows.push(PolygonizerRow {
                continues: true,
                cells: kind,
                roots,
                visited: found.visited,
                missed: crossed - found.crossed,
                evaluations: found.evaluations,
                vertices: found.positions.len() as u64,
                triangles: found.triangles.len() as u64,
                errors: vertex_errors(tree, bounds, dims, isovalue, &found.positions),
                seconds,
            });
        }
    }
    let record = json!({
        "samples": dims, "isovalue": isovalue, "cells": cells, "crossed_cells": crossed, "searched_rows": searched,
        "rows": rows.iter().map(PolygonizerRow::to_json).collect::<Vec<_>>(),
    });
    Ok(PolygonizerStudy { rows, cells, searched, record })
}

impl PolygonizerRow {
    /// What it is.
    pub fn name(&self) -> &'static str {
        if self.continues { "continuation" } else { "samples" }
    }

    fn to_json(&self) -> Value {
        json!({
            "polygonizer": self.name(), "cells": self.cells.name(), "roots": self.roots.name(),
            "visited": self.visited, "missed": self.missed, "evaluations": self.evaluations,
            "vertices": self.vertices, "triangles": self.triangles,
            "error_voxels": { "most": self.errors.most, "rms": self.errors.rms }, "seconds": self.seconds,
        })
    }
}

impl PolygonizerStudy {
    /// All that was found, for programs; `input` names what was studied.
    pub fn to_json(&self, input: &str) -> Value {
        let mut whole = self.record.clone();
        whole["input"] = json!(input);
        whole
    }

    /// The rows in words, the first of their heads.
    pub fn table(&self) -> Vec<Vec<String>> {
        let head = [
            "polygonizer",
            "cells",
            "roots",
            "visited",
            "of the box",
            "missed",
            "evaluations",
            "triangles",
            "largest error, voxels",
            "RMS",
            "s",
        ];
        let row = |row: &PolygonizerRow| {
            vec![
                row.name().into(),
                row.cells.name().into(),
                row.roots.name().into(),
                count(row.visited),
                format!("{} %", number(100.0 * row.visited as f64 / self.cells.max(1) as f64, 3)),
                count(row.missed),
                count(row.evaluations),
                count(row.triangles),
                format!("{:.1e}", row.errors.most),
                format!("{:.1e}", row.errors.rms),
                format!("{:.2}", row.seconds),
            ]
        };
        [head.map(String::from).to_vec()].into_iter().chain(self.rows.iter().map(row)).collect()
    }

    /// How the figures are to be read.
    pub fn legend(&self) -> String {
        let seeds = match self.searched {
            true => {
                "primitives' skeletons and each fourth row of the grid, as some primitives have no skeleton near the surface"
            }
            false => "primitives' skeletons",
        };
        format!(
            "Samples: the pruned sampling of the box on all threads, then marching cubes with normals; newton: with --exact-vertices. \
             Continuation: from seeds ({seeds}), on one thread, of the model itself. Missed: crossed cells of the samples that \
             it did not reach. Error: |f - isovalue| / |gradient| at the vertices; of samples it includes rounding to single \
             precision."
        )
    }

    /// Writes polygonizers.csv and polygonizers.json into a folder, which is made if it is not there.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path, input: &str) -> Result<()> {
        atomic::make_folder(folder)?;
        atomic::write_bytes(folder.join("polygonizers.csv"), self.csv().as_bytes())?;
        atomic::write_bytes(folder.join("polygonizers.json"), format!("{:#}\n", self.to_json(input)).as_bytes())
    }

    fn csv(&self) -> String {
        let mut out = String::from(
            "polygonizer,cells,roots,visited,cells_of_the_box,missed,evaluations,vertices,triangles,error_most_voxels,\
             error_rms_voxels,seconds\n",
        );
        for row in &self.rows {
            out += &format!(
                "{},{},{},{},{},{},{},{},{},{:e},{:e},{:.3}\n",
                row.name(),
                row.cells.name(),
                row.roots.name(),
                row.visited,
                self.cells,
                row.missed,
                row.evaluations,
                row.vertices,
                row.triangles,
                row.errors.most,
                row.errors.rms,
                row.seconds,
            );
        }
        out
    }
}
