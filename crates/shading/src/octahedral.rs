//! Spherical images in the octahedral parametrisation, read bilinearly with exact derivatives.
//!
//! A direction `d` (any length) maps to `p = (x, z) / (|x| + |y| + |z|)`; the lower half (`y < 0`) folds to
//! `p = (1 - |z|, 1 - |x|)` with the signs of x and z (Engelhardt and Dachsbacher 2008, y up). A border of one
//! texel holds the neighbours across the folds, so that lookups need no wrapping.

use photofit_scalar::{Real, Vec3, vec3};

/// A square spherical image of RGB radiance.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Octahedral<T> {
    size: usize,
    /// `(size + 2)^2` texels, the fourth number is padding.
    texels: Vec<[T; 4]>,
}

/// Where a direction lies in the image.
struct Taps<T> {
    index: usize,
    fx: T,
    fy: T,
    p: [T; 2],
    inv: T,
    sign: Vec3<T>,
}

/// Coordinates of a border texel's twin inside of the image; `(i, j)` in `-1..=size`.
fn inside(i: isize, j: isize, size: isize) -> (isize, isize) {
    let (mut i, mut j) = (i, j);
    if i < 0 || i >= size {
        i = i.clamp(0, size - 1);
        j = size - 1 - j;
    }
    if j < 0 || j >= size {
        j = j.clamp(0, size - 1);
        i = size - 1 - i;
    }
    (i, j)
}

/// The unit direction at `p` in `[-1, 1]^2`, and the solid angle per area of `p` there.
pub(crate) fn direction(px: f64, pz: f64) -> (Vec3<f64>, f64) {
    let y = 1.0 - px.abs() - pz.abs();
    let (mut x, mut z) = (px, pz);
    if y < 0.0 {
        x = (1.0 - pz.abs()).copysign(px);
        z = (1.0 - px.abs()).copysign(pz);
    }
    let d = vec3(x, y, z);
    let inv = 1.0 / d.length();
    (d * inv, inv * inv * inv)
}

/// Unit direction and solid angle of texel `(i, j)` of `size`^2 (the solid angle as at its centre).
pub(crate) fn texel_direction(size: usize, i: usize, j: usize) -> (Vec3<f64>, f64) {
    let step = 2.0 / size as f64;
    let (d, density) = direction((i as f64 + 0.5) * step - 1.0, (j as f64 + 0.5) * step - 1.0);
    (d, density * step * step)
}

impl<T: Real> Octahedral<T> {
    /// Fills an image from the values of its texels in row-major order.
    pub(crate) fn from_texels(size: usize, texels: &[Vec3<T>]) -> Self {
        assert_eq!(texels.len(), size * size, "one value per texel");
        let signed = size as isize;
        let mut padded = Vec::with_capacity((size + 2) * (size + 2));
        for j in -1..=signed {
            for i in -1..=signed {
                let (x, y) = inside(i, j, signed);
                let t = texels[y as usize * size + x as usize];
                padded.push([t.x, t.y, t.z, T::zero()]);
            }
        }
        Self { size, texels: padded }
    }

    /// Texels per side.
    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// All texels with their border, `(size + 2)^2`; the fourth number is padding.
    #[cfg(feature = "gpu")]
    pub(crate) fn padded(&self) -> &[[T; 4]] {
        &self.texels
    }

    /// The texel of column `i`, row `j`.
    pub(crate) fn texel(&self, i: usize, j: usize) -> Vec3<T> {
        let t = &self.texels[(j + 1) * (self.size + 2) + i + 1];
        vec3(t[0], t[1], t[2])
    }

    /// [`texel_direction`] of an image of this size.
    pub(crate) fn texel_direction(&self, i: usize, j: usize) -> (Vec3<f64>, f64) {
        texel_direction(self.size, i, j)
    }

    /// Multiplies every texel.
    pub(crate) fn scale(&mut self, factor: T) {
        for v in self.texels.iter_mut().flatten() {
            *v *= factor;
        }
    }

    /// Converts the texels to another scalar.
    pub(crate) fn cast<U: Real>(&self) -> Octahedral<U> {
        let texels = self.texels.iter().map(|t| t.map(|v| U::of(v.f64()))).collect();
        Octahedral { size: self.size, texels }
    }

    #[inline(always)]
    fn taps(&self, d: Vec3<T>) -> Taps<T> {
        let (zero, one, half) = (T::zero(), T::one(), T::of(0.5));
        let sign = d.map(|v| if v < zero { -one } else { one });
        let l1 = d.x.abs() + d.y.abs() + d.z.abs();
        let inv = one / if l1 > T::of(1e-30) { l1 } else { T::of(1e-30) };
        let (px, pz) = (d.x * inv, d.z * inv);
        let (u, v) =
            if d.y < zero { ((one - pz.abs()) * sign.x, (one - px.abs()) * sign.z) } else { (px, pz) };
        let scale = T::of(self.size as f64) * half;
        // Texel centres lie at +.5, the border adds one.
        let x = u * scale + (scale + half);
        let y = v * scale + (scale + half);
        let i = (x.f64() as usize).min(self.size);
        let j = (y.f64() as usize).min(self.size);
        let (fx, fy) = (x - T::of(i as f64), y - T::of(j as f64));
        Taps { index: j * (self.size + 2) + i, fx, fy, p: [px, pz], inv, sign }
    }

    #[inline(always)]
    fn corners(&self, index: usize) -> [Vec3<T>; 4] {
        let pitch = self.size + 2;
        let row = &self.texels[index..index + pitch + 2];
        [row[0], row[1], row[pitch], row[pitch + 1]].map(|t| vec3(t[0], t[1], t[2]))
    }

