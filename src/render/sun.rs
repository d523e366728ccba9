//! Direct light of a sun that was split off the environment: visibility rays on the level set.
//!
//! Exitant radiance is ρ/π · flux · (mean over the disk of V(x, ω)(n·ω)⁺). The rays obey the rule of the
//! bake: they start *on* the level set of their point, so they can neither hit it at once nor leak.

use crate::geom::{Frame, Normal};
use crate::level::{CellPoint, Counts, LevelField, Outcome, Pyramid, Start};
use crate::probe::{LampShape, Orientation, Sun};
use crate::sampling::{PathSampler, hash, warp};
use crate::volume::{Sample, Volume, with_samples};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A sun as it stands in the world, with the number of rays to give it.
#[derive(Clone, Debug, PartialEq)]
pub struct SunLight {
    /// Unit vector to the centre of its disk.
    pub direction_in_world: DVec3,
    /// Half the angle across, in radians.
    pub angular_radius: f64,
    /// Radiance times solid angle, red, green, blue.
    pub flux: [f64; 3],
    /// Visibility rays for each surface point, at least 1; powers of two are spread best. Where they disagree, in the
    /// penumbra, there are [`PENUMBRA`] times as many. A single ray goes to the centre and makes hard shadows.
    pub rays: u32,
    /// Its shape in world; a uniform disk, if `None`.
    pub shape: Option<LampShape>,
}

impl SunLight {
    /// The sun of a probe that stands as `orientation` says.
    pub fn new(sun: &Sun, orientation: Orientation, rays: u32) -> Self {
        Self {
            direction_in_world: sun.direction_in_world(orientation),
            angular_radius: sun.angular_radius,
            flux: sun.flux,
            rays,
            shape: sun.shape.as_ref().map(|shape| shape.turned(orientation.world_from_probe())),
        }
    }
}

/// How much of a sun reaches each point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SunVisibility {
    /// Mean over the disk of V(x, ω)(n·ω)⁺, in [0, 1], one entry a position;
    /// [`crate::relight::VertexRadiance::add_sun`] turns it into radiance.
    pub lit: Vec<f32>,
    /// Variance of each of them by the choice of the rays; 0 where all agree.
    pub variance: Vec<f32>,
    /// Visibility rays: their own count, apart from the rays of the transport and of cameras.
    pub counts: Counts,
}

/// Seed of the points on the disk: any would do; a fixed one makes the same numbers every time.
const SEED: u64 = 0x5375_6e20_7261_7973;

/// Rays in the penumbra over those elsewhere: with 16 rays everywhere the large lamps of a studio raised the stated noise of two
/// surfaces to 3 and 6 %.
pub const PENUMBRA: u32 = 4;

/// Cells that the edge of a shadow crosses, over the root of the number of rays.
///
/// The rays are points of a (0, 2)-sequence: one in each of N cells of equal area, of which the edge crosses a number that
/// grows as √N; all others are lit or dark as a whole. A cell that is crossed anywhere has p(1 − p) = 1/6 in the mean, which
/// makes a variance of CROSSED √N/(6 N²). N independent rays have p(1 − p)/N, 1/(6 N) in the mean over the penumbra: the
/// ratio is CROSSED/√N. A chord of a disk cut into squares crosses about 1.2 √N; cells in polar coordinates are longer.
/// `the_variance_of_the_rays_is_that_of_many_choices` compares what it states with what other choices of the rays give.
const CROSSED: f32 = 1.3;

/// Points tested by one task.
const TASK: usize = 256;

/// The disk of a sun, ready for rays.
pub(super) struct Disk {
    frame: Frame,
    /// 1 − cos of the angular radius.
    height: f32,
    /// Sine of the angle up to which it reaches.
    sine: f32,
    rays: u32,
    shape: Option<LampShape>,
    /// Of its direction: lamps side by side take other rays.
    key: u64,
}

impl Disk {
    pub(super) fn new(sun: &SunLight) -> Self {
        let towards = sun.direction_in_world.as_vec3();
        // A normal points down a gradient. A zero direction lights nothing whatever the frame.
        let axis = Normal::down_gradient(-towards);
        let frame =
            axis.map_or(Frame { tangent: Vec3::ZERO, bitangent: Vec3::ZERO, normal: Vec3::ZERO }, Frame::around);
        let radius = sun.angular_radius.clamp(0.0, std::f64::consts::FRAC_PI_2);
        let extent = sun.shape.as_ref().map_or(radius, |shape| shape.extent(sun.direction_in_world));
        let key = sun.direction_in_world.to_array().iter().fold(0, |key, x| hash::key(key, x.to_bits()));
        let sine = libm::sin(extent.min(std::f64::consts::FRAC_PI_2)) as f32;
        Self { frame, height: warp::cap_height(radius), sine, rays: sun.rays.max(1), shape: sun.shape.clone(), key }
    }

