//! Adjoints of scattering functions in double precision against central differences.

use super::catalogue::{EXTENDED, extended};
use crate::bsdf::{
    Bsdf, BsdfGradient, Conductor, Diffuse, Distribution, Energy, GltfGradient, GltfParameters, Masking,
    MetallicRoughness, Microfacet, RoughConductor, Scatter,
};
use crate::tests::{at, at_cosine, join, material, unflatten, vector};
use crate::{ROUGHNESS_MIN, Surface};
use photofit_gradcheck::{Uniform, check, max_relative_error};
use photofit_scalar::{Vec3, vec3};

const UP: Vec3<f64> = vec3(0.0, 0.0, 1.0);

/// A pair of directions: anywhere, near grazing, or within the lobe of a roughness about the mirror direction.
fn pair(random: &mut Uniform, kind: usize, roughness: f64) -> (Vec3<f64>, Vec3<f64>) {
    let mut cosine = || match kind {
        1 => 10_f64.powf(random.range(-3.0, -1.0)),
        _ => random.range(0.1, 1.0),
    };
    let (a, b) = (cosine(), cosine());
    let (wo, wi) = (at_cosine(random, UP, a), at_cosine(random, UP, b));
    if kind == 2 {
        let half = (UP + vector(random) * (roughness * roughness)).normalize_or_zero();
        (wo, half * (2.0 * half.dot(wo)) - wo)
    } else {
        (wo, wi)
    }
}

/// A value as a function of the normal, tilted by two slopes.
fn tilted(wo: Vec3<f64>, wi: Vec3<f64>, slopes: &[f64], value: impl Fn(Vec3<f64>, Vec3<f64>) -> f64) -> f64 {
    let n = vec3(slopes[0], slopes[1], 1.0).normalize_or_zero();
    let (s, t) = n.orthonormal_pair();
    let local = |d: Vec3<f64>| vec3(s.dot(d), t.dot(d), n.dot(d));
    value(local(wo), local(wi))
}

#[test]
fn lambertian_reflection() {
    let mut random = Uniform::new(61);
    for k in 0..60 {
        let (wo, wi) = pair(&mut random, k % 2, 1.0);
        let (reflectance, seed) = (vector(&mut random), vector(&mut random));
        let Some(BsdfGradient::Diffuse(d)) = Bsdf::Diffuse(Diffuse { reflectance }).eval_vjp(wo, wi, seed)
        else {
            panic!("Lambertian reflection has a gradient");
        };
        let x = join(vec![0.0, 0.0], &[reflectance]);
        let gradient = join(vec![d.n.x, d.n.y], &[d.reflectance]);
        check(&format!("diffuse {k}"), &x, &gradient, 1e-7, 1e-6, |x| {
            tilted(wo, wi, x, |wo, wi| Diffuse { reflectance: at(x, 2) }.eval(wo, wi).dot(seed))
        });
    }
}

#[test]
fn rough_metal_by_alpha_and_reflectance() {
    let mut random = Uniform::new(64);
    for k in 0..240 {
        let (distribution, masking) = (
            [Distribution::Ggx, Distribution::Beckmann][k % 2],
            [Masking::Correlated, Masking::Separable][k / 2 % 2],
        );
        let (x, y) = (random.range(0.1, 0.8), random.range(0.1, 0.8));
        let (wo, wi) = pair(&mut random, if k % 3 == 0 { 2 } else { 0 }, 0.5);
        if wi.z < 0.05 || wo.z < 0.05 {
            continue;
        }
        let [eta, extinction, reflectance] = [0, 1, 2].map(|_| vector(&mut random).map(|v| 0.2 + v.abs()));
        let seed = vector(&mut random);
        let bsdf = |x: &[f64]| {
            let metal = Conductor { eta, k: extinction, reflectance: at(x, 2) };
            let surface = Microfacet { distribution, masking, alpha_x: x[0], alpha_y: x[1] };
            Bsdf::RoughConductor(RoughConductor { metal, surface })
        };
        let x = join(vec![x, y], &[reflectance]);
        let Some(BsdfGradient::RoughConductor(d)) = bsdf(&x).eval_vjp(wo, wi, seed) else {
            panic!("a rough metal has a gradient");
        };
        let gradient = join(d.alpha.to_vec(), &[d.reflectance]);
        // By the value, here with a further factor of a half.
        let Bsdf::RoughConductor(metal) = bsdf(&x) else { panic!("a rough metal") };
        let by_value = metal.eval_vjp_of(wo, wi, seed * 2.0, metal.eval(wo, wi) * 0.5);
        for (a, b) in gradient.iter().zip(join(by_value.alpha.to_vec(), &[by_value.reflectance])) {
            assert!((a - b).abs() < 1e-12 * (1.0 + a.abs()), "{k}: {a} and {b}");
        }
        // The masking of Beckmann's distribution is approximated to 2e-7.
        let tolerance = if distribution == Distribution::Ggx { 1e-6 } else { 1e-4 };
        check(&format!("metal {k}"), &x, &gradient, 1e-6, tolerance, |x| bsdf(x).eval(wo, wi).dot(seed));
    }
}

