//! Previews: the level set ray-traced from a camera, with the same radiance as the exported vertices.
//! And the visibility of a sun that was split off the environment, from any points of the level set.
//! Knows nothing of solvers: radiance comes from a contracted texture, visibility from the tracer.

mod camera;
mod lamps;
mod pixels;
mod preview;
mod reflected;
mod sun;

pub use camera::{Camera, Projection, VIEWS, View, Viewpoint};
pub use lamps::Lamps;
pub(crate) use lamps::{AIM, places_of_trial, rays_that_are_enough};
pub use pixels::{SeenPoint, seen_points};
pub use preview::{Backdrop, Picture, RenderOptions, Subject, radiance_along, render};
pub use reflected::{Reflected, SunLit, Surroundings, bytes_of_suns};
pub use sun::{PENUMBRA, SunLight, SunVisibility, sun_visibility};
