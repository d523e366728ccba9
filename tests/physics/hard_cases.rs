//! VALIDATION section 5: one table of hard volumes, and everything run over it. Finite and bounded, or
//! refused by name; never a panic. `tests/common/cases.rs` says why each case is there.
//!
//! `cargo test --release --test physics -- --nocapture hard_cases::map` prints which test stands for which number.

mod export;
mod map;
mod mesh;
mod options;
mod solve;

use crate::common::cases::{Case, Expect, Level, volumes};
use isolume::surface::extract;
use isolume::volume::Volume;
use solve::{Estimator, solve};

/// Runs `work` on every case that is a volume with cells.
fn each_solved(work: impl Fn(&Case, &Volume)) {
    let mut done = 0;
    for case in volumes() {
        if matches!(case.expect, Expect::Solved | Expect::Empty | Expect::NoTexels) {
            let volume = case.volume.as_ref().unwrap_or_else(|e| panic!("{}: {e}", case.name));
            work(&case, volume);
            done += 1;
        }
    }
    assert!(done > 50, "{done} cases");
}

#[test]
fn what_is_no_volume_is_refused_by_name() {
    let mut refused = 0;
    for case in volumes() {
        if let Expect::Refused(words) = case.expect {
            let error = case.volume.err().unwrap_or_else(|| panic!("{} was taken", case.name)).to_string();
            assert!(error.contains(words), "{}: {error}", case.name);
            refused += 1;
        }
    }
    assert!(refused >= 4, "{refused}");
}

#[test]
fn readers_say_what_they_replaced() {
    for case in volumes().into_iter().filter(|c| c.name.ends_with(" read") && c.expect == Expect::Solved) {
        let volume = case.volume.unwrap();
        assert_eq!(
            volume.notes.len(),
            usize::from(case.name != "range 1e-30 read" && case.name != "range 1e30 read"),
            "{}: {:?}",
            case.name,
            volume.notes
        );
        let (low, high) = volume.raw_range();
        assert!(low.abs().max(high.abs()) < 2f32.powi(101) && low < high, "{}: {low} {high}", case.name);
    }
}

#[test]
fn every_surface_is_closed_up_to_the_box_and_has_unit_normals() {
    each_solved(|case, volume| {
        let mut triangles = 0;
        for level in &case.levels {
            triangles += mesh::check(volume, level.of(volume), &format!("{} at {level:?}", case.name)).triangles.len();
        }
        assert_eq!(triangles == 0, case.expect == Expect::Empty, "{}: {triangles} triangles", case.name);
    });
}

#[test]
fn every_sample_type_gives_the_same_surface() {
    let all: Vec<Case> = volumes().into_iter().filter(|c| c.name.starts_with("samples ")).collect();
    assert!(all.len() >= 20);
    for level in [Level::Value(60.0), Level::Value(45.5)] {
        let reference = extract(all[0].volume.as_ref().unwrap(), level.of(all[0].volume.as_ref().unwrap())).unwrap();
        for case in &all {
            let volume = case.volume.as_ref().unwrap();
            assert_eq!(extract(volume, level.of(volume)).unwrap(), reference, "{} at {level:?}", case.name);
        }
    }
}

#[test]
fn every_estimator_is_finite_and_bounded_on_every_case() {
    each_solved(|case, volume| {
        let mut valid = 0;
        for estimator in Estimator::ALL {
            let solved = solve(volume, estimator).unwrap_or_else(|e| panic!("{} by {estimator:?}: {e}", case.name));
            valid = solved.check(&format!("{} by {estimator:?}", case.name));
        }
        assert_eq!(valid == 0, case.expect != Expect::Solved, "{}: {valid} valid texels", case.name);
    });
}

#[test]
fn volumes_without_cells_are_refused_by_the_estimators_and_have_no_surface() {
    let mut seen = 0;
    for case in volumes() {
        let Expect::NoCells(words) = case.expect else { continue };
        let volume = case.volume.unwrap();
        for estimator in Estimator::ALL {
            let error =
                solve(&volume, estimator).err().unwrap_or_else(|| panic!("{} was solved", case.name)).to_string();
            assert!(error.contains(words), "{}: {error}", case.name);
        }
        for level in &case.levels {
            assert!(mesh::check(&volume, level.of(&volume), &case.name).triangles.is_empty(), "{}", case.name);
        }
        seen += 1;
    }
    assert!(seen >= 5, "{seen}");
}

#[test]
fn every_case_is_lit_within_bounds_and_exported() {
    let lights = export::lights();
    let mut vertices = 0;
    each_solved(|case, volume| {
        let solved = solve(volume, Estimator::Positive).unwrap();
        for level in &case.levels {
            export::check(volume, &solved, level.of(volume), &lights, &format!("{} at {level:?}", case.name));
        }
    });
    for case in volumes() {
        // A volume without cells still makes valid empty files.
        if matches!(case.expect, Expect::NoCells(_)) {
            vertices += export::empty(&case.volume.unwrap(), &case.name);
        }
    }
    assert_eq!(vertices, 0);
}
