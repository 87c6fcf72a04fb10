//! Whole pictures on a device against [`crate::deferred::render`] and [`crate::deferred::render_vjp`].

use super::scene::{self, Scene};
use super::{NAMES, on_cpu, weights};
use crate::deferred::gpu::MapShading;
use crate::deferred::{Masks, Passes};
use crate::gpu::tests::device;
use crate::gpu::tolerances::{OTHER_PIXELS, PICTURE, PICTURE_VJP};
use crate::gpu::{FrameParams, GradientBuffers, MeshBuffers, PictureBuffers, Shot, render, render_vjp};
use photofit_gpu::Gpu;
use photofit_shading::gpu::ShadingTables;
use photofit_texture::gpu::{MipBuffers, SUM_SCALE};

struct Picture {
    color: Vec<[f32; 4]>,
    gradients: [Vec<f32>; 4],
}

fn on_device(gpu: &Gpu, s: &Scene, passes: &Passes, g: &[[f32; 4]]) -> Picture {
    s.with(|geometry, view| {
        let uvs: Vec<_> = s.uvs.iter().map(|uv| [uv.x, uv.y]).collect();
        let mesh =
            MeshBuffers::new(gpu, &uvs, &geometry.topology, geometry.alpha, geometry.sides).expect("fits");
        gpu.write(&mesh.positions, bytemuck::cast_slice(&s.positions)).expect("written");
        gpu.write(&mesh.normals, bytemuck::cast_slice(&s.normals)).expect("written");
        gpu.write(&mesh.tangents, bytemuck::cast_slice(&s.tangents)).expect("written");
        let (n, pixels) = (view.width * view.height, s.background.len());
        let layers = mesh.layers(passes);
        let picture = PictureBuffers::new(gpu, &mesh, n, pixels, layers, passes.antialias).expect("fits");
        let background: Vec<_> = s.background.iter().map(|b| [b[0], b[1], b[2], 0.0]).collect();
        gpu.write(&picture.background, &background).expect("written");
        let fitted = std::array::from_fn(|c| c < crate::maps::channel::USED);
        let maps = MipBuffers::new(gpu, &s.maps, fitted, SUM_SCALE).expect("fits");
        let tables = ShadingTables::new(gpu, &[&s.environment]).expect("fits");
        let mut shading = MapShading::new(gpu, maps, tables, mesh.triangles(), passes).expect("fits");
        let params = shading.params(view, passes, SUM_SCALE, |_| 0);
        shading.set(&params);
        let shot = Shot {
            view_projection: view.view_projection,
            width: view.width,
            height: view.height,
            samples: view.samples,
            scale: SUM_SCALE,
        };
        let fits_alpha = mesh.fits_alpha(passes);
        let frame = FrameParams::new(&shot, mesh.vertices(), mesh.triangles(), passes, fits_alpha);
        let out = GradientBuffers::new(gpu, &mesh, n, pixels).expect("fits");
        gpu.write(&out.color, g).expect("written");
        let mut r = gpu.record("picture");
        render(&mut r, &mesh, &picture, passes, &frame, &mut shading).expect("recorded");
        render_vjp(&mut r, &mesh, &picture, passes, &frame, &mut shading, &out).expect("recorded");
        shading.maps.record_collect(&mut r).expect("recorded");
        r.finish().expect("finished").run().expect("runs");
        assert_eq!(gpu.read(&out.status).expect("read"), [0]);
        assert_eq!(gpu.read(&shading.maps.status).expect("read"), [0]);
        Picture {
            color: gpu.read(&picture.color).expect("read"),
            gradients: [
                gpu.read(&out.positions).expect("read").concat(),
                gpu.read(&out.normals).expect("read").concat(),
                gpu.read(&out.tangents).expect("read").concat(),
                gpu.read(&shading.maps.gradient).expect("read").concat(),
            ],
        }
    })
}

/// Norm of a difference, relative to that of the second.
fn relative(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "of one length");
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    difference / norm(&mut b.iter().map(|b| f64::from(*b))).max(1e-30)
}

fn check(gpu: &Gpu, what: &str, s: &Scene, passes: &Passes) {
    let g = weights(s.background.len(), 3);
    let (found, expected) = (on_device(gpu, s, passes, &g), on_cpu(s, passes, &g));
    let apart = |(a, b): &(&[f32; 4], &[f32; 4])| (0..4).any(|k| (a[k] - b[k]).abs() > PICTURE);
    let other = found.color.iter().zip(&expected.color).filter(apart).count();
    let share = other as f64 / found.color.len() as f64;
    assert!(share <= OTHER_PIXELS, "{what}: {other} pixels differ");
    for (k, (found, expected)) in found.gradients.iter().zip(&expected.gradients).enumerate() {
        let error = relative(found, expected);
        assert!(error <= PICTURE_VJP, "{what}, {}: differs by {error:.2e}", NAMES[k]);
    }
}

#[test]
fn opaque_pictures_agree() {
    let gpu = device!();
    check(gpu, "one sample", &Scene::new(11, 1), &Passes::default());
    check(gpu, "two by two samples", &Scene::new(12, 2), &Passes::default());
    check(gpu, "once a pixel", &Scene::new(13, 2).shaded_per_pixel(), &Passes::default());
}

#[test]
fn transparent_pictures_agree() {
    let gpu = device!();
    let s = Scene::new(14, 1);
    let all = Passes::default();
    check(gpu, "blended", &s.with_alpha(scene::BLEND), &all);
    check(gpu, "cut", &s.with_alpha(scene::MASK), &all);
    let faded = Passes { masks: Masks::Faded { slope: 2.5 }, ..all };
    check(gpu, "faded", &s.with_alpha(scene::MASK), &faded);
    let per_pixel = Scene::new(15, 2).shaded_per_pixel().with_alpha(scene::BLEND);
    check(gpu, "blended, once a pixel", &per_pixel, &all);
}

#[test]
fn a_perturbed_picture_is_found() {
    let gpu = device!();
    let s = Scene::new(16, 1);
    let g = weights(s.background.len(), 5);
    let passes = Passes::default();
    let expected = on_cpu(&s, &passes, &g);
    let mut other = s;
    other.positions[40].x += 0.003;
    let found = on_device(gpu, &other, &passes, &g);
    assert!(relative(&found.gradients[0], &expected.gradients[0]) > PICTURE_VJP);
}
