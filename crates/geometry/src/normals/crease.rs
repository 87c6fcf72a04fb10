//! Hard edges: vertices are split along them, so that each side has normals of its own.

use crate::adjacency::Edges;
use crate::angle::unit;
use crate::split::Split;
use crate::weld::Weld;
use crate::{Incidence, normals};
use photofit_scalar::{Vec3f, vec3};

/// A mesh split along its hard edges.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Creased {
    /// The split vertices; attributes are copied with [`Split::apply`].
    pub split: Split,
    /// Smoothing groups: output vertices of one id share their normal. A group lies at one place.
    pub smoothing: Weld,
}

/// Splits vertices where hard edges part the surface around them.
///
/// `edges` are those of `triangles` under `weld`; `hard` has one entry per edge. Two corners at a place belong together
/// if a path of triangles joined by soft edges leads from one to the other around it.
///
/// ```
/// use photofit_geometry::{Edges, normals::split_hard_edges, weld::Weld};
/// // Two triangles that share the edge (1, 2).
/// let (triangles, weld) = ([[0, 1, 2], [2, 1, 3]], Weld::identity(4));
/// let edges = Edges::new(&triangles, &weld);
/// let hard: Vec<bool> = edges.vertices.iter().map(|e| *e == [1, 2]).collect();
/// let creased = split_hard_edges(&triangles, &weld, &edges, &hard);
/// assert_eq!(creased.split.source, [0, 1, 2, 3, 2, 1]);
/// assert_eq!(creased.split.triangles, [[0, 1, 2], [4, 5, 3]]);
/// assert_eq!(creased.smoothing.count(), 6);
/// ```
///
/// # Panics
/// When the arguments are not of one mesh, or when the split would exceed 2^32 - 2 vertices.
pub fn split_hard_edges(triangles: &[[u32; 3]], weld: &Weld, edges: &Edges, hard: &[bool]) -> Creased {
    assert_eq!(hard.len(), edges.len(), "one flag per edge");
    assert_eq!(triangles.len(), edges.of_triangle.len(), "the triangles the edges were made of");
    let mut groups = Groups { parent: (0..3 * triangles.len() as u32).collect() };
    for e in (0..edges.len()).filter(|e| !hard[*e]) {
        for pair in edges.half_edges.row(e).windows(2) {
            let [ta, tb] = [pair[0], pair[1]].map(|half| half as usize / 3);
            for end in edges.vertices[e] {
                let corner = |t: usize| (0..3).find(|&k| weld.ids[triangles[t][k] as usize] == end);
                if let (Some(i), Some(j)) = (corner(ta), corner(tb)) {
                    groups.join((3 * ta + i) as u32, (3 * tb + j) as u32);
                }
            }
        }
    }
    // Output vertices: the first group met at a vertex keeps it, later ones append.
    let vertices = weld.vertices();
    let mut split = Split { triangles: triangles.to_vec(), source: (0..vertices as u32).collect() };
    let mut by_vertex: Vec<Vec<(u32, u32)>> = vec![Vec::new(); vertices];
    let mut group_of_output = vec![u32::MAX; vertices];
    for corner in 0..3 * triangles.len() {
        let group = groups.find(corner as u32);
        let vertex = triangles[corner / 3][corner % 3] as usize;
        let known = by_vertex[vertex].iter().find(|(g, _)| *g == group).map(|&(_, v)| v);
        let output = known.unwrap_or_else(|| {
            let output = if by_vertex[vertex].is_empty() { vertex as u32 } else { split.source.len() as u32 };
            if output as usize == split.source.len() {
                split.source.push(vertex as u32);
                group_of_output.push(u32::MAX);
            }
            group_of_output[output as usize] = group;
            by_vertex[vertex].push((group, output));
            output
        });
        split.triangles[corner / 3][corner % 3] = output;
    }
    Creased { split, smoothing: weld_groups(&group_of_output) }
}

/// Angle-weighted normals that are smooth only across edges whose two faces differ by at most `crease` radians.
///
/// Returns the split topology and one unit normal per output vertex (zero where no face contributes). Smoothness is
/// followed through welded positions; a border or non-manifold edge is always hard. A crease of pi or more
/// smooths every inner edge; for loaders of files without normals, pi/3 or so.
///
/// # Panics
/// When a triangle names a vertex outside `weld`, when `positions` does not have one entry per vertex, or when the
/// split would exceed 2^32 - 2 vertices.
pub fn split_creases(
    positions: &[Vec3f],
    triangles: &[[u32; 3]],
    weld: &Weld,
    crease: f32,
) -> (Split, Vec<Vec3f>) {
    assert_eq!(positions.len(), weld.vertices(), "one position per vertex");
    let edges = Edges::new(triangles, weld);
    let face = |t: usize| {
        let [a, b, c] = triangles[t].map(|v| positions[v as usize].cast::<f64>());
        unit((b - a).cross(c - a))
    };
    let limit = f64::from(crease).clamp(0.0, std::f64::consts::PI).cos() - 1e-9;
    let hard: Vec<bool> = (0..edges.len())
        .map(|e| {
            let &[a, b] = edges.half_edges.row(e) else { return true };
            let (na, nb) = (face(a as usize / 3), face(b as usize / 3));
            let degenerate = na.length_squared() == 0.0 || nb.length_squared() == 0.0;
            !degenerate && na.dot(nb) < limit
        })
        .collect();
    let Creased { split, smoothing } = split_hard_edges(triangles, weld, &edges, &hard);
    let moved: Vec<Vec3f> = split.source.iter().map(|&v| positions[v as usize]).collect();
    let incidence = Incidence::new(&split.triangles, &smoothing);
    let smooth = normals::vertex_normals(&incidence, &moved, normals::Weighting::Angle);
    debug_assert!(smooth.iter().all(|n| *n == vec3(0.0, 0.0, 0.0) || n.is_finite()), "normals are finite");
    (split, smooth)
}

