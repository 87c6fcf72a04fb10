//! The loss of a fit, chosen by how noisy the pictures of the reference are.

use super::trainer::{HeldOut, Measure};
use photofit_raster::loss::{self, Loss, LossScalar};
use photofit_scalar::Real;

/// Relative noise above which a logarithmic loss would pull the result too dark: at .1, .2, .3, .5 and 1 its optimum is
/// off by -.3, -1.3, -3.1, -8.3 and -31%, that of the squared error by nothing.
const MOST_NOISE: f64 = 0.15;

/// The same of the candidate's own pictures, for squares: a reference of half of it, the optimum is less than 2% off.
const MOST_CANDIDATE_NOISE: f64 = 0.1;

/// How much each pixel of a comparison counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weights {
    /// All alike.
    #[default]
    Equal,
    /// See [`relative_weights`].
    Relative,
}

/// How pictures are compared: the loss of a pixel, and how much it counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureLoss {
    /// Of a pixel.
    pub loss: Loss,
    /// Of the pixels.
    pub weights: Weights,
}

impl From<Loss> for PictureLoss {
    /// All pixels count alike.
    fn from(loss: Loss) -> Self {
        Self { loss, weights: Weights::Equal }
    }
}

impl PictureLoss {
    /// Squares of linear light relative to what it should be around a pixel: of wide ranges, and with little bias by noise.
    pub const RELATIVE_SQUARES: Self = Self { loss: Loss::Mse, weights: Weights::Relative };

    /// The losses that can be asked for by name.
    pub const ALL: [Self; 7] = [
        Self { loss: Loss::Mse, weights: Weights::Equal },
        Self::RELATIVE_SQUARES,
        Self { loss: Loss::LogSrgbL1, weights: Weights::Equal },
        Self { loss: Loss::LogSrgbL2, weights: Weights::Equal },
        Self { loss: Loss::Smape, weights: Weights::Equal },
        Self { loss: Loss::RelativeL2, weights: Weights::Equal },
        Self { loss: Loss::Ssim, weights: Weights::Equal },
    ];

    /// Its name.
    pub fn name(&self) -> &'static str {
        match (self.loss, self.weights) {
            (Loss::Mse, Weights::Equal) => "squares",
            (_, Weights::Relative) => "relative-squares",
            (Loss::LogSrgbL1, _) => "log-l1",
            (Loss::LogSrgbL2, _) => "log-l2",
            (Loss::Smape, _) => "smape",
            (Loss::RelativeL2, _) => "relative-l2",
            (Loss::Ssim, _) => "ssim",
        }
    }

    /// What it is good for.
    pub fn about(&self) -> &'static str {
        match (self.loss, self.weights) {
            (Loss::Mse, Weights::Equal) => "squared differences of light; noise does not bias them",
            (_, Weights::Relative) => "the same relative to the mean light around a pixel, for light above 1",
            (Loss::LogSrgbL1, _) => {
                "absolute differences as a screen shows them; pixels that are wrong in a few pictures count little"
            }
            (Loss::LogSrgbL2, _) => "squared differences as a screen shows them",
            (Loss::Smape, _) => {
                "absolute differences relative to both pixels; dark parts count as bright ones"
            }
            (Loss::RelativeL2, _) => "squared differences relative to both pixels",
            (Loss::Ssim, _) => "structural similarity; brightness counts less than detail",
        }
    }

    /// `factor` times the mean loss of the colours of `pixels` `[height * width]` against `reference`; adds its gradient to
    /// `gradient`. Alpha counts for nothing.
    ///
    /// # Panics
    /// If the numbers of pixels differ.
    pub fn value_and_gradient<T: LossScalar>(
        &self,
        (width, height): (usize, usize),
        pixels: &[[T; 4]],
        reference: &[[T; 4]],
        factor: f64,
        gradient: &mut [[T; 4]],
    ) -> f64 {
        let weights: Vec<T> = match self.weights {
            Weights::Equal => Vec::new(),
            Weights::Relative => relative_weights((width, height), reference),
        };
        let mut layout = loss::PictureLayout::new(width, height, 4).only(0..3);
        if self.weights == Weights::Relative {
            layout = layout.weighted(&weights);
        }
        let (x, y) = (pixels.as_flattened(), reference.as_flattened());
        self.loss.value_and_gradient(x, y, &layout, factor, gradient.as_flattened_mut())
    }
}

