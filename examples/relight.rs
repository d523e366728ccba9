//! Lights isosurfaces of a store by several environments, and writes each as .glb. No file but the store and
//! the results.
//!
//! cargo run --release --example bake -- target/bumps.isolume
//! cargo run --release --example relight -- target/bumps.isolume 30

use isolume::{LightOptions, LitOptions, Material, MeshOptions, Session, Store, probe};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let store = Store::open(arguments.next().unwrap_or("target/bumps.isolume".into()))?;
    let isovalues = arguments.map(|c| c.parse()).collect::<Result<Vec<f64>, _>>()?;
    let session = Session::open(&store)?;
    for isovalue in if isovalues.is_empty() { store.holdings()?.isovalues } else { isovalues } {
        let surface = session.surface(isovalue)?;
        for name in ["sunset", "studio"] {
            let probe = probe::by_name(name)?.ok_or("no such environment")?;
            let light = session.light(&probe, &LightOptions::default())?;
            let material = Material::new([0.7, 0.6, 0.5], [0.0; 3])?;
            let lit = surface.lit(&light, &material, &LitOptions::default())?;
            let path = format!("target/lit-{isovalue}-{name}.glb");
            lit.write_gltf(&path, &MeshOptions::default())?;
            println!("{path}: {} vertices, noise {:.1} %", surface.vertices(), 100.0 * lit.rms_over_mean());
        }
    }
    Ok(())
}
