//! What is kept of a glTF through loading and saving, and what is told of the rest.

use super::gltf::{Builder, push, triangle};
use super::png;
use super::posed::{again, moving};
use crate::{Property, Scene, to_glb};
use photofit_scalar::vec4;
use serde_json::{Value, json};

/// A triangle with texture coordinates and these tangents, of a material with these extensions.
fn tangents(tangents: [[f32; 4]; 3], material: Value) -> Builder {
    let mut b = triangle();
    let uvs = b.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC2", 3);
    let given = b.floats(tangents.as_flattened(), "VEC4", 3);
    let primitive = &mut b.json["meshes"][0]["primitives"][0];
    (primitive["attributes"]["TEXCOORD_0"], primitive["attributes"]["TANGENT"]) = (json!(uvs), json!(given));
    primitive["material"] = json!(0);
    b.json["materials"] = json!([material]);
    b
}

#[test]
fn given_tangents_stay_whatever_the_material_says() {
    // Not those of MikkTSpace, which lie along x.
    let given = [[0.0, 1.0, 0.0, -1.0], [0.6, 0.8, 0.0, 1.0], [-1.0, 0.0, 0.0, 1.0]];
    let anisotropic = json!({"extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}});
    let unlit = json!({"extensions": {"KHR_materials_unlit": {}}});
    for material in [anisotropic.clone(), unlit, json!({})] {
        let scene = tangents(given, material.clone()).load();
        let wanted = given.map(|[x, y, z, w]| vec4(x, y, z, w));
        assert_eq!(scene.primitives[0].mesh.tangents, wanted);
        let after = again(&scene);
        assert_eq!(after.primitives[0].mesh, scene.primitives[0].mesh, "{material}");
        // Instances alone have them where they matter.
        let alone = Scene { hierarchy: None, ..scene };
        let needed = material == anisotropic;
        assert_eq!(again(&alone).primitives[0].mesh.tangents.len(), if needed { 3 } else { 0 }, "{material}");
        assert_eq!(alone.complete_mesh(0).tangents, wanted);
    }
    // Where they are needed and missing, readers find those that this library computes.
    let mut scene = tangents(given, anisotropic).load();
    scene.primitives[0].mesh.tangents.clear();
    assert_eq!(again(&scene).primitives[0].mesh.tangents, [vec4(1.0, 0.0, 0.0, -1.0); 3]);
}

#[test]
fn channels_without_a_node_do_not_hide_the_others() {
    let mut b = moving();
    let pointer = json!({"sampler": 2, "target": {"path": "pointer", "extensions": {
        "KHR_animation_pointer": {"pointer": "/materials/0/alphaCutoff"}}}});
    let channels = b.json["animations"][0]["channels"].as_array_mut().unwrap();
    channels.insert(1, pointer.clone());
    channels.push(json!({"sampler": 0, "target": {"path": "rotation"}}));
    let samplers = b.json["animations"][0]["samplers"].clone();
    push(&mut b.json["animations"], json!({"channels": [pointer], "samplers": samplers}));
    let (scene, plain) = (b.load(), moving().load());
    assert_eq!(scene.ignored_extensions, ["KHR_animation_pointer"]);
    let animations = |s: &Scene| s.hierarchy.as_ref().unwrap().animations.clone();
    assert_eq!(animations(&scene), animations(&plain));
    assert_eq!(animations(&scene)[0].channels[1].property, Property::Translation);
    let told = |part: &str| scene.warnings.iter().filter(|w| w.contains(part)).count();
    assert_eq!(told("animation 0: channels that name no node are ignored: 2"), 1, "{:?}", scene.warnings);
    assert_eq!(told("animation 1: channels that name no node are ignored: 1"), 1, "{:?}", scene.warnings);
    assert_eq!((told("animation 1 moves nothing"), scene.warnings.len()), (1, 4));
    b.json["extensionsUsed"] = json!(["KHR_animation_pointer"]);
    b.json["extensionsRequired"] = json!(["KHR_animation_pointer"]);
    b.refused(&["KHR_animation_pointer", "required"]);
}

/// A textured triangle.
fn textured() -> Builder {
    let mut b = triangle();
    let view = b.view(&png(1, 1, [51, 102, 204, 255]));
    b.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    b.json["samplers"] = json!([{}]);
    b.json["textures"] = json!([{"source": 0, "sampler": 0}]);
    b.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, {}]);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    b
}

