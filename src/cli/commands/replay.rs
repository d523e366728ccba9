//! `bake --replay-texel`: the paths of one texel, one by one.

use crate::bake::{Estimator, Request};
use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::level::Pyramid;
use crate::scene::geometry::Geometry;
use crate::transfer::{Layers, Selection};
use crate::transport::{Bake, On, ReplayedPath, TexelEstimate, replay_texel};
use serde_json::json;

pub(in crate::cli) fn run(request: &Request<'_>, texel: [usize; 3], console: &Console) -> Outcome {
    let (pyramid, selection) = (Pyramid::new(request.volume), Selection::empty(request.layout.lattice));
    let photons = request.specular_photons(&pyramid)?;
    let specular = photons.as_ref().map(|photons| photons as _);
    let bake = Bake { specular, ..request.bake(&pyramid, &request.settings, &selection) };
    if request.estimator == Estimator::Gather {
        console.note("above layer 0 these are paths: gather looks up what they have ahead of them where they meet their level set");
    }
    let Some(found) = replay_texel(&bake, texel)? else {
        console
            .print(format!("texel {texel:?} has no level set: its neighbourhood is constant or its gradient vanishes"));
        console.print_json(&json!({ "texel": texel, "valid": false }));
        return Ok(());
    };
    let (site, geometry) = (&found.site, request.geometry);
    let isovalue = request.volume.value_from_raw(f64::from(site.isovalue));
    let groups: Vec<(String, Layers)> =
        bake.groups().iter().map(|g| Ok((g.node(), g.layout(&request.layout)?.layers))).collect::<Outcome<_>>()?;
    if console.is_json() {
        let paths: Vec<_> = found.paths.iter().map(|path| path.to_json(geometry)).collect();
        let mut json = json!({
            "texel": texel, "valid": true, "clamped": site.clamped, "isovalue": isovalue,
            "normal_in_world": site.normal.vec().to_array(),
            "bands": request.layout.layers.bands(), "buried": found.estimates.is_empty(), "paths": paths,
        });
        if let [environment, others @ ..] = found.estimates.as_slice() {
            (json["transfer"], json["stderr"]) = (json!(environment.transfer), json!(environment.stderr));
            for ((name, _), estimate) in groups[1..].iter().zip(others) {
                json["groups"][name] = json!({ "transfer": estimate.transfer, "stderr": estimate.stderr });
            }
        }
        console.print_json(&json);
        return Ok(());
    }
    console.print(format!(
        "texel {texel:?}: isovalue {}{}, normal in world {:?}",
        text::number(isovalue, 8),
        if site.clamped { " (clamped)" } else { "" },
        site.normal.vec().to_array()
    ));
    if found.estimates.is_empty() {
        console.print("no light reaches it: it lies inside the solid of another volume");
    }
    console.print("replicate path  ended     last direction in world        grid positions of texel and hits");
    found.paths.iter().for_each(|path| console.print(line(path, geometry)));
    console.print(ends(&found.paths));
    for ((name, layers), estimate) in groups.iter().zip(&found.estimates) {
        console.print(estimate_lines(name, layers, estimate));
    }
    Ok(())
}

fn line(path: &ReplayedPath, geometry: Option<&Geometry>) -> String {
    let d = path.last_direction_in_world;
    let vertex = |(v, &on): (&[f32; 3], &On)| format!("({:.3} {:.3} {:.3}{})", v[0], v[1], v[2], on.name(geometry));
    let vertices: Vec<String> = path.vertices_in_grid.iter().zip(&path.on).map(vertex).collect();
    format!(
        "{:>9} {:>4}  {:<8}  {:>8.4} {:>8.4} {:>8.4}  {}",
        path.replicate,
        path.path,
        path.ended.name_in(geometry),
        d[0],
        d[1],
        d[2],
        vertices.join(" → ")
    )
}

/// How many paths ended how.
fn ends(paths: &[ReplayedPath]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for name in ["escaped", "trapped", "lost"].into_iter().chain(paths.iter().map(|p| p.ended.name())) {
        if counts.iter().all(|(known, _)| *known != name) {
            counts.push((name, paths.iter().filter(|p| p.ended.name() == name).count()));
        }
    }
    let counts: Vec<String> = counts.iter().map(|(name, n)| format!("{n} {name}")).collect();
    format!("{} paths: {}", paths.len(), counts.join(", "))
}

/// The coefficients of a group, layer by layer, channel by channel.
fn estimate_lines(group: &str, layers: &Layers, estimate: &TexelEstimate) -> String {
    let numbers = |values: &[f32]| values.iter().map(|v| format!("{v:.5}")).collect::<Vec<_>>().join(" ");
    let (symbol, channels) = (if group == "env" { "T" } else { "G" }, layers.channels());
    let mut lines = if channels == 1 { Vec::new() } else { vec![format!("{group}:")] };
    for (k, &bands) in layers.bands().iter().enumerate() {
        for c in 0..channels {
            let first = layers.offset(k) + c * bands * bands;
            let channel = if channels == 1 { String::new() } else { format!(" {}", ["red", "green", "blue"][c]) };
            lines.push(format!("{symbol}_{k}{channel}  {}", numbers(&estimate.transfer[first..first + bands * bands])));
        }
        let errors = &estimate.stderr[layers.error_offset(k)..][..bands];
        lines.push(format!("  standard error by band  {}", numbers(errors)));
    }
    lines.join("\n")
}
