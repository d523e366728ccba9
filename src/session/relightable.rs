//! Relightable glTF: the transfer of the vertices as attributes, the light they were lit by beside them.
//!
//! Attributes are named after the spherical harmonics of `KHR_gaussian_splatting` (`SH_DEGREE_l_COEF_n`, n from 0 to
//! 2l): `_T<k>_SH_DEGREE_<l>_COEF_<n>`, one float to a vertex, layer k, degree l, order m = n − l. They are
//! transfer, not radiance, hence no attributes of that extension. In a scene there is one of each channel,
//! `_T<k>_<R|G|B>_SH_DEGREE_<l>_COEF_<n>`, and one number a layer and channel of the level set's own emission,
//! `_G<k>_EMISSION_<R|G|B>`, and of each luminaire, `_LUMINAIRE_<i>_G<k>_<R|G|B>`.

use super::textures::{Groups, refuse_body};
use super::{Isosurface, LuminaireFactor};
use crate::error::{Error, Result};
use crate::export::gltf::Scalars;
use crate::geom::Up;
use crate::probe::{Orientation, Probe};
use crate::relight::{Light, Material, look_up_transfer, transfer_at_vertices};
use crate::sh::Rotation;
use crate::transfer::store::Store;
use serde_json::{Value, json};

const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// The attributes of a file: the vertices of each mesh, with the transfer of its store, behind those of the one before.
pub(super) fn attributes<'a>(surfaces: impl Iterator<Item = (&'a Store, &'a Isosurface)>) -> Result<Vec<Scalars>> {
    let mut all: Vec<Scalars> = Vec::new();
    for (store, isosurface) in surfaces {
        let mesh = isosurface.mesh();
        refuse_body(store, "transfer")?;
        let groups = Groups::open(isosurface.transfer().unwrap_or(store), &[])?;
        let found = match isosurface.transfer() {
            Some(_) => transfer_at_vertices(&groups.textures()?, &mesh.normals),
            None => look_up_transfer(&groups.textures()?, &mesh.positions_in_grid, &mesh.normals),
        };
        let planes = found?.planes;
        let more = names(&groups).into_iter().zip(planes).map(|(name, values)| Scalars { name, values });
        if all.is_empty() {
            all = more.collect();
            continue;
        }
        let more: Vec<Scalars> = more.collect();
        if !all.iter().map(|s| &s.name).eq(more.iter().map(|s| &s.name)) {
            let expected = "the same layers, bands and luminaires in all volumes";
            return Err(Error::argument("transfer", "different textures", expected, "light one of them alone"));
        }
        all.iter_mut().zip(more).for_each(|(all, more)| all.values.extend(more.values));
    }
    Ok(all)
}

/// Names in the order of [`crate::relight::VertexTransfer::planes`].
fn names(groups: &Groups<'_>) -> Vec<String> {
    let layers = groups.layers();
    let grey = layers.channels() == 1;
    let mut names = Vec::new();
    for (k, &bands) in layers.bands().iter().enumerate() {
        for channel in if grey { &[""][..] } else { &CHANNELS } {
            let layer = if grey { format!("T{k}") } else { format!("T{k}_{channel}") };
            let coefficients = (0..bands).flat_map(|l| (0..=2 * l).map(move |n| (l, n)));
            names.extend(coefficients.map(|(l, n)| format!("{layer}_SH_DEGREE_{l}_COEF_{n}")));
        }
    }
    if !grey {
        let numbers = || (0..layers.len()).flat_map(|k| CHANNELS.map(|channel| (k, channel)));
        names.extend(numbers().map(|(k, channel)| format!("G{k}_EMISSION_{channel}")));
        for i in 0..groups.factors().count() {
            names.extend(numbers().map(|(k, channel)| format!("LUMINAIRE_{i}_G{k}_{channel}")));
        }
    }
    names
}

/// What a reader needs to relight: the light, the material, and how they go together. The light has the lamps that are lit apart;
/// only the colours of the file have their sharp shadows.
pub(super) fn extras(
    (store, factors): (&Store, &[LuminaireFactor]),
    probe: &Probe,
    light: &Light,
    material: &Material,
    up: Up,
    rotation: f64,
    exposure: f32,
    lamps: usize,
) -> Result<Value> {
    let groups = Groups::open(store, factors)?;
    let layers = groups.layers();
    let (upright, standing) = (Orientation::new(Up::Z, 0.0)?, Orientation::new(up, 0.0)?);
    let turn = Rotation::new(layers.max_bands(), &(standing.world_from_probe() * upright.probe_from_world()))?;
    let mut all = json!({
        "version": 1,
        "attributes": "_T<k>_SH_DEGREE_<l>_COEF_<n>: layer k (light reflected k times), degree l, order m = n - l, in world axes",
        "basis": "real, orthonormal, no Condon-Shortley sign: Y_1,-1 = 0.488603 y, Y_1,0 = 0.488603 z, Y_1,1 = 0.488603 x",
        "formula": "radiance = sum_k albedo^(k+1) <T_k, L> + tail; COLOR_0 = clamp(exposure * radiance, 0, 1)",
        "negative": "before exposure, radiance with a channel below 0 (least) becomes Y + Y/(Y - least) (radiance - Y), Y its luminance 0.2126 R + 0.7152 G + 0.0722 B; 0 where Y <= 0",
        "tail": "albedo^(K+1) <T_K, L> x/(1-x), x = albedo * S/(S + max(a_K, S/512)), a_k = sqrt(4 pi) T_k,00, S = max(0, 1 - sum a_k); none for one layer or a_K = 0",
        "bands": layers.bands(),
        "light": { "name": probe.name, "rotation_degrees": rotation, "coefficients_in_world": light.coefficients(0) },
        "lamps_lit_apart": lamps,
        "albedo": material.albedo, "emission": material.emission, "exposure": exposure,
        "world_from_upright": (0..turn.bands()).map(|l| turn.block(l)).collect::<Vec<_>>(),
    });
    if layers.channels() == 3 {
        let of_scene = json!({
            "version": 2,
            "channels": 3,
            "attributes": "_T<k>_<R|G|B>_SH_DEGREE_<l>_COEF_<n>: layer k (light that the surface reflected k times), degree l, order m = n - l, in world axes; _G<k>_EMISSION_<R|G|B>; _LUMINAIRE_<i>_G<k>_<R|G|B>, i among luminaires",
            "formula": "in each channel: radiance = e + sum_k B_k + tail, B_k = albedo^(k+1) (<T_k, L> + e EMISSION_k + sum_i s_i LUMINAIRE_i_k), e = emission, s_i = luminaires[i].factor, twice of which is twice the power; COLOR_0 = clamp(exposure * radiance, 0, 1)",
            "tail": "B_K x/(1-x), x = albedo * min(1, EMISSION_K/EMISSION_(K-1)); none where EMISSION_(K-1) is 0 or x is 1, or for one layer",
            "luminaires": groups.factors().map(|(name, factor)| json!({ "name": name, "factor": factor })).collect::<Vec<_>>(),
        });
        if let (Value::Object(all), Value::Object(of_scene)) = (&mut all, of_scene) {
            all.extend(of_scene);
        }
    }
    Ok(json!({ "isolume_transfer": all }))
}
