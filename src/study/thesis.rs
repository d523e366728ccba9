//! The table of the thesis: what a texture of several data sets costs, and how far its colours are from the light computed for one
//! isosurface directly (Beason 2005, table 5.14).
//!
//! Each volume, or pair of volumes, stands in a closed room of coloured walls under one luminaire, as his did; sizes and colours
//! of the room are ours. Transfer is baked at the vertices of the isosurfaces, by paths; beside it stand photons (indirect light from
//! the map, direct light by rays). Both are held against path tracing at random vertices, by his measure: root mean square in
//! percent of white after the exposure of the reference, mean over the isovalues.

pub mod table;

use super::Clock;
use crate::bake::{Bake, Silent};
use crate::compare::{LitSurface, PhotonQuestion, Question, Vertices, compare, compare_photons, unburied};
use crate::error::{Error, Result};
use crate::geom::{Bounds, Direction};
use crate::level::Pyramid;
use crate::sampling::hash::uniform;
use crate::sampling::{DirectionSample, DirectionalSource};
use crate::scene::geometry::{Finish, Geometry, Luminaire, LuminaireShape, Shape, Wall};
use crate::scene::{Member, Scene};
use crate::sh::Coefficients;
use crate::surface::Mesh;
use crate::transfer::BrickSource;
use crate::transfer::store::Store;
use crate::transport::{
    Isovalues, PhotonLight, PhotonLightSettings, PhotonSearch, PhotonSettings, SceneReference, SurfacePoint, direct,
};
use glam::DVec3;
use std::path::Path;

/// A row of the printed table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Printed {
    /// The data set.
    pub name: &'static str,
    /// Samples of its texture.
    pub samples: u64,
    /// Photons in millions.
    pub photons: f64,
    /// Seconds before any picture: photons and texture.
    pub precompute: f64,
    /// Seconds to colour one isosurface from the texture.
    pub texturing: f64,
    /// Seconds to render one directly.
    pub render: f64,
    /// Root mean square in percent, mean over the isosurfaces.
    pub rms_percent: f64,
}

/// Rows of table 5.14, and of table 4.2 for the bump box.
pub const PRINTED: [Printed; 5] = [
    row("bump box", 1_000_000, 0.0, 3120.0, 0.055, 312.0, 1.29),
    row("nucleon", 8_000_000, 11.0, 9685.0, 0.050, 2155.0, 5.61),
    row("LAPR", 3_755_979, 15.2, 5565.0, 0.036, 522.0, 8.06),
    row("neuron", 2_075_806, 11.7, 4587.0, 0.014, 1229.0, 5.70),
    row("brain", 17_390_102, 7.6, 5452.0, 0.098, 1819.0, 6.53),
];

const fn row(
    name: &'static str,
    samples: u64,
    photons: f64,
    precompute: f64,
    texturing: f64,
    render: f64,
    rms_percent: f64,
) -> Printed {
    Printed { name, samples, photons, precompute, texturing, render, rms_percent }
}

/// How much work a row is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Paths of a vertex.
    pub rays: u32,
    /// Photons of each isosurface.
    pub photons: u32,
    /// Random vertices at which light is compared.
    pub points: u32,
    /// Paths of the reference at each of them.
    pub paths: u32,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Effort {
    /// How the figures of the table are to be read.
    pub fn legend(&self) -> String {
        format!(
            "RMS %: of linear radiance after the exposure of the reference, cut to [0, 1], mean over the isosurfaces, as Beason (2005) \
             measured; reference: {} paths at each of {} vertices. Precompute: the bake of all isosurfaces by {} paths a vertex, wall clock; \
             his: photons and texture. Sizes of the room and colours of its walls are ours: they are not printed in the thesis. nucleons and \
             spray are stand-ins for data that are not public.",
            self.paths, self.points, self.rays
        )
    }
}

