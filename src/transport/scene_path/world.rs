//! What a ray meets: the level set of its isovalue, the walls, or the luminaires.
//!
//! The level set is followed inside the box of the volume by [`LevelField::trace`]; a ray that leaves the box never
//! comes back to it but by a wall. Walls and luminaires are met anywhere. Where a ray enters the box from outside in the
//! solid it meets the cut through it, which is black: the solid has no surface there.
//!
//! Walls flush with a face of the box count as outside: for walls, points of the level set lie a little within the box.
//!
//! Where volumes have partners a ray carries an isovalue for each of them, and the nearest of their level sets counts. A point
//! of one that lies in the solid of another is *buried*: no light reaches it.

use super::body::Inside;
use super::images;
use super::level_set::{Along, On, PartnerSet, Placement, Standing};
use super::media::Media;
use crate::geom::{Affine, Normal};
use crate::level::{CellPoint, Counts, LevelField, Start};
use crate::scene::geometry::{FlatMirror, Geometry, LightHit, Partner, WallHit};
use crate::volume::{Sample, Volume, with_samples};
use glam::DVec3;

/// A place where paths turn.
#[derive(Clone, Copy)]
pub(in super::super) enum Place {
    /// On a level set: that of the volume, 0, or of partner n − 1.
    Level(usize, Start),
    /// On a part of a wall.
    Wall(u32),
    /// In a medium, on the lit side of all level sets.
    Medium,
    /// Anywhere else: luminaires, cameras.
    Free,
}

/// Where a ray starts.
#[derive(Clone, Copy)]
pub(in super::super) struct Origin {
    pub(in super::super) place: Place,
    pub(in super::super) in_world: DVec3,
}

/// What a ray meets first.
pub(in super::super) enum Met {
    /// The environment.
    Nothing,
    /// Its level set, 0, or that of partner n − 1.
    Level(usize, CellPoint),
    /// The facet under a smoothed normal, or solid around a wall.
    Lost,
    /// A cut through the solid at the border of the box, so far away; or the solid of a partner, around a point of a level set.
    Cut(f64),
    Wall(WallHit),
    Luminaire(LightHit),
}

/// Work by kind of ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneCounts {
    /// Rays of paths.
    pub path_rays: u64,
    /// Rays to luminaires.
    pub light_rays: u64,
    /// Rays that were tried against walls, of both kinds.
    pub wall_rays: u64,
    /// Paths' meetings with diffuse walls from which they go on.
    pub wall_hits: u64,
    /// Paths' meetings with mirrors and glass.
    pub specular_hits: u64,
    /// Paths that ended on a luminaire.
    pub luminaire_hits: u64,
    /// Paths that ended on a cut through the solid, or inside it.
    pub cut: u64,
    /// Rays of both kinds that came into the box of a partner.
    pub partner_rays: u64,
    /// Paths' meetings with level sets of partners.
    pub partner_hits: u64,
    /// Texels inside the solid of a partner: they have no surface.
    pub buried: u64,
    /// Paths that were cut at the most mirrors and glass in a row; what light they had ahead of them is missing.
    pub lost_specular: u64,
    /// Parts of rays, of both kinds, that were followed through a medium.
    pub medium_rays: u64,
    /// Cells of fields that these passed.
    pub medium_cells: u64,
    /// Meetings of paths with media.
    pub collisions: u64,
    /// Times that paths entered the translucent solid.
    pub entries: u64,
    /// Paths that were cut at the most turns; what light they had ahead of them is missing.
    pub lost_turns: u64,
}

impl SceneCounts {
    /// Rays of paths that go on from walls.
    pub fn wall_rays_started(&self) -> u64 {
        self.wall_hits + self.specular_hits
    }
}

