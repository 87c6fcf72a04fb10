//! The bitstreams of `EXT_meshopt_compression` and `KHR_meshopt_compression`: vertices, triangles and index sequences, and
//! the filters over vertices.
//!
//! Both extensions are specified at Khronos (`references.bib`: `khronos_meshopt`). Decoders take bytes from untrusted files:
//! the claimed size is compared with the smallest stream that could hold it before memory is taken.

mod filter;
mod reader;
mod sequence;
#[cfg(test)]
mod tests;
mod triangles;
mod vertices;

pub(crate) use filter::{Filter, exponential, octahedral};
pub(crate) use triangles::encode as encode_triangles;
pub(crate) use vertices::encode as encode_vertices;

/// What a stream holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Elements of `stride` bytes.
    Attributes,
    /// Indices of triangles.
    Triangles,
    /// Indices in any order.
    Indices,
}

/// Decodes a stream to `count` elements of `stride` bytes, little-endian.
///
/// # Errors
/// If the stream breaks a rule; the message says which.
pub(crate) fn decode(
    stream: &[u8],
    mode: Mode,
    filter: Filter,
    count: usize,
    stride: usize,
) -> Result<Vec<u8>, String> {
    match mode {
        Mode::Attributes => {
            if stride == 0 || !stride.is_multiple_of(4) || stride > 256 {
                return Err(format!("byteStride is {stride}; it must be a multiple of 4 from 4 to 256"));
            }
            filter.check(stride)?;
            let mut out = vertices::decode(stream, count, stride)?;
            filter.apply(&mut out, stride);
            Ok(out)
        }
        Mode::Triangles | Mode::Indices => {
            if filter != Filter::None {
                return Err("has a filter; only the mode ATTRIBUTES may have one".into());
            }
            if stride != 2 && stride != 4 {
                return Err(format!("byteStride is {stride}; it must be 2 or 4 for indices"));
            }
            let indices = match mode {
                Mode::Triangles => triangles::decode(stream, count)?,
                _ => sequence::decode(stream, count)?,
            };
            if stride == 4 {
                return Ok(indices.iter().flat_map(|i| i.to_le_bytes()).collect());
            }
            if let Some(i) = indices.iter().find(|i| **i > 0xffff) {
                return Err(format!("has the index {i}; indices of 2 bytes must be at most 65535"));
            }
            Ok(indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect())
        }
    }
}

/// A signed number from its zigzag form: 0, -1, 1, -2, 2.
fn unzigzag(v: u32) -> u32 {
    (v >> 1) ^ (v & 1).wrapping_neg()
}

/// The zigzag form of a difference modulo 2^32.
fn zigzag(v: u32) -> u32 {
    (v << 1) ^ ((v as i32) >> 31) as u32
}
