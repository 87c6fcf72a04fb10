//! What a ray finds: the point of a surface, its frame, and its material there.

use super::instance::Placed;
use super::material::{glow, library_bsdf};
use super::scatter::{Resolved, SurfaceMaterial};
use super::{Kind, World, WorldHit, WorldRay, sphere};
use glam::{DAffine3, DVec3};
use photofit_geometry::Mesh;
use photofit_rays::DistanceGrid;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3};
use photofit_scene::ExtensionSample;
use photofit_scene::graph::{Partials, SurfaceGraph, SurfacePoint};
use photofit_shading::bsdf::Bsdf;
use photofit_shading::{face_viewer, perturb};

/// Rounding of an intersection, in units in the last place of the coordinates involved.
const ROUNDING: f32 = 16.0 * 0.5 * f32::EPSILON;

/// A point of a surface, in the render frame.
#[derive(Clone, Copy, Debug)]
pub struct Interaction {
    /// The point.
    pub p: Vec3f,
    /// Unit geometric normal of the front.
    pub ng: Vec3f,
    /// Unit interpolated normal, on the side of `ng` but for materials of glTF without transmission: their vertex normals are
    /// taken as they are, as the rasterizer takes them.
    pub ns: Vec3f,
    /// Both sets of texture coordinates.
    pub uv: [Vec2f; 2],
    /// Vertex colour; white where there is none.
    pub color: Vec4f,
    /// Interpolated tangent with handedness; zero where there is none.
    pub tangent: Vec4f,
    /// Bound on the rounding of `p`: rays that leave start this far off.
    pub rounding: f32,
    /// The ray comes from the front.
    pub front: bool,
    /// Index of the instance.
    pub instance: u32,
    /// Index of the triangle.
    pub piece: u32,
}

/// Metalness beyond which vertex normals are bent until the mirror direction leaves the surface.
///
/// A compromise: what is no metal, coats on it included, is shaded as the rasterizer shades it, which bends nothing, so that both draw
/// one asset alike. It loses the more at rims, the more it mirrors there: at grazing angles Fresnel's factor of dielectrics grows
/// to 1. A step, since metalness of materials is 0 or 1 but for texels at the border of both; a normal that followed metalness would
/// have to be differentiated with respect to it by path replay, and all metals below 1 would differ from the rasterizer.
const METAL: f32 = 0.5;

impl Interaction {
    /// A ray from here towards the unit vector `direction`, on the side where it goes.
    #[inline(always)]
    pub fn leave(&self, direction: Vec3f, t_max: f32) -> WorldRay {
        WorldRay { origin: self.beside(direction), direction, t_max }
    }

    /// Whether the interpolated normal is another one than that of the facet, on its side.
    #[inline(always)]
    fn is_smooth(&self) -> bool {
        self.ns != self.ng && self.ns.dot(self.ng) > 0.0
    }

    /// Whether vertex normals may send the mirror direction of a surface of this metalness below its triangles.
    #[inline(always)]
    pub(super) fn has_rims(&self, metallic: f32) -> bool {
        metallic > METAL && self.is_smooth()
    }

    /// The geometric normal on the side of `wo`.
    #[inline(always)]
    pub(super) fn facing(&self, wo: Vec3f) -> Vec3f {
        if self.ng.dot(wo) < 0.0 { -self.ng } else { self.ng }
    }

    /// The point moved off the surface to the side of `direction`.
    #[inline(always)]
    pub fn beside(&self, direction: Vec3f) -> Vec3f {
        let side = if direction.dot(self.ng) < 0.0 { -self.rounding } else { self.rounding };
        self.p + self.ng * side
    }
}

/// Attributes of the three corners, interpolated.
struct Corners<'a> {
    mesh: &'a Mesh,
    ids: [usize; 3],
    b: [f32; 3],
}

