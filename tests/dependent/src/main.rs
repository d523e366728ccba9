//! Bakes an array and lights it, with the public interface alone.

use isolume::glam::DVec3;
use isolume::level::Pyramid;
use isolume::relight::{Light, Material, Textures, contract};
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{Lattice, Layers, Layout, MemoryTexture};
use isolume::transport::{Bake, ChunkBricks, Progress, Settings, bake};
use isolume::volume::{Samples, Volume};

fn main() -> isolume::Result<()> {
    let distance = |i: usize| (DVec3::new((i % 16) as f64, (i / 16 % 16) as f64, (i / 256) as f64) - 7.5).length();
    let samples = Samples::F32((0..4096).map(|i| 10.0 - distance(i) as f32).collect());
    let volume = Volume::new([16; 3], samples, isolume::geom::Affine::IDENTITY)?;
    let (pyramid, layers) = (Pyramid::new(&volume), Layers::uniform(1, 3)?);
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: layers.clone() };
    let settings = Settings { layers, rays: 64, seed: 0, target: None, positive: false };
    let selection = texels_of_isosurface(&volume, layout.lattice, 5.0);
    let job = Bake::new(&volume, &pyramid, &layout, &settings, &selection);
    let mut texture = MemoryTexture::new(layout.clone());
    let mut keep = |chunk, mut groups: ChunkBricks| texture.insert_chunk(chunk, groups.swap_remove(0));
    bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut keep)?;

    let (mesh, light) = (isolume::surface::extract(&volume, 5.0)?, Light::constant([1.0; 3]));
    let material = Material::new([0.5; 3], [0.0; 3])?;
    let lit = contract(&Textures::of_volume(&texture)?, &selection.bricks(), &light, &material)?;
    let radiance = lit.look_up(&mesh.positions_in_grid, &mesh.normals, &light, &material).radiance;
    let mean = radiance.iter().map(|c| c[1]).sum::<f32>() / radiance.len() as f32;
    println!("{} vertices, mean radiance {mean:.4}", radiance.len());
    // A convex solid under light of 1 from everywhere is as bright as its albedo.
    assert!((mean - 0.5).abs() < 0.005, "a mean radiance of 0.5, found {mean}");
    Ok(())
}
