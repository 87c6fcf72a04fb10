//! The JSON document and its buffers.

use super::compressed::{self, RawBuffer, RawView};
use super::draco::{self, RawMesh, RawPrimitive, Stream};
use super::inventory::Inventory;
use crate::Scene;
use crate::error::{Fault, fault};
use crate::load::Limits;
use crate::load::file::{Folder, clip};
use crate::nodes::AssetInfo;
use gltf::json;
use serde::de::IgnoredAny;
use serde_json::Value;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

/// Extensions whose meaning is read here.
const SUPPORTED: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    DRACO,
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

const DRACO: &str = "KHR_draco_mesh_compression";

/// A parsed document with its buffers in memory.
#[derive(Debug)]
pub(super) struct Document<'a> {
    pub(super) root: json::Root,
    /// The `materials` array as it stands: the typed one lacks the texture transforms of some slots.
    pub(super) materials: Vec<Value>,
    /// The lights of `KHR_lights_punctual` as they stand.
    pub(super) lights: Vec<Value>,
    /// Index of the light of each node that has one.
    node_lights: HashMap<usize, usize>,
    /// What places the meshes of nodes more than once.
    instancing: HashMap<usize, Instancing>,
    pub(super) buffers: Vec<Cow<'a, [u8]>>,
    /// Bytes of buffer views that are compressed.
    decoded: HashMap<usize, Vec<u8>>,
    /// Streams of primitives that are compressed, by mesh and primitive.
    pub(super) streams: HashMap<(usize, usize), Stream>,
    /// Whether the file says that it cannot be read without decoding them.
    pub(super) draco_required: bool,
    /// The meshes with all names of attributes.
    meshes: Vec<RawMesh>,
    /// Objects with application data, anywhere in the file.
    pub(super) extras: usize,
    /// The `textures` array as it stands.
    pub(super) textures: Vec<Value>,
    pub(super) folder: &'a Folder,
    pub(super) limits: &'a Limits,
}

/// What the typed document leaves out.
#[derive(serde::Deserialize)]
struct Raw {
    #[serde(default)]
    materials: Vec<Value>,
    #[serde(default)]
    animations: Vec<RawAnimation>,
    #[serde(default)]
    meshes: Vec<RawMesh>,
    #[serde(default)]
    nodes: Vec<RawNode>,
    #[serde(default)]
    scenes: Vec<RawScene>,
    #[serde(default)]
    textures: Vec<Value>,
    #[serde(default)]
    buffers: Vec<RawBuffer>,
    #[serde(default, rename = "bufferViews")]
    views: Vec<RawView>,
    extensions: Option<RootExtensions>,
}

/// A scene of the file; without nodes it is empty.
#[derive(serde::Deserialize)]
struct RawScene {
    nodes: Option<IgnoredAny>,
}

#[derive(serde::Deserialize)]
struct RawAnimation {
    #[serde(default)]
    channels: Vec<RawChannel>,
}

#[derive(serde::Deserialize)]
struct RawChannel {
    target: RawTarget,
}

#[derive(serde::Deserialize)]
struct RawTarget {
    node: Option<IgnoredAny>,
}

#[derive(serde::Deserialize)]
struct RawNode {
    extensions: Option<NodeExtensions>,
}

#[derive(serde::Deserialize)]
struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    light: Option<LightIndex>,
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    instancing: Option<Instancing>,
}

/// The accessors that place the mesh of a node.
#[derive(Debug, serde::Deserialize)]
pub(super) struct Instancing {
    /// By the names of the extension.
    #[serde(default)]
    pub(super) attributes: HashMap<String, usize>,
}

#[derive(serde::Deserialize)]
struct LightIndex {
    light: usize,
}

#[derive(serde::Deserialize)]
struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    lights: Option<LightList>,
}

#[derive(serde::Deserialize)]
struct LightList {
    lights: Vec<Value>,
}

