//! What plans say, against assets and options that make each line true or false.

use super::*;
use crate::candidate::{Candidate, SurfaceClass};
use crate::engine::plan::rows::Unseen;
use crate::engine::plan::tests::{candidate, planned, scene};
use crate::engine::surface::Surface;
use crate::simplify::{FitRenderer, JudgeRenderer, ReferenceRenderer, SimplifyOptions};
use photofit_geometry::shapes;
use photofit_raster::deferred::Passes;
use photofit_raster::loss::Loss;
use photofit_raster::{CHANNELS, channel};
use photofit_scene::{
    AlphaMode, Anisotropy, Clearcoat, Extensions, Instance, Material, Primitive, Sheen, TextureImage,
    TextureSlot, Transmission, Volume,
};
use std::collections::BTreeSet;

fn runs(plan: &FitPlan, what: &str) -> Runs {
    plan.items().into_iter().find(|i| i.what == what).unwrap_or_else(|| panic!("no item {what}")).runs
}

fn fit(scene: &Scene, candidate: &Candidate) -> FitPlan {
    fit_of(scene, candidate, 100)
}

fn fit_of(scene: &Scene, candidate: &Candidate, steps: u64) -> FitPlan {
    let plan = FitPlan::new(scene).with_options(steps, ReferenceKind::RASTERIZED, &Lighting::Mixed);
    plan.with_maps(planned(candidate, steps))
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
    let few = told(0.000_01, 0.0);
    assert!(few.runs == Runs::No && few.why.contains("less than 0.01%"), "{}", few.why);
    let shown = told(0.034, 0.25);
    assert!(
        shown.runs == Runs::Yes && shown.why.contains("3.4%") && shown.why.contains("25%"),
        "{}",
        shown.why
    );
}

#[test]
fn before_maps_are_baked_steps_tell_whether_normals_are_drawn() {
    let clay = scene(Material::clay());
    let asked = |steps| FitPlan::new(&clay).with_options(steps, ReferenceKind::RASTERIZED, &Lighting::Mixed);
    assert_eq!(runs(&FitPlan::new(&clay), "normal map"), Runs::Open);
    assert_eq!([0, 9].map(|steps| runs(&asked(steps), "normal map")), [Runs::Open, Runs::Yes]);
}

#[test]
fn a_factor_alone_says_nothing_of_what_is_emitted() {
    let glow = scene(Material { emissive: [1.0, 0.0, 0.0], ..Material::clay() });
    let plan = FitPlan::new(&glow).with_options(10, ReferenceKind::RASTERIZED, &Lighting::Mixed);
    assert_eq!(runs(&plan, "emission"), Runs::Open);
    // Its texture is black.
    let black = candidate(AlphaMode::Opaque, |_, t| t[channel::EMISSIVE..channel::USED].fill(0.0));
    assert_eq!(runs(&fit(&glow, &black), "emission"), Runs::No);
}

#[test]
fn blended_surfaces_beside_glass_are_fitted() {
    let of = |extensions, alpha_mode| Material { extensions, alpha_mode, ..Material::clay() };
    let transmission = Some(Transmission { factor: 1.0, texture: None });
    let glass = Some(Box::new(Extensions { transmission, ..Extensions::default() }));
    // Alpha of glass is not fitted, whatever it means.
    for mode in [AlphaMode::Opaque, AlphaMode::Blend] {
        let asked = FitPlan::new(&scene(of(glass.clone(), mode)));
        let plan = asked.with_options(10, ReferenceKind::RASTERIZED, &Lighting::Mixed);
        let told = ["transparent layers", "alpha gradients", "transmission"].map(|what| runs(&plan, what));
        assert_eq!(told, [Runs::Yes, Runs::No, Runs::Yes], "{mode:?}");
    }
    for beside in [AlphaMode::Blend, AlphaMode::Mask { cutoff: 0.5 }, AlphaMode::Opaque] {
        let mut s = scene(of(glass.clone(), AlphaMode::Opaque));
        s.materials.push(of(None, beside));
        s.primitives.push(Primitive { mesh: shapes::cube(), material: 1 });
        s.instances.push(Instance { primitive: 1, transform: glam::Affine3A::IDENTITY });
        let mut sheet = candidate(AlphaMode::Blend, |_, _| {});
        sheet.classes[0].see_through = true;
        sheet.classes.push(SurfaceClass { alpha: beside, ..SurfaceClass::default() });
        sheet.class[0] = 1;
        let before = FitPlan::new(&s).with_options(10, ReferenceKind::RASTERIZED, &Lighting::Mixed);
        let has_alpha = beside != AlphaMode::Opaque;
        let open = if has_alpha { Runs::Open } else { Runs::No };
        assert_eq!(runs(&before, "alpha gradients"), open, "{beside:?}: where the part beside glass is left");
        assert_eq!(runs(&fit(&s, &sheet), "alpha gradients"), has_alpha.into(), "{beside:?}");
    }
}

