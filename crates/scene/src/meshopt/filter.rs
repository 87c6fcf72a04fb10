//! Filters: what numbers of a vertex stream stand for, undone after decoding.

use std::f64::consts::FRAC_1_SQRT_2;

/// How elements of a vertex stream are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filter {
    /// As they are.
    None,
    /// Unit vectors by their octahedral projection.
    Octahedral,
    /// Unit quaternions without their largest component.
    Quaternion,
    /// Floats as a mantissa of 24 bits and an exponent of 8.
    Exponential,
    /// Colours as luma, two differences of chroma, and alpha.
    Color,
}

impl Filter {
    const ALL: [Self; 5] = [Self::None, Self::Octahedral, Self::Quaternion, Self::Exponential, Self::Color];

    /// By the name in the file.
    pub(crate) fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }

    /// The name in the file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::None => "NONE",
            Self::Octahedral => "OCTAHEDRAL",
            Self::Quaternion => "QUATERNION",
            Self::Exponential => "EXPONENTIAL",
            Self::Color => "COLOR",
        }
    }

    pub(super) fn check(self, stride: usize) -> Result<(), String> {
        let allowed: &[usize] = match self {
            Self::None | Self::Exponential => return Ok(()),
            Self::Octahedral | Self::Color => &[4, 8],
            Self::Quaternion => &[8],
        };
        if allowed.contains(&stride) {
            return Ok(());
        }
        let allowed = if allowed.len() == 1 { "8" } else { "4 or 8" };
        Err(format!("byteStride is {stride}; it must be {allowed} with this filter"))
    }

    /// Turns stored elements into what they stand for, in place.
    pub(super) fn apply(self, elements: &mut [u8], stride: usize) {
        match (self, stride) {
            (Self::None, _) => {}
            (Self::Octahedral, 4) => elements.as_chunks_mut::<4>().0.iter_mut().for_each(|e| {
                let v = unit_of_octahedral(e.map(|b| f32::from(b as i8)), 127.0);
                (e[0], e[1], e[2]) = (v[0] as i8 as u8, v[1] as i8 as u8, v[2] as i8 as u8);
            }),
            (Self::Octahedral, _) => elements.as_chunks_mut::<8>().0.iter_mut().for_each(|e| {
                let v = unit_of_octahedral(words(e).map(f32::from), 32767.0);
                let w = words(e)[3];
                set_words(e, [v[0] as i16, v[1] as i16, v[2] as i16, w]);
            }),
            (Self::Quaternion, _) => {
                elements.as_chunks_mut::<8>().0.iter_mut().for_each(|e| set_words(e, quaternion(words(e))));
            }
            (Self::Exponential, _) => elements.as_chunks_mut::<4>().0.iter_mut().for_each(|e| {
                *e = float(u32::from_le_bytes(*e)).to_le_bytes();
            }),
            (Self::Color, 4) => elements.as_chunks_mut::<4>().0.iter_mut().for_each(|e| {
                let signed = e.map(|b| i32::from(b as i8));
                let c = rgb([i32::from(e[0]), signed[1], signed[2], i32::from(e[3])], 255.0);
                *e = c.map(|x| x as u8);
            }),
            (Self::Color, _) => elements.as_chunks_mut::<8>().0.iter_mut().for_each(|e| {
                let w = words(e).map(i32::from);
                let c = rgb([w[0] & 0xffff, w[1], w[2], w[3] & 0xffff], 65535.0);
                set_words(e, c.map(|x| x as u16 as i16));
            }),
        }
    }
}

fn words(e: &[u8; 8]) -> [i16; 4] {
    std::array::from_fn(|k| i16::from_le_bytes([e[2 * k], e[2 * k + 1]]))
}

fn set_words(e: &mut [u8; 8], words: [i16; 4]) {
    for (to, word) in e.as_chunks_mut::<2>().0.iter_mut().zip(words) {
        *to = word.to_le_bytes();
    }
}

