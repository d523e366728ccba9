//! Writes GLB files of every kind that the exporter can make, reads each back with the `gltf`
//! crate and compares the numbers, and lets the Khronos validator judge them.
//!
//! The validator needs `node` and the npm package `gltf-validator` (folder in
//! `ISOLUME_GLTF_VALIDATOR`, or `npm install --prefix target/npm --no-save gltf-validator`);
//! without them that half is skipped and says so.

use glam::{DMat3, DMat4, DVec3, Vec3};
use gltf::Semantic;
use gltf::accessor::Iter;
use gltf::mesh::util::{ReadColors, ReadIndices};
use isolume::export::gltf::{ColourFormat, GltfOptions};
use isolume::export::{ExportMesh, Positions, StandardError, atomic};
use isolume::geom::{Affine, Bounds, Up};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A mesh that owns its attributes.
struct Owned {
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    colours: Vec<[f32; 3]>,
    radiance: Vec<[f32; 3]>,
    error_grey: Vec<f32>,
    bounds: Bounds,
}

impl Owned {
    /// A torus of `rows` × `columns` vertices (radii 3 and 1 around z) under an affine map; it is
    /// closed and has no poles, so no degenerate triangle. A left-handed map flips the winding,
    /// as the extractor does.
    fn torus(rows: u32, columns: u32, world_from_local: &Affine) -> Self {
        let mut mesh = Self::nothing(Bounds::EMPTY);
        for r in 0..rows {
            for c in 0..columns {
                let (u, v) = (TAU * f64::from(r) / f64::from(rows), TAU * f64::from(c) / f64::from(columns));
                let outward = DVec3::new(u.cos() * v.cos(), u.sin() * v.cos(), v.sin());
                let p = world_from_local.point(DVec3::new(3.0 * u.cos(), 3.0 * u.sin(), 0.0) + outward);
                let n = world_from_local.gradient_matrix() * outward.as_vec3();
                mesh.positions.push(p);
                mesh.normals.push(n.normalize());
                mesh.bounds = mesh.bounds.including(p);
                let colour = (0.5 * outward + 0.5).as_vec3().clamp(Vec3::ZERO, Vec3::ONE).to_array();
                mesh.colours.push(colour);
                mesh.radiance.push(colour.map(|x| 1e4 * x - 1.0));
                mesh.error_grey.push(colour[0]);
                let at = |r: u32, c: u32| (r % rows) * columns + c % columns;
                let (a, b, d, e) = (at(r, c), at(r + 1, c), at(r, c + 1), at(r + 1, c + 1));
                let flip = |[a, b, c]: [u32; 3]| if world_from_local.is_left_handed() { [a, c, b] } else { [a, b, c] };
                mesh.triangles.extend([flip([a, b, e]), flip([a, e, d])]);
            }
        }
        mesh
    }

    fn nothing(bounds: Bounds) -> Self {
        Self {
            positions: vec![],
            normals: vec![],
            triangles: vec![],
            colours: vec![],
            radiance: vec![],
            error_grey: vec![],
            bounds,
        }
    }

    fn mesh(&self) -> ExportMesh<'_> {
        ExportMesh {
            name: "surface",
            positions: Positions::World(&self.positions),
            normals_in_world: &self.normals,
            triangles: &self.triangles,
            colours: &self.colours,
            radiance: None,
            standard_error: None,
            box_in_world: self.bounds,
            up: Up::Z,
            metres_per_unit: None,
        }
    }
}

fn unit_box() -> Bounds {
    Bounds { min: DVec3::ZERO, max: DVec3::ONE }
}

