//! A lit ball path traced, then its material replaced without building anything again.
//!
//! `cargo run --release -p photofit-pathtrace --example lamp`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_pathtrace::{
    EnvironmentMap, Material, Parts, PathtraceError, RenderOptions, Renderer, Shape, View, World,
};
use photofit_scalar::{Vec3, vec3};
use photofit_scene::Camera;
use photofit_shading::bsdf::{Bsdf, Diffuse};
use std::time::Instant;

/// Mean of the picture and the largest standard error of a pixel.
fn render(world: &World, view: &View) -> Result<(f32, f32), PathtraceError> {
    let options = RenderOptions { width: 96, height: 96, spp: 64, ..RenderOptions::default() };
    let mut renderer = Renderer::new(world, view, options)?;
    renderer.finish();
    let (picture, variance) = (renderer.picture(), renderer.sample_variance());
    let mean = picture.data.chunks_exact(4).map(|p| p[1]).sum::<f32>() / picture.pixels() as f32;
    let worst = variance.data.iter().fold(0.0_f32, |a, v| a.max(*v));
    Ok((mean, (worst / 64.0).sqrt()))
}

fn main() -> Result<(), PathtraceError> {
    let white = |albedo: f32| Material::new(Bsdf::Diffuse(Diffuse { reflectance: Vec3::splat(albedo) }));
    let mut parts =
        Parts { environment: Some(EnvironmentMap::constant(vec3(0.4, 0.5, 0.6))), ..Parts::default() };
    let ball = Shape::Sphere { center: Vec3::splat(0.0), radius: 1.0 };
    parts.add(ball, white(0.8));
    let mut world = World::new(parts)?;
    let eye = glam::vec3(0.0, 1.0, 4.0);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.7, 1.0, 0.1, 10.0);
    for albedo in [0.8, 0.2] {
        let began = Instant::now();
        world.set_material(0, &white(albedo))?;
        let edit = began.elapsed();
        let (mean, noise) = render(&world, &View::pinhole(&camera))?;
        println!(
            "albedo {albedo}: edited in {edit:?}, mean {mean:.4}, standard error of a pixel at most {noise:.4}"
        );
    }
    Ok(())
}
