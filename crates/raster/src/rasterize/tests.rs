//! Tests of visibility and barycentrics.

use super::*;
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::{Vec4, vec2, vec4};

fn quad(z: f32) -> Vec<Vec4f> {
    vec![vec4(-0.5, -0.5, z, 1.0), vec4(0.5, -0.5, z, 1.0), vec4(0.5, 0.5, z, 1.0), vec4(-0.5, 0.5, z, 1.0)]
}

const QUAD: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

#[test]
fn a_quad_covers_exactly_its_pixels() {
    let v = rasterize(&quad(0.5), &QUAD, 64, 64, None);
    for y in 0..64 {
        for x in 0..64 {
            let inside = (16..48).contains(&x) && (16..48).contains(&y);
            assert_eq!(v.triangle[y * 64 + x] != NONE, inside, "pixel {x},{y}");
        }
    }
    assert!(v.depth.iter().zip(&v.triangle).all(|(d, t)| *t == NONE || (d - 0.5).abs() < 1e-6));
}

#[test]
fn row_zero_is_the_top() {
    let clip = vec![vec4(-1.0, 0.0, 0.5, 1.0), vec4(1.0, 0.0, 0.5, 1.0), vec4(0.0, 1.0, 0.5, 1.0)];
    let v = rasterize(&clip, &[[0, 1, 2]], 8, 8, None);
    assert!(v.triangle[32..].iter().all(|t| *t == NONE), "the lower half is empty");
    assert!(v.triangle[..32].contains(&0), "the upper half is not");
}

#[test]
fn a_fan_has_neither_holes_nor_double_hits() {
    // A closed fan around an interior point, random in perspective: every pixel of the square is hit by exactly one
    // triangle, which peeling would reveal.
    let mut rng = Uniform::new(5);
    for case in 0..20 {
        let (cx, cy) = (rng.range(-0.4, 0.4), rng.range(-0.4, 0.4));
        let mut clip = vec![];
        let n = 17;
        for i in 0..n {
            let a = i as f64 / n as f64 * std::f64::consts::TAU;
            let w = rng.range(0.5, 3.0);
            clip.push(vec4(
                (a.cos() * 3.0 * w) as f32,
                (a.sin() * 3.0 * w) as f32,
                (0.5 * w) as f32,
                w as f32,
            ));
        }
        let w = rng.range(0.5, 3.0);
        clip.push(vec4((cx * w) as f32, (cy * w) as f32, (0.5 * w) as f32, w as f32));
        let tris: Vec<[u32; 3]> = (0..n as u32).map(|i| [i, (i + 1) % n as u32, n as u32]).collect();
        let front = rasterize(&clip, &tris, 97, 61, None);
        assert!(front.triangle.iter().all(|t| *t != NONE), "case {case}: a crack");
        let behind = rasterize(&clip, &tris, 97, 61, Some(&front));
        assert!(behind.triangle.iter().all(|t| *t == NONE), "case {case}: an overlap");
    }
}

#[test]
fn triangles_through_the_camera_plane_do_not_crack() {
    // Ground plane under the eye: its far edge is ahead, its near edge behind (w < 0).
    let p = |x: f32, z: f32| vec4(x, -1.0, z * 1.001 - 0.1, z);
    let clip = vec![p(-50.0, -20.0), p(50.0, -20.0), p(50.0, 90.0), p(-50.0, 90.0), p(0.0, 3.0)];
    let tris = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    let v = rasterize(&clip, &tris, 64, 64, None);
    for y in 34..63 {
        for x in 20..44 {
            assert!(v.triangle[y * 64 + x] != NONE, "hole at {x},{y}");
        }
    }
    assert!(v.triangle[..30 * 64].iter().all(|t| *t == NONE), "nothing above the horizon");
}

#[test]
fn peeling_keeps_coplanar_duplicates_and_ends() {
    let clip: Vec<Vec4f> = quad(0.5).into_iter().chain(quad(0.5)).chain(quad(0.7)).collect();
    let tris: Vec<[u32; 3]> = (0..3).flat_map(|k| QUAD.map(|t: [u32; 3]| t.map(|i| i + 4 * k))).collect();
    let l0 = rasterize(&clip, &tris, 32, 32, None);
    let l1 = rasterize(&clip, &tris, 32, 32, Some(&l0));
    let l2 = rasterize(&clip, &tris, 32, 32, Some(&l1));
    let l3 = rasterize(&clip, &tris, 32, 32, Some(&l2));
    let at = 16 * 32 + 12;
    assert_eq!([l0.triangle[at] / 2, l1.triangle[at] / 2, l2.triangle[at] / 2], [0, 1, 2]);
    assert!(l3.triangle.iter().all(|t| *t == NONE));
}

#[test]
fn empty_and_broken_input_shows_nothing() {
    assert!(rasterize(&[], &[], 0, 0, None).triangle.is_empty());
    assert_eq!(rasterize(&[], &[], 1, 1, None).triangle, [NONE]);
    let bad = vec![vec4(f32::NAN, 0.0, 0.0, 1.0), vec4(1.0, 0.0, 0.5, 1.0), vec4(0.0, 1.0, 0.5, 1.0)];
    assert!(rasterize(&bad, &[[0, 1, 2]], 8, 8, None).triangle.iter().all(|t| *t == NONE));
    let flat = vec![vec4(0.1, 0.1, 0.5, 1.0); 3];
    assert!(rasterize(&flat, &[[0, 1, 2]], 8, 8, None).triangle.iter().all(|t| *t == NONE));
}

