//! GLB: a lit mesh as glTF 2.0 in one binary file (Khronos, "glTF 2.0 Specification", 2021).
//!
//! The JSON is made of `gltf::json` types; the binary chunk is packed here, because no crate
//! does that: one buffer view to an attribute, indices last, every view a multiple of 4 bytes.
//!
//! * `COLOR_0` is linear and within [0, 1] (the specification demands it of floats, too);
//!   by default 16-bit normalised RGBA with alpha 1, whose 8 bytes keep the alignment of 4.
//! * `_RADIANCE` (VEC3 float) and `_STDERR` (SCALAR or VEC3 float) carry what `COLOR_0` cannot.
//! * [`Scalars`] carry what else belongs to the vertices, such as transfer coefficients.
//! * `KHR_materials_unlit`: the light is in the colours. A viewer without it sees a rough,
//!   non-metallic white that the colours modulate.
//! * A surface without triangles is a file with a node and no mesh: accessors cannot be empty.

use super::{ExportMesh, StandardError, bytes_of_triple, write_error, write_records};
use crate::error::{Error, Result};
use crate::geom::Bounds;
use ::gltf::json::validation::{Checked, USize64};
use ::gltf::json::{self, Index, accessor, buffer, extensions, extras::RawValue, material, mesh, scene};
use glam::{DQuat, DVec3, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;

/// How `COLOR_0` is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourFormat {
    /// 16 bits a channel, normalised: 8 bytes a vertex, error at most 1/131,070.
    #[default]
    U16,
    /// 32-bit floating point: 12 bytes a vertex, exact.
    F32,
}

/// How to write a GLB.
#[derive(Clone, Debug)]
pub struct GltfOptions {
    /// How `COLOR_0` is stored.
    pub colour_format: ColourFormat,
    /// Whether up to 65,535 vertices are indexed with 16 bits.
    pub allow_u16_indices: bool,
    /// glTF units (metres) to a world unit; `None` leaves it to [`scale`].
    pub scale: Option<f64>,
    /// Whether back faces show, too. True by default: surfaces are open at the box border.
    pub double_sided: bool,
    /// What made the file, for `asset.generator`.
    pub generator: String,
    /// Copyright line of the data, for `asset.copyright`.
    pub copyright: Option<String>,
    /// How the file was made, for `asset.extras`; left out when null.
    pub provenance: Value,
    /// More numbers to the vertices, one attribute each.
    pub scalars: Vec<Scalars>,
    /// What readers of [`GltfOptions::scalars`] need to know, for `extras` of the mesh; left out when null.
    pub mesh_extras: Value,
}

/// A number to each vertex, as an attribute of its own.
#[derive(Clone, Debug)]
pub struct Scalars {
    /// Name of the attribute without the underscore that begins it: capital letters, digits and underscores.
    pub name: String,
    /// One number a vertex, finite.
    pub values: Vec<f32>,
}

impl Default for GltfOptions {
    fn default() -> Self {
        Self {
            colour_format: ColourFormat::U16,
            allow_u16_indices: true,
            scale: None,
            double_sided: true,
            generator: concat!("isolume ", env!("CARGO_PKG_VERSION")).into(),
            copyright: None,
            provenance: Value::Null,
            scalars: Vec::new(),
            mesh_extras: Value::Null,
        }
    }
}

/// glTF units (metres) to a world unit: 0.001 where a world unit is a millimetre; else what makes
/// the longest side of the box 1 (a molecule or a cell in metres would be invisible); 1 for a box
/// without extent.
pub fn scale(mesh: &ExportMesh<'_>) -> f64 {
    const MILLIMETRE: f64 = 1e-3;
    let longest = mesh.box_in_world.size().max_element();
    match mesh.metres_per_unit {
        // Units come from names, but also from products of decimal numbers.
        Some(metres) if (metres / MILLIMETRE - 1.0).abs() < 1e-6 => MILLIMETRE,
        _ if longest > 0.0 => 1.0 / longest,
        _ => 1.0,
    }
}

