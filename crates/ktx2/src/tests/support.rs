//! Texels for tests, and the independent decoder.
use basisu::{DecodeFlags, TargetFormat, Transcoder};

/// A small generator of numbers (xorshift).
pub(super) struct Random(pub(super) u64);
impl Random {
    pub(super) fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 24) as u32
    }
    pub(super) fn below(&mut self, n: u32) -> u32 {
        self.next() % n
    }
}

/// Images of `size` x `size` texels by kind.
pub(super) fn image(kind: &str, size: usize) -> Vec<[u8; 4]> {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let byte = |v: f64| v.round().clamp(0.0, 255.0) as u8;
    let mut noise: Vec<f64> = (0..size * size).map(|_| f64::from(random.below(1000)) / 500.0 - 1.0).collect();
    if kind != "random" {
        // Neighbouring texels of a photo resemble each other.
        for _ in 0..2 {
            let old = noise.clone();
            for y in 0..size {
                for x in 0..size {
                    let at = |dx: usize, dy: usize| old[(y + dy) % size * size + (x + dx) % size];
                    noise[y * size + x] = 0.6 * at(0, 0) + 0.4 * (at(1, 0) + at(0, 1) + at(1, 1)) / 3.0;
                }
            }
        }
    }
    (0..size * size)
        .map(|i| {
            let (x, y) = ((i % size) as f64 / size as f64, (i / size) as f64 / size as f64);
            let n = noise[i];
            let m = noise[(i * 7 + 13) % (size * size)];
            let wave = (x * 40.0).sin() * (y * 31.0).cos();
            match kind {
                "random" => [0; 4].map(|_| random.below(256) as u8),
                "gradient" => [byte(255.0 * x), byte(255.0 * y), byte(255.0 * (1.0 - x)), 255],
                "photo" => {
                    let edge = if (x * 5.0 + y * 3.0).fract() > 0.5 { 60.0 } else { 0.0 };
                    let l = 90.0 + 50.0 * wave + edge + 24.0 * n;
                    [byte(l * 1.1 + 3.0 * m), byte(l * 0.9), byte(l * 0.6 + 20.0 - 3.0 * m), 255]
                }
                "normal" => {
                    let (a, b) = (0.3 * (x * 60.0).sin() + 0.1 * n, 0.3 * (y * 45.0).cos() + 0.1 * m);
                    let c = (1.0 - a * a - b * b).max(0.0).sqrt();
                    [byte(127.5 + 127.5 * a), byte(127.5 + 127.5 * b), byte(127.5 + 127.5 * c), 255]
                }
                "alpha" => {
                    let l = 120.0 + 60.0 * wave + 15.0 * n;
                    [byte(l * 0.5), byte(l), byte(l * 0.4), byte(150.0 + 100.0 * (x * 50.0).sin() + 10.0 * m)]
                }
                "grey" => {
                    let l = byte(128.0 + 80.0 * wave + 30.0 * n);
                    [l, l, l, 255]
                }
                "grey alpha" => {
                    let l = byte(128.0 + 80.0 * wave + 10.0 * n);
                    [l, l, l, byte(128.0 + 90.0 * (y * 33.0).sin())]
                }
                other => panic!("no image {other}"),
            }
        })
        .collect()
}

/// Texels of a level after the independent decoder.
pub(super) fn decode(file: &[u8], level: u32) -> (u32, u32, Vec<[u8; 4]>) {
    let texture = Transcoder::new(file).expect("a readable file");
    let info = texture.image_level_info(level).expect("a level");
    let bytes = texture.transcode(level, TargetFormat::Rgba32, DecodeFlags::NONE).expect("valid blocks");
    let texels: Vec<[u8; 4]> = bytes.as_chunks::<4>().0.to_vec();
    assert_eq!(texels.len(), (info.width * info.height) as usize);
    (info.width, info.height, texels)
}

/// PSNR over `channels` channels in dB.
pub(super) fn psnr(a: &[[u8; 4]], b: &[[u8; 4]], channels: usize) -> f64 {
    assert_eq!(a.len(), b.len());
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        for c in 0..channels {
            sum += (f64::from(x[c]) - f64::from(y[c])).powi(2);
        }
    }
    if sum == 0.0 { f64::INFINITY } else { 10.0 * (65025.0 * (a.len() * channels) as f64 / sum).log10() }
}
