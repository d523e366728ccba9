//! Places in a grid of three axes and their linear index, x fastest.

/// The linear index of a place; `dims` are the lengths along x and y.
#[inline(always)]
pub fn index(dims: [usize; 2], [x, y, z]: [usize; 3]) -> usize {
    x + dims[0] * (y + dims[1] * z)
}

/// The place of a linear index; `dims` are the lengths along x and y.
#[inline(always)]
pub fn at(dims: [usize; 2], index: usize) -> [usize; 3] {
    [index % dims[0], index / dims[0] % dims[1], index / dims[0] / dims[1]]
}

/// All places of a grid, x fastest.
pub fn all([nx, ny, nz]: [usize; 3]) -> impl ExactSizeIterator<Item = [usize; 3]> + Clone {
    (0..nx * ny * nz).map(move |i| at([nx, ny], i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_indices_are_inverse() {
        let dims = [3, 5, 7];
        for (i, place) in all(dims).enumerate() {
            assert_eq!((index([3, 5], place), at([3, 5], i)), (i, place));
        }
        assert_eq!((all(dims).len(), all(dims).nth(1), all(dims).nth(15)), (105, Some([1, 0, 0]), Some([0, 0, 1])));
    }
}
