//! Materials on a device against those of the CPU.

use super::*;
use crate::{
    Filter, MapKind, Material, Sampler, Scene, SurfacePacket, SurfaceSample, TextureImage, TextureSlot, Wrap,
};
use photofit_gpu::{INDEX, Kernel, assert_twin, test_device, validate};
use photofit_gradcheck::Uniform;
use photofit_texture::gpu::STORED;

const LOOK_UP: Kernel = Kernel {
    name: "surfaces",
    source: &[INDEX, photofit_scalar::WGSL, STORED, SURFACE, include_str!("tests.wgsl")],
    entry: "surfaces",
};
const POINTS: usize = 256;
/// Numbers of a point, relative to one or to themselves: the share of a level is known to some 1e-6, and unit normals of texels
/// that nearly cancel are worse than these.
const CLOSE: f32 = 1e-4;
/// Share of points with a number that differs by more: those where alpha equals the cutoff within rounding, a coordinate
/// lies between two texels that are not filtered, or normals nearly cancel.
const SURFACE_POINTS: f64 = 2e-3;

/// Texture coordinates, their derivatives along X and Y, and the colour of the vertices: `SurfacePoint`.
type Point = [[f32; 4]; 4];
/// Base colour and alpha; roughness, metalness and whether it is unlit; normal; emission.
type Found = [[f32; 4]; 4];
/// A change of a material.
type Change<'a> = &'a dyn Fn(&mut Material);

fn image(rng: &mut Uniform, [width, height]: [usize; 2], wide: bool) -> TextureImage {
    let texels16: Vec<[u16; 4]> =
        (0..width * height).map(|_| std::array::from_fn(|_| rng.range(0.0, 65536.0) as u16)).collect();
    let texels = texels16.iter().map(|t| t.map(|x| (x >> 8) as u8)).collect();
    TextureImage {
        width,
        height,
        texels,
        texels16: if wide { texels16 } else { Vec::new() },
        ..TextureImage::default()
    }
}

fn pick<T: Copy>(rng: &mut Uniform, of: &[T]) -> T {
    of[rng.range(0.0, of.len() as f64) as usize]
}

fn slot(rng: &mut Uniform, images: usize) -> Option<TextureSlot> {
    let wraps = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge];
    let filters = [Filter::Nearest, Filter::Bilinear, Filter::Trilinear, Filter::Trilinear];
    let sampler =
        Sampler { wrap_u: pick(rng, &wraps), wrap_v: pick(rng, &wraps), filter: pick(rng, &filters) };
    let transform = pick(rng, &[[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.5, 0.3, 0.1], [-0.2, 1.2, 0.4]]]);
    let (image, tex_coord) = (rng.range(0.0, images as f64) as usize, pick(rng, &[0, 1]));
    (rng.range(0.0, 1.0) < 0.75).then_some(TextureSlot { image, sampler, tex_coord, transform })
}

fn material(rng: &mut Uniform, k: usize, images: usize) -> Material {
    let number = |rng: &mut Uniform| rng.range(0.1, 1.0) as f32;
    let mut material = Material {
        base_color: std::array::from_fn(|_| number(rng)),
        metallic: number(rng),
        roughness: number(rng),
        normal_scale: 2.0 * number(rng),
        emissive: std::array::from_fn(|_| 3.0 * number(rng)),
        alpha_mode: [AlphaMode::Mask { cutoff: 0.3 }, AlphaMode::Opaque, AlphaMode::Blend][k % 3],
        unlit: k % 7 == 6,
        base_color_texture: slot(rng, images),
        metallic_roughness_texture: slot(rng, images),
        normal_texture: slot(rng, images),
        emissive_texture: slot(rng, images),
        ..Material::default()
    };
    // Maps that share an address, as most of an asset do.
    if k.is_multiple_of(2) {
        material.metallic_roughness_texture = material.base_color_texture;
        material.emissive_texture = material.normal_texture;
    }
    material
}

