//! What plans say, against assets and options that make each line true or false.

use super::*;
use crate::candidate::SurfaceClass;
use photofit_geometry::{Weld, shapes};
use photofit_raster::Maps as Texels;
use photofit_raster::loss::Loss;
use photofit_scene::{Extensions, Instance, Primitive, Sampler, Sheen, TextureImage, Transmission, Volume};
use photofit_shading::Sides;

fn scene(material: Material) -> Scene {
    Scene {
        primitives: vec![Primitive { mesh: shapes::cube(), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![material],
        ..Scene::default()
    }
}

/// A sheet with texels that `paint` changes, from the number of the texel.
fn candidate(mode: AlphaMode, paint: impl Fn(usize, &mut [f32; CHANNELS])) -> Candidate {
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

fn runs(plan: &FitPlan, what: &str) -> Runs {
    plan.items().into_iter().find(|i| i.what == what).unwrap_or_else(|| panic!("no item {what}")).runs
}

fn fit(scene: &Scene, candidate: &Candidate) -> FitPlan {
    FitPlan::new(scene).with_options(100, ReferenceKind::RASTERIZED, &Lighting::Mixed).with_maps(candidate)
}

/// One line of a plan and what makes it so.
type Case<'a> = (&'a str, Material, AlphaMode, fn(usize, &mut [f32; CHANNELS]));

#[test]
fn passes_follow_from_the_materials() {
    let glow = Material { emissive: [1.0, 0.0, 0.0], ..Material::clay() };
    let cases: [Case<'_>; 4] = [
        (
            "transparent layers",
            Material { alpha_mode: AlphaMode::Blend, ..Material::clay() },
            AlphaMode::Blend,
            |_, _| {},
        ),
        (
            "alpha gradients",
            Material { alpha_mode: AlphaMode::Blend, ..Material::clay() },
            AlphaMode::Blend,
            |_, _| {},
        ),
        ("emission", glow, AlphaMode::Opaque, |_, t| t[channel::EMISSIVE] = 1.0),
        ("metalness gradients", Material { metallic: 1.0, ..Material::clay() }, AlphaMode::Opaque, |i, t| {
            t[channel::METALLIC] = (i % 2) as f32;
        }),
    ];
    let clay = scene(Material::clay());
    let plain = fit(&clay, &candidate(AlphaMode::Opaque, |_, _| {}));
    for (what, material, mode, paint) in cases {
        assert_eq!(runs(&FitPlan::new(&clay), what), Runs::No, "clay skips {what}");
        assert_eq!(runs(&plain, what), Runs::No, "clay skips {what}");
        let with = scene(material);
        assert_ne!(runs(&FitPlan::new(&with), what), Runs::No, "{what} may run");
        assert_eq!(runs(&fit(&with, &candidate(mode, paint)), what), Runs::Yes, "{what} runs");
    }
}

#[test]
fn backs_are_told_once_they_are_measured() {
    let plan = FitPlan::new(&scene(Material::clay()));
    assert!(plan.items().iter().all(|i| i.what != "single-sided backs"));
    let told = |seen, share| {
        let plan = plan.clone().with_backs(Some(seen), share);
        plan.items().into_iter().find(|i| i.what == "single-sided backs").expect("a row")
    };
    assert_eq!((told(0.0, 0.0).runs, &*told(0.0, 0.0).why), (Runs::No, "none is seen"));
    let some = told(0.0004, 0.0);
    assert!(some.runs == Runs::No && some.why.contains("0.04%"), "{}", some.why);
    let shown = told(0.034, 0.25);
    assert!(
        shown.runs == Runs::Yes && shown.why.contains("3.4%") && shown.why.contains("25%"),
        "{}",
        shown.why
    );
}

#[test]
fn an_opaque_scene_runs_one_layer_and_no_blending() {
    let plan = fit(&scene(Material::clay()), &candidate(AlphaMode::Opaque, |_, _| {}));
    assert_eq!(plan.passes().max_layers, 1);
    assert!(!plan.fitted()[channel::ALPHA]);
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    let leaf = Material { alpha_mode: mask, ..Material::clay() };
    let masked = fit(&scene(leaf), &candidate(mask, |_, _| {}));
    assert!(masked.fades() && masked.fitted()[channel::ALPHA] && !plan.fades());
    // Glass beside masks is drawn by an alpha that is not written.
    let glass = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        ..Extensions::default()
    };
    let glass = scene(Material { extensions: Some(Box::new(glass)), ..Material::clay() });
    assert!(!fit(&glass, &candidate(AlphaMode::Blend, |_, _| {})).fitted()[channel::ALPHA]);
    let glass = Material { alpha_mode: AlphaMode::Blend, ..Material::clay() };
    let plan = fit(&scene(glass), &candidate(AlphaMode::Blend, |_, _| {}));
    assert!(!plan.fades());
    assert!(plan.passes().max_layers > 1 && plan.fitted()[channel::ALPHA]);
}

#[test]
fn frozen_positions_run_no_silhouettes() {
    let (clay, sheet) = (scene(Material::clay()), candidate(AlphaMode::Opaque, |_, _| {}));
    let frozen =
        FitPlan::new(&clay).with_options(0, ReferenceKind::RASTERIZED, &Lighting::Point).with_maps(&sheet);
    let passes = frozen.passes();
    assert!(!passes.position_gradients && !passes.antialias);
    assert_eq!(runs(&frozen, "silhouette gradients"), Runs::No);
    let passes = fit(&clay, &sheet).passes();
    assert!(passes.position_gradients && passes.antialias);
}

#[test]
fn flat_normals_and_constant_maps_are_skipped() {
    let clay = scene(Material::clay());
    let sheet = candidate(AlphaMode::Opaque, |_, _| {});
    let flat =
        FitPlan::new(&clay).with_options(0, ReferenceKind::RASTERIZED, &Lighting::Mixed).with_maps(&sheet);
    assert!(!flat.passes().normal_map && !flat.passes().map_gradients);
    assert_eq!((runs(&flat, "normal map"), runs(&flat, "map gradients")), (Runs::No, Runs::No));
    assert!(fit(&clay, &sheet).passes().normal_map, "a shape that moves does not keep its normals flat");
    let bent = fit(&clay, &candidate(AlphaMode::Opaque, |i, t| t[channel::NORMAL] = 0.1 * (i % 2) as f32));
    assert!(bent.passes().normal_map && bent.passes().map_gradients);
    assert_eq!(runs(&bent, "normal map"), Runs::Yes);
    assert!(bent.fitted()[channel::NORMAL + 2] && !bent.fitted()[0]);
    assert_eq!(runs(&FitPlan::new(&clay), "normal map"), Runs::Open);
}

#[test]
fn light_and_reference_are_told_as_they_are() {
    let clay = scene(Material::clay());
    let with = |path, lighting: &Lighting| {
        let kind = if path { ReferenceKind::path_traced(64) } else { ReferenceKind::RASTERIZED };
        FitPlan::new(&clay).with_options(10, kind, lighting)
    };
    assert_eq!(runs(&with(false, &Lighting::Mixed), "environment light"), Runs::Yes, "the default uses one");
    assert_eq!(runs(&with(false, &Lighting::Point), "environment light"), Runs::No);
    let studio = Lighting::Environment(crate::views::studio());
    assert_eq!(runs(&with(false, &studio), "environment light"), Runs::Yes);
    assert_eq!(runs(&with(true, &studio), "indirect light"), Runs::Yes);
    assert_eq!(runs(&with(false, &studio), "indirect light"), Runs::No);
    let noisy = with(true, &studio).with_loss(Loss::Mse.into(), Some(0.4));
    assert!(noisy.to_string().contains("0.400"), "{noisy}");
}

#[test]
fn what_is_in_the_file_is_not_denied() {
    let extensions = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        volume: Some(Volume { thickness: 1.0, ..Volume::default() }),
        sheen: Some(Sheen { color: [1.0; 3], ..Sheen::default() }),
        ..Extensions::default()
    };
    let glass = scene(Material { extensions: Some(Box::new(extensions)), ..Material::default() });
    let text = FitPlan::new(&glass).to_string();
    for part in [
        "volumes                1 of 1 materials enclose one",
        "sheen, volume: kept",
        "run  transmission           1 of 1 materials let light pass: drawn blended",
    ] {
        assert!(text.contains(part), "{part:?} in\n{text}");
    }
    let text = FitPlan::new(&scene(Material::clay())).to_string();
    assert!(text.contains("no material encloses one"), "{text}");
}

