//! Known values of the lookup.

use super::*;
use crate::{Filter, Material, Sampler, TextureImage, TextureSlot, Wrap};
use photofit_scalar::{vec2, vec4};

const WHITE: Vec4f = vec4(1.0, 1.0, 1.0, 1.0);

fn image(width: usize, height: usize, texel: impl Fn(usize, usize) -> [u8; 4]) -> TextureImage {
    let texels =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
    TextureImage { width, height, texels, ..TextureImage::default() }
}

fn slot(image: usize, filter: Filter) -> TextureSlot {
    TextureSlot { sampler: Sampler { filter, ..Sampler::default() }, ..TextureSlot::new(image) }
}

fn scene(material: Material, images: Vec<TextureImage>) -> Scene {
    Scene { materials: vec![material], images, ..Scene::default() }
}

fn at(library: &SurfaceLibrary, u: f32, v: f32) -> SurfaceSample {
    library.lookup(0, vec2(u, v), vec2(0.0, 0.0), WHITE, None)
}

#[test]
fn constant_materials_need_no_texture() {
    let library = SurfaceLibrary::new(&scene(Material::clay(), vec![]));
    assert!(library.is_constant(0) && library.is_opaque(0));
    let s = library.lookup(0, vec2(f32::NAN, 3.0), vec2(0.0, 0.0), vec4(0.5, 1.0, 1.0, 0.1), None);
    assert_eq!(s.base_color, vec3(0.25, 0.5, 0.5));
    assert_eq!((s.alpha, s.roughness, s.metallic), (1.0, 0.5, 0.0));
    assert_eq!(library.bytes(), 0);
}

#[test]
fn base_colour_is_decoded_and_multiplied() {
    let checker = image(2, 2, |x, y| if (x + y) % 2 == 0 { [255, 188, 0, 128] } else { [0; 4] });
    let material = Material {
        base_color: [0.5, 1.0, 1.0, 1.0],
        base_color_texture: Some(slot(0, Filter::Bilinear)),
        alpha_mode: AlphaMode::Blend,
        ..Material::default()
    };
    let library = SurfaceLibrary::new(&scene(material, vec![checker]));
    let s = at(&library, 0.25, 0.25);
    assert!((s.base_color - vec3(0.5, photofit_image::srgb_u8_to_linear(188), 0.0)).length() < 1e-6, "{s:?}");
    assert!((s.alpha - 128.0 / 255.0).abs() < 1e-6);
    // Halfway between four texels, in linear light.
    let s = at(&library, 0.5, 0.5);
    assert!((s.base_color.x - 0.25).abs() < 1e-6, "{s:?}");
    assert!((library.alpha(0, vec2(0.5, 0.5), vec2(0.0, 0.0), 1.0) - s.alpha).abs() < 1e-6);
}

