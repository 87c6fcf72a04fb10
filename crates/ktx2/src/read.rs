//! Reading KTX 2.0 files of Basis Universal.
//!
//! What the header claims is checked against the file before anything is allocated by it; blocks are decoded by `basisu`.

use crate::{
    BLOCK_BYTES, HEADER_BYTES, IDENTIFIER, INDEX_ENTRY_BYTES, Ktx2Error, Level, MODEL_ETC1S, MODEL_UASTC,
    SCHEME_BASIS_LZ, SCHEME_NONE, SCHEME_ZSTANDARD,
};
use basisu::{DecodeFlags, TargetFormat, Transcoder};

/// Greatest side that is read, texels.
const SIDE_MAX: u32 = 1 << 16;

/// Whether the bytes begin as a KTX 2.0 file does.
pub fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(&IDENTIFIER)
}

/// Width and height of the first level, texels: nothing is decoded.
///
/// # Errors
/// If the file's header is damaged, or the file is of a kind that is not read.
pub fn size(bytes: &[u8]) -> Result<(usize, usize), Ktx2Error> {
    Header::read(bytes).map(|h| (h.width as usize, h.height as usize))
}

/// Whether its levels are packed once more, by Zstandard or `BasisLZ`: a file then holds more texels than it has bytes.
///
/// # Errors
/// If the file's header is damaged, or the file is of a kind that is not read.
pub fn is_supercompressed(bytes: &[u8]) -> Result<bool, Ktx2Error> {
    Header::read(bytes).map(|h| h.scheme != SCHEME_NONE)
}

/// The number of mip levels, at least 1.
///
/// # Errors
/// If the file's header is damaged, or the file is of a kind that is not read.
pub fn level_count(bytes: &[u8]) -> Result<usize, Ktx2Error> {
    Header::read(bytes).map(|h| h.levels)
}

/// A mip level, 0 the largest. It takes some 8 bytes of memory for each texel of the level; ask [`size`] before.
///
/// # Errors
/// If the file is damaged, of a kind that is not read, or has no such level.
pub fn decode(bytes: &[u8], level: usize) -> Result<Level, Ktx2Error> {
    let header = Header::read(bytes)?;
    if level >= header.levels {
        return Err(invalid("the file", format!("has no mip level {level}; it has {}", header.levels)));
    }
    let damaged = |_| invalid("the file", format!("is damaged: mip level {level} cannot be decoded"));
    let (width, height) = header.level_size(level);
    let bytes = header.only_what_is_checked(bytes);
    let texture = Transcoder::new(&bytes).map_err(damaged)?;
    let samples =
        texture.transcode(level as u32, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(damaged)?;
    let texels = samples.as_chunks::<4>().0;
    if texels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(invalid(
            "the file",
            format!("is damaged: mip level {level} has other texels than its size"),
        ));
    }
    Ok((width, height, texels.to_vec()))
}

/// What texels would have to be turned or exchanged for, `KHR_texture_basisu` does not allow, and nothing here does.
///
/// # Errors
/// Another orientation than rows from the top, from the left, or channels in another order; key/value data beyond the file.
fn check_key_values(bytes: &[u8]) -> Result<(), Ktx2Error> {
    let broken = || invalid("the key/value data", "must be keys and values within the file".into());
    let [at, length] = [KEY_VALUES.start, KEY_VALUES.start + 4].map(|k| word(bytes, k) as usize);
    let mut rest = match at.checked_add(length) {
        _ if length == 0 => return Ok(()),
        Some(end) => bytes.get(at..end).ok_or_else(broken)?,
        None => return Err(broken()),
    };
    while !rest.is_empty() {
        let (size, pairs) = rest.split_first_chunk::<4>().ok_or_else(broken)?;
        let size = u32::from_le_bytes(*size) as usize;
        let pair = pairs.get(..size).ok_or_else(broken)?;
        let end = pair.iter().position(|b| *b == 0).ok_or_else(broken)?;
        let (key, value) = (&pair[..end], pair[end + 1..].strip_suffix(&[0]).unwrap_or(&pair[end + 1..]));
        for (name, wanted) in [("KTXorientation", "rd"), ("KTXswizzle", "rgba")] {
            if key == name.as_bytes() && value != wanted.as_bytes() {
                let found = String::from_utf8_lossy(value);
                return Err(Ktx2Error::Unsupported(format!(
                    "textures of {name} {found:?}; it must be {wanted:?}"
                )));
            }
        }
        rest = pairs.get(size.next_multiple_of(4)..).unwrap_or_default();
    }
    Ok(())
}

/// What a header says, once it is known to agree with the file.
struct Header {
    width: u32,
    height: u32,
    levels: usize,
    scheme: u32,
}

/// Places in the header: of the key/value data, and of the global data of `BasisLZ`.
const KEY_VALUES: core::ops::Range<usize> = 56..64;
const GLOBAL: core::ops::Range<usize> = 64..80;

