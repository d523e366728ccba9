//! What is to be lit: the description of a scene, what stands around its volume, materials over the isovalue, and the
//! plan of effects. Knows nothing of the insides of solvers.

mod added;
mod colormap;
mod coupling;
mod description;
mod effects;
mod environment;
pub mod geometry;
mod material;
pub mod medium;
mod member;
mod model;
mod names;
mod open;
mod plan;

pub use crate::probe::{MOST_SUNS, SUN_TOLERANCE, SunSplit};
#[doc(hidden)]
pub use added::{Fog, SceneOptions, Translucent};
#[doc(hidden)]
pub use colormap::Colormap;
pub use coupling::{Coupled, Coupling, IsovalueMap};
#[doc(hidden)]
pub use description::{
    Albedo, BakeDescription, BodyDescription, CameraDescription, FieldDescription, Files, Located, MOST_ISOVALUES,
    MediumDescription, ModelDescription, ProbeDescription, ReadFile, SceneDescription, Size, Surroundings, TextureSize,
    VolumeDescription, WallDescription, WallShape,
};
pub use effects::{EFFECTS, EffectSwitch, Effects};
#[doc(hidden)]
pub use environment::{environment, open_probe};
#[doc(hidden)]
pub use material::{EmissionRule, MaterialRule, Table};
pub use member::{Front, Member, VolumeOptions};
#[doc(hidden)]
pub use member::{NamedIsovalue, check_count, missing_store};
pub(crate) use model::sample_and_count;
#[doc(hidden)]
pub use model::{ModelName, describe, sample};
#[doc(hidden)]
pub use names::nearest;
pub(crate) use open::files_of;
pub use open::{DARK, Scene, SceneFile, distant_light};
#[doc(hidden)]
pub use plan::{BodyForecast, MediumForecast, Pilot, PlanInput, Surrounded, plan};
pub use plan::{Effect, Plan};
