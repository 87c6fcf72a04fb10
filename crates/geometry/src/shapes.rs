//! Procedural meshes for tests, benchmarks and initial guesses.
//!
//! All are outward oriented (counter-clockwise seen from outside), with unit normals; uv origin at the upper left.

use crate::Mesh;
use photofit_scalar::{Vec2f, Vec3, Vec3f, vec2, vec3};
use std::f64::consts::{PI, TAU};

/// Unit icosphere: every face of an icosahedron divided into `frequency^2` triangles and pushed to the sphere;
/// `20 f^2` triangles and `10 f^2 + 2` shared vertices, no uvs.
///
/// # Panics
/// When `frequency` is zero or above 10000.
pub fn icosphere(frequency: u32) -> Mesh {
    assert!((1..=10_000).contains(&frequency), "the frequency lies in 1..=10000");
    let f = frequency as usize;
    let phi = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let corners: Vec<Vec3<f64>> = (0..12)
        .map(|i| {
            let (s, t) = (if i & 1 == 0 { 1.0 } else { -1.0 }, if i & 2 == 0 { phi } else { -phi });
            [vec3(0.0, s, t), vec3(s, t, 0.0), vec3(t, 0.0, s)][i / 4].normalize_or_zero()
        })
        .collect();
    let near = |a: usize, b: usize| a != b && (corners[a] - corners[b]).length_squared() < 1.2;
    let mut edges = Vec::with_capacity(30);
    let mut faces = Vec::with_capacity(20);
    for a in 0..12 {
        for b in (a + 1..12).filter(|&b| near(a, b)) {
            edges.push([a, b]);
            for c in (b + 1..12).filter(|&c| near(a, c) && near(b, c)) {
                let outward = corners[a].dot(corners[b].cross(corners[c])) > 0.0;
                faces.push(if outward { [a, b, c] } else { [a, c, b] });
            }
        }
    }
    // Vertices: 12 corners, then f - 1 per edge from its lower corner, then the faces' inner ones.
    let inner = if f > 2 { (f - 1) * (f - 2) / 2 } else { 0 };
    let mut directions = vec![Vec3::<f64>::zero(); 12 + 30 * (f - 1) + 20 * inner];
    let mut triangles = Vec::with_capacity(20 * f * f);
    let edge_id = |from: usize, to: usize, step: usize| {
        let (low, high, step) = if from < to { (from, to, step) } else { (to, from, f - step) };
        let e = edges.iter().position(|e| *e == [low, high]).expect("faces are made of edges");
        12 + e * (f - 1) + step - 1
    };
    let row_start = |j: usize| if j == 0 { 0 } else { (j - 1) * (2 * f - j - 2) / 2 };
    for (n, &[a, b, c]) in faces.iter().enumerate() {
        // Barycentric grid: i steps towards b, j steps towards c.
        let id = |i: usize, j: usize| match (i, j, f - i - j) {
            (0, 0, _) => a,
            (_, 0, 0) => b,
            (0, _, 0) => c,
            (i, 0, _) => edge_id(a, b, i),
            (0, j, _) => edge_id(a, c, j),
            (_, j, 0) => edge_id(b, c, j),
            (i, j, _) => 12 + 30 * (f - 1) + n * inner + row_start(j) + i - 1,
        };
        for j in 0..=f {
            for i in 0..=f - j {
                let [wa, wb, wc] = [f - i - j, i, j].map(|w| w as f64);
                directions[id(i, j)] =
                    (corners[a] * wa + corners[b] * wb + corners[c] * wc).normalize_or_zero();
                if i + j < f {
                    triangles.push([id(i, j), id(i + 1, j), id(i, j + 1)].map(|v| v as u32));
                }
                if i + j + 2 <= f {
                    triangles.push([id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)].map(|v| v as u32));
                }
            }
        }
    }
    let positions: Vec<Vec3f> = directions.iter().map(|d| d.cast()).collect();
    Mesh { normals: positions.clone(), positions, triangles, ..Mesh::default() }
}