/// Sides in metres, along X, Y and Z of glTF, of the box around what a mesh shows in a viewer; `given` is
/// [`GltfOptions::scale`]. All 0 for a mesh without triangles.
pub fn size_in_metres(mesh: &ExportMesh<'_>, given: Option<f64>) -> [f64; 3] {
    let centre = mesh.centre_in_world();
    let bounds = (0..mesh.positions.len())
        .fold(Bounds::EMPTY, |bounds, v| bounds.including(mesh.positions.from_centre(v, centre).as_dvec3()));
    if mesh.triangles.is_empty() {
        return [0.0; 3];
    }
    // The rotation takes axes to axes.
    let sides = (mesh.up.gltf_from_world() * bounds.size()).abs();
    (sides * given.unwrap_or_else(|| scale(mesh))).to_array()
}

/// Largest vertex count with 16-bit indices: 65,535 is the primitive restart value, so 65,534 is
/// the last index.
const MOST_U16_VERTICES: usize = 65_535;

/// Writes a mesh as GLB.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`Error::Argument`] for a scale that is not positive or
/// not normal in f32, or a place beyond f32; [`Error::Limit`] above 4 GiB, the most a GLB can hold;
/// [`Error::Io`] (path empty) from the stream.
pub fn write(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>, options: &GltfOptions) -> Result<()> {
    mesh.check()?;
    check_scalars(mesh, &options.scalars)?;
    let layout = Layout::new(mesh, options);
    let mut text = document(mesh, options, &layout)?.into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');

    let binary = layout.bytes.next_multiple_of(4);
    let total = 12 + 8 + text.len() as u64 + if binary > 0 { 8 + binary } else { 0 };
    let (Ok(total), Ok(binary)) = (u32::try_from(total), u32::try_from(binary)) else {
        return Err(Error::Limit {
            what: "the GLB file".into(),
            needed: format!("{total} bytes"),
            limit: format!("{} bytes", u32::MAX),
            remedy: "leave out radiance and standard error, or extract a part of the surface".into(),
        });
    };
    let mut head = Vec::with_capacity(text.len() + 28);
    head.extend(b"glTF");
    head.extend(2u32.to_le_bytes());
    head.extend(total.to_le_bytes());
    head.extend((text.len() as u32).to_le_bytes());
    head.extend(b"JSON");
    head.extend(&text);
    if binary > 0 {
        head.extend(binary.to_le_bytes());
        head.extend(b"BIN\0");
    }
    w.write_all(&head).map_err(write_error)?;
    for view in &layout.views {
        write_view(w, mesh, &options.scalars, view)?;
    }
    Ok(())
}

fn check_scalars(mesh: &ExportMesh<'_>, scalars: &[Scalars]) -> Result<()> {
    let count = mesh.positions.len();
    for Scalars { name, values } in scalars {
        let legal = !name.is_empty() && name.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_');
        let finite = values.iter().all(|v| v.is_finite());
        if !(legal && finite && values.len() == count) {
            return Err(Error::argument(
                format!("mesh attribute _{name}"),
                format!("{} numbers{}", values.len(), if finite { "" } else { ", not all finite" }),
                format!("{count} finite numbers under a name of A-Z, 0-9 and _"),
                "correct the attribute before export",
            ));
        }
    }
    Ok(())
}

/// What a buffer view holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Position,
    Normal,
    ColourU16,
    ColourF32,
    Radiance,
    StderrGrey,
    StderrRgb,
    /// Entry of [`GltfOptions::scalars`].
    Scalars(usize),
    IndicesU16,
    IndicesU32,
}

