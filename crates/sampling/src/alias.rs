//! Discrete distributions in constant time (alias method; Walker 1974, Vose 1991).

/// Why weights are no distribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AliasError {
    /// No weights, or more than 2^32.
    #[error("an alias table needs 1 to 2^32 weights, not {0}")]
    Count(usize),
    /// A weight is negative, infinite or NaN.
    #[error("weight {0} is negative or not finite")]
    Weight(usize),
    /// All weights are zero.
    #[error("all weights are zero")]
    Zero,
}

/// One draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AliasSample {
    /// The drawn index.
    pub index: usize,
    /// Its probability.
    pub pmf: f32,
    /// A number uniform in `[0, 1)` made from the second argument, for use inside the drawn cell.
    pub remapped: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    /// Share of the cell that belongs to its own index.
    own: f32,
    /// Whom the rest belongs to.
    alias: u32,
    pmf: f32,
}

/// A distribution over `0..len` with given weights; building takes linear time, a draw constant time.
///
/// ```
/// use photofit_sampling::AliasTable;
/// let table = AliasTable::new(&[1.0, 0.0, 3.0])?;
/// assert_eq!((table.pmf(0), table.pmf(1), table.pmf(2)), (0.25, 0.0, 0.75));
/// assert_ne!(table.sample([0.4, 0.9]).index, 1);
/// # Ok::<(), photofit_sampling::AliasError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct AliasTable {
    cells: Vec<Cell>,
    sum: f64,
}

impl AliasTable {
    /// The distribution proportional to `weights`.
    ///
    /// # Errors
    /// If there are no weights or more than 2^32, one is negative or not finite, or all are zero.
    pub fn new(weights: &[f32]) -> Result<Self, AliasError> {
        let n = weights.len();
        if n == 0 || n as u64 > 1 << 32 {
            return Err(AliasError::Count(n));
        }
        if let Some(i) = weights.iter().position(|w| !w.is_finite() || *w < 0.0) {
            return Err(AliasError::Weight(i));
        }
        let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
        if sum <= 0.0 {
            return Err(AliasError::Zero);
        }
        // Shares of the average cell; a share below one is filled up by one above.
        let mut share: Vec<f64> = weights.iter().map(|w| f64::from(*w) / sum * n as f64).collect();
        let cell =
            |(i, w): (usize, &f32)| Cell { own: 1.0, alias: i as u32, pmf: (f64::from(*w) / sum) as f32 };
        let mut cells: Vec<Cell> = weights.iter().enumerate().map(cell).collect();
        let (mut small, mut large): (Vec<u32>, Vec<u32>) =
            (0..n).map(|i| i as u32).partition(|i| share[*i as usize] < 1.0);
        while let (Some(low), Some(high)) = (small.pop(), large.last().copied()) {
            let (l, h) = (low as usize, high as usize);
            cells[l].own = share[l] as f32;
            cells[l].alias = high;
            share[h] -= 1.0 - share[l];
            if share[h] < 1.0 {
                large.pop();
                small.push(high);
            }
        }
        // What rounding leaves in `small` keeps its whole cell, except that an index of weight zero owns nothing.
        let heaviest = weights.iter().enumerate().fold(0, |m, (i, w)| if *w > weights[m] { i } else { m });
        for (i, cell) in cells.iter_mut().enumerate() {
            if cell.pmf == 0.0 && weights[i] == 0.0 {
                cell.own = 0.0;
                if cell.alias as usize == i {
                    cell.alias = heaviest as u32;
                }
            }
        }
        Ok(Self { cells, sum })
    }

    /// Number of indices.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Never true: a table has at least one index.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Sum of the weights.
    pub fn sum(&self) -> f64 {
        self.sum
    }

    /// Probability of `index`.
    ///
    /// # Panics
    /// If `index >= len`.
    #[inline]
    pub fn pmf(&self, index: usize) -> f32 {
        self.cells[index].pmf
    }

