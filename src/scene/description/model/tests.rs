use super::*;
use crate::geom::Affine;
use crate::volume::Samples;
use glam::DVec3;

/// A file that is not there, and a tetrahedron or a water molecule for all names that are.
struct Made;

impl Files for Made {
    fn mesh(&mut self, name: &str) -> Result<TriangleMesh> {
        let positions = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(DVec3::from).to_vec();
        let mut triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        if name == "open.stl" {
            triangles.pop();
        }
        Ok(TriangleMesh { positions, triangles })
    }

    /// x + 2 y + 4 z + 10 on a box from 0 to (1, 2, 2), perhaps one of two channels, or of five points in time.
    fn volume(&mut self, name: &str, choice: Choice) -> Result<Volume> {
        let mut notes = Vec::new();
        match name {
            "two.tif" => drop(choice.of("TIFF", vec!["dapi".into(), "gfp".into()], 1, &mut notes)?),
            "moving.nii" => drop(choice.of("NIfTI", Vec::new(), 5, &mut notes)?),
            _ => {}
        }
        if name == "slice.nii" {
            return Volume::new([3, 3, 1], Samples::U8(vec![0, 1, 2, 3, 4, 5, 6, 7, 8]), Affine::IDENTITY);
        }
        let at = |[x, y, z]: [usize; 3]| (x + 2 * y + 4 * z + 10) as u8;
        let samples = Samples::U8(crate::grid3::all([2, 3, 3]).map(at).collect());
        let mut volume = Volume::new([2, 3, 3], samples, Affine::from_spacing(DVec3::ONE, DVec3::ZERO).unwrap())?;
        volume.notes = notes;
        Ok(volume)
    }

    fn bytes(&mut self, name: &str) -> Result<Vec<u8>> {
        Ok(match name {
            "odd.xyz" => b"1\n\nXx 0 0 0\n".to_vec(),
            "short.xyz" => b"3\n\nO 0 0 0\n".to_vec(),
            "w.pdb" => {
                b"HETATM    1  O   HOH A   1       0.000   0.100   0.200  1.00  0.00           O\nEND\n".to_vec()
            }
            _ => b"3\nwater\nO 0 0 0.1173\nH 0 0.7572 -0.4692\nH 0 -0.7572 -0.4692\n".to_vec(),
        })
    }
}

const HEAD: &str = "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\n";

fn read(body: &str) -> Result<ModelDescription> {
    ModelDescription::read(&format!("{HEAD}{body}"), "m.toml", None, &mut Made)
}

#[track_caller]
fn value(body: &str, at: [f64; 3]) -> f64 {
    match read(body) {
        Ok(model) => model.tree.value(DVec3::from(at)),
        Err(e) => panic!("{e}"),
    }
}

