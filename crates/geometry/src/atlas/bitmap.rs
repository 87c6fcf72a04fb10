//! Occupied cells of the square and the row spans of a shape.

use super::overlap::rows_of;
use photofit_scalar::Vec2;
use std::ops::RangeInclusive;

/// Cells covered by a shape: per row, disjoint spans `[from, to)` in increasing order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mask {
    pub(super) width: u32,
    pub(super) height: u32,
    start: Vec<u32>,
    spans: Vec<(u32, u32)>,
    /// Longest span of each row.
    longest: Vec<u32>,
}

/// Rounding guard, in cells.
const GUARD: f64 = 1e-3;

impl Mask {
    /// Every cell that touches the region inside the closed, simple, disjoint loops that the segments of `outline`
    /// make, in any order; points are in cells and not negative.
    pub(super) fn of_outline(outline: &[[Vec2<f64>; 2]], width: u32, height: u32) -> Self {
        let words = (width as usize).div_ceil(64);
        let last = height as usize - 1;
        let mut bits = vec![0_u64; words * height as usize];
        let mut crossings: Vec<(u32, f64)> = Vec::new();
        for &[a, b] in outline {
            // The shifts make rows that are met within rounding count as met.
            for shift in [-GUARD, GUARD] {
                let moved = |q: Vec2<f64>| Vec2 { x: q.x, y: q.y + shift };
                rows_of(moved(a), moved(b), |row, x0, x1| {
                    let at = (row.max(0) as usize).min(last) * words;
                    let from = ((x0 - GUARD).floor().max(0.0) as usize).min(width as usize - 1);
                    let to = ((x1 + GUARD).floor().max(0.0) as usize + 1).min(width as usize);
                    fill(&mut bits[at..at + words], from, to);
                });
            }
            // Rows whose middle lies in `[low, high)`: neighbouring segments share no crossing.
            let (low, high) = if a.y <= b.y { (a, b) } else { (b, a) };
            let first = (low.y - 0.5).ceil().max(0.0) as u32;
            let end = ((high.y - 0.5).ceil().max(0.0) as u32).min(height);
            let slope = (high.x - low.x) / (high.y - low.y);
            crossings.extend((first..end).map(|r| (r, low.x + slope * (f64::from(r) + 0.5 - low.y))));
        }
        // A cell that no segment touches is inside as a whole or not at all: its middle decides.
        crossings.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        for row in crossings.chunk_by(|a, b| a.0 == b.0) {
            let at = row[0].0 as usize * words;
            for pair in row.chunks_exact(2) {
                let from = (pair[0].1 - 0.5).ceil().max(0.0) as usize;
                let to = ((pair[1].1 - 0.5).ceil().max(0.0) as usize).min(width as usize);
                fill(&mut bits[at..at + words], from, to);
            }
        }
        Self::of_bits(&bits, width, height)
    }

    fn of_bits(bits: &[u64], width: u32, height: u32) -> Self {
        let words = (width as usize).div_ceil(64);
        let mut start = vec![0];
        let mut spans = Vec::new();
        let mut longest = Vec::with_capacity(height as usize);
        for row in bits.chunks_exact(words) {
            let mut x = 0;
            let mut most = 0;
            while let Some(from) = next_bit(row, x, true) {
                let to = next_bit(row, from, false).unwrap_or(words * 64);
                spans.push((from as u32, to as u32));
                most = most.max((to - from) as u32);
                x = to;
            }
            longest.push(most);
            start.push(spans.len() as u32);
        }
        Self { width, height, start, spans, longest }
    }

    #[inline]
    pub(super) fn row(&self, y: u32) -> &[(u32, u32)] {
        &self.spans[self.start[y as usize] as usize..self.start[y as usize + 1] as usize]
    }

    /// The cells within `by` cells (in either axis) of the shape; the box grows by `2 by` and its corner moves by `-by`.
    pub(super) fn grown(&self, by: u32) -> Self {
        let (width, height) = (self.width + 2 * by, self.height + 2 * by);
        let words = (width as usize).div_ceil(64);
        let mut bits = vec![0_u64; words * height as usize];
        for r in 0..self.height {
            for &(a, b) in self.row(r) {
                for row in r..=r + 2 * by {
                    let at = row as usize * words;
                    fill(&mut bits[at..at + words], a as usize, (b + 2 * by) as usize);
                }
            }
        }
        Self::of_bits(&bits, width, height)
    }

