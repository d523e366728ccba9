//! Bakes a volume to a standard error of 2 %, watched, and stops after a minute: run it again, and it goes on where it was.
//!
//! cargo run --release --example bake -- brain.nii.gz 90 brain.isolume

use isolume::bake::Task;
use isolume::{Bake, Observer, Progress, Scene};
use std::{sync::atomic::Ordering, time::Duration, time::Instant};

struct Watch(Instant);

impl Observer for Watch {
    fn wants_stop(&self) -> bool {
        self.0.elapsed() > Duration::from_secs(60)
    }
    fn watch(&self, _: Task, items: u64, progress: &Progress, work: &mut dyn FnMut()) {
        work();
        println!("{} of {items} texels", progress.texels.load(Ordering::Relaxed));
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [volume, isovalue, store] =
        std::env::args().skip(1).collect::<Vec<_>>().try_into().map_err(|_| "three words")?;
    let bake =
        Bake::of(&Scene::open(volume)?).isovalues([isovalue.parse()?]).error(0.02).run(store, &Watch(Instant::now()));
    println!("error of half of the texels at most {:.4}", bake?.1[0].summary.errors.quantile(0.5));
    Ok(())
}
