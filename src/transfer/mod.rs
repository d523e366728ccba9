//! Transfer textures: the lattice of texels, the layout of coefficients, bricks, lookup, and
//! the store on disk. Knows nothing of how transfer was computed, and nothing of probes.
//!
//! # Texture lattice
//! Texel i of M along an axis with N samples sits at grid position i·(N−1)/(M−1);
//! M = max(2, round((N−1)·ratio)+1), and M = 1 if N = 1. Ratio 1 is the data lattice.
//!
//! # Layers and coefficients
//! T_k is the grey, albedo-free transfer of light that was reflected k times on its way:
//! exitant radiance is L_o = Σ_k ρ^(k+1) ⟨T_k, L⟩. Layer k holds bands² coefficients in the
//! order of [`crate::sh`], in world axes; a texel's vector is layer-major, coefficient fastest.
//!
//! # Bricks and chunks
//! A [`Brick`] is 8³ texels, the unit of work, of reading and of contraction; a chunk is 4³
//! bricks = 32³ texels, the unit of writing. Inside a brick x runs fastest. Bricks at the far
//! edges are full size; texels beyond the lattice are never read.
//!
//! # Surfaces
//! The vertices of a named isosurface hold transfer of their own, without interpolation between texels: a [`Lattice`]
//! of vertices in a row, in bricks of 512 and chunks of 4096. All that is said of texels holds for them.
//!
//! # Scenes
//! Where a volume stands among walls and luminaires, transfer has three channels ([`Layers::coloured`]): T_k is the
//! light that the level set reflected k times and coloured walls any number of times. Each luminaire has a texture of
//! its own, [`Group`]: one band a layer, whose number is the radiance that arrives, not a coefficient.
//!
//! A texel that was not baked holds NaN in all coefficients, one without a usable normal holds 0.

pub mod checks;
mod group;
mod isosurface;
mod octants;
pub mod precision;
mod selection;
pub mod store;
pub(crate) mod strides;
pub mod texture;

pub use group::Group;
pub use isosurface::{extents_by_chunk, texels_of_isosurface, texels_of_isosurfaces};
pub use octants::Octants;
pub use precision::{Precision, Steps};
pub use selection::Selection;
pub use texture::MemoryTexture;

use crate::error::{Error, Result};
use crate::grid3;
use half::f16;

/// Texels along the side of a brick.
pub const BRICK: usize = 8;
/// Texels in a brick.
pub const BRICK_TEXELS: usize = BRICK * BRICK * BRICK;
/// Texels along the side of a chunk.
pub const CHUNK: usize = 32;
/// Vertices of an isosurface in a chunk.
pub const CHUNK_VERTICES: usize = 4096;
/// Most layers a texture may have.
pub const MAX_LAYERS: usize = 16;

/// Albedo at which errors of transfer as a whole are stated, of packed stores and between texels; up to it their bound holds.
pub(crate) const WEIGHED_ALBEDO: f64 = 0.7;

/// Most texels of a lattice, 2^40: a bit each is 128 GiB, and a texel's largest vector (16 layers of 11 bands, 4 bytes
/// a number) times their number stays below 2^63, so that no size made of them overflows.
pub const MOST_TEXELS: u64 = 1 << 40;

/// Flags of a texel's validity byte.
pub mod validity {
    /// The texel has a level set with a usable normal.
    pub const VALID: u8 = 1;
    /// Its isovalue was moved inward, away from a local extreme of the data.
    pub const CLAMPED: u8 = 2;
    /// Its transfer was filled from neighbours.
    pub const FILLED: u8 = 4;
    /// Nothing can block its rays: the clamped cosine in closed form, of no rays and no error.
    pub const OPEN: u8 = 8;
}

/// Where the texels of a texture sit in the grid of a volume, and how they are cut into bricks and chunks; or the
/// vertices of an isosurface in their order, each of which takes the place of a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    grid: [usize; 3],
    texels: [usize; 3],
    of_vertices: bool,
}

