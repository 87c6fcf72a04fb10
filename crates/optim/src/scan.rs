//! The pass over the gradients before a step: finiteness and mean square, in fixed chunks and a fixed order.

use crate::error::OptimError;
use photofit_scalar::Real;
use rayon::prelude::*;

/// Samples in a chunk handed to one thread, about; chunks hold whole rows.
const CHUNK: usize = 1 << 14;

/// Which samples a step moves: rows of consecutive samples, with a rate per channel.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a, T> {
    /// Learning rate of each sample of a row, in order; its length is the row's length, 0 freezes a channel.
    pub rates: &'a [T],
    /// Which rows take part in this step (`None`: all); one entry per row.
    pub touched: Option<&'a [bool]>,
}

impl<T: Real> Rows<'_, T> {
    /// Samples per chunk: whole rows, independent of the number of threads.
    pub(crate) fn chunk(&self) -> usize {
        (CHUNK / self.rates.len()).max(1) * self.rates.len()
    }

    /// The flags of the rows in chunk `c`.
    pub(crate) fn touched_in(&self, c: usize) -> Option<&[bool]> {
        let rows = self.chunk() / self.rates.len();
        self.touched.map(|t| &t[c * rows..((c + 1) * rows).min(t.len())])
    }

    pub(crate) fn check(
        &self,
        group: &str,
        params: &[T],
        grads: &[T],
        expected: usize,
    ) -> Result<(), OptimError> {
        OptimError::length(group, "parameters", params.len(), expected)?;
        OptimError::length(group, "gradients", grads.len(), expected)?;
        let width = self.rates.len();
        let whole = width > 0 && expected.is_multiple_of(width);
        OptimError::setting(group, "row length", width as f64, "a divisor of the parameter count", whole)?;
        if let Some(touched) = self.touched {
            OptimError::length(group, "row flags", touched.len(), expected / width)?;
        }
        let bad = self.rates.iter().find(|r| !(**r >= T::zero() && r.is_finite()));
        bad.map_or(Ok(()), |r| {
            OptimError::setting(group, "learning rate", r.f64(), "finite and not negative", false)
        })
    }
}

/// Lanes of the sums of squares: sample `i` of a chunk goes to lane `i % LANES`.
const LANES: usize = 16;

/// Sum of squares and number of the samples that move in one chunk, and the first that is not finite.
#[derive(Clone, Copy, Debug, Default)]
struct Part {
    squares: f64,
    count: u64,
    bad: Option<usize>,
}

/// Mean square of the gradients of touched rows and unfrozen channels; `None` when no row is touched.
///
/// Finiteness is read off the sums: the square of a finite f32 neither overflows in f64 nor turns finite again.
pub(crate) fn mean_square<T: Real>(
    group: &str,
    grads: &[T],
    rows: &Rows<'_, T>,
) -> Result<Option<f64>, OptimError> {
    let (chunk, width) = (rows.chunk(), rows.rates.len());
    let live: Vec<bool> = rows.rates.iter().map(|r| *r > T::zero()).collect();
    let live_per_row = live.iter().filter(|l| **l).count() as u64;
    let part = |(c, grads): (usize, &[T])| {
        let touched = rows.touched_in(c);
        let (squares, finite) = match touched {
            None if LANES.is_multiple_of(width) => {
                let lanes = lane_squares(grads);
                let moving = lanes.iter().enumerate().filter(|(k, _)| live[k % width]).map(|(_, s)| s);
                (moving.sum::<f64>(), lanes.iter().sum::<f64>().is_finite())
            }
            _ => row_squares(grads, &live, touched),
        };
        let taken = touched.map_or(grads.len() / width, |t| t.iter().filter(|t| **t).count());
        let is_touched = |i: usize| touched.is_none_or(|t| t[i / width]);
        let is_bad = |&i: &usize| !grads[i].is_finite() && is_touched(i);
        let bad = if finite { None } else { (0..grads.len()).find(is_bad).map(|i| c * chunk + i) };
        Part { squares, count: taken as u64 * live_per_row, bad }
    };
    let parts: Vec<Part> = grads.par_chunks(chunk).enumerate().map(part).collect();
    if let Some(index) = parts.iter().find_map(|p| p.bad) {
        return Err(OptimError::NonFiniteGradient {
            group: group.to_owned(),
            index,
            value: grads[index].f64(),
        });
    }
    let count: u64 = parts.iter().map(|p| p.count).sum();
    let any = rows.touched.is_none_or(|t| t.contains(&true)) && !grads.is_empty();
    // Squares of f64 gradients above 1e154 overflow: the mean is then as large as can be.
    let squares = parts.iter().map(|p| p.squares).sum::<f64>().min(f64::MAX);
    Ok(any.then(|| if count > 0 { squares / count as f64 } else { 0.0 }))
}

/// Sums of squares by `i % LANES`.
fn lane_squares<T: Real>(values: &[T]) -> [f64; LANES] {
    let mut lanes = [0.0_f64; LANES];
    let (groups, rest) = values.as_chunks::<LANES>();
    for group in groups {
        for k in 0..LANES {
            lanes[k] += group[k].f64() * group[k].f64();
        }
    }
    for (lane, g) in lanes.iter_mut().zip(rest) {
        *lane += g.f64() * g.f64();
    }
    lanes
}

/// Sum of squares over touched rows and live channels, and whether all gradients of touched rows may be finite.
fn row_squares<T: Real>(grads: &[T], live: &[bool], touched: Option<&[bool]>) -> (f64, bool) {
    let (mut moving, mut frozen) = (0.0, 0.0);
    for (r, row) in grads.chunks_exact(live.len()).enumerate() {
        if touched.is_some_and(|t| !t[r]) {
            continue;
        }
        for (g, live) in row.iter().zip(live) {
            let square = g.f64() * g.f64();
            *(if *live { &mut moving } else { &mut frozen }) += square;
        }
    }
    (moving, moving.is_finite() && frozen.is_finite())
}
