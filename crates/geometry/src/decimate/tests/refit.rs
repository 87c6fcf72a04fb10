//! Attributes of the light surface are near the least squares that its triangles allow.

use super::super::*;
use super::{grid, to};
use nalgebra::{DMatrix, DVector};
use photofit_scalar::{Vec3f, vec2, vec3, vec4};

const CELLS: u32 = 48;

fn height(x: f32, y: f32) -> f32 {
    0.08 * (9.0 * x).sin() * (7.0 * y).cos()
}

fn normal(x: f32, y: f32) -> Vec3f {
    let [dx, dy] = [0.72 * (9.0 * x).cos() * (7.0 * y).cos(), -0.56 * (9.0 * x).sin() * (7.0 * y).sin()];
    vec3(-dx, -dy, 1.0).normalize_or_zero()
}

/// Bumps with normals, curved coordinates and colours.
fn bumps() -> Mesh {
    let mut mesh = grid(CELLS, height);
    let at: Vec<(f32, f32)> = mesh.positions.iter().map(|p| (p.x, p.y)).collect();
    mesh.normals = at.iter().map(|(x, y)| normal(*x, *y)).collect();
    mesh.uvs = at.iter().map(|(x, y)| coordinates(*x, *y)).collect();
    mesh.colors = at.iter().map(|(x, y)| color(*x, *y)).collect();
    mesh
}

fn coordinates(x: f32, y: f32) -> photofit_scalar::Vec2f {
    vec2(0.5 + 0.4 * (2.0 * x - 1.0) * (1.0 + 0.1 * (6.0 * y).sin()), 0.1 + 0.7 * y)
}

fn color(x: f32, y: f32) -> photofit_scalar::Vec4f {
    vec4(0.5 + 0.4 * (11.0 * x).sin(), 0.5 + 0.4 * (13.0 * y).cos(), x * y, 1.0)
}

/// Every attribute of a vertex, or of the input at a place.
fn row(n: Vec3f, uv: photofit_scalar::Vec2f, c: photofit_scalar::Vec4f) -> Vec<f64> {
    let all = n.to_array().into_iter().chain(uv.to_array()).chain(c.to_array());
    all.map(f64::from).collect()
}

/// Triangle over a place, and barycentric coordinates there.
fn over(mesh: &Mesh, x: f32, y: f32) -> Option<(usize, [f64; 3])> {
    (0..mesh.triangles.len()).find_map(|t| {
        let [a, b, c] = mesh.corners(t);
        let area = |p: [f32; 2], q: [f32; 2]| {
            f64::from(p[0] - x) * f64::from(q[1] - y) - f64::from(p[1] - y) * f64::from(q[0] - x)
        };
        let [a, b, c] = [a, b, c].map(|p| [p.x, p.y]);
        let parts = [area(b, c), area(c, a), area(a, b)];
        let sum: f64 = parts.iter().sum();
        let inside = sum != 0.0 && parts.iter().all(|p| p / sum >= -1e-9);
        inside.then(|| (t, parts.map(|p| p / sum)))
    })
}

#[test]
fn attributes_are_near_the_least_squares_of_the_triangles() {
    let light = to(&bumps(), 260, |o| o.keep_uvs = true).mesh;
    let n = light.positions.len();
    let (mut matrix, mut places) = (DMatrix::<f64>::zeros(n, n), Vec::new());
    for k in 0..12_000_u32 {
        let place = |step: f64| (f64::from(k) * step).fract() as f32;
        let (x, y) = (place(0.754_877_666_246_692_7), place(0.569_840_290_998_053_2));
        let Some((t, b)) = over(&light, x, y) else { continue };
        // Per area of the surface, not of the plane.
        let weight = 1.0 / f64::from(normal(x, y).z);
        let at = light.triangles[t].map(|v| v as usize);
        for (i, p) in at.iter().zip(b) {
            for (j, q) in at.iter().zip(b) {
                matrix[(*i, *j)] += weight * p * q;
            }
        }
        places.push((at, b, weight, row(normal(x, y), coordinates(x, y), color(x, y))));
    }
    assert!(places.len() > 11_000, "{}", places.len());
    for i in 0..n {
        matrix[(i, i)] += 1e-6;
    }
    let factor = matrix.cholesky().expect("positive definite");
    let found: Vec<Vec<f64>> = (0..n).map(|v| row(light.normals[v], light.uvs[v], light.colors[v])).collect();
    let mut best: Vec<Vec<f64>> = vec![Vec::new(); n];
    for j in 0..8 {
        let mut right = DVector::<f64>::zeros(n);
        for (at, b, weight, wanted) in &places {
            (0..3).for_each(|k| right[at[k]] += weight * b[k] * wanted[j]);
        }
        factor.solve(&right).iter().zip(&mut best).for_each(|(x, row)| row.push(*x));
    }
    // Root mean square of the distance; of normals as they are shaded, of unit length.
    let error = |values: &[Vec<f64>], block: std::ops::Range<usize>| {
        let of = |(at, b, weight, wanted): &([usize; 3], [f64; 3], f64, Vec<f64>)| {
            let here = |j: usize| (0..3).map(|k| b[k] * values[at[k]][j]).sum::<f64>();
            let length = if block.start == 0 {
                block.clone().map(|j| here(j).powi(2)).sum::<f64>().sqrt()
            } else {
                1.0
            };
            weight * block.clone().map(|j| (here(j) / length - wanted[j]).powi(2)).sum::<f64>()
        };
        (places.iter().map(of).sum::<f64>() / places.len() as f64).sqrt()
    };
    for block in [0..3, 3..5, 5..8] {
        let [found, best] = [&found, &best].map(|values| error(values, block.clone()));
        // Samples with coordinates that are far off are left out, as of another chart.
        let most = if block == (3..5) { 1.2 } else { 1.1 };
        assert!(found < most * best, "{block:?}: {found} of {best}");
    }
}
