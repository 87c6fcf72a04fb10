//! A packet of samples that are shaded side by side, stage by stage: interpolate, texture, normal map, shade; forward and
//! adjoint.
//!
//! Every number of a sample stands in a row of its own, one entry per lane: stages are loops over the lanes without
//! branches or calls, which the compiler turns into vector instructions. Texels are read and gathered lane by lane, all
//! channels at once. Lanes past the end hold numbers of earlier samples, which nobody reads.

mod light;

use super::alpha::{drawn_alpha, drawn_alpha_vjp};
use super::{Geometry, Passes, View};
use crate::interpolate::{slope, value, value_vjp, weights};
use crate::maps::{CHANNELS, channel};
use crate::rasterize::{PixelGrid, barycentrics, barycentrics_vjp};
use crate::texture::{LevelOfDetail, Lookup, Pyramid, Taps, level_of_detail, lookup, sample, sample_vjp};
use photofit_scalar::{Real, Vec3, Vec4, vec2, vec3, vec4};
use photofit_shading::{
    Surface, face_viewer, face_viewer_vjp, perturb, perturb_vjp, view_direction, view_direction_vjp,
};
use photofit_texture::{AlphaMode, Filter, Sampler, Wrap};

/// How the maps of a fitted mesh are read: its atlas is padded, so the border texel continues.
pub const SAMPLER: Sampler =
    Sampler { wrap_u: Wrap::ClampToEdge, wrap_v: Wrap::ClampToEdge, filter: Filter::Trilinear };

/// Samples of a packet.
pub(super) const LANES: usize = 32;
/// Lanes that are written at once where samples of a triangle stand side by side; those too many are written again.
const STEP: usize = 8;

/// A number of every lane.
type Row<T> = [T; LANES + STEP];
/// Numbers of every lane.
type Rows<T, const R: usize> = [Row<T>; R];

/// Components of vertex attributes: position, normal and tangent, then uv.
const ATTRIBUTES: usize = 11;
/// Where each attribute starts.
pub(super) const POSITION: usize = 0;
pub(super) const NORMAL: usize = 3;
pub(super) const TANGENT: usize = 6;
const UV: usize = 9;
/// Room for the gradients of a lane side by side.
const WIDTH: usize = 16;
/// Components that have gradients for the vertices: those of uv are not used by anyone, the atlas is fixed.
const FITTED: usize = 9;

/// Gradients of the corners of one triangle: x, y and w in clip space, corner by corner, and room.
pub(super) type ClipGradient<T> = [T; WIDTH];
/// Gradients of position, normal and tangent of the three corners, and room.
pub(super) type AttributeGradient<T> = [[T; WIDTH]; 3];

/// The samples of a triangle in a packet.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Segment {
    pub triangle: u32,
    pub first: usize,
    pub end: usize,
}

/// What a stage needs of the whole picture.
pub(super) struct Scene<'a, T> {
    pub view: &'a View<'a, T>,
    pub passes: &'a Passes,
    pub maps: &'a Pyramid<T, CHANNELS>,
    /// The grid by whose cells texture footprints are measured.
    pub footprint: PixelGrid<T>,
}

impl<T> Scene<'_, T> {
    /// Whether light falls on the surfaces: else normals, tangents and directions do not matter.
    #[inline(always)]
    fn is_lit(&self) -> bool {
        !self.view.lights.is_empty()
    }
}

/// The lanes.
pub(super) struct Packet<T> {
    /// Lanes in use.
    pub len: usize,
    /// Triangles in use.
    segments: usize,
    segment: [Segment; LANES],
    /// Normalized device coordinates.
    pub f: Rows<T, 2>,
    /// Gradient of radiance and alpha.
    pub g: Rows<T, 4>,
    /// Radiance.
    rgb: Rows<T, 3>,
    /// Of the triangle: x, y and w of the corners in clip space, and the attributes of the corners.
    clip: Rows<T, 9>,
    corners: [Rows<T, 3>; ATTRIBUTES],
    handedness: Row<T>,
    alpha: [AlphaMode; LANES],
    /// Barycentrics, uv and level of detail.
    weights: Rows<T, 2>,
    uv: Rows<T, 2>,
    level: Row<T>,
    at: [Lookup<T>; LANES],
    texel: Rows<T, { channel::USED }>,
    /// Interpolated position, normal and tangent.
    surface: Rows<T, FITTED>,
    perturbed: Rows<T, 3>,
    normal: Rows<T, 3>,
    wo: Rows<T, 3>,
    /// [`SplitSum`] of the viewer.
    viewer: Rows<T, 6>,
    /// Gradients of the texel, of the shading normal, of the direction to the viewer, and of the interpolated attributes.
    g_texel: Rows<T, { channel::USED }>,
    g_normal: Rows<T, 3>,
    g_wo: Rows<T, 3>,
    g_attributes: Rows<T, ATTRIBUTES>,
    g_clip: Rows<T, 9>,
    /// Texels lane by lane, or their gradients.
    by_lane: [[T; CHANNELS]; LANES],
}

