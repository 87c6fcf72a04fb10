//! Emitting surfaces: triangles, parallelograms and spheres.

use super::patch::{Patch, Receiver};
use super::{End, LightOrigin, LightSample, luminance};
use crate::PathtraceError;
use crate::error::invalid;
use crate::world::{Interaction, Kind, Placed, World, WorldHit, WorldRay, from_glam, to_glam};
use photofit_sampling::{uniform_sphere, uniform_triangle};
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::MapKind;
use std::f32::consts::PI;

/// Points of a triangle at which emission that varies is looked at, to estimate its power.
const PROBES: u32 = 32;
/// Share of the choice among the triangles of an instance whose emission varies that goes by area: light that the probes of
/// a triangle miss is found, too.
const EVEN_SHARE: f64 = 0.02;

/// A sphere, triangle or parallelogram that emits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Emitter {
    instance: u32,
    piece: u32,
    /// Area in the render frame; that of triangles only.
    area: f32,
    both_sides: bool,
    /// Where it lies, if it is flat and emits evenly.
    patch: Option<Patch>,
}

/// The emitters of a world.
#[derive(Debug, Default)]
pub(crate) struct Emitters {
    pub(crate) list: Vec<Emitter>,
    /// Their powers.
    pub(crate) weights: Vec<f32>,
    /// Which of them each piece of each emitting instance belongs to.
    pub(crate) of_piece: Vec<u32>,
}

/// The emitters of all instances; instances learn where their pieces begin. Two triangles in a row that make up a
/// parallelogram are one.
pub(crate) fn collect(world: &mut World) -> Result<Emitters, PathtraceError> {
    let mut out = Emitters::default();
    for i in 0..world.placed.len() {
        let material = &world.materials[world.placed[i].material as usize];
        let kind = &world.shapes[world.placed[i].shape as usize].kind;
        // Points of grids cannot be chosen evenly: what they emit is found by scattering.
        if !material.emits || matches!(kind, Kind::DistanceGrid { .. }) {
            world.placed[i].emitter = Placed::DARK;
            continue;
        }
        let (both_sides, even) = (material.both_sides, !material.varies);
        let pieces = world.shapes[world.placed[i].shape as usize].pieces();
        if out.of_piece.len() + pieces > u32::MAX as usize {
            return Err(invalid(
                format!("instance {i}"),
                "the emitting triangles up to here are too many; there may be 2^32 - 1",
            ));
        }
        world.placed[i].emitter = out.of_piece.len() as u32;
        let first = out.list.len();
        let (mut piece, pieces) = (0, pieces as u32);
        while piece < pieces {
            let patch = if even { patch(world, i as u32, piece, pieces) } else { None };
            let area = patch.map_or_else(|| area(world, &world.placed[i], piece), |p| p.area);
            let power = area * emission(world, i as u32, piece) * if both_sides { 2.0 * PI } else { PI };
            let index = out.list.len() as u32;
            out.list.push(Emitter { instance: i as u32, piece, area, both_sides, patch });
            out.weights.push(if power.is_finite() { power } else { 0.0 });
            let covered = if patch.is_some_and(|p| !p.triangle) { 2 } else { 1 };
            out.of_piece.extend((0..covered).map(|_| index));
            piece += covered;
        }
        if !even {
            share_evenly(world, &out.list[first..], &mut out.weights[first..]);
        }
    }
    Ok(out)
}

/// Lets a share of the power of an instance, whose emitters these are, count by area: all of it where no probe met light.
fn share_evenly(world: &World, list: &[Emitter], weights: &mut [f32]) {
    let area: f64 = list.iter().map(|e| f64::from(e.area)).sum();
    let Some(emitter) = list.first().filter(|_| area > 0.0) else { return };
    let found: f64 = weights.iter().map(|w| f64::from(*w)).sum();
    let sides = if emitter.both_sides { 2.0 } else { 1.0 };
    let (power, share) = match found > 0.0 {
        true => (found, EVEN_SHARE),
        false => (sides * std::f64::consts::PI * area * mean_emission(world, emitter.instance), 1.0),
    };
    for (weight, emitter) in weights.iter_mut().zip(list) {
        let own = f64::from(*weight);
        let mixed = own + share * (power * (f64::from(emitter.area) / area) - own);
        // Powers beyond the largest number count as it.
        *weight = mixed.min(f64::from(f32::MAX)) as f32;
    }
}

