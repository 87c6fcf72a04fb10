//! Materials as small trees of BSDFs and textures, for formats that describe surfaces more freely than glTF.
//!
//! A [`SurfaceGraph`] says what a surface does at each of its points; [`SurfaceGraph::resolve`] works a point out into
//! BSDFs that a path tracer can use.

mod adjoint;
mod bitmap;
mod resolve;
#[cfg(test)]
mod tests;
mod texture;
mod visit;

pub use bitmap::Bitmap;
pub use resolve::{Partials, ResolvedSurface};
#[cfg(feature = "mitsuba")]
pub(crate) use texture::IDENTITY_UV;
pub use texture::{SurfacePoint, Texture, UvTransform};

use photofit_shading::bsdf::{Bsdf, Plastic, RoughPlastic};

/// Deepest nesting that importers accept.
pub const MAX_GRAPH_DEPTH: usize = 16;

/// A surface: how it scatters, and what it emits from its front.
#[derive(Clone, Debug)]
pub struct SurfaceGraph {
    /// How it scatters.
    pub root: SurfaceNode,
    /// Radiance that leaves the front; `None`: dark.
    pub emission: Option<Texture>,
}

/// A BSDF whose parameters are textures, or a change to one.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum SurfaceNode {
    /// The same BSDF everywhere.
    Constant(Bsdf<f32>),
    /// Lambertian reflection.
    Diffuse {
        /// Albedo.
        reflectance: Texture,
    },
    /// A metal, rough where `alpha` is there.
    Conductor {
        /// Real part of the index of refraction.
        eta: Texture,
        /// Extinction.
        k: Texture,
        /// Factor of the reflectance.
        reflectance: Texture,
        /// Roughness: the surface's distribution and masking, with alpha along both axes from the textures.
        rough: Option<Roughness>,
    },
    /// The boundary of a transparent medium, or a pane, with textured factors; alpha where it is rough.
    Dielectric {
        /// The BSDF with factors 1.
        base: Bsdf<f32>,
        /// Factor of reflected light.
        reflectance: Texture,
        /// Factor of transmitted light.
        transmittance: Texture,
        /// Roughness, for rough boundaries.
        rough: Option<Roughness>,
    },
    /// Smooth plastic with textured colours.
    Plastic {
        /// The plastic with any colours.
        base: Plastic<f32>,
        /// Albedo of the base.
        diffuse: Texture,
        /// Factor of the reflection.
        specular: Texture,
    },
    /// Rough plastic with textured colours.
    RoughPlastic {
        /// The plastic with any colours.
        base: Box<RoughPlastic<f32>>,
        /// Albedo of the base.
        diffuse: Texture,
        /// Factor of the reflection.
        specular: Texture,
    },
    /// The principled model of Burley (2012, 2015), with refraction.
    Principled(Box<PrincipledTextures>),
    /// The thin principled model.
    PrincipledThin(Box<PrincipledThinTextures>),
    /// One surface seen from the front, another (or the same) from the back; both are one-sided.
    TwoSided {
        /// Seen from the front.
        front: Box<Self>,
        /// Seen from the back; `None`: as the front.
        back: Option<Box<Self>>,
    },
    /// A surface that covers a part of its points.
    Mask {
        /// Coverage, 0 to 1.
        opacity: Texture,
        /// What covers.
        inner: Box<Self>,
    },
    /// A mixture: `1 - weight` of the first, `weight` of the second.
    Blend {
        /// Share of the second, 0 to 1.
        weight: Texture,
        /// The two.
        inner: Box<[Self; 2]>,
    },
    /// A surface whose normal follows a height.
    Bump {
        /// Height as a function of the texture coordinates.
        height: Texture,
        /// Factor of the height, in units of the scene.
        scale: f32,
        /// The surface.
        inner: Box<Self>,
    },
    /// A surface whose normal is given in the frame of the tangents, as `(n + 1) / 2`.
    NormalMap {
        /// The normals.
        map: Texture,
        /// The surface.
        inner: Box<Self>,
    },
}

/// A rough surface whose alphas may be textured.
#[derive(Clone, Debug)]
pub struct Roughness {
    /// Distribution and masking; its alphas are replaced.
    pub surface: photofit_shading::bsdf::Microfacet<f32>,
    /// Alpha along the first tangent.
    pub alpha_u: Texture,
    /// Alpha along the second tangent.
    pub alpha_v: Texture,
}

/// Parameters of [`SurfaceNode::PrincipledThin`].
#[derive(Clone, Debug)]
pub struct PrincipledThinTextures {
    /// Colour of the sheet.
    pub base_color: Texture,
    /// Perceptual roughness; its square is alpha.
    pub roughness: Texture,
    /// Stretch of highlights, 0 to 1.
    pub anisotropic: Texture,
    /// Share of what is reflected and passes as by a pane.
    pub spec_trans: Texture,
    /// Twice the share of diffuse light that passes.
    pub diff_trans: Texture,
    /// Tint of the reflection towards the base colour.
    pub spec_tint: Texture,
    /// Sheen at grazing angles.
    pub sheen: Texture,
    /// Tint of the sheen.
    pub sheen_tint: Texture,
    /// Blend towards a flatter diffuse lobe.
    pub flatness: Texture,
    /// Index of refraction.
    pub eta: f32,
}

