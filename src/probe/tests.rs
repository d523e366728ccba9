use super::latlong::{angles_from_direction, direction_from_angles, luminance};
use super::*;
use crate::geom::{Direction, Up};
use crate::sampling::{DirectionalSource, hash, statistics};
use crate::sh::project::gauss_legendre;
use crate::sh::{self, MAX_BANDS, basis};
use glam::DVec3;
use std::f64::consts::PI;

/// A file of the shared data, or `None` with a printed reason.
pub(super) fn data(file: &str) -> Option<Vec<u8>> {
    let root = std::env::var("ISOLUME_DATA")
        .map_or_else(|_| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), Into::into);
    let path = root.join("probes").join(file);
    let bytes = std::fs::read(&path).ok();
    if bytes.is_none() {
        println!("skipped: {} is absent", path.display());
    }
    bytes
}

fn random_image(width: usize, height: usize, seed: u64) -> LatLong {
    LatLong::from_fn(width, height, |x, y| {
        std::array::from_fn(|c| f64::from(hash::uniform(seed, (y * width + x) as u64, 0, c as u32)))
    })
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

fn relative_difference(a: &Coefficients, b: &Coefficients) -> f64 {
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut a.values().iter().zip(b.values()).map(|(x, y)| x - y)) / norm(&mut b.values().iter().copied())
}

#[test]
fn a_constant_is_exact_at_any_resolution() {
    for (width, height) in [(1, 1), (2, 1), (1, 5), (7, 3), (64, 32), (33, 200), (2048, 1024)] {
        let image = LatLong::from_fn(width, height, |_, _| [1.0, 0.5, 100.0]);
        let coefficients = project(&image, MAX_BANDS);
        for (c, radiance) in [1.0, 0.5, 100.0].into_iter().enumerate() {
            let mut expected = vec![0.0; basis::count(MAX_BANDS)];
            expected[0] = radiance * (4.0 * PI).sqrt();
            let error = largest_difference(coefficients[c].values(), &expected) / radiance;
            assert!(error < 1e-12, "{width}x{height}: {error:e}");
        }
    }
}

/// The slow twin, from the definition: each pixel times the integral of each basis function over
/// it, by quadrature in both angles.
#[test]
fn projection_equals_the_integral_over_each_pixel() {
    let image = random_image(7, 5, 1);
    let nodes = gauss_legendre(16);
    let mut expected = vec![vec![0.0; basis::count(MAX_BANDS)]; 3];
    let mut values = vec![0.0; basis::count(MAX_BANDS)];
    for y in 0..5 {
        let [top, bottom] = image.row_latitudes(y);
        for x in 0..7 {
            for (u, wu) in &nodes {
                for (v, wv) in &nodes {
                    let longitude = PI * (1.0 - 2.0 * (x as f64 + 0.5 + 0.5 * u) / 7.0);
                    let latitude = 0.5 * (top + bottom) + 0.5 * (top - bottom) * v;
                    let weight = PI / 7.0 * wu * 0.5 * (top - bottom) * wv * latitude.cos();
                    basis::evaluate(MAX_BANDS, direction_from_angles(longitude, latitude).to_array(), &mut values);
                    for c in 0..3 {
                        for (sum, basis) in expected[c].iter_mut().zip(&values) {
                            *sum += weight * basis * f64::from(image.row(y)[x][c]);
                        }
                    }
                }
            }
        }
    }
    let found = project(&image, MAX_BANDS);
    for c in 0..3 {
        let error = largest_difference(found[c].values(), &expected[c]);
        assert!(error < 1e-12, "{error:e}");
        // Fewer bands are a prefix.
        let few = project(&image, 3);
        assert!(largest_difference(few[c].values(), &found[c].values()[..9]) < 1e-13);
    }
}

