//! Broken and hostile glTF files.

use super::gltf::{push, triangle};
use super::{png, refused, refused_with};
use crate::Limits;
use photofit_scalar::vec3;
use serde_json::json;

#[test]
fn containers() {
    let good = triangle().glb();
    let mut huge = b"glTF\x02\0\0\0".to_vec();
    huge.extend_from_slice(&u32::MAX.to_le_bytes());
    huge.extend_from_slice(&0xffff_fff0_u32.to_le_bytes());
    huge.extend_from_slice(b"JSON{}");
    assert_eq!(huge.len(), 22, "a tiny file that claims 4 GB");
    refused(&[("bad.glb", &huge)], &["length", "4294967295", "22"]);
    for cut in [4, 11, 12, 18, 30, good.len() - 5] {
        refused(&[("bad.glb", &good[..cut])], &["byte"]);
    }
    let mut version = good.clone();
    version[4] = 1;
    refused(&[("bad.glb", &version)], &["version", "version is 1"]);
    let mut chunk = good.clone();
    chunk[12..16].copy_from_slice(&0x7fff_ffff_u32.to_le_bytes());
    refused(&[("bad.glb", &chunk)], &["chunk", "2147483647"]);
    let mut kind = good.clone();
    kind[16] = b'X';
    refused(&[("bad.glb", &kind)], &["JSON"]);
    let mut text = good;
    text[20] = b'[';
    refused(&[("bad.glb", &text)], &["JSON", "line 1"]);
    refused(&[("bad.gltf", b"{\"asset\": {\"version\": \"1.0\"}}")], &["asset.version", "1.0"]);
    refused(&[("bad.gltf", "{\"a\":".repeat(100_000).as_bytes())], &["JSON"]);
    // However deep what is not read may be, it refuses nothing.
    let deep = format!("{}0{}", "[{\"extensions\":".repeat(10_000), "}]".repeat(10_000));
    let text = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"extras\":0,\"x\":{deep}}}");
    assert_eq!(super::load_files(&[("a.gltf", text.as_bytes())]).unwrap().triangle_count(), 0);
    let text = br#"{"asset":{"version":"2.0"},"x":[1e999]}"#;
    let warnings = super::load_files(&[("a.gltf", &text[..])]).unwrap().warnings;
    assert!(warnings.iter().any(|w| w.contains("cannot be told")), "{warnings:?}");
    let many = Limits { json_items: 100, ..Limits::default() };
    let text = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}{{}}]}}", "{},".repeat(100));
    refused_with(&[("bad.gltf", text.as_bytes())], &many, &["at most 100 objects"]);
}

#[test]
fn accessors_and_views() {
    let check = |change: &dyn Fn(&mut super::gltf::Builder), words: &[&str]| {
        let mut b = triangle();
        change(&mut b);
        b.refused(words);
    };
    check(&|b| b.json["accessors"][0]["count"] = json!(4), &["accessor 0", "bufferView 0"]);
    check(&|b| b.json["accessors"][0]["count"] = json!(4_000_000_000_u64), &["at most", "vertices"]);
    check(&|b| b.json["accessors"][0]["count"] = json!(u64::MAX), &["at most"]);
    check(&|b| b.json["accessors"][0]["byteOffset"] = json!(u64::MAX), &["accessor 0", "byteOffset"]);
    check(&|b| b.json["accessors"][0]["bufferView"] = json!(77), &["bufferView 77"]);
    check(&|b| b.json["accessors"][0]["componentType"] = json!(1), &["accessor 0", "componentType"]);
    check(&|b| b.json["accessors"][0]["type"] = json!("VEC2"), &["accessor 0", "3 components"]);
    check(&|b| b.json["accessors"][0]["type"] = json!("VEC9"), &["accessor 0", "type"]);
    check(&|b| b.json["accessors"][1]["count"] = json!(2), &["NORMAL", "count 3"]);
    check(&|b| b.json["accessors"][2]["componentType"] = json!(5126), &["indices", "unsigned"]);
    check(&|b| b.json["bufferViews"][0]["byteLength"] = json!(1_u64 << 40), &["bufferView 0", "buffer 0"]);
    check(&|b| b.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX), &["bufferView 0"]);
    check(&|b| b.json["bufferViews"][0]["buffer"] = json!(3), &["bufferView 0", "buffer 3"]);
    check(&|b| b.json["bufferViews"][0]["byteStride"] = json!(4), &["byteStride 4"]);
    check(&|b| b.json["bufferViews"][0]["byteStride"] = json!(u64::MAX), &["accessor 0"]);
    check(
        &|b| {
            let zeros = json!({"componentType": 5125, "count": 4_000_000_000_u64, "type": "SCALAR"});
            let i = push(&mut b.json["accessors"], zeros);
            b.json["meshes"][0]["primitives"][0]["indices"] = json!(i);
        },
        &["at most", "triangles"],
    );
}

