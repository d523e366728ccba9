use super::*;
use crate::export::test_mesh::TestMesh;
use glam::Vec2;

/// The corners of a triangle in the picture, in texels.
fn flat(map: &Lightmap, triangle: [u32; 3]) -> [Vec2; 3] {
    triangle.map(|v| Vec2::from_array(map.texture.coordinates[v as usize]) * map.report.side as f32)
}

#[test]
fn every_triangle_is_in_one_chart_and_keeps_its_orientation() {
    let torus = TestMesh::torus(20);
    let map = unwrap(&torus.mesh(), &torus.mesh(), 256).expect("room enough");
    let own = |t: &[u32; 3]| t.map(|v| map.selection.vertices[v as usize]);
    let mut found: Vec<[u32; 3]> = map.selection.triangles.iter().map(own).collect();
    let mut all = torus.triangles.clone();
    found.sort_unstable();
    all.sort_unstable();
    assert_eq!(found, all);
    assert!(map.texture.coordinates.iter().flatten().all(|c| (0.0..=1.0).contains(c)));
    // From the top left a surface seen from its lit side turns the other way round in all charts alike.
    let turns = map.selection.triangles.iter().map(|&t| {
        let [a, b, c] = flat(&map, t);
        (b - a).perp_dot(c - a)
    });
    let turns: Vec<f32> = turns.collect();
    assert!(turns.iter().all(|&t| t * turns[0] > 0.0));
    assert!(map.report.charts < 80 && map.report.covered > 0.4, "{:?}", map.report);
}

#[test]
fn no_two_triangles_share_a_texel_and_charts_keep_their_distance() {
    let torus = TestMesh::torus(20);
    let map = unwrap(&torus.mesh(), &torus.mesh(), 300).expect("room enough");
    let side = map.report.side as usize;
    // Ten places a texel along each axis would be exact; one and a tolerance are quick.
    let mut owner: Vec<Option<usize>> = vec![None; side * side];
    for (number, &t) in map.selection.triangles.iter().enumerate() {
        let [a, b, c] = flat(&map, t);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        for y in low.y as usize..=(high.y as usize).min(side - 1) {
            for x in low.x as usize..=(high.x as usize).min(side - 1) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let edges = [(a, b), (b, c), (c, a)];
                let turn = (b - a).perp_dot(c - a).signum();
                // Inside by more than a tenth of a texel.
                if edges.iter().all(|(from, to)| turn * (*to - *from).perp_dot(p - *from) > 0.1 * from.distance(*to)) {
                    assert_eq!(owner[y * side + x].replace(number), None, "texel ({x}, {y})");
                }
            }
        }
    }
}

#[test]
fn the_picture_has_the_colours_of_the_vertices() {
    let torus = TestMesh::torus(24);
    let map = unwrap(&torus.mesh(), &torus.mesh(), 512).expect("room enough");
    assert!(map.report.colour_rms < 0.004, "{:?}", map.report);
    // Read back from the file, at the vertices: 8 bits, and linear interpolation between texels.
    let picture = image::load_from_memory(&map.texture.png).expect("a PNG").to_rgb8();
    let texels = picture.pixels().map(|p| p.0.map(srgb::linear_from_byte)).collect::<Vec<_>>();
    let picture = Image::from_rgb(512, 512, &texels).expect("a picture");
    for (&v, &place) in map.selection.vertices.iter().zip(&map.texture.coordinates) {
        let (seen, own) = (sample(&picture, place), torus.colours[v as usize]);
        assert!(seen.iter().zip(own).all(|(a, b)| (a - b).abs() < 0.04), "{seen:?}, not {own:?}");
    }
}

