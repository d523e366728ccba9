//! The demonstration: a small brain, inside the program, baked and lit.

use crate::bake::{Report, Request};
use crate::cache::Filler;
use crate::error::Result;
use crate::export::png::PngOptions;
use crate::export::sheet::{SheetStyle, Tile, contact_sheet};
use crate::export::{Image, atomic, png};
use crate::relight::Material;
use crate::render::View;
use crate::scene::{Effects, open_probe};
use crate::session::{LightOptions, LitOptions, MeshOptions, PictureOptions, Session};
use crate::transfer::store::Store;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;
use crate::volume::{Isovalue, ReadHint, Volume, read};
use std::path::{Path, PathBuf};

/// See `examples/data/README.md` for its origin and licence.
const VOLUME: &[u8] = include_bytes!("../examples/data/mni152_t1_2mm.nii.gz");
/// Name of the volume.
pub const VOLUME_NAME: &str = "mni152_t1_2mm";
/// The outside of the brain, and the border of white matter.
pub const ISOVALUES: [f64; 2] = [90.0, 160.0];
const ENVIRONMENTS: [&str; 3] = ["courtyard", "studio", "sunset"];
/// Rays a texel: a draft, so that the bake takes well below a minute on two cores.
pub const RAYS: u32 = 64;
/// From the front left and a little above: azimuth and elevation in degrees.
pub const VIEW: [f64; 2] = [30.0, 15.0];
/// Brings the brightest part of the environments before the brain.
pub const ROTATE: f64 = 240.0;
/// Width and height of a picture.
pub const SIZE: [usize; 2] = [376, 324];

/// Files of one kind that a command of the program makes.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// The surface.
    pub isovalue: f64,
    /// Its lights.
    pub environments: &'static [&'static str],
    /// Ending of the files: glb or png.
    pub suffix: &'static str,
}

/// The surfaces under their lights: as meshes, then as pictures.
pub fn tasks() -> impl Iterator<Item = Task> {
    let surfaces = [(ISOVALUES[0], &ENVIRONMENTS[..]), (ISOVALUES[1], &ENVIRONMENTS[2..])];
    let task = |(isovalue, environments)| ["glb", "png"].map(|suffix| Task { isovalue, environments, suffix });
    surfaces.into_iter().flat_map(task)
}

/// A file that was written.
pub struct LitFile {
    /// The file.
    pub path: PathBuf,
    /// The surface.
    pub isovalue: f64,
    /// Its light.
    pub environment: &'static str,
    /// From the light to the file.
    pub seconds: f64,
    /// Root mean square of the standard errors over the mean radiance.
    pub noise: f64,
    /// The picture, where it is one.
    pub image: Option<Image>,
}

/// The brain.
///
/// # Errors
/// None, but that the reader says so.
pub fn volume() -> Result<Volume> {
    read(VOLUME, &ReadHint { name: VOLUME_NAME.into(), ..ReadHint::default() })
}

/// Bakes it into the store at `path`.
///
/// # Errors
/// Those of the bake.
pub fn bake(volume: &Volume, path: &Path, seed: u64, fill: &Filler<'_>) -> Result<(Store, Report)> {
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: Layers::usual(4)? };
    let settings = Settings { layers: layout.layers.clone(), rays: RAYS, seed, target: None, positive: false };
    let value = |c: f64| Ok(Isovalue::Value(c).resolve(volume, Some(volume.solid), None)?.value);
    let isovalues = ISOVALUES.into_iter().map(value).collect::<Result<Vec<f64>>>()?;
    let effects = Effects::default();
    let request = Request::new(volume, VOLUME_NAME, layout, settings, &effects);
    fill(&Request { isovalues: Some(isovalues), ..request }, path)
}

/// Lights a surface and writes its files into a folder; `seconds` is the clock.
///
/// # Errors
/// When a file cannot be written.
pub fn light(session: &Session<'_>, task: &Task, folder: &Path, seconds: &dyn Fn() -> f64) -> Result<Vec<LitFile>> {
    let options = LightOptions { rotation_degrees: ROTATE, ..LightOptions::default() };
    let ([azimuth, elevation], [width, height]) = (VIEW, SIZE);
    let picture = PictureOptions { width, height, view: View { azimuth, elevation }, ..PictureOptions::default() };
    let material = Material::new([0.7; 3], [0.0; 3])?;
    let surface = session.surface(task.isovalue)?;
    let mut files = Vec::new();
    for &environment in task.environments {
        let probe = open_probe(environment, false, None)?;
        let start = seconds();
        let lighting = session.light(&probe, &options)?;
        let lit = surface.lit(&lighting, &material, &LitOptions::default())?;
        let path = folder.join(format!("brain-{}-{environment}.{}", task.isovalue, task.suffix));
        let image = if task.suffix == "png" {
            let still = lit.picture(&picture)?;
            lit.write_png(&path, &still)?;
            Some(still.image)
        } else {
            lit.write_gltf(&path, &MeshOptions::default())?;
            None
        };
        let (seconds, noise) = (seconds() - start, lit.rms_over_mean());
        files.push(LitFile { path, isovalue: task.isovalue, environment, seconds, noise, image });
    }
    Ok(files)
}

/// Writes all pictures on one sheet.
///
/// # Errors
/// When the file cannot be written.
pub fn write_sheet(lit: &[LitFile], path: &Path) -> Result<()> {
    let label = |f: &LitFile| format!("isovalue {}, {}", f.isovalue, f.environment);
    let pictures: Vec<(&Image, String)> = lit.iter().filter_map(|f| Some((f.image.as_ref()?, label(f)))).collect();
    let tiles: Vec<Tile<'_>> = pictures.iter().map(|(image, label)| Tile { image, label }).collect();
    let sheet = contact_sheet(&tiles, &SheetStyle { columns: Some(2), margin: 16, ..SheetStyle::default() })?;
    let software = Some(concat!("isolume ", env!("CARGO_PKG_VERSION")).into());
    atomic::write(path, |w| png::write(w, &sheet, &PngOptions { software, ..PngOptions::default() }))
}
