//! Variational denoising: energy gap against time for each model, time and memory against size, what skips save.

use anyhow::Result;
use photofit_denoise::Shape;
use photofit_denoise::admm::{Admm, Coupling, Problem, Stop, Weight};
use photofit_denoise::models;
use photofit_denoise::primal_dual::{Beltrami, ChambollePock, Tgv2, beltrami_energy, rof_gap, tgv2_energy};

use crate::context::Context;

/// Side of the image for the curves of error against time.
const SIDE: usize = 256;
/// Iterations of the optimum against which gaps are taken.
const LONG: usize = 4000;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    convergence(ctx)?;
    primal_dual(ctx)?;
    sizes(ctx)?;
    skips(ctx)?;
    match std::env::var_os("PHOTOFIT_PYTHON").filter(|_| ctx.baseline()) {
        Some(python) => super::denoise_peer::run(ctx, &python)?,
        None if ctx.baseline() => {
            ctx.note("No comparison with scikit-image: `PHOTOFIT_PYTHON` names no Python interpreter.");
        }
        None => {}
    }
    ctx.note(
        "Gaps are relative energies above the optimum (found by a long run in double precision), on a noisy image of \
         256 x 256; for ROF beside them the certified primal-dual gap. Sizes are samples (pixels times channels). \
         Single precision, all threads.",
    );
    Ok(())
}

/// Discs and stripes on a shaded ground with noise of standard deviation .1; one plane per channel.
pub(super) fn picture(width: usize, height: usize, channels: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(height * width * channels);
    for c in 0..channels {
        for i in 0..height {
            for j in 0..width {
                let (x, y) = (j as f64, i as f64);
                let disc = if (x % 96.0 - 40.0).hypot(y % 80.0 - 36.0) < 24.0 { 0.35 } else { 0.0 };
                let stripe = if ((x + 2.0 * y) / 70.0) as usize % 3 == c { 0.15 } else { 0.0 };
                let k = out.len() as u64;
                let hash = (k ^ (k >> 7)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                let noise = ((hash ^ (hash >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f64;
                let noise = noise / f64::from(1 << 24) - 0.5;
                out.push(0.2 + disc + stripe + 0.2 * x / width as f64 + 0.346 * noise);
            }
        }
    }
    out
}

pub(super) fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|v| *v as f32).collect()
}

fn double(values: &[f32]) -> Vec<f64> {
    values.iter().map(|v| f64::from(*v)).collect()
}

/// A model as a problem in double precision and in single precision.
struct Model<'a> {
    name: &'static str,
    exact: Problem<'a, f64>,
    fast: Problem<'a, f32>,
    certified: bool,
}

fn convergence(ctx: &mut Context) -> Result<()> {
    let gray = Shape::new(SIDE, SIDE, 1);
    let rgb = Shape::new(SIDE, SIDE, 3);
    let (g, c) = (picture(SIDE, SIDE, 1), picture(SIDE, SIDE, 3));
    let (gf, cf) = (single(&g), single(&c));
    let holes: Vec<f64> = (0..g.len()).map(|k| if k * 7919 % 10 < 4 { 0.0 } else { 8.0 }).collect();
    let models = [
        Model {
            name: "ROF",
            exact: models::rof(gray, &g, 8.0),
            fast: models::rof(gray, &gf, 8.0),
            certified: true,
        },
        Model {
            name: "TV-L1",
            exact: models::tv_l1(gray, &g, 1.2),
            fast: models::tv_l1(gray, &gf, 1.2),
            certified: false,
        },
        Model {
            name: "HTV-L2, holes",
            exact: models::htv_l2(gray, &g, holes.clone(), 0.5, 1.0),
            fast: models::htv_l2(gray, &gf, single(&holes), 0.5, 1.0),
            certified: false,
        },
        Model {
            name: "hybrid RGB",
            exact: models::hybrid(rgb, &c, 0.1, 0.5, 0.08),
            fast: models::hybrid(rgb, &cf, 0.1, 0.5, 0.08),
            certified: false,
        },
    ];
    for model in models {
        let mut exact = Admm::new(&model.exact)?;
        exact.solve(Stop::Iterations(LONG));
        let optimum = model.exact.energy(&exact.solution());
        for iterations in [5, 10, 20, 50, 100, 200] {
            let solve = || {
                let mut admm = Admm::new(&model.fast).expect("a good problem");
                admm.solve(Stop::Iterations(iterations));
                admm
            };
            let figures = |admm: &Admm<f32>| {
                let u = admm.solution();
                let mut figures = vec![("gap", (model.exact.energy(&double(&u)) / optimum - 1.0).max(1e-9))];
                if let (true, Some(y)) = (model.certified, admm.gradient_dual()) {
                    figures.push(("certified", rof_gap(&model.fast, &u, &y).relative()));
                }
                figures
            };
            let size = model.fast.shape.len();
            ctx.measure(model.name, &format!("{iterations} iterations"), size, solve, figures);
        }
    }
    Ok(())
}

fn primal_dual(ctx: &mut Context) -> Result<()> {
    let shape = Shape::new(SIDE, SIDE, 1);
    let exact = picture(SIDE, SIDE, 1);
    let target = single(&exact);
    let beltrami = |values: &[f64], iterations| -> Result<Vec<f64>> {
        let mut solver = Beltrami::new(shape, values, 40.0, 5.0)?;
        solver.iterate(iterations);
        Ok(solver.solution())
    };
    let lambda = Weight::Uniform(40.0);
    let optimum = beltrami_energy(shape, &beltrami(&exact, 1000)?, &exact, &lambda, 5.0);
    for iterations in [5, 10, 20, 40] {
        let solve = || {
            let mut solver = Beltrami::new(shape, &target, 40.0, 5.0).expect("a good problem");
            solver.iterate(iterations);
            solver.solution()
        };
        let gap = |u: &Vec<f32>| beltrami_energy(shape, &double(u), &exact, &lambda, 5.0) / optimum - 1.0;
        let case = format!("{iterations} iterations");
        ctx.measure("Beltrami", &case, shape.len(), solve, |u| vec![("gap", gap(u).max(1e-9))]);
    }
    let weights = [1.0, 2.0];
    let lambda = Weight::Uniform(8.0);
    let energy =
        |u: &[f64], w: &[f64]| tgv2_energy((shape, &exact, &lambda), weights, Coupling::Separate, u, w);
    let mut long = Tgv2::new(shape, &exact, 8.0, weights, Coupling::Separate)?;
    long.iterate(LONG);
    let optimum = energy(&long.solution(), &long.slope());
    for iterations in [50, 100, 200, 500] {
        let solve = || {
            let mut solver =
                Tgv2::new(shape, &target, 8.0, weights, Coupling::Separate).expect("a good problem");
            solver.iterate(iterations);
            solver
        };
        let gap = |s: &Tgv2<f32>| energy(&double(&s.solution()), &double(&s.slope())) / optimum - 1.0;
        let case = format!("{iterations} iterations");
        ctx.measure("TGV2", &case, shape.len(), solve, |s| vec![("gap", gap(s).max(1e-9))]);
    }
    if ctx.baseline() {
        let (problem, fine) = (models::rof(shape, &target, 8.0), models::rof(shape, &exact, 8.0));
        let mut admm = Admm::new(&fine)?;
        admm.solve(Stop::Iterations(LONG));
        let optimum = fine.energy(&admm.solution());
        for iterations in [10, 20, 50, 100, 200, 500] {
            let solve = || {
                let mut solver = ChambollePock::new(&problem).expect("a good problem");
                for _ in 0..iterations {
                    solver.step();
                }
                solver
            };
            let figures = |s: &ChambollePock<'_, f32>| {
                let gap = fine.energy(&double(&s.solution())) / optimum - 1.0;
                vec![("gap", gap.max(1e-9)), ("certified", s.gap().relative())]
            };
            let case = format!("{iterations} iterations");
            ctx.measure("ROF, Chambolle-Pock", &case, shape.len(), solve, figures);
        }
    }
    Ok(())
}

