//! Files of lit surfaces, with a record of how each was made.

use super::surface::Merged;
use super::{Lit, Still, relightable};
use crate::error::{Error, Result};
use crate::export::gltf::{ColourFormat, GltfOptions};
use crate::export::lightmap::{Lightmap, LightmapReport, unwrap};
use crate::export::simplify::{Lod, SimplificationError, Simplified, simplify};
use crate::export::usdz::{self, UsdzOptions};
use crate::export::{ExportMesh, Positions, atomic, gltf, ply, png, stl};
use crate::quantity::number;
use crate::relight::{ErrorTerm, Light, TotalError};
use serde_json::{Value, json};
use std::path::Path;

/// What a mesh file holds besides positions, normals and colours.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct MeshOptions {
    /// The true linear radiance as attribute `_RADIANCE`, and its standard error as `_STDERR`.
    pub radiance: bool,
    /// Colours as 32-bit floats; glTF alone.
    pub float_colour: bool,
    /// The transfer of each vertex, for relighting elsewhere; glTF alone.
    pub transfer: bool,
    /// glTF units (metres) to a world unit; `None` leaves it to [`gltf::scale`].
    pub scale: Option<f64>,
    /// How many triangles are left; `None` leaves all.
    pub lod: Option<Lod>,
    /// A small file for the web ([`GltfOptions::for_web`]); glTF alone.
    pub for_web: bool,
    /// The colours as a square picture with so many texels along its side, in the place of colours at vertices; glTF, and USDZ,
    /// which has [`USDZ_SIDE`] without it.
    pub lightmap: Option<u32>,
}

/// Texels along the side of the picture of a USDZ file, unless another number is given.
pub const USDZ_SIDE: u32 = 2048;

/// What is in a file of a mesh, and what it took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct MeshFile {
    /// Vertices in it.
    pub vertices: usize,
    /// Triangles in it.
    pub triangles: usize,
    /// Triangles of the isosurface.
    pub triangles_of_isosurface: usize,
    /// Sides along X, Y and Z of glTF; 0 where a file has no metres.
    pub size_in_metres: [f64; 3],
    /// What leaving out triangles cost.
    pub simplification: Option<SimplificationError>,
    /// How far rounded positions are off at most, in world units.
    pub position_error: Option<f64>,
    /// What the picture of the colours is like.
    pub lightmap: Option<LightmapReport>,
}

/// A mesh as it is written, and what it took.
struct Shown<'a> {
    mesh: ExportMesh<'a>,
    simplified: Option<&'a Simplified>,
    lightmap: Option<&'a Lightmap>,
    // How it was made.
    record: Value,
}

