//! Pixels without noise: a shown environment, emitters. They are kept as they are and do not reach their neighbours; nor
//! do the pixels around an emitter that show a part of it.

use super::RUN;
use super::frame::{Features, Frame};
use super::window::{blur_sums, gaussian_taps};
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelIterator, ParallelIterator, ParallelSlice, ParallelSliceMut,
};

/// Deviation over the level of a pixel below which it has no noise: half precision files round by as much.
const SILENT: f32 = 1e-3;
/// Where rays meet nothing, the variance of a pixel over the squared difference from its neighbours, below which what
/// varies is the texture of an environment: of `n` samples in its square 1 / (6 n) for a smooth texture and 1 / (2 n) at
/// edges; independent noise, of a medium, has 1 / 2.
const TEXTURE: f32 = 0.3;
/// Deviation in pixels of the window in which the two are compared.
const TEXTURE_WINDOW: f32 = 2.5;
/// Pixels on each side of the middle of a window that has to be silent as a whole.
///
/// Few samples can be equal by chance, under a light of one colour that half of them see; windows of them hardly are.
const REACH: usize = 2;
/// Lone silent pixels count if they are this many times as bright as the mean of all that is lit: small emitters.
const OUTSTANDING: f32 = 8.0;
/// A pixel near an emitter shows a part of it if this share of the emitter's radiance is in it, above what is beside.
const RIM: f32 = 0.1;
/// And it lies above what is beside by this many deviations of the noise there.
const NOISES: f32 = 4.0;
/// Pixels on each side of the window whose median is what lies beside an emitter.
const BESIDE: usize = 4;

/// A pixel and its radiance.
pub(crate) type ExactPixel = (usize, [f32; 3]);

/// The pixels whose known variance (or halves) is 0. Black ones only where the ray meets nothing: elsewhere all samples
/// may have missed the light. Pixels of weight 0 are holes.
pub(crate) fn exact_pixels(frame: &Frame<'_>, features: &Features<'_>, weight: &[f32]) -> Vec<ExactPixel> {
    let (n, width) = (frame.shape.pixels(), frame.shape.width);
    let color = |c: usize, i: usize| match frame.half {
        Some(half) => 0.5 * (frame.color[c * n + i] + half[c * n + i]),
        None => frame.color[c * n + i],
    };
    let level = |i: usize| (color(0, i) + color(1, i) + color(2, i)) * (1.0 / 3.0);
    let shown = shown(features, weight, width);
    let texture = textured(frame, &shown, &color);
    let mut silent = vec![0_u8; n];
    let mut sums = vec![(0.0_f64, 0_usize); n / width];
    silent.par_chunks_mut(width).zip(&mut sums).enumerate().with_min_len(8).for_each(|(y, (row, sum))| {
        for (x, s) in row.iter_mut().enumerate() {
            let i = y * width + x;
            if weight[i] <= 0.0 {
                continue;
            }
            let level = level(i);
            let limit = (level * SILENT).powi(2);
            let quiet = texture.get(i) == Some(&true) || (0..3).all(|c| variance(frame, c * n + i) <= limit);
            *s = u8::from(quiet && (shown[i] > 0 || level > 0.0));
            if level > 0.0 {
                *sum = (sum.0 + f64::from(level), sum.1 + 1);
            }
        }
    });
    if silent.iter().all(|s| *s == 0) {
        return Vec::new();
    }
    let windows = spread(&spread(&silent, width, u8::min), width, u8::max);
    let (sum, count) = sums.iter().fold((0.0, 0), |(s, k), (sum, count)| (s + sum, k + count));
    let bright = OUTSTANDING * (sum / count.max(1) as f64) as f32;
    let is_exact = |i: usize| silent[i] > 0 && (windows[i] > 0 || level(i) > bright);
    let exact: Vec<bool> = (0..n).into_par_iter().with_min_len(RUN).map(is_exact).collect();
    let emitted = |i: usize| if exact[i] && !missed(features, i) { level(i) } else { 0.0 };
    let noise = |i: usize| ((0..3).map(|c| variance(frame, c * n + i)).sum::<f32>() / 3.0).sqrt();
    let rims = rims(&exact, weight, width, &emitted, &level, &noise);
    let kept = |i: usize| exact[i] || rims[i];
    let pixels = (0..n).into_par_iter().with_min_len(RUN).filter(|i| kept(*i));
    pixels.map(|i| (i, [0, 1, 2].map(|c| color(c, i).max(0.0)))).collect()
}

