//! The filter over steps: exponential moving averages of gradients and of their squares.

use crate::error::OptimError;

/// What the step is divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SecondMoment {
    /// Nothing: the step is `rate m^` (gradient descent).
    None,
    /// `sqrt(v^)` of each entry, `v` the mean of `g^2` (Adam).
    PerEntry,
    /// `sqrt(v^)` of each vector of this many consecutive entries, `v` the mean of `|g|^2` (`VectorAdam`, Ling et al. 2022):
    /// directions are kept and results do not depend on the axes.
    PerVector(usize),
    /// The largest `sqrt(v^)` of the group (`UniformAdam`, Nicolet et al. 2021): directions of the whole group are kept.
    GlobalMax,
}

/// The temporal filter: `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`, step `rate m^ / (sqrt(v^) + eps)`.
///
/// Both decays zero is the memoryless filter: no moments are stored, and `m = g`, `v = g^2`. It is of use together with
/// a spatial postfilter, which then is the only average.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Temporal {
    /// Decay of the first moment, in `[0, 1)`.
    pub beta1: f64,
    /// Decay of the second moment, in `[0, 1)`.
    pub beta2: f64,
    /// What the step is divided by.
    pub second: SecondMoment,
    /// Epsilon over the root mean square of `sqrt(v^)` of the group, not negative: scale-free, unlike the customary
    /// absolute 1e-8, which stalls where gradients are about 1e-10. Unused without a second moment and with the
    /// global maximum.
    pub relative_epsilon: f64,
    /// Whether moments are divided by `1 - beta^t` (after the spatial filter).
    pub bias_correction: bool,
}

impl Default for Temporal {
    /// Adam.
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.999,
            second: SecondMoment::PerEntry,
            relative_epsilon: 1e-6,
            bias_correction: true,
        }
    }
}

impl Temporal {
    /// Adam (Kingma and Ba 2015) with decays .9 and .999.
    pub fn adam() -> Self {
        Self::default()
    }

    /// `UniformAdam` (Nicolet et al. 2021).
    pub fn uniform_adam() -> Self {
        Self { second: SecondMoment::GlobalMax, ..Self::default() }
    }

    /// `VectorAdam` (Ling et al. 2022) on vectors of `width` entries.
    pub fn vector_adam(width: usize) -> Self {
        Self { second: SecondMoment::PerVector(width), ..Self::default() }
    }

    /// Gradient descent with momentum as a moving average: `m = b m + (1 - b) g`, `p -= rate m^`. Polyak's heavy ball of
    /// rate `r` is this one at rate `r / (1 - b)`, but for the bias correction of the first steps.
    pub fn descent(momentum: f64) -> Self {
        Self { beta1: momentum, beta2: 0.0, second: SecondMoment::None, ..Self::default() }
    }

    /// Both decays zero: no memory.
    pub fn memoryless() -> Self {
        Self::default().betas(0.0, 0.0)
    }

    /// With other decays.
    #[must_use]
    pub fn betas(self, beta1: f64, beta2: f64) -> Self {
        Self { beta1, beta2, ..self }
    }

    /// With `beta1` and the `beta2` that belongs to it, `1 - beta1 = sqrt(1 - beta2)`: a lone gradient on a zero
    /// history then gives a step of exactly the rate, and no step is longer than [`Self::bound`] times the rate.
    #[must_use]
    pub fn paired(self, beta1: f64) -> Self {
        self.betas(beta1, 1.0 - (1.0 - beta1) * (1.0 - beta1))
    }

    /// `sqrt((2 - b1) / (2 (1 - b1)))`: the largest `|m| / sqrt(v)` for [paired](Self::paired) decays. It also holds
    /// after a spatial filter of both moments by the same non-negative weights of sum one.
    pub fn bound(&self) -> f64 {
        ((2.0 - self.beta1) / (2.0 * (1.0 - self.beta1))).sqrt()
    }

    pub(crate) fn check(&self, group: &str, len: usize) -> Result<(), OptimError> {
        for (name, beta) in [("beta1", self.beta1), ("beta2", self.beta2)] {
            OptimError::setting(group, name, beta, "in [0, 1)", (0.0..1.0).contains(&beta))?;
        }
        let epsilon = self.relative_epsilon;
        let good = epsilon >= 0.0 && epsilon.is_finite();
        OptimError::setting(group, "relative epsilon", epsilon, "finite and not negative", good)?;
        if let SecondMoment::PerVector(width) = self.second {
            let whole = width > 0 && len.is_multiple_of(width);
            let rule = "a divisor of the parameter count";
            OptimError::setting(group, "vector width", width as f64, rule, whole)?;
        }
        Ok(())
    }

    /// Entries of the first and of the second moment that are stored for `len` parameters.
    pub(crate) fn memory(&self, len: usize) -> [usize; 2] {
        if self.beta1 == 0.0 && self.beta2 == 0.0 {
            return [0, 0];
        }
        [len, self.second_len(len)]
    }

    /// Entries of the second moment, stored or not.
    pub(crate) fn second_len(&self, len: usize) -> usize {
        match self.second {
            SecondMoment::None => 0,
            SecondMoment::PerEntry | SecondMoment::GlobalMax => len,
            SecondMoment::PerVector(width) => len / width,
        }
    }

    /// `[1 / (1 - beta1^t), 1 / (1 - beta2^t)]`, or ones.
    pub(crate) fn corrections(&self, step: u64) -> [f64; 2] {
        if !self.bias_correction {
            return [1.0; 2];
        }
        let t = i32::try_from(step).unwrap_or(i32::MAX);
        [self.beta1, self.beta2].map(|beta| 1.0 / (1.0 - beta.powi(t)))
    }
}
