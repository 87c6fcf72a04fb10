//! Passes and rates against maps and options that need them or not.

use super::*;
use crate::candidate::SurfaceClass;
use crate::engine::cpu::Chain as _;
use crate::engine::surface::Surface;
use photofit_geometry::{Weld, shapes};
use photofit_raster::Maps as Texels;
use photofit_scene::{Extensions, Instance, Material, Primitive, Transmission};
use photofit_shading::Sides;

pub(crate) fn scene(material: Material) -> Scene {
    Scene {
        primitives: vec![Primitive { mesh: shapes::cube(), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![material],
        ..Scene::default()
    }
}

/// A sheet with texels that `paint` changes, from the number of the texel.
pub(crate) fn candidate(mode: AlphaMode, paint: impl Fn(usize, &mut [f32; CHANNELS])) -> Candidate {
    let mesh = shapes::quad_grid(2, 2);
    let mut maps = Texels::filled(4, 4, crate::bake::blank_texel());
    maps.texels.iter_mut().enumerate().for_each(|(i, t)| paint(i, t));
    let n = mesh.positions.len();
    let class = vec![0; mesh.triangles.len()];
    Candidate::new(
        &mesh,
        &Weld::identity(n),
        class,
        vec![SurfaceClass { alpha: mode, sides: Sides::Both, ..SurfaceClass::default() }],
        maps,
    )
}

/// The plan of 100 steps against rasterized pictures, or of none.
pub(crate) fn planned(scene: &Scene, candidate: &Candidate, steps: u64) -> SurfacePlan {
    SurfacePlan::new(scene, candidate, Asked { steps, moves: true, reference: ReferenceKind::RASTERIZED })
}

#[test]
fn an_opaque_scene_runs_one_layer_and_no_blending() {
    let fit = |scene: &Scene, candidate: &Candidate| planned(scene, candidate, 100);
    let plan = fit(&scene(Material::clay()), &candidate(AlphaMode::Opaque, |_, _| {}));
    assert_eq!(plan.passes.max_layers, 1);
    assert!(!plan.fitted[channel::ALPHA]);
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    let leaf = Material { alpha_mode: mask, ..Material::clay() };
    let masked = fit(&scene(leaf), &candidate(mask, |_, _| {}));
    assert!(masked.fades && masked.fitted[channel::ALPHA] && !plan.fades);
    // Glass beside masks is drawn by an alpha that is not written.
    let glass = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        ..Extensions::default()
    };
    let glass = scene(Material { extensions: Some(Box::new(glass)), ..Material::clay() });
    assert!(!fit(&glass, &candidate(AlphaMode::Blend, |_, _| {})).fitted[channel::ALPHA]);
    let glass = Material { alpha_mode: AlphaMode::Blend, ..Material::clay() };
    let plan = fit(&scene(glass), &candidate(AlphaMode::Blend, |_, _| {}));
    assert!(!plan.fades);
    assert!(plan.passes.max_layers > 1 && plan.fitted[channel::ALPHA]);
}

#[test]
fn frozen_positions_run_no_silhouettes() {
    let (clay, sheet) = (scene(Material::clay()), candidate(AlphaMode::Opaque, |_, _| {}));
    let asked = Asked { steps: 100, moves: false, reference: ReferenceKind::RASTERIZED };
    for frozen in [planned(&clay, &sheet, 0), SurfacePlan::new(&clay, &sheet, asked)] {
        assert!(!frozen.passes.position_gradients && !frozen.passes.antialias);
    }
    let passes = planned(&clay, &sheet, 100).passes;
    assert!(passes.position_gradients && passes.antialias);
}

#[test]
fn flat_normals_and_constant_maps_are_skipped() {
    let clay = scene(Material::clay());
    let sheet = candidate(AlphaMode::Opaque, |_, _| {});
    let flat = planned(&clay, &sheet, 0).passes;
    assert!(!flat.normal_map && !flat.map_gradients);
    assert!(
        planned(&clay, &sheet, 100).passes.normal_map,
        "a shape that moves does not keep its normals flat"
    );
    let paint = |i: usize, t: &mut [f32; CHANNELS]| t[channel::NORMAL] = 0.1 * (i % 2) as f32;
    let bent = planned(&clay, &candidate(AlphaMode::Opaque, paint), 100);
    assert!(bent.passes.normal_map && bent.passes.map_gradients);
    assert!(bent.fitted[channel::NORMAL + 2] && !bent.fitted[0]);
}

#[test]
fn what_coarse_mip_levels_fit_beyond_the_base_is_told() {
    let clay = scene(Material::clay());
    let mut sheet = candidate(AlphaMode::Opaque, |_, _| {});
    for free in [false, true] {
        if free {
            sheet.free_mips();
        }
        let plan = planned(&clay, &sheet, 100);
        let surface = Surface::new(sheet.clone(), &plan);
        let told = rows::surface(&surface.work(100));
        assert_eq!(rows::surface(&plan.work(100)), told, "free: {free}");
        let groups = surface.groups();
        let moved = groups.iter().any(|g| g.rates.get(channel::ROUGHNESS).is_some_and(|r| *r > 0.0));
        assert_eq!(moved, free, "its rates say what is fitted");
        let row = |what| told.iter().find(|i| i.what == what).expect("a row");
        assert_eq!(row("roughness gradients").runs, free.into(), "{told:?}");
        let maps = &row("map gradients").why;
        assert!(maps.contains("3 of 16") && maps.contains("4 in coarse mip levels") == free, "{maps}");
    }
    assert!(rows::free_mips([16, 64]).why.contains("coarse ones at 5 times the rate"));
}
