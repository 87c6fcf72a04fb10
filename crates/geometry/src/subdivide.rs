//! Midpoint subdivision: every triangle into four, the surface unchanged.

use crate::Mesh;
use crate::adjacency::Edges;
use crate::angle::unit;
use crate::error::{GeometryError, check_triangles};
use crate::weld::Weld;
use photofit_scalar::{Vec3f, Vec4f};

/// A subdivided mesh and where its vertices come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Subdivision {
    /// The result; its first vertices are the input's.
    pub mesh: Mesh,
    /// The two input vertices of each output vertex (twice the same for the input's own); further attributes, such as
    /// skinning weights, are the mean of the two.
    pub parents: Vec<[u32; 2]>,
}

/// Splits each triangle into four at its edges' midpoints.
///
/// Attributes are averaged; normals and tangents are renormalised, the tangent's `w` is the lower parent's. Edges
/// shared by vertex index stay shared, and the two sides of a uv seam get bitwise equal positions. Triangle `t`
/// becomes `4 t .. 4 t + 4`: its three corners in order, then the middle.
///
/// ```
/// use photofit_geometry::{shapes, subdivide::midpoint};
/// let fine = midpoint(&shapes::cube(), u64::MAX)?;
/// assert_eq!(fine.mesh.triangles.len(), 48);
/// # Ok::<(), photofit_geometry::GeometryError>(())
/// ```
///
/// # Errors
/// [`GeometryError::TooLarge`] when the result would exceed `max_triangles`, or what 32 bits count;
/// [`GeometryError::IndexOutOfRange`] and [`GeometryError::AttributeLength`] for a malformed mesh.
pub fn midpoint(mesh: &Mesh, max_triangles: u64) -> Result<Subdivision, GeometryError> {
    let n = mesh.positions.len();
    let count = 4 * mesh.triangles.len() as u64;
    let limit = max_triangles.min(u64::from(u32::MAX) / 3 - 1);
    if count > limit {
        return Err(GeometryError::TooLarge { what: "triangle list", count, limit });
    }
    check_triangles(&mesh.triangles, n)?;
    if let Some((attribute, found)) = mesh.misfit() {
        return Err(GeometryError::AttributeLength { attribute, found, expected: n });
    }
    let edges = Edges::new(&mesh.triangles, &Weld::identity(n));
    let vertices = (n + edges.len()) as u64;
    if vertices >= u64::from(u32::MAX) {
        return Err(GeometryError::TooLarge {
            what: "vertex list",
            count: vertices,
            limit: u64::from(u32::MAX) - 1,
        });
    }
    let own = (0..n as u32).map(|v| [v, v]);
    let parents: Vec<[u32; 2]> = own.chain(edges.vertices.iter().copied()).collect();
    let mut triangles = Vec::with_capacity(count as usize);
    for (t, edge) in mesh.triangles.iter().zip(&edges.of_triangle) {
        let [a, b, c] = *t;
        // The edges of a degenerate triangle are not listed: it stays degenerate, at its own corners.
        let [ab, bc, ca] = if edge.contains(&u32::MAX) { [a, b, c] } else { edge.map(|e| n as u32 + e) };
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    let normal = |a: Vec3f, b: Vec3f| unit(a + b);
    let tangent = |a: Vec4f, b: Vec4f| unit(a.xyz() + b.xyz()).extend(a.w);
    let mesh = Mesh {
        positions: averaged(&mesh.positions, &edges, |a, b| (a + b) * 0.5),
        normals: averaged(&mesh.normals, &edges, normal),
        uvs: averaged(&mesh.uvs, &edges, |a, b| (a + b) * 0.5),
        uvs1: averaged(&mesh.uvs1, &edges, |a, b| (a + b) * 0.5),
        tangents: averaged(&mesh.tangents, &edges, tangent),
        colors: averaged(&mesh.colors, &edges, |a, b| (a + b) * 0.5),
        triangles,
    };
    Ok(Subdivision { mesh, parents })
}

fn averaged<A: Copy>(values: &[A], edges: &Edges, mean: impl Fn(A, A) -> A) -> Vec<A> {
    if values.is_empty() {
        return Vec::new();
    }
    let middle = edges.vertices.iter().map(|&[a, b]| mean(values[a as usize], values[b as usize]));
    values.iter().copied().chain(middle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::weld::weld_exact;
    use photofit_scalar::{vec2, vec3, vec4};

    fn area(mesh: &Mesh) -> f32 {
        (0..mesh.triangles.len())
            .map(|t| mesh.corners(t))
            .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
            .sum()
    }

    #[test]
    fn the_surface_and_its_seams_are_kept() {
        let torus = shapes::torus(9, 7, 1.0, 0.3);
        let fine = midpoint(&torus, 1 << 20).unwrap();
        assert_eq!(fine.mesh.triangles.len(), 4 * torus.triangles.len());
        assert!((area(&fine.mesh) / area(&torus) - 1.0).abs() < 1e-5);
        let edges = Edges::new(&fine.mesh.triangles, &weld_exact(&fine.mesh.positions));
        assert!(
            (0..edges.len()).all(|e| edges.half_edges.row(e).len() == 2),
            "still closed across the uv seam"
        );
        assert!(fine.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
        for (v, [a, b]) in fine.parents.iter().map(|p| p.map(|v| v as usize)).enumerate() {
            assert_eq!(fine.mesh.uvs[v], (torus.uvs[a] + torus.uvs[b]) * 0.5, "vertex {v}");
        }
        for (t, four) in fine.mesh.triangles.chunks_exact(4).enumerate() {
            let direction = |t: [Vec3f; 3]| unit((t[1] - t[0]).cross(t[2] - t[0]));
            let coarse = direction(torus.corners(t));
            for f in four {
                let fine = direction(f.map(|v| fine.mesh.positions[v as usize]));
                assert!((fine - coarse).length() < 1e-3, "triangle {t} keeps its side");
            }
        }
    }

    #[test]
    fn all_attributes_and_limits() {
        let mut mesh = shapes::quad_grid(1, 1);
        mesh.tangents = vec![vec4(1.0, 0.0, 0.0, -1.0); 4];
        mesh.colors = (0..4).map(|i| Vec4f::splat(i as f32)).collect();
        mesh.uvs1 = vec![vec2(0.0, 2.0); 4];
        mesh.triangles.push([1, 1, 2]);
        let fine = midpoint(&mesh, 12).unwrap().mesh;
        assert_eq!((fine.positions.len(), fine.triangles.len()), (9, 12));
        assert!(fine.tangents.iter().all(|t| *t == mesh.tangents[0]));
        assert!(fine.colors[4..].iter().any(|c| c.x == 0.5));
        assert_eq!(fine.uvs1.len(), 9);
        assert!(fine.positions.iter().all(|p| p.z == 0.0 && *p != vec3(9.0, 9.0, 9.0)));
        assert!(matches!(midpoint(&mesh, 11), Err(GeometryError::TooLarge { count: 12, .. })));
        mesh.uvs.pop();
        assert!(matches!(midpoint(&mesh, 99), Err(GeometryError::AttributeLength { attribute: "uvs", .. })));
        mesh.triangles.push([0, 1, 9]);
        assert!(matches!(midpoint(&mesh, 99), Err(GeometryError::IndexOutOfRange { triangle: 3, .. })));
    }
}
