//! First-order optimizers on a device.

use super::{COLUMNS, Columns, LargeStepsSolver};
use crate::{OptimError, SecondMoment, State, Temporal};
use photofit_gpu::{Buffer, Gpu, INDEX, Kernel, Recorder, Recording, Slot};

const STATE: &str = include_str!("../optimizer/state.wgsl");
const SCAN: &[&str] = &[INDEX, STATE, include_str!("../scan.wgsl")];
const FUSED: &[&str] = &[INDEX, STATE, include_str!("../optimizer/fused.wgsl")];
pub(super) const CHUNK: Kernel = Kernel { name: "optim.chunk", source: SCAN, entry: "chunk" };
pub(super) const OBSERVE: Kernel = Kernel { name: "optim.observe", source: SCAN, entry: "observe" };
pub(super) const DENSE: Kernel = Kernel { name: "optim.dense", source: FUSED, entry: "dense" };
pub(super) const ACCUMULATE: Kernel = Kernel { name: "optim.accumulate", source: FUSED, entry: "accumulate" };
pub(super) const FACTOR: Kernel = Kernel { name: "optim.factor", source: FUSED, entry: "factor" };
pub(super) const MOVE: Kernel = Kernel { name: "optim.move", source: FUSED, entry: "uniform_move" };

/// Samples of a chunk of the scan.
const CHUNK_SAMPLES: usize = 4096;
/// Lanes of the kernels that move.
const LANES: usize = 256;

/// As `scan.wgsl` has it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ScanParams {
    count: u32,
    width: u32,
    live: u32,
    chunks: u32,
    inverse_count: f32,
    beta2: f32,
    rest2: f32,
    correction2: f32,
    relative_epsilon: f32,
    step: u32,
    filtered: u32,
    first: u32,
}

/// As `fused.wgsl` has it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct MoveParams {
    count: u32,
    width: u32,
    chunks: u32,
    first: u32,
    betas: [f32; 2],
    rests: [f32; 2],
    corrections: [f32; 2],
    unused: [f32; 2],
    rates: Columns,
}

/// As `state.wgsl` has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Words {
    mean: f32,
    mean_exponent: i32,
    scale_exponent: i32,
    halted: u32,
    bad_index: u32,
    bad_bits: u32,
    bad_step: u32,
    unused: u32,
    constants: [f32; 8],
}

/// [`Optimizer`](crate::Optimizer) on a device: the method that a fit of textures uses (a second moment per entry, no filter)
/// and that of positions (the largest second moment for all, diffused by [`LargeStepsSolver`] before and after the
/// moments, which equals the change of variables of Large Steps, or before them and by another one after them).
#[derive(Debug)]
pub struct DeviceOptimizer {
    gpu: Gpu,
    group: String,
    width: usize,
    temporal: Temporal,
    /// Filters of the gradient and of the first moment.
    solvers: Option<[LargeStepsSolver; 2]>,
    m: Buffer<f32>,
    v: Buffer<f32>,
    state: Buffer<Words>,
    partials: Buffer<[u32; 4]>,
    maxima: Buffer<f32>,
    /// The filtered gradient, and the filtered first moment.
    filtered: [Buffer<f32>; 2],
    /// Steps asked for.
    steps: u64,
}

/// The kernels of a step in a recording.
#[derive(Clone, Debug)]
pub struct Recorded {
    scan: Vec<Slot>,
    moves: Vec<Slot>,
    /// Where the samples begin in their buffers.
    first: usize,
}

