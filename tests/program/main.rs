//! The program from outside: every test here starts `isolume` and looks at its exit code, its output and its files. Each
//! works in a folder of its own and gives its children their environment and limits, never this process.

#[path = "../common/mod.rs"]
mod common;

mod cli;
mod compare;
mod doctor;
mod hard_cli;
mod hard_files;
mod isovalues;
mod lazy;
mod planned;
mod resume;
mod scene;
mod scene_volumes;
mod service;
mod view;
