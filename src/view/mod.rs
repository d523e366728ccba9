//! The live page: a level set that is ray-marched and relit in a browser, from the data of a store.
//!
//! Pure functions from a texture and a volume to bytes: [`pack()`] makes the data, [`page()`] the HTML around it.
//! Knows no sockets and no files; `isolume view` serves or writes what it gets from here.
//!
//! * [`mod@pack`]: header (JSON) and payload (sections of numbers) as the page reads them.
//! * [`mod@page`]: the page with its scripts, served or in one file.
//!
//! # What crosses into the page
//! The texels that have a level set, as planes of one coefficient each, 16-bit floats or 8-bit with a scale to each
//! coefficient; the samples; coefficients of probes; figures about the bake. In the page a change of environment,
//! rotation or albedo changes only coefficients (a few hundred numbers); the GPU multiplies them with the texels.
//!
//! # Frames
//! Probes come in the *upright* frame, world axes as if up were +z: there a turn of the light is a turn about z, which
//! mixes only m and −m. One fixed rotation, sent with the data, takes the coefficients from there into world.

pub mod pack;
pub mod page;

mod samples;
mod texels;

#[cfg(test)]
mod tests;

pub use pack::{Coding, Options, Package, Subject, pack};
pub use page::page;
