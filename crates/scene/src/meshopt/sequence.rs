//! Index sequences: each index is a difference from one of two that came before.

use super::reader::Reader;
use super::unzigzag;

/// Bytes after the last index, not read.
const TAIL: usize = 4;

/// The `count` indices of a stream.
pub(super) fn decode(stream: &[u8], count: usize) -> Result<Vec<u32>, String> {
    if stream.first() != Some(&0xd1) {
        return Err("does not begin with the byte 0xd1; a stream of INDICES must".into());
    }
    let body = stream.len().checked_sub(TAIL).filter(|end| *end >= 1).ok_or("the stream is truncated")?;
    if count > body - 1 {
        return Err(format!("claims {count} indices in {} bytes; each takes at least one byte", body - 1));
    }
    let mut reader = Reader::new(&stream[1..body]);
    let mut last = [0_u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let value = reader.varint()?;
        let base = &mut last[(value & 1) as usize];
        *base = base.wrapping_add(unzigzag(value >> 1));
        out.push(*base);
    }
    reader.finish()?;
    Ok(out)
}