#[track_caller]
fn refused(body: &str, expected: &[&str]) {
    let text = read(body).map(|_| ()).expect_err(body).to_string();
    assert!(text.starts_with("m.toml:"), "{text}");
    for part in expected {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
}

#[test]
fn the_model_of_the_documentation_is_read() {
    let body = r#"
isovalue = 0.5
root = "all"
[model.point.a]
centre = [-0.5, 0, 0]
radius = 1.0
falloff = "soft"
[model.segment.b]
from = [0, 0, 0]
to = [1, 0, 0]
radius = [0.6, 0.4]
[model.blend.ab]
of = ["a", "b"]
ricci = 2
[model.twist.t]
of = "ab"
axis = "z"
per_unit = 0.8
[model.difference.all]
of = ["t", "hole"]
[model.formula.hole]
f = "0.5 - 4*(x^2 + y^2 - r^2)"
parameters = { r = 0.1 }
"#;
    let model = read(body).unwrap();
    assert_eq!((model.isovalue, model.dims), (0.5, [DEFAULT_SAMPLES; 3]));
    // The hole is ½ at r = 0.1; at the axis 0.54, so the difference is 1 − 0.54.
    near(model.tree.value(DVec3::ZERO), 0.46);
    assert!(model.notes.iter().any(|n| n.contains("0.5 alone")), "{:?}", model.notes);
}

#[test]
fn every_kind_has_the_value_it_says() {
    let soft = "centre = [0, 0, 0]\nradius = 1\n";
    let a = format!("[model.point.a]\n{soft}");
    let half = |body: &str, at: [f64; 3]| near(value(body, at), 0.5);
    half("[model.point.a]\ncentre = [0, 0, 0]\nsurface_radius = 0.3", [0.3, 0.0, 0.0]);
    half("[model.point.a]\ncentre = [0, 0, 0]\nsurface_radius = 0.3\nfalloff = \"gaussian\"", [0.0, 0.3, 0.0]);
    half("[model.point.a]\ncentre = [0, 0, 0]\nsurface_radius = 0.3\nweight = 2", [0.0, 0.3, 0.0]);
    half("[model.segment.a]\nfrom = [0, 0, 0]\nto = [1, 0, 0]\nsurface_radius = [0.3, 0.2]", [1.0, 0.2, 0.0]);
    half(
        "[model.polyline.a]\npoints = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\nclosed = true\nradius = 0.2",
        [0.4, 0.4, 0.1],
    );
    half("[model.polygon.a]\npoints = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\nradius = 0.2", [0.4, 0.5, 0.1]);
    half("[model.triangle.a]\npoints = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\nradius = 0.2", [0.6, 0.5, -0.1]);
    half("[model.disc.a]\ncentre = [0, 0, 0]\nnormal = [0, 0, 2]\ndisc_radius = 0.5\nradius = 0.2", [0.6, 0.0, 0.0]);
    half("[model.torus.a]\ncentre = [0, 0, 0]\nnormal = [0, 0, 2]\nring_radius = 0.5\nradius = 0.2", [0.4, 0.0, 0.0]);
    half("[model.box.a]\ncentre = [0, 0, 0]\nsize = [1, 1, 1]\nradius = 0.2", [0.6, 0.3, 0.2]);
    half("[model.plane.a]\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\nradius = 0.2", [0.6, 0.3, 0.0]);
    half("[model.mesh.a]\nfile = \"t.stl\"\nfalloff = \"density\"", [0.2, 0.3, 0.0]);
    half("[model.points.a]\nat = [[0, 0, 0], [5, 0, 0]]\nradii = [0.3, 0.2]", [0.0, 0.0, 0.3]);
    half("[model.points.a]\nat = [[0, 0, 0], [5, 0, 0]]\nradius = 0.4", [0.0, 0.0, 0.2]);
    near(value("[model.points.a]\nat = [[0, 0, 0], [1, 0, 0]]\nradius = 1\nricci = 2", [0.5, 0.0, 0.0]), 0.5f64.sqrt());
    half("[model.points.a]\nfile = \"w.pdb\"\nradii = \"vdw\"", [0.0, 0.1, 1.72]);
    near(value("[model.mesh.a]\nfile = \"t.stl\"\ntranslate = [0, 0, 1]", [0.2, 0.2, 0.9]), -0.1);
    near(value("[model.mesh.a]\nfile = \"t.stl\"", [0.2, 0.2, 0.1]), 0.1);
    near(value("[model.formula.a]\nf = \"x + 2*y\"", [0.5, 0.25, 0.0]), 1.0);
    near(
        value("[model.convolution.a]\npoints = [[-9, 0, 0], [0, 0, 0], [9, 0, 0]]\nradius = 0.5", [0.1, 0.0, 0.0]),
        1.0,
    );
    let arc = "[model.convolution.a]\narc = { centre = [0,0,0], normal = [0,0,1], from = [30,0,0], angle = 360 }\nradius = 0.5";
    assert!((value(arc, [0.0, 30.0, 0.0]) - 1.0).abs() < 1e-3);
    let rbf = "[model.rbf.a]\npoints = [[1,0,0],[-1,0,0],[0,1,0],[0,-1,0],[0,0,1],[0,0,-1]]\nnormals = [[1,0,0],[-1,0,0],[0,1,0],[0,-1,0],[0,0,1],[0,0,-1]]";
    half(rbf, [0.0, 1.0, 0.0]);
    assert!(value(rbf, [0.0; 3]) > 0.5);
    // Operators.
    let two = format!("{a}[model.point.b]\ncentre = [0.5, 0, 0]\nradius = 1\n");
    let x = [0.5, 0.0, 0.0];
    near(value(&format!("{two}[model.sum.s]\nof = [\"a\", \"b\"]"), x), 1.5);
    near(value(&format!("{two}[model.union.s]\nof = [\"a\", \"b\"]"), x), 1.0);
    near(value(&format!("{two}[model.intersection.s]\nof = [\"a\", \"b\"]"), x), 0.5);
    near(value(&format!("{two}[model.difference.s]\nof = [\"a\", \"b\"]"), x), 0.0);
    near(value(&format!("{two}[model.union.s]\nof = [\"a\", \"b\"]\nsmooth = true"), x), 1.0);
    near(value(&format!("{two}[model.pasko.s]\nof = [\"a\", \"b\"]\noperation = \"sum\""), x), 1.0);
    near(value(&format!("{a}[model.affine.s]\nof = \"a\"\nscale = 2\ntranslate = [1, 0, 0]"), [2.0, 0.0, 0.0]), 0.5);
    near(
        value(&format!("{a}[model.affine.s]\nof = \"a\"\nscale = [1, 2, 1]\nrotate = [0, 0, 1, 90]"), [1.0, 0.0, 0.0]),
        0.5,
    );
    near(value(&format!("{a}[model.instance.s]\nof = \"a\"\nat = [[3, 0, 0], [0, 3, 0]]"), [0.0, 3.5, 0.0]), 0.5);
    near(value(&format!("{a}[model.repeat.s]\nof = \"a\"\ncount = 4\ntranslate = [1, 0, 0]\nblend = \"sum\""), x), 1.0);
    near(value(&format!("{a}[model.offset.s]\nof = \"a\"\nby = -0.25"), x), 0.25);
    near(value(&format!("{a}[model.shell.s]\nof = \"a\"\nthickness = 0.2"), x), 0.6);
    near(value(&format!("{a}[model.weight.s]\nof = \"a\"\nby = 3"), x), 1.5);
    near(value(&format!("{a}[model.invert.s]\nof = \"a\""), [0.0; 3]), 0.0);
    near(value(&format!("{a}[model.taper.s]\nof = \"a\"\nfrom = 0\nto = 1\nscale = 0.5"), [0.25, 1.0, 0.0]), 0.0);
    // What lies at x = π/2 on the axis is bent to (1, 1).
    let far = "[model.point.a]\ncentre = [1.5707963267948966, 0, 0]\nradius = 0.2\n[model.bend.s]\nof = \"a\"\nper_unit = 1\nfrom = -1.6\nto = 1.6";
    near(value(far, [1.0, 1.0, 0.0]), 1.0);
    let cached = format!("{a}[model.cache.s]\nof = \"a\"\nsamples = 64");
    assert!((value(&cached, x) - 0.5).abs() < 1e-3);
    assert!(read(&cached).unwrap().notes.iter().any(|n| n.contains("RMS")));
    let contact = format!("{two}[model.contact.s]\nof = [\"a\", \"b\"]\nwidth = 0.2\nshow = \"first\"");
    near(value(&contact, [0.25, 0.0, 0.0]), 0.5);
}

#[test]
fn axes_of_twists_keep_their_sense() {
    // About x, from y to z; about y, from z to x; about z, from x to y: by one radian at height 1.
    for (axis, at) in [("z", [0, 2]), ("x", [1, 0]), ("y", [2, 1])] {
        let mut centre = [0.0; 3];
        centre[at[0]] = 1.0;
        centre[at[1]] = 1.0;
        let mut seen = [0.0; 3];
        seen[at[1]] = 1.0;
        seen[at[0]] = libm::cos(1.0);
        seen[(at[0] + 1) % 3] = libm::sin(1.0);
        let body = format!(
            "[model.point.a]\ncentre = {centre:?}\nradius = 0.3\n[model.twist.t]\nof = \"a\"\naxis = \"{axis}\"\nper_unit = 1"
        );
        near(value(&body, seen), 1.0);
    }
}

#[test]
fn what_makes_no_sense_is_refused_with_its_line() {
    let a = "[model.point.a]\ncentre = [0, 0, 0]\nradius = 1\n";
    let with = |rest: &str| format!("{a}{rest}");
    refused("", &["m.toml:1", "at least one node"]);
    refused("[model.pont.a]\ncentre = [0, 0, 0]", &["m.toml:3", "model.pont", "did you mean point?"]);
    refused("[model.point.a]\ncentre = [0, 0, 0]\nradius = 1\ncolour = 3", &["m.toml:6", "model.point.a.colour"]);
    refused("[model.point.a]\nradius = 1", &["m.toml:3", "the key `centre`"]);
    refused("[model.point.a]\ncentre = [0, nan, 0]\nradius = 1", &["m.toml:4", "a number"]);
    refused("[model.point.a]\ncentre = [0, 0, 0]\nradius = -1", &["m.toml:5", "positive"]);
    refused("[model.point.a]\ncentre = [0, 0, 0]", &["m.toml:3", "surface_radius"]);
    refused("[model.point.a]\ncentre = [0, 0, 0]\nradius = 1\nsurface_radius = 1", &["m.toml:6", "take one out"]);
    refused("[model.point.a]\ncentre = [0, 0, 0]\nsurface_radius = 1\nweight = 0.4", &["m.toml:5", "never is 0.5"]);
    refused(&with("[model.blend.b]\nof = [\"a\", \"aa\"]"), &["m.toml:7", "did you mean a?"]);
    refused(&with("[model.blend.b]\nof = [\"a\", \"c\"]\n[model.blend.c]\nof = [\"b\"]"), &["one node at the top"]);
    let cycle =
        with("[model.blend.b]\nof = [\"a\", \"c\"]\n[model.blend.c]\nof = [\"b\"]\n[model.blend.d]\nof = \"c\"");
    refused(&cycle, &["m.toml:", "lead back", "c → b → c"]);
    refused(&with("[model.point.b]\ncentre = [0, 0, 0]\nradius = 1"), &["m.toml:1", "a, b", "root ="]);
    let unused = format!("root = \"a\"\n{a}[model.point.b]\ncentre = [0, 0, 0]\nradius = 1");
    refused(&unused, &["m.toml:7", "nothing uses `b`"]);
    refused(&format!("root = \"q\"\n{a}"), &["m.toml:3", "name of a node"]);
    refused(&with("[model.segment.a]\nfrom = [0,0,0]\nto = [1,0,0]\nradius = 1"), &["names that differ"]);
    refused("[model.segment.a]\nfrom = [0,0,0]\nto = [0,0,0]\nradius = 1", &["m.toml:3", "points that differ"]);
    refused("[model.polygon.a]\npoints = [[0,0,0],[1,0,0],[2,0,0]]\nradius = 1", &["span an area"]);
    refused("[model.polygon.a]\npoints = [[0,0,0],[1,0,0],[1,1,0],[0,1,1]]\nradius = 1", &["one plane"]);
    refused("[model.formula.a]\nf = \"x + sni(y)\"", &["m.toml:4", "`sni`"]);
    refused("[model.formula.a]\nf = \"x +\"", &["m.toml:4", "the end of the formula"]);
    refused("[model.mesh.a]\nfile = \"open.stl\"", &["m.toml:4", "3 edges of one triangle", "winding"]);
    refused("[model.points.a]\nfile = \"odd.xyz\"\nradii = \"vdw\"", &["`Xx`", "radii = 1.7"]);
    let short = read("[model.points.a]\nfile = \"short.xyz\"\nradii = \"vdw\"").map(|_| ()).unwrap_err().to_string();
    assert!(short.contains("short.xyz") && short.contains("1 atoms"), "{short}");
    let both = with(
        "[model.point.b]\ncentre = [0.5, 0, 0]\nradius = 1\n[model.contact.c]\nof = [\"a\", \"b\"]\nwidth = 0.2\nshow = \"both\"",
    );
    refused(&both, &["m.toml:12", "gap = 0.02"]);
    refused(
        &with("[model.bend.b]\nof = \"a\"\nper_unit = 1.5\nfrom = -1\nto = 1"),
        &["m.toml:8", "axis of the bend", "bend less"],
    );
    refused(&with("[model.bend.b]\nof = \"a\"\nper_unit = 4\nfrom = -1\nto = 1"), &["m.toml:8", "less than a turn"]);
    refused(&with("[model.affine.b]\nof = \"a\"\nscale = 0"), &["m.toml:6", "inverse"]);
    refused(&with("[model.union.b]\nof = [\"a\"]"), &["m.toml:7", "at least 2"]);
    let smooth = "isovalue = 0\n[model.point.a]\ncentre = [0,0,0]\nradius = 1\nfalloff = \"distance\"\n[model.point.b]\ncentre = [1,0,0]\nradius = 1\nfalloff = \"distance\"\n[model.union.c]\nof = [\"a\", \"b\"]\nsmooth = true";
    refused(smooth, &["m.toml:14", "positive isovalue"]);
    let text = ModelDescription::read("volume = \"a\"", "m.toml", None, &mut Made).map(|_| ()).unwrap_err().to_string();
    assert!(text.contains("no section [model]"), "{text}");
    let flat = ModelDescription::read("[model]\nbounds = [[0,0,0],[1,1,0]]\n", "m.toml", None, &mut Made).map(|_| ());
    assert!(flat.unwrap_err().to_string().contains("m.toml:2"));
}

/// 2⁴⁰ nodes by 40 lines, and 10⁵ by as many: refused before they are made.
#[test]
fn models_without_end_are_refused() {
    let mut body = "[model.point.n0]\ncentre = [0, 0, 0]\nradius = 1\n".to_string();
    for i in 1..=40 {
        body += &format!("[model.sum.n{i}]\nof = [\"n{}\", \"n{}\"]\n", i - 1, i - 1);
    }
    refused(&body, &["at most 100000 nodes", "`cache`"]);
    let mut chain = "[model.point.n0]\ncentre = [0, 0, 0]\nradius = 1\n".to_string();
    for i in 1..=2000 {
        chain += &format!("[model.offset.n{i}]\nof = \"n{}\"\nby = 0\n", i - 1);
    }
    refused(&chain, &["nodes below each other"]);
    refused("[model.point.a]\ncentre = [0,0,0]\nradius = 1\n[model.repeat.b]\nof = \"a\"\ncount = 99999", &["nodes"]);
}

#[test]
fn sizes_are_the_longest_side() {
    let text = "[model]\nbounds = [[0, 0, 0], [4, 2, 1]]\nsamples = 33\n[model.formula.a]\nf = \"x\"";
    let dims = |size| ModelDescription::read(text, "m.toml", size, &mut Made).unwrap().dims;
    assert_eq!(dims(None), [33, 17, 9]);
    assert_eq!(dims(Some(Size::Longest(9))), [9, 5, 3]);
    assert_eq!(dims(Some(Size::Exactly([3, 4, 5]))), [3, 4, 5]);
}

/// The examples are read, and their surfaces lie inside of their boxes: no solid touches the faces.
#[test]
fn examples_fit_their_boxes() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/models");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        count += 1;
        let name = format!("{}:40", path.display());
        let model = crate::scene::describe(&crate::scene::ModelName::of(&name).unwrap(), false).unwrap();
        let mut values = Vec::new();
        model.tree.sample(&model.bounds, model.dims, true, &mut values);
        let solid = |v: &f32| f64::from(*v) > model.isovalue;
        let share = values.iter().filter(|v| solid(v)).count() as f64 / values.len() as f64;
        assert!(share > 0.005 && share < 0.7, "{name}: {share} is solid");
        for (value, at) in values.iter().zip(crate::grid3::all(model.dims)) {
            let on_face = (0..3).any(|a| at[a] == 0 || at[a] + 1 == model.dims[a]);
            assert!(!(on_face && solid(value)), "{name}: solid at {at:?}, on a face of the box");
        }
    }
    assert!(count >= 6, "{count} examples");
}

