//! isolume: precomputed light transfer on every isosurface of a volume.

pub mod error;
pub mod geom;
pub mod sampling;
pub mod sh;
pub mod volume;
pub mod level;
pub mod scene;
pub mod transfer;
pub mod transport;
pub mod probe;
pub mod surface;
pub mod relight;
pub mod render;
pub mod export;
pub mod cli;

pub use error::{Error, Result};
