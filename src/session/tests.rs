//! Sessions over a small store: steps and whole, and what is refused.

use super::*;
use crate::bake::{self, Request, Silent};
use crate::probe::{self, LatLong, SunSplit};
use crate::relight::{Exposure, Material};
use crate::render::View;
use crate::scene::Effects;
use crate::sh::Window;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;
use crate::volume::field;

const ISOVALUE: f64 = 47.0;

/// A store that holds one isovalue.
fn store(folder: &std::path::Path) -> Store {
    let volume = field::by_name("bumpbox:12").unwrap().unwrap().sample().unwrap();
    let layers = Layers::uniform(2, 3).unwrap();
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).unwrap(), layers: layers.clone() };
    let settings = Settings { layers, rays: 4, seed: 0, target: None, positive: false };
    let effects = Effects::default();
    let mut request = Request::new(&volume, "bumpbox:12", layout, settings, &effects);
    request.isovalues = Some(vec![ISOVALUE]);
    bake::run(&request, folder.join("bumps.isolume"), &Silent).unwrap().0
}

fn material() -> Material {
    Material::new([0.7, 0.5, 0.3], [0.0; 3]).unwrap()
}

#[test]
fn steps_give_what_the_whole_gives_and_a_volume_read_before_what_the_store_holds() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let session = Session::open(&store).unwrap();
    let probe = probe::by_name("sun:30,40").unwrap().unwrap();
    let options = LightOptions { split_sun: SunSplit::Lobes(1), window: Window::Certified, ..LightOptions::default() };
    let light = session.light(&probe, &options).unwrap();
    let surface = session.surface(ISOVALUE).unwrap();
    let whole = surface.lit(&light, &material(), &LitOptions::default()).unwrap();
    let (volume, member) = (store.volume().unwrap(), &session.members()[0]);
    let pyramid = Pyramid::new(&volume);
    let alone = Session::alone(&store, &volume, &pyramid);
    let part = alone.members()[0].select(member.extract(ISOVALUE).unwrap());
    let in_steps = alone.surface_of(vec![part]).unwrap();
    let steps = in_steps.contract(&light, &material(), &[]).unwrap().look_up(Exposure::Percentile).unwrap();
    assert!(whole.sun_rays() > 0 && !whole.radiance().is_empty());
    assert_eq!(whole.radiance(), steps.radiance());
    assert_eq!(whole.record(), steps.record());
    let told = whole.notes();
    assert!(matches!(told[..], [LightNote::Suns { .. }, LightNote::Window(_), LightNote::Clamped(_)]), "{told:?}");
}

