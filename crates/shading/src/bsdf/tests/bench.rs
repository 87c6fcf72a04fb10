//! Time per evaluation and sample: `cargo test --release -p photofit-shading -- --ignored --nocapture bsdf_bench`.

use super::catalogue::{EXTENDED, extended};
use crate::bsdf::{Bsdf, Energy, GltfBsdf, GltfParameters, Scatter};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3, Vec3f, vec3};
use std::hint::black_box;
use std::time::Instant;

/// Best time of several runs in nanoseconds per call: evaluation with density, and sampling.
fn time(bsdf: &impl Scatter<f32>, points: &[(Vec3f, Vec3f, f32)]) -> [f64; 2] {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..9 {
        let mut runs = [0.0; 2];
        let start = Instant::now();
        let mut sum = Vec3::zero();
        for (wo, wi, _) in points {
            let (value, pdf) = black_box(bsdf).eval_pdf(*wo, *wi);
            sum += value * pdf;
        }
        black_box(sum);
        runs[0] = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let mut sum = Vec3::zero();
        for (wo, wi, lobe) in points {
            if let Some(s) = black_box(bsdf).sample(*wo, *lobe, [wi.z, wi.x.abs()]) {
                sum += s.weight;
            }
        }
        black_box(sum);
        runs[1] = start.elapsed().as_secs_f64();
        for k in 0..2 {
            best[k] = f64::min(best[k], runs[k] * 1e9 / points.len() as f64);
        }
    }
    best
}

#[test]
#[ignore = "measures time"]
fn bsdf_bench() {
    let mut random = Uniform::new(3);
    let mut direction = || {
        let (z, phi) = (random.range(0.05, 1.0), random.range(0.0, std::f64::consts::TAU));
        let r = (1.0 - z * z).sqrt();
        vec3(r * phi.cos(), r * phi.sin(), z).cast::<f32>()
    };
    let points: Vec<_> = (0..20_000).map(|i| (direction(), direction(), (i % 97) as f32 / 97.0)).collect();
    let show = |name: &str, t: [f64; 2]| println!("{name:<34} eval {:6.1} ns, sample {:6.1} ns", t[0], t[1]);
    for energy in [Energy::Single, Energy::Compensated] {
        let p = GltfParameters {
            base_color: vec3(0.8_f32, 0.5, 0.2),
            metallic: 0.2,
            roughness: 0.4,
            energy,
            ..GltfParameters::default()
        };
        let Bsdf::MetallicRoughness(plain) = p.bsdf() else { panic!("nothing is used") };
        show(&format!("plain {energy:?}"), time(&plain, &points));
        show(&format!("layered, nothing used {energy:?}"), time(&GltfBsdf::new(&p), &points));
        for kind in EXTENDED {
            let p = GltfParameters { energy, ..extended::<f32>(kind, 0.4) };
            show(&format!("{kind} {energy:?}"), time(&GltfBsdf::new(&p), &points));
        }
    }
}
