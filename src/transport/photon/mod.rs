//! Flattened photon mapping (Beason 2005): photons that carry an isovalue for life, kept in four dimensions.
//!
//! # Emission
//! A photon comes from the direction ω of the environment, drawn from the light's own density p(ω), starts uniformly on
//! the disk of the box's bounding sphere (radius R) across ω, and takes an isovalue c from a density p(c). It
//! carries the flux-height F = L(ω) π R² / (p(ω) p(c) n): power times isovalue, so that in every stretch dc of
//! isovalues the photons of that stretch make up the light on those level sets. It sees the level set of c alone, and is
//! reflected diffusely; Russian roulette by the albedo ends it. Photons that enter the box inside their solid
//! are discarded, as rays of the bake can never leave that way either. Every hit is kept.
//!
//! # Density
//! A photon lies on its level set, so its four coordinates (x, κc) are a point of the graph of the field, a
//! three-dimensional surface. The k nearest of a query lie within r of it; where the field is linear over that
//! distance with a gradient of length g, their positions fill an ellipsoid, r across and r/√(1+κ²g²) along the
//! normal, of volume V = 4/3 π r³/√(1+κ²g²). A volume dV holds the level sets of an area dA over a stretch
//! dc = g dn, so that E = ΣF/(g V) = ΣF κ_eff/(4/3 π r³) with κ_eff = √(κ² + 1/g²).
//!
//! We differ from Beason 2005, eq. 4.9 (unclipped; eq. 4.10 is the clipped one), which takes κ for κ_eff: that reads E κg/√(1+κ²g²), 71 % of the truth at
//! κg = 1 and 10 % at 0.1 ([`Density::Published`] keeps it for study). We cut what the ellipsoid has outside the box
//! and outside the isovalues that were drawn, and leave out the k-th photon, whose distance is the radius: with it
//! the mean of ΣF/V would be k/(k−1) too large.
//!
//! κ = γ · extent(box) / extent(isovalues), the diagonal of the box over the range of the samples. So all lengths here
//! are in diagonals and all isovalues in ranges, and nothing depends on the scale of either.
//!
//! # Errors
//! The stated standard error is the noise of the photons alone. The bias of a search that reaches over edges, and over
//! surfaces that bend within r, is not in it: it falls as the number of photons rises, as r² ~ n^(−2/3).

mod energy;
mod estimate;
mod isovalues;
mod lighting;
mod map;
mod packing;
mod space;
mod transfer;
mod tree;

#[cfg(test)]
mod tests;

pub use energy::PhotonEnergy;
pub use estimate::{Density, Irradiance, PhotonSearch};
pub use isovalues::{IsovalueChoice, Isovalues};
pub use lighting::{PhotonLight, PhotonLightSettings, photon_direct};
pub use map::{PhotonMap, PhotonSettings};
pub use transfer::{PhotonBake, photon_bake, photon_bake_from, photon_bake_map};
pub(super) use tree::{Nearest, Node, Tree};