#[test]
fn without_steps_nothing_is_fitted_by_a_loss() {
    let clay = scene(Material::clay());
    for steps in [0, 10] {
        let plan = fit_of(&clay, &candidate(AlphaMode::Opaque, |_, _| {}), steps);
        let plan = plan.with_loss(Loss::LogSrgbL1.into(), Some(0.0)).with_mips(Some([16, 64]));
        for what in ["logarithmic loss", "free mip levels"] {
            assert_eq!(runs(&plan, what), Runs::from(steps > 0), "{what}, {steps} steps");
        }
        let stopped = plan.with_result(Written::Baked, [0; 2], (None, false));
        assert_eq!(runs(&stopped, "logarithmic loss"), Runs::No, "no step was made");
    }
}

#[test]
fn unseen_triangles_that_stay_are_told() {
    let plan = FitPlan::new(&scene(Material::clay()));
    let told = |[dropped, unseen, all]: [usize; 3]| {
        let rows = plan.clone().with_unseen(Some(Unseen { dropped, unseen, all })).items();
        let row = rows.into_iter().find(|i| i.what == "unseen triangles").expect("a row");
        (row.runs, row.why)
    };
    assert_eq!(told([0, 4, 12]), (Runs::Note, "4 of 12: none of them is left out for that".into()));
    assert_eq!(told([0, 0, 12]), (Runs::Note, "none of 12".into()));
    assert_eq!(told([3, 4, 12]).0, Runs::No);
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
    let glass = scene(Material { extensions: Some(Box::new(extensions.clone())), ..Material::clay() });
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
    // Metal lets no light pass, whatever its file says.
    let metal = Material { metallic: 1.0, extensions: Some(Box::new(extensions)), ..Material::clay() };
    let text = FitPlan::new(&scene(metal)).to_string();
    assert!(text.contains("no material encloses one") && !text.contains("let light pass: drawn"), "{text}");
}

#[test]
fn where_occlusion_comes_from_is_told() {
    use crate::bake::OcclusionRays;
    let clay = FitPlan::new(&scene(Material::clay()));
    let rays = OcclusionRays { rays: 77, ..OcclusionRays::default() };
    for (occlusion, expected) in
        [(Occlusion::Maps, Runs::No), (Occlusion::None, Runs::No), (Occlusion::Rays(rays), Runs::Yes)]
    {
        let plan = clay.clone().with_appearance(Appearance::Maps).with_occlusion(occlusion);
        assert_eq!(runs(&plan, "occlusion textures"), expected, "{occlusion:?}");
        assert_eq!(plan.to_string().contains("77 rays a texel"), expected == Runs::Yes, "{plan}");
    }
    let slot = TextureSlot::new(0);
    let occluded = scene(Material { occlusion_texture: Some(slot), ..Material::clay() });
    for (appearance, expected) in [(Appearance::Maps, Runs::Yes), (Appearance::VertexColors, Runs::No)] {
        let plan = FitPlan::new(&occluded).with_appearance(appearance).with_occlusion(Occlusion::Maps);
        assert_eq!(runs(&plan, "occlusion textures"), expected, "{appearance:?}");
        assert_eq!(plan.to_string().contains("have one: left out"), expected == Runs::No, "{plan}");
    }
    // What options leave out, the asset alone does not promise.
    for inspected in [FitPlan::new(&occluded), clay] {
        assert_eq!(runs(&inspected, "occlusion textures"), Runs::Open);
    }
}

