//! The whole of a bake: what is asked for, what of it is there already or damaged, how exact it is to be, and the chunks that
//! go into the store one by one.
//!
//! A [`Request`] says what; [`run()`] does it, resumably: a bake that is stopped goes on with the same request and ends with the
//! same bytes. An [`Observer`] is the only way in for the clock, for a wish to stop, and out for notes and progress.
//!
//! ```
//! use isolume::bake::{self, Request, Silent};
//! use isolume::scene::Effects;
//! use isolume::transfer::{Lattice, Layers, Layout};
//! use isolume::transport::Settings;
//! use isolume::volume::field;
//!
//! # fn main() -> isolume::Result<()> {
//! # let folder = tempfile::tempdir().map_err(|e| isolume::Error::io("", "make a folder", e))?;
//! # let path = folder.path().join("bumps.isolume");
//! let volume = field::by_name("bumpbox:12")?.expect("a field").sample()?;
//! let layers = Layers::uniform(2, 3)?;
//! let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: layers.clone() };
//! let settings = Settings { layers, rays: 16, seed: 0, target: None, positive: false };
//! let effects = Effects::default();
//! let mut request = Request::new(&volume, "bumpbox:12", layout, settings, &effects);
//! request.isovalues = Some(vec![47.0]);
//! let (store, report) = bake::run(&request, &path, &Silent)?;
//! assert_eq!(report.chunks_baked, store.holdings()?.chunks);
//! # Ok(())
//! # }
//! ```

mod goal;
mod memory;
mod observer;
mod pending;
mod repair;
mod report;
mod request;
mod run;
mod scene;

pub use goal::{ESCAPE, ForLight, Goal, spread};
pub use memory::{bytes_of_bake, bytes_of_texel};
pub use observer::{Observer, Silent, Task};
pub use report::{GoalRecord, PhotonReport, Report};
pub use request::{Estimator, Hints, Request, Share, Writing};
pub use run::run;
pub use scene::{bytes_of_scene_texel, layout_of_scene, surroundings};
