//! The principled model: values of an independent implementation, and sampling against density.

use super::catalogue::v;
use crate::bsdf::{Principled, PrincipledParameters, Scatter};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3, vec3};
use std::f64::consts::PI;

fn cases() -> [PrincipledParameters<f64>; 4] {
    let eta = |specular: f64| 2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0;
    let none = PrincipledParameters {
        base_color: v(0.5, 0.5, 0.5),
        roughness: 0.5,
        anisotropic: 0.0,
        metallic: 0.0,
        spec_trans: 0.0,
        spec_tint: 0.0,
        sheen: 0.0,
        sheen_tint: 0.0,
        flatness: 0.0,
        clearcoat: 0.0,
        clearcoat_gloss: 0.0,
        eta: eta(0.5),
    };
    [
        PrincipledParameters { base_color: v(0.7, 0.25, 0.1), roughness: 0.35, metallic: 0.1, ..none },
        PrincipledParameters {
            base_color: v(0.2, 0.5, 0.9),
            roughness: 0.6,
            metallic: 0.4,
            spec_tint: 0.5,
            sheen: 0.7,
            sheen_tint: 0.3,
            anisotropic: 0.6,
            eta: eta(0.8),
            ..none
        },
        PrincipledParameters {
            base_color: v(0.8, 0.75, 0.7),
            roughness: 0.2,
            metallic: 1.0,
            clearcoat: 0.9,
            clearcoat_gloss: 0.2,
            ..none
        },
        PrincipledParameters {
            base_color: v(0.3, 0.6, 0.2),
            roughness: 0.8,
            flatness: 0.6,
            clearcoat: 0.5,
            clearcoat_gloss: 0.8,
            eta: 1.3,
            ..none
        },
    ]
}

#[test]
fn values_are_those_of_mitsuba() {
    // `eval` of Mitsuba 3.9.1 (scalar_rgb) for three pairs of directions.
    let pairs = [
        ([0.3, 0.2, 0.9], [-0.4, 0.1, 0.8]),
        ([0.8, -0.1, 0.3], [-0.7, 0.2, 0.35]),
        ([0.1, 0.9, 0.2], [0.5, -0.3, 0.6]),
    ];
    let expected = [
        [
            [0.234_563, 0.096_152_5, 0.050_015_8],
            [0.354_482, 0.243_613, 0.206_657],
            [0.137_827, 0.049_868_9, 0.020_549_4],
        ],
        [
            [0.065_704_1, 0.155_694, 0.275_681],
            [0.120_225, 0.207_387, 0.323_604],
            [0.038_232_8, 0.090_735_1, 0.160_738],
        ],
        [
            [0.095_321_3, 0.090_123_3, 0.084_925_3],
            [0.255_034, 0.241_499, 0.227_964],
            [0.002_564_43, 0.002_448_52, 0.002_332_61],
        ],
        [
            [0.077_283_7, 0.146_271, 0.054_288],
            [0.081_541_5, 0.133_482, 0.064_227_8],
            [0.082_381_7, 0.160_737, 0.056_263_4],
        ],
    ];
    for (p, expected) in cases().iter().zip(expected) {
        for ((wo, wi), wanted) in pairs.into_iter().zip(expected) {
            let unit = |d: [f64; 3]| Vec3::from_array(d).normalize_or_zero();
            let found = Principled::new(p).eval(unit(wo), unit(wi));
            for (a, b) in found.to_array().into_iter().zip(wanted) {
                assert!((a - b).abs() < 2e-3 * b + 1e-6, "{p:?} {wo:?}: {found:?} {wanted:?}");
            }
        }
    }
}

#[test]
fn samples_have_their_density_and_weight() {
    for p in &cases() {
        let bsdf = Principled::new(p);
        for wo in [v(0.1, 0.2, 0.95), v(-0.6, 0.5, 0.25)].map(Vec3::normalize_or_zero) {
            // Moments of the density by the midpoint rule, and by samples.
            let moments = |d: Vec3<f64>| [1.0, d.z, d.x * d.x, d.x * d.y + d.z * d.z * d.z];
            let (steps, mut integral) = (1500, [0.0; 4]);
            for i in 0..steps {
                let z = (f64::from(i) + 0.5) / f64::from(steps);
                let r = (1.0 - z * z).sqrt();
                for j in 0..steps {
                    let (sin, cos) = (2.0 * PI * (f64::from(j) + 0.5) / f64::from(steps)).sin_cos();
                    let d = vec3(r * cos, r * sin, z);
                    let weight = bsdf.pdf(wo, d) * 2.0 * PI / (f64::from(steps) * f64::from(steps));
                    integral.iter_mut().zip(moments(d)).for_each(|(s, m)| *s += weight * m);
                }
            }
            let (n, mut sum, mut squares) = (200_000, [0.0; 4], [0.0; 4]);
            let mut rng = Rng::new(7, 0);
            for _ in 0..n {
                let (lobe, a, b) = (rng.next_f64(), rng.next_f64(), rng.next_f64());
                let Some(s) = bsdf.sample(wo, lobe, [a, b]) else { continue };
                let (value, pdf) = bsdf.eval_pdf(wo, s.wi);
                assert!((s.weight * pdf - value).length() < 1e-9 * (1.0 + value.length()) && pdf == s.pdf);
                for (k, m) in moments(s.wi).into_iter().enumerate() {
                    sum[k] += m;
                    squares[k] += m * m;
                }
            }
            for k in 0..4 {
                let mean = sum[k] / f64::from(n);
                let sigma = ((squares[k] / f64::from(n) - mean * mean).max(1e-6) / f64::from(n)).sqrt();
                let error = (mean - integral[k]).abs();
                assert!(error < 4.5 * sigma + 2e-3, "{p:?} {wo:?} {k}: {mean} {}", integral[k]);
            }
        }
    }
}
