//! One strip of tiles: the covered samples, sorted by triangle, through the stages of shading. What is shaded at once is
//! a sample, or all samples of a triangle in a pixel ([`View::shade_per_pixel`]).

use super::packet::{AttributeGradient, ClipGradient, LANES, Packet, Scene};
use super::{Geometry, Passes, View};
use crate::maps::CHANNELS;
use crate::rasterize::{NONE, PixelGrid, TILE, Visibility};
use crate::texture::{Pyramid, ScatterQueue};
use photofit_scalar::wide::{Kernel, Width, run_up_to};
use photofit_scalar::{Real, Vec2, Vec4};

/// Inputs of a strip.
pub(super) struct Strip<'a, T> {
    pub geometry: &'a Geometry<'a, T>,
    pub view: &'a View<'a, T>,
    pub passes: &'a Passes,
    pub maps: &'a Pyramid<T, CHANNELS>,
    pub clip: &'a [Vec4<T>],
    pub visibility: &'a Visibility,
    /// First row.
    pub y: usize,
}

/// The covered samples of a strip, sorted by triangle tile by tile, as the forward pass left them.
#[derive(Clone, Debug, Default)]
pub(super) struct StripSpans {
    spans: Vec<Span>,
    /// The end of each tile in `spans`.
    ends: Vec<usize>,
}

/// Samples of a triangle side by side in a row of a block: `triangle << 32 | first << 16 | number`, the first by its number in the
/// tile (see [`Blocks`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Span(u64);

impl Span {
    fn new(triangle: u32, first: usize, len: usize) -> Self {
        Self(u64::from(triangle) << 32 | (first << 16 | len) as u64)
    }

    #[inline(always)]
    fn triangle(self) -> u32 {
        (self.0 >> 32) as u32
    }

    #[inline(always)]
    fn first(self) -> usize {
        (self.0 >> 16) as usize & 0xffff
    }

    #[inline(always)]
    fn len(self) -> usize {
        self.0 as usize & 0xffff
    }
}

/// What the reverse pass of a strip collects.
#[derive(Clone, Debug)]
pub(super) struct StripGradients<T> {
    pub clips: Vec<(u32, ClipGradient<T>)>,
    /// Of the same triangles; empty without lights.
    pub attributes: Vec<AttributeGradient<T>>,
    pub texels: ScatterQueue<T, CHANNELS>,
}

impl<T: Real> Default for StripGradients<T> {
    fn default() -> Self {
        Self { clips: Vec::new(), attributes: Vec::new(), texels: ScatterQueue::default() }
    }
}

/// Blocks of `side` x `side` samples of a tile, in which samples are counted block by block; what is shaded at once lies in
/// one.
#[derive(Clone, Copy)]
struct Blocks {
    side: usize,
}

impl Blocks {
    #[inline(always)]
    fn number(self, x: usize, y: usize) -> usize {
        let s = self.side;
        if s == 1 { y * TILE + x } else { ((y / s) * (TILE / s) + x / s) * s * s + (y % s) * s + x % s }
    }

    /// Column and row of a sample by its number.
    #[inline(always)]
    fn at(self, number: usize) -> (usize, usize) {
        if self.side == 1 {
            return (number % TILE, number / TILE);
        }
        let (s, area) = (self.side, self.side * self.side);
        let (block, inside) = (number / area, number % area);
        let columns = TILE / s;
        ((block % columns) * s + inside % s, (block / columns) * s + inside / s)
    }

    /// Number of the block of a span.
    #[inline(always)]
    fn of(self, span: Span) -> usize {
        span.first() / (self.side * self.side)
    }
}

impl<'a, T: Real> Strip<'a, T> {
    fn blocks(&self) -> Blocks {
        let side = if self.view.shade_per_pixel { self.view.samples.max(1) } else { 1 };
        assert!(TILE.is_multiple_of(side), "pixels of {side} x {side} samples do not fill tiles of {TILE}");
        Blocks { side }
    }