#[test]
fn sparse_accessors() {
    let sparse = |count: u64, index: u8| {
        let mut b = triangle();
        let indices = b.view(&[0, index]);
        let values = b.view(&[0; 24]);
        b.json["accessors"][0]["sparse"] = json!({
            "count": count,
            "indices": {"bufferView": indices, "componentType": 5121},
            "values": {"bufferView": values},
        });
        b
    };
    assert_eq!(sparse(2, 2).load().triangle_count(), 1);
    sparse(4_000_000_000, 2).refused(&["accessor 0", "sparse.count 4000000000", "count 3"]);
    sparse(3, 2).refused(&["accessor 0", "3 sparse values"]);
    sparse(2, 3).refused(&["accessor 0", "sparse indices"]);
    sparse(2, 0).refused(&["accessor 0", "sparse indices"]);
}

#[test]
fn geometry() {
    let mut b = triangle();
    let at = b.json["bufferViews"][2]["byteOffset"].as_u64().unwrap() as usize;
    b.binary[at + 2] = 3;
    b.refused(&["mesh 0 primitive 0 indices", "index 1 is 3", "3 vertices"]);
    for value in [f32::NAN, f32::INFINITY] {
        let mut b = triangle();
        b.binary[12..16].copy_from_slice(&value.to_le_bytes());
        b.refused(&["POSITION", "element 1", "finite"]);
        let mut b = triangle();
        let at = b.json["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
        b.binary[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let scene = b.load();
        assert_eq!(scene.primitives[0].mesh.normals, [vec3(0.0, 0.0, 1.0); 3], "that of the face");
        assert!(scene.warnings[0].contains("NORMAL: normals without a direction: 1"), "{:?}", scene.warnings);
    }
    let mut b = triangle();
    b.binary[12..16].copy_from_slice(&1e30_f32.to_le_bytes());
    b.refused(&["instance 0", "at most"]);
    let mut b = triangle();
    b.json["meshes"][0]["primitives"][0]["attributes"] = json!({"NORMAL": 1});
    b.refused(&["mesh 0 primitive 0", "POSITION"]);
    let mut b = triangle();
    b.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(50);
    b.refused(&["accessor 50"]);
    let mut b = triangle();
    b.json["meshes"][0]["primitives"][0]["mode"] = json!(9);
    b.refused(&["mode"]);
    let few = Limits { vertices: 2, ..Limits::default() };
    refused_with(&[("bad.glb", &triangle().glb())], &few, &["at most 2 vertices"]);
}

#[test]
fn zero_normals_and_coordinates_that_are_no_numbers_are_repaired() {
    let mut b = triangle();
    let at = b.json["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
    b.binary[at..at + 12].fill(0);
    let t = b.floats(&[f32::NAN, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC2", 3);
    b.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(t);
    let scene = b.load();
    assert_eq!(scene.primitives[0].mesh.normals[0].z, 1.0);
    assert_eq!(scene.primitives[0].mesh.uvs[0].x, 0.0);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
}

#[test]
fn nodes() {
    let with = |nodes: serde_json::Value, words: &[&str]| {
        let mut b = triangle();
        b.json["nodes"] = nodes;
        b.refused(words);
    };
    with(json!([{"children": [0]}]), &["node 0", "cycle"]);
    with(json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}]), &["node 1", "cycle"]);
    with(json!([{"children": [2]}, {"children": [2]}, {"mesh": 0}]), &["node 2", "one parent"]);
    with(json!([{"children": [9]}]), &["node 0", "child 9"]);
    with(json!([{"mesh": 5}]), &["node 0", "mesh 5"]);
    with(json!([{"mesh": 0, "skin": 5}]), &["node 0", "skin 5"]);
    with(json!([{"mesh": 0, "camera": 5}]), &["node 0", "camera 5"]);
    with(json!([{"mesh": 0, "rotation": [0, 0, 0, 0]}]), &["node 0", "rotation"]);
    with(
        json!([{"mesh": 0, "scale": [1e38, 1, 1], "children": [1]}, {"mesh": 0, "scale": [1e38, 1, 1]}]),
        &["finite"],
    );
    let mut b = triangle();
    b.json["scenes"] = json!([{"nodes": [0, 0]}]);
    b.refused(&["scene", "node 0 twice", "list each node once"]);
    b.json["scenes"] = json!([{"nodes": [8]}]);
    b.refused(&["scene", "node 8"]);
    b.json["scene"] = json!(4);
    b.refused(&["scene", "4"]);
}

#[test]
fn extensions() {
    let mut b = triangle();
    b.json["extensionsRequired"] = json!(["EXT_texture_avif"]);
    b.refused(&["extensionsRequired", "EXT_texture_avif", "PNG, JPEG, WebP or KTX 2.0"]);
}

#[test]
fn textures() {
    let textured = |image: serde_json::Value| {
        let mut b = triangle();
        b.json["images"] = json!([image]);
        b.json["textures"] = json!([{"source": 0}]);
        b.json["materials"] = json!([{"normalTexture": {"index": 0}}]);
        b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        b
    };
    textured(json!({"uri": "none.png"})).refused(&["image 0", "none.png"]);
    textured(json!({})).refused(&["image 0", "URI"]);
    textured(json!({"bufferView": 0})).refused(&["image 0", "neither PNG nor JPEG nor WebP nor KTX 2.0"]);
    let mut b = textured(json!({"uri": "a.png"}));
    b.json["textures"] = json!([{"source": 6}]);
    b.refused(&["texture 0", "image 6"]);
    b.json["textures"] = json!([{"extensions": {"EXT_texture_avif": {"source": 0}}}]);
    b.refused(&["texture 0", "source"]);
    b.json["textures"] = json!([{"extensions": {"KHR_texture_basisu": {"source": "0"}}}]);
    b.refused(&["texture 0", "KHR_texture_basisu.source"]);
    b.json["materials"] = json!([{"normalTexture": {"index": 3}}]);
    b.refused(&["material 0.normalTexture", "texture 3"]);
    b.json["materials"] = json!([{"pbrMetallicRoughness": {"metallicFactor": 7}}]);
    b.refused(&["material 0", "metallicFactor"]);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(3);
    b.refused(&["material 3"]);
    // A truncated picture, one that claims 60000 x 60000, one beyond the budget.
    let good = png(64, 64, [1, 2, 3, 4]);
    let mut b = textured(json!({}));
    let cut = b.view(&good[..good.len() / 2]);
    b.json["images"] = json!([{"bufferView": cut}]);
    b.refused(&["image 0"]);
    let mut huge = good.clone();
    huge[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let mut b = textured(json!({}));
    let view = b.view(&huge);
    b.json["images"] = json!([{"bufferView": view}]);
    b.refused(&["image 0"]);
    let mut b = textured(json!({}));
    let view = b.view(&good);
    b.json["images"] = json!([{"bufferView": view}]);
    let small = Limits { texture_side: 32, ..Limits::default() };
    refused_with(&[("bad.glb", &b.glb())], &small, &["image 0", "32 x 32", "64 x 64"]);
    let small = Limits { texels: 100, ..Limits::default() };
    refused_with(&[("bad.glb", &b.glb())], &small, &["image 0", "at most 100 texels"]);
}

#[test]
fn uris_stay_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("asset");
    std::fs::create_dir(&inside).unwrap();
    let mut b = triangle();
    std::fs::write(folder.path().join("secret.bin"), &b.binary).unwrap();
    let secret = folder.path().join("secret.bin");
    let absolute = secret.to_string_lossy().into_owned();
    let mut uris = vec![
        "../secret.bin".to_owned(),
        "%2e%2e/secret.bin".into(),
        "a/../../secret.bin".into(),
        "..\\secret.bin".into(),
        absolute.clone(),
        format!("file://{absolute}"),
        "http://localhost/secret.bin".into(),
        "C:\\secret.bin".into(),
        "a%00.bin".into(),
        String::new(),
    ];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&secret, inside.join("link.bin")).unwrap();
        std::os::unix::fs::symlink(folder.path(), inside.join("out")).unwrap();
        uris.extend(["link.bin".to_owned(), "out/secret.bin".into()]);
    }
    for uri in uris {
        b.json["buffers"] = json!([{"byteLength": b.binary.len(), "uri": uri}]);
        let path = inside.join("a.gltf");
        std::fs::write(&path, b.json.to_string()).unwrap();
        let text = crate::load(&path).unwrap_err().to_string();
        assert!(
            text.contains("buffer 0") && text.contains("inside of the asset's folder"),
            "`{uri}`: {text}"
        );
    }
    // A detour that ends inside is fine.
    std::fs::create_dir(inside.join("sub")).unwrap();
    std::fs::write(inside.join("data.bin"), &b.binary).unwrap();
    b.json["buffers"] = json!([{"byteLength": b.binary.len(), "uri": "sub/../data.bin"}]);
    std::fs::write(inside.join("a.gltf"), b.json.to_string()).unwrap();
    assert_eq!(crate::load(inside.join("a.gltf")).unwrap().triangle_count(), 1);
    refused(
        &[(
            "bad.gltf",
            b"{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":9,\"uri\":\"data:,x\"}]}",
        )],
        &["buffer 0", "base64"],
    );
    refused(
        &[("bad.gltf", b"{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":9,\"uri\":\"data:;base64,AAAA\"}]}")],
        &["buffer 0", "byteLength 9", "3 bytes"],
    );
}

