//! What is to be lit: materials over the isovalue, the encoding of their colours, and the plan of effects. Knows nothing of the insides of
//! solvers.

mod colormap;
mod plan;
pub mod srgb;

pub use colormap::{Colormap, MaterialRule};
pub use plan::{Effect, Pilot, Plan, PlanInput, plan};
