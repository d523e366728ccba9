use super::super::bake::bake;
use super::super::path::{Scratch, Settings, TexelEstimate, estimate as estimate_path};
use super::bias::{self, Sampled, pick};
use super::cache::{Cache, cached_layers};
use super::estimate::Pass;
use super::*;
use crate::geom::Affine;
use crate::grid3;
use crate::level::{Counts, Pyramid};
use crate::sh;
use crate::transfer::{BRICK, Brick, Lattice, Layout, Selection};
use crate::volume::{Samples, Volume};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;

/// Relative rounding of f16.
const HALF: f64 = 1.0 / 2048.0;

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
            settings: Settings { layers, rays, seed: 1, positive: false, target: None },
            selection: Selection::all(lattice),
            volume,
        }
    }

    fn job(&self) -> Bake<'_> {
        Bake::new(&self.volume, &self.pyramid, &self.layout, &self.settings, &self.selection)
    }

    fn gather(&self, settings: &GatherSettings, chunks: &[[usize; 3]]) -> Result<(Gathered, Bricks)> {
        let mut bricks = Bricks::new();
        let gathered =
            gather(&self.job(), settings, chunks, &Progress::default(), &|_| Ok(None), &mut |chunk, list| {
                collect(&mut bricks, chunk, list.concat());
                Ok(())
            })?;
        Ok((gathered, bricks))
    }

    fn all(&self, settings: &GatherSettings) -> (Gathered, Bricks) {
        self.gather(settings, &self.job().chunks()).unwrap()
    }

    fn path(&self) -> Bricks {
        let mut bricks = Bricks::new();
        let job = self.job();
        bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, list| {
            collect(&mut bricks, chunk, list.concat());
            Ok(())
        })
        .unwrap();
        bricks
    }

    /// Coefficients of a texel, if it is valid.
    fn transfer(&self, bricks: &Bricks, texel: [usize; 3]) -> Option<Vec<f64>> {
        let brick = &bricks[&texel.map(|t| t / BRICK)];
        let t = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
        let n = self.layout.layers.coefficients();
        let values = brick.transfer[t * n..][..n].iter().map(|v| f64::from(v.to_f32()));
        (brick.validity[t] & 1 == 1).then(|| values.collect())
    }

    /// a_k of a texel, if it is valid.
    fn escapes(&self, bricks: &Bricks, texel: [usize; 3]) -> Option<Vec<f64>> {
        let t = self.transfer(bricks, texel)?;
        let root_four_pi = 2.0 * std::f64::consts::PI.sqrt();
        Some((0..self.layout.layers.len()).map(|k| root_four_pi * t[self.layout.layers.offset(k)]).collect())
    }

    fn texels(&self) -> Vec<[usize; 3]> {
        let [mx, my, mz] = self.layout.lattice.texels();
        grid3::all([mx, my, mz]).collect()
    }

    /// Runs `body` with the field of the volume.
    fn with_field<R>(&self, body: impl FnOnce(&LevelField<'_, f32>) -> R) -> R {
        let Samples::F32(samples) = self.volume.samples() else { unreachable!("`sampled` makes f32") };
        body(&LevelField::new(&self.volume, samples, &self.pyramid))
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

/// Crossed waves: valleys that see themselves, a level set through every texel.
fn waves(dims: [usize; 3]) -> Volume {
    sampled(dims, Vec3::ZERO, |p| 6.0 * libm::sinf(0.5 * p.x) + 4.0 * libm::sinf(0.4 * p.y) - p.z)
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
    let scene = Scene::new(volume, Layers::uniform(4, 1).unwrap(), 16);
    let (gathered, bricks) = scene.all(&GatherSettings { passes: 5, ..GatherSettings::default() });
    let mut sums = [[0.0f64; 2]; 4];
    let mut n = 0.0;
    for texel in scene.texels() {
        let radius = (Vec3::from_array(texel.map(|t| t as f32)) - centre).length();
        if texel[2] < 20 && (10.0..18.0).contains(&radius) {
            for (sum, a) in sums.iter_mut().zip(scene.escapes(&bricks, texel).unwrap()) {
                sum[0] += a;
                sum[1] += a * a;
            }
            n += 1.0;
        }
    }
    for k in 0..4 {
        let (mean, exact) = (sums[k][0] / n, 0.5f64.powi(k as i32 + 1));
        let error = ((sums[k][1] / n - mean * mean) / n).sqrt();
        // The trilinear sphere of radius c deviates from the round one by up to (1/8) Σ ∂²h = 1/(4c), its
        // open fraction by that over 2c at most: 1/(4c²) of f = 1/2, once for every segment.
        // Texels share the noise of the cache, one of 64 rays for each: as much again as their own.
        let tolerance = exact * (k + 1) as f64 / (4.0 * 100.0) + 3.0 * 2.0f64.sqrt() * error;
        assert!((mean - exact).abs() < tolerance, "layer {k}: {mean:.5}, not {exact} ± {tolerance:.5}");
    }
    let b = gathered.bias;
    assert!(b.texels > 400 && b.mean_stderr > 0.0);
    assert_eq!(gathered.lookups.neighbourhood + gathered.lookups.continued, 0, "every texel is there");
}

#[test]
fn a_convex_sphere_has_the_transfer_of_the_clamped_cosine() {
    let volume = sampled([25, 25, 25], Vec3::splat(12.0), |p| -p.length());
    let scene = Scene::new(volume, Layers::new(vec![5, 2, 3]).unwrap(), 16);
    let (_, bricks) = scene.all(&quick());
    scene.with_field(|field| {
        for texel in scene.texels() {
            let radius = (Vec3::from_array(texel.map(|t| t as f32)) - 12.0).length();
            if !(4.0..12.0).contains(&radius) {
                continue;
            }
            // Every ray escapes, so the control variate leaves the closed form and nothing else.
            let site = field.site(texel.map(|t| t as f64)).unwrap();
            let t = scene.transfer(&bricks, texel).unwrap();
            let mut y = [0.0f32; 25];
            sh::basis::evaluate_f32(5, site.normal.vec(), &mut y);
            for l in 0..5 {
                for i in l * l..(l + 1) * (l + 1) {
                    let exact = f64::from(y[i]) * sh::CLAMPED_COSINE[l] / std::f64::consts::PI;
                    // f16, and f32 sums of 16 basis values below 1.5 each.
                    let tolerance = HALF * exact.abs() + 16.0 * 1.5 * f64::from(f32::EPSILON);
                    assert!((t[i] - exact).abs() <= tolerance, "{texel:?} {i}: {} not {exact}", t[i]);
                }
            }
            assert!(t[25..].iter().all(|&v| v == 0.0), "{texel:?} sees nothing, so reflects nothing");
        }
    });
}

#[test]
fn layer_0_is_that_of_path_and_the_others_lie_within_the_noise() {
    let scene = Scene::new(waves([24, 24, 16]), Layers::uniform(3, 3).unwrap(), 64);
    let (_, gathered) = scene.all(&quick());
    let path = scene.path();
    let (mut difference, mut level, mut n) = ([0.0f64; 3], [0.0f64; 3], 0.0);
    for texel in scene.texels() {
        let (Some(a), Some(b)) = (scene.transfer(&gathered, texel), scene.transfer(&path, texel)) else { continue };
        assert_eq!(a[..9], b[..9], "{texel:?}");
        for k in 0..3 {
            difference[k] += a[9 * k] - b[9 * k];
            level[k] += b[9 * k];
        }
        n += 1.0;
    }
    assert!(n > 9000.0 && level[1] / level[0] > 0.1, "the waves see themselves: {level:?}");
    for k in 1..3 {
        // Means over 9216 texels: a texel's noise is at most 100 % of the layer at 64 rays, 1 % in
        // the mean with its sign; the rest is bias of interpolation over 2–3 voxels of a
        // wave of 12, of second order: (1/8)(2π/12)² = 3.4 % of what varies, per lookup.
        let share = difference[k] / level[k];
        assert!(share.abs() < 0.01 + 0.034 * k as f64, "layer {k} is off by {share:.4}");
    }
}

#[test]
fn a_texel_never_lets_out_more_than_came_in() {
    // Each state of the cache is a convex combination of vectors with Σ a ≤ 1; f16 rounds each of
    // three cached states by at most one part in 2048 and the output once more.
    for (positive, precision) in [(false, CachePrecision::Half), (true, CachePrecision::Single)] {
        let mut scene = Scene::new(waves([16, 16, 16]), Layers::uniform(6, 2).unwrap(), 8);
        scene.settings.positive = positive;
        let (_, bricks) = scene.all(&GatherSettings { passes: 4, precision, ..quick() });
        let mut most = 0.0f64;
        for a in scene.texels().into_iter().filter_map(|t| scene.escapes(&bricks, t)) {
            assert!(a.iter().all(|&a| a >= 0.0), "{a:?}");
            most = most.max(a.iter().sum());
        }
        assert!(most > 0.9 && most <= 1.0 + 4.0 * HALF, "{most}");
    }
}

#[test]
fn the_bytes_do_not_depend_on_threads_or_on_the_chunks_asked_for() {
    // Two chunks along x.
    let scene = Scene::new(waves([36, 9, 9]), Layers::new(vec![3, 2, 2]).unwrap(), 8);
    let with_threads = |threads: usize, chunks: &[[usize; 3]]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| scene.gather(&quick(), chunks).unwrap())
    };
    let (one, bricks) = with_threads(1, &[[0, 0, 0], [1, 0, 0]]);
    assert_eq!(bricks.len(), 5 * 2 * 2);
    let bits = |b: &Bricks| -> Vec<u16> { b.values().flat_map(|b| &b.transfer).map(|v| v.to_bits()).collect() };
    for threads in [2, 3] {
        let (many, again) = with_threads(threads, &[[0, 0, 0], [1, 0, 0]]);
        assert_eq!((one.bias, one.lookups, &one.summary), (many.bias, many.lookups, &many.summary));
        assert_eq!(bits(&bricks), bits(&again));
    }
    let (second, mut parts) = with_threads(2, &[[1, 0, 0]]);
    assert_eq!(second.bias, one.bias);
    parts.extend(with_threads(2, &[[0, 0, 0]]).1);
    assert_eq!(bits(&bricks), bits(&parts));
}

