//! The convex models on a device: solver, exponential and local means, from the uploaded logarithms to the irradiance that is
//! read back.

use super::Plan;
use super::log_domain::NOT_RESTORED;
use super::window::gaussian_taps;
use crate::admm::{DeviceAdmm, Problem};
use crate::{DenoiseError, Shape};
#[cfg(test)]
use photofit_gpu::KernelReport;
use photofit_gpu::{Buffer, Gpu, INDEX, Kernel, Recorder, Recording};
use std::time::Instant;

const SOURCE: &[&str] = &[INDEX, include_str!("mean.wgsl")];
pub(crate) const EXPONENTIAL: Kernel =
    Kernel { name: "mean: exponential", source: SOURCE, entry: "exponential" };
pub(crate) const MEAN_ROWS: Kernel = Kernel { name: "mean: rows", source: SOURCE, entry: "mean_rows" };
pub(crate) const MEAN_COLUMNS: Kernel =
    Kernel { name: "mean: columns", source: SOURCE, entry: "mean_columns" };

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

/// The irradiance of a convex model by a device; `None`, with the reason in the plan, where it cannot.
pub(crate) fn solve_model(
    gpu: &Gpu,
    problem: &Problem<'_, f32>,
    iterations: usize,
    means: Option<&Means<'_>>,
    plan: &mut Plan,
) -> Result<Option<Vec<f32>>, DenoiseError> {
    let (name, began) = (&gpu.report().name, Instant::now());
    match DeviceModel::new(gpu, problem, iterations, means).and_then(|mut model| model.run()) {
        Ok(u) => {
            plan.timed("solver", format!("{iterations} steps and the way back from logarithms"), began);
            let what = "noisy logarithms to irradiance stay there; one upload, one submission, one readback";
            plan.run("device", format!("{name}: {what}"));
            match means {
                Some(_) => plan.run("mean", "local means of the noisy picture, on the device"),
                None => plan.skip("mean", NOT_RESTORED),
            }
            Ok(Some(u))
        }
        Err(e @ (DenoiseError::NotOnDevice { .. } | DenoiseError::Device(_))) => {
            plan.skip("device", format!("{name}: {e}: the model runs on the CPU"));
            Ok(None)
        }
        Err(e) => Err(e),
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
        problem: &Problem<'_, f32>,
        iterations: usize,
        means: Option<&Means<'_>>,
    ) -> Result<Self, DenoiseError> {
        let shape = problem.shape;
        let admm = DeviceAdmm::new(gpu, problem)?;
        let planes = gpu.zeros("irradiance", shape.len())?;
        let mut r = gpu.record("convex model");
        admm.record(&mut r, iterations)?;
        admm.unpack(&mut r, &planes)?;
        record_way_back(gpu, &mut r, shape, &planes, means)?;
        Ok(Self { gpu: gpu.clone(), recording: r.finish()?, planes })
    }

    /// Runs it and reads the irradiance back.
    pub(crate) fn run(&mut self) -> Result<Vec<f32>, DenoiseError> {
        self.recording.run()?;
        Ok(self.gpu.read(&self.planes)?)
    }

    /// Runs it and tells the work of its kernels.
    #[cfg(test)]
    pub(crate) fn report(&mut self) -> Result<Vec<KernelReport>, DenoiseError> {
        Ok(self.recording.report()?)
    }
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
