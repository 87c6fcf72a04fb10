//! KTX 2.0 textures of Basis Universal, in Rust alone: an encoder of UASTC LDR 4x4, whose mip levels are the caller's own, and
//! a reader of UASTC and ETC1S.
//!
//! Graphics processors keep such textures compressed: readers turn a block of UASTC into one of BC7, ASTC or what else the
//! hardware samples. Of one file they take the levels as they are, so that prefiltered ones survive in every engine.
//!
//! ```
//! use photofit_ktx2::{Options, decode, encode};
//! let levels = [(4, 2, vec![[200, 100, 50, 255]; 8]), (2, 1, vec![[9, 9, 9, 255]; 2]), (1, 1, vec![[0, 0, 0, 255]])];
//! let file = encode(&levels, &Options::new(true))?;
//! assert_eq!(decode(&file, 0)?, levels[0]);
//! assert_eq!(decode(&file, 1)?, levels[1]);
//! # Ok::<(), photofit_ktx2::Ktx2Error>(())
//! ```
//!
//! Sources: the KTX 2.0 specification and the Data Format specification of Khronos, the "UASTC LDR 4x4 Texture Specification"
//! of Binomial. Blocks are fitted by least squares on the principal axis of each subset of their texels.

mod error;
mod read;
#[cfg(test)]
mod tests;
mod uastc;
mod write;
mod zstandard;

pub use error::Ktx2Error;
pub use read::{decode, is_ktx2, is_supercompressed, level_count, size};
pub use uastc::{Effort, encode_block};
pub use write::{Options, encode};

/// Texels of one mip level: width, height, and RGBA texels in raster order from the top.
pub type Level = (u32, u32, Vec<[u8; 4]>);

/// First bytes of every KTX 2.0 file.
const IDENTIFIER: [u8; 12] = [0xab, b'K', b'T', b'X', b' ', b'2', b'0', 0xbb, b'\r', b'\n', 0x1a, b'\n'];
/// Bytes from the start of a file to the index of levels.
const HEADER_BYTES: usize = 80;
/// Bytes of a level's entry in the index.
const INDEX_ENTRY_BYTES: usize = 24;
/// Bytes of a block of UASTC.
const BLOCK_BYTES: usize = 16;
/// Supercompression schemes.
const SCHEME_NONE: u32 = 0;
const SCHEME_BASIS_LZ: u32 = 1;
const SCHEME_ZSTANDARD: u32 = 2;
/// Colour models of the data format descriptor.
const MODEL_ETC1S: u32 = 163;
const MODEL_UASTC: u32 = 166;
