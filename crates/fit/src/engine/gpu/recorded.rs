//! The two lists of commands of a fit: a whole step, and a picture.

use super::references::{FromHeld, References};
use super::resident::{ADD_LOSSES, Resident};
use super::stage::{Drawn, Room, Skies, Stage, aim, largest, padded};
use super::weights::RelativeWeights;
use crate::engine::loss::{PictureLoss, Weights};
use crate::engine::model::Group;
use crate::engine::surface::POSITIONS;
use crate::engine::views::Shot;
use photofit_gpu::{Buffer, Gpu, GpuError, KernelReport, Recording, Slot};
use photofit_optim::OptimError;
use photofit_optim::gpu::{DeviceOptimizer, Recorded, constrain};
use photofit_raster::deferred::gpu::MapShading;
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::gpu::{PictureBuffers, render, render_vjp};
use photofit_raster::loss::Loss;
use photofit_raster::loss::gpu::{RecordedLoss, Term, value_and_gradient};
use photofit_raster::texture::gpu::{SUM_SCALE, sum_scale};

/// Losses that are kept on the device until they are read.
pub(super) const COURSE: usize = 1024;

/// One picture of a step.
#[derive(Debug)]
struct Place {
    drawn: Drawn,
    loss: RecordedLoss,
    weights: Option<RelativeWeights>,
    from: FromHeld,
}

/// A step: all pictures of a batch, forward and in reverse, and the moves.
#[derive(Debug)]
pub(super) struct Step {
    recording: Recording,
    /// What it was recorded for.
    pub(super) room: Room,
    pub(super) moving: Vec<bool>,
    loss: PictureLoss,
    passes: Passes,
    shading: MapShading,
    places: Vec<Place>,
    optimizers: Vec<Option<Recorded>>,
    losses: Slot,
    /// Takes the scale of the sums of texels.
    collected: Option<Slot>,
}

/// How a batch is compared: its mean loss over the colours.
fn term(loss: Loss, pictures: usize) -> Term {
    Term { loss, read: 0..3, factor: 1.0 / pictures.max(1) as f64, accumulates: false }
}

impl Step {
    /// Records a step for batches of so many pictures.
    pub(super) fn new(
        gpu: &Gpu,
        on: &Resident,
        (stage, skies, course): (&Stage, &Skies, &Buffer<f32>),
        (room, pictures, compare): (Room, usize, PictureLoss),
        (groups, optimizers): (&[Group], &[DeviceOptimizer]),
        (moving, passes): (&[bool], &Passes),
    ) -> Result<Self, OptimError> {
        let mut r = gpu.record("step");
        let g = &stage.gradients;
        let triangles = on.mesh.triangles();
        let mut shading = MapShading::new(gpu, on.maps.clone(), skies.tables.clone(), triangles, passes)?;
        let params = largest(on, room, passes);
        on.record_clear(&mut r, g);
        on.record_vertices(&mut r)?;
        let (term, pixels) = (term(compare.loss, pictures), room.pixel_count());
        let mut shared = stage.loss.clone().serving(gpu, compare.loss, pixels)?;
        let relative = compare.weights == Weights::Relative;
        if relative {
            shared.weights = gpu.zeros("weights", pixels)?;
        }
        let rows = gpu.zeros("mean light along rows", if relative { pixels } else { 0 })?;
        let mut places = Vec::new();
        for place in 0..pictures {
            let background = gpu.zeros("background", room.pixel_count())?;
            let reference = gpu.zeros("reference", room.pixel_count())?;
            let from = FromHeld::record(&mut r, &reference, &background)?;
            let picture = PictureBuffers { background, ..stage.picture.clone() };
            let mut compared = shared.clone();
            compared.reference = reference;
            let weights = relative
                .then(|| RelativeWeights::record(&mut r, &compared.reference, &rows, &compared.weights));
            let weights = weights.transpose()?;
            let forward = render(&mut r, &on.mesh, &picture, passes, &params, &mut shading)?;
            let loss = value_and_gradient(&mut r, &term, pixels, &picture.color, &compared, &g.color, place)?;
            let reverse = render_vjp(&mut r, &on.mesh, &picture, passes, &params, &mut shading, g)?;
            let drawn = Drawn { slots: vec![forward, reverse], shading: shading.take_slots() };
            places.push(Place { drawn, loss, weights, from });
        }
        let buffers = [stage.loss.values.bind(), course.bind()];
        let losses = r.dispatch(&ADD_LOSSES, &[pictures as u32, 0, 0, 0], &buffers, 1)?;
        let collected = on.record_vjp(&mut r, g, passes)?;
        let mut recorded = Vec::new();
        for ((group, optimizer), moves) in groups.iter().zip(optimizers).zip(moving) {
            if !*moves {
                recorded.push(None);
                continue;
            }
            let (shape, ranges, unit) = ((group.rows, group.columns), &group.ranges, group.unit);
            if group.name == POSITIONS {
                recorded.push(Some(optimizer.record(&mut r, &on.welded, &on.d_welded)?));
                constrain(&mut r, &on.welded, shape, ranges, unit)?;
            } else {
                recorded.push(Some(optimizer.record(&mut r, &on.maps.texels, &on.maps.gradient)?));
                constrain(&mut r, &on.maps.texels, shape, ranges, unit)?;
                on.maps.record_rebuild(&mut r)?;
            }
        }
        let (moving, passes) = (moving.to_vec(), *passes);
        let recording = r.finish()?;
        let (loss, optimizers) = (compare, recorded);
        Ok(Self { recording, room, moving, loss, passes, shading, places, optimizers, losses, collected })
    }

