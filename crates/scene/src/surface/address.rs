//! Where a material's texture is read: set of texture coordinates, transform, level of detail.

use super::UvDerivatives;
use crate::{Filter, Sampler};
use photofit_scalar::{Vec2f, vec2};
use photofit_texture::{LevelOfDetail, Lookup, MipLayout, MipSizes, level_of_detail, lookup};

/// How one or more textures of a material are addressed: the lookup is the same for all of one size, sampler and
/// transform.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Address {
    pub(super) set: usize,
    /// `None`: the identity.
    pub(super) transform: Option<[[f32; 3]; 2]>,
    pub(super) sampler: Sampler,
    pub(super) layout: MipLayout,
}

impl Address {
    /// The lookup at texture coordinates with derivatives along x and y of the image (or none: the base level).
    #[inline(always)]
    pub(super) fn lookup(&self, uv: [Vec2f; 2], footprint: Option<&UvDerivatives>) -> Lookup<f32> {
        // No closure: it would be compiled for the baseline, whatever its caller is compiled for.
        match footprint {
            Some(f) if self.is_trilinear() => self.lookup_at(uv, Some(&self.level(f))),
            _ => self.lookup_at(uv, None),
        }
    }

    /// The lookup at texture coordinates on a level (or none: the base level).
    #[inline(always)]
    pub(super) fn lookup_at(&self, uv: [Vec2f; 2], level: Option<&LevelOfDetail<f32>>) -> Lookup<f32> {
        let uv = match &self.transform {
            None => uv[self.set],
            Some(m) => affine(m, uv[self.set]),
        };
        lookup(&self.layout, uv, level, &self.sampler)
    }

    /// Whether a footprint says which levels are read.
    #[inline(always)]
    pub(super) fn is_trilinear(&self) -> bool {
        self.sampler.filter == Filter::Trilinear && self.layout.count() > 1
    }

    /// The level that a footprint asks for.
    #[inline(always)]
    pub(super) fn level(&self, f: &UvDerivatives) -> LevelOfDetail<f32> {
        let (mut dx, mut dy) = (f.dx[self.set], f.dy[self.set]);
        if let Some(m) = &self.transform {
            (dx, dy) = (linear(m, dx), linear(m, dy));
        }
        let base = self.layout.level(0);
        let (w, h) = (base.width as usize, base.height as usize);
        level_of_detail(&[vec2(dx.x, dy.x), vec2(dx.y, dy.y)], w, h, 0.0, self.layout.count() - 1)
    }
}

#[inline(always)]
fn affine(m: &[[f32; 3]; 2], uv: Vec2f) -> Vec2f {
    let d = linear(m, uv);
    vec2(d.x + m[0][2], d.y + m[1][2])
}

#[inline(always)]
fn linear(m: &[[f32; 3]; 2], uv: Vec2f) -> Vec2f {
    vec2(m[0][0] * uv.x + m[0][1] * uv.y, m[1][0] * uv.x + m[1][1] * uv.y)
}
