//! Surfaces ready to be lit: isosurfaces of all volumes of a session, and the bricks that their lookups read.

use super::among::LitByPaths;
use super::lit::OfSuns;
use super::textures::{check_factors_of_nodes, radiance_of_bricks, settled};
use super::{Isosurface, Lighting, Lit, LitOptions, LitTexels, LuminaireFactor, Session};
use crate::error::Result;
use crate::geom::Bounds;
use crate::level::bytes_of_field;
use crate::relight::{Contracted, Exposure, LayerFactors, Material, TriangleIndex, TriangleOrder};
use crate::render::{SunLit, Surroundings, bytes_of_suns};
use crate::surface::Mesh;
use crate::transfer::{BRICK_TEXELS, Lattice, texels_of_isosurface};
use crate::volume::Volume;
use glam::Vec3;
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

/// An isosurface of a member, and where its lookups read.
pub struct Part {
    pub(super) isosurface: Isosurface,
    bricks: Vec<[usize; 3]>,
    below_a_texel: f64,
    triangles: OnceLock<TriangleOrder>,
}

impl Part {
    pub(super) fn new(volume: &Volume, lattice: Lattice, isosurface: Isosurface) -> Self {
        if let Some(transfer) = isosurface.transfer() {
            let [bricks, ..] = transfer.layout().lattice.bricks();
            let bricks = (0..bricks).map(|b| [b, 0, 0]).collect();
            return Self { isosurface, bricks, below_a_texel: 0.0, triangles: OnceLock::new() };
        }
        let bricks = texels_of_isosurface(volume, lattice, isosurface.isovalue()).bricks();
        let below_a_texel = below_a_texel(isosurface.mesh(), lattice);
        Self { isosurface, bricks, below_a_texel, triangles: OnceLock::new() }
    }

    /// The triangles between its vertices, where these have transfer of their own.
    pub(super) fn triangles(&self) -> Option<TriangleIndex<'_>> {
        self.isosurface.transfer().map(|_| self.all_triangles())
    }

    /// The triangles between its vertices.
    pub(super) fn all_triangles(&self) -> TriangleIndex<'_> {
        let mesh = self.isosurface.mesh();
        TriangleIndex::new(mesh, self.triangles.get_or_init(|| TriangleOrder::new(mesh)))
    }

    /// The isosurface.
    pub fn isosurface(&self) -> &Isosurface {
        &self.isosurface
    }

    /// Bricks that lookups on it read.
    #[doc(hidden)]
    pub fn bricks(&self) -> &[[usize; 3]] {
        &self.bricks
    }

    /// Share of the vertices where the surface bends too much within a texel, of a texture coarser than the data.
    #[doc(hidden)]
    pub fn below_a_texel(&self) -> f64 {
        self.below_a_texel
    }
}

/// Share of the vertices in cells of a coarse texture within which normals differ so much that their mean is shorter
/// than 0.8: what they cover is then a cap of more than 53° about its middle, or two sides of a thin shell. 0 for a
/// texture that is as fine as the data.
fn below_a_texel(mesh: &Mesh, lattice: Lattice) -> f64 {
    const SHORTEST_MEAN: f32 = 0.8;
    let steps = [0, 1, 2].map(|axis| lattice.step(axis));
    if steps.iter().all(|&step| step <= 1.0) || mesh.normals.is_empty() {
        return 0.0;
    }
    let mut cells: HashMap<[u32; 3], (Vec3, u32)> = HashMap::new();
    for (position, normal) in mesh.positions_in_grid.iter().zip(&mesh.normals) {
        let cell = std::array::from_fn(|a| (f64::from(position[a]) / steps[a].max(1.0)) as u32);
        let (sum, count) = cells.entry(cell).or_default();
        (*sum, *count) = (*sum + Vec3::from_array(*normal), *count + 1);
    }
    let bent = cells.values().filter(|(sum, count)| sum.length() < SHORTEST_MEAN * *count as f32);
    bent.map(|(_, count)| f64::from(*count)).sum::<f64>() / mesh.normals.len() as f64
}
/// The isosurfaces of all members of a session that are lit together.
pub struct Surface<'s> {
    pub(super) session: &'s Session<'s>,
    // Invariant: one for each member.
    pub(super) parts: Arc<Vec<Part>>,
}

