//! Lamps that are lit apart among walls, luminaires and other volumes: by paths from the vertices, which ask for a lamp wherever they
//! turn, in all orders of reflection. Of a volume alone [`crate::render::SunLit`] is cheaper.

use super::Session;
use super::member::{Member, coupling_of};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::relight::check_count;
use crate::render::{AIM, Lamps, Reflected, SunLight, places_of_trial, rays_that_are_enough};
use crate::scene::IsovalueMap;
use crate::scene::geometry::{Among, Geometry, Partner};
use crate::transfer::store::{CouplingIdentity, PartnerIdentity};
use crate::transport::{SceneReference, SurfacePoint, direct};
use crate::volume::Volume;
use std::sync::Arc;

/// Bounds of the paths of a point, and most of all together.
const FEWEST_PATHS: u32 = 64;
const MOST_PATHS: u32 = 1024;
const MOST_OF_ALL: u64 = 1 << 24;
const SEED: u64 = 0x6c61_6d70_7321;
/// Albedo at which two reflections are nothing.
const FAINT: f32 = 1.0 / 1_048_576.0;

/// An isosurface among what stands around it, and how much of the light that arrives there it sends back.
pub(crate) struct LitByPaths<'a> {
    pub(crate) volume: &'a Volume,
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) geometry: &'a Geometry,
    /// In the file's values.
    pub(crate) isovalue: f64,
    pub(crate) albedo: [f32; 3],
    /// Whether it lights itself.
    pub(crate) reflects: bool,
}

impl LitByPaths<'_> {
    /// Radiance that lamps bring to some points (grid space, unit normals in world), direct and reflected, by as many paths as bring
    /// its standard error to 1.2 % of the mean radiance: trials tell, within bounds. `rest`: the mean radiance that comes from
    /// elsewhere. Variances are those of four replicates; that of the mean of the channels is an upper bound, as if they erred
    /// together.
    ///
    /// # Errors
    /// As [`direct`]; when there are not as many normals as positions.
    pub(crate) fn lit(
        &self,
        lamps: &[SunLight],
        (positions_in_grid, normals_in_world): (&[[f32; 3]], &[[f32; 3]]),
        rest: f64,
    ) -> Result<Reflected> {
        let count = positions_in_grid.len();
        check_count("normals", normals_in_world.len(), count)?;
        if count == 0 {
            return Ok(Reflected::default());
        }
        let place = |(&position_in_grid, &normal)| SurfacePoint { position_in_grid, normal };
        let points: Vec<SurfacePoint> = positions_in_grid.iter().zip(normals_in_world).map(place).collect();
        let some: Vec<SurfacePoint> = places_of_trial(count).map(|i| points[i]).collect();
        let allowed = (MOST_OF_ALL / count as u64).clamp(FEWEST_PATHS.into(), MOST_PATHS.into()) as u32;
        let mut tried = 0;
        let paths = rays_that_are_enough(FEWEST_PATHS, allowed, |paths| {
            let trial = self.by_paths(lamps, &some, paths)?;
            tried += trial.rays;
            let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / some.len() as f64;
            let radiance = mean(&mut trial.radiance.iter().flatten().map(|&v| f64::from(v))) / 3.0;
            let variance = mean(&mut trial.channel_variance.iter().map(|&v| f64::from(v)));
            Ok(variance.sqrt() <= AIM * (rest.max(0.0) + radiance))
        })?;
        let found = self.by_paths(lamps, &points, paths)?;
        Ok(Reflected { rays: found.rays + tried, ..found })
    }

    fn by_paths(&self, lamps: &[SunLight], points: &[SurfacePoint], paths: u32) -> Result<Reflected> {
        let Self { volume, pyramid, geometry, isovalue, .. } = *self;
        // Of an albedo that nears 0 nothing is reflected twice, and what is left is in proportion to it.
        let (albedo, factor) =
            if self.reflects { (self.albedo, [1.0; 3]) } else { ([FAINT; 3], self.albedo.map(|a| a / FAINT)) };
        // Luminaires and what media send out are in the transfer.
        let scales = vec![[0.0; 3]; geometry.luminaires().len()];
        let settings = SceneReference { scales, ..SceneReference::new(paths, albedo, SEED) };
        let source = Lamps::new(lamps, None);
        let (found, counts) = direct(volume, pyramid, Some(geometry), isovalue, points, &[&source], &settings)?;
        let found = found.into_iter().next().unwrap_or_default();
        let scaled = |v: [f64; 3]| [0, 1, 2].map(|c| v[c] * f64::from(factor[c]));
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>() as f32 / 3.0;
        let together = |v: [f64; 3]| (v.iter().sum::<f64>() / 3.0).powi(2) as f32;
        Ok(Reflected {
            radiance: found.iter().map(|r| scaled(r.mean).map(|v| v as f32)).collect(),
            variance: found.iter().map(|r| together(scaled(r.stderr))).collect(),
            channel_variance: found.iter().map(|r| square(scaled(r.stderr))).collect(),
            rays_each: paths,
            rays: counts.path_rays + counts.light_rays,
        })
    }
}

