use super::super::assemble::note;
use super::super::{Samples, Solid};
use super::*;
use crate::geom::Affine;
use glam::{DMat3, DVec3};

fn made(dims: [usize; 3], samples: Samples, affine: Affine) -> Volume {
    Volume::new(dims, samples, affine).unwrap()
}

/// 64 × 8 × 8 values with no two neighbours alike and no heap at either end.
fn plain() -> Volume {
    let samples = (0..64 * 64).map(|i| (i % 64) as f32 + 0.1 * (i / 64 % 8) as f32 + 0.01 * (i / 512) as f32).collect();
    made([64, 8, 8], Samples::F32(samples), Affine::IDENTITY)
}

fn topics(volume: &Volume) -> Vec<&'static str> {
    diagnose(volume, None).iter().map(|f| f.topic).collect()
}

fn only<'a>(found: &'a [Finding], topic: &str) -> &'a Finding {
    let mut matching = found.iter().filter(|f| f.topic == topic);
    let first = matching.next().unwrap_or_else(|| panic!("no {topic} in {found:?}"));
    assert!(matching.next().is_none(), "{topic} twice");
    first
}

#[test]
fn plain_data_has_nothing_unusual() {
    assert_eq!(topics(&plain()), [] as [&str; 0]);
}

#[test]
fn notes_of_the_reader_are_findings() {
    let mut volume = plain();
    volume.notes.push(note(format!("{REPLACED} by the smallest finite one"), 7));
    volume.notes.push(note("mode 0 bytes are signed", 1));
    volume.notes.push(note("float64 samples were rounded to float32", 9));
    let found = diagnose(&volume, None);
    let of = |i: usize| (found[i].topic, found[i].count, found[i].of, found[i].unit);
    assert_eq!(of(0), ("not finite", 7, 4096, "samples"));
    assert_eq!(of(1), ("reader", 1, 0, "items"));
    assert_eq!(of(2), ("reader", 9, 4096, "samples"));
}

#[test]
fn constant_volumes_and_slices_say_so_and_nothing_else() {
    assert_eq!(topics(&made([4, 4, 4], Samples::U8(vec![7; 64]), Affine::IDENTITY)), ["constant"]);
    assert_eq!(topics(&made([1, 1, 1], Samples::F32(vec![7.0]), Affine::IDENTITY)), ["flat grid", "constant"]);
    let slice = made([1, 40, 41], Samples::I16((0..1640).map(|i| i as i16).collect()), Affine::IDENTITY);
    assert_eq!(topics(&slice), ["flat grid"]);
}

#[test]
fn plateaus_are_counted_in_cells() {
    // A block of 5 × 3 × 3 equal samples has 4 · 2 · 2 flat cells, the rest is a ramp.
    let plain = plain();
    let raw = |i: usize| {
        let (x, y, z) = (i % 64, i / 64 % 8, i / 512);
        let block = (10..15).contains(&x) && (2..5).contains(&y) && (3..6).contains(&z);
        if block { 30.5 } else { plain.samples().raw(i) }
    };
    let volume = made([64, 8, 8], Samples::F32((0..4096).map(raw).collect()), Affine::IDENTITY);
    let found = diagnose(&volume, None);
    let flat = only(&found, "plateaus");
    assert_eq!((flat.count, flat.of, flat.unit), (16, 63 * 49, "cells"));
    assert!(flat.found.contains("100.0 % of these at 30.5"), "{}", flat.found);
}

#[test]
fn saturation_is_told_from_a_background() {
    // 0 … 249 evenly, then 40 samples of 0 and 50 of the largest value.
    let heaped = |top: u8| -> Volume {
        let mut s: Vec<u8> = (0..1000).map(|i| (i % 250) as u8).collect();
        s.extend([0; 40]);
        s.extend(vec![top; 50]);
        made([1090, 1, 1], Samples::U8(s), Affine::IDENTITY)
    };
    let found = diagnose(&heaped(255), None);
    assert_eq!((only(&found, "saturation").count, only(&found, "saturation").of), (50, 1090));
    assert_eq!(only(&found, "clipped range").count, 44);
    // Below the end of the type the same heap is a clipped range: two of them.
    let found = diagnose(&heaped(253), None);
    assert_eq!(found.iter().filter(|f| f.topic == "clipped range").map(|f| f.count).collect::<Vec<_>>(), [44, 50]);
}

