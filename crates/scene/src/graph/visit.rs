//! All textures of a surface tree, to be read or changed, in one order.

use super::{PrincipledTextures, PrincipledThinTextures, Roughness, SurfaceNode, Texture};

/// Visits the textures of a node and of those inside it, through shared or exclusive references alike.
macro_rules! visit {
    ($node:expr, $visit:ident, $again:ident, $inside:ident, $iter:ident) => {
        match $node {
            SurfaceNode::Constant(_) => {}
            SurfaceNode::Diffuse { reflectance } => $visit(reflectance),
            SurfaceNode::Conductor { eta, k, reflectance, rough } => {
                [eta, k, reflectance].into_iter().for_each(&mut *$visit);
                if let Some(Roughness { alpha_u, alpha_v, .. }) = rough {
                    [alpha_u, alpha_v].into_iter().for_each($visit);
                }
            }
            SurfaceNode::Dielectric { reflectance, transmittance, rough, .. } => {
                [reflectance, transmittance].into_iter().for_each(&mut *$visit);
                if let Some(Roughness { alpha_u, alpha_v, .. }) = rough {
                    [alpha_u, alpha_v].into_iter().for_each($visit);
                }
            }
            SurfaceNode::Plastic { diffuse, specular, .. }
            | SurfaceNode::RoughPlastic { diffuse, specular, .. } => {
                [diffuse, specular].into_iter().for_each($visit);
            }
            SurfaceNode::Principled(p) => {
                let PrincipledTextures {
                    base_color,
                    roughness,
                    anisotropic,
                    metallic,
                    spec_trans,
                    spec_tint,
                    sheen,
                    sheen_tint,
                    flatness,
                    clearcoat,
                    clearcoat_gloss,
                    eta: _,
                } = p.$inside();
                let base = [base_color, roughness, anisotropic, metallic, spec_trans, spec_tint];
                let layers = [sheen, sheen_tint, flatness, clearcoat, clearcoat_gloss];
                base.into_iter().chain(layers).for_each($visit);
            }
            SurfaceNode::PrincipledThin(p) => {
                let PrincipledThinTextures {
                    base_color,
                    roughness,
                    anisotropic,
                    spec_trans,
                    diff_trans,
                    spec_tint,
                    sheen,
                    sheen_tint,
                    flatness,
                    eta: _,
                } = p.$inside();
                let base = [base_color, roughness, anisotropic, spec_trans, diff_trans, spec_tint];
                base.into_iter().chain([sheen, sheen_tint, flatness]).for_each($visit);
            }
            SurfaceNode::TwoSided { front, back } => {
                front.$again($visit);
                if let Some(back) = back {
                    back.$again($visit);
                }
            }
            SurfaceNode::Mask { opacity: own, inner }
            | SurfaceNode::Bump { height: own, inner, .. }
            | SurfaceNode::NormalMap { map: own, inner } => {
                $visit(own);
                inner.$again($visit);
            }
            SurfaceNode::Blend { weight, inner } => {
                $visit(weight);
                inner.$iter().for_each(|n| n.$again($visit));
            }
        }
    };
}

impl SurfaceNode {
    /// Calls `visit` with every texture.
    pub fn textures<'a>(&'a self, visit: &mut dyn FnMut(&'a Texture)) {
        visit!(self, visit, textures, as_ref, iter);
    }

    /// The textures in the same order, to be changed.
    pub(super) fn textures_mut(&mut self, visit: &mut dyn FnMut(&mut Texture)) {
        visit!(self, visit, textures_mut, as_mut, iter_mut);
    }
}
