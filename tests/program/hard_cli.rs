//! Hard volumes and options through the program: what has no surface, what would not fit, what has one cell.

use crate::common::cases::npy;
use crate::common::program::Bench;

impl Bench {
    /// Writes a volume of bytes.
    fn volume(&self, name: &str, dims: [usize; 3], value: impl Fn(usize) -> u8) {
        let count = dims.iter().product();
        self.write(name, npy("|u1", dims, (0..count).map(value)));
    }

    fn succeeds(&self, line: &str) -> String {
        let (code, out, said) = self.outcome(line);
        assert_eq!(code, 0, "{line}: {said}");
        out
    }
}

const RELIGHT: &str = "--env constant --rays 4 --layers 2 --cache cache";

#[test]
fn what_has_no_surface_is_an_error_or_with_allow_empty_an_empty_valid_file() {
    let bench = Bench::new();
    bench.volume("flat.npy", [6, 5, 4], |_| 7);
    bench.volume("ramp.npy", [6, 5, 4], |i| i as u8);
    for isovalue in ["7", "auto", "50%", "3", "1e300"] {
        let said = bench.refuses(&format!("relight flat.npy --isovalue {isovalue} {RELIGHT} -o a.glb"));
        assert!(said.contains("no surface"), "{said}");
    }
    let said = bench.refuses(&format!("relight ramp.npy --isovalue 500 {RELIGHT} -o a.glb"));
    assert!(said.contains("500") && said.contains("0 to 119"), "{said}");
    assert!(bench.refuses("bake flat.npy --isovalues 7 --rays 4 -o a.isolume").contains("no surface"));
    assert!(bench.refuses("bake flat.npy --rays 4 -o a.isolume").contains("no surface"));
    assert!(!bench.path("a.glb").exists() && !bench.path("a.isolume").exists());

    bench.succeeds("bake flat.npy --rays 4 -o empty.isolume --allow-empty");
    bench.succeeds("bake flat.npy --isovalues 7 --rays 4 -o empty.isolume --allow-empty");
    assert!(bench.succeeds("doctor empty.isolume").contains("nothing baked"));
    bench.succeeds(&format!("relight empty.isolume --isovalue 7 {RELIGHT} -o e.glb --allow-empty"));

    for (volume, isovalue) in [("flat", "7"), ("flat", "auto"), ("flat", "3"), ("ramp", "500")] {
        for ending in ["glb", "ply", "png"] {
            let line =
                format!("relight {volume}.npy --isovalue {isovalue} {RELIGHT} --size 16x8 -o e.{ending} --allow-empty");
            bench.succeeds(&line);
        }
        let glb = gltf::Gltf::from_slice(&std::fs::read(bench.path("e.glb")).expect("a file")).expect("a valid file");
        assert_eq!((glb.meshes().count(), glb.nodes().count()), (0, 1), "{volume} {isovalue}");
        let ply = std::fs::read(bench.path("e.ply")).expect("a file");
        let ply = String::from_utf8_lossy(&ply);
        assert!(ply.contains("element vertex 0\n") && ply.contains("element face 0\n"), "{ply}");
        let png = image::open(bench.path("e.png")).expect("a picture").to_rgb8();
        // Below the smallest value everything is solid, and the picture shows the faces of the box.
        let solid = isovalue == "3";
        assert_eq!(png.pixels().any(|p| p != png.get_pixel(0, 0)), solid, "{volume} {isovalue}");
    }
    // What has a surface is not touched by the flag, and a typing error is still one.
    bench.succeeds(&format!("relight ramp.npy --isovalue 50 {RELIGHT} -o r.glb --allow-empty"));
    let glb = gltf::Gltf::from_slice(&std::fs::read(bench.path("r.glb")).expect("a file")).expect("a valid file");
    assert_eq!(glb.meshes().count(), 1);
    assert_eq!(bench.outcome(&format!("relight flat.npy --isovalue x {RELIGHT} -o a.glb --allow-empty")).0, 2);
}

