//! The solver: state, steps, solution.

use std::fmt;

use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

use super::exact::Exact;
use super::plan::{AdmmPlan, ChannelPlan};
use super::split::{Frame, TermFrame};
use super::stop::{Report, Stop};
use super::survey::{Survey, full};
use super::sweep::Sweep;
use super::{Coupling, DataTerm, LinearStep, Penalties, Problem, Weight};
use crate::transform::{Sample, StripSolver, fast_length};
use crate::{DenoiseError, Shape};

/// Stiffest system `(t1+t3) / t0` that the sweep takes by default.
const STIFFEST: f64 = 4.0;

/// Share of the target's contrast below which a solution counts as constant: against its own contrast, which is rounding, no
/// change is ever small.
const FLAT: f64 = 1e-2;

/// The over-relaxed splitting of one [`Problem`], see [the module](crate::admm).
///
/// ```
/// use photofit_denoise::admm::{Admm, DataTerm, Problem, Stop};
/// use photofit_denoise::Shape;
/// let shape = Shape::new(64, 8, 1);
/// let step: Vec<f64> = (0..512).map(|k| if k % 64 < 32 { 0.0 } else { 1.0 }).collect();
/// let problem = Problem::new(shape, &step, DataTerm::L2 { lambda: 0.2.into() }).with_gradient(1.0);
/// let mut admm = Admm::new(&problem)?;
/// admm.solve(Stop::Iterations(2000));
/// let u = admm.solution(); // the step keeps its place and loses 2/(lambda * 32) on each side
/// assert!((u[0] - 0.15625).abs() < 1e-6 && (u[63] - 0.84375).abs() < 1e-6);
/// # Ok::<(), photofit_denoise::DenoiseError>(())
/// ```
pub struct Admm<T: Sample> {
    pub(super) shape: Shape,
    pub(super) plan: AdmmPlan,
    pub(super) penalties: Penalties,
    pub(super) coupling: Coupling,
    pub(super) channels: Vec<usize>,
    frozen: Vec<bool>,
    /// Added back to each channel of the solution.
    pub(super) offsets: Vec<T>,
    pub(super) target: Vec<T>,
    pub(super) data: DataTerm<T>,
    pub(super) weights: [Option<Weight<T>>; 3],
    guide: Vec<T>,
    /// Squared norm of the target of each solved channel without its mean, over the samples that are read.
    contrast: Vec<f64>,
    /// Samples of the target that are not finite, and so must stay holes.
    unreadable: Vec<usize>,
    /// `1 / sqrt(k)` where `k` equal coupled channels are solved as one.
    pub(super) merged: f64,
    /// The estimate before the first step, if it is not the target.
    start: Option<Vec<T>>,
    /// `None` if no channel is solved.
    engine: Option<Engine<T>>,
    steps: usize,
}

/// The linear step and the splits it is fused with.
enum Engine<T: Sample> {
    Exact(Exact<T>),
    Sweep(Sweep<T>),
}

impl<T: Sample> fmt::Debug for Admm<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Admm({}, {}, step {})", self.shape, self.plan, self.steps)
    }
}

impl<T: Sample> Admm<T> {
    /// Starts at the target, with holes at the mean of their channel, and default penalties.
    ///
    /// # Errors
    /// If the problem does not pass [`Problem::check`].
    pub fn new(problem: &Problem<'_, T>) -> Result<Self, DenoiseError> {
        Self::owning(problem.clone(), LinearStep::Auto)
    }

    /// As [`Self::new`], without copies of the weights and with a choice of the linear step.
    ///
    /// # Errors
    /// If the problem does not pass [`Problem::check`], or if the sweep is asked for and the Hessian is on.
    pub fn owning(problem: Problem<'_, T>, linear: LinearStep) -> Result<Self, DenoiseError> {
        problem.check()?;
        let survey = Survey::new(&problem);
        let penalties = Penalties::at_contrast(&problem, survey.contrast);
        Self::build(problem, penalties, None, linear, survey)
    }