impl Corners<'_> {
    #[inline(always)]
    fn vec3(&self, of: &[Vec3f]) -> Vec3f {
        let [i, j, k] = self.ids;
        of[i] * self.b[0] + of[j] * self.b[1] + of[k] * self.b[2]
    }

    #[inline(always)]
    fn vec2(&self, of: &[Vec2f]) -> Vec2f {
        if of.is_empty() {
            return vec2(0.0, 0.0);
        }
        let [i, j, k] = self.ids;
        of[i] * self.b[0] + of[j] * self.b[1] + of[k] * self.b[2]
    }

    #[inline(always)]
    fn color(&self) -> Vec4f {
        let of = &self.mesh.colors;
        if of.is_empty() {
            return Vec4f::splat(1.0);
        }
        let [i, j, k] = self.ids;
        of[i] * self.b[0] + of[j] * self.b[1] + of[k] * self.b[2]
    }
}

impl World {
    /// The point where `ray` meets the world at `hit`. Without `TEXTURES`, texture coordinates, colours and tangents are
    /// left out.
    #[inline(never)]
    pub(crate) fn interaction<const TEXTURES: bool>(&self, ray: &WorldRay, hit: &WorldHit) -> Interaction {
        let placed = &self.placed[hit.instance as usize];
        let shape = &self.shapes[placed.shape as usize];
        match &shape.kind {
            Kind::Mesh(mesh) => {
                let facet = shape.facets[hit.piece as usize];
                self.on_mesh::<TEXTURES>((mesh, facet), placed, hit, ray.direction)
            }
            Kind::Sphere { radius } => self.on_sphere(placed, *radius, ray, hit),
            Kind::DistanceGrid { grid, cells, smooth } => on_grid((grid, *cells, *smooth), placed, ray, hit),
        }
    }

    #[inline(always)]
    fn on_mesh<const TEXTURES: bool>(
        &self,
        (mesh, facet): (&Mesh, Vec3f),
        placed: &Placed,
        hit: &WorldHit,
        direction: Vec3f,
    ) -> Interaction {
        let ids = mesh.triangles[hit.piece as usize].map(|i| i as usize);
        let at = Corners { mesh, ids, b: [1.0 - hit.u - hit.v, hit.u, hit.v] };
        let [a, b, c] = ids.map(|i| mesh.positions[i]);
        let local = at.vec3(&mesh.positions);
        let p = placed.point(local);
        let rounding = ROUNDING * (largest(a).max(largest(b)).max(largest(c)) * placed.stretch + largest(p));
        // Away from the edges by as much as the rounding: on the plane of the next face a ray could slip out.
        let size = largest(b - a).max(largest(c - a)) * placed.stretch;
        let inward = (rounding / size).min(0.1);
        let p = p + placed.vector((a + b + c) * (1.0 / 3.0) - local) * inward;
        let ng = placed.normal(facet);
        let ng = if placed.rigid { ng } else { ng.normalize_or_zero() };
        let ng = if ng == Vec3f::zero() { direction * if hit.front { -1.0 } else { 1.0 } } else { ng };
        let mut ns = ng;
        if !mesh.normals.is_empty() {
            let n = placed.normal(at.vec3(&mesh.normals)).normalize_or_zero();
            if n != Vec3f::zero() {
                ns = if n.dot(ng) < 0.0 && self.materials[placed.material as usize].turns_normals() {
                    -n
                } else {
                    n
                };
            }
        }
        let mut out = Interaction {
            p,
            ng,
            ns,
            uv: [vec2(0.0, 0.0); 2],
            color: Vec4f::splat(1.0),
            tangent: Vec4f::zero(),
            rounding,
            front: hit.front,
            instance: hit.instance,
            piece: hit.piece,
        };
        if TEXTURES {
            out.uv = [at.vec2(&mesh.uvs), at.vec2(&mesh.uvs1)];
            out.color = at.color();
            if !mesh.tangents.is_empty() {
                let [i, j, k] = ids.map(|i| mesh.tangents[i].xyz());
                let t = placed.vector(i * at.b[0] + j * at.b[1] + k * at.b[2]);
                let w = mesh.tangents[ids[0]].w;
                out.tangent = t.extend(if placed.mirrored { -w } else { w });
            }
        }
        out
    }

