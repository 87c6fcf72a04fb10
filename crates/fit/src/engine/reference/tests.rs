//! Pictures of references.

use super::*;
use crate::engine::judge::Stage;
use crate::engine::views::{Lighting, Orbit, Set, Views};
use glam::{Affine3A, Vec3};
use photofit_geometry::{Mesh, shapes};
use photofit_scene::{Clearcoat, Extensions, Instance, Material, Primitive, Sheen, Transmission, Volume};

/// Spheres of clay at the given places, with radius 1.
pub(super) fn spheres(places: &[f32]) -> Scene {
    let mut mesh: Mesh = shapes::icosphere(24);
    mesh.normals = mesh.positions.clone();
    Scene {
        primitives: vec![Primitive { mesh, material: 0 }],
        materials: vec![Material {
            base_color: [0.2, 0.2, 0.2, 1.0],
            metallic: 0.0,
            roughness: 1.0,
            ..Material::clay()
        }],
        instances: places
            .iter()
            .map(|x| Instance {
                primitive: 0,
                transform: Affine3A::from_translation(Vec3::new(10.0 + x, 0.0, 0.0)),
            })
            .collect(),
        ..Scene::default()
    }
}

fn pictures(scene: &Scene, lighting: &Lighting, index: u64) -> [Image; 2] {
    let n = Normalised::new(scene).unwrap();
    let s = Orbit::new(0, lighting, 64).setup(Set::Report, index, 4);
    let raster = Rasterized::new(&n.flat, &n.library).picture(&s).unwrap();
    let path = PathTraced::new(scene, &n, MaterialFeatures::Core, 0).unwrap().picture(&s).unwrap();
    assert_eq!(raster.noise, Some(0.0));
    assert!(path.noise.is_some_and(|n| n > 0.0 && n < 0.2), "{:?}", path.noise);
    [raster.image, path.image]
}

pub(super) fn mean(image: &Image, k: usize) -> f64 {
    image.data.chunks_exact(4).map(|p| f64::from(p[k])).sum::<f64>() / image.pixels() as f64
}

#[test]
fn a_convex_body_looks_the_same_to_both() {
    // No shadows fall and no light goes from surface to surface.
    let clay = spheres(&[0.0]);
    let mut metal = clay.clone();
    metal.materials[0] =
        Material { base_color: [0.9, 0.9, 0.9, 1.0], metallic: 1.0, roughness: 0.8, ..Material::clay() };
    for (lighting, index) in [(Lighting::Point, 1), (Lighting::Mixed, 0), (Lighting::Mixed, 2)] {
        // The rasterizer prefilters environments, which shows on metals.
        for (scene, name, most) in [(&clay, "clay", 0.03), (&metal, "metal", 0.05)] {
            let [raster, path] = pictures(scene, &lighting, index);
            for k in 0..4 {
                let (a, b) = (mean(&raster, k), mean(&path, k));
                assert!((a / b - 1.0).abs() < 0.025, "{name}, {lighting:?}, channel {k}: {a} against {b}");
            }
            // The same places are bright.
            let rmse = photofit_image::rmse(&raster, &path);
            assert!(rmse < most, "{name}, {lighting:?}: {rmse}");
        }
        // On rough metal the policy on energy shows: another one on one side is seen.
        let n = Normalised::new(&metal).unwrap();
        let mut other = PathTraced::new(&metal, &n, MaterialFeatures::Core, 0).unwrap();
        let compensated = world(&metal, n.frame(), Energy::Compensated).unwrap();
        other.world = Mutex::new((compensated, Moment::default()));
        let s = Orbit::new(0, &lighting, 64).setup(Set::Report, index, 4);
        let (a, b) = (pictures(&metal, &lighting, index), other.picture(&s).unwrap().image);
        assert!(mean(&b, 1) > 1.06 * mean(&a[0], 1), "{lighting:?}: {} {}", mean(&b, 1), mean(&a[0], 1));
    }
}

#[test]
fn shadows_are_in_path_traced_pictures_alone() {
    let [raster, path] = pictures(&spheres(&[0.0, 1.9, -1.9]), &Lighting::Mixed, 0);
    assert!((mean(&raster, 3) - mean(&path, 3)).abs() < 0.01);
    // Around the contact little of the sky is seen.
    let darker = |(r, p): (&[f32], &[f32])| r[3] == 1.0 && p[1] < 0.8 * r[1];
    let dark = raster.data.chunks_exact(4).zip(path.data.chunks_exact(4)).filter(|x| darker(*x)).count();
    assert!(dark > 10, "{dark} pixels are darker");
}

#[test]
fn what_a_candidate_cannot_express_is_left_out_of_core_pictures() {
    let plain = spheres(&[0.0]);
    let mut velvet = plain.clone();
    velvet.materials[0].extensions = Some(Box::new(Extensions {
        sheen: Some(Sheen { color: [0.2, 0.4, 1.0], roughness: 0.3, ..Sheen::default() }),
        clearcoat: Some(Clearcoat { factor: 1.0, ..Clearcoat::default() }),
        ..Extensions::default()
    }));
    let n = Normalised::new(&plain).unwrap();
    let s = Orbit::new(0, &Lighting::Mixed, 32).setup(Set::Report, 0, 4);
    let picture =
        |scene, features| PathTraced::new(scene, &n, features, 0).unwrap().picture(&s).unwrap().image;
    assert_eq!(picture(&velvet, MaterialFeatures::Core), picture(&plain, MaterialFeatures::Core));
    let (all, core) = (picture(&velvet, MaterialFeatures::All), picture(&velvet, MaterialFeatures::Core));
    assert!(mean(&all, 2) > 1.1 * mean(&core, 2), "sheen is blue: {} {}", mean(&all, 2), mean(&core, 2));
}

#[test]
fn absorption_is_scaled_with_the_asset() {
    // The same vase in units and in hundredths of units.
    let glass = |scale: f32| {
        let mut scene = spheres(&[0.0]);
        let volume = Volume {
            thickness: scale,
            attenuation_distance: scale,
            attenuation_color: [0.9, 0.5, 0.1],
            ..Volume::default()
        };
        let transmission = Some(Transmission { factor: 1.0, texture: None });
        let extensions = Extensions { transmission, volume: Some(volume), ..Extensions::default() };
        scene.materials[0] = Material {
            metallic: 0.0,
            roughness: 0.0,
            extensions: Some(Box::new(extensions)),
            ..Material::default()
        };
        scene.instances[0].transform = Affine3A::from_scale(Vec3::splat(scale));
        let n = Normalised::new(&scene).unwrap();
        let s = Orbit::new(0, &Lighting::Mixed, 32).setup(Set::Report, 0, 4);
        let placed = PathTraced::new(&scene, &n, MaterialFeatures::All, 0).unwrap();
        // The same with its geometry in the frame of the fit already.
        let stage = Stage::of_mesh("own", &scene, &n.flat.mesh, &n.flat.triangle_material);
        let in_frame = PathTraced::in_frame(&stage.scene, &n, MaterialFeatures::All, 0).unwrap();
        [placed, in_frame].map(|p| p.picture(&s).unwrap().image)
    };
    let ([large, large_in_frame], [small, small_in_frame]) = (glass(1.0), glass(0.01));
    for (k, other) in [large_in_frame, small, small_in_frame].iter().enumerate() {
        for c in 0..3 {
            let (a, b) = (mean(&large, c), mean(other, c));
            assert!(a > 0.0 && (a / b - 1.0).abs() < 0.01, "picture {k}, channel {c}: {a} against {b}");
        }
    }
}