impl<'s> Surface<'s> {
    pub(super) fn new(session: &'s Session<'s>, parts: Arc<Vec<Part>>) -> Self {
        Self { session, parts }
    }

    /// The isosurface of each member.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Vertices of all parts.
    pub fn vertices(&self) -> usize {
        self.parts.iter().map(|part| part.isosurface.positions().len()).sum()
    }

    /// Bytes that lighting it by at most so many lamps apart takes, about: the volumes with their pyramids, the contracted bricks, and the meshes with
    /// their colours, once more while they are written.
    #[doc(hidden)]
    pub fn bytes_of_lighting(&self, lamps: usize) -> u64 {
        // Radiance, weight and standard error of a texel; two positions, two normals, radiance, colour, error and what
        // is written of a vertex; a triangle, twice.
        const TEXEL: u64 = 20;
        const VERTEX: u64 = 4 * 12 + 12 + 12 + 4 + 12 + 12 + 8 + 16;
        const TRIANGLE: u64 = 24;
        // Where paths light a vertex: its place, radiance and counts.
        const OF_PATHS: u64 = 256;
        let bytes = |(number, part): (usize, &Part)| {
            let field = bytes_of_field(self.session.members()[number].volume());
            let contracted = part.bricks.len() as u64 * BRICK_TEXELS as u64 * TEXEL;
            let (vertices, triangles) = (part.isosurface.positions().len(), part.isosurface.mesh().triangles.len());
            let mesh = vertices as u64 * VERTEX + triangles as u64 * TRIANGLE;
            let of_suns = match self.session.around(number) {
                _ if lamps == 0 => 0,
                Ok(None) => bytes_of_suns(vertices, lamps),
                _ => vertices as u64 * OF_PATHS,
            };
            field + contracted + mesh + of_suns
        };
        self.parts.iter().enumerate().map(bytes).sum()
    }

