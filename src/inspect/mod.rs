//! What is in a volume or a store, what is unusual about a file, and how far a bake has come.

mod diagnosis;
mod store;
mod volume;
mod watch;

pub use diagnosis::{Diagnosed, Kind, Looked, diagnose_volumes, kind_of};
pub use store::StoreFacts;
pub use volume::{Estimate, VolumeFacts, solid_text};
pub use watch::{Look, Watch};