/// A message of the JSON reader without the names of our types.
fn without_types(message: &str) -> String {
    let words: Vec<&str> = message.split(' ').collect();
    let mut out = Vec::new();
    let mut i = 0;
    while let Some(word) = words.get(i) {
        let named = matches!(*word, "struct" | "enum")
            && words.get(i + 1).is_some_and(|w| w.starts_with(char::is_uppercase));
        out.push(if named { "an object" } else { word });
        i += 1 + usize::from(named);
    }
    out.join(" ")
}

impl<'a> Document<'a> {
    pub(super) fn new(
        text: &[u8],
        binary: Option<&'a [u8]>,
        folder: &'a Folder,
        limits: &'a Limits,
        scene: &mut Scene,
    ) -> Result<Self, Fault> {
        check_size(text, limits)?;
        let syntax = |e: serde_json::Error| fault("the JSON", without_types(&e.to_string()));
        let raw: Raw = serde_json::from_slice(text).map_err(syntax)?;
        let Raw { materials, animations, meshes, nodes, scenes, textures, buffers, views, extensions } = raw;
        // A number or text that only a full reader refuses may stand where nobody reads.
        let inventory = Inventory::of(text).unwrap_or_else(|e| {
            scene.warnings.push(format!("what the file holds beyond what is read cannot be told: {e}"));
            Inventory::default()
        });
        let text = with_nodes(text, (&animations, &scenes), &mut scene.warnings).map_err(syntax)?;
        let root: json::Root = serde_json::from_slice(&text).map_err(syntax)?;
        if !root.asset.version.starts_with("2.") {
            return Err(fault(
                "asset.version",
                format!("the version is `{}`; it must be 2.x", clip(&root.asset.version)),
            ));
        }
        check_extensions(&root, &inventory, scene)?;
        let lights = extensions.and_then(|e| e.lights).map_or_else(Vec::new, |l| l.lights);
        let node_lights = nodes.iter().enumerate();
        let node_lights =
            node_lights.filter_map(|(i, n)| Some((i, n.extensions.as_ref()?.light.as_ref()?.light)));
        let node_lights = node_lights.collect();
        let instancing = nodes.into_iter().enumerate();
        let instancing = instancing.filter_map(|(i, n)| Some((i, n.extensions?.instancing?))).collect();
        let draco_required = root.extensions_required.iter().any(|e| e == DRACO);
        let mut document = Self {
            root,
            materials,
            lights,
            node_lights,
            instancing,
            buffers: Vec::new(),
            decoded: HashMap::new(),
            streams: draco::streams(&meshes),
            draco_required,
            meshes,
            extras: inventory.extras,
            textures,
            folder,
            limits,
        };
        let mut total = 0_u64;
        for (i, raw) in buffers.iter().enumerate() {
            // What only stands for decoded bytes is not read.
            let bytes = if raw.is_fallback() { Cow::default() } else { document.buffer(i, binary)? };
            total = total.saturating_add(bytes.len() as u64);
            if total > limits.file_bytes {
                let rule = format!(
                    "buffers have {total} bytes up to here; there may be at most {} bytes",
                    limits.file_bytes
                );
                return Err(fault(format!("buffer {i}"), rule));
            }
            document.buffers.push(bytes);
        }
        document.decoded = compressed::decode(&document, &views, total)?;
        Ok(document)
    }

    /// Index of the light of a node.
    pub(super) fn light(&self, node: usize) -> Option<usize> {
        self.node_lights.get(&node).copied()
    }

    /// Primitive `p` of mesh `m` as it stands.
    pub(super) fn primitive(&self, m: usize, p: usize) -> Option<&RawPrimitive> {
        self.meshes.get(m)?.primitives.get(p)
    }

    /// What places the mesh of a node more than once.
    pub(super) fn instancing(&self, node: usize) -> Option<&Instancing> {
        self.instancing.get(&node)
    }

    /// Application data of an object.
    pub(super) fn extras(
        &self,
        raw: &json::Extras,
        place: impl FnOnce() -> String,
    ) -> Result<Option<Value>, Fault> {
        let Some(raw) = raw else { return Ok(None) };
        let value = serde_json::from_str(raw.get());
        value.map(Some).map_err(|e| fault(place(), format!("extras cannot be read: {e}")))
    }

