//! Rectangles onto shelves: sorted by height, side by side, each shelf as high as its first. The scale is the largest at which
//! all fit.

use glam::Vec2;

/// Texels around a chart that repeat its border, so that lookups between texels never meet another chart.
pub(super) const GUTTER: u32 = 2;

/// Where charts lie in a square picture.
#[derive(Clone, Debug)]
pub(super) struct Packing {
    /// Texels along its side.
    pub(super) side: u32,
    /// Texels to a world unit.
    pub(super) scale: f32,
    /// The first texel of the rectangle of each chart, gutter included.
    pub(super) origins: Vec<[u32; 2]>,
}

impl Packing {
    /// A place of a chart in the picture, in texels from its corner.
    pub(super) fn texels(&self, origin: [u32; 2], place: Vec2) -> Vec2 {
        // The border of a chart runs through centres of texels.
        Vec2::from_array(origin.map(|o| (o + GUTTER) as f32 + 0.5)) + self.scale * place
    }
}

/// Texels that a chart takes at a scale, gutter included.
pub(super) fn extent(size: Vec2, scale: f32) -> [u32; 2] {
    size.to_array().map(|side| (scale * side).ceil() as u32 + 1 + 2 * GUTTER)
}

/// Packs charts of these sizes; `None` where not even points would fit.
pub(super) fn pack(sizes: &[Vec2], side: u32) -> Option<Packing> {
    const HALVINGS: usize = 24;
    let largest = sizes.iter().fold(0.0, |most: f32, size| most.max(size.max_element()));
    let mut best = (0.0, shelves(sizes, side, 0.0)?);
    let mut high = if largest > 0.0 { side as f32 / largest } else { 0.0 };
    for _ in 0..HALVINGS {
        let middle = 0.5 * (best.0 + high);
        match shelves(sizes, side, middle) {
            Some(origins) => best = (middle, origins),
            None => high = middle,
        }
    }
    (best.0 > 0.0 || largest == 0.0).then_some(Packing { side, scale: best.0, origins: best.1 })
}

fn shelves(sizes: &[Vec2], side: u32, scale: f32) -> Option<Vec<[u32; 2]>> {
    let extents: Vec<[u32; 2]> = sizes.iter().map(|&size| extent(size, scale)).collect();
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse((extents[i][1], extents[i][0])), i));
    let mut origins = vec![[0; 2]; sizes.len()];
    let (mut x, mut y, mut shelf) = (0, 0, 0);
    for i in order {
        let [width, height] = extents[i];
        if x + width > side {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        // The first of a shelf is the highest.
        if shelf == 0 {
            shelf = height;
        }
        if width > side || y + height > side {
            return None;
        }
        origins[i] = [x, y];
        x += width;
    }
    Some(origins)
}
