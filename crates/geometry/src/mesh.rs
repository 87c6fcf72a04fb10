//! The indexed triangle mesh.

use photofit_scalar::{Vec2f, Vec3f, Vec4f};

/// An indexed triangle mesh with optional vertex attributes.
///
/// Every attribute array is empty (absent) or has one entry per position. Right-handed, counter-clockwise front
/// faces; uv origin at the upper left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, in the asset's units.
    pub positions: Vec<Vec3f>,
    /// Unit vertex normals, or empty.
    pub normals: Vec<Vec3f>,
    /// First set of texture coordinates, or empty.
    pub uvs: Vec<Vec2f>,
    /// Second set of texture coordinates, or empty.
    pub uvs1: Vec<Vec2f>,
    /// Unit tangents, `w` = handedness (+1 or -1): bitangent = w * cross(normal, tangent); or empty.
    pub tangents: Vec<Vec4f>,
    /// Linear vertex colours with alpha, or empty.
    pub colors: Vec<Vec4f>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Smallest box around the positions, `(min, max)`; `None` without positions.
    pub fn bounds(&self) -> Option<(Vec3f, Vec3f)> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p))))
    }

    /// Name and length of the first list of attributes that holds neither nothing nor one value a vertex.
    pub fn misfit(&self) -> Option<(&'static str, usize)> {
        let lists = [
            ("normals", self.normals.len()),
            ("uvs", self.uvs.len()),
            ("uvs1", self.uvs1.len()),
            ("tangents", self.tangents.len()),
            ("colors", self.colors.len()),
        ];
        lists.into_iter().find(|(_, length)| *length != 0 && *length != self.positions.len())
    }

    /// Positions of the corners of triangle `t`.
    #[inline]
    pub fn corners(&self, t: usize) -> [Vec3f; 3] {
        self.triangles[t].map(|i| self.positions[i as usize])
    }
}