fn invalid(place: &'static str, rule: String) -> Ktx2Error {
    Ktx2Error::Invalid { place, rule }
}

/// The little-endian word at a place that is known to exist.
fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(core::array::from_fn(|k| bytes[at + k]))
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(core::array::from_fn(|k| bytes[at + k]))
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, Ktx2Error> {
        if !is_ktx2(bytes) {
            return Err(invalid("the file", "is no KTX 2.0 file".into()));
        }
        if bytes.len() < HEADER_BYTES {
            return Err(invalid("the header", format!("must have {HEADER_BYTES} bytes")));
        }
        let [format, _, width, height, depth, layers, faces, levels, scheme] =
            core::array::from_fn(|k| word(bytes, IDENTIFIER.len() + 4 * k));
        if format != 0 {
            return Err(Ktx2Error::Unsupported(format!("textures of the Vulkan format {format}")));
        }
        if depth > 0 || layers > 1 || faces != 1 {
            return Err(Ktx2Error::Unsupported("volumes, arrays and cube maps".into()));
        }
        if !(1..=SIDE_MAX).contains(&width) || !(1..=SIDE_MAX).contains(&height) {
            let rule = format!("is {width} x {height}; sides must be in 1..={SIDE_MAX}");
            return Err(invalid("the size", rule));
        }
        let most = width.max(height).ilog2() + 1;
        if !(1..=most).contains(&levels) {
            let rule = format!("is {levels}; it must be in 1..={most} for {width} x {height} texels");
            return Err(invalid("the number of mip levels", rule));
        }
        let header = Self { width, height, levels: levels as usize, scheme };
        let model = header.model(bytes)?;
        match (model, scheme) {
            (MODEL_ETC1S, SCHEME_BASIS_LZ) | (MODEL_UASTC, SCHEME_NONE | SCHEME_ZSTANDARD) => {}
            (MODEL_ETC1S | MODEL_UASTC, other) => {
                return Err(Ktx2Error::Unsupported(format!("textures of supercompression scheme {other}")));
            }
            (other, _) => return Err(Ktx2Error::Unsupported(format!("textures of colour model {other}"))),
        }
        let [at, length] = [GLOBAL.start, GLOBAL.start + 8].map(|k| long(bytes, k));
        if scheme == SCHEME_BASIS_LZ && at.checked_add(length).is_none_or(|end| end > bytes.len() as u64) {
            return Err(invalid("the global data", "must lie within the file".into()));
        }
        header.check_levels(bytes, scheme)?;
        check_key_values(bytes)?;
        Ok(header)
    }

    /// The file without key/value data, which nothing here needs, and without global data where none is in use: the decoder
    /// trusts their places.
    fn only_what_is_checked(&self, bytes: &[u8]) -> Vec<u8> {
        let mut out = bytes.to_vec();
        out[KEY_VALUES].fill(0);
        if self.scheme != SCHEME_BASIS_LZ {
            out[GLOBAL].fill(0);
        }
        out
    }

    fn level_size(&self, level: usize) -> (u32, u32) {
        ((self.width >> level).max(1), (self.height >> level).max(1))
    }

    /// The colour model that the data format descriptor names.
    fn model(&self, bytes: &[u8]) -> Result<u32, Ktx2Error> {
        let (at, length) = (word(bytes, 48) as usize, word(bytes, 52) as usize);
        if length < 44 || at.checked_add(length).is_none_or(|end| end > bytes.len()) {
            return Err(invalid("the data format descriptor", "must have 44 bytes within the file".into()));
        }
        if word(bytes, at + 12) >> 24 & 1 == 1 {
            return Err(Ktx2Error::Unsupported("textures whose colours are multiplied by alpha".into()));
        }
        Ok(word(bytes, at + 12) & 0xff)
    }

    fn check_levels(&self, bytes: &[u8], scheme: u32) -> Result<(), Ktx2Error> {
        let index_end = HEADER_BYTES + self.levels * INDEX_ENTRY_BYTES;
        if index_end > bytes.len() {
            return Err(invalid("the index of levels", format!("must have {} entries", self.levels)));
        }
        for level in 0..self.levels {
            let [offset, length, whole] =
                [0, 8, 16].map(|k| long(bytes, HEADER_BYTES + level * INDEX_ENTRY_BYTES + k));
            if offset.checked_add(length).is_none_or(|end| end > bytes.len() as u64) {
                return Err(invalid(
                    "the index of levels",
                    format!("has level {level} beyond the file's end"),
                ));
            }
            let (width, height) = self.level_size(level);
            let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
            let must = if scheme == SCHEME_BASIS_LZ { 0 } else { blocks * BLOCK_BYTES as u64 };
            if whole != must {
                let rule = format!("says that level {level} has {whole} bytes; it must be {must}");
                return Err(invalid("the index of levels", rule));
            }
        }
        Ok(())
    }
}
