//! Scenes: volumes that stand in one world with what is around them, from a file, from a description, or made by hand.

use super::geometry::{Among, DistantLight, Geometry, Partner, TriangleMesh};
use super::medium::{Body, Medium, MediumField};
use super::member::{AmongOthers, nearest_beside};
use super::model::{ModelName, files_of_model};
use super::{
    Coupled, Coupling, Effects, FieldDescription, Located, Member, SceneDescription, VolumeDescription, VolumeOptions,
    WallShape, nearest,
};
use crate::error::{Error, Result};
use crate::file::{self, Beside};
use crate::level::Pyramid;
use crate::probe::{self, Orientation, Probe, ReadOptions};
use crate::volume::{LengthUnit, Volume, field};
use glam::DVec3;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest scene: ten times one with a million isovalues.
const MOST_SCENE_BYTES: u64 = 1 << 26;
/// Longest file of a mesh.
const MOST_MESH_BYTES: u64 = 1 << 32;

/// The name of an environment that sends no light.
pub const DARK: &str = "constant:0";

/// What is lit: one volume or several that light each other, in one world with walls and luminaires.
#[derive(Clone, Debug)]
pub struct Scene {
    members: Vec<Member>,
    description: Option<SceneFile>,
}

/// The description of a scene with the folder that its paths start from.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// What the file says.
    pub description: SceneDescription,
    folder: PathBuf,
    // Taken before the file was read.
    stamp: Option<String>,
}

impl Scene {
    /// A volume alone, with nothing around it.
    pub fn of(volume: Volume) -> Self {
        Self { members: vec![Member::of(volume)], description: None }
    }

    /// The same of a volume with what is known of it.
    pub fn of_member(member: Member) -> Self {
        Self { members: vec![member], description: None }
    }

    /// A volume among walls and luminaires.
    pub fn among(volume: Volume, geometry: Geometry) -> Self {
        let mut member = Member::of(volume);
        member.geometry = Some(geometry);
        Self { members: vec![member], description: None }
    }

    /// Volumes that light each other, by name unique, in one world; `coupling` says which of their isovalues belong together,
    /// `tints` are factors on the albedo, one a volume; `geometry` holds what else stands there.
    ///
    /// # Errors
    /// When the coupling does not fit the volumes ([`Coupling::check`]), or there are too many of them.
    pub fn coupled(
        volumes: Vec<Volume>,
        tints: &[[f32; 3]],
        coupling: &Coupling,
        geometry: Option<Geometry>,
    ) -> Result<Self> {
        if tints.len() != volumes.len() {
            let (found, expected) = (format!("{} of them", tints.len()), format!("{}, one a volume", volumes.len()));
            return Err(Error::argument("tints", found, expected, "give [1, 1, 1] where there is none"));
        }
        let members = couple(volumes.into_iter().map(Member::of).collect(), tints, coupling, geometry)?;
        Ok(Self { members, description: None })
    }

    /// Opens a volume file, an analytic field by name such as `bumpbox:96`, or a description in TOML.
    ///
    /// # Errors
    /// When a file is not there or cannot be read, or a description makes no sense; each names the file and what to do.
    pub fn open(name: impl AsRef<Path>) -> Result<Self> {
        let path = name.as_ref();
        let name = path
            .to_str()
            .ok_or_else(|| Error::argument("volume", path.display(), "a name in UTF-8", "rename the file"))?;
        Self::open_with(name, &VolumeOptions::default(), &Effects::default())
    }

