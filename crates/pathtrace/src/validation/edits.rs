//! Worlds whose parts are replaced render the same bits as worlds that are built with these parts.

use super::scenes::{cornell, cornell_view, diffuse, glossy, quad, render, square};
use crate::{
    Boundary, BoundedMedium, EnvironmentMap, LightSource, Material, Parts, PathtraceError, Shape, Volume,
    World, WorldOptions,
};
use glam::{DAffine3, DVec3};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Energy, Null, ThinDielectric};

/// Parts of every kind.
fn parts() -> Parts {
    let mut parts = cornell();
    parts.volumes.push(cloud(1.0));
    let ball = Shape::Sphere { center: vec3(0.2, 0.6, 0.1), radius: 0.15 };
    let fog = parts.add(ball, Material::new(Bsdf::Null(Null)));
    parts.media.push(fogs(2.0));
    parts.boundaries.push(Boundary { instance: fog, interior: Some(0), exterior: None });
    let position = DVec3::new(0.1, 0.8, 0.3);
    parts.lights.push(LightSource::Point { position, intensity: Vec3f::splat(0.3) });
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(0.2)));
    parts
}

fn cloud(density: f32) -> Volume {
    let (lo, hi) = (DVec3::new(-0.4, 0.1, -0.3), DVec3::new(0.1, 0.5, 0.3));
    let mut volume = Volume::homogeneous(lo, hi, 3.0, Vec3f::splat(0.9), 0.2);
    volume.size = [5, 6, 7];
    volume.density = (0..210).map(|i| density * (i % 11) as f32 / 10.0).collect();
    volume
}

fn fogs(extinction: f32) -> BoundedMedium {
    BoundedMedium::homogeneous(vec3(extinction, 1.0, 0.5), Vec3f::splat(0.8), 0.0)
}

/// Asserts that an edited world renders as one of the edited parts, and not as it did.
fn check(
    name: &str,
    from: &dyn Fn() -> Parts,
    edit: &dyn Fn(&mut World) -> Result<(), PathtraceError>,
    change: &dyn Fn(&mut Parts),
) {
    let picture = |world: &World| render(world, &cornell_view(), square(12, 4)).0.data;
    let mut edited = World::new(from()).unwrap();
    let before = picture(&edited);
    edit(&mut edited).unwrap();
    let mut parts = from();
    change(&mut parts);
    let after = picture(&edited);
    assert!(after == picture(&World::new(parts).unwrap()), "{name}: other bits than a new world");
    assert!(after != before, "{name}: nothing changed");
}

