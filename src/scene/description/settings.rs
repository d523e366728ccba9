//! The sections `[bake]`, `[probe]` and `[camera]`.

use super::Located;
use super::read::Item;
use crate::error::Result;
use crate::scene::{MOST_SUNS, SunSplit};
use crate::sh::MAX_BANDS;
use std::fmt;
use std::str::FromStr;

/// Most layers; the limit of [`crate::transfer::Layers`], which scenes come before.
const MOST_LAYERS: u64 = 16;
/// Fewest and most rays of a texel.
const RAYS: std::ops::RangeInclusive<u64> = 4..=1 << 20;

/// Resolution of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TextureSize {
    /// Texels to a sample.
    Ratio(f64),
    /// Texels along x, y, z.
    Texels([u64; 3]),
    /// So many texels to a sample at most, rounded up so that intervals are a multiple of 8: those are left out that can be interpolated with this error, relative to the root mean square
    /// of the transfer.
    Adaptive {
        /// Between 0 and 1.
        error: f64,
        /// Above 0 and up to 16.
        ratio: f64,
    },
}

impl From<f64> for TextureSize {
    fn from(ratio: f64) -> Self {
        Self::Ratio(ratio)
    }
}

impl fmt::Display for TextureSize {
    /// As it is read.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ratio(ratio) => write!(f, "{ratio}"),
            Self::Texels([x, y, z]) => write!(f, "{x}x{y}x{z}"),
            Self::Adaptive { error, ratio } => write!(f, "adaptive:{error},{ratio}"),
        }
    }
}

impl FromStr for TextureSize {
    /// What to give instead.
    type Err = String;

    /// Reads a ratio such as 0.5, texels such as 128x128x96, or `adaptive:2%`, which goes up to two texels to a sample;
    /// `adaptive:2%,1` up to one.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if let Some(rest) = text.strip_prefix("adaptive") {
            let example = "give adaptive:2%, or with the most texels to a sample adaptive:2%,1";
            return adaptive(rest).ok_or_else(|| example.into());
        }
        if let Ok(ratio) = text.parse::<f64>() {
            return if ratio > 0.0 && ratio <= 16.0 {
                Ok(Self::Ratio(ratio))
            } else {
                Err("give a ratio above 0 and up to 16".into())
            };
        }
        let texels: Option<Vec<u64>> = text.split('x').map(|n| n.parse().ok()).collect();
        match texels.as_deref() {
            Some(&[x, y, z]) => Ok(Self::Texels([x, y, z])),
            _ => Err("give a ratio such as 0.5, a resolution such as 128x128x96, or adaptive:2%".into()),
        }
    }
}

/// Texels to a sample, at most, of an adaptive texture that does not say.
const FINEST: f64 = 2.0;

/// Reads what follows `adaptive`.
fn adaptive(text: &str) -> Option<TextureSize> {
    let rest = text.strip_prefix(':')?;
    let (error, ratio) = match rest.split_once(',') {
        Some((error, ratio)) => (error, ratio.trim().parse().ok()?),
        None => (rest, FINEST),
    };
    let error = match error.trim().strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().ok()? / 100.0,
        None => error.trim().parse().ok()?,
    };
    let is_legal = error > 0.0 && error < 1.0 && ratio > 0.0 && ratio <= 16.0;
    is_legal.then_some(TextureSize::Adaptive { error, ratio })
}

/// How transfer is computed; `None` where the file does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeDescription {
    /// Paths of a texel, a power of two.
    pub rays: Option<u64>,
    /// Stored layers.
    pub layers: Option<u64>,
    /// Bands: one count, or one for each layer. Empty where the file does not say.
    pub bands: Vec<u64>,
    /// Standard error at which a texel stops.
    pub error: Option<f64>,
    /// Resolution.
    pub texture: Option<TextureSize>,
    /// Transfer that stays non-negative.
    pub positive: Option<bool>,
}

/// The environment.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeDescription {
    /// An environment of the program, a sky by formula, or a file.
    pub name: Located<String>,
    /// Whether it is a path from the folder of the file.
    pub is_file: bool,
    /// Counter-clockwise about up, degrees.
    pub rotation: Option<f64>,
    /// Window of the band-limited light.
    pub window: Option<&'static str>,
    /// Which lamps are lit apart.
    pub sun_split: Option<SunSplit>,
}

