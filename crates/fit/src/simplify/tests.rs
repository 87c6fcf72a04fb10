//! The main job on assets of a few hundred triangles.

mod plans;

use super::*;
use crate::Silent;
pub(super) use crate::progress::Heard;
use crate::report::Verdict;
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes::{cube, displaced_sphere};
use photofit_scalar::{vec2, vec3};
use photofit_scene::{AlphaMode, Instance, Material, Primitive, TextureImage, TextureSlot};
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

pub(super) fn of(mesh: photofit_geometry::Mesh, material: Material) -> Scene {
    Scene {
        name: "rock".into(),
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![material],
        ..Scene::default()
    }
}

pub(super) fn rock() -> Scene {
    of(displaced_sphere(8, 0.25, 4, 3), Material { name: "stone".into(), ..Material::clay() })
}

/// A bumpy grid that shows a small texture four times each way, with a file of its texels.
pub(super) fn tiled() -> Scene {
    let mut mesh = photofit_geometry::shapes::quad_grid(20, 20);
    for p in &mut mesh.positions {
        *p = vec3(p.x, p.y, 0.1 * (3.0 * p.x).sin() * (2.0 * p.y).cos());
    }
    mesh.uvs.iter_mut().for_each(|uv| *uv = vec2(uv.x * 4.0, uv.y * 4.0));
    mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    let slot = TextureSlot::new(0);
    let material = Material { base_color_texture: Some(slot), double_sided: true, ..Material::clay() };
    let texels = (0..64).map(|k| [(k * 4) as u8, 255 - (k * 3) as u8, (k % 8 * 30) as u8, 255]).collect();
    let image = TextureImage { width: 8, height: 8, texels, ..TextureImage::default() };
    Scene { images: vec![image], ..of(mesh, material) }
}

/// Tiles need few texels, of which maps that show each of them anew have far too few: no fit comes near.
/// A fit to 700 triangles whose new maps of 16 texels look worse than the asset's own materials on them.
fn far_behind() -> SimplifyOptions {
    SimplifyOptions {
        target: Target::Triangles(700),
        // Pixels in which tiles do not alias.
        resolution: 256,
        texture_size: 16,
        own_textures: true,
        steps: 200,
        ..options()
    }
}

#[test]
fn a_fit_far_behind_fewer_triangles_alone_ends_early() {
    let dir = tempfile::tempdir().unwrap();
    let ended = simplify(&tiled(), &dir.path().join("a.glb"), &far_behind(), &Silent).unwrap();
    assert!(ended.steps < 200 && ended.written == Written::Decimated, "{} {:?}", ended.steps, ended.stages);
    let told = ended.plan.to_string();
    assert!(told.contains(" of at most 200: the asset's own materials look"), "{told}");
}

#[test]
#[ignore = "slow: five fits"]
fn fits_end_early_only_where_the_other_way_is_known_and_resume_to_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let made = |o: &SimplifyOptions| {
        let outcome = simplify(&tiled(), &path, o, &Silent).unwrap();
        (outcome, std::fs::read(&path).unwrap())
    };
    let far = far_behind();
    let (ended, file) = made(&far);
    // Within bytes, as engines draw it, and with new maps alone nothing is known of what will be written.
    for o in [
        SimplifyOptions { max_bytes: Some(1 << 20), ..far.clone() },
        SimplifyOptions { own_textures: false, ..far.clone() },
    ] {
        assert!(made(&o).0.steps > ended.steps, "{o:?}");
    }
    let checkpoint = Some(dir.path().join("state"));
    let kept = SimplifyOptions { checkpoint, ..far };
    let limited = SimplifyOptions { time_limit: Some(std::time::Duration::from_nanos(1)), ..kept.clone() };
    assert!(made(&limited).0.stopped);
    assert!(made(&SimplifyOptions { resume: true, ..kept }).1 == file);
}

