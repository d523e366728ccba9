//! Which estimator filled a store, as part of its identity. Stores of the formats 1 and 2 hold a sentence instead, which is
//! read here; [`std::fmt::Display`] gives that sentence for people.

use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// An estimator and all of its settings that decide numbers, rays and seed apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "name", rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum EstimatorIdentity {
    /// Path tracing within each level set.
    Path {
        /// What is known of shadows.
        shadowing: Shadows,
    },
    /// Path tracing among walls and luminaires, or among the level sets of other volumes.
    ScenePath {
        /// What stands around.
        among: Surroundings,
        /// Whether paths from luminaires through mirrors and glass count.
        caustics: bool,
        /// Photons sent out for such light as no path finds; none where paths find all.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        photons: Option<u32>,
    },
    /// The texture as radiance cache. Texels depend on their neighbours, so which isosurfaces are baked together counts.
    Gather {
        /// Passes that fill the cache.
        passes: u32,
        /// Rays a texel in each.
        cache_rays: u32,
        /// Rays a texel of the final gather.
        rays: u32,
        /// In the file's values; none for all.
        isovalues: Option<Vec<f64>>,
        /// What is known of shadows.
        shadowing: Shadows,
    },
    /// The same among walls and luminaires, or among the level sets of other volumes.
    SceneGather {
        /// What stands around.
        among: Surroundings,
        /// As of [`Self::ScenePath`].
        caustics: bool,
        /// As of [`Self::ScenePath`].
        #[serde(default, skip_serializing_if = "Option::is_none")]
        photons: Option<u32>,
        /// Passes that fill the cache.
        passes: u32,
        /// Rays a texel in each.
        cache_rays: u32,
        /// Rays a texel of the final gather.
        rays: u32,
        /// In the file's values; none for all.
        isovalues: Option<Vec<f64>>,
    },
    /// Flattened photon mapping.
    Photon {
        /// Photons sent out.
        sent: u32,
        /// Photons that a texel looks up.
        nearest: u32,
        /// What is known of shadows.
        shadowing: Shadows,
    },
    /// An estimator of another program that uses the library, by its name.
    Custom {
        /// What tells it from others, with its settings.
        text: String,
    },
}

/// What is known of shadows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shadows {
    /// Texels that nothing can shade are found, and get the closed form.
    #[default]
    Found,
    /// No shadows: every texel gets the closed form.
    Ignored,
    /// Every texel is traced.
    Traced,
    /// The volume declares its solids convex.
    Convex,
}

/// What paths meet besides the level set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Surroundings {
    /// Walls or luminaires.
    Walls,
    /// Level sets of other volumes alone.
    Volumes,
}

impl Surroundings {
    fn name(self) -> &'static str {
        if self == Self::Volumes { "volumes" } else { "walls" }
    }
}

impl EstimatorIdentity {
    /// Whether all texels are lit as if nothing hid the light from them.
    pub fn ignores_shadows(&self) -> bool {
        match self {
            Self::Path { shadowing } | Self::Gather { shadowing, .. } | Self::Photon { shadowing, .. } => {
                *shadowing == Shadows::Ignored
            }
            Self::ScenePath { .. } | Self::SceneGather { .. } | Self::Custom { .. } => false,
        }
    }

    /// Whether light of luminaires counts that comes by way of mirrors and glass.
    pub(crate) fn has_caustics(&self) -> bool {
        !matches!(self, Self::ScenePath { caustics: false, .. } | Self::SceneGather { caustics: false, .. })
    }

    /// Photons sent out for such of it as no path finds.
    pub(crate) fn specular_photons(&self) -> Option<u32> {
        match self {
            Self::ScenePath { photons, .. } | Self::SceneGather { photons, .. } => *photons,
            _ => None,
        }
    }

