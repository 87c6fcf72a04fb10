//! Normals with hard edges: vertices are split where faces meet at more than a crease angle.

use crate::adjacency::Edges;
use crate::angle::unit;
use crate::split::Split;
use crate::weld::Weld;
use crate::{Incidence, normals};
use photofit_scalar::{Vec3f, vec3};

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
    let mut groups = Groups { parent: (0..3 * triangles.len() as u32).collect() };
    for e in 0..edges.len() {
        let &[a, b] = edges.half_edges.row(e) else { continue };
        let (ta, tb) = (a as usize / 3, b as usize / 3);
        let (na, nb) = (face(ta), face(tb));
        let degenerate = na.length_squared() == 0.0 || nb.length_squared() == 0.0;
        if !degenerate && na.dot(nb) < limit {
            continue;
        }
        for end in edges.vertices[e] {
            let corner = |t: usize| (0..3).find(|&k| weld.ids[triangles[t][k] as usize] == end);
            if let (Some(i), Some(j)) = (corner(ta), corner(tb)) {
                groups.join((3 * ta + i) as u32, (3 * tb + j) as u32);
            }
        }
    }
    // Output vertices: the first group met at a vertex keeps it, later ones append.
    let mut split = Split { triangles: triangles.to_vec(), source: (0..positions.len() as u32).collect() };
    let mut by_vertex: Vec<Vec<(u32, u32)>> = vec![Vec::new(); positions.len()];
    let mut group_of_output = vec![u32::MAX; positions.len()];
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
    let shared = weld_groups(&group_of_output);
    let moved: Vec<Vec3f> = split.source.iter().map(|&v| positions[v as usize]).collect();
    let incidence = Incidence::new(&split.triangles, &shared);
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
}