    /// Starts at `start` (or, without it, as [`Self::new`]) with the given penalties. The first step is the one that
    /// follows an estimate equal to `start`.
    ///
    /// # Errors
    /// If the problem does not pass [`Problem::check`], a penalty is out of range or 0 for a term that is on, or
    /// `start` is not finite or has the wrong length.
    pub fn with_penalties(
        problem: &Problem<'_, T>,
        penalties: Penalties,
        start: Option<&[T]>,
    ) -> Result<Self, DenoiseError> {
        Self::with_linear_step(problem, penalties, start, LinearStep::Auto)
    }

    /// As [`Self::with_penalties`], with a choice of the linear step.
    ///
    /// # Errors
    /// As [`Self::with_penalties`], or if the sweep is asked for and the Hessian is on.
    pub fn with_linear_step(
        problem: &Problem<'_, T>,
        penalties: Penalties,
        start: Option<&[T]>,
        linear: LinearStep,
    ) -> Result<Self, DenoiseError> {
        problem.check()?;
        Self::build(problem.clone(), penalties, start, linear, Survey::new(problem))
    }

    /// As [`Self::owning`] with the exact step, without what takes the steps.
    #[cfg(feature = "gpu")]
    pub(super) fn without_engine(problem: &Problem<'_, T>) -> Result<Self, DenoiseError> {
        problem.check()?;
        let survey = Survey::new(problem);
        let penalties = Penalties::at_contrast(problem, survey.contrast);
        Self::stated(problem.clone(), penalties, None, LinearStep::Exact, survey)
    }

    fn build(
        problem: Problem<'_, T>,
        penalties: Penalties,
        start: Option<&[T]>,
        linear: LinearStep,
        survey: Survey,
    ) -> Result<Self, DenoiseError> {
        let mut admm = Self::stated(problem, penalties, start, linear, survey)?;
        if !admm.channels.is_empty() {
            let engine = if admm.plan.sweep {
                Engine::Sweep(Sweep::new(&admm.frame(false)))
            } else {
                let solver = StripSolver::new(
                    admm.plan.padded_width,
                    admm.shape.height,
                    admm.plan.symbol(admm.penalties),
                );
                Engine::Exact(Exact::new(&admm.frame(false), solver))
            };
            admm.engine = Some(engine);
        }
        admm.plan.bytes = size_of_val(admm.target.as_slice())
            + size_of_val(admm.guide.as_slice())
            + match &admm.engine {
                Some(Engine::Exact(exact)) => exact.bytes(),
                Some(Engine::Sweep(sweep)) => sweep.bytes(),
                None => 0,
            };
        Ok(admm)
    }

    /// The state before the first step, without what takes the steps.
    fn stated(
        problem: Problem<'_, T>,
        penalties: Penalties,
        start: Option<&[T]>,
        linear: LinearStep,
        survey: Survey,
    ) -> Result<Self, DenoiseError> {
        penalties.check()?;
        let shape = problem.shape;
        if let Some(start) = start {
            crate::check_finite("start", start, shape)?;
        }
        let mut plan = AdmmPlan::new(&problem, shape.width);
        let on = [plan.gradient, plan.hessian, plan.guide];
        let t = [penalties.gradient, penalties.hessian, penalties.guide];
        for ((on, t), name) in on.into_iter().zip(t).zip(["gradient", "Hessian", "guide"]) {
            let setting = match name {
                "gradient" => "the penalty of the gradient",
                "Hessian" => "the penalty of the Hessian",
                _ => "the penalty of the guide",
            };
            DenoiseError::setting(setting, t, "positive where the term is on", !on || t > 0.0)?;
        }
        let channels = plan.solved();
        let same = plan.channels.iter().filter(|c| matches!(c, ChannelPlan::SameAs(_))).count();
        let merged = match problem.coupling {
            Coupling::Vectorial => 1.0 / ((1 + same) as f64).sqrt(),
            Coupling::Separate => 1.0,
        };
        let (offsets, target) = center(&problem, &plan, &survey.means);
        let square = |v: &T| v.f64() * v.f64();
        let (n, all) = (shape.pixels(), full(&problem.data));
        let read = |c: usize, i: usize| all || !problem.data.hole(c * n + i, shape);
        let contrast_of = |(c, plane): (&usize, &[T])| {
            plane.iter().enumerate().filter(|(i, _)| read(*c, *i)).map(|(_, v)| square(v)).sum()
        };
        let contrast = channels.iter().zip(target.chunks(n)).map(contrast_of).collect();
        let symbol = plan.symbol(penalties);
        let sweep = match linear {
            LinearStep::Exact => false,
            LinearStep::Sweep => true,
            LinearStep::Auto => !plan.hessian && full(&problem.data) && symbol.c1 <= STIFFEST * symbol.c0,
        };
        let hessian = f64::from(u8::from(plan.hessian));
        DenoiseError::setting("the Hessian", hessian, "off for the sweep", !(sweep && plan.hessian))?;
        plan.sweep = sweep;
        plan.padded_width = if sweep { shape.width } else { fast_length(shape.width) };
        let (guide, guide_weight) = match problem.guide.filter(|_| plan.guide) {
            Some(g) => (g.gradient.to_vec(), Some(g.weight)),
            None => (Vec::new(), None),
        };
        let weights =
            [problem.alpha.filter(|_| plan.gradient), problem.beta.filter(|_| plan.hessian), guide_weight];
        Ok(Self {
            shape,
            penalties,
            coupling: problem.coupling,
            frozen: vec![false; channels.len()],
            offsets,
            target,
            contrast,
            data: problem.data,
            weights,
            guide,
            unreadable: survey.unreadable,
            merged,
            start: start.map(<[T]>::to_vec),
            engine: None,
            steps: 0,
            channels,
            plan,
        })
    }

