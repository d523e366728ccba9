//! The description of a scene, a TOML file: which volume, what it is made of, how it is baked, what lights it, and which
//! files are wanted of it.
//!
//! The reader is strict. A key that it does not know, a value of another type and a number that makes no sense are
//! errors that name file, line, and what to write instead.
//!
//! ```toml
//! volume = "brain.nii.gz"        # a path from the folder of this file, or a field such as "gyroid:96"
//! solid = "above"                # which side is matter
//! up = "z"
//! isovalues = [90, "60%", "auto"]
//! outputs = ["{isovalue}.glb", "{isovalue}.png"]   # paths from the working folder
//!
//! [material]
//! albedo = [0.7, 0.6, 0.5]       # or a number, or rows [isovalue, r, g, b]
//! # colormap = "viridis"         # then albedo is a factor
//! # range = [40, 200]
//! emission = 0.0                 # or r, g, b, or rows [isovalue, r, g, b]
//!
//! # kind = "translucent"         # then light passes through the solid; albedo, phase as of a [medium], and:
//! # preset = "marble"            # milk, skin, bone, wax; or extinction, or mean_free_path = "0.4 mm"
//! # albedo_nodes = 6             # in place of albedo: free at relight
//! # index = 1.5                  # of refraction
//!
//! [bake]
//! rays = 64
//! layers = 4
//! bands = 5                      # or one for each layer
//! # error = "1%"
//! texture = 1.0                  # or [128, 128, 96]
//! positive = false
//!
//! [probe]
//! name = "courtyard"             # or file = "sunset.exr"
//! rotation = 30.0                # degrees, counter-clockwise about up
//!
//! [camera]
//! azimuth = 35.0                 # or view = "iso"
//! elevation = 25.0
//! size = [960, 720]
//! projection = "perspective"
//! field_of_view = 35.0
//! exposure = "auto"
//! ```
//!
//! What stands around the volume, in its world coordinates:
//!
//! ```toml
//! metres_per_unit = 1.0          # [default: as the file of the volume says, else 1]
//!
//! [[walls]]                      # or [[objects]], which is the same
//! name = "room"
//! shape = "room"                 # its six faces look inward; box, rectangle, sphere, mesh, isosurface
//! min = [0, 0, 0]
//! max = [1, 1, 1]
//! albedo = 0.7                   # diffuse; or material = "mirror", reflectance = 0.9
//! faces = { "-x" = [0.63, 0.06, 0.05] }
//! open = ["-z"]
//!
//! [[objects]]
//! shape = "sphere"
//! centre = [0.5, 0.3, 0.5]
//! radius = 0.1
//! material = "glass"
//! index = 1.5
//!
//! [[objects]]
//! shape = "mesh"                 # .obj, .ply, .stl, .gltf, .glb; triangles counter-clockwise seen from the front
//! file = "table.obj"
//! scale = 0.01
//! rotate = [0, 0, 1, 90]         # axis and degrees
//! translate = [0, 0, 0.2]
//! emission = [2, 1, 0.5]         # radiance of its front, W m⁻² sr⁻¹; then it is a luminaire too
//!
//! [[objects]]
//! shape = "isosurface"           # of another volume, lit and shaded together with this one
//! volume = "gyroid:48"
//! isovalue = 0.5
//! scale = 0.1
//!
//! [[luminaires]]
//! name = "ceiling"
//! shape = "rectangle"            # shines to the side of u × v; sphere, point, directional
//! corner = [0.3, 0.0, 0.3]
//! u = [0.0, 0.0, 0.4]
//! v = [0.4, 0.0, 0.0]
//! power = 90                     # watts; irradiance in W m⁻² of a directional one
//! colour = [1.0, 0.9, 0.8]       # a factor
//!
//! [[luminaires]]
//! shape = "environment"          # a whole image that is fixed before the bake, without limit of bands
//! image = "courtyard"            # a file, or a name such as sky
//! rotation = 30                  # degrees, counter-clockwise about up
//! power = 1                      # a factor on its radiance
//! ```
//!
//! What lies between surfaces, outside the solid ([`crate::scene::medium`]); `[medium]` for one, `[[medium]]` for several:
//!
//! ```toml
//! [medium]
//! name = "fog"
//! field = "self"                      # or a file, or the name of a volume; not needed where extinction is one number
//! extinction = [[0, 0.0], [40, 0.8]]  # per world unit over the values of the field; or one number, or r, g, b; rows of four = value, r, g, b
//! albedo = [0.95, 0.9, 0.85]          # or one number, or rows
//! phase = { hg = 0.6 }                # { schlick = 0.5 } { rayleigh = true } { table = [[-1, 0.2], [1, 3]] } { mix = [[0.7, { hg = 0.8 }], [0.3, { hg = -0.2 }]] }
//! emission = 0.0                      # radiance of an opaque piece; then it is a luminaire too
//! min = [0, 0, 0]                     # a box in world, or centre and radius of a ball [default: the box of the field]
//! max = [1, 1, 1]
//! ```
//!
//! Several volumes that light each other stand in place of `volume` and `solid`; `isovalues` are then those of the first:
//!
//! ```toml
//! coupling = "normalised"        # the same fraction of each range; or "equal" values; or rows [[47, 0.6], …] of pairs
//!
//! [[volumes]]
//! name = "bumps"                 # that of its groups in the store
//! volume = "bumpbox:48"
//!
//! [[volumes]]
//! name = "gyroid"
//! volume = "gyroid:24"
//! solid = "above"
//! scale = 0.3                    # of its file's world, then
//! rotate = [0, 0, 1, 90]
//! translate = [0.35, 0.08, 0.35]
//! albedo = [0.3, 0.5, 1.0]       # a factor on that of the material, baked in
//! ```

