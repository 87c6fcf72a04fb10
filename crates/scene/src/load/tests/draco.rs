//! `KHR_draco_mesh_compression`: the torus of `assets/draco`, written by Google's encoder, against its formula; claims that
//! do not hold.

use super::gltf::{Builder, triangle};
use super::{load_files, refused, refused_with};
use crate::{Limits, Scene};
use photofit_scalar::{Vec3f, vec3};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::f32::consts::TAU;

const VALENCE: &[u8] = include_bytes!("../../../../../assets/draco/torus-valence.glb");
const STANDARD: &[u8] = include_bytes!("../../../../../assets/draco/torus-standard.glb");
const SEQUENTIAL: &[u8] = include_bytes!("../../../../../assets/draco/torus-sequential.glb");

/// Quads around the torus and around its tube.
const AROUND: usize = 40;
const TUBE: usize = 16;

/// Position and normal of a vertex.
fn point(i: usize, j: usize) -> (Vec3f, Vec3f) {
    let angle = |k: usize, n: usize| TAU * (k % n) as f32 / n as f32;
    let ((sa, ca), (sb, cb)) = (angle(i, AROUND).sin_cos(), angle(j, TUBE).sin_cos());
    let r = 1.0 + 0.4 * cb;
    (vec3(r * ca, 0.4 * sb, r * sa), vec3(cb * ca, sb, cb * sa))
}

/// The triangles as pairs of grid indices, each beginning with its smallest corner.
fn expected_triangles() -> BTreeSet<[(usize, usize); 3]> {
    let mut out = BTreeSet::new();
    for i in (0..AROUND).filter(|i| ![20, 30].contains(i)) {
        for j in (0..TUBE).filter(|j| !((5..9).contains(&i) && (3..7).contains(j))) {
            out.insert(turned([(i, j), (i, j + 1), (i + 1, j)]));
            out.insert(turned([(i + 1, j), (i, j + 1), (i + 1, j + 1)]));
        }
    }
    out
}

fn turned(mut triangle: [(usize, usize); 3]) -> [(usize, usize); 3] {
    let first = (0..3).min_by_key(|&k| triangle[k]).unwrap();
    triangle.rotate_left(first);
    triangle
}

fn check_torus(scene: &Scene, name: &str) {
    assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings);
    let hierarchy = scene.hierarchy.as_ref().unwrap();
    let bind = hierarchy.meshes[0].primitives[0].bind.as_ref().unwrap();
    let mesh = &bind.mesh;
    // Which vertex of the grid each one is follows from its texture coordinates: 12 bits, the grid has 41 x 17 vertices.
    let grid: Vec<(usize, usize)> = mesh
        .uvs
        .iter()
        .map(|uv| {
            let (i, j) = (uv.x * AROUND as f32, uv.y * TUBE as f32);
            let off = (i - i.round()).abs().max((j - j.round()).abs());
            assert!(off <= 0.5 * AROUND as f32 / 4095.0 + 1e-5, "{name}: {uv:?}");
            (i.round() as usize, j.round() as usize)
        })
        .collect();
    assert_eq!(mesh.positions.len(), 688, "{name}");
    // Half a step: of 14 bits of the largest extent, of 12 bits of [-1, 1]; of 10 bits of octahedral coordinates, whose steps
    // are sqrt(6) times as long on the octahedron and sqrt(3) times that on the sphere.
    let position = 0.5 * 2.8 / 16383.0 + 1e-6;
    let normal = 18_f32.sqrt() / 1022.0;
    let unit = 1.0 / 4095.0 + 1e-6;
    for (v, &(i, j)) in grid.iter().enumerate() {
        let (p, n) = point(i, j);
        assert!(
            (mesh.positions[v] - p).to_array().iter().all(|d| d.abs() <= position),
            "{name} {v}: {:?}",
            mesh.positions[v]
        );
        assert!((mesh.normals[v] - n).length() <= normal, "{name} {v}: {:?} {n:?}", mesh.normals[v]);
        let a = TAU * (i % AROUND) as f32 / AROUND as f32;
        let tangent = vec3(-a.sin(), 0.0, a.cos());
        // Made perpendicular to the normal when it is read.
        assert!((mesh.tangents[v].xyz() - tangent).length() <= 2.0 * unit + normal, "{name} {v}");
        assert_eq!(mesh.tangents[v].w, if i < AROUND / 2 { 1.0 } else { -1.0 }, "{name} {v}");
        let uv1 = [(j * 4095) as f32 / 65535.0, ((AROUND - i) * 1638) as f32 / 65535.0];
        assert_eq!(mesh.uvs1[v].to_array(), uv1, "{name} {v}: integers are exact");
        let color = [i * 6, j * 15, (i * 7 + j * 3) % 256, 255].map(|c| (c as f32) / 255.0);
        assert_eq!(mesh.colors[v].to_array(), color, "{name} {v}: integers are exact");
        let weight = j as f32 / TUBE as f32;
        let influences = &bind.influences[0];
        for (w, e) in influences.weights[v].iter().zip([1.0 - weight, weight, 0.0, 0.0]) {
            assert!((w - e).abs() <= 0.5 * unit, "{name} {v}: {w} {e}");
        }
        let joints = [u32::from(i >= AROUND / 2), 1];
        let used = joints.into_iter().enumerate().filter(|(k, _)| influences.weights[v][*k] != 0.0);
        for (k, joint) in used {
            assert_eq!(influences.joints[v][k], joint, "{name} {v}");
        }
    }
    let triangles: Vec<_> = mesh.triangles.iter().map(|t| turned(t.map(|v| grid[v as usize]))).collect();
    let distinct: BTreeSet<_> = triangles.iter().copied().collect();
    assert_eq!(distinct.len(), triangles.len(), "{name}: no triangle is there twice");
    assert_eq!(distinct, expected_triangles(), "{name}");
}

