//! The program `isolume`: everything is in the library, see [`isolume::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    isolume::cli::main()
}
