//! Large Steps: the solve, and whole steps.

use super::tolerances::{EDGE_AWARE, LARGE_STEPS, SOLVE};
use super::{distance, largest, random};
use crate::gpu::{DeviceOptimizer, LargeStepsSolver};
use crate::{EdgeAware, LargeSteps, OptimError, Optimizer, Placement, Temporal};
use photofit_gpu::{Gpu, assert_twin, test_device};

/// A grid of triangles, a vertex joined to a hundred of them, and one without neighbours.
fn edges() -> (usize, Vec<[u32; 2]>) {
    let (w, h) = (37_u32, 29_u32);
    let mut edges = Vec::new();
    for y in 0..h {
        for x in 0..w {
            let i = y * w + x;
            let ends = [(x + 1 < w, i + 1), (y + 1 < h, i + w), (x + 1 < w && y + 1 < h, i + w + 1)];
            edges.extend(ends.iter().filter(|e| e.0).map(|e| [i, e.1]));
        }
    }
    let pole = w * h;
    edges.extend((0..100).map(|k| [3 * k, pole]));
    (pole as usize + 2, edges)
}

fn rings(vertices: usize, edges: &[[u32; 2]]) -> (Vec<u32>, Vec<u32>) {
    let mut pairs: Vec<[u32; 2]> = edges.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
    pairs.sort_unstable();
    let mut offsets = vec![0; vertices + 1];
    pairs.iter().for_each(|[a, _]| offsets[*a as usize + 1] += 1);
    (0..vertices).for_each(|i| offsets[i + 1] += offsets[i]);
    (offsets, pairs.into_iter().map(|[_, b]| b).collect())
}

