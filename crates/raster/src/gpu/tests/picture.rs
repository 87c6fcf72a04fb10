//! Whole pictures on a device against the CPU's: colours, and the gradients of everything they are made from.

use super::SCALE;
use crate::antialias::MeshTopology;
use crate::deferred::gpu::{MapShading, ShadeSlots};
use crate::deferred::{self, Geometry, Gradients, Masks, Passes, View};
use crate::gpu::tolerances::{GRADIENT, PICTURE, PICTURE_PIXELS};
use crate::gpu::{
    FrameParams, GradientBuffers, MeshBuffers, PictureBuffers, Shot, Slots, render, render_vjp,
};
use crate::maps::{CHANNELS, Maps, channel};
use crate::texture::Pyramid;
use photofit_geometry::{Mesh, shapes};
use photofit_gpu::{Gpu, Recording, assert_twin, test_device};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3, vec4};
use photofit_shading::gpu::ShadingTables;
use photofit_shading::{Environment, Light, Sides};
use photofit_texture::AlphaMode;
use photofit_texture::gpu::MipBuffers;

const BLEND: AlphaMode = AlphaMode::Blend;
const MASK: AlphaMode = AlphaMode::Mask { cutoff: 0.5 };

/// A mesh with random maps, under lights.
struct Scene {
    mesh: Mesh,
    topology: MeshTopology,
    tangents: Vec<Vec4f>,
    uvs: Vec<Vec2f>,
    maps: Pyramid<f32, CHANNELS>,
    alpha: Vec<AlphaMode>,
    sides: Vec<Sides>,
    environment: Environment<f32>,
}

/// What a picture is taken with.
#[derive(Clone, Copy)]
struct Camera {
    /// Pixels.
    width: usize,
    height: usize,
    samples: usize,
    shade_per_pixel: bool,
    /// Distance of the eye from the origin.
    distance: f32,
}

const CAMERA: Camera = Camera { width: 61, height: 45, samples: 1, shade_per_pixel: false, distance: 3.0 };

impl Scene {
    /// A bumpy sphere whose triangles have the given classes in turns; its inside is seen through holes.
    fn new(frequency: u32, alpha: &[AlphaMode], sides: &[Sides]) -> Self {
        let mesh = shapes::displaced_sphere(frequency, 0.3, 3, 5);
        let mut rng = Uniform::new(11);
        let mut next = |lo: f64, hi: f64| rng.range(lo, hi) as f32;
        let (width, height) = (64, 32);
        let mut texels = vec![[0.0; CHANNELS]; width * height];
        for t in &mut texels {
            t.iter_mut().for_each(|x| *x = next(0.1, 0.9));
            t[channel::ROUGHNESS] = next(0.3, 1.0);
            // Some alpha at both ends.
            t[channel::ALPHA] = next(-0.2, 1.2).clamp(0.0, 1.0);
            t[channel::NORMAL] = next(-0.3, 0.3);
            t[channel::NORMAL + 1] = next(-0.3, 0.3);
            t[channel::NORMAL + 2] = 0.9;
        }
        let rgb: Vec<f32> = (0..16 * 8 * 3).map(|_| next(0.0, 2.0)).collect();
        let in_turns = |n: usize| (0..mesh.triangles.len()).map(move |t| t % n.max(1));
        Self {
            topology: MeshTopology::new(&mesh.triangles, &mesh.positions),
            tangents: mesh.normals.iter().map(|n| vec4(-n.z + 0.1, 0.2, n.x, 1.0)).collect(),
            uvs: mesh.positions.iter().map(|p| vec2(0.5 + 0.35 * p.x, 0.5 + 0.35 * p.y)).collect(),
            maps: Pyramid::new(Maps { width, height, texels }),
            alpha: in_turns(alpha.len()).filter_map(|k| alpha.get(k).copied()).collect(),
            sides: in_turns(sides.len()).filter_map(|k| sides.get(k).copied()).collect(),
            environment: Environment::from_equirectangular(16, 8, &rgb).expect("an image"),
            mesh,
        }
    }

