//! Lights: gradients, and ambient and environment light against brute-force integration.

use super::{at, at_cosine, flatten, join, material, unflatten, unit, vector};
use crate::{
    Beam, Energy, Environment, Light, ROUGHNESS_MIN, ShadeGradient, Surface, Yaw, eval, shade, shade_ambient,
    shade_ambient_vjp, shade_beam, shade_beam_vjp, shade_vjp, split_sum, view_direction, view_direction_vjp,
};
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::{Real, Vec3, vec3};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

const WIDTH: usize = 256;
const HEIGHT: usize = 128;

/// A sky with a horizon, a soft window and a small sun of 500 times the sky's radiance.
static SKY: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let mut rgb = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for k in 0..WIDTH * HEIGHT {
        rgb.extend(radiance(pixel(k).0).to_array().map(|v| v as f32));
    }
    rgb
});

/// The sky's radiance.
pub(super) fn radiance(d: Vec3<f64>) -> Vec3<f64> {
    let sky = 0.5 + 0.5 * d.y;
    let window = (8.0 * (d.dot(vec3(-0.6, 0.48, 0.64)) - 1.0)).exp() * 4.0;
    let sun = (800.0 * (d.dot(vec3(0.48, 0.64, 0.6)) - 1.0)).exp() * 500.0;
    vec3(sky * 0.6 + window + sun, sky * 0.8 + sun * 0.9, sky + 0.5 * window + sun * 0.7)
}

pub(super) static MAP: LazyLock<Environment> =
    LazyLock::new(|| Environment::from_equirectangular(WIDTH, HEIGHT, &SKY).unwrap());

/// Direction and solid angle of a pixel.
fn pixel(k: usize) -> (Vec3<f64>, f64) {
    let (u, v) = (((k % WIDTH) as f64 + 0.5) / WIDTH as f64, ((k / WIDTH) as f64 + 0.5) / HEIGHT as f64);
    let (phi, theta) = ((u - 0.5) * TAU, v * PI);
    let d = vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
    (d, theta.sin() * TAU * PI / (WIDTH * HEIGHT) as f64)
}

/// Integral of a function times the sky over all directions.
fn integrate(mut f: impl FnMut(Vec3<f64>) -> Vec3<f64>) -> Vec3<f64> {
    let mut sum = Vec3::zero();
    for (k, c) in SKY.chunks(3).enumerate() {
        let (d, w) = pixel(k);
        sum += f(d).mul(vec3(c[0], c[1], c[2]).cast()) * w;
    }
    sum
}

