//! What stands in the binary chunk of a GLB, and in which form.

use super::web::Lattice;
use super::{ColourFormat, GltfOptions, Scalars};
use crate::error::Result;
use crate::export::{ExportMesh, StandardError, bytes_of_triple, write_error, write_records};
use ::gltf::json::{accessor, mesh};
use std::io::Write;

/// Largest vertex count with 16-bit indices: 65,535 is the primitive restart value, so 65,534 is
/// the last index.
const MOST_U16_VERTICES: usize = 65_535;

/// What a buffer view holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Position,
    /// On the lattice of [`Layout::lattice`], with two bytes of padding.
    PositionU16,
    Normal,
    /// Normalised, with two bytes of padding.
    NormalI16,
    ColourU16,
    ColourF32,
    Radiance,
    StderrGrey,
    StderrRgb,
    /// Entry of [`GltfOptions::scalars`].
    Scalars(usize),
    Coordinates,
    /// Normalised.
    CoordinatesU16,
    IndicesU16,
    IndicesU32,
    /// A file in the file: it has no accessor.
    Picture,
}

impl Content {
    /// Component type, type, bytes from element to element.
    pub(super) fn format(self) -> (accessor::ComponentType, accessor::Type, u64) {
        use accessor::{ComponentType as C, Type as T};
        match self {
            Self::Position | Self::Normal | Self::ColourF32 | Self::Radiance | Self::StderrRgb => (C::F32, T::Vec3, 12),
            Self::PositionU16 => (C::U16, T::Vec3, 8),
            Self::NormalI16 => (C::I16, T::Vec3, 8),
            Self::ColourU16 => (C::U16, T::Vec4, 8),
            Self::Coordinates => (C::F32, T::Vec2, 8),
            Self::CoordinatesU16 => (C::U16, T::Vec2, 4),
            Self::StderrGrey | Self::Scalars(_) => (C::F32, T::Scalar, 4),
            Self::IndicesU16 => (C::U16, T::Scalar, 2),
            Self::IndicesU32 => (C::U32, T::Scalar, 4),
            Self::Picture => (C::U8, T::Scalar, 1),
        }
    }

    /// Whether elements are longer than what they hold.
    pub(super) fn is_padded(self) -> bool {
        matches!(self, Self::PositionU16 | Self::NormalI16)
    }

    /// Whether integers stand for numbers in [0, 1] or [-1, 1].
    pub(super) fn is_normalised(self) -> bool {
        matches!(self, Self::NormalI16 | Self::ColourU16 | Self::CoordinatesU16)
    }

    pub(super) fn is_indices(self) -> bool {
        matches!(self, Self::IndicesU16 | Self::IndicesU32)
    }

    /// The attribute it is; `None` for indices and pictures.
    pub(super) fn semantic(self, scalars: &[Scalars]) -> Option<mesh::Semantic> {
        match self {
            Self::Position | Self::PositionU16 => Some(mesh::Semantic::Positions),
            Self::Normal | Self::NormalI16 => Some(mesh::Semantic::Normals),
            Self::ColourU16 | Self::ColourF32 => Some(mesh::Semantic::Colors(0)),
            // The crate writes the underscore.
            Self::Radiance => Some(mesh::Semantic::Extras("RADIANCE".into())),
            Self::StderrGrey | Self::StderrRgb => Some(mesh::Semantic::Extras("STDERR".into())),
            Self::Scalars(i) => Some(mesh::Semantic::Extras(scalars[i].name.clone())),
            Self::Coordinates | Self::CoordinatesU16 => Some(mesh::Semantic::TexCoords(0)),
            Self::IndicesU16 | Self::IndicesU32 | Self::Picture => None,
        }
    }
}