/// Welds output vertices of one smoothing group (which meet at one welded position); unused vertices stay alone.
fn weld_groups(group_of_output: &[u32]) -> Weld {
    let largest = group_of_output.iter().filter(|&&g| g != u32::MAX).max().map_or(0, |&g| g as usize + 1);
    let mut id_of_group = vec![u32::MAX; largest];
    let mut weld = Weld::default();
    for (v, &group) in group_of_output.iter().enumerate() {
        let fresh = weld.first.len() as u32;
        let id = match id_of_group.get_mut(group as usize) {
            Some(id) if *id != u32::MAX => *id,
            Some(id) => {
                *id = fresh;
                fresh
            }
            None => fresh,
        };
        if id == fresh {
            weld.first.push(v as u32);
        }
        weld.ids.push(id);
    }
    weld
}

/// Disjoint sets of corners; the lowest corner names its set.
struct Groups {
    parent: Vec<u32>,
}

impl Groups {
    fn find(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let up = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = up;
            i = up;
        }
        i
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        let (low, high) = (a.min(b), a.max(b));
        self.parent[high as usize] = low;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::weld::weld_exact;

    #[test]
    fn a_cube_keeps_its_hard_edges_below_ninety_degrees() {
        let cube = shapes::cube();
        let weld = weld_exact(&cube.positions);
        // One vertex per corner: the crease angle has to make the 24 again.
        let (positions, triangles) = (weld.pick(&cube.positions), weld.triangles(&cube.triangles));
        let welded = Weld::identity(8);
        let (hard, normals) = split_creases(&positions, &triangles, &welded, 1.0);
        assert_eq!((hard.source.len(), hard.triangles.len()), (24, 12));
        for t in &hard.triangles {
            let [a, b, c] = t.map(|v| positions[hard.source[v as usize] as usize]);
            let n = unit((b - a).cross(c - a));
            assert!(t.iter().all(|&v| (normals[v as usize] - n).length() < 1e-6), "{t:?}");
        }
        let (soft, _) = split_creases(&positions, &triangles, &welded, 1.6);
        assert_eq!((soft.source.len(), &soft.triangles), (8, &triangles));
        // Already split vertices stay split but share their normal where the surface is smooth.
        let (seam, normals) = split_creases(&cube.positions, &cube.triangles, &weld, 1.6);
        assert_eq!(seam.source.len(), 24);
        assert!(
            normals.iter().zip(&cube.positions).all(|(n, p)| (*n - p.normalize_or_zero()).length() < 1e-6)
        );
    }

    #[test]
    fn unused_and_degenerate_input_is_harmless() {
        let positions =
            [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(f32::NAN, 0.0, 0.0)];
        let (split, normals) =
            split_creases(&positions, &[[0, 1, 2], [0, 1, 1], [0, 3, 3]], &Weld::identity(4), 0.5);
        assert!(normals.iter().all(|n| n.is_finite()));
        assert_eq!(normals[split.triangles[0][1] as usize], vec3(0.0, 0.0, 1.0));
    }

    #[test]
    fn a_hard_edge_that_ends_on_the_surface_splits_only_what_it_parts() {
        // A fan of six triangles around vertex 0 with one hard spoke: the surface around the vertex stays one piece.
        let triangles: Vec<[u32; 3]> = (0..6).map(|k| [0, 1 + k, 1 + (k + 1) % 6]).collect();
        let weld = Weld::identity(7);
        let edges = Edges::new(&triangles, &weld);
        let split = |spokes: &[u32]| {
            let hard: Vec<bool> =
                edges.vertices.iter().map(|e| e[0] == 0 && spokes.contains(&e[1])).collect();
            split_hard_edges(&triangles, &weld, &edges, &hard)
        };
        let none = split(&[]);
        assert_eq!((none.split.triangles, none.smoothing), (triangles.clone(), weld.clone()));
        assert_eq!(split(&[1]).split.source.len(), 8, "only the outer end is split");
        assert_eq!(split(&[1, 4]).split.source.len(), 10, "both outer ends and the centre");
    }
}