fn check_shade(
    name: &str,
    energy: Energy,
    lights: &[Light<'_, f64>],
    random: &mut Uniform,
    h: f64,
    tolerance: f64,
) {
    let roughness = random.range(0.2, 0.95);
    let s = material(random, roughness);
    let n = unit(random);
    let cosine = random.range(0.1, 0.95);
    let wo = at_cosine(random, n, cosine);
    let x = join(flatten(&s), &[vector(random) * 0.2, n, wo]);
    let seed = vector(random);
    let f = |x: &[f64]| shade(&unflatten(x), energy, at(x, 6), at(x, 9), at(x, 12), lights).dot(seed);
    let d = shade_vjp(&s, energy, at(&x, 6), n, wo, lights, seed);
    let gradient = join(flatten(&d.surface), &[d.position, d.n, d.wo]);
    check(name, &x, &gradient, h, tolerance, f);
}

#[test]
fn gradients_of_every_light() {
    let mut random = Uniform::new(31);
    let map: Environment<f64> = MAP.cast();
    for (k, energy) in (0..60).flat_map(|k| [(k, Energy::Single), (k, Energy::Compensated)]) {
        let point = Light::Point { position: unit(&mut random) * 2.0, intensity: vector(&mut random) };
        let sun = Light::Directional { direction: unit(&mut random), irradiance: vector(&mut random) };
        let ambient = Light::Ambient { radiance: vector(&mut random) };
        let rotation = Yaw::new(random.range(0.0, TAU));
        let environment = Light::Environment { map: &map, rotation, scale: 0.7 };
        check_shade(&format!("ambient {k} {energy:?}"), energy, &[ambient], &mut random, 1e-7, 1e-5);
        check_shade(&format!("environment {k} {energy:?}"), energy, &[environment], &mut random, 1e-7, 1e-5);
        check_shade(
            &format!("mixed {k} {energy:?}"),
            energy,
            &[point, sun, ambient, environment, point],
            &mut random,
            1e-7,
            1e-5,
        );
        // A light in front of the surface in any case.
        let sure = [Light::Ambient { radiance: vec3(0.1, 0.2, 0.3) }, point, sun];
        check_shade(&format!("point and sun {k} {energy:?}"), energy, &sure, &mut random, 1e-7, 1e-5);
    }
}

/// What loops over many points add up light by light is what [`shade`] adds up, its gradient included; also where the light is
/// behind the surface, or opposite to the viewer, and for normals of length zero.
#[test]
fn one_light_at_a_time_is_what_shade_adds_up() {
    let mut random = Uniform::new(33);
    for k in 0..400 {
        let roughness = random.range(0.05, 1.0);
        let s = material(&mut random, roughness);
        let (position, seed, color) = (vector(&mut random) * 0.2, vector(&mut random), vector(&mut random));
        let n = if k % 17 == 0 { Vec3::zero() } else { unit(&mut random) };
        let wo = unit(&mut random);
        let wi = if k % 13 == 0 { -wo } else { unit(&mut random) };
        let whole = |light: Light<'_, f64>| {
            let value = shade(&s, Energy::Single, position, n, wo, &[light]);
            (value, shade_vjp(&s, Energy::Single, position, n, wo, &[light], seed))
        };
        let one = |beam: &Beam<f64>| (shade_beam(&s, n, wo, beam), shade_beam_vjp(&s, n, wo, beam, seed));
        let at = position + wi * random.range(0.5, 2.0);
        let viewer = split_sum(n.dot(wo), s.roughness);
        let ambient = (shade_ambient(&s, &viewer, color), shade_ambient_vjp(&s, &viewer, n, wo, color, seed));
        for (name, (a, g), (b, h)) in [
            (
                "sun",
                one(&Beam::of_direction(wi, color)),
                whole(Light::Directional { direction: wi, irradiance: color }),
            ),
            (
                "point",
                one(&Beam::of_point(at, color, position)),
                whole(Light::Point { position: at, intensity: color }),
            ),
            ("ambient", ambient, whole(Light::Ambient { radiance: color })),
        ] {
            let row = |v: Vec3<f64>, g: ShadeGradient<f64>| {
                // That of a direction is not one of a position.
                let position = if name == "point" { g.position } else { Vec3::zero() };
                join(flatten(&g.surface), &[v, position, g.n, g.wo])
            };
            for (a, b) in row(a, g).iter().zip(row(b, h)) {
                assert!((a - b).abs() <= 1e-11 * (1.0 + b.abs()), "{name} {k}: {a} and {b}");
            }
        }
    }
}

#[test]
fn gradients_of_directions_and_maps() {
    let mut random = Uniform::new(32);
    let map: Environment<f64> = MAP.cast();
    for k in 0..100 {
        let (eye, position, seed) = (vector(&mut random) * 3.0, vector(&mut random), vector(&mut random));
        let g = view_direction_vjp(eye, position, seed);
        check("view direction", &position.to_array(), &g.to_array(), 1e-6, 1e-6, |x| {
            view_direction(eye, at(x, 0)).dot(seed)
        });
        let d = unit(&mut random);
        let (_, g) = map.diffuse_vjp(d, |_| seed);
        check(&format!("diffuse {k}"), &d.to_array(), &g.to_array(), 1e-7, 1e-5, |x| {
            map.diffuse(at(x, 0)).dot(seed)
        });
        let r = random.range(0.01, 0.99);
        let (_, g, g_r) = map.specular_vjp(d, r, seed);
        check(&format!("specular {k}"), &[d.x, d.y, d.z, r], &[g.x, g.y, g.z, g_r], 1e-7, 1e-5, |x| {
            map.specular(at(x, 0), x[3]).dot(seed)
        });
    }
}

#[test]
fn a_point_light_falls_with_the_square_of_the_distance() {
    let s = Surface { base_color: vec3(0.5, 0.6, 0.7), roughness: 0.4, metallic: 0.2, gamma: 0.0 };
    let (n, wo) = (vec3(0.0, 1.0, 0.0), vec3(0.6, 0.8, 0.0));
    let d = vec3(0.0, 0.8, 0.6);
    let sun = Light::Directional { direction: d, irradiance: vec3(1.0, 2.0, 3.0) };
    let point = Light::Point { position: d * 3.0, intensity: vec3(9.0, 18.0, 27.0) };
    let (a, b) = (
        shade(&s, Energy::Single, Vec3::zero(), n, wo, &[sun]),
        shade(&s, Energy::Single, Vec3::zero(), n, wo, &[point]),
    );
    assert!((a - b).length() < 1e-12, "{a:?} {b:?}");
    assert!((a - eval(&s, Energy::Single, n, wo, d).mul(vec3(1.0, 2.0, 3.0))).length() < 1e-12);
    let inside = Light::Point { position: Vec3::zero(), intensity: vec3(1.0, 1.0, 1.0) };
    assert_eq!(shade(&s, Energy::Single, Vec3::zero(), n, wo, &[inside]), Vec3::zero());
}

