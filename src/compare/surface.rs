//! A surface under a light, and what each link of the chain says of it.

use super::slow::{TexelLight, trilinear};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::relight::{
    Contracted, Light, LookupReport, LuminaireLight, Material, Textures, TriangleIndex, TriangleOrder, VertexRadiance,
    contract,
};
use crate::sampling::DirectionalSource;
use crate::scene::geometry::Geometry;
use crate::sh::Coefficients;
use crate::surface::Mesh;
use crate::transfer::{BrickSource, Lattice, Layers, Layout, Selection, texels_of_isosurface};
use crate::transport::{
    Bake, Radiance, SceneReference, Settings, SpecularLight, SurfacePoint, SurfacePoints, buried, direct, estimates,
};
use crate::volume::Volume;
use std::collections::BTreeMap;

/// An isosurface under a light, at whose points radiance is compared.
#[derive(Clone, Copy)]
pub struct LitSurface<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// What stands around it: walls, luminaires and other volumes; none for a volume alone.
    pub geometry: Option<&'a Geometry>,
    /// Whether textures hold the light of luminaires by way of mirrors and glass.
    pub caustics: bool,
    /// What of it they hold from photons.
    pub specular: Option<&'a dyn SpecularLight>,
    /// In the file's values.
    pub isovalue: f64,
    /// Where radiance is compared; of several volumes those that no other buries ([`unburied`]).
    pub points: &'a [SurfacePoint],
    /// The whole light of the environment.
    pub light: &'a dyn DirectionalSource,
    /// The same light cut to the bands of the texture, in world axes.
    pub coefficients: &'a [Coefficients; 3],
    /// Diffuse reflectance of each channel.
    pub albedo: [f32; 3],
    /// Radiance that the surface emits.
    pub emission: [f32; 3],
    /// Factors on the power of the luminaires, in their order; those not given are 1.
    pub scales: &'a [[f64; 3]],
    /// The mesh whose vertices textures may be of ([`Lattice::of_vertices`]); none where all have texels.
    pub vertices: Option<&'a Vertices>,
}

/// The mesh of an isosurface whose vertices have transfer of their own.
pub struct Vertices {
    mesh: Mesh,
    sorted: TriangleOrder,
    points: SurfacePoints,
}

impl Vertices {
    /// A mesh with normals, of an isovalue in the file's values.
    pub fn new(isovalue: f64, mesh: Mesh) -> Self {
        let (positions_in_grid, normals) = (mesh.positions_in_grid.clone(), mesh.normals.clone());
        let points = SurfacePoints { isovalue, positions_in_grid, normals, own: Vec::new() };
        Self { sorted: TriangleOrder::new(&mesh), mesh, points }
    }

    /// As textures of its vertices have it.
    pub fn lattice(&self) -> Lattice {
        Lattice::of_vertices(self.mesh.positions_in_grid.len())
    }

    /// Its triangles by the cells that hold them.
    pub(super) fn index(&self) -> TriangleIndex<'_> {
        TriangleIndex::new(&self.mesh, &self.sorted)
    }
}

/// Those of some points of an isosurface that no volume beside it buries.
pub fn unburied(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: Option<&Geometry>,
    isovalue: f64,
    points: Vec<SurfacePoint>,
) -> Vec<SurfacePoint> {
    let Some(geometry) = geometry.filter(|geometry| !geometry.partners().is_empty()) else { return points };
    let buried = buried(volume, pyramid, geometry, isovalue, &points);
    points.into_iter().zip(buried).filter(|(_, buried)| !buried).map(|(point, _)| point).collect()
}

/// Transfer of single texels, each with a vector for each group ([`Bake::groups`]).
pub(crate) type Texels = BTreeMap<[usize; 3], Vec<Vec<f32>>>;