/// Mean luminance of what a material emits over all texels of its texture; the largest of a tree.
fn mean_emission(world: &World, instance: u32) -> f64 {
    let material = &world.materials[world.placed[instance as usize].material as usize];
    let map = match (material.library, &world.library) {
        (Some(index), Some(library)) => library.texture_of(index, MapKind::Emissive).map(|texture| {
            let [r, g, b, _] = library.texture(texture).mean().map(|v| v as f32);
            luminance(library.factors(index).emissive.mul(vec3(r, g, b)))
        }),
        _ => None,
    };
    let tree = material.graph.as_ref().and_then(|g| g.emission.as_ref());
    f64::from(map.or_else(|| tree?.largest().map(luminance)).unwrap_or(1.0))
}

/// The parallelogram that a triangle makes up with the next one, or else the triangle; `None` for spheres.
fn patch(world: &World, instance: u32, piece: u32, pieces: u32) -> Option<Patch> {
    let placed = &world.placed[instance as usize];
    let own = corners(world, placed, piece)?;
    // The points with the largest coordinates are corners.
    let ends = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]].map(|u| surface_point(world, instance, piece, u));
    let rounding = ends.iter().map(|e| e.rounding).fold(0.0, f32::max);
    let next = if piece + 1 < pieces { corners(world, placed, piece + 1) } else { None };
    let whole = next.and_then(|next| parallelogram(own, next, rounding));
    Some(match whole {
        Some(whole) => Patch::new(whole, false, ends[0].ng, rounding),
        None => Patch::new(own, true, ends[0].ng, rounding),
    })
}

/// A corner of the parallelogram of two triangles that turn the same way, and its neighbours; `None` where they make up
/// none to within `rounding`.
fn parallelogram(own: [Vec3f; 3], next: [Vec3f; 3], rounding: f32) -> Option<[Vec3f; 3]> {
    for i in 0..3 {
        // The diagonal is the edge from `b` to `c`.
        let [a, b, c] = [own[i], own[(i + 1) % 3], own[(i + 2) % 3]];
        for j in 0..3 {
            let shared = next[(j + 1) % 3] == c && next[(j + 2) % 3] == b;
            if shared && (a + next[j] - b - c).length() <= rounding {
                return Some([a, b, c]);
            }
        }
    }
    None
}

/// Corners of a triangle in the render frame.
#[inline(always)]
fn corners(world: &World, placed: &Placed, piece: u32) -> Option<[Vec3f; 3]> {
    match &world.shapes[placed.shape as usize].kind {
        Kind::Mesh(mesh) => Some(mesh.corners(piece as usize).map(|p| placed.point(p))),
        Kind::Sphere { .. } | Kind::DistanceGrid { .. } => None,
    }
}

fn area(world: &World, placed: &Placed, piece: u32) -> f32 {
    match corners(world, placed, piece) {
        Some([a, b, c]) => {
            let [a, b, c] = [a, b, c].map(Vec3f::cast::<f64>);
            (0.5 * (b - a).cross(c - a).length()) as f32
        }
        None => {
            // Of the ellipsoid by its mean stretch: for the choice of lights only.
            let Kind::Sphere { radius } = world.shapes[placed.shape as usize].kind else { return 0.0 };
            let scale = placed.to_render.matrix3.determinant().abs().powf(2.0 / 3.0);
            4.0 * PI * radius * radius * scale
        }
    }
}

/// Mean luminance of the emission of a piece.
fn emission(world: &World, instance: u32, piece: u32) -> f32 {
    let placed = &world.placed[instance as usize];
    let material = &world.materials[placed.material as usize];
    if !material.varies || material.unlit {
        return luminance(material.emission);
    }
    let mut sum = 0.0;
    for i in 0..PROBES {
        // The points of Roberts' sequence, in the same places of every triangle.
        let (a, b) = (0.754_877_7 * (i as f32 + 0.5), 0.569_840_3 * (i as f32 + 0.5));
        let at = surface_point(world, instance, piece, [a.fract(), b.fract()]);
        let wo = at.ng;
        sum += luminance(world.material_at::<true>(&at, wo, &mut None).emission);
    }
    sum / PROBES as f32
}

