//! A mesh unwrapped into a square picture of its colours, for readers that drop vertex colours.
//!
//! The surface is cut into charts, each flat enough to be laid into the plane by projection (`charts`); rectangles around them are
//! packed onto shelves (`pack`); every texel takes the colour of the surface at its place (`fill`), and both sides of a seam are made
//! equal (`seams`). The mesh that
//! is shown may be simpler than the one that colours come from: then the picture keeps the shading that its triangles have lost.
//!
//! Written here, because the known unwrappers are C++ without a crate that is kept: no conformal maps, so that a chart is
//! stretched by at most a factor of two, where it stands at 60° to its plane.

mod charts;
mod fill;
mod pack;
mod seams;

use super::gltf::Texture;
use super::simplify::longest_side;
use super::{ExportMesh, Image, Selection, png};
use crate::error::{Error, Result};
use crate::srgb;
use charts::{Chart, cut};
use glam::Vec3;
use pack::{Packing, pack};
use rayon::prelude::*;

/// Sides that a picture may have, in texels.
pub const SIDES: std::ops::RangeInclusive<u32> = 64..=8192;

/// A mesh cut along the seams of its picture.
#[derive(Clone, Debug)]
pub struct Lightmap {
    /// The vertices, those on seams once for each chart.
    pub selection: Selection,
    /// The picture, and where the vertices lie in it.
    pub texture: Texture,
    /// What it is like.
    pub report: LightmapReport,
}

/// A lightmap in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct LightmapReport {
    /// Texels along a side.
    pub side: u32,
    /// Pieces of the surface.
    pub charts: usize,
    /// Share of the picture that the surface covers.
    pub covered: f64,
    /// Root mean square difference between the colour of a vertex and that of the picture at its place, in display signal (sRGB), from
    /// 0 to 1.
    pub colour_rms: f64,
    /// Difference between the two sides of seams, the largest of the three channels: its 99th percentile, in display signal.
    pub seams: f64,
}

/// Unwraps `shown`, and colours it as `original`: the same mesh, or the one that it was simplified from.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`Error::Argument`] for a side out of [`SIDES`] or a mesh without triangles;
/// [`Error::Limit`] where the picture has not enough texels for the charts.
pub fn unwrap(shown: &ExportMesh<'_>, original: &ExportMesh<'_>, side: u32) -> Result<Lightmap> {
    shown.check()?;
    original.check()?;
    if !SIDES.contains(&side) {
        let expected = format!("a side from {} to {} texels", SIDES.start(), SIDES.end());
        return Err(Error::argument("lightmap", side, expected, "1024 suits a mesh of 20,000 triangles"));
    }
    if shown.is_empty() {
        let remedy = "choose another isovalue, or leave out the lightmap";
        return Err(Error::argument("lightmap", "a mesh without triangles", "a surface to unwrap", remedy));
    }
    // Over the longest side: squares of areas stay in range whatever the unit.
    let unit = longest_side(shown);
    let places = |mesh: &ExportMesh<'_>| -> Vec<Vec3> {
        let centre = mesh.centre_in_world();
        let place = |v: usize| (mesh.positions.from_centre(v, centre).as_dvec3() / unit).as_vec3();
        (0..mesh.positions.len()).map(place).collect()
    };
    let positions = places(shown);
    let charts = cut(&positions, shown.triangles);
    let Some(packing) = pack(&charts.iter().map(|chart| chart.size).collect::<Vec<_>>(), side) else {
        return Err(Error::Limit {
            what: format!("a lightmap of {} charts", charts.len()),
            needed: "more texels than it has".into(),
            limit: format!("{side} × {side} texels"),
            remedy: "give a larger --lightmap, or fewer triangles by --lod".into(),
        });
    };
    let of_original = places(original);
    let mut picture = fill::fill(&charts, &packing, (&positions, shown.triangles), (&of_original, original))?;
    let (selection, coordinates) = assemble(&charts, &packing);
    let seams = seams::close(&mut picture, &selection, &coordinates);
    let colour_rms = difference(&picture, &selection, &coordinates, shown.colours);
    let mut bytes = Vec::new();
    png::write(&mut bytes, &picture.image, &png::PngOptions::default())?;
    let report = LightmapReport { side, charts: charts.len(), covered: picture.covered, colour_rms, seams };
    Ok(Lightmap { selection, texture: Texture { coordinates, png: bytes }, report })
}

/// The vertices of all charts, and where they lie in the picture.
fn assemble(charts: &[Chart], packing: &Packing) -> (Selection, Vec<[f32; 2]>) {
    let mut selection = Selection { vertices: Vec::new(), triangles: Vec::new() };
    let mut coordinates = Vec::new();
    for (chart, &origin) in charts.iter().zip(&packing.origins) {
        let first = selection.vertices.len() as u32;
        selection.triangles.extend(chart.corners.iter().map(|t| t.map(|v| first + v)));
        selection.vertices.extend(&chart.vertices);
        coordinates.extend(chart.places.iter().map(|&place| {
            let texels = packing.texels(origin, place);
            (texels / packing.side as f32).to_array().map(|x| x.clamp(0.0, 1.0))
        }));
    }
    (selection, coordinates)
}

/// See [`LightmapReport::colour_rms`].
fn difference(picture: &fill::Picture, selection: &Selection, coordinates: &[[f32; 2]], colours: &[[f32; 3]]) -> f64 {
    let signal = |x: f32| srgb::srgb_from_linear(f64::from(x));
    let squares: Vec<f64> = (selection.vertices.par_iter().zip(coordinates))
        .map(|(&v, &place)| {
            let seen = sample(&picture.image, place);
            let own = colours[v as usize];
            (0..3).map(|c| (signal(seen[c]) - signal(own[c])).powi(2)).sum::<f64>() / 3.0
        })
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// The colour of a square picture at a place in [0, 1], linear between the centres of texels.
fn sample(image: &Image, place: [f32; 2]) -> [f32; 3] {
    seams::sample(image, place.map(|x| image.width() as f32 * x))
}

#[cfg(test)]
mod tests;
