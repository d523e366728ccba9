//! What is unusual about an input, how much of it, and what this program does about it: the
//! common currency of the diagnoses of volumes ([`crate::volume::diagnose`],
//! [`crate::level::diagnose`]), probes ([`mod@crate::probe::diagnose`]) and stores
//! ([`mod@crate::transfer::store::diagnose`]). A finding is not an error;
//! its [`Severity`] says whether the input can be used.

use serde::Serialize;

/// One thing that is unusual.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// A short fixed name, such as "plateaus": what programs look for.
    pub topic: &'static str,
    /// How many `unit` it concerns.
    pub count: u64,
    /// How many there are; 0 where that means nothing.
    pub of: u64,
    /// What is counted, in the plural: "samples", "cells", "pixels", "chunks".
    pub unit: &'static str,
    /// What was found; no full stop.
    pub found: String,
    /// What the program does about it, and what the user may do; no full stop.
    pub handled: String,
    /// Damage or a mere remark.
    pub severity: Severity,
}

/// How grave a finding is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing: the input can be used.
    #[default]
    Remark,
    /// Something was lost or changed: what depends on it is refused until it is mended.
    Damage,
}

impl Finding {
    /// A finding about `count` of `of` things called `unit`.
    pub fn new(
        topic: &'static str,
        (count, of, unit): (u64, u64, &'static str),
        found: impl Into<String>,
        handled: impl Into<String>,
    ) -> Self {
        Self { topic, count, of, unit, found: found.into(), handled: handled.into(), severity: Severity::Remark }
    }

    /// The same, as damage.
    #[must_use]
    pub fn damage(self) -> Self {
        Self { severity: Severity::Damage, ..self }
    }

    /// Whether something was lost or changed.
    pub fn is_damage(&self) -> bool {
        self.severity == Severity::Damage
    }

    /// The part of all that it concerns, in [0, 1]; 1 where `of` is 0.
    pub fn share(&self) -> f64 {
        if self.of == 0 { 1.0 } else { self.count as f64 / self.of as f64 }
    }
}