#[test]
fn long_tails_and_few_levels_and_narrow_ranges() {
    let mut s: Vec<f32> = (0..100_000).map(|i| (i % 997) as f32 * 1e-3).collect();
    (0..100).for_each(|i| s[1000 * i] = 30.0 + i as f32);
    let found = diagnose(&made([100_000, 1, 1], Samples::F32(s), Affine::IDENTITY), None);
    let tail = only(&found, "long tail");
    assert_eq!((tail.count, tail.of), (100, 100_000));

    let mask = Samples::U8((0..512).map(|i| 200 * u8::from(i % 7 == 0)).collect());
    let found = diagnose(&made([8, 8, 8], mask, Affine::IDENTITY), None);
    assert_eq!(only(&found, "few levels").count, 2);

    // 1024 … 1025 has 2^13 steps of 2^-13; 1024 … 1024.25 has 2^11.
    let range = |width: f32| Samples::F32((0..=1024).map(|i| 1024.0 + width * i as f32 / 1024.0).collect());
    assert_eq!(topics(&made([1025, 1, 1], range(1.0), Affine::IDENTITY)), ["flat grid"]);
    let found = diagnose(&made([1025, 1, 1], range(0.25), Affine::IDENTITY), None);
    assert_eq!(only(&found, "narrow range").count, 2048);
}

#[test]
fn the_stand_of_the_grid_is_described() {
    let with = |x: DVec3, y: DVec3, z: DVec3, origin: DVec3| {
        let affine = Affine::new(DMat3::from_cols(x, y, z), origin).unwrap();
        topics(&made([64, 8, 8], plain().samples().clone(), affine))
    };
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    assert_eq!(with(x, y, 4.0 * z, DVec3::ZERO), [] as [&str; 0]);
    assert_eq!(with(x, y, 4.1 * z, DVec3::ZERO), ["anisotropy"]);
    assert_eq!(with(-x, y, z, DVec3::ZERO), ["left-handed"]);
    assert_eq!(with(x, y + 0.01 * x, z, DVec3::ZERO), ["oblique"]);
    let turn = DMat3::from_rotation_z(0.1);
    assert_eq!(with(turn * x, turn * y, z, DVec3::ZERO), ["rotated"]);
    // A quarter turn is only a swap of axes.
    assert_eq!(with(y, -x, z, DVec3::ZERO), [] as [&str; 0]);
    // 2⁻²⁴ of 1e6 is 0.06 voxels, of 1e4 0.0006.
    assert_eq!(with(x, y, z, DVec3::new(0.0, 1e6, 0.0)), ["far origin"]);
    assert_eq!(with(x, y, z, DVec3::new(0.0, 1e4, 0.0)), [] as [&str; 0]);
}

#[test]
fn an_isovalue_is_compared_with_the_samples() {
    let mut volume = plain();
    let topics = |v: &Volume, c: f64| diagnose(v, Some(c)).iter().map(|f| f.topic).collect::<Vec<_>>();
    assert_eq!(topics(&volume, 1e9), ["no surface"]);
    // The largest value is a sample, and above it is nothing; below it, with matter below, there is.
    let high = volume.value_range().1;
    assert_eq!(topics(&volume, high), ["no surface"]);
    volume.solid = Solid::Below;
    assert_eq!(topics(&volume, high), ["isovalue on samples", "open surface"]);
    // A solid that stays inside: 1 sample of 3³.
    let mut ball = vec![0.0f32; 27];
    ball[13] = 1.0;
    let ball = made([3, 3, 3], Samples::F32(ball), Affine::IDENTITY);
    assert!(!topics(&ball, 0.5).contains(&"open surface"));
    // The field's value is what counts, not the raw sample.
    let scaled = ball.with_scaling(-2.0, 10.0).unwrap();
    let found = diagnose(&scaled, Some(8.0));
    assert_eq!(only(&found, "isovalue on samples").count, 1);
    // With a negative slope matter above is where raw samples are small: all but the centre.
    assert_eq!((only(&found, "open surface").count, only(&found, "open surface").of), (26, 26));
}
