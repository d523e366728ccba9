//! Several volumes that light each other, and points of light in mirrors: against one volume that holds both, against closed
//! forms, and against each alone.

#[allow(dead_code, reason = "each test uses what it needs")]
#[path = "common/program.rs"]
mod program;

use glam::{DMat3, DVec3};
use isolume::geom::Bounds;
use isolume::level::Pyramid;
use isolume::relight::{Contracted, Light, LookupReport, LuminaireLight, Material, Textures, contract};
use isolume::sampling::statistics::{Running, normal_two_sided, rms, sidak};
use isolume::scene::geometry::{Among, Finish, Geometry, Luminaire, LuminaireShape, Partner, Shape, Wall};
use isolume::scene::{Coupled, Coupling};
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{BRICK, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, validity};
use isolume::transport::{
    Progress, SceneBake, SceneCounts, SceneReference, SceneSettings, bake_scene, scene_radiance, trace_photons,
};
use isolume::volume::field::{Field, by_name, sample};
use isolume::volume::{Samples, Volume};
use program::Bench;
use std::f64::consts::PI;
use std::sync::Arc;

/// A volume lit among others: its textures in memory.
struct Baked {
    volume: Volume,
    textures: Vec<MemoryTexture>,
    exponents: Vec<i32>,
    selection: Selection,
    counts: SceneCounts,
}

const WHITE: [f32; 3] = [1.0; 3];

/// A geometry in which `own` stands beside `others`, coupled.
fn among(own: &Volume, others: &[&Volume], coupling: &Coupling, tint: [f32; 3], around: Geometry) -> Geometry {
    let coupled = |volume: &&Volume| Coupled { name: volume.name.clone(), range: volume.value_range() };
    let volumes: Vec<Coupled> = [own].iter().chain(others).map(coupled).collect();
    coupling.check(&volumes).expect("a coupling");
    let partner = |(i, volume): (usize, &&Volume)| Partner {
        name: volume.name.clone(),
        volume: Arc::new((*volume).clone()),
        pyramid: Arc::new(Pyramid::new(volume)),
        isovalue: coupling.between(&volumes, 0, i + 1),
        tint: WHITE,
    };
    let partners = others.iter().enumerate().map(partner).collect();
    let name = own.name.clone();
    around.with_partners(Among { name, place: 0, coupling: coupling.describe(), tint }, partners).expect("partners")
}

fn nothing() -> Geometry {
    Geometry::new(Vec::new(), Vec::new(), 1.0).expect("nothing")
}

fn baked(volume: &Volume, geometry: &Geometry, isovalues: &[f64], rays: u32, layers: usize) -> Baked {
    let layers = Layers::uniform(layers, 2).expect("layers").coloured();
    let layout =
        Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).expect("a lattice"), layers: layers.clone() };
    let settings = SceneSettings { layers, rays, seed: 5, caustics: true };
    let mut selection = Selection::empty(layout.lattice);
    isovalues.iter().for_each(|&c| selection.insert_all(&texels_of_isosurface(volume, layout.lattice, c)));
    let pyramid = Pyramid::new(volume);
    let (layout, settings, selection) = (&layout, &settings, &selection);
    let request = SceneBake { volume, pyramid: &pyramid, geometry, layout, settings, selection };
    let mut textures: Vec<MemoryTexture> =
        request.groups().iter().map(|g| MemoryTexture::new(g.layout(layout).expect("a layout"))).collect();
    let [cx, cy, cz] = layout.lattice.chunks();
    let chunks: Vec<[usize; 3]> = (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]).collect();
    let summary = bake_scene(&request, &chunks, &Progress::default(), &|_| Ok(None), &mut |chunk, groups| {
        textures.iter_mut().zip(groups).try_for_each(|(texture, bricks)| texture.insert_chunk(chunk, bricks))
    })
    .expect("a bake");
    let (exponents, counts) = (request.geometry.exponents(request.volume), summary.counts);
    Baked { volume: volume.clone(), textures, exponents, selection: selection.clone(), counts }
}

impl Baked {
    /// Everything but the validity of what was not asked, as bits: NaN marks what is not baked.
    fn bits(&self) -> Vec<u16> {
        let bricks = || self.selection.bricks().into_iter();
        let all = self.textures.iter().flat_map(|t| bricks().map(move |b| (t, b)));
        all.flat_map(|(texture, index)| {
            let view = texture.brick(index).expect("a brick").expect("baked");
            view.transfer.iter().chain(view.stderr).map(|v| v.to_bits()).collect::<Vec<_>>()
        })
        .collect()
    }

    fn texels(&self) -> impl Iterator<Item = [usize; 3]> {
        let [nx, ny, nz] = self.volume.dims();
        (0..nx * ny * nz).map(move |i| [i % nx, i / nx % ny, i / nx / ny]).filter(|t| self.selection.contains(*t))
    }

    /// The coefficients of a texel in a group; `None` where it is not valid.
    fn at(&self, group: usize, texel: [usize; 3]) -> Option<Vec<f64>> {
        let texture = &self.textures[group];
        let view = texture.brick(texel.map(|i| i / BRICK)).expect("a brick")?;
        let [x, y, z] = texel.map(|i| i % BRICK);
        let t = x + BRICK * (y + BRICK * z);
        let n = texture.layout().layers.coefficients();
        let valid = view.validity[t] & validity::VALID != 0;
        valid.then(|| view.transfer[t * n..(t + 1) * n].iter().map(|v| f64::from(v.to_f32())).collect())
    }

