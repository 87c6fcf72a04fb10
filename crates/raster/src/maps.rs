//! The material maps of a fitted asset: all channels of a texel side by side, one cache line each.

use crate::texture::Texture;

/// Samples of a texel.
pub const CHANNELS: usize = 16;

/// Which sample of a texel means what.
pub mod channel {
    /// Linear base colour, three samples.
    pub const BASE_COLOR: usize = 0;
    /// Straight alpha.
    pub const ALPHA: usize = 3;
    /// Specular suppression gamma (0 = full specular lobe).
    pub const SPECULAR_SUPPRESSION: usize = 4;
    /// Perceptual roughness.
    pub const ROUGHNESS: usize = 5;
    /// Metalness.
    pub const METALLIC: usize = 6;
    /// Tangent-space unit normal, three samples in [-1, 1].
    pub const NORMAL: usize = 7;
    /// Linear emitted radiance, three samples.
    pub const EMISSIVE: usize = 10;
    /// Samples that are drawn and fitted.
    pub const USED: usize = 13;
    /// Share of indirect light that reaches the surface (ambient occlusion), in [0, 1]: carried along, not drawn. The
    /// samples behind it are padding.
    pub const OCCLUSION: usize = 13;
}

/// Material maps: a texture of [`CHANNELS`] samples a texel, row 0 at the top (v = 0).
pub type Maps<T = f32> = Texture<T, CHANNELS>;
