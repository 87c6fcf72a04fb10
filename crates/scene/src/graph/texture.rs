//! Textures as functions of a surface point.

use super::Bitmap;
use super::bitmap::luminance_weights;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2};
use std::sync::Arc;

/// An affine map of texture coordinates, row by row.
pub type UvTransform = [[f32; 3]; 2];

/// The map that changes nothing.
#[cfg(feature = "mitsuba")]
pub(crate) const IDENTITY_UV: UvTransform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// What a texture may depend on.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Texture coordinates as the format defines them.
    pub uv: Vec2f,
    /// Interpolated vertex attribute.
    pub color: Vec4f,
    /// Index of the triangle in its mesh.
    pub piece: u32,
}

/// A colour or number over a surface.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Texture {
    /// The same everywhere.
    Constant(Vec3f),
    /// Squares of half a unit: the first texture where both coordinates lie in the same half.
    Checkerboard {
        /// The two textures.
        colors: Arc<[Self; 2]>,
        /// Applied to the texture coordinates.
        to_uv: UvTransform,
    },
    /// An image.
    Bitmap {
        /// The image.
        image: Arc<Bitmap>,
        /// Applied to the texture coordinates.
        to_uv: UvTransform,
        /// Factor of the values.
        scale: f32,
    },
    /// An attribute of the vertices, interpolated.
    VertexAttribute {
        /// Factor of the values.
        scale: f32,
    },
    /// An attribute of the triangles.
    FaceAttribute {
        /// One value per triangle.
        values: Arc<[Vec3f]>,
        /// Factor of the values.
        scale: f32,
    },
}

impl Texture {
    /// The same number in all channels.
    pub fn number(x: f32) -> Self {
        Self::Constant(Vec3f::splat(x))
    }

    /// Colour at a point.
    pub fn color(&self, at: &SurfacePoint) -> Vec3f {
        match self {
            Self::Constant(c) => *c,
            Self::Checkerboard { colors, to_uv } => {
                let uv = transform(to_uv, at.uv);
                let upper = |x: f32| x - x.floor() > 0.5;
                colors[usize::from(upper(uv.x) != upper(uv.y))].color(at)
            }
            Self::Bitmap { image, to_uv, scale } => image.color(transform(to_uv, at.uv)) * *scale,
            Self::VertexAttribute { scale } => at.color.xyz() * *scale,
            Self::FaceAttribute { values, scale } => {
                values.get(at.piece as usize).copied().unwrap_or_default() * *scale
            }
        }
    }

    /// Adjoint of [`Self::color`] for the gradient `g`: calls `add` with texels of an image, or with 0 for a constant.
    /// Other textures have none.
    pub fn color_vjp(&self, at: &SurfacePoint, g: Vec3f, mut add: impl FnMut(usize, Vec3f)) {
        match self {
            Self::Constant(_) => add(0, g),
            Self::Bitmap { image, to_uv, scale } => {
                image.color_vjp(transform(to_uv, at.uv), g * *scale, add);
            }
            _ => {}
        }
    }

    /// Adjoint of [`Self::value`], as [`Self::color_vjp`]: of constants and of texels of one channel the gradient is in the
    /// first component, of coloured texels it is shared as their luminance is.
    pub fn value_vjp(&self, at: &SurfacePoint, g: f32, add: impl FnMut(usize, Vec3f)) {
        let share = match self {
            Self::Bitmap { image, .. } if image.channels() > 1 => Vec3f::from_array(luminance_weights()),
            _ => Vec3f { x: 1.0, y: 0.0, z: 0.0 },
        };
        self.color_vjp(at, share * g, add);
    }

    /// Texels of an image, 1 for a constant; `None` where [`Self::color_vjp`] tells nothing.
    pub fn texels(&self) -> Option<usize> {
        match self {
            Self::Constant(_) => Some(1),
            Self::Bitmap { image, .. } => Some(image.size()[0] * image.size()[1]),
            _ => None,
        }
    }

    /// Number at a point: the luminance of colours.
    pub fn value(&self, at: &SurfacePoint) -> f32 {
        match self {
            Self::Bitmap { image, to_uv, scale } if image.channels() == 1 => {
                image.color(transform(to_uv, at.uv)).x * scale
            }
            _ => {
                let c = self.color(at);
                if c.x == c.y && c.y == c.z { c.x } else { photofit_image::luminance(c.to_array()) }
            }
        }
    }

    /// Derivative of [`Self::value`] with respect to the texture coordinates of the surface; zero but for images.
    pub fn gradient(&self, at: &SurfacePoint) -> Vec2f {
        match self {
            Self::Bitmap { image, to_uv: m, scale } => {
                let g = image.gradient(transform(m, at.uv)) * *scale;
                vec2(m[0][0] * g.x + m[1][0] * g.y, m[0][1] * g.x + m[1][1] * g.y)
            }
            _ => vec2(0.0, 0.0),
        }
    }

    /// The value, if it is the same everywhere.
    pub fn constant(&self) -> Option<Vec3f> {
        match self {
            Self::Constant(c) => Some(*c),
            _ => None,
        }
    }

    /// Whether it is 0 everywhere.
    pub(crate) fn is_zero(&self) -> bool {
        self.constant() == Some(Vec3f::zero())
    }

    /// Whether both are the same constant.
    pub(crate) fn same(&self, other: &Self) -> bool {
        self.constant().is_some() && self.constant() == other.constant()
    }

    /// Largest value that the texture takes, per channel; `None` where that is not known.
    pub fn largest(&self) -> Option<Vec3f> {
        match self {
            Self::Constant(c) => Some(*c),
            Self::Checkerboard { colors, .. } => Some(colors[0].largest()?.max(colors[1].largest()?)),
            Self::Bitmap { image, scale, .. } => Some(image.largest() * *scale),
            Self::FaceAttribute { values, scale } => {
                Some(values.iter().fold(Vec3f::zero(), |m, v| m.max(*v)) * *scale)
            }
            Self::VertexAttribute { .. } => None,
        }
    }
}

#[inline]
fn transform(m: &UvTransform, uv: Vec2f) -> Vec2f {
    vec2(m[0][0] * uv.x + m[0][1] * uv.y + m[0][2], m[1][0] * uv.x + m[1][1] * uv.y + m[1][2])
}
