//! The sRGB transfer function.

use std::sync::LazyLock;

/// Linear light to sRGB (IEC 61966-2-1), not clamped: `12.92 x` up to 0.0031308, else `1.055 x^(1/2.4) - 0.055`.
#[inline]
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        return 12.92 * linear;
    }
    // 1.055 p - 0.055, in a form that is exactly 1 at 1.
    let p = linear.powf(1.0 / 2.4);
    p + 0.055 * (p - 1.0)
}

/// sRGB to linear light, not clamped: the inverse of [`srgb_encode`].
#[inline]
pub fn srgb_decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

static DECODE: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let v = i as f64 / 255.0;
        (if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }) as f32
    })
});

/// Linear light of every 8-bit sRGB sample.
#[inline]
pub fn srgb_table() -> &'static [f32; 256] {
    &DECODE
}

/// An 8-bit sRGB sample as linear light (table).
///
/// ```
/// use photofit_scalar::{linear_to_srgb_u8, srgb_u8_to_linear};
/// assert_eq!(srgb_u8_to_linear(255), 1.0);
/// assert_eq!(linear_to_srgb_u8(srgb_u8_to_linear(77)), 77);
/// ```
#[inline]
pub fn srgb_u8_to_linear(encoded: u8) -> f32 {
    DECODE[encoded as usize]
}

/// Linear light as an 8-bit sRGB sample, clamped and rounded to nearest; NaN becomes 0.
#[inline]
pub fn linear_to_srgb_u8(linear: f32) -> u8 {
    // A float-to-integer cast saturates, and maps NaN to 0.
    (srgb_encode(linear) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfer_round_trips_and_has_known_values() {
        for i in 0..=255_u8 {
            assert_eq!(linear_to_srgb_u8(srgb_u8_to_linear(i)), i, "8 bit round trip");
            let v = f32::from(i) / 255.0;
            assert!((srgb_decode(v) - srgb_u8_to_linear(i)).abs() < 2e-7, "table against formula at {i}");
            assert!((srgb_encode(srgb_decode(v)) - v).abs() < 1e-6, "inverse at {i}");
        }
        assert!((srgb_encode(0.18) - 0.461_356).abs() < 1e-5, "18% grey");
        assert!((srgb_decode(0.5) - 0.214_041_14).abs() < 1e-6, "half");
        assert_eq!(linear_to_srgb_u8(f32::NAN), 0);
        assert_eq!(linear_to_srgb_u8(f32::INFINITY), 255);
        assert_eq!(linear_to_srgb_u8(-1.0), 0);
    }
}