#[test]
fn where_occlusion_comes_from_is_told() {
    use crate::bake::{Occlusion, OcclusionRays};
    let clay = FitPlan::new(&scene(Material::clay()));
    let rays = OcclusionRays { rays: 77, ..OcclusionRays::default() };
    for (occlusion, expected) in
        [(Occlusion::Maps, Runs::No), (Occlusion::Open, Runs::No), (Occlusion::Rays(rays), Runs::Yes)]
    {
        let plan = clay.clone().with_occlusion(occlusion);
        assert_eq!(runs(&plan, "occlusion textures"), expected, "{occlusion:?}");
        assert_eq!(plan.to_string().contains("77 rays a texel"), expected == Runs::Yes, "{plan}");
    }
}

#[test]
fn textures_of_occlusion_and_extensions_are_read() {
    let slot = |tex_coord| {
        let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Some(TextureSlot { image: 0, sampler: Sampler::default(), tex_coord, transform })
    };
    let told = |material, occlusion| {
        let mut s = scene(material);
        s.primitives[0].mesh.uvs1 = s.primitives[0].mesh.uvs.clone();
        s.images = vec![TextureImage { width: 1, height: 1, texels: vec![[9; 4]], ..TextureImage::default() }];
        let plan = FitPlan::new(&s).with_occlusion(occlusion);
        ["texture coordinates 0", "texture coordinates 1", "textures"].map(|what| runs(&plan, what))
    };
    let occluded = || Material { occlusion_texture: slot(1), ..Material::clay() };
    assert_eq!(told(occluded(), Occlusion::Maps), [Runs::No, Runs::Yes, Runs::Yes]);
    assert_eq!(told(occluded(), Occlusion::Open), [Runs::No; 3], "where its maps are left out, nothing reads them");
    let sheen = Sheen { color: [1.0; 3], color_texture: slot(1), ..Sheen::default() };
    let extensions = Extensions { sheen: Some(sheen), ..Extensions::default() };
    let velvet = Material { extensions: Some(Box::new(extensions)), ..Material::clay() };
    assert_eq!(told(velvet.clone(), Occlusion::Open), [Runs::No, Runs::Yes, Runs::Yes]);
    let unlit = Material { unlit: true, ..velvet };
    assert_eq!(told(unlit, Occlusion::Maps), [Runs::No; 3], "unlit surfaces have no sheen");
}

