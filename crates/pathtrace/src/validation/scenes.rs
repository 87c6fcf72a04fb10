//! Small scenes and the way to render them.

use crate::{Instance, Material, Parts, PathOptions, RenderOptions, Renderer, Shape, Strategy, View, World};
use glam::{DAffine3, Vec3};
use photofit_geometry::Mesh;
pub(super) use photofit_geometry::shapes::parallelogram as quad;
use photofit_image::Image;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;
use photofit_shading::bsdf::{Bsdf, Diffuse, MetallicRoughness};
use photofit_shading::{Surface, bsdf::Energy};

pub(super) fn diffuse(r: f32, g: f32, b: f32) -> Bsdf<f32> {
    Bsdf::Diffuse(Diffuse { reflectance: vec3(r, g, b) })
}

pub(super) fn glossy(color: f32, roughness: f32, metallic: f32, energy: Energy) -> Bsdf<f32> {
    let surface = Surface { base_color: Vec3f::splat(color), roughness, metallic, gamma: 0.0 };
    Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, energy))
}

pub(super) fn place(parts: &mut Parts, mesh: Mesh, material: Material) -> usize {
    parts.add(Shape::Mesh(mesh), material)
}

/// A box of unit size, open towards +z, with a light in its ceiling and two smaller boxes in it.
pub(super) fn cornell() -> Parts {
    let mut parts = Parts::default();
    let (x, y, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let white = || Material::new(diffuse(0.73, 0.73, 0.73));
    let o = vec3(-0.5, 0.0, -0.5);
    place(&mut parts, quad(o, z, x), white());
    place(&mut parts, quad(o + y, x, z), white());
    place(&mut parts, quad(o, x, y), white());
    place(&mut parts, quad(o, y, z), Material::new(diffuse(0.63, 0.06, 0.05)));
    place(&mut parts, quad(o + x, z, y), Material::new(diffuse(0.14, 0.45, 0.09)));
    let lamp = quad(vec3(-0.15, 0.998, -0.15), x * 0.3, z * 0.3);
    let light = Material::new(diffuse(0.0, 0.0, 0.0)).emitting(vec3(17.0, 12.0, 4.0));
    place(&mut parts, lamp, light);
    let cube = photofit_geometry::shapes::cube();
    let shape = parts.shapes.len();
    parts.shapes.push(Shape::Mesh(cube));
    for (angle, scale, at) in
        [(0.3, [0.3, 0.6, 0.3], [-0.2, 0.3, -0.15]), (-0.3, [0.3, 0.3, 0.3], [0.2, 0.15, 0.15])]
    {
        let size = unit_cube_size();
        let scale = Vec3::from_array(scale) / size;
        let transform = glam::Affine3A::from_scale_rotation_translation(
            scale,
            glam::Quat::from_rotation_y(angle),
            Vec3::from_array(at),
        );
        let transform = DAffine3::from_cols_array(&transform.to_cols_array().map(f64::from));
        parts.materials.push(white());
        parts.instances.push(Instance { shape, material: parts.materials.len() - 1, transform });
    }
    parts
}

/// Edge of the cube of [`photofit_geometry::shapes::cube`].
pub(super) fn unit_cube_size() -> f32 {
    let (lo, hi) = photofit_geometry::shapes::cube().bounds().unwrap();
    hi.x - lo.x
}

pub(super) fn cornell_view() -> View {
    let eye = Vec3::new(0.0, 0.5, 2.2);
    View::pinhole(&Camera::look_at(eye, Vec3::new(0.0, 0.5, 0.0), Vec3::Y, 0.65, 1.0, 0.1, 10.0))
}

/// A camera at `eye` that looks at `target`.
pub(super) fn looking(eye: [f32; 3], target: [f32; 3], fov: f32) -> View {
    let up = if (eye[0] - target[0]).abs() + (eye[2] - target[2]).abs() > 1e-6 { Vec3::Y } else { Vec3::Z };
    View::pinhole(&Camera::look_at(eye.into(), target.into(), up, fov, 1.0, 0.1, 10.0))
}

pub(super) fn with_strategy(strategy: Strategy, max_depth: u32) -> PathOptions {
    PathOptions { strategy, max_depth, ..PathOptions::default() }
}

/// Renders to the end: the mean (four channels) and the variance of single samples (three).
pub(super) fn render(world: &World, view: &View, options: RenderOptions) -> (Image, Image) {
    let mut renderer = Renderer::new(world, view, options).unwrap();
    while !renderer.pass(|| false).done {}
    (renderer.picture(), renderer.sample_variance())
}

/// A square picture of `side` pixels with `spp` samples.
pub(super) fn square(side: usize, spp: u32) -> RenderOptions {
    RenderOptions { width: side, height: side, spp, ..RenderOptions::default() }
}