#[test]
fn textures_of_occlusion_and_extensions_are_read() {
    let slot = |tex_coord| Some(TextureSlot { tex_coord, ..TextureSlot::new(0) });
    let told = |material, occlusion| {
        let mut s = scene(material);
        s.primitives[0].mesh.uvs1 = s.primitives[0].mesh.uvs.clone();
        s.images =
            vec![TextureImage { width: 1, height: 1, texels: vec![[9; 4]], ..TextureImage::default() }];
        let plan = FitPlan::new(&s).with_appearance(Appearance::Maps).with_occlusion(occlusion);
        assert_eq!(runs(&FitPlan::new(&s), "texture coordinates 0"), Runs::No);
        ["texture coordinates 0", "texture coordinates 1", "textures"].map(|what| runs(&plan, what))
    };
    let occluded = || Material { occlusion_texture: slot(1), ..Material::clay() };
    assert_eq!(told(occluded(), Occlusion::Maps), [Runs::No, Runs::Yes, Runs::Yes]);
    let mut inspected = scene(occluded());
    inspected.primitives[0].mesh.uvs1 = inspected.primitives[0].mesh.uvs.clone();
    inspected.images =
        vec![TextureImage { width: 1, height: 1, texels: vec![[9; 4]], ..TextureImage::default() }];
    for what in ["texture coordinates 1", "textures"] {
        assert_eq!(runs(&FitPlan::new(&inspected), what), Runs::Open, "{what}: as the options say");
    }
    assert_eq!(
        told(occluded(), Occlusion::None),
        [Runs::No; 3],
        "where its maps are left out, nothing reads them"
    );
    let sheen = Sheen { color: [1.0; 3], color_texture: slot(1), ..Sheen::default() };
    let extensions = Extensions { sheen: Some(sheen), ..Extensions::default() };
    let velvet = Material { extensions: Some(Box::new(extensions)), ..Material::clay() };
    assert_eq!(told(velvet.clone(), Occlusion::None), [Runs::No, Runs::Yes, Runs::Yes]);
    let unlit = Material { unlit: true, ..velvet };
    assert_eq!(told(unlit, Occlusion::Maps), [Runs::No; 3], "unlit surfaces have no sheen");
}

#[test]
fn whatever_has_directions_needs_tangents() {
    let slot = Some(TextureSlot::new(0));
    let with = |extensions| Material { extensions: Some(Box::new(extensions)), ..Material::clay() };
    let coat = Clearcoat { factor: 1.0, normal_texture: slot, ..Clearcoat::default() };
    let coated = with(Extensions { clearcoat: Some(coat), ..Extensions::default() });
    let brushed = with(Extensions { anisotropy: Some(Anisotropy::default()), ..Extensions::default() });
    let told = |material| runs(&FitPlan::new(&scene(material)), "reference tangents");
    assert_eq!([coated, brushed].map(told), [Runs::Yes; 2]);
    assert_eq!(told(Material::clay()), Runs::No);
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
    let mut phases = [phase("coarse", 2, 0.01), phase("fine", 1, 0.004)];
    let text = FitPlan::new(&scene(Material::clay())).with_phases(&phases).to_string();
    for part in
        ["coarse: 40 steps", "pictures 1/2 as wide", "fine: 40 steps", "positions at 0.4 of their rate"]
    {
        assert!(text.contains(part), "{part:?} in\n{text}");
    }
    // A fit that ended before a phase began says nothing of it.
    phases[1].first = 40;
    let ended = |reached| {
        let plan = FitPlan::new(&scene(Material::clay())).with_phases(&phases);
        plan.with_result(Written::Fitted, [reached; 2], (None, false)).to_string()
    };
    assert!(ended(40).contains("coarse: 40") && !ended(40).contains("fine: 40"), "{}", ended(40));
    assert!(ended(41).contains("fine: 40") && !ended(0).contains("coarse: 40"), "{}", ended(41));
    let frozen = [phase("maps", 1, 0.0)];
    let text = FitPlan::new(&scene(Material::clay())).with_phases(&frozen).to_string();
    assert!(text.contains("positions frozen"), "{text}");
}

