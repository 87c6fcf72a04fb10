//! The tone curve `S(x) = G(ln(1 + x))` with its derivative: exact in `f64`, branch-free and vectorisable in `f32`.

use super::SAMPLE_MAX;
use photofit_scalar::Real;

/// End of the linear part of the sRGB transfer, and its slope.
const LINEAR_END: f64 = 0.0031308;
const LINEAR_SLOPE: f64 = 12.92;

/// The scalars that losses work on: `f32` in production, `f64` in gradient checks.
pub trait LossScalar: Real {
    /// `S(x)` and `S'(x)` for `0 <= x <= SAMPLE_MAX`; with `FMA`, the machine has fused multiply-add.
    #[doc(hidden)]
    fn log_srgb<const FMA: bool>(x: Self) -> (Self, Self);
}

/// The odd continuation of the tone curve and its derivative; samples beyond the clamp have a zero derivative.
#[inline(always)]
pub(crate) fn tone<T: LossScalar, const FMA: bool>(x: T) -> (T, T) {
    let (a, free) = clamp_magnitude(x.abs());
    let (s, d) = T::log_srgb::<FMA>(a);
    // Zero but for NaN, which the bit tricks of the curve would lose.
    let s = s + a * T::zero();
    (if x < T::zero() { -s } else { s }, if free { d } else { T::zero() })
}

/// Clamps a magnitude to [`SAMPLE_MAX`] (NaN stays), and whether it was below.
#[inline(always)]
pub(crate) fn clamp_magnitude<T: Real>(a: T) -> (T, bool) {
    let max = T::of(SAMPLE_MAX);
    if a > max { (max, false) } else { (a, true) }
}

impl LossScalar for f64 {
    #[inline]
    fn log_srgb<const FMA: bool>(x: Self) -> (Self, Self) {
        let t = x.ln_1p();
        if t <= LINEAR_END {
            (LINEAR_SLOPE * t, LINEAR_SLOPE / (1.0 + x))
        } else {
            let p = t.powf(1.0 / 2.4);
            (1.055 * p - 0.055, 1.055 / 2.4 * p / (t * (1.0 + x)))
        }
    }
}

#[inline(always)]
fn mul_add<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Exponent e and mantissa m of a positive normal number, `z = 2^e m` with `m` in `[sqrt(1/2), sqrt(2))`.
#[inline(always)]
fn split(z: f32) -> (i32, f32) {
    const ROOT_HALF: i32 = 0x3f35_04f3;
    let bits = z.to_bits() as i32;
    let e = (bits - ROOT_HALF) >> 23;
    (e, f32::from_bits((bits - (e << 23)) as u32))
}

/// `e ln 2 + ln(1 + f)` for `1 + f` in `[sqrt(1/2), sqrt(2))`: `ln(1 + f) = 2 atanh(f / (2 + f))`, whose series is exact
/// to 8e-8 after four terms.
#[inline(always)]
fn ln<const FMA: bool>(e: i32, f: f32) -> f32 {
    let s = f / (2.0 + f);
    let s2 = s * s;
    let series = mul_add::<FMA>(s2, 1.0 / 7.0, 1.0 / 5.0);
    let series = mul_add::<FMA>(s2, series, 1.0 / 3.0);
    let twice = s + s;
    let ln_m = mul_add::<FMA>(twice * s2, series, twice);
    mul_add::<FMA>(e as f32, std::f32::consts::LN_2, ln_m)
}

/// `exp2` for magnitudes below 100: Taylor's series about the nearest integer.
#[inline(always)]
fn exp2<const FMA: bool>(y: f32) -> f32 {
    // Adding 1.5 * 2^23 leaves the nearest integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    const L: f32 = std::f32::consts::LN_2;
    let shifted = y + ROUND;
    let r = y - (shifted - ROUND);
    let mut p = L * L * L * L * L * L / 720.0;
    for c in [L * L * L * L * L / 120.0, L * L * L * L / 24.0, L * L * L / 6.0, L * L / 2.0, L, 1.0] {
        p = mul_add::<FMA>(p, r, c);
    }
    // The integer goes to the exponent; the shift drops what ROUND put above it.
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

impl LossScalar for f32 {
    #[inline(always)]
    fn log_srgb<const FMA: bool>(x: Self) -> (Self, Self) {
        let z = 1.0 + x;
        let (e, m) = split(z);
        // For a small x, x itself is exact while 1 + x - 1 is not.
        let t = ln::<FMA>(e, if e == 0 { x } else { m - 1.0 });
        // The power is evaluated on the curved part only, the linear part replaces it below.
        let end = LINEAR_END as Self;
        let linear = t <= end;
        let u = if linear { end } else { t };
        let (e, m) = split(u);
        let p = exp2::<FMA>(ln::<FMA>(e, m - 1.0) * (std::f32::consts::LOG2_E / 2.4));
        // 12.92 / z and 1.055 / 2.4 p / (t z) with one division; u = t on the curved part.
        let linear_slope = LINEAR_SLOPE as Self;
        let numerator = if linear { linear_slope * u } else { (1.055 / 2.4) * p };
        let value = if linear { linear_slope * t } else { mul_add::<FMA>(1.055, p, -0.055) };
        (value, numerator / (u * z))
    }
}
