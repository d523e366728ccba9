//! One surface under one light, looked up and written into one file: a mesh, or pictures.

use super::{
    LightNote, LightOptions, Lit, LitTexels, LuminaireFactor, MeshFile, MeshOptions, PictureOptions, Session, Surface,
    lightmap_json, simplified_json, total_json, with_medium_albedo,
};
use crate::error::{Error, Result};
use crate::export::target::{Format, Target};
use crate::file::size_on_disk;
use crate::level::Counts;
use crate::probe::Probe;
use crate::relight::{Exposure, LookupReport, Material, SurfaceError, TotalError};
use crate::scene::{EmissionRule, MaterialRule};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Stands for the number of a turntable's picture in the name of a file.
pub const FRAME: &str = "{frame}";

/// What does not change from file to file.
pub struct FileOptions<'a> {
    /// How environments light.
    pub light: LightOptions,
    /// Albedo over the isovalue.
    pub albedo: &'a MaterialRule,
    /// Emission over the isovalue.
    pub emission: &'a EmissionRule,
    /// Albedo of the medium of a translucent solid.
    pub medium_albedo: Option<[f32; 3]>,
    /// Factors on luminaires.
    pub luminaires: &'a [LuminaireFactor],
    /// From radiance to colour.
    pub exposure: Exposure,
    /// How meshes are written.
    pub mesh: MeshOptions,
    /// How pictures are made.
    pub picture: PictureOptions,
    /// The turntable of pictures, if they are of one.
    pub turntable: Option<Turntable>,
    /// Whether notes that no sun was split off are wanted.
    pub tells_no_sun: bool,
}

/// Pictures of a full turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turntable {
    /// How many.
    pub frames: u32,
    /// Whether the light turns, and not the view.
    pub turns_light: bool,
}

impl Turntable {
    /// The output as a pattern: into a directory, names in it.
    ///
    /// # Errors
    /// When the names of a turntable's pictures would be the same.
    pub fn pattern(output: &Path) -> Result<PathBuf> {
        let text = output.to_string_lossy();
        if text.contains(FRAME) {
            return Ok(output.into());
        }
        if output.is_dir() || text.ends_with(['/', '\\']) {
            return Ok(output.join(format!("{{isovalue}}-{{env}}-{FRAME}.png")));
        }
        let expected = format!("a directory, or {FRAME} in the name of a .png");
        let remedy = "write for example -o turn/ or -o turn-{frame}.png";
        Err(Error::argument("output", output.display(), expected, remedy))
    }

    /// How far it is turned in a picture, in degrees.
    fn degrees(self, frame: u32) -> f64 {
        360.0 * f64::from(frame) / f64::from(self.frames)
    }

    /// The file of one picture.
    fn path(self, path: &Path, frame: u32) -> PathBuf {
        let digits = (self.frames - 1).to_string().len();
        path.to_string_lossy().replace(FRAME, &format!("{frame:0digits$}")).into()
    }
}

/// Seconds that a file took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FileTimes {
    /// Multiplying transfer and light.
    pub contract: f64,
    /// Looking up the vertices.
    pub look_up: f64,
    /// Making pictures.
    pub render: f64,
    /// Writing.
    pub write: f64,
}

impl FileTimes {
    /// From the light to the file.
    pub fn total(&self) -> f64 {
        self.contract + self.look_up + self.render + self.write
    }
}

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// A mesh.
    Mesh(MeshFile),
    /// Pictures.
    Pictures,
}

/// One file and how it came about.
#[derive(Clone, Debug)]
pub struct WrittenFile {
    /// Where it is, and of which format.
    pub target: Target,
    /// Of the first volume, in its values.
    pub isovalue: f64,
    /// The environment.
    pub env: String,
    /// What it took.
    pub times: FileTimes,
    /// How the lookups went.
    pub report: LookupReport,
    /// Standard error of the radiance at the vertices.
    pub error: SurfaceError,
    /// Its root mean square over the mean radiance.
    pub rms_over_mean: f64,
    /// Of a free albedo of the medium of a translucent solid.
    pub node_error: Option<f64>,
    /// How far the colours are from exact light transport, where check points say it.
    pub total: Option<TotalError>,
    /// Whether the vertices have transfer of their own; else it comes from the texture.
    pub at_vertices: bool,
    /// In stops.
    pub exposure_ev: f64,
    /// Vertices with a channel below 0.
    pub negative: u64,
    /// Rays of suns that were split off: of visibility, and those that find what the surface reflects of them.
    pub sun_rays: u64,
    /// What was done to the light.
    pub notes: Vec<String>,
    /// Largest part of the emission that is left out for each further bounce.
    pub remainder: f32,
    /// Rays of the camera.
    pub camera: Counts,
    /// Bytes of the file, or of all pictures.
    pub bytes: u64,
    /// What is in it.
    pub content: Content,
}