/// Where the files go: under `target/`.
fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("glb");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Writes a file, reads it back, compares; the path goes to the validator.
fn write_and_compare(name: &str, mesh: &ExportMesh<'_>, options: &GltfOptions) -> PathBuf {
    let path = folder().join(format!("{name}.glb"));
    atomic::write(&path, |w| isolume::export::gltf::write(w, mesh, options)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    check_container(name, &bytes);
    compare(name, &bytes, mesh, options);
    path
}

/// GLB lengths, padding and alignment.
fn check_container(name: &str, bytes: &[u8]) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((word(8), word(12) % 4), (bytes.len(), 0), "{name}");
    let glb = gltf::Glb::from_slice(bytes).unwrap();
    let text = std::str::from_utf8(&glb.json).unwrap();
    let padding = text.len() - text.trim_end().len();
    assert!(padding < 4 && text[text.len() - padding..].bytes().all(|b| b == b' '), "{name}");
    let json: serde_json::Value = serde_json::from_str(text).unwrap();
    let Some(bin) = glb.bin else {
        assert!(json.get("buffers").is_none(), "{name}");
        return;
    };
    let used = json["buffers"][0]["byteLength"].as_u64().unwrap() as usize;
    assert!(bin.len() % 4 == 0 && bin.len() - used < 4 && bin[used..].iter().all(|&b| b == 0), "{name}");
    for view in json["bufferViews"].as_array().unwrap() {
        assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0, "{name}");
    }
}

/// The numbers, as an independent reader sees them.
fn compare(name: &str, bytes: &[u8], mesh: &ExportMesh<'_>, options: &GltfOptions) {
    let document = gltf::Gltf::from_slice(bytes).unwrap();
    let blob = document.blob.clone();
    let buffers = |_: gltf::Buffer<'_>| blob.as_deref();
    let node = document.default_scene().unwrap().nodes().next().unwrap();
    let extras: serde_json::Value = serde_json::from_str(node.extras().as_ref().unwrap().get()).unwrap();
    let centre = mesh.box_in_world.centre();
    assert_eq!(extras["centre_in_world"], serde_json::json!(centre.to_array()), "{name}");
    assert_eq!(extras["metres_per_unit"].as_f64(), mesh.metres_per_unit, "{name}");
    let scale = extras["scale"].as_f64().unwrap();
    assert_eq!(scale, options.scale.unwrap_or_else(|| isolume::export::gltf::scale(mesh)), "{name}");
    let Some(gltf_mesh) = node.mesh() else {
        assert!(mesh.triangles.is_empty(), "{name}: the mesh is missing");
        return;
    };
    let primitive = gltf_mesh.primitives().next().unwrap();
    assert!(primitive.material().unlit(), "{name}");
    let reader = primitive.reader(buffers);

    let positions: Vec<_> = reader.read_positions().unwrap().collect();
    let to_gltf = DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
    let size = mesh.box_in_world.size().max_element();
    let rotation = mesh.up.gltf_from_world();
    assert_eq!(positions.len(), mesh.positions.len(), "{name}");
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (v, &p) in positions.iter().enumerate() {
        let in_world = mesh.positions.in_world(v, centre);
        let stored = Vec3::from(p);
        // |world − centre| ≤ size/2 is rounded to f32 once: error ≤ 2⁻²⁵ of the side on each axis.
        assert!((stored.as_dvec3() - (in_world - centre)).abs().max_element() <= size / f64::from(1 << 25), "{name}");
        // The node brings in f32 rotation, scale and translation: a few 2⁻²⁴ of each part.
        let expected = rotation * (scale * in_world);
        let tolerance = 1e-6 * scale * (size + in_world.length());
        assert!((to_gltf.transform_point3(stored.as_dvec3()) - expected).length() <= tolerance, "{name}, vertex {v}");
        (low, high) = (low.min(stored), high.max(stored));
    }
    let declared = primitive.bounding_box();
    assert_eq!((declared.min, declared.max), (low.to_array(), high.to_array()), "{name}: min and max are exact");

    for (&normal, given) in reader.read_normals().unwrap().collect::<Vec<_>>().iter().zip(mesh.normals_in_world) {
        let n = Vec3::from(normal).as_dvec3();
        assert!((n.length() - 1.0).abs() < 1e-6 && (n.as_vec3() - *given).length() < 1e-5, "{name}");
    }
    let colours: Vec<[f32; 3]> = match (options.colour_format, reader.read_colors(0).unwrap()) {
        (ColourFormat::U16, ReadColors::RgbaU16(c)) => {
            c.map(|[r, g, b, a]| (a == 65_535).then(|| [r, g, b].map(|x| f32::from(x) / 65_535.0)).unwrap()).collect()
        }
        (ColourFormat::F32, ReadColors::RgbF32(c)) => c.collect(),
        _ => panic!("{name}: colours in another format"),
    };
    // Half a step of 16 bits, and f32 rounding of the quotient.
    let tolerance = if options.colour_format == ColourFormat::U16 { 0.5 / 65_535.0 + 1e-7 } else { 0.0 };
    assert!(colours.as_flattened().iter().zip(mesh.colours.as_flattened()).all(|(a, b)| (a - b).abs() <= tolerance));

    let custom = |name: &str| primitive.get(&Semantic::Extras(name.into()));
    let radiance: Option<Vec<[f32; 3]>> = custom("RADIANCE").map(|a| Iter::new(a, buffers).unwrap().collect());
    assert_eq!(radiance.as_deref(), mesh.radiance, "{name}");
    match mesh.standard_error {
        None => assert!(custom("STDERR").is_none()),
        Some(StandardError::Grey(e)) => {
            assert_eq!(Iter::<f32>::new(custom("STDERR").unwrap(), buffers).unwrap().collect::<Vec<_>>(), e, "{name}");
        }
        Some(StandardError::Rgb(e)) => {
            let read = Iter::<[f32; 3]>::new(custom("STDERR").unwrap(), buffers).unwrap();
            assert_eq!(read.collect::<Vec<_>>(), e, "{name}");
        }
    }

    let indices = reader.read_indices().unwrap();
    let short = options.allow_u16_indices && positions.len() <= 65_535;
    assert_eq!(matches!(indices, ReadIndices::U16(_)), short, "{name}");
    assert_eq!(indices.into_u32().collect::<Vec<_>>(), mesh.triangles.as_flattened(), "{name}");
    let stored = |i: u32| to_gltf.transform_vector3(Vec3::from(positions[i as usize]).as_dvec3());
    let volume: f64 =
        mesh.triangles.iter().map(|&[a, b, c]| stored(a).dot(stored(b).cross(stored(c)))).sum::<f64>() / 6.0;
    assert!(name.starts_with("single") || volume > 0.0, "{name}: front faces look inward");
}