/// Fills lanes from `at` on.
#[inline(always)]
fn put<T: Real>(row: &mut Row<T>, at: usize, x: T) {
    for lane in &mut row[at..at + STEP] {
        *lane = x;
    }
}

/// Three rows at a lane.
#[inline(always)]
fn triple<T: Real, const R: usize>(rows: &Rows<T, R>, at: usize, lane: usize) -> Vec3<T> {
    vec3(rows[at][lane], rows[at + 1][lane], rows[at + 2][lane])
}

#[inline(always)]
fn set<T: Real, const R: usize>(rows: &mut Rows<T, R>, at: usize, lane: usize, v: Vec3<T>) {
    (rows[at][lane], rows[at + 1][lane], rows[at + 2][lane]) = (v.x, v.y, v.z);
}

#[inline(always)]
fn add<T: Real, const R: usize>(rows: &mut Rows<T, R>, at: usize, lane: usize, v: Vec3<T>) {
    rows[at][lane] += v.x;
    rows[at + 1][lane] += v.y;
    rows[at + 2][lane] += v.z;
}

/// An attribute of the three corners at a lane.
#[inline(always)]
fn corners_at<T: Real>([p, q, r]: &Rows<T, 3>, lane: usize) -> [T; 3] {
    [p[lane], q[lane], r[lane]]
}

/// The material of a texel.
#[inline(always)]
fn surface<T: Real>(t: &Rows<T, { channel::USED }>, lane: usize) -> Surface<T> {
    Surface {
        base_color: triple(t, channel::BASE_COLOR, lane),
        roughness: t[channel::ROUGHNESS][lane],
        metallic: t[channel::METALLIC][lane],
        gamma: t[channel::SPECULAR_SUPPRESSION][lane],
    }
}

impl<T: Real> Packet<T> {
    /// Without samples.
    pub(super) fn new() -> Self {
        let zero = [T::zero(); LANES + STEP];
        let taps = Taps { index: [0; 4], fx: T::zero(), fy: T::zero() };
        Self {
            len: 0,
            segments: 0,
            segment: [Segment::default(); LANES],
            f: [zero; 2],
            g: [zero; 4],
            rgb: [zero; 3],
            clip: [zero; 9],
            corners: [[zero; 3]; ATTRIBUTES],
            handedness: zero,
            alpha: [AlphaMode::Opaque; LANES],
            weights: [zero; 2],
            uv: [zero; 2],
            level: zero,
            at: [Lookup { level: 0, fine: taps, coarse: None }; LANES],
            texel: [zero; channel::USED],
            surface: [zero; FITTED],
            perturbed: [zero; 3],
            normal: [zero; 3],
            wo: [zero; 3],
            viewer: [zero; 6],
            g_texel: [zero; channel::USED],
            g_normal: [zero; 3],
            g_wo: [zero; 3],
            g_attributes: [zero; ATTRIBUTES],
            g_clip: [zero; 9],
            by_lane: [[T::zero(); CHANNELS]; LANES],
        }
    }

