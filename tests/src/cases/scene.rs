//! Cases of whole scenes: the forward renderer on glTF materials, and deferred shading of one mesh with maps.

use photofit_fit::scene_render::SceneRenderer;
use photofit_geometry::{Incidence, Mesh, shapes, tangents};
use photofit_image::{Image, to_display};
use photofit_raster::antialias::MeshTopology;
use photofit_raster::deferred::{Geometry, Passes, View, render};
use photofit_raster::project::matrix_rows;
use photofit_raster::texture::{Pyramid, Texture};
use photofit_raster::{CHANNELS, channel};
use photofit_scalar::{Vec3, Vec3f, vec3};
use photofit_scene::{
    AlphaMode, Camera, Instance, Material, Primitive, Sampler, Scene, SurfaceLibrary, TextureImage,
    TextureSlot,
};
use photofit_shading::Light;

/// Width and height of the pictures.
const SIZE: usize = 80;

fn camera(eye: [f32; 3]) -> Camera {
    Camera::look_at(eye.into(), glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 20.0)
}

fn lights() -> [Light<'static>; 2] {
    [
        Light::Point { position: vec3(2.0, 3.0, 3.0), intensity: Vec3::splat(30.0) },
        Light::Ambient { radiance: vec3(0.25, 0.3, 0.4) },
    ]
}

/// A checkerboard with straight alpha 1.
fn checker() -> TextureImage {
    let bright = |i: usize| (i % 16 / 2 + i / 16 / 2).is_multiple_of(2);
    let texels = (0..256).map(|i| if bright(i) { [250, 220, 60, 255] } else { [40, 60, 200, 255] }).collect();
    TextureImage { name: "checker".into(), width: 16, height: 16, texels, ..TextureImage::default() }
}

/// A textured sphere and a metal torus behind a pane of half-transparent glass.
pub(super) fn materials() -> Image {
    let slot = TextureSlot {
        image: 0,
        sampler: Sampler::default(),
        tex_coord: 0,
        transform: [[2.0, 0.0, 0.1], [0.0, 1.0, 0.0]],
    };
    let glass = AlphaMode::Blend;
    let materials = vec![
        Material { base_color_texture: Some(slot), metallic: 0.0, roughness: 0.4, ..Material::default() },
        Material { base_color: [0.9, 0.6, 0.3, 1.0], roughness: 0.35, ..Material::default() },
        Material {
            base_color: [0.2, 0.9, 0.4, 0.45],
            metallic: 0.0,
            alpha_mode: glass,
            ..Material::default()
        },
    ];
    let place = |primitive, x, y, z, scale| Instance {
        primitive,
        transform: glam::Affine3A::from_scale_rotation_translation(
            glam::Vec3::splat(scale),
            glam::Quat::from_rotation_x(0.6),
            glam::vec3(x, y, z),
        ),
    };
    let meshes = [shapes::uv_sphere(24, 12), shapes::torus(32, 16, 1.0, 0.35), shapes::quad_grid(1, 1)];
    let primitives =
        meshes.into_iter().zip(0..).map(|(mesh, material)| Primitive { mesh, material }).collect();
    let scene = Scene {
        name: "materials".into(),
        primitives,
        instances: vec![
            place(0, -0.5, 0.3, 0.0, 0.7),
            place(1, 0.6, -0.3, -0.3, 0.6),
            place(2, 0.3, 0.2, 1.0, 0.5),
        ],
        materials,
        images: vec![checker()],
        ..Scene::default()
    };
    let (flat, library) = (scene.flatten(), SurfaceLibrary::new(&scene));
    let image =
        SceneRenderer::new(&flat, &library).render(&camera([0.0, 0.5, 3.2]), &lights(), SIZE, SIZE, 2);
    to_display(&image.select(&[0, 1, 2]))
}

/// A torus with maps of its own: dents by a normal map, roughness and metalness in stripes.
pub(super) fn deferred() -> Image {
    let mesh: Mesh = shapes::torus(32, 16, 1.0, 0.45);
    let topology = MeshTopology::new(&mesh.triangles, &mesh.positions);
    let incidence = Incidence::new(&mesh.triangles, &photofit_geometry::Weld::identity(mesh.positions.len()));
    let frames = tangents::UvFrames::new(&incidence, &mesh.uvs);
    let tangents = tangents::vertex_tangents(&incidence, &frames, &mesh.positions, &mesh.normals);
    let view = camera([0.4, 2.2, 2.6]);
    let frame = render(
        &Geometry {
            positions: &mesh.positions,
            normals: &mesh.normals,
            tangents: &tangents,
            uvs: &mesh.uvs,
            topology: topology.topology(),
            alpha: &[],
            sides: &[],
        },
        &Pyramid::new(maps(64)),
        &View {
            view_projection: matrix_rows(&view.view_projection()),
            eye: vec3(view.eye.x, view.eye.y, view.eye.z),
            lights: &lights(),
            width: SIZE,
            height: SIZE,
            samples: 1,
            shade_per_pixel: false,
            lod_bias: 0.0,
        },
        &vec![[0.02, 0.02, 0.03]; SIZE * SIZE],
        &Passes::default(),
    );
    let rgb = frame.color.iter().flat_map(|c| [c[0], c[1], c[2]]).collect();
    to_display(&Image::from_data(SIZE, SIZE, 3, rgb))
}

/// Material maps of `size` x `size` texels.
fn maps(size: usize) -> Texture<f32, CHANNELS> {
    let texel = |i: usize| {
        let turns = |n: usize| std::f32::consts::TAU * 8.0 * (n as f32 + 0.5) / size as f32;
        let (x, y) = (i % size, i / size);
        let normal: Vec3f = vec3(0.5 * turns(x).sin(), 0.5 * turns(y).sin(), 1.0);
        let mut texel = [0.0; CHANNELS];
        texel[channel::BASE_COLOR..channel::BASE_COLOR + 3].copy_from_slice(&[0.8, 0.5, 0.4]);
        texel[channel::ALPHA] = 1.0;
        texel[channel::ROUGHNESS] = if (x * 4 / size).is_multiple_of(2) { 0.25 } else { 0.6 };
        texel[channel::METALLIC] = if (y * 4 / size).is_multiple_of(2) { 1.0 } else { 0.0 };
        texel[channel::NORMAL..channel::NORMAL + 3].copy_from_slice(&normal.normalize_or_zero().to_array());
        texel
    };
    Texture { width: size, height: size, texels: (0..size * size).map(texel).collect() }
}
