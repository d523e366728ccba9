//! How far textures are from another one of the same volume, between its texels, too.
//!
//!     cargo run --release --example measure-texture -- REFERENCE.isolume STORE.isolume…
//!
//! At every texel of the reference with a level set: the trilinear mean of the other's texels, as lookups weigh them, against
//! the reference; root mean square of 0.7^(k+1) T_k over that of the reference, in percent. Prints CSV: texels that were baked and
//! that were filled in, texels of the reference without a value, the difference, and the noise of the reference alone.

use isolume::Result;
use isolume::transfer::store::Store;
use isolume::transfer::{BRICK_TEXELS, Brick, BrickSource, Lattice, Layers, validity};

/// A texture in memory.
struct Texture {
    lattice: Lattice,
    count: usize,
    bricks: Vec<Option<Brick>>,
}

impl Texture {
    fn open(path: &str) -> Result<Self> {
        let store = Store::open(path)?;
        let lattice = store.layout().lattice;
        let [x, y, z] = lattice.bricks();
        let at = |i: usize| [i % x, i / x % y, i / x / y];
        let bricks = (0..x * y * z).map(|i| Ok(store.brick(at(i))?.map(|view| view.to_brick())));
        Ok(Self { lattice, count: store.layout().layers.coefficients(), bricks: bricks.collect::<Result<_>>()? })
    }

    /// Texels that were baked, and that were filled in.
    fn counts(&self) -> [usize; 2] {
        let mut counts = [0; 2];
        for brick in self.bricks.iter().flatten() {
            for t in (0..BRICK_TEXELS).filter(|t| !brick.transfer[t * self.count].is_nan()) {
                counts[usize::from(brick.validity[t] & validity::FILLED != 0)] += 1;
            }
        }
        counts
    }

    /// The trilinear mean at a grid position; `None` where no texel around it has a level set.
    fn look_up(&self, position: [f64; 3], out: &mut Vec<f64>) -> Option<()> {
        let m = self.lattice.texels();
        let place: [f64; 3] = std::array::from_fn(|a| position[a] / self.lattice.step(a));
        let low: [usize; 3] = std::array::from_fn(|a| (place[a] as usize).min(m[a].saturating_sub(2)));
        let [bx, by, _] = self.lattice.bricks();
        out.clear();
        out.resize(self.count, 0.0);
        let mut weights = 0.0;
        for corner in 0..8usize {
            let texel: [usize; 3] = std::array::from_fn(|a| (low[a] + (corner >> a & 1)).min(m[a] - 1));
            let weight: f64 = (0..3)
                .map(|a| {
                    let fraction = place[a] - low[a] as f64;
                    if corner >> a & 1 == 1 { fraction } else { 1.0 - fraction }
                })
                .product();
            let (brick, t) = self.lattice.place_of(texel);
            let Some(brick) = &self.bricks[brick[0] + bx * (brick[1] + by * brick[2])] else { continue };
            if weight > 0.0 && brick.validity[t] & validity::VALID != 0 {
                let texel = &brick.transfer[t * self.count..(t + 1) * self.count];
                out.iter_mut().zip(texel).for_each(|(sum, v)| *sum += weight * v.to_f64());
                weights += weight;
            }
        }
        out.iter_mut().for_each(|sum| *sum /= weights);
        (weights > 0.0).then_some(())
    }
}

/// 0.7^(k+1) for each coefficient of a grey texture.
fn weights(layers: &Layers) -> Vec<f64> {
    let each = layers.bands().iter().enumerate();
    each.flat_map(|(k, bands)| std::iter::repeat_n(0.7f64.powi(k as i32 + 1), bands * bands)).collect()
}

/// Sum of the squares of the standard errors of a texel, weighed alike.
fn noise(layers: &Layers, errors: &[half::f16]) -> f64 {
    let mut sum = 0.0;
    for (k, &bands) in layers.bands().iter().enumerate() {
        for l in 0..bands {
            let error = errors[layers.error_offset(k) + l].to_f64();
            sum += 0.7f64.powi(2 * (k as i32 + 1)) * (2 * l + 1) as f64 * error * error;
        }
    }
    sum
}

fn main() -> Result<()> {
    let mut paths = std::env::args().skip(1);
    let (reference, others) = (paths.next().unwrap_or_default(), paths.collect::<Vec<_>>());
    let layers = Store::open(&reference)?.layout().layers.clone();
    let (weights, reference) = (weights(&layers), Texture::open(&reference)?);
    let (n, e) = (layers.coefficients(), layers.errors());
    println!("store,baked,filled,without_value,difference_percent,noise_of_reference_percent");
    for path in others {
        let other = Texture::open(&path)?;
        let [baked, filled] = other.counts();
        let (mut squares, mut differences, mut noises, mut without) = (0.0, 0.0, 0.0, 0);
        let mut found = Vec::new();
        let [bx, by, _] = reference.lattice.bricks();
        for (i, brick) in reference.bricks.iter().enumerate() {
            let Some(brick) = brick else { continue };
            for t in (0..BRICK_TEXELS).filter(|&t| brick.validity[t] & validity::VALID != 0) {
                let texel = reference.lattice.texel_in_brick([i % bx, i / bx % by, i / bx / by], t);
                if other.look_up(reference.lattice.grid_from_texel(texel), &mut found).is_none() {
                    without += 1;
                    continue;
                }
                for ((w, truth), found) in weights.iter().zip(&brick.transfer[t * n..(t + 1) * n]).zip(&found) {
                    squares += (w * truth.to_f64()).powi(2);
                    differences += (w * (truth.to_f64() - found)).powi(2);
                }
                noises += noise(&layers, &brick.stderr[t * e..(t + 1) * e]);
            }
        }
        let percent = |sum: f64| 100.0 * (sum / squares).sqrt();
        println!("{path},{baked},{filled},{without},{:.3},{:.3}", percent(differences), percent(noises));
    }
    Ok(())
}