#[test]
fn a_volume_is_trilinear_where_it_lies_and_its_least_outside() {
    let body =
        "[model.volume.v]\nfile = \"v.nii\"\nisovalue = 16\nweight = 0.5\nscale = 0.25\ntranslate = [-0.5, 0, 0.125]\n";
    let model = read(body).unwrap();
    // p = 0.25 q + t; f = ½ + ½ (h(q) − 16).
    let of = |q: DVec3| 0.5 + 0.5 * (q.x + 2.0 * q.y + 4.0 * q.z + 10.0 - 16.0);
    for q in [DVec3::new(0.3, 0.7, 1.4), DVec3::new(1.0, 2.0, 2.0), DVec3::new(0.0, 1.0, 0.5)] {
        let p = 0.25 * q + DVec3::new(-0.5, 0.0, 0.125);
        let (value, gradient) = model.tree.value_and_gradient(p);
        near(value, of(q));
        assert!((gradient - DVec3::new(2.0, 4.0, 8.0)).length() < 1e-9, "{gradient}");
    }
    near(model.tree.value(DVec3::new(0.9, 0.0, 0.0)), 0.5 + 0.5 * (10.0 - 16.0));
    // Below: high values are empty, and what is outside is the highest.
    near(value(&body.replace("weight = 0.5", "weight = -1"), [0.9, 0.0, 0.0]), 0.5 - (23.0 - 16.0));
    for (wrong, expected) in
        [("isovalue = 16\n", "isovalue"), ("file = \"v.nii\"\n", "file"), ("weight = 0.5", "other than 0")]
    {
        let with = if wrong.starts_with("weight") { "weight = 0" } else { "" };
        let text = read(&body.replace(wrong, with)).unwrap_err().to_string();
        assert!(text.contains("m.toml:") && text.contains(expected), "{text}");
    }
}

