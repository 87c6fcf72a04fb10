//! glTF features with known results.

use super::{load_files, load_files_with, png, refused};
use crate::{AlphaMode, Filter, Limits, Scene, Wrap};
use base64::Engine;
use photofit_scalar::{vec2, vec3, vec4};
use serde_json::{Value, json};
use std::f32::consts::FRAC_1_SQRT_2;

/// A document under construction.
#[derive(Clone)]
pub(super) struct Builder {
    pub(super) json: Value,
    pub(super) binary: Vec<u8>,
}

impl Builder {
    pub(super) fn new() -> Self {
        Self {
            json: json!({"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}),
            binary: Vec::new(),
        }
    }

    /// A bufferView of these bytes.
    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        self.binary.extend_from_slice(bytes);
        push(&mut self.json["bufferViews"], view)
    }

    pub(super) fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        push(&mut self.json["accessors"], accessor)
    }

    pub(super) fn floats(&mut self, values: &[f32], kind: &str, count: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, 5126, kind, count)
    }

    pub(super) fn glb(&self) -> Vec<u8> {
        self.glb_with(&[])
    }

    /// The file with further buffers.
    pub(super) fn glb_with(&self, buffers: &[Value]) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.binary.len()}]);
        buffers.iter().for_each(|b| _ = push(&mut json["buffers"], b.clone()));
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut binary = self.binary.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend_from_slice(&(28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
        for (kind, data) in [(b"JSON", text), (b"BIN\0", binary)] {
            out.extend_from_slice(&(data.len() as u32).to_le_bytes());
            out.extend_from_slice(kind);
            out.extend_from_slice(&data);
        }
        out
    }

    pub(super) fn load(&self) -> Scene {
        load_files(&[("a.glb", &self.glb())]).unwrap()
    }

    pub(super) fn refused(&self, words: &[&str]) {
        refused(&[("bad.glb", &self.glb())], words);
    }
}

pub(super) fn push(array: &mut Value, value: Value) -> usize {
    if !array.is_array() {
        *array = json!([]);
    }
    let array = array.as_array_mut().unwrap();
    array.push(value);
    array.len() - 1
}

/// One node with one mesh of one triangle.
pub(super) fn triangle() -> Builder {
    let mut b = Builder::new();
    let p = b.floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], "VEC3", 3);
    let n = b.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC3", 3);
    let i = b.accessor(&[0, 0, 1, 0, 2, 0], 5123, "SCALAR", 3);
    b.json["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": p, "NORMAL": n}, "indices": i}]}]);
    b.json["nodes"] = json!([{"mesh": 0}]);
    b.json["scenes"] = json!([{"nodes": [0]}]);
    b.json["scene"] = json!(0);
    b
}

#[test]
fn scenes_without_nodes_are_empty() {
    for (scenes, default, placed) in [
        (json!([{"nodes": [0]}, {"name": "second"}]), 0, 1),
        (json!([{"nodes": [0]}, {"name": "second"}]), 1, 0),
        (json!([{}]), 0, 0),
    ] {
        let mut b = triangle();
        (b.json["scenes"], b.json["scene"]) = (scenes, json!(default));
        assert_eq!(b.load().instances.len(), placed, "{}", b.json["scenes"]);
    }
}

#[test]
fn node_transforms_compose_and_mirror() {
    let mut b = triangle();
    b.json["nodes"] = json!([
        {"children": [1], "translation": [1, 0, 0], "rotation": [0, 0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]},
        {"mesh": 0, "scale": [-2, 1, 1]},
    ]);
    let flat = b.load().flatten();
    let expected = [vec3(1.0, 0.0, 0.0), vec3(1.0, -2.0, 0.0), vec3(0.0, 0.0, 0.0)];
    for (p, e) in flat.mesh.positions.iter().zip(expected) {
        assert!((*p - e).length() < 1e-6, "{p:?} {e:?}");
    }
    assert_eq!(flat.mesh.triangles, [[0, 2, 1]], "a mirrored instance is turned around");
    assert!((flat.mesh.normals[0] - vec3(0.0, 0.0, 1.0)).length() < 1e-6, "{:?}", flat.mesh.normals[0]);
    let [a, b, c] = flat.mesh.corners(0);
    assert!((b - a).cross(c - a).z > 0.0, "winding and normal agree");
}