/// Every kind of file.
fn write_all() -> Vec<PathBuf> {
    let plain = GltfOptions::default();
    let float = GltfOptions { colour_format: ColourFormat::F32, ..Default::default() };
    let mut paths = Vec::new();
    let mut put = |name: &str, mesh: &ExportMesh<'_>, options: &GltfOptions| {
        paths.push(write_and_compare(name, mesh, options));
    };

    let empty = Owned::nothing(unit_box());
    put("empty", &empty.mesh(), &plain);
    let far_empty = Owned::nothing(Bounds { min: DVec3::splat(1e6), max: DVec3::splat(1e6 + 100.0) });
    put("empty_far_mm", &ExportMesh { metres_per_unit: Some(0.001), ..far_empty.mesh() }, &plain);

    let mut single = Owned::nothing(unit_box());
    single.positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    single.normals = vec![Vec3::Z; 3];
    single.triangles = vec![[0, 1, 2]];
    single.colours = vec![[0.0; 3], [1.0; 3], [0.2140; 3]];
    put("single_triangle", &single.mesh(), &plain); // 6 bytes of indices: the padding is real

    let torus = Owned::torus(12, 9, &Affine::IDENTITY);
    let lit = ExportMesh { radiance: Some(&torus.radiance), ..torus.mesh() };
    put("torus_u16", &torus.mesh(), &plain);
    put("torus_float", &torus.mesh(), &float);
    put("torus_long_indices", &torus.mesh(), &GltfOptions { allow_u16_indices: false, ..plain.clone() });
    put("torus_one_sided", &torus.mesh(), &GltfOptions { double_sided: false, ..plain.clone() });
    let (grey, rgb) = (StandardError::Grey(&torus.error_grey), StandardError::Rgb(&torus.colours));
    put("torus_radiance_grey_error", &ExportMesh { standard_error: Some(grey), ..lit }, &plain);
    put("torus_radiance_rgb_error", &ExportMesh { standard_error: Some(rgb), ..lit }, &float);
    let from_centre: Vec<_> = torus.positions.iter().map(|p| (*p - torus.bounds.centre()).as_vec3()).collect();
    put("torus_from_centre", &ExportMesh { positions: Positions::FromCentre(&from_centre), ..torus.mesh() }, &plain);
    for up in [Up::X, Up::Y, Up::Z, Up::NegX, Up::NegY, Up::NegZ] {
        put(&format!("torus_up_{}", up.name()), &ExportMesh { up, ..torus.mesh() }, &plain);
    }
    let millimetres = Affine::from_spacing(DVec3::splat(20.0), DVec3::ZERO).unwrap();
    let millimetres = Owned::torus(12, 9, &millimetres);
    put("torus_mm", &ExportMesh { metres_per_unit: Some(0.001), ..millimetres.mesh() }, &plain);
    put("torus_bohr", &ExportMesh { metres_per_unit: Some(5.29e-11), ..torus.mesh() }, &plain);
    put("torus_scaled", &torus.mesh(), &GltfOptions { scale: Some(0.25), ..plain.clone() });
    put(
        "torus_named",
        &ExportMesh { name: "caf\"é\n≤", ..torus.mesh() },
        &GltfOptions {
            copyright: Some("© the data's owner".into()),
            provenance: serde_json::json!({ "command": ["isolume", "demo"], "isovalue": 0.25, "nothing": null }),
            ..plain.clone()
        },
    );

    let far = Affine::from_spacing(DVec3::splat(0.37), DVec3::new(1e6, -1e6, 1e6)).unwrap();
    let far = Owned::torus(40, 30, &far);
    put("torus_far", &far.mesh(), &plain);
    put("torus_far_mm", &ExportMesh { metres_per_unit: Some(0.001), ..far.mesh() }, &plain);
    let oblique = DMat3::from_cols(DVec3::new(2., 0., 0.3), DVec3::new(0.4, 0.5, 0.), DVec3::new(0., 0.1, -100.));
    let left = Affine::new(oblique, DVec3::splat(-5.0)).unwrap();
    assert!(left.is_left_handed());
    put("torus_left_handed", &Owned::torus(40, 30, &left).mesh(), &plain);

    // 65,535 vertices are the most that 16-bit indices reach (the restart value is taken).
    put("torus_65535", &Owned::torus(255, 257, &Affine::IDENTITY).mesh(), &plain);
    put("torus_65536", &Owned::torus(256, 256, &Affine::IDENTITY).mesh(), &plain);
    let large = Owned::torus(300, 300, &Affine::IDENTITY);
    put("torus_90000", &ExportMesh { radiance: Some(&large.radiance), ..large.mesh() }, &float);
    paths
}