#[test]
fn unplaced_materials_do_not_count() {
    let mut s = scene(Material::clay());
    s.materials.push(Material { alpha_mode: AlphaMode::Blend, ..Material::clay() });
    assert_eq!(runs(&FitPlan::new(&s), "transparent layers"), Runs::No);
    assert_eq!(runs(&FitPlan::new(&s), "texture coordinates 0"), Runs::No, "no texture reads them");
}

#[test]
fn phases_say_what_moves_at_which_rate() {
    let phase = |name, shrink, positions: f64| {
        let rates = vec![("positions".into(), positions), ("maps".into(), 0.002)];
        Phase::<()> { name, first: 0, steps: 40, shrink, rates, fade: None, reinitialised: None }
    };
    let phases = [phase("coarse", 2, 0.01), phase("fine", 1, 0.004)];
    let text = FitPlan::new(&scene(Material::clay())).with_phases(&phases).to_string();
    for part in
        ["coarse: 40 steps", "pictures 1/2 as wide", "fine: 40 steps", "positions at 0.4 of their rate"]
    {
        assert!(text.contains(part), "{part:?} in\n{text}");
    }
    let frozen = [phase("maps", 1, 0.0)];
    let text = FitPlan::new(&scene(Material::clay())).with_phases(&frozen).to_string();
    assert!(text.contains("positions frozen"), "{text}");
}

