//! Materials of assets: normal maps, single-sided surfaces, light sampling that would miss light, faulty light.

use super::scenes::{looking, render, square, with_strategy};
use super::statistics::mean_of;
use crate::random::PixelRandom;
use crate::render::primary_ray;
use crate::{
    Aov, EnvironmentMap, LightSource, Parts, PathtraceError, RenderOptions, Renderer, Strategy, View, World,
};
use glam::DVec3;
use photofit_geometry::{Mesh, shapes};
use photofit_image::Image;
use photofit_scalar::{Vec3, Vec3f, vec3, vec4};
use photofit_scene::{
    Clearcoat, Extensions, Instance, MapKind, Material, Primitive, Scene, SurfaceLibrary, TextureImage,
    TextureSlot,
};

/// A scene of one mesh.
pub(super) fn scene(mesh: Mesh, material: Material) -> Scene {
    Scene {
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: Default::default() }],
        materials: vec![material],
        ..Scene::default()
    }
}

fn lit(scene: &Scene, radiance: f32) -> World {
    let environment = Some(EnvironmentMap::constant(Vec3f::splat(radiance)));
    World::new(Parts { environment, ..Parts::from_scene(scene) }).unwrap()
}

/// Bumps that lean by up to 60 degrees.
fn bumps() -> TextureImage {
    let texel = |i: usize| {
        let (x, y) = ((i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0);
        let lean = |t: f32| 0.61 * (t * 8.0 * std::f32::consts::TAU).sin();
        let (nx, ny) = (lean(x), lean(y));
        let nz = (1.0 - nx * nx - ny * ny).sqrt();
        let byte = |v: f32| ((0.5 * v + 0.5) * 255.0).round() as u8;
        [byte(nx), byte(ny), byte(nz), 255]
    };
    TextureImage { width: 64, height: 64, texels: (0..64 * 64).map(texel).collect(), ..Default::default() }
}

/// The first image, as it is.
pub(super) fn slot() -> TextureSlot {
    TextureSlot::new(0)
}

#[test]
fn mirrors_with_normal_maps_are_nowhere_black() {
    let material = Material { roughness: 0.0, normal_texture: Some(slot()), ..Material::default() };
    let mut scene = scene(shapes::uv_sphere(96, 48), material);
    scene.images.push(bumps());
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 0.75);
    // A white mirror in a white furnace: every ray ends in the light, after one reflection or more.
    let world = lit(&scene, 1.0);
    let options = RenderOptions { path: with_strategy(Strategy::Mis, 8), ..square(48, 16) };
    let (picture, _) = render(&world, &view, options);
    let values: Vec<f32> = (0..picture.pixels()).map(|i| picture.data[4 * i]).collect();
    let least = values.iter().fold(f32::INFINITY, |a, b| a.min(*b));
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    // What the narrow lobe scatters below the surface is lost.
    assert!(least > 0.9 && mean > 0.99, "darkest pixel {least}, mean {mean}");
    assert!(values.iter().all(|v| *v < 1.001), "a mirror makes no light");
    // Rough ones lose what they scatter below the surface and what microfacets hide from each other, and no more.
    for roughness in [0.1, 0.2, 0.4] {
        scene.materials[0].roughness = roughness;
        let world = lit(&scene, 1.0);
        let options = RenderOptions { path: with_strategy(Strategy::Mis, 8), ..square(24, 64) };
        let expected = expected_furnace(&world, &view, &options, 8, f64::from(roughness));
        let (picture, variance) = render(&world, &view, options);
        let (mean, error) = mean_of(&picture, &variance, 64, 0);
        assert!(
            (mean - expected).abs() < 4.0 * error + 1e-3,
            "roughness {roughness}: {mean} +- {error}, expected {expected}"
        );
        assert!(error < 2e-3 && expected < 0.9999, "roughness {roughness}: +- {error}, expected {expected}");
    }
}

