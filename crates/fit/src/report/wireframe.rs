//! Wireframes with hidden lines removed: edges drawn inside the visible triangles by their distance in pixels.

use glam::Vec3;
use photofit_image::{Image, downsample};
use photofit_raster::project::{matrix_rows, project};
use photofit_raster::rasterize::{NONE, PixelGrid, barycentrics, rasterize};
use photofit_scalar::{Vec3f, Vec4f, vec3};
use photofit_scene::Camera;
use rayon::prelude::*;

/// Width and height of a wireframe.
pub(super) const SIDE: usize = 560;
/// Samples per axis of a pixel.
const SUPERSAMPLE: usize = 3;
/// Half the width of a line, pixels.
const HALF_WIDTH: f32 = 0.55;
/// Triangles lower than this, in pixels, are drawn with fainter lines, so that dense meshes stay readable.
const READABLE: f32 = 5.0;
const LINE: [f32; 3] = [0.08, 0.16, 0.30];
const PAPER: [f32; 3] = [1.0, 1.0, 1.0];

/// A mesh in the normalised frame, from one side and a little above.
pub(super) fn shaded(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Image {
    let camera = Camera::framing(Vec3::ZERO, 1.0, 0.6, 0.3, 0.7, 1.0);
    let mut clip = vec![Vec4f::zero(); positions.len()];
    project(&matrix_rows(&camera.view_projection()), positions, &mut clip);
    let to_eye = vec3(camera.eye.x, camera.eye.y, camera.eye.z).normalize_or_zero();
    draw(&clip, triangles, |t| {
        let [a, b, c] = triangles[t].map(|i| positions[i as usize]);
        let facing = (b - a).cross(c - a).normalize_or_zero().dot(to_eye).abs();
        let light = 0.68 + 0.28 * facing;
        [light * 0.97, light * 0.985, light]
    })
}

/// Draws triangles (clip space) with their edges as a display picture; `fill` gives the colour of a triangle.
pub(super) fn draw(clip: &[Vec4f], triangles: &[[u32; 3]], fill: impl Fn(usize) -> [f32; 3] + Sync) -> Image {
    let side = SIDE * SUPERSAMPLE;
    let seen = rasterize(clip, triangles, side, side, None);
    let grid = PixelGrid::new(side, side);
    let mut data = vec![PAPER; side * side];
    data.par_chunks_mut(side).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let t = seen.triangle[y * side + x];
            if t == NONE {
                continue;
            }
            let corners = triangles[t as usize].map(|i| clip[i as usize]);
            let b = barycentrics(&corners, grid.ndc(x, y), &grid);
            let ink =
                ink(&[(b.u, b.du.length()), (b.v, b.dv.length()), (1.0 - b.u - b.v, (b.du + b.dv).length())]);
            let color = fill(t as usize);
            *pixel = std::array::from_fn(|k| color[k] + (LINE[k] - color[k]) * ink);
        }
    });
    downsample(&Image::from_data(side, side, 3, data.into_flattened()), SUPERSAMPLE)
}

/// Darkness of a sample from the three barycentric coordinates and their change per sample.
fn ink(coordinates: &[(f32, f32); 3]) -> f32 {
    let scale = SUPERSAMPLE as f32;
    let (mut distance, mut height) = (f32::INFINITY, f32::INFINITY);
    for (value, slope) in coordinates {
        let samples = 1.0 / slope.max(1e-12);
        height = height.min(samples / scale);
        distance = distance.min(value.max(0.0) * samples / scale);
    }
    let strength = (height / READABLE).clamp(0.25, 1.0);
    if distance < HALF_WIDTH { strength } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec4;

    #[test]
    fn edges_are_dark_and_faces_light() {
        let clip = [vec4(-0.9, -0.9, 0.5, 1.0), vec4(0.9, -0.9, 0.5, 1.0), vec4(-0.9, 0.9, 0.5, 1.0)];
        let picture = draw(&clip, &[[0, 1, 2]], |_| [0.9; 3]);
        let at = |x: f32, y: f32| {
            picture.pixel(((x + 1.0) * 0.5 * SIDE as f32) as usize, ((1.0 - y) * 0.5 * SIDE as f32) as usize)
                [0]
        };
        assert!((at(-0.4, -0.4) - 0.9).abs() < 1e-5, "the face");
        assert!((at(0.5, 0.5) - 1.0).abs() < 1e-5, "the paper");
        let darkest = (0..40).map(|k| at(-0.3, -0.93 + 0.002 * k as f32)).fold(1.0, f32::min);
        assert!(darkest < 0.4, "the lower edge, {darkest}");
    }
}
