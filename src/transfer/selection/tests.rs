use super::*;
use crate::grid3;

#[test]
fn a_cell_adds_what_lookups_in_it_read_and_no_more() {
    let n = [14, 9, 3];
    for ratio in [0.3, 0.5, 2.0 / 3.0, 1.0, 1.7, 3.0] {
        let lattice = Lattice::from_ratio(n, ratio).unwrap();
        let m = lattice.texels();
        for cell in [[0, 0, 0], [5, 3, 1], [12, 7, 1], [7, 2, 0]] {
            let mut selection = Selection::empty(lattice);
            selection.insert_cell(cell);
            let mut read = Selection::empty(lattice);
            const STEPS: usize = 40;
            let grid = |i: usize, a: usize| (cell[a] as f32 + (i as f32 / STEPS as f32)).min((cell[a] + 1) as f32);
            // The texels of positive weight along each axis, as relight::lookup takes them.
            let along = |i: usize, a: usize| {
                let p = (f64::from(grid(i, a)) / lattice.step(a)).clamp(0.0, (m[a] - 1) as f64);
                let base = (p as usize).min(m[a].saturating_sub(2));
                let t = p - base as f64;
                [(base, 1.0 - t), ((base + 1).min(m[a] - 1), t)].into_iter().filter(|w| w.1 > 0.0).map(|w| w.0)
            };
            let all = |a: usize| (0..=STEPS).flat_map(move |i| along(i, a)).collect::<Vec<_>>();
            let (xs, ys, zs) = (all(0), all(1), all(2));
            for &z in &zs {
                for &y in &ys {
                    xs.iter().for_each(|&x| read.insert([x, y, z]));
                }
            }
            assert_eq!(selection.bits, read.bits, "ratio {ratio} cell {cell:?}");
        }
    }
}

/// Bricks are looked at by words of bits: against texel by texel, where rows begin and end anywhere in a word.
#[test]
fn a_brick_is_touched_where_one_of_its_texels_is_in_the_set() {
    for side in [3, 8, 13, 70] {
        let lattice = Lattice::from_ratio([side, 9, 10], 1.0).unwrap();
        let [mx, my, mz] = lattice.texels();
        let [bx, by, bz] = lattice.bricks();
        for texel in (0..mx * my * mz).step_by(7).map(|i| grid3::at([mx, my], i)) {
            let mut selection = Selection::empty(lattice);
            selection.insert(texel);
            let both = Selection::empty(lattice).with(selection.clone());
            for b in grid3::all([bx, by, bz]) {
                let holds = (0..3).all(|a| texel[a] / crate::transfer::BRICK == b[a]);
                assert_eq!(selection.touches_brick(b), holds, "{texel:?} {b:?}");
                assert_eq!(both.touches_brick(b), holds);
            }
            assert!(!selection.touches_brick([bx, 0, 0]), "beyond the lattice there is nothing");
        }
    }
}

#[test]
fn octants_of_a_chunk_count_and_keep_their_own_texels() {
    // 40 texels along x: the second chunk has 8 of them, all in octants 0, 2, 4, 6.
    let lattice = Lattice::from_texels([40, 36, 20], [40, 36, 20]).unwrap();
    let all = Selection::all(lattice);
    assert_eq!(all.texels_by_octant([0, 0, 0]), [4096, 4096, 4096, 4096, 1024, 1024, 1024, 1024]);
    assert_eq!(all.texels_by_octant([1, 1, 0]), [8 * 4 * 16, 0, 0, 0, 8 * 4 * 4, 0, 0, 0]);
    assert_eq!(all.octants([1, 1, 0]), Octants::one(0).with(Octants::one(4)));
    let mut kept = all.clone();
    kept.keep_octants([0, 0, 0], Octants::one(3));
    assert_eq!(kept.texels_by_octant([0, 0, 0]), [0, 0, 0, 4096, 0, 0, 0, 0]);
    assert!(kept.contains([16, 16, 0]) && !kept.contains([15, 16, 0]) && kept.contains([32, 0, 0]));
    // A brick belongs to the octant of its texels.
    for slot in 0..64 {
        let texel = lattice.texel_in_brick(lattice.brick_in_chunk([0, 0, 0], slot), 0);
        assert_eq!(Octants::one(3).hold_slot(&lattice, slot), texel[0] >= 16 && texel[1] >= 16 && texel[2] < 16);
    }
    let vertices = Selection::all(Lattice::of_vertices(5000));
    assert_eq!(vertices.texels_by_octant([1, 0, 0])[0], 904);
    assert_eq!(vertices.octants([1, 0, 0]), Octants::ALL);
}
