//! Deferred shading of a fitted mesh: visibility, then interpolate, texture, normal map and shade per pixel, then
//! blending of layers and antialiasing; forward, and the whole list reversed.
//!
//! The per-pixel stages run tile by tile, sorted by triangle, packets of pixels at a time. The reverse pass computes the
//! forward one again: that costs less than reading it back. The mip level passes no gradient to positions.

mod alpha;
#[cfg(feature = "gpu")]
pub mod composite;
mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
mod packet;
mod tile;

pub use frame::{Frame, FrameLayer, Gradients, render, render_into, render_vjp};
pub use packet::SAMPLER;

use crate::antialias::Topology;
use crate::project::Matrix4;
use photofit_scalar::{Vec2, Vec3, Vec4};
use photofit_shading::{Energy, Light, Sides};
use photofit_texture::AlphaMode;

/// Most transparent layers that are drawn of a pixel.
pub const MOST_LAYERS: usize = 16;

/// Transmittance of what lies in front below which nothing behind it is looked for: what rounding leaves of an alpha of 1
/// that was interpolated between texels, not what an asset asks for.
pub const LEAST_TRANSMITTANCE: f32 = 1.0 / (1 << 20) as f32;

/// A mesh as the renderer sees it; all arrays have one entry per vertex or per triangle.
#[derive(Clone, Copy, Debug)]
pub struct Geometry<'a, T> {
    /// World positions.
    pub positions: &'a [Vec3<T>],
    /// Vertex normals.
    pub normals: &'a [Vec3<T>],
    /// Tangents with handedness.
    pub tangents: &'a [Vec4<T>],
    /// Texture coordinates.
    pub uvs: &'a [Vec2<T>],
    /// Triangles and their neighbours.
    pub topology: Topology<'a>,
    /// What alpha means for each triangle; empty = all opaque.
    pub alpha: &'a [AlphaMode],
    /// What is drawn of each triangle; empty = both sides.
    pub sides: &'a [Sides],
}

/// Camera and lights of one image.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, T> {
    /// World to clip space, z in [0, w].
    pub view_projection: Matrix4<T>,
    /// The eye in world space.
    pub eye: Vec3<T>,
    /// The lights.
    pub lights: &'a [Light<'a, T>],
    /// Columns of samples.
    pub width: usize,
    /// Rows of samples.
    pub height: usize,
    /// Samples per axis of one pixel (supersampling; both sizes are multiples of it): backgrounds and gradients
    /// come per pixel.
    pub samples: usize,
    /// Shades once per pixel and triangle, at the centroid of the samples that the triangle covers in the pixel, with
    /// the texture footprint of the pixel, as graphics hardware does; else every sample by itself. `samples` must then
    /// divide [`crate::rasterize::TILE`]. The centroid passes no gradient to positions.
    pub shade_per_pixel: bool,
    /// Added to the mip level; negative is sharper.
    pub lod_bias: T,
}

/// How surfaces with an alpha mask are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Masks {
    /// As glTF says: whole where alpha reaches the cutoff, else not at all. Alpha has no gradient.
    #[default]
    Cut,
    /// Blended with `clamp(1/2 + slope (alpha - cutoff), 0, 1)`, so that alpha has a gradient within `1 / (2 slope)` of
    /// the cutoff. Tends to [`Masks::Cut`] as the slope grows.
    Faded {
        /// Change of the drawn alpha with that of the map, above 0.
        slope: f32,
    },
}

impl Masks {
    /// Whether the drawn alpha follows that of the map.
    pub(crate) fn fades(self, alpha: AlphaMode) -> bool {
        match alpha {
            AlphaMode::Opaque => false,
            AlphaMode::Mask { .. } => self != Self::Cut,
            AlphaMode::Blend => true,
        }
    }
}

/// Which parts run; the rest is skipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passes {
    /// Perturb normals by the map (else interpolated normals are used).
    pub normal_map: bool,
    /// Add emission.
    pub emissive: bool,
    /// Blend silhouettes.
    pub antialias: bool,
    /// Most transparent layers that are looked for.
    pub max_layers: usize,
    /// How alpha masks are drawn.
    pub masks: Masks,
    /// Gradients flow to positions, normals and tangents.
    pub position_gradients: bool,
    /// Gradients flow to the maps.
    pub map_gradients: bool,
    /// Single or multiple scattering between microfacets.
    pub energy: Energy,
    /// Gradients flow to alpha: what lies behind blended surfaces is drawn also where their alpha is 1, and kept.
    pub alpha_gradients: bool,
}

impl Passes {
    /// Whether some gradient of alpha is asked for.
    pub(crate) fn fits_alpha(&self) -> bool {
        self.alpha_gradients && (self.position_gradients || self.map_gradients)
    }
}

impl Default for Passes {
    fn default() -> Self {
        Self {
            normal_map: true,
            emissive: true,
            antialias: true,
            max_layers: MOST_LAYERS,
            masks: Masks::Cut,
            position_gradients: true,
            map_gradients: true,
            energy: Energy::Single,
            alpha_gradients: true,
        }
    }
}

#[cfg(test)]
mod tests;
