//! Gradients of path replay against central differences of renders with paired seeds.

mod filters;
mod samplers;
mod sharing;
mod splitting;
pub(super) mod tapes;

use super::scenes::{cornell, cornell_view, diffuse, looking, place, quad, square};
use crate::{
    Adjoint, BsdfSource, EnvironmentMap, Falloff, GradientSamples, LightSource, Material, MaterialValue,
    Parameter, Parts, PathtraceError, RenderOptions, Renderer, Shape, View, World,
};
use glam::DVec3;
use photofit_geometry::shapes;
use photofit_image::Image;
use photofit_sampling::{hash, unit_f32};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{
    Instance, MapKind, Material as SceneMaterial, Primitive, Scene, TextureImage, TextureSlot,
};
use photofit_shading::bsdf::{Bsdf, Conductor, Distribution, Microfacet, Null, RoughConductor};

const SIDE: usize = 16;
const SPP: u32 = 64;
/// Independent estimates of either kind.
const REPLICATES: u64 = 8;

/// A number in [0, 1) for two keys.
fn noise(a: u64, b: u64) -> f32 {
    unit_f32((hash(0x6ead, a, b) >> 32) as u32)
}

/// Weights of a loss that is linear in the picture: random, of both signs.
fn weights() -> Image {
    Image::from_fn(SIDE, SIDE, 3, |x, y, c| 1.4 * noise((y * SIDE + x) as u64, c as u64) - 0.4)
}

/// Sum of a picture, weighted.
fn loss(world: &World, view: &View, options: RenderOptions) -> f64 {
    let mut renderer = Renderer::new(world, view, options).unwrap();
    while !renderer.pass(|| false).done {}
    let (picture, weights) = (renderer.picture(), weights());
    let pixel = |i: usize| {
        (0..3).map(|c| f64::from(picture.data[4 * i + c]) * f64::from(weights.data[3 * i + c])).sum::<f64>()
    };
    (0..SIDE * SIDE).map(pixel).sum()
}

/// Mean and standard error.
fn statistics(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// A parameter, and how to change it.
struct Case<'a> {
    name: &'a str,
    world: &'a dyn Fn() -> World,
    view: View,
    parameter: Parameter,
    /// Length of the central difference's step along a random direction of values in [0.5, 1).
    step: f64,
    /// Adds numbers to the values.
    edit: &'a dyn Fn(&mut World, &[f64]),
}

impl Case<'_> {
    /// Compares the derivatives along a random direction; accepts 2 % or four standard errors, which must be small
    /// themselves.
    fn check(&self) {
        let options = |seed| {
            let mut options = RenderOptions { seed, ..square(SIDE, SPP) };
            options.path.max_depth = 4;
            options
        };
        let world = (self.world)();
        let adjoint =
            Adjoint::new(&world, &self.view, options(0), std::slice::from_ref(&self.parameter)).unwrap();
        let mut direction = Vec::new();
        let replayed = |seed: u64| {
            let samples = GradientSamples { spp: SPP, seed: Some(1000 + seed) };
            let gradient = adjoint.render_vjp(&weights(), samples).unwrap();
            assert!(gradient.residual < 1e-9, "{}: {} is left", self.name, gradient.residual);
            assert_eq!(gradient.not_finite, 0, "{}", self.name);
            let values = &gradient.parameters[0].values;
            direction = (0..values.len() as u64).map(|i| 0.5 + 0.5 * f64::from(noise(i, 77))).collect();
            values.iter().zip(&direction).map(|(g, d)| g * d).sum()
        };
        let replayed: Vec<f64> = (0..REPLICATES).map(replayed).collect();
        let moved = |sign: f64| {
            let mut world = (self.world)();
            let offsets: Vec<f64> = direction.iter().map(|d| sign * self.step * d).collect();
            (self.edit)(&mut world, &offsets);
            world
        };
        let (plus, minus) = (moved(1.0), moved(-1.0));
        let difference = |seed| {
            let at = |world| loss(world, &self.view, options(seed));
            (at(&plus) - at(&minus)) / (2.0 * self.step)
        };
        let differences: Vec<f64> = (0..REPLICATES).map(difference).collect();
        let ((a, sa), (b, sb)) = (statistics(&replayed), statistics(&differences));
        let sigma = sa.hypot(sb);
        println!("{:<28} replay {a:>11.5} +- {sa:.5}, differences {b:>11.5} +- {sb:.5}", self.name);
        let bound = (0.02 * b.abs()).max(4.0 * sigma);
        assert!((a - b).abs() <= bound, "{}: {a} +- {sa} and {b} +- {sb}", self.name);
        assert!(sigma < 0.15 * b.abs(), "{}: {a} +- {sa} and {b} +- {sb} say nothing", self.name);
    }
}

