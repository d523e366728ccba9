//! Isovalues on the command line.

use super::console::Console;
use super::input::Input;
use super::scene::SceneFile;
use super::{options, text};
use crate::error::{Error, Result};
use crate::scene::MOST_ISOVALUES;
use crate::volume::{Note, Solid};
use std::str::FromStr;

pub(super) use crate::volume::Isovalue;
pub(super) use crate::volume::isovalue::Chosen;

/// An isovalue, perhaps of one of several volumes: `NAME=C`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedIsovalue {
    /// The volume, where it is named.
    pub(super) volume: Option<String>,
    pub(super) isovalue: Isovalue,
}

impl FromStr for NamedIsovalue {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let of = |text: &str| text.parse::<Isovalue>().map_err(|e| e.to_string());
        match text.split_once('=') {
            Some((name, _)) if name.trim().is_empty() => Err(format!("`{text}`: give NAME=C, such as inner=0.5")),
            Some((name, isovalue)) => Ok(Self { volume: Some(name.trim().into()), isovalue: of(isovalue)? }),
            None => Ok(Self { volume: None, isovalue: of(text)? }),
        }
    }
}

/// Refuses a list that would take hours to look at.
pub(super) fn check_count(count: usize) -> Result<()> {
    if count <= MOST_ISOVALUES {
        return Ok(());
    }
    Err(Error::Limit {
        what: "the list of isovalues".into(),
        needed: text::count(count as u64),
        limit: text::count(MOST_ISOVALUES as u64),
        remedy: "bake all isovalues at once: leave the list out".into(),
    })
}

impl Input {
    /// The side that is matter, where the user, a scene or a field has decided it.
    fn side(&self) -> Option<Solid> {
        (self.side_is_given || self.default_isovalue.is_some() || self.joint.is_some()).then_some(self.volume.solid)
    }

    /// An isovalue for this volume, with the side of it that is matter.
    ///
    /// # Errors
    /// When no surface has it.
    pub(super) fn choose(&self, isovalue: Isovalue) -> Result<Chosen> {
        match &self.joint {
            Some(joint) => joint.resolve(&isovalue, &self.volume, self.default_isovalue),
            None => isovalue.resolve(&self.volume, self.side(), self.default_isovalue),
        }
    }

    /// Isovalues of which all surfaces are made on their own: of one that stands for several, such as `auto` of labels,
    /// all those of one side. The volume takes the side that the choice found.
    ///
    /// # Errors
    /// When no surface has one of them, or they are of different sides.
    pub(super) fn settle(&mut self, isovalues: &[Isovalue], scene: Option<&SceneFile>) -> Result<Vec<Chosen>> {
        check_count(isovalues.len())?;
        let mut all = Vec::new();
        for isovalue in isovalues {
            let chosen = self.choose(*isovalue).map_err(|e| options::in_scene(e, scene, isovalue))?;
            let same_side = chosen.more.iter().filter(|level| level.solid == chosen.solid);
            let reason = |c: &Chosen| c.reason.clone();
            let more: Vec<Chosen> = same_side
                .map(|level| Chosen { reason: reason(&chosen), ..Chosen::given(level.value, level.solid) })
                .collect();
            all.push(chosen);
            all.extend(more);
        }
        self.take_side(&all)?;
        Ok(all)
    }

    /// The side of all isovalues becomes that of the volume, which loses the smaller parts of its solid if so asked for.
    pub(super) fn take_side(&mut self, chosen: &[Chosen]) -> Result<()> {
        let Some(first) = chosen.first() else { return Ok(()) };
        if let Some(other) = chosen.iter().find(|c| c.solid != first.solid) {
            let given = [first, other].map(|c| text::number(c.value, 8)).join(" and ");
            let expected = "isovalues of one side: of these one has matter above, the other below";
            let remedy = "give --solid above or --solid below, or one isovalue at a time";
            return Err(Error::argument("--isovalue", given, expected, remedy));
        }
        self.volume.solid = first.solid;
        if std::mem::take(&mut self.keep_largest)
            && let Some(outermost) = self.volume.outermost(chosen.iter().map(|c| c.value))
        {
            let (volume, removed) = self.volume.clone().keep_largest(outermost)?;
            self.volume = volume;
            let what = format!(
                "{} smaller parts of the solid of {} were dropped, {} samples; the largest has {}",
                text::count(removed.parts),
                text::number(outermost, 6),
                text::count(removed.samples),
                text::count(removed.kept)
            );
            self.volume.notes.push(Note { text: what, count: removed.samples });
        }
        Ok(())
    }

    /// Refuses what needs an isovalue where all are asked for.
    pub(super) fn check_all(&self) -> Result<()> {
        if !self.keep_largest {
            return Ok(());
        }
        let expected = "the isovalues whose solid is meant";
        let remedy = "add --isovalues C: the parts of a solid differ from isovalue to isovalue";
        Err(Error::argument("--keep-largest", "without --isovalues", expected, remedy))
    }
}

/// What the program chose, and what a user should know of it.
pub(super) fn tell(console: &Console, chosen: &[Chosen]) {
    for c in chosen {
        if let Some(reason) = &c.reason {
            console.note(format!("isovalue {}: {reason}", text::number(c.value, 6)));
        }
        if let Some(warning) = &c.warning {
            console.note(warning);
        }
    }
}
