//! The isolume program; everything is in [`isolume::cli`].

fn main() {}
