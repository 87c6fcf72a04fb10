//! Edges, triangle neighbours, one-rings and borders of a triangle mesh, by welded position.
//!
//! Edge `k` of a triangle joins its corners `k` and `(k + 1) % 3`; the corner opposite to it is `(k + 2) % 3`. A
//! half-edge is named `3 * triangle + k`. Triangles with two welded-equal corners are left out of the topology.

use crate::csr::Csr;
use crate::weld::Weld;

/// Marks a missing neighbour, vertex or edge.
pub const NONE: u32 = u32::MAX;

/// The undirected edges of a mesh, sorted by their welded vertex ids.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// Welded ids `[a, b]` of each edge, `a < b`, in ascending order.
    pub vertices: Vec<[u32; 2]>,
    /// Half-edges `3 * triangle + k` on each edge, ascending. One: border; two: manifold; more: non-manifold.
    pub half_edges: Csr,
    /// Edge of each triangle's edge `k`; [`NONE`] in degenerate triangles.
    pub of_triangle: Vec<[u32; 3]>,
    welded: usize,
}

impl Edges {
    /// Finds the edges of `triangles` (vertex indices) under `weld`. Linear time: counting sort by the lower id.
    ///
    /// ```
    /// use photofit_geometry::{adjacency::Edges, weld::Weld};
    /// let edges = Edges::new(&[[0, 1, 2], [2, 1, 3]], &Weld::identity(4));
    /// assert_eq!(edges.vertices, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]);
    /// assert_eq!(edges.triangles(2), [Some(0), Some(1)]);
    /// ```
    ///
    /// # Panics
    /// When a triangle names a vertex outside the weld, or above 2^32 - 2 half-edges; see
    /// [`check_triangles`](crate::check_triangles).
    pub fn new(triangles: &[[u32; 3]], weld: &Weld) -> Self {
        assert!(3 * (triangles.len() as u64) < u64::from(u32::MAX), "half-edges are counted in 32 bits");
        let welded = weld.triangles(triangles);
        let mut start = vec![0_u32; weld.count() + 1];
        let half_edges = |t: &[u32; 3]| {
            let proper = t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            let [a, b, c] = *t;
            proper.then_some([(a.min(b), a.max(b)), (b.min(c), b.max(c)), (c.min(a), c.max(a))])
        };
        for ends in welded.iter().filter_map(half_edges) {
            for (low, _) in ends {
                start[low as usize + 1] += 1;
            }
        }
        for i in 0..weld.count() {
            start[i + 1] += start[i];
        }
        let mut next = start.clone();
        let mut sorted = vec![(0_u32, 0_u32); start[weld.count()] as usize];
        for (t, ends) in welded.iter().enumerate() {
            for (k, (low, high)) in half_edges(ends).into_iter().flatten().enumerate() {
                let slot = &mut next[low as usize];
                sorted[*slot as usize] = (high, (3 * t + k) as u32);
                *slot += 1;
            }
        }
        let mut edges = Self {
            vertices: Vec::with_capacity(sorted.len() / 2 + 1),
            half_edges: Csr {
                offsets: Vec::with_capacity(sorted.len() / 2 + 2),
                items: Vec::with_capacity(sorted.len()),
            },
            of_triangle: vec![[NONE; 3]; triangles.len()],
            welded: weld.count(),
        };
        for low in 0..weld.count() {
            let bucket = &mut sorted[start[low] as usize..start[low + 1] as usize];
            bucket.sort_unstable();
            let mut previous = NONE;
            for &(high, half) in bucket.iter() {
                if high != previous {
                    edges.half_edges.offsets.push(edges.half_edges.items.len() as u32);
                    edges.vertices.push([low as u32, high]);
                    previous = high;
                }
                edges.half_edges.items.push(half);
                edges.of_triangle[half as usize / 3][half as usize % 3] = edges.vertices.len() as u32 - 1;
            }
        }
        edges.half_edges.offsets.push(edges.half_edges.items.len() as u32);
        edges
    }

