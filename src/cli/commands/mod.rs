//! The commands: what each asks of the library, and in which order it prints what comes back.

pub(in crate::cli) mod bake;
pub(in crate::cli) mod cache;
pub(in crate::cli) mod cluster;
pub(in crate::cli) mod compare;
pub(in crate::cli) mod completions;
pub(in crate::cli) mod demo;
pub(in crate::cli) mod doctor;
pub(in crate::cli) mod env;
pub(in crate::cli) mod export;
pub(in crate::cli) mod info;
pub(in crate::cli) mod man;
pub(in crate::cli) mod merge;
pub(in crate::cli) mod pack;
pub(in crate::cli) mod placements;
pub(in crate::cli) mod polygonizers;
pub(in crate::cli) mod plan;
pub(in crate::cli) mod relight;
pub(in crate::cli) mod replay;
pub(in crate::cli) mod study;
pub(in crate::cli) mod thesis;
pub(in crate::cli) mod verify;
pub(in crate::cli) mod view;
pub(in crate::cli) mod watch;
