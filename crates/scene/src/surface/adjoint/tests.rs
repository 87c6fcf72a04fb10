//! Gradients of a lookup against differences, for every factor and every texel of every map.

use super::super::{MapKind, SurfaceSample};
use super::*;
use crate::{Filter, Material, Sampler, Scene, TextureImage, TextureSlot};
use photofit_scalar::{vec2, vec4};

const SIDE: usize = 4;
const TINT: Vec4f = vec4(0.7, 0.9, 0.4, 1.0);
const PLACES: [[f32; 2]; 3] = [[0.31, 0.64], [0.02, 0.97], [0.5, 0.125]];

/// A material with one texture per map, whose texels and factors differ.
fn library() -> SurfaceLibrary {
    let slot = |image| {
        let sampler = Sampler { filter: Filter::Bilinear, ..Sampler::default() };
        Some(TextureSlot { sampler, ..TextureSlot::new(image) })
    };
    let material = Material {
        base_color: [0.8, 0.6, 0.3, 1.0],
        roughness: 0.7,
        metallic: 0.6,
        emissive: [1.5, 0.4, 2.5],
        normal_scale: 0.6,
        base_color_texture: slot(0),
        metallic_roughness_texture: slot(1),
        normal_texture: slot(2),
        emissive_texture: slot(3),
        ..Material::default()
    };
    let texels = vec![[200; 4]; SIDE * SIDE];
    let image = TextureImage { width: SIDE, height: SIDE, texels, ..TextureImage::default() };
    let scene = Scene { materials: vec![material], images: vec![image; 4], ..Scene::default() };
    let mut library = SurfaceLibrary::new(&scene);
    for texture in 0..library.textures() {
        library.set_texels(texture, &texels_of(texture));
    }
    library
}

fn texels_of(texture: usize) -> Vec<[f32; 4]> {
    let value = |i: usize, c: usize| 0.15 + 0.7 * ((7 * i + 5 * c + 3 * texture) % 11) as f32 / 11.0;
    (0..SIDE * SIDE).map(|i| [0, 1, 2].map(|c| value(i, c))).map(|[r, g, b]| [r, g, b, 1.0]).collect()
}

const GRADIENT: SampleGradient = SampleGradient {
    base_color: vec3(0.3, -1.1, 0.8),
    roughness: -0.9,
    metallic: 1.3,
    normal: vec3(0.6, -0.4, 0.2),
    emissive: vec3(-0.5, 0.7, 0.25),
};

/// What the gradients are of: the sample times [`GRADIENT`], summed over places.
fn value(library: &SurfaceLibrary) -> f64 {
    let at = |[u, v]: [f32; 2]| {
        let s = library.lookup(0, vec2(u, v), vec2(0.0, 0.0), TINT, None);
        let g = GRADIENT;
        let dot = |a: Vec3f, b: Vec3f| f64::from(a.dot(b));
        dot(s.base_color, g.base_color)
            + dot(s.normal, g.normal)
            + dot(s.emissive, g.emissive)
            + f64::from(s.roughness * g.roughness + s.metallic * g.metallic)
    };
    PLACES.into_iter().map(at).sum()
}

#[derive(Default)]
struct Sums {
    /// Base colour, roughness, metalness, emission.
    factors: [f32; 8],
    texels: std::collections::BTreeMap<(usize, usize), Vec3f>,
}

impl SampleSink for Sums {
    fn factors(&mut self, base_color: Vec3f, roughness: f32, metallic: f32, emissive: Vec3f) {
        let ([r, g, b], [x, y, z]) = (base_color.to_array(), emissive.to_array());
        let all = [r, g, b, roughness, metallic, x, y, z];
        self.factors.iter_mut().zip(all).for_each(|(sum, x)| *sum += x);
    }

    fn texel(&mut self, texture: usize, texel: usize, gradient: Vec3f) {
        let sum = self.texels.entry((texture, texel)).or_insert(Vec3f::zero());
        *sum += gradient;
    }
}

fn sums(library: &SurfaceLibrary) -> Sums {
    let mut sums = Sums::default();
    for [u, v] in PLACES {
        library.lookup_vjp(0, [vec2(u, v), vec2(0.0, 0.0)], TINT, &GRADIENT, &mut sums);
    }
    sums
}

/// Central difference of [`value`] over a step of 2 `h`.
fn difference(change: impl Fn(&mut SurfaceLibrary, f32), h: f32) -> f64 {
    let at = |h: f32| {
        let mut library = library();
        change(&mut library, h);
        value(&library)
    };
    (at(h) - at(-h)) / (2.0 * f64::from(h))
}

#[test]
fn factors_have_the_gradients_of_differences() {
    let found = sums(&library()).factors;
    for (k, found) in found.into_iter().enumerate() {
        let change = |library: &mut SurfaceLibrary, h: f32| {
            let mut f: SurfaceSample = library.factors(0);
            let (mut base, mut glow) = (f.base_color.to_array(), f.emissive.to_array());
            match k {
                0..=2 => base[k] += h,
                3 => f.roughness += h,
                4 => f.metallic += h,
                _ => glow[k - 5] += h,
            }
            (f.base_color, f.emissive) = (Vec3f::from_array(base), Vec3f::from_array(glow));
            library.set_factors(0, &f);
        };
        let wanted = difference(change, 0.05);
        assert!((f64::from(found) - wanted).abs() < 1e-4 * (1.0 + wanted.abs()), "{k}: {found} {wanted}");
        assert!(wanted.abs() > 0.05, "{k}: {wanted}");
    }
}

#[test]
fn texels_have_the_gradients_of_differences() {
    let (first, found) = (library(), sums(&library()));
    let mut seen = [0; 4];
    for (kind, map) in [MapKind::BaseColor, MapKind::MetallicRoughness, MapKind::Normal, MapKind::Emissive]
        .into_iter()
        .enumerate()
    {
        let texture = first.texture_of(0, map).expect("a texture of each");
        for texel in 0..SIDE * SIDE {
            let found = found.texels.get(&(texture, texel)).copied().unwrap_or(Vec3f::zero()).to_array();
            for (c, found) in found.into_iter().enumerate() {
                let change = |library: &mut SurfaceLibrary, h: f32| {
                    let mut texels = texels_of(texture);
                    texels[texel][c] += h;
                    library.set_texels(texture, &texels);
                };
                // All but normals are linear.
                let (h, most) = if map == MapKind::Normal { (5e-3, 2e-3) } else { (0.05, 1e-4) };
                let wanted = difference(change, h);
                let error = (f64::from(found) - wanted).abs();
                assert!(error < most * (1.0 + wanted.abs()), "{map:?} {texel} {c}: {found} {wanted}");
                seen[kind] += usize::from(wanted.abs() > 1e-3);
            }
        }
    }
    // Three places of four texels each, some of them the same; roughness and metalness are two channels of three.
    assert!(seen.iter().all(|n| *n >= 14), "{seen:?}");
}
