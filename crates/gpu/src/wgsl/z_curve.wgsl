// Column and row of a lane in a square of 8 x 8, along a Z curve.
fn z_curve(lane: u32) -> vec2<u32> {
    let x = (lane & 1u) | ((lane >> 1u) & 2u) | ((lane >> 2u) & 4u);
    let y = ((lane >> 1u) & 1u) | ((lane >> 2u) & 2u) | ((lane >> 3u) & 4u);
    return vec2<u32>(x, y);
}