fn solver(gpu: &Gpu, lambda: f64) -> LargeStepsSolver {
    let (vertices, edges) = edges();
    let (offsets, neighbours) = rings(vertices, &edges);
    LargeStepsSolver::new(gpu, &offsets, &neighbours, lambda).unwrap()
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn solves_agree_with_the_factor() {
    let gpu = test_device();
    let (vertices, edges) = edges();
    for lambda in [0.0, 0.3, 19.0, 1000.0] {
        let (direct, solver) = (LargeSteps::new(vertices, &edges, lambda).unwrap(), solver(gpu, lambda));
        let b = random(5, 3 * vertices, 1.0);
        let expected = direct.to_x(&b).unwrap();
        let (right, x) = (gpu.upload("b", &b).unwrap(), gpu.upload("x", &b).unwrap());
        let mut r = gpu.record("solve");
        solver.solve(&mut r, &right.bind(), &x).unwrap();
        let mut recording = r.finish().unwrap();
        recording.run().unwrap();
        let ours = gpu.read(&x).unwrap();
        let worst = distance(&expected, &ours) / largest(&expected);
        println!(
            "lambda {lambda}: condition {:.1}, {} iterations, error {worst:.1e}",
            solver.condition(),
            solver.iterations()
        );
        // Rounding grows with the condition number.
        let bound = SOLVE * (1.0 + solver.condition().sqrt() / 50.0);
        assert_twin("SOLVE", lambda, worst, bound);
        recording.run().unwrap();
        assert!(gpu.read(&x).unwrap() == ours, "the same bits again");
        if lambda > 0.0 {
            let other = LargeSteps::new(vertices, &edges, 2.0 * lambda).unwrap().to_x(&b).unwrap();
            assert!(distance(&other, &ours) / largest(&expected) > bound, "another weight is noticed");
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn fifty_steps_agree() {
    let gpu = test_device();
    let (vertices, edges) = edges();
    let temporal = Temporal::uniform_adam().betas(0.9, 0.99);
    for (lambda, size) in [(0.3, 1e-4), (19.0, 1e-12), (0.3, 1e12)] {
        let start = random(7, 3 * vertices, 1.0);
        let mut x = start.clone();
        let filter = LargeSteps::new(vertices, &edges, lambda).unwrap();
        let mut cpu = Optimizer::new("positions", x.len(), temporal)
            .and_then(|o| o.with_filter(Placement::VARIABLE, filter))
            .unwrap();
        let solver = Some(solver(gpu, lambda));
        let mut device = DeviceOptimizer::new(gpu, "positions", (vertices, 3), temporal, solver).unwrap();
        let (on_device, g) = (gpu.upload("x", &x).unwrap(), gpu.zeros("g", x.len()).unwrap());
        let mut r = gpu.record("large steps");
        let recorded = device.record(&mut r, &on_device, &g, 0).unwrap();
        let mut recording = r.finish().unwrap();
        for step in 0..50 {
            // A part that lasts, and noise.
            let mut gradient = random(8, x.len(), size);
            gradient.iter_mut().zip(random(step, x.len(), size)).for_each(|(g, n)| *g = 0.5 * *g + n);
            cpu.step(&mut x, &gradient, 0.01).unwrap();
            gpu.write(&g, &gradient).unwrap();
            device.prepare(&mut recording, &recorded, &[0.01]).unwrap();
            recording.run().unwrap();
        }
        let moved = distance(&x, &start);
        let worst = distance(&x, &gpu.read(&on_device).unwrap()) / moved;
        println!("lambda {lambda}, gradients {size:e}: moved {moved:.2}, error {worst:.1e}");
        assert!(moved > 0.02, "{moved}");
        assert_twin("LARGE_STEPS", lambda, worst, LARGE_STEPS);
        assert!(device.check().unwrap().is_none());
        let (ours, theirs) = (cpu.state(), device.state().unwrap());
        assert_eq!((ours.step, ours.scale_exponent), (theirs.step, theirs.scale_exponent));
        // It goes on on the CPU from the device's state.
        cpu.restore(theirs).unwrap();
    }
}

/// Normals of length one but for a few, over creases.
fn normals(vertices: usize) -> Vec<f32> {
    let mut normals = random(11, 3 * vertices, 1.0);
    for (v, n) in normals.chunks_mut(3).enumerate() {
        let towards = if v % 37 < 18 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        n.iter_mut().zip(towards).for_each(|(n, t)| *n = 0.1 * *n + t);
        let length = n.iter().map(|x| x * x).sum::<f32>().sqrt();
        n.iter_mut().for_each(|x| *x = if v % 50 == 0 { 0.0 } else { *x / length });
    }
    normals
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn fifty_steps_that_stop_at_creases_agree() {
    let gpu = test_device();
    let (vertices, edges) = edges();
    let (offsets, neighbours) = rings(vertices, &edges);
    let (temporal, sigma) = (Temporal::uniform_adam().betas(0.9, 0.99), 0.5);
    for lambda in [0.3, 19.0] {
        let start = random(7, 3 * vertices, 1.0);
        let (mut x, mut other) = (start.clone(), start.clone());
        let cpu = |sigma| {
            Optimizer::new("positions", 3 * vertices, temporal)
                .and_then(|o| {
                    o.with_filter(Placement::PRE, LargeSteps::new(vertices, &edges, lambda).unwrap())
                })
                .and_then(|o| {
                    o.with_filter(Placement::FIRST, EdgeAware::new(vertices, &edges, lambda, sigma).unwrap())
                })
                .unwrap()
        };
        let (mut ours, mut wider) = (cpu(sigma), cpu(1.05 * sigma));
        let creases = LargeStepsSolver::edge_aware(gpu, &offsets, &neighbours, lambda, sigma).unwrap();
        println!(
            "lambda {lambda}: condition {:.1}, {} iterations",
            creases.condition(),
            creases.iterations()
        );
        let plain = Some(solver(gpu, lambda));
        let mut device = DeviceOptimizer::new(gpu, "positions", (vertices, 3), temporal, plain)
            .and_then(|o| o.with_moments_by(creases))
            .unwrap();
        let [on_device, g, guide] = ["x", "g", "normals"].map(|name| gpu.upload(name, &x).unwrap());
        let mut r = gpu.record("bilateral");
        device.record_guide(&mut r, &guide).unwrap();
        let recorded = device.record(&mut r, &on_device, &g, 0).unwrap();
        let mut recording = r.finish().unwrap();
        for step in 0..50 {
            let mut gradient = random(8, x.len(), 1e-4);
            gradient.iter_mut().zip(random(step, x.len(), 1e-4)).for_each(|(g, n)| *g = 0.5 * *g + n);
            let mut normals = normals(vertices);
            // They turn from step to step.
            normals.rotate_left(3 * step as usize);
            ours.step_guided(&mut x, &gradient, 0.01, &normals).unwrap();
            wider.step_guided(&mut other, &gradient, 0.01, &normals).unwrap();
            gpu.write(&g, &gradient).unwrap();
            gpu.write(&guide, &normals).unwrap();
            device.prepare(&mut recording, &recorded, &[0.01]).unwrap();
            recording.run().unwrap();
        }
        let moved = distance(&x, &start);
        let there = gpu.read(&on_device).unwrap();
        assert!(moved > 0.02, "{moved}");
        assert_twin("EDGE_AWARE", lambda, distance(&x, &there) / moved, EDGE_AWARE);
        assert!(distance(&other, &there) / moved > EDGE_AWARE, "another sigma is noticed");
    }
    let solvers = || LargeStepsSolver::edge_aware(gpu, &offsets, &neighbours, 1.0, sigma).unwrap();
    let plain = DeviceOptimizer::new(gpu, "positions", (vertices, 3), temporal, None).unwrap();
    assert!(matches!(plain.with_moments_by(solvers()), Err(OptimError::Combination { .. })));
    let small = DeviceOptimizer::new(gpu, "positions", (vertices, 3), temporal, Some(solvers())).unwrap();
    let of_another = LargeStepsSolver::edge_aware(gpu, &[0, 0], &[], 1.0, sigma).unwrap();
    assert!(matches!(small.with_moments_by(of_another), Err(OptimError::Length { .. })));
    let later = DeviceOptimizer::new(gpu, "positions", (vertices, 3), temporal, Some(solvers())).unwrap();
    let x = gpu.zeros::<f32>("x", 3 * vertices + 3).unwrap();
    let refused = later.record(&mut gpu.record("later"), &x, &x, 3);
    assert!(matches!(refused, Err(OptimError::Combination { .. })), "{refused:?}");
    assert!(LargeStepsSolver::edge_aware(gpu, &offsets, &neighbours, 1.0, 0.0).is_err());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_broken_gradient_is_named_before_it_is_spread() {
    let gpu = test_device();
    let solver = solver(gpu, 19.0);
    let n = solver.vertices();
    let temporal = Temporal::uniform_adam();
    let mut device = DeviceOptimizer::new(gpu, "positions", (n, 3), temporal, Some(solver)).unwrap();
    let mut gradient = random(1, 3 * n, 1.0);
    gradient[1500] = f32::NAN;
    let (x, g) = (gpu.zeros::<f32>("x", 3 * n).unwrap(), gpu.upload("g", &gradient).unwrap());
    let mut r = gpu.record("broken");
    let recorded = device.record(&mut r, &x, &g, 0).unwrap();
    let mut recording = r.finish().unwrap();
    device.prepare(&mut recording, &recorded, &[0.01]).unwrap();
    recording.run().unwrap();
    let (ago, error) = device.check().unwrap().unwrap();
    assert_eq!(ago, 0);
    assert!(error.to_string().contains("1500"), "{error}");
    assert!(gpu.read(&x).unwrap().iter().all(|x| *x == 0.0));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn graphs_that_are_none_are_refused() {
    let gpu = test_device();
    for (offsets, neighbours, lambda) in [
        (vec![0, 1], vec![3], 1.0),
        (vec![0, 2], vec![0], 1.0),
        (vec![0], vec![], -1.0),
        (vec![], vec![], 1.0),
    ] {
        assert!(LargeStepsSolver::new(gpu, &offsets, &neighbours, lambda).is_err(), "{offsets:?}");
    }
}