fn color(offsets: &[f64]) -> Vec3f {
    vec3(offsets[0] as f32, offsets[1] as f32, offsets[2] as f32)
}

/// Changes material `index` as it was given.
fn change(world: &mut World, index: usize, edit: impl FnOnce(&mut Material)) {
    let mut material = world.given[index].clone();
    edit(&mut material);
    world.set_material(index, &material).unwrap();
}

/// A box with a lamp, a rough metal, a point light and a spot, under a weak sky that comes in through the open side.
fn room() -> World {
    let mut parts = cornell();
    let ball = Shape::Sphere { center: vec3(0.22, 0.45, 0.15), radius: 0.16 };
    parts.add(ball, Material::new(metal(Distribution::Ggx, 0.3)));
    let ball = Shape::Sphere { center: vec3(-0.1, 0.2, 0.3), radius: 0.15 };
    parts.add(ball, Material::new(metal(Distribution::Beckmann, 0.4)));
    let position = DVec3::new(0.1, 0.8, 0.3);
    parts.lights.push(LightSource::Point { position, intensity: vec3(0.3, 0.4, 0.5) });
    parts.lights.push(LightSource::Spot {
        position: DVec3::new(-0.3, 0.9, 0.4),
        direction: vec3(0.3, -1.0, -0.3),
        intensity: vec3(0.8, 0.6, 0.4),
        inner: 0.3,
        outer: 0.8,
        falloff: Falloff::Smooth,
        picture: None,
    });
    let direction = vec3(0.2, 0.4, 1.0);
    parts.lights.push(LightSource::Directional { direction, irradiance: vec3(0.5, 0.4, 0.3) });
    let sky = Image::from_fn(8, 4, 3, |x, y, c| 0.2 + 0.1 * ((3 * x + 5 * y + c) % 7) as f32);
    parts.environment = Some(EnvironmentMap { scale: 1.5, ..EnvironmentMap::new(sky) });
    World::new(parts).unwrap()
}

fn metal(distribution: Distribution, alpha: f32) -> Bsdf<f32> {
    let metal =
        Conductor { eta: vec3(0.2, 0.9, 1.1), k: vec3(3.9, 2.5, 2.3), reflectance: vec3(0.9, 0.8, 0.7) };
    Bsdf::RoughConductor(RoughConductor { metal, surface: Microfacet::isotropic(distribution, alpha) })
}

fn of(material: usize, value: MaterialValue) -> Parameter {
    Parameter::Material { materials: vec![material], value }
}

/// A ball of metal on a floor under a sky.
fn metals(distribution: Distribution) -> World {
    World::new(metal_parts(distribution)).unwrap()
}

fn metal_parts(distribution: Distribution) -> Parts {
    let mut parts = Parts::default();
    let ground = quad(vec3(-3.0, -0.5, -3.0), vec3(0.0, 0.0, 6.0), vec3(6.0, 0.0, 0.0));
    place(&mut parts, ground, Material::new(diffuse(0.5, 0.4, 0.3)));
    let ball = Shape::Sphere { center: vec3(-0.4, 0.0, 0.0), radius: 0.5 };
    parts.add(ball, Material::new(metal(distribution, 0.35)));
    let sky = Image::from_fn(16, 8, 3, |x, y, _| 0.2 + if y < 4 && x % 8 < 4 { 1.0 } else { 0.0 });
    parts.environment = Some(EnvironmentMap::new(sky));
    parts
}