    /// The same with what its volumes are to be understood as, and without what `effects` switch off around them.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_with(name: &str, options: &VolumeOptions, effects: &Effects) -> Result<Self> {
        match name.to_ascii_lowercase().ends_with(".toml") {
            true => SceneFile::read(name)?.open(options, effects),
            false => Ok(Self { members: vec![Member::open(name, options)?], description: None }),
        }
    }

    /// The same with a medium besides, in the box of the volume.
    ///
    /// # Errors
    /// When there are several volumes, the medium makes no sense, or there is one of its name.
    pub fn with_medium(mut self, medium: Medium) -> Result<Self> {
        let [member] = self.members.as_mut_slice() else {
            let remedy = "write it into the scene: [medium] with `field` or a region";
            return Err(Error::argument("medium", "several volumes", "one volume alone", remedy));
        };
        let geometry = match member.geometry.take() {
            Some(geometry) => geometry,
            None => Geometry::new(Vec::new(), Vec::new(), 1.0)?,
        };
        let media = geometry.media().iter().cloned().chain([medium]).collect();
        let geometry = geometry.with_media(media)?;
        member.geometry = (!geometry.is_empty()).then_some(geometry);
        Ok(self)
    }

    /// The same with the solid of the volume translucent.
    ///
    /// # Errors
    /// When there are several volumes, or the body makes no sense.
    pub fn with_body(mut self, body: Body) -> Result<Self> {
        let [member] = self.members.as_mut_slice() else {
            let remedy = "leave the others out";
            return Err(Error::argument("translucent", "several volumes", "one volume alone", remedy));
        };
        let geometry = match member.geometry.take() {
            Some(geometry) => geometry,
            None => Geometry::new(Vec::new(), Vec::new(), 1.0)?,
        };
        member.geometry = Some(geometry.with_body(body)?);
        Ok(self)
    }

    /// The volumes; isovalues without a name are those of the first.
    pub fn members(&self) -> &[Member] {
        &self.members
    }

    /// The same, to change them.
    pub fn members_mut(&mut self) -> &mut [Member] {
        &mut self.members
    }

    /// The number of a volume of several by its name.
    ///
    /// # Errors
    /// When none is called so, or there is one alone.
    #[doc(hidden)]
    pub fn member_named(&self, name: &str) -> Result<usize> {
        let several = || self.members.iter().filter(|member| member.is_among_others());
        if let Some(found) = several().position(|member| member.volume.name == name) {
            return Ok(found);
        }
        let names: Vec<&str> = several().map(|member| member.volume.name.as_str()).collect();
        let (expected, remedy) = match names.as_slice() {
            [] => ("a store or a scene of several volumes".into(), "this is one volume alone: leave it out".into()),
            _ => (
                format!("one of {}", names.join(", ")),
                nearest(name, names.iter().copied())
                    .map_or("see the [[volumes]] of the scene".into(), |near| format!("did you mean {near}?")),
            ),
        };
        Err(Error::argument("--volume", name, expected, remedy))
    }

    /// The description that it comes from.
    pub fn description(&self) -> Option<&SceneFile> {
        self.description.as_ref()
    }
}

impl SceneFile {
    /// Reads the description in a file.
    ///
    /// # Errors
    /// When there is none, it is no description of a scene, or the environment that it names is not there.
    pub fn read(path: &str) -> Result<Self> {
        let stamp = file::stamp(path);
        let text = read_text(path).map_err(|error| {
            let Error::Io { source: e, .. } = &error else { return error };
            let near = nearest_beside(path, |name| name.ends_with(".toml"));
            match near.filter(|_| e.kind() == std::io::ErrorKind::NotFound) {
                Some(near) => {
                    let remedy = format!("did you mean {near}?");
                    Error::argument("scene", path, "a scene file that exists", remedy)
                }
                None => match error {
                    Error::Io { source, .. } => Error::io(path, "read the scene", source),
                    other => other,
                },
            }
        })?;
        let folder = Path::new(path).parent().map(Path::to_path_buf).unwrap_or_default();
        let file = Self { description: SceneDescription::parse(&text, path)?, folder, stamp };
        if let Some(probe) = file.description.probe.as_ref().filter(|p| p.is_file) {
            let place = file.folder.join(&probe.name.value);
            if !place.exists() {
                let remedy = "correct the path; it starts from the folder of the scene";
                let error = Error::argument("probe.file", place.display(), "an environment image that exists", remedy);
                return Err(file.description.at_line(probe.name.line, error));
            }
        }
        Ok(file)
    }

    /// A description that a program makes, with paths as they are; `name` is for messages.
    ///
    /// # Errors
    /// As [`SceneDescription::parse`].
    #[doc(hidden)]
    pub fn from_text(text: &str, name: &str) -> Result<Self> {
        Ok(Self { description: SceneDescription::parse(text, name)?, folder: PathBuf::new(), stamp: None })
    }

    /// Opens its volumes, with what stands around them and is not switched off.
    ///
    /// # Errors
    /// When a file that it names cannot be read, or what it describes makes no sense; each names the line.
    pub fn open(&self, options: &VolumeOptions, effects: &Effects) -> Result<Scene> {
        let (options, description) = (&options.of_scene(), &self.description);
        let members = if description.volumes.is_empty() {
            let volume = &description.volume;
            let opened = Member::open(&self.place_of(&volume.value), options);
            // A model names its lines itself.
            let is_model = ModelName::of(&volume.value).is_some();
            let mut member = opened.map_err(|e| if is_model { e } else { description.at_line(volume.line, e) })?;
            member.geometry = self.geometry(&member.volume, effects, options.choice.allow_outside)?;
            vec![member]
        } else {
            self.open_several(options, effects)?
        };
        Ok(Scene { members, description: Some(self.clone()) })
    }