    fn on_sphere(&self, placed: &Placed, radius: f32, ray: &WorldRay, hit: &WorldHit) -> Interaction {
        // From the approximate point to the unit sphere, and from there to a point that lies on the surface.
        let near = ray.origin + ray.direction * hit.t;
        let inverse = placed.to_render.inverse();
        let q = inverse.transform_point3a(super::to_glam(near));
        let q = vec3(q.x, q.y, q.z).normalize_or_zero();
        let q = if q == Vec3f::zero() { vec3(0.0, 0.0, 1.0) } else { q };
        let p = placed.point(q * radius);
        let n = placed.normal(q).normalize_or_zero();
        Interaction {
            p,
            ng: n,
            ns: n,
            uv: [sphere::uv(q); 2],
            color: Vec4f::splat(1.0),
            tangent: placed.vector(sphere::tangent(q)).extend(1.0),
            rounding: ROUNDING * (radius * placed.stretch + largest(p)),
            front: hit.front,
            instance: hit.instance,
            piece: hit.piece,
        }
    }

    /// The material at a point seen from `wo`, a unit vector; `resolved` is a place for what does not hold everywhere.
    #[inline(always)]
    pub(crate) fn material_at<'a, const TEXTURES: bool>(
        &'a self,
        at: &Interaction,
        wo: Vec3f,
        resolved: &'a mut Option<Resolved>,
    ) -> SurfaceMaterial<'a> {
        let placed = &self.placed[at.instance as usize];
        let material = &self.materials[placed.material as usize];
        let shown = at.front || material.both_sides;
        let emission = if shown { material.emission } else { Vec3f::zero() };
        let mut out = SurfaceMaterial {
            bsdf: &material.bsdf,
            second: None,
            bent: None,
            s: at.ns,
            t: at.ns,
            n: at.ns,
            emission,
        };
        let tangent = if TEXTURES { at.tangent.xyz() } else { Vec3f::zero() };
        let Some(index) = material.library else {
            if TEXTURES && let Some(graph) = &material.graph {
                self.resolve(graph, at, wo, shown, &mut out, resolved);
                return out;
            }
            if material.two_sided && !material.transmits && !at.front {
                out.n = -at.ns;
            }
            (out.s, out.t) = axes(out.n, tangent);
            return out;
        };
        if !TEXTURES || !placed.varies {
            let n = face_viewer(at.ns, at.ng, wo);
            out.n = match (material.transmits, at.front) {
                (true, false) => -n,
                (true, true) => n,
                (false, _)
                    if self.library.as_ref().is_some_and(|l| at.has_rims(l.factors(index).metallic)) =>
                {
                    reflecting_upwards(n, at.facing(wo), wo)
                }
                (false, _) => n,
            };
            (out.s, out.t) = axes(out.n, tangent);
            return out;
        }
        self.look_up(index, at, wo, &mut out, resolved);
        out
    }

    /// The material of a library where it varies.
    #[inline(never)]
    fn look_up<'a>(
        &'a self,
        index: usize,
        at: &Interaction,
        wo: Vec3f,
        out: &mut SurfaceMaterial<'a>,
        resolved: &'a mut Option<Resolved>,
    ) {
        let library = self.library.as_ref().expect("a library material was compiled from the library");
        let sample = library.lookup(index, at.uv[0], at.uv[1], at.color, None);
        let extensions = library.extensions(index, at.uv[0], at.uv[1], None);
        let added = self.materials[self.placed[at.instance as usize].material as usize].added;
        out.emission = added + glow(&sample);
        let tangent = at.tangent.xyz().normalize_or_zero();
        let has_map = library.has_normal_map(index);
        let normal = if has_map { mapped(at, sample.normal) } else { at.ns };
        let mut n = face_viewer(normal, at.ng, wo);
        let transmits = extensions.is_some_and(|e| e.transmission > 0.0) && sample.metallic < 1.0;
        let rims = at.has_rims(sample.metallic);
        if !transmits && (has_map || rims) {
            n = reflecting_upwards(n, at.facing(wo), wo);
        }
        out.n = if transmits && !at.front { -n } else { n };
        (out.s, out.t) = axes(out.n, tangent);
        let up = vec3(0.0, 0.0, 1.0);
        let coat = match extensions {
            Some(e) => coat_normal(&e, at, wo, CoatOn { transmits, rims }, out),
            None => up,
        };
        let bsdf = library_bsdf(&sample, extensions.as_ref(), coat, self.energy);
        out.bsdf = &resolved.insert(Resolved { bsdf, second: None }).bsdf;
    }

    /// The material of a tree.
    #[inline(never)]
    fn resolve<'a>(
        &'a self,
        graph: &SurfaceGraph,
        at: &Interaction,
        wo: Vec3f,
        shown: bool,
        out: &mut SurfaceMaterial<'a>,
        resolved: &'a mut Option<Resolved>,
    ) {
        let point = SurfacePoint { uv: at.uv[0], color: at.color, piece: at.piece };
        if let Some(emission) = graph.emission.as_ref().filter(|_| shown) {
            out.emission += emission.color(&point);
        }
        let (mut du, mut dv) = (Vec3f::zero(), Vec3f::zero());
        if graph.root.needs_partials() {
            (du, dv) = self.partials(at);
        }
        (out.s, out.t) = axes(out.n, du);
        let partials = || Partials { du: out.to_local(du), dv: out.to_local(dv) };
        let found = graph.resolve(&point, at.front, partials);
        let scattering = resolved.insert(Resolved { bsdf: found.bsdf, second: found.second });
        (out.bsdf, out.second) = (&scattering.bsdf, scattering.second.as_ref());
        let mut n = out.n;
        if let Some(m) = found.normal {
            // Seen from behind, the bend is turned to the viewer.
            let local = out.to_local(wo);
            let behind = m.dot(local) * local.z < 0.0;
            let m = if behind { vec3(-m.x, -m.y, m.z) } else { m };
            n = out.to_render(m).normalize_or_zero();
        }
        if found.two_sided && !at.front {
            // The back is the mirror image of the front.
            n = n - at.ns * (2.0 * n.dot(at.ns));
        }
        if n != out.n && n != Vec3f::zero() {
            let up = if found.two_sided && !at.front { -at.ns } else { at.ns };
            out.n = n;
            (out.s, out.t) = axes(n, du);
            if found.normal.is_some() {
                let cosine = n.dot(up).abs();
                let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine).max(1e-12);
                out.bent = Some((out.to_local(up), (0.125 * tan2).clamp(0.0, 1.0)));
            }
        }
    }

    /// Derivatives of the position with respect to the texture coordinates; any across the normal where they say
    /// nothing.
    fn partials(&self, at: &Interaction) -> (Vec3f, Vec3f) {
        let placed = &self.placed[at.instance as usize];
        let any = || at.ns.orthonormal_pair();
        let mesh = match &self.shapes[placed.shape as usize].kind {
            Kind::Mesh(mesh) => mesh,
            Kind::Sphere { .. } => {
                let du = at.tangent.xyz() * std::f32::consts::TAU;
                return (du, at.ng.cross(du) * 0.5);
            }
            Kind::DistanceGrid { .. } => return any(),
        };
        if mesh.uvs.is_empty() {
            return any();
        }
        let ids = mesh.triangles[at.piece as usize].map(|i| i as usize);
        let [a, b, c] = ids.map(|i| mesh.positions[i]);
        let [s, t, r] = ids.map(|i| mesh.uvs[i]);
        let (e, f) = (placed.vector(b - a), placed.vector(c - a));
        let (p, q) = (t - s, r - s);
        let determinant = p.x * q.y - p.y * q.x;
        let inverse = 1.0 / determinant;
        if !inverse.is_finite() || determinant == 0.0 {
            return any();
        }
        ((e * q.y - f * p.y) * inverse, (f * p.x - e * q.x) * inverse)
    }

    /// Whether some point of an instance may emit.
    #[inline(always)]
    pub(crate) fn emits(&self, instance: u32) -> bool {
        self.materials[self.placed[instance as usize].material as usize].emits
    }

    /// Whether a camera ray passes a hit: the back of a single-sided surface.
    #[inline(always)]
    pub(crate) fn culls(&self, hit: &WorldHit) -> bool {
        !hit.front && self.materials[self.placed[hit.instance as usize].material as usize].culled
    }

    /// Whether nothing of an instance is seen: it is a boundary alone.
    #[inline(always)]
    pub(crate) fn is_invisible(&self, instance: u32) -> bool {
        let material = &self.materials[self.placed[instance as usize].material as usize];
        material.is_null && material.absorption == Vec3f::zero()
    }

    /// Part of light that goes straight through a pane; 1 for other surfaces.
    pub(crate) fn straight_through(&self, ray: &WorldRay, hit: &WorldHit) -> Vec3f {
        if !self.materials[self.placed[hit.instance as usize].material as usize].pane {
            return Vec3f::splat(1.0);
        }
        let at = self.interaction::<true>(ray, hit);
        let mut resolved = None;
        let material = self.material_at::<true>(&at, -ray.direction, &mut resolved);
        match material.bsdf {
            Bsdf::ThinDielectric(glass) => glass.straight(material.n.dot(ray.direction).abs()),
            _ => Vec3f::zero(),
        }
    }

    /// Coverage of the surface at a hit: 1 for opaque materials.
    #[inline(never)]
    pub(crate) fn coverage(&self, hit: &WorldHit) -> f32 {
        let placed = &self.placed[hit.instance as usize];
        let material = &self.materials[placed.material as usize];
        let mesh = match &self.shapes[placed.shape as usize].kind {
            Kind::Mesh(mesh) => mesh,
            Kind::Sphere { .. } => return 1.0,
            Kind::DistanceGrid { .. } => {
                let opacity = material.graph.as_ref().and_then(|g| g.root.opacity());
                let point = SurfacePoint { uv: vec2(0.0, 0.0), color: Vec4f::splat(1.0), piece: hit.piece };
                return opacity.map_or(1.0, |o| o.value(&point).clamp(0.0, 1.0));
            }
        };
        if let Some(opacity) = material.graph.as_ref().and_then(|g| g.root.opacity()) {
            let ids = mesh.triangles[hit.piece as usize].map(|i| i as usize);
            let at = Corners { mesh, ids, b: [1.0 - hit.u - hit.v, hit.u, hit.v] };
            let point = SurfacePoint { uv: at.vec2(&mesh.uvs), color: at.color(), piece: hit.piece };
            return opacity.value(&point).clamp(0.0, 1.0);
        }
        let Some(index) = material.library else { return 1.0 };
        let ids = mesh.triangles[hit.piece as usize].map(|i| i as usize);
        let at = Corners { mesh, ids, b: [1.0 - hit.u - hit.v, hit.u, hit.v] };
        let library = self.library.as_ref().expect("a library material was compiled from the library");
        library.alpha(index, at.vec2(&mesh.uvs), at.vec2(&mesh.uvs1), at.color().w)
    }
}