/// Materials of the room by their order, and the metal.
const FLOOR: usize = 0;
const LAMP: usize = 5;
const BALL: usize = 1;

#[test]
fn uniform_surfaces() {
    let reflectance = |world: &mut World, o: &[f64]| {
        change(world, FLOOR, |m| {
            if let BsdfSource::Uniform(Bsdf::Diffuse(d)) = &mut m.scattering {
                d.reflectance += color(o);
            }
        });
    };
    let (parameter, view) = (of(FLOOR, MaterialValue::Reflectance), cornell_view());
    Case { name: "reflectance", world: &room, view, parameter, step: 0.06, edit: &reflectance }.check();
    for (name, distribution) in
        [("alpha (GGX)", Distribution::Ggx), ("alpha (Beckmann)", Distribution::Beckmann)]
    {
        let world = || metals(distribution);
        let edit = |world: &mut World, f: &dyn Fn(&mut RoughConductor<f32>)| {
            change(world, BALL, |m| {
                if let BsdfSource::Uniform(Bsdf::RoughConductor(c)) = &mut m.scattering {
                    f(c);
                }
            });
        };
        let view = looking([0.0, 0.6, 2.6], [-0.3, 0.0, 0.0], 0.6);
        let alpha = |world: &mut World, o: &[f64]| {
            edit(world, &|c| {
                c.surface.alpha_x += o[0] as f32;
                c.surface.alpha_y += o[0] as f32;
            });
        };
        let specular = |world: &mut World, o: &[f64]| edit(world, &|c| c.metal.reflectance += color(o));
        let parameter = of(BALL, MaterialValue::Alpha);
        Case { name, world: &world, view, parameter, step: 0.06, edit: &alpha }.check();
        let (name, parameter) = ("specular reflectance", of(BALL, MaterialValue::SpecularReflectance));
        Case { name, world: &world, view, parameter, step: 0.1, edit: &specular }.check();
    }
}

#[test]
fn lights() {
    let view = cornell_view();
    let emission = |world: &mut World, o: &[f64]| change(world, LAMP, |m| m.emission += color(o));
    let parameter = of(LAMP, MaterialValue::Emission);
    Case { name: "emission", world: &room, view, parameter, step: 2.0, edit: &emission }.check();
    for light in 0..3 {
        let edit = |world: &mut World, o: &[f64]| {
            let mut sources = world.lights.given().to_vec();
            *sources[light].flux_mut() += color(o);
            let map = sky_of(world, None);
            world.relight(&sources, Some(map)).unwrap();
        };
        let name = ["point light", "spot", "directional light"][light];
        let parameter = Parameter::Light { light };
        Case { name, world: &room, view, parameter, step: 0.25, edit: &edit }.check();
    }
    let edit = |world: &mut World, o: &[f64]| {
        let sources = world.lights.given().to_vec();
        let map = sky_of(world, Some(o));
        world.relight(&sources, Some(map)).unwrap();
    };
    let parameter = Parameter::Environment;
    Case { name: "environment texels", world: &room, view, parameter, step: 0.05, edit: &edit }.check();
}

/// The sky of the room with its texels changed.
fn sky_of(world: &World, offsets: Option<&[f64]>) -> EnvironmentMap {
    let [width, height] = world.lights.environment.as_ref().unwrap().size();
    let image = Image::from_fn(width, height, 3, |x, y, c| {
        let offset = offsets.map_or(0.0, |o| o[3 * (y * width + x) + c] as f32);
        0.2 + 0.1 * ((3 * x + 5 * y + c) % 7) as f32 + offset
    });
    EnvironmentMap { scale: 1.5, ..EnvironmentMap::new(image) }
}

/// A clear body around a ball, under a sky and a lamp: camera rays and shadow rays pass its boundary.
fn clear_body() -> World {
    let mut parts = Parts::default();
    let clear = Material { absorption: vec3(0.3, 0.6, 0.9), solid: true, ..Material::new(Bsdf::Null(Null)) };
    parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 1.0 }, clear);
    let ball = Shape::Sphere { center: Vec3f::zero(), radius: 0.5 };
    parts.add(ball, Material::new(diffuse(0.8, 0.7, 0.6)));
    let direction = vec3(0.3, 0.5, 1.0);
    parts.lights.push(LightSource::Directional { direction, irradiance: Vec3f::splat(2.0) });
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(0.5)));
    World::new(parts).unwrap()
}