#[test]
fn a_point_light_has_its_gradient_however_near_it_is() {
    let s = Surface { base_color: vec3(0.5, 0.6, 0.7), roughness: 0.4, metallic: 0.2, gamma: 0.0 };
    let (n, wo, seed) = (vec3(0.0, 1.0, 0.0), vec3(0.6, 0.8, 0.0), vec3(1.0, -0.4, 0.3));
    for distance in [1.0, 1e-3, 1e-5, 1e-7] {
        let at_light = vec3(0.1, 0.8, 0.6) * distance;
        let lights = [Light::Point { position: at_light, intensity: vec3(1.0, 2.0, 3.0) }];
        let f = |x: &[f64]| shade(&s, Energy::Single, at(x, 0), n, wo, &lights).dot(seed);
        let g = shade_vjp(&s, Energy::Single, Vec3::zero(), n, wo, &lights, seed).position;
        check(&format!("from {distance}"), &[0.0; 3], &g.to_array(), 1e-5 * distance, 1e-7, f);
    }
}

fn dark<T: Real>() {
    let [n, wo, wi] =
        [[0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]].map(|v| Vec3::<f64>::from_array(v).cast::<T>());
    let (seed, color, nan) = (Vec3::splat(T::one()), Vec3::splat(T::of(2.0)), Vec3::splat(T::of(f64::NAN)));
    let s = Surface { base_color: color, roughness: T::of(0.4), metallic: T::of(0.2), gamma: T::zero() };
    let none = ShadeGradient::default();
    let on_the_spot = Beam::of_point(wo, color, wo);
    let sun = Beam::of_direction(wi, color);
    for (name, n, wo, beam) in [
        ("a light on the spot", n, wo, on_the_spot),
        ("a light behind", n, wo, Beam::of_direction(-wi, color)),
        ("a normal that is none", nan, wo, sun),
        ("a direction that is none", n, wo, Beam::of_direction(nan, color)),
    ] {
        assert_eq!(shade_beam(&s, n, wo, &beam), Vec3::zero(), "{name}");
        let g = shade_beam_vjp(&s, n, wo, &beam, seed);
        assert_eq!((g.surface, g.n, g.wo), (none.surface, none.n, none.wo), "{name}");
    }
    let lamp = [Light::Point { position: wi, intensity: color }];
    for energy in [Energy::Single, Energy::Compensated] {
        assert_eq!(shade_vjp(&s, energy, wi, n, wo, &lamp, seed), none, "on the spot, {energy:?}");
        assert_eq!(shade_vjp(&s, energy, wo, nan, wo, &lamp, seed), none, "no normal, {energy:?}");
    }
    assert_eq!(shade_beam_vjp(&s, nan, wo, &Beam::of_point(wi, color, wo), seed), none);
}

#[test]
fn where_no_light_arrives_nothing_has_a_gradient() {
    dark::<f64>();
    dark::<f32>();
}

#[test]
fn ambient_light_is_the_integral_of_the_bsdf() {
    let n = vec3(0.0, 1.0, 0.0);
    for roughness in [0.3, 0.5, 0.8, 1.0] {
        for cosine in [0.1, 0.4, 0.8, 1.0_f64] {
            let s = Surface { base_color: vec3(0.9, 0.5, 0.1), roughness, metallic: 0.4, gamma: 0.1 };
            let wo = vec3((1.0 - cosine * cosine).sqrt(), cosine, 0.0);
            // Half of the azimuths, finely: lobes are narrow sideways near grazing.
            let (mut sum, cosines, azimuths) = (Vec3::zero(), 400, 600);
            for k in 0..cosines * azimuths {
                let c = ((k / azimuths) as f64 + 0.5) / cosines as f64;
                let phi = ((k % azimuths) as f64 + 0.5) / azimuths as f64 * PI;
                let wi = vec3((1.0 - c * c).sqrt() * phi.cos(), c, (1.0 - c * c).sqrt() * phi.sin());
                sum += eval(&s, Energy::Single, n, wo, wi) * (TAU / (cosines * azimuths) as f64);
            }
            let radiance = vec3(1.0, 2.0, 0.5);
            let got = shade(&s, Energy::Single, Vec3::zero(), n, wo, &[Light::Ambient { radiance }]);
            let e = (got - sum.mul(radiance)).length();
            assert!(e < 5e-3, "roughness {roughness} cosine {cosine}: {got:?} {:?}", sum.mul(radiance));
        }
    }
}