/// Materials with textures of 8 and 16 bits.
fn scene() -> Scene {
    let mut rng = Uniform::new(41);
    let images = vec![
        image(&mut rng, [16, 16], false),
        image(&mut rng, [13, 6], false),
        image(&mut rng, [32, 8], true),
    ];
    let materials = (0..42).map(|k| material(&mut rng, k, images.len())).collect();
    Scene { images, materials, ..Scene::default() }
}

/// The materials of a scene, some textures in floating point.
fn library(scene: &Scene) -> SurfaceLibrary {
    let mut library = SurfaceLibrary::new(scene);
    let maps = [MapKind::BaseColor, MapKind::Normal, MapKind::MetallicRoughness];
    for (k, map) in maps.into_iter().enumerate() {
        let texture = (0..library.materials()).find_map(|m| library.texture_of(m, map)).expect("some map");
        let base: Vec<_> = library.texture(texture).linear_base();
        let wider = |t: [f32; 4]| [1.5 * t[0] - 0.1, t[1], t[2] + 0.01 * k as f32, t[3]];
        library.set_texels(texture, &base.into_iter().map(wider).collect::<Vec<_>>());
    }
    library
}

fn points(rng: &mut Uniform) -> Vec<Point> {
    let four = |rng: &mut Uniform, low: f64, high: f64| -> [f32; 4] {
        std::array::from_fn(|_| rng.range(low, high) as f32)
    };
    let mut out: Vec<Point> = (0..POINTS)
        .map(|_| {
            let size = 10_f64.powf(rng.range(-3.0, 0.3));
            [four(rng, -1.5, 2.5), four(rng, -size, size), four(rng, -size, size), four(rng, 0.2, 1.2)]
        })
        .collect();
    // A mesh without texture coordinates or colours; coordinates of broken ones.
    out.extend([[[0.0; 4], [0.0; 4], [0.0; 4], [1.0; 4]]; 8]);
    for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
        let [u, v, dx, dy] = [[odd, 0.3, 0.7, odd], [0.3, odd, odd, odd], [odd; 4], [0.1; 4]];
        out.extend([[u, dy, dy, dy], [v, dy, dy, dy], [dy, dx, dy, dy], [dy, dy, u, dy]]);
    }
    out
}

fn on_device(gpu: &Gpu, library: &SurfaceLibrary, material: usize, points: &[Point]) -> Vec<Found> {
    let surfaces = SurfaceBuffers::new(gpu, library).expect("fits");
    let bound = gpu.upload("points", points).expect("fits");
    let out = gpu.zeros::<Found>("out", points.len()).expect("fits");
    let params = [SurfaceBuffers::place(material), points.len() as u32, 0, 0];
    let buffers = [bound.bind(), surfaces.materials.bind(), surfaces.textures.words.bind(), out.bind()];
    let mut r = gpu.record("surfaces");
    r.dispatch(&LOOK_UP, &params, &buffers, points.len()).expect("recorded");
    r.finish().expect("finished").run().expect("runs");
    gpu.read(&out).expect("read")
}

fn on_cpu(library: &SurfaceLibrary, material: usize, points: &[Point]) -> Vec<Found> {
    let mut out = Vec::new();
    for some in points.chunks(8) {
        let of =
            |k: usize| std::array::from_fn(|c| std::array::from_fn(|l| some.get(l).map_or(0.0, |p| p[k][c])));
        let packet = SurfacePacket { uv: of(0), dx: of(1), dy: of(2), color: of(3) };
        let mut samples = [library.factors(material); 8];
        library.lookup_packet(material, &packet, some.len(), &mut samples);
        out.extend(samples[..some.len()].iter().map(found));
    }
    out
}

fn found(s: &SurfaceSample) -> Found {
    let ([r, g, b], n, e) = (s.base_color.to_array(), s.normal, s.emissive);
    let unlit = if s.unlit { 1.0 } else { 0.0 };
    [[r, g, b, s.alpha], [s.roughness, s.metallic, unlit, 0.0], [n.x, n.y, n.z, 0.0], [e.x, e.y, e.z, 0.0]]
}

