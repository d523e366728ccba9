//! Arrays of NumPy as volumes: samples of a type that volumes hold are read where they are.
//!
//! This is the one module here with unsafe code: a slice that outlives the lock of the interpreter. What it rests on stands at
//! [`Samples`].

#![allow(unsafe_code)]

use crate::volume::array::Data;
use crate::volume::{SampleOwner, SamplesView};
use numpy::{Element, PyArray3, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, dtype};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Arrays that are frozen, by the address of the object, which lives as long as its entry: how many volumes read it, and
/// whether it was writeable before.
static FROZEN: Mutex<Option<HashMap<usize, (usize, bool)>>> = Mutex::new(None);

/// An array that nobody may write to as long as this lives.
#[derive(Debug)]
struct Frozen {
    array: Py<PyAny>,
}

impl Frozen {
    fn new(array: &Bound<'_, PyAny>) -> PyResult<Self> {
        let flags = array.getattr("flags")?;
        let was_writeable: bool = flags.getattr("writeable")?.extract()?;
        {
            let mut frozen = FROZEN.lock().unwrap_or_else(PoisonError::into_inner);
            let entry = frozen.get_or_insert_default().entry(array.as_ptr() as usize).or_insert((0, was_writeable));
            entry.0 += 1;
        }
        let made = Self { array: array.clone().unbind() };
        if was_writeable {
            flags.setattr("writeable", false)?;
        }
        Ok(made)
    }
}

impl Drop for Frozen {
    fn drop(&mut self) {
        // At the end of the interpreter there is nobody left who could write.
        Python::try_attach(|py| {
            // A volume may end because an exception is on its way up, which what follows would lose.
            let raised = PyErr::take(py);
            self.thaw(py);
            if let Some(raised) = raised {
                raised.restore(py);
            }
        });
    }
}

impl Frozen {
    /// The array is as it was before the first who read it, if this is the last.
    fn thaw(&self, py: Python<'_>) {
        let array = self.array.bind(py);
        let was_writeable = {
            let mut frozen = FROZEN.lock().unwrap_or_else(PoisonError::into_inner);
            let frozen = frozen.get_or_insert_default();
            let key = array.as_ptr() as usize;
            let Some(entry) = frozen.get_mut(&key) else { return };
            entry.0 -= 1;
            if entry.0 > 0 {
                return;
            }
            frozen.remove(&key).is_some_and(|(_, was_writeable)| was_writeable)
        };
        if was_writeable {
            // NumPy refuses where the owner of the memory has become read-only meanwhile: then it stays as it is.
            let _ = array.getattr("flags").and_then(|flags| flags.setattr("writeable", true));
        }
    }
}

/// Where samples lie, by their type.
#[derive(Clone, Copy, Debug)]
enum Place {
    U8(*const u8),
    I8(*const i8),
    U16(*const u16),
    I16(*const i16),
    F32(*const f32),
}

/// The samples of an array that is held.
///
/// The slices it gives out are valid: the array is C-contiguous, aligned, in native byte order, and of the type of the
/// pointer, which was looked up when it was made; it is held by a reference, so its memory stays (NumPy resizes no array that
/// others refer to, unless told not to look). Nobody writes to it meanwhile: the array is flagged as read-only. As with a file that is
/// mapped into memory, this is a promise of whoever hands it over: views of the same memory that were made before stay
/// writeable.
#[derive(Debug)]
struct Samples {
    place: Place,
    count: usize,
    _array: Py<PyAny>,
    _frozen: Frozen,
}

// SAFETY: the memory is read alone, by any number of threads, as the type says.
unsafe impl Send for Samples {}
// SAFETY: as above.
unsafe impl Sync for Samples {}

impl SampleOwner for Samples {
    fn view(&self) -> SamplesView<'_> {
        use std::slice::from_raw_parts;
        // SAFETY: as the type says.
        unsafe {
            match self.place {
                Place::U8(first) => SamplesView::U8(from_raw_parts(first, self.count)),
                Place::I8(first) => SamplesView::I8(from_raw_parts(first, self.count)),
                Place::U16(first) => SamplesView::U16(from_raw_parts(first, self.count)),
                Place::I16(first) => SamplesView::I16(from_raw_parts(first, self.count)),
                Place::F32(first) => SamplesView::F32(from_raw_parts(first, self.count)),
            }
        }
    }
}

/// What an array is to a volume.
pub(super) enum Found {
    /// Samples that are read where they are.
    Shared(Arc<dyn SampleOwner>),
    /// Numbers of another type, copied.
    Copied(Data),
}

/// The samples of a C-contiguous array [z, y, x] in native byte order; `frozen` is the array of the user, which it may be a view
/// of, and which becomes read-only as long as the samples are used. Returns them with the dimensions in x, y, z.
///
/// # Errors
/// `TypeError` for an array of another shape, layout or type.
pub(super) fn samples_of(
    array: &Bound<'_, PyUntypedArray>,
    frozen: &Bound<'_, PyAny>,
) -> PyResult<([usize; 3], Found)> {
    let found = array.dtype();
    let py = array.py();
    let &[z, y, x] = array.shape() else {
        return Err(PyTypeError::new_err(format!("an array of {} dimensions, expected 3: [z, y, x]", array.ndim())));
    };
    let dims = [x, y, z];
    let is_aligned: bool = array.getattr("flags")?.getattr("aligned")?.extract()?;
    if !array.is_c_contiguous() || !is_aligned || found.is_native_byteorder() == Some(false) {
        return Err(PyTypeError::new_err("an array that is not C-contiguous, aligned and in native byte order"));
    }
    macro_rules! shared {
        ($($t:ty, $variant:ident);*) => {$(
            if found.is_equiv_to(&dtype::<$t>(py)) {
                let first = array.cast::<PyArray3<$t>>()?.data() as *const $t;
                let samples = Samples {
                    place: Place::$variant(first),
                    count: x * y * z,
                    _array: array.clone().into_any().unbind(),
                    _frozen: Frozen::new(frozen)?,
                };
                return Ok((dims, Found::Shared(Arc::new(samples))));
            }
        )*};
    }
    shared!(u8, U8; i8, I8; u16, U16; i16, I16; f32, F32);
    macro_rules! copied {
        ($($t:ty, $variant:ident);*) => {$(
            if found.is_equiv_to(&dtype::<$t>(py)) {
                return Ok((dims, Found::Copied(Data::$variant(numbers::<$t>(array)?))));
            }
        )*};
    }
    copied!(u32, U32; i32, I32; u64, U64; i64, I64; f64, F64);
    Err(PyTypeError::new_err(format!("an array of {found}, expected integers or real floating-point numbers")))
}

/// A copy of the numbers, in the order of memory, which is that of the indices.
fn numbers<T: Element>(array: &Bound<'_, PyUntypedArray>) -> PyResult<Vec<T>> {
    Ok(array.cast::<PyArray3<T>>()?.to_vec()?)
}
