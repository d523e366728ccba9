//! Flattened light transport: what fills a transfer texture. The estimators, their error bars, and
//! the one parallel loop. Knows nothing of probes, meshes and files; light would reach it only
//! through [`crate::sampling::DirectionalSource`], and the transfer estimators need none at all.
//!
//! # What is estimated
//! Exitant radiance of the Lambertian level set at x under a distant environment L(ω) = Σ L_i Y_i is
//! L_o = Σ_k ρ^(k+1) ⟨T_k(x), L⟩ with
//! T_0,i = (1/π) ∫ V(x, ω) Y_i(ω) (n·ω)⁺ dω and
//! T_{k+1,i}(x) = (1/π) ∫ (1−V) T_k,i(x'(x, ω)) (n·ω)⁺ dω, x' the first hit on the *same* level set
//! (flattened transport: Beason 2005; SH transfer per texel: Wyman et al. 2004, Sloan et al. 2002; we
//! differ in keeping the layers apart and free of albedo).

mod adaptive;
mod bake;
mod chunks;
mod control;
mod direct;
mod errors;
mod estimator;
mod gather;
mod geometric;
mod open;
mod path;
pub mod photon;
mod replay;
pub mod scatter;
mod scene_path;
mod summary;
mod sums;

#[cfg(test)]
mod tests;

pub use adaptive::Tolerance;
pub use bake::{
    Bake, ChunkBricks, Present, Progress, Sink, SurfacePoints, bake, bake_brick, estimates, noise_picked, pilot,
    share_traced, trial,
};
pub(crate) use chunks::most_in_work;
pub use direct::{Radiance, SurfacePoint, buried, direct};
pub use estimator::BrickOutput;
pub use gather::{Bias, CachePrecision, GatherSettings, Gathered, Lookups, gather, gather_memory};
pub(crate) use gather::{cache_memory, translucent};
pub use geometric::{CellPoints, ExactPoint, GeometricCounts, geometric, points_in_cells};
pub use path::{Settings, Target, TexelEstimate, radiance_weights};
pub use photon::{
    Density, Irradiance, IsovalueChoice, Isovalues, Kept, PhotonBake, PhotonEnergy, PhotonLight, PhotonLightSettings,
    PhotonMap, PhotonScene, PhotonSearch, PhotonSettings, SpecularPhotons, photon_bake, photon_bake_from,
    photon_bake_map, photon_direct,
};
pub use replay::{On, PathEnd, ReplayedPath, ReplayedTexel, replay, replay_paths, replay_texel};
pub use scene_path::{
    Airlight, Arrival, LevelSite, MOST_SPECULAR, MOST_TURNS, SceneCounts, SceneReference, SpecularLight, airlight,
    needs_photons, scene_radiance, site_radiance,
};
pub use summary::{ErrorHistogram, Summary};

/// Independent scrambles of each texel's points; error bars come from their spread.
///
/// Four: each halving of the points of a scrambled net costs accuracy (≤ 1.41× in RMS), and a t-interval with three
/// degrees of freedom is 1.6 times wider than the normal one. Pooling bands makes that 1.09 times
/// ([`crate::sampling::statistics::stored_degrees`]).
pub const REPLICATES: usize = 4;
