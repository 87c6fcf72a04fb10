//! Passes and rates against maps and options that need them or not.

use super::*;
use crate::candidate::SurfaceClass;
use crate::engine::cpu::Chain as _;
use crate::engine::surface::Surface;
use photofit_geometry::{Weld, shapes};
use photofit_raster::Maps as Texels;
use photofit_scene::{AlphaMode, Instance, Material, Primitive, Scene};
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
pub(crate) fn planned(candidate: &Candidate, steps: u64) -> SurfacePlan {
    SurfacePlan::new(candidate, FitRequest { steps, moves: true, reference: ReferenceKind::RASTERIZED })
}

#[test]
fn an_opaque_surface_runs_one_layer_and_no_blending() {
    let fit = |candidate: &Candidate| planned(candidate, 100);
    let plan = fit(&candidate(AlphaMode::Opaque, |_, _| {}));
    assert_eq!(plan.passes.max_layers, 1);
    assert!(!plan.fitted[channel::ALPHA]);
    let masked = fit(&candidate(AlphaMode::Mask { cutoff: 0.5 }, |_, _| {}));
    assert!(masked.fades && masked.fitted[channel::ALPHA] && !plan.fades);
    let sheet = candidate(AlphaMode::Blend, |_, _| {});
    let plan = fit(&sheet);
    assert!(!plan.fades);
    assert!(plan.passes.max_layers > 1 && plan.fitted[channel::ALPHA]);
    // Glass is drawn by an alpha that is not written.
    let mut glass = sheet;
    glass.classes[0].see_through = true;
    let plan = fit(&glass);
    assert!(plan.passes.max_layers > 1 && !plan.fitted[channel::ALPHA] && !plan.passes.alpha_gradients);
    // Alpha of what stands beside it is written.
    for alpha in [AlphaMode::Blend, AlphaMode::Mask { cutoff: 0.5 }] {
        let mut both = glass.clone();
        both.classes.push(SurfaceClass { alpha, ..SurfaceClass::default() });
        both.class[0] = 1;
        assert!(fit(&both).fitted[channel::ALPHA], "{alpha:?}");
    }
}

#[test]
fn frozen_positions_run_no_silhouettes() {
    let sheet = candidate(AlphaMode::Opaque, |_, _| {});
    let asked = FitRequest { steps: 100, moves: false, reference: ReferenceKind::RASTERIZED };
    for frozen in [planned(&sheet, 0), SurfacePlan::new(&sheet, asked)] {
        assert!(!frozen.passes.position_gradients && !frozen.passes.antialias);
    }
    let passes = planned(&sheet, 100).passes;
    assert!(passes.position_gradients && passes.antialias);
}

#[test]
fn flat_normals_and_constant_maps_are_skipped() {
    let sheet = candidate(AlphaMode::Opaque, |_, _| {});
    let flat = planned(&sheet, 0).passes;
    assert!(!flat.normal_map && !flat.map_gradients);
    assert!(planned(&sheet, 100).passes.normal_map, "a shape that moves does not keep its normals flat");
    let paint = |i: usize, t: &mut [f32; CHANNELS]| t[channel::NORMAL] = 0.1 * (i % 2) as f32;
    let bent = planned(&candidate(AlphaMode::Opaque, paint), 100);
    assert!(bent.passes.normal_map && bent.passes.map_gradients);
    assert!(bent.fitted[channel::NORMAL + 2] && !bent.fitted[0]);
}

#[test]
fn samples_that_vary_and_are_not_fitted_are_told() {
    let told = |candidate: &Candidate| {
        let plan = planned(candidate, 100);
        let rows = rows::surface(&plan.work(100));
        assert_eq!(rows, rows::surface(&Surface::new(candidate.clone(), &plan).work(100)));
        let of = |what| rows.iter().find(|i| i.what == what).expect("a row").why.clone();
        [of("map gradients"), of("alpha gradients")]
    };
    let some = |i: usize| (i % 2) as f32;
    let [constant, _] = told(&candidate(AlphaMode::Opaque, |_, _| {}));
    assert!(constant.ends_with("3 of 13 samples of a texel; the others are constant"), "{constant}");
    let [occluded, _] = told(&candidate(AlphaMode::Opaque, |i, t| t[channel::OCCLUSION] = some(i)));
    assert!(
        occluded.ends_with("the others are constant; occlusion is carried along, not drawn"),
        "{occluded}"
    );
    let [unlit, _] = told(&candidate(AlphaMode::Opaque, |i, t| t[channel::SPECULAR_SUPPRESSION] = some(i)));
    assert!(unlit.contains("; held as they are: specular suppression; the others"), "{unlit}");
    let mut glass = candidate(AlphaMode::Blend, |i, t| t[channel::ALPHA] = 0.5 + 0.2 * some(i));
    glass.classes[0].see_through = true;
    let [maps, alpha] = told(&glass);
    assert!(maps.contains("held as they are: alpha") && alpha == "held as it is", "{maps}, {alpha}");
}

#[test]
fn what_coarse_mip_levels_fit_beyond_the_base_is_told() {
    let mut sheet = candidate(AlphaMode::Opaque, |_, _| {});
    for free in [false, true] {
        if free {
            sheet.free_mips();
        }
        let plan = planned(&sheet, 100);
        let surface = Surface::new(sheet.clone(), &plan);
        let told = rows::surface(&surface.work(100));
        assert_eq!(rows::surface(&plan.work(100)), told, "free: {free}");
        let groups = surface.groups();
        let moved = groups.iter().any(|g| g.rates.get(channel::ROUGHNESS).is_some_and(|r| *r > 0.0));
        assert_eq!(moved, free, "its rates say what is fitted");
        let row = |what| told.iter().find(|i| i.what == what).expect("a row");
        assert_eq!(row("roughness gradients").runs, free.into(), "{told:?}");
        let maps = &row("map gradients").why;
        assert!(maps.contains("3 of 13") && maps.contains("4 in coarse mip levels") == free, "{maps}");
    }
    assert!(rows::free_mips([16, 64], true).why.contains("coarse ones at 5 times the rate"));
}
