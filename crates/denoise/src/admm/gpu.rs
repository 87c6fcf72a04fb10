//! [`Admm`] on a device: total variation under any data term, with the exact linear step.

use super::{Admm, DataTerm, Problem, Weight};
#[cfg(not(target_arch = "wasm32"))]
use crate::future::at_once;
use crate::gpu::{filled, room};
use crate::transform::DeviceStrip;
use crate::{DenoiseError, Shape};
use photofit_gpu::{Bind, Buffer, Gpu, GpuError, INDEX, Kernel, Recorder};

const SOURCE: &[&str] = &[INDEX, include_str!("split.wgsl")];
pub(crate) const GRADIENT: Kernel = Kernel { name: "admm: gradient", source: SOURCE, entry: "gradient" };
pub(crate) const RIGHT_HAND_SIDES: Kernel =
    Kernel { name: "admm: right-hand sides", source: SOURCE, entry: "right_hand_sides" };
pub(crate) const BEGIN: Kernel = Kernel { name: "admm: begin", source: SOURCE, entry: "begin" };
pub(crate) const UNPACK: Kernel = Kernel { name: "admm: unpack", source: SOURCE, entry: "unpack" };

#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    width: u32,
    padded: u32,
    height: u32,
    channels: u32,
    coupled: u32,
    alpha: [u32; 2],
    first: [u32; 2],
    second: [u32; 2],
    huber: u32,
    gain: f32,
    relaxation: f32,
    t0: f32,
    t1: f32,
    scale: f32,
    channel: u32,
    plane: u32,
    offset: f32,
}

/// [`Admm`] on a device, from the first estimate on. All of it stays there until the planes are read.
///
/// Total variation of all channels or of each, under any data term; no Hessian and no guide. Steps are those of
/// [`super::LinearStep::Exact`].
#[derive(Debug)]
pub struct DeviceAdmm {
    shape: Shape,
    params: Params,
    /// For each plane of the solution the solved channel, none for a constant one, and its offset.
    lanes: Vec<(Option<usize>, f32)>,
    strip: DeviceStrip,
    picture: Buffer<[f32; 2]>,
    kept: Buffer<[f32; 2]>,
    reflected: Buffer<[f32; 2]>,
    alpha: Buffer<f32>,
    data: Buffer<f32>,
    target: Buffer<f32>,
    weights: [Buffer<f32>; 2],
}

/// A weight on the device: its buffer, and the steps from pixel to pixel and from channel to channel.
fn weight(
    gpu: &Gpu,
    former: Option<&Buffer<f32>>,
    name: &str,
    weight: Option<&Weight<f32>>,
    shape: Shape,
    channels: &[usize],
) -> Result<(Buffer<f32>, [u32; 2]), GpuError> {
    let n = shape.pixels();
    match weight {
        None => Ok((filled(gpu, former, name, &[0.0])?, [0, 0])),
        Some(Weight::Uniform(v)) => Ok((filled(gpu, former, name, &[*v])?, [0, 0])),
        Some(Weight::Map(values)) if values.len() == n => Ok((filled(gpu, former, name, values)?, [1, 0])),
        Some(Weight::Map(values)) => {
            let planes: Vec<f32> = channels.iter().flat_map(|c| &values[c * n..][..n]).copied().collect();
            Ok((filled(gpu, former, name, &planes)?, [1, n as u32]))
        }
    }
}

impl DeviceAdmm {
    /// At the first estimate, with the penalties of the CPU.
    ///
    /// # Errors
    /// If the problem does not pass [`Problem::check`], [`DenoiseError::NotOnDevice`] if it has a Hessian or a guide or rows
    /// that are too long, and what the device says.
    pub fn new(gpu: &Gpu, problem: &Problem<'_, f32>) -> Result<Self, DenoiseError> {
        Self::build(gpu, None, problem)
    }