/// The loss that goes with how the held-out views are judged and with the noise of their pictures. Where they are judged
/// without clamping, relative to the reference, so are the steps; else it is robust and logarithmic for clean pictures,
/// unbiased squares for noisy ones and for those of which it is not known.
pub fn choose(held_out: &HeldOut) -> PictureLoss {
    let clean = held_out.noise.is_some_and(|n| n <= MOST_NOISE);
    match held_out.measure {
        Measure::Relative => PictureLoss::RELATIVE_SQUARES,
        Measure::Psnr | Measure::PsnrOfViews if clean => Loss::LogSrgbL1.into(),
        Measure::Psnr | Measure::PsnrOfViews => Loss::Mse.into(),
    }
}

/// The loss of steps whose candidate pictures are noisy, too, by `factor` times the relative noise of the held-out
/// references: squares as a screen shows them where that is small, else squares relative to what is around, which noise
/// does not bias.
pub fn choose_for_noisy(held_out: &HeldOut, factor: f64) -> PictureLoss {
    match held_out.noise {
        Some(noise) if noise * factor.max(1.0) <= MOST_CANDIDATE_NOISE => Loss::LogSrgbL2.into(),
        _ => PictureLoss::RELATIVE_SQUARES,
    }
}

/// Pixels on either side of one whose mean its weight follows.
pub(super) const ASIDE: usize = 2;

