//! Options as clap reads them, and the requests of the library that follow; nothing is opened here.

pub(in crate::cli) mod choices;
pub(in crate::cli) mod comparison;
pub(in crate::cli) mod light;
pub(in crate::cli) mod mesh;
pub(in crate::cli) mod photons;
pub(in crate::cli) mod picture;
pub(in crate::cli) mod scene;
pub(in crate::cli) mod transfer;
pub(in crate::cli) mod volume;