impl std::ops::AddAssign for SceneCounts {
    fn add_assign(&mut self, other: Self) {
        self.path_rays += other.path_rays;
        self.light_rays += other.light_rays;
        self.wall_rays += other.wall_rays;
        self.wall_hits += other.wall_hits;
        self.specular_hits += other.specular_hits;
        self.luminaire_hits += other.luminaire_hits;
        self.cut += other.cut;
        self.partner_rays += other.partner_rays;
        self.partner_hits += other.partner_hits;
        self.buried += other.buried;
        self.lost_specular += other.lost_specular;
        self.medium_rays += other.medium_rays;
        self.medium_cells += other.medium_cells;
        self.collisions += other.collisions;
        self.entries += other.entries;
        self.lost_turns += other.lost_turns;
    }
}

/// The isovalue of a ray in raw samples of the volume, then of each partner.
pub(in super::super) type Isovalues = Vec<f32>;

/// All that a ray can meet.
pub(in super::super) struct World<'a, T> {
    pub(in super::super) field: &'a LevelField<'a, T>,
    pub(in super::super) geometry: &'a Geometry,
    volume: &'a Volume,
    pub(super) placement: Placement,
    partners: Vec<Box<dyn PartnerSet + 'a>>,
    /// Those in which images of luminaires are looked for.
    pub(super) mirrors: Vec<FlatMirror>,
    /// What lies between surfaces.
    pub(super) media: Media<'a>,
    /// The solid of the volume, where it is translucent.
    pub(super) body: Option<Inside<'a, T>>,
}

impl<'a, T: Sample> World<'a, T> {
    pub(in super::super) fn new(volume: &'a Volume, field: &'a LevelField<'a, T>, geometry: &'a Geometry) -> Self {
        let partner = |partner: &'a Partner| -> Box<dyn PartnerSet + 'a> {
            let (volume, pyramid) = (&*partner.volume, &*partner.pyramid);
            with_samples!(volume.samples(), s => {
                let field = LevelField::new(volume, s, pyramid);
                Box::new(Standing { field, placement: Placement::new(volume) })
            })
        };
        let partners = geometry.partners().iter().map(partner).collect();
        Self {
            field,
            geometry,
            volume,
            placement: Placement::new(volume),
            partners,
            mirrors: images::mirrors(geometry),
            media: Media::new(geometry.media(), volume, field.pyramid(), geometry),
            body: geometry.body().map(|body| Inside::new(body, volume, field, geometry)),
        }
    }

    /// Of the baked volume.
    pub(super) fn grid_from_world(&self) -> Affine {
        self.volume.world_from_grid().inverse()
    }

    /// The isovalues of a ray, from that of the volume in raw samples.
    pub(in super::super) fn isovalues(&self, raw: f32) -> Isovalues {
        let value = self.volume.value_from_raw(f64::from(raw));
        let of_partner = |p: &Partner| p.volume.raw_from_value(p.isovalue.at(value)) as f32;
        std::iter::once(raw).chain(self.geometry.partners().iter().map(of_partner)).collect()
    }

    /// Factor on the albedo of a level set.
    pub(in super::super) fn tint(&self, set: usize) -> [f32; 3] {
        match set.checked_sub(1) {
            Some(partner) => self.geometry.partners()[partner].tint,
            None => self.geometry.tint(),
        }
    }

    /// A start on a level set and its place in world.
    pub(in super::super) fn on_level(&self, set: usize, start: Start) -> Origin {
        let placement = set.checked_sub(1).map_or(&self.placement, |partner| self.partners[partner].place());
        Origin { place: Place::Level(set, start), in_world: placement.on_level(&start) }
    }

    /// Outward normal that a point of a level set is shaded about where it is looked at.
    pub(in super::super) fn smoothed_normal(&self, set: usize, at: &CellPoint) -> Option<Normal> {
        match set.checked_sub(1) {
            Some(partner) => self.partners[partner].smoothed_normal_at(at),
            None => self.field.normal(at),
        }
    }

    /// Outward normal of a point where a path met a level set.
    pub(in super::super) fn normal(&self, set: usize, at: &CellPoint) -> Option<Normal> {
        match set.checked_sub(1) {
            Some(partner) => self.partners[partner].normal_at(at),
            None => self.field.hit_normal(at),
        }
    }