#[test]
fn meshes_are_shared_by_nodes() {
    let mut b = triangle();
    b.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 5,6,7,1]}]);
    b.json["scenes"] = json!([{"nodes": [0, 1]}]);
    let scene = b.load();
    assert_eq!((scene.primitives.len(), scene.instances.len(), scene.triangle_count()), (1, 2, 2));
    assert_eq!(scene.bounds(), Some((vec3(0.0, 0.0, 0.0), vec3(6.0, 7.0, 7.0))));
    assert_eq!(scene.materials[0].metallic, 1.0, "the default material of the specification");
}

#[test]
fn deep_hierarchies_do_not_recurse() {
    let mut b = triangle();
    let n = 100_000;
    let mut nodes: Vec<Value> = (0..n).map(|i| json!({"children": [i + 1]})).collect();
    nodes.push(json!({"mesh": 0}));
    b.json["nodes"] = Value::Array(nodes);
    assert_eq!(b.load().triangle_count(), 1);
}

#[test]
fn strips_fans_and_plain_vertices() {
    let mut b = Builder::new();
    let p = b.floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0], "VEC3", 5);
    b.json["meshes"] = json!([{"primitives": [
        {"attributes": {"POSITION": p}, "mode": 5},
        {"attributes": {"POSITION": p}, "mode": 6},
        {"attributes": {"POSITION": p}, "mode": 4},
        {"attributes": {"POSITION": p}, "mode": 1},
    ]}]);
    b.json["nodes"] = json!([{"mesh": 0}]);
    b.json["scenes"] = json!([{"nodes": [0]}]);
    let scene = b.load();
    let counts: Vec<_> = scene.primitives.iter().map(|p| p.mesh.triangles.len()).collect();
    assert_eq!(counts, [3, 3, 1]);
    assert!(scene.warnings.iter().any(|w| w.contains("lines")), "{:?}", scene.warnings);
    // Flat normals, as the specification asks: every triangle of the strip faces +z.
    for t in 0..3 {
        let n = scene.primitives[0].mesh.normals[3 * t];
        assert_eq!(n, vec3(0.0, 0.0, 1.0), "triangle {t}");
    }
}

#[test]
fn integers_interleaving_and_sparse_values() {
    let mut b = Builder::new();
    // Positions as signed bytes beside coordinates as normalized u16, 8 bytes a vertex.
    let mut bytes = Vec::new();
    for (x, y, u, v) in [(0_i8, 0_i8, 0_u16, 0_u16), (127, 0, 65535, 0), (0, -127, 0, 65535)] {
        bytes.extend_from_slice(&[x as u8, y as u8, 0, 0]);
        bytes.extend_from_slice(&u.to_le_bytes());
        bytes.extend_from_slice(&v.to_le_bytes());
    }
    let view = b.view(&bytes);
    b.json["bufferViews"][view]["byteStride"] = json!(8);
    let p = push(
        &mut b.json["accessors"],
        json!({"bufferView": view, "componentType": 5120, "count": 3, "type": "VEC3", "normalized": true}),
    );
    let t = push(
        &mut b.json["accessors"],
        json!({"bufferView": view, "byteOffset": 4, "componentType": 5123, "count": 3, "type": "VEC2", "normalized": true}),
    );
    let c = b.accessor(&[255, 0, 51, 0, 0, 0, 0, 0, 0, 0, 0, 0], 5121, "VEC3", 3);
    b.json["accessors"][c]["normalized"] = json!(true);
    b.json["bufferViews"][c - 1]["byteStride"] = json!(4);
    // The last position is replaced: no base values needed for the second set of coordinates.
    let indices = b.view(&[2]);
    let values = b.view(&[0, 64, 0]);
    b.json["accessors"][p]["sparse"] = json!({
        "count": 1,
        "indices": {"bufferView": indices, "componentType": 5121},
        "values": {"bufferView": values},
    });
    let values: Vec<u8> = [0.5_f32, 0.25].iter().flat_map(|x| x.to_le_bytes()).collect();
    let values = b.view(&values);
    let zeros = push(
        &mut b.json["accessors"],
        json!({"componentType": 5126, "count": 3, "type": "VEC2", "sparse": {
            "count": 1,
            "indices": {"bufferView": indices, "componentType": 5121},
            "values": {"bufferView": values},
        }}),
    );
    b.json["meshes"] = json!([{"primitives": [{"attributes": {
        "POSITION": p, "TEXCOORD_0": t, "TEXCOORD_1": zeros, "COLOR_0": c,
    }}]}]);
    b.json["nodes"] = json!([{"mesh": 0}]);
    b.json["scenes"] = json!([{"nodes": [0]}]);
    b.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = b.load();
    let mesh = &scene.primitives[0].mesh;
    assert_eq!(mesh.positions, [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 64.0 / 127.0, 0.0)]);
    assert_eq!(mesh.uvs, [vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(0.0, 1.0)]);
    assert_eq!(mesh.uvs1, [vec2(0.0, 0.0), vec2(0.0, 0.0), vec2(0.5, 0.25)]);
    assert_eq!(mesh.colors[0], vec4(1.0, 0.0, 51.0 / 255.0, 1.0));
}

