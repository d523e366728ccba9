//! The program from outside: tests start `isolume` and look at its exit code, its output and its files. They share one
//! process: each works in a folder of its own, and gives environment and limits to its children alone.

#[path = "../common/mod.rs"]
mod common;

mod assets;
mod cli;
mod compare;
mod doctor;
mod hard_cli;
mod hard_files;
mod isovalues;
mod lazy;
mod model;
mod pack;
mod planned;
mod resume;
mod scene;
mod scene_volumes;
mod service;
mod view;
