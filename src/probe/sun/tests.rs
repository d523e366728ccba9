use super::super::latlong::LUMINANCE;
use super::super::{EMBEDDED, ReadOptions, by_name};
use super::lobe::angle;
use super::*;
use crate::sh::Coefficients;

/// ∫ L dω of each channel.
fn flux(image: &LatLong) -> [f64; 3] {
    image.mean().map(|v| 4.0 * PI * v)
}

fn assert_flux_kept(name: &str, whole: &LatLong, split: &Split) {
    let (before, after) = (flux(whole), flux(&split.rest.image));
    for c in 0..3 {
        let suns: f64 = split.suns.iter().map(|s| s.sun.flux[c]).sum();
        let error = (after[c] + suns - before[c]).abs();
        assert!(error <= 1e-10 * before[c].abs(), "{name}, channel {c}: {} + {suns} of {}", after[c], before[c]);
    }
}

/// The picture of a sun over a sky, as a photograph would show it: no formula is left.
fn sun_over(sky: &str, azimuth: f64, elevation: f64, degrees: f64, strength: f64) -> Probe {
    let sun = by_name(&format!("sun:{azimuth},{elevation},{degrees}")).unwrap().unwrap().image;
    let sky = by_name(sky).unwrap().unwrap().image;
    let (w, h) = (sun.width(), sun.height());
    let image = LatLong::from_fn(w, h, |x, y| {
        let behind = sky.radiance(sun.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5));
        std::array::from_fn(|c| f64::from(behind[c]) + strength * f64::from(sun.row(y)[x][c]))
    });
    Probe::from_image(
        format!("sun:{azimuth},{elevation},{degrees} over {sky:?}").chars().take(24).collect::<String>(),
        image,
    )
}

#[test]
fn suns_are_found_wherever_they_stand_and_energy_is_kept() {
    // Azimuth 180 is the seam of the image, ±90 the poles.
    for (azimuth, elevation) in [(45.0, 30.0), (180.0, 5.0), (0.0, 90.0), (77.0, -90.0), (-100.0, 88.5), (10.0, -20.0)]
    {
        for degrees in [0.53, 2.0, 8.0] {
            let probe = sun_over("overcast", azimuth, elevation, degrees, 3.0);
            let split = split_sun(&probe, &SunOptions::default());
            let name = format!("{azimuth}, {elevation}, {degrees}");
            assert_eq!(split.suns.len(), 1, "{name}: {}", split.stopped);
            assert_flux_kept(&name, &probe.image, &split);
            let found = &split.suns[0].sun;
            let truth = direction(azimuth, elevation);
            let off = angle(found.direction_in_probe, truth).to_degrees();
            // A tenth of a pixel of 0.35°, and what the gradient of the sky behind adds.
            assert!(off < 0.035, "{name}: off by {off}°");
            // Pixels of side s blur it twice, averaging and being constant: s²/6 each in squared distance from
            // the centre, where a disk d across has d²/8; at the poles pixels are narrower than s.
            let across = 2.0 * found.angular_radius.to_degrees();
            let blurred = (degrees * degrees + 8.0 / 3.0 * (360.0f64 / 1024.0).powi(2)).sqrt();
            assert!(across > 0.97 * degrees && across < 1.03 * blurred, "{name}: {across}° across");
            // Irradiance 3π on a surface that faces it: flux (1 + cos α)/2.
            let facing = found.flux[1] * 0.5 * (1.0 + libm::cos(found.angular_radius));
            assert!((facing / (3.0 * PI) - 1.0).abs() < 0.005, "{name}: {facing}");
            // What is left is the sky, and slivers at the edge of the disk below a hundredth of its peak.
            let brightest = |image: &LatLong| image.pixels().iter().fold(0.0f32, |m, p| m.max(p[1]));
            let (peak, sliver) = (brightest(&split.rest.image), FRACTIONS[0] as f32 * brightest(&probe.image));
            let sky = by_name("overcast").unwrap().unwrap().image;
            let sky_peak = brightest(&sky);
            assert!(peak <= 1.01 * (sky_peak + sliver), "{name}: {peak} left over a sky of {sky_peak}");
        }
    }
}

fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    super::super::latlong::direction_from_angles(azimuth.to_radians(), elevation.to_radians())
}

/// Bands 0 and 1 hold the flux and the first moment, which the disk has from the lobe.
#[test]
fn flux_and_first_moment_of_the_light_are_those_of_the_original() {
    for name in EMBEDDED {
        let probe = by_name(name).unwrap().unwrap();
        let options = SunOptions { tolerance: 0.0, most: 1, ..SunOptions::default() };
        let split = split_sun(&probe, &options);
        let Some(SplitSun { sun, .. }) = split.suns.first() else { continue };
        let disk = Exact::Disk { centre: sun.direction_in_probe, half_angle: sun.angular_radius, radiance: 1.0 };
        let disk = disk.coefficients(2);
        let (before, after) = (probe.coefficients(2), split.rest.coefficients(2));
        for i in 0..4 {
            let grey = |set: &[Coefficients; 3]| (0..3).map(|c| LUMINANCE[c] * set[c].values()[i]).sum::<f64>();
            let strength: f64 = (0..3).map(|c| LUMINANCE[c] * sun.radiance()[c]).sum();
            let error = grey(&after) + strength * disk.values()[i] - grey(&before);
            assert!(error.abs() < 1e-9 * grey(&before).abs().max(before[1].values()[0]), "{name} {i}: {error}");
        }
    }
}

#[test]
fn real_probes_keep_their_energy() {
    let folder = std::env::var_os("ISOLUME_DATA")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), Into::into);
    let mut probes: Vec<Probe> = EMBEDDED.iter().map(|name| by_name(name).unwrap().unwrap()).collect();
    for name in ["courtyard.exr", "sunset.exr", "studio.exr", "interior.exr"] {
        match std::fs::read(folder.join("probes").join(name)) {
            Ok(bytes) => probes.push(Probe::from_bytes(name, &bytes, &ReadOptions::default()).unwrap()),
            Err(e) => println!("skipped: {name}: {e}"),
        }
    }
    for probe in probes {
        for most in [1, 4, MOST_SUNS] {
            let options = SunOptions { most, ..SunOptions::default() };
            let split = split_sun(&probe, &options);
            assert_flux_kept(&probe.name, &probe.image, &split);
            assert!(split.suns.len() <= most);
            assert!(split.truncation_of_rest <= split.truncation, "{}", probe.name);
            println!(
                "{}: {:.2} % lost, {:.2} % of the rest",
                probe.name,
                100.0 * split.truncation,
                100.0 * split.truncation_of_rest
            );
            for s in &split.suns {
                println!(
                    "{}: flux {:.1} %, ringing {:.1} %, {} pixels, {:.2}° across, {:?}",
                    probe.name,
                    100.0 * s.flux_share,
                    100.0 * s.ringing,
                    s.pixels,
                    2.0 * s.sun.angular_radius.to_degrees(),
                    s.sun.direction_in_probe,
                );
                assert!(s.sun.flux.iter().all(|f| f.is_finite() && *f >= 0.0) && s.ringing > FAINT * options.tolerance);
                assert!((s.sun.direction_in_probe.length() - 1.0).abs() < 1e-12);
            }
            println!("{}: {}", probe.name, split.stopped);
        }
    }
}

#[test]
fn a_sun_by_formula_is_taken_whole() {
    let probe = by_name("sun:30,60,1").unwrap().unwrap();
    let split = split_sun(&probe, &SunOptions::default());
    let sun = &split.suns[0].sun;
    assert!((2.0 * sun.angular_radius.to_degrees() - 1.0).abs() < 1e-12);
    assert!((sun.flux[0] * 0.5 * (1.0 + libm::cos(sun.angular_radius)) / PI - 1.0).abs() < 1e-12);
    assert!(split.rest.coefficients(5).iter().all(|c| c.energy() == 0.0));
    assert!(split.suns[0].ringing > 0.5 && split.suns[0].flux_share == 1.0);
    assert_eq!(split.truncation_of_rest, 0.0);
    // A disk of 80° across is no sun, whatever it loses.
    let wide = split_sun(&by_name("sun:30,60,80").unwrap().unwrap(), &SunOptions::default());
    assert!(wide.suns.is_empty() && wide.stopped.to_string().contains("10"), "{}", wide.stopped);
    assert_eq!(wide.rest.coefficients(5), by_name("sun:30,60,80").unwrap().unwrap().coefficients(5));
}

