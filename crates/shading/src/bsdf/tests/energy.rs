//! White furnaces: how much of uniform light is scattered.

use super::catalogue::{Case, EXTENDED, ROUGHNESSES, all, extended, glass, v};
use crate::bsdf::{
    Bsdf, Conductor, Distribution, Energy, GltfParameters, MetallicRoughness, Microfacet, Plastic,
    RoughConductor, RoughDielectric, RoughPlastic, TransportMode,
};
use crate::{Surface, split_sum};
use photofit_sampling::Sobol;
use photofit_scalar::{Vec3, vec3};
use rayon::prelude::*;

const COSINES: [f64; 7] = [1.0, 0.9, 0.7, 0.4, 0.2, 0.1, 0.03];

/// Part of uniform light that is scattered towards a viewer, by low-discrepancy samples.
fn furnace(bsdf: &Bsdf<f64>, wo: Vec3<f64>) -> Vec3<f64> {
    let points = Sobol::new(5, 0);
    let n = 1 << 12;
    let mut sum = Vec3::zero();
    for i in 0..n {
        let lobe = f64::from(points.sample(i, 0));
        if let Some(s) = bsdf.sample(wo, lobe, points.sample_2d(i, 1).map(f64::from)) {
            sum += s.weight;
        }
    }
    sum / f64::from(n)
}

fn viewer(z: f64, phi: f64) -> Vec3<f64> {
    let r = (1.0 - z * z).sqrt();
    vec3(r * phi.cos(), r * phi.sin(), z)
}

/// Checks every channel of a furnace.
fn each(bsdf: &Bsdf<f64>, z: f64, name: &str, holds: impl Fn(f64) -> bool) {
    let found = furnace(bsdf, viewer(z, 0.7));
    assert!(found.to_array().into_iter().all(holds), "{name} from {z}: {found:?}");
}

fn plain(metallic: f64, roughness: f64, energy: Energy) -> Bsdf<f64> {
    let p = GltfParameters { metallic, roughness, energy, ..GltfParameters::default() };
    p.bsdf()
}

#[test]
fn compensated_white_materials_return_what_they_receive() {
    for roughness in [0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0] {
        for z in COSINES {
            for metallic in [0.0, 0.3, 1.0] {
                let bsdf = plain(metallic, roughness, Energy::Compensated);
                // Between dielectric and metal the Lambertian part stands for light that is not all absorbed.
                let least = if metallic == 0.3 { 0.0 } else { 0.995 };
                each(&bsdf, z, &format!("r {roughness} m {metallic}"), |a| a > least && a < 1.005);
            }
        }
    }
}

