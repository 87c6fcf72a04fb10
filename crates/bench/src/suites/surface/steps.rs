//! The steps of surfaces from points, one by one, on a sphere before a wall whose depth is known, beside the figures
//! of a double precision prototype on a scene of the same kind.

use anyhow::Result;
use photofit_denoise::Shape;
use photofit_denoise::admm::{Admm, DataTerm, Penalties, Problem};
use photofit_denoise::surface::synthetic::{SIDE, Scene, ln_depth};
use photofit_denoise::surface::{
    BlendOptions, Pinhole, PullPushOptions, Samples, SplatRadius, blend, blend_weight, fill_channels,
    normal_target, prune, pull_push, splat_depth,
};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3, vec3};

use super::scene::{Outlined, Part};
use crate::context::Context;

/// Pixels of the scene.
const PIXELS: usize = SIDE * SIDE;
/// Share of the pixels on which a sample of the sphere falls, and of the wall where the sphere does not hide it.
const SHARES: (f32, f32) = (0.12, 0.10);
/// A denser wall: of the samples within the outline of the sphere 58% are hidden ones, not 42%.
const DENSE: (f32, f32) = (0.12, 0.19);
/// Least cosine of normal and ray at which slopes are compared: towards the outline they grow without bound.
const FLAT: f32 = 0.3;
/// Seeds over which figures are averaged.
const SEEDS: std::ops::Range<u64> = 1..6;
/// Weight of curvature and of the normals, and the change of relative depth that a step shrinks away.
#[derive(Clone, Copy)]
struct Strength {
    weight: f32,
    threshold: f32,
}

/// Large enough to close holes in 100 steps.
const GENTLE: Strength = Strength { weight: 0.01, threshold: 0.02 };
/// What smooths in 10 steps: of the weights .0005 to .2 these come closest to the prototype's figures.
const FIRM: Strength = Strength { weight: 0.1, threshold: 0.5 };
/// Largest difference of ln z within a surface.
const TOLERANCE: f32 = 0.05;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let outlined = Outlined::new();
    targets(ctx, &outlined.scene);
    plane(ctx)?;
    hidden(ctx, &outlined)?;
    pruning(ctx, &outlined.scene);
    levels(ctx, &outlined);
    fast(ctx, &outlined)?;
    ctx.note(
        "128 x 128 pixels; a sphere that covers 45% of the picture, samples on 12% of its pixels and on 10% of those \
         of the wall, which shows through where the sphere has none. Means over 5 draws of the samples. Front, back, \
         edge: relative rms errors of depth on the sphere, on the wall, and within 3 pixels of the outline. The columns of the prototype \
         are its figures on its own scene of this kind.",
    );
    Ok(())
}

/// Independent numbers in `[0, 1)`.
fn uniform(seed: u64) -> impl FnMut() -> f32 {
    let mut rng = Rng::new(seed, 0);
    move || rng.next_f32()
}