    fn open_several(&self, options: &VolumeOptions, effects: &Effects) -> Result<Vec<Member>> {
        let descriptions = &self.description.volumes;
        let Some(coupling) = &self.description.coupling else {
            let remedy = "write coupling = \"normalised\", \"equal\" or rows of isovalues";
            return Err(Error::argument("coupling", "none", "which isovalues belong together", remedy));
        };
        options.refuse_exact_of_several()?;
        let mut members = descriptions.iter().map(|d| self.open_one(d, options)).collect::<Result<Vec<_>>>()?;
        // One world has one up, and the units of the first.
        let up = members.first().map(|first| first.volume.up).unwrap_or_default();
        members.iter_mut().for_each(|member| member.volume_mut().up = up);
        let geometry = match members.first() {
            Some(first) => self.geometry(&first.volume, effects, options.choice.allow_outside)?,
            None => None,
        };
        let tints: Vec<[f32; 3]> = descriptions.iter().map(|d| d.albedo).collect();
        let volumes: Vec<Coupled> = members.iter().map(coupled).collect();
        coupling.value.check(&volumes).map_err(|error| self.description.at_line(coupling.line, error))?;
        couple(members, &tints, &coupling.value, geometry)
    }

    /// Opens a volume of several where the description says that it stands.
    fn open_one(&self, description: &VolumeDescription, options: &VolumeOptions) -> Result<Member> {
        let in_file = |error| self.description.at_line(description.volume.line, error);
        if options.keep_largest {
            let remedy = "leave it out, or mask each volume before";
            let expected = "one volume alone";
            return Err(Error::argument("--keep-largest", "a scene of several volumes", expected, remedy));
        }
        let mut member = Member::open(&self.place_of(&description.volume.value), options).map_err(in_file)?;
        let placed = Volume::clone(&member.volume).placed(description.world_from_file, description.translate);
        let mut volume = placed.map_err(in_file)?;
        volume.name = description.name.value.clone();
        if options.solid.is_none()
            && let Some(solid) = description.solid
        {
            volume.solid = solid;
        }
        volume.check_cells().map_err(in_file)?;
        member.volume = Arc::new(volume);
        Ok(member)
    }

    /// Walls and luminaires; `None` where there are none, or all are switched off.
    fn geometry(&self, volume: &Volume, effects: &Effects, allow_outside: bool) -> Result<Option<Geometry>> {
        let mut surroundings = self.description.surroundings.clone();
        if effects.switched("walls") == Some(false) {
            surroundings.walls.clear();
        }
        if effects.switched("luminaires") == Some(false) {
            surroundings.luminaires.clear();
            surroundings.environments.clear();
            surroundings.walls.iter_mut().for_each(|wall| wall.emission = None);
            surroundings.media.iter_mut().for_each(|medium| medium.emission = [0.0; 3]);
        }
        if effects.switched("media") == Some(false) {
            surroundings.media.clear();
            surroundings.body = None;
        }
        if surroundings.is_empty() {
            return Ok(None);
        }
        let metres = match volume.unit {
            LengthUnit::Metres(metres) => metres,
            LengthUnit::Unknown => 1.0,
        };
        let mut read = |name: &str, named: Option<(&str, u64)>| {
            let mesh = self.folder.join(name);
            match named {
                None => read_mesh_file(&mesh),
                Some((other, bytes)) => {
                    let (file, length, path) = Beside::new(&mesh, allow_outside).open(other)?;
                    let (mut part, bytes) = (Vec::new(), bytes.min(length).min(MOST_MESH_BYTES));
                    file.take(bytes).read_to_end(&mut part).map_err(|e| Error::io(&path, "read", e))?;
                    Ok(part)
                }
            }
        };
        let mut surface = |name: &str, isovalue: f64| {
            let opened = Member::open(&self.place_of(name), &VolumeOptions::default())?;
            let mesh = crate::surface::extract(&opened.volume, isovalue)?;
            let place = |p: &[f32; 3]| opened.volume.world_from_grid().point(DVec3::from_array(p.map(f64::from)));
            Ok(TriangleMesh {
                positions: mesh.positions_in_grid.iter().map(place).collect(),
                triangles: mesh.triangles,
            })
        };
        let mut environment = |name: &str, rotation: f64| {
            let probe = probe::open(&self.place_of_environment(name), &ReadOptions::default())?;
            Ok(distant_light(&probe, Orientation::new(volume.up, rotation)?))
        };
        let mut field = |field: &FieldDescription| {
            let volume = match field {
                FieldDescription::Lit => return Ok(MediumField::Lit),
                // The volumes of the scene, where they stand in it.
                FieldDescription::Volume(name) => {
                    let of_name = self.description.volumes.iter().find(|v| v.name.value == *name);
                    let found = of_name.map(|d| self.open_one(d, &VolumeOptions::default())).transpose()?;
                    found.map(|member| member.volume).ok_or_else(|| {
                        Error::argument("field", name, "a volume of the scene", "name one of its [[volumes]]")
                    })?
                }
                FieldDescription::File(name) => Member::open(&self.place_of(name), &VolumeOptions::default())?.volume,
            };
            volume.check_cells()?;
            let pyramid = Arc::new(Pyramid::new(&volume));
            Ok(MediumField::Other { volume, pyramid })
        };
        let (read, surface, environment) = (&mut read, &mut surface, &mut environment);
        let geometry = surroundings.assemble(&self.description, metres, read, surface, environment, &mut field)?;
        let of_unit = match (volume.unit, self.description.surroundings.metres_per_unit) {
            (_, Some(metres)) | (LengthUnit::Metres(metres), None) => Some(metres),
            (LengthUnit::Unknown, None) => None,
        };
        let geometry = match &surroundings.body {
            Some(body) => {
                geometry.with_body(body.body(of_unit).map_err(|e| self.description.at_line(body.line, e))?)?
            }
            None => geometry,
        };
        // Vacuum alone is nothing.
        Ok((!geometry.is_empty()).then_some(geometry))
    }