mod body;
mod material;
mod media;
mod model;
mod read;
mod settings;
mod surroundings;
mod volumes;

#[cfg(test)]
mod tests;

pub use body::BodyDescription;
pub use material::Albedo;
pub use media::{FieldDescription, MediumDescription};
pub(crate) use model::files_of_nodes;
pub use model::{Files, ModelDescription, Size};
pub use settings::{BakeDescription, CameraDescription, ProbeDescription, TextureSize};
pub use surroundings::{ReadFile, Surroundings, WallDescription, WallShape};
pub use volumes::VolumeDescription;

use super::{Coupling, EmissionRule};
use crate::error::{Error, Result};
use crate::geom::Up;
use crate::volume::{Isovalue, Solid};
use read::{Item, Section, Source};

/// A value and its line in the file, from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Located<T> {
    /// The value.
    pub value: T,
    /// The line.
    pub line: usize,
}

/// A scene as described; what a file does not say is `None`.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// Name of the file, for messages.
    pub file: String,
    /// A path from the folder of the file, or a field such as `gyroid:96`; the first one where there are several.
    pub volume: Located<String>,
    /// The line of the section `[model]`, if that is the volume: `volume` is then the name of this file with its samples.
    pub model: Option<usize>,
    /// Where there are several: all of them, at least two. Isovalues are those of the first.
    pub volumes: Vec<VolumeDescription>,
    /// Which isovalues of several volumes are shown together; there where they are.
    pub coupling: Option<Located<Coupling>>,
    /// Which side is matter.
    pub solid: Option<Solid>,
    /// The world axis that points up.
    pub up: Option<Up>,
    /// Numbers in the values of the volume, percentages of their range, or `auto`; as on the command line. Empty for all.
    pub isovalues: Vec<Located<String>>,
    /// Diffuse reflectance over the isovalue.
    pub albedo: Option<Albedo>,
    /// Emitted radiance over the isovalue.
    pub emission: Option<EmissionRule>,
    /// How transfer is computed.
    pub bake: BakeDescription,
    /// The environment.
    pub probe: Option<ProbeDescription>,
    /// How pictures look.
    pub camera: CameraDescription,
    /// Walls, objects and luminaires around the volume.
    pub surroundings: Surroundings,
    /// Files to write, as `-o` of `isolume relight` names them.
    pub outputs: Vec<Located<String>>,
}

const KEYS: [&str; 17] = [
    "volume",
    "model",
    "volumes",
    "coupling",
    "solid",
    "up",
    "isovalues",
    "outputs",
    "material",
    "bake",
    "probe",
    "camera",
    "metres_per_unit",
    "walls",
    "objects",
    "luminaires",
    "medium",
];
const UPS: [&str; 6] = ["x", "y", "z", "-x", "-y", "-z"];

