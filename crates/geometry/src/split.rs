//! Splitting vertices: a new triangle list with the source vertex of every output vertex.

use crate::Mesh;

/// A mesh topology in which some vertices were duplicated.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Triangles in output vertices; same order as the input's.
    pub triangles: Vec<[u32; 3]>,
    /// Input vertex of each output vertex; the first entries are the input's vertices in order.
    pub source: Vec<u32>,
}

impl Split {
    /// `mesh` with the split applied: every attribute is copied from the source vertices.
    ///
    /// # Panics
    /// When the split was made for another mesh.
    pub fn apply(&self, mesh: &Mesh) -> Mesh {
        fn pick<A: Copy>(values: &[A], source: &[u32]) -> Vec<A> {
            if values.is_empty() { Vec::new() } else { source.iter().map(|&v| values[v as usize]).collect() }
        }
        Mesh {
            positions: pick(&mesh.positions, &self.source),
            normals: pick(&mesh.normals, &self.source),
            uvs: pick(&mesh.uvs, &self.source),
            uvs1: pick(&mesh.uvs1, &self.source),
            tangents: pick(&mesh.tangents, &self.source),
            colors: pick(&mesh.colors, &self.source),
            triangles: self.triangles.clone(),
        }
    }
}
