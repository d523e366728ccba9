use super::*;
use crate::grid3;
use glam::{IVec3, Vec3};

#[test]
fn a_layer_is_held_with_the_bands_that_later_ones_need() {
    let bands = |list: &[usize]| cached_layers(&Layers::new(list.to_vec()).unwrap()).map(|l| l.bands().to_vec());
    assert_eq!(bands(&[5, 4, 3, 3]), Some(vec![4, 3, 3]));
    assert_eq!(bands(&[2, 1, 5]), Some(vec![5, 5]));
    assert_eq!(bands(&[5]), None);
}

#[test]
fn spans_move_each_layer_to_the_next() {
    let layers = Layers::uniform(4, 5).unwrap();
    let cached = cached_layers(&layers).unwrap();
    assert_eq!(spans(&layers, &cached, 0), [Span { target: 25, source: 0, count: 75 }]);
    assert_eq!(spans(&layers, &cached, 2), [Span { target: 75, source: 0, count: 25 }]);
    assert_eq!(spans(&layers, &cached, 3), []);
    let falling = Layers::new(vec![3, 2, 1]).unwrap();
    let cached = cached_layers(&falling).unwrap();
    // T_0 of 2 bands to layer 1 at 9, T_1 of 1 band to layer 2 at 13.
    assert_eq!(spans(&falling, &cached, 0), [Span { target: 9, source: 0, count: 5 }]);
}

/// A cache of one coefficient whose value is linear in the texel's position, on a lattice twice as fine
/// as the grid.
fn linear(valid: impl Fn([usize; 3]) -> bool, precision: CachePrecision) -> Cache {
    let lattice = Lattice::from_ratio([9, 9, 9], 2.0).unwrap();
    let mut cache = Cache::new(&Selection::all(lattice), 1, precision);
    let mut values = cache.blank();
    let mut flags = vec![false; cache.valid().len()];
    for (slot, part) in values.parts(BRICK_TEXELS).iter_mut().enumerate() {
        for t in 0..BRICK_TEXELS {
            let inner = grid3::at([BRICK, BRICK], t);
            let texel: [usize; 3] = std::array::from_fn(|a| cache.bricks()[slot][a] * BRICK + inner[a]);
            if (0..3).all(|a| texel[a] < 17) && valid(texel) {
                flags[slot * BRICK_TEXELS + t] = true;
                part.store(t, &[(texel[0] + 2 * texel[1] + 4 * texel[2]) as f32]);
            }
        }
    }
    cache.replace_rows(&mut values, flags);
    cache
}

fn look_up(cache: &Cache, cell: [i32; 3], local: [f32; 3]) -> (Option<f32>, Lookups) {
    let at = CellPoint { cell: IVec3::from_array(cell), local: Vec3::from_array(local) };
    let span = [Span { target: 0, source: 0, count: 1 }];
    let (mut sum, mut lookups) = ([0.0f32], Lookups::default());
    let found = cache.add(&at, &span, &mut sum, &mut EMPTY_ROW.clone(), &mut lookups);
    (found.then_some(sum[0]), lookups)
}

#[test]
fn lookups_are_exact_on_linear_values_and_fall_back_by_the_rule() {
    for precision in [CachePrecision::Half, CachePrecision::Single] {
        let cache = linear(|_| true, precision);
        // Whole numbers below 2048 are exact in f16; binary fractions keep the sums exact.
        for (cell, local) in [([0, 0, 0], [0.0, 0.0, 0.0]), ([3, 4, 7], [0.25, 0.625, 1.0]), ([7, 7, 7], [1.0; 3])] {
            let p: [f32; 3] = std::array::from_fn(|a| 2.0 * (cell[a] as f32 + local[a]));
            let (value, lookups) = look_up(&cache, cell, local);
            assert_eq!(value, Some(p[0] + 2.0 * p[1] + 4.0 * p[2]));
            assert_eq!(lookups, Lookups { lookups: 1, ..Lookups::default() });
        }
        // Only the face x = 6 of the cell that holds texel coordinates (6.5, 0, 0) is valid.
        let half = linear(|t| t[0] <= 6, precision);
        let (value, lookups) = look_up(&half, [3, 0, 0], [0.25, 0.0, 0.0]);
        assert_eq!((value, lookups.renormalised), (Some(6.0), 1));
        // Texel coordinates (7.5, 0, 0): none of eight, but x = 6 of the 4³, y and z in 0…2.
        let (value, lookups) = look_up(&half, [3, 0, 0], [0.75, 0.0, 0.0]);
        assert_eq!((value.map(f32::round), lookups.neighbourhood), (Some(6.0 + 2.0 + 4.0), 1));
        // Texel coordinates (10, 0, 0): nothing near.
        let (value, lookups) = look_up(&half, [5, 0, 0], [0.0, 0.0, 0.0]);
        assert_eq!((value, lookups.continued), (None, 1));
    }
}