#[test]
fn harmonics_project_on_themselves_with_second_order() {
    // Each Y_lm sampled at pixel centres; the image is constant over a pixel, so the error is
    // that of the midpoint rule and falls 4 times a doubling.
    let errors: Vec<f64> = [32, 64, 128]
        .into_iter()
        .map(|height| {
            let mut worst: f64 = 0.0;
            for l in 0..=4usize {
                for m in -(l as isize)..=l as isize {
                    let mut unit = vec![0.0; basis::count(5)];
                    unit[sh::index(l, m)] = 1.0;
                    let function = Coefficients::new(5, unit.clone()).unwrap();
                    let blank = LatLong::from_fn(2 * height, height, |_, _| [0.0; 3]);
                    let image = LatLong::from_fn(2 * height, height, |x, y| {
                        [function.evaluate(blank.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5)); 3]
                    });
                    worst = worst.max(largest_difference(project(&image, 5)[0].values(), &unit));
                }
            }
            worst
        })
        .collect();
    assert!(errors[1] < 1e-2, "{errors:?}");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.1, "{errors:?}");
    }
    // cos of the angle to the zenith is one coefficient of sqrt(4π/3).
    let (linear, exact) = sky::by_name("gradient:2").unwrap().unwrap();
    let expected = exact.unwrap().coefficients(5);
    assert!((expected.values()[1] - (4.0 * PI / 3.0).sqrt()).abs() < 1e-14);
    let found = project(&linear, 5);
    assert!(largest_difference(found[1].values(), expected.values()) < 1e-4);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let image = random_image(120, 61, 2);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| project(&image, 6)).map(|c| c.values().iter().map(|v| v.to_bits()).collect::<Vec<_>>())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn coefficients_turn_into_world_with_the_light() {
    let probe = by_name("sun:30,20,40").unwrap().unwrap();
    for up in [Up::X, Up::Y, Up::Z, Up::NegX, Up::NegY, Up::NegZ, Up::Anatomical] {
        let orientation = Orientation::new(up, 25.0).unwrap();
        let in_probe = probe.coefficients(5);
        let in_world = probe.coefficients_in_world(5, orientation);
        let source = probe.source(orientation);
        for i in 0..50u64 {
            let variate = |d| f64::from(hash::uniform(3, i, 0, d));
            let d = direction_from_angles(2.0 * PI * variate(0), (2.0 * variate(1) - 1.0).asin());
            let turned = orientation.probe_from_world() * d;
            let difference = in_world[0].evaluate(d) - in_probe[0].evaluate(turned);
            assert!(difference.abs() < 1e-11, "{up:?} {difference:e}");
            // The source and the coefficients agree on where the disk is, but for its rim.
            let apart = turned.dot(direction_from_angles(30f64.to_radians(), 20f64.to_radians())).acos().to_degrees();
            let radiance = source.radiance(Direction::new(d.as_vec3()).unwrap())[0];
            if (apart - 20.0).abs() > 1.0 {
                assert_eq!(radiance > 0.0, apart < 20.0, "{up:?} {apart}");
            }
        }
    }
    // Azimuth 30 + 25 about world z, counted from world +x counter-clockwise: towards +y.
    let world = probe.coefficients_in_world(2, Orientation::new(Up::Z, 25.0).unwrap());
    let v = world[0].values();
    let mean_direction = DVec3::new(v[3], v[1], v[2]).normalize();
    let (a, e) = (55f64.to_radians(), 20f64.to_radians());
    assert!((mean_direction - DVec3::new(a.cos() * e.cos(), a.sin() * e.cos(), e.sin())).length() < 1e-12);
}

