//! Walls and luminaires against closed forms and slow twins.

use super::*;
use crate::sampling::hash::uniform;
use crate::sampling::statistics::Running;
use std::f64::consts::PI;

fn number(item: u64, dimension: u32) -> f64 {
    f64::from(uniform(7, 0x6765_6f6d, item as u32, dimension))
}

fn point(item: u64, first: u32) -> DVec3 {
    DVec3::new(number(item, first), number(item, first + 1), number(item, first + 2))
}

fn wall(shape: Shape) -> Wall {
    Wall { name: "w".into(), shape, finish: Finish::Diffuse([0.5; 3]) }
}

fn light(shape: LuminaireShape, power: f64) -> Geometry {
    let lamp = Luminaire { name: "lamp".into(), shape, power: [power, 2.0 * power, 0.0] };
    Geometry::new(Vec::new(), vec![lamp], 1.0).expect("a luminaire")
}

/// The hierarchy of boxes finds what trying every triangle finds, far from the origin too; `is_walled` agrees with it.
#[test]
fn the_hierarchy_finds_what_the_slow_twin_finds() {
    for far in [0.0, 1e6] {
        let corners = |i: u64| {
            let corner = point(i, 0) + far;
            [corner, corner + 0.2 * (point(i, 3) - 0.5), corner + 0.2 * (point(i, 6) - 0.5)]
        };
        let all: Vec<[DVec3; 3]> = (0..400).map(corners).collect();
        let fast = Geometry::new(vec![wall(Shape::Triangles(all.clone()))], Vec::new(), 1.0).expect("walls");
        assert!(fast.hierarchy.is_some());
        let mut hits = 0;
        for i in 0..2000 {
            let origin = 3.0 * point(i, 10) - 1.0 + far;
            let direction = (point(i + 5000, 13) + far - origin).normalize();
            let slow = (0..fast.parts() as u32)
                .filter_map(|part| Some((fast.distance_to(part, origin, direction, None)?, part)))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let found = fast.first_wall(origin, direction, None, f64::INFINITY);
            assert_eq!(found.map(|hit| (hit.distance, hit.part)), slow, "ray {i}");
            if let Some((distance, part)) = slow {
                hits += 1;
                assert!(fast.is_walled(origin, direction, None, 1.01 * distance));
                assert!(!fast.is_walled(origin, direction, None, 0.99 * distance));
                let beyond = fast.first_wall(origin + distance * direction, direction, Some(part), f64::INFINITY);
                assert!(beyond.is_none_or(|hit| hit.part != part));
            }
        }
        assert!(hits > 200, "{hits} hits do not tell much");
    }
}

/// No ray leaves a closed room, whatever edge or corner it is aimed at.
#[test]
fn rooms_do_not_leak() {
    let (min, max) = (DVec3::new(-1.0, 2.0, 0.1), DVec3::new(1.0, 2.3, 7.0));
    let walls = Shape::faces_of_box(min, max, true).map(wall).to_vec();
    let room = Geometry::new(walls, Vec::new(), 1.0).expect("a room");
    for i in 0..3000 {
        let origin = min + point(i, 0) * (max - min);
        // To corners, to edges, and anywhere.
        let aim = |a: usize| match i % 3 {
            0 => number(i, 5 + a as u32).round(),
            1 if a < 2 => number(i, 5 + a as u32).round(),
            _ => number(i, 5 + a as u32) * 3.0 - 1.0,
        };
        let target = min + DVec3::new(aim(0), aim(1), aim(2)) * (max - min);
        let direction = (target - origin).normalize();
        let hit = room.first_wall(origin, direction, None, f64::INFINITY).expect("a wall");
        assert!(hit.normal.dot(direction) < 0.0, "fronts look inward");
    }
}

/// Mean and standard error of the irradiance at a point with a normal.
fn irradiance(geometry: &Geometry, at: DVec3, normal: DVec3) -> Running {
    let mut sum = Running::new();
    for i in 0..20_000 {
        let u = [number(i, 0) as f32, number(i, 1) as f32];
        sum.push(geometry.arriving(0, at, u).map_or(0.0, |l| l.value[0] * l.direction.dot(normal).max(0.0)));
    }
    sum
}