/// What its reader says of a file is told; what is wrong with one stands at its line, with the keys that mend it.
#[test]
fn files_of_volumes_are_chosen_from_checked_and_spoken_of() {
    let volume = |name: &str, more: &str| format!("[model.volume.v]\nfile = \"{name}\"\nisovalue = 16\n{more}");
    refused(&volume("two.tif", ""), &["m.toml:4", "two.tif", "dapi", "channel = N or channel = NAME"]);
    refused(&volume("two.tif", "channel = \"rfp\""), &["m.toml:4", "rfp", "gfp"]);
    refused(&volume("slice.nii", ""), &["m.toml:4", "slice.nii", "3×3×1 samples", "at least 2 samples"]);
    for channel in ["1", "\"gfp\""] {
        assert!(read(&volume("two.tif", &format!("channel = {channel}"))).is_ok());
    }
    let notes = read(&volume("moving.nii", "")).unwrap().notes;
    let told = |n: &String| n.starts_with("line 4: moving.nii: ") && n.contains("5") && n.contains("timepoint =");
    assert!(notes.iter().any(told), "{notes:?}");
    assert!(!read(&volume("moving.nii", "timepoint = 1")).unwrap().notes.iter().any(|n| n.contains("choose")));
    // 10 to 23: nothing is above 23, all is from 10 on.
    for (isovalue, weight, is_good) in [
        ("9.5", 1, false),
        ("10", 1, true),
        ("23", 1, false),
        ("22.9", 1, true),
        ("10", -1, false),
        ("10.1", -1, true),
        ("23", -1, true),
        ("23.5", -1, false),
    ] {
        let body = volume("v.nii", &format!("weight = {weight}")).replace("16", isovalue);
        if is_good {
            assert!(read(&body).is_ok(), "{isovalue} {weight}");
        } else {
            refused(&body, &["m.toml:5", "range of v.nii, 10 to 23"]);
        }
    }
}

