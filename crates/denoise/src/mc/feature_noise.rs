//! Noise of the features: depth of field, media, and edges that one sample a pixel leaves jagged.
//!
//! White noise differs as much from its neighbour as from the pixel behind that, in every direction; smooth textures and
//! edges differ less from the neighbour, lines less along the line. Of the mean squared differences in a window, the least
//! of four directions at one step over the largest at two steps is 1 for white noise and 0 for straight edges.

use super::demodulate::{ALBEDO_FLOOR, divisor};
use super::window::{blur_mean, blur_sums, gaussian_taps};
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Ratio of differences at which values begin to count as noise, and from which they are noise alone: for the albedo, and for
/// edges.
const NOISE: [f32; 2] = [0.2, 0.5];
const JAGGED: [f32; 2] = [0.1, 0.4];
/// Deviations in pixels of the windows of the two.
const NOISE_WINDOW: f32 = 2.5;
const JAGGED_WINDOW: f32 = 2.0;
/// Mean squared difference below which nothing is noise.
const LEAST: f32 = 1e-5;
/// Deviations in pixels of the means that replace a noisy albedo: before the division, and in the product.
const BEFORE: f32 = 2.0;
const AFTER: f32 = 1.5;
/// Deviation in pixels of the windows in which the noise of two quotients is compared.
const COMPARED: f32 = 3.0;

/// The share of noise in a feature of any number of planes, between 0 and 1 per pixel; `None` if it is 0 everywhere.
fn noise_share(
    feature: &[f32],
    pixels: usize,
    width: usize,
    window: f32,
    range: [f32; 2],
) -> Option<Vec<f32>> {
    let taps = gaussian_taps(window);
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    let (mut near, mut far) = (vec![f32::INFINITY; pixels], vec![0.0_f32; pixels]);
    for direction in [[1, 0], [0, 1], [1, 1], [1, -1]] {
        let step = |k: isize| {
            blur_sums(&differences(feature, pixels, width, direction.map(|d| k * d)), width, &taps)
        };
        near.iter_mut().zip(step(1)).for_each(|(a, b)| *a = a.min(b));
        far.iter_mut().zip(step(2)).for_each(|(a, b)| *a = a.max(b));
    }
    let [low, high] = range;
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

/// How jagged the edges of the features are, between 0 and 1 per pixel: those of one sample a pixel, that an average over the
/// pixel would smooth.
pub(crate) fn jagged<'a>(
    features: impl Iterator<Item = &'a [f32]>,
    pixels: usize,
    width: usize,
) -> Option<Vec<f32>> {
    let shares = features.filter_map(|f| noise_share(f, pixels, width, JAGGED_WINDOW, JAGGED));
    shares.reduce(|a, b| a.iter().zip(b).map(|(a, b)| a.max(b)).collect())
}

/// An albedo of which a part is noise.
pub(crate) struct CleanAlbedo {
    /// To divide by: the noise stays where the light has it too, for then the quotient has less.
    pub(crate) before: Vec<f32>,
    /// To multiply by.
    pub(crate) after: Vec<f32>,
    /// Share of noise, mean over the pixels.
    pub(crate) share: f32,
}

/// Takes the noise out of an albedo (3 planes) of the noisy radiance `color`; `None` if there is none.
pub(crate) fn clean_albedo(
    albedo: &[f32],
    color: &[f32],
    weight: &[f32],
    width: usize,
) -> Option<CleanAlbedo> {
    let n = weight.len();
    let d = divisor(albedo);
    let share = noise_share(&d, n, width, NOISE_WINDOW, NOISE)?;
    let all = vec![1.0; n];
    let means = |planes: &[f32], weight: &[f32], sigma: f32| -> Vec<f32> {
        planes.chunks(n).flat_map(|plane| blur_mean(plane, weight, width, sigma)).collect()
    };
    let mean = divisor(&means(albedo, &all, BEFORE));
    let level =
        |of: &dyn Fn(usize) -> f32| (0..n).map(|i| of(i) + of(n + i) + of(2 * n + i)).collect::<Vec<f32>>();
    let [plain, divided] = [level(&|k| color[k]), level(&|k| color[k] / d[k] * mean[k])].map(|v| {
        let around = blur_mean(&v, weight, width, COMPARED);
        let square = |(v, m): (&f32, &f32)| if *m > 0.0 { (v / m - 1.0).powi(2).min(25.0) } else { 0.0 };
        let squares: Vec<f32> = v.iter().zip(&around).map(square).collect();
        blur_mean(&squares, weight, width, COMPARED)
    });
    let black = |i: usize| (0..3).all(|c| albedo[c * n + i] <= ALBEDO_FLOOR);
    let mut before = albedo.to_vec();
    for i in (0..n).filter(|i| share[*i] > 0.0 && plain[*i] < divided[*i]) {
        if !black(i) || share[i] > 0.5 {
            (0..3)
                .for_each(|c| before[c * n + i] = d[c * n + i] + share[i] * (mean[c * n + i] - d[c * n + i]));
        }
    }
    let mut after = divisor(&before);
    let lit: Vec<f32> =
        (0..n).map(|i| f32::from(u8::from((0..3).any(|c| after[c * n + i] > ALBEDO_FLOOR)))).collect();
    let mean = means(&after, &lit, AFTER);
    for (k, a) in after.iter_mut().enumerate().filter(|(k, _)| lit[k % n] > 0.0) {
        *a += share[k % n] * (mean[k] - *a);
    }
    let share = share.iter().sum::<f32>() / n as f32;
    Some(CleanAlbedo { before, after, share })
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
            let share = noise_share(feature, width * height, width, NOISE_WINDOW, NOISE);
            share.map_or(0.0, |s| s.iter().sum::<f32>() / s.len() as f32)
        };
        let noise = mean(&picture(|_, _| if rng.uniform() < 0.3 { 0.8 } else { 0.2 }));
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

    #[test]
    fn a_noisy_albedo_is_divided_by_where_the_light_has_its_noise() {
        let [width, height] = SIZE;
        let mut rng = Rng::new(2, 0);
        let albedo = picture(|_, _| if rng.uniform() < 0.3 { 0.8 } else { 0.2 });
        let weight = vec![1.0; width * height];
        // Each pixel is one point out of focus: its light is that of its albedo.
        let found = clean_albedo(&albedo, &albedo, &weight, width).expect("noise");
        assert_eq!(found.before, albedo);
        let far = |a: &[f32]| a.iter().map(|a| (a - 0.38).abs()).sum::<f32>() / a.len() as f32;
        assert!(far(&found.after) < 0.4 * far(&albedo), "{}", far(&found.after));
        // The light comes from a medium in front: the albedo says nothing of it.
        let medium = vec![0.5; albedo.len()];
        let found = clean_albedo(&albedo, &medium, &weight, width).expect("noise");
        assert!(far(&found.before) < 0.4 * far(&albedo), "{}", far(&found.before));
        assert!(clean_albedo(&medium, &albedo, &weight, width).is_none());
    }
}
