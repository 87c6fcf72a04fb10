//! The type-2 cosine transform of rows of one length.

use crate::{Buffers, Complex, RealFft, Sample};
use std::fmt;

/// The type-2 cosine transform of rows of one length and its inverse, each by a real Fourier transform of that length (Makhoul 1980).
#[derive(Clone)]
pub struct Cosine<T> {
    fft: RealFft<T>,
    /// `exp(-i pi k / 2N)` for k up to N/2.
    turns: Vec<Complex<T>>,
}

impl<T> fmt::Debug for Cosine<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Cosine of {:?}", self.fft)
    }
}

impl<T: Sample> Cosine<T> {
    /// For rows of `len` samples.
    ///
    /// # Panics
    /// If `len` is 0.
    pub fn new(len: usize) -> Self {
        let turn = |k: usize| {
            let angle = -std::f64::consts::PI * k as f64 / (2 * len) as f64;
            Complex::new(T::of(angle.cos()), T::of(angle.sin()))
        };
        Self { fft: T::real_fft(len), turns: (0..=len / 2).map(turn).collect() }
    }

    /// Samples of a row.
    #[expect(clippy::len_without_is_empty, reason = "no row is empty")]
    pub fn len(&self) -> usize {
        self.fft.len()
    }

    /// Working memory of one thread.
    pub fn buffers(&self) -> Buffers<T> {
        self.fft.buffers()
    }

    /// `X_k = sum_j x_j cos(pi (2 j + 1) k / 2N)`, in place.
    ///
    /// # Panics
    /// If `row` is not of the length.
    pub fn forward(&self, row: &mut [T], b: &mut Buffers<T>) {
        let n = self.fft.len();
        assert_eq!(row.len(), n, "samples of a row");
        for (j, x) in row.iter().enumerate() {
            b.real[if j % 2 == 0 { j / 2 } else { n - 1 - j / 2 }] = *x;
        }
        self.fft.forward(&mut b.real, &mut b.spectrum, &mut b.scratch);
        for (k, (z, turn)) in b.spectrum.iter().zip(&self.turns).enumerate() {
            let turned = *z * *turn;
            if k > 0 {
                row[n - k] = -turned.im;
            }
            row[k] = turned.re;
        }
    }

    /// Inverse of [`Self::forward`], times N, in place.
    ///
    /// # Panics
    /// If `row` is not of the length.
    pub fn inverse(&self, row: &mut [T], b: &mut Buffers<T>) {
        let n = self.fft.len();
        assert_eq!(row.len(), n, "coefficients of a row");
        for (k, (z, turn)) in b.spectrum.iter_mut().zip(&self.turns).enumerate() {
            let mirrored = if k == 0 { T::zero() } else { row[n - k] };
            *z = Complex::new(row[k], -mirrored) * turn.conj();
        }
        self.fft.inverse(&mut b.spectrum, &mut b.real, &mut b.scratch);
        for (j, x) in row.iter_mut().enumerate() {
            *x = b.real[if j % 2 == 0 { j / 2 } else { n - 1 - j / 2 }];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_are_those_of_the_sum() {
        for n in [1, 2, 3, 8, 15, 31, 64] {
            let cosine = Cosine::<f64>::new(n);
            let mut b = cosine.buffers();
            let row: Vec<f64> = (0..n).map(|k| ((k * k + 3) as f64).sin()).collect();
            let mut changed = row.clone();
            cosine.forward(&mut changed, &mut b);
            for (k, x) in changed.iter().enumerate() {
                let angle = |j: usize| std::f64::consts::PI * ((2 * j + 1) * k) as f64 / (2 * n) as f64;
                let wanted: f64 = row.iter().enumerate().map(|(j, x)| x * angle(j).cos()).sum();
                assert!((x - wanted).abs() < 1e-12 * n as f64, "{n} {k}: {x} {wanted}");
            }
            cosine.inverse(&mut changed, &mut b);
            for (x, y) in row.iter().zip(&changed) {
                assert!((x - y / n as f64).abs() < 1e-13, "{n}: {x} {y}");
            }
        }
    }
}
