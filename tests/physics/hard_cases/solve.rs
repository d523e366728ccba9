//! Every estimator on a volume, and what must hold of its texels.

use isolume::level::Pyramid;
use isolume::transfer::{
    BRICK, BRICK_TEXELS, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, validity,
};
use isolume::transport::{Bake, ChunkBricks, GatherSettings, Progress, Settings, Summary, bake, gather};
use isolume::volume::Volume;
use isolume::{Error, Result};

/// sqrt(4π): a_k is this times T_k,00.
const ROOT_FOUR_PI: f64 = 3.544_907_701_811_032;

/// The ways to fill a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimator {
    Path,
    Positive,
    Gather,
}

impl Estimator {
    pub const ALL: [Self; 3] = [Self::Path, Self::Positive, Self::Gather];
}

/// A texture of the whole volume.
pub struct Solved {
    pub texture: MemoryTexture,
    pub summary: Summary,
    pub selection: Selection,
}

/// All texels at the resolution of the data: 3 layers of 3 bands, 16 rays.
pub fn solve(volume: &Volume, estimator: Estimator) -> Result<Solved> {
    solve_with(volume, estimator, Layers::uniform(3, 3)?, 16)
}

/// As [`solve`], with layers and rays.
pub fn solve_with(volume: &Volume, estimator: Estimator, layers: Layers, rays: u32) -> Result<Solved> {
    let pyramid = Pyramid::new(volume);
    let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
    let layout = Layout { lattice, layers: layers.clone() };
    let positive = estimator == Estimator::Positive;
    let settings = Settings { layers, rays, seed: 11, positive, target: None };
    let selection = Selection::all(lattice);
    let job = Bake::new(volume, &pyramid, &layout, &settings, &selection);
    let mut texture = MemoryTexture::new(layout.clone());
    let mut sink = |chunk: [usize; 3], mut groups: ChunkBricks| texture.insert_chunk(chunk, groups.swap_remove(0));
    let (chunks, progress) = (job.chunks(), Progress::default());
    let none = |_| Ok::<_, Error>(None);
    let summary = match estimator {
        Estimator::Gather => {
            let passes = GatherSettings { passes: 3, bias_texels: 32, ..GatherSettings::default() };
            gather(&job, &passes, &chunks, &progress, &none, &mut sink)?.summary
        }
        _ => bake(&job, &chunks, &progress, &none, &mut sink)?,
    };
    Ok(Solved { texture, summary, selection })
}

impl Solved {
    /// Finite coefficients and errors; 0 ≤ a_k and Σ a_k ≤ 1 up to the rounding of f16. Returns the number of valid
    /// texels.
    ///
    /// No noise is allowed for: a_k counts paths of weight 1 (its control variate is exact for the constant
    /// harmonic), and a gather takes means of vectors of which the same is true. Each stored a_k is rounded to
    /// f16, 2⁻¹¹ of it, and so is each pass of the cache.
    pub fn check(&self, what: &str) -> u64 {
        let layers = &self.texture.layout().layers;
        let m = self.texture.layout().lattice.texels();
        let n = layers.coefficients();
        let mut valid = 0;
        for index in self.selection.bricks() {
            let view = self.texture.brick(index).unwrap().expect("a brick that was baked");
            for t in 0..BRICK_TEXELS {
                let inner = [t % BRICK, t / BRICK % BRICK, t / BRICK / BRICK];
                if (0..3).any(|a| index[a] * BRICK + inner[a] >= m[a]) {
                    continue;
                }
                let transfer: Vec<f64> = view.transfer[t * n..(t + 1) * n].iter().map(|v| v.to_f64()).collect();
                let errors = &view.stderr[t * layers.errors()..(t + 1) * layers.errors()];
                assert!(transfer.iter().all(|v| v.is_finite()), "{what}: {index:?} {t}: {transfer:?}");
                assert!(errors.iter().all(|v| v.is_finite() && v.to_f32() >= 0.0), "{what}: {index:?} {t}: {errors:?}");
                if view.validity[t] & validity::VALID == 0 {
                    assert!(transfer.iter().all(|&v| v == 0.0), "{what}: an invalid texel that holds something");
                    continue;
                }
                valid += 1;
                let escapes: Vec<f64> = (0..layers.len()).map(|k| ROOT_FOUR_PI * transfer[layers.offset(k)]).collect();
                let sum: f64 = escapes.iter().sum();
                let rounding = 4.0 * 2f64.powi(-11);
                assert!(
                    escapes.iter().all(|&a| a >= 0.0) && sum <= 1.0 + rounding,
                    "{what}: {index:?} {t}: {escapes:?}"
                );
            }
        }
        assert_eq!(valid, self.summary.valid, "{what}");
        assert!(self.summary.escape_stderr_rms().is_finite() && self.summary.lost_share().is_finite(), "{what}");
        valid
    }
}
