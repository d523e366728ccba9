//! Who watches a bake, and may end it.

use crate::scene::Plan;
use crate::transport::Progress;

/// What takes long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Task {
    /// Texels are estimated; items are texels. A stop loses at most the chunks in work.
    Texels,
    /// Photons are sent out; items are photons. A stop loses all of them.
    Photons,
}

/// Watches a bake. Every method has a default that does nothing: [`Silent`] is the observer that only lets it run.
pub trait Observer: Sync {
    /// Something that whoever asked for the bake should know, in one sentence.
    fn note(&self, text: &str) {
        let _ = text;
    }

    /// The plan of effects, where the request asks to be told.
    fn plan(&self, plan: &Plan) {
        let _ = plan;
    }

    /// Seconds since the bake was asked for; goals in time count from there. The bake itself reads no clock: 0 makes a
    /// goal in time pointless.
    fn seconds(&self) -> f64 {
        0.0
    }

    /// The store is open and locked, and the long part begins: from here on a stop should wait for the chunks in work.
    fn begin(&self) {}

    /// Asked after every chunk, and before a part: whether to stop when the chunks in work are written.
    fn wants_stop(&self) -> bool {
        false
    }

    /// Runs `work`, during which `progress` tells how many of so many items are done; its flags stop or drop the work.
    fn watch(&self, task: Task, items: u64, progress: &Progress, work: &mut dyn FnMut()) {
        let _ = (task, items, progress);
        work();
    }
}

/// The observer that asks for nothing and tells nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {}