#[test]
fn application_data_is_kept_or_counted() {
    let mut b = textured();
    let kept = ["/meshes/0/primitives/0", "/images/0", "/materials/0", "/nodes/0", "/asset", "/scenes/0"];
    let lost = ["/textures/0", "/samplers/0", "/accessors/1", "/materials/1", "/bufferViews/0"];
    for (i, place) in kept.iter().chain(&lost).enumerate() {
        let at = b.json.pointer_mut(place).unwrap();
        // What it holds is no application data of its own.
        at["extras"] = json!({"number": i, "extras": {}, "extensions": {"NOT_one": {"extras": 1}}});
    }
    b.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extras"] = json!([7]);
    let scene = b.load();
    assert_eq!(scene.ignored_extras, lost.len() + 1);
    let told = |s: &Scene, part: &str| s.warnings.iter().filter(|w| w.contains(part)).count();
    assert_eq!((told(&scene, "ignored: 6"), scene.warnings.len()), (1, 1), "{:?}", scene.warnings);
    assert_eq!(scene.ignored_extensions, Vec::<String>::new());
    let lines = scene.left_out(&Scene::default());
    assert!(lines.contains(&"application data (extras) of 10 objects".to_owned()), "{lines:?}");
    let after = again(&scene);
    let found = |s: &Scene| {
        let part = &s.hierarchy.as_ref().unwrap().meshes[0].primitives[0];
        [part.extras.clone(), s.images[0].extras.clone(), s.materials[0].extras.clone()]
    };
    assert_eq!(found(&after), found(&scene));
    let numbers = found(&scene).map(|extras| extras.map_or(Value::Null, |e| e["number"].clone()));
    assert_eq!(numbers, [json!(0), json!(1), json!(2)]);
    assert_eq!((after.ignored_extras, after.warnings.len()), (0, 0));
    assert_eq!(to_glb(&after).unwrap(), to_glb(&scene).unwrap());
}

#[test]
fn extensions_are_found_wherever_they_stand() {
    let mut b = textured();
    b.json["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
    b.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]);
    let places = [
        "",
        "/scenes/0",
        "/meshes/0",
        "/meshes/0/primitives/0",
        "/textures/0",
        "/images/0",
        "/cameras/0",
        "/cameras/0/perspective",
        "/accessors/0",
        "/extensions/KHR_lights_punctual/lights/0",
        "/materials/1",
        "/materials/0/pbrMetallicRoughness/baseColorTexture",
    ];
    for (i, place) in places.iter().enumerate() {
        b.json.pointer_mut(place).unwrap()["extensions"][format!("MY_{i:02}")] = json!({"deeper": [1]});
    }
    let scene = b.load();
    let wanted: Vec<String> = (0..places.len()).map(|i| format!("MY_{i:02}")).collect();
    assert_eq!(scene.ignored_extensions, wanted);
    assert_eq!((scene.warnings.len(), scene.lights.len()), (wanted.len(), 1));
}

#[test]
fn attributes_that_are_not_read_are_listed() {
    let mut b = triangle();
    let four = b.floats(&[0.0; 12], "VEC4", 3);
    let bytes = b.accessor(&[0; 12], 5121, "VEC4", 3);
    let two = b.floats(&[0.0; 6], "VEC2", 3);
    let attributes = &mut b.json["meshes"][0]["primitives"][0]["attributes"];
    for (name, accessor) in [
        ("TEXCOORD_0", two),
        ("TEXCOORD_2", two),
        ("COLOR_0", four),
        ("COLOR_1", four),
        ("JOINTS_0", bytes),
        ("WEIGHTS_0", four),
        ("JOINTS_4", bytes),
        ("WEIGHTS_4", four),
        ("_OWN", two),
    ] {
        attributes[name] = json!(accessor);
    }
    let bare = json!({"attributes": {"POSITION": 0, "TANGENT": four}, "targets": [
        {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": two}, {"COLOR_0": four}]});
    push(&mut b.json["meshes"][0]["primitives"], bare);
    let scene = b.load();
    let wanted = [
        "COLOR_0 of morph targets",
        "COLOR_1",
        "JOINTS_4",
        "NORMAL of morph targets",
        "TANGENT",
        "TEXCOORD_0 of morph targets",
        "TEXCOORD_2",
        "WEIGHTS_4",
        "_OWN",
    ];
    assert_eq!(scene.ignored_attributes, wanted);
    let lines = scene.left_out(&Scene::default());
    assert!(lines.iter().any(|l| l.starts_with("9 vertex attributes (COLOR_0 of morph targets, COLOR_1")));
    assert_eq!(again(&scene).ignored_attributes, Vec::<String>::new());
}
