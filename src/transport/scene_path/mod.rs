//! Path tracing of a level set among walls and luminaires: an estimator of its own, which a scene with geometry asks for.
//! A volume alone never comes here.
//!
//! Transfer has three channels, because walls have colours, and each luminaire fills a texture of its own, so that its
//! power may change at relight time: `estimate` says what is added where, `world` what a ray meets.
//! Light of luminaires that have an area is found through mirrors and glass by the paths
//! themselves, if noisily, and points and parallel light by their images in flat mirrors (`images`). Through glass and in
//! curved mirrors these cannot be found so; photons bring it ([`SpecularLight`]). See [`needs_photons`].

mod airlight;
mod among;
mod body;
mod estimate;
pub(super) mod glass;
mod images;
mod level_set;
mod media;
mod reference;
mod scatter;
mod sites;
pub(super) mod specular_chain;
mod world;

pub use airlight::{Airlight, airlight};
pub(super) use among::Among;
pub use among::{Arrival, SpecularLight};
pub use estimate::MOST_TURNS;
pub use reference::{SceneReference, scene_radiance};
pub(super) use reference::{Tracer, refuse_body};
pub use sites::{LevelSite, site_radiance};
pub use specular_chain::MOST as MOST_SPECULAR;
pub use world::SceneCounts;
pub(super) use world::{Isovalues, Met, Origin, Place, World};

use crate::scene::geometry::Geometry;

/// Luminaires whose light cannot be found through the mirrors and glass of a scene but by photons:
/// points and parallel light beside glass, curved mirrors, or more than six flat ones. Empty where all is found.
pub fn needs_photons(geometry: &Geometry) -> Vec<String> {
    let found =
        !geometry.has_specular() || geometry.flat_mirrors().is_some_and(|all| all.len() <= images::MOST_MIRRORS);
    let named = |l: usize| geometry.luminaires()[l].name.clone();
    if found { Vec::new() } else { images::of_no_area(geometry).into_iter().map(named).collect() }
}
