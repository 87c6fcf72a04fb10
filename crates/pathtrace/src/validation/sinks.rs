//! What a path reports: contributions that sum up to the picture, radiance to train with, other direction samplers.

use super::scenes::{cornell, cornell_view, diffuse, glossy, looking, place, quad, square};
use super::statistics::agree;
use crate::{
    Aov, Boundary, BoundedMedium, Contribution, EnvironmentMap, Field, Found, Material, Parts, PathVertex,
    PictureSink, RenderOptions, Renderer, Shape, Sink, TrainingSink, View, World,
};
use photofit_flow::{FlowGuide, FlowOptions, Guide, Guided, Query, Waves};
use photofit_image::Image;
use photofit_sampling::{DirectionSampler, ScatteringSampler, uniform_sphere, uniform_sphere_pdf};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::SurfaceLibrary;
use photofit_shading::bsdf::{
    Bsdf, Dielectric, Distribution, Energy, Microfacet, Null, RoughDielectric, TransportMode,
};

/// A guide that knows nothing: all directions alike, with a given share.
pub(in crate::validation) struct Uniform(pub(in crate::validation) f32);

impl Guide for Uniform {
    type Local = ();

    fn local(&self, _: &Query) {}

    fn share(&self, _: &()) -> f32 {
        self.0
    }

    fn sample(&self, _: &(), u: [f32; 2]) -> Option<(Vec3f, f32)> {
        Some((uniform_sphere(u), uniform_sphere_pdf()))
    }

    fn pdf(&self, _: &(), _: Vec3f) -> f32 {
        uniform_sphere_pdf()
    }
}

/// Keeps everything.
#[derive(Default)]
struct Record {
    lights: Vec<Contribution>,
    vertices: Vec<PathVertex>,
    /// Product of the weights of vertices and of the factors between them.
    throughput: Option<Vec3f>,
}

impl Sink for Record {
    fn vertex(&mut self, vertex: &PathVertex) {
        let before = self.throughput.unwrap_or(Vec3f::splat(1.0));
        near("a vertex tells the throughput", vertex.throughput, before);
        self.throughput = Some(before.mul(vertex.weight));
        self.vertices.push(*vertex);
    }

    fn attenuate(&mut self, factor: Vec3f) {
        self.throughput = Some(self.throughput.unwrap_or(Vec3f::splat(1.0)).mul(factor));
    }

    fn contribution(&mut self, light: &Contribution) {
        near("light tells the throughput", light.throughput, self.throughput.unwrap_or(Vec3f::splat(1.0)));
        self.lights.push(*light);
    }
}

fn near(what: &str, a: Vec3f, b: Vec3f) {
    for c in 0..3 {
        assert!((a[c] - b[c]).abs() <= 1e-4 * b[c].abs() + 1e-7, "{what}: {a:?}, {b:?}");
    }
}

/// Balls of glass (frosted with this alpha), metal and plaster on a floor, with a lamp, under a sky.
fn mixed(alpha: f32) -> World {
    let mut parts = Parts::default();
    let ground = quad(vec3(-3.0, 0.0, -3.0), vec3(0.0, 0.0, 6.0), vec3(6.0, 0.0, 0.0));
    place(&mut parts, ground, Material::new(diffuse(0.5, 0.6, 0.4)));
    let one = Vec3f::splat(1.0);
    let glass = Dielectric { ior: 1.5, reflectance: one, transmittance: one, mode: TransportMode::Radiance };
    let surface = Microfacet::isotropic(Distribution::Ggx, alpha);
    let mut tinted = Material::new(Bsdf::RoughDielectric(RoughDielectric { glass, surface }));
    tinted.absorption = vec3(0.2, 1.0, 2.0);
    let kinds = [
        tinted,
        Material::new(glossy(0.8, 0.25, 1.0, Energy::Compensated)),
        Material::new(diffuse(0.8, 0.3, 0.2)),
    ];
    for (i, material) in kinds.into_iter().enumerate() {
        let center = vec3(i as f32 * 0.7 - 0.7, 0.3, 0.0);
        parts.add(Shape::Sphere { center, radius: 0.3 }, material);
    }
    let lamp = Shape::Sphere { center: vec3(0.5, 1.0, 0.4), radius: 0.15 };
    parts.add(lamp, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(vec3(8.0, 4.0, 2.0)));
    let sky = Image::from_fn(24, 12, 3, |x, y, c| {
        (if y < 6 { 0.4 + 0.1 * c as f32 } else { 0.05 }) + if (x, y) == (5, 3) { 60.0 } else { 0.0 }
    });
    parts.environment = Some(EnvironmentMap::new(sky));
    World::new(parts).unwrap()
}