impl Session<'_> {
    /// Lights a surface by an environment, once, and writes it into files; `seconds` is the clock. What lighting took stands with the
    /// first.
    ///
    /// # Errors
    /// As [`Session::light`], [`Surface::contract`], [`LitTexels::look_up`] and the writers.
    #[doc(hidden)]
    pub fn write_files(
        &self,
        surface: &Surface<'_>,
        probe: &Probe,
        targets: Vec<Target>,
        options: &FileOptions<'_>,
        seconds: &dyn Fn() -> f64,
    ) -> Result<Vec<WrittenFile>> {
        let isovalue = surface.parts()[0].isosurface().isovalue();
        let lighting = self.light(probe, &options.light)?;
        let mut material = Material::new(options.albedo.albedo(isovalue), options.emission.at(isovalue))?;
        if let Some(albedo) = options.medium_albedo {
            material = with_medium_albedo(self.members()[0].store(), &material, albedo)?;
        }
        let mut times = FileTimes::default();
        let start = seconds();
        let texels = surface.contract(&lighting, &material, options.luminaires)?;
        times.contract = seconds() - start;
        let start = seconds();
        let lit = texels.look_up(options.exposure)?;
        times.look_up = seconds() - start;
        let lit = lit.with_total_error()?;
        let told = |note: &&LightNote| options.tells_no_sun || !matches!(note, LightNote::NoSun(_));
        let node_error = surface.node_error(&lighting, options.luminaires)?;
        let of_file = |(i, target): (usize, Target)| WrittenFile {
            isovalue,
            env: probe.name.clone(),
            times: if i == 0 { times } else { FileTimes::default() },
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
            sun_rays: if i == 0 { lit.sun_rays() } else { 0 },
            notes: lit.notes().iter().filter(told).map(|note| note.sentence(&probe.name)).collect(),
            bytes: 0,
            content: Content::Pictures,
            target,
        };
        let mut files: Vec<WrittenFile> = targets.into_iter().enumerate().map(of_file).collect();
        for written in &mut files {
            match written.target.format {
                Format::Png => self.write_pictures(surface, &lit, probe, written, options, seconds)?,
                _ => write_mesh(&lit, written, options, seconds)?,
            }
        }
        Ok(files)
    }

    fn write_pictures(
        &self,
        surface: &Surface<'_>,
        lit: &Lit<'_>,
        probe: &Probe,
        written: &mut WrittenFile,
        options: &FileOptions<'_>,
        seconds: &dyn Fn() -> f64,
    ) -> Result<()> {
        if self.lacks_walls() {
            let note = "the store does not hold the walls: relight the scene file to see them in pictures";
            written.notes.push(note.into());
        }
        for index in 0..options.turntable.map_or(1, |table| table.frames) {
            let start = seconds();
            let turned = options.turntable.map_or(0.0, |table| table.degrees(index));
            let turns_light = options.turntable.is_some_and(|table| table.turns_light);
            let mut of_frame = options.picture.clone();
            if !turns_light {
                of_frame.view.azimuth += turned;
            }
            let picture = |texels: &LitTexels<'_>| texels.picture(lit.exposure(), &of_frame);
            let still = if turns_light && index > 0 {
                let mut light = lit.texels().lighting().options().clone();
                light.rotation_degrees += turned;
                let lighting = self.light(probe, &light)?;
                picture(&surface.contract(&lighting, lit.texels().material(), options.luminaires)?)
            } else {
                picture(lit.texels())
            }?;
            written.report += still.report;
            written.camera += still.counts;
            written.times.render += seconds() - start;
            let start = seconds();
            let path = &written.target.path;
            let path = options.turntable.map_or_else(|| path.clone(), |table| table.path(path, index));
            lit.write_png(&path, &still)?;
            written.bytes += size_on_disk(&path);
            written.times.write += seconds() - start;
        }
        Ok(())
    }
}

fn write_mesh(
    lit: &Lit<'_>,
    written: &mut WrittenFile,
    options: &FileOptions<'_>,
    seconds: &dyn Fn() -> f64,
) -> Result<()> {
    let start = seconds();
    let path = &written.target.path;
    let mesh = MeshOptions { lod: written.target.lod, ..options.mesh.clone() };
    written.content = Content::Mesh(match written.target.format {
        Format::Ply => lit.write_ply(path, &mesh)?,
        Format::Stl => lit.write_stl(path, &mesh)?,
        Format::Usdz => lit.write_usdz(path, &mesh)?,
        _ => lit.write_gltf(path, &mesh)?,
    });
    written.times.write = seconds() - start;
    written.bytes = size_on_disk(path);
    Ok(())
}

/// JSON has no infinity: it becomes null.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn mesh_json(made: &MeshFile) -> Value {
    json!({
        "vertices": made.vertices, "triangles": made.triangles, "size_in_metres": made.size_in_metres,
        "simplified": made.simplification.as_ref().map(simplified_json), "largest_position_error": made.position_error,
        "lightmap": made.lightmap.as_ref().map(lightmap_json),
    })
}

impl WrittenFile {
    /// For programs.
    pub fn to_json(&self) -> Value {
        let (r, t) = (&self.report, &self.times);
        json!({
            "path": self.target.path.display().to_string(),
            "isovalue": self.isovalue,
            "environment": self.env,
            "bytes": self.bytes,
            "mesh": match &self.content {
                Content::Mesh(made) => Some(mesh_json(made)),
                Content::Pictures => None,
            },
            "exposure_ev": self.exposure_ev,
            "error": {
                "rms_over_mean": self.rms_over_mean,
                "medium_albedo_error": self.node_error,
                "median_relative": finite(self.error.median),
                "percentile_95_relative": finite(self.error.percentile_95),
            },
            "total_error": self.total.as_ref().map(total_json),
            "negative_vertices": self.negative, "sun_rays": self.sun_rays, "light_notes": self.notes,
            "emission_remainder": self.remainder,
            "lookups": {
                "all": r.lookups, "renormalised": r.renormalised, "neighbourhood": r.neighbourhood,
                "unoccluded": r.unoccluded, "unbaked": r.unbaked,
            },
            "seconds": { "contract": t.contract, "look_up": t.look_up, "render": t.render, "write": t.write },
        })
    }
}
