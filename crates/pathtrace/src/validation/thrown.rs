//! Lights that throw pictures, against closed forms.

use super::scenes::{diffuse, looking, place, quad, render, square, with_strategy};
use crate::{
    Adjoint, Falloff, GradientSamples, LightSource, Material, Parameter, Parts, Strategy, ThrownPicture,
    World,
};
use glam::DVec3;
use photofit_image::Image;
use photofit_scalar::vec3;
use photofit_scene::graph::{Bitmap, Texture};
use photofit_scene::{Filter, LightPicture, Wrap};
use std::f64::consts::PI;
use std::sync::Arc;

const ALBEDO: f64 = 0.6;
/// Height of the lights above the floor.
const HEIGHT: f64 = 2.0;
/// Half the sides of pictures at distance 1.
const HALF: [f32; 2] = [0.8, 0.5];

/// `texture` thrown down: `u` along x, `v` along -z.
fn picture(texture: Texture) -> LightPicture {
    LightPicture { texture, u: glam::Vec3::X, v: glam::Vec3::NEG_Z, half: HALF }
}

fn thrown(texture: Texture) -> Arc<ThrownPicture> {
    Arc::new(ThrownPicture::new(picture(texture)))
}

fn projector(texture: Texture) -> LightSource {
    LightSource::Projector {
        position: DVec3::Y * HEIGHT,
        direction: vec3(0.0, -3.0, 0.0),
        intensity: vec3(3.0, 2.0, 1.0),
        picture: thrown(texture),
    }
}

fn spot(picture: Option<Arc<ThrownPicture>>) -> LightSource {
    LightSource::Spot {
        position: DVec3::Y * HEIGHT,
        direction: vec3(0.0, -1.0, 0.0),
        intensity: vec3(3.0, 2.0, 1.0),
        inner: 0.2,
        outer: 0.6,
        falloff: Falloff::Linear,
        picture,
    }
}

/// An image, one colour for each column.
fn columns(colors: &[[f32; 3]]) -> Texture {
    let image = Image::from_fn(colors.len(), 1, 3, |x, _, c| colors[x][c]);
    let image = Arc::new(Bitmap::new(&image, Wrap::ClampToEdge, Filter::Nearest));
    Texture::Bitmap { image, to_uv: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], scale: 1.0 }
}

fn lit(lights: Vec<LightSource>) -> World {
    let mut parts = Parts { lights, ..Parts::default() };
    let ground = quad(vec3(-50.0, 0.0, -50.0), vec3(0.0, 0.0, 100.0), vec3(100.0, 0.0, 0.0));
    let a = ALBEDO as f32;
    place(&mut parts, ground, Material::new(diffuse(a, a, a)));
    World::new(parts).unwrap()
}

/// Irradiance of the floor at `x` and `z`.
fn irradiance(world: &World, x: f32, z: f32) -> [f64; 3] {
    let view = looking([x, 1.0, z + 0.001], [x, 0.0, z], 0.002);
    let options = crate::RenderOptions { path: with_strategy(Strategy::Mis, 1), ..square(2, 4) };
    let (picture, _) = render(world, &view, options);
    std::array::from_fn(|c| {
        let sum: f64 = picture.data.chunks_exact(4).map(|p| f64::from(p[c])).sum();
        sum / 4.0 * PI / ALBEDO
    })
}

fn close(found: [f64; 3], wanted: [f64; 3], what: &str) {
    let near = |a: f64, b: f64| (a - b).abs() < 1e-3 * b + 1e-6;
    assert!((0..3).all(|c| near(found[c], wanted[c])), "{what}: {found:?}, expected {wanted:?}");
}

#[test]
fn a_constant_picture_lights_a_plane_evenly() {
    let world = lit(vec![projector(Texture::number(0.5))]);
    let wanted = [3.0, 2.0, 1.0].map(|i| 0.5 * i / (HEIGHT * HEIGHT));
    // The picture covers 1.6 to either side along x, 1 along z.
    for (x, z) in [(0.0, 0.0), (1.55, 0.0), (-1.55, 0.95), (0.7, -0.95)] {
        close(irradiance(&world, x, z), wanted, &format!("at {x} {z}"));
    }
    for (x, z) in [(1.65, 0.0), (-1.65, 0.5), (0.0, 1.05), (0.0, -1.05), (3.0, 3.0)] {
        close(irradiance(&world, x, z), [0.0; 3], &format!("beside at {x} {z}"));
    }
}

#[test]
fn half_of_a_half_black_picture_is_lit() {
    let world = lit(vec![projector(columns(&[[0.0; 3], [1.0, 0.5, 0.25]]))]);
    let wanted = [3.0, 1.0, 0.25].map(|i| i / (HEIGHT * HEIGHT));
    for (x, z) in [(0.05, 0.0), (1.5, 0.9)] {
        close(irradiance(&world, x, z), wanted, &format!("at {x} {z}"));
        close(irradiance(&world, -x, z), [0.0; 3], &format!("at -{x} {z}"));
    }
}

