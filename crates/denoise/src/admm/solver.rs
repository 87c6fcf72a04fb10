//! The solver: state, steps, solution.

use std::fmt;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::{
    IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator, ParallelSliceMut,
};

use super::plan::{ChannelPlan, Plan};
use super::stop::{Report, Stop};
use super::tile::{Frame, Scratch, TermFrame, Tile};
use super::{Coupling, DataTerm, Penalties, Problem, Weight};
use crate::transform::{Block, Sample, StripSolver, Symbol, fast_length};
use crate::{DenoiseError, Shape};

/// Rows of a band.
const BAND: usize = 16;

/// The over-relaxed splitting of one [`Problem`], see [the module](crate::admm).
///
/// ```
/// use photofit_denoise::admm::{Admm, DataTerm, Problem, Stop};
/// use photofit_denoise::Shape;
/// let shape = Shape::new(8, 64, 1);
/// let step: Vec<f64> = (0..512).map(|k| if k % 64 < 32 { 0.0 } else { 1.0 }).collect();
/// let problem = Problem::new(shape, &step, DataTerm::L2 { lambda: 0.2.into() }).with_gradient(1.0);
/// let mut admm = Admm::new(&problem)?;
/// admm.solve(Stop::Iterations(2000));
/// let u = admm.solution(); // the step keeps its place and loses 2/(lambda * 32) on each side
/// assert!((u[0] - 0.15625).abs() < 1e-6 && (u[63] - 0.84375).abs() < 1e-6);
/// # Ok::<(), photofit_denoise::DenoiseError>(())
/// ```
pub struct Admm<T: Sample> {
    shape: Shape,
    plan: Plan,
    penalties: Penalties,
    coupling: Coupling,
    channels: Vec<usize>,
    frozen: Vec<bool>,
    /// Added back to each channel of the solution.
    offsets: Vec<T>,
    target: Vec<T>,
    data: DataTerm<T>,
    weights: [Option<Weight<T>>; 3],
    guide: Vec<T>,
    /// Samples of the target that are not finite, and so must stay holes.
    unreadable: Vec<usize>,
    /// `1 / sqrt(k)` where `k` equal coupled channels are solved as one.
    merged: f64,
    solver: StripSolver<T>,
    u: Vec<T>,
    tiles: Vec<Tile<T>>,
    blocks: Vec<Block<T>>,
    pool: Mutex<Vec<Scratch<T>>>,
    steps: usize,
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
        problem.check()?;
        Self::with_penalties(problem, Penalties::for_problem(problem), None)
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
        problem.check()?;
        penalties.check()?;
        let shape = problem.shape;
        if let Some(start) = start {
            crate::check_finite("start", start, shape)?;
        }
        let cols = fast_length(shape.cols);
        let mut plan = Plan::new(problem, cols);
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
        let used = |k: usize| if on[k] { t[k] } else { 0.0 };
        let symbol = Symbol { c0: penalties.data, c1: used(0) + used(2), c2: used(1) };
        let channels = plan.solved();
        let same = plan.channels.iter().filter(|c| matches!(c, ChannelPlan::SameAs(_))).count();
        let merged = match problem.coupling {
            Coupling::Vectorial => 1.0 / ((1 + same) as f64).sqrt(),
            Coupling::Separate => 1.0,
        };
        let (offsets, target) = center(problem, &plan);
        let rows = if channels.is_empty() { 1 } else { shape.rows };
        let weights = [
            problem.alpha.clone().filter(|_| plan.gradient),
            problem.beta.clone().filter(|_| plan.hessian),
            problem.guide.as_ref().map(|g| g.weight.clone()).filter(|_| plan.guide),
        ];
        let guide = problem.guide.as_ref().filter(|_| plan.guide).map_or(Vec::new(), |g| g.gradient.to_vec());
        let solver = StripSolver::new(rows, cols, symbol);
        let blocks = solver.blocks(channels.len());
        let mut admm = Self {
            shape,
            penalties,
            coupling: problem.coupling,
            frozen: vec![false; channels.len()],
            offsets,
            target,
            data: problem.data.clone(),
            weights,
            guide,
            unreadable: (0..shape.len()).filter(|&k| !problem.target[k].is_finite()).collect(),
            merged,
            u: vec![T::zero(); shape.rows * channels.len() * cols],
            tiles: Vec::new(),
            blocks,
            pool: Mutex::new(Vec::new()),
            steps: 0,
            channels,
            plan: plan.clone(),
            solver,
        };
        admm.set_start(start);
        if !admm.channels.is_empty() {
            let bands = (0..shape.rows).step_by(BAND).map(|i| i..(i + BAND).min(shape.rows));
            admm.tiles = bands.map(|rows| Tile::new(rows, &admm.frame(false))).collect();
        }
        plan.bytes = size_of_val(admm.u.as_slice())
            + size_of_val(admm.target.as_slice())
            + size_of_val(admm.guide.as_slice())
            + admm.solver.bytes()
            + admm.tiles.iter().map(Tile::bytes).sum::<usize>()
            + admm.blocks.iter().map(Block::bytes).sum::<usize>();
        admm.plan = plan;
        Ok(admm)
    }

    /// What the problem needed.
    pub fn plan(&self) -> &Plan {
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

    fn set_start(&mut self, start: Option<&[T]>) {
        let (m, n, cols, channels) =
            (self.shape.rows, self.shape.cols, self.plan.padded_cols, self.channels.len());
        for (c, &plane) in self.channels.iter().enumerate() {
            for i in 0..m {
                let row = &mut self.u[(i * channels + c) * cols..][..cols];
                match start {
                    Some(start) => {
                        for (v, s) in row.iter_mut().zip(&start[(plane * m + i) * n..][..n]) {
                            *v = *s - self.offsets[plane];
                        }
                    }
                    None => {
                        for (j, v) in row[..n].iter_mut().enumerate() {
                            let hole = self.data.hole((plane * m + i) * n + j, self.shape);
                            *v = if hole { T::zero() } else { self.target[(c * m + i) * n + j] };
                        }
                    }
                }
                // The padding continues the row back to its beginning, without a jump.
                let (first, last) = (row[0], row[n - 1]);
                let pad = cols - n;
                for (k, v) in row[n..].iter_mut().enumerate() {
                    *v = last + (first - last) * T::of((k + 1) as f64 / (pad + 1) as f64);
                }
            }
        }
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
        let gain = if self.steps == 0 { 1.0 } else { p.relaxation };
        Frame {
            shape: self.shape,
            cols: self.plan.padded_cols,
            channels: &self.channels,
            frozen: &self.frozen,
            coupling: self.coupling,
            u: &self.u,
            target: &self.target,
            data: &self.data,
            t0: T::of(p.data),
            terms: [term(0, p.gradient), term(1, p.hessian), term(2, p.guide)],
            relaxation: [T::of(gain), T::of(p.relaxation)],
            solver: &self.solver,
            measure,
        }
    }

    /// One iteration.
    pub fn step(&mut self) {
        self.advance(false);
    }

    fn advance(&mut self, measure: bool) {
        if self.channels.is_empty() {
            self.steps += 1;
            return;
        }
        let mut tiles = std::mem::take(&mut self.tiles);
        let mut blocks = std::mem::take(&mut self.blocks);
        let frame = self.frame(measure);
        let pool = &self.pool;
        let take = |frame: &Frame<'_, T>| {
            let kept = pool.lock().unwrap_or_else(PoisonError::into_inner).pop();
            kept.unwrap_or_else(|| Scratch::new(frame))
        };
        let give = |scratch| pool.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
        tiles.par_iter_mut().for_each(|tile| {
            let mut scratch = take(&frame);
            tile.update(&frame, &mut scratch);
            give(scratch);
        });
        let (channels, n) = (self.channels.len(), self.solver.frequencies());
        blocks.par_iter_mut().filter(|b| !self.frozen[b.channel]).for_each(|block| {
            let c = block.channel;
            self.solver.solve_block(block, |i| {
                let tile = &tiles[i / BAND];
                &tile.spectrum[((i - tile.rows.start) * channels + c) * n..][..n]
            });
        });
        let mut u = std::mem::take(&mut self.u);
        let (cols, per_channel) = (self.plan.padded_cols, self.solver.blocks_per_channel());
        let frame = self.frame(false);
        u.par_chunks_mut(BAND * channels * cols).enumerate().for_each(|(band, rows)| {
            let mut scratch = take(&frame);
            for (k, row) in rows.chunks_mut(cols).enumerate() {
                let (i, c) = (band * BAND + k / channels, k % channels);
                if !self.frozen[c] {
                    let blocks = &blocks[c * per_channel..(c + 1) * per_channel];
                    self.solver.inverse_row(blocks, i, row, &mut scratch.transform);
                }
            }
            give(scratch);
        });
        (self.tiles, self.blocks, self.u) = (tiles, blocks, u);
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
        for tile in &self.tiles {
            for (total, sum) in sums.iter_mut().zip(&tile.sums) {
                for (t, s) in total.iter_mut().zip(sum) {
                    *t += s;
                }
            }
        }
        let ratio = |[r, d, u]: [f64; 3]| {
            let change = r.max(d).sqrt();
            if change == 0.0 { 0.0 } else { change / u.sqrt().max(f64::MIN_POSITIVE) }
        };
        match self.coupling {
            Coupling::Separate => sums.into_iter().map(ratio).collect(),
            Coupling::Vectorial => {
                let all = sums.into_iter().fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
                vec![ratio(all)]
            }
        }
    }

    /// The estimate.
    pub fn solution(&self) -> Vec<T> {
        let mut out = vec![T::zero(); self.shape.len()];
        self.write_solution(&mut out);
        out
    }

    /// Writes the estimate.
    ///
    /// # Panics
    /// If `out` does not have the shape of the problem.
    pub fn write_solution(&self, out: &mut [T]) {
        assert_eq!(out.len(), self.shape.len(), "an image of {}", self.shape);
        let (m, n, cols, channels) =
            (self.shape.rows, self.shape.cols, self.plan.padded_cols, self.channels.len());
        out.par_chunks_mut(n).enumerate().for_each(|(row, out)| {
            let (plane, i) = (row / m, row % m);
            let source = match self.plan.channels[plane] {
                ChannelPlan::SameAs(source) => source,
                ChannelPlan::Solved | ChannelPlan::Constant => plane,
            };
            match self.channels.iter().position(|&c| c == source) {
                Some(c) => {
                    let u = &self.u[(i * channels + c) * cols..][..n];
                    for (o, v) in out.iter_mut().zip(u) {
                        *o = *v + self.offsets[source];
                    }
                }
                None => out.fill(self.offsets[plane]),
            }
        });
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

/// The mean of each channel over the samples that are read, and the target of the solved channels less their mean,
/// 0 where it is not finite. Without the mean single precision keeps its digits.
fn center<T: Sample>(problem: &Problem<'_, T>, plan: &Plan) -> (Vec<T>, Vec<T>) {
    let shape = problem.shape;
    let n = shape.pixels();
    let offsets: Vec<T> = (0..shape.channels)
        .map(|c| {
            if plan.channels[c] == ChannelPlan::Constant {
                return problem.target[c * n];
            }
            let (mut sum, mut count) = (0.0, 0_usize);
            for k in c * n..(c + 1) * n {
                if !problem.data.hole(k, shape) {
                    sum += problem.target[k].f64();
                    count += 1;
                }
            }
            if count == 0 { T::zero() } else { T::of(sum / count as f64) }
        })
        .collect();
    let mut target = Vec::with_capacity(plan.solved().len() * n);
    for c in plan.solved() {
        let centred = |v: &T| if v.is_finite() { *v - offsets[c] } else { T::zero() };
        target.extend(problem.target[c * n..(c + 1) * n].iter().map(centred));
    }
    (offsets, target)
}
