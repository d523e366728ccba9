//! Points, directions, normals, frames, bounds, affine maps. Knows nothing of anything else.
//!
//! # Spaces
//! * **grid**: continuous voxel index, (0, 0, 0) at the centre of the first sample.
//! * **world**: the file's physical frame and units, reached through an affine `world_from_grid`.
//!   Anisotropic, oblique and left-handed affines are legal. NIfTI world is RAS+.
//! * **glTF**: Y-up, right-handed; [`Up::gltf_from_world`] is the one place of that rotation.
//!   Environments live in this frame too.
//!
//! A variable's name carries its space (`hit_in_world`); a map's name carries both
//! (`world_from_grid`), so that in a product of maps the inner names meet.
//!
//! A gradient is a covector: it transforms by the inverse transpose
//! ([`Affine::gradient_matrix`]).

use glam::{DMat3, DVec3, Mat3, Vec3};

/// An invertible affine map of 3-space, stored with its inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    // Invariant: finite, determinant not 0, `inverse` is the inverse of `linear`.
    linear: DMat3,
    inverse: DMat3,
    offset: DVec3,
}

impl Affine {
    /// The identity.
    pub const IDENTITY: Self = Self { linear: DMat3::IDENTITY, inverse: DMat3::IDENTITY, offset: DVec3::ZERO };

    /// The map p → `linear` p + `offset`; `None` if it is not finite or not invertible
    /// (relative to the product of its column lengths, so that any unit is fine).
    pub fn new(linear: DMat3, offset: DVec3) -> Option<Self> {
        let volume = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
        let inverse = linear.inverse();
        let usable = linear.is_finite()
            && offset.is_finite()
            && inverse.is_finite()
            && volume > 0.0
            && linear.determinant().abs() > 1e-12 * volume;
        usable.then_some(Self { linear, inverse, offset })
    }

    /// Scaling by `spacing` along each axis, then translation to `origin`.
    pub fn from_spacing(spacing: DVec3, origin: DVec3) -> Option<Self> {
        Self::new(DMat3::from_diagonal(spacing), origin)
    }

    /// Image of a point.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.linear * p + self.offset
    }

    /// Image of a displacement.
    pub fn vector(&self, v: DVec3) -> DVec3 {
        self.linear * v
    }

    /// The inverse map.
    pub fn inverse(&self) -> Self {
        Self { linear: self.inverse, inverse: self.linear, offset: -(self.inverse * self.offset) }
    }

    /// The linear part.
    pub fn linear(&self) -> DMat3 {
        self.linear
    }

    /// The image of the origin.
    pub fn offset(&self) -> DVec3 {
        self.offset
    }

    /// Length of the image of each unit step: the voxel spacing for `world_from_grid`.
    pub fn spacing(&self) -> DVec3 {
        DVec3::new(self.linear.x_axis.length(), self.linear.y_axis.length(), self.linear.z_axis.length())
    }

    /// Whether the map turns a right-handed frame into a left-handed one.
    pub fn is_left_handed(&self) -> bool {
        self.linear.determinant() < 0.0
    }

    /// The matrix that takes gradients (covectors) through this map: the inverse transpose.
    pub fn gradient_matrix(&self) -> Mat3 {
        self.inverse.transpose().as_mat3()
    }
}

/// A unit vector: where light comes from or goes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction(Vec3); // Invariant: length 1 within rounding.

impl Direction {
    /// Normalises `v`; `None` for zero, subnormal-short or non-finite vectors. Any magnitude
    /// works: the vector is scaled by its largest component first.
    pub fn new(v: Vec3) -> Option<Self> {
        let largest = v.abs().max_element();
        if !(largest.is_finite() && largest > f32::MIN_POSITIVE) {
            return None;
        }
        let scaled = v / largest;
        Some(Self(scaled / scaled.length()))
    }

    /// Wraps a vector that is unit by construction.
    pub fn from_unit(v: Vec3) -> Self {
        debug_assert!((v.length_squared() - 1.0).abs() < 1e-4, "not a unit vector: {v}");
        Self(v)
    }

    /// The vector.
    pub fn vec(self) -> Vec3 {
        self.0
    }
}

/// A unit surface normal. A normal comes from a gradient (a covector), never from a displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normal(Vec3); // Invariant: length 1 within rounding.

impl Normal {
    /// The normal that points *down* a gradient given in world coordinates, n = −g/‖g‖;
    /// `None` where the gradient vanishes.
    pub fn down_gradient(gradient_in_world: Vec3) -> Option<Self> {
        Direction::new(-gradient_in_world).map(|d| Self(d.0))
    }

