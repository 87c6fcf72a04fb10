// Parameters of every kernel of a picture, and how its samples are numbered.
struct Frame {
    // World to clip space, row by row.
    rows: array<vec4<f32>, 4>,
    // Columns and rows of samples; samples per axis of a pixel.
    width: u32,
    height: u32,
    side: u32,
    layer: u32,
    vertices: u32,
    triangles: u32,
    // What a kernel with several uses is used for.
    mode: u32,
    // Units of fixed-point sums in one, a power of two.
    scale: f32,
    // Slope of faded masks; 0 cuts them.
    slope: f32,
    // 1 where alpha has a gradient.
    fits_alpha: u32,
    // 1 where backs of single-sided triangles are drawn, too.
    backs: u32,
    // Place of the first pixel of a picture without gradients.
    first: u32,
}

@group(0) @binding(0) var<uniform> params: Frame;

const NONE: u32 = 0xffffffffu;

fn sample_count() -> u32 {
    return params.width * params.height;
}

// The pixel that a sample belongs to.
fn pixel_of(i: u32) -> u32 {
    let x = i % params.width;
    let y = i / params.width;
    return (y / params.side) * (params.width / params.side) + x / params.side;
}
