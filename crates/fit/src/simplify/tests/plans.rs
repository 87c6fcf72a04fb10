//! Plans against what ran, over small assets and options: no row says before the work what it comes to be false, and after it
//! every row is what was done.

use super::*;
use crate::bake::{Occlusion, OcclusionRays};
use crate::engine::plan::{Item, PlanRows, rows};
use crate::lod::{LodOptions, simplify_chain};
use crate::simplify::prepare::{decimated, importance};
use photofit_geometry::shapes::{icosphere, quad_grid};
use photofit_raster::{CHANNELS, channel};
use photofit_scene::{Extensions, TextureEncoding, Transmission};

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
    Some(TextureSlot::new(image))
}

/// A ball whose material reads an image of one texel.
fn with_texel(material: Material, texel: [u8; 4]) -> Scene {
    let image = TextureImage { width: 1, height: 1, texels: vec![texel], ..TextureImage::default() };
    Scene { images: vec![image], ..beside(&[material]) }
}

/// A ball inside of a ball.
fn nested(outer: Material, inner: Material) -> Scene {
    let mut scene = of(icosphere(4), outer);
    scene.materials.push(inner);
    scene.primitives.push(Primitive { material: 1, ..scene.primitives[0].clone() });
    let transform = glam::Affine3A::from_scale(glam::Vec3::splat(0.5));
    scene.instances.push(Instance { primitive: 1, transform });
    scene
}

fn quick() -> SimplifyOptions {
    SimplifyOptions { steps: 2, effort: Effort::Fast, judge_spp: 2, ..options() }
}

fn glass() -> Material {
    let transmission = Some(Transmission { factor: 1.0, texture: None });
    let glass = Extensions { transmission, ..Extensions::default() };
    Material { extensions: Some(Box::new(glass)), ..Material::clay() }
}

fn with_alpha(alpha_mode: AlphaMode) -> Material {
    Material { base_color: [0.9, 0.3, 0.2, 0.7], alpha_mode, double_sided: true, ..Material::clay() }
}

/// What assets ask for.
fn assets() -> Vec<Case> {
    let case = |name, scene, options| Case { name, scene, options };
    let [mask, blend] = [AlphaMode::Mask { cutoff: 0.5 }, AlphaMode::Blend].map(with_alpha);
    let (glass, clay) = (glass(), Material::clay());
    let hazy = Material { extensions: glass.extensions.clone(), ..blend.clone() };
    let glowing = Material { emissive: [1.0; 3], ..Material::clay() };
    let dark = Material { emissive_texture: slot(0), ..glowing.clone() };
    let metal = Material { metallic: 1.0, metallic_roughness_texture: slot(0), ..Material::clay() };
    let opaque = || nested(clay.clone(), clay.clone());
    let mut flat = rock();
    flat.primitives[0].mesh.triangles.push([0, 1, 1]);
    vec![
        case("clay", rock(), quick()),
        case("a triangle without area", flat, quick()),
        case("a texture", tiled(), quick()),
        case("a mask", beside(&[clay.clone(), mask.clone()]), quick()),
        case("blended beside glass", beside(&[glass.clone(), blend.clone()]), quick()),
        case("a mask beside glass", beside(&[glass.clone(), mask]), quick()),
        case("glass", beside(&[clay.clone(), glass]), quick()),
        case("blended glass", beside(&[hazy]), quick()),
        case("glowing", beside(&[glowing]), quick()),
        case("glowing by a black texture", with_texel(dark, [0, 0, 0, 255]), quick()),
        case("metal by a black texture", with_texel(metal, [0, 128, 0, 255]), quick()),
        case("nested", opaque(), quick()),
        case("nested, locked", opaque(), SimplifyOptions { lock_borders: true, ..quick() }),
        case("nested, whole", opaque(), SimplifyOptions { target: Target::Ratio(1.0), ..quick() }),
        case(
            "a hidden blended part",
            nested(clay, blend),
            SimplifyOptions { target: Target::Ratio(0.25), ..quick() },
        ),
    ]
}

