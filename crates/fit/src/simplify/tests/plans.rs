//! Plans against what ran, over small assets and options: no row says before the work what it comes to be false, and after it
//! every row is what was done.

use super::*;
use crate::engine::plan::{Item, PlanRows, rows};
use crate::simplify::prepare::{decimated, importance};
use photofit_geometry::shapes::{icosphere, quad_grid};
use photofit_raster::{CHANNELS, channel};
use photofit_scene::{Extensions, Transmission};

struct Case {
    name: &'static str,
    scene: Scene,
    options: SimplifyOptions,
}

/// A ball of the first material, and a sheet of each other one beside it.
fn beside(materials: &[Material]) -> Scene {
    let mut scene = of(icosphere(4), materials[0].clone());
    for (k, material) in materials.iter().enumerate().skip(1) {
        scene.materials.push(material.clone());
        scene.primitives.push(Primitive { mesh: quad_grid(6, 6), material: k });
        let transform = glam::Affine3A::from_translation(glam::Vec3::X * 2.2 * k as f32);
        scene.instances.push(Instance { primitive: k, transform });
    }
    scene
}

fn slot(image: usize) -> Option<TextureSlot> {
    let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    Some(TextureSlot { image, sampler: Sampler::default(), tex_coord: 0, transform })
}

/// A ball whose material reads an image of one texel.
fn with_texel(material: Material, texel: [u8; 4]) -> Scene {
    let image = TextureImage { width: 1, height: 1, texels: vec![texel], ..TextureImage::default() };
    Scene { images: vec![image], ..beside(&[material]) }
}

fn cases() -> Vec<Case> {
    let quick = || SimplifyOptions { steps: 2, effort: Effort::Fast, judge_spp: 1, ..options() };
    let case = |name, scene, options| Case { name, scene, options };
    let transmission = Some(Transmission { factor: 1.0, texture: None });
    let glass = Extensions { transmission, ..Extensions::default() };
    let glass = Material { extensions: Some(Box::new(glass)), ..Material::clay() };
    let [mask, blend] = [AlphaMode::Mask { cutoff: 0.5 }, AlphaMode::Blend].map(|alpha_mode| Material {
        base_color: [0.9, 0.3, 0.2, 0.7],
        alpha_mode,
        double_sided: true,
        ..Material::clay()
    });
    let glowing = Material { emissive: [1.0; 3], ..Material::clay() };
    let dark = Material { emissive_texture: slot(0), ..glowing.clone() };
    let metal = Material { metallic: 1.0, metallic_roughness_texture: slot(0), ..Material::clay() };
    let occluded = Material { occlusion_texture: slot(0), ..Material::clay() };
    // A ball inside of a ball.
    let mut nested = beside(&[Material::clay()]);
    let transform = glam::Affine3A::from_scale(glam::Vec3::splat(0.5));
    nested.instances.push(Instance { primitive: 0, transform });
    let all =
        SimplifyOptions { max_bytes: Some(1 << 24), triangles_by_bytes: true, own_textures: true, ..quick() };
    let colors = SimplifyOptions { surfacing: Surfacing::VertexColors, ..quick() };
    vec![
        case("clay", rock(), quick()),
        case("no steps", rock(), SimplifyOptions { steps: 0, ..quick() }),
        case("a texture", tiled(), quick()),
        case("locked borders", tiled(), SimplifyOptions { lock_borders: true, ..quick() }),
        case("a mask", beside(&[Material::clay(), mask.clone()]), quick()),
        case("blended beside glass", beside(&[glass.clone(), blend]), quick()),
        case("a mask beside glass", beside(&[glass.clone(), mask]), quick()),
        case("glass", beside(&[Material::clay(), glass]), quick()),
        case("glowing", beside(&[glowing]), quick()),
        case("glowing by a black texture", with_texel(dark, [0, 0, 0, 255]), quick()),
        case("metal by a black texture", with_texel(metal, [0, 128, 0, 255]), quick()),
        case("nested", nested.clone(), quick()),
        case("nested, locked", nested.clone(), SimplifyOptions { lock_borders: true, ..quick() }),
        case("nested, whole", nested, SimplifyOptions { target: Target::Ratio(1.0), ..quick() }),
        case("colours of vertices", with_texel(occluded, [99, 0, 0, 255]), colors),
        case("all triangles fit", tiled(), all),
    ]
}