#[test]
fn anisotropic_metal_is_compensated_nearly() {
    let mut worst = 0.0_f64;
    for roughness in [0.1, 0.33, 0.6, 0.85] {
        for anisotropy in [0.3, 0.6, 1.0] {
            for z in COSINES {
                for phi in [0.0, 0.8, 1.57] {
                    let energy = Energy::Compensated;
                    let p = GltfParameters { roughness, anisotropy, energy, ..GltfParameters::default() };
                    let a = furnace(&p.bsdf(), viewer(z, phi)).x;
                    worst = worst.max((a - 1.0).abs());
                }
            }
        }
    }
    // The table of two alphas is coarse.
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn single_scattering_loses_the_tabulated_part() {
    for roughness in [0.1, 0.3, 0.6, 1.0] {
        for z in COSINES {
            let table = split_sum(z, roughness);
            let metal = table.scale + table.bias;
            each(&plain(1.0, roughness, Energy::Single), z, "metal", |a| (a - metal).abs() < 5e-3 && a < 1.0);
            // The Lambertian lobe of the rasterizer's model knows nothing of the reflection above it.
            let dielectric = 1.0 + 0.04 * table.scale + table.bias;
            each(&plain(0.0, roughness, Energy::Single), z, "dielectric", |a| (a - dielectric).abs() < 5e-3);
        }
    }
}

#[test]
fn thin_walls_return_what_they_receive() {
    for roughness in [0.0, 0.3, 1.0] {
        for z in COSINES {
            let p = GltfParameters {
                metallic: 0.0,
                roughness,
                transmission: 0.7,
                energy: Energy::Compensated,
                ..GltfParameters::default()
            };
            each(&p.bsdf(), z, &format!("thin r {roughness}"), |a| (a - 1.0).abs() < 5e-3);
            each(&p.bsdf(), -z, &format!("thin r {roughness}"), |a| (a - 1.0).abs() < 5e-3);
        }
    }
}

#[test]
fn rough_glass_returns_what_it_receives() {
    for roughness in [0.1, 0.3, 0.5, 0.75, 1.0] {
        for ior in [1.05, 1.33, 1.5, 2.4] {
            for z in COSINES.into_iter().flat_map(|z| [z, -z]) {
                let p = GltfParameters {
                    transmission: 1.0,
                    volume: true,
                    metallic: 0.0,
                    roughness,
                    ior,
                    energy: Energy::Compensated,
                    mode: TransportMode::Importance,
                    ..GltfParameters::default()
                };
                let a = furnace(&p.bsdf(), viewer(z, 0.7)).x;
                // The table is coarse at grazing angles.
                let most = if z.abs() < 0.15 { 0.025 } else { 0.012 };
                assert!((a - 1.0).abs() < most, "r {roughness} ior {ior} from {z}: {a}");
            }
        }
    }
}

#[test]
fn smooth_glass_returns_what_it_receives() {
    for ior in [1.0, 1.0001, 1.5, 2.4] {
        for z in COSINES {
            for side in [z, -z] {
                let bsdf = Bsdf::Dielectric(glass(ior, TransportMode::Importance));
                each(&bsdf, side, &format!("glass {ior}"), |a| (a - 1.0).abs() < 1e-9);
                let p = GltfParameters {
                    transmission: 1.0,
                    volume: true,
                    metallic: 0.0,
                    roughness: 0.0,
                    ior,
                    mode: TransportMode::Importance,
                    ..GltfParameters::default()
                };
                each(&p.bsdf(), side, &format!("glTF glass {ior}"), |a| (a - 1.0).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn nothing_returns_more_than_it_receives() {
    all::<f64>().par_iter().for_each(|case| {
        for z in [0.95, 0.5, 0.1] {
            let sides = if case.both_sides { vec![z, -z] } else { vec![z] };
            for z in sides {
                let most = 1.005 * radiance_gain(case, z) + added(case, z);
                each(&case.bsdf, z, &case.name, |a| a >= 0.0 && a < most);
            }
        }
    });
}

/// Largest factor by which radiance grows at refraction towards the viewer.
fn radiance_gain(case: &Case<f64>, z: f64) -> f64 {
    let mode = match &case.bsdf {
        Bsdf::Dielectric(b) => b.mode,
        Bsdf::RoughDielectric(b) => b.glass.mode,
        _ => TransportMode::Radiance,
    };
    let (TransportMode::Radiance, Some(ior)) = (mode, case.ior) else { return 1.0 };
    f64::max(1.0, if z < 0.0 { ior * ior } else { 1.0 / (ior * ior) })
}

/// What [`Energy::Single`] states that it may add: the reflection of a dielectric, of an eighth at most from straight above,
/// over a base that knows nothing of it.
fn added(case: &Case<f64>, z: f64) -> f64 {
    let reflected = |roughness| {
        let table = split_sum(z.abs(), roughness);
        table.scale / 8.0 + table.bias
    };
    let most = || ROUGHNESSES.into_iter().map(reflected).fold(0.0, f64::max);
    if case.energy == Some(Energy::Single) { most() } else { 0.0 }
}

#[test]
fn layers_never_add_energy() {
    let kinds = || EXTENDED.into_iter().filter(|k| k.contains("coat") || k.contains("sheen"));
    for (energy, kind) in
        [Energy::Compensated, Energy::Single].into_iter().flat_map(|e| kinds().map(move |k| (e, k)))
    {
        for roughness in [0.0, 0.3, 1.0] {
            let p = GltfParameters {
                base_color: v(1.0, 1.0, 1.0),
                sheen_color: if kind.contains("sheen") { v(1.0, 1.0, 1.0) } else { Vec3::zero() },
                energy,
                ..extended(kind, roughness)
            };
            for z in COSINES {
                for phi in [0.7, 2.5, 4.2, 5.7] {
                    let found = furnace(&p.bsdf(), viewer(z, phi));
                    // Without compensation the core alone may return more ([`added`]); layers add nothing to it.
                    let core = GltfParameters { clearcoat: 0.0, sheen_color: Vec3::zero(), ..p };
                    let core = furnace(&core.bsdf(), viewer(z, phi));
                    let most = core.to_array().into_iter().fold(1.0, f64::max);
                    let holds = |a: f64| a > 0.4 && a < 1.005 * most;
                    let right = found.to_array().into_iter().all(holds);
                    assert!(right, "{energy:?} {kind} r {roughness} from {z}, {phi}: {found:?}");
                }
            }
        }
    }
}

#[test]
fn rough_conductors_lose_and_plastic_conserves() {
    let white = Vec3::splat(1.0);
    let mirror = Conductor { eta: Vec3::splat(1e-9), k: Vec3::splat(1e9), reflectance: white };
    for distribution in [Distribution::Ggx, Distribution::Beckmann] {
        for alpha in [0.01, 0.1, 0.5, 1.0] {
            let surface = Microfacet::isotropic(distribution, alpha);
            for z in COSINES {
                let metal = Bsdf::RoughConductor(RoughConductor { metal: mirror, surface });
                each(&metal, z, &format!("{distribution:?} {alpha}"), |a| a > 0.3 && a < 1.0001);
                let glass = RoughDielectric { glass: glass(1.5, TransportMode::Importance), surface };
                for side in [z, -z] {
                    let name = format!("rough glass {distribution:?} {alpha}");
                    each(&Bsdf::RoughDielectric(glass), side, &name, |a| a > 0.3 && a < 1.0001);
                }
            }
        }
        let surface = Microfacet::isotropic(distribution, 0.05);
        let plastic = RoughPlastic::new(white, white, 1.5, true, surface);
        for z in COSINES {
            each(&Bsdf::RoughPlastic(plastic), z, "rough plastic", |a| a > 0.9 && a < 1.001);
        }
    }
    for z in COSINES {
        let plastic = Bsdf::Plastic(Plastic::new(white, white, 1.5, true));
        each(&plastic, z, "plastic", |a| (a - 1.0).abs() < 1e-3);
        let polished = Surface { base_color: white, roughness: 0.0, metallic: 1.0, gamma: 0.0 };
        let metal = MetallicRoughness::new(&polished, Energy::Single);
        each(&Bsdf::MetallicRoughness(metal), z, "polished metal", |a| (a - 1.0).abs() < 5e-3);
    }
}
