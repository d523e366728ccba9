//! What a contraction reads: the texture of the environment and, in a scene, those of what else shines.

use crate::error::{Error, Result};
use crate::transfer::{BrickSource, Layout};

/// A luminaire's texture and the factor on what it holds: that of its storage (2^exponent) times that on its power.
#[derive(Clone, Copy)]
pub struct LuminaireLight<'a> {
    /// G_k, see [`crate::transfer::Group`].
    pub texture: &'a dyn BrickSource,
    /// For red, green and blue.
    pub factor: [f64; 3],
}

/// The textures of a scene besides that of the environment.
pub(in super::super) struct Surroundings<'a> {
    pub(in super::super) emission: &'a dyn BrickSource,
    pub(in super::super) luminaires: Vec<LuminaireLight<'a>>,
}

/// The textures that are lit together: those of a volume alone, or of a scene.
pub struct Textures<'a> {
    // Invariant: one channel without surroundings, three with them; what stands there has one band in each of as many
    // layers, three channels, and the same lattice.
    pub(in super::super) environment: &'a dyn BrickSource,
    pub(in super::super) surroundings: Option<Surroundings<'a>>,
}

impl<'a> Textures<'a> {
    /// The grey transfer of a volume alone.
    ///
    /// # Errors
    /// When it is the coloured transfer of a scene, which needs the textures of its surroundings.
    pub fn of_volume(texture: &'a dyn BrickSource) -> Result<Self> {
        if texture.layout().layers.channels() != 1 {
            let expected = "the grey transfer of a volume alone";
            let remedy = "give the textures of emission and luminaires too: Textures::of_scene";
            return Err(Error::argument("texture", "the coloured transfer of a scene", expected, remedy));
        }
        Ok(Self { environment: texture, surroundings: None })
    }

    /// The transfer of a scene in three channels, that of the level set's own emission, and those of its luminaires
    /// with their factors.
    ///
    /// # Errors
    /// When they are not the textures of one scene: other lattices, layers, bands or channels.
    pub fn of_scene(
        environment: &'a dyn BrickSource,
        emission: &'a dyn BrickSource,
        luminaires: &[LuminaireLight<'a>],
    ) -> Result<Self> {
        let layout = environment.layout();
        let belongs = |source: &dyn BrickSource| {
            let other = source.layout();
            let same = other.lattice == layout.lattice && other.layers.len() == layout.layers.len();
            same && other.layers.channels() == 3 && other.layers.max_bands() == 1
        };
        let all = belongs(emission) && luminaires.iter().all(|l| belongs(l.texture));
        if layout.layers.channels() != 3 || !all {
            let remedy = "take all of them from one store of a scene";
            return Err(Error::argument("textures", "different layouts", "the textures of one scene", remedy));
        }
        let surroundings = Surroundings { emission, luminaires: luminaires.to_vec() };
        Ok(Self { environment, surroundings: Some(surroundings) })
    }

    /// That of the environment.
    pub fn environment(&self) -> &'a dyn BrickSource {
        self.environment
    }

    /// That of the level set's own emission; `None` for a volume alone.
    pub fn emission(&self) -> Option<&'a dyn BrickSource> {
        self.surroundings.as_ref().map(|surroundings| surroundings.emission)
    }

    /// Those of the luminaires; none for a volume alone.
    pub fn luminaires(&self) -> &[LuminaireLight<'a>] {
        self.surroundings.as_ref().map_or(&[], |surroundings| &surroundings.luminaires)
    }

    /// Lattice and layers of the environment's texture.
    pub fn layout(&self) -> &'a Layout {
        self.environment.layout()
    }
}
