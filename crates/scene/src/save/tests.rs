//! Round trips through `.glb` files.

mod compressed;
mod sixteen_bits;

use super::*;
use crate::graph::Texture;
use crate::{
    AlphaMode, Anisotropy, Clearcoat, Extensions, Filter, Instance, LightKind, LightPicture, Material,
    Primitive, PunctualLight, Sampler, Sheen, Specular, TextureEncoding, TextureImage, TextureSlot,
    Transmission, Volume, Wrap, from_glb, load,
};
use glam::{Affine3A, Mat3A, Quat, Vec3};
use photofit_geometry::Mesh;
use photofit_scalar::{Vec3f, vec2, vec3, vec4};

fn patch() -> Mesh {
    let n = 3;
    let grid = |f: &dyn Fn(f32, f32) -> Vec3f| {
        (0..n * n).map(|i| f((i % n) as f32 / 2.0, (i / n) as f32 / 2.0)).collect::<Vec<_>>()
    };
    let positions = grid(&|x, y| vec3(x, y, 0.1 * x * y));
    Mesh {
        normals: grid(&|x, y| vec3(-0.1 * y, -0.1 * x, 1.0).normalize_or_zero()),
        uvs: grid(&|x, y| vec3(x, 1.0 - y, 0.0)).iter().map(|p| vec2(p.x, p.y)).collect(),
        uvs1: positions.iter().map(|p| vec2(2.0 * p.x, p.y)).collect(),
        tangents: positions.iter().map(|_| vec4(1.0, 0.0, 0.0, -1.0)).collect(),
        colors: positions.iter().map(|p| vec4(p.x, p.y, 0.25, 1.0)).collect(),
        triangles: vec![
            [0, 1, 4],
            [0, 4, 3],
            [1, 2, 5],
            [1, 5, 4],
            [3, 4, 7],
            [3, 7, 6],
            [4, 5, 8],
            [4, 8, 7],
        ],
        positions,
    }
}

fn slot(image: usize, tex_coord: u32) -> TextureSlot {
    TextureSlot {
        image,
        sampler: Sampler {
            wrap_u: Wrap::ClampToEdge,
            wrap_v: Wrap::MirroredRepeat,
            filter: Filter::Bilinear,
        },
        tex_coord,
        transform: load::affine_of_transform([0.25, 0.5], 0.75, [2.0, -0.5]),
    }
}

fn image(name: &str, alpha: u8) -> TextureImage {
    let texels = (0..6).map(|i| [i * 40, 255 - i, 7, if i == 3 { alpha } else { 255 }]).collect();
    TextureImage { name: name.into(), width: 3, height: 2, texels, ..TextureImage::default() }
}

/// A scene that uses every feature that can be written.
fn rich() -> Scene {
    let bare = Mesh {
        positions: vec![vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)],
        normals: vec![vec3(0.0, 0.0, 1.0); 3],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let full = Material {
        name: "full".into(),
        base_color: [0.5, 0.25, 1.0, 0.75],
        base_color_texture: Some(slot(0, 0)),
        metallic: 0.25,
        roughness: 0.5,
        metallic_roughness_texture: Some(slot(1, 1)),
        normal_texture: Some(TextureSlot { transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..slot(1, 0) }),
        normal_scale: 0.5,
        occlusion_texture: Some(TextureSlot { sampler: Sampler::default(), ..slot(1, 0) }),
        occlusion_strength: 0.75,
        emissive: [4.0, 2.0, 0.0],
        emissive_texture: Some(slot(0, 0)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.25 },
        double_sided: true,
        unlit: false,
        extensions: None,
        extras: Some(serde_json::json!({"shop": 7})),
    };
    let unlit =
        Material { name: "unlit".into(), unlit: true, alpha_mode: AlphaMode::Blend, ..Material::clay() };
    let turned = Affine3A::from_scale_rotation_translation(
        Vec3::new(2.0, 2.0, 3.0),
        Quat::from_rotation_y(0.5),
        Vec3::new(1.0, -2.0, 3.0),
    );
    Scene {
        name: "rich".into(),
        primitives: vec![Primitive { mesh: patch(), material: 0 }, Primitive { mesh: bare, material: 1 }],
        instances: vec![
            Instance { primitive: 0, transform: Affine3A::IDENTITY },
            Instance { primitive: 1, transform: turned },
            Instance { primitive: 1, transform: Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)) },
        ],
        materials: vec![full, unlit, Material::default()],
        images: vec![image("colour", 100), image("orm", 255), image("unused", 255)],
        cameras: vec![Camera::look_at(Vec3::new(3.0, 2.0, 1.0), Vec3::ZERO, Vec3::Y, 0.8, 1.5, 0.1, 50.0)],
        ..Scene::default()
    }
}

