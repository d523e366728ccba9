//! The preview picture.

use super::Camera;
use super::sun::{Disk, SunLight};
use crate::geom::Bounds;
use crate::level::{CellPoint, Counts, LevelField, Outcome, Pyramid, Start};
use crate::relight::{Contracted, Light, LookupReport, Material, TriangleIndex};
use crate::volume::{Sample, Volume, with_samples};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Size and sampling of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Rays along each side of a pixel: n² rays a pixel, on a regular grid.
    pub supersampling: usize,
    /// Whether the cut of the box through the solid is drawn as a flat face; else rays pass through the solid there, and
    /// show what a mesh does whose back faces are not drawn.
    pub cap: bool,
}

/// A picture in linear radiance, not yet exposed.
pub struct Picture {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Red, green, blue, coverage; the colour is premultiplied by the coverage. Row by row from the top.
    pub pixels: Vec<[f32; 4]>,
    /// Camera rays: their own count, apart from the rays of the transport.
    pub counts: Counts,
    /// How the lookups went.
    pub report: LookupReport,
}

/// What else a camera ray may show: from its origin and unit direction in world, a distance before which alone it counts,
/// and the number of its pixel.
pub type Backdrop<'a> = dyn Fn(DVec3, DVec3, f64, usize) -> Option<[f32; 3]> + Sync + 'a;

/// A lit level set.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// In the file's values.
    pub isovalue: f64,
    /// Radiance of its texels, or of its vertices.
    pub contracted: &'a Contracted,
    /// The triangles between the vertices; none where radiance is that of texels.
    pub triangles: Option<&'a TriangleIndex<'a>>,
    /// The light that they were contracted with: without suns that were split off.
    pub light: &'a Light,
    /// What they reflect of it.
    pub material: &'a Material,
    /// What suns bring by reflection at the vertices of its mesh, and the triangles between these.
    pub reflected: Option<(&'a TriangleIndex<'a>, &'a [[f32; 3]])>,
}

/// What one ray (origin and unit direction in world) sees of the level set alone, and how far away: for what is shown
/// as a [`Backdrop`] of others.
pub fn radiance_along(
    subject: &Subject<'_>,
    camera: &Camera,
    options: &RenderOptions,
    origin: DVec3,
    direction: DVec3,
) -> Option<([f32; 3], f64)> {
    let Subject { volume, pyramid, isovalue, .. } = *subject;
    with_samples!(volume.samples(), s => {
        let scene = Scene {
            field: LevelField::new(volume, s, pyramid),
            subject,
            isovalue: volume.raw_from_value(isovalue) as f32,
            camera, options, suns: &[], backdrop: None,
            clip: clip_box(volume),
        };
        let (mut counts, mut report) = (Counts::default(), LookupReport::default());
        let (rgb, in_grid) = scene.shade(origin, direction, 0, &mut counts, &mut report)?;
        Some((rgb, (volume.world_from_grid().point(in_grid) - origin).length()))
    })
}

/// Ray-traces a level set with the radiance of its texels.
///
/// Every surface point tests whether it sees the `suns` that were split off the environment. What `backdrop` shows stands
/// before or behind the level set.
///
/// Where a ray enters the box inside the solid it sees a cut face ([`RenderOptions::cap`]); that has no surface point, so
/// it is shaded as an unoccluded one of the box face, at half strength.
pub fn render(
    subject: &Subject<'_>,
    suns: &[SunLight],
    backdrop: Option<&Backdrop<'_>>,
    camera: &Camera,
    options: &RenderOptions,
) -> Picture {
    let Subject { volume, pyramid, isovalue, .. } = *subject;
    let suns: Vec<(Disk, [f32; 3])> =
        suns.iter().map(|s| (Disk::new(&of_one_ray(s, options)), subject.material.sun_factor(s.flux))).collect();
    let mut pixels = vec![[0.0; 4]; options.width * options.height];
    let totals: Vec<(Counts, LookupReport)> = with_samples!(volume.samples(), s => {
        let scene = Scene {
            field: LevelField::new(volume, s, pyramid),
            subject,
            isovalue: volume.raw_from_value(isovalue) as f32,
            camera, options, suns: &suns, backdrop,
            clip: clip_box(volume),
        };
        pixels.par_chunks_mut(options.width).with_max_len(1).enumerate().map(|(y, row)| scene.row(y, row)).collect()
    });
    let (mut counts, mut report) = (Counts::default(), LookupReport::default());
    for (c, r) in totals {
        counts += c;
        report += r;
    }
    Picture { width: options.width, height: options.height, pixels, counts, report }
}

/// A sun for one of the rays of a pixel: all of them together give it the rays that it has at a point.
fn of_one_ray(sun: &SunLight, options: &RenderOptions) -> SunLight {
    let of_pixel = options.supersampling.max(1).pow(2) as u32;
    SunLight { rays: sun.rays.div_ceil(OVER_PIXELS * of_pixel).max(sun.rays.min(FEWEST_SUN_RAYS)), ..sun.clone() }
}

/// Fewest rays to a sun, where it has as many: fewer would miss much of the penumbra.
const FEWEST_SUN_RAYS: u32 = 8;

/// Rays of a point over those of a pixel: beside it are others.
const OVER_PIXELS: u32 = 2;

/// Steps of a ray through the solid, in voxels.
const STEP_IN_SOLID: f64 = 0.25;

struct Scene<'a, T> {
    field: LevelField<'a, T>,
    subject: &'a Subject<'a>,
    // As stored.
    isovalue: f32,
    camera: &'a Camera,
    options: &'a RenderOptions,
    // Each with ρ/π · flux.
    suns: &'a [(Disk, [f32; 3])],
    backdrop: Option<&'a Backdrop<'a>>,
    clip: Bounds,
}