#[test]
fn decimation_is_written_where_no_fit_looks_better() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    // Texels far larger than the triangles: whatever is baked into them is worse than no maps at all.
    let scene = of(displaced_sphere(24, 0.25, 4, 3), Material { name: "stone".into(), ..Material::clay() });
    let coarse = SimplifyOptions {
        target: Target::Triangles(600),
        resolution: 64,
        texture_size: 16,
        report_views: 4,
        own_textures: true,
        ..options()
    };
    let outcome = simplify(&scene, &path, &coarse, &Silent).unwrap();
    let [decimated, baked, fitted] = ["decimated", "baked", "file"].map(|s| *outcome.stage(s).unwrap());
    // The row of the fit is that of the fit, whatever is in the file.
    let lost = outcome.stage("fitted").unwrap();
    assert!(lost.psnr < fitted.psnr && outcome.shipped() == Some(&fitted), "{:?}", outcome.stages);
    assert!(decimated.psnr > baked.psnr + 0.1, "{:?}", outcome.stages);
    assert!(
        outcome.written == Written::Decimated && fitted.psnr > decimated.psnr - 0.05,
        "{:?}",
        outcome.stages
    );
    let light = photofit_scene::load(&path).unwrap();
    assert!(light.images.is_empty() && light.triangle_count() == outcome.triangles_out, "no maps");
    assert!(Verdict::of(&outcome).better.is_none(), "{:?}", outcome.stages);

    // Not where new maps are asked for.
    let outcome =
        simplify(&scene, &path, &SimplifyOptions { own_textures: false, ..coarse }, &Silent).unwrap();
    let light = photofit_scene::load(&path).unwrap();
    assert!(outcome.written != Written::Decimated && light.materials[0].normal_texture.is_some());
    let better = Verdict::of(&outcome).better;
    assert_eq!(better.map(|b| b.name), Some("decimated"), "{:?}", outcome.stages);
}

/// Smallest red of the occlusion map of a written asset, its largest, and whether it has one.
fn occlusion_of(path: &Path) -> Option<(u8, u8)> {
    let light = photofit_scene::load(path).unwrap();
    let slot = light.materials.iter().find_map(|m| m.occlusion_texture.as_ref())?;
    let red = || light.images[slot.image].texels.iter().map(|t| t[0]);
    Some((red().min()?, red().max()?))
}

#[test]
fn occlusion_is_kept_baked_or_left_out() {
    use crate::bake::{Occlusion, OcclusionRays};
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    // A ball on a floor; the map of both says .6 everywhere.
    let slot = TextureSlot::new(0);
    let occluded = Material { occlusion_texture: Some(slot), ..Material::clay() };
    let mut scene = of(photofit_geometry::shapes::uv_sphere(24, 12), occluded);
    let mut floor = photofit_geometry::shapes::quad_grid(4, 4);
    floor.positions.iter_mut().for_each(|p| *p = *p * 2.0 + vec3(0.0, 0.0, -1.0));
    scene.primitives.push(Primitive { mesh: floor, material: 0 });
    scene.instances.push(Instance { primitive: 1, transform: glam::Affine3A::IDENTITY });
    scene.images = vec![TextureImage {
        width: 2,
        height: 2,
        texels: vec![[153, 255, 255, 255]; 4],
        ..TextureImage::default()
    }];
    let written = |occlusion, own_textures| {
        let of = SimplifyOptions { occlusion, own_textures, steps: 0, texture_size: 64, ..options() };
        simplify(&scene, &path, &of, &Silent).unwrap();
        occlusion_of(&path)
    };
    assert_eq!(written(Occlusion::Maps, false), Some((153, 153)));
    for own in [false, true] {
        assert_eq!(written(Occlusion::None, own), None);
        let (least, most) = written(Occlusion::Rays(OcclusionRays::default()), own).unwrap();
        // The top of the ball sees all of the sky; where it meets the floor there is none.
        assert!(least < 120 && most == 255, "{least} to {most}");
    }
}

pub(super) fn options() -> SimplifyOptions {
    SimplifyOptions {
        target: Target::Triangles(150),
        resolution: 32,
        steps: 40,
        batch: 1,
        texture_size: 32,
        report_views: 1,
        own_textures: false,
        ..SimplifyOptions::default()
    }
}

/// Says stop at the n-th question within the fit, and keeps the warnings.
#[derive(Default)]
pub(super) struct Watching {
    fitting: AtomicUsize,
    stop_at: Option<usize>,
    warnings: Mutex<Vec<String>>,
    /// Stages that were reported after the stop.
    after: Mutex<BTreeSet<&'static str>>,
}

impl Watching {
    pub(super) fn stopping_at(question: usize) -> Self {
        Self { stop_at: Some(question), ..Self::default() }
    }
}

