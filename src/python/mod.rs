//! The Python package `isolume`: the calls of the library on arrays of NumPy (feature `python`).
//!
//! This module is `isolume._isolume`, a thin layer of classes; what users see is the package beside it
//! (`src/python/isolume`), which makes arrays of what other packages have (xarray, SimpleITK, nibabel, dask), and objects of
//! theirs of surfaces. Nothing is computed in Python.
//!
//! * [`volume`]: volumes of arrays and files, and their bakes. `array`: arrays read where they are.
//! * [`store`]: stores, which bake what a surface lacks. [`surface`]: lit surfaces as arrays, pictures and files.
//! * [`environment`]: environments. `watch`: long calls outside the lock of the interpreter, with progress and Ctrl-C.
//! * [`mod@error`]: errors of the library as exceptions.

mod array;
mod bake;
mod environment;
mod error;
mod store;
mod surface;
mod volume;
mod watch;

use pyo3::prelude::*;

/// The part of the package that is compiled.
#[pymodule]
mod _isolume {
    #[pymodule_export]
    use super::environment::{Environment, built_in_environments, colormaps};
    #[pymodule_export]
    use super::store::Store;
    #[pymodule_export]
    use super::surface::Surface;
    #[pymodule_export]
    use super::volume::Volume;
    #[pymodule_export]
    use super::{main, page, version};
}

/// Runs the program with a command line, of which the first word is its name, and returns the exit code.
#[pyfunction]
fn main(py: Python<'_>, line: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| crate::cli::exit_code(line))
}

/// The page without its data, for a frame in a notebook.
#[pyfunction]
fn page() -> String {
    crate::view::page()
}

/// The version of the package.
#[pyfunction]
fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}