/// Rounding does not put a point of the face outside, wherever the volume lies.
#[test]
fn faces_of_volumes_belong_to_them() {
    let turns = ["[0.3, -0.7, 12.3]", "[10000.1, 333.3, -77.7]"];
    for (scale, translate, rotate) in turns.iter().flat_map(|t| [(0.1, t, 0.0), (0.3, t, 33.0), (7.7, t, 120.0)]) {
        let body = format!(
            "[model.volume.v]\nfile = \"v.nii\"\nisovalue = 16\nscale = {scale}\ntranslate = {translate}\n\
             rotate = [1, 2, 3, {rotate}]\n"
        );
        let model = read(&body).unwrap();
        let t: Vec<f64> = translate[1..translate.len() - 1].split(',').map(|n| n.trim().parse().unwrap()).collect();
        let turn = glam::DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), f64::to_radians(rotate));
        for i in 0..200 {
            let mut q = crate::model::grid::scattered(i) * DVec3::new(1.0, 2.0, 2.0);
            let axis = i as usize % 3;
            q[axis] = if i % 2 == 0 { 0.0 } else { [1.0, 2.0, 2.0][axis] };
            let p = turn * (scale * q) + DVec3::new(t[0], t[1], t[2]);
            let expected = 0.5 + q.x + 2.0 * q.y + 4.0 * q.z + 10.0 - 16.0;
            let value = model.tree.value(p);
            assert!((value - expected).abs() < 1e-7, "{value} for {expected} at {q}, {body}");
        }
    }
}