    fn geometry(&self) -> Geometry<'_, f32> {
        Geometry {
            positions: &self.mesh.positions,
            normals: &self.mesh.normals,
            tangents: &self.tangents,
            uvs: &self.uvs,
            topology: self.topology.topology(),
            alpha: &self.alpha,
            sides: &self.sides,
        }
    }

    fn with<R>(&self, c: &Camera, f: impl FnOnce(&View<'_, f32>) -> R) -> R {
        let lights = [
            Light::Point { position: vec3(1.0, 1.5, 3.0), intensity: vec3(20.0, 18.0, 15.0) },
            Light::Ambient { radiance: vec3(0.3, 0.3, 0.4) },
            Light::Environment {
                map: &self.environment,
                rotation: photofit_shading::Yaw::new(0.4),
                scale: 0.5,
            },
        ];
        f(&View {
            view_projection: [
                [1.5, 0.1, 0.2, 0.1],
                [0.0, 2.0, -0.1, 0.0],
                [0.0, 0.0, -1.05, 1.05 * c.distance - 0.5],
                [0.0, 0.0, -1.0, c.distance],
            ],
            eye: vec3(0.0, 0.0, c.distance),
            lights: &lights,
            width: c.width * c.samples,
            height: c.height * c.samples,
            samples: c.samples,
            shade_per_pixel: c.shade_per_pixel,
            lod_bias: 0.0,
        })
    }

    fn background(&self, c: &Camera) -> Vec<[f32; 3]> {
        let mut rng = Uniform::new(12);
        (0..c.width * c.height).map(|_| std::array::from_fn(|_| rng.range(0.0, 1.0) as f32)).collect()
    }
}

/// Pixels, and the gradients of positions, normals, tangents and texels.
#[derive(Clone, PartialEq)]
struct Result {
    color: Vec<[f32; 4]>,
    gradients: [Vec<f32>; 4],
    /// Layers that were drawn.
    layers: usize,
}

const NAMES: [&str; 4] = ["positions", "normals", "tangents", "texels"];

fn weights(c: &Camera) -> Vec<[f32; 4]> {
    let mut rng = Uniform::new(13);
    (0..c.width * c.height).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect()
}

fn flat(v: &[Vec3f]) -> Vec<f32> {
    v.iter().flat_map(|v| v.to_array()).collect()
}

fn on_cpu(s: &Scene, c: &Camera, passes: &Passes) -> Result {
    s.with(c, |view| {
        let frame = deferred::render(&s.geometry(), &s.maps, view, &s.background(c), passes);
        let mut out = Gradients::new(s.uvs.len(), &s.maps);
        deferred::render_vjp(&s.geometry(), &s.maps, view, passes, &frame, &weights(c), &mut out);
        let texels = out.maps.levels.iter().flat_map(|l| l.texels.concat()).collect();
        let gradients = [flat(&out.positions), flat(&out.normals), flat(&out.tangents), texels];
        Result { color: frame.color, gradients, layers: frame.layers.len() }
    })
}

/// A recorded picture.
struct Device<'a> {
    gpu: &'a Gpu,
    mesh: MeshBuffers,
    picture: PictureBuffers,
    g: GradientBuffers,
    shading: MapShading,
    recording: Recording,
    slots: [Slots; 2],
    shade_slots: ShadeSlots,
    passes: Passes,
}

impl<'a> Device<'a> {
    /// Records pictures of the size of a camera's.
    fn new(gpu: &'a Gpu, s: &Scene, c: &Camera, passes: &Passes) -> Self {
        let geometry = s.geometry();
        let uvs: Vec<_> = s.uvs.iter().map(|uv| [uv.x, uv.y]).collect();
        let mesh = MeshBuffers::new(gpu, &uvs, &geometry.topology, geometry.alpha, geometry.sides)
            .expect("uploaded");
        let pixels = c.width * c.height;
        let samples = pixels * c.samples * c.samples;
        let layers = mesh.layers(passes);
        let picture =
            PictureBuffers::new(gpu, &mesh, samples, pixels, layers, passes.antialias).expect("made");
        let g = GradientBuffers::new(gpu, &mesh, samples, pixels).expect("made");
        let fitted = std::array::from_fn(|k| k < channel::USED);
        let maps = MipBuffers::new(gpu, &s.maps, fitted).expect("uploaded");
        let tables = ShadingTables::new(gpu, &[&s.environment]).expect("uploaded");
        let mut shading = MapShading::new(gpu, maps, tables, mesh.triangles(), passes).expect("made");
        let params = s.with(c, |view| frame_params(&mesh, view, passes));
        let mut r = gpu.record("picture");
        let forward = render(&mut r, &mesh, &picture, passes, &params, &mut shading).expect("recorded");
        let reverse =
            render_vjp(&mut r, &mesh, &picture, passes, &params, &mut shading, &g).expect("recorded");
        shading.maps.record_collect(&mut r, SCALE).expect("recorded");
        let shade_slots = shading.take_slots();
        let recording = r.finish().expect("recorded");
        let slots = [forward, reverse];
        Self { gpu, mesh, picture, g, shading, recording, slots, shade_slots, passes: *passes }
    }