    /// Bilinear lookup in the direction `d` (any length but zero).
    #[inline(always)]
    pub(crate) fn lookup(&self, d: Vec3<T>) -> Vec3<T> {
        let at = self.taps(d);
        let [a, b, c, e] = self.corners(at.index);
        let (low, high) = (a + (b - a) * at.fx, c + (e - c) * at.fx);
        low + (high - low) * at.fy
    }

    /// [`Self::lookup`] and its adjoint with respect to `d`; `seed` maps the value to its gradient.
    #[inline(always)]
    pub(crate) fn lookup_vjp(&self, d: Vec3<T>, seed: impl FnOnce(Vec3<T>) -> Vec3<T>) -> (Vec3<T>, Vec3<T>) {
        let at = self.taps(d);
        let [a, b, c, e] = self.corners(at.index);
        let (low, high) = (a + (b - a) * at.fx, c + (e - c) * at.fx);
        let value = low + (high - low) * at.fy;
        let g = seed(value);
        let scale = T::of(self.size as f64) * T::of(0.5);
        let g_u = g.dot((b - a) + ((e - c) - (b - a)) * at.fy) * scale;
        let g_v = g.dot(high - low) * scale;
        let fold = -at.sign.x * at.sign.z;
        let (g_x, g_z) = if d.y < T::zero() { (g_v * fold, g_u * fold) } else { (g_u, g_v) };
        let common = (g_x * at.p[0] + g_z * at.p[1]) * at.inv;
        let g_d = vec3(g_x * at.inv, T::zero(), g_z * at.inv) - at.sign * common;
        (value, g_d)
    }
}

impl Octahedral<f32> {
    /// Half the size: averages of 2x2 texels weighted by solid angle.
    ///
    /// # Panics
    /// If the size is odd.
    pub(crate) fn halved(&self) -> Self {
        assert!(self.size.is_multiple_of(2), "an even size can be halved");
        let size = self.size / 2;
        let mut texels = Vec::with_capacity(size * size);
        for j in 0..size {
            for i in 0..size {
                let (mut sum, mut weight) = (Vec3::zero(), 0.0);
                for (k, l) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let w = self.texel_direction(2 * i + k, 2 * j + l).1 as f32;
                    sum += self.texel(2 * i + k, 2 * j + l) * w;
                    weight += w;
                }
                texels.push(sum * (1.0 / weight));
            }
        }
        Self::from_texels(size, &texels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{unit, vector};
    use photofit_gradcheck::{Uniform, check};
    use std::f64::consts::PI;

    #[test]
    fn texel_directions_map_back_to_their_texels() {
        let size = 8;
        for k in 0..size * size {
            let mut texels = vec![Vec3::zero(); size * size];
            texels[k] = vec3(1.0, 2.0, 3.0);
            let image: Octahedral<f64> = Octahedral::from_texels(size, &texels);
            let (d, _) = image.texel_direction(k % size, k / size);
            assert!((image.lookup(d * 3.0) - texels[k]).length() < 1e-12, "texel {k}");
        }
    }

    #[test]
    fn solid_angles_sum_to_the_sphere() {
        let image: Octahedral<f64> = Octahedral::from_texels(64, &[Vec3::zero(); 64 * 64]);
        let sum: f64 = (0..64 * 64).map(|k| image.texel_direction(k % 64, k / 64).1).sum();
        assert!((sum / (4.0 * PI) - 1.0).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn lookups_are_continuous_across_the_folds() {
        let mut random = Uniform::new(21);
        let texels: Vec<Vec3<f64>> = (0..64).map(|_| vector(&mut random)).collect();
        let image = Octahedral::from_texels(8, &texels);
        for _ in 0..2000 {
            let mut d = unit(&mut random);
            let axis = (random.range(0.0, 3.0)) as usize;
            d[axis] = 1e-9;
            let mut other = d;
            other[axis] = -1e-9;
            let jump = (image.lookup(d) - image.lookup(other)).length();
            assert!(jump < 1e-6, "{d:?}: jump {jump}");
        }
    }

    #[test]
    fn gradient_of_lookups() {
        let mut random = Uniform::new(22);
        let texels: Vec<Vec3<f64>> = (0..64).map(|_| vector(&mut random)).collect();
        let image = Octahedral::from_texels(8, &texels);
        for k in 0..300 {
            let d = unit(&mut random) * random.range(0.3, 3.0);
            let seed = vector(&mut random);
            let (_, g) = image.lookup_vjp(d, |_| seed);
            check(&format!("lookup {k}"), &d.to_array(), &g.to_array(), 1e-7, 1e-5, |x| {
                image.lookup(vec3(x[0], x[1], x[2])).dot(seed)
            });
        }
    }

    #[test]
    fn halving_keeps_the_mean() {
        let mut random = Uniform::new(23);
        let texels: Vec<Vec3<f32>> = (0..256).map(|_| vector(&mut random).cast()).collect();
        let fine = Octahedral::from_texels(16, &texels);
        let mean = |image: &Octahedral<f32>| {
            let (mut sum, mut weight, n) = (Vec3::<f64>::zero(), 0.0, image.size());
            for k in 0..n * n {
                let w = image.texel_direction(k % n, k / n).1;
                sum += image.texel(k % n, k / n).cast() * w;
                weight += w;
            }
            sum * (1.0 / weight)
        };
        assert!((mean(&fine) - mean(&fine.halved())).length() < 0.02);
    }
}