impl Lattice {
    /// The lattice with `ratio` texels to a sample.
    ///
    /// # Errors
    /// When the ratio is not in (0, 1024], or the lattice would have more than [`MOST_TEXELS`].
    pub fn from_ratio(grid: [usize; 3], ratio: f64) -> Result<Self> {
        if !(ratio.is_finite() && ratio > 0.0 && ratio <= 1024.0) {
            return Err(Error::argument("texture", ratio, "a ratio in (0, 1024]", "1 is the resolution of the data"));
        }
        let axis = |n: usize| if n == 1 { 1 } else { (((n - 1) as f64 * ratio).round() as usize + 1).max(2) };
        Self::counted(grid, grid.map(axis))
    }

    /// The lattice with the given number of texels along each axis.
    ///
    /// # Errors
    /// When an axis has fewer than 2 texels while the grid has 2 samples or more, or not 1 where
    /// the grid has 1; when the lattice would have more than [`MOST_TEXELS`].
    pub fn from_texels(grid: [usize; 3], texels: [usize; 3]) -> Result<Self> {
        for a in 0..3 {
            if (grid[a] == 1 && texels[a] != 1) || (grid[a] > 1 && texels[a] < 2) {
                return Err(Error::argument(
                    "texture",
                    format!("{}x{}x{}", texels[0], texels[1], texels[2]),
                    "at least 2 texels along each axis of the data, 1 where the data has 1",
                    "give a larger resolution or a ratio such as 0.5",
                ));
            }
        }
        Self::counted(grid, texels)
    }

    /// The lattice, if its texels can be counted and addressed.
    fn counted(grid: [usize; 3], texels: [usize; 3]) -> Result<Self> {
        let count = texels.iter().try_fold(1u64, |n, &m| n.checked_mul(m as u64));
        if count.is_some_and(|n| n <= MOST_TEXELS) {
            return Ok(Self { grid, texels, of_vertices: false });
        }
        Err(Error::Limit {
            what: "the texture".into(),
            needed: format!("{}×{}×{} texels", texels[0], texels[1], texels[2]),
            limit: format!("{MOST_TEXELS} texels"),
            remedy: "lower --texture, or crop the volume".into(),
        })
    }

    /// The vertices of an isosurface in a row: bricks of [`BRICK_TEXELS`] of them, chunks of [`CHUNK_VERTICES`].
    pub fn of_vertices(count: usize) -> Self {
        Self { grid: [count, 1, 1], texels: [count, 1, 1], of_vertices: true }
    }

    /// Whether texels are the vertices of an isosurface.
    pub fn is_of_vertices(&self) -> bool {
        self.of_vertices
    }

    /// Texels of a brick along each axis.
    pub fn brick_shape(&self) -> [usize; 3] {
        if self.of_vertices { [BRICK_TEXELS, 1, 1] } else { [BRICK; 3] }
    }

    /// Texels of a chunk along each axis.
    pub fn chunk_shape(&self) -> [usize; 3] {
        if self.of_vertices { [CHUNK_VERTICES, 1, 1] } else { [CHUNK; 3] }
    }

    /// Bricks of a chunk along each axis.
    pub fn bricks_of_chunk(&self) -> [usize; 3] {
        let (chunk, brick) = (self.chunk_shape(), self.brick_shape());
        std::array::from_fn(|a| chunk[a] / brick[a])
    }

    /// The brick in a slot of a chunk.
    pub fn brick_in_chunk(&self, chunk: [usize; 3], slot: usize) -> [usize; 3] {
        let count = self.bricks_of_chunk();
        let inner = grid3::at([count[0], count[1]], slot);
        std::array::from_fn(|a| chunk[a] * count[a] + inner[a])
    }

    /// The texel at a place of a brick.
    pub fn texel_in_brick(&self, brick: [usize; 3], place: usize) -> [usize; 3] {
        let shape = self.brick_shape();
        let inner = grid3::at([shape[0], shape[1]], place);
        std::array::from_fn(|a| brick[a] * shape[a] + inner[a])
    }

