//! One brick of grey transfer: its valid texels block by block, while those of the next block come from memory.

use super::super::block::{self, Column, LANES, Lanes};
use super::super::noise::{ROOT_FOUR_PI, TailRadiance, mean};
use super::super::tail::Tail;
use super::{BrickTotals, Opened, UNBAKED, Weights};
use crate::error::Result;
use crate::transfer::{BRICK_TEXELS, BrickSource, BrickView, Layers, MAX_LAYERS};
use glam::Vec4;
use half::f16;
use multiversion::{multiversion, target::match_target};

/// Contraction of the bricks of a grey texture.
pub(super) struct Kernel<'a> {
    pub(super) source: &'a dyn BrickSource,
    pub(super) bricks: &'a [[usize; 3]],
    pub(super) weights: Weights,
}

/// What a thread works with.
pub(super) struct Thread<'a> {
    room: Room,
    // The brick of a slot, opened before it is its turn, so that its memory is asked for in time.
    ahead: Option<(usize, Opened<'a>)>,
}

impl Thread<'_> {
    pub(super) fn new(layers: &Layers) -> Self {
        Self { room: Room::new(layers), ahead: None }
    }
}

impl<'a> Kernel<'a> {
    /// Contracts the brick of a slot.
    pub(super) fn contract(
        &self,
        thread: &mut Thread<'a>,
        slot: usize,
        out: &mut [[f32; 4]; BRICK_TEXELS],
    ) -> Result<BrickTotals> {
        let open = |slot: usize| self.source.brick(self.bricks[slot]).map(Opened::new);
        let brick = match thread.ahead.take() {
            Some((of, opened)) if of == slot => opened,
            _ => open(slot)?,
        };
        if slot + 1 < self.bricks.len() {
            thread.ahead = Some((slot + 1, open(slot + 1)?));
        }
        let next = thread.ahead.as_ref().map(|(_, opened)| opened);
        Ok(contract_brick(BrickJob { brick, next, weights: &self.weights, out, room: &mut thread.room }))
    }
}

/// What contraction makes of a block.
struct BlockWork {
    // ⟨T_k, L⟩ of each layer with its albedo; fourth ⟨T_k, G_k²⟩, see `noise`. One entry a layer.
    contracted: Vec<[Lanes; 4]>,
    // T_k,00 of each layer.
    first: Vec<Lanes>,
    rgb: [Lanes; 3],
    // Of the mean of the channels, and its root.
    variance: Lanes,
    stderr: Lanes,
    tail: TailRadiance,
    // Emission that the sum leaves out, the most of any lane.
    left_out: f32,
}

/// Room for the blocks of one task.
struct Room {
    columns: Vec<Column>,
    error_columns: Vec<Column>,
    errors: Vec<Lanes>,
    work: BlockWork,
}

impl Room {
    fn new(layers: &Layers) -> Self {
        Self {
            columns: vec![[f16::ZERO; LANES]; layers.coefficients()],
            error_columns: vec![[f16::ZERO; LANES]; layers.errors()],
            errors: vec![[0.0; LANES]; layers.errors()],
            work: BlockWork {
                contracted: vec![[[0.0; LANES]; 4]; layers.len()],
                first: vec![[0.0; LANES]; layers.len()],
                rgb: [[0.0; LANES]; 3],
                variance: [0.0; LANES],
                stderr: [0.0; LANES],
                tail: TailRadiance::NONE,
                left_out: 0.0,
            },
        }
    }
}

/// A brick to contract, and where to.
struct BrickJob<'a> {
    brick: Opened<'a>,
    // What comes after it.
    next: Option<&'a Opened<'a>>,
    weights: &'a Weights,
    out: &'a mut [[f32; 4]; BRICK_TEXELS],
    room: &'a mut Room,
}

/// [`block::wide::fetch`], or nothing.
trait Fetch: Fn(&[f16]) {}
impl<F: Fn(&[f16])> Fetch for F {}

/// [`block::columns`] in one of its forms.
trait Columns: Fn(&[f16], usize, &[usize; LANES], &mut [Column]) {}
impl<F: Fn(&[f16], usize, &[usize; LANES], &mut [Column])> Columns for F {}

/// [`block::widen`] in one of its forms.
trait Widen: Fn(&Column) -> Lanes {}
impl<F: Fn(&Column) -> Lanes> Widen for F {}

