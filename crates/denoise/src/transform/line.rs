//! Transforms of one row that diagonalise the one-dimensional `L`.

use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use super::{Sample, eigenvalue};
use crate::operators::Boundary;

/// Forward and inverse transform of rows of one length: the real Fourier transform for [`Boundary::Periodic`], the
/// DCT-II and its inverse for [`Boundary::Neumann`].
///
/// The DCT of N samples is one real FFT of N reordered samples and N multiplications by twiddles (Makhoul 1980).
#[derive(Clone)]
pub struct LineTransform<T: Sample> {
    boundary: Boundary,
    len: usize,
    forward: Arc<dyn RealToComplex<T>>,
    inverse: Arc<dyn ComplexToReal<T>>,
    /// `exp(-i pi k / 2N)` for k up to N/2, for the DCT.
    twiddles: Vec<Complex<T>>,
}

/// Buffers of one task.
#[derive(Debug)]
pub(crate) struct LineScratch<T> {
    real: Vec<T>,
    complex: Vec<Complex<T>>,
    fft: Vec<Complex<T>>,
}

impl<T: Sample> fmt::Debug for LineTransform<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LineTransform({:?}, {})", self.boundary, self.len)
    }
}

impl<T: Sample> LineTransform<T> {
    /// Plans for rows of `len` samples.
    ///
    /// # Panics
    /// If `len` is 0.
    pub fn new(boundary: Boundary, len: usize) -> Self {
        assert!(len > 0, "rows have samples");
        let mut planner = RealFftPlanner::new();
        let angle = |k: usize| -std::f64::consts::PI * k as f64 / (2 * len) as f64;
        let twiddles = match boundary {
            Boundary::Periodic => Vec::new(),
            Boundary::Neumann => {
                (0..=len / 2).map(|k| Complex::new(T::of(angle(k).cos()), T::of(angle(k).sin()))).collect()
            }
        };
        Self {
            boundary,
            len,
            forward: planner.plan_fft_forward(len),
            inverse: planner.plan_fft_inverse(len),
            twiddles,
        }
    }

    /// Number of real coefficients: N for the DCT; for the Fourier transform N/2+1 real parts, then as many
    /// imaginary parts.
    pub fn coefficients(&self) -> usize {
        match self.boundary {
            Boundary::Periodic => 2 * (self.len / 2 + 1),
            Boundary::Neumann => self.len,
        }
    }

    /// Eigenvalue of the one-dimensional `L` that belongs to coefficient `k`.
    pub fn eigenvalue(&self, k: usize) -> f64 {
        let n = self.len as f64;
        match self.boundary {
            Boundary::Periodic => eigenvalue(std::f64::consts::TAU * (k % (self.len / 2 + 1)) as f64 / n),
            Boundary::Neumann => eigenvalue(std::f64::consts::PI * k as f64 / n),
        }
    }

    pub(crate) fn scratch(&self) -> LineScratch<T> {
        let zero = Complex::new(T::zero(), T::zero());
        LineScratch {
            real: vec![T::zero(); self.len],
            complex: vec![zero; self.len / 2 + 1],
            fft: vec![zero; self.forward.get_scratch_len().max(self.inverse.get_scratch_len())],
        }
    }

    /// Coefficients of `row`, not normalised.
    pub(crate) fn forward(&self, row: &[T], out: &mut [T], s: &mut LineScratch<T>) {
        let n = self.len;
        match self.boundary {
            Boundary::Periodic => s.real.copy_from_slice(row),
            Boundary::Neumann => {
                for (i, &v) in row.iter().enumerate() {
                    s.real[if i % 2 == 0 { i / 2 } else { n - 1 - i / 2 }] = v;
                }
            }
        }
        self.forward
            .process_with_scratch(&mut s.real, &mut s.complex, &mut s.fft)
            .expect("buffers have the planned lengths");
        match self.boundary {
            Boundary::Periodic => {
                let (re, im) = out.split_at_mut(n / 2 + 1);
                for ((re, im), z) in re.iter_mut().zip(im).zip(&s.complex) {
                    (*re, *im) = (z.re, z.im);
                }
            }
            Boundary::Neumann => {
                for (k, (z, w)) in s.complex.iter().zip(&self.twiddles).enumerate() {
                    let v = *z * *w;
                    out[k] = v.re;
                    if k > 0 && 2 * k < n {
                        out[n - k] = -v.im;
                    }
                }
            }
        }
    }

    /// Inverse of [`Self::forward`] times N.
    pub(crate) fn inverse(&self, coefficients: &[T], row: &mut [T], s: &mut LineScratch<T>) {
        let n = self.len;
        match self.boundary {
            Boundary::Periodic => {
                let (re, im) = coefficients.split_at(n / 2 + 1);
                for ((z, &re), &im) in s.complex.iter_mut().zip(re).zip(im) {
                    *z = Complex::new(re, im);
                }
            }
            Boundary::Neumann => {
                for (k, (z, w)) in s.complex.iter_mut().zip(&self.twiddles).enumerate() {
                    let mirrored = if k == 0 { T::zero() } else { coefficients[n - k] };
                    *z = Complex::new(coefficients[k], -mirrored) * w.conj();
                }
            }
        }
        // The transform of a real row is real at the lowest frequency and, for even N, at the highest.
        s.complex[0].im = T::zero();
        if n.is_multiple_of(2) {
            s.complex[n / 2].im = T::zero();
        }
        self.inverse
            .process_with_scratch(&mut s.complex, &mut s.real, &mut s.fft)
            .expect("buffers have the planned lengths and real ends");
        match self.boundary {
            Boundary::Periodic => row.copy_from_slice(&s.real),
            Boundary::Neumann => {
                for (i, v) in row.iter_mut().enumerate() {
                    *v = s.real[if i % 2 == 0 { i / 2 } else { n - 1 - i / 2 }];
                }
            }
        }
    }
}
