//! A loss of an image: smooth the loss, or smooth the image.
//!
//! With the renderer `R` and a loss `L` of images, `E[L(R)]` and `L(E[R])` are different objectives: for a squared error
//! the first holds the variance of every pixel under the perturbation as well. [`RenderedLoss`] smooths the one or the
//! other ([`Smoothing`]).

use super::black_box::{Batch, BlackBox};
use super::directional::axis;
use super::error::SampledError;
use super::estimate::{Estimate, Estimator};
use super::kernel::GRADIENT_WEIGHT;
use super::objective::{GROUP, Objective, SamplePoint, SmoothedLoss, check, check_scales};
use crate::OptimError;
use draw::{Draw, Sum};

mod draw;

/// A function of the parameters whose values are images.
pub trait Renderer {
    /// Why a picture could not be rendered.
    type Error;

    /// Numbers in an image (pixels times channels).
    fn image_len(&self) -> usize;

    /// Renders each point of `batch`; `images` holds `batch.len()` images of [`Self::image_len`] numbers.
    ///
    /// # Errors
    /// Whatever makes a picture fail; it ends the estimate.
    fn render(&mut self, batch: &Batch<'_>, images: &mut [f64]) -> Result<(), Self::Error>;
}

/// A loss of an image with its first two derivatives.
pub trait ImageLoss {
    /// The loss.
    fn value(&self, image: &[f64]) -> f64;
    /// Writes dL/dimage to `gradient`.
    fn gradient(&self, image: &[f64], gradient: &mut [f64]);
    /// `a^T L'' b`.
    fn second(&self, image: &[f64], a: &[f64], b: &[f64]) -> f64;
}

/// Mean squared difference from a target image.
#[derive(Clone, Debug, PartialEq)]
pub struct SquaredError {
    /// The target.
    pub target: Vec<f64>,
}

impl SquaredError {
    fn share(&self) -> f64 {
        1.0 / self.target.len().max(1) as f64
    }
}

impl ImageLoss for SquaredError {
    fn value(&self, image: &[f64]) -> f64 {
        image.iter().zip(&self.target).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() * self.share()
    }

    fn gradient(&self, image: &[f64], gradient: &mut [f64]) {
        let factor = 2.0 * self.share();
        for (g, (a, b)) in gradient.iter_mut().zip(image.iter().zip(&self.target)) {
            *g = factor * (a - b);
        }
    }

    fn second(&self, _image: &[f64], a: &[f64], b: &[f64]) -> f64 {
        2.0 * self.share() * a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
    }
}

/// What is smoothed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothing {
    /// The loss: `E[L(R(theta + sigma t))]`. Unbiased from any number of samples.
    Loss,
    /// The image: `L(E[R(theta + sigma t)])`. Each estimate first renders `image_samples` pictures to know the mean
    /// image, then samples the derivative of the loss linearised there. Gradients are unbiased for losses quadratic in
    /// the image; the loss itself comes out too high by its noise.
    Image {
        /// Pictures behind the mean image, in antithetic pairs (rounded up to even).
        image_samples: usize,
    },
}

/// A loss of rendered images, smoothed as [`Smoothing`] says.
#[derive(Clone, Debug)]
pub struct RenderedLoss<R, L> {
    smoothed: SmoothedLoss<Linearised<R, L>>,
    smoothing: Smoothing,
    /// Pictures rendered for mean images and their derivatives.
    pictures: u64,
}

/// The loss of an image, or the image's product with a fixed one, as a black box.
#[derive(Clone, Debug)]
struct Linearised<R, L> {
    renderer: R,
    loss: L,
    adjoint: Option<Vec<f64>>,
    images: Vec<f64>,
}

/// Images rendered at once.
const IMAGES: usize = 64;

impl<R: Renderer, L: ImageLoss> BlackBox for Linearised<R, L> {
    type Error = R::Error;

    fn evaluate(&mut self, batch: &Batch<'_>, values: &mut [f64]) -> Result<(), R::Error> {
        let len = self.renderer.image_len();
        for (part, values) in batch.parts(IMAGES).zip(values.chunks_mut(IMAGES)) {
            self.images.clear();
            self.images.resize(part.len() * len, 0.0);
            self.renderer.render(&part, &mut self.images)?;
            for (value, image) in values.iter_mut().zip(self.images.chunks_exact(len)) {
                *value = match &self.adjoint {
                    Some(adjoint) => adjoint.iter().zip(image).map(|(a, b)| a * b).sum(),
                    None => self.loss.value(image),
                };
            }
        }
        Ok(())
    }
}

