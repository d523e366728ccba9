//! Files of lit surfaces, with a record of how each was made.

use super::surface::Merged;
use super::{Lit, Still, relightable};
use crate::error::Result;
use crate::export::gltf::{ColourFormat, GltfOptions};
use crate::export::{ExportMesh, Positions, atomic, gltf, ply, png, stl};
use crate::quantity::number;
use crate::relight::{ErrorTerm, TotalError};
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
}

/// JSON has no infinity: it becomes null.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl Lit<'_> {
    /// Writes the mesh as GLB, whole or not at all, and returns its size in metres.
    ///
    /// # Errors
    /// When the transfer of volumes is asked for whose textures differ in layers or bands, as [`gltf::write`], and as
    /// [`atomic::write`].
    pub fn write_gltf(&self, path: impl AsRef<Path>, options: &MeshOptions) -> Result<[f64; 3]> {
        let colour_format = if options.float_colour { ColourFormat::F32 } else { ColourFormat::U16 };
        let provenance = self.record();
        let mut file = GltfOptions { colour_format, scale: options.scale, provenance, ..Default::default() };
        if options.transfer {
            let (texels, session) = (&self.texels, self.texels.surface.session);
            let lighting = texels.lighting;
            let parts = session.members().iter().zip(texels.surface.parts.iter());
            file.scalars = relightable::attributes(parts.map(|(m, part)| (m.store(), &part.isosurface)))?;
            let lit = (session.members()[0].store(), &*texels.luminaires);
            let rotation = lighting.options.rotation_degrees;
            let (light, material, up) = (&lighting.light, &texels.material, session.up());
            let (exposure, lamps) = (self.exposure, lighting.suns.len());
            file.mesh_extras =
                relightable::extras(lit, lighting.probe, light, material, up, rotation, exposure, lamps)?;
        }
        self.with_mesh(options.radiance, |mesh| {
            atomic::write(path, |w| gltf::write(w, mesh, &file))?;
            Ok(gltf::size_in_metres(mesh, options.scale))
        })
    }

    /// Writes the mesh as binary PLY, whole or not at all.
    ///
    /// # Errors
    /// As [`ply::write`] and [`atomic::write`].
    pub fn write_ply(&self, path: impl AsRef<Path>, options: &MeshOptions) -> Result<()> {
        let file = ply::PlyOptions { provenance: self.record(), ..Default::default() };
        self.with_mesh(options.radiance, |mesh| atomic::write(path, |w| ply::write(w, mesh, &file)).map(|_| ()))
    }

    /// Writes its triangles as binary STL, without colours, whole or not at all.
    ///
    /// # Errors
    /// As [`stl::write`] and [`atomic::write`].
    pub fn write_stl(&self, path: impl AsRef<Path>) -> Result<()> {
        self.with_mesh(false, |mesh| atomic::write(path, |w| stl::write(w, mesh)).map(|_| ()))
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

/// The whole error as files and machines get it: root mean squares over the mean radiance.
pub fn total_json(total: &TotalError) -> Value {
    let term = |term: ErrorTerm| json!({ "rms": term.rms, "upper": term.upper });
    json!({
        "rms": total.rms, "percentile_95": total.percentile_95,
        "noise": term(total.noise), "texture": term(total.texture), "truncation": total.truncation.map(term),
        "check_points": total.points,
    })
}
