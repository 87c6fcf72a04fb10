//! The convex models on a device: the scores of trial strengths; then solver, exponential and local means, from the uploaded
//! logarithms to the irradiance that is read back.

use super::Plan;
use super::log_domain::NOT_RESTORED;
use super::plan::now;
use super::window::gaussian_taps;
use crate::admm::{DeviceAdmm, Problem};
use crate::gpu::{filled, room};
use crate::{DenoiseError, Shape};
#[cfg(test)]
use photofit_gpu::KernelReport;
use photofit_gpu::{Buffer, Gpu, INDEX, Kernel, Recorder, Recording};

const SOURCE: &[&str] = &[INDEX, include_str!("mean.wgsl")];
pub(crate) const EXPONENTIAL: Kernel =
    Kernel { name: "mean: exponential", source: SOURCE, entry: "exponential" };
pub(crate) const MEAN_ROWS: Kernel = Kernel { name: "mean: rows", source: SOURCE, entry: "mean_rows" };
pub(crate) const MEAN_COLUMNS: Kernel =
    Kernel { name: "mean: columns", source: SOURCE, entry: "mean_columns" };
pub(crate) const SCORE: Kernel =
    Kernel { name: "score", source: &[INDEX, include_str!("score.wgsl")], entry: "score" };

/// Samples of a partial sum of a score.
const TERMS: usize = 64;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    width: u32,
    height: u32,
    radius: u32,
    plane: u32,
    black: u32,
    count: u32,
    unused: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ScoreParams {
    pixels: u32,
    count: u32,
    sums: u32,
    first: u32,
}

/// What the local means are restored from.
pub(crate) struct Means<'a> {
    /// The noisy irradiance.
    pub(crate) noisy: &'a [f32],
    /// 1 where there is a sample, 0 at holes.
    pub(crate) weight: &'a [f32],
    /// Pixels without diffuse reflectance.
    pub(crate) black: &'a [usize],
    /// Deviation of the window in pixels.
    pub(crate) sigma: f32,
}

/// A device that solves the convex model of a picture at some strengths: the trials, then the model, in the buffers of one solver.
/// What it refuses first ends that; the CPU does the rest.
pub(crate) struct OnDevice<'a> {
    gpu: &'a Gpu,
    /// Whether what it cannot do is an error.
    required: bool,
    solver: Option<DeviceSolver>,
    /// Those that told scores.
    trials: usize,
    refused: Option<DenoiseError>,
}

impl<'a> OnDevice<'a> {
    pub(crate) fn new(gpu: &'a Gpu, required: bool) -> Self {
        Self { gpu, required, solver: None, trials: 0, refused: None }
    }

