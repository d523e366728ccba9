//! A balanced tree over four coordinates, in the array of the photons itself, and exact nearest neighbours (Bentley
//! 1975, "Multidimensional binary search trees"; balanced in place by selection, as Jensen 2001, ch. 6, does).

use std::collections::BinaryHeap;

/// What a tree can order.
pub(in crate::transport) trait Node: Send {
    /// Its coordinates.
    fn point(&self) -> &[f32; 4];
    /// Coordinate by which the tree splits here.
    fn axis(&self) -> u8;
    /// Room for that in the node, so that the tree itself takes no memory.
    fn split_by(&mut self, axis: u8);
}

/// Stretches so short are looked through one by one: the photons of two or three cache lines.
const LEAF: usize = 8;
/// Stretches so long are built by two threads.
const PARALLEL: usize = 1 << 14;

/// Nodes (photons, mostly) in the order of the tree: the middle one of a stretch splits the others by its coordinate
/// `axis`.
#[derive(Clone, Debug, Default)]
pub(in crate::transport) struct Tree<P> {
    photons: Vec<P>,
}

/// The nearest photons of a query. Kept from query to query, so that nothing is allocated.
#[derive(Clone, Debug, Default)]
pub(in crate::transport) struct Nearest {
    // Squared distance (bits of a number that is not negative are in its order) and place: so of equally distant
    // ones those of lower places are nearer, and there is one answer.
    found: BinaryHeap<u64>,
    wanted: usize,
    most: f32,
}

impl Nearest {
    /// Squared distance beyond which nothing is wanted.
    #[inline(always)]
    fn reach(&self) -> f32 {
        match self.found.peek() {
            Some(&worst) if self.found.len() == self.wanted => f32::from_bits((worst >> 32) as u32),
            _ => self.most,
        }
    }

    #[inline(always)]
    fn offer(&mut self, squared: f32, place: usize) {
        if squared > self.reach() {
            return;
        }
        let key = u64::from(squared.to_bits()) << 32 | place as u64;
        if self.found.len() < self.wanted {
            self.found.push(key);
        } else if let Some(mut worst) = self.found.peek_mut()
            && key < *worst
        {
            *worst = key;
        }
    }

    /// Squared distances and places, in no order.
    pub(in crate::transport) fn places(&self) -> impl Iterator<Item = (f32, usize)> {
        self.found.iter().map(|&key| (f32::from_bits((key >> 32) as u32), (key & 0xffff_ffff) as usize))
    }

    /// How many were found.
    pub(in crate::transport) fn len(&self) -> usize {
        self.found.len()
    }

    /// The last of them.
    pub(super) fn farthest(&self) -> Option<(f32, usize)> {
        self.found.peek().map(|&key| (f32::from_bits((key >> 32) as u32), (key & 0xffff_ffff) as usize))
    }
}

impl<P: Node> Tree<P> {
    /// Builds the tree in place, O(n log n) in the worst case; at most 2³² − 1 photons.
    pub(in crate::transport) fn new(mut photons: Vec<P>) -> Self {
        balance(&mut photons);
        Self { photons }
    }

    pub(in crate::transport) fn in_order(&self) -> &[P] {
        &self.photons
    }

    /// The `count` nearest photons within a squared distance of `most`.
    pub(in crate::transport) fn nearest(&self, at: [f32; 4], count: usize, most: f32, nearest: &mut Nearest) {
        nearest.found.clear();
        (nearest.wanted, nearest.most) = (count, most);
        if count > 0 {
            self.search(0, self.photons.len(), &at, nearest);
        }
    }

    fn search(&self, low: usize, high: usize, at: &[f32; 4], nearest: &mut Nearest) {
        if high - low <= LEAF {
            for place in low..high {
                nearest.offer(squared_distance(self.photons[place].point(), at), place);
            }
            return;
        }
        let middle = low + (high - low) / 2;
        let node = &self.photons[middle];
        let axis = usize::from(node.axis() & 3);
        let beyond = at[axis] - node.point()[axis];
        let (near, far) =
            if beyond < 0.0 { ((low, middle), (middle + 1, high)) } else { ((middle + 1, high), (low, middle)) };
        self.search(near.0, near.1, at, nearest);
        nearest.offer(squared_distance(node.point(), at), middle);
        // Rounding is monotone, so no distance on the far side comes out below this; equal ones may be of lower places.
        if beyond * beyond <= nearest.reach() {
            self.search(far.0, far.1, at, nearest);
        }
    }
}

#[inline(always)]
pub(super) fn squared_distance(a: &[f32; 4], b: &[f32; 4]) -> f32 {
    let d: [f32; 4] = std::array::from_fn(|i| a[i] - b[i]);
    (d[0] * d[0] + d[1] * d[1]) + (d[2] * d[2] + d[3] * d[3])
}

fn balance<P: Node>(photons: &mut [P]) {
    if photons.len() <= LEAF {
        return;
    }
    let axis = widest(photons);
    let middle = photons.len() / 2;
    photons.select_nth_unstable_by(middle, |a, b| a.point()[axis].total_cmp(&b.point()[axis]));
    photons[middle].split_by(axis as u8);
    let parallel = photons.len() > PARALLEL;
    let (left, right) = photons.split_at_mut(middle);
    let right = &mut right[1..];
    if parallel {
        rayon::join(|| balance(left), || balance(right));
    } else {
        balance(left);
        balance(right);
    }
}

/// The coordinate along which photons reach the farthest.
fn widest<P: Node>(photons: &[P]) -> usize {
    let (mut low, mut high) = ([f32::INFINITY; 4], [f32::NEG_INFINITY; 4]);
    for photon in photons {
        for a in 0..4 {
            low[a] = low[a].min(photon.point()[a]);
            high[a] = high[a].max(photon.point()[a]);
        }
    }
    (0..4).fold(0, |best, a| if high[a] - low[a] > high[best] - low[best] { a } else { best })
}
