//! A painted sphere, photographed by our own renderer, is painted again from its pictures.

use super::*;
use crate::Silent;
use crate::engine::plan::Runs;
use crate::scene_render::SceneRenderer;
use glam::{Affine3A, Vec3};
use photofit_geometry::shapes;
use photofit_image::Image;
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{Camera, Instance, Primitive, SurfaceLibrary, TextureImage, TextureSlot};
use photofit_shading::Light;
use serde_json::{Value, json};

/// Cameras around the sphere.
const CAMERAS: usize = 24;
const SIDE: usize = 64;
const FOV: f32 = 0.7;
const CENTER: Vec3 = Vec3::new(3.0, -1.0, 2.0);
const RADIUS: f32 = 2.0;

fn sphere(unlit: bool) -> Scene {
    let mut mesh = shapes::icosphere(10);
    mesh.uvs = mesh.positions.iter().map(|p| vec2(0.5 + 0.45 * p.x, 0.5 + 0.45 * p.y)).collect();
    let texel = |i: usize| {
        let (x, y) = ((i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0);
        let wave = |f: f32| (128.0 + 90.0 * (f * 6.0).sin()) as u8;
        [wave(x + 0.3 * y), wave(y), wave(x - y), 255]
    };
    let image = TextureImage {
        name: "waves".into(),
        width: 64,
        height: 64,
        texels: (0..64 * 64).map(texel).collect(),
        ..TextureImage::default()
    };
    let slot = TextureSlot::new(0);
    let material = Material {
        base_color: [1.0; 4],
        base_color_texture: Some(slot),
        unlit,
        roughness: 0.6,
        ..Material::clay()
    };
    Scene {
        name: "ball".into(),
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance {
            primitive: 0,
            transform: Affine3A::from_scale_rotation_translation(
                Vec3::splat(RADIUS),
                glam::Quat::IDENTITY,
                CENTER,
            ),
        }],
        materials: vec![material],
        images: vec![image],
        ..Scene::default()
    }
}

/// Writes pictures of a scene and their `transforms.json`; with a point light and a constant surrounding unless unlit.
fn photograph(scene: &Scene, folder: &Path, lit: bool) {
    let (flat, library) = (scene.flatten(), SurfaceLibrary::new(scene));
    let renderer = SceneRenderer::new(&flat, &library);
    let position = vec3(CENTER.x + 6.0, CENTER.y + 8.0, CENTER.z + 5.0);
    let intensity = Vec3f::splat(250.0);
    let radiance = Vec3f::splat(0.5);
    let lights = [Light::Point { position, intensity }, Light::Ambient { radiance }];
    let frame = |k: usize| {
        let y = 1.0 - 2.0 * (k as f32 + 0.5) / CAMERAS as f32;
        let a = k as f32 * 2.4;
        let direction = Vec3::new((1.0 - y * y).sqrt() * a.cos(), y, (1.0 - y * y).sqrt() * a.sin());
        let eye = CENTER + direction * (1.1 * RADIUS / (0.5 * FOV).sin());
        let camera = Camera::look_at(eye, CENTER, Vec3::Y, FOV, 1.0, 0.1, 50.0);
        let image = renderer.render(&camera, if lit { &lights[..] } else { &[] }, SIDE, SIDE, 4);
        let name = if lit { format!("{k}.exr") } else { format!("{k}.png") };
        if lit {
            photofit_image::write_exr(folder.join(&name), &[("", &image, &["R", "G", "B", "A"])]).unwrap();
        } else {
            let mut straight = image.clone();
            for p in straight.data.chunks_exact_mut(4).filter(|p| p[3] > 0.0) {
                (0..3).for_each(|k| p[k] /= p[3]);
            }
            photofit_image::write_png(folder.join(&name), &straight).unwrap();
        }
        let m = camera.view.inverse().transpose().to_cols_array_2d();
        json!({ "file_path": name, "transform_matrix": m })
    };
    let frames: Vec<Value> = (0..CAMERAS).map(frame).collect();
    let mut file = json!({ "camera_angle_x": FOV, "frames": frames });
    if lit {
        file["lights"] = json!([
            { "type": "point", "position": position.to_array(), "intensity": intensity.to_array() },
            { "type": "ambient", "radiance": radiance.to_array() },
        ]);
    }
    std::fs::write(folder.join(crate::pictures::FILE), file.to_string()).unwrap();
}

fn options() -> RecoverOptions {
    RecoverOptions { texture_size: 64, steps: 400, ..RecoverOptions::default() }
}