    /// The standard error of the first layer of a texel in a group of one band.
    fn error(&self, group: usize, texel: [usize; 3]) -> f64 {
        let texture = &self.textures[group];
        let view = texture.brick(texel.map(|i| i / BRICK)).expect("a brick").expect("baked");
        let [x, y, z] = texel.map(|i| i % BRICK);
        f64::from(view.stderr[(x + BRICK * (y + BRICK * z)) * texture.layout().layers.errors()].to_f32())
    }

    fn lit(&self, light: &Light, material: &Material) -> Contracted {
        let luminaires: Vec<LuminaireLight<'_>> = self.textures[2..]
            .iter()
            .zip(&self.exponents)
            .map(|(texture, &e)| LuminaireLight { texture, factor: [f64::from(e).exp2(); 3] })
            .collect();
        let bricks = self.selection.bricks();
        let textures = Textures::of_scene(&self.textures[0], &self.textures[1], &luminaires).expect("textures");
        contract(&textures, &bricks, light, material).expect("in memory")
    }
}

/// Radiance of a texel.
fn of_texel(contracted: &Contracted, texel: [usize; 3]) -> f64 {
    let black = Material::new([0.0; 3], [0.0; 3]).expect("black");
    let mut report = LookupReport::default();
    let dark = Light::constant([0.0; 3]);
    f64::from(contracted.radiance_at(texel.map(|i| i as f32), [0.0, 0.0, 1.0], &dark, &black, &mut report)[0])
}

fn field(name: &str) -> Volume {
    by_name(name).expect("a field").expect("a field").sample().expect("a volume")
}

/// ±(z − z₀) on the unit square around z₀: the level set 0 is the square, lit from above where the sign is −, else from below.
struct Square {
    z: f64,
    sign: f64,
}

impl Field for Square {
    fn name(&self) -> &'static str {
        "square"
    }
    fn value(&self, p: DVec3) -> f64 {
        self.sign * (p.z - self.z)
    }
    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(0.0, 0.0, self.z - 0.25), max: DVec3::new(1.0, 1.0, self.z + 0.25) }
    }
    fn default_isovalue(&self) -> f64 {
        0.0
    }
}

fn square(name: &str, z: f64, sign: f64) -> Volume {
    let mut volume = sample(&Square { z, sign }, [17, 17, 5]).expect("a volume");
    volume.name = name.into();
    volume
}

/// A volume too far away to be met changes no bit; a factor of ½ on the albedo halves every number of the direct light.
#[test]
fn far_apart_each_is_alone() {
    let own = field("gyroid:13");
    let mut far = field("sphere:9").placed(DMat3::IDENTITY, DVec3::splat(1e9)).expect("far away");
    far.name = "far".into();
    let alone = baked(&own, &nothing(), &[0.0], 16, 3);
    for coupling in [Coupling::Normalised, Coupling::Equal, Coupling::Rows(vec![vec![0.0, -0.6]])] {
        let beside = baked(&own, &among(&own, &[&far], &coupling, WHITE, nothing()), &[0.0], 16, 3);
        assert!(beside.bits() == alone.bits(), "{coupling:?}");
        assert_eq!((beside.counts.partner_rays, beside.counts.partner_hits, beside.counts.buried), (0, 0, 0));
    }
    let tinted = baked(&own, &among(&own, &[&far], &Coupling::Normalised, [0.5; 3], nothing()), &[0.0], 16, 3);
    for texel in alone.texels() {
        let (Some(whole), Some(half)) = (alone.at(0, texel), tinted.at(0, texel)) else { continue };
        // Two bands in three channels, then the next layer, which has the factor twice. 16 bits: exact but for the smallest.
        for (i, (a, b)) in whole.iter().zip(half).enumerate() {
            let factor = [0.5, 0.25, 0.125][i / 12];
            assert!((b - factor * a).abs() <= 2f64.powi(-24), "{texel:?} {i}: {a} {b}");
        }
    }
}