/// What options ask for.
fn choices() -> Vec<Case> {
    let case = |name, scene, options| Case { name, scene, options };
    let occluded =
        || with_texel(Material { occlusion_texture: slot(0), ..Material::clay() }, [99, 0, 0, 255]);
    let all =
        SimplifyOptions { max_bytes: Some(1 << 24), triangles_by_bytes: true, own_textures: true, ..quick() };
    let most = photofit_scene::to_glb(&tiled()).unwrap().len() as u64 * 19 / 20;
    let colors = SimplifyOptions { appearance: Appearance::VertexColors, ..quick() };
    let kept = SimplifyOptions { appearance: Appearance::Kept, target: Target::Ratio(0.5), ..quick() };
    let normal = SimplifyOptions { effort: Effort::Normal, ..quick() };
    let rays = OcclusionRays { rays: 8, ..OcclusionRays::default() };
    let occlusion = |occlusion| SimplifyOptions { occlusion, ..quick() };
    let ktx2 = TextureEncoding::Ktx2 { quality: 90 };
    let free = SimplifyOptions { mips: Mips::Free, texture_encoding: ktx2, smallest_size: 16, ..quick() };
    let path = SimplifyOptions { reference: ReferenceRenderer::Path, ..quick() };
    let ended = SimplifyOptions { time_limit: Some(std::time::Duration::ZERO), ..quick() };
    vec![
        case("no steps", rock(), SimplifyOptions { steps: 0, ..quick() }),
        case("ended before the first step", rock(), ended),
        case("two starts", rock(), normal.clone()),
        case("two starts, no steps", rock(), SimplifyOptions { steps: 0, ..normal }),
        case("a sphere", rock(), SimplifyOptions { init: Init::Sphere, ..quick() }),
        case("a sphere, no steps", rock(), SimplifyOptions { init: Init::Sphere, steps: 0, ..quick() }),
        case("locked borders", tiled(), SimplifyOptions { lock_borders: true, ..quick() }),
        case("colours of vertices", occluded(), colors.clone()),
        case("colours of vertices, no steps", rock(), SimplifyOptions { steps: 0, ..colors }),
        case("all triangles fit", tiled(), all.clone()),
        case("most triangles fit", tiled(), SimplifyOptions { max_bytes: Some(most), ..all.clone() }),
        case("few triangles fit", tiled(), SimplifyOptions { max_bytes: Some(most / 4), ..all.clone() }),
        case(
            "an own surface that fits",
            tiled(),
            SimplifyOptions { appearance: Appearance::Kept, ..all.clone() },
        ),
        case(
            "an own surface within bytes",
            tiled(),
            SimplifyOptions { appearance: Appearance::Kept, max_bytes: Some(most / 2), ..all },
        ),
        case("an own surface", tiled(), kept),
        case("no occlusion", occluded(), occlusion(Occlusion::None)),
        case("occlusion by rays", rock(), occlusion(Occlusion::Rays(rays))),
        case("free mip levels", tiled(), free),
        case("a path traced reference", rock(), path.clone()),
        case("through the path tracer", rock(), SimplifyOptions { fit_with: FitRenderer::Path, ..path }),
        case("as an engine shows it", rock(), SimplifyOptions { as_engine: true, ..quick() }),
        case("judged by paths", rock(), SimplifyOptions { judge: JudgeRenderer::Path, ..quick() }),
    ]
}

/// Rows of a fit, which are not there where the asset keeps its surface.
const OF_A_FIT: [&str; 6] = [
    "transparent layers",
    "alpha gradients",
    "position gradients",
    "normal map",
    "metalness gradients",
    "emission",
];