/// Share of points that differ. Of those that are not seen only that.
fn differing(found: &[Found], expected: &[Found]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let close =
        |(f, e): (&f32, &f32)| (f - e).abs() <= CLOSE * e.abs().max(1.0) || f.to_bits() == e.to_bits();
    let alike = |(f, e): &(&Found, &Found)| {
        let shown = if e[0][3] > 0.0 { 16 } else { 4 };
        f.as_flattened()[..shown].iter().zip(&e.as_flattened()[..shown]).all(close)
    };
    found.iter().zip(expected).filter(|pair| !alike(pair)).count() as f64 / found.len() as f64
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
fn kernels_are_valid() {
    validate(&LOOK_UP).expect("valid");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn materials_are_those_of_the_cpu() {
    let (gpu, mut rng, scene) = (test_device(), Uniform::new(42), scene());
    let (mut all, mut expected) = (Vec::new(), Vec::new());
    for (what, library) in [("of files", SurfaceLibrary::new(&scene)), ("some replaced", library(&scene))] {
        for material in 0..library.materials() {
            let at = points(&mut rng);
            let (a, b) = (on_device(gpu, &library, material, &at), on_cpu(&library, material, &at));
            let share = differing(&a, &b);
            assert!(share < 0.02, "{what}, material {material}, {:?}: {share}", scene.materials[material]);
            all.extend(a);
            expected.extend(b);
        }
    }
    assert_twin("SURFACE_POINTS", "all materials", differing(&all, &expected), SURFACE_POINTS);
    // Points of every kind are among them.
    let count = |is: &dyn Fn(&Found) -> bool| expected.iter().filter(|f| is(f)).count();
    let kinds: [&dyn Fn(&Found) -> bool; 5] = [
        &|f| f[0][3] <= 0.0,
        &|f| f[0][3] > 0.0 && f[0][3] < 1.0,
        &|f| f[1][2] > 0.0,
        &|f| f[2][2] < 0.999,
        &|f| f[3][0] > 0.0,
    ];
    kinds.iter().for_each(|is| assert!(count(*is) > expected.len() / 50, "{} points", count(*is)));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn another_material_is_noticed() {
    let (gpu, scene) = (test_device(), scene());
    let at = points(&mut Uniform::new(43));
    let has = |is: &dyn Fn(&Material) -> bool| scene.materials.iter().position(is).expect("some material");
    let cases: [(&str, usize, Change<'_>); 4] = [
        ("normal scale", has(&|m| m.normal_texture.is_some() && !m.unlit), &|m| m.normal_scale += 0.01),
        ("base alpha", has(&|m| m.alpha_mode == AlphaMode::Blend), &|m| m.base_color[3] *= 0.99),
        (
            "cutoff",
            has(&|m| matches!(m.alpha_mode, AlphaMode::Mask { .. }) && m.base_color_texture.is_some()),
            &|m| {
                m.alpha_mode = AlphaMode::Mask { cutoff: 0.35 };
            },
        ),
        ("set of coordinates", has(&|m| m.base_color_texture.is_some()), &|m| {
            m.base_color_texture.iter_mut().for_each(|t| t.tex_coord = 1 - t.tex_coord);
        }),
    ];
    for (what, material, change) in cases {
        let mut other = scene.clone();
        change(&mut other.materials[material]);
        let found = on_device(gpu, &SurfaceLibrary::new(&other), material, &at);
        let share = differing(&found, &on_cpu(&SurfaceLibrary::new(&scene), material, &at));
        assert!(share > SURFACE_POINTS, "{what}: {share}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_scene_without_materials_has_tables_alone() {
    let gpu = test_device();
    let surfaces = SurfaceBuffers::new(gpu, &SurfaceLibrary::new(&Scene::default())).expect("fits");
    assert!(surfaces.materials.is_empty());
    assert_eq!(surfaces.textures.words.len(), photofit_scalar::srgb_table().len());
    assert!(on_device(gpu, &SurfaceLibrary::new(&Scene::default()), 0, &[]).is_empty());
}
