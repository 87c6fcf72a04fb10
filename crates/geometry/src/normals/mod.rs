//! Vertex normals and their vector-Jacobian product.
//!
//! `n_w = unit(sum over the corners c at w of weight_c n_face(c))`, where `w` is a welded position, so that uv seams do
//! not split the shading normal. Weights: the corner's angle times the unit face normal (Thürmer and Wüthrich 1998,
//! independent of the triangulation), or the face's doubled area. Degenerate and non-finite faces contribute
//! nothing; a vertex without contributions gets the zero vector and passes no gradient.

mod crease;
#[cfg(feature = "gpu")]
pub mod gpu;

pub use crease::{Creased, split_creases, split_hard_edges};

use crate::Mesh;
use crate::angle::{reach, unit, unit_vjp};
use crate::incidence::Incidence;
use crate::weld::weld_exact;
use photofit_scalar::{Real, Vec3, Vec3f};
use rayon::prelude::*;

/// How a face counts at its corners.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weighting {
    /// Unit face normal times the angle at the corner.
    #[default]
    Angle,
    /// Face normal times twice the face's area.
    Area,
}

/// Items handed to one thread at a time.
const GRAIN: usize = 512;

/// A face's share in the normals of its corners: `normal * weights[k]`.
#[derive(Clone, Copy, Debug)]
struct Share<T> {
    normal: Vec3<T>,
    weights: [T; 3],
}

/// Edges of a triangle divided by their largest component, and that component; `None` where the triangle is
/// degenerate (its height is below rounding) or not finite.
#[inline(always)]
fn scaled_edges<T: Real>(p: [Vec3<T>; 3]) -> Option<(Vec3<T>, Vec3<T>, T)> {
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let scale = reach(e1).max(reach(e2));
    if !(scale > T::zero() && scale.is_finite()) {
        return None;
    }
    let (e1, e2) = (e1 / scale, e2 / scale);
    let sine = e1.cross(e2).length();
    (sine > T::epsilon()).then_some((e1, e2, scale))
}

#[inline(always)]
fn share<T: Real>(p: [Vec3<T>; 3], weighting: Weighting) -> Share<T> {
    let nothing = Share { normal: Vec3::zero(), weights: [T::zero(); 3] };
    let Some((e1, e2, scale)) = scaled_edges(p) else { return nothing };
    let cross = e1.cross(e2);
    match weighting {
        Weighting::Area => {
            let raw = cross * scale * scale;
            if raw.is_finite() { Share { normal: raw, weights: [T::one(); 3] } } else { nothing }
        }
        Weighting::Angle => {
            let sine = cross.length();
            let first = sine.atan2(e1.dot(e2));
            let second = sine.atan2(e1.dot(e1 - e2));
            let third = (T::of(std::f64::consts::PI) - first - second).max(T::zero());
            Share { normal: cross / sine, weights: [first, second, third] }
        }
    }
}

fn shares<T: Real>(incidence: &Incidence, positions: &[Vec3<T>], weighting: Weighting) -> Vec<Share<T>> {
    assert_eq!(positions.len(), incidence.vertices(), "one position per vertex");
    let triangles = incidence.triangles.par_iter().with_min_len(GRAIN);
    triangles.map(|t| share(t.map(|v| positions[v as usize]), weighting)).collect()
}

/// Unnormalised normal of welded id `w`.
#[inline(always)]
fn weighted_sum<T: Real>(incidence: &Incidence, shares: &[Share<T>], w: usize) -> Vec3<T> {
    let mut sum = Vec3::zero();
    for &c in incidence.corners_of_weld(w) {
        let share = &shares[c as usize / 3];
        sum += share.normal * share.weights[c as usize % 3];
    }
    sum
}

/// Unit vertex normals, one per (unwelded) vertex; zero where no face contributes.
///
/// `positions`: one per vertex, any unit. The result does not depend on the number of threads.
///
/// ```
/// use photofit_geometry::{Incidence, normals::{Weighting, vertex_normals}, shapes, weld::weld_exact};
/// let cube = shapes::cube();
/// let incidence = Incidence::new(&cube.triangles, &weld_exact(&cube.positions));
/// let normals = vertex_normals(&incidence, &cube.positions, Weighting::Angle);
/// let corner = cube.positions[0].normalize_or_zero();
/// assert!((normals[0] - corner).length() < 1e-6);
/// ```
///
/// # Panics
/// When `positions` does not have one entry per vertex of `incidence`.
pub fn vertex_normals<T: Real>(
    incidence: &Incidence,
    positions: &[Vec3<T>],
    weighting: Weighting,
) -> Vec<Vec3<T>> {
    let shares = shares(incidence, positions, weighting);
    let welds = (0..incidence.weld.count()).into_par_iter().with_min_len(GRAIN);
    let normals: Vec<Vec3<T>> = welds.map(|w| unit(weighted_sum(incidence, &shares, w))).collect();
    if incidence.weld.is_identity() { normals } else { incidence.weld.expand(&normals) }
}

