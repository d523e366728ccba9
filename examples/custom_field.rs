//! A field of one's own: two metaballs, baked and lit; prints how dark the crease between them is.
//!
//! cargo run --release --example custom_field -- balls.isolume

use isolume::geom::Bounds;
use isolume::volume::field::{Field, sample};
use isolume::{Bake, LightOptions, LitOptions, Material, Scene, Session, Silent, glam::DVec3, probe};

struct Metaballs;

impl Field for Metaballs {
    fn name(&self) -> &'static str {
        "metaballs"
    }
    fn value(&self, p: DVec3) -> f64 {
        let ball = |x: f64| 1.0 / (p - DVec3::new(x, 0.0, 0.0)).length_squared().max(1e-6);
        ball(-0.5) + ball(0.5)
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
    let (store, _) = Bake::of(&scene).isovalues([7.0]).run(std::env::args().nth(1).ok_or("name a store")?, &Silent)?;
    let (session, white) = (Session::open(&store)?, probe::open("constant", &Default::default())?);
    let (surface, light) = (session.surface(7.0)?, session.light(&white, &LightOptions::default())?);
    let lit = surface.lit(&light, &Material::new([0.7; 3], [0.0; 3])?, &LitOptions::default())?;
    let darkest = lit.radiance().iter().map(|c| c[0]).fold(f32::INFINITY, f32::min);
    println!("{} vertices, radiance from {darkest:.3} in the crease to 0.7", surface.vertices());
    Ok(())
}