    /// The vector.
    pub fn vec(self) -> Vec3 {
        self.0
    }
}

/// A right-handed orthonormal frame around a unit vector, without branches on its direction
/// except the sign of z (Duff et al. 2017, "Building an Orthonormal Basis, Revisited", JCGT 6(1)).
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// First tangent.
    pub tangent: Vec3,
    /// Second tangent.
    pub bitangent: Vec3,
    /// The unit vector itself.
    pub normal: Vec3,
}

impl Frame {
    /// The frame around `normal`.
    pub fn around(normal: Normal) -> Self {
        let n = normal.vec();
        let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            bitangent: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            normal: n,
        }
    }

    /// Local coordinates (tangent, bitangent, normal) to the space of the frame.
    pub fn from_local(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: DVec3,
    /// Largest corner.
    pub max: DVec3,
}

impl Bounds {
    /// The box that contains nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box around this one and `p`.
    #[must_use]
    #[doc(hidden)]
    pub fn including(self, p: DVec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Centre of the box.
    pub fn centre(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// Side lengths.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }
}

/// How world stands in the Y-up frame of glTF: the axis that points up, and what is the front.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// +x
    X,
    /// +y
    Y,
    /// +z, the default: scientific data.
    #[default]
    Z,
    /// −x
    NegX,
    /// −y
    NegY,
    /// −z
    NegZ,
    /// +z of a patient's frame, RAS+ (x right, y anterior, z superior): anterior is the front.
    Anatomical,
}

impl Up {
    /// The rotation from world axes to the Y-up, right-handed frame of glTF and of environments.
    /// For z it is (x, y, z) → (x, z, −y); for the other axes the rotation by a quarter or half
    /// turn that takes the axis to +Y. For a patient's frame it is (x, y, z) → (−x, z, y):
    /// anterior is +Z, which cameras see from the front, and the patient's left +X.
    #[doc(hidden)]
    pub fn gltf_from_world(self) -> DMat3 {
        // Rows written as the images of (x, y, z); `from_cols` takes the transpose.
        let rows = match self {
            Self::X => [[0., -1., 0.], [1., 0., 0.], [0., 0., 1.]],
            Self::Y => [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]],
            Self::Z => [[1., 0., 0.], [0., 0., 1.], [0., -1., 0.]],
            Self::NegX => [[0., 1., 0.], [-1., 0., 0.], [0., 0., 1.]],
            Self::NegY => [[1., 0., 0.], [0., -1., 0.], [0., 0., -1.]],
            Self::NegZ => [[1., 0., 0.], [0., 0., -1.], [0., 1., 0.]],
            Self::Anatomical => [[-1., 0., 0.], [0., 0., 1.], [0., 1., 0.]],
        };
        DMat3::from_cols_array_2d(&rows).transpose()
    }

    /// The axis itself.
    pub fn axis(self) -> DVec3 {
        self.gltf_from_world().transpose() * DVec3::Y
    }

    /// The axis of a name: x, y, z, -x, -y, -z.
    pub fn named(name: &str) -> Option<Self> {
        [Self::X, Self::Y, Self::Z, Self::NegX, Self::NegY, Self::NegZ].into_iter().find(|up| up.name() == name)
    }

    /// Whether the front is a patient's.
    pub fn is_anatomical(self) -> bool {
        self == Self::Anatomical
    }

    /// The name of the axis, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z | Self::Anatomical => "z",
            Self::NegX => "-x",
            Self::NegY => "-y",
            Self::NegZ => "-z",
        }
    }
}

/// The octahedral map of a direction onto the square [−1, 1]² (Meyer et al. 2010, "On floating-point normal vectors").
pub(crate) fn octahedral_from_direction(v: Vec3) -> [f32; 2] {
    let flat = v / (v.x.abs() + v.y.abs() + v.z.abs());
    match v.z < 0.0 {
        true => [(1.0 - flat.y.abs()) * one_with_sign(flat.x), (1.0 - flat.x.abs()) * one_with_sign(flat.y)],
        false => [flat.x, flat.y],
    }
}

/// The inverse of [`octahedral_from_direction`], of unit length.
pub(crate) fn direction_from_octahedral([x, y]: [f32; 2]) -> Vec3 {
    let z = 1.0 - x.abs() - y.abs();
    let folded = match z < 0.0 {
        true => Vec3::new((1.0 - y.abs()) * one_with_sign(x), (1.0 - x.abs()) * one_with_sign(y), z),
        false => Vec3::new(x, y, z),
    };
    folded.normalize()
}

/// +1 for 0, unlike a sign that has three values.
fn one_with_sign(t: f32) -> f32 {
    if t < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests;