/// Mean over the picture of what a convex white metal shows in a white furnace, from the geometry and the normals of the
/// world alone: its GGX lobe integrated by quadrature over half vectors, without what goes below the surface.
fn expected_furnace(world: &World, view: &View, options: &RenderOptions, spp: u32, roughness: f64) -> f64 {
    let camera = view.prepare(world);
    let pixels = options.width * options.height;
    let mut sum = 0.0;
    for pixel in 0..pixels {
        let mut numbers = PixelRandom::new(options.seed, pixel as u64);
        for sample in 0..spp {
            let at = [pixel % options.width, pixel / options.width];
            let ray = primary_ray(options, &camera, at, &numbers.sample(sample));
            sum += world.closest_where::<true>(&ray, |_| true).map_or(1.0, |hit| {
                let at = world.interaction::<true>(&ray, &hit);
                let wo = -ray.direction;
                let mut found = None;
                let material = world.material_at::<true>(&at, wo, &mut found);
                reflected(
                    roughness * roughness,
                    material.to_local(wo).cast(),
                    material.to_local(at.ng).cast(),
                )
            });
        }
    }
    sum / (pixels as f64 * f64::from(spp))
}

/// Part of uniform light above the normal `ng` that a perfectly reflecting GGX surface of roughness `alpha` around +z sends
/// to `wo` at once (Walter et al. 2007, Heitz 2014).
fn reflected(alpha: f64, wo: Vec3<f64>, ng: Vec3<f64>) -> f64 {
    const STEPS: [usize; 2] = [32, 64];
    let lambda = |w: Vec3<f64>| {
        let tan2 = (1.0 - w.z * w.z).max(0.0) / (w.z * w.z);
        0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
    };
    let mut sum = 0.0;
    for i in 0..STEPS[0] * STEPS[1] {
        let u = ((i % STEPS[0]) as f64 + 0.5) / STEPS[0] as f64;
        let phi = std::f64::consts::TAU * ((i / STEPS[0]) as f64 + 0.5) / STEPS[1] as f64;
        let cosine = (1.0 + alpha * alpha * u / (1.0 - u)).recip().sqrt();
        let sine = (1.0 - cosine * cosine).sqrt();
        let h = vec3(sine * phi.cos(), sine * phi.sin(), cosine);
        let wi = h * (2.0 * h.dot(wo)) - wo;
        if h.dot(wo) > 0.0 && wi.z > 0.0 && wi.dot(ng) > 0.0 {
            sum += h.dot(wo) / (wo.z * h.z * (1.0 + lambda(wo) + lambda(wi)));
        }
    }
    sum / (STEPS[0] * STEPS[1]) as f64
}

