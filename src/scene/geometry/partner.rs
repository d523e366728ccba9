//! Other volumes whose level sets stand in the same world as the one that is baked.

use super::Geometry;
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::scene::coupling::IsovalueMap;
use crate::volume::Volume;
use std::sync::Arc;

/// Most partners of a volume: each is asked by every ray.
#[doc(hidden)]
pub const MOST_PARTNERS: usize = 7;

/// A volume beside the one that is baked: its level set of the isovalue that belongs to that of the ray.
#[derive(Clone, Debug)]
#[doc(hidden)]
pub struct Partner {
    /// Its name in the scene.
    pub name: String,
    /// The volume, where it stands in the world.
    pub volume: Arc<Volume>,
    /// Of that volume.
    pub pyramid: Arc<Pyramid>,
    /// From an isovalue of the baked volume, in the values of its file, to this one's.
    pub isovalue: IsovalueMap,
    /// Factor on the albedo in red, green and blue, in [0, 1].
    pub tint: [f32; 3],
}

/// The baked volume among its partners.
#[derive(Clone, Debug, PartialEq)]
#[doc(hidden)]
pub struct Among {
    /// Its name in the scene.
    pub name: String,
    /// Its place in the scene, from 0.
    pub place: usize,
    /// What couples the isovalues, for people.
    pub coupling: String,
    /// Factor on its albedo in red, green and blue, in [0, 1].
    pub tint: [f32; 3],
}

impl Geometry {
    /// The same walls and luminaires around a volume among partners, whose order does not count, in the place of those that it had.
    ///
    /// # Errors
    /// When a factor is outside [0, 1], two partners have one name, there are too many, or a partner has no cells.
    #[doc(hidden)]
    pub fn with_partners(mut self, among: Among, mut partners: Vec<Partner>) -> Result<Self> {
        for (name, tint) in partners.iter().map(|p| (p.name.as_str(), p.tint)).chain([(&*among.name, among.tint)]) {
            if !tint.iter().all(|v| (0.0..=1.0).contains(v)) {
                let remedy = "a surface cannot reflect more light than it receives";
                return Err(Error::argument(format!("albedo of {name}"), format!("{tint:?}"), "0 to 1", remedy));
            }
        }
        if partners.len() > MOST_PARTNERS {
            return Err(Error::Limit {
                what: "the scene".into(),
                needed: format!("{} volumes", partners.len() + 1),
                limit: format!("{} volumes", MOST_PARTNERS + 1),
                remedy: "leave some out".into(),
            });
        }
        if self.body.is_some() && !partners.is_empty() {
            let remedy = "leave the other volumes out, or make them walls: shape = \"isosurface\"";
            return Err(Error::argument("translucent", "a scene of several volumes", "one volume alone", remedy));
        }
        partners.iter().try_for_each(|p| p.volume.check_cells())?;
        partners.sort_by(|a, b| a.name.cmp(&b.name));
        let names: Vec<&str> = partners.iter().map(|p| p.name.as_str()).chain([&*among.name]).collect();
        if let Some(twice) = (1..names.len()).find(|&i| names[..i].contains(&names[i])) {
            return Err(Error::argument("volumes", names[twice], "names that differ", "give each its own"));
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.of_walls.as_bytes());
        hasher.update(format!("{:?}", among.tint).as_bytes());
        for partner in &partners {
            let Partner { name, volume, isovalue, tint, .. } = partner;
            hasher.update(format!("{name} {:?} {tint:?} {:?}", volume.solid, isovalue.knots()).as_bytes());
            hasher.update(volume.content_hash().as_bytes());
        }
        self.of_surfaces = hasher.finalize().to_hex().to_string();
        self.name_all();
        (self.among, self.partners) = (Some(among), partners);
        Ok(self)
    }

    /// The volumes beside the baked one, by name.
    #[doc(hidden)]
    pub fn partners(&self) -> &[Partner] {
        &self.partners
    }

    /// Factor on the albedo of the baked volume.
    #[doc(hidden)]
    pub fn tint(&self) -> [f32; 3] {
        self.among.as_ref().map_or([1.0; 3], |among| among.tint)
    }

    /// The baked volume among its partners; `None` where it stands alone.
    #[doc(hidden)]
    pub fn among(&self) -> Option<&Among> {
        self.among.as_ref()
    }
}