impl DeviceOptimizer {
    /// For rows of `width` samples, `rows` of them, named for messages.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for settings outside their ranges, [`OptimError::Combination`] for methods that only the CPU
    /// has, and [`OptimError::Device`].
    pub fn new(
        gpu: &Gpu,
        group: &str,
        (rows, width): (usize, usize),
        temporal: Temporal,
        solver: Option<LargeStepsSolver>,
    ) -> Result<Self, OptimError> {
        let len = rows * width;
        temporal.check(group, len)?;
        let fits = (1..=COLUMNS).contains(&width);
        OptimError::setting(group, "row length", width as f64, "1 to 16 on a device", fits)?;
        let remembers = temporal.memory(len) == [len; 2];
        let known = match temporal.second {
            SecondMoment::PerEntry => solver.is_none(),
            SecondMoment::GlobalMax => true,
            SecondMoment::None | SecondMoment::PerVector(_) => false,
        };
        if !(known && (remembers || len == 0)) {
            let group = group.to_owned();
            return Err(OptimError::Combination { group, what: "this temporal filter", with: "a device" });
        }
        if let Some(solver) = &solver {
            OptimError::length(group, "samples of the filter's sites", 3 * solver.vertices(), len)?;
        }
        let uniform = temporal.second == SecondMoment::GlobalMax;
        let scratch = |used: bool, name: &str, n: usize| gpu.zeros::<f32>(name, if used { n } else { 0 });
        let filters = solver.is_some();
        Ok(Self {
            m: gpu.zeros("first moments", len)?,
            v: gpu.zeros("second moments", len)?,
            state: gpu.zeros("optimizer", 1)?,
            partials: gpu.zeros("sums of squares", len.div_ceil(CHUNK_SAMPLES))?,
            maxima: scratch(uniform, "largest second moments", len.div_ceil(LANES))?,
            filtered: [
                scratch(filters, "filtered gradients", len)?,
                scratch(filters, "filtered first moments", len)?,
            ],
            gpu: gpu.clone(),
            group: group.to_owned(),
            width,
            temporal,
            solvers: solver.map(|s| [s.clone(), s]),
            steps: 0,
        })
    }

    /// Filters the first moment by another solver than the gradient, such as [`LargeStepsSolver::edge_aware`], which
    /// [`Self::record_guide`] guides.
    ///
    /// # Errors
    /// [`OptimError::Length`] for one of another mesh; [`OptimError::Combination`] where nothing is filtered.
    pub fn with_moments_by(mut self, solver: LargeStepsSolver) -> Result<Self, OptimError> {
        OptimError::length(
            &self.group,
            "samples of the filter's sites",
            3 * solver.vertices(),
            self.m.len(),
        )?;
        let Some(solvers) = &mut self.solvers else {
            let what = "a filter of the moments alone";
            return Err(OptimError::Combination { group: self.group, what, with: "a device" });
        };
        solvers[1] = solver;
        Ok(self)
    }

    /// Records that the filter of the first moment is guided by normals, three samples per vertex, in the steps that follow.
    ///
    /// # Errors
    /// If the device refuses the kernel.
    pub fn record_guide<N: bytemuck::Pod>(
        &self,
        r: &mut Recorder,
        normals: &Buffer<N>,
    ) -> Result<(), OptimError> {
        let Some([_, solver]) = &self.solvers else { return Ok(()) };
        Ok(solver.weigh(r, normals)?)
    }

