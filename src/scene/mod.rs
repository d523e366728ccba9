//! What is to be lit: the description of a scene, what stands around its volume, materials over the isovalue, the encoding of their colours, and the
//! plan of effects. Knows nothing of the insides of solvers.

mod colormap;
mod coupling;
mod description;
mod effects;
pub mod geometry;
mod material;
mod member;
mod names;
mod open;
mod plan;
pub mod srgb;

pub use colormap::Colormap;
pub use coupling::{Coupled, Coupling, IsovalueMap};
pub use description::{
    Albedo, BakeDescription, CameraDescription, Located, MOST_ISOVALUES, ProbeDescription, ReadFile, SceneDescription,
    Surroundings, TextureSize, VolumeDescription, WallDescription, WallShape,
};
pub use effects::{EFFECTS, EffectSwitch, Effects};
pub use material::{EmissionRule, MaterialRule, Table};
pub use member::{Front, Member, VolumeOptions, check_count, missing_store};
pub use names::nearest;
pub use open::{DARK, Scene, SceneFile};
pub use plan::{Effect, Pilot, Plan, PlanInput, Surrounded, plan};
