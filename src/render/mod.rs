//! Previews: the level set ray-traced from a camera, with the same radiance as the exported vertices.
//! Knows nothing of solvers: radiance comes from a contracted texture, visibility from the tracer.

mod camera;
mod preview;

pub use camera::{Camera, Projection, View};
pub use preview::{Picture, RenderOptions, render};