    /// Which version of its computation this program has: stores of another one are read, and not extended, because
    /// their texels would have other numbers and other errors.
    ///
    /// 2: paths go on about the normal of the trilinear facet that they met, and a ray may leave the solid that it starts into
    /// by one cell (before, about the smoothed normal, and by four); rays from hits have a control variate, and errors of the
    /// layers above 0 owe little to how many paths happened to escape.
    ///
    /// 3, among walls: chains of mirrors and glass end by roulette, and are cut at 4096 (before, at 64).
    pub fn revision(&self) -> u32 {
        match self {
            Self::ScenePath { among: Surroundings::Walls, .. }
            | Self::SceneGather { among: Surroundings::Walls, .. } => 3,
            Self::Path { .. }
            | Self::ScenePath { .. }
            | Self::Gather { .. }
            | Self::SceneGather { .. }
            | Self::Photon { .. } => 2,
            Self::Custom { .. } => first_revision(),
        }
    }
}

/// That of stores that do not name one.
pub(super) fn first_revision() -> u32 {
    1
}

pub(super) fn is_first_revision(revision: &u32) -> bool {
    *revision == first_revision()
}

impl Shadows {
    const ALL: [Self; 4] = [Self::Found, Self::Ignored, Self::Traced, Self::Convex];

    /// How the sentence ends.
    fn ending(self) -> &'static str {
        match self {
            Self::Found => "",
            Self::Ignored => "; shadowing ignored",
            Self::Traced => "; every texel traced",
            Self::Convex => "; solids declared convex",
        }
    }
}

impl fmt::Display for EstimatorIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path { shadowing } => write!(f, "path{}", shadowing.ending()),
            Self::ScenePath { among, caustics, photons } => {
                write!(f, "path among {}{}", among.name(), of_caustics(*caustics, *photons))
            }
            Self::Gather { passes, cache_rays, rays, isovalues, shadowing } => {
                let isovalues = list(isovalues.as_ref());
                let ending = shadowing.ending();
                write!(f, "gather: {passes} passes of {cache_rays}, then {rays} rays; isovalues {isovalues}{ending}")
            }
            Self::SceneGather { among, caustics, photons, passes, cache_rays, rays, isovalues } => {
                let (among, isovalues) = (among.name(), list(isovalues.as_ref()));
                write!(
                    f,
                    "gather among {among}: {passes} passes of {cache_rays}, then {rays} rays; isovalues {isovalues}"
                )?;
                f.write_str(&of_caustics(*caustics, *photons))
            }
            Self::Photon { sent, nearest, shadowing } => {
                write!(f, "photon: {sent} sent out, {nearest} to a texel{}", shadowing.ending())
            }
            Self::Custom { text } => f.write_str(text),
        }
    }
}

/// Isovalues as the sentence has them.
fn list(isovalues: Option<&Vec<f64>>) -> String {
    isovalues.map_or("all".into(), |list| list.iter().map(f64::to_string).collect::<Vec<_>>().join(" "))
}

/// How the sentence of a scene ends.
fn of_caustics(caustics: bool, photons: Option<u32>) -> String {
    let photons = photons.map_or(String::new(), |photons| format!("; {photons} photons"));
    format!("{}{photons}", if caustics { "" } else { "; caustics left out" })
}

/// Reads the sentence of an estimator of this program; any other text is that of a custom one.
impl From<&str> for EstimatorIdentity {
    fn from(text: &str) -> Self {
        parse(text).unwrap_or_else(|| Self::Custom { text: text.into() })
    }
}

impl From<String> for EstimatorIdentity {
    fn from(text: String) -> Self {
        text.as_str().into()
    }
}

