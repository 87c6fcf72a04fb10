//! The stages of a convex model: logarithm, coherence, noise, weights, solver, and the way back.
//!
//! What a stage has used up is freed before the next one: the solver holds most of the memory.

use super::black::classes;
use super::coherence::{SHARPNESS, auxiliary_weight};
#[cfg(feature = "gpu")]
use super::gpu::{Means, OnDevice};
use super::noise::{log_sigma, mad_sigma};
use super::pipeline::{Gpu, LEFT_OUT, Settings};
use super::plan::now;
use super::prepare::Prepared;
#[cfg(feature = "gpu")]
use super::variational::problem;
use super::variational::{VariationalModel, adaptive_weight, choose_by_halves, least, minimise};
use super::window::blur_mean;
use super::{Plan, Stage, divisor};
use crate::DenoiseError;
use std::borrow::Cow;

/// Deviation of the window of the means in pixels.
const SIGMA: f32 = 8.0;

/// What the plan says where they are not restored.
pub(super) const NOT_RESTORED: &str = "restoring it is switched off";

/// Irradiance by a convex model, and its `c`.
pub(super) async fn variational(
    gpu: Option<&Gpu>,
    model: VariationalModel,
    p: &mut Prepared<'_>,
    settings: &Settings,
    plan: &mut Plan,
) -> Result<(Vec<f32>, f32), DenoiseError> {
    // Of the regression.
    p.trust = Vec::new();
    let sampled = sampled(&p.weight);
    let mask = sampled.as_deref().unwrap_or(&p.weight);
    let target =
        plan.stage("logarithm", || (logarithm(&p.irradiance), "log(1 + irradiance), after all sums"));
    let auxiliary = match settings.without.has(Stage::Coherence) {
        true => {
            plan.skip("coherence", LEFT_OUT);
            vec![1.0; p.shape.pixels()]
        }
        _ if p.divisor.is_none() && !p.features.has_edges() => {
            plan.skip("coherence", "no guide is in use");
            vec![1.0; p.shape.pixels()]
        }
        _ => plan.stage("coherence", || {
            let mut features = p.features.borrowed();
            features.albedo = p.divisor.as_deref().map(Cow::Borrowed);
            (auxiliary_weight(&features, p.shape, SHARPNESS), "edges of the guides and of the divisor")
        }),
    };
    let sigma = plan.stage("deviation", || match &p.variance {
        Some(v) => (log_sigma(&p.level(), v, mask, p.shape.width), "from the known variance"),
        None => (deviation(p, &target), "median of the finest diagonal wavelets"),
    });
    let iterations = settings.iterations;
    #[cfg(feature = "gpu")]
    let mut device = gpu.map(|gpu| OnDevice::new(gpu, settings.device_required));
    #[cfg(not(feature = "gpu"))]
    if let Some(never) = gpu {
        match *never {}
    }
    let strength = match (settings.strength, &p.halves) {
        (Some(c), _) => {
            plan.run("strength", format!("c = {c}, given"));
            c
        }
        (None, Some([a, b])) => {
            let began = now();
            let halves = [&logarithm(a)[..], &logarithm(b)[..]];
            let grid = VariationalModel::GRID.map(|f| f * model.strength());
            // A half has twice the variance of the mean.
            let alpha = |c: f32| adaptive_weight(std::f32::consts::SQRT_2 * c, &sigma, &auxiliary);
            let scores: Option<Vec<f64>>;
            #[cfg(feature = "gpu")]
            {
                let of = |c, target| problem(model, p.shape, target, mask, alpha(c));
                scores = match &mut device {
                    Some(device) => device.scores(&grid, halves, mask, iterations, of).await?,
                    None => None,
                };
            }
            #[cfg(not(feature = "gpu"))]
            {
                scores = None;
            }
            let on_cpu = |c: f32, target: &[f32]| {
                minimise(model, p.shape, Cow::Borrowed(target), mask, alpha(c), iterations)
            };
            let c = match scores {
                Some(scores) => least(&grid, &scores),
                None => choose_by_halves(&grid, halves, mask, on_cpu)?.0,
            };
            plan.timed("strength", format!("c = {c}, by cross-validation of the halves"), began);
            c
        }
        (None, None) => {
            let c = model.strength();
            plan.run("strength", format!("c = {c}, the default for pictures without halves"));
            c
        }
    };
    DenoiseError::setting(
        "the strength",
        f64::from(strength),
        "finite and not negative",
        strength >= 0.0 && strength.is_finite(),
    )?;
    let alpha = adaptive_weight(strength, &sigma, &auxiliary);
    drop((sigma, auxiliary));
    #[cfg(feature = "gpu")]
    if let Some(device) = &mut device {
        let problem = problem(model, p.shape, &target, mask, alpha.clone());
        let means = Means { noisy: &p.irradiance, weight: mask, black: &p.black, sigma: SIGMA };
        let means = settings.restore_mean.then_some(&means);
        if let Some(u) = device.solve(&problem, iterations, means, plan).await? {
            return Ok((u, strength));
        }
    }
    // Made again from the albedo afterwards.
    p.divisor = None;
    let mut u = plan.stage("solver", || {
        let u = minimise(model, p.shape, Cow::Owned(target), mask, alpha, iterations);
        (u, format!("{iterations} steps"))
    })?;
    let demodulated = p.features.albedo.as_deref().filter(|_| !settings.without.has(Stage::Demodulation));
    p.divisor = demodulated.map(divisor);
    match settings.restore_mean {
        true => plan.stage("mean", || {
            way_back(&mut u, p.shape.width, Some((&p.irradiance, mask, &p.black)));
            ((), "local means of the noisy picture")
        }),
        false => {
            way_back(&mut u, p.shape.width, None);
            plan.skip("mean", NOT_RESTORED);
        }
    }
    Ok((u, strength))
}