#[test]
fn a_plan_tells_the_rows_of_the_surface_that_is_fitted() {
    let blend = scene(Material { alpha_mode: AlphaMode::Blend, ..Material::clay() });
    let sheet = candidate(AlphaMode::Blend, |i, t| t[channel::ALPHA] = 0.1 * (i % 3) as f32);
    for steps in [0, 10] {
        let plan = fit_of(&blend, &sheet, steps);
        let surface = Surface::new(sheet.clone(), &planned(&sheet, steps));
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
        let inspected = FitPlan::new(&s);
        assert_eq!(runs(&inspected, "alpha gradients"), Runs::Open, "where steps are made");
        let plan = inspected.with_options(10, ReferenceKind::RASTERIZED, &Lighting::Mixed);
        let row = plan.items().into_iter().find(|i| i.what == "alpha gradients").unwrap();
        assert_eq!(row.runs, Runs::Yes, "nothing else is there that could be left alone");
        row.why
    };
    assert!(
        told(&[&mask]).contains("fade") && told(&[&mask, &blend]).contains("cut out or blended: masks fade")
    );
    assert_eq!(told(&[&blend]), "1 of 1 materials are blended");
}

#[test]
fn light_of_the_fit_through_the_path_tracer_is_told() {
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
    let plan = fit(&clay, &candidate(AlphaMode::Opaque, |_, _| {})).with_unseen(Some(Unseen {
        dropped: 3,
        unseen: 5,
        all: 12,
    }));
    let options = SimplifyOptions { report_views: 2, judge_spp: 5, ..Default::default() };
    let plan = plan.with_judgement(options.judgement(&clay));
    let text = plan.with_result(Written::Fitted, [40; 2], (None, false)).to_string();
    let most = Passes::default().max_layers;
    for part in [
        "skip unseen triangles       3 of 12: left out of the decimation, of 5 that nobody sees",
        "steps                  40 of at most 100",
        &format!("one layer in place of {most}, no blending"),
        "3 of 13 samples of a texel; the others are constant",
        "the report saves up to 14 pictures of 256 x 256 pixels, 5 samples each, 4.6 million samples",
    ] {
        assert!(text.contains(part), "{part:?} in\n{text}");
    }
}

#[test]
fn what_was_written_is_what_the_plan_tells() {
    let slot = TextureSlot::new(0);
    let sheen = Sheen { color: [1.0; 3], color_texture: Some(slot), ..Sheen::default() };
    let extensions = Extensions { sheen: Some(sheen), ..Extensions::default() };
    let mut velvet = scene(Material { extensions: Some(Box::new(extensions)), ..Material::clay() });
    velvet.images =
        vec![TextureImage { width: 1, height: 1, texels: vec![[9; 4]], ..TextureImage::default() }];
    let mesh = &mut velvet.primitives[0].mesh;
    mesh.colors = vec![photofit_scalar::vec4(1.0, 0.5, 0.2, 1.0); mesh.positions.len()];
    let planned = fit(&velvet, &candidate(AlphaMode::Opaque, |_, _| {}));
    let told = |written, steps| {
        planned
            .clone()
            .with_appearance(Appearance::Maps)
            .with_result(written, [steps; 2], (None, false))
            .to_string()
    };
    let (new, own) = (
        ["an atlas has new ones", "their textures as mean values", "baked into the base colour"],
        ["read by textures, and kept", "sheen: kept as they are", "read, and kept"],
    );
    for (text, has, has_not) in [
        (told(Written::Fitted, 9), new, own),
        (told(Written::Baked, 9), new, own),
        (told(Written::Decimated, 9), own, new),
        (told(Written::Whole, 9), own, new),
    ] {
        assert!(has.iter().all(|part| text.contains(part)), "{text}");
        assert!(!has_not.iter().any(|part| text.contains(part)), "{text}");
        assert!(text.contains("run  position gradients"), "{text}");
    }
    let chosen = |choice| {
        planned
            .clone()
            .with_result(Written::Fitted, [9; 2], (None, false))
            .with_choice(Some(choice))
            .to_string()
    };
    let (clear, close) =
        (chosen(Certainty { views: 4, close: false }), chosen(Certainty { views: 28, close: true }));
    assert!(clear.contains("what was fitted; chosen in 4 views\n"), "{clear}");
    assert!(close.contains("chosen in 28 views, and something else may be better yet"), "{close}");
    let open = planned.to_string();
    assert_eq!(open.matches("where maps are new").count(), 3, "pictures decide: {open}");
    let still = told(Written::Baked, 0);
    assert!(still.contains("skip position gradients     no steps are made"), "{still}");
    // Nothing is baked or fitted where the asset keeps its surface.
    let kept = FitPlan::new(&velvet).with_appearance(Appearance::Kept).with_occlusion(Occlusion::Maps);
    let kept = kept.with_options(0, ReferenceKind::RASTERIZED, &Lighting::Mixed);
    for plan in [kept.clone(), kept.with_result(Written::Kept, [0; 2], (None, false))] {
        let text = plan.to_string();
        assert!(own.iter().all(|part| text.contains(part)), "{text}");
        let fitted = ["gradients", "transparent layers", "open "];
        assert!(!fitted.iter().any(|part| text.contains(part)), "{text}");
    }
}

