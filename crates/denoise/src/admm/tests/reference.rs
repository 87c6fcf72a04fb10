//! A plain splitting on whole planes with the operators and the cosine or Fourier solver: the oracle of the fused one,
//! and the place where the printed errors are tried.

use crate::operators::{
    Boundary, divergence, gradient, gradient_mask, hessian, hessian_adjoint, hessian_mask,
};
use crate::transform::{SpectralSolver, Symbol};

/// One gray problem: `l1 |r| + l2/2 r^2 + alpha |grad u| + beta |H u|`, weights of the data per pixel.
pub(crate) struct Plain<'a> {
    pub(crate) rows: usize,
    pub(crate) width: usize,
    pub(crate) target: &'a [f64],
    pub(crate) l1: Vec<f64>,
    pub(crate) l2: Vec<f64>,
    pub(crate) alpha: f64,
    pub(crate) beta: f64,
    pub(crate) t: [f64; 3],
    pub(crate) boundary: Boundary,
    pub(crate) masked: bool,
    pub(crate) printed: Printed,
}

/// Which of the printed errors to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Printed {
    None,
    /// The data map as `2 lambda / (2 lambda + t0)`.
    DoubledWeight,
    /// Each component shrunk by itself.
    ComponentShrink,
    /// The mixed derivative replaced by the second one along y.
    MixedIsYy,
    /// The square pulls to the estimate and not to the target.
    PullToEstimate,
    /// The penalty of the Hessian subtracted from the symbol.
    MinusHessian,
}

impl Plain<'_> {
    /// The estimate after some iterations.
    pub(crate) fn run(&self, iterations: usize) -> Vec<f64> {
        let (m, n, size) = (self.rows, self.width, self.rows * self.width);
        let [t0, t1, t2] = self.t;
        let on = |weight: f64, t: f64| if weight > 0.0 { t } else { 0.0 };
        let (t1, t2) = (on(self.alpha, t1), on(self.beta, t2));
        let symbol = Symbol { c0: t0, c1: t1, c2: t2 };
        let mut solver = SpectralSolver::new(self.boundary, n, m, symbol);
        let (mut p, mut b0) = (self.target.to_vec(), vec![0.0; size]);
        let (mut w, mut b) = (gradient(self.boundary, n, m, &p), vec![0.0; 2 * size]);
        let (mut v, mut d) = (self.second(&p), vec![0.0; 4 * size]);
        let masks = [gradient_mask::<f64>(n, m), hessian_mask::<f64>(n, m)];
        let mut u = p.clone();
        for _ in 0..iterations {
            let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
            let div = divergence(self.boundary, n, m, &minus(&w, &b));
            let second = self.second_adjoint(&minus(&v, &d));
            u = (0..size).map(|k| t0 * (p[k] - b0[k]) - t1 * div[k] + t2 * second[k]).collect();
            if self.printed == Printed::MinusHessian {
                minus_hessian(&mut u, self.boundary, m, n, [t0, t1, t2]);
            } else {
                solver.solve(&mut u);
            }
            for k in 0..size {
                let q = u[k] + b0[k];
                let (mut s, mut l2) = (q - self.target[k], self.l2[k]);
                let mut origin = self.target[k];
                match self.printed {
                    Printed::DoubledWeight => l2 *= 2.0,
                    Printed::PullToEstimate => {
                        // The square's force vanishes: it pulls to where the estimate is.
                        (l2, s) = (0.0, q - self.target[k]);
                        origin = self.target[k];
                    }
                    _ => {}
                }
                p[k] = origin + s.signum() * (t0 * s.abs() - self.l1[k]).max(0.0) / (l2 + t0);
                b0[k] = q - p[k];
            }
            self.shrink(
                &gradient(self.boundary, n, m, &u),
                &masks[0],
                on(self.alpha, self.alpha / t1),
                &mut w,
                &mut b,
            );
            self.shrink(&self.second(&u), &masks[1], on(self.beta, self.beta / t2), &mut v, &mut d);
        }
        u
    }

    fn second(&self, u: &[f64]) -> Vec<f64> {
        let mut h = hessian(self.boundary, self.width, self.rows, u);
        if self.printed == Printed::MixedIsYy {
            let n = self.rows * self.width;
            let yy = h[3 * n..].to_vec();
            h[n..2 * n].copy_from_slice(&yy);
            h[2 * n..3 * n].copy_from_slice(&yy);
        }
        h
    }

    fn second_adjoint(&self, v: &[f64]) -> Vec<f64> {
        hessian_adjoint(self.boundary, self.width, self.rows, v)
    }

    fn shrink(&self, x: &[f64], mask: &[f64], tau: f64, w: &mut [f64], b: &mut [f64]) {
        let size = self.rows * self.width;
        for k in 0..size {
            let active = |c: &usize| !self.masked || mask[*c] > 0.0;
            let all = || (k..x.len()).step_by(size);
            let length = all().filter(active).map(|c| (x[c] + b[c]).powi(2)).sum::<f64>().sqrt();
            for c in all() {
                let z = x[c] + b[c];
                let norm = if self.printed == Printed::ComponentShrink { z.abs() } else { length };
                w[c] = if active(&c) { z * (norm - tau).max(0.0) / norm.max(1e-30) } else { z };
                b[c] = z - w[c];
            }
        }
    }
}

/// Divides by `t0 + t1 L - t2 L^2` in the cosine domain, mode by mode, by the plain sum.
fn minus_hessian(f: &mut [f64], boundary: Boundary, m: usize, n: usize, [t0, t1, t2]: [f64; 3]) {
    assert_eq!(boundary, Boundary::Neumann, "cosine modes");
    let basis = |k: usize, i: usize, n: usize| {
        let scale = if k == 0 { 1.0 / n as f64 } else { 2.0 / n as f64 };
        scale.sqrt() * (std::f64::consts::PI * k as f64 * (i as f64 + 0.5) / n as f64).cos()
    };
    let mut out = vec![0.0; f.len()];
    for r in 0..m {
        for s in 0..n {
            let mode: Vec<f64> = (0..m * n).map(|k| basis(r, k / n, m) * basis(s, k % n, n)).collect();
            let coefficient: f64 = mode.iter().zip(&*f).map(|(a, b)| a * b).sum();
            let angle = |k: usize, n: usize| 2.0 - 2.0 * (std::f64::consts::PI * k as f64 / n as f64).cos();
            let l = angle(r, m) + angle(s, n);
            let c = coefficient / (t0 + t1 * l - t2 * l * l);
            for (o, v) in out.iter_mut().zip(&mode) {
                *o += c * v;
            }
        }
    }
    f.copy_from_slice(&out);
}
