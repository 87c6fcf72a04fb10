//! Textures and graphs against their definitions.

use super::*;
use photofit_image::Image;
use photofit_scalar::{Vec3f, Vec4f, vec2, vec3};
use photofit_shading::bsdf::Diffuse;
use photofit_texture::{Filter, Wrap};
use std::sync::Arc;

fn at(u: f32, v: f32) -> SurfacePoint {
    SurfacePoint { uv: vec2(u, v), color: Vec4f::splat(1.0), piece: 0 }
}

const IDENTITY: UvTransform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

fn image(wrap: Wrap, filter: Filter) -> Arc<Bitmap> {
    Arc::new(Bitmap::new(&Image::from_fn(4, 3, 1, |x, y, _| (x + 4 * y) as f32), wrap, filter))
}

#[test]
fn bitmaps_wrap_and_interpolate() {
    let read = |wrap, filter, u: f32, v: f32| image(wrap, filter).color(vec2(u, v)).x;
    use Filter::{Bilinear, Nearest};
    use Wrap::{ClampToEdge as Clamp, MirroredRepeat as Mirror, Repeat};
    // Row 0 lies at v = 0; centres lie at half texels.
    assert_eq!(read(Repeat, Bilinear, 0.125, 0.5 / 3.0), 0.0);
    assert!((read(Repeat, Bilinear, 0.25, 0.5 / 3.0) - 0.5).abs() < 1e-5);
    assert!((read(Repeat, Bilinear, 0.0, 0.5 / 3.0) - 1.5).abs() < 1e-5);
    assert_eq!(read(Clamp, Bilinear, -3.0, 0.5 / 3.0), 0.0);
    assert_eq!(read(Mirror, Bilinear, -0.125, 0.5 / 3.0), 0.0);
    assert_eq!(read(Mirror, Nearest, 1.1, 0.9), 11.0);
    assert_eq!(read(Repeat, Nearest, 1.1, 0.9), 8.0);
    for u in [f32::NAN, f32::INFINITY, -1e30, 1e30] {
        for wrap in [Repeat, Mirror, Clamp] {
            for filter in [Bilinear, Nearest] {
                assert!(read(wrap, filter, u, u).is_finite(), "{u} {wrap:?} {filter:?}");
            }
        }
    }
}

#[test]
fn gradients_are_differences() {
    let bitmap = Image::from_fn(5, 7, 3, |x, y, c| ((7 * x + 3 * y * y + c) % 5) as f32);
    let image = Arc::new(Bitmap::new(&bitmap, Wrap::Repeat, Filter::Bilinear));
    let texture = Texture::Bitmap { image, to_uv: [[2.0, 0.3, 0.1], [-0.4, 1.5, 0.2]], scale: 0.7 };
    for (u, v) in [(0.21, 0.33), (0.64, 0.81), (-0.4, 1.3)] {
        let g = texture.gradient(&at(u, v));
        let h = 1e-3;
        let du = (texture.value(&at(u + h, v)) - texture.value(&at(u - h, v))) / (2.0 * h);
        let dv = (texture.value(&at(u, v + h)) - texture.value(&at(u, v - h))) / (2.0 * h);
        assert!((g.x - du).abs() < 0.02 * (1.0 + du.abs()), "{g:?} {du}");
        assert!((g.y - dv).abs() < 0.02 * (1.0 + dv.abs()), "{g:?} {dv}");
    }
}

#[test]
fn a_flat_height_and_a_straight_normal_change_nothing_and_a_slope_tilts() {
    let leaf = || Box::new(SurfaceNode::Constant(Bsdf::Diffuse(Diffuse { reflectance: Vec3f::splat(0.5) })));
    let partials = || Partials { du: vec3(2.0, 0.0, 0.0), dv: vec3(0.0, 2.0, 0.0) };
    let normal = |root: SurfaceNode, u: f32| {
        let graph = SurfaceGraph { root, emission: None };
        graph.resolve(&at(u, 0.5), true, partials).normal.unwrap()
    };
    let straight = Texture::Constant(vec3(0.5, 0.5, 1.0));
    let n = normal(SurfaceNode::NormalMap { map: straight, inner: leaf() }, 0.3);
    assert!((n - vec3(0.0, 0.0, 1.0)).length() < 1e-6);
    let flat = SurfaceNode::Bump { height: Texture::number(3.0), scale: 1.0, inner: leaf() };
    assert_eq!(normal(flat, 0.3), vec3(0.0, 0.0, 1.0));
    // Height 4 u over two units of length per u: slope 2.
    let ramp = image(Wrap::ClampToEdge, Filter::Bilinear);
    let height = Texture::Bitmap { image: ramp, to_uv: IDENTITY, scale: 1.0 };
    let n = normal(SurfaceNode::Bump { height, scale: 1.0, inner: leaf() }, 0.5);
    let expected = vec3(-2.0_f32, 0.0, 1.0);
    assert!((n.x / n.z - expected.x).abs() < 1e-4, "{n:?}");
}

