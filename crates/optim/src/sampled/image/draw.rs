//! Pictures around a place: which to render, and their weighted mean.

use crate::sampled::directional::set_along;
use crate::sampled::kernel::gradient_magnitude;
use crate::sampled::noise::{Noise, hash};
use crate::sampled::objective::SamplePoint;

/// Pictures in antithetic pairs.
pub(crate) struct Draw<'a> {
    /// Pictures, rounded up to even.
    pub(crate) samples: usize,
    /// A unit vector along which the gradient kernel is used; the first of each pair lies on its positive side.
    pub(crate) along: Option<&'a [f64]>,
    /// Keeps the samples of different estimates apart.
    pub(crate) stream: u64,
}

impl Draw<'_> {
    /// Points and seeds, at most `at_once` (an even number) at a time.
    pub(crate) fn parts(
        &self,
        at: SamplePoint<'_>,
        sigma: &[f64],
        at_once: usize,
    ) -> impl Iterator<Item = (Vec<f64>, Vec<u64>)> {
        let pairs = self.samples.div_ceil(2);
        let (n, per_part) = (sigma.len(), at_once / 2);
        let seed = hash(at.seed, self.stream << 32);
        (0..pairs).step_by(per_part).map(move |first| {
            let count = per_part.min(pairs - first);
            let mut points = Vec::with_capacity(2 * count * n);
            let mut seeds = Vec::with_capacity(2 * count);
            let mut t = vec![0.0; n];
            for pair in first..first + count {
                let mut noise = Noise::new(seed, pair as u64);
                let y = (pair as f64 + noise.uniform()) / pairs as f64;
                noise.fill_normal(&mut t);
                if let Some(axis) = self.along {
                    set_along(&mut t, axis, gradient_magnitude(y));
                }
                for sign in [1.0, -1.0] {
                    points.extend(at.theta.iter().zip(sigma).zip(&t).map(|((x, s), t)| x + sign * s * t));
                    seeds.push(hash(!seed, pair as u64));
                }
            }
            (points, seeds)
        })
    }
}

/// A sum of images.
#[derive(Default)]
pub(crate) struct Sum {
    sum: Vec<f64>,
    count: f64,
}

impl Sum {
    pub(crate) fn add(&mut self, image: &[f64], weight: f64) {
        self.sum.resize(image.len(), 0.0);
        self.sum.iter_mut().zip(image).for_each(|(s, v)| *s += weight * v);
        self.count += 1.0;
    }

    pub(crate) fn add_number(&mut self, value: f64) {
        self.add(&[value], 1.0);
    }

    pub(crate) fn mean(self) -> Vec<f64> {
        let count = self.count.max(1.0);
        self.sum.into_iter().map(|s| s / count).collect()
    }
}
