//! Procedural test meshes.

use photofit_scalar::{Vec3f, vec3};
use std::collections::HashMap;
use std::f32::consts::TAU;

pub(super) struct Shape {
    pub(super) positions: Vec<Vec3f>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Shape {
    pub(super) fn corners(&self, t: usize) -> [Vec3f; 3] {
        self.triangles[t].map(|i| self.positions[i as usize])
    }

    pub(super) fn mapped(&self, f: impl Fn(Vec3f) -> Vec3f) -> Self {
        Self { positions: self.positions.iter().map(|&p| f(p)).collect(), triangles: self.triangles.clone() }
    }
}

/// Pseudo-random number in `[0, 1)`.
pub(super) fn random(seed: &mut u64) -> f32 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 40) as f32 / 16_777_216.0
}

/// Two triangles per quad of a `w x h` lattice of vertices.
fn lattice(w: u32, h: u32) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for y in 0..h - 1 {
        for x in 0..w - 1 {
            let i = y * w + x;
            triangles.extend([[i, i + 1, i + w + 1], [i, i + w + 1, i + w]]);
        }
    }
    triangles
}

/// Unit square of `n x n` quads with a height.
pub(super) fn grid(n: u32, height: impl Fn(f32, f32) -> f32) -> Shape {
    let at = |i: u32| i as f32 / n as f32;
    let positions = (0..=n).flat_map(|y| (0..=n).map(move |x| (at(x), at(y))));
    let positions = positions.map(|(x, y)| vec3(x, y, height(x, y))).collect();
    Shape { positions, triangles: lattice(n + 1, n + 1) }
}

pub(super) fn noise(n: u32) -> Shape {
    let mut shape = grid(n, |_, _| 0.0);
    let mut seed = 11;
    shape.positions.iter_mut().for_each(|p| p.z = 0.3 * random(&mut seed));
    shape
}

