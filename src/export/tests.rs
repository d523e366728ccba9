//! Checks of meshes, and PLY against a reader written from the format's definition. GLB is read
//! back by `tests/readers/gltf_validator.rs`.

use super::test_mesh::mesh_of;
use super::*;
use std::io;

/// A tetrahedron; its normals are its vertex directions.
struct Tetrahedron {
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    colours: Vec<[f32; 3]>,
    radiance: Vec<[f32; 3]>,
    error: Vec<f32>,
    triangles: Vec<[u32; 3]>,
}

impl Tetrahedron {
    fn at(origin: DVec3) -> Self {
        let corners = [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]].map(DVec3::from);
        Self {
            positions: corners.map(|c| origin + c).into(),
            normals: corners.map(|c| c.as_vec3().normalize()).into(),
            colours: vec![[0.0; 3], [1.0; 3], [0.2140; 3], [0.1, 0.5, 0.9]],
            radiance: vec![[0.0; 3], [50.0, 2.0, -0.5], [1.0; 3], [3.0; 3]],
            error: vec![0.0, 0.25, 0.5, 1.0],
            triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
        }
    }

    fn mesh(&self) -> ExportMesh<'_> {
        let mesh = mesh_of(&self.positions, &self.normals, &self.triangles, &self.colours);
        ExportMesh { name: "tetrahedron", ..mesh }
    }
}

/// The two writers of meshes.
fn all_refuse(mesh: &ExportMesh<'_>, expected: &str) {
    let results = [
        gltf::write(&mut Vec::new(), mesh, &gltf::GltfOptions::default()),
        ply::write(&mut Vec::new(), mesh, &ply::PlyOptions::default()),
    ];
    for result in results {
        let message = result.expect_err(expected).to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn unsound_meshes_are_refused_by_name() {
    let sound = Tetrahedron::at(DVec3::ZERO);
    sound.mesh().check().unwrap();
    for bad in [1.0 + f32::EPSILON, -1e-9, f32::NAN, f32::INFINITY] {
        let mut t = Tetrahedron::at(DVec3::ZERO);
        t.colours[2][1] = bad;
        all_refuse(&t.mesh(), "at vertex 2");
    }
    for bad in [Vec3::ZERO, Vec3::splat(f32::NAN), 1.01 * Vec3::X, 0.99 * Vec3::X] {
        let mut t = Tetrahedron::at(DVec3::ZERO);
        t.normals[1] = bad;
        all_refuse(&t.mesh(), "mesh normal");
    }
    let mut t = Tetrahedron::at(DVec3::ZERO);
    t.triangles[3][0] = 4;
    all_refuse(&t.mesh(), "in triangle 3");
    for bad in [f64::NAN, 1e39] {
        let mut t = Tetrahedron::at(DVec3::ZERO);
        t.positions[3].y = bad;
        all_refuse(&ExportMesh { box_in_world: sound.mesh().box_in_world, ..t.mesh() }, "mesh position");
    }
    all_refuse(&ExportMesh { colours: &sound.colours[1..], ..sound.mesh() }, "one to a vertex");
    all_refuse(&ExportMesh { radiance: Some(&[[0.0; 3]]), ..sound.mesh() }, "mesh radiance");
    all_refuse(&ExportMesh { radiance: Some(&[[f32::NAN; 3]; 4]), ..sound.mesh() }, "finite channels");
    for e in [-1.0, f32::NAN] {
        all_refuse(&ExportMesh { standard_error: Some(StandardError::Grey(&[e; 4])), ..sound.mesh() }, "0 or more");
        all_refuse(&ExportMesh { standard_error: Some(StandardError::Rgb(&[[e; 3]; 4])), ..sound.mesh() }, "0 or more");
    }
    for metres in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        all_refuse(&ExportMesh { metres_per_unit: Some(metres), ..sound.mesh() }, "metres per unit");
    }
    let bounds = sound.mesh().box_in_world;
    for min in [DVec3::NAN, DVec3::splat(5.0), DVec3::NEG_INFINITY, DVec3::splat(-f64::MAX)] {
        let max = if min.x == -f64::MAX { DVec3::MAX } else { bounds.max };
        all_refuse(&ExportMesh { box_in_world: Bounds { min, max }, ..sound.mesh() }, "mesh box");
    }
}

#[test]
fn millimetres_keep_their_size_and_else_the_longest_side_becomes_one_metre() {
    let t = Tetrahedron::at(DVec3::ZERO); // longest side 2
    let with = |metres_per_unit| gltf::scale(&ExportMesh { metres_per_unit, ..t.mesh() });
    assert_eq!(with(Some(0.001)), 0.001);
    // Another way to write it, as products of header fields give it.
    assert_eq!(with(Some(0.1 * 0.01)), 0.001);
    // Ångström, bohr, µm, cm and m.
    for metres in [1e-10, 5.29177210903e-11, 1e-6, 1e-2, 1.0] {
        assert_eq!(with(Some(metres)), 0.5);
    }
    assert_eq!(with(None), 0.5);
    let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
    assert_eq!(gltf::scale(&ExportMesh { box_in_world: point, ..t.mesh() }), 1.0);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-39, 1e39] {
        let options = gltf::GltfOptions { scale: Some(bad), ..Default::default() };
        let message = gltf::write(&mut Vec::new(), &t.mesh(), &options).unwrap_err().to_string();
        assert!(message.starts_with("scale: given"), "{message}");
    }
}

