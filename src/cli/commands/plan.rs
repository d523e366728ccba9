//! `isolume plan`: what a bake would simulate, and why.

use crate::bake::Hints;
use crate::cli::args::transfer::{BakeArgs, parse_time};
use crate::cli::args::volume::VolumeArgs;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::lent::clock;
use crate::cli::present::{effects, forecast, text};
use crate::level::Pyramid;
use crate::probe::Orientation;
use crate::scene::geometry::Geometry;
use crate::scene::{Scene, SceneFile, environment};
use crate::study::forecast as forecasts;
use crate::volume::isovalue::Chosen;
use serde_json::{Value, json};
use std::time::Duration;

/// Show which effects a bake needs, with the reason and the error of what is dropped
///
/// A trial of two thousand texels with 16 rays each estimates what the volume does to light. Nothing is
/// written.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  isolume plan brain.nii.gz --isovalues auto --rays 256\n  isolume plan brain.nii.gz --isovalues 90 --time 2m\n  isolume plan scene.toml --effects -interreflection"
)]
pub(in crate::cli) struct Plan {
    /// Volume file, a field such as bumpbox or gyroid:128, an implicit model or a scene (.toml)
    #[arg(value_name = "VOLUME|SCENE")]
    input: String,
    #[command(flatten)]
    bake: BakeArgs,
    #[command(flatten)]
    volume: VolumeArgs,
    /// Largest albedo that will be asked for [default: 0.7]
    #[arg(long, value_name = "RHO")]
    albedo: Option<f32>,
    /// Forecast from a pilot which texture and rays to bake with, so that it takes this long; --error 2% forecasts what a
    /// relit error of 2 % takes
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    time: Option<Duration>,
    /// Environment of the forecast [default: the scene's, else courtyard]
    #[arg(long, value_name = "PROBE")]
    for_env: Option<String>,
    #[arg(skip)]
    pub(in crate::cli) scene: Option<SceneFile>,
}

impl Plan {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let transfer = &self.bake.transfer;
        let mut scene = transfer.scene(&self.volume).open(&self.input, self.scene.as_ref())?;
        let (mut plans, mut isovalues) = (Vec::new(), Vec::new());
        for member in 0..scene.members().len() {
            let (plan, chosen) = self.run_member(&mut scene, member, seed, console)?;
            plans.push(plan);
            isovalues.push(chosen);
        }
        let mut json = match plans.as_slice() {
            [one] => one.clone(),
            all => json!({ "volumes": all }),
        };
        if self.time.is_some() || transfer.error.is_some() {
            forecasts::check("--time and --error", self.bake.estimator)?;
            json["forecast"] = self.forecast(&scene, &isovalues, seed, console)?;
        }
        console.print_json(&json);
        Ok(())
    }

    /// The plan of one volume of a scene, and the isovalues asked for.
    fn run_member(
        &self,
        scene: &mut Scene,
        member: usize,
        seed: u64,
        console: &Console,
    ) -> Outcome<(Value, Option<Vec<f64>>)> {
        let opened = &mut scene.members_mut()[member];
        let scene = self.scene.as_ref();
        let chosen = opened.settle_in(&self.bake.isovalues, scene)?;
        chosen.iter().flatten().flat_map(Chosen::notes).for_each(|text| console.note(text));
        let isovalues: Option<Vec<f64>> = chosen.map(|list| list.iter().map(|c| c.value).collect());
        let (volume, geometry, quality) = (&*opened.volume, opened.geometry.as_ref(), self.bake.quality(seed));
        let mut job = quality.request(opened, isovalues, Vec::new())?;
        job.hints = Hints::of_scene(scene, volume.value_range(), job.isovalues.as_deref());
        job.hints.albedo = self.albedo.or(job.hints.albedo);
        if let Some(albedo) = self.albedo {
            crate::relight::Material::new([albedo; 3], [0.0; 3])?;
        }
        let pyramid = Pyramid::new(volume);
        let plan = job.plan(&pyramid)?;
        if let Some(among) = geometry.and_then(Geometry::among) {
            console.print(format!("{}{}:", if member > 0 { "\n" } else { "" }, among.name));
        }
        console.print(effects::table(&plan));
        console.print(format!(
            "\n{} texels with a level set{}, {}rays, at most {} in the store, about {} of memory",
            text::count(plan.valid_texels as u64),
            plan.left_out(),
            text::metric(plan.rays),
            text::bytes(plan.bytes),
            text::bytes(job.bytes_needed() as f64)
        ));
        let mut json = serde_json::to_value(&plan).unwrap_or_default();
        json["memory_bytes"] = json!(job.bytes_needed());
        if let Some(among) = geometry.and_then(Geometry::among) {
            json["volume"] = json!(among.name);
        }
        Ok((json, job.isovalues))
    }

    /// Weighs textures and rays by a pilot and prints what they take and give.
    fn forecast(&self, scene: &Scene, isovalues: &[Option<Vec<f64>>], seed: u64, console: &Console) -> Outcome<Value> {
        let Some(first) = scene.members().first() else {
            return Err(Failure::Message("a scene without volumes".into()));
        };
        let (probe, turned) = environment(self.for_env.as_deref(), self.scene.as_ref())?;
        let (isovalue, all) = forecasts::weigh(
            &forecasts::Asked {
                members: scene.members(),
                isovalues,
                quality: &self.bake.quality(seed),
                probe: &probe,
                orientation: Orientation::new(first.volume.up, turned)?,
                albedo: self.albedo.unwrap_or(0.7),
            },
            &clock(),
        )?;
        let threads = rayon::current_num_threads();
        let by_time = self.time.and_then(|t| forecasts::best_within(&all, t.as_secs_f64() * threads as f64));
        let by_error = self.bake.transfer.error.and_then(|e| forecasts::cheapest_within(&all, f64::from(e)));
        let chosen = if self.time.is_some() { by_time } else { by_error };
        console.print(format!(
            "\nforecast, {threads} threads: error is the RMS of the relit radiance of isovalue {} over its mean, under {} cut to the bands",
            text::number(isovalue, 6),
            probe.name
        ));
        console.print(forecast::table(&all, chosen.map(|(w, f)| (w.ratio, f.rays)), threads));
        match chosen {
            Some((weighed, found)) => console.print(format!(
                "bake with: --texture {} --rays {}   (about {}, {} error, {})",
                weighed.ratio,
                found.rays,
                text::duration(Duration::from_secs_f64(found.seconds / threads as f64)),
                text::percent(found.error),
                text::bytes(weighed.bytes as f64)
            )),
            None => console
                .print("nothing reaches that: give more time, a larger error, or a finer texture than the data's"),
        }
        let rows: Vec<Value> =
            all.iter().flat_map(|w| (4..=12).map(move |k| w.to_json(&w.pilot.forecast(1 << k), threads))).collect();
        Ok(json!({ "isovalue": isovalue, "environment": probe.name, "rows": rows,
            "chosen": chosen.map(|(w, f)| w.to_json(&f, threads)) }))
    }
}
