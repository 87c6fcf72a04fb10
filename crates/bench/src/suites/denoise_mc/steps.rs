//! What each step brings: the automatic model without one of its inputs, the convex model built up step by step.

use super::cases::{Case, View};
use super::score::score;
use super::{figures, single};
use crate::context::Context;
use anyhow::Result;
use photofit_denoise::Shape;
use photofit_denoise::mc::{
    Guides, Model, SHARPNESS, Settings, VariationalModel, adaptive_weight, blended_weight, curvature,
    demodulate, denoise, divisor, mad_sigma, remodulate, solve_variational,
};

const HYBRID: VariationalModel = VariationalModel::Hybrid;

/// `s_E` of the published weight for deviations from medians.
const PUBLISHED_SHARPNESS: f32 = 3.0;

/// The published weights of one alpha are tried with these.
const ALPHAS: [f32; 9] = [0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28, 2.56, 5.12];

/// Mean irradiance to which the pipeline scales every picture.
const EXPOSURE: f64 = 0.35;

/// The automatic model without one guide, without all, and with all samples as they are.
pub(super) fn automatic(ctx: &mut Context, case: &Case, label: &str) -> Result<()> {
    let view = case.last();
    let all = case.frame(view).guides;
    for (name, guides) in [
        ("auto without normal", Guides { normal: None, ..all }),
        ("auto without position", Guides { position: None, ..all }),
        ("auto without albedo", Guides { albedo: None, ..all }),
        ("auto without guides", Guides::default()),
    ] {
        if given(&guides) == given(&all) {
            continue;
        }
        let frame = case.frame(view).with_guides(guides);
        let work = || denoise(&frame, &Settings::default());
        ctx.measure(name, label, case.pixels(), work, |d| figures(case, d.as_ref().ok()))?;
    }
    let settings = Settings { fireflies: false, ..Settings::default() };
    single(ctx, case, "auto, fireflies kept", label, settings)
}

/// Guides that are there.
fn given(guides: &Guides<'_>) -> usize {
    [guides.albedo, guides.normal, guides.position].iter().flatten().count()
}

/// The convex model, each row with one step more than the row before.
pub(super) fn variational(ctx: &mut Context, case: &Case, label: &str) -> Result<()> {
    let view = case.last();
    let shape = Shape::new(case.width, case.height, 3);
    let weight = vec![1.0; shape.pixels()];
    let ladder = Ladder { case, shape, weight };
    let raw = ladder.target(view, false, false);
    let log = ladder.target(view, false, true);
    let demodulated = ladder.target(view, true, true);
    let flat = vec![1.0; shape.pixels()];
    let edges = ladder.edges(view);
    let sigma = deviation(&demodulated.values, shape);
    let blended = blended_weight(&edges, &sigma, PUBLISHED_SHARPNESS);
    for (name, target, weight) in [
        ("hybrid 1: radiance, best alpha", &raw, &flat),
        ("hybrid 2: + logarithm", &log, &flat),
        ("hybrid 3: + demodulation", &demodulated, &flat),
        ("hybrid 4: + guides", &demodulated, &edges),
        ("hybrid 5: + noise, published weight", &demodulated, &blended),
    ] {
        ladder.best(ctx, name, label, target, &|a| weight.iter().map(|w| a * w).collect())?;
    }
    let automatic = |a: f32| adaptive_weight(a, &sigma, &edges);
    let ours = ladder.solve(&demodulated, &automatic(HYBRID.strength()))?;
    let work = || ladder.solve(&demodulated, &automatic(HYBRID.strength()));
    ctx.measure("hybrid 6: automatic alpha instead", label, case.pixels(), work, |_| score(case, &ours))?;
    let settings = Settings { model: Model::Variational(HYBRID), ..Settings::default() };
    let dark = Settings { restore_mean: false, ..settings };
    single(ctx, case, "hybrid 7: + fireflies clamped", label, dark)?;
    single(ctx, case, "hybrid 8: + mean restored", label, settings)
}

