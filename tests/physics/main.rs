//! Light transport, relight and surfaces through the library: closed forms, invariances, convergence and hard cases, by
//! the numbers of `tests/VALIDATION.md`.

#[path = "../common/mod.rs"]
mod common;

mod adaptive;
mod compare_scenes;
mod hard_cases;
mod hard_environments;
mod hard_rays;
mod lamps;
mod light;
mod media;
mod models;
mod open;
mod photons;
mod reflected_suns;
mod relight_transport;
mod scene_gather;
mod scene_volumes;
mod scene_walls;
mod sh_properties;
mod stated_error;
mod transport_bowl;
mod transport_closed_forms;
mod transport_convergence;
mod transport_coverage;
mod transport_invariance;
mod transport_layers;
mod transport_quantised;
