// Twins of `blend`, `transparent_part`, `average` and `magnify`, and of their adjoints.
@group(0) @binding(1) var<storage, read> triangle: array<u32>;
@group(0) @binding(2) var<storage, read> shaded: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> behind: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> background: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> live: array<u32>;
@group(0) @binding(6) var<storage, read_write> out: array<vec4<f32>>;

// What lies behind the layer: the next one if it is drawn, else the background.
fn behind_at(i: u32) -> vec4<f32> {
    if live[params.layer + 1u] == 0u {
        return vec4<f32>(background[pixel_of(i)].xyz, 0.0);
    }
    return behind[i];
}

// One invocation per sample: `alpha (rgb, 1) + (1 - alpha) behind` where the layer has a fragment.
@compute @workgroup_size(64)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    var c = behind_at(i);
    if triangle[i] != NONE {
        let s = shaded[i];
        c += s.w * (vec4<f32>(s.xyz, 1.0) - c);
    }
    out[i] = c;
}

@group(0) @binding(6) var<storage, read_write> g: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> g_shaded: array<vec4<f32>>;

// One invocation per sample: writes the gradient of the layer's fragments and turns `g` into that of what lies behind.
@compute @workgroup_size(64)
fn blend_vjp(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
             @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    var o = vec4<f32>(0.0);
    if triangle[i] != NONE {
        let s = shaded[i];
        let front = g[i];
        if params.fits_alpha != 0u {
            o.w = dot(front, vec4<f32>(s.xyz, 1.0) - behind_at(i));
        }
        o = vec4<f32>(s.w * front.xyz, o.w);
        g[i] = (1.0 - s.w) * front;
    }
    g_shaded[i] = o;
}

@group(0) @binding(3) var<storage, read> surfaces: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> front: array<u32>;
@group(0) @binding(5) var<storage, read_write> seen: array<atomic<u32>>;

// 2^-20: LEAST_TRANSMITTANCE of deferred/mod.rs.
const LEAST_TRANSMITTANCE: f32 = 9.5367431640625e-7;

fn hides(surface: vec2<u32>, drawn: f32) -> bool {
    let mode = surface.x & 3u;
    if params.fits_alpha != 0u {
        if mode == 2u {
            return false;
        }
        if mode == 1u && params.slope > 0.0 {
            return params.slope > 1.0 && drawn >= 1.0;
        }
    }
    return 1.0 - drawn < LEAST_TRANSMITTANCE;
}

// One invocation per sample: the layer restricted to samples that do not hide what lies behind; the next layer is drawn
// where there are any.
@compute @workgroup_size(64)
fn transparent_part(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                    @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    var t = triangle[i];
    if t != NONE && hides(surfaces[t], shaded[i].w) {
        t = NONE;
    }
    front[i] = t;
    if t != NONE && atomicLoad(&seen[params.layer + 1u]) == 0u {
        atomicStore(&seen[params.layer + 1u], 1u);
    }
}

@group(0) @binding(1) var<storage, read> samples: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> color: array<vec4<f32>>;

// One invocation per pixel: the mean of its samples.
@compute @workgroup_size(64)
fn average(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    let side = params.side;
    let columns = params.width / side;
    if i >= columns * (params.height / side) {
        return;
    }
    let first = (i / columns) * side * params.width + (i % columns) * side;
    let share = 1.0 / f32(side * side);
    var sum = vec4<f32>(0.0);
    for (var y = 0u; y < side; y++) {
        for (var x = 0u; x < side; x++) {
            sum += samples[first + y * params.width + x] * share;
        }
    }
    color[i] = sum;
}

@group(0) @binding(1) var<storage, read> g_color: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> g_samples: array<vec4<f32>>;

// One invocation per sample: its share of the gradient of its pixel.
@compute @workgroup_size(64)
fn magnify(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i < sample_count() {
        g_samples[i] = g_color[pixel_of(i)] * (1.0 / f32(params.side * params.side));
    }
}

@group(0) @binding(1) var<storage, read> layer_triangle: array<u32>;
@group(0) @binding(2) var<storage, read> layer_shaded: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> in_front: array<u32>;
@group(0) @binding(4) var<storage, read_write> layer_seen: array<atomic<u32>>;
// Premultiplied radiance, and the share of light from behind that passes.
@group(0) @binding(5) var<storage, read_write> laid: array<vec4<f32>>;

// One invocation per sample: lays a layer behind those before it. In mode 1 another one may follow: it is drawn where light from
// behind passes.
@compute @workgroup_size(64)
fn lay_behind(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
              @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    var so_far = vec4<f32>(0.0, 0.0, 0.0, 1.0);
    if params.layer > 0u {
        so_far = laid[i];
    }
    var t = layer_triangle[i];
    if t != NONE {
        let s = layer_shaded[i];
        if s.w > 0.0 {
            so_far += vec4<f32>(s.xyz * (so_far.w * s.w), 0.0);
        }
        so_far.w *= 1.0 - s.w;
        if so_far.w < LEAST_TRANSMITTANCE {
            so_far.w = 0.0;
            t = NONE;
        }
    }
    laid[i] = so_far;
    if params.mode == 0u {
        return;
    }
    in_front[i] = t;
    if t != NONE && atomicLoad(&layer_seen[params.layer + 1u]) == 0u {
        atomicStore(&layer_seen[params.layer + 1u], 1u);
    }
}

@group(0) @binding(1) var<storage, read> laid_samples: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> picture: array<vec4<f32>>;

// One invocation per pixel: the mean of its samples, with what they hide in place of what passes.
@compute @workgroup_size(64)
fn resolve(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    let side = params.side;
    let columns = params.width / side;
    if i >= columns * (params.height / side) {
        return;
    }
    let first = (i / columns) * side * params.width + (i % columns) * side;
    let share = 1.0 / f32(side * side);
    var sum = vec4<f32>(0.0);
    for (var y = 0u; y < side; y++) {
        for (var x = 0u; x < side; x++) {
            let s = laid_samples[first + y * params.width + x];
            sum += vec4<f32>(s.xyz, 1.0 - s.w) * share;
        }
    }
    picture[params.first + i] = sum;
}
