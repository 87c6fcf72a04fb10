//! One look over the target: what is read, its mean and its contrast.

use photofit_scalar::Real;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSlice};

use super::{DataTerm, Problem, Weight};

/// Samples summed by one task.
const CHUNK: usize = 1 << 14;

/// Mean of each channel and contrast over the samples that are read, and the samples that cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Survey {
    /// Mean of each channel, 0 if no sample is read.
    pub(crate) means: Vec<f64>,
    /// Standard deviation about the channels' means; 1 if there is none.
    pub(crate) contrast: f64,
    /// Samples that are not finite.
    pub(crate) unreadable: Vec<usize>,
}

/// Sums of one chunk or channel.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    sum: f64,
    squares: f64,
    broken: bool,
}

impl Survey {
    pub(crate) fn new<T: Real>(problem: &Problem<'_, T>) -> Self {
        let n = problem.shape.pixels();
        let (mut means, mut squares, mut count, mut broken) = (Vec::new(), 0.0, 0.0, false);
        for (c, plane) in problem.target.chunks(n).enumerate() {
            // Sums about one of the values keep their digits.
            let read = |k: usize| plane[k].is_finite() && !problem.data.hole(c * n + k, problem.shape);
            let shift = (0..n).find(|&k| read(k)).map_or(T::zero(), |k| plane[k]);
            let sums = channel(problem, c, plane, shift);
            let mean = if sums.count > 0.0 { sums.sum / sums.count } else { 0.0 };
            means.push(if sums.count > 0.0 { shift.f64() + mean } else { 0.0 });
            squares += (sums.squares - mean * sums.sum).max(0.0);
            count += sums.count;
            broken |= sums.broken;
        }
        let sigma = (squares / f64::max(count, 1.0)).sqrt();
        let unreadable = if broken {
            (0..problem.shape.len()).filter(|&k| !problem.target[k].is_finite()).collect()
        } else {
            Vec::new()
        };
        Self { means, contrast: if sigma.is_finite() && sigma > 0.0 { sigma } else { 1.0 }, unreadable }
    }
}

fn channel<T: Real>(problem: &Problem<'_, T>, c: usize, plane: &[T], shift: T) -> Sums {
    let shape = problem.shape;
    let all = full(&problem.data);
    let chunks: Vec<Sums> = plane
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, values)| {
            let fast = if all { full_chunk(values, shift) } else { Sums { broken: true, ..Sums::default() } };
            if !fast.broken {
                return fast;
            }
            let mut sums = Sums::default();
            for (k, v) in values.iter().enumerate() {
                sums.broken |= !v.is_finite();
                if v.is_finite() && !problem.data.hole(c * shape.pixels() + chunk * CHUNK + k, shape) {
                    let d = (*v - shift).f64();
                    sums.count += 1.0;
                    sums.sum += d;
                    sums.squares += d * d;
                }
            }
            sums
        })
        .collect();
    chunks.into_iter().fold(Sums::default(), |a, b| Sums {
        count: a.count + b.count,
        sum: a.sum + b.sum,
        squares: a.squares + b.squares,
        broken: a.broken || b.broken,
    })
}

/// A chunk without holes, in lanes.
fn full_chunk<T: Real>(values: &[T], shift: T) -> Sums {
    const LANES: usize = 8;
    let (mut sum, mut squares) = ([0.0_f64; LANES], [0.0_f64; LANES]);
    let chunks = values.chunks_exact(LANES);
    for (lane, v) in chunks.remainder().iter().enumerate() {
        let d = (*v - shift).f64();
        sum[lane] += d;
        squares[lane] += d * d;
    }
    for chunk in chunks {
        for (lane, v) in chunk.iter().enumerate() {
            let d = (*v - shift).f64();
            sum[lane] += d;
            squares[lane] += d * d;
        }
    }
    let (sum, squares): (f64, f64) = (sum.iter().sum(), squares.iter().sum());
    Sums { count: values.len() as f64, sum, squares, broken: !(sum.is_finite() && squares.is_finite()) }
}

/// True when the weights alone say that there are no holes.
pub(crate) fn full<T: Real>(data: &DataTerm<T>) -> bool {
    let positive = |w: Option<&Weight<T>>| matches!(w, Some(Weight::Uniform(v)) if *v > T::zero());
    match data {
        DataTerm::Hybrid { .. } => data.weights().into_iter().any(positive),
        DataTerm::L2 { .. } | DataTerm::L1 { .. } | DataTerm::Huber { .. } => positive(data.weights()[0]),
    }
}
