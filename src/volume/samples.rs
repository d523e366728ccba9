//! Samples in their native type, in memory of their own or of somebody else.

use crate::error::Result;
use glam::Vec4;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// The samples of a volume in their native type, x fastest. Floating samples are finite.
#[derive(Clone, Debug)]
pub enum Samples {
    /// 8-bit unsigned.
    U8(Vec<u8>),
    /// 8-bit signed.
    I8(Vec<i8>),
    /// 16-bit unsigned.
    U16(Vec<u16>),
    /// 16-bit signed.
    I16(Vec<i16>),
    /// 32-bit floating point.
    F32(Vec<f32>),
    /// Of any of these types, in memory that belongs to somebody else.
    Shared(Arc<dyn SampleOwner>),
}

/// Memory with samples that a volume reads where they are, such as the array of another program.
#[doc(hidden)]
pub trait SampleOwner: Send + Sync + std::fmt::Debug {
    /// The samples: the same, at the same place, as long as it lives.
    fn view(&self) -> SamplesView<'_>;

    /// Where in a file they are read, if they are: then they lie in the cache of the system and take no memory of this process.
    fn place(&self) -> Option<Place> {
        None
    }

    /// Refuses samples that another program has changed since.
    ///
    /// # Errors
    /// With the name of their file.
    fn check(&self) -> Result<()> {
        Ok(())
    }
}

/// Where samples lie in a file: all of them, one after the other, as a volume holds them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[doc(hidden)]
pub struct Place {
    /// The file.
    pub file: PathBuf,
    /// Its first byte that is one of a sample.
    pub offset: u64,
    /// Its length, and
    pub bytes: u64,
    /// when it was last written, as the system counts: nanoseconds since 1970 on Unix.
    pub modified: i64,
}

