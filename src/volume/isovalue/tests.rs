use super::*;
use crate::geom::Affine;
use crate::sampling::hash::uniform;
use crate::volume::Samples;

const N: usize = 40;

/// A function on the box from −1 to 1.
fn made(f: impl Fn([f64; 3]) -> f64) -> Volume {
    let at = |i: usize| 2.0 * i as f64 / (N - 1) as f64 - 1.0;
    let samples = (0..N * N * N).map(|i| f([at(i % N), at(i / N % N), at(i / (N * N))]) as f32).collect();
    Volume::new([N; 3], Samples::F32(samples), Affine::IDENTITY).unwrap()
}

fn negative(volume: &Volume) -> Volume {
    let (slope, inter) = (-volume.slope(), -volume.inter());
    volume.clone().with_scaling(slope, inter).unwrap()
}

fn radius([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Of unit variance, a function of the place.
fn noise(p: [f64; 3]) -> f64 {
    let place = p.iter().fold(0u32, |n, v| 64 * n + ((v + 1.0) * 20.0) as u32);
    // A sum of twelve uniform numbers has the variance 1.
    (0..12).map(|d| f64::from(uniform(1, u64::from(place), d, 0))).sum::<f64>() - 6.0
}

fn auto(volume: &Volume) -> Chosen {
    Isovalue::Auto.resolve(volume, None, None).unwrap()
}

#[test]
fn isovalues_are_read_as_written() {
    for (text, expected) in [
        ("40%", Isovalue::Percent(40.0)),
        ("-0.6", Isovalue::Value(-0.6)),
        ("auto", Isovalue::Auto),
        ("1.5sigma", Isovalue::Sigma(1.5)),
        ("3σ", Isovalue::Sigma(3.0)),
        ("1.5rms", Isovalue::Rms(1.5)),
        ("enclosed:5%", Isovalue::Enclosed(0.05)),
        ("enclosed:0.2", Isovalue::Enclosed(0.2)),
        ("300HU", Isovalue::Hounsfield(300.0)),
        ("bone", Isovalue::Hounsfield(300.0)),
        ("Skin", Isovalue::Hounsfield(-300.0)),
    ] {
        assert_eq!(text.parse::<Isovalue>().unwrap(), expected, "{text}");
    }
    for wrong in ["", "x", "nan", "inf", "%", "4O%", "sigma", "enclosed:0%", "enclosed:100%", "infσ", "HU"] {
        assert!(wrong.parse::<Isovalue>().is_err(), "{wrong}");
    }
}

#[test]
fn levels_by_deviation_and_enclosed_share_follow_their_definition() {
    // 0, 1, … 999 in a row: mean 499.5, variance (1000² − 1)/12, mean square 999·1999/6.
    let samples = Samples::U16((0..1000).collect());
    let volume = Volume::new([10, 10, 10], samples, Affine::IDENTITY).unwrap();
    let value = |text: &str| text.parse::<Isovalue>().unwrap().resolve(&volume, None, None).unwrap().value;
    let deviation = ((1e6 - 1.0) / 12.0f64).sqrt();
    assert!((value("1.5sigma") - (499.5 + 1.5 * deviation)).abs() < 1e-9);
    assert!((value("-1σ") - (499.5 - deviation)).abs() < 1e-9);
    assert!((value("1.5rms") - 1.5 * (999.0 * 1999.0 / 6.0f64).sqrt()).abs() < 1e-9);
    // Half a sample of 1000 to either side.
    assert!((value("enclosed:5%") - 949.5).abs() <= 1.0);
    let below = Isovalue::Enclosed(0.05).resolve(&volume, Some(Solid::Below), None).unwrap();
    assert!((below.value - 49.5).abs() <= 1.0 && below.solid == Solid::Below);
    assert!("600HU".parse::<Isovalue>().unwrap().resolve(&volume, None, None).unwrap().value == 600.0);
    assert!("5sigma".parse::<Isovalue>().unwrap().resolve(&volume, None, None).is_err());
}

#[test]
fn the_range_may_be_as_wide_as_numbers_go() {
    let samples = (0..N * N * N).map(|i| if i % 7 == 0 { 1.0 } else { -1.0 } + (i % 5) as f32 * 0.01).collect();
    let volume = Volume::new([N; 3], Samples::F32(samples), Affine::IDENTITY).unwrap();
    let volume = volume.with_scaling(1.5e308, 0.0).unwrap();
    for text in ["auto", "50%", "1sigma", "1rms", "otsu", "enclosed:50%"] {
        let value = text.parse::<Isovalue>().unwrap().resolve(&volume, Some(Solid::Above), None).unwrap().value;
        assert!(value.is_finite() && value.abs() < 1.6e308, "{text} {value}");
    }
    assert_eq!(overview(&volume, 64).iter().sum::<u64>(), (N * N * N) as u64);
}

#[test]
fn lobes_get_a_level_on_either_side_of_zero() {
    let volume = made(|p| p[0] * (-6.0 * radius(p)).exp());
    for volume in [&volume, &negative(&volume)] {
        let chosen = auto(volume);
        let (low, high) = volume.value_range();
        assert!(chosen.value > 0.0 && chosen.value < 0.5 * high.min(-low), "{chosen:?}");
        assert_eq!(chosen.solid, Solid::Above);
        assert_eq!(chosen.more, [Level { value: -chosen.value, solid: Solid::Below }]);
        assert!(chosen.reason.unwrap().contains("both lobes") && chosen.warning.is_none());
    }
    let below = Isovalue::Auto.resolve(&volume, Some(Solid::Below), None).unwrap();
    assert!(below.value < 0.0 && below.more.is_empty());
}

/// The same surface with the same side for h and −h.
fn agrees_with_negative(volume: &Volume) -> Chosen {
    let (chosen, turned) = (auto(volume), auto(&negative(volume)));
    assert!((chosen.value + turned.value).abs() <= 1e-12 * chosen.value.abs(), "{chosen:?} {turned:?}");
    assert_ne!(chosen.solid, turned.solid, "{chosen:?} {turned:?}");
    chosen
}

#[test]
fn signal_stands_out_of_noise() {
    let volume = made(|p| noise(p) + if radius(p) < 0.35 { 6.0 } else { 0.0 });
    let chosen = agrees_with_negative(&volume);
    // σ is 1 and the median near 0; the ball, 2 % of the box, widens the bulk by about as much.
    assert!((3.2..4.0).contains(&chosen.value), "{chosen:?}");
    assert!(chosen.reason.unwrap().contains("noise"));
    // Noise on a background that is not 0.
    let lifted = made(|p| 100.0 + noise(p) + if radius(p) < 0.35 { 60.0 } else { 0.0 });
    let chosen = agrees_with_negative(&lifted);
    assert!((103.0..105.0).contains(&chosen.value), "{chosen:?}");
}

#[test]
fn tomography_shows_bone_and_says_so() {
    let tissue = |p: [f64; 3]| match radius(p) {
        r if r > 0.8 => -1000.0,
        r if (0.6..0.7).contains(&r) => 1000.0,
        _ => 40.0,
    };
    let chosen = agrees_with_negative(&made(|p| (tissue(p) + 20.0 * noise(p)).round()));
    assert_eq!(chosen.value, 300.0);
    assert!(chosen.reason.unwrap().contains("bone, 300 HU"));
    assert!(chosen.alternatives.iter().any(|a| a.name == "skin" && a.level.value == -300.0));
    let soft = agrees_with_negative(&made(|p| (tissue(p).min(40.0) + 20.0 * noise(p)).round()));
    assert_eq!(soft.value, -300.0);
}

#[test]
fn labels_get_a_level_between_each_two() {
    let label = |p: [f64; 3]| match radius(p) {
        r if r < 0.3 => 9.0,
        r if r < 0.5 => 5.0,
        r if r < 0.7 => 3.0,
        _ => 0.0,
    };
    let chosen = agrees_with_negative(&made(label));
    assert_eq!(chosen.value, 1.5);
    assert_eq!(chosen.more.iter().map(|l| l.value).collect::<Vec<_>>(), [4.0, 7.0]);
    assert_eq!(chosen.solid, Solid::Above);
    let mask = agrees_with_negative(&made(|p| if radius(p) < 0.5 { 200.0 } else { 0.0 }));
    assert_eq!((mask.value, mask.more.len()), (100.0, 0));
}

#[test]
fn two_classes_are_split_and_the_side_at_the_border_is_air() {
    let ball = agrees_with_negative(&made(|p| 80.0 - 60.0 * radius(p)));
    assert!(ball.solid == Solid::Above && ball.warning.is_none(), "{ball:?}");
    // Open on half of the border: the side stays, and it is said that the other is as likely.
    let slab = auto(&made(|p| p[0]));
    assert!(slab.solid == Solid::Above && slab.value.abs() < 0.01 && slab.warning.is_none(), "{slab:?}");
    assert!(slab.reason.unwrap().contains("--solid below is as likely"));
}

#[test]
fn a_surface_that_is_open_all_round_is_said() {
    let volume = made(|p| 80.0 - 60.0 * radius(p));
    let ball = Isovalue::Value(50.0).resolve(&volume, None, None).unwrap();
    assert!(ball.warning.is_none());
    let hole = Isovalue::Value(50.0).resolve(&volume, Some(Solid::Below), None).unwrap();
    assert!(hole.warning.unwrap().contains("--solid above"));
}

#[test]
fn constant_volumes_have_no_isovalue() {
    let volume = made(|_| 3.0);
    assert!(Isovalue::Auto.resolve(&volume, None, None).unwrap_err().to_string().contains("constant"));
}