    /// The brick of a texel, and its place there.
    pub fn place_of(&self, texel: [usize; 3]) -> ([usize; 3], usize) {
        let shape = self.brick_shape();
        let inner: [usize; 3] = std::array::from_fn(|a| texel[a] % shape[a]);
        (std::array::from_fn(|a| texel[a] / shape[a]), grid3::index([shape[0], shape[1]], inner))
    }

    /// Samples of the volume along each axis.
    pub fn grid(&self) -> [usize; 3] {
        self.grid
    }

    /// Texels along each axis.
    pub fn texels(&self) -> [usize; 3] {
        self.texels
    }

    /// Bricks along each axis.
    pub fn bricks(&self) -> [usize; 3] {
        let shape = self.brick_shape();
        std::array::from_fn(|a| self.texels[a].div_ceil(shape[a]))
    }

    /// Chunks along each axis.
    pub fn chunks(&self) -> [usize; 3] {
        let shape = self.chunk_shape();
        std::array::from_fn(|a| self.texels[a].div_ceil(shape[a]))
    }

    /// Samples from one texel to the next along `axis`.
    pub fn step(&self, axis: usize) -> f64 {
        let (n, m) = (self.grid[axis], self.texels[axis]);
        if m < 2 { 1.0 } else { (n - 1) as f64 / (m - 1) as f64 }
    }

    /// Grid position of a texel; of vertices, whose places the mesh has, their number.
    pub fn grid_from_texel(&self, texel: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|a| texel[a] as f64 * self.step(a))
    }
}

/// Number of bands of each layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layers {
    bands: Vec<usize>, // Invariant: 1…MAX_LAYERS entries, each in 1…sh::MAX_BANDS.
    channels: usize,   // Invariant: 1 (grey) or 3 (red, green, blue).
}

impl Layers {
    /// Layers with the given bands each.
    ///
    /// # Errors
    /// When there is no layer or more than [`MAX_LAYERS`], or a band count outside 1…11.
    pub fn new(bands: Vec<usize>) -> Result<Self> {
        let legal =
            (1..=MAX_LAYERS).contains(&bands.len()) && bands.iter().all(|b| (1..=crate::sh::MAX_BANDS).contains(b));
        if legal {
            Ok(Self { bands, channels: 1 })
        } else {
            Err(Error::argument(
                "bands",
                format!("{bands:?}"),
                "1 to 16 layers of 1 to 11 bands each",
                "use --layers 4 --bands 5, or one band count for each layer as in --bands 5,4,3,3",
            ))
        }
    }

    /// `layers` layers of `bands` bands.
    ///
    /// # Errors
    /// As [`Layers::new`].
    pub fn uniform(layers: usize, bands: usize) -> Result<Self> {
        Self::new(vec![bands; layers.min(MAX_LAYERS + 1)])
    }

    /// `layers` layers as they are baked when nobody asks for others: 8, 5, 4 and then 3 bands.
    ///
    /// Direct light has edges, and what is reflected is smooth: of the light that bands leave out most is lost in the first layer,
    /// and there its coefficients cost no rays. (`probes/record/2026-11-30-xeon-2core-bands`: half of what five bands in each layer leave out, for
    /// 114 numbers in the place of 100.)
    ///
    /// # Errors
    /// As [`Layers::new`].
    pub fn usual(layers: usize) -> Result<Self> {
        const FIRST: [usize; 3] = [8, 5, 4];
        Self::new((0..layers.min(MAX_LAYERS + 1)).map(|k| FIRST.get(k).copied().unwrap_or(3)).collect())
    }

    /// The same layers in red, green and blue, for scenes whose walls or luminaires have colours. A layer then holds
    /// its bands² red coefficients, then the green ones, then the blue ones.
    #[must_use]
    pub fn coloured(self) -> Self {
        Self { channels: 3, ..self }
    }

    /// The same layers in one channel.
    #[must_use]
    pub fn grey(self) -> Self {
        Self { channels: 1, ..self }
    }

    /// Colour channels: 1 where transfer is grey, else 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Bands of each layer.
    pub fn bands(&self) -> &[usize] {
        &self.bands
    }