/// A point of the zero level of a grid, and whether its normals are smoothed.
fn on_grid(
    (grid, cells, smooth): (&DistanceGrid, DVec3, bool),
    placed: &Placed,
    ray: &WorldRay,
    hit: &WorldHit,
) -> Interaction {
    let near = super::dvec3(ray.origin) + super::dvec3(ray.direction) * f64::from(hit.t);
    let m = placed.to_render;
    let inverse = DAffine3 { matrix3: m.matrix3.as_dmat3(), translation: m.translation.as_dvec3() }.inverse();
    // From the approximate point to the surface.
    let (q, gradient) = grid.on_surface(hit.piece, inverse.transform_point3(near) * cells);
    let single = |v: DVec3| vec3(v.x as f32, v.y as f32, v.z as f32);
    let local = single(q / cells);
    let p = placed.point(local);
    let turned = |n: DVec3| placed.normal(single(n.normalize_or_zero())).normalize_or_zero();
    let ng = turned(gradient * cells);
    let ng = if ng == Vec3f::zero() { ray.direction * if hit.front { -1.0 } else { 1.0 } } else { ng };
    let mut ns = ng;
    if smooth {
        let n = turned(grid.smooth_normal(q, 1.0 / cells));
        if n != Vec3f::zero() {
            ns = if n.dot(ng) < 0.0 { -n } else { n };
        }
    }
    Interaction {
        p,
        ng,
        ns,
        uv: [vec2(0.0, 0.0); 2],
        color: Vec4f::splat(1.0),
        tangent: Vec4f::zero(),
        rounding: ROUNDING * (placed.stretch + largest(p)),
        front: hit.front,
        instance: hit.instance,
        piece: hit.piece,
    }
}