impl Progress for Watching {
    fn report(&self, stage: &'static str, _: u64, _: u64, _: &str) {
        let asked = self.fitting.load(Ordering::Relaxed);
        if self.stop_at.is_some_and(|n| asked > n + 1) {
            self.after.lock().unwrap().insert(stage);
        }
        if stage == "fit" {
            self.fitting.fetch_max(1, Ordering::Relaxed);
        }
    }

    fn warn(&self, text: &str) {
        self.warnings.lock().unwrap().push(text.into());
    }

    fn is_cancelled(&self) -> bool {
        let asked = self.fitting.load(Ordering::Relaxed);
        if asked == 0 {
            return false;
        }
        self.fitting.fetch_add(1, Ordering::Relaxed);
        self.stop_at.is_some_and(|n| asked > n)
    }
}

#[test]
fn a_fit_stopped_at_any_step_resumes_to_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    let scene = rock();
    let file = |name: &str, options: &SimplifyOptions, progress: &dyn Progress| {
        let path = dir.path().join(name);
        let outcome = simplify(&scene, &path, options, progress).unwrap();
        (outcome.stopped, std::fs::read(path).unwrap())
    };
    let classic = options();
    let texture_encoding = photofit_scene::TextureEncoding::Ktx2 { quality: 100 };
    let free = SimplifyOptions { mips: Mips::Free, texture_encoding, ..options() };
    let whole = [&classic, &free].map(|o| file("whole.glb", o, &Silent).1);
    // In the first phase, at its end (step 16), while maps are baked anew, in the second phase.
    let all = [0, 3, 16, 17, 30, 70].map(|stop_at| (&classic, &whole[0], stop_at));
    for (options, whole, stop_at) in all.into_iter().chain([3, 17, 30].map(|at| (&free, &whole[1], at))) {
        let checkpoint = Some(dir.path().join(format!("{}{stop_at}", options.mips.name())));
        let kept = SimplifyOptions { checkpoint, ..options.clone() };
        let progress = Watching::stopping_at(stop_at);
        let (stopped, _) = file("stopped.glb", &kept, &progress);
        assert!(stopped, "question {stop_at}");
        let (stopped, resumed) = file("resumed.glb", &SimplifyOptions { resume: true, ..kept }, &Silent);
        assert!(!stopped && resumed == *whole, "{}, stopped at question {stop_at}", options.mips.name());
    }
}

#[test]
fn nothing_is_compared_with_what_a_stopped_fit_had_reached() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let own = SimplifyOptions { own_textures: true, report_views: 8, ..options() };
    for stop_at in [3, 30] {
        let progress = Watching { stop_at: Some(stop_at), ..Watching::default() };
        let made = simplify(&rock(), &path, &own, &progress).unwrap();
        let after = progress.after.into_inner().unwrap();
        assert!(
            after.contains("report") && !after.contains("choose") && !after.contains("decimate"),
            "{after:?}"
        );
        assert!(made.stopped && made.fit_stopped && !made.was_chosen(), "{:?}", made.stages);
        let verdict = Verdict::of(&made).to_string();
        assert!(verdict.contains(" over 2 views of 8 (the judgement was cut short); "), "{verdict}");
        let first = made.history[0].quality;
        let gained = made.history.iter().any(|h| h.quality > first);
        assert_eq!(made.written == Written::Fitted, gained, "{:?}", made.written);
        assert!(photofit_scene::load(&path).unwrap().triangle_count() > 0);
    }
    // The time limit ends the fit alone.
    let limited = SimplifyOptions { time_limit: Some(std::time::Duration::ZERO), ..own };
    let made = simplify(&rock(), &path, &limited, &Silent).unwrap();
    assert!(made.fit_stopped && made.was_chosen(), "{:?}", made.stages);
    assert!(Verdict::of(&made).to_string().contains(" over 8 new views; "));
}

#[test]
fn the_file_does_not_depend_on_its_name_and_keeps_the_names_of_materials() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| {
        let path = dir.path().join(name);
        simplify(&rock(), &path, &SimplifyOptions { steps: 0, ..options() }, &Silent).unwrap();
        (photofit_scene::load(&path).unwrap().materials[0].name.clone(), std::fs::read(path).unwrap())
    };
    let (a, b) = (file("a.glb"), file("b.glb"));
    assert_eq!(a.0, "stone");
    assert!(a.1 == b.1);
}