    /// A path from the folder of the scene, or the name of a field, as [`Member::open`] takes it.
    #[doc(hidden)]
    pub fn place_of(&self, name: &str) -> String {
        let is_field = !matches!(field::by_name(name), Ok(None));
        if is_field { name.to_string() } else { self.folder.join(name).display().to_string() }
    }

    /// The environment as [`crate::probe::open`] takes it: a name, or a path; where there is none but luminaires, [`DARK`].
    #[doc(hidden)]
    pub fn environment(&self) -> Option<String> {
        let Some(probe) = self.description.probe.as_ref() else {
            // Luminaires are light enough.
            let shines = self.description.surroundings.shines();
            return shines.then(|| DARK.to_string());
        };
        let name = &probe.name.value;
        Some(if probe.is_file { self.folder.join(name).display().to_string() } else { name.clone() })
    }

    /// A path from the folder of the scene, or the name of a built-in environment, as [`crate::probe::open`] takes it.
    fn place_of_environment(&self, name: &str) -> String {
        let place = self.folder.join(name);
        if place.exists() { place.display().to_string() } else { name.to_string() }
    }

    /// The isovalues that it lists, as written: where there are none, those of the first volume in the pairs of the coupling.
    #[doc(hidden)]
    pub fn listed_isovalues(&self) -> Vec<String> {
        match &self.description.coupling {
            Some(Located { value: Coupling::Rows(rows), .. }) if self.description.isovalues.is_empty() => {
                rows.iter().map(|row| row[0].to_string()).collect()
            }
            _ => self.description.isovalues.iter().map(|i| i.value.clone()).collect(),
        }
    }

    /// Bands of the layers; none where it does not say.
    #[doc(hidden)]
    pub fn bands(&self) -> Vec<u8> {
        self.description.bake.bands.iter().map(|&b| b as u8).collect()
    }

    /// The [`file::stamp`] of the file as it was before it was read.
    #[doc(hidden)]
    pub fn stamp(&self) -> Option<String> {
        self.stamp.clone()
    }

    /// All files that it names, and those that models among them name.
    #[doc(hidden)]
    pub fn files(&self) -> Vec<PathBuf> {
        let description = &self.description;
        let volumes = description.volumes.iter().map(|volume| &volume.volume.value);
        let walls = description.surroundings.walls.iter().filter_map(|wall| match &wall.shape {
            WallShape::Mesh { file, .. } => Some(&file.value),
            WallShape::Isosurface { volume, .. } => Some(&volume.value),
            WallShape::Ready(_) => None,
        });
        let probe = description.probe.iter().filter(|probe| probe.is_file).map(|probe| &probe.name.value);
        let fixed = description.surroundings.environments.iter().map(|environment| &environment.image.value);
        let of_media = description.surroundings.media.iter().filter_map(|medium| match &medium.field {
            FieldDescription::File(name) => Some(name),
            _ => None,
        });
        let named = volumes.chain(walls).chain(of_media).chain(probe).chain(fixed).chain([&description.volume.value]);
        let in_folder = named.map(|name| self.folder.join(name));
        let files = in_folder.flat_map(|path| match ModelName::of(&path.to_string_lossy()) {
            Some(model) => files_of_model(&model),
            None => vec![path],
        });
        files.collect()
    }
}