#[test]
fn absorption() {
    let edit = |world: &mut World, o: &[f64]| change(world, 0, |m| m.absorption += color(o));
    let view = looking([0.0, 0.5, 3.0], [0.0; 3], 0.7);
    let parameter = of(0, MaterialValue::Absorption);
    Case { name: "absorption", world: &clear_body, view, parameter, step: 0.02, edit: &edit }.check();
}

/// A texture of random texels in a range.
fn texture(key: u64, lo: f32, hi: f32) -> TextureImage {
    let byte = |i: usize, c: u64| ((lo + (hi - lo) * noise(i as u64, 4 * key + c)) * 255.0).round() as u8;
    let texels = (0..64).map(|i| [byte(i, 0), byte(i, 1), byte(i, 2), 255]).collect();
    TextureImage { width: 8, height: 8, texels, ..Default::default() }
}

/// Normals that lean a little.
fn leaning() -> TextureImage {
    let mut image = texture(9, 0.4, 0.6);
    image.texels.iter_mut().for_each(|t| t[2] = 240);
    image
}

fn slot(image: usize) -> Option<TextureSlot> {
    Some(TextureSlot::new(image))
}

/// A ball with four maps on a floor without any; `coat` puts clear coat on it.
fn mapped(coat: bool) -> World {
    let extensions = coat.then(|| {
        let clearcoat = photofit_scene::Clearcoat { factor: 0.6, roughness: 0.3, ..Default::default() };
        Box::new(photofit_scene::Extensions { clearcoat: Some(clearcoat), ..Default::default() })
    });
    let material = SceneMaterial {
        base_color: [0.9, 0.8, 0.7, 1.0],
        roughness: 0.8,
        metallic: 0.7,
        emissive: [0.3, 0.2, 0.4],
        base_color_texture: slot(0),
        metallic_roughness_texture: slot(1),
        emissive_texture: slot(2),
        normal_texture: slot(3),
        extensions,
        ..SceneMaterial::default()
    };
    let floor = SceneMaterial { roughness: 0.5, ..SceneMaterial::clay() };
    let (ball, ground) =
        (shapes::uv_sphere(24, 12), quad(vec3(-3.0, -1.0, -3.0), vec3(0.0, 0.0, 6.0), vec3(6.0, 0.0, 0.0)));
    let scene = Scene {
        primitives: vec![Primitive { mesh: ball, material: 0 }, Primitive { mesh: ground, material: 1 }],
        instances: (0..2).map(|primitive| Instance { primitive, transform: Default::default() }).collect(),
        materials: vec![material, floor],
        images: vec![texture(0, 0.3, 0.9), texture(1, 0.4, 0.9), texture(2, 0.2, 0.8), leaning()],
        ..Scene::default()
    };
    let mut parts = Parts::from_scene(&scene);
    let position = DVec3::new(1.0, 2.0, 2.0);
    parts.lights.push(LightSource::Point { position, intensity: vec3(4.0, 5.0, 6.0) });
    let sky = Image::from_fn(16, 8, 3, |x, y, c| 0.3 + 0.2 * ((3 * x + 5 * y + c) % 5) as f32);
    parts.environment = Some(EnvironmentMap::new(sky));
    World::new(parts).unwrap()
}

