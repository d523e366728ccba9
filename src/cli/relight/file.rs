//! One surface under one light, looked up and written.

use super::Relight;
use super::joint::{Companion, Merged};
use super::report::finite;
use crate::cli::light::Lighting;
use crate::cli::output::{Format, Target};
use crate::cli::scene_light::contracted;
use crate::cli::still::Still;
use crate::cli::surface::Surface;
use crate::cli::{Failure, Outcome, info, relightable, text};
use crate::export::gltf::{ColourFormat, GltfOptions};
use crate::export::{Image, Positions, atomic, gltf, ply, png};
use crate::geom::Up;
use crate::level::{Counts, Pyramid};
use crate::probe::{EnvFrame, Probe};
use crate::relight::{Contracted, Exposure, LookupReport, Material, SurfaceError};
use crate::render::sun_visibility;
use crate::scene::geometry::Geometry;
use crate::scene::{EmissionRule, MaterialRule};
use crate::transfer::store::Store;
use crate::volume::Volume;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// What one file took.
#[derive(Clone, Copy, Default)]
pub(in crate::cli) struct Times {
    pub(super) contract: Duration,
    pub(super) look_up: Duration,
    pub(super) render: Duration,
    pub(super) write: Duration,
}

impl Times {
    /// From the light to the file.
    pub(in crate::cli) fn total(&self) -> Duration {
        self.contract + self.look_up + self.render + self.write
    }
}

/// One file and how it came about.
pub(in crate::cli) struct Written {
    pub(in crate::cli) target: Target,
    pub(in crate::cli) isovalue: f64,
    pub(in crate::cli) env: String,
    pub(in crate::cli) times: Times,
    /// The picture, where the file is one.
    pub(in crate::cli) image: Option<Image>,
    pub(super) report: LookupReport,
    /// Standard error of the radiance at the vertices.
    pub(super) error: SurfaceError,
    /// Its root mean square over the mean radiance.
    pub(in crate::cli) rms_over_mean: f64,
    pub(super) exposure: f32,
    pub(super) negative: u64,
    /// Visibility rays of suns that were split off.
    pub(super) sun_rays: u64,
    /// What was done to the light.
    pub(super) notes: Vec<String>,
    pub(super) remainder: f32,
    pub(super) camera: Counts,
    pub(super) bytes: u64,
    /// What is in the file: vertices and size, or pixels and view.
    pub(super) what: String,
}

/// Root mean square of the standard errors of the vertices over their mean radiance (mean of the channels); 0
/// for a black surface.
fn rms_over_mean(radiance: &[[f32; 3]], errors: &[f32]) -> f64 {
    let count = radiance.len().max(1) as f64;
    let mean = radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * count);
    let square = errors.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / count;
    if mean > 0.0 { square.sqrt() / mean } else { 0.0 }
}

/// What does not change from file to file.
pub(super) struct Context<'a> {
    pub(super) command: &'a Relight,
    pub(super) store: &'a Store,
    pub(super) volume: &'a Volume,
    pub(super) pyramid: &'a Pyramid,
    pub(super) rule: &'a MaterialRule,
    pub(super) emission: &'a EmissionRule,
    pub(super) up: Up,
    /// What to type to bake an isovalue that is missing.
    pub(super) bake_hint: String,
    /// What stands around the volume, where it is known.
    pub(super) geometry: Option<&'a Geometry>,
}

