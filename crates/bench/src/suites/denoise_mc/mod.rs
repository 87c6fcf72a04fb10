//! Monte Carlo denoising: models, single frames and sequences, what each step brings, error against time.
//!
//! `PHOTOFIT_BENCH_DENOISE` names a folder whose subfolders hold rendered sets (`cameras.json` with EXR files, or pictures
//! named `spp1.png` or `cornell_1spp/color.hdr` with their guides); without it a small analytic scene is taken.

mod cases;
mod score;
mod steps;

use anyhow::{Result, anyhow};
use photofit_denoise::mc::{Denoised, Model, Sequence, Settings, VariationalModel, denoise};
use std::time::Instant;

use crate::context::Context;
use crate::plot::Axis;
use crate::timing::Timing;
use cases::{Case, cases};
use score::{display_rmse, score};

const MODELS: [(&str, Model); 6] = [
    ("auto", Model::Auto),
    ("rof", Model::Variational(VariationalModel::Rof)),
    ("tvl1", Model::Variational(VariationalModel::TvL1)),
    ("hybrid", Model::Variational(VariationalModel::Hybrid)),
    ("tgv", Model::Variational(VariationalModel::Tgv)),
    ("atrous", Model::Atrous),
];

/// Repetitions of one frame of a sequence.
const RUNS: usize = 5;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for case in &cases()? {
        let label = format!("{}, {} spp", case.name, case.spp);
        let none = Timing::of(vec![0.0]);
        ctx.record("noisy", &label, case.pixels(), none, score(case, &case.last().color));
        for (name, model) in MODELS {
            single(ctx, case, name, &label, Settings { model, ..Settings::default() })?;
        }
        if case.is_sequence() {
            for (name, model) in MODELS {
                sequence(ctx, case, &format!("{name}, sequence"), &label, model)?;
            }
        }
        steps::automatic(ctx, case, &label)?;
        steps::variational(ctx, case, &label)?;
        convergence(ctx, case, &label)?;
    }
    ctx.note(
        "Displayed pictures (sRGB, cut to [0, 1]) against their references. The time of a sequence is that of its last \
         frame: history and filter. Automatic parameters, but for the rows with \"best alpha\": there one number for the \
         whole picture was chosen by the reference.",
    );
    Ok(())
}

fn single(ctx: &mut Context, case: &Case, method: &str, label: &str, settings: Settings) -> Result<()> {
    let frame = case.frame(case.last());
    let work = || denoise(&frame, &settings);
    ctx.measure(method, label, case.pixels(), work, |d| figures(case, d.as_ref().ok()))?;
    Ok(())
}

fn figures(case: &Case, result: Option<&Denoised>) -> Vec<(&'static str, f64)> {
    result.map_or(Vec::new(), |d| score(case, &d.color))
}

/// The last frame of a sequence.
fn sequence(ctx: &mut Context, case: &Case, method: &str, label: &str, model: Model) -> Result<()> {
    let mut before = Sequence::new(Settings { model, ..Settings::default() });
    let push = |s: &mut Sequence, k: usize| -> Result<()> {
        let view = &case.views[k];
        let camera = view.camera.ok_or_else(|| anyhow!("{label}: frame {k} has no camera"))?;
        Ok(s.push(&case.frame(view), camera)?)
    };
    let last = case.views.len() - 1;
    (0..last).try_for_each(|k| push(&mut before, k))?;
    let mut seconds = Vec::with_capacity(RUNS);
    let mut result = None;
    for _ in 0..RUNS {
        let mut history = before.clone();
        let began = Instant::now();
        push(&mut history, last)?;
        result = history.denoise().transpose()?;
        seconds.push(began.elapsed().as_secs_f64());
    }
    ctx.record(method, label, case.pixels(), Timing::of(seconds), figures(case, result.as_ref()));
    Ok(())
}

/// Error against time of each model: points are numbers of iterations, a single one for models that have none.
fn convergence(ctx: &mut Context, case: &Case, label: &str) -> Result<()> {
    let frame = case.frame(case.last());
    let mut curves = Vec::new();
    for (name, model) in MODELS {
        let counts: &[usize] = match model {
            Model::Variational(VariationalModel::Tgv) => &[1, 2, 5, 10, 20],
            Model::Variational(_) => &[1, 2, 5, 10, 20, 50],
            Model::Auto | Model::Atrous => &[1],
        };
        let mut points = Vec::new();
        for iterations in counts {
            let settings = Settings { model, iterations: *iterations, ..Settings::default() };
            let mut best = f64::INFINITY;
            let mut error = 0.0;
            for _ in 0..3 {
                let began = Instant::now();
                let result = denoise(&frame, &settings)?;
                best = best.min(began.elapsed().as_secs_f64());
                error = display_rmse(case, &result.color);
            }
            points.push((1e3 * best, error));
        }
        curves.push((name.to_owned(), points));
    }
    let ending: String = label.chars().filter_map(|c| if c == ' ' { Some('-') } else { named(c) }).collect();
    ctx.plot(&ending, label, [Axis("milliseconds"), Axis("RMSE, displayed")], &curves)
}

/// Letters and digits, for the name of a file.
fn named(c: char) -> Option<char> {
    c.is_ascii_alphanumeric().then_some(c)
}