fn round_trip(scene: &Scene) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rich.glb");
    save_glb(&path, scene).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing but the file is left");
    load(&path).unwrap()
}

#[test]
fn everything_comes_back() {
    let before = rich();
    let after = round_trip(&before);
    assert_eq!(after.name, "rich");
    assert_eq!(after.warnings, Vec::<String>::new());
    assert_eq!(after.primitives[0].mesh.positions, before.primitives[0].mesh.positions);
    let (a, b) = (&after.primitives[0].mesh, &before.primitives[0].mesh);
    assert_eq!((&a.uvs, &a.uvs1, &a.colors, &a.triangles), (&b.uvs, &b.uvs1, &b.colors, &b.triangles));
    assert_eq!(a.tangents, b.tangents);
    assert!(a.normals.iter().zip(&b.normals).all(|(a, b)| (*a - *b).length() < 1e-6), "normals");
    assert_eq!(after.primitives.len(), 2);
    for (a, b) in after.instances.iter().zip(&before.instances) {
        assert_eq!(a.primitive, b.primitive);
        assert!(a.transform.abs_diff_eq(b.transform, 1e-5), "{a:?} {b:?}");
    }
    for (a, b) in after.materials.iter().zip(&before.materials) {
        check_material(a, b, &after, &before);
    }
    let (a, b) = (after.cameras[0], before.cameras[0]);
    assert!(a.view.abs_diff_eq(b.view, 1e-5) && a.fov_y == b.fov_y && a.far == b.far, "{a:?}");
}

fn check_material(a: &Material, b: &Material, after: &Scene, before: &Scene) {
    let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert_eq!(
        (&a.name, a.alpha_mode, a.double_sided, a.unlit),
        (&b.name, b.alpha_mode, b.double_sided, b.unlit)
    );
    assert!(close(&a.base_color, &b.base_color) && close(&a.emissive, &b.emissive), "{a:?}");
    assert!(
        close(
            &[a.metallic, a.roughness, a.normal_scale, a.occlusion_strength],
            &[b.metallic, b.roughness, b.normal_scale, b.occlusion_strength]
        ),
        "{a:?}"
    );
    let pairs: Vec<_> = slots_of(a).into_iter().zip(slots_of(b)).collect();
    for (a, b) in pairs {
        assert_eq!(a.is_some(), b.is_some());
        let (Some(a), Some(b)) = (a, b) else { continue };
        assert_eq!((a.sampler, a.tex_coord), (b.sampler, b.tex_coord));
        assert!(close(a.transform.as_flattened(), b.transform.as_flattened()), "{a:?} {b:?}");
        assert_eq!(after.images[a.image], before.images[b.image]);
    }
}

fn slots_of(m: &Material) -> [Option<TextureSlot>; 5] {
    [
        m.base_color_texture,
        m.metallic_roughness_texture,
        m.normal_texture,
        m.occlusion_texture,
        m.emissive_texture,
    ]
}

#[test]
fn textures_are_stored_as_jpeg_where_that_is_asked_for_and_nothing_shines_through() {
    let mut scene = rich();
    for i in &mut scene.images {
        i.encoding = TextureEncoding::Jpeg { quality: 95 };
    }
    let bytes = to_glb(&scene).unwrap();
    let has = |text: &str| bytes.windows(text.len()).any(|w| w == text.as_bytes());
    assert!(has("image/jpeg") && has("image/png"), "one image of the two has alpha");
    let after = round_trip(&scene);
    for (a, b) in after.images.iter().zip(&scene.images) {
        let opaque = b.texels.iter().all(|t| t[3] == 255);
        for (x, y) in a.texels.iter().zip(&b.texels) {
            let near = (0..3).all(|k| x[k].abs_diff(y[k]) <= 24);
            assert!(if opaque { near && x[3] == 255 } else { x == y }, "{x:?} {y:?}");
        }
    }
}

