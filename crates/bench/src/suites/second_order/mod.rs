//! Minimisation of black boxes: sampled first and second derivatives against finite differences and an evolution
//! strategy, error of the parameters against iterations, evaluations and time.

mod baselines;
mod race;
mod rendered;
mod tasks;

use anyhow::Result;

use crate::context::Context;
use crate::plot::Axis;
use crate::timing::Timing;
use race::{Entry, METHODS, Trace};
use tasks::Task;

/// Runs of the tasks that cost microseconds, and of those that render.
const SEEDS: u64 = 20;
const RENDERED_SEEDS: u64 = 5;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for task in [tasks::quad(), tasks::gaussian(), tasks::box2(), tasks::box10()] {
        measure(ctx, &task, SEEDS)?;
    }
    let rendered =
        [rendered::mug_task(), rendered::shadow_task()?, rendered::bunny_task()?, rendered::texture_task()];
    for task in rendered {
        measure(ctx, &task, RENDERED_SEEDS)?;
    }
    ctx.note(format!(
        "Evaluations: median over the runs until 1% of the parameters' error is left, missing where half of the runs or \
         more do not get there; time: to the same point, or of the whole run. {SEEDS} runs each, {RENDERED_SEEDS} of \
         the tasks that render; solved: the share that got there within the task's budget. Error left: the least, \
         median over the runs. Known: evaluations of the specification's re-runs, first-order or L-BFGS. Differences and \
         CMA-ES stop at 16 parameters, Newton's method at 10."
    ));
    Ok(())
}

/// Runs every method on one task.
fn measure(ctx: &mut Context, task: &Task, seeds: u64) -> Result<()> {
    let mut curves: Vec<(String, Vec<Trace>)> = Vec::new();
    for Entry { name, most, run } in METHODS {
        if task.dimension() > most {
            continue;
        }
        let traces = (0..seeds).map(|seed| run(task, seed)).collect::<Result<Vec<Trace>>>()?;
        let seconds = traces.iter().map(|t| t.done().map_or_else(|| t.seconds(), |d| d.1)).collect();
        let mut figures = vec![("error left", median(traces.iter().map(Trace::best)))];
        let solved = traces.iter().filter(|t| t.done().is_some()).count();
        if 2 * solved > traces.len() {
            let evaluations = traces.iter().map(|t| t.done().map_or(f64::INFINITY, |d| d.0 as f64));
            figures.push(("evaluations to 1%", median(evaluations)));
        }
        figures.push(("solved", solved as f64 / traces.len() as f64));
        let known = match name {
            "sampled, Adam" => task.known[0],
            "sampled, L-BFGS" => task.known[1],
            _ => None,
        };
        figures.extend(known.map(|k| ("known", k as f64)));
        ctx.record(name, task.name, task.dimension(), Timing::of(seconds), figures);
        curves.push((name.to_owned(), traces));
    }
    draw(ctx, task, &curves)
}

/// One plot for each abscissa: the median over the runs of the error left.
fn draw(ctx: &mut Context, task: &Task, curves: &[(String, Vec<Trace>)]) -> Result<()> {
    type Abscissa = fn(usize, &(u64, f64, f64)) -> f64;
    let axes: [(&str, &str, Abscissa); 3] = [
        ("iterations", "iterations", |i, _| (i + 1) as f64),
        ("evaluations", "evaluations", |_, p| p.0 as f64),
        ("seconds", "milliseconds", |_, p| 1e3 * p.1),
    ];
    for (ending, words, at) in axes {
        let lines: Vec<(String, Vec<(f64, f64)>)> =
            curves.iter().map(|(name, traces)| (name.clone(), medians(traces, at))).collect();
        let title = format!("{}: share of the parameters' error that is left", task.name);
        let file = format!("{}-{ending}", task.name.trim_start_matches('-').to_lowercase());
        ctx.plot(&file, &title, [Axis(words), Axis("error")], &lines)?;
    }
    Ok(())
}

/// The median over runs of the least error so far, at about 40 places of the abscissa.
fn medians(traces: &[Trace], at: fn(usize, &(u64, f64, f64)) -> f64) -> Vec<(f64, f64)> {
    let runs: Vec<Vec<(f64, f64)>> = traces
        .iter()
        .map(|t| {
            let mut least = 1.0_f64;
            let points = t.points.iter().enumerate();
            points
                .map(|(i, p)| {
                    least = least.min(p.2);
                    (at(i, p), least)
                })
                .collect()
        })
        .collect();
    let ends = |pick: fn(f64, f64) -> f64, start: f64| runs.iter().flatten().map(|p| p.0).fold(start, pick);
    let (low, high) = (ends(f64::min, f64::INFINITY).max(1e-6), ends(f64::max, 0.0));
    let places = 40;
    let mut curve: Vec<(f64, f64)> = Vec::new();
    for k in 0..=places {
        let x = low * (high / low).powf(f64::from(k) / f64::from(places));
        let left = runs.iter().map(|run| run.iter().take_while(|p| p.0 <= x).last().map_or(1.0, |p| p.1));
        curve.push((x, median(left)));
    }
    // Flat ends say nothing.
    let last = curve.iter().position(|p| p.1 <= curve[curve.len() - 1].1).unwrap_or(0);
    curve.truncate(last + 1);
    curve
}

/// The upper median.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests;
