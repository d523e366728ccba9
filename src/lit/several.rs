//! Several volumes that light each other: baked one after the other into one store, and lit together.

use super::{Host, Job, Relit};
use crate::cache::{MemberBakes, lights};
use crate::error::Error;
use crate::scene::geometry::Geometry;
use crate::scene::{Scene, SceneFile};
use crate::transfer::store::Store;

impl Job<'_> {
    /// Bakes what all volumes of a scene need for the isovalues asked for, as exactly as the environments ask, and lights them.
    pub(super) fn light_scene<E: From<Error>>(&self, scene: &Scene, host: &Host<'_, E>) -> Result<Relit, E> {
        let cache = (host.cache)()?;
        let mut quality = self.quality.clone();
        quality.bands = self.scene.map(SceneFile::bands).unwrap_or_default().into_iter().map(usize::from).collect();
        let mut bakes = MemberBakes::new(&cache, &quality, self.scene, host.fill, host.note);
        let (mut rays, mut in_use) = (0, None);
        for member in scene.members() {
            let isovalues: Vec<f64> = bakes.choose(member, &self.isovalues)?.iter().map(|c| c.value).collect();
            let volume = &*member.volume;
            let layers = quality.layout(volume, member.geometry.as_ref())?.layers;
            let rule = self.material.rule_in(self.scene, volume.value_range())?;
            let albedo = rule.largest_albedo(Some(&isovalues));
            let up = self.how.volume.up_of(volume.up)?;
            let splits = Geometry::splits_lamps(member.geometry.as_ref());
            let lights = lights(self.probes, (up, &layers), &self.light_options(splits), albedo)?;
            let filled = bakes.bake(member, Some(isovalues), lights)?;
            (host.filled)(&filled);
            rays += filled.report.summary.counts.rays;
            in_use = Some(filled.in_use);
        }
        let Some(path) = bakes.path() else {
            return Err(Error::argument("scene", "no volume", "at least one", "give a volume").into());
        };
        let store = Store::open(path)?;
        let geometry = scene.members().first().and_then(|first| first.geometry.as_ref());
        let done = self.light_members(&store, geometry, rays, host)?;
        cache.tidy(host.note);
        drop(in_use);
        Ok(done)
    }
}