/// The rows of two plans that say the contrary, and those of the first that are gone, but for some that `may_go`. Who ends a fit
/// before its first step gets no steps, whatever was planned.
fn contradictions(before: &FitPlan, after: &FitPlan, may_go: &[&str], may_end: bool) -> Vec<String> {
    let after = after.items();
    let contrary = |row: &Item| match after.iter().find(|i| i.what == row.what) {
        None => (!may_go.contains(&row.what)).then(|| format!("{row:?}, and then nothing")),
        Some(now) => {
            let open = row.runs == Runs::Open || now.runs == Runs::Open;
            let ended = now.why == rows::NO_STEPS && row.runs == Runs::Yes;
            (!open && row.runs != now.runs && !(ended && may_end))
                .then(|| format!("{row:?}, and then {now:?}"))
        }
    };
    before.items().iter().filter_map(contrary).collect()
}

/// Asserts that the rows of what was written, of steps and of pictures are what a simplification came to.
fn check_figures(case: &Case, resolved: &SimplifyOptions, made: &Outcome) {
    let Case { name, scene, options } = case;
    let told = PlanRows::from(&made.plan);
    let row = |what: &str| told.items.iter().find(|i| i.what == what);
    let kept = options.appearance == Appearance::Kept;
    match (options.steps, resolved.steps) {
        _ if kept => assert_eq!(row("steps"), None, "{name}"),
        (0, _) => assert_eq!(row("steps"), None, "{name}"),
        (_, 0) => assert!(row("steps").is_some_and(|r| r.why.contains("nothing is missing")), "{name}"),
        (_, most) => assert_eq!(row("steps"), Some(&rows::steps(made.steps, most, None)), "{name}"),
    }
    assert_eq!(told.phases.is_empty(), made.steps == 0, "{name}");

    // A fit without a better step is its start.
    let first = made.history.first().map_or(f64::INFINITY, |h| h.quality);
    let gained = made.history.iter().any(|h| h.quality > first);
    assert!(gained || !matches!(made.written, Written::Fitted | Written::Rebaked), "{name}");
    let decimated = (kept || made.written == Written::Decimated) && made.triangles_out < made.triangles_in;
    assert_eq!(row("decimation").is_some(), decimated, "{name}");

    // What is written is a start by its own name, and stands among the stages.
    let stages: Vec<&str> = made.stages.iter().map(|s| s.name).filter(|s| *s != ORIGINAL).collect();
    let starts: &[&str] = match (options.init, options.effort) {
        _ if kept => &[],
        (Init::Sphere, _) => &["sphere"],
        (Init::Decimate, Effort::Fast) => &["shrink-wrapped"],
        _ => &["baked", "shrink-wrapped"],
    };
    let named: Vec<&str> =
        Written::STARTS.map(Written::name).into_iter().filter(|s| stages.contains(s)).collect();
    assert_eq!(named, starts, "{name}: {stages:?}");
    let maps = if options.appearance == Appearance::VertexColors { "colours of vertices" } else { "maps" };
    let expected = match made.written {
        Written::Fitted => "what was fitted".to_owned(),
        Written::Rebaked => format!("the fitted shape, its {maps} baked anew"),
        Written::Baked => format!("a start: the decimated shape with baked {maps}"),
        Written::ShrinkWrapped => {
            format!("a start: the decimated shape, drawn onto the asset's surface, with baked {maps}")
        }
        Written::Sphere => format!("a start: a sphere, drawn onto the asset's surface, with baked {maps}"),
        Written::Decimated => "the asset's own materials".to_owned(),
        Written::Whole => "the asset as it was given, which has few enough bytes".to_owned(),
        Written::Kept => "the asset's own surface".to_owned(),
    };
    let traced = match made.traced_maps.as_ref().is_some_and(|m| m.gained()) {
        true => ", whose maps were fitted once more through the path tracer",
        false => "",
    };
    let expected = format!("{expected}{traced}; {} of {} triangles", made.triangles_out, made.triangles_in);
    let told = row("written asset").map_or("", |r| &r.why);
    assert_eq!(told.split("; chosen in ").next(), Some(&expected[..]), "{name}");
    let is_start = Written::STARTS.contains(&made.written);
    assert!(!is_start || starts.contains(&made.written.name()), "{name}: {:?}", made.written);

    // Before the work at most the fitted asset is counted that need not be another than the file; after it all is what was drawn.
    let before = resolved.judgement(scene);
    let asset = 1 + u64::from(!matches!(made.judged, Judged::RasterizedAgainst(_)));
    let drawn = made.views.len() as u64 * (asset + stages.len() as u64);
    let all = ["decimated", "fitted", "file"].iter().all(|s| stages.contains(s));
    let more = if all || kept { 0 } else { made.views.len() };
    assert_eq!(before.pictures, drawn + more as u64, "{name}: {stages:?}");
    assert_eq!((before.judged, before.at_most), (made.judged, !kept), "{name}");
    let why = &row("path traced judgement").expect("a row").why;
    assert!(why.contains(&format!(" {drawn} pictures of ")) && !why.contains("up to"), "{name}: {why}");
}

