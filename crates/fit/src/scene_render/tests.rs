//! Samples that are shaded together beside samples that are shaded alone.

use super::*;
use crate::engine::reference::ENERGY;
use crate::engine::views::studio;
use glam::{Affine3A, Vec3};
use photofit_geometry::shapes;
use photofit_raster::interpolate::{derivatives, interpolate};
use photofit_raster::rasterize::barycentrics;
use photofit_sampling::Rng;
use photofit_scalar::{Vec2f, vec2, vec4};
use photofit_scene::{
    AlphaMode, Instance, Material, Primitive, Sampler, Scene, TextureImage, TextureSlot, UvDerivatives,
};
use photofit_shading::{Surface, Yaw, face_viewer, perturb, shade, view_direction};

/// Spheres beside and behind each other: with all maps and colours of vertices, cut out by a mask, blended, unlit, and
/// plain.
pub(crate) fn spheres() -> Scene {
    let mut rng = Rng::new(3, 0);
    let mut image = |n: usize| TextureImage {
        width: n,
        height: n,
        texels: (0..n * n).map(|_| rng.next_u32().to_le_bytes()).collect(),
        ..TextureImage::default()
    };
    let images = vec![image(64), image(32)];
    let slot = |image, turned: bool| {
        let transform =
            if turned { [[1.5, 0.3, 0.1], [-0.2, 1.2, 0.4]] } else { [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        Some(TextureSlot { image, sampler: Sampler::default(), tex_coord: u32::from(turned), transform })
    };
    let all = Material {
        base_color_texture: slot(0, false),
        metallic_roughness_texture: slot(1, false),
        normal_texture: slot(0, true),
        emissive_texture: slot(1, true),
        emissive: [0.5, 0.2, 0.1],
        ..Material::default()
    };
    let seen = |alpha_mode| Material {
        base_color_texture: slot(0, false),
        double_sided: true,
        alpha_mode,
        ..Material::clay()
    };
    let unlit = Material { base_color_texture: slot(1, false), unlit: true, ..Material::clay() };
    let materials =
        vec![all, seen(AlphaMode::Mask { cutoff: 0.4 }), seen(AlphaMode::Blend), unlit, Material::clay()];
    let mut mesh = shapes::uv_sphere(24, 12);
    mesh.uvs1 = mesh.uvs.iter().map(|uv| vec2(uv.y, 1.0 - uv.x)).collect();
    mesh.colors = mesh.positions.iter().map(|p| vec4(0.5 + 0.5 * p.x, 0.6, 0.5 - 0.4 * p.y, 1.0)).collect();
    let instance = |k: usize| Instance {
        primitive: k,
        transform: Affine3A::from_translation(Vec3::new(
            0.9 * k as f32 - 1.8,
            0.2 * k as f32 - 0.4,
            0.3 * k as f32,
        )),
    };
    Scene {
        primitives: (0..materials.len()).map(|material| Primitive { mesh: mesh.clone(), material }).collect(),
        instances: (0..materials.len()).map(instance).collect(),
        materials,
        images,
        ..Scene::default()
    }
}

/// Who sees all of [`spheres`].
pub(super) fn camera() -> Camera {
    Camera::look_at(Vec3::new(0.4, 1.0, 6.0), Vec3::ZERO, Vec3::Y, 0.7, 1.0, 0.1, 20.0)
}

/// Radiance and alpha of one sample of a triangle, alone.
fn alone(of: &Shading<'_>, triangle: usize, x: usize, y: usize) -> (Vec3f, f32) {
    let (flat, library) = (of.renderer.flat, of.renderer.library);
    let mesh = &flat.mesh;
    let material = flat.triangle_material[triangle] as usize;
    let id = mesh.triangles[triangle].map(|i| i as usize);
    let b = barycentrics(&id.map(|i| of.clip[i]), of.grid.ndc(x, y), of.grid);
    let of3 = |v: &dyn Fn(usize) -> [f32; 3]| {
        let [p, q, r] = id.map(v);
        Vec3f::from_array(interpolate([&p, &q, &r], &b))
    };
    let of_uv = |v: &[Vec2f]| {
        if v.is_empty() {
            return (Vec2f::zero(), Vec2f::zero(), Vec2f::zero());
        }
        let [p, q, r] = id.map(|i| v[i].to_array());
        let d = derivatives([&p, &q, &r], &b);
        let uv = Vec2f::from_array(interpolate([&p, &q, &r], &b));
        (uv, vec2(d[0].x, d[1].x), vec2(d[0].y, d[1].y))
    };
    let ((uv0, dx0, dy0), (uv1, dx1, dy1)) = (of_uv(&mesh.uvs), of_uv(&mesh.uvs1));
    let color = if mesh.colors.is_empty() {
        Vec4f::splat(1.0)
    } else {
        let [p, q, r] = id.map(|i| mesh.colors[i].to_array());
        Vec4f::from_array(interpolate([&p, &q, &r], &b))
    };
    let footprint = UvDerivatives { dx: [dx0, dx1], dy: [dy0, dy1] };
    let s = library.lookup(material, uv0, uv1, color, Some(&footprint));
    if s.unlit || s.alpha <= 0.0 {
        return (s.base_color, s.alpha);
    }
    let [p0, p1, p2] = id.map(|i| mesh.positions[i]);
    let position = of3(&|i| mesh.positions[i].to_array());
    let normal = of3(&|i| mesh.normals[i].to_array());
    let normal = if library.has_normal_map(material) {
        let tangent = of3(&|i| mesh.tangents[i].xyz().to_array());
        perturb(normal, tangent, mesh.tangents[id[0]].w, s.normal)
    } else {
        normal.normalize_or_zero()
    };
    let wo = view_direction(of.eye, position);
    let n = face_viewer(normal, (p1 - p0).cross(p2 - p0), wo);
    let surface =
        Surface { base_color: s.base_color, roughness: s.roughness, metallic: s.metallic, gamma: 0.0 };
    (shade(&surface, ENERGY, position, n, wo, of.lights) + s.emissive, s.alpha)
}

/// The picture of a renderer, one sample a pixel, each shaded alone.
fn one_by_one(
    renderer: &SceneRenderer<'_>,
    camera: &Camera,
    lights: &[Light<'_, f32>],
    size: usize,
) -> Image {
    let mesh = &renderer.flat.mesh;
    let mut clip = vec![Vec4f::zero(); mesh.positions.len()];
    project(&matrix_rows(&camera.view_projection()), &mesh.positions, &mut clip);
    let bins = Bins::new(&clip, &mesh.triangles, &renderer.sides, size, size);
    let grid = PixelGrid::new(size, size);
    let eye = vec3(camera.eye.x, camera.eye.y, camera.eye.z);
    let shading = Shading { renderer, clip: &clip, eye, lights, grid: &grid };
    let mut image = Image::new(size, size, 4);
    for row in 0..size.div_ceil(TILE) {
        for column in 0..bins.columns() {
            let tile = bins.tile(column, row);
            let (mut layer, mut front) = (Layer::default(), None);
            let mut through = [1.0_f32; AREA];
            for _ in 0..MOST_LAYERS {
                tile.rasterize(&clip, &mesh.triangles, front.as_ref(), &mut layer);
                for i in (0..AREA).filter(|i| i % TILE < tile.width && i / TILE < tile.height) {
                    if layer.triangle[i] == NONE {
                        continue;
                    }
                    let (x, y) = (tile.x + i % TILE, tile.y + i / TILE);
                    let (radiance, alpha) = alone(&shading, layer.triangle[i] as usize, x, y);
                    let pixel = &mut image.data[(y * size + x) * 4..][..4];
                    if alpha > 0.0 {
                        (0..3).for_each(|k| pixel[k] += radiance.to_array()[k] * (through[i] * alpha));
                    }
                    through[i] *= 1.0 - alpha;
                    if through[i] < LEAST_TRANSMITTANCE {
                        (through[i], layer.triangle[i]) = (0.0, NONE);
                    }
                    pixel[3] = 1.0 - through[i];
                }
                front = Some(layer.clone());
            }
        }
    }
    image
}

#[test]
fn samples_that_are_shaded_together_are_those_that_are_shaded_alone() {
    let scene = spheres();
    let (flat, library) = (scene.flatten(), SurfaceLibrary::new(&scene));
    let renderer = SceneRenderer::new(&flat, &library);
    let studio = studio();
    let lights = [
        Light::Point { position: vec3(3.0, 4.0, 5.0), intensity: Vec3f::splat(60.0) },
        Light::Directional { direction: vec3(0.0, 0.6, 0.8), irradiance: vec3(0.9, 0.5, 0.2) },
        Light::Ambient { radiance: vec3(0.1, 0.2, 0.3) },
        Light::Environment { map: &studio, rotation: Yaw::new(0.7), scale: 0.5 },
    ];
    let camera = camera();
    for lights in [&lights[..], &lights[..1], &lights[3..], &[]] {
        let together = renderer.render(&camera, lights, 150, 150, 1);
        let alone = one_by_one(&renderer, &camera, lights, 150);
        let covered = alone.data.chunks_exact(4).filter(|p| p[3] > 0.0).count();
        assert!(covered > 4000 && alone.data.chunks_exact(4).any(|p| p[3] > 0.1 && p[3] < 0.9), "{covered}");
        for (i, (a, b)) in together.data.iter().zip(&alone.data).enumerate() {
            assert!((a - b).abs() <= 1e-6 * b.abs().max(1.0), "{a} against {b} at {i}");
        }
    }
}

/// A lamp of radiance 1000 behind glass of some alpha.
pub(super) fn lamp_behind_glass(alpha: f32) -> (Scene, Camera) {
    let card = |z: f32| {
        let mut mesh = shapes::quad_grid(1, 1);
        mesh.positions.iter_mut().for_each(|p| p.z = z);
        mesh
    };
    let glass = Material {
        base_color: [0.0, 0.0, 0.0, alpha],
        alpha_mode: AlphaMode::Blend,
        unlit: true,
        ..Material::default()
    };
    let lamp = Material { base_color: [1000.0, 1000.0, 1000.0, 1.0], unlit: true, ..Material::default() };
    let scene = Scene {
        primitives: vec![
            Primitive { mesh: card(1.0), material: 0 },
            Primitive { mesh: card(0.0), material: 1 },
        ],
        instances: (0..2).map(|primitive| Instance { primitive, transform: Affine3A::IDENTITY }).collect(),
        materials: vec![glass, lamp],
        ..Scene::default()
    };
    (scene, Camera::look_at(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, Vec3::Y, 0.1, 1.0, 0.1, 20.0))
}

#[test]
fn what_lies_behind_glass_of_any_alpha_is_seen() {
    for alpha in [0.5_f32, 0.99, 0.999, 0.9999, 1.0] {
        let (scene, camera) = lamp_behind_glass(alpha);
        let (flat, library) = (scene.flatten(), SurfaceLibrary::new(&scene));
        let picture = SceneRenderer::new(&flat, &library).render(&camera, &[], 8, 8, 1);
        let (seen, expected) = (picture.pixel(4, 4)[0], 1000.0 * (1.0 - alpha));
        assert!((seen - expected).abs() <= 1e-3 * expected, "alpha {alpha}: {seen} for {expected}");
    }
}
