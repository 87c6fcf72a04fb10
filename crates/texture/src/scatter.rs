//! Texel gradients: pixels queue what they read, bands of texel rows then add it up in a fixed order.
//!
//! A pixel's adjoint touches texels anywhere, so pixels in parallel would need atomics, whose order changes the last
//! bits. Instead every task queues its pixels, sorted into bands of v; each band is summed by one thread that walks
//! the queues in order. The result does not depend on the number of threads.

use super::filter::add_scaled;
use super::{Lookup, Pyramid, Taps, Texture};
use photofit_scalar::Real;
use photofit_scalar::wide::{Kernel, Width, run_up_to};
use rayon::prelude::*;

/// Bands of texel rows.
const BANDS: usize = 32;

/// What one pixel hands back to the texture.
#[derive(Clone, Copy, Debug)]
struct Entry<T, const C: usize> {
    at: Lookup<T>,
    g: [T; C],
}

/// What pixels side by side that read the same texels of one level hand back to these: the texture seen enlarged.
#[derive(Clone, Copy, Debug)]
struct Shared<T, const C: usize> {
    level: usize,
    index: [u32; 4],
    g: [[T; C]; 4],
}

/// Marks the ids of what is shared.
const SHARED: u32 = 1 << 31;

/// The pixels of one task.
#[derive(Clone, Debug)]
pub struct ScatterQueue<T, const C: usize> {
    entries: Vec<Entry<T, C>>,
    shared: Vec<Shared<T, C>>,
    bands: Vec<Vec<u32>>,
}

impl<T: Real, const C: usize> Default for ScatterQueue<T, C> {
    fn default() -> Self {
        Self { entries: Vec::new(), shared: Vec::new(), bands: vec![Vec::new(); BANDS] }
    }
}

/// Band of a row.
#[inline(always)]
fn band(row: u32, height: usize) -> u32 {
    row * BANDS as u32 / height as u32
}

/// Bands of the upper and the lower row of taps.
#[inline(always)]
fn bands<T, const C: usize>([upper, _, lower, _]: [u32; 4], t: &Texture<T, C>) -> [u32; 2] {
    let width = t.width as u32;
    let row = upper / width;
    let first = band(row, t.height);
    let second = if lower == upper {
        first
    } else if lower == upper + width {
        band(row + 1, t.height)
    } else {
        band(lower / width, t.height)
    };
    [first, second]
}

impl<T: Real, const C: usize> ScatterQueue<T, C> {
    /// Forgets all pixels and keeps the memory.
    pub fn clear(&mut self) {
        self.entries.clear();
        self.shared.clear();
        self.bands.iter_mut().for_each(Vec::clear);
    }

    /// Queues the adjoints of lookups `[n]` for the gradients `g` `[n]` of their values.
    ///
    /// # Panics
    /// If `g` is shorter, or a lookup is not of the texture.
    #[inline(always)]
    pub fn push(&mut self, texture: &Pyramid<T, C>, at: &[Lookup<T>], g: &[[T; C]]) {
        let mut i = 0;
        while i < at.len() {
            let first = &at[i];
            let mut end = i + 1;
            if first.coarse.is_none() {
                let same = |o: &Lookup<T>| {
                    o.coarse.is_none() && o.level == first.level && o.fine.index == first.fine.index
                };
                while end < at.len() && same(&at[end]) {
                    end += 1;
                }
            }
            if end == i + 1 {
                self.push_one(texture, first, &g[i]);
            } else {
                self.push_shared(texture, &at[i..end], &g[i..end]);
            }
            i = end;
        }
    }

    #[inline(always)]
    fn push_one(&mut self, texture: &Pyramid<T, C>, at: &Lookup<T>, g: &[T; C]) {
        let id = self.entries.len() as u32;
        self.entries.push(Entry { at: *at, g: *g });
        let [a, b] = bands(at.fine.index, &texture.levels[at.level]);
        let [c, d] = match &at.coarse {
            Some((taps, _)) => bands(taps.index, &texture.levels[at.level + 1]),
            None => [a, b],
        };
        self.bands[a as usize].push(id);
        if b != a {
            self.bands[b as usize].push(id);
        }
        if c != a && c != b {
            self.bands[c as usize].push(id);
        }
        if d != a && d != b && d != c {
            self.bands[d as usize].push(id);
        }
    }