#[test]
fn edited_worlds_render_as_new_ones() {
    let metal = || Material::new(glossy(0.9, 0.3, 1.0, Energy::Compensated));
    check("material", &parts, &|w| w.set_material(3, &metal()), &|p| p.materials[3] = metal());
    // A wall becomes a light; the lamp ceases to be one.
    let glowing = || Material::new(diffuse(0.2, 0.2, 0.2)).emitting(vec3(0.3, 0.5, 1.0));
    check("a new light", &parts, &|w| w.set_material(1, &glowing()), &|p| p.materials[1] = glowing());
    let dark = || Material::new(diffuse(0.1, 0.1, 0.1));
    check("a light less", &parts, &|w| w.set_material(5, &dark()), &|p| p.materials[5] = dark());
    check("volume", &parts, &|w| w.set_volume(0, cloud(2.0)), &|p| p.volumes[0] = cloud(2.0));
    let density = cloud(0.3).density;
    check("voxels", &parts, &|w| w.set_density(0, &density), &|p| p.volumes[0].density.clone_from(&density));
    check("medium", &parts, &|w| w.set_medium(0, fogs(7.0)), &|p| p.media[0] = fogs(7.0));
    let sheet = || {
        let one = Vec3f::splat(1.0);
        let glass = Bsdf::ThinDielectric(ThinDielectric { ior: 1.5, reflectance: one, transmittance: one });
        let mut all = parts().materials;
        (all[3], all[5]) = (Material::new(glass), Material::new(diffuse(0.1, 0.1, 0.1)));
        all.push(metal());
        all
    };
    check("materials", &parts, &|w| w.set_materials(sheet(), None), &|p| p.materials = sheet());
    let boundary = |p: &Parts| Boundary { interior: Some(1), ..p.boundaries[0] };
    check(
        "media",
        &parts,
        &|w| w.set_media(vec![cloud(2.0)], vec![fogs(1.0), fogs(5.0)], &[boundary(&parts())], None),
        &|p| {
            p.volumes = vec![cloud(2.0)];
            p.media = vec![fogs(1.0), fogs(5.0)];
            p.boundaries = vec![boundary(p)];
        },
    );
    let glass = || Parts { materials: sheet(), ..parts() };
    check("no media", &glass, &|w| w.set_media(Vec::new(), Vec::new(), &[], None), &|p| {
        (p.volumes, p.media, p.boundaries) = Default::default();
    });
    let lamp = [LightSource::Directional { direction: vec3(0.1, 0.2, 1.0), irradiance: Vec3f::splat(2.0) }];
    let sky = || Some(EnvironmentMap::constant(vec3(0.1, 0.5, 0.2)));
    check("lights", &parts, &|w| w.relight(&lamp, sky()), &|p| {
        p.lights = lamp.to_vec();
        p.environment = sky();
    });
    let lit = || Parts { lights: lamp.to_vec(), ..parts() };
    check("environment alone", &lit, &|w| w.set_environment(sky()), &|p| p.environment = sky());
    let under_sky = || Parts { environment: sky(), ..lit() };
    check("no environment", &under_sky, &|w| w.set_environment(None), &|p| p.environment = None);
}

#[test]
fn edits_of_materials_media_and_lights_leave_all_hierarchies_where_they_are() {
    let slot = super::library::slot();
    let textured =
        photofit_scene::Material { base_color_texture: Some(slot), ..photofit_scene::Material::clay() };
    let mut scene = super::library::scene(photofit_geometry::shapes::uv_sphere(12, 6), textured);
    scene.images.push(photofit_scene::TextureImage {
        width: 2,
        height: 2,
        texels: vec![[9; 4]; 4],
        ..Default::default()
    });
    let mut with_library = parts();
    let ball = Shape::Mesh(scene.primitives[0].mesh.clone());
    with_library.library = Some(photofit_scene::SurfaceLibrary::new(&scene));
    with_library.add(ball, Material::from_library(0));
    let mut world = World::new(with_library).unwrap();
    let allocations = |world: &World| -> Vec<*const photofit_rays::Accel> {
        world.hierarchy.accels.iter().map(std::sync::Arc::as_ptr).collect()
    };
    let before = allocations(&world);
    let glowing = Material::new(diffuse(0.2, 0.2, 0.2)).emitting(vec3(0.3, 0.5, 1.0));
    world.set_material(1, &glowing).unwrap();
    world.set_texels(0, &[[0.5; 4]; 4]).unwrap();
    world.set_density(0, &cloud(0.3).density).unwrap();
    world.set_medium(0, fogs(7.0)).unwrap();
    world.relight(&[], Some(EnvironmentMap::constant(vec3(0.1, 0.5, 0.2)))).unwrap();
    assert!(!before.is_empty() && allocations(&world) == before);
    // A pose in which nothing moves keeps them, too; new geometry does not.
    let p = parts();
    let mut world = World::new(parts()).unwrap();
    let before = allocations(&world);
    world.set_pose(Vec::new(), &p.instances).unwrap();
    assert_eq!(allocations(&world), before);
    world.set_geometry(p.shapes, &p.instances).unwrap();
    assert!(allocations(&world) != before, "the comparison notices a new hierarchy");
}

