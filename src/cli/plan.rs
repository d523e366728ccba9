//! `isolume plan`: what a bake would simulate, and why.

use super::baking::{Goal, Hints, Job, layout_of_scene};
use super::console::Console;
use super::input::VolumeArgs;
use super::options::BakeArgs;
use super::scene::SceneFile;
use super::{Outcome, text};
use crate::level::Pyramid;
use crate::scene;
use std::time::Instant;

/// Show which effects a bake needs, with the reason and the error of what is dropped
///
/// A trial of two thousand texels with 16 rays each estimates what the volume does to light. Nothing is
/// written.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  isolume plan brain.nii.gz --isovalues auto --rays 256\n  isolume plan scene.toml --effects -interreflection"
)]
pub(super) struct Plan {
    /// Volume file, a field such as bumpbox or gyroid:128, or a scene (.toml)
    #[arg(value_name = "VOLUME|SCENE")]
    input: String,
    #[command(flatten)]
    bake: BakeArgs,
    #[command(flatten)]
    volume: VolumeArgs,
    /// Largest albedo that will be asked for [default: 0.7]
    #[arg(long, value_name = "RHO")]
    albedo: Option<f32>,
    #[arg(skip)]
    pub(super) scene: Option<SceneFile>,
}

impl Plan {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let scene = self.scene.as_ref();
        let mut opened = super::scene::open(&self.input, &self.volume, scene, &self.bake.transfer.effects())?;
        self.bake.transfer.switch_shadows(&mut opened.volume);
        let volume = &opened.volume;
        let geometry = opened.geometry.as_ref();
        let layout = layout_of_scene(self.bake.transfer.layout(volume, &self.bake.bands)?, geometry);
        let settings = self.bake.transfer.settings(&layout, seed, false);
        let chosen = self.bake.isovalues(volume, opened.default_isovalue, scene)?;
        let isovalues: Option<Vec<f64>> = chosen.map(|list| list.iter().map(|c| c.value).collect());
        let memory_limit = self.bake.transfer.memory_limit;
        let goal = Goal { error: self.bake.transfer.error, ..Goal::default() };
        let (label, estimator, start) = (&opened.label, self.bake.estimator, Instant::now());
        let mut hints = Hints::of_scene(scene, volume.value_range(), isovalues.as_deref());
        hints.albedo = self.albedo.or(hints.albedo);
        let effects = &self.bake.transfer.effects();
        let share = None;
        let job = Job {
            volume,
            label,
            layout,
            settings,
            goal,
            estimator,
            isovalues,
            share,
            memory_limit,
            start,
            effects,
            hints,
            geometry,
        };
        if let Some(albedo) = self.albedo {
            crate::relight::Material::new([albedo; 3], [0.0; 3])?;
        }
        let pyramid = Pyramid::new(volume);
        let plan = job.plan(&pyramid)?;
        console.print(table(&plan));
        console.print(format!(
            "\n{} texels with a level set, {}rays, at most {} in the store",
            text::count(plan.valid_texels as u64),
            text::metric(plan.rays),
            text::bytes(plan.bytes)
        ));
        let json = serde_json::to_value(&plan).unwrap_or_default();
        console.print_json(&json);
        Ok(())
    }
}

/// The plan as a table.
pub(super) fn table(plan: &scene::Plan) -> String {
    let header = ["effect", "", "setting", "cost", "error of what is dropped", "reason"].map(String::from).to_vec();
    let mut rows = vec![header];
    for effect in &plan.effects {
        let kind = if effect.estimated { "estimate" } else { "bound" };
        rows.push(vec![
            effect.name.into(),
            if effect.on { "on" } else { "off" }.into(),
            effect.setting.clone(),
            if effect.cost_share > 0.0 { format!("{:.0} %", 100.0 * effect.cost_share) } else { "-".into() },
            effect.error.map_or("-".into(), |e| format!("{} ({kind})", text::percent(e))),
            effect.reason.clone(),
        ]);
    }
    text::table(&rows)
}