fn parse(text: &str) -> Option<EstimatorIdentity> {
    let found = text.find("; ").map_or("", |i| &text[i..]);
    if let Some(rest) = text.strip_prefix("path among ") {
        let (what, caustics) = match rest.strip_suffix("; caustics left out") {
            Some(what) => (what, false),
            None => (rest, true),
        };
        let among = [("walls", Surroundings::Walls), ("volumes", Surroundings::Volumes)];
        let among = among.into_iter().find(|(name, _)| *name == what)?.1;
        return Some(EstimatorIdentity::ScenePath { among, caustics, photons: None });
    }
    let ends = |s: &&Shadows| **s != Shadows::Found && text.ends_with(s.ending());
    let shadowing = Shadows::ALL.iter().find(ends).copied().unwrap_or_default();
    let body = text.strip_suffix(shadowing.ending())?;
    let number = |text: &str| text.parse::<u32>().ok();
    if body == "path" && (found.is_empty() || found == shadowing.ending()) {
        return Some(EstimatorIdentity::Path { shadowing });
    }
    if let Some(rest) = body.strip_prefix("photon: ") {
        let (sent, rest) = rest.split_once(" sent out, ")?;
        let nearest = number(rest.strip_suffix(" to a texel")?)?;
        return Some(EstimatorIdentity::Photon { sent: number(sent)?, nearest, shadowing });
    }
    let (passes, rest) = body.strip_prefix("gather: ")?.split_once(" passes of ")?;
    let (cache_rays, rest) = rest.split_once(", then ")?;
    let (rays, isovalues) = rest.split_once(" rays; isovalues ")?;
    let isovalues = match isovalues {
        "all" => None,
        list => Some(list.split(' ').map(|v| v.parse().ok()).collect::<Option<Vec<f64>>>()?),
    };
    let (passes, cache_rays, rays) = (number(passes)?, number(cache_rays)?, number(rays)?);
    Some(EstimatorIdentity::Gather { passes, cache_rays, rays, isovalues, shadowing })
}

/// Reads an estimator as it stands in an identity: an object, or in the formats 1 and 2 a sentence.
pub(super) fn read<'de, D: Deserializer<'de>>(deserializer: D) -> Result<EstimatorIdentity, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stored {
        Sentence(String),
        Typed(EstimatorIdentity),
    }
    Ok(match Stored::deserialize(deserializer)? {
        Stored::Sentence(text) => text.into(),
        Stored::Typed(typed) => typed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sentences_of_older_stores_are_read_and_written() {
        let list = |isovalues| EstimatorIdentity::Gather {
            passes: 5,
            cache_rays: 16,
            rays: 64,
            isovalues,
            shadowing: Shadows::Traced,
        };
        let cases = [
            ("path", EstimatorIdentity::Path { shadowing: Shadows::Found }),
            ("path; shadowing ignored", EstimatorIdentity::Path { shadowing: Shadows::Ignored }),
            ("path; solids declared convex", EstimatorIdentity::Path { shadowing: Shadows::Convex }),
            (
                "path among walls",
                EstimatorIdentity::ScenePath { among: Surroundings::Walls, caustics: true, photons: None },
            ),
            (
                "path among volumes; caustics left out",
                EstimatorIdentity::ScenePath { among: Surroundings::Volumes, caustics: false, photons: None },
            ),
            (
                "photon: 4096 sent out, 64 to a texel",
                EstimatorIdentity::Photon { sent: 4096, nearest: 64, shadowing: Shadows::Found },
            ),
            ("gather: 5 passes of 16, then 64 rays; isovalues all; every texel traced", list(None)),
            (
                "gather: 5 passes of 16, then 64 rays; isovalues 30 -0.5; every texel traced",
                list(Some(vec![30.0, -0.5])),
            ),
        ];
        for (text, typed) in cases {
            assert_eq!(EstimatorIdentity::from(text), typed);
            assert_eq!(typed.to_string(), text);
            let json = serde_json::to_value(&typed).unwrap();
            assert_eq!(read(json).unwrap(), typed);
            assert_eq!(read(serde_json::Value::from(text)).unwrap(), typed);
        }
        for text in ["", "mine, 3 rays", "path; something new", "path among trees", "gather: 5 passes"] {
            assert_eq!(EstimatorIdentity::from(text), EstimatorIdentity::Custom { text: text.into() });
        }
        let (caustics, photons) = (false, Some(4096));
        let gathered = EstimatorIdentity::SceneGather {
            among: Surroundings::Walls,
            caustics,
            photons,
            passes: 1,
            cache_rays: 16,
            rays: 64,
            isovalues: Some(vec![47.0]),
        };
        let text = "gather among walls: 1 passes of 16, then 64 rays; isovalues 47; caustics left out; 4096 photons";
        assert_eq!(gathered.to_string(), text);
        assert_eq!(read(serde_json::to_value(&gathered).unwrap()).unwrap(), gathered);
        assert_eq!((gathered.has_caustics(), gathered.specular_photons()), (caustics, photons));
        let unknown = serde_json::json!({ "name": "path", "shadowing": "found", "more": 1 });
        assert!(read(unknown).is_err());
    }
}