#[test]
fn new_geometry_renders_as_in_a_new_world() {
    // Farther off and larger: another render frame, too.
    let away = DAffine3::from_translation(DVec3::new(0.01, -0.02, 0.03)) * DAffine3::from_rotation_y(0.1);
    let moved = |p: &mut Parts| {
        p.instances.iter_mut().for_each(|i| i.transform = away * i.transform);
        let wall = quad(vec3(-0.2, 0.1, 0.3), vec3(0.1, 0.0, 0.0), vec3(0.0, 0.3, 0.0));
        p.shapes[3] = Shape::Mesh(wall);
    };
    let mut new = parts();
    moved(&mut new);
    check("geometry", &parts, &|w| w.set_geometry(new.shapes.clone(), &new.instances), &moved);
    let far =
        |p: &mut Parts| p.instances.iter_mut().for_each(|i| i.transform.translation += DVec3::splat(100.0));
    let back = || {
        let mut parts = parts();
        far(&mut parts);
        parts
    };
    let near = parts();
    check("from far off", &back, &|w| w.set_geometry(near.shapes.clone(), &near.instances), &|p| {
        p.instances = near.instances.clone();
    });
}

/// Many balls of one mesh, each in its place, a floor, and a second mesh that stands twice.
fn crowd() -> Parts {
    let mut parts = cornell();
    let fine = || Shape::Mesh(photofit_geometry::shapes::icosphere(24));
    parts.add(fine(), Material::new(diffuse(0.7, 0.3, 0.2)));
    let ball = parts.instances.len() - 1;
    let place = |x: f64, y: f64| {
        DAffine3::from_translation(DVec3::new(x, y, 0.1)) * DAffine3::from_scale(DVec3::splat(0.12))
    };
    parts.instances[ball].transform = place(-0.3, 0.2);
    parts.instances.push(crate::Instance { transform: place(0.2, 0.6), ..parts.instances[ball] });
    parts
}

#[test]
fn a_pose_builds_what_changed_alone() {
    let (parts, picture) = (crowd(), |world: &World| render(world, &cornell_view(), square(12, 4)).0.data);
    let mut world = World::new(crowd()).unwrap();
    let before = picture(&world);
    let ball = parts.instances.len() - 1;
    let (shape, count) = (parts.instances[ball].shape, parts.instances.len());
    let moved = |instances: &mut Vec<crate::Instance>, k: usize| {
        let turn = DAffine3::from_rotation_y(0.4);
        instances[k].transform =
            DAffine3::from_translation(DVec3::new(0.05, 0.1, 0.0)) * instances[k].transform * turn;
    };
    // What stands more than once has a structure of its own: moving it builds nothing.
    let mut instances = parts.instances.clone();
    moved(&mut instances, ball);
    assert_eq!(world.set_pose(Vec::new(), &instances).unwrap(), 0);
    let fresh = World::new(Parts { instances: instances.clone(), ..crowd() }).unwrap();
    let after = picture(&world);
    assert!(after == picture(&fresh) && after != before);
    // A wall stands once: it is merged with all others that do.
    moved(&mut instances, 1);
    assert_eq!(world.set_pose(Vec::new(), &instances).unwrap(), 1);
    let fresh = World::new(Parts { instances: instances.clone(), ..crowd() }).unwrap();
    assert!(picture(&world) == picture(&fresh));
    // A deformed mesh builds its own structure.
    let mut mesh = photofit_geometry::shapes::icosphere(24);
    mesh.positions.iter_mut().for_each(|p| p.y *= 1.0 + 0.3 * p.x);
    let deformed = || (shape, Shape::Mesh(mesh.clone()));
    assert_eq!(world.set_pose(vec![deformed()], &instances).unwrap(), 1);
    let mut shapes = crowd().shapes;
    shapes[shape] = deformed().1;
    let fresh = World::new(Parts { instances: instances.clone(), shapes, ..crowd() }).unwrap();
    assert!(picture(&world) == picture(&fresh));
    // A shape that grows too large for the merged structure leaves it.
    let large = || (shape, Shape::Mesh(photofit_geometry::shapes::icosphere(60)));
    let small = || (shape, Shape::Mesh(photofit_geometry::shapes::icosphere(2)));
    for (new, built) in [(small(), 1), (large(), 2)] {
        assert_eq!(world.set_pose(vec![new.clone()], &instances).unwrap(), built);
        let mut shapes = crowd().shapes;
        shapes[shape] = new.1;
        let fresh = World::new(Parts { instances: instances.clone(), shapes, ..crowd() }).unwrap();
        assert!(picture(&world) == picture(&fresh));
    }
    assert_eq!(world.set_pose(vec![deformed()], &instances).unwrap(), 1);
    // Faults leave the world as it is.
    let now = picture(&world);
    let mut flat = instances.clone();
    flat[ball].transform = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let mut other = instances.clone();
    other[ball].material = 0;
    for (shapes, instances, words) in [
        (vec![deformed()], &flat, "three dimensions"),
        (Vec::new(), &other, "in their order"),
        (vec![(count + 9, deformed().1)], &instances, "is not there"),
        (vec![deformed(), deformed()], &instances, "named twice"),
    ] {
        let text = world.set_pose(shapes, instances).expect_err(words).to_string();
        assert!(text.contains(words), "{words} in {text}");
    }
    assert!(picture(&world) == now);
}

