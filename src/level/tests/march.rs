//! The march with the pyramid against a march through every cell: bit for bit.

use super::*;
use crate::level::trace::MAX_BURIED_CELLS;
use glam::Vec4;

/// The march from its definition: cell by cell through the plane that comes first (x before y
/// before z in a tie), the same arithmetic in each cell, nothing skipped.
pub(super) fn plain_trace<T: Sample>(field: &LevelField<'_, T>, c: f32, start: &Start, direction: Vec3) -> Outcome {
    let direction = as_traced(direction);
    let (origin, inverse) = (start.at.local, direction.recip());
    let forward = [0, 1, 2].map(|a| direction[a] >= 0.0);
    let mut cell = start.at.cell;
    let mut entry = origin;
    let mut entered_at = 0.0f32;
    let mut side = if start.on_surface { Carried::Start } else { Carried::Unknown };
    let mut buried = 0;
    loop {
        let meets = [0, 1, 2].map(|a| {
            let plane = cell[a] - start.at.cell[a] + i32::from(forward[a]);
            if direction[a] == 0.0 { f32::INFINITY } else { (plane as f32 - origin[a]) * inverse[a] }
        });
        let axis = (0..3).fold(0, |best, a| if meets[a] < meets[best] { a } else { best });
        let left_at = meets[axis];
        assert!(left_at >= entered_at, "the march went back");
        let here = origin + direction * left_at;
        let mut exit = (here - (cell - start.at.cell).as_vec3()).clamp(Vec3::ZERO, Vec3::ONE);
        exit[axis] = if forward[axis] { 1.0 } else { 0.0 };
        let (low, high) = field.corners(cell);
        let f = |v: [f32; 4]| (Vec4::from_array(v) - Vec4::splat(c)) * field.sign();
        let cubic = cell::along_segment(f(low), f(high), entry, exit);
        match side.through(cubic, left_at > entered_at) {
            Err(t) => {
                let local = (entry + (exit - entry) * t).clamp(Vec3::ZERO, Vec3::ONE);
                return Outcome::Hit(Hit { at: CellPoint { cell, local } });
            }
            Ok(next) => side = next,
        }
        if side == Carried::In && left_at > entered_at {
            buried += 1;
            if buried > MAX_BURIED_CELLS {
                return Outcome::Lost;
            }
        }
        cell[axis] += if forward[axis] { 1 } else { -1 };
        if cell[axis] < 0 || cell[axis] > field.dims()[axis] as i32 - 2 {
            return if side == Carried::In { Outcome::Lost } else { Outcome::Escaped };
        }
        entered_at = left_at;
        entry = (here - (cell - start.at.cell).as_vec3()).clamp(Vec3::ZERO, Vec3::ONE);
        entry[axis] = if forward[axis] { 0.0 } else { 1.0 };
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Carried {
    Start,
    Unknown,
    Out,
    In,
}

impl Carried {
    /// The side after a cell, or the parameter of a hit in it.
    fn through(self, mut cubic: cell::Cubic, moved: bool) -> Result<Self, f32> {
        let inside = match self {
            Self::Start if !moved => return Ok(Self::Start),
            Self::Start => {
                cubic = cell::deflate(cubic);
                cubic.into_iter().find(|&b| b != 0.0).is_some_and(|b| b > 0.0)
            }
            Self::Unknown => cubic[0] > 0.0,
            Self::Out => false,
            Self::In => true,
        };
        let mut offset = 0.0;
        if inside {
            let Some(t) = cell::first_rise(&cubic.map(|b| -b)).map(|b| b.root()) else { return Ok(Self::In) };
            cubic = cell::deflate(cell::right_part(cubic, t));
            offset = t;
        }
        cell::first_rise(&cubic).map_or(Ok(Self::Out), |b| Err(offset + (1.0 - offset) * b.root()))
    }
}

#[test]
fn skipping_blocks_changes_no_bit_of_any_outcome() {
    let mut kinds = [0u32; 3];
    for (seed, (name, volume)) in gallery().into_iter().enumerate() {
        with_field!(volume, field => {
            let mut counts = Counts::default();
            let all = directions();
            for item in 0..60_000u64 {
                let (start, c) = any_start(&field, seed as u64, item);
                let d = if item % 3 == 0 { all[item as usize / 3 % all.len()] } else { on_sphere(seed as u64, item) };
                let fast = field.trace(c, &start, d, &mut counts);
                let plain = plain_trace(&field, c, &start, d);
                assert_eq!(fast, plain, "{name}, item {item}: {start:?}, isovalue {c}, direction {d}");
                kinds[match fast {
                    Outcome::Escaped => 0,
                    Outcome::Hit(_) => 1,
                    Outcome::Lost => 2,
                }] += 1;
            }
        });
    }
    // The comparison is worth something only if all of them occur.
    assert!(kinds.iter().all(|&n| n > 50_000), "{kinds:?}");
}
