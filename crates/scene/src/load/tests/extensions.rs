//! Extensions of materials, lights and cameras with known results.

use super::gltf::{Builder, triangle};
use super::{png, refused};
use crate::surface::SurfaceLibrary;
use crate::{Extensions, LightKind, Scene, Volume};
use photofit_scalar::{Vec4f, vec2, vec3};
use photofit_shading::bsdf::{Bsdf, Energy, TransportMode};
use serde_json::{Value, json};
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, LN_2};

/// A triangle whose material has these extensions, with one texture.
fn with_material(extensions: Value) -> Builder {
    let mut b = triangle();
    let view = b.view(&png(1, 1, [51, 102, 204, 153]));
    b.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    b.json["textures"] = json!([{"source": 0}]);
    b.json["materials"] = json!([{"name": "glass", "extensions": extensions}]);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    b
}

fn extensions(scene: &Scene) -> &Extensions {
    scene.materials[0].extensions.as_deref().expect("the material has extensions")
}

#[test]
fn plain_materials_have_no_extensions() {
    let scene = with_material(json!({"KHR_materials_ior": {"ior": 1.5}, "KHR_materials_unlit": {}})).load();
    assert_eq!(scene.materials[0].extensions, None, "the default index of refraction changes nothing");
    assert!(!SurfaceLibrary::new(&scene).has_extensions(0));
}

#[test]
fn defaults_are_those_of_the_specifications() {
    let names = ["specular", "transmission", "volume", "clearcoat", "sheen", "anisotropy"];
    let all: serde_json::Map<String, Value> =
        names.iter().map(|n| (format!("KHR_materials_{n}"), json!({}))).collect();
    let scene = with_material(Value::Object(all)).load();
    assert_eq!(scene.warnings, Vec::<String>::new());
    let e = extensions(&scene);
    assert_eq!(e.names(), names);
    let specular = e.specular.as_ref().unwrap();
    assert_eq!((specular.factor, specular.color), (1.0, [1.0; 3]));
    assert_eq!(e.volume, Some(Volume::default()));
    assert_eq!(e.volume.as_ref().unwrap().absorption(), [0.0; 3]);
    assert_eq!(e.clearcoat.as_ref().unwrap().factor, 0.0);
    let library = SurfaceLibrary::new(&scene);
    let sample = library.extensions(0, vec2(0.0, 0.0), vec2(0.0, 0.0), None).unwrap();
    assert_eq!(sample, crate::ExtensionSample::default());
}

#[test]
fn values_and_textures_of_all_extensions_are_read() {
    let t = json!({"index": 0});
    let mut b = with_material(json!({
        "KHR_materials_ior": {"ior": 1.33},
        "KHR_materials_specular": {
            "specularFactor": 0.5, "specularTexture": t,
            "specularColorFactor": [2.0, 1.0, 0.5], "specularColorTexture": t,
        },
        "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": t},
        "KHR_materials_volume": {
            "thicknessFactor": 2.0, "thicknessTexture": t,
            "attenuationDistance": 4.0, "attenuationColor": [0.5, 1.0, 0.0],
        },
        "KHR_materials_clearcoat": {
            "clearcoatFactor": 0.5, "clearcoatTexture": t,
            "clearcoatRoughnessFactor": 0.25, "clearcoatRoughnessTexture": t,
            "clearcoatNormalTexture": {"index": 0, "scale": 0.0},
        },
        "KHR_materials_sheen": {
            "sheenColorFactor": [1.0, 0.5, 0.25], "sheenColorTexture": t,
            "sheenRoughnessFactor": 0.5, "sheenRoughnessTexture": t,
        },
        "KHR_materials_anisotropy": {
            "anisotropyStrength": 0.5, "anisotropyRotation": FRAC_PI_2,
            "anisotropyTexture": {
                "index": 0, "texCoord": 1,
                "extensions": {"KHR_texture_transform": {"offset": [0.25, 0.5]}},
            },
        },
    }));
    b.json["extensionsRequired"] = json!(["KHR_materials_volume", "KHR_materials_transmission"]);
    let scene = b.load();
    let e = extensions(&scene);
    assert_eq!(e.textures().count(), 10);
    assert_eq!(e.names().len(), 7);
    let slot = e.anisotropy.as_ref().unwrap().texture.unwrap();
    assert_eq!((slot.tex_coord, slot.transform[1][2]), (1, 0.5));
    let [r, g, _] = e.volume.as_ref().unwrap().absorption();
    assert!((r - LN_2 / 4.0).abs() < 1e-6 && g == 0.0, "{r} {g}");

    let library = SurfaceLibrary::new(&scene);
    let uv = vec2(0.3, 0.6);
    let s = library.extensions(0, uv, uv, None).unwrap();
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
    let srgb = photofit_image::srgb_u8_to_linear;
    near(s.ior, 1.33);
    near(s.specular, 0.5 * 0.6); // alpha
    near(s.specular_color.x, 2.0 * srgb(51));
    near(s.specular_color.z, 0.5 * srgb(204));
    near(s.transmission, 0.75 * 0.2); // red
    assert!(s.volume);
    near(s.thickness, 2.0 * 0.4); // green
    near(s.clearcoat, 0.5 * 0.2); // red
    near(s.clearcoat_roughness, 0.25 * 0.4); // green
    assert_eq!(s.clearcoat_normal, vec3(0.0, 0.0, 1.0), "a scale of 0 flattens");
    near(s.sheen_color.y, 0.5 * srgb(102));
    near(s.sheen_roughness, 0.5 * 0.6); // alpha
    near(s.anisotropy, 0.5 * 0.8); // blue
    // The texture says (-0.6, -0.2); a quarter turn from the tangent to the bitangent makes (0.2, -0.6).
    let length = 0.2_f32.hypot(0.6);
    near(s.anisotropy_direction[0], 0.2 / length);
    near(s.anisotropy_direction[1], -0.6 / length);

    let surface = library.lookup(0, uv, uv, Vec4f::splat(1.0), None);
    let p = s.parameters(&surface, vec3(0.0, 0.0, 1.0), Energy::Single, TransportMode::Radiance);
    assert_eq!((p.ior, p.transmission, p.roughness), (s.ior, s.transmission, 1.0));
    assert!(matches!(p.bsdf(), Bsdf::Gltf(_)));
}