    fn scene(&self, blocks: Blocks) -> Scene<'a, T> {
        let (view, side) = (self.view, blocks.side);
        let footprint = PixelGrid::new(view.width / side, view.height / side);
        Scene { view, passes: self.passes, maps: self.maps, footprint }
    }

    /// Collects the covered samples of the strip, each tile's sorted by triangle.
    fn collect(&self, out: &mut StripSpans) {
        let (w, blocks) = (self.view.width, self.blocks());
        let rows = TILE.min(self.view.height - self.y);
        let StripSpans { spans, ends } = out;
        spans.clear();
        ends.clear();
        let longest = if blocks.side == 1 { TILE } else { blocks.side };
        for x0 in (0..w).step_by(TILE) {
            let first = spans.len();
            for y in 0..rows {
                let row = &self.visibility.triangle[(self.y + y) * w..][x0..(x0 + TILE).min(w)];
                for (k, part) in row.chunks(longest).enumerate() {
                    let mut x = k * longest;
                    for run in part.chunk_by(|a, b| a == b) {
                        if run[0] != NONE {
                            spans.push(Span::new(run[0], blocks.number(x, y), run.len()));
                        }
                        x += run.len();
                    }
                }
            }
            spans[first..].sort_unstable();
            ends.push(spans.len());
        }
    }

    /// Writes radiance and alpha of every covered pixel of the strip, and keeps in `kept` what [`Self::shade_vjp`]
    /// needs. The bits are the same for any width.
    pub(super) fn shade(&self, most: Width, kept: &mut StripSpans, out: &mut [[T; 4]]) {
        self.collect(kept);
        out.fill([T::zero(); 4]);
        if !kept.spans.is_empty() {
            run_up_to(most, Shade { strip: self, kept, out });
        }
    }

    /// Adjoint of [`Self::shade`] for the gradients `g` of the strip's rows.
    pub(super) fn shade_vjp(
        &self,
        most: Width,
        kept: &StripSpans,
        g: &[[T; 4]],
        out: &mut StripGradients<T>,
    ) {
        out.clips.clear();
        out.attributes.clear();
        out.texels.clear();
        if !kept.spans.is_empty() {
            run_up_to(most, ShadeVjp { strip: self, kept, g, out });
        }
    }

    /// The samples of the strip, to be packed; with `g`, gradients of the strip's rows.
    #[inline(always)]
    fn packing(&'a self, kept: &'a StripSpans, g: Option<&'a [[T; 4]]>) -> Packing<'a, T> {
        let grid = PixelGrid::new(self.view.width, self.view.height);
        Packing { strip: self, kept, blocks: self.blocks(), grid, g, tile: 0, span: 0, offset: 0 }
    }
}

/// Where the samples of a lane lie.
#[derive(Clone, Copy, Default)]
struct LaneSamples {
    /// The sample by its number in the strip; of several the first span.
    first: u32,
    /// Number of spans; 0: one sample.
    spans: u32,
    /// The tile's first column.
    column: u32,
}

/// What is shaded at once, one after the other.
struct Packing<'a, T> {
    strip: &'a Strip<'a, T>,
    kept: &'a StripSpans,
    blocks: Blocks,
    grid: PixelGrid<T>,
    g: Option<&'a [[T; 4]]>,
    tile: usize,
    span: usize,
    /// Samples of the span that are done.
    offset: usize,
}