    /// Forgets all samples.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        (self.len, self.segments) = (0, 0);
    }

    /// The triangles of the packet with their lanes.
    #[inline(always)]
    fn segments(&self) -> &[Segment] {
        &self.segment[..self.segments]
    }

    /// Gives the lanes from `first` to the end to a triangle.
    #[inline(always)]
    pub(super) fn cover(
        &mut self,
        geometry: &Geometry<'_, T>,
        clip: &[Vec4<T>],
        is_lit: bool,
        triangle: u32,
        first: usize,
    ) {
        let end = self.len;
        assert!(end <= LANES, "a packet has {LANES} lanes");
        if first == end {
            return;
        }
        self.segment[self.segments] = Segment { triangle, first, end };
        self.segments += 1;
        let [i, j, k] = geometry.topology.triangles[triangle as usize];
        let [i, j, k] = [i as usize, j as usize, k as usize];
        let (p, uv) = ([clip[i], clip[j], clip[k]], [geometry.uvs[i], geometry.uvs[j], geometry.uvs[k]]);
        let clip = [p[0].x, p[0].y, p[0].w, p[1].x, p[1].y, p[1].w, p[2].x, p[2].y, p[2].w];
        for at in (first..end).step_by(STEP) {
            for k in 0..9 {
                put(&mut self.clip[k], at, clip[k]);
            }
            for k in 0..3 {
                put(&mut self.corners[UV][k], at, uv[k].x);
                put(&mut self.corners[UV + 1][k], at, uv[k].y);
            }
        }
        if let Some(alpha) = geometry.alpha.get(triangle as usize) {
            self.alpha[first..end].fill(*alpha);
        }
        if !is_lit {
            return;
        }
        let of = |i: usize| {
            let (p, n, t) = (geometry.positions[i], geometry.normals[i], geometry.tangents[i]);
            [p.x, p.y, p.z, n.x, n.y, n.z, t.x, t.y, t.z]
        };
        let vectors = [of(i), of(j), of(k)];
        let handedness = geometry.tangents[i].w;
        for at in (first..end).step_by(STEP) {
            put(&mut self.handedness, at, handedness);
            for c in 0..FITTED {
                for k in 0..3 {
                    put(&mut self.corners[c][k], at, vectors[k][c]);
                }
            }
        }
    }

    /// The corners in clip space, whose z does not matter.
    #[inline(always)]
    fn clip_at(&self, lane: usize) -> [Vec4<T>; 3] {
        let c = &self.clip;
        let corner = |k: usize| vec4(c[k][lane], c[k + 1][lane], T::zero(), c[k + 2][lane]);
        [corner(0), corner(3), corner(6)]
    }

    /// Radiance and alpha of all lanes; [`Self::color`] reads them.
    #[inline(always)]
    pub(super) fn shade(&mut self, scene: &Scene<'_, T>) {
        self.locate(scene);
        self.read(scene);
        if scene.is_lit() {
            self.orient(scene);
            self.light(scene);
        } else {
            self.rgb = [[T::zero(); LANES + STEP]; 3];
        }
        if scene.passes.emissive {
            for lane in 0..LANES {
                let emitted = triple(&self.texel, channel::EMISSIVE, lane);
                add(&mut self.rgb, 0, lane, emitted);
            }
        }
    }

    /// Radiance and alpha of a lane.
    #[inline(always)]
    pub(super) fn color(&self, scene: &Scene<'_, T>, lane: usize) -> [T; 4] {
        let alpha = drawn_alpha(self.texel[channel::ALPHA][lane], self.alpha[lane], scene.passes.masks);
        [self.rgb[0][lane], self.rgb[1][lane], self.rgb[2][lane], alpha]
    }

    /// Barycentrics, uv and level of detail.
    #[inline(always)]
    fn locate(&mut self, scene: &Scene<'_, T>) {
        let base = &scene.maps.levels[0];
        let (width, height, max) = (base.width, base.height, scene.maps.levels.len() - 1);
        let (footprint, bias) = (scene.footprint, scene.view.lod_bias);
        for lane in 0..LANES {
            let f = vec2(self.f[0][lane], self.f[1][lane]);
            let b = barycentrics(&self.clip_at(lane), f, &footprint);
            let of = |corners: &Rows<T, 3>| {
                let a = corners_at(corners, lane);
                (value(a, b.u, b.v), slope(a, &b))
            };
            let ((u, du), (v, dv)) = (of(&self.corners[UV]), of(&self.corners[UV + 1]));
            let level = level_of_detail(&[du, dv], width, height, bias, max).level;
            (self.weights[0][lane], self.weights[1][lane]) = (b.u, b.v);
            (self.uv[0][lane], self.uv[1][lane]) = (u, v);
            self.level[lane] = level;
        }
    }

    /// Where the lanes read the maps.
    #[inline(always)]
    fn look_up(&mut self, scene: &Scene<'_, T>) {
        for lane in 0..self.len {
            let level = LevelOfDetail { level: self.level[lane] };
            let uv = vec2(self.uv[0][lane], self.uv[1][lane]);
            self.at[lane] = lookup(scene.maps, uv, Some(&level), &SAMPLER);
        }
    }

    /// The texels.
    #[inline(always)]
    fn read(&mut self, scene: &Scene<'_, T>) {
        self.look_up(scene);
        for lane in 0..self.len {
            self.by_lane[lane] = sample(scene.maps, &self.at[lane]);
        }
        let mut gather = |from: usize, end: usize| {
            for lane in 0..self.len {
                for c in from..end {
                    self.texel[c][lane] = self.by_lane[lane][c];
                }
            }
        };
        if scene.is_lit() {
            gather(0, channel::USED);
        } else {
            gather(channel::ALPHA, channel::ALPHA + 1);
            gather(channel::EMISSIVE, channel::EMISSIVE + 3);
        }
    }

    /// Positions, normals and directions to the viewer.
    #[inline(always)]
    fn orient(&mut self, scene: &Scene<'_, T>) {
        for c in 0..FITTED {
            for lane in 0..LANES {
                let (u, v) = (self.weights[0][lane], self.weights[1][lane]);
                self.surface[c][lane] = value(corners_at(&self.corners[c], lane), u, v);
            }
        }
        if scene.passes.normal_map {
            for lane in 0..LANES {
                let (n, t) = (triple(&self.surface, NORMAL, lane), triple(&self.surface, TANGENT, lane));
                let map = triple(&self.texel, channel::NORMAL, lane);
                set(&mut self.perturbed, 0, lane, perturb(n, t, self.handedness[lane], map));
            }
        } else {
            for lane in 0..LANES {
                let n = triple(&self.surface, NORMAL, lane);
                set(&mut self.perturbed, 0, lane, n.normalize_or_zero());
            }
        }
        let eye = scene.view.eye;
        for lane in 0..LANES {
            let wo = view_direction(eye, triple(&self.surface, POSITION, lane));
            let n = face_viewer(triple(&self.perturbed, 0, lane), self.geometric_normal(lane), wo);
            set(&mut self.wo, 0, lane, wo);
            set(&mut self.normal, 0, lane, n);
        }
    }

    #[inline(always)]
    fn geometric_normal(&self, lane: usize) -> Vec3<T> {
        let corner = |k: usize| {
            let row = |c: usize| self.corners[POSITION + c][k][lane];
            vec3(row(0), row(1), row(2))
        };
        (corner(1) - corner(0)).cross(corner(2) - corner(0))
    }

    /// Where the lanes read the maps, and the gradients of what they read.
    #[inline(always)]
    pub(super) fn lookups(&self) -> (&[Lookup<T>], &[[T; CHANNELS]]) {
        (&self.at[..self.len], &self.by_lane[..self.len])
    }

    /// Adjoint of [`Self::shade`] and [`Self::color`] for the gradients in `g`, from the places of the samples alone:
    /// [`Self::lookups`] gives what the maps take, [`Self::reduce`] sums up what the corners take. `transparent`: alpha
    /// counts.
    #[inline(always)]
    pub(super) fn shade_vjp(&mut self, scene: &Scene<'_, T>, transparent: bool) {
        let (is_lit, passes) = (scene.is_lit(), scene.passes);
        let reads = is_lit || transparent;
        self.locate(scene);
        if reads {
            self.read(scene);
            self.g_texel[..channel::EMISSIVE].fill([T::zero(); LANES + STEP]);
        } else {
            self.look_up(scene);
        }
        if passes.emissive {
            self.g_texel[channel::EMISSIVE..][..3].copy_from_slice(&self.g[..3]);
        } else {
            self.g_texel[channel::EMISSIVE..][..3].fill([T::zero(); LANES + STEP]);
        }
        if transparent && passes.alpha_gradients {
            for lane in 0..self.len {
                let alpha = self.texel[channel::ALPHA][lane];
                self.g_texel[channel::ALPHA][lane] =
                    drawn_alpha_vjp(alpha, self.alpha[lane], passes.masks, self.g[3][lane]);
            }
        }
        if is_lit {
            self.orient(scene);
            self.light_vjp(scene);
            self.orient_vjp(scene);
        }
        self.spread(if reads { 0 } else { channel::EMISSIVE });
        if passes.position_gradients {
            for lane in 0..self.len {
                let (g_uv, _) = sample_vjp(scene.maps, &self.at[lane], &self.by_lane[lane]);
                (self.g_attributes[UV][lane], self.g_attributes[UV + 1][lane]) = (g_uv.x, g_uv.y);
            }
            self.locate_vjp(if is_lit { 0 } else { UV });
        }
    }

    /// Writes the gradients of the texels lane by lane: those of the channels from `first` on; the others have
    /// none.
    #[inline(always)]
    fn spread(&mut self, first: usize) {
        for lane in 0..self.len {
            self.by_lane[lane] = [T::zero(); CHANNELS];
        }
        for lane in 0..self.len {
            for c in first..channel::USED {
                self.by_lane[lane][c] = self.g_texel[c][lane];
            }
        }
    }

    /// Adjoint of [`Self::orient`].
    #[inline(always)]
    fn orient_vjp(&mut self, scene: &Scene<'_, T>) {
        let eye = scene.view.eye;
        for lane in 0..LANES {
            let (n, wo) = (triple(&self.perturbed, 0, lane), triple(&self.wo, 0, lane));
            let g = triple(&self.g_normal, 0, lane);
            let d = face_viewer_vjp(n, self.geometric_normal(lane), wo, g);
            let position = triple(&self.surface, POSITION, lane);
            let g_wo = triple(&self.g_wo, 0, lane) + d.wo;
            add(&mut self.g_attributes, POSITION, lane, view_direction_vjp(eye, position, g_wo));
            set(&mut self.g_normal, 0, lane, d.normal);
        }
        if scene.passes.normal_map {
            for lane in 0..LANES {
                let (n, t) = (triple(&self.surface, NORMAL, lane), triple(&self.surface, TANGENT, lane));
                let map = triple(&self.texel, channel::NORMAL, lane);
                let d = perturb_vjp(n, t, self.handedness[lane], map, triple(&self.g_normal, 0, lane));
                set(&mut self.g_texel, channel::NORMAL, lane, d.map);
                set(&mut self.g_attributes, NORMAL, lane, d.normal);
                set(&mut self.g_attributes, TANGENT, lane, d.tangent);
            }
        } else {
            for lane in 0..LANES {
                let n = triple(&self.surface, NORMAL, lane);
                let g = n.normalize_vjp(triple(&self.g_normal, 0, lane));
                set(&mut self.g_attributes, NORMAL, lane, g);
                set(&mut self.g_attributes, TANGENT, lane, Vec3::zero());
            }
        }
    }

    /// Adjoint of the interpolation of the attributes from number `first` on with respect to the corners in clip space.
    #[inline(always)]
    fn locate_vjp(&mut self, first: usize) {
        let mut g_weights: Rows<T, 2> = [[T::zero(); LANES + STEP]; 2];
        for c in first..ATTRIBUTES {
            for lane in 0..LANES {
                let [u, v] = value_vjp(corners_at(&self.corners[c], lane), self.g_attributes[c][lane]);
                g_weights[0][lane] += u;
                g_weights[1][lane] += v;
            }
        }
        for lane in 0..LANES {
            let f = vec2(self.f[0][lane], self.f[1][lane]);
            let g = barycentrics_vjp(&self.clip_at(lane), f, g_weights[0][lane], g_weights[1][lane]);
            for k in 0..3 {
                set(&mut self.g_clip, 3 * k, lane, vec3(g[k].x, g[k].y, g[k].w));
            }
        }
    }

    /// Adds the sums of the gradients of corners, triangle by triangle; attributes have some where light falls on them.
    #[inline(always)]
    pub(super) fn reduce(
        &self,
        is_lit: bool,
        clips: &mut Vec<(u32, ClipGradient<T>)>,
        attributes: &mut Vec<AttributeGradient<T>>,
    ) {
        // Lane by lane side by side, so that sums are vectors.
        let mut clip = [[T::zero(); WIDTH]; LANES];
        for lane in 0..self.len {
            for k in 0..9 {
                clip[lane][k] = self.g_clip[k][lane];
            }
        }
        for s in self.segments() {
            let mut sum = [T::zero(); WIDTH];
            for g in &clip[s.first..s.end] {
                for k in 0..WIDTH {
                    sum[k] += g[k];
                }
            }
            clips.push((s.triangle, sum));
        }
        if is_lit {
            self.reduce_attributes(attributes);
        }
    }

    #[inline(always)]
    fn reduce_attributes(&self, attributes: &mut Vec<AttributeGradient<T>>) {
        let mut by_lane = [[T::zero(); WIDTH]; LANES];
        for lane in 0..self.len {
            for c in 0..FITTED {
                by_lane[lane][c] = self.g_attributes[c][lane];
            }
        }
        for s in self.segments() {
            let mut sum = [[T::zero(); WIDTH]; 3];
            for lane in s.first..s.end {
                let weights = weights(self.weights[0][lane], self.weights[1][lane]);
                for k in 0..3 {
                    for c in 0..WIDTH {
                        sum[k][c] += weights[k] * by_lane[lane][c];
                    }
                }
            }
            attributes.push(sum);
        }
    }
}

#[cfg(test)]
mod tests;