#[test]
fn sources_draw_in_proportion_to_luminance() {
    // Each pixel is split into 2 × 2 cells of the probe frame; the expectation follows from the
    // definition of the density alone. Two images, two orientations: Šidák over four tests.
    const DRAWS: u32 = 100_000;
    let spiked = LatLong::from_fn(16, 8, |x, y| if (x, y) == (3, 0) { [1e6; 3] } else { [0.0, (x * y) as f64, 0.0] });
    let tests = [(random_image(16, 8, 5), 1u64), (spiked, 2)];
    for (image, seed) in &tests {
        for orientation in [Orientation::default(), Orientation::new(Up::NegX, 77.0).unwrap()] {
            let source = EnvironmentSource::new(image, orientation);
            let power: f64 =
                (0..8).flat_map(|y| image.row(y).iter().map(move |p| luminance(*p) * image.pixel_solid_angle(y))).sum();
            let mut observed = vec![0.0; 16 * 8 * 4];
            let mut estimates = [statistics::Running::new(); 3];
            for i in 0..DRAWS {
                let u = [hash::uniform(*seed, 7, i, 0), hash::uniform(*seed, 7, i, 1)];
                let sample = source.sample(u).unwrap();
                let in_probe = orientation.probe_from_world() * sample.direction.vec().as_dvec3();
                let [x, y] = image.pixel_from_direction(in_probe);
                let (_, latitude) = angles_from_direction(in_probe);
                let [top, bottom] = image.row_latitudes((y as usize).min(7)).map(f64::sin);
                let lower = (latitude.sin() - top) / (bottom - top) >= 0.5;
                let cell = ((y as usize).min(7) * 2 + usize::from(lower)) * 32 + ((2.0 * x) as usize).min(31);
                observed[cell] += 1.0;
                assert!(sample.density > 0.0 && sample.density.is_finite());
                for c in 0..3 {
                    estimates[c].push(f64::from(sample.radiance[c]) / f64::from(sample.density));
                }
            }
            let expected: Vec<f64> = (0..observed.len())
                .map(|cell| {
                    let (x, y) = (cell % 32 / 2, cell / 64);
                    f64::from(DRAWS) * luminance(image.row(y)[x]) * image.pixel_solid_angle(y) / 4.0 / power
                })
                .collect();
            // f32 directions may cross into a black neighbour: such cells are left to the rest.
            let (observed, expected): (Vec<f64>, Vec<f64>) =
                observed.iter().zip(&expected).filter(|(_, e)| **e > 0.0).unzip();
            let result = statistics::chi_square_test(&observed, &expected);
            assert!(result.p > statistics::sidak(1e-3, 4), "{result:?}");
            // The mean over the draws is ∫ L dω = 4π times the mean, for each channel.
            for c in 0..3 {
                let exact = 4.0 * PI * image.mean()[c];
                let error = (estimates[c].mean() - exact).abs();
                let z = error / estimates[c].standard_error().max(1e-7 * exact.max(1e-30));
                assert!(statistics::normal_two_sided(z) > statistics::sidak(1e-3, 12), "{c}: z = {z}");
            }
        }
    }
}

#[test]
fn densities_integrate_to_one_and_invert() {
    let image = random_image(9, 5, 8);
    let orientation = Orientation::new(Up::X, 10.0).unwrap();
    let source = EnvironmentSource::new(&image, orientation);
    let mut total = 0.0;
    for y in 0..5 {
        for x in 0..9 {
            let d = orientation.world_from_probe() * image.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5);
            let d = Direction::new(d.as_vec3()).unwrap();
            total += f64::from(source.density(d)) * image.pixel_solid_angle(y);
            assert_eq!(source.radiance(d), image.row(y)[x]);
        }
    }
    // 45 densities rounded to f32.
    assert!((total - 1.0).abs() < 1e-7, "{total}");
    for i in 0..1000 {
        let u = [hash::uniform(1, 2, i, 0), hash::uniform(1, 2, i, 1)];
        let sample = source.sample(u).unwrap();
        let back = source.inverse(sample.direction).unwrap();
        // Directions are f32 (6e-8 relative); near the poles longitude loses the factor cos β.
        for k in 0..2 {
            assert!((back[k] - f64::from(u[k])).abs() < 2e-5, "{u:?} {back:?}");
        }
        assert_eq!(source.density(sample.direction), sample.density);
    }
    for u in [[0.0, 0.0], [0.999_999_94, 0.999_999_94], [1.0, 1.0]] {
        assert!(source.sample(u).unwrap().density > 0.0);
    }
}

#[test]
fn black_and_single_pixel_probes_are_harmless() {
    let black = Probe::from_image("black", LatLong::new(4, 2, vec![[0.0; 3]; 8]).unwrap());
    let source = black.source(Orientation::default());
    assert!(source.sample([0.5, 0.5]).is_none());
    let up = Direction::new(glam::Vec3::Z).unwrap();
    assert_eq!((source.density(up), source.radiance(up)), (0.0, [0.0; 3]));
    assert!(source.inverse(up).is_none());
    assert!(black.coefficients(5).iter().all(|c| c.values().iter().all(|v| *v == 0.0)));
    let figures = report(&black, 5);
    assert_eq!((figures.range_ev, figures.lobe, figures.brightest_pixel), (0.0, None, None));
    let single = Probe::from_image("single", LatLong::new(1, 1, vec![[2.0; 3]]).unwrap());
    let source = single.source(Orientation::default());
    for i in 0..100 {
        let sample = source.sample([hash::uniform(0, 0, i, 0), hash::uniform(0, 0, i, 1)]).unwrap();
        assert!((f64::from(sample.density) * 4.0 * PI - 1.0).abs() < 1e-6);
    }
    // One texel of 1e6 among black: every draw lands in it and weighs the same.
    let mut pixels = vec![[0.0; 3]; 64 * 32];
    pixels[0] = [1e6, 0.0, 0.0];
    let image = LatLong::new(64, 32, pixels).unwrap();
    let source = EnvironmentSource::new(&image, Orientation::default());
    let sample = source.sample([0.3, 0.9]).unwrap();
    assert!((f64::from(sample.density) * image.pixel_solid_angle(0) - 1.0).abs() < 1e-6);
}

