//! MikkTSpace-compatible vertex tangents and their vector-Jacobian product.
//!
//! `t_v = unit(sum over corners c at v of angle_c unit(P_v s_face(c)))`, with the projection `P_v x = x - n (n.x)` on the
//! plane of the vertex normal, `s` the direction in which u grows on the face, and the angle between the projected
//! edges (Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited"; threshold 180 degrees).
//!
//! Handedness follows glTF: uv origin at the upper left, green of a normal map up, `bitangent = w cross(n, t)`, so `w` is
//! +1 where the texture is not mirrored. This equals MikkTSpace run on `(u, 1 - v)`, and the negated sign of a run on
//! the raw uvs. MikkTSpace gives a vertex one tangent per uv orientation; here a vertex has one: split first with
//! [`split_mirrored`], otherwise the orientation of most of its corners wins and the others do not count.
//!
//! Faces with zero area in uv, or with two equal positions, contribute nothing. A vertex without contributions gets
//! an arbitrary unit vector perpendicular to its normal and passes no gradient. Uvs are constants; the handedness has
//! no gradient.

#[cfg(feature = "gpu")]
pub mod gpu;
mod split;

pub use split::{mirrored_vertices, split_mirrored};

use crate::angle::{angle, angle_vjp, reach, unit, unit_vjp};
use crate::incidence::Incidence;
use crate::normals::gather_corners;
use photofit_scalar::{Real, Vec2f, Vec3, Vec4, vec3};
use rayon::prelude::*;

/// Items handed to one thread at a time.
const GRAIN: usize = 256;

/// What the uvs of a face say: the tangent is along `edges[0] * e1 + edges[1] * e2`.
#[derive(Clone, Copy, Debug)]
struct FaceUv {
    edges: [f32; 2],
    handedness: i8,
}

impl FaceUv {
    fn new(uv: [Vec2f; 3]) -> Self {
        let [a, b, c] = uv.map(|p| p.cast::<f64>());
        let (s, t) = (b - a, c - a);
        let area = s.x * t.y - s.y * t.x;
        let size = s.length_squared().max(t.length_squared()).max((t - s).length_squared());
        if !(area.abs() > 1e-12 * size && size.is_finite()) {
            return Self { edges: [0.0; 2], handedness: 0 };
        }
        // v grows downwards: a face seen from its front with upright uvs has a negative area.
        let sign = area.signum();
        let scale = sign / t.y.abs().max(s.y.abs());
        Self { edges: [(t.y * scale) as f32, (-s.y * scale) as f32], handedness: -sign as i8 }
    }
}

/// The constant part of tangent generation: what each face's uvs say, and each vertex's handedness.
#[derive(Clone, Debug)]
pub struct UvFrames {
    faces: Vec<FaceUv>,
    /// +1 or -1 per welded id.
    handedness: Vec<i8>,
}

impl UvFrames {
    /// Reads `uvs`, one per (unwelded) vertex. `incidence` says which vertices share a tangent: the identity weld for
    /// meshes whose vertices are already unique, else a weld by position, normal and uv
    /// ([`weld_rows`](crate::weld::weld_rows)).
    ///
    /// # Panics
    /// When `uvs` does not have one entry per vertex of `incidence`.
    pub fn new(incidence: &Incidence, uvs: &[Vec2f]) -> Self {
        assert_eq!(uvs.len(), incidence.vertices(), "one uv per vertex");
        let faces: Vec<_> =
            incidence.triangles.iter().map(|t| FaceUv::new(t.map(|v| uvs[v as usize]))).collect();
        let handedness = (0..incidence.weld.count())
            .map(|w| {
                let corners = incidence.corners_of_weld(w).iter();
                let votes: i64 = corners.map(|&c| i64::from(faces[c as usize / 3].handedness)).sum();
                if votes < 0 { -1 } else { 1 }
            })
            .collect();
        Self { faces, handedness }
    }
}

/// Everything one corner needs: its normal, the scaled edges to the face's other corners, and its place.
struct Corner<T> {
    normal: Vec3<T>,
    /// Edges from corner 0 of the face, to corners 1 and 2, over `scale`.
    edges: [Vec3<T>; 2],
    scale: T,
    uv: FaceUv,
    k: usize,
}

/// Intermediate values of a corner's contribution, saved for the adjoint.
struct Contribution<T> {
    /// Direction of u on the face, and its projection.
    along: Vec3<T>,
    projected: Vec3<T>,
    /// Unit projected direction.
    tangent: Vec3<T>,
    /// Edges to the next and the last corner, and their projections.
    legs: [Vec3<T>; 2],
    flat: [Vec3<T>; 2],
    angle: T,
}