    /// Multiplies light and transfer, at the texels that lookups read; lamps that are lit apart light the
    /// vertices by rays, and unless the transfer has direct light alone, by what the surface reflects of them.
    ///
    /// # Errors
    /// As [`radiance_of_bricks`]; a material that is none ([`Material::new`]); lamps apart where these cannot be ([`Session::light`]).
    pub fn contract<'t>(
        &'t self,
        lighting: &'t Lighting<'t>,
        material: &Material,
        luminaires: &[LuminaireFactor],
    ) -> Result<LitTexels<'t>> {
        // Its fields are open to whoever writes them.
        Material::new(material.albedo, material.emission)?;
        let all = self.parts.iter().zip(self.session.members());
        let all = all.map(|(part, member)| {
            let transfer = part.isosurface.transfer().unwrap_or(member.store());
            radiance_of_bricks(transfer, &part.bricks, lighting, material, luminaires)
        });
        let (members, clamped): (Vec<Contracted>, _) = all.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let material = settled(self.session.members()[0].store(), material);
        let parts = self.parts.iter().zip(self.session.members()).zip(&members);
        let suns = parts.enumerate().map(|(number, ((part, member), contracted))| {
            if lighting.suns.is_empty() {
                return Ok(None);
            }
            let layers = &part.isosurface.transfer().unwrap_or(member.store()).layout().layers;
            let reflects = layers.len() > 1 && !member.store().identity().estimator.ignores_shadows();
            let (mesh, triangles) = (part.isosurface.mesh(), &part.all_triangles());
            let (volume, pyramid, isovalue) = (member.volume(), member.pyramid(), part.isosurface.isovalue());
            if let Some(geometry) = self.session.around(number)? {
                let albedo = material.albedo;
                let among = LitByPaths { volume, pyramid, geometry, isovalue, albedo, reflects };
                let places = (&*mesh.positions_in_grid, &*mesh.normals);
                let reflected = among.lit(&lighting.suns, places, contracted.noise.mean_radiance)?;
                let rays = reflected.rays;
                return Ok(Some(OfSuns { seen: Vec::new(), reflected, rays }));
            }
            let surface = Surroundings { volume, pyramid, isovalue, triangles };
            let lit = SunLit::new(surface, &lighting.suns, &material, reflects);
            let reflected = lit.reflected(&mesh.positions_in_grid, &mesh.normals, contracted.noise.mean_radiance)?;
            let rays = lit.rays() + reflected.rays;
            Ok(Some(OfSuns { seen: lit.seen, reflected, rays }))
        });
        let suns = suns.collect::<Result<_>>()?;
        Ok(LitTexels { surface: self, lighting, material, suns, luminaires: luminaires.to_vec(), members, clamped })
    }

    /// Lights it: [`Self::contract`], [`LitTexels::look_up`] at the vertices, and [`Lit::with_total_error`].
    ///
    /// # Errors
    /// As those two.
    pub fn lit<'t>(&'t self, lighting: &'t Lighting<'t>, material: &Material, options: &LitOptions) -> Result<Lit<'t>> {
        self.contract(lighting, material, &options.luminaires)?.look_up(options.exposure)?.with_total_error()
    }

    /// How far radiance is off where the albedo of a translucent solid's medium lies between the nodes of its transfer: at the node
    /// that stands apart to tell, the root mean square over the vertices of the difference between interpolation and what is stored
    /// there, over the mean radiance. `None` where nothing is interpolated.
    ///
    /// # Errors
    /// As [`Self::lit`].
    #[doc(hidden)]
    pub fn node_error(&self, lighting: &Lighting<'_>, luminaires: &[LuminaireFactor]) -> Result<Option<f64>> {
        let Some(session) = self.session.members().first() else { return Ok(None) };
        let Some((of_difference, of_check)) = check_factors_of_nodes(session.store()) else { return Ok(None) };
        let radiance = |layers: LayerFactors| -> Result<Vec<[f32; 3]>> {
            let material = Material { layers, ..Material::new([0.0; 3], [0.0; 3])? };
            let lit = self.contract(lighting, &material, luminaires)?.look_up(Exposure::Stops(0.0))?;
            Ok(lit.radiance().to_vec())
        };
        let (off, there) = (radiance(of_difference)?, radiance(of_check)?);
        let mean = there.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * there.len().max(1)) as f64;
        let square = off.iter().flatten().map(|&v| f64::from(v).powi(2)).sum::<f64>() / (3 * off.len().max(1)) as f64;
        Ok((mean > 0.0).then(|| square.sqrt() / mean))
    }

    /// The box of all volumes in world.
    pub(super) fn bounds(&self) -> Bounds {
        self.session.members().iter().fold(Bounds::EMPTY, |bounds, member| {
            let own = member.volume().world_bounds();
            bounds.including(own.min).including(own.max)
        })
    }
}

/// Positions, normals and triangles of several surfaces as one, in the order in which [`Lit`] has their vertices.
pub struct Merged {
    /// The box of all volumes in world.
    pub bounds: Bounds,
    /// In world, relative to the centre of the box.
    pub positions: Vec<Vec3>,
    /// In world.
    pub normals: Vec<Vec3>,
    /// Three vertices each, counter-clockwise from the lit side.
    pub triangles: Vec<[u32; 3]>,
}

impl Merged {
    /// Puts the parts of a surface together.
    pub fn new(surface: &Surface<'_>) -> Self {
        let bounds = surface.bounds();
        let mut merged = Self { bounds, positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
        for (part, member) in surface.parts.iter().zip(surface.session.members()) {
            let isosurface = &part.isosurface;
            let first = merged.positions.len() as u32;
            let shift = member.volume().world_bounds().centre() - bounds.centre();
            merged.positions.extend(isosurface.positions().iter().map(|p| (p.as_dvec3() + shift).as_vec3()));
            merged.normals.extend(isosurface.normals());
            merged.triangles.extend(isosurface.mesh().triangles.iter().map(|t| t.map(|i| first + i)));
        }
        merged
    }
}
