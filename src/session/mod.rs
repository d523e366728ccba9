//! A session of relighting: a store is opened once, surfaces are extracted once, and each is lit by as many
//! environments and materials as wanted. Nothing is traced but what no texture holds: suns that were split off, camera
//! rays, and the walls of pictures.
//!
//! [`Session::open`] reads the volumes of a store, [`Session::surface`] extracts an isosurface (of volumes that were
//! baked together those that belong together), [`Session::light`] prepares an environment, [`Surface::lit`] multiplies
//! the two, and [`Lit`] is written or pictured. Who has to measure or share the steps takes them one by one:
//! [`Member::extract`], [`Member::select`], [`Session::surface_of`]; [`Surface::contract`], [`LitTexels::look_up`].
//!
//! ```
//! # use isolume::{Bake, Silent};
//! use isolume::probe;
//! use isolume::relight::Material;
//! use isolume::session::{LightOptions, LitOptions, MeshOptions, Session};
//!
//! # fn main() -> isolume::Result<()> {
//! # let folder = tempfile::tempdir().map_err(|e| isolume::Error::io("", "make a folder", e))?;
//! # let scene = isolume::Scene::open("bumpbox:12")?;
//! # let bake = Bake::of(&scene).isovalues([47.0]).layers(2).bands(3).rays(16);
//! # let (store, _) = bake.run(folder.path().join("bumps.isolume"), &Silent)?;
//! let session = Session::open(&store)?;
//! let surface = session.surface(47.0)?;
//! let probe = probe::open("sky", &Default::default())?;
//! let light = session.light(&probe, &LightOptions::default())?;
//! let lit = surface.lit(&light, &Material::new([0.7; 3], [0.0; 3])?, &LitOptions::default())?;
//! lit.write_gltf(folder.path().join("bumps.glb"), &MeshOptions::default())?;
//! assert_eq!(lit.radiance().len(), surface.vertices());
//! # Ok(())
//! # }
//! ```

mod among;
mod error;
mod field;
mod file;
mod isosurface;
mod light;
mod lit;
mod material;
mod member;
mod picture;
mod relightable;
mod scale_bar;
mod surface;
mod textures;
mod tone;
mod haze;
mod walls;
mod write;

#[cfg(test)]
mod tests;

pub(crate) use among::LitByPaths;
#[doc(hidden)]
pub use field::RelitField;
#[doc(hidden)]
pub use file::{Content, FRAME, FileOptions, FileTimes, Turntable, WrittenFile};
pub use isosurface::Isosurface;
pub use light::{LightNote, LightOptions, Lighting, SUN_RAYS};
pub use lit::{Lit, LitOptions, LitTexels};
#[doc(hidden)]
pub use material::MaterialChoice;
pub use member::Member;
pub use picture::{Background, Framing, PictureOptions, Still};
pub use surface::{Merged, Part, Surface};
pub use textures::LuminaireFactor;
#[doc(hidden)]
pub use textures::{Groups, check_factors, factor_of, radiance_of_bricks, refuse_body, with_medium_albedo};
pub use tone::Tone;
pub use write::{MeshFile, MeshOptions, USDZ_SIDE};
#[doc(hidden)]
pub use write::{lightmap_json, simplified_json, total_json};

use crate::error::{Error, Result};
use crate::geom::Up;
use crate::level::Pyramid;
use crate::probe::{Probe, SunSplit};
use crate::quantity::number;
use crate::scene::geometry::Geometry;
use crate::scene::{NamedIsovalue, nearest};
use crate::transfer::store::Store;
use crate::volume::Volume;
use crate::volume::isovalue::Chosen;
use member::{Held, coupling_of, partnered};
use std::sync::{Arc, OnceLock};

/// The volumes of a store, ready for surfaces to be lit: the one that stands alone, or all that were baked together.
pub struct Session<'a> {
    // Invariant: not empty; more than one only of a store whose volumes are coupled, in the order of the store.
    members: Vec<Member<'a>>,
    up: Up,
    geometry: Option<Held<'a, Geometry>>,
    // What stands around each member that was baked among others, where that is known.
    beside: OnceLock<Vec<Option<Geometry>>>,
}

