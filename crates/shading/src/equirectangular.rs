//! Bilinear lookup in an equirectangular image of radiance, and its adjoint with respect to the texels.
//!
//! The direction `d` is found at `u = 1/2 + atan2(d.z, d.x) / 2 pi` from the left and `v = acos(d.y) / pi` from the top
//! (the orientation of three.js); row 0 is at +y. Texel centres lie half a texel inside; columns wrap around, rows end
//! at the poles.

use photofit_scalar::{Real, Vec3};
use std::f64::consts::PI;

/// The four texels that a direction sees, and their weights, which sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EquirectangularTaps<T = f32> {
    /// Indices of texels, row by row; some are equal in narrow images and at the poles.
    pub texels: [usize; 4],
    /// Their weights.
    pub weights: [T; 4],
}

impl<T: Real> EquirectangularTaps<T> {
    /// For the direction `d` (of any length but 0) in an image of `width` columns and `height` rows.
    ///
    /// # Panics
    /// When a size is 0.
    #[inline]
    pub fn new(d: Vec3<T>, width: usize, height: usize) -> Self {
        assert!(width > 0 && height > 0, "an image of {width} x {height} has no texels");
        let (one, half) = (T::one(), T::of(0.5));
        let u = half + d.z.atan2(d.x) * T::of(0.5 / PI);
        // More digits than acos(y) near the poles.
        let v = (d.x * d.x + d.z * d.z).sqrt().atan2(d.y) * T::of(1.0 / PI);
        // Shifted by one turn, so that nothing is negative.
        let x = u * T::of(width as f64) - half + T::of(width as f64);
        let y = (v * T::of(height as f64) - half).clamp_to(T::zero(), T::of((height - 1) as f64));
        let (i, j) = (x.f64() as usize, y.f64() as usize);
        let (fx, fy) = (x - T::of(i as f64), y - T::of(j as f64));
        let rows = [j * width, (j + 1).min(height - 1) * width];
        let columns = [i % width, (i + 1) % width];
        Self {
            texels: [rows[0] + columns[0], rows[0] + columns[1], rows[1] + columns[0], rows[1] + columns[1]],
            weights: [(one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy],
        }
    }

    /// Radiance: the weighted sum of the texels.
    ///
    /// # Panics
    /// When `texels` is shorter than the image.
    #[inline]
    pub fn radiance(&self, texels: &[Vec3<T>]) -> Vec3<T> {
        let mut sum = Vec3::zero();
        for (i, w) in self.texels.into_iter().zip(self.weights) {
            sum += texels[i] * w;
        }
        sum
    }

    /// Adjoint of [`Self::radiance`] for the gradient `g` of the radiance, added to that of the texels.
    ///
    /// # Panics
    /// When `gradient` is shorter than the image.
    #[inline]
    pub fn radiance_vjp(&self, g: Vec3<T>, gradient: &mut [Vec3<T>]) {
        for (i, w) in self.texels.into_iter().zip(self.weights) {
            gradient[i] += g * w;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{unit, vector};
    use photofit_gradcheck::{Uniform, check};
    use photofit_scalar::vec3;

    #[test]
    fn texels_have_the_gradient_of_differences() {
        let mut random = Uniform::new(71);
        for (width, height) in [(7, 4), (2, 1), (1, 3), (16, 8)] {
            for k in 0..20 {
                let texels: Vec<Vec3<f64>> = (0..width * height).map(|_| vector(&mut random)).collect();
                let (d, seed) = (unit(&mut random), vector(&mut random));
                let taps = EquirectangularTaps::new(d, width, height);
                let mut gradient = vec![Vec3::zero(); texels.len()];
                taps.radiance_vjp(seed, &mut gradient);
                let flat = |v: &[Vec3<f64>]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<_>>();
                check(
                    &format!("{width} x {height} {k}"),
                    &flat(&texels),
                    &flat(&gradient),
                    1e-6,
                    1e-8,
                    |x| {
                        let texels: Vec<_> = x.chunks(3).map(|c| vec3(c[0], c[1], c[2])).collect();
                        taps.radiance(&texels).dot(seed)
                    },
                );
            }
        }
    }

    #[test]
    fn weights_sum_to_one_and_columns_wrap() {
        let mut random = Uniform::new(72);
        for _ in 0..1000 {
            let taps = EquirectangularTaps::<f32>::new(unit(&mut random).cast(), 12, 6);
            assert!((taps.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{taps:?}");
            assert!(
                taps.weights.iter().all(|w| *w >= 0.0) && taps.texels.iter().all(|i| *i < 72),
                "{taps:?}"
            );
        }
        // The seam lies at -x: half of the last column and half of the first.
        let seam = EquirectangularTaps::<f64>::new(vec3(-1.0, 0.0, 0.0), 8, 4);
        let columns = seam.texels.map(|i| i % 8);
        assert!(columns.contains(&0) && columns.contains(&7), "{seam:?}");
        // The middle of the image looks along +x.
        let middle = EquirectangularTaps::<f64>::new(vec3(1.0, 0.0, 0.0), 7, 3);
        assert!((middle.weights[0] - 1.0).abs() < 1e-12 && middle.texels[0] == 7 + 3, "{middle:?}");
    }
}
