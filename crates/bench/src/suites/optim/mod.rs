//! First-order optimizers: the problems of figures 2 and 3 of the bilateral optimizer's paper, and ablations.

pub(crate) mod speed;

use std::time::Instant;

use anyhow::Result;
use photofit_optim::{Bilateral, Placement, Sigma, Taps};
use piecewise::{Filter, Method, Source, Target, floor, steps_below};

use crate::context::Context;
use crate::plot::Axis;
use crate::timing::Timing;

/// The problems and methods, shared with the gates of the optimizers' tests.
#[path = "../../../../optim/tests/piecewise/mod.rs"]
mod piecewise;

/// Targets, matrices and noise are drawn anew for each.
const SEEDS: u64 = 5;

/// A problem in one or two dimensions.
#[derive(Clone, Copy)]
struct Problem {
    name: &'static str,
    ending: &'static str,
    target: fn(u64) -> Target,
    source: fn(u64) -> Source,
    steps: usize,
    /// Step at which methods are compared.
    at: usize,
}

const PROBLEMS: [Problem; 4] = [
    Problem {
        name: "anisotropic, 1-D",
        ending: "anisotropic-line",
        target: Target::line,
        source: |seed| Source::anisotropic(seed, 1000),
        steps: 1000,
        at: 250,
    },
    Problem {
        name: "noisy, 1-D",
        ending: "noisy-line",
        target: Target::line,
        source: Source::noisy,
        steps: 300,
        at: 250,
    },
    Problem {
        name: "anisotropic, 2-D",
        ending: "anisotropic-plane",
        target: |seed| Target::plane(seed, 32),
        source: |seed| Source::anisotropic(seed, 1024),
        steps: 1000,
        at: 250,
    },
    Problem {
        name: "noisy, 2-D",
        ending: "noisy-plane",
        target: |seed| Target::plane(seed, 128),
        source: Source::noisy,
        steps: 300,
        at: 250,
    },
];

const TUNED: Sigma = Sigma::Fixed(0.02);
const AUTO: Sigma = Sigma::Auto(2.0);

/// The methods compared on anisotropic problems.
const ANISOTROPIC: [Method; 6] = [
    Method::adam(0.13, 0.9),
    Method::laplacian(0.13, 0.9, 10.0),
    Method::bilateral(0.01, 0.5, TUNED),
    Method::bilateral(0.01, 0.5, AUTO).named("bilateral, automatic"),
    Method::bilateral(0.1, 0.5, AUTO).named("bilateral, automatic, cosine").cosine(250),
    Method::adam(0.13, 0.9).named("Adam, cosine").cosine(1000),
];

/// The methods compared under noise.
const NOISY: [Method; 5] = [
    Method::adam(0.01, 0.9),
    Method::laplacian(0.01, 0.5, 3.0),
    Method::bilateral(0.01, 0.5, TUNED),
    Method::bilateral(0.01, 0.5, AUTO).named("bilateral, automatic"),
    Method::bilateral(0.05, 0.5, AUTO).named("bilateral, automatic, cosine").cosine(250),
];

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for problem in PROBLEMS {
        let methods = if problem.steps == 1000 { &ANISOTROPIC[..] } else { &NOISY[..] };
        compare(ctx, problem, methods)?;
    }
    ctx.note(format!(
        "Medians over {SEEDS} seeds. `error` is |theta - theta*| / |theta*| after 250 steps, `last` after all (1000 or 300), `worst` the \
         largest of the seeds after 250; `steps` those until the error stays below .03 (none: never). Times are those of \
         whole runs, gradients included."
    ));
    ablations(ctx)
}