#[test]
fn shear_is_worked_into_the_vertices() {
    let mut scene = rich();
    let shear =
        Affine3A::from_mat3(Mat3A::from_cols_array(&[1.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, -1.0]).into());
    let flat = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    scene.instances =
        vec![Instance { primitive: 0, transform: shear }, Instance { primitive: 0, transform: flat }];
    let (before, after) = (scene.flatten(), round_trip(&scene).flatten());
    assert_eq!(before.mesh.triangles, after.mesh.triangles);
    for (a, b) in before.mesh.positions.iter().zip(&after.mesh.positions) {
        assert!((*a - *b).length() < 1e-6, "{a:?} {b:?}");
    }
    for (a, b) in before.mesh.normals.iter().zip(&after.mesh.normals) {
        assert!((*a - *b).length() < 1e-5, "{a:?} {b:?}");
    }
    assert_eq!(before.mesh.tangents.len(), after.mesh.tangents.len());
    assert!(before.mesh.tangents.iter().zip(&after.mesh.tangents).all(|(a, b)| a.w == b.w), "handedness");
}

#[test]
fn large_meshes_take_wide_indices() {
    for n in [0xffff_usize, 0x1_0000] {
        let mesh = Mesh {
            positions: (0..n).map(|i| vec3(i as f32, (i % 7) as f32, 0.0)).collect(),
            normals: vec![vec3(0.0, 0.0, 1.0); n],
            triangles: vec![[0, 1, n as u32 - 1]],
            ..Mesh::default()
        };
        let scene = Scene {
            primitives: vec![Primitive { mesh, material: 0 }],
            instances: vec![Instance { primitive: 0, transform: Affine3A::IDENTITY }],
            materials: vec![Material::default()],
            ..Scene::default()
        };
        let after = round_trip(&scene);
        assert_eq!(after.primitives[0].mesh.triangles, scene.primitives[0].mesh.triangles, "{n} vertices");
        assert_eq!(after.primitives[0].mesh.positions.len(), n);
    }
}

#[test]
fn empty_scenes_are_files_too() {
    let after = round_trip(&Scene::default());
    assert_eq!((after.triangle_count(), after.instances.len()), (0, 0));
    assert!(after.bounds().is_none());
}

#[test]
fn broken_scenes_and_paths_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = rich();
    scene.primitives[0].mesh.triangles[0][0] = 99;
    let path = folder.path().join("a.glb");
    let text = save_glb(&path, &scene).unwrap_err().to_string();
    assert!(text.contains("primitive 0") && text.contains("99"), "{text}");
    let mut scene = rich();
    scene.primitives[0].mesh.positions[2].x = f32::NAN;
    assert!(save_glb(&path, &scene).unwrap_err().to_string().contains("finite"));
    let mut scene = rich();
    scene.materials[0].roughness = f32::NAN;
    assert!(save_glb(&path, &scene).unwrap_err().to_string().contains("material 0"));
    let nowhere = folder.path().join("no/such/folder.glb");
    let text = save_glb(&nowhere, &rich()).unwrap_err().to_string();
    assert!(text.contains("folder.glb") && !text.contains('\n'), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
}

#[test]
fn texture_transforms_are_taken_apart() {
    for (offset, rotation, scale) in [
        ([0.0, 0.0], 0.0, [1.0, 1.0]),
        ([0.1, -0.2], 1.2, [2.0, 0.5]),
        ([0.0, 0.0], -2.5, [-1.0, 3.0]),
        ([0.0, 0.0], 0.7, [0.0, 2.0]),
    ] {
        let m = load::affine_of_transform(offset, rotation, scale);
        let (o, r, s) = material::parts(&m).unwrap();
        let again = load::affine_of_transform(o, r, s);
        for (a, b) in m.as_flattened().iter().zip(again.as_flattened()) {
            assert!((a - b).abs() < 1e-5, "{m:?} {again:?}");
        }
    }
    assert!(material::parts(&[[1.0, 0.5, 0.0], [0.0, 1.0, 0.0]]).is_none(), "shear");
}

