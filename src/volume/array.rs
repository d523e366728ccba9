//! Volumes from arrays in memory: numbers of any type, or samples that somebody else owns.

use super::assemble::{Parts, assemble};
use super::read::ReadHint;
use super::{LengthUnit, MOST_MAGNITUDE, SampleOwner, Samples, SamplesView, Series, Solid, Volume, with_samples};
use crate::error::Result;
use crate::geom::Affine;
use rayon::prelude::*;
use std::sync::Arc;

pub use super::decode::Data;

/// What a volume in memory is called, and how it lies in space.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Its name.
    pub name: String,
    /// Where its samples are: x fastest.
    pub world_from_grid: Affine,
    /// Unit of world coordinates.
    pub unit: LengthUnit,
    /// From samples to values, `slope·raw + inter`: the slope, and
    pub slope: f64,
    /// the offset.
    pub inter: f64,
    /// Which side is matter: NaN and infinite samples become the extreme of the other.
    pub solid: Solid,
}

/// A volume of numbers, x fastest. What is changed to make samples of them, such as NaN, stands in its notes.
///
/// # Errors
/// When no number is finite, and as [`Volume::new`] and [`Volume::with_scaling`].
pub fn from_numbers(dims: [usize; 3], data: Data, placement: Placement) -> Result<Volume> {
    let Placement { name, world_from_grid, unit, slope, inter, solid } = placement;
    let (series, notes) = (Series::default(), Vec::new());
    let parts = Parts { format: "array", dims, data, slope, inter, world_from_grid, unit, series, notes };
    assemble(parts, &ReadHint { name, solid, ..ReadHint::default() })
}

/// A volume of samples that somebody else owns, read where they are: copied only where samples have to be changed, being
/// NaN, infinite or beyond [`MOST_MAGNITUDE`].
///
/// # Errors
/// As [`from_numbers`].
pub fn from_owner(dims: [usize; 3], owner: Arc<dyn SampleOwner>, placement: Placement) -> Result<Volume> {
    const PART: usize = 1 << 16;
    if let SamplesView::F32(samples) = owner.view()
        && !samples.par_chunks(PART).all(|part| part.iter().fold(true, |all, v| all & (v.abs() <= MOST_MAGNITUDE)))
    {
        return from_numbers(dims, Data::F32(samples.to_vec()), placement);
    }
    let samples = Samples::Shared(owner);
    let mut volume =
        Volume::new(dims, samples, placement.world_from_grid)?.with_scaling(placement.slope, placement.inter)?;
    (volume.name, volume.unit, volume.solid) = (placement.name, placement.unit, placement.solid);
    Ok(volume)
}

/// Where the first sample lies in memory, for who wants to know whether they were copied.
pub fn address(samples: &Samples) -> usize {
    with_samples!(samples, s => s.as_ptr() as usize)
}

/// How many metres a unit of length is, by its name, such as "mm", "um", "nm" or "A".
pub fn metres_in(unit: &str) -> Option<f64> {
    super::format::metres_in(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Owner(Vec<f32>);

    impl SampleOwner for Owner {
        fn view(&self) -> SamplesView<'_> {
            SamplesView::F32(&self.0)
        }
    }

    fn placement() -> Placement {
        Placement {
            name: "array".into(),
            world_from_grid: Affine::IDENTITY,
            unit: LengthUnit::Unknown,
            slope: 2.0,
            inter: 1.0,
            solid: Solid::Above,
        }
    }

    #[test]
    fn samples_of_others_are_read_where_they_are_and_light_as_ones_own() {
        let values: Vec<f32> = (0..60).map(|i| (i * i % 17) as f32).collect();
        let owner = Arc::new(Owner(values.clone()));
        let there = owner.0.as_ptr() as usize;
        let shared = from_owner([5, 4, 3], owner, placement()).unwrap();
        let own = from_numbers([5, 4, 3], Data::F32(values), placement()).unwrap();
        assert_eq!(address(shared.samples()), there);
        assert_eq!((shared.samples(), shared.raw_range()), (own.samples(), own.raw_range()));
        assert_eq!(shared.content_hash(), own.content_hash());
        assert_eq!(address(shared.clone().samples()), there);
    }

    #[test]
    fn what_has_to_be_changed_is_copied_with_a_note() {
        let mut values = vec![1.0f32; 27];
        (values[3], values[4]) = (f32::NAN, -2.0);
        let volume = from_owner([3; 3], Arc::new(Owner(values)), placement()).unwrap();
        assert_eq!(volume.samples().raw(3), -2.0);
        assert_eq!((volume.notes.len(), volume.notes[0].count), (1, 1));
        assert!(from_owner([3; 3], Arc::new(Owner(vec![f32::NAN; 27])), placement()).is_err());
        assert!(from_owner([3, 3, 2], Arc::new(Owner(vec![0.0; 27])), placement()).is_err());
        let huge = from_owner([3; 3], Arc::new(Owner(vec![f32::MAX; 27])), placement()).unwrap();
        assert!((huge.value_range().1 / f64::from(f32::MAX) - 2.0).abs() < 1e-6);
    }
}
