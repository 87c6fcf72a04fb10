//! Vertex streams: byte by byte, the differences between neighbouring elements in groups of 16 with as many bits as they need.

use super::reader::Reader;

/// Elements of a group.
const GROUP: usize = 16;
/// Least bytes of the tail, which holds the first element (and the channels of version 1).
const TAIL: [usize; 2] = [32, 24];
/// Bits per difference by the 2-bit code of a group: version 0, and version 1 with control 0 and 1.
const BITS: [[u32; 4]; 3] = [[0, 2, 4, 8], [0, 1, 2, 4], [1, 2, 4, 8]];

/// Elements of a block.
fn block_elements(stride: usize) -> usize {
    (8192 / stride / GROUP * GROUP).min(256)
}

/// The `count` elements of `stride` bytes of a stream of version 0 or 1, filters not applied.
pub(super) fn decode(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, String> {
    let version = match stream.first() {
        Some(0xa0) => 0,
        Some(0xa1) => 1,
        _ => return Err("does not begin with the byte 0xa0 or 0xa1; a stream of ATTRIBUTES must".into()),
    };
    let tail = stride + version * (stride / 4);
    let body = stream.len().checked_sub(tail.max(TAIL[version])).filter(|end| *end >= 1);
    let body = body.ok_or("the stream is truncated")?;
    let (first, channels) = stream[stream.len() - tail..].split_at(stride);
    if let Some(c) = channels.iter().find(|c| **c & 3 == 3) {
        return Err(format!("has the channel mode {c}; the low bits must be 0, 1 or 2"));
    }
    check_count(body - 1, count, stride, version)?;
    let mut reader = Reader::new(&stream[1..body]);
    let mut last = first.to_vec();
    let mut out = vec![0; count * stride];
    let most = block_elements(stride);
    let mut deltas = vec![0; stride * most];
    for block in out.chunks_mut(most * stride) {
        let elements = block.len() / stride;
        let row = elements.next_multiple_of(GROUP);
        read_block(&mut reader, version, elements, &mut deltas[..row * stride], stride)?;
        for at in (0..stride).step_by(4) {
            let channel = channels.get(at / 4).copied().unwrap_or(0);
            let lanes = &deltas[at * row..(at + 4) * row];
            for (e, element) in block.chunks_exact_mut(stride).enumerate() {
                let delta = [lanes[e], lanes[row + e], lanes[2 * row + e], lanes[3 * row + e]];
                let previous = [last[at], last[at + 1], last[at + 2], last[at + 3]];
                let value = add(previous, delta, channel);
                element[at..at + 4].copy_from_slice(&value);
                last[at..at + 4].copy_from_slice(&value);
            }
        }
    }
    reader.finish()?;
    Ok(out)
}

/// No stream of these bytes can hold fewer than the headers of its blocks.
fn check_count(bytes: usize, count: usize, stride: usize, version: usize) -> Result<(), String> {
    let most = block_elements(stride);
    let headers = |elements: usize| match version {
        0 => stride * elements.div_ceil(GROUP).div_ceil(4),
        _ => stride / 4,
    };
    let rest = if count.is_multiple_of(most) { 0 } else { headers(count % most) };
    let least = (count / most).saturating_mul(headers(most)).saturating_add(rest);
    if least > bytes {
        return Err(format!(
            "claims {count} elements of {stride} bytes in {bytes} bytes; they take at least {least}"
        ));
    }
    Ok(())
}

/// The differences of a block: one row of whole groups for each byte of an element.
fn read_block(
    reader: &mut Reader<'_>,
    version: usize,
    elements: usize,
    deltas: &mut [u8],
    stride: usize,
) -> Result<(), String> {
    let row = deltas.len() / stride;
    let groups = row / GROUP;
    let controls = if version == 0 { &[] } else { reader.take(stride / 4)? };
    for (byte, deltas) in deltas.chunks_exact_mut(row).enumerate() {
        let control = controls.get(byte / 4).map(|c| c >> (2 * (byte % 4)) & 3);
        let bits = match control {
            Some(2) => {
                deltas.fill(0);
                continue;
            }
            Some(3) => {
                deltas[..elements].copy_from_slice(reader.take(elements)?);
                deltas[elements..].fill(0);
                continue;
            }
            Some(c) => BITS[1 + usize::from(c)],
            None => BITS[0],
        };
        let codes = reader.take(groups.div_ceil(4))?;
        for (g, group) in deltas.chunks_exact_mut(GROUP).enumerate() {
            let code = codes[g / 4] >> (2 * (g % 4)) & 3;
            read_group(reader, bits[usize::from(code)], group)?;
        }
    }
    Ok(())
}

/// A group of numbers with `bits` each; the largest says that a whole byte follows.
fn read_group(reader: &mut Reader<'_>, bits: u32, group: &mut [u8]) -> Result<(), String> {
    if bits == 0 {
        group.fill(0);
        return Ok(());
    }
    let packed = reader.take(2 * bits as usize)?;
    if bits == 8 {
        group.copy_from_slice(packed);
        return Ok(());
    }
    let escape = (1_u8 << bits) - 1;
    for (i, value) in group.iter_mut().enumerate() {
        let (byte, shift) = place(i, bits);
        *value = packed[byte] >> shift & escape;
        if *value == escape {
            *value = reader.byte()?;
        }
    }
    Ok(())
}

/// Byte and shift of number `i` of a group: single bits from the low end, others from the high end.
fn place(i: usize, bits: u32) -> (usize, u32) {
    let per_byte = 8 / bits as usize;
    let within = (i % per_byte) as u32;
    (i / per_byte, if bits == 1 { within } else { 8 - bits * (within + 1) })
}

/// The next four bytes of an element from the previous ones.
fn add(previous: [u8; 4], delta: [u8; 4], channel: u8) -> [u8; 4] {
    match channel & 3 {
        1 => {
            let half = |k: usize| {
                let p = u16::from_le_bytes([previous[k], previous[k + 1]]);
                let d = u16::from_le_bytes([delta[k], delta[k + 1]]);
                p.wrapping_add((d >> 1) ^ (d & 1).wrapping_neg()).to_le_bytes()
            };
            let (low, high) = (half(0), half(2));
            [low[0], low[1], high[0], high[1]]
        }
        2 => {
            let turned = u32::from_le_bytes(delta).rotate_right(u32::from(channel >> 4));
            (u32::from_le_bytes(previous) ^ turned).to_le_bytes()
        }
        _ => std::array::from_fn(|k| {
            let d = delta[k];
            previous[k].wrapping_add((d >> 1) ^ (d & 1).wrapping_neg())
        }),
    }
}

/// A stream of version 0 of elements of `stride` bytes.
///
/// # Panics
/// If the stride is not a multiple of 4 from 4 to 256, or does not divide the number of bytes.
pub(crate) fn encode(elements: &[u8], stride: usize) -> Vec<u8> {
    assert!(stride > 0 && stride <= 256 && stride.is_multiple_of(4), "a stride of {stride} bytes");
    assert!(elements.len().is_multiple_of(stride), "whole elements");
    let mut out = vec![0xa0];
    let first = elements.get(..stride).map_or_else(|| vec![0; stride], <[u8]>::to_vec);
    let mut last = first.clone();
    for block in elements.chunks(block_elements(stride) * stride) {
        for (byte, last) in last.iter_mut().enumerate() {
            let mut deltas: Vec<u8> = Vec::with_capacity(256);
            for element in block.chunks_exact(stride) {
                let d = element[byte].wrapping_sub(*last);
                deltas.push((d << 1) ^ ((d as i8) >> 7) as u8);
                *last = element[byte];
            }
            deltas.resize(deltas.len().next_multiple_of(GROUP), 0);
            write_row(&deltas, &mut out);
        }
    }
    out.resize(out.len() + TAIL[0].saturating_sub(stride), 0);
    out.extend(first);
    out
}

/// The groups of one byte of a block, each with the bits that take the least room.
fn write_row(deltas: &[u8], out: &mut Vec<u8>) {
    let header = out.len();
    out.resize(header + (deltas.len() / GROUP).div_ceil(4), 0);
    for (g, group) in deltas.chunks_exact(GROUP).enumerate() {
        let size = |bits: u32| match bits {
            0 if group.iter().any(|d| *d > 0) => usize::MAX,
            0 => 0,
            8 => GROUP,
            _ => 2 * bits as usize + group.iter().filter(|d| u32::from(**d) >= (1 << bits) - 1).count(),
        };
        let code = (0..4).min_by_key(|c| size(BITS[0][*c])).unwrap_or(3);
        out[header + g / 4] |= (code as u8) << (2 * (g % 4));
        write_group(group, BITS[0][code], out);
    }
}

fn write_group(group: &[u8], bits: u32, out: &mut Vec<u8>) {
    match bits {
        0 => {}
        8 => out.extend_from_slice(group),
        _ => {
            let start = out.len();
            out.resize(start + 2 * bits as usize, 0);
            let escape = (1_u8 << bits) - 1;
            for (i, &value) in group.iter().enumerate() {
                let (byte, shift) = place(i, bits);
                out[start + byte] |= value.min(escape) << shift;
                if value >= escape {
                    out.push(value);
                }
            }
        }
    }
}
