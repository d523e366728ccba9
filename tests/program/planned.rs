//! What the plan leaves out stays within what it says, and costs nothing: eight scenes, planned against full.

use crate::common::program::{Bench, radiance};
use serde_json::Value;

struct Planned {
    name: &'static str,
    /// Of the scene: volume, isovalue, albedo.
    volume: &'static str,
    isovalue: f64,
    albedo: f64,
    /// The brightest light: environment, luminaire, or the level set itself.
    brightest: f64,
    /// What else the scene holds.
    rest: &'static str,
    /// Effects that the plan must switch off.
    off: &'static [&'static str],
}

const CONSTANT: &str = "[probe]\nname = \"constant\"\n";
const LAMP: &str = "[[luminaires]]\nname = \"lamp\"\nshape = \"rectangle\"\ncorner = [0.3, 0, 0.3]\nu = [0, 0, 0.4]\n\
    v = [0.4, 0, 0]\npower = 0.5026548245743669\n";

/// 0.16 π W on 0.16 m²: radiance 1.
const SCENES: [Planned; 8] = [
    Planned {
        name: "convex",
        volume: "sphere:17",
        isovalue: -0.6,
        albedo: 0.7,
        brightest: 1.0,
        rest: "",
        off: &["shadowing", "interreflection", "walls", "luminaires", "caustics", "media", "colour-channels"],
    },
    Planned {
        name: "dark",
        volume: "gyroid:17",
        isovalue: 0.0,
        albedo: 0.15,
        brightest: 1.0,
        rest: "",
        off: &["walls", "luminaires", "caustics", "media", "emission"],
    },
    Planned {
        name: "bowl",
        volume: "bowl:17",
        isovalue: 0.7,
        albedo: 0.4,
        brightest: 1.0,
        rest: "",
        off: &["walls", "luminaires", "caustics", "media", "emission"],
    },
    Planned {
        name: "black",
        volume: "bumpbox:17",
        isovalue: 47.0,
        albedo: 0.0,
        brightest: 1.0,
        rest: "",
        off: &["interreflection", "walls", "luminaires", "caustics", "media", "emission"],
    },
    Planned {
        name: "glowing",
        volume: "gyroid:17",
        isovalue: 0.5,
        albedo: 0.3,
        brightest: 2.0,
        rest: "emission = 1.0\n",
        off: &["walls", "luminaires", "caustics", "media"],
    },
    Planned {
        name: "closed room",
        volume: "bumpbox:17",
        isovalue: 47.0,
        albedo: 0.5,
        brightest: 1.0,
        rest: "[[walls]]\nshape = \"room\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nalbedo = [0.6, 0.4, 0.3]\n",
        off: &["caustics", "media", "emission"],
    },
    Planned {
        name: "open room",
        volume: "bumpbox:17",
        isovalue: 47.0,
        albedo: 0.5,
        brightest: 1.0,
        rest: "[[walls]]\nshape = \"room\"\nmin = [-0.1, -0.1, -0.1]\nmax = [1.1, 1.1, 1.1]\nalbedo = 0.5\nopen = \"-y\"\n",
        off: &["luminaires", "caustics", "media", "emission"],
    },
    Planned {
        name: "glass",
        volume: "bumpbox:17",
        isovalue: 47.0,
        albedo: 0.5,
        brightest: 1.0,
        rest: "[[objects]]\nshape = \"sphere\"\ncentre = [0.5, 0.15, 0.5]\nradius = 0.1\nmaterial = \"glass\"\n",
        off: &["media", "emission"],
    },
];

fn row<'a>(plan: &'a Value, name: &str) -> &'a Value {
    plan["effects"].as_array().expect("rows").iter().find(|e| e["name"] == name).expect("a row")
}

/// Mean radiance of the vertices (its three channels are the last before the errors), and how many there are.
fn mean_radiance(bytes: &[u8]) -> (f64, usize) {
    let all = radiance(bytes);
    let sum: f64 = all.iter().map(|v| v.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0).sum();
    (sum / all.len() as f64, all.len())
}

#[test]
fn eight_scenes_planned_and_full() {
    for scene in SCENES {
        let bench = Bench::new();
        let Planned { name, volume, isovalue, albedo, .. } = scene;
        let light = if scene.off.contains(&"luminaires") { CONSTANT } else { LAMP };
        let text = format!(
            "volume = \"{volume}\"\nisovalues = {isovalue}\n[material]\nalbedo = {albedo}\n{}{light}[bake]\nrays = 32\nbands = 2\n",
            scene.rest
        );
        bench.write("s.toml", text);
        let needed = bench.json("plan s.toml --layers 8")["layers_needed"].as_u64().expect("a number");
        let plan = bench.json(&format!("plan s.toml --layers {needed}"));
        let stated: f64 = plan["effects"].as_array().expect("rows").iter().filter_map(|e| e["error"].as_f64()).sum();
        let baked = bench.json(&format!("bake s.toml --layers {needed} -o planned.isolume"));
        for effect in scene.off {
            assert_eq!(row(&plan, effect)["on"], false, "{name}: {effect}");
            let counters = baked["bake"]["effects"][effect].as_object();
            for (what, count) in counters.into_iter().flatten().filter(|(what, _)| !what.contains("rays_saved")) {
                assert!(*count == 0 || what == "open_texels", "{name}: {effect} {what} {count}");
            }
        }
        let alone = !scene.rest.contains("shape") && !light.contains("shape");
        let traced = if alone { "--effects +shadowing" } else { "" };
        bench.json(&format!("bake s.toml --layers 8 {traced} -o full.isolume"));
        let env = if light == LAMP { "constant:0" } else { "constant" };
        let emission = if scene.rest.contains("emission") { "--emission 1" } else { "" };
        let lit = |store: &str| {
            let line =
                format!("relight {store}.isolume --isovalue {isovalue} --env {env} --albedo {albedo} {emission}");
            let told = bench.json(&format!("{line} --exposure 0 --radiance -o {store}.ply"));
            let rms = told["files"][0]["error"]["rms_over_mean"].as_f64().expect("an error");
            let (mean, count) = mean_radiance(&bench.bytes(&format!("{store}.ply")));
            // Of eight texels that a vertex reads, vertices around share most.
            (mean, rms * mean / (count as f64 / 8.0).sqrt())
        };
        let ((planned, noise), (full, noise_of_full)) = (lit("planned"), lit("full"));
        let allowed = stated * scene.brightest + 4.0 * noise.hypot(noise_of_full);
        println!(
            "{name}: {needed} layers, stated {stated:.5}, planned {planned:.5}, full {full:.5}, difference {:.5}, noise {:.5}",
            (planned - full).abs(),
            noise.hypot(noise_of_full)
        );
        assert!((planned - full).abs() <= allowed, "{name}: {planned} for {full}, allowed {allowed}, {needed} layers");
        assert!(full > 0.0 || albedo == 0.0, "{name}: {full}");
        // It is a bound that says something.
        assert!(stated < 0.05, "{name}: {stated}");
    }
}
