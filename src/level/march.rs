//! The ray as a march through integer cells and blocks.
//!
//! The parameter at a grid plane is computed from the plane and the start each time, never
//! accumulated, and planes are passed in the order of (parameter, axis). So a ray visits a connected
//! chain of cells, whatever rounding does, values at the shared faces agree in sign up to the sign
//! carry, and a block that holds nothing is left into the very cell that a march through all its
//! cells would come to: the pyramid changes no bit of a hit.
//!
//! Each axis is looked at along the ray, mirrored where the ray falls: planes are counted from the
//! start cell in the direction of travel, so that they rise along every axis. Negation is exact, so this
//! changes no bit either, and the three axes are three lanes of one vector without a branch among
//! them. The fourth lane is an axis whose planes are never met.

use super::CellPoint;
use super::pyramid::BLOCK_SHIFT;
use glam::{BVec4A, IVec3, Vec3, Vec4, Vec4Swizzles};

/// A component of a direction below this part of the largest is 0. Over any grid it amounts to
/// nothing, and its inverse times the size of any grid is still a number.
const PARALLEL: f32 = 1.0 / (1u128 << 100) as f32;

/// Cells along the side of the smallest blocks.
const SIDE: f32 = (1 << BLOCK_SHIFT) as f32;

/// 1.5·2²³: a number below 2²² in size added to it is rounded to a whole one, which stands in the low bits.
const WHOLE: f32 = 12_582_912.0;

const X: BVec4A = BVec4A::new(true, false, false, false);
const XY: BVec4A = BVec4A::new(true, true, false, false);

/// One axis or none, as a mask of lanes.
pub(super) type Axis = BVec4A;

/// The axis of the plane that comes first; in a tie x before y before z.
#[inline(always)]
pub(super) fn first(far: Vec4) -> Axis {
    let (one, other) = (far.yxxw(), far.zzyw());
    (far.cmplt(one) | (far.cmple(one) & X)) & (far.cmplt(other) | (far.cmple(other) & XY))
}

/// What is added to an index for a ray's step along an axis; for none it is 0, which saves a branch.
pub(super) struct Steps([usize; 8]);

impl Steps {
    /// For rays of an octant (bit a set: falling along axis a), given the strides of the index.
    #[inline(always)]
    pub(super) fn new(strides: [usize; 3], octant: usize) -> Self {
        let signed = |a: usize| if octant >> a & 1 == 1 { strides[a].wrapping_neg() } else { strides[a] };
        Self([0, signed(0), signed(1), 0, signed(2), 0, 0, 0])
    }

    /// One step along the axis, or none.
    #[inline(always)]
    pub(super) fn along(&self, axis: Axis) -> usize {
        // The bits are 0, 1, 2 or 4.
        self.0[(axis.bitmask() & 7) as usize]
    }

    /// So many steps along each axis.
    #[inline(always)]
    pub(super) fn times(&self, [x, y, z]: [i32; 3]) -> usize {
        let along = |bits: usize, count: i32| self.0[bits].wrapping_mul(count as usize);
        along(1, x).wrapping_add(along(2, y)).wrapping_add(along(4, z))
    }
}

/// The three whole numbers in a vector.
#[inline(always)]
fn whole(v: Vec4) -> [i32; 3] {
    let bits = |x: f32| (x + WHOLE).to_bits().wrapping_sub(WHOLE.to_bits()) as i32;
    [bits(v.x), bits(v.y), bits(v.z)]
}

/// A ray in grid space and the cell it is in. Parameters are measured from the start cell, so that
/// their precision does not fall with the size of the grid.
pub(super) struct March {
    start: IVec3,
    origin: Vec4,
    direction: Vec4,
    // ±1; 1 where the ray rises along the axis, else 0.
    step: Vec4,
    upper: Vec4,
    // The parameter of a plane p, counted along the ray, is (p − plane_origin)·inverse; for an axis whose
    // planes are never met these are −∞ and 1.
    plane_origin: Vec4,
    inverse: Vec4,
    // Where the box ends, and the planes where the block ends that the march is in, the former unclipped.
    border: Vec4,
    block: Vec4,
    edge: Vec4,
    // The far planes of the cell, their parameters, and those of the planes behind them.
    plane: Vec4,
    pub(super) far: Vec4,
    next: Vec4,
    // Where it entered the cell, and through which axis: none at the start.
    pub(super) entered_at: f32,
    entered: Axis,
}

