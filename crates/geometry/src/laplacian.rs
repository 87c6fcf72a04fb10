//! Graph and cotangent Laplacians, and the uniform Laplacian regulariser with its vector-Jacobian product.
//!
//! All work on welded vertices: take neighbours from [`Edges::one_rings`] and welded positions from
//! [`Weld::pick`](crate::Weld::pick), so that uv seams do not open the surface.

use crate::adjacency::{Edges, NONE};
use crate::csr::{Csr, CsrMatrix};
use photofit_scalar::{Real, Vec3};
use rayon::prelude::*;

/// Items handed to one thread at a time; also the fixed chunk of the ordered sums.
const GRAIN: usize = 1024;

/// Uniform differential coordinates `delta_i = v_i - mean of the neighbours of i`; zero without neighbours.
///
/// # Panics
/// When `neighbours` does not have one row per vertex.
pub fn differential<T: Real>(neighbours: &Csr, vertices: &[Vec3<T>]) -> Vec<Vec3<T>> {
    assert_eq!(neighbours.rows(), vertices.len(), "one row of neighbours per vertex");
    let delta = |(i, v): (usize, &Vec3<T>)| {
        let row = neighbours.row(i);
        if row.is_empty() {
            return Vec3::zero();
        }
        let sum = row.iter().fold(Vec3::zero(), |s, &j| s + vertices[j as usize]);
        *v - sum / T::of(row.len() as f64)
    };
    vertices.par_iter().with_min_len(GRAIN).enumerate().map(delta).collect()
}

/// The regulariser `mean_i |delta_i - delta0_i|^2` over all vertices, with `delta0` the differential coordinates to
/// keep (`None`: zero, the absolute form used when starting from a sphere); a vertex without neighbours adds nothing.
/// Summed in f64, in a fixed order.
///
/// ```
/// use photofit_geometry::{Edges, laplacian, shapes, weld::weld_exact};
/// let sphere = shapes::icosphere(3);
/// let rings = Edges::new(&sphere.triangles, &weld_exact(&sphere.positions)).one_rings();
/// let start = laplacian::differential(&rings, &sphere.positions);
/// assert_eq!(laplacian::regulariser(&rings, &sphere.positions, Some(&start)), 0.0);
/// assert!(laplacian::regulariser(&rings, &sphere.positions, None) > 0.0);
/// ```
///
/// # Panics
/// When a length differs from the number of vertices.
pub fn regulariser<T: Real>(neighbours: &Csr, vertices: &[Vec3<T>], delta0: Option<&[Vec3<T>]>) -> f64 {
    let residual = residual(neighbours, vertices, delta0);
    let sum = |chunk: &[Vec3<T>]| chunk.iter().map(|r| r.cast::<f64>().length_squared()).sum::<f64>();
    let parts: Vec<f64> = residual.par_chunks(GRAIN).map(sum).collect();
    parts.iter().sum::<f64>() / (vertices.len().max(1) as f64)
}

/// Vector-Jacobian product of [`regulariser`]: adds `seed` times its gradient to `d_vertices`. Exact; `delta0` is a
/// constant. Deterministic gather.
///
/// # Panics
/// When a length differs from the number of vertices.
pub fn regulariser_vjp<T: Real>(
    neighbours: &Csr,
    vertices: &[Vec3<T>],
    delta0: Option<&[Vec3<T>]>,
    seed: f64,
    d_vertices: &mut [Vec3<T>],
) {
    assert_eq!(d_vertices.len(), vertices.len(), "one gradient per vertex");
    let residual = residual(neighbours, vertices, delta0);
    let scale = T::of(2.0 * seed / vertices.len().max(1) as f64);
    d_vertices.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(i, d)| {
        // Neighbourhood is symmetric: the vertices whose mean holds i are the neighbours of i.
        let spread = neighbours.row(i).iter().fold(Vec3::zero(), |s, &j| {
            s + residual[j as usize] / T::of(neighbours.row(j as usize).len() as f64)
        });
        *d += (residual[i] - spread) * scale;
    });
}

fn residual<T: Real>(neighbours: &Csr, vertices: &[Vec3<T>], delta0: Option<&[Vec3<T>]>) -> Vec<Vec3<T>> {
    let mut delta = differential(neighbours, vertices);
    if let Some(delta0) = delta0 {
        assert_eq!(delta0.len(), vertices.len(), "one target per vertex");
        for (i, (d, d0)) in delta.iter_mut().zip(delta0).enumerate() {
            if !neighbours.row(i).is_empty() {
                *d -= *d0;
            }
        }
    }
    delta
}