impl Context<'_> {
    pub(super) fn light(
        &self,
        surface: &Surface,
        companions: &[Companion<'_>],
        probe: &Probe,
        target: Target,
    ) -> Outcome<Written> {
        let c = self.command;
        let isovalue = surface.isovalue;
        let lighting = c.light.prepare(probe, self.up, &self.store.layout().layers, c.splits_sun())?;
        let light = &lighting.light;
        let material = Material::new(self.rule.albedo(isovalue), self.emission.at(isovalue))?;
        let mut times = Times::default();
        let start = Instant::now();
        let mut contracted = contracted(self.store, &surface.bricks, &lighting, &material, &c.light.luminaires)?;
        let mut notes = lighting.notes.clone();
        if lighting.certified {
            let clamped = contracted.clamp_negative();
            notes.push(format!(
                "{}: {} of {} texels were below 0 by noise or rounding and are 0 now, {} of the energy",
                probe.name,
                text::count(clamped.texels),
                text::count(clamped.of_texels),
                text::percent(clamped.energy)
            ));
        }
        times.contract = start.elapsed();
        let start = Instant::now();
        let mut lit = contracted.look_up(&surface.mesh.positions_in_grid, &surface.mesh.normals, light, &material);
        let mut sun_rays = 0;
        for sun in &lighting.suns {
            let (positions, normals) = (&surface.mesh.positions_in_grid, &surface.mesh.normals);
            let seen = sun_visibility(self.volume, self.pyramid, isovalue, positions, normals, sun);
            lit.add_sun(&seen.lit, sun.flux, &material);
            sun_rays += seen.counts.rays;
        }
        let mut errors = contracted.look_up_errors(&surface.mesh.positions_in_grid);
        if lit.report.unbaked > 0 {
            return Err(self.unbaked(isovalue, &lit.report));
        }
        // Behind its own: the surfaces of the other volumes.
        for companion in companions {
            let (mesh, of_other) = (&companion.surface.mesh, companion.surface.isovalue);
            let texels = companion.contracted(&lighting, &material, &c.light.luminaires)?;
            let more = texels.look_up(&mesh.positions_in_grid, &mesh.normals, light, &material);
            if more.report.unbaked > 0 {
                return Err(self.unbaked(of_other, &more.report));
            }
            lit.report += more.report;
            lit.radiance.extend(more.radiance);
            errors.extend(texels.look_up_errors(&mesh.positions_in_grid));
        }
        times.look_up = start.elapsed();
        let exposure = c.material.exposure.factor(&lit.radiance);
        let negative = || lit.radiance.iter().filter(|v| v.iter().any(|&x| x < 0.0)).count() as u64;
        let (error, (rms_over_mean, negative)) = rayon::join(
            || SurfaceError::new(&lit.radiance, &errors),
            || (rms_over_mean(&lit.radiance, &errors), negative()),
        );
        let mut written = Written {
            target,
            isovalue,
            env: probe.name.clone(),
            times,
            image: None,
            report: lit.report,
            error,
            rms_over_mean,
            exposure,
            negative,
            remainder: contracted.emission_remainder,
            camera: Counts::default(),
            sun_rays,
            notes,
            bytes: 0,
            what: String::new(),
        };
        let record = self.record(probe, &material, &written);
        let lit_radiance = lit.radiance;
        match written.target.format {
            Format::Png => {
                let lit = (probe, &lighting, &material);
                self.write_picture((surface, companions), &contracted, lit, record, &mut written)?;
            }
            _ => {
                let lit = (probe, &lighting, &material);
                self.write_mesh((surface, companions), lit, (&lit_radiance, &errors), record, &mut written)?;
            }
        }
        if written.target.format != Format::Png {
            written.bytes = std::fs::metadata(&written.target.path).map_or(0, |m| m.len());
        }
        Ok(written)
    }

    fn write_mesh(
        &self,
        (surface, companions): (&Surface, &[Companion<'_>]),
        (probe, lighting, material): (&Probe, &Lighting, &Material),
        (radiance, errors): (&[[f32; 3]], &[f32]),
        record: Value,
        written: &mut Written,
    ) -> Outcome {
        let args = &self.command.mesh;
        let start = Instant::now();
        let colours = Exposure::apply(written.exposure, radiance);
        let name = format!("{} {}", self.volume.name, text::number(surface.isovalue, 8));
        let merged;
        let mut mesh =
            surface.export(&name, self.volume, self.up, &colours, args.radiance.then_some((radiance, errors)));
        if !companions.is_empty() {
            merged = Merged::new(self.volume, surface, companions);
            mesh.positions = Positions::FromCentre(&merged.positions);
            (mesh.normals_in_world, mesh.triangles) = (&merged.normals, &merged.triangles);
            mesh.box_in_world = merged.bounds;
        }
        let path = &written.target.path;
        written.what = format!("{} vertices", text::count(mesh.positions.len() as u64));
        if written.target.format == Format::Ply {
            let options = ply::PlyOptions { provenance: record, ..Default::default() };
            atomic::write(path, |w| ply::write(w, &mesh, &options))?;
        } else {
            let colour_format = if args.float_color { ColourFormat::F32 } else { ColourFormat::U16 };
            let mut options =
                GltfOptions { colour_format, scale: args.scale, provenance: record, ..Default::default() };
            if args.transfer {
                let (lit, rotation) = ((self.store, &self.command.light.luminaires[..]), self.command.light.env_rotate);
                let others = companions.iter().map(|c| (&c.member.store, &c.surface.mesh));
                options.scalars = relightable::attributes(std::iter::once((self.store, &surface.mesh)).chain(others))?;
                options.mesh_extras =
                    relightable::extras(lit, probe, &lighting.light, material, self.up, rotation, written.exposure)?;
            }
            atomic::write(path, |w| gltf::write(w, &mesh, &options))?;
            let [x, y, z] = gltf::size_in_metres(&mesh, args.scale).map(|side| text::number(side, 3));
            written.what += &format!(", {x} × {y} × {z} m");
        }
        written.times.write = start.elapsed();
        Ok(())
    }

    fn write_picture(
        &self,
        (surface, companions): (&Surface, &[Companion<'_>]),
        contracted: &Contracted,
        (probe, lighting, material): (&Probe, &Lighting, &Material),
        record: Value,
        written: &mut Written,
    ) -> Outcome {
        let args = &self.command.picture;
        let still = Still {
            args,
            light: &self.command.light,
            split: self.command.splits_sun(),
            store: self.store,
            volume: self.volume,
            pyramid: self.pyramid,
            surface,
            up: self.up,
            probe,
            material,
            exposure: written.exposure,
            geometry: self.geometry,
            wall_rays: self.command.transfer.rays.unwrap_or(64),
            companions,
        };
        let has_walls =
            self.store.identity().scene.as_ref().is_some_and(|s| s.coupling.is_none() || !s.luminaires.is_empty());
        if self.geometry.is_none() && has_walls {
            let note = "the store does not hold the walls: relight the scene file to see them in pictures";
            written.notes.push(note.into());
        }
        let options = png::PngOptions {
            alpha: args.background.is_transparent(),
            software: Some(concat!("isolume ", env!("CARGO_PKG_VERSION")).into()),
            description: Some(record.to_string()),
        };
        let (width, height) = args.seen.size;
        let frames = if args.frames() > 1 { format!("{} frames of ", args.frames()) } else { String::new() };
        written.what = format!("{frames}{width} × {height}, {}", args.seen.view.describe(self.up));
        for index in 0..args.frames() {
            let start = Instant::now();
            let frame = still.frame(index, contracted, lighting)?;
            if frame.report.unbaked > 0 {
                return Err(self.unbaked(surface.isovalue, &frame.report));
            }
            written.report += frame.report;
            written.camera += frame.counts;
            written.times.render += start.elapsed();
            let start = Instant::now();
            let path = args.path_of_frame(&written.target.path, index);
            atomic::write(&path, |w| png::write(w, &frame.image, &options))?;
            written.bytes += std::fs::metadata(&path).map_or(0, |m| m.len());
            written.image = Some(frame.image);
            written.times.write += start.elapsed();
        }
        Ok(())
    }

    /// The error for a surface whose texels the store does not have.
    fn unbaked(&self, isovalue: f64, report: &LookupReport) -> Failure {
        let held = self.store.holdings().map_or("unknown".into(), |h| info::isovalues_text(&h));
        let value = text::number(isovalue, 8);
        let source = self.store.provenance()["input"].as_str().unwrap_or("VOLUME").to_string();
        Failure::Message(format!(
            "{}: {} of {} lookups at isovalue {value} meet texels that were never baked; \
             the store holds these isovalues: {held}; \
             bake the missing ones into it: isolume bake {source} --isovalues {value} -o {} \
             (with the options of the first bake)",
            self.bake_hint,
            text::count(report.unbaked),
            text::count(report.lookups),
            self.store.path().display(),
        ))
    }

    /// How the file was made; nothing in it depends on the machine, the threads or the clock.
    fn record(&self, probe: &Probe, material: &Material, written: &Written) -> Value {
        let c = self.command;
        json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "volume": self.volume.name,
            "store": self.store.identity().hash(),
            "isovalue": written.isovalue,
            "solid": self.store.identity().solid,
            "environment": probe.name,
            "env_rotate_degrees": c.light.env_rotate, "env_frame": EnvFrame::from(c.light.env_frame).name(),
            "bands": c.light.bands.map_or(self.store.layout().layers.max_bands(), usize::from),
            "window": c.light.window_name(),
            "albedo": material.albedo,
            "emission": material.emission,
            "exposure_ev": f64::from(written.exposure).log2(),
            "error": { "rms_over_mean": written.rms_over_mean, "median_relative": finite(written.error.median) },
        })
    }
}