    /// The scene that is shown; `None` where the file has none.
    pub(super) fn default_scene(&self) -> Result<Option<&json::Scene>, Fault> {
        let scenes = &self.root.scenes;
        let Some(s) = self.root.scene.map(|s| s.value()).or((!scenes.is_empty()).then_some(0)) else {
            return Ok(None);
        };
        let found = scenes.get(s);
        found.map(Some).ok_or_else(|| fault("scene", format!("is {s}; there are {} scenes", scenes.len())))
    }

    /// What the file says about itself.
    pub(super) fn about(&self) -> Result<AssetInfo, Fault> {
        let asset = &self.root.asset;
        let scene = self.default_scene()?;
        Ok(AssetInfo {
            copyright: asset.copyright.clone().unwrap_or_default(),
            scene: scene.and_then(|s| s.name.clone()).unwrap_or_default(),
            asset_extras: self.extras(&asset.extras, || "asset".into())?,
            root_extras: self.extras(&self.root.extras, || "the file".into())?,
            scene_extras: match scene {
                Some(s) => self.extras(&s.extras, || "scene".into())?,
                None => None,
            },
        })
    }

    fn buffer(&self, i: usize, binary: Option<&'a [u8]>) -> Result<Cow<'a, [u8]>, Fault> {
        let buffer = &self.root.buffers[i];
        let place = format!("buffer {i}");
        let bytes: Cow<'a, [u8]> = match (&buffer.uri, binary) {
            (Some(uri), _) => {
                if buffer.byte_length.0 > self.limits.file_bytes {
                    let rule = format!(
                        "has {} bytes; it may have at most {} bytes",
                        buffer.byte_length.0, self.limits.file_bytes
                    );
                    return Err(fault(place, rule));
                }
                self.folder.read_uri(uri, self.limits.file_bytes, &place)?.into()
            }
            (None, Some(binary)) if i == 0 => binary.into(),
            _ => return Err(fault(place, "has no URI; only the binary chunk of a .glb may have none")),
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            return Err(fault(
                place,
                format!(
                    "byteLength {} is too large; it must be at most the {} bytes that exist",
                    buffer.byte_length.0,
                    bytes.len()
                ),
            ));
        }
        Ok(bytes)
    }

    /// The bytes of a buffer view.
    pub(super) fn view(&self, i: usize, user: &str) -> Result<&[u8], Fault> {
        let view = self.root.buffer_views.get(i).ok_or_else(|| {
            fault(
                user,
                format!("names bufferView {i}; there are {} bufferViews", self.root.buffer_views.len()),
            )
        })?;
        if let Some(decoded) = self.decoded.get(&i) {
            return Ok(decoded);
        }
        let (offset, length) = (view.byte_offset.map_or(0, |o| o.0), view.byte_length.0);
        self.part(view.buffer.value(), offset, length, || format!("bufferView {i}"))
    }

    /// Bytes of a buffer.
    pub(super) fn part(
        &self,
        b: usize,
        offset: u64,
        length: u64,
        place: impl Fn() -> String,
    ) -> Result<&[u8], Fault> {
        let buffer = self.buffers.get(b).ok_or_else(|| {
            fault(place(), format!("names buffer {b}; there are {} buffers", self.buffers.len()))
        })?;
        let available = (buffer.len() as u64).min(self.root.buffers[b].byte_length.0);
        match offset.checked_add(length) {
            Some(end) if end <= available => Ok(&buffer[offset as usize..end as usize]),
            _ => Err(fault(
                place(),
                format!(
                    "byteOffset {offset} + byteLength {length} does not fit into the {available} bytes of buffer {b}; it must"
                ),
            )),
        }
    }
}

