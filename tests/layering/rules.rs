//! The rules, as tables.

/// A module, in the order in which data flows; it may use the modules above it.
pub struct Layer {
    pub module: &'static str,
    /// Of the modules above, those it must not use all the same.
    pub knows_nothing_of: &'static [&'static str],
}

const fn layer(module: &'static str, knows_nothing_of: &'static [&'static str]) -> Layer {
    Layer { module, knows_nothing_of }
}

/// The table of modules.
pub const LAYERS: &[Layer] = &[
    layer("error", &[]),
    layer("finding", &["error"]),
    layer("quantity", &["error", "finding"]),
    layer("file", &["finding"]),
    layer("memory", &["finding", "file"]),
    layer("staging", &["error", "finding", "file", "memory"]),
    layer("grid3", &["error", "finding", "file", "memory", "staging"]),
    layer("geom", &["error", "finding", "file", "memory", "staging", "grid3"]),
    layer("srgb", &["error", "finding", "file", "memory", "staging", "grid3", "geom"]),
    layer("sampling", &[]),
    layer("sh", &[]),
    layer("probe", &[]),
    // Not files, not random numbers.
    layer("model", &["finding", "file", "staging", "sampling", "sh", "probe"]),
    layer("volume", &["sh", "probe"]),
    layer("level", &["sh", "sampling", "probe"]),
    // Not light, not SH.
    layer("surface", &["sh", "sampling", "probe"]),
    layer("scene", &[]),
    // Not how the transfer was computed.
    layer("transfer", &["level", "sampling", "probe"]),
    // Not files.
    layer("transport", &["transfer::store", "probe"]),
    // Not light.
    layer("bake", &["probe"]),
    // Not rays, not solvers.
    layer("relight", &["level", "transport"]),
    layer("render", &["transport"]),
    // It takes meshes, images and attributes.
    layer(
        "export",
        &[
            "sampling",
            "sh",
            "volume",
            "level",
            "scene::plan",
            "transfer",
            "transport",
            "probe",
            "surface",
            "relight",
            "render",
        ],
    ),
    // Not how a store came about.
    layer("session", &["bake"]),
    layer("cache", &["level", "relight", "render"]),
    layer("lit", &[]),
    layer("demo", &["lit"]),
    layer("compare", &["cache", "lit", "demo"]),
    layer("study", &["cache", "lit", "demo"]),
    layer("inspect", &["cache", "lit", "demo", "compare", "study"]),
    layer("view", &["transport", "cache", "lit", "demo"]),
    layer("signals", &[]),
    layer("cli", &[]),
    // A second caller of the same calls; of the program it asks for the folder of the cache.
    layer("python", &[]),
];

/// Token sequences that must not appear outside the files that start with one of `allowed`.
pub struct Rule {
    pub patterns: &'static [&'static str],
    pub allowed: &'static [&'static str],
    pub why: &'static str,
}

const PROGRAM: &[&str] = &["src/cli/", "src/signals/", "src/main.rs"];

/// What library code must not do.
pub const FORBIDDEN: &[Rule] = &[
    Rule {
        patterns: &[".unwrap(", ".expect(", "panic!", "todo!", "unimplemented!"],
        allowed: &[],
        why: "bad input is an Err that says what was found, expected, and to be done; state a bug with assert!",
    },
    Rule {
        patterns: &["println!", "eprintln!", "print!", "eprint!", "dbg!"],
        allowed: PROGRAM,
        why: "the library never prints",
    },
    Rule { patterns: &["process::exit", "process::abort"], allowed: PROGRAM, why: "the library never exits" },
    Rule {
        patterns: &["Instant::now", "SystemTime"],
        // How long the server of the page waits for the other side, and how long a call of Python takes.
        // When a store of the cache was last used, and how long another process may take that fills it.
        allowed: &["src/cli/", "src/main.rs", "src/cache/", "src/view/server/", "src/python/watch.rs"],
        why: "the library never reads the clock",
    },
    Rule {
        patterns: &["unsafe"],
        // The one map of a file into memory, the answer to a mapped file that shrinks, and arrays of NumPy that are not copied.
        allowed: &["src/file.rs", "src/signals/fault.rs", "src/python/array.rs"],
        why: "unsafe code is denied but for the memory map, the signal that comes of it, and arrays of NumPy",
    },
    Rule {
        patterns: &["thread::spawn", "thread::scope", "AtomicF32", "AtomicF64"],
        // Beside a bake that Python waits for, its thread listens to Ctrl-C.
        allowed: &["src/cli/", "src/signals/", "src/main.rs", "src/python/watch.rs"],
        why: "parallel loops go through rayon, write their own slots and sum in a fixed order",
    },
    Rule {
        patterns: &[
            ".sin(",
            ".cos(",
            ".tan(",
            ".sin_cos(",
            ".asin(",
            ".acos(",
            ".atan(",
            ".atan2(",
            ".sinh(",
            ".cosh(",
            ".tanh(",
            ".exp(",
            ".exp2(",
            ".exp_m1(",
            ".ln(",
            ".ln_1p(",
            ".log2(",
            ".log10(",
            ".powf(",
            ".cbrt(",
            ".hypot(",
            "from_axis_angle",
            "from_rotation_x",
            "from_rotation_y",
            "from_rotation_z",
            "angle_between",
        ],
        allowed: PROGRAM,
        why: "the platform's mathematics differs from machine to machine; use the crate libm",
    },
    Rule {
        patterns: &[".mul_add("],
        // Contraction, which has forms for the processors that have the instruction.
        allowed: &["src/relight/block.rs"],
        why: "it is made in software, and slowly, where the processor is not asked what it has; use plain a·b + c",
    },
];

