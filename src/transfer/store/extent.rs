//! How far a chunk was baked: claims about its texels, each of which stays true when others are added.
//!
//! A texel only ever gets better: a bake that goes on replaces it by an estimate of more rays or leaves it. So what
//! was once reached for an isosurface is never lost to a later bake for another, and the record does not depend on
//! the order in which isosurfaces were asked for.

use crate::error::{Error, Result};
use crate::transfer::Octants;
use serde_json::{Value, json};

/// A standard error to stop at, and of what.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorTarget {
    /// The standard error.
    pub error: f64,
    /// The name of the number that has it: two targets are compared only if their names agree.
    pub of: String,
}

/// A claim: the texels that lookups on some isosurface read, as far as they lie in the chunk, are baked this well.
#[derive(Clone, Debug, PartialEq)]
pub struct Baked {
    /// The isovalue in the file's values; `None` for every isosurface.
    pub isovalue: Option<f64>,
    /// Rays a texel; the most that a texel gets where texels decide for themselves.
    pub rays: u32,
    /// The standard error at which texels may stop before `rays`.
    pub target: Option<ErrorTarget>,
}

impl Baked {
    /// Of an isosurface, however well: every other claim of it covers this one.
    pub fn any(isovalue: Option<f64>) -> Self {
        Self { isovalue, rays: 0, target: None }
    }

    /// Whether this claim implies another.
    pub fn covers(&self, other: &Self) -> bool {
        let error = match (&self.target, &other.target) {
            (None, _) => true,
            (Some(_), None) => other.rays == 0,
            (Some(have), Some(want)) => have.of == want.of && have.error <= want.error,
        };
        (self.isovalue.is_none() || self.isovalue == other.isovalue) && self.rays >= other.rays && error
    }

    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let isovalue = |b: &Self| b.isovalue.unwrap_or(f64::NEG_INFINITY);
        let error = |b: &Self| b.target.as_ref().map_or(0.0, |t| t.error);
        let of = |b: &Self| b.target.as_ref().map_or(String::new(), |t| t.of.clone());
        let by_quality = self.rays.cmp(&other.rays).then(error(self).total_cmp(&error(other)));
        isovalue(self).total_cmp(&isovalue(other)).then(by_quality).then_with(|| of(self).cmp(&of(other)))
    }

    fn to_json(&self) -> Value {
        let (error, of) = self.target.as_ref().map(|t| (t.error, &t.of)).unzip();
        json!({ "isovalue": self.isovalue, "rays": self.rays, "error": error, "error_of": of })
    }

    fn from_json(record: &Value) -> Option<Self> {
        let optional = |value: &Value| match value {
            Value::Null => Some(None),
            number => number.as_f64().map(Some),
        };
        let target = match (optional(&record["error"])?, &record["error_of"]) {
            (None, Value::Null) => None,
            (Some(error), Value::String(of)) => Some(ErrorTarget { error, of: of.clone() }),
            _ => return None,
        };
        let rays = record["rays"].as_u64()?.try_into().ok()?;
        Some(Self { isovalue: optional(&record["isovalue"])?, rays, target })
    }
}

/// All that is claimed of a chunk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChunkExtent {
    // Invariant: ascending by isovalue (every isosurface first), rays, error; none covers another.
    claims: Vec<Baked>,
    // Claims about some octants only, where several processes bake one chunk. Invariant: ascending as `claims`, each once, no set
    // empty or whole, none covered by a claim.
    parts: Vec<(Baked, Octants)>,
}

impl ChunkExtent {
    /// One claim.
    pub fn new(isovalue: Option<f64>, rays: u32, target: Option<ErrorTarget>) -> Self {
        Self { claims: vec![Baked { isovalue, rays, target }], parts: Vec::new() }
    }

    /// The claims, ascending by isovalue, those for every isosurface first; none covers another.
    pub fn claims(&self) -> &[Baked] {
        &self.claims
    }

    /// Whether a claim follows from those made.
    pub fn covers(&self, asked: &Baked) -> bool {
        self.claims.iter().any(|have| have.covers(asked))
    }

    /// Adds a claim.
    pub fn add(&mut self, claim: Baked) {
        if self.covers(&claim) {
            return;
        }
        self.claims.retain(|old| !claim.covers(old));
        self.parts.retain(|(old, _)| !claim.covers(old));
        let place = self.claims.partition_point(|old| old.order(&claim).is_lt());
        self.claims.insert(place, claim);
    }