    /// Adds one step to a recording: samples of `params` from `first` on move against those of `gradients` at the same place,
    /// in `f32` one after the other. [`Self::prepare`] says by what rates.
    ///
    /// # Errors
    /// [`OptimError::Length`] and [`OptimError::Device`]; [`OptimError::Combination`] for positions that are not the first
    /// samples.
    pub fn record<P: bytemuck::Pod, G: bytemuck::Pod>(
        &self,
        r: &mut Recorder,
        params: &Buffer<P>,
        gradients: &Buffer<G>,
        first: usize,
    ) -> Result<Recorded, OptimError> {
        let len = self.m.len();
        let samples = |bytes: u64| len.min((bytes as usize / size_of::<f32>()).saturating_sub(first));
        if self.solvers.is_some() && first > 0 {
            let (what, with) = ("a filter over a mesh", "samples that are not the first of a buffer");
            return Err(OptimError::Combination { group: self.group.clone(), what, with });
        }
        OptimError::length(&self.group, "parameters", samples(params.bytes()), len)?;
        OptimError::length(&self.group, "gradients", samples(gradients.bytes()), len)?;
        let [filtered, moved] = &self.filtered;
        // `prepare` sets them for each run.
        let (scan, moving) = (self.scan_params(&[], 0), self.move_params(&[], 0));
        let (partials, state) = (self.partials.bind(), self.state.bind());
        let chunks = self.partials.len() * LANES;
        let unfiltered = gradients.bind();
        let mut out = Recorded { scan: Vec::new(), moves: Vec::new(), first };
        out.scan.push(r.dispatch(&CHUNK, &scan, &[unfiltered.clone(), partials.clone()], chunks)?);
        let gradients = match &self.solvers {
            Some([solver, _]) => {
                solver.solve(r, &unfiltered, filtered)?;
                out.scan.push(r.dispatch(&CHUNK, &scan, &[filtered.bind(), partials.clone()], chunks)?);
                filtered.bind()
            }
            None => unfiltered.clone(),
        };
        out.scan.push(r.dispatch(&OBSERVE, &scan, &[unfiltered, partials, state.clone()], 1)?);
        let (m, v, g) = (self.m.bind(), self.v.bind(), gradients);
        if self.temporal.second == SecondMoment::PerEntry {
            out.moves.push(r.dispatch(&DENSE, &moving, &[state, params.bind(), g, m, v], len)?);
            return Ok(out);
        }
        let maxima = self.maxima.bind();
        let buffers = [state.clone(), g, m, v, maxima.clone()];
        out.moves.push(r.dispatch(&ACCUMULATE, &moving, &buffers, len)?);
        out.moves.push(r.dispatch(&FACTOR, &moving, &[state.clone(), maxima], 1)?);
        let direction = match &self.solvers {
            Some([_, solver]) => {
                solver.solve(r, &self.m.bind(), moved)?;
                moved
            }
            None => &self.m,
        };
        out.moves.push(r.dispatch(&MOVE, &moving, &[state, params.bind(), direction.bind()], len)?);
        Ok(out)
    }

    /// Sets what the next run of a recording needs, and counts it as a step. `rates`: one for all columns, or one each; 0
    /// freezes a column.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for rates that are negative or not finite; [`OptimError::Length`].
    pub fn prepare(
        &mut self,
        recording: &mut Recording,
        recorded: &Recorded,
        rates: &[f32],
    ) -> Result<(), OptimError> {
        let one;
        let rates = if let [rate] = rates {
            one = vec![*rate; self.width];
            &one
        } else {
            rates
        };
        OptimError::length(&self.group, "rates", rates.len(), self.width)?;
        if let Some(r) = rates.iter().find(|r| !(**r >= 0.0 && r.is_finite())) {
            OptimError::setting(
                &self.group,
                "learning rate",
                f64::from(*r),
                "finite and not negative",
                false,
            )?;
        }
        self.steps += 1;
        let (scan, moving) =
            (self.scan_params(rates, recorded.first), self.move_params(rates, recorded.first));
        for (k, slot) in recorded.scan.iter().enumerate() {
            // The second scan of three is that of the filtered gradients.
            let filtered = u32::from(k == 1 && recorded.scan.len() == 3);
            recording.set(*slot, &ScanParams { filtered, ..scan });
        }
        recorded.moves.iter().for_each(|s| recording.set(*s, &moving));
        Ok(())
    }

    fn scan_params(&self, rates: &[f32], first: usize) -> ScanParams {
        let live = rates.iter().enumerate().filter(|(_, r)| **r > 0.0).fold(0_u32, |l, (k, _)| l | 1 << k);
        let moving = self.m.len() / self.width * live.count_ones() as usize;
        let Temporal { beta2, relative_epsilon, .. } = self.temporal;
        ScanParams {
            count: self.m.len() as u32,
            width: self.width as u32,
            live,
            chunks: self.partials.len() as u32,
            inverse_count: if moving > 0 { (1.0 / moving as f64) as f32 } else { 0.0 },
            beta2: beta2 as f32,
            rest2: (1.0 - beta2) as f32,
            correction2: self.temporal.corrections(self.steps)[1] as f32,
            relative_epsilon: relative_epsilon as f32,
            step: self.steps as u32,
            filtered: 0,
            first: first as u32,
        }
    }

