//! Extreme directions and random numbers in `f32`: every result stays a number in its range.

use super::catalogue::all;
use crate::bsdf::Bsdf;
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3, Vec3f, vec3};

const NEARLY_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

fn directions() -> Vec<Vec3f> {
    let mut out = Vec::new();
    for z in [1.0, 0.999_999, 0.7, 0.1, 1e-3, 1e-5, 1e-8, 0.0_f32] {
        for phi in [0.0_f32, 0.9, 3.0] {
            let r = (1.0 - z * z).max(0.0).sqrt();
            out.push(vec3(r * phi.cos(), r * phi.sin(), z));
            out.push(vec3(r * phi.cos(), r * phi.sin(), -z));
        }
    }
    out
}

fn check(name: &str, bsdf: &Bsdf<f32>, wo: Vec3f, lobe: f32, u: [f32; 2]) {
    let Some(s) = bsdf.sample(wo, lobe, u) else { return };
    let place = || format!("{name} from {wo:?} with {lobe} {u:?}: {s:?}");
    assert!((s.wi.length() - 1.0).abs() < 1e-3 && s.wi.is_finite(), "{}", place());
    assert!(s.weight.is_finite() && s.weight.to_array().into_iter().all(|w| w >= 0.0), "{}", place());
    assert!(s.pdf > 0.0 && s.pdf.is_finite() && s.eta > 0.0, "{}", place());
    assert!(!s.delta || s.pdf == 1.0, "{}", place());
}

#[test]
fn everything_stays_a_number() {
    let mut random = Uniform::new(9);
    let directions = directions();
    let corners = [0.0, 0.5, NEARLY_ONE];
    for case in all::<f32>() {
        for &wo in &directions {
            for lobe in corners {
                for a in corners {
                    for b in corners {
                        check(&case.name, &case.bsdf, wo, lobe, [a, b]);
                    }
                }
            }
            for _ in 0..4 {
                let mut number = || (random.range(0.0, 1.0) as f32).min(NEARLY_ONE);
                check(&case.name, &case.bsdf, wo, number(), [number(), number()]);
            }
            for &wi in directions.iter().step_by(3) {
                let (value, pdf) = case.bsdf.eval_pdf(wo, wi);
                let right = value.is_finite() && value.to_array().into_iter().all(|x| x >= 0.0) && pdf >= 0.0;
                assert!(right && pdf.is_finite(), "{} {wo:?} {wi:?}: {value:?} {pdf}", case.name);
            }
            let albedo = case.bsdf.albedo(wo);
            assert!(albedo.is_finite() && albedo.to_array().into_iter().all(|x| x >= 0.0), "{}", case.name);
        }
    }
}

#[test]
fn samples_of_random_directions_have_bounded_weights() {
    // Wide lobes: what is chosen with its probability weighs no more than a few.
    let mut random = Uniform::new(10);
    for case in all::<f32>() {
        let mut largest = 0.0_f32;
        for _ in 0..300 {
            let mut wo = loop {
                let d: Vec3<f64> =
                    vec3(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(0.01, 1.0));
                if d.length() < 1.0 {
                    break d.normalize_or_zero().cast::<f32>();
                }
            };
            if case.both_sides && random.range(0.0, 1.0) < 0.5 {
                wo.z = -wo.z;
            }
            let mut number = || (random.range(0.0, 1.0) as f32).min(NEARLY_ONE);
            if let Some(s) = case.bsdf.sample(wo, number(), [number(), number()]) {
                // Without the factor of radiance at refraction.
                let scale = if s.eta == 1.0 { 1.0 } else { (s.eta * s.eta).min(1.0) };
                largest = largest.max(s.weight.x.max(s.weight.y).max(s.weight.z) * scale);
            }
        }
        assert!(largest < 20.0, "{}: {largest}", case.name);
    }
}

#[test]
fn samples_that_pass_tell_the_index_of_refraction_of_the_surface() {
    let mut random = Uniform::new(11);
    let mut refracting = 0;
    for case in all::<f32>() {
        for wo in directions() {
            for _ in 0..20 {
                let mut number = || (random.range(0.0, 1.0) as f32).min(NEARLY_ONE);
                let Some(s) = case.bsdf.sample(wo, number(), [number(), number()]) else { continue };
                let passes = s.wi.z * wo.z < 0.0;
                let expected = if passes { case.bsdf.eta(wo) } else { 1.0 };
                assert_eq!(s.eta, expected, "{} from {wo:?} to {:?}", case.name, s.wi);
                refracting += usize::from(s.eta != 1.0);
            }
        }
    }
    assert!(refracting > 100, "{refracting}");
}
