//! The loss of a fit, chosen by how noisy the pictures of the reference are.

use photofit_raster::loss::{self, Loss, LossScalar};
use photofit_scalar::Real;

/// Relative noise above which a logarithmic loss would pull the result too dark: at .1, .2, .3, .5 and 1 its optimum is
/// off by -.3, -1.3, -3.1, -8.3 and -31%, that of the squared error by nothing.
const MOST_NOISE: f64 = 0.15;

/// How much each pixel of a comparison counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weights {
    /// All alike.
    #[default]
    Equal,
    /// See [`relative_weight`].
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
    /// Squares of linear light relative to what it should be: of wide ranges, and without bias by noise.
    pub const RELATIVE_SQUARES: Self = Self { loss: Loss::Mse, weights: Weights::Relative };

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
            Weights::Relative => reference.iter().map(relative_weight).collect(),
        };
        let mut frame = loss::Frame::new(width, height, 4).only(0..3);
        if self.weights == Weights::Relative {
            frame = frame.weighted(&weights);
        }
        let (x, y) = (pixels.as_flattened(), reference.as_flattened());
        self.loss.value_and_gradient(x, y, &frame, factor, gradient.as_flattened_mut())
    }
}

/// The loss for pictures with this relative noise: robust and logarithmic for clean ones, unbiased squares for noisy
/// ones and for those of which it is not known.
pub fn choose(noise: Option<f64>) -> PictureLoss {
    let clean = noise.is_some_and(|n| n <= MOST_NOISE);
    let loss = if clean { Loss::LogSrgbL1 } else { Loss::Mse };
    loss.into()
}

/// Weight of the squared error of a pixel that should have this linear colour: relative to what it should be, so that
/// bright parts do not drown the others. Unlike a logarithm, such weights leave noise without bias.
pub fn relative_weight<T: Real>(reference: &[T; 4]) -> T {
    let mean = (reference[0] + reference[1] + reference[2]) / T::of(3.0);
    T::of(1.0) / (mean * mean + T::of(0.01))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_raster::loss::Frame;
    use photofit_sampling::Rng;

    /// The grey that fits pictures of mean .5 with relative noise `sigma` (log-normal samples) best.
    fn optimum(loss: Loss, sigma: f64) -> f64 {
        let s2 = (1.0 + sigma * sigma).ln();
        let mut rng = Rng::new(3, 0);
        let mut normal = || {
            let (u, v) = (f64::from(rng.next_f32()).max(1e-12), f64::from(rng.next_f32()));
            (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
        };
        let y: Vec<f32> =
            (0..40_000).map(|_| (0.5 * (s2.sqrt() * normal() - 0.5 * s2).exp()) as f32).collect();
        let frame = Frame::new(200, 200, 1);
        let slope = |x: f32| {
            let mut g = vec![0.0; y.len()];
            loss.value_and_gradient(&vec![x; y.len()], &y, &frame, 1.0, &mut g);
            g.iter().map(|g| f64::from(*g)).sum::<f64>()
        };
        let (mut lo, mut hi) = (0.1_f32, 1.0_f32);
        for _ in 0..30 {
            let x = 0.5 * (lo + hi);
            if slope(x) > 0.0 { hi = x } else { lo = x }
        }
        f64::from(lo) / 0.5 - 1.0
    }

    #[test]
    fn the_chosen_loss_is_nearly_unbiased() {
        for noise in [0.0, 0.05, 0.1, 0.149, 0.16, 0.3, 1.0] {
            let bias = optimum(choose(Some(noise)).loss, noise);
            assert!(bias.abs() < 0.02, "noise {noise}: {bias}");
        }
        assert!(optimum(Loss::LogSrgbL1, 1.0) < -0.2, "the other loss is biased");
    }
}
