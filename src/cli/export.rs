//! `isolume export`: the relit texture as a volume for other programs.

use super::console::Console;
use super::info::{check_store, check_texture};
use super::inputs::Inputs;
use super::light::{LightArgs, MaterialArgs, by_option, open_probe, sentence};
use super::output::check_file;
use super::{Outcome, text};
use crate::error::Error;
use crate::export::atomic;
use crate::export::field::{RadianceField, write_nrrd, write_raw, write_raw_header, write_vti};
use crate::grid3;
use crate::probe::{EnvFrame, SunSplit};
use crate::relight::{LookupReport, Material};
use crate::scene::MaterialRule;
use crate::session::{Lighting, radiance_of_bricks};
use crate::transfer::store::Completeness;
use crate::transfer::store::Store;
use crate::transfer::{BRICK, BrickSource, BrickView, Lattice, Selection, validity};
use crate::volume::Volume;
use glam::{DMat3, DVec3};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Write the relit 3D texture for other programs: the colour of every isosurface, as a volume
///
/// The radiance of the level set through each texel: any contour made elsewhere is lit by looking it up there.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  isolume export brain.isolume --env courtyard -o brain.vti")]
pub(super) struct Export {
    /// The store
    #[arg(value_name = "X.isolume")]
    input: String,
    /// Environment: an image file or a name, as relight takes it
    #[arg(short, long, value_name = "PROBE")]
    env: String,
    /// File to write: .vti (ParaView, VTK), .nrrd (3D Slicer, ITK), or .raw (RGBA floats, with a header .nhdr beside it)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Which of several volumes baked together [default: the first]
    #[arg(long, value_name = "NAME")]
    volume: Option<String>,
    /// Accept a store whose bake is not finished: what is missing is filled from neighbours, or has no light
    #[arg(long)]
    partial: bool,
    #[command(flatten, next_help_heading = "Light")]
    light: LightArgs,
    #[command(flatten, next_help_heading = "Material")]
    material: MaterialArgs,
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Vti,
    Nrrd,
    Raw,
}

impl Export {
    pub(super) fn run(&self, console: &Console) -> Outcome {
        let format = self.check()?;
        let store = Store::open(&self.input)?;
        let store = match &self.volume {
            Some(name) => store.of_volume(name)?,
            None => store,
        };
        let volume = store.volume()?;
        Completeness::of(&store, &volume)?.check(&store, self.partial)?;
        check_texture(&store, &store.holdings()?, "an export of the volume")?;
        if let (None, [first, .., _]) = (&self.volume, store.volumes()?.as_slice()) {
            console.note(format!("{first}, the first volume of the store: --volume NAME takes another"));
        }
        let layout = store.layout();
        let MaterialRule::Constant(albedo) = self.material.rule(volume.value_range())? else {
            let expected = "one albedo for all isosurfaces";
            return Err(
                Error::argument("--colormap", "a colour scale", expected, "leave it out, or use relight").into()
            );
        };
        let material = Material::new(albedo, self.material.emission.map_or([0.0; 3], |e| e.0))?;
        let probe = open_probe(&self.env, self.light.keep_negative, self.light.layout)?;
        let lighting =
            Lighting::new(&probe, volume.up, &layout.layers, &self.light.options(SunSplit::Off)).map_err(by_option)?;
        lighting.notes().iter().for_each(|note| console.note(sentence(&probe.name, note)));
        let bricks = Selection::all(layout.lattice).bricks();
        let (contracted, _) =
            radiance_of_bricks(&store, &bricks, &lighting, &material, &self.light.luminaires).map_err(by_option)?;
        let views = bricks.iter().map(|&b| store.brick(b)).collect::<Result<Vec<_>, Error>>()?;
        let (mut radiance, mut valid, mut values) = (Vec::new(), Vec::new(), Vec::new());
        let [mx, my, mz] = layout.lattice.texels();
        let mut report = LookupReport::default();
        for i in 0..mx * my * mz {
            let texel = grid3::at([mx, my], i);
            let at = layout.lattice.grid_from_texel(texel);
            let before = report;
            let rgb =
                contracted.radiance_at(at.map(|v| v as f32), [0.0, 0.0, 1.0], lighting.light(), &material, &mut report);
            let none = report.unoccluded > before.unoccluded;
            radiance.push(if none { [0.0; 3] } else { rgb });
            let has_level_set = is_valid(&views, layout.lattice, texel);
            valid.push(if none {
                0
            } else if has_level_set {
                1
            } else {
                2
            });
            values.push(value(&volume, at));
        }
        let lit: Vec<[f32; 3]> = radiance.iter().zip(&valid).filter(|(_, v)| **v == 1).map(|(r, _)| *r).collect();
        if lit.is_empty() {
            let remedy = "bake it first: isolume bake VOLUME -o X.isolume";
            return Err(
                Error::argument("store", "no texel with a level set", "at least one that is baked", remedy).into()
            );
        }
        let filled = valid.iter().filter(|v| **v == 2).count() as u64;
        let exposure = self.material.exposure.factor(&lit);
        let provenance = json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "volume": volume.name, "store": store.identity().hash(), "environment": probe.name,
            "env_rotate_degrees": self.light.env_rotate, "env_frame": EnvFrame::from(self.light.env_frame).name(), "window": lighting.options().window.name(),
            "albedo": material.albedo, "emission": material.emission, "exposure_ev": f64::from(exposure).log2(),
            "noise_over_mean": contracted.noise.relative(),
        });
        let (origin, steps) = placement(&volume, layout.lattice);
        let field = RadianceField {
            dims: layout.lattice.texels(),
            origin,
            steps,
            radiance: &radiance,
            valid: &valid,
            values: &values,
            exposure,
            provenance: &provenance,
        };
        write(&self.output, format, &field)?;
        let bytes = std::fs::metadata(&self.output).map_or(0, |m| m.len());
        let what = format!("{mx} × {my} × {mz} texels, {}", text::bytes(bytes as f64));
        console.summary(text::file_line(&self.output, &what));
        console.summary(format!(
            "{} with a level set, {} filled from neighbours; exposure {:+.2} EV",
            text::count(lit.len() as u64),
            text::count(filled),
            exposure.log2()
        ));
        console.print_json(&json!({
            "path": self.output.display().to_string(), "bytes": bytes, "texels": [mx, my, mz], "valid": lit.len(),
            "filled": filled, "record": provenance,
        }));
        Ok(())
    }

    /// Refuses what cannot be done before any work.
    fn check(&self) -> Outcome<Format> {
        check_store(&self.input)?;
        if self.light.sun_split.is_some_and(|split| split != SunSplit::Off) {
            let remedy = "leave it out: a sun's sharp shadows are not in the texture";
            return Err(Error::argument("--sun-split", "with export", "light that the texture holds", remedy).into());
        }
        let suffix = self.output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let format = match suffix.as_deref() {
            Some("vti") => Format::Vti,
            Some("nrrd") => Format::Nrrd,
            Some("raw") => Format::Raw,
            _ => {
                let expected = "a name ending in .vti, .nrrd or .raw";
                let remedy = "the ending decides the format";
                return Err(Error::argument("output", self.output.display(), expected, remedy).into());
            }
        };
        check_file(&self.output)?;
        let inputs = Inputs::new([&self.input, &self.env]);
        inputs.refuse(&self.output)?;
        if format == Format::Raw {
            inputs.refuse(&self.output.with_extension("nhdr"))?;
        }
        Ok(format)
    }
}