    /// The octants for which a claim follows from those made.
    pub fn octants_of(&self, asked: &Baked) -> Octants {
        if self.covers(asked) {
            return Octants::ALL;
        }
        let parts = self.parts.iter().filter(|(have, _)| have.covers(asked));
        parts.fold(Octants::NONE, |all, (_, octants)| all.with(*octants))
    }

    /// Adds a claim about some octants; once all have it, it is one about the chunk.
    pub fn add_part(&mut self, claim: Baked, octants: Octants) {
        if self.octants_of(&claim).contain(octants) {
            return;
        }
        let known = self.parts.iter().position(|(old, _)| *old == claim);
        let octants = known.map_or(octants, |i| self.parts.remove(i).1.with(octants));
        if octants == Octants::ALL {
            return self.add(claim);
        }
        self.parts.retain(|(old, held)| !(claim.covers(old) && octants.contain(*held)));
        let place = self.parts.partition_point(|(old, _)| old.order(&claim).is_lt());
        self.parts.insert(place, (claim, octants));
    }

    /// What was asked of a chunk that claims this: claims about octants count as claims about all of it.
    #[must_use]
    pub fn asked(&self) -> Self {
        let mut all = Self { claims: self.claims.clone(), parts: Vec::new() };
        self.parts.iter().for_each(|(claim, _)| all.add(claim.clone()));
        all
    }

    /// Whether it claims anything about some octants only.
    pub fn is_partial(&self) -> bool {
        !self.parts.is_empty()
    }

    /// The claims as they stand in the record of a chunk.
    pub(super) fn to_json(&self) -> Value {
        let part = |(claim, octants): &(Baked, Octants)| {
            let mut record = claim.to_json();
            record["octants"] = json!(octants.bits());
            record
        };
        self.claims.iter().map(Baked::to_json).chain(self.parts.iter().map(part)).collect()
    }

    /// Reads what [`Self::to_json`] wrote.
    pub(super) fn from_json(record: &Value) -> Option<Self> {
        let mut extent = Self::default();
        for record in record.as_array()? {
            let claim = Baked::from_json(record)?;
            match &record["octants"] {
                Value::Null => extent.add(claim),
                octants => extent.add_part(claim, Octants::from_bits(octants.as_u64()?.try_into().ok()?)),
            }
        }
        Some(extent)
    }

    /// Reads the record of a chunk of format 1: one claim for all isosurfaces, or one for each of a list.
    pub(super) fn from_first_format(record: &Value) -> Option<Self> {
        let isovalues = match &record["isovalues"] {
            Value::String(all) if all == "all" => vec![None],
            Value::Array(list) => list.iter().map(|v| v.as_f64().map(Some)).collect::<Option<_>>()?,
            _ => return None,
        };
        let target = match &record["error_target"] {
            Value::Null => None,
            error => Some(ErrorTarget { error: error.as_f64()?, of: "the error of format 1".into() }),
        };
        let rays = record["rays"].as_u64()?.try_into().ok()?;
        let mut extent = Self::default();
        isovalues.into_iter().for_each(|isovalue| extent.add(Baked { isovalue, rays, target: target.clone() }));
        Some(extent)
    }

    /// Adds all claims of another extent.
    pub fn join(&mut self, other: &Self) {
        other.claims.iter().for_each(|claim| self.add(claim.clone()));
        other.parts.iter().for_each(|(claim, octants)| self.add_part(claim.clone(), *octants));
    }

