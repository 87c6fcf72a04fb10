//! Deferred shading of a fitted mesh: visibility, then interpolate, texture, normal map and shade per pixel, then
//! blending of layers and antialiasing; forward, and the whole list reversed.
//!
//! The per-pixel stages run tile by tile, sorted by triangle. Where gradients are asked for, what a covered pixel
//! computed is kept for the reverse pass (about 220 bytes each): reading it back costs less than computing it again. The
//! mip level passes no gradient to positions.

mod frame;
mod pixel;
mod tile;

pub use frame::{Frame, FrameLayer, Gradients, render, render_into, render_vjp};

use crate::antialias::Topology;
use crate::project::Matrix4;
use photofit_scalar::{Vec2, Vec3, Vec4};
use photofit_shading::{Energy, Light};
use photofit_texture::AlphaMode;

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
    /// Added to the mip level; negative is sharper.
    pub lod_bias: T,
}

/// Which parts run; the rest is skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passes {
    /// Perturb normals by the map (else interpolated normals are used).
    pub normal_map: bool,
    /// Add emission.
    pub emissive: bool,
    /// Blend silhouettes.
    pub antialias: bool,
    /// Most transparent layers that are looked for.
    pub max_layers: usize,
    /// Gradients flow to positions, normals and tangents.
    pub position_gradients: bool,
    /// Gradients flow to the maps.
    pub map_gradients: bool,
    /// Single or multiple scattering between microfacets.
    pub energy: Energy,
}

impl Default for Passes {
    fn default() -> Self {
        Self {
            normal_map: true,
            emissive: true,
            antialias: true,
            max_layers: 8,
            position_gradients: true,
            map_gradients: true,
            energy: Energy::Single,
        }
    }
}

#[cfg(test)]
mod tests;