fn write(path: &Path, format: Format, field: &RadianceField<'_>) -> Outcome {
    match format {
        Format::Vti => atomic::write(path, |w| write_vti(w, field))?,
        Format::Nrrd => atomic::write(path, |w| write_nrrd(w, field))?,
        Format::Raw => {
            atomic::write(path, |w| write_raw(w, field))?;
            let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
            atomic::write(path.with_extension("nhdr"), |w| write_raw_header(w, field, &name))?;
        }
    }
    Ok(())
}

/// Whether a texel has a level set; `views` are all bricks, x fastest.
fn is_valid(views: &[Option<BrickView<'_>>], lattice: Lattice, texel: [usize; 3]) -> bool {
    let [bx, by, _] = lattice.bricks();
    let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
    views[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))]
        .is_some_and(|view| view.validity[inner] & validity::VALID != 0)
}

/// World position of the first texel and the steps from texel to texel.
fn placement(volume: &Volume, lattice: Lattice) -> (DVec3, DMat3) {
    let world_from_grid = volume.world_from_grid();
    let steps = DMat3::from_diagonal(DVec3::new(lattice.step(0), lattice.step(1), lattice.step(2)));
    (world_from_grid.offset(), world_from_grid.linear() * steps)
}

/// The trilinear field at a grid position, in the file's values.
fn value(volume: &Volume, at: [f64; 3]) -> f32 {
    let dims = volume.dims();
    let base: [usize; 3] = std::array::from_fn(|a| (at[a] as usize).min(dims[a].saturating_sub(2)));
    let mut sum = 0.0;
    for corner in 0..8 {
        let mut weight = 1.0;
        let index: [usize; 3] = std::array::from_fn(|a| {
            let (high, part) = (corner >> a & 1, at[a] - base[a] as f64);
            weight *= if high == 1 { part } else { 1.0 - part };
            (base[a] + high).min(dims[a] - 1)
        });
        if weight > 0.0 {
            sum += weight * f64::from(volume.samples().raw(volume.index(index[0], index[1], index[2])));
        }
    }
    volume.value_from_raw(sum) as f32
}
