//! One surface under one light, looked up and written.

use super::{Relight, report};
use crate::cli::light::{by_option, sentence};
use crate::cli::output::{Format, Target};
use crate::cli::{Failure, Outcome, info, text};
use crate::error::Error;
use crate::level::Counts;
use crate::probe::Probe;
use crate::relight::{LookupReport, Material, SurfaceError, TotalError};
use crate::scene::{EmissionRule, MaterialRule};
use crate::session::{Lit, LitTexels, MeshFile, Session, Surface, with_medium_albedo};
use crate::transfer::store::{Holdings, Store};
use std::time::{Duration, Instant};

/// What one file took.
#[derive(Clone, Copy, Default)]
pub(super) struct Times {
    pub(super) contract: Duration,
    pub(super) look_up: Duration,
    pub(super) render: Duration,
    pub(super) write: Duration,
}

impl Times {
    /// From the light to the file.
    pub(super) fn total(&self) -> Duration {
        self.contract + self.look_up + self.render + self.write
    }
}

/// One file and how it came about.
pub(super) struct Written {
    pub(super) target: Target,
    pub(super) isovalue: f64,
    pub(super) env: String,
    pub(super) times: Times,
    pub(super) report: LookupReport,
    /// Standard error of the radiance at the vertices.
    pub(super) error: SurfaceError,
    /// Its root mean square over the mean radiance.
    pub(super) rms_over_mean: f64,
    /// Of a free albedo of the medium of a translucent solid.
    pub(super) node_error: Option<f64>,
    /// How far the colours are from exact light transport, where check points say it.
    pub(super) total: Option<TotalError>,
    /// Whether the vertices have transfer of their own; else it comes from the texture.
    pub(super) at_vertices: bool,
    /// In stops.
    pub(super) exposure_ev: f64,
    pub(super) negative: u64,
    /// Visibility rays of suns that were split off.
    pub(super) sun_rays: u64,
    /// What was done to the light.
    pub(super) notes: Vec<String>,
    pub(super) remainder: f32,
    pub(super) camera: Counts,
    pub(super) bytes: u64,
    /// Of a mesh file.
    pub(super) mesh: Option<MeshFile>,
    /// What is in the file: vertices and size, or pixels and view.
    pub(super) what: String,
}

/// What does not change from file to file.
pub(super) struct Context<'a> {
    pub(super) command: &'a Relight,
    pub(super) session: &'a Session<'a>,
    pub(super) rule: &'a MaterialRule,
    pub(super) emission: &'a EmissionRule,
}