/// How pictures look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraDescription {
    /// A named view, or azimuth and elevation in degrees as text `AZIMUTH,ELEVATION`.
    pub view: Option<String>,
    /// Width and height in pixels.
    pub size: Option<[u64; 2]>,
    /// Vertical field of view in degrees; 0 for parallel projection.
    pub field_of_view: Option<f64>,
    /// Stops, or `auto`.
    pub exposure: Option<String>,
    /// As `--background`.
    pub background: Option<String>,
}

pub(super) fn bake(item: &Item<'_>) -> Result<BakeDescription> {
    let section = item.section(&["rays", "layers", "bands", "error", "texture", "positive"])?;
    let mut out = BakeDescription::default();
    if let Some(item) = section.get("rays") {
        let rays = item.integer(RAYS)?;
        if !rays.is_power_of_two() {
            return Err(item.refuse("a power of two", "16 is a preview, 64 a draft, 256 final, 4096 a reference"));
        }
        out.rays = Some(rays);
    }
    out.layers = section.get("layers").map(|item| item.integer(1..=MOST_LAYERS)).transpose()?;
    if let Some(item) = section.get("bands") {
        let counts = item.one_or_more()?;
        out.bands = counts.iter().map(|item| item.integer(1..=MAX_BANDS as u64)).collect::<Result<_>>()?;
        let layers = out.layers.unwrap_or(counts.len() as u64);
        if counts.len() > 1 && counts.len() as u64 != layers {
            return Err(item.refuse(format!("one count, or {layers}: one for each layer"), "leave out `layers`"));
        }
    }
    if let Some(item) = section.get("error") {
        let percent = item.as_text().and_then(|t| t.strip_suffix('%')).and_then(|t| t.trim().parse::<f64>().ok());
        let error = percent.map(|p| p / 100.0).or_else(|| item.as_number());
        let expected = "a standard error between 0 and 1";
        let remedy = "write 0.01 or \"1%\"";
        out.error = Some(error.filter(|e| *e > 0.0 && *e < 1.0).ok_or_else(|| item.refuse(expected, remedy))?);
    }
    out.texture = section.get("texture").map(|item| texture(&item)).transpose()?;
    out.positive = section.get("positive").map(|item| item.boolean()).transpose()?;
    Ok(out)
}

fn texture(item: &Item<'_>) -> Result<TextureSize> {
    let expected = "a ratio above 0 and up to 16, [x, y, z] texels, or \"adaptive:2%\"";
    let refuse = || item.refuse(expected, "1 is the resolution of the data");
    if let Some(rest) = item.as_text().and_then(|text| text.strip_prefix("adaptive")) {
        return adaptive(rest).ok_or_else(refuse);
    }
    if let Some(ratio) = item.as_number() {
        return if ratio > 0.0 && ratio <= 16.0 { Ok(TextureSize::Ratio(ratio)) } else { Err(refuse()) };
    }
    let list = item.list().ok_or_else(refuse)?;
    let texels = list.iter().map(|item| item.integer(1..=1 << 24)).collect::<Result<Vec<_>>>()?;
    let texels: [u64; 3] = texels.try_into().map_err(|_| refuse())?;
    Ok(TextureSize::Texels(texels))
}

pub(super) fn probe(item: &Item<'_>) -> Result<ProbeDescription> {
    let section = item.section(&["name", "file", "rotation", "window", "sun_split"])?;
    let (name, is_file) = match (section.get("name"), section.get("file")) {
        (Some(name), None) => (name, false),
        (None, Some(file)) => (file, true),
        (None, None) => return Err(item.refuse("a `name` or a `file`", "write name = \"courtyard\"")),
        (Some(_), Some(file)) => return Err(file.refuse("a `name` or a `file`, not both", "take one out")),
    };
    Ok(ProbeDescription {
        name: Located { value: name.text()?.to_string(), line: name.line() },
        is_file,
        rotation: section.get("rotation").map(|item| item.number()).transpose()?,
        window: section
            .get("window")
            .map(|item| item.word(&["none", "lanczos", "hanning", "certified"]))
            .transpose()?,
        sun_split: section.get("sun_split").map(|item| sun_split(&item)).transpose()?,
    })
}

