//! Prefiltering of an equirectangular image: resampling to octahedral, a pyramid, and GGX lobes by importance
//! sampling with the level chosen from the sample density (Krivanek and Colbert 2008).

use crate::environment::{Environment, EnvironmentError, LEVELS};
use crate::equirectangular::EquirectangularTaps;
use crate::octahedral::{Octahedral, direction, texel_direction};
use photofit_scalar::{Vec3, Vec3f, vec3};
use rayon::prelude::{IntoParallelIterator, ParallelIterator};
use std::f64::consts::{PI, TAU};

/// Texels per side of each roughness level, at most.
const SIZES: [usize; LEVELS] = [512, 256, 128, 64, 64, 32, 32, 32, 32];
/// Directions per texel of a roughness level.
const SAMPLES: usize = 256;
/// From this level on, lobes are wide enough to be summed over all texels of a coarse image.
const SUMMED_LEVEL: usize = 4;
/// Texels per side of that image, at most, and of the diffuse image.
const SUMMED_SOURCE: usize = 128;
const DIFFUSE_SIZE: usize = 64;
/// Partial sums, so that they vectorise and small numbers are not lost beside large ones.
const LANES: usize = 16;
/// Added to the pyramid level of a sample, so that neighbouring footprints overlap.
const LEVEL_BIAS: f64 = 0.5;
/// Widest equirectangular image that is resampled directly; wider ones are averaged down first.
const WIDTH_MAX: usize = 1024;
/// Radiance above this is clamped, so that sums stay finite in `f32`.
const RADIANCE_MAX: f32 = 1e8;

impl Environment<f32> {
    /// Prefilters an equirectangular image: `height` rows of `width` linear RGB pixels, row 0 at +y.
    ///
    /// Orientation (that of three.js): the direction `d` is found at `u = 1/2 + atan2(d.z, d.x) / 2 pi` from the
    /// left and `v = acos(d.y) / pi` from the top; the middle column looks along +x. Negative and non-finite pixels
    /// count as black. A 1024x512 image takes about one second of processor time, shared by the threads.
    ///
    /// ```
    /// use photofit_scalar::{Vec3, vec3};
    /// use photofit_shading::Environment;
    /// // Upper half white, lower half black.
    /// let rgb: Vec<f32> = (0..16 * 8 * 3).map(|i| if i < 16 * 4 * 3 { 1.0 } else { 0.0 }).collect();
    /// let map = Environment::from_equirectangular(16, 8, &rgb)?;
    /// assert!(map.diffuse(vec3(0.0, 1.0, 0.0)).x > 0.99);
    /// assert!((map.diffuse(vec3(1.0, 0.0, 0.0)).x - 0.5).abs() < 0.01);
    /// assert!(map.specular(vec3(0.0, -1.0, 0.0), 0.2).x < 0.01);
    /// # Ok::<(), photofit_shading::EnvironmentError>(())
    /// ```
    ///
    /// # Errors
    /// When the image has no pixels or `rgb` does not hold `3 * width * height` numbers.
    pub fn from_equirectangular(width: usize, height: usize, rgb: &[f32]) -> Result<Self, EnvironmentError> {
        if width == 0 || height == 0 {
            return Err(EnvironmentError::Empty { width, height });
        }
        if width.checked_mul(height).and_then(|n| n.checked_mul(3)) != Some(rgb.len()) {
            return Err(EnvironmentError::Length { width, height, length: rgb.len() });
        }
        let source = Equirectangular::averaged(width, height, rgb);
        let base_size = (source.width / 2).next_power_of_two().clamp(64, SIZES[0]);
        let pyramid = Pyramid::new(source.resampled(base_size));
        let roughness = |k: usize| k as f64 / (LEVELS - 1) as f64;
        let specular = (0..LEVELS)
            .map(|k| match k {
                0 => pyramid.levels[0].clone(),
                1..SUMMED_LEVEL => pyramid.filtered(SIZES[k].min(base_size), roughness(k)),
                _ => {
                    let a2 = roughness(k).powi(4) as f32;
                    pyramid.summed(SIZES[k], |nl| {
                        // D n.wi for n = wo: the squared cosine of the half vector is (1 + n.wi) / 2.
                        let q = 0.5 * (1.0 + nl) * (a2 - 1.0) + 1.0;
                        nl.max(0.0) / (q * q)
                    })
                }
            })
            .collect();
        Ok(Self { diffuse: pyramid.summed(DIFFUSE_SIZE, |nl| nl.max(0.0)), specular })
    }
}

/// An equirectangular image of moderate size.
struct Equirectangular {
    width: usize,
    height: usize,
    pixels: Vec<Vec3f>,
}

