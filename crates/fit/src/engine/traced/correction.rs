//! What the optimizer moves of a parameter: its values, their logarithms, or a coarse grid of corrections.

/// What moves.
#[derive(Debug)]
pub(super) enum Motion {
    /// The values.
    Values,
    /// Their logarithms.
    Logarithms(Vec<f32>),
    /// Corrections of a texture, bilinear between the centres of cells.
    Correction(Correction),
}

/// A grid over a texture whose values, linear between the centres of cells, are the logarithms of factors of its texels or are added
/// to them.
#[derive(Debug)]
pub(super) struct Correction {
    /// Columns and rows of texels, and their channels.
    texels: [usize; 2],
    channels: usize,
    /// Texels along the side of a cell.
    side: usize,
    is_factor: bool,
    /// Texels without correction.
    start: Vec<f32>,
    pub(super) grid: Vec<f32>,
}

/// The two cells that a place along an axis is between, with their weights.
type Between = [(usize, f32); 2];

impl Correction {
    /// None so far.
    pub(super) fn none(texels: [usize; 2], side: usize, is_factor: bool, start: Vec<f32>) -> Self {
        let cells: usize = texels.iter().map(|n| n.div_ceil(side)).product();
        let channels = start.len() / (texels[0] * texels[1]).max(1);
        Self { texels, channels, side, is_factor, start, grid: vec![0.0; cells * channels] }
    }

    /// Begins anew from other texels.
    pub(super) fn restart(&mut self, texels: &[f32]) {
        self.start.copy_from_slice(texels);
        self.grid.fill(0.0);
    }

    /// Texels along the side of a cell.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Columns and rows of cells.
    pub(super) fn cells(&self) -> [usize; 2] {
        self.texels.map(|n| n.div_ceil(self.side))
    }

    /// Lowest and highest correction of values in a range: from one end to the other.
    pub(super) fn range(&self, [low, high]: [f32; 2]) -> [f32; 2] {
        let most = if self.is_factor { (high / low.max(1e-6)).ln() } else { high - low };
        [-most, most]
    }

    /// The cells between whose centres the middle of a texel lies.
    fn between(&self, texel: usize, cells: usize) -> Between {
        let at = (texel as f32 + 0.5) / self.side as f32 - 0.5;
        let first = at.floor();
        let last = cells - 1;
        let [a, b] = [first, first + 1.0].map(|c| (c.max(0.0) as usize).min(last));
        let share = at - first;
        [(a, 1.0 - share), (b, share)]
    }

    /// Each texel with the four cells (index of the first channel, weight) that it takes its correction from.
    fn each(&self, mut visit: impl FnMut(usize, [(usize, f32); 4])) {
        let [columns, rows] = self.cells();
        let across: Vec<Between> = (0..self.texels[0]).map(|x| self.between(x, columns)).collect();
        for y in 0..self.texels[1] {
            let [up, down] = self.between(y, rows);
            for (x, [left, right]) in across.iter().enumerate() {
                let one = |(row, a): (usize, f32), (column, b): (usize, f32)| {
                    ((row * columns + column) * self.channels, a * b)
                };
                let four = [one(up, *left), one(up, *right), one(down, *left), one(down, *right)];
                visit((y * self.texels[0] + x) * self.channels, four);
            }
        }
    }

    /// The corrected texels, in the ranges of their channels.
    pub(super) fn apply(&self, ranges: &[[f32; 2]], texels: &mut [f32]) {
        self.each(|at, four| {
            for (c, [low, high]) in ranges.iter().copied().enumerate() {
                let by: f32 = four.iter().map(|(cell, w)| w * self.grid[cell + c]).sum();
                // What is black begins at the lower end of its range: a factor of 0 is 0.
                let start = self.start[at + c].max(low);
                let corrected = if self.is_factor { start * by.exp() } else { start + by };
                texels[at + c] = corrected.clamp(low, high);
            }
        });
    }

