//! Cholesky factors of the column systems, one for each frequency along the rows.

use super::{Sample, Symbol};

/// Factors `L D L^T` of `c0 + c1 (a + Ly) + c2 (a + Ly)^2` down a column of M rows, for each of a list of `a`.
///
/// `Ly` is the Neumann second difference, so that the matrix has one subdiagonal, or two if `c2 > 0`, and is the same
/// in all rows but the first and last two. Its factors converge geometrically down the column: rows are stored until
/// they no longer change, then one row stands for all, then the last two.
#[derive(Clone, Debug)]
pub(crate) struct BandedFactors<T> {
    rows: usize,
    /// Number of stored rows before the repeated one.
    head: usize,
    frequencies: usize,
    /// True if there are two subdiagonals.
    wide: bool,
    /// For each stored row: the reciprocal pivots times `norm`, then the first and the second subdiagonal of L.
    table: Vec<T>,
}

/// One row of factors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FactorRow<'a, T> {
    /// Reciprocal pivots times the normalisation.
    pub(crate) pivot: &'a [T],
    /// First subdiagonal of L, negated.
    pub(crate) first: &'a [T],
    /// Second subdiagonal of L, negated; empty for a tridiagonal matrix.
    pub(crate) second: &'a [T],
}

/// The band of a symmetric matrix of M rows: diagonal, first and second subdiagonal (entry `i` belongs to row `i`).
fn band(symbol: Symbol, a: f64, rows: usize, i: usize) -> [f64; 3] {
    let diagonal = |i: usize| match rows {
        1 => 0.0,
        _ if i == 0 || i + 1 == rows => 1.0,
        _ => 2.0,
    };
    let own = a + diagonal(i);
    let below = if i > 0 { a + diagonal(i - 1) } else { 0.0 };
    let neighbours = usize::from(i > 0) + usize::from(i + 1 < rows);
    let d0 = symbol.c0 + symbol.c1 * own + symbol.c2 * (own * own + neighbours as f64);
    let d1 = if i > 0 { -symbol.c1 - symbol.c2 * (own + below) } else { 0.0 };
    let d2 = if i > 1 { symbol.c2 } else { 0.0 };
    [d0, d1, d2]
}

impl<T: Sample> BandedFactors<T> {
    /// Factors for columns of `rows` rows; solutions come out multiplied by `norm`.
    pub(crate) fn new(symbol: Symbol, rows: usize, eigenvalues: &[f64], norm: f64) -> Self {
        let wide = symbol.c2 > 0.0;
        let frequencies = eigenvalues.len();
        let mut table: Vec<T> = Vec::new();
        // Pivots of the last two rows and the first subdiagonal of the last, for each frequency.
        let mut state = vec![[0.0_f64; 3]; frequencies];
        let mut head = 0;
        let tail = rows.saturating_sub(2);
        let mut i = 0;
        while i < rows {
            let mut change = 0.0_f64;
            let start = table.len();
            table.resize(start + if wide { 3 } else { 2 } * frequencies, T::zero());
            for (f, (&a, s)) in eigenvalues.iter().zip(&mut state).enumerate() {
                let [d0, d1, d2] = band(symbol, a, rows, i);
                let [before, previous, l] = *s;
                let second = if i > 1 { d2 / before } else { 0.0 };
                let first = if i > 0 { (d1 - second * before * l) / previous } else { 0.0 };
                let pivot = d0
                    - if i > 0 { first * first * previous } else { 0.0 }
                    - if i > 1 { second * second * before } else { 0.0 };
                change = change.max((pivot - previous).abs() / pivot).max((first - l).abs());
                *s = [previous, pivot, first];
                table[start + f] = T::of(norm / pivot);
                table[start + frequencies + f] = T::of(-first);
                if wide {
                    table[start + 2 * frequencies + f] = T::of(-second);
                }
            }
            if i < tail {
                head = i;
            }
            // A quarter of a rounding: the row is the same as the one before, and so are all until the last two.
            let same = i > 3 && i + 1 < tail && change < 0.25 * T::epsilon().f64();
            i = if same { tail } else { i + 1 };
        }
        Self { rows, head, frequencies, wide, table }
    }

    #[inline(always)]
    pub(crate) fn wide(&self) -> bool {
        self.wide
    }

    /// Bytes of the table.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.table.as_slice())
    }

    /// The factors of row `i` for frequencies `from..to`.
    #[inline(always)]
    pub(crate) fn row(&self, i: usize, from: usize, to: usize) -> FactorRow<'_, T> {
        let stored = self.table.len() / (self.frequencies * if self.wide { 3 } else { 2 }).max(1);
        // The last two rows are the last two stored ones.
        let index = if i + 2 >= self.rows { stored + i - self.rows } else { i.min(self.head) };
        let n = self.frequencies;
        let row = &self.table[index * n * if self.wide { 3 } else { 2 }..];
        FactorRow {
            pivot: &row[from..to],
            first: &row[n + from..n + to],
            second: if self.wide { &row[2 * n + from..2 * n + to] } else { &[] },
        }
    }
}
