//! Isovalues and volumes as users give them, through the program: the kinds of isovalues, both lobes of a signed field
//! in one picture, the largest part alone, channels, folders, and files that lead astray.

use crate::common::program::Bench;

const N: usize = 24;

/// A function on the box from −1 to 1 as a raw volume with its sidecar.
fn write(bench: &Bench, name: &str, f: impl Fn([f64; 3]) -> f64) {
    let at = |i: usize| 2.0 * i as f64 / (N - 1) as f64 - 1.0;
    let values = (0..N * N * N).map(|i| f([at(i % N), at(i / N % N), at(i / (N * N))]) as f32);
    bench.write(&format!("{name}.raw"), values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>());
    let sidecar = format!("{{\"dims\": [{N}, {N}, {N}], \"type\": \"float32\", \"data\": \"{name}.raw\"}}");
    bench.write(&format!("{name}.json"), sidecar);
}

fn radius([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Two Gaussians of opposite sign, 0.6 to either side along x.
fn lobes(p: [f64; 3]) -> f64 {
    let blob = |centre: f64| (-20.0 * radius([p[0] - centre, p[1], p[2]]).powi(2)).exp();
    blob(0.6) - blob(-0.6)
}

const QUICK: &str = "--rays 16 --layers 2 --no-draft --cache c --env constant -q";

/// Pixels that differ from the background, from left to right: their column and whether red exceeds blue.
fn seen(bench: &Bench, name: &str) -> Vec<(u32, bool)> {
    let image = image::open(bench.path(name)).expect("a picture").to_rgb8();
    let background = *image.get_pixel(0, 0);
    let lit = image.enumerate_pixels().filter(|(.., p)| **p != background);
    lit.map(|(x, _, p)| (x, p[0] > p[2])).collect()
}

#[test]
fn two_isovalues_of_opposite_sign_are_two_lobes_in_one_picture() {
    let bench = Bench::new();
    write(&bench, "l", lobes);
    let view = "--view front --size 80x60 --background white";
    bench.run(&format!("relight l.json --isovalue 0.3,-0.3 {QUICK} {view} -o both.png"));
    let both = seen(&bench, "both.png");
    // The lobe above 0 stands at +x, the right of the front view or of the back, and is warm; the other is cool.
    let mean = |warm: bool| {
        let columns: Vec<f64> = both.iter().filter(|(_, w)| *w == warm).map(|(x, _)| f64::from(*x)).collect();
        assert!(columns.len() > 100, "{warm}: {} pixels", columns.len());
        columns.iter().sum::<f64>() / columns.len() as f64
    };
    assert!((mean(true) - mean(false)).abs() > 15.0, "{} {}", mean(true), mean(false));
    // Of one colour where an albedo is given.
    bench.run(&format!("relight l.json --isovalues 0.3,-0.3 {QUICK} {view} --albedo 0.9,0.3,0.1 -o red.png"));
    assert!(seen(&bench, "red.png").iter().all(|(_, warm)| *warm));
    // The program's own choice; and a mesh of both.
    let auto = bench.command(&format!("relight l.json --isovalue auto {} {view} -o auto.png", QUICK.replace("-q", "")));
    let mut auto = auto;
    let text = String::from_utf8(auto.assert().success().get_output().stderr.clone()).expect("text");
    assert!(text.contains("two lobes") && text.contains("both lobes of a field about 0"), "{text}");
    let found = seen(&bench, "auto.png");
    assert!(found.iter().any(|(_, w)| *w) && found.iter().any(|(_, w)| !*w));
    bench.run(&format!("relight l.json --isovalue 0.3,-0.3 {QUICK} --float-color -o both.ply"));
    bench.run(&format!("relight l.json --isovalue 0.3 {QUICK} -o one.ply"));
    let vertices = |name: &str| {
        let text = String::from_utf8_lossy(&bench.bytes(name)).into_owned();
        let line = text.lines().find_map(|l| l.strip_prefix("element vertex ")).expect("a count").to_string();
        line.trim().parse::<u64>().expect("a number")
    };
    assert_eq!(vertices("both.ply"), 2 * vertices("one.ply"), "the lobes are mirror images");
    // With a name for each isovalue: one file each, as ever.
    bench.run(&format!("relight l.json --isovalue 0.3,-0.3 {QUICK} {view} -o lobe{{isovalue}}.png"));
    assert!(bench.path("lobe0.3.png").exists() && bench.path("lobe-0.3.png").exists());
    // Two of one sign hide each other.
    let text = bench.refuses(&format!("relight l.json --isovalue 0.3,0.4 {QUICK} -o x.png"));
    assert!(text.contains("{isovalue}"), "{text}");
}

#[test]
fn every_command_takes_isovalue_and_isovalues() {
    let bench = Bench::new();
    bench.run("bake sphere:12 --isovalue 50% --rays 4 --layers 1 --bands 2 -q -o a.isolume");
    bench.run("bake sphere:12 --isovalues 50% --rays 4 --layers 1 --bands 2 -q -o b.isolume");
    bench.run("plan sphere:12 --isovalue 50% -q");
    for option in ["--isovalue", "--isovalues"] {
        bench.run(&format!("relight a.isolume {option} 50% --env constant -q -o s.ply"));
        bench.run(&format!("doctor sphere:12 {option} 50%"));
        bench.run(&format!("compare a.isolume {option} 50% --env constant --points 4 --paths 16 -q"));
    }
    for command in ["bake", "plan", "relight", "compare", "doctor", "view", "study"] {
        let help = bench.run(&format!("{command} --help"));
        assert!(help.contains("--isovalue"), "{command}");
    }
}

#[test]
fn levels_have_units_and_their_reason_is_told() {
    let bench = Bench::new();
    write(&bench, "ball", |p| 100.0 - 80.0 * radius(p));
    for isovalue in ["1.5rms", "1sigma", "1σ", "enclosed:5%", "50HU", "otsu", "auto", "60%"] {
        let line = format!("bake ball.json --isovalues {isovalue} --rays 4 --layers 1 --bands 2 -o x.isolume --force");
        let (code, _, text) = bench.outcome(&line);
        assert!(code == 0, "{isovalue}: {text}");
    }
    let (_, _, text) = bench.outcome("bake ball.json --isovalues 1sigma --rays 4 --layers 1 --bands 2 -o y.isolume");
    assert!(text.contains("1 standard deviations from the mean"), "{text}");
    // The negative: matter is below, and the program finds it.
    write(&bench, "negative", |p| 80.0 * radius(p) - 100.0);
    let info = bench.json("info negative.json");
    assert_eq!(info["suggested_isovalue"]["solid"], "below the isovalue");
    let of_ball = bench.json("info ball.json")["suggested_isovalue"]["value"].as_f64().expect("a number");
    assert_eq!(info["suggested_isovalue"]["value"].as_f64(), Some(-of_ball));
    let bake = bench.json("bake negative.json --isovalues auto --rays 4 --layers 1 --bands 2 -o n.isolume");
    assert_eq!(bake["identity"]["solid"], "below");
    // A scene as long as a book is refused at once.
    let many = (0..1_000_000).map(|i| format!("{i},")).collect::<String>();
    bench.write("many.toml", format!("volume = \"ball.json\"\nisovalues = [{many}]\n"));
    let text = bench.refuses("plan many.toml");
    assert!(text.contains("at most 1000 isovalues") && text.len() < 400, "{text}");
}

#[test]
fn the_largest_part_alone_is_kept_if_asked_for() {
    let bench = Bench::new();
    // A head of radius 0.5 and a thin table below it.
    write(&bench, "head", |p| {
        let head = 100.0 - 100.0 * radius([p[0], p[1], p[2] - 0.2]) / 0.5;
        if (p[2] + 0.75).abs() < 0.06 { 90.0 } else { head }
    });
    let (_, _, text) =
        bench.outcome(&format!("relight head.json --isovalue 20 --keep-largest {} -o k.ply", QUICK.replace("-q", "")));
    assert!(text.contains("1 smaller parts of the solid of 20 were dropped"), "{text}");
    bench.run(&format!("relight head.json --isovalue 20 {QUICK} -o all.ply"));
    assert!(bench.bytes("k.ply").len() < bench.bytes("all.ply").len());
    // The store holds the masked volume.
    bench.run("bake head.json --isovalues 20 --keep-largest --rays 4 --layers 1 --bands 2 -q -o k.isolume");
    bench.run("bake head.json --isovalues 20 --rays 4 --layers 1 --bands 2 -q -o all.isolume");
    let hash = |store: &str| bench.json(&format!("info {store}"))["identity"]["volume"].clone();
    assert_ne!(hash("k.isolume"), hash("all.isolume"));
    let text = bench.refuses("bake head.json --keep-largest --rays 4 -q -o z.isolume");
    assert!(text.contains("--isovalues"), "{text}");
    let text = bench.refuses("relight k.isolume --isovalue 20 --keep-largest --env constant -o z.ply");
    assert!(text.contains("--keep-largest"), "{text}");
}

#[test]
fn cut_faces_are_drawn_or_left_open_as_doctor_says() {
    let bench = Bench::new();
    write(&bench, "slab", |p| p[0]);
    let line = format!("relight slab.json --isovalue 0 {QUICK} --view 90,20 --size 60x60");
    bench.run(&format!("{line} -o flat.png"));
    bench.run(&format!("{line} --cap open -o open.png"));
    let (flat, open) = (seen(&bench, "flat.png").len(), seen(&bench, "open.png").len());
    let doctor = bench.run("doctor slab.json --isovalue 0");
    assert!(doctor.contains("--cap open") && !doctor.contains("no cap is drawn"), "{doctor}");
    assert!(open < flat, "{open} {flat}");
}

#[test]
fn folders_of_slices_are_volumes_and_other_folders_are_named() {
    let bench = Bench::new();
    let slices = bench.path("slices");
    std::fs::create_dir(&slices).expect("a folder");
    for z in 0..12u32 {
        let value = |x: u32, y: u32| 200 - 8 * (x.abs_diff(6) + y.abs_diff(6) + z.abs_diff(6)) as u8;
        let image = image::GrayImage::from_fn(12, 12, |x, y| image::Luma([value(x, y)]));
        image.save(slices.join(format!("s{z}.png"))).expect("a slice");
    }
    let info = bench.json("info slices --spacing 1,1,2um");
    assert_eq!(
        (&info["dims"], &info["spacing"]),
        (&serde_json::json!([12, 12, 12]), &serde_json::json!([1.0, 1.0, 2.0]))
    );
    assert_eq!(info["metres_per_unit"], 1e-6);
    bench.run(&format!("relight slices --isovalue 150 {QUICK} -o s.ply"));
    std::fs::remove_file(slices.join("s7.png")).expect("gone");
    let text = bench.refuses("info slices");
    assert!(text.contains("slices: ") && text.contains("between s6.png and s8.png"), "{text}");
    let other = bench.path("other");
    std::fs::create_dir(&other).expect("a folder");
    std::fs::write(other.join("1.dcm"), "x").expect("a file");
    let text = bench.refuses("info other");
    assert!(text.contains("no DICOM file"), "{text}");
    let zarr = bench.path("image.zarr");
    std::fs::create_dir(&zarr).expect("a folder");
    let root = "{\"zarr_format\": 3, \"node_type\": \"group\", \"attributes\": {\"ome\": {\"multiscales\": []}}}";
    std::fs::write(zarr.join("zarr.json"), root).expect("a file");
    let text = bench.refuses("info image.zarr");
    assert!(text.contains("multiscales without an image"), "{text}");
}

#[test]
fn files_that_headers_name_are_plain_and_below_their_folder() {
    let bench = Bench::new();
    let header =
        |name: &str| format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 4 4\nencoding: raw\ndata file: {name}\n\n");
    bench.write("p.nhdr", header("../../../../../../../../etc/passwd"));
    let text = bench.refuses("bake p.nhdr --rays 16 -q -o pw.isolume");
    assert!(text.contains("etc/passwd") && text.contains("--allow-outside"), "{text}");
    bench.write("p.nhdr", header("/dev/zero"));
    assert!(bench.refuses("info p.nhdr").contains("/dev/zero"));
    assert!(bench.refuses("info p.nhdr --allow-outside").contains("a device"));
    bench.write("sidecar.json", "{\"dims\": [2, 2, 2], \"type\": \"uint8\", \"data\": \"/etc/passwd\"}");
    assert!(bench.refuses("info sidecar.json").contains("--allow-outside"));
    if cfg!(unix) {
        // Without a writer: opening it would wait for ever.
        let made = std::process::Command::new("mkfifo").arg(bench.path("pipe")).status().expect("mkfifo");
        assert!(made.success());
        bench.write("p.nhdr", header("pipe"));
        assert!(bench.refuses("info p.nhdr").contains("a named pipe"));
        assert!(bench.refuses("info pipe").contains("/dev/stdin"));
        assert!(bench.refuses("relight sphere:8 --isovalue 50% --env pipe -o x.ply").contains("a named pipe"));
    }
    // What is piped in is read.
    let mut command = bench.command("info /dev/stdin");
    let nrrd = [header("x").replace("data file: x\n", "").as_bytes(), &[7; 127], &[9]].concat();
    command.write_stdin(nrrd).assert().success();
}