/// One isosurface of a row.
#[derive(Clone, Debug, PartialEq)]
pub struct OfIsovalue {
    /// The volume.
    pub volume: String,
    /// In its values.
    pub isovalue: f64,
    /// Vertices of it.
    pub vertices: u64,
    /// Root mean square in percent by spherical harmonics, and by photons.
    pub rms_percent: [f64; 2],
    /// Seconds to light all vertices from the store, wall clock.
    pub texturing: f64,
    /// Seconds that as many vertices take by the paths of the reference, from those that were traced.
    pub render: f64,
    /// Seconds of the photons: their flight and all readings.
    pub photons: f64,
}

/// What was found of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct ThesisRow {
    /// Each volume at each isovalue.
    pub surfaces: Vec<OfIsovalue>,
    /// Seconds of the bake, wall clock and processor.
    pub bake: [f64; 2],
}

impl ThesisRow {
    /// The mean over the isosurfaces of what `of` says.
    pub fn mean(&self, of: impl Fn(&OfIsovalue) -> f64) -> f64 {
        self.surfaces.iter().map(of).sum::<f64>() / self.surfaces.len().max(1) as f64
    }
}

/// A closed room around a box, a tenth larger on each side, with a red and a green wall and a luminaire of 90 W (its longest side being
/// a metre) in the middle of the side towards `up`.
///
/// # Errors
/// When the box is empty, `up` is no direction, or the margin is below 0.
pub fn room(bounds: &Bounds, up: DVec3, margin: f64) -> Result<Geometry> {
    let size = bounds.size();
    let longest = size.max_element();
    if !(margin >= 0.0 && up.is_finite() && up != DVec3::ZERO) {
        let (found, expected) = (format!("up {up}, margin {margin}"), "a direction, and a margin of 0 or more");
        return Err(Error::argument("room", found, expected, "take that of the volume, and 0.1"));
    }
    if !(longest.is_finite() && longest > 0.0) {
        return Err(Error::argument("bounds", format!("{size}"), "a box with a positive volume", "give a volume"));
    }
    let (min, max) = (bounds.min - margin * longest, bounds.max + margin * longest);
    let colours = [[0.63, 0.065, 0.05], [0.14, 0.45, 0.091], [0.75; 3], [0.75; 3], [0.75; 3], [0.75; 3]];
    // The pair of sides that differ in colour must not be that of the luminaire.
    let vertical = (0..3).max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs())).unwrap_or(2);
    let first = if vertical == 0 { 2 } else { 0 };
    let faces = Shape::faces_of_box(min, max, true).into_iter().enumerate();
    let wall = |(i, shape): (usize, Shape)| {
        let colour = if i / 2 == first { colours[i % 2] } else { colours[2] };
        Wall { name: format!("side{i}"), shape, finish: Finish::Diffuse(colour) }
    };
    let towards = DVec3::from_array(std::array::from_fn(|a| if a == vertical { up[a].signum() } else { 0.0 }));
    let u = DVec3::from_array(std::array::from_fn(|a| f64::from(u8::from(a == (vertical + 1) % 3))));
    let v = (-towards).cross(u);
    let middle = 0.5 * (min + max);
    // A little off the wall, so that it hides it.
    let place = middle + towards * (0.5 * (max - min)[vertical] * (1.0 - 1e-4));
    let side = 0.4 * longest;
    let shape = LuminaireShape::Rectangle { corner: place - 0.5 * side * (u + v), u: side * u, v: side * v };
    let lamp = Luminaire { name: "ceiling".into(), shape, power: [90.0; 3] };
    Geometry::new(faces.map(wall).collect(), vec![lamp], 1.0 / longest)
}

/// No light but that of the luminaire.
struct Dark;

impl DirectionalSource for Dark {
    fn sample(&self, _: [f32; 2]) -> Option<DirectionSample> {
        None
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, _: Direction) -> [f32; 3] {
        [0.0; 3]
    }
}