#[test]
fn bad_values_are_refused_with_the_name_of_the_material() {
    for (extension, value, word) in [
        ("ior", json!({"ior": 0.9}), "must be at least 1"),
        ("ior", json!({"ior": -1.0}), "must be at least 1"),
        ("ior", json!({"ior": "high"}), "must be at least 1"),
        ("ior", json!(3), "is no object"),
        ("specular", json!({"specularFactor": 1.5}), "specularFactor is 1.5; it must lie in [0, 1]"),
        ("specular", json!({"specularColorFactor": [1.0, -0.5, 1.0]}), "not negative"),
        ("specular", json!({"specularColorFactor": [1.0, 1e39, 1.0]}), "not negative"),
        ("transmission", json!({"transmissionFactor": -0.1}), "lie in [0, 1]"),
        ("transmission", json!({"transmissionFactor": null}), "lie in [0, 1]"),
        ("volume", json!({"thicknessFactor": -1.0}), "thicknessFactor is -1.0; it must be not negative"),
        ("volume", json!({"attenuationDistance": 0.0}), "attenuationDistance is 0.0; it must be positive"),
        ("volume", json!({"attenuationColor": [1.0, 0.5]}), "three channels"),
        ("clearcoat", json!({"clearcoatRoughnessFactor": 2.0}), "clearcoatRoughnessFactor"),
        ("clearcoat", json!({"clearcoatTexture": {"index": 7}}), "texture 7; there are 1"),
        ("clearcoat", json!({"clearcoatTexture": {}}), "clearcoatTexture.index"),
        (
            "clearcoat",
            json!({"clearcoatNormalTexture": {"index": 0, "scale": 1e39}}),
            "clearcoatNormalTexture.scale is 1e+39; it must be finite",
        ),
        ("sheen", json!({"sheenColorFactor": [2.0, 0.0, 0.0]}), "lie in [0, 1]"),
        ("sheen", json!({"sheenRoughnessFactor": "x"}), "sheenRoughnessFactor"),
        (
            "anisotropy",
            json!({"anisotropyStrength": 1.01}),
            "anisotropyStrength is 1.01; it must lie in [0, 1]",
        ),
        (
            "anisotropy",
            json!({"anisotropyRotation": 1e300}),
            "anisotropyRotation is 1e+300; it must be finite",
        ),
    ] {
        let b = with_material(json!({format!("KHR_materials_{extension}"): value}));
        let name =
            if word.starts_with("texture 7") || word.contains(".index") { "material 0" } else { "`glass`" };
        refused(&[("a.glb", &b.glb())], &["material 0", name, word]);
    }
    // The same for the core values.
    let mut b = with_material(json!({}));
    b.json["materials"][0]["pbrMetallicRoughness"] = json!({"roughnessFactor": 7.0});
    refused(&[("a.glb", &b.glb())], &["material 0 `glass`", "lie in [0, 1]"]);
}