impl Content {
    /// Component type, type, bytes an element.
    fn format(self) -> (accessor::ComponentType, accessor::Type, u64) {
        use accessor::{ComponentType as C, Type as T};
        match self {
            Self::Position | Self::Normal | Self::ColourF32 | Self::Radiance | Self::StderrRgb => (C::F32, T::Vec3, 12),
            Self::ColourU16 => (C::U16, T::Vec4, 8),
            Self::StderrGrey | Self::Scalars(_) => (C::F32, T::Scalar, 4),
            Self::IndicesU16 => (C::U16, T::Scalar, 2),
            Self::IndicesU32 => (C::U32, T::Scalar, 4),
        }
    }

    /// The attribute it is; `None` for indices.
    fn semantic(self, scalars: &[Scalars]) -> Option<mesh::Semantic> {
        match self {
            Self::Position => Some(mesh::Semantic::Positions),
            Self::Normal => Some(mesh::Semantic::Normals),
            Self::ColourU16 | Self::ColourF32 => Some(mesh::Semantic::Colors(0)),
            // The crate writes the underscore.
            Self::Radiance => Some(mesh::Semantic::Extras("RADIANCE".into())),
            Self::StderrGrey | Self::StderrRgb => Some(mesh::Semantic::Extras("STDERR".into())),
            Self::Scalars(i) => Some(mesh::Semantic::Extras(scalars[i].name.clone())),
            Self::IndicesU16 | Self::IndicesU32 => None,
        }
    }
}

struct View {
    content: Content,
    count: u64,
    // Invariant: a multiple of 4.
    offset: u64,
    bytes: u64,
}

/// Where everything stands in the binary chunk.
struct Layout {
    views: Vec<View>,
    // Without the padding of the last view.
    bytes: u64,
}

impl Layout {
    fn new(mesh: &ExportMesh<'_>, options: &GltfOptions) -> Self {
        let mut layout = Self { views: Vec::new(), bytes: 0 };
        if mesh.is_empty() {
            return layout;
        }
        let vertices = mesh.positions.len();
        layout.push(Content::Position, vertices);
        layout.push(Content::Normal, vertices);
        layout.push(
            match options.colour_format {
                ColourFormat::U16 => Content::ColourU16,
                ColourFormat::F32 => Content::ColourF32,
            },
            vertices,
        );
        if mesh.radiance.is_some() {
            layout.push(Content::Radiance, vertices);
        }
        match mesh.standard_error {
            Some(StandardError::Grey(_)) => layout.push(Content::StderrGrey, vertices),
            Some(StandardError::Rgb(_)) => layout.push(Content::StderrRgb, vertices),
            None => {}
        }
        (0..options.scalars.len()).for_each(|i| layout.push(Content::Scalars(i), vertices));
        let short = options.allow_u16_indices && vertices <= MOST_U16_VERTICES;
        layout.push(if short { Content::IndicesU16 } else { Content::IndicesU32 }, 3 * mesh.triangles.len());
        layout
    }

    fn push(&mut self, content: Content, count: usize) {
        let count = count as u64;
        let bytes = count * content.format().2;
        // Every element but a 16-bit index is a multiple of 4 bytes, and indices come last.
        debug_assert!(self.bytes.is_multiple_of(4));
        self.views.push(View { content, count, offset: self.bytes, bytes });
        self.bytes += bytes;
    }
}

