//! Cases of `photofit-shading`: spheres in closed form, so that no renderer is involved.

use photofit_image::{Image, contact_sheet};
use photofit_scalar::{Vec3, Vec3f, vec3};
use photofit_shading::{Energy, Environment, Light, Surface, Yaw, shade};

/// Size of one sphere in pixels.
const SIZE: usize = 32;

/// One sphere `[SIZE, SIZE, 3]`, seen along -z without perspective; linear radiance.
fn sphere(surface: &Surface, lights: &[Light<'_>]) -> Image {
    let mut image = Image::new(SIZE, SIZE, 3);
    for y in 0..SIZE {
        for x in 0..SIZE {
            let place = |i: usize| (i as f32 + 0.5) / (0.5 * SIZE as f32) - 1.0;
            let (px, py) = (place(x), -place(y));
            let height = 1.0 - px * px - py * py;
            // The rim is left out: its normals turn away within one pixel.
            if height > 0.01 {
                let n: Vec3f = vec3(px, py, height.sqrt());
                let radiance = shade(surface, Energy::Single, n, n, vec3(0.0, 0.0, 1.0), lights);
                image.pixel_mut(x, y).copy_from_slice(&radiance.to_array());
            }
        }
    }
    image
}

/// Roughness grows to the right, metalness downwards; the last sphere has no specular lobe.
fn materials(lights: &[Light<'_>]) -> Image {
    let base_color = vec3(0.8, 0.45, 0.2);
    let surface = |roughness, metallic, gamma| Surface { base_color, roughness, metallic, gamma };
    let mut spheres = Vec::new();
    for metallic in [0.0, 1.0] {
        for roughness in [0.15, 0.4, 0.7] {
            spheres.push(sphere(&surface(roughness, metallic, 0.0), lights));
        }
        spheres.push(sphere(&surface(0.4, metallic, 1.0 - metallic), lights));
    }
    contact_sheet(&spheres.iter().collect::<Vec<_>>(), 4, 0)
}

/// A point light at the upper left and a dim directional one.
pub(super) fn point_light() -> Image {
    let position = vec3(-2.0, 2.5, 3.0);
    let direction = vec3(0.8, 0.0, 0.6);
    materials(&[
        Light::Point { position, intensity: Vec3::splat(20.0) },
        Light::Directional { direction, irradiance: vec3(0.1, 0.2, 0.6) },
    ])
}

/// The same radiance from every direction.
pub(super) fn ambient_light() -> Image {
    materials(&[Light::Ambient { radiance: vec3(0.7, 0.8, 1.0) }])
}

/// An environment of a sky gradient, a dark ground and a warm window, turned by a quarter.
pub(super) fn environment_light() -> Image {
    let (width, height) = (32, 16);
    let texel = |i: usize| {
        let (x, y) = (i % width, i / width);
        match (x, y) {
            (10..14, 4..7) => [12.0, 8.0, 4.0],
            (_, 0..8) => [0.3, 0.4, 0.5 + 0.06 * y as f32],
            _ => [0.1, 0.08, 0.05],
        }
    };
    let rgb: Vec<f32> = (0..width * height).flat_map(texel).collect();
    let map = Environment::from_equirectangular(width, height, &rgb).expect("a valid image");
    let rotation = Yaw::new(std::f32::consts::FRAC_PI_2);
    materials(&[Light::Environment { map: &map, rotation, scale: 1.0 }])
}
