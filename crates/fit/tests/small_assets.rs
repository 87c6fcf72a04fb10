//! The main job, whole, on assets that take seconds.

use glam::{Affine3A, Vec3};
use photofit_fit::Silent;
use photofit_fit::scene_render::SceneRenderer;
use photofit_fit::simplify::{
    FitRenderer, Init, Judged, Outcome, ReferenceRenderer, SimplifyOptions, Written, simplify,
};
use photofit_fit::views::Lighting;
use photofit_geometry::decimate::Target;
use photofit_geometry::{Mesh, shapes};
use photofit_image::Image;
use photofit_scalar::{Vec3f, vec2, vec3, vec4};
use photofit_scene::{
    AlphaMode, Camera, Extensions, Filter, Instance, Material, Primitive, Sampler, Scene, Sheen,
    SurfaceLibrary, TextureImage, TextureSlot, Transmission, Wrap,
};
use photofit_shading::Light;

fn quick(target: Target, steps: u64) -> SimplifyOptions {
    SimplifyOptions {
        target,
        steps,
        resolution: 128,
        texture_size: 128,
        report_views: 4,
        lighting: Lighting::Point,
        own_textures: false,
        ..SimplifyOptions::default()
    }
}

/// Simplifies and loads what was written.
fn run(scene: &Scene, options: &SimplifyOptions) -> (Outcome, Scene) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("light.glb");
    let outcome = simplify(scene, &path, options, &Silent).expect("the asset can be simplified");
    let written = photofit_scene::load(&path).expect("what was written can be read");
    (outcome, written)
}

fn paint(rgb: [f32; 3], double_sided: bool) -> Material {
    Material { base_color: [rgb[0], rgb[1], rgb[2], 1.0], double_sided, ..Material::clay() }
}

/// A scene of meshes, each with its material, at the given places.
fn scene(parts: Vec<(Mesh, Material, Vec<Affine3A>)>) -> Scene {
    let mut out = Scene::default();
    for (k, (mut mesh, material, places)) in parts.into_iter().enumerate() {
        mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
        out.primitives.push(Primitive { mesh, material: k });
        out.materials.push(material);
        out.instances.extend(places.into_iter().map(|transform| Instance { primitive: k, transform }));
    }
    out
}

/// The scene seen from `eye`, under the same light everywhere.
fn picture(scene: &Scene, eye: Vec3) -> Image {
    let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.9, 1.0, 0.1, 20.0);
    let (flat, library) = (scene.flatten(), SurfaceLibrary::new(scene));
    let lights = [Light::Ambient { radiance: Vec3f::splat(1.0) }];
    SceneRenderer::new(&flat, &library).render(&camera, &lights, 64, 64, 2)
}

/// Share of the pixels whose colour is mostly the given channel.
fn share(image: &Image, channel: usize) -> f64 {
    let mostly = |p: &&[f32]| (0..3).all(|k| k == channel || p[channel] > 3.0 * p[k]) && p[3] > 0.5;
    image.data.chunks_exact(4).filter(mostly).count() as f64 / image.pixels() as f64
}

#[test]
fn a_fit_beats_its_own_start() {
    let mut mesh = shapes::displaced_sphere(24, 0.35, 4, 3);
    let colour = |p: &Vec3f| {
        let wave = |x: f32| 0.5 + 0.4 * (5.0 * x).sin();
        vec4(wave(p.x), wave(p.y + 0.3), wave(p.z - 0.7), 1.0)
    };
    mesh.colors = mesh.positions.iter().map(colour).collect();
    let asset = scene(vec![(mesh, paint([1.0; 3], false), vec![Affine3A::IDENTITY])]);
    let (outcome, _) = run(&asset, &quick(Target::Triangles(150), 200));
    assert_eq!(outcome.written, Written::Fitted);
    let best = outcome.history.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    let first = outcome.history[0].quality;
    assert!(best > first + MARGIN, "held-out views: {first:.2} dB became {best:.2}");
    let stage = |name| *outcome.stage(name).expect("every stage is judged");
    let (baked, wrapped, fitted) = (stage("baked"), stage("shrink-wrapped"), stage("fitted"));
    let start = baked.psnr.max(wrapped.psnr);
    assert!(outcome.triangles_out <= 150);
    assert!(fitted.psnr > start + MARGIN, "{:.2} dB became {:.2}", start, fitted.psnr);
    assert!(fitted.flip < baked.flip.min(wrapped.flip), "FLIP falls too");
}

