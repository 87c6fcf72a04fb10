// Directional albedo of the specular lobe: twin of `split_sum.rs`. The table lies in a buffer that the kernel declares,
//     var<storage, read> shading_tables: array<vec4<f32>>;
// as pairs (scale, bias) of an entry and of the next cosine.

const SPLIT_SUM_COSINES: u32 = 64u;
const SPLIT_SUM_ROUGHNESSES: u32 = 48u;
const GRAZING: f32 = 0.05;

struct SplitSum {
    // Scale and bias.
    value: vec2<f32>,
    // Their derivatives by the cosine and by the roughness.
    d_cosine: vec2<f32>,
    d_roughness: vec2<f32>,
}

fn split_sum(cosine: f32, roughness: f32) -> SplitSum {
    let c = clamp_to(cosine, COSINE_MIN, 1.0);
    let d_c = select(0.0, 1.0, c == cosine);
    let inv = 1.0 / (c + GRAZING);
    let to_x = (1.0 + GRAZING) * f32(SPLIT_SUM_COSINES - 1u);
    let x = c * inv * to_x;
    let d_x = to_x * GRAZING * inv * inv * d_c;

    let r = clamp_to(roughness, ROUGHNESS_MIN, 1.0);
    let to_y = f32(SPLIT_SUM_ROUGHNESSES - 1u) / (1.0 - ROUGHNESS_MIN);
    let y = (r - ROUGHNESS_MIN) * to_y;
    let d_y = select(0.0, to_y, r == roughness);

    let i = min(u32(x), SPLIT_SUM_COSINES - 2u);
    let j = min(u32(y), SPLIT_SUM_ROUGHNESSES - 2u);
    let fx = x - f32(i);
    let fy = y - f32(j);
    let near = shading_tables[j * SPLIT_SUM_COSINES + i];
    let far = shading_tables[(j + 1u) * SPLIT_SUM_COSINES + i];
    let d_near = near.zw - near.xy;
    let d_far = far.zw - far.xy;
    let low = near.xy + d_near * fx;
    let high = far.xy + d_far * fx;
    let slope = d_near + (d_far - d_near) * fy;
    return SplitSum(low + (high - low) * fy, slope * d_x, (high - low) * d_y);
}