    /// The scores of [`super::choose_by_halves`]; `None` where the device refuses.
    pub(crate) async fn scores<'p>(
        &mut self,
        grid: &[f32],
        halves: [&'p [f32]; 2],
        mask: &[f32],
        iterations: usize,
        problem: impl Fn(f32, &'p [f32]) -> Problem<'p, f32>,
    ) -> Result<Option<Vec<f64>>, DenoiseError> {
        let scores = self.trials(grid, halves, mask, iterations, problem).await;
        let scores = self.unless_refused(scores)?;
        self.trials = scores.as_ref().map_or(0, |scores| 2 * scores.len());
        Ok(scores)
    }

    async fn trials<'p>(
        &mut self,
        grid: &[f32],
        [a, b]: [&'p [f32]; 2],
        mask: &[f32],
        iterations: usize,
        problem: impl Fn(f32, &'p [f32]) -> Problem<'p, f32>,
    ) -> Result<Vec<f64>, DenoiseError> {
        let gpu = self.gpu;
        let parts = a.len().div_ceil(TERMS);
        let sums = gpu.zeros("partial sums of scores", 2 * grid.len() * parts)?;
        let mask = gpu.upload("mask", mask)?;
        let mut other = None;
        for (side, [own, wanted]) in [[a, b], [b, a]].into_iter().enumerate() {
            let wanted = filled(gpu, other.as_ref(), "the other half", wanted)?;
            for (k, c) in grid.iter().enumerate() {
                let solver = DeviceSolver::new(gpu, self.solver.take(), &problem(*c, own))?;
                let mut r = gpu.record("trial");
                solver.record(&mut r, iterations)?;
                let first = (side * grid.len() + k) * parts;
                record_score(&mut r, [&solver.planes, &wanted, &mask], &sums, first)?;
                r.finish()?.run()?;
                self.solver = Some(solver);
            }
            other = Some(wanted);
        }
        let sums = gpu.fetch(&sums).await?;
        let total = |k: usize| sums[k * parts..][..parts].iter().map(|v| f64::from(*v)).sum::<f64>();
        Ok((0..grid.len()).map(|k| 0.5 * (total(k) + total(grid.len() + k))).collect())
    }

    /// The irradiance of a model; `None`, with the reason in the plan, where the device refuses or did before.
    pub(crate) async fn solve(
        &mut self,
        problem: &Problem<'_, f32>,
        iterations: usize,
        means: Option<&Means<'_>>,
        plan: &mut Plan,
    ) -> Result<Option<Vec<f32>>, DenoiseError> {
        let (gpu, name, began) = (self.gpu, &self.gpu.report().name, now());
        let mut solved = None;
        if self.refused.is_none() {
            let model = match DeviceModel::new(gpu, self.solver.take(), problem, iterations, means) {
                Ok(mut model) => model.fetch().await,
                Err(e) => Err(e),
            };
            solved = self.unless_refused(model)?;
        }
        if let Some(e) = &self.refused {
            let chosen = if self.trials > 0 { "; it chose the strength" } else { "" };
            plan.skip("device", format!("{name}: {e}: the model runs on the CPU{chosen}"));
            return Ok(None);
        }
        let told = match self.trials {
            0 => "one submission, one readback".into(),
            n => format!(
                "{n} trials of the strength and the model in one solver: {} submissions, 2 readbacks",
                n + 1
            ),
        };
        plan.timed("solver", format!("{iterations} steps and the way back from logarithms"), began);
        plan.run("device", format!("{name}: noisy logarithms to irradiance stay there; {told}"));
        match means {
            Some(_) => plan.run("mean", "local means of the noisy picture, on the device"),
            None => plan.skip("mean", NOT_RESTORED),
        }
        Ok(solved)
    }

    /// What the device gave; where it refused, `None`, and the reason is kept, unless the device is required.
    fn unless_refused<T>(&mut self, given: Result<T, DenoiseError>) -> Result<Option<T>, DenoiseError> {
        match given {
            Ok(given) => Ok(Some(given)),
            Err(e @ (DenoiseError::NotOnDevice { .. } | DenoiseError::Device(_))) if !self.required => {
                (self.solver, self.refused) = (None, Some(e));
                Ok(None)
            }
            Err(e) => Err(e),
        }
    }
}

/// The solver and the planes that it writes.
pub(crate) struct DeviceSolver {
    admm: DeviceAdmm,
    planes: Buffer<f32>,
}

impl DeviceSolver {
    /// In the buffers of a former one, as far as they have the size.
    fn new(gpu: &Gpu, former: Option<Self>, problem: &Problem<'_, f32>) -> Result<Self, DenoiseError> {
        let (admm, planes) = match former {
            Some(former) => (former.admm.again(gpu, problem)?, Some(former.planes)),
            None => (DeviceAdmm::new(gpu, problem)?, None),
        };
        Ok(Self { admm, planes: room(gpu, planes.as_ref(), "irradiance", problem.shape.len())? })
    }

    fn record(&self, r: &mut Recorder, iterations: usize) -> Result<(), DenoiseError> {
        self.admm.record(r, iterations)?;
        self.admm.unpack(r, &self.planes)
    }
}

/// A convex model on a device, recorded.
pub(crate) struct DeviceModel {
    gpu: Gpu,
    recording: Recording,
    planes: Buffer<f32>,
}

impl DeviceModel {
    /// Uploads what a model needs and records it: `iterations` of the solver, `max(exp(x) - 1, 0)`, and the means, if there are any.
    pub(crate) fn new(
        gpu: &Gpu,
        former: Option<DeviceSolver>,
        problem: &Problem<'_, f32>,
        iterations: usize,
        means: Option<&Means<'_>>,
    ) -> Result<Self, DenoiseError> {
        let solver = DeviceSolver::new(gpu, former, problem)?;
        let mut r = gpu.record("convex model");
        solver.record(&mut r, iterations)?;
        record_way_back(gpu, &mut r, problem.shape, &solver.planes, means)?;
        Ok(Self { gpu: gpu.clone(), recording: r.finish()?, planes: solver.planes })
    }

    /// Runs it and reads the irradiance back.
    pub(crate) async fn fetch(&mut self) -> Result<Vec<f32>, DenoiseError> {
        self.recording.run()?;
        Ok(self.gpu.fetch(&self.planes).await?)
    }

    /// Runs it and tells the work of its kernels.
    #[cfg(test)]
    pub(crate) fn report(&mut self) -> Result<Vec<KernelReport>, DenoiseError> {
        Ok(self.recording.report()?)
    }
}

/// Adds the squared distance of an estimate from the other half over a mask: partial sums from place `first` on.
pub(crate) fn record_score(
    r: &mut Recorder,
    [u, wanted, mask]: [&Buffer<f32>; 3],
    sums: &Buffer<f32>,
    first: usize,
) -> Result<(), DenoiseError> {
    let parts = u.len().div_ceil(TERMS);
    let [pixels, count, sums_of_one, first] = [mask.len(), u.len(), parts, first].map(|n| n as u32);
    let params = ScoreParams { pixels, count, sums: sums_of_one, first };
    r.dispatch(&SCORE, &params, &[u.bind(), wanted.bind(), mask.bind(), sums.bind()], parts)?;
    Ok(())
}

/// Adds the exponential of the estimate and its local means.
pub(crate) fn record_way_back(
    gpu: &Gpu,
    r: &mut Recorder,
    shape: Shape,
    planes: &Buffer<f32>,
    means: Option<&Means<'_>>,
) -> Result<(), DenoiseError> {
    let mut params = Params {
        width: shape.width as u32,
        height: shape.height as u32,
        radius: 0,
        plane: 0,
        black: 0,
        count: shape.len() as u32,
        unused: [0; 2],
    };
    r.dispatch(&EXPONENTIAL, &params, &[planes.bind()], shape.len())?;
    let Some(means) = means else { return Ok(()) };
    let taps = gaussian_taps(means.sigma);
    params.radius = taps.len() as u32 - 1;
    let mut signed = means.weight.to_vec();
    means.black.iter().for_each(|i| signed[*i] = -signed[*i]);
    let noisy = gpu.upload("noisy irradiance", means.noisy)?;
    let weights = gpu.upload("weights of the means", &signed)?;
    let taps = gpu.upload("taps", &taps)?;
    let sums = gpu.zeros::<[f32; 4]>("sums along rows", shape.pixels())?;
    for black in 0..=u32::from(!means.black.is_empty()) {
        for plane in 0..shape.channels as u32 {
            let params = Params { black, plane, ..params };
            let all = [planes.bind(), noisy.bind(), weights.bind(), taps.bind(), sums.bind()];
            r.dispatch(&MEAN_ROWS, &params, &all, shape.pixels())?;
            let [planes, _, weights, taps, sums] = all;
            r.dispatch(&MEAN_COLUMNS, &params, &[planes, weights, taps, sums], shape.pixels())?;
        }
    }
    Ok(())
}