/// Combinatorial Laplacian `L = degree - adjacency`, symmetric positive semi-definite: the matrix of Large Steps
/// (Nicolet et al. 2021).
///
/// # Panics
/// When `neighbours` holds 2^32 entries or more together with its diagonal.
pub fn combinatorial<T: Real>(neighbours: &Csr) -> CsrMatrix<T> {
    with_diagonal(neighbours, |_, _| T::one())
}

/// Cotangent Laplacian `L_ij = -(cot a_ij + cot b_ij) / 2`, diagonal = minus the row's sum, over the welded vertices of
/// `edges` (Pinkall and Polthier 1993); `L x` is the area gradient at `x`, without division by vertex areas.
///
/// `triangles` are those of `edges`, in welded ids; `vertices` the welded positions. Angles of degenerate triangles
/// count as right ones (weight zero). With `clamp`, negative weights (non-Delaunay edges) become zero: the
/// matrix is then an M-matrix and positive semi-definite for any mesh.
///
/// # Panics
/// When the lengths disagree with `edges`.
pub fn cotangent<T: Real>(
    edges: &Edges,
    triangles: &[[u32; 3]],
    vertices: &[Vec3<T>],
    clamp: bool,
) -> CsrMatrix<T> {
    assert_eq!(triangles.len(), edges.of_triangle.len(), "the triangles of the edges");
    let half = T::of(0.5);
    let mut weights = vec![T::zero(); edges.len()];
    for (t, of) in triangles.iter().zip(&edges.of_triangle) {
        let p = t.map(|v| vertices[v as usize]);
        for k in (0..3).filter(|&k| of[k] != NONE) {
            let apex = p[(k + 2) % 3];
            let (a, b) = (p[k] - apex, p[(k + 1) % 3] - apex);
            let (sine, cosine) = (a.cross(b).length(), a.dot(b));
            let size = (a.length_squared() * b.length_squared()).sqrt();
            if sine > size * T::epsilon() && sine > T::min_positive_value() {
                weights[of[k] as usize] += half * cosine / sine;
            }
        }
    }
    if clamp {
        weights.iter_mut().for_each(|w| *w = w.relu());
    }
    let rings = edges.one_rings();
    assert_eq!(rings.rows(), vertices.len(), "one position per welded vertex");
    let weight = |i: u32, j: u32| {
        let e =
            edges.vertices.binary_search(&[i.min(j), i.max(j)]).expect("neighbours are joined by an edge");
        weights[e]
    };
    with_diagonal(&rings, weight)
}

