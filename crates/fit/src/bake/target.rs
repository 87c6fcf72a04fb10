//! The target mesh: checks, points and frames on it.

use super::BakeError;
use super::reference::attribute;
use photofit_geometry::Mesh;
use photofit_rays::AccelError;
use photofit_scalar::{Real, Vec3f, vec3};

/// Least z of a baked normal: beyond it the shading would clamp.
const LEAST_Z: f32 = 1e-3;

/// A point of the target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) position: Vec3f,
    /// Unit normal along which to look.
    pub(super) normal: Vec3f,
}

/// The interpolated tangent frame at a texel, as shading uses it: nothing renormalised.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    tangent: Vec3f,
    bitangent: Vec3f,
    normal: Vec3f,
}

/// Checks lengths, indices and values.
pub(super) fn check(mesh: &Mesh) -> Result<(), BakeError> {
    if mesh.triangles.is_empty() {
        return Err(BakeError::Empty { what: "target" });
    }
    let n = mesh.positions.len();
    attribute("target", "normals", mesh.normals.len(), n, true)?;
    attribute("target", "tangents", mesh.tangents.len(), n, true)?;
    attribute("target", "uvs", mesh.uvs.len(), n, true)?;
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&i| i as usize >= n) {
            let source = AccelError::Index { triangle, index, vertices: n };
            return Err(BakeError::Geometry { mesh: "target", source });
        }
    }
    for v in 0..n {
        let finite = [
            ("position", mesh.positions[v].is_finite()),
            ("normal", mesh.normals[v].is_finite()),
            ("tangent", mesh.tangents[v].is_finite()),
            ("uv", mesh.uvs[v].is_finite()),
        ];
        if let Some((what, _)) = finite.into_iter().find(|(_, ok)| !ok) {
            return Err(BakeError::NonFinite { mesh: "target", what, vertex: v });
        }
    }
    Ok(())
}

/// The point with barycentric weights `w`; `None` where neither the vertices nor the face have a normal.
///
/// It looks along the interpolated `directions`, one per vertex; `face_share` in [0, 1] mixes the face normal into the direction.
pub(super) fn point(
    mesh: &Mesh,
    directions: &[Vec3f],
    triangle: usize,
    w: [f32; 3],
    face_share: f32,
) -> Option<Point> {
    let t = mesh.triangles[triangle].map(|i| i as usize);
    let [a, b, c] = t.map(|i| mesh.positions[i]);
    let face = (b - a).cross(c - a).normalize_or_zero();
    let smooth =
        (directions[t[0]] * w[0] + directions[t[1]] * w[1] + directions[t[2]] * w[2]).normalize_or_zero();
    // Normals that lean away from their own face are of no use.
    let smooth = if smooth.dot(face) < 0.1 && face != Vec3f::zero() { face } else { smooth };
    let normal = (smooth * (1.0 - face_share) + face * face_share).normalize_or_zero();
    let usable = normal != Vec3f::zero();
    usable.then(|| Point { position: a * w[0] + b * w[1] + c * w[2], normal })
}

impl Frame {
    /// The frame at the point with barycentric weights `w`.
    pub(super) fn new(mesh: &Mesh, triangle: usize, w: [f32; 3]) -> Self {
        let t = mesh.triangles[triangle].map(|i| i as usize);
        let normal = mesh.normals[t[0]] * w[0] + mesh.normals[t[1]] * w[1] + mesh.normals[t[2]] * w[2];
        let tangent = mesh.tangents[t[0]].xyz() * w[0]
            + mesh.tangents[t[1]].xyz() * w[1]
            + mesh.tangents[t[2]].xyz() * w[2];
        let bitangent = normal.cross(tangent) * mesh.tangents[t[0]].w;
        Self { tangent, bitangent, normal }
    }

    /// Unit tangent-space normal that shading turns into the direction `n`: the solution of `[T B N] x = n`.
    ///
    /// Directions below the surface are bent up to the horizon; a degenerate frame answers with the flat normal.
    pub(super) fn express(&self, n: Vec3f) -> Vec3f {
        // Cramer's rule by rows of cofactors.
        let [t, b, m]: [photofit_scalar::Vec3<f64>; 3] =
            [self.tangent, self.bitangent, self.normal].map(Vec3f::cast);
        let n: photofit_scalar::Vec3<f64> = n.cast();
        let det = t.dot(b.cross(m));
        let size = t.length() * b.length() * m.length();
        let flat = vec3(0.0, 0.0, 1.0);
        if det.abs() <= 1e-6 * size || det == 0.0 {
            return flat;
        }
        let x = vec3(n.dot(b.cross(m)), n.dot(m.cross(t)), n.dot(t.cross(b))) * (1.0 / det);
        let x = x.normalize_or_zero();
        let lifted = vec3(x.x, x.y, x.z.max(f64::of(f64::from(LEAST_Z)))).normalize_or_zero();
        let out: Vec3f = lifted.cast();
        if out == Vec3f::zero() { flat } else { out }
    }
}