#[test]
fn isovalues_that_were_never_baked_are_refused_with_those_that_were() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let session = Session::open(&store).unwrap();
    let probe = probe::by_name("constant").unwrap().unwrap();
    let light = session.light(&probe, &LightOptions::default()).unwrap();
    let surface = session.surface(20.0).unwrap();
    match surface.lit(&light, &material(), &LitOptions::default()).map(|_| ()) {
        Err(Error::Unbaked { isovalue: 20.0, unbaked, lookups, holds_all: false, isovalues, .. }) => {
            assert_eq!(isovalues, [ISOVALUE]);
            assert!(0 < unbaked && unbaked <= lookups && lookups == surface.vertices() as u64);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn unknown_luminaires_members_and_negative_light_that_is_to_be_certified_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let session = Session::open(&store).unwrap();
    let refused = |result: Result<()>, name: &str| match result {
        Err(Error::Argument { name: found, .. }) => assert_eq!(found, name),
        other => panic!("{name}: {other:?}"),
    };
    let mut probe = probe::by_name("constant").unwrap().unwrap();
    let light = session.light(&probe, &LightOptions::default()).unwrap();
    let luminaires = vec![LuminaireFactor { luminaire: "ceiling".into(), factor: [1.0; 3] }];
    let surface = session.surface(ISOVALUE).unwrap();
    refused(
        surface.lit(&light, &material(), &LitOptions { luminaires, ..Default::default() }).map(|_| ()),
        "luminaire",
    );
    refused(session.member("other").map(|_| ()), "isovalue");
    refused(session.isovalues(1, ISOVALUE).map(|_| ()), "member");
    refused(session.light(&probe, &LightOptions { bands: Some(0), ..Default::default() }).map(|_| ()), "bands");
    let bare = Material { albedo: [f32::NAN; 3], ..material() };
    refused(surface.lit(&light, &bare, &LitOptions::default()).map(|_| ()), "albedo");
    let picture = PictureOptions {
        scale_bar: true,
        projection: crate::render::Projection::Perspective(35.0),
        ..PictureOptions::default()
    };
    let lit = surface.lit(&light, &material(), &LitOptions::default()).unwrap();
    refused(lit.picture(&picture).map(|_| ()), "scale bar");
    for stops in [f64::NAN, f64::INFINITY] {
        let options = LitOptions { exposure: Exposure::Stops(stops), ..LitOptions::default() };
        refused(surface.lit(&light, &material(), &options).map(|_| ()), "exposure");
    }
    let empty = PictureOptions { width: 0, ..PictureOptions::default() };
    refused(lit.picture(&empty).map(|_| ()), "picture");
    for (width, supersampling, name) in
        [(usize::MAX, 1, "picture"), (1 << 20, 1, "picture"), (4, 1 << 40, "supersampling")]
    {
        let large = PictureOptions { width, supersampling, height: 4, ..PictureOptions::default() };
        refused(lit.picture(&large).map(|_| ()), name);
    }
    let small = PictureOptions { width: 4, height: 4, ..PictureOptions::default() };
    for degrees in [f64::NAN, f64::INFINITY, 0.0, -30.0, 180.0] {
        let projection = crate::render::Projection::Perspective(degrees);
        refused(lit.picture(&PictureOptions { projection, ..small.clone() }).map(|_| ()), "perspective");
    }
    let view = View { azimuth: f64::NAN, elevation: 0.0 };
    refused(lit.picture(&PictureOptions { view, ..small }).map(|_| ()), "view");
    probe.image = LatLong::new(2, 1, vec![[1.0; 3], [1.0, -0.5, 1.0]]).unwrap();
    let certified = LightOptions { window: Window::Certified, ..LightOptions::default() };
    refused(session.light(&probe, &certified).map(|_| ()), "window");
}

/// An environment without lamps is multiplied as ever; one with a lamp is so where that is asked for, and under a window.
#[test]
fn lamps_are_split_off_where_they_ring_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let session = Session::open(&store).unwrap();
    let surface = session.surface(ISOVALUE).unwrap();
    let lit = |name: &str, split_sun: SunSplit, window: Window| {
        let probe = probe::by_name(name).unwrap().unwrap();
        let light = session.light(&probe, &LightOptions { split_sun, window, ..Default::default() }).unwrap();
        let lit = surface.lit(&light, &material(), &LitOptions::default()).unwrap();
        let bits = |v: f32| v.to_bits();
        let radiance: Vec<[u32; 3]> = lit.radiance().iter().map(|rgb| rgb.map(bits)).collect();
        (light.suns().len(), radiance, lit.standard_errors().iter().map(|&v| bits(v)).collect::<Vec<u32>>())
    };
    for sky in ["constant", "gradient", "overcast"] {
        assert_eq!(lit(sky, SunSplit::Auto, Window::None), lit(sky, SunSplit::Off, Window::None), "{sky}");
    }
    let [auto, off] = [SunSplit::Auto, SunSplit::Off].map(|split| lit("sun:30,40", split, Window::None));
    assert_eq!((auto.0, off.0), (1, 0));
    assert!(auto.1 != off.1);
    for window in [Window::Lanczos, Window::Certified] {
        assert_eq!(lit("sun:30,40", SunSplit::Auto, window), lit("sun:30,40", SunSplit::Off, window));
    }
}

/// The extras of a file with transfer, as they stand under the light of a sun.
fn extras_of_transfer(folder: &std::path::Path, session: &Session<'_>, split_sun: SunSplit) -> serde_json::Value {
    let surface = session.surface(ISOVALUE).unwrap();
    let probe = probe::by_name("sun:30,40").unwrap().unwrap();
    let light = session.light(&probe, &LightOptions { split_sun, ..LightOptions::default() }).unwrap();
    let lit = surface.lit(&light, &material(), &LitOptions::default()).unwrap();
    let path = folder.join("transfer.glb");
    lit.write_gltf(&path, &MeshOptions { transfer: true, ..MeshOptions::default() }).unwrap();
    let bytes = std::fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    json["meshes"][0]["extras"]["isolume_transfer"].clone()
}

#[test]
fn a_file_with_transfer_has_all_of_the_light_and_textures_refuse_a_part_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let session = Session::open(&store).unwrap();
    let [apart, whole] =
        [SunSplit::Lobes(1), SunSplit::Off].map(|split| extras_of_transfer(folder.path(), &session, split));
    assert_eq!((&apart["lamps_lit_apart"], &whole["lamps_lit_apart"]), (&1.into(), &0.into()));
    let coefficients = &whole["light"]["coefficients_in_world"];
    assert_eq!(coefficients.as_array().unwrap().len(), 9, "{coefficients}");
    assert_eq!(&apart["light"]["coefficients_in_world"], coefficients);
    let probe = probe::by_name("sun:30,40").unwrap().unwrap();
    let light = session.light(&probe, &LightOptions::default()).unwrap();
    let volume = store.volume().unwrap();
    match RelitField::new(&store, &volume, &light, &material(), &[]).map(|_| ()) {
        Err(Error::Argument { name, given, .. }) => assert!(name == "light" && given.starts_with("1 lamp"), "{given}"),
        other => panic!("{other:?}"),
    }
}