    /// Number of edges.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Whether there is no edge.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// The first two triangles on edge `e`.
    pub fn triangles(&self, e: usize) -> [Option<u32>; 2] {
        let halves = self.half_edges.row(e);
        [0, 1].map(|i| halves.get(i).map(|h| h / 3))
    }

    /// Whether edge `e` has exactly one triangle.
    #[inline]
    pub fn is_border(&self, e: usize) -> bool {
        self.half_edges.row(e).len() == 1
    }

    /// Whether edge `e` has three triangles or more.
    #[inline]
    pub fn is_non_manifold(&self, e: usize) -> bool {
        self.half_edges.row(e).len() > 2
    }

    /// For each triangle and edge `k`: the triangle on the other side, [`NONE`] on borders, non-manifold edges and
    /// degenerate triangles.
    pub fn triangle_neighbours(&self) -> Vec<[u32; 3]> {
        let across = |half: u32, e: u32| match (e != NONE).then(|| self.half_edges.row(e as usize)) {
            Some(&[a, b]) => (if a == half { b } else { a }) / 3,
            _ => NONE,
        };
        let of = |(t, edges): (usize, &[u32; 3])| [0, 1, 2].map(|k| across((3 * t + k) as u32, edges[k]));
        self.of_triangle.iter().enumerate().map(of).collect()
    }

    /// For each triangle and edge `k`: the vertex opposite to that edge in the triangle on the other side, as an
    /// index into the unwelded vertices, or [`NONE`].
    ///
    /// Triangles that repeat each other (the two sides of a card) count once: the answer is a vertex where exactly
    /// two different welded vertices face the edge, and [`NONE`] on borders, where more surfaces meet, and in
    /// degenerate triangles. Among repeats the lowest half-edge answers. Used by silhouette antialiasing.
    ///
    /// # Panics
    /// When `triangles` and `weld` are not those the edges were made of.
    pub fn opposite_vertices(&self, triangles: &[[u32; 3]], weld: &Weld) -> Vec<[u32; 3]> {
        assert_eq!(triangles.len(), self.of_triangle.len(), "the triangles the edges were made of");
        let facing = |half: u32| triangles[half as usize / 3][(half as usize % 3 + 2) % 3];
        let mut opposite = vec![[NONE; 3]; triangles.len()];
        for e in 0..self.len() {
            let halves = self.half_edges.row(e);
            let id = |half: u32| weld.ids[facing(half) as usize];
            let one = halves[0];
            let Some(&two) = halves.iter().find(|&&h| id(h) != id(one)) else { continue };
            if halves.iter().any(|&h| id(h) != id(one) && id(h) != id(two)) {
                continue;
            }
            for &h in halves {
                let other = if id(h) == id(one) { two } else { one };
                opposite[h as usize / 3][h as usize % 3] = facing(other);
            }
        }
        opposite
    }

    /// Neighbours of each welded vertex, ascending and without repeats.
    pub fn one_rings(&self) -> Csr {
        let mut offsets = vec![0_u32; self.welded + 1];
        for &[a, b] in &self.vertices {
            offsets[a as usize + 1] += 1;
            offsets[b as usize + 1] += 1;
        }
        for i in 0..self.welded {
            offsets[i + 1] += offsets[i];
        }
        let mut next = offsets.clone();
        let mut items = vec![0_u32; 2 * self.len()];
        // Edges ascend by (a, b): lower neighbours of a vertex come in order, and so do the higher ones. Writing all
        // lower neighbours first keeps each row sorted.
        for swap in [true, false] {
            for &[a, b] in &self.vertices {
                let (row, item) = if swap { (b, a) } else { (a, b) };
                let slot = &mut next[row as usize];
                items[*slot as usize] = item;
                *slot += 1;
            }
        }
        Csr { offsets, items }
    }