/// Irradiance of luminaires of known power: a sphere πL(R/d)², a point I/d², a small rectangle L A/d², a large one by
/// its form factor.
#[test]
fn luminaires_send_what_their_power_says() {
    let (at, z) = (DVec3::new(0.3, -0.2, 0.1), DVec3::Z);
    let check = |name: &str, sum: &Running, expected: f64| {
        let error = (sum.mean() - expected).abs();
        assert!(error <= 4.0 * sum.standard_error() + 1e-6 * expected, "{name}: {} for {expected}", sum.mean());
    };
    let centre = at + 4.0 * z;
    // Φ = 4πR²·πL, so that πL(R/d)² = Φ/(4πd²).
    let sphere = light(LuminaireShape::Sphere { centre, radius: 1.5 }, 90.0);
    check("sphere", &irradiance(&sphere, at, z), 90.0 / (4.0 * PI * 16.0));
    let bulb = light(LuminaireShape::Point { position: centre }, 90.0);
    check("point", &irradiance(&bulb, at, z), 90.0 / (4.0 * PI * 16.0));
    let sun = light(LuminaireShape::Directional { towards: DVec3::new(0.6, 0.0, 0.8) }, 90.0);
    check("directional", &irradiance(&sun, at, z), 90.0 * 0.8);
    // A square of side 2 at height 1, centred: F = 4 · 1/(2π) · 2 · (1/√2) atan(1/√2) for corners at X = Y = 1.
    let (corner, u, v) = (at + DVec3::new(-1.0, -1.0, 1.0), 2.0 * DVec3::Y, 2.0 * DVec3::X);
    let square = light(LuminaireShape::Rectangle { corner, u, v }, 90.0);
    let factor = 4.0 / PI * std::f64::consts::FRAC_1_SQRT_2 * libm::atan(std::f64::consts::FRAC_1_SQRT_2);
    check("rectangle", &irradiance(&square, at, z), 90.0 / 4.0 * factor);
    let back = light(LuminaireShape::Rectangle { corner, u: v, v: u }, 90.0);
    assert_eq!(irradiance(&back, at, z).mean(), 0.0);
}