/// A box with a lamp, full of fog.
fn foggy() -> World {
    let mut parts = cornell();
    let medium = BoundedMedium::homogeneous(vec3(1.5, 1.0, 0.5), vec3(0.9, 0.8, 0.7), 0.3);
    parts.media.push(medium);
    let fog = parts
        .add(Shape::Sphere { center: vec3(0.0, 0.5, 0.0), radius: 0.3 }, Material::new(Bsdf::Null(Null)));
    parts.boundaries.push(Boundary { instance: fog, interior: Some(0), exterior: None });
    World::new(parts).unwrap()
}

/// The same, and the fog emits light of its own.
fn glowing() -> World {
    let mut world = foggy();
    let medium = BoundedMedium::homogeneous(vec3(1.5, 1.0, 0.5), vec3(0.9, 0.8, 0.7), 0.3);
    let emission = Some(Field::constant(vec3(0.5, 1.0, 2.0)));
    world.set_medium(0, BoundedMedium { emission, ..medium }).unwrap();
    world
}

fn from_above() -> View {
    looking([0.0, 1.2, 2.2], [0.0, 0.2, 0.0], 0.8)
}

/// A flow of random weights.
fn random_flow() -> FlowGuide {
    let mut guide = FlowGuide::new(Vec3f::splat(-2.0), Vec3f::splat(2.0), FlowOptions::default()).unwrap();
    guide.randomize(0.3, 1);
    guide
}