#[test]
fn opposite_suns_have_no_first_band() {
    let image =
        LatLong::from_fn(64, 32, |x, y| if (x, y) == (10, 5) || (x, y) == (42, 26) { [1e6; 3] } else { [0.0; 3] });
    let probe = Probe::from_image("twins", image);
    let c = &probe.coefficients(11)[0];
    for l in [1, 3, 5, 7, 9] {
        assert!(c.band_energy(l) < 1e-20 * c.energy(), "degree {l}");
    }
    assert!(report(&probe, 5).lobe.is_some());
}

#[test]
fn skies_have_the_irradiance_they_promise() {
    // The sun: ∫ L (n·ω)⁺ dω = π on a surface that faces it, whatever its place and size; the
    // image carries exactly the energy of the disk (f32 pixels).
    for spec in ["sun:0,0", "sun:180,45", "sun:-90,90", "sun:77,-90,5", "sun:-180,10,0.01", "sun:10,80,30"] {
        let probe = by_name(spec).unwrap().unwrap();
        let numbers: Vec<f64> = spec[4..].split(',').map(|w| w.parse().unwrap()).collect();
        let half_angle = 0.5 * numbers.get(2).copied().unwrap_or(sky::SUN_DEGREES).to_radians();
        let energy = PI / (PI * half_angle.sin().powi(2)) * 2.0 * PI * (1.0 - half_angle.cos());
        let mean = probe.image.mean()[0] * 4.0 * PI;
        // 1 − cos α loses digits in this formula: 1e-16 of 4e-9 at the smallest disk.
        assert!((mean / energy - 1.0).abs() < 1e-6, "{spec}: {mean} {energy}");
        let exact = probe.coefficients(MAX_BANDS);
        assert!((exact[0].values()[0] * (4.0 * PI).sqrt() / energy - 1.0).abs() < 1e-6, "{spec}");
        // Picture and closed form: pixels of 0.35° blur degree 10 by up to 10 · 0.35°/2.
        let picture = project(&probe.image, MAX_BANDS);
        let difference = relative_difference(&picture[0], &exact[0]);
        assert!(difference < 0.03, "{spec}: {difference}");
        let d = direction_from_angles(numbers[0].to_radians(), numbers[1].to_radians());
        let irradiance = sh::kernel::irradiance(&exact[0]).evaluate(d);
        // A small sun head on in 11 bands gives 1.01025 of the irradiance (Σ A_l (2l+1)/4π, l ≤ 10).
        if half_angle < 0.01 {
            assert!((irradiance / PI - 1.01025).abs() < 1e-4, "{spec}: {irradiance}");
        }
    }
    for spec in ["sky", "sky:-60,5", "sky:0,90", "overcast"] {
        let image = by_name(spec).unwrap().unwrap().image;
        let mut irradiance = 0.0;
        for y in 0..image.height() / 2 {
            for (x, pixel) in image.row(y).iter().enumerate() {
                let d = image.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5);
                irradiance += luminance(*pixel) * d.y * image.pixel_solid_angle(y);
            }
        }
        assert!((irradiance / PI - 1.0).abs() < 1e-4, "{spec}: {irradiance}");
        assert_eq!(image.radiance(-DVec3::Y), [0.2; 3]);
    }
    // CIE overcast: zenith 9/7 in this scale, three times the horizon.
    let overcast = by_name("overcast").unwrap().unwrap().image;
    assert!((f64::from(overcast.row(0)[0][0]) - 9.0 / 7.0).abs() < 1e-3);
    assert!((f64::from(overcast.row(127)[0][0]) - 3.0 / 7.0).abs() < 1e-2);
    // The clear sky is brightest around the sun.
    let figures = report(&by_name("sky:120,30").unwrap().unwrap(), 5);
    let brightest = figures.brightest_pixel.unwrap();
    assert!((brightest.azimuth_degrees - 120.0).abs() < 2.0 && (brightest.elevation_degrees - 30.0).abs() < 5.0);
}

