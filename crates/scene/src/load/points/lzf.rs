//! Expanding LZF, the compression of binary PCD files.
//!
//! A control byte below 32 announces that many literal bytes and one more. Any other one is a copy from what was
//! already written: the upper three bits are the length less 2 (7: a further byte is added), the lower five bits and
//! the next byte the distance less 1.

/// Expands `input` to exactly `length` bytes; `None` if it is broken or expands to another length.
///
/// At most `length` bytes are taken.
pub(super) fn expand(input: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(length);
    let mut at = 0;
    while at < input.len() {
        let control = usize::from(input[at]);
        at += 1;
        if control < 32 {
            let literal = input.get(at..at + control + 1)?;
            at += literal.len();
            if out.len() + literal.len() > length {
                return None;
            }
            out.extend_from_slice(literal);
            continue;
        }
        let mut run = control >> 5;
        if run == 7 {
            run += usize::from(*input.get(at)?);
            at += 1;
        }
        let distance = ((control & 31) << 8 | usize::from(*input.get(at)?)) + 1;
        at += 1;
        let start = out.len().checked_sub(distance)?;
        if out.len() + run + 2 > length {
            return None;
        }
        // The copy may run into what it writes itself.
        for i in start..start + run + 2 {
            let byte = out[i];
            out.push(byte);
        }
    }
    (out.len() == length).then_some(out)
}

/// The most bytes that `compressed` bytes can expand to: a copy of three bytes writes at most 264.
pub(super) fn most(compressed: u64) -> u64 {
    compressed.saturating_mul(88)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_copies_expand() {
        assert_eq!(expand(&[2, b'a', b'b', b'c'], 3).unwrap(), b"abc");
        // "ab", then 4 bytes from 2 back: an overlapping copy.
        assert_eq!(expand(&[1, b'a', b'b', 2 << 5, 1], 6).unwrap(), b"ababab");
        // A long copy: 7 + 3 + 2 bytes from 1 back.
        assert_eq!(expand(&[0, b'x', 7 << 5, 3, 0], 13).unwrap(), b"xxxxxxxxxxxxx");
    }

    #[test]
    fn broken_input_is_refused() {
        for (input, length) in [
            (&[2_u8, b'a'][..], 3),
            (&[2, b'a', b'b', b'c'], 2),
            (&[2, b'a', b'b', b'c'], 4),
            (&[2 << 5, 0], 4),
            (&[0, b'x', 1 << 5], 3),
            (&[0, b'x', 7 << 5, 255], 300),
            (&[0, b'x', 7 << 5, 255, 0], 100),
        ] {
            assert_eq!(expand(input, length), None, "{input:?}");
        }
    }
}
