//! What is printed: text, tables, progress; and what the console lends to a bake.

pub(in crate::cli) mod baked;
pub(in crate::cli) mod comparison;
pub(in crate::cli) mod console;
pub(in crate::cli) mod forecast;
pub(in crate::cli) mod lent;
pub(in crate::cli) mod effects;
pub(in crate::cli) mod relit;
pub(in crate::cli) mod study;
pub(in crate::cli) mod text;
