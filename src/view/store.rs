//! What the page shows of a store.

use super::{Coding, Options, Package, Subject, Surrounded, pack};
use crate::error::Result;
use crate::probe::{EMBEDDED, Probe};
use crate::quantity::{bytes, count};
use crate::scene::{DARK, open_probe};
use crate::session::Groups;
use crate::transfer::store::{Completeness, SceneIdentity, Store};
use crate::volume::Isovalue;

/// What the page shows of a store: `isovalue` to begin with, where that is `auto` the one that a field or a model has, `rotation` of the
/// environment in a scene, and whether a bake that is not finished will do.
pub fn package_of(
    store: &Store,
    probes: &[Probe],
    ((isovalue, own), rotation, partial): ((Isovalue, Option<f64>), f64, bool),
    options: &Options,
) -> Result<Package> {
    let volume = store.volume()?;
    Completeness::of(store, &volume)?.check(store, partial)?;
    let held = store.holdings()?;
    store.check_texture(&held, "the page")?;
    let isovalue = match held.in_texture.first() {
        Some(&first) if !held.all && isovalue == Isovalue::Auto => first,
        _ => isovalue.resolve(&volume, Some(volume.solid), own)?.value,
    };
    let identity = store.identity();
    let surroundings = identity.scene.as_ref();
    let layout = store.layout();
    let triple = |[x, y, z]: [usize; 3]| format!("{x} × {y} × {z}");
    let rays = if held.rays[0] == held.rays[1] {
        held.rays[0].to_string()
    } else {
        format!("{} to {}", held.rays[0], held.rays[1])
    };
    let mut about = vec![
        ("volume", format!("{}, {} samples", volume.name, triple(volume.dims()))),
        ("solid", format!("{} the isovalue", identity.solid)),
        ("texture", format!("{} texels", triple(layout.lattice.texels()))),
        ("layers", format!("{} with {:?} bands", layout.layers.len(), layout.layers.bands())),
        ("estimator", format!("{}, {rays} rays a texel, seed {}", identity.estimator, identity.seed)),
        ("isovalues", held.isovalues_text()),
        ("store", identity.hash()[..16].to_string()),
        ("program", concat!("isolume ", env!("CARGO_PKG_VERSION")).into()),
    ];
    about.splice(1..1, surroundings.iter().flat_map(|scene| about_surroundings(scene)));
    let groups = Groups::open(store, &[])?;
    let subject = Subject {
        volume: &volume,
        textures: &groups.textures()?,
        surrounded: surroundings.map(|identity| Surrounded { identity, rotation }),
        isovalues: (!held.all).then(|| held.in_texture.clone()),
        about: about.into_iter().map(|(name, text)| (name.to_string(), text)).collect(),
        probes,
        isovalue,
    };
    pack(&subject, options)
}

/// What stands around the volume, for the page.
fn about_surroundings(scene: &SceneIdentity) -> Vec<(&'static str, String)> {
    let mut about = Vec::new();
    if scene.coupling.is_none() || !scene.luminaires.is_empty() {
        about.push(("walls", "in the light of the surface, not drawn".into()));
    }
    if !scene.luminaires.is_empty() {
        about.push(("luminaires", scene.luminaires.join(", ")));
    }
    if let Some(coupling) = &scene.coupling {
        let names: Vec<&str> = coupling.partners.iter().map(|p| p.name.as_str()).collect();
        let others = format!("{}, in the light of the surface, not drawn: --volume NAME shows one", names.join(", "));
        about.push(("other volumes", others));
    }
    about
}

impl Package {
    /// What is in it, in a line: how far texture and volume are reduced, and how coefficients are kept.
    pub fn describe(&self, store: &Store, options: &Options) -> String {
        let layout = store.layout();
        let triple = |[x, y, z]: [usize; 3]| format!("{x} × {y} × {z}");
        let reduced = |from: [usize; 3], to: [usize; 3]| {
            if from == to { triple(to) } else { format!("{} (of {})", triple(to), triple(from)) }
        };
        let coding = match options.coding {
            Coding::Half => "16-bit floats",
            Coding::Byte => "8 bits with a scale to each coefficient",
        };
        let beside = store.identity().scene.as_ref().map_or(String::new(), |scene| {
            let numbers = 3 * layout.layers.len() * (1 + scene.luminaires.len());
            format!(" and {numbers} 16-bit floats of emission and luminaires")
        });
        format!(
            "samples {}, texels {}; {} texels with a level set × {} coefficients in {coding}{beside}, {}",
            reduced(layout.lattice.grid(), self.samples),
            reduced(layout.lattice.texels(), self.texels),
            count(self.valid_texels),
            layout.layers.coefficients(),
            bytes(self.payload.len() as f64),
        )
    }
}

/// The volume of a store that the page shows: the one of this name, or the first.
///
/// # Errors
/// When no volume has the name.
pub fn volume_shown(store: Store, name: Option<&str>, note: &dyn Fn(&str)) -> Result<Store> {
    match name {
        Some(name) => store.of_volume(name),
        None => {
            if let [first, _, ..] = store.volumes()?.as_slice() {
                note(&format!("{first}, the first volume, is shown: --volume NAME shows another"));
            }
            Ok(store)
        }
    }
}

/// The environments of the page, the first of which it begins with: those given, no light where luminaires are light enough, and
/// those that every page has.
///
/// # Errors
/// None, but that an environment is opened.
pub fn page_probes(mut given: Vec<Probe>, store: &Store) -> Result<Vec<Probe>> {
    let luminaires = store.identity().scene.as_ref().is_some_and(|scene| !scene.luminaires.is_empty());
    for name in luminaires.then_some(DARK).into_iter().chain(EMBEDDED) {
        if !given.iter().any(|probe| probe.name == name) {
            given.push(open_probe(name, false, None)?);
        }
    }
    Ok(given)
}
