//! Gradients of a mixture's two sides and of the emission against differences, for every texel of every texture.

use super::super::{Bitmap, Roughness, SurfaceGraph, SurfaceNode, SurfacePoint, Texture};
use photofit_image::Image;
use photofit_scalar::{Vec3f, Vec4f, vec2, vec3};
use photofit_shading::bsdf::{
    Bsdf, BsdfGradient, DiffuseGradient, Distribution, Microfacet, RoughConductorGradient,
};
use photofit_texture::{Filter, Wrap};
use std::collections::BTreeMap;
use std::sync::Arc;

const WIDTH: usize = 4;
const HEIGHT: usize = 3;
const PLACES: [[f32; 2]; 2] = [[0.31, 0.64], [0.93, 0.12]];

fn bitmap(channels: usize, seed: usize) -> Texture {
    let value = |x: usize, y: usize, c: usize| 0.1 + 0.7 * ((5 * x + 7 * y + 3 * c + seed) % 9) as f32 / 9.0;
    let image = Image::from_fn(WIDTH, HEIGHT, channels, value);
    let image = Arc::new(Bitmap::new(&image, Wrap::Repeat, Filter::Bilinear));
    Texture::Bitmap { image, to_uv: [[1.5, 0.2, 0.1], [-0.3, 0.9, 0.2]], scale: 0.8 }
}

/// A mixture of a diffuse surface and a rough metal behind a mask that shines.
fn graph() -> SurfaceGraph {
    let surface = Microfacet::isotropic(Distribution::Ggx, 0.0);
    let rough = Roughness { surface, alpha_u: bitmap(1, 2), alpha_v: bitmap(1, 4) };
    let metal = SurfaceNode::Conductor {
        eta: Texture::number(0.2),
        k: Texture::number(3.0),
        reflectance: bitmap(3, 1),
        rough: Some(rough),
    };
    let diffuse = SurfaceNode::Diffuse { reflectance: bitmap(3, 5) };
    let inner = Box::new([diffuse, metal]);
    let blend = Box::new(SurfaceNode::Blend { weight: Texture::number(0.4), inner });
    let root = SurfaceNode::Mask { opacity: Texture::number(0.9), inner: blend };
    SurfaceGraph { root, emission: Some(bitmap(3, 7)) }
}

fn point([u, v]: [f32; 2]) -> SurfacePoint {
    SurfacePoint { uv: vec2(u, v), color: Vec4f::splat(1.0), piece: 0 }
}

const OF_DIFFUSE: Vec3f = vec3(0.4, -0.9, 0.6);
const OF_METAL: Vec3f = vec3(-0.7, 0.3, 1.1);
const OF_ALPHA: [f32; 2] = [0.8, -0.5];
const OF_EMISSION: Vec3f = vec3(1.2, 0.5, -0.6);

/// What the gradients are of.
fn value(graph: &SurfaceGraph) -> f64 {
    let at = |place| {
        let at = point(place);
        let resolved = graph.resolve(&at, true, || unreachable!("no normals"));
        let Bsdf::Diffuse(diffuse) = resolved.bsdf else { panic!("{:?}", resolved.bsdf) };
        let Some((Bsdf::RoughConductor(metal), _)) = resolved.second else { panic!("{:?}", resolved.second) };
        let emission = graph.emission.as_ref().expect("it shines").color(&at);
        let alphas = metal.surface.alpha_x * OF_ALPHA[0] + metal.surface.alpha_y * OF_ALPHA[1];
        let dot = |a: Vec3f, b: Vec3f| f64::from(a.dot(b));
        dot(diffuse.reflectance, OF_DIFFUSE)
            + dot(metal.metal.reflectance, OF_METAL)
            + f64::from(alphas)
            + dot(emission, OF_EMISSION)
    };
    PLACES.into_iter().map(at).sum()
}

#[test]
fn all_textures_have_the_gradients_of_differences() {
    let first = graph();
    let mut found: BTreeMap<(usize, usize), Vec3f> = BTreeMap::new();
    let diffuse =
        BsdfGradient::Diffuse(DiffuseGradient { reflectance: OF_DIFFUSE, ..DiffuseGradient::default() });
    let metal =
        BsdfGradient::RoughConductor(RoughConductorGradient { reflectance: OF_METAL, alpha: OF_ALPHA });
    for place in PLACES {
        let mut add = |texture: usize, texel: usize, g: Vec3f| {
            let sum = found.entry((texture, texel)).or_insert(Vec3f::zero());
            *sum += g;
        };
        first.resolve_vjp(&point(place), true, [Some(&diffuse), Some(&metal)], &mut add);
        first.emission_vjp(&point(place), OF_EMISSION, &mut add);
    }
    let differentiable = first.differentiable();
    // Opacity, weight, reflectance, eta, k, reflectance, two alphas, emission.
    let wanted = [false, false, true, false, false, true, true, true, true];
    assert_eq!(differentiable, wanted);
    for (texture, _) in differentiable.iter().enumerate().filter(|(_, d)| **d) {
        let Texture::Bitmap { image, .. } = first.textures()[texture].clone() else { panic!("{texture}") };
        let (channels, mut seen) = (image.channels(), 0);
        for (texel, c) in (0..WIDTH * HEIGHT).flat_map(|t| (0..channels).map(move |c| (t, c))) {
            let h = 0.05;
            let at = |h: f32| {
                let mut graph = graph();
                graph.edit_texture(texture, |t| {
                    let Texture::Bitmap { image, .. } = t else { panic!("{texture}") };
                    let mut texels = image.texels();
                    texels[3 * texel + c] += h;
                    Arc::make_mut(image).set_texels(&texels);
                });
                value(&graph)
            };
            let wanted = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let g = found.get(&(texture, texel)).copied().unwrap_or(Vec3f::zero());
            let g = g.to_array()[c];
            assert!((f64::from(g) - wanted).abs() < 1e-4, "{texture} {texel} {c}: {g} {wanted}");
            seen += usize::from(wanted.abs() > 1e-3);
        }
        assert!(seen >= 4 * channels, "texture {texture}: {seen}");
    }
}
