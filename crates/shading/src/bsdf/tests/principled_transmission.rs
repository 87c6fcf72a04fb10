//! The principled models with transmission: values of an independent implementation, sampling against density on the
//! whole sphere, and reciprocity.

use super::catalogue::v;
use crate::bsdf::{Principled, PrincipledParameters, PrincipledThin, PrincipledThinParameters, Scatter};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3, vec3};
use std::f64::consts::PI;

fn solids() -> [PrincipledParameters<f64>; 3] {
    let glass = PrincipledParameters {
        base_color: v(0.9, 0.8, 0.6),
        roughness: 0.5,
        anisotropic: 0.0,
        metallic: 0.0,
        spec_trans: 1.0,
        spec_tint: 0.0,
        sheen: 0.0,
        sheen_tint: 0.0,
        flatness: 0.0,
        clearcoat: 0.0,
        clearcoat_gloss: 0.0,
        eta: 1.3,
    };
    [
        PrincipledParameters {
            base_color: v(0.7, 0.25, 0.1),
            roughness: 0.35,
            anisotropic: 0.5,
            metallic: 0.1,
            spec_trans: 0.8,
            spec_tint: 0.3,
            sheen: 0.4,
            sheen_tint: 0.6,
            flatness: 0.2,
            clearcoat: 0.5,
            clearcoat_gloss: 0.3,
            eta: 1.45,
        },
        glass,
        PrincipledParameters {
            roughness: 0.6,
            metallic: 0.2,
            spec_trans: 0.5,
            spec_tint: 0.2,
            sheen: 0.3,
            sheen_tint: 0.5,
            clearcoat: 0.4,
            clearcoat_gloss: 0.5,
            eta: 0.8,
            ..glass
        },
    ]
}

fn sheets() -> [PrincipledThinParameters<f64>; 3] {
    let pane = PrincipledThinParameters {
        base_color: v(0.9, 0.8, 0.6),
        roughness: 0.5,
        anisotropic: 0.0,
        spec_trans: 1.0,
        diff_trans: 0.0,
        spec_tint: 0.0,
        sheen: 0.0,
        sheen_tint: 0.0,
        flatness: 0.0,
        eta: 1.3,
    };
    [
        PrincipledThinParameters {
            base_color: v(0.7, 0.25, 0.1),
            roughness: 0.45,
            anisotropic: 0.5,
            spec_trans: 0.6,
            diff_trans: 0.4,
            spec_tint: 0.3,
            sheen: 0.4,
            sheen_tint: 0.6,
            flatness: 0.2,
            eta: 1.45,
        },
        pane,
        PrincipledThinParameters {
            base_color: v(0.3, 0.6, 0.2),
            roughness: 0.7,
            spec_trans: 0.0,
            diff_trans: 0.6,
            sheen: 0.5,
            sheen_tint: 0.2,
            flatness: 0.5,
            eta: 1.5,
            ..pane
        },
    ]
}