/// Where rayon may be named: file (or the beginning of its path) and the loop it runs.
pub const RAYON_FILES: &[(&str, &str)] = &[
    ("src/model/sample.rs", "slabs of bricks"),
    ("src/transport/", "texels in bricks"),
    ("src/bake/checks.rs", "check points"),
    ("src/volume/samples.rs", "range and finiteness of the samples"),
    ("src/volume/array.rs", "magnitudes of an array's samples"),
    ("src/level/pyramid.rs", "slabs of blocks"),
    ("src/transfer/store/volume.rs", "slabs of chunks"),
    ("src/transfer/store/verify.rs", "chunks to verify"),
    ("src/transfer/store/pack.rs", "chunks to pack"),
    ("src/transfer/isosurface.rs", "slabs of cells"),
    ("src/probe/project.rs", "rows of an environment, summed in order"),
    ("src/probe/read/layout.rs", "rows of a converted environment"),
    ("src/surface/", "slabs of cells"),
    ("src/relight/", "bricks to contract, vertices to look up"),
    ("src/render/", "rows of a picture"),
    ("src/export/mod.rs", "records of a stream"),
    ("src/export/simplify.rs", "vertices to measure"),
    ("src/export/lightmap/", "charts to colour"),
    ("src/session/", "vertices to place, and figures of them"),
    ("src/cli/", "the pool of threads"),
    ("src/python/", "the pool of threads"),
];

/// Where the file system may be named, and why. Readers take `impl Read`.
pub const FILE_SYSTEM_FILES: &[(&str, &str)] = &[
    ("src/cli/", "opens what the user names"),
    ("src/signals/", "asks the system which signals are ignored"),
    ("src/main.rs", "is the program"),
    ("src/export/atomic.rs", "writes a file whole or not at all"),
    ("src/cache/", "is a folder of stores"),
    ("src/export/inputs.rs", "tells whether two names are one file"),
    ("src/export/target.rs", "makes the folder of what is written"),
    ("src/transfer/store/", "is a folder of files"),
    ("src/file.rs", "opens plain files, for all others"),
    ("src/memory.rs", "reads what the system says of memory"),
    ("src/staging.rs", "makes files beside their place, for all others"),
    ("src/volume/open.rs", "opens a volume and the files its header names"),
    ("src/scene/member.rs", "says which file beside a missing one may be meant"),
    ("src/volume/slices.rs", "lists a folder of slices"),
    ("src/volume/zarr/", "is a folder of files"),
    ("src/volume/dicom/", "lists a folder of a series"),
];

/// Crates that belong to certain modules.
pub const CRATES: &[(&str, &[&str])] = &[
    ("clap", &["cli", "main"]),
    ("indicatif", &["cli", "main"]),
    ("cpu_time", &["cli", "main"]),
    ("ctrlc", &["signals"]),
    ("signal_hook", &["signals"]),
    ("libc", &["signals"]),
    ("clap_complete", &["cli", "main"]),
    ("clap_mangen", &["cli", "main"]),
    ("getrandom", &["view", "cli", "main"]),
    ("directories", &["cli", "main"]),
    ("exr", &["probe"]),
    ("meshopt", &["export"]),
    ("nifti", &["volume"]),
    ("mrc", &["volume"]),
    ("npyz", &["volume"]),
    ("tiff", &["volume"]),
    ("ruzstd", &["volume"]),
    ("memmap2", &["file", "transfer", "volume"]),
    ("sobol_burley", &["sampling"]),
    ("base64", &["view"]),
    ("pyo3", &["python"]),
    ("numpy", &["python"]),
    ("self_cell", &["python"]),
];
