//! Where the light of the photons went.

/// Flux-heights by what became of them, per channel, in units of the environment's radiance (lengths in diagonals of the
/// box, isovalues in ranges of the samples).
///
/// emitted = missed + discarded + escaped + absorbed + cut, up to rounding of the sums.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotonEnergy {
    /// Sent out.
    pub emitted: [f64; 3],
    /// Of photons that missed the box.
    pub missed: [f64; 3],
    /// Of photons that entered the box inside the solid of their isovalue.
    pub discarded: [f64; 3],
    /// Of photons that left the box.
    pub escaped: [f64; 3],
    /// Taken by the surfaces.
    pub absorbed: [f64; 3],
    /// Of photons still travelling after the last reflection allowed.
    pub cut: [f64; 3],
    /// As it arrived at the hits that were kept, by the number of reflections before, 16 and more together. Not a part of
    /// the sum: a photon is kept at every hit.
    pub stored: [[f64; 3]; 17],
    /// Photons sent out.
    pub photons: u64,
    /// Hits.
    pub hits: u64,
    /// Rays that started into the solid and did not come out: they count as hits where they started.
    pub lost: u64,
}

impl PhotonEnergy {
    pub(super) fn arrive(&mut self, bounce: u32, flux: [f64; 3]) {
        tally(&mut self.stored[bounce.min(16) as usize], flux);
    }

    /// The largest part of the emitted light, of any channel, that the rows leave unexplained.
    pub fn imbalance(&self) -> f64 {
        let all = [self.missed, self.discarded, self.escaped, self.absorbed, self.cut];
        let of = |c: usize| {
            let sum: f64 = all.iter().map(|part| part[c]).sum();
            if self.emitted[c] > 0.0 { (sum / self.emitted[c] - 1.0).abs() } else { sum.abs() }
        };
        of(0).max(of(1)).max(of(2))
    }
}

/// Adds.
pub(super) fn tally(sum: &mut [f64; 3], flux: [f64; 3]) {
    for c in 0..3 {
        sum[c] += flux[c];
    }
}

impl std::ops::AddAssign<&Self> for PhotonEnergy {
    fn add_assign(&mut self, other: &Self) {
        tally(&mut self.emitted, other.emitted);
        tally(&mut self.missed, other.missed);
        tally(&mut self.discarded, other.discarded);
        tally(&mut self.escaped, other.escaped);
        tally(&mut self.absorbed, other.absorbed);
        tally(&mut self.cut, other.cut);
        self.stored.iter_mut().zip(&other.stored).for_each(|(a, b)| tally(a, *b));
        self.photons += other.photons;
        self.hits += other.hits;
        self.lost += other.lost;
    }
}