/// Sheet of `(columns + 1) x (rows + 1)` vertices, the position, normal and uv of each given by `at(u, v)`; the cells
/// split along alternating-free diagonals, counter-clockwise where `v` grows downwards.
fn sheet(columns: u32, rows: u32, at: impl Fn(f64, f64) -> (Vec3<f64>, Vec3<f64>)) -> Mesh {
    assert!(columns >= 1 && rows >= 1, "at least one cell");
    let count = (u64::from(columns) + 1) * (u64::from(rows) + 1);
    assert!(count < u64::from(u32::MAX) / 6, "vertices and corners are counted in 32 bits");
    let mut mesh = Mesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            let (u, v) = (f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows));
            let (position, normal) = at(u, v);
            mesh.positions.push(position.cast());
            mesh.normals.push(normal.normalize_or_zero().cast());
            mesh.uvs.push(vec2(u as f32, v as f32));
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let [a, b] = [j * (columns + 1) + i, (j + 1) * (columns + 1) + i];
            mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    mesh
}

/// Two triangles over the parallelogram of a corner and two edges; the front is on the side of `a x b`.
pub fn parallelogram(corner: Vec3f, a: Vec3f, b: Vec3f) -> Mesh {
    Mesh {
        positions: vec![corner, corner + a, corner + a + b, corner + b],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// Square grid in the xy plane over `[-1, 1]^2`, facing +z, upright uvs; `2 columns rows` triangles.
///
/// # Panics
/// When a count is zero or the vertices exceed what 32 bits count.
pub fn quad_grid(columns: u32, rows: u32) -> Mesh {
    sheet(columns, rows, |u, v| (vec3(2.0 * u - 1.0, 1.0 - 2.0 * v, 0.0), vec3(0.0, 0.0, 1.0)))
}

/// Unit sphere of longitudes and latitudes about +y, with uvs, a seam and one pole vertex per segment;
/// `2 segments (rings - 1)` triangles.
///
/// # Panics
/// With fewer than 3 segments or 2 rings, or when the vertices exceed what 32 bits count.
pub fn uv_sphere(segments: u32, rings: u32) -> Mesh {
    assert!(segments >= 3 && rings >= 2, "at least 3 segments and 2 rings");
    let mut mesh = sheet(segments, rings, |u, v| {
        // The seam's two columns must carry the same bits, and so must the poles.
        let (sin, cos) = if u >= 1.0 { (0.0, 1.0) } else { (TAU * u).sin_cos() };
        let (ring, height) = if v >= 1.0 { (0.0, -1.0) } else { (PI * v).sin_cos() };
        let n = vec3(ring * sin, height, ring * cos);
        (n, n)
    });
    let degenerate = |t: &[u32; 3]| {
        let row = |v: u32| v / (segments + 1);
        let top = t.iter().filter(|&&v| row(v) == 0).count();
        let bottom = t.iter().filter(|&&v| row(v) == rings).count();
        top > 1 || bottom > 1
    };
    mesh.triangles.retain(|t| !degenerate(t));
    mesh
}

/// Torus about +y with uvs and seams: `major` radius of the circle, `minor` of the tube, in the asset's units;
/// `2 segments sides` triangles.
///
/// # Panics
/// With fewer than 3 segments or sides, or when the vertices exceed what 32 bits count.
pub fn torus(segments: u32, sides: u32, major: f32, minor: f32) -> Mesh {
    assert!(segments >= 3 && sides >= 3, "at least 3 segments and sides");
    let (major, minor) = (f64::from(major), f64::from(minor));
    let turn = |x: f64| if x >= 1.0 { (0.0, 1.0) } else { (TAU * x).sin_cos() };
    sheet(segments, sides, |u, v| {
        let ((su, cu), (sv, cv)) = (turn(u), turn(v));
        let normal = vec3(cv * su, -sv, cv * cu);
        (vec3(major * su, 0.0, major * cu) + normal * minor, normal)
    })
}

/// Cube over `[-1, 1]^3`: 24 vertices, each face with its own uvs over the unit square, 12 triangles.
pub fn cube() -> Mesh {
    let mut mesh = Mesh::default();
    let faces: [[Vec3f; 2]; 6] = [
        [vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, -1.0)],
        [vec3(-1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0)],
        [vec3(0.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0)],
        [vec3(0.0, -1.0, 0.0), vec3(1.0, 0.0, 0.0)],
        [vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 0.0)],
        [vec3(0.0, 0.0, -1.0), vec3(-1.0, 0.0, 0.0)],
    ];
    for [normal, right] in faces {
        let up = normal.cross(right);
        let base = mesh.positions.len() as u32;
        for (x, y) in [(-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (1.0, 1.0)] {
            mesh.positions.push(normal + right * x + up * y);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2f { x: (x + 1.0) / 2.0, y: (1.0 - y) / 2.0 });
        }
        mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    mesh
}

/// Icosphere displaced along the radius by a sum of plane waves, with angle-weighted normals: a benchmark shape with
/// detail at every scale.
///
/// `r = 1 + amplitude sum_o 2^-o sum_3 cos(k . x + phase) / 3`, wave numbers doubling per octave from 3, directions and
/// phases a fixed function of `seed`. The same bits on every run.
///
/// # Panics
/// When `frequency` is zero or above 10000, or `octaves` is above 16.
pub fn displaced_sphere(frequency: u32, amplitude: f32, octaves: u32, seed: u64) -> Mesh {
    assert!(octaves <= 16, "at most 16 octaves");
    let mut mesh = icosphere(frequency);
    let mut state = seed;
    let mut next = || {
        // SplitMix64 (Steele et al. 2014).
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let waves: Vec<(Vec3<f64>, f64, f64)> = (0..3 * octaves)
        .map(|i| {
            let (z, angle) = (2.0 * next() - 1.0, TAU * next());
            let (ring, scale) = ((1.0 - z * z).sqrt(), f64::from(1_u32 << (i / 3)));
            let direction = vec3(ring * angle.cos(), ring * angle.sin(), z);
            (direction * (3.0 * scale), TAU * next(), f64::from(amplitude) / (3.0 * scale))
        })
        .collect();
    for p in &mut mesh.positions {
        let x: Vec3<f64> = p.cast();
        let r = waves.iter().map(|(k, phase, a)| a * (k.dot(x) + phase).cos()).sum::<f64>() + 1.0;
        *p = (x * r).cast();
    }
    mesh.normals = crate::normals::mesh_normals(&mesh);
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::weld_exact;
    use crate::{Edges, check_triangles};

    fn volume(mesh: &Mesh) -> f64 {
        let corners = |t: usize| mesh.corners(t).map(|p| p.cast::<f64>());
        (0..mesh.triangles.len()).map(corners).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    #[test]
    fn closed_shapes_are_closed_and_outward() {
        let shapes = [
            ("icosphere 1", icosphere(1), 2.5361507),
            ("icosphere 2", icosphere(2), 3.6586),
            ("icosphere 3", icosphere(3), 3.9459),
            ("icosphere 40", icosphere(40), 4.0 * PI / 3.0),
            ("uv sphere", uv_sphere(96, 64), 4.0 * PI / 3.0),
            ("torus", torus(128, 64, 2.0, 0.5), PI * PI),
            ("cube", cube(), 8.0),
            ("displaced", displaced_sphere(20, 0.0, 3, 1), 4.0 * PI / 3.0),
        ];
        for (name, mesh, expected) in shapes {
            check_triangles(&mesh.triangles, mesh.positions.len()).unwrap();
            let edges = Edges::new(&mesh.triangles, &weld_exact(&mesh.positions));
            assert!((0..edges.len()).all(|e| edges.half_edges.row(e).len() == 2), "{name} is closed");
            assert!((volume(&mesh) / expected - 1.0).abs() < 0.01, "{name}: volume {}", volume(&mesh));
            assert_eq!(mesh.normals.len(), mesh.positions.len(), "{name}");
            assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5), "{name}: unit normals");
        }
    }

    #[test]
    fn counts_are_as_stated() {
        for f in [1, 2, 3, 5, 8] {
            let s = icosphere(f);
            assert_eq!(
                (s.triangles.len(), s.positions.len()),
                (20 * (f * f) as usize, (10 * f * f + 2) as usize)
            );
            assert_eq!(
                weld_exact(&s.positions).count(),
                s.positions.len(),
                "frequency {f}: no repeated vertex"
            );
        }
        assert_eq!(uv_sphere(8, 5).triangles.len(), 2 * 8 * 4);
        let grid = quad_grid(3, 2);
        assert_eq!((grid.triangles.len(), grid.positions.len()), (12, 12));
        assert_eq!((grid.positions[0], grid.uvs[0]), (vec3(-1.0, 1.0, 0.0), vec2(0.0, 0.0)));
    }

    #[test]
    fn the_displaced_sphere_depends_on_its_seed_only() {
        let a = displaced_sphere(6, 0.2, 4, 11);
        assert_eq!(a, displaced_sphere(6, 0.2, 4, 11));
        assert_ne!(a.positions, displaced_sphere(6, 0.2, 4, 12).positions);
        assert!(a.positions.iter().any(|p| (p.length() - 1.0).abs() > 0.05));
    }
}
