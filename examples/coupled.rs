//! Two volumes that shade and light each other, in one store.
//!
//! cargo run --release --example coupled -- pair.isolume

use glam::{DMat3, DVec3};
use isolume::scene::Coupling;
use isolume::volume::{Volume, field};
use isolume::{Bake, Scene, Silent, glam};

fn named(name: &str, field: &str) -> Result<Volume, Box<dyn std::error::Error>> {
    let mut volume = field::by_name(field)?.ok_or("no such field")?.sample()?;
    volume.name = name.into();
    Ok(volume)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let store = std::env::args().nth(1).ok_or("name a store")?;
    let small = named("gyroid", "gyroid:24")?;
    let small = small.placed(DMat3::from_diagonal(DVec3::splat(0.3)), DVec3::new(0.35, -0.35, 0.35))?;
    // Isovalue 47 of the bumps is shown with 0.6 of the gyroid, which is redder.
    let (tints, coupling) = ([[1.0; 3], [1.0, 0.7, 0.5]], Coupling::Rows(vec![vec![47.0, 0.6]]));
    let scene = Scene::coupled(vec![named("bumps", "bumpbox:32")?, small], &tints, &coupling, None)?;
    let (store, reports) = Bake::of(&scene).isovalues([47.0]).rays(64).run(store, &Silent)?;
    println!("{:?}: {} rays", store.volumes()?, reports.iter().map(|r| r.summary.counts.rays).sum::<u64>());
    Ok(())
}
