//! Pictures of lit surfaces: among walls and other surfaces, before a background, exposed and bent by a tone curve.

use super::haze::Haze;
use super::lit::check_baked;
use super::textures::factor_of;
use super::walls::{WallQuestion, Walls, in_view};
use super::{Lit, LitTexels, Member, Part, Tone, scale_bar};
use crate::error::{Error, Result};
use crate::export::Image;
use crate::geom::{Bounds, Up};
use crate::level::Counts;
use crate::probe::LatLong;
use crate::relight::{Contracted, LookupReport, Material, TriangleIndex, without_negative};
use crate::render::{Camera, Picture, Projection, RenderOptions, Subject, View, radiance_along, render};
use crate::srgb;
use glam::{DMat3, DVec3};
use std::str::FromStr;

/// How a surface is pictured.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PictureOptions {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Where the camera stands.
    pub view: View,
    /// Parallel or perspective.
    pub projection: Projection,
    /// What the camera has in view.
    pub framing: Framing,
    /// Whether the cut of the box through the solid is drawn as a flat face; else the surface has an open edge there,
    /// as meshes have it.
    pub cap: bool,
    /// Rays along each side of a pixel, at least 1.
    pub supersampling: usize,
    /// What is behind the surface.
    pub background: Background,
    /// From exposed radiance to colour.
    pub tone: Tone,
    /// Whether to draw a bar of a round length; of parallel projections alone.
    pub scale_bar: bool,
    /// Most paths of what is seen of the walls of a scene: for each point of a grid on them, or pixel.
    pub wall_paths: u32,
}

impl PictureOptions {
    /// Most pixels of a side.
    pub const MOST_SIDE: usize = 16_384;
    /// Most rays along each side of a pixel.
    pub const MOST_SUPERSAMPLING: usize = 16;
}

impl Default for PictureOptions {
    /// A raised three-quarter view in parallel projection, 960 × 720, before dark grey.
    fn default() -> Self {
        let [r, g, b] = [0x2c, 0x30, 0x36].map(srgb::linear_from_byte);
        Self {
            width: 960,
            height: 720,
            view: View { azimuth: 35.0, elevation: 25.0 },
            projection: Projection::Orthographic,
            framing: Framing::Surface,
            cap: true,
            supersampling: 2,
            background: Background::Colour([r, g, b, 1.0]),
            tone: Tone::None,
            scale_bar: false,
            wall_paths: 64,
        }
    }
}

/// What a camera has in view of a volume without walls beside it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Framing {
    /// The surface.
    #[default]
    Surface,
    /// The whole box of the volume, so that pictures of several isovalues stay in register.
    Box,
    /// The box however it is turned about up: the size of what is seen is the same from every side.
    Turntable,
}

/// What is behind the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Linear, with alpha.
    Colour([f32; 4]),
    /// The environment that lights it.
    Environment,
}

impl FromStr for Background {
    /// What to give instead.
    type Err = String;

    /// Reads white, black, transparent, environment, or #rrggbb (sRGB).
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let hex =
            |i: usize| text.get(i..i + 2).and_then(|h| u8::from_str_radix(h, 16).ok()).map(srgb::linear_from_byte);
        let colour = match text {
            "environment" => return Ok(Background::Environment),
            "white" => [1.0; 4],
            "black" => [0.0, 0.0, 0.0, 1.0],
            "transparent" => [0.0; 4],
            _ => match (text.len(), text.starts_with('#'), hex(1), hex(3), hex(5)) {
                (7, true, Some(r), Some(g), Some(b)) => [r, g, b, 1.0],
                _ => return Err("give white, black, transparent, environment, or #rrggbb".into()),
            },
        };
        Ok(Background::Colour(colour))
    }
}

impl Background {
    /// Whether something of it lets through.
    #[doc(hidden)]
    pub fn is_transparent(self) -> bool {
        matches!(self, Self::Colour([.., alpha]) if alpha < 1.0)
    }
}

/// A picture and how it came about.
#[derive(Clone, Debug)]
pub struct Still {
    /// The picture.
    pub image: Image,
    /// Camera rays, apart from the rays of the transport.
    pub counts: Counts,
    /// How the lookups went.
    pub report: LookupReport,
    /// Whether its background lets something through.
    pub is_transparent: bool,
}