#[test]
fn masks_are_zero_or_one() {
    let ramp = image(4, 1, |x, _| [255, 255, 255, (x * 85) as u8]);
    let material = Material {
        base_color_texture: Some(slot(0, Filter::Nearest)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        ..Material::default()
    };
    let library = SurfaceLibrary::new(&scene(material, vec![ramp]));
    let alphas: Vec<f32> = (0..4).map(|x| at(&library, (x as f32 + 0.5) / 4.0, 0.5).alpha).collect();
    assert_eq!(alphas, [0.0, 0.0, 1.0, 1.0]);
}

#[test]
fn channels_of_the_other_maps() {
    let texel = [255, 128, 0, 255];
    let material = Material {
        roughness: 0.5,
        metallic_roughness_texture: Some(slot(0, Filter::Trilinear)),
        normal_texture: Some(slot(0, Filter::Trilinear)),
        normal_scale: 0.5,
        emissive: [2.0, 2.0, 2.0],
        emissive_texture: Some(slot(0, Filter::Trilinear)),
        ..Material::default()
    };
    let library = SurfaceLibrary::new(&scene(material, vec![image(8, 8, |_, _| texel)]));
    let s = at(&library, 0.3, 0.7);
    assert!((s.roughness - 0.5 * 128.0 / 255.0).abs() < 1e-6 && s.metallic == 0.0, "{s:?}");
    let n = vec3(0.5, 0.5 * (2.0 * 128.0 / 255.0 - 1.0), -1.0).normalize_or_zero();
    assert!((s.normal - n).length() < 1e-6, "{s:?}");
    assert!(
        (s.emissive - vec3(2.0, 2.0 * photofit_image::srgb_u8_to_linear(128), 0.0)).length() < 1e-6,
        "{s:?}"
    );
    // One size, one sampler: one set of taps for all; two encodings of one image.
    assert_eq!(library.materials[0].addresses.len(), 1);
    assert_eq!(library.textures.len(), 2);
}

#[test]
fn footprints_choose_the_level() {
    // Columns of black and white: every level below the base is grey.
    let columns = image(16, 16, |x, _| if x % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
    let material =
        Material { metallic_roughness_texture: Some(slot(0, Filter::Trilinear)), ..Material::default() };
    let library = SurfaceLibrary::new(&scene(material, vec![columns]));
    let rough = |texels: f32| {
        let d = texels / 16.0;
        let f = UvDerivatives::same(vec2(d, 0.0), vec2(0.0, d));
        library.lookup(0, vec2(0.5 / 16.0, 0.5), vec2(0.0, 0.0), WHITE, Some(&f)).roughness
    };
    assert!((rough(0.5) - 1.0).abs() < 1e-6, "magnified: the base level");
    assert!((rough(2.0) - 128.0 / 255.0).abs() < 1e-6, "two texels a pixel: level 1");
    let between = 0.5 + 0.5 * 128.0 / 255.0;
    assert!((rough(2.0_f32.sqrt()) - between).abs() < 1e-5, "half way: {}", rough(2.0_f32.sqrt()));
    assert!((rough(1e9) - 128.0 / 255.0).abs() < 1e-6, "beyond the chain: the last level");
    assert!((rough(f32::NAN) - 1.0).abs() < 1e-6, "no number: the base level");
}

#[test]
fn transforms_sets_and_wraps_are_obeyed() {
    let ramp = image(4, 1, |x, _| [(x * 60) as u8; 4]);
    let mut s = slot(0, Filter::Nearest);
    s.tex_coord = 1;
    s.sampler.wrap_u = Wrap::MirroredRepeat;
    // u' = v + 1: reads the mirrored period.
    s.transform = [[0.0, 1.0, 1.0], [0.0, 0.0, 0.5]];
    let material = Material { metallic_roughness_texture: Some(s), ..Material::default() };
    let library = SurfaceLibrary::new(&scene(material, vec![ramp]));
    let r = library.lookup(0, vec2(0.9, 0.9), vec2(0.3, 0.125), WHITE, None).roughness;
    assert!((r - 180.0 / 255.0).abs() < 1e-6, "{r}");
}

#[test]
fn unlit_reads_the_base_colour_only() {
    let material = Material {
        unlit: true,
        emissive: [1.0; 3],
        base_color_texture: Some(slot(0, Filter::Trilinear)),
        normal_texture: Some(slot(0, Filter::Trilinear)),
        ..Material::default()
    };
    let library = SurfaceLibrary::new(&scene(material, vec![image(2, 2, |_, _| [255, 0, 0, 255])]));
    let s = at(&library, 0.1, 0.1);
    assert!(s.unlit && s.emissive == Vec3f::zero() && s.normal.z == 1.0 && s.base_color.x == 1.0, "{s:?}");
    assert!(!library.has_normal_map(0));
}

#[test]
fn one_texture_is_replaced_alone() {
    let material = Material {
        base_color_texture: Some(slot(0, Filter::Trilinear)),
        emissive: [1.0; 3],
        emissive_texture: Some(slot(0, Filter::Trilinear)),
        metallic_roughness_texture: Some(slot(1, Filter::Trilinear)),
        alpha_mode: AlphaMode::Blend,
        ..Material::default()
    };
    let images = vec![image(4, 4, |_, _| [255, 0, 0, 255]), image(2, 2, |_, _| [0, 255, 255, 255])];
    let mut library = SurfaceLibrary::new(&scene(material, images));
    let before = at(&library, 0.4, 0.6);
    let base = library.texture_of(0, MapKind::BaseColor).unwrap();
    // One image, but its alpha is coverage in the base colour alone: another texture.
    assert_ne!(Some(base), library.texture_of(0, MapKind::Emissive));
    assert_eq!(library.texture_of(0, MapKind::Normal), None);
    library.set_texels(base, &[[0.1, 7.5, -1.0, 0.25]; 16]);
    assert_eq!(library.texture(base).linear_base(), [[0.1, 7.5, -1.0, 0.25]; 16]);
    let far = UvDerivatives::same(vec2(1.0, 0.0), vec2(0.0, 1.0));
    for footprint in [None, Some(&far)] {
        let s = library.lookup(0, vec2(0.4, 0.6), vec2(0.0, 0.0), WHITE, footprint);
        assert!((s.base_color - vec3(0.1, 7.5, -1.0)).length() < 1e-5, "{s:?}");
        assert!((s.alpha - 0.25).abs() < 1e-6);
        assert_eq!(
            (s.emissive, s.roughness, s.metallic),
            (before.emissive, before.roughness, before.metallic)
        );
    }
    assert!((library.alpha(0, vec2(0.4, 0.6), vec2(0.0, 0.0), 1.0) - 0.25).abs() < 1e-6);
}

#[test]
fn points_looked_up_together_are_those_looked_up_one_by_one() {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let noise: Vec<u8> = (0..4 * 256).map(|_| (255.0 * random()) as u8).collect();
    let noisy = |x: usize, y: usize| {
        let at = 4 * (y * 16 + x);
        [noise[at], noise[at + 1], noise[at + 2], noise[at + 3]]
    };
    let turned = |filter| TextureSlot {
        tex_coord: 1,
        transform: [[1.5, 0.3, 0.1], [-0.2, 1.2, 0.4]],
        ..slot(0, filter)
    };
    let material = Material {
        base_color_texture: Some(slot(0, Filter::Trilinear)),
        metallic_roughness_texture: Some(turned(Filter::Trilinear)),
        normal_texture: Some(slot(0, Filter::Trilinear)),
        emissive_texture: Some(turned(Filter::Nearest)),
        emissive: [1.0, 0.5, 0.25],
        alpha_mode: AlphaMode::Blend,
        ..Material::default()
    };
    let library = SurfaceLibrary::new(&scene(material, vec![image(16, 16, noisy)]));
    for n in [8, 8, 8, 3] {
        let mut fill =
            |scale: f32| [[0.0; 8]; 4].map(|c: [f32; 8]| c.map(|_| scale * (2.0 * random() - 1.0)));
        let packet = SurfacePacket { uv: fill(2.0), dx: fill(0.2), dy: fill(0.2), color: fill(1.0) };
        let mut together = [library.factors(0); 8];
        library.lookup_packet(0, &packet, n, &mut together);
        for l in 0..n {
            let of = |c: &[[f32; 8]; 4]| c.map(|c| c[l]);
            let [u0, v0, u1, v1] = of(&packet.uv);
            let pairs = |[a, b, c, d]: [f32; 4]| [vec2(a, b), vec2(c, d)];
            let footprint = UvDerivatives { dx: pairs(of(&packet.dx)), dy: pairs(of(&packet.dy)) };
            let color = Vec4f::from_array(of(&packet.color));
            let alone = library.lookup(0, vec2(u0, v0), vec2(u1, v1), color, Some(&footprint));
            assert_eq!(together[l], alone, "point {l}");
        }
    }
}

#[test]
fn data_of_16_bits_keep_their_steps() {
    const WIDTH: usize = 1024;
    // Roughness and metalness in steps of an eighth of those of 8 bits, in a file.
    let ramp: Vec<u16> =
        (0..WIDTH).flat_map(|x| [0, 20_000 + 32 * x as u16, 60_000 - 32 * x as u16]).collect();
    let png = photofit_image::encode_png16(WIDTH, 1, 3, &ramp, photofit_image::PngCompression::Fast).unwrap();
    let image = TextureImage { encoded: Some(png.into()), ..TextureImage::default() }.read_again().unwrap();
    let material = Material {
        metallic_roughness_texture: Some(slot(0, Filter::Nearest)),
        base_color_texture: Some(slot(0, Filter::Nearest)),
        metallic: 1.0,
        roughness: 1.0,
        ..Material::default()
    };
    let steps = |image: &TextureImage| {
        let library = SurfaceLibrary::new(&scene(material.clone(), vec![image.clone()]));
        let of = |x: usize| at(&library, (x as f32 + 0.5) / WIDTH as f32, 0.5);
        (0..WIDTH).map(of).collect::<Vec<_>>()
    };
    let distinct = |samples: &[SurfaceSample]| {
        samples.windows(2).filter(|w| w[0].roughness != w[1].roughness).count() + 1
    };
    let read = steps(&image);
    assert_eq!(distinct(&read), WIDTH);
    for (x, s) in read.iter().enumerate() {
        let wanted = [20_000.0 + 32.0 * x as f32, 60_000.0 - 32.0 * x as f32].map(|v| v / 65535.0);
        assert!(
            (s.roughness - wanted[0]).abs() < 1e-6 && (s.metallic - wanted[1]).abs() < 1e-6,
            "{x}: {s:?}"
        );
    }
    // Without them there are the steps of 8 bits.
    let eight = TextureImage { texels16: Vec::new(), ..image.clone() };
    assert!(distinct(&steps(&eight)) < 140, "{}", distinct(&steps(&eight)));
    // Written without the file that was read, and read again: the same.
    let written = scene(material, vec![TextureImage { encoded: None, ..image.clone() }]);
    let again = written.stored_as(0, crate::TextureEncoding::Png).unwrap();
    assert_eq!((&again.texels16, &again.texels), (&image.texels16, &image.texels));
    let lossy = written.stored_as(0, crate::TextureEncoding::WebP).unwrap();
    assert!(lossy.texels16.is_empty() && lossy.texels == image.texels);
}
