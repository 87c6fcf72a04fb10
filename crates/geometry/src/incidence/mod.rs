//! Which triangle corners meet at which vertex: the gather lists behind normals and tangents.

#[cfg(feature = "gpu")]
pub(crate) mod gpu;

use crate::csr::Csr;
use crate::weld::Weld;

/// Triangles together with the corner lists that turn scatters into deterministic gathers.
///
/// A corner is named `3 * triangle + k`. Made once per topology and reused in every step of a fit.
#[derive(Clone, Debug, Default)]
pub struct Incidence {
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices to welded ids.
    pub weld: Weld,
    /// Corners at each vertex, ascending.
    pub corners_of_vertex: Csr,
    /// Corners at each welded id, ascending; empty where the weld is the identity (use the line above).
    corners_of_weld: Csr,
    /// Vertices of each welded id, ascending; empty where the weld is the identity.
    members: Csr,
}

impl Incidence {
    /// Builds the lists; linear time.
    ///
    /// # Panics
    /// When a triangle names a vertex outside the weld, or above 2^32 - 2 corners; see
    /// [`check_triangles`](crate::check_triangles).
    pub fn new(triangles: &[[u32; 3]], weld: &Weld) -> Self {
        let corners = triangles.as_flattened();
        let corners_of_vertex = Csr::group(weld.vertices(), corners.iter().copied());
        let (corners_of_weld, members) = if weld.is_identity() {
            (Csr::default(), Csr::default())
        } else {
            (Csr::group(weld.count(), corners.iter().map(|&v| weld.ids[v as usize])), weld.members())
        };
        Self {
            triangles: triangles.to_vec(),
            weld: weld.clone(),
            corners_of_vertex,
            corners_of_weld,
            members,
        }
    }

    /// Number of (unwelded) vertices.
    pub fn vertices(&self) -> usize {
        self.weld.vertices()
    }

    /// Corners at welded id `w`, ascending.
    #[inline(always)]
    pub fn corners_of_weld(&self, w: usize) -> &[u32] {
        if self.weld.is_identity() { self.corners_of_vertex.row(w) } else { self.corners_of_weld.row(w) }
    }

    /// Vertices of each welded id, ascending.
    #[cfg(feature = "gpu")]
    fn members(&self) -> Csr {
        if self.weld.is_identity() { self.weld.members() } else { self.members.clone() }
    }

    /// Sum over the vertices of welded id `w` of `value(vertex)`, in ascending order.
    #[inline(always)]
    pub(crate) fn sum_members<V: std::ops::AddAssign>(
        &self,
        w: usize,
        zero: V,
        value: impl Fn(usize) -> V,
    ) -> V {
        let mut sum = zero;
        if self.weld.is_identity() {
            sum += value(w);
        } else {
            for &v in self.members.row(w) {
                sum += value(v as usize);
            }
        }
        sum
    }
}