/// Parameters of [`SurfaceNode::Principled`].
#[derive(Clone, Debug)]
pub struct PrincipledTextures {
    /// Colour of the base.
    pub base_color: Texture,
    /// Perceptual roughness; its square is alpha.
    pub roughness: Texture,
    /// Stretch of highlights, 0 to 1.
    pub anisotropic: Texture,
    /// Share of metal.
    pub metallic: Texture,
    /// Share of what is not metal that refracts light.
    pub spec_trans: Texture,
    /// Tint of the reflection towards the base colour.
    pub spec_tint: Texture,
    /// Sheen at grazing angles.
    pub sheen: Texture,
    /// Tint of the sheen.
    pub sheen_tint: Texture,
    /// Blend towards a flatter diffuse lobe.
    pub flatness: Texture,
    /// Strength of a clear coat.
    pub clearcoat: Texture,
    /// Gloss of the clear coat.
    pub clearcoat_gloss: Texture,
    /// Index of refraction.
    pub eta: f32,
}

impl SurfaceNode {
    /// The same surface; one whose textures are all constant becomes a [`SurfaceNode::Constant`].
    #[must_use]
    pub fn simplified(self) -> Self {
        let mut constant = true;
        self.textures(&mut |t| constant &= t.constant().is_some());
        let leaf = matches!(
            self,
            Self::Diffuse { .. }
                | Self::Conductor { .. }
                | Self::Dielectric { .. }
                | Self::Plastic { .. }
                | Self::RoughPlastic { .. }
                | Self::Principled(_)
                | Self::PrincipledThin(_)
        );
        if constant && leaf { Self::Constant(resolve::anywhere(&self)) } else { self }
    }

    /// Whether light can pass to the other side (coverage aside).
    pub fn transmits(&self) -> bool {
        match self {
            Self::Constant(b) => b.transmits(),
            Self::Dielectric { .. } | Self::PrincipledThin(_) => true,
            Self::Principled(p) => !p.spec_trans.is_zero(),
            Self::TwoSided { .. } => false,
            Self::Mask { inner, .. } | Self::Bump { inner, .. } | Self::NormalMap { inner, .. } => {
                inner.transmits()
            }
            Self::Blend { inner, .. } => inner.iter().any(Self::transmits),
            _ => false,
        }
    }

    /// The texture of the coverage, if the surface does not cover all of its points.
    pub fn opacity(&self) -> Option<&Texture> {
        match self {
            Self::Mask { opacity, .. } => Some(opacity),
            Self::Bump { inner, .. } | Self::NormalMap { inner, .. } => inner.opacity(),
            Self::TwoSided { front, .. } => front.opacity(),
            _ => None,
        }
    }

    /// Whether a frame along the texture coordinates is needed.
    pub fn needs_partials(&self) -> bool {
        let two = |r: &Option<Roughness>| r.as_ref().is_some_and(|r| !r.alpha_u.same(&r.alpha_v));
        match self {
            Self::Constant(Bsdf::Principled(b)) => b.is_anisotropic(),
            Self::Constant(Bsdf::PrincipledThin(b)) => b.is_anisotropic(),
            Self::Constant(Bsdf::RoughConductor(b)) => b.surface.alpha_x != b.surface.alpha_y,
            Self::Constant(Bsdf::RoughDielectric(b)) => b.surface.alpha_x != b.surface.alpha_y,
            Self::Conductor { rough, .. } | Self::Dielectric { rough, .. } => two(rough),
            Self::Principled(p) => !p.anisotropic.is_zero(),
            Self::PrincipledThin(p) => !p.anisotropic.is_zero(),
            Self::Bump { .. } | Self::NormalMap { .. } => true,
            Self::TwoSided { front, back } => {
                front.needs_partials() || back.as_ref().is_some_and(|b| b.needs_partials())
            }
            Self::Mask { inner, .. } => inner.needs_partials(),
            Self::Blend { inner, .. } => inner.iter().any(Self::needs_partials),
            _ => false,
        }
    }

    /// Whether one BSDF, possibly the same on both sides, says it all; then that BSDF and whether it is two-sided.
    pub fn constant(&self) -> Option<(Bsdf<f32>, bool)> {
        match self {
            Self::Constant(b) => Some((*b, false)),
            Self::TwoSided { front, back: None } => match &**front {
                Self::Constant(b) => Some((*b, true)),
                _ => None,
            },
            _ => None,
        }
    }
}
