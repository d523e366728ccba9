//! Slow twins for the tests, written from the definition of the trilinear function and sharing
//! nothing with the extraction: a cell is refined to n³ small cells, and what the level set is
//! there is read off the signs of the samples.

/// Signs of the trilinear function of a cell at (n + 1)³ points: bit x of `rows[y + (n+1) z]`.
pub(super) struct Refined {
    n: usize,
    rows: Vec<u128>,
}

impl Refined {
    pub fn new(d: &[f64; 8], n: usize) -> Self {
        assert!(n < 128);
        let mut rows = Vec::with_capacity((n + 1) * (n + 1));
        let mix = |a: f64, b: f64, i: usize| (a * (n - i) as f64 + b * i as f64) / n as f64;
        for z in 0..=n {
            let plane: [f64; 4] = std::array::from_fn(|k| mix(d[k], d[k + 4], z));
            for y in 0..=n {
                let (a, b) = (mix(plane[0], plane[2], y), mix(plane[1], plane[3], y));
                rows.push((0..=n).fold(0u128, |row, x| row | u128::from(mix(a, b, x) > 0.0) << x));
            }
        }
        Self { n, rows }
    }

    /// The row of samples (y, z), shifted so that bit x is the sample at x + dx.
    fn shifted(&self, dx: usize, y: usize, z: usize) -> u128 {
        self.rows[y + (self.n + 1) * z] >> dx
    }

    /// Number of chains p, p + s₁, p + s₁ + s₂, … of the Kuhn triangulation whose samples do not
    /// all have one sign. `sums` holds the partial sums as masks of axes, ascending.
    fn crossed(&self, sums: &[usize]) -> i64 {
        let n = self.n;
        let last = sums[sums.len() - 1];
        let reach = |axis: usize| last >> axis & 1;
        let mask = (1u128 << (n + 1 - reach(0))) - 1;
        let mut count = 0;
        for z in 0..=n - reach(2) {
            for y in 0..=n - reach(1) {
                let first = self.shifted(0, y, z);
                let (mut any, mut all) = (first, first);
                for s in sums {
                    let row = self.shifted(s & 1, y + (s >> 1 & 1), z + (s >> 2));
                    (any, all) = (any | row, all & row);
                }
                count += i64::from((any & !all & mask).count_ones());
            }
        }
        count
    }

    /// Euler characteristic of the level set in the closed cell, from marching tetrahedra:
    /// a vertex on each crossed edge, a segment in each crossed triangle, a polygon in each crossed
    /// tetrahedron.
    pub fn euler_characteristic(&self) -> i64 {
        let mut sum = 0;
        for a in 1..8 {
            sum += self.crossed(&[a]);
            for b in (1..8).filter(|b| a & b == 0) {
                sum -= self.crossed(&[a, a | b]);
                for c in (1..8).filter(|c| c & (a | b) == 0) {
                    if a.count_ones() == 1 && b.count_ones() == 1 && c.count_ones() == 1 {
                        sum += self.crossed(&[a, a | b, a | b | c]);
                    }
                }
            }
        }
        sum
    }

    /// The component of each corner within its own side, named by its smallest corner, where
    /// samples are joined along axes. Such a joint is real, for the function is linear along
    /// axes: components found joined are joined, and with n → ∞ all joints are found.
    pub fn corner_components(&self) -> [u8; 8] {
        let m = self.n + 1;
        let sign = |i: usize| self.rows[i / m] >> (i % m) & 1;
        let mut names = [u8::MAX; 8];
        let corner = |c: usize| self.n * ((c & 1) + m * (c >> 1 & 1) + m * m * (c >> 2));
        for c in 0..8 {
            if names[c] != u8::MAX {
                continue;
            }
            let mut seen = vec![false; m * m * m];
            let mut open = vec![corner(c)];
            seen[corner(c)] = true;
            while let Some(i) = open.pop() {
                let at = [i % m, i / m % m, i / (m * m)];
                for (axis, step) in [1, m, m * m].into_iter().enumerate() {
                    let down = (at[axis] > 0).then(|| i - step);
                    let up = (at[axis] < self.n).then_some(i + step);
                    for j in [down, up].into_iter().flatten() {
                        if !seen[j] && sign(j) == sign(i) {
                            seen[j] = true;
                            open.push(j);
                        }
                    }
                }
            }
            (c..8).filter(|&other| seen[corner(other)]).for_each(|other| names[other] = c as u8);
        }
        names
    }
}

/// Uniform numbers in (0, 1) for tests: SplitMix64 (Steele, Lea & Flood 2014).
pub(super) struct Uniform(pub u64);

impl Uniform {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 + f64::EPSILON
    }
}

#[test]
fn the_reference_knows_a_disk_and_a_tunnel() {
    // One solid corner: a disk. Two opposite solid corners with a high or a low body between.
    let mut d = [-1.0; 8];
    d[0] = 1.0;
    assert_eq!(Refined::new(&d, 15).euler_characteristic(), 1);
    d[7] = 1.0;
    assert_eq!(Refined::new(&d, 15).euler_characteristic(), 2);
    assert_eq!(Refined::new(&d, 15).corner_components(), [0, 1, 1, 1, 1, 1, 1, 7]);
    // Corners 0 and 7 at 10: the centre of the cell is (2·10 − 6·1)/8 > 0, so the solid runs along
    // the diagonal and the surface is an annulus around it.
    (d[0], d[7]) = (10.0, 10.0);
    assert_eq!(Refined::new(&d, 15).euler_characteristic(), 0);
    assert_eq!(Refined::new(&d, 15).corner_components(), [0, 1, 1, 1, 1, 1, 1, 0]);
}