/// A hollow ball cut in two, with air of two cells at the cut: the halves as two volumes are the one that holds both. Baked at
/// two isovalues; by symmetry the ranges are the same, so that equal isovalues and normalised ones are the same thing.
#[test]
fn two_half_bowls_are_the_volume_that_holds_both() {
    const N: usize = 25;
    let place = |i: usize| (i as f64 - 12.0) / 12.0;
    let value = |[x, y, z]: [usize; 3]| {
        let p = DVec3::new(place(x), place(y), place(z));
        let shell = 0.25 - (p.length() - 0.7).abs();
        (if x.abs_diff(12) <= 1 { shell.min(-0.4) } else { shell }) as f32
    };
    let part = |name: &str, from: usize, to: usize| {
        let dims = [to - from, N, N];
        let at = |i: usize| [from + i % dims[0], i / dims[0] % N, i / dims[0] / N];
        let samples = Samples::F32((0..dims.iter().product()).map(|i| value(at(i))).collect());
        let affine = isolume::geom::Affine::from_spacing(DVec3::splat(1.0 / 12.0), DVec3::new(place(from), -1.0, -1.0));
        let mut volume = Volume::new(dims, samples, affine.expect("an affine")).expect("a volume");
        volume.name = name.into();
        volume
    };
    let (whole, left, right) = (part("whole", 0, N), part("left", 0, 13), part("right", 12, N));
    let (isovalues, rays) = ([0.02, 0.1], 16);
    let reference = baked(&whole, &nothing(), &isovalues, rays, 3);
    let mut tests = Vec::new();
    for (own, other, shift) in [(&left, &right, 0), (&right, &left, 12)] {
        let alone = baked(own, &nothing(), &isovalues, rays, 3);
        for coupling in [Coupling::Normalised, Coupling::Equal] {
            let both = baked(own, &among(own, &[other], &coupling, WHITE, nothing()), &isovalues, rays, 3);
            assert!(both.counts.partner_hits > 10_000 && both.counts.buried == 0, "{:?}", both.counts);
            let (mut differences, mut of_alone) = (vec![Running::new(); 3], Running::new());
            for texel in both.texels() {
                let Some(expected) = reference.at(0, [texel[0] + shift, texel[1], texel[2]]) else { continue };
                let Some(found) = both.at(0, texel) else { continue };
                // The constant coefficient of each layer: a_k, the chance to escape.
                (0..3).for_each(|k| differences[k].push(found[12 * k] - expected[12 * k]));
                of_alone.extend_with(alone.at(0, texel).map(|v| v[0] - expected[0]));
            }
            for (k, difference) in differences.iter().enumerate() {
                assert!(difference.count() > 800, "{}", difference.count());
                tests.push((k, difference.mean() / difference.standard_error()));
            }
            // Without the other half there is more sky: the test would see it.
            assert!(of_alone.mean() > 20.0 * of_alone.standard_error(), "{}", of_alone.mean());
        }
    }
    let level = sidak(0.001, tests.len());
    assert!(tests.iter().all(|(_, z)| normal_two_sided(*z) > level), "{tests:?}");
}

trait ExtendWith {
    fn extend_with(&mut self, value: Option<f64>);
}

impl ExtendWith for Running {
    fn extend_with(&mut self, value: Option<f64>) {
        value.into_iter().for_each(|v| self.push(v));
    }
}

/// Form factor of a point with normal z to a rectangle [0, a] × [0, b] at height 1 above its corner.
fn corner_factor(a: f64, b: f64) -> f64 {
    let (x, y) = (a / (1.0 + a * a).sqrt(), b / (1.0 + b * b).sqrt());
    (x * (b / (1.0 + a * a).sqrt()).atan() + y * (a / (1.0 + b * b).sqrt()).atan()) / (2.0 * PI)
}

/// VALIDATION 16 with two level sets as the squares: each shines with radiance 1 and sees the other under the form factor of
/// a rectangle, in the mean 0.19982 both ways. Between a lamp and the lower one the upper one leaves nothing.
#[test]
fn facing_squares_are_two_level_sets() {
    let (low, high) = (square("low", 0.0, -1.0), square("high", 1.0, 1.0));
    let lamp = |z: f64| {
        let shape = LuminaireShape::Point { position: DVec3::new(0.5, 0.5, z) };
        let lamp = Luminaire { name: "bulb".into(), shape, power: [4.0 * PI; 3] };
        Geometry::new(Vec::new(), vec![lamp], 1.0).expect("a lamp")
    };
    for (own, other, above) in [(&low, &high, 2.0), (&high, &low, -1.0)] {
        let geometry = among(own, &[other], &Coupling::Normalised, WHITE, lamp(above));
        let scene = baked(own, &geometry, &[0.0], 1024, 1);
        let glows = Material::new([1.0; 3], [1.0; 3]).expect("a material");
        let lit = scene.lit(&Light::constant([0.0; 3]), &glows);
        let on_square: Vec<[usize; 3]> = scene.texels().filter(|t| t[2] == 2).collect();
        // Four replicates make a poor error of one texel: all together make a good one of all.
        let pooled = rms(on_square.iter().map(|t| scene.error(1, *t)));
        let (mut mean, mut weights, mut squares) = (0.0, 0.0, Running::new());
        for texel in &on_square {
            let [x, y] = [texel[0], texel[1]].map(|i| i as f64 / 16.0);
            let sides = [(x, y), (1.0 - x, y), (x, 1.0 - y), (1.0 - x, 1.0 - y)];
            let expected: f64 = sides.iter().map(|&(a, b)| corner_factor(a, b)).sum();
            // What is sent out, less what is its own; no light of the lamp.
            let found = of_texel(&lit, *texel) - 1.0;
            // 16 bits round by 2⁻¹¹.
            assert!(
                (found - expected).abs() < 6.0 * pooled + 5e-4 * expected,
                "{texel:?}: {found} {expected} {pooled}"
            );
            squares.push(((found - expected) / pooled).powi(2));
            let end = |i: usize| if i == 0 || i == 16 { 0.5 } else { 1.0 };
            mean += end(texel[0]) * end(texel[1]) * found;
            weights += end(texel[0]) * end(texel[1]);
            assert!(scene.at(2, *texel).expect("a texel").iter().all(|v| *v == 0.0), "{texel:?} sees the lamp");
        }
        assert!(squares.count() == 289 && (0.7..1.4).contains(&squares.mean()), "{}", squares.mean());
        // As in `scene_walls`: 3e-4 for the trapezoid rule; and the errors of 17² texels.
        assert!((mean / weights - 0.19982).abs() < 3e-4 + 4.0 * pooled / 17.0, "{}", mean / weights);
        // Alone the lamp is seen, by cosine over π and the square of the distance: Φ = 4π is an intensity of 1.
        let alone = baked(own, &lamp(above), &[0.0], 4, 1);
        let lit = alone.lit(&Light::constant([0.0; 3]), &Material::new([1.0; 3], [0.0; 3]).expect("white"));
        for texel in on_square {
            let [x, y] = [texel[0], texel[1]].map(|i| i as f64 / 16.0 - 0.5);
            let square = x * x + y * y + 4.0;
            let (expected, found) = (2.0 / (PI * square * square.sqrt()), of_texel(&lit, texel));
            assert!((found - expected).abs() < 1e-3 * expected, "{texel:?}: {found} {expected}");
        }
    }
}