/// `L_ij = -weight(i, j)` on the neighbours, the diagonal making each row sum to zero.
fn with_diagonal<T: Real>(neighbours: &Csr, weight: impl Fn(u32, u32) -> T) -> CsrMatrix<T> {
    let n = neighbours.rows();
    assert!(neighbours.items.len() + n <= u32::MAX as usize, "matrix entries are counted in 32 bits");
    let mut matrix = CsrMatrix {
        offsets: Vec::with_capacity(n + 1),
        columns: Vec::with_capacity(neighbours.items.len() + n),
        values: Vec::with_capacity(neighbours.items.len() + n),
    };
    matrix.offsets.push(0);
    for i in 0..n as u32 {
        let row = neighbours.row(i as usize);
        let start = matrix.columns.len();
        let before = row.partition_point(|&j| j < i);
        let mut total = T::zero();
        let mut push = |j: u32, value: T| {
            matrix.columns.push(j);
            matrix.values.push(value);
        };
        for (at, &j) in row.iter().enumerate() {
            if at == before {
                push(i, T::zero());
            }
            let w = weight(i, j);
            total += w;
            push(j, -w);
        }
        if before == row.len() {
            push(i, T::zero());
        }
        matrix.values[start + before] = total;
        matrix.offsets.push(matrix.columns.len() as u32);
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::weld::{Weld, weld_exact};
    use photofit_gradcheck::{Uniform, check};
    use photofit_scalar::vec3;

    fn torus() -> (Edges, Vec<[u32; 3]>, Vec<Vec3<f64>>) {
        let mesh = shapes::torus(8, 6, 1.0, 0.4);
        let weld = weld_exact(&mesh.positions);
        let positions = weld.pick(&mesh.positions).iter().map(|p| p.cast()).collect();
        (Edges::new(&mesh.triangles, &weld), weld.triangles(&mesh.triangles), positions)
    }

    #[test]
    fn regulariser_vjp_agrees_with_central_differences() {
        let (edges, _, start) = torus();
        // A vertex without neighbours must not disturb.
        let mut rings = edges.one_rings();
        rings.offsets.push(rings.items.len() as u32);
        let mut rng = Uniform::new(4);
        let mut vertices: Vec<Vec3<f64>> =
            start.iter().map(|p| p.map(|x| x + rng.range(-0.1, 0.1))).collect();
        vertices.push(vec3(3.0, 1.0, 2.0));
        let targets: Vec<Vec3<f64>> = vertices.iter().map(|p| p.map(|x| 0.1 * x)).collect();
        for delta0 in [None, Some(&targets[..])] {
            let seed = rng.range(0.5, 2.0);
            let mut gradient = vec![Vec3::zero(); vertices.len()];
            regulariser_vjp(&rings, &vertices, delta0, seed, &mut gradient);
            let flat = bytemuck::cast_slice(&vertices);
            check("laplacian", flat, bytemuck::cast_slice(&gradient), 1e-5, 1e-8, |x| {
                seed * regulariser(&rings, bytemuck::cast_slice(x), delta0)
            });
        }
    }

    #[test]
    fn matrices_are_symmetric_and_semi_definite() {
        let (edges, triangles, vertices) = torus();
        let mut rng = Uniform::new(8);
        let x: Vec<Vec3<f64>> =
            (0..vertices.len()).map(|_| Vec3::from_array([0; 3].map(|_| rng.range(-1.0, 1.0)))).collect();
        let combinatorial = combinatorial::<f64>(&edges.one_rings());
        for (name, l) in [
            ("combinatorial", combinatorial),
            ("cotangent", cotangent(&edges, &triangles, &vertices, false)),
            ("clamped", cotangent(&edges, &triangles, &vertices, true)),
        ] {
            let entry = |i: usize, j: usize| l.row(i).find(|(c, _)| *c == j).map_or(0.0, |(_, v)| v);
            for i in 0..l.rows() {
                assert!(l.row(i).map(|(c, _)| c).is_sorted_by(|a, b| a < b), "{name}: row {i} ascends");
                assert!(
                    l.row(i).all(|(j, v)| (entry(j, i) - v).abs() < 1e-12),
                    "{name}: row {i} is symmetric"
                );
                assert!(l.row(i).map(|(_, v)| v).sum::<f64>().abs() < 1e-12, "{name}: row {i} sums to zero");
            }
            let energy: f64 = l.mul(&x).iter().zip(&x).map(|(a, b)| a.dot(*b)).sum();
            assert!(energy > 0.1, "{name}: {energy}");
        }
    }

    #[test]
    fn cotangent_weights_are_the_area_gradient() {
        let (edges, triangles, vertices) = torus();
        let product = cotangent(&edges, &triangles, &vertices, false).mul(&vertices);
        check("area", bytemuck::cast_slice(&vertices), bytemuck::cast_slice(&product), 1e-5, 1e-7, |x| {
            let p: &[Vec3<f64>] = bytemuck::cast_slice(x);
            let area = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| p[v as usize]);
                (b - a).cross(c - a).length() / 2.0
            };
            triangles.iter().map(area).sum()
        });
    }

    #[test]
    fn known_values_and_degenerate_faces() {
        // A right isosceles triangle: 45 degrees at 1 and 2, 90 at 0; and a face without area.
        let vertices =
            [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(2.0, 0.0, 0.0_f64)];
        let triangles = [[0, 1, 2], [0, 1, 3]];
        let edges = Edges::new(&triangles, &Weld::identity(4));
        let l = cotangent(&edges, &triangles, &vertices, false);
        let row: Vec<_> = l.row(0).collect();
        assert_eq!(row.iter().map(|r| r.0).collect::<Vec<_>>(), [0, 1, 2, 3]);
        for ((_, v), expected) in row.iter().zip([1.0, -0.5, -0.5, 0.0]) {
            assert!((v - expected).abs() < 1e-12, "{row:?}");
        }
        let l = combinatorial::<f32>(&edges.one_rings());
        assert_eq!(l.row(2).collect::<Vec<_>>(), [(0, -1.0), (1, -1.0), (2, 2.0)]);
    }
}