#[test]
fn smooth_mirrors_of_few_triangles_have_no_dark_rims() {
    let mut mesh = shapes::icosphere(2);
    mesh.normals = mesh.positions.clone();
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 0.75);
    for (clearcoat, colored) in [(false, false), (true, false), (false, true), (true, true)] {
        // Colours of vertices, all white: the material varies.
        mesh.colors = if colored { vec![vec4(1.0, 1.0, 1.0, 1.0); mesh.positions.len()] } else { Vec::new() };
        let mut material = Material { roughness: 0.0, ..Material::default() };
        if clearcoat {
            let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
            material.extensions =
                Some(Box::new(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
        }
        let world = lit(&scene(mesh.clone(), material), 1.0);
        let options = RenderOptions { path: with_strategy(Strategy::Mis, 8), ..square(48, 16) };
        let (picture, _) = render(&world, &view, options);
        let values: Vec<f32> = (0..picture.pixels()).map(|i| picture.data[4 * i]).collect();
        let least = values.iter().fold(f32::INFINITY, |a, b| a.min(*b));
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!(
            least > 0.9 && mean > 0.99,
            "coat {clearcoat}, colours {colored}: darkest pixel {least}, mean {mean}"
        );
        assert!(values.iter().all(|v| *v < 1.001), "a mirror makes no light");
    }
}

/// Shading normals at points of a ball of few triangles that the camera sees, and how many of them differ from those of its
/// vertices.
fn bent_normals(metallic: f32) -> (Vec<Vec3f>, usize) {
    let mut mesh = shapes::icosphere(2);
    mesh.normals = mesh.positions.clone();
    let world = lit(&scene(mesh, Material { metallic, ..Material::clay() }), 1.0);
    let camera = looking([0.0, 0.0, 3.0], [0.0; 3], 0.75).prepare(&world);
    let options = square(32, 1);
    let (mut found, mut bent) = (Vec::new(), 0);
    for pixel in 0..32 * 32 {
        let numbers = PixelRandom::new(0, pixel as u64).sample(0);
        let ray = primary_ray(&options, &camera, [pixel % 32, pixel / 32], &numbers);
        let Some(hit) = world.closest_where::<true>(&ray, |_| true) else { continue };
        let (at, wo) = (world.interaction::<true>(&ray, &hit), -ray.direction);
        let normal = world.material_at::<true>(&at, wo, &mut None).n;
        // Turned to the viewer, as the rasterizer's are, and that is all.
        bent += usize::from(normal != photofit_shading::face_viewer(at.ns, at.ng, wo));
        found.push(normal);
    }
    (found, bent)
}

#[test]
fn smooth_normals_are_those_of_the_vertices_but_on_metals() {
    let metal = bent_normals(1.0);
    assert!(metal.1 > 5, "{} normals are bent", metal.1);
    assert_eq!(bent_normals(0.7), metal, "more metal than not");
    for metallic in [0.0, 0.3] {
        assert_eq!(bent_normals(metallic).1, 0, "metalness {metallic}");
    }
}

#[test]
fn cameras_see_through_the_backs_of_single_sided_surfaces() {
    // A square of side 2 around the origin with +z in front.
    let square_mesh = || Mesh {
        positions: vec![
            vec3(-1.0, -1.0, 0.0),
            vec3(1.0, -1.0, 0.0),
            vec3(1.0, 1.0, 0.0),
            vec3(-1.0, 1.0, 0.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let alpha = |double_sided: bool, mirrored: bool, z: f32| {
        let mut scene = scene(square_mesh(), Material { double_sided, ..Material::clay() });
        if mirrored {
            scene.instances[0].transform = glam::Affine3A::from_scale(glam::vec3(-1.0, 1.0, 1.0));
        }
        let view = looking([0.0, 0.0, z], [0.0; 3], 0.2);
        let mut options = RenderOptions { aovs: vec![Aov::Instance], ..square(4, 4) };
        options.path.show_environment = false;
        let world = lit(&scene, 1.0);
        let mut renderer = Renderer::new(&world, &view, options).unwrap();
        while !renderer.pass(|| false).done {}
        let (alpha, id) =
            (renderer.picture().pixel(2, 2)[3], renderer.aov(Aov::Instance).unwrap().pixel(2, 2)[0]);
        assert!((alpha > 0.5) == (id > 0.5), "the auxiliary images agree");
        alpha
    };
    for (double_sided, mirrored, z, expected) in [
        (false, false, 3.0, 1.0),
        (false, false, -3.0, 0.0),
        (true, false, -3.0, 1.0),
        // Transforms that mirror turn the winding, not the side that is shown.
        (false, true, 3.0, 1.0),
        (false, true, -3.0, 0.0),
    ] {
        let found = alpha(double_sided, mirrored, z);
        assert!((found - expected).abs() < 1e-6, "{double_sided} {mirrored} {z}: {found}");
    }
    // A floor behind it lies in its shadow all the same, whichever side the light meets.
    for turn in [1.0_f32, -1.0] {
        let mut scene = scene(square_mesh(), Material::clay());
        let floor = Mesh {
            positions: square_mesh().positions.iter().map(|p| vec3(p.x, p.y, -1.0)).collect(),
            ..square_mesh()
        };
        scene.primitives.push(Primitive { mesh: floor, material: 0 });
        scene.instances.push(Instance { primitive: 1, transform: Default::default() });
        scene.instances[0].transform = glam::Affine3A::from_scale(glam::vec3(1.0, turn, turn));
        let mut parts = Parts::from_scene(&scene);
        parts
            .lights
            .push(LightSource::Directional { direction: vec3(0.0, 0.0, 1.0), irradiance: Vec3f::splat(1.0) });
        let world = World::new(parts).unwrap();
        let view: View = looking([3.0, 0.0, -0.5], [0.0, 0.0, -1.0], 0.05);
        let picture = render(&world, &view, square(4, 4)).0;
        assert!(picture.pixel(2, 2)[0] < 1e-6 && picture.pixel(2, 2)[3] > 0.5, "in shadow");
    }
}

#[test]
fn shadows_do_not_know_which_way_a_card_faces() {
    let plate = |half: f32, z: f32| Mesh {
        positions: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| vec3(half * x, half * y, z))
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    // A floor that a card hangs above, seen from below the card.
    let floor_under = |double_sided: bool, turned: bool, light: usize| {
        let mut scene = scene(plate(4.0, 0.0), Material { double_sided: true, ..Material::clay() });
        let mut card = plate(0.5, 1.0);
        if turned {
            card.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        scene.materials.push(Material { double_sided, ..Material::clay() });
        scene.primitives.push(Primitive { mesh: card, material: 1 });
        scene.instances.push(Instance { primitive: 1, transform: Default::default() });
        let mut parts = Parts::from_scene(&scene);
        let white = Vec3f::splat(1.0);
        match light {
            0 => parts
                .lights
                .push(LightSource::Directional { direction: vec3(0.0, 0.6, 0.8), irradiance: white }),
            1 => parts
                .lights
                .push(LightSource::Point { position: DVec3::new(0.2, 0.1, 3.0), intensity: white }),
            _ => parts.environment = Some(EnvironmentMap::constant(white)),
        }
        let world = World::new(parts).unwrap();
        let view = looking([3.0, 0.0, 0.8], [0.0, 0.0, 0.0], 0.5);
        let options = RenderOptions { path: with_strategy(Strategy::Mis, 1), ..square(24, 16) };
        let picture = render(&world, &view, options).0;
        (0..picture.pixels()).map(|i| picture.data[4 * i]).collect::<Vec<f32>>()
    };
    for light in 0..3 {
        let both = floor_under(true, false, light);
        let dark = both.iter().filter(|v| **v < 0.5 * both.iter().fold(0.0, |a: f32, b| a.max(*b))).count();
        assert!(dark > 10, "light {light}: the card casts a shadow, on {dark} pixels");
        for turned in [false, true] {
            assert_eq!(floor_under(false, turned, light), both, "light {light}, turned {turned}");
        }
    }
}

#[test]
fn light_sampling_alone_asks_for_the_plain_density() {
    let image = Image::from_fn(8, 4, 3, |x, _, _| if x == 2 { 30.0 } else { 0.5 });
    let scene = scene(shapes::icosphere(2), Material::clay());
    let world = |compensate| {
        let environment = Some(EnvironmentMap { compensate, ..EnvironmentMap::new(image.clone()) });
        World::new(Parts { environment, ..Parts::from_scene(&scene) }).unwrap()
    };
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 0.7);
    let options = RenderOptions { path: with_strategy(Strategy::Light, 2), ..square(4, 1) };
    let compensated = world(true);
    let error = Renderer::new(&compensated, &view, options.clone()).unwrap_err();
    assert!(
        matches!(error, PathtraceError::Invalid { .. }) && error.to_string().contains("compensate"),
        "{error}"
    );
    assert!(Renderer::new(&world(false), &view, options).is_ok());
    assert!(Renderer::new(&compensated, &view, square(4, 1)).is_ok(), "with BSDF sampling nothing is missed");
}

#[test]
fn light_that_is_not_finite_is_left_out_and_counted() {
    let mut parts = Parts::from_scene(&scene(shapes::icosphere(4), Material::clay()));
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 0.7);
    let run = |parts: Parts| {
        let world = World::new(parts).unwrap();
        let mut renderer = Renderer::new(&world, &view, square(8, 4)).unwrap();
        let mut progress = renderer.progress();
        while !progress.done {
            progress = renderer.pass(|| false);
        }
        let saved = renderer.save("scene", "");
        let mut again = Renderer::new(&world, &view, square(8, 4)).unwrap();
        again.resume("scene", &[""], &saved).unwrap();
        assert_eq!(again.progress().not_finite, progress.not_finite, "counts survive");
        (renderer.picture(), progress.not_finite)
    };
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let copy = || Parts {
        environment: parts.environment.clone(),
        ..Parts::from_scene(&scene(shapes::icosphere(4), Material::clay()))
    };
    let (picture, count) = run(copy());
    assert!(count == 0 && picture.data.iter().all(|v| v.is_finite()));
    let mut glaring = copy();
    let intensity = Vec3f::splat(3e38);
    glaring.lights.push(LightSource::Point { position: DVec3::new(0.0, 0.0, 1.05), intensity });
    let (picture, count) = run(glaring);
    assert!(count > 10, "{count}");
    assert!(picture.data.iter().all(|v| v.is_finite()), "the picture stays finite");
}

#[test]
fn an_edited_library_renders_as_a_new_one() {
    let ball = |base_color: [f32; 4], emissive: [f32; 3]| {
        scene(shapes::icosphere(4), Material { base_color, emissive, ..Material::clay() })
    };
    let from = ball([0.5, 0.5, 0.5, 1.0], [0.0; 3]);
    let to = ball([0.9, 0.2, 0.1, 1.0], [0.3, 0.1, 0.0]);
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 0.7);
    let picture = |world: &World| render(world, &view, square(8, 4)).0.data;
    let mut world = lit(&from, 1.0);
    let before = picture(&world);
    world.edit_library(|library| *library = SurfaceLibrary::new(&to)).unwrap();
    let after = picture(&world);
    assert!(after == picture(&lit(&to, 1.0)), "other bits than a new world");
    assert!(after != before, "nothing changed");
    // Texels, in floating point.
    let mut bumpy = ball([1.0; 4], [0.0; 3]);
    bumpy.primitives[0].mesh = shapes::uv_sphere(24, 12);
    bumpy.materials[0].base_color_texture = Some(slot());
    bumpy.images.push(bumps());
    let texels: Vec<[f32; 4]> = (0..64 * 64).map(|i| [(i % 64) as f32 / 63.0, 0.3, 0.7, 1.0]).collect();
    let mut world = lit(&bumpy, 1.0);
    let before = picture(&world);
    let texture = world.library().and_then(|l| l.texture_of(0, MapKind::BaseColor)).unwrap();
    world.set_texels(texture, &texels).unwrap();
    let after = picture(&world);
    let mut parts = Parts::from_scene(&bumpy);
    parts.library.as_mut().unwrap().set_texels(texture, &texels);
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    assert!(after == picture(&World::new(parts).unwrap()), "other bits than a new world");
    assert!(after != before, "nothing changed");
    for (texture, texels, words) in [
        (9, &texels[..], "9 is not there"),
        (texture, &texels[1..], "4095 texels for 64 x 64"),
        (texture, &[[0.5, f32::NAN, 0.5, 1.0]; 64 * 64][..], "texel 0 is [0.5, NaN"),
        (texture, &[[0.5, 0.5, f32::INFINITY, 1.0]; 64 * 64][..], "must be finite"),
    ] {
        let text = world.set_texels(texture, texels).expect_err(words).to_string();
        assert!(text.contains(words), "{words} in {text}");
    }
    assert!(after == picture(&world), "an edit that fails changes nothing");
    let mut plain = World::new(super::scenes::cornell()).unwrap();
    assert!(plain.edit_library(|_| ()).is_err(), "there is no library");
}
