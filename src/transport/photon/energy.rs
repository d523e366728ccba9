//! Where the light of the photons went.

/// Flux-heights by what became of them, per channel, in units of radiance (lengths in diagonals of the volume's box, isovalues
/// in ranges of the samples).
///
/// emitted = missed + discarded + escaped + absorbed + in_walls + in_luminaires + cut, up to rounding of the sums.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotonEnergy {
    /// Sent out.
    pub emitted: [f64; 3],
    /// Of photons that met nothing.
    pub missed: [f64; 3],
    /// Of photons that entered a box inside the solid of their isovalue, or began inside it.
    pub discarded: [f64; 3],
    /// Of photons that left the scene after they had met something.
    pub escaped: [f64; 3],
    /// Taken by level sets.
    pub absorbed: [f64; 3],
    /// Taken by walls.
    pub in_walls: [f64; 3],
    /// Of photons that met the body of a luminaire.
    pub in_luminaires: [f64; 3],
    /// Of photons still travelling after the last reflection, mirror or glass allowed.
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

    /// What the emitted light is the sum of.
    fn parts(&self) -> [[f64; 3]; 7] {
        let Self { missed, discarded, escaped, absorbed, in_walls, in_luminaires, cut, .. } = *self;
        [missed, discarded, escaped, absorbed, in_walls, in_luminaires, cut]
    }

    /// The largest part of the emitted light, of any channel, that the rows leave unexplained.
    pub fn imbalance(&self) -> f64 {
        let of = |c: usize| {
            let sum: f64 = self.parts().iter().map(|part| part[c]).sum();
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
        tally(&mut self.in_walls, other.in_walls);
        tally(&mut self.in_luminaires, other.in_luminaires);
        tally(&mut self.cut, other.cut);
        self.stored.iter_mut().zip(&other.stored).for_each(|(a, b)| tally(a, *b));
        self.photons += other.photons;
        self.hits += other.hits;
        self.lost += other.lost;
    }
}
