//! From photons to irradiance.

use super::map::PhotonMap;
use super::packing::Photon;
use super::tree::{Nearest, Tree};
use crate::geom::{Frame, Normal};
use crate::level::{CellPoint, LevelField};
use crate::sampling::warp;
use crate::volume::Sample;
use glam::{DVec3, Vec3};

/// How the density of photons is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Density {
    /// By the ellipsoid that the search covers, κ_eff = √(κ² + 1/g²), cut by the box and the isovalues drawn, without the
    /// photon whose distance is the radius.
    #[default]
    Tilted,
    /// As published without clipping (Beason 2005, eq. 4.9): a ball in position and isovalue, ΔV = 4/3 π d³/κ, all photons counted.
    /// Reads κg/√(1+κ²g²) of the truth, g the slope of the field. For study.
    Published,
    /// As published and recommended there (eq. 4.10): the ball between the lowest and the highest isovalue that were found. The
    /// print lacks 1/κ, which is put in; with many photons it reads 2/(3 − t²) of the truth, t = κg/√(1+κ²g²). For study.
    PublishedClipped,
}

/// How photons are searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonSearch {
    /// How many nearest photons: at least 2.
    pub neighbours: u32,
    /// Most distance, in diagonals of the box.
    pub most_radius: f32,
    /// Photons count only where the cosine between their normal and the one asked for is at least this.
    pub normal_cosine: f32,
    /// How their density is read.
    pub density: Density,
}

impl PhotonSearch {
    /// For light by way of mirrors and glass, which has edges: 64 nearest within a third of the usual distance.
    pub fn of_caustics() -> Self {
        let usual = Self::default();
        Self { neighbours: 64, most_radius: usual.most_radius / 3.0, ..usual }
    }
}

impl Default for PhotonSearch {
    /// 128 photons within a tenth of the diagonal, normals within 60°.
    fn default() -> Self {
        Self { neighbours: 128, most_radius: 0.1, normal_cosine: 0.5, density: Density::Tilted }
    }
}

/// Irradiance of a point, per channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// The estimate.
    pub mean: [f64; 3],
    /// Variance of a sum of as many independent photons.
    pub variance: [f64; 3],
    /// Distance searched, in diagonals of the box.
    pub radius: f64,
    /// Photons that count.
    pub photons: u32,
}

/// A place at which light is asked for, in the space of the photons.
pub(super) struct Query {
    position: DVec3,
    share: f64,
    normal: Normal,
    slope: f64,
}

/// What a search found: the photons that count, and what the sum of their flux-heights is divided by.
pub(super) struct Found {
    pub(super) measure: f64,
    pub(super) radius: f64,
}

/// Photons among which to search.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    /// All that are kept but caustics.
    Usual,
    /// Of light by way of mirrors and glass alone.
    Caustic,
}

