//! A surface graph at a point.

use super::{
    PrincipledTextures, PrincipledThinTextures, Roughness, SurfaceGraph, SurfaceNode, SurfacePoint, Texture,
};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{
    Bsdf, Conductor, Diffuse, Microfacet, Principled, PrincipledParameters, PrincipledThin,
    PrincipledThinParameters, RoughConductor,
};

/// Derivatives of the position with respect to the texture coordinates, in the frame whose z is the shading normal.
#[derive(Clone, Copy, Debug)]
pub struct Partials {
    /// Along `u`.
    pub du: Vec3f,
    /// Along `v`.
    pub dv: Vec3f,
}

/// What a surface is at a point, seen from one side.
#[derive(Clone, Copy, Debug)]
pub struct ResolvedSurface {
    /// The BSDF.
    pub bsdf: Bsdf<f32>,
    /// A second one and its share.
    pub second: Option<(Bsdf<f32>, f32)>,
    /// The same is seen from the back as from the front.
    pub two_sided: bool,
    /// The shading normal in the frame of the surface seen from its front; `None`: unchanged.
    pub normal: Option<Vec3f>,
}

impl SurfaceGraph {
    /// The BSDFs at a point seen from the front or the back; `partials` are asked for where a normal map or height
    /// needs them.
    pub fn resolve(
        &self,
        at: &SurfacePoint,
        front: bool,
        partials: impl Fn() -> Partials,
    ) -> ResolvedSurface {
        let mut out = ResolvedSurface {
            bsdf: Bsdf::Diffuse(Diffuse { reflectance: Vec3f::zero() }),
            second: None,
            two_sided: false,
            normal: None,
        };
        let mut node = &self.root;
        loop {
            match node {
                SurfaceNode::TwoSided { front: f, back } => {
                    out.two_sided = true;
                    node = if front { f } else { back.as_ref().unwrap_or(f) };
                }
                SurfaceNode::Mask { inner, .. } => node = inner,
                SurfaceNode::Bump { height, scale, inner } => {
                    out.normal = Some(bumped(height.gradient(at) * *scale, &partials()));
                    node = inner;
                }
                SurfaceNode::NormalMap { map, inner } => {
                    let n = (map.color(at) * 2.0 - Vec3f::splat(1.0)).normalize_or_zero();
                    let p = partials();
                    let z = vec3(0.0, 0.0, 1.0);
                    // The frame of the map follows the texture coordinates.
                    let s = (p.du - z * p.du.z).normalize_or_zero();
                    let s = if s == Vec3f::zero() { vec3(1.0, 0.0, 0.0) } else { s };
                    out.normal = Some(s * n.x + z.cross(s) * n.y + z * n.z);
                    node = inner;
                }
                SurfaceNode::Blend { weight, inner } => {
                    let w = weight.value(at).clamp(0.0, 1.0);
                    out.bsdf = leaf(&inner[0], at);
                    out.second = Some((leaf(&inner[1], at), w));
                    return out;
                }
                other => {
                    out.bsdf = leaf(other, at);
                    return out;
                }
            }
        }
    }
}

/// The normal of a displaced surface (Blinn 1978).
fn bumped(gradient: photofit_scalar::Vec2f, p: &Partials) -> Vec3f {
    let z = vec3(0.0, 0.0, 1.0);
    // Heights are measured along the shading normal, from its tangent plane.
    let du = p.du + z * (gradient.x - p.du.z);
    let dv = p.dv + z * (gradient.y - p.dv.z);
    let n = du.cross(dv).normalize_or_zero();
    if n == Vec3f::zero() {
        z
    } else if n.z < 0.0 {
        -n
    } else {
        n
    }
}

impl Roughness {
    fn at(&self, at: &SurfacePoint) -> Microfacet<f32> {
        let alpha = |t: &Texture| t.value(at).clamp(0.0, 1e3);
        Microfacet { alpha_x: alpha(&self.alpha_u), alpha_y: alpha(&self.alpha_v), ..self.surface }
    }
}

