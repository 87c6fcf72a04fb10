//! Quantized ranges of endpoint values (Bounded Integer Sequence Encoding).
//!
//! An endpoint value in a block is a code of one of the ASTC ranges: some
//! plain low bits and, in most ranges, one trit (0..=2) or one quint (0..=4)
//! above them. The ASTC section of the Khronos Data Format specification
//! ("Endpoint Unquantization") gives the 8-bit value of every code; UASTC
//! LDR 4x4 takes those values as they are.

/// One range: how a code splits, and the 8-bit values it can name.
///
/// Values are kept in rising order. The place of a value in that order is
/// its *rank*; fits work with ranks, packed blocks hold codes.
#[derive(Debug)]
pub(crate) struct Range {
    /// Number of plain low bits of a code.
    pub(crate) bits: u32,
    /// 3 where the upper part is a trit, 5 where it is a quint, 1 where there is none.
    pub(crate) base: u32,
    /// Number of values.
    pub(crate) levels: usize,
    /// 8-bit value of each rank.
    pub(crate) value: [u8; 256],
    /// Code of each rank.
    pub(crate) code: [u8; 256],
    /// Rank of each code.
    pub(crate) rank: [u8; 256],
    /// For each 8-bit value, the greatest rank whose value is not above it.
    pub(crate) floor: [u8; 256],
}

impl Range {
    /// Builds a range. `scatter` names, from the top bit of the nine-bit
    /// number `B` of the specification, the code bit ('b' is bit 1) that it
    /// copies, or '0'; `factor` is the number `C`.
    const fn new(bits: u32, base: u32, scatter: &[u8; 9], factor: u32) -> Self {
        let levels = (base as usize) << bits;
        let mut code_of = [usize::MAX; 256];
        let mut code = 0;
        while code < levels {
            code_of[unquantize(code as u32, bits, base, scatter, factor) as usize] = code;
            code += 1;
        }
        let mut range =
            Self { bits, base, levels, value: [0; 256], code: [0; 256], rank: [0; 256], floor: [0; 256] };
        let mut found = 0;
        let mut value = 0;
        while value < 256 {
            if code_of[value] != usize::MAX {
                range.value[found] = value as u8;
                range.code[found] = code_of[value] as u8;
                range.rank[code_of[value]] = found as u8;
                found += 1;
            }
            range.floor[value] = (found - 1) as u8;
            value += 1;
        }
        assert!(found == levels);
        range
    }

    /// 8-bit value of a code.
    #[inline]
    pub(crate) fn value_of_code(&self, code: u8) -> u8 {
        self.value[self.rank[code as usize] as usize]
    }
}

/// 8-bit value of a code, after the ASTC rules.
const fn unquantize(code: u32, bits: u32, base: u32, scatter: &[u8; 9], factor: u32) -> u32 {
    let low = code & ((1 << bits) - 1);
    if base == 1 {
        // Repeat the bits downward until all eight are filled.
        let mut value = 0;
        let mut shift = 8 - bits as i32;
        while shift > -(bits as i32) {
            value |= if shift >= 0 { low << shift } else { low >> -shift };
            shift -= bits as i32;
        }
        return value & 255;
    }
    let high = code >> bits;
    let mut b = 0;
    let mut i = 0;
    while i < 9 {
        b <<= 1;
        if scatter[i] != b'0' {
            b |= (low >> (scatter[i] - b'a')) & 1;
        }
        i += 1;
    }
    let a = if low & 1 == 1 { 0x1ff } else { 0 };
    let t = (high * factor + b) ^ a;
    (a & 0x80) | (t >> 2)
}

/// 12 values.
pub(crate) static RANGE_12: Range = Range::new(2, 3, b"b000b0bb0", 93);
/// 16 values.
pub(crate) static RANGE_16: Range = Range::new(4, 1, b"000000000", 0);
/// 32 values.
pub(crate) static RANGE_32: Range = Range::new(5, 1, b"000000000", 0);
/// 40 values.
pub(crate) static RANGE_40: Range = Range::new(3, 5, b"cb0000cbc", 26);
/// 48 values.
pub(crate) static RANGE_48: Range = Range::new(4, 3, b"dcb000dcb", 22);
/// 160 values.
pub(crate) static RANGE_160: Range = Range::new(5, 5, b"edcb0000e", 6);
/// 192 values.
pub(crate) static RANGE_192: Range = Range::new(6, 3, b"fedcb000f", 5);
/// 256 values.
pub(crate) static RANGE_256: Range = Range::new(8, 1, b"000000000", 0);
