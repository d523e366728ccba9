//! A volume of a session, and how the isovalues of several go together.

use super::{Isosurface, Part};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::quantity::number;
use crate::scene::IsovalueMap;
use crate::transfer::store::{CouplingIdentity, Store};
use crate::volume::Volume;
use std::ops::Deref;
use std::sync::Arc;

/// What a session owns, shares with others, or was lent.
pub(super) enum Held<'a, T> {
    Own(Box<T>),
    Shared(Arc<T>),
    Lent(&'a T),
}

impl<T> Deref for Held<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        match self {
            Self::Own(own) => own,
            Self::Shared(shared) => shared,
            Self::Lent(lent) => lent,
        }
    }
}

/// A volume of a store with its transfer.
pub struct Member<'a> {
    store: Held<'a, Store>,
    volume: Held<'a, Volume>,
    pyramid: Held<'a, Pyramid>,
}

/// What the volume of a store was baked among; none where it stands alone.
pub(super) fn coupling_of(store: &Store) -> Option<&CouplingIdentity> {
    store.identity().scene.as_ref()?.coupling.as_ref()
}

impl<'a> Member<'a> {
    pub(super) fn of_parts(store: &'a Store, volume: &'a Volume, pyramid: &'a Pyramid) -> Self {
        Self { store: Held::Lent(store), volume: Held::Lent(volume), pyramid: Held::Lent(pyramid) }
    }

    pub(super) fn sharing(store: Store, volume: Arc<Volume>, pyramid: Arc<Pyramid>) -> Self {
        Self { store: Held::Own(Box::new(store)), volume: Held::Shared(volume), pyramid: Held::Shared(pyramid) }
    }

    pub(super) fn borrowing(store: &'a Store) -> Result<Self> {
        Self::reading(Held::Lent(store))
    }

    pub(super) fn owning(store: Store) -> Result<Self> {
        Self::reading(Held::Own(Box::new(store)))
    }

    fn reading(store: Held<'a, Store>) -> Result<Self> {
        let volume = store.volume()?;
        volume.check_cells()?;
        let pyramid = Held::Shared(Arc::new(Pyramid::new(&volume)));
        Ok(Self { store, volume: Held::Shared(Arc::new(volume)), pyramid })
    }

    /// The transfer.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The volume.
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// The pyramid over the volume.
    pub fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    /// The volume with its pyramid, for who keeps them; `None` where they were lent.
    pub(super) fn shared(&self) -> Option<(Arc<Volume>, Arc<Pyramid>)> {
        match (&self.volume, &self.pyramid) {
            (Held::Shared(volume), Held::Shared(pyramid)) => Some((volume.clone(), pyramid.clone())),
            _ => None,
        }
    }

    /// Its name in the scene; that of the volume where it stands alone.
    pub fn name(&self) -> &str {
        coupling_of(&self.store).map_or(&self.volume.name, |coupling| &coupling.name)
    }

    /// The factor on its albedo that its transfer holds.
    pub(super) fn tint(&self) -> [f32; 3] {
        coupling_of(&self.store).map_or([1.0; 3], |coupling| coupling.tint)
    }

    /// Its isosurface: as the store has it with transfer at its vertices, else one that is looked up in the texture.
    ///
    /// # Errors
    /// As [`Isosurface::extract`]; when the surface of the store is damaged.
    pub fn extract(&self, isovalue: f64) -> Result<Isosurface> {
        if let Some(surface) = self.surface(isovalue)?
            && let Some(isosurface) = Isosurface::of_store(&self.volume, surface)?
        {
            return Ok(isosurface);
        }
        Isosurface::extract(&self.volume, &self.pyramid, isovalue)
    }

    /// The surface of the store, unless it is incomplete while the texture holds the isovalue.
    fn surface(&self, isovalue: f64) -> Result<Option<Store>> {
        let Some(surface) = self.store.surface(isovalue)? else { return Ok(None) };
        let is_other = self.volume.exact.is_some() && !surface.is_on_model();
        if surface.is_complete()? && !is_other {
            return Ok(Some(surface));
        }
        let held = self.store.holdings()?;
        if held.all || held.in_texture.contains(&isovalue) {
            return Ok(None);
        }
        if is_other {
            let given = format!("the surface of isovalue {} in the store", number(isovalue, 8));
            let expected = "vertices that were baked on the model: these lie on its samples";
            let remedy = "bake it with --exact-vertices into another store, or leave the option out";
            return Err(Error::argument("--exact-vertices", given, expected, remedy));
        }
        Ok(Some(surface))
    }

    /// Finds the texels that lookups on an isosurface of it read.
    pub fn select(&self, isosurface: Isosurface) -> Part {
        Part::new(&self.volume, self.store.layout().lattice, isosurface)
    }
}

/// The isovalue of a partner that belongs to one of a member.
pub(super) fn partnered(of: &Member<'_>, partner: &Member<'_>, isovalue: f64) -> Result<f64> {
    let coupled = coupling_of(of.store()).and_then(|c| c.partners.iter().find(|p| p.name == partner.name()));
    let Some(knots) = coupled.map(|partner| &partner.isovalues) else { return Ok(isovalue) };
    let map = IsovalueMap::from_knots(knots.clone());
    let (low, high) = match (knots.first(), knots.last()) {
        (Some(first), Some(last)) => (first[0], last[0]),
        _ => {
            let (a, b) = (of.volume().value_range(), partner.volume().value_range());
            (a.0.max(b.0), a.1.min(b.1))
        }
    };
    if (low..=high).contains(&isovalue) {
        return Ok(map.at(isovalue));
    }
    let name = of.name();
    let given = format!("{name}={}, which has no partner in {}", number(isovalue, 8), partner.name());
    let expected = match low == high {
        true => format!("{}, the one of {name} that has", number(low, 8)),
        false => format!("{} to {}", number(low, 8), number(high, 8)),
    };
    let remedy = "choose such a one, or give the pair in the `coupling` of the scene and bake anew";
    Err(Error::argument("isovalue", given, expected, remedy))
}