#[test]
fn names_are_understood_or_refused() {
    for spec in ["constant", "constant:0", "gradient", "overcast", "sky", "sky:10,20", "sun:1,2", "sun:1,2,3"] {
        assert!(by_name(spec).unwrap().is_some(), "{spec}");
    }
    for spec in [
        "constant:-1",
        "constant:x",
        "constant:nan",
        "gradient:1,2",
        "overcast:1",
        "sky:1",
        "sky:0,-5",
        "sun",
        "sun:1",
        "sun:0,91",
        "sun:0,0,0",
        "sun:0,0,1,2",
        "sun:",
    ] {
        assert!(matches!(by_name(spec), Err(Error::Argument { .. })), "{spec}");
    }
    assert!(by_name("room.exr").unwrap().is_none());
    assert!(matches!(open("no/such/file", &ReadOptions::default()), Err(Error::Argument { .. })));
    assert!(open(env!("CARGO_MANIFEST_DIR"), &ReadOptions::default()).unwrap_err().to_string().contains("a directory"));
    let twice = by_name("constant:2").unwrap().unwrap();
    assert_eq!(twice.coefficients(1)[0].values()[0], 2.0 * (4.0 * PI).sqrt());
}

#[test]
fn reports_tell_the_light() {
    let figures = report(&by_name("sun:-40,35,10").unwrap().unwrap(), 3);
    for lobe in [figures.lobe.unwrap(), figures.brightest_pixel.unwrap()] {
        assert!((lobe.azimuth_degrees + 40.0).abs() < 5.5 && (lobe.elevation_degrees - 35.0).abs() < 5.5, "{lobe:?}");
    }
    assert!((figures.lobe.unwrap().azimuth_degrees + 40.0).abs() < 0.1);
    assert_eq!(figures.coefficients[0].len(), 9);
    // A small disk spreads its energy like (2l+1): nearly all lies above degree 10.
    let fractions: Vec<f64> = figures.energy.iter().map(|b| b.fraction).collect();
    assert!((fractions[1] / fractions[0] - 3.0).abs() < 0.1, "{fractions:?}");
    assert!(figures.energy[10].lost_above > 0.5);
    let constant = report(&by_name("constant").unwrap().unwrap(), 5);
    assert!((constant.energy[0].fraction - 1.0).abs() < 1e-12 && constant.lobe.is_none());
    assert_eq!(constant.range_ev, 0.0);
    assert!(serde_json::to_string(&figures).unwrap().contains("\"azimuth_degrees\""));
}

#[test]
fn embedded_probes_open_by_name() {
    for name in EMBEDDED {
        let probe = by_name(name).unwrap().unwrap();
        assert!(embedded(name).unwrap().len() <= 150_000, "{name} makes the program too large");
        assert_eq!((probe.image.width(), probe.image.height()), (256, 128), "{name}");
        let figures = report(&probe, 5);
        assert!(figures.range_ev > 5.0 && figures.lobe.unwrap().elevation_degrees > 0.0, "{name}: light from above");
    }
    assert!(embedded("nowhere").is_none());
}

