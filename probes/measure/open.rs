//! Which share of texels is proven open, what the proof costs, and whether rays agree.
//!
//! `cargo run --release --example measure-open -- [VOLUME…]` prints CSV: for every volume and budget of blocks the texels with a
//! level set, the proven ones, nanoseconds of the proof for a texel, nanoseconds of 64 paths of four layers, and how many of 64
//! cosine-distributed first rays of each proven texel (at most 20,000 of them) met something, beyond one cell or at all.

use glam::Vec3;
use isolume::geom::Frame;
use isolume::level::{Counts, Horizon, LevelField, Outcome, Pyramid, Site};
use isolume::sampling::{PathSampler, warp};
use isolume::transfer::{Lattice, Layers, Layout, Selection};
use isolume::transport::{Bake, Settings, pilot};
use isolume::volume::{Sample, SamplesView, Shadowing, Volume, field, open};
use std::time::Instant;

/// Texels that are looked at, at most.
const MOST_TEXELS: usize = 400_000;
const CHECKED: usize = 20_000;
const RAYS: u32 = 64;
/// Budgets of the proof.
const BLOCKS: [u32; 3] = [16, 64, 256];

fn main() {
    let named: Vec<String> = std::env::args().skip(1).collect();
    let all = ["bumpbox:64", "sphere:64", "sphere:128", "bowl:65", "gyroid:64", "torus:64", "sphere-over-plane:64"];
    let names = if named.is_empty() { all.map(String::from).to_vec() } else { named };
    println!("volume,blocks,valid,proven,share,proof_ns,paths64_ns,rays,hits_beyond_a_cell,hits");
    for name in names {
        let volume = match field::by_name(&name) {
            Ok(Some(field)) => field.sample(),
            _ => open(&name),
        };
        match volume {
            Ok(volume) => measure(&name, volume),
            Err(error) => eprintln!("{error}"),
        }
    }
}

fn measure(name: &str, mut volume: Volume) {
    volume.convex_side = None;
    volume.shadowing = Shadowing::Traced;
    let pyramid = Pyramid::new(&volume);
    let paths = paths_ns(&volume, &pyramid);
    match volume.samples().view() {
        SamplesView::U8(s) => proofs(name, &volume, &LevelField::new(&volume, s, &pyramid), paths),
        SamplesView::I8(s) => proofs(name, &volume, &LevelField::new(&volume, s, &pyramid), paths),
        SamplesView::U16(s) => proofs(name, &volume, &LevelField::new(&volume, s, &pyramid), paths),
        SamplesView::I16(s) => proofs(name, &volume, &LevelField::new(&volume, s, &pyramid), paths),
        SamplesView::F32(s) => proofs(name, &volume, &LevelField::new(&volume, s, &pyramid), paths),
    }
}

/// Nanoseconds of one thread for 64 paths of a valid texel.
fn paths_ns(volume: &Volume, pyramid: &Pyramid) -> f64 {
    let layers = Layers::uniform(4, 5).expect("legal");
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).expect("legal"), layers: layers.clone() };
    let settings = Settings { layers, rays: 64, seed: 1, target: None, positive: false };
    let selection = Selection::of_all_isosurfaces(layout.lattice, volume);
    let bake = Bake::new(volume, pyramid, &layout, &settings, &selection);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(|| {
        let start = Instant::now();
        let summary = pilot(&bake, 4000).expect("a bake");
        start.elapsed().as_secs_f64() * 1e9 / summary.valid.max(1) as f64
    })
}

fn proofs<T: Sample>(name: &str, volume: &Volume, field: &LevelField<'_, T>, paths: f64) {
    let [nx, ny, nz] = volume.dims();
    let count = nx * ny * nz;
    let stride = count.div_ceil(MOST_TEXELS) | 1;
    let at = |i: usize| [i % nx, i / nx % ny, i / nx / ny].map(|v| v as f64);
    let sites: Vec<Site> = (0..count).step_by(stride).filter_map(|i| field.site(at(i))).collect();
    for blocks in BLOCKS {
        proofs_within(name, field, &sites, paths, blocks);
    }
}

fn proofs_within<T: Sample>(name: &str, field: &LevelField<'_, T>, sites: &[Site], paths: f64, blocks: u32) {
    let start = Instant::now();
    let horizon = Horizon::new(field);
    let proven: Vec<&Site> = sites.iter().filter(|site| horizon.proves_open_within(site, blocks)).collect();
    let nanoseconds = start.elapsed().as_secs_f64() * 1e9 / sites.len().max(1) as f64;
    let (mut rays, mut far, mut hits) = (0u64, 0u64, 0u64);
    for (i, site) in proven.iter().step_by(proven.len().div_ceil(CHECKED).max(1)).enumerate() {
        let sampler = PathSampler::new(7, i as u64, 0);
        for ray in 0..RAYS {
            let local = warp::square_to_cosine_hemisphere(sampler.pair(ray, 0));
            let direction: Vec3 = Frame::around(site.normal).from_local(local);
            let in_grid = field.direction_in_grid(direction);
            rays += 1;
            match field.trace(site.isovalue, &site.start, in_grid, &mut Counts::default()) {
                Outcome::Escaped => {}
                Outcome::Lost => hits += 1,
                Outcome::Hit(hit) => {
                    hits += 1;
                    let from = site.start.at.in_grid() - hit.at.in_grid();
                    far += u64::from(from.abs().max_element() > 1.0);
                }
            }
        }
    }
    println!(
        "{name},{blocks},{},{},{:.4},{nanoseconds:.0},{paths:.0},{rays},{far},{hits}",
        sites.len(),
        proven.len(),
        proven.len() as f64 / sites.len().max(1) as f64,
    );
}
