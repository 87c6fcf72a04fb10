// Where a silhouette edge crosses the line between two neighbouring samples. Uses `clip` and `triangles`.

// In the word of a pair: the right or lower sample is the closer one.
const SECOND_IS_CLOSER: u32 = 0x80000000u;

// The crossing of a pair: place of the edge's ends along and across it, in samples from the closer one's centre.
struct Crossing {
    vertices: vec2<u32>,
    a: vec2<f32>,
    b: vec2<f32>,
    // Blend factor; a positive one writes the first sample.
    alpha: f32,
}

// Position of a vertex in samples from the centre of sample `at`: x along the pair, y across it.
fn place(c: vec4<f32>, at: vec2<u32>, vertical: bool) -> vec2<f32> {
    let r = 0.5 / c.w;
    let x = (c.x + c.w) * r * f32(params.width) - (f32(at.x) + 0.5);
    let y = (c.w - c.y) * r * f32(params.height) - (f32(at.y) + 0.5);
    return select(vec2<f32>(x, y), vec2<f32>(y, x), vertical);
}

// The crossing that a word of `pairs` stands for; `i` is the left or upper sample.
fn crossing(word: u32, i: u32, vertical: bool) -> Crossing {
    var out: Crossing;
    let id = word & 0x7fffffffu;
    let t = id / 3u;
    let k = id % 3u;
    let second = word >= SECOND_IS_CLOSER;
    let sign = select(1.0, -1.0, second);
    let closer = vec2<u32>(i % params.width, i / params.width) + vec2<u32>(u32(second && !vertical), u32(second && vertical));
    out.vertices = vec2<u32>(triangles[3u * t + k], triangles[3u * t + (k + 1u) % 3u]);
    out.a = place(clip[out.vertices.x], closer, vertical);
    out.b = place(clip[out.vertices.y], closer, vertical);
    let along = sign * (out.a.x - out.a.y * (out.b.x - out.a.x) / (out.b.y - out.a.y));
    out.alpha = sign * (0.5 - clamp(along, 0.0, 1.0));
    return out;
}
