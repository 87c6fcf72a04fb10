//! Parameters that belong to several places, those of anisotropic metals, and edits that leave the rest as it is.

use super::super::scenes::render;
use super::*;
use glam::Quat;

/// A ball of brushed metal on a floor under a sky.
fn brushed() -> World {
    let mut world = metals(Distribution::Ggx);
    change(&mut world, BALL, |m| {
        if let BsdfSource::Uniform(Bsdf::RoughConductor(c)) = &mut m.scattering {
            (c.surface.alpha_x, c.surface.alpha_y) = (0.45, 0.2);
        }
    });
    world
}

#[test]
fn the_alphas_of_anisotropic_metals_are_two() {
    let view = looking([0.0, 0.6, 2.6], [-0.3, 0.0, 0.0], 0.6);
    for (name, value) in [("alpha u", MaterialValue::AlphaU), ("alpha v", MaterialValue::AlphaV)] {
        let edit = |world: &mut World, o: &[f64]| {
            change(world, BALL, |m| {
                if let BsdfSource::Uniform(Bsdf::RoughConductor(c)) = &mut m.scattering {
                    let along = value == MaterialValue::AlphaU;
                    let alpha = if along { &mut c.surface.alpha_x } else { &mut c.surface.alpha_y };
                    *alpha += o[0] as f32;
                }
            });
        };
        Case { name, world: &brushed, view, parameter: of(BALL, value), step: 0.05, edit: &edit }.check();
    }
    let mut world = brushed();
    let refused = world.parameter(&of(BALL, MaterialValue::Alpha)).unwrap_err().to_string();
    assert!(refused.contains("anisotropic") && refused.contains("AlphaU"), "{refused}");
    world.set_parameter(&of(BALL, MaterialValue::AlphaU), &[0.6]).unwrap();
    assert_eq!(world.parameter(&of(BALL, MaterialValue::AlphaU)).unwrap(), [0.6]);
    assert_eq!(world.parameter(&of(BALL, MaterialValue::AlphaV)).unwrap(), [0.2], "the other one stays");
}

/// Two balls of different materials of the world that name one material of the library.
fn twins() -> World {
    let material = SceneMaterial { base_color: [0.6, 0.5, 0.4, 1.0], ..SceneMaterial::clay() };
    let scene = Scene {
        primitives: vec![Primitive { mesh: shapes::uv_sphere(24, 12), material: 0 }],
        materials: vec![material],
        ..Scene::default()
    };
    let mut parts = Parts::from_scene(&scene);
    parts.materials.push(Material::from_library(0));
    for (material, x) in [(0, -1.1), (1, 1.1)] {
        let transform = glam::DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
        parts.instances.push(crate::Instance { shape: 0, material, transform });
    }
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(0.7)));
    World::new(parts).unwrap()
}

#[test]
fn a_factor_of_the_library_moves_all_materials_that_name_it() {
    let view = looking([0.0, 0.3, 4.5], [0.0; 3], 0.8);
    let edit = |world: &mut World, o: &[f64]| {
        let parameter = of(0, MaterialValue::BaseColor);
        let values = world.parameter(&parameter).unwrap();
        let moved: Vec<f32> = values.iter().zip(o).map(|(v, o)| v + *o as f32).collect();
        world.set_parameter(&parameter, &moved).unwrap();
    };
    // Whichever of the two is named, the gradient is that of both.
    for materials in [vec![0], vec![1], vec![0, 1]] {
        let parameter = Parameter::Material { materials, value: MaterialValue::BaseColor };
        Case { name: "factor of twins", world: &twins, view, parameter, step: 0.06, edit: &edit }.check();
    }
    let world = twins();
    let both = [of(0, MaterialValue::BaseColor), of(1, MaterialValue::BaseColor)];
    let twice = Adjoint::new(&world, &view, square(SIDE, 1), &both).unwrap_err().to_string();
    assert!(twice.contains("given twice"), "{twice}");
}

#[test]
fn places_with_different_values_are_no_parameter() {
    let world = room();
    let parameter =
        Parameter::Material { materials: vec![FLOOR, FLOOR + 3], value: MaterialValue::Reflectance };
    let text = world.parameter(&parameter).unwrap_err().to_string();
    assert!(text.contains("Reflectance of material 3") && text.contains("same values"), "{text}");
}

#[test]
fn other_parameters_leave_a_scaled_and_turned_environment_as_it_is() {
    let build = || {
        let mut parts = cornell();
        let position = DVec3::new(0.1, 0.8, 0.3);
        parts.lights.push(LightSource::Point { position, intensity: vec3(0.3, 0.4, 0.5) });
        let sky = Image::from_fn(8, 4, 3, |x, y, c| 0.21 + 0.13 * ((3 * x + 5 * y + c) % 7) as f32);
        let rotation = Quat::from_rotation_y(0.7) * Quat::from_rotation_x(0.4);
        parts.environment = Some(EnvironmentMap { scale: 1.37, rotation, ..EnvironmentMap::new(sky) });
        World::new(parts).unwrap()
    };
    let view = cornell_view();
    let picture = |world: &World| render(world, &view, square(SIDE, 4)).0.data;
    let mut world = build();
    let before = picture(&world);
    let light = Parameter::Light { light: 0 };
    for k in 0..40 {
        world.set_parameter(&light, &[0.3 + 0.01 * k as f32, 0.4, 0.5]).unwrap();
    }
    world.set_parameter(&light, &[0.3, 0.4, 0.5]).unwrap();
    assert!(picture(&world) == before, "the light is as it was");
    // The same values once or often give the same bits: a fit that goes on sets them once.
    let sky = build().parameter(&Parameter::Environment).unwrap();
    let mut often = build();
    (0..40).for_each(|_| often.set_parameter(&Parameter::Environment, &sky).unwrap());
    let mut once = build();
    once.set_parameter(&Parameter::Environment, &sky).unwrap();
    assert!(picture(&often) == picture(&once), "once and often");
}