/// From logarithms to irradiance; with the noisy irradiance, its mask and the black pixels the local means are restored.
pub(crate) fn way_back(u: &mut [f32], width: usize, means: Option<(&[f32], &[f32], &[usize])>) {
    u.iter_mut().for_each(|v| *v = v.max(0.0).exp_m1());
    let Some((noisy, mask, black)) = means else { return };
    // A lamp in the mean of what is around would show as a frame.
    let [others, own] = classes(mask, black);
    restore_mean(u, noisy, &others, width, |i| own[i] == 0.0);
    if !black.is_empty() {
        restore_mean(u, noisy, &own, width, |i| own[i] > 0.0);
    }
}

/// 1 where there is a sample, 0 at holes; `None` where the weights are that already.
fn sampled(weight: &[f32]) -> Option<Vec<f32>> {
    let same = weight.iter().all(|w| *w == 0.0 || *w == 1.0);
    (!same).then(|| weight.iter().map(|w| if *w > 0.0 { 1.0 } else { 0.0 }).collect())
}

fn logarithm(u: &[f32]) -> Vec<f32> {
    u.iter().map(|v| v.ln_1p()).collect()
}

/// Deviation of the noise from the target itself, root mean square over the channels.
fn deviation(p: &Prepared<'_>, target: &[f32]) -> Vec<f32> {
    let n = p.shape.pixels();
    let mut sum = vec![0.0; n];
    for plane in target.chunks(n) {
        let sigma = mad_sigma(plane, p.shape.width, p.shape.height);
        sum.iter_mut().zip(sigma).for_each(|(a, s)| *a += s * s * (1.0 / 3.0));
    }
    sum.iter_mut().for_each(|s| *s = s.sqrt());
    sum
}

/// `u G(L)/G(u)` with a Gaussian of sigma 8: total variation of logarithms darkens, for the logarithm is concave. Only
/// pixels that are `of` the class with `weight`.
fn restore_mean(u: &mut [f32], noisy: &[f32], weight: &[f32], width: usize, of: impl Fn(usize) -> bool) {
    let n = weight.len();
    for (u, l) in u.chunks_mut(n).zip(noisy.chunks(n)) {
        let (bright, dark) = (blur_mean(l, weight, width, SIGMA), blur_mean(u, weight, width, SIGMA));
        for (i, ((u, b), d)) in u.iter_mut().zip(bright).zip(dark).enumerate() {
            if d > 1e-6 && of(i) {
                *u *= (b / d).clamp(0.5, 2.0);
            }
        }
    }
}
