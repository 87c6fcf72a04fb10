// Twin of the tone curve `S(x) = G(ln(1 + x))` and its derivative in single precision: the same series, because the
// logarithm and the power of WGSL promise less.

const SAMPLE_MAX: f32 = 65535.0;
const LINEAR_END: f32 = 0.0031308;
const LINEAR_SLOPE: f32 = 12.92;
const LN_2: f32 = 0.69314718;

// Exponent e and mantissa m of a positive normal number, `z = 2^e m` with m in [sqrt(1/2), sqrt(2)).
struct Split {
    e: i32,
    m: f32,
}

fn split(z: f32) -> Split {
    let bits = bitcast<i32>(z);
    let e = (bits - 0x3f3504f3) >> 23u;
    return Split(e, bitcast<f32>(bits - (e << 23u)));
}

// `e ln 2 + ln(1 + f)`.
fn series_ln(e: i32, f: f32) -> f32 {
    let s = f / (2.0 + f);
    let s2 = s * s;
    let series = fma(s2, fma(s2, 0.14285715, 0.2), 0.33333334);
    let twice = s + s;
    return fma(f32(e), LN_2, fma(twice * s2, series, twice));
}

// `2^y` for magnitudes below 100.
fn series_exp2(y: f32) -> f32 {
    let n = round(y);
    let r = y - n;
    var p = 0.000154035303933816;
    p = fma(p, r, 0.00133335581464284);
    p = fma(p, r, 0.00961812910762848);
    p = fma(p, r, 0.0555041086648216);
    p = fma(p, r, 0.240226506959101);
    p = fma(p, r, LN_2);
    p = fma(p, r, 1.0);
    return bitcast<f32>(bitcast<i32>(p) + (i32(n) << 23u));
}

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

// Clamped magnitude, and 1 where it was not clamped, else 0.
fn clamp_magnitude(x: f32) -> vec2<f32> {
    let bits = bitcast<u32>(x) & 0x7fffffffu;
    if bits > bitcast<u32>(SAMPLE_MAX) {
        return vec2<f32>(SAMPLE_MAX, 0.0);
    }
    return vec2<f32>(bitcast<f32>(bits), 1.0);
}

// The odd continuation of the curve and its derivative, zero beyond the clamp.
fn tone(x: f32) -> vec2<f32> {
    let clamped = clamp_magnitude(x);
    let a = clamped.x;
    let z = 1.0 + a;
    let whole = split(z);
    let t = series_ln(whole.e, select(whole.m - 1.0, a, whole.e == 0));
    let linear = t <= LINEAR_END;
    let u = select(t, LINEAR_END, linear);
    let curved = split(u);
    let p = series_exp2(series_ln(curved.e, curved.m - 1.0) * 0.60112293);
    let numerator = select((1.055 / 2.4) * p, LINEAR_SLOPE * u, linear);
    let value = select(fma(1.055, p, -0.055), LINEAR_SLOPE * t, linear);
    return vec2<f32>(select(value, -value, x < 0.0), clamped.y * numerator / (u * z));
}
