//! Files that are damaged.

use super::support::{Random, image};
use crate::{Ktx2Error, Options, decode, encode, level_count, size};

fn file(zstandard: Option<i32>) -> Vec<u8> {
    let texels = image("alpha", 16);
    let level = |l: u32| (16 >> l, 16 >> l, texels[..256 >> (2 * l)].to_vec());
    encode(&[level(0), level(1)], &Options { zstandard, ..Options::new(true) }).unwrap()
}

fn with(at: usize, word: u32) -> Vec<u8> {
    let mut bytes = file(None);
    bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
    bytes
}

#[test]
fn what_the_header_claims_is_checked() {
    assert_eq!((size(&file(None)), level_count(&file(None))), (Ok((16, 16)), Ok(2)));
    let index = 80;
    for (at, word, says) in [
        (0, 0, "is no KTX 2.0 file"),
        (12, 37, "the Vulkan format 37"),
        (20, 0, "the size is 0 x 16"),
        (24, 1 << 31, "sides must be in"),
        (28, 1, "volumes, arrays and cube maps"),
        (32, 2, "volumes, arrays and cube maps"),
        (36, 6, "volumes, arrays and cube maps"),
        (40, 0, "the number of mip levels is 0"),
        (40, 6, "it must be in 1..=5"),
        (40, 3, "the index of levels"),
        (44, 1, "supercompression scheme 1"),
        (48, u32::MAX, "the data format descriptor"),
        (index, u32::MAX, "beyond the file's end"),
        (index + 16, 272, "it must be 256"),
        // The second level says that it is as large as a file of many gigabytes.
        (index + 24 + 20, 99, "it must be 64"),
    ] {
        let error = size(&with(at, word)).unwrap_err().to_string();
        assert!(error.contains(says), "{error} instead of {says}");
    }
    let error = decode(&file(None), 2).unwrap_err();
    assert!(
        matches!(&error, Ktx2Error::Invalid { rule, .. } if rule.contains("has no mip level 2")),
        "{error}"
    );
}

#[test]
fn damage_anywhere_is_an_error_or_a_picture() {
    let mut random = Random(29);
    for zstandard in [None, Some(19)] {
        let whole = file(zstandard);
        for length in 0..whole.len() {
            // The largest level stands last.
            assert!(decode(&whole[..length], 0).is_err(), "{length}");
        }
        for _ in 0..4000 {
            let mut bytes = whole.clone();
            for _ in 0..=random.below(3) {
                let at = random.below(bytes.len() as u32) as usize;
                bytes[at] = random.below(256) as u8;
            }
            for level in 0..2 {
                if let Ok((width, height, texels)) = decode(&bytes, level) {
                    assert_eq!(texels.len(), (width * height) as usize);
                    assert!(texels.len() <= 1 << 16, "no more than the file has blocks for");
                }
            }
        }
    }
}

/// Every word of the header by values that have a place at, just before and far beyond the end of the file.
#[test]
fn no_word_of_the_header_is_trusted() {
    for zstandard in [None, Some(19)] {
        let whole = file(zstandard);
        let length = whole.len() as u32;
        let values =
            [0, 1, 2, 3, 21, 22, 23, 40, 41, length - 1, length, length + 1, u32::MAX - 10, u32::MAX];
        // Colour models too: ETC1S with the global data of its scheme.
        for scheme in [None, Some((163, 1))] {
            for at in (12..whole.len().min(300) - 4).step_by(4) {
                for value in values {
                    let mut bytes = whole.clone();
                    if let Some((model, scheme)) = scheme {
                        let descriptor =
                            u32::from_le_bytes([bytes[48], bytes[49], bytes[50], bytes[51]]) as usize;
                        bytes[descriptor + 12] = model;
                        bytes[44] = scheme;
                        for level in 0..2 {
                            bytes[80 + 24 * level + 16..80 + 24 * level + 24].fill(0);
                        }
                    }
                    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
                    let _ = (decode(&bytes, 0), decode(&bytes, 1));
                    // Both words of long places.
                    bytes[at + 4..at + 8].fill(0xff);
                    let _ = (decode(&bytes, 0), decode(&bytes, 1));
                }
            }
        }
    }
}

#[test]
fn turned_and_multiplied_textures_are_refused() {
    let whole = file(None);
    let find = |key: &[u8]| whole.windows(key.len()).position(|w| w == key).unwrap();
    let refused = |bytes: &[u8], part: &str| {
        let error = decode(bytes, 0).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    let mut turned = whole.clone();
    let at = find(b"KTXorientation") + 15;
    turned[at..at + 2].copy_from_slice(b"ru");
    refused(&turned, "KTXorientation \"ru\"; it must be \"rd\"");
    let mut exchanged = whole.clone();
    let at = find(b"KTXorientation");
    // As long as the other key and its value.
    exchanged[at..at + 18].copy_from_slice(b"KTXswizzle\0bgraXXX");
    refused(&exchanged, "KTXswizzle");
    let mut multiplied = whole.clone();
    let descriptor = u32::from_le_bytes([whole[48], whole[49], whole[50], whole[51]]) as usize;
    multiplied[descriptor + 15] |= 1;
    refused(&multiplied, "multiplied by alpha");
    let mut beyond = whole.clone();
    beyond[60..64].copy_from_slice(&(whole.len() as u32).to_le_bytes());
    refused(&beyond, "key/value data");
}