/// Decibels that the fit must gain on the best of its starts.
const MARGIN: f64 = 0.1;

#[test]
fn single_sided_parts_keep_their_sides() {
    // As test assets tell mirrored from plain nodes: a green card, and close before it a red one that turns its back to
    // the viewer. Who draws backs sees red.
    let card = |z: f32, turned: bool| {
        let mut mesh = shapes::quad_grid(3, 3);
        mesh.positions.iter_mut().for_each(|p| *p = vec3(0.4 * p.x, 0.4 * p.y, z));
        if turned {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        mesh.normals.clear();
        mesh
    };
    let at = |x: f32| Affine3A::from_translation(Vec3::new(x, 0.0, 0.0));
    let mirrored = at(0.5) * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let places = vec![at(-0.5), mirrored];
    let ball = shapes::icosphere(3);
    let below =
        Affine3A::from_translation(Vec3::new(0.0, -0.75, 0.0)) * Affine3A::from_scale(Vec3::splat(0.25));
    let asset = scene(vec![
        (card(0.0, false), paint([0.0, 0.8, 0.0], false), places.clone()),
        (card(0.06, true), paint([0.8, 0.0, 0.0], false), places),
        (ball, paint([0.0, 0.0, 0.8], true), vec![below]),
    ]);
    let (front, back) = (Vec3::new(0.0, 0.0, 3.0), Vec3::new(0.0, 0.0, -3.0));
    let check = |scene: &Scene, what: &str| {
        let [green, red] = [front, back].map(|eye| [1, 0].map(|c| share(&picture(scene, eye), c)));
        assert!(green[0] > 0.12 && green[1] < 0.005, "{what}, front: green {}, red {}", green[0], green[1]);
        assert!(red[1] > 0.12 && red[0] < 0.005, "{what}, back: green {}, red {}", red[0], red[1]);
    };
    check(&asset, "the asset");
    let (_, light) = run(&asset, &quick(Target::Ratio(1.0), 20));
    check(&light, "the light asset");
    let sides: Vec<bool> = light.materials.iter().map(|m| m.double_sided).collect();
    assert!(sides.contains(&true) && sides.contains(&false), "classes by sides: {sides:?}");
}

/// A card with a disc of radius .7, cut out where alpha, which falls from the middle, is below `cutoff`.
fn disc(cutoff: f32) -> Scene {
    let n = 64;
    let texel = |i: usize| {
        let [x, y] = [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32 * 2.0 - 1.0);
        // `cutoff` at radius .7.
        let alpha = (cutoff + 0.6 * (0.7 - x.hypot(y))).clamp(0.0, 1.0);
        [230, 60, 60, (alpha * 255.0).round() as u8]
    };
    let mut card = shapes::quad_grid(4, 4);
    card.uvs = card.positions.iter().map(|p| vec2(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y)).collect();
    let slot = TextureSlot {
        sampler: Sampler { wrap_u: Wrap::ClampToEdge, wrap_v: Wrap::ClampToEdge, filter: Filter::Trilinear },
        ..TextureSlot::new(0)
    };
    let material = Material {
        alpha_mode: AlphaMode::Mask { cutoff },
        base_color_texture: Some(slot),
        ..paint([1.0; 3], true)
    };
    let mut out = scene(vec![(card, material, vec![Affine3A::IDENTITY])]);
    out.images = vec![TextureImage {
        name: "disc".into(),
        width: n,
        height: n,
        texels: (0..n * n).map(texel).collect(),
        ..TextureImage::default()
    }];
    out
}

#[test]
fn masks_keep_their_outline_at_any_cutoff() {
    let covered = |scene: &Scene| {
        let image = picture(scene, Vec3::new(0.0, 0.0, 3.0));
        image.data.chunks_exact(4).map(|p| f64::from(p[3])).sum::<f64>()
    };
    for cutoff in [0.15, 0.5, 0.85] {
        let asset = disc(cutoff);
        let (_, light) = run(&asset, &quick(Target::Ratio(1.0), 0));
        let (a, b) = (covered(&asset), covered(&light));
        assert!((a / b - 1.0).abs() < 0.01, "cutoff {cutoff}: {a:.1} pixels covered became {b:.1}");
    }
}

/// Six bent cards around an axis, each with a leaf of 128 x 128 texels that is cut out.
fn leaves() -> Scene {
    let n = 128;
    let texel = |i: usize| {
        let [x, y] = [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32 * 2.0 - 1.0);
        let hole = ((6.0 * x).sin() * (6.0 * y).sin()).abs() > 0.8;
        let inside = x.hypot(y) < 0.75 + 0.15 * (7.0 * y.atan2(x)).sin() && !hole;
        [(100.0 + 60.0 * x) as u8, 150, 50, if inside { 255 } else { 0 }]
    };
    let mut leaf = shapes::quad_grid(6, 6);
    leaf.uvs = leaf.positions.iter().map(|p| vec2(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y)).collect();
    leaf.positions.iter_mut().for_each(|p| *p = vec3(0.5 * p.x, 0.5 * p.y, 0.06 * (3.0 * p.x).sin()));
    leaf.normals.clear();
    let place = |k: usize| {
        let a = 2.4 * k as f32;
        let at = Vec3::new(0.7 * (1.3 * a).cos(), 0.3 * k as f32 - 0.75, 0.7 * (1.3 * a).sin());
        Affine3A::from_translation(at) * Affine3A::from_rotation_y(a)
    };
    let mut out = disc(0.5);
    let material = out.materials[0].clone();
    let mut scene = scene(vec![(leaf, material, (0..6).map(place).collect())]);
    out.images[0] = TextureImage {
        width: n,
        height: n,
        texels: (0..n * n).map(texel).collect(),
        ..TextureImage::default()
    };
    scene.images = out.images;
    scene
}

#[test]
fn outlines_of_masks_are_fitted() {
    let asset = leaves();
    let eyes = [Vec3::new(0.0, 0.5, 3.0), Vec3::new(2.5, -0.4, 1.5), Vec3::new(-2.0, 0.3, -2.2)];
    // Mean difference of what is covered.
    let outline = |light: &Scene| {
        let difference = |eye: &Vec3| {
            let (a, b) = (picture(&asset, *eye), picture(light, *eye));
            let pixels = a.data.chunks_exact(4).zip(b.data.chunks_exact(4));
            pixels.map(|(a, b)| f64::from((a[3] - b[3]).abs())).sum::<f64>() / a.pixels() as f64
        };
        eyes.iter().map(difference).sum::<f64>() / eyes.len() as f64
    };
    // Maps of 64 x 64 texels: baked outlines are coarse.
    let run =
        |steps| run(&asset, &SimplifyOptions { texture_size: 64, ..quick(Target::Triangles(200), steps) });
    let ((baked, start), (fitted, light)) = (run(0), run(150));
    let (before, after) = (outline(&start), outline(&light));
    let (from, to) = (baked.shipped().unwrap().psnr, fitted.shipped().unwrap().psnr);
    println!("outline {before:.4} -> {after:.4}, {from:.2} -> {to:.2} dB");
    assert_eq!(fitted.written, Written::Fitted);
    assert!(after < 0.75 * before, "{before} became {after}");
    assert!(to > from + 1.5, "{from:.2} dB became {to:.2}");
    assert!(fitted.plan.to_string().contains("masks fade"), "{}", fitted.plan);
}

#[test]
fn a_sphere_takes_the_classes_of_what_it_is_drawn_onto() {
    let kind = |alpha_mode, transmits: bool| {
        let transmission = Some(Transmission { factor: 1.0, texture: None });
        let glass = || Box::new(Extensions { transmission, ..Extensions::default() });
        let base_color = [0.9, 0.2, 0.2, if alpha_mode == AlphaMode::Blend { 0.5 } else { 1.0 }];
        Material { base_color, alpha_mode, extensions: transmits.then(glass), ..Material::clay() }
    };
    let kinds = [
        (AlphaMode::Opaque, false),
        (AlphaMode::Mask { cutoff: 0.5 }, false),
        (AlphaMode::Blend, false),
        (AlphaMode::Opaque, true),
    ];
    // A ball of each, beside one another.
    let ball = |k: usize| {
        let at = Vec3::new([-1.05, 1.05][k % 2], [-1.05, 1.05][k / 2], 0.0);
        (shapes::icosphere(12), kind(kinds[k].0, kinds[k].1), vec![Affine3A::from_translation(at)])
    };
    let asset = scene((0..kinds.len()).map(ball).collect());
    let options = SimplifyOptions { init: Init::Sphere, judge_spp: 2, ..quick(Target::Triangles(1000), 0) };
    let (_, light) = run(&asset, &options);
    for (mode, transmits) in kinds {
        let of = |p: &&Primitive| {
            let m = &light.materials[p.material];
            let glass = m.extensions.as_ref().is_some_and(|e| e.transmission.is_some());
            (m.alpha_mode, glass) == (mode, transmits)
        };
        let triangles: usize = light.primitives.iter().filter(of).map(|p| p.mesh.triangles.len()).sum();
        assert!(triangles > 150, "{mode:?}, glass {transmits}: {triangles} triangles");
    }
}

#[test]
fn occlusion_maps_are_carried_over() {
    // Half of the indirect light reaches the left half of a bowl, at half strength.
    let mut mesh = shapes::quad_grid(12, 12);
    mesh.positions.iter_mut().for_each(|p| p.z = 0.2 * (p.x * p.x + p.y * p.y));
    let (lo, hi) = (0.25, 0.75);
    mesh.uvs = mesh.positions.iter().map(|p| vec2(lo + (hi - lo) * 0.5 * (p.x + 1.0), 0.5)).collect();
    let image = TextureImage {
        width: 64,
        height: 2,
        texels: (0..128).map(|i| [if i % 64 < 32 { 127 } else { 255 }, 0, 255, 255]).collect(),
        ..TextureImage::default()
    };
    let clamp = Wrap::ClampToEdge;
    let occlusion_texture = Some(TextureSlot {
        sampler: Sampler { wrap_u: clamp, wrap_v: clamp, filter: Filter::Bilinear },
        ..TextureSlot::new(0)
    });
    let material = Material { occlusion_texture, occlusion_strength: 0.5, ..paint([0.8; 3], true) };
    let mut asset = scene(vec![(mesh, material, vec![Affine3A::IDENTITY])]);
    asset.images.push(image);
    let (outcome, written) = run(&asset, &quick(Target::Triangles(80), 5));
    assert!(outcome.left_out.iter().all(|l| !l.contains("occlusion")), "{:?}", outcome.left_out);
    let library = SurfaceLibrary::with_occlusion(&written);
    let plain = written.materials[0].metallic_roughness_texture.map(|t| t.image);
    assert_eq!(plain, written.materials[0].occlusion_texture.map(|t| t.image), "one texture for both");
    assert!(
        (library.lookup(0, vec2(0.5, 0.5), vec2(0.5, 0.5), vec4(1.0, 1.0, 1.0, 1.0), None).metallic).abs()
            < 0.01
    );
    let mesh = &written.primitives[0].mesh;
    let mut seen = [0, 0];
    for t in &mesh.triangles {
        let mean = |v: [f32; 3]| v.iter().sum::<f32>() / 3.0;
        let x = mean(t.map(|i| mesh.positions[i as usize].x));
        let uv = vec2(mean(t.map(|i| mesh.uvs[i as usize].x)), mean(t.map(|i| mesh.uvs[i as usize].y)));
        let right = usize::from(x > 0.0);
        if x.abs() > 0.1 {
            let found = library.occlusion(0, [uv; 2], None);
            assert!((found - [0.75, 1.0][right]).abs() < 0.02, "x = {x}: {found}");
            seen[right] += 1;
        }
    }
    assert!(seen[0] > 10 && seen[1] > 10, "{seen:?}");
}

/// A sheet with a checkerboard of one texel a field: what 16 x 16 new texels cannot show, and the asset's own uvs do.
fn checkered() -> Scene {
    let mut mesh = shapes::quad_grid(16, 16);
    mesh.positions.iter_mut().for_each(|p| p.z = 0.05 * (3.0 * p.x).sin());
    let checker =
        |i: usize| if (i / 32 + i).is_multiple_of(2) { [230, 40, 30, 255] } else { [20, 40, 200, 255] };
    let image = TextureImage {
        width: 32,
        height: 32,
        texels: (0..1024).map(checker).collect(),
        ..TextureImage::default()
    };
    let slot = TextureSlot {
        sampler: Sampler { wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, filter: Filter::Trilinear },
        ..TextureSlot::new(0)
    };
    let material = Material { base_color_texture: Some(slot), ..paint([1.0; 3], true) };
    let mut asset = scene(vec![(mesh, material, vec![Affine3A::IDENTITY])]);
    asset.images.push(image);
    asset
}

#[test]
fn own_textures_are_kept_where_they_look_better() {
    let asset = checkered();
    let options = SimplifyOptions { texture_size: 16, ..quick(Target::Triangles(100), 10) };
    let psnr = |own_textures: bool| {
        let (outcome, written) = run(&asset, &SimplifyOptions { own_textures, ..options.clone() });
        assert!(outcome.triangles_out <= 100);
        let stage = |name| outcome.stage(name).expect("every stage is judged").psnr;
        let file = outcome.shipped().expect("the file is judged").psnr;
        (stage("decimated"), file, written.images[0].texels == asset.images[0].texels)
    };
    let (decimated, fitted, own) = psnr(false);
    assert!(fitted < decimated - 3.0 && !own, "new maps lose: {fitted:.1} against {decimated:.1} dB");
    let (decimated, fitted, own) = psnr(true);
    assert!((fitted - decimated).abs() < 0.01 && own, "{fitted:.2} and {decimated:.2} dB");
}

#[test]
fn own_materials_are_kept_with_their_sheen() {
    let mut asset = checkered();
    let sheen = Sheen { color: [0.5, 0.5, 0.9], roughness: 0.4, ..Sheen::default() };
    asset.materials[0].extensions =
        Some(Box::new(Extensions { sheen: Some(sheen), ..Extensions::default() }));
    let options = SimplifyOptions {
        own_textures: true,
        texture_size: 16,
        judge_spp: 16,
        ..quick(Target::Triangles(100), 10)
    };
    let (outcome, light) = run(&asset, &options);
    assert_eq!((outcome.written, outcome.judged), (Written::Decimated, Judged::PathTraced));
    assert_eq!(light.materials[0].extensions, asset.materials[0].extensions);
    assert_eq!(outcome.not_fitted, ["material extensions, as the asset has them: sheen"]);
    let told = outcome.plan.to_string();
    assert!(told.contains("sheen: kept as they are") && told.contains("own materials"), "{told}");
    assert!(!told.contains("mean values") && !told.contains("new ones"), "{told}");
}

#[test]
fn maps_may_be_fitted_through_the_path_tracer() {
    // Spheres in a heap shadow one another.
    let place = |x: f32, y: f32| Affine3A::from_translation(Vec3::new(x, y, 0.0));
    let places = vec![place(-0.9, 0.0), place(0.9, 0.0), place(0.0, 1.4)];
    let asset = scene(vec![(shapes::icosphere(8), paint([0.7, 0.6, 0.5], false), places)]);
    let options = SimplifyOptions {
        reference: ReferenceRenderer::Path,
        fit_with: FitRenderer::Path,
        resolution: 64,
        judge_spp: 16,
        ..quick(Target::Triangles(300), 40)
    };
    let (outcome, light) = run(&asset, &options);
    let maps = outcome.traced_maps.as_ref().expect("a fit through the path tracer");
    assert_eq!((maps.steps, outcome.judged), (40, Judged::PathTraced));
    // The start of this small fit may be as good as its end: what it started from is written then.
    let file = outcome.shipped().expect("the file is judged");
    // Maps that were baked anew are no stage: they looked better than those of the fit.
    let before = [outcome.written.name(), "fitted"].into_iter().find_map(|s| outcome.stage(s));
    let before = before.expect("what was chosen is judged");
    assert!(maps.gained() || file.flip < before.flip + 0.002, "{file:?} {before:?}");
    // Judged with 16 samples a pixel.
    assert!(file.psnr > before.psnr - 0.15, "{file:?} {before:?}");
    let has_map = light.materials[0].base_color_texture.is_some();
    assert_eq!(has_map, maps.gained(), "the shadows of what is lost have a map");
    // Stopped by the time limit and gone on from both checkpoints: the file of a run that nothing stopped.
    let folder = tempfile::tempdir().expect("a temporary folder");
    let kept = SimplifyOptions { checkpoint: Some(folder.path().into()), ..options.clone() };
    let limit = Some(std::time::Duration::from_millis(1));
    let (cut, _) = run(&asset, &SimplifyOptions { time_limit: limit, ..kept.clone() });
    assert!(cut.fit_stopped && cut.traced_maps.is_none(), "the first fit goes on before the second begins");
    let (ran, not) = (outcome.plan.to_string(), cut.plan.to_string());
    assert!(ran.contains("run  path traced maps") && not.contains("skip path traced maps"), "{ran}\n{not}");
    for _ in 0..2 {
        let (end, again) = run(&asset, &SimplifyOptions { resume: true, ..kept.clone() });
        assert_eq!(end.traced_maps.map(|m| m.steps), Some(40));
        assert_eq!(again.images[0].texels, light.images[0].texels);
    }
    let alone = SimplifyOptions { reference: ReferenceRenderer::Raster, ..options };
    let text = alone.check(usize::MAX).unwrap_err().to_string();
    assert_eq!(text, "fit_with is path; it needs path as the reference, too");
}