#[test]
fn both_sides_of_a_seam_have_one_colour() {
    // Colours that change from vertex to vertex, some texels apart.
    let mut torus = TestMesh::torus(20);
    let value = |v: u32, c: u32| crate::sampling::hash::uniform(3, u64::from(v), c, 0);
    torus.colours = (0..torus.positions.len() as u32).map(|v| [0, 1, 2].map(|c| value(v, c))).collect();
    let map = unwrap(&torus.mesh(), &torus.mesh(), 512).expect("room enough");
    assert!(map.report.charts > 4 && map.report.seams < 3.0 / 255.0, "{:?}", map.report);
}

#[cfg(feature = "meshopt")]
#[test]
fn a_simpler_mesh_keeps_the_shading_of_the_original() {
    use crate::export::simplify::{Lod, simplify};
    let stripes = |x: f64, _: f64| [if (8.0 * x) as i32 % 2 == 0 { 0.1 } else { 0.7 }; 3];
    let sheet = TestMesh::sheet(64, |_, _| 0.0, stripes);
    let flat = TestMesh { colours: vec![[0.5; 3]; sheet.colours.len()], ..TestMesh::sheet(64, |_, _| 0.0, stripes) };
    // Simplified as if it had one colour, then coloured by the stripes.
    let left = simplify(&flat.mesh(), Lod::Share(0.1)).expect("a sound mesh");
    let attributes = left.selection.attributes(&sheet.mesh());
    let shown = attributes.mesh(&sheet.mesh());
    let map = unwrap(&shown, &sheet.mesh(), 256).expect("room enough");
    let picture = image::load_from_memory(&map.texture.png).expect("a PNG").to_rgb8();
    let texels = picture.pixels().map(|p| p.0.map(srgb::linear_from_byte)).collect::<Vec<_>>();
    let picture = Image::from_rgb(256, 256, &texels).expect("a picture");
    let centre = shown.centre_in_world();
    let mut seen = 0;
    for t in &map.selection.triangles {
        for weights in [[0.5, 0.3, 0.2], [0.1, 0.6, 0.3], [0.2, 0.1, 0.7]] {
            let mix =
                |of: &dyn Fn(usize) -> f32| -> f32 { t.iter().zip(weights).map(|(&v, w)| w * of(v as usize)).sum() };
            let x = mix(&|v| shown.positions.in_world(map.selection.vertices[v] as usize, centre).x as f32);
            let place = [0, 1].map(|a| mix(&|v| map.texture.coordinates[v][a]));
            // Not within a voxel and a texel of an edge of a stripe.
            if (8.0 * x - (8.0 * x).round()).abs() > 0.25 {
                let expected = stripes(f64::from(x), 0.0)[0];
                let found = sample(&picture, place)[0];
                assert!((found - expected).abs() < 0.02, "at {x}: {found}, not {expected}");
                seen += 1;
            }
        }
    }
    assert!(seen > 100);
}

#[test]
fn what_cannot_be_unwrapped_is_refused() {
    let torus = TestMesh::torus(8);
    for (side, expected) in [(63, "64 to 8192"), (8193, "64 to 8192")] {
        let message = unwrap(&torus.mesh(), &torus.mesh(), side).expect_err("a side out of range").to_string();
        assert!(message.contains(expected), "{message}");
    }
    let none = ExportMesh { triangles: &[], ..torus.mesh() };
    assert!(unwrap(&none, &none, 64).expect_err("no triangles").to_string().contains("without triangles"));
    // Triangles apart from each other: a chart each, of at least six texels a side.
    let corners: Vec<u32> = (0..torus.triangles.len() as u32).collect();
    let apart = TestMesh {
        positions: torus.triangles.iter().flatten().map(|&v| torus.positions[v as usize]).collect(),
        normals: torus.triangles.iter().flatten().map(|&v| torus.normals[v as usize]).collect(),
        colours: torus.triangles.iter().flatten().map(|&v| torus.colours[v as usize]).collect(),
        triangles: corners.iter().map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    };
    let message = unwrap(&apart.mesh(), &apart.mesh(), 64).expect_err("too many charts").to_string();
    assert!(message.contains("larger --lightmap"), "{message}");
}