/// A lamp in the middle between two black squares, which are faces of a cube around it: a third of its power ends on them.
/// A ray that meets the other volume sees it glow.
#[test]
fn photons_and_rays_meet_the_other_volume() {
    let (low, high) = (square("low", 0.0, -1.0), square("high", 1.0, 1.0));
    let shape = LuminaireShape::Point { position: DVec3::splat(0.5) };
    let lamp = Luminaire { name: "bulb".into(), shape, power: [1.0; 3] };
    let around = Geometry::new(Vec::new(), vec![lamp], 1.0).expect("a lamp");
    let geometry = among(&low, &[&high], &Coupling::Normalised, WHITE, around);
    let pyramid = Pyramid::new(&low);
    let photons = 1 << 14;
    let balance = trace_photons(&low, &pyramid, &geometry, 0.0, [0.0; 3], 0, photons, 3).expect("photons");
    let error = (1.0 / 3.0 * 2.0 / 3.0 / f64::from(photons)).sqrt();
    assert!((balance.in_level_set - 1.0 / 3.0).abs() < 4.0 * error, "{balance:?}");
    assert!((balance.sum() - 1.0).abs() < 1e-6, "{balance:?}");
    let settings = SceneReference {
        paths: 4,
        albedo: [0.0; 3],
        emission: [1.0, 2.0, 3.0],
        scales: Vec::new(),
        samples_luminaires: true,
        sees_through_backs: false,
        seed: 0,
    };
    let rays = [DVec3::Z, -DVec3::Z, DVec3::X].map(|direction| (DVec3::new(0.4, 0.6, 0.5), direction));
    let (seen, _) = scene_radiance(&low, &pyramid, &geometry, 0.0, &rays, None, &settings).expect("rays");
    let seen: Vec<Option<[f64; 3]>> = seen.into_iter().map(|s| s.map(|s| s.mean)).collect();
    assert_eq!(seen, [Some([1.0, 2.0, 3.0]), Some([1.0, 2.0, 3.0]), None]);
}

/// Two squares back to back: no ray of one comes to the other, and nothing of it is tried.
#[test]
fn what_cannot_be_seen_costs_nothing() {
    let (up, down) = (square("up", 0.0, -1.0), square("down", -1.0, 1.0));
    let geometry = among(&up, &[&down], &Coupling::Normalised, WHITE, nothing());
    let beside = baked(&up, &geometry, &[0.0], 64, 2);
    assert_eq!((beside.counts.partner_rays, beside.counts.partner_hits), (0, 0));
    assert!(beside.counts.path_rays > 0 && beside.bits() == baked(&up, &nothing(), &[0.0], 64, 2).bits());
}

/// A small sphere in the solid of a large one has no surface; a large one around it does not notice.
#[test]
fn what_is_buried_has_no_surface() {
    let mut small = field("sphere:9").placed(0.2 * DMat3::IDENTITY, DVec3::ZERO).expect("small");
    let mut large = field("sphere:9");
    (small.name, large.name) = ("small".into(), "large".into());
    // -0.6 is a radius of 0.6; both isovalues at once.
    let inside = baked(&small, &among(&small, &[&large], &Coupling::Normalised, WHITE, nothing()), &[-0.6], 4, 1);
    let selected = inside.texels().count() as u64;
    assert!(selected > 100 && inside.counts.buried == selected, "{:?} of {selected}", inside.counts);
    assert!(inside.texels().all(|t| inside.at(0, t).is_none()));
    let around = baked(&large, &among(&large, &[&small], &Coupling::Normalised, WHITE, nothing()), &[-0.6], 4, 1);
    assert!(around.counts.buried == 0 && around.bits() == baked(&large, &nothing(), &[-0.6], 4, 1).bits());
}