/// The slope that normals ask for, against the true one within each surface.
fn targets(ctx: &mut Context, scene: &Scene) {
    let truth: Vec<f64> = scene.z.iter().map(|z| f64::from(*z).ln()).collect();
    let flat = |i: usize| -scene.normal[i].dot(scene.camera.ray(i)) >= FLAT * scene.camera.ray(i).length();
    let inner = |i: usize, step: usize| {
        let inside = if step == 1 { i % SIDE + 1 < SIDE } else { i / SIDE + 1 < SIDE };
        inside && scene.front[i] == scene.front[i + step] && flat(i) && flat(i + step)
    };
    let pairs: Vec<(usize, usize)> =
        (0..PIXELS).flat_map(|i| [(i, 1), (i, SIDE)]).filter(|(i, step)| inner(*i, *step)).collect();
    let slope = |&(i, step): &(usize, usize)| truth[i + step] - truth[i];
    let error = |of: &dyn Fn(&(usize, usize)) -> f64| {
        let (mut wrong, mut all) = (0.0, 0.0);
        for pair in &pairs {
            wrong += (of(pair) - slope(pair)).powi(2);
            all += slope(pair).powi(2);
        }
        (wrong / all).sqrt()
    };
    ctx.measure(
        "slope of the normals",
        "exact",
        PIXELS,
        || normal_target(&scene.normal, &scene.camera),
        |(gx, gy)| {
            let of = |&(i, step): &(usize, usize)| f64::from(if step == 1 { gx[i] } else { gy[i] });
            vec![("error", error(&of)), ("prototype", 0.06)]
        },
    );
    // The target sigma (n_x, n_y) with the sigma of least squares.
    let part = |&(i, step): &(usize, usize)| {
        f64::from(if step == 1 { scene.normal[i].x } else { scene.normal[i].y })
    };
    let best = || {
        let (mut both, mut own) = (0.0, 0.0);
        for pair in &pairs {
            both += part(pair) * slope(pair);
            own += part(pair).powi(2);
        }
        both / own
    };
    ctx.measure("slope of the normals", "best sigma", PIXELS, best, |sigma| {
        vec![("error", error(&|pair| sigma * part(pair))), ("prototype", 0.99)]
    });
}

/// A plane from 2% of its pixels, 1000 steps in double precision.
fn plane(ctx: &mut Context) -> Result<()> {
    const SMALL: usize = 32;
    let camera = Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 0.8, SMALL, SMALL);
    let n = vec3(0.35_f64, -0.25, -0.9);
    let ray = |i: usize| {
        let (x, y) = ((i % SMALL) as f64 + 0.5, (i / SMALL) as f64 + 0.5);
        vec3((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0)
    };
    let exact: Vec<f64> = (0..SMALL * SMALL).map(|i| (-2.0 / n.dot(ray(i))).ln()).collect();
    let mut rng = Rng::new(8, 0);
    let lambda: Vec<f64> = exact.iter().map(|_| if rng.next_f64() < 0.02 { 8.0 } else { 0.0 }).collect();
    let (gx, gy) = normal_target(&vec![n; SMALL * SMALL], &camera);
    let unit = n * (1.0 / n.length());
    let mean = |g: &[f64]| g.iter().sum::<f64>() / g.len() as f64;
    let sigma = (mean(&gx) * unit.x + mean(&gy) * unit.y) / (unit.x * unit.x + unit.y * unit.y);
    let wrong = [vec![sigma * unit.x; SMALL * SMALL], vec![sigma * unit.y; SMALL * SMALL]].concat();
    for (case, target, prototype) in [("exact", [gx, gy].concat(), 6e-9), ("best sigma", wrong, 3.5e-2)] {
        let data = DataTerm::L2 { lambda: lambda.clone().into() };
        let problem = Problem::new(Shape::new(SMALL, SMALL, 1), &exact, data)
            .with_hessian(0.05)
            .with_guide(1.0, &target);
        let penalties = Penalties { data: 8.0, gradient: 0.0, hessian: 1.0, guide: 10.0, relaxation: 1.7 };
        let solve = || -> Result<Vec<f64>> {
            let mut admm = Admm::with_penalties(&problem, penalties, None)?;
            (0..1000).for_each(|_| admm.step());
            Ok(admm.solution())
        };
        let error = |u: &Result<Vec<f64>>| {
            let squared =
                |u: &Vec<f64>| u.iter().zip(&exact).map(|(u, e)| ((u - e).exp() - 1.0).powi(2)).sum();
            let sum: f64 = u.as_ref().map_or(f64::NAN, squared);
            vec![("error", (sum / (SMALL * SMALL) as f64).sqrt()), ("prototype", prototype)]
        };
        ctx.measure("plane from 2% of it", case, SMALL * SMALL, solve, error)?;
    }
    Ok(())
}