impl Session<'static> {
    /// As [`Session::open`], of a store that becomes the session's own: it may live as long as it is wanted.
    ///
    /// # Errors
    /// As [`Session::open`].
    pub fn owning(store: Store) -> Result<Self> {
        match coupling_of(&store) {
            None => Self::of_members(vec![Member::owning(store)?]),
            Some(_) => Self::of_members(coupled(&store)?),
        }
    }

    /// As [`Session::alone`], of a store that becomes the session's own, and a volume that others have too.
    #[doc(hidden)]
    pub fn sharing(store: Store, volume: Arc<Volume>, pyramid: Arc<Pyramid>) -> Self {
        let up = volume.up;
        Self { members: vec![Member::sharing(store, volume, pyramid)], up, geometry: None, beside: OnceLock::new() }
    }

    /// As [`Session::with_geometry`], of walls and luminaires that become the session's own.
    #[must_use]
    pub fn with_own_geometry(self, geometry: Option<Geometry>) -> Self {
        Self { geometry: geometry.map(|geometry| Held::Own(Box::new(geometry))), beside: OnceLock::new(), ..self }
    }
}

/// The volumes of a store that were baked together.
fn coupled<'a>(store: &Store) -> Result<Vec<Member<'a>>> {
    let held = store.volumes()?;
    let partners = coupling_of(store).map_or(&[][..], |first| &first.partners);
    if let Some(missing) = partners.iter().find(|p| !held.contains(&p.name)) {
        let found = format!("{} without its partner {}", held.join(", "), missing.name);
        let remedy = "go on with the bake of the scene: the same command";
        return Err(Error::argument("store", found, "all volumes of the scene", remedy));
    }
    let mut members = Vec::new();
    for name in held {
        let store = store.of_volume(&name)?;
        if coupling_of(&store).is_some() {
            members.push(Member::owning(store)?);
        }
    }
    Ok(members)
}

impl<'a> Session<'a> {
    /// Reads the volumes of a store.
    ///
    /// # Errors
    /// When a volume is damaged, cannot be read or has no cells, or the bake of a scene has not come to all of its
    /// volumes.
    pub fn open(store: &'a Store) -> Result<Self> {
        match coupling_of(store) {
            None => Self::of_members(vec![Member::borrowing(store)?]),
            Some(_) => Self::of_members(coupled(store)?),
        }
    }

    fn of_members(members: Vec<Member<'a>>) -> Result<Self> {
        match members.first() {
            Some(first) => Ok(Self { up: first.volume().up, members, geometry: None, beside: OnceLock::new() }),
            None => Err(Error::argument("store", "no volume", "at least one", "bake it again")),
        }
    }

    /// One volume alone, which has been read already, with the pyramid over it: that of a store, or the same samples as
    /// a file had them. Of volumes that were baked together the others are left out.
    pub fn alone(store: &'a Store, volume: &'a Volume, pyramid: &'a Pyramid) -> Self {
        Self {
            members: vec![Member::of_parts(store, volume, pyramid)],
            up: volume.up,
            geometry: None,
            beside: OnceLock::new(),
        }
    }

    /// The same with another axis that points up: it turns environments, views, and what is written.
    #[must_use]
    pub fn with_up(self, up: Up) -> Self {
        Self { up, ..self }
    }

    /// The same with walls and luminaires in its pictures: a store holds what they do to light, and not their shapes.
    #[must_use]
    pub fn with_geometry(self, geometry: Option<&'a Geometry>) -> Self {
        Self { geometry: geometry.map(Held::Lent), beside: OnceLock::new(), ..self }
    }

    /// The volumes; isovalues without a name are those of the first.
    pub fn members(&self) -> &[Member<'a>] {
        &self.members
    }

    /// The axis that points up.
    pub fn up(&self) -> Up {
        self.up
    }

    /// Walls and luminaires that its pictures show.
    fn geometry(&self) -> Option<&Geometry> {
        self.geometry.as_deref()
    }