/// Asserts that parameters changed where rows say so; `false` where that cannot be seen.
fn check_parameters(name: &str, start: &Outcome, made: &Outcome) -> bool {
    // The maps are baked anew before the first step, on the same shape. What looks best, and is kept, may be what was there before
    // it.
    let moved = start.candidate.positions != made.candidate.positions;
    let levels = [start, made].map(|o| &o.candidate.maps.levels);
    let changed = |c: usize, coarse: bool| {
        let pairs = levels[0].iter().zip(levels[1]).take(if coarse { usize::MAX } else { 1 });
        pairs.flat_map(|(a, b)| a.texels.iter().zip(&b.texels)).any(|(a, b)| a[c] != b[c])
    };
    // Of several starts another may be written.
    let at_all = start.effort == Effort::Fast && made.written == Written::Fitted && made.steps > 0;
    if !at_all || !moved && !(0..CHANNELS).any(|c| changed(c, true)) {
        return false;
    }
    let told = PlanRows::from(&made.plan);
    let flows = |what| told.runs(what).expect("a row") == Runs::Yes;
    assert_eq!(flows("position gradients"), moved, "{name}");
    let coarse = told.runs("free mip levels") == Some(Runs::Yes);
    for (what, mut group) in [
        ("base colour gradients", channel::BASE_COLOR..channel::ALPHA),
        ("alpha gradients", channel::ALPHA..channel::SPECULAR_SUPPRESSION),
        ("roughness gradients", channel::ROUGHNESS..channel::METALLIC),
        ("metalness gradients", channel::METALLIC..channel::NORMAL),
        ("normal gradients", channel::NORMAL..channel::EMISSIVE),
        ("emission gradients", channel::EMISSIVE..channel::USED),
    ] {
        assert_eq!(flows(what), group.any(|c| changed(c, coarse)), "{name}: {what}");
    }
    let count = (0..channel::USED).filter(|c| changed(*c, false)).count();
    let row = told.items.iter().find(|i| i.what == "map gradients").expect("a row");
    assert!(row.why.starts_with(&format!("{count} of {} ", channel::USED)), "{name}: {count}, {}", row.why);
    true
}

