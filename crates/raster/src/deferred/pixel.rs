//! One pixel: interpolate, texture, normal map, shade; forward and adjoint.

use super::{Geometry, Masks, Passes, View};
use crate::interpolate::{derivatives, interpolate, interpolate_vjp};
use crate::maps::{CHANNELS, channel};
use crate::rasterize::{Barycentrics, PixelGrid, barycentrics, barycentrics_vjp};
use crate::texture::{Lookup, Pyramid, level_of_detail, lookup, sample, sample_vjp};
use photofit_scalar::{Real, Vec2, Vec3, Vec4, vec2, vec3};
use photofit_shading::{
    Surface, face_viewer, face_viewer_vjp, perturb, perturb_vjp, shade, shade_vjp, view_direction,
    view_direction_vjp,
};
use photofit_texture::{AlphaMode, Filter, Sampler, Wrap};

/// How the maps of a fitted mesh are read: its atlas is padded, so the border texel continues.
pub const SAMPLER: Sampler =
    Sampler { wrap_u: Wrap::ClampToEdge, wrap_v: Wrap::ClampToEdge, filter: Filter::Trilinear };

/// Interpolated vertex attributes: side by side, they fill whole vector registers.
const ATTRIBUTES: usize = 12;

/// Where each attribute starts.
pub(super) mod attribute {
    pub(crate) const POSITION: usize = 0;
    pub(crate) const NORMAL: usize = 3;
    pub(crate) const TANGENT: usize = 6;
    pub(crate) const UV: usize = 9;
}

/// The corners of one triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corners<T> {
    pub clip: [Vec4<T>; 3],
    attributes: [[T; ATTRIBUTES]; 3],
    handedness: T,
    geometric_normal: Vec3<T>,
    alpha: AlphaMode,
}

/// Gradients of the corners of one triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct CornerGradients<T> {
    pub clip: [Vec4<T>; 3],
    /// Those of uv are not used by anyone: the atlas is fixed.
    pub attributes: [[T; ATTRIBUTES]; 3],
}

impl<T: Real> Default for CornerGradients<T> {
    fn default() -> Self {
        Self { clip: [Vec4::zero(); 3], attributes: [[T::zero(); ATTRIBUTES]; 3] }
    }
}

impl<T: Real> Corners<T> {
    #[inline]
    pub(super) fn load(geometry: &Geometry<'_, T>, clip: &[Vec4<T>], triangle: usize) -> Self {
        let [i, j, k] = geometry.topology.triangles[triangle].map(|i| i as usize);
        let p = [geometry.positions[i], geometry.positions[j], geometry.positions[k]];
        let attributes = |i: usize| {
            let (p, n) = (geometry.positions[i], geometry.normals[i]);
            let (t, uv) = (geometry.tangents[i], geometry.uvs[i]);
            [p.x, p.y, p.z, n.x, n.y, n.z, t.x, t.y, t.z, uv.x, uv.y, T::zero()]
        };
        let id = [i, j, k];
        Self {
            clip: [clip[i], clip[j], clip[k]],
            attributes: [attributes(i), attributes(j), attributes(k)],
            handedness: geometry.tangents[id[0]].w,
            geometric_normal: (p[1] - p[0]).cross(p[2] - p[0]),
            alpha: geometry.alpha.get(triangle).copied().unwrap_or_default(),
        }
    }
}

/// Everything that a pixel computes on the way to its colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pixel<T> {
    b: Barycentrics<T>,
    at: Lookup<T>,
    texel: [T; CHANNELS],
    position: Vec3<T>,
    normal: Vec3<T>,
    tangent: Vec3<T>,
    perturbed: Vec3<T>,
    shading_normal: Vec3<T>,
    wo: Vec3<T>,
}

#[inline(always)]
fn refs<const C: usize, T>(a: &[[T; C]; 3]) -> [&[T; C]; 3] {
    [&a[0], &a[1], &a[2]]
}

#[inline(always)]
fn triple<T: Real>(t: &[T], at: usize) -> Vec3<T> {
    vec3(t[at], t[at + 1], t[at + 2])
}

/// The material of a texel.
#[inline(always)]
fn surface<T: Real>(t: &[T; CHANNELS]) -> Surface<T> {
    Surface {
        base_color: triple(t, channel::BASE_COLOR),
        roughness: t[channel::ROUGHNESS],
        metallic: t[channel::METALLIC],
        gamma: t[channel::GAMMA],
    }
}

/// The alpha that is blended with, for that of the map.
#[inline(always)]
fn drawn_alpha<T: Real>(alpha: T, mode: AlphaMode, masks: Masks) -> T {
    match (mode, masks) {
        (AlphaMode::Opaque, _) => T::one(),
        (AlphaMode::Blend, _) => alpha,
        (AlphaMode::Mask { cutoff }, Masks::Cut) if alpha >= T::of(f64::from(cutoff)) => T::one(),
        (AlphaMode::Mask { .. }, Masks::Cut) => T::zero(),
        (AlphaMode::Mask { cutoff }, Masks::Faded { slope }) => {
            faded(alpha, cutoff, slope).clamp_to(T::zero(), T::one())
        }
    }
}

/// Adjoint of [`drawn_alpha`] with respect to the map's alpha.
#[inline(always)]
fn drawn_alpha_vjp<T: Real>(alpha: T, mode: AlphaMode, masks: Masks, g: T) -> T {
    match (mode, masks) {
        (AlphaMode::Blend, _) => g,
        (AlphaMode::Mask { cutoff }, Masks::Faded { slope }) => {
            // The ends belong to the range that moves: with a slope of 1 no alpha in [0, 1] is stuck.
            let f = faded(alpha, cutoff, slope);
            if f >= T::zero() && f <= T::one() { g * T::of(f64::from(slope)) } else { T::zero() }
        }
        (AlphaMode::Opaque | AlphaMode::Mask { .. }, _) => T::zero(),
    }
}

