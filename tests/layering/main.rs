//! Who may use whom, and what library code must not do: the table of the design, enforced.
//!
//! Works on tokens of the source without comments, literals and test code (`source`), not on a
//! compiled crate, so it also sees code that is compiled away. What the rules are stands in
//! `rules`; to change one, change it there, with the reason beside it.

mod rules;
mod source;

use rules::{CRATES, FORBIDDEN, LAYERS, RAYON_FILES, Rule};
use source::{File, Token};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Every source file of the library and the binary, test files left out.
fn load() -> Vec<File> {
    // Read at run time, so that the compiled test can be pointed at another checkout.
    let root = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    let mut paths = Vec::new();
    collect(&root.join("src"), &mut paths);
    paths.sort();
    let files: Vec<File> = paths
        .iter()
        .map(|path| {
            let name = path.strip_prefix(&root).unwrap().to_str().unwrap().replace('\\', "/");
            File::parse(&name, &std::fs::read_to_string(path).unwrap())
        })
        .collect();
    let tests: BTreeSet<String> = files.iter().flat_map(|f| f.test_files.clone()).collect();
    files.into_iter().filter(|f| !tests.iter().any(|t| f.is_part_of(t))).collect()
}

fn collect(folder: &Path, paths: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, paths);
        } else if path.extension().is_some_and(|e| e == "rs") {
            paths.push(path);
        }
    }
}

/// Position of a module in the order of data flow.
fn position(module: &str) -> Option<usize> {
    LAYERS.iter().position(|layer| layer.module == module)
}

/// Uses of modules that come later, or that the module must know nothing of.
fn layer_violations(file: &File) -> Vec<String> {
    let mut found = Vec::new();
    let module = file.module();
    if module == "lib" {
        return found; // lists and re-exports all
    }
    for path in file.crate_paths() {
        let Some(first) = path.segments.first() else { continue };
        // `crate::Error` and `crate::Result` are re-exports of `error`.
        let used = if first == "Error" || first == "Result" { "error" } else { first.as_str() };
        if module == "main" {
            if used != "cli" {
                found.push(file.at(path.line, &format!("the binary is thin: it uses isolume::cli only, not {used}")));
            }
            continue;
        }
        let Some(later) = position(used) else {
            if file.names_root(&path) && used.starts_with(char::is_lowercase) && used != "self" {
                found.push(file.at(path.line, &format!("crate::{used} is no module of the table in tests/layering")));
            }
            continue;
        };
        if used == module {
            continue;
        }
        let own = position(module).unwrap_or(0);
        if later > own {
            found.push(file.at(path.line, &format!("{module} comes before {used} in lib.rs and may not use it")));
        }
        for &forbidden in LAYERS[own].knows_nothing_of {
            let prefix: Vec<&str> = forbidden.split("::").collect();
            let matches = prefix.len() <= path.segments.len()
                && prefix
                    .iter()
                    .zip(&path.segments)
                    .all(|(a, b)| *a == if b == "Error" || b == "Result" { "error" } else { b });
            if matches {
                found.push(file.at(path.line, &format!("{module} knows nothing of {forbidden}")));
            }
        }
    }
    found
}

/// Tokens that the rules forbid outside their allow-lists.
fn token_violations(file: &File) -> Vec<String> {
    let mut found = Vec::new();
    for Rule { patterns, allowed, why } in FORBIDDEN {
        if allowed.iter().any(|prefix| file.name.starts_with(prefix)) {
            continue;
        }
        for pattern in *patterns {
            let wanted = source::tokens(pattern);
            for window in file.tokens.windows(wanted.len()) {
                if window.iter().zip(&wanted).all(|(a, b)| a.text == b.text) {
                    found.push(file.at(window[0].line, &format!("`{pattern}`: {why}")));
                }
            }
        }
    }
    for path in file.std_paths() {
        let joined = path.segments.join("::");
        if joined.starts_with("fs") && !rules::FILE_SYSTEM_FILES.iter().any(|f| file.name.starts_with(f.0)) {
            found.push(file.at(path.line, "`std::fs`: code that opens paths is listed in FILE_SYSTEM_FILES"));
        }
    }
    let rayon = |t: &&Token| t.text == "rayon";
    if let Some(token) = file.tokens.iter().find(rayon)
        && !RAYON_FILES.iter().any(|f| file.name.starts_with(f.0))
    {
        found.push(file.at(token.line, "`rayon`: parallel loops are listed in RAYON_FILES"));
    }
    for (name, modules) in CRATES {
        if modules.contains(&file.module()) {
            continue;
        }
        for (index, pair) in file.tokens.windows(2).enumerate() {
            let qualified = index > 0 && file.tokens[index - 1].text == "::";
            if pair[0].text == *name && pair[1].text == "::" && !qualified {
                found.push(file.at(pair[0].line, &format!("the crate {name} is used in {modules:?} only")));
            }
        }
    }
    found
}