#[test]
fn the_plan_says_what_the_judge_does() {
    let sheen = Sheen { color: [1.0; 3], ..Sheen::default() };
    let velvet = Extensions { sheen: Some(sheen), ..Extensions::default() };
    let velvet = Material { extensions: Some(Box::new(velvet)), ..Material::clay() };
    let mut seen = BTreeSet::new();
    for scene in [scene(Material::clay()), scene(velvet)] {
        let n = crate::engine::Normalised::new(&scene).unwrap();
        for (judge, reference, fit_with) in [
            (JudgeRenderer::Auto, ReferenceRenderer::Raster, FitRenderer::Raster),
            (JudgeRenderer::Auto, ReferenceRenderer::Path, FitRenderer::Raster),
            (JudgeRenderer::Auto, ReferenceRenderer::Path, FitRenderer::Path),
            (JudgeRenderer::Raster, ReferenceRenderer::Path, FitRenderer::Path),
            (JudgeRenderer::Path, ReferenceRenderer::Raster, FitRenderer::Raster),
        ] {
            let options = SimplifyOptions { judge, reference, fit_with, ..SimplifyOptions::default() };
            let told = options.judgement(&scene);
            let reference = options.rasterized_against().reference(&scene, &n, &options).unwrap();
            let stages = [crate::engine::judge::Stage::new("light", scene.clone())];
            let judged = options.judge_of(&scene, &n, &*reference).method(&stages);
            assert_eq!(told.judged, judged, "{told:?}");
            let runs = judged == crate::engine::judge::Judged::PathTraced;
            assert_eq!((told.item().runs, options.is_judged_by_path_tracing(&scene)), (runs.into(), runs));
            seen.insert(format!("{judged:?}"));
        }
    }
    assert_eq!(seen.len(), 3, "all kinds: {seen:?}");
}

#[test]
fn shadows_in_maps_are_not_judged_twice() {
    let sheen =
        Extensions { sheen: Some(Sheen { color: [1.0; 3], ..Sheen::default() }), ..Extensions::default() };
    let velvet = scene(Material { extensions: Some(Box::new(sheen)), ..Material::default() });
    let told = |options: &SimplifyOptions| options.judgement(&velvet).item();
    let raster = SimplifyOptions::default();
    assert_eq!(told(&raster).runs, Runs::Yes);
    let path = SimplifyOptions { reference: ReferenceRenderer::Path, ..raster };
    let item = told(&path);
    assert!(item.runs == Runs::No && item.why.contains("not drawn: sheen"), "{item:?}");
    let asked = SimplifyOptions { judge: JudgeRenderer::Path, ..path };
    assert!(told(&asked).why.contains("count twice"), "{:?}", told(&asked));
}