impl Equirectangular {
    /// Cleans the pixels and averages them down to at most [`WIDTH_MAX`] columns.
    fn averaged(width: usize, height: usize, rgb: &[f32]) -> Self {
        let clean = |v: f32| if v > 0.0 && v.is_finite() { v.min(RADIANCE_MAX) } else { 0.0 };
        let (w, h) = (width.min(WIDTH_MAX), height.min(WIDTH_MAX / 2));
        let pixels = (0..w * h)
            .into_par_iter()
            .map(|k| {
                let (i, j) = (k % w, k / w);
                let (mut sum, mut weight) = (Vec3::zero(), 0.0);
                for y in j * height / h..(j + 1) * height / h {
                    let solid_angle = ((y as f64 + 0.5) / height as f64 * PI).sin() as f32;
                    for x in i * width / w..(i + 1) * width / w {
                        let at = (y * width + x) * 3;
                        sum += vec3(clean(rgb[at]), clean(rgb[at + 1]), clean(rgb[at + 2])) * solid_angle;
                        weight += solid_angle;
                    }
                }
                sum * (1.0 / weight)
            })
            .collect();
        Self { width: w, height: h, pixels }
    }

    fn lookup(&self, d: Vec3<f64>) -> Vec3f {
        let taps = EquirectangularTaps::new(d, self.width, self.height);
        EquirectangularTaps { texels: taps.texels, weights: taps.weights.map(|w| w as f32) }
            .radiance(&self.pixels)
    }

    /// The octahedral image of the given size, each texel the mean of several lookups.
    fn resampled(&self, size: usize) -> Octahedral<f32> {
        let n = self.width.div_ceil(size).clamp(2, 8);
        let step = 2.0 / (size * n) as f64;
        let texels: Vec<Vec3f> = (0..size * size)
            .into_par_iter()
            .map(|k| {
                let (i, j) = (k % size * n, k / size * n);
                let (mut sum, mut weight) = (Vec3::zero(), 0.0);
                for l in 0..n * n {
                    let (x, y) = ((i + l % n) as f64 + 0.5, (j + l / n) as f64 + 0.5);
                    let (d, w) = direction(x * step - 1.0, y * step - 1.0);
                    sum += self.lookup(d) * w as f32;
                    weight += w as f32;
                }
                sum * (1.0 / weight)
            })
            .collect();
        Octahedral::from_texels(size, &texels)
    }
}

/// The image at ever halved sizes.
struct Pyramid {
    levels: Vec<Octahedral<f32>>,
}

impl Pyramid {
    fn new(base: Octahedral<f32>) -> Self {
        let mut levels = vec![base];
        while let Some(last) = levels.last()
            && last.size() > 4
        {
            let next = last.halved();
            levels.push(next);
        }
        Self { levels }
    }

    /// Trilinear lookup, `level` in levels above the base.
    #[inline(always)]
    fn lookup(&self, d: Vec3f, level: f32) -> Vec3f {
        let level = level.clamp(0.0, (self.levels.len() - 1) as f32 - 1e-3);
        let i = level as usize;
        let f = level - i as f32;
        self.levels[i].lookup(d) * (1.0 - f) + self.levels[i + 1].lookup(d) * f
    }

    /// The image filtered by the GGX lobe of a roughness.
    fn filtered(&self, size: usize, roughness: f64) -> Octahedral<f32> {
        let samples = lobe_samples(roughness, self.levels[0].size());
        let texels: Vec<Vec3f> = (0..size * size)
            .into_par_iter()
            .map(|k| {
                let n: Vec3f = texel_direction(size, k % size, k / size).0.cast();
                let (s, t) = n.orthonormal_pair();
                let mut sum = Vec3::zero();
                for sample in &samples {
                    let d = s * sample.d.x + t * sample.d.y + n * sample.d.z;
                    sum += self.lookup(d, sample.level) * sample.weight;
                }
                sum
            })
            .collect();
        Octahedral::from_texels(size, &texels)
    }

    /// Means weighted by a function of the cosine, for all axes, by summing over every texel of a coarse level.
    fn summed(&self, size: usize, weight: impl Fn(f32) -> f32 + Sync) -> Octahedral<f32> {
        let source = self
            .levels
            .iter()
            .find(|l| l.size() <= SUMMED_SOURCE)
            .expect("the pyramid goes down to 4 texels");
        let n = source.size();
        // Structure of arrays: direction, solid angle, radiance.
        let mut rows: [Vec<f32>; 7] = Default::default();
        for k in 0..n * n {
            let (d, solid_angle) = source.texel_direction(k % n, k / n);
            let radiance = source.texel(k % n, k / n);
            let values =
                [d.x as f32, d.y as f32, d.z as f32, solid_angle as f32, radiance.x, radiance.y, radiance.z];
            rows.iter_mut().zip(values).for_each(|(row, v)| row.push(v));
        }
        let texels: Vec<Vec3f> = (0..size * size)
            .into_par_iter()
            .map(|k| {
                let axis: Vec3f = texel_direction(size, k % size, k / size).0.cast();
                let mut sums = [[0.0_f32; 4]; LANES];
                for start in (0..n * n).step_by(LANES) {
                    let [x, y, z, w, r, g, b] = std::array::from_fn(|i| &rows[i][start..start + LANES]);
                    for l in 0..LANES {
                        let w = weight(x[l] * axis.x + y[l] * axis.y + z[l] * axis.z) * w[l];
                        sums[l][0] += w * r[l];
                        sums[l][1] += w * g[l];
                        sums[l][2] += w * b[l];
                        sums[l][3] += w;
                    }
                }
                let [r, g, b, w] = std::array::from_fn(|c| sums.iter().map(|s| s[c]).sum::<f32>());
                vec3(r, g, b) * (1.0 / w)
            })
            .collect();
        Octahedral::from_texels(size, &texels)
    }
}