/// A triangle and nodes with these lights, turned to shine along -x from (1, 2, 3).
fn with_lights(lights: Value) -> Builder {
    let mut b = triangle();
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let count = lights.as_array().map_or(0, Vec::len);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
    let first = b.json["nodes"].as_array().map_or(0, Vec::len);
    for i in 0..count {
        let node = json!({
            "translation": [1.0, 2.0, 3.0], "rotation": [0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2],
            "scale": [2.0, 2.0, 2.0], "extensions": {"KHR_lights_punctual": {"light": i}},
        });
        b.json["nodes"].as_array_mut().unwrap().push(node);
        b.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(first + i));
    }
    b
}

#[test]
fn lights_are_placed_and_keep_their_units() {
    let scene = with_lights(json!([
        {"name": "sun", "type": "directional", "color": [1.0, 0.5, 0.25], "intensity": 100000.0},
        {"type": "point", "intensity": 80.0, "range": 5.0},
        {"type": "spot", "spot": {}},
        {"type": "spot", "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}},
    ]))
    .load();
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert_eq!(scene.lights.len(), 4);
    for light in &scene.lights {
        assert_eq!(light.position, glam::vec3(1.0, 2.0, 3.0));
        assert!((light.direction - glam::Vec3::NEG_X).length() < 1e-6, "{}", light.direction);
    }
    let [sun, point, spot, narrow] = scene.lights.as_slice() else { panic!("four lights") };
    assert_eq!((sun.name.as_str(), sun.kind), ("sun", LightKind::Directional));
    assert_eq!(sun.intensity, [100_000.0, 50_000.0, 25_000.0], "lux, as in the file");
    assert_eq!((point.kind, point.range, point.intensity), (LightKind::Point, Some(5.0), [80.0; 3]));
    assert_eq!(spot.kind, LightKind::Spot { inner: 0.0, outer: FRAC_PI_4 });
    assert_eq!(narrow.kind, LightKind::Spot { inner: 0.25, outer: 0.5 });
    // Halfway between the cosines of the cones the ramp is one half, squared.
    let middle = 0.5 * (0.25_f32.cos() + 0.5_f32.cos());
    assert!((narrow.attenuation(middle) - 0.25).abs() < 1e-5);
    assert_eq!(point.attenuation(-1.0), 1.0);
}

#[test]
fn bad_lights_are_refused() {
    for (light, word) in [
        (json!({"type": "area"}), "type is"),
        (json!({}), "type is"),
        (json!({"type": "point", "intensity": -1.0}), "it must be finite and not negative"),
        (json!({"type": "point", "intensity": 1e39}), "it must be finite and not negative"),
        (json!({"type": "point", "color": [1.0, 2.0]}), "three channels"),
        (json!({"type": "point", "color": [1.0, 2.0, null]}), "color.2"),
        (json!({"type": "point", "color": [3e38, 1.0, 1.0], "intensity": 10.0}), "color times intensity"),
        (json!({"type": "point", "range": 0.0}), "range is 0.0"),
        (json!({"type": "spot", "spot": {"outerConeAngle": 3.0}}), "outerConeAngle"),
        (json!({"type": "spot", "spot": {"innerConeAngle": 0.9, "outerConeAngle": 0.5}}), "innerConeAngle"),
    ] {
        refused(&[("a.glb", &with_lights(json!([light])).glb())], &["light 0", word]);
    }
    let mut b = with_lights(json!([{"type": "point"}]));
    let last = b.json["nodes"].as_array().unwrap().len() - 1;
    b.json["nodes"][last]["extensions"]["KHR_lights_punctual"]["light"] = json!(9);
    refused(&[("a.glb", &b.glb())], &["light 9", "there are 1 lights"]);
    b.json["nodes"][last]["extensions"]["KHR_lights_punctual"]["light"] = json!("first");
    refused(&[("a.glb", &b.glb())], &["the JSON"]);
    let mut b = with_lights(json!([{"type": "point"}]));
    b.json["nodes"][last]["translation"] = json!([1e30, 0.0, 0.0]);
    refused(&[("a.glb", &b.glb())], &["light", "at most 1e15"]);
}

#[test]
fn orthographic_cameras_are_named_as_left_out() {
    let mut b = triangle();
    b.json["cameras"] = json!([
        {"type": "orthographic", "orthographic": {"xmag": 1.0, "ymag": 1.0, "znear": 0.1, "zfar": 10.0}},
        {"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 1.5, "znear": 0.1}},
    ]);
    let nodes = b.json["nodes"].as_array_mut().unwrap();
    let first = nodes.len();
    nodes.push(json!({"camera": 0}));
    nodes.push(json!({"camera": 1}));
    let scene_nodes = b.json["scenes"][0]["nodes"].as_array_mut().unwrap();
    scene_nodes.extend([json!(first), json!(first + 1)]);
    let scene = b.load();
    assert_eq!(scene.cameras.len(), 1);
    assert!(scene.warnings.iter().any(|w| w.contains("camera 0")), "{:?}", scene.warnings);
}
