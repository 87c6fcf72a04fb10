//! A texture in memory: one level of texels of any number of channels.

use photofit_scalar::Real;

/// A texture of `C` samples a texel, row-major, row 0 at v = 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Texture<T, const C: usize> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` texels.
    pub texels: Vec<[T; C]>,
}

impl<T: Real, const C: usize> Texture<T, C> {
    /// A texture with all texels equal.
    pub fn filled(width: usize, height: usize, texel: [T; C]) -> Self {
        Self { width, height, texels: vec![texel; width * height] }
    }
}
