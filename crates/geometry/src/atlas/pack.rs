//! Packing of chart shapes into the square: lowest free place on a bitmap, largest scale that fits.

use super::bitmap::{Mask, Strip, probe_order};
use photofit_scalar::{Vec2, vec2};
use std::collections::HashMap;

/// A chart to pack, in its own units, lower corner of its box at the origin.
pub(super) struct Shape {
    pub(super) points: Vec<Vec2<f64>>,
    pub(super) corners: Vec<[u32; 3]>,
    pub(super) size: Vec2<f64>,
    pub(super) area: f64,
}

impl Shape {
    /// Points in cells for a quarter-turn count of 0..4, lower corner at the origin.
    fn turned(&self, turn: u32, scale: f64) -> Vec<Vec2<f64>> {
        self.points.iter().map(|&p| turn_point(p, self.size, turn) * scale).collect()
    }

    fn mask(&self, turn: u32, scale: f64) -> Mask {
        let size = if turn % 2 == 0 { self.size } else { vec2(self.size.y, self.size.x) } * scale;
        // One spare cell takes rounding; `Mask` trims nothing, so it is only asked for where it can be needed.
        let cells = |s: f64| ((s + 2e-3).floor() as u32).saturating_add(1);
        Mask::of_triangles(&self.turned(turn, scale), &self.corners, cells(size.x), cells(size.y))
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
#[derive(Debug)]
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

struct Packer<'a> {
    shapes: &'a [Shape],
    size: u32,
    padding: u32,
}

impl Packer<'_> {
    /// Finds a large scale on coarse cells with several orders, then repeats the best at single texels.
    fn search(&self) -> Option<Layout> {
        let inner = f64::from(self.size - 2 * self.padding);
        let area: f64 = self.shapes.iter().map(|s| s.area).sum();
        let guess = if area > 0.0 { (0.6 / area).sqrt() * inner } else { 1.0 };
        let count = self.shapes.len();
        let cell = if count > 400 { 1 } else { (self.size / 256).clamp(1, 8) };
        let mut order = self.order(0);
        let mut start = guess;
        if cell > 1 {
            let (scale, best) = self.coarse(cell, guess, &order);
            start = scale;
            order = best;
        }
        self.fit(1, start, &order, if cell > 1 { 0.04 } else { 0.2 })
    }

