//! What is skipped, and that skipping changes nothing.

use super::scenes::{cornell, cornell_view, diffuse, render, square};
use crate::{
    Boundary, BoundedMedium, EnvironmentMap, Features, LightSource, Material, Parts, Plan, RenderOptions,
    Shape, World, plan,
};
use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};

#[test]
fn scenes_run_what_they_need() {
    let ball = || {
        let mut parts = Parts::default();
        parts
            .add(Shape::Mesh(photofit_geometry::shapes::icosphere(2)), Material::new(diffuse(0.5, 0.5, 0.5)));
        parts
    };
    let lit = |change: &dyn Fn(&mut Parts)| {
        let mut parts = ball();
        change(&mut parts);
        Plan::new(&World::new(parts).unwrap())
    };
    let sky = EnvironmentMap::constant(Vec3f::splat(1.0));
    let point = LightSource::Point { position: DVec3::Y * 3.0, intensity: Vec3f::splat(1.0) };
    let cases = [
        (lit(&|p| p.environment = Some(sky.clone())), plan::ENVIRONMENT),
        (lit(&|p| p.lights.push(point.clone())), plan::SOURCES),
        (Plan::new(&World::new(cornell()).unwrap()), plan::EMITTERS),
    ];
    for (plan, bits) in cases {
        assert_eq!(plan.needs, Features(bits));
        assert_eq!(plan.has, Features(bits), "nothing else is compiled in");
    }
    let both = lit(&|p| {
        p.environment = Some(sky.clone());
        p.lights.push(point.clone());
        p.add(
            Shape::Sphere { center: vec3(2.0, 0.0, 0.0), radius: 0.5 },
            Material::new(diffuse(0.1, 0.1, 0.1)),
        );
    });
    assert_eq!(both.needs, Features(plan::ENVIRONMENT | plan::SOURCES | plan::TWO_LEVEL));
    assert!(both.has.contains(both.needs) && !both.has.contains(Features(plan::VOLUMES)));
    let fog = lit(&|p| {
        p.environment = Some(sky.clone());
        p.media.push(BoundedMedium::homogeneous(Vec3f::splat(1.0), Vec3f::splat(0.5), 0.0));
        p.boundaries.push(Boundary { instance: 0, interior: Some(0), exterior: None });
    });
    assert_eq!(fog.needs, Features(plan::ENVIRONMENT | plan::VOLUMES));
    let text = both.to_string();
    assert!(text.contains("media") && text.contains("skipped: there are no volumes"), "{text}");
    assert!(text.contains("environment sampling") && text.lines().count() == 8, "{text}");
}

#[test]
fn what_is_compiled_in_without_need_changes_no_bit() {
    let world = World::new(cornell()).unwrap();
    let options = |further| RenderOptions { further, ..square(16, 8) };
    let (lean, _) = render(&world, &cornell_view(), options(Features::default()));
    for further in [Features::ALL, Features(plan::TWO_LEVEL), Features(plan::ALL & !plan::VOLUMES)] {
        let (full, _) = render(&world, &cornell_view(), options(further));
        assert_eq!(lean.data, full.data, "{further:?}");
    }
}