#[test]
fn grids_of_one_cell_are_lit_and_grids_without_cells_refused() {
    let bench = Bench::new();
    bench.volume("cell.npy", [2, 2, 2], |i| 30 * i as u8);
    bench.succeeds(&format!("relight cell.npy --isovalue 100 {RELIGHT} -o c.glb"));
    for (name, dims) in [("a", [1, 6, 5]), ("b", [6, 1, 5]), ("c", [6, 5, 1])] {
        bench.volume(&format!("{name}.npy"), dims, |i| i as u8);
        let said = bench.refuses(&format!("relight {name}.npy --isovalue 10 {RELIGHT} -o x.glb"));
        assert!(said.contains("at least 2 samples along each axis"), "{said}");
        assert!(bench.refuses(&format!("bake {name}.npy --rays 4 -o {name}.isolume")).contains("at least 2 samples"));
        assert!(!bench.path("x.glb").exists());
    }
}

#[test]
fn more_memory_than_allowed_is_refused_with_the_figure_and_what_to_change() {
    let bench = Bench::new();
    bench.volume("v.npy", [9, 9, 9], |i| (i % 251) as u8);
    for texture in ["100000x100000x1000", "2000000x2000000x2000000", "18446744073709551615x2x2"] {
        let said = bench.refuses(&format!("bake v.npy --rays 4 --texture {texture} -o v.isolume"));
        assert!(said.contains("--texture") && said.contains("limit"), "{said}");
    }
    let said = bench.refuses("bake v.npy --rays 4 --memory-limit 1MB -o v.isolume");
    assert!(said.contains("MB") && said.contains("--memory-limit") && said.contains("--texture"), "{said}");
    assert!(!bench.path("v.isolume").exists());
}

#[test]
fn albedo_1_with_emission_says_what_it_left_out() {
    let bench = Bench::new();
    // A closed room: solid outside a ball.
    let far = |i: usize| [i % 13, i / 13 % 13, i / 169].map(|v| (v as f64 - 6.0).powi(2)).iter().sum::<f64>().sqrt();
    bench.volume("room.npy", [13, 13, 13], |i| (20.0 * far(i)) as u8);
    let line = format!("relight room.npy --isovalue 95 {RELIGHT} --albedo 1 --emission 1 -o room.glb");
    let (code, _, said) = bench.outcome(&line);
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("albedo 1 with emission has no end") && said.contains("1.000"), "{said}");
}

/// Whatever looks at a volume before a bake does refuses a slice, and a sweep that has no step.
#[test]
fn commands_that_look_before_they_bake_refuse_by_name_and_leave_nothing() {
    let bench = Bench::new();
    bench.volume("slice.npy", [8, 8, 1], |i| i as u8);
    bench.volume("ok.npy", [9, 9, 9], |i| (i % 251) as u8);
    let before = bench.names();
    for line in [
        "study slice.npy -o out",
        "bake slice.npy --auto 5s -o out",
        "bake slice.npy --replay-texel 0,0,0",
        "plan slice.npy --time 1s",
        "relight slice.npy --isovalue 5 --env constant --cache out -o a.glb",
    ] {
        let said = bench.refuses(line);
        assert!(
            said.contains("8×8×1 samples") && said.contains("at least 2 samples along each axis"),
            "{line}: {said}"
        );
    }
    assert!(bench.refuses("study ok.npy --most-rays 8 -o out").contains("at least 16"));
    assert!(bench.refuses("study ok.npy --isovalue 9999 -o out").contains("0 to 250"));
    assert!(bench.refuses("study ok.npy -o nowhere/out").contains("nowhere"));
    assert_eq!(bench.names(), before);
    let said = bench.refuses("relight ok.npy --isovalue 100 --env constant --transfer --cache kept -o a.ply");
    assert!(said.contains("--transfer") && said.contains(".glb"), "{said}");
}
