//! Choice of the mode of a block: fits in several modes, best one kept.

use crate::uastc::attempt::{ALL, Search};
use crate::uastc::axis::principal_ends;
use crate::uastc::block::{Symbols, pack_solid};
use crate::uastc::divide::{Division, three_subsets, two_subsets};
use crate::uastc::fit::{Channel, Ends, Set, sum};
use crate::uastc::hints::Hints;
use crate::uastc::mode::MODES;

/// How much is tried for a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// Few modes, few rounds.
    Fast,
    /// The usual trade.
    #[default]
    Normal,
    /// All modes, more patterns and rounds.
    Best,
}

/// Limits that an [`Effort`] stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Rounds of a fit.
    pub(crate) rounds: u32,
    /// Squared error of a channel's texel below which a block is good enough.
    pub(crate) good: f32,
    /// Part of the squared error below which what lies off one line does not
    /// call for modes of several lines.
    pub(crate) aligned: f32,
    /// Number of patterns to try.
    pub(crate) patterns: usize,
    /// Try every channel for the second plane, and modes that seldom win.
    pub(crate) all: bool,
    /// Steps of endpoint ranks to try at the end: for every fit, or for the best alone.
    pub(crate) polish: Polish,
}

impl Effort {
    fn limits(self) -> Limits {
        match self {
            Self::Fast => {
                Limits { rounds: 2, good: 2.0, aligned: 0.7, patterns: 1, all: false, polish: Polish::None }
            }
            Self::Normal => {
                Limits { rounds: 2, good: 0.3, aligned: 0.6, patterns: 2, all: false, polish: Polish::Winner }
            }
            Self::Best => {
                Limits { rounds: 6, good: 0.0, aligned: 0.0, patterns: 8, all: true, polish: Polish::Every }
            }
        }
    }
}

/// Which fits are bettered step by step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Polish {
    None,
    Winner,
    Every,
}

/// What a search found for a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Found {
    /// All texels have this colour.
    Solid([u8; 4]),
    /// A block in another mode, and the squared error over all texels and channels.
    Block(Symbols, f32),
}

impl Found {
    /// The block's bytes, with transcoder hints for its texels or the fixed ones.
    pub(crate) fn pack(&self, with_hints: bool) -> [u8; 16] {
        match self {
            Self::Solid(colour) => pack_solid(*colour, &Hints::of_colour(*colour)),
            Self::Block(symbols, _) if with_hints => {
                let alpha = MODES[usize::from(symbols.mode)].has_alpha();
                symbols.pack(&Hints::of_texels(&symbols.texels(), alpha))
            }
            Self::Block(symbols, _) => symbols.pack(&Hints::default()),
        }
    }

    /// The texels that a decoder makes of the block.
    pub(crate) fn texels(&self) -> [[u8; 4]; 16] {
        match self {
            Self::Solid(colour) => [*colour; 16],
            Self::Block(symbols, _) => symbols.texels(),
        }
    }
}

/// Finds the block with the least squared error among those that `effort` tries.
pub(crate) fn search(texels: &[[u8; 4]; 16], effort: Effort) -> Found {
    if texels.iter().all(|t| t == &texels[0]) {
        return Found::Solid(texels[0]);
    }
    let mut channels = [[0.0; 16]; 4];
    for (i, texel) in texels.iter().enumerate() {
        for c in 0..4 {
            channels[c][i] = texel[c].into();
        }
    }
    let grey = texels.iter().all(|t| t[0] == t[1] && t[1] == t[2]);
    let opaque = texels.iter().all(|t| t[3] == 255);
    let mut search = Search::new(effort.limits());
    let [r, g, b, a] = channels;
    if grey {
        search.grey(&[g, a], opaque);
    }
    if opaque && !search.done(3.0) {
        search.rgb(&[r, g, b], grey);
    } else if !search.done(4.0) {
        search.rgba(&channels);
    }
    search.polish_winner(&channels);
    match search.best {
        Some(symbols) => Found::Block(symbols, search.error),
        // Not reached: every texel set has been fitted in some mode.
        None => Found::Solid(texels[0]),
    }
}

impl Search {
    fn grey(&mut self, channels: &[Channel; 2], opaque: bool) {
        let metric = [3.0, 1.0];
        let set = Set { channels, mask: &ALL, metric: &metric };
        self.one_set::<2, 4>(15, &set, &principal_ends(&set));
        if !opaque && !self.done(4.0) {
            let [l, a] = channels;
            self.two_planes::<1, 2>(17, 3, &[*l], &[3.0], a, 1.0);
        }
        if !self.done(4.0) {
            self.divided_grey(channels, &metric);
        }
    }

