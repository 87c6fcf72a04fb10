//! Twins against the CPU.

mod denoised;
mod solver;
mod tolerances;

use super::KERNELS;
use photofit_gpu::validate;
use photofit_sampling::Rng;

fn random(seed: u64, n: usize, size: f32) -> Vec<f32> {
    let mut rng = Rng::new(seed, 1);
    (0..n).map(|_| rng.uniform(-size, size)).collect()
}

/// The largest difference.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many values");
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()).fold(0.0, f64::max)
}

fn largest(a: &[f32]) -> f64 {
    a.iter().map(|a| f64::from(a.abs())).fold(0.0, f64::max)
}

fn bits(a: &[f32]) -> Vec<u32> {
    a.iter().map(|a| a.to_bits()).collect()
}

#[test]
fn kernels_are_valid() {
    KERNELS.iter().for_each(|k| validate(k).expect("a kernel of this crate"));
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}
