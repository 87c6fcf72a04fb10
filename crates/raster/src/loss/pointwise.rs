//! Losses that are a sum of terms of one sample each.

use super::PictureLayout;
use super::curve::{LossScalar, clamp_magnitude, tone};
use photofit_scalar::Real;
use rayon::prelude::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator, ParallelSliceMut};

/// Samples of a block: what the vectorised kernels work on at a time.
const BLOCK: usize = 256;
/// Partial sums of a block.
const LANES: usize = 16;
/// Samples of a chunk, about: the unit of parallel work.
const CHUNK: usize = 1 << 14;

/// A term and its derivative with respect to `x`.
pub(super) trait Term {
    fn term<T: LossScalar, const FMA: bool>(x: T, y: T) -> (T, T);
}

/// `d / |d|`, zero at zero.
#[inline(always)]
fn sign<T: Real>(d: T) -> T {
    let (zero, one) = (T::zero(), T::one());
    (if d > zero { one } else { zero }) - (if d < zero { one } else { zero })
}

/// `x` and `y` clamped, and one or zero: the derivative of the clamp of `x`.
#[inline(always)]
fn clamped<T: Real>(x: T, y: T) -> (T, T, T) {
    let ((a, free), (b, _)) = (clamp_magnitude(x.abs()), clamp_magnitude(y.abs()));
    let signed = |v: T, magnitude: T| if v < T::zero() { -magnitude } else { magnitude };
    (signed(x, a), signed(y, b), if free { T::one() } else { T::zero() })
}

pub(super) struct LogSrgbL1;
impl Term for LogSrgbL1 {
    #[inline(always)]
    fn term<T: LossScalar, const FMA: bool>(x: T, y: T) -> (T, T) {
        let ((a, slope), (b, _)) = (tone::<T, FMA>(x), tone::<T, FMA>(y));
        let d = a - b;
        (d.abs(), sign(d) * slope)
    }
}

pub(super) struct LogSrgbL2;
impl Term for LogSrgbL2 {
    #[inline(always)]
    fn term<T: LossScalar, const FMA: bool>(x: T, y: T) -> (T, T) {
        let ((a, slope), (b, _)) = (tone::<T, FMA>(x), tone::<T, FMA>(y));
        let d = a - b;
        (d * d, (d + d) * slope)
    }
}

pub(super) struct Mse;
impl Term for Mse {
    #[inline(always)]
    fn term<T: LossScalar, const FMA: bool>(x: T, y: T) -> (T, T) {
        let (x, y, free) = clamped(x, y);
        let d = x - y;
        (d * d, (d + d) * free)
    }
}

pub(super) struct Smape;
impl Term for Smape {
    #[inline(always)]
    fn term<T: LossScalar, const FMA: bool>(x: T, y: T) -> (T, T) {
        let (x, y, free) = clamped(x, y);
        let d = x - y;
        let inv = T::one() / (x.abs() + y.abs() + T::of(0.01));
        let value = d.abs() * inv;
        (value, (sign(d) - value * sign(x)) * inv * free)
    }
}

pub(super) struct RelativeL2;
impl Term for RelativeL2 {
    #[inline(always)]
    fn term<T: LossScalar, const FMA: bool>(x: T, y: T) -> (T, T) {
        let (x, y, free) = clamped(x, y);
        let d = x - y;
        let inv = T::one() / (x * x + y * y + T::of(0.1));
        let value = d * d * inv;
        let half = (d - value * x) * inv * free;
        (value, half + half)
    }
}

/// Weighted sum of the terms of a block; adds `scale` times weight times derivative to `gradient`. All lengths are
/// equal; without weights they are one.
#[inline(always)]
fn block<T: LossScalar, K: Term, const FMA: bool>(
    x: &[T],
    y: &[T],
    w: Option<&[T]>,
    scale: T,
    gradient: &mut [T],
) -> f64 {
    match w {
        None => sum_terms::<T, K, FMA>(x, y, |_| T::one(), scale, gradient),
        Some(w) => sum_terms::<T, K, FMA>(x, y, |i| w[i], scale, gradient),
    }
}