impl SceneDescription {
    /// Reads a description; `file` is its name for messages.
    ///
    /// # Errors
    /// When the text is no TOML, a key is not known or not supported yet, a value has the wrong type or makes no sense;
    /// each names file and line.
    pub fn parse(text: &str, file: &str) -> Result<Self> {
        let source = Source { file, text };
        let document = source.table()?;
        let all = Section::new(source, document.get_ref(), "", &KEYS)?;
        let (volumes, coupling) = volumes::read(&all)?;
        let model = model::glance(&all)?;
        if let (Some((line, _)), Some(other)) = (model, all.get("volume").or(all.get("volumes"))) {
            return Err(other.refuse(format!("one volume: line {line} has a [model]"), "take one of them out"));
        }
        let volume = match (volumes.first(), model) {
            (Some(first), _) => first.volume.clone(),
            (None, Some((line, samples))) => {
                // The model is read again where volumes are opened, by the name that it has beside this scene.
                let name = std::path::Path::new(file).file_name().map(|n| n.to_string_lossy().into_owned());
                Located { value: format!("{}:{samples}", name.unwrap_or_default()), line }
            }
            (None, None) => {
                let volume = all.get("volume").ok_or_else(|| {
                    let remedy = "write volume = \"brain.nii.gz\", a field such as \"bumpbox:96\", or a [model]";
                    source.error(0, "no key `volume`", "the volume of the scene", remedy)
                })?;
                Located { value: volume.text()?.to_string(), line: volume.line() }
            }
        };
        let solid = all.get("solid").map(|item| side(&item)).transpose()?;
        let up = all.get("up").map(|item| axis(&item)).transpose()?;
        let isovalues = match all.get("isovalues") {
            Some(item) => {
                let list = item.one_or_more()?;
                if list.len() > MOST_ISOVALUES {
                    let expected = format!("at most {MOST_ISOVALUES} isovalues (found {})", list.len());
                    return Err(item.refuse(expected, "bake all isovalues at once: leave the list out"));
                }
                list.iter().map(isovalue).collect::<Result<_>>()?
            }
            None => Vec::new(),
        };
        let outputs = match all.get("outputs") {
            Some(item) => item.one_or_more()?.iter().map(output).collect::<Result<_>>()?,
            None => Vec::new(),
        };
        let body = all.get("material").map(|item| body::read(&item)).transpose()?.flatten();
        let (albedo, emission) = match all.get("material") {
            Some(item) if body.is_none() => material::read(&item)?,
            _ => (None, None),
        };
        let bake = all.get("bake").map(|item| settings::bake(&item)).transpose()?.unwrap_or_default();
        let probe = all.get("probe").map(|item| settings::probe(&item)).transpose()?;
        let camera = all.get("camera").map(|item| settings::camera(&item)).transpose()?.unwrap_or_default();
        let mut surroundings = surroundings::read(&all)?;
        surroundings.media = media::read(&all, &volumes)?;
        surroundings.body = body;
        surroundings.check_names(&all)?;
        let file = file.to_string();
        Ok(Self {
            file,
            volume,
            model: model.map(|(line, _)| line),
            volumes,
            coupling,
            solid,
            up,
            isovalues,
            albedo,
            emission,
            bake,
            probe,
            camera,
            surroundings,
            outputs,
        })
    }

    /// Names file and line in an error about what stands there.
    #[must_use]
    pub fn at_line(&self, line: usize, error: Error) -> Error {
        let place = format!("{}:{line}", self.file);
        match error {
            Error::Argument { name, given, expected, remedy } => {
                Error::Argument { name: format!("{place}: {name}"), given, expected, remedy }
            }
            Error::Format { file, format, found, expected, remedy } => {
                Error::Format { file: format!("{place}: {file}"), format, found, expected, remedy }
            }
            other => other,
        }
    }
}

fn side(item: &Item<'_>) -> Result<Solid> {
    Ok(if item.word(&["above", "below"])? == "above" { Solid::Above } else { Solid::Below })
}

fn axis(item: &Item<'_>) -> Result<Up> {
    Ok(Up::named(item.word(&UPS)?).unwrap_or_default())
}

/// A number, or text such as "40%" or "auto".
/// Most isovalues of a scene or of a command: each takes a pass over the volume.
pub const MOST_ISOVALUES: usize = 1000;

fn isovalue(item: &Item<'_>) -> Result<Located<String>> {
    let value = match (item.as_number(), item.as_text()) {
        (Some(number), _) => Some(number.to_string()),
        (None, Some(text)) => match text.parse() {
            Ok(Isovalue::Percent(part)) if !(0.0..=100.0).contains(&part) => None,
            Ok(Isovalue::Value(_)) | Err(_) => None,
            Ok(_) => Some(text.to_string()),
        },
        _ => None,
    };
    let expected = "a number, or text such as \"40%\", \"1.5sigma\", \"bone\" or \"auto\"";
    let value = value.ok_or_else(|| item.refuse(expected, "numbers stand without quotes"))?;
    Ok(Located { value, line: item.line() })
}

fn output(item: &Item<'_>) -> Result<Located<String>> {
    let name = item.text()?;
    let known = [".glb", ".ply", ".stl", ".png"].iter().any(|end| name.to_ascii_lowercase().ends_with(end));
    if !known && !name.ends_with('/') {
        return Err(item.refuse("a name ending in .glb, .ply, .stl or .png", "the ending decides the format"));
    }
    Ok(Located { value: name.to_string(), line: item.line() })
}
