//! Known values, energy, reciprocity, and single against double precision.

use super::{at_cosine, material, unit, vector};
use crate::{COSINE_MIN, Energy, ROUGHNESS_MIN, Surface, eval, eval_vjp, face_viewer, perturb};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3, vec3};
use std::f64::consts::{PI, TAU};

const Z: Vec3<f64> = vec3(0.0, 0.0, 1.0);

/// Directional albedo by quadrature: over half vectors (which follows narrow lobes) or over directions.
fn albedo(s: &Surface<f64>, cosine: f64, n: usize) -> Vec3<f64> {
    let wo = vec3((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    let mut sum = Vec3::zero();
    let a2 = s.roughness.max(ROUGHNESS_MIN).powi(4);
    for i in 0..n {
        // The polar angle of the half vector: nh = t / sqrt(a2 + (1 - a2) t^2), dense inside of the lobe.
        let t = (i as f64 + 0.5) / n as f64;
        let root = (a2 + (1.0 - a2) * t * t).sqrt();
        let (nh, d_nh) = (t / root, a2 / (root * root * root));
        for j in 0..n {
            let phi = (j as f64 + 0.5) / n as f64 * TAU;
            let sh = (1.0 - nh * nh).max(0.0).sqrt();
            let h = vec3(sh * phi.cos(), sh * phi.sin(), nh);
            let vh = h.dot(wo);
            if vh > 0.0 {
                let wi = h * (2.0 * vh) - wo;
                sum += eval(s, Energy::Single, Z, wo, wi) * (4.0 * vh * d_nh);
            }
        }
    }
    sum * (TAU / (n * n) as f64)
}

#[test]
fn the_specular_lobe_never_creates_energy() {
    for roughness in [0.0, 0.1, 0.25, 0.5, 0.75, 1.0] {
        for cosine in [0.02, 0.1, 0.3, 0.6, 0.9, 1.0] {
            let white_metal =
                Surface { base_color: vec3(1.0, 1.0, 1.0), roughness, metallic: 1.0, gamma: 0.0 };
            let a = albedo(&white_metal, cosine, 200).x;
            assert!(a < 1.003, "roughness {roughness} cosine {cosine}: albedo {a}");
            let at_least = if roughness <= 0.25 { 0.85 } else { 0.3 };
            assert!(a > at_least, "roughness {roughness} cosine {cosine}: albedo {a}");
            let black = Surface { base_color: Vec3::zero(), roughness, metallic: 0.0, gamma: 1.0 };
            let b = albedo(&black, cosine, 100).x;
            assert!(b < a && b >= 0.0, "roughness {roughness} cosine {cosine}: only Fresnel is left: {b}");
        }
    }
}

#[test]
fn the_roughest_metal_reflects_one_minus_ln_2_at_normal_incidence() {
    // alpha = 1, n = wo: D = 1 / pi, V = 1 / (2 (1 + n.wi)), so the albedo is int_0^1 2 x / (2 (1 + x)) dx.
    let s = Surface { base_color: vec3(1.0, 1.0, 1.0), roughness: 1.0, metallic: 1.0, gamma: 0.0 };
    let a = albedo(&s, 1.0, 500).x;
    assert!((a - (1.0 - 2f64.ln())).abs() < 1e-4, "{a}");
}

#[test]
fn a_white_dielectric_exceeds_one_by_its_specular_albedo_only() {
    for roughness in [0.3, 0.6, 1.0] {
        for cosine in [0.2, 0.7, 1.0] {
            let white = Surface { base_color: vec3(1.0, 1.0, 1.0), roughness, metallic: 0.0, gamma: 0.0 };
            let black = Surface { base_color: Vec3::zero(), ..white };
            let (a, b) = (albedo(&white, cosine, 300).x, albedo(&black, cosine, 300).x);
            assert!((a - b - 1.0).abs() < 5e-3, "roughness {roughness} cosine {cosine}: {a} {b}");
        }
    }
}

#[test]
fn scattering_is_reciprocal() {
    let mut random = Uniform::new(11);
    for _ in 0..10_000 {
        let roughness = random.range(0.0, 1.0);
        let s = material(&mut random, roughness);
        let n = unit(&mut random);
        let (a, b) = (random.range(COSINE_MIN, 1.0), random.range(COSINE_MIN, 1.0));
        let (wo, wi) = (at_cosine(&mut random, n, a), at_cosine(&mut random, n, b));
        let (there, back) = (
            eval(&s, Energy::Single, n, wo, wi) * (1.0 / b),
            eval(&s, Energy::Single, n, wi, wo) * (1.0 / a),
        );
        assert!((there - back).length() <= 1e-9 * there.length(), "{there:?} {back:?}");
    }
}

#[test]
fn textbook_terms_give_the_same_value() {
    let mut random = Uniform::new(12);
    for _ in 0..1000 {
        let roughness = random.range(0.1, 1.0);
        let s = material(&mut random, roughness);
        let n = unit(&mut random);
        let (cv, cl) = (random.range(0.01, 1.0), random.range(0.01, 1.0));
        let (wo, wi) = (at_cosine(&mut random, n, cv), at_cosine(&mut random, n, cl));
        let h = (wo + wi).normalize_or_zero();
        let a2 = roughness.powi(4);
        let d = a2 / (PI * (n.dot(h).powi(2) * (a2 - 1.0) + 1.0).powi(2));
        let lambda = |c: f64| 0.5 * ((1.0 + a2 * (1.0 / (c * c) - 1.0)).sqrt() - 1.0);
        let g = 1.0 / (1.0 + lambda(cv) + lambda(cl));
        let p = (1.0 - wo.dot(h)).powi(5);
        let dielectric = 0.04 * (1.0 - s.metallic);
        for k in 0..3 {
            let kd = s.base_color[k];
            let f0 = (dielectric + s.metallic * kd) * (1.0 - s.gamma);
            let f = f0 + (1.0 - f0) * p;
            let expected = (kd * (1.0 - s.metallic) / PI + f * d * g / (4.0 * cv * cl)) * cl;
            let got = eval(&s, Energy::Single, n, wo, wi)[k];
            assert!((got - expected).abs() < 1e-8 * expected.max(1.0), "{got} {expected}");
        }
    }
}

/// Relative error of single precision, with inputs rounded to single precision on both sides.
fn single_precision_error(random: &mut Uniform, roughness: f64, cosine_min: f64) -> (f64, f64) {
    let s = material(random, roughness).cast::<f32>();
    let n = unit(random).cast::<f32>();
    let wide: Vec3<f64> = n.cast::<f64>().normalize_or_zero();
    let cosine = 10f64.powf(random.range(cosine_min.log10(), 0.0));
    let wo = at_cosine(random, wide, cosine).cast::<f32>();
    let alpha = roughness.max(ROUGHNESS_MIN).powi(2);
    let half = (wide + vector(random) * alpha).normalize_or_zero();
    let wo_wide = wo.cast::<f64>();
    let wi = (half * (2.0 * half.dot(wo_wide)) - wo_wide).normalize_or_zero().cast::<f32>();
    let seed = vector(random).cast::<f32>();
    let narrow = eval(&s, Energy::Single, n, wo, wi);
    let exact = eval(&s.cast::<f64>(), Energy::Single, n.cast(), wo.cast(), wi.cast());
    let a = eval_vjp(&s, Energy::Single, n, wo, wi, seed);
    let b = eval_vjp(&s.cast::<f64>(), Energy::Single, n.cast(), wo.cast(), wi.cast(), seed.cast());
    let difference = |x: Vec3<f32>, y: Vec3<f64>| (x.cast::<f64>() - y).length() / y.length().max(1e-3);
    let gradient = [
        difference(a.n, b.n),
        difference(a.wo, b.wo),
        difference(a.wi, b.wi),
        difference(a.surface.base_color, b.surface.base_color),
        (f64::from(a.surface.roughness) - b.surface.roughness).abs() / b.surface.roughness.abs().max(1e-2),
    ];
    (difference(narrow, exact), gradient.into_iter().fold(0.0, f64::max))
}

#[test]
fn single_precision_is_close_to_double() {
    let mut random = Uniform::new(13);
    for (roughness, value_limit, gradient_limit) in
        [(0.0, 3e-3, 2e-2), (0.1, 1e-3, 1e-2), (0.3, 2e-4, 5e-3), (0.7, 1e-4, 5e-3), (1.0, 1e-4, 5e-3)]
    {
        let (mut value, mut gradient): (f64, f64) = (0.0, 0.0);
        for _ in 0..2000 {
            let e = single_precision_error(&mut random, roughness, 1e-2);
            (value, gradient) = (value.max(e.0), gradient.max(e.1));
        }
        println!("roughness {roughness}: value {value:.1e} gradient {gradient:.1e}");
        assert!(value < value_limit, "roughness {roughness}: value {value:.2e}");
        assert!(gradient < gradient_limit, "roughness {roughness}: gradient {gradient:.2e}");
    }
}

#[test]
fn extreme_inputs_stay_finite_in_single_precision() {
    let mut random = Uniform::new(14);
    for roughness in [-1.0, 0.0, 0.5, 1.0, 2.0] {
        for cv in [-1.0, -1e-4, 0.0, 1e-7, 1e-4, 1.0] {
            for cl in [1e-20, 1e-7, 1e-4, 1.0] {
                let s = material(&mut random, roughness).cast::<f32>();
                let n = unit(&mut random);
                let wo = at_cosine(&mut random, n, cv);
                for wi in [at_cosine(&mut random, n, cl), -wo, wo, n * (2.0 * cv) - wo] {
                    let d =
                        eval_vjp(&s, Energy::Single, n.cast(), wo.cast(), wi.cast(), vec3(1.0, -1.0, 0.5));
                    let finite = d.n.is_finite() && d.wo.is_finite() && d.wi.is_finite();
                    let finite =
                        finite && d.surface.base_color.is_finite() && d.surface.roughness.is_finite();
                    assert!(finite, "roughness {roughness} n.wo {cv} n.wi {cl}: {d:?}");
                    assert!(eval(&s, Energy::Single, n.cast(), wo.cast(), wi.cast()).is_finite());
                }
            }
        }
    }
}

#[test]
fn the_normal_map_follows_the_handedness() {
    let (n, t) = (vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 0.0));
    let map = vec3(0.6, 0.0, 0.8);
    assert!((perturb(n, t, 1.0, map) - map).length() < 1e-12);
    let map = vec3(0.0, 0.6, 0.8);
    assert!((perturb(n, t, 1.0, map) - map).length() < 1e-12);
    assert!((perturb(n, t, -1.0, map) - vec3(0.0, -0.6, 0.8)).length() < 1e-12);
    assert_eq!(perturb(n, Vec3::zero(), 1.0, vec3(0.0, 0.0, -1.0)), Vec3::zero());
}

#[test]
fn every_normal_ends_on_the_side_of_the_viewer() {
    let mut random = Uniform::new(15);
    for _ in 0..1000 {
        let (n, geometric, wo) = (unit(&mut random), unit(&mut random), unit(&mut random));
        let faced = face_viewer(n, geometric, wo);
        assert!((faced.length() - 1.0).abs() < 1e-9 && faced.dot(wo) > 1e-4, "{faced:?}");
        let same_side = if geometric.dot(wo) < 0.0 { -n } else { n };
        if same_side.dot(wo) > 0.05 {
            assert_eq!(faced, same_side);
        }
    }
    assert!((face_viewer(-Z, Z, Z) - Z).length() < 1e-9, "a normal straight away from the viewer");
}