fn write_view(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>, scalars: &[Scalars], view: &View) -> Result<()> {
    let vertices = mesh.positions.len();
    let centre = mesh.centre_in_world();
    let triangles = mesh.triangles;
    match view.content {
        Content::Position => {
            write_records(w, vertices, |v| bytes_of_triple(mesh.positions.from_centre(v, centre).to_array()))
        }
        Content::Normal => write_records(w, vertices, |v| bytes_of_triple(mesh.unit_normal(v).to_array())),
        Content::ColourF32 => write_records(w, vertices, |v| bytes_of_triple(mesh.colours[v])),
        Content::ColourU16 => write_records(w, vertices, |v| {
            let [r, g, b] = mesh.colours[v].map(|c| ((c * 65_535.0 + 0.5) as u16).to_le_bytes());
            [r[0], r[1], g[0], g[1], b[0], b[1], 0xff, 0xff]
        }),
        Content::Radiance => {
            let radiance = mesh.radiance.unwrap_or_default();
            write_records(w, radiance.len(), |v| bytes_of_triple(radiance[v]))
        }
        Content::StderrGrey | Content::StderrRgb => match mesh.standard_error {
            Some(StandardError::Grey(e)) => write_records(w, e.len(), |v| e[v].to_le_bytes()),
            Some(StandardError::Rgb(e)) => write_records(w, e.len(), |v| bytes_of_triple(e[v])),
            None => Ok(()),
        },
        Content::Scalars(i) => write_records(w, vertices, |v| scalars[i].values[v].to_le_bytes()),
        Content::IndicesU32 => write_records(w, triangles.len(), |t| {
            let [a, b, c] = triangles[t].map(u32::to_le_bytes);
            [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], c[0], c[1], c[2], c[3]]
        }),
        Content::IndicesU16 => {
            write_records(w, triangles.len(), |t| {
                let [a, b, c] = triangles[t].map(|i| (i as u16).to_le_bytes());
                [a[0], a[1], b[0], b[1], c[0], c[1]]
            })?;
            let padding = (view.bytes.next_multiple_of(4) - view.bytes) as usize;
            w.write_all(&[0; 3][..padding]).map_err(write_error)
        }
    }
}

/// The JSON chunk.
fn document(mesh: &ExportMesh<'_>, options: &GltfOptions, layout: &Layout) -> Result<String> {
    let mut root = json::Root {
        asset: json::Asset {
            generator: Some(options.generator.clone()),
            copyright: options.copyright.clone(),
            extras: raw(&options.provenance)?,
            ..Default::default()
        },
        ..Default::default()
    };
    let mesh_index = (!mesh.is_empty()).then(|| push_mesh(&mut root, mesh, options, layout)).transpose()?;
    let node = node(mesh, options, mesh_index)?;
    let node = root.push(node);
    root.scene = Some(root.push(json::Scene { extensions: None, extras: None, name: None, nodes: vec![node] }));
    json::serialize::to_string(&root).map_err(serialization_error)
}

fn push_mesh(
    root: &mut json::Root,
    mesh: &ExportMesh<'_>,
    options: &GltfOptions,
    layout: &Layout,
) -> Result<Index<json::Mesh>> {
    let buffer = root.push(json::Buffer {
        byte_length: USize64(layout.bytes),
        name: None,
        uri: None,
        extensions: None,
        extras: None,
    });
    let mut attributes = BTreeMap::new();
    let mut indices = None;
    for view in &layout.views {
        let accessor = push_accessor(root, mesh, view, buffer);
        match view.content.semantic(&options.scalars) {
            Some(semantic) => {
                attributes.insert(Checked::Valid(semantic), accessor);
            }
            None => indices = Some(accessor),
        }
    }
    let unlit = extensions::material::Material { unlit: Some(extensions::material::Unlit {}) };
    root.extensions_used.push("KHR_materials_unlit".into());
    let material = root.push(json::Material {
        double_sided: options.double_sided,
        pbr_metallic_roughness: material::PbrMetallicRoughness {
            base_color_factor: material::PbrBaseColorFactor([1.0; 4]),
            metallic_factor: material::StrengthFactor(0.0),
            roughness_factor: material::StrengthFactor(1.0),
            ..Default::default()
        },
        extensions: Some(unlit),
        ..Default::default()
    });
    let primitive = mesh::Primitive {
        attributes,
        extensions: None,
        extras: None,
        indices,
        material: Some(material),
        mode: Checked::Valid(mesh::Mode::Triangles),
        targets: None,
    };
    Ok(root.push(json::Mesh {
        extensions: None,
        extras: raw(&options.mesh_extras)?,
        name: Some(mesh.name.into()),
        primitives: vec![primitive],
        weights: None,
    }))
}