impl Lit<'_> {
    /// A picture of it, with the exposure of its vertices.
    ///
    /// # Errors
    /// As [`LitTexels::picture`].
    pub fn picture(&self, options: &PictureOptions) -> Result<Still> {
        self.texels.picture(self.exposure, options)
    }
}

impl LitTexels<'_> {
    /// A picture of the surface; `exposure` is the factor from radiance to colour.
    ///
    /// # Errors
    /// [`Error::Unbaked`] when the store does not have the texels of the surface; [`Error::Argument`] for a picture
    /// without pixels or of more than [`PictureOptions`] says, a view that is none, and a scale bar in perspective.
    pub fn picture(&self, exposure: f32, options: &PictureOptions) -> Result<Still> {
        Stage { texels: self, exposure, options }.still()
    }
}

/// What lamps bring to the vertices of a mesh.
type OfLamps<'a> = Option<(&'a TriangleIndex<'a>, &'a [[f32; 3]])>;

/// A surface and a camera.
struct Stage<'a> {
    texels: &'a LitTexels<'a>,
    exposure: f32,
    options: &'a PictureOptions,
}

impl<'a> Stage<'a> {
    fn still(&self) -> Result<Still> {
        let options = self.options;
        if options.width == 0 || options.height == 0 {
            let given = format!("{} × {} pixels", options.width, options.height);
            return Err(Error::argument("picture", given, "at least one pixel each way", "give a larger size"));
        }
        let (sides, rays) = (PictureOptions::MOST_SIDE, PictureOptions::MOST_SUPERSAMPLING);
        if options.width.max(options.height) > sides {
            let given = format!("{} × {} pixels", options.width, options.height);
            return Err(Error::argument("picture", given, format!("at most {sides} each way"), "give a smaller size"));
        }
        if options.supersampling > rays {
            let given = options.supersampling;
            return Err(Error::argument("supersampling", given, format!("at most {rays}"), "2 is usual, 4 is smooth"));
        }
        let View { azimuth, elevation } = options.view;
        if !(azimuth.is_finite() && elevation.is_finite()) {
            let given = format!("{azimuth}, {elevation}");
            return Err(Error::argument("view", given, "finite degrees", "give azimuth and elevation"));
        }
        if let Projection::Perspective(degrees) = options.projection
            && !(degrees > 0.0 && degrees < 180.0)
        {
            return Err(Error::argument("perspective", degrees, "degrees above 0 and below 180", "40 is usual"));
        }
        if options.scale_bar && matches!(options.projection, Projection::Perspective(_)) {
            let remedy = "lengths have no one scale in perspective: leave out the bar";
            return Err(Error::argument("scale bar", "a perspective view", "a parallel projection", remedy));
        }
        let camera = self.camera();
        let mut picture = self.picture(&camera)?;
        self.add_haze(&mut picture, &camera)?;
        let (part, member) = self.first();
        check_baked(member.store(), part.isosurface.isovalue(), &picture.report)?;
        let mut image = match options.background {
            Background::Colour(colour) => develop(&picture, self.exposure, options.tone, &|_, _| colour)?,
            Background::Environment => develop(&picture, self.exposure, options.tone, &self.sky()?)?,
        };
        if options.scale_bar {
            scale_bar::draw(&mut image, &camera, member.volume().unit);
        }
        let is_transparent = options.background.is_transparent();
        Ok(Still { image, counts: picture.counts, report: picture.report, is_transparent })
    }

    fn up(&self) -> Up {
        self.texels.surface.session.up()
    }

    fn aspect(&self) -> f64 {
        self.options.width as f64 / self.options.height as f64
    }

    /// The first volume with its surface.
    fn first(&self) -> (&'a Part, &'a Member<'a>) {
        let surface = self.texels.surface;
        (&surface.parts[0], &surface.session.members()[0])
    }