impl<R: Renderer, L: ImageLoss> RenderedLoss<R, L> {
    /// With a scale for each parameter.
    ///
    /// # Errors
    /// [`SampledError::Setting`] without parameters, for images without pixels, for a scale that is not finite and
    /// positive, and for 0 image samples.
    pub fn new(
        renderer: R,
        loss: L,
        scales: Vec<f64>,
        smoothing: Smoothing,
    ) -> Result<Self, SampledError<R::Error>> {
        check_scales(&scales)?;
        OptimError::setting(GROUP, "image length", 0.0, "at least 1", renderer.image_len() > 0)?;
        OptimError::setting(
            GROUP,
            "image samples",
            0.0,
            "at least 1",
            smoothing != Smoothing::Image { image_samples: 0 },
        )?;
        let black_box = Linearised { renderer, loss, adjoint: None, images: Vec::new() };
        Ok(Self { smoothed: SmoothedLoss::with_scales(black_box, scales)?, smoothing, pictures: 0 })
    }

    /// The loss and what it costs to know it: `E[L(R)]` or `L(E[R])`, from `samples` pictures.
    ///
    /// # Errors
    /// As [`Objective::gradient`].
    pub fn loss(&mut self, at: SamplePoint<'_>, samples: usize) -> Result<f64, SampledError<R::Error>> {
        let mut sum = Sum::default();
        let draw = Draw { samples, along: None, stream: 1 };
        let smoothing = self.smoothing;
        self.draw(at, &draw, |image, loss| match smoothing {
            Smoothing::Loss => sum.add_number(loss.value(image)),
            Smoothing::Image { .. } => sum.add(image, 1.0),
        })?;
        let mean = sum.mean();
        Ok(match smoothing {
            Smoothing::Loss => mean[0],
            Smoothing::Image { .. } => self.smoothed.black_box().loss.value(&mean),
        })
    }

    /// Finds the mean image, and makes the black box the loss linearised there. The mean image.
    fn linearise(&mut self, at: SamplePoint<'_>, samples: usize) -> Result<Vec<f64>, SampledError<R::Error>> {
        let mut sum = Sum::default();
        self.draw(at, &Draw { samples, along: None, stream: 2 }, |image, _| sum.add(image, 1.0))?;
        let mean = sum.mean();
        let black_box = self.smoothed.black_box_mut();
        let mut adjoint = vec![0.0; mean.len()];
        black_box.loss.gradient(&mean, &mut adjoint);
        black_box.adjoint = Some(adjoint);
        Ok(mean)
    }

    /// The mean image's derivative along a unit vector in units of sigma.
    fn slope(
        &mut self,
        at: SamplePoint<'_>,
        axis: &[f64],
        samples: usize,
        stream: u64,
    ) -> Result<Vec<f64>, SampledError<R::Error>> {
        let mut sum = Sum::default();
        let mut sign = 1.0;
        self.draw(at, &Draw { samples, along: Some(axis), stream }, |image, _| {
            sum.add(image, sign * GRADIENT_WEIGHT);
            sign = -sign;
        })?;
        Ok(sum.mean())
    }

    /// Renders pictures around `at` and shows each to `see`.
    fn draw(
        &mut self,
        at: SamplePoint<'_>,
        draw: &Draw<'_>,
        mut see: impl FnMut(&[f64], &L),
    ) -> Result<(), SampledError<R::Error>> {
        let sigma = check(
            at,
            self.smoothed.scales(),
            Estimator { samples: draw.samples.max(1), ..Estimator::default() },
        )?;
        let before = self.evaluations();
        let black_box = self.smoothed.black_box_mut();
        let len = black_box.renderer.image_len();
        let mut rendered = 0;
        for (points, seeds) in draw.parts(at, &sigma, IMAGES) {
            let batch = Batch::new(sigma.len(), &points, &seeds);
            let mut images = vec![0.0; len * batch.len()];
            black_box.renderer.render(&batch, &mut images).map_err(SampledError::BlackBox)?;
            for (i, image) in images.chunks_exact(len).enumerate() {
                if let Some(value) = image.iter().find(|v| !v.is_finite()) {
                    return Err(SampledError::NonFinite {
                        evaluation: before + rendered + i as u64,
                        seed: batch.seed(i),
                        value: *value,
                        point: batch.point(i).to_vec(),
                    });
                }
                see(image, &black_box.loss);
            }
            rendered += batch.len() as u64;
        }
        self.pictures += rendered;
        Ok(())
    }