#[test]
fn a_painted_sphere_is_recovered_from_its_pictures() {
    // Least PSNR of the held-out pictures, decibels, and least gain over the grey start.
    for (lit, floor, gain) in [(true, 30.0, 8.0), (false, 30.0, 8.0)] {
        let dir = tempfile::tempdir().unwrap();
        let scene = sphere(!lit);
        photograph(&scene, dir.path(), lit);
        let output = dir.path().join("out.glb");
        let r = recover_texture(dir.path(), &scene, &output, &options(), &Silent).unwrap();
        assert_eq!((r.pictures, r.lit, r.without_alpha, r.steps), ([CAMERAS, 3], lit, 0, 400));
        assert!(r.quality.psnr > floor, "lit {lit}: {:?} from {:?}", r.quality, r.start);
        assert!(r.quality.psnr > r.start.psnr + gain, "lit {lit}: {:?} from {:?}", r.quality, r.start);
        let written = photofit_scene::load(&output).unwrap();
        let m = &written.materials[0];
        assert_eq!((m.unlit, m.name.as_str(), written.triangle_count()), (!lit, "recovered", 2000));
        assert!(m.base_color_texture.is_some() && m.normal_texture.is_none() && m.emissive_texture.is_none());
    }
}

#[test]
fn a_robust_loss_passes_over_what_stood_before_a_few_cameras() {
    let dir = tempfile::tempdir().unwrap();
    let scene = sphere(true);
    photograph(&scene, dir.path(), false);
    // A white bar before the middle of every fourth camera; the pictures that are held out have none.
    for k in (1..CAMERAS).step_by(4) {
        let file = dir.path().join(format!("{k}.png"));
        let picture = photofit_image::read(&file).unwrap();
        let bar = Image::from_fn(SIDE, SIDE, 4, |x, y, c| {
            if (SIDE / 3..SIDE / 2).contains(&y) { 1.0 } else { picture.pixel(x, y)[c] }
        });
        photofit_image::write_png(&file, &bar).unwrap();
    }
    let output = dir.path().join("out.glb");
    let run = |loss| {
        let few = RecoverOptions { steps: 150, loss, ..options() };
        recover_texture(dir.path(), &scene, &output, &few, &Silent).unwrap()
    };
    let psnr = |name: &str| {
        let r = run(PictureLoss::ALL.into_iter().find(|l| l.name() == name));
        assert!(r.plan.to_string().contains(&format!("{name} is asked for")), "{}", r.plan);
        assert!(r.quality.psnr > r.start.psnr + 1.0, "{name}: {:?} from {:?}", r.quality, r.start);
        r.quality.psnr
    };
    let (squares, robust) = (psnr("squares"), psnr("log-l1"));
    assert!(robust > squares + 1.0, "{robust} with log-l1, {squares} with squares");
    assert_eq!(run(None).plan.runs("loss"), None);
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "gpu: needs an adapter"]
fn every_loss_recovers_on_a_device_what_it_does_on_the_cpu() {
    let gpu = photofit_gpu::test_device();
    let dir = tempfile::tempdir().unwrap();
    let scene = sphere(true);
    photograph(&scene, dir.path(), false);
    let output = dir.path().join("out.glb");
    let run = |loss, device| {
        let few = RecoverOptions { steps: 40, loss, device, ..options() };
        recover_texture(dir.path(), &scene, &output, &few, &Silent).unwrap()
    };
    let all = PictureLoss::ALL.map(Some);
    let psnr = all.map(|loss| {
        let [cpu, there] =
            [Device::default(), Device::gpu(gpu.clone(), true, "asked for")].map(|d| run(loss, d));
        assert!(there.device.contains(&gpu.report().name) && cpu.device == "CPU", "{}", there.device);
        let plan = there.plan.to_string();
        assert!(plan.contains("device") && plan.contains("asked for"), "{plan}");
        let name = loss.map_or("", |l| l.name());
        println!("{name}: {:.3} dB on the CPU, {:.3} dB on the device", cpu.quality.psnr, there.quality.psnr);
        assert!((cpu.quality.psnr - there.quality.psnr).abs() < 0.1, "{name}");
        there.quality.psnr
    });
    let spread = psnr.iter().fold(f64::MIN, |m, p| m.max(*p)) - psnr.iter().fold(f64::MAX, |m, p| m.min(*p));
    assert!(spread > 0.1, "losses differ: {psnr:?}");
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "gpu: needs an adapter"]
fn a_device_with_less_memory_draws_bands_and_the_plan_says_so() {
    let name = photofit_gpu::Choice::Named(photofit_gpu::test_device().report().name.clone());
    let dir = tempfile::tempdir().unwrap();
    let scene = sphere(true);
    photograph(&scene, dir.path(), false);
    let output = dir.path().join("out.glb");
    let within = |memory: u64| {
        let caps = photofit_gpu::Caps { memory, ..photofit_gpu::Caps::NONE };
        let device = Device::gpu(photofit_gpu::Gpu::within(&name, caps).unwrap(), true, "asked for");
        let few = RecoverOptions { texture_size: 16, steps: 8, device, ..options() };
        recover_texture(dir.path(), &scene, &output, &few, &Silent)
    };
    let whole = within(u64::MAX).unwrap();
    assert!(!whole.plan.to_string().contains("bands of rows"), "{}", whole.plan);
    let mut memory = 4 << 20;
    let parts = loop {
        // Refused before pictures are drawn in bands: there is no room for what does not get smaller.
        let r = within(memory).unwrap();
        if r.plan.to_string().contains("pictures are drawn in 2 bands of rows") {
            break r;
        }
        memory = memory * 9 / 10;
    };
    println!("bands at {memory} bytes: {:.3} and {:.3} dB", whole.quality.psnr, parts.quality.psnr);
    assert!((whole.quality.psnr - parts.quality.psnr).abs() < 0.1);
}

