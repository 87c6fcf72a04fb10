//! Shading on a device against the CPU: a layer alone.

mod scene;

use super::*;
use crate::deferred::{Gradients, render, render_vjp};
use crate::gpu::tolerances::{SHADED, SHADED_BROKEN, SHADED_VJP};
use crate::gpu::{VERTEX_SUMS, vertex_sum};
use crate::maps::channel;
use crate::project::project_vjp;
use crate::rasterize::NONE;
use photofit_gpu::{FIXED_LIMITED, FIXED_LOST, assert_twin, test_device};
use photofit_gradcheck::{Uniform, worst_difference};
use photofit_scalar::{Vec3f, Vec4f, vec3, vec4};
use photofit_texture::gpu::SUM_SCALE;
use scene::Scene;

/// What a layer gives: pixels, and the gradients of positions, normals, tangents and texels.
struct Layer {
    color: Vec<[f32; 4]>,
    gradients: [Vec<f32>; 4],
    /// Of the sums of vertices and of texels.
    status: [u32; 2],
}

fn on_cpu(s: &Scene, passes: &Passes, g: &[[f32; 4]]) -> Layer {
    s.with(|geometry, view| {
        let frame = render(geometry, &s.maps, view, &s.background, passes);
        let mut out = Gradients::new(s.positions.len(), &s.maps);
        render_vjp(geometry, &s.maps, view, passes, &frame, g, &mut out);
        let flat = |v: &[Vec3f]| v.iter().flat_map(|v| v.to_array()).collect();
        let texels = out.maps.levels.iter().flat_map(|l| l.texels.concat()).collect();
        Layer {
            color: frame.color,
            gradients: [flat(&out.positions), flat(&out.normals), flat(&out.tangents), texels],
            status: [0; 2],
        }
    })
}

/// The same from the CPU's visibility, with what surrounds shading done here.
fn on_device(gpu: &Gpu, s: &Scene, passes: &Passes, g: &[[f32; 4]]) -> Layer {
    s.with(|geometry, view| {
        let frame = render(geometry, &s.maps, view, &s.background, passes);
        let triangle = &frame.layers[0].visibility.triangle;
        let n = triangle.len();
        let uvs: Vec<_> = s.uvs.iter().map(|uv| [uv.x, uv.y]).collect();
        let mesh =
            MeshBuffers::new(gpu, &uvs, &geometry.topology, geometry.alpha, geometry.sides).expect("fits");
        gpu.write(&mesh.positions, bytemuck::cast_slice(&s.positions)).expect("written");
        gpu.write(&mesh.normals, bytemuck::cast_slice(&s.normals)).expect("written");
        gpu.write(&mesh.tangents, bytemuck::cast_slice(&s.tangents)).expect("written");
        let pixels = n / (view.samples * view.samples);
        let picture = PictureBuffers::new(gpu, &mesh, n, pixels, 1, false).expect("fits");
        let mut clip = vec![Vec4f::zero(); s.positions.len()];
        crate::project::project(&view.view_projection, &s.positions, &mut clip);
        gpu.write(&picture.clip, bytemuck::cast_slice(&clip)).expect("written");
        let layer = &picture.layers[0];
        gpu.write(&layer.triangle, triangle).expect("written");
        let gradients = GradientBuffers::new(gpu, &mesh, n, pixels).expect("fits");
        let fitted = std::array::from_fn(|c| c < channel::USED);
        let maps = MipBuffers::new(gpu, &s.maps, fitted).expect("fits");
        let tables = ShadingTables::new(gpu, &[&s.environment]).expect("fits");
        let mut shading = MapShading::new(gpu, maps, tables, mesh.triangles(), passes).expect("fits");
        let params = shading.params(view, passes, [SUM_SCALE; 2], |_| 0);

        // Recorded with the parameters of no picture, run with those of this one.
        let mut r = gpu.record("forward");
        shading.record(&mut r, &mesh, &picture, layer, Work::Threads(n)).expect("recorded");
        let mut forward = r.finish().expect("finished");
        shading.take_slots().set(&mut forward, &params);
        forward.run().expect("runs");
        let shaded = gpu.read(&layer.shaded).expect("read");

        // Blending over the background, the mean of the samples, and their adjoints.
        let (side, columns) = (view.samples, view.width / view.samples);
        let share = 1.0 / (side * side) as f32;
        let pixel = |i: usize| (i / view.width / side) * columns + i % view.width / side;
        let mut color = vec![[0.0; 4]; pixels];
        let mut g_shaded = vec![[0.0; 4]; n];
        let fits_alpha = passes.fits_alpha() && geometry.alpha.iter().any(|a| passes.masks.fades(*a));
        for i in 0..n {
            let b = s.background[pixel(i)];
            let behind = [b[0], b[1], b[2], 0.0];
            let (drawn, g) = (if triangle[i] == NONE { [0.0; 4] } else { shaded[i] }, g[pixel(i)]);
            let over = [drawn[0], drawn[1], drawn[2], 1.0];
            for k in 0..4 {
                color[pixel(i)][k] += share * (behind[k] + drawn[3] * (over[k] - behind[k]));
                if triangle[i] != NONE && fits_alpha {
                    g_shaded[i][3] += share * g[k] * (over[k] - behind[k]);
                }
            }
            (0..3).for_each(|k| g_shaded[i][k] = share * g[k] * drawn[3]);
        }
        gpu.write(&gradients.shaded, &g_shaded).expect("written");

        shading.set(&params);
        let mut r = gpu.record("reverse");
        shading.record_vjp(&mut r, &mesh, &picture, layer, &gradients, Work::Threads(n)).expect("recorded");
        shading.maps.record_collect(&mut r, SUM_SCALE).expect("recorded");
        r.finish().expect("finished").run().expect("runs");
        let words = gpu.read(&gradients.sums).expect("read");
        let status = [*words.last().expect("a status"), gpu.read(&shading.maps.status).expect("read")[0]];
        let sum = |v: usize, c: usize| {
            let at = 2 * (VERTEX_SUMS * v + c);
            let units = (i64::from(words[at + 1] as i32) << 32) + i64::from(words[at]);
            (units as f64 / f64::from(SUM_SCALE)) as f32
        };
        let vertices = s.positions.len();
        let vectors = |c: usize| -> Vec<Vec3f> {
            (0..vertices).map(|v| vec3(sum(v, c), sum(v, c + 1), sum(v, c + 2))).collect()
        };
        let mut positions = vectors(vertex_sum::POSITION);
        let g_clip: Vec<_> =
            (0..vertices).map(|v| vec4(sum(v, 0), sum(v, 1), sum(v, 2), sum(v, 3))).collect();
        project_vjp(&view.view_projection, &g_clip, &mut positions);
        let flat = |v: &[Vec3f]| v.iter().flat_map(|v| v.to_array()).collect();
        let texels = gpu.read(&shading.maps.gradient).expect("read").concat();
        let gradients = [
            flat(&positions),
            flat(&vectors(vertex_sum::NORMAL)),
            flat(&vectors(vertex_sum::TANGENT)),
            texels,
        ];
        Layer { color, gradients, status }
    })
}