/// The normal of a tangent-space map at a point.
pub(super) fn mapped(at: &Interaction, map: Vec3f) -> Vec3f {
    let tangent = at.tangent.xyz().normalize_or_zero();
    if tangent == Vec3f::zero() { at.ns } else { perturb(at.ns, tangent, at.tangent.w, map) }
}

/// What a coat lies on.
#[derive(Clone, Copy)]
pub(super) struct CoatOn {
    /// Light passes through it.
    pub(super) transmits: bool,
    /// Its vertex normals are bent ([`Interaction::has_rims`]).
    pub(super) rims: bool,
}

/// The normal of a coat in the frame of the surface below it.
pub(super) fn coat_normal(
    e: &ExtensionSample,
    at: &Interaction,
    wo: Vec3f,
    CoatOn { transmits, rims }: CoatOn,
    below: &SurfaceMaterial<'_>,
) -> Vec3f {
    let up = vec3(0.0, 0.0, 1.0);
    if e.clearcoat <= 0.0 {
        return up;
    }
    let coat = if e.clearcoat_normal == up { at.ns } else { mapped(at, e.clearcoat_normal) };
    let mut coat = if at.front || transmits { coat } else { -coat };
    if !transmits && (e.clearcoat_normal != up || rims) {
        coat = reflecting_upwards(coat, at.facing(wo), wo);
    }
    let local = below.to_local(coat);
    if local.z > 0.0 { local } else { up }
}

