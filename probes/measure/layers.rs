//! What each layer of a texel errs, and whether its stated errors say so.
//!
//! `cargo run --release --example measure-layers -- [TEXELS] [REFERENCE] [VOLUME[@ISOVALUE]…]` (2000, 4096, a table of nine)
//!
//! A volume is an analytic field or a file; its texels are drawn from those that a lookup on the isosurface reads, or from
//! those of all isosurfaces. Truth is `REFERENCE` paths from other random numbers. Prints CSV, one line for a volume, a
//! number of rays and a layer: the RMS error of its coefficients, the same without any control variate, that of a_k, the RMS
//! of the errors stated for a_k over it, the same of the bands above 0, the share of the 95 % intervals of a_k that hold the truth,
//! and the microseconds of processor time that a texel took with all its layers, with the control variate and without.

#[path = "layer_sample.rs"]
mod layer_sample;

use cpu_time::ProcessTime;
use layer_sample::{Row, Sample};

const RAYS: [u32; 4] = [16, 64, 256, 1024];

fn main() -> isolume::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| args.get(i).and_then(|s| s.parse().ok()).unwrap_or(default);
    let (texels, reference) = (number(0, 2000), number(1, 4096) as u32);
    let data = std::env::var("ISOLUME_DATA").unwrap_or_else(|_| "../shared/data".into());
    let file = |name: &str| format!("{data}/volumes/{name}");
    let mut names: Vec<String> = args.into_iter().skip(2).collect();
    if names.is_empty() {
        names = vec![
            file("mni152_t1_2mm.nii.gz@90"),
            file("emd_3197.map@2"),
            file("caffeine_density.nrrd@0.05"),
            file("rna_1jzv.ccp4@0.8"),
            file("purkinje_neuron.nrrd@45"),
        ];
        names.extend(["gyroid:48", "bowl:48", "sphere-over-plane:48", "bumpbox:48"].map(String::from));
    }
    println!(
        "volume,rays,layer,texels,rms,rms_without,rms_a,stated_over_true,stated_over_true_above,covered,microseconds,\
         microseconds_without"
    );
    for name in names {
        let sample = Sample::open(&name, texels)?;
        let truth = sample.estimates(reference, 1_000_001)?;
        let name = name.rsplit('/').next().unwrap_or(&name);
        for rays in RAYS {
            let timed = |positive: bool| -> isolume::Result<_> {
                let clock = ProcessTime::now();
                let found = sample.estimates_of(rays, 1, positive)?;
                let microseconds = 1e6 * clock.elapsed().as_secs_f64() / found.len() as f64;
                Ok((found, microseconds))
            };
            let ((found, time), (without, time_without)) = (timed(false)?, timed(true)?);
            for k in 0..sample.layers() {
                let Row { rms, rms_a, stated_over_true, covered, above } = sample.row(k, &found, &truth);
                let rms_without = sample.row(k, &without, &truth).rms;
                let texels = found.len();
                let errors =
                    format!("{rms:.5},{rms_without:.5},{rms_a:.5},{stated_over_true:.3},{above:.3},{covered:.4}");
                println!("{name},{rays},{k},{texels},{errors},{time:.1},{time_without:.1}");
            }
        }
    }
    Ok(())
}