/// Albedo of all isosurfaces.
const ALBEDO: f32 = 0.7;
/// Layers of the transfer; nothing of an environment comes in, so that a band is enough.
const LAYERS: usize = 4;

/// Bakes the isosurfaces of a scene into a store at `path`, and compares them; isovalues are those of the first volume.
///
/// # Errors
/// As the bake and the comparisons.
pub fn measure(scene: &Scene, isovalues: &[f64], effort: &Effort, path: &Path, clock: &Clock<'_>) -> Result<ThesisRow> {
    if effort.points == 0 {
        return Err(Error::argument("points", 0, "at least one vertex to compare at", "2000 are those of the program"));
    }
    let start = clock();
    let list = isovalues.iter().copied();
    let bake = Bake::of(scene).isovalues(list).layers(LAYERS).bands(1).rays(effort.rays).seed(effort.seed);
    let (store, _) = bake.run(path, &Silent)?;
    let end = clock();
    let mut surfaces = Vec::new();
    for (m, member) in scene.members().iter().enumerate() {
        let is_joint = scene.members().len() > 1;
        let of_member = if is_joint { store.of_volume(&member.volume.name)? } else { Store::open(store.path())? };
        for &isovalue in isovalues {
            let isovalue = if m == 0 { isovalue } else { of_partner(scene, &member.volume.name, isovalue) };
            if let Some(found) = compared(member, &of_member, isovalue, effort, clock)? {
                surfaces.push(found);
            }
        }
    }
    Ok(ThesisRow { surfaces, bake: [end[0] - start[0], end[1] - start[1]] })
}

/// The isovalue of a volume beside the first that belongs to one of the first.
fn of_partner(scene: &Scene, name: &str, isovalue: f64) -> f64 {
    let geometry = scene.members().first().and_then(|member| member.geometry.as_ref());
    let partner = geometry.and_then(|geometry| geometry.partners().iter().find(|partner| partner.name == name));
    partner.map_or(isovalue, |partner| partner.isovalue.at(isovalue))
}

/// One isosurface of a volume; `None` where it has no vertex that is seen.
fn compared(
    member: &Member,
    store: &Store,
    isovalue: f64,
    effort: &Effort,
    clock: &Clock<'_>,
) -> Result<Option<OfIsovalue>> {
    let volume = &*member.volume;
    let pyramid = Pyramid::new(volume);
    let Some(surface) = store.surface(isovalue)? else { return Ok(None) };
    let Some(mesh) = surface.mesh()? else { return Ok(None) };
    let count = mesh.positions_in_grid.len();
    let geometry = member.geometry.as_ref();
    let points = unburied(volume, &pyramid, geometry, isovalue, vertices(&mesh, effort));
    if points.is_empty() {
        return Ok(None);
    }
    let groups = surface.identity().groups();
    let textures = groups.iter().map(|group| surface.group(group)).collect::<Result<Vec<_>>>()?;
    let textures: Vec<&dyn BrickSource> = textures.iter().map(|t| t as _).collect();
    let point = |v: usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
    let everywhere: Vec<SurfacePoint> = (0..count).map(point).collect();
    let vertices = Vertices::new(isovalue, mesh);
    let none = [(); 3].map(|()| Coefficients::zero(1));
    let lit = LitSurface {
        volume,
        pyramid: &pyramid,
        geometry,
        caustics: true,
        specular: None,
        isovalue,
        points: &points,
        light: &Dark,
        coefficients: &none,
        albedo: [ALBEDO; 3],
        emission: [0.0; 3],
        scales: &[],
        vertices: Some(&vertices),
    };
    let question = Question {
        surface: lit,
        textures: &textures,
        baked_by: None,
        apart: None,
        paths: effort.paths,
        texel_rays: 4,
        seed: effort.seed,
    };
    let start = clock()[0];
    LitSurface { points: &everywhere, ..lit }.by_textures(&textures, &none)?;
    let texturing = clock()[0] - start;
    let start = clock()[0];
    let reference = SceneReference::new(effort.paths, [ALBEDO; 3], effort.seed ^ 1);
    direct(volume, &pyramid, geometry, isovalue, &points, &[], &reference)?;
    let render = (clock()[0] - start) * count as f64 / points.len() as f64;
    let found = compare(&question)?;
    let near = Isovalues::near(volume, isovalue, 1.0);
    let asked = PhotonQuestion {
        map: PhotonSettings {
            photons: effort.photons,
            isovalues: near.unwrap_or_default(),
            seed: effort.seed,
            ..PhotonSettings::default()
        },
        reading: PhotonLightSettings {
            light: PhotonLight::Indirect,
            rays: 256,
            search: PhotonSearch::default(),
            caustics: PhotonSearch::of_caustics(),
            seed: effort.seed,
        },
    };
    let start = clock()[0];
    let photons = compare_photons(&question, &found, &asked)?;
    Ok(Some(OfIsovalue {
        volume: volume.name.clone(),
        isovalue,
        vertices: count as u64,
        rms_percent: [found.whole.rms_percent, photons.paths.rms_percent],
        texturing,
        render,
        photons: clock()[0] - start,
    }))
}