/// The point of a triangle for two random numbers, seen from its front.
fn surface_point(world: &World, instance: u32, piece: u32, u: [f32; 2]) -> Interaction {
    let [_, v, w] = uniform_triangle(u);
    let hit = WorldHit { t: 0.0, u: v, v: w, instance, piece, front: true };
    let ray = WorldRay { origin: Vec3f::zero(), direction: vec3(0.0, 0.0, -1.0), t_max: 0.0 };
    world.interaction::<true>(&ray, &hit)
}

impl Emitter {
    /// A point of the emitter as seen by `from`.
    #[inline]
    pub(crate) fn sample(&self, world: &World, from: &Receiver, u: [f32; 2]) -> Option<LightSample> {
        if let Some(patch) = &self.patch {
            return self.sample_patch(patch, world, from, u);
        }
        let placed = &world.placed[self.instance as usize];
        let p = from.p;
        if let Kind::Sphere { radius } = world.shapes[placed.shape as usize].kind {
            return self.sample_sphere(world, radius, p, u);
        }
        let [_, bu, bv] = uniform_triangle(u);
        let mut hit =
            WorldHit { t: 0.0, u: bu, v: bv, instance: self.instance, piece: self.piece, front: true };
        let ray = WorldRay { origin: p, direction: vec3(0.0, 0.0, -1.0), t_max: 0.0 };
        let mut at = world.interaction::<true>(&ray, &hit);
        let (wi, distance) = direction(p, at.p)?;
        let cosine = -wi.dot(at.ng);
        hit.front = cosine > 0.0;
        at.front = hit.front;
        if !hit.front && !self.both_sides {
            return None;
        }
        let pdf = distance * distance / (cosine.abs() * self.area);
        self.seen(world, &at, wi, pdf)
    }

    /// As [`Self::sample`] of what is flat and emits evenly.
    #[inline(always)]
    fn sample_patch(
        &self,
        patch: &Patch,
        world: &World,
        from: &Receiver,
        u: [f32; 2],
    ) -> Option<LightSample> {
        if !self.both_sides && patch.is_behind(from.p) {
            return None;
        }
        let (at, density) = patch.sample(from, u)?;
        let (wi, distance) = direction(from.p, at)?;
        let cosine = -wi.dot(patch.ng);
        if cosine <= 0.0 && !self.both_sides {
            return None;
        }
        let pdf = distance * distance / cosine.abs() * density;
        let radiance = world.materials[world.placed[self.instance as usize].material as usize].emission;
        let shines = pdf > 0.0 && pdf.is_finite() && radiance != Vec3f::zero();
        let end = End::Surface(at + patch.ng * patch.rounding.copysign(cosine));
        let uv = [vec2(0.0, 0.0); 2];
        let origin = LightOrigin::Surface { instance: self.instance, piece: self.piece, uv };
        shines.then_some(LightSample { wi, radiance, pdf, delta: false, end, origin })
    }

    #[inline(always)]
    fn seen(&self, world: &World, at: &Interaction, wi: Vec3f, pdf: f32) -> Option<LightSample> {
        if !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        let material = &world.materials[world.placed[at.instance as usize].material as usize];
        let radiance = if material.varies {
            world.material_at::<true>(at, -wi, &mut None).emission
        } else if at.front || self.both_sides {
            material.emission
        } else {
            Vec3f::zero()
        };
        (radiance != Vec3f::zero()).then(|| LightSample {
            wi,
            radiance,
            pdf,
            delta: false,
            end: End::Surface(at.beside(-wi)),
            origin: LightOrigin::surface(at),
        })
    }