/// Worlds where something is in the way of lights: solid, absorbing, and a medium.
fn lights_with_obstacles() -> [(&'static str, World, View); 3] {
    [
        ("box", World::new(cornell()).unwrap(), cornell_view()),
        ("mixed", mixed(0.4), from_above()),
        ("fog", foggy(), cornell_view()),
    ]
}

#[test]
fn paths_side_by_side_make_the_same_picture() {
    let guide = random_flow();
    for (name, world, view) in lights_with_obstacles() {
        for aovs in [Vec::new(), vec![Aov::Albedo, Aov::Normal]] {
            // Tiles at the edge are 3 pixels wide.
            let options = RenderOptions { aovs: aovs.clone(), ..square(19, 70) };
            let picture = |side_by_side: bool| {
                let mut renderer = Renderer::new(&world, &view, options.clone()).unwrap();
                while !match side_by_side {
                    true => renderer.pass_side_by_side(&Waves(&guide), || false),
                    false => renderer.pass_with(&Guided(&guide), || false),
                }
                .done
                {}
                let auxiliary: Vec<Image> = aovs.iter().filter_map(|a| renderer.aov(*a)).collect();
                (renderer.picture(), renderer.sample_variance(), auxiliary, renderer.progress())
            };
            let (together, single) = (picture(true), picture(false));
            assert!(together == single, "{name}, {aovs:?}: {:?} {:?}", together.3, single.3);
            assert!(single.0.data.iter().any(|v| *v > 0.0), "{name}");
        }
    }
}

/// A picture whose sink wants to know of light that does not arrive, too.
#[derive(Default)]
struct Curious(PictureSink);

impl Sink for Curious {
    const SURFACES: bool = true;
    const MEDIA: bool = true;

    fn contribution(&mut self, light: &Contribution) {
        self.0.contribution(light);
    }

    fn not_finite(&mut self) {
        self.0.not_finite();
    }
}

#[test]
fn light_that_waits_for_its_weight_is_that_which_does_not() {
    let guide = random_flow();
    for (name, world, view) in lights_with_obstacles() {
        let renderer = Renderer::new(&world, &view, square(16, 8)).unwrap();
        let mut sum = 0.0;
        for path in 0..16 * 16 * 8 {
            let (pixel, sample) = ([path / 8 % 16, path / 128], (path % 8) as u32);
            let (mut waiting, mut curious) = (PictureSink::default(), Curious::default());
            renderer.walk(pixel, sample, &Guided(&guide), &mut waiting);
            renderer.walk(pixel, sample, &Guided(&guide), &mut curious);
            let (a, b) = (waiting.radiance, curious.0.radiance);
            assert_eq!(a, b, "{name}, {pixel:?}, {sample}");
            sum += a.x;
        }
        assert!(sum > 0.0, "{name}");
    }
}

/// A guide whose densities are no numbers.
struct Broken;

impl Guide for Broken {
    type Local = ();

    fn local(&self, _: &Query) {}

    fn share(&self, (): &()) -> f32 {
        0.5
    }

    fn sample(&self, (): &(), u: [f32; 2]) -> Option<(Vec3f, f32)> {
        Some((uniform_sphere(u), f32::NAN))
    }

    fn pdf(&self, (): &(), _: Vec3f) -> f32 {
        f32::NAN
    }
}

#[test]
fn light_without_a_weight_is_left_out() {
    let world = World::new(cornell()).unwrap();
    let renderer = Renderer::new(&world, &cornell_view(), square(16, 4)).unwrap();
    let (mut picture, mut sink) = (PictureSink::default(), TrainingSink::weighted());
    for pixel in 0..16 * 16 {
        let at = [pixel % 16, pixel / 16];
        renderer.walk(at, 0, &Guided(&Broken), &mut picture);
        sink.begin();
        renderer.walk(at, 0, &Guided(&Broken), &mut sink);
    }
    assert!(picture.radiance.is_finite() && picture.not_finite > 10, "{picture:?}");
    assert!(sink.vertices.iter().all(|v| v.radiance.is_finite()));
}

#[test]
fn contributions_sum_up_to_the_picture() {
    let cases = [
        ("box", World::new(cornell()).unwrap(), cornell_view()),
        ("mixed", mixed(0.0), from_above()),
        ("fog", foggy(), cornell_view()),
        ("glowing fog", glowing(), cornell_view()),
    ];
    const SPP: u32 = 8;
    for (name, world, view) in cases {
        let mut renderer = Renderer::new(&world, &view, square(12, SPP)).unwrap();
        while !renderer.pass(|| false).done {}
        let picture = renderer.picture();
        let mut found = [0_usize; 4];
        for y in 0..12 {
            for x in 0..12 {
                let mut sum = [0.0_f64; 3];
                for sample in 0..SPP {
                    let mut record = Record::default();
                    renderer.walk([x, y], sample, &ScatteringSampler, &mut record);
                    for light in &record.lights {
                        let density = if light.found == Found::NextEvent { light.pdf } else { 1.0 };
                        let local = light.scattering.mul(light.radiance).mul(light.transmittance);
                        near(name, light.value, light.throughput.mul(local) * (light.weight / density));
                        found[light.found as usize] += usize::from(light.value != Vec3f::zero());
                        (0..3).for_each(|c| sum[c] += f64::from(light.value[c]));
                    }
                    assert!(record.vertices.windows(2).all(|v| v[1].depth == v[0].depth + 1), "{name}");
                }
                for c in 0..3 {
                    let (mean, expected) = (sum[c] / f64::from(SPP), f64::from(picture.pixel(x, y)[c]));
                    assert!((mean - expected).abs() <= 1e-5 * expected, "{name}: {mean} {expected}");
                }
            }
        }
        assert!(found[0] > 500 && found[1] > 10, "{name}: {found:?}");
        assert!((found[2] > 0) == world.lights.environment.is_some(), "{name}: {found:?}");
        assert!((found[3] > 100) == name.starts_with("glowing"), "{name}: {found:?}");
    }
}

#[test]
fn light_that_is_met_and_not_finite_is_left_out_of_all_sinks() {
    // A lamp whose two parts of emission overflow, above a floor under a sky.
    let glowing = photofit_scene::Material { emissive: [3e38; 3], ..photofit_scene::Material::clay() };
    let scene = photofit_scene::Scene { materials: vec![glowing], ..Default::default() };
    let mut parts = Parts { library: Some(SurfaceLibrary::new(&scene)), ..Parts::default() };
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let lamp = Shape::Sphere { center: vec3(0.0, 1.0, 0.0), radius: 0.5 };
    parts.add(lamp, Material::from_library(0).emitting(Vec3f::splat(3e38)));
    let floor = quad(vec3(-3.0, 0.0, -3.0), vec3(0.0, 0.0, 6.0), vec3(6.0, 0.0, 0.0));
    place(&mut parts, floor, Material::new(diffuse(0.5, 0.5, 0.5)));
    let world = World::new(parts).unwrap();
    let view = looking([0.0, 2.0, 4.0], [0.0, 0.0, 0.0], 0.5);
    let renderer = Renderer::new(&world, &view, square(16, 16)).unwrap();
    let (mut seen, mut picture, mut sink) = (0.0, PictureSink::default(), TrainingSink::default());
    for pixel in 0..16 * 16 {
        let at = [pixel % 16, pixel / 16];
        let before = picture.not_finite;
        picture.radiance = Vec3f::zero();
        renderer.walk(at, 0, &ScatteringSampler, &mut picture);
        // Light of the same path that is finite stays.
        seen += if picture.not_finite > before { picture.radiance.x } else { 0.0 };
        sink.begin();
        renderer.walk(at, 0, &ScatteringSampler, &mut sink);
        assert!(picture.radiance.is_finite(), "pixel {at:?}");
    }
    assert!(picture.not_finite > 10, "{}", picture.not_finite);
    assert!(seen > 0.0, "the rest of such paths is seen");
    assert!(sink.vertices.iter().all(|v| v.radiance.is_finite()), "nothing to train with that is not finite");
}

#[test]
fn recorded_radiance_is_what_arrives() {
    // Inside of a glowing sphere with Le = Kd = 1/2 radiance is 1 everywhere and from everywhere; also where the sphere is full
    // of a coloured medium that emits what it absorbs.
    for full in [false, true] {
        let mut parts = Parts::default();
        let mut material = Material::new(diffuse(0.5, 0.5, 0.5)).emitting(Vec3f::splat(0.5));
        (material.emits_both_sides, material.two_sided) = (true, true);
        parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 1.0 }, material);
        if full {
            let (extinction, albedo) = (vec3(1.5, 0.2, 0.6), vec3(0.3, 0.8, 0.1));
            let emission = Some(Field::constant(extinction.mul(albedo.map(|a| 1.0 - a))));
            let medium = BoundedMedium::homogeneous(extinction, albedo, 0.2);
            parts.media.push(BoundedMedium { emission, ..medium });
            parts.medium_around_camera = Some(0);
        }
        recorded_radiance_is_one(parts);
    }
}

