//! A volume in a room with a lamp, baked and described: what comes back from the walls is in its light.
//!
//! cargo run --release --example walls -- room.isolume

use glam::DVec3;
use isolume::scene::geometry::{Finish, Geometry, Luminaire, LuminaireShape, Shape, Wall};
use isolume::volume::field;
use isolume::{Bake, Scene, Silent, glam};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let store = std::env::args().nth(1).ok_or("name a store")?;
    let volume = field::by_name("bumpbox:32")?.ok_or("no such field")?.sample()?;
    let sides = Shape::faces_of_box(DVec3::ZERO, DVec3::ONE, true).into_iter().enumerate();
    let wall = |(i, shape)| Wall { name: format!("side {i}"), shape, finish: Finish::Diffuse([0.7, 0.6, 0.5]) };
    let shape = LuminaireShape::Sphere { centre: DVec3::new(0.5, 0.1, 0.5), radius: 0.05 };
    let lamp = Luminaire { name: "lamp".into(), shape, power: [90.0; 3] };
    let scene = Scene::among(volume, Geometry::new(sides.map(wall).collect(), vec![lamp], 1.0)?);
    let (store, reports) = Bake::of(&scene).isovalues([47.0]).bands(1).rays(64).run(store, &Silent)?;
    println!(
        "{}: {} texels, lit by {:?}",
        store.path().display(),
        reports[0].summary.texels,
        store.identity().groups()
    );
    Ok(())
}