    /// A direction in the cone of a sphere seen from outside; a point of its surface else, or where the transform
    /// makes an ellipsoid of it.
    fn sample_sphere(&self, world: &World, radius: f32, p: Vec3f, u: [f32; 2]) -> Option<LightSample> {
        let placed = &world.placed[self.instance as usize];
        if let Some(cone) = Cone::around(placed, radius, p) {
            let cosine = 1.0 - u[0] * cone.one_minus_cos;
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            let (s, t) = cone.axis.orthonormal_pair();
            let (sin_phi, cos_phi) = (2.0 * PI * u[1]).sin_cos();
            let wi = (s * (sine * cos_phi) + t * (sine * sin_phi) + cone.axis * cosine).normalize_or_zero();
            // The nearer intersection; at the rim rounding may miss, where the point of closest approach serves.
            let along = wi.dot(cone.axis) * cone.distance;
            let below =
                (cone.radius * cone.radius - (cone.distance * cone.distance - along * along)).max(0.0);
            let t = along - below.sqrt();
            let near = p + wi * t;
            let ray = WorldRay { origin: p, direction: wi, t_max: t };
            let hit = WorldHit { t, u: 0.0, v: 0.0, instance: self.instance, piece: 0, front: true };
            let mut at = world.interaction::<true>(&ray, &hit);
            at.p = near;
            let pdf = 1.0 / (2.0 * PI * cone.one_minus_cos);
            return self.seen(world, &at, wi, pdf);
        }
        let q: Vec3f = uniform_sphere(u);
        let to = placed.point(q * radius);
        let (wi, t) = direction(p, to)?;
        let ray = WorldRay { origin: p, direction: wi, t_max: t };
        let hit = WorldHit { t, u: 0.0, v: 0.0, instance: self.instance, piece: 0, front: true };
        let mut at = world.interaction::<true>(&ray, &hit);
        at.front = wi.dot(at.ng) < 0.0;
        if !at.front && !self.both_sides {
            return None;
        }
        let pdf = t * t / wi.dot(at.ng).abs() * ellipsoid_density(placed, radius, q);
        self.seen(world, &at, wi, pdf)
    }

    /// Density per solid angle with which [`Self::sample`] finds `at` for `from`.
    #[inline]
    pub(crate) fn pdf(&self, world: &World, from: &Receiver, at: &Interaction) -> f32 {
        let placed = &world.placed[self.instance as usize];
        if !at.front && !self.both_sides {
            return 0.0;
        }
        let Some((wi, distance)) = direction(from.p, at.p) else { return 0.0 };
        let cosine = wi.dot(at.ng).abs();
        let pdf = match (&self.patch, &world.shapes[placed.shape as usize].kind) {
            (Some(patch), _) => distance * distance / cosine * patch.pdf(from, at.p),
            (None, Kind::DistanceGrid { .. }) => 0.0,
            (None, Kind::Mesh(_)) => distance * distance / (cosine * self.area),
            (None, Kind::Sphere { radius }) => match Cone::around(placed, *radius, from.p) {
                Some(cone) => 1.0 / (2.0 * PI * cone.one_minus_cos),
                None => {
                    let q = from_glam(placed.to_render.inverse().transform_point3a(to_glam(at.p)));
                    distance * distance / cosine * ellipsoid_density(placed, *radius, q * (1.0 / radius))
                }
            },
        };
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

/// Unit direction and distance.
#[inline(always)]
fn direction(from: Vec3f, to: Vec3f) -> Option<(Vec3f, f32)> {
    let v = to - from;
    let distance = v.length();
    (distance > f32::MIN_POSITIVE && distance.is_finite()).then(|| (v * (1.0 / distance), distance))
}

/// Density per area at the image of the unit vector `q`, for points uniform on the unit sphere.
fn ellipsoid_density(placed: &Placed, radius: f32, q: Vec3f) -> f32 {
    let m = placed.to_render.matrix3;
    let det = m.determinant().abs();
    // A surface element grows by |det M| |M^-T q|.
    let stretch = (m.inverse().transpose() * to_glam(q)).length();
    1.0 / (4.0 * PI * radius * radius * det * stretch)
}

/// The cone that a sphere fills.
struct Cone {
    axis: Vec3f,
    distance: f32,
    radius: f32,
    one_minus_cos: f32,
}

impl Cone {
    /// `None` from inside or very near, and for ellipsoids.
    #[inline]
    fn around(placed: &Placed, radius: f32, p: Vec3f) -> Option<Self> {
        let m = placed.to_render.matrix3;
        let scale = m.x_axis.length();
        let even = |v: f32| (v - scale).abs() <= 1e-5 * scale;
        let square = |v: f32| v.abs() <= 1e-5 * scale * scale;
        let round = even(m.y_axis.length())
            && even(m.z_axis.length())
            && square(m.x_axis.dot(m.y_axis))
            && square(m.y_axis.dot(m.z_axis))
            && square(m.z_axis.dot(m.x_axis));
        let radius = radius * scale;
        let center = from_glam(placed.to_render.translation);
        let (axis, distance) = direction(p, center)?;
        let sine = radius / distance;
        if !round || sine > 0.9999 {
            return None;
        }
        let s2 = sine * sine;
        // 1 - cos without cancellation.
        let one_minus_cos = s2 / (1.0 + (1.0 - s2).sqrt());
        Some(Self { axis, distance, radius, one_minus_cos })
    }
}
