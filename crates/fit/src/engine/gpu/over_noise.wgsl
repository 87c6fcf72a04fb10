// Puts a picture (linear, premultiplied) over noise: twin of `Shot::over_noise`.

struct Params {
    // Of the generator of the noise.
    keys: vec4<u32>,
    pixels: u32,
    // Largest radiance of the noise.
    most: f32,
    // Number of the first pixel in the whole picture.
    first: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// The picture, and what becomes of it.
@group(0) @binding(1) var<storage, read_write> reference: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> background: array<vec4<f32>>;

// One pixel an invocation.
@compute @workgroup_size(64)
fn over_noise(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.pixels {
        return;
    }
    let at = 3u * (params.first + i);
    let x = uniform_draw(params.keys, at);
    let y = uniform_draw(params.keys, at + 1u);
    let z = uniform_draw(params.keys, at + 2u);
    let b = params.most * vec3<f32>(x, y, z);
    let p = reference[i];
    background[i] = vec4<f32>(b, 0.0);
    reference[i] = vec4<f32>(p.xyz + (1.0 - p.w) * b, p.w);
}
