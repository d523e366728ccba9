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
//! * [`GltfOptions::for_web`] makes a file of a quarter of the bytes (`web`), [`Texture`] puts the colours into a picture in the file.
//! * A surface without triangles is a file with a node and no mesh: accessors cannot be empty.

mod layout;
mod web;

use super::{ExportMesh, write_error};
use crate::error::{Error, Result};
use crate::geom::Bounds;
use ::gltf::json::validation::{Checked, USize64};
use ::gltf::json::{self, Index, accessor, buffer, extensions, extras::RawValue, material, mesh, scene};
use glam::{DQuat, DVec3, Vec3};
use layout::{Content, Layout, View, write_view};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use web::Packed;

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
    /// Whether the file is made small, for readers that have `KHR_mesh_quantization` and `EXT_meshopt_compression`: three.js,
    /// Babylon.js and what is built on them. Positions are rounded to 16 bits ([`position_error`]), normals left out unless there
    /// are [`GltfOptions::scalars`], colours as without it, vertices and triangles in another order.
    pub for_web: bool,
    /// A picture in the place of `COLOR_0`.
    pub texture: Option<Texture>,
}

impl GltfOptions {
    /// The same without what belongs to vertices.
    fn without_attributes(&self) -> Self {
        Self {
            generator: self.generator.clone(),
            copyright: self.copyright.clone(),
            provenance: self.provenance.clone(),
            scalars: Vec::new(),
            mesh_extras: self.mesh_extras.clone(),
            texture: None,
            ..*self
        }
    }
}

/// A picture of the colours, in sRGB, for readers that drop `COLOR_0`.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Where each vertex lies in it: from the left and from the top, in [0, 1].
    pub coordinates: Vec<[f32; 2]>,
    /// The bytes of a PNG file.
    pub png: Vec<u8>,
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
            for_web: false,
            texture: None,
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

/// How far positions of a file with [`GltfOptions::for_web`] are off at most, in world units: half the diagonal of a cell of the
/// lattice that they are rounded to, which is shared by all surfaces of one box.
pub fn position_error(mesh: &ExportMesh<'_>) -> f64 {
    web::Lattice::new(mesh).largest_error()
}

/// Writes a mesh as GLB.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`Error::Argument`] for a scale that is not positive or
/// not normal in f32, or a place beyond f32, or for the web where the crate was built without the feature `meshopt`;
/// [`Error::Limit`] above 4 GiB, the most a GLB can hold; [`Error::Io`] (path empty) from the stream.
pub fn write(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>, options: &GltfOptions) -> Result<()> {
    mesh.check()?;
    check_scalars(mesh, &options.scalars)?;
    check_texture(mesh, options.texture.as_ref())?;
    if !options.for_web {
        return write_chunks(w, mesh, options, &Layout::new(mesh, options), None);
    }
    let order = web::order(mesh)?;
    let attributes = order.attributes(mesh);
    let mesh = &attributes.mesh(mesh);
    let texture = options.texture.as_ref();
    let texture = texture.map(|t| Texture { coordinates: order.of(&t.coordinates), png: t.png.clone() });
    let options = &GltfOptions { scalars: order.of_scalars(&options.scalars), texture, ..options.without_attributes() };
    let layout = Layout::new(mesh, options);
    let packed = web::pack(mesh, options, &layout)?;
    write_chunks(w, mesh, options, &layout, Some(&packed))
}

fn write_chunks(
    w: &mut (impl Write + ?Sized),
    mesh: &ExportMesh<'_>,
    options: &GltfOptions,
    layout: &Layout,
    packed: Option<&Packed>,
) -> Result<()> {
    let mut text = document(mesh, options, layout, packed)?.into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');

    let binary = packed.map_or(layout.bytes, |packed| packed.bytes.len() as u64).next_multiple_of(4);
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
    match packed {
        Some(packed) => w.write_all(&packed.bytes).map_err(write_error),
        None => layout.views.iter().try_for_each(|view| write_view(w, mesh, options, None, view)),
    }
}

