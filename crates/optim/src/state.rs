//! What an optimizer remembers between steps, as plain vectors for checkpoints.

use crate::error::OptimError;
use photofit_scalar::Real;

/// State of one parameter group.
///
/// Moments are kept in units of a power of two near the gradients' size, `2^scale_exponent`, so that gradients of 1e-20
/// and of 1e20 neither vanish nor overflow when squared in f32. Scaling by a power of two is exact.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State<T> {
    /// First moments (for SGD: velocities) over `2^scale_exponent`; empty where the optimizer keeps none.
    pub m: Vec<T>,
    /// Second moments over `4^scale_exponent`; empty where the optimizer keeps none.
    pub v: Vec<T>,
    /// Steps taken.
    pub step: u64,
    /// Binary exponent of the moments' unit.
    pub scale_exponent: i32,
    /// Running mean of the squared gradients over the group (decay beta2, not bias-corrected): the mean of `v`.
    pub mean_square: f64,
    /// Steps taken by each row, once rows have been stepped apart; else empty.
    pub row_steps: Vec<u32>,
}

impl<T: Real> State<T> {
    pub(crate) fn new(m: usize, v: usize) -> Self {
        Self { m: vec![T::zero(); m], v: vec![T::zero(); v], ..Self::default() }
    }

    /// Checks a state read from elsewhere against the one it is to replace.
    pub(crate) fn check(&self, group: &str, current: &Self) -> Result<(), OptimError> {
        OptimError::length(group, "first moments", self.m.len(), current.m.len())?;
        OptimError::length(group, "second moments", self.v.len(), current.v.len())?;
        let good = self.mean_square >= 0.0 && self.mean_square.is_finite();
        OptimError::setting(group, "mean square", self.mean_square, "finite and not negative", good)?;
        let exponent = f64::from(self.scale_exponent);
        OptimError::setting(group, "scale exponent", exponent, "within +-120", exponent.abs() <= 120.0)?;
        for (setting, values) in [("first moment", &self.m), ("second moment", &self.v)] {
            if let Some(x) = values.iter().find(|x| !x.is_finite()) {
                OptimError::setting(group, setting, x.f64(), "finite", false)?;
            }
        }
        Ok(())
    }

    /// `2^-scale_exponent`.
    pub(crate) fn inverse_scale(&self) -> T {
        T::of((-f64::from(self.scale_exponent)).exp2())
    }

    /// Takes the mean squared gradient of this step (in true units) into account, and moves the unit where it no
    /// longer fits.
    pub(crate) fn observe(&mut self, mean_square: f64, beta2: f64) {
        let before = self.mean_square;
        self.mean_square = beta2 * before + (1.0 - beta2) * mean_square;
        if self.mean_square <= 0.0 {
            return;
        }
        let wanted = (0.5 * self.mean_square.log2()).floor().clamp(-120.0, 120.0) as i32;
        let fresh = before == 0.0 && self.m.iter().all(|m| *m == T::zero());
        if fresh {
            self.scale_exponent = wanted;
        } else if (wanted - self.scale_exponent).abs() > 30 {
            let factor = f64::from(self.scale_exponent - wanted).exp2();
            let (first, second) = (T::of(factor), T::of(factor * factor));
            self.m.iter_mut().for_each(|m| *m *= first);
            self.v.iter_mut().for_each(|v| *v *= second);
            self.scale_exponent = wanted;
        }
    }
}