/// The rows of two plans that say the contrary.
fn contradictions(before: &FitPlan, after: &FitPlan) -> Vec<String> {
    let after = after.items();
    let contrary = |row: &Item| {
        let now = after.iter().find(|i| i.what == row.what)?;
        let open = row.runs == Runs::Open || now.runs == Runs::Open;
        (!open && row.runs != now.runs).then(|| format!("{row:?}, and then {now:?}"))
    };
    before.items().iter().filter_map(contrary).collect()
}

#[test]
fn plans_say_what_comes_and_what_was() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let mut fitted = 0;
    for Case { name, scene, options } in cases() {
        let (resolved, _) = options.resolved(&scene).unwrap();
        let before = resolved.plan(&scene, options.rasterized_against().kind());
        let made = simplify(&scene, &path, &options, &Silent).unwrap();
        let wrong = contradictions(&before, &made.plan);
        assert!(wrong.is_empty(), "{name}: {wrong:#?}");
        if options.surfacing == Surfacing::Maps {
            let wrong = contradictions(&FitPlan::new(&scene), &made.plan);
            assert!(wrong.is_empty(), "{name}, inspected: {wrong:#?}");
        }
        let told = PlanRows::from(&made.plan);
        let row = |what: &str| told.items.iter().find(|i| i.what == what);

        // Figures are those of what ran.
        let steps = (resolved.steps > 0).then(|| rows::steps(made.steps, resolved.steps));
        assert_eq!(row("steps"), steps.as_ref(), "{name}");
        assert_eq!(told.phases.is_empty(), made.steps == 0, "{name}");
        let counts = with_asset(&scene, &Silent, |Asset { n, visibility, .. }| {
            let (mesh, seen) = (&n.flat.mesh, importance(n, visibility));
            let d = decimated(n, mesh, &n.triangle_classes(), &seen, &resolved, &Silent)?;
            Ok([d.stats.unseen, visibility.hidden(), mesh.triangles.len()])
        });
        assert_eq!(row("unseen triangles"), Some(&rows::unseen(counts.unwrap())), "{name}");
        let judgement = resolved.judgement(&scene);
        let drawn = (made.views.len() * made.stages.len()) as u64;
        assert!(made.views.len() == 1 && judgement.pictures >= drawn, "{name}: {judgement:?}, {drawn} drawn");
        assert_eq!(judgement.judged, made.judged, "{name}");
        assert_eq!(row("path traced judgement"), Some(&judgement.item()), "{name}");

        // Parameters changed where rows say so. The maps are baked anew before the first step, on the same shape.
        if made.written != Written::Fitted || made.steps == 0 {
            continue;
        }
        let start = simplify(&scene, &path, &SimplifyOptions { steps: 0, ..options }, &Silent).unwrap();
        let flows = |what| told.runs(what) == Some(Runs::Yes);
        let moved = start.candidate.positions != made.candidate.positions;
        let [a, b] = [&start, &made].map(|o| &o.candidate.maps.levels[0].texels);
        // What looks best, and is kept, may be what was there before the first step.
        if !moved && a == b {
            continue;
        }
        fitted += 1;
        assert_eq!(flows("position gradients"), moved, "{name}");
        let changed: [bool; CHANNELS] = std::array::from_fn(|c| a.iter().zip(b).any(|(a, b)| a[c] != b[c]));
        for (what, group) in [
            ("base colour gradients", channel::BASE_COLOR..channel::ALPHA),
            ("alpha gradients", channel::ALPHA..channel::GAMMA),
            ("roughness gradients", channel::ROUGHNESS..channel::METALLIC),
            ("metalness gradients", channel::METALLIC..channel::NORMAL),
            ("normal gradients", channel::NORMAL..channel::EMISSIVE),
            ("emission gradients", channel::EMISSIVE..channel::USED),
        ] {
            assert_eq!(flows(what), changed[group].contains(&true), "{name}: {what}");
        }
        let count = changed.iter().filter(|c| **c).count();
        let why = &row("map gradients").unwrap().why;
        assert!(why.starts_with(&format!("{count} of {CHANNELS} ")), "{name}: {count}, {why}");
    }
    assert!(fitted >= 6, "{fitted} fits looked better than their starts");
}