#[test]
fn two_suns_come_one_by_one() {
    let first = sun_over("constant:0.01", 20.0, 40.0, 0.53, 2.0).image;
    let second = sun_over("constant:0", -160.0, -40.0, 1.5, 1.0).image;
    let both = LatLong::from_fn(first.width(), first.height(), |x, y| {
        std::array::from_fn(|c| f64::from(first.row(y)[x][c]) + f64::from(second.row(y)[x][c]))
    });
    let probe = Probe::from_image("two", both);
    let one = split_sun(&probe, &SunOptions { tolerance: 1e-3, most: 1, ..SunOptions::default() });
    let all = split_sun(&probe, &SunOptions { tolerance: 1e-3, ..SunOptions::default() });
    assert_eq!((one.suns.len(), one.stopped, all.suns.len()), (1, NoSun::Enough, 2));
    assert_eq!(one.suns[0], all.suns[0]);
    assert!(angle(all.suns[0].sun.direction_in_probe, direction(20.0, 40.0)) < 1e-3);
    assert!(angle(all.suns[1].sun.direction_in_probe, direction(-160.0, -40.0)) < 1e-3);
    assert_flux_kept("two", &probe.image, &all);
    assert!(matches!(all.stopped, NoSun::Smooth { .. }), "{}", all.stopped);
}

#[test]
fn light_without_a_sun_says_why() {
    let none = |probe: &Probe| {
        let split = split_sun(probe, &SunOptions::default());
        assert!(split.suns.is_empty(), "{}", probe.name);
        assert_eq!(split.rest.image, probe.image);
        split.stopped
    };
    let sky = |spec: &str| by_name(spec).unwrap().unwrap();
    assert_eq!(none(&Probe::from_image("black", LatLong::from_fn(8, 4, |_, _| [0.0; 3]))), NoSun::Black);
    assert_eq!(none(&Probe::from_image("black", LatLong::from_fn(1, 1, |_, _| [0.0; 3]))), NoSun::Black);
    for even in [Probe::from_image("one pixel", LatLong::from_fn(1, 1, |_, _| [5.0; 3])), sky("constant")] {
        assert!(matches!(none(&even), NoSun::Smooth { .. }), "{}", even.name);
    }
    for spec in ["gradient", "overcast", "sky:0,45", "sky:0,90"] {
        let reason = none(&sky(spec));
        assert!(matches!(reason, NoSun::Wide(_) | NoSun::Smooth { .. } | NoSun::Faint { .. }), "{spec}: {reason}");
    }
}

#[test]
fn one_bright_texel_anywhere_is_split_or_smooth_but_never_lost() {
    for (w, h) in [(1, 1), (2, 1), (1, 5), (3, 2), (7, 3), (16, 8), (31, 17), (40, 20)] {
        for at in 0..w * h {
            let image = LatLong::from_fn(w, h, |x, y| if y * w + x == at { [1e6, 5e5, 2.0] } else { [0.5, 1.0, 1.5] });
            let probe = Probe::from_image("texel", image);
            let split = split_sun(&probe, &SunOptions { tolerance: 0.0, ..SunOptions::default() });
            assert_flux_kept("texel", &probe.image, &split);
            if let Some(s) = split.suns.first() {
                assert_eq!(s.pixels, 1, "{w}x{h} {at}");
                let d = s.sun.direction_in_probe;
                assert!(probe.image.radiance(d)[0] == 1e6, "{w}x{h} {at}: {d}");
                let radius = s.sun.angular_radius;
                assert!(radius > 0.0 && radius <= SunOptions::default().max_radius, "{w}x{h} {at}: {radius}");
            } else {
                // A texel of 22.5° is no sun; one of 11.6° is.
                assert!(
                    h < 17 && matches!(split.stopped, NoSun::Wide(_) | NoSun::Even | NoSun::Smooth { .. }),
                    "{w}x{h} {at}: {}",
                    split.stopped
                );
            }
        }
    }
}