#[test]
fn a_cube_stays_a_cube() {
    let dir = tempfile::tempdir().unwrap();
    let progress = Watching::default();
    let by_default = SimplifyOptions { target: SimplifyOptions::default().target, steps: 0, ..options() };
    let outcome =
        simplify(&of(cube(), Material::clay()), &dir.path().join("a.glb"), &by_default, &progress).unwrap();
    assert_eq!(outcome.triangles_out, 12);
    assert!(outcome.shipped().unwrap().psnr > 30.0, "{:?}", outcome.stages);
    let warnings = progress.warnings.into_inner().unwrap();
    assert!(warnings.iter().any(|w| w.contains("12 triangles")), "{warnings:?}");
}

#[test]
fn unlit_surfaces_are_fitted_judged_and_written_as_such() {
    let dir = tempfile::tempdir().unwrap();
    let sign =
        Material { name: "sign".into(), base_color: [0.8, 0.3, 0.1, 1.0], unlit: true, ..Material::clay() };
    let scene = of(displaced_sphere(8, 0.25, 4, 3), sign);
    let path = dir.path().join("a.glb");
    let outcome = simplify(&scene, &path, &SimplifyOptions { steps: 10, ..options() }, &Silent).unwrap();
    let light = photofit_scene::load(&path).unwrap();
    let m = &light.materials[0];
    assert!(m.unlit && m.extensions.is_none() && m.alpha_mode == AlphaMode::Opaque, "{m:?}");
    assert!(m.emissive_texture.is_none() && m.emissive.iter().all(|e| *e < 1e-3), "{m:?}");
    let texels = m.base_color_texture.map_or(vec![[255; 4]], |t| light.images[t.image].texels.clone());
    for (k, wanted) in [0.8, 0.3, 0.1].into_iter().enumerate() {
        let sum: f32 = texels.iter().map(|t| photofit_image::srgb_u8_to_linear(t[k])).sum();
        let mean = m.base_color[k] * sum / texels.len() as f32;
        assert!((mean - wanted).abs() < 0.05, "channel {k}: {mean}");
    }
    // No highlight lies on the fitted pictures: what is seen inside of the outline is one colour.
    assert!(outcome.shipped().unwrap().outline > 0.9, "{:?}", outcome.stages);
    assert_eq!(outcome.judged, Judged::Rasterized);
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "gpu: needs an adapter"]
fn a_fit_on_a_device_ends_like_one_on_the_cpu_and_resumes_to_the_same_file() {
    let gpu = photofit_gpu::test_device();
    let dir = tempfile::tempdir().unwrap();
    let scene = rock();
    let on_device = SimplifyOptions { device: Device::gpu(gpu.clone(), true, "asked for"), ..options() };
    let fit = |name: &str, options: &SimplifyOptions, progress: &dyn Progress| {
        let path = dir.path().join(name);
        let outcome = simplify(&scene, &path, options, progress).unwrap();
        (outcome, std::fs::read(path).unwrap())
    };
    let (cpu, _) = fit("cpu.glb", &options(), &Silent);
    let (device, whole) = fit("device.glb", &on_device, &Silent);
    assert_eq!(cpu.device, "CPU");
    assert!(device.device.contains(&gpu.report().name), "{}", device.device);
    let plan = device.plan.to_string();
    assert!(plan.contains("asked for") && plan.contains("pictures of the reference of"), "{plan}");
    assert!(plan.contains("pictures of the reference are drawn there"), "{plan}");
    let psnr = |o: &Outcome| o.shipped().unwrap().psnr;
    println!("CPU {:.3} dB, device {:.3} dB", psnr(&cpu), psnr(&device));
    assert!((psnr(&cpu) - psnr(&device)).abs() < 0.1, "{} and {} dB", psnr(&cpu), psnr(&device));
    assert!(device.history.last().unwrap().quality > device.history[0].quality);
    for stop_at in [3, 17, 30] {
        let checkpoint = Some(dir.path().join(format!("state{stop_at}")));
        let kept = SimplifyOptions { checkpoint, ..on_device.clone() };
        let progress = Watching::stopping_at(stop_at);
        assert!(fit("stopped.glb", &kept, &progress).0.stopped, "question {stop_at}");
        let (resumed, bytes) = fit("resumed.glb", &SimplifyOptions { resume: true, ..kept }, &Silent);
        assert!(!resumed.stopped && bytes == whole, "stopped at question {stop_at}");
    }
}