pub(super) fn cube() -> Shape {
    let positions = (0..8).map(|i| vec3((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    Shape { positions, triangles }
}

pub(super) fn icosphere(levels: u32) -> Shape {
    let g = 0.5 * (1.0 + 5.0_f32.sqrt());
    let mut positions = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        positions.extend([vec3(a, b, 0.0), vec3(0.0, a, b), vec3(b, 0.0, a)]);
    }
    positions.iter_mut().for_each(|p| *p = p.normalize_or_zero());
    // Faces of the hull: triples at the edge distance, turned outwards.
    let close = |a: Vec3f, b: Vec3f| ((a - b).length() - 1.0515).abs() < 0.01;
    let mut triangles = Vec::new();
    for a in 0..12_u32 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [a, b, c].map(|i| positions[i as usize]);
                if close(p, q) && close(q, r) && close(r, p) {
                    triangles.push(if (q - p).cross(r - p).dot(p) > 0.0 { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middle = HashMap::new();
        let mut next = Vec::new();
        for t in &triangles {
            let m = [0, 1, 2].map(|k| {
                let (a, b): (u32, u32) = (t[k], t[(k + 1) % 3]);
                *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push((positions[a as usize] + positions[b as usize]).normalize_or_zero());
                    positions.len() as u32 - 1
                })
            });
            next.extend([[t[0], m[0], m[2]], [m[0], t[1], m[1]], [m[2], m[1], t[2]], m]);
        }
        triangles = next;
    }
    Shape { positions, triangles }
}

pub(super) fn torus(n: u32, m: u32) -> Shape {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let (s, c) = (TAU * i as f32 / n as f32).sin_cos();
            let (t, d) = (TAU * j as f32 / m as f32).sin_cos();
            positions.push(vec3((2.0 + d) * c, (2.0 + d) * s, t));
            let at = |i: u32, j: u32| (i % n) * m + j % m;
            triangles.extend([
                [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
                [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
            ]);
        }
    }
    Shape { positions, triangles }
}

/// Rectangles of two triangles, turned and spread.
pub(super) fn scattered(n: u32, mut seed: u64) -> Shape {
    let mut shape = Shape { positions: Vec::new(), triangles: Vec::new() };
    for i in 0..n * 4 {
        let mut r = || random(&mut seed) - 0.5;
        if i % 4 == 0 {
            let middle = vec3(r(), r(), r()) * 20.0;
            let a = vec3(r(), r(), r() + 0.6).normalize_or_zero();
            let b = a.cross(vec3(r(), r() + 0.7, r())).normalize_or_zero() * (0.3 + r().abs());
            let k = shape.positions.len() as u32;
            shape.positions.extend([middle - a - b, middle + a - b, middle + a + b, middle - a + b]);
            shape.triangles.extend([[k, k + 1, k + 2], [k, k + 2, k + 3]]);
        }
    }
    shape
}

pub(super) fn random_connections(vertices: u32, triangles: u32) -> Shape {
    let mut seed = 5;
    let positions =
        (0..vertices).map(|_| vec3(random(&mut seed), random(&mut seed), random(&mut seed))).collect();
    let mut index = || (random(&mut seed) * vertices as f32) as u32 % vertices;
    Shape { positions, triangles: (0..triangles).map(|_| [index(), index(), index()]).collect() }
}

/// A strip folded flat onto itself, again and again.
pub(super) fn pleats(n: u32) -> Shape {
    let positions =
        (0..2 * (n + 1)).map(|i| vec3((i / 2 % 2) as f32, (i % 2) as f32, 1e-4 * (i / 2) as f32)).collect();
    let triangles = (0..n).flat_map(|i| {
        let k = 2 * i;
        [[k, k + 2, k + 3], [k, k + 3, k + 1]]
    });
    Shape { positions, triangles: triangles.collect() }
}

/// A flat spiral staircase, whose turns lie above each other.
pub(super) fn helix(turns: u32, steps: u32) -> Shape {
    let positions = (0..=turns * steps)
        .flat_map(|i| {
            let (s, c) = (TAU * i as f32 / steps as f32).sin_cos();
            [0.3, 1.0].map(|r| vec3(r * c, r * s, 0.01 * i as f32))
        })
        .collect();
    let triangles = (0..turns * steps).flat_map(|i| {
        let k = 2 * i;
        [[k, k + 1, k + 3], [k, k + 3, k + 2]]
    });
    Shape { positions, triangles: triangles.collect() }
}

/// The sheet and its back side on the same vertices.
pub(super) fn doubled(shape: &Shape) -> Shape {
    let back = shape.triangles.iter().map(|t| [t[0], t[2], t[1]]);
    Shape {
        positions: shape.positions.clone(),
        triangles: shape.triangles.iter().copied().chain(back).collect(),
    }
}

/// Every triangle twice.
pub(super) fn repeated(shape: &Shape) -> Shape {
    Shape {
        positions: shape.positions.clone(),
        triangles: [&shape.triangles[..], &shape.triangles[..]].concat(),
    }
}

/// Strips of needles of widths from 1e-1 down to 1e-6 of their length.
pub(super) fn needles(n: u32) -> Shape {
    let mut y = 0.0;
    let positions = (0..=n)
        .flat_map(|i| {
            let row = [vec3(0.0, y, 0.0), vec3(1.0, y, 0.0)];
            y += 10.0_f32.powf(-1.0 - (i % 6) as f32);
            row
        })
        .collect();
    let triangles = (0..n).flat_map(|i| {
        let k = 2 * i;
        [[k, k + 1, k + 3], [k, k + 3, k + 2]]
    });
    Shape { positions, triangles: triangles.collect() }
}

/// Triangles that share one edge, like the pages of a book.
pub(super) fn pages(n: u32) -> Shape {
    let mut positions = vec![vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0)];
    let mut triangles = Vec::new();
    for i in 0..n {
        let (s, c) = (TAU * i as f32 / n as f32).sin_cos();
        positions.push(vec3(c, s, 0.5));
        triangles.push(if i % 2 == 0 { [0, 1, i + 2] } else { [1, 0, i + 2] });
    }
    Shape { positions, triangles }
}

/// A fan around one vertex at height `z` above a unit circle.
pub(super) fn spokes(n: u32, z: f32) -> Shape {
    let mut positions = vec![vec3(0.0, 0.0, z)];
    for i in 0..n {
        let (s, c) = (TAU * i as f32 / n as f32).sin_cos();
        positions.push(vec3(c, s, 0.0));
    }
    Shape { positions, triangles: (0..n).map(|i| [0, i + 1, (i + 1) % n + 1]).collect() }
}

/// A flat strip of `n` squares.
pub(super) fn ribbon(n: u32) -> Shape {
    let positions = (0..2 * (n + 1)).map(|i| vec3((i / 2) as f32, (i % 2) as f32, 0.0)).collect();
    let triangles = (0..n).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]);
    Shape { positions, triangles: triangles.collect() }
}
