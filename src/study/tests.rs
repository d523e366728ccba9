use super::front::{Price, cost_at, front};
use super::*;

use crate::level::Pyramid;
use crate::sampling::hash::uniform;
use crate::sampling::statistics::log_log_slope;
use crate::transfer::precision::bytes_of_texel;
use crate::transfer::{Precision, Steps};
use crate::volume::{Volume, field};

fn price(cost: f64, error: f64) -> Price {
    Price { cost, error }
}

#[test]
fn the_front_leaves_out_what_another_beats() {
    let prices = [price(1.0, 5.0), price(2.0, 6.0), price(3.0, 2.0), price(3.0, 3.0), price(4.0, 2.0), price(9.0, 1.0)];
    assert_eq!(front(&prices), [0, 2, 5]);
    assert_eq!(front(&[]), [0usize; 0]);
}

#[test]
fn the_cost_of_an_error_lies_on_the_power_law_between_two_bakes() {
    // Error = cost^−1/2.
    let ladder = [price(4.0, 0.5), price(100.0, 0.1)];
    assert!((cost_at(&ladder, 0.2).unwrap() - 25.0).abs() < 1e-9);
    assert_eq!(cost_at(&ladder, 0.7), Some(4.0));
    assert_eq!(cost_at(&ladder, 0.05), None);
    assert_eq!(cost_at(&[], 0.05), None);
}

#[test]
fn no_time_buys_more_paths_than_a_reference_has() {
    let accuracy = model::Accuracy { noise: [1e-2, 2e-3], floor: 1e-4 };
    let pilot = model::Pilot { rays: [16, 64], seconds_per_texel: [1e-6, 4e-6], accuracy, texels: 8 };
    assert_eq!(pilot.most_within(3600.0).map(|f| f.rays), Some(model::ENOUGH));
    // 8 texels of 1 µs for 16 paths, in proportion.
    assert_eq!(pilot.most_within(8.0e-6).map(|f| f.rays), Some(16));
    assert_eq!(pilot.most_within(1e-9), None);
}

/// Points of a surface, at least `from_box` samples away from the faces of the grid.
fn points(volume: &Volume, isovalue: f64, count: usize, from_box: f32) -> Vec<SurfacePoint> {
    let mesh = crate::surface::extract(volume, isovalue).unwrap();
    let inside = |p: &[f32; 3]| (0..3).all(|a| p[a] > from_box && p[a] < (volume.dims()[a] - 1) as f32 - from_box);
    let all: Vec<usize> = (0..mesh.positions_in_grid.len()).filter(|&i| inside(&mesh.positions_in_grid[i])).collect();
    (0..count)
        .map(|i| {
            let v = all[(uniform(3, i as u64, 0, 0) * all.len() as f32) as usize];
            SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] }
        })
        .collect()
}

fn baked(study: &Study<'_>, bands: &[usize], rays: u32, ratio: f64) -> Baked {
    let setting = Setting {
        estimator: Estimator::Path,
        rays,
        bands: bands.to_vec(),
        ratio: Some(ratio),
        kept_as: Precision::Half,
    };
    study.bake(&setting, 5, &|| [0.0; 2]).unwrap()
}

/// A surface under a light, from which studies of it are made.
struct Ground {
    volume: Volume,
    pyramid: Pyramid,
    isovalue: f64,
    points: Vec<SurfacePoint>,
    probe: crate::probe::Probe,
    coefficients: [Coefficients; 3],
}

impl Ground {
    fn new(volume: Volume, isovalue: f64, count: usize, probe: &str, bands: usize) -> Self {
        let pyramid = Pyramid::new(&volume);
        let points = points(&volume, isovalue, count, 1.0);
        let probe = crate::probe::by_name(probe).unwrap().unwrap();
        let coefficients = probe.coefficients(bands);
        Self { volume, pyramid, isovalue, points, probe, coefficients }
    }

    /// The bump box, in whose valleys light bounces.
    fn bump_box(count: usize, probe: &str) -> Self {
        let mut volume = field::by_name("bumpbox:24").unwrap().unwrap().sample().unwrap();
        volume.shadowing = crate::volume::Shadowing::Traced;
        Self::new(volume, 30.0, count, probe, 2)
    }

    fn source(&self) -> crate::probe::EnvironmentSource<'_> {
        self.probe.source(Default::default())
    }

    fn study<'a>(&'a self, light: &'a dyn DirectionalSource, paths: u32, texel_rays: u32, layers: usize) -> Study<'a> {
        let surface = LitSurface {
            volume: &self.volume,
            pyramid: &self.pyramid,
            geometry: None,
            caustics: true,
            specular: None,
            isovalue: self.isovalue,
            points: &self.points,
            light,
            coefficients: &self.coefficients,
            albedo: [0.7; 3],
            emission: [0.0; 3],
            scales: &[],
            vertices: None,
        };
        Study { surface, paths, texel_rays, layers, seed: 11 }
    }
}

fn assert_rows_sum(found: &Measured) {
    let sum: f64 = found.budget.iter().map(|r| r.mean_square).sum();
    let whole = found.whole.relative_rms.value.powi(2);
    assert!((sum - whole).abs() < 1e-9 * whole.max(1e-9), "{sum} against {whole}");
}