    /// Number of covered cells.
    pub(super) fn area(&self) -> u64 {
        self.spans.iter().map(|s| u64::from(s.1 - s.0)).sum()
    }
}

/// First position from `x` on whose bit equals `value`.
fn next_bit(row: &[u64], x: usize, value: bool) -> Option<usize> {
    let mut word = x / 64;
    let look = |w: u64| if value { w } else { !w };
    let mut bits = look(*row.get(word)?) & (u64::MAX << (x % 64));
    while bits == 0 {
        word += 1;
        bits = look(*row.get(word)?);
    }
    Some(word * 64 + bits.trailing_zeros() as usize)
}

/// Sets the bits `[from, to)`.
#[inline]
fn fill(row: &mut [u64], from: usize, to: usize) {
    if from >= to {
        return;
    }
    let (first, last) = (from / 64, (to - 1) / 64);
    let head = u64::MAX << (from % 64);
    let tail = u64::MAX >> (63 - (to - 1) % 64);
    if first == last {
        row[first] |= head & tail;
        return;
    }
    row[first] |= head;
    row[first + 1..last].fill(u64::MAX);
    row[last] |= tail;
}

/// Longest run of clear bits among the first `width`.
fn longest_free(row: &[u64], width: usize) -> u32 {
    let (mut x, mut best) = (0, 0);
    while let Some(from) = next_bit(row, x, false).filter(|&f| f < width) {
        x = next_bit(row, from, true).unwrap_or(width).min(width);
        best = best.max(x - from);
    }
    best as u32
}

/// Clears the bits `[from, to)`.
#[inline]
fn clear(row: &mut [u64], from: usize, to: usize) {
    if from >= to {
        return;
    }
    let (first, last) = (from / 64, (to - 1) / 64);
    let head = u64::MAX << (from % 64);
    let tail = u64::MAX >> (63 - (to - 1) % 64);
    if first == last {
        row[first] &= !(head & tail);
        return;
    }
    row[first] &= !head;
    row[first + 1..last].fill(0);
    row[last] &= !tail;
}

/// Last set bit in `[from, to)`.
#[inline]
fn last_set(row: &[u64], from: usize, to: usize) -> Option<usize> {
    let (first, last) = (from / 64, (to - 1) / 64);
    let mut word = last;
    let mut bits = row[last] & (u64::MAX >> (63 - (to - 1) % 64));
    loop {
        if word == first {
            bits &= u64::MAX << (from % 64);
        }
        if bits != 0 {
            return Some(word * 64 + 63 - bits.leading_zeros() as usize);
        }
        if word == first {
            return None;
        }
        word -= 1;
        bits = row[word];
    }
}

/// The first collision of the rows of a shape, that of the row `hint` before those in `order`; `hint` becomes the row that
/// collides.
#[inline]
fn first_collision(order: &[u32], hint: &mut u32, row: impl Fn(u32) -> Option<u32>) -> Option<u32> {
    if let Some(next) = row(*hint) {
        return Some(next);
    }
    let (r, next) = order.iter().find_map(|&r| row(r).map(|next| (r, next)))?;
    *hint = r;
    Some(next)
}

/// A strip of cells, `width` wide and as high as needed; cells around placed shapes are kept free.
pub(super) struct Strip {
    width: u32,
    words: usize,
    rows: Vec<u64>,
    /// Longest free run of each row.
    run: Vec<u32>,
    /// Rows up to here have no free cell.
    full: u32,
}

impl Strip {
    pub(super) fn new(width: u32) -> Self {
        Self { width, words: (width as usize).div_ceil(64), rows: Vec::new(), run: Vec::new(), full: 0 }
    }