#[test]
fn a_plan_tells_the_rows_of_the_surface_that_is_fitted() {
    let blend = scene(Material { alpha_mode: AlphaMode::Blend, ..Material::clay() });
    let sheet = candidate(AlphaMode::Blend, |i, t| t[channel::ALPHA] = 0.1 * (i % 3) as f32);
    for steps in [0, 10] {
        let plan = FitPlan::new(&blend).with_options(steps, ReferenceKind::RASTERIZED, &Lighting::Point);
        let plan = plan.with_maps(&sheet);
        let surface = super::super::surface::Surface::new(sheet.clone(), &plan);
        let told = rows::surface(&surface.moving(steps > 0).work(steps));
        assert_eq!(plan.items()[..told.len()], told, "{steps} steps");
        let names: BTreeSet<&str> = plan.items().iter().map(|i| i.what).collect();
        assert_eq!(names.len(), plan.items().len(), "each row stands once");
        for what in ["base colour gradients", "alpha gradients", "position gradients", "map gradients"] {
            let row = told.iter().find(|i| i.what == what).unwrap();
            let flows = steps > 0 && what != "base colour gradients";
            assert_eq!(row.runs, flows.into(), "{what}, {steps} steps");
            assert_eq!(row.why.contains("no steps are made"), steps == 0, "{row:?}");
        }
    }
}

#[test]
fn masks_alone_are_said_to_fade() {
    let of = |alpha_mode| Material { alpha_mode, ..Material::clay() };
    let (mask, blend) = (of(AlphaMode::Mask { cutoff: 0.5 }), of(AlphaMode::Blend));
    let told = |materials: &[&Material]| {
        let mut s = scene(materials[0].clone());
        for (k, m) in materials.iter().enumerate().skip(1) {
            s.materials.push((*m).clone());
            s.primitives.push(Primitive { mesh: shapes::cube(), material: k });
            s.instances.push(Instance { primitive: k, transform: glam::Affine3A::IDENTITY });
        }
        let row = FitPlan::new(&s).items().into_iter().find(|i| i.what == "alpha gradients").unwrap();
        assert_eq!(row.runs, Runs::Yes);
        row.why
    };
    assert!(told(&[&mask]).contains("fade") && told(&[&mask, &blend]).contains("cut out or blended: masks fade"));
    assert_eq!(told(&[&blend]), "1 of 1 materials are blended");
}

#[test]
fn light_of_the_fit_through_the_path_tracer_is_told() {
    use crate::simplify::{FitRenderer, ReferenceRenderer, SimplifyOptions};
    let clay = scene(Material::clay());
    let reference = ReferenceRenderer::Path;
    let options = SimplifyOptions { reference, fit_with: FitRenderer::Path, ..SimplifyOptions::default() };
    let told = |o: &SimplifyOptions| runs(&o.plan(&clay, o.rasterized_against().kind()), "indirect light");
    assert_eq!(told(&options), Runs::Yes);
    assert_eq!(told(&SimplifyOptions { steps: 0, ..options }), Runs::No, "no map is fitted");
}

#[test]
fn what_can_be_counted_is_told_as_saved() {
    let clay = scene(Material::clay());
    let plan = fit(&clay, &candidate(AlphaMode::Opaque, |_, _| {})).with_unseen([3, 12]);
    let options = crate::simplify::SimplifyOptions { report_views: 2, judge_spp: 5, ..Default::default() };
    let plan = plan.with_judgement(options.judgement(&clay));
    let text = plan.with_result(Written::Fitted, 40, None).to_string();
    let most = Passes::default().max_layers;
    for part in [
        "unseen triangles       3 of 12",
        "steps                  40 of at most 100",
        &format!("one layer of {most}"),
        "3 of 16 samples of a texel",
        "saved: at most 12 pictures of 256 x 256 pixels, 5 samples each, 4 million samples",
    ] {
        assert!(text.contains(part), "{part:?} in\n{text}");
    }
}

