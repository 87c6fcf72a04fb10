//! Triangles whose vertex normals point to their back.
//!
//! Renderers tell front from back by the winding and shade with the normals that a file has: where the two oppose each
//! other, light from behind counts. No normal map turns the normals that follow from the winding that far.

use crate::weld::weld_exact;
use crate::{Edges, Mesh, NONE};
use photofit_scalar::Vec3f;

/// Share of the asset's area below which such triangles are flaws of single faces: they stay as they are.
const LEAST_SHARE: f64 = 1e-3;

/// Whether the normals of each triangle of a mesh, which has one per vertex, point to its back; empty where that holds for
/// none of any weight (a thousandth of the area).
///
/// What decides is the sum over a piece of the mesh, all that edges join whose two triangles turn the same way: a single
/// triangle at the rim of a smooth surface may lean away from its normals.
pub fn opposed(mesh: &Mesh) -> Vec<bool> {
    let facing: Vec<[f64; 2]> = (0..mesh.triangles.len()).map(|t| facing(mesh, t)).collect();
    if facing.iter().all(|[along, _]| *along >= 0.0) {
        return Vec::new();
    }
    let piece = pieces(mesh);
    let mut sums = vec![0.0; mesh.triangles.len()];
    for (p, [along, _]) in piece.iter().zip(&facing) {
        sums[*p as usize] += along;
    }
    let flags: Vec<bool> = piece.iter().map(|p| sums[*p as usize] < 0.0).collect();
    let area = |of: &dyn Fn(usize) -> bool| -> f64 {
        facing.iter().enumerate().filter(|(t, _)| of(*t)).map(|(_, [_, area])| area).sum()
    };
    if area(&|t| flags[t]) > LEAST_SHARE * area(&|_| true) { flags } else { Vec::new() }
}

/// The share of a triangle's normals along its front, times its area; and its area, both doubled.
fn facing(mesh: &Mesh, triangle: usize) -> [f64; 2] {
    let [a, b, c] = mesh.corners(triangle).map(Vec3f::cast::<f64>);
    let face = (b - a).cross(c - a);
    let normals = mesh.triangles[triangle].map(|v| mesh.normals[v as usize].cast::<f64>());
    let mean = (normals[0] + normals[1] + normals[2]).normalize_or_zero();
    let values = [face.dot(mean), face.length()];
    if values.iter().all(|v| v.is_finite()) { values } else { [0.0; 2] }
}

/// The piece of each triangle, named by one of its triangles.
fn pieces(mesh: &Mesh) -> Vec<u32> {
    let weld = weld_exact(&mesh.positions);
    let edges = Edges::new(&mesh.triangles, &weld);
    let start = |half: u32| weld.ids[mesh.triangles[half as usize / 3][half as usize % 3] as usize];
    let across = |half: u32, e: u32| match (e != NONE).then(|| edges.half_edges.row(e as usize)) {
        Some(&[a, b]) if start(a) != start(b) => Some((if a == half { b } else { a }) / 3),
        _ => None,
    };
    let mut piece = vec![NONE; mesh.triangles.len()];
    let mut open = Vec::new();
    for first in 0..piece.len() as u32 {
        if piece[first as usize] != NONE {
            continue;
        }
        piece[first as usize] = first;
        open.push(first);
        while let Some(t) = open.pop() {
            for k in 0..3 {
                let next = across(3 * t + k, edges.of_triangle[t as usize][k as usize]);
                if let Some(n) = next.filter(|n| piece[*n as usize] == NONE) {
                    piece[n as usize] = first;
                    open.push(n);
                }
            }
        }
    }
    piece
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use photofit_scalar::vec3;

    fn turned(mut mesh: Mesh) -> Mesh {
        mesh.normals.iter_mut().for_each(|n| *n = -*n);
        mesh
    }

    #[test]
    fn whole_pieces_are_opposed_and_single_leaning_triangles_are_not() {
        let sphere = shapes::uv_sphere(16, 8);
        assert!(opposed(&sphere).is_empty());
        let all = opposed(&turned(sphere.clone()));
        assert!(all.len() == sphere.triangles.len() && all.iter().all(|o| *o), "{all:?}");

        // One triangle of a smooth surface whose normals lean away.
        let mut leaning = sphere.clone();
        leaning.triangles[40]
            .into_iter()
            .for_each(|v| leaning.normals[v as usize] = -leaning.normals[v as usize]);
        assert!(opposed(&leaning).is_empty());

        // Beside a right one, a turned copy that it does not touch, and a part of it that is wound the other way round.
        let (mut both, far) = (sphere.clone(), turned(sphere.clone()));
        let base = both.positions.len() as u32;
        both.positions.extend(far.positions.iter().map(|p| *p + vec3(9.0, 0.0, 0.0)));
        both.normals.extend(&far.normals);
        both.triangles.extend(far.triangles.iter().map(|t| t.map(|v| v + base)));
        let wound = 32;
        both.triangles[..wound].iter_mut().for_each(|t| t.swap(1, 2));
        let wanted: Vec<bool> =
            (0..both.triangles.len()).map(|t| t < wound || t >= sphere.triangles.len()).collect();
        assert_eq!(opposed(&both), wanted);
    }
}
