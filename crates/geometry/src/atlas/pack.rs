//! Packing of chart shapes into the square: lowest free place on a bitmap, largest scale that fits.
//!
//! Few shapes are first arranged on coarse cells, where many orders can be tried, and then settled on single texels
//! near the places found (see [`settle`]); many shapes are placed on texels at once.

use super::bitmap::{Mask, Strip, probe_order};
use super::settle::settle;
use photofit_scalar::{Vec2, vec2};
use rayon::prelude::*;
use std::collections::HashMap;

/// More shapes than this are placed on single texels at once.
const MANY: usize = 400;
/// Cells along a side in the coarse arrangement.
const COARSE: u32 = 512;
/// Shapes placed in the search for a good order, in all.
const PLACEMENTS: usize = 10000;
/// Orders tried side by side.
const BATCH: usize = 8;

/// A chart to pack, in its own units, lower corner of its box at the origin.
pub(super) struct Shape {
    /// Directed edges of its border.
    pub(super) outline: Vec<[Vec2<f64>; 2]>,
    pub(super) size: Vec2<f64>,
    pub(super) area: f64,
}

impl Shape {
    /// Cells covered after quarter turns at a scale in cells per unit.
    pub(super) fn mask(&self, turn: u32, scale: f64) -> Mask {
        let size = if turn.is_multiple_of(2) { self.size } else { vec2(self.size.y, self.size.x) } * scale;
        let at = |p| turn_point(p, self.size, turn) * scale;
        let outline: Vec<_> = self.outline.iter().map(|&[a, b]| [at(a), at(b)]).collect();
        let cells = |s: f64| ((s + 2e-3).floor() as u32).saturating_add(1);
        Mask::of_outline(&outline, cells(size.x), cells(size.y))
    }
}

/// Rotates a point of a box by quarter turns, counter-clockwise, and moves the box back to the origin.
pub(super) fn turn_point(p: Vec2<f64>, size: Vec2<f64>, turn: u32) -> Vec2<f64> {
    match turn % 4 {
        0 => p,
        1 => vec2(size.y - p.y, p.x),
        2 => size - p,
        _ => vec2(p.y, size.x - p.x),
    }
}

/// Place of a shape: lower corner in texels and quarter turns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Place {
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) turn: u32,
}

/// All places, the scale in texels per unit, and the padding that was kept.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) places: Vec<Place>,
    pub(super) scale: f64,
    pub(super) padding: u32,
}

/// Packs the shapes into `size x size` texels with `padding` texels between them and at the border; halves the
/// padding where even the smallest scale does not fit. `None` when there are more shapes than texels.
pub(super) fn pack(shapes: &[Shape], size: u32, padding: u32) -> Option<Layout> {
    let mut padding = padding.min(size.saturating_sub(1) / 2);
    loop {
        let packer = Packer { shapes, size, padding };
        if let Some(layout) = packer.search() {
            return Some(layout);
        }
        if padding == 0 {
            return None;
        }
        padding /= 2;
    }
}

/// A mask with the order in which its rows are probed.
struct Stamp {
    mask: Mask,
    probe: Vec<u32>,
}

/// The stamps of every shape at one scale, for each quarter turn that differs from the earlier ones.
struct Stamps {
    of: Vec<Vec<(u32, Stamp)>>,
    scale: f64,
}

/// Places in the order of the shapes and the height reached, both in cells without the border.
type Placed = (Vec<Place>, u32);

struct Packer<'a> {
    shapes: &'a [Shape],
    size: u32,
    padding: u32,
}

