// Twin of `rng.rs`. 64 bits are two words, the lower one first.

// a * b, all of its bits.
fn multiply_wide(a: u32, b: u32) -> vec2<u32> {
    let al = a & 0xffffu;
    let ah = a >> 16u;
    let bl = b & 0xffffu;
    let bh = b >> 16u;
    let low = al * bl;
    let first = al * bh;
    let second = ah * bl;
    let middle = (low >> 16u) + (first & 0xffffu) + (second & 0xffffu);
    let high = ah * bh + (first >> 16u) + (second >> 16u) + (middle >> 16u);
    return vec2<u32>((low & 0xffffu) | (middle << 16u), high);
}

fn multiply64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let wide = multiply_wide(a.x, b.x);
    return vec2<u32>(wide.x, wide.y + a.x * b.y + a.y * b.x);
}

fn add64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2<u32>(low, a.y + b.y + select(0u, 1u, low < b.x));
}

// By 1 to 31 bits.
fn shift_right64(a: vec2<u32>, n: u32) -> vec2<u32> {
    return vec2<u32>((a.x >> n) | (a.y << (32u - n)), a.y >> n);
}

fn mix64(a: vec2<u32>) -> vec2<u32> {
    var z = multiply64(a ^ shift_right64(a, 30u), vec2<u32>(0x1ce4e5b9u, 0xbf58476du));
    z = multiply64(z ^ shift_right64(z, 27u), vec2<u32>(0x133111ebu, 0x94d049bbu));
    return z ^ shift_right64(z, 31u);
}

// Draw number `draw` of the generator with these keys (`Rng::keys`), uniform in [0, 1): what `next_f32` gives.
fn uniform_draw(keys: vec4<u32>, draw: u32) -> f32 {
    let golden = vec2<u32>(0x7f4a7c15u, 0x9e3779b9u);
    let first = mix64(add64(multiply64(vec2<u32>(draw, 0u), golden), keys.xy));
    let bits = mix64(first ^ keys.zw);
    return f32(bits.y >> 8u) * (1.0 / 16777216.0);
}
