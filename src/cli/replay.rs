//! `bake --replay-texel`: the paths of one texel, one by one.

use super::console::Console;
use super::{Outcome, text};
use crate::error::Error;
use crate::level::{LevelField, Pyramid, Site};
use crate::transfer::{BRICK, Layout, Selection};
use crate::transport::{Bake, ReplayedPath, Settings, bake_brick, replay};
use crate::volume::Volume;
use serde_json::json;

pub(super) fn parse_texel(text: &str) -> Result<[usize; 3], String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok([x, y, z]),
        _ => Err("give three indices such as 90,120,80".into()),
    }
}

pub(super) fn run(
    volume: &Volume,
    layout: &Layout,
    settings: &Settings,
    texel: [usize; 3],
    console: &Console,
) -> Outcome {
    let m = layout.lattice.texels();
    if (0..3).any(|a| texel[a] >= m[a]) {
        let expected = format!("indices below {},{},{}", m[0], m[1], m[2]);
        let given = format!("{},{},{}", texel[0], texel[1], texel[2]);
        return Err(Error::argument("--replay-texel", given, expected, "the texture is smaller").into());
    }
    let pyramid = Pyramid::new(volume);
    let selection = one_texel(layout, texel);
    let bake = Bake::new(volume, &pyramid, layout, settings, &selection);
    let output = bake_brick(&bake, texel.map(|t| t / BRICK))?;
    let item = texel[0] + m[0] * (texel[1] + m[1] * texel[2]);
    let found: Option<(Site, Vec<ReplayedPath>)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, &pyramid);
        let site = field.site(layout.lattice.grid_from_texel(texel));
        site.map(|site| (site, replay(&field, &site, item as u64, settings)))
    });
    let Some((site, paths)) = found else {
        console
            .print(format!("texel {texel:?} has no level set: its neighbourhood is constant or its gradient vanishes"));
        console.print_json(&json!({ "texel": texel, "valid": false }));
        return Ok(());
    };
    let inner = texel.map(|t| t % BRICK);
    let inner = inner[0] + BRICK * (inner[1] + BRICK * inner[2]);
    let (coefficients, errors) = (layout.layers.coefficients(), layout.layers.errors());
    let transfer: Vec<f32> =
        output.bricks[0].transfer[inner * coefficients..][..coefficients].iter().map(|v| v.to_f32()).collect();
    let stderr: Vec<f32> = output.bricks[0].stderr[inner * errors..][..errors].iter().map(|v| v.to_f32()).collect();
    let isovalue = volume.value_from_raw(f64::from(site.isovalue));
    if console.is_json() {
        let paths: Vec<_> = paths.iter().map(path_json).collect();
        console.print_json(&json!({
            "texel": texel, "valid": true, "clamped": site.clamped, "isovalue": isovalue,
            "normal_in_world": site.normal.vec().to_array(),
            "bands": layout.layers.bands(), "transfer": transfer, "stderr": stderr, "paths": paths,
        }));
        return Ok(());
    }
    console.print(format!(
        "texel {texel:?}: isovalue {}{}, normal in world {:?}",
        text::number(isovalue, 8),
        if site.clamped { " (clamped)" } else { "" },
        site.normal.vec().to_array()
    ));
    console.print("replicate path  ended     last direction in world        grid positions of texel and hits");
    for path in &paths {
        let d = path.last_direction_in_world;
        let vertices: Vec<String> =
            path.vertices_in_grid.iter().map(|v| format!("({:.3} {:.3} {:.3})", v[0], v[1], v[2])).collect();
        console.print(format!(
            "{:>9} {:>4}  {:<8}  {:>8.4} {:>8.4} {:>8.4}  {}",
            path.replicate,
            path.path,
            path.ended,
            d[0],
            d[1],
            d[2],
            vertices.join(" → ")
        ));
    }
    let ended = |how: &str| paths.iter().filter(|p| p.ended == how).count();
    console.print(format!(
        "{} paths: {} escaped, {} trapped, {} lost",
        paths.len(),
        ended("escaped"),
        ended("trapped"),
        ended("lost")
    ));
    for k in 0..layout.layers.len() {
        let bands = layout.layers.bands()[k];
        let layer = &transfer[layout.layers.offset(k)..][..bands * bands];
        let errors = &stderr[layout.layers.error_offset(k)..][..bands];
        let line = |values: &[f32]| values.iter().map(|v| format!("{v:.5}")).collect::<Vec<_>>().join(" ");
        console.print(format!("T_{k}  {}\n  standard error by band  {}", line(layer), line(errors)));
    }
    Ok(())
}

fn path_json(path: &ReplayedPath) -> serde_json::Value {
    json!({
        "replicate": path.replicate, "path": path.path, "ended": path.ended,
        "vertices_in_grid": path.vertices_in_grid, "last_direction_in_world": path.last_direction_in_world,
    })
}

/// The selection of the texels around one; a brick computes its texels independently, so that more do not matter.
fn one_texel(layout: &Layout, texel: [usize; 3]) -> Selection {
    let mut selection = Selection::empty(layout.lattice);
    let grid = layout.lattice.grid_from_texel(texel);
    let last = layout.lattice.grid().map(|n| n.saturating_sub(2));
    selection.insert_cell(std::array::from_fn(|a| (grid[a] as usize).min(last[a])));
    selection
}