    /// Lowest, then leftmost place of the shape with its lowest row in `from..=last`.
    pub(super) fn find(&self, mask: &Mask, order: &[u32], from: u32, last: u32) -> Option<(u32, u32)> {
        if mask.width > self.width {
            return None;
        }
        let room = self.width - mask.width;
        let mut hint = 0;
        for y in from.max(self.full)..=last {
            let Some(run) = self.run.get(y as usize..) else { return Some((0, y)) };
            let narrow = |r: &u32| run.get(*r as usize).is_some_and(|&free| free < mask.longest[*r as usize]);
            if narrow(&hint) || order.iter().any(narrow) {
                continue;
            }
            let mut x = 0;
            while let Some(next) = self.collision(mask, order, x, y, &mut hint) {
                x = next;
                if x > room {
                    break;
                }
            }
            if x <= room {
                return Some((x, y));
            }
        }
        None
    }

    /// The first `x` past the collision found for the shape at `(x, y)`; `None` where it fits. `hint` is the row that
    /// collided last.
    #[inline]
    fn collision(&self, mask: &Mask, order: &[u32], x: u32, y: u32, hint: &mut u32) -> Option<u32> {
        first_collision(order, hint, |r| self.row_collision(mask, r, x, y))
    }

    #[inline]
    fn row_collision(&self, mask: &Mask, r: u32, x: u32, y: u32) -> Option<u32> {
        let at = (y + r) as usize * self.words;
        let row = self.rows.get(at..at + self.words)?;
        for &(a, b) in mask.row(r) {
            if let Some(q) = last_set(row, (x + a) as usize, (x + b) as usize) {
                return Some(q as u32 + 1 - a);
            }
        }
        None
    }

    /// Occupies the shape at `(x, y)` and `padding` cells around it.
    pub(super) fn place(&mut self, mask: &Mask, x: u32, y: u32, padding: u32) {
        let top = (y + mask.height + padding) as usize;
        if self.rows.len() < top * self.words {
            self.rows.resize(top * self.words, 0);
            self.run.resize(top, self.width);
        }
        for r in 0..mask.height {
            let low = (y + r).saturating_sub(padding) as usize;
            let high = (y + r + padding) as usize;
            for &(a, b) in mask.row(r) {
                let from = (x + a).saturating_sub(padding) as usize;
                let to = ((x + b + padding) as usize).min(self.width as usize);
                for row in low..=high {
                    fill(&mut self.rows[row * self.words..(row + 1) * self.words], from, to);
                }
            }
        }
        for y in y.saturating_sub(padding) as usize..top {
            let row = &self.rows[y * self.words..(y + 1) * self.words];
            self.run[y] = longest_free(row, self.width as usize);
        }
        while self.run.get(self.full as usize).is_some_and(|&free| free == 0) {
            self.full += 1;
        }
    }
}

/// A square of cells with the shapes that stand on it, without padding, so that they can be taken away again.
pub(super) struct Board {
    size: u32,
    words: usize,
    rows: Vec<u64>,
}

impl Board {
    pub(super) fn new(size: u32) -> Self {
        let words = (size as usize).div_ceil(64);
        Self { size, words, rows: vec![0; words * size as usize] }
    }

    /// Puts the shape down with its lower corner at `(x, y)`, or takes it away.
    pub(super) fn set(&mut self, mask: &Mask, x: u32, y: u32, present: bool) {
        for r in 0..mask.height {
            let at = (y + r) as usize * self.words;
            let row = &mut self.rows[at..at + self.words];
            for &(a, b) in mask.row(r) {
                let (from, to) = ((x + a) as usize, (x + b) as usize);
                if present { fill(row, from, to) } else { clear(row, from, to) }
            }
        }
    }

    /// First free column in `xs` for the shape with its lower corner in row `y`.
    pub(super) fn free_column(
        &self,
        mask: &Mask,
        probe: &[u32],
        xs: RangeInclusive<u32>,
        y: u32,
        hint: &mut u32,
    ) -> Option<u32> {
        let last = (*xs.end()).min(self.size.checked_sub(mask.width)?);
        if y > self.size.checked_sub(mask.height)? {
            return None;
        }
        let mut x = *xs.start();
        while x <= last {
            match self.collision(mask, probe, x, y, hint) {
                Some(next) => x = next,
                None => return Some(x),
            }
        }
        None
    }

