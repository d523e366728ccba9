//! Pictures of a comparison: the store, the reference, and their difference in false colours.

use super::{LitSurface, PhotonQuestion, Question, by_store};
use crate::error::{Error, Result};
use crate::export::gltf::{GltfOptions, Scalars};
use crate::export::png::PngOptions;
use crate::export::sheet::{SheetStyle, Tile, contact_sheet};
use crate::export::target::targets;
use crate::export::{Image, atomic, gltf, png};
use crate::quantity::{number, percent};
use crate::relight::Exposure;
use crate::render::{Projection, SeenPoint, View, seen_points};
use crate::scene::Colormap;
use crate::session::Isosurface;
use crate::transport::{Radiance, SurfacePoint, buried};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Behind the surface: a dark grey, on which white stands out.
const BACKGROUND: [f32; 4] = [0.025, 0.03, 0.037, 1.0];

/// Which files to write, as names or patterns of names with `{isovalue}` and `{env}`.
#[derive(Clone, Copy, Debug, Default)]
pub struct PicturePatterns<'a> {
    /// Store, reference and difference, side by side.
    pub png: Option<&'a Path>,
    /// The surface with the difference as vertex colours.
    pub glb: Option<&'a Path>,
    /// The surface as the reference lights it.
    pub direct: Option<&'a Path>,
}

/// The files of one surface under one light.
#[derive(Clone, Debug, Default)]
pub struct PictureFiles {
    png: Option<PathBuf>,
    glb: Option<PathBuf>,
    direct: Option<PathBuf>,
}

/// How a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureLook {
    /// From where.
    pub view: View,
    /// Parallel or perspective.
    pub projection: Projection,
    /// Of each of the three pictures.
    pub size: (usize, usize),
    /// The difference, over the mean radiance, that shows in full colour; what 98 % of it is below, if none.
    pub scale: Option<f64>,
}

impl PicturePatterns<'_> {
    /// The files to write, isovalue-major; each can be written.
    ///
    /// # Errors
    /// When a name has the ending of another format or two files are one, or as [`targets`].
    pub fn files(&self, name: &str, isovalues: &[f64], environments: &[String]) -> Result<Vec<PictureFiles>> {
        let of = |path: Option<&Path>, suffix: &str| -> Result<Vec<Option<PathBuf>>> {
            let Some(path) = path else { return Ok(vec![None; isovalues.len() * environments.len()]) };
            if path.extension().is_none_or(|e| e != suffix) {
                let expected = format!("a name ending in .{suffix}");
                return Err(Error::argument("output", path.display(), expected, "the ending decides the format"));
            }
            Ok(targets(path, name, isovalues, environments)?.into_iter().map(|target| Some(target.path)).collect())
        };
        if let (Some(difference), Some(direct)) = (self.glb, self.direct)
            && difference == direct
        {
            let expected = "a file of its own, beside that of --glb";
            return Err(Error::argument("--direct", direct.display(), expected, "give another name"));
        }
        let (pngs, glbs, directs) = (of(self.png, "png")?, of(self.glb, "glb")?, of(self.direct, "glb")?);
        let all = pngs.into_iter().zip(glbs).zip(directs);
        Ok(all.map(|((png, glb), direct)| PictureFiles { png, glb, direct }).collect())
    }

    /// Refuses files of several volumes.
    ///
    /// # Errors
    /// When one is asked for.
    pub fn refuse(&self) -> Result<()> {
        match self.png.or(self.glb).or(self.direct) {
            None => Ok(()),
            Some(path) => {
                let expected = "one volume: a picture of a comparison shows one";
                Err(Error::argument("output", path.display(), expected, "add --volume NAME"))
            }
        }
    }
}

impl PictureFiles {
    /// Where they are.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.png.iter().chain(&self.glb).chain(&self.direct).map(PathBuf::as_path)
    }
}

/// What is shown.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    /// The question.
    pub question: &'a Question<'a>,
    /// The surface that it asks about.
    pub surface: &'a Isosurface,
    /// The reference, where it is photons; else paths.
    pub photons: Option<&'a PhotonQuestion>,
    /// What differences are measured by.
    pub mean: f64,
}

/// What differs where.
struct Differences {
    store: Vec<[f32; 3]>,
    reference: Vec<[f32; 3]>,
    // Mean of the channels of store minus reference, over the mean radiance of the reference.
    relative: Vec<f64>,
}

/// Three attributes, one a channel.
fn scalars_of<'a>(name: &'static str, values: &'a [[f32; 3]]) -> impl Iterator<Item = Scalars> + 'a {
    let channel = move |(c, letter): (usize, &str)| Scalars {
        name: format!("{name}_{letter}"),
        values: values.iter().map(|v| v[c]).collect(),
    };
    ["R", "G", "B"].into_iter().enumerate().map(channel)
}

