//! Where features are noise: depth of field, media, and edges that one sample a pixel leaves jagged.
//!
//! White noise differs as much from its neighbour as from the pixel behind that, in every direction; smooth textures and
//! edges differ less from the neighbour, lines less along the line. Of the mean squared differences in a window, the least
//! of four directions at one step over the largest at two steps is 1 for white noise and 0 for straight edges.

use super::pooled::{Pooled, SIDE, add_row};
use rayon::prelude::{IndexedParallelIterator, ParallelIterator};

/// Ratio of differences at which edges begin to count as jagged, and from which they do wholly.
const RANGE: [f32; 2] = [0.1, 0.4];
/// Deviation of the window in pixels.
const WINDOW: f32 = 2.0;
/// Mean squared difference below which nothing is jagged.
const LEAST: f32 = 1e-5;
/// Steps whose differences are compared.
const STEPS: [[usize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [1, usize::MAX]];

/// The share of noise in a feature of any number of planes, between 0 and 1 in each block; `None` if it is 0 everywhere.
pub(crate) fn noise_share(feature: &[f32], pixels: usize, width: usize) -> Option<Pooled<1>> {
    let height = pixels / width;
    let mut sums = Pooled::<{ 2 * STEPS.len() }>::new(width, height);
    let scratch = || vec![0.0; 2 * STEPS.len() * width];
    sums.rows().enumerate().for_each_init(scratch, |squares, (block, sums)| {
        squares.fill(0.0);
        for y in SIDE * block..(SIDE * (block + 1)).min(height) {
            for plane in feature.chunks(pixels) {
                let row = |y: usize| &plane[y * width..][..width];
                let runs = squares.chunks_mut(width);
                for (out, (k, [dx, dy])) in runs.zip((1..3).flat_map(|k| STEPS.map(|step| (k, step)))) {
                    let other = match dy {
                        usize::MAX => y.saturating_sub(k),
                        _ => (y + k * dy).min(height - 1),
                    };
                    add_squares(row(y), row(other), k * dx, out);
                }
            }
        }
        add_row(sums, squares, width);
    });
    sums.smooth_blocks(WINDOW);
    let blocks = sums.map(|s| {
        let (near, far) = s.split_at(STEPS.len());
        [near.iter().copied().fold(f32::INFINITY, f32::min), far.iter().copied().fold(0.0, f32::max)]
    });
    let least = LEAST * (SIDE * SIDE) as f32;
    let [low, high] = RANGE;
    let shares = blocks.map(|[near, far]| match far > least {
        true => [((near / far - low) / (high - low)).clamp(0.0, 1.0)],
        false => [0.0],
    });
    shares.sums.iter().any(|s| *s > 0.0).then_some(shares)
}

/// Adds the squared differences of a row to one `step` columns further; the border repeats.
fn add_squares(own: &[f32], other: &[f32], step: usize, out: &mut [f32]) {
    let inside = own.len().saturating_sub(step);
    for ((o, a), b) in out.iter_mut().zip(own).zip(&other[step.min(other.len())..]) {
        *o += (a - b) * (a - b);
    }
    let last = other[other.len() - 1];
    for (o, a) in out[inside..].iter_mut().zip(&own[inside..]) {
        *o += (a - last) * (a - last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    const SIZE: [usize; 2] = [96, 72];

    fn picture(of: impl FnMut(usize, usize) -> f32) -> Vec<f32> {
        let mut of = of;
        let [width, height] = SIZE;
        let plane: Vec<f32> = (0..width * height).map(|i| of(i % width, i / width)).collect();
        plane.repeat(3)
    }

    #[test]
    fn white_noise_is_told_from_textures_edges_and_lines() {
        let [width, height] = SIZE;
        let mut rng = Rng::new(1, 0);
        let mean = |feature: &[f32]| {
            let share = noise_share(feature, width * height, width);
            share.map_or(0.0, |s| s.sums.iter().sum::<f32>() / s.sums.len() as f32)
        };
        let noise = mean(&picture(|_, _| if rng.uniform(0.0, 1.0) < 0.3 { 0.8 } else { 0.2 }));
        assert!(noise > 0.9, "{noise}");
        let pictures: [fn(usize, usize) -> f32; 6] = [
            |_, _| 0.5,
            |x, _| 0.5 + 0.4 * (x as f32 * 0.3).sin(),
            |x, _| if x < 40 { 0.2 } else { 0.8 },
            |x, y| if 2 * x < 3 * y { 0.2 } else { 0.8 },
            |x, _| if x % 9 == 0 { 0.8 } else { 0.2 },
            |x, y| if (x + y) % 2 == 0 { 0.8 } else { 0.2 },
        ];
        for (k, picture_of) in pictures.into_iter().enumerate() {
            let share = mean(&picture(picture_of));
            assert!(share < 0.1, "picture {k}: {share}");
        }
    }
}
