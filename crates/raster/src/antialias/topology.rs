//! Topology of a mesh for silhouettes, built once.

use super::Topology;
use photofit_geometry::{Edges, weld::weld_exact};
use photofit_scalar::Vec3;

/// Triangles, and for each of their edges what lies across: the arrays that a [`Topology`] borrows.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshTopology {
    triangles: Vec<[u32; 3]>,
    opposite: Vec<[u32; 3]>,
    neighbour: Vec<[u32; 3]>,
}

impl MeshTopology {
    /// Joins the triangles along edges whose ends have exactly equal positions, so that vertices split for their texture
    /// coordinates or normals make no silhouette. Positions may move afterwards.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn new(triangles: &[[u32; 3]], positions: &[Vec3<f32>]) -> Self {
        let weld = weld_exact(positions);
        let edges = Edges::new(triangles, &weld);
        Self {
            triangles: triangles.to_vec(),
            opposite: edges.opposite_vertices(triangles, &weld),
            neighbour: edges.triangle_neighbours(),
        }
    }

    /// What the rasterizer takes.
    pub fn topology(&self) -> Topology<'_> {
        Topology { triangles: &self.triangles, opposite: &self.opposite, neighbour: &self.neighbour }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rasterize::NONE;
    use photofit_scalar::vec3;

    #[test]
    fn split_vertices_are_joined() {
        // A square of two triangles that share no index; the diagonal runs from (0, 0) to (1, 1).
        let at = |x: f32, y: f32| vec3(x, y, 0.0);
        let positions = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        let mesh = MeshTopology::new(&[[0, 1, 2], [3, 4, 5]], &positions);
        let t = mesh.topology();
        assert_eq!(t.neighbour, [[NONE, NONE, 1], [0, NONE, NONE]]);
        assert_eq!((t.opposite[0][2], t.opposite[1][0]), (5, 1));
        assert_eq!(t.triangles, [[0, 1, 2], [3, 4, 5]]);
    }
}