/// What a study reads off a bump box: its noise falls as VALIDATION 26 says of Owen-scrambled points, ambient light,
/// and the rows of its budget sum to the whole.
#[test]
fn noise_falls_with_the_order_of_the_points_and_the_rows_sum_to_the_whole() {
    let ground = Ground::bump_box(200, "constant");
    let source = ground.source();
    // Exact texels with noise of a hundredth of the variance of the best bake.
    let study = ground.study(&source, 64, 8192, 4);
    let lattice = Lattice::from_ratio(ground.volume.dims(), 1.0).unwrap();
    let references = study.references(&[2], &[lattice]).unwrap();
    let mut ladder = Vec::new();
    for rays in [16, 64, 256] {
        let Baked { textures, settings, .. } = baked(&study, &[2; 3], rays, 1.0);
        let found = study.measure(&references, &textures.sources(), Some(&settings), None).unwrap();
        ladder.push((f64::from(rays), found.row("noise").sqrt()));
        assert_rows_sum(&found);
        // Half precision of the stored numbers: 2⁻¹¹ of each.
        assert!(found.row("rounding").sqrt() < 1e-3, "{:?}", found.budget);
    }
    let slope = log_log_slope(&ladder);
    assert!(slope <= -0.7, "slope {slope} of {ladder:?}");
}

/// Fewer bits to a coefficient err no more than their steps allow. A coefficient of layer k is off by at most half a
/// step, s/2 with s = (its largest magnitude)/127 for 8 bits, or 2⁻¹¹ of it for f16; radiance is linear in them, so it
/// is off by at most Σ_k ρ^(k+1) Σ_i |L_i| s_ki/2, and interpolation takes means. The tail multiplies the last layer by
/// 1 + g(r), r = a_K/a_{K−1}: with every bounce darker than the one before, its own change is of the same kind, and is
/// bounded by twice the last layer's term where ρ r ≤ 1/2.
#[test]
fn fewer_bits_err_no_more_than_their_steps() {
    // Under constant light most of this surface has the one number of what is open, which every code hits.
    let ground = Ground::bump_box(300, "gradient");
    let source = ground.source();
    let study = ground.study(&source, 16, 16, 3);
    let lattice = Lattice::from_ratio(ground.volume.dims(), 1.0).unwrap();
    let references = study.references(&[2], &[lattice]).unwrap();
    let layers = Layers::uniform(3, 2).unwrap();
    let Baked { textures, settings, .. } = baked(&study, &[2; 3], 64, 1.0);
    let textures = textures.sources();
    let kinds = [Precision::Single, Precision::Half, Precision::Steps(Steps::TWELVE), Precision::Steps(Steps::BYTE)];
    let found = study.measure_kept_as(&references, &textures, &settings, &kinds).unwrap();
    found.iter().for_each(assert_rows_sum);
    let rounding: Vec<f64> = found.iter().map(|m| m.row("rounding").sqrt()).collect();
    assert_eq!(rounding[0], 0.0);
    let largest = storage::largest_magnitudes(textures[0]).unwrap();
    let mean = means(&references.whole).iter().flatten().sum::<f64>() / 900.0;
    for (precision, rms) in kinds.iter().zip(&rounding) {
        let of_layer = |k: usize| -> f64 {
            let of = |i: usize| f64::from(precision.largest_error(largest[layers.offset(k) + i]));
            let light = ground.coefficients[0].values();
            0.7f64.powi(k as i32 + 1) * (0..4).map(|i| light[i].abs() * of(i)).sum::<f64>()
        };
        let bound = (0..3).map(of_layer).sum::<f64>() + 3.0 * of_layer(2);
        assert!(*rms <= bound / mean, "{}: {rms} above {}", precision.name(), bound / mean);
    }
    // Issue's own figures.
    assert!(rounding[1] <= 0.0005 && rounding[3] <= 0.01, "{rounding:?}");
    // Steps of 1/2047 against steps of 1/127 of the same scale.
    let ratio = rounding[3] / rounding[2];
    assert!((8.0..32.0).contains(&ratio), "{rounding:?}");
    // The runtime's lookup of the stored halves adds nothing to their rounding that would show.
    let stored = study.measure(&references, &textures, Some(&settings), None).unwrap().row("rounding").sqrt();
    assert!((stored / rounding[1] - 1.0).abs() < 0.05, "{stored} against {}", rounding[1]);
    assert_eq!(bytes_of_texel(&layers, Precision::Half), f64::from(2 * 12 + 2 * 6 + 5));
}

/// VALIDATION 25: on a smooth field and away from edges of shadow, interpolation errs as the square of the texel.
#[test]
fn interpolation_errs_as_the_square_of_the_texel() {
    // The outer side of a sphere is convex: transfer is a smooth function of the normal, and no ray is needed.
    let volume = field::by_name("sphere:129").unwrap().unwrap().sample().unwrap();
    let ground = Ground::new(volume, -0.7, 400, "gradient", 3);
    let source = ground.source();
    let study = ground.study(&source, 4, 4, 1);
    let lit = |ratio: f64| {
        let Baked { textures, .. } = baked(&study, &[3], 4, ratio);
        study.surface.by_textures(&textures.sources(), &ground.coefficients).unwrap().0
    };
    // Texels of 16, 8 and 4 samples against those of one, whose own error is the 16th part of the least.
    let finest = lit(1.0);
    let ladder: Vec<(f64, f64)> = [1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0]
        .iter()
        .map(|&ratio| (ratio, mean_square(&lit(ratio), &finest).sqrt()))
        .collect();
    let slope = log_log_slope(&ladder);
    assert!((slope + 2.0).abs() <= 0.3, "slope {slope} of {ladder:?}");
}
