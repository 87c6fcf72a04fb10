//! Adjointness, symbols and known values of the operators.

use photofit_sampling::Rng;

use super::*;

fn random(n: usize, seed: u64) -> Vec<f64> {
    let mut rng = Rng::new(seed, 0);
    (0..n).map(|_| rng.next_f64() - 0.5).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

const SIZES: [(usize, usize); 7] = [(1, 1), (1, 7), (7, 1), (2, 2), (5, 3), (16, 13), (31, 32)];
const BOUNDARIES: [Boundary; 2] = [Boundary::Periodic, Boundary::Neumann];

#[test]
fn divergence_is_minus_the_adjoint_of_the_gradient() {
    for boundary in BOUNDARIES {
        for (m, n) in SIZES {
            let (u, w) = (random(m * n, 1), random(2 * m * n, 2));
            let a = dot(&gradient(boundary, n, m, &u), &w);
            let b = -dot(&u, &divergence(boundary, n, m, &w));
            assert!((a - b).abs() <= 1e-14 * (m * n) as f64, "{boundary:?} {m}x{n}: {a} {b}");
        }
    }
}

#[test]
fn hessian_adjoint_is_the_adjoint_of_the_hessian() {
    for boundary in BOUNDARIES {
        for (m, n) in SIZES {
            let (u, v) = (random(m * n, 3), random(4 * m * n, 4));
            let a = dot(&hessian(boundary, n, m, &u), &v);
            let b = dot(&u, &hessian_adjoint(boundary, n, m, &v));
            assert!((a - b).abs() <= 1e-14 * (m * n) as f64, "{boundary:?} {m}x{n}: {a} {b}");
        }
    }
}

/// The printed `dy+` is a backward difference: as partner of the printed `dy-` its adjoint defect is visible.
#[test]
fn a_backward_difference_in_place_of_dy_forward_breaks_the_adjoint() {
    let (m, n) = (16, 13);
    let (u, w) = (random(m * n, 1), random(m * n, 2));
    let wrong = dy_backward(Boundary::Periodic, n, &u);
    let scale = (m * n) as f64;
    let defect = (dot(&wrong, &w) + dot(&u, &dy_backward(Boundary::Periodic, n, &w))).abs() / scale;
    assert!(defect > 1e-3, "{defect}");
}

/// Symbols: `L` for grad^T grad, `L^2` for H^T H, on the modes of the transform that diagonalises them.
#[test]
fn modes_are_eigenvectors() {
    let (m, n) = (12, 9);
    for boundary in BOUNDARIES {
        for (r, s) in [(0, 0), (1, 0), (0, 2), (3, 4), (6, 8), (11, 1)] {
            let step = if boundary == Boundary::Periodic { 2.0 } else { 1.0 } * std::f64::consts::PI;
            let (a, b) = (step * s as f64 / n as f64, step * r as f64 / m as f64);
            let shift = if boundary == Boundary::Periodic { 0.0 } else { 0.5 };
            let u: Vec<f64> = (0..m * n)
                .map(|k| (a * ((k % n) as f64 + shift)).cos() * (b * ((k / n) as f64 + shift)).cos())
                .collect();
            let l = 4.0 - 2.0 * a.cos() - 2.0 * b.cos();
            let lu = divergence(boundary, n, m, &gradient(boundary, n, m, &u));
            let hu = hessian_adjoint(boundary, n, m, &hessian(boundary, n, m, &u));
            for k in 0..m * n {
                assert!((lu[k] + l * u[k]).abs() < 1e-11, "{boundary:?} gradient ({r},{s})");
                assert!((hu[k] - l * l * u[k]).abs() < 1e-11, "{boundary:?} Hessian ({r},{s})");
            }
        }
    }
}

#[test]
fn mixed_derivatives_of_polynomials() {
    let (m, n) = (8, 9);
    let at = |f: fn(f64, f64) -> f64| -> Vec<f64> {
        (0..m * n).map(|k| f((k % n) as f64, (k / n) as f64)).collect()
    };
    for (f, expected) in [((|x, y| x * y) as fn(f64, f64) -> f64, 1.0), (|_, y| y * y, 0.0)] {
        let h = hessian(Boundary::Neumann, n, m, &at(f));
        for component in 1..3 {
            for i in 0..m - 1 {
                for j in 0..n - 1 {
                    assert_eq!(h[(component * m + i) * n + j], expected);
                }
            }
        }
    }
}

/// An affine ramp has no second derivative inside; the raw operators see the border, the masks exclude it.
#[test]
fn masks_exclude_the_border_only() {
    let (m, n) = (24, 20);
    let ramp: Vec<f64> = (0..m * n).map(|k| 0.5 * (k % n) as f64 - 0.25 * (k / n) as f64).collect();
    let mask = hessian_mask::<f64>(n, m);
    for boundary in BOUNDARIES {
        let h = hessian(boundary, n, m, &ramp);
        assert!(
            h.iter().map(|v| v.abs()).sum::<f64>() > 1.0,
            "{boundary:?}: the raw operator sees the border"
        );
        assert!(h.iter().zip(&mask).all(|(v, k)| v * k == 0.0), "{boundary:?}: the masked one does not");
    }
    let inside = mask.iter().sum::<f64>() as usize;
    assert_eq!(inside, m * (n - 2) + 2 * (m - 1) * (n - 1) + (m - 2) * n);
    assert_eq!(gradient_mask::<f64>(n, m).iter().sum::<f64>() as usize, m * (n - 1) + (m - 1) * n);
}

#[test]
fn norms_of_the_operators() {
    let (m, n) = (32, 32);
    let checker: Vec<f64> = (0..m * n).map(|k| if (k / n + k % n) % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let e = dot(&checker, &checker);
    let g = gradient(Boundary::Periodic, n, m, &checker);
    let h = hessian(Boundary::Periodic, n, m, &checker);
    assert!((dot(&g, &g) / e - 8.0).abs() < 1e-12 && (dot(&h, &h) / e - 64.0).abs() < 1e-12);
}
