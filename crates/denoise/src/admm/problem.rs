//! What is minimised: data term, regularisers, weights.

use photofit_scalar::Real;

use crate::field::not_finite;
use crate::{DenoiseError, Shape};

/// Samples checked at once.
const CHUNK: usize = 1 << 12;

/// A weight: the same everywhere or one value per pixel.
#[derive(Clone, Debug, PartialEq)]
pub enum Weight<T> {
    /// The same at every sample.
    Uniform(T),
    /// One value per pixel (`width * height`, shared by the channels) or per sample (`channels * width * height`).
    Map(Vec<T>),
}

impl<T> From<T> for Weight<T> {
    fn from(value: T) -> Self {
        Self::Uniform(value)
    }
}

impl<T> From<Vec<T>> for Weight<T> {
    fn from(values: Vec<T>) -> Self {
        Self::Map(values)
    }
}

impl<T: Real> Weight<T> {
    /// The weight at sample `index` of a problem of this shape.
    #[inline]
    pub fn at(&self, index: usize, shape: Shape) -> T {
        match self {
            Self::Uniform(value) => *value,
            Self::Map(values) => {
                values[if values.len() == shape.len() { index } else { index % shape.pixels() }]
            }
        }
    }

    /// The mean over the image of values that are not zero; 0 if there are none.
    pub fn mean(&self) -> f64 {
        match self {
            Self::Uniform(value) => value.f64(),
            Self::Map(values) => {
                let (mut sum, mut count) = (0.0, 0_usize);
                for v in values.iter().filter(|v| **v > T::zero()) {
                    sum += v.f64();
                    count += 1;
                }
                sum / count.max(1) as f64
            }
        }
    }

    /// True when the channels share the weight.
    pub(crate) fn shared(&self, shape: Shape) -> bool {
        match self {
            Self::Uniform(_) => true,
            Self::Map(values) => values.len() == shape.pixels(),
        }
    }

    pub(crate) fn check(&self, what: &'static str, shape: Shape) -> Result<(), DenoiseError> {
        let bad = |v: T| !(v.is_finite() && v >= T::zero());
        match self {
            Self::Uniform(v) => DenoiseError::setting(what, v.f64(), "finite and not negative", !bad(*v)),
            Self::Map(values) => {
                if values.len() != shape.pixels() {
                    DenoiseError::length(what, values.len(), shape.len(), shape)?;
                }
                match values.iter().position(|v| bad(*v)) {
                    Some(i) if !values[i].is_finite() => Err(not_finite(what, values[i], i, shape)),
                    Some(i) => DenoiseError::setting(what, values[i].f64(), "not negative", false),
                    None => Ok(()),
                }
            }
        }
    }
}

/// The data term `rho(r)`, `r = u - u0`, per sample. A weight of 0 is a hole: the target there is not read.
#[derive(Clone, Debug, PartialEq)]
pub enum DataTerm<T> {
    /// `lambda/2 r^2`.
    L2 {
        /// Weight.
        lambda: Weight<T>,
    },
    /// `lambda |r|`.
    L1 {
        /// Weight.
        lambda: Weight<T>,
    },
    /// `l1 |r| + l2/2 r^2`.
    Hybrid {
        /// Weight of the absolute value.
        l1: Weight<T>,
        /// Weight of the square.
        l2: Weight<T>,
    },
    /// `lambda/2 r^2` for `r >= -delta`, linear below: a sample far above the estimate (behind the surface, for depth)
    /// pulls with a bounded force.
    Huber {
        /// Weight of the square.
        lambda: Weight<T>,
        /// Where the square ends.
        delta: Weight<T>,
    },
}

impl<T: Real> DataTerm<T> {
    /// `rho` at sample `index`.
    pub fn value(&self, index: usize, r: T, shape: Shape) -> f64 {
        let (x, at) = (r.f64(), |w: &Weight<T>| w.at(index, shape).f64());
        match self {
            Self::L2 { lambda } => 0.5 * at(lambda) * x * x,
            Self::L1 { lambda } => at(lambda) * x.abs(),
            Self::Hybrid { l1, l2 } => at(l1) * x.abs() + 0.5 * at(l2) * x * x,
            Self::Huber { lambda, delta } => {
                let d = at(delta);
                at(lambda) * if x >= -d { 0.5 * x * x } else { d * (-x - 0.5 * d) }
            }
        }
    }

    /// True where the target is not read.
    pub fn hole(&self, index: usize, shape: Shape) -> bool {
        let zero = |w: &Weight<T>| w.at(index, shape) == T::zero();
        match self {
            Self::L2 { lambda } | Self::L1 { lambda } | Self::Huber { lambda, .. } => zero(lambda),
            Self::Hybrid { l1, l2 } => zero(l1) && zero(l2),
        }
    }

    pub(crate) fn weights(&self) -> [Option<&Weight<T>>; 2] {
        match self {
            Self::L2 { lambda } | Self::L1 { lambda } => [Some(lambda), None],
            Self::Hybrid { l1, l2 } => [Some(l1), Some(l2)],
            Self::Huber { lambda, delta } => [Some(lambda), Some(delta)],
        }
    }