/// Uses, in `cli`, of items that the library does not publish. `cli` lives in the crate, so the
/// compiler would let it.
fn private_uses(files: &[File]) -> Vec<String> {
    let library = files.iter().filter(|f| !["cli", "main", "python"].contains(&f.module()));
    let public: BTreeSet<&str> = library.clone().flat_map(|f| f.items(false)).collect();
    let private: BTreeSet<&str> = library.flat_map(|f| f.items(true)).filter(|n| !public.contains(n)).collect();
    let own: BTreeSet<&str> =
        files.iter().filter(|f| f.module() == "cli").flat_map(|f| f.items(true).chain(f.items(false))).collect();
    let mut found = Vec::new();
    for file in files.iter().filter(|f| f.module() == "cli") {
        let mut refuse = |line: usize, name: &str| {
            found.push(file.at(line, &format!("cli uses the public API only, and {name} is pub(crate)")));
        };
        for path in file.crate_paths() {
            let outside = path.segments.first().is_some_and(|first| first != "cli");
            if let Some(name) = path.segments.iter().find(|name| outside && private.contains(name.as_str())) {
                refuse(path.line, name);
            }
        }
        // Paths through a module that was imported.
        for (index, pair) in file.tokens.windows(3).enumerate() {
            let name = pair[2].text.as_str();
            // `super::surface` is a module of cli.
            let inner = index > 0 && file.tokens[index - 1].text == "::";
            if !inner && position(&pair[0].text).is_some() && pair[1].text == "::" && private.contains(name) {
                refuse(pair[2].line, name);
            }
        }
        // Methods; what a method belongs to is not known here, so names of its own and of std are passed over.
        for call in file.tokens.windows(3) {
            let name = call[1].text.as_str();
            if call[0].text == "."
                && call[2].text == "("
                && private.contains(name)
                && !own.contains(name)
                && !COMMON.contains(&name)
            {
                refuse(call[1].line, name);
            }
        }
    }
    found
}

/// Methods of std that code of the library may share a name with.
const COMMON: [&str; 10] = ["entry", "first", "last", "get", "get_mut", "insert", "next", "replace", "take", "write"];

fn refuse(violations: Vec<String>) {
    assert!(violations.is_empty(), "{} violations:\n{}", violations.len(), violations.join("\n"));
}

#[test]
fn modules_use_only_what_the_table_allows() {
    let files = load();
    assert!(files.len() > 10, "{} files: the sources were not found", files.len());
    refuse(files.iter().flat_map(layer_violations).collect());
}

#[test]
fn library_code_keeps_its_habits() {
    refuse(load().iter().flat_map(token_violations).collect());
}

#[test]
fn the_command_line_uses_the_public_interface() {
    refuse(private_uses(&load()));
}

#[test]
fn lib_lists_the_modules_in_the_order_of_the_table() {
    let lib = load().into_iter().find(|f| f.module() == "lib").unwrap();
    let listed: Vec<_> = lib
        .tokens
        .windows(3)
        .filter(|w| w[0].text == "mod" && w[2].text == ";")
        .map(|w| (w[1].text.clone(), w[1].line))
        .collect();
    let mut violations = Vec::new();
    let mut last = None;
    for (module, line) in &listed {
        match position(module) {
            None => violations.push(lib.at(*line, &format!("{module} is no module of the table in tests/layering"))),
            here if here < last => violations.push(lib.at(*line, &format!("{module} is listed too late"))),
            here => last = here,
        }
    }
    assert!(listed.len() > 5, "modules were not found in lib.rs");
    refuse(violations);
}

#[test]
fn allow_lists_name_files_that_could_exist() {
    let names = RAYON_FILES.iter().chain(rules::FILE_SYSTEM_FILES).map(|f| f.0);
    for name in names.chain(FORBIDDEN.iter().flat_map(|r| r.allowed.iter().copied())) {
        let module = name.strip_prefix("src/").unwrap().split(['/', '.']).next().unwrap();
        assert!(module == "main" || position(module).is_some(), "{name}: no such module");
    }
}

