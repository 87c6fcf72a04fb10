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

/// Sum of squares and number of the samples that move; `None` where none does.
#[derive(Clone, Copy, Debug, Default)]
struct Part {
    squares: f64,
    count: u64,
    bad: Option<usize>,
}

/// Mean square of the gradients of touched rows and unfrozen channels; `None` when no row is touched.
pub(crate) fn mean_square<T: Real>(
    group: &str,
    grads: &[T],
    rows: &Rows<'_, T>,
) -> Result<Option<f64>, OptimError> {
    let (chunk, width) = (rows.chunk(), rows.rates.len());
    let live: Vec<f64> = rows.rates.iter().map(|r| if *r > T::zero() { 1.0 } else { 0.0 }).collect();
    let live_per_row = live.iter().filter(|l| **l > 0.0).count() as u64;
    let part = |(c, grads): (usize, &[T])| {
        let mut part = Part::default();
        let mut all_finite = true;
        let mut add = |row: &[T]| {
            let mut squares = 0.0;
            for (g, live) in row.iter().zip(&live) {
                all_finite &= g.is_finite();
                squares += g.f64() * g.f64() * live;
            }
            part.squares += squares;
        };
        match rows.touched_in(c) {
            None if width == 1 => {
                let (squares, finite) = scan(grads);
                part.squares = squares * live[0];
                all_finite = finite;
                part.count = grads.len() as u64 * live_per_row;
            }
            None => {
                grads.chunks_exact(width).for_each(add);
                part.count = (grads.len() / width) as u64 * live_per_row;
            }
            Some(touched) => {
                let taken = grads.chunks_exact(width).zip(touched).filter(|(_, t)| **t);
                taken.for_each(|(row, _)| add(row));
                part.count = touched.iter().filter(|t| **t).count() as u64 * live_per_row;
            }
        }
        if !all_finite {
            let is_touched = |i: usize| rows.touched_in(c).is_none_or(|t| t[i / width]);
            part.bad =
                (0..grads.len()).find(|&i| !grads[i].is_finite() && is_touched(i)).map(|i| c * chunk + i);
        }
        part
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
    let squares: f64 = parts.iter().map(|p| p.squares).sum();
    Ok(any.then(|| if count > 0 { squares / count as f64 } else { 0.0 }))
}

/// Sum of squares in eight fixed lanes, and whether all values are finite.
fn scan<T: Real>(values: &[T]) -> (f64, bool) {
    let mut lanes = [0.0_f64; 8];
    let mut finite = [true; 8];
    let (eights, rest) = values.as_chunks::<8>();
    for eight in eights {
        for k in 0..8 {
            lanes[k] += eight[k].f64() * eight[k].f64();
            finite[k] &= eight[k].is_finite();
        }
    }
    let tail: f64 = rest.iter().map(|g| g.f64() * g.f64()).sum();
    (lanes.iter().sum::<f64>() + tail, finite.iter().all(|f| *f) && rest.iter().all(|g| g.is_finite()))
}