/// What an argument that may be a path is read from: it, and of a scene or a model the files that it names.
pub(crate) fn files_of(name: &str) -> Vec<PathBuf> {
    let Some(model) = ModelName::of(name) else { return vec![name.into()] };
    // What cannot be read is refused where it is read.
    let scene = SceneFile::read(model.path).map(|scene| scene.files()).unwrap_or_default();
    files_of_model(&model).into_iter().chain(scene).collect()
}

/// An environment that is fixed before the bake, as it stands in the world.
#[doc(hidden)]
pub fn distant_light(probe: &Probe, orientation: Orientation) -> DistantLight {
    let image = &probe.image;
    let (mut hasher, mut total) = (blake3::Hasher::new(), [0.0f64; 3]);
    for y in 0..image.height() {
        let solid_angle = image.pixel_solid_angle(y);
        for pixel in image.row(y) {
            for v in pixel {
                hasher.update(&v.to_le_bytes());
            }
            (0..3).for_each(|c| total[c] += f64::from(pixel[c].max(0.0)) * solid_angle);
        }
    }
    hasher.update(&(image.width() as u64).to_le_bytes());
    for v in orientation.probe_from_world().to_cols_array() {
        hasher.update(&v.to_le_bytes());
    }
    let fingerprint = format!("environment {}", hasher.finalize().to_hex());
    DistantLight::new(Arc::new(probe.source(orientation).into_owned()), fingerprint, total)
}

fn coupled(member: &Member) -> Coupled {
    Coupled { name: member.volume.name.clone(), range: member.volume.value_range() }
}

/// Puts volumes side by side: each gets the others as its partners.
fn couple(
    mut members: Vec<Member>,
    tints: &[[f32; 3]],
    coupling: &Coupling,
    geometry: Option<Geometry>,
) -> Result<Vec<Member>> {
    let volumes: Vec<Coupled> = members.iter().map(coupled).collect();
    coupling.check(&volumes)?;
    // Among others a convex solid is shaded all the same.
    members.iter_mut().filter(|m| m.volume.convex_side.is_some()).for_each(|m| m.volume_mut().convex_side = None);
    let geometry = match geometry {
        Some(geometry) => geometry,
        None => Geometry::new(Vec::new(), Vec::new(), 1.0)?,
    };
    let pyramids: Vec<Arc<Pyramid>> = members.iter().map(|m| Arc::new(Pyramid::new(&m.volume))).collect();
    let first = members.first().map(|first| (first.volume.clone(), first.default_isovalue));
    let all: Vec<Arc<Volume>> = members.iter().map(|m| m.volume.clone()).collect();
    for (place, member) in members.iter_mut().enumerate() {
        let partner = |i: usize| Partner {
            name: volumes[i].name.clone(),
            volume: all[i].clone(),
            pyramid: pyramids[i].clone(),
            isovalue: coupling.between(&volumes, place, i),
            tint: tints[i],
        };
        let partners = (0..all.len()).filter(|&i| i != place).map(partner).collect();
        let among =
            Among { name: volumes[place].name.clone(), place, coupling: coupling.describe(), tint: tints[place] };
        member.geometry = Some(geometry.clone().with_partners(among, partners)?);
        let first = first.clone().filter(|_| place > 0);
        member.among = Some(AmongOthers { coupling: coupling.clone(), volumes: volumes.clone(), place, first });
    }
    Ok(members)
}

/// The text of a scene.
fn read_text(path: &str) -> Result<String> {
    let bytes = file::read(path, MOST_SCENE_BYTES)?;
    String::from_utf8(bytes).map_err(|_| {
        Error::format("scene", "bytes that are no text", "TOML in UTF-8", "save it as UTF-8").in_file(path)
    })
}

/// A mesh that the scene names.
fn read_mesh_file(path: &Path) -> Result<Vec<u8>> {
    file::read(path, MOST_MESH_BYTES).map_err(|error| match error {
        Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            let remedy = "correct the path; it starts from the folder of the scene";
            Error::argument("file", path.display(), "a mesh that exists (.obj, .ply, .stl, .gltf, .glb)", remedy)
        }
        other => other,
    })
}