#[test]
fn materials_slots_and_transforms() {
    let mut b = triangle();
    let one = b.view(&png(2, 2, [10, 20, 30, 40]));
    let two = b.view(&png(4, 1, [1, 2, 3, 255]));
    b.json["images"] =
        json!([{"bufferView": two, "mimeType": "image/png"}, {"bufferView": one, "name": "one"}]);
    b.json["samplers"] = json!([{"magFilter": 9728, "minFilter": 9984, "wrapS": 33071, "wrapT": 33648}]);
    b.json["textures"] = json!([{"source": 1, "sampler": 0}, {"source": 0}]);
    b.json["materials"] = json!([{
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}, "roughnessFactor": 0.5},
        "normalTexture": {"index": 1, "scale": 0.5, "extensions": {"KHR_texture_transform": {
            "offset": [0.5, 0.25], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2, 3], "texCoord": 1,
        }}},
        "emissiveFactor": [1, 0.5, 0],
        "alphaMode": "MASK",
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}, "KHR_materials_unlit": {}},
    }]);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    b.json["extensionsUsed"] = json!(["KHR_materials_unlit", "KHR_materials_iridescence"]);
    let scene = b.load();
    let m = &scene.materials[0];
    let base = m.base_color_texture.unwrap();
    assert_eq!(scene.images[base.image].texels[0], [10, 20, 30, 40]);
    assert_eq!(scene.images[base.image].name, "one");
    assert_eq!((base.tex_coord, base.sampler.filter), (1, Filter::Nearest));
    assert_eq!((base.sampler.wrap_u, base.sampler.wrap_v), (Wrap::ClampToEdge, Wrap::MirroredRepeat));
    let normal = m.normal_texture.unwrap();
    assert_eq!((scene.images[normal.image].width, normal.tex_coord), (4, 1));
    // A quarter turn counter-clockwise as seen in the image: u goes to -v, v to u.
    let t = normal.transform;
    let at = |u: f32, v: f32| [t[0][0] * u + t[0][1] * v + t[0][2], t[1][0] * u + t[1][1] * v + t[1][2]];
    for (from, to) in [((1.0, 0.0), [0.5, 0.25 - 2.0]), ((0.0, 1.0), [0.5 + 3.0, 0.25])] {
        let found = at(from.0, from.1);
        assert!((found[0] - to[0]).abs() < 1e-5 && (found[1] - to[1]).abs() < 1e-5, "{found:?} {to:?}");
    }
    assert_eq!((m.emissive, m.unlit, m.roughness, m.normal_scale), ([4.0, 2.0, 0.0], true, 0.5, 0.5));
    assert_eq!(m.alpha_mode, AlphaMode::Mask { cutoff: 0.5 });
    assert!(scene.warnings.iter().any(|w| w.contains("KHR_materials_iridescence")), "{:?}", scene.warnings);
}

#[test]
fn external_and_embedded_files() {
    let mut b = triangle();
    b.json["images"] = json!([{"uri": "textures/a%20b.png"}]);
    b.json["textures"] = json!([{"source": 0}]);
    b.json["materials"] = json!([{"emissiveTexture": {"index": 0}}]);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    b.json["buffers"] = json!([{"byteLength": b.binary.len(), "uri": "data.bin"}]);
    let picture = png(3, 3, [9; 4]);
    let text = b.json.to_string();
    let files: [(&str, &[u8]); 3] =
        [("a.gltf", text.as_bytes()), ("data.bin", &b.binary), ("textures/a b.png", &picture)];
    let scene = load_files(&files).unwrap();
    assert_eq!((scene.triangle_count(), scene.images[0].width, scene.name.as_str()), (1, 3, "a"));
    assert_eq!(scene.source_bytes, files.iter().map(|f| f.1.len() as u64).sum::<u64>());
    let coded = base64::engine::general_purpose::STANDARD.encode(&b.binary);
    b.json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{coded}"));
    let coded = base64::engine::general_purpose::STANDARD.encode(&picture);
    b.json["images"] = json!([{"uri": format!("data:image/png;base64,{coded}")}]);
    let scene = load_files(&[("a.gltf", b.json.to_string().as_bytes())]).unwrap();
    assert_eq!((scene.triangle_count(), scene.images[0].height), (1, 3));
}

