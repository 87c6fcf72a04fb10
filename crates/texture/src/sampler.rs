//! How a texture is read, and what its alpha means.

use photofit_scalar::Real;

/// How a texture continues outside of 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// Periodic.
    #[default]
    Repeat,
    /// Periodic with every other period mirrored.
    MirroredRepeat,
    /// The border texel continues.
    ClampToEdge,
}

/// How a texture is filtered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The nearest texel of the base level.
    Nearest,
    /// Bilinear on the base level.
    Bilinear,
    /// Bilinear on two levels of the mip chain, linear between them.
    #[default]
    Trilinear,
}

/// How a texture is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Sampler {
    /// Continuation along u.
    pub wrap_u: Wrap,
    /// Continuation along v.
    pub wrap_v: Wrap,
    /// Filter.
    pub filter: Filter,
}

/// What alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Visible where alpha is at least the cutoff.
    Mask {
        /// The cutoff.
        cutoff: f32,
    },
    /// Straight alpha blending.
    Blend,
}

impl AlphaMode {
    /// The mode as kernels have it: 0 opaque, 1 mask, 2 blend.
    #[cfg(feature = "gpu")]
    pub fn code(self) -> u32 {
        match self {
            Self::Opaque => 0,
            Self::Mask { .. } => 1,
            Self::Blend => 2,
        }
    }

    /// The part of what lies behind that an alpha hides: 1 for opaque surfaces, 0 or 1 for masks, else alpha within
    /// `[0, 1]`; 0 where it is not a number.
    #[inline(always)]
    pub fn coverage<T: Real>(self, alpha: T) -> T {
        match self {
            Self::Opaque => T::one(),
            Self::Mask { cutoff } if alpha >= T::of(f64::from(cutoff)) => T::one(),
            Self::Mask { .. } => T::zero(),
            Self::Blend => alpha.clamp_to(T::zero(), T::one()),
        }
    }
}
