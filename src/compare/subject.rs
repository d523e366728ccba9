//! What a store is compared with: the volumes of it, what stood around them, and the isovalues that belong together.

use crate::bake::surroundings;
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::memory;
use crate::scene::geometry::Geometry;
use crate::scene::{NamedIsovalue, Scene};
use crate::session::Session;
use crate::transfer::store::{EstimatorIdentity, Shadows, Store};
use crate::transport::{PhotonScene, Settings, SpecularPhotons};
use crate::volume::Volume;

/// A volume of a store.
pub struct Subject {
    /// Its textures, one a group; that of the environment is the store of the volume.
    pub textures: Vec<Store>,
    /// The volume.
    pub volume: Volume,
    /// Its pyramid.
    pub pyramid: Pyramid,
    /// What stood around it.
    pub geometry: Option<Geometry>,
    /// Its name, where there are several.
    pub name: Option<String>,
}

impl Subject {
    fn new(store: Store, volume: Volume, pyramid: Pyramid, scene: Option<&Scene>) -> Result<Self> {
        let geometry = surroundings(&store, scene)?;
        let others = store.identity().groups().split_off(1);
        let others = others.iter().map(|group| store.group(group)).collect::<Result<Vec<_>>>()?;
        let name = geometry.as_ref().and_then(|geometry| Some(geometry.among()?.name.clone()));
        let textures = [store].into_iter().chain(others).collect();
        Ok(Self { textures, volume, pyramid, geometry, name })
    }

    /// How its texels were made, with another number of rays; `None` where they cannot be made again.
    pub fn baked_by(&self, rays: u32) -> Option<Settings> {
        let identity = self.textures[0].identity();
        let is_same_path = match identity.estimator {
            EstimatorIdentity::Path { shadowing } => shadowing == Shadows::Found,
            EstimatorIdentity::ScenePath { .. } => true,
            _ => false,
        } && identity.can_be_made_again();
        let layers = self.textures[0].layout().layers.clone();
        is_same_path.then_some(Settings {
            layers,
            rays,
            seed: identity.seed,
            target: None,
            positive: identity.positive,
        })
    }

    /// The textures of the vertices of an isosurface, one a group, where they have transfer of their own.
    ///
    /// # Errors
    /// When the store is damaged.
    pub fn at_vertices(&self, isovalue: f64) -> Result<Option<Vec<Store>>> {
        let Some(surface) = self.textures[0].surface(isovalue)? else { return Ok(None) };
        let others = surface.identity().groups().split_off(1);
        let others = others.iter().map(|group| surface.group(group)).collect::<Result<Vec<_>>>()?;
        Ok(Some(std::iter::once(surface).chain(others).collect()))
    }

    /// Whether light by way of mirrors and glass was baked.
    pub fn has_caustics(&self) -> bool {
        self.textures[0].identity().estimator.has_caustics()
    }

    /// Photons of light that paths did not find, as they were sent out for its texture, or for the vertices of one isosurface.
    ///
    /// # Errors
    /// As [`SpecularPhotons::new`].
    pub fn specular_photons(&self, isovalue: Option<f64>) -> Result<Option<SpecularPhotons>> {
        let identity = self.textures[0].identity();
        let Some(sent) = identity.estimator.specular_photons() else { return Ok(None) };
        let (volume, pyramid) = (&self.volume, &self.pyramid);
        let scene = PhotonScene { volume, pyramid, geometry: self.geometry.as_ref(), light: None };
        let limit = memory::default_limit();
        SpecularPhotons::new(&scene, identity.bands.len(), isovalue, (sent, identity.seed), limit)
    }

    /// Whether other volumes stand beside it.
    pub fn is_among_others(&self) -> bool {
        self.name.is_some()
    }
}

/// The volumes of a store and the isovalues of each, those that belong together at the same place. Isovalues without a
/// name are those of `of`, else of the first; with `of` it is the only volume.
///
/// # Errors
/// When no volume has such a name, no surface such an isovalue, or the store or the scene is not what the other needs.
pub fn subjects(
    store: Store,
    scene: Option<&Scene>,
    of: Option<&str>,
    isovalues: &[NamedIsovalue],
) -> Result<(Vec<Subject>, Vec<Vec<f64>>)> {
    if store.identity().scene.as_ref().is_none_or(|scene| scene.coupling.is_none()) {
        let named = isovalues.iter().find_map(|i| i.volume.as_ref());
        if let Some(name) = of.or(named.map(String::as_str)) {
            let expected = "a store of several volumes";
            return Err(Error::argument("--volume", name, expected, "leave the name out: it holds one alone"));
        }
        let volume = store.volume()?;
        let resolved = isovalues.iter().map(|i| Ok(i.isovalue.resolve(&volume, Some(volume.solid), None)?.value));
        let resolved = resolved.collect::<Result<Vec<f64>>>()?;
        let pyramid = Pyramid::new(&volume);
        return Ok((vec![Subject::new(store, volume, pyramid, scene)?], vec![resolved]));
    }
    let session = Session::open(&store)?;
    let named = |i: &NamedIsovalue| NamedIsovalue { volume: i.volume.clone().or(of.map(str::to_owned)), ..i.clone() };
    let resolved = isovalues.iter().map(|i| Ok(session.choose(&named(i))?.1)).collect::<Result<Vec<Vec<f64>>>>()?;
    let all = session.members().iter().map(|m| {
        let (volume, pyramid) = (m.volume().clone(), Pyramid::new(m.volume()));
        Subject::new(store.of_volume(m.name())?, volume, pyramid, scene)
    });
    let all = all.collect::<Result<Vec<_>>>()?;
    let of_member = |m: usize| resolved.iter().map(|row| row[m]).collect();
    let mut isovalues: Vec<Vec<f64>> = (0..all.len()).map(of_member).collect();
    let Some(name) = of else { return Ok((all, isovalues)) };
    let mut all = all;
    let place = all.iter().position(|s| s.name.as_deref() == Some(name)).unwrap_or(0);
    Ok((vec![all.swap_remove(place)], vec![isovalues.swap_remove(place)]))
}
