//! Effects switched by hand.

use super::nearest;
use crate::error::{Error, Result};
use crate::volume::Shadowing;
use std::str::FromStr;

/// The effects of a plan, in its order.
pub const EFFECTS: [&str; 12] = [
    "shadowing",
    "interreflection",
    "colour-channels",
    "emission",
    "walls",
    "coupling",
    "luminaires",
    "caustics",
    "media",
    "bands",
    "sun-split",
    "texels",
];

/// What can be switched, and why not the others.
fn refusal(name: &str, on: bool) -> Option<&'static str> {
    match (name, on) {
        ("shadowing" | "interreflection" | "emission", _) | ("sun-split", _) => None,
        ("colour-channels", true) => Some("grey layers serve every colour exactly: there is nothing to add"),
        ("walls" | "luminaires" | "caustics" | "media", true) => {
            Some("it is on wherever the scene has it: describe it there")
        }
        ("colour-channels" | "walls" | "luminaires" | "caustics" | "media", false) => None,
        ("bands", _) => Some("give --bands"),
        ("coupling", _) => Some("it is on wherever a scene has several volumes: describe it there"),
        _ => Some("give --isovalues: what they do not look up is not baked"),
    }
}

/// One effect switched on or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EffectSwitch {
    /// One of [`EFFECTS`].
    pub name: &'static str,
    /// On or off.
    pub on: bool,
}

impl FromStr for EffectSwitch {
    type Err = Error;

    /// Reads `+name` or `-name`.
    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (on, word) = match (text.strip_prefix('+'), text.strip_prefix('-')) {
            (Some(word), _) => (true, word),
            (_, Some(word)) => (false, word),
            _ => {
                let remedy = format!("write +{text} or -{text}");
                return Err(Error::argument("--effects", text, "a name after + or -", remedy));
            }
        };
        let Some(name) = EFFECTS.into_iter().find(|name| *name == word) else {
            let remedy = match nearest(word, EFFECTS) {
                Some(near) => format!("did you mean {near}?"),
                None => "see `isolume plan`".into(),
            };
            return Err(Error::argument("--effects", text, format!("one of {}", EFFECTS.join(", ")), remedy));
        };
        match refusal(name, on) {
            None => Ok(Self { name, on }),
            Some(why) => Err(Error::argument("--effects", text, "an effect that can be switched so", why)),
        }
    }
}

/// All switches given; the last one of a name counts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Effects(Vec<EffectSwitch>);

impl Effects {
    /// From switches in the order given.
    pub fn new(switches: impl IntoIterator<Item = EffectSwitch>) -> Self {
        Self(switches.into_iter().collect())
    }

    /// Whether an effect was switched, and how.
    pub fn switched(&self, name: &str) -> Option<bool> {
        self.0.iter().rev().find(|s| s.name == name).map(|s| s.on)
    }

    /// Which shadows count.
    #[doc(hidden)]
    pub fn shadowing(&self) -> Shadowing {
        match self.switched("shadowing") {
            None => Shadowing::Found,
            Some(true) => Shadowing::Traced,
            Some(false) => Shadowing::Ignored,
        }
    }

    /// Whether nothing was switched.
    #[doc(hidden)]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
