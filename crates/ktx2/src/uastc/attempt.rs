//! Attempts at a block in one mode each, and the best of them so far.

use crate::uastc::axis::principal_ends;
use crate::uastc::block::Symbols;
use crate::uastc::fit::{Channel, Ends, Fit, Set, fit, polish};
use crate::uastc::mode::MODES;
use crate::uastc::partition::{Pattern, pattern};
use crate::uastc::search::{Limits, Polish};
use crate::uastc::weights::assign;

/// The mask of all texels.
pub(crate) const ALL: Channel = [1.0; 16];

/// The best block so far.
pub(crate) struct Search {
    pub(crate) limits: Limits,
    pub(crate) best: Option<Symbols>,
    pub(crate) error: f32,
}

impl Search {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { limits, best: None, error: f32::MAX }
    }

    /// Whether the block is good enough, with `channels` channels in the error.
    pub(crate) fn done(&self, channels: f32) -> bool {
        self.error <= self.limits.good * 16.0 * channels
    }

    fn fit<const C: usize, const BITS: u32>(&self, mode: u8, set: &Set<'_, C>, ends: &Ends<C>) -> Fit<C> {
        let range = MODES[usize::from(mode)].range;
        let mut found = fit::<C, BITS>(set, range, ends, self.limits.rounds);
        if self.limits.polish == Polish::Every {
            polish::<C, BITS>(set, range, &mut found);
        }
        found
    }

    /// A mode of one subset and one plane.
    pub(crate) fn one_set<const C: usize, const BITS: u32>(
        &mut self,
        mode: u8,
        set: &Set<'_, C>,
        ends: &Ends<C>,
    ) {
        let found = self.fit::<C, BITS>(mode, set, ends);
        if found.error < self.error {
            let mut symbols = empty(mode);
            store(&mut symbols, &found, (0, 0), &ALL, |c| c);
            self.keep(symbols, found.error);
        }
    }

    /// A mode of one subset in which `channel` has weights of its own.
    pub(crate) fn two_planes<const C: usize, const BITS: u32>(
        &mut self,
        mode: u8,
        channel: u8,
        others: &[Channel; C],
        metric: &[f32; C],
        own: &Channel,
        own_metric: f32,
    ) {
        let own = Set { channels: &[*own], mask: &ALL, metric: &[own_metric] };
        let others = Set { channels: others, mask: &ALL, metric };
        let first = self.fit::<C, BITS>(mode, &others, &principal_ends(&others));
        if first.error >= self.error {
            return;
        }
        let second = self.fit::<1, BITS>(mode, &own, &principal_ends(&own));
        let error = first.error + second.error;
        if error < self.error {
            let mut symbols = Symbols { channel, ..empty(mode) };
            let place = usize::from(channel).min(C);
            store(&mut symbols, &first, (0, 0), &ALL, |c| if c < place { c } else { c + 1 });
            store(&mut symbols, &second, (0, 1), &ALL, |_| place);
            self.keep(symbols, error);
        }
    }

    /// A mode of several subsets, in one of its patterns.
    pub(crate) fn subsets<const C: usize, const BITS: u32>(
        &mut self,
        number: u8,
        index: u8,
        channels: &[Channel; C],
        metric: &[f32; C],
    ) {
        let mode = &MODES[usize::from(number)];
        let Some(pattern) = pattern(number, mode.subsets, index) else { return };
        let mut symbols = Symbols { pattern: index, ..empty(number) };
        let mut error = 0.0;
        for subset in 0..mode.subsets {
            let mask = mask_of(pattern, subset);
            let set = Set { channels, mask: &mask, metric };
            let ends = principal_ends(&set);
            let found = self.fit::<C, BITS>(number, &set, &ends);
            error += found.error;
            if error >= self.error {
                return;
            }
            store(&mut symbols, &found, (subset, 0), &mask, |c| c);
        }
        self.keep(symbols, error);
    }

    fn keep(&mut self, symbols: Symbols, error: f32) {
        if error < self.error {
            self.error = error;
            self.best = Some(symbols);
        }
    }

    /// Betters the best block by steps of its endpoints.
    pub(crate) fn polish_winner(&mut self, channels: &[Channel; 4]) {
        let Some(mut symbols) = self.best else { return };
        if self.limits.polish != Polish::Winner || self.done(if symbols.mode < 8 { 3.0 } else { 4.0 }) {
            return;
        }
        let [r, g, b, a] = channels;
        let s = &mut symbols;
        let error = match s.mode {
            0 => each::<3, 4>(s, &[*r, *g, *b], &[1.0; 3]),
            2 => each::<3, 3>(s, &[*r, *g, *b], &[1.0; 3]),
            5 => each::<3, 3>(s, &[*r, *g, *b], &[1.0; 3]),
            1 | 3 | 4 | 7 => each::<3, 2>(s, &[*r, *g, *b], &[1.0; 3]),
            18 => each::<3, 5>(s, &[*r, *g, *b], &[1.0; 3]),
            6 => both::<2, 2>(s, channels, &[1.0; 2]),
            9 | 14 => each::<4, 2>(s, channels, &[1.0; 4]),
            10 => each::<4, 4>(s, channels, &[1.0; 4]),
            12 => each::<4, 3>(s, channels, &[1.0; 4]),
            11 => both::<3, 2>(s, channels, &[1.0; 3]),
            13 => both::<3, 1>(s, channels, &[1.0; 3]),
            15 => each::<2, 4>(s, &[*r, *a], &[3.0, 1.0]),
            16 => each::<2, 2>(s, &[*r, *a], &[3.0, 1.0]),
            _ => return,
        };
        self.keep(symbols, error);
    }
}