/// One-sided Huber data of several delta on all samples, hidden ones too, 100 steps from pull-push.
fn hidden(ctx: &mut Context, outlined: &Outlined) -> Result<()> {
    let cases = [
        ("delta infinite", 1e3, SHARES, [1.69, 0.001]),
        ("delta .02", 0.02, SHARES, [0.237, 0.004]),
        ("delta .005", 0.005, SHARES, [0.038, 0.061]),
        ("delta .001", 0.001, SHARES, [0.017, 0.173]),
        // A square takes the mean of ln z: the front error of an infinite delta tells how many samples are hidden.
        ("delta infinite, dense wall", 1e3, DENSE, [1.69, 0.001]),
        ("delta .02, dense wall", 0.02, DENSE, [0.237, 0.004]),
        ("delta .005, dense wall", 0.005, DENSE, [0.038, 0.061]),
        ("delta .001, dense wall", 0.001, DENSE, [0.017, 0.173]),
    ];
    for (case, delta, shares, prototype) in cases {
        let draws: Vec<Samples> =
            SEEDS.map(|seed| outlined.scene.sample(shares.0, shares.1, uniform(seed)).0).collect();
        let work = || -> Result<Vec<Vec<f32>>> {
            draws
                .iter()
                .map(|s| {
                    let (ln_z, valid) = ln_depth(s);
                    let start = pyramid(&ln_z, &valid);
                    let lambda: Vec<f32> = valid.iter().map(|v| f32::from(u8::from(*v))).collect();
                    let data = DataTerm::Huber { lambda: lambda.into(), delta: delta.into() };
                    Guided::new(&outlined.scene, s, &start, GENTLE).solve(&ln_z, data, &start, 100)
                })
                .collect()
        };
        ctx.measure("hidden samples", case, PIXELS, work, |all| {
            all.as_ref().map_or(vec![], |all| both(outlined, all, prototype))
        })?;
    }
    Ok(())
}

/// Hidden samples found by discs of 3 pixels.
fn pruning(ctx: &mut Context, scene: &Scene) {
    let draws: Vec<_> = SEEDS.map(|seed| scene.sample(SHARES.0, SHARES.1, uniform(seed))).collect();
    for (case, radius) in
        [("3 pixels", SplatRadius::Pixels(3.0)), ("1.5 spacings", SplatRadius::Spacing(1.5))]
    {
        let work = || -> Vec<Samples> {
            draws
                .iter()
                .map(|(samples, _)| {
                    let mut kept = samples.clone();
                    prune(&mut kept, &splat_depth(samples, &scene.camera, radius), 0.03);
                    kept
                })
                .collect()
        };
        ctx.measure("pruning", case, PIXELS, work, |kept| {
            let [mut right, mut wrong, mut occluded, mut visible] = [0.0; 4];
            for ((samples, hidden), kept) in draws.iter().zip(kept) {
                for i in (0..PIXELS).filter(|i| samples.is_valid(*i)) {
                    let gone = f64::from(u8::from(!kept.is_valid(i)));
                    if hidden[i] {
                        occluded += 1.0;
                        right += gone;
                    } else {
                        visible += f64::from(u8::from(!scene.front[i]));
                        wrong += gone;
                    }
                }
            }
            let mut figures = vec![
                ("recall", right / occluded),
                ("precision", right / (right + wrong)),
                ("lost", wrong / visible),
            ];
            if case == "3 pixels" {
                figures.extend([
                    ("recall prototype", 0.965),
                    ("precision prototype", 0.917),
                    ("lost prototype", 0.073),
                ]);
            }
            figures
        });
    }
}

/// Pull-push by its level limit, no sample removed before.
fn levels(ctx: &mut Context, outlined: &Outlined) {
    let draws = samples(&outlined.scene);
    let unknown = f64::NAN;
    let cases =
        [(0, [unknown; 2]), (1, [1.51, 0.006]), (2, [0.74, 0.041]), (3, [0.094, 0.18]), (7, [unknown, 0.69])];
    for (level, prototype) in cases {
        let options = PullPushOptions { max_level: level, tolerance: TOLERANCE };
        let work = || -> Vec<Vec<f32>> {
            let one = |s: &Samples| {
                let (u, valid) = ln_depth(s);
                pull_push(&u, &valid, None, SIDE, SIDE, &options)
            };
            draws.iter().map(one).collect()
        };
        let figures = |all: &Vec<Vec<f32>>| both(outlined, all, prototype);
        ctx.measure("pull-push", &format!("level {level}"), PIXELS, work, figures);
    }
}

