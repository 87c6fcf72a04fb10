//! Known values, agreement between the variants, reciprocity.

use super::catalogue::{EXTENDED, all, extended, v};
use crate::Surface;
use crate::bsdf::{
    Bsdf, Energy, GltfBsdf, GltfParameters, MetallicRoughness, Scatter, TwoSided, fresnel_average,
    fresnel_conductor, fresnel_dielectric,
};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3, vec3};

/// A random direction of the sphere.
fn direction(random: &mut Uniform) -> Vec3<f64> {
    loop {
        let d = vec3(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        if d.length() < 1.0 && d.z.abs() > 1e-3 {
            return d.normalize_or_zero();
        }
    }
}

fn up(d: Vec3<f64>) -> Vec3<f64> {
    vec3(d.x, d.y, d.z.abs())
}

#[test]
fn only_what_has_lobes_depends_on_their_number() {
    let mut random = Uniform::new(46);
    let mut chose = 0;
    for case in all::<f64>() {
        let differs = (0..64).any(|_| {
            let (wo, u) = (up(direction(&mut random)), [random.range(0.0, 1.0), random.range(0.0, 1.0)]);
            case.bsdf.sample(wo, 0.01, u) != case.bsdf.sample(wo, 0.99, u)
        });
        assert!(!differs || case.bsdf.has_lobes(), "{}", case.name);
        chose += usize::from(differs);
    }
    assert!(chose > 20, "{chose} choose among lobes");
}

#[test]
fn fresnel_has_its_known_values() {
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
    near(fresnel_dielectric(1.0, 1.5), 0.04);
    near(fresnel_dielectric(1.0, 1.0 / 1.5), 0.04);
    near(fresnel_dielectric(0.0, 1.5), 1.0);
    near(fresnel_dielectric(0.4, 1.0), 0.0);
    // Brewster's angle: the parallel part vanishes, the other one is ((n^2 - 1) / (n^2 + 1))^2.
    let n = 1.5_f64;
    near(fresnel_dielectric(1.0 / (1.0 + n * n).sqrt(), n), 0.5 * ((n * n - 1.0) / (n * n + 1.0)).powi(2));
    // Both sides of one refracted ray.
    let inside = (1.0 - (1.0 - 0.25) / (n * n)).sqrt();
    near(fresnel_dielectric(0.5, n), fresnel_dielectric(inside, 1.0 / n));
    // The two averages are bound by reciprocity; the outer one is known for n = 1.5.
    near(1.0 - fresnel_average(1.0 / n), (1.0 - fresnel_average(n)) / (n * n));
    assert!((fresnel_average(1.5_f64) - 0.091_8).abs() < 2e-4, "{}", fresnel_average(1.5_f64));
    let (eta, k) = (vec3(0.2, 0.92, 1.5), vec3(3.91, 2.45, 0.0));
    let f = fresnel_conductor(1.0, eta, k);
    near(f.x, ((0.2 - 1.0_f64).powi(2) + 3.91 * 3.91) / ((0.2 + 1.0_f64).powi(2) + 3.91 * 3.91));
    for c in [1.0, 0.6, 0.2, 0.01] {
        let z = fresnel_conductor(c, eta, k).z;
        assert!((z - fresnel_dielectric(c, 1.5)).abs() < 1e-9, "without extinction it is a dielectric");
    }
    near(fresnel_conductor(0.0, eta, k).y, 1.0);
}

#[test]
fn layers_that_are_off_change_nothing() {
    let mut random = Uniform::new(4);
    for energy in [Energy::Single, Energy::Compensated] {
        for roughness in [0.0, 0.02, 0.05, 0.4, 1.0] {
            let p = GltfParameters {
                base_color: v(0.7, 0.5, 0.2),
                metallic: 0.3,
                roughness,
                energy,
                ..GltfParameters::default()
            };
            let Bsdf::MetallicRoughness(plain) = p.bsdf() else { panic!("nothing is used") };
            let layered = GltfBsdf::new(&p);
            for _ in 0..200 {
                let (wo, wi) = (up(direction(&mut random)), up(direction(&mut random)));
                let (a, b) = (plain.eval_pdf(wo, wi), layered.eval_pdf(wo, wi));
                assert!((a.0 - b.0).length() < 1e-12 * (1.0 + a.0.length()), "{a:?} {b:?}");
                assert!((a.1 - b.1).abs() < 1e-12 * (1.0 + a.1), "{a:?} {b:?}");
            }
        }
    }
    // A factor of zero is off, whatever else is set.
    for kind in EXTENDED {
        let p = GltfParameters::<f64> {
            clearcoat: 0.0,
            transmission: 0.0,
            sheen_color: Vec3::zero(),
            anisotropy: 0.0,
            ..extended(kind, 0.5)
        };
        assert!(matches!(p.bsdf(), Bsdf::MetallicRoughness(_)), "{kind}");
    }
}

#[test]
fn anisotropic_highlights_are_long_along_their_direction() {
    let p = GltfParameters {
        roughness: 0.3,
        anisotropy: 0.8,
        anisotropy_direction: [0.6, 0.8],
        ..GltfParameters::<f64>::default()
    };
    let bsdf = p.bsdf();
    let wo = vec3(0.0, 0.0, 1.0);
    let at = |x: f64, y: f64| bsdf.eval(wo, vec3(0.4 * x, 0.4 * y, (1.0_f64 - 0.16).sqrt())).x;
    assert!(at(0.6, 0.8) > 5.0 * at(-0.8, 0.6), "{} {}", at(0.6, 0.8), at(-0.8, 0.6));
}

#[test]
fn scattering_is_reciprocal() {
    // A coat with a normal of its own is not: its cosines are not those of the surface.
    let cases: Vec<_> = all::<f64>().into_iter().filter(|c| !c.name.contains("bent")).collect();
    let mut random = Uniform::new(5);
    let mut compared = 0;
    for i in 0..10_000 * 4 {
        let case = &cases[i % cases.len()];
        let (mut wo, mut wi) = (direction(&mut random), direction(&mut random));
        if !case.both_sides {
            (wo, wi) = (up(wo), up(wi));
        }
        let (there, back) = (case.bsdf.eval(wo, wi), case.bsdf.eval(wi, wo));
        let (mut there, mut back) = (there / wi.z.abs(), back / wo.z.abs());
        if wo.z * wi.z < 0.0
            && let Some(ior) = case.ior
        {
            // Radiance: n_i^2 f(wo, wi) = n_o^2 f(wi, wo); importance the other way round.
            let square = |z: f64| if z < 0.0 { ior * ior } else { 1.0 };
            let radiance = !case.name.contains("Importance");
            let (a, b) = if radiance { (square(wi.z), square(wo.z)) } else { (square(wo.z), square(wi.z)) };
            (there, back) = (there * a, back * b);
        }
        let scale = there.length().max(back.length());
        if scale < 1e-12 {
            continue;
        }
        assert!((there - back).length() <= 1e-4 * scale, "{}: {wo:?} {wi:?} {there:?} {back:?}", case.name);
        compared += 1;
    }
    assert!(compared > 10_000, "{compared} pairs scatter");
}

#[test]
fn two_sided_materials_look_the_same_from_below() {
    let surface = Surface { base_color: v(0.5, 0.4, 0.3), roughness: 0.4, metallic: 0.2, gamma: 0.0 };
    let bsdf = TwoSided(MetallicRoughness::new(&surface, Energy::Single));
    let (wo, wi) = (v(0.6, 0.0, 0.8), v(-0.48, 0.6, 0.64));
    let below = |d: Vec3<f64>| vec3(d.x, d.y, -d.z);
    assert_eq!(bsdf.eval_pdf(wo, wi), bsdf.eval_pdf(below(wo), below(wi)));
    assert_eq!(bsdf.eval(wo, below(wi)), Vec3::zero());
    let (a, b) =
        (bsdf.sample(wo, 0.9, [0.2, 0.6]).unwrap(), bsdf.sample(below(wo), 0.9, [0.2, 0.6]).unwrap());
    assert_eq!((a.wi, a.weight), (below(b.wi), b.weight));
}

#[test]
fn kinds_are_told() {
    for case in all::<f64>() {
        // From both sides, as `is_delta` and `transmits` say it for all directions.
        let mut random = Uniform::new(6);
        let (mut delta, mut passed) = (true, false);
        for _ in 0..400 {
            let wo = direction(&mut random);
            let wo = if case.both_sides { wo } else { up(wo) };
            let (lobe, a, b) = (random.range(0.0, 1.0), random.range(0.0, 1.0), random.range(0.0, 1.0));
            if let Some(s) = case.bsdf.sample(wo, lobe, [a, b]) {
                delta &= s.delta;
                passed |= s.wi.z * wo.z < 0.0;
            }
        }
        assert_eq!((delta, passed), (case.bsdf.is_delta(), case.bsdf.transmits()), "{}", case.name);
    }
}

#[test]
fn what_scatters_is_sampled() {
    let mut random = Uniform::new(8);
    let cases = all::<f64>();
    for i in 0..60_000 {
        let case = &cases[i % cases.len()];
        let (wo, wi) = (direction(&mut random), direction(&mut random));
        let (value, pdf) = case.bsdf.eval_pdf(wo, wi);
        let weight = value.x.max(value.y).max(value.z) / pdf;
        assert!(value == Vec3::zero() || pdf > 0.0 && weight < 1e4, "{} {wo:?} {wi:?}: {weight}", case.name);
    }
}