/// A BSDF without sides, masks and mixtures; what cannot stand here is black.
fn leaf(node: &SurfaceNode, at: &SurfacePoint) -> Bsdf<f32> {
    match node {
        SurfaceNode::Constant(b) => *b,
        SurfaceNode::Diffuse { reflectance } => Bsdf::Diffuse(Diffuse { reflectance: unit(reflectance, at) }),
        SurfaceNode::Conductor { eta, k, reflectance, rough } => {
            let metal = Conductor { eta: eta.color(at), k: k.color(at), reflectance: reflectance.color(at) };
            match rough {
                None => Bsdf::Conductor(metal),
                Some(r) => Bsdf::RoughConductor(RoughConductor { metal, surface: r.at(at) }),
            }
        }
        SurfaceNode::Dielectric { base, reflectance, transmittance, rough } => {
            let (r, t) = (reflectance.color(at), transmittance.color(at));
            let mut bsdf = *base;
            match &mut bsdf {
                Bsdf::Dielectric(b) => (b.reflectance, b.transmittance) = (r, t),
                Bsdf::ThinDielectric(b) => (b.reflectance, b.transmittance) = (r, t),
                Bsdf::RoughDielectric(b) => {
                    (b.glass.reflectance, b.glass.transmittance) = (r, t);
                    if let Some(rough) = rough {
                        b.surface = rough.at(at);
                    }
                }
                _ => {}
            }
            bsdf
        }
        SurfaceNode::Plastic { base, diffuse, specular } => {
            let mut plastic = *base;
            (plastic.diffuse, plastic.specular) = (unit(diffuse, at), specular.color(at));
            Bsdf::Plastic(plastic)
        }
        SurfaceNode::RoughPlastic { base, diffuse, specular } => {
            let mut plastic = **base;
            (plastic.diffuse, plastic.specular) = (unit(diffuse, at), specular.color(at));
            Bsdf::RoughPlastic(plastic)
        }
        SurfaceNode::Principled(p) => Bsdf::Principled(principled(p, at)),
        SurfaceNode::PrincipledThin(p) => Bsdf::PrincipledThin(principled_thin(p, at)),
        _ => Bsdf::Diffuse(Diffuse { reflectance: Vec3f::zero() }),
    }
}

/// A reflectance: not negative, at most 1.
fn unit(t: &Texture, at: &SurfacePoint) -> Vec3f {
    t.color(at).map(|x| x.clamp(0.0, 1.0))
}

fn principled(p: &PrincipledTextures, at: &SurfacePoint) -> Principled<f32> {
    let number = |t: &Texture| t.value(at).clamp(0.0, 1.0);
    Principled::new(&PrincipledParameters {
        base_color: unit(&p.base_color, at),
        roughness: number(&p.roughness),
        anisotropic: number(&p.anisotropic),
        metallic: number(&p.metallic),
        spec_trans: number(&p.spec_trans),
        spec_tint: number(&p.spec_tint),
        sheen: number(&p.sheen),
        sheen_tint: number(&p.sheen_tint),
        flatness: number(&p.flatness),
        clearcoat: number(&p.clearcoat),
        clearcoat_gloss: number(&p.clearcoat_gloss),
        eta: p.eta,
    })
}

fn principled_thin(p: &PrincipledThinTextures, at: &SurfacePoint) -> PrincipledThin<f32> {
    let number = |t: &Texture| t.value(at).clamp(0.0, 1.0);
    PrincipledThin::new(&PrincipledThinParameters {
        base_color: unit(&p.base_color, at),
        roughness: number(&p.roughness),
        anisotropic: number(&p.anisotropic),
        spec_trans: number(&p.spec_trans),
        diff_trans: 0.5 * p.diff_trans.value(at).clamp(0.0, 2.0),
        spec_tint: number(&p.spec_tint),
        sheen: number(&p.sheen),
        sheen_tint: number(&p.sheen_tint),
        flatness: number(&p.flatness),
        eta: p.eta,
    })
}

/// The BSDF of a surface that is the same everywhere.
pub(super) fn anywhere(node: &SurfaceNode) -> Bsdf<f32> {
    let at = SurfacePoint {
        uv: photofit_scalar::vec2(0.0, 0.0),
        color: photofit_scalar::Vec4f::splat(1.0),
        piece: 0,
    };
    leaf(node, &at)
}
