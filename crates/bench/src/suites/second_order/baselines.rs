//! What the sampled methods are measured against: Adam on finite differences, and an evolution strategy.

use anyhow::Result;
use photofit_optim::{Optimizer, Temporal};
use photofit_sampling::Rng;

use super::race::Trace;
use super::tasks::Task;

/// Adam on central differences, `step` to either side, one parameter after the other. The rate falls as the sampled
/// Adam's does.
pub(super) fn finite_differences(task: &Task, seed: u64) -> Result<Trace> {
    let step = task.sigma[1];
    let mut theta = (task.start)(seed);
    let n = theta.len();
    let mut trace = Trace::begin(task, &theta);
    let mut adam = Optimizer::new("theta", n, Temporal { beta2: 0.99, ..Temporal::adam() })?;
    let iterations = task.budget / (2 * n as u64);
    let mut gradient = vec![0.0; n];
    for i in 0..iterations {
        for k in 0..n {
            let centre = theta[k];
            let [plus, minus] = [step, -step].map(|h| {
                theta[k] = centre + h;
                (task.f)(&theta, i)
            });
            theta[k] = centre;
            gradient[k] = (plus - minus) / (2.0 * step);
        }
        let share = i as f64 / iterations as f64;
        let rate = task.rate * (1.0 + share * (task.sigma[1] / task.sigma[0] - 1.0));
        adam.step(&mut theta, &gradient, rate)?;
        if trace.see(2 * n as u64 * (i + 1), &theta) {
            break;
        }
    }
    Ok(trace)
}

/// Loss, normal draw and the step it makes.
type Child = (f64, Vec<f64>, Vec<f64>);

/// CMA-ES (Hansen 2016): weighted recombination, rank-one and rank-mu updates, step-size control by cumulation; the root
/// of the covariance is its Cholesky factor.
pub(super) fn evolution(task: &Task, seed: u64) -> Trace {
    let mut mean = (task.start)(seed);
    let mut trace = Trace::begin(task, &mean);
    let n = mean.len();
    let nf = n as f64;
    let lambda = 4 + (3.0 * nf.ln()) as usize;
    let mu = lambda / 2;
    let raw: Vec<f64> = (1..=mu).map(|i| (mu as f64 + 0.5).ln() - (i as f64).ln()).collect();
    let total: f64 = raw.iter().sum();
    let weights: Vec<f64> = raw.iter().map(|w| w / total).collect();
    let mu_eff = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
    let cs = (mu_eff + 2.0) / (nf + mu_eff + 5.0);
    let damping = 1.0 + 2.0 * (((mu_eff - 1.0) / (nf + 1.0)).sqrt() - 1.0).max(0.0) + cs;
    let cc = (4.0 + mu_eff / nf) / (nf + 4.0 + 2.0 * mu_eff / nf);
    let c1 = 2.0 / ((nf + 1.3).powi(2) + mu_eff);
    let cmu = (1.0 - c1).min(2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((nf + 2.0).powi(2) + mu_eff));
    let chi = nf.sqrt() * (1.0 - 1.0 / (4.0 * nf) + 1.0 / (21.0 * nf * nf));
    let mut sigma = task.sigma[0];
    let mut c: Vec<f64> = (0..n * n).map(|e| f64::from(u8::from(e / n == e % n))).collect();
    let (mut ps, mut pc) = (vec![0.0; n], vec![0.0; n]);
    let mut rng = Rng::new(seed, 77);
    let mut evaluations = 0;
    while evaluations < task.budget {
        let root = cholesky(&c, n);
        let mut offspring: Vec<Child> = (0..lambda)
            .map(|_| {
                let z: Vec<f64> = (0..n).map(|_| f64::from(rng.normal())).collect();
                let y: Vec<f64> = (0..n).map(|i| (0..=i).map(|j| root[i * n + j] * z[j]).sum()).collect();
                let x: Vec<f64> = mean.iter().zip(&y).map(|(m, y)| m + sigma * y).collect();
                ((task.f)(&x, evaluations), z, y)
            })
            .collect();
        evaluations += lambda as u64;
        offspring.sort_by(|a, b| a.0.total_cmp(&b.0));
        let average = |pick: fn(&Child) -> &Vec<f64>| -> Vec<f64> {
            (0..n).map(|i| weights.iter().zip(&offspring).map(|(w, o)| w * pick(o)[i]).sum()).collect()
        };
        let (zw, yw) = (average(|o| &o.1), average(|o| &o.2));
        mean.iter_mut().zip(&yw).for_each(|(m, y)| *m += sigma * y);
        let grow = (cs * (2.0 - cs) * mu_eff).sqrt();
        ps.iter_mut().zip(&zw).for_each(|(p, z)| *p = (1.0 - cs) * *p + grow * z);
        let length = ps.iter().map(|p| p * p).sum::<f64>().sqrt();
        sigma *= ((cs / damping) * (length / chi - 1.0)).clamp(-1.0, 1.0).exp();
        let grow = (cc * (2.0 - cc) * mu_eff).sqrt();
        pc.iter_mut().zip(&yw).for_each(|(p, y)| *p = (1.0 - cc) * *p + grow * y);
        for e in 0..n * n {
            let (i, j) = (e / n, e % n);
            let rank: f64 = weights.iter().zip(&offspring).map(|(w, o)| w * o.2[i] * o.2[j]).sum();
            c[e] = (1.0 - c1 - cmu) * c[e] + c1 * pc[i] * pc[j] + cmu * rank;
        }
        if trace.see(evaluations, &mean) {
            break;
        }
    }
    trace
}

/// Lower Cholesky factor; pivots lost to rounding count as tiny.
fn cholesky(a: &[f64], n: usize) -> Vec<f64> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let rest = a[i * n + j] - sum;
            l[i * n + j] = if i == j { rest.max(1e-30).sqrt() } else { rest / l[j * n + j] };
        }
    }
    l
}