#[test]
fn recovery_resumes_and_checks_its_options() {
    let dir = tempfile::tempdir().unwrap();
    let scene = sphere(true);
    photograph(&scene, dir.path(), false);
    let file = |options: &RecoverOptions| {
        let path = dir.path().join("out.glb");
        recover_texture(dir.path(), &scene, &path, options, &Silent).map(|_| std::fs::read(path).unwrap())
    };
    let short = RecoverOptions { steps: 30, ..options() };
    let whole = file(&short).unwrap();
    let checkpoint = Some(dir.path().join("state"));
    let kept =
        Checkpointing { checkpoint, resume: true, time_limit: Some(std::time::Duration::from_nanos(1)) };
    file(&RecoverOptions { checkpointing: kept.clone(), ..short.clone() }).unwrap();
    let kept = Checkpointing { time_limit: None, ..kept };
    assert!(file(&RecoverOptions { checkpointing: kept, ..short }).unwrap() == whole);
    let error = file(&RecoverOptions { batch: 0, ..options() }).unwrap_err().to_string();
    assert_eq!(error, "batch is 0; it must be 1 to 64");
}

#[test]
fn a_fit_that_ends_before_its_first_step_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let scene = sphere(true);
    photograph(&scene, dir.path(), false);
    let checkpointing =
        Checkpointing { time_limit: Some(std::time::Duration::ZERO), ..Checkpointing::default() };
    let ended = RecoverOptions { checkpointing, ..options() };
    let r = recover_texture(dir.path(), &scene, &dir.path().join("out.glb"), &ended, &Silent).unwrap();
    assert!(r.steps == 0 && r.plan.phases.is_empty(), "{}", r.plan);
    for what in ["map gradients", "emission gradients", "logarithmic loss"] {
        assert_eq!(r.plan.runs(what), Some(Runs::No), "{what}");
    }
}

#[test]
fn the_sides_that_are_seen_stay_those_of_the_parts() {
    let dir = tempfile::tempdir().unwrap();
    let mut scene = sphere(true);
    photograph(&scene, dir.path(), false);
    // A leaf in the sphere, seen from both sides.
    let mut leaf = scene.primitives[0].mesh.clone();
    leaf.positions.iter_mut().for_each(|p| *p *= 0.2);
    let triangles = leaf.triangles.len();
    scene.primitives.push(Primitive { mesh: leaf, material: 1 });
    scene.instances.push(Instance { primitive: 1, ..scene.instances[0] });
    scene.materials.push(Material { double_sided: true, ..Material::clay() });
    scene.about.copyright = "2026 A. Painter".into();
    scene.ignored_extensions = vec!["EXT_unheard".into()];
    let output = dir.path().join("out.glb");
    let few = RecoverOptions { texture_size: 16, steps: 1, ..options() };
    let r = recover_texture(dir.path(), &scene, &output, &few, &Silent).unwrap();
    let written = photofit_scene::load(&output).unwrap();
    let sides: Vec<(bool, usize)> = written
        .primitives
        .iter()
        .map(|p| (written.materials[p.material].double_sided, p.mesh.triangles.len()))
        .collect();
    assert_eq!(sides, [(false, 2000), (true, triangles)]);
    assert!(written.materials.iter().all(|m| m.unlit));
    assert_eq!(written.about.copyright, "2026 A. Painter");
    assert_eq!(r.left_out, ["1 extension that are not read (EXT_unheard)"]);
}
