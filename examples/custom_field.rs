//! A field of one's own: two metaballs, baked; prints how much of the sky they see around each other.
//!
//! cargo run --release --example custom_field -- balls.isolume

use isolume::volume::field::{Field, sample};
use isolume::{Bake, Bounds, Scene, Silent, glam::DVec3};

struct Metaballs;

impl Field for Metaballs {
    fn name(&self) -> &'static str {
        "metaballs"
    }
    fn value(&self, p: DVec3) -> f64 {
        [-0.5, 0.5].iter().map(|x| 1.0 / (p - DVec3::X * x).length_squared().max(1e-6)).sum()
    }
    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::splat(-1.5), max: DVec3::splat(1.5) }
    }
    fn default_isovalue(&self) -> f64 {
        7.0
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = Scene::of(sample(&Metaballs, [49; 3])?);
    let store = std::env::args().nth(1).ok_or("name a store")?;
    let reports = Bake::of(&scene).isovalues([7.0]).run(store, &Silent)?.1;
    println!("{:.1} % of the sky is seen, in the mean", 100.0 * reports[0].summary.mean_escapes()[0]);
    Ok(())
}
