//! Time and memory of photon maps: how many photons land, what they take, how long building and searching takes.
//!
//!     cargo run --release --example measure-photons -- FIELD PHOTONS [NEIGHBOURS [FIRST_BOUNCE [QUERIES]]]
//!
//! Prints CSV. Doubling PHOTONS shows that no step is quadratic.

use isolume::level::Pyramid;
use isolume::probe::{Orientation, by_name};
use isolume::sampling::hash::uniform;
use isolume::transport::{
    PhotonLight, PhotonLightSettings, PhotonMap, PhotonScene, PhotonSearch, PhotonSettings, SurfacePoint, photon_direct,
};
use isolume::volume::field;
use std::time::Instant;

/// A line of the process's status, in MB.
fn status(name: &str) -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find(|l| l.starts_with(name));
    line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1e3
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: u32| arguments.get(i).map_or(default, |a| a.parse().expect("a number"));
    let spec = arguments.first().map_or("gyroid:256", String::as_str);
    let (photons, neighbours, first_bounce, queries) =
        (number(1, 10_000_000), number(2, 128), number(3, 0), number(4, 100_000));
    let named = field::by_name(spec).expect("a field").expect("a field");
    let isovalue = named.field.default_isovalue();
    let volume = named.sample().expect("samples");
    let pyramid = Pyramid::new(&volume);
    let before = status("VmRSS:");
    let probe = by_name("courtyard").expect("a probe").expect("a probe");
    let light = probe.source(Orientation::new(volume.up, 0.0).expect("up"));
    let how = if first_bounce == 0 { PhotonLight::All } else { PhotonLight::Indirect };
    let settings = PhotonSettings { photons, kept: how.kept(), memory_limit: 16 << 30, ..PhotonSettings::default() };
    let scene = PhotonScene::alone(&volume, &pyramid, &light);
    let start = Instant::now();
    let map = PhotonMap::new(&scene, &settings).expect("a map");
    let seconds = start.elapsed().as_secs_f64();
    let (after, peak) = (status("VmRSS:"), status("VmHWM:"));
    let mesh = isolume::surface::extract(&volume, isovalue).expect("a surface");
    let n = mesh.positions_in_grid.len();
    let points: Vec<SurfacePoint> = (0..queries)
        .map(|i| (f64::from(uniform(1, u64::from(i), 0, 0)) * n as f64) as usize)
        .map(|v| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] })
        .collect();
    let search = PhotonSearch { neighbours, ..PhotonSearch::default() };
    let reading = PhotonLightSettings { light: how, rays: 4, search, caustics: PhotonSearch::of_caustics(), seed: 1 };
    let start = Instant::now();
    let (found, _) = photon_direct(&scene, isovalue, &points, &map, &reading).expect("light");
    let query = start.elapsed().as_secs_f64() / f64::from(queries) * 1e6;
    let mean = found.iter().map(|r| r.mean[1]).sum::<f64>() / found.len() as f64;
    println!(
        "field,photons,hits,seconds,bytes_a_photon,mb_before,mb_after,mb_peak,neighbours,us_a_query,mean,imbalance"
    );
    println!(
        "{spec},{photons},{},{seconds:.2},{},{before:.0},{after:.0},{peak:.0},{neighbours},{query:.1},{mean:.4},{:.1e}",
        map.len(),
        map.bytes() / map.len().max(1) as u64,
        map.energy().imbalance()
    );
}