#[test]
fn nothing_to_see_is_loadable_and_found_by_the_check() {
    let mut b = triangle();
    b.binary[..36].fill(0);
    let scene = b.load();
    assert_eq!(scene.area(), 0.0);
    assert!(scene.validate_for_fit().unwrap_err().to_string().contains("positive finite area"));
    let mut b = triangle();
    b.json["nodes"] = json!([{}]);
    let scene = b.load();
    assert_eq!(scene.triangle_count(), 0);
    assert!(scene.validate_for_fit().unwrap_err().to_string().contains("no geometry"));
    assert!(triangle().load().validate_for_fit().is_ok());
}

#[test]
fn truncations_and_flipped_bits_never_panic() {
    let mut b = triangle();
    let view = b.view(&png(8, 8, [5, 6, 7, 8]));
    b.json["images"] = json!([{"bufferView": view}]);
    b.json["textures"] = json!([{"source": 0}]);
    b.json["materials"] = json!([{"normalTexture": {"index": 0}}]);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let good = b.glb();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let mut state = 1_u64;
    for round in 0..400 {
        let mut bytes = good.clone();
        for _ in 0..1 + round % 3 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = (state >> 33) as usize % bytes.len();
            bytes[at] ^= 1 << (state >> 61);
        }
        std::fs::write(&path, bytes).unwrap();
        match crate::load(&path) {
            Ok(scene) => drop(scene.flatten()),
            Err(e) => assert!(e.to_string().contains("a.glb"), "{e}"),
        }
    }
}