#[test]
fn sides_mixtures_and_constants() {
    let grey = |x: f32| SurfaceNode::Diffuse { reflectance: Texture::number(x) }.simplified();
    assert!(grey(0.5).constant().is_some());
    let check = Texture::Checkerboard {
        colors: Arc::new([Texture::number(0.0), Texture::number(1.0)]),
        to_uv: [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
    };
    let both = SurfaceNode::TwoSided { front: Box::new(grey(0.1)), back: Some(Box::new(grey(0.9))) };
    let blend = SurfaceNode::Blend { weight: check, inner: Box::new([grey(0.2), grey(0.4)]) };
    assert!(both.constant().is_none() && !both.transmits());
    let partials = || Partials { du: Vec3f::zero(), dv: Vec3f::zero() };
    let reflectance = |b: &Bsdf<f32>| match b {
        Bsdf::Diffuse(d) => d.reflectance.x,
        other => panic!("{other:?}"),
    };
    let both = SurfaceGraph { root: both, emission: None };
    assert_eq!(reflectance(&both.resolve(&at(0.0, 0.0), true, partials).bsdf), 0.1);
    assert_eq!(reflectance(&both.resolve(&at(0.0, 0.0), false, partials).bsdf), 0.9);
    let blend = SurfaceGraph { root: blend, emission: None };
    for (u, share) in [(0.1, 0.0), (0.4, 1.0)] {
        let (second, w) = blend.resolve(&at(u, 0.1), true, partials).second.unwrap();
        assert_eq!((reflectance(&second), w), (0.4, share));
    }
}

#[test]
fn gradients_of_bitmaps_fall_on_the_texels_that_are_read() {
    use Filter::{Bilinear, Nearest};
    use Wrap::{ClampToEdge as Clamp, MirroredRepeat as Mirror, Repeat};
    // A colour is linear in its texels: <g, color(texels)> = <color_vjp(g), texels>, for texels of both signs.
    let g = vec3(0.7, -1.3, 0.4);
    for (channels, wrap, filter) in [1, 3].into_iter().flat_map(|c| {
        [Repeat, Mirror, Clamp].into_iter().flat_map(move |w| [Bilinear, Nearest].map(|f| (c, w, f)))
    }) {
        let texel = |x: usize, y: usize, c: usize| ((7 * x + 13 * y + 5 * c) % 11) as f32 - 4.0;
        let image = Image::from_fn(4, 3, channels, texel);
        let map = Arc::new(Bitmap::new(&image, wrap, filter));
        let texture = Texture::Bitmap { image: map, to_uv: IDENTITY, scale: 1.5 };
        for (u, v) in [(0.1, 0.2), (0.6, 0.9), (-0.3, 1.7), (2.2, -0.6)] {
            let place = at(u, v);
            let dot = |found: &mut f32, t: usize, share: Vec3f| {
                let share = share.to_array();
                (0..channels).for_each(|c| *found += share[c] * image.data[t * channels + c]);
            };
            let mut found = 0.0;
            texture.color_vjp(&place, g, |t, share| dot(&mut found, t, share));
            let expected = g.dot(texture.color(&place));
            assert!((found - expected).abs() < 1e-4, "{channels} {wrap:?} {filter:?}: {found} {expected}");
            let mut found = 0.0;
            texture.value_vjp(&place, 0.6, |t, share| dot(&mut found, t, share));
            let expected = 0.6 * texture.value(&place);
            assert!((found - expected).abs() < 1e-4, "{channels} {wrap:?} {filter:?}: {found} {expected}");
        }
    }
}

#[test]
fn textures_without_an_adjoint_are_told() {
    let grey = Texture::number(0.5);
    let metal = |rough| SurfaceNode::Conductor {
        eta: grey.clone(),
        k: grey.clone(),
        reflectance: grey.clone(),
        rough,
    };
    let checks = Texture::Checkerboard { colors: Arc::new([grey.clone(), grey.clone()]), to_uv: IDENTITY };
    let of = |root| SurfaceGraph { root, emission: None }.differentiable();
    assert_eq!(of(SurfaceNode::Diffuse { reflectance: grey.clone() }), [true]);
    assert_eq!(of(SurfaceNode::Diffuse { reflectance: checks }), [false]);
    assert_eq!(of(metal(None)), [false; 3], "a mirror's lobe has no density");
    let graph =
        SurfaceGraph { root: SurfaceNode::Diffuse { reflectance: grey.clone() }, emission: Some(grey) };
    assert_eq!(graph.differentiable().len(), graph.textures().len());
}
