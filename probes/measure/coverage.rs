//! How often the 95 % intervals of a bake hold the truth: of a_0, and of radiance under smooth skies at albedo 0.7, at
//! texels and (radiance) at points between texels.
//!
//! `cargo run --release --example measure-coverage -- [TEXELS] [VERTICES] [VOLUME…]` (10000, 500, four volumes)
//!
//! A volume is an analytic field or a file. Truth is a bake of 64 times 256 rays from other random numbers. Texels are
//! drawn uniformly from those of all isosurfaces; those whose replicates are all equal are counted apart. Prints CSV:
//! shares covered; the mean square of the errors over the mean of the stated variances, and over what the stated
//! variance would be if coefficients were uncorrelated.
//!
//! `cargo run --release --example measure-coverage -- scenes [TEXELS] [REFERENCE]` (500, 8192): of scenes with walls, lamps
//! and a second volume, at texels; intervals of the factors for one band (3 degrees of freedom) and for five (15), by the
//! model of today and as if layers, bands and luminaires were independent.

#[path = "coverage_sample.rs"]
mod coverage_sample;
#[path = "coverage_scenes.rs"]
mod coverage_scenes;

use coverage_sample::{Coverage, Place, Subject};
use coverage_scenes::{Covered, SceneSubject};
use isolume::relight::Light;
use isolume::sampling::statistics::half_interval_95;
use std::path::Path;

const SKIES: [&str; 3] = ["gradient", "overcast", "sky"];
const RAYS: [u32; 3] = [16, 64, 256];

fn main() -> isolume::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| args.get(i).and_then(|s| s.parse().ok()).unwrap_or(default);
    if args.first().is_some_and(|a| a == "scenes") {
        return scenes(number(1, 500), number(2, 8192) as u32);
    }
    let (texels, vertices) = (number(0, 10_000), number(1, 500));
    let named: Vec<&str> = args.iter().skip(2).map(String::as_str).collect();
    let data = std::env::var("ISOLUME_DATA").unwrap_or_else(|_| "../shared/data".into());
    let brain = format!("{data}/volumes/mni152_t1_2mm.nii.gz");
    let names = if named.is_empty() { vec!["sphere-over-plane", "bumpbox", "gyroid", &brain] } else { named };
    println!("volume,place,number,rays,places,covered,equal,equal_covered,true_over_stated,true_over_uncorrelated");
    for name in names {
        let volume = match isolume::volume::field::by_name(name)? {
            Some(field) => field.sample()?,
            None => isolume::volume::open(Path::new(name))?,
        };
        let subject = Subject::new(volume)?;
        let name = name.rsplit('/').next().unwrap_or(name);
        let lights = SKIES.iter().map(|sky| subject.light(sky)).collect::<isolume::Result<Vec<_>>>()?;
        let report = |kind: &str, places: &[Place], first: usize| {
            let mut lists = subject.measure(places, &RAYS, 64 * 256, &lights);
            let reference = lists.pop().unwrap_or_default();
            for which in first..=SKIES.len() {
                let number = if which == 0 { "a_0" } else { SKIES[which - 1] };
                for (rays, found) in RAYS.iter().zip(&lists) {
                    let c = Coverage::of(found, &reference, which);
                    println!(
                        "{name},{kind},{number},{rays},{},{:.4},{},{:.4},{:.3},{:.3}",
                        c.places,
                        c.share(),
                        c.equal,
                        c.equal_share(),
                        c.ratio,
                        c.uncorrelated_ratio
                    );
                }
            }
        };
        report("texel", &subject.texels(texels, 2026), 0);
        if vertices > 0 {
            report("vertex", &subject.vertices(vertices, 2027), 1);
        }
    }
    Ok(())
}

/// The lights of a scene: name, sky, and the factor on the power of its luminaires.
fn lights(subject: &SceneSubject, scene: &str) -> isolume::Result<Vec<(String, (Light, f64))>> {
    let mut all = Vec::new();
    if scene != "box" {
        for sky in SKIES {
            all.push((sky.into(), (subject.light(sky)?, 0.0)));
        }
    }
    if scene != "pair" {
        all.push(("lamp".into(), (Light::constant([0.0; 3]), 1.0)));
    }
    if scene == "room" {
        all.push(("overcast and lamp".into(), (subject.light("overcast")?, 0.01)));
    }
    Ok(all)
}

fn scenes(texels: usize, reference: u32) -> isolume::Result<()> {
    println!("scene,light,rays,texels,bands,covered,covered_uncorrelated,true_over_stated,true_over_uncorrelated");
    for scene in ["box", "room", "pair", "fog", "wax"] {
        let subject = SceneSubject::new(scene, texels)?;
        let (names, lights): (Vec<_>, Vec<_>) = lights(&subject, scene)?.into_iter().unzip();
        let truth = subject.measure(reference, 1_000_001, &lights)?;
        for rays in [64, 256] {
            let found = subject.measure(rays, 1, &lights)?;
            for (which, name) in names.iter().enumerate() {
                for bands in [1, 5] {
                    let c = Covered::of(&found, &truth, which, half_interval_95(bands));
                    let share = |n: usize| n as f64 / c.places as f64;
                    let shares = format!("{:.4},{:.4}", share(c.covered), share(c.covered_uncorrelated));
                    let ratios = format!("{:.3},{:.3}", c.ratio, c.ratio_uncorrelated);
                    println!("{scene},{name},{rays},{},{bands},{shares},{ratios}", c.places);
                }
            }
        }
    }
    Ok(())
}