/// Lamps over a constant sky: one, two of unlike size and strength, and three of which one is too faint to matter.
#[test]
fn as_many_lamps_are_split_off_as_the_tolerance_needs() {
    let over = |lamps: &[(f64, f64, f64, f64)]| {
        let mut image = by_name("constant:1").unwrap().unwrap().image;
        for &(azimuth, elevation, degrees, share) in lamps {
            let lamp = by_name(&format!("sun:{azimuth},{elevation},{degrees}")).unwrap().unwrap().image;
            // Of the flux of the sky, 4π.
            let factor = share * 4.0 * PI / flux(&lamp)[1];
            let (w, h) = (lamp.width(), lamp.height());
            let before = image.clone();
            image = LatLong::from_fn(w, h, |x, y| {
                let behind = before.radiance(lamp.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5));
                std::array::from_fn(|c| f64::from(behind[c]) + factor * f64::from(lamp.row(y)[x][c]))
            });
        }
        Probe::from_image("lamps", image)
    };
    // A lamp without extent loses 0.57 of its share: 3.5 % of the light is what 2 % may stay of.
    let alone = truncation_of_lamp(1.0, 5);
    assert!((0.4..0.8).contains(&alone), "{alone}");
    // Azimuth, elevation, degrees across, share of the sky.
    type Lamp = (f64, f64, f64, f64);
    let cases: [(&[Lamp], usize); 6] = [
        (&[], 0),
        (&[(10.0, 40.0, 1.0, 0.02)], 0),
        (&[(10.0, 40.0, 1.0, 0.08)], 1),
        (&[(10.0, 40.0, 1.0, 0.5), (130.0, 10.0, 5.0, 0.5)], 2),
        (&[(10.0, 40.0, 0.5, 1.0), (130.0, 10.0, 5.0, 0.3), (-100.0, 60.0, 2.0, 0.2)], 3),
        (&[(10.0, 40.0, 0.5, 1.0), (130.0, 10.0, 5.0, 0.01), (-100.0, 60.0, 2.0, 0.2)], 2),
    ];
    for (lamps, count) in cases {
        let probe = over(lamps);
        let split = split_sun(&probe, &SunOptions::default());
        assert_eq!(split.suns.len(), count, "{lamps:?}: {}", split.stopped);
        assert!(matches!(split.stopped, NoSun::Smooth { .. }), "{lamps:?}: {}", split.stopped);
        assert_flux_kept("lamps", &probe.image, &split);
        assert!(split.suns.windows(2).all(|pair| pair[0].flux_share >= pair[1].flux_share), "{lamps:?}");
        let [first, two] = [1, 2].map(|n| SunOptions::of(SunSplit::Lobes(n), 5).unwrap());
        for options in [first, two] {
            assert_eq!(split_sun(&probe, &options).suns.len(), lamps.len().min(options.most), "{lamps:?}");
        }
    }
    assert_eq!(SunOptions::of(SunSplit::Off, 5), None);
}

#[test]
fn choices_of_lamps_are_read_as_they_are_written() {
    for (text, split) in
        [("auto", SunSplit::Auto), ("on", SunSplit::Auto), ("off", SunSplit::Off), ("3", SunSplit::Lobes(3))]
    {
        assert_eq!(text.parse::<SunSplit>().unwrap(), split);
        assert_eq!(split.to_string().parse::<SunSplit>().unwrap(), split);
    }
    for wrong in ["9", "-1", "", "yes", "1.5"] {
        assert!(wrong.parse::<SunSplit>().unwrap_err().to_string().contains("auto"), "{wrong}");
    }
}
