//! A field of one's own: two metaballs, baked in memory and lit; prints how dark the crease between them is.
//!
//! cargo run --release --example custom_field

use glam::DVec3;
use isolume::geom::Bounds;
use isolume::level::Pyramid;
use isolume::relight::{Light, Material, Textures, contract};
use isolume::surface::extract;
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{BRICK, CHUNK, Lattice, Layers, Layout, MemoryTexture};
use isolume::transport::{Bake, Progress, Settings, bake};
use isolume::volume::field::{Field, sample};

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

fn main() -> isolume::Result<()> {
    let (volume, isovalue) = (sample(&Metaballs, [49; 3])?, Metaballs.default_isovalue());
    let layers = Layers::uniform(4, 3)?;
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: layers.clone() };
    let settings = Settings { layers, rays: 256, seed: 0, target: None, positive: false };
    let selection = texels_of_isosurface(&volume, layout.lattice, isovalue);
    let pyramid = Pyramid::new(&volume);
    let request = Bake::new(&volume, &pyramid, &layout, &settings, &selection);

    let mut texture = MemoryTexture::new(layout.clone());
    bake(&request, &request.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, mut groups| {
        const SIDE: usize = CHUNK / BRICK;
        for (i, brick) in groups.swap_remove(0).into_iter().enumerate().filter_map(|(i, b)| Some((i, b?))) {
            let inside = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
            texture.insert(std::array::from_fn(|a| chunk[a] * SIDE + inside[a]), brick)?;
        }
        Ok(())
    })?;

    // Under light from everywhere a convex surface would be as bright as its albedo.
    let (mesh, light, material) =
        (extract(&volume, isovalue)?, Light::constant([1.0; 3]), Material::new([0.7; 3], [0.0; 3])?);
    let contracted = contract(&Textures::of_volume(&texture)?, &selection.bricks(), &light, &material)?;
    let lit = contracted.look_up(&mesh.positions_in_grid, &mesh.normals, &light, &material);
    let darkest = lit.radiance.iter().map(|c| c[0]).fold(f32::INFINITY, f32::min);
    println!("{} vertices, radiance from {darkest:.3} in the crease to 0.7", lit.radiance.len());
    Ok(())
}
