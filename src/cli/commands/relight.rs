//! `isolume relight`: light on surfaces, from a store, in milliseconds.

use crate::cli::args::light::{LightArgs, MaterialArgs, by_option};
use crate::cli::args::mesh::MeshArgs;
use crate::cli::args::picture::PictureArgs;
use crate::cli::args::transfer::TransferArgs;
use crate::cli::args::volume::VolumeArgs;
use crate::cli::commands::cache::ready;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::lent::{details, filler};
use crate::cli::present::relit::report;
use crate::cli::present::text;
use crate::error::Error;
use crate::export::inputs::Inputs;
use crate::lit::{Host, Job};
use crate::probe::{Probe, SunSplit};
use crate::scene::{NamedIsovalue, SceneFile, open_probe};
use crate::transfer::store::{Holdings, Store};
use std::path::PathBuf;
use std::time::Instant;

/// Light isosurfaces by environments and write them as .glb, .ply, .stl or .png
///
/// From a store transfer and light are multiplied; rays are traced to lamps that bands would blur, no others. A volume is baked first, for the
/// isovalues asked for, into a store in the user's cache folder; the next run finds it there. Where that takes
/// longer than a moment, a draft of 16 rays a texel is written first, then replaced.
#[derive(clap::Args, Clone)]
#[command(override_usage = "isolume relight [OPTIONS] -i <C[,…]> -e <PROBE> -o <FILE> <INPUT>")]
#[command(after_help = "Examples:
  isolume relight brain.isolume --isovalue 90 --env courtyard -o brain.glb
  isolume relight brain.isolume --isovalue 90,160 --env studio -o {isovalue}.png
  isolume relight brain.isolume --isovalue 90 --env sunset.exr --env sky -o out/
  isolume relight bumpbox:96 --isovalue auto --env sun:-45,30 -o bumps.png
  isolume relight orbital.cube --isovalue 0.03,-0.03 --env studio -o orbital.png   (both lobes)
  isolume relight brain.isolume --isovalue 90 --env courtyard --for web --lod 20000 -o brain.glb
  isolume relight head.nii.gz --isovalue bone --env studio --keep-largest -o skull.png
  isolume relight scene.toml --exposure -1")]
pub(in crate::cli) struct Relight {
    /// Store, or a volume file, field or scene (.toml) that is baked first
    #[arg(value_name = "X.isolume|VOLUME|SCENE")]
    input: String,
    /// Isovalues: numbers in the file's values, 40% of their range, 1.5sigma from the mean, 1.5rms from 0, enclosed:5% of
    /// the volume, 300HU, bone, skin, otsu, or auto. Two of opposite sign without {isovalue} in the output are the lobes of
    /// a field about 0, in one picture. Of several volumes baked together isovalues are those of the first; NAME=C is that
    /// of another, and all surfaces that belong to it are lit
    #[arg(short, long, visible_alias = "isovalues", value_name = "[NAME=]C[,…]", value_delimiter = ',')]
    #[arg(required = true, allow_hyphen_values = true)]
    isovalue: Vec<NamedIsovalue>,
    /// Environment: an image file, courtyard, studio, sunset, or a sky: constant, gradient, overcast, sky, sun:AZ,EL
    /// (azimuth counter-clockwise from the centre of an image, glTF +X)
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// File to write, or several; the ending decides the format. For several surfaces: a name with {isovalue} and {env},
    /// or a directory
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Write an empty file, instead of an error, for an isovalue that no surface has
    #[arg(long)]
    allow_empty: bool,
    /// Light only this one of several volumes baked together; isovalues are then its own
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    #[command(flatten, next_help_heading = "Light")]
    light: LightArgs,
    #[command(flatten, next_help_heading = "Material")]
    material: MaterialArgs,
    #[command(flatten, next_help_heading = "Mesh files")]
    mesh: MeshArgs,
    #[command(flatten, next_help_heading = "Pictures")]
    picture: PictureArgs,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
    #[command(flatten, next_help_heading = "Bake of a volume")]
    transfer: TransferArgs,
    /// Where stores of volumes are kept [default: the user's cache folder; see isolume cache]
    #[arg(long, value_name = "DIR", help_heading = "Bake of a volume")]
    cache: Option<PathBuf>,
    /// Write no draft before the result
    #[arg(long, help_heading = "Bake of a volume")]
    no_draft: bool,
    #[arg(skip)]
    pub(in crate::cli) scene: Option<SceneFile>,
}