/// [`Masks::Faded`] before it is clamped.
#[inline(always)]
fn faded<T: Real>(alpha: T, cutoff: f32, slope: f32) -> T {
    T::of(0.5) + T::of(f64::from(slope)) * (alpha - T::of(f64::from(cutoff)))
}

impl<T: Real> Pixel<T> {
    /// Runs the stages up to the shading normal.
    #[inline(always)]
    pub(super) fn new(
        c: &Corners<T>,
        f: Vec2<T>,
        grid: &PixelGrid<T>,
        maps: &Pyramid<T, CHANNELS>,
        view: &View<'_, T>,
        passes: &Passes,
    ) -> Self {
        let b = barycentrics(&c.clip, f, grid);
        let a = interpolate(refs(&c.attributes), &b);
        let uv = vec2(a[attribute::UV], a[attribute::UV + 1]);
        let corner_uv = |k: usize| [c.attributes[k][attribute::UV], c.attributes[k][attribute::UV + 1]];
        let duv = derivatives([&corner_uv(0), &corner_uv(1), &corner_uv(2)], &b);
        let base = &maps.levels[0];
        let lod = level_of_detail(&duv, base.width, base.height, view.lod_bias, maps.levels.len() - 1);
        let at = lookup(maps, uv, Some(&lod), &SAMPLER);
        let texel = sample(maps, &at);
        let position = triple(&a, attribute::POSITION);
        let (normal, tangent) = (triple(&a, attribute::NORMAL), triple(&a, attribute::TANGENT));
        let perturbed = if passes.normal_map {
            perturb(normal, tangent, c.handedness, triple(&texel, channel::NORMAL))
        } else {
            normal.normalize_or_zero()
        };
        let wo = view_direction(view.eye, position);
        let shading_normal = face_viewer(perturbed, c.geometric_normal, wo);
        Self { b, at, texel, position, normal, tangent, perturbed, shading_normal, wo }
    }

    /// Radiance and alpha.
    #[inline(always)]
    pub(super) fn color(&self, c: &Corners<T>, view: &View<'_, T>, passes: &Passes) -> [T; 4] {
        let s = surface(&self.texel);
        let mut rgb = shade(&s, passes.energy, self.position, self.shading_normal, self.wo, view.lights);
        if passes.emissive {
            rgb += triple(&self.texel, channel::EMISSIVE);
        }
        [rgb.x, rgb.y, rgb.z, drawn_alpha(self.texel[channel::ALPHA], c.alpha, passes.masks)]
    }

    /// Adjoint of the whole pixel for the gradient `g` of radiance and alpha. Returns the lookup and the gradient of
    /// the texel; corner gradients are accumulated if positions are optimised.
    #[inline(always)]
    pub(super) fn vjp(
        &self,
        c: &Corners<T>,
        f: Vec2<T>,
        maps: &Pyramid<T, CHANNELS>,
        view: &View<'_, T>,
        passes: &Passes,
        g: &[T; 4],
        out: &mut CornerGradients<T>,
    ) -> (Lookup<T>, [T; CHANNELS]) {
        let s = surface(&self.texel);
        let g_rgb = vec3(g[0], g[1], g[2]);
        let sg =
            shade_vjp(&s, passes.energy, self.position, self.shading_normal, self.wo, view.lights, g_rgb);
        let mut g_texel = [T::zero(); CHANNELS];
        g_texel[..3].copy_from_slice(&sg.surface.base_color.to_array());
        g_texel[channel::ROUGHNESS] = sg.surface.roughness;
        g_texel[channel::METALLIC] = sg.surface.metallic;
        g_texel[channel::GAMMA] = sg.surface.gamma;
        if passes.emissive {
            g_texel[channel::EMISSIVE..channel::EMISSIVE + 3].copy_from_slice(&g_rgb.to_array());
        }
        if passes.alpha_gradients {
            let alpha = self.texel[channel::ALPHA];
            g_texel[channel::ALPHA] = drawn_alpha_vjp(alpha, c.alpha, passes.masks, g[3]);
        }
        let fv = face_viewer_vjp(self.perturbed, c.geometric_normal, self.wo, sg.n);
        let (g_normal, g_tangent) = if passes.normal_map {
            let map = triple(&self.texel, channel::NORMAL);
            let p = perturb_vjp(self.normal, self.tangent, c.handedness, map, fv.normal);
            g_texel[channel::NORMAL..channel::NORMAL + 3].copy_from_slice(&p.map.to_array());
            (p.normal, p.tangent)
        } else {
            (self.normal.normalize_vjp(fv.normal), Vec3::zero())
        };
        if passes.position_gradients {
            let g_position = sg.position + view_direction_vjp(view.eye, self.position, sg.wo + fv.wo);
            let (g_uv, _) = sample_vjp(maps, &self.at, &g_texel);
            let (p, n, t) = (g_position, g_normal, g_tangent);
            let g = [p.x, p.y, p.z, n.x, n.y, n.z, t.x, t.y, t.z, g_uv.x, g_uv.y, T::zero()];
            let [a0, a1, a2] = &mut out.attributes;
            let g_uvw = interpolate_vjp(refs(&c.attributes), &self.b, &g, [a0, a1, a2]);
            let g_clip = barycentrics_vjp(&c.clip, f, g_uvw.x, g_uvw.y);
            for k in 0..3 {
                out.clip[k] += g_clip[k];
            }
        }
        (self.at, g_texel)
    }
}