    /// What the problem needed.
    pub fn plan(&self) -> &AdmmPlan {
        &self.plan
    }

    /// The penalties.
    pub fn penalties(&self) -> Penalties {
        self.penalties
    }

    /// Steps so far.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The shape of the solution.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    fn frame(&self, measure: bool) -> Frame<'_, T> {
        let p = self.penalties;
        let term = |k: usize, penalty: f64| {
            self.weights[k].as_ref().map(|weight| TermFrame {
                weight,
                scale: T::of(self.merged / penalty),
                penalty: T::of(penalty),
                guide: &self.guide,
            })
        };
        let (a, sweep) = (p.relaxation, self.plan.sweep);
        // The first step takes the operators once: the splits start at the estimate.
        let gain = if sweep || self.steps == 0 { 1.0 } else { a };
        Frame {
            shape: self.shape,
            width: self.plan.padded_width,
            periodic: !sweep,
            channels: &self.channels,
            frozen: &self.frozen,
            coupling: self.coupling,
            start: self.start.as_deref(),
            offsets: &self.offsets,
            target: &self.target,
            data: &self.data,
            t0: T::of(p.data),
            terms: [term(0, p.gradient), term(1, p.hessian), term(2, p.guide)],
            gain: T::of(gain),
            relaxation: T::of(a),
            carry: T::of(if sweep { 1.0 - a } else { 0.0 }),
            measure,
        }
    }

    /// One iteration.
    pub fn step(&mut self) {
        self.advance(false);
    }

    fn advance(&mut self, measure: bool) {
        let mut engine = self.engine.take();
        let frame = self.frame(measure);
        match &mut engine {
            Some(Engine::Exact(exact)) => exact.advance(&frame),
            Some(Engine::Sweep(sweep)) => sweep.advance(&frame),
            None => {}
        }
        self.engine = engine;
        self.start = None;
        self.steps += 1;
    }

    /// Iterates until `stop`. Channels that are not coupled and have converged take no part in further iterations of
    /// this solve.
    pub fn solve(&mut self, stop: Stop) -> Report {
        self.solve_with(stop, |_| {})
    }

    /// As [`Self::solve`]; `after` is called after each iteration and may change weights.
    pub fn solve_with(&mut self, stop: Stop, mut after: impl FnMut(&mut Self)) -> Report {
        match stop {
            Stop::Iterations(n) => {
                for _ in 0..n {
                    self.advance(false);
                    after(self);
                }
                Report { iterations: n, residual: None, converged: true }
            }
            Stop::Tolerance { tolerance, limit } => {
                let mut report =
                    Report { iterations: 0, residual: None, converged: self.channels.is_empty() };
                while report.iterations < limit && !report.converged {
                    self.advance(true);
                    report.iterations += 1;
                    let residuals = self.residuals();
                    let worst = residuals.iter().copied().fold(0.0, f64::max);
                    report.residual = Some(worst);
                    if report.iterations >= 5 {
                        report.converged = worst < tolerance;
                        for (frozen, r) in self.frozen.iter_mut().zip(&residuals) {
                            *frozen |= self.coupling == Coupling::Separate && *r < tolerance;
                        }
                    }
                    after(self);
                }
                self.frozen.fill(false);
                report
            }
        }
    }

    /// The relative change of each solved channel, or of all together if they are coupled; 0 for those frozen.
    fn residuals(&self) -> Vec<f64> {
        let channels = self.channels.len();
        let mut sums = vec![[0.0; 3]; channels];
        let mut add = |band: &[[f64; 3]]| {
            for (total, sum) in sums.iter_mut().zip(band) {
                for (t, s) in total.iter_mut().zip(sum) {
                    *t += s;
                }
            }
        };
        match &self.engine {
            Some(Engine::Exact(exact)) => exact.sums().for_each(&mut add),
            Some(Engine::Sweep(sweep)) => sweep.sums().for_each(&mut add),
            None => {}
        }
        let ratio = |[r, d, u]: [f64; 3], contrast: f64| {
            let change = r.max(d).sqrt();
            let scale = u.sqrt().max(FLAT * contrast.sqrt()).max(f64::MIN_POSITIVE);
            if change == 0.0 { 0.0 } else { change / scale }
        };
        match self.coupling {
            Coupling::Separate => sums.into_iter().zip(&self.contrast).map(|(s, c)| ratio(s, *c)).collect(),
            Coupling::Vectorial => {
                let all = sums.into_iter().fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
                vec![ratio(all, self.contrast.iter().sum())]
            }
        }
    }

    /// The estimate.
    pub fn solution(&self) -> Vec<T> {
        let mut out = vec![T::zero(); self.shape.len()];
        self.write_solution(&mut out);
        out
    }

    /// The estimate; what the solver holds beside it is freed before it is written.
    pub fn into_solution(mut self) -> Vec<T> {
        // Before the first step the estimate is made from the target.
        if self.steps > 0 {
            match &mut self.engine {
                Some(Engine::Exact(exact)) => exact.forget_splits(),
                Some(Engine::Sweep(sweep)) => sweep.forget_splits(),
                None => {}
            }
            (self.target, self.guide) = (Vec::new(), Vec::new());
        }
        self.solution()
    }

    /// Writes the estimate.
    ///
    /// # Panics
    /// If `out` does not have the shape of the problem.
    pub fn write_solution(&self, out: &mut [T]) {
        assert_eq!(out.len(), self.shape.len(), "an image of {}", self.shape);
        let mut made = Vec::new();
        let rows: &[T] = match &self.engine {
            Some(Engine::Exact(exact)) => {
                made.resize(self.channels.len() * self.shape.pixels(), T::zero());
                exact.write_rows(&self.frame(false), &mut made);
                &made
            }
            Some(Engine::Sweep(sweep)) => sweep.rows(),
            None => &made,
        };
        let (m, n, lanes) = (self.shape.height, self.shape.width, self.channels.len());
        out.par_chunks_mut(n).enumerate().for_each(|(k, out)| {
            let (plane, i) = (k / m, k % m);
            match self.lane_of(plane) {
                Some((c, source)) => {
                    for (o, v) in out.iter_mut().zip(&rows[(i * lanes + c) * n..]) {
                        *o = *v + self.offsets[source];
                    }
                }
                None => out.fill(self.offsets[plane]),
            }
        });
    }

    /// The solved channel that a channel of the solution is taken from, and its place in the problem.
    pub(super) fn lane_of(&self, plane: usize) -> Option<(usize, usize)> {
        let source = match self.plan.channels[plane] {
            ChannelPlan::SameAs(source) => source,
            ChannelPlan::Solved | ChannelPlan::Constant => plane,
        };
        self.channels.iter().position(|&c| c == source).map(|c| (c, source))
    }

    /// The dual variable of the total variation: for each channel the plane of x, then of y, `|y| <= alpha`; with
    /// [`crate::primal_dual::rof_gap`] it bounds the distance to the optimum. `None` if the term is off.
    pub fn gradient_dual(&self) -> Option<Vec<T>> {
        self.weights[0].as_ref()?;
        let (m, n) = (self.shape.height, self.shape.width);
        let rows = match &self.engine {
            Some(Engine::Exact(exact)) => exact.gradient_dual(&self.frame(false)),
            Some(Engine::Sweep(sweep)) => sweep.gradient_dual(&self.frame(false)),
            None => Vec::new(),
        };
        let mut out = vec![T::zero(); 2 * self.shape.len()];
        let lanes = 2 * self.channels.len();
        for (k, row) in out.chunks_exact_mut(n).enumerate() {
            let (plane, part, i) = (k / (2 * m), k / m % 2, k % m);
            if let Some((c, _)) = self.lane_of(plane) {
                row.copy_from_slice(&rows[(i * lanes + 2 * c + part) * n..][..n]);
            }
        }
        Some(out)
    }

    /// Replaces the data term's weights (and, if wished, its kind) between steps; the duals stay.
    ///
    /// # Errors
    /// If a weight has a wrong length or range, or reads a sample of the target that is not finite.
    pub fn set_data(&mut self, data: DataTerm<T>) -> Result<(), DenoiseError> {
        data.check(self.shape)?;
        self.check_shared(data.weights())?;
        if let Some(&k) = self.unreadable.iter().find(|&&k| !data.hole(k, self.shape)) {
            return Err(crate::field::not_finite("target", f64::NAN, k, self.shape));
        }
        self.data = data;
        Ok(())
    }

    /// Replaces `alpha` between steps; the duals stay.
    ///
    /// # Errors
    /// If the weight has a wrong length or range, or the term was off.
    pub fn set_gradient_weight(&mut self, alpha: impl Into<Weight<T>>) -> Result<(), DenoiseError> {
        self.set_weight(0, "alpha", alpha.into())
    }

    /// Replaces `beta` between steps; the duals stay.
    ///
    /// # Errors
    /// If the weight has a wrong length or range, or the term was off.
    pub fn set_hessian_weight(&mut self, beta: impl Into<Weight<T>>) -> Result<(), DenoiseError> {
        self.set_weight(1, "beta", beta.into())
    }

    /// Replaces `gamma` between steps; the duals stay.
    ///
    /// # Errors
    /// If the weight has a wrong length or range, or the term was off.
    pub fn set_guide_weight(&mut self, gamma: impl Into<Weight<T>>) -> Result<(), DenoiseError> {
        self.set_weight(2, "gamma", gamma.into())
    }

    fn set_weight(&mut self, k: usize, name: &'static str, weight: Weight<T>) -> Result<(), DenoiseError> {
        weight.check(name, self.shape)?;
        self.check_shared([Some(&weight), None])?;
        let was = self.weights[k].is_some();
        DenoiseError::setting(name, weight.mean(), "on from the beginning to be changed", was)?;
        self.weights[k] = Some(weight);
        Ok(())
    }

    /// Channels solved as one must keep equal weights.
    fn check_shared(&self, weights: [Option<&Weight<T>>; 2]) -> Result<(), DenoiseError> {
        let merged = self.plan.channels.iter().any(|c| matches!(c, ChannelPlan::SameAs(_)));
        let shared = weights.into_iter().flatten().all(|w| w.shared(self.shape));
        let channels = self.shape.channels as f64;
        DenoiseError::setting(
            "the channels of a weight",
            channels,
            "1 where channels are merged",
            shared || !merged,
        )
    }
}

/// What is taken off each channel, and the target of the solved channels less that, 0 where it is not finite. Without
/// the mean single precision keeps its digits.
fn center<T: Sample>(problem: &Problem<'_, T>, plan: &AdmmPlan, means: &[f64]) -> (Vec<T>, Vec<T>) {
    let n = problem.shape.pixels();
    let offset = |c: usize| match plan.channels[c] {
        ChannelPlan::Constant => problem.target[c * n],
        ChannelPlan::Solved | ChannelPlan::SameAs(_) => T::of(means[c]),
    };
    let offsets: Vec<T> = (0..problem.shape.channels).map(offset).collect();
    let mut target = Vec::with_capacity(plan.solved().len() * n);
    for c in plan.solved() {
        let centred = |v: &T| if v.is_finite() { *v - offsets[c] } else { T::zero() };
        target.extend(problem.target[c * n..(c + 1) * n].iter().map(centred));
    }
    (offsets, target)
}
