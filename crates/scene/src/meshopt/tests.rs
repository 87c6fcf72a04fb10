//! Streams of our encoders are decoded to what went in; streams of another encoder to what it was given; bad ones refused.

use super::*;

fn random(state: &mut u64) -> u32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as u32
}

/// Elements with bytes that are constant, smooth, and noisy.
fn elements(count: usize, stride: usize, seed: u64) -> Vec<u8> {
    let mut state = seed;
    let byte = |e: usize, k: usize, state: &mut u64| match k % 4 {
        0 => 7,
        1 => (e / 3) as u8,
        2 => (128.0 + 100.0 * (e as f32 * 0.01).sin()) as u8,
        _ => random(state) as u8 >> (k % 8),
    };
    (0..count * stride).map(|i| byte(i / stride, i % stride, &mut state)).collect()
}

#[test]
fn vertices_come_back() {
    for stride in [4, 8, 12, 16, 32, 64, 256] {
        for count in [0, 1, 15, 16, 17, 255, 256, 257, 1000] {
            let given = elements(count, stride, 1 + count as u64);
            let stream = encode_vertices(&given, stride);
            let again = decode(&stream, Mode::Attributes, Filter::None, count, stride).unwrap();
            assert!(again == given, "{count} elements of {stride} bytes");
        }
    }
    let flat = encode_vertices(&[9; 4096], 16);
    assert!(flat.len() < 150, "constant elements take {} bytes", flat.len());
}

/// A grid of `n x n` quads, with vertices numbered row by row.
fn grid(n: u32) -> Vec<[u32; 3]> {
    let mut out = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            out.extend([[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]);
        }
    }
    out
}

