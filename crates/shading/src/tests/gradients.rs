//! Gradients in double precision against central differences.

use super::{at, at_cosine, flatten, join, material, unflatten, unit, vector};
use crate::Surface;
use crate::{
    Energy, ROUGHNESS_MIN, eval, eval_vjp, face_viewer, face_viewer_vjp, perturb, perturb_vjp, split_sum,
};
use photofit_gradcheck::{Uniform, check, max_relative_error};
use photofit_scalar::vec3;

fn check_eval(name: &str, energy: Energy, x: &[f64], seed: photofit_scalar::Vec3<f64>, h: f64) {
    let d = eval_vjp(&unflatten(x), energy, at(x, 6), at(x, 9), at(x, 12), seed);
    let gradient = join(flatten(&d.surface), &[d.n, d.wo, d.wi]);
    let tolerance = if energy == Energy::Single { 1e-6 } else { 1e-5 };
    let f = |x: &[f64]| eval(&unflatten(x), energy, at(x, 6), at(x, 9), at(x, 12)).dot(seed);
    check(&format!("{name} {energy:?}"), x, &gradient, h, tolerance, f);
}

#[test]
fn eval_for_random_configurations() {
    let mut random = Uniform::new(1);
    for k in 0..200 {
        let roughness = random.range(0.15, 1.0);
        let s = material(&mut random, roughness);
        let n = unit(&mut random);
        let (cv, cl) = (random.range(0.05, 1.0), random.range(0.05, 1.0));
        let wo = at_cosine(&mut random, n, cv);
        let wi = at_cosine(&mut random, n, cl);
        let seed = vector(&mut random);
        let x = join(flatten(&s), &[n, wo, wi]);
        check_eval(&format!("eval {k}"), Energy::Single, &x, seed, 1e-5);
        // The tables are linear between their points: a step over one of them would show.
        check_eval(&format!("eval {k}"), Energy::Compensated, &x, seed, 1e-7);
    }
}

#[test]
fn eval_for_narrow_lobes_near_the_mirror_direction() {
    let mut random = Uniform::new(2);
    for k in 0..100 {
        let roughness = random.range(ROUGHNESS_MIN + 0.001, 0.2);
        let s = material(&mut random, roughness);
        let alpha = roughness * roughness;
        let n = unit(&mut random);
        let cosine = random.range(0.05, 1.0);
        let wo = at_cosine(&mut random, n, cosine);
        let half = (n + vector(&mut random) * alpha).normalize_or_zero();
        let wi = half * (2.0 * half.dot(wo)) - wo;
        let seed = vector(&mut random);
        let x = join(flatten(&s), &[n, wo, wi]);
        check_eval(&format!("narrow {k}"), Energy::Single, &x, seed, 1e-4 * alpha);
        check_eval(&format!("narrow {k}"), Energy::Compensated, &x, seed, 1e-4 * alpha);
    }
}

#[test]
fn eval_at_grazing_angles() {
    let mut random = Uniform::new(3);
    for k in 0..100 {
        let roughness = random.range(0.1, 1.0);
        let s = material(&mut random, roughness);
        let n = unit(&mut random);
        let (cv, cl) = (10f64.powf(random.range(-3.0, -1.0)), 10f64.powf(random.range(-3.0, -1.0)));
        let wo = at_cosine(&mut random, n, cv);
        let wi = at_cosine(&mut random, n, cl);
        let seed = vector(&mut random);
        let x = join(flatten(&s), &[n, wo, wi]);
        check_eval(&format!("grazing {k}"), Energy::Single, &x, seed, 1e-7);
        check_eval(&format!("grazing {k}"), Energy::Compensated, &x, seed, 1e-8);
    }
}

#[test]
fn eval_with_the_viewer_below_the_horizon() {
    let mut random = Uniform::new(4);
    for k in 0..50 {
        let roughness = random.range(0.3, 1.0);
        let s = material(&mut random, roughness);
        let n = unit(&mut random);
        let (cv, cl) = (random.range(-0.9, -0.01), random.range(0.05, 1.0));
        let wo = at_cosine(&mut random, n, cv);
        let wi = at_cosine(&mut random, n, cl);
        let seed = vector(&mut random);
        check_eval(&format!("below {k}"), Energy::Single, &join(flatten(&s), &[n, wo, wi]), seed, 1e-6);
    }
}

