//! Bakes of a study, in memory.

use super::{Clock, Setting, Study};
use crate::bake::Estimator;
use crate::error::{Error, Result};
use crate::transfer::{BrickSource, Layers, Layout, MemoryTexture, Selection, texels_of_isosurface};
use crate::transport::{
    Bake, ChunkBricks, GatherSettings, PhotonBake, Progress, Settings, Summary, bake, gather, photon_bake,
};

/// The textures of a bake, one a group.
pub struct MemoryTextures(Vec<MemoryTexture>);

/// A bake in memory.
pub struct Baked {
    /// Its textures.
    pub textures: MemoryTextures,
    /// How it was made.
    pub settings: Settings,
    /// What it took.
    pub summary: Summary,
    /// Wall-clock and processor seconds.
    pub seconds: [f64; 2],
}

impl MemoryTextures {
    /// Textures in which nothing is baked.
    ///
    /// # Errors
    /// As [`crate::transfer::Group::layout`].
    pub fn new(bake: &Bake<'_>) -> Result<Self> {
        let each = bake.groups().into_iter().map(|group| Ok(MemoryTexture::new(group.layout(bake.layout)?)));
        Ok(Self(each.collect::<Result<_>>()?))
    }

    /// Puts the bricks of a chunk into their places.
    ///
    /// # Errors
    /// As [`MemoryTexture::insert_chunk`].
    pub fn insert_chunk(&mut self, chunk: [usize; 3], groups: ChunkBricks) -> Result<()> {
        self.0.iter_mut().zip(groups).try_for_each(|(texture, bricks)| texture.insert_chunk(chunk, bricks))
    }

    /// For contraction and lookup.
    pub fn sources(&self) -> Vec<&dyn BrickSource> {
        self.0.iter().map(|texture| texture as &dyn BrickSource).collect()
    }
}

impl Study<'_> {
    /// Bakes the texels that the surface needs.
    ///
    /// # Errors
    /// As [`bake`] and [`gather`]; the estimator `photon` in a scene.
    pub fn bake(&self, setting: &Setting, seed: u64, clock: &Clock<'_>) -> Result<Baked> {
        if self.surface.geometry.is_some() && setting.estimator == Estimator::Photon {
            let remedy = "leave it out: scenes are baked by path";
            return Err(Error::argument("estimator", setting.estimator.name(), "path or gather in a scene", remedy));
        }
        let (volume, isovalue) = (self.surface.volume, self.surface.isovalue);
        let lattice = setting.lattice(&self.surface)?;
        let layers = self.surface.layers_of(Layers::new(setting.bands.clone())?);
        let layout = Layout { lattice, layers: layers.clone() };
        let selection = match lattice.is_of_vertices() {
            true => Selection::all(lattice),
            false => texels_of_isosurface(volume, lattice, isovalue),
        };
        let settings = Settings { layers, rays: setting.rays, seed, target: None, positive: false };
        let job = self.surface.bake(&layout, &settings, &selection);
        let mut textures = MemoryTextures::new(&job)?;
        let mut keep = |chunk: [usize; 3], groups: ChunkBricks| textures.insert_chunk(chunk, groups);
        let (chunks, progress) = (job.chunks(), Progress::default());
        let before = clock();
        let summary = match setting.estimator {
            Estimator::Gather => {
                let options = GatherSettings { bias_texels: 0, ..GatherSettings::default() };
                gather(&job, &options, &chunks, &progress, &|_| Ok(None), &mut keep)?.summary
            }
            Estimator::Photon => {
                let texels: u64 = lattice.texels().iter().map(|&m| m as u64).product();
                let options = PhotonBake::for_texels(texels, setting.rays);
                photon_bake(&job, &options, &chunks, &progress, &|_| Ok(None), &mut keep)?.0
            }
            Estimator::Path => bake(&job, &chunks, &progress, &|_| Ok(None), &mut keep)?,
        };
        let after = clock();
        let seconds = [0, 1].map(|i| after[i] - before[i]);
        Ok(Baked { textures, settings, summary, seconds })
    }
}