pub(super) fn check_texture(mesh: &ExportMesh<'_>, texture: Option<&Texture>) -> Result<()> {
    let Some(texture) = texture else { return Ok(()) };
    let count = mesh.positions.len();
    let inside = texture.coordinates.iter().flatten().all(|c| (0.0..=1.0).contains(c));
    if inside && texture.coordinates.len() == count {
        return Ok(());
    }
    let given =
        format!("{} places{}", texture.coordinates.len(), if inside { "" } else { ", some outside the picture" });
    let expected = format!("{count} places in [0, 1], one to a vertex");
    Err(Error::argument("texture coordinates", given, expected, "pass those of the same mesh"))
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

/// The JSON chunk.
fn document(mesh: &ExportMesh<'_>, options: &GltfOptions, layout: &Layout, packed: Option<&Packed>) -> Result<String> {
    let mut root = json::Root {
        asset: json::Asset {
            generator: Some(options.generator.clone()),
            copyright: options.copyright.clone(),
            extras: raw(&options.provenance)?,
            ..Default::default()
        },
        ..Default::default()
    };
    let mesh_index = (!mesh.is_empty()).then(|| push_mesh(&mut root, mesh, options, layout, packed)).transpose()?;
    let node = node(mesh, options, layout.lattice.as_ref(), mesh_index)?;
    let node = root.push(node);
    root.scene = Some(root.push(json::Scene { extensions: None, extras: None, name: None, nodes: vec![node] }));
    json::serialize::to_string(&root).map_err(serialization_error)
}

fn push_mesh(
    root: &mut json::Root,
    mesh: &ExportMesh<'_>,
    options: &GltfOptions,
    layout: &Layout,
    packed: Option<&Packed>,
) -> Result<Index<json::Mesh>> {
    let buffer = root.push(json::Buffer {
        byte_length: USize64(packed.map_or(layout.bytes, |packed| packed.bytes.len() as u64)),
        name: None,
        uri: None,
        extensions: None,
        extras: None,
    });
    let unpacked = packed.map(|_| web::push_unpacked(root, layout.bytes));
    let mut attributes = BTreeMap::new();
    let (mut indices, mut texture) = (None, None);
    for (number, view) in layout.views.iter().enumerate() {
        let stream = packed.and_then(|packed| packed.streams[number].as_ref());
        let buffer_view = match (stream, unpacked, packed) {
            (Some(stream), Some(unpacked), _) => root.push(web::view(view, stream, unpacked, buffer)),
            (_, _, Some(packed)) => root.push(plain_view(view, packed.plain_offset(view), buffer)),
            _ => root.push(plain_view(view, view.offset, buffer)),
        };
        if view.content == Content::Picture {
            texture = Some(push_texture(root, buffer_view));
            continue;
        }
        let accessor = root.push(accessor(mesh, layout, view, buffer_view));
        match view.content.semantic(&options.scalars) {
            Some(semantic) => {
                attributes.insert(Checked::Valid(semantic), accessor);
            }
            None => indices = Some(accessor),
        }
    }
    let unlit = extensions::material::Material { unlit: Some(extensions::material::Unlit {}), ..Default::default() };
    root.extensions_used.push("KHR_materials_unlit".into());
    let material = root.push(json::Material {
        double_sided: options.double_sided,
        pbr_metallic_roughness: material::PbrMetallicRoughness {
            base_color_factor: material::PbrBaseColorFactor([1.0; 4]),
            base_color_texture: texture.map(|index| json::texture::Info {
                index,
                tex_coord: 0,
                extensions: None,
                extras: None,
            }),
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

/// A view of what is stored as it is.
fn plain_view(view: &View, offset: u64, buffer: Index<json::Buffer>) -> buffer::View {
    let target =
        if view.content.is_indices() { buffer::Target::ElementArrayBuffer } else { buffer::Target::ArrayBuffer };
    buffer::View {
        buffer,
        byte_length: USize64(view.bytes),
        byte_offset: Some(USize64(offset)),
        byte_stride: view.content.is_padded().then_some(buffer::Stride(view.content.format().2 as usize)),
        name: None,
        target: (view.content != Content::Picture).then_some(Checked::Valid(target)),
        extensions: None,
        extras: None,
    }
}

/// A picture as the texture of a material: between its texels linear, at its border the border, and no smaller copies of it,
/// in which texels of other charts would mix.
fn push_texture(root: &mut json::Root, view: Index<buffer::View>) -> Index<json::Texture> {
    use ::gltf::json::texture::{MagFilter, MinFilter, Sampler, WrappingMode};
    let source = root.push(json::Image {
        buffer_view: Some(view),
        mime_type: Some(json::image::MimeType("image/png".into())),
        name: None,
        uri: None,
        extensions: None,
        extras: None,
    });
    let sampler = root.push(Sampler {
        mag_filter: Some(Checked::Valid(MagFilter::Linear)),
        min_filter: Some(Checked::Valid(MinFilter::Linear)),
        wrap_s: Checked::Valid(WrappingMode::ClampToEdge),
        wrap_t: Checked::Valid(WrappingMode::ClampToEdge),
        ..Default::default()
    });
    root.push(json::Texture { name: None, sampler: Some(sampler), source, extensions: None, extras: None })
}

fn accessor(mesh: &ExportMesh<'_>, layout: &Layout, view: &View, buffer_view: Index<buffer::View>) -> json::Accessor {
    let (component, kind, _) = view.content.format();
    let (min, max) = match (view.content, &layout.lattice) {
        (Content::Position, _) => position_range(mesh),
        (Content::PositionU16, Some(lattice)) => lattice.range(mesh),
        _ => (None, None),
    };
    json::Accessor {
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
        normalized: view.content.is_normalised(),
        sparse: None,
    }
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

/// The scale of a file: what is given, or as [`scale`]; refused where it, or what a step of positions becomes by it, is none in
/// 32 bits.
pub(super) fn checked_scale(mesh: &ExportMesh<'_>, given: Option<f64>, step: f64) -> Result<f64> {
    let scale = given.unwrap_or_else(|| scale(mesh));
    let is_normal = |v: f64| v > 0.0 && (v as f32).is_normal();
    if is_normal(scale) && is_normal(scale * step) {
        return Ok(scale);
    }
    Err(Error::argument(
        "scale",
        scale,
        format!("a number from {:e} to {:e}", f32::MIN_POSITIVE, f32::MAX),
        "give --scale so that the object becomes about 1 in size",
    ))
}

/// The node: translation ∘ up-rotation ∘ scale, so that node · `POSITION` =
/// rotation · scale · world. Positions on a lattice begin at its corner, in steps of it.
fn node(
    mesh: &ExportMesh<'_>,
    options: &GltfOptions,
    lattice: Option<&web::Lattice>,
    mesh_index: Option<Index<json::Mesh>>,
) -> Result<json::Node> {
    let scale = checked_scale(mesh, options.scale, lattice.map_or(1.0, web::Lattice::step))?;
    let centre = mesh.centre_in_world();
    let rotation = mesh.up.gltf_from_world();
    let origin = lattice.map_or(centre, |lattice| centre + lattice.corner());
    let translation = (rotation * (origin * scale)).as_vec3();
    if !translation.is_finite() {
        return Err(Error::argument(
            "mesh place",
            origin * scale,
            "a place within 3.4e38 metres of the origin",
            "give a smaller --scale",
        ));
    }
    let mut extras = json!({
        "up": mesh.up.name(),
        "front": if mesh.up.is_anatomical() { "anterior" } else { "grid" },
        "scale": scale,
        "metres_per_unit": mesh.metres_per_unit,
        "centre_in_world": centre.to_array(),
    });
    let step = lattice.map_or(1.0, web::Lattice::step);
    if let Some(lattice) = lattice {
        extras["positions"] =
            json!({ "corner_in_world": origin.to_array(), "step": step, "largest_error": lattice.largest_error() });
    }
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
        scale: (scale * step != 1.0).then_some([(scale * step) as f32; 3]),
        translation: (origin != DVec3::ZERO).then_some(translation.to_array()),
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