    /// The others, with the radiance of their texels.
    fn others(&self) -> impl Iterator<Item = ((&'a Part, &'a Member<'a>), &'a Contracted)> + Clone {
        let surface = self.texels.surface;
        surface.parts.iter().zip(surface.session.members()).zip(&self.texels.members).skip(1)
    }

    /// The camera; where there are walls or several volumes, all of them in view.
    fn camera(&self) -> Camera {
        let PictureOptions { view, projection, framing, .. } = *self.options;
        let aspect = self.aspect();
        let (part, member) = self.first();
        let (volume, isosurface) = (member.volume(), &part.isosurface);
        match in_view(self.texels.surface.session.geometry(), volume, self.together()) {
            Some(_) if self.shows_lobes() => {
                let others = self.others().flat_map(|((part, member), _)| part.isosurface.seen(member.volume()));
                let points = isosurface.seen(volume).chain(others);
                Camera::framing_points(points, self.up(), view, projection, aspect)
            }
            Some(bounds) => Camera::framing(&bounds, self.up(), view, projection, aspect),
            None => match framing {
                Framing::Surface => isosurface.camera(volume, self.up(), view, projection, aspect),
                Framing::Box => Camera::framing(&volume.world_bounds(), self.up(), view, projection, aspect),
                Framing::Turntable => {
                    let points = corners_of_turns(volume.world_bounds(), self.up());
                    Camera::framing_points(points, self.up(), view, projection, aspect)
                }
            },
        }
    }

    /// The surface, among the walls of its scene.
    fn picture(&self, camera: &Camera) -> Result<Picture> {
        let (texels, (part, member)) = (self.texels, self.first());
        let (volume, pyramid, isovalue) = (member.volume(), member.pyramid(), part.isosurface.isovalue());
        let (lighting, material) = (texels.lighting, &texels.material);
        let PictureOptions { width, height, supersampling, cap, .. } = *self.options;
        let options = &RenderOptions { width, height, supersampling, cap };
        let (contracted, own) = (&texels.members[0], &tinted(material, member));
        let triangles = part.triangles();
        let (light, triangles) = (&lighting.light, triangles.as_ref());
        let reflected = self.of_lamps(0);
        let reflected = reflected.as_ref().map(|(index, radiance)| (index, *radiance));
        let subject = Subject { volume, pyramid, isovalue, contracted, triangles, light, material: own, reflected };
        let geometry = texels.surface.session.geometry();
        if geometry.is_none() && texels.surface.parts.len() == 1 {
            return Ok(render(&subject, &lighting.suns, None, camera, options));
        }
        let question = WallQuestion { volume, pyramid, isovalue, material, rays: self.options.wall_paths };
        let walls = geometry
            .map(|geometry| Walls::new(geometry, &question, camera, options, lighting, &texels.luminaires))
            .transpose()?;
        let others: Vec<_> = (1..texels.members.len()).map(|number| self.of_lamps(number)).collect();
        let backdrop = |origin, direction, limit, pixel| {
            let (mut found, mut limit): (Option<[f32; 3]>, f64) = (None, limit);
            for ((other, contracted), lamps) in self.others().zip(&others) {
                let lamps = lamps.as_ref().map(|(index, radiance)| (index, *radiance));
                if let Some((rgb, distance)) =
                    self.seen(other, (contracted, lamps), (camera, options), (origin, direction))
                    && distance < limit
                {
                    (found, limit) = (Some(rgb), distance);
                }
            }
            walls.as_ref().and_then(|walls| walls.seen(origin, direction, limit, pixel)).or(found)
        };
        Ok(render(&subject, &[], Some(&backdrop), camera, options))
    }

    /// What lamps that are lit apart bring to the vertices of a part and no ray of the camera finds.
    fn of_lamps(&self, number: usize) -> Option<(TriangleIndex<'a>, &'a [[f32; 3]])> {
        let part = self.texels.surface.parts.get(number)?;
        let suns = self.texels.suns.get(number)?.as_ref()?;
        Some((part.all_triangles(), &*suns.reflected.radiance))
    }

    /// Lays media over the picture.
    fn add_haze(&self, picture: &mut Picture, camera: &Camera) -> Result<()> {
        let texels = self.texels;
        let Some(geometry) = texels.surface.session.geometry().filter(|g| !g.media().is_empty()) else {
            return Ok(());
        };
        let (part, member) = self.first();
        let scales = geometry.luminaires().iter().map(|l| factor_of(&l.name, &texels.luminaires)).collect();
        let haze = Haze {
            volume: member.volume(),
            pyramid: member.pyramid(),
            geometry,
            isovalue: part.isosurface.isovalue(),
            material: &texels.material,
            lighting: texels.lighting,
            scales,
        };
        haze.lay_over(picture, camera)
    }

    /// What a camera ray sees of another volume, and how far away.
    fn seen(
        &self,
        (part, member): (&Part, &Member<'_>),
        (contracted, reflected): (&Contracted, OfLamps<'_>),
        (camera, options): (&Camera, &RenderOptions),
        (origin, direction): (DVec3, DVec3),
    ) -> Option<([f32; 3], f64)> {
        let (volume, pyramid, isovalue) = (member.volume(), member.pyramid(), part.isosurface.isovalue());
        let (light, material) = (&self.texels.lighting.light, &tinted(&self.texels.material, member));
        let triangles = part.triangles();
        let triangles = triangles.as_ref();
        let subject = Subject { volume, pyramid, isovalue, contracted, triangles, light, material, reflected };
        radiance_along(&subject, camera, options, origin, direction)
    }

    /// Whether all surfaces are of one grid, without walls, and to be framed closely.
    fn shows_lobes(&self) -> bool {
        let bounds = self.first().1.volume().world_bounds();
        let has_walls =
            self.texels.surface.session.geometry().is_some_and(|geometry| geometry.bounds().min.is_finite());
        let is_one_grid = self.others().all(|((_, member), _)| member.volume().world_bounds() == bounds);
        is_one_grid && !has_walls && self.options.framing == Framing::Surface
    }

    /// The box of all volumes, where there are several.
    fn together(&self) -> Option<Bounds> {
        (self.texels.surface.parts.len() > 1).then(|| self.texels.surface.bounds())
    }

    /// The environment behind a pixel. Parallel rays would see one direction of it: behind them it is seen in
    /// perspective.
    fn sky(&self) -> Result<impl Fn(usize, usize) -> [f32; 4]> {
        let PictureOptions { width, height, view, projection, tone, .. } = *self.options;
        let aspect = self.aspect();
        let projection = match projection {
            Projection::Orthographic => Projection::Perspective(SKY_FIELD_OF_VIEW),
            perspective => perspective,
        };
        let camera = Camera::framing(&self.first().1.volume().world_bounds(), self.up(), view, projection, aspect);
        let lighting = self.texels.lighting;
        let probe_from_world = lighting.options.orientation(self.up())?.probe_from_world();
        let (exposure, image) = (self.exposure, &lighting.probe.image);
        Ok(move |x: usize, y: usize| {
            let px = (x as f64 + 0.5) / width as f64 * 2.0 - 1.0;
            let py = 1.0 - (y as f64 + 0.5) / height as f64 * 2.0;
            let (_, direction) = camera.ray(px, py, aspect);
            let [r, g, b] = tone.apply(between_pixels(image, probe_from_world * direction).map(|v| v * exposure));
            [r, g, b, 1.0]
        })
    }
}

/// Turns of the box that a turntable's camera has in view.
const TURNS: usize = 72;

/// The corners of a box at all its turns about up, in world.
fn corners_of_turns(bounds: Bounds, up: Up) -> impl Iterator<Item = DVec3> {
    let Bounds { min, max } = bounds;
    let centre = bounds.centre();
    (0..8 * TURNS).map(move |i| {
        let corner = [0, 1, 2].map(|a| if i >> a & 1 == 0 { min[a] } else { max[a] });
        let angle = std::f64::consts::TAU * (i / 8) as f64 / TURNS as f64;
        centre + turn_about(up.axis(), angle) * (DVec3::from_array(corner) - centre)
    })
}

/// The turn about a unit axis, by Rodrigues' formula.
fn turn_about(axis: DVec3, angle: f64) -> DMat3 {
    let (sine, cosine) = libm::sincos(angle);
    let turned = |v: DVec3| v * cosine + axis.cross(v) * sine + axis * (axis.dot(v) * (1.0 - cosine));
    DMat3::from_cols(turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z))
}

/// Degrees of the environment that stand behind a parallel view.
const SKY_FIELD_OF_VIEW: f64 = 60.0;

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
        let colour = tone.apply(without_negative([r, g, b].map(|v| v / coverage)).map(|v| v * factor));
        let alpha = coverage + background[3] * (1.0 - coverage);
        let mix = |c: usize| (colour[c] * coverage + background[c] * background[3] * (1.0 - coverage)) / alpha;
        [mix(0), mix(1), mix(2), alpha]
    });
    Image::new(picture.width, picture.height, pixels.collect())
}

/// The material of a volume with its own factor on the albedo, for what shows without transfer, which holds that factor.
fn tinted(material: &Material, member: &Member<'_>) -> Material {
    let tint = member.tint();
    Material { albedo: std::array::from_fn(|c| material.albedo[c] * tint[c]), ..*material }
}

#[cfg(test)]
mod tests {
    use super::*;

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