fn first_lowest([a, b, c]: [u32; 3]) -> [u32; 3] {
    let least = a.min(b).min(c);
    if a == least {
        [a, b, c]
    } else if b == least {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

fn triangles_of(bytes: &[u8]) -> Vec<[u32; 3]> {
    let indices: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    indices.as_chunks::<3>().0.to_vec()
}

#[test]
fn triangles_come_back() {
    let mut state = 3;
    let noise: Vec<[u32; 3]> = (0..500).map(|_| [(); 3].map(|()| random(&mut state) % 70)).collect();
    let far: Vec<[u32; 3]> = (0..200).map(|_| [(); 3].map(|()| random(&mut state) << 1)).collect();
    for given in [vec![], vec![[5, 6, 7]], vec![[0, 0, 0], [0, 1, 1]], grid(20), noise, far] {
        let stream = encode_triangles(&given);
        let again = decode(&stream, Mode::Triangles, Filter::None, 3 * given.len(), 4).unwrap();
        let again: Vec<_> = triangles_of(&again).into_iter().map(first_lowest).collect();
        let given: Vec<_> = given.into_iter().map(first_lowest).collect();
        assert_eq!(again, given);
    }
    let stream = encode_triangles(&grid(20));
    assert!(stream.len() < 800 * 2, "a grid of 800 triangles takes {} bytes", stream.len());
}

#[test]
fn filtered_vectors_come_back_within_half_a_step() {
    let mut state = 5;
    let vectors: Vec<[f32; 4]> = (0..2000)
        .map(|i| {
            let v = [(); 3].map(|()| random(&mut state) as f32 / (1_u32 << 30) as f32 - 1.0);
            let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
            [v[0] / length, v[1] / length, v[2] / length, if i % 2 == 0 { 1.0 } else { -1.0 }]
        })
        .collect();
    for (bits, stride, most, tolerance) in
        [(8, 4, 127.0, 0.02), (12, 8, 32767.0, 1.5e-3), (16, 8, 32767.0, 1e-4)]
    {
        let stream = encode_vertices(&octahedral(&vectors, bits), stride);
        let bytes = decode(&stream, Mode::Attributes, Filter::Octahedral, vectors.len(), stride).unwrap();
        for (v, e) in vectors.iter().zip(bytes.chunks_exact(stride)) {
            let component = |k: usize| match stride {
                4 => f32::from(e[k] as i8) / most,
                _ => f32::from(i16::from_le_bytes([e[2 * k], e[2 * k + 1]])) / most,
            };
            for (k, x) in v.iter().enumerate() {
                assert!((component(k) - x).abs() < tolerance, "{bits} bits: {v:?} has {}", component(k));
            }
        }
    }
}

#[test]
fn filtered_floats_lie_on_a_grid() {
    let values: Vec<f32> = (0..999).map(|i| (i as f32 * 0.37).sin() * 7.0).collect();
    for exponent in [-19, -12, -3] {
        let (stored, meant) = exponential(&values, exponent);
        let stream = encode_vertices(&stored, 12);
        let bytes = decode(&stream, Mode::Attributes, Filter::Exponential, 333, 12).unwrap();
        let decoded: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(decoded, meant);
        let step = 2.0_f32.powi(exponent);
        for (x, y) in values.iter().zip(&meant) {
            assert!((x - y).abs() <= 0.5 * step && (y / step).fract() == 0.0, "2^{exponent}: {x} became {y}");
        }
    }
    for (exponent, value) in [(106, 3e38), (-126, 3.0 * 2.0_f32.powi(-126))] {
        let (_, meant) = exponential(&[value, -value, 0.0], exponent);
        assert!(
            (meant[0] / value - 1.0).abs() < 1e-6 && meant[1] == -meant[0] && meant[2] == 0.0,
            "{meant:?}"
        );
    }
}

#[test]
fn sequences_are_read() {
    // 3 (base 0, +3), 4 (+1), 100 (base 1, +100), 2 (base 0, -2): varints of zigzag(difference) * 2 + base.
    let stream = [0xd1, 12, 4, 0x91, 0x03, 6, 0, 0, 0, 0];
    let bytes = decode(&stream, Mode::Indices, Filter::None, 4, 2).unwrap();
    assert_eq!(bytes, [3, 0, 4, 0, 100, 0, 2, 0]);
}

#[test]
fn claims_are_compared_with_bytes() {
    let refused = |stream: &[u8], mode, count, stride, word: &str| {
        let rule = decode(stream, mode, Filter::None, count, stride).map(|_| ()).unwrap_err();
        assert!(rule.contains(word), "{rule}");
    };
    let vertices = encode_vertices(&elements(1000, 16, 1), 16);
    refused(&vertices, Mode::Attributes, 1 << 40, 16, "at least");
    refused(&vertices, Mode::Attributes, 900, 16, "more than");
    refused(&vertices, Mode::Attributes, 1000, 18, "multiple of 4");
    refused(&vertices[..20], Mode::Attributes, 1000, 16, "truncated");
    refused(&[], Mode::Attributes, 0, 16, "0xa0");
    let triangles = encode_triangles(&grid(4));
    refused(&triangles, Mode::Triangles, 3 << 40, 4, "at least one byte");
    refused(&triangles, Mode::Triangles, 95, 4, "multiple of 3");
    refused(&triangles, Mode::Triangles, 96, 3, "2 or 4");
    refused(&[0xd1, 1, 0, 0, 0, 0], Mode::Indices, 1 << 40, 4, "at least one byte");
    refused(&[0xd1, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 0, 0, 0, 0], Mode::Indices, 1, 4, "5 bytes");
    let big = encode_triangles(&[[1, 2, 70_000]]);
    refused(&big, Mode::Triangles, 3, 2, "65535");
    assert!(decode(&triangles, Mode::Triangles, Filter::Octahedral, 96, 4).is_err());
    assert!(decode(&vertices, Mode::Attributes, Filter::Quaternion, 1000, 16).is_err());
}

#[test]
fn broken_streams_never_panic() {
    let streams = [
        (encode_vertices(&elements(300, 8, 1), 8), Mode::Attributes, 300, 8),
        (encode_triangles(&grid(8)), Mode::Triangles, 384, 4),
        (vec![0xd1, 12, 4, 0x91, 0x03, 6, 0, 0, 0, 0], Mode::Indices, 4, 4),
    ];
    let filters = [Filter::None, Filter::Octahedral, Filter::Quaternion, Filter::Exponential, Filter::Color];
    let mut state = 9;
    let mut accepted = 0;
    for (stream, mode, count, stride) in streams {
        for round in 0..3000 {
            let mut bad = stream.clone();
            for _ in 0..1 + round % 3 {
                let at = random(&mut state) as usize % bad.len();
                bad[at] ^= 1 << (random(&mut state) % 8);
            }
            if round % 5 == 0 {
                bad.truncate(random(&mut state) as usize % bad.len());
            }
            if round % 7 == 0 && mode == Mode::Attributes {
                bad.splice(..bad.len().min(1), [0xa1]);
            }
            let filter = if mode == Mode::Attributes { filters[round % 5] } else { Filter::None };
            let count = if round % 11 == 0 { random(&mut state) as usize % 1000 } else { count };
            accepted += usize::from(decode(&bad, mode, filter, count, stride).is_ok());
        }
    }
    assert!(accepted > 100, "{accepted} of 9000 broken streams still decode");
}

/// Streams that meshoptimizer 1.3 made of the elements and triangles below.
const VERTICES_0: &[u8] = &[
    160, 0, 10, 10, 170, 170, 170, 170, 170, 170, 170, 170, 170, 0, 0, 0, 0, 0, 0, 7, 0, 6, 18, 30, 42, 54,
    66, 78, 90, 102, 114, 126, 138, 150, 162, 174, 255, 0, 0, 0, 186, 198, 210, 222, 1, 0, 0, 12, 0, 111, 7,
    0, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 255, 0, 0, 0, 74, 74, 74, 74, 5, 21, 85,
    85, 85, 85, 0, 0, 0, 7, 0, 2, 14, 38, 74, 122, 182, 254, 173, 77, 30, 150, 229, 85, 70, 238, 255, 0, 0,
    0, 93, 98, 209, 6, 5, 38, 102, 102, 102, 102, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 0, 255, 0, 0,
];
const VERTICES_1: &[u8] = &[
    161, 54, 119, 2, 10, 170, 170, 170, 170, 170, 170, 170, 15, 0, 10, 10, 10, 10, 0, 6, 18, 30, 42, 54, 66,
    78, 90, 102, 114, 126, 138, 150, 162, 174, 186, 198, 210, 222, 1, 0, 4, 111, 0, 74, 74, 74, 74, 74, 74,
    74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 74, 5, 21, 85, 85, 85, 85, 0, 0, 0, 0, 2, 14, 38, 74,
    122, 182, 254, 173, 77, 30, 150, 229, 85, 70, 238, 93, 98, 209, 6, 5, 38, 102, 102, 102, 102, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 0, 255, 0, 0, 0, 0,
];
const TRIANGLES: &[u8] = &[
    225, 254, 30, 16, 14, 16, 14, 142, 30, 20, 14, 19, 14, 142, 30, 19, 14, 19, 14, 15, 8, 0, 118, 135, 86,
    103, 120, 169, 134, 101, 137, 104, 152, 1, 105, 0, 0,
];
const SEQUENCE: &[u8] = &[
    209, 0, 4, 12, 10, 16, 2, 10, 4, 12, 10, 16, 2, 10, 4, 12, 10, 16, 2, 6, 4, 12, 10, 16, 2, 10, 4, 12, 10,
    16, 2, 10, 4, 12, 10, 16, 2, 6, 4, 12, 10, 16, 2, 10, 4, 12, 10, 16, 2, 10, 4, 12, 10, 16, 2, 0, 0, 0, 0,
];

#[test]
fn streams_of_another_encoder_are_read() {
    let bytes = |e: usize| {
        [7, 5 * e, 3 * e * e, if e < 10 { 0 } else { 200 }, 37 * e, 255 - e, e * e * e, e & 1]
            .map(|x| x as u8)
    };
    let elements: Vec<u8> = (0..20).flat_map(bytes).collect();
    for stream in [VERTICES_0, VERTICES_1] {
        assert_eq!(decode(stream, Mode::Attributes, Filter::None, 20, 8).unwrap(), elements);
    }
    assert_eq!(VERTICES_1[0], 0xa1);
    let given = grid(3);
    let triangles = triangles_of(&decode(TRIANGLES, Mode::Triangles, Filter::None, 54, 4).unwrap());
    let turned = |t: &[[u32; 3]]| t.iter().map(|t| first_lowest(*t)).collect::<Vec<_>>();
    assert_eq!(turned(&triangles), turned(&given));
    let sequence = triangles_of(&decode(SEQUENCE, Mode::Indices, Filter::None, 54, 4).unwrap());
    assert_eq!(sequence, given);
}

#[test]
fn channels_of_two_and_four_bytes_are_read() {
    let turn = 4;
    let halves = |e: u32| [(e * 1931) as u16, (40_000 - 29 * e * e) as u16];
    let float = |e: u32| (1.0 + e as f32 / 64.0).to_bits();
    let (mut elements, mut deltas) = (Vec::new(), Vec::new());
    for e in 0..36_u32 {
        elements.extend(halves(e).map(u16::to_le_bytes).as_flattened());
        elements.extend(float(e).to_le_bytes());
        let before = e.saturating_sub(1);
        let mut delta = Vec::new();
        for (now, last) in halves(e).into_iter().zip(halves(before)) {
            let d = now.wrapping_sub(last) as i16;
            delta.extend(((d << 1) ^ (d >> 15)).to_le_bytes());
        }
        delta.extend((float(e) ^ float(before)).rotate_left(turn).to_le_bytes());
        deltas.push(delta);
    }
    // Two bytes of controls, which say that all eight rows are stored as they are; then the rows.
    let mut stream = vec![0xa1, 0xff, 0xff];
    (0..8).for_each(|k| stream.extend(deltas.iter().map(|d| d[k])));
    stream.extend([0; 14]);
    stream.extend(&elements[..8]);
    stream.extend([1, 2 | (turn as u8) << 4]);
    assert_eq!(decode(&stream, Mode::Attributes, Filter::None, 36, 8).unwrap(), elements);
    let last = stream.len() - 1;
    stream[last] = 3;
    assert!(decode(&stream, Mode::Attributes, Filter::None, 36, 8).unwrap_err().contains("channel mode 3"));
}

#[test]
fn filters_of_another_encoder_are_undone() {
    // (0, 0, 1), (.6, 0, -.8), (-.48, .6, .64), (0, -1, 0)
    let mut oct = [0, 0, 127, 127, 127, 73, 127, 129, 221, 44, 127, 127, 0, 129, 127, 129_u8];
    Filter::Octahedral.apply(&mut oct, 4);
    let near = |e: &[u8], v: [i32; 4]| e.iter().zip(v).all(|(b, x)| (i32::from(*b as i8) - x).abs() <= 1);
    let vectors = [[0, 0, 127, 127], [76, 0, -102, -127], [-61, 76, 81, 127], [0, -127, 0, -127]];
    assert!(oct.chunks(4).zip(vectors).all(|(e, v)| near(e, v)), "{:?}", oct.map(|b| b as i8));
    // (0, 0, 0, 1), (.5, .5, .5, -.5), (.6, 0, -.8, 0); opposite quaternions are the same rotation.
    let mut quat =
        [0, 0, 0, 0, 0, 0, 255, 127, 130, 90, 130, 90, 126, 165, 252, 127, 0, 0, 100, 147, 0, 0, 254, 127_u8];
    Filter::Quaternion.apply(&mut quat, 8);
    let wanted = [[0.0, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, -0.5], [0.6, 0.0, -0.8, 0.0]];
    for (e, q) in quat.as_chunks::<8>().0.iter().zip(wanted) {
        let got: Vec<f64> =
            e.as_chunks::<2>().0.iter().map(|b| f64::from(i16::from_le_bytes(*b)) / 32767.0).collect();
        let dot: f64 = got.iter().zip(q).map(|(a, b)| a * b).sum();
        assert!(dot.abs() > 0.9999, "{got:?} is not {q:?}");
    }
    let mut exp = [0, 16, 0, 244, 0, 216, 255, 244, 132, 62, 0, 252, 0, 0, 0, 252_u8];
    Filter::Exponential.apply(&mut exp, 8);
    let floats: Vec<f32> = exp.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    assert_eq!(floats, [1.0, -2.5, 1000.25, 0.0]);
    // (1, 0, .5, 1), (.2, .4, .6, .5)
    let mut color = [96, 63, 161, 255, 102, 205, 0, 192_u8];
    Filter::Color.apply(&mut color, 4);
    let wanted = [255, 0, 128, 255, 51, 102, 153, 128];
    assert!(color.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 2), "{color:?}");
}
