//! Compressed buffer views: good ones, and claims that do not hold.

use super::gltf::{Builder, push, triangle};
use crate::Limits;
use crate::load::tests::refused_with;
use crate::meshopt::{encode_triangles, encode_vertices};
use serde_json::{Value, json};

/// The triangle with compressed positions and indices.
fn compressed(extension: &str) -> Builder {
    let mut b = triangle();
    let positions = encode_vertices(&b.binary[..36], 12);
    let (vertices, indices) = (b.view(&positions), b.view(&encode_triangles(&[[0, 1, 2]])));
    let mut replace = |old: usize, new: usize, stride: usize, mode: &str| {
        let views = b.json["bufferViews"].as_array_mut().unwrap();
        let new = views[new].clone();
        let mut meshopt = json!({"byteStride": stride, "count": 3, "mode": mode});
        for key in ["buffer", "byteOffset", "byteLength"] {
            meshopt[key] = new[key].clone();
        }
        views[old] = json!({"buffer": 1, "byteLength": 3 * stride, "extensions": {extension: meshopt}});
    };
    replace(0, vertices, 12, "ATTRIBUTES");
    replace(2, indices, 2, "TRIANGLES");
    b.json["extensionsUsed"] = json!([extension]);
    b.json["extensionsRequired"] = json!([extension]);
    b
}

/// The file with the buffer that only stands for decoded bytes.
fn with_fallback(b: &Builder, extension: &str) -> Vec<u8> {
    let text = json!({"byteLength": 44, "extensions": {extension: {"fallback": true}}});
    b.glb_with(&[text])
}

#[test]
fn both_extensions_are_read() {
    for extension in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let bytes = with_fallback(&compressed(extension), extension);
        let scene = super::load_files(&[("a.glb", &bytes)]).unwrap();
        let mesh = &scene.primitives[0].mesh;
        assert_eq!(mesh.positions[1].to_array(), [1.0, 0.0, 0.0]);
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
}

#[test]
fn claims_are_checked() {
    let extension = "EXT_meshopt_compression";
    let check = |change: &dyn Fn(&mut Value), words: &[&str]| {
        let mut b = compressed(extension);
        change(&mut b.json["bufferViews"][0]);
        super::refused(&[("bad.glb", &with_fallback(&b, extension))], words);
    };
    let set = |key: &'static str, value: Value| {
        move |view: &mut Value| view["extensions"][extension][key] = value.clone()
    };
    check(&set("mode", json!("POINTS")), &["bufferView 0", "mode", "ATTRIBUTES"]);
    check(&set("filter", json!("ROUND")), &["bufferView 0", "filter", "OCTAHEDRAL"]);
    check(&set("filter", json!("OCTAHEDRAL")), &["bufferView 0", "byteStride is 12"]);
    check(&set("count", json!(4)), &["bufferView 0", "byteLength is 36", "count 4"]);
    check(&set("count", json!(u64::MAX)), &["bufferView 0", "byteLength is 36"]);
    check(&set("byteOffset", json!(1_u64 << 40)), &["bufferView 0", "buffer 0"]);
    check(&set("byteLength", json!(20)), &["bufferView 0", "truncated"]);
    check(&set("buffer", json!(7)), &["bufferView 0", "buffer 7"]);
    check(&set("buffer", json!(1)), &["bufferView 0", "buffer 1"]);
    check(
        &|view| {
            view["byteLength"] = json!(12_u64 << 30);
            view["extensions"][extension]["count"] = json!(1_u64 << 30);
        },
        &["bufferView 0", "at most 4294967296 bytes"],
    );
    check(
        &|view| {
            view["byteLength"] = json!(12_u64 << 20);
            view["extensions"][extension]["count"] = json!(1_u64 << 20);
        },
        &["bufferView 0", "1048576 elements", "at least"],
    );
    check(&|view| *view = json!({"buffer": 1, "byteLength": 36}), &["bufferView 0", "0 bytes of buffer 1"]);
    let few = Limits { file_bytes: 4000, ..Limits::default() };
    let mut b = compressed(extension);
    let wide = encode_vertices(&[0; 12_000], 12);
    b.view(&wide);
    let mut view = pop(&mut b.json["bufferViews"]);
    view["extensions"] = json!({extension: {
        "buffer": 0, "byteOffset": view["byteOffset"], "byteLength": view["byteLength"],
        "byteStride": 12, "count": 1000, "mode": "ATTRIBUTES",
    }});
    view["byteLength"] = json!(12_000);
    push(&mut b.json["bufferViews"], view);
    refused_with(&[("bad.glb", &with_fallback(&b, extension))], &few, &["decoded", "at most 4000 bytes"]);
}

/// Takes the last element of an array.
fn pop(array: &mut Value) -> Value {
    array.as_array_mut().and_then(Vec::pop).unwrap()
}