/// Least cosine between a mirrored direction and the geometric normal, where the viewer stands higher.
const REFLECTED_COSINE: f32 = 0.01;

/// The shading normal `n`, bent as little as it takes for the mirror direction of `wo` to stay above the surface with the
/// geometric normal `ng`; all are unit vectors with `wo` above both.
///
/// A mapped or interpolated normal may send the mirror direction below the surface, where nothing arrives: mirrors would be
/// black there. The mirror direction is lifted, within the plane of it and `ng`, to a small cosine, and the normal becomes the half
/// vector. Reference renderers bend normals to the same effect.
#[inline]
fn reflecting_upwards(n: Vec3f, ng: Vec3f, wo: Vec3f) -> Vec3f {
    let least = REFLECTED_COSINE.min(0.9 * ng.dot(wo));
    let mirrored = n * (2.0 * n.dot(wo)) - wo;
    let cosine = mirrored.dot(ng);
    if cosine >= least {
        return n;
    }
    let along = (mirrored - ng * cosine).normalize_or_zero();
    let lifted = ng * least + along * (1.0 - least * least).max(0.0).sqrt();
    let half = (wo + lifted).normalize_or_zero();
    if along == Vec3f::zero() || half == Vec3f::zero() { ng } else { half }
}

/// Adjoint of [`reflecting_upwards`] for the gradient `g` of its result, with respect to `n`.
pub(crate) fn reflecting_upwards_vjp(n: Vec3f, ng: Vec3f, wo: Vec3f, g: Vec3f) -> Vec3f {
    let least = REFLECTED_COSINE.min(0.9 * ng.dot(wo));
    let mirrored = n * (2.0 * n.dot(wo)) - wo;
    let cosine = mirrored.dot(ng);
    if cosine >= least {
        return g;
    }
    let across = mirrored - ng * cosine;
    let along = across.normalize_or_zero();
    let reach = (1.0 - least * least).max(0.0).sqrt();
    let g = across.normalize_vjp((wo + ng * least + along * reach).normalize_vjp(g) * reach);
    let g = g - ng * ng.dot(g);
    (g * n.dot(wo) + wo * n.dot(g)) * 2.0
}

/// The axes of a frame around `n`, the first along `tangent` where that says something.
#[inline(always)]
fn axes(n: Vec3f, tangent: Vec3f) -> (Vec3f, Vec3f) {
    if tangent != Vec3f::zero() {
        let s = (tangent - n * n.dot(tangent)).normalize_or_zero();
        if s != Vec3f::zero() {
            return (s, n.cross(s));
        }
    }
    n.orthonormal_pair()
}

/// Largest absolute component.
#[inline(always)]
pub(crate) fn largest(v: Vec3f) -> f32 {
    v.x.abs().max(v.y.abs()).max(v.z.abs())
}
