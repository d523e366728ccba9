//! The paths of one texel again, one by one.

use super::REPLICATES;
use super::bake::{Bake, estimates};
use super::path::{Alive, PointsTaken, Settings, TexelEstimate, continuation};
use super::scene_path::Among;
use crate::error::{Error, Result};
use crate::geom::Frame;
use crate::grid3;
use crate::level::{Counts, LevelField, Outcome, Site};
use crate::sampling::{PathSampler, warp};
use crate::scene::geometry::Geometry;
use crate::volume::{Sample, with_samples};
use serde_json::{Value, json};

/// What a path turned on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum On {
    /// A level set: that of the volume, 0, or of partner n − 1 of its geometry.
    LevelSet(usize),
    /// A part of a wall, diffuse, mirror or glass.
    Wall(u32),
    /// A medium, by its number in the geometry.
    Medium(usize),
}

/// How a path ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PathEnd {
    /// It left for the environment.
    Escaped,
    /// It was still travelling after the last stored layer.
    Trapped,
    /// At a hit without a normal before the last layer.
    Lost,
    /// On a cut through the solid at the border of a volume, or inside a solid.
    Cut,
    /// On a luminaire, by its place in the scene.
    Luminaire(usize),
    /// In a wall: it was black, or roulette ended the path.
    Absorbed,
    /// After the most turns, or the most mirrors and glass in a row.
    TooLong,
}

impl PathEnd {
    /// In a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Escaped => "escaped",
            Self::Trapped => "trapped",
            Self::Lost => "lost",
            Self::Cut => "cut",
            Self::Luminaire(_) => "luminaire",
            Self::Absorbed => "absorbed",
            Self::TooLong => "too long",
        }
    }
}

/// One path of a texel, step by step: for finding out why a texel is what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayedPath {
    /// Replicate and number of the path in it.
    pub replicate: usize,
    /// Point set index.
    pub path: u32,
    /// Grid positions (of the baked volume) of the texel and of where the path turned; one is repeated where a ray was lost.
    pub vertices_in_grid: Vec<[f32; 3]>,
    /// What it turned on, one entry a vertex; the first is the texel's own level set.
    pub on: Vec<On>,
    /// World direction of the last ray.
    pub last_direction_in_world: [f32; 3],
    /// How it ended.
    pub ended: PathEnd,
}

impl ReplayedPath {
    /// A path that starts at a texel.
    pub(super) fn new(replicate: usize, path: u32, start_in_grid: [f32; 3]) -> Self {
        Self {
            replicate,
            path,
            vertices_in_grid: vec![start_in_grid],
            on: vec![On::LevelSet(0)],
            last_direction_in_world: [0.0; 3],
            ended: PathEnd::Trapped,
        }
    }
}

/// A texel computed again.
#[derive(Clone, Debug)]
pub struct ReplayedTexel {
    /// Its point on its level set.
    pub site: Site,
    /// Its estimates before rounding, one a group ([`Bake::groups`]); empty where it has no light, inside another volume.
    pub estimates: Vec<TexelEstimate>,
    /// Its paths.
    pub paths: Vec<ReplayedPath>,
}

/// Computes one texel again as a bake does, and reports each of its paths; `None` where it has no level set.
///
/// # Errors
/// As [`super::bake()`]; a texel outside the texture.
pub fn replay_texel(bake: &Bake<'_>, texel: [usize; 3]) -> Result<Option<ReplayedTexel>> {
    let Some((site, paths)) = replay_paths(bake, texel)? else { return Ok(None) };
    let estimates = estimates(bake, &[(texel, bake.settings.rays)])?.swap_remove(0).unwrap_or_default();
    Ok(Some(ReplayedTexel { site, estimates, paths }))
}

/// The paths of one texel alone, without its estimates, and its point on its level set; `None` where it has none.
///
/// # Errors
/// As [`replay_texel`].
pub fn replay_paths(bake: &Bake<'_>, texel: [usize; 3]) -> Result<Option<(Site, Vec<ReplayedPath>)>> {
    bake.check()?;
    let m = bake.layout.lattice.texels();
    if (0..3).any(|a| texel[a] >= m[a]) {
        let expected = format!("indices below {},{},{}", m[0], m[1], m[2]);
        let given = format!("{},{},{}", texel[0], texel[1], texel[2]);
        return Err(Error::argument("texel", given, expected, "the texture is smaller"));
    }
    let item = (grid3::index([m[0], m[1]], texel)) as u64;
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let site = match bake.points {
            None => field.site(bake.layout.lattice.grid_from_texel(texel)),
            Some(points) => points.site(&field, bake.volume, texel[0]),
        };
        let Some(site) = site else { return Ok(None) };
        let paths = match bake.geometry {
            None => replay(&field, &site, item, bake.settings),
            Some(geometry) => Among::new(bake, &field, geometry)?.replay(&site, item),
        };
        Ok(Some((site, paths)))
    })
}