/// The density that is stated for a direction is the one it was drawn with, so the balance heuristic may use it.
#[test]
fn densities_are_those_of_the_samples() {
    let at = DVec3::new(0.1, 0.2, 0.3);
    let shapes = [
        LuminaireShape::Rectangle { corner: DVec3::new(-1.0, -1.0, 2.0), u: 3.0 * DVec3::Y, v: DVec3::X },
        LuminaireShape::Sphere { centre: DVec3::new(0.0, 1.0, 3.0), radius: 0.7 },
    ];
    for shape in shapes {
        let geometry = light(shape.clone(), 5.0);
        for i in 0..1000 {
            let u = [number(i, 0) as f32, number(i, 1) as f32];
            let drawn = geometry.arriving(0, at, u).expect("in front");
            let hit = geometry.first_luminaire(at, drawn.direction, f64::INFINITY).expect("it is there");
            assert!((hit.distance - drawn.distance).abs() < 1e-6 * drawn.distance, "{shape:?}");
            let cosine = geometry.light_cosine(0, at + hit.distance * drawn.direction, drawn.direction);
            let density = geometry.light_density(0, at, hit.distance, cosine);
            assert!((density / drawn.density.expect("an area") - 1.0).abs() < 1e-5, "{shape:?}");
        }
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let flat = Shape::Rectangle { corner: DVec3::ZERO, u: DVec3::X, v: 2.0 * DVec3::X };
    assert!(Geometry::new(vec![wall(flat)], Vec::new(), 1.0).is_err());
    let white = Wall { finish: Finish::Diffuse([1.1; 3]), ..wall(Shape::Sphere { centre: DVec3::ZERO, radius: 1.0 }) };
    assert!(Geometry::new(vec![white], Vec::new(), 1.0).is_err());
    let nowhere = LuminaireShape::Wall("no".into());
    let lamp = |shape| Luminaire { name: "l".into(), shape, power: [1.0; 3] };
    assert!(Geometry::new(Vec::new(), vec![lamp(nowhere)], 1.0).is_err());
    let bulb = LuminaireShape::Point { position: DVec3::ZERO };
    assert!(Geometry::new(Vec::new(), vec![lamp(bulb.clone()), lamp(bulb.clone())], 1.0).is_err());
    assert!(Geometry::new(Vec::new(), vec![lamp(bulb)], 0.0).is_err());
}

const OBJ: &str = "# a square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1 4//1\nf -4 -3 -2\n";

fn no_file(name: &str, _: u64) -> Result<Vec<u8>> {
    Err(Error::argument("file", name, "none", "none"))
}

#[test]
fn meshes_are_read_from_text_and_binary() {
    let square = read_mesh(OBJ.as_bytes(), &mut no_file).expect("OBJ");
    assert_eq!(square.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert_eq!(square.positions[2], DVec3::new(1.0, 1.0, 0.0));
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment c\nelement vertex 3\nproperty float x\nproperty uchar red\n\
             property double y\nproperty short z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let text = format!("{}0.5 9 2 -3\n1 9 0 0\n0 9 1 0\n3 2 1 0\n", header("ascii"));
    let from_text = read_mesh(text.as_bytes(), &mut no_file).expect("PLY");
    assert_eq!((from_text.positions[0], from_text.triangles[0]), (DVec3::new(0.5, 2.0, -3.0), [2, 1, 0]));
    for little in [true, false] {
        let name = if little { "binary_little_endian" } else { "binary_big_endian" };
        let mut bytes = header(name).into_bytes();
        let mut put = |mut b: Vec<u8>| {
            if !little {
                b.reverse();
            }
            bytes.extend(b);
        };
        for (x, y, z) in [(0.5f32, 2.0f64, -3i16), (1.0, 0.0, 0), (0.0, 1.0, 0)] {
            put(x.to_le_bytes().into());
            put(vec![9]);
            put(y.to_le_bytes().into());
            put(z.to_le_bytes().into());
        }
        put(vec![3]);
        [2i32, 1, 0].iter().for_each(|i| put(i.to_le_bytes().into()));
        assert_eq!(read_mesh(&bytes, &mut no_file).expect("PLY"), from_text, "{name}");
        // Every truncation is an error, none a panic.
        (0..bytes.len()).for_each(|n| assert!(read_mesh(&bytes[..n], &mut no_file).is_err(), "{n} bytes"));
    }
}

#[test]
fn a_gltf_file_is_placed_by_its_nodes() {
    let json = |byte_length: usize| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
            "nodes":[{{"mesh":0,"translation":[0,0,5],"scale":[2,2,2]}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
            "buffers":[{{"uri":"a.bin","byteLength":{byte_length}}}],
            "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":6}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
            {{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}}]}}"#
        )
    };
    let mut bin: Vec<u8> = Vec::new();
    [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().for_each(|v| bin.extend(v.to_le_bytes()));
    [0u16, 1, 2].iter().for_each(|v| bin.extend(v.to_le_bytes()));
    let mesh = read_mesh(json(42).as_bytes(), &mut |_, _| Ok(bin.clone())).expect("glTF");
    assert_eq!(mesh.positions, [DVec3::new(0., 0., 5.), DVec3::new(2., 0., 5.), DVec3::new(0., 2., 5.)]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert!(read_mesh(json(42).as_bytes(), &mut |_, _| Ok(vec![0; 40])).is_err());
    assert!(read_mesh(json(42).as_bytes(), &mut no_file).is_err());
    bin[40] = 9;
    assert!(read_mesh(json(42).as_bytes(), &mut |_, _| Ok(bin.clone())).is_err(), "an index beyond the vertices");
}

#[test]
fn broken_meshes_are_errors() {
    for text in [
        "",
        "v 1 2\n",
        "v 0 0 0\nf 1 2 3\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n",
        "v 0 0 nan\nv 0 0 0\nv 1 0 0\nf 1 2 3",
        "ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n",
        "{\"asset\":{}}",
        "glTF",
    ] {
        assert!(read_mesh(text.as_bytes(), &mut no_file).is_err(), "{text}");
    }
}
