//! Hints: what transcoders make of them for ETC1 and ETC2.
use super::support::{Random, image, psnr};
use crate::{Options, encode};
use basisu::{DecodeFlags, TargetFormat, Transcoder};

const STEPS: [[i32; 2]; 8] = [[2, 8], [5, 17], [9, 29], [13, 42], [18, 60], [24, 80], [33, 106], [47, 183]];

/// Texels of an ETC1 block (Khronos Data Format specification, "ETC1S and ETC1").
fn etc1(block: &[u8]) -> [[u8; 4]; 16] {
    let (differential, flip) = (block[3] & 2 != 0, block[3] & 1 != 0);
    let mut base = [[0i32; 3]; 2];
    for c in 0..3 {
        let byte = i32::from(block[c]);
        if differential {
            let first = byte >> 3;
            let second = first + if byte & 4 != 0 { (byte & 7) - 8 } else { byte & 7 };
            assert!((0..32).contains(&second), "an overflow would be another format");
            for (side, v) in [first, second].into_iter().enumerate() {
                base[side][c] = v << 3 | v >> 2;
            }
        } else {
            base[0][c] = (byte >> 4) * 17;
            base[1][c] = (byte & 15) * 17;
        }
    }
    let tables = [usize::from(block[3] >> 5), usize::from(block[3] >> 2 & 7)];
    let high = u16::from_be_bytes([block[4], block[5]]);
    let low = u16::from_be_bytes([block[6], block[7]]);
    core::array::from_fn(|i| {
        let (x, y) = (i % 4, i / 4);
        let side = if flip { y / 2 } else { x / 2 };
        let bit = x * 4 + y;
        let step = STEPS[tables[side]][usize::from(low >> bit & 1)];
        let step = if high >> bit & 1 == 1 { -step } else { step };
        let channel = |c: usize| (base[side][c] + step).clamp(0, 255) as u8;
        [channel(0), channel(1), channel(2), 255]
    })
}

fn transcoded(texels: &[[u8; 4]], size: usize, etc_hints: bool) -> Vec<[u8; 4]> {
    let options = Options { zstandard: None, etc_hints, ..Options::new(true) };
    let level = (size as u32, size as u32, texels.to_vec());
    let file = encode(&[level], &options).unwrap();
    let blocks =
        Transcoder::new(&file).unwrap().transcode(0, TargetFormat::Etc1Rgb, DecodeFlags::NONE).unwrap();
    let mut out = vec![[0; 4]; size * size];
    for (b, block) in blocks.chunks(8).enumerate() {
        let (bx, by) = (b % (size / 4), b / (size / 4));
        for (i, texel) in etc1(block).into_iter().enumerate() {
            out[(by * 4 + i / 4) * size + bx * 4 + i % 4] = texel;
        }
    }
    out
}

/// Hints made for a block give a better ETC1 block than the fixed ones (on smooth blocks: as good).
#[test]
fn hints_better_etc1() {
    for (kind, floor) in [("photo", 33.0), ("normal", 30.5), ("gradient", 30.0), ("grey", 34.0)] {
        let texels = image(kind, 128);
        let with = psnr(&texels, &transcoded(&texels, 128, true), 3);
        let without = psnr(&texels, &transcoded(&texels, 128, false), 3);
        println!("{kind}: ETC1 {with:.2} dB with hints, {without:.2} dB with fixed ones");
        assert!(with > floor && with > without - 0.1, "{kind}: {with} dB with, {without} dB without");
    }
}

/// Solid blocks are within three of their colour in ETC1.
#[test]
fn solid_blocks_are_near_in_etc1() {
    let mut random = Random(5);
    let mut texels = vec![[0; 4]; 64 * 64];
    for b in 0..256 {
        let colour = [random.below(256) as u8, random.below(256) as u8, random.below(256) as u8, 255];
        for i in 0..16 {
            texels[(b / 16 * 4 + i / 4) * 64 + b % 16 * 4 + i % 4] = colour;
        }
    }
    let out = transcoded(&texels, 64, true);
    let most = out.iter().flatten().zip(texels.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max();
    println!("solid colours: ETC1 off by at most {most:?}, {:.2} dB", psnr(&texels, &out, 3));
    assert!(psnr(&texels, &out, 3) > 42.0);
}

/// Alpha of an EAC block of ETC2.
fn eac(block: &[u8]) -> [u8; 16] {
    const MODIFIERS: [[i32; 4]; 16] = [
        [3, 6, 9, 15],
        [3, 7, 10, 13],
        [2, 5, 8, 13],
        [2, 4, 6, 13],
        [3, 6, 8, 12],
        [3, 7, 9, 11],
        [4, 7, 8, 11],
        [3, 5, 8, 11],
        [2, 6, 8, 10],
        [2, 5, 8, 10],
        [2, 4, 8, 10],
        [2, 5, 7, 10],
        [3, 4, 7, 10],
        [1, 2, 3, 10],
        [4, 6, 8, 9],
        [3, 5, 7, 9],
    ];
    let (base, multiplier) = (i32::from(block[0]), i32::from(block[1] >> 4));
    let row = MODIFIERS[usize::from(block[1] & 15)];
    let bits = block[2..8].iter().fold(0u64, |n, b| n << 8 | u64::from(*b));
    core::array::from_fn(|i| {
        let (x, y) = (i % 4, i / 4);
        let index = (bits >> (45 - 3 * (x * 4 + y)) & 7) as usize;
        // The upper four modifiers are the mirrored lower ones less one.
        let step = if index < 4 { -row[index] } else { row[index - 4] - 1 };
        (base + step * multiplier).clamp(0, 255) as u8
    })
}

#[test]
fn hints_better_eac_alpha() {
    for kind in ["alpha", "grey alpha"] {
        let texels = image(kind, 128);
        let mut quality = [0.0; 2];
        for (etc_hints, q) in [false, true].into_iter().zip(&mut quality) {
            let options = Options { zstandard: None, etc_hints, ..Options::new(true) };
            let file = encode(&[(128, 128, texels.clone())], &options).unwrap();
            let blocks = Transcoder::new(&file)
                .unwrap()
                .transcode(0, TargetFormat::Etc2Rgba, DecodeFlags::NONE)
                .unwrap();
            let mut sum = 0.0;
            for (b, block) in blocks.chunks(16).enumerate() {
                for (i, a) in eac(block).into_iter().enumerate() {
                    let texel = texels[(b / 32 * 4 + i / 4) * 128 + b % 32 * 4 + i % 4];
                    sum += (f64::from(a) - f64::from(texel[3])).powi(2);
                }
            }
            *q = 10.0 * (65025.0 * 16384.0 / sum).log10();
        }
        println!("{kind}: EAC alpha {:.2} dB with hints, {:.2} dB with fixed ones", quality[1], quality[0]);
        assert!(quality[1] > 35.0 && quality[1] > quality[0] + 3.0, "{kind}: {quality:?}");
    }
}