fn push_accessor(
    root: &mut json::Root,
    mesh: &ExportMesh<'_>,
    view: &View,
    buffer: Index<json::Buffer>,
) -> Index<json::Accessor> {
    let is_index = matches!(view.content, Content::IndicesU16 | Content::IndicesU32);
    let target = if is_index { buffer::Target::ElementArrayBuffer } else { buffer::Target::ArrayBuffer };
    let buffer_view = root.push(buffer::View {
        buffer,
        byte_length: USize64(view.bytes),
        byte_offset: Some(USize64(view.offset)),
        byte_stride: None,
        name: None,
        target: Some(Checked::Valid(target)),
        extensions: None,
        extras: None,
    });
    let (component, kind, _) = view.content.format();
    let (min, max) = if view.content == Content::Position { position_range(mesh) } else { (None, None) };
    root.push(json::Accessor {
        buffer_view: Some(buffer_view),
        byte_offset: None,
        count: USize64(view.count),
        component_type: Checked::Valid(accessor::GenericComponentType(component)),
        extensions: None,
        extras: None,
        type_: Checked::Valid(kind),
        min,
        max,
        name: None,
        normalized: view.content == Content::ColourU16,
        sparse: None,
    })
}

/// Smallest and largest `POSITION` as stored: exact, because every f32 is a JSON number.
fn position_range(mesh: &ExportMesh<'_>) -> (Option<Value>, Option<Value>) {
    let centre = mesh.centre_in_world();
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for v in 0..mesh.positions.len() {
        let p = mesh.positions.from_centre(v, centre);
        (low, high) = (low.min(p), high.max(p));
    }
    (Some(json!(low.to_array().map(f64::from))), Some(json!(high.to_array().map(f64::from))))
}

/// The node: translation ∘ up-rotation ∘ scale, so that node · `POSITION` =
/// rotation · scale · world.
fn node(mesh: &ExportMesh<'_>, options: &GltfOptions, mesh_index: Option<Index<json::Mesh>>) -> Result<json::Node> {
    let scale = options.scale.unwrap_or_else(|| scale(mesh));
    if !(scale > 0.0 && (scale as f32).is_normal()) {
        return Err(Error::argument(
            "scale",
            scale,
            format!("a number from {:e} to {:e}", f32::MIN_POSITIVE, f32::MAX),
            "give --scale so that the object becomes about 1 in size",
        ));
    }
    let centre = mesh.centre_in_world();
    let rotation = mesh.up.gltf_from_world();
    let translation = (rotation * (centre * scale)).as_vec3();
    if !translation.is_finite() {
        return Err(Error::argument(
            "mesh place",
            centre * scale,
            "a place within 3.4e38 metres of the origin",
            "give a smaller --scale",
        ));
    }
    let extras = json!({
        "up": mesh.up.name(),
        "front": if mesh.up.is_anatomical() { "anterior" } else { "grid" },
        "scale": scale,
        "metres_per_unit": mesh.metres_per_unit,
        "centre_in_world": centre.to_array(),
    });
    // A quarter turn has components of sqrt(1/2): exact to f32 rounding.
    let turn = DQuat::from_mat3(&rotation).normalize().as_quat().to_array();
    Ok(json::Node {
        camera: None,
        children: None,
        extensions: None,
        extras: raw(&extras)?,
        matrix: None,
        mesh: mesh_index,
        name: Some(mesh.name.into()),
        rotation: (mesh.up != crate::geom::Up::Y).then_some(scene::UnitQuaternion(turn)),
        scale: (scale != 1.0).then_some([scale as f32; 3]),
        translation: (centre != DVec3::ZERO).then_some(translation.to_array()),
        skin: None,
        weights: None,
    })
}

/// JSON as the crate keeps extras; null is left out.
fn raw(value: &Value) -> Result<Option<Box<RawValue>>> {
    if value.is_null() {
        return Ok(None);
    }
    RawValue::from_string(value.to_string()).map(Some).map_err(serialization_error)
}

fn serialization_error(error: serde_json::Error) -> Error {
    Error::argument("provenance", error, "a JSON value", "report this: it should not happen")
}
