//! Determinism, stopping and bad input.

use super::{World, go_on, patches, sheet, size};
use crate::bake::{BakeError, BakeSettings, ReferenceSurface, Target, bake};
use crate::visibility::Visibility;
use photofit_geometry::{Mesh, shapes};
use photofit_rays::AccelError;
use photofit_scalar::{Vec3f, vec2};
use photofit_scene::{FlatScene, Material, SurfaceLibrary};
use std::ops::ControlFlow;

#[test]
fn results_do_not_depend_on_threads_and_a_bake_can_be_stopped() {
    let mut world = World::default();
    world.add(&shapes::displaced_sphere(12, 0.2, 3, 5), Material { double_sided: true, ..Material::clay() });
    let target = patches(&shapes::displaced_sphere(3, 0.2, 3, 5));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let seen = world.visibility();
            let baked = world.bake(&seen, &target, &size(64));
            (seen, baked.maps, baked.valid, baked.statistics)
        })
    };
    assert!(run(1) == run(3), "results differ");
    let stop = |share: f32| if share > 0.3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let seen = world.visibility();
    assert_eq!(
        world.with(|r| bake(r, &seen, &Target::new(&target), &size(64), &stop)).unwrap_err(),
        BakeError::Stopped
    );
}

#[test]
fn bad_input_is_refused() {
    let mut world = World::default();
    world.add(&sheet(1), Material::clay());
    let seen = Visibility::everything(2);
    let check = |target: &Mesh, seen: &Visibility, settings: &BakeSettings, expected: &str| {
        let error =
            world.with(|r| bake(r, seen, &Target::new(target), settings, &go_on)).unwrap_err().to_string();
        assert_eq!(error, expected);
    };
    let good = sheet(1);
    let broken = |edit: fn(&mut Mesh)| {
        let mut m = sheet(1);
        edit(&mut m);
        m
    };
    let s = size(4);
    check(&Mesh::default(), &seen, &s, "the target has no triangles");
    check(&broken(|m| m.tangents.clear()), &seen, &s, "target: 0 tangents, expected 4");
    check(&broken(|m| m.positions[2].y = f32::NAN), &seen, &s, "target: position of vertex 2 is not finite");
    check(&broken(|m| m.uvs[1].x = f32::INFINITY), &seen, &s, "target: uv of vertex 1 is not finite");
    check(
        &broken(|m| m.triangles[1][0] = 9),
        &seen,
        &s,
        "target: triangle 1: vertex index 9 is out of range, there are 4 vertices",
    );
    check(&good, &Visibility::everything(1), &s, "reference: 1 sides' visibility, expected 2");
    check(&good, &seen, &size(0), "width is 0: must be 1 to 16384");
    let far = BakeSettings { max_distance: f32::NAN, ..s };
    check(&good, &seen, &far, "max_distance is NaN: must lie in (0, 10]");

    let refuse = |edit: fn(&mut FlatScene)| {
        let mut flat = world.flat.clone();
        edit(&mut flat);
        let library = SurfaceLibrary::new(&world.scene);
        ReferenceSurface::new(&flat, &world.scene.materials, &library, &[]).unwrap_err()
    };
    assert_eq!(
        refuse(|f| f.mesh.positions[3].z = f32::NAN),
        BakeError::Geometry { mesh: "reference", source: AccelError::NonFinite { vertex: 3 } }
    );
    assert_eq!(
        refuse(|f| f.triangle_material[1] = 4),
        BakeError::Material { triangle: 1, material: 4, materials: 1 }
    );
    assert_eq!(refuse(|f| f.mesh.triangles.clear()), BakeError::Empty { what: "reference" });
    assert!(matches!(refuse(|f| f.mesh.normals.truncate(1)), BakeError::Length { what: "normals", .. }));
}

#[test]
fn degenerate_targets_are_survived() {
    let mut world = World::default();
    world.add(&sheet(2), Material::clay());
    let mut target = sheet(2);
    target.triangles.extend([[0, 0, 1], [2, 2, 2]]);
    target.normals[4] = Vec3f::zero();
    target.tangents[4] = Vec3f::zero().extend(1.0);
    target.uvs[8] = vec2(7.0, -3.0);
    let baked = world.bake(&Visibility::everything(8), &target, &size(8));
    assert!(baked.maps.texels.iter().flatten().all(|x| x.is_finite()), "finite maps");
    assert!(baked.statistics.valid_texels > 30, "{:?}", baked.statistics);
}
