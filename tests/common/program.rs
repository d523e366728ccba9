//! The program from outside, run in a folder that disappears with the test.

use assert_cmd::Command;
use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process;
use tempfile::TempDir;

/// Where the program is.
pub fn isolume() -> PathBuf {
    assert_cmd::cargo::cargo_bin("isolume")
}

/// A folder and the program in it.
pub struct Bench {
    /// Disappears with the bench.
    pub folder: TempDir,
}

impl Bench {
    /// An empty folder.
    pub fn new() -> Self {
        Self { folder: TempDir::new().expect("a temporary folder") }
    }

    /// The path of a name in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Any program, in the folder.
    pub fn here(&self, program: impl AsRef<OsStr>) -> process::Command {
        let mut command = process::Command::new(program);
        // Nothing may land in the home of who runs the tests.
        command.current_dir(self.folder.path()).env("HOME", self.folder.path()).env_remove("XDG_CACHE_HOME");
        command
    }

    /// A command line, cut at spaces, for tests that start the program and go on beside it.
    pub fn process(&self, line: &str) -> process::Command {
        let mut command = self.here(isolume());
        command.args(line.split_whitespace());
        command
    }

    /// A command line, cut at spaces.
    pub fn command(&self, line: &str) -> Command {
        Command::from_std(self.process(line))
    }

    /// Runs a line that must succeed and returns its standard output.
    pub fn run(&self, line: &str) -> String {
        let output = self.command(line).assert().success().get_output().stdout.clone();
        String::from_utf8(output).expect("text")
    }

    /// Runs a line that must succeed with `--json`.
    pub fn json(&self, line: &str) -> Value {
        serde_json::from_str(&self.run(&format!("{line} --json"))).expect("one JSON document")
    }

    /// Runs a line: its exit code, standard output and standard error.
    pub fn outcome(&self, line: &str) -> (i32, String, String) {
        let output = self.command(line).output().expect("the program runs");
        let text = |bytes| joined(&String::from_utf8(bytes).expect("text"));
        (output.status.code().expect("an exit code"), text(output.stdout), text(output.stderr))
    }

    /// Runs a line that must fail with exit code 1, one `error:` line, and nothing new in the folder; returns
    /// what it said.
    pub fn refuses(&self, line: &str) -> String {
        let before = self.names();
        let output = self.command(line).assert().code(1).get_output().clone();
        let text = joined(&String::from_utf8(output.stderr).expect("text"));
        assert_eq!(text.lines().filter(|l| l.starts_with("error: ")).count(), 1, "{line}: {text}");
        assert_eq!(self.names(), before, "{line} left something behind");
        text
    }

    /// Everything in the folder, sorted.
    pub fn names(&self) -> Vec<PathBuf> {
        let mut names = Vec::new();
        collect(self.folder.path(), &mut names);
        names.sort();
        names
    }

    /// Writes a file.
    pub fn write(&self, name: &str, contents: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, contents).expect("a file");
        path
    }

    /// The bytes of a file.
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).expect("a file")
    }
}

/// Lines that were broken to fit are whole again.
pub fn joined(text: &str) -> String {
    text.replace("\n  ", " ")
}

/// Everything below a folder.
pub fn collect(folder: &Path, names: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, names);
        }
        names.push(path);
    }
}

/// `_RADIANCE` of the vertices of a PLY file.
pub fn radiance(bytes: &[u8]) -> Vec<[f32; 3]> {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
    let header = String::from_utf8_lossy(&bytes[..at]).into_owned();
    let count: usize =
        header.lines().find_map(|l| l.strip_prefix("element vertex ")?.trim().parse().ok()).expect("vertices");
    let size = |kind: &str| match kind {
        "float" | "float32" | "int" | "uint" => 4,
        "uchar" | "uint8" => 1,
        "double" => 8,
        other => panic!("{other}"),
    };
    let vertex: Vec<(usize, String)> = header
        .lines()
        .skip_while(|l| !l.starts_with("element vertex"))
        .skip(1)
        .take_while(|l| l.starts_with("property"))
        .map(|l| l.split_whitespace().collect::<Vec<_>>())
        .map(|w| (size(w[1]), w[2].to_string()))
        .collect();
    let stride: usize = vertex.iter().map(|(n, _)| n).sum();
    let first = vertex.iter().position(|(_, name)| name.starts_with("radiance")).expect("the radiance");
    let offset: usize = vertex[..first].iter().map(|(n, _)| n).sum();
    (0..count)
        .map(|i| {
            std::array::from_fn(|c| {
                let from = at + i * stride + offset + 4 * c;
                f32::from_le_bytes(bytes[from..from + 4].try_into().expect("four bytes"))
            })
        })
        .collect()
}
