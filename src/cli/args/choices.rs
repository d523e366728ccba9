//! Names on the command line of what the library has as types.

use crate::bake::Estimator;
use crate::probe::EnvFrame;
use crate::scene::Front;
use crate::session::Tone;
use crate::sh::Window;
use crate::transport::{Density, PhotonLight};
use crate::volume::Solid;
use clap::ValueEnum;
use clap::builder::PossibleValue;

/// A type of the library by the names of its variants, with what `--help` says of them.
macro_rules! choices {
    ($type:ty: $($variant:ident = $name:literal $(or $alias:literal)? $(, $help:literal)?;)*) => {
        impl ValueEnum for $type {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(Self::$variant),*]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                $(if *self == Self::$variant {
                    return Some(PossibleValue::new($name)$(.alias($alias))?$(.help($help))?);
                })*
                None
            }
        }
    };
}

choices! { Window:
    None = "none";
    Lanczos = "lanczos";
    Hanning = "hanning";
    Certified = "certified", "Proven nowhere negative; costs contrast";
}
choices! { EnvFrame:
    Gltf = "gltf", "The image's centre is +X, +Z three quarters from the left";
    OpenExr = "openexr", "The image's centre is +Z, +X a quarter from the left";
}
choices! { Tone:
    None = "none", "Linear up to white";
    Reinhard = "reinhard", "Reinhard and others 2002, equation 4, by luminance; four times white becomes white";
    Filmic = "filmic", "Narkowicz's fit of the ACES curve (2016), by channel";
}
choices! { Estimator:
    Path = "path", "Path tracing within each level set: unbiased";
    Gather = "gather", "The texture as radiance cache: less noise in less time where light bounces often, with a bias that is printed";
    Photon = "photon", "Flattened photon mapping, for study: light spread over the nearest photons, with a bias that no error bar holds";
}
choices! { Solid:
    Above = "above", "Values above the isovalue";
    Below = "below", "Values below the isovalue";
}
choices! { Front:
    Grid = "grid", "The axes of the file's frame: the front is -y where z is up";
    Anatomical = "anatomical", "A patient's frame (RAS+, z up): the front is anterior";
}
choices! { PhotonLight:
    Indirect = "indirect", "Indirect light; direct light by rays";
    All = "all", "All light";
    FinalGather = "gather", "All light, one reflection away: rays gather it";
}
choices! { Density:
    Tilted = "tilted", "By the ellipsoid that a search covers on a tilted field";
    Published = "published-4.9" or "published", "As published by Beason (2005, eq. 4.9), not clipped: too dark; for study";
    PublishedClipped = "published-4.10", "As published and recommended there (eq. 4.10), clipped to the isovalues found; for study";
}