    /// Takes one picture of the scene.
    fn take(&mut self, s: &Scene, c: &Camera) -> Result {
        let Self { gpu, mesh, picture, g, shading, recording, slots, shade_slots, passes } = self;
        s.with(c, |view| {
            let params = frame_params(mesh, view, passes);
            slots.iter().for_each(|slots| slots.set(recording, &params));
            shade_slots.set(recording, &shading.params(view, passes, [SCALE; 2], |_| 0));
        });
        gpu.write(&mesh.positions, bytemuck::cast_slice(&s.mesh.positions)).expect("written");
        gpu.write(&mesh.normals, bytemuck::cast_slice(&s.mesh.normals)).expect("written");
        gpu.write(&mesh.tangents, bytemuck::cast_slice(&s.tangents)).expect("written");
        let background: Vec<_> = s.background(c).iter().map(|b| [b[0], b[1], b[2], 0.0]).collect();
        gpu.write(&picture.background, &background).expect("written");
        gpu.write(&g.color, &weights(c)).expect("written");
        let mut clear = gpu.record("clear");
        [&g.positions, &g.normals, &g.tangents].into_iter().for_each(|b| clear.clear(b));
        clear.clear(&shading.maps.gradient);
        clear.finish().expect("recorded").run().expect("runs");
        recording.run().expect("runs");
        assert_eq!(gpu.read(&g.status).expect("read"), [0], "sums of vertices stay in their range");
        assert_eq!(gpu.read(&shading.maps.status).expect("read"), [0], "sums of texels stay in their range");
        let vectors = |b| gpu.read::<[f32; 3]>(b).expect("read").concat();
        let texels = gpu.read(&shading.maps.gradient).expect("read").concat();
        let mut color = gpu.read(&picture.color).expect("read");
        color.truncate(c.width * c.height);
        let live = gpu.read(&picture.live).expect("read");
        Result {
            color,
            gradients: [vectors(&g.positions), vectors(&g.normals), vectors(&g.tangents), texels],
            layers: 1 + live.iter().filter(|l| **l != 0).count(),
        }
    }
}

fn frame_params(mesh: &MeshBuffers, view: &View<'_, f32>, passes: &Passes) -> FrameParams {
    let shot = Shot {
        view_projection: view.view_projection,
        width: view.width,
        height: view.height,
        samples: view.samples,
        scale: SCALE,
    };
    FrameParams::new(&shot, mesh.vertices(), mesh.triangles(), passes, mesh.fits_alpha(passes))
}

/// Norm of the difference relative to that of the expected.
fn relative(found: &[f32], expected: &[f32]) -> f64 {
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut found.iter().zip(expected).map(|(f, e)| f64::from(*f) - f64::from(*e)));
    let size = norm(&mut expected.iter().map(|e| f64::from(*e)));
    if difference == 0.0 { 0.0 } else { difference / size }
}

/// Share of pixels that differ, and relative differences of the gradients.
fn differences(found: &Result, expected: &Result) -> (f64, [f64; 4]) {
    let close = |(f, e): (&f32, &f32)| (f - e).abs() <= PICTURE * e.abs().max(1.0);
    let off = |(f, e): (&[f32; 4], &[f32; 4])| !f.iter().zip(e).all(close);
    let off = found.color.iter().zip(&expected.color).filter(|p| off(*p)).count();
    let gradients = std::array::from_fn(|k| relative(&found.gradients[k], &expected.gradients[k]));
    (off as f64 / expected.color.len() as f64, gradients)
}

fn agree(what: &str, found: &Result, expected: &Result) {
    let (off, gradients) = differences(found, expected);
    println!("{what}: {} layers, {off:.1e} of the pixels differ, gradients by {gradients:?}", found.layers);
    assert_eq!(found.color.len(), expected.color.len(), "{what}");
    assert_twin("PICTURE_PIXELS", what, off, PICTURE_PIXELS);
    for (k, error) in gradients.into_iter().enumerate() {
        assert_twin("GRADIENT", format!("{what}: gradients of {}", NAMES[k]), error, GRADIENT);
    }
}

/// Classes of alpha and sides in turns.
type Case<'a> = (&'a str, &'a [AlphaMode], &'a [Sides], Camera, Passes);

