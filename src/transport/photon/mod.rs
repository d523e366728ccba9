//! Flattened photon mapping (Beason 2005): photons that carry an isovalue for life, kept in four dimensions.
//!
//! # Emission
//! A photon takes an isovalue c from a density p(c), and carries the flux-height F = Φ/(p(c) n), n the photons of its source: power
//! times isovalue, so that in every stretch dc of isovalues the photons of that stretch make up the light on those level
//! sets. Φ is the power of a rectangle, sphere or shining wall (uniform on it, cosine about the normal), of a point (the same in
//! all directions), or E π R² of parallel light that crosses a sphere of radius R around the whole scene. A photon of the environment
//! comes from a direction ω, drawn from the light's own density p(ω), and starts uniformly on the disk of that sphere across ω:
//! Φ = L(ω) π R² / p(ω). It sees the level set of c alone, walls, mirrors and glass (`flight`). Photons that enter the box
//! inside their solid are discarded, as rays of the bake can never leave that way either. Every hit on the volume's level set is
//! kept; light by way of mirrors and glass alone in a map of its own, since it has edges.
//!
//! # Density
//! A photon lies on its level set, so its four coordinates (x, κc) are a point of the graph of the field, a
//! three-dimensional surface. The k nearest of a query lie within r of it; where the field is linear over that
//! distance with a gradient of length g, their positions fill an ellipsoid, r across and r/√(1+κ²g²) along the
//! normal, of volume V = 4/3 π r³/√(1+κ²g²). A volume dV holds the level sets of an area dA over a stretch
//! dc = g dn, so that E = ΣF/(g V) = ΣF κ_eff/(4/3 π r³) with κ_eff = √(κ² + 1/g²).
//!
//! We differ from Beason 2005, eq. 4.9 (unclipped) and 4.10 (clipped), which take κ for κ_eff: the first reads E κg/√(1+κ²g²), 71 %
//! of the truth at κg = 1 and 10 % at 0.1 ([`Density`] keeps both for study). We cut what the ellipsoid has outside the box
//! and outside the isovalues that were drawn, and leave out the k-th photon, whose distance is the radius: with it
//! the mean of ΣF/V would be k/(k−1) too large.
//!
//! κ = γ · extent(box) / extent(isovalues), the diagonal of the box over the range of the samples. So all lengths here
//! are in diagonals and all isovalues in ranges, and nothing depends on the scale of either.
//!
//! # Errors
//! The stated standard error is the noise of the photons alone. The bias of a search that reaches over edges, and over
//! surfaces that bend within r, is not in it: it falls as the number of photons rises, as r² ~ n^(−2/3).

mod caustics;
mod energy;
mod estimate;
mod flight;
mod isovalues;
mod lighting;
mod map;
mod packing;
mod space;
mod transfer;
mod tree;

#[cfg(test)]
mod tests;

pub use caustics::SpecularPhotons;
pub use energy::PhotonEnergy;
pub use estimate::{Density, Irradiance, PhotonSearch};
pub use isovalues::{IsovalueChoice, Isovalues};
pub use lighting::{PhotonLight, PhotonLightSettings, photon_direct};
pub use map::{Kept, PhotonMap, PhotonScene, PhotonSettings};
pub use transfer::{PhotonBake, photon_bake, photon_bake_from, photon_bake_map};
pub(super) use tree::{Nearest, Node, Tree};
