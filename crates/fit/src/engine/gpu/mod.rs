//! A surface that is fitted on a device: pictures, gradients and moves stay there, one submission a step; losses, values
//! and states are read when the trainer evaluates.
//!
//! It does what [`Surface`] does in main memory, operation by operation. Gradients are sums that do not depend on the order
//! of their terms: the same fit gives the same bits on the same device. Pictures of the reference, drawn on the device or not,
//! are uploaded, each of them once where the device has room for all that are shown again; their noise is made on the device. Pictures of a step
//! share their buffers, one after the other; where there is no room for a whole one, it is drawn in bands of rows.

mod bands;
mod drawn;
mod poses;
mod recorded;
mod references;
mod resident;
mod room;
mod skies;
mod stage;
mod weights;

use super::cpu::Chain;
use super::device::Posable;
use super::loss::PictureLoss;
use super::model::{Group, Model, ModelError, Snapshot};
use super::surface::{POSITIONS, PositionOptimizer, SIGMA, Surface, temporal};
use super::views::{Moment, Shot};
use crate::FitError;
use crate::candidate::Vertices;
pub use bands::BandCount;
use bands::Bands;
pub(crate) use bands::projection_of_rows;
pub use drawn::DeviceMemory;
pub(crate) use drawn::DrawnThere;
use photofit_gpu::{Buffer, FIXED_LIMITED, FIXED_LOST, Gpu, GpuError, Kernel, KernelReport, Recording};
use photofit_optim::OptimError;
use photofit_optim::gpu::{DeviceOptimizer, LargeStepsSolver};
use photofit_raster::CHANNELS;
use photofit_raster::deferred::{Masks, Passes};
use poses::Poses;
use recorded::{COURSE, Forward, Step};
use references::References;
pub use references::{Residence, Shown};
use resident::Resident;
pub use room::NoRoom;
pub(crate) use skies::Skies;
use stage::{Room, Stage};
use std::borrow::Cow;
use std::ops::Range;

/// The kernels of this crate.
pub const KERNELS: &[Kernel] = &[
    resident::HOLD,
    resident::PUT_BACK,
    resident::ADD_LOSSES,
    references::OVER_NOISE,
    weights::KERNELS[0],
    weights::KERNELS[1],
    crate::scene_render::gpu::SHADE,
];

/// Vectors of a texel.
const VECTORS: usize = CHANNELS / 4;

/// A [`Surface`] on a device, as it stands or in poses.
#[derive(Debug)]
pub struct GpuSurface<S = Surface> {
    gpu: Gpu,
    asset: S,
    /// Those of a surface that is seen in some.
    poses: Option<Poses>,
    groups: Vec<Group>,
    on: Resident,
    optimizers: Vec<DeviceOptimizer>,
    skies: Skies,
    references: References,
    /// The largest picture so far, the most pictures at once, and the bands that they are drawn in.
    room: Room,
    most: usize,
    bands: Bands,
    told: BandCount,
    stage: Option<Stage>,
    step: Option<Step>,
    forward: Option<Forward>,
    /// Builds the mip chain of the maps.
    rebuild: Recording,
    keep: Recording,
    /// Loss of each step since they were read.
    course: Buffer<f32>,
    pending: usize,
    losses: Vec<f64>,
    limited: Limited,
    /// What the reference holds there.
    of_reference: Option<DeviceMemory>,
}

/// Gradients with terms that ended at the limit of their sums.
#[derive(Debug, Default)]
struct Limited {
    seen: Vec<&'static str>,
    told: usize,
}

impl From<GpuError> for ModelError {
    fn from(e: GpuError) -> Self {
        Self::Device(Box::new(e))
    }
}

/// What an optimizer says of the present step, or its device.
fn model_error(e: OptimError) -> ModelError {
    match e {
        OptimError::Device(e) => e.into(),
        source => ModelError::Optim { ago: 0, source },
    }
}

/// Why no device fits a surface.
fn refused(surface: &Surface, posed: bool) -> Option<OptimError> {
    let refuse =
        |group: &'static str, what, with| Some(OptimError::Combination { group: group.into(), what, with });
    if posed && surface.moves {
        let what = "the shape of an asset that is seen in poses";
        return refuse(POSITIONS, what, "a device, where poses have no gradient");
    }
    None
}