pub(super) fn clip_box(volume: &Volume) -> Bounds {
    let last = volume.dims().map(|d| (d - 1) as f64);
    Bounds { min: DVec3::ZERO, max: DVec3::from_array(last) }
}

impl<T: Sample> Scene<'_, T> {
    fn row(&self, y: usize, row: &mut [[f32; 4]]) -> (Counts, LookupReport) {
        let (mut counts, mut report) = (Counts::default(), LookupReport::default());
        let n = self.options.supersampling.max(1);
        let (width, height) = (self.options.width as f64, self.options.height as f64);
        let aspect = width / height;
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut sum = [0.0f32; 4];
            for sub in 0..n * n {
                let px = (x as f64 + ((sub % n) as f64 + 0.5) / n as f64) / width * 2.0 - 1.0;
                let py = 1.0 - (y as f64 + ((sub / n) as f64 + 0.5) / n as f64) / height * 2.0;
                let (origin, direction) = self.camera.ray(px, py, aspect);
                let item = ((y * self.options.width + x) * n * n + sub) as u64;
                let level = self.shade(origin, direction, item, &mut counts, &mut report);
                let other = self.backdrop.and_then(|backdrop| {
                    let place = |(_, in_grid): ([f32; 3], DVec3)| self.subject.volume.world_from_grid().point(in_grid);
                    let limit = level.map_or(f64::INFINITY, |hit| (place(hit) - origin).length());
                    backdrop(origin, direction.normalize(), limit, y * self.options.width + x)
                });
                if let Some(rgb) = other.or(level.map(|(rgb, _)| rgb)) {
                    for c in 0..3 {
                        sum[c] += rgb[c];
                    }
                    sum[3] += 1.0;
                }
            }
            *pixel = sum.map(|v| v / (n * n) as f32);
        }
        (counts, report)
    }

    /// Radiance along a ray and where it meets the level set, in grid space.
    fn shade(
        &self,
        origin: DVec3,
        direction: DVec3,
        item: u64,
        counts: &mut Counts,
        report: &mut LookupReport,
    ) -> Option<([f32; 3], DVec3)> {
        let grid_from_world = self.subject.volume.world_from_grid().inverse();
        let origin = grid_from_world.point(origin);
        let direction = grid_from_world.vector(direction).normalize();
        let (entry, face) = enter(&self.clip, origin, direction)?;
        let mut at = self.field.locate(entry.to_array());
        let is_solid = |at: &CellPoint| self.field.sign() * (self.field.raw_value(at) - self.isovalue) > 0.0;
        if !self.options.cap {
            let mut place = entry;
            while is_solid(&at) {
                place += direction * STEP_IN_SOLID;
                if place.clamp(self.clip.min, self.clip.max) != place {
                    return None;
                }
                at = self.field.locate(place.to_array());
            }
        }
        if is_solid(&at) {
            // A cut through the solid: the normal of the box face, as a covector.
            let mut gradient = Vec3::ZERO;
            gradient[face] = direction[face].signum() as f32;
            let normal = (self.subject.volume.world_from_grid().gradient_matrix() * -gradient).normalize_or_zero();
            let open = self.subject.light.unoccluded(normal.to_array());
            let mut rgb: [f32; 3] = std::array::from_fn(|c| self.subject.material.albedo[c] * open[c].max(0.0));
            for (disk, factor) in self.suns {
                let cosine = disk.towards().dot(normal).max(0.0);
                rgb = std::array::from_fn(|c| rgb[c] + factor[c] * cosine);
            }
            return Some((rgb.map(|v| 0.5 * v), entry));
        }
        match self.field.trace(self.isovalue, &Start::beside(at), direction.as_vec3(), counts) {
            Outcome::Hit(hit) => {
                let normal = self.field.normal(&hit.at).map_or([0.0, 0.0, 1.0], |n| n.vec().to_array());
                let position = hit.at.in_grid().to_array();
                let Subject { contracted, light, material, triangles, reflected, .. } = self.subject;
                let mut rgb = match triangles {
                    Some(index) => contracted.between_vertices(index, position, normal, light, material, report),
                    None => contracted.radiance_at(position, normal, light, material, report),
                };
                if let Some(more) = reflected.and_then(|(index, values)| index.between(position, values)) {
                    rgb = std::array::from_fn(|c| rgb[c] + more[c]);
                }
                for (disk, factor) in self.suns {
                    let (lit, _) = disk.lit_cosine(&self.field, self.isovalue, hit.at, normal.into(), item, counts);
                    rgb = std::array::from_fn(|c| rgb[c] + factor[c] * lit);
                }
                Some((rgb, hit.at.in_grid().as_dvec3()))
            }
            _ => None,
        }
    }
}

/// Where a ray enters a box, and through which pair of faces; `None` when it misses.
pub(super) fn enter(clip: &Bounds, origin: DVec3, direction: DVec3) -> Option<(DVec3, usize)> {
    let (mut near, mut far, mut face) = (0.0f64, f64::INFINITY, 0);
    for a in 0..3 {
        if direction[a] == 0.0 {
            if origin[a] < clip.min[a] || origin[a] > clip.max[a] {
                return None;
            }
            continue;
        }
        let (s, t) = ((clip.min[a] - origin[a]) / direction[a], (clip.max[a] - origin[a]) / direction[a]);
        let (s, t) = if s < t { (s, t) } else { (t, s) };
        if s > near {
            (near, face) = (s, a);
        }
        far = far.min(t);
    }
    (near < far).then(|| (origin + direction * near, face))
}
