//! The two decisions that the signs of the corners leave open, both for the trilinear function
//! of the cell: does the solid join across a face, and does a tunnel join two regions inside.
//!
//! Values are d = s·(raw − c), s the solid sign: solid is d > 0, strictly. A tie counts as lit
//! everywhere, as if every isovalue were raised by less than any number.

use super::cell::face_corners;

/// Decisions of the faces in `ambiguous`, one bit each in ascending order of face, set where the
/// solid corners join across the face.
///
/// With solid corners a, c and lit corners b, d around a face, the bilinear saddle has the value
/// (ac − bd)/(a + c − b − d) and the denominator is positive, so the solid joins if and only if
/// ac > bd (the asymptotic decider of Nielson & Hamann 1991, "The Asymptotic Decider",
/// without the division). Both cells of a face form the same two products of the same numbers,
/// and multiplication commutes in floating point: they agree bit for bit, ties and roundings
/// included. This is what makes the mesh closed; it does not rest on accuracy.
pub(super) fn face_decisions(d: &[f64; 8], ambiguous: u8) -> u8 {
    let (mut decisions, mut bit) = (0, 1);
    for face in (0..6).filter(|f| ambiguous >> f & 1 == 1) {
        let [p, q, r, s] = face_corners(face).map(|c| d[c]);
        let (even, odd) = (p * r, q * s);
        let joined = if p > 0.0 { even > odd } else { odd > even };
        decisions |= if joined { bit } else { 0 };
        bit <<= 1;
    }
    decisions
}

/// The two regions, smaller number first, that a tunnel inside the cell joins, if there is one.
/// `regions` are those of the corners after the face decisions.
///
/// *The test.* Slice the cell at z = t. A slice is bilinear with corners A, B, C, D (in turn),
/// linear in t; every component of its solid holds a corner, and the same for its lit part. Along
/// a corner's vertical edge the solid is one segment, of one region. Regions can therefore meet
/// inside only through a slice whose diagonal corners join across the slice, as on a face: A and
/// C solid, B and D lit, q(t) = AC − BD > 0 (or q ≤ 0, which joins B and D). If the regions of A
/// and C differ, q ≤ 0 at both ends of the interval of such t, since there the joint would be on
/// the boundary: so q must be concave and positive at its vertex. The vertex alone decides.
///
/// q has one vertex, so a cell has at most one tunnel, and no other surface than disks and one
/// annulus can occur. Slicing along one axis is enough; the choice matters only for roundings,
/// and those never open the mesh, because the faces are decided before and apart.
///
/// Source: the interior test of Chernyaev 1995 ("Marching Cubes 33"), in the form of one test for
/// all cases. He tests chosen edges case by case; Custodio et al. 2013 ("Practical considerations
/// on Marching Cubes 33 topological correctness") show that this cannot settle his case 13.5. Here
/// the vertex of q lies in at most one of the two intervals of that case and tells them apart.
pub(super) fn tunnel(d: &[f64; 8], regions: &[u8; 8]) -> Option<[u8; 2]> {
    /// Corners of the lower slice in turn; the upper ones are four more.
    const TURN: [usize; 4] = [0, 1, 3, 2];
    let low = TURN.map(|c| d[c]);
    let rise = TURN.map(|c| d[c + 4] - d[c]);
    let [a, b, c, e] = low;
    let bend = rise[0] * rise[2] - rise[1] * rise[3];
    let slope = a * rise[2] + c * rise[0] - b * rise[3] - e * rise[1];
    let t = -0.5 * slope / bend;
    if !(t > 0.0 && t < 1.0) {
        return None; // bend = 0 gives NaN or an infinity
    }
    let slice: [f64; 4] = std::array::from_fn(|k| low[k] + t * rise[k]);
    let solid = slice.map(|v| v > 0.0);
    if solid[0] != solid[2] || solid[1] != solid[3] || solid[0] == solid[1] {
        return None;
    }
    // From here on `first` tells whether A and C are the solid pair.
    let first = solid[0];
    let (even, odd) = (slice[0] * slice[2], slice[1] * slice[3]);
    let solid_joins = if first { even > odd } else { odd > even };
    // Solid that joins at the vertex must part away from it, and the same for the lit side.
    let parts_away_from_it = if first == solid_joins { bend < 0.0 } else { bend > 0.0 };
    if !parts_away_from_it {
        return None;
    }
    let pair = if first == solid_joins { [0, 2] } else { [1, 3] };
    let region = |k: usize| {
        // The end of this vertical edge that is on the same side as the slice.
        let bottom_fits = (low[k] > 0.0) == solid[k];
        regions[if bottom_fits { TURN[k] } else { TURN[k] + 4 }]
    };
    let [r, s] = pair.map(region);
    (r != s).then_some([r.min(s), r.max(s)])
}