/// Parameters, topology and optimizers on a device.
fn uploaded(
    gpu: &Gpu,
    surface: &Surface,
    groups: &[Group],
) -> Result<(Resident, Vec<DeviceOptimizer>), NoRoom> {
    let on = Resident::new(gpu, surface)?;
    let (rings, smoothness) = (&surface.candidate.rings, surface.smoothness);
    let (offsets, neighbours) = (&rings.offsets[..], &rings.items[..]);
    let optimizer = |group: &Group| {
        let shape = (group.rows, group.columns);
        if group.name != POSITIONS {
            let made = DeviceOptimizer::new(gpu, &group.name, shape, temporal(&group.name), None);
            return made.map_err(NoRoom::maps);
        }
        let made = |solver| DeviceOptimizer::new(gpu, POSITIONS, shape, surface.optimizer.temporal(), solver);
        let diffused = || made(Some(LargeStepsSolver::new(gpu, offsets, neighbours, smoothness)?));
        let made = match surface.optimizer {
            PositionOptimizer::LargeSteps => diffused(),
            PositionOptimizer::Bilateral => {
                LargeStepsSolver::edge_aware(gpu, offsets, neighbours, smoothness, SIGMA)
                    .and_then(|creases| diffused()?.with_moments_by(creases))
            }
            PositionOptimizer::Adam => made(None),
        };
        made.map_err(NoRoom::mesh)
    };
    Ok((on, groups.iter().map(optimizer).collect::<Result<_, _>>()?))
}

/// What a device says.
fn itself(e: &GpuError) -> Option<&GpuError> {
    Some(e)
}

/// What a device says, where it is that.
fn of_device(e: &OptimError) -> Option<&GpuError> {
    if let OptimError::Device(e) = e { Some(e) } else { None }
}

impl<S: Posable> GpuSurface<S> {
    /// Uploads a surface, and makes room for pictures such as `shots`.
    ///
    /// # Errors
    /// If the device cannot hold it, or does not run its optimizer.
    pub fn new(gpu: &Gpu, asset: S, shots: &[Shot]) -> Result<Self, NoRoom> {
        Self::beside(gpu, asset, shots, None)
    }

    /// [`Self::new`] beside a reference, which gives back what it holds there before pictures are drawn in bands or there is
    /// no room.
    pub(crate) fn beside(
        gpu: &Gpu,
        asset: S,
        shots: &[Shot],
        of_reference: Option<DeviceMemory>,
    ) -> Result<Self, NoRoom> {
        let (groups, surface) = (asset.groups(), asset.surface());
        if let Some(source) = refused(surface, S::POSED) {
            return Err(NoRoom { source, option: None });
        }
        let (on, optimizers) = loop {
            match uploaded(gpu, surface, &groups) {
                Err(e)
                    if e.is_out_of_memory() && of_reference.as_ref().is_some_and(DeviceMemory::give_back) => {
                }
                made => break made?,
            }
        };
        let mut r = gpu.record("rebuild");
        on.maps.record_rebuild(&mut r)?;
        let rebuild = r.finish()?;
        let mut r = gpu.record("keep");
        r.copy(&on.welded, &on.best.0)?;
        r.copy(&on.maps.texels, &on.best.1)?;
        let mut keep = r.finish()?;
        keep.run()?;
        let mut model = Self {
            skies: Skies::new(gpu)?,
            references: References::default(),
            course: gpu.zeros("losses of steps", COURSE)?,
            gpu: gpu.clone(),
            poses: S::POSED.then(Poses::default),
            asset,
            groups,
            on,
            optimizers,
            room: Room::default(),
            most: 0,
            bands: Bands::default(),
            told: BandCount::new(Bands::default()),
            stage: None,
            step: None,
            forward: None,
            rebuild,
            keep,
            pending: 0,
            losses: Vec::new(),
            limited: Limited::default(),
            of_reference,
        };
        model.in_bands(shots, itself, |_| Ok(())).map_err(NoRoom::pictures)?;
        Ok(model)
    }

    /// Makes room for the pictures of the reference that a fit shows again, so that each is uploaded once; tells for how
    /// many there is.
    ///
    /// # Errors
    /// If there is none for those of a step.
    pub fn keeping(mut self, shown: Shown) -> Result<(Self, Residence), NoRoom> {
        let made = self.in_bands(&[], itself, |model| References::new(&model.gpu, shown));
        let (references, residence) = made.map_err(NoRoom::pictures)?;
        self.references = references;
        Ok((self, residence))
    }