/// A file with violations and one with the same words where they are harmless.
#[test]
fn violations_are_seen_and_harmless_words_are_not() {
    let check = |name: &str, text: &str| {
        let file = File::parse(name, text);
        let mut all = layer_violations(&file);
        all.extend(token_violations(&file));
        all
    };
    let bad = [
        ("src/sh/basis.rs", "use crate::volume::Volume;", "sh comes before volume"),
        ("src/sh/basis.rs", "use super::super::probe;", "sh comes before probe"),
        ("src/geom.rs", "use crate::{error::{Result as R}};", "geom knows nothing of error"),
        ("src/level/mod.rs", "fn f() { crate::sampling::hash(1); }", "level knows nothing of sampling"),
        ("src/relight/mod.rs", "use crate::{sh, level::{trace}};", "relight knows nothing of level"),
        (
            "src/transport/path.rs",
            "use crate::transfer::{Lattice, store};",
            "transport knows nothing of transfer::store",
        ),
        ("src/export/ply.rs", "use crate::Nothing;\nuse crate::surface::Mesh;", "src/export/ply.rs:2: "),
        ("src/export/ply.rs", "use crate::mystery::X;", "no module of the table"),
        ("src/main.rs", "fn main() { isolume::sh::basis(); }", "isolume::cli only"),
        ("src/volume/a.rs", "fn f() { x.unwrap(); }", "`.unwrap(`"),
        ("src/volume/a.rs", "fn f() { x\n  .expect (\"a\"); }", "src/volume/a.rs:2: `.expect(`"),
        ("src/volume/a.rs", "fn f() { panic!() }", "`panic!`"),
        ("src/volume/a.rs", "fn f() { println!() }", "`println!`"),
        ("src/volume/a.rs", "use std::{io, fs::File};", "`std::fs`"),
        ("src/volume/a.rs", "fn f() { ::std::process::exit(1) }", "`process::exit`"),
        ("src/scene/a.rs", "let t = Instant::now();", "`Instant::now`"),
        ("src/scene/a.rs", "use rayon::prelude::*;", "`rayon`"),
        ("src/scene/a.rs", "unsafe { x }", "`unsafe`"),
        ("src/scene/a.rs", "let y = x.sin();", "`.sin(`"),
        ("src/scene/a.rs", "use clap::Parser;", "the crate clap"),
        ("src/scene/a.rs", "#[cfg(test)]\nmod tests { fn g() {} }\nfn f() { x.unwrap() }", ":3: `.unwrap(`"),
        ("src/scene/a.rs", "const Q: char = '\"'; fn f() { x.unwrap() } // \"", "`.unwrap(`"),
        ("src/scene/a.rs", "fn f<'a>(x: &'a str) { x.unwrap() }", "`.unwrap(`"),
    ];
    for (name, text, expected) in bad {
        let found = check(name, text);
        assert!(found.len() == 1 && found[0].contains(expected), "{text}: {found:?}");
    }
    let good = [
        ("src/sh/basis.rs", "/// See [`crate::volume`]. `x.unwrap()`\nfn f() {}"),
        ("src/sh/basis.rs", "/* use crate::probe; /* nested */ panic!() */ fn f() {}"),
        ("src/sh/basis.rs", r##"const A: &str = r#"panic!() " x.unwrap()"#; const B: &[u8] = b"rayon \" unsafe";"##),
        (
            "src/sh/basis.rs",
            "use crate::{Error, Result};\nuse crate::geom;\nuse crate::sh::kernel;\nuse super::kernel;",
        ),
        ("src/sh/basis.rs", "#[cfg(test)]\nmod tests { use crate::probe; fn f() { x.unwrap(); if a { panic!() } } }"),
        ("src/sh/basis.rs", "#[cfg(test)]\nuse crate::probe;\n#[test]\nfn t() { x.unwrap(); }"),
        ("src/sh/basis.rs", "fn f() { x.unwrap_or(1); x.expect_err; std::panic::catch_unwind; libm::sin(1.0); }"),
        ("src/cli/run.rs", "use crate::relight; fn f() { println!(); std::process::exit(1) }"),
        ("src/export/atomic.rs", "use std::fs;"),
        ("src/main.rs", "fn main() { isolume::cli::main() }"),
    ];
    for (name, text) in good {
        assert_eq!(check(name, text), Vec::<String>::new(), "{text}");
    }
    let files = [
        File::parse("src/sh/mod.rs", "pub(crate) fn hidden() {}\npub fn shown() {}\npub(crate) use a::{b as c, d};"),
        File::parse("src/cli/mod.rs", "fn f() { sh::shown(); sh::hidden(); sh::c(); sh::d(); sh::b(); x.hidden() }"),
    ];
    assert_eq!(private_uses(&files).len(), 4, "{:?}", private_uses(&files));
    let parent = File::parse("src/sh/mod.rs", "#[cfg(test)]\nmod oracle;\nmod real;");
    assert_eq!(parent.test_files, ["src/sh/oracle"]);
    assert!(File::parse("src/sh/oracle/deep.rs", "").is_part_of("src/sh/oracle"));
    assert!(!File::parse("src/sh/oracles.rs", "").is_part_of("src/sh/oracle"));
}
