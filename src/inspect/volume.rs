//! What is in a volume, and what a bake of it would take.

use crate::bake::{bytes_of_bake, bytes_of_texel, crossed_cells};
use crate::error::Result;
use crate::geom::Affine;
use crate::scene::Member;
use crate::transfer::{BRICK_TEXELS, Lattice, Layers, Layout, Selection, texels_of_isosurface};
use crate::volume::isovalue::{Chosen, overview};
use crate::volume::{Isovalue, Solid, Volume};
use serde_json::{Value, json};

/// Bins of the histogram.
const BINS: usize = 64;

/// What is in a volume, beside what it says itself.
pub struct VolumeFacts {
    /// Samples in equal parts of the range of the values.
    pub histogram: Vec<u64>,
    /// The isovalue that `auto` takes, if there is one.
    pub suggested: Option<Chosen>,
    /// What a bake of that isovalue takes.
    pub estimate: Option<Estimate>,
}

/// What a bake with the default options would take.
pub struct Estimate {
    /// Bytes of memory.
    pub memory: u64,
    /// Bytes of the store for all isovalues.
    pub all: u64,
    /// Bytes of the store for the suggested one.
    pub one: u64,
}

impl Estimate {
    fn new(volume: &Volume, isovalue: f64) -> Result<Self> {
        let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
        let layout = Layout { lattice, layers: Layers::usual(4)? };
        let texel = bytes_of_texel(&layout.layers);
        let data = volume.samples().bytes().len() as u64;
        let crossed = crossed_cells(volume, &[isovalue]);
        let bytes = |s: Selection| data + s.bricks().len() as u64 * BRICK_TEXELS as u64 * texel;
        Ok(Self {
            memory: bytes_of_bake(volume, &layout, Some((1, &crossed)), true, None),
            all: bytes(Selection::of_all_isosurfaces(lattice, volume)),
            one: bytes(texels_of_isosurface(volume, lattice, isovalue)),
        })
    }
}

impl VolumeFacts {
    /// Looks at all samples.
    pub fn of(member: &Member) -> Self {
        let suggested = member.choose(Isovalue::Auto).ok();
        let estimate = suggested.as_ref().and_then(|c| Estimate::new(&member.volume, c.value).ok());
        Self { histogram: overview(&member.volume, BINS), suggested, estimate }
    }

    /// For programs, with what the volume says itself.
    pub fn to_json(&self, volume: &Volume) -> Value {
        let bounds = volume.world_bounds();
        json!({
            "name": volume.name,
            "dims": volume.dims(),
            "type": volume.samples().type_name(),
            "scaling": { "slope": volume.slope(), "inter": volume.inter() },
            "spacing": volume.world_from_grid().spacing().to_array(),
            "world_from_grid": rows_of(volume.world_from_grid()),
            "metres_per_unit": volume.unit.metres(),
            "world_box": { "min": bounds.min.to_array(), "max": bounds.max.to_array() },
            "left_handed": volume.world_from_grid().is_left_handed(),
            "up": volume.up.name(),
            "anatomical": volume.up.is_anatomical(),
            "solid": solid_text(volume.solid),
            "range": volume.value_range(),
            "histogram": self.histogram,
            "suggested_isovalue": self.suggested.as_ref().map(|c| json!({
                "value": c.value, "solid": solid_text(c.solid), "reason": c.reason, "warning": c.warning,
                "more": c.more.iter().map(|l| l.value).collect::<Vec<_>>(),
                "alternatives": c.alternatives.iter().map(|a| json!({ "isovalue": a.name, "value": a.level.value }))
                    .collect::<Vec<_>>(),
            })),
            "channels": volume.series.channels, "channel": volume.series.channel,
            "timepoints": volume.series.timepoints, "timepoint": volume.series.timepoint,
            "arrays": volume.series.arrays, "array": volume.series.array,
            "series": volume.series.scans, "series_number": volume.series.scan,
            "levels": volume.series.levels, "level": volume.series.level,
            "estimate": self.estimate.as_ref().map(|e| json!({
                "memory_bytes": e.memory, "store_bytes_all": e.all, "store_bytes_suggested": e.one,
            })),
            "notes": volume.notes.iter().map(|n| json!({ "text": n.text, "count": n.count })).collect::<Vec<_>>(),
            "content_hash": volume.content_hash(),
        })
    }
}

/// Three rows of four numbers.
fn rows_of(map: &Affine) -> [[f64; 4]; 3] {
    let (linear, offset) = (map.linear(), map.offset());
    [0, 1, 2].map(|row| [linear.x_axis[row], linear.y_axis[row], linear.z_axis[row], offset[row]])
}

/// The side that is solid, in words.
pub fn solid_text(solid: Solid) -> &'static str {
    match solid {
        Solid::Above => "above the isovalue",
        Solid::Below => "below the isovalue",
    }
}
