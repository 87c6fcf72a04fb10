//! Files against the independent reader.
use super::support::{decode, image, psnr};
use crate::{Ktx2Error, Level, Options, encode};

/// Levels with texels of their own, so that one cannot pass for another.
fn chain(width: u32, height: u32) -> Vec<Level> {
    (0..=width.max(height).ilog2())
        .map(|l| {
            let (w, h) = ((width >> l).max(1), (height >> l).max(1));
            let texels =
                (0..w * h).map(|i| [(40 * l) as u8, (3 * (i % w)) as u8, (3 * (i / w)) as u8, 255]).collect();
            (w, h, texels)
        })
        .collect()
}

fn word(file: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(file[at..at + 4].try_into().unwrap())
}

fn long(file: &[u8], at: usize) -> usize {
    u64::from_le_bytes(file[at..at + 8].try_into().unwrap()) as usize
}

#[test]
fn every_level_reads_back() {
    for (width, height) in [(64, 64), (65, 33), (1, 1), (3, 7), (5, 1), (30, 62), (1, 64)] {
        for zstandard in [None, Some(1), Some(19)] {
            let levels = chain(width, height);
            let options = Options { zstandard, ..Options::new(true) };
            let file = encode(&levels, &options).unwrap();
            for (l, (w, h, texels)) in levels.iter().enumerate() {
                let (dw, dh, decoded) = decode(&file, l as u32);
                assert_eq!((dw, dh), (*w, *h));
                let quality = psnr(texels, &decoded, 4);
                assert!(quality > 44.0, "{width}x{height} level {l}: {quality}");
            }
        }
    }
}

/// Sections and levels lie where the KTX 2.0 specification wants them.
#[test]
fn layout_follows_the_specification() {
    for zstandard in [None, Some(19)] {
        let levels = chain(32, 16);
        let file = encode(&levels, &Options { zstandard, ..Options::new(true) }).unwrap();
        let head: Vec<u32> = (12..48).step_by(4).map(|at| word(&file, at)).collect();
        assert_eq!(head, [0, 1, 32, 16, 0, 0, 1, 6, if zstandard.is_some() { 2 } else { 0 }]);
        let (descriptor, pairs) = (word(&file, 48) as usize, word(&file, 56) as usize);
        assert_eq!(descriptor, 80 + 6 * 24);
        assert_eq!(pairs, descriptor + word(&file, 52) as usize);
        assert_eq!(word(&file, descriptor), 44);
        assert_eq!(word(&file, descriptor + 12), 166 | 1 << 8 | 2 << 16);
        assert_eq!(word(&file, descriptor + 28) >> 24, 0, "channel RGB");
        let text = String::from_utf8_lossy(&file[pairs..pairs + word(&file, 60) as usize]).into_owned();
        assert!(text.contains("KTXorientation\0rd\0") && text.contains("KTXwriter\0photofit"));
        let mut end = pairs + word(&file, 60) as usize;
        for l in (0..6).rev() {
            let [offset, length, size] = [0, 8, 16].map(|k| long(&file, 80 + 24 * l + k));
            let (w, h) = (levels[l].0 as usize, levels[l].1 as usize);
            assert_eq!(size, w.div_ceil(4) * h.div_ceil(4) * 16);
            if zstandard.is_none() {
                assert_eq!(length, size);
                assert_eq!(offset, end.next_multiple_of(16));
            } else {
                assert_eq!(offset, end);
            }
            end = offset + length;
        }
        assert_eq!(end, file.len());
    }
}

#[test]
fn descriptor_names_transfer_and_alpha() {
    for (srgb, alpha) in [(false, 255), (false, 9), (true, 255), (true, 9)] {
        let file = encode(&[(4, 4, vec![[1, 2, 3, alpha]; 16])], &Options::new(srgb)).unwrap();
        let at = word(&file, 48) as usize;
        assert_eq!(word(&file, at + 12) >> 16, if srgb { 2 } else { 1 });
        assert_eq!(word(&file, at + 28) >> 24, if alpha == 255 { 0 } else { 3 });
        assert_eq!(decode(&file, 0).2, [[1, 2, 3, alpha]; 16]);
    }
}

#[test]
fn files_do_not_depend_on_threads() {
    // More blocks than one thread takes at once.
    let level = (288, 288, image("photo", 288));
    for rdo_lambda in [0.0, 20.0] {
        let made = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = Options { rdo_lambda, ..Options::new(true) };
            pool.install(|| encode(std::slice::from_ref(&level), &options)).unwrap()
        };
        assert!(made(1) == made(3), "lambda {rdo_lambda}");
    }
}

/// A greater lambda gives a smaller file and a greater error.
#[test]
fn lambda_trades_error_for_bytes() {
    let texels = image("photo", 256);
    let mut last = (usize::MAX, f64::INFINITY);
    for rdo_lambda in [0.0, 20.0, 50.0, 120.0] {
        let options = Options { rdo_lambda, etc_hints: false, ..Options::new(true) };
        let file = encode(&[(256, 256, texels.clone())], &options).unwrap();
        let quality = psnr(&texels, &decode(&file, 0).2, 3);
        println!("lambda {rdo_lambda}: {} bytes, {quality:.2} dB", file.len());
        assert!(file.len() < last.0 && quality < last.1);
        last = (file.len(), quality);
    }
}

#[test]
fn bad_levels_are_refused() {
    let fail = |levels: &[Level]| encode(levels, &Options::new(true)).unwrap_err();
    assert_eq!(fail(&[]), Ktx2Error::NoLevels);
    assert!(matches!(fail(&[(0, 4, vec![])]), Ktx2Error::LevelSize { level: 0, .. }));
    assert!(matches!(fail(&[(4, 4, vec![[0; 4]; 15])]), Ktx2Error::TexelCount { level: 0, found: 15, .. }));
    let two = |w, h| [(8, 4, vec![[0; 4]; 32]), (w, h, vec![[0; 4]; (w * h) as usize])];
    assert!(matches!(fail(&two(4, 4)), Ktx2Error::LevelSize { level: 1, expected: (4, 2), .. }));
    assert!(encode(&two(4, 2), &Options::new(true)).is_ok());
    let long: Vec<Level> = (0..2).map(|_| (1, 1, vec![[0; 4]])).collect();
    assert!(matches!(fail(&long), Ktx2Error::TooManyLevels { count: 2, most: 1, .. }));
    let bad = Options { zstandard: Some(23), ..Options::new(true) };
    assert_eq!(encode(&[(1, 1, vec![[0; 4]])], &bad), Err(Ktx2Error::ZstandardLevel(23)));
    let bad = Options { rdo_lambda: -1.0, ..Options::new(true) };
    assert!(matches!(encode(&[(1, 1, vec![[0; 4]])], &bad), Err(Ktx2Error::Lambda(_))));
}