    /// In how many bands of rows pictures are drawn: as many as the device needs to have room.
    pub fn bands(&self) -> BandCount {
        self.told.clone()
    }

    /// Makes the last step once more, with a timestamp around each dispatch, and tells the work of its kernels; empty before
    /// the first step.
    ///
    /// # Errors
    /// If the device refuses it or is lost.
    pub fn report_step(&mut self) -> Result<Vec<KernelReport>, GpuError> {
        self.step.as_mut().map_or(Ok(Vec::new()), Step::report)
    }

    /// Makes room for shots and their environments. What was recorded for less is dropped.
    fn prepare(&mut self, shots: &[Shot]) -> Result<(), GpuError> {
        self.room = self.room.and(Room::of(shots));
        self.most = self.most.max(shots.len());
        let serves = |s: &Stage| s.room == self.room && s.bands == self.bands && s.places() >= self.most;
        if !self.stage.as_ref().is_some_and(serves) {
            (self.stage, self.step, self.forward) = (None, None, None);
            let drawn = (self.room, self.bands);
            self.stage =
                Some(Stage::new(&self.gpu, &self.on, drawn, &self.asset.surface().passes, self.most)?);
        }
        if self.skies.add(&self.gpu, shots.iter().map(|s| &s.lights))? {
            (self.step, self.forward) = (None, None);
        }
        Ok(())
    }

    /// Uploads the poses of shots that are not there.
    fn pose(&mut self, shots: &[Shot]) -> Result<(), ModelError> {
        let Some(poses) = &mut self.poses else { return Ok(()) };
        let missing = poses.begin(shots.iter().map(|s| s.moment));
        let asset = &self.asset;
        let made = |m: Moment| Ok((m, asset.posed(m).map_err(|e| ModelError::Picture(Box::new(e)))?));
        let made: Vec<(Moment, Vertices)> =
            missing.into_iter().map(made).collect::<Result<_, ModelError>>()?;
        let put = self.in_bands(shots, itself, |model| {
            let Some(poses) = &mut model.poses else { return Ok(()) };
            made.iter().try_for_each(|(moment, vertices)| poses.put(&model.gpu, *moment, vertices))
        });
        Ok(put?)
    }

