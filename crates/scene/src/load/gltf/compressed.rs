//! Buffer views that are compressed: `EXT_meshopt_compression` and `KHR_meshopt_compression`.

use super::document::Document;
use crate::error::{Fault, fault};
use crate::load::file::clip;
use crate::meshopt::{self, Filter, Mode};
use rayon::prelude::*;
use serde::Deserialize;
use std::collections::HashMap;

/// What the typed document leaves out of a buffer.
#[derive(Deserialize)]
pub(super) struct RawBuffer {
    extensions: Option<BufferExtensions>,
}

#[derive(Deserialize)]
struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    ext: Option<Fallback>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr: Option<Fallback>,
}

#[derive(Deserialize)]
struct Fallback {
    #[serde(default)]
    fallback: bool,
}

impl RawBuffer {
    /// Whether the buffer only stands for bytes that are decoded from others.
    pub(super) fn is_fallback(&self) -> bool {
        self.extensions.as_ref().is_some_and(|e| e.ext.iter().chain(&e.khr).any(|m| m.fallback))
    }
}

/// What the typed document leaves out of a buffer view.
#[derive(Deserialize)]
pub(super) struct RawView {
    #[serde(default, rename = "byteLength")]
    byte_length: u64,
    #[serde(rename = "byteStride")]
    byte_stride: Option<u64>,
    extensions: Option<ViewExtensions>,
}

#[derive(Deserialize)]
struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    ext: Option<Meshopt>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr: Option<Meshopt>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Meshopt {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: u64,
    count: u64,
    mode: String,
    filter: Option<String>,
}

/// The bytes of all compressed buffer views, by index. Together with the `stored` bytes of buffers they may have
/// `limits.file_bytes`.
pub(super) fn decode(
    document: &Document<'_>,
    views: &[RawView],
    stored: u64,
) -> Result<HashMap<usize, Vec<u8>>, Fault> {
    let mut total = stored;
    let mut compressed = Vec::new();
    for (i, view) in views.iter().enumerate() {
        let Some(meshopt) = view.extensions.as_ref().and_then(|e| e.khr.as_ref().or(e.ext.as_ref())) else {
            continue;
        };
        if let Some(stride) =
            view.byte_stride.filter(|s| meshopt.mode == "ATTRIBUTES" && *s != meshopt.byte_stride)
        {
            let rule = format!(
                "byteStride is {stride}; it must be {}, that of what is compressed",
                meshopt.byte_stride
            );
            return Err(fault(format!("bufferView {i}"), rule));
        }
        let bytes = meshopt.count.checked_mul(meshopt.byte_stride);
        if bytes != Some(view.byte_length) {
            let rule = format!(
                "byteLength is {}; it must be count {} times byteStride {}, as they are compressed",
                view.byte_length, meshopt.count, meshopt.byte_stride
            );
            return Err(fault(format!("bufferView {i}"), rule));
        }
        total = total.saturating_add(view.byte_length);
        if total > document.limits.file_bytes {
            let most = document.limits.file_bytes;
            let rule = format!(
                "buffers and what is decoded from them have {total} bytes up to here; there may be at most {most} bytes"
            );
            return Err(fault(format!("bufferView {i}"), rule));
        }
        compressed.push((i, meshopt));
    }
    let decoded: Vec<Result<_, Fault>> =
        compressed.into_par_iter().map(|(i, meshopt)| Ok((i, decode_view(document, i, meshopt)?))).collect();
    decoded.into_iter().collect()
}

fn decode_view(document: &Document<'_>, i: usize, m: &Meshopt) -> Result<Vec<u8>, Fault> {
    let place = || format!("bufferView {i} (compressed)");
    let stream = document.part(m.buffer, m.byte_offset, m.byte_length, place)?;
    let mode = match m.mode.as_str() {
        "ATTRIBUTES" => Mode::Attributes,
        "TRIANGLES" => Mode::Triangles,
        "INDICES" => Mode::Indices,
        other => {
            let rule = format!("mode is `{}`; it must be ATTRIBUTES, TRIANGLES or INDICES", clip(other));
            return Err(fault(place(), rule));
        }
    };
    let name = m.filter.as_deref().unwrap_or("NONE");
    let filter = Filter::of(name).ok_or_else(|| {
        let rule = "it must be NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR";
        fault(place(), format!("filter is `{}`; {rule}", clip(name)))
    })?;
    // Both fit: their product is at most the limit of bytes, or one of them is 0.
    let (count, stride) = (usize::try_from(m.count), usize::try_from(m.byte_stride));
    let (Ok(count), Ok(stride)) = (count, stride) else {
        return Err(fault(place(), "count and byteStride are too large; they must fit this machine"));
    };
    meshopt::decode(stream, mode, filter, count, stride).map_err(|rule| fault(place(), rule))
}