/// Twenty iterations of the RGB hybrid.
fn sizes(ctx: &mut Context) -> Result<()> {
    for (height, width) in [(180, 320), (360, 640), (719, 1283), (720, 1280), (1080, 1920)] {
        let shape = Shape::new(width, height, 3);
        let target = single(&picture(width, height, 3));
        let problem = models::hybrid(shape, &target, 0.1, 0.5, 0.08);
        let bytes = Admm::new(&problem)?.plan().bytes as f64 / shape.len() as f64;
        let case = format!("{width} x {height}");
        let solve = || solved(&problem, 20);
        ctx.measure("hybrid RGB, 20 iterations", &case, shape.len(), solve, |_| {
            vec![("bytes/sample", bytes)]
        });
    }
    Ok(())
}

/// The same with less to do.
fn skips(ctx: &mut Context) -> Result<()> {
    let shape = Shape::new(1280, 720, 3);
    let plane = single(&picture(1280, 720, 1));
    let gray = plane.repeat(3);
    let problem = models::hybrid(shape, &gray, 0.1, 0.5, 0.08);
    ctx.measure("equal channels merged", "1280 x 720", shape.len(), || solved(&problem, 20), |_| Vec::new());
    let mut two = single(&picture(1280, 720, 3));
    two[..shape.pixels()].fill(0.5);
    let problem = models::hybrid(shape, &two, 0.1, 0.5, 0.08);
    ctx.measure("one constant channel", "1280 x 720", shape.len(), || solved(&problem, 20), |_| Vec::new());
    let all = single(&picture(1280, 720, 3));
    let hessian = models::hybrid(shape, &all, 0.1, 0.5, 0.08).with_hessian(0.05);
    ctx.measure("with the Hessian", "1280 x 720", shape.len(), || solved(&hessian, 20), |_| Vec::new());
    // One smooth channel beside two noisy ones: with a tolerance it rests as soon as it has converged.
    let mut mixed = all.clone();
    for (k, v) in mixed[..shape.pixels()].iter_mut().enumerate() {
        *v = 0.3 + 2e-4 * (k % 1280) as f32;
    }
    let separate = models::rof(shape, &mixed, 8.0);
    let stop = Stop::Tolerance { tolerance: 1e-3, limit: 200 };
    let rest = || Admm::new(&separate).map(|mut admm| admm.solve(stop).iterations);
    ctx.measure("converged channel rests", "1280 x 720", shape.len(), rest, |n| match n {
        Ok(n) => vec![("iterations", *n as f64)],
        Err(_) => Vec::new(),
    })?;
    let coupled = separate.clone().vectorial();
    let works = || Admm::new(&coupled).map(|mut admm| admm.solve(stop).iterations);
    ctx.measure("coupled: none rests", "1280 x 720", shape.len(), works, |n| match n {
        Ok(n) => vec![("iterations", *n as f64)],
        Err(_) => Vec::new(),
    })?;
    Ok(())
}

fn solved(problem: &Problem<'_, f32>, iterations: usize) -> Vec<f32> {
    let mut admm = Admm::new(problem).expect("a good problem");
    admm.solve(Stop::Iterations(iterations));
    admm.solution()
}
