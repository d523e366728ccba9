//! Both lobes of a field about 0 in one picture or file: matter is above the one level and below the other.
//!
//! A store has one solid side. So the two lobes are what a scene of two volumes is: the field with its solid above, and the
//! same field with its solid below, coupled by the pair of levels. They shade each other and light each other.

use super::Job;
use crate::error::Result;
use crate::scene::{Member, NamedIsovalue, SceneFile};
use crate::volume::isovalue::Chosen;
use crate::volume::{Isovalue, Solid};

/// Factors on the albedo of the lobe above 0 and of that below: mild, and told apart by most colour-blind people.
const COLOURS: [[f32; 3]; 2] = [[1.0, 0.62, 0.42], [0.42, 0.66, 1.0]];

/// The two levels that are to be shown together, the one above 0 first: those of a choice of both lobes, or two of
/// opposite sign that were given, where what is written cannot tell isovalues apart.
pub(super) fn levels(job: &Job<'_>, opened: &Member, chosen: &[Chosen]) -> Option<[f64; 2]> {
    let several = job.outputs.iter().any(|output| job.tells_isovalues_apart(output));
    if several || opened.has_side() || opened.geometry.is_some() {
        return None;
    }
    let mut values = match chosen {
        [one] => {
            let other = one.more.iter().find(|level| level.solid == Solid::Below && one.solid == Solid::Above)?;
            [one.value, other.value]
        }
        [one, other] => [one.value, other.value],
        _ => return None,
    };
    values.sort_by(|a, b| b.total_cmp(a));
    let (low, high) = opened.volume.value_range();
    let [above, below] = values;
    (0.0 < above && above < high && low < below && below < 0.0).then_some(values)
}

/// The job and the scene that show them.
pub(super) fn scene<'a>(job: &Job<'a>, opened: &Member, [above, below]: [f64; 2]) -> Result<(Job<'a>, SceneFile)> {
    let mut material = job.material.clone();
    let colours = if material.colormap.is_some() {
        let rule = material.rule(opened.volume.value_range())?;
        // The colours are in the factors; what they multiply is 1.
        (material.colormap, material.albedo) = (None, Some([1.0; 3]));
        [rule.albedo(above), rule.albedo(below)].map(|colour| colour.map(|v| v.clamp(0.0, 1.0)))
    } else if material.says_albedo() {
        [[1.0; 3]; 2]
    } else {
        COLOURS
    };
    let file = toml::Value::String(job.input.into());
    let mut text = format!("coupling = [[{above:?}, {below:?}]]\n");
    for ((name, side), colour) in [("positive", "above"), ("negative", "below")].into_iter().zip(colours) {
        text += &format!("[[volumes]]\nname = \"{name}\"\nvolume = {file}\nsolid = \"{side}\"\nalbedo = {colour:?}\n");
    }
    let scene = SceneFile::from_text(&text, job.input)?;
    let isovalues = vec![NamedIsovalue { volume: None, isovalue: Isovalue::Value(above) }];
    Ok((Job { isovalues, material, ..job.clone() }, scene))
}
