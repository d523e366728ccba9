//! The whole of a bake: what is asked for, what of it is there already or damaged, how exact it is to be, and the chunks that
//! go into the store one by one.
//!
//! A [`Bake`] says what, in a few calls; a [`Request`] says it of one volume, in every detail, and [`run()`] does it, resumably: a
//! bake that is stopped goes on with the same request and ends with the same bytes. An [`Observer`] is the only way in for the
//! clock, for a wish to stop, and out for notes and progress.

mod builder;
mod checks;
#[doc(hidden)]
pub mod cluster;
mod deal;
mod goal;
mod memory;
mod observer;
mod pending;
mod plan;
mod quality;
mod repair;
mod report;
mod request;
mod run;
mod scene;

#[cfg(test)]
mod tests;

pub use builder::Bake;
#[doc(hidden)]
pub use goal::{ESCAPE, spread};
pub use goal::{ForLight, Goal};
#[doc(hidden)]
pub use memory::{bytes_of_bake, bytes_of_texel, crossed_cells};
pub use observer::{Observer, Silent, Task};
#[doc(hidden)]
pub use quality::{Quality, lattice_of};
pub use report::{GoalRecord, PhotonReport, Report};
pub use request::{Estimator, Hints, Request, Share, Writing};
pub use run::run;
#[doc(hidden)]
pub use scene::{bytes_of_scene_texel, layout_of_scene, surroundings};