    /// Which welded vertices lie on a border edge.
    pub fn border_vertices(&self) -> Vec<bool> {
        let mut border = vec![false; self.welded];
        for e in (0..self.len()).filter(|&e| self.is_border(e)) {
            for v in self.vertices[e] {
                border[v as usize] = true;
            }
        }
        border
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::weld::weld_exact;

    #[test]
    fn a_closed_surface_has_eulers_numbers() {
        let sphere = shapes::icosphere(7);
        let edges = Edges::new(&sphere.triangles, &weld_exact(&sphere.positions));
        assert_eq!(edges.len(), sphere.triangles.len() * 3 / 2);
        assert!((0..edges.len()).all(|e| !edges.is_border(e) && !edges.is_non_manifold(e)));
        assert!(edges.border_vertices().iter().all(|b| !b));
        let neighbours = edges.triangle_neighbours();
        for (t, n) in neighbours.iter().enumerate() {
            assert!(n.iter().all(|&n| neighbours[n as usize].contains(&(t as u32))), "triangle {t}");
        }
        let rings = edges.one_rings();
        for v in 0..rings.rows() {
            assert!(rings.row(v).is_sorted_by(|a, b| a < b), "ring {v}");
            assert!([5, 6].contains(&rings.row(v).len()), "ring {v}");
        }
        assert_eq!((0..rings.rows()).filter(|&v| rings.row(v).len() == 5).count(), 12);
    }

    #[test]
    fn seams_are_crossed_by_position() {
        let cube = shapes::cube();
        let weld = weld_exact(&cube.positions);
        let edges = Edges::new(&cube.triangles, &weld);
        assert_eq!((weld.count(), edges.len()), (8, 18));
        assert!((0..18).all(|e| edges.triangles(e).iter().all(Option::is_some)));
        let opposite = edges.opposite_vertices(&cube.triangles, &weld);
        for (t, o) in opposite.iter().enumerate() {
            for k in 0..3 {
                let n = edges.triangle_neighbours()[t][k] as usize;
                let corner = cube.triangles[n].iter().find(|&&v| {
                    let ends = [k, (k + 1) % 3].map(|c| weld.ids[cube.triangles[t][c] as usize]);
                    !ends.contains(&weld.ids[v as usize])
                });
                assert_eq!(corner, Some(&o[k]), "triangle {t} edge {k}");
            }
        }
        let alone = Edges::new(&cube.triangles, &Weld::identity(24));
        assert_eq!((0..alone.len()).filter(|&e| alone.is_border(e)).count(), 24);
    }

    #[test]
    fn borders_repeats_and_fans() {
        // A strip of two triangles, both sides modelled: inner edge crossed, outer edges open.
        let card = [[0, 1, 2], [2, 1, 3], [0, 2, 1], [2, 3, 1]];
        let weld = Weld::identity(4);
        let edges = Edges::new(&card, &weld);
        let opposite = edges.opposite_vertices(&card, &weld);
        assert_eq!(opposite[0], [NONE, 3, NONE]);
        assert_eq!(opposite[1], [0, NONE, NONE]);
        assert_eq!(opposite[2], [NONE, 3, NONE]);
        // Three different surfaces at one edge, and a degenerate triangle.
        let fan = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [0, 0, 1]];
        let weld = Weld::identity(6);
        let edges = Edges::new(&fan, &weld);
        assert!(edges.is_non_manifold(0));
        assert_eq!(edges.opposite_vertices(&fan, &weld)[0], [NONE; 3]);
        assert_eq!(edges.of_triangle[3], [NONE; 3]);
        assert_eq!(edges.border_vertices(), [true, true, true, true, true, false]);
        assert!(Edges::new(&[], &Weld::identity(0)).is_empty());
    }

    #[test]
    #[ignore = "measurement"]
    fn a_million_triangles() {
        let sphere = shapes::icosphere(224);
        let start = std::time::Instant::now();
        let weld = weld_exact(&sphere.positions);
        let welded = start.elapsed();
        let edges = Edges::new(&sphere.triangles, &weld);
        let made = start.elapsed();
        let opposite = edges.opposite_vertices(&sphere.triangles, &weld);
        println!(
            "{} triangles: weld {welded:?}, edges {:?}, opposite {:?}",
            opposite.len(),
            made - welded,
            start.elapsed() - made
        );
    }
}