/// Samples to be read, by their type.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub enum SamplesView<'a> {
    /// 8-bit unsigned.
    U8(&'a [u8]),
    /// 8-bit signed.
    I8(&'a [i8]),
    /// 16-bit unsigned.
    U16(&'a [u16]),
    /// 16-bit signed.
    I16(&'a [i16]),
    /// 32-bit floating point.
    F32(&'a [f32]),
}

/// Runs `$body` with `$s` bound to the slice of samples, whatever its type.
macro_rules! with_samples {
    ($samples:expr, $s:ident => $body:expr) => {
        match $samples.view() {
            $crate::volume::SamplesView::U8($s) => $body,
            $crate::volume::SamplesView::I8($s) => $body,
            $crate::volume::SamplesView::U16($s) => $body,
            $crate::volume::SamplesView::I16($s) => $body,
            $crate::volume::SamplesView::F32($s) => $body,
        }
    };
}
pub(crate) use with_samples;

/// Samples that a thread looks at in a row.
const PART: usize = 1 << 16;

/// A sample type that a volume can hold.
#[doc(hidden)]
pub trait Sample: Copy + Send + Sync + 'static {
    /// The sample as a number; exact for every type held.
    fn raw(self) -> f32;

    /// The first samples and the second ones of four pairs, as numbers. Each pair is read as one word.
    fn turned(pairs: [[Self; 2]; 4]) -> (Vec4, Vec4);
}

macro_rules! sample {
    ($($t:ty, $bits:ty, $word:ty);*) => {$(impl Sample for $t {
        #[inline(always)]
        fn raw(self) -> f32 {
            self as f32
        }

        #[inline(always)]
        fn turned(pairs: [[Self; 2]; 4]) -> (Vec4, Vec4) {
            let (mut first, mut second) = ([0.0; 4], [0.0; 4]);
            for i in 0..4 {
                let word = <$word>::from(pairs[i][0] as $bits) | <$word>::from(pairs[i][1] as $bits) << <$bits>::BITS;
                first[i] = word as $bits as $t as f32;
                second[i] = (word >> <$bits>::BITS) as $bits as $t as f32;
            }
            (Vec4::from_array(first), Vec4::from_array(second))
        }
    })*};
}
sample!(u8, u8, u16; i8, u8, u16; u16, u16, u32; i16, u16, u32);

impl Sample for f32 {
    #[inline(always)]
    fn raw(self) -> f32 {
        self
    }

    #[inline(always)]
    fn turned([a, b, c, d]: [[Self; 2]; 4]) -> (Vec4, Vec4) {
        let word = |[first, second]: [Self; 2]| u64::from(first.to_bits()) | u64::from(second.to_bits()) << 32;
        let (front, back): (Vec4, Vec4) = (bytemuck::cast([word(a), word(b)]), bytemuck::cast([word(c), word(d)]));
        (Vec4::new(front.x, front.z, back.x, back.z), Vec4::new(front.y, front.w, back.y, back.w))
    }
}

impl PartialEq for Samples {
    /// Whether type and samples are the same, whoever owns them.
    fn eq(&self, other: &Self) -> bool {
        self.view() == other.view()
    }
}

impl Samples {
    /// The samples to be read.
    #[doc(hidden)]
    pub fn view(&self) -> SamplesView<'_> {
        match self {
            Self::U8(s) => SamplesView::U8(s),
            Self::I8(s) => SamplesView::I8(s),
            Self::U16(s) => SamplesView::U16(s),
            Self::I16(s) => SamplesView::I16(s),
            Self::F32(s) => SamplesView::F32(s),
            Self::Shared(owner) => owner.view(),
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        with_samples!(self, s => s.len())
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The raw sample at a linear index.
    #[doc(hidden)]
    pub fn raw(&self, index: usize) -> f32 {
        with_samples!(self, s => s[index].raw())
    }

    /// The name of the type as NumPy writes it: "uint8", "int8", "uint16", "int16", "float32".
    pub fn type_name(&self) -> &'static str {
        match self.view() {
            SamplesView::U8(_) => "uint8",
            SamplesView::I8(_) => "int8",
            SamplesView::U16(_) => "uint16",
            SamplesView::I16(_) => "int16",
            SamplesView::F32(_) => "float32",
        }
    }

    /// Smallest and largest raw sample; (0, 0) when empty.
    #[doc(hidden)]
    pub fn raw_range(&self) -> (f32, f32) {
        fn range<T: Sample>(samples: &[T]) -> (f32, f32) {
            let start = samples.first().map_or(0.0, |s| s.raw());
            let wider = |(lo, hi): (f32, f32), (l, h): (f32, f32)| (lo.min(l), hi.max(h));
            let parts = samples.par_chunks(PART);
            let parts = parts.map(|part| part.iter().fold((start, start), |all, s| wider(all, (s.raw(), s.raw()))));
            parts.collect::<Vec<_>>().into_iter().fold((start, start), wider)
        }
        with_samples!(self, s => range(s))
    }

    /// The index of the first sample that is not finite.
    pub(super) fn first_not_finite(&self) -> Option<usize> {
        let SamplesView::F32(samples) = self.view() else { return None };
        samples.par_chunks(PART).enumerate().find_map_first(|(i, part)| {
            // All of a part at once first: a search stops at every sample.
            let all = part.iter().fold(true, |all, v| all & v.is_finite());
            if all { None } else { part.iter().position(|v| !v.is_finite()).map(|at| PART * i + at) }
        })
    }

    /// Bytes of memory that they take of this process: none of samples that are read in their file.
    #[doc(hidden)]
    pub fn bytes_owned(&self) -> u64 {
        match self {
            Self::Shared(owner) if owner.place().is_some() => 0,
            _ => self.bytes().len() as u64,
        }
    }

    /// Where in a file they are read, if they are.
    #[doc(hidden)]
    pub fn place(&self) -> Option<Place> {
        match self {
            Self::Shared(owner) => owner.place(),
            _ => None,
        }
    }

    /// Refuses samples whose file another program has changed since it was opened.
    ///
    /// # Errors
    /// With the name of the file.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Shared(owner) => owner.check(),
            _ => Ok(()),
        }
    }

    /// The samples as bytes in native (little-endian on every supported machine) order.
    pub fn bytes(&self) -> &[u8] {
        with_samples!(self, s => bytemuck::cast_slice(s))
    }
}

/// The largest magnitude of samples; none where one is not finite.
pub(super) fn largest_finite(samples: &[f32]) -> Option<f32> {
    let of_part =
        |part: &[f32]| part.iter().fold((0.0f32, true), |(most, all), v| (most.max(v.abs()), all & v.is_finite()));
    let parts: Vec<(f32, bool)> = samples.par_chunks(PART).map(of_part).collect();
    let (most, all) = parts.iter().fold((0.0f32, true), |(most, all), part| (most.max(part.0), all & part.1));
    all.then_some(most)
}