impl PhotonMap {
    /// Irradiance at a point of the level set of the raw isovalue, whose normal is given.
    pub(super) fn irradiance<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        at: &CellPoint,
        raw_isovalue: f64,
        normal: Normal,
        kind: Kind,
        search: &PhotonSearch,
        nearest: &mut Nearest,
    ) -> Irradiance {
        let mut found = Irradiance::default();
        if self.photons_of(kind).is_empty() {
            return found;
        }
        let query = self.query(field, at, raw_isovalue, normal);
        let Some(all) = self.find_near(&query, kind, search, nearest) else { return found };
        self.for_counted(&query, kind, search, nearest, &mut |photon| {
            found.photons += 1;
            let flux = photon.flux_of();
            for c in 0..3 {
                found.mean[c] += flux[c];
                found.variance[c] += flux[c] * flux[c];
            }
        });
        found.radius = all.radius;
        found.mean = found.mean.map(|v| v / all.measure);
        found.variance = found.variance.map(|v| v / (all.measure * all.measure));
        found
    }

    pub(super) fn query<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        at: &CellPoint,
        raw_isovalue: f64,
        normal: Normal,
    ) -> Query {
        self.query_of(at.in_grid().as_dvec3(), field.raw_gradient(at), raw_isovalue, normal)
    }

    /// The same from the gradient of the raw samples, in grid space.
    pub(super) fn query_of(&self, in_grid: DVec3, raw_gradient: Vec3, raw_isovalue: f64, normal: Normal) -> Query {
        Query {
            position: self.space.unit_from_grid(in_grid),
            share: self.space.share_from_raw(raw_isovalue),
            normal,
            slope: self.space.slope(raw_gradient),
        }
    }

    fn tree(&self, kind: Kind) -> &Tree<Photon> {
        match kind {
            Kind::Usual => &self.tree,
            Kind::Caustic => &self.caustics,
        }
    }

    pub(super) fn photons_of(&self, kind: Kind) -> &[Photon] {
        self.tree(kind).in_order()
    }

    /// Finds the nearest photons; `None` where there are none.
    pub(super) fn find_near(
        &self,
        query: &Query,
        kind: Kind,
        search: &PhotonSearch,
        nearest: &mut Nearest,
    ) -> Option<Found> {
        let [x, y, z] = query.position.as_vec3().to_array();
        let at = [x, y, z, (f64::from(self.settings.gamma) * query.share) as f32];
        let most = search.most_radius * search.most_radius;
        self.tree(kind).nearest(at, search.neighbours as usize, most, nearest);
        let radius = if nearest.len() < search.neighbours as usize {
            f64::from(search.most_radius)
        } else {
            f64::from(nearest.farthest()?.0).sqrt()
        };
        let measure = match search.density {
            Density::Tilted => self.measure(query, radius),
            Density::Published => ball(radius) / f64::from(self.settings.gamma),
            Density::PublishedClipped => {
                let own = at[3];
                let heights = nearest.places().map(|(_, place)| self.photons_of(kind)[place].point[3] - own);
                let (low, high) =
                    heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
                let upto = |h: f32| {
                    let h = f64::from(h).clamp(-radius, radius);
                    std::f64::consts::PI * (radius * radius * h - h * h * h / 3.0)
                };
                (upto(high) - upto(low)) / f64::from(self.settings.gamma)
            }
        };
        (nearest.len() > 0 && measure > 0.0).then_some(Found { measure, radius })
    }

    /// Calls for every photon found that counts: those of the normal asked for; not the last, whose distance was taken for the
    /// radius, but where densities are read as published.
    pub(super) fn for_counted(
        &self,
        query: &Query,
        kind: Kind,
        search: &PhotonSearch,
        nearest: &Nearest,
        visit: &mut dyn FnMut(&Photon),
    ) {
        let all_count = search.density != Density::Tilted || nearest.len() < search.neighbours as usize;
        let last = if all_count { None } else { nearest.farthest() };
        for (_, place) in nearest.places() {
            let photon = &self.photons_of(kind)[place];
            let counts = last.is_none_or(|l| l.1 != place);
            if counts && photon.normal().dot(query.normal.vec()) >= search.normal_cosine {
                visit(photon);
            }
        }
    }

    /// Area times isovalue that a search of this radius covers: g times the volume of the ellipsoid.
    fn measure(&self, query: &Query, radius: f64) -> f64 {
        let kappa = f64::from(self.settings.gamma);
        let g = query.slope;
        if g <= 0.0 {
            return 0.0;
        }
        // Half of the ellipsoid's thickness, over which the isovalue changes by g times as much.
        let half = radius / (1.0 + kappa * kappa * g * g).sqrt();
        let reach = (half * g).max(f64::MIN_POSITIVE);
        let [low, high] = self.drawn.map(|bound| ((bound - query.share) / reach).clamp(-1.0, 1.0));
        let drawn = below(high) - below(low);
        let inside = if self.space.holds_ball(query.position, radius) {
            1.0
        } else {
            self.share_in_box(query, radius, half, [low, high])
        };
        ball(radius) / (kappa * kappa + 1.0 / (g * g)).sqrt() * drawn * inside
    }

    /// Share of an ellipsoid between two heights (from −1 to 1 along the gradient) that lies in the box, by points.
    fn share_in_box(&self, query: &Query, radius: f64, half: f64, heights: [f64; 2]) -> f64 {
        const LAYERS: usize = 8;
        const ACROSS: usize = 8;
        let frame = Frame::around(query.normal);
        let (mut inside, mut all) = (0.0, 0.0);
        for layer in 0..LAYERS {
            let height = heights[0] + (heights[1] - heights[0]) * (layer as f64 + 0.5) / LAYERS as f64;
            let square = (1.0 - height * height).max(0.0);
            // The normal points to the lit side: against the gradient where larger samples are solid.
            let middle = query.position - frame.normal.as_dvec3() * (half * height * self.sign);
            for i in 0..ACROSS * ACROSS {
                let u = [(i % ACROSS) as f32 + 0.5, (i / ACROSS) as f32 + 0.5].map(|v| v / ACROSS as f32);
                let disk = warp::square_to_uniform_disk(u).as_dvec2() * (radius * square.sqrt());
                let at = middle + frame.tangent.as_dvec3() * disk.x + frame.bitangent.as_dvec3() * disk.y;
                all += square;
                if self.space.box_contains(at) {
                    inside += square;
                }
            }
        }
        if all > 0.0 { inside / all } else { 1.0 }
    }
}

fn ball(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius
}

/// Share of a ball below a height in [−1, 1].
fn below(height: f64) -> f64 {
    0.5 + 0.25 * height * (3.0 - height * height)
}