    #[inline(always)]
    fn push_shared(&mut self, texture: &Pyramid<T, C>, at: &[Lookup<T>], g: &[[T; C]]) {
        let (level, index) = (at[0].level, at[0].fine.index);
        let mut sum = [[T::zero(); C]; 4];
        for (at, g) in at.iter().zip(g) {
            let w = at.fine.weights();
            for k in 0..4 {
                add_scaled(&mut sum[k], g, w[k]);
            }
        }
        let id = self.shared.len() as u32 | SHARED;
        self.shared.push(Shared { level, index, g: sum });
        let [a, b] = bands(index, &texture.levels[level]);
        self.bands[a as usize].push(id);
        if b != a {
            self.bands[b as usize].push(id);
        }
    }
}

/// Adds queued adjoints to texel gradients.
#[derive(Debug)]
pub struct Scatter;

/// Rows of one level that belong to a band.
struct Rows<'a, T, const C: usize> {
    first: usize,
    texels: &'a mut [[T; C]],
}

impl Scatter {
    /// Accumulates the queues, in order, into the gradients of every level.
    pub fn accumulate<T: Real, const C: usize>(queues: &[&ScatterQueue<T, C>], gradient: &mut Pyramid<T, C>) {
        let sizes: Vec<(usize, usize)> = gradient.levels.iter().map(|l| (l.width, l.height)).collect();
        let mut bands: Vec<Vec<Rows<'_, T, C>>> =
            (0..BANDS).map(|_| Vec::with_capacity(sizes.len())).collect();
        for level in &mut gradient.levels {
            let mut rest = level.texels.as_mut_slice();
            let mut first = 0;
            for (b, rows) in bands.iter_mut().enumerate() {
                // Rows r with band(r) == b.
                let end = ((b + 1) * level.height).div_ceil(BANDS);
                let (head, tail) = rest.split_at_mut((end - first) * level.width);
                rows.push(Rows { first: first * level.width, texels: head });
                rest = tail;
                first = end;
            }
        }
        bands.par_iter_mut().enumerate().for_each(|(b, rows)| {
            run_up_to(Width::Avx512, AddBand { queues, band: b, rows });
        });
    }
}

/// Adds what lies in one band.
struct AddBand<'a, 'b, T, const C: usize> {
    queues: &'a [&'a ScatterQueue<T, C>],
    band: usize,
    rows: &'a mut [Rows<'b, T, C>],
}

impl<T: Real, const C: usize> Kernel for AddBand<'_, '_, T, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { queues, band, rows } = self;
        for q in queues {
            for &id in &q.bands[band] {
                if id & SHARED != 0 {
                    let s = &q.shared[(id & !SHARED) as usize];
                    for (index, g) in s.index.iter().zip(&s.g) {
                        if let Some(t) = rows[s.level].texel(*index) {
                            add_scaled(t, g, T::one());
                        }
                    }
                    continue;
                }
                let e = &q.entries[id as usize];
                match &e.at.coarse {
                    None => add(&mut rows[e.at.level], &e.at.fine, &e.g, T::one()),
                    Some((taps, share)) => {
                        add(&mut rows[e.at.level], &e.at.fine, &e.g, T::one() - *share);
                        add(&mut rows[e.at.level + 1], taps, &e.g, *share);
                    }
                }
            }
        }
    }
}

impl<T, const C: usize> Rows<'_, T, C> {
    /// A texel by its index in the level, if it lies in these rows.
    #[inline(always)]
    fn texel(&mut self, index: u32) -> Option<&mut [T; C]> {
        self.texels.get_mut((index as usize).wrapping_sub(self.first))
    }
}

/// Adds the taps that fall into the band's rows.
#[inline(always)]
fn add<T: Real, const C: usize>(rows: &mut Rows<'_, T, C>, taps: &Taps<T>, g: &[T; C], scale: T) {
    let w = taps.weights();
    for k in 0..4 {
        if let Some(t) = rows.texel(taps.index[k]) {
            add_scaled(t, g, w[k] * scale);
        }
    }
}