#[test]
fn files_read_back_the_same_and_pass_the_khronos_validator() {
    let paths = write_all();
    assert!(paths.len() > 20);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = root.join("tests/validate_gltf.mjs");
    let package = std::env::var_os("ISOLUME_GLTF_VALIDATOR")
        .map_or_else(|| root.join("target/npm/node_modules/gltf-validator"), PathBuf::from);
    if !package.join("package.json").is_file() {
        println!("skipped: no gltf-validator in {}; set ISOLUME_GLTF_VALIDATOR", package.display());
        return;
    }
    let outcome = Command::new("node").arg(&script).args(&paths).env("ISOLUME_GLTF_VALIDATOR", &package).output();
    let output = match outcome {
        Ok(output) => output,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            println!("skipped: node is not installed");
            return;
        }
        Err(error) => panic!("node: {error}"),
    };
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(text.lines().filter(|l| l.contains(": 0 errors, 0 warnings,")).count(), paths.len(), "{text}");

    // The judge can say no: a float colour above 1 is an error.
    let mut bytes = std::fs::read(folder().join("torus_float.glb")).unwrap();
    let document = gltf::Gltf::from_slice(&bytes).unwrap();
    let colours = document.accessors().find(|a| a.index() == 2).and_then(|a| a.view()).unwrap();
    let at = bytes.len() - document.blob.as_ref().unwrap().len() + colours.offset();
    bytes[at..at + 4].copy_from_slice(&1.5f32.to_le_bytes());
    let broken = folder().join("broken.glb.txt");
    std::fs::write(&broken, bytes).unwrap();
    let output =
        Command::new("node").arg(&script).arg(&broken).env("ISOLUME_GLTF_VALIDATOR", &package).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.code() == Some(1) && text.contains("1 errors"), "{text}");
}
