//! Blocks of UASTC LDR 4x4: 16 texels in 128 bits, in one of 19 modes.

mod attempt;
mod axis;
pub(crate) mod block;
mod divide;
mod ends;
mod fit;
pub(crate) mod hints;
pub(crate) mod mode;
mod partition;
mod range;
pub(crate) mod rdo;
mod search;
mod weights;

pub use search::Effort;
pub(crate) use search::{Found, search};

/// Encodes a block of 4 x 4 RGBA texels, in raster order, into the 16 bytes of UASTC with the least squared error among
/// those that `effort` tries.
pub fn encode_block(texels: &[[u8; 4]; 16], effort: Effort) -> [u8; 16] {
    search(texels, effort).pack(true)
}