#[test]
#[ignore = "gpu: needs an adapter"]
fn pictures_and_gradients_are_those_of_the_cpu() {
    let gpu = test_device();
    let all = Passes::default();
    let faded = Masks::Faded { slope: 2.5 };
    let mixed = [AlphaMode::Opaque, BLEND, MASK];
    let four = Camera { width: 31, height: 23, samples: 4, ..CAMERA };
    let both = [Sides::Both];
    let some = [Sides::Both, Sides::Front];
    let cases: [Case<'_>; 11] = [
        ("opaque", &[], &[], CAMERA, all),
        ("fronts of some", &[], &some, CAMERA, all),
        ("samples", &[], &[], four, all),
        ("pixels shaded once", &[], &[], Camera { shade_per_pixel: true, ..four }, all),
        ("blended", &[BLEND], &both, CAMERA, all),
        ("without gradients of alpha", &mixed, &both, CAMERA, Passes { alpha_gradients: false, ..all }),
        ("cut masks", &[MASK], &some, CAMERA, all),
        ("faded masks", &mixed, &some, CAMERA, Passes { masks: faded, ..all }),
        ("two layers", &mixed, &both, four, Passes { masks: faded, max_layers: 2, ..all }),
        ("no antialiasing", &mixed, &both, four, Passes { antialias: false, ..all }),
        ("maps alone", &mixed, &both, CAMERA, Passes { position_gradients: false, ..all }),
    ];
    for (what, alpha, sides, camera, passes) in cases {
        let scene = Scene::new(9, alpha, sides);
        let expected = on_cpu(&scene, &camera, &passes);
        let found = Device::new(gpu, &scene, &camera, &passes).take(&scene, &camera);
        agree(what, &found, &expected);
        assert!(found.layers >= expected.layers && expected.color.iter().any(|c| c[3] > 0.0), "{what}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_recording_takes_other_pictures() {
    let gpu = test_device();
    let passes = Passes::default();
    let scene = Scene::new(9, &[AlphaMode::Opaque, BLEND], &[Sides::Both]);
    let mut device = Device::new(gpu, &scene, &CAMERA, &passes);
    let first = device.take(&scene, &CAMERA);
    let mut other = Scene::new(9, &[AlphaMode::Opaque, BLEND], &[Sides::Both]);
    other.mesh.positions.iter_mut().for_each(|p| p.x = 0.8 * p.x + 0.2);
    for (what, camera) in [
        ("smaller", Camera { width: 40, height: 23, ..CAMERA }),
        ("wider", Camera { width: 90, height: 17, distance: 2.6, ..CAMERA }),
        ("a pixel", Camera { width: 1, height: 1, ..CAMERA }),
        ("nothing in sight", Camera { distance: -3.0, ..CAMERA }),
    ] {
        agree(what, &device.take(&other, &camera), &on_cpu(&other, &camera, &passes));
    }
    // What was before leaves no trace.
    assert!(device.take(&scene, &CAMERA) == first, "the same bits");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_perturbed_picture_is_noticed() {
    let gpu = test_device();
    let scene = Scene::new(9, &[], &[]);
    let expected = on_cpu(&scene, &CAMERA, &Passes::default());
    let mut other = Scene::new(9, &[], &[]);
    other.mesh.positions.iter_mut().for_each(|p| p.x += 0.003);
    let found = Device::new(gpu, &scene, &CAMERA, &Passes::default()).take(&other, &CAMERA);
    let (off, gradients) = differences(&found, &expected);
    assert!(off > PICTURE_PIXELS && gradients.iter().all(|g| *g > GRADIENT), "{off} {gradients:?}");
}

#[test]
#[ignore = "measures time: cargo test -p photofit-raster --features gpu --lib picture -- --ignored --nocapture"]
fn bench() {
    let gpu = test_device();
    println!("{} with {}", gpu.report().name, gpu.report().driver);
    let least = |run: &mut dyn FnMut()| {
        let times = (0..5).map(|_| {
            let start = std::time::Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e3
        });
        times.fold(f64::INFINITY, f64::min)
    };
    for size in [256, 1024] {
        // About 10,000 triangles.
        let scene = Scene::new(22, &[], &[]);
        let camera = Camera { width: size, height: size, ..CAMERA };
        let mut device = Device::new(gpu, &scene, &camera, &Passes::default());
        device.take(&scene, &camera);
        let on_device = least(&mut || {
            device.recording.run().expect("runs");
            gpu.wait().expect("runs");
        });
        let background = scene.background(&camera);
        let (g, passes) = (weights(&camera), Passes::default());
        let mut frame = deferred::Frame::default();
        let mut out = Gradients::new(scene.uvs.len(), &scene.maps);
        let on_cpu = scene.with(&camera, |view| {
            least(&mut || {
                deferred::render_into(&scene.geometry(), &scene.maps, view, &background, &passes, &mut frame);
                deferred::render_vjp(&scene.geometry(), &scene.maps, view, &passes, &frame, &g, &mut out);
            })
        });
        println!("{size} x {size}: {on_device:.2} ms forward and reverse, CPU {on_cpu:.2} ms");
        let mut kernels: Vec<(&str, f64)> = Vec::new();
        for (name, ms) in device.recording.profile().expect("runs") {
            match kernels.iter_mut().find(|k| k.0 == name) {
                Some(k) => k.1 += ms,
                None => kernels.push((name, ms)),
            }
        }
        kernels.iter().for_each(|(name, ms)| println!("    {name}: {ms:.3} ms"));
    }
}