#[test]
fn streams_of_the_reference_encoder_are_read() {
    for (name, bytes, method, traversal) in
        [("valence", VALENCE, 1, 2), ("standard", STANDARD, 1, 0), ("sequential", SEQUENTIAL, 0, u8::MAX)]
    {
        // The file is what its name says: bytes 8 and 11 of the stream are the method and the traversal.
        let at = bytes.windows(5).position(|w| w == b"DRACO").unwrap();
        assert_eq!(bytes[at + 8], method, "{name}");
        assert!(method == 0 || bytes[at + 11] == traversal, "{name}");
        check_torus(&load_files(&[("torus.glb", bytes)]).unwrap(), name);
    }
}

/// A file apart into its document and binary part.
fn apart(bytes: &[u8]) -> Builder {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    json.as_object_mut().unwrap().remove("buffers");
    Builder { json, binary: bytes[28 + length..].to_vec() }
}

/// Where the extension of the only primitive stands.
fn extension(b: &mut Builder) -> &mut Value {
    &mut b.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]
}

#[test]
fn claims_are_checked() {
    let check = |change: &dyn Fn(&mut Builder), words: &[&str]| {
        let mut b = apart(SEQUENTIAL);
        change(&mut b);
        b.refused(words);
    };
    check(&|b| extension(b)["bufferView"] = json!(9), &["mesh 0 primitive 0 (Draco)", "bufferView 9"]);
    check(
        &|b| extension(b)["attributes"]["NORMAL"] = json!(77),
        &["accessor 2", "NORMAL", "no attribute 77"],
    );
    check(&|b| extension(b)["attributes"]["NORMAL"] = json!(3), &["accessor 2", "2 components", "3"]);
    check(
        &|b| b.json["accessors"][5]["componentType"] = json!(5121),
        &["TEXCOORD_1", "componentType", "the number 65520"],
    );
    check(&|b| b.json["accessors"][7]["componentType"] = json!(5126), &["JOINTS_0", "unsigned"]);
    check(
        &|b| b.json["accessors"][1]["componentType"] = json!(5123),
        &["POSITION", "which is no integer type"],
    );
    check(&|b| b.json["meshes"][0]["primitives"][0]["mode"] = json!(6), &["indices", "mode is 6"]);
    // Positions from elsewhere would not tell how many vertices are decoded.
    let elsewhere = |b: &mut Builder| {
        extension(b)["attributes"].as_object_mut().unwrap().remove("POSITION");
    };
    check(&elsewhere, &["mesh 0 primitive 0", "Draco stream without POSITION"]);
    check(&|b| b.json["bufferViews"][1]["byteLength"] = json!(2000), &["(Draco)", "cannot be decoded"]);
    let sparse =
        json!({"count": 1, "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 0}});
    check(&|b| b.json["accessors"][2]["sparse"] = sparse.clone(), &["accessor 2", "sparse"]);
    let bytes = apart(SEQUENTIAL).glb();
    for limits in
        [Limits { triangles: 1000, ..Limits::default() }, Limits { file_bytes: 30_000, ..Limits::default() }]
    {
        refused_with(&[("a.glb", &bytes)], &limits, &["(Draco)", "too large"]);
    }
    refused_with(
        &[("a.glb", &bytes)],
        &Limits { vertices: 500, ..Limits::default() },
        &["688 vertices", "500"],
    );
}

#[test]
fn counts_of_the_stream_hold() {
    let mut b = apart(STANDARD);
    for accessor in 0..8 {
        b.json["accessors"][accessor]["count"] = json!(3);
    }
    let scene = b.load();
    let mesh = &scene.hierarchy.as_ref().unwrap().meshes[0].primitives[0].bind.as_ref().unwrap().mesh;
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (688, expected_triangles().len()));
    assert!(
        scene.warnings.iter().any(|w| w.contains("count 3") && w.contains("688 vertices")),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn what_is_not_compressed_is_read_from_buffers() {
    // Texture coordinates beside the stream, in its order of vertices.
    let plain = load_files(&[("a.glb", SEQUENTIAL)]).unwrap();
    let mesh = &plain.hierarchy.as_ref().unwrap().meshes[0].primitives[0].bind.as_ref().unwrap().mesh;
    let mut b = apart(SEQUENTIAL);
    let uvs: Vec<f32> = mesh.uvs.iter().flat_map(|uv| [uv.x + 1.0, uv.y]).collect();
    let own = b.floats(&uvs, "VEC2", mesh.uvs.len());
    extension(&mut b)["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
    b.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(own);
    let read = b.load();
    let other = &read.hierarchy.as_ref().unwrap().meshes[0].primitives[0].bind.as_ref().unwrap().mesh;
    assert_eq!(other.positions, mesh.positions);
    assert!(other.uvs.iter().zip(&mesh.uvs).all(|(a, b)| a.x == b.x + 1.0 && a.y == b.y));
}

#[test]
fn a_fallback_is_read_where_decoding_is_optional() {
    let mut b = triangle();
    let stream = b.view(b"no stream of Draco");
    b.json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression": {"bufferView": stream, "attributes": {"POSITION": 0, "NORMAL": 1}}});
    b.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    let scene = b.load();
    assert_eq!(scene.triangle_count(), 1);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    b.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    refused(&[("a.glb", &b.glb())], &["mesh 0 primitive 0 (Draco)", "cannot be decoded", "Draco 2.2"]);
}