const NAMES: [&str; 4] = ["positions", "normals", "tangents", "texels"];

fn weights(pixels: usize, seed: u64) -> Vec<[f32; 4]> {
    let mut rng = Uniform::new(seed);
    (0..pixels).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect()
}

/// Without what a layer alone does not know.
fn passes() -> Passes {
    Passes { antialias: false, max_layers: 1, ..Passes::default() }
}

fn check(gpu: &Gpu, what: &str, s: &Scene, passes: &Passes) {
    check_scaled(gpu, what, s, passes, 1.0);
}

/// [`check`] with gradients of another size.
fn check_scaled(gpu: &Gpu, what: &str, s: &Scene, passes: &Passes, size: f32) {
    let g: Vec<_> = weights(s.background.len(), 3).iter().map(|g| g.map(|g| g * size)).collect();
    let (found, expected) = (on_device(gpu, s, passes, &g), on_cpu(s, passes, &g));
    assert_eq!(found.status, [0; 2], "{what}: status");
    let covered = expected.color.iter().filter(|c| c[3] > 0.0).count();
    assert!(covered > expected.color.len() / 5, "{what}: {covered} pixels are covered");
    let error = worst_difference(found.color.as_flattened(), expected.color.as_flattened());
    assert_twin("SHADED", format!("{what}: radiance"), error, SHADED);
    for (k, (found, expected)) in found.gradients.iter().zip(&expected.gradients).enumerate() {
        let error = worst_difference(found, expected);
        assert_twin("SHADED_VJP", format!("{what}, {}", NAMES[k]), error, SHADED_VJP);
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn every_sample_agrees() {
    let gpu = test_device();
    check(gpu, "one sample", &Scene::new(1, 1), &passes());
    check(gpu, "four by four samples", &Scene::new(2, 4), &passes());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn pixels_shaded_once_agree() {
    let gpu = test_device();
    let s = Scene::new(3, 4).shaded_per_pixel();
    check(gpu, "once a pixel", &s, &passes());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn parts_that_are_left_out_agree() {
    let gpu = test_device();
    let s = Scene::new(4, 1);
    let all = passes();
    check(gpu, "no normal map", &s, &Passes { normal_map: false, ..all });
    check(gpu, "no emission", &s, &Passes { emissive: false, ..all });
    check(gpu, "compensated", &s, &Passes { energy: Energy::Compensated, ..all });
    check(gpu, "no positions", &s, &Passes { position_gradients: false, ..all });
    check(gpu, "no maps", &s, &Passes { map_gradients: false, ..all });
    check(gpu, "blended", &s.with_alpha(scene::BLEND), &all);
    check(gpu, "no alpha", &s.with_alpha(scene::BLEND), &Passes { alpha_gradients: false, ..all });
    check(gpu, "cut", &s.with_alpha(scene::MASK), &all);
    let faded = Passes { masks: Masks::Faded { slope: 2.5 }, ..all };
    check(gpu, "faded", &s.with_alpha(scene::MASK), &faded);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn small_and_large_gradients_agree() {
    let gpu = test_device();
    let s = Scene::new(7, 1);
    // Of loss functions that are means over many pixels, and of sums.
    for size in [1e-7, 1e-4, 100.0] {
        check_scaled(gpu, &format!("gradients of {size}"), &s, &passes(), size);
    }
    for (bad, bit) in [(1e9, FIXED_LIMITED), (f32::NAN, FIXED_LOST)] {
        let mut g = weights(s.background.len(), 3);
        g.iter_mut().for_each(|g| *g = [bad; 4]);
        let found = on_device(gpu, &s, &passes(), &g);
        assert!(found.status.iter().all(|s| s & bit != 0), "{bad} is told: {:?}", found.status);
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn broken_meshes_agree() {
    let gpu = test_device();
    let mut s = Scene::new(8, 1);
    for (i, k) in (0..s.positions.len()).step_by(7).zip(0..) {
        match k % 6 {
            // Behind the eye, on another vertex, without a direction, without a place in the maps.
            0 => s.positions[i].z = 2.7,
            1 => s.positions[i] = s.positions[i + 1],
            2 => s.normals[i] = Vec3f::zero(),
            3 => s.tangents[i] = Vec4f::zero(),
            4 => s.uvs[i].x = f32::NAN,
            _ => s.normals[i] = -s.normals[i],
        }
    }
    for t in s.maps.levels[0].texels.iter_mut().step_by(5) {
        t[channel::ROUGHNESS] = 0.0;
        t[channel::NORMAL..channel::NORMAL + 3].fill(0.0);
    }
    s.maps.rebuild();
    let passes = Passes { position_gradients: false, ..passes() };
    let g = weights(s.background.len(), 3);
    let (found, expected) = (on_device(gpu, &s, &passes, &g), on_cpu(&s, &passes, &g));
    assert!(expected.color.as_flattened().iter().all(|c| c.is_finite()), "the CPU's picture is finite");
    assert!(found.color.as_flattened().iter().all(|c| c.is_finite()), "and the device's");
    let error = worst_difference(found.color.as_flattened(), expected.color.as_flattened());
    assert_twin("SHADED_BROKEN", "radiance", error, SHADED_BROKEN);
    let error = worst_difference(&found.gradients[3], &expected.gradients[3]);
    assert_twin("SHADED_BROKEN", "texels", error, SHADED_BROKEN);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn gradients_have_the_same_bits_in_every_run() {
    let gpu = test_device();
    let s = Scene::new(5, 1);
    let g = weights(s.background.len(), 4);
    let (a, b) = (on_device(gpu, &s, &passes(), &g), on_device(gpu, &s, &passes(), &g));
    assert!(a.gradients.iter().all(|g| g.iter().any(|g| *g != 0.0)));
    assert_eq!(a.gradients, b.gradients);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_perturbed_side_is_found() {
    let gpu = test_device();
    let s = Scene::new(6, 1);
    let g = weights(s.background.len(), 5);
    let expected = on_cpu(&s, &passes(), &g);
    let mut other = s;
    other.normals[40].x += 0.01;
    let found = on_device(gpu, &other, &passes(), &g);
    assert!(worst_difference(found.color.as_flattened(), expected.color.as_flattened()) > SHADED);
    assert!(worst_difference(&found.gradients[0], &expected.gradients[0]) > SHADED_VJP);
}