    fn divided_grey(&mut self, channels: &[Channel; 2], metric: &[f32; 2]) {
        let divisions: [Division; 8] = two_subsets(channels, metric, false);
        for division in divisions.iter().take(self.limits.patterns) {
            if division.error < self.error {
                self.subsets::<2, 2>(16, division.index, channels, metric);
            }
        }
    }

    fn rgb(&mut self, channels: &[Channel; 3], grey: bool) {
        let metric = [1.0; 3];
        let set = Set { channels, mask: &ALL, metric: &metric };
        let ends = principal_ends(&set);
        self.one_set::<3, 4>(0, &set, &ends);
        let (lonely, off) = off_line(&set, &ends);
        // Error of weights in `steps` steps, if spread evenly over the line.
        let length: f32 = (0..3).map(|c| (ends[1][c] - ends[0][c]).powi(2)).sum();
        let spread = |steps: f32| off + 16.0 / 12.0 * length / (steps * steps);
        let all = self.limits.all;
        let may_win = |expected: f32, error: f32| all || expected < error;
        if may_win(spread(31.0) + 16.0, self.error) {
            self.one_set::<3, 5>(18, &set, &ends);
        }
        if self.done(3.0) {
            return;
        }
        if may_win(0.6 * spread(7.0), self.error) {
            self.one_set::<3, 3>(5, &set, &ends);
        }
        if self.limits.all {
            self.one_set::<3, 2>(1, &set, &ends);
        }
        if grey || self.done(3.0) || off < self.limits.aligned * self.error {
            return;
        }
        let divisions: [Division; 8] = two_subsets(channels, &metric, true);
        let mut dense = self.limits.patterns;
        for division in divisions.iter().take(self.limits.patterns) {
            if division.error >= self.error {
                break;
            }
            if division.seventh {
                self.subsets::<3, 2>(7, division.index, channels, &metric);
            } else {
                self.subsets::<3, 2>(4, division.index, channels, &metric);
                if dense > 0 {
                    self.subsets::<3, 3>(2, division.index, channels, &metric);
                    dense = dense.saturating_sub(2);
                }
            }
        }
        for channel in 0..3 {
            if channel == lonely || self.limits.all {
                let others = [(1, 2), (0, 2), (0, 1)][channel];
                let others = [channels[others.0], channels[others.1]];
                let own = &channels[channel];
                self.two_planes::<2, 2>(6, channel as u8, &others, &[1.0; 2], own, 1.0);
            }
        }
        if self.limits.all {
            let (index, error) = three_subsets(channels);
            if error < self.error {
                self.subsets::<3, 2>(3, index, channels, &metric);
            }
        }
    }

    fn rgba(&mut self, channels: &[Channel; 4]) {
        let metric = [1.0; 4];
        let set = Set { channels, mask: &ALL, metric: &metric };
        let ends = principal_ends(&set);
        self.one_set::<4, 4>(10, &set, &ends);
        self.one_set::<4, 3>(12, &set, &ends);
        self.one_set::<4, 2>(14, &set, &ends);
        if self.done(4.0) {
            return;
        }
        let (lonely, off) = off_line(&set, &ends);
        if off < self.limits.aligned * self.error {
            return;
        }
        for channel in 0..4 {
            if channel == 3 || channel == lonely || self.limits.all {
                let others: [Channel; 3] =
                    core::array::from_fn(|k| channels[if k < channel { k } else { k + 1 }]);
                let own = &channels[channel];
                self.two_planes::<3, 2>(11, channel as u8, &others, &[1.0; 3], own, 1.0);
                self.two_planes::<3, 1>(13, channel as u8, &others, &[1.0; 3], own, 1.0);
            }
        }
        let divisions: [Division; 8] = two_subsets(channels, &metric, false);
        for division in divisions.iter().take(self.limits.patterns) {
            if division.error < self.error {
                self.subsets::<4, 2>(9, division.index, channels, &metric);
            }
        }
    }
}

/// The channel that lies farthest off the line through all texels, and the
/// squared distance of all channels from that line.
fn off_line<const C: usize>(set: &Set<'_, C>, ends: &Ends<C>) -> (usize, f32) {
    let mut axis = [0.0; C];
    let mut norm = 1e-9;
    for c in 0..C {
        axis[c] = ends[1][c] - ends[0][c];
        norm += axis[c] * axis[c];
    }
    let mut along = [0.0; 16];
    for c in 0..C {
        let factor = axis[c] / norm;
        for i in 0..16 {
            along[i] += (set.channels[c][i] - ends[0][c]) * factor;
        }
    }
    let (mut lonely, mut most, mut total) = (0, -1.0, 0.0);
    for c in 0..C {
        let off = sum(|i| {
            let distance = set.channels[c][i] - ends[0][c] - along[i] * axis[c];
            distance * distance
        });
        total += off;
        if off > most {
            (lonely, most) = (c, off);
        }
    }
    (lonely, total)
}
