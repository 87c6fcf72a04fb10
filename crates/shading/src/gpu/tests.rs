//! The functions in WGSL against those of the CPU.

use super::*;
use crate::tests::{unit, vector};
use crate::{
    Energy, Surface, Yaw, face_viewer, face_viewer_vjp, perturb, perturb_vjp, shade, shade_vjp,
    view_direction, view_direction_vjp,
};
use photofit_gpu::{INDEX, Kernel, test_device, validate};
use photofit_gradcheck::{Uniform, worst_difference};
use photofit_scalar::{Vec3, Vec3f, vec3};

const SOURCE: &[&str] = &[INDEX, photofit_scalar::WGSL, WGSL, include_str!("tests.wgsl")];
const RADIANCE: Kernel = Kernel { name: "radiance", source: SOURCE, entry: "radiance" };
const NORMALS: Kernel = Kernel { name: "normals", source: SOURCE, entry: "normals" };

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    lights: Lights,
    count: u32,
    compensated: u32,
    pad: [u32; 2],
}

fn environment(seed: u64) -> Environment<f32> {
    let mut rng = Uniform::new(seed);
    let rgb: Vec<f32> = rng.vec(32 * 16 * 3, 0.0, 3.0).iter().map(|x| *x as f32).collect();
    Environment::from_equirectangular(32, 16, &rgb).expect("an image")
}

fn run(
    gpu: &Gpu,
    kernel: &Kernel,
    params: &Params,
    tables: &ShadingTables,
    input: &[f32],
    out: usize,
) -> Vec<f32> {
    let input = gpu.upload("input", input).expect("fits");
    let output = gpu.zeros::<f32>("output", out).expect("fits");
    let mut r = gpu.record("test");
    // `normals` reads no tables.
    let mut buffers = vec![tables.buffer.bind(), input.bind(), output.bind()];
    if kernel.name == "normals" {
        buffers.remove(0);
    }
    r.dispatch(kernel, params, &buffers, params.count as usize).expect("fits");
    r.finish().expect("recorded").run().expect("runs");
    gpu.read(&output).expect("read")
}

/// Inputs of `radiance`: 18 numbers each.
type Item = [f32; 18];

fn at(x: &[f32], i: usize) -> Vec3f {
    vec3(x[i], x[i + 1], x[i + 2])
}