fn point_of(seen: &SeenPoint) -> SurfacePoint {
    SurfacePoint { position_in_grid: seen.position_in_grid, normal: seen.normal }
}

impl Shown<'_> {
    /// Computes both answers anew at the pixels and at the vertices, and writes these files.
    ///
    /// # Errors
    /// As the answers; when a file cannot be written.
    pub fn write(&self, files: &PictureFiles, look: &PictureLook) -> Result<()> {
        files.png.as_ref().map_or(Ok(()), |path| self.write_png(path, look))?;
        files.glb.as_ref().map_or(Ok(()), |path| self.write_glb(path, look.scale))?;
        files.direct.as_ref().map_or(Ok(()), |path| self.write_direct(path))
    }

    /// Store, reference and difference side by side, as a camera sees the surface.
    fn write_png(&self, path: &Path, look: &PictureLook) -> Result<()> {
        let PictureLook { view, projection, size: (width, height), scale } = *look;
        let (q, mean) = (&self.question.surface, self.mean);
        png::check_size((3 * width, height), None)?;
        let camera = self.surface.camera(q.volume, q.volume.up, view, projection, width as f64 / height as f64);
        let seen = seen_points(q.volume, q.pyramid, q.isovalue, &camera, width, height);
        let found = self.differences(&seen.iter().flatten().map(point_of).collect::<Vec<_>>())?;
        let scale = scale.unwrap_or_else(|| found.natural_scale());
        let exposure = Exposure::Percentile.factor(&found.reference);
        let panel = |colours: &[[f32; 3]]| -> Result<Image> {
            let mut next = colours.iter();
            let pixels = seen.iter().map(|seen| match seen.and_then(|_| next.next()) {
                Some(&[r, g, b]) => [r, g, b, 1.0],
                None => BACKGROUND,
            });
            Image::new(width, height, pixels.collect())
        };
        let mut difference = panel(&found.colours(scale))?;
        draw_bar(&mut difference);
        let images = [
            panel(&Exposure::apply(exposure, &found.store))?,
            panel(&Exposure::apply(exposure, &found.reference))?,
            difference,
        ];
        let reference = self.reference();
        let rms = (found.relative.iter().map(|d| d * d).sum::<f64>() / found.relative.len().max(1) as f64).sqrt();
        let labels = [
            "spherical harmonics".to_string(),
            reference.to_string(),
            format!("difference / mean: blue −{0}, white 0, red +{0}; RMS {1}", percent(scale), percent(rms)),
        ];
        let tiles: Vec<Tile<'_>> = images.iter().zip(&labels).map(|(image, label)| Tile { image, label }).collect();
        let sheet = contact_sheet(&tiles, &SheetStyle { columns: Some(3), ..SheetStyle::default() })?;
        let software = Some(concat!("isolume ", env!("CARGO_PKG_VERSION")).into());
        let description = json!({
            "isovalue": q.isovalue, "reference": reference, "scale": scale, "mean_radiance": mean, "rms": rms,
        });
        let options = PngOptions { software, description: Some(description.to_string()), alpha: false };
        atomic::write(path, |w| png::write(w, &sheet, &options))
    }

    /// The surface with the difference as vertex colours.
    fn write_glb(&self, path: &Path, scale: Option<f64>) -> Result<()> {
        let (q, surface, mean) = (&self.question.surface, self.surface, self.mean);
        let found = self.differences(&self.vertices())?;
        let scale = scale.unwrap_or_else(|| found.natural_scale());
        let colours = found.colours(scale);
        let name = format!("{} {}, difference", q.volume.name, number(q.isovalue, 8));
        let radiance: Vec<[f32; 3]> =
            (0..colours.len()).map(|i| std::array::from_fn(|c| found.store[i][c] - found.reference[i][c])).collect();
        let errors = vec![0.0; radiance.len()];
        let mesh = surface.export(&name, q.volume, q.volume.up, &colours, Some((&radiance, &errors)));
        let provenance = json!({
            "difference_of": ["store", self.reference()], "blue": -scale, "red": scale, "mean_radiance": mean,
            "_RADIANCE": "store minus reference", "_STORE_R, _G, _B": "radiance by the store",
            "_REFERENCE_R, _G, _B": "radiance by the reference",
        });
        let scalars = scalars_of("STORE", &found.store).chain(scalars_of("REFERENCE", &found.reference)).collect();
        let options = GltfOptions { provenance, scalars, ..GltfOptions::default() };
        atomic::write(path, |w| gltf::write(w, &mesh, &options))
    }

    /// The reference itself, exposed, as a file like those of relight.
    fn write_direct(&self, path: &Path) -> Result<()> {
        let (q, surface) = (&self.question.surface, self.surface);
        let (radiance, errors) = self.reference_at_vertices()?;
        let exposure = Exposure::Percentile.factor(&radiance);
        let colours: Vec<[f32; 3]> =
            Exposure::apply(exposure, &radiance).into_iter().map(|c| c.map(|v| v.clamp(0.0, 1.0))).collect();
        let name = format!("{} {}, {}", q.volume.name, number(q.isovalue, 8), self.reference());
        let mesh = surface.export(&name, q.volume, q.volume.up, &colours, Some((&radiance, &errors)));
        let provenance = json!({ "by": self.reference(), "isovalue": q.isovalue, "exposure": exposure });
        let options = GltfOptions { provenance, ..GltfOptions::default() };
        atomic::write(path, |w| gltf::write(w, &mesh, &options))
    }

    fn reference(&self) -> &'static str {
        if self.photons.is_some() { "photons" } else { "paths" }
    }

    /// What the reference says.
    fn answer(&self, q: &Question<'_>) -> Result<Vec<Radiance>> {
        match self.photons {
            Some(photons) => Ok(photons.answer(q)?.0),
            None => {
                let (found, _) = q.surface.by_paths(&[q.surface.light], q.paths, q.seed)?;
                Ok(found.into_iter().flatten().collect())
            }
        }
    }

    /// Radiance of the reference at all vertices, and the standard error of its mean over the channels.
    fn reference_at_vertices(&self) -> Result<(Vec<[f32; 3]>, Vec<f32>)> {
        let points = self.vertices();
        let q = &Question { surface: LitSurface { points: &points, ..self.question.surface }, ..*self.question };
        let each = self.answer(q)?.into_iter().map(|r| {
            let error = (r.stderr.iter().map(|e| e * e).sum::<f64>() / 3.0).sqrt();
            (r.mean.map(|v| v as f32), error as f32)
        });
        Ok(each.unzip())
    }

    fn vertices(&self) -> Vec<SurfacePoint> {
        let mesh = self.surface.mesh();
        let vertices = mesh.positions_in_grid.iter().zip(&mesh.normals);
        vertices.map(|(p, n)| SurfacePoint { position_in_grid: *p, normal: *n }).collect()
    }

    /// Both answers at points of the surface; black where another volume buries it.
    fn differences(&self, points: &[SurfacePoint]) -> Result<Differences> {
        let q = &Question { surface: LitSurface { points, ..self.question.surface }, ..*self.question };
        let surface = &q.surface;
        let (mut store, _) = by_store(q)?;
        let mut reference: Vec<[f64; 3]> = self.answer(q)?.iter().map(|r| r.mean).collect();
        if let Some(geometry) = surface.geometry {
            let buried = buried(surface.volume, surface.pyramid, geometry, surface.isovalue, points);
            let hidden = buried.into_iter().enumerate().filter(|(_, buried)| *buried);
            hidden.for_each(|(i, _)| (store[i], reference[i]) = ([0.0; 3], [0.0; 3]));
        }
        let relative = store.iter().zip(&reference).map(|(a, b)| {
            let difference = (0..3).map(|c| a[c] - b[c]).sum::<f64>() / 3.0;
            if self.mean > 0.0 { difference / self.mean } else { 0.0 }
        });
        let relative = relative.collect();
        let rounded = |v: Vec<[f64; 3]>| v.into_iter().map(|p| p.map(|c| c as f32)).collect();
        Ok(Differences { store: rounded(store), reference: rounded(reference), relative })
    }
}

