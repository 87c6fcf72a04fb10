//! Division by the reflectance and its inverse: textures leave the picture before it is filtered.

use super::RUN;
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator, ParallelSlice, ParallelSliceMut,
};

/// The smallest divisor. A lower one amplifies noise on black texels that the product takes back anyway.
pub const ALBEDO_FLOOR: f32 = 0.01;

/// The divisor of each sample: `d = max(A, 0.01)`.
///
/// The same `d` multiplies the result, so an emitter on a black surface keeps its light (dividing by `A + eps` and
/// multiplying by `A` loses it). The divisor is continuous in `A`: one that jumps from `A` to 1 at `A = 0.05` puts a
/// factor of 20 between neighbours of a texture that is dark by nature.
///
/// ```
/// use photofit_denoise::mc::divisor;
/// let (albedo, color) = ([0.5_f32, 0.0, 2.0], [1.0_f32, 5.0, 1.0]);
/// for (d, c) in divisor(&albedo).iter().zip(color) {
///     assert!((c / d * d - c).abs() <= 1e-6 * c, "no light is lost");
/// }
/// ```
pub fn divisor(albedo: &[f32]) -> Vec<f32> {
    albedo.par_iter().with_min_len(RUN).map(|a| a.max(ALBEDO_FLOOR)).collect()
}

/// `color / d`, sample by sample.
///
/// # Panics
/// If the lengths differ.
pub fn demodulate(color: &mut [f32], d: &[f32]) {
    assert_eq!(color.len(), d.len(), "one divisor per sample");
    color.par_chunks_mut(RUN).zip(d.par_chunks(RUN)).for_each(|(c, d)| {
        for (c, d) in c.iter_mut().zip(d) {
            *c /= *d;
        }
    });
}

/// `irradiance * d`, sample by sample: the inverse of [`demodulate`].
///
/// # Panics
/// If the lengths differ.
pub fn remodulate(irradiance: &mut [f32], d: &[f32]) {
    assert_eq!(irradiance.len(), d.len(), "one divisor per sample");
    irradiance.par_chunks_mut(RUN).zip(d.par_chunks(RUN)).for_each(|(u, d)| {
        for (u, d) in u.iter_mut().zip(d) {
            *u *= *d;
        }
    });
}
