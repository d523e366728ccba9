//! `isolume study thesis`: the table of Beason (2005) on data at hand.

use crate::cli::console::Console;
use crate::cli::options::parse_rays;
use crate::cli::{Outcome, output, text};
use crate::error::Error;
use crate::export::atomic;
use crate::scene::{Coupling, Member, Scene, VolumeOptions};
use crate::study::thesis::{Effort, PRINTED, Printed, ThesisRow, measure, room};
use crate::volume::{Volume, field};
use cpu_time::ProcessTime;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

/// Bake several data sets in a box of coloured walls, and compare with the light computed directly (Beason 2005, table 5.14)
///
/// Rows: the bump box, stand-ins for the two-field data (nucleons and spray), and a neuron and a brain where they are given.
/// Each stands in a closed room under one luminaire. By spherical harmonics at the vertices of the isosurfaces, and by photons
/// (indirect light from the map, direct light by rays); errors against path tracing at random vertices, in percent of white after
/// the exposure of the reference, mean over the isovalues. Writes thesis.csv and thesis.json.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume study thesis
  isolume study thesis --neuron neuron.nrrd --brain brain.nii.gz --rays 256")]
pub(super) struct ThesisArgs {
    /// A volume in the place of the neuron of the thesis
    #[arg(long, value_name = "VOLUME")]
    neuron: Option<String>,
    /// Isovalues of it
    #[arg(long, value_name = "C[,C…]", value_delimiter = ',', default_value = "30,45,90")]
    neuron_isovalues: Vec<f64>,
    /// A volume in the place of the brain of the thesis
    #[arg(long, value_name = "VOLUME")]
    brain: Option<String>,
    /// Isovalues of it; those of the thesis
    #[arg(long, value_name = "C[,C…]", value_delimiter = ',', default_value = "77,106,97,82,19")]
    brain_isovalues: Vec<f64>,
    /// Samples of the bump box along a side; stand-ins have those of the thesis, 101 and 120, or as many if that is less
    #[arg(long, value_name = "N", default_value_t = 101, value_parser = clap::value_parser!(u32).range(8..=1024))]
    size: u32,
    /// Paths of a vertex, a power of two
    #[arg(long, value_name = "N", default_value = "256", value_parser = parse_rays)]
    rays: u32,
    /// Photons sent out for each isosurface
    #[arg(long, value_name = "N", default_value_t = 1 << 22, value_parser = clap::value_parser!(u32).range(1..=1 << 30))]
    photons: u32,
    /// Random vertices at which light is compared
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "1024", value_parser = parse_rays)]
    reference_paths: u32,
    /// Folder for thesis.csv and thesis.json
    #[arg(short, long, value_name = "DIR", default_value = "thesis")]
    output: PathBuf,
}

/// A data set to measure.
struct Data {
    name: String,
    resolution: String,
    scene: Scene,
    isovalues: Vec<f64>,
    printed: Printed,
}

impl ThesisArgs {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let sets = self.data()?;
        let folder = output::result_folder(Some(&self.output), String::new(), "thesis.csv")?;
        let effort =
            Effort { rays: self.rays, photons: self.photons, points: self.points, paths: self.reference_paths, seed };
        let stores = tempfile_beside(&folder)?;
        let (start, cpu) = (Instant::now(), ProcessTime::now());
        let clock = || [start.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64()];
        let mut rows = Vec::new();
        for (i, data) in sets.into_iter().enumerate() {
            console.note(format!("{}, isovalues {:?}", data.name, data.isovalues));
            let path = stores.path().join(format!("{i}.isolume"));
            let row = measure(&data.scene, &data.isovalues, &effort, &path, &clock)?;
            rows.push((data, row));
        }
        console.print(table(&rows));
        console.print(format!(
            "\nRMS %: of linear radiance after the exposure of the reference, cut to [0, 1], mean over the isosurfaces, as Beason (2005) \
             measured; reference: {} paths at each of {} vertices. Precompute: the bake of all isosurfaces by {} paths a vertex, wall clock; \
             his: photons and texture. Sizes of the room and colours of its walls are ours: they are not printed in the thesis. nucleons and \
             spray are stand-ins for data that are not public.",
            self.reference_paths, self.points, self.rays
        ));
        let csv = csv(&rows);
        let (csv_file, json_file) = (folder.join("thesis.csv"), folder.join("thesis.json"));
        atomic::write(&csv_file, |w| w.write_all(csv.as_bytes()).map_err(|e| Error::io(&csv_file, "write", e)))?;
        let json = json!({ "rows": rows.iter().map(|(data, row)| row_json(data, row)).collect::<Vec<_>>() });
        atomic::write(&json_file, |w| writeln!(w, "{json:#}").map_err(|e| Error::io(&json_file, "write", e)))?;
        console.print_json(&json);
        console.print(csv_file.display());
        Ok(())
    }

    fn data(&self) -> Outcome<Vec<Data>> {
        let mut all = Vec::new();
        let [bump, nucleon, spray, neuron, brain] = PRINTED;
        let bumps = named(&format!("bumpbox:{}", self.size))?;
        all.push(alone("bump box", bumps, vec![10.0, 47.0, 100.0, 150.0], bump, 0.0)?);
        let size = |most: u32| self.size.min(most);
        let nucleons = [format!("nucleons:{}", size(101)), format!("nucleons-2:{}", size(101))];
        all.push(pair("nucleons, a stand-in", &nucleons, vec![24.0, 39.0, 79.0, 170.0], nucleon)?);
        let drops = [format!("spray:{}", size(120)), format!("spray-2:{}", size(120))];
        all.push(pair("spray, a stand-in", &drops, vec![52.0, 76.0, 112.0, 116.0, 166.0, 201.0], spray)?);
        for (file, isovalues, printed) in
            [(&self.neuron, &self.neuron_isovalues, neuron), (&self.brain, &self.brain_isovalues, brain)]
        {
            let Some(file) = file else { continue };
            let member = Member::open(file, &VolumeOptions::default())?;
            let (low, high) = member.volume.value_range();
            if let Some(outside) = isovalues.iter().find(|c| !(low < **c && **c < high)) {
                let (expected, remedy) = (
                    format!("isovalues of {file}, from {low} to {high}"),
                    "give others with --neuron-isovalues or --brain-isovalues",
                );
                return Err(Error::argument("isovalue", outside, expected, remedy).into());
            }
            let volume = Volume::clone(&member.volume);
            all.push(alone(printed.name, volume, isovalues.clone(), printed, 0.1)?);
        }
        Ok(all)
    }
}