/// Takes the device away once a checkpoint is saved, and keeps its step.
#[cfg(feature = "gpu")]
struct Unplugging {
    gpu: photofit_gpu::Gpu,
    saved: AtomicUsize,
}

#[cfg(feature = "gpu")]
impl Progress for Unplugging {
    fn report(&self, stage: &'static str, done: u64, _: u64, _: &str) {
        if stage == "checkpoint" {
            self.saved.store(done as usize, Ordering::Relaxed);
        }
    }

    fn is_cancelled(&self) -> bool {
        if self.saved.load(Ordering::Relaxed) > 0 {
            self.gpu.destroy();
        }
        false
    }
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "gpu: needs an adapter"]
fn a_fit_whose_device_is_lost_keeps_its_checkpoint_and_goes_on_from_it() {
    let shared = photofit_gpu::test_device();
    let named = photofit_gpu::Choice::Named(shared.report().name.clone());
    let gpu = photofit_gpu::Gpu::new(&named).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (scene, path, folder) = (rock(), dir.path().join("a.glb"), dir.path().join("state"));
    let on = |gpu: &photofit_gpu::Gpu| SimplifyOptions {
        device: Device::gpu(gpu.clone(), false, "asked for"),
        checkpoint: Some(folder.clone()),
        ..options()
    };
    let unplugging = Unplugging { gpu: gpu.clone(), saved: AtomicUsize::new(0) };
    let error = simplify(&scene, &path, &on(&gpu), &unplugging).unwrap_err();
    let FitError::Device { kept, .. } = &error else { panic!("{error}") };
    assert!(error.to_string().contains("the device was lost"), "{error}");
    let step = unplugging.saved.load(Ordering::Relaxed);
    let unchanged = format!("the checkpoint of step {step} in {} is unchanged", folder.display());
    assert!(step > 0 && *kept == unchanged, "{kept}");
    assert!(!path.exists(), "no file of a fit that broke");
    let resumed = simplify(&scene, &path, &SimplifyOptions { resume: true, ..on(shared) }, &Silent).unwrap();
    let lost = std::fs::read(&path).unwrap();
    let whole = SimplifyOptions { checkpoint: None, ..on(shared) };
    simplify(&scene, &path, &whole, &Silent).unwrap();
    assert!(!resumed.stopped && lost == std::fs::read(&path).unwrap(), "the same file as of a whole fit");
}

#[test]
fn vertex_normals_that_point_to_the_back_are_baked_as_they_are_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let mut sphere = photofit_geometry::shapes::uv_sphere(32, 16);
    let right = sphere.clone();
    sphere.normals.iter_mut().for_each(|n| *n = -*n);
    // Beside it one that is right, so that both kinds stand in one asset.
    let mut scene = of(sphere, Material::clay());
    scene.primitives.push(Primitive { mesh: right, material: 0 });
    let transform = glam::Affine3A::from_translation(glam::vec3(2.5, 0.0, 0.0));
    scene.instances.push(Instance { primitive: 1, transform });
    let heard = Heard::default();
    let baked = SimplifyOptions {
        target: Target::Triangles(600),
        steps: 0,
        texture_size: 128,
        resolution: 128,
        own_textures: false,
        report_views: 4,
        ..options()
    };
    let made = simplify(&scene, &dir.path().join("a.glb"), &baked, &heard).unwrap();
    assert!(made.stage("baked").unwrap().psnr > 24.0, "{:?}", made.stages);
    assert!(made.shipped().unwrap().psnr > 24.0, "{:?}", made.stages);
    let told = heard.0.lock().unwrap().join("\n");
    assert!(told.contains("960 of 1920 triangles point to their back"), "{told}");
    let light = photofit_scene::load(dir.path().join("a.glb")).unwrap();
    assert_eq!((light.materials.len(), light.primitives.len()), (1, 1), "normals alone tell the kinds apart");
    let opposed = photofit_geometry::opposed(&light.flatten().mesh);
    let count = opposed.iter().filter(|o| **o).count();
    assert!(count > 200 && count < opposed.len() - 200, "{count} of {}", opposed.len());
}