    fn first(&self) -> &Member<'a> {
        &self.members[0]
    }

    /// Whether walls or luminaires stand in the scene that pictures do not show, for want of [`Self::with_geometry`].
    #[doc(hidden)]
    pub fn lacks_walls(&self) -> bool {
        let scene = self.first().store().identity().scene.as_ref();
        self.geometry.is_none() && scene.is_some_and(|s| s.coupling.is_none() || !s.luminaires.is_empty())
    }

    /// The number of a member by its name.
    ///
    /// # Errors
    /// When there is none of that name.
    pub fn member(&self, name: &str) -> Result<usize> {
        if let Some(found) = self.members.iter().position(|m| m.name() == name) {
            return Ok(found);
        }
        let names: Vec<&str> = self.members.iter().map(Member::name).collect();
        let remedy = match nearest(name, names.iter().copied()) {
            Some(near) => format!("did you mean {near}?"),
            None => "see `isolume info` of the store".into(),
        };
        Err(Error::argument("isovalue", format!("{name}=…"), format!("one of {}", names.join(", ")), remedy))
    }

    /// The isovalue of every member that belongs to one of member number `of`, as the store couples them.
    ///
    /// # Errors
    /// When there is no such member, or the isovalue has no partner.
    pub fn isovalues(&self, of: usize, isovalue: f64) -> Result<Vec<f64>> {
        let Some(member) = self.members.get(of) else {
            let expected = format!("a number below {}, that of the volumes", self.members.len());
            return Err(Error::argument("member", of, expected, "take that of Session::member"));
        };
        self.members.iter().map(|partner| partnered(member, partner, isovalue)).collect()
    }

    /// The isovalue of each volume that belongs to one that was asked for, and how that of the first came about; `auto` is the one
    /// that the store holds, if it holds only some.
    ///
    /// # Errors
    /// When no volume has the name, no surface the isovalue, or it has no partner.
    #[doc(hidden)]
    pub fn choose(&self, named: &NamedIsovalue) -> Result<(Chosen, Vec<f64>)> {
        let from = named.volume.as_ref().map_or(Ok(0), |name| self.member(name)).map_err(as_option)?;
        let members = self.members();
        let of = &members[from];
        let chosen = of.store().choose(of.volume(), named.isovalue)?;
        let all = self.isovalues(from, chosen.value).map_err(as_option)?;
        let reason = all.iter().zip(members).map(|(c, m)| format!("{} {}", m.name(), number(*c, 6)));
        let reason = reason.collect::<Vec<_>>().join(", ");
        Ok((
            Chosen {
                reason: Some(chosen.reason.map_or(reason.clone(), |r| format!("{r}; {reason}"))),
                ..Chosen::given(all[0], members[0].volume().solid)
            },
            all,
        ))
    }

    /// The isosurface of an isovalue of the first member, with those of the others that belong to it.
    ///
    /// # Errors
    /// As [`Self::isovalues`] and [`Member::extract`].
    pub fn surface(&self, isovalue: f64) -> Result<Surface<'_>> {
        let isovalues = self.isovalues(0, isovalue)?;
        let parts = self.members.iter().zip(isovalues).map(|(member, c)| Ok(member.select(member.extract(c)?)));
        self.surface_of(parts.collect::<Result<Vec<_>>>()?)
    }

    /// A surface of isosurfaces that are there: one of each member, in their order.
    ///
    /// # Errors
    /// When there are more or fewer than members.
    pub fn surface_of(&self, parts: impl Into<Arc<Vec<Part>>>) -> Result<Surface<'_>> {
        let parts = parts.into();
        if parts.len() != self.members.len() {
            let expected = format!("one for each of the {} volumes", self.members.len());
            return Err(Error::argument("isosurfaces", parts.len(), expected, "extract that of each member"));
        }
        Ok(Surface::new(self, parts))
    }

    /// The light of a probe around the first member, cut and windowed at the band limit of each layer. Lamps that nobody asked to be lit
    /// apart stay in it where a scene has mirrors, glass or a translucent solid, or walls whose shapes are not known.
    ///
    /// # Errors
    /// As [`Lighting::new`].
    pub fn light<'p>(&self, probe: &'p Probe, options: &LightOptions) -> Result<Lighting<'p>> {
        let split_sun = match options.split_sun {
            SunSplit::Auto if !self.splits_lamps() => SunSplit::Off,
            split => split,
        };
        let options = LightOptions { split_sun, ..options.clone() };
        Lighting::new(probe, self.up, &self.first().store().layout().layers, &options)
    }
}

/// The error about an isovalue that an option gave.
fn as_option(error: Error) -> Error {
    match error {
        Error::Argument { name, given, expected, remedy } if name == "isovalue" => {
            Error::argument("--isovalue", given, expected, remedy)
        }
        other => other,
    }
}
