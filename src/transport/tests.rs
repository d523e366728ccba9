use super::*;
use crate::geom::Affine;
use crate::level::Pyramid;
use crate::sh;
use crate::transfer::{BRICK, BRICK_TEXELS, Brick, Lattice, Layers, Layout, Selection};
use crate::volume::{Samples, Volume};
use glam::{DVec3, Vec3};
use std::f32::consts::PI;

/// Samples of `field` on a grid of spacing 1 whose point (0, 0, 0) is `centre`.
fn sampled(dims: [usize; 3], centre: Vec3, field: impl Fn(Vec3) -> f32) -> Volume {
    let [nx, ny, nz] = dims;
    let samples = (0..nx * ny * nz)
        .map(|i| field(Vec3::new((i % nx) as f32, (i / nx % ny) as f32, (i / nx / ny) as f32) - centre))
        .collect();
    let affine = Affine::from_spacing(DVec3::ONE, -centre.as_dvec3()).unwrap();
    Volume::new(dims, Samples::F32(samples), affine).unwrap()
}

struct Baked {
    lattice: Lattice,
    layers: Layers,
    bricks: std::collections::BTreeMap<[usize; 3], Brick>,
    summary: Summary,
}

fn bake_all(volume: &Volume, settings: &Settings) -> Baked {
    let pyramid = Pyramid::new(volume);
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
    let layout = Layout { lattice, layers: settings.layers.clone() };
    let selection = Selection::all(lattice);
    let job = Bake { volume, pyramid: &pyramid, layout: &layout, settings, selection: &selection };
    let mut bricks = std::collections::BTreeMap::new();
    let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, list| {
        for (b, brick) in list.into_iter().enumerate() {
            if let Some(brick) = brick {
                let inner = [b % 4, b / 4 % 4, b / 16];
                bricks.insert(std::array::from_fn(|a| chunk[a] * 4 + inner[a]), brick);
            }
        }
        Ok(())
    })
    .unwrap();
    Baked { lattice, layers: settings.layers.clone(), bricks, summary }
}

impl Baked {
    /// Coefficients, errors and validity of a texel.
    fn texel(&self, texel: [usize; 3]) -> (Vec<f32>, Vec<f32>, u8) {
        let brick = &self.bricks[&texel.map(|t| t / BRICK)];
        let inner = texel.map(|t| t % BRICK);
        let t = inner[0] + BRICK * (inner[1] + BRICK * inner[2]);
        assert!(t < BRICK_TEXELS);
        let (c, e) = (self.layers.coefficients(), self.layers.errors());
        let floats = |s: &[half::f16]| s.iter().map(|v| v.to_f32()).collect();
        (floats(&brick.transfer[t * c..][..c]), floats(&brick.stderr[t * e..][..e]), brick.validity[t])
    }
}

fn settings(layers: usize, rays: u32) -> Settings {
    Settings { layers: Layers::uniform(layers, 5).unwrap(), rays, seed: 1, positive: false, target: None }
}

#[test]
fn the_bowl_lets_half_of_the_light_out_at_every_bounce() {
    // VALIDATION 13: f = 1/2 at every point of every hemisphere, so a_k = 2^-(k+1).
    let volume = sampled([65, 65, 33], Vec3::new(32.0, 32.0, 32.0), |p| p.length());
    let baked = bake_all(&volume, &settings(4, 64));
    let mut sums = [0.0f64; 4];
    let mut n = 0;
    let [mx, my, mz] = baked.lattice.texels();
    for z in 0..mz - 1 {
        for y in 0..my {
            for x in 0..mx {
                let radius = (Vec3::new(x as f32, y as f32, z as f32) - 32.0).length();
                if (12.0..30.0).contains(&radius) {
                    let (t, _, valid) = baked.texel([x, y, z]);
                    assert_eq!(valid & 1, 1);
                    for k in 0..4 {
                        sums[k] += f64::from(t[k * 25] * 2.0 * PI.sqrt());
                    }
                    n += 1;
                }
            }
        }
    }
    for k in 0..4 {
        let (mean, expected) = (sums[k] / n as f64, 0.5f64.powi(k as i32 + 1));
        println!("bowl layer {k}: {mean:.5} expected {expected:.5} ratio {:.4}", mean / expected);
    }
    println!("{:?}", baked.summary.counts);
    println!("lost {}", baked.summary.lost_share());
}

#[test]
fn a_convex_sphere_has_the_transfer_of_the_clamped_cosine() {
    let volume = sampled([33, 33, 33], Vec3::splat(16.0), |p| -p.length());
    let baked = bake_all(&volume, &settings(1, 64));
    let (mut sum, mut norm) = (0.0f64, 0.0f64);
    for z in 0..33 {
        for y in 0..33 {
            for x in 0..33 {
                let p = Vec3::new(x as f32, y as f32, z as f32) - 16.0;
                if !(5.0..16.0).contains(&p.length()) {
                    continue;
                }
                let (t, _, _) = baked.texel([x, y, z]);
                let mut y = [0.0f32; 25];
                sh::basis::evaluate_f32(5, p.normalize(), &mut y);
                for l in 0..5 {
                    for i in l * l..(l + 1) * (l + 1) {
                        let exact = y[i] * (sh::CLAMPED_COSINE[l] as f32) / PI;
                        sum += f64::from((t[i] - exact).powi(2));
                        norm += f64::from(exact.powi(2));
                    }
                }
            }
        }
    }
    println!("sphere RMS of T: {:.4} %  lost {}", 100.0 * (sum / norm).sqrt(), baked.summary.lost_share());
}