/// The vector of length `most` whose projection is `x : y` of `one`.
fn unit_of_octahedral([x, y, one, _]: [f32; 4], most: f32) -> [f32; 3] {
    let z = one - x.abs() - y.abs();
    let fold = z.min(0.0);
    let x = x + if x >= 0.0 { fold } else { -fold };
    let y = y + if y >= 0.0 { fold } else { -fold };
    let scale = most / (x * x + y * y + z * z).sqrt();
    if scale.is_finite() { [x, y, z].map(|c| (c * scale).round()) } else { [0.0; 3] }
}

/// The quaternion, in units of 1 / 32767, whose three smaller components are stored.
fn quaternion([x, y, z, tag]: [i16; 4]) -> [i16; 4] {
    let scale = FRAC_1_SQRT_2 / f64::from(tag | 3);
    let small = [x, y, z].map(|c| f64::from(c) * scale);
    let rest = 1.0 - small.iter().map(|c| c * c).sum::<f64>();
    let largest = (tag & 3) as usize;
    let mut out = [0; 4];
    out[largest] = (rest.max(0.0).sqrt() * 32767.0).round() as i16;
    for (k, c) in small.into_iter().enumerate() {
        out[(largest + k + 1) % 4] = (c * 32767.0).round() as i16;
    }
    out
}

/// Mantissa times a power of two.
fn float(stored: u32) -> f32 {
    let exponent = (stored as i32) >> 24;
    let mantissa = ((stored << 8) as i32) >> 8;
    // Powers of two below the normal range are reached in two steps, both exact.
    let power = |e: i32| f32::from_bits(((e + 127) as u32) << 23);
    if exponent >= -126 {
        mantissa as f32 * power(exponent)
    } else {
        mantissa as f32 * power(exponent + 24) * power(-24)
    }
}

/// Red, green, blue and alpha up to `most`. The highest bit of alpha says how many bits there are.
fn rgb([y, co, cg, alpha]: [i32; 4], most: f32) -> [f32; 4] {
    let high = 31 - (alpha.max(1) as u32).leading_zeros();
    let all = (1_i32 << (high + 1)) - 1;
    let a = alpha & (all >> 1);
    let scale = most / all as f32;
    [y + co - cg, y + cg, y - co - cg, a << 1 | a & 1].map(|c| (c as f32 * scale).round().clamp(0.0, most))
}

/// Unit vectors with a fourth component in [-1, 1], as elements of 4 bytes (`bits` up to 8) or 8 bytes (up to 16) for
/// [`Filter::Octahedral`].
pub(crate) fn octahedral(vectors: &[[f32; 4]], bits: u32) -> Vec<u8> {
    let most = ((1_i32 << (bits - 1)) - 1) as f32;
    let mut out = Vec::with_capacity(vectors.len() * if bits > 8 { 8 } else { 4 });
    for &[x, y, z, w] in vectors {
        let length = x.abs() + y.abs() + z.abs();
        let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
        let (x, y) = (x * scale, y * scale);
        let (u, v) =
            if z >= 0.0 { (x, y) } else { ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)) };
        let whole = if bits > 8 { 32767.0 } else { 127.0 };
        let stored = [(u * most).round(), (v * most).round(), most, (w * whole).round()];
        if bits > 8 {
            stored.iter().for_each(|c| out.extend((*c as i16).to_le_bytes()));
        } else {
            out.extend(stored.map(|c| c as i8 as u8));
        }
    }
    out
}

/// Floats for [`Filter::Exponential`], as multiples of 2^`exponent`: the stored numbers and what they stand for.
///
/// # Panics
/// If the exponent is not in -126..=127, or a value is not below 2^(`exponent` + 23) in magnitude.
pub(crate) fn exponential(values: &[f32], exponent: i32) -> (Vec<u8>, Vec<f32>) {
    assert!((-126..=127).contains(&exponent), "an exponent of {exponent}");
    let mut stored = Vec::with_capacity(values.len() * 4);
    let mut meant = Vec::with_capacity(values.len());
    for x in values {
        let mantissa = (f64::from(*x) * 2.0_f64.powi(-exponent)).round();
        assert!(mantissa.abs() < f64::from(1 << 23), "{x} is no multiple of 2^{exponent} with 23 bits");
        let packed = (mantissa as i32 as u32 & 0x00ff_ffff) | (exponent as u32) << 24;
        stored.extend(packed.to_le_bytes());
        meant.push(float(packed));
    }
    (stored, meant)
}
