//! Adam by entries, with rates per column.

use super::tolerances::{ADAM, MOMENTS};
use super::{distance, largest, random};
use crate::gpu::DeviceOptimizer;
use crate::{OptimError, Optimizer, Rows, Temporal};
use photofit_gpu::{Buffer, Gpu, assert_twin, test_device};

const STEPS: u64 = 50;

/// Rows of five samples, one of them frozen, more than one chunk of the scan.
const RATES: [f32; 5] = [0.01, 0.02, 0.0, 0.01, 0.005];
const ROWS: usize = 3001;

/// Gradients that grow from 1e-18 to 1e18 or fall the other way, so that the unit of the moments moves.
fn gradient(step: u64, way: f32) -> Vec<f32> {
    let size = 10_f32.powf(way * (step as f32 / STEPS as f32 * 36.0 - 18.0));
    random(step, ROWS * RATES.len(), size)
}

fn temporal() -> Temporal {
    Temporal { beta1: 0.8, beta2: 0.98, relative_epsilon: 0.5, ..Temporal::adam() }
}

/// Samples before those that are fitted, and behind them: they stay, and their gradients, which are none, are not read.
const AROUND: [usize; 2] = [37, 5];

fn padded(samples: &[f32], with: f32) -> Vec<f32> {
    [&vec![with; AROUND[0]], samples, &vec![with; AROUND[1]]].concat()
}

/// A device's optimizer with its buffers.
struct Run<'a> {
    gpu: &'a Gpu,
    optimizer: DeviceOptimizer,
    x: Buffer<f32>,
    g: Buffer<f32>,
}

impl<'a> Run<'a> {
    fn new(gpu: &'a Gpu, x: &[f32]) -> Self {
        Self {
            gpu,
            optimizer: DeviceOptimizer::new(gpu, "texels", (ROWS, RATES.len()), temporal(), None).unwrap(),
            x: gpu.upload("x", &padded(x, 7.0)).unwrap(),
            g: gpu.upload("g", &padded(x, f32::NAN)).unwrap(),
        }
    }

    fn steps(&mut self, steps: std::ops::Range<u64>, rates: &[f32], g: impl Fn(u64) -> Vec<f32>) {
        let mut r = self.gpu.record("adam");
        let recorded = self.optimizer.record(&mut r, &self.x, &self.g, AROUND[0]).unwrap();
        let mut recording = r.finish().unwrap();
        for step in steps {
            self.gpu.write_from(&self.g, AROUND[0], &g(step)).unwrap();
            self.optimizer.prepare(&mut recording, &recorded, rates).unwrap();
            recording.run().unwrap();
        }
    }