#[test]
fn diffuse_environment_agrees_with_integration() {
    let mut random = Uniform::new(33);
    let (mut worst, mut scale): (f64, f64) = (0.0, 0.0);
    for _ in 0..60 {
        let n = unit(&mut random);
        let exact = integrate(|d| Vec3::splat(d.dot(n).max(0.0) / PI));
        let got = MAP.diffuse(n.cast()).cast::<f64>();
        worst = worst.max((got - exact).length());
        scale = scale.max(exact.length());
    }
    assert!(worst < 1e-2 * scale, "error {worst:.4} of {scale:.3}");
}

#[test]
fn specular_environment_agrees_with_integration() {
    let mut random = Uniform::new(34);
    for k in 1..9 {
        let roughness = f64::from(k) / 8.0;
        let a2 = roughness.powi(4);
        let (mut error, mut scale): (f64, f64) = (0.0, 0.0);
        for _ in 0..20 {
            let n = unit(&mut random);
            let mut weight = 0.0;
            let lobe = |d: Vec3<f64>| {
                let nl = d.dot(n);
                // Density of wi for n = wo, times n.wi: D / 4.
                let nh2 = 0.5 * (1.0 + nl);
                if nl > 0.0 { nl * a2 / (nh2 * (a2 - 1.0) + 1.0).powi(2) } else { 0.0 }
            };
            let exact = integrate(|d| {
                let w = lobe(d);
                weight += w * (1.0 - d.y * d.y).sqrt() * TAU * PI / (WIDTH * HEIGHT) as f64;
                Vec3::splat(w)
            }) * (1.0 / weight);
            error += (MAP.specular(n.cast(), roughness as f32).cast() - exact).length_squared();
            scale += exact.length_squared();
        }
        let relative = (error / scale).sqrt();
        assert!(relative < if k < 4 { 0.05 } else { 0.015 }, "roughness {roughness}: {relative:.4}");
    }
}

#[test]
fn environment_shading_is_near_the_integral_of_the_bsdf() {
    let mut random = Uniform::new(35);
    for roughness in [0.25, 0.4, 0.6, 0.8, 1.0] {
        let (mut error, mut scale): (f64, f64) = (0.0, 0.0);
        for _ in 0..20 {
            let s = material(&mut random, roughness);
            let n = unit(&mut random);
            let cosine = random.range(0.2, 1.0);
            let wo = at_cosine(&mut random, n, cosine);
            let exact = integrate(|d| eval(&s, Energy::Single, n, wo, d));
            let light = Light::Environment { map: &*MAP, rotation: Yaw::default(), scale: 1.0 };
            let got =
                shade(&s.cast(), Energy::Single, Vec3::zero(), n.cast(), wo.cast(), &[light]).cast::<f64>();
            error += (got - exact).length_squared();
            scale += exact.length_squared();
        }
        let relative = (error / scale).sqrt();
        assert!(relative < 0.15, "roughness {roughness}: relative rms error {relative:.4}");
        assert!(relative > 1e-4, "an approximation cannot be this good: {relative:.2e}");
    }
}

#[test]
fn turning_the_environment_turns_the_light() {
    let mut random = Uniform::new(36);
    let (angle, map) = (1.1, &*MAP);
    let yaw = Yaw::new(angle as f32);
    for _ in 0..50 {
        let roughness = random.range(ROUGHNESS_MIN, 1.0);
        let s = material(&mut random, roughness).cast();
        let (n, wo) = (unit(&mut random).cast(), unit(&mut random).cast());
        let still = Light::Environment { map, rotation: Yaw::default(), scale: 1.0 };
        let turned = Light::Environment { map, rotation: yaw, scale: 1.0 };
        let a = shade(&s, Energy::Single, Vec3::zero(), n, wo, &[still]);
        let b = shade(&s, Energy::Single, Vec3::zero(), yaw.apply(n), yaw.apply(wo), &[turned]);
        assert!((a - b).length() < 1e-3 * a.length() + 1e-4, "{a:?} {b:?}");
    }
    let east = Yaw::new(std::f64::consts::FRAC_PI_2).apply(vec3(0.0, 0.0, -1.0));
    assert!((east - vec3(-1.0, 0.0, 0.0)).length() < 1e-12, "counterclockwise seen from above: {east:?}");
}
