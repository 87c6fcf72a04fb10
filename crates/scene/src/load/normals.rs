//! Normals that a file lacks, and those that oppose its faces.

use photofit_geometry::normals::{Weighting, split_creases, vertex_normals};
use photofit_geometry::weld::weld_exact;
use photofit_geometry::{Incidence, Mesh, Split};
use photofit_scalar::{Vec3f, vec3};

/// The mesh with three vertices of its own and the face normal for every triangle.
pub(crate) fn flat(mesh: &Mesh) -> Mesh {
    fn corners<T: Copy>(values: &[T], triangles: &[[u32; 3]]) -> Vec<T> {
        if values.is_empty() {
            return Vec::new();
        }
        triangles.iter().flatten().map(|&i| values[i as usize]).collect()
    }
    let t = &mesh.triangles;
    let normals = (0..t.len()).flat_map(|i| [unit_or_up(area_normal(mesh.corners(i))); 3]).collect();
    Mesh {
        positions: corners(&mesh.positions, t),
        normals,
        uvs: corners(&mesh.uvs, t),
        uvs1: corners(&mesh.uvs1, t),
        tangents: Vec::new(),
        colors: corners(&mesh.colors, t),
        triangles: (0..t.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    }
}

/// Smooth unit normals, weighted by angle, vertices of equal position sharing one; +y where no face has an area.
pub(crate) fn smooth(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Vec<Vec3f> {
    let incidence = Incidence::new(triangles, &weld_exact(positions));
    let mut normals = vertex_normals(&incidence, positions, Weighting::Angle);
    normals.iter_mut().for_each(|n| *n = unit_or_up(*n));
    normals
}

/// The angle between two faces beyond which the edge between them is hard, radians: below that of a hexagonal bolt, above
/// what noise does to most edges of a scan.
const CREASE: f32 = 55.0 * std::f32::consts::PI / 180.0;

/// Unit normals that are smooth but for the edges at which faces meet at more than [`CREASE`], where vertices are split.
pub(crate) fn creased(positions: &[Vec3f], triangles: &[[u32; 3]]) -> (Split, Vec<Vec3f>) {
    let (split, mut normals) = split_creases(positions, triangles, &weld_exact(positions), CREASE);
    normals.iter_mut().for_each(|n| *n = unit_or_up(*n));
    (split, normals)
}

/// Computes the normals that are zero; returns how many there were.
pub(crate) fn repair(mesh: &mut Mesh) -> usize {
    let computed = smooth(&mesh.positions, &mesh.triangles);
    let mut found = 0;
    for (n, c) in mesh.normals.iter_mut().zip(computed) {
        if *n == Vec3f::zero() {
            *n = c;
            found += 1;
        }
    }
    found
}

/// Turns the faces whose normals point to their back; returns how many there were. OBJ and PLY say nothing of sides, so that
/// the normals of a file tell more of its surface than an order of corners that a mirroring exporter left as it was.
pub(crate) fn turn_opposed(mesh: &mut Mesh) -> usize {
    let opposed = photofit_geometry::opposed(mesh);
    let turned = mesh.triangles.iter_mut().zip(opposed).filter(|(_, o)| *o);
    turned.map(|(t, _)| t.swap(1, 2)).count()
}

/// What [`turn_opposed`] did.
pub(crate) fn turned(count: usize) -> Option<String> {
    (count > 0).then(|| format!("faces that look away from their normals: {count}, which are turned"))
}

fn area_normal(p: [Vec3f; 3]) -> Vec3f {
    let p = p.map(|p| p.cast::<f64>());
    (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero().cast()
}

fn unit_or_up(n: Vec3f) -> Vec3f {
    let n = n.normalize_or_zero();
    if n == Vec3f::zero() { vec3(0.0, 1.0, 0.0) } else { n }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec2;

    fn cube_corner() -> Mesh {
        // Three faces of a cube at the origin, the corner vertex doubled.
        Mesh {
            positions: vec![
                vec3(0.0, 0.0, 0.0),
                vec3(1.0, 0.0, 0.0),
                vec3(0.0, 1.0, 0.0),
                vec3(0.0, 0.0, 1.0),
                vec3(-0.0, 0.0, 0.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 3, 1]],
            ..Mesh::default()
        }
    }

    #[test]
    fn smooth_normals_join_equal_positions() {
        let mesh = cube_corner();
        let n = smooth(&mesh.positions, &mesh.triangles);
        let d = 1.0 / 3.0_f32.sqrt();
        assert!((n[0] - vec3(d, d, d)).length() < 1e-6, "{:?}", n[0]);
        assert_eq!(n[0], n[4], "doubled vertex");
    }

    #[test]
    fn creased_normals_join_gentle_edges_alone() {
        // A strip of three quads, folded by 30 degrees and then by 60.
        let (mut at, mut angle, mut positions) = (vec2(0.0_f32, 0.0), 0.0_f32, Vec::new());
        for turn in [30.0_f32, 60.0, 0.0, 0.0] {
            positions.extend([vec3(at.x, 0.0, at.y), vec3(at.x, 1.0, at.y)]);
            at += vec2(angle.cos(), angle.sin());
            angle += turn.to_radians();
        }
        let quad = |i: u32| [[2 * i, 2 * i + 2, 2 * i + 1], [2 * i + 1, 2 * i + 2, 2 * i + 3]];
        let (split, n) = creased(&positions, &[quad(0), quad(1), quad(2)].concat());
        assert_eq!((split.source.len(), n.len()), (10, 10), "two vertices are split");
        let corner = |t: usize, k: usize| n[split.triangles[t][k] as usize];
        assert_eq!(corner(0, 1), corner(2, 0), "30 degrees are smooth");
        let between = corner(2, 1).dot(corner(4, 0)).acos().to_degrees();
        assert!((between - 60.0).abs() < 0.1, "{between}");
    }

    #[test]
    fn flat_normals_are_those_of_the_faces() {
        let flat = flat(&cube_corner());
        assert_eq!(flat.positions.len(), 9);
        assert_eq!(flat.normals[0], vec3(0.0, 0.0, 1.0));
        assert_eq!(flat.normals[3], vec3(1.0, 0.0, 0.0));
    }

    #[test]
    fn zero_area_gives_a_unit_normal() {
        let n = smooth(&[vec3(1.0, 1.0, 1.0); 3], &[[0, 1, 2]]);
        assert_eq!(n, vec![vec3(0.0, 1.0, 0.0); 3]);
    }
}