/// Pixels that show a part of an emitter: their light is that of the emitter, so that it must not reach what is beside,
/// and their noise is that of the pixel filter alone. They lie between the emitter and what is beside, further from it than
/// noise gets.
fn rims(
    exact: &[bool],
    weight: &[f32],
    width: usize,
    emitted: &(impl Fn(usize) -> f32 + Sync),
    level: &(impl Fn(usize) -> f32 + Sync),
    noise: &(impl Fn(usize) -> f32 + Sync),
) -> Vec<bool> {
    let height = exact.len() / width;
    let around = |i: usize, reach: usize| {
        let (x, y) = (i % width, i / width);
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    };
    let median = |values: &mut [f32]| {
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    let all = (0..exact.len()).into_par_iter().with_min_len(RUN);
    let emitters: Vec<u8> = all.map(|i| u8::from(emitted(i) > 0.0)).collect();
    let mut rims = vec![false; exact.len()];
    if !emitters.contains(&1) {
        return rims;
    }
    let near = spread(&emitters, width, u8::max);
    rims.par_chunks_mut(width).enumerate().with_min_len(8).for_each(|(y, row)| {
        for (x, rim) in row.iter_mut().enumerate() {
            let i = y * width + x;
            if near[i] == 0 || exact[i] || weight[i] <= 0.0 {
                continue;
            }
            let beside = || around(i, BESIDE).filter(|j| !exact[*j] && weight[*j] > 0.0);
            let usual = median(&mut beside().map(level).collect::<Vec<_>>());
            let full = around(i, REACH).map(emitted).fold(0.0, f32::max);
            let own = level(i);
            let further = || NOISES * median(&mut beside().map(noise).collect::<Vec<_>>());
            *rim = own <= full && own - usual > RIM * (full - usual) && own - usual > further();
        }
    });
    rims
}

/// 1 at samples whose ray meets nothing.
fn shown(features: &Features<'_>, weight: &[f32], width: usize) -> Vec<u8> {
    let mut shown = vec![0_u8; weight.len()];
    shown.par_chunks_mut(width).enumerate().with_min_len(8).for_each(|(y, row)| {
        for (x, s) in row.iter_mut().enumerate() {
            let i = y * width + x;
            *s = u8::from(weight[i] > 0.0 && missed(features, i));
        }
    });
    shown
}

/// Pixels that show the texture of an environment: what varies in them varies between them too. Empty if there is none.
fn textured(frame: &Frame<'_>, shown: &[u8], color: &(impl Fn(usize, usize) -> f32 + Sync)) -> Vec<bool> {
    let (n, width) = (frame.shape.pixels(), frame.shape.width);
    if !shown.contains(&1) {
        return Vec::new();
    }
    let (mut own, mut between) = (vec![0.0; n], vec![0.0; n]);
    own.par_chunks_mut(width).zip(between.par_chunks_mut(width)).enumerate().with_min_len(8).for_each(
        |(y, (own, between))| {
            for x in (0..width).filter(|x| shown[y * width + x] > 0) {
                let i = y * width + x;
                own[x] = (0..3).map(|c| variance(frame, c * n + i)).sum();
                let (mut sum, mut count) = (0.0, 0.0);
                for (inside, j) in [(x + 1 < width, i + 1), (i + width < n, i + width)] {
                    if inside && shown[j] > 0 {
                        sum += (0..3).map(|c| (color(c, i) - color(c, j)).powi(2)).sum::<f32>();
                        count += 1.0;
                    }
                }
                between[x] = sum / f32::max(count, 1.0);
            }
        },
    );
    let taps = gaussian_taps(TEXTURE_WINDOW);
    let (own, between) = (blur_sums(&own, width, &taps), blur_sums(&between, width, &taps));
    let like = |i: usize| shown[i] > 0 && own[i] <= TEXTURE * between[i];
    (0..n).into_par_iter().with_min_len(RUN).map(like).collect()
}

/// Variance of the mean of a sample.
fn variance(frame: &Frame<'_>, i: usize) -> f32 {
    match (frame.half, frame.variance) {
        (Some(half), _) => 0.25 * (frame.color[i] - half[i]).powi(2),
        (None, Some(v)) => v[i].abs(),
        (None, None) => f32::INFINITY,
    }
}

/// Whether a guide says that the ray meets nothing.
fn missed(features: &Features<'_>, i: usize) -> bool {
    let zero = |planes: &[f32], channels: usize| {
        let n = planes.len() / channels;
        (0..channels).all(|c| planes[c * n + i] == 0.0)
    };
    match (&features.normal, &features.depth, &features.position) {
        (Some(normal), ..) => zero(normal, 3),
        (None, Some(depth), _) => zero(depth, 1),
        (None, None, position) => position.as_ref().is_some_and(|p| zero(p, 3)),
    }
}

/// The least or largest value of the window around each pixel, as far as the window lies inside.
fn spread(mask: &[u8], width: usize, pick: impl Fn(u8, u8) -> u8 + Sync) -> Vec<u8> {
    let height = mask.len() / width;
    let mut along = mask.to_vec();
    along.par_chunks_mut(width).zip(mask.par_chunks(width)).with_min_len(8).for_each(|(out, row)| {
        for k in 1..=REACH.min(width - 1) {
            out[k..].iter_mut().zip(row).for_each(|(o, v)| *o = pick(*o, *v));
            out.iter_mut().zip(&row[k..]).for_each(|(o, v)| *o = pick(*o, *v));
        }
    });
    let mut out = along.clone();
    out.par_chunks_mut(width).enumerate().with_min_len(8).for_each(|(y, out)| {
        for k in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            out.iter_mut().zip(&along[k * width..]).for_each(|(o, v)| *o = pick(*o, *v));
        }
    });
    out
}
