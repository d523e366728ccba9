//! What lighting lamps apart gains: radiance at vertices against path tracing under the whole image, with and without.
//!
//! `cargo run --release --example measure-lamps -- STORE ISOVALUE VERTICES PATHS PROBE...`
//!
//! CSV, one row for each probe and choice of lamps: relative RMS without the reference's noise, bias, the stated noise (RMS
//! over the mean), 95th and 99th percentile of the distance in u′v′ where luminance is above 2 % of its mean, of vertices as
//! they are shown and with channels below 0 set to 0, vertices with such a channel, visibility rays a vertex, and the time of
//! contraction and lookup.

use isolume::compare::unburied;
use isolume::geom::Up;
use isolume::probe::{self, Orientation, Probe};
use isolume::relight::{Exposure, Material, without_negative};
use isolume::scene::SunSplit;
use isolume::session::{LightOptions, Session};
use isolume::transfer::store::Store;
use isolume::transport::{Radiance, SceneReference, SurfacePoint, direct};
use std::time::Instant;

const ALBEDO: f32 = 0.7;

/// u′v′ of CIE 1976 of linear Rec.709.
fn uv([r, g, b]: [f64; 3]) -> [f64; 2] {
    let x = 0.4124 * r + 0.3576 * g + 0.1805 * b;
    let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let z = 0.0193 * r + 0.1192 * g + 0.9505 * b;
    let all = x + 15.0 * y + 3.0 * z;
    [4.0 * x / all, 9.0 * y / all]
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// 95th and 99th percentile of the distance in u′v′ where the reference is bright enough.
fn chroma(found: &[[f64; 3]], reference: &[Radiance]) -> [f64; 2] {
    let mean = reference.iter().map(|r| luminance(r.mean)).sum::<f64>() / reference.len() as f64;
    let pairs = found.iter().zip(reference).filter(|(f, r)| luminance(r.mean) > 0.02 * mean && luminance(**f) > 0.0);
    let distance = |(f, r): (&[f64; 3], &Radiance)| {
        let ([u, v], [s, t]) = (uv(*f), uv(r.mean));
        ((u - s).powi(2) + (v - t).powi(2)).sqrt()
    };
    let mut all: Vec<f64> = pairs.map(distance).collect();
    all.sort_by(f64::total_cmp);
    [0.95, 0.99].map(|q| all.get(((all.len().max(1) - 1) as f64 * q) as usize).copied().unwrap_or(0.0))
}

fn main() -> isolume::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [store, isovalue, vertices, paths, probes @ ..] = arguments.as_slice() else {
        println!("give STORE ISOVALUE VERTICES PATHS PROBE...");
        return Ok(());
    };
    let number = |text: &String| text.parse::<f64>().unwrap_or(0.0);
    let (isovalue, vertices, paths) = (number(isovalue), number(vertices) as usize, number(paths) as u32);
    let store = Store::open(store)?;
    let session = Session::open(&store)?;
    let surface = session.surface(isovalue)?;
    let member = &session.members()[0];
    let (volume, mesh) = (member.volume(), surface.parts()[0].isosurface().mesh());
    let stride = (mesh.positions_in_grid.len() / vertices.max(1)).max(1);
    let picked: Vec<usize> = (0..mesh.positions_in_grid.len()).step_by(stride).collect();
    let point = |&v: &usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
    let points = unburied(volume, member.pyramid(), None, isovalue, picked.iter().map(point).collect());
    let material = Material::new([ALBEDO; 3], [0.0; 3])?;
    println!(
        "volume,isovalue,environment,lamps,count,share,rms,bias,stated,uv95,uv99,clamped_uv99,negative,of,rays_a_vertex,seconds"
    );
    for name in probes {
        let probe: Probe = probe::open(name, &Default::default())?;
        let up: Up = session.up();
        let source = probe.source(Orientation::new(up, 0.0)?);
        let settings = SceneReference::new(paths, [ALBEDO; 3], 5);
        let (found, _) = direct(volume, member.pyramid(), None, isovalue, &points, &[&source], &settings)?;
        let reference = &found[0];
        let count = (3 * reference.len()) as f64;
        let mean = reference.iter().flat_map(|r| r.mean).sum::<f64>() / count;
        let noise = reference.iter().flat_map(|r| r.stderr).map(|e| e * e).sum::<f64>() / count;
        for split in [SunSplit::Off, SunSplit::Auto] {
            let mut options = LightOptions::default();
            options.split_sun = split;
            let light = session.light(&probe, &options)?;
            let start = Instant::now();
            let lit = surface.contract(&light, &material, &[])?.look_up(Exposure::Percentile)?;
            let seconds = start.elapsed().as_secs_f64();
            let at = |v: &usize| lit.radiance()[*v];
            let radiance: Vec<[f64; 3]> = picked.iter().map(|v| at(v).map(f64::from)).collect();
            let differences = || radiance.iter().zip(reference).flat_map(|(a, r)| (0..3).map(|c| a[c] - r.mean[c]));
            let square = differences().map(|d| d * d).sum::<f64>() / count;
            let bias = differences().sum::<f64>() / count;
            let shown: Vec<_> = picked.iter().map(|v| without_negative(at(v)).map(f64::from)).collect();
            let clamped: Vec<_> = picked.iter().map(|v| at(v).map(|x| f64::from(x.max(0.0)))).collect();
            let [[uv95, uv99], [_, clamped_uv99]] = [chroma(&shown, reference), chroma(&clamped, reference)];
            let flux: f64 = light.suns().iter().map(|s| luminance(s.flux)).sum();
            let whole = luminance(probe.image.mean()) * 4.0 * std::f64::consts::PI;
            println!(
                "{},{isovalue},{},{split},{},{:.3},{:.4},{:.4},{:.4},{uv95:.4},{uv99:.4},{clamped_uv99:.4},{},{},{:.1},{seconds:.3}",
                volume.name,
                probe.name,
                light.suns().len(),
                flux / whole,
                (square - noise).max(0.0).sqrt() / mean,
                bias / mean,
                lit.rms_over_mean(),
                lit.negative_vertices(),
                lit.radiance().len(),
                lit.sun_rays() as f64 / lit.radiance().len() as f64,
            );
        }
    }
    Ok(())
}