fn expected(items: &[Item], energy: Energy, lights: &[Light<'_>]) -> Vec<f32> {
    let mut out = Vec::new();
    for x in items {
        let s = Surface { base_color: at(x, 0), roughness: x[3], metallic: x[4], gamma: x[5] };
        let (position, n, wo, g) = (at(x, 6), at(x, 9), at(x, 12), at(x, 15));
        let v = shade(&s, energy, position, n, wo, lights);
        let d = shade_vjp(&s, energy, position, n, wo, lights, g);
        out.extend(v.to_array());
        out.extend(d.surface.base_color.to_array());
        out.extend([d.surface.roughness, d.surface.metallic, d.surface.gamma]);
        for v in [d.position, d.n, d.wo] {
            out.extend(v.to_array());
        }
    }
    out
}

fn found(
    gpu: &Gpu,
    tables: &ShadingTables,
    items: &[Item],
    energy: Energy,
    lights: &[Light<'_>],
    number: impl Fn(&Environment<f32>) -> usize,
) -> Vec<f32> {
    let params = Params {
        lights: tables.lights(lights, number),
        count: items.len() as u32,
        compensated: u32::from(energy == Energy::Compensated),
        pad: [0; 2],
    };
    run(gpu, &RADIANCE, &params, tables, items.as_flattened(), 18 * items.len())
}

fn random_items(n: usize, roughness: (f64, f64), rng: &mut Uniform) -> Vec<Item> {
    let mut out = Vec::new();
    for _ in 0..n {
        let (normal, wo) = (unit(rng), unit(rng));
        let wo = if normal.dot(wo) < -0.2 { -wo } else { wo };
        let mut x: Vec<f64> = rng.vec(3, 0.02, 1.0);
        x.extend([rng.range(roughness.0, roughness.1), rng.range(0.0, 1.0), rng.range(0.0, 0.9)]);
        for v in [vector(rng), normal, wo, vector(rng)] {
            x.extend(v.to_array());
        }
        out.push(std::array::from_fn(|k| x[k] as f32));
    }
    out
}

/// What each of the numbers out of `radiance` is.
const NAMES: [&str; 6] =
    ["radiance", "base colour", "roughness, metallic, gamma", "position", "normal", "viewer"];

/// Compares quantity by quantity: their sizes differ.
fn compare(what: &str, found: &[f32], expected: &[f32], (of, bound): (&str, f64)) {
    for (k, name) in NAMES.iter().enumerate() {
        let part =
            |x: &[f32]| -> Vec<f32> { x.chunks(18).flat_map(|x| x[3 * k..3 * k + 3].to_vec()).collect() };
        let error = worst_difference(&part(found), &part(expected));
        photofit_gpu::assert_twin(of, format!("{what}, {name}"), error, bound);
    }
}

fn lights<'a>(first: &'a Environment<f32>, second: &'a Environment<f32>) -> [Light<'a>; 5] {
    [
        Light::Point { position: vec3(0.4, 2.5, 1.5), intensity: vec3(9.0, 7.0, 5.0) },
        Light::Directional { direction: vec3(0.48, 0.6, 0.64), irradiance: vec3(1.0, 2.0, 3.0) },
        Light::Ambient { radiance: vec3(0.3, 0.2, 0.4) },
        Light::Environment { map: first, rotation: Yaw::new(0.7), scale: 0.8 },
        Light::Environment { map: second, rotation: Yaw::new(-2.0), scale: 1.3 },
    ]
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
fn kernels_are_valid() {
    validate(&RADIANCE).expect("valid");
    validate(&NORMALS).expect("valid");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn radiance_and_gradients_agree_for_every_light() {
    let gpu = test_device();
    let maps = [environment(1), environment(2)];
    let tables = ShadingTables::new(gpu, &[&maps[0], &maps[1]]).expect("fits");
    let number = |map: &Environment<f32>| usize::from(!std::ptr::eq(map, &raw const maps[0]));
    let lights = lights(&maps[0], &maps[1]);
    let mut rng = Uniform::new(3);
    for (roughness, bound) in
        [((0.3, 1.0), ("ROUGH", tolerances::ROUGH)), ((0.0, 0.3), ("SMOOTH", tolerances::SMOOTH))]
    {
        let items = random_items(1500, roughness, &mut rng);
        for energy in [Energy::Single, Energy::Compensated] {
            let sets = lights.iter().map(std::slice::from_ref).chain([&lights[..]]);
            for (k, set) in sets.enumerate() {
                let found = found(gpu, &tables, &items, energy, set, number);
                let expected = expected(&items, energy, set);
                compare(&format!("{energy:?} set {k} roughness {roughness:?}"), &found, &expected, bound);
            }
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn as_many_lights_as_there_is_room_for_agree() {
    let gpu = test_device();
    let map = environment(5);
    let tables = ShadingTables::new(gpu, &[&map]).expect("fits");
    let mut rng = Uniform::new(6);
    let single = |v: Vec3<f64>| vec3(v.x as f32, v.y as f32, v.z as f32);
    let light = |k: usize| match k % 3 {
        0 => Light::Point { position: single(vector(&mut rng)) * 3.0, intensity: Vec3::splat(0.5) },
        1 => Light::Directional { direction: single(unit(&mut rng)), irradiance: Vec3::splat(0.1) },
        _ => Light::Environment { map: &map, rotation: Yaw::new(k as f32), scale: 0.05 },
    };
    let lights: Vec<Light<'_>> = (0..LIGHTS_MAX).map(light).collect();
    let items = random_items(300, (0.3, 1.0), &mut Uniform::new(7));
    let expected = expected(&items, Energy::Compensated, &lights);
    let of = |lights: &[Light<'_>]| found(gpu, &tables, &items, Energy::Compensated, lights, |_| 0);
    compare("all lights", &of(&lights), &expected, ("ROUGH", tolerances::ROUGH));
    let fewer = worst_difference(&of(&lights[..LIGHTS_MAX - 1]), &expected);
    assert!(fewer > tolerances::ROUGH, "a missing light is noticed: {fewer:e}");
    let more = [&lights[..], &lights[..1]].concat();
    let refused = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| tables.lights(&more, |_| 0)));
    assert!(refused.is_err(), "more than there is room for");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn extremes_agree() {
    let gpu = test_device();
    let map = environment(4);
    let tables = ShadingTables::new(gpu, &[&map]).expect("fits");
    let (up, side) = ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]);
    let mut items: Vec<Item> = Vec::new();
    for roughness in [0.0, 0.03, 0.5, 1.0] {
        for metallic in [0.0, 1.0] {
            for base in [0.0, 1.0] {
                for (n, wo) in [(up, up), (up, side), (up, [0.0, 0.0, -1.0]), ([0.0; 3], up), (up, [0.0; 3])]
                {
                    let head = [base, base, base, roughness, metallic, 0.0, 0.2, 0.1, 0.0];
                    let mut x: Vec<f32> = head.to_vec();
                    x.extend(n.iter().chain(&wo).chain(&[1.0, -2.0, 0.5]));
                    items.push(std::array::from_fn(|k| x[k]));
                }
            }
        }
    }
    let lights = [
        // At the place itself, behind, at the horizon, and very bright.
        Light::Point { position: vec3(0.2, 0.1, 0.0), intensity: Vec3::splat(1.0) },
        Light::Point { position: vec3(0.2, 0.1, -3.0), intensity: Vec3::splat(1e6) },
        Light::Directional { direction: vec3(1.0, 0.0, 0.0), irradiance: Vec3::splat(1e6) },
        Light::Directional { direction: vec3(-0.6, 0.0, 0.8), irradiance: Vec3::splat(1e6) },
        Light::Ambient { radiance: Vec3::splat(1e6) },
        Light::Environment { map: &map, rotation: Yaw::default(), scale: 0.0 },
        Light::Environment { map: &map, rotation: Yaw::default(), scale: 1.0 },
    ];
    for energy in [Energy::Single, Energy::Compensated] {
        for light in &lights {
            let found = found(gpu, &tables, &items, energy, std::slice::from_ref(light), |_| 0);
            let expected = expected(&items, energy, std::slice::from_ref(light));
            assert!(expected.iter().all(|x| x.is_finite()), "{light:?}");
            compare(&format!("{energy:?}"), &found, &expected, ("SMOOTH", tolerances::SMOOTH));
        }
        assert!(found(gpu, &tables, &items, energy, &[], |_| 0).iter().all(|x| *x == 0.0), "no light");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn shading_normals_agree() {
    let gpu = test_device();
    let mut rng = Uniform::new(5);
    let tables = ShadingTables::new(gpu, &[]).expect("fits");
    let mut items: Vec<[f32; 22]> = Vec::new();
    for k in 0..3000 {
        let mut x = Vec::new();
        for _ in 0..7 {
            x.extend(vector(&mut rng).to_array());
        }
        x.push(if k % 2 == 0 { 1.0 } else { -1.0 });
        let mut x: [f32; 22] = std::array::from_fn(|i| x[i] as f32);
        match k % 50 {
            // Nothing at all, tiny and huge vectors, the eye at the surface.
            0 => x[..9].fill(0.0),
            1 => x[..6].iter_mut().for_each(|v| *v *= 1e-15),
            2 => x[..6].iter_mut().for_each(|v| *v *= 1e6),
            3 => x.copy_within(12..15, 15),
            _ => {}
        }
        items.push(x);
    }
    let mut expected = Vec::new();
    for x in &items {
        let (normal, tangent, map, geometric) = (at(x, 0), at(x, 3), at(x, 6), at(x, 9));
        let (eye, position, g, handedness) = (at(x, 12), at(x, 15), at(x, 18), x[21]);
        let perturbed = perturb(normal, tangent, handedness, map);
        let wo = view_direction(eye, position);
        let p = perturb_vjp(normal, tangent, handedness, map, g);
        let f = face_viewer_vjp(perturbed, geometric, wo, g);
        let facing = face_viewer(perturbed, geometric, wo);
        let g_position = view_direction_vjp(eye, position, g);
        for v in [perturbed, facing, wo, p.normal, p.tangent, p.map, f.normal, f.wo, g_position] {
            expected.extend(v.to_array());
        }
    }
    let params = Params { lights: Lights::default(), count: items.len() as u32, compensated: 0, pad: [0; 2] };
    let found = run(gpu, &NORMALS, &params, &tables, items.as_flattened(), 27 * items.len());
    for k in 0..9 {
        // Vectors of ordinary size apart from the tiny and huge ones.
        for special in [None, Some(1), Some(2)] {
            let of = |x: &[f32]| -> Vec<f32> {
                let each = x.chunks(27).enumerate();
                let wanted = each.filter(|(i, _)| match special {
                    Some(s) => i % 50 == s,
                    None => ![1, 2].contains(&(i % 50)),
                });
                wanted.flat_map(|(_, x)| x[3 * k..3 * k + 3].to_vec()).collect()
            };
            let error = worst_difference(&of(&found), &of(&expected));
            let (name, most) = match k {
                0..5 => ("NORMALS", tolerances::NORMALS),
                _ => ("NORMALS_VJP", tolerances::NORMALS_VJP),
            };
            photofit_gpu::assert_twin(name, format!("vector {k}, {special:?}"), error, most);
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_perturbed_side_is_found() {
    let gpu = test_device();
    let map = environment(6);
    let tables = ShadingTables::new(gpu, &[&map]).expect("fits");
    let items = random_items(100, (0.3, 1.0), &mut Uniform::new(7));
    let light = |angle: f32| [Light::Environment { map: &map, rotation: Yaw::new(angle), scale: 1.0 }];
    let found = found(gpu, &tables, &items, Energy::Single, &light(0.7001), |_| 0);
    let expected = expected(&items, Energy::Single, &light(0.7));
    assert!(worst_difference(&found, &expected) > tolerances::ROUGH);
}