#[test]
fn too_little_memory_is_refused_with_the_amount() {
    let scene = Scene::new(waves([9, 9, 9]), Layers::uniform(4, 5).unwrap(), 16);
    // 8 bricks of 512 texels: two copies of 75 f16 and two flags, 24 B for each brick's place and 4 for
    // its slot; and twice the output of 200 + 40 + 5 B.
    let texels = 8 * 512;
    let expected = texels * (2 * 75 * 2 + 2) + 8 * 28 + 2 * texels * (200 + 40 + 5);
    assert_eq!(gather_memory(&scene.job(), &quick()), expected);
    let one_copy = GatherSettings { passes: 2, ..quick() };
    assert_eq!(gather_memory(&scene.job(), &one_copy), expected - texels * 75 * 2);
    let enough = GatherSettings { memory_limit: expected, ..quick() };
    assert_eq!(scene.all(&enough).0.memory, expected);
    let short = GatherSettings { memory_limit: expected - 1, ..quick() };
    let error = scene.gather(&short, &scene.job().chunks()).err().unwrap();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("4 MiB") && message.contains("729 texels") && message.contains("path"), "{message}");
}

#[test]
fn senseless_settings_are_refused_by_name() {
    let scene = Scene::new(waves([9, 9, 9]), Layers::uniform(2, 1).unwrap(), 16);
    for (settings, name) in [
        (GatherSettings { passes: 1, ..quick() }, "passes"),
        (GatherSettings { cache_rays: 12, ..quick() }, "cache rays"),
        (GatherSettings { cache_rays: 2, ..quick() }, "cache rays"),
    ] {
        let message = scene.gather(&settings, &[]).err().unwrap().to_string();
        assert!(message.starts_with(name), "{message}");
    }
}

