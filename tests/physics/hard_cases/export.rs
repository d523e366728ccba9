//! Relight under hard lights, and the files that come of it, in memory.

use super::mesh;
use super::solve::Solved;
use glam::{DVec3, Vec3};
use isolume::export::gltf::GltfOptions;
use isolume::export::ply::PlyOptions;
use isolume::export::{ExportMesh, Positions, gltf as glb, ply};
use isolume::geom::Up;
use isolume::level::{LevelField, Pyramid};
use isolume::probe::{LatLong, Orientation, Probe, by_name};
use isolume::relight::{Exposure, Light, Material, Textures, contract, prepare};
use isolume::sh::certified::bounds;
use isolume::sh::{Coefficients, Window};
use isolume::surface::{Mesh, extract, extract_with_normals};
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{BrickSource, Layers};
use isolume::volume::{Sample, SamplesView, Volume};

/// A light by its coefficients in world axes.
pub struct Lit {
    pub name: &'static str,
    light: Light,
    /// Least and largest radiance, and what rounding may add, by channel.
    limits: [[f64; 3]; 3],
}

impl Lit {
    fn new(name: &'static str, channels: &[Coefficients; 3], certified: bool) -> Self {
        let window = if certified { Window::Certified } else { Window::None };
        let layers = Layers::uniform(3, 3).unwrap();
        let light = prepare(channels, &layers, window).unwrap().light;
        let limits = std::array::from_fn(|c| {
            let values = light.coefficients(0).iter().map(|v| v[c]).collect();
            let channel = Coefficients::new(light.bands(0), values).unwrap();
            let (low, high) = bounds(&channel);
            let slack = (2f64.powi(-10) + 32.0 * 2f64.powi(-24)) * reach(&channel);
            [if certified { 0.0 } else { low.min(0.0) }, high.max(0.0), slack]
        });
        Self { name, light, limits }
    }
}

/// Lights that break relighters: nothing, everything, a point of 1e6, skies by formula.
pub fn lights() -> Vec<Lit> {
    let mut pixels = vec![[0.0; 3]; 16 * 8];
    pixels[37] = [1e6, 5e5, 0.0];
    let point = Probe::from_image("point", LatLong::new(16, 8, pixels).unwrap());
    let one = Probe::from_image("one pixel", LatLong::new(1, 1, vec![[2.0, 1.0, 0.5]]).unwrap());
    let black = Probe::from_image("black", LatLong::new(2, 1, vec![[0.0; 3]; 2]).unwrap());
    let orientation = Orientation::new(Up::Z, 30.0).unwrap();
    let of = |name, probe: &Probe, certified| Lit::new(name, &probe.coefficients_in_world(3, orientation), certified);
    let named = |name| of(name, &by_name(name).unwrap().unwrap(), true);
    vec![
        of("one texel of 1e6", &point, true),
        of("one texel of 1e6, ringing", &point, false),
        of("one pixel", &one, true),
        of("black", &black, true),
        named("constant"),
        named("overcast"),
        named("sun:45,30"),
    ]
}

/// Σ_i max|Y_i| |L_i| of a light: what a transfer of unit weight can make of it. |Y_lm| ≤ sqrt((2l+1)/4π).
fn reach(channel: &Coefficients) -> f64 {
    (0..channel.bands())
        .map(|l| {
            let most = ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI)).sqrt();
            most * channel.band(l).iter().map(|v| v.abs()).sum::<f64>()
        })
        .sum()
}

/// Lights the surface of a positive bake by every light at albedo 0, 0.7 and 1, judges the radiance, and
/// writes GLB and PLY into memory.
pub fn check(volume: &Volume, solved: &Solved, isovalue: f64, lights: &[Lit], what: &str) {
    let surface = with_normals(volume, isovalue);
    assert_eq!(surface.positions_in_grid, extract(volume, isovalue).unwrap().positions_in_grid, "{what}");
    let layout = solved.texture.layout();
    let bricks = texels_of_isosurface(volume, layout.lattice, isovalue).bricks();
    for light in lights {
        for albedo in [0.0f32, 0.7, 1.0] {
            let what = format!("{what}, {}, albedo {albedo}", light.name);
            let material = Material::new([albedo, 0.5 * albedo, albedo], [0.0; 3]).unwrap();
            let (radiance, limits) = relight(solved, &bricks, &surface, light, &material);
            for (c, (low, high)) in limits.into_iter().enumerate() {
                for r in &radiance {
                    assert!(f64::from(r[c]) >= low && f64::from(r[c]) <= high, "{what}: {} not in {low}…{high}", r[c]);
                }
            }
            if light.name == "black" || albedo == 0.0 {
                assert!(radiance.iter().all(|r| *r == [0.0; 3]), "{what}");
            }
            if albedo == 0.7 {
                write_both(volume, &surface, &radiance, &what);
            }
        }
    }
}