/// `eval` of Mitsuba 3.9.1 (`scalar_rgb`) for five pairs of directions, both sides of the surface.
#[test]
fn values_are_those_of_mitsuba() {
    let pairs = [
        ([0.3, 0.2, 0.9], [-0.4, 0.1, 0.8]),
        ([0.8, -0.1, 0.3], [-0.7, 0.2, -0.35]),
        ([0.1, 0.7, -0.5], [0.2, -0.3, 0.6]),
        ([0.1, 0.7, -0.5], [0.2, -0.6, -0.6]),
        ([0.2, 0.1, 0.7], [-0.3, 0.1, -0.8]),
    ];
    let solid = [
        [
            [0.068_258_6, 0.032_182_4, 0.020_157],
            [0.052_945_6, 0.031_641_1, 0.020_011_6],
            [0.0; 3],
            [0.332_792; 3],
            [0.013_837, 0.008_269_16, 0.005_229_88],
        ],
        [
            [0.010_165_1; 3],
            [0.569_949, 0.537_353, 0.465_362],
            [0.0; 3],
            [0.124_228; 3],
            [0.113_887, 0.107_373, 0.092_988],
        ],
        [
            [0.188_59, 0.168_591, 0.128_594],
            [0.327_676, 0.308_936, 0.267_546],
            [9.759_92e-5, 9.201_74e-5, 7.968_94e-5],
            [0.003_558_74; 3],
            [0.174_546, 0.164_564, 0.142_516],
        ],
    ];
    let sheet = [
        [
            [0.054_793_5, 0.023_055_6, 0.012_476_3],
            [0.138_607, 0.049_502_7, 0.019_801_1],
            [0.042_575_7, 0.015_205_6, 0.006_082_25],
            [0.059_919, 0.030_647_8, 0.020_890_7],
            [0.152_442, 0.054_443_7, 0.021_777_5],
        ],
        [
            [0.010_165_1; 3],
            [0.499_778, 0.444_247, 0.333_186],
            [0.025_946_9, 0.023_064, 0.017_298],
            [0.012_522_2; 3],
            [0.527_584, 0.468_964, 0.351_723],
        ],
        [
            [0.028_655, 0.057_309_7, 0.019_103_5],
            [0.024_825_6, 0.049_651_3, 0.016_550_4],
            [0.049_110_7, 0.098_221_3, 0.032_740_4],
            [0.026_681_9, 0.052_853_2, 0.017_958_2],
            [0.053_284, 0.106_568, 0.035_522_7],
        ],
    ];
    let unit = |d: [f64; 3]| Vec3::from_array(d).normalize_or_zero();
    let agree = |found: Vec3<f64>, wanted: [f64; 3], what: String| {
        for (a, b) in found.to_array().into_iter().zip(wanted) {
            // Mitsuba's luminance has other digits, which tints show.
            assert!((a - b).abs() < 3e-4 * b + 1e-9, "{what}: {found:?} {wanted:?}");
        }
    };
    for (k, (p, wanted)) in solids().iter().zip(solid).enumerate() {
        for ((wo, wi), wanted) in pairs.into_iter().zip(wanted) {
            agree(Principled::new(p).eval(unit(wo), unit(wi)), wanted, format!("solid {k} {wo:?}"));
        }
    }
    for (k, (p, wanted)) in sheets().iter().zip(sheet).enumerate() {
        for ((wo, wi), wanted) in pairs.into_iter().zip(wanted) {
            agree(PrincipledThin::new(p).eval(unit(wo), unit(wi)), wanted, format!("sheet {k} {wo:?}"));
        }
    }
}

/// Moments of the density by the midpoint rule on the whole sphere, and by samples.
fn samples_follow(bsdf: &impl Scatter<f64>, wo: Vec3<f64>, what: &str) {
    let moments = |d: Vec3<f64>| [1.0, f64::from(u8::from(d.z > 0.0)), d.x, d.y * d.y, d.z * d.z * d.z];
    let (steps, mut integral) = (1400, [0.0; 5]);
    for i in 0..steps {
        let z = 2.0 * (f64::from(i) + 0.5) / f64::from(steps) - 1.0;
        let r = (1.0 - z * z).sqrt();
        for j in 0..steps {
            let (sin, cos) = (2.0 * PI * (f64::from(j) + 0.5) / f64::from(steps)).sin_cos();
            let d = vec3(r * cos, r * sin, z);
            let weight = bsdf.pdf(wo, d) * 4.0 * PI / (f64::from(steps) * f64::from(steps));
            integral.iter_mut().zip(moments(d)).for_each(|(s, m)| *s += weight * m);
        }
    }
    let (n, mut sum, mut squares) = (200_000, [0.0; 5], [0.0; 5]);
    let mut rng = Rng::new(11, 0);
    for _ in 0..n {
        let (lobe, a, b) = (rng.next_f64(), rng.next_f64(), rng.next_f64());
        let Some(s) = bsdf.sample(wo, lobe, [a, b]) else { continue };
        let (value, pdf) = bsdf.eval_pdf(wo, s.wi);
        let error = (s.weight * pdf - value).length();
        assert!(error < 1e-7 * (1.0 + value.length()), "{what}: {error:e}");
        assert!((pdf / s.pdf - 1.0).abs() < 1e-7, "{what}: {pdf} {}", s.pdf);
        for (k, m) in moments(s.wi).into_iter().enumerate() {
            sum[k] += m;
            squares[k] += m * m;
        }
    }
    for k in 0..5 {
        let mean = sum[k] / f64::from(n);
        let sigma = ((squares[k] / f64::from(n) - mean * mean).max(1e-6) / f64::from(n)).sqrt();
        let error = (mean - integral[k]).abs();
        assert!(error < 4.5 * sigma + 2e-3, "{what} {wo:?} {k}: {mean} {}", integral[k]);
    }
}

