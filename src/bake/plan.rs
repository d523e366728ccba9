//! The plan of a bake: what its effects cost, from trials of a few texels.

use super::quality::RAYS;
use super::scene::bytes_of_scene_texel;
use super::{Estimator, Hints, Request};
use crate::error::Result;
use crate::level::Pyramid;
use crate::scene as scenes;
use crate::transfer::Selection;
use crate::transport::{Bake, Settings, Tolerance, pilot, share_traced};
use serde_json::{Value, json};

/// Texels and rays of the trial that the plan rests on.
pub(super) const PILOT_TEXELS: u64 = 2000;
pub(super) const PILOT_RAYS: u32 = 16;
/// Bricks of the trial that tells how much an adaptive texture leaves out.
const PILOT_BRICKS: usize = 64;
/// Accepted error of what the plan drops, relative to the brightest light.
const TOLERANCE: f64 = 0.01;

impl Request<'_> {
    /// The plan of effects, from a trial of a few texels.
    ///
    /// # Errors
    /// Those of the trial: a volume without cells, rays that are no power of two; what the estimator cannot do.
    #[doc(hidden)]
    pub fn plan(&self, pyramid: &Pyramid) -> Result<scenes::Plan> {
        self.check_estimator()?;
        let selection = self.selection();
        let share = self.share_traced(pyramid, &selection)?;
        self.plan_of(pyramid, &selection, (self.isovalues.as_deref(), share), self.settings.rays, self.hints)
    }

    /// The share of the texels that an adaptive texture traces: of 64 bricks.
    pub(super) fn share_traced(&self, pyramid: &Pyramid, selection: &Selection) -> Result<f64> {
        let Some(error) = self.adaptive else { return Ok(1.0) };
        self.check_adaptive(error)?;
        let settings = Settings { rays: RAYS, target: None, ..self.settings.clone() };
        let bake = self.bake(pyramid, &settings, selection);
        let tolerance = Tolerance::new(&bake, error)?;
        let all = selection.bricks();
        let stride = all.len().div_ceil(PILOT_BRICKS).max(1);
        let bricks: Vec<[usize; 3]> = all.into_iter().skip(stride / 2).step_by(stride).collect();
        share_traced(&Bake { tolerance: Some(&tolerance), ..bake }, &bricks)
    }

    fn plan_of(
        &self,
        pyramid: &Pyramid,
        selection: &Selection,
        (isovalues, traced_share): (Option<&[f64]>, f64),
        rays: u32,
        hints: Hints,
    ) -> Result<scenes::Plan> {
        let (volume, layout) = (self.volume, &self.layout);
        let (pilot, surroundings) = match self.geometry {
            Some(geometry) => {
                let (pilot, surrounded) = self.plan_of_scene(geometry, pyramid, selection)?;
                (pilot, Some(surrounded))
            }
            None => (self.pilot_of_volume(pyramid, selection)?, None),
        };
        let mut plan = scenes::plan(&scenes::PlanInput {
            texels: layout.lattice.texels().iter().map(|&m| m as u64).product(),
            selected: selection.len(),
            isovalues,
            rays,
            bands: layout.layers.bands(),
            albedo: hints.albedo,
            emission: hints.emission,
            convex: volume.is_convex() && self.geometry.is_none(),
            effects: self.effects,
            sun_split: hints.sun_split,
            tolerance: TOLERANCE,
            bytes_per_texel: bytes_of_scene_texel(&layout.layers, self.geometry),
            traced_share,
            pilot: &pilot,
            surroundings: surroundings.as_ref(),
        });
        if self.estimator == Estimator::Gather {
            self.plan_cache(&mut plan, rays);
        }
        Ok(plan)
    }

    /// What `gather` makes of a plan: its paths end where they first meet the level set, and those of the cache do not.
    fn plan_cache(&self, plan: &mut scenes::Plan, rays: u32) {
        let how = self.gather_settings();
        let Some(row) = plan.effects.iter_mut().find(|row| row.name == "interreflection" && row.on) else { return };
        row.setting += &format!(", by a cache that {} paths a texel fill", (how.passes - 1) * how.cache_rays);
        row.reason += "; where a path meets its level set the texture says the rest, with a bias that the bake prints";
        let cache = f64::from((how.passes - 1) * how.cache_rays) / f64::from(rays.max(1));
        let all = 1.0 - row.cost_share + cache;
        row.cost_share = cache;
        plan.effects.iter_mut().for_each(|row| row.cost_share /= all);
        plan.rays *= all;
    }

    fn pilot_of_volume(&self, pyramid: &Pyramid, selection: &Selection) -> Result<scenes::Pilot> {
        let settings = Settings { rays: PILOT_RAYS, target: None, ..self.settings.clone() };
        let trial = pilot(&self.bake(pyramid, &settings, selection), PILOT_TEXELS)?;
        Ok(scenes::Pilot {
            texels: trial.texels,
            valid: trial.valid,
            paths: trial.paths,
            rays: trial.counts.rays,
            escapes: trial.mean_escapes(),
            lost_share: trial.lost_share(),
            open: trial.open,
        })
    }

    /// How the store was made. Nothing in it depends on the machine, the threads or the clock, nor on what may grow
    /// later: isovalues, rays and errors stand with the chunks. So the plan is that of all isosurfaces at 64 rays.
    pub(super) fn provenance(&self, pyramid: &Pyramid) -> Result<Value> {
        let selection = Selection::of_all_isosurfaces(self.layout.lattice, self.volume);
        let plan = self.plan_of(pyramid, &selection, (None, 1.0), 64, Hints::default())?;
        Ok(json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "input": self.label,
            "plan": plan.effects,
        }))
    }
}