fn recorded_radiance_is_one(parts: Parts) {
    let world = World::new(parts).unwrap();
    let view = looking([0.3, 0.1, 0.2], [0.0, 0.4, -1.0], 1.2);
    let mut options = square(16, 64);
    options.path.max_depth = 100;
    let renderer = Renderer::new(&world, &view, options).unwrap();
    let guide = Uniform(0.4);
    let guided = Guided(&guide);
    for (name, mean) in [
        ("scattering", mean_of_vertices(&renderer, &ScatteringSampler)),
        ("mixture", mean_of_vertices(&renderer, &guided)),
    ] {
        for (depth, (mean, error)) in mean.into_iter().enumerate() {
            assert!((mean - 1.0).abs() < 4.0 * error + 1e-4, "{name}, vertex {depth}: {mean} +- {error}");
            assert!(error < 0.05, "{name}: {error}");
        }
    }
}

/// Mean of the recorded radiance at the first two vertices of paths, with its standard error.
fn mean_of_vertices(renderer: &Renderer<'_>, sampler: &impl DirectionSampler) -> [(f64, f64); 2] {
    let mut sums = [[0.0_f64; 3]; 2];
    let mut sink = TrainingSink::default();
    for pixel in 0..16 * 16 {
        for sample in 0..16 {
            sink.vertices.clear();
            sink.begin();
            renderer.walk([pixel % 16, pixel / 16], sample, sampler, &mut sink);
            for v in sink.vertices.iter().filter(|v| v.event.depth < 2) {
                let in_medium = v.event.instance == u32::MAX;
                let above =
                    in_medium || v.event.wi.dot(v.event.normal) * v.event.wo.dot(v.event.normal) > 0.0;
                assert!(above && v.event.pdf > 0.0, "{v:?}");
                let value = f64::from(v.radiance.x);
                let sum = &mut sums[v.event.depth as usize];
                *sum = [sum[0] + 1.0, sum[1] + value, sum[2] + value * value];
            }
        }
    }
    sums.map(|[n, sum, squares]| {
        let mean = sum / n;
        (mean, ((squares / n - mean * mean) / n).sqrt())
    })
}