#[test]
fn samples_have_their_density_and_weight() {
    for wo in [v(0.1, 0.2, 0.95), v(-0.6, 0.5, 0.4), v(0.3, -0.4, -0.8)].map(Vec3::normalize_or_zero) {
        for (k, p) in solids().iter().enumerate() {
            samples_follow(&Principled::new(p), wo, &format!("solid {k}"));
        }
        for (k, p) in sheets().iter().enumerate() {
            samples_follow(&PrincipledThin::new(p), wo, &format!("sheet {k}"));
        }
    }
}

/// `f(wo, wi) / eta_o^2 = f(wi, wo) / eta_i^2` through the boundary of a solid, with values per cosine.
#[test]
fn refraction_is_reciprocal() {
    let solid = Principled::new(&solids()[1]);
    let mut rng = Rng::new(5, 0);
    let mut seen = 0;
    for _ in 0..400 {
        let mut d = |side: f64| {
            let (z, phi) = (0.05 + 0.95 * rng.next_f64(), 2.0 * PI * rng.next_f64());
            let r = (1.0 - z * z).sqrt();
            vec3(r * phi.cos(), r * phi.sin(), side * z)
        };
        let (above, below) = (d(1.0), d(-1.0));
        let there = solid.eval(above, below).x / below.z.abs();
        let back = solid.eval(below, above).x / above.z;
        seen += i32::from(there > 0.0);
        assert!((there * 1.3 * 1.3 - back).abs() <= 1e-9 * back.max(1e-9), "{there} {back}");
    }
    assert!(seen > 40, "{seen}");
}

/// A white pane without absorption gives back no more light than it gets, and nearly all of it where it is smooth.
#[test]
fn nothing_shines_by_itself() {
    let white = Vec3::splat(1.0);
    let glass = PrincipledParameters { base_color: white, ..solids()[1] };
    let pane = PrincipledThinParameters { base_color: white, roughness: 0.1, ..sheets()[1] };
    let (solid, sheet) = (Principled::new(&glass), PrincipledThin::new(&pane));
    let mut rng = Rng::new(3, 0);
    let mut energy = [0.0; 2];
    let n = 100_000;
    for _ in 0..n {
        let u = [rng.next_f64(), rng.next_f64(), rng.next_f64()];
        let wo = v(0.3, 0.1, 0.8).normalize_or_zero();
        // Radiance is squeezed on its way in: undone, so that energy is counted.
        if let Some(s) = solid.sample(wo, u[0], [u[1], u[2]]) {
            energy[0] += s.weight.x * s.eta * s.eta / f64::from(n);
        }
        energy[1] += sheet.sample(wo, u[0], [u[1], u[2]]).map_or(0.0, |s| s.weight.x) / f64::from(n);
    }
    assert!(energy[0] > 0.9 && energy[0] < 1.001, "{energy:?}");
    assert!(energy[1] > 0.98 && energy[1] < 1.02, "{energy:?}");
}