/// A point of light beside a mirror is two of them, one of which is as strong as the mirror; through two mirrors, three and
/// more. Parallel light likewise. Glass is refused by name.
#[test]
fn points_of_light_are_found_in_flat_mirrors() {
    let volume = square("floor", 0.0, -1.0);
    // Mirrors at x = 2 and x = −1, large enough for all that is asked.
    let mirror = |name: &str, x: f64, share: f32| Wall {
        name: name.into(),
        shape: Shape::Rectangle {
            corner: DVec3::new(x, -20.0, 0.05),
            u: DVec3::new(0.0, 40.0, 0.0),
            v: DVec3::new(0.0, 0.0, 40.0),
        },
        finish: Finish::Mirror([share; 3]),
    };
    let position = DVec3::new(1.2, 0.4, 1.5);
    let point = Luminaire { name: "bulb".into(), shape: LuminaireShape::Point { position }, power: [4.0 * PI; 3] };
    let towards = DVec3::new(-2.0, 0.0, 1.0);
    let sun = Luminaire { name: "sun".into(), shape: LuminaireShape::Directional { towards }, power: [1.0; 3] };
    let white = Material::new([1.0; 3], [0.0; 3]).expect("white");
    let lit = |walls: Vec<Wall>, lamp: &Luminaire| {
        let geometry = Geometry::new(walls, vec![lamp.clone()], 1.0).expect("mirrors");
        let scene = baked(&volume, &geometry, &[0.0], 4, 1);
        let contracted = scene.lit(&Light::constant([0.0; 3]), &white);
        let on_square: Vec<[usize; 3]> = scene.texels().filter(|t| t[2] == 2).collect();
        let found: Vec<(DVec3, f64)> = on_square
            .iter()
            .map(|t| (DVec3::new(t[0] as f64 / 16.0, t[1] as f64 / 16.0, 0.0), of_texel(&contracted, *t)))
            .collect();
        (found, scene.counts)
    };
    let from = |lamp: DVec3, at: DVec3| {
        let way = lamp - at;
        way.z / (PI * way.length().powi(3))
    };
    let image = |lamp: DVec3, x: f64| DVec3::new(2.0 * x - lamp.x, lamp.y, lamp.z);
    // The feet of the mirrors are low enough that every texel sees all images.
    let (found, counts) = lit(vec![mirror("right", 2.0, 0.5)], &point);
    assert!(counts.specular_hits >= 4 * 289);
    for (at, value) in found {
        let expected = from(position, at) + 0.5 * from(image(position, 2.0), at);
        assert!((value - expected).abs() < 1e-3 * expected, "{at}: {value} {expected}");
    }
    let (right, left) = (image(position, 2.0), image(position, -1.0));
    let (found, _) = lit(vec![mirror("right", 2.0, 0.5), mirror("left", -1.0, 0.8)], &point);
    for (at, value) in found {
        let two = 0.4 * (from(image(right, -1.0), at) + from(image(left, 2.0), at));
        let three = 0.2 * from(image(image(right, -1.0), 2.0), at) + 0.32 * from(image(image(left, 2.0), -1.0), at);
        let expected = from(position, at) + 0.5 * from(right, at) + 0.8 * from(left, at) + two + three;
        assert!((value - expected).abs() < 1e-3 * expected, "{at}: {value} {expected}");
    }
    // Light that goes to +x and down: straight, and back from the mirror at x = 2.
    let (found, _) = lit(vec![mirror("right", 2.0, 0.5)], &sun);
    let cosine = 1.0 / 5f64.sqrt();
    for (at, value) in found {
        let expected = 1.5 * cosine / PI;
        assert!((value - expected).abs() < 1e-3 * expected, "{at}: {value} {expected}");
    }
    let ball = Wall {
        name: "ball".into(),
        shape: Shape::Sphere { centre: DVec3::new(0.5, 0.5, 0.6), radius: 0.2 },
        finish: Finish::Glass(1.5),
    };
    let geometry = Geometry::new(vec![ball, mirror("right", 2.0, 0.5)], vec![point, sun], 1.0).expect("glass");
    assert_eq!(isolume::transport::needs_photons(&geometry), ["bulb", "sun"]);
}

const PAIR: &str = "coupling = COUPLING\n[[volumes]]\nname = \"bumps\"\nvolume = \"bumpbox:12\"\n\
    [[volumes]]\nname = \"gyroid\"\nvolume = \"gyroid:9\"\nscale = 0.3\ntranslate = [0.35, 0.08, 0.35]\nalbedo = [0.5, 0.5, 1]\n\
    [bake]\nrays = 8\nlayers = 2\nbands = 2\n[probe]\nname = \"sky\"\n[camera]\nsize = [24, 24]\nexposure = 0\n";

/// The same pair with the volumes in the other order.
fn swapped(coupling: &str) -> String {
    let text = PAIR.replace("COUPLING", coupling);
    let tables: Vec<&str> = text.split("[[volumes]]\n").collect();
    let (second, rest) = tables[2].split_once("[bake]").expect("a bake");
    format!("{}[[volumes]]\n{second}[[volumes]]\n{}[bake]{rest}", tables[0], tables[1])
}