#[test]
fn the_size_is_that_of_what_a_viewer_shows() {
    // Sides 2, 4 and 6 along world x, y and z.
    let mut t = Tetrahedron::at(DVec3::ZERO);
    t.positions.iter_mut().for_each(|p| *p *= DVec3::new(1.0, 2.0, 3.0));
    let sides = |up, scale| gltf::size_in_metres(&ExportMesh { up, ..t.mesh() }, scale);
    assert_eq!(sides(Up::Y, Some(1.0)), [2.0, 4.0, 6.0]);
    // World z is glTF y; of a patient, too.
    assert_eq!(sides(Up::Z, Some(1.0)), [2.0, 6.0, 4.0]);
    assert_eq!(sides(Up::Anatomical, Some(0.5)), [1.0, 3.0, 2.0]);
    assert_eq!(sides(Up::Y, None), [2.0 / 6.0, 4.0 / 6.0, 1.0]);
}

/// Takes `left` bytes, then fails.
struct Full {
    left: usize,
}

impl io::Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(self.left);
        self.left -= taken;
        if taken == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(taken) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_stream_that_fails_anywhere_is_an_error() {
    let t = Tetrahedron::at(DVec3::ZERO);
    let image = Image::filled(3, 3, [0.5; 4]).unwrap();
    type Writer<'a> = dyn Fn(&mut dyn io::Write) -> Result<()> + 'a;
    let writers: [&Writer<'_>; 3] = [
        &|w| gltf::write(w, &t.mesh(), &Default::default()),
        &|w| ply::write(w, &t.mesh(), &Default::default()),
        &|w| png::write(w, &image, &Default::default()),
    ];
    for (index, writer) in writers.iter().enumerate() {
        let mut whole = Vec::new();
        writer(&mut whole).unwrap();
        for left in 0..whole.len() {
            let error = writer(&mut Full { left });
            assert!(matches!(error, Err(Error::Io { .. })), "writer {index} at byte {left}: {error:?}");
        }
        writer(&mut Full { left: whole.len() }).unwrap();
    }
}

/// A PLY as lines of its header, vertex rows by property, and faces.
struct Ply {
    header: String,
    names: Vec<String>,
    vertices: Vec<Vec<f64>>,
    faces: Vec<[u32; 3]>,
}