/// A direction of a lobe about +z.
struct LobeSample {
    d: Vec3f,
    weight: f32,
    level: f32,
}

/// Directions reflected about half vectors of the GGX distribution with `n = wo = z`, weighted by `n.wi`.
fn lobe_samples(roughness: f64, base_size: usize) -> Vec<LobeSample> {
    let a2 = roughness.powi(4);
    let texel = 4.0 * PI / (base_size * base_size) as f64;
    let mut samples = Vec::with_capacity(SAMPLES);
    for i in 0..SAMPLES {
        let u = f64::from((i as u32).reverse_bits()) / 2f64.powi(32) + 0.5 / SAMPLES as f64;
        let phi = TAU * (i as f64 + 0.5) / SAMPLES as f64;
        let nh2 = (1.0 - u) / (1.0 + (a2 - 1.0) * u);
        let nl = 2.0 * nh2 - 1.0;
        if nl > 0.0 {
            let side = 2.0 * (nh2 * (1.0 - nh2)).sqrt();
            let d = a2 / (PI * (nh2 * (a2 - 1.0) + 1.0).powi(2));
            let footprint = 4.0 / (d * SAMPLES as f64);
            samples.push(LobeSample {
                d: vec3(side * phi.cos(), side * phi.sin(), nl).cast(),
                weight: nl as f32,
                level: (0.5 * (footprint / texel).log2() + LEVEL_BIAS) as f32,
            });
        }
    }
    let total: f32 = samples.iter().map(|s| s.weight).sum();
    samples.iter_mut().for_each(|s| s.weight /= total);
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_shapes_are_errors() {
        let e = Environment::from_equirectangular(4, 2, &[0.0; 23]).unwrap_err();
        assert_eq!(e, EnvironmentError::Length { width: 4, height: 2, length: 23 });
        let e = Environment::from_equirectangular(0, 2, &[]).unwrap_err();
        assert_eq!(e, EnvironmentError::Empty { width: 0, height: 2 });
        assert!(Environment::from_equirectangular(usize::MAX, 2, &[0.0; 6]).is_err());
    }

    #[test]
    fn a_constant_stays_constant_and_dirt_is_black() {
        let constant = Environment::from_equirectangular(8, 4, &[0.7; 96]).unwrap();
        for d in [vec3(0.0, 1.0, 0.0_f32), vec3(0.3, -0.2, 0.9), vec3(-1.0, 0.1, -0.5)] {
            assert!((constant.diffuse(d) - Vec3::splat(0.7)).length() < 2e-3, "{:?}", constant.diffuse(d));
            for r in [0.0, 0.05, 0.3, 1.0] {
                assert!((constant.specular(d, r) - Vec3::splat(0.7)).length() < 1e-4);
            }
        }
        let dirt = [f32::NAN, f32::INFINITY, -1.0].repeat(32);
        let black = Environment::from_equirectangular(8, 4, &dirt).unwrap();
        assert_eq!(black.diffuse(vec3(0.0, 1.0, 0.0)), Vec3::zero());
        assert_eq!(black.clone().normalised(1.0), black);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let rgb: Vec<f32> = (0..16 * 8 * 3).map(|i| ((i * 7919) % 101) as f32).collect();
        let make = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Environment::from_equirectangular(16, 8, &rgb).unwrap())
        };
        assert_eq!(make(1), make(3));
    }

    #[test]
    fn one_pixel_is_an_environment() {
        let map = Environment::from_equirectangular(1, 1, &[0.1, 0.2, 0.3]).unwrap();
        assert!((map.specular(vec3(0.1, 0.5, -0.7), 0.4) - vec3(0.1, 0.2, 0.3)).length() < 1e-5);
        let scaled = map.normalised(0.5).mean_radiance();
        assert!((scaled.dot(vec3(0.2126, 0.7152, 0.0722)) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn columns_point_where_the_documentation_says() {
        let (w, h) = (64, 32);
        for (d, column) in [
            (vec3(1.0, 0.0, 0.0), 32),
            (vec3(0.0, 0.0, 1.0), 48),
            (vec3(0.0, 0.0, -1.0), 16),
            (vec3(-1.0, 0.0, 0.0), 0),
        ] {
            let mut rgb = vec![0.0; w * h * 3];
            for y in 12..20 {
                for x in [column + w - 2, column + w - 1, column, column + 1] {
                    rgb[(y * w + x % w) * 3] = 1.0;
                }
            }
            let map = Environment::from_equirectangular(w, h, &rgb).unwrap();
            assert!(map.specular(d, 0.0).x > 0.9, "{d:?}: {:?}", map.specular(d, 0.0));
            assert!(map.specular(-d, 0.0).x < 0.01, "{d:?}");
        }
    }
}