impl March {
    #[inline(always)]
    pub(super) fn new(start: &CellPoint, direction: Vec3, dims: [usize; 3]) -> Self {
        let direction = direction.extend(0.0);
        // The largest component comes to [1, 2), by a power of two: exact, and no parameter overflows.
        let exponent = (direction.abs().max_element().to_bits() >> 23) as i32 - 127;
        let direction = direction * f32::from_bits(((127 - exponent.clamp(-126, 126)) as u32) << 23);
        // Not a number counts as 0 too.
        let parallel = !direction.abs().cmpge(Vec4::splat(PARALLEL));
        let direction = Vec4::select(parallel, Vec4::ZERO, direction);
        let backward = direction.cmplt(Vec4::ZERO);
        let step = Vec4::select(backward, Vec4::NEG_ONE, Vec4::ONE);
        let upper = Vec4::select(backward, Vec4::ZERO, Vec4::ONE);
        let origin = start.local.extend(0.0);
        // Small whole numbers: exact.
        let cell = start.cell.as_vec3().extend(0.0);
        let inner = (start.cell & IVec3::splat((1 << BLOCK_SHIFT) - 1)).as_vec3().extend(0.0);
        let end = Vec3::new((dims[0] - 1) as i32 as f32, (dims[1] - 1) as i32 as f32, (dims[2] - 1) as i32 as f32);
        let border = Vec4::select(backward, cell, end.extend(1.0) - cell);
        let block = Vec4::select(backward, inner, Vec4::splat(SIDE) - inner);
        let mut march = Self {
            start: start.cell,
            origin,
            direction,
            step,
            upper,
            plane_origin: Vec4::select(parallel, Vec4::NEG_INFINITY, origin * step),
            inverse: Vec4::select(parallel, Vec4::ONE, direction.recip().abs()),
            border,
            block,
            edge: block.min(border),
            plane: upper,
            far: Vec4::ZERO,
            next: Vec4::ZERO,
            entered_at: 0.0,
            entered: BVec4A::default(),
        };
        march.face_cell();
        march
    }

    /// 1 for each axis along which the ray falls, in bits 0, 1, 2.
    #[inline(always)]
    pub(super) fn octant(&self) -> usize {
        (self.step.cmplt(Vec4::ZERO).bitmask() & 7) as usize
    }

    /// The sizes of the components of the direction.
    #[inline(always)]
    pub(super) fn slope(&self) -> Vec3 {
        self.direction.abs().truncate()
    }

    /// Parameters at which the ray meets planes, counted along the ray.
    #[inline(always)]
    fn at_planes(&self, planes: Vec4) -> Vec4 {
        (planes - self.plane_origin) * self.inverse
    }

    /// Sets the parameters of the far planes of the cell.
    #[inline(always)]
    fn face_cell(&mut self) {
        self.far = self.at_planes(self.plane);
        self.next = self.at_planes(self.plane + Vec4::ONE);
    }

    /// The cell.
    #[inline(always)]
    pub(super) fn cell(&self) -> IVec3 {
        self.start + IVec3::from_array(whole(self.plane * self.step - self.upper))
    }

    /// How many planes it has passed along each axis.
    #[inline(always)]
    pub(super) fn passed(&self) -> [i32; 3] {
        whole(self.plane - self.upper)
    }

    /// Where in its cell the ray is at `t`, when it passes a plane of `axis` there; `face` is 1 on
    /// the upper plane.
    #[inline(always)]
    fn local(&self, t: f32, axis: Axis, face: Vec4) -> Vec3 {
        let cell = self.plane * self.step - self.upper;
        let local = (self.origin + self.direction * t - cell).clamp(Vec4::ZERO, Vec4::ONE);
        Vec4::select(axis, face, local).truncate()
    }

