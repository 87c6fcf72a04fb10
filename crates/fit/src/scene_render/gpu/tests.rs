//! Pictures of scenes on a device against those of the CPU.

use super::tolerances::{CLOSE, SCENE_MEAN, SCENE_PIXELS, THROUGH_GLASS};
use super::*;
use crate::engine::gpu::DrawnThere;
use crate::engine::reference::{Rasterized, Reference};
use crate::engine::views::{Moment, Setup, ViewLight, studio};
use crate::scene_render::tests::{camera, lamp_behind_glass, spheres};
use photofit_gpu::{Caps, Choice, assert_twin, test_device};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Scene;

/// One of each kind.
fn lights() -> Vec<ViewLight> {
    vec![
        ViewLight::Point { position: vec3(3.0, 4.0, 5.0), intensity: Vec3f::splat(60.0) },
        ViewLight::Directional { direction: vec3(0.0, 0.6, 0.8), irradiance: vec3(0.9, 0.5, 0.2) },
        ViewLight::Ambient { radiance: vec3(0.1, 0.2, 0.3) },
        ViewLight::Environment { map: studio(), yaw: 0.7 },
    ]
}

/// A scene as renderers take it.
struct Ready {
    flat: FlatScene,
    library: SurfaceLibrary,
}

impl Ready {
    fn new(scene: &Scene) -> Self {
        Self { flat: scene.flatten(), library: SurfaceLibrary::new(scene) }
    }

    fn on(&self, gpu: &Gpu) -> DeviceScene {
        DeviceScene::new(gpu, &self.flat, &self.library).expect("uploaded")
    }

    fn reference(&self, samples: usize) -> Rasterized<'_> {
        Rasterized::new(&self.flat, &self.library).sampled(samples)
    }

    fn on_cpu(&self, asked: &PictureRequest<'_>) -> Image {
        self.reference(asked.samples).picture(&setup(asked)).expect("drawn").image
    }
}

/// What a reference is asked for.
fn setup(asked: &PictureRequest<'_>) -> Setup {
    let [width, height] = asked.size;
    Setup {
        camera: (*asked.camera).into(),
        lights: asked.lights.clone(),
        moment: Moment::default(),
        width,
        height,
        picture: None,
        backs: asked.backs,
    }
}

/// Share of pixels that differ, and the mean difference relative to the mean.
fn differences(found: &Image, expected: &Image) -> (f64, f64) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let close = |(f, e): (&f32, &f32)| (f - e).abs() <= CLOSE * e.abs().max(1.0);
    let pixels = found.data.chunks_exact(4).zip(expected.data.chunks_exact(4));
    let off = pixels.filter(|(f, e)| !f.iter().zip(*e).all(close)).count();
    let sum = |x: &mut dyn Iterator<Item = f32>| x.map(|x| f64::from(x.abs())).sum::<f64>();
    let difference = sum(&mut found.data.iter().zip(&expected.data).map(|(f, e)| f - e));
    (off as f64 / expected.pixels() as f64, difference / sum(&mut expected.data.iter().copied()))
}