/// What a volume is outside of its box is no part of it for `cache`, which has samples of all that is looked at.
#[test]
fn a_volume_goes_on_outside_of_its_box_below_other_nodes() {
    let volume = "[model.volume.v]\nfile = \"v.nii\"\nisovalue = 16\nscale = 0.25\ntranslate = [-0.3, -0.2, 0.1]\n";
    // Far from the box: the least of the file.
    let beyond = 0.5 + 10.0 - 16.0;
    let body = format!("{volume}[model.cache.c]\nof = \"v\"\nsamples = 32\n");
    for at in [[0.7, 0.7, 0.0], [-0.7, 0.0, 0.5], [0.0, 0.0, -0.5], [0.5, 0.8, 0.9]] {
        near(value(&body, at), beyond);
    }
    let others = [
        "[model.point.p]\ncentre = [0.1, 0.2, 0.3]\nradius = 0.8\n[model.union.u]\nof = [\"v\", \"p\"]\n",
        "[model.point.p]\ncentre = [0.1, 0.2, 0.3]\nradius = 0.8\n[model.difference.u]\nof = [\"p\", \"v\"]\n",
        "[model.point.p]\ncentre = [0.1, 0.2, 0.3]\nradius = 0.8\n[model.sum.u]\nof = [\"p\", \"v\"]\n",
        "[model.twist.u]\nof = \"v\"\nper_unit = 0.8\n",
        "[model.invert.w]\nof = \"v\"\n[model.shell.u]\nof = \"w\"\nthickness = 0.4\n",
        "[model.cache.c]\nof = \"v\"\nsamples = 24\n[model.bend.u]\nof = \"c\"\nper_unit = 0.4\nfrom = -1\nto = 1\n",
        "[model.point.p]\ncentre = [0.1, 0.2, 0.3]\nradius = 0.8\n[model.contact.u]\nof = [\"p\", \"v\"]\nwidth = 0.2\nshow = \"first\"\n",
    ];
    for other in others {
        let model = read(&format!("{volume}{other}")).unwrap();
        let sampled = |prunes: bool| {
            let mut values = Vec::new();
            model.tree.sample(&model.bounds, [37, 40, 33], prunes, &mut values);
            values.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        assert!(sampled(true) == sampled(false), "{other}");
    }
}
