//! Bakes the light transfer of an analytic field into a store, as `isolume bake` does.
//!
//! cargo run --release --example bake -- target/bumps.isolume

use isolume::level::Pyramid;
use isolume::transfer::store::{ChunkExtent, Identity, Store};
use isolume::transfer::{Lattice, Layers, Layout};
use isolume::transport::{Bake, Progress, Settings, bake};
use isolume::volume::field;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or("target/bumps.isolume".into());

    // The volume: any file through `isolume::volume::open`, or a field by name.
    let named = field::by_name("bumpbox:48")?.ok_or("no such field")?;
    let (volume, isovalue) = (named.sample()?, named.field.default_isovalue());
    let pyramid = Pyramid::new(&volume);

    // What to compute: one texel a sample, direct light and one bounce with 4 bands each, 64 paths a texel,
    // only where the surface of one isovalue looks it up.
    let layers = Layers::uniform(2, 4)?;
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: layers.clone() };
    let settings = Settings { layers, rays: 64, seed: 0, target: None, positive: false };
    let selection = isolume::transfer::texels_of_isosurface(&volume, layout.lattice, isovalue);
    let request =
        Bake { volume: &volume, pyramid: &pyramid, layout: &layout, settings: &settings, selection: &selection };

    // Where it goes: chunk after chunk into a store; a chunk that is there already is handed back by `present`.
    let identity = Identity::new(&volume, &layout, "path", settings.positive, settings.seed);
    let store = Store::open_or_create(&path, &volume, &identity, serde_json::Value::Null)?;
    let extent = ChunkExtent::new(Some(isovalue), settings.rays, None);
    let present = |chunk| Ok(store.read_chunk(chunk)?.map(|(bricks, _)| bricks));
    let mut write = |chunk, bricks| store.write_chunk(chunk, bricks, &extent);
    let summary = bake(&request, &request.chunks(), &Progress::default(), &present, &mut write)?;

    println!("{path}: {} valid texels, {} rays", summary.valid, summary.counts.rays);
    println!("mean chance to escape after exactly 0, 1 bounces: {:.4?}", summary.mean_escapes());
    println!("root mean square standard error of their sum: {:.4}", summary.escape_stderr_rms());
    Ok(())
}
