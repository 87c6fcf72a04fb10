//! The chunks of a `.glb` file.

use crate::error::{Fault, fault};

/// The JSON chunk and the binary chunk.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let version = word(bytes, 4).ok_or_else(|| truncated(bytes, 12))?;
    let length = word(bytes, 8).ok_or_else(|| truncated(bytes, 12))? as usize;
    if version != 2 {
        return Err(fault("byte 4 of the .glb header", format!("the version is {version}; it must be 2")));
    }
    if length > bytes.len() {
        return Err(fault(
            "byte 8 of the .glb header",
            format!("the length is {length} bytes; it must be at most the file's {}", bytes.len()),
        ));
    }
    let bytes = &bytes[..length];
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at < bytes.len() {
        let size = word(bytes, at).ok_or_else(|| truncated(bytes, at + 8))? as usize;
        let kind = word(bytes, at + 4).ok_or_else(|| truncated(bytes, at + 8))?;
        let data = bytes.get(at + 8..).and_then(|b| b.get(..size)).ok_or_else(|| {
            fault(
                format!("byte {at} of the .glb"),
                format!(
                    "a chunk of {size} bytes does not fit into the {} that follow; it must",
                    bytes.len() - at - 8
                ),
            )
        })?;
        match kind {
            0x4e4f_534a if json.is_none() => json = Some(data),
            0x004e_4942 if json.is_some() && binary.is_none() => binary = Some(data),
            _ => {}
        }
        at += 8 + size;
    }
    let json = json.ok_or_else(|| {
        fault("byte 12 of the .glb", "there is no JSON chunk; the first chunk must be JSON")
    })?;
    Ok((json, binary))
}

fn truncated(bytes: &[u8], needed: usize) -> Fault {
    fault(
        format!("byte {} of the .glb", bytes.len()),
        format!("the file is truncated: it must have at least {needed} bytes"),
    )
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let b = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}