#[inline(always)]
fn project<T: Real>(n: Vec3<T>, x: Vec3<T>) -> Vec3<T> {
    x - n * n.dot(x)
}

/// Adjoint of [`project`]: adds to `dn` and returns the gradient of `x`.
#[inline(always)]
fn project_vjp<T: Real>(n: Vec3<T>, x: Vec3<T>, g: Vec3<T>, dn: &mut Vec3<T>) -> Vec3<T> {
    let ng = n.dot(g);
    *dn -= x * ng + g * n.dot(x);
    g - n * ng
}

impl<T: Real> Corner<T> {
    /// `None` where the face does not count at this corner.
    #[inline(always)]
    fn new(
        incidence: &Incidence,
        frames: &UvFrames,
        positions: &[Vec3<T>],
        normals: &[Vec3<T>],
        corner: u32,
    ) -> Option<Self> {
        let (t, k) = (corner as usize / 3, corner as usize % 3);
        let (vertices, uv) = (incidence.triangles[t], frames.faces[t]);
        let vertex = vertices[k] as usize;
        if uv.handedness != frames.handedness[incidence.weld.ids[vertex] as usize] {
            return None;
        }
        let p = vertices.map(|v| positions[v as usize]);
        if p[0] == p[1] || p[1] == p[2] || p[2] == p[0] {
            return None;
        }
        let edges = [p[1] - p[0], p[2] - p[0]];
        let scale = reach(edges[0]).max(reach(edges[1]));
        let usable = scale > T::zero() && scale.is_finite() && normals[vertex].is_finite();
        usable.then(|| Self { normal: normals[vertex], edges: edges.map(|e| e / scale), scale, uv, k })
    }

    #[inline(always)]
    fn contribution(&self) -> Contribution<T> {
        let [e1, e2] = self.edges;
        let [c1, c2] = self.uv.edges.map(|c| T::of(f64::from(c)));
        let legs = [[e1, e2], [e2 - e1, -e1], [-e2, e1 - e2]][self.k];
        let along = e1 * c1 + e2 * c2;
        let projected = project(self.normal, along);
        let flat = legs.map(|l| project(self.normal, l));
        let angle = angle(flat[0], flat[1]);
        Contribution { along, projected, tangent: unit(projected), legs, flat, angle }
    }

    /// Gradients of the face's positions and of this corner's normal, for the gradient `g` of the sum.
    #[inline(always)]
    fn vjp(&self, g: Vec3<T>) -> ([Vec3<T>; 3], Vec3<T>) {
        let c = self.contribution();
        let mut dn = Vec3::zero();
        let d_projected = unit_vjp(c.projected, g * c.angle);
        let d_along = project_vjp(self.normal, c.along, d_projected, &mut dn);
        let (d0, d1) = angle_vjp(c.flat[0], c.flat[1], c.tangent.dot(g));
        let d_next = project_vjp(self.normal, c.legs[0], d0, &mut dn);
        let d_last = project_vjp(self.normal, c.legs[1], d1, &mut dn);
        let [c1, c2] = self.uv.edges.map(|c| T::of(f64::from(c)));
        let mut d = [d_along * -(c1 + c2), d_along * c1, d_along * c2];
        d[(self.k + 1) % 3] += d_next;
        d[(self.k + 2) % 3] += d_last;
        d[self.k] -= d_next + d_last;
        (d.map(|d| d / self.scale), dn)
    }
}

/// Sum of the corners' contributions at welded id `w`.
#[inline(always)]
fn weighted_sum<T: Real>(
    incidence: &Incidence,
    frames: &UvFrames,
    positions: &[Vec3<T>],
    normals: &[Vec3<T>],
    w: usize,
) -> Vec3<T> {
    let mut sum = Vec3::zero();
    for &c in incidence.corners_of_weld(w) {
        if let Some(corner) = Corner::new(incidence, frames, positions, normals, c) {
            let part = corner.contribution();
            sum += part.tangent * part.angle;
        }
    }
    sum
}

fn check_lengths<T>(incidence: &Incidence, frames: &UvFrames, positions: &[Vec3<T>], normals: &[Vec3<T>]) {
    assert_eq!(positions.len(), incidence.vertices(), "one position per vertex");
    assert_eq!(normals.len(), incidence.vertices(), "one normal per vertex");
    assert_eq!(frames.faces.len(), incidence.triangles.len(), "frames of the same triangles");
    assert_eq!(frames.handedness.len(), incidence.weld.count(), "frames of the same weld");
}

