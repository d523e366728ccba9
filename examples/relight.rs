//! Lights a surface from a store by two environments: no rays, no file but the store and the results.
//!
//! cargo run --release --example bake -- target/bumps.isolume
//! cargo run --release --example relight -- target/bumps.isolume 30

use isolume::export::{ExportMesh, Positions, atomic, gltf};
use isolume::probe::{Orientation, by_name};
use isolume::relight::{Exposure, Light, Material, Textures, contract};
use isolume::surface::extract;
use isolume::transfer::store::Store;
use isolume::transfer::texels_of_isosurface;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or("target/bumps.isolume".into());
    let isovalue: f64 = arguments.next().map_or(Ok(30.0), |c| c.parse())?;

    let store = Store::open(&path)?;
    let volume = store.volume()?;
    let mesh = extract(&volume, isovalue)?;
    let bricks = texels_of_isosurface(&volume, store.layout().lattice, isovalue).bricks();
    let world = |p: &[f32; 3]| volume.world_from_grid().point(glam::DVec3::from_array(p.map(f64::from)));
    let positions: Vec<glam::DVec3> = mesh.positions_in_grid.iter().map(world).collect();
    let normals: Vec<glam::Vec3> = mesh.normals.iter().map(|&n| n.into()).collect();

    for name in ["sunset", "sun:40,50"] {
        let probe = by_name(name)?.ok_or("no such environment")?;
        let bands = store.layout().layers.max_bands();
        let [r, g, b] = probe.coefficients_in_world(bands, Orientation::new(volume.up, 0.0)?);
        let rgb = (0..bands * bands).map(|i| [r.values()[i], g.values()[i], b.values()[i]]);
        let light = Light::new(rgb.collect())?;
        let material = Material::new([0.7, 0.6, 0.5], [0.0; 3])?;

        let contracted = contract(&Textures::of_volume(&store)?, &bricks, &light, &material)?;
        let lit = contracted.look_up(&mesh.positions_in_grid, &mesh.normals, &light, &material);
        let colours = Exposure::apply(Exposure::Percentile.factor(&lit.radiance), &lit.radiance);

        let out = format!("target/lit-{}.glb", name.replace([':', ','], "_"));
        let mesh = ExportMesh {
            name,
            positions: Positions::World(&positions),
            normals_in_world: &normals,
            triangles: &mesh.triangles,
            colours: &colours,
            radiance: None,
            standard_error: None,
            box_in_world: volume.world_bounds(),
            up: volume.up,
            metres_per_unit: None,
        };
        atomic::write(&out, |w| gltf::write(w, &mesh, &Default::default()))?;
        println!("{out}: {} vertices, noise {:.1} %", colours.len(), 100.0 * contracted.noise.relative());
    }
    Ok(())
}
