//! Learning-rate schedules and the decay of the Laplacian's weight, as functions of the step.

/// A factor on the learning rate over the steps of a fit. Stateless: the same step gives the same factor after a resume.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Schedule {
    /// 1 at every step.
    #[default]
    Constant,
    /// `10^(-rate t)`.
    Exponential {
        /// Decades per step (0.0002 in the baseline of appearance-driven simplification).
        rate: f64,
    },
    /// Multiplied by `ratio` after every `every` steps.
    Staircase {
        /// Steps between drops; zero means none.
        every: u64,
        /// Factor of a drop.
        ratio: f64,
    },
    /// Linear warm-up from `1/warmup` to 1, then half a cosine down to `floor` at step `total`, and `floor` after.
    WarmupCosine {
        /// Steps of the warm-up.
        warmup: u64,
        /// Step at which the floor is reached.
        total: u64,
        /// Last factor.
        floor: f64,
    },
}

impl Schedule {
    /// Factor of step `t`, counted from 0.
    ///
    /// ```
    /// use photofit_optim::Schedule;
    /// let cosine = Schedule::WarmupCosine { warmup: 4, total: 104, floor: 0.0 };
    /// assert_eq!(cosine.factor(0), 0.25);
    /// assert_eq!(cosine.factor(4), 1.0);
    /// assert!((cosine.factor(54) - 0.5).abs() < 1e-12);
    /// ```
    pub fn factor(&self, t: u64) -> f64 {
        match *self {
            Self::Constant => 1.0,
            Self::Exponential { rate } => 10.0_f64.powf(-rate * t as f64),
            Self::Staircase { every, ratio } => match t.checked_div(every) {
                Some(drops) => ratio.powf(drops as f64),
                None => 1.0,
            },
            Self::WarmupCosine { warmup, .. } if t < warmup => (t + 1) as f64 / warmup as f64,
            Self::WarmupCosine { warmup, total, floor } => {
                if t >= total {
                    return floor;
                }
                let x = (t - warmup) as f64 / (total - warmup) as f64;
                floor + (1.0 - floor) * 0.5 * (1.0 + (std::f64::consts::PI * x).cos())
            }
        }
    }
}

/// Weight of the Laplacian regulariser over the steps: `l_t = lmin + (l_(t-1) - lmin) 10^(-k t)`, `lmin = 0.02 l_0`,
/// `l_0 = 0.25 L_image / L_laplacian` (Hasselgren et al. 2021, "Appearance-Driven Automatic 3D Model Simplification").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaplacianWeight {
    /// Weight at step 0.
    pub initial: f64,
    /// Decay constant `k`, 1e-6 in the paper's code.
    pub rate: f64,
}

impl LaplacianWeight {
    /// From the two losses at the start; `None` while the Laplacian loss is zero (at the initial mesh of the relative
    /// form) or a loss is not finite: ask again at the next step.
    pub fn from_losses(image: f64, laplacian: f64) -> Option<Self> {
        let initial = 0.25 * image / laplacian;
        (laplacian > 0.0 && image >= 0.0 && initial.is_finite()).then_some(Self { initial, rate: 1e-6 })
    }

    /// Weight at step `t`, in closed form: the recursion's factors multiply to `10^(-k t (t + 1) / 2)`.
    pub fn at(&self, t: u64) -> f64 {
        let least = 0.02 * self.initial;
        let t = t as f64;
        least + (self.initial - least) * 10.0_f64.powf(-self.rate * t * (t + 1.0) / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_have_their_known_values() {
        let exponential = Schedule::Exponential { rate: 0.0002 };
        assert!((exponential.factor(5000) - 0.1).abs() < 1e-12);
        let stairs = Schedule::Staircase { every: 50, ratio: 0.5 };
        assert_eq!([0, 49, 50, 199].map(|t| stairs.factor(t)), [1.0, 1.0, 0.5, 0.125]);
        assert_eq!(Schedule::Staircase { every: 0, ratio: 0.5 }.factor(9), 1.0);
        let cosine = Schedule::WarmupCosine { warmup: 10, total: 100, floor: 0.1 };
        assert!((0..9).all(|t| cosine.factor(t) < cosine.factor(t + 1)));
        assert!((10..100).all(|t| cosine.factor(t) > cosine.factor(t + 1)));
        assert_eq!([cosine.factor(100), cosine.factor(u64::MAX)], [0.1, 0.1]);
        // A warm-up longer than the run is cut, not divided by zero.
        assert_eq!(Schedule::WarmupCosine { warmup: 10, total: 5, floor: 0.1 }.factor(10), 0.1);
        assert_eq!(Schedule::default().factor(7), 1.0);
    }

    #[test]
    fn the_closed_form_is_the_recursion() {
        let weight = LaplacianWeight::from_losses(0.8, 0.01).unwrap();
        assert!((weight.initial - 20.0).abs() < 1e-12);
        let (least, mut l) = (0.02 * weight.initial, weight.initial);
        for t in 1..2000_u64 {
            l = least + (l - least) * 10.0_f64.powf(-1e-6 * t as f64);
            assert!((weight.at(t) / l - 1.0).abs() < 1e-9, "step {t}");
        }
        assert!(weight.at(2000) < 0.3 * weight.initial);
        assert_eq!(LaplacianWeight::from_losses(1.0, 0.0), None);
        assert_eq!(LaplacianWeight::from_losses(f64::NAN, 1.0), None);
    }
}
