//! Adjoint of the materials of a library at a point.

use super::surface::{CoatOn, coat_normal, mapped, reflecting_upwards_vjp};
use super::{Interaction, SurfaceMaterial, World};
use photofit_scalar::Vec3f;
use photofit_scene::SampleGradient;
use photofit_shading::bsdf::{BsdfGradient, TransportMode};
use photofit_shading::{Surface, face_viewer, face_viewer_vjp, perturb_vjp};

impl World {
    /// Adjoint of the value of a library material, `surface` at the point `at` seen from `viewer`, with respect to what
    /// the library says there: for the gradient `g` of the value between the local directions `wo` and `wi`. `None`
    /// where there is none.
    pub(crate) fn library_vjp(
        &self,
        index: usize,
        at: &Interaction,
        (surface, viewer): (&SurfaceMaterial<'_>, Vec3f),
        [wo, wi]: [Vec3f; 2],
        g: Vec3f,
    ) -> Option<SampleGradient> {
        let library = self.library.as_ref()?;
        let sample = library.lookup(index, at.uv[0], at.uv[1], at.color, None);
        if sample.unlit {
            return None;
        }
        let (mut out, n) = match library.extensions(index, at.uv[0], at.uv[1], None) {
            None => {
                let BsdfGradient::MetallicRoughness(d) = surface.bsdf.eval_vjp(wo, wi, g)? else {
                    return None;
                };
                let (base_color, roughness, metallic) =
                    (sample.base_color, sample.roughness, sample.metallic);
                let s = Surface { base_color, roughness, metallic, gamma: 0.0 }.lobes_vjp(&d.lobes);
                let (base_color, roughness, metallic) = (s.base_color, s.roughness, s.metallic);
                (SampleGradient { base_color, roughness, metallic, ..SampleGradient::default() }, d.n)
            }
            Some(e) => {
                let on = CoatOn { transmits: false, rims: at.has_rims(sample.metallic) };
                let coat = coat_normal(&e, at, viewer, on, surface);
                let parameters = e.parameters(&sample, coat, self.energy, TransportMode::Radiance);
                let d = parameters.eval_vjp(wo, wi, g)?;
                let (base_color, roughness, metallic) = (d.base_color, d.roughness, d.metallic);
                (SampleGradient { base_color, roughness, metallic, ..SampleGradient::default() }, d.n)
            }
        };
        if library.has_normal_map(index) {
            out.normal = map_vjp(at, viewer, sample.normal, surface.to_render(n));
        }
        Some(out)
    }
}

/// Adjoint of the shading normal of a mapped surface with respect to the map's unit normal.
fn map_vjp(at: &Interaction, viewer: Vec3f, map: Vec3f, g: Vec3f) -> Vec3f {
    let tangent = at.tangent.xyz().normalize_or_zero();
    if tangent == Vec3f::zero() {
        return Vec3f::zero();
    }
    let normal = mapped(at, map);
    let n = face_viewer(normal, at.ng, viewer);
    let g = reflecting_upwards_vjp(n, at.facing(viewer), viewer, g);
    let g = face_viewer_vjp(normal, at.ng, viewer, g).normal;
    perturb_vjp(at.ns, tangent, at.tangent.w, map, g).map
}
