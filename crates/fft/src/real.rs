//! The Fourier transform of real rows of one length.

use photofit_scalar::Real;
use realfft::num_complex::Complex;
use realfft::{ComplexToReal, FftNum, RealFftPlanner, RealToComplex};
use std::fmt;
use std::sync::Arc;

/// A scalar that can be transformed: `f32` or `f64`.
pub trait Sample: Real + FftNum {
    /// The transform of rows of `len` samples.
    ///
    /// # Panics
    /// If `len` is 0.
    fn real_fft(len: usize) -> RealFft<Self>;
}

/// Forward and inverse transform of rows of one length N: N samples, and the N/2 + 1 frequencies that are not redundant.
#[derive(Clone)]
pub struct RealFft<T> {
    len: usize,
    forward: Arc<dyn RealToComplex<T>>,
    inverse: Arc<dyn ComplexToReal<T>>,
}

/// Working memory of one thread for transforms of one length.
#[derive(Clone, Debug)]
pub struct Buffers<T> {
    /// N samples.
    pub real: Vec<T>,
    /// N/2 + 1 frequencies.
    pub spectrum: Vec<Complex<T>>,
    /// What [`RealFft::scratch`] makes.
    pub scratch: Vec<Complex<T>>,
}

impl Sample for f32 {
    fn real_fft(len: usize) -> RealFft<Self> {
        planned(&mut RealFftPlanner::new(), len)
    }
}

impl Sample for f64 {
    fn real_fft(len: usize) -> RealFft<Self> {
        planned(&mut RealFftPlanner::new(), len)
    }
}

fn planned<T: Sample>(planner: &mut RealFftPlanner<T>, len: usize) -> RealFft<T> {
    assert!(len > 0, "rows have samples");
    RealFft { len, forward: planner.plan_fft_forward(len), inverse: planner.plan_fft_inverse(len) }
}

impl<T> fmt::Debug for RealFft<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RealFft({})", self.len)
    }
}

impl<T: Sample> RealFft<T> {
    /// Samples of a row.
    #[expect(clippy::len_without_is_empty, reason = "no row is empty")]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Frequencies of a row, N/2 + 1.
    pub fn frequencies(&self) -> usize {
        self.len / 2 + 1
    }

    /// Buffers for a row, its spectrum, and the work between them.
    pub fn buffers(&self) -> Buffers<T> {
        Buffers {
            real: vec![T::zero(); self.len],
            spectrum: vec![Complex::new(T::zero(), T::zero()); self.frequencies()],
            scratch: self.scratch(),
        }
    }

    /// Working memory of one thread.
    pub fn scratch(&self) -> Vec<Complex<T>> {
        let zero = Complex::new(T::zero(), T::zero());
        vec![zero; self.forward.get_scratch_len().max(self.inverse.get_scratch_len())]
    }

    /// `X_k = sum_j x_j exp(-2 pi i j k / N)`; the samples of `row` are lost.
    ///
    /// # Panics
    /// If `row`, `spectrum` or `scratch` is not as long as it must be.
    pub fn forward(&self, row: &mut [T], spectrum: &mut [Complex<T>], scratch: &mut [Complex<T>]) {
        self.forward.process_with_scratch(row, spectrum, scratch).expect("buffers have the planned lengths");
    }

    /// Inverse of [`Self::forward`], times N; `spectrum` is lost. Imaginary parts of the lowest frequency and, for even N, of the highest
    /// do not count, since those of a real row have none.
    ///
    /// # Panics
    /// As [`Self::forward`].
    pub fn inverse(&self, spectrum: &mut [Complex<T>], row: &mut [T], scratch: &mut [Complex<T>]) {
        spectrum[0].im = T::zero();
        if self.len.is_multiple_of(2) {
            spectrum[self.len / 2].im = T::zero();
        }
        self.inverse.process_with_scratch(spectrum, row, scratch).expect("buffers have the planned lengths");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the sums, for a scalar whose rounding is `unit`.
    fn check<T: Sample>(unit: f64) {
        for n in [1, 2, 3, 8, 15, 31, 64] {
            let fft = T::real_fft(n);
            let row: Vec<f64> = (0..n).map(|k| ((k * k + 3) as f64).sin()).collect();
            let mut b = fft.buffers();
            b.real.iter_mut().zip(&row).for_each(|(x, y)| *x = T::of(*y));
            fft.forward(&mut b.real, &mut b.spectrum, &mut b.scratch);
            for (k, z) in b.spectrum.iter().enumerate() {
                let angle = |j: usize| -std::f64::consts::TAU * (j * k) as f64 / n as f64;
                let wanted: Complex<f64> =
                    row.iter().enumerate().map(|(j, x)| Complex::from_polar(*x, angle(j))).sum();
                let found = Complex::new(z.re.f64(), z.im.f64());
                assert!((found - wanted).norm() < 8.0 * unit * n as f64, "{n} {k}: {found} {wanted}");
            }
            // Imaginary ends are none of a real row's.
            b.spectrum[0].im = T::of(7.0);
            if n % 2 == 0 {
                b.spectrum[n / 2].im = T::of(5.0);
            }
            fft.inverse(&mut b.spectrum, &mut b.real, &mut b.scratch);
            for (x, y) in row.iter().zip(&b.real) {
                assert!((x - y.f64() / n as f64).abs() < 8.0 * unit, "{n}: {x} {y:?}");
            }
        }
    }

    #[test]
    fn frequencies_are_those_of_the_sum() {
        check::<f32>(f64::from(f32::EPSILON));
        check::<f64>(f64::EPSILON);
    }
}
