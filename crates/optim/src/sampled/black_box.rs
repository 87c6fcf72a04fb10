//! What is differentiated: a function of which only values are known.

use std::marker::PhantomData;

use photofit_scalar::Real;
use rayon::prelude::*;

/// Points at which a black box is to be evaluated.
///
/// Points are independent of each other, so that a black box may evaluate them at once, on threads or on a GPU.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    dimension: usize,
    points: &'a [f64],
    seeds: &'a [u64],
}

impl<'a> Batch<'a> {
    /// From `seeds.len()` points, one after the other.
    ///
    /// # Panics
    /// When `points` does not hold `dimension` numbers for each seed.
    pub fn new(dimension: usize, points: &'a [f64], seeds: &'a [u64]) -> Self {
        assert_eq!(points.len(), dimension * seeds.len(), "`dimension` numbers for each seed");
        Self { dimension, points, seeds }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.seeds.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.seeds.is_empty()
    }

    /// Parameters of one point.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The parameters of point `i`.
    pub fn point(&self, i: usize) -> &'a [f64] {
        &self.points[i * self.dimension..(i + 1) * self.dimension]
    }

    /// The same points, `count` at a time.
    pub(crate) fn parts(&self, count: usize) -> impl Iterator<Item = Self> {
        let dimension = self.dimension;
        let parts = self.points.chunks(count * dimension).zip(self.seeds.chunks(count));
        parts.map(move |(points, seeds)| Self { dimension, points, seeds })
    }

    /// The seed of point `i`. Points with one seed must see the same noise (of a renderer, say): their differences
    /// are what counts.
    pub fn seed(&self, i: usize) -> u64 {
        self.seeds[i]
    }
}

/// A function f(theta) that gives values only, no derivatives.
///
/// [`serial`] and [`parallel`] make one from a closure.
pub trait BlackBox {
    /// Why an evaluation failed.
    type Error;

    /// Writes the value at each point of `batch` to `values`, which is as long.
    ///
    /// # Errors
    /// Whatever makes an evaluation fail; it ends the estimate.
    fn evaluate(&mut self, batch: &Batch<'_>, values: &mut [f64]) -> Result<(), Self::Error>;
}

/// A closure evaluated point after point; see [`serial`].
#[derive(Clone, Debug)]
pub struct Serial<T, F>(F, PhantomData<fn(&[T])>);

/// A closure evaluated on all threads; see [`parallel`].
#[derive(Clone, Debug)]
pub struct Parallel<T, F>(F, PhantomData<fn(&[T])>);

/// A black box from a closure of parameters (`f32` or `f64`) and seed, called point after point.
///
/// Estimators work in double precision whatever the closure takes: second differences of f32 values cancel early.
pub fn serial<T: Real, E, F: FnMut(&[T], u64) -> Result<T, E>>(f: F) -> Serial<T, F> {
    Serial(f, PhantomData)
}

/// A black box from a closure of parameters (`f32` or `f64`) and seed, called on all threads; results do not depend on
/// their number.
pub fn parallel<T: Real, E: Send, F: Fn(&[T], u64) -> Result<T, E> + Sync>(f: F) -> Parallel<T, F> {
    Parallel(f, PhantomData)
}

fn cast<T: Real>(point: &[f64], into: &mut Vec<T>) {
    into.clear();
    into.extend(point.iter().map(|x| T::of(*x)));
}

impl<T: Real, E, F: FnMut(&[T], u64) -> Result<T, E>> BlackBox for Serial<T, F> {
    type Error = E;

    fn evaluate(&mut self, batch: &Batch<'_>, values: &mut [f64]) -> Result<(), E> {
        let mut theta = Vec::with_capacity(batch.dimension());
        for (i, value) in values.iter_mut().enumerate() {
            cast(batch.point(i), &mut theta);
            *value = (self.0)(&theta, batch.seed(i))?.f64();
        }
        Ok(())
    }
}

impl<T: Real, E: Send, F: Fn(&[T], u64) -> Result<T, E> + Sync> BlackBox for Parallel<T, F> {
    type Error = E;

    fn evaluate(&mut self, batch: &Batch<'_>, values: &mut [f64]) -> Result<(), E> {
        let evaluate = |theta: &mut Vec<T>, i| {
            cast(batch.point(i), theta);
            (self.0)(theta, batch.seed(i))
        };
        // Collected before looked at: the error reported is the first by index, not by time.
        let all: Vec<Result<T, E>> = (0..batch.len())
            .into_par_iter()
            .map_init(|| Vec::with_capacity(batch.dimension()), evaluate)
            .collect();
        for (value, result) in values.iter_mut().zip(all) {
            *value = result?.f64();
        }
        Ok(())
    }
}