#[test]
fn morph_weights_of_node_and_mesh() {
    let mut b = triangle();
    let d = b.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC3", 3);
    b.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": d}]);
    b.json["meshes"][0]["weights"] = json!([0.5]);
    b.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "weights": [2.0]}, {"mesh": 0, "weights": [0.0]}]);
    b.json["scenes"] = json!([{"nodes": [0, 1, 2]}]);
    let flat = b.load().flatten();
    let heights: Vec<f32> = flat.mesh.positions.iter().step_by(3).map(|p| p.z).collect();
    assert_eq!(heights, [0.5, 2.0, 0.0]);
}

#[test]
fn skins_are_loaded_in_their_pose() {
    let mut b = triangle();
    let joints = b.accessor(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], 5121, "VEC4", 3);
    let weights = b.floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0], "VEC4", 3);
    let attributes = &mut b.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
    // The mesh node's own transform has no say.
    b.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
        {"translation": [0, 0, 1], "children": [2]},
        {"translation": [0, 0, 2]},
    ]);
    b.json["scenes"] = json!([{"nodes": [0, 1]}]);
    b.json["skins"] = json!([{"joints": [1, 2]}]);
    let flat = b.load().flatten();
    assert_eq!(flat.mesh.positions, [vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 3.0), vec3(0.0, 1.0, 2.0)]);
}

#[test]
fn tangents_are_made_where_a_normal_map_needs_them() {
    let mut b = triangle();
    let t = b.floats(&[0.0, 0.0, 0.0, 1.0, 1.0, 0.0], "VEC2", 3);
    b.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(t);
    b.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    b.json["materials"] = json!([{}]);
    assert!(b.load().flatten().mesh.tangents.is_empty(), "nothing needs them");
    let image = b.view(&png(1, 1, [128, 128, 255, 255]));
    b.json["images"] = json!([{"bufferView": image}]);
    b.json["textures"] = json!([{"source": 0}]);
    b.json["materials"] = json!([{"normalTexture": {"index": 0}}]);
    let scene = b.load();
    assert!(scene.primitives[0].mesh.tangents.is_empty());
    let flat = scene.flatten();
    // u grows along +y, v along +x (down in the image): bitangent = w cross(n, t) is -v.
    let t = flat.mesh.tangents[0];
    assert!((t.xyz() - vec3(0.0, 1.0, 0.0)).length() < 1e-6, "{t:?}");
    let bitangent = vec3(0.0, 0.0, 1.0).cross(t.xyz()) * t.w;
    assert!((bitangent - vec3(-1.0, 0.0, 0.0)).length() < 1e-6, "{bitangent:?}");
}