impl Context<'_> {
    pub(super) fn light(&self, surface: &Surface<'_>, probe: &Probe, target: Target) -> Outcome<Written> {
        let c = self.command;
        let isovalue = surface.parts()[0].isosurface().isovalue();
        let in_scene = self.session.members()[0].store().identity().scene.is_some();
        let lighting = self.session.light(probe, &c.light_options(in_scene)).map_err(by_option)?;
        let mut material = Material::new(self.rule.albedo(isovalue), self.emission.at(isovalue))?;
        if let Some(albedo) = c.material.medium_albedo {
            material = with_medium_albedo(self.session.members()[0].store(), &material, albedo.0)?;
        }
        let mut times = Times::default();
        let start = Instant::now();
        let texels = surface.contract(&lighting, &material, &c.light.luminaires).map_err(by_option)?;
        times.contract = start.elapsed();
        let start = Instant::now();
        let lit = texels.look_up(c.material.exposure).map_err(|e| self.explained(e))?;
        times.look_up = start.elapsed();
        let lit = lit.with_total_error()?;
        let node_error = surface.node_error(&lighting, &c.light.luminaires)?;
        let mut written = Written {
            target,
            isovalue,
            env: probe.name.clone(),
            times,
            report: *lit.report(),
            error: lit.relative_error(),
            rms_over_mean: lit.rms_over_mean(),
            node_error,
            total: lit.total_error(),
            at_vertices: surface.parts()[0].isosurface().transfer().is_some(),
            exposure_ev: lit.exposure_in_stops(),
            negative: lit.negative_vertices(),
            remainder: lit.emission_remainder(),
            camera: Counts::default(),
            sun_rays: lit.sun_rays(),
            notes: lit.notes().iter().filter(|note| c.tells(note)).map(|note| sentence(&probe.name, note)).collect(),
            bytes: 0,
            mesh: None,
            what: String::new(),
        };
        match written.target.format {
            Format::Png => self.write_pictures(surface, &lit, probe, &mut written)?,
            _ => self.write_mesh(&lit, &mut written)?,
        }
        Ok(written)
    }

    fn write_mesh(&self, lit: &Lit<'_>, written: &mut Written) -> Outcome {
        let options = self.command.mesh.options(written.target.lod);
        let start = Instant::now();
        let path = &written.target.path;
        let made = match written.target.format {
            Format::Ply => lit.write_ply(path, &options)?,
            Format::Stl => lit.write_stl(path, &options)?,
            Format::Usdz => lit.write_usdz(path, &options)?,
            _ => lit.write_gltf(path, &options).map_err(by_option)?,
        };
        written.what = report::mesh(&made, written.target.format);
        written.mesh = Some(made);
        written.times.write = start.elapsed();
        written.bytes = std::fs::metadata(path).map_or(0, |m| m.len());
        Ok(())
    }

    fn write_pictures(&self, surface: &Surface<'_>, lit: &Lit<'_>, probe: &Probe, written: &mut Written) -> Outcome {
        let (c, args) = (self.command, &self.command.picture);
        let (up, wall_paths) = (self.session.up(), c.transfer.rays.unwrap_or(64));
        if self.session.lacks_walls() {
            let note = "the store does not hold the walls: relight the scene file to see them in pictures";
            written.notes.push(note.into());
        }
        let (width, height) = args.seen.size;
        let frames = if args.frames() > 1 { format!("{} frames of ", args.frames()) } else { String::new() };
        written.what = format!("{frames}{width} × {height}, {}", args.seen.view.describe(up));
        for index in 0..args.frames() {
            let start = Instant::now();
            let turned = args.degrees_of_frame(index);
            let options = args.options(up, turned, wall_paths);
            let picture = |texels: &LitTexels<'_>| texels.picture(lit.exposure(), &options);
            let still = if args.turns_light() && index > 0 {
                let mut light = lit.texels().lighting().options().clone();
                light.rotation_degrees += turned;
                let lighting = self.session.light(probe, &light)?;
                picture(&surface.contract(&lighting, lit.texels().material(), &c.light.luminaires)?)
            } else {
                picture(lit.texels())
            };
            let still = still.map_err(|e| self.explained(e))?;
            written.report += still.report;
            written.camera += still.counts;
            written.times.render += start.elapsed();
            let start = Instant::now();
            let path = args.path_of_frame(&written.target.path, index);
            lit.write_png(&path, &still)?;
            written.bytes += std::fs::metadata(&path).map_or(0, |m| m.len());
            written.times.write += start.elapsed();
        }
        Ok(())
    }

    /// The error for a surface whose texels the store does not have says what to type; others name options.
    fn explained(&self, error: Error) -> Failure {
        let Error::Unbaked { path, isovalue, unbaked, lookups, holds_all, isovalues, .. } = error else {
            return by_option(error).into();
        };
        let held = info::isovalues_text(&Holdings { all: holds_all, isovalues, ..Holdings::default() });
        let value = text::number(isovalue, 8);
        let source = source_of(self.session.members()[0].store());
        Failure::Message(format!(
            "{}: {} of {} lookups at isovalue {value} meet texels that were never baked; \
             the store holds these isovalues: {held}; \
             bake the missing ones into it: isolume bake {source} --isovalues {value} -o {} \
             (with the options of the first bake)",
            self.command.input,
            text::count(unbaked),
            text::count(lookups),
            path.display(),
        ))
    }
}

/// What a store was baked from, as its user named it.
fn source_of(store: &Store) -> &str {
    store.provenance()["input"].as_str().unwrap_or("VOLUME")
}
