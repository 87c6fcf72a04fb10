//! What is skipped, and that skipping changes nothing.

use super::scenes::{cornell, cornell_view, diffuse, render, square};
use crate::{
    Aov, Boundary, BoundedMedium, EnvironmentMap, Features, LightSource, Material, Parts, RenderOptions,
    RenderPlan, Renderer, Shape, World, plan,
};
use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Null};

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
        RenderPlan::new(&World::new(parts).unwrap())
    };
    let sky = EnvironmentMap::constant(Vec3f::splat(1.0));
    let point = LightSource::Point { position: DVec3::Y * 3.0, intensity: Vec3f::splat(1.0) };
    let cases = [
        (lit(&|p| p.environment = Some(sky.clone())), plan::ENVIRONMENT),
        (lit(&|p| p.lights.push(point.clone())), plan::SOURCES),
        (RenderPlan::new(&World::new(cornell()).unwrap()), plan::EMITTERS),
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
    assert!(text.contains("environment light") && text.lines().count() == 8, "{text}");
}

#[test]
fn lines_of_a_plan_are_true() {
    // An even sky is never sampled, an unlit surface emits nothing, a boundary alone absorbs nothing.
    let environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let mut parts = Parts { environment, ..Parts::default() };
    let ball = Shape::Mesh(photofit_geometry::shapes::icosphere(2));
    parts.add(ball.clone(), Material::new(Bsdf::Null(Null)));
    let unlit = photofit_scene::Material { unlit: true, ..photofit_scene::Material::default() };
    let scene = photofit_scene::Scene { materials: vec![unlit], ..photofit_scene::Scene::default() };
    parts.library = Some(photofit_scene::SurfaceLibrary::new(&scene));
    parts.add(ball, Material::from_library(0));
    let world = World::new(parts).unwrap();
    let text = RenderPlan::new(&world).to_string();
    let line = |name: &str| text.lines().find(|l| l.trim().starts_with(name)).expect(name).trim().to_owned();
    for name in ["environment light", "light of surfaces", "absorption, boundaries"] {
        assert!(line(name).ends_with(" runs"), "{text}");
    }
    assert!(!text.contains("sampling"), "{text}");
    // Each name leaves its column a space.
    assert!(Features::each().all(|(name, _)| name.len() <= 22));
}

#[test]
fn what_a_sampler_directs_has_everything_compiled_in() {
    let world = World::new(cornell()).unwrap();
    let renderer = Renderer::new(&world, &cornell_view(), square(8, 1)).unwrap();
    let (plain, sampled) = (renderer.plan().to_string(), renderer.sampled_plan());
    assert_eq!(sampled.has, Features(plan::SAMPLED));
    let sampled = sampled.to_string();
    assert!(plain.matches("skipped").count() > 4, "{plain}");
    assert!(
        sampled.matches("skipped").count() == 1 && sampled.contains("skipped: there are no volumes"),
        "{sampled}"
    );
    let sky = EnvironmentMap::constant(Vec3f::splat(1.0));
    let mut parts = Parts { environment: Some(sky), ..Parts::default() };
    parts.add(Shape::Mesh(photofit_geometry::shapes::icosphere(2)), Material::new(Bsdf::Null(Null)));
    parts.media.push(BoundedMedium::homogeneous(Vec3f::splat(1.0), Vec3f::splat(0.5), 0.0));
    parts.boundaries.push(Boundary { instance: 0, interior: Some(0), exterior: None });
    assert_eq!(RenderPlan::sampled(&World::new(parts).unwrap()).has, Features::ALL);
}

#[test]
fn films_are_bounded_by_their_bytes() {
    let world = World::new(cornell()).unwrap();
    let new = |width, height, aovs: &[Aov]| {
        let options = RenderOptions { width, height, aovs: aovs.to_vec(), ..RenderOptions::default() };
        Renderer::new(&world, &cornell_view(), options).map(|_| ()).map_err(|e| e.to_string())
    };
    for (w, h, aovs, each) in
        [(16384, 16384, &[][..], 64_u64), (65536, 65536, &[], 64), (8192, 8192, &Aov::ALL, 212)]
    {
        let text = new(w, h, aovs).unwrap_err();
        let bytes = (w * h) as u64 * each;
        let rule = format!("{w} x {h} pixels of {each} bytes on the film, {bytes}; there may be 8589934592");
        assert!(text.contains(&rule), "{text}");
    }
    assert!(new(64, 64, &[Aov::Albedo, Aov::Instance]).is_ok());
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