    fn move_params(&self, rates: &[f32], first: usize) -> MoveParams {
        let betas = [self.temporal.beta1, self.temporal.beta2];
        let mut columns = [0.0; COLUMNS];
        columns[..rates.len()].copy_from_slice(rates);
        MoveParams {
            count: self.m.len() as u32,
            width: self.width as u32,
            chunks: self.maxima.len() as u32,
            first: first as u32,
            betas: betas.map(|b| b as f32),
            rests: betas.map(|b| (1.0 - b) as f32),
            corrections: self.temporal.corrections(self.steps).map(|c| c as f32),
            unused: [0.0; 2],
            rates: columns,
        }
    }

    /// Reads whether a gradient was not finite: from that step on, nothing moves. Gives the number of steps since then. In a
    /// browser, [`Self::fetch_check`] does.
    ///
    /// # Errors
    /// [`OptimError::Device`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn check(&self) -> Result<Option<(u64, OptimError)>, OptimError> {
        Ok(self.halt(&self.gpu.read(&self.state)?))
    }

    /// [`Self::check`] as a future, as [`Gpu::fetch`] is one.
    ///
    /// # Errors
    /// [`OptimError::Device`].
    pub async fn fetch_check(&self) -> Result<Option<(u64, OptimError)>, OptimError> {
        Ok(self.halt(&self.gpu.fetch(&self.state).await?))
    }

    fn halt(&self, words: &[Words]) -> Option<(u64, OptimError)> {
        let words = words.first().copied().unwrap_or_default();
        (words.halted != 0).then(|| {
            let value = f64::from(f32::from_bits(words.bad_bits));
            let index = words.bad_index as usize;
            let error = OptimError::NonFiniteGradient { group: self.group.clone(), index, value };
            (u64::from((self.steps as u32).wrapping_sub(words.bad_step)), error)
        })
    }

    /// What a checkpoint has to keep; the optimizers of the CPU read it, too. In a browser, [`Self::fetch_state`] does.
    ///
    /// # Errors
    /// [`OptimError::Device`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn state(&self) -> Result<State<f32>, OptimError> {
        let gpu = &self.gpu;
        Ok(self.saved(&gpu.read(&self.state)?, gpu.read(&self.m)?, gpu.read(&self.v)?))
    }

    /// [`Self::state`] as a future, as [`Gpu::fetch`] is one.
    ///
    /// # Errors
    /// [`OptimError::Device`].
    pub async fn fetch_state(&self) -> Result<State<f32>, OptimError> {
        let gpu = &self.gpu;
        let (words, m) = (gpu.fetch(&self.state).await?, gpu.fetch(&self.m).await?);
        Ok(self.saved(&words, m, gpu.fetch(&self.v).await?))
    }

    fn saved(&self, words: &[Words], m: Vec<f32>, v: Vec<f32>) -> State<f32> {
        let words = words.first().copied().unwrap_or_default();
        State {
            m,
            v,
            step: self.steps,
            scale_exponent: words.scale_exponent,
            mean_square: f64::from(words.mean) * f64::from(2 * words.mean_exponent).exp2(),
            row_steps: Vec::new(),
        }
    }

    /// Continues from a saved state, to the same bits where a device saved it.
    ///
    /// # Errors
    /// [`OptimError::Length`] or [`OptimError::Setting`] when the state is not one of this group, and
    /// [`OptimError::Device`].
    pub fn restore(&mut self, state: &State<f32>) -> Result<(), OptimError> {
        let len = self.m.len();
        state.check(&self.group, &State::new(len, len))?;
        OptimError::length(&self.group, "row counts", state.row_steps.len(), 0)?;
        let half = (0.5 * state.mean_square.log2()).floor();
        let mean_exponent = if state.mean_square > 0.0 { half as i32 } else { 0 };
        let mean = (state.mean_square * f64::from(-2 * mean_exponent).exp2()) as f32;
        let words = Words { mean, mean_exponent, scale_exponent: state.scale_exponent, ..Words::default() };
        self.gpu.write(&self.state, &[words])?;
        self.gpu.write(&self.m, &state.m)?;
        self.gpu.write(&self.v, &state.v)?;
        self.steps = state.step;
        Ok(())
    }

    /// Begins anew.
    ///
    /// # Errors
    /// [`OptimError::Device`].
    pub fn reset(&mut self) -> Result<(), OptimError> {
        let len = self.m.len();
        self.restore(&State::new(len, len))
    }
}
