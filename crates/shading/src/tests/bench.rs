//! Time per evaluation: `cargo test --release -p photofit-shading -- --ignored --nocapture bench`.

use super::{at_cosine, material, unit, vector};
use crate::{Energy, Environment, Light, Surface, Yaw, eval, eval_vjp, shade, shade_vjp};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3, Vec3f, vec3};
use std::hint::black_box;
use std::time::Instant;

type Point = (Surface, Vec3f, Vec3f, Vec3f, Vec3f);

/// Best time of several runs in nanoseconds per point.
fn time(name: &str, points: &[Point], mut f: impl FnMut(&Point) -> Vec3f) {
    let mut best = f64::INFINITY;
    for _ in 0..7 {
        let start = Instant::now();
        let mut sum = Vec3::zero();
        for p in points {
            sum += f(p);
        }
        black_box(sum);
        best = best.min(start.elapsed().as_secs_f64() * 1e9 / points.len() as f64);
    }
    println!("{name:<32} {best:7.1} ns");
}

#[test]
#[ignore = "measures time"]
fn bench() {
    let mut random = Uniform::new(41);
    let points: Vec<Point> = (0..20_000)
        .map(|_| {
            let roughness = random.range(0.05, 1.0);
            let s = material(&mut random, roughness);
            let n = unit(&mut random);
            let (a, b) = (random.range(0.05, 1.0), random.range(0.05, 1.0));
            let (wo, wi) = (at_cosine(&mut random, n, a), at_cosine(&mut random, n, b));
            (s.cast(), n.cast(), wo.cast(), wi.cast(), vector(&mut random).cast())
        })
        .collect();
    let all = |d: crate::EvalGradient| {
        d.surface.base_color
            + d.n
            + d.wo
            + d.wi
            + vec3(d.surface.roughness, d.surface.metallic, d.surface.gamma)
    };
    let sum = |d: crate::ShadeGradient| {
        d.surface.base_color
            + d.n
            + d.wo
            + d.position
            + vec3(d.surface.roughness, d.surface.metallic, d.surface.gamma)
    };
    time("eval", &points, |p| eval(&p.0, Energy::Single, p.1, p.2, p.3));
    time("eval_vjp", &points, |p| all(eval_vjp(&p.0, Energy::Single, p.1, p.2, p.3, p.4)));

    let (w, h) = (1024, 512);
    let rgb: Vec<f32> = (0..w * h * 3).map(|i| ((i * 7919) % 1000) as f32 * 1e-3).collect();
    let start = Instant::now();
    let map = Environment::from_equirectangular(w, h, &rgb).unwrap();
    println!("prefilter of {w}x{h}: {:.3} s", start.elapsed().as_secs_f64());
    for count in [1, 4] {
        let lights: Vec<Light<'_>> = (0..count)
            .map(|k| Light::Directional {
                direction: vec3(0.1 * k as f32, 1.0, 0.2).normalize_or_zero(),
                irradiance: vec3(1.0, 0.9, 0.8),
            })
            .collect();
        // Normals towards the light, so that every light is evaluated.
        time(&format!("shade, {count} directional"), &points, |p| {
            shade(&p.0, Energy::Single, p.4, vec3(0.0, 1.0, 0.0), p.3, black_box(&lights))
        });
        time(&format!("shade_vjp, {count} directional"), &points, |p| {
            sum(shade_vjp(&p.0, Energy::Single, p.4, vec3(0.0, 1.0, 0.0), p.3, black_box(&lights), p.2))
        });
    }
    let point = [Light::Point { position: vec3(0.0, 3.0, 0.0), intensity: vec3(1.0, 2.0, 3.0) }];
    let ambient = [Light::Ambient { radiance: vec3(1.0, 2.0, 3.0) }];
    let environment = [Light::Environment { map: &map, rotation: Yaw::new(0.3), scale: 1.0 }];
    for (name, lights) in [("point", &point), ("ambient", &ambient), ("environment", &environment)] {
        time(&format!("shade, {name}"), &points, |p| {
            shade(&p.0, Energy::Single, p.4, p.1, p.2, black_box(lights))
        });
        time(&format!("shade_vjp, {name}"), &points, |p| {
            sum(shade_vjp(&p.0, Energy::Single, p.4, p.1, p.2, black_box(lights), p.3))
        });
    }
}
