//! A scene in the open, and one in a room that light enters through a gap.

use glam::{Affine3A, Vec3};
use photofit_geometry::{Mesh, shapes};
use photofit_pathtrace::View;
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{Camera, Instance, Material, Primitive, Scene, TextureImage, TextureSlot};

/// Texels along the side of a texture.
const TEXELS: usize = 32;
/// Pictures.
const VIEWS: usize = 10;

/// A scene, its name and cameras.
type Case = (&'static str, Scene, Vec<View>);

/// A torus and a metal ball over a floor.
pub(super) fn open() -> Case {
    let mut scene = Scene::default();
    add(
        &mut scene,
        sheet(vec3(-1.4, 0.0, -1.4), vec3(0.0, 0.0, 2.8), vec3(2.8, 0.0, 0.0)),
        checks(8),
        even(0.7, 0.0),
    );
    objects(&mut scene);
    ("open", scene, around(4.6, [0.35, 1.1]))
}

/// The same in a room whose ceiling has a gap; its walls are seen from inside alone.
pub(super) fn room() -> Case {
    let mut scene = Scene::default();
    let (x, y, z) = (vec3(2.8, 0.0, 0.0), vec3(0.0, 1.6, 0.0), vec3(0.0, 0.0, 2.8));
    let o = vec3(-1.4, 0.0, -1.4);
    add(&mut scene, sheet(o, z, x), checks(8), even(0.7, 0.0));
    for (corner, a, b) in [(o, x, y), (o + z, y, x), (o, y, z), (o + x, z, y)] {
        add(&mut scene, sheet(corner, a, b), checks(16), even(0.8, 0.0));
    }
    // The ceiling around its gap.
    for (corner, a, b) in [
        (o + y, x, z * 0.3),
        (o + y + z * 0.7, x, z * 0.3),
        (o + y + z * 0.3, x * 0.3, z * 0.4),
        (o + y + z * 0.3 + x * 0.7, x * 0.3, z * 0.4),
    ] {
        add(&mut scene, sheet(corner, a, b), checks(32), even(0.8, 0.0));
    }
    objects(&mut scene);
    ("room", scene, around(5.2, [0.2, 0.75]))
}

fn objects(scene: &mut Scene) {
    let at = |mut mesh: Mesh, scale: f32, to: Vec3f| {
        mesh.positions.iter_mut().for_each(|p| *p = *p * scale + to);
        mesh
    };
    let torus = at(shapes::torus(32, 16, 1.0, 0.42), 0.42, vec3(-0.5, 0.2, 0.25));
    add(scene, torus, checks(4), bands([0.2, 0.7], 0.0));
    let ball = at(shapes::uv_sphere(32, 16), 0.4, vec3(0.6, 0.42, -0.3));
    add(scene, ball, &|_, _| [230, 190, 110, 255], bands([0.25, 0.5], 1.0));
}

/// Cameras on two circles around the middle.
fn around(distance: f32, elevations: [f32; 2]) -> Vec<View> {
    let middle = Vec3::new(0.0, 0.45, 0.0);
    let view = |k: usize| {
        let (turn, up) = (std::f32::consts::TAU * (k as f32 + 0.3) / VIEWS as f32, elevations[k % 2]);
        let eye = middle + distance * Vec3::new(up.cos() * turn.cos(), up.sin(), up.cos() * turn.sin());
        View::pinhole(&Camera::look_at(eye, middle, Vec3::Y, 0.7, 1.0, 0.1, 20.0))
    };
    (0..VIEWS).map(view).collect()
}

type Texel<'a> = &'a dyn Fn(usize, usize) -> [u8; 4];

/// Checks of two colours, so many texels wide.
fn checks(width: usize) -> Texel<'static> {
    match width {
        4 => &|x, y| if (x / 4 + y / 8) % 2 == 0 { [200, 60, 60, 255] } else { [225, 215, 190, 255] },
        8 => &|x, y| if (x / 8 + y / 8) % 2 == 0 { [190, 150, 90, 255] } else { [90, 110, 150, 255] },
        16 => &|x, y| if (x / 16 + y / 16) % 2 == 0 { [180, 190, 170, 255] } else { [120, 160, 120, 255] },
        _ => &|_, _| [200, 200, 200, 255],
    }
}

/// Roughness and metalness that are the same everywhere.
fn even(roughness: f32, metallic: f32) -> [[u8; 4]; 2] {
    bands([roughness; 2], metallic)
}

/// Two roughnesses in bands.
fn bands(roughness: [f32; 2], metallic: f32) -> [[u8; 4]; 2] {
    roughness.map(|r| [255, (255.0 * r) as u8, (255.0 * metallic) as u8, 255])
}

fn sheet(corner: Vec3f, a: Vec3f, b: Vec3f) -> Mesh {
    let mut mesh = shapes::parallelogram(corner, a, b);
    mesh.uvs = vec![vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(1.0, 1.0), vec2(0.0, 1.0)];
    mesh
}

fn add(scene: &mut Scene, mesh: Mesh, color: Texel<'_>, [a, b]: [[u8; 4]; 2]) {
    let mut slot = |texel: Texel<'_>| {
        scene.images.push(TextureImage {
            width: TEXELS,
            height: TEXELS,
            texels: (0..TEXELS * TEXELS).map(|i| texel(i % TEXELS, i / TEXELS)).collect(),
            ..TextureImage::default()
        });
        let image = scene.images.len() - 1;
        Some(TextureSlot::new(image))
    };
    let base_color_texture = slot(color);
    let metallic_roughness_texture = slot(&|_, y| if y / 8 % 2 == 0 { a } else { b });
    let material = scene.materials.len();
    scene.materials.push(Material { base_color_texture, metallic_roughness_texture, ..Material::default() });
    scene.primitives.push(Primitive { mesh, material });
    scene.instances.push(Instance { primitive: material, transform: Affine3A::IDENTITY });
}
