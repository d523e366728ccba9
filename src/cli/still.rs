//! Pictures for print and film: what is behind the surface, tone, a scale bar, and turntables.

use super::light::{LightArgs, Lighting};
use super::picture::{Background, Cap, PictureArgs, Tone, Turn};
use super::relight::Companion;
use super::scene_light::contracted as contracted_by;
use super::scene_walls::{WallQuestion, Walls, in_view};
use super::surface::Surface;
use super::{Outcome, text};
use crate::error::{Error, Result};
use crate::export::{Image, font};
use crate::geom::{Bounds, Up};
use crate::level::{Counts, Pyramid};
use crate::probe::{LatLong, Probe};
use crate::relight::{Contracted, LookupReport, Material};
use crate::render::{Camera, Picture, Projection, RenderOptions, Subject, View, render};
use crate::scene::geometry::Geometry;
use crate::transfer::store::Store;
use crate::volume::{LengthUnit, Volume};
use glam::DVec3;

/// One surface under one light, to be pictured from one or many sides.
pub(super) struct Still<'a> {
    pub(super) args: &'a PictureArgs,
    pub(super) light: &'a LightArgs,
    /// Whether dominant lamps are lit apart.
    pub(super) split: bool,
    pub(super) store: &'a Store,
    pub(super) volume: &'a Volume,
    pub(super) pyramid: &'a Pyramid,
    pub(super) surface: &'a Surface,
    pub(super) up: Up,
    pub(super) probe: &'a Probe,
    pub(super) material: &'a Material,
    pub(super) exposure: f32,
    /// What stands around the volume, where it is known.
    pub(super) geometry: Option<&'a Geometry>,
    /// Paths of what is seen of it.
    pub(super) wall_rays: u32,
    /// Surfaces of other volumes, lit with this one.
    pub(super) companions: &'a [Companion<'a>],
}

/// A picture and how it came about.
pub(super) struct Frame {
    pub(super) image: Image,
    pub(super) counts: Counts,
    pub(super) report: LookupReport,
}

