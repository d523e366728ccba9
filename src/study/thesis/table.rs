//! The data sets of the table, and the table of all of them.

use super::{Effort, OfIsovalue, PRINTED, Printed, ThesisRow, measure, room};
use crate::error::{Error, Result};
use crate::export::atomic;
use crate::quantity::{count, number};
use crate::scene::{Coupling, Member, Scene, VolumeOptions};
use crate::study::Clock;
use crate::volume::{Volume, field};
use serde_json::{Value, json};
use std::path::Path;

/// A data set to measure.
pub struct DataSet {
    /// Its name.
    pub name: String,
    /// Samples along the axes.
    pub resolution: String,
    /// The volumes in their room.
    pub scene: Scene,
    /// Those of the first volume.
    pub isovalues: Vec<f64>,
    /// The row of the thesis that it stands beside.
    pub printed: Printed,
}

/// The data sets: the bump box, stand-ins for nucleons and spray, and a neuron and a brain where a file is given. `size`: most
/// samples along a side.
///
/// # Errors
/// When a file cannot be read, or no surface of it has one of the isovalues.
pub fn data_sets(size: u32, neuron: Option<(&str, &[f64])>, brain: Option<(&str, &[f64])>) -> Result<Vec<DataSet>> {
    let mut all = Vec::new();
    let [bump, nucleon, spray, of_neuron, of_brain] = PRINTED;
    let bumps = named(&format!("bumpbox:{size}"))?;
    all.push(alone("bump box", bumps, vec![10.0, 47.0, 100.0, 150.0], bump, 0.0)?);
    let nucleons = [format!("nucleons:{}", size.min(101)), format!("nucleons-2:{}", size.min(101))];
    all.push(pair("nucleons, a stand-in", &nucleons, vec![24.0, 39.0, 79.0, 170.0], nucleon)?);
    let drops = [format!("spray:{}", size.min(120)), format!("spray-2:{}", size.min(120))];
    all.push(pair("spray, a stand-in", &drops, vec![52.0, 76.0, 112.0, 116.0, 166.0, 201.0], spray)?);
    for (given, printed) in [(neuron, of_neuron), (brain, of_brain)] {
        let Some((file, isovalues)) = given else { continue };
        let member = Member::open(file, &VolumeOptions::default())?;
        let (low, high) = member.volume.value_range();
        if let Some(outside) = isovalues.iter().find(|c| !(low < **c && **c < high)) {
            let expected = format!("isovalues of {file}, from {low} to {high}");
            let remedy = "give others with --neuron-isovalues or --brain-isovalues";
            return Err(Error::argument("isovalue", outside, expected, remedy));
        }
        let volume = Volume::clone(&member.volume);
        all.push(alone(printed.name, volume, isovalues.to_vec(), printed, 0.1)?);
    }
    Ok(all)
}

fn named(spec: &str) -> Result<Volume> {
    let found = field::by_name(spec)?.ok_or_else(|| Error::argument("field", spec, "a field", "see isolume info"))?;
    found.sample()
}

fn resolution(volume: &Volume) -> String {
    let [x, y, z] = volume.dims();
    format!("{x}x{y}x{z}")
}

fn alone(name: &str, volume: Volume, isovalues: Vec<f64>, printed: Printed, margin: f64) -> Result<DataSet> {
    let geometry = room(&volume.world_bounds(), volume.up.axis(), margin)?;
    let resolution = resolution(&volume);
    Ok(DataSet { name: name.into(), resolution, scene: Scene::among(volume, geometry), isovalues, printed })
}

fn pair(name: &str, specs: &[String; 2], isovalues: Vec<f64>, printed: Printed) -> Result<DataSet> {
    let volumes = specs.iter().map(|spec| named(spec)).collect::<Result<Vec<_>>>()?;
    let resolution = resolution(&volumes[0]);
    let geometry = room(&volumes[0].world_bounds(), volumes[0].up.axis(), 0.1)?;
    let scene = Scene::coupled(volumes, &[[1.0; 3]; 2], &Coupling::Equal, Some(geometry))?;
    Ok(DataSet { name: name.into(), resolution, scene, isovalues, printed })
}

/// The table of some data sets.
pub struct ThesisTable {
    /// Each data set and what was found of it.
    pub rows: Vec<(DataSet, ThesisRow)>,
}

impl ThesisTable {
    /// The rows for people, a head first.
    pub fn table(&self) -> Vec<Vec<String>> {
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
        for (data, row) in &self.rows {
            let seconds = |v: f64| format!("{} s", number(v, 3));
            let printed = &data.printed;
            lines.push(vec![
                data.name.clone(),
                data.scene.members().len().to_string(),
                data.resolution.clone(),
                count(row.surfaces.iter().map(|s| s.vertices).sum()),
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
        lines
    }

    /// Measures data sets, with stores in `scratch`; `note` hears of each.
    ///
    /// # Errors
    /// As [`measure`].
    pub fn measure(
        sets: Vec<DataSet>,
        effort: &Effort,
        scratch: &Path,
        clock: &Clock<'_>,
        note: &dyn Fn(&str),
    ) -> Result<Self> {
        let mut rows = Vec::new();
        for (i, data) in sets.into_iter().enumerate() {
            note(&format!("{}, isovalues {:?}", data.name, data.isovalues));
            let path = scratch.join(format!("{i}.isolume"));
            let row = measure(&data.scene, &data.isovalues, effort, &path, clock)?;
            rows.push((data, row));
        }
        Ok(Self { rows })
    }

    /// For programs.
    pub fn to_json(&self) -> Value {
        json!({ "rows": self.rows.iter().map(|(data, row)| row_json(data, row)).collect::<Vec<_>>() })
    }

    /// Writes thesis.csv and thesis.json into a folder that is there.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        atomic::write_bytes(folder.join("thesis.csv"), csv(&self.rows).as_bytes())?;
        atomic::write_bytes(folder.join("thesis.json"), format!("{:#}\n", self.to_json()).as_bytes())
    }
}

const HEAD: &str = "data_set,volume,isovalue,vertices,rms_percent_sh,rms_percent_photons,texturing_seconds,direct_seconds,photon_seconds,\
thesis_rms_percent";

fn csv(rows: &[(DataSet, ThesisRow)]) -> String {
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

fn row_json(data: &DataSet, row: &ThesisRow) -> Value {
    let of = |s: &OfIsovalue| {
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