    /// Whether it serves a batch: the same number of pictures that are compared alike and move the same groups, with masks
    /// that are cut or that fade, at most as large and not much smaller.
    pub(super) fn serves(
        &self,
        room: Room,
        (pictures, loss): (usize, PictureLoss),
        (moving, masks): (&[bool], Masks),
    ) -> bool {
        self.room.and(room) == self.room
            && self.loss == loss
            && 2 * room.pixel_count() > self.room.pixel_count()
            && self.places.len() == pictures
            && self.moving == moving
            && (self.passes.masks == Masks::Cut) == (masks == Masks::Cut)
    }

    /// Submits a step; its loss goes to place `at` of the course.
    pub(super) fn run(
        &mut self,
        gpu: &Gpu,
        (on, skies, references): (&Resident, &Skies, &mut References),
        (shots, masks): (&[Shot], Masks),
        (optimizers, rates): (&mut [DeviceOptimizer], &[Vec<f32>]),
        at: usize,
    ) -> Result<(), OptimError> {
        self.passes.masks = masks;
        let term = term(self.loss.loss, shots.len());
        // Of this batch alone: a fit that goes on has the same sums.
        let samples = |s: &Shot| s.width * s.height * s.sampling.per_axis.pow(2);
        let scale = sum_scale(shots.iter().map(samples).sum());
        if let Some(slot) = self.collected {
            self.recording.set(slot, &on.maps.collected(scale));
        }
        references.begin();
        for (place, shot) in self.places.iter().zip(shots) {
            place.from.set(gpu, &mut self.recording, references, shot)?;
            let size = [shot.width, shot.height];
            place.loss.set(&mut self.recording, &term, size);
            if let Some(weights) = &place.weights {
                weights.set(&mut self.recording, size);
            }
            aim(&mut self.recording, &place.drawn, &self.shading, (on, skies), (shot, scale), &self.passes);
        }
        for ((optimizer, rates), recorded) in optimizers.iter_mut().zip(rates).zip(&self.optimizers) {
            if let Some(recorded) = recorded {
                optimizer.prepare(&mut self.recording, recorded, rates)?;
            }
        }
        self.recording.set(self.losses, &[shots.len() as u32, at as u32, 0, 0]);
        Ok(self.recording.run()?)
    }
}

impl Step {
    /// Makes the step of the last run once more, and tells the work of its kernels.
    pub(super) fn report(&mut self) -> Result<Vec<KernelReport>, GpuError> {
        self.recording.report()
    }
}

/// A picture without gradients.
#[derive(Debug)]
pub(super) struct Forward {
    recording: Recording,
    room: Room,
    passes: Passes,
    shading: MapShading,
    drawn: Drawn,
}

impl Forward {
    pub(super) fn new(
        gpu: &Gpu,
        on: &Resident,
        (stage, skies): (&Stage, &Skies),
        room: Room,
        passes: &Passes,
    ) -> Result<Self, GpuError> {
        let mut r = gpu.record("forward");
        let triangles = on.mesh.triangles();
        let mut shading = MapShading::new(gpu, on.maps.clone(), skies.tables.clone(), triangles, passes)?;
        on.record_vertices(&mut r)?;
        let params = largest(on, room, passes);
        let forward = render(&mut r, &on.mesh, &stage.picture, passes, &params, &mut shading)?;
        let drawn = Drawn { slots: vec![forward], shading: shading.take_slots() };
        Ok(Self { recording: r.finish()?, room, passes: *passes, shading, drawn })
    }

    /// Whether pictures of some size can be drawn.
    pub(super) fn serves(&self, room: Room) -> bool {
        self.room.and(room) == self.room
    }

    /// Draws a picture.
    pub(super) fn run(
        &mut self,
        gpu: &Gpu,
        (on, stage, skies): (&Resident, &Stage, &Skies),
        shot: &Shot,
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        gpu.write(&stage.picture.background, &padded(&shot.background()))?;
        aim(&mut self.recording, &self.drawn, &self.shading, (on, skies), (shot, SUM_SCALE), &self.passes);
        self.recording.run()?;
        let mut color = gpu.read(&stage.picture.color)?;
        color.truncate(shot.width * shot.height);
        Ok(color)
    }
}
