//! The views that a fit is judged by and never moved by, and how its pictures of them are judged.

use crate::engine::judge::OUTLINE;
use crate::engine::loss::relative_weights;
use crate::engine::reference::Reference;
use crate::engine::views::{Sampling, Set, Shot, Views};
use crate::{FitError, Progress};
use photofit_image::psnr_from_mse;
use rayon::prelude::*;
use std::sync::OnceLock;

/// What the pictures of an evaluation are judged by; more dB are better.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measure {
    /// PSNR of the foreground after clamping to [0, 1] and sRGB encoding: what a screen shows.
    #[default]
    Psnr,
    /// The same, with each view counting alike, whatever the size of its picture.
    PsnrOfViews,
    /// `-10 log10` of the mean squared error of linear light, relative to the reference ([`relative_weights`]) and not
    /// clamped: what fits of radiance minimise.
    Relative,
}

impl Measure {
    /// A quality in words.
    pub(super) fn told(self, quality: f64) -> String {
        match self {
            Self::Psnr | Self::PsnrOfViews => format!("{quality:.2} dB"),
            Self::Relative => format!("relative squared error {:.4e}", relative_error(quality)),
        }
    }
}

/// The mean relative squared error that [`Measure::Relative`] tells in dB.
pub fn relative_error(quality: f64) -> f64 {
    10.0_f64.powf(-0.1 * quality)
}

/// The warning about an asset that no picture shows.
const UNSEEN: &str = "no camera sees anything of the asset (transparent all over, or too small beside its bounds): whatever is written \
                      looks the same";

/// The views of the early stop.
#[derive(Clone, Debug)]
pub struct HeldOut {
    shots: Vec<Shot>,
    /// Their reference pictures over noise, `[H*W]` each, once they are asked for.
    references: OnceLock<Vec<Vec<[f32; 4]>>>,
    /// Weights of their pixels, once they are asked for.
    weights: OnceLock<Vec<Vec<f32>>>,
    /// Mean relative noise of these pictures; `None` where that of one is not known.
    pub noise: Option<f64>,
    /// What they are judged by.
    pub measure: Measure,
}

impl HeldOut {
    /// Pictures of the reference from `count` held-out views.
    ///
    /// # Errors
    /// If a picture cannot be made.
    pub fn new(
        reference: &dyn Reference,
        views: &dyn Views,
        sampling: Sampling,
        count: u64,
        seed: u64,
    ) -> Result<Self, FitError> {
        let mut out = Self::of(Vec::new(), Some(0.0));
        for index in 0..count {
            let s = views.setup(Set::HeldOut, index, count);
            let picture = reference.picture(&s)?;
            out.noise = out.noise.zip(picture.noise).map(|(sum, noise)| sum + noise / count as f64);
            out.shots.push(Shot::new(&s, picture.image, sampling, seed ^ 0x5eed, index));
        }
        Ok(out)
    }

    /// These views, with the mean relative noise of their pictures.
    pub(crate) fn of(shots: Vec<Shot>, noise: Option<f64>) -> Self {
        Self {
            shots,
            references: OnceLock::new(),
            weights: OnceLock::new(),
            noise,
            measure: Measure::default(),
        }
    }

    /// The views with their reference pictures.
    pub fn shots(&self) -> &[Shot] {
        &self.shots
    }

    /// Their reference pictures over noise, `[H*W]` each; the fourth number is coverage.
    pub fn references(&self) -> &[Vec<[f32; 4]>] {
        let over = |s: &Shot| s.over_noise().reference;
        self.references.get_or_init(|| self.shots.par_iter().map(over).collect())
    }

    /// Whether the reference covers no pixel of any of these pictures.
    pub fn shows_nothing(&self) -> bool {
        let covers = |s: &Shot| s.shown.data.chunks_exact(4).any(|p| p[3] > 0.0);
        !self.shots.par_iter().any(covers)
    }

    /// Warns where [`Self::shows_nothing`]: every asset looks the same then.
    pub(crate) fn warn_unseen(&self, progress: &dyn Progress) {
        if self.shows_nothing() {
            progress.warn(UNSEEN);
        }
    }

    /// The same views, judged by another measure.
    #[must_use]
    pub fn measured_by(self, measure: Measure) -> Self {
        Self { measure, ..self }
    }

    /// Quality of pictures of these views, dB.
    pub fn quality(&self, pictures: &[Vec<[f32; 4]>]) -> f64 {
        match self.measure {
            Measure::Psnr | Measure::PsnrOfViews => self.psnr(pictures),
            Measure::Relative => self.relative(pictures),
        }
    }

    fn relative(&self, pictures: &[Vec<[f32; 4]>]) -> f64 {
        let references = self.references();
        let of = |(s, r): (&Shot, &Vec<[f32; 4]>)| relative_weights((s.width, s.height), r);
        let weights = self.weights.get_or_init(|| self.shots.iter().zip(references).map(of).collect());
        let one = |i: usize| {
            let (mut squares, mut count) = (0.0, 0.0);
            for ((c, r), weight) in pictures[i].iter().zip(&references[i]).zip(&weights[i]) {
                let weight = f64::from(*weight) / 3.0;
                squares += weight * (0..3).map(|k| (f64::from(c[k]) - f64::from(r[k])).powi(2)).sum::<f64>();
                count += 1.0;
            }
            [squares, count]
        };
        -10.0 * mean((0..pictures.len()).into_par_iter().map(one).collect()).log10()
    }

    /// Share of the squared error of pictures of these views, in [0, 1], in pixels that they cover otherwise than the reference.
    pub fn at_outline(&self, pictures: &[Vec<[f32; 4]>]) -> f64 {
        let one = |(picture, reference): (&Vec<[f32; 4]>, &Vec<[f32; 4]>)| {
            let (mut at, mut all) = (0.0, 0.0);
            for (c, r) in picture.iter().zip(reference) {
                let e = squared_error(c, r);
                all += e;
                if (c[3] - r[3]).abs() > OUTLINE {
                    at += e;
                }
            }
            [at, all]
        };
        let sums: Vec<[f64; 2]> = pictures.par_iter().zip(self.references()).map(one).collect();
        let [at, all] = sums.iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        if all > 0.0 { at / all } else { 0.0 }
    }

    /// PSNR (sRGB, foreground) of pictures of these views, over all their pixels; over the views where these count alike.
    pub fn psnr(&self, pictures: &[Vec<[f32; 4]>]) -> f64 {
        let one = |(picture, reference): (&Vec<[f32; 4]>, &Vec<[f32; 4]>)| {
            let (mut squares, mut count) = (0.0, 0.0);
            for (c, r) in picture.iter().zip(reference) {
                if c[3] > 0.0 || r[3] > 0.0 {
                    squares += squared_error(c, r);
                    count += 1.0;
                }
            }
            match self.measure {
                Measure::PsnrOfViews if count > 0.0 => [squares / count, 1.0],
                _ => [squares, count],
            }
        };
        psnr_from_mse(mean(pictures.par_iter().zip(self.references()).map(one).collect()))
    }
}

/// Mean squared difference of two colours as a screen shows them.
fn squared_error(c: &[f32; 4], r: &[f32; 4]) -> f64 {
    let e = |x: f32| photofit_image::srgb_encode(x.clamp(0.0, 1.0));
    (0..3).map(|k| f64::from(e(c[k]) - e(r[k])).powi(2)).sum::<f64>() / 3.0
}

/// The mean of what pictures have: sums and counts, added in the order of the pictures.
fn mean(of: Vec<[f64; 2]>) -> f64 {
    let [sum, count] = of.iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    sum / count.max(1.0)
}