/// The fast method, 10 and 10 steps, by what it starts from.
fn fast(ctx: &mut Context, outlined: &Outlined) -> Result<()> {
    let draws: Vec<Samples> = samples(&outlined.scene)
        .into_iter()
        .map(|mut s| {
            let splats = splat_depth(&s, &outlined.scene.camera, SplatRadius::Pixels(3.0));
            prune(&mut s, &splats, 0.03);
            s
        })
        .collect();
    type Begin = fn(&[f32], &[bool]) -> Vec<f32>;
    let unknown = [f64::NAN; 2];
    let cases: [(&str, Begin, [f64; 2]); 5] = [
        // Zero is a depth of one unit: these figures depend on the unit, the others do not.
        ("from zero", |_, valid| vec![0.0; valid.len()], [0.505, 0.392]),
        ("from zero, unit of 2", |_, valid| vec![2.0_f32.ln(); valid.len()], [0.505, 0.392]),
        ("from the mean", average, unknown),
        ("from the nearest", nearest, [0.184, 0.162]),
        ("from pull-push", pyramid, [0.150, 0.083]),
    ];
    for (case, begin, prototype) in cases {
        let one = |s: &Samples| {
            let (ln_z, valid) = ln_depth(s);
            let start = begin(&ln_z, &valid);
            let guided = Guided::new(&outlined.scene, s, &start, FIRM);
            let lambda =
                |hole: f32| -> Vec<f32> { valid.iter().map(|v| if *v { 1.0 } else { hole }).collect() };
            let filled = DataTerm::L2 { lambda: lambda(0.05).into() };
            let huber = DataTerm::Huber { lambda: lambda(0.0).into(), delta: 0.005.into() };
            let smooth = guided.solve(&start, filled, &start, 10)?;
            let sharp = guided.solve(&ln_z, huber, &start, 10)?;
            Ok(blend(&sharp, &smooth, &blend_weight(&smooth, SIDE, SIDE, &BlendOptions::default())))
        };
        let work = || -> Result<Vec<Vec<f32>>> { draws.iter().map(one).collect() };
        ctx.measure("fast, 10 + 10 steps", case, PIXELS, work, |all| {
            let Ok(all) = all else { return vec![] };
            let published = [("all prototype", prototype[0]), ("front prototype", prototype[1])];
            let ours = [
                ("all", mean(outlined, all, |_, _| true)),
                ("front", mean(outlined, all, |p, _| p == Part::Front)),
                ("front with outline", mean(outlined, all, |_, front| front)),
            ];
            ours.into_iter().chain(published.into_iter().filter(|(_, v)| v.is_finite())).collect()
        })?;
    }
    Ok(())
}

/// The scene drawn with every seed.
fn samples(scene: &Scene) -> Vec<Samples> {
    SEEDS.map(|seed| scene.sample(SHARES.0, SHARES.1, uniform(seed)).0).collect()
}

/// Pull-push with the level limit of these samples.
fn pyramid(ln_z: &[f32], valid: &[bool]) -> Vec<f32> {
    let options = PullPushOptions { max_level: 3, tolerance: TOLERANCE };
    pull_push(ln_z, valid, None, SIDE, SIDE, &options)
}

/// The mean of ln z everywhere.
fn average(ln_z: &[f32], valid: &[bool]) -> Vec<f32> {
    let known: Vec<f32> = ln_z.iter().zip(valid).filter(|(_, v)| **v).map(|(u, _)| *u).collect();
    vec![known.iter().sum::<f32>() / known.len().max(1) as f32; valid.len()]
}

