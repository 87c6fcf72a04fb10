//! Blocks against the independent decoder.
use super::support::{Random, decode, image, psnr};
use crate::uastc::block::Symbols;
use crate::uastc::hints::Hints;
use crate::uastc::mode::{MODES, SOLID};
use crate::uastc::{Found, search};
use crate::write::assemble;
use crate::{Effort, Options, encode, encode_block};

fn plain() -> Options {
    Options { zstandard: None, ..Options::new(false) }
}

/// Random symbols of every mode and pattern read back as this crate reads them.
#[test]
fn symbols_of_every_mode_decode_alike() {
    let mut random = Random(7);
    let mut blocks = Vec::new();
    let mut expected = Vec::new();
    for (number, mode) in MODES.iter().enumerate().filter(|(n, _)| *n != usize::from(SOLID)) {
        for round in 0..120u32 {
            let patterns = match (mode.subsets, number) {
                (1, _) => 1,
                (2, 7) => 19,
                (2, _) => 30,
                _ => 11,
            };
            let channel = if mode.writes_channel { random.below(mode.components as u32) as u8 } else { 3 };
            let mut symbols = Symbols {
                mode: number as u8,
                pattern: (round % patterns) as u8,
                channel,
                endpoints: [0; 18],
                weights: [0; 32],
            };
            for e in &mut symbols.endpoints {
                *e = random.below(mode.range.levels as u32) as u8
            }
            for w in &mut symbols.weights {
                *w = random.below(1 << mode.weight_bits) as u8
            }
            assert_eq!(symbols.settled().texels(), symbols.texels(), "mode {number}");
            expected.push(symbols.texels());
            let hints = if round % 2 == 0 {
                Hints::default()
            } else {
                Hints::of_texels(&symbols.texels(), mode.has_alpha())
            };
            blocks.extend(symbols.pack(&hints));
        }
    }
    let width = 4 * expected.len() as u32;
    let (_, _, texels) = decode(&assemble((width, 4), vec![blocks], true, &plain()), 0);
    for (b, block) in expected.iter().enumerate() {
        for i in 0..16 {
            assert_eq!(texels[i / 4 * width as usize + b * 4 + i % 4], block[i], "block {b} texel {i}");
        }
    }
}

/// Every block of every kind of image decodes to what the search says it does,
/// and to a quality not below the one on record.
#[test]
fn images_reach_their_quality() {
    for (kind, channels, floors) in [
        ("random", 4, [15.0, 15.1, 15.2]),
        ("gradient", 3, [45.5, 54.5, 55.4]),
        ("photo", 3, [46.2, 46.6, 46.8]),
        ("normal", 3, [40.1, 40.6, 40.9]),
        ("alpha", 4, [38.5, 38.9, 38.9]),
        ("grey", 3, [47.4, 49.2, 49.3]),
        ("grey alpha", 4, [38.3, 38.5, 38.9]),
    ] {
        let size = 128;
        let texels = image(kind, size);
        let mut last = 0.0;
        for (effort, floor) in [Effort::Fast, Effort::Normal, Effort::Best].into_iter().zip(floors) {
            let options = Options { effort, ..plain() };
            let file = encode(&[(size as u32, size as u32, texels.clone())], &options).unwrap();
            let (_, _, decoded) = decode(&file, 0);
            for by in 0..size / 4 {
                for bx in 0..size / 4 {
                    let at = |i: usize| (by * 4 + i / 4) * size + bx * 4 + i % 4;
                    let block = core::array::from_fn(|i| texels[at(i)]);
                    let found = search(&block, effort);
                    let own = found.texels();
                    for i in 0..16 {
                        assert_eq!(own[i], decoded[at(i)], "{kind} {effort:?}");
                    }
                    if let Found::Block(_, error) = found {
                        let exact: i32 = own
                            .iter()
                            .flatten()
                            .zip(block.iter().flatten())
                            .map(|(a, b)| (i32::from(*a) - i32::from(*b)).pow(2))
                            .sum();
                        assert_eq!(error, exact as f32, "{kind} {effort:?}: {found:?}");
                    }
                }
            }
            let quality = psnr(&texels, &decoded, channels);
            println!("{kind:>10} {effort:?}: {quality:.2} dB");
            assert!(quality >= floor, "{kind} {effort:?}: {quality} dB, must be {floor}");
            assert!(quality >= last, "{kind} {effort:?}: {quality} dB, less effort gave {last}");
            last = quality;
        }
    }
}

/// Blocks of one colour are exact, whatever the colour.
#[test]
fn solid_blocks_are_exact() {
    let mut random = Random(3);
    let mut texels = vec![[0; 4]; 16 * 500];
    for b in 0..500 {
        let colour = [0; 4].map(|_| random.below(256) as u8);
        for i in 0..16 {
            texels[i / 4 * 2000 + b * 4 + i % 4] = colour;
        }
    }
    let file = encode(&[(2000, 4, texels.clone())], &plain()).unwrap();
    assert_eq!(decode(&file, 0).2, texels);
}

/// The same texels give the same bytes.
#[test]
fn encoding_is_deterministic() {
    let mut random = Random(11);
    for _ in 0..200 {
        let block = [[0; 4]; 16].map(|t: [u8; 4]| t.map(|_| random.below(256) as u8));
        assert_eq!(encode_block(&block, Effort::Normal), encode_block(&block, Effort::Normal));
    }
}