#[test]
fn the_bias_estimate_finds_a_bias_put_into_the_cache() {
    // A cache that is 20 % too bright adds 20 % of Σ_{k≥1} ρ^(k+1) a_k. The sample without and
    // with it has the same numbers, so their difference holds that and nothing else.
    let scene = Scene::new(waves([24, 24, 12]), Layers::uniform(3, 1).unwrap(), 64);
    let cached = cached_layers(&scene.layout.layers).unwrap();
    let lattice = &scene.layout.lattice;
    scene.with_field(|field| {
        let (job, how, progress) = (scene.job(), GatherSettings { bias_texels: 400, ..quick() }, Progress::default());
        let asked =
            Asked { field, bake: &job, settings: &how, chunks: &[], progress: &progress, present: &|_| Ok(None) };
        let (mut cache, _) = asked.fill_alone(&cached).unwrap();
        let texels = pick(&cache, lattice, scene.settings.seed, 400);
        assert!((380..=400).contains(&texels.len()), "{} texels", texels.len());
        let told = |cache: &Cache| asked.bias_alone(cache, &cached).0;
        let plain = told(&cache);
        cache.scale(1.2);
        let bright = told(&cache);
        // Direct light in the sample, by path, to get at what later layers add.
        let direct = Settings { layers: Layers::uniform(1, 1).unwrap(), rays: 256, ..scene.settings.clone() };
        let mut out = TexelEstimate::default();
        let mut sum = 0.0;
        for &t in &texels {
            let site = field.site(lattice.grid_from_texel(t)).unwrap();
            estimate_path(field, &site, 0, &direct, &mut Scratch::default(), &mut Counts::default(), &mut out);
            sum += bias::ambient(&out.transfer, &direct.layers);
        }
        let later = plain.ambient - sum / texels.len() as f64;
        assert!(later > 0.03, "{later}");
        let error = plain.mean_stderr.hypot(bright.mean_stderr);
        assert!(
            (bright.mean - plain.mean - 0.2 * later).abs() < 0.1 * 0.2 * later + error,
            "{bright:?} {plain:?} {later}"
        );
        // It is told as significant, and the RMS cannot be below the mean by more than noise.
        assert!(bright.mean > 5.0 * bright.mean_stderr, "{bright:?}");
        assert!(bright.square > bright.mean.powi(2) - 3.0 * bright.square_stderr);
    });
    let same = Sampled { gathered: [0.4; 2], traced: [0.4; 2] };
    assert_eq!(Bias::of(&[same; 3]).rms_difference_stderr, 0.0);
}