/// Vector-Jacobian product of [`vertex_normals`]: adds to `d_positions` the gradient of
/// `sum_v d_normals[v] . normals[v]`.
///
/// Exact for both weightings, the angles' derivatives included; zero from degenerate faces. Deterministic: gathers
/// in a fixed order.
///
/// # Panics
/// When a slice does not have one entry per vertex of `incidence`.
pub fn vertex_normals_vjp<T: Real>(
    incidence: &Incidence,
    positions: &[Vec3<T>],
    weighting: Weighting,
    d_normals: &[Vec3<T>],
    d_positions: &mut [Vec3<T>],
) {
    assert_eq!(d_normals.len(), incidence.vertices(), "one normal gradient per vertex");
    assert_eq!(d_positions.len(), incidence.vertices(), "one position gradient per vertex");
    let shares = shares(incidence, positions, weighting);
    let welds = (0..incidence.weld.count()).into_par_iter().with_min_len(GRAIN);
    let d_sums: Vec<Vec3<T>> = welds
        .map(|w| {
            let g = incidence.sum_members(w, Vec3::zero(), |v| d_normals[v]);
            unit_vjp(weighted_sum(incidence, &shares, w), g)
        })
        .collect();
    let faces = incidence.triangles.par_iter().zip(&shares).with_min_len(GRAIN);
    let d_corners: Vec<[Vec3<T>; 3]> = faces
        .map(|(t, share)| {
            let g = t.map(|v| d_sums[incidence.weld.ids[v as usize] as usize]);
            share_vjp(t.map(|v| positions[v as usize]), weighting, share, g)
        })
        .collect();
    gather_corners(incidence, &d_corners, d_positions);
}

/// Adds the gradients of a vertex's corners to the vertex.
pub(crate) fn gather_corners<T: Real>(
    incidence: &Incidence,
    d_corners: &[[Vec3<T>; 3]],
    d_vertices: &mut [Vec3<T>],
) {
    d_vertices.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(v, d)| {
        for &c in incidence.corners_of_vertex.row(v) {
            *d += d_corners[c as usize / 3][c as usize % 3];
        }
    });
}

/// Position gradients of one face, for the gradients `g[k]` of the sums its corners go into.
#[inline(always)]
fn share_vjp<T: Real>(
    p: [Vec3<T>; 3],
    weighting: Weighting,
    share: &Share<T>,
    g: [Vec3<T>; 3],
) -> [Vec3<T>; 3] {
    let Some((e1, e2, scale)) = scaled_edges(p) else { return [Vec3::zero(); 3] };
    let g_normal = g[0] * share.weights[0] + g[1] * share.weights[1] + g[2] * share.weights[2];
    match weighting {
        Weighting::Area => {
            let (d1, d2) = (e2.cross(g_normal) * scale, g_normal.cross(e1) * scale);
            [-(d1 + d2), d1, d2]
        }
        Weighting::Angle => {
            let (n, sine) = (share.normal, e1.cross(e2).length());
            let g_cross = (g_normal - n * n.dot(g_normal)) / sine;
            let (d1, d2) = (e2.cross(g_cross), g_cross.cross(e1));
            let mut d = [-(d1 + d2), d1, d2];
            // The angle at corner k falls as its next corner turns by n x edge, and so for the corner before.
            let turn = [e1, e2 - e1, -e2].map(|e| n.cross(e) / e.length_squared());
            for k in 0..3 {
                let (next, last, g_angle) = ((k + 1) % 3, (k + 2) % 3, n.dot(g[k]));
                d[next] -= turn[k] * g_angle;
                d[last] -= turn[last] * g_angle;
                d[k] += (turn[k] + turn[last]) * g_angle;
            }
            d.map(|d| d / scale)
        }
    }
}

/// Angle-weighted normals of a mesh, smooth across exactly coincident positions.
///
/// # Panics
/// When a triangle names a vertex that does not exist.
pub fn mesh_normals(mesh: &Mesh) -> Vec<Vec3f> {
    let incidence = Incidence::new(&mesh.triangles, &weld_exact(&mesh.positions));
    vertex_normals(&incidence, &mesh.positions, Weighting::Angle)
}

#[cfg(test)]
mod tests;