    pub(super) fn check(&self) -> Result<()> {
        let claims = self.claims.iter().chain(self.parts.iter().map(|(claim, _)| claim));
        let numbers = claims.flat_map(|c| c.isovalue.into_iter().chain(c.target.as_ref().map(|t| t.error)));
        match numbers.into_iter().find(|v| !v.is_finite()) {
            None => Ok(()),
            Some(bad) => Err(Error::argument("extent", bad, "finite isovalues and error target", "check the options")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(isovalue: Option<f64>, rays: u32, error: Option<f64>) -> Baked {
        Baked { isovalue, rays, target: error.map(|error| ErrorTarget { error, of: "escape".into() }) }
    }

    #[test]
    fn any_order_of_claims_gives_the_same_record() {
        let claims = [
            claim(Some(30.0), 16, None),
            claim(Some(30.0), 64, None),
            claim(Some(-2.5), 64, None),
            claim(Some(60.0), 4096, Some(0.01)),
            claim(Some(60.0), 4096, Some(0.02)),
            claim(None, 16, None),
        ];
        let mut seen = Vec::new();
        for turn in 0..claims.len() {
            let mut extent = ChunkExtent::default();
            (0..claims.len()).for_each(|i| extent.add(claims[(i * 5 + turn) % claims.len()].clone()));
            assert!(claims.iter().all(|c| extent.covers(c)));
            assert_eq!(ChunkExtent::from_json(&extent.to_json()), Some(extent.clone()));
            seen.push(extent);
        }
        // 30 at 16 follows from 30 at 64, and 60 at 0.02 from 60 at 0.01.
        assert_eq!(seen[0].claims().len(), 4);
        assert!(seen.iter().all(|extent| *extent == seen[0]));
    }

    #[test]
    fn claims_about_octants_become_one_about_the_chunk() {
        let asked = claim(Some(30.0), 64, None);
        let (low, high) = (Octants::from_bits(0x0f), Octants::from_bits(0xf0));
        let whole = ChunkExtent::new(Some(30.0), 64, None);
        for order in [[low, high], [high, low]] {
            let mut extent = ChunkExtent::default();
            extent.add_part(asked.clone(), order[0]);
            assert!(!extent.covers(&asked) && extent.is_partial() && extent.asked() == whole);
            assert_eq!(extent.octants_of(&claim(Some(30.0), 16, None)), order[0]);
            assert_eq!(extent.octants_of(&claim(Some(30.0), 128, None)), Octants::NONE);
            assert_eq!(ChunkExtent::from_json(&extent.to_json()), Some(extent.clone()));
            // Of two stores that were baked apart.
            let mut other = ChunkExtent::default();
            other.add_part(asked.clone(), order[1]);
            extent.join(&other);
            assert_eq!(extent, whole);
        }
        // What a better claim says already is not said twice.
        let mut extent = ChunkExtent::default();
        extent.add_part(asked.clone(), low);
        extent.add_part(claim(Some(30.0), 16, None), low);
        extent.add_part(asked.clone(), Octants::NONE);
        assert_eq!(extent.to_json().as_array().map(Vec::len), Some(1));
        extent.add(claim(None, 64, None));
        assert!(!extent.is_partial());
        let damaged = json!([{ "isovalue": 1.0, "rays": 4, "error": null, "error_of": null, "octants": 256 }]);
        assert_eq!(ChunkExtent::from_json(&damaged), None);
    }

    #[test]
    fn records_of_the_first_format_are_read() {
        let list = json!({ "isovalues": [30.0, -2.5], "rays": 64, "error_target": null });
        let extent = ChunkExtent::from_first_format(&list).unwrap();
        assert_eq!(extent.claims(), [claim(Some(-2.5), 64, None), claim(Some(30.0), 64, None)]);
        let all = json!({ "isovalues": "all", "rays": 16, "error_target": 0.1 });
        let extent = ChunkExtent::from_first_format(&all).unwrap();
        assert_eq!(extent.claims()[0].target.as_ref().map(|t| t.error), Some(0.1));
        for damaged in [json!({}), json!({ "isovalues": ["x"], "rays": 1 }), json!({ "isovalues": "all", "rays": -1 })]
        {
            assert_eq!(ChunkExtent::from_first_format(&damaged), None);
        }
    }

    #[test]
    fn a_claim_covers_less_rays_a_larger_error_and_one_isosurface_of_all() {
        let all = claim(None, 64, None);
        assert!(all.covers(&claim(Some(1.0), 64, None)) && all.covers(&claim(Some(1.0), 32, Some(0.1))));
        assert!(!all.covers(&claim(None, 128, None)) && !claim(Some(1.0), 64, None).covers(&all));
        let stopped = claim(Some(1.0), 64, Some(0.01));
        assert!(stopped.covers(&claim(Some(1.0), 64, Some(0.02))) && !stopped.covers(&claim(Some(1.0), 16, None)));
        let other = Baked { target: Some(ErrorTarget { error: 0.02, of: "a light".into() }), ..stopped.clone() };
        assert!(!stopped.covers(&other) && !other.covers(&stopped));
    }
}
