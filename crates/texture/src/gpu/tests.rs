//! The kernels against the CPU.

use super::*;
use photofit_gpu::{test_device, validate};
use photofit_gradcheck::{Uniform, worst_difference};

const COVERAGE: MipRule = MipRule::Coverage { colors: 3, alpha: 3 };
const SIZES: [(usize, usize); 9] =
    [(1, 1), (2, 2), (3, 3), (5, 4), (7, 1), (1, 6), (37, 21), (64, 32), (129, 63)];

mod lookups;
mod stored;

fn pyramid(size: (usize, usize), rule: MipRule, seed: u64) -> Pyramid<f32, CHANNELS> {
    let mut rng = Uniform::new(seed);
    let mut texels = vec![[0.0; CHANNELS]; size.0 * size.1];
    for t in &mut texels {
        t.iter_mut().for_each(|x| *x = rng.range(-1.0, 1.0) as f32);
        // Alpha with texels that are hardly there.
        t[3] = (rng.range(-0.4, 1.0).max(0.0)) as f32;
    }
    Pyramid::with_rule(Texture { width: size.0, height: size.1, texels }, rule)
}

fn flat(p: &Pyramid<f32, CHANNELS>) -> Vec<f32> {
    p.levels.iter().flat_map(|l| l.texels.iter().flatten().copied()).collect()
}

fn run(gpu: &Gpu, record: impl FnOnce(&mut Recorder) -> Result<(), GpuError>) {
    let mut r = gpu.record("test");
    record(&mut r).expect("recorded");
    r.finish().expect("finished").run().expect("runs");
}

fn words(gpu: &Gpu, b: &Buffer<[f32; 4]>) -> Vec<f32> {
    gpu.read(b).expect("read").concat()
}

fn assert_close(name: &str, what: &str, found: &[f32], expected: &[f32], bound: f64) {
    photofit_gpu::assert_twin(name, what, worst_difference(found, expected), bound);
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
fn kernels_are_valid() {
    for kernel in KERNELS.iter().chain([&lookups::FORWARD, &lookups::REVERSE, &stored::READ]) {
        validate(kernel).expect("valid");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn chains_agree() {
    let gpu = test_device();
    for (k, size) in SIZES.into_iter().enumerate() {
        for rule in [MipRule::Area, COVERAGE, MipRule::Free] {
            let expected = pyramid(size, rule, k as u64);
            let mut start = expected.clone();
            if rule != MipRule::Free {
                start.levels[1..].iter_mut().for_each(|l| l.texels.fill([f32::NAN; CHANNELS]));
            }
            let maps = MipBuffers::new(gpu, &start, [true; CHANNELS]).expect("fits");
            assert_eq!(maps.read(gpu).expect("read").levels[0], expected.levels[0]);
            run(gpu, |r| maps.record_rebuild(r));
            let found = flat(&maps.read(gpu).expect("read"));
            assert_close(
                "LEVELS",
                &format!("{size:?} {rule:?}"),
                &found,
                &flat(&expected),
                tolerances::LEVELS,
            );
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn adjoints_of_chains_agree() {
    let gpu = test_device();
    for (k, size) in SIZES.into_iter().enumerate() {
        for rule in [MipRule::Area, COVERAGE, MipRule::Free] {
            for adjoint in [MipAdjoint::Exact, MipAdjoint::Smooth] {
                let values = pyramid(size, rule, k as u64);
                let mut expected = pyramid(size, MipRule::Free, 100 + k as u64);
                expected.rule = rule;
                let maps = MipBuffers::new(gpu, &values, [true; CHANNELS]).expect("fits");
                gpu.write(&maps.gradient, bytemuck::cast_slice(&flat(&expected))).expect("written");
                values.collapse_vjp(&mut expected, adjoint);
                run(gpu, |r| maps.record_collapse_vjp(r, adjoint));
                let found = words(gpu, &maps.gradient);
                let what = format!("{size:?} {rule:?} {adjoint:?}");
                // Levels apart: their gradients differ in size.
                let mut at = 0;
                for l in &expected.levels {
                    let level = l.texels.as_flattened();
                    assert_close("LEVELS", &what, &found[at..at + level.len()], level, tolerances::LEVELS);
                    at += level.len();
                }
            }
        }
    }
}
