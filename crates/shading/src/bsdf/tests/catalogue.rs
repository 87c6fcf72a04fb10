//! One of everything, over the ranges of its parameters.

use crate::Surface;
use crate::bsdf::{
    Bsdf, Conductor, Dielectric, Diffuse, Distribution, Energy, GltfParameters, Masking, MetallicRoughness,
    Microfacet, Null, Plastic, RoughConductor, RoughDielectric, RoughPlastic, ThinDielectric, TransportMode,
};
use photofit_scalar::{Real, Vec3, vec3};

/// A BSDF of the tests.
pub(super) struct Case<T> {
    pub(super) name: String,
    pub(super) bsdf: Bsdf<T>,
    /// Index of refraction of the inside, where light is refracted.
    pub(super) ior: Option<f64>,
    /// Scatters both above and below.
    pub(super) both_sides: bool,
    /// How microfacets scatter, where the material has a choice.
    pub(super) energy: Option<Energy>,
}

pub(super) fn v<T: Real>(x: f64, y: f64, z: f64) -> Vec3<T> {
    vec3(T::of(x), T::of(y), T::of(z))
}

pub(super) fn case<T>(name: String, bsdf: Bsdf<T>) -> Case<T> {
    Case { name, bsdf, ior: None, both_sides: false, energy: None }
}

pub(super) const ROUGHNESSES: [f64; 6] = [0.0, 0.02, 0.1, 0.3, 0.6, 1.0];

/// Everything.
pub(super) fn all<T: Real>() -> Vec<Case<T>> {
    let mut out = vec![
        Case { both_sides: true, ..case("null".into(), Bsdf::Null(Null)) },
        case("diffuse".into(), Bsdf::Diffuse(Diffuse { reflectance: v(0.8, 0.5, 0.1) })),
    ];
    for roughness in ROUGHNESSES {
        metallic_roughness(roughness, &mut out);
        layered(roughness, &mut out);
    }
    for (alpha_x, alpha_y) in [(1e-5, 1e-5), (0.01, 0.01), (0.1, 0.1), (0.05, 0.4), (1.0, 1.0)] {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for masking in [Masking::Correlated, Masking::Separable] {
                let surface =
                    Microfacet { distribution, masking, alpha_x: T::of(alpha_x), alpha_y: T::of(alpha_y) };
                mitsuba(surface, &mut out);
            }
        }
    }
    for ior in [1.0, 1.0001, 1.33, 1.5, 2.4] {
        smooth(ior, &mut out);
    }
    out
}

fn metallic_roughness<T: Real>(roughness: f64, out: &mut Vec<Case<T>>) {
    for energy in [Energy::Single, Energy::Compensated] {
        for (metallic, color) in [(0.0, 0.9), (0.5, 0.7), (1.0, 0.9), (0.0, 0.0)] {
            let surface = Surface {
                base_color: v(color, 0.8 * color, 0.3 * color),
                roughness: T::of(roughness),
                metallic: T::of(metallic),
                gamma: T::zero(),
            };
            let name = format!("metallic-roughness r {roughness} m {metallic} c {color} {energy:?}");
            let bsdf = Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, energy));
            out.push(Case { energy: Some(energy), ..case(name, bsdf) });
        }
    }
}

/// A material that has a layer, by name.
pub(super) fn extended<T: Real>(kind: &str, roughness: f64) -> GltfParameters<T> {
    let p = GltfParameters {
        base_color: v(0.9, 0.6, 0.3),
        metallic: T::zero(),
        roughness: T::of(roughness),
        ..GltfParameters::default()
    };
    let half = T::of(0.5);
    match kind {
        "clearcoat" => GltfParameters { clearcoat: T::of(0.8), clearcoat_roughness: T::of(0.1), ..p },
        "smooth clearcoat" => GltfParameters { clearcoat: T::one(), metallic: half, ..p },
        "bent clearcoat" => GltfParameters {
            clearcoat: T::one(),
            clearcoat_roughness: T::of(0.3),
            clearcoat_normal: vec3(T::of(0.3), T::of(-0.2), T::one()).normalize_or_zero(),
            ..p
        },
        "sheen" => GltfParameters { sheen_color: v(1.0, 0.5, 0.2), sheen_roughness: T::of(0.4), ..p },
        "narrow sheen" => GltfParameters { sheen_color: v(1.0, 1.0, 1.0), ..p },
        "anisotropy" => GltfParameters {
            metallic: T::one(),
            anisotropy: T::of(0.7),
            anisotropy_direction: [T::of(0.6), T::of(0.8)],
            ..p
        },
        "specular" => {
            GltfParameters { specular: half, specular_color: v(2.0, 1.0, 0.5), ior: T::of(2.0), ..p }
        }
        "thin" => GltfParameters { transmission: T::of(0.8), ..p },
        "volume" => GltfParameters { transmission: T::one(), volume: true, ..p },
        "air" => GltfParameters { transmission: T::one(), volume: true, ior: T::of(1.0001), ..p },
        "everything" => GltfParameters {
            transmission: half,
            volume: true,
            clearcoat: half,
            clearcoat_roughness: T::of(0.2),
            sheen_color: v(0.3, 0.4, 0.5),
            sheen_roughness: half,
            anisotropy: half,
            metallic: T::of(0.2),
            specular: T::of(0.8),
            ..p
        },
        other => panic!("no material {other}"),
    }
}