/// ln z of the nearest sample.
fn nearest(ln_z: &[f32], valid: &[bool]) -> Vec<f32> {
    let place = |i: usize| ((i % SIDE) as i32, (i / SIDE) as i32);
    let known: Vec<usize> = (0..PIXELS).filter(|i| valid[*i]).collect();
    let at = |i: usize| {
        let (x, y) = place(i);
        let distance = |k: &&usize| (place(**k).0 - x).pow(2) + (place(**k).1 - y).pow(2);
        known.iter().min_by_key(distance).map_or(0.0, |k| ln_z[*k])
    };
    (0..PIXELS).map(at).collect()
}

/// Mean relative rms error over the pixels that are `of` it.
fn mean(outlined: &Outlined, all: &[Vec<f32>], of: impl Fn(Part, bool) -> bool) -> f64 {
    all.iter().map(|u| outlined.error(u, &of)).sum::<f64>() / all.len() as f64
}

/// Errors beside those of the prototype; what it does not have is left out.
fn both(outlined: &Outlined, all: &[Vec<f32>], prototype: [f64; 2]) -> Vec<(&'static str, f64)> {
    let ours = [("front", Part::Front), ("back", Part::Back), ("edge", Part::Edge)];
    let published = [("front prototype", prototype[0]), ("back prototype", prototype[1])];
    let whole = [("front with outline", true), ("back with outline", false)];
    ours.map(|(name, part)| (name, mean(outlined, all, |p, _| p == part)))
        .into_iter()
        .chain(whole.map(|(name, side)| (name, mean(outlined, all, |_, front| front == side))))
        .chain(published.into_iter().filter(|(_, v)| v.is_finite()))
        .collect()
}

/// The terms of curvature and of normals.
struct Guided {
    slope: Vec<f32>,
    weight: Vec<f32>,
    strength: Strength,
}

impl Guided {
    /// The slope that the normals of `samples` ask for, which counts 1 at samples, half between them, and not where
    /// `start` jumps.
    fn new(scene: &Scene, samples: &Samples, start: &[f32], strength: Strength) -> Self {
        let valid: Vec<bool> = (0..PIXELS).map(|i| samples.is_valid(i)).collect();
        let values: Vec<[f32; 3]> = samples.normal.iter().map(|n| n.to_array()).collect();
        let normals: Vec<Vec3<f32>> =
            fill_channels(&values, &valid, SIDE, SIDE).into_iter().map(Vec3::from_array).collect();
        let (gx, gy) = normal_target(&normals, &scene.camera);
        let jump = |i: usize, j: usize, g: f32| (start[j] - start[i] - g).abs() > 0.5 * TOLERANCE;
        let trust = |i: usize| {
            let across = i % SIDE + 1 < SIDE && jump(i, i + 1, gx[i]);
            let down = i / SIDE + 1 < SIDE && jump(i, i + SIDE, gy[i]);
            match (across || down, valid[i]) {
                (true, _) => 0.0,
                (false, true) => strength.weight,
                (false, false) => 0.5 * strength.weight,
            }
        };
        let weight = (0..PIXELS).map(trust).collect();
        Self { weight, slope: [gx, gy].concat(), strength }
    }

    fn solve(&self, target: &[f32], data: DataTerm<f32>, start: &[f32], steps: usize) -> Result<Vec<f32>> {
        let problem = Problem::new(Shape::new(SIDE, SIDE, 1), target, data)
            .with_hessian(self.strength.weight)
            .with_guide(self.weight.clone(), &self.slope);
        let split = f64::from(self.strength.weight / self.strength.threshold);
        let penalties = Penalties { data: 1.0, gradient: 0.0, hessian: split, guide: split, relaxation: 1.7 };
        let mut admm = Admm::with_penalties(&problem, penalties, Some(start))?;
        (0..steps).for_each(|_| admm.step());
        Ok(admm.solution())
    }
}