#[test]
fn grids_of_a_pose_pass_through_as_many_cells_as_those_of_a_world() {
    // Signs take turns: there is surface in every cell.
    let grid = |side: usize| Shape::DistanceGrid {
        size: [side; 3],
        values: (0..side.pow(3))
            .map(|i| (i % side + i / side % side + i / side / side) % 2)
            .map(|odd| 1.0 - 2.0 * odd as f32)
            .collect(),
        smooth: false,
    };
    let two = || {
        let mut parts = Parts { environment: parts().environment, ..Parts::default() };
        for _ in 0..2 {
            parts.add(grid(3), Material::new(diffuse(0.5, 0.5, 0.5)));
        }
        parts
    };
    let mut world = World::new(two()).unwrap();
    let picture = |world: &World| render(world, &cornell_view(), square(8, 2)).0.data;
    let before = picture(&world);
    let large = vec![(0, grid(130)), (1, grid(130))];
    let text = world.set_pose(large, &two().instances).unwrap_err().to_string();
    assert!(text.starts_with("shape 1") && text.contains("they may pass through"), "{text}");
    assert!(picture(&world) == before, "an edit that fails changes nothing");
    assert!(world.set_pose(vec![(0, grid(4))], &two().instances).is_ok());
    assert!(picture(&world) != before);
}

#[test]
fn bad_edits_change_nothing() {
    let mut world = World::new(parts()).unwrap();
    let picture = |world: &World| render(world, &cornell_view(), square(8, 2)).0.data;
    let before = picture(&world);
    let negative = Material::new(diffuse(0.1, 0.1, 0.1)).emitting(vec3(-1.0, 0.0, 0.0));
    let flat = |p: &Parts| {
        let mut instances = p.instances.clone();
        instances[0].transform = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
        instances
    };
    let p = parts();
    let faults = [
        (world.set_material(99, &Material::new(diffuse(0.5, 0.5, 0.5))), "99 is not there"),
        (world.set_material(0, &negative), "emission"),
        (world.set_material(0, &Material::from_library(0)), "library material 0"),
        (world.set_materials(p.materials[..3].to_vec(), None), "material 3 is not there"),
        (world.set_materials(vec![Material::from_library(0); 9], None), "library material 0"),
        (world.set_media(vec![cloud(-1.0)], Vec::new(), &[], None), "volume 0"),
        (world.set_media(Vec::new(), Vec::new(), &p.boundaries, None), "medium 0"),
        (world.set_volume(3, cloud(1.0)), "3 is not there; the index must be below 1"),
        (world.set_density(0, &[1.0]), "there are 1 densities"),
        (world.set_density(0, &[f32::NAN; 210]), "finite"),
        (world.set_medium(1, fogs(1.0)), "1 is not there"),
        (world.set_geometry(p.shapes.clone(), &p.instances[1..]), "instances"),
        (world.set_geometry(p.shapes.clone(), &flat(&p)), "three dimensions"),
        (world.relight(&[], Some(EnvironmentMap::constant(vec3(-1.0, 0.0, 0.0)))), "environment"),
        (world.set_environment(Some(EnvironmentMap::constant(vec3(-1.0, 0.0, 0.0)))), "environment"),
    ];
    for (result, words) in faults {
        let text = result.expect_err(words).to_string();
        assert!(text.contains(words), "{words} in {text}");
    }
    assert!(picture(&world) == before, "an edit that fails changes nothing");
}

