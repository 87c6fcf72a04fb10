//! Solvers against the operators, and against each other.

use photofit_sampling::Rng;

use super::*;
use crate::operators::{Boundary, divergence, gradient, hessian, hessian_adjoint};

const SYMBOLS: [Symbol; 4] = [
    Symbol { c0: 1.5, c1: 0.0, c2: 0.0 },
    Symbol { c0: 0.3, c1: 2.0, c2: 0.0 },
    Symbol { c0: 0.7, c1: 0.0, c2: 1.5 },
    Symbol { c0: 1e-3, c1: 4.0, c2: 9.0 },
];

fn random(n: usize) -> Vec<f64> {
    let mut rng = Rng::new(11, 0);
    (0..n).map(|_| rng.next_f64() - 0.5).collect()
}

/// `(c0 + c1 L + c2 L^2) u` by the plain operators.
fn apply(boundary: Boundary, symbol: Symbol, m: usize, n: usize, u: &[f64]) -> Vec<f64> {
    let l = divergence(boundary, n, m, &gradient(boundary, n, m, u));
    let h = hessian_adjoint(boundary, n, m, &hessian(boundary, n, m, u));
    (0..m * n).map(|k| symbol.c0 * u[k] - symbol.c1 * l[k] + symbol.c2 * h[k]).collect()
}

#[test]
fn spectral_solutions_satisfy_the_system() {
    for boundary in [Boundary::Periodic, Boundary::Neumann] {
        for (m, n) in [(1, 1), (1, 8), (9, 1), (2, 3), (7, 11), (32, 30), (17, 64)] {
            for symbol in SYMBOLS {
                let f = random(m * n);
                let mut u = f.clone();
                SpectralSolver::new(boundary, n, m, symbol).solve(&mut u);
                let residual = apply(boundary, symbol, m, n, &u);
                let worst = residual.iter().zip(&f).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst < 1e-11, "{boundary:?} {m}x{n} {symbol:?}: {worst}");
            }
        }
    }
}

/// The strip operator is the sum of periodic second differences along rows and Neumann ones along columns.
#[test]
fn strip_solutions_satisfy_the_system() {
    for (m, n) in [(1, 2), (1, 8), (9, 1), (2, 3), (3, 4), (4, 6), (7, 11), (32, 30), (97, 64), (300, 20)] {
        for symbol in SYMBOLS {
            let f = random(m * n);
            let mut u = f.clone();
            StripSolver::new(n, m, symbol).solve(&mut u);
            let l = |u: &[f64]| -> Vec<f64> {
                let x = crate::operators::dx_backward(
                    Boundary::Periodic,
                    n,
                    &crate::operators::dx_forward(Boundary::Periodic, n, u),
                );
                let y = crate::operators::dy_backward(
                    Boundary::Neumann,
                    n,
                    &crate::operators::dy_forward(Boundary::Neumann, n, u),
                );
                x.iter().zip(y).map(|(a, b)| -a - b).collect()
            };
            let (lu, llu) = (l(&u), l(&l(&u)));
            for k in 0..m * n {
                let r = symbol.c0 * u[k] + symbol.c1 * lu[k] + symbol.c2 * llu[k] - f[k];
                assert!(r.abs() < 1e-11, "{m}x{n} {symbol:?}: {r} at {k}");
            }
        }
    }
}

/// In f32 the solution keeps its digits up to the condition of the system.
#[test]
fn single_precision_solutions_are_close() {
    let (m, n) = (211, 240);
    for (symbol, tolerance) in SYMBOLS.into_iter().zip([1e-6, 1e-6, 1e-6, 3e-4]) {
        let f = random(m * n);
        let mut exact = f.clone();
        StripSolver::new(n, m, symbol).solve(&mut exact);
        let mut strip: Vec<f32> = f.iter().map(|&v| v as f32).collect();
        let mut spectral = strip.clone();
        StripSolver::new(n, m, symbol).solve(&mut strip);
        let scale = exact.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let worst = |u: &[f32]| {
            u.iter().zip(&exact).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max) / scale
        };
        SpectralSolver::new(Boundary::Periodic, n, m, symbol).solve(&mut spectral);
        println!("{symbol:?}: strip {:.1e}", worst(&strip));
        assert!(worst(&strip) < tolerance, "{symbol:?}: {}", worst(&strip));
    }
}

#[test]
fn fast_lengths_are_close_and_smooth() {
    for (n, expected) in [(1, 2), (2, 2), (7, 8), (13, 16), (1280, 1280), (1283, 1296), (721, 750)] {
        assert_eq!(fast_length(n), expected, "{n}");
    }
    for n in 1..4000 {
        assert!(fast_length(n) <= n + n / 8 + 3, "{n}: {}", fast_length(n));
    }
}
