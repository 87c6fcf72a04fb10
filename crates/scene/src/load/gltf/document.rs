//! The JSON document and its buffers.

use crate::error::{Fault, fault};
use crate::load::Limits;
use crate::load::file::{Folder, clip};
use gltf::json;
use std::borrow::Cow;

/// Extensions whose meaning is read here.
const SUPPORTED: &[&str] = &[
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// A parsed document with its buffers in memory.
#[derive(Debug)]
pub(super) struct Document<'a> {
    pub(super) root: json::Root,
    /// The `materials` array as it stands: the typed one lacks the texture transforms of some slots.
    pub(super) materials: Vec<serde_json::Value>,
    pub(super) buffers: Vec<Cow<'a, [u8]>>,
    pub(super) folder: &'a Folder,
    pub(super) limits: &'a Limits,
}

#[derive(serde::Deserialize)]
struct RawMaterials {
    #[serde(default)]
    materials: Vec<serde_json::Value>,
}

impl<'a> Document<'a> {
    pub(super) fn new(
        text: &[u8],
        binary: Option<&'a [u8]>,
        folder: &'a Folder,
        limits: &'a Limits,
        warnings: &mut Vec<String>,
    ) -> Result<Self, Fault> {
        check_size(text, limits)?;
        let syntax = |e: serde_json::Error| fault("the JSON", e.to_string());
        let root: json::Root = serde_json::from_slice(text).map_err(syntax)?;
        let RawMaterials { materials } = serde_json::from_slice(text).map_err(syntax)?;
        if !root.asset.version.starts_with("2.") {
            return Err(fault(
                "asset.version",
                format!("the version is 2.x, found `{}`", clip(&root.asset.version)),
            ));
        }
        check_extensions(&root, warnings)?;
        let mut document = Self { root, materials, buffers: Vec::new(), folder, limits };
        let mut total = 0_u64;
        for i in 0..document.root.buffers.len() {
            let bytes = document.buffer(i, binary)?;
            total = total.saturating_add(bytes.len() as u64);
            if total > limits.file_bytes {
                let rule = format!("all buffers have at most {} bytes", limits.file_bytes);
                return Err(fault(format!("buffer {i}"), rule));
            }
            document.buffers.push(bytes);
        }
        Ok(document)
    }

    fn buffer(&self, i: usize, binary: Option<&'a [u8]>) -> Result<Cow<'a, [u8]>, Fault> {
        let buffer = &self.root.buffers[i];
        let place = format!("buffer {i}");
        let bytes: Cow<'a, [u8]> = match (&buffer.uri, binary) {
            (Some(uri), _) => {
                if buffer.byte_length.0 > self.limits.file_bytes {
                    let rule = format!("at most {} bytes", self.limits.file_bytes);
                    return Err(fault(place, rule));
                }
                self.folder.read_uri(uri, self.limits.file_bytes, &place)?.into()
            }
            (None, Some(binary)) if i == 0 => binary.into(),
            _ => return Err(fault(place, "a buffer without a URI is the binary chunk of a .glb")),
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            return Err(fault(
                place,
                format!(
                    "byteLength {} is at most the {} bytes that exist",
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
            fault(user, format!("bufferView {i} is one of {}", self.root.buffer_views.len()))
        })?;
        let place = || format!("bufferView {i}");
        let b = view.buffer.value();
        let buffer = self
            .buffers
            .get(b)
            .ok_or_else(|| fault(place(), format!("buffer {b} is one of {}", self.buffers.len())))?;
        let (offset, length) = (view.byte_offset.map_or(0, |o| o.0), view.byte_length.0);
        let available = (buffer.len() as u64).min(self.root.buffers[b].byte_length.0);
        match offset.checked_add(length) {
            Some(end) if end <= available => Ok(&buffer[offset as usize..end as usize]),
            _ => Err(fault(
                place(),
                format!(
                    "byteOffset {offset} + byteLength {length} fits into the {available} bytes of buffer {b}"
                ),
            )),
        }
    }
}

/// Bounds the memory that parsing takes: the parsed form is larger than its text.
fn check_size(text: &[u8], limits: &Limits) -> Result<(), Fault> {
    if text.len() > limits.json_bytes {
        let rule = format!("at most {} bytes, found {}", limits.json_bytes, text.len());
        return Err(fault("the JSON", rule));
    }
    let values = text.iter().filter(|&&b| b == b',').count();
    if values > limits.json_items.saturating_mul(16) {
        let rule = format!("at most {} values, found {values}", limits.json_items.saturating_mul(16));
        return Err(fault("the JSON", rule));
    }
    let items = text.iter().filter(|&&b| b == b'{' || b == b'[').count();
    if items > limits.json_items {
        let rule = format!("at most {} objects and arrays, found {items}", limits.json_items);
        return Err(fault("the JSON", rule));
    }
    Ok(())
}

fn check_extensions(root: &json::Root, warnings: &mut Vec<String>) -> Result<(), Fault> {
    for name in &root.extensions_required {
        if !SUPPORTED.contains(&name.as_str()) {
            return Err(fault(
                "extensionsRequired",
                format!("the extension `{}` is required and not supported", clip(name)),
            ));
        }
    }
    for name in &root.extensions_used {
        if !SUPPORTED.contains(&name.as_str()) {
            warnings.push(format!("the extension {} is ignored", clip(name)));
        }
    }
    if !root.animations.is_empty() {
        warnings
            .push(format!("{} animations are ignored: the default pose is loaded", root.animations.len()));
    }
    Ok(())
}