#[test]
fn real_files_agree_with_each_other() {
    let load = |file: &str| Some(Probe::from_bytes(file, &data(file)?, &ReadOptions::default()).unwrap());
    let Some(zip) = load("courtyard_256x128_zip.exr") else { return };
    let Some(plain) = load("courtyard_256x128_none.exr") else { return };
    assert_eq!(zip.image, plain.image);
    let Some(half) = load("courtyard_256x128_piz_half.exr") else { return };
    let Some(rgbe) = load("courtyard_256x128.hdr") else { return };
    for (i, p) in zip.image.pixels().iter().enumerate() {
        let largest = p.iter().copied().fold(0.0, f32::max);
        for c in 0..3 {
            // Half: 11 significant bits, spacing 6e-8 at the small end. RGBE: 8 bits of the
            // largest channel, cut or rounded.
            assert!((half.image.pixels()[i][c] - p[c]).abs() <= p[c] / 2048.0 + 6e-8);
            assert!((rgbe.image.pixels()[i][c] - p[c]).abs() <= largest / 128.0 + 1e-30, "{p:?}");
        }
    }
    let reference = zip.coefficients(5);
    let difference = |probe: &Probe| {
        let c = probe.coefficients(5);
        (0..3).map(|i| relative_difference(&c[i], &reference[i])).fold(0.0, f64::max)
    };
    println!("half {:e}, rgbe {:e}", difference(&half), difference(&rgbe));
    assert!(difference(&half) < 1e-4 && difference(&rgbe) < 5e-3);
    let Some(angular) = load("courtyard_angular_512.hdr") else { return };
    let Some(full) = load("courtyard.exr") else { return };
    println!("angular {:e}, 1024x512 {:e}", difference(&angular), difference(&full));
    assert_eq!(angular.layout, Layout::Angular);
    // A mirrored or turned map would differ by the order of 1.
    assert!(difference(&angular) < 0.01);
    assert!(difference(&full) < 0.01);
    for name in ["studio", "sunset"] {
        let Some(full) = load(&format!("{name}.exr")) else { return };
        let Some(small) = load(&format!("{name}_256x128_zip.exr")) else { return };
        let (a, b) = (full.coefficients(5), small.coefficients(5));
        let embedded = by_name(name).unwrap().unwrap().coefficients(5);
        for c in 0..3 {
            println!("{name} {:e} {:e}", relative_difference(&b[c], &a[c]), relative_difference(&embedded[c], &b[c]));
            assert!(relative_difference(&b[c], &a[c]) < 0.01, "{name}");
            assert!(relative_difference(&embedded[c], &b[c]) < 5e-3, "{name}");
        }
    }
    let Some(interior) = load("interior.exr") else { return };
    assert_eq!((interior.image.width(), interior.image.height()), (1024, 512));
}

/// The coefficients of Debevec's probes as published (order L00 L1-1 L10 L11 L2-2 …, y up) read
/// in our order and sign: every one of these probes is lit from above, and its irradiance
/// is positive all around, as that of real light must be in the first three bands to a few per
/// cent. A swapped order or sign of any of L1m breaks the first, of L2m the second.
#[test]
fn published_coefficients_make_sense_in_our_convention() {
    let Some(bytes) = data("published_sh.json") else { return };
    let json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
    // The basis of Ramamoorthi & Hanrahan 2001, eq. 3, in the order of the file.
    let published = |d: DVec3| {
        let DVec3 { x, y, z } = d;
        [
            0.282095,
            0.488603 * y,
            0.488603 * z,
            0.488603 * x,
            1.092548 * x * y,
            1.092548 * y * z,
            0.315392 * (3.0 * z * z - 1.0),
            1.092548 * x * z,
            0.546274 * (x * x - y * y),
        ]
    };
    let probes = json["five_to_seven_digits"].as_object().unwrap();
    assert_eq!(probes.len(), 8);
    for (name, rows) in probes {
        for c in 0..3 {
            let values: Vec<f64> = (0..9).map(|i| rows[i][c].as_f64().unwrap()).collect();
            assert!(values[1] > 0.0, "{name}: lit from above");
            let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
            let mut worst = f64::INFINITY;
            let mut ours = [0.0; 9];
            for i in 0..800 {
                // A Fibonacci lattice.
                let y = 1.0 - (2 * i + 1) as f64 / 800.0;
                let longitude = i as f64 * PI * (3.0 - 5f64.sqrt());
                let d = direction_from_angles(longitude, y.asin());
                basis::evaluate(3, d.to_array(), &mut ours);
                assert!(largest_difference(&ours, &published(d)) < 1e-6);
                let irradiance: f64 = (0..9usize).map(|k| sh::CLAMPED_COSINE[k.isqrt()] * values[k] * ours[k]).sum();
                if irradiance > best.0 {
                    best = (irradiance, d);
                }
                worst = worst.min(irradiance);
            }
            assert!(best.1.y > 0.0, "{name}: brightest from {}", best.1);
            assert!(worst > -0.05 * best.0, "{name}: {worst} of {}", best.0);
        }
    }
    // The 2001 paper prints the same numbers to two digits.
    for (name, rows) in json["two_digits_as_in_the_2001_paper"].as_object().unwrap() {
        for (i, c) in (0..9).flat_map(|i| (0..3).map(move |c| (i, c))) {
            let difference = rows[i][c].as_f64().unwrap() - probes[name][i][c].as_f64().unwrap();
            assert!(difference.abs() < 0.011, "{name} {i} {c}");
        }
    }
}