    /// Does `work` once there is room for shots. Where there is none, once more without the pictures of the reference beyond
    /// those of a step, then without what the reference draws with, then with pictures in more and more bands, as long as something is missing for want of room.
    fn in_bands<T, E: From<GpuError>>(
        &mut self,
        shots: &[Shot],
        device: impl Fn(&E) -> Option<&GpuError>,
        mut work: impl FnMut(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        loop {
            match self.prepare(shots).map_err(E::from).and_then(|()| work(self)) {
                Err(e) if device(&e).is_some_and(GpuError::is_of_size) => {
                    let full = matches!(device(&e), Some(GpuError::OutOfMemory { .. }));
                    let reference = || self.of_reference.as_ref().is_some_and(DeviceMemory::give_back);
                    if full && (self.references.give_back(shots.len()) || reference()) {
                        continue;
                    }
                    (self.stage, self.step, self.forward) = (None, None, None);
                    self.bands = self.bands.finer(self.room).ok_or(e)?;
                    self.told.tell(self.bands);
                }
                done => return done,
            }
        }
    }

    /// Records a step; none before there is room for pictures.
    fn record(
        &self,
        rooms: Vec<Room>,
        loss: PictureLoss,
        with: (&[bool], &Passes),
    ) -> Result<Option<Step>, OptimError> {
        let Some(stage) = &self.stage else { return Ok(None) };
        let on = (stage, &self.skies, &self.course);
        let groups = (&self.groups[..], &self.optimizers[..]);
        Step::new(&self.gpu, &self.on, on, (rooms, loss), groups, (with.0, with.1, S::POSED)).map(Some)
    }

    /// Takes the losses of the steps since they were read from the device.
    fn read_course(&mut self) -> Result<(), GpuError> {
        if self.pending > 0 {
            let course = self.gpu.read(&self.course)?;
            self.losses.extend(course[..self.pending].iter().map(|l| f64::from(*l)));
            self.pending = 0;
        }
        Ok(())
    }

    /// Where the texels of a group lie in the buffers of the maps, in vectors; none for the positions.
    fn place(&self, group: usize) -> Option<Range<usize>> {
        let surface = self.asset.surface();
        let texels = (!surface.is_positions(group)).then(|| self.on.texels_of(surface.level_of(group)))?;
        Some(VECTORS * texels.start..VECTORS * texels.end)
    }

    fn read_group(&self, group: usize, best: bool) -> Result<Vec<f32>, GpuError> {
        let on = &self.on;
        let Some(place) = self.place(group) else {
            let positions = if best { &on.best.0 } else { &on.welded };
            return Ok(self.gpu.read(positions)?.into_flattened());
        };
        let texels = if best { &on.best.1 } else { &on.maps.texels };
        Ok(self.gpu.read_range(texels, place)?.into_flattened())
    }

    fn write_group(&mut self, group: usize, values: &[f32]) -> Result<(), GpuError> {
        let Some(place) = self.place(group) else {
            return self.gpu.write(&self.on.welded, bytemuck::cast_slice(values));
        };
        self.gpu.write_from(&self.on.maps.texels, place.start, bytemuck::cast_slice(values))?;
        self.rebuild.run()
    }

    /// Copies the values of a group to the best ones, or the best ones to the values.
    fn copy_group(&self, group: usize, from_best: bool) -> Result<(), GpuError> {
        let (on, mut r) = (&self.on, self.gpu.record("copy a group"));
        if let Some(place) = self.place(group) {
            // Levels that follow from the base are copied with it.
            let alone = self.asset.surface().candidate.fitted_levels() > 1;
            let place = if alone { place } else { 0..on.maps.texels.len() };
            let (present, best) = (&on.maps.texels, &on.best.1);
            let (from, to) = if from_best { (best, present) } else { (present, best) };
            r.copy_range(from, to, place)?;
        } else {
            let (present, best) = (&on.welded, &on.best.0);
            let (from, to) = if from_best { (best, present) } else { (present, best) };
            r.copy(from, to)?;
        }
        r.finish()?.run()
    }

    /// Brings the surface in main memory up to date.
    fn download(&mut self) -> Result<(), GpuError> {
        for group in 0..self.groups.len() {
            let values = self.read_group(group, false)?;
            let surface = self.asset.surface_mut();
            surface.values_mut(group).copy_from_slice(&values);
            surface.update(group);
        }
        Ok(())
    }
}

impl<S: Posable> Model for GpuSurface<S> {
    type Asset = S;

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn step_masks(&mut self, masks: Masks) {
        self.asset.surface_mut().masks = masks;
    }

    fn step(&mut self, shots: &[Shot], loss: PictureLoss, rates: &[f64]) -> Result<(), ModelError> {
        let mut ordered: Vec<&Shot> = shots.iter().collect();
        ordered.sort_by_key(|s| std::cmp::Reverse(s.width * s.height));
        let rooms: Vec<Room> = ordered.iter().map(|s| Room::of(std::slice::from_ref(*s))).collect();
        let (room, moving) = (Room::of(shots), rates.iter().map(|r| *r > 0.0).collect::<Vec<_>>());
        let rates: Vec<Vec<f32>> = self.groups.iter().zip(rates).map(|(g, r)| g.rates_at(*r)).collect();
        let passes = self.asset.surface().moving_passes(&moving);
        self.pose(shots)?;
        let recorded = self.in_bands(shots, of_device, |model| {
            model.references.make_room(&model.gpu, shots.len(), room.pixel_count())?;
            let with = (&moving[..], passes.masks);
            if !model.step.as_ref().is_some_and(|s| s.serves(&rooms, loss, with)) {
                // Sizes vary from step to step: soon there is room for all.
                let before = model.step.take();
                let rooms = before.and_then(|s| s.rooms_and(&rooms)).unwrap_or_else(|| rooms.clone());
                model.step = model.record(rooms, loss, (&moving, &passes))?;
            }
            Ok(())
        });
        recorded.map_err(model_error)?;
        if self.pending == COURSE {
            self.read_course()?;
        }
        if let Some(step) = &mut self.step {
            let on = (&self.on, &self.skies, &mut self.references, self.poses.as_ref());
            let optimizers = (&mut self.optimizers[..], &rates[..]);
            step.run(&self.gpu, on, (&ordered, passes.masks), optimizers, self.pending)
                .map_err(model_error)?;
            self.pending += 1;
        }
        Ok(())
    }

