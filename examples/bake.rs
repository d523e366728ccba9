//! Bakes the light transfer of one isosurface of an analytic field into a store, to an error, as `isolume bake --error` does.
//! Run it again after a Ctrl-C, or after making the file `target/stop`: it goes on where it was.
//!
//! cargo run --release --example bake -- target/bumps.isolume

use isolume::bake::{self, Observer, Request, Task};
use isolume::transfer::{Lattice, Layers, Layout};
use isolume::transport::{Progress, Settings};
use isolume::volume::field;
use std::sync::atomic::Ordering::Relaxed;

struct Watch(std::time::Instant);

impl Observer for Watch {
    fn note(&self, text: &str) {
        println!("{text}");
    }
    fn seconds(&self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }
    fn wants_stop(&self) -> bool {
        std::path::Path::new("target/stop").exists()
    }
    fn watch(&self, _: Task, items: u64, progress: &Progress, work: &mut dyn FnMut()) {
        work(); // A thread may look at `progress` meanwhile.
        println!("{} of {items} texels", progress.texels.load(Relaxed));
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or("target/bumps.isolume".into());
    // The volume: any file through `isolume::volume::open`, or a field by name.
    let named = field::by_name("bumpbox:48")?.ok_or("no such field")?;
    let (volume, isovalue) = (named.sample()?, named.field.default_isovalue());
    // One texel a sample; direct light and one bounce with 4 bands each; at most 256 paths a texel.
    let layers = Layers::uniform(2, 4)?;
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: layers.clone() };
    let settings = Settings { layers, rays: 256, seed: 0, target: None, positive: false };
    let effects = Default::default();
    let mut request = Request::new(&volume, "bumpbox:48", layout, settings, &effects);
    request.isovalues = Some(vec![isovalue]);
    request.goal.error = Some(0.02);
    let (store, report) = bake::run(&request, &path, &Watch(std::time::Instant::now()))?;
    println!("{path}: {} chunks written, {} kept", report.chunks_baked, report.chunks_kept);
    println!("standard error of each texel: {:?}", store.asked()?.claims()[0].target);
    Ok(())
}