#[test]
fn what_was_written_is_what_the_plan_tells() {
    let slot = TextureSlot {
        image: 0,
        sampler: Sampler::default(),
        tex_coord: 0,
        transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    };
    let sheen = Sheen { color: [1.0; 3], color_texture: Some(slot), ..Sheen::default() };
    let extensions = Extensions { sheen: Some(sheen), ..Extensions::default() };
    let mut velvet = scene(Material { extensions: Some(Box::new(extensions)), ..Material::clay() });
    velvet.images = vec![TextureImage { width: 1, height: 1, texels: vec![[9; 4]], ..TextureImage::default() }];
    let mesh = &mut velvet.primitives[0].mesh;
    mesh.colors = vec![photofit_scalar::vec4(1.0, 0.5, 0.2, 1.0); mesh.positions.len()];
    let planned = fit(&velvet, &candidate(AlphaMode::Opaque, |_, _| {}));
    let told = |written, steps| planned.clone().with_result(written, steps, None).to_string();
    let (new, own) = (
        ["an atlas has new ones", "their textures as mean values", "baked into the base colour"],
        ["read by textures, and kept", "sheen: kept as they are", "read, and kept"],
    );
    for (text, has, has_not) in [
        (told(Written::Fitted, 9), new, own),
        (told(Written::Baked, 9), new, own),
        (told(Written::Decimated, 9), own, new),
    ] {
        assert!(has.iter().all(|part| text.contains(part)), "{text}");
        assert!(!has_not.iter().any(|part| text.contains(part)), "{text}");
        assert!(text.contains("run  position gradients"), "{text}");
    }
    let open = planned.to_string();
    assert_eq!(open.matches("where maps are new").count(), 3, "pictures decide: {open}");
    let still = told(Written::Baked, 0);
    assert!(still.contains("skip position gradients     no steps are made"), "{still}");
    // Nothing is baked or fitted where the asset keeps its surface.
    let kept = FitPlan::new(&velvet).with_surfacing(Surfacing::Kept);
    let kept = kept.with_options(0, ReferenceKind::RASTERIZED, &Lighting::Mixed);
    for plan in [kept.clone(), kept.with_result(Written::Kept, 0, None)] {
        let text = plan.to_string();
        assert!(own.iter().all(|part| text.contains(part)), "{text}");
        let fitted = ["gradients", "transparent layers", "open "];
        assert!(!fitted.iter().any(|part| text.contains(part)), "{text}");
    }
}

#[test]
fn what_coarse_mip_levels_fit_beyond_the_base_is_told() {
    use crate::engine::cpu::Chain as _;
    let clay = scene(Material::clay());
    let mut sheet = candidate(AlphaMode::Opaque, |_, _| {});
    let row = |plan: &FitPlan, what| plan.items().into_iter().find(|i| i.what == what).unwrap();
    for free in [false, true] {
        if free {
            sheet.free_mips();
        }
        let plan = fit(&clay, &sheet).with_mips(free.then_some([16, 64]));
        let surface = super::super::surface::Surface::new(sheet.clone(), &plan);
        let told = rows::surface(&surface.work(100));
        assert_eq!(plan.items()[..told.len()], told, "free: {free}");
        let groups = surface.groups();
        let moved = groups.iter().any(|g| g.rates.get(channel::ROUGHNESS).is_some_and(|r| *r > 0.0));
        assert_eq!(moved, free, "its rates say what is fitted");
        let roughness = row(&plan, "roughness gradients");
        assert_eq!(roughness.runs, free.into(), "{roughness:?}");
        let maps = row(&plan, "map gradients").why;
        assert!(maps.contains("3 of 16") && maps.contains("4 in coarse mip levels") == free, "{maps}");
        assert_eq!(plan.to_string().contains("coarse ones at 5 times the rate"), free, "{plan}");
    }
}

#[test]
fn shadows_in_maps_are_not_judged_twice() {
    let sheen =
        Extensions { sheen: Some(Sheen { color: [1.0; 3], ..Sheen::default() }), ..Extensions::default() };
    let velvet = scene(Material { extensions: Some(Box::new(sheen)), ..Material::default() });
    let told = |options: &crate::simplify::SimplifyOptions| options.judgement(&velvet).item();
    let raster = crate::simplify::SimplifyOptions::default();
    assert_eq!(told(&raster).runs, Runs::Yes);
    let path =
        crate::simplify::SimplifyOptions { reference: crate::simplify::ReferenceRenderer::Path, ..raster };
    let item = told(&path);
    assert!(item.runs == Runs::No && item.why.contains("sheen are not drawn"), "{item:?}");
    let asked = crate::simplify::SimplifyOptions { judge: JudgeRenderer::Path, ..path };
    assert!(told(&asked).why.contains("count twice"), "{:?}", told(&asked));
}
