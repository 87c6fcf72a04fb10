//! Pictures of the reference: by the rasterizer that also draws the candidate, or by the path tracer.
//!
//! To the fit the renderer of the reference is a black box: it gives pictures, no gradients. Path traced pictures hold
//! what a rasterizer leaves out (shadows, light between surfaces, glass); the candidate takes up in its maps what of it
//! does not depend on the light.

use crate::FitError;
use crate::scene_render::SceneRenderer;
use crate::simplify::{Normalised, SimplifyOptions};
use crate::views::Setup;
use glam::{Affine3A, Quat, Vec3};
use photofit_image::Image;
use photofit_pathtrace::{
    EnvironmentMap, LightSource, Parts, PathOptions, RenderOptions, Renderer, View, World,
};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Scene;
use photofit_shading::{Environment, Light};
use std::sync::{Mutex, PoisonError};

/// Samples per axis of a rasterized pixel.
const SUPERSAMPLE: usize = 4;
/// Samples of a path traced pixel.
const SAMPLES: u32 = 64;
/// Rows of the maps that path tracing takes from a prefiltered environment.
const ROWS: usize = 128;

/// How pictures of the reference are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReferenceRenderer {
    /// As the candidate's: direct light without shadows.
    #[default]
    Raster,
    /// With all light.
    Path,
}

/// Makes pictures of the reference.
pub(crate) struct Painter<'a> {
    n: &'a Normalised,
    /// Behind a lock, since each picture has lights of its own.
    world: Option<Mutex<World>>,
    seed: u64,
}

impl<'a> Painter<'a> {
    pub(crate) fn new(n: &'a Normalised, scene: &Scene, options: &SimplifyOptions) -> Result<Self, FitError> {
        let world = match options.reference {
            ReferenceRenderer::Raster => None,
            ReferenceRenderer::Path => Some(Mutex::new(world(n, scene)?)),
        };
        Ok(Self { n, world, seed: options.seed })
    }

    /// A picture of `size` x `size` pixels, linear and premultiplied.
    pub(crate) fn picture(&self, setup: &Setup, size: usize) -> Result<Image, FitError> {
        let lights = setup.lights.lights();
        let Some(world) = &self.world else {
            let renderer = SceneRenderer::new(&self.n.flat, &self.n.library);
            return Ok(renderer.render(&setup.camera, &lights, size, size, SUPERSAMPLE));
        };
        let mut world = world.lock().unwrap_or_else(PoisonError::into_inner);
        let (sources, environment) = path_lights(&lights);
        world.relight(&sources, environment)?;
        let options = RenderOptions {
            width: size,
            height: size,
            spp: SAMPLES,
            seed: self.seed,
            path: PathOptions { show_environment: false, ..PathOptions::default() },
            ..RenderOptions::default()
        };
        let mut renderer = Renderer::new(&world, &View::pinhole(&setup.camera), options)?;
        while !renderer.pass(|| false).done {}
        Ok(renderer.picture())
    }
}

/// The scene in the normalised frame; its own lights are left out, as by the rasterizer.
fn world(n: &Normalised, scene: &Scene) -> Result<World, FitError> {
    let to_frame = Affine3A::from_scale(Vec3::splat(1.0 / n.radius))
        * Affine3A::from_translation(-Vec3::from_array(n.center.to_array()));
    let to_frame =
        glam::DAffine3 { matrix3: to_frame.matrix3.as_dmat3(), translation: to_frame.translation.as_dvec3() };
    let mut parts = Parts::from_scene(scene);
    parts.lights.clear();
    for instance in &mut parts.instances {
        instance.transform = to_frame * instance.transform;
    }
    // A world is never without light; every picture brings its own.
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    Ok(World::new(parts)?)
}