    /// Unit vector to the centre.
    pub(super) fn towards(&self) -> Vec3 {
        self.frame.normal
    }

    /// Sine of the angle up to which it reaches from its centre.
    pub(super) fn sine(&self) -> f32 {
        self.sine
    }

    /// A unit vector to a place on it: uniform in solid angle on a disk, by luminance on a shape, where the variates are uniform.
    pub(super) fn direction(&self, u: [f32; 2]) -> Vec3 {
        match &self.shape {
            Some(shape) => shape.direction(u),
            None => self.frame.from_local(warp::square_to_uniform_cone(u, self.height)),
        }
    }

    /// Mean of V(x, ω)(n·ω)⁺ over the disk at a point of the level set, and its variance; `item` picks the points.
    pub(super) fn lit_cosine<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        isovalue: f32,
        at: CellPoint,
        normal_in_world: Vec3,
        item: u64,
        counts: &mut Counts,
    ) -> (f32, f32) {
        // The whole disk below the horizon: n·s ≤ −sin α.
        if self.towards().dot(normal_in_world) <= -self.sine {
            return (0.0, 0.0);
        }
        let start = Start::on(at);
        let sequence = PathSampler::new(SEED ^ self.key, item, 0).sequence(0);
        let (mut sum, mut squares, mut lit, mut rays) = (0.0, 0.0, 0, 0);
        let mut most = self.rays;
        while rays < most {
            let direction = match self.rays {
                1 => self.towards(),
                _ => self.direction(sequence.point(rays)),
            };
            rays += 1;
            let cosine = direction.dot(normal_in_world);
            if cosine > 0.0
                && field.trace(isovalue, &start, field.direction_in_grid(direction), counts) == Outcome::Escaped
            {
                sum += cosine;
                squares += cosine * cosine;
                lit += 1;
            }
            // Rays that disagree are in the penumbra.
            if rays == self.rays && lit > 0 && lit < rays {
                most = PENUMBRA * self.rays;
            }
        }
        let rays = rays as f32;
        let mean = sum / rays;
        (mean, (CROSSED / rays.sqrt()).min(1.0) * (squares / rays - mean * mean).max(0.0) / rays)
    }
}

/// Tests the visibility of a sun from points of the level set of `isovalue` (a value of the file), such
/// as the vertices of its mesh. Normals are unit vectors in world axes. A point with a normal of zero
/// stays dark. A grid without cells has no shadows, only cosines.
///
/// The numbers are a function of the position's index: the same for any number of threads.
///
/// # Panics
/// When there are not as many normals as positions.
pub fn sun_visibility(
    volume: &Volume,
    pyramid: &Pyramid,
    isovalue: f64,
    positions_in_grid: &[[f32; 3]],
    normals_in_world: &[[f32; 3]],
    sun: &SunLight,
) -> SunVisibility {
    assert_eq!(positions_in_grid.len(), normals_in_world.len());
    let disk = Disk::new(sun);
    let mut lit = vec![(0.0f32, 0.0f32); positions_in_grid.len()];
    if volume.dims().iter().any(|&d| d < 2) {
        for (lit, normal) in lit.iter_mut().zip(normals_in_world) {
            lit.0 = disk.towards().dot(Vec3::from_array(*normal)).max(0.0);
        }
        let (lit, variance) = lit.into_iter().unzip();
        return SunVisibility { lit, variance, counts: Counts::default() };
    }
    let raw = volume.raw_from_value(isovalue) as f32;
    let parts: Vec<Counts> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        lit.par_chunks_mut(TASK)
            .enumerate()
            .map(|(task, lit)| {
                let mut counts = Counts::default();
                for (i, lit) in lit.iter_mut().enumerate() {
                    let i = task * TASK + i;
                    let at = field.locate(positions_in_grid[i].map(f64::from));
                    let normal = Vec3::from_array(normals_in_world[i]);
                    *lit = disk.lit_cosine(&field, raw, at, normal, i as u64, &mut counts);
                }
                counts
            })
            .collect()
    });
    let mut counts = Counts::default();
    parts.into_iter().for_each(|part| counts += part);
    let (lit, variance) = lit.into_iter().unzip();
    SunVisibility { lit, variance, counts }
}