    /// Adjoint of [`Self::apply`]: adds to the derivatives of the grid those that come from `of(texel value)`, where texels are
    /// within the range of their channel.
    pub(super) fn apply_vjp(
        &self,
        ranges: &[[f32; 2]],
        texels: &[f32],
        of: impl Fn(usize) -> f64,
        grid: &mut [f32],
    ) {
        self.each(|at, four| {
            for (c, [low, high]) in ranges.iter().copied().enumerate() {
                let value = texels[at + c];
                let by = of(at + c);
                if by == 0.0 || value <= low && by > 0.0 || value >= high && by < 0.0 {
                    continue;
                }
                let by = if self.is_factor { (by * f64::from(value)) as f32 } else { by as f32 };
                four.iter().for_each(|(cell, w)| grid[cell + c] += w * by);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid over 13 x 9 texels of two channels, with corrections that no clamping meets.
    fn correction(is_factor: bool) -> Correction {
        let start = (0..13 * 9 * 2).map(|i| 0.3 + 0.2 * (i as f32 * 0.7).sin()).collect();
        let mut made = Correction::none([13, 9], 4, is_factor, start);
        assert_eq!(made.cells(), [4, 3]);
        made.grid.iter_mut().enumerate().for_each(|(i, v)| *v = 0.05 * (i as f32 * 1.3).cos());
        made
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        for is_factor in [false, true] {
            let mut c = correction(is_factor);
            let weight = |i: usize| (i as f64 * 0.37).sin();
            let value = |c: &Correction| {
                let mut texels = c.start.clone();
                c.apply(&[[0.0, 1.0]; 2], &mut texels);
                (texels.iter().enumerate().map(|(i, t)| f64::from(*t) * weight(i)).sum::<f64>(), texels)
            };
            let mut found = vec![0.0; c.grid.len()];
            c.apply_vjp(&[[0.0, 1.0]; 2], &value(&c).1, weight, &mut found);
            for k in 0..c.grid.len() {
                let middle = c.grid[k];
                let mut at = |d: f32| {
                    c.grid[k] = middle + d;
                    value(&c).0
                };
                let difference = (at(0.01) - at(-0.01)) / 0.02;
                c.grid[k] = middle;
                assert!(
                    (f64::from(found[k]) - difference).abs() < 1e-3,
                    "{is_factor} {k}: {} {difference}",
                    found[k]
                );
            }
        }
    }

    #[test]
    fn an_even_grid_is_an_even_correction_and_none_changes_nothing() {
        for (is_factor, by) in [(false, 0.1_f32), (true, 1.25_f32.ln())] {
            let mut c = correction(is_factor);
            let mut texels = vec![0.0; c.start.len()];
            for even in [0.0, by] {
                c.grid.fill(even);
                c.apply(&[[0.0, 1.0]; 2], &mut texels);
                for (t, s) in texels.iter().zip(&c.start) {
                    let wanted = if is_factor { s * even.exp() } else { s + even };
                    assert!((t - wanted).abs() < 1e-6, "{is_factor} {even}: {t} of {s}");
                }
            }
        }
    }

    #[test]
    fn what_is_black_answers_to_its_derivatives() {
        let (low, mut c) = (1e-4, correction(true));
        c.start.fill(0.0);
        c.grid.fill(0.0);
        let mut texels = vec![0.0; c.start.len()];
        c.apply(&[[low, 1.0]; 2], &mut texels);
        assert!(texels.iter().all(|t| *t == low));
        let mut found = vec![0.0; c.grid.len()];
        c.apply_vjp(&[[low, 1.0]; 2], &texels, |_| -1.0, &mut found);
        assert!(found.iter().all(|g| *g < 0.0), "brighter is better");
        c.grid.fill(1.0);
        c.apply(&[[low, 1.0]; 2], &mut texels);
        assert!(texels.iter().all(|t| (t - low * 1.0_f32.exp()).abs() < 1e-8));
    }

    #[test]
    fn texels_at_an_end_of_their_range_move_away_from_it_alone() {
        let mut c = correction(false);
        c.grid.fill(-1.0);
        let mut texels = vec![0.0; c.start.len()];
        c.apply(&[[0.0, 1.0]; 2], &mut texels);
        assert!(texels.iter().all(|t| *t == 0.0));
        let mut found = vec![0.0; c.grid.len()];
        // A loss that falls with the texels would have them rise.
        c.apply_vjp(&[[0.0, 1.0]; 2], &texels, |_| 1.0, &mut found);
        assert!(found.iter().all(|g| *g == 0.0));
        c.apply_vjp(&[[0.0, 1.0]; 2], &texels, |_| -1.0, &mut found);
        assert!(found.iter().all(|g| *g < 0.0));
    }
}
