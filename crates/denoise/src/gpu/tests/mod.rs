//! Twins against the CPU.

mod denoised;
mod refusals;
mod solver;
mod tolerances;

use super::KERNELS;
use photofit_gpu::{Choice, Gpu, validate};
use photofit_sampling::Rng;

fn random(seed: u64, n: usize, size: f32) -> Vec<f32> {
    let mut rng = Rng::new(seed, 1);
    (0..n).map(|_| rng.uniform(-size, size)).collect()
}

/// The largest of some numbers that are not negative; infinity where one is not a number.
fn worst(of: impl Iterator<Item = f64>) -> f64 {
    of.fold(0.0, |most, v| if v.is_nan() { f64::INFINITY } else { v.max(most) })
}

/// The largest difference.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many values");
    worst(a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()))
}

fn largest(a: &[f32]) -> f64 {
    worst(a.iter().map(|a| f64::from(a.abs())))
}

/// Which adapter the tests choose.
fn choice() -> Choice {
    std::env::var("PHOTOFIT_TEST_GPU").map_or(Choice::Any, Choice::Named)
}

/// A device that no other test uses.
fn own_device() -> Gpu {
    Gpu::new(&choice()).expect("a device")
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