/// Mean and variance of the samples of a picture whose paths take directions of a sampler.
fn rendered_with(
    renderer: &Renderer<'_>,
    side: usize,
    spp: u32,
    sampler: &impl DirectionSampler,
) -> [Image; 2] {
    let mut out = [Image::new(side, side, 4), Image::new(side, side, 3)];
    for y in 0..side {
        for x in 0..side {
            let mut sums = [[0.0_f64; 2]; 3];
            for sample in 0..spp {
                let mut sink = PictureSink::default();
                renderer.walk([x, y], sample, sampler, &mut sink);
                for (sum, v) in sums.iter_mut().zip(sink.radiance.to_array().map(f64::from)) {
                    *sum = [sum[0] + v, sum[1] + v * v];
                }
            }
            let n = f64::from(spp);
            for (c, [sum, squares]) in sums.into_iter().enumerate() {
                out[0].pixel_mut(x, y)[c] = (sum / n) as f32;
                out[1].pixel_mut(x, y)[c] = ((squares - sum * sum / n).max(0.0) / (n - 1.0)) as f32;
            }
        }
    }
    out
}

#[test]
fn other_direction_samplers_give_the_same_picture() {
    const SPP: u32 = 256;
    let guide = Uniform(0.35);
    let sampler = Guided(&guide);
    for (name, world, view) in [
        ("box", World::new(cornell()).unwrap(), cornell_view()),
        ("mixed", mixed(0.0), from_above()),
        ("frosted", mixed(0.4), from_above()),
    ] {
        let options = |seed| {
            let mut options = RenderOptions { seed, ..square(16, SPP) };
            options.path.max_depth = 4;
            options
        };
        let (first, second) = (options(1), options(2));
        let [a, va] =
            rendered_with(&Renderer::new(&world, &view, first).unwrap(), 16, SPP, &ScatteringSampler);
        let [b, vb] = rendered_with(&Renderer::new(&world, &view, second).unwrap(), 16, SPP, &sampler);
        agree(name, (&a, &va, SPP), (&b, &vb, SPP));
        assert!(a.data != b.data, "{name}: the mixture takes other directions");
    }
}
