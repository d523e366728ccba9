//! `isolume export`: the relit texture as a volume for other programs.

use crate::cli::args::light::{LightArgs, MaterialArgs, by_option};
use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::Error;
use crate::export::field::FieldFormat;
use crate::export::inputs::Inputs;
use crate::export::target::check_file;
use crate::probe::SunSplit;
use crate::relight::Material;
use crate::scene::{MaterialRule, open_probe};
use crate::session::{Lighting, RelitField};
use crate::transfer::store::{Completeness, Store, check_store};
use serde_json::json;
use std::path::PathBuf;

/// Write the relit 3D texture for other programs: the colour of every isosurface, as a volume
///
/// The radiance of the level set through each texel: any contour made elsewhere is lit by looking it up there.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  isolume export brain.isolume --env courtyard -o brain.vti")]
pub(in crate::cli) struct Export {
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

impl Export {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let format = self.check()?;
        let store = Store::open_telling(&self.input, true, |note| console.note(note))?;
        let store = match &self.volume {
            Some(name) => store.of_volume(name)?,
            None => store,
        };
        let volume = store.volume()?;
        Completeness::of(&store, &volume)?.check(&store, self.partial)?;
        store.check_texture(&store.holdings()?, "an export of the volume")?;
        if let (None, [first, .., _]) = (&self.volume, store.volumes()?.as_slice()) {
            console.note(format!("{first}, the first volume of the store: --volume NAME takes another"));
        }
        let layout = store.layout();
        let MaterialRule::Constant(albedo) = self.material.choice().rule(volume.value_range())? else {
            let expected = "one albedo for all isosurfaces";
            return Err(
                Error::argument("--colormap", "a colour scale", expected, "leave it out, or use relight").into()
            );
        };
        let material = Material::new(albedo, self.material.emission.map_or([0.0; 3], |e| e.0))?;
        let probe = open_probe(&self.env, self.light.keep_negative, self.light.layout)?;
        let lighting =
            Lighting::new(&probe, volume.up, &layout.layers, &self.light.options(SunSplit::Off)).map_err(by_option)?;
        lighting.notes().iter().for_each(|note| console.note(note.sentence(&probe.name)));
        let field =
            RelitField::new(&store, &volume, &lighting, &material, &self.light.luminaires).map_err(by_option)?;
        let lit = field.lit();
        if lit.is_empty() {
            let remedy = "bake it first: isolume bake VOLUME -o X.isolume";
            return Err(
                Error::argument("store", "no texel with a level set", "at least one that is baked", remedy).into()
            );
        }
        let filled = field.valid.iter().filter(|v| **v == 2).count() as u64;
        let exposure = self.material.exposure.factor(&lit);
        let provenance = json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "volume": volume.name, "store": store.identity().hash(), "environment": probe.name,
            "env_rotate_degrees": self.light.env_rotate, "env_frame": self.light.env_frame.name(), "window": lighting.options().window.name(),
            "albedo": material.albedo, "emission": material.emission, "exposure_ev": f64::from(exposure).log2(),
            "noise_over_mean": field.noise,
        });
        field.write(&self.output, format, exposure, &provenance)?;
        let [mx, my, mz] = field.dims;
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
    fn check(&self) -> Outcome<FieldFormat> {
        check_store(&self.input)?;
        if self.light.sun_split.is_some_and(|split| split != SunSplit::Off) {
            let remedy = "leave it out: a sun's sharp shadows are not in the texture";
            return Err(Error::argument("--sun-split", "with export", "light that the texture holds", remedy).into());
        }
        let format = FieldFormat::of(&self.output)?;
        check_file(&self.output)?;
        let inputs = Inputs::new([&self.input, &self.env]);
        inputs.refuse(&self.output)?;
        if format == FieldFormat::Raw {
            inputs.refuse(&self.output.with_extension("nhdr"))?;
        }
        Ok(format)
    }
}