    /// Number of stored layers.
    pub fn len(&self) -> usize {
        self.bands.len()
    }

    /// Never true: there is always a layer.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Most bands of any layer.
    pub fn max_bands(&self) -> usize {
        self.bands.iter().copied().max().unwrap_or(1)
    }

    /// Coefficients of one texel: channels · Σ bands².
    pub fn coefficients(&self) -> usize {
        self.channels * self.bands.iter().map(|b| b * b).sum::<usize>()
    }

    /// Entries of the standard error of one texel: Σ bands, one a layer and band.
    pub fn errors(&self) -> usize {
        self.bands.iter().sum()
    }

    /// w_k = 0.7^(k+1): what a coefficient of layer k does to radiance at an albedo of [`WEIGHED_ALBEDO`], one a layer. Errors of
    /// transfer as a whole are those of w_k T_k.
    pub(crate) fn weights(&self) -> Vec<f64> {
        std::iter::successors(Some(WEIGHED_ALBEDO), |w| Some(w * WEIGHED_ALBEDO)).take(self.len()).collect()
    }

    /// The weight of each coefficient.
    pub(crate) fn weights_of_coefficients(&self) -> Vec<f64> {
        let of_layer = |(k, w): (usize, f64)| std::iter::repeat_n(w, self.channels * self.bands[k].pow(2));
        self.weights().into_iter().enumerate().flat_map(of_layer).collect()
    }

    /// Where layer `k` starts in a texel's coefficients.
    pub fn offset(&self, k: usize) -> usize {
        self.channels * self.bands[..k].iter().map(|b| b * b).sum::<usize>()
    }

    /// Where layer `k` starts in a texel's standard errors.
    pub fn error_offset(&self, k: usize) -> usize {
        self.bands[..k].iter().sum()
    }
}

/// What a texture consists of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Where the texels sit.
    pub lattice: Lattice,
    /// What each texel holds.
    pub layers: Layers,
}

/// The texels of one brick.
#[derive(Clone, Debug, PartialEq)]
pub struct Brick {
    /// 512 × coefficients, coefficient fastest, x next.
    pub transfer: Vec<f16>,
    /// 512 × errors: standard error of each layer and band, root mean square over the orders; an estimator may pool
    /// bands (see [`crate::sampling::statistics::stored_degrees`]).
    pub stderr: Vec<f16>,
    /// 512 flags, see [`validity`].
    pub validity: Vec<u8>,
    /// 512 counts: paths traced for the texel.
    pub rays: Vec<u32>,
}

impl Brick {
    /// A brick in which nothing is baked.
    pub fn unbaked(layers: &Layers) -> Self {
        Self {
            transfer: vec![f16::NAN; BRICK_TEXELS * layers.coefficients()],
            stderr: vec![f16::NAN; BRICK_TEXELS * layers.errors()],
            validity: vec![0; BRICK_TEXELS],
            rays: vec![0; BRICK_TEXELS],
        }
    }

    /// A borrowed view.
    pub fn view(&self) -> BrickView<'_> {
        BrickView { transfer: &self.transfer, stderr: &self.stderr, validity: &self.validity, rays: &self.rays }
    }
}

/// A brick that lives in memory or in a mapped file.
#[derive(Clone, Copy, Debug)]
pub struct BrickView<'a> {
    /// As [`Brick::transfer`].
    pub transfer: &'a [f16],
    /// As [`Brick::stderr`].
    pub stderr: &'a [f16],
    /// As [`Brick::validity`].
    pub validity: &'a [u8],
    /// As [`Brick::rays`].
    pub rays: &'a [u32],
}

/// Anything that can hand out the bricks of a transfer texture.
pub trait BrickSource: Sync {
    /// Lattice and layers.
    fn layout(&self) -> &Layout;

    /// The brick at a brick index (x, y, z); `None` where nothing is baked.
    ///
    /// # Errors
    /// When the storage behind it is damaged or cannot be read.
    fn brick(&self, index: [usize; 3]) -> Result<Option<BrickView<'_>>>;
}
