//! The unit cell: numbering of its corners, edges and faces. Pure integer geometry.
//!
//! Corner `x + 2y + 4z`, each coordinate 0 or 1. Edge `4·axis + k`, where the bits of `k` are the
//! two other coordinates in ascending order of axis. Face `2·axis + side`.

/// Both corners of an edge, the one with the smaller coordinate along the edge first.
pub(crate) const fn edge_corners(edge: usize) -> [usize; 2] {
    let (axis, k) = (edge / 4, edge % 4);
    let low = match axis {
        0 => k << 1,
        1 => (k & 1) | (k >> 1) << 2,
        _ => k,
    };
    [low, low | 1 << axis]
}

/// The edge between two corners that differ in one coordinate.
pub(super) const fn edge_between(a: usize, b: usize) -> usize {
    let low = a & b;
    match a ^ b {
        1 => low >> 1,
        2 => 4 + (low & 1 | (low >> 2) << 1),
        _ => 8 + (low & 3),
    }
}

/// The four corners of a face, counter-clockwise as seen from outside the cell.
pub(crate) const fn face_corners(face: usize) -> [usize; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = side << axis;
    // u × v = +axis, so (u, v) turns counter-clockwise as seen from the high side.
    if side == 1 { [base, base | u, base | u | v, base | v] } else { [base, base | v, base | u | v, base | u] }
}

/// Whether two edges lie in a common face.
pub(super) const fn share_a_face(e: usize, f: usize) -> bool {
    let ([a, b], [c, d]) = (edge_corners(e), edge_corners(f));
    (a & b & c & d) | (!(a | b | c | d) & 7) != 0
}

/// The middle of an edge, in half cells.
pub(super) fn edge_middle(edge: usize) -> [i32; 3] {
    let [a, b] = edge_corners(edge);
    [0, 1, 2].map(|axis| ((a >> axis & 1) + (b >> axis & 1)) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_and_their_corners_are_inverse_to_each_other() {
        for edge in 0..12 {
            let [a, b] = edge_corners(edge);
            assert_eq!(a ^ b, 1 << (edge / 4));
            assert!(a < b && b < 8);
            assert_eq!(edge_between(a, b), edge);
            assert_eq!(edge_between(b, a), edge);
        }
    }

    #[test]
    fn faces_turn_counter_clockwise_seen_from_outside() {
        for face in 0..6 {
            let point = |c: usize| [0, 1, 2].map(|a| (c >> a & 1) as f64);
            let corners = face_corners(face).map(|c| glam::DVec3::from(point(c)));
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[1]);
            let outward = corners.iter().sum::<glam::DVec3>() / 4.0 - 0.5;
            assert_eq!(normal, 2.0 * outward, "face {face}");
        }
    }

    #[test]
    fn every_edge_shares_a_face_with_six_others() {
        // Two faces with three other edges each; no other edge lies in both.
        for e in 0..12 {
            assert_eq!((0..12).filter(|&f| f != e && share_a_face(e, f)).count(), 6);
        }
    }
}