impl Relight {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let start = Instant::now();
        if let Some(scale) = self.mesh.scale
            && !(scale.is_finite() && scale > 0.0)
        {
            return Err(Error::argument("--scale", scale, "a positive number", "give metres to a world unit").into());
        }
        let scene = self.scene.as_ref();
        let inputs = Inputs::new(self.env.iter().chain([&self.input]));
        self.output.iter().try_for_each(|output| inputs.refuse(output))?;
        // Whatever can be wrong is refused before the bake, which may take minutes.
        let material = self.material.choice();
        material.rule((0.0, 1.0))?;
        let probes = self.open_probes(console)?;
        let quality = self.transfer.quality(&[], seed);
        let job = Job {
            input: &self.input,
            scene,
            isovalues: self.isovalue.clone(),
            of_volume: self.of_volume.as_deref(),
            probes: &probes,
            outputs: &self.output,
            inputs: &inputs,
            allow_empty: self.allow_empty,
            how: self.transfer.scene(&self.volume),
            quality,
            light: self.light.options(SunSplit::Auto),
            sun_split: self.light.sun_split,
            luminaires: &self.light.luminaires,
            material,
            mesh: self.mesh.options(),
            lods: &self.mesh.lod,
            view: self.picture.seen.view,
            picture: self.picture.options(self.transfer.rays.unwrap_or(64)),
            turntable: self.picture.turntable(),
            drafts: !self.no_draft,
        };
        let host = Host {
            cache: &|| ready(self.cache.as_deref()),
            fill: &filler(start, console),
            filled: &|filled| details(filled, console),
            note: &|text| console.note(text),
            seconds: &|| start.elapsed().as_secs_f64(),
        };
        report(console, &job.run(&host).map_err(|failure| self.explained(failure))?);
        Ok(())
    }

    fn open_probes(&self, console: &Console) -> Outcome<Vec<Probe>> {
        let mut probes = Vec::new();
        for argument in &self.env {
            let probe = open_probe(argument, self.light.keep_negative, self.light.layout)
                .map_err(|error| self.scene.iter().fold(error, |e, file| file.at_environment(argument, e)))?;
            for note in &probe.notes {
                console.note(format!("{}: {} ({})", probe.name, note.text, text::count(note.count)));
            }
            probes.push(probe);
        }
        Ok(probes)
    }

    /// The error for a surface whose texels the store does not have says what to type; others name options.
    fn explained(&self, failure: Failure) -> Failure {
        let error = match failure {
            Failure::Library(error) => error,
            other => return other,
        };
        let Error::Unbaked { path, isovalue, unbaked, lookups, holds_all, isovalues, .. } = error else {
            return by_option(error).into();
        };
        let held = Holdings { all: holds_all, isovalues, ..Holdings::default() }.isovalues_text();
        let value = text::number(isovalue, 8);
        // What it was baked from, as its user named it.
        let of_store = Store::open(&path).ok().and_then(|s| Some(s.provenance()["input"].as_str()?.to_string()));
        let source = of_store.as_deref().unwrap_or("VOLUME");
        Failure::Message(format!(
            "{}: {} of {} lookups at isovalue {value} meet texels that were never baked; \
             the store holds these isovalues: {held}; \
             bake the missing ones into it: isolume bake {source} --isovalues {value} -o {} \
             (with the options of the first bake)",
            self.input,
            text::count(unbaked),
            text::count(lookups),
            path.display(),
        ))
    }
}