/// Extensions with every value and slot, on images 0 and 1.
fn extended() -> Extensions {
    let plain = |image| Some(TextureSlot { transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..slot(image, 1) });
    Extensions {
        ior: 1.25,
        specular: Some(Specular {
            factor: 0.5,
            texture: plain(0),
            color: [2.0, 1.0, 0.25],
            color_texture: plain(1),
        }),
        transmission: Some(Transmission { factor: 0.75, texture: plain(0) }),
        volume: Some(Volume {
            thickness: 2.0,
            thickness_texture: plain(1),
            attenuation_distance: 8.0,
            attenuation_color: [0.5, 0.75, 1.0],
        }),
        clearcoat: Some(Clearcoat {
            factor: 0.5,
            texture: plain(0),
            roughness: 0.125,
            roughness_texture: plain(1),
            normal_texture: plain(0),
            normal_scale: 0.5,
        }),
        sheen: Some(Sheen {
            color: [0.25, 0.5, 1.0],
            color_texture: plain(0),
            roughness: 0.5,
            roughness_texture: plain(0),
        }),
        anisotropy: Some(Anisotropy { strength: 0.5, rotation: 0.75, texture: plain(1) }),
    }
}

/// A white picture to be thrown along +z.
fn slide() -> LightPicture {
    LightPicture { texture: Texture::number(1.0), u: Vec3::X, v: Vec3::Y, half: [0.5; 2] }
}

#[test]
fn extensions_and_lights_come_back() {
    let mut before = rich();
    before.materials[0].extensions = Some(Box::new(extended()));
    before.materials[1].extensions = Some(Box::new(Extensions {
        volume: Some(Volume { thickness: 1.0, ..Volume::default() }),
        ..Extensions::default()
    }));
    let light = |kind, direction: Vec3| PunctualLight {
        name: format!("{kind:?}"),
        kind,
        intensity: [10.0, 5.0, 2.5],
        position: Vec3::new(1.0, 2.0, 3.0),
        direction: direction.normalize_or_zero(),
        range: (kind == LightKind::Point).then_some(4.0),
        picture: None,
    };
    before.lights = vec![
        light(LightKind::Directional, Vec3::new(1.0, -2.0, 0.5)),
        light(LightKind::Point, Vec3::NEG_Z),
        light(LightKind::Spot { inner: 0.25, outer: 0.5 }, Vec3::Z),
    ];
    let after = round_trip(&before);
    assert_eq!(after.warnings, Vec::<String>::new());
    for m in 0..2 {
        assert_eq!(after.materials[m].extensions, before.materials[m].extensions);
    }
    assert_eq!(after.lights.len(), 3);
    for (a, b) in after.lights.iter().zip(&before.lights) {
        assert_eq!((&a.name, a.kind, a.intensity, a.range), (&b.name, b.kind, b.intensity, b.range));
        assert!((a.direction - b.direction).length() < 1e-6 && a.position == b.position, "{a:?}");
    }
    // What cannot be written is refused.
    let mut thrown = before.clone();
    thrown.lights[2].picture = Some(slide());
    let text = to_glb(&thrown).unwrap_err().to_string();
    assert!(text.contains("light 2") && text.contains("throws a picture"), "{text}");
    let mut light = Scene::default();
    light.inherit(&thrown);
    assert_eq!((light.lights.len(), thrown.left_out(&light)[0].as_str()), (2, "1 light"));
    before.lights[0].intensity[1] = f32::NAN;
    assert!(to_glb(&before).unwrap_err().to_string().contains("light 0"));
    before.lights.clear();
    before.materials[0].extensions.as_mut().unwrap().ior = f32::INFINITY;
    let text = to_glb(&before).unwrap_err().to_string();
    assert!(text.contains("material 0") && text.contains("KHR_materials_ior: ior is not finite"), "{text}");
}

