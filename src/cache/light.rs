//! The light that the errors of a bake are measured by.

use crate::bake::ForLight;
use crate::error::{Error, Result};
use crate::geom::Up;
use crate::probe::{EnvFrame, Orientation, Probe};
use crate::session::{LightOptions, Lighting};
use crate::sh::{Coefficients, MAX_BANDS};
use crate::transfer::Layers;

/// An environment that errors are measured by, on a surface of one albedo, as it stands around what has an axis up, turned by
/// so many degrees.
///
/// # Errors
/// When the rotation is not finite, or the bands are not 1 to 11.
pub fn for_light(
    probe: &Probe,
    (up, rotation, frame): (Up, f64, EnvFrame),
    bands: usize,
    albedo: f32,
) -> Result<ForLight> {
    if !(1..=MAX_BANDS).contains(&bands) {
        let remedy = "8 is what a bake has where nothing is asked for";
        return Err(Error::argument("bands", bands, format!("1 to {MAX_BANDS}"), remedy));
    }
    let light = probe.coefficients_in_world(bands, Orientation::new(up, rotation)?.in_frame(frame));
    // In the OpenEXR frame it has the bare name, as in stores from before there was another.
    let name_in_store = match frame {
        EnvFrame::OpenExr => probe.name.clone(),
        EnvFrame::Gltf => format!("{} in the frame of glTF", probe.name),
    };
    Ok(ForLight { name: probe.name.clone(), name_in_store, light, rest: None, albedo })
}

/// The environments that surfaces of one albedo will be lit by, as they will be.
///
/// # Errors
/// As [`Lighting::new`].
pub fn lights(
    probes: &[Probe],
    (up, layers): (Up, &Layers),
    options: &LightOptions,
    albedo: f32,
) -> Result<Vec<ForLight>> {
    let each = probes.iter().map(|probe| {
        let lighting = Lighting::new(probe, up, layers, options)?;
        // The layer of most bands.
        let most = layers.bands().iter().enumerate().max_by_key(|(_, bands)| **bands).map_or(0, |(k, _)| k);
        let rest = {
            let rgb = lighting.light().coefficients(most);
            let bands = lighting.light().bands(most);
            let mut channels = [(); 3].map(|()| Coefficients::zero(bands));
            for (c, channel) in channels.iter_mut().enumerate() {
                channel.values_mut().iter_mut().zip(rgb).for_each(|(to, from)| *to = from[c]);
            }
            channels
        };
        let turned = match options.rotation_degrees {
            0.0 => String::new(),
            degrees => format!(" turned {degrees}°"),
        };
        let name_in_store = format!("{}{turned}", probe.name);
        let light = lighting.whole(up, layers.max_bands())?;
        Ok(ForLight { name: probe.name.clone(), name_in_store, light, rest: Some(rest), albedo })
    });
    each.collect()
}
