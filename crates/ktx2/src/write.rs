//! KTX 2.0 files of UASTC LDR 4x4 textures.
//!
//! Layout after the KTX 2.0 specification of Khronos: identifier, header,
//! index of levels (largest first), data format descriptor, key/value data,
//! then the levels' data, smallest first. The descriptor is a basic one of
//! the Khronos Data Format specification with the colour model UASTC.

use crate::uastc::rdo::optimize;
use crate::uastc::{Effort, Found, search};
use crate::zstandard::compress;
use crate::{
    BLOCK_BYTES, HEADER_BYTES, IDENTIFIER, INDEX_ENTRY_BYTES, Ktx2Error, Level, MODEL_UASTC, SCHEME_NONE,
    SCHEME_ZSTANDARD,
};
use rayon::prelude::*;

/// Bytes of the data format descriptor.
const DESCRIPTOR_BYTES: usize = 44;
/// Blocks that are weighed against each other for their bytes; strips of so many are independent.
const STRIP: usize = 4096;

/// How to encode a file.
#[derive(Clone, Debug)]
pub struct Options {
    /// Whether red, green and blue are sRGB encoded (else linear).
    pub srgb: bool,
    /// How much is tried for each block.
    pub effort: Effort,
    /// Whether blocks carry hints made for them, which transcoders to ETC1 and
    /// ETC2 need for good results. Without, files compress better; BC7, BC1-5,
    /// ASTC and RGBA are the same.
    pub etc_hints: bool,
    /// Level of Zstandard supercompression, 1..=22, or none.
    pub zstandard: Option<i32>,
    /// Squared error of a block that a saved bit is worth; 0 is the least error, 10 a
    /// third of the bytes for some 8 dB.
    pub rdo_lambda: f32,
    /// Value of the `KTXwriter` key.
    pub writer: String,
}

impl Options {
    /// The usual options for colour (`srgb`) or other data.
    pub fn new(srgb: bool) -> Self {
        Self {
            srgb,
            effort: Effort::Normal,
            etc_hints: true,
            zstandard: Some(19),
            rdo_lambda: 0.0,
            writer: concat!("photofit ", env!("CARGO_PKG_VERSION")).into(),
        }
    }
}

/// Encodes mip levels, largest first, into a KTX 2.0 file; each level is encoded from its own texels.
///
/// # Errors
/// Where a level's size is not `max(1, first >> level)` or its texels do not
/// fill it, and for options out of range.
pub fn encode(levels: &[Level], options: &Options) -> Result<Vec<u8>, Ktx2Error> {
    check(levels, options)?;
    let alpha = levels.iter().any(|(.., texels)| texels.iter().any(|t| t[3] != 255));
    let blocks: Vec<Vec<u8>> = levels.iter().map(|level| encode_level(level, options)).collect();
    Ok(assemble((levels[0].0, levels[0].1), blocks, alpha, options))
}

/// The blocks of one level, row by row from the top. Blocks over the right
/// and lower edges repeat the last texels.
pub(crate) fn encode_level((width, height, texels): &Level, options: &Options) -> Vec<u8> {
    let (width, height) = (*width as usize, *height as usize);
    let blocks: Vec<[[u8; 4]; 16]> = (0..height.div_ceil(4))
        .flat_map(|by| (0..width.div_ceil(4)).map(move |bx| (bx, by)))
        .map(|(bx, by)| {
            core::array::from_fn(|i| {
                let x = (bx * 4 + i % 4).min(width - 1);
                let y = (by * 4 + i / 4).min(height - 1);
                texels[y * width + x]
            })
        })
        .collect();
    let mut found: Vec<Found> = blocks.par_iter().map(|b| search(b, options.effort)).collect();
    if options.rdo_lambda > 0.0 {
        let strips = blocks.par_chunks(STRIP).zip(found.par_chunks(STRIP));
        let strips: Vec<Vec<Found>> = strips.map(|(b, f)| optimize(b, f, options.rdo_lambda)).collect();
        found = strips.concat();
    }
    let packed: Vec<[u8; BLOCK_BYTES]> = found.par_iter().map(|f| f.pack(options.etc_hints)).collect();
    packed.concat()
}