/// Radiance at the vertices, and the least and largest that it may be, by channel.
///
/// A positive bake is T_k = Σ_j w_j Y(ω_j) with w ≥ 0 and Σ w = a_k, so ⟨T_k, L⟩ lies between a_k min L and
/// a_k max L, and Σ_k a_k ≤ 1 with the tail included; min and max over the sphere are bounded by
/// `certified::bounds`. Storage in f16 adds 2⁻¹¹ of each |T_i L_i| (2⁻²⁴ where f16 is subnormal, lent to the tail up
/// to 16 times, the least a_K of 16 rays), f32 as much again at most; |T_i| ≤ a_k max|Y_i|. The fallback for vertices
/// without texels is ⟨cosine, L⟩, within the same bounds.
fn relight(
    solved: &Solved,
    bricks: &[[usize; 3]],
    surface: &Mesh,
    light: &Lit,
    material: &Material,
) -> (Vec<[f32; 3]>, [(f64, f64); 3]) {
    let contracted = contract(&Textures::of_volume(&solved.texture).unwrap(), bricks, &light.light, material).unwrap();
    let lit = contracted.look_up(&surface.positions_in_grid, &surface.normals, &light.light, material);
    assert_eq!((lit.report.lookups, lit.report.unbaked), (surface.positions_in_grid.len() as u64, 0));
    assert!(contracted.look_up_errors(&surface.positions_in_grid).iter().all(|e| e.is_finite() && *e >= 0.0));
    assert!(contracted.noise.relative().is_finite());
    let limits = std::array::from_fn(|c| {
        let ([low, high, slack], albedo) = (light.limits[c], f64::from(material.albedo[c]));
        (albedo * low - slack, albedo * high + slack)
    });
    (lit.radiance, limits)
}

/// The surface with normals of the field, as the program makes it.
fn with_normals(volume: &Volume, isovalue: f64) -> Mesh {
    fn run<T: Sample>(volume: &Volume, samples: &[T], isovalue: f64) -> Mesh {
        let pyramid = Pyramid::new(volume);
        let field = LevelField::new(volume, samples, &pyramid);
        extract_with_normals(volume, isovalue, &|p| {
            field.normal(&field.locate(p.map(f64::from))).map_or([0.0; 3], |n| n.vec().to_array())
        })
        .unwrap()
    }
    match volume.samples().view() {
        SamplesView::U8(s) => run(volume, s, isovalue),
        SamplesView::I8(s) => run(volume, s, isovalue),
        SamplesView::U16(s) => run(volume, s, isovalue),
        SamplesView::I16(s) => run(volume, s, isovalue),
        SamplesView::F32(s) => run(volume, s, isovalue),
    }
}

/// Writes a surface as GLB and PLY and reads the counts back. Refused by name where the place is beyond f32.
fn write_both(volume: &Volume, surface: &Mesh, radiance: &[[f32; 3]], what: &str) {
    let world = |p: &[f32; 3]| volume.world_from_grid().point(DVec3::from_array(p.map(f64::from)));
    let positions: Vec<DVec3> = surface.positions_in_grid.iter().map(world).collect();
    let normals: Vec<Vec3> = surface.normals.iter().map(|&n| n.into()).collect();
    let factor = Exposure::Percentile.factor(radiance);
    assert!(factor.is_finite() && factor > 0.0, "{what}: exposure {factor}");
    let colours = Exposure::apply(factor, radiance);
    let export = ExportMesh {
        name: "case",
        positions: Positions::World(&positions),
        normals_in_world: &normals,
        triangles: &surface.triangles,
        colours: &colours,
        radiance: Some(radiance),
        standard_error: None,
        box_in_world: volume.world_bounds(),
        up: volume.up,
        metres_per_unit: None,
    };
    let mut file = Vec::new();
    if let Err(error) = glb::write(&mut file, &export, &GltfOptions::default()) {
        // Voxels of 1e40 or 1e-40 units: no position, or no scale, in f32.
        let error = error.to_string();
        let size = volume.world_bounds().size().max_element();
        assert!(!(1e-37..1e38).contains(&size), "{what}: {error}");
        assert!(error.contains("32 bits") || error.contains("scale"), "{what}: {error}");
        return;
    }
    let (vertices, triangles) = (positions.len(), surface.triangles.len());
    let read = ::gltf::Gltf::from_slice(&file).unwrap_or_else(|e| panic!("{what}: {e}"));
    let primitive = read.meshes().next().and_then(|m| m.primitives().next());
    assert_eq!(primitive.is_some(), triangles > 0, "{what}");
    if let Some(primitive) = primitive {
        assert_eq!(primitive.get(&::gltf::Semantic::Positions).unwrap().count(), vertices, "{what}");
        assert_eq!(primitive.indices().unwrap().count(), 3 * triangles, "{what}");
        let blob = read.blob.as_deref();
        let reader = primitive.reader(|_| blob);
        let inside = |p: [f32; 3]| p.iter().all(|v| v.is_finite());
        assert!(reader.read_positions().unwrap().all(inside), "{what}");
        let unit = |n: [f32; 3]| (Vec3::from(n).length() - 1.0).abs() < 1e-5;
        assert!(reader.read_normals().unwrap().all(unit), "{what}");
    }
    let mut file = Vec::new();
    ply::write(&mut file, &export, &PlyOptions::default()).unwrap_or_else(|e| panic!("{what}: {e}"));
    let head = String::from_utf8_lossy(&file[..file.len().min(2000)]).into_owned();
    assert!(head.contains(&format!("element vertex {vertices}\n")), "{what}: {head}");
    assert!(head.contains(&format!("element face {triangles}\n")), "{what}: {head}");
}

/// Writes the empty surface of a volume; returns how many vertices it had.
pub fn empty(volume: &Volume, what: &str) -> usize {
    let surface = mesh::check(volume, volume.value_range().1, what);
    write_both(volume, &surface, &[], what);
    surface.positions_in_grid.len()
}