/// Weights of the squared errors of the pixels `[height * width]` of a picture that should have these linear colours:
/// `1 / (mean^2 + .01)`, so that bright parts do not drown the others. The mean is over the channels of 5 x 5 pixels,
/// fewer at the border. A weight of a noisy pixel alone would be large where that happens to be dark: with relative noise
/// of .15 and .3 the optimum would be off by -4 and -15%; of 25 pixels with noise of their own it is by less than 1%.
///
/// # Panics
/// If the number of pixels is another.
pub fn relative_weights<T: Real>((width, height): (usize, usize), reference: &[[T; 4]]) -> Vec<T> {
    assert_eq!(reference.len(), width * height, "one colour per pixel");
    let around = |at: usize, end: usize| at.saturating_sub(ASIDE)..(at + ASIDE + 1).min(end);
    let grey = |p: &[T; 4]| (p[0] + p[1] + p[2]) / T::of(3.0);
    let mean = |of: &dyn Fn(usize) -> T, range: std::ops::Range<usize>| {
        let count = T::of(range.len() as f64);
        range.map(of).fold(T::zero(), |sum, x| sum + x) / count
    };
    let mut rows = Vec::with_capacity(reference.len());
    for y in 0..height {
        let row = &reference[y * width..(y + 1) * width];
        rows.extend((0..width).map(|x| mean(&|k| grey(&row[k]), around(x, width))));
    }
    let weight = |i: usize| {
        let (x, y) = (i % width, i / width);
        let m = mean(&|k| rows[k * width + x], around(y, height));
        T::of(1.0) / (m * m + T::of(0.01))
    };
    (0..reference.len()).map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    /// The grey that fits pictures of mean .5 with relative noise `sigma` (log-normal samples) best, relative to .5, less 1.
    fn optimum(loss: PictureLoss, sigma: f64) -> f64 {
        optimum_of_noisy(loss, [0.0, sigma])
    }

    /// The same where the fitted pictures are noisy, too, with noise that the gradient's own samples do not know of.
    fn optimum_of_noisy(loss: PictureLoss, [of_candidate, of_reference]: [f64; 2]) -> f64 {
        let mut rng = Rng::new(3, 0);
        let mut normal = || {
            let (u, v) = (f64::from(rng.next_f32()).max(1e-12), f64::from(rng.next_f32()));
            (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
        };
        let mut samples = |mean: f64, sigma: f64| -> Vec<[f32; 4]> {
            let s2 = (1.0 + sigma * sigma).ln();
            (0..40_000).map(|_| [(mean * (s2.sqrt() * normal() - 0.5 * s2).exp()) as f32; 4]).collect()
        };
        let y = samples(0.5, of_reference);
        let noise = samples(1.0, of_candidate);
        let slope = |x: f32| {
            let mut g = vec![[0.0; 4]; y.len()];
            let pixels: Vec<[f32; 4]> = noise.iter().map(|n| n.map(|n| n * x)).collect();
            loss.value_and_gradient((200, 200), &pixels, &y, 1.0, &mut g);
            g.iter().map(|g| f64::from(g[0])).sum::<f64>()
        };
        let (mut lo, mut hi) = (0.1_f32, 1.0_f32);
        for _ in 0..30 {
            let x = 0.5 * (lo + hi);
            if slope(x) > 0.0 { hi = x } else { lo = x }
        }
        f64::from(lo) / 0.5 - 1.0
    }

    fn judged(measure: Measure, noise: Option<f64>) -> HeldOut {
        HeldOut::of(Vec::new(), noise).measured_by(measure)
    }

    #[test]
    fn the_chosen_loss_is_nearly_unbiased() {
        for noise in [0.0, 0.05, 0.1, 0.149, 0.16, 0.3, 1.0] {
            let bias = optimum(choose(&judged(Measure::Psnr, Some(noise))), noise);
            assert!(bias.abs() < 0.02, "noise {noise}: {bias}");
        }
        assert!(optimum(Loss::LogSrgbL1.into(), 1.0) < -0.2, "the other loss is biased");
        let relative = choose(&judged(Measure::Relative, None));
        for noise in [0.0, 0.15, 0.3] {
            let bias = optimum(relative, noise);
            assert!(bias.abs() < 0.01, "relative squares, noise {noise}: {bias}");
        }
    }

    #[test]
    fn the_loss_of_noisy_candidates_is_nearly_unbiased() {
        for (noise, factor) in [(0.0, 2.0), (0.03, 2.0), (0.05, 2.0), (0.1, 1.0), (0.06, 2.0), (0.15, 2.0)] {
            let loss = choose_for_noisy(&judged(Measure::Psnr, Some(noise)), factor);
            let bias = optimum_of_noisy(loss, [noise * factor, noise]);
            assert!(bias.abs() < 0.02, "noise {noise} x {factor}, {}: {bias}", loss.name());
        }
        let bias = optimum_of_noisy(Loss::LogSrgbL2.into(), [0.3, 0.15]);
        assert!(bias.abs() > 0.04, "beyond the bound squares as a screen shows them are biased: {bias}");
        assert_eq!(choose_for_noisy(&judged(Measure::Psnr, None), 1.0), PictureLoss::RELATIVE_SQUARES);
    }

    #[test]
    fn every_loss_has_a_name_and_falls_towards_its_reference() {
        let mut names: Vec<&str> = PictureLoss::ALL.iter().map(|l| l.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), PictureLoss::ALL.len());
        let picture = |x: f32| -> Vec<[f32; 4]> {
            (0..64).map(|i| [x * (1.0 + (i % 5) as f32), 0.5 * x, x, 1.0]).collect()
        };
        let reference = picture(0.2);
        for loss in PictureLoss::ALL {
            let value = |x: f32| {
                let mut g = vec![[0.0; 4]; 64];
                let v = loss.value_and_gradient((8, 8), &picture(x), &reference, 1.0, &mut g);
                let along = g.iter().zip(picture(1.0)).map(|(g, d)| (0..3).map(|k| g[k] * d[k]).sum::<f32>());
                (v, along.sum::<f32>())
            };
            let ((far, slope), (near, _), (there, _)) = (value(0.3), value(0.22), value(0.2));
            assert!(far > near && near > there && there.abs() < 1e-5 && slope > 0.0, "{}", loss.name());
        }
    }

    #[test]
    fn loss_and_measure_are_of_one_kind() {
        for noise in [None, Some(0.0), Some(0.5)] {
            assert_eq!(choose(&judged(Measure::Relative, noise)), PictureLoss::RELATIVE_SQUARES);
            assert_eq!(choose(&judged(Measure::Psnr, noise)).weights, Weights::Equal);
        }
    }

    #[test]
    fn weights_follow_the_mean_around_a_pixel() {
        // A bright pixel in a corner: 9 pixels are around it there, 12, 16, 25 elsewhere.
        let mut picture = vec![[0.0_f64, 0.0, 0.0, 1.0]; 49];
        picture[0] = [3.0, 6.0, 9.0, 1.0];
        let weights = relative_weights((7, 7), &picture);
        let of = |mean: f64| 1.0 / (mean * mean + 0.01);
        for (x, y, mean) in
            [(0, 0, 6.0 / 9.0), (1, 0, 6.0 / 12.0), (2, 2, 6.0 / 25.0), (3, 0, 0.0), (6, 6, 0.0)]
        {
            let w = weights[y * 7 + x];
            assert!((w - of(mean)).abs() < 1e-9 * w, "({x}, {y}): {w}, {}", of(mean));
        }
    }
}