/// `_RADIANCE` of a PLY file, in order.
fn radiance(bytes: &[u8]) -> Vec<u8> {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
    let header = String::from_utf8_lossy(&bytes[..at]).into_owned();
    let mut sizes = header.lines().skip_while(|l| !l.starts_with("element vertex")).map(str::to_string);
    let count: usize = sizes.next().expect("vertices")["element vertex ".len()..].trim().parse().expect("a number");
    let properties: Vec<(usize, bool)> = sizes
        .take_while(|l| l.starts_with("property"))
        .map(|l| (if l.contains("uchar") || l.contains("uint8") { 1 } else { 4 }, l.contains("radiance")))
        .collect();
    let stride: usize = properties.iter().map(|p| p.0).sum();
    let first: usize = properties.iter().take_while(|p| !p.1).map(|p| p.0).sum();
    (0..count).flat_map(|i| bytes[at + i * stride + first..][..12].to_vec()).collect()
}

#[test]
fn a_pair_is_baked_into_one_store_and_lit_together() {
    let bench = Bench::new();
    bench.write("pair.toml", PAIR.replace("COUPLING", "[[47, 0.6]]"));
    let plan = bench.json("plan pair.toml");
    for (volume, other) in [(0, "gyroid"), (1, "bumps")] {
        let rows = plan["volumes"][volume]["effects"].as_array().expect("rows").clone();
        let row = rows.iter().find(|e| e["name"] == "coupling").expect("a row");
        assert!(row["on"] == true && row["setting"].as_str().is_some_and(|s| s.contains("chosen pair")), "{row}");
        assert!(row["reason"].as_str().is_some_and(|s| s.contains(other)), "{row}");
    }
    let bake = bench.json("bake pair.toml -o pair.isolume");
    for volume in [0, 1] {
        let effects = &bake["volumes"][volume]["bake"]["effects"];
        assert!(effects["coupling"]["hits"].as_u64() > Some(0), "{effects}");
        assert_eq!((effects["walls"]["rays"].as_u64(), effects["luminaires"]["rays"].as_u64()), (Some(0), Some(0)));
    }
    let of = |name: &str| bake["volumes"][usize::from(name == "gyroid")]["identity"]["scene"]["coupling"].clone();
    assert_eq!(of("bumps")["partners"][0]["isovalues"], serde_json::json!([[47.0, 0.6]]));
    assert_eq!(of("gyroid")["partners"][0]["isovalues"], serde_json::json!([[0.6, 47.0]]));
    for place in ["volumes/bumps/data", "volumes/gyroid/data", "transfer/bumps/env", "transfer/gyroid/emission"] {
        assert!(bench.path("pair.isolume").join(place).join("zarr.json").is_file(), "{place}");
    }
    // Both together are each of them, one behind the other; named by either isovalue.
    let line = "relight pair.isolume --env sky --exposure 0 --radiance";
    assert_eq!(bench.json(&format!("{line} --isovalue 47 -o both.ply"))["transport_rays"], 0);
    bench.run(&format!("{line} --isovalue gyroid=0.6 -o same.ply -o both.glb -o both.png --size 24x24"));
    bench.run(&format!("{line} --volume bumps --isovalue 47 -o bumps.ply"));
    bench.run(&format!("{line} --volume gyroid --isovalue 0.6 -o gyroid.ply"));
    let [both, same, bumps, gyroid] =
        ["both", "same", "bumps", "gyroid"].map(|n| radiance(&bench.bytes(&format!("{n}.ply"))));
    assert!(both == [bumps, gyroid].concat() && both == same && !both.is_empty());
    for name in ["bumps", "gyroid"] {
        bench.run(&format!("export pair.isolume --volume {name} --env sky -o {name}.nrrd"));
    }
    // Baked again nothing is done; the scene lights the same surfaces by itself.
    let again = bench.json("bake pair.toml -o pair.isolume");
    assert!((0..2).all(|v| again["volumes"][v]["bake"]["chunks"]["baked"] == 0), "{again}");
    bench.run("relight pair.toml --cache c --radiance -o scene.ply");
    assert!(radiance(&bench.bytes("scene.ply")) == both);
    for (line, words) in [
        ("relight pair.isolume --env sky -o x.glb --isovalue 48", "bumps=48, which has no partner in gyroid"),
        ("relight pair.isolume --env sky -o x.glb --isovalue gyrod=0.6", "did you mean gyroid?"),
        ("relight pair.isolume --env sky -o x.glb --isovalue 47 --volume gyrod", "one of bumps, gyroid"),
        ("relight pair.toml --cache c -o x.glb --isovalue 50", "bumps=50, which has no partner"),
        ("relight bumpbox:12 --cache c --env sky -o x.glb --isovalue bumps=47", "one volume alone"),
        ("relight bumpbox:12 --cache c --env sky -o x.glb --isovalue 47 --volume bumps", "one volume alone"),
        ("bake pair.toml --chunks 1/2 -o x.isolume", "a scene of one volume"),
        ("bake pair.toml --isovalues 48 -o x.isolume", "bumps=48, which has no partner"),
    ] {
        let text = bench.refuses(line);
        assert!(text.contains(words), "{line}: {text}");
    }
    // Another pair is another store.
    bench.write("pair.toml", PAIR.replace("COUPLING", "[[60, 0.6]]"));
    assert!(bench.refuses("bake pair.toml -o pair.isolume").contains("coupling"));
}

