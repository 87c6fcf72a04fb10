//! Where a fit runs.

use super::cpu::{Chain, Cpu};
#[cfg(feature = "gpu")]
use super::gpu::{BandCount, DrawnThere, GpuSurface, Residence, Shown};
use super::posed::Posed;
use super::reference::{Rasterized, Reference};
use super::surface::Surface;
use super::trainer::{Job, Phase, Trained, train};
use super::views::Moment;
use crate::candidate::Vertices;
use crate::{FitError, Progress};
#[cfg(feature = "gpu")]
use photofit_gpu::Gpu;

/// Where a fit runs, and why there.
#[derive(Clone, Debug)]
pub struct Device {
    kind: Kind,
    why: String,
}

#[derive(Clone, Debug)]
enum Kind {
    Cpu,
    #[cfg(feature = "gpu")]
    Gpu {
        gpu: Gpu,
        /// Whether nothing else will do.
        required: bool,
    },
}

impl Default for Device {
    fn default() -> Self {
        Self::cpu("")
    }
}

impl Device {
    /// The CPU. `why` is told by the plan; empty: nothing is told.
    pub fn cpu(why: &str) -> Self {
        Self { kind: Kind::Cpu, why: why.into() }
    }

    /// A device; unless it is `required`, a fit that does not fit on it runs on the CPU, and says so.
    #[cfg(feature = "gpu")]
    pub fn gpu(gpu: Gpu, required: bool, why: &str) -> Self {
        Self { kind: Kind::Gpu { gpu, required }, why: why.into() }
    }

    /// Whether it is the CPU.
    pub fn is_cpu(&self) -> bool {
        matches!(self.kind, Kind::Cpu)
    }

    /// Whether it is a GPU, and nothing else will do.
    pub(crate) fn requires_gpu(&self) -> bool {
        match &self.kind {
            Kind::Cpu => false,
            #[cfg(feature = "gpu")]
            Kind::Gpu { required, .. } => *required,
        }
    }

    /// What it is, for people.
    pub fn name(&self) -> String {
        match &self.kind {
            Kind::Cpu => "CPU".into(),
            #[cfg(feature = "gpu")]
            Kind::Gpu { gpu, .. } => format!("{}, {}", gpu.report().name, gpu.report().backend),
        }
    }

    /// With where the pictures of the reference are and are drawn, and how pictures are drawn, where a reason is told.
    #[cfg(feature = "gpu")]
    fn with(&self, told: Option<(Residence, BandCount)>, reference: &dyn Reference) -> Self {
        let mut why = self.why.clone();
        if !why.is_empty() {
            let bands =
                told.as_ref().filter(|(_, bands)| bands.get() > 1).map(|(_, bands)| bands.to_string());
            let rows =
                told.map(|(r, _)| r.to_string()).into_iter().chain(bands).chain(reference.where_drawn());
            rows.for_each(|row| why += &format!("; {row}"));
        }
        Self { kind: self.kind.clone(), why }
    }

    /// A rasterized reference whose pictures are drawn here.
    pub(crate) fn drawing<'a>(&self, reference: Rasterized<'a>) -> Box<dyn Reference + 'a> {
        match &self.kind {
            Kind::Cpu => Box::new(reference),
            #[cfg(feature = "gpu")]
            Kind::Gpu { gpu, required } => Box::new(DrawnThere::new(gpu, reference, *required)),
        }
    }

    /// Name and reason, as the plan tells them; none where there is nothing to tell.
    pub(crate) fn told(&self) -> Option<String> {
        (!self.why.is_empty()).then(|| format!("{}: {}", self.name(), self.why))
    }
}

/// What a device fits: a surface, as it stands or at moments of an animation.
pub trait Posable: Chain + Clone {
    /// Whether every picture has vertices of its own.
    const POSED: bool;

    /// The surface.
    fn surface(&self) -> &Surface;

    /// The same to be changed.
    fn surface_mut(&mut self) -> &mut Surface;

    /// Its vertices at a moment.
    ///
    /// # Errors
    /// A moment that it does not have, or one at which it cannot be drawn.
    fn posed(&self, moment: Moment) -> Result<Vertices, FitError>;
}

impl Posable for Surface {
    const POSED: bool = false;

    fn surface(&self) -> &Surface {
        self
    }

    fn surface_mut(&mut self) -> &mut Surface {
        self
    }

    fn posed(&self, _: Moment) -> Result<Vertices, FitError> {
        Ok(self.candidate.vertices())
    }
}

impl Posable for Posed<'_> {
    const POSED: bool = true;

    fn surface(&self) -> &Surface {
        Posed::surface(self)
    }

    fn surface_mut(&mut self) -> &mut Surface {
        Posed::surface_mut(self)
    }

    fn posed(&self, moment: Moment) -> Result<Vertices, FitError> {
        self.vertices(moment)
    }
}

/// Runs a fit of a surface there; see [`train`]. Also tells the device that it ran on: where a GPU was not required and
/// cannot hold the fit, or fails before its first step is done, that is the CPU.
pub(crate) fn train_on<'p, S: Posable + 'p>(
    device: &Device,
    surface: S,
    job: &Job<'_>,
    phases: impl FnMut(f64) -> Vec<Phase<'p, S>>,
    progress: &dyn Progress,
) -> Result<(Trained<S>, Device), FitError> {
    #[cfg(feature = "gpu")]
    if let Kind::Gpu { gpu, required } = &device.kind {
        let (mut phases, mut told) = (phases, None);
        let model =
            GpuSurface::beside(gpu, surface.clone(), job.held_out.shots(), job.reference.device_memory());
        let trained = match model.and_then(|m| m.keeping(Shown::by(job))) {
            Ok((model, residence)) => {
                told = Some((residence, model.bands()));
                train(model, job, &mut phases, progress)
            }
            Err(source) => Err(FitError::NoRoom { device: device.name(), source: Box::new(source) }),
        };
        let name = device.name();
        let why = match trained {
            Err(FitError::NoRoom { source, .. }) if !*required => {
                format!("it does not fit on {name}: {source}")
            }
            Err(FitError::Device { step: 0, source, .. }) if !*required => {
                format!("its first step failed on {name}: {source}")
            }
            trained => return Ok((trained?, device.with(told, job.reference))),
        };
        progress.warn(&format!("the fit runs on the CPU: {why}"));
        job.reference.leave_device(&why);
        let trained = train(Cpu::new(surface)?, job, phases, progress)?;
        return Ok((trained, Device::cpu(&why)));
    }
    Ok((train(Cpu::new(surface)?, job, phases, progress)?, device.clone()))
}