#[inline(always)]
fn sum_terms<T: LossScalar, K: Term, const FMA: bool>(
    x: &[T],
    y: &[T],
    w: impl Fn(usize) -> T,
    scale: T,
    gradient: &mut [T],
) -> f64 {
    let n = gradient.len();
    let (x, y) = (&x[..n], &y[..n]);
    let mut lanes = [T::zero(); LANES];
    let whole = n - n % LANES;
    for i in (0..whole).step_by(LANES) {
        let (x, y, g) = (&x[i..i + LANES], &y[i..i + LANES], &mut gradient[i..i + LANES]);
        for l in 0..LANES {
            let (value, slope) = K::term::<T, FMA>(x[l], y[l]);
            lanes[l] += value * w(i + l);
            g[l] += slope * (scale * w(i + l));
        }
    }
    for i in whole..n {
        let (value, slope) = K::term::<T, FMA>(x[i], y[i]);
        lanes[i - whole] += value * w(i);
        gradient[i] += slope * (scale * w(i));
    }
    lanes.iter().map(|v| v.f64()).sum()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn block_avx2<T: LossScalar, K: Term>(
    x: &[T],
    y: &[T],
    w: Option<&[T]>,
    scale: T,
    gradient: &mut [T],
) -> f64 {
    block::<T, K, true>(x, y, w, scale, gradient)
}

/// One block on the widest instructions of this machine.
#[inline]
fn any_block<T: LossScalar, K: Term>(x: &[T], y: &[T], w: Option<&[T]>, scale: T, gradient: &mut [T]) -> f64 {
    #[cfg(target_arch = "x86_64")]
    if crate::cpu::has_avx2() {
        #[expect(unsafe_code, reason = "calling a function compiled for AVX2 and FMA")]
        // SAFETY: both features were just detected.
        return unsafe { block_avx2::<T, K>(x, y, w, scale, gradient) };
    }
    block::<T, K, false>(x, y, w, scale, gradient)
}

/// Sum over whole rows of which every sample counts alike.
fn plain_chunk<T: LossScalar, K: Term>(x: &[T], y: &[T], scale: T, mut gradient: Option<&mut [T]>) -> f64 {
    let mut sum = 0.0;
    for from in (0..x.len()).step_by(BLOCK) {
        let range = from..(from + BLOCK).min(x.len());
        let mut unused = [T::zero(); BLOCK];
        let g = match &mut gradient {
            Some(g) => &mut g[range.clone()],
            None => &mut unused[..range.len()],
        };
        sum += any_block::<T, K>(&x[range.clone()], &y[range], None, scale, g);
    }
    sum
}

/// Sum over whole rows from pixel `first` on: the samples that count are gathered with their weights.
fn gathered_chunk<T: LossScalar, K: Term>(
    x: &[T],
    y: &[T],
    layout: &PictureLayout<'_, T>,
    first: usize,
    scale: T,
    mut gradient: Option<&mut [T]>,
) -> f64 {
    let zeros = [T::zero(); BLOCK];
    let mut buffer = Gather { x: zeros, y: zeros, w: zeros, at: [0; BLOCK], len: 0 };
    let mut sum = 0.0;
    for pixel in 0..x.len() / layout.channels {
        let weight = layout.weights.map_or(T::one(), |w| w[first + pixel]);
        if weight == T::zero() {
            continue;
        }
        for at in pixel * layout.channels + layout.read.start..pixel * layout.channels + layout.read.end {
            if buffer.len == BLOCK {
                sum += buffer.flush::<K>(scale, gradient.as_deref_mut());
            }
            buffer.push(x[at], y[at], weight, at);
        }
    }
    sum + buffer.flush::<K>(scale, gradient)
}

/// Samples that wait until they fill a block.
struct Gather<T> {
    x: [T; BLOCK],
    y: [T; BLOCK],
    w: [T; BLOCK],
    at: [usize; BLOCK],
    len: usize,
}

impl<T: LossScalar> Gather<T> {
    #[inline(always)]
    fn push(&mut self, x: T, y: T, w: T, at: usize) {
        let i = self.len;
        (self.x[i], self.y[i], self.w[i], self.at[i]) = (x, y, w, at);
        self.len += 1;
    }

    /// Weighted sum of the terms; scatters the gradient and empties the buffer.
    fn flush<K: Term>(&mut self, scale: T, gradient: Option<&mut [T]>) -> f64 {
        let n = std::mem::take(&mut self.len);
        let mut g = [T::zero(); BLOCK];
        let sum = any_block::<T, K>(&self.x[..n], &self.y[..n], Some(&self.w[..n]), scale, &mut g[..n]);
        if let Some(gradient) = gradient {
            self.at[..n].iter().zip(&g).for_each(|(at, g)| gradient[*at] += *g);
        }
        sum
    }
}

/// `factor` times the mean of the terms; adds `factor` times the gradient.
pub(super) fn run<T: LossScalar, K: Term>(
    x: &[T],
    y: &[T],
    layout: &PictureLayout<'_, T>,
    factor: f64,
    gradient: Option<&mut [T]>,
) -> f64 {
    let rows = CHUNK.div_ceil(layout.pitch());
    let size = rows * layout.pitch();
    let plain = layout.weights.is_none() && layout.read.len() == layout.channels;
    let scale = factor / layout.terms() as f64;
    let part = |k: usize, g: Option<&mut [T]>| {
        let (from, to) = (k * size, ((k + 1) * size).min(x.len()));
        let (x, y) = (&x[from..to], &y[from..to]);
        if plain {
            plain_chunk::<T, K>(x, y, T::of(scale), g)
        } else {
            gathered_chunk::<T, K>(x, y, layout, k * rows * layout.width, T::of(scale), g)
        }
    };
    let sums: Vec<f64> = match gradient {
        Some(g) => g.par_chunks_mut(size).enumerate().map(|(k, g)| part(k, Some(g))).collect(),
        None => (0..x.len().div_ceil(size)).into_par_iter().map(|k| part(k, None)).collect(),
    };
    sums.iter().sum::<f64>() * scale
}