impl Session<'_> {
    /// Whether lamps can be lit apart from environments.
    pub(crate) fn splits_lamps(&self) -> bool {
        (0..self.members().len()).all(|number| self.around(number).is_ok())
    }

    /// What stands around a member; `None` where it is alone.
    ///
    /// # Errors
    /// When lamps cannot be lit apart there: the store is of walls whose shapes are not known, or they are such that paths do not find
    /// lamps.
    pub(super) fn around(&self, number: usize) -> Result<Option<&Geometry>> {
        let refuse = |found: String, remedy: &str| {
            Err(Error::argument("sun split", found, "an environment whose lamps stay in it", remedy))
        };
        let Some(identity) = &self.members()[number].store().identity().scene else { return Ok(None) };
        let around = match identity.coupling {
            None => self.geometry(),
            Some(_) => {
                self.beside.get_or_init(|| self.members().iter().map(|of| self.beside(of)).collect())[number].as_ref()
            }
        };
        match around.filter(|geometry| geometry.fingerprint() == identity.fingerprint) {
            None => {
                let found = "a store, which holds what walls and luminaires do to light and not their shapes";
                refuse(found.into(), "relight the scene that it was baked of, or leave sun split out")
            }
            Some(geometry) => match geometry.keeps_lamps() {
                Some(why) => refuse(format!("a scene with {why}"), "leave it out"),
                None => Ok(Some(geometry)),
            },
        }
    }

    /// Walls with the volumes that are beside that of a member: other members, or volumes of its store. `None` where it was baked alone, or
    /// one of them cannot be read.
    fn beside(&self, of: &Member<'_>) -> Option<Geometry> {
        let partner = |known: &PartnerIdentity| {
            let member = self.members().iter().find(|member| member.name() == known.name);
            let (volume, pyramid) = match member.and_then(Member::shared) {
                Some(shared) => shared,
                None => {
                    let volume = Arc::new(of.store().of_volume(&known.name).ok()?.volume().ok()?);
                    let pyramid = Arc::new(Pyramid::new(&volume));
                    (volume, pyramid)
                }
            };
            let isovalue = IsovalueMap::from_knots(known.isovalues.clone());
            Some(Partner { name: known.name.clone(), volume, pyramid, isovalue, tint: known.tint })
        };
        let CouplingIdentity { coupling, name, place, tint, partners } = coupling_of(of.store())?.clone();
        let partners = partners.iter().map(partner).collect::<Option<Vec<_>>>()?;
        let walls = match self.geometry() {
            Some(geometry) => geometry.clone(),
            None => Geometry::new(Vec::new(), Vec::new(), 1.0).ok()?,
        };
        walls.with_partners(Among { name, place, coupling, tint }, partners).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Up;
    use crate::probe::{EnvironmentSource, LatLong, Orientation, Probe, SunOptions, split_sun};
    use crate::scene::geometry::{Finish, Luminaire, LuminaireShape, Shape, Wall};
    use crate::scene::medium::{Medium, Phase};
    use crate::surface::{Mesh, extract};
    use crate::volume::field;
    use glam::DVec3;
    use std::f64::consts::{FRAC_PI_2, PI};

    struct Subject {
        volume: Volume,
        pyramid: Pyramid,
        mesh: Mesh,
    }

    const ISOVALUE: f64 = 47.0;

    fn subject() -> Subject {
        let volume = field::by_name("bumpbox:16").unwrap().unwrap().sample().unwrap();
        let mut mesh = extract(&volume, ISOVALUE).unwrap();
        let some = |all: &[[f32; 3]]| all.iter().step_by(7).copied().collect::<Vec<_>>();
        (mesh.positions_in_grid, mesh.normals) = (some(&mesh.positions_in_grid), some(&mesh.normals));
        Subject { pyramid: Pyramid::new(&volume), mesh, volume }
    }

    /// A floor below the box, larger than it.
    fn around(albedo: [f32; 3], luminaires: Vec<Luminaire>) -> Geometry {
        let shape = Shape::Rectangle { corner: DVec3::new(-1.0, -1.0, -0.1), u: 3.0 * DVec3::X, v: 3.0 * DVec3::Y };
        let floor = Wall { name: "floor".into(), shape, finish: Finish::Diffuse(albedo) };
        Geometry::new(vec![floor], luminaires, 1.0).unwrap()
    }

    impl Subject {
        fn lit(&self, geometry: &Geometry, lamps: &[SunLight], albedo: [f32; 3], reflects: bool) -> Reflected {
            let Self { volume, pyramid, mesh } = self;
            let among = LitByPaths { volume, pyramid, geometry, isovalue: ISOVALUE, albedo, reflects };
            among.lit(lamps, (&mesh.positions_in_grid, &mesh.normals), 0.0).unwrap()
        }
    }

    /// Two suns of half of the sphere each are light of radiance 1 from everywhere: on white surfaces among white walls all is 1.
    #[test]
    fn in_a_furnace_among_walls_all_is_one() {
        let sun = |towards| SunLight {
            direction_in_world: towards,
            angular_radius: FRAC_PI_2,
            flux: [2.0 * PI; 3],
            rays: 64,
            shape: None,
        };
        let (subject, geometry) = (subject(), around([1.0; 3], Vec::new()));
        let found = subject.lit(&geometry, &[sun(DVec3::Z), sun(-DVec3::Z)], [1.0; 3], true);
        let count = found.radiance.len() as f64;
        let mean = found.radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * count);
        let error = found.variance.iter().map(|&v| f64::from(v)).sum::<f64>().sqrt() / count;
        // The trial stops at the aim, and what is stated is an upper bound. Rays lost at grazing starts are hits here and there.
        assert!((mean - 1.0).abs() < 4.0 * error + 0.003, "{mean} ± {error}");
        assert!(error * count.sqrt() < 2.0 * AIM, "{error}");
        // Without reflections by the surface there is less, and no more than what the sky and the floor send.
        let alone = subject.lit(&geometry, &[sun(DVec3::Z), sun(-DVec3::Z)], [1.0; 3], false);
        let less = alone.radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * count);
        assert!(less < mean - 0.02 && less > 0.5, "{less}");
    }

    /// Coloured lamps of an image over a coloured floor in fog, beside a lamp that is no matter of theirs, are what other paths find.
    #[test]
    fn they_are_what_paths_find_that_know_the_image() {
        let lamp = LuminaireShape::Sphere { centre: DVec3::new(0.5, 0.5, 1.6), radius: 0.1 };
        let lamp = Luminaire { name: "lamp".into(), shape: lamp, power: [5.0; 3] };
        let fog = Medium::constant("fog", 0.4, 0.8, Phase::Isotropic).unwrap();
        let geometry = around([0.7, 0.4, 0.2], vec![lamp]).with_media(vec![fog]).unwrap();
        let image = LatLong::from_fn(256, 128, |x, y| match (x, y) {
            (40..=44, 30..=33) => [900.0, 700.0, 300.0],
            (170..=180, 40..=48) => [30.0, 60.0, 90.0],
            _ => [0.2, 0.3, 0.4],
        });
        let (probe, orientation) = (Probe::from_image("lamps", image), Orientation::new(Up::Z, 0.0).unwrap());
        let split = split_sun(&probe, &SunOptions::default());
        assert!(split.suns.len() >= 2);
        let lamps: Vec<SunLight> = split.suns.iter().map(|s| SunLight::new(&s.sun, orientation, 64)).collect();
        let rest = &split.rest.image;
        let of_lamps = LatLong::from_fn(256, 128, |x, y| {
            [0, 1, 2].map(|c| f64::from(probe.image.row(y)[x][c]) - f64::from(rest.row(y)[x][c]))
        });
        let (subject, albedo) = (subject(), [0.8, 0.6, 0.4]);
        let found = subject.lit(&geometry, &lamps, albedo, true);
        let Subject { volume, pyramid, mesh } = &subject;
        let place = |(&position_in_grid, &normal)| SurfacePoint { position_in_grid, normal };
        let points: Vec<SurfacePoint> = mesh.positions_in_grid.iter().zip(&mesh.normals).map(place).collect();
        let settings = SceneReference { scales: vec![[0.0; 3]], ..SceneReference::new(1024, albedo, 9) };
        let source = EnvironmentSource::new(&of_lamps, orientation);
        let (truth, _) = direct(volume, pyramid, Some(&geometry), ISOVALUE, &points, &[&source], &settings).unwrap();
        let (mut squares, mut stated, mut off, mut all) = (0.0, 0.0, [0.0; 3], [0.0; 3]);
        for (i, truth) in truth[0].iter().enumerate() {
            stated += 3.0 * f64::from(found.channel_variance[i]);
            for c in 0..3 {
                let difference = f64::from(found.radiance[i][c]) - truth.mean[c];
                squares += difference * difference;
                stated += truth.stderr[c].powi(2);
                off[c] += difference;
                all[c] += truth.mean[c];
            }
        }
        let ratio = squares / stated;
        let percents = [0, 1, 2].map(|c| 100.0 * off[c] / all[c]);
        println!(
            "{percents:.2?} % off in the mean, mean square {ratio:.2} of what is stated, {} paths",
            found.rays_each
        );
        // A lamp has one colour, of its image each pixel its own: this one has one a lamp. Four standard errors of the sum, which each
        // channel has at most; and the mean square, of which 100 points of six degrees of freedom know 6 %.
        assert!(off.iter().all(|v| v.abs() < 4.0 * stated.sqrt()), "{off:?} {stated}");
        assert!((0.5..1.5).contains(&ratio), "{ratio}");
    }
}