/// What a model minimises over, and the way back to radiance.
struct Target {
    values: Vec<f32>,
    divisor: Option<Vec<f32>>,
    key: f32,
    logarithm: bool,
}

struct Ladder<'a> {
    case: &'a Case,
    shape: Shape,
    weight: Vec<f32>,
}

impl Ladder<'_> {
    fn target(&self, view: &View, demodulation: bool, logarithm: bool) -> Target {
        let mut values: Vec<f32> =
            view.color.iter().map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 }).collect();
        let divisor = view.albedo.as_deref().filter(|_| demodulation).map(divisor);
        if let Some(d) = &divisor {
            demodulate(&mut values, d);
        }
        let key = exposure(&values);
        let scaled = |v: f32| if logarithm { (v * key).ln_1p() } else { v * key };
        values.iter_mut().for_each(|v| *v = scaled(*v));
        Target { values, divisor, key, logarithm }
    }

    /// `exp(-s_A max C)` of the guides.
    fn edges(&self, view: &View) -> Vec<f32> {
        let mut most = vec![0.0_f32; self.shape.pixels()];
        let d = view.albedo.as_deref().map(divisor);
        for guide in [&d, &view.normal, &view.position].into_iter().flatten() {
            let c = curvature(guide, self.shape.width, self.shape.height);
            most.iter_mut().zip(c).for_each(|(m, c)| *m = m.max(c));
        }
        most.iter().map(|c| (-SHARPNESS * c).exp()).collect()
    }

    /// Radiance of the minimiser.
    fn solve(&self, target: &Target, alpha: &[f32]) -> Result<Vec<f32>> {
        let iterations = Settings::default().iterations;
        let mut u = solve_variational(HYBRID, self.shape, &target.values, &self.weight, alpha, iterations)?;
        let plain = |v: f32| if target.logarithm { v.max(0.0).exp_m1() } else { v.max(0.0) };
        u.iter_mut().for_each(|v| *v = plain(*v) / target.key);
        if let Some(d) = &target.divisor {
            remodulate(&mut u, d);
        }
        Ok(u)
    }

    /// Records the result of the alpha that is closest to the reference.
    fn best(
        &self,
        ctx: &mut Context,
        method: &str,
        label: &str,
        target: &Target,
        weights: &dyn Fn(f32) -> Vec<f32>,
    ) -> Result<()> {
        let mut best = (f64::INFINITY, ALPHAS[0]);
        for alpha in ALPHAS {
            let error = super::display_rmse(self.case, &self.solve(target, &weights(alpha))?);
            best = if error < best.0 { (error, alpha) } else { best };
        }
        let weights = weights(best.1);
        let work = || self.solve(target, &weights);
        let figures = |u: &[f32]| {
            let mut figures = score(self.case, u);
            figures.push(("alpha", f64::from(best.1)));
            figures
        };
        let size = self.case.pixels();
        ctx.measure(method, label, size, work, |u| u.as_ref().map_or(Vec::new(), |u| figures(u)))?;
        Ok(())
    }
}

/// Deviation of the noise from the target itself, root mean square over the channels.
fn deviation(target: &[f32], shape: Shape) -> Vec<f32> {
    let n = shape.pixels();
    let mut sum = vec![0.0; n];
    for plane in target.chunks(n) {
        let sigma = mad_sigma(plane, shape.width, shape.height);
        sum.iter_mut().zip(sigma).for_each(|(a, s)| *a += s * s / 3.0);
    }
    sum.iter().map(|s| s.sqrt()).collect()
}

/// Factor to the common exposure: the mean without the brightest hundredth.
fn exposure(values: &[f32]) -> f32 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f32::total_cmp);
    let kept = sorted.len() - sorted.len() / 100;
    let mean = sorted[..kept].iter().map(|v| f64::from(*v)).sum::<f64>() / kept as f64;
    if mean > 0.0 { (EXPOSURE / mean) as f32 } else { 1.0 }
}