#[test]
fn a_spot_that_throws_white_is_the_plain_spot() {
    let white = |half| LightPicture { half, ..picture(columns(&[[1.0; 3]; 2])) };
    let half = 0.6_f32.tan();
    let plain = lit(vec![spot(None)]);
    let thrown = lit(vec![spot(Some(Arc::new(ThrownPicture::new(white([half; 2])))))]);
    for x in [0.0, 0.3, 0.7, 1.1, 1.35, 1.5] {
        close(irradiance(&thrown, x, 0.2 * x), irradiance(&plain, x, 0.2 * x), &format!("at {x}"));
    }
    // Colours where they belong, under the same fade.
    let colors = lit(vec![spot(Some(thrown_columns()))]);
    for (x, share) in [(-0.5, [1.0, 0.5, 0.0]), (0.5, [0.0, 0.5, 1.0])] {
        let [r, g, b] = irradiance(&plain, x, 0.1);
        close(irradiance(&colors, x, 0.1), [r * share[0], g * share[1], b * share[2]], &format!("at {x}"));
    }
}

fn thrown_columns() -> Arc<ThrownPicture> {
    thrown(columns(&[[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]]))
}

#[test]
fn gradients_of_intensities_see_the_colours_of_pictures() {
    let world = lit(vec![projector(columns(&[[0.25, 0.5, 1.0]]))]);
    let view = looking([0.0, 1.0, 0.001], [0.0, 0.0, 0.0], 0.002);
    let options = crate::RenderOptions { path: with_strategy(Strategy::Mis, 1), ..square(2, 4) };
    let adjoint = Adjoint::new(&world, &view, options, &[Parameter::Light { light: 0 }]).unwrap();
    let loss = Image::from_fn(2, 2, 3, |_, _, _| 0.25);
    let gradient = adjoint.render_vjp(&loss, GradientSamples { spp: 4, seed: None }).unwrap();
    let wanted = [0.25, 0.5, 1.0].map(|p| p / (HEIGHT * HEIGHT));
    let found: [f64; 3] = std::array::from_fn(|c| gradient.parameters[0].values[c] * PI / ALBEDO);
    close(found, wanted, "gradient");
}

#[test]
fn pictures_move_and_grow_with_the_world() {
    let mut parts = Parts { lights: vec![projector(Texture::number(1.0))], ..Parts::default() };
    let ground = quad(vec3(-50.0, 0.0, -50.0), vec3(0.0, 0.0, 100.0), vec3(100.0, 0.0, 0.0));
    place(&mut parts, ground, Material::new(diffuse(0.6, 0.6, 0.6)));
    parts.scale(2.0, DVec3::new(5.0, 0.0, 0.0));
    let world = World::new(parts).unwrap();
    let wanted = [3.0, 2.0, 1.0].map(|i| i / (HEIGHT * HEIGHT));
    close(irradiance(&world, 8.0, 1.9), wanted, "inside");
    close(irradiance(&world, 8.5, 1.9), [0.0; 3], "beside");
}

#[test]
fn one_bright_texel_counts_as_a_light() {
    // It lies between the looks that estimate the mean.
    let mut colors = vec![[0.0; 3]; 4096];
    colors[2000] = [1.0; 3];
    let world = lit(vec![projector(columns(&colors))]);
    let x = (2000.5 / 4096.0 * 2.0 - 1.0) * HALF[0] * HEIGHT as f32;
    assert!(irradiance(&world, x, 0.0)[0] > 0.1);
}

#[test]
fn broken_pictures_are_refused() {
    let whole = picture(Texture::number(1.0));
    for (broken, part) in [
        (LightPicture { u: glam::Vec3::Y, ..whole.clone() }, "right angles"),
        (LightPicture { v: glam::Vec3::NEG_Z * 2.0, ..whole.clone() }, "unit axes"),
        (LightPicture { half: [0.0, 1.0], ..whole.clone() }, "positive"),
        (LightPicture { texture: Texture::number(f32::NAN), ..whole.clone() }, "finite"),
        (LightPicture { texture: Texture::number(-1.0), ..whole }, "not negative"),
    ] {
        let LightSource::Projector { position, direction, intensity, .. } = projector(Texture::number(1.0))
        else {
            unreachable!()
        };
        let picture = Arc::new(ThrownPicture::new(broken));
        let light = LightSource::Projector { position, direction, intensity, picture };
        let text = World::new(Parts { lights: vec![light], ..Parts::default() }).unwrap_err().to_string();
        assert!(text.contains(part), "{part} in {text}");
    }
}