/// Asserts that no row says before the work what it comes to be false, and that all rows are what was done; whether it could be seen
/// what was fitted.
fn check(case: &Case, path: &Path) -> bool {
    let Case { name, scene, options } = case;
    let resolved = options.resolved(scene).unwrap();
    let before = resolved.options().plan(scene, options.rasterized_against().kind());
    let made = simplify(scene, path, options, &Silent).unwrap();
    let wrong = contradictions(&before, &made.plan, &[], made.fit_stopped);
    assert!(wrong.is_empty(), "{name}: {wrong:#?}");
    let kept = options.appearance == Appearance::Kept;
    let may_go: &[&str] = if kept { &OF_A_FIT } else { &[] };
    let wrong = contradictions(&FitPlan::new(scene), &made.plan, may_go, false);
    assert!(wrong.is_empty(), "{name}, inspected: {wrong:#?}");
    let open: Vec<Item> = made.plan.items().into_iter().filter(|i| i.runs == Runs::Open).collect();
    assert!(open.is_empty(), "{name}: {open:?}");
    check_figures(case, resolved.options(), &made);

    let counts = with_asset(scene, &Silent, |Asset { n, visibility, .. }| {
        let (mesh, seen) = (&n.flat.mesh, importance(n, visibility));
        let d = decimated(n, mesh, &n.triangle_classes(), &seen, resolved.options(), &Silent)?;
        let flat = (0..mesh.triangles.len()).filter(|t| {
            let [a, b, c] = mesh.corners(*t);
            (b - a).cross(c - a).length() <= 0.0
        });
        let flat = flat.count();
        let (unseen, all) = (visibility.hidden() - flat, mesh.triangles.len() - flat);
        Ok(rows::unseen(rows::Unseen { dropped: d.stats.unseen, unseen, all }))
    });
    let decimates = options.init == Init::Decimate && !kept;
    let row = made.plan.items().into_iter().find(|i| i.what == "unseen triangles");
    assert_eq!(row, decimates.then(|| counts.unwrap()), "{name}");
    if kept || made.steps == 0 {
        return false;
    }
    let start = simplify(scene, path, &SimplifyOptions { steps: 0, ..options.clone() }, &Silent).unwrap();
    check_parameters(name, &start, &made)
}

#[test]
fn plans_of_assets_say_what_comes_and_what_was() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let fitted = assets().iter().filter(|case| check(case, &path)).count();
    // Which of these short fits beat their starts hangs on last digits.
    assert!(fitted >= 4, "{fitted} fits looked better than their starts");
}

#[test]
fn plans_of_options_say_what_comes_and_what_was() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let fitted = choices().iter().filter(|case| check(case, &path)).count();
    assert!(fitted >= 4, "{fitted} fits looked better than their starts");
}

/// Of a chain the first level alone is a sphere, and each later one has two starts.
#[test]
fn plans_of_levels_say_what_they_start_from() {
    let dir = tempfile::tempdir().unwrap();
    let chain = LodOptions {
        sizes: vec![64.0, 32.0],
        triangles: vec![150, 100],
        fit: SimplifyOptions { init: Init::Sphere, effort: Effort::Normal, ..quick() },
        ..LodOptions::default()
    };
    let made = simplify_chain(&rock(), &dir.path().join("a.glb"), &chain, &Silent).unwrap();
    assert_eq!(made.levels.len(), 2);
    for (k, starts) in [&["sphere"][..], &["baked", "shrink-wrapped"]].into_iter().enumerate() {
        let outcome = &made.levels[k].outcome;
        let stages: Vec<&str> = outcome.stages.iter().map(|s| s.name).collect();
        let named = Written::STARTS.map(Written::name).into_iter().filter(|s| stages.contains(s));
        assert_eq!(named.collect::<Vec<_>>(), starts, "level {k}");
        let rows = outcome.plan.items();
        let outline = rows.iter().find(|i| i.what == "triangles by outline").expect("a row");
        let from = ["the fit starts from a sphere", "the fit starts from the level before"][k];
        assert_eq!((outline.runs, &*outline.why), (Runs::No, from), "level {k}");
        let drawn = stages.iter().filter(|s| **s != ORIGINAL).count() as u64;
        let fitted = u64::from(!(stages.contains(&"fitted") && stages.contains(&"file")));
        assert_eq!(chain.level(k).judgement(&rock()).pictures, 2 + drawn + fitted, "level {k}: {stages:?}");
    }
}
