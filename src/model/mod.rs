//! Implicit models: trees of primitives and operators whose solid is {f > iso} (BlobTrees, Wyvill, Guy and Galin 1999),
//! evaluated with their gradient and sampled to a grid. Knows nothing of volumes but the samples that it fills, and
//! nothing of files: [`crate::scene`] reads models in TOML.
//!
//! # Conventions
//! * f is large inside. Fields with a fall-off lie in \[0, weight\]; distances are stored negated, `radius − d`.
//! * A node gives value and gradient together, by the chain rule ([`scalar`]). Deformations are inverse maps ([`warp`]).
//! * `f64` and the crate `libm`, rounded once to `f32`: the same bytes on every machine, for any number of threads, and
//!   whether subtrees are pruned or not ([`sample`]).

pub mod contact;
pub mod convolution;
pub mod falloff;
pub mod formula;
pub mod grid;
pub mod interval;
pub mod leaf;
pub mod mesh;
pub mod operator;
pub mod rbf;
pub mod root;
pub mod sample;
pub mod scalar;
pub mod shape;
pub mod skeleton;
pub mod tree;
pub mod warp;

#[cfg(test)]
mod tests;

pub use contact::{Contact, Show};
pub use convolution::{Convolution, Kernel};
pub use falloff::Falloff;
pub use formula::Formula;
pub use grid::{Between, Grid};
pub use leaf::{Leaf, Skeletal};
pub use mesh::MeshDistance;
pub use operator::{Crease, Pasko};
pub use rbf::{Radial, Rbf};
pub use root::{Root, RootFinder, root_on_segment};
pub use sample::Counters;
pub use shape::{Round, Shape};
pub use skeleton::Skeletons;
pub use tree::{Node, Op, Tree};
pub use warp::{Kind, Region, Warp};
