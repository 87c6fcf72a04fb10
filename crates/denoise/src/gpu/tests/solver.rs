//! The linear step and the splitting.

use super::{bits, distance, largest, random, tolerances};
use crate::admm::{
    Admm, ChannelPlan, Coupling, DataTerm, DeviceAdmm, LinearStep, Problem, Stop, Weight, solve_on,
};
use crate::transform::{DeviceStrip, StripSolver, Symbol};
use crate::{DenoiseError, Shape};
use photofit_gpu::{Gpu, assert_twin, test_device};

#[test]
#[ignore = "gpu: needs an adapter"]
fn linear_steps_agree() {
    let gpu = test_device();
    let sizes = [
        [2, 1],
        [2, 2],
        [4, 16],
        [6, 17],
        [30, 15],
        [50, 31],
        [128, 32],
        [90, 33],
        [1024, 5],
        [1280, 40],
        [2048, 3],
    ];
    for (seed, [width, height]) in sizes.into_iter().enumerate() {
        for (c0, c1) in [(1.0, 0.0), (2.0, 1.0), (0.05, 3.0), (1e-3, 1.0)] {
            let symbol = Symbol { c0, c1, c2: 0.0 };
            let sides = random(seed as u64, 2 * width * height, 1.0);
            let error = strip_error(gpu, [width, height], [symbol; 2], [sides.clone(), sides]);
            assert_twin("STRIP", format!("{width} x {height}, {c0}, {c1}"), error, tolerances::STRIP);
        }
    }
}