    fn x(&self) -> Vec<f32> {
        let mut all = self.gpu.read(&self.x).unwrap();
        let behind = all.split_off(all.len() - AROUND[1]);
        let own = all.split_off(AROUND[0]);
        assert!(all.iter().chain(&behind).all(|x| *x == 7.0), "what is around stays");
        own
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn fifty_steps_agree_at_any_size_of_the_gradients() {
    let gpu = test_device();
    for way in [0.0, 1.0, -1.0] {
        let start = random(99, ROWS * RATES.len(), 1.0);
        let mut x = start.clone();
        let mut cpu = Optimizer::new("texels", x.len(), temporal()).unwrap();
        let mut run = Run::new(gpu, &x);
        for step in 0..STEPS {
            cpu.step_rows(&mut x, &gradient(step, way), &Rows { rates: &RATES, touched: None }).unwrap();
        }
        run.steps(0..STEPS, &RATES, |s| gradient(s, way));
        let worst = distance(&x, &run.x()) / (STEPS as f64 * 0.02);
        let (ours, theirs) = (cpu.state(), run.optimizer.state().unwrap());
        let moments = distance(&ours.m, &theirs.m) / largest(&ours.m);
        let squares = distance(&ours.v, &theirs.v) / largest(&ours.v);
        assert_twin("ADAM", way, worst, ADAM);
        assert_twin("MOMENTS", way, moments.max(squares), MOMENTS);
        assert_eq!((ours.step, ours.scale_exponent), (theirs.step, theirs.scale_exponent), "{way}");
        assert!((ours.mean_square / theirs.mean_square - 1.0).abs() < 1e-5, "{way}");
        assert!(run.optimizer.check().unwrap().is_none());
        let frozen = |x: &[f32]| x.chunks(5).map(|r| r[2].to_bits()).collect::<Vec<_>>();
        assert!(frozen(&run.x()) == frozen(&start), "a frozen column keeps its bits");
        // A rate that differs by a hundredth is noticed.
        let mut other = Run::new(gpu, &start);
        other.steps(0..STEPS, &RATES.map(|r| 1.01 * r), |s| gradient(s, way));
        assert!(distance(&x, &other.x()) / (STEPS as f64 * 0.02) > ADAM, "{way}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn runs_repeat_and_resume_to_the_bit() {
    let gpu = test_device();
    let start = random(3, ROWS * RATES.len(), 1.0);
    let whole = || {
        let mut run = Run::new(gpu, &start);
        run.steps(0..STEPS, &RATES, |s| gradient(s, 1.0));
        run.x()
    };
    let expected = whole();
    assert!(whole() == expected, "two runs");
    let mut first = Run::new(gpu, &start);
    first.steps(0..20, &RATES, |s| gradient(s, 1.0));
    let mut second = Run::new(gpu, &first.x());
    second.optimizer.restore(&first.optimizer.state().unwrap()).unwrap();
    second.steps(20..STEPS, &RATES, |s| gradient(s, 1.0));
    assert!(second.x() == expected, "a run that went on");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_gradient_that_is_not_finite_halts_and_is_told() {
    let gpu = test_device();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        // In the frozen column, too.
        for index in [7001, 12] {
            let start = random(3, ROWS * RATES.len(), 1.0);
            let gradients = |s: u64| {
                let mut g = gradient(s, 0.0);
                if s == 4 {
                    g[index] = bad;
                    g[9999] = bad;
                }
                g
            };
            let mut run = Run::new(gpu, &start);
            run.steps(0..4, &RATES, gradients);
            let (before, state) = (run.x(), run.optimizer.state().unwrap());
            run.steps(4..9, &RATES, gradients);
            assert!(run.x() == before, "nothing moves from there on");
            assert!(run.optimizer.state().unwrap().m == state.m);
            let (ago, error) = run.optimizer.check().unwrap().unwrap();
            assert_eq!(ago, 4, "steps after it");
            let OptimError::NonFiniteGradient { group, index: at, value } = error else { panic!() };
            assert_eq!((group.as_str(), at), ("texels", index));
            assert!(value.to_bits() == f64::from(bad).to_bits() || value.is_nan() && bad.is_nan());
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn zero_gradients_move_nothing() {
    let gpu = test_device();
    let start = random(3, ROWS * RATES.len(), 1.0);
    let mut run = Run::new(gpu, &start);
    run.steps(0..3, &RATES, |_| vec![0.0; ROWS * RATES.len()]);
    assert!(run.x() == start);
    run.steps(3..4, &RATES, |s| gradient(s, 0.0));
    let moved = run.x();
    assert!(moved != start && moved.iter().all(|x| x.is_finite()));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn what_only_the_cpu_has_is_refused() {
    let gpu = test_device();
    for temporal in [Temporal::vector_adam(3), Temporal::descent(0.9), Temporal::memoryless()] {
        let error = DeviceOptimizer::new(gpu, "x", (4, 3), temporal, None).unwrap_err();
        assert!(matches!(error, OptimError::Combination { .. }), "{error}");
    }
    assert!(DeviceOptimizer::new(gpu, "x", (4, 17), Temporal::adam(), None).is_err());
}