/// Root and description of the second volume are lost: the first restores the one, the second the other, and no chunk is
/// computed again.
#[test]
fn lost_metadata_of_several_volumes_comes_back() {
    let bench = Bench::new();
    bench.write("a.toml", PAIR.replace("COUPLING", "[[47, 0.6]]"));
    bench.run("bake a.toml -o a.isolume");
    let names = ["zarr.json", "transfer/gyroid/env/zarr.json", "volumes/gyroid/data/zarr.json", "volumes/zarr.json"];
    let before = names.map(|name| bench.bytes(&format!("a.isolume/{name}")));
    for lost in [&names[..1], &names[..2], &names[1..], &names[..]] {
        lost.iter().for_each(|name| std::fs::remove_file(bench.path(&format!("a.isolume/{name}"))).expect("removed"));
        let again = bench.json("bake a.toml -o a.isolume");
        let volumes = again["volumes"].as_array().expect("two volumes");
        assert!(volumes.iter().all(|v| v["bake"]["chunks"]["baked"] == 0), "{lost:?}: {again:#}");
        assert!(names.map(|name| bench.bytes(&format!("a.isolume/{name}"))) == before, "{lost:?}");
    }
}

#[test]
fn the_order_of_volumes_does_not_matter() {
    let bench = Bench::new();
    // What is baked, without the stamp before the index: that of the store, which names the volumes in their order.
    let shard = |store: &str, name: &str| {
        let mut bytes = bench.bytes(&format!("{store}/transfer/{name}/env/transfer/c/0/0/0/0"));
        let index = bytes.len() - (64 * 16 + 4);
        bytes.drain(index - 16..index);
        bytes
    };
    for (coupling, other) in [("[[47, 0.6]]", "[[0.6, 47]]"), ("\"normalised\"", "\"normalised\"")] {
        bench.write("a.toml", PAIR.replace("COUPLING", coupling));
        bench.write("b.toml", swapped(other));
        // 40 % of either range is the same pair; rounding may differ by a bit where it goes back and forth.
        let line = if coupling.starts_with('[') { "" } else { "--isovalues 40%" };
        bench.run(&format!("bake a.toml {line} -o a.isolume --force"));
        bench.run(&format!("bake b.toml {line} -o b.isolume --force"));
        for name in ["bumps", "gyroid"] {
            assert!(shard("a.isolume", name) == shard("b.isolume", name), "{coupling} {name}");
        }
    }
}