/// Error courses of a method over all seeds, and the times of its runs.
fn courses(problem: Problem, method: &Method) -> Result<(Vec<Vec<f64>>, Timing)> {
    let (mut courses, mut seconds) = (Vec::new(), Vec::new());
    for seed in 0..SEEDS {
        let (target, source) = ((problem.target)(seed), (problem.source)(seed));
        let start = Instant::now();
        let steps = if matches!(method.filter, Filter::None | Filter::Laplacian(_)) {
            problem.steps
        } else {
            problem.steps.min(300)
        };
        let errors = method.run(&target, source, steps)?;
        seconds.push(start.elapsed().as_secs_f64() / steps as f64 * problem.steps as f64);
        courses.push(errors);
    }
    Ok((courses, Timing::of(seconds)))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Error, last error, worst error, and steps to .03 if all seeds get there.
fn figures(problem: Problem, courses: &[Vec<f64>]) -> Vec<(&'static str, f64)> {
    let at = |t: usize| courses.iter().map(|c| c[t.min(c.len() - 1)]).collect::<Vec<_>>();
    let worst = at(problem.at).into_iter().fold(0.0, f64::max);
    let mut figures =
        vec![("error", median(at(problem.at))), ("last", median(at(problem.steps))), ("worst", worst)];
    let steps: Vec<usize> = courses.iter().filter_map(|c| steps_below(c, 0.03)).collect();
    if steps.len() == courses.len() {
        figures.push(("steps", median(steps.into_iter().map(|s| s as f64).collect())));
    }
    figures
}

fn compare(ctx: &mut Context, problem: Problem, methods: &[Method]) -> Result<()> {
    let (mut by_step, mut by_time) = (Vec::new(), Vec::new());
    let mut draw = |name: &str, courses: &[Vec<f64>], step_seconds: f64| {
        let length = courses[0].len();
        let steps = (0..60).map(|k| (1.15_f64.powi(k)) as usize).filter(|t| *t < length);
        let mut steps: Vec<usize> = steps.chain([length - 1]).collect();
        steps.dedup();
        let error = |t: usize| median(courses.iter().map(|c| c[t]).collect());
        let points: Vec<(f64, f64)> = steps.iter().map(|t| (*t as f64, error(*t))).collect();
        by_time.push((
            name.to_owned(),
            points.iter().map(|(t, e)| (t * step_seconds * 1e3, *e)).collect::<Vec<_>>(),
        ));
        by_step.push((name.to_owned(), points));
    };
    for method in methods {
        let (courses, timing) = courses(problem, method)?;
        draw(method.name, &courses, timing.median / problem.steps as f64);
        ctx.record(method.name, problem.name, problem.steps, timing, figures(problem, &courses));
    }
    if problem.steps == 300 {
        let (mut courses, mut seconds) = (Vec::new(), Vec::new());
        for seed in 0..SEEDS {
            let start = Instant::now();
            courses.push(floor(&(problem.target)(seed), (problem.source)(seed), problem.steps));
            seconds.push(start.elapsed().as_secs_f64());
        }
        let timing = Timing::of(seconds);
        draw("mean of all gradients", &courses, timing.median / problem.steps as f64);
        ctx.record("mean of all gradients", problem.name, problem.steps, timing, figures(problem, &courses));
    }
    let title = |x: &str| format!("{}: error against {x}", problem.name);
    let ending = |x: &str| format!("{}-{x}", problem.ending);
    ctx.plot(&ending("steps"), &title("steps"), [Axis("steps"), Axis("relative error")], &by_step)?;
    ctx.plot(&ending("time"), &title("time"), [Axis("milliseconds"), Axis("relative error")], &by_time)
}

/// Where the filter acts, and what it is made of, on the problems in one dimension.
fn ablations(ctx: &mut Context) -> Result<()> {
    let base = Method::bilateral(0.01, 0.5, TUNED);
    let with = |name, change: &dyn Fn(&mut Bilateral)| {
        let mut method = base.named(name);
        if let Filter::Bilateral(config) = &mut method.filter {
            change(config);
        }
        method
    };
    let only_second = Placement { first: false, ..Placement::POST };
    let methods = [
        base.named("ablation: postfilter"),
        base.named("ablation: prefilter").placed(Placement::PRE),
        base.named("ablation: both").placed(Placement::BOTH),
        with("ablation: coarse to fine", &|c| c.coarse_to_fine = true),
        with("ablation: 3 taps", &|c| c.taps = Taps::Three),
        with("ablation: no range weights", &|c| c.sigma = Sigma::Unlimited),
        with("ablation: sigma x 4", &|c| c.sigma = Sigma::Fixed(0.08)),
        with("ablation: sigma / 4", &|c| c.sigma = Sigma::Fixed(0.005)),
        with("ablation: guided by g", &|c| {
            c.source = photofit_optim::Source::Gradients;
            c.sigma = AUTO;
        }),
        Method { beta1: 0.0, ..base.named("ablation: memoryless") },
        base.named("ablation: m only").placed(Placement::FIRST),
        base.named("ablation: v only").placed(only_second),
    ];
    for problem in &PROBLEMS[..2] {
        let problem = Problem { steps: 300, ..*problem };
        for method in &methods {
            let (courses, timing) = courses(problem, method)?;
            ctx.record(method.name, problem.name, problem.steps, timing, figures(problem, &courses));
        }
    }
    Ok(())
}