fn check(levels: &[Level], options: &Options) -> Result<(), Ktx2Error> {
    let Some(&(width, height, _)) = levels.first() else { return Err(Ktx2Error::NoLevels) };
    if width == 0 || height == 0 {
        let expected = (width.max(1), height.max(1));
        return Err(Ktx2Error::LevelSize { level: 0, found: (width, height), expected });
    }
    let most = width.max(height).ilog2() as usize + 1;
    if levels.len() > most {
        return Err(Ktx2Error::TooManyLevels { count: levels.len(), most, width, height });
    }
    for (level, (w, h, texels)) in levels.iter().enumerate() {
        let expected = ((width >> level).max(1), (height >> level).max(1));
        if (*w, *h) != expected {
            return Err(Ktx2Error::LevelSize { level, found: (*w, *h), expected });
        }
        let count = u64::from(*w) * u64::from(*h);
        if texels.len() as u64 != count {
            return Err(Ktx2Error::TexelCount { level, found: texels.len(), expected: count });
        }
    }
    if let Some(level) = options.zstandard.filter(|l| !(1..=22).contains(l)) {
        return Err(Ktx2Error::ZstandardLevel(level));
    }
    if !options.rdo_lambda.is_finite() || options.rdo_lambda < 0.0 {
        return Err(Ktx2Error::Lambda(options.rdo_lambda));
    }
    Ok(())
}

/// Puts a file together from the size of the first level and the blocks of
/// every level. `alpha` says whether the texture has an alpha channel.
pub(crate) fn assemble(
    (width, height): (u32, u32),
    levels: Vec<Vec<u8>>,
    alpha: bool,
    options: &Options,
) -> Vec<u8> {
    let sizes: Vec<usize> = levels.iter().map(Vec::len).collect();
    let data: Vec<Vec<u8>> = match options.zstandard {
        Some(level) => levels.par_iter().map(|blocks| compress(blocks, level)).collect(),
        None => levels,
    };
    let descriptor_at = HEADER_BYTES + INDEX_ENTRY_BYTES * data.len();
    let pairs = key_values(&options.writer);
    let pairs_at = descriptor_at + DESCRIPTOR_BYTES;
    // Levels of whole blocks start at multiples of a block; supercompressed
    // ones stand without gaps.
    let alignment = if options.zstandard.is_some() { 1 } else { BLOCK_BYTES };
    let mut at = pairs_at + pairs.len();
    let mut offsets = vec![0; data.len()];
    for (offset, bytes) in offsets.iter_mut().zip(&data).rev() {
        at = at.next_multiple_of(alignment);
        *offset = at;
        at += bytes.len();
    }
    let mut out = Vec::with_capacity(at);
    out.extend(IDENTIFIER);
    let scheme = if options.zstandard.is_some() { SCHEME_ZSTANDARD } else { SCHEME_NONE };
    // Format undefined, type size 1, size, depth, layers, faces, levels, scheme.
    let head = [0, 1, width, height, 0, 0, 1, data.len() as u32, scheme];
    let index = [descriptor_at, DESCRIPTOR_BYTES, pairs_at, pairs.len()].map(|v| v as u32);
    out.extend(head.into_iter().chain(index).flat_map(u32::to_le_bytes));
    // No supercompression global data.
    out.extend([0; 16]);
    for ((offset, bytes), size) in offsets.iter().zip(&data).zip(sizes) {
        let entry = [*offset, bytes.len(), size].map(|v| v as u64);
        out.extend(entry.into_iter().flat_map(u64::to_le_bytes));
    }
    out.extend(descriptor(options.srgb, alpha));
    out.extend(pairs);
    for (offset, bytes) in offsets.iter().zip(&data).rev() {
        out.resize(*offset, 0);
        out.extend(bytes);
    }
    out
}

/// Data format descriptor: one sample that is the whole block.
fn descriptor(srgb: bool, alpha: bool) -> Vec<u8> {
    const PRIMARIES_BT709: u32 = 1;
    const TRANSFER_LINEAR: u32 = 1;
    const TRANSFER_SRGB: u32 = 2;
    const CHANNEL_RGBA: u32 = 3;
    let (primaries, transfer) = if srgb { (PRIMARIES_BT709, TRANSFER_SRGB) } else { (0, TRANSFER_LINEAR) };
    let channel = if alpha { CHANNEL_RGBA } else { 0 };
    let words = [
        DESCRIPTOR_BYTES as u32,
        0,                                             // Khronos, basic descriptor
        2 | (DESCRIPTOR_BYTES as u32 - 4) << 16,       // version and size
        MODEL_UASTC | primaries << 8 | transfer << 16, // straight alpha
        3 | 3 << 8,                                    // blocks of 4 x 4 texels
        BLOCK_BYTES as u32,                            // bytes of the first plane
        0,
        127 << 16 | channel << 24, // bit 0, 128 bits
        0,                         // position
        0,                         // least value
        u32::MAX,                  // greatest value
    ];
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// Key/value data: orientation and writer, sorted by key.
fn key_values(writer: &str) -> Vec<u8> {
    let mut out = Vec::new();
    for (key, value) in [("KTXorientation", "rd"), ("KTXwriter", writer)] {
        let length = key.len() + value.len() + 2;
        out.extend((length as u32).to_le_bytes());
        out.extend(key.bytes().chain([0]).chain(value.bytes()).chain([0]));
        out.resize(out.len().next_multiple_of(4), 0);
    }
    out
}
