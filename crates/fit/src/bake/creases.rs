//! Which edges of a target stand for creases of the reference.

use super::ReferenceSurface;
use super::select::{Choice, Selector};
use super::target::Point;
use crate::visibility::Visibility;
use photofit_geometry::{Edges, Mesh};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Faces that meet at a smaller angle (radians) are smooth whatever the reference does there.
const LEAST_ANGLE: f32 = 0.35;
/// Share of the angle between the faces that the reference must turn close to the edge.
const SHARE: f32 = 0.6;
/// Where along an edge to look.
const ALONG: [f32; 3] = [0.25, 0.5, 0.75];
/// How far from the edge to look, as a share of the way to the opposite vertex. A smooth surface turns by about three
/// times this share of the angle between the two places.
const ASIDE: f32 = 0.06;
/// Largest distance to look, in diagonals of the reference's box.
const REACH: f32 = 0.04;

/// One flag per edge: the faces meet at an angle, and so do the smooth normals of the reference on the two sides.
///
/// A rounded shape made of few triangles has edges too, but there the reference hardly turns from one side of the edge
/// to the other.
pub(crate) fn hard_edges(
    reference: &ReferenceSurface<'_>,
    visibility: &Visibility,
    target: &Mesh,
    edges: &Edges,
) -> Vec<bool> {
    let selector = Selector { reference, visibility, limit: REACH * reference.diagonal() };
    let faces: Vec<Vec3f> = (0..target.triangles.len())
        .map(|t| {
            let [a, b, c] = target.corners(t);
            (b - a).cross(c - a).normalize_or_zero()
        })
        .collect();
    (0..edges.len())
        .into_par_iter()
        .map(|e| {
            let &[a, b] = edges.half_edges.row(e) else { return false };
            let angle = between(faces[a as usize / 3], faces[b as usize / 3]);
            if angle < LEAST_ANGLE {
                return false;
            }
            let side = |half| side_normal(&selector, target, &faces, half);
            match (side(a), side(b)) {
                (Some(m), Some(n)) => between(m, n) > (SHARE * angle).max(LEAST_ANGLE),
                _ => false,
            }
        })
        .collect()
}

/// One flag per edge: the faces meet at an angle, and so do the mesh's own vertex normals on the two sides. A mesh without
/// normals is smooth. `edges` are those of its triangles, however their vertices are welded.
pub(crate) fn own_creases(mesh: &Mesh, edges: &Edges) -> Vec<bool> {
    if mesh.normals.len() != mesh.positions.len() {
        return vec![false; edges.len()];
    }
    let face = |half: u32| {
        let [a, b, c] = mesh.corners(half as usize / 3);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let side = |half: u32| {
        let (triangle, k) = (mesh.triangles[half as usize / 3], half as usize % 3);
        let normal = |k: usize| mesh.normals[triangle[k % 3] as usize];
        (normal(k) + normal(k + 1)).normalize_or_zero()
    };
    let is_hard = |e: usize| {
        let &[a, b] = edges.half_edges.row(e) else { return false };
        let angle = between(face(a), face(b));
        angle >= LEAST_ANGLE && between(side(a), side(b)) > (SHARE * angle).max(LEAST_ANGLE)
    };
    (0..edges.len()).map(is_hard).collect()
}

/// Mean smooth normal of the reference on one side of an edge.
fn side_normal(selector: &Selector<'_>, target: &Mesh, faces: &[Vec3f], half: u32) -> Option<Vec3f> {
    let (t, k) = (half as usize / 3, half as usize % 3);
    let corners = target.corners(t);
    let (p, q, o) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
    let mut sum = Vec3f::zero();
    for along in ALONG {
        let on = p * (1.0 - along) + q * along;
        let point = Point { position: on * (1.0 - ASIDE) + o * ASIDE, normal: faces[t] };
        if let Choice::Surface(pick) = selector.choose(&point, selector.limit, None) {
            let n = selector.reference.smooth_normal(&pick.place);
            sum += if pick.front { n } else { -n };
        }
    }
    let mean = sum.normalize_or_zero();
    (mean != Vec3f::zero()).then_some(mean)
}

/// Angle between unit vectors.
fn between(a: Vec3f, b: Vec3f) -> f32 {
    a.cross(b).length().atan2(a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::tests::World;
    use photofit_geometry::weld::weld_exact;
    use photofit_scalar::vec3;
    use photofit_scene::Material;

    /// A square tube of four quads with the normals given at each corner's angle.
    fn tube(normal: impl Fn(f32, f32) -> Vec3f) -> Mesh {
        let mut mesh = Mesh::default();
        for side in 0..4_u32 {
            let angle = |k: u32| ((side + k) % 4) as f32 * std::f32::consts::FRAC_PI_2;
            let middle = (side as f32 + 0.5) * std::f32::consts::FRAC_PI_2;
            let first = mesh.positions.len() as u32;
            for (k, y) in [(0, -1.0), (1, -1.0), (1, 1.0), (0, 1.0)] {
                mesh.positions.push(vec3(angle(k).cos(), y, -angle(k).sin()));
                mesh.normals.push(normal(angle(k), middle));
            }
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh
    }

    fn creases(reference: Mesh) -> usize {
        let target = tube(|a, _| vec3(a.cos(), 0.0, -a.sin()));
        let edges = Edges::new(&target.triangles, &weld_exact(&target.positions));
        let mut world = World::default();
        world.add(&reference, Material::clay());
        let seen = world.visibility();
        world.with(|r| hard_edges(r, &seen, &target, &edges)).iter().filter(|h| **h).count()
    }

    #[test]
    fn a_box_has_creases_and_a_round_shape_of_the_same_triangles_has_none() {
        let around = |a: f32| vec3(a.cos(), 0.0, -a.sin());
        assert_eq!(creases(tube(|_, middle| around(middle))), 4, "flat sides");
        assert_eq!(creases(tube(|corner, _| around(corner))), 0, "smooth normals");
        let own = |mesh: Mesh| {
            let edges = Edges::new(&mesh.triangles, &weld_exact(&mesh.positions));
            own_creases(&mesh, &edges).iter().filter(|h| **h).count()
        };
        assert_eq!(own(tube(|_, middle| around(middle))), 4, "by its own normals");
        assert_eq!(own(tube(|corner, _| around(corner))), 0, "smooth by its own normals");
        let bare = Mesh { normals: Vec::new(), ..tube(|_, middle| around(middle)) };
        assert_eq!(own(bare), 0, "without normals");
    }
}
