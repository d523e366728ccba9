use super::front::{Price, cost_at, front};
use super::*;

use crate::sampling::hash::uniform;
use crate::sampling::statistics::log_log_slope;
use crate::transfer::{BRICK, CHUNK, MemoryTexture};
use crate::transport::{Progress, bake};
use crate::volume::field;

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

fn baked(study: &Study<'_>, settings: &Settings, ratio: f64) -> MemoryTexture {
    let lattice = Lattice::from_ratio(study.volume.dims(), ratio).unwrap();
    let layout = Layout { lattice, layers: settings.layers.clone() };
    let selection = texels_of_isosurface(study.volume, lattice, study.isovalue);
    let (volume, pyramid) = (study.volume, study.pyramid);
    let job = Bake { volume, pyramid, layout: &layout, settings, selection: &selection };
    let mut texture = MemoryTexture::new(layout.clone());
    bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, bricks| {
        const SIDE: usize = CHUNK / BRICK;
        for (i, brick) in bricks.into_iter().enumerate() {
            let place = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
            if let Some(brick) = brick {
                texture.insert(std::array::from_fn(|a| chunk[a] * SIDE + place[a]), brick)?;
            }
        }
        Ok(())
    })
    .unwrap();
    texture
}

fn settings(rays: u32, layers: &Layers) -> Settings {
    Settings { layers: layers.clone(), rays, seed: 5, target: None, positive: false }
}

/// What a study reads off a bump box: its noise falls as VALIDATION 26 says of Owen-scrambled points, ambient light,
/// and the rows of its budget sum to the whole.
#[test]
fn noise_falls_with_the_order_of_the_points_and_the_rows_sum_to_the_whole() {
    let mut volume = field::by_name("bumpbox:24").unwrap().unwrap().sample().unwrap();
    volume.shadowing = crate::volume::Shadowing::Traced;
    let pyramid = Pyramid::new(&volume);
    let isovalue = 30.0;
    let points = points(&volume, isovalue, 200, 1.0);
    let probe = crate::probe::by_name("constant").unwrap().unwrap();
    let coefficients = probe.coefficients(2);
    let source = probe.source(Default::default());
    let study = Study {
        volume: &volume,
        pyramid: &pyramid,
        isovalue,
        points: &points,
        light: &source,
        coefficients: &coefficients,
        albedo: [0.7; 3],
        paths: 64,
        // Noise of a hundredth of the variance of the best bake.
        texel_rays: 8192,
        layers: 4,
        seed: 11,
    };
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
    let references = study.references(&[2], &[lattice]).unwrap();
    let layers = Layers::uniform(3, 2).unwrap();
    let mut ladder = Vec::new();
    for rays in [16, 64, 256] {
        let settings = settings(rays, &layers);
        let texture = baked(&study, &settings, 1.0);
        let found = study.measure(&references, &texture, Some(&settings), None).unwrap();
        ladder.push((f64::from(rays), found.row("noise").sqrt()));
        let sum: f64 = found.budget.iter().map(|r| r.mean_square).sum();
        let whole = found.whole.relative_rms.value.powi(2);
        assert!((sum - whole).abs() < 1e-9 * whole.max(1e-9), "{sum} against {whole}");
        // Half precision of the stored numbers: 2⁻¹¹ of each.
        assert!(found.row("rounding").sqrt() < 1e-3, "{:?}", found.budget);
    }
    let slope = log_log_slope(&ladder);
    assert!(slope <= -0.7, "slope {slope} of {ladder:?}");
}

/// VALIDATION 25: on a smooth field and away from edges of shadow, interpolation errs as the square of the texel.
#[test]
fn interpolation_errs_as_the_square_of_the_texel() {
    // The outer side of a sphere is convex: transfer is a smooth function of the normal, and no ray is needed.
    let volume = field::by_name("sphere:129").unwrap().unwrap().sample().unwrap();
    let pyramid = Pyramid::new(&volume);
    let isovalue = -0.7;
    let points = points(&volume, isovalue, 400, 1.0);
    let probe = crate::probe::by_name("gradient").unwrap().unwrap();
    let coefficients = probe.coefficients(3);
    let source = probe.source(Default::default());
    let study = Study {
        volume: &volume,
        pyramid: &pyramid,
        isovalue,
        points: &points,
        light: &source,
        coefficients: &coefficients,
        albedo: [0.7; 3],
        paths: 4,
        texel_rays: 4,
        layers: 1,
        seed: 11,
    };
    let layers = Layers::uniform(1, 3).unwrap();
    let lit = |ratio: f64| study.looked_up(&baked(&study, &settings(4, &layers), ratio), &coefficients).unwrap();
    // Texels of 16, 8 and 4 samples against those of one, whose own error is the 16th part of the least.
    let finest = lit(1.0);
    let ladder: Vec<(f64, f64)> = [1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0]
        .iter()
        .map(|&ratio| (ratio, mean_square(&lit(ratio), &finest).sqrt()))
        .collect();
    let slope = log_log_slope(&ladder);
    assert!((slope + 2.0).abs() <= 0.3, "slope {slope} of {ladder:?}");
}