fn sun_split(item: &Item<'_>) -> Result<SunSplit> {
    if let Ok(is_on) = item.boolean() {
        return Ok(if is_on { SunSplit::Auto } else { SunSplit::Off });
    }
    let number = || item.as_number().filter(|v| v.fract() == 0.0).map(|v| v.to_string());
    let text = item.as_text().map(String::from).or_else(number);
    let expected = format!("true, false, or a number of lamps from 1 to {MOST_SUNS}");
    text.and_then(|text| text.parse().ok()).ok_or_else(|| item.refuse(expected, "true splits off as many as ring"))
}

const VIEWS: [&str; 7] = ["front", "back", "left", "right", "top", "bottom", "iso"];

pub(super) fn camera(item: &Item<'_>) -> Result<CameraDescription> {
    let section = item.section(&[
        "view",
        "azimuth",
        "elevation",
        "size",
        "projection",
        "field_of_view",
        "exposure",
        "background",
    ])?;
    let mut out = CameraDescription::default();
    let angle = |key: &str, most: f64| -> Result<Option<f64>> {
        let Some(item) = section.get(key) else { return Ok(None) };
        let degrees = item.number()?;
        if degrees.abs() > most {
            return Err(item.refuse(format!("degrees from -{most} to {most}"), "choose an angle in this range"));
        }
        Ok(Some(degrees))
    };
    let angles = (angle("azimuth", 3600.0)?, angle("elevation", 90.0)?);
    out.view = match (section.get("view"), angles) {
        (Some(item), (None, None)) => Some(item.word(&VIEWS)?.to_string()),
        (Some(item), _) => return Err(item.refuse("a view, or azimuth and elevation", "take one of them out")),
        (None, (None, None)) => None,
        (None, (azimuth, elevation)) => Some(format!("{},{}", azimuth.unwrap_or(0.0), elevation.unwrap_or(0.0))),
    };
    if let Some(item) = section.get("size") {
        let sides = item.list().unwrap_or_default();
        let sides = sides.iter().map(|item| item.integer(1..=16384)).collect::<Result<Vec<_>>>()?;
        let refuse = |_| item.refuse("[width, height] in pixels", "write size = [960, 720]");
        out.size = Some(sides.try_into().map_err(refuse)?);
    }
    let projection = section.get("projection").map(|item| item.word(&["orthographic", "perspective"])).transpose()?;
    if let Some(item) = section.get("field_of_view") {
        let degrees = item.number()?;
        if !(1.0..=150.0).contains(&degrees) || projection == Some("orthographic") {
            return Err(item.refuse(
                "degrees from 1 to 150, of a perspective projection",
                "write projection = \"perspective\", or take it out",
            ));
        }
        out.field_of_view = Some(degrees);
    }
    match projection {
        Some("perspective") if out.field_of_view.is_none() => out.field_of_view = Some(35.0),
        Some("orthographic") => out.field_of_view = Some(0.0),
        _ => {}
    }
    if let Some(item) = section.get("exposure") {
        let stops = item.as_number().filter(|v| v.abs() <= 100.0).map(|v| v.to_string());
        let auto = item.as_text().filter(|t| *t == "auto").map(String::from);
        out.exposure =
            Some(stops.or(auto).ok_or_else(|| item.refuse("stops, or \"auto\"", "write a number such as -1.5"))?);
    }
    out.background = section.get("background").map(|item| background(&item)).transpose()?;
    Ok(out)
}

/// white, black, transparent or #rrggbb.
fn background(item: &Item<'_>) -> Result<String> {
    let name = item.text()?;
    let digits = name.strip_prefix('#').is_some_and(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
    if digits || ["white", "black", "transparent"].contains(&name) {
        return Ok(name.to_string());
    }
    Err(item.refuse("white, black, transparent or #rrggbb", "colours are sRGB, such as \"#2c3036\""))
}
