//! The live page: a level set that is ray-marched and relit in a browser, from the data of a store.
//!
//! Pure functions from textures and a volume to bytes: [`pack()`] makes the data, [`page()`] the HTML around it.
//! They know no sockets and no files; `isolume view` writes what it gets from here, or has it served.
//!
//! * [`mod@pack`]: header (JSON) and payload (sections of numbers) as the page reads them.
//! * [`mod@page`]: the page with its scripts, served or in one file.
//! * `server` (feature `cli`): serves both on this machine.
//!
//! # What crosses into the page
//! The texels that have a level set, as planes of one coefficient each, 16-bit floats or 8-bit with a scale to each
//! coefficient; the samples; coefficients of probes; figures about the bake. In the page a change of environment,
//! rotation or albedo changes only coefficients (a few hundred numbers); the GPU multiplies them with the texels.
//!
//! Of a scene the coefficients come in three channels, and behind them G_k of the level set's emission and of each
//! luminaire: their powers are sliders. Walls are not sent, and of several volumes that light each other one: the page
//! names the others with their isovalues.
//!
//! # Frames
//! Probes come in the *upright* frame, world axes as if up were +z: there a turn of the light is a turn about z, which
//! mixes only m and −m. One fixed rotation, sent with the data, takes the coefficients from there into world.

pub mod pack;
pub mod page;
#[cfg(feature = "cli")]
pub mod server;

mod samples;
mod store;
mod texels;

#[cfg(test)]
mod tests;

pub use pack::{Coding, Options, Package, Subject, Surrounded, pack};
pub use page::page;
pub use store::{package_of, page_probes, volume_shown};