fn all_maps(coat: bool) {
    let world = || mapped(coat);
    let view = looking([0.0, 0.8, 3.2], [0.0, -0.1, 0.0], 0.7);
    let maps = [
        ("base colour texels", MapKind::BaseColor, 0.06),
        ("roughness, metalness texels", MapKind::MetallicRoughness, 0.06),
        ("emission texels", MapKind::Emissive, 0.05),
        ("normal texels", MapKind::Normal, 0.03),
    ];
    for (name, map, step) in maps {
        let texture = world().library().unwrap().texture_of(0, map).unwrap();
        let edit = |world: &mut World, o: &[f64]| {
            let mut texels = world.library().unwrap().texture(texture).linear_base();
            for (t, o) in texels.iter_mut().zip(o.chunks_exact(3)) {
                (0..3).for_each(|c| t[c] += o[c] as f32);
            }
            world.set_texels(texture, &texels).unwrap();
        };
        Case { name, world: &world, view, parameter: Parameter::Texels { texture }, step, edit: &edit }
            .check();
    }
}

#[test]
fn maps_of_assets() {
    all_maps(false);
}

#[test]
fn maps_below_a_coat() {
    all_maps(true);
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let world = mapped(false);
    let view = looking([0.0, 0.8, 3.2], [0.0, -0.1, 0.0], 0.7);
    let parameters: Vec<Parameter> =
        (0..4).map(|texture| Parameter::Texels { texture }).chain([Parameter::Environment]).collect();
    // Nine tiles, ragged ones among them. One estimate has five tasks of each: more than are reduced at a time.
    let side = 2 * SIDE + 5;
    let weights = Image::from_fn(side, side, 3, |x, y, c| 1.4 * noise((y * side + x) as u64, c as u64) - 0.4);
    let run = |threads: usize| {
        let adjoint = Adjoint::new(&world, &view, square(side, 1), &parameters).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let samples = GradientSamples { spp: 40, seed: None };
        let (gradient, error) = pool.install(|| adjoint.render_vjp_with_error(&weights, samples)).unwrap();
        (gradient, error, pool.install(|| adjoint.render_vjp(&weights, samples)).unwrap())
    };
    let (a, b) = (run(1), run(2));
    assert!(a == b && a == run(7), "any number of threads");
    assert!(a.0.parameters.iter().all(|p| p.values.iter().any(|v| *v != 0.0)));
    assert!(a.1.parameters.iter().flat_map(|p| &p.values).all(|e| e.is_finite() && *e >= 0.0));
}

#[test]
fn standard_errors_are_the_spread_of_estimates() {
    let world = room();
    let parameters = [of(FLOOR, MaterialValue::Reflectance), of(LAMP, MaterialValue::Emission)];
    let adjoint = Adjoint::new(&world, &cornell_view(), square(SIDE, 1), &parameters).unwrap();
    let runs: Vec<_> = (0..24)
        .map(|seed| {
            let samples = GradientSamples { spp: 16, seed: Some(seed) };
            adjoint.render_vjp_with_error(&weights(), samples).unwrap()
        })
        .collect();
    for p in 0..2 {
        for c in 0..3 {
            let means: Vec<f64> = runs.iter().map(|r| r.0.parameters[p].values[c]).collect();
            let told = (runs.iter().map(|r| r.1.parameters[p].values[c].powi(2)).sum::<f64>() / 24.0).sqrt();
            let spread = statistics(&means).1 * 24.0_f64.sqrt();
            let ratio = told / spread;
            assert!((0.6..1.7).contains(&ratio), "{p} {c}: told {told}, found {spread}");
        }
    }
}

/// Mean over estimates of the gradient of a squared error with respect to the floor's reflectance, the sum of the
/// channels, with its standard error; the gradient takes the picture's own numbers where `shared`.
fn squared_error(shared: bool) -> (f64, f64) {
    let world = room();
    let parameters = [of(FLOOR, MaterialValue::Reflectance)];
    let mut values = Vec::new();
    for seed in 0..300 {
        let options = RenderOptions { seed, ..square(SIDE, 1) };
        let adjoint = Adjoint::new(&world, &cornell_view(), options, &parameters).unwrap();
        let picture = adjoint.render().unwrap();
        // Half of the squared norm: the derivative is the picture.
        let loss = Image::from_fn(SIDE, SIDE, 3, |x, y, c| picture.pixel(x, y)[c]);
        let samples = GradientSamples { spp: 1, seed: shared.then_some(seed) };
        let gradient = adjoint.render_vjp(&loss, samples).unwrap();
        values.push(gradient.parameters[0].values.iter().sum());
    }
    statistics(&values)
}