#[test]
fn roughness_has_a_gradient_over_its_whole_range() {
    let mut random = Uniform::new(10);
    for roughness in [ROUGHNESS_MIN, 0.031, 0.04, 0.045, 0.3, 1.0] {
        let s = material(&mut random, roughness);
        let n = unit(&mut random);
        let wo = at_cosine(&mut random, n, 0.7);
        let half = (n + vector(&mut random) * (roughness * roughness)).normalize_or_zero();
        let wi = half * (2.0 * half.dot(wo)) - wo;
        for energy in [Energy::Single, Energy::Compensated] {
            let d = eval_vjp(&s, energy, n, wo, wi, vec3(1.0, 1.0, 1.0)).surface.roughness;
            // The roughness moves alone, into its range: at an end the derivative is that side's.
            let h = if roughness < 1.0 { 1e-6 * roughness * roughness } else { -1e-6 };
            let moved = Surface { roughness: roughness + h, ..s };
            let f = |s: &Surface<f64>| eval(s, energy, n, wo, wi).sum();
            let quotient = (f(&moved) - f(&s)) / h;
            assert!(
                d != 0.0 && (d - quotient).abs() < 1e-3 * d.abs(),
                "{roughness} {energy:?}: {d} {quotient}"
            );
        }
    }
    let below = Surface { roughness: 0.5 * ROUGHNESS_MIN, ..material(&mut random, 0.5) };
    let (n, wo) = (vec3(0.0, 0.0, 1.0), vec3(0.6, 0.0, 0.8));
    let d = eval_vjp(&below, Energy::Single, n, wo, vec3(-0.6, 0.0, 0.8), vec3(1.0, 1.0, 1.0));
    assert_eq!(d.surface.roughness, 0.0, "a clamped value has none");
}

#[test]
fn nothing_is_reflected_from_below_and_nothing_flows_back() {
    let mut random = Uniform::new(5);
    let s = material(&mut random, 0.4);
    let n = unit(&mut random);
    let wo = at_cosine(&mut random, n, 0.5);
    for cosine in [-1.0, -0.3, 0.0] {
        let wi = at_cosine(&mut random, n, cosine) - n * 1e-15;
        assert_eq!(eval(&s, Energy::Single, n, wo, wi).sum(), 0.0);
        assert_eq!(eval_vjp(&s, Energy::Single, n, wo, wi, unit(&mut random)), Default::default());
    }
}

#[test]
fn perturbed_normals() {
    let mut random = Uniform::new(6);
    for k in 0..100 {
        let (n, t) = (unit(&mut random) * random.range(0.5, 1.5), vector(&mut random));
        let hand = if k % 2 == 0 { 1.0 } else { -1.0 };
        let mut map = vector(&mut random);
        map.z = if k % 5 == 0 { -0.2 } else { random.range(0.1, 1.0) };
        let seed = vector(&mut random);
        let d = perturb_vjp(n, t, hand, map, seed);
        let x = join(Vec::new(), &[n, t, map]);
        let gradient = join(Vec::new(), &[d.normal, d.tangent, d.map]);
        check(&format!("perturb {k}"), &x, &gradient, 1e-6, 1e-6, |x| {
            perturb(at(x, 0), at(x, 3), hand, at(x, 6)).dot(seed)
        });
    }
}

#[test]
fn normals_that_face_the_viewer() {
    let mut random = Uniform::new(7);
    for k in 0..200 {
        let n = unit(&mut random);
        let cosine = random.range(-0.95, 0.2);
        let wo = at_cosine(&mut random, n, cosine);
        let geometric = unit(&mut random) * 3.0;
        let seed = vector(&mut random);
        let d = face_viewer_vjp(n, geometric, wo, seed);
        let x = join(Vec::new(), &[n, wo]);
        let gradient = join(Vec::new(), &[d.normal, d.wo]);
        check(&format!("face {k}"), &x, &gradient, 1e-7, 1e-5, |x| {
            face_viewer(at(x, 0), geometric, at(x, 3)).dot(seed)
        });
    }
}

#[test]
fn split_sum_of_cosine_and_roughness() {
    let mut random = Uniform::new(8);
    for k in 0..200 {
        let x = [random.range(0.001, 0.999), random.range(ROUGHNESS_MIN + 0.001, 0.999)];
        let seed = [random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
        let s = split_sum(x[0], x[1]);
        let gradient = [0, 1].map(|i| seed[0] * s.d_scale[i] + seed[1] * s.d_bias[i]);
        check(&format!("split sum {k}"), &x, &gradient, 1e-7, 1e-5, |x| {
            let s = split_sum(x[0], x[1]);
            seed[0] * s.scale + seed[1] * s.bias
        });
    }
}

#[test]
fn a_wrong_gradient_is_noticed() {
    let mut random = Uniform::new(9);
    let s = material(&mut random, 0.5);
    let n = unit(&mut random);
    let (wo, wi) = (at_cosine(&mut random, n, 0.6), at_cosine(&mut random, n, 0.7));
    let x = join(flatten(&s), &[n, wo, wi]);
    let seed = vector(&mut random);
    let d = eval_vjp(&s, Energy::Single, n, wo, wi, seed);
    let mut gradient = join(flatten(&d.surface), &[d.n, d.wo, d.wi]);
    let f = |x: &[f64]| eval(&unflatten(x), Energy::Single, at(x, 6), at(x, 9), at(x, 12)).dot(seed);
    assert!(max_relative_error(&x, &gradient, 1e-5, f) < 1e-6);
    let largest = (0..gradient.len()).max_by(|a, b| gradient[*a].abs().total_cmp(&gradient[*b].abs()));
    gradient[largest.unwrap()] *= 1.001;
    assert!(max_relative_error(&x, &gradient, 1e-5, f) > 1e-4);
}