/// Traces the paths of one texel of a volume alone again, from the same numbers, and reports each.
///
/// With a target a texel may have got fewer paths than `settings.rays`: these are the first of each replicate.
pub fn replay<T: Sample>(field: &LevelField<'_, T>, site: &Site, item: u64, settings: &Settings) -> Vec<ReplayedPath> {
    let points = settings.points();
    let mut counts = Counts::default();
    let mut all = Vec::with_capacity(REPLICATES * points);
    for replicate in 0..REPLICATES {
        let sampler = PathSampler::new(settings.seed, item, replicate as u32);
        let first_record = all.len();
        let start = site.start.at.in_grid().to_array();
        all.extend((0..points as u32).map(|path| ReplayedPath::new(replicate, path, start)));
        // Bounce by bounce, because the points that a path takes depend on which paths are left.
        let mut taken = PointsTaken::default();
        let at_texel = Alive { point: 0, start: site.start, normal: site.normal };
        let mut alive: Vec<(usize, Alive)> = (0..points).map(|path| (first_record + path, at_texel)).collect();
        for k in 0..settings.layers.len() {
            let mut left = Vec::new();
            for (index, mut path) in alive {
                path.point = taken.point_for(k, path.point);
                let local = warp::square_to_cosine_hemisphere(sampler.pair(path.point, k as u32));
                let direction = Frame::around(path.normal).from_local(local);
                let record: &mut ReplayedPath = &mut all[index];
                record.last_direction_in_world = direction.to_array();
                let in_grid = field.direction_in_grid(direction);
                let outcome = field.trace(site.isovalue, &path.start, in_grid, &mut counts);
                match continuation(field, &path, outcome) {
                    Some(next) => {
                        record.vertices_in_grid.push(next.start.at.in_grid().to_array());
                        record.on.push(On::LevelSet(0));
                        left.push((index, next));
                    }
                    None if outcome == Outcome::Escaped => record.ended = PathEnd::Escaped,
                    None if k + 1 < settings.layers.len() => record.ended = PathEnd::Lost,
                    None => {}
                }
            }
            alive = left;
        }
    }
    all
}

impl On {
    /// What a path turned on, where that is not its own level set.
    pub fn name(self, geometry: Option<&Geometry>) -> String {
        match (self, geometry) {
            (Self::LevelSet(0), _) | (_, None) => String::new(),
            (Self::LevelSet(set), Some(geometry)) => {
                geometry.partners().get(set - 1).map_or(String::new(), |partner| format!(" {}", partner.name))
            }
            (Self::Wall(part), Some(_)) => format!(" wall {part}"),
            (Self::Medium(medium), Some(geometry)) => {
                geometry.media().get(medium).map_or(String::new(), |medium| format!(" {}", medium.name))
            }
        }
    }
}

impl PathEnd {
    /// Its name, or that of the luminaire that was met.
    pub fn name_in(self, geometry: Option<&Geometry>) -> String {
        match (self, geometry) {
            (Self::Luminaire(l), Some(geometry)) => {
                geometry.luminaires().get(l).map_or_else(|| self.name().into(), |luminaire| luminaire.name.clone())
            }
            _ => self.name().into(),
        }
    }
}

impl ReplayedPath {
    /// For programs.
    pub fn to_json(&self, geometry: Option<&Geometry>) -> Value {
        let mut json = json!({
            "replicate": self.replicate, "path": self.path, "ended": self.ended.name_in(geometry),
            "vertices_in_grid": self.vertices_in_grid, "last_direction_in_world": self.last_direction_in_world,
        });
        if geometry.is_some() {
            let names: Vec<String> = self.on.iter().map(|&on| on.name(geometry).trim().to_string()).collect();
            json["turned_on"] = json!(names);
        }
        json
    }
}