impl LitSurface<'_> {
    /// Refuses a surface without points.
    pub(crate) fn check(&self) -> Result<()> {
        match self.points.is_empty() {
            true => Err(Error::argument("points", 0, "at least one point of a surface", "give another isovalue")),
            false => Ok(()),
        }
    }

    /// Radiance at the points by paths under each of `environments`, and the rays that it took.
    ///
    /// # Errors
    /// As [`direct`].
    pub fn by_paths(
        &self,
        environments: &[&dyn DirectionalSource],
        paths: u32,
        seed: u64,
    ) -> Result<(Vec<Vec<Radiance>>, u64)> {
        let (emission, scales) = (self.emission, self.scales.to_vec());
        let settings = SceneReference { emission, scales, ..SceneReference::new(paths, self.albedo, seed) };
        let (volume, pyramid, geometry) = (self.volume, self.pyramid, self.geometry);
        let (found, counts) = direct(volume, pyramid, geometry, self.isovalue, self.points, environments, &settings)?;
        Ok((found, counts.path_rays + counts.light_rays))
    }

    /// What a user gets at the points from textures, one a group, through contraction and lookup, under light of some
    /// bands.
    ///
    /// # Errors
    /// As the textures; an albedo that is none; more or fewer textures than groups.
    pub fn by_textures(
        &self,
        textures: &[&dyn BrickSource],
        light: &[Coefficients; 3],
    ) -> Result<(Vec<[f64; 3]>, LookupReport)> {
        let light = &Light::from_channels(light)?;
        let material = Material::new(self.albedo, self.emission)?;
        let contracted = self.contracted(textures, light, &material)?;
        let positions: Vec<[f32; 3]> = self.points.iter().map(|p| p.position_in_grid).collect();
        let normals: Vec<[f32; 3]> = self.points.iter().map(|p| p.normal).collect();
        let at_vertices = textures.first().is_some_and(|texture| texture.layout().lattice.is_of_vertices());
        let lit = match self.vertices.filter(|_| at_vertices) {
            Some(vertices) => {
                let (index, mut report) = (vertices.index(), LookupReport::default());
                let places = positions.iter().zip(&normals);
                let radiance = places.map(|(&position, &normal)| {
                    contracted.between_vertices(&index, position, normal, light, &material, &mut report)
                });
                VertexRadiance { radiance: radiance.collect(), report }
            }
            None => contracted.look_up(&positions, &normals, light, &material),
        };
        if lit.report.unbaked > 0 {
            let LookupReport { unbaked, lookups, .. } = lit.report;
            return Err(Error::argument(
                "isovalue",
                format!("{}: {unbaked} of {lookups} lookups meet texels that were never baked", self.isovalue),
                "an isovalue that the store holds",
                "bake it into the store first",
            ));
        }
        Ok((lit.radiance.iter().map(|v| v.map(f64::from)).collect(), lit.report))
    }

    /// The texels of the surface under a light.
    fn contracted(&self, textures: &[&dyn BrickSource], light: &Light, material: &Material) -> Result<Contracted> {
        let strengths = self.strengths();
        let textures = match textures {
            [alone] => Textures::of_volume(*alone)?,
            [environment, emission, luminaires @ ..] if luminaires.len() == strengths.len() => {
                let each = luminaires.iter().zip(strengths);
                let luminaires: Vec<LuminaireLight<'_>> =
                    each.map(|(texture, factor)| LuminaireLight { texture: *texture, factor }).collect();
                Textures::of_scene(*environment, *emission, &luminaires)?
            }
            _ => {
                let remedy = "give that of each group of the store, in their order";
                let expected = format!("{}: of environment, emission and each luminaire", 2 + strengths.len());
                return Err(Error::argument("textures", format!("{} of them", textures.len()), expected, remedy));
            }
        };
        let lattice = textures.layout().lattice;
        let bricks = match lattice.is_of_vertices() {
            true => Selection::all(lattice).bricks(),
            false => texels_of_isosurface(self.volume, lattice, self.isovalue).bricks(),
        };
        contract(&textures, &bricks, light, material)
    }

    /// Of each luminaire the factor on what its texture holds: that on its power, and that of its storage.
    fn strengths(&self) -> Vec<[f64; 3]> {
        let exponents = self.geometry.map_or(Vec::new(), |geometry| geometry.exponents(self.volume));
        let scale = |l: usize| self.scales.get(l).copied().unwrap_or([1.0; 3]);
        exponents.iter().enumerate().map(|(l, &e)| scale(l).map(|s| s * libm::ldexp(1.0, e))).collect()
    }

    /// What the transfer of single texels is multiplied with, under light of some bands.
    pub(crate) fn texel_light<'l>(&self, light: &'l [Coefficients; 3]) -> TexelLight<'l> {
        TexelLight { light, albedo: self.albedo, emission: self.emission, luminaires: self.strengths() }
    }

    /// These layers with the channels that a texture of the surface has.
    pub(crate) fn layers_of(&self, layers: Layers) -> Layers {
        if self.geometry.is_some() { layers.coloured() } else { layers }
    }

    /// What a lookup at a point reads, with weights: texels, or vertices.
    pub(crate) fn around(&self, lattice: Lattice, point: &SurfacePoint) -> Vec<([usize; 3], f64)> {
        let Some(vertices) = self.vertices.filter(|_| lattice.is_of_vertices()) else {
            return trilinear(lattice, point.position_in_grid);
        };
        let Some((triangle, weights)) = vertices.index().nearest(point.position_in_grid) else { return Vec::new() };
        let each = triangle.iter().zip(weights).filter(|(_, w)| *w > 0.0);
        each.map(|(&v, w)| ([v as usize, 0, 0], f64::from(w))).collect()
    }

    /// Texels, each with its number of paths, as `path` makes them, unrounded; those with a level set.
    pub(crate) fn texels(&self, layout: &Layout, settings: &Settings, wanted: &[([usize; 3], u32)]) -> Result<Texels> {
        let selection = Selection::empty(layout.lattice);
        let found = estimates(&self.bake(layout, settings, &selection), wanted)?;
        let valid = wanted.iter().zip(found).filter_map(|((texel, _), found)| Some((*texel, found?)));
        Ok(valid.map(|(texel, groups)| (texel, groups.into_iter().map(|g| g.transfer).collect())).collect())
    }

    /// A bake of texels of the volume, among what stands around it.
    pub(crate) fn bake<'b>(&'b self, layout: &'b Layout, settings: &'b Settings, selection: &'b Selection) -> Bake<'b> {
        let alone = Bake::new(self.volume, self.pyramid, layout, settings, selection);
        let of_vertices = layout.lattice.is_of_vertices();
        let points = self.vertices.filter(|_| of_vertices).map(|vertices| &vertices.points);
        Bake { caustics: self.caustics, specular: self.specular, points, ..alone.among(self.geometry) }
    }
}