impl Packer<'_> {
    fn search(&self) -> Option<Layout> {
        let inner = f64::from(self.size - 2 * self.padding);
        let area: f64 = self.shapes.iter().map(|s| s.area).sum();
        let guess = if area > 0.0 { (0.6 / area).sqrt() * inner } else { 1.0 };
        let cell = (self.size / COARSE).max(1);
        if self.shapes.len() <= MANY
            && let Some(coarse) = self.arrange(cell, guess)
        {
            return Some(settle(self.shapes, coarse, self.size, 3 * cell));
        }
        let placement = Placement { order: self.order(), lean: 0 };
        self.bracket(guess, 0.2, |scale| {
            let stamps = self.stamps(1, scale)?;
            self.place_all(&stamps, 1, &placement, self.inner(1)).map(|p| p.0)
        })
    }

    /// Indices of the shapes, larger boxes first.
    fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.shapes.len() as u32).collect();
        let key = |i: u32| self.shapes[i as usize].size.x * self.shapes[i as usize].size.y;
        order.sort_by(|&a, &b| key(b).total_cmp(&key(a)).then(a.cmp(&b)));
        order
    }

    /// Stamps at `scale` texels per unit on cells of `cell` texels; `None` where the shapes cannot fit.
    fn stamps(&self, cell: u32, scale: f64) -> Option<Stamps> {
        let inner = self.inner(cell);
        let per_cell = scale / f64::from(cell);
        let largest = self.shapes.iter().map(|s| s.size.x).fold(0.0, f64::max) * per_cell;
        if largest > f64::from(inner) * 1.42 + 1.0 {
            return None;
        }
        let of: Vec<Vec<(u32, Stamp)>> = self
            .shapes
            .par_iter()
            .map(|s| {
                let mut list: Vec<(u32, Stamp)> = Vec::with_capacity(4);
                for turn in 0..4 {
                    let mask = s.mask(turn, per_cell);
                    if mask.height <= inner && mask.width <= inner && list.iter().all(|x| x.1.mask != mask) {
                        let probe = probe_order(mask.height);
                        list.push((turn, Stamp { mask, probe }));
                    }
                }
                list
            })
            .collect();
        // Shapes grown by the padding to two sides are disjoint inside the square grown alike.
        let pad = u64::from(self.padding.div_ceil(cell));
        let mut need = 0;
        for list in &of {
            let mask = &list.first()?.1.mask;
            need += mask.area() + pad * u64::from(mask.width.max(mask.height)) + pad * pad;
        }
        (need <= (u64::from(inner) + pad).pow(2)).then_some(Stamps { of, scale })
    }

    fn inner(&self, cell: u32) -> u32 {
        (self.size - 2 * self.padding) / cell
    }

    /// Texels of a place in cells.
    fn texels(&self, p: Place, cell: u32) -> Place {
        Place { x: p.x * cell + self.padding, y: p.y * cell + self.padding, turn: p.turn }
    }

    /// A layout at a large scale on cells of `cell` texels.
    fn arrange(&self, cell: u32, guess: f64) -> Option<Layout> {
        let inner = self.inner(cell);
        let mut placement = Placement { order: self.order(), lean: 1 };
        let mut best = self.bracket(guess, 0.2, |scale| {
            self.place_all(&self.stamps(cell, scale)?, cell, &placement, inner).map(|p| p.0)
        })?;
        let mut batches = (PLACEMENTS / self.shapes.len().max(1)).min(400) / BATCH;
        let mut random = Lcg(0x9E37_79B9_7F4A_7C15);
        while batches > 0 && self.shapes.len() > 1 {
            let Some(stamps) = self.stamps(cell, best.scale * 1.006) else { break };
            // Walk over placements towards less height at this scale until everything fits.
            let mut height = 2 * inner;
            let mut first = true;
            while batches > 0 {
                batches -= 1;
                let mut tried: Vec<Placement> = (0..BATCH).map(|_| placement.changed(&mut random)).collect();
                if std::mem::take(&mut first) {
                    tried[0] = placement.clone();
                }
                let placed: Vec<Option<Placed>> =
                    tried.par_iter().map(|p| self.place_all(&stamps, cell, p, height)).collect();
                let lowest = placed
                    .into_iter()
                    .zip(tried)
                    .filter_map(|(placed, placement)| placed.map(|p| (p.1, p.0, placement)))
                    .min_by_key(|p| p.0);
                if let Some((reached, places, next)) = lowest {
                    (height, placement) = (reached, next);
                    if reached <= inner {
                        best = Layout { places, scale: stamps.scale, padding: self.padding };
                        break;
                    }
                }
            }
        }
        Some(best)
    }

    /// Largest scale found by bracketing from `start`; `reach` is the first step.
    fn bracket(&self, start: f64, reach: f64, place: impl Fn(f64) -> Option<Vec<Place>>) -> Option<Layout> {
        let (mut good, mut bad): (Option<(f64, Vec<Place>)>, f64) = (None, f64::INFINITY);
        let mut step = reach;
        let largest = self.shapes.iter().map(|s| s.size.x).fold(0.0, f64::max);
        let most = 1.5 * f64::from(self.size) / largest.max(1e-300);
        let mut scale = start.min(most);
        for _ in 0..60 {
            match place(scale) {
                Some(places) => good = Some((scale, places)),
                None => bad = scale,
            }
            scale = match &good {
                Some((g, _)) if bad / g < 1.002 => break,
                Some((g, _)) if bad.is_finite() => 0.5 * (g + bad),
                Some((g, _)) => g * (1.0 + step),
                None => bad / (1.0 + step),
            };
            if good.is_none() {
                step = (step * 2.0).min(1.0);
            }
            if scale * largest < 1e-3 || scale > most {
                break;
            }
        }
        good.map(|(scale, places)| Layout { places, scale, padding: self.padding })
    }

    /// Places every shape on a strip as low as it goes, at most `limit` cells high. Places are in texels.
    fn place_all(&self, stamps: &Stamps, cell: u32, placement: &Placement, limit: u32) -> Option<Placed> {
        let inner = self.inner(cell);
        let padding = self.padding.div_ceil(cell);
        let mut strip = Strip::new(inner);
        let mut places = vec![Place::default(); self.shapes.len()];
        let mut height = 0;
        // Where a small shape of this box was last placed: the next one starts there.
        let mut hints: HashMap<(u32, u32), u32> = HashMap::new();
        for &i in &placement.order {
            let list = &stamps.of[i as usize];
            let base = &list.first()?.1.mask;
            let small = self.shapes.len() > MANY && base.width.max(base.height) <= 24;
            let key = (base.width.max(base.height), base.width.min(base.height));
            let from = if small { hints.get(&key).copied().unwrap_or(0) } else { 0 };
            let mut best: Option<((u32, u32), Place, &Mask)> = None;
            for (turn, Stamp { mask, probe }) in list {
                // No place in a row above this one can beat the best so far.
                let Some(mut last) = limit.checked_sub(mask.height) else { continue };
                if let Some((key, ..)) = &best {
                    let Some(row) = key.0.checked_sub(mask.height) else { continue };
                    last = last.min(row / (1 + placement.lean));
                }
                if let Some((x, y)) = strip.find(mask, probe, from, last) {
                    let key = (y + mask.height + placement.lean * y, x);
                    if best.as_ref().is_none_or(|b| key < b.0) {
                        best = Some((key, Place { x, y, turn: *turn }, mask));
                    }
                }
            }
            let (_, place, mask) = best?;
            height = height.max(place.y + mask.height);
            if small {
                hints.insert(key, place.y);
            }
            strip.place(mask, place.x, place.y, padding);
            places[i as usize] = self.texels(place, cell);
        }
        Some((places, height))
    }
}

/// How to place: an order, and how much the lower edge of a shape counts against its top.
#[derive(Clone)]
struct Placement {
    order: Vec<u32>,
    lean: u32,
}

impl Placement {
    /// A neighbouring placement: one to three shapes taken to other places of the order, now and then another lean.
    fn changed(&self, random: &mut Lcg) -> Self {
        let mut placement = self.clone();
        // The early, large shapes decide most.
        let front = placement.order.len().min(60);
        for _ in 0..=random.below(3) {
            let (from, to) = (random.below(front), random.below(front));
            let shape = placement.order.remove(from);
            placement.order.insert(to, shape);
        }
        if random.below(4) == 0 {
            placement.lean = random.below(4) as u32;
        }
        placement
    }
}

/// A linear congruential generator, for reproducible trials.
struct Lcg(u64);

impl Lcg {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % n as u64) as usize
    }
}