/// JSON has no infinity: it becomes null.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl Lit<'_> {
    /// Writes the mesh as GLB, whole or not at all.
    ///
    /// # Errors
    /// When the transfer of volumes is asked for whose textures differ in layers or bands, as [`gltf::write`], as [`simplify`], and
    /// as [`atomic::write`].
    pub fn write_gltf(&self, path: impl AsRef<Path>, options: &MeshOptions) -> Result<MeshFile> {
        let colour_format = if options.float_colour { ColourFormat::F32 } else { ColourFormat::U16 };
        let for_web = options.for_web;
        let mut file = GltfOptions { colour_format, scale: options.scale, for_web, ..Default::default() };
        if options.transfer {
            let (texels, session) = (&self.texels, self.texels.surface.session);
            let lighting = texels.lighting;
            let parts = session.members().iter().zip(texels.surface.parts.iter());
            file.scalars = relightable::attributes(parts.map(|(m, part)| (m.store(), &part.isosurface)))?;
            let lit = (session.members()[0].store(), &*texels.luminaires);
            let rotation = lighting.options.rotation_degrees;
            let (material, up) = (&texels.material, session.up());
            // Of lamps that are lit apart the file has nothing but the light.
            let whole = lighting.whole(up, lighting.light.bands(0))?;
            let light = match lighting.suns.is_empty() {
                true => &lighting.light,
                false => &Light::from_channels(&whole)?,
            };
            let (exposure, lamps) = (self.exposure, lighting.suns.len());
            file.mesh_extras =
                relightable::extras(lit, lighting.probe, light, material, up, rotation, exposure, lamps)?;
        }
        // A surface without triangles is a file without a mesh, and so without a picture.
        let has_triangles = self.texels.surface.parts.iter().any(|part| !part.isosurface.mesh().triangles.is_empty());
        self.write_mesh(options, options.lightmap.filter(|_| has_triangles), |shown, made| {
            let simplified = shown.simplified.map(|simplified| &simplified.selection);
            for selection in simplified.into_iter().chain(shown.lightmap.map(|lightmap| &lightmap.selection)) {
                file.scalars = selection.of_scalars(&file.scalars);
            }
            made.size_in_metres = gltf::size_in_metres(&shown.mesh, options.scale);
            made.position_error = for_web.then(|| gltf::position_error(&shown.mesh));
            file.texture = shown.lightmap.map(|lightmap| lightmap.texture.clone());
            file.provenance = shown.record;
            atomic::write(path, |w| gltf::write(w, &shown.mesh, &file))
        })
    }

    /// Writes the mesh as USDZ, its colours as a picture, whole or not at all.
    ///
    /// # Errors
    /// As [`usdz::write`], [`simplify`], [`unwrap`] and [`atomic::write`].
    pub fn write_usdz(&self, path: impl AsRef<Path>, options: &MeshOptions) -> Result<MeshFile> {
        self.write_mesh(options, Some(options.lightmap.unwrap_or(USDZ_SIDE)), |shown, made| {
            made.size_in_metres = gltf::size_in_metres(&shown.mesh, options.scale);
            let texture = shown.lightmap.map(|lightmap| lightmap.texture.clone());
            let texture = texture.ok_or_else(|| {
                Error::argument("USDZ", "no picture", "one of the colours", "report this: it should not happen")
            })?;
            let file = UsdzOptions { texture, scale: options.scale, provenance: shown.record };
            atomic::write(path, |w| usdz::write(w, &shown.mesh, &file))
        })
    }

    /// Writes the mesh as binary PLY, whole or not at all.
    ///
    /// # Errors
    /// As [`ply::write`], [`simplify`] and [`atomic::write`].
    pub fn write_ply(&self, path: impl AsRef<Path>, options: &MeshOptions) -> Result<MeshFile> {
        self.write_mesh(options, None, |shown, _| {
            let file = ply::PlyOptions { provenance: shown.record, ..Default::default() };
            atomic::write(path, |w| ply::write(w, &shown.mesh, &file)).map(|_| ())
        })
    }

    /// Writes its triangles as binary STL, without colours, whole or not at all.
    ///
    /// # Errors
    /// As [`stl::write`], [`simplify`] and [`atomic::write`].
    pub fn write_stl(&self, path: impl AsRef<Path>, options: &MeshOptions) -> Result<MeshFile> {
        let options = MeshOptions { radiance: false, ..options.clone() };
        self.write_mesh(&options, None, |shown, _| atomic::write(path, |w| stl::write(w, &shown.mesh)).map(|_| ()))
    }

    /// Hands the mesh to a writer: simplified where that was asked for, and with a picture of so many texels a side.
    fn write_mesh(
        &self,
        options: &MeshOptions,
        side: Option<u32>,
        write: impl FnOnce(Shown<'_>, &mut MeshFile) -> Result<()>,
    ) -> Result<MeshFile> {
        self.with_mesh(options.radiance, |original| {
            let mut record = self.record();
            let mut made = MeshFile { triangles_of_isosurface: original.triangles.len(), ..MeshFile::default() };
            let simplified = options.lod.map(|lod| simplify(original, lod)).transpose()?;
            let attributes = simplified.as_ref().map(|simplified| simplified.selection.attributes(original));
            let mesh = attributes.as_ref().map_or(*original, |attributes| attributes.mesh(original));
            if let Some(Simplified { error, .. }) = simplified {
                record["simplified"] = simplified_json(&error);
                record["simplified"]["triangles_of_isosurface"] = json!(made.triangles_of_isosurface);
                made.simplification = Some(error);
            }
            let lightmap = side.map(|side| unwrap(&mesh, original, side)).transpose()?;
            let attributes = lightmap.as_ref().map(|lightmap| lightmap.selection.attributes(&mesh));
            let mesh = attributes.as_ref().map_or(mesh, |attributes| attributes.mesh(&mesh));
            if let Some(Lightmap { report, .. }) = lightmap {
                record["lightmap"] = lightmap_json(&report);
                made.lightmap = Some(report);
            }
            (made.vertices, made.triangles) = (mesh.positions.len(), mesh.triangles.len());
            let (simplified, lightmap) = (simplified.as_ref(), lightmap.as_ref());
            write(Shown { mesh, simplified, lightmap, record }, &mut made)?;
            Ok(made)
        })
    }

    /// Writes a picture of it as PNG, whole or not at all.
    ///
    /// # Errors
    /// As [`png::write`] and [`atomic::write`].
    pub fn write_png(&self, path: impl AsRef<Path>, still: &Still) -> Result<()> {
        let options = self.png_options(still);
        atomic::write(path, |w| png::write(w, &still.image, &options)).map(|_| ())
    }

    /// The bytes of the file that [`Lit::write_png`] writes.
    ///
    /// # Errors
    /// As [`png::write`].
    pub fn png(&self, still: &Still) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        png::write(&mut bytes, &still.image, &self.png_options(still))?;
        Ok(bytes)
    }

    fn png_options(&self, still: &Still) -> png::PngOptions {
        png::PngOptions {
            alpha: still.is_transparent,
            software: Some(concat!("isolume ", env!("CARGO_PKG_VERSION")).into()),
            description: Some(self.record().to_string()),
        }
    }

    /// The mesh as the writers take it: those of all volumes as one.
    fn with_mesh<T>(&self, radiance: bool, use_it: impl FnOnce(&ExportMesh<'_>) -> Result<T>) -> Result<T> {
        let surface = self.texels.surface;
        let (first, session) = (&surface.parts[0].isosurface, surface.session);
        let volume = session.members()[0].volume();
        let colours = self.colours();
        let name = format!("{} {}", volume.name, number(first.isovalue(), 8));
        let radiance = radiance.then_some((&*self.radiance, &*self.errors));
        let mut mesh = first.export(&name, volume, session.up(), &colours, radiance);
        let merged;
        if surface.parts.len() > 1 {
            merged = Merged::new(surface);
            mesh.positions = Positions::FromCentre(&merged.positions);
            (mesh.normals_in_world, mesh.triangles) = (&merged.normals, &merged.triangles);
            mesh.box_in_world = merged.bounds;
        }
        use_it(&mesh)
    }

    /// How it was made; nothing in it depends on the machine, the threads or the clock.
    pub fn record(&self) -> Value {
        let texels = &self.texels;
        let (surface, lighting) = (texels.surface, texels.lighting);
        let (member, options) = (&surface.session.members()[0], &lighting.options);
        let identity = member.store().identity();
        let mut record = json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "volume": member.volume().name,
            "store": identity.hash(),
            "isovalue": surface.parts[0].isosurface.isovalue(),
            "solid": identity.solid,
            "environment": lighting.probe.name,
            "env_rotate_degrees": options.rotation_degrees, "env_frame": options.frame.name(),
            "bands": options.bands.unwrap_or(member.store().layout().layers.max_bands()),
            "window": options.window.name(), "lamps_lit_apart": lighting.suns.len(),
            "albedo": texels.material.albedo,
            "emission": texels.material.emission,
            "exposure_ev": self.exposure_in_stops(),
            "error": {
                "rms_over_mean": self.rms_over_mean(), "median_relative": finite(self.relative_error().median),
            },
        });
        if let Some(scene) = &identity.scene
            && let Some(body) = &scene.body
        {
            record["translucent"] = json!({ "index": body.index, "albedo_nodes": body.nodes });
        }
        if surface.session.geometry().is_some_and(|geometry| !geometry.media().is_empty()) {
            record["media"] = json!("radiance at the surface: the media between it and an eye are in pictures alone");
        }
        if let Some(total) = self.total {
            record["total_error"] = total_json(&total);
        }
        record
    }
}

/// What leaving out triangles cost, as files and machines get it: distances in world units.
pub fn simplified_json(error: &SimplificationError) -> Value {
    json!({
        "largest_distance": error.largest, "rms_distance": error.rms, "largest_over_longest_side": error.relative,
        "colour_rms_srgb": error.colour_rms,
        "pieces_left_out": error.pieces_left_out, "largest_piece_left_out": error.largest_piece_left_out,
    })
}

/// A picture of the colours, as files and machines get it.
pub fn lightmap_json(report: &LightmapReport) -> Value {
    json!({
        "side": report.side, "charts": report.charts, "covered": report.covered, "colour_rms_srgb": report.colour_rms,
        "seams_99_srgb": report.seams,
    })
}

/// The whole error as files and machines get it: root mean squares over the mean radiance.
pub fn total_json(total: &TotalError) -> Value {
    let term = |term: ErrorTerm| json!({ "rms": term.rms, "upper": term.upper });
    json!({
        "rms": total.rms, "percentile_95": total.percentile_95,
        "noise": term(total.noise), "texture": term(total.texture), "truncation": total.truncation.map(term),
        "check_points": total.points,
    })
}