impl Still<'_> {
    /// Picture number `index` of the turntable; the only one where there is none.
    pub(super) fn frame(&self, index: u32, contracted: &Contracted, lighting: &Lighting) -> Outcome<Frame> {
        let degrees = self.args.turntable.map_or(0.0, |n| 360.0 * f64::from(index) / f64::from(n));
        let mut view = self.args.seen.view.view(self.up);
        let mut light = self.light.clone();
        match self.args.turn {
            Turn::View => view.azimuth += degrees,
            Turn::Light => light.env_rotate += degrees,
        }
        let anew = if self.args.turn == Turn::Light && index > 0 {
            let lighting = light.prepare(self.probe, self.up, &self.store.layout().layers, self.split)?;
            let (bricks, factors) = (&self.surface.bricks, &light.luminaires);
            let mut contracted = contracted_by(self.store, bricks, &lighting, self.material, factors)?;
            if lighting.certified {
                contracted.clamp_negative();
            }
            Some((contracted, lighting))
        } else {
            None
        };
        let (contracted, lighting) = anew.as_ref().map_or((contracted, lighting), |(c, l)| (c, l));
        let (width, height) = self.args.seen.size;
        let aspect = width as f64 / height as f64;
        let camera = match in_view(self.geometry, self.volume, self.together()) {
            Some(_) if self.shows_lobes() => {
                let points = self.surface.seen(self.volume).chain(self.companions.iter().flat_map(Companion::points));
                Camera::framing_points(points, self.up, view, self.args.seen.projection(), aspect)
            }
            Some(bounds) => Camera::framing(&bounds, self.up, view, self.args.seen.projection(), aspect),
            None => self.args.camera(self.surface, self.volume, self.up, view),
        };
        let options = RenderOptions {
            width,
            height,
            supersampling: usize::from(self.args.supersampling),
            cap: self.args.cap == Cap::Flat,
        };
        let picture = self.picture(contracted, lighting, &camera, &options)?;
        let mut image = match self.args.background {
            Background::Colour(colour) => develop(&picture, self.exposure, self.args.tone, &|_, _| colour)?,
            Background::Environment => {
                let sky = self.sky(view, &light)?;
                develop(&picture, self.exposure, self.args.tone, &sky)?
            }
        };
        if self.args.scale_bar {
            self.draw_bar(&mut image, &camera)?;
        }
        Ok(Frame { image, counts: picture.counts, report: picture.report })
    }

    /// The surface, among the walls of its scene.
    fn picture(
        &self,
        contracted: &Contracted,
        lighting: &Lighting,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Outcome<Picture> {
        let (volume, pyramid, isovalue, material) = (self.volume, self.pyramid, self.surface.isovalue, self.material);
        let subject = Subject { volume, pyramid, isovalue, contracted, light: &lighting.light, material };
        if self.geometry.is_none() && self.companions.is_empty() {
            return Ok(render(&subject, &lighting.suns, None, camera, options));
        }
        let question = WallQuestion { volume, pyramid, isovalue, material, rays: self.wall_rays };
        let walls = self
            .geometry
            .map(|geometry| Walls::new(geometry, &question, camera, options, lighting, &self.light.luminaires))
            .transpose()?;
        let beside = self
            .companions
            .iter()
            .map(|c| Ok((c, c.contracted(lighting, material, &self.light.luminaires)?)))
            .collect::<Outcome<Vec<_>>>()?;
        let backdrop = |origin, direction, limit, pixel| {
            let (mut found, mut limit): (Option<[f32; 3]>, f64) = (None, limit);
            for (companion, contracted) in &beside {
                let ray = (origin, direction);
                if let Some((rgb, distance)) = companion.seen(contracted, lighting, material, (camera, options), ray)
                    && distance < limit
                {
                    (found, limit) = (Some(rgb), distance);
                }
            }
            walls.as_ref().and_then(|walls| walls.seen(origin, direction, limit, pixel)).or(found)
        };
        Ok(render(&subject, &[], Some(&backdrop), camera, options))
    }

    /// Whether all surfaces are of one grid, without walls, and to be framed closely.
    fn shows_lobes(&self) -> bool {
        let bounds = self.volume.world_bounds();
        let has_walls = self.geometry.is_some_and(|geometry| geometry.bounds().min.is_finite());
        let is_one_grid = self.companions.iter().all(|companion| companion.bounds() == bounds);
        is_one_grid && !has_walls && self.args.frame == super::picture::Frame::Surface && self.args.turntable.is_none()
    }

    /// The box of all volumes, where there are several.
    fn together(&self) -> Option<Bounds> {
        let first = (!self.companions.is_empty()).then(|| self.volume.world_bounds())?;
        Some(self.companions.iter().fold(first, |all, companion| {
            let own = companion.bounds();
            all.including(own.min).including(own.max)
        }))
    }

    /// The environment behind a pixel. Parallel rays would see one direction of it: behind them it is seen in
    /// perspective.
    fn sky(&self, view: View, light: &LightArgs) -> Result<impl Fn(usize, usize) -> [f32; 4]> {
        let (width, height) = self.args.seen.size;
        let aspect = width as f64 / height as f64;
        let projection = match self.args.seen.projection() {
            Projection::Orthographic => Projection::Perspective(SKY_FIELD_OF_VIEW),
            perspective => perspective,
        };
        let camera = Camera::framing(&self.volume.world_bounds(), self.up, view, projection, aspect);
        let probe_from_world = light.orientation(self.up)?.probe_from_world();
        let (exposure, tone, image) = (self.exposure, self.args.tone, &self.probe.image);
        Ok(move |x: usize, y: usize| {
            let px = (x as f64 + 0.5) / width as f64 * 2.0 - 1.0;
            let py = 1.0 - (y as f64 + 0.5) / height as f64 * 2.0;
            let (_, direction) = camera.ray(px, py, aspect);
            let [r, g, b] = tone.apply(between_pixels(image, probe_from_world * direction).map(|v| v * exposure));
            [r, g, b, 1.0]
        })
    }

    /// A bar of a round length, with its length in words.
    fn draw_bar(&self, image: &mut Image, camera: &Camera) -> Result<()> {
        if self.args.seen.perspective.is_some() {
            let remedy = "leave out --perspective or the bar";
            return Err(Error::argument("--scale-bar", "with --perspective", "a parallel projection", remedy));
        }
        let (width, height) = self.args.seen.size;
        let aspect = width as f64 / height as f64;
        let units = (camera.ray(0.0, 1.0, aspect).0 - camera.ray(0.0, -1.0, aspect).0).length() / height as f64;
        let (name, in_named) = bar_unit(self.volume.unit);
        let (length, pixels) = round_length(units * in_named, width as f64 * 0.2);
        let label = format!("{} {name}", text::number(length, 4));
        let scale = (height / 300).max(1);
        let (left, thick) = (width / 40 + 1, (height / 240).max(1));
        let bottom = height - (height / 30).max(thick + 1);
        let top = bottom.saturating_sub(font::height(&label, scale) + 2 * thick + scale);
        let ink = if brightness(image, left, top) > 0.2 { [0.0, 0.0, 0.0, 1.0] } else { [1.0; 4] };
        for x in 0..pixels as usize {
            for y in 0..thick {
                image.blend(left + x, bottom + y, ink);
            }
        }
        for y in 0..3 * thick {
            for x in 0..thick {
                image.blend(left + x, bottom + thick - y, ink);
                image.blend(left + pixels as usize - x, bottom + thick - y, ink);
            }
        }
        font::draw(image, left, top, &label, scale, ink);
        Ok(())
    }
}

