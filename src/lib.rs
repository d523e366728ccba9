//! Precomputed light transfer on every isosurface of a volume: bake once, then relight any isosurface by any
//! distant environment, as dot products.
//!
//! ```
//! use isolume::{Bake, LightOptions, LitOptions, Material, MeshOptions, Scene, Session, Silent, probe};
//!
//! # fn main() -> isolume::Result<()> {
//! # let folder = tempfile::tempdir().map_err(|e| isolume::Error::io("", "make a folder", e))?;
//! # let path = |name: &str| folder.path().join(name);
//! let scene = Scene::open("bumpbox:12")?; // a volume file, an analytic field, or a scene.toml
//! let bake = Bake::of(&scene).isovalues([47.0]).layers(2).bands(3).rays(16);
//! let (store, _) = bake.run(path("bumps.isolume"), &Silent)?; // once, for every light; goes on if it was stopped
//!
//! let session = Session::open(&store)?;
//! let surface = session.surface(47.0)?;
//! for name in ["sunset", "studio"] {
//!     let light = probe::open(name, &Default::default())?; // or an HDR image
//!     let light = session.light(&light, &LightOptions::default())?;
//!     let lit = surface.lit(&light, &Material::new([0.7; 3], [0.0; 3])?, &LitOptions::default())?;
//!     lit.write_gltf(path(&format!("{name}.glb")), &MeshOptions::default())?;
//! }
//! # Ok(())
//! # }
//! ```
//!
//! [`Scene`] says what is lit, [`Bake`] fills a [`Store`], [`Session`] relights it: the command line is a caller of these, as
//! your program may be. More in `examples/`: `bake` (to an error, resumably, watched), `relight`, `walls`, `coupled`, `shares`,
//! `custom_field`. Modules that are not listed below ([`transport`], [`level`], [`sh`] and others) are the insides: public for
//! tests and measurements, and free to change.
//!
//! The rest of this page is the map: read it in five minutes and you know where a change belongs. What a word means in
//! numbers is stated once, in the module named.
//!
//! # Data path
//! ```text
//! file, field, .toml ─scene→ Scene ─bake→ plan → transport → bricks ─transfer::store→ disk
//!                                                                       (once, no light in hand)
//! environment ─probe::open→ image ─project, rotate→ relight::Light ┐
//! Store ─session→ Volume ─surface::extract(c)→ Mesh ───────────────┴→ relight → vertex colours ─export→ .glb .ply .usdz
//!                                                                       (often, in milliseconds)
//! Volume, light ─render→ preview picture ─export→ .png
//! Bricks, Volume, probes ─view→ a page that does all of this on the GPU of a browser
//! ```
//! The transfer of a texel does not know the light: exitant radiance of the level set {h = c} at x, a Lambertian
//! surface of albedo ρ, is Σ_k ρ^(k+1) ⟨T_k(x), L⟩ with one vector T_k for light that was reflected k times on
//! its way. In flattened transport a ray sees only its own level set, so a colour that depends on the isovalue
//! alone is exact too: relighting *and* recolouring never trace a ray.
//!
//! Walls and luminaires around the volume are the same for every isovalue. Where a scene has them, transfer has three
//! channels and each luminaire a texture of its own ([`transfer::Group`]), and another estimator fills them
//! ([`transport::Bake::among`]); the albedo of the level set and the power of the luminaires stay free for relighting.
//! Other volumes may stand there too: a ray then carries an isovalue for each, and [`scene::Coupling`] says which belong
//! together; every volume gets a texture of its own.
//!
//! # Words
//! * **h**: the scalar field, trilinear between samples, vertex-centred ([`volume`]).
//! * **c**: an isovalue, always in the file's values where it crosses the interface ([`volume`]).
//! * **solid**: {h > c}, or {h < c} with [`volume::Solid::Below`]; light lives on the other side ([`volume`]).
//! * **texel**: a point of the texture lattice; its level set is the one through it ([`transfer`], [`level`]).
//! * **layer** k: light reflected k times, T_k, grey and free of albedo ([`transfer`]).
//! * **degree** l ≤ l_max, **bands** n = l_max + 1, n² coefficients ([`sh`]).
//! * **probe**: a distant environment, linear radiance ([`probe`]).
//!
//! # Spaces
//! *grid* (voxel index) → *world* (the file's frame and unit, by an affine `world_from_grid` that may be oblique
//! and left-handed) → *glTF* (Y-up, right-handed, by [`geom::Up`], which also says what is the front). Environments live
//! in the glTF frame ([`probe::latlong`] states how an image lies there); transfer lives in world axes, and a probe's
//! coefficients are rotated into world, never the transfer. A gradient is a covector. The space is in the name:
//! `hit_in_world`, `world_from_grid`; in a product the inner names meet.
//!
//! # Units
//! World coordinates are in the file's unit ([`volume::LengthUnit`] says how many metres that is, if known).
//! Radiance is linear Rec.709 in the unit of the environment. Angles are radians inside and degrees on the command
//! line. Exposure is in stops.
//!
//! # Spherical harmonics
//! Real, orthonormal, without the Condon-Shortley sign in the result, index l(l+1)+m: Y_1,-1 = 0.488603 y,
//! Y_1,0 = 0.488603 z, Y_1,1 = 0.488603 x. Stated in [`sh`].
//!
//! # Who may use whom
//! A module uses only modules above it, and not those in the last column; `tests/layering` enforces it.
//!
//! | module | holds | knows nothing of |
//! |---|---|---|
//! | [`error`] | the one error type; errors are values | everything else |
//! | [`finding`] | what a diagnosis found, how often, what is done about it | everything else |
//! | [`quantity`] | counts, bytes, times and shares as people read them | everything else |
//! | [`mod@file`] | opening plain files, and those that other files name | formats |
//! | [`memory`] | how much memory the process may have, and what sets the bound | what it is for |
//! | `staging` | files and directories that appear whole, what killed processes leave | what is in them |
//! | [`grid3`] | places in a grid of three axes and their linear index | everything else |
//! | [`geom`] | directions, normals as covectors, frames, boxes, affine maps | everything else |
//! | [`srgb`] | the transfer function of sRGB, both ways | everything else |
//! | [`sampling`] | numbers by their index, Owen-Sobol points, warps in threes, statistics, `DirectionalSource` | volumes, SH, threads, the clock |
//! | [`sh`] | basis, coefficients, projection, rotation, windows | colour, images, volumes |
//! | [`model`] | implicit models: trees of primitives and operators with value and gradient, sampled in bricks | volumes, SH, files, TOML |
//! | [`probe`] | environment images, skies, projection, orientation | volumes, transfer |
//! | [`volume`] | samples and grid, readers from `impl Read`, analytic fields | light, rays |
//! | [`level`] | rays with an isovalue for life, the min/max pyramid, roots in a cell, B-spline normals | light, SH, random numbers |
//! | [`surface`] | extraction of watertight meshes | light, SH, transfer |
//! | [`scene`] | descriptions in TOML, walls and luminaires ([`scene::geometry`]), materials over the isovalue, environments as luminaires, the plan of effects | solvers' insides |
//! | [`transfer`] | lattice, layers, bricks, selections, the store on disk | how transfer was computed; probes |
//! | [`transport`] | the estimators, error bars, the parallel loop, paths and photons as references of one surface | probes, meshes, files |
//! | [`mod@bake`] | requests, goals, what is pending or damaged, the bake into a store | probes, relighting, the clock |
//! | [`relight`] | the runtime: contraction, lookup, albedo, emission, exposure | rays, solvers, files |
//! | [`render`] | camera rays for previews, what pixels see | solvers |
//! | [`export`] | GLB, USDZ, PLY, PNG, VTI, NRRD, contact sheets, simpler meshes, lightmaps, atomic files | volumes, SH, light |
//! | [`session`] | a store, its surfaces, and light on them: meshes and pictures, step by step | the bake, the clock |
//! | [`cache`] | stores of volumes that are lit without a bake of their own: their place, drafts before them, what leaves; the light that their errors are measured by | surfaces, files of lit surfaces |
//! | [`lit`] | from a store, a volume or a scene to files of lit surfaces: choices, drafts, bakes into the cache | the clock |
//! | [`demo`] | the demonstration: a small brain, inside the program, baked and lit | the clock |
//! | [`mod@compare`] | the store against paths and photons on the same surface, the budget of its errors, pictures of the difference | the clock |
//! | [`study`] | what accuracy costs: settings against one reference, the front, the figure; where samples of a texture should lie | the clock |
//! | [`inspect`] | what is in a volume or a store, what is unusual about a file, how far a bake has come | what is done about it |
//! | [`view`] | the live page and its data, as bytes; the server of the page, with the feature `cli` | solvers, and outside the server sockets |
//! | `signals` | what a program answers to signals of the system; feature `cli` | everything else |
//! | `cli` | flags, progress, printing, threads, the clock, paths | the insides: public interface only |
//! | `python` | the same calls on arrays of NumPy (feature `python`) | how anything is computed |
//!
//! # Habits that bind
//! * The same bytes for any number of threads: each parallel item writes its own slot, sums run in a fixed order,
//!   a random number is a pure function of (seed, texel, replicate, path, bounce). No platform mathematics in
//!   solver code: the crate `libm`.
//! * Errors are values ([`Error`]); a panic is a bug. The library never prints or exits, and reads the clock in two places: the
//!   server of the page gives up connections that fall silent, and the cache notes when a store was used and how long it waits.
//! * A texel can be replayed alone (`isolume bake --replay-texel x,y,z`, [`transport::replay`]).