    /// Orders to place the shapes in; larger ones first by different measures.
    fn order(&self, kind: u32) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.shapes.len() as u32).collect();
        let key = |i: u32| {
            let s = &self.shapes[i as usize];
            match kind {
                0 => s.size.x * s.size.y,
                1 => s.size.x,
                2 => s.area,
                _ => s.size.x + s.size.y,
            }
        };
        order.sort_by(|&a, &b| key(b).total_cmp(&key(a)).then(a.cmp(&b)));
        order
    }

    /// Best scale over several orders on cells of `cell` texels, improved by deterministic exchanges.
    fn coarse(&self, cell: u32, guess: f64, first: &[u32]) -> (f64, Vec<u32>) {
        let mut best = (self.fit(cell, guess, first, 0.2).map_or(0.5 * guess, |l| l.scale), first.to_vec());
        let tries = 2000 / self.shapes.len().max(20);
        let mut random = 0x9E37_79B9_7F4A_7C15_u64;
        let mut next = |n: u64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) % n
        };
        let count = self.shapes.len() as u64;
        for step in 0..tries {
            let order = if step < 3 {
                self.order(step as u32 + 1)
            } else {
                // Early places matter most: move one shape near the front.
                let mut order = best.1.clone();
                let (from, to) = (next(count.min(40)) as usize, next(count.min(40)) as usize);
                let shape = order.remove(from);
                order.insert(to, shape);
                order
            };
            let mut scale = best.0 * 1.004;
            while self.place_all(cell, scale, &order).is_some() {
                best = (scale, order.clone());
                scale *= 1.01;
            }
        }
        best
    }

    /// Largest scale found by bracketing from `start`; `reach` is the first step.
    fn fit(&self, cell: u32, start: f64, order: &[u32], reach: f64) -> Option<Layout> {
        let (mut good, mut bad): (Option<(f64, Vec<Place>)>, f64) = (None, f64::INFINITY);
        let mut scale = start;
        let mut step = reach;
        for _ in 0..60 {
            match self.place_all(cell, scale, order) {
                Some(places) => good = Some((scale, places)),
                None => bad = scale,
            }
            scale = match &good {
                Some((g, _)) if bad / g < 1.003 => break,
                Some((g, _)) if bad.is_finite() => 0.5 * (g + bad),
                Some((g, _)) => g * (1.0 + step),
                None => bad / (1.0 + step),
            };
            if good.is_none() {
                step = (step * 2.0).min(1.0);
            }
            if scale * self.largest() < 1e-3 {
                break;
            }
        }
        good.map(|(scale, places)| Layout { places, scale, padding: self.padding })
    }

    fn largest(&self) -> f64 {
        self.shapes.iter().map(|s| s.size.x).fold(0.0, f64::max)
    }

    /// Places every shape at one scale, or `None`.
    fn place_all(&self, cell: u32, scale: f64, order: &[u32]) -> Option<Vec<Place>> {
        let inner = (self.size - 2 * self.padding) / cell;
        let padding = self.padding.div_ceil(cell);
        let scale = scale / f64::from(cell);
        if self.largest() * scale > f64::from(inner) * 1.42 {
            return None;
        }
        let many = self.shapes.len() > 400;
        let first: Vec<Mask> = self.shapes.iter().map(|s| s.mask(0, scale)).collect();
        // Shapes grown by the padding to two sides are disjoint inside the square grown alike.
        let pad = u64::from(padding);
        let need: u64 = first
            .iter()
            .map(|m| {
                m.area() + pad * (u64::from(m.width) + u64::from(m.height)) * u64::from(many) + pad * pad
            })
            .sum();
        if need > (u64::from(inner) + pad).pow(2) {
            return None;
        }
        let mut strip = Strip::new(inner);
        let mut places = vec![Place::default(); self.shapes.len()];
        // Where a shape of about this box was last placed: the next one starts there.
        let mut hints: HashMap<(u32, u32), u32> = HashMap::new();
        for &i in order {
            let shape = &self.shapes[i as usize];
            let base = &first[i as usize];
            let small = many && base.width.max(base.height) <= 24;
            let key = (base.width.max(base.height), base.width.min(base.height));
            let from = if small { hints.get(&key).copied().unwrap_or(0) } else { 0 };
            let mut best: Option<(u32, u32, Place, Mask)> = None;
            let mut seen: Vec<Mask> = Vec::new();
            for turn in 0..4 {
                let mask = if turn == 0 { base.clone() } else { shape.mask(turn, scale) };
                if mask.height > inner || seen.contains(&mask) {
                    continue;
                }
                let mut last = inner - mask.height;
                if let Some((top, ..)) = &best {
                    if *top < mask.height {
                        continue;
                    }
                    last = last.min(top - mask.height);
                }
                let probe = probe_order(mask.height);
                if let Some((x, y)) = strip.find(&mask, &probe, from, last) {
                    let top = y + mask.height;
                    if best.as_ref().is_none_or(|b| (top, x) < (b.0, b.1)) {
                        best = Some((top, x, Place { x, y, turn }, mask.clone()));
                    }
                }
                seen.push(mask);
            }
            let (_, _, place, mask) = best?;
            if small {
                hints.insert(key, place.y);
            }
            strip.place(&mask, place.x, place.y, padding);
            places[i as usize] = Place {
                x: place.x * cell + self.padding,
                y: place.y * cell + self.padding,
                turn: place.turn,
            };
        }
        Some(places)
    }
}