#[test]
fn metallic_roughness_by_material_and_normal() {
    let mut random = Uniform::new(62);
    for (k, energy) in (0..240).flat_map(|k| [(k, Energy::Single), (k, Energy::Compensated)]) {
        let roughness = match k % 4 {
            0 => random.range(ROUGHNESS_MIN + 1e-3, 0.1),
            _ => random.range(0.1, 1.0),
        };
        let (wo, wi) = pair(&mut random, if k % 4 == 0 { 2 } else { k % 3 }, roughness);
        if wi.z < 1e-3 {
            continue;
        }
        let surface = material(&mut random, roughness);
        let seed = vector(&mut random);
        let bsdf = Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, energy));
        let Some(BsdfGradient::MetallicRoughness(d)) = bsdf.eval_vjp(wo, wi, seed) else {
            panic!("the model has a gradient");
        };
        let s = surface.lobes_vjp(&d.lobes);
        let x = join(crate::tests::flatten(&surface), &[Vec3::zero()]);
        let gradient = join(crate::tests::flatten(&s), &[vec3(d.n.x, d.n.y, 0.0)]);
        // Small beside the narrowest feature: the lobe, or the grazing cosine.
        let h = 1e-4 * (roughness * roughness).min(wo.z).min(wi.z).min(1e-2);
        check(&format!("metallic-roughness {k} {energy:?}"), &x, &gradient, h, 2e-5, |x| {
            let bsdf = MetallicRoughness::new(&unflatten(x), energy);
            tilted(wo, wi, &x[6..8], |wo, wi| bsdf.eval(wo, wi).dot(seed))
        });
    }
}

/// The parameters of the base as numbers.
fn flatten(p: &GltfParameters<f64>) -> Vec<f64> {
    vec![p.base_color.x, p.base_color.y, p.base_color.z, p.metallic, p.roughness]
}

#[test]
fn the_base_of_layered_materials() {
    let mut random = Uniform::new(63);
    let (mut missing, mut skipped) = (0, 0);
    for kind in EXTENDED {
        for (k, energy) in (0..30).flat_map(|k| [(k, Energy::Single), (k, Energy::Compensated)]) {
            let metallic = if k % 2 == 0 { random.range(0.0, 1.0) } else { 0.2 };
            let roughness = random.range(0.06, 1.0);
            let p = GltfParameters { energy, metallic, ..extended(kind, roughness) };
            let (wo, wi) = pair(&mut random, k % 3, roughness);
            let seed = vector(&mut random);
            let Some(d) = p.eval_vjp(wo, wi, seed) else {
                missing += 1;
                continue;
            };
            // White sheen may leave nothing at grazing angles.
            if wi.z < 1e-3 || d == GltfGradient::default() {
                skipped += 1;
                continue;
            }
            let gradient = [d.base_color.x, d.base_color.y, d.base_color.z, d.metallic, d.roughness];
            let h = 1e-4 * (roughness * roughness).min(1e-2);
            check(&format!("{kind} {k} {energy:?}"), &flatten(&p), &gradient, h, 2e-5, |x| {
                let q = GltfParameters { base_color: at(x, 0), metallic: x[3], roughness: x[4], ..p };
                q.bsdf().eval(wo, wi).dot(seed)
            });
        }
    }
    assert!(skipped < 60, "{skipped} checks are empty");
    let without = ["anisotropy", "thin", "volume", "air", "everything"];
    assert_eq!(missing, 60 * without.len(), "what transmits or is anisotropic has none");
}

#[test]
fn a_wrong_gradient_is_noticed() {
    let mut random = Uniform::new(64);
    let surface = material(&mut random, 0.4);
    let (wo, wi) = pair(&mut random, 0, 0.4);
    let seed = vector(&mut random);
    let d = MetallicRoughness::new(&surface, Energy::Compensated).eval_vjp(wo, wi, seed);
    let right = surface.lobes_vjp(&d.lobes);
    let f = |x: &[f64]| MetallicRoughness::new(&unflatten(x), Energy::Compensated).eval(wo, wi).dot(seed);
    let error = |s: &Surface<f64>| {
        max_relative_error(&crate::tests::flatten(&surface), &crate::tests::flatten(s), 1e-6, f)
    };
    let wrong = Surface { base_color: right.base_color * 1.002, ..right };
    assert!(error(&right) < 1e-5 && error(&wrong) > 1e-4, "{} {}", error(&right), error(&wrong));
}