// Bad input is an `Err`: what only tests may do does not compile elsewhere at the gate, which makes warnings errors.
#![cfg_attr(
    not(test),
    warn(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::todo, clippy::unimplemented)
)]

pub mod error;
#[doc(hidden)]
pub mod finding;
#[doc(hidden)]
pub mod quantity;
#[doc(hidden)]
pub mod file;
#[doc(hidden)]
pub mod memory;
mod staging;
#[doc(hidden)]
pub mod grid3;
#[doc(hidden)]
pub mod geom;
#[doc(hidden)]
pub mod srgb;
#[doc(hidden)]
pub mod sampling;
#[doc(hidden)]
pub mod sh;
pub mod probe;
#[doc(hidden)]
pub mod model;
pub mod volume;
#[doc(hidden)]
pub mod level;
#[doc(hidden)]
pub mod surface;
pub mod scene;
#[doc(hidden)]
pub mod transfer;
#[doc(hidden)]
pub mod transport;
pub mod bake;
#[doc(hidden)]
pub mod relight;
#[doc(hidden)]
pub mod render;
#[doc(hidden)]
pub mod export;
pub mod session;
#[doc(hidden)]
pub mod cache;
#[doc(hidden)]
pub mod lit;
#[doc(hidden)]
pub mod demo;
#[doc(hidden)]
pub mod compare;
#[doc(hidden)]
pub mod study;
#[doc(hidden)]
pub mod inspect;
#[doc(hidden)]
pub mod view;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod signals;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "python")]
mod python;

pub use bake::{Bake, ForLight, Observer, Silent};
pub use cache::for_light;
pub use error::{Error, Result};
pub use export::Image;
pub use export::simplify::Lod;
pub use geom::{Bounds, Up};
/// The crate whose vectors and matrices are in the public interface, in the version that is.
pub use glam;
pub use probe::Probe;
pub use relight::{Exposure, Material};
pub use render::{Projection, View};
pub use scene::Scene;
pub use session::{LightOptions, LitOptions, MeshOptions, Session};
pub use sh::Window;
pub use transfer::store::{Store, StoreOptions};
pub use transport::Progress;
pub use volume::{Isovalue, Volume};