/// [`block::dot`] in one of its forms.
trait Dot: Fn(&[Column], &[Vec4]) -> [Lanes; 4] {}
impl<F: Fn(&[Column], &[Vec4]) -> [Lanes; 4]> Dot for F {}

/// The inner loops for one kind of processor. Closures, because they are compiled for what calls them.
struct Forms<F: Fetch, C: Columns, W: Widen, D: Dot> {
    fetch: F,
    columns: C,
    widen: W,
    dot: D,
}

/// Contracts a brick with what this processor has. All variants give the same bits.
#[multiversion(targets("x86_64+avx+avx2+f16c+fma+avx512f", "x86_64+avx+avx2+f16c+fma"))]
fn contract_brick(job: BrickJob<'_>) -> BrickTotals {
    match_target! {
        "x86_64+avx+avx2+f16c+fma+avx512f" => job.run(&Forms {
            fetch: |stored| block::wide::fetch(stored),
            columns: |stored, n, texels, out| block::wide::columns(stored, n, texels, out),
            widen: |column| block::wide::widen(column),
            dot: |columns, weights| block::wide::dot_512(columns, weights),
        }),
        "x86_64+avx+avx2+f16c+fma" => job.run(&Forms {
            fetch: |stored| block::wide::fetch(stored),
            columns: |stored, n, texels, out| block::wide::columns(stored, n, texels, out),
            widen: |column| block::wide::widen(column),
            dot: |columns, weights| block::wide::dot(columns, weights),
        }),
        _ => job.run(&Forms { fetch: |_| (), columns: block::columns, widen: block::widen, dot: block::dot }),
    }
}

/// Parts in which the transfer of the next block is asked for: only so many lines can be on their way at once.
const PARTS: usize = 4 + AMONG_LAYERS;

/// Parts asked for after one layer each, as far as there are so many.
const AMONG_LAYERS: usize = 4;

/// The rows of a block that comes next.
struct Soon<'a> {
    view: BrickView<'a>,
    texels: &'a [u16],
}

impl Soon<'_> {
    /// Asks for one of `parts` parts of its rows of `n` numbers.
    #[inline(always)]
    fn fetch(&self, stored: &[f16], n: usize, part: usize, parts: usize, fetch: &impl Fetch) {
        let rows = |first: u16, last: u16| &stored[n * usize::from(first)..n * (usize::from(last) + 1)];
        match self.texels {
            [first, .., last] if usize::from(last - first) == self.texels.len() - 1 => {
                let all = rows(*first, *last);
                fetch(&all[all.len() * part / parts..all.len() * (part + 1) / parts]);
            }
            texels => {
                let some = &texels[texels.len() * part / parts..texels.len() * (part + 1) / parts];
                some.iter().for_each(|&t| fetch(rows(t, t)));
            }
        }
    }
}

impl BrickJob<'_> {
    /// Inlined, with all that it calls, where the wide registers are.
    #[inline(always)]
    fn run<F: Fetch, C: Columns, W: Widen, D: Dot>(self, forms: &Forms<F, C, W, D>) -> BrickTotals {
        let Self { brick, next, weights, out, room } = self;
        let Some(view) = brick.view else {
            out.fill([0.0, 0.0, 0.0, UNBAKED]);
            return BrickTotals::default();
        };
        let mut totals = BrickTotals { texels: brick.count as u64, ..BrickTotals::default() };
        let mut blocks = brick.valid().chunks(LANES).peekable();
        while let Some(some) = blocks.next() {
            let in_brick = blocks.peek().map(|&texels| Soon { view, texels });
            let soon = in_brick.or_else(|| {
                let next = next?;
                Some(Soon { view: next.view?, texels: next.valid().chunks(LANES).next()? })
            });
            // A block that is not full repeats its first texel.
            let mut texels = [usize::from(some[0]); LANES];
            texels.iter_mut().zip(some).for_each(|(texel, &t)| *texel = usize::from(t));
            weights.contract_block(&view, &texels, soon, forms, room);
            let BlockWork { rgb: [red, green, blue], variance, stderr, left_out, .. } = &room.work;
            for (j, &t) in texels[..some.len()].iter().enumerate() {
                out[t] = [red[j], green[j], blue[j], stderr[j]];
                totals.variance += f64::from(variance[j]);
                totals.radiance += f64::from(red[j] + green[j] + blue[j]);
            }
            totals.left_out = totals.left_out.max(*left_out);
        }
        brick.mark_others(&view, weights.errors, out);
        totals
    }
}

