//! Where features are noise: depth of field, media, and edges that one sample a pixel leaves jagged.
//!
//! White noise differs as much from its neighbour as from the pixel behind that, in every direction; smooth textures and
//! edges differ less from the neighbour, lines less along the line. Of the mean squared differences in a window, the least
//! of four directions at one step over the largest at two steps is 1 for white noise and 0 for straight edges.

use super::window::{blur_sums, gaussian_taps};
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Ratio of differences at which edges begin to count as jagged, and from which they do wholly.
const RANGE: [f32; 2] = [0.1, 0.4];
/// Deviation of the window in pixels.
const WINDOW: f32 = 2.0;
/// Mean squared difference below which nothing is jagged.
const LEAST: f32 = 1e-5;

/// The share of noise in a feature of any number of planes, between 0 and 1 per pixel; `None` if it is 0 everywhere.
pub(crate) fn noise_share(feature: &[f32], pixels: usize, width: usize) -> Option<Vec<f32>> {
    let taps = gaussian_taps(WINDOW);
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    let (mut near, mut far) = (vec![f32::INFINITY; pixels], vec![0.0_f32; pixels]);
    for direction in [[1, 0], [0, 1], [1, 1], [1, -1]] {
        let step = |k: isize| {
            blur_sums(&differences(feature, pixels, width, direction.map(|d| k * d)), width, &taps)
        };
        near.iter_mut().zip(step(1)).for_each(|(a, b)| *a = a.min(b));
        far.iter_mut().zip(step(2)).for_each(|(a, b)| *a = a.max(b));
    }
    let [low, high] = RANGE;
    let share = |(near, far): (&f32, &f32)| match *far > LEAST * sum * sum {
        true => ((near / far - low) / (high - low)).clamp(0.0, 1.0),
        false => 0.0,
    };
    let shares: Vec<f32> = near.iter().zip(&far).map(share).collect();
    shares.iter().any(|s| *s > 0.0).then_some(shares)
}

/// Squared differences to the pixel at an offset, summed over the planes; the border repeats.
fn differences(feature: &[f32], pixels: usize, width: usize, [dx, dy]: [isize; 2]) -> Vec<f32> {
    let height = pixels / width;
    let shifted = |i: usize, d: isize, n: usize| i.saturating_add_signed(d).min(n - 1);
    let mut out = vec![0.0; pixels];
    out.par_chunks_mut(width).enumerate().with_min_len(8).for_each(|(y, out)| {
        let other = shifted(y, dy, height);
        for plane in feature.chunks(pixels) {
            let (own, other) = (&plane[y * width..][..width], &plane[other * width..][..width]);
            for (x, o) in out.iter_mut().enumerate() {
                *o += (own[x] - other[shifted(x, dx, width)]).powi(2);
            }
        }
    });
    out
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
            share.map_or(0.0, |s| s.iter().sum::<f32>() / s.len() as f32)
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
