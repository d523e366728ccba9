//! Samples that change under a bake, and what a bake is said to take of memory.

use super::*;
use crate::error::{Error, Result};
use crate::scene::Effects;
use crate::scene::IsovalueMap;
use crate::scene::geometry::{Among, Geometry, Partner};
use crate::transfer::store::Store;
use crate::transfer::{BRICK_TEXELS, Lattice, Layers, Layout};
use crate::transport::{Progress, Settings};
use crate::volume::{SampleOwner, Samples, SamplesView, Volume, field};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Samples in a file that another program writes once the flag is set.
#[derive(Debug)]
struct Watched(Vec<f32>, Arc<AtomicBool>);

impl SampleOwner for Watched {
    fn view(&self) -> SamplesView<'_> {
        SamplesView::F32(&self.0)
    }

    fn check(&self) -> Result<()> {
        match self.1.load(Ordering::Relaxed) {
            false => Ok(()),
            true => Err(Error::io("samples.raw", "go on with", std::io::Error::other("written meanwhile"))),
        }
    }
}

fn watched(flag: &Arc<AtomicBool>) -> Volume {
    let field = field::by_name("sphere:12").unwrap().unwrap().sample().unwrap();
    let samples = (0..field.samples().len()).map(|i| field.samples().raw(i)).collect();
    let samples = Samples::Shared(Arc::new(Watched(samples, flag.clone())));
    let mut volume = Volume::new(field.dims(), samples, *field.world_from_grid()).unwrap();
    volume.name = "sphere".into();
    volume
}

fn layout(volume: &Volume) -> Layout {
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
    Layout { lattice, layers: Layers::new(vec![2]).unwrap() }
}

fn request<'a>(volume: &'a Volume, effects: &'a Effects) -> Request<'a> {
    let layout = layout(volume);
    let settings = Settings { layers: layout.layers.clone(), rays: 32, seed: 0, target: None, positive: false };
    let writing = Writing { sync: false, ..Writing::default() };
    Request {
        isovalues: Some(vec![-0.6]),
        surfaces: true,
        writing,
        ..Request::new(volume, "sphere", layout, settings, effects)
    }
}

/// When the samples change.
#[derive(Clone, Copy, Debug, PartialEq)]
enum When {
    BeforeSurfaces,
    BeforeChecks,
}

struct Writer(When, Arc<AtomicBool>);

impl Observer for Writer {
    fn seconds(&self) -> f64 {
        // First asked when the store is made.
        if self.0 == When::BeforeSurfaces {
            self.1.store(true, Ordering::Relaxed);
        }
        0.0
    }

    fn watch(&self, _: Task, _: u64, _: &Progress, work: &mut dyn FnMut()) {
        work();
        self.1.store(true, Ordering::Relaxed);
    }
}

/// Nothing goes into a store that was computed of samples which are not those that it is of: no surface, no check points.
#[test]
fn samples_that_change_end_a_bake_before_anything_of_them_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let effects = Effects::default();
    for when in [When::BeforeSurfaces, When::BeforeChecks] {
        let flag = Arc::new(AtomicBool::new(false));
        let volume = watched(&flag);
        let path = folder.path().join(format!("{when:?}.isolume"));
        let error = run(&request(&volume, &effects), &path, &Writer(when, flag)).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("samples.raw"), "{when:?}: {error}");
        let store = Store::open(&path).unwrap();
        match when {
            When::BeforeSurfaces => assert!(store.surfaces().unwrap().is_empty()),
            When::BeforeChecks => {
                let surface = store.surface(-0.6).unwrap().unwrap();
                assert!(surface.checks(Some(-0.6)).unwrap().is_none());
                assert!(surface.holdings().unwrap().chunks > 0);
            }
        }
    }
    // Before it is made there is none.
    let flag = Arc::new(AtomicBool::new(true));
    let path = folder.path().join("new.isolume");
    assert!(run(&request(&watched(&flag), &effects), &path, &Silent).is_err() && !path.exists());
}

#[test]
fn samples_of_partners_are_asked_as_well() {
    let (own, other) = (Arc::default(), Arc::new(AtomicBool::new(false)));
    let (volume, partner) = (watched(&own), Arc::new(watched(&other)));
    let pyramid = Arc::new(crate::level::Pyramid::new(&partner));
    let isovalue = IsovalueMap::from_knots(Vec::new());
    let partner = Partner { name: "other".into(), volume: partner, pyramid, isovalue, tint: [1.0; 3] };
    let among = Among { name: "own".into(), place: 0, coupling: "equal".into(), tint: [1.0; 3] };
    let around = Geometry::new(Vec::new(), Vec::new(), 1.0).unwrap().with_partners(among, vec![partner]).unwrap();
    let effects = Effects::default();
    let request = Request { geometry: Some(&around), ..request(&volume, &effects) };
    assert!(request.check_samples().is_ok());
    other.store(true, Ordering::Relaxed);
    assert!(request.check_samples().is_err());
    other.store(false, Ordering::Relaxed);
    own.store(true, Ordering::Relaxed);
    assert!(request.check_samples().is_err());
}

/// The threads are those of whoever bakes, not of whoever asks: each holds a chunk, as it was and as it is.
#[test]
fn the_forecast_is_of_the_threads_that_are_asked_about() {
    let (flag, effects) = (Arc::default(), Effects::default());
    let volume = watched(&flag);
    let of_texture = Request { surfaces: false, ..request(&volume, &effects) };
    let chunk = 64 * BRICK_TEXELS as u64 * bytes_of_texel(&of_texture.layout.layers);
    assert_eq!(of_texture.bytes_needed_by(65) - of_texture.bytes_needed_by(1), 2 * 64 * chunk);
    assert_eq!(of_texture.bytes_needed(), of_texture.bytes_needed_by(rayon::current_num_threads()));
}

/// What was counted for one list of isovalues is not taken for that of another.
#[test]
fn the_forecast_is_of_the_isovalues_that_are_asked_about() {
    let (flag, effects) = (Arc::default(), Effects::default());
    let volume = watched(&flag);
    let first = request(&volume, &effects);
    let before = first.bytes_needed_by(1);
    let longer = Request { isovalues: Some(vec![-0.6, -0.4, -0.2]), ..first.clone() };
    let fresh = Request { isovalues: longer.isovalues.clone(), ..request(&volume, &effects) };
    assert_eq!(longer.bytes_needed_by(1), fresh.bytes_needed_by(1));
    assert_eq!(first.bytes_needed_by(1), before);
    let cells = crossed_cells(&volume, &[-0.6, -0.4, -0.2]);
    assert!(cells.iter().all(|&count| count > 0), "{cells:?}");
    assert_eq!(longer.bytes_needed_by(1), bytes_of_bake(&volume, &longer.layout, Some((3, &cells)), true, Some(1)));
}