/// Degrees of the environment that stand behind a parallel view.
const SKY_FIELD_OF_VIEW: f64 = 60.0;

/// The largest of 1, 2, 5 × 10^n units that `most` pixels hold, and its pixels.
fn round_length(units_per_pixel: f64, most: f64) -> (f64, f64) {
    let longest = units_per_pixel * most;
    let power = 10f64.powi(longest.log10().floor() as i32);
    let length = [5.0, 2.0, 1.0].map(|f| f * power).into_iter().find(|l| *l <= longest).unwrap_or(power);
    (length, length / units_per_pixel)
}

/// The unit that a bar is labelled in, and how many of it are a world unit: the nearest of those with a name, so that
/// bohr (0.529 Å) are shown in Å.
fn bar_unit(unit: LengthUnit) -> (&'static str, f64) {
    const NAMES: [(f64, &str); 6] = [(1e-10, "Å"), (1e-9, "nm"), (1e-6, "µm"), (1e-3, "mm"), (1e-2, "cm"), (1.0, "m")];
    let LengthUnit::Metres(metres) = unit else { return ("units", 1.0) };
    let away = |m: f64| (metres / m).ln().abs();
    let nearest = NAMES.into_iter().min_by(|a, b| away(a.0).total_cmp(&away(b.0)));
    nearest.map_or(("m", metres), |(m, name)| (name, if away(m) < 1e-9 { 1.0 } else { metres / m }))
}

/// Mean luminance of what lies under a label, transparent counted as white paper.
fn brightness(image: &Image, left: usize, top: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0f32);
    for y in (top..image.height()).step_by(2) {
        for x in (left..(left + image.width() / 5).min(image.width())).step_by(2) {
            let [r, g, b, a] = image.pixel(x, y);
            sum += (0.2126 * r + 0.7152 * g + 0.0722 * b) * a + 1.0 - a;
            count += 1.0;
        }
    }
    sum / count.max(1.0)
}

