//! Relightable glTF: the transfer of the vertices as attributes, the light they were lit by beside them.
//!
//! Attributes are named after the spherical harmonics of `KHR_gaussian_splatting` (`SH_DEGREE_l_COEF_n`, n from 0 to
//! 2l): `_T<k>_SH_DEGREE_<l>_COEF_<n>`, one float to a vertex, layer k, degree l, order m = n − l. They are grey
//! transfer, not radiance, hence no attributes of that extension.

use crate::error::{Error, Result};
use crate::export::gltf::Scalars;
use crate::geom::Up;
use crate::probe::{Orientation, Probe};
use crate::relight::{Light, Material, look_up_transfer};
use crate::sh::Rotation;
use crate::surface::Mesh;
use crate::transfer::{BrickSource, Layers};
use serde_json::{Value, json};

/// The attributes of a mesh.
pub(super) fn attributes(source: &dyn BrickSource, mesh: &Mesh) -> Result<Vec<Scalars>> {
    if source.layout().layers.channels() != 1 {
        let remedy = "leave it out, or bake the volume without walls and luminaires";
        let expected = "the grey transfer of a volume alone";
        return Err(Error::argument("transfer", "the coloured transfer of a scene", expected, remedy));
    }
    let planes = look_up_transfer(source, &mesh.positions_in_grid, &mesh.normals)?.planes;
    Ok(names(&source.layout().layers).zip(planes).map(|(name, values)| Scalars { name, values }).collect())
}

fn names(layers: &Layers) -> impl Iterator<Item = String> {
    layers.bands().iter().enumerate().flat_map(|(k, &bands)| {
        (0..bands).flat_map(move |l| (0..=2 * l).map(move |n| format!("T{k}_SH_DEGREE_{l}_COEF_{n}")))
    })
}

/// What a reader needs to relight: the light, the material, and how they go together.
pub(super) fn extras(
    layers: &Layers,
    probe: &Probe,
    light: &Light,
    material: &Material,
    up: Up,
    rotation: f64,
    exposure: f32,
) -> Result<Value> {
    let (upright, standing) = (Orientation::new(Up::Z, 0.0)?, Orientation::new(up, 0.0)?);
    let turn = Rotation::new(layers.max_bands(), &(standing.world_from_probe() * upright.probe_from_world()))?;
    Ok(json!({ "isolume_transfer": {
        "version": 1,
        "attributes": "_T<k>_SH_DEGREE_<l>_COEF_<n>: layer k (light reflected k times), degree l, order m = n - l, in world axes",
        "basis": "real, orthonormal, no Condon-Shortley sign: Y_1,-1 = 0.488603 y, Y_1,0 = 0.488603 z, Y_1,1 = 0.488603 x",
        "formula": "radiance = sum_k albedo^(k+1) <T_k, L> + tail; COLOR_0 = clamp(exposure * radiance, 0, 1)",
        "tail": "albedo^(K+1) <T_K, L> x/(1-x), x = albedo * min(a_K/a_(K-1), S/(S+a_K)), a_k = sqrt(4 pi) T_k,00, S = max(0, 1 - sum a_k); none for one layer",
        "bands": layers.bands(),
        "light": { "name": probe.name, "rotation_degrees": rotation, "coefficients_in_world": light.coefficients(0) },
        "albedo": material.albedo, "emission": material.emission, "exposure": exposure,
        "world_from_upright": (0..turn.bands()).map(|l| turn.block(l)).collect::<Vec<_>>(),
    }}))
}
