//! Mirrors and glass in a row, for paths and photons alike: when roulette ends a chain, and when it is cut.

/// Mirrors and glass in a row before roulette begins.
const SURE: u32 = 8;
/// Mirrors and glass in a row after which a path is cut, and counted as lost: only white mirrors and glass, where roulette
/// would end nothing, come that far.
pub const MOST: u32 = 4096;
/// Pairs of random numbers of chains start here, out of the way of all others.
const FIRST_PAIR: u32 = 1 << 24;

/// The pair of random numbers of a meeting; `turn` counts the diffuse ones before.
pub(in super::super) fn pair(turn: u32, in_a_row: u32) -> u32 {
    FIRST_PAIR + turn * MOST + in_a_row
}

/// The chance to go on at a mirror that reflects this share of each channel, by which what goes on is divided.
pub(in super::super) fn survival(in_a_row: u32, share: [f32; 3]) -> f64 {
    if in_a_row < SURE { 1.0 } else { f64::from(share[0].max(share[1]).max(share[2])) }
}