/// The lights of a picture as the path tracer takes them.
fn path_lights(lights: &[Light<'_, f32>]) -> (Vec<LightSource>, Option<EnvironmentMap>) {
    let (mut sources, mut environment) = (Vec::new(), None);
    for light in lights {
        match light {
            Light::Point { .. } | Light::Directional { .. } => sources.extend(LightSource::of(light)),
            Light::Ambient { radiance } => environment = Some(EnvironmentMap::constant(*radiance)),
            Light::Environment { map, rotation, scale } => {
                let x = rotation.apply(vec3(1.0, 0.0, 0.0));
                let turn = Quat::from_rotation_y((-x.z).atan2(x.x));
                let mut out = EnvironmentMap::new(equirectangular(map));
                (out.scale, out.rotation) = (*scale, turn);
                environment = Some(out);
            }
        }
    }
    (sources, environment)
}

/// The unfiltered level of an environment, laid out as [`EnvironmentMap`] says.
fn equirectangular(map: &Environment<f32>) -> Image {
    let (width, height) = (2 * ROWS, ROWS);
    let texel = |i: usize| {
        let theta = ((i / width) as f32 + 0.5) / height as f32 * std::f32::consts::PI;
        let phi = (((i % width) as f32 + 0.5) / width as f32 - 0.5) * std::f32::consts::TAU;
        let d = vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
        map.specular(d, 0.0).map(|x| x.max(0.0)).to_array()
    };
    let data: Vec<[f32; 3]> = (0..width * height).map(texel).collect();
    Image::from_data(width, height, 3, data.into_flattened())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::{Lighting, Set, setup};
    use photofit_geometry::{Mesh, shapes};
    use photofit_scene::{Instance, Material, Primitive};

    /// Spheres of clay at the given places, with radius 1.
    fn spheres(places: &[f32]) -> Scene {
        let mut mesh: Mesh = shapes::icosphere(24);
        mesh.normals = mesh.positions.clone();
        Scene {
            primitives: vec![Primitive { mesh, material: 0 }],
            materials: vec![Material {
                base_color: [0.2, 0.2, 0.2, 1.0],
                metallic: 0.0,
                roughness: 1.0,
                ..Material::clay()
            }],
            instances: places
                .iter()
                .map(|x| Instance {
                    primitive: 0,
                    transform: Affine3A::from_translation(Vec3::new(10.0 + x, 0.0, 0.0)),
                })
                .collect(),
            ..Scene::default()
        }
    }

    fn pictures(scene: &Scene, lighting: &Lighting, index: u64) -> [Image; 2] {
        let n = Normalised::new(scene).unwrap();
        let s = setup(Set::Report, index, 4, 0, lighting);
        [ReferenceRenderer::Raster, ReferenceRenderer::Path].map(|reference| {
            let options = SimplifyOptions { reference, ..SimplifyOptions::default() };
            Painter::new(&n, scene, &options).unwrap().picture(&s, 64).unwrap()
        })
    }

    fn mean(image: &Image, k: usize) -> f64 {
        image.data.chunks_exact(4).map(|p| f64::from(p[k])).sum::<f64>() / image.pixels() as f64
    }

    #[test]
    fn a_convex_body_looks_the_same_to_both() {
        // No shadows fall and no light goes from surface to surface.
        for (lighting, index) in [(Lighting::Point, 1), (Lighting::Mixed, 0), (Lighting::Mixed, 2)] {
            let [raster, path] = pictures(&spheres(&[0.0]), &lighting, index);
            for k in 0..4 {
                let (a, b) = (mean(&raster, k), mean(&path, k));
                assert!((a / b - 1.0).abs() < 0.025, "{lighting:?}, channel {k}: {a} against {b}");
            }
            // The same places are bright.
            let rmse = photofit_image::rmse(&raster, &path);
            assert!(rmse < 0.03, "{lighting:?}: {rmse}");
        }
    }

    #[test]
    fn shadows_are_in_path_traced_pictures_alone() {
        let [raster, path] = pictures(&spheres(&[0.0, 1.9, -1.9]), &Lighting::Mixed, 0);
        assert!((mean(&raster, 3) - mean(&path, 3)).abs() < 0.01);
        // Around the contact little of the sky is seen.
        let darker = |(r, p): (&[f32], &[f32])| r[3] == 1.0 && p[1] < 0.8 * r[1];
        let dark = raster.data.chunks_exact(4).zip(path.data.chunks_exact(4)).filter(|x| darker(*x)).count();
        assert!(dark > 10, "{dark} pixels are darker");
    }
}