fn agree(what: &str, found: &Image, expected: &Image) {
    let (off, mean) = differences(found, expected);
    assert_twin("SCENE_PIXELS", what, off, SCENE_PIXELS);
    assert_twin("SCENE_MEAN", what, mean, SCENE_MEAN);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn pictures_of_a_scene_are_those_of_the_cpu() {
    let (gpu, scene, camera) = (test_device(), Ready::new(&spheres()), camera());
    let mut device = scene.on(gpu);
    let all = lights();
    let of = |lights: &[ViewLight]| ViewLights(lights.to_vec());
    let cases = [
        ("all lights", of(&all), [150, 130], 4, false),
        ("a sample a pixel", of(&all), [150, 130], 1, false),
        ("many samples", of(&all), [50, 40], 16, false),
        ("a point", of(&all[..1]), [150, 130], 2, false),
        ("an environment and backs", of(&all[3..]), [150, 130], 2, true),
        ("no light", of(&[]), [150, 130], 2, true),
        ("smaller", of(&all), [9, 7], 4, false),
    ];
    for (what, lights, size, samples, backs) in cases {
        let asked = PictureRequest { camera: &camera, lights: &lights, size, samples, backs };
        let (found, expected) = (device.draw(&asked).expect("drawn"), scene.on_cpu(&asked));
        agree(what, &found, &expected);
        let covered = expected.data.chunks_exact(4).filter(|p| p[3] > 0.0).count();
        assert!(5 * covered > expected.pixels(), "{what}: {covered} pixels");
        assert_eq!(device.bands(), 1, "{what}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_reference_that_is_drawn_on_a_device_gives_the_pictures_of_the_cpu() {
    let (gpu, scene, camera) = (test_device(), Ready::new(&spheres()), camera());
    let all = ViewLights(lights());
    let each = lights().into_iter().map(|light| ViewLights(vec![light]));
    let asked =
        |lights, size, samples, backs| PictureRequest { camera: &camera, lights, size, samples, backs };
    let ones: Vec<ViewLights> = each.collect();
    let one =
        ones.iter().enumerate().map(|(k, lights)| (format!("light {k}"), asked(lights, [90, 80], 2, false)));
    let more = [
        ("backs".to_owned(), asked(&all, [90, 80], 4, true)),
        ("16 samples".to_owned(), asked(&all, [40, 50], 16, false)),
        ("16 samples and backs".to_owned(), asked(&all, [50, 30], 16, true)),
    ];
    for (what, asked) in one.chain(more) {
        let on_cpu = scene.reference(asked.samples);
        let there = DrawnThere::new(gpu, on_cpu, true);
        let setup = setup(&asked);
        let [found, expected] =
            [&there as &dyn Reference, &on_cpu].map(|r| r.picture(&setup).expect("drawn"));
        agree(&what, &found.image, &expected.image);
        assert_eq!(found.noise, expected.noise, "{what}");
        assert_eq!(
            there.where_drawn().as_deref(),
            Some("pictures of the reference are drawn there"),
            "{what}"
        );
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn opaque_scenes_without_colours_or_textures_are_drawn_in_one_layer() {
    let mut plain = spheres();
    plain.primitives.iter_mut().for_each(|p| (p.mesh.colors, p.mesh.uvs1) = (Vec::new(), Vec::new()));
    plain.instances.retain(|i| i.primitive == 4 || i.primitive == 3);
    let (gpu, scene, camera) = (test_device(), Ready::new(&plain), camera());
    let mut device = scene.on(gpu);
    assert_eq!((device.scene.layers, device.scene.layout.tangent, device.scene.layout.color), (1, 0, 0));
    let lights = ViewLights(lights());
    let asked =
        PictureRequest { camera: &camera, lights: &lights, size: [100, 100], samples: 4, backs: false };
    agree("plain", &device.draw(&asked).expect("drawn"), &scene.on_cpu(&asked));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_picture_has_the_same_bits_whatever_was_drawn_before() {
    let (scene, camera) = (Ready::new(&spheres()), camera());
    // Of its own: other tests would count among its submissions.
    let gpu = Gpu::new(&Choice::Named(test_device().report().name.clone())).expect("opened");
    let mut device = scene.on(&gpu);
    let (all, point) = (ViewLights(lights()), ViewLights(lights()[..1].to_vec()));
    let asked = PictureRequest { camera: &camera, lights: &all, size: [90, 80], samples: 4, backs: false };
    let first = device.draw(&asked).expect("drawn");
    for other in [
        PictureRequest { size: [80, 75], lights: &point, backs: true, ..asked },
        PictureRequest { size: [20, 20], samples: 8, ..asked },
    ] {
        device.draw(&other).expect("drawn");
        assert!(device.draw(&asked).expect("drawn") == first, "after {:?}", other.size);
    }
    let traffic = gpu.traffic();
    device.draw(&asked).expect("drawn");
    let submissions = gpu.traffic().submissions - traffic.submissions;
    assert_eq!(submissions, 2, "a picture and its readback");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_perturbed_scene_is_noticed() {
    let (gpu, scene, camera) = (test_device(), Ready::new(&spheres()), camera());
    let lights = ViewLights(lights());
    let asked =
        PictureRequest { camera: &camera, lights: &lights, size: [120, 120], samples: 4, backs: false };
    let expected = scene.on_cpu(&asked);
    let mut moved = spheres();
    moved.primitives[0].mesh.positions.iter_mut().for_each(|p| p.x += 0.001);
    let mut rough = spheres();
    rough.materials[4].roughness -= 0.002;
    let mut textured = spheres();
    textured.images[1].texels.iter_mut().for_each(|t| t[1] = t[1].saturating_add(2));
    let mut masked = spheres();
    masked.materials[1].alpha_mode = photofit_scene::AlphaMode::Mask { cutoff: 0.41 };
    for (what, other) in [("moved", moved), ("rough", rough), ("textured", textured), ("masked", masked)] {
        let found = Ready::new(&other).on(gpu).draw(&asked).expect("drawn");
        let (off, _) = differences(&found, &expected);
        assert!(off > SCENE_PIXELS, "{what}: {off}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn what_lies_behind_glass_of_any_alpha_is_seen_on_a_device() {
    let gpu = test_device();
    for alpha in [0.5_f32, 0.99, 0.999, 0.9999, 1.0] {
        let (scene, camera) = lamp_behind_glass(alpha);
        let lights = ViewLights::default();
        let asked =
            PictureRequest { camera: &camera, lights: &lights, size: [8, 8], samples: 1, backs: false };
        let picture = Ready::new(&scene).on(gpu).draw(&asked).expect("drawn");
        let (seen, expected) = (f64::from(picture.pixel(4, 4)[0]), f64::from(1000.0 * (1.0 - alpha)));
        let error = (seen - expected).abs() / expected.max(f64::MIN_POSITIVE);
        assert_twin("THROUGH_GLASS", format!("alpha {alpha}"), error, THROUGH_GLASS);
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_picture_in_bands_is_the_whole_one() {
    let (shared, scene, camera) = (test_device(), Ready::new(&spheres()), camera());
    let lights = ViewLights(lights());
    let asked =
        PictureRequest { camera: &camera, lights: &lights, size: [150, 131], samples: 4, backs: false };
    let whole = scene.on(shared).draw(&asked).expect("drawn");
    let named = Choice::Named(shared.report().name.clone());
    // The samples of 54 rows can be bound.
    let caps = Caps { binding: 16 * 150 * 16 * 54, ..Caps::NONE };
    let small = Gpu::within(&named, caps).expect("opened");
    let mut device = scene.on(&small);
    let banded = device.draw(&asked).expect("drawn");
    assert_eq!(device.bands(), 3);
    agree("three bands", &banded, &whole);
    // Bands and bits are those of the picture, whatever was drawn before.
    let fewer = PictureRequest { size: [150, 100], ..asked };
    let after = device.draw(&fewer).expect("drawn");
    agree("fewer rows", &after, &scene.on_cpu(&fewer));
    let mut fresh = scene.on(&small);
    assert!(fresh.draw(&fewer).expect("drawn") == after && fresh.bands() == 2);
    assert!(device.draw(&asked).expect("drawn") == banded);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn pictures_without_room_are_refused() {
    let (shared, scene, camera) = (test_device(), Ready::new(&spheres()), camera());
    let lights = ViewLights(lights());
    let asked =
        PictureRequest { camera: &camera, lights: &lights, size: [150, 131], samples: 4, backs: false };
    let named = Choice::Named(shared.report().name.clone());
    // By the limits, before anything is allocated: more pixels, or more samples in a row, than are bound.
    let small = Gpu::within(&named, Caps { binding: 16 * 150 * 131, ..Caps::NONE }).expect("opened");
    let told = |size, samples| DeviceScene::refused(&small, &PictureRequest { size, samples, ..asked });
    assert_eq!(told([150, 131], 4), None);
    assert!(told([150, 132], 4).is_some_and(|t| t.contains("its pixels take 316800 of 314400 bytes")));
    assert!(told([76, 1], 16).is_none() && told([77, 1], 16).is_some_and(|t| t.contains("samples of a row")));
    // By the memory: it is given back.
    let gpu = Gpu::within(&named, Caps { memory: 12 << 20, ..Caps::NONE }).expect("opened");
    let mut device = scene.on(&gpu);
    device.draw(&PictureRequest { size: [8, 8], ..asked }).expect("drawn");
    let error = device.draw(&asked).expect_err("no room");
    assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
    assert!(device.bytes(&asked) > 12 << 20 && device.stage.is_none());
    device.draw(&PictureRequest { size: [8, 8], ..asked }).expect("drawn");
}

#[test]
#[ignore = "measures time: cargo test -p photofit-fit --features gpu --lib scene_render::gpu -- --ignored --nocapture"]
fn bench() {
    let (gpu, camera) = (test_device(), camera());
    let lights = ViewLights(lights());
    let mut opaque = spheres();
    opaque.materials.iter_mut().for_each(|m| m.alpha_mode = photofit_scene::AlphaMode::Opaque);
    for (what, scene) in [("transparent", spheres()), ("opaque", opaque)] {
        let scene = Ready::new(&scene);
        let mut device = scene.on(gpu);
        for size in [128, 256] {
            let asked = PictureRequest {
                camera: &camera,
                lights: &lights,
                size: [size; 2],
                samples: 4,
                backs: false,
            };
            let least = |run: &mut dyn FnMut()| {
                let times = (0..2).map(|_| {
                    let start = std::time::Instant::now();
                    run();
                    start.elapsed().as_secs_f64() * 1e3
                });
                times.fold(f64::INFINITY, f64::min)
            };
            let there = least(&mut || drop(device.draw(&asked).expect("drawn")));
            let here = least(&mut || drop(scene.on_cpu(&asked)));
            println!("{what}, {size} x {size}, {} bands: {there:.1} ms, CPU {here:.1} ms", device.bands());
        }
    }
}