    /// Runs an estimate of the linearised loss, with the mean image and its cost.
    fn around<T>(
        &mut self,
        at: SamplePoint<'_>,
        estimate: impl FnOnce(&mut Self, Option<&[f64]>) -> Result<T, SampledError<R::Error>>,
    ) -> Result<T, SampledError<R::Error>> {
        match self.smoothing {
            Smoothing::Loss => estimate(self, None),
            Smoothing::Image { image_samples } => {
                let mean = self.linearise(at, image_samples)?;
                let result = estimate(self, Some(&mean));
                self.smoothed.black_box_mut().adjoint = None;
                result
            }
        }
    }

    /// Completes an estimate of the linearised loss: the cost since `before`, and the loss for the mean.
    fn complete(&self, mut estimate: Estimate, mean: Option<&[f64]>, before: u64) -> Estimate {
        estimate.evaluations = self.evaluations() - before;
        if let Some(mean) = mean {
            estimate.mean = self.smoothed.black_box().loss.value(mean);
        }
        estimate
    }

    /// `axis^T J^T L'' J other`, from independent samples of the two slopes where they are the same.
    fn gauss_newton(
        &mut self,
        at: SamplePoint<'_>,
        mean: &[f64],
        axes: [&[f64]; 2],
        samples: usize,
    ) -> Result<f64, SampledError<R::Error>> {
        let a = self.slope(at, axes[0], samples, 3)?;
        let b = self.slope(at, axes[1], samples, 4)?;
        Ok(self.smoothed.black_box().loss.second(mean, &a, &b))
    }
}

impl<R: Renderer, L: ImageLoss> Objective for RenderedLoss<R, L> {
    type Error = R::Error;

    fn scales(&self) -> &[f64] {
        self.smoothed.scales()
    }

    fn evaluations(&self) -> u64 {
        self.smoothed.evaluations() + self.pictures
    }

    fn gradient(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<R::Error>> {
        let before = self.evaluations();
        self.around(at, |this, mean| {
            let estimate = this.smoothed.gradient(at, estimator)?;
            Ok(this.complete(estimate, mean, before))
        })
    }

    /// For smoothed images the sum of the linearised loss's curvature and of the Gauss-Newton term, the latter from
    /// `2 * estimator.samples` antithetic pairs of pictures. The variance is the former's.
    fn curvature(
        &mut self,
        at: SamplePoint<'_>,
        direction: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<R::Error>> {
        let before = self.evaluations();
        let sigma = check(at, self.smoothed.scales(), estimator)?;
        self.around(at, |this, mean| {
            let mut estimate = this.smoothed.curvature(at, direction, estimator)?;
            if let (Some(mean), Some((axis, length))) = (mean, axis(direction, &sigma)) {
                let square = this.gauss_newton(at, mean, [&axis, &axis], 2 * estimator.samples)?;
                estimate.value[0] += length * length * square;
                estimate.informative |= square != 0.0;
            }
            Ok(this.complete(estimate, mean, before))
        })
    }

    /// For smoothed images: as [`Self::curvature`], with one pair of slopes for each parameter.
    fn hessian(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<R::Error>> {
        let before = self.evaluations();
        let sigma = check(at, self.smoothed.scales(), estimator)?;
        self.around(at, |this, mean| {
            let mut estimate = this.smoothed.hessian(at, estimator)?;
            let Some(mean) = mean else { return Ok(this.complete(estimate, None, before)) };
            let n = sigma.len();
            let mut slopes = [Vec::with_capacity(n), Vec::with_capacity(n)];
            for k in 0..n {
                let axis: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == k))).collect();
                for (stream, slopes) in (3..).zip(&mut slopes) {
                    slopes.push(this.slope(at, &axis, 2 * estimator.samples, stream)?);
                }
            }
            let loss = &this.smoothed.black_box().loss;
            for (e, value) in estimate.value.iter_mut().enumerate() {
                let (i, j) = (e / n, e % n);
                let [a, b] = &slopes;
                let square = 0.5 * (loss.second(mean, &a[i], &b[j]) + loss.second(mean, &a[j], &b[i]));
                *value += square / (sigma[i] * sigma[j]);
                estimate.informative |= square != 0.0;
            }
            Ok(this.complete(estimate, Some(mean), before))
        })
    }

    /// For smoothed images the central difference of gradients with common random numbers, half a sigma to either side.
    fn hessian_product(
        &mut self,
        at: SamplePoint<'_>,
        vector: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<R::Error>> {
        match self.smoothing {
            Smoothing::Loss => self.smoothed.hessian_product(at, vector, estimator),
            Smoothing::Image { .. } => self.hessian_product_difference(at, vector, 0.5, estimator),
        }
    }
}