#[test]
fn shared_random_numbers_bias_what_separate_ones_do_not() {
    // What both would be without noise: the gradient for a picture of many samples.
    let world = room();
    let options = RenderOptions { seed: 99, ..square(SIDE, 2048) };
    let parameters = [of(FLOOR, MaterialValue::Reflectance)];
    let adjoint = Adjoint::new(&world, &cornell_view(), options, &parameters).unwrap();
    let picture = adjoint.render().unwrap();
    let loss = Image::from_fn(SIDE, SIDE, 3, |x, y, c| picture.pixel(x, y)[c]);
    let samples = GradientSamples { spp: 512, seed: None };
    let (gradient, error) = adjoint.render_vjp_with_error(&loss, samples).unwrap();
    let truth = gradient.parameters[0].values.iter().sum::<f64>();
    let own = error.parameters[0].values.iter().sum::<f64>();
    let ((separate, s), (shared, t)) = (squared_error(false), squared_error(true));
    println!("true {truth} +- {own}, separate {separate} +- {s}, shared {shared} +- {t}");
    assert!((separate - truth).abs() < 4.0 * s.hypot(own), "separate: {separate} +- {s} of {truth}");
    assert!(s < 0.05 * truth, "the test is sharp");
    assert!(shared - truth > 8.0 * t.hypot(own), "shared: {shared} +- {t} of {truth}");
}

#[test]
fn what_has_no_derivative_is_refused() {
    let world = room();
    let new = |p: &[Parameter]| Adjoint::new(&world, &cornell_view(), square(SIDE, 1), p);
    let message = |p: &[Parameter]| new(p).unwrap_err().to_string();
    for (parameters, words) in [
        (vec![Parameter::Positions { shape: 2 }], ["parameter 0", "no derivatives", "rasterizer"]),
        (vec![of(FLOOR, MaterialValue::Alpha)], ["material 0", "Alpha", "rough conductor"]),
        (vec![of(FLOOR, MaterialValue::BaseColor)], ["material 0", "BaseColor", "library"]),
        (vec![of(99, MaterialValue::Emission)], ["parameter 0", "99", "below 10"]),
        (vec![Parameter::Light { light: 3 }], ["parameter 0", "light 3", "below 3"]),
        (vec![Parameter::Environment; 2], ["parameter 1", "given twice", "once"]),
        (vec![Parameter::Graph { places: vec![[0, 0]] }], ["texture 0", "material 0", "below 0"]),
    ] {
        let text = message(&parameters);
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
    }
    let adjoint = new(&[Parameter::Environment]).unwrap();
    let one = GradientSamples { spp: 1, seed: None };
    let small = Image::new(3, 4, 3);
    let mut nan = weights();
    nan.pixel_mut(5, 2)[1] = f32::NAN;
    for (result, words) in [
        (adjoint.render_vjp(&small, one), ["3 x 4", "16 x 16"]),
        (adjoint.render_vjp(&nan, one), ["pixel (5, 2)", "finite"]),
        (adjoint.render_vjp(&weights(), GradientSamples { spp: 0, seed: None }), ["samples", "at least 1"]),
        (adjoint.render_vjp_with_error(&weights(), one).map(|r| r.0), ["samples", "at least 2"]),
    ] {
        let Err(PathtraceError::Invalid { place, rule }) = result else { panic!("an error") };
        let text = format!("{place}: {rule}");
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
    }
}

