//! Twins against the optimizers of the CPU.

mod adam;
mod large_steps;
mod tolerances;

use super::{KERNELS, constrain};
use crate::{clamp_channels, normalize_vectors};
use photofit_gpu::{test_device, validate};
use photofit_sampling::Rng;

fn random(seed: u64, n: usize, size: f32) -> Vec<f32> {
    let mut rng = Rng::new(seed, 1);
    (0..n).map(|_| rng.uniform(-size, size)).collect()
}

/// The largest difference.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()).fold(0.0, f64::max)
}

fn largest(a: &[f32]) -> f64 {
    a.iter().map(|a| f64::from(a.abs())).fold(0.0, f64::max)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn constraints_agree() {
    let gpu = test_device();
    let (width, rows) = (7, 1000);
    let mut x = random(1, width * rows, 2.0);
    // What is not a number, huge, tiny, zero, and unit already.
    for (k, v) in
        [[0.9; 3], [f32::NAN, 0.0, 1.0], [3e30, 0.0, 4e30], [1e-30, 0.0, 0.0], [0.0; 3], [0.6, 0.0, 0.8]]
            .iter()
            .enumerate()
    {
        x[k * width + 2..k * width + 5].copy_from_slice(v);
    }
    x[13] = f32::NAN;
    x[20] = f32::INFINITY;
    let wide = [f32::NEG_INFINITY, f32::INFINITY];
    let ranges = [[0.0, 1.0], [-0.5, 0.25], wide, wide, wide, [0.03, 1.0], [-1.0, 1e4]];
    let buffer = gpu.upload("x", &x).unwrap();
    let mut r = gpu.record("constrain");
    // The first row stays, as does the last one.
    constrain(&mut r, &buffer, (1..rows - 1, width), &ranges, Some(2)).unwrap();
    r.finish().unwrap().run().unwrap();
    let inside = &mut x[width..width * (rows - 1)];
    clamp_channels(inside, &ranges);
    normalize_vectors(inside, width, 2);
    let theirs = gpu.read(&buffer).unwrap();
    assert!(x.iter().chain(&theirs).all(|x| x.is_finite()));
    let worst = distance(&x, &theirs);
    // The largest entry is that of a range.
    photofit_gpu::assert_twin("CONSTRAIN", "constraints", worst, tolerances::CONSTRAIN);
    normalize_vectors(&mut x, width, 3);
    assert!(distance(&x, &theirs) > tolerances::CONSTRAIN, "another vector is noticed");
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
fn kernels_are_valid() {
    KERNELS.iter().for_each(|k| validate(k).unwrap());
}