/// Radiance from a direction, linear between the pixels' centres: a picture, where [`LatLong::radiance`] is the light.
fn between_pixels(image: &LatLong, direction_in_probe: DVec3) -> [f32; 3] {
    let [x, y] = image.pixel_from_direction(direction_in_probe).map(|v| v - 0.5);
    let (column, row) = (x.floor(), y.floor());
    let (fx, fy) = ((x - column) as f32, (y - row) as f32);
    let pixel = |i: f64, j: f64| {
        let (w, h) = (image.width() as i64, image.height() as i64);
        image.row((j as i64).clamp(0, h - 1) as usize)[(i as i64).rem_euclid(w) as usize]
    };
    let corners = [
        (pixel(column, row), (1.0 - fx) * (1.0 - fy)),
        (pixel(column + 1.0, row), fx * (1.0 - fy)),
        (pixel(column, row + 1.0), (1.0 - fx) * fy),
        (pixel(column + 1.0, row + 1.0), fx * fy),
    ];
    std::array::from_fn(|c| corners.iter().map(|(p, w)| p[c] * w).sum())
}

/// Exposes a picture, bends it by a tone curve, and lays it over what is behind: linear colour and alpha of a pixel.
fn develop(picture: &Picture, factor: f32, tone: Tone, behind: &dyn Fn(usize, usize) -> [f32; 4]) -> Result<Image> {
    let pixels = picture.pixels.iter().enumerate().map(|(i, &[r, g, b, coverage])| {
        let background = behind(i % picture.width, i / picture.width);
        if coverage <= 0.0 {
            return background;
        }
        let colour = tone.apply([r, g, b].map(|v| v / coverage * factor));
        let alpha = coverage + background[3] * (1.0 - coverage);
        let mix = |c: usize| (colour[c] * coverage + background[c] * background[3] * (1.0 - coverage)) / alpha;
        [mix(0), mix(1), mix(2), alpha]
    });
    Image::new(picture.width, picture.height, pixels.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_round_and_fit() {
        for (units, most) in [(0.5, 200.0), (1e-6, 77.0), (3.0, 333.0)] {
            let (length, pixels) = round_length(units, most);
            assert!(pixels <= most && pixels > most / 2.51, "{length} {pixels}");
            let digit = length / 10f64.powf(length.log10().floor());
            assert!([1.0, 2.0, 5.0].iter().any(|d| (digit - d).abs() < 1e-9), "{length}");
        }
    }

    #[test]
    fn bars_are_labelled_in_units_with_a_name() {
        for (metres, name) in [(1e-10, "Å"), (1e-6, "µm"), (1e-3, "mm")] {
            assert_eq!(bar_unit(LengthUnit::Metres(metres)), (name, 1.0));
        }
        let (name, in_named) = bar_unit(LengthUnit::Metres(5.29177210903e-11));
        assert!(name == "Å" && (in_named - 0.529177210903).abs() < 1e-9, "{name} {in_named}");
        assert_eq!(bar_unit(LengthUnit::Unknown), ("units", 1.0));
    }

    #[test]
    fn tone_curves_rise_and_stay_within_bounds() {
        for tone in [Tone::None, Tone::Reinhard, Tone::Filmic] {
            let mut before = -1.0;
            for i in 0..200 {
                let [r, g, b] = tone.apply([0.05 * i as f32; 3]);
                assert!(r == g && g == b && (0.0..=1.0).contains(&r) && r >= before, "{tone:?} {i}");
                before = r;
            }
            assert_eq!(tone.apply([-1.0; 3]), [0.0; 3], "{tone:?}");
        }
        // Four times white is where the curve of Reinhard reaches 1.
        assert!((Tone::Reinhard.apply([4.0; 3])[0] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_sky_is_smooth_and_wraps_around() {
        let pixels = (0..8).map(|i| [i as f32; 3]).collect();
        let image = LatLong::new(4, 2, pixels).unwrap();
        let centre = image.direction_from_pixel(1.5, 0.5);
        assert!((between_pixels(&image, centre)[0] - 1.0).abs() < 1e-5);
        // At the seam, half of the last and half of the first column.
        let seam = image.direction_from_pixel(0.0, 0.5);
        assert!((between_pixels(&image, seam)[0] - 1.5).abs() < 1e-5);
    }
}
