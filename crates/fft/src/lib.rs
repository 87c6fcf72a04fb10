//! Fourier and cosine transforms of rows of real numbers.
//!
//! The transforms of `rustfft` are generic code, which every crate that plans one compiles anew; here they are planned for `f32` and
//! `f64`, so that other crates link to them.

mod cosine;
mod real;

pub use cosine::Cosine;
pub use real::{Buffers, RealFft, Sample};
pub use realfft::num_complex::Complex;

/// `2 - 2 cos a`, the eigenvalue of the one-dimensional Laplacian (minus the second difference) at the angle `a` between neighbours,
/// without cancellation.
pub fn laplacian_eigenvalue(a: f64) -> f64 {
    let s = (0.5 * a).sin();
    4.0 * s * s
}

#[cfg(test)]
mod tests {
    #[test]
    fn eigenvalues_are_those_of_waves_and_keep_their_digits() {
        for k in 0..40 {
            let a = 0.1 * f64::from(k);
            let wave = |x: f64| (a * x).cos();
            let found = super::laplacian_eigenvalue(a) * wave(3.0);
            assert!((found - (2.0 * wave(3.0) - wave(2.0) - wave(4.0))).abs() < 1e-13, "{a}");
        }
        assert!((super::laplacian_eigenvalue(1e-9) * 1e18 - 1.0).abs() < 1e-12);
    }
}