    fn collision(&self, mask: &Mask, probe: &[u32], x: u32, y: u32, hint: &mut u32) -> Option<u32> {
        first_collision(probe, hint, |r| self.row_collision(mask, r, x, y))
    }

    #[inline]
    fn row_collision(&self, mask: &Mask, r: u32, x: u32, y: u32) -> Option<u32> {
        let at = (y + r) as usize * self.words;
        let row = &self.rows[at..at + self.words];
        mask.row(r)
            .iter()
            .find_map(|&(a, b)| last_set(row, (x + a) as usize, (x + b) as usize).map(|q| q as u32 + 1 - a))
    }
}

/// Rows of a shape in an order that meets obstacles early: ends and middle first, then ever finer.
pub(super) fn probe_order(height: u32) -> Vec<u32> {
    let mut order = Vec::with_capacity(height as usize);
    let mut seen = vec![false; height as usize];
    let mut step = height.next_power_of_two();
    let mut push = |r: u32, order: &mut Vec<u32>| {
        if r < height && !std::mem::replace(&mut seen[r as usize], true) {
            order.push(r);
        }
    };
    if height > 0 {
        push(height - 1, &mut order);
    }
    while step > 0 {
        (0..height).step_by(step as usize).for_each(|r| push(r, &mut order));
        step /= 2;
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec2;

    #[test]
    fn mask_covers_each_touched_cell() {
        let points = [vec2(0.2, 0.2), vec2(6.7, 1.4), vec2(2.1, 4.9)];
        let mask = Mask::of_outline(&[0, 1, 2].map(|k| [points[k], points[(k + 1) % 3]]), 7, 5);
        for y in 0..5_u32 {
            for x in 0..7_u32 {
                let inside = |px: f64, py: f64| {
                    (0..3).all(|k| {
                        let (a, b) = (points[k], points[(k + 1) % 3]);
                        (b.x - a.x) * (py - a.y) - (b.y - a.y) * (px - a.x) >= 0.0
                    })
                };
                let touched = (0..=20).any(|i| {
                    (0..=20).any(|j| {
                        inside(f64::from(x) + f64::from(i) / 20.0, f64::from(y) + f64::from(j) / 20.0)
                    })
                });
                let covered = mask.row(y).iter().any(|s| (s.0..s.1).contains(&x));
                assert!(covered || !touched, "cell ({x}, {y}) is touched but not covered");
                let near = (-4..=24).any(|i| {
                    (-4..=24).any(|j| {
                        inside(f64::from(x) + f64::from(i) / 20.0, f64::from(y) + f64::from(j) / 20.0)
                    })
                });
                assert!(near || !covered, "cell ({x}, {y}) is covered far from the triangle");
            }
        }
    }

    #[test]
    fn strip_places_shapes_apart_and_low() {
        let square = |s: f64| {
            let p = [vec2(0.0, 0.0), vec2(s, 0.0), vec2(s, s), vec2(0.0, s)];
            Mask::of_outline(&[0, 1, 2, 3].map(|k| [p[k], p[(k + 1) % 4]]), s.ceil() as u32, s.ceil() as u32)
        };
        let mut strip = Strip::new(100);
        let mask = square(29.5);
        let order = probe_order(mask.height);
        let mut at = Vec::new();
        for _ in 0..6 {
            let (x, y) = strip.find(&mask, &order, 0, 200).unwrap();
            strip.place(&mask, x, y, 2);
            at.push((x, y));
        }
        assert_eq!(at, [(0, 0), (32, 0), (64, 0), (0, 32), (32, 32), (64, 32)]);
        assert_eq!(strip.find(&square(100.9), &probe_order(101), 0, 500), None, "wider than the strip");
    }

    #[test]
    fn probe_order_lists_every_row_once() {
        for h in [1, 2, 3, 17, 64] {
            let mut o = probe_order(h);
            o.sort_unstable();
            assert_eq!(o, (0..h).collect::<Vec<_>>());
        }
    }
}