impl Differences {
    /// What 98 % of the differences are below, rounded up to 1, 2 or 5 of a decimal place.
    fn natural_scale(&self) -> f64 {
        let mut sizes: Vec<f64> = self.relative.iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let wanted = sizes.get(sizes.len() * 98 / 100).copied().unwrap_or(0.0);
        let steps = (-6..6).flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e)));
        let mut steps = steps.skip_while(|s| *s < wanted);
        steps.next().unwrap_or(1.0)
    }

    /// Blue for too dark, white for equal, red for too bright.
    fn colours(&self, scale: f64) -> Vec<[f32; 3]> {
        self.relative.iter().map(|d| false_colour(d / scale)).collect()
    }
}

/// The colour of a difference from −1 to 1.
fn false_colour(t: f64) -> [f32; 3] {
    let Ok(map) = Colormap::named("red-blue") else { return [0.0; 3] };
    map.linear(0.5 - 0.5 * t)
}

/// Draws the scale of colours along the lower edge.
fn draw_bar(image: &mut Image) {
    let (width, height) = (image.width(), image.height());
    let thickness = (height / 40).max(2);
    for x in 0..width {
        let [r, g, b] = false_colour(2.0 * (x as f64 + 0.5) / width as f64 - 1.0);
        for y in height - thickness..height {
            image.pixels_mut()[y * width + x] = [r, g, b, 1.0];
        }
    }
}