fn read_ply(bytes: &[u8]) -> Ply {
    let mark = b"end_header\n";
    let end = bytes.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len();
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let count = |element: &str| -> usize {
        header.lines().find_map(|l| l.strip_prefix(&format!("element {element} "))).unwrap().parse().unwrap()
    };
    let scalars: Vec<(String, String)> = header
        .lines()
        .filter_map(|l| l.strip_prefix("property ").filter(|l| !l.starts_with("list")))
        .map(|l| l.split_once(' ').map(|(kind, name)| (kind.into(), name.into())).unwrap())
        .collect();
    let mut rest = &bytes[end..];
    let mut take = |n: usize| {
        let (head, tail) = rest.split_at(n);
        rest = tail;
        head
    };
    let vertices = (0..count("vertex"))
        .map(|_| {
            let mut value = |kind: &str| match kind {
                "uchar" => f64::from(take(1)[0]),
                "float" => f64::from(f32::from_le_bytes(take(4).try_into().unwrap())),
                "double" => f64::from_le_bytes(take(8).try_into().unwrap()),
                other => panic!("{other}"),
            };
            scalars.iter().map(|(kind, _)| value(kind)).collect()
        })
        .collect();
    let faces = (0..count("face"))
        .map(|_| {
            assert_eq!(take(1), [3]);
            std::array::from_fn(|_| u32::from_le_bytes(take(4).try_into().unwrap()))
        })
        .collect();
    assert!(rest.is_empty(), "{} bytes too many", rest.len());
    Ply { header, names: scalars.into_iter().map(|s| s.1).collect(), vertices, faces }
}

#[test]
fn ply_holds_the_mesh_in_world() {
    for origin in [DVec3::ZERO, DVec3::new(1e6, -1e6, 0.0)] {
        let t = Tetrahedron::at(origin);
        let mesh =
            ExportMesh { radiance: Some(&t.radiance), standard_error: Some(StandardError::Grey(&t.error)), ..t.mesh() };
        let options = ply::PlyOptions {
            provenance: serde_json::json!({ "file": "é\n😀" }),
            generator: "isolume\nelement".into(),
        };
        let mut bytes = Vec::new();
        ply::write(&mut bytes, &mesh, &options).unwrap();
        let read = read_ply(&bytes);
        assert!(read.header.is_ascii() && read.header.contains(r#"provenance {"file":"\u00e9\n\ud83d\ude00"}"#));
        assert_eq!(read.header.contains("property double x"), origin != DVec3::ZERO);
        assert_eq!(read.names.join(" "), "x y z nx ny nz red green blue radiance_r radiance_g radiance_b stderr");
        for (v, row) in read.vertices.iter().enumerate() {
            assert_eq!(row[..3], t.positions[v].to_array());
            assert!((DVec3::from_slice(&row[3..6]) - t.normals[v].as_dvec3()).length() < 1e-6);
            for channel in 0..3 {
                let signal = 255.0 * crate::srgb::srgb_from_linear(f64::from(t.colours[v][channel]));
                assert!((row[6 + channel] - signal).abs() <= 0.5 + 1e-4);
            }
            let radiance = t.radiance[v].map(f64::from);
            assert_eq!(row[9..12], radiance);
            assert_eq!(row[12], f64::from(t.error[v]));
        }
        assert_eq!(read.faces, t.triangles);
    }
}

#[test]
fn empty_ply_has_no_elements() {
    let t = Tetrahedron::at(DVec3::ZERO);
    let mesh = ExportMesh {
        positions: Positions::FromCentre(&[]),
        normals_in_world: &[],
        colours: &[],
        triangles: &[],
        ..t.mesh()
    };
    let mut bytes = Vec::new();
    ply::write(&mut bytes, &mesh, &Default::default()).unwrap();
    let read = read_ply(&bytes);
    assert!(read.vertices.is_empty() && read.faces.is_empty());
}

#[test]
fn records_are_written_whole_whatever_the_buffer() {
    // A buffer holds 2¹⁸ / 12 = 21,845 records.
    for count in [0, 1, 21_844, 21_845, 21_846, 50_000] {
        let mut bytes = Vec::new();
        write_records(&mut bytes, count, |i| bytes_of_triple([i as f32, 1.0, 2.0])).unwrap();
        assert_eq!(bytes.len(), 12 * count);
        assert!(bytes.chunks(12).enumerate().all(|(i, b)| b[..4] == (i as f32).to_le_bytes()));
    }
}
