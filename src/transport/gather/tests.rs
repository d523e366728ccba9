use super::super::bake::bake;
use super::*;
use crate::geom::Affine;
use crate::level::Pyramid;
use crate::sh;
use crate::transfer::{Lattice, Layout, Selection};
use crate::volume::{Samples, Volume};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;

/// Samples of `field` on a grid of spacing 1 whose point (0, 0, 0) is `centre`.
fn sampled(dims: [usize; 3], centre: Vec3, field: impl Fn(Vec3) -> f32) -> Volume {
    let [nx, ny, nz] = dims;
    let samples = (0..nx * ny * nz)
        .map(|i| field(Vec3::new((i % nx) as f32, (i / nx % ny) as f32, (i / nx / ny) as f32) - centre))
        .collect();
    let affine = Affine::from_spacing(DVec3::ONE, -centre.as_dvec3()).unwrap();
    Volume::new(dims, Samples::F32(samples), affine).unwrap()
}

/// A volume with all that a bake of it needs.
struct Scene {
    volume: Volume,
    pyramid: Pyramid,
    layout: Layout,
    settings: Settings,
    selection: Selection,
}

type Bricks = BTreeMap<[usize; 3], Brick>;

impl Scene {
    fn new(volume: Volume, layers: Layers, rays: u32) -> Self {
        let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
        Self {
            pyramid: Pyramid::new(&volume),
            layout: Layout { lattice, layers: layers.clone() },
            settings: Settings { layers, rays, seed: 1, positive: false },
            selection: Selection::all(lattice),
            volume,
        }
    }

    fn job(&self) -> Bake<'_> {
        Bake {
            volume: &self.volume,
            pyramid: &self.pyramid,
            layout: &self.layout,
            settings: &self.settings,
            selection: &self.selection,
        }
    }

    fn gather(&self, settings: &GatherSettings, chunks: &[[usize; 3]]) -> Result<(Gathered, Bricks)> {
        let mut bricks = Bricks::new();
        let gathered =
            gather(&self.job(), settings, chunks, &Progress::default(), &|_| Ok(None), &mut |chunk, list| {
                collect(&mut bricks, chunk, list);
                Ok(())
            })?;
        Ok((gathered, bricks))
    }

    fn all(&self, settings: &GatherSettings) -> (Gathered, Bricks) {
        self.gather(settings, &self.job().chunks()).unwrap()
    }

    /// Coefficients of a texel.
    fn transfer(&self, bricks: &Bricks, texel: [usize; 3]) -> Vec<f32> {
        let t = texel[0] % 8 + BRICK * (texel[1] % 8 + BRICK * (texel[2] % 8));
        let n = self.layout.layers.coefficients();
        bricks[&texel.map(|t| t / BRICK)].transfer[t * n..][..n].iter().map(|v| v.to_f32()).collect()
    }

    /// a_k of a texel.
    fn escapes(&self, bricks: &Bricks, texel: [usize; 3]) -> Vec<f64> {
        let t = self.transfer(bricks, texel);
        let root_four_pi = 2.0 * std::f64::consts::PI.sqrt();
        (0..self.layout.layers.len()).map(|k| root_four_pi * f64::from(t[self.layout.layers.offset(k)])).collect()
    }

    fn texels(&self) -> Vec<[usize; 3]> {
        let [mx, my, mz] = self.layout.lattice.texels();
        (0..mx * my * mz).map(|i| [i % mx, i / mx % my, i / mx / my]).collect()
    }
}

fn collect(bricks: &mut Bricks, chunk: [usize; 3], list: Vec<Option<Brick>>) {
    for (b, brick) in list.into_iter().enumerate() {
        if let Some(brick) = brick {
            let inner = [b % 4, b / 4 % 4, b / 16];
            bricks.insert(std::array::from_fn(|a| chunk[a] * 4 + inner[a]), brick);
        }
    }
}

/// Two interlocking waves: valleys that see themselves, with a level set through every texel.
fn waves(dims: [usize; 3]) -> Volume {
    sampled(dims, Vec3::ZERO, |p| 3.0 * (0.5 * p.x).sin() + 2.0 * (0.4 * p.y).sin() - p.z)
}

fn quick() -> GatherSettings {
    GatherSettings { passes: 3, cache_rays: 4, bias_texels: 64, ..GatherSettings::default() }
}

#[test]
fn the_bowl_lets_half_of_the_light_out_at_every_bounce() {
    // VALIDATION 13: f = 1/2 at every point of every hemisphere, so a_k = 2^-(k+1), constant over
    // the texture: interpolation has no bias there.
    let centre = Vec3::new(20.0, 20.0, 20.0);
    let volume = sampled([41, 41, 21], centre, |p| p.length());
    let scene = Scene::new(volume, Layers::uniform(4, 2).unwrap(), 16);
    let (gathered, bricks) = scene.all(&GatherSettings::default());
    let mut sums = [[0.0f64; 2]; 4];
    let mut n = 0.0;
    for texel in scene.texels() {
        let radius = (Vec3::from_array(texel.map(|t| t as f32)) - centre).length();
        if texel[2] < 20 && (10.0..18.0).contains(&radius) {
            for (sum, a) in sums.iter_mut().zip(scene.escapes(&bricks, texel)) {
                sum[0] += a;
                sum[1] += a * a;
            }
            n += 1.0;
        }
    }
    for k in 0..4 {
        let (mean, exact) = (sums[k][0] / n, 0.5f64.powi(k as i32 + 1));
        let deviation = (sums[k][1] / n - mean * mean).sqrt();
        println!("layer {k}: {mean:.5} exact {exact:.5} ratio {:.4} sd {:.4}", mean / exact, deviation);
    }
    println!("{:?} {:?}", gathered.bias, gathered.lookups);
}

#[test]
fn a_convex_sphere_has_the_transfer_of_the_clamped_cosine() {
    let volume = sampled([25, 25, 25], Vec3::splat(12.0), |p| -p.length());
    let scene = Scene::new(volume, Layers::uniform(3, 5).unwrap(), 16);
    let (_, bricks) = scene.all(&quick());
    let (mut exact, mut near) = (0, 0);
    let mut later = 0.0;
    for texel in scene.texels() {
        let p = Vec3::from_array(texel.map(|t| t as f32)) - 12.0;
        if !(4.0..12.0).contains(&p.length()) {
            continue;
        }
        let t = scene.transfer(&bricks, texel);
        let a = scene.escapes(&bricks, texel);
        near += 1;
        later += a[1] + a[2];
        exact += u32::from(a[0] > 0.9999);
        let _ = t;
    }
    println!("{exact} of {near}, later {}", later / f64::from(near));
}