#[test]
fn mistakes_in_pairs_name_file_and_line() {
    let bench = Bench::new();
    let pair = |coupling: &str| PAIR.replace("COUPLING", coupling);
    let one = "coupling = \"equal\"\n[[volumes]]\nvolume = \"bumpbox:8\"\n".to_string();
    let cases: [(String, &str, &str); 14] = [
        (one, "s.toml:2:", "two to 8 volumes (found 1)"),
        (pair("\"normalized\""), "s.toml:1:", "did you mean normalised?"),
        (pair("[]"), "s.toml:1:", "rows of 2 isovalues"),
        (pair("[[47]]"), "s.toml:1:", "rows of 2 isovalues"),
        (pair("[47, 0.6]"), "s.toml:1:", "rows of 2 isovalues"),
        (pair("[[47, 99]]"), "s.toml:1:", "99 of gyroid"),
        (pair("[[47, 0.6], [50, 0.6]]"), "s.toml:1:", "rise, or fall"),
        (pair("\"equal\"").replace("\"gyroid:9\"", "\"sphere:9\""), "s.toml:", "isovalue"),
        (pair("\"equal\"").replacen("coupling = \"equal\"\n", "", 1), "s.toml:1:", "the key `coupling`"),
        (pair("\"equal\"").replace("name = \"gyroid\"", "name = \"bumps\""), "s.toml:", "names that differ"),
        (pair("\"equal\"").replace("name = \"gyroid\"", "name = \"_g\""), "s.toml:", "begins with a letter"),
        (pair("\"equal\"").replace("albedo = [0.5, 0.5, 1]", "albedo = 2"), "s.toml:10:", "shares from 0 to 1"),
        (format!("volume = \"gyroid:8\"\n{}", pair("\"equal\"")), "s.toml:1:", "below each [[volumes]]"),
        ("volume = \"gyroid:8\"\ncoupling = \"equal\"\n".into(), "s.toml:2:", "[[volumes]], which it couples"),
    ];
    for (text, place, words) in cases {
        let is_range = text.contains("sphere:9");
        bench.write("s.toml", &text);
        let line = if is_range { "bake s.toml --isovalues 150 -o x.isolume" } else { "bake s.toml -o x.isolume" };
        let message = bench.refuses(line);
        assert!(is_range || message.contains(place), "{text}: {message}");
        assert!(message.contains(words), "{text}: {message}");
    }
    // Ranges that have no value in common.
    let apart = pair("\"equal\"").replace("\"gyroid:9\"", "\"FAR\"");
    bench.write("far.json", r#"{"dims": [2, 2, 2], "type": "uint8", "data": "far.raw"}"#);
    bench.write("far.raw", "\u{1}\u{2}\u{1}\u{2}\u{1}\u{2}\u{1}\u{2}");
    bench.write("near.json", r#"{"dims": [2, 2, 2], "type": "uint8", "inter": 100, "data": "far.raw"}"#);
    bench.write("s.toml", apart.replace("FAR", "far.json").replace("\"bumpbox:12\"", "\"near.json\""));
    let message = bench.refuses("bake s.toml -o x.isolume");
    assert!(message.contains("s.toml:1:") && message.contains("ranges that overlap"), "{message}");
}

/// The numbers of an attribute of a .glb, widened.
fn attribute(json: &serde_json::Value, bin: &[u8], name: &str) -> Vec<f64> {
    let index = json["meshes"][0]["primitives"][0]["attributes"][name].as_u64();
    let accessor = &json["accessors"][index.unwrap_or_else(|| panic!("no {name}")) as usize];
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
    let at = |v: &serde_json::Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
    let per = match accessor["type"].as_str() {
        Some("SCALAR") => 1,
        Some("VEC3") => 3,
        _ => 4,
    };
    let count = per * accessor["count"].as_u64().expect("a count") as usize;
    let bytes = &bin[at(view) + at(accessor)..];
    match accessor["componentType"].as_u64() {
        Some(5126) => bytes.as_chunks().0[..count].iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect(),
        _ => bytes.as_chunks().0[..count].iter().map(|b| f64::from(u16::from_le_bytes(*b)) / 65535.0).collect(),
    }
}

/// Two volumes under a sky and a lamp, relit from the attributes of their file alone by the formula beside them.
#[test]
fn a_scene_is_relit_from_its_file() {
    let bench = Bench::new();
    let lamp =
        "[[luminaires]]\nname = \"lamp\"\nshape = \"sphere\"\ncentre = [0.9, -0.2, 0.1]\nradius = 0.1\npower = 20\n";
    for layers in [1, 2] {
        let scene = PAIR.replace("COUPLING", "[[47, 0.6]]").replace("layers = 2", &format!("layers = {layers}"));
        bench.write("s.toml", scene.replace("[bake]", &format!("{lamp}[bake]")));
        let line = "relight s.toml --cache c --albedo 0.8,0.6,0.4 --emission 0.25 --luminaire lamp=2,1,0.5";
        bench.run(&format!("{line} --transfer --radiance -o s.glb"));
        let bytes = bench.bytes("s.glb");
        let file = gltf::Glb::from_slice(&bytes).expect("a GLB");
        let json: serde_json::Value = serde_json::from_slice(&file.json).expect("JSON");
        let bin = file.bin.as_deref().expect("numbers");
        let extras = &json["meshes"][0]["extras"]["isolume_transfer"];
        let number = |v: &serde_json::Value| v.as_f64().expect("a number");
        let [radiance, colours] = ["_RADIANCE", "COLOR_0"].map(|name| attribute(&json, bin, name));
        let vertices = radiance.len() / 3;
        let width = colours.len() / vertices;
        let (mut square, mut of_tail, mut mean) = (0.0, 0.0, 0.0);
        for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
            let (rho, glow) = (number(&extras["albedo"][c]), number(&extras["emission"][c]));
            let factor = number(&extras["luminaires"][0]["factor"][c]);
            let (mut sum, mut brought, mut emission) = (vec![glow; vertices], Vec::new(), Vec::new());
            for k in 0..layers {
                let power = rho.powi(k + 1);
                brought = vec![0.0; vertices];
                let mut add = |name: &str, weight: f64| {
                    let values = attribute(&json, bin, name);
                    assert_eq!(values.len(), vertices, "{name}");
                    brought.iter_mut().zip(&values).for_each(|(b, v)| *b += power * weight * v);
                    values
                };
                for (i, light) in
                    extras["light"]["coefficients_in_world"].as_array().expect("a light").iter().enumerate()
                {
                    let l = i.isqrt();
                    if l < 2 {
                        add(&format!("_T{k}_{channel}_SH_DEGREE_{l}_COEF_{}", i - l * l), number(&light[c]));
                    }
                }
                add(&format!("_LUMINAIRE_0_G{k}_{channel}"), factor);
                emission.push(add(&format!("_G{k}_EMISSION_{channel}"), glow));
                sum.iter_mut().zip(&brought).for_each(|(s, b)| *s += b);
            }
            for v in 0..vertices {
                let without = sum[v];
                if let [.., before, last] = &emission[..] {
                    let x = if before[v] > 0.0 { rho * (last[v] / before[v]).min(1.0) } else { 0.0 };
                    sum[v] += brought[v] * x / (1.0 - x);
                }
                let expected = radiance[3 * v + c];
                square += (sum[v] - expected).powi(2);
                of_tail += (sum[v] - without).powi(2);
                mean += expected / (3 * vertices) as f64;
                let shown = (number(&extras["exposure"]) * expected).clamp(0.0, 1.0);
                // To a step of 16 bits.
                assert!((colours[width * v + c] - shown).abs() < 1.01 / 65535.0);
            }
        }
        let [rms, tail] = [square, of_tail].map(|s| (s / (3 * vertices) as f64).sqrt());
        assert!(vertices > 100 && mean > 0.1, "{vertices} vertices of mean {mean}");
        // The layers are linear in the transfer: what interpolation and contraction do commutes, to the rounding of some
        // dozen sums in 32 bits. The tail is not, its ratio is a quotient of interpolated numbers.
        let allowed = if layers == 1 { 64.0 * f64::from(f32::EPSILON) * mean } else { tail };
        assert!(rms < allowed, "{layers} layers: {rms} {allowed}");
    }
}
