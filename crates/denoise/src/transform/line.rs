//! Transforms of one row that diagonalise the one-dimensional `L`.

use photofit_fft::{Buffers, Complex, Cosine, RealFft, laplacian_eigenvalue};

use super::Sample;
use crate::operators::Boundary;

/// Forward and inverse transform of rows of one length: the real Fourier transform for [`Boundary::Periodic`], the
/// DCT-II and its inverse for [`Boundary::Neumann`].
#[derive(Clone, Debug)]
pub struct LineTransform<T: Sample>(By<T>);

#[derive(Clone, Debug)]
enum By<T> {
    Fourier(RealFft<T>),
    Cosine(Cosine<T>),
}

impl<T: Sample> LineTransform<T> {
    /// Plans for rows of `len` samples.
    ///
    /// # Panics
    /// If `len` is 0.
    pub fn new(boundary: Boundary, len: usize) -> Self {
        Self(match boundary {
            Boundary::Periodic => By::Fourier(T::real_fft(len)),
            Boundary::Neumann => By::Cosine(Cosine::new(len)),
        })
    }

    /// Number of real coefficients: N for the DCT; for the Fourier transform N/2+1 real parts, then as many
    /// imaginary parts.
    pub fn coefficients(&self) -> usize {
        match &self.0 {
            By::Fourier(fft) => 2 * fft.frequencies(),
            By::Cosine(cosine) => cosine.len(),
        }
    }

    /// Eigenvalue of the one-dimensional `L` that belongs to coefficient `k`.
    pub fn eigenvalue(&self, k: usize) -> f64 {
        match &self.0 {
            By::Fourier(fft) => laplacian_eigenvalue(
                std::f64::consts::TAU * (k % fft.frequencies()) as f64 / fft.len() as f64,
            ),
            By::Cosine(cosine) => laplacian_eigenvalue(std::f64::consts::PI * k as f64 / cosine.len() as f64),
        }
    }

    pub(crate) fn scratch(&self) -> Buffers<T> {
        match &self.0 {
            By::Fourier(fft) => fft.buffers(),
            By::Cosine(cosine) => cosine.buffers(),
        }
    }

    /// Coefficients of `row`, not normalised.
    pub(crate) fn forward(&self, row: &[T], out: &mut [T], s: &mut Buffers<T>) {
        match &self.0 {
            By::Fourier(fft) => {
                s.real.copy_from_slice(row);
                fft.forward(&mut s.real, &mut s.spectrum, &mut s.scratch);
                let (re, im) = out.split_at_mut(fft.frequencies());
                for ((re, im), z) in re.iter_mut().zip(im).zip(&s.spectrum) {
                    (*re, *im) = (z.re, z.im);
                }
            }
            By::Cosine(cosine) => {
                out.copy_from_slice(row);
                cosine.forward(out, s);
            }
        }
    }

    /// Inverse of [`Self::forward`] times N.
    pub(crate) fn inverse(&self, coefficients: &[T], row: &mut [T], s: &mut Buffers<T>) {
        match &self.0 {
            By::Fourier(fft) => {
                let (re, im) = coefficients.split_at(fft.frequencies());
                for ((z, re), im) in s.spectrum.iter_mut().zip(re).zip(im) {
                    *z = Complex::new(*re, *im);
                }
                fft.inverse(&mut s.spectrum, row, &mut s.scratch);
            }
            By::Cosine(cosine) => {
                row.copy_from_slice(coefficients);
                cosine.inverse(row, s);
            }
        }
    }
}