#[test]
fn an_attribute_with_a_name_of_its_own_is_read_where_it_is_asked_for() {
    let mut b = triangle();
    let floats = b.floats(&[0.0, 0.75, f32::NAN], "SCALAR", 3);
    // Four bytes a vertex, as the alignment of the specification asks for.
    let bytes = b.view(&[255, 0, 0, 0, 0, 0, 0, 0, 255, 0, 0, 0]);
    b.json["bufferViews"][bytes]["byteStride"] = json!(4);
    b.json["accessors"].as_array_mut().unwrap().push(json!({
        "bufferView": bytes, "componentType": 5121, "normalized": true, "count": 3, "type": "SCALAR",
    }));
    let bytes = b.json["accessors"].as_array().unwrap().len() - 1;
    let pairs = b.floats(&[0.0; 6], "VEC2", 3);
    let short = b.floats(&[1.0, 1.0], "SCALAR", 2);
    let attributes = &mut b.json["meshes"][0]["primitives"][0]["attributes"];
    (attributes["_SEAM"], attributes["_Hem"]) = (json!(floats), json!(bytes));
    (attributes["_PAIRS"], attributes["__SHORT"]) = (json!(pairs), json!(short));
    b.json["nodes"] = json!([{"mesh": 0, "translation": [0, 0, 2]}, {"mesh": 0, "scale": [2, 2, 2]}]);
    b.json["scenes"] = json!([{"nodes": [0, 1]}]);
    let limits = |name: &str| Limits { vertex_attribute: Some(name.into()), ..Limits::default() };
    let load = |b: &Builder, name| load_files_with(&[("a.glb", &b.glb())], &limits(name));
    // What nobody asks for is listed, and refuses nothing.
    let plain = b.load();
    assert!(plain.vertex_attributes.is_empty());
    assert_eq!(plain.ignored_attributes, ["_Hem", "_PAIRS", "_SEAM", "__SHORT"]);
    assert!(plain.left_out(&Scene::default()).iter().any(|l| l.contains("4 vertex attributes")));
    for (name, values, at) in [("seam", [0.0, 0.75, 0.0], vec![1]), ("HEM", [1.0, 0.0, 1.0], vec![0, 2])] {
        let scene = load(&b, name).unwrap();
        assert_eq!((scene.vertex_attributes.len(), scene.ignored_attributes.len()), (1, 3));
        assert_eq!(scene.vertex_attributes[0].values, values);
        // At both places.
        let flat = scene.flatten().mesh.positions;
        let want: Vec<_> =
            [0, 3].iter().flat_map(|base| at.iter().map(move |v| base + v)).map(|v| flat[v]).collect();
        assert_eq!(scene.positions_with(name), Some(want));
        assert_eq!(scene.positions_with("pairs"), None);
        assert!(scene.validate().is_ok());
    }
    for (name, word) in [("pairs", "2 components"), ("_short", "3")] {
        let refused = load(&b, name).unwrap_err().to_string();
        assert!(refused.contains("mesh 0 primitive 0 _") && refused.contains(word), "{refused}");
    }
    // Names that differ in case alone mark vertices together.
    let attributes = &mut b.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["_Seam"] = attributes["_Hem"].clone();
    let both = load(&b, "seam").unwrap();
    assert_eq!((both.vertex_attributes.len(), both.positions_with("seam").unwrap().len()), (2, 6));
    b.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("_Seam");
    // Without normals each corner has a vertex of its own, with what its vertex has; all of them count.
    b.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("NORMAL");
    let more = b.accessor(&[0, 0, 1, 0, 2, 0, 2, 0, 1, 0, 0, 0], 5123, "SCALAR", 6);
    b.json["meshes"][0]["primitives"][0]["indices"] = json!(more);
    let scene = load(&b, "hem").unwrap();
    assert_eq!(scene.vertex_attributes[0].values, [1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let few = Limits { vertices: 3 + 6 + 8, ..limits("hem") };
    let refused = load_files_with(&[("a.glb", &b.glb())], &few).unwrap_err().to_string();
    assert!(refused.contains("vertices"), "{refused}");
    let few = Limits { vertices: 3 + 6 + 9, ..limits("hem") };
    assert!(load_files_with(&[("a.glb", &b.glb())], &few).is_ok());
}

#[test]
fn attributes_of_parts_that_deform_go_to_each_pose() {
    let mut b = triangle();
    let lift = b.floats(&[0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0], "VEC3", 3);
    let seam = b.floats(&[0.0, 1.0, 0.0], "SCALAR", 3);
    let primitive = &mut b.json["meshes"][0]["primitives"][0];
    primitive["targets"] = json!([{"POSITION": lift}]);
    primitive["attributes"]["_SEAM"] = json!(seam);
    b.json["nodes"] = json!([{"mesh": 0, "weights": [0.5]}, {"mesh": 0, "weights": [1.0]}]);
    b.json["scenes"] = json!([{"nodes": [0, 1]}]);
    let limits = Limits { vertex_attribute: Some("seam".into()), ..Limits::default() };
    let scene = load_files_with(&[("a.glb", &b.glb())], &limits).unwrap();
    let flat = scene.flatten().mesh.positions;
    assert_eq!(scene.positions_with("seam"), Some(vec![flat[1], flat[4]]));
    assert_eq!((flat[1].y, flat[4].y), (0.5, 1.0));
}