    /// Draws an index from `u` in `[0, 1)^2`: the first number picks a cell, the second one its owner or its alias. An
    /// index of weight zero is never drawn.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> AliasSample {
        let n = self.cells.len();
        let at = ((f64::from(u[0]) * n as f64) as usize).min(n - 1);
        let cell = self.cells[at];
        const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
        let (index, remapped) = if u[1] < cell.own {
            (at, u[1] / cell.own)
        } else {
            (cell.alias as usize, (u[1] - cell.own) / (1.0 - cell.own))
        };
        AliasSample { index, pmf: self.cells[index].pmf, remapped: remapped.min(BELOW_ONE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;
    use crate::statistics::{chi_square, chi_square_uniform};

    /// Probabilities that the cells of the table add up to.
    fn implied(table: &AliasTable) -> Vec<f64> {
        let n = table.len();
        let mut out = vec![0.0; n];
        for (i, cell) in table.cells.iter().enumerate() {
            out[i] += f64::from(cell.own) / n as f64;
            out[cell.alias as usize] += (1.0 - f64::from(cell.own)) / n as f64;
        }
        out
    }

    fn weights() -> Vec<Vec<f32>> {
        let mut rng = Rng::new(6, 0);
        vec![
            vec![2.0],
            vec![1.0, 1.0],
            vec![0.0, 5.0, 0.0],
            vec![1e-30, 1.0, 1e-3, 1e30],
            vec![0.1; 10],
            (0..1000).map(|i| if i % 3 == 0 { 0.0 } else { rng.next_f32().powi(8) }).collect(),
        ]
    }

    #[test]
    fn the_table_holds_its_weights() {
        for weights in weights() {
            let table = AliasTable::new(&weights).unwrap();
            let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
            assert_eq!(table.sum(), sum);
            for (i, (w, p)) in weights.iter().zip(implied(&table)).enumerate() {
                let expected = f64::from(*w) / sum;
                assert!((p - expected).abs() < 1e-7, "{i}: {p} against {expected}");
                assert!((f64::from(table.pmf(i)) - expected).abs() <= 1e-7 * expected + 1e-38, "{i}");
            }
        }
    }

    #[test]
    fn draws_follow_the_weights_and_avoid_zeros() {
        for (stream, weights) in weights().into_iter().enumerate() {
            let table = AliasTable::new(&weights).unwrap();
            let mut rng = Rng::new(31, stream as u64);
            let mut counts = vec![0; weights.len()];
            let mut remapped = vec![0; 16];
            for _ in 0..100_000 {
                let draw = table.sample([rng.next_f32(), rng.next_f32()]);
                assert!(weights[draw.index] > 0.0, "weight zero is drawn");
                assert_eq!(draw.pmf, table.pmf(draw.index));
                counts[draw.index] += 1;
                remapped[(draw.remapped * 16.0) as usize] += 1;
            }
            let probabilities: Vec<f64> = weights.iter().map(|w| f64::from(*w) / table.sum()).collect();
            if probabilities.iter().filter(|p| **p > 1e-3).count() > 1 {
                chi_square(&format!("weights {stream}"), &counts, &probabilities);
            }
            chi_square_uniform(&format!("remapped {stream}"), &remapped);
        }
    }

    #[test]
    fn extreme_numbers_stay_in_range() {
        let table = AliasTable::new(&[1.0, 2.0, 3.0]).unwrap();
        for u in [[0.0, 0.0], [1.0 - f32::EPSILON / 2.0; 2], [1.0, 1.0]] {
            let draw = table.sample(u);
            assert!(draw.index < 3 && (0.0..1.0).contains(&draw.remapped));
        }
    }

    #[test]
    fn wrong_weights_are_refused() {
        assert_eq!(AliasTable::new(&[]), Err(AliasError::Count(0)));
        assert_eq!(AliasTable::new(&[1.0, -1.0]), Err(AliasError::Weight(1)));
        assert_eq!(AliasTable::new(&[f32::NAN]), Err(AliasError::Weight(0)));
        assert_eq!(AliasTable::new(&[1.0, f32::INFINITY]), Err(AliasError::Weight(1)));
        assert_eq!(AliasTable::new(&[0.0, 0.0]), Err(AliasError::Zero));
    }
}