#[test]
fn surfaces_in_fog_have_gradients() {
    let world = || {
        let mut parts = cornell();
        let medium = crate::BoundedMedium::homogeneous(vec3(1.5, 1.0, 0.5), vec3(0.9, 0.8, 0.7), 0.3);
        parts.media.push(medium);
        let ball = Shape::Sphere { center: vec3(0.0, 0.5, 0.0), radius: 0.3 };
        let fog = parts.add(ball, Material::new(Bsdf::Null(Null)));
        parts.boundaries.push(crate::Boundary { instance: fog, interior: Some(0), exterior: None });
        let wall = quad(vec3(-0.4, 0.2, -0.3), vec3(0.8, 0.0, 0.0), vec3(0.0, 0.6, 0.0));
        place(&mut parts, wall, Material::new(diffuse(0.5, 0.6, 0.7)));
        World::new(parts).unwrap()
    };
    let edit = |world: &mut World, o: &[f64]| {
        change(world, 9, |m| {
            if let BsdfSource::Uniform(Bsdf::Diffuse(d)) = &mut m.scattering {
                d.reflectance += color(o);
            }
        });
    };
    let (parameter, view) = (of(9, MaterialValue::Reflectance), cornell_view());
    Case { name: "reflectance in fog", world: &world, view, parameter, step: 0.05, edit: &edit }.check();
}

/// Paths that are split at a metal behind and within fog.
#[test]
fn metals_in_fog_have_gradients() {
    let alpha = |world: &mut World, o: &[f64]| {
        change(world, BALL, |m| {
            if let BsdfSource::Uniform(Bsdf::RoughConductor(c)) = &mut m.scattering {
                c.surface.alpha_x += o[0] as f32;
                c.surface.alpha_y += o[0] as f32;
            }
        });
    };
    let view = looking([0.0, 0.6, 2.6], [-0.3, 0.0, 0.0], 0.6);
    for extinction in [Vec3f::splat(0.4), vec3(0.2, 0.4, 0.8)] {
        let world = || {
            let mut parts = metal_parts(Distribution::Ggx);
            let albedo = vec3(0.9, 0.8, 0.7);
            parts.media.push(crate::BoundedMedium::homogeneous(extinction, albedo, 0.3));
            let ball = Shape::Sphere { center: vec3(-0.2, 0.1, 0.4), radius: 0.9 };
            let fog = parts.add(ball, Material::new(Bsdf::Null(Null)));
            parts.boundaries.push(crate::Boundary { instance: fog, interior: Some(0), exterior: None });
            World::new(parts).unwrap()
        };
        let (name, parameter) = ("alpha in fog", of(BALL, MaterialValue::Alpha));
        Case { name, world: &world, view, parameter, step: 0.06, edit: &alpha }.check();
    }
}

#[test]
fn parameters_are_read_and_replaced() {
    for (world, parameters) in [
        (
            room(),
            vec![
                of(FLOOR, MaterialValue::Reflectance),
                of(LAMP, MaterialValue::Emission),
                Parameter::Light { light: 1 },
                Parameter::Environment,
            ],
        ),
        (mapped(false), vec![of(0, MaterialValue::BaseColor), Parameter::Texels { texture: 1 }]),
        (metals(Distribution::Ggx), vec![of(BALL, MaterialValue::Alpha)]),
    ] {
        let mut world = world;
        let render = |w: &World| loss(w, &cornell_view(), square(SIDE, 4));
        let before = render(&world);
        for p in &parameters {
            let values = world.parameter(p).unwrap();
            let adjoint =
                Adjoint::new(&world, &cornell_view(), square(SIDE, 1), std::slice::from_ref(p)).unwrap();
            let gradient = adjoint.render_vjp(&weights(), GradientSamples { spp: 1, seed: None }).unwrap();
            assert_eq!(values.len(), gradient.parameters[0].values.len(), "{p:?}");
            let half: Vec<f32> = values.iter().map(|v| 0.5 * v).collect();
            world.set_parameter(p, &half).unwrap();
            let read = world.parameter(p).unwrap();
            assert!(read.iter().zip(&half).all(|(a, b)| (a - b).abs() <= 2e-7 * b.abs()), "{p:?}");
            assert_ne!(render(&world), before, "{p:?} changes the picture");
            world.set_parameter(p, &values).unwrap();
            assert!((render(&world) - before).abs() <= 1e-4 * before.abs(), "{p:?}");
            assert!(world.set_parameter(p, &values[1..]).unwrap_err().to_string().contains("values"));
            let nan = vec![f32::NAN; values.len()];
            assert!(world.set_parameter(p, &nan).unwrap_err().to_string().contains("finite"));
        }
    }
}