#[test]
fn shared_bytes_are_counted_each_time() {
    let small = Limits { file_bytes: 4000, ..Limits::default() };
    let mut b = triangle();
    let buffer = json!({"byteLength": 1500, "uri": "data.bin"});
    b.json["buffers"] = json!([buffer, buffer, buffer]);
    let files: [(&str, &[u8]); 2] =
        [("bad.gltf", &b.json.to_string().into_bytes()), ("data.bin", &[0; 1500])];
    refused_with(&files, &small, &["buffer 2", "buffers have 4500", "4000"]);
    let mut b = triangle();
    let bytes = png(64, 64, [1, 2, 3, 4]);
    let images: Vec<_> = (0..200)
        .map(|_| {
            let view = b.view(&bytes);
            json!({"bufferView": view})
        })
        .collect();
    b.json["images"] = json!(images);
    b.json["textures"] = (0..200).map(|i| json!({"source": i})).collect();
    b.json["materials"] = (0..200).map(|i| json!({"emissiveTexture": {"index": i}})).collect();
    let attributes = b.json["meshes"][0]["primitives"][0].clone();
    b.json["meshes"][0]["primitives"] = (0..200)
        .map(|i| {
            let mut p = attributes.clone();
            p["material"] = json!(i);
            p
        })
        .collect();
    let scene = b.load();
    assert_eq!((scene.images.len(), scene.primitives.len()), (200, 200));
    let few = Limits { texels: 64 * 64 * 150, ..Limits::default() };
    refused_with(&[("bad.glb", &b.glb())], &few, &["image 150", "all textures"]);
    let few = Limits { instances: 100, ..Limits::default() };
    refused_with(&[("bad.glb", &b.glb())], &few, &["primitive 100", "at most 100 placed"]);
}

