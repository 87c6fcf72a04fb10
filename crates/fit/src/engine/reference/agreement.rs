//! Rasterized and path-traced pictures of the same lights and normals.

use super::tests::{mean, spheres};
use super::*;
use crate::engine::views::{Lighting, Orbit, Set, ViewLight, ViewLights, Views, studio};

#[test]
fn light_from_all_around_adds_up_in_both() {
    let ambient = |r| ViewLight::Ambient { radiance: Vec3f::splat(r) };
    let around = |yaw| ViewLight::Environment { map: studio(), yaw };
    let clay = spheres(&[0.0]);
    let n = Normalised::new(&clay).unwrap();
    let path = PathTraced::new(&clay, &n, MaterialFeatures::Core, 0).unwrap();
    for lights in [vec![ambient(0.3), ambient(0.5)], vec![around(0.7), ambient(0.4), around(2.0)]] {
        let mut s = Orbit::new(0, &Lighting::Mixed, 64).setup(Set::Report, 0, 4);
        s.lights = ViewLights(lights);
        let rasterized = Rasterized::new(&n.flat, &n.library).picture(&s).unwrap().image;
        let traced = path.picture(&s).unwrap().image;
        for k in 0..3 {
            let (a, b) = (mean(&rasterized, k), mean(&traced, k));
            assert!((a / b - 1.0).abs() < 0.025, "channel {k}: {a} against {b}");
        }
        let rmse = photofit_image::rmse(&rasterized, &traced);
        assert!(rmse < 0.03, "{rmse}");
    }
}

#[test]
fn points_of_light_fall_off_alike_in_both() {
    let clay = spheres(&[0.0]);
    let n = Normalised::new(&clay).unwrap();
    let path = PathTraced::new(&clay, &n, MaterialFeatures::Core, 0).unwrap();
    let mut means = Vec::new();
    // From near, where every point of the surface has a distance of its own, and from twice as far.
    for distance in [1.8, 3.6] {
        let mut s = Orbit::new(0, &Lighting::Mixed, 64).setup(Set::Report, 0, 4);
        let eye = s.camera.pinhole().eye.normalize();
        let position = vec3(eye.x + 0.3, eye.y - 0.2, eye.z).normalize_or_zero() * distance;
        s.lights = ViewLights(vec![ViewLight::Point { position, intensity: vec3(6.0, 5.0, 4.0) }]);
        let rasterized = Rasterized::new(&n.flat, &n.library).picture(&s).unwrap().image;
        let traced = path.picture(&s).unwrap().image;
        for k in 0..3 {
            let (a, b) = (mean(&rasterized, k), mean(&traced, k));
            assert!((a / b - 1.0).abs() < 0.01, "channel {k} from {distance}: {a} against {b}");
        }
        let rmse = photofit_image::rmse(&rasterized, &traced);
        assert!(rmse < 0.02, "{rmse}");
        means.push(mean(&rasterized, 1));
    }
    assert!(means[0] > 3.0 * means[1], "{means:?}");
}

#[test]
fn vertex_normals_that_point_to_the_back_are_dark_in_both() {
    let right = spheres(&[0.0]);
    let mut opposed = right.clone();
    opposed.primitives[0].mesh.normals.iter_mut().for_each(|n| *n = -*n);
    let mut means = Vec::new();
    for scene in [&right, &opposed] {
        let n = Normalised::new(scene).unwrap();
        let mut s = Orbit::new(0, &Lighting::Mixed, 64).setup(Set::Report, 0, 4);
        let direction = s.camera.pinhole().eye.normalize();
        let direction = vec3(direction.x, direction.y, direction.z);
        s.lights = ViewLights(vec![ViewLight::Directional { direction, irradiance: Vec3f::splat(3.0) }]);
        let rasterized = Rasterized::new(&n.flat, &n.library).picture(&s).unwrap().image;
        let path = PathTraced::new(scene, &n, MaterialFeatures::Core, 0).unwrap();
        let traced = path.picture(&s).unwrap().image;
        let (a, b) = (mean(&rasterized, 1), mean(&traced, 1));
        let rmse = photofit_image::rmse(&rasterized, &traced);
        assert!((a - b).abs() < 0.003 && rmse < 0.02, "{a} against {b}, {rmse}");
        means.push(a);
    }
    assert!(means[1] < 0.3 * means[0], "{means:?}");
}