#[test]
fn barycentrics_and_their_derivatives() {
    let p: [Vec4<f64>; 3] = [vec4(-0.7, -0.6, 0.3, 1.1), vec4(1.3, -0.2, 0.2, 1.9), vec4(0.1, 0.8, 0.4, 0.8)];
    let grid = PixelGrid::new(40, 30);
    let f = grid.ndc(22, 14);
    let b = barycentrics(&p, f, &grid);
    // Reconstruction: the interpolated clip position projects to the pixel centre.
    let c = p[0] * b.u + p[1] * b.v + p[2] * (1.0 - b.u - b.v);
    assert!((c.x / c.w - f.x).abs() < 1e-12 && (c.y / c.w - f.y).abs() < 1e-12);
    let h = 1e-6;
    let at = |dx: f64, dy: f64| barycentrics(&p, vec2(f.x + dx * grid.sx, f.y - dy * grid.sy), &grid);
    for (d, (plus, minus)) in [(0, (at(h, 0.0), at(-h, 0.0))), (1, (at(0.0, h), at(0.0, -h)))] {
        assert!((b.du[d] - (plus.u - minus.u) / (2.0 * h)).abs() < 1e-8, "du {d}");
        assert!((b.dv[d] - (plus.v - minus.v) / (2.0 * h)).abs() < 1e-8, "dv {d}");
    }
}

#[test]
fn gradient_of_the_barycentrics() {
    let mut rng = Uniform::new(3);
    let grid = PixelGrid::<f64>::new(40, 30);
    let f = grid.ndc(22, 14);
    let x = [-0.7, -0.6, 0.3, 1.1, 1.3, -0.2, 0.2, 1.9, 0.1, 0.8, 0.4, 0.8];
    let (gu, gv) = (rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
    let points = |x: &[f64]| -> [Vec4<f64>; 3] {
        [0, 1, 2].map(|i| vec4(x[4 * i], x[4 * i + 1], x[4 * i + 2], x[4 * i + 3]))
    };
    let g = barycentrics_vjp(&points(&x), f, gu, gv);
    let flat: Vec<f64> = g.iter().flat_map(|v| v.to_array()).collect();
    check("barycentrics", &x, &flat, 1e-6, 1e-7, |x| {
        let b = barycentrics(&points(x), f, &grid);
        gu * b.u + gv * b.v
    });
}

#[test]
fn eight_pixels_at_a_time_give_the_bits_of_one_at_a_time() {
    let mut rng = Uniform::new(41);
    let clip: Vec<Vec4f> = (0..600)
        .map(|_| {
            let w = rng.range(-0.2, 2.0);
            let (x, y, z) = (rng.range(-1.5, 1.5), rng.range(-1.5, 1.5), rng.range(-0.1, 1.1));
            vec4((x * w) as f32, (y * w) as f32, (z * w) as f32, w as f32)
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..200).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let bins = Bins::new(&clip, &triangles, &[], 77, 70);
    let mut covered = 0;
    for (column, row) in [(0, 0), (1, 1), (2, 2)] {
        let tile = bins.tile(column, row);
        let mut front: Option<Layer> = None;
        for _ in 0..3 {
            let (mut wide, mut narrow) = (Layer::default(), Layer::default());
            tile.rasterize(&clip, &triangles, front.as_ref(), &mut wide);
            narrow.depth.fill(f32::INFINITY);
            tile.for_each_setup(&clip, &triangles, |id, s| s.draw(id, front.as_ref(), &mut narrow));
            for y in 0..tile.height {
                for i in y * TILE..y * TILE + tile.width {
                    assert_eq!(wide.triangle[i], narrow.triangle[i], "tile {column},{row}, pixel {i}");
                    assert_eq!(wide.depth[i], narrow.depth[i].min(1.0), "tile {column},{row}, pixel {i}");
                    covered += usize::from(wide.triangle[i] != NONE);
                }
            }
            front = Some(wide);
        }
    }
    assert!(covered > 3000, "the scene covers {covered} pixels");
}

#[test]
fn front_faces_are_all_that_a_closed_surface_shows() {
    let mesh = photofit_geometry::shapes::displaced_sphere(12, 0.2, 3, 5);
    let camera =
        [[2.0_f32, 0.0, 0.3, 0.1], [0.0, 2.0, -0.2, 0.0], [0.0, 0.0, -1.02, 2.5], [0.0, 0.0, -1.0, 3.0]];
    let row = |r: [f32; 4], p: photofit_scalar::Vec3f| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
    let clip: Vec<Vec4f> = mesh
        .positions
        .iter()
        .map(|p| vec4(row(camera[0], *p), row(camera[1], *p), row(camera[2], *p), row(camera[3], *p)))
        .collect();
    let sides = vec![Sides::Front; mesh.triangles.len()];
    let all = rasterize(&clip, &mesh.triangles, 90, 70, None);
    let mut front = Visibility::default();
    rasterize_into(&clip, &mesh.triangles, &sides, 90, 70, None, &mut front);
    assert!(all.triangle.iter().filter(|t| **t != NONE).count() > 1000);
    assert_eq!(all, front);
    let turned: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
    rasterize_into(&clip, &turned, &sides, 90, 70, None, &mut front);
    assert_ne!(all.triangle, front.triangle, "turned inside out, the far side shows");
}