#[test]
fn where_nothing_is_cached_paths_go_on() {
    // An empty cache: every hit goes on as a path, by the numbers that path uses for its first two rays (later
    // ones take points by their rank among the paths that are left). Without the control variate, which a pass has for
    // first rays alone.
    let scene = Scene::new(waves([16, 16, 16]), Layers::uniform(2, 2).unwrap(), 16);
    let cached = cached_layers(&scene.layout.layers).unwrap();
    let cache = Cache::new(&Selection::empty(scene.layout.lattice), cached.coefficients(), CachePrecision::Half);
    let settings = Settings { positive: true, ..scene.settings.clone() };
    let pass = Pass::new(&cache, &cached, settings.clone());
    let (mut a, mut b) = (TexelEstimate::default(), TexelEstimate::default());
    let (mut scratch, mut lookups, mut reflected) = (Scratch::default(), Lookups::default(), 0.0);
    scene.with_field(|field| {
        for (item, texel) in scene.texels().into_iter().enumerate().step_by(7) {
            let Some(site) = field.site(texel.map(|t| t as f64)) else { continue };
            let (mut with, mut without) = (Counts::default(), Counts::default());
            pass.estimate(field, &site, item as u64, &mut scratch, &mut with, &mut lookups, &mut a);
            estimate_path(field, &site, item as u64, &settings, &mut scratch, &mut without, &mut b);
            assert_eq!((with, a.lost, a.trapped), (without, b.lost, b.trapped));
            reflected += a.transfer[4];
            for (a, b) in a.transfer.iter().zip(&b.transfer) {
                // Sums of at most 16 values below 1 in another order.
                assert!((a - b).abs() <= 16.0 * f32::EPSILON, "{texel:?}: {a} {b}");
            }
        }
    });
    assert!(reflected > 1.0 && lookups.continued == lookups.lookups, "{lookups:?}");
}

#[test]
fn one_layer_needs_no_cache_and_a_cancelled_gather_hands_out_nothing() {
    let scene = Scene::new(waves([9, 9, 9]), Layers::uniform(1, 3).unwrap(), 16);
    let (gathered, traced) = (scene.all(&quick()).1, scene.path());
    for texel in scene.texels() {
        assert_eq!(scene.transfer(&gathered, texel), scene.transfer(&traced, texel));
    }
    let scene = Scene::new(waves([9, 9, 9]), Layers::uniform(2, 1).unwrap(), 16);
    let progress = Progress::default();
    progress.cancel.store(true, Ordering::Relaxed);
    let job = scene.job();
    let mut called = false;
    let mut sink = |_, _| {
        called = true;
        Ok(())
    };
    let gathered = gather(&job, &quick(), &job.chunks(), &progress, &|_| Ok(None), &mut sink).unwrap();
    assert!(!called && gathered.bias == Bias::default());
}