pub(super) struct View {
    pub(super) content: Content,
    pub(super) count: u64,
    // Invariant: a multiple of 4.
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Where everything stands in the binary chunk; of a compressed file, in what is decompressed.
pub(super) struct Layout {
    pub(super) views: Vec<View>,
    // Without the padding of the last view.
    pub(super) bytes: u64,
    /// That positions are rounded to, if they are.
    pub(super) lattice: Option<Lattice>,
}

impl Layout {
    pub(super) fn new(mesh: &ExportMesh<'_>, options: &GltfOptions) -> Self {
        let mut layout = Self { views: Vec::new(), bytes: 0, lattice: None };
        if mesh.is_empty() {
            return layout;
        }
        let vertices = mesh.positions.len();
        if options.for_web {
            layout.lattice = Some(Lattice::new(mesh));
            layout.push(Content::PositionU16, vertices);
            // Nothing is shaded; who relights needs them.
            if !options.scalars.is_empty() {
                layout.push(Content::NormalI16, vertices);
            }
        } else {
            layout.push(Content::Position, vertices);
            layout.push(Content::Normal, vertices);
        }
        match (&options.texture, options.colour_format) {
            (Some(_), _) if options.for_web => layout.push(Content::CoordinatesU16, vertices),
            (Some(_), _) => layout.push(Content::Coordinates, vertices),
            (None, ColourFormat::U16) => layout.push(Content::ColourU16, vertices),
            (None, ColourFormat::F32) => layout.push(Content::ColourF32, vertices),
        }
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
        if let Some(texture) = &options.texture {
            layout.push(Content::Picture, texture.png.len());
        }
        layout
    }

    fn push(&mut self, content: Content, count: usize) {
        let (count, offset) = (count as u64, self.bytes.next_multiple_of(4));
        let bytes = count * content.format().2;
        self.views.push(View { content, count, offset, bytes });
        self.bytes = offset + bytes;
    }
}

/// Writes what a view holds, padded to a multiple of 4 bytes.
pub(super) fn write_view(
    w: &mut (impl Write + ?Sized),
    mesh: &ExportMesh<'_>,
    options: &GltfOptions,
    lattice: Option<&Lattice>,
    view: &View,
) -> Result<()> {
    let vertices = mesh.positions.len();
    let centre = mesh.centre_in_world();
    let triangles = mesh.triangles;
    match view.content {
        Content::Position => {
            write_records(w, vertices, |v| bytes_of_triple(mesh.positions.from_centre(v, centre).to_array()))
        }
        Content::PositionU16 => {
            let Some(lattice) = lattice else { return Ok(()) };
            write_records(w, vertices, |v| {
                let [x, y, z] = lattice.snap(mesh.positions.from_centre(v, centre)).map(u16::to_le_bytes);
                [x[0], x[1], y[0], y[1], z[0], z[1], 0, 0]
            })
        }
        Content::NormalI16 => write_records(w, vertices, |v| {
            let [x, y, z] = mesh.unit_normal(v).to_array().map(|n| ((n * 32_767.0).round() as i16).to_le_bytes());
            [x[0], x[1], y[0], y[1], z[0], z[1], 0, 0]
        }),
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
        Content::Scalars(i) => write_records(w, vertices, |v| options.scalars[i].values[v].to_le_bytes()),
        Content::IndicesU32 => write_records(w, triangles.len(), |t| {
            let [a, b, c] = triangles[t].map(u32::to_le_bytes);
            [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], c[0], c[1], c[2], c[3]]
        }),
        Content::IndicesU16 => {
            write_records(w, triangles.len(), |t| {
                let [a, b, c] = triangles[t].map(|i| (i as u16).to_le_bytes());
                [a[0], a[1], b[0], b[1], c[0], c[1]]
            })?;
            pad(w, view.bytes)
        }
        Content::Coordinates | Content::CoordinatesU16 | Content::Picture => {
            let Some(texture) = &options.texture else { return Ok(()) };
            let all = &texture.coordinates;
            match view.content {
                Content::Coordinates => write_records(w, all.len(), |v| {
                    let [s, t] = all[v].map(f32::to_le_bytes);
                    [s[0], s[1], s[2], s[3], t[0], t[1], t[2], t[3]]
                }),
                Content::CoordinatesU16 => write_records(w, all.len(), |v| {
                    let [s, t] = all[v].map(|x| ((x * 65_535.0 + 0.5) as u16).to_le_bytes());
                    [s[0], s[1], t[0], t[1]]
                }),
                _ => {
                    w.write_all(&texture.png).map_err(write_error)?;
                    pad(w, view.bytes)
                }
            }
        }
    }
}

fn pad(w: &mut (impl Write + ?Sized), bytes: u64) -> Result<()> {
    w.write_all(&[0; 3][..(bytes.next_multiple_of(4) - bytes) as usize]).map_err(write_error)
}