    fn losses(&mut self) -> Result<Vec<f64>, ModelError> {
        self.read_course()?;
        let losses = std::mem::take(&mut self.losses);
        if losses.is_empty() || losses.iter().any(|l| !l.is_finite()) {
            return Ok(losses);
        }
        for optimizer in &self.optimizers {
            if let Some((ago, source)) = optimizer.check().map_err(model_error)? {
                return Err(ModelError::Optim { ago, source });
            }
        }
        // Terms that end at their limit, next to slivers, count as that: a step in their direction is as good, and told.
        let sums = self.stage.as_ref().map(|s| ("positions", &s.gradients.status));
        for (what, status) in sums.into_iter().chain([("maps", &self.on.maps.status)]) {
            let bits = self.gpu.read(status)?.first().copied().unwrap_or_default();
            if bits & FIXED_LIMITED != 0 && !self.limited.seen.contains(&what) {
                self.limited.seen.push(what);
            }
            if bits & FIXED_LOST != 0 {
                let rule = "is not finite or outside of the range of the device's sums; a fit on the CPU has no such range";
                return Err(ModelError::Device(format!("a gradient of the {what} {rule}").into()));
            }
        }
        Ok(losses)
    }

    fn notes(&mut self) -> Vec<String> {
        let new = &self.limited.seen[std::mem::replace(&mut self.limited.told, self.limited.seen.len())..];
        let told = |what: &&str| {
            format!(
                "some terms of the gradient of the {what} are larger than the device's sums take and count as the largest \
                 that they take, as next to slivers: a fit on the CPU has no such limit"
            )
        };
        new.iter().map(told).collect()
    }

    fn pictures(&mut self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        self.pose(shots)?;
        let room = Room::of(shots);
        self.in_bands(shots, itself, |model| {
            if let Some(stage) =
                model.stage.as_ref().filter(|_| !model.forward.as_ref().is_some_and(|l| l.serves(room)))
            {
                let with = (&model.asset.surface().passes, S::POSED);
                model.forward = Some(Forward::new(&model.gpu, &model.on, (stage, &model.skies), room, with)?);
            }
            Ok(())
        })?;
        let Some(stage) = &self.stage else { return Ok(Vec::new()) };
        let Some(forward) = &mut self.forward else { return Ok(Vec::new()) };
        let with = (&self.on, stage, &self.skies, self.poses.as_ref());
        Ok(shots.iter().map(|s| forward.run(&self.gpu, with, s)).collect::<Result<_, _>>()?)
    }

    fn values(&self, group: usize) -> Result<Cow<'_, [f32]>, ModelError> {
        Ok(self.read_group(group, false)?.into())
    }

    fn set(&mut self, group: usize, values: &[f32]) -> Result<(), ModelError> {
        Ok(self.write_group(group, values)?)
    }

    fn keep_best(&mut self) -> Result<(), ModelError> {
        Ok(self.keep.run()?)
    }

    fn go_to_best(&mut self, group: usize) -> Result<(), ModelError> {
        Ok(self.copy_group(group, true)?)
    }

    fn reset_optimizer(&mut self, group: usize) -> Result<(), FitError> {
        self.optimizers[group].reset().map_err(FitError::Preconditioner)
    }

    fn snapshot(&self, group: usize) -> Result<Snapshot<'_>, ModelError> {
        Ok(Snapshot {
            values: self.values(group)?,
            best: self.read_group(group, true)?.into(),
            optimizer: Cow::Owned(self.optimizers[group].state().map_err(model_error)?),
        })
    }

    fn restore(&mut self, group: usize, saved: Snapshot<'_>) -> Result<(), ModelError> {
        self.optimizers[group].restore(&saved.optimizer).map_err(model_error)?;
        // The best maps are kept with their levels: by way of the present ones.
        self.write_group(group, &saved.best)?;
        self.copy_group(group, false)?;
        Ok(self.write_group(group, &saved.values)?)
    }

    fn asset(&mut self) -> Result<&S, ModelError> {
        self.download()?;
        Ok(&self.asset)
    }

    fn into_asset(mut self) -> Result<S, ModelError> {
        self.download()?;
        Ok(self.asset)
    }
}

#[cfg(test)]
mod tests;