    /// Whether a point of the volume's level set lies in the solid of a partner.
    pub(in super::super) fn is_buried(&self, isovalues: &[f32], point: DVec3) -> bool {
        self.partners.iter().zip(&isovalues[1..]).any(|(partner, &isovalue)| partner.is_buried(isovalue, point))
    }

    /// The first thing on a ray of unit direction.
    pub(in super::super) fn meet(
        &self,
        isovalues: &[f32],
        from: &Origin,
        direction: DVec3,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Met {
        counts.path_rays += 1;
        let (mut limit, mut found) = (f64::INFINITY, Met::Nothing);
        for (set, &isovalue) in isovalues.iter().enumerate() {
            match self.along(set, isovalue, from, direction, limit, level, counts) {
                Along::Nothing => {}
                Along::Hit(cell, distance) if distance < limit => (limit, found) = (distance, Met::Level(set, cell)),
                Along::Cut(distance) if distance < limit => (limit, found) = (distance, Met::Cut(distance)),
                Along::Hit(..) | Along::Cut(_) => {}
                // A point of another level set around which there is solid, or one of its own.
                Along::Lost => match from.place {
                    Place::Level(own, _) if own != set => return Met::Cut(0.0),
                    _ => return Met::Lost,
                },
            }
        }
        counts.partner_hits += u64::from(matches!(found, Met::Level(set, _) if set > 0));
        let own = if let Place::Wall(part) = from.place { Some(part) } else { None };
        let mut nearest = limit;
        if self.geometry.parts() > 0 {
            counts.wall_rays += 1;
            if let Some(hit) = self.geometry.first_wall(from.in_world, direction, own, limit) {
                nearest = hit.distance;
                found = Met::Wall(hit);
            }
        }
        match self.geometry.first_luminaire(from.in_world, direction, nearest) {
            Some(hit) if hit.distance < limit => Met::Luminaire(hit),
            _ => found,
        }
    }

    /// Whether light of luminaire `l`, or of the environment, reaches a point along a direction from a distance.
    pub(in super::super) fn sees(
        &self,
        isovalues: &[f32],
        from: &Origin,
        l: Option<usize>,
        direction: DVec3,
        distance: f64,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> bool {
        counts.light_rays += 1;
        let own = if let Place::Wall(part) = from.place { Some(part) } else { None };
        if self.geometry.parts() > 0 {
            counts.wall_rays += 1;
            if self.geometry.is_walled(from.in_world, direction, own, distance) {
                return false;
            }
        }
        if self.geometry.is_shaded_by_luminaires(l, from.in_world, direction, distance) {
            return false;
        }
        isovalues.iter().enumerate().all(|(set, &isovalue)| {
            match self.along(set, isovalue, from, direction, distance, level, counts) {
                Along::Nothing => true,
                Along::Hit(_, hit) => hit >= distance,
                Along::Cut(cut) => cut >= distance,
                Along::Lost => false,
            }
        })
    }

    /// How far a ray goes to what it meets.
    pub(super) fn distance_to(&self, met: &Met, from: &Origin, direction: DVec3) -> f64 {
        match met {
            Met::Nothing => f64::INFINITY,
            Met::Lost => 0.0,
            Met::Cut(distance) => *distance,
            Met::Wall(hit) => hit.distance,
            Met::Luminaire(hit) => hit.distance,
            Met::Level(set, cell) => {
                (self.on_level(*set, Start::on(*cell)).in_world - from.in_world).dot(direction).max(0.0)
            }
        }
    }

    /// What one level set alone does to a ray before `limit`.
    fn along(
        &self,
        set: usize,
        isovalue: f32,
        from: &Origin,
        direction: DVec3,
        limit: f64,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Along {
        let on = match from.place {
            Place::Level(own, start) if own == set => On::Surface(start),
            Place::Medium => On::Lit,
            _ => On::Anywhere,
        };
        let Some(partner) = set.checked_sub(1) else {
            return self.placement.along(self.field, isovalue, on, from.in_world, direction, limit, level);
        };
        let before = level.rays;
        let found = self.partners[partner].meet_along(isovalue, on, from.in_world, direction, limit, level);
        counts.partner_rays += level.rays - before;
        found
    }
}