/// How far solutions of the CPU and of a device differ, each of a system and right-hand sides of its own.
fn strip_error(
    gpu: &Gpu,
    [width, height]: [usize; 2],
    [cpu, device]: [Symbol; 2],
    sides: [Vec<f32>; 2],
) -> f64 {
    let n = width * height;
    let [mut both, sides] = sides;
    let packed: Vec<[f32; 2]> = (0..n).map(|i| [sides[i], sides[n + i]]).collect();
    let picture = gpu.upload("picture", &packed).expect("room");
    let strip = DeviceStrip::new(gpu, None, [width, height], 1, device).expect("a solver");
    let mut r = gpu.record("strip");
    strip.solve(&mut r, &picture).expect("kernels");
    r.finish().expect("a recording").run().expect("a run");
    let theirs = gpu.read(&picture).expect("values").concat();
    let solver = StripSolver::new(width, height, cpu);
    both.chunks_mut(n).for_each(|plane| solver.solve(plane));
    let ours: Vec<f32> = (0..n).flat_map(|i| [both[i], both[n + i]]).collect();
    distance(&ours, &theirs) / (largest(&ours) * (cpu.c0 + 8.0 * cpu.c1) / cpu.c0)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn another_system_is_noticed() {
    let gpu = test_device();
    let size = [90, 33];
    let (symbol, sides) = (Symbol { c0: 2.0, c1: 1.0, c2: 0.0 }, random(1, 2 * 90 * 33, 1.0));
    let error =
        |device: Symbol, theirs: Vec<f32>| strip_error(gpu, size, [symbol, device], [sides.clone(), theirs]);
    let mut entry = sides.clone();
    entry[1234] += 1e-4;
    let mut moved = sides.clone();
    moved.swap(40 * 33 + 2, 40 * 33 + 3);
    assert!(error(symbol, sides.clone()) <= tolerances::STRIP, "the same");
    for (what, error) in [
        ("c0", error(Symbol { c0: 2.0001, ..symbol }, sides.clone())),
        ("c1", error(Symbol { c1: 1.0001, ..symbol }, sides.clone())),
        ("an entry of a right-hand side", error(symbol, entry)),
        ("its place", error(symbol, moved)),
    ] {
        assert!(error > tolerances::STRIP, "{what} is noticed: {error:.1e}");
    }
}

/// A picture with an edge, ramps and noise.
fn picture(shape: Shape, seed: u64, size: f32) -> Vec<f32> {
    let noise = random(seed, shape.len(), 0.2);
    let of = |(i, noise): (usize, &f32)| {
        let (y, x, c) = shape.position(i);
        let disc = if x * 3 > y + 7 { 0.7 } else { 0.1 };
        size * (disc + 0.02 * c as f32 + 0.3 * x as f32 / shape.width as f32 + noise)
    };
    noise.iter().enumerate().map(of).collect()
}

fn maps(shape: Shape, seed: u64, planes: usize, holes: bool) -> Weight<f32> {
    let n = shape.pixels() * planes;
    let zero = |v: &f32| if holes && *v < -0.5 { 0.0 } else { 1.0 + 0.5 * v };
    random(seed, n, 1.0).iter().map(zero).collect::<Vec<f32>>().into()
}

/// The problems of the twin: data terms, weights, couplings, holes, sizes.
fn check(each: impl Fn(&str, Problem<'_, f32>, usize)) {
    for (k, (width, height, channels)) in
        [(1, 1, 1), (1, 9, 3), (17, 1, 3), (31, 33, 3), (64, 48, 2), (97, 50, 1), (40, 64, 5)]
            .into_iter()
            .enumerate()
    {
        let (shape, seed) = (Shape::new(width, height, channels), 10 * k as u64);
        let target = picture(shape, seed, 1.0);
        let name = |what: &str| format!("{what}, {shape}");
        let with = |data: DataTerm<f32>| Problem::new(shape, &target, data);
        each(&name("rof"), with(DataTerm::L2 { lambda: 4.0.into() }).with_gradient(0.5), 30);
        let hybrid = DataTerm::Hybrid { l1: 0.1.into(), l2: 0.5.into() };
        each(&name("hybrid"), with(hybrid).with_gradient(maps(shape, seed + 1, 1, false)).vectorial(), 20);
        let (l1, l2) = (maps(shape, seed + 2, 1, true), maps(shape, seed + 2, 1, true));
        let holes = DataTerm::Hybrid { l1, l2 };
        each(&name("hybrid, holes"), with(holes).with_gradient(0.3).vectorial(), 20);
        let absolute = DataTerm::L1 { lambda: maps(shape, seed + 3, channels, true) };
        let alpha = maps(shape, seed + 4, channels, false);
        each(&name("tv-l1, maps of all channels"), with(absolute).with_gradient(alpha), 20);
        let huber = DataTerm::Huber { lambda: maps(shape, seed + 5, 1, true), delta: 0.1.into() };
        each(&name("huber"), with(huber).with_gradient(0.3), 20);
    }
}

fn on_cpu(problem: &Problem<'_, f32>, iterations: usize) -> Vec<f32> {
    let mut admm = Admm::owning(problem.clone(), LinearStep::Exact).expect("a good problem");
    admm.solve(Stop::Iterations(iterations));
    admm.solution()
}

/// The largest difference over the contrast of the target, or over its largest value: a single pixel has no contrast.
fn error(problem: &Problem<'_, f32>, ours: &[f32], theirs: &[f32]) -> f64 {
    let [low, high] = problem.target.iter().fold([f32::MAX, f32::MIN], |[l, h], v| [l.min(*v), h.max(*v)]);
    distance(ours, theirs) / f64::from((high - low).max(high.abs()).max(low.abs())).max(1e-6)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn splittings_agree() {
    let gpu = test_device();
    check(|what, problem, iterations| {
        let ours = on_cpu(&problem, iterations);
        let theirs = solve_on(gpu, &problem, iterations).expect("a device");
        assert_twin("SPLITTING", what, error(&problem, &ours, &theirs), tolerances::SPLITTING);
        assert_eq!(bits(&theirs), bits(&solve_on(gpu, &problem, iterations).expect("a device")), "{what}");
        // Before the first step, too.
        let (ours, theirs) = (on_cpu(&problem, 0), solve_on(gpu, &problem, 0).expect("a device"));
        assert_twin("SPLITTING", what, error(&problem, &ours, &theirs), tolerances::SPLITTING);
    });
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn equal_and_constant_channels_agree() {
    let gpu = test_device();
    for (width, height) in [(31, 33), (40, 17)] {
        let (shape, n) = (Shape::new(width, height, 3), width * height);
        let grey = picture(Shape::new(width, height, 1), 7, 1.0).repeat(3);
        let mut constant = grey.clone();
        constant[n..2 * n].fill(0.4);
        let hybrid = || DataTerm::Hybrid { l1: maps(shape, 2, 1, true), l2: maps(shape, 2, 1, true) };
        let absolute = || DataTerm::L1 { lambda: 2.0.into() };
        let of = |target, data| Problem::new(shape, target, data).with_gradient(maps(shape, 3, 1, false));
        use ChannelPlan::{Constant, SameAs, Solved};
        for (what, problem, plan) in [
            ("coupled", of(&grey, hybrid()).vectorial(), [Solved, SameAs(0), SameAs(0)]),
            ("separate", of(&grey, hybrid()), [Solved, SameAs(0), SameAs(0)]),
            ("coupled, one constant", of(&constant, absolute()).vectorial(), [Solved, Constant, SameAs(0)]),
            ("separate, one constant", of(&constant, absolute()), [Solved, Constant, SameAs(0)]),
        ] {
            assert_eq!(Admm::new(&problem).expect("a good problem").plan().channels, plan, "{what}");
            let (ours, theirs) = (on_cpu(&problem, 20), solve_on(gpu, &problem, 20).expect("a device"));
            assert_twin("SPLITTING", what, error(&problem, &ours, &theirs), tolerances::SPLITTING);
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_solver_takes_another_problem_as_a_new_one() {
    let gpu = test_device();
    let (shape, other) = (Shape::new(31, 33, 3), Shape::new(40, 17, 2));
    let targets = [picture(shape, 1, 1.0), picture(shape, 2, 3.0), picture(other, 3, 1.0)];
    let quadratic = |shape, target, alpha: f32| {
        Problem::new(shape, target, DataTerm::L2 { lambda: 4.0.into() }).with_gradient(alpha)
    };
    let holes = DataTerm::Hybrid { l1: maps(shape, 2, 1, true), l2: maps(shape, 2, 1, true) };
    let problems = [
        quadratic(shape, &targets[0], 0.5).vectorial(),
        quadratic(shape, &targets[0], 1.5).vectorial(),
        Problem::new(shape, &targets[1], holes).with_gradient(maps(shape, 3, 1, false)),
        quadratic(other, &targets[2], 0.5),
        quadratic(shape, &targets[1], 0.5),
    ];
    let mut former: Option<DeviceAdmm> = None;
    for (k, problem) in problems.iter().enumerate() {
        let admm = match former.take() {
            Some(former) => former.again(gpu, problem),
            None => DeviceAdmm::new(gpu, problem),
        };
        let admm = admm.expect("room");
        let planes = gpu.zeros("solution", problem.shape.len()).expect("room");
        let mut r = gpu.record("admm");
        admm.record(&mut r, 20).expect("kernels");
        admm.unpack(&mut r, &planes).expect("kernels");
        r.finish().expect("a recording").run().expect("a run");
        let fresh = solve_on(gpu, problem, 20).expect("a device");
        assert_eq!(bits(&gpu.read(&planes).expect("values")), bits(&fresh), "problem {k}");
        former = Some(admm);
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn another_problem_is_noticed() {
    let gpu = test_device();
    let shape = Shape::new(31, 33, 3);
    let target = picture(shape, 30, 1.0);
    let problem = |alpha: f32, l1: f32| {
        let data = DataTerm::Hybrid { l1: l1.into(), l2: 0.5.into() };
        Problem::new(shape, &target, data).with_gradient(alpha).vectorial()
    };
    let ours = on_cpu(&problem(0.5, 0.1), 20);
    let theirs = |problem: Problem<'_, f32>, steps| solve_on(gpu, &problem, steps).expect("a device");
    let same = problem(0.5, 0.1);
    assert!(error(&same, &ours, &theirs(same.clone(), 20)) <= tolerances::SPLITTING, "the same");
    let others = [
        ("a weight", theirs(problem(0.502, 0.1), 20)),
        ("a data term", theirs(problem(0.5, 0.101), 20)),
        ("a step", theirs(problem(0.5, 0.1), 19)),
        ("a coupling", theirs(Problem { coupling: Coupling::Separate, ..problem(0.5, 0.1) }, 20)),
    ];
    for (what, other) in others {
        assert!(error(&same, &ours, &other) > tolerances::SPLITTING, "{what} is noticed");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn what_the_cpu_refuses_or_no_kernel_solves_is_refused() {
    let gpu = test_device();
    let shape = Shape::new(8, 6, 1);
    for bad in [f32::NAN, f32::INFINITY] {
        let mut target = picture(shape, 1, 1.0);
        target[13] = bad;
        let problem = Problem::new(shape, &target, DataTerm::L2 { lambda: 2.0.into() }).with_gradient(1.0);
        let refused = Admm::new(&problem).expect_err("not finite");
        // Not a number equals nothing: the messages are compared.
        let theirs = solve_on(gpu, &problem, 3).expect_err("not finite");
        assert_eq!(refused.to_string(), theirs.to_string());
    }
    let target = picture(shape, 1, 1.0);
    let problem = Problem::new(shape, &target, DataTerm::L2 { lambda: 2.0.into() }).with_hessian(1.0);
    assert!(matches!(solve_on(gpu, &problem, 3), Err(DenoiseError::NotOnDevice { .. })), "a Hessian");
    let shape = Shape::new(4000, 1, 1);
    let target = picture(shape, 1, 1.0);
    let problem = Problem::new(shape, &target, DataTerm::L2 { lambda: 2.0.into() }).with_gradient(1.0);
    assert!(matches!(solve_on(gpu, &problem, 3), Err(DenoiseError::NotOnDevice { .. })), "long rows");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn huge_and_tiny_values_agree() {
    let gpu = test_device();
    let shape = Shape::new(37, 29, 3);
    for size in [1e-12, 1e-6, 1e6, 1e12] {
        let target = picture(shape, 5, size);
        let data = DataTerm::L2 { lambda: 4.0.into() };
        let problem = Problem::new(shape, &target, data).with_gradient(0.5 * size).vectorial();
        let (ours, theirs) = (on_cpu(&problem, 20), solve_on(gpu, &problem, 20).expect("a device"));
        let contrast = f64::from(size);
        assert_twin("SPLITTING", size, distance(&ours, &theirs) / contrast, tolerances::SPLITTING);
    }
}
