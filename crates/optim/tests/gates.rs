//! The figures that the bilateral optimizer must reach, over five seeds.

mod piecewise;

use photofit_optim::{Bilateral, Placement, Sigma};
use piecewise::{Filter, Method, Source, Target, floor, steps_below};

const TUNED: Sigma = Sigma::Fixed(0.02);
const AUTO: Sigma = Sigma::Auto(2.0);

fn anisotropic(seed: u64, method: Method, steps: usize) -> Vec<f64> {
    method.run(&Target::line(seed), Source::anisotropic(seed, 1000), steps).expect("finite steps")
}

fn noisy(seed: u64, method: Method) -> Vec<f64> {
    method.run(&Target::line(seed), Source::noisy(seed), 250).expect("finite steps")
}

/// Figure 2 of the paper: an anisotropic objective without noise.
fn check_anisotropic(seed: u64) {
    let adam = anisotropic(seed, Method::adam(0.13, 0.9), 1000);
    let laplacian = anisotropic(seed, Method::laplacian(0.13, 0.9, 10.0), 250);
    for sigma in [TUNED, AUTO] {
        let constant = anisotropic(seed, Method::bilateral(0.01, 0.5, sigma), 250);
        assert!(constant[250] <= 0.008, "seed {seed} {sigma:?}: {}", constant[250]);
        assert!(constant[250] <= laplacian[250] / 5.0, "seed {seed} {sigma:?}: Laplacian {}", laplacian[250]);
        assert!(constant[250] <= adam[1000] / 5.0, "seed {seed} {sigma:?}: Adam {}", adam[1000]);
        let cosine = anisotropic(seed, Method::bilateral(0.1, 0.5, sigma).cosine(250), 250);
        let steps = steps_below(&cosine, 0.03);
        assert!(steps.is_some_and(|s| s <= 40), "seed {seed} {sigma:?}: {steps:?} steps");
    }
    assert_eq!(steps_below(&adam, 0.03), None, "Adam does not get there");
}

#[test]
fn anisotropic_gates_hold_for_one_seed() {
    check_anisotropic(0);
}

#[test]
#[ignore = "slow: 15 seconds"]
fn anisotropic_gates_hold_for_all_seeds() {
    (0..5).for_each(check_anisotropic);
}

/// Figure 3 of the paper: an isotropic objective with noise.
#[test]
fn noisy_gates_hold() {
    for seed in 0..5 {
        let adam = noisy(seed, Method::adam(0.01, 0.9))[250];
        let laplacian = noisy(seed, Method::laplacian(0.01, 0.5, 3.0))[250];
        let mean = floor(&Target::line(seed), Source::noisy(seed), 250)[250];
        for sigma in [TUNED, AUTO] {
            let ours = noisy(seed, Method::bilateral(0.01, 0.5, sigma))[250];
            assert!(ours <= 0.45 * adam, "seed {seed} {sigma:?}: {ours} against Adam {adam}");
            assert!(ours <= 0.6 * laplacian, "seed {seed} {sigma:?}: {ours} against Laplacian {laplacian}");
            assert!(ours <= 0.7 * mean, "seed {seed} {sigma:?}: {ours} against the mean {mean}");
        }
    }
}

/// The same in the plane, with the default filter: there are more neighbours to average over, and more edges.
#[test]
fn noisy_gates_hold_in_the_plane() {
    for seed in 0..2 {
        let target = Target::plane(seed, 64);
        let run = |method: Method| method.run(&target, Source::noisy(seed), 250).unwrap()[250];
        let adam = run(Method::adam(0.01, 0.9));
        let filter = Filter::Bilateral(Bilateral::default());
        let ours = run(Method { filter, ..Method::bilateral(0.01, 0.5, AUTO) });
        assert!(ours <= 0.45 * adam, "seed {seed}: {ours} against Adam {adam}");
        let mean = floor(&target, Source::noisy(seed), 250)[250];
        assert!(ours <= 0.7 * mean, "seed {seed}: {ours} against the mean {mean}");
    }
}

/// Every place and order of the filter beats Adam under noise; the postfilter is best.
#[test]
fn ablations_under_noise() {
    for seed in 0..5 {
        let base = Method::bilateral(0.01, 0.5, TUNED);
        let adam = noisy(seed, Method::adam(0.01, 0.9))[250];
        let post = noisy(seed, base)[250];
        let mut coarse_to_fine = base;
        if let Filter::Bilateral(config) = &mut coarse_to_fine.filter {
            config.coarse_to_fine = true;
        }
        let coarse = noisy(seed, coarse_to_fine)[250];
        assert!(coarse < 1.25 * post, "seed {seed}: coarse to fine {coarse} against {post}");
        for placement in [Placement::PRE, Placement::BOTH] {
            let other = noisy(seed, base.placed(placement))[250];
            assert!(other < 0.7 * adam && other > post, "seed {seed} {placement:?}: {other}, post {post}");
        }
        let memoryless = noisy(seed, Method { beta1: 0.0, ..base })[250];
        assert!(memoryless < 0.6 * adam, "seed {seed}: without memory {memoryless}");
    }
}

/// Without noise the prefilter is slowest to get there, and the order of the levels does not matter much.
#[test]
#[ignore = "slow: 10 seconds"]
fn ablations_without_noise() {
    for seed in 0..5 {
        let base = Method::bilateral(0.01, 0.5, TUNED);
        let mut coarse_to_fine = base;
        if let Filter::Bilateral(config) = &mut coarse_to_fine.filter {
            config.coarse_to_fine = true;
        }
        let run = |method| anisotropic(seed, method, 250)[250];
        let [post, coarse] = [base, coarse_to_fine].map(run);
        let [pre, both] = [Placement::PRE, Placement::BOTH].map(|p| run(base.placed(p)));
        assert!(post <= 0.008 && coarse <= 0.008, "seed {seed}: {post}, coarse to fine {coarse}");
        assert!(both <= 0.015 && post < pre && pre <= 0.06, "seed {seed}: before {pre}, both {both}");
    }
}

/// Negative controls: filtering one moment alone.
#[test]
fn one_moment_alone_diverges_or_does_not_help() {
    let base = Method::bilateral(0.01, 0.5, TUNED);
    for seed in 0..3 {
        let first = anisotropic(seed, base.placed(Placement::FIRST), 250);
        let largest = first.iter().fold(0.0_f64, |a, b| a.max(*b));
        assert!(largest > 1.0 && first[250] > 0.3, "seed {seed}: up to {largest}, at last {}", first[250]);
        let second = Placement { first: false, ..Placement::POST };
        let adam = noisy(seed, Method::adam(0.01, 0.5))[250];
        let alone = noisy(seed, base.placed(second))[250];
        assert!(alone > 0.9 * adam, "seed {seed}: {alone} against Adam {adam}");
    }
}