/// Random vertices, as many as asked for.
fn vertices(mesh: &Mesh, effort: &Effort) -> Vec<SurfacePoint> {
    let count = mesh.positions_in_grid.len();
    let vertex = |i: u32| {
        let [high, low] = [0, 1].map(|d| f64::from(uniform(effort.seed, 0x7468_6573, i, d)));
        (((high + low / f64::from(1u32 << 24)) * count as f64) as usize).min(count.saturating_sub(1))
    };
    let point = |v: usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
    if count == 0 { Vec::new() } else { (0..effort.points).map(|i| point(vertex(i))).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::field;

    #[test]
    fn a_room_has_its_luminaire_on_the_side_that_is_up() {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 0.5) };
        for up in [DVec3::X, DVec3::NEG_Y, DVec3::Z] {
            let geometry = room(&bounds, up, 0.1).unwrap();
            let shape = &geometry.luminaires()[0].shape;
            let LuminaireShape::Rectangle { corner, u, v } = shape else { panic!("{shape:?}") };
            // It shines down, from within the room.
            assert!(u.cross(*v).normalize().dot(up) < -0.999, "{up}");
            let middle = *corner + 0.5 * (*u + *v);
            let inside = 0.5 * (bounds.min + bounds.max);
            assert!((middle - inside).normalize().dot(up) > 0.999, "{up}: {middle}");
            let wall = geometry.first_wall(inside, up, None, f64::INFINITY).unwrap();
            assert!(wall.distance > (middle - inside).length(), "{up}");
        }
        assert!(room(&Bounds::EMPTY, DVec3::Z, 0.1).is_err());
    }

    #[test]
    fn a_row_of_the_table_is_as_exact_as_its_paths() {
        let volume = field::by_name("bumpbox:17").unwrap().unwrap().sample().unwrap();
        let geometry = room(&volume.world_bounds(), volume.up.axis(), 0.0).unwrap();
        let scene = Scene::among(volume, geometry);
        let folder = tempfile::tempdir().unwrap();
        let effort = Effort { rays: 256, photons: 1 << 16, points: 100, paths: 256, seed: 1 };
        let row = measure(&scene, &[47.0, 100.0], &effort, &folder.path().join("x.isolume"), &|| [0.0; 2]).unwrap();
        assert_eq!(row.surfaces.len(), 2);
        // 256 paths of some 50 % each leave 3 % of the radiance, which is at most white.
        assert!(row.mean(|s| s.rms_percent[0]) < 6.0, "{row:?}");
        assert!(row.mean(|s| s.rms_percent[1]) < 8.0, "{row:?}");
    }
}
