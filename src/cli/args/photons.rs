//! Photons as options.

use crate::compare::PhotonQuestion;
use crate::error::{Error, Result};
use crate::transport::{
    Density, IsovalueChoice, Isovalues, PhotonLight, PhotonLightSettings, PhotonSearch, PhotonSettings,
};
use crate::volume::Volume;

/// Flattened photon mapping.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Photons, with --against photon")]
pub(in crate::cli) struct PhotonArgs {
    /// Photons sent out
    #[arg(long, value_name = "N", default_value_t = 1 << 21, value_parser = clap::value_parser!(u32).range(1..=1 << 30))]
    photons: u32,
    /// What photons are taken for
    #[arg(long, value_enum, default_value = "indirect")]
    photon_light: PhotonLight,
    /// Which isovalues they carry
    #[arg(long, value_enum, default_value = "near")]
    photon_isovalues: IsovaluesChoice,
    /// How far photons of other isovalues are off: γ times the box's diagonal over the range of the samples
    #[arg(long, value_name = "G", default_value_t = 1.0)]
    gamma: f32,
    /// Nearest photons that an estimate rests on
    #[arg(long, value_name = "K", default_value_t = 512, value_parser = clap::value_parser!(u32).range(2..=1 << 20))]
    neighbours: u32,
    /// The same of light by way of mirrors and glass alone, within a third of the distance
    #[arg(long, value_name = "K", default_value_t = 64, value_parser = clap::value_parser!(u32).range(2..=1 << 20))]
    caustic_neighbours: u32,
    /// How the density of photons is read
    #[arg(long, value_enum, default_value = "tilted")]
    estimate: Density,
    /// Rays at each point for direct light and gathering, a power of two
    #[arg(long, value_name = "N", default_value = "256", value_parser = crate::cli::args::transfer::parse_rays)]
    photon_rays: u32,
}

/// As [`IsovalueChoice`], and its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum IsovaluesChoice {
    /// Those within half a sample of the surface
    Near,
    /// All, by the number of cells that they cross
    Extents,
    /// All alike
    Uniform,
}

/// Samples that isovalues near a surface span across it.
const NEAR_CELLS: f64 = 1.0;

impl PhotonArgs {
    pub(in crate::cli) fn question(&self, volume: &Volume, isovalue: f64, seed: u64) -> Result<PhotonQuestion> {
        let isovalues = match self.photon_isovalues {
            IsovaluesChoice::Near => Isovalues::near(volume, isovalue, NEAR_CELLS)
                .ok_or_else(|| Error::argument("isovalue", isovalue, "one that crosses a cell", "give another"))?,
            IsovaluesChoice::Extents => Isovalues { choice: IsovalueChoice::Extents, range: None },
            IsovaluesChoice::Uniform => Isovalues { choice: IsovalueChoice::Uniform, range: None },
        };
        let memory_limit = crate::memory::default_limit();
        let map = PhotonSettings {
            photons: self.photons,
            isovalues,
            gamma: self.gamma,
            seed,
            memory_limit,
            ..PhotonSettings::default()
        };
        let (light, density) = (self.photon_light, self.estimate);
        let search = PhotonSearch { neighbours: self.neighbours, density, ..PhotonSearch::default() };
        let caustics = PhotonSearch { neighbours: self.caustic_neighbours, density, ..PhotonSearch::of_caustics() };
        let reading = PhotonLightSettings { light, rays: self.photon_rays, search, caustics, seed };
        Ok(PhotonQuestion { map, reading })
    }
}
