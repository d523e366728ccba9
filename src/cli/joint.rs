//! Several volumes that light each other: opened together, and isovalues that follow those of the first.

use super::input::{Input, VolumeArgs};
use super::isovalue::{Chosen, Isovalue, NamedIsovalue};
use super::scene::SceneFile;
use super::{Failure, Outcome, input, text};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::scene::geometry::{Among, Geometry, Partner};
use crate::scene::{Coupled, Coupling, VolumeDescription};
use crate::volume::Volume;
use std::sync::Arc;

/// The coupling as one of the volumes sees it.
pub(super) struct Joint {
    coupling: Coupling,
    volumes: Vec<Coupled>,
    /// Which of them is baked.
    member: usize,
    /// The first, whose isovalues are given, where that is another one; and the isovalue that shows it best.
    first: Option<(Arc<Volume>, Option<f64>)>,
}

impl Joint {
    /// The isovalue of the baked volume that belongs to one of the first.
    pub(super) fn resolve(&self, isovalue: &Isovalue, own: &Volume, of_field: Option<f64>) -> Result<Chosen> {
        let (first, of_field) = match &self.first {
            Some((first, default)) => (&**first, *default),
            None => (own, of_field),
        };
        let chosen = isovalue.resolve(first, Some(first.solid), of_field)?;
        self.coupling.check_isovalue(&self.volumes, 0, chosen.value)?;
        if self.member == 0 {
            return Ok(chosen);
        }
        let value = self.coupling.between(&self.volumes, 0, self.member).at(chosen.value);
        let Chosen { value, .. } = Isovalue::Value(value).resolve(own, Some(own.solid), None)?;
        let names = [self.member, 0].map(|m| self.volumes[m].name.as_str());
        let reason = format!("of {}, with {} of {}", names[0], text::number(chosen.value, 6), names[1]);
        Ok(Chosen { reason: Some(reason), ..Chosen::given(value, own.solid) })
    }
}

impl Joint {
    /// As [`Self::resolve`], of an isovalue that may be that of another volume than the first.
    pub(super) fn resolve_named(&self, named: &NamedIsovalue, own: &Volume, of_field: Option<f64>) -> Result<Chosen> {
        let Some(name) = &named.volume else { return self.resolve(&named.isovalue, own, of_field) };
        let names = || self.volumes.iter().map(|v| v.name.as_str());
        let Some(from) = names().position(|n| n == name) else {
            let remedy = match text::nearest(name, names()) {
                Some(near) => format!("did you mean {near}?"),
                None => "see the [[volumes]] of the scene".into(),
            };
            let expected = format!("one of {}", names().collect::<Vec<_>>().join(", "));
            return Err(Error::argument("--isovalue", format!("{name}=…"), expected, remedy));
        };
        let (low, high) = self.volumes[from].range;
        let value = match named.isovalue {
            Isovalue::Value(value) => value,
            Isovalue::Percent(part) => low + part / 100.0 * (high - low),
            _ => {
                let remedy = format!("give a number, as in {name}={}", text::number(0.5 * (low + high), 3));
                let expected = "a number or a percentage beside a name";
                return Err(Error::argument("--isovalue", format!("{name}=…"), expected, remedy));
            }
        };
        if !(low..=high).contains(&value) {
            let expected = format!("{} to {}", text::number(low, 8), text::number(high, 8));
            let given = format!("{name}={}", text::number(value, 8));
            return Err(Error::argument("--isovalue", given, expected, "choose an isovalue in its range"));
        }
        self.coupling.check_isovalue(&self.volumes, from, value)?;
        if from == self.member {
            return Isovalue::Value(value).resolve(own, Some(own.solid), None);
        }
        let value = self.coupling.between(&self.volumes, from, self.member).at(value);
        Isovalue::Value(value).resolve(own, Some(own.solid), None)
    }
}

/// Opens a volume of a scene where that says it stands.
fn open_one(file: &SceneFile, description: &VolumeDescription, args: &VolumeArgs) -> Outcome<Input> {
    let in_file = |failure| match failure {
        Failure::Library(error) => file.scene.at_line(description.volume.line, error).into(),
        other => other,
    };
    if args.keep_largest {
        let remedy = "leave it out, or mask each volume before";
        return Err(refuse("--keep-largest", "one volume alone", remedy));
    }
    let mut opened = input::open(&file.place_of(&description.volume.value), args).map_err(in_file)?;
    let placed = opened.volume.placed(description.world_from_file, description.translate);
    opened.volume = placed.map_err(|e| file.scene.at_line(description.volume.line, e))?;
    opened.volume.name = description.name.value.clone();
    // Among others a convex solid is shaded all the same.
    opened.volume.convex_side = None;
    if args.solid.is_none()
        && let Some(solid) = description.solid
    {
        opened.volume.solid = solid;
    }
    opened.volume.check_cells().map_err(|e| file.scene.at_line(description.volume.line, e))?;
    Ok(opened)
}

/// Opens volume `member` of a scene, with the others around it; `walls` makes what else stands there, in metres to a unit as
/// the volume says.
pub(super) fn open(
    file: &SceneFile,
    member: usize,
    args: &VolumeArgs,
    walls: &dyn Fn(&Input) -> Outcome<Option<Geometry>>,
) -> Outcome<Input> {
    let descriptions = &file.scene.volumes;
    let Some(coupling) = &file.scene.coupling else { return Err(Failure::Message("a scene without coupling".into())) };
    let mut inputs = descriptions.iter().map(|d| open_one(file, d, args)).collect::<Outcome<Vec<_>>>()?;
    // One world has one up.
    let up = inputs.first().map(|first| first.volume.up).unwrap_or_default();
    inputs.iter_mut().for_each(|input| input.volume.up = up);
    let coupled = |input: &Input| Coupled { name: input.volume.name.clone(), range: input.volume.value_range() };
    let volumes: Vec<Coupled> = inputs.iter().map(coupled).collect();
    let in_line = |error| file.scene.at_line(coupling.line, error);
    coupling.value.check(&volumes).map_err(in_line)?;
    // Units are those of the first: all stand in one world.
    let geometry = match walls(&inputs[0])? {
        Some(geometry) => geometry,
        None => Geometry::new(Vec::new(), Vec::new(), 1.0)?,
    };
    let mut own = inputs.remove(member);
    let first_default = inputs.first().and_then(|input| input.default_isovalue);
    let others = (0..descriptions.len()).filter(|&i| i != member).zip(inputs);
    let partners: Vec<Partner> = others
        .map(|(i, input)| Partner {
            name: volumes[i].name.clone(),
            pyramid: Arc::new(Pyramid::new(&input.volume)),
            isovalue: coupling.value.between(&volumes, member, i),
            tint: descriptions[i].albedo,
            volume: Arc::new(input.volume),
        })
        .collect();
    let first = partners.iter().find(|p| p.name == volumes[0].name).map(|p| (p.volume.clone(), first_default));
    let among = Among {
        name: volumes[member].name.clone(),
        place: member,
        coupling: coupling.value.describe(),
        tint: descriptions[member].albedo,
    };
    own.geometry = Some(geometry.with_partners(among, partners)?);
    own.joint = Some(Joint { coupling: coupling.value.clone(), volumes, member, first });
    Ok(own)
}

/// Refuses what shares of chunks and others cannot do with several volumes.
pub(super) fn refuse(name: &str, expected: &str, remedy: &str) -> Failure {
    Error::argument(name, "a scene of several volumes", expected, remedy).into()
}