impl Weights {
    /// Contracts a block of valid texels into the work of the room, while what comes `soon` comes from memory.
    #[inline(always)]
    fn contract_block<F: Fetch, C: Columns, W: Widen, D: Dot>(
        &self,
        view: &BrickView<'_>,
        texels: &[usize; LANES],
        soon: Option<Soon<'_>>,
        forms: &Forms<F, C, W, D>,
        room: &mut Room,
    ) {
        let (n, errors) = (self.rows.len(), self.errors);
        let ask = |part: usize| {
            if let Some(soon) = &soon {
                soon.fetch(soon.view.transfer, n, part, PARTS, &forms.fetch);
            }
        };
        let Room { columns, error_columns, errors: error_lanes, work } = room;
        ask(0);
        (forms.columns)(view.transfer, n, texels, columns);
        ask(1);
        (forms.columns)(view.stderr, errors, texels, error_columns);
        if let Some(soon) = &soon {
            soon.fetch(soon.view.stderr, errors, 0, 1, &forms.fetch);
        }
        for (k, &(offset, count)) in self.spans.iter().enumerate() {
            work.contracted[k] = (forms.dot)(&columns[offset..offset + count], &self.rows[offset..offset + count]);
            work.first[k] = (forms.widen)(&columns[offset]);
            if k < AMONG_LAYERS {
                ask(2 + k);
            }
        }
        (self.spans.len()..AMONG_LAYERS).for_each(|k| ask(2 + k));
        for (lanes, column) in error_lanes.iter_mut().zip(&*error_columns) {
            *lanes = (forms.widen)(column);
        }
        self.radiance(work);
        ask(PARTS - 2);
        work.variance = self.noise.variance(&work.first, &work.contracted, &work.tail, error_lanes);
        ask(PARTS - 1);
        for j in 0..LANES {
            work.stderr[j] = work.variance[j].sqrt();
        }
    }

    /// Radiance of the texels of a block from what is in `work`; leaves there what the noise needs of it.
    #[inline(always)]
    fn radiance(&self, work: &mut BlockWork) {
        work.rgb = [[0.0; LANES]; 3];
        for layer in &work.contracted {
            for c in 0..3 {
                for j in 0..LANES {
                    work.rgb[c][j] += layer[c][j];
                }
            }
        }
        work.left_out = 0.0;
        let last = work.first.len() - 1;
        if last == 0 && self.emission == [0.0; 3] {
            work.tail = TailRadiance::NONE;
            return;
        }
        let mut escaped = [0.0; LANES];
        for first in &work.first {
            for j in 0..LANES {
                escaped[j] += ROOT_FOUR_PI * first[j];
            }
        }
        let (of_last, rgb) = (&work.contracted[last], &mut work.rgb);
        for j in 0..LANES {
            let tail = Tail::beyond(escaped[j], ROOT_FOUR_PI * work.first[last][j], last > 0);
            let [mut beyond, mut slope] = [[0.0; 3]; 2];
            for c in 0..3 {
                let [gain, gain_slope] = tail.gain_and_slope(self.albedo[c]);
                (beyond[c], slope[c]) = (of_last[c][j] * gain, of_last[c][j] * gain_slope);
                rgb[c][j] += beyond[c];
            }
            work.tail.beyond[j] = mean(beyond[0], beyond[1], beyond[2]);
            work.tail.slope[j] = mean(slope[0], slope[1], slope[2]);
            let slopes = tail.ratio_slopes();
            for i in 0..2 {
                work.tail.ratio_slopes[i][j] = slopes[i];
            }
            work.tail.survival[j] = tail.survival;
        }
        if self.emission != [0.0; 3] {
            self.emit(work);
        }
    }

    /// Adds emission.
    fn emit(&self, work: &mut BlockWork) {
        let layers = work.first.len();
        let mut escapes = [0.0f32; MAX_LAYERS];
        for j in 0..LANES {
            for k in 0..layers {
                escapes[k] = ROOT_FOUR_PI * work.first[k][j];
            }
            let tail = Tail::new(&escapes[..layers]);
            for c in 0..3 {
                let (factor, remainder) = tail.emission(&escapes[..layers], self.albedo[c]);
                work.rgb[c][j] += self.emission[c] * factor;
                if self.emission[c] > 0.0 {
                    work.left_out = work.left_out.max(remainder);
                }
            }
        }
    }
}