/// Bounds the memory that parsing takes: the parsed form is larger than its text.
fn check_size(text: &[u8], limits: &Limits) -> Result<(), Fault> {
    if text.len() > limits.json_bytes {
        let rule = format!("has {} bytes; it may have at most {} bytes", text.len(), limits.json_bytes);
        return Err(fault("the JSON", rule));
    }
    let values = text.iter().filter(|&&b| b == b',').count();
    if values > limits.json_items.saturating_mul(16) {
        let rule = format!(
            "has {values} values; it may have at most {} values",
            limits.json_items.saturating_mul(16)
        );
        return Err(fault("the JSON", rule));
    }
    let items = text.iter().filter(|&&b| b == b'{' || b == b'[').count();
    if items > limits.json_items {
        let rule = format!(
            "has {items} objects and arrays; it may have at most {} objects and arrays",
            limits.json_items
        );
        return Err(fault("the JSON", rule));
    }
    Ok(())
}

/// What to do about a required extension that is not read.
fn instead(name: &str) -> &'static str {
    match name {
        "EXT_texture_avif" => {
            "; textures must be PNG, JPEG, WebP or KTX 2.0: convert them to one of these with the program that wrote the asset"
        }
        _ => "",
    }
}

/// The text as the typed document has a place for it: scenes name their nodes, of which they may have none, and there are no
/// channels of animations that name no node, as those of `KHR_animation_pointer`.
fn with_nodes<'a>(
    text: &'a [u8],
    (animations, scenes): (&[RawAnimation], &[RawScene]),
    warnings: &mut Vec<String>,
) -> Result<Cow<'a, [u8]>, serde_json::Error> {
    let named = |a: &RawAnimation| a.channels.iter().map(|c| c.target.node.is_some()).collect::<Vec<_>>();
    let named: Vec<Vec<bool>> = animations.iter().map(named).collect();
    if named.iter().flatten().all(|named| *named) && scenes.iter().all(|s| s.nodes.is_some()) {
        return Ok(text.into());
    }
    let mut json: Value = serde_json::from_slice(text)?;
    for scene in json.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
        }
    }
    for (a, named) in named.iter().enumerate() {
        let lost = named.iter().filter(|named| !**named).count();
        let channels = json.pointer_mut(&format!("/animations/{a}/channels")).and_then(Value::as_array_mut);
        if let (Some(channels), 1..) = (channels, lost) {
            let mut named = named.iter();
            channels.retain(|_| named.next().is_none_or(|named| *named));
            warnings.push(format!("animation {a}: channels that name no node are ignored: {lost}"));
        }
    }
    serde_json::to_vec(&json).map(Cow::from)
}

/// Refuses required extensions that are not read, and lists the others: those that the file declares and those that its
/// objects have undeclared.
fn check_extensions(root: &json::Root, inventory: &Inventory, scene: &mut Scene) -> Result<(), Fault> {
    for name in &root.extensions_required {
        if !SUPPORTED.contains(&name.as_str()) {
            return Err(fault(
                "extensionsRequired",
                format!("the extension `{}` is required and not supported{}", clip(name), instead(name)),
            ));
        }
    }
    let mut known: HashSet<&str> = SUPPORTED.iter().copied().collect();
    for name in root.extensions_used.iter().chain(&inventory.extensions) {
        if known.insert(name) {
            scene.warnings.push(format!("the extension {} is ignored", clip(name)));
            scene.ignored_extensions.push(clip(name));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn messages_of_the_json_reader_name_no_types() {
        let found = |text: &str| match serde_json::from_str::<super::Raw>(text) {
            Ok(_) => panic!("`{text}` was read"),
            Err(e) => super::without_types(&e.to_string()),
        };
        let of_lights = found(r#"{"extensions": 7}"#);
        assert!(of_lights.starts_with("invalid type: integer `7`, expected an object"), "{of_lights}");
        assert!(of_lights.contains("line 1"), "{of_lights}");
        assert_eq!(found("7"), "invalid type: integer `7`, expected an object at line 1 column 1");
        let said = super::without_types("unknown variant `x`, expected a struct of the enum that is told");
        assert_eq!(said, "unknown variant `x`, expected a struct of the enum that is told");
    }
}