/// Vertex tangents, one per (unwelded) vertex: `xyz` a unit vector perpendicular to the normal, `w` the handedness.
///
/// `normals`: unit (the projection assumes it), one per vertex. The result does not depend on the number of threads.
///
/// ```
/// use photofit_geometry::{Incidence, Weld, shapes, tangents::{UvFrames, vertex_tangents}};
/// let grid = shapes::quad_grid(4, 4);
/// let incidence = Incidence::new(&grid.triangles, &Weld::identity(grid.positions.len()));
/// let frames = UvFrames::new(&incidence, &grid.uvs);
/// let tangents = vertex_tangents(&incidence, &frames, &grid.positions, &grid.normals);
/// assert!((tangents[7].x - 1.0).abs() < 1e-6 && tangents[7].w == 1.0);
/// ```
///
/// # Panics
/// When a slice does not have one entry per vertex, or `frames` was made for another topology.
pub fn vertex_tangents<T: Real>(
    incidence: &Incidence,
    frames: &UvFrames,
    positions: &[Vec3<T>],
    normals: &[Vec3<T>],
) -> Vec<Vec4<T>> {
    check_lengths(incidence, frames, positions, normals);
    let welds = (0..incidence.weld.count()).into_par_iter().with_min_len(GRAIN);
    let tangents: Vec<Vec4<T>> = welds
        .map(|w| {
            let mut tangent = unit(weighted_sum(incidence, frames, positions, normals, w));
            if tangent == Vec3::zero() {
                let n = unit(normals[incidence.weld.first[w] as usize]);
                let none = n == Vec3::zero();
                tangent = if none { vec3(T::one(), T::zero(), T::zero()) } else { n.orthonormal_pair().0 };
            }
            tangent.extend(T::of(f64::from(frames.handedness[w])))
        })
        .collect();
    if incidence.weld.is_identity() { tangents } else { incidence.weld.expand(&tangents) }
}

/// Vector-Jacobian product of [`vertex_tangents`]: adds to `d_positions` and `d_normals` the gradient of
/// `sum_v d_tangents[v].xyz . tangents[v].xyz`; `d_tangents[v].w` is ignored.
///
/// Exact except at kinks (parallel projected edges, where the angle's derivative is taken as zero). Chain
/// `d_normals` through [`vertex_normals_vjp`](crate::normals::vertex_normals_vjp). Deterministic.
///
/// # Panics
/// When a slice does not have one entry per vertex, or `frames` was made for another topology.
pub fn vertex_tangents_vjp<T: Real>(
    incidence: &Incidence,
    frames: &UvFrames,
    positions: &[Vec3<T>],
    normals: &[Vec3<T>],
    d_tangents: &[Vec4<T>],
    d_positions: &mut [Vec3<T>],
    d_normals: &mut [Vec3<T>],
) {
    check_lengths(incidence, frames, positions, normals);
    assert_eq!(d_tangents.len(), incidence.vertices(), "one tangent gradient per vertex");
    assert_eq!(d_positions.len(), incidence.vertices(), "one position gradient per vertex");
    assert_eq!(d_normals.len(), incidence.vertices(), "one normal gradient per vertex");
    let welds = (0..incidence.weld.count()).into_par_iter().with_min_len(GRAIN);
    let d_sums: Vec<Vec3<T>> = welds
        .map(|w| {
            let g = incidence.sum_members(w, Vec3::zero(), |v| d_tangents[v].xyz());
            unit_vjp(weighted_sum(incidence, frames, positions, normals, w), g)
        })
        .collect();
    let mut d_face_positions = vec![[Vec3::zero(); 3]; incidence.triangles.len()];
    let mut d_face_normals = vec![[Vec3::zero(); 3]; incidence.triangles.len()];
    let faces = d_face_positions.par_iter_mut().zip(&mut d_face_normals).with_min_len(GRAIN);
    faces.enumerate().for_each(|(t, (d_face, d_corner))| {
        for k in 0..3 {
            let c = (3 * t + k) as u32;
            let Some(corner) = Corner::new(incidence, frames, positions, normals, c) else { continue };
            let w = incidence.weld.ids[incidence.triangles[t][k] as usize] as usize;
            let (d, dn) = corner.vjp(d_sums[w]);
            for i in 0..3 {
                d_face[i] += d[i];
            }
            d_corner[k] = dn;
        }
    });
    gather_corners(incidence, &d_face_positions, d_positions);
    gather_corners(incidence, &d_face_normals, d_normals);
}

#[cfg(test)]
mod tests;