    pub(crate) fn check(&self, shape: Shape) -> Result<(), DenoiseError> {
        let names = match self {
            Self::L2 { .. } | Self::L1 { .. } => ["lambda", ""],
            Self::Hybrid { .. } => ["l1", "l2"],
            Self::Huber { .. } => ["lambda", "delta"],
        };
        for (weight, name) in self.weights().into_iter().zip(names) {
            if let Some(weight) = weight {
                weight.check(name, shape)?;
            }
        }
        Ok(())
    }
}

/// How the channels of an image share a regulariser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coupling {
    /// Each channel by itself.
    Separate,
    /// One norm over the components of all channels (vectorial total variation): edges of the channels stay together.
    Vectorial,
}

/// A target gradient for `gamma |grad u - g|`.
#[derive(Clone, Debug, PartialEq)]
pub struct Guide<'a, T> {
    /// Weight `gamma`.
    pub weight: Weight<T>,
    /// `g`: for each channel the plane of x, then the plane of y (`2 * channels * width * height` values); the last
    /// column of x and the last row of y are not read.
    pub gradient: &'a [T],
}

/// `E(u) = sum rho(u - u0) + sum alpha |grad u| + sum beta |H u|_F + sum gamma |grad u - g|` with natural boundaries.
///
/// All terms are convex. Absent terms take no time and no memory. Planes follow each other ([`Shape`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Problem<'a, T> {
    /// Shape of the target and the solution.
    pub shape: Shape,
    /// The noisy image `u0`.
    pub target: &'a [T],
    /// Data term.
    pub data: DataTerm<T>,
    /// `alpha`, the weight of the total variation.
    pub alpha: Option<Weight<T>>,
    /// `beta`, the weight of the Hessian.
    pub beta: Option<Weight<T>>,
    /// `gamma` and `g`.
    pub guide: Option<Guide<'a, T>>,
    /// Coupling of the channels in all regularisers.
    pub coupling: Coupling,
}

impl<'a, T: Real> Problem<'a, T> {
    /// A problem without regularisers.
    pub fn new(shape: Shape, target: &'a [T], data: DataTerm<T>) -> Self {
        Self { shape, target, data, alpha: None, beta: None, guide: None, coupling: Coupling::Separate }
    }

    /// With total variation.
    #[must_use]
    pub fn with_gradient(mut self, alpha: impl Into<Weight<T>>) -> Self {
        self.alpha = Some(alpha.into());
        self
    }

    /// With the Hessian.
    #[must_use]
    pub fn with_hessian(mut self, beta: impl Into<Weight<T>>) -> Self {
        self.beta = Some(beta.into());
        self
    }

    /// With a target gradient, see [`Guide`].
    #[must_use]
    pub fn with_guide(mut self, gamma: impl Into<Weight<T>>, gradient: &'a [T]) -> Self {
        self.guide = Some(Guide { weight: gamma.into(), gradient });
        self
    }

    /// With the channels coupled in all regularisers.
    #[must_use]
    pub fn vectorial(mut self) -> Self {
        self.coupling = Coupling::Vectorial;
        self
    }

    /// Checks lengths, ranges, and that everything that is read is finite.
    ///
    /// # Errors
    /// The first rule that is broken, with its place.
    pub fn check(&self) -> Result<(), DenoiseError> {
        let shape = self.shape;
        shape.check()?;
        DenoiseError::length("target", self.target.len(), shape.len(), shape)?;
        self.data.check(shape)?;
        for (weight, name) in [(&self.alpha, "alpha"), (&self.beta, "beta")] {
            if let Some(weight) = weight {
                weight.check(name, shape)?;
            }
        }
        // One chunk after the other, so that a good image costs one fast pass.
        let suspicious = |v: &&[T]| v.iter().fold(false, |bad, v| bad | !v.is_finite());
        for (chunk, values) in self.target.chunks(CHUNK).enumerate().filter(|(_, v)| suspicious(v)) {
            let bad = |&k: &usize| !values[k].is_finite() && !self.data.hole(chunk * CHUNK + k, shape);
            if let Some(k) = (0..values.len()).find(bad) {
                return Err(not_finite("target", values[k], chunk * CHUNK + k, shape));
            }
        }
        let Some(guide) = &self.guide else { return Ok(()) };
        guide.weight.check("gamma", shape)?;
        DenoiseError::length("the target gradient", guide.gradient.len(), 2 * shape.len(), shape)?;
        let read = |i: usize| {
            let (row, col, plane) = shape.position(i);
            if plane % 2 == 0 { col + 1 < shape.width } else { row + 1 < shape.height }
        };
        match guide.gradient.iter().enumerate().position(|(i, v)| !v.is_finite() && read(i)) {
            Some(i) => {
                let (row, col, plane) = shape.position(i);
                let value = guide.gradient[i].f64();
                Err(DenoiseError::NotFinite {
                    what: "the target gradient",
                    value,
                    row,
                    col,
                    channel: plane / 2,
                })
            }
            None => Ok(()),
        }
    }
}