#[test]
fn a_file_in_memory_must_have_all_of_its_data() {
    let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
    scene.primitives.push(Primitive { mesh: patch(), material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    let bytes = to_glb(&scene).unwrap();
    assert_eq!(from_glb(&bytes).unwrap().triangle_count(), scene.triangle_count());
    let text = from_glb(b"ply").unwrap_err().to_string();
    assert!(text.contains("byte 0") && text.contains("glTF"), "{text}");
    assert!(from_glb(&bytes[..bytes.len() - 4]).is_err());
    // The same with its buffer in another file.
    let json_length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json = std::str::from_utf8(&bytes[20..20 + json_length]).unwrap();
    let mut json = json.replace(r#""buffers":[{"#, r#""buffers":[{"uri":"a.bin","#);
    json += &" ".repeat(json.len().next_multiple_of(4) - json.len());
    let mut outside = bytes[..12].to_vec();
    outside.extend((json.len() as u32).to_le_bytes());
    outside.extend(&bytes[16..20]);
    outside.extend(json.as_bytes());
    outside.extend(&bytes[20 + json_length..]);
    let length = outside.len() as u32;
    outside[8..12].copy_from_slice(&length.to_le_bytes());
    let text = from_glb(&outside).unwrap_err().to_string();
    assert!(text.contains("`a.bin`") && text.contains("from memory"), "{text}");
}

#[test]
fn webp_textures_come_back_exactly() {
    let texels: Vec<[u8; 4]> =
        (0..48_u8).map(|i| [i, 255 - i, i.wrapping_mul(37), 255 - 5 * (i % 2)]).collect();
    let image = TextureImage {
        name: "w".into(),
        width: 8,
        height: 6,
        texels: texels.clone(),
        encoding: TextureEncoding::WebP,
        ..TextureImage::default()
    };
    let material = Material { base_color_texture: Some(slot(0, 0)), ..Material::clay() };
    let mut scene = Scene { materials: vec![material], images: vec![image], ..Scene::default() };
    scene.primitives.push(Primitive { mesh: patch(), material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    save_glb(&path, &scene).unwrap();
    let again = load(&path).unwrap();
    assert_eq!(again.images[0].texels, texels);
    assert!(again.ignored_extensions.is_empty(), "{:?}", again.ignored_extensions);
    let text = std::fs::read(&path).unwrap();
    let text = String::from_utf8_lossy(&text);
    assert!(text.contains(r#""extensionsRequired":["EXT_texture_webp"]"#));
    assert!(text.contains("image/webp"));
}

/// An independent reader finds every level in the written file; sides that are no multiples of 4 stay PNG.
#[test]
fn ktx2_textures_come_back_with_their_levels() {
    let image = |side: usize| TextureImage {
        width: side,
        height: side,
        texels: (0..side * side).map(|i| [(i % side * 255 / side) as u8, 90, 30, 255]).collect(),
        encoding: TextureEncoding::Ktx2 { quality: 100 },
        ..TextureImage::default()
    };
    let material = |k| Material { base_color_texture: Some(slot(k, 0)), ..Material::clay() };
    let mut scene = Scene {
        materials: vec![material(0), material(1)],
        images: vec![image(32), image(6)],
        ..Scene::default()
    };
    for m in 0..2 {
        scene.primitives.push(Primitive { mesh: patch(), material: m });
        scene.instances.push(Instance { primitive: m, transform: Affine3A::IDENTITY });
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    save_glb(&path, &scene).unwrap();
    let again =
        crate::load_with(&path, &crate::Limits { keep_encoded: true, ..crate::Limits::default() }).unwrap();
    assert!(again.ignored_extensions.is_empty(), "{:?}", again.ignored_extensions);
    let near = |a: &[[u8; 4]], b: &[[u8; 4]]| {
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| a.abs_diff(*b) < 5)
    };
    assert!(near(&again.images[0].texels, &scene.images[0].texels));
    assert_eq!(again.images[1].texels, scene.images[1].texels, "a PNG");
    let file = again.images[0].encoded.as_ref().unwrap();
    assert_eq!(photofit_ktx2::level_count(file), Ok(6));
    assert_eq!(photofit_ktx2::decode(file, 5).unwrap().2[0][1..], [90, 30, 255]);
    let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    assert!(text.contains(r#""extensionsRequired":["KHR_texture_basisu"]"#) && text.contains("image/ktx2"));
    assert_eq!(to_glb(&again).unwrap(), to_glb(&again).unwrap());
}

#[test]
fn images_are_what_is_read_again_once_they_are_stored() {
    let texel = |i: usize| {
        let wave = |f: f64| (127.0 + 120.0 * (f * i as f64).sin()) as u8;
        [wave(0.01), wave(0.002), wave(0.0051), 255]
    };
    let (width, height) = (40, 28);
    let image = TextureImage {
        name: "i".into(),
        width,
        height,
        texels: (0..width * height).map(texel).collect(),
        ..TextureImage::default()
    };
    let mut see_through = image.clone();
    see_through.texels[3][3] = 9;
    let error = |a: &TextureImage, b: &TextureImage| {
        let each = a.texels.iter().flatten().zip(b.texels.iter().flatten());
        each.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum::<f64>() / a.texels.len() as f64
    };
    let lossy = [TextureEncoding::Jpeg { quality: 80 }, TextureEncoding::LossyWebP { quality: 80 }];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    for encoding in [TextureEncoding::Png, TextureEncoding::WebP].into_iter().chain(lossy) {
        for (image, opaque) in [(&image, true), (&see_through, false)] {
            let alone = Scene { images: vec![image.clone()], ..Scene::default() };
            let stored = alone.stored_as(0, encoding).unwrap();
            assert_eq!(
                stored.encoding == encoding,
                opaque || !matches!(encoding, TextureEncoding::Jpeg { .. })
            );
            let exact = !lossy.contains(&stored.encoding);
            assert_eq!(stored.texels == image.texels, exact, "{encoding:?}");
            assert!(error(image, &stored) < 300.0, "{encoding:?}: {}", error(image, &stored));
            let material = Material { base_color_texture: Some(slot(0, 0)), ..Material::clay() };
            let mut scene =
                Scene { materials: vec![material], images: vec![stored.clone()], ..Scene::default() };
            scene.primitives.push(Primitive { mesh: patch(), material: 0 });
            scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
            let written = to_glb(&scene).unwrap();
            scene.images[0] = TextureImage { encoding, ..image.clone() };
            assert_eq!(written, to_glb(&scene).unwrap(), "stored or not, the file is the same");
            std::fs::write(&path, &written).unwrap();
            let again = load(&path).unwrap();
            assert_eq!(again.images[0].texels, stored.texels, "{encoding:?}");
        }
    }
}

/// Colours are integers where these hold the same bits, and numbers are written with the fewest digits that give the same float.
#[test]
fn colours_and_numbers_take_few_bytes_and_come_back() {
    for (channel, alpha, component, kind) in [
        (51.0 / 255.0, 1.0, 5121, "VEC4"),
        (1234.0 / 65535.0, 1.0, 5123, "VEC4"),
        (0.123_456_79, 1.0, 5126, "VEC3"),
        (0.123_456_79, 0.25, 5126, "VEC4"),
    ] {
        let color = vec4(channel, 1.0, 0.0, alpha);
        let mesh = Mesh {
            positions: vec![vec3(0.1, 0.2, 0.3), vec3(1.1, 0.0, 0.0), vec3(0.0, 1.7, 0.0)],
            colors: vec![color; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let extras = Some(serde_json::json!({"kept": f64::from(0.1_f32)}));
        let scene = Scene {
            primitives: vec![Primitive { mesh, material: 0 }],
            instances: vec![Instance { primitive: 0, transform: Affine3A::IDENTITY }],
            materials: vec![Material { base_color: [0.8, 0.1, 0.3, 1.0], extras, ..Material::default() }],
            ..Scene::default()
        };
        let bytes = to_glb(&scene).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let text = std::str::from_utf8(&bytes[20..20 + length]).unwrap();
        let json: Value = serde_json::from_str(text).unwrap();
        let accessor = json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize;
        let accessor = &json["accessors"][accessor];
        assert_eq!(
            (accessor["componentType"].as_u64(), accessor["type"].as_str()),
            (Some(component), Some(kind))
        );
        assert_eq!(accessor["normalized"].as_bool().unwrap_or(false), component != 5126);
        assert!(text.contains("[0.8,0.1,0.3,1.0]") && text.contains("[1.1,1.7,0.3]"), "{text}");
        assert!(text.contains("0.10000000149011612"), "application data are as they were: {text}");
        let after = round_trip(&scene);
        assert_eq!(after.primitives[0].mesh.colors, vec![color; 3]);
        assert_eq!(after.primitives[0].mesh.positions, scene.primitives[0].mesh.positions);
        assert_eq!(after.materials, scene.materials);
    }
}