/// Polishes each subset of a block of one plane.
fn each<const C: usize, const BITS: u32>(
    symbols: &mut Symbols,
    channels: &[Channel; C],
    metric: &[f32; C],
) -> f32 {
    let subsets = MODES[usize::from(symbols.mode)].subsets;
    let Some(pattern) = pattern(symbols.mode, subsets, symbols.pattern) else { return f32::MAX };
    let mut error = 0.0;
    for subset in 0..subsets {
        let mask = mask_of(pattern, subset);
        let set = Set { channels, mask: &mask, metric };
        error += polish_part::<C, BITS>(symbols, &set, (subset, 0), |c| c);
    }
    error
}

/// Polishes both planes of a block.
fn both<const C: usize, const BITS: u32>(
    symbols: &mut Symbols,
    channels: &[Channel; 4],
    metric: &[f32; C],
) -> f32 {
    let own = usize::from(symbols.channel);
    let place = |c: usize| if c < own { c } else { c + 1 };
    let mut others = [[0.0; 16]; C];
    for c in 0..C {
        others[c] = channels[place(c)];
    }
    let set = Set { channels: &others, mask: &ALL, metric };
    let error = polish_part::<C, BITS>(symbols, &set, (0, 0), place);
    let set = Set { channels: &[channels[own]], mask: &ALL, metric: &[1.0] };
    error + polish_part::<1, BITS>(symbols, &set, (0, 1), |_| own)
}

/// Polishes the endpoints of one subset and plane, and returns their error.
fn polish_part<const C: usize, const BITS: u32>(
    symbols: &mut Symbols,
    set: &Set<'_, C>,
    part: (usize, usize),
    place: impl Fn(usize) -> usize,
) -> f32 {
    let mode = &MODES[usize::from(symbols.mode)];
    let mut ends = [[0; C]; 2];
    for c in 0..C {
        let at = (part.0 * mode.components + place(c)) * 2;
        for end in 0..2 {
            ends[end][c] = mode.range.rank[usize::from(symbols.endpoints[at + end])];
        }
    }
    let mut found = assign::<C, BITS>(set, mode.range, ends);
    polish::<C, BITS>(set, mode.range, &mut found);
    store(symbols, &found, part, set.mask, place);
    found.error
}

fn empty(mode: u8) -> Symbols {
    Symbols { mode, pattern: 0, channel: 3, endpoints: [0; 18], weights: [0; 32] }
}

/// Writes the endpoints and weights of a fit into a block, at a subset and a
/// plane; `place` says which component of the mode a channel of the fit is.
fn store<const C: usize>(
    symbols: &mut Symbols,
    found: &Fit<C>,
    (subset, plane): (usize, usize),
    mask: &Channel,
    place: impl Fn(usize) -> usize,
) {
    let mode = &MODES[usize::from(symbols.mode)];
    for c in 0..C {
        let at = (subset * mode.components + place(c)) * 2;
        for end in 0..2 {
            symbols.endpoints[at + end] = mode.range.code[usize::from(found.ends[end][c])];
        }
    }
    for i in 0..16 {
        if mask[i] > 0.0 {
            symbols.weights[i * mode.planes + plane] = found.weights[i] as u8;
        }
    }
}

fn mask_of(pattern: &Pattern, subset: usize) -> Channel {
    pattern.map(|s| if usize::from(s) == subset { 1.0 } else { 0.0 })
}