    /// Another problem in the buffers of this one, as far as they have the size. What this one recorded must have been run.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn again(self, gpu: &Gpu, problem: &Problem<'_, f32>) -> Result<Self, DenoiseError> {
        Self::build(gpu, Some(&self), problem)
    }

    fn build(gpu: &Gpu, former: Option<&Self>, problem: &Problem<'_, f32>) -> Result<Self, DenoiseError> {
        let admm = Admm::without_engine(problem)?;
        let (shape, plan, p) = (admm.shape, &admm.plan, admm.penalties);
        let cannot = |what: String| Err(DenoiseError::NotOnDevice { what });
        if plan.hessian || plan.guide {
            return cannot("the Hessian and guided gradients".into());
        }
        let (longest, padded) = (DeviceStrip::longest(gpu), plan.padded_width);
        if padded > longest {
            return cannot(format!("rows of {} pixels (at most {longest})", shape.width));
        }
        let channels = &admm.channels;
        let count = channels.len();
        let [first, second] = admm.data.weights();
        let ([w0, w1], huber) = match &admm.data {
            DataTerm::L2 { .. } => ([None, first], 0),
            DataTerm::L1 { .. } | DataTerm::Hybrid { .. } => ([first, second], 0),
            DataTerm::Huber { .. } => ([first, second], 1),
        };
        let upload = |former, name, w| weight(gpu, former, name, w, shape, channels);
        let (alpha, alpha_steps) = upload(former.map(|f| &f.alpha), "alpha", admm.weights[0].as_ref())?;
        let (first, first_steps) = upload(former.map(|f| &f.weights[0]), "first weight", w0)?;
        let (second, second_steps) = upload(former.map(|f| &f.weights[1]), "second weight", w1)?;
        let system = plan.symbol(p);
        let params = Params {
            width: shape.width as u32,
            padded: padded as u32,
            height: shape.height as u32,
            channels: count as u32,
            coupled: if admm.coupling == super::Coupling::Vectorial { count as u32 } else { 1 },
            alpha: alpha_steps,
            first: first_steps,
            second: second_steps,
            huber,
            // The first step takes the operators once: the splits start at the estimate.
            gain: 1.0,
            relaxation: p.relaxation as f32,
            t0: p.data as f32,
            t1: system.c1 as f32,
            scale: if plan.gradient { (admm.merged / p.gradient) as f32 } else { 0.0 },
            channel: 0,
            plane: 0,
            offset: 0.0,
        };
        let samples = padded * shape.height;
        let lanes = (0..shape.channels).map(|plane| match admm.lane_of(plane) {
            Some((c, source)) => (Some(c), admm.offsets[source]),
            None => (None, admm.offsets[plane]),
        });
        let pictures = count.div_ceil(2);
        let strip =
            DeviceStrip::new(gpu, former.map(|f| &f.strip), [padded, shape.height], pictures, system)?;
        Ok(Self {
            shape,
            params,
            lanes: lanes.collect(),
            strip,
            picture: room(gpu, former.map(|f| &f.picture), "estimate", pictures * samples)?,
            kept: room(gpu, former.map(|f| &f.kept), "splits of the gradient", count * samples)?,
            reflected: room(
                gpu,
                former.map(|f| &f.reflected),
                "reflections of the gradient",
                count * samples,
            )?,
            alpha,
            data: room(gpu, former.map(|f| &f.data), "split of the data term", count * samples)?,
            target: filled(gpu, former.map(|f| &f.target), "target", &admm.target)?,
            weights: [first, second],
        })
    }

    fn weights(&self) -> [Bind; 3] {
        [self.target.bind(), self.weights[0].bind(), self.weights[1].bind()]
    }

    /// Adds the first estimate and `iterations` steps to a list of commands.
    ///
    /// # Errors
    /// If the device refuses a kernel.
    pub fn record(&self, r: &mut Recorder, iterations: usize) -> Result<(), GpuError> {
        let threads = self.params.padded as usize * self.shape.height;
        if self.params.channels == 0 {
            return Ok(());
        }
        r.clear(&self.kept);
        r.clear(&self.data);
        let [target, first, second] = self.weights();
        let begin = [self.picture.bind(), target.clone(), first.clone(), second.clone()];
        r.dispatch(&BEGIN, &self.params, &begin, threads)?;
        for k in 0..iterations {
            let params = Params { gain: if k == 0 { 1.0 } else { self.params.relaxation }, ..self.params };
            let splits = [&self.picture, &self.kept, &self.reflected].map(Buffer::bind);
            let alpha = [&splits[..], &[self.alpha.bind()]].concat();
            r.dispatch(&GRADIENT, &params, &alpha, threads)?;
            let [picture, _, reflected] = splits;
            let sides = [picture, reflected, self.data.bind(), target.clone(), first.clone(), second.clone()];
            r.dispatch(&RIGHT_HAND_SIDES, &params, &sides, threads)?;
            self.strip.solve(r, &self.picture)?;
        }
        Ok(())
    }

    /// Adds what writes the estimate as planes of the problem's shape.
    ///
    /// # Errors
    /// If the device refuses the kernel, or the buffer is shorter.
    pub fn unpack(&self, r: &mut Recorder, planes: &Buffer<f32>) -> Result<(), DenoiseError> {
        DenoiseError::length("the planes of a device", planes.len(), self.shape.len(), self.shape)?;
        for (plane, (lane, offset)) in self.lanes.iter().enumerate() {
            let channel = lane.map_or(u32::MAX, |c| c as u32);
            let params = Params { channel, plane: plane as u32, offset: *offset, ..self.params };
            r.dispatch(&UNPACK, &params, &[self.picture.bind(), planes.bind()], self.shape.pixels())?;
        }
        Ok(())
    }
}

/// The estimate after some iterations on a device, as [`Admm::solution`] gives it. In a browser, [`fetch_solution`] gives it.
///
/// # Errors
/// Those of [`DeviceAdmm::new`], and what the device says.
#[cfg(not(target_arch = "wasm32"))]
pub fn solve_on(gpu: &Gpu, problem: &Problem<'_, f32>, iterations: usize) -> Result<Vec<f32>, DenoiseError> {
    at_once(fetch_solution(gpu, problem, iterations))
}

/// [`solve_on`] as a future, which blocks the thread outside of browsers only.
///
/// # Errors
/// As [`solve_on`].
pub async fn fetch_solution(
    gpu: &Gpu,
    problem: &Problem<'_, f32>,
    iterations: usize,
) -> Result<Vec<f32>, DenoiseError> {
    let admm = DeviceAdmm::new(gpu, problem)?;
    let planes = gpu.zeros("solution", problem.shape.len())?;
    let mut r = gpu.record("admm");
    admm.record(&mut r, iterations)?;
    admm.unpack(&mut r, &planes)?;
    r.finish()?.run()?;
    Ok(gpu.fetch(&planes).await?)
}
