//! Tests of antialiasing.

use super::*;
use crate::rasterize::rasterize;
use photofit_gradcheck::{Uniform, check};

const QUAD: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
/// Edge 2 of the first triangle is the diagonal, as edge 0 of the second.
const OPPOSITE: [[u32; 3]; 2] = [[NONE, NONE, 3], [1, NONE, NONE]];
const NEIGHBOUR: [[u32; 3]; 2] = [[NONE, NONE, 1], [0, NONE, NONE]];
const TOPOLOGY: Topology<'_> = Topology { triangles: &QUAD, opposite: &OPPOSITE, neighbour: &NEIGHBOUR };

fn quad(x: &[f64]) -> Vec<Vec4<f64>> {
    x.chunks(4).map(|c| vec4(c[0], c[1], c[2], c[3])).collect()
}

/// A rotated quad in perspective.
fn corners() -> Vec<f64> {
    let mut x = vec![];
    for (k, w) in [1.0, 1.2, 1.4, 1.1].into_iter().enumerate() {
        let a: f64 = 0.3 + std::f64::consts::FRAC_PI_2 * k as f64;
        x.extend([0.61 * a.cos() * w, 0.57 * a.sin() * w, 0.5 * w, w]);
    }
    x
}

type Rendered = (Visibility, Vec<Pair<f64>>, Vec<[f64; 1]>, Vec<[f64; 1]>);

fn render(clip: &[Vec4<f64>], size: usize) -> Rendered {
    let clip32: Vec<_> = clip.iter().map(|c| c.cast::<f32>()).collect();
    let v = rasterize(&clip32, &QUAD, size, size, None);
    let pairs = silhouettes(&v, clip, &TOPOLOGY);
    let color: Vec<[f64; 1]> = v.triangle.iter().map(|t| [if *t == NONE { 0.0 } else { 1.0 }]).collect();
    let mut out = color.clone();
    antialias(&pairs, &color, &mut out);
    (v, pairs, color, out)
}

#[test]
fn coverage_approaches_the_area() {
    let clip = quad(&corners());
    let (_, pairs, color, out) = render(&clip, 48);
    let p: Vec<(f64, f64)> =
        clip.iter().map(|c| ((c.x / c.w + 1.0) * 24.0, (1.0 - c.y / c.w) * 24.0)).collect();
    let area: f64 =
        (0..4).map(|i| (p[i].0 * p[(i + 1) % 4].1 - p[(i + 1) % 4].0 * p[i].1) / 2.0).sum::<f64>().abs();
    let sum = |c: &[[f64; 1]]| c.iter().map(|c| c[0]).sum::<f64>();
    assert!((sum(&out) - area).abs() < 0.006 * area, "antialiased {} against {area}", sum(&out));
    assert!((sum(&out) - area).abs() < (sum(&color) - area).abs() || (sum(&color) - area).abs() < 0.5);
    assert!(pairs.iter().all(|p| p.alpha.abs() <= 0.5));
}

#[test]
fn the_inner_diagonal_is_no_silhouette() {
    let (v, pairs, ..) = render(&quad(&corners()), 48);
    for p in &pairs {
        let (a, b) = (v.triangle[p.first as usize], v.triangle[p.second as usize]);
        assert!(a == NONE || b == NONE, "pair between the two halves");
    }
}

#[test]
fn gradients_of_positions_and_colours() {
    let x = corners();
    let (v, pairs, color, out) = render(&quad(&x), 24);
    let mut rng = Uniform::new(2);
    let g: Vec<[f64; 1]> = out.iter().map(|_| [rng.range(-1.0, 1.0)]).collect();
    let (mut g_color, mut g_clip) = (g.clone(), vec![Vec4::zero(); 4]);
    antialias_vjp(&pairs, &quad(&x), (24, 24), &color, &mut g_color, Some(&mut g_clip));
    let mut alone = g.clone();
    antialias_vjp(&pairs, &quad(&x), (24, 24), &color, &mut alone, None);
    assert_eq!(alone, g_color, "colours have the same gradients where positions have none");
    // Visibility is held fixed: the operator's own derivative.
    let loss = |clip: &[Vec4<f64>], color: &[[f64; 1]]| {
        let pairs = silhouettes(&v, clip, &TOPOLOGY);
        let mut out = color.to_vec();
        antialias(&pairs, color, &mut out);
        out.iter().zip(&g).map(|(o, g)| o[0] * g[0]).sum::<f64>()
    };
    let flat: Vec<f64> = g_clip.iter().flat_map(|g| g.to_array()).collect();
    check("clip positions", &x, &flat, 1e-6, 1e-6, |x| loss(&quad(x), &color));
    let c: Vec<f64> = color.concat();
    check("colours", &c, &g_color.concat(), 1e-4, 1e-7, |c| {
        loss(&quad(&x), &c.iter().map(|c| [*c]).collect::<Vec<_>>())
    });
}

#[test]
fn moving_a_quad_changes_the_coverage_by_its_border() {
    // d(area)/dx of the right edge of an axis-aligned quad = its height; the left edge gives the negative.
    let x = [-0.51, -0.5, 0.5, 1.0, 0.53, -0.5, 0.5, 1.0, 0.53, 0.5, 0.5, 1.0, -0.51, 0.5, 0.5, 1.0];
    let (_, pairs, color, out) = render(&quad(&x), 32);
    let g = vec![[1.0]; out.len()];
    let mut g_color = g.clone();
    let mut g_clip = vec![Vec4::zero(); 4];
    antialias_vjp(&pairs, &quad(&x), (32, 32), &color, &mut g_color, Some(&mut g_clip));
    let right = g_clip[1].x + g_clip[2].x;
    let left = g_clip[0].x + g_clip[3].x;
    // 16 rows, 16 pixels per unit of x.
    assert!((right - 256.0).abs() < 1e-6 && (left + 256.0).abs() < 1e-6, "{right} {left}");
}
