// Level of detail: twin of `level.rs`.

// Base-2 logarithm of a positive normal number: the same arithmetic as on the CPU, so that both choose the same texels.
fn log2_fast(x: f32) -> f32 {
    let shifted = bitcast<u32>(x) - 0x3f3504f3u;
    let e = bitcast<i32>(shifted) >> 23u;
    let m = bitcast<f32>((shifted & 0x007fffffu) + 0x3f3504f3u);
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    return f32(e) + ((0.577078 * s2 + 0.9617967) * s2 + 2.88539) * s;
}

// Level for the footprint d(u)/d(X,Y), d(v)/d(X,Y) on a base level of width x height texels.
fn level_of_detail(du: vec2<f32>, dv: vec2<f32>, width: u32, height: u32, bias: f32, coarsest: u32) -> f32 {
    let s = du * f32(width);
    let t = dv * f32(height);
    let a = s.x * s.x + t.x * t.x;
    let b = s.y * s.y + t.y * t.y;
    let c = s.x * s.y + t.x * t.y;
    let half_difference = (a - b) * 0.5;
    let axis = (a + b) * 0.5 + sqrt(half_difference * half_difference + c * c);
    var level = 0.0;
    if axis > 0.0 {
        level = log2_fast(axis) * 0.5 + bias;
    }
    return clamp_to(level, 0.0, f32(coarsest));
}
