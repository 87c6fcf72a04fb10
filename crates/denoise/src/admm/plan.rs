//! What a problem needs: which terms, which channels, how much memory.

use std::fmt;

use super::{Coupling, Penalties, Problem, Weight};
use crate::transform::{Sample, Symbol};

/// Where a channel of the solution comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelPlan {
    /// Solved.
    Solved,
    /// Constant in the target: the optimum is the target.
    Constant,
    /// Equal to an earlier channel: the optimum is equal too.
    SameAs(usize),
}

/// The work that a problem needs, derived before it starts.
///
/// | skip | when | saves |
/// |---|---|---|
/// | term | its weight is `None` or 0 everywhere | its splits (memory) and its part of the pass over the rows |
/// | constant channel | uniform, without holes and guide | the channel: its optimum is the target |
/// | equal channels | all channels of a coupled image, or any of separate ones, share target and weights | all but one |
/// | transforms | total variation or guide without holes, not too stiff ([`super::LinearStep`]) | the transforms: more than half of the time |
/// | converged channel | separate channels, tolerance stop | the channel's part of all further iterations |
///
/// Constant tiles are not skipped: the linear step is global, and the pass over the rows has no branches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdmmPlan {
    /// Total variation is on.
    pub gradient: bool,
    /// The Hessian is on.
    pub hessian: bool,
    /// The guided gradient is on.
    pub guide: bool,
    /// One entry per channel.
    pub channels: Vec<ChannelPlan>,
    /// The linear step is a sweep and not exact.
    pub sweep: bool,
    /// Columns with padding.
    pub padded_width: usize,
    /// Bytes of the solver's state.
    pub bytes: usize,
}

impl AdmmPlan {
    /// The system of the linear step: penalties of terms that are off count for nothing.
    pub(super) fn symbol(&self, p: Penalties) -> Symbol {
        let used = |on: bool, t: f64| if on { t } else { 0.0 };
        Symbol {
            c0: p.data,
            c1: used(self.gradient, p.gradient) + used(self.guide, p.guide),
            c2: used(self.hessian, p.hessian),
        }
    }

    pub(crate) fn new<T: Sample>(problem: &Problem<'_, T>, padded_width: usize) -> Self {
        let on = |w: Option<&Weight<T>>| match w {
            None => false,
            Some(Weight::Uniform(v)) => *v > T::zero(),
            Some(Weight::Map(values)) => values.iter().any(|v| *v > T::zero()),
        };
        Self {
            gradient: on(problem.alpha.as_ref()),
            hessian: on(problem.beta.as_ref()),
            guide: on(problem.guide.as_ref().map(|g| &g.weight)),
            channels: channels(problem),
            sweep: false,
            padded_width,
            bytes: 0,
        }
    }

    /// Indices of the solved channels.
    pub fn solved(&self) -> Vec<usize> {
        (0..self.channels.len()).filter(|&c| self.channels[c] == ChannelPlan::Solved).collect()
    }
}

impl fmt::Display for AdmmPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [("gradient", self.gradient), ("Hessian", self.hessian), ("guide", self.guide)];
        let terms: Vec<&str> = names.iter().filter(|(_, on)| *on).map(|(name, _)| *name).collect();
        write!(
            f,
            "terms: data {}; linear step: {}; channels solved: {} of {}; columns with padding: {}; state: {:.1} MiB",
            terms.join(" "),
            if self.sweep { "sweep" } else { "exact" },
            self.solved().len(),
            self.channels.len(),
            self.padded_width,
            self.bytes as f64 / (1 << 20) as f64
        )
    }
}

/// Finds constant and equal channels.
fn channels<T: Sample>(problem: &Problem<'_, T>) -> Vec<ChannelPlan> {
    let shape = problem.shape;
    let n = shape.pixels();
    let plane = |c: usize| &problem.target[c * n..(c + 1) * n];
    let mut plan = vec![ChannelPlan::Solved; shape.channels];
    if problem.guide.is_none() {
        let read = |c: usize| (0..n).all(|k| !problem.data.hole(c * n + k, shape));
        for (c, entry) in plan.iter_mut().enumerate() {
            let first = plane(c)[0];
            if plane(c).iter().all(|v| *v == first) && read(c) {
                *entry = ChannelPlan::Constant;
            }
        }
    }
    let shared = problem.data.weights().into_iter().flatten().all(|w| w.shared(shape))
        && [&problem.alpha, &problem.beta].into_iter().flatten().all(|w| w.shared(shape))
        && problem.guide.is_none();
    if !shared {
        return plan;
    }
    let solved: Vec<usize> = (0..shape.channels).filter(|&c| plan[c] == ChannelPlan::Solved).collect();
    let bits = |a: &T, b: &T| *a == *b || (a.is_nan() && b.is_nan());
    let equal = |a: usize, b: usize| plane(a).iter().zip(plane(b)).all(|(x, y)| bits(x, y));
    match problem.coupling {
        Coupling::Vectorial => {
            if solved.len() > 1 && solved[1..].iter().all(|&c| equal(solved[0], c)) {
                for &c in &solved[1..] {
                    plan[c] = ChannelPlan::SameAs(solved[0]);
                }
            }
        }
        Coupling::Separate => {
            for (k, &c) in solved.iter().enumerate() {
                let earlier = solved[..k].iter().find(|&&e| plan[e] == ChannelPlan::Solved && equal(e, c));
                if let Some(&earlier) = earlier {
                    plan[c] = ChannelPlan::SameAs(earlier);
                }
            }
        }
    }
    plan
}