/// A folder for stores beside the results, which goes when it is dropped.
fn tempfile_beside(folder: &std::path::Path) -> Outcome<Scratch> {
    let path = folder.join(format!(".stores-{}", std::process::id()));
    std::fs::create_dir_all(&path).map_err(|e| Error::io(&path, "make the folder", e))?;
    Ok(Scratch(path))
}

struct Scratch(PathBuf);

impl Scratch {
    fn path(&self) -> &std::path::Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed stays.
        drop(std::fs::remove_dir_all(&self.0));
    }
}

fn named(spec: &str) -> Outcome<Volume> {
    let found = field::by_name(spec)?.ok_or_else(|| Error::argument("field", spec, "a field", "see isolume info"))?;
    Ok(found.sample()?)
}

fn resolution(volume: &Volume) -> String {
    let [x, y, z] = volume.dims();
    format!("{x}x{y}x{z}")
}

fn alone(name: &str, volume: Volume, isovalues: Vec<f64>, printed: Printed, margin: f64) -> Outcome<Data> {
    let geometry = room(&volume.world_bounds(), volume.up.axis(), margin)?;
    let resolution = resolution(&volume);
    Ok(Data { name: name.into(), resolution, scene: Scene::among(volume, geometry), isovalues, printed })
}

fn pair(name: &str, specs: &[String; 2], isovalues: Vec<f64>, printed: Printed) -> Outcome<Data> {
    let volumes = specs.iter().map(|spec| named(spec)).collect::<Outcome<Vec<_>>>()?;
    let resolution = resolution(&volumes[0]);
    let geometry = room(&volumes[0].world_bounds(), volumes[0].up.axis(), 0.1)?;
    let scene = Scene::coupled(volumes, &[[1.0; 3]; 2], &Coupling::Equal, Some(geometry))?;
    Ok(Data { name: name.into(), resolution, scene, isovalues, printed })
}

fn table(rows: &[(Data, ThesisRow)]) -> String {
    let head = [
        "data set",
        "volumes",
        "resolution",
        "vertices",
        "precompute",
        "thesis",
        "texturing",
        "thesis",
        "direct",
        "thesis",
        "RMS %, SH",
        "photons",
        "thesis",
    ];
    let mut lines = vec![head.map(String::from).to_vec()];
    for (data, row) in rows {
        let seconds = |v: f64| format!("{} s", text::number(v, 3));
        let printed = &data.printed;
        lines.push(vec![
            data.name.clone(),
            data.scene.members().len().to_string(),
            data.resolution.clone(),
            text::count(row.surfaces.iter().map(|s| s.vertices).sum()),
            seconds(row.bake[0]),
            seconds(printed.precompute),
            seconds(row.mean(|s| s.texturing)),
            seconds(printed.texturing),
            seconds(row.mean(|s| s.render)),
            seconds(printed.render),
            format!("{:.2}", row.mean(|s| s.rms_percent[0])),
            format!("{:.2}", row.mean(|s| s.rms_percent[1])),
            format!("{:.2}", printed.rms_percent),
        ]);
    }
    text::table(&lines)
}

const HEAD: &str = "data_set,volume,isovalue,vertices,rms_percent_sh,rms_percent_photons,texturing_seconds,direct_seconds,photon_seconds,\
thesis_rms_percent";

fn csv(rows: &[(Data, ThesisRow)]) -> String {
    let mut out = format!("{HEAD}\n");
    for (data, row) in rows {
        for s in &row.surfaces {
            let [sh, photons] = s.rms_percent;
            out += &format!(
                "\"{}\",{},{},{},{sh:.4},{photons:.4},{:.4},{:.3},{:.3},{}\n",
                data.name, s.volume, s.isovalue, s.vertices, s.texturing, s.render, s.photons, data.printed.rms_percent
            );
        }
    }
    out
}

fn row_json(data: &Data, row: &ThesisRow) -> Value {
    let of = |s: &crate::study::thesis::OfIsovalue| {
        json!({
            "volume": s.volume, "isovalue": s.isovalue, "vertices": s.vertices, "rms_percent_sh": s.rms_percent[0],
            "rms_percent_photons": s.rms_percent[1],
            "seconds": { "texturing": s.texturing, "direct": s.render, "photons": s.photons },
        })
    };
    let p = &data.printed;
    json!({
        "data_set": data.name, "resolution": data.resolution, "bake_seconds": row.bake,
        "rms_percent_sh": row.mean(|s| s.rms_percent[0]), "rms_percent_photons": row.mean(|s| s.rms_percent[1]),
        "surfaces": row.surfaces.iter().map(of).collect::<Vec<_>>(),
        "thesis": {
            "data_set": p.name, "samples": p.samples, "photons_in_millions": p.photons, "precompute_seconds": p.precompute,
            "texturing_seconds": p.texturing, "render_seconds": p.render, "rms_percent": p.rms_percent,
        },
    })
}