pub(super) const EXTENDED: [&str; 11] = [
    "clearcoat",
    "smooth clearcoat",
    "bent clearcoat",
    "sheen",
    "narrow sheen",
    "anisotropy",
    "specular",
    "thin",
    "volume",
    "air",
    "everything",
];

fn layered<T: Real>(roughness: f64, out: &mut Vec<Case<T>>) {
    for kind in EXTENDED {
        for energy in [Energy::Single, Energy::Compensated] {
            let p: GltfParameters<T> = GltfParameters { energy, ..extended(kind, roughness) };
            let bsdf = p.bsdf();
            let ior = p.volume.then_some(p.ior.f64());
            let name = format!("glTF {kind} r {roughness} {energy:?}");
            let both_sides = bsdf.transmits();
            out.push(Case { name, bsdf, ior, both_sides, energy: Some(energy) });
        }
    }
}

pub(super) fn gold<T: Real>() -> Conductor<T> {
    Conductor { eta: v(0.2, 0.92, 1.1), k: v(3.91, 2.45, 2.14), reflectance: Vec3::splat(T::one()) }
}

pub(super) fn glass<T: Real>(ior: f64, mode: TransportMode) -> Dielectric<T> {
    let white = Vec3::splat(T::one());
    Dielectric { ior: T::of(ior), reflectance: white, transmittance: white, mode }
}

fn mitsuba<T: Real>(surface: Microfacet<T>, out: &mut Vec<Case<T>>) {
    let of = format!(
        "{:?} {:?} {:.0e} {:.0e}",
        surface.distribution,
        surface.masking,
        surface.alpha_x.f64(),
        surface.alpha_y.f64()
    );
    let metal = RoughConductor { metal: gold(), surface };
    out.push(case(format!("rough conductor {of}"), Bsdf::RoughConductor(metal)));
    for ior in [1.0, 1.0001, 1.5, 2.4, 0.7] {
        let mode = if ior > 2.0 { TransportMode::Importance } else { TransportMode::Radiance };
        let bsdf = Bsdf::RoughDielectric(RoughDielectric { glass: glass(ior, mode), surface });
        let name = format!("rough dielectric {of} ior {ior} {mode:?}");
        out.push(Case { ior: Some(ior), both_sides: true, ..case(name, bsdf) });
    }
    if surface.alpha_x == surface.alpha_y {
        let (diffuse, white) = (v(0.5, 0.2, 0.9), v(1.0, 1.0, 1.0));
        let plastic = RoughPlastic::new(diffuse, white, T::of(1.5), true, surface);
        out.push(case(format!("rough plastic {of}"), Bsdf::RoughPlastic(plastic)));
    }
}

fn smooth<T: Real>(ior: f64, out: &mut Vec<Case<T>>) {
    let white = Vec3::splat(T::one());
    for mode in [TransportMode::Radiance, TransportMode::Importance] {
        let bsdf = Bsdf::Dielectric(glass(ior, mode));
        let name = format!("dielectric {ior} {mode:?}");
        out.push(Case { ior: Some(ior), both_sides: true, ..case(name, bsdf) });
    }
    let thin = ThinDielectric { ior: T::of(ior), reflectance: white, transmittance: white };
    let thin = case(format!("thin dielectric {ior}"), Bsdf::ThinDielectric(thin));
    out.push(Case { both_sides: true, ..thin });
    for nonlinear in [false, true] {
        let plastic = Plastic::new(v(0.5, 0.2, 0.9), white, T::of(ior), nonlinear);
        out.push(case(format!("plastic {ior} {nonlinear}"), Bsdf::Plastic(plastic)));
    }
    out.push(case("conductor".into(), Bsdf::Conductor(gold())));
}
