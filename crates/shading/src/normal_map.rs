//! Shading normals: tangent-space normal maps, and normals that face the viewer.

use photofit_scalar::{Real, Vec3};

/// `n.wo` below which [`face_viewer`] bends a normal (2.9 degrees above the horizon).
pub const BEND_START: f64 = 0.05;

/// Gradient of [`perturb`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PerturbGradient<T = f32> {
    /// With respect to the interpolated normal.
    pub normal: Vec3<T>,
    /// With respect to the interpolated tangent.
    pub tangent: Vec3<T>,
    /// With respect to the texel.
    pub map: Vec3<T>,
}

/// Gradient of [`face_viewer`] (the geometric normal only decides the side and has none).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaceViewerGradient<T = f32> {
    /// With respect to the shading normal.
    pub normal: Vec3<T>,
    /// With respect to the direction to the viewer.
    pub wo: Vec3<T>,
}

/// Unit shading normal `normalize(T x + B y + N max(z, 0))` with `B = handedness N x T`.
///
/// The convention of `MikkTSpace`: `normal` and `tangent` are the interpolated vertex vectors, not renormalised
/// here or before; `handedness` is +1 or -1 (the w of a glTF tangent). `map` is the decoded texel in `[-1, 1]`
/// with y up (glTF). Where everything vanishes the result is the zero vector.
#[inline(always)]
pub fn perturb<T: Real>(normal: Vec3<T>, tangent: Vec3<T>, handedness: T, map: Vec3<T>) -> Vec3<T> {
    let bitangent = normal.cross(tangent) * handedness;
    (tangent * map.x + bitangent * map.y + normal * map.z.relu()).normalize_or_zero()
}

/// Adjoint of [`perturb`] for the gradient `g` of the unit normal.
#[inline(always)]
pub fn perturb_vjp<T: Real>(
    normal: Vec3<T>,
    tangent: Vec3<T>,
    handedness: T,
    map: Vec3<T>,
    g: Vec3<T>,
) -> PerturbGradient<T> {
    let bitangent = normal.cross(tangent) * handedness;
    let z = map.z.relu();
    let g = (tangent * map.x + bitangent * map.y + normal * z).normalize_vjp(g);
    let g_cross = g * (map.y * handedness);
    PerturbGradient {
        normal: g * z + tangent.cross(g_cross),
        tangent: g * map.x + g_cross.cross(normal),
        map: Vec3 {
            x: g.dot(tangent),
            y: g.dot(bitangent),
            z: if map.z > T::zero() { g.dot(normal) } else { T::zero() },
        },
    }
}

/// The unit normal on the viewer's side.
///
/// Where the geometric normal `n_geometric` (any length) points away from `wo` the surface is seen from behind and
/// the shading normal is negated. Where the shading normal then still leaves less than `e =` [`BEND_START`] of
/// cosine, it is bent towards the viewer: `d = n.wo < e` becomes `n' = normalize(n + (e^2 / (2 e - d) - d) wo)`,
/// which keeps `n'.wo > 0` and joins with a continuous derivative. `n` and `wo` are unit vectors.
#[inline(always)]
pub fn face_viewer<T: Real>(n: Vec3<T>, n_geometric: Vec3<T>, wo: Vec3<T>) -> Vec3<T> {
    let n = if n_geometric.dot(wo) < T::zero() { -n } else { n };
    let d = n.dot(wo);
    if d >= T::of(BEND_START) { n } else { (n + wo * bend(d).0).normalize_or_zero() }
}

/// Adjoint of [`face_viewer`] for the gradient `g` of its result.
#[inline(always)]
pub fn face_viewer_vjp<T: Real>(
    n: Vec3<T>,
    n_geometric: Vec3<T>,
    wo: Vec3<T>,
    g: Vec3<T>,
) -> FaceViewerGradient<T> {
    let flipped = n_geometric.dot(wo) < T::zero();
    let n = if flipped { -n } else { n };
    let d = n.dot(wo);
    let (g_n, g_wo) = if d >= T::of(BEND_START) {
        (g, Vec3::zero())
    } else {
        let (add, d_add) = bend(d);
        let g = (n + wo * add).normalize_vjp(g);
        let g_d = g.dot(wo) * d_add;
        (g + wo * g_d, g * add + n * g_d)
    };
    FaceViewerGradient { normal: if flipped { -g_n } else { g_n }, wo: g_wo }
}

/// How much of `wo` is added for the cosine `d`, and its derivative.
#[inline(always)]
fn bend<T: Real>(d: T) -> (T, T) {
    let e = T::of(BEND_START);
    let r = e / (e + e - d);
    (e * r - d, r * r - T::one())
}
