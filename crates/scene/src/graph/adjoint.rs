//! Adjoint of [`SurfaceGraph::resolve`]: what gradients of the BSDFs say about textures.
//!
//! Textures are told apart by their place in the order of [`SurfaceNode::textures`]; that of the emission comes last.
//! Coverage, weights of mixtures, heights and normal maps have no gradient.

use super::{SurfaceGraph, SurfaceNode, SurfacePoint, Texture};
use photofit_scalar::Vec3f;
use photofit_shading::bsdf::BsdfGradient;

impl SurfaceGraph {
    /// All textures in order, the emission's last.
    pub fn textures(&self) -> Vec<&Texture> {
        let mut out = Vec::new();
        self.root.textures(&mut |t| out.push(t));
        out.extend(&self.emission);
        out
    }

    /// Changes texture number `index` of [`Self::textures`].
    pub fn edit_texture(&mut self, index: usize, edit: impl FnOnce(&mut Texture)) {
        let (mut edit, mut at) = (Some(edit), 0);
        let mut visit = |t: &mut Texture| {
            if at == index
                && let Some(edit) = edit.take()
            {
                edit(t);
            }
            at += 1;
        };
        self.root.textures_mut(&mut visit);
        self.emission.iter_mut().for_each(visit);
    }

    /// Whether each of [`Self::textures`] has a gradient by [`Self::resolve_vjp`] or [`Self::emission_vjp`].
    pub fn differentiable(&self) -> Vec<bool> {
        let mut out = Vec::new();
        self.root.mark(&mut out, &|leaf, k, texture| {
            texture.texels().is_some()
                && match leaf {
                    SurfaceNode::Diffuse { .. } => true,
                    // Index of refraction and absorption come first; smooth metals are delta lobes.
                    SurfaceNode::Conductor { rough, .. } => rough.is_some() && k >= 2,
                    _ => false,
                }
        });
        out.extend(self.emission.iter().map(|e| e.texels().is_some()));
        out
    }

    /// Whether each of [`Self::textures`] changes the directions of scattered light, and not only how much of it there is: the alphas of
    /// rough metals.
    pub fn changes_directions(&self) -> Vec<bool> {
        let mut out = Vec::new();
        self.root.mark(&mut out, &|leaf, k, _| matches!(leaf, SurfaceNode::Conductor { .. }) && k >= 3);
        out.extend(self.emission.iter().map(|_| false));
        out
    }

    /// Adjoint of [`Self::resolve`] for gradients of the two BSDFs: calls `add` with the index of a texture, a texel (0
    /// of constants) and its gradient.
    pub fn resolve_vjp(
        &self,
        at: &SurfacePoint,
        front: bool,
        gradients: [Option<&BsdfGradient>; 2],
        mut add: impl FnMut(usize, usize, Vec3f),
    ) {
        let (mut node, mut index) = (&self.root, 0);
        loop {
            match node {
                SurfaceNode::TwoSided { front: f, back } => match back {
                    Some(b) if !front => {
                        index += f.texture_count();
                        node = b;
                    }
                    _ => node = f,
                },
                SurfaceNode::Mask { inner, .. }
                | SurfaceNode::Bump { inner, .. }
                | SurfaceNode::NormalMap { inner, .. } => {
                    index += 1;
                    node = inner;
                }
                SurfaceNode::Blend { inner, .. } => {
                    index += 1;
                    leaf_vjp(&inner[0], at, index, gradients[0], &mut add);
                    index += inner[0].texture_count();
                    return leaf_vjp(&inner[1], at, index, gradients[1], &mut add);
                }
                other => return leaf_vjp(other, at, index, gradients[0], &mut add),
            }
        }
    }

    /// Adjoint of the emission at a point for the gradient `g`, as [`Self::resolve_vjp`].
    pub fn emission_vjp(&self, at: &SurfacePoint, g: Vec3f, mut add: impl FnMut(usize, usize, Vec3f)) {
        if let Some(emission) = &self.emission {
            let index = self.root.texture_count();
            emission.color_vjp(at, g, |texel, g| add(index, texel, g));
        }
    }
}

impl SurfaceNode {
    /// What `of` says of each texture of the leaves, by its number there; false for all others. In the order of
    /// [`Self::textures`]; as [`SurfaceGraph::resolve_vjp`] walks.
    fn mark(&self, out: &mut Vec<bool>, of: &impl Fn(&Self, usize, &Texture) -> bool) {
        match self {
            Self::TwoSided { front, back } => {
                front.mark(out, of);
                back.iter().for_each(|b| b.mark(out, of));
            }
            Self::Mask { inner, .. } | Self::Bump { inner, .. } | Self::NormalMap { inner, .. } => {
                out.push(false);
                inner.mark(out, of);
            }
            Self::Blend { inner, .. } => {
                out.push(false);
                inner.iter().for_each(|i| i.mark(out, of));
            }
            leaf => {
                let mut k = 0..;
                leaf.textures(&mut |t| out.push(k.next().is_some_and(|k| of(leaf, k, t))));
            }
        }
    }

    fn texture_count(&self) -> usize {
        let mut count = 0;
        self.textures(&mut |_| count += 1);
        count
    }
}

/// Adjoint of a BSDF without sides, masks and mixtures, whose first texture has the index `first`.
fn leaf_vjp(
    node: &SurfaceNode,
    at: &SurfacePoint,
    first: usize,
    gradient: Option<&BsdfGradient>,
    add: &mut impl FnMut(usize, usize, Vec3f),
) {
    match (node, gradient) {
        (SurfaceNode::Diffuse { reflectance }, Some(BsdfGradient::Diffuse(d))) => {
            // Held where it is clamped.
            let value = reflectance.color(at);
            let g = Vec3f {
                x: inside(value.x, d.reflectance.x),
                y: inside(value.y, d.reflectance.y),
                z: inside(value.z, d.reflectance.z),
            };
            reflectance.color_vjp(at, g, |texel, g| add(first, texel, g));
        }
        (SurfaceNode::Conductor { reflectance, rough, .. }, Some(BsdfGradient::RoughConductor(d))) => {
            reflectance.color_vjp(at, d.reflectance, |texel, g| add(first + 2, texel, g));
            if let Some(r) = rough {
                r.alpha_u.value_vjp(at, d.alpha[0], |texel, g| add(first + 3, texel, g));
                r.alpha_v.value_vjp(at, d.alpha[1], |texel, g| add(first + 4, texel, g));
            }
        }
        _ => {}
    }
}

/// The gradient of a value in `[0, 1]`, else 0.
fn inside(value: f32, g: f32) -> f32 {
    if (0.0..=1.0).contains(&value) { g } else { 0.0 }
}

#[cfg(test)]
mod tests;