    /// Where it entered the cell.
    #[inline(always)]
    pub(super) fn entry(&self) -> Vec3 {
        if self.entered.bitmask() == 0 {
            return self.origin.truncate();
        }
        self.local(self.entered_at, self.entered, Vec4::ONE - self.upper)
    }

    /// Where it leaves the cell, through `axis` at `t`.
    #[inline(always)]
    pub(super) fn exit_at(&self, t: f32, axis: Axis) -> Vec3 {
        self.local(t, axis, self.upper)
    }

    /// Steps into the next cell through `axis` at `t`. Gives the axis if the cell is behind the edge of the block, else
    /// none.
    #[inline(always)]
    pub(super) fn cross(&mut self, t: f32, axis: Axis) -> Axis {
        let left = self.plane.cmpeq(self.edge) & axis;
        self.entered_at = t;
        self.entered = axis;
        self.far = Vec4::select(axis, self.next, self.far);
        self.plane += Vec4::select(axis, Vec4::ONE, Vec4::ZERO);
        self.next = self.at_planes(self.plane + Vec4::ONE);
        left
    }

    /// Goes on to the block behind the edge of `axis` that was just crossed, if any was; `false` behind the border of the
    /// box.
    #[inline(always)]
    pub(super) fn next_block(&mut self, axis: Axis) -> bool {
        if (self.edge.cmpeq(self.border) & axis).any() {
            return false;
        }
        self.block += Vec4::select(axis, Vec4::splat(SIDE), Vec4::ZERO);
        self.edge = self.block.min(self.border);
        true
    }

    /// Passes the block, and says through which axis. Leaves the cell behind; see [`Self::enter`].
    #[inline(always)]
    pub(super) fn cross_block(&mut self) -> Axis {
        let leave = self.at_planes(self.edge);
        self.entered_at = leave.min_element();
        self.entered = first(leave);
        self.entered
    }

    /// Takes up the march through cells where the block was entered.
    ///
    /// The cell is the one that a march through every cell would be in: along the other axes just those
    /// planes lie behind that come before (t, axis) in the order of [`first`].
    #[inline(always)]
    pub(super) fn enter(&mut self) {
        let (t, axis) = (self.entered_at, self.entered);
        let nearest = self.block - Vec4::splat(SIDE - 1.0);
        let least = nearest.max(self.upper);
        // An estimate by position, then made right; it is right but for rounding.
        let position = self.origin * self.step + self.direction.abs() * t;
        let floor = (position - Vec4::splat(0.5)) + Vec4::splat(WHOLE) - Vec4::splat(WHOLE);
        self.plane = Vec4::select(axis, nearest, (floor + Vec4::ONE).max(least).min(self.edge));
        let early = !self.before(self.plane - Vec4::ONE) & self.plane.cmpgt(least);
        let late = self.before(self.plane) & self.plane.cmplt(self.edge);
        if ((early | late) & !axis).bitmask() & 7 != 0 {
            self.correct(least);
        }
        self.face_cell();
    }

    /// Along which axes these planes come before the one where the block was entered.
    #[inline(always)]
    fn before(&self, planes: Vec4) -> BVec4A {
        let (at, t) = (self.at_planes(planes), Vec4::splat(self.entered_at));
        // The axes in front of `entered`: as bits, those below its own.
        let bit = self.entered.bitmask();
        let in_front = BVec4A::new(bit > 1, bit > 2, false, false);
        at.cmplt(t) | (at.cmpeq(t) & in_front)
    }

    #[cold]
    fn correct(&mut self, least: Vec4) {
        loop {
            let early = !self.before(self.plane - Vec4::ONE) & self.plane.cmpgt(least) & !self.entered;
            if early.bitmask() & 7 == 0 {
                break;
            }
            self.plane -= Vec4::select(early, Vec4::ONE, Vec4::ZERO);
        }
        loop {
            let late = self.before(self.plane) & self.plane.cmplt(self.edge) & !self.entered;
            if late.bitmask() & 7 == 0 {
                break;
            }
            self.plane += Vec4::select(late, Vec4::ONE, Vec4::ZERO);
        }
    }
}