impl<T: Real> Packing<'_, T> {
    /// Fills a packet with what comes next; false at the end. Sums of gradients are the packet's, and what has none costs
    /// nothing (equal to the reference, or outside of a mask).
    #[inline(always)]
    fn fill(&mut self, packet: &mut Packet<T>, lanes: &mut [LaneSamples; LANES]) -> bool {
        let Strip { geometry, view, clip, .. } = *self.strip;
        packet.clear();
        while packet.len < LANES && self.span < self.kept.spans.len() {
            while self.span >= self.kept.ends[self.tile] {
                self.tile += 1;
            }
            let spans = &self.kept.spans[..self.kept.ends[self.tile]];
            let (triangle, first) = (spans[self.span].triangle(), packet.len);
            while packet.len < LANES && spans.get(self.span).is_some_and(|s| s.triangle() == triangle) {
                if self.blocks.side == 1 {
                    self.take_samples(spans[self.span], packet, lanes);
                } else {
                    self.take_block(spans, packet, lanes);
                }
            }
            packet.cover(geometry, clip, !view.lights.is_empty(), triangle, first);
        }
        packet.len > 0
    }

    /// Takes samples of a span, as many as there is room for.
    #[inline(always)]
    fn take_samples(&mut self, span: Span, packet: &mut Packet<T>, lanes: &mut [LaneSamples; LANES]) {
        let (x, y) = (self.tile * TILE + span.first() % TILE, span.first() / TILE);
        let end = span.len().min(self.offset + LANES - packet.len);
        let row = y * self.strip.view.width;
        for x in x + self.offset..x + end {
            let (at, lane) = (row + x, packet.len);
            if let Some(g) = self.g {
                let g = g[at];
                if g[0] == T::zero() && g[1] == T::zero() && g[2] == T::zero() && g[3] == T::zero() {
                    continue;
                }
                for k in 0..4 {
                    packet.g[k][lane] = g[k];
                }
            }
            let f = self.grid.ndc(x, self.strip.y + y);
            (packet.f[0][lane], packet.f[1][lane]) = (f.x, f.y);
            lanes[lane] = LaneSamples { first: at as u32, spans: 0, column: 0 };
            packet.len += 1;
        }
        self.offset = end;
        if end == span.len() {
            (self.span, self.offset) = (self.span + 1, 0);
        }
    }

    /// Takes the samples of the triangle in a block as one, at the mean of their places.
    #[inline(always)]
    fn take_block(&mut self, spans: &[Span], packet: &mut Packet<T>, lanes: &mut [LaneSamples; LANES]) {
        let (first, block) = (self.span, self.blocks.of(spans[self.span]));
        let (column, width, lane) = (self.tile * TILE, self.strip.view.width, packet.len);
        let triangle = spans[first].triangle();
        let (mut f, mut g_sum, mut count) = (Vec2::zero(), [T::zero(); 4], 0);
        while let Some(span) = spans.get(self.span).copied() {
            if span.triangle() != triangle || self.blocks.of(span) != block {
                break;
            }
            let (x, y) = self.blocks.at(span.first());
            for x in column + x..column + x + span.len() {
                f += self.grid.ndc(x, self.strip.y + y);
                if let Some(g) = self.g {
                    for (sum, g) in g_sum.iter_mut().zip(&g[y * width + x]) {
                        *sum += *g;
                    }
                }
            }
            count += span.len();
            self.span += 1;
        }
        if self.g.is_some() && g_sum.iter().all(|g| *g == T::zero()) {
            return;
        }
        let share = T::one() / T::of(count as f64);
        (packet.f[0][lane], packet.f[1][lane]) = (f.x * share, f.y * share);
        for k in 0..4 {
            packet.g[k][lane] = g_sum[k];
        }
        lanes[lane] =
            LaneSamples { first: first as u32, spans: (self.span - first) as u32, column: column as u32 };
        packet.len += 1;
    }

    /// Writes the colour of a lane to its samples.
    #[inline(always)]
    fn write(&self, samples: LaneSamples, color: [T; 4], out: &mut [[T; 4]]) {
        if samples.spans == 0 {
            out[samples.first as usize] = color;
            return;
        }
        for span in &self.kept.spans[samples.first as usize..][..samples.spans as usize] {
            let (x, y) = self.blocks.at(span.first());
            let first = y * self.strip.view.width + samples.column as usize + x;
            out[first..first + span.len()].fill(color);
        }
    }
}

/// [`Strip::shade`].
struct Shade<'a, T> {
    strip: &'a Strip<'a, T>,
    kept: &'a StripSpans,
    out: &'a mut [[T; 4]],
}

impl<T: Real> Kernel for Shade<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { strip, kept, out } = self;
        let scene = strip.scene(strip.blocks());
        let (mut packet, mut lanes) = (Packet::new(), [LaneSamples::default(); LANES]);
        let mut packing = strip.packing(kept, None);
        while packing.fill(&mut packet, &mut lanes) {
            packet.shade(&scene);
            for lane in 0..packet.len {
                packing.write(lanes[lane], packet.color(&scene, lane), out);
            }
        }
    }
}

/// [`Strip::shade_vjp`].
struct ShadeVjp<'a, T> {
    strip: &'a Strip<'a, T>,
    kept: &'a StripSpans,
    g: &'a [[T; 4]],
    out: &'a mut StripGradients<T>,
}

impl<T: Real> Kernel for ShadeVjp<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { strip, kept, g, out } = self;
        let Strip { geometry, view, passes, maps, .. } = *strip;
        let scene = strip.scene(strip.blocks());
        let (mut packet, mut lanes) = (Packet::new(), [LaneSamples::default(); LANES]);
        let mut packing = strip.packing(kept, Some(g));
        while packing.fill(&mut packet, &mut lanes) {
            packet.shade_vjp(&scene, !geometry.alpha.is_empty());
            if passes.map_gradients {
                let (at, g) = packet.lookups();
                out.texels.push(maps, at, g);
            }
            if passes.position_gradients {
                packet.reduce(!view.lights.is_empty(), &mut out.clips, &mut out.attributes);
            }
        }
    }
}