/// A ball of a library material that bounds fog: it must stay whole.
#[test]
fn edits_of_a_library_that_fail_change_nothing() {
    use photofit_scene::{AlphaMode, Material as SceneMaterial, Scene, SurfaceLibrary};
    let of = |materials: Vec<SceneMaterial>| {
        let mesh = photofit_geometry::shapes::icosphere(4);
        Scene { materials, ..super::library::scene(mesh, SceneMaterial::clay()) }
    };
    let red = SceneMaterial { base_color: [0.9, 0.1, 0.1, 0.5], ..SceneMaterial::clay() };
    let glowing = SceneMaterial { emissive: [2.0; 3], ..red.clone() };
    let parts = |scene: &Scene| {
        let mut parts = Parts {
            environment: Some(EnvironmentMap::constant(Vec3f::splat(1.0))),
            library: Some(SurfaceLibrary::new(scene)),
            ..Parts::default()
        };
        let ball = parts.add(Shape::Mesh(scene.primitives[0].mesh.clone()), Material::from_library(0));
        parts.media.push(fogs(2.0));
        parts.boundaries.push(Boundary { instance: ball, interior: Some(0), exterior: None });
        parts
    };
    let picture = |world: &World| render(world, &cornell_view(), square(8, 4)).0.data;
    let mut world = World::new(parts(&of(vec![SceneMaterial::clay()]))).unwrap();
    let before = picture(&world);
    let masked = SceneMaterial { alpha_mode: AlphaMode::Mask { cutoff: 0.9 }, ..glowing.clone() };
    for (other, words) in [(of(vec![masked]), "cut-outs"), (of(Vec::new()), "library material 0")] {
        let edit = |library: &mut SurfaceLibrary| *library = SurfaceLibrary::new(&other);
        let text = world.edit_library(edit).expect_err(words).to_string();
        assert!(text.contains(words), "{words} in {text}");
        assert!(picture(&world) == before, "{words}: an edit that fails changes nothing");
    }
    let other = of(vec![glowing]);
    world.edit_library(|library| *library = SurfaceLibrary::new(&other)).unwrap();
    assert!(picture(&world) == picture(&World::new(parts(&other)).unwrap()), "and the next one is whole");
}

#[test]
fn loose_majorants_change_noise_alone() {
    let picture = |majorant_factor: f32, spp: u32| {
        let options = WorldOptions { majorant_factor, ..WorldOptions::default() };
        let world = World::with_options(parts(), options).unwrap();
        render(&world, &cornell_view(), square(16, spp))
    };
    let (tight, loose) = (picture(1.0, 256), picture(4.0, 256));
    assert!(tight.0.data != loose.0.data, "other collisions");
    super::statistics::agree("majorants", (&tight.0, &tight.1, 256), (&loose.0, &loose.1, 256));
    for factor in [0.5, f32::NAN, 1e6] {
        let options = WorldOptions { majorant_factor: factor, ..WorldOptions::default() };
        let text = World::with_options(parts(), options).unwrap_err().to_string();
        assert!(text.contains("majorant factor"), "{text}");
    }
}