#[test]
fn skins() {
    let skinned = || {
        let mut b = triangle();
        let joints = b.accessor(&[0; 12], 5121, "VEC4", 3);
        let weights = b.floats(&[1.0, 0.0, 0.0, 0.0].repeat(3), "VEC4", 3);
        let attributes = &mut b.json["meshes"][0]["primitives"][0]["attributes"];
        attributes["JOINTS_0"] = json!(joints);
        attributes["WEIGHTS_0"] = json!(weights);
        b.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {}]);
        b.json["skins"] = json!([{"joints": [1]}]);
        b
    };
    assert_eq!(skinned().load().triangle_count(), 1);
    let mut b = skinned();
    b.json["skins"] = json!([{"joints": [7]}]);
    b.refused(&["skin 0", "joint 7"]);
    b.json["skins"] = json!([{"joints": []}]);
    b.refused(&["node 0 primitive 0", "joint 0 of vertex 0", "0 joints"]);
    // Many inverse bind matrices that nobody needs are not read.
    let zeros = json!({"componentType": 5126, "count": 4_000_000_000_u64, "type": "MAT4", "sparse": {
        "count": 0, "indices": {"bufferView": 0, "componentType": 5121}, "values": {"bufferView": 0},
    }});
    let bind = push(&mut b.json["accessors"], zeros);
    b.json["skins"] = json!([{"joints": [1], "inverseBindMatrices": bind}]);
    b.json["nodes"][1]["translation"] = json!([1, 2, 3]);
    // The singular one collapses what follows the joint.
    let flat = b.load().flatten().mesh;
    assert_eq!(flat.positions, [vec3(1.0, 2.0, 3.0); 3]);
    assert!(flat.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6), "{:?}", flat.normals);
    let mut b = skinned();
    let broken = b.floats(&[f32::NAN; 16], "MAT4", 1);
    b.json["skins"] = json!([{"joints": [1], "inverseBindMatrices": broken}]);
    b.refused(&["skin 0", "not finite"]);
    let mut b = skinned();
    b.json["skins"] = json!([{"joints": [1, 1], "inverseBindMatrices": 0}]);
    b.refused(&["accessor 0", "16 components"]);
    let mut b = skinned();
    b.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(1);
    b.refused(&["WEIGHTS_0", "4 components"]);
    b.json["meshes"][0]["primitives"][0]["attributes"] = json!({"POSITION": 0});
    b.refused(&["node 0 primitive 0", "JOINTS_0"]);
    let mut b = skinned();
    let weights = b.floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0], "VEC4", 3);
    b.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    b.refused(&["mesh 0 primitive 0", "weights of vertex 2", "not negative"]);
    let mut b = skinned();
    b.json["skins"] = json!([{"joints": [1], "skeleton": 9}]);
    b.refused(&["skin 0", "joint 9", "2 nodes"]);
}
