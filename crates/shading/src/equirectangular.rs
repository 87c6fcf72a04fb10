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
        let [u, v] = equirectangular(d);
        Self::at([u * T::of(width as f64), v * T::of(height as f64)], [width, height], false)
    }

    /// For a place in texels from the upper left corner of an image of this width and height, above 0. Where
    /// `rows_to_poles`, the centres of the first and the last row lie at the poles, instead of half a row away.
    #[inline(always)]
    pub fn at([x, y]: [T; 2], [width, height]: [usize; 2], rows_to_poles: bool) -> Self {
        let (one, half) = (T::one(), T::of(0.5));
        let x = x - half;
        let y = if rows_to_poles { y * T::of((height - 1) as f64 / height as f64) } else { y - half };
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (x - i, y - j);
        let (i, j, w, h) = (i.as_i32(), j.as_i32(), width as i32, height as i32);
        let column = |i: i32| {
            let turn = if i < 0 {
                w
            } else if i >= w {
                -w
            } else {
                0
            };
            (i + turn).clamp(0, w - 1) as usize
        };
        let row = |j: i32| j.clamp(0, h - 1) as usize * width;
        let (c0, c1, r0, r1) = (column(i), column(i + 1), row(j), row(j + 1));
        Self {
            texels: [r0 + c0, r0 + c1, r1 + c0, r1 + c1],
            weights: [(one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy],
        }
    }

    /// Indices and weights: the derivative of the radiance with respect to each texel.
    #[inline]
    pub fn pairs(&self) -> impl Iterator<Item = (usize, T)> + use<T> {
        self.texels.into_iter().zip(self.weights)
    }

    /// Radiance: the weighted sum of the texels.
    ///
    /// # Panics
    /// When `texels` is shorter than the image.
    #[inline]
    pub fn radiance(&self, texels: &[Vec3<T>]) -> Vec3<T> {
        let mut sum = Vec3::zero();
        for (i, w) in self.pairs() {
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
        for (i, w) in self.pairs() {
            gradient[i] += g * w;
        }
    }
}

/// Place of a direction (of any length but 0) in an image: `u` from the left and `v` from the top, in `[0, 1]`.
#[inline(always)]
pub fn equirectangular<T: Real>(d: Vec3<T>) -> [T; 2] {
    let u = T::of(0.5) + d.z.atan2(d.x) * T::of(0.5 / PI);
    // More digits than acos(y) near the poles.
    let v = (d.x * d.x + d.z * d.z).sqrt().atan2(d.y) * T::of(1.0 / PI);
    [u, v]
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
                let taps = if k % 2 == 0 {
                    EquirectangularTaps::new(d, width, height)
                } else {
                    let [u, v] = equirectangular(d);
                    EquirectangularTaps::at([u * width as f64, v * height as f64], [width, height], true)
                };
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