#[test]
fn glass_keeps_its_thickness_at_each_scale() {
    use photofit_scene::{Extensions, Transmission, Volume};
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let glass = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        volume: Some(Volume { thickness: 0.5, ..Volume::default() }),
        ..Extensions::default()
    };
    let glass = Material { name: "glass".into(), extensions: Some(Box::new(glass)), ..Material::clay() };
    let mut scene = of(photofit_geometry::shapes::uv_sphere(16, 8), glass);
    let transform = glam::Affine3A::from_translation(glam::Vec3::X * 4.0)
        * glam::Affine3A::from_scale(glam::Vec3::splat(2.0));
    scene.instances.push(Instance { primitive: 0, transform });
    for appearance in [Appearance::Maps, Appearance::Kept] {
        let few = SimplifyOptions { steps: 0, judge_spp: 2, appearance, ..options() };
        let told = simplify(&scene, &path, &few, &Silent).unwrap();
        let plan = told.plan.to_string();
        assert!(!plan.contains("of 2 materials"), "the asset has one material: {plan}");
        let light = photofit_scene::load(&path).unwrap();
        // The small ball and the large one.
        let mut found: Vec<(bool, f32)> = Vec::new();
        for p in &light.primitives {
            let volume = light.materials[p.material].extensions.as_ref().unwrap().volume.as_ref().unwrap();
            found.push((p.mesh.positions.iter().all(|p| p.x > 1.5), volume.thickness));
            assert_eq!(light.materials[p.material].name, "glass");
        }
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        let [(false, small), (true, large)] = found[..] else { panic!("{appearance:?}: {found:?}") };
        assert!((small - 0.5).abs() < 1e-3 && (large - 1.0).abs() < 1e-3, "{appearance:?}: {found:?}");
    }
}

#[test]
fn an_asset_that_no_camera_sees_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let clear = |alpha_mode| Material { base_color: [1.0, 1.0, 1.0, 0.0], alpha_mode, ..Material::clay() };
    for appearance in [Appearance::Maps, Appearance::Kept] {
        let told = |alpha_mode: AlphaMode| {
            let heard = Heard::default();
            let few = SimplifyOptions { steps: 0, target: Target::Triangles(200), appearance, ..options() };
            let scene = of(photofit_geometry::shapes::uv_sphere(24, 12), clear(alpha_mode));
            simplify(&scene, &dir.path().join("a.glb"), &few, &heard).unwrap();
            let told = heard.0.into_inner().unwrap();
            told.iter().filter(|t| t.contains("no camera sees anything")).count()
        };
        assert_eq!(told(AlphaMode::Mask { cutoff: 0.5 }), 1, "{appearance:?}");
        assert_eq!(told(AlphaMode::Blend), 1, "{appearance:?}");
        assert_eq!(told(AlphaMode::Opaque), 0, "{appearance:?}: alpha has no meaning there");
    }
}

/// Where no step comes to anything better, what is written is a start and has its name, and no row speaks of a fit.
#[test]
fn a_fit_that_gains_nothing_is_its_start() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let file = |triangles: usize, steps: u64| {
        let target = Target::Triangles(triangles);
        let few = SimplifyOptions { target, own_textures: false, effort: Effort::Fast, steps, ..options() };
        let made = simplify(&rock(), &path, &few, &Silent).unwrap();
        (made, std::fs::read(&path).unwrap())
    };
    let mut without = 0;
    for triangles in [200, 400, 640, 1280] {
        let (none, start) = file(triangles, 0);
        let (some, fitted) = file(triangles, 1);
        let first = some.history[0].quality;
        if some.history.iter().any(|h| h.quality > first) {
            continue;
        }
        without += 1;
        assert!(some.steps > 0 && start == fitted, "a step that looks worse is not written");
        for made in [&none, &some] {
            assert_eq!(made.written, Written::ShrinkWrapped);
            let names: Vec<&str> = made.stages.iter().map(|s| s.name).collect();
            assert_eq!(names, ["decimated", "shrink-wrapped", "file"]);
            assert!(made.stages.iter().all(|s| s.triangles == made.triangles_out));
            let verdict = Verdict::of(made).to_string();
            assert!(verdict.contains("drawn onto the asset's surface"), "{verdict}");
            let counts = format!("{} of {} triangles", made.triangles_out, made.triangles_in);
            assert!(made.plan.to_string().contains(&counts), "{}", made.plan);
        }
    }
    assert!(without > 0, "every first step gained");
}
