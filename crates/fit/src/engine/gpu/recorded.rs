//! The two lists of commands of a fit: a whole step, and a picture.

use super::bands::Bands;
use super::poses::{FromPose, Poses};
use super::references::{FromHeld, References};
use super::resident::{ADD_LOSSES, Resident};
use super::skies::Skies;
use super::stage::{Drawn, Room, Stage, aim, largest, padded};
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
use photofit_raster::gpu::{render, render_vjp};
use photofit_raster::loss::Loss;
use photofit_raster::loss::gpu::{RecordedLoss, Term, value_and_gradient};
use photofit_raster::texture::gpu::{SUM_SCALE, sum_scale};

/// Losses that are kept on the device until they are read.
pub(super) const COURSE: usize = 1024;

/// One band of a picture of a step.
#[derive(Debug)]
struct RecordedBand {
    drawn: Drawn,
    loss: RecordedLoss,
    weights: Option<RelativeWeights>,
    from: FromHeld,
    /// Of the first band of a picture, where pictures have poses.
    pose: Option<FromPose>,
}

/// A step: all pictures of a batch one after the other, each band by band, forward and in reverse, and the moves.
#[derive(Debug)]
pub(super) struct Step {
    recording: Recording,
    /// What it was recorded for: the room of each picture, the largest first.
    pub(super) rooms: Vec<Room>,
    pub(super) moving: Vec<bool>,
    bands: Bands,
    loss: PictureLoss,
    passes: Passes,
    shading: MapShading,
    places: Vec<RecordedBand>,
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
    /// Records a step for a picture in each of these rooms.
    pub(super) fn new(
        gpu: &Gpu,
        on: &Resident,
        (stage, skies, course): (&Stage, &Skies, &Buffer<f32>),
        (rooms, compare): (Vec<Room>, PictureLoss),
        (groups, optimizers): (&[Group], &[DeviceOptimizer]),
        (moving, passes, posed): (&[bool], &Passes, bool),
    ) -> Result<Self, OptimError> {
        let mut r = gpu.record("step");
        let g = &stage.gradients;
        let triangles = on.mesh.triangles();
        let mut shading = MapShading::new(gpu, on.maps.clone(), skies.tables.clone(), triangles, passes)?;
        let bands = stage.bands;
        on.record_clear(&mut r, g);
        if !posed {
            on.record_vertices(&mut r)?;
        }
        let (term, pixels) = (term(compare.loss, rooms.len()), bands.room(stage.room).pixel_count());
        let mut shared = stage.loss.clone().serving(gpu, compare.loss, pixels)?;
        let relative = compare.weights == Weights::Relative;
        if relative {
            shared.weights = gpu.zeros("weights", pixels)?;
        }
        let rows = gpu.zeros("mean light along rows", if relative { pixels } else { 0 })?;
        let mut places = Vec::new();
        let picture = &stage.picture;
        for place in 0..rooms.len() * bands.count() {
            let first = place % bands.count() == 0;
            let band = bands.room(rooms[place / bands.count()]);
            let (params, pixels) = (largest(on, band, passes), band.pixel_count());
            let pose = (posed && first).then(|| FromPose::record(&mut r, &on.mesh)).transpose()?;
            let from = FromHeld::record(&mut r, &shared.reference, &picture.background, pixels)?;
            let weights =
                relative.then(|| RelativeWeights::record(&mut r, &shared.reference, &rows, &shared.weights));
            let weights = weights.transpose()?;
            let forward = render(&mut r, &on.mesh, picture, passes, &params, &mut shading)?;
            let loss = value_and_gradient(&mut r, &term, pixels, &picture.color, &shared, &g.color, place)?;
            let reverse = render_vjp(&mut r, &on.mesh, picture, passes, &params, &mut shading, g)?;
            let drawn = Drawn { slots: vec![forward, reverse], shading: shading.take_slots() };
            places.push(RecordedBand { drawn, loss, weights, from, pose });
        }
        let buffers = [stage.loss.values.bind(), course.bind()];
        let losses = r.dispatch(&ADD_LOSSES, &[places.len() as u32, 0, 0, 0], &buffers, 1)?;
        let collected = on.record_vjp(&mut r, g, passes)?;
        let mut recorded = Vec::new();
        let with_positions = groups.iter().filter(|g| g.name == POSITIONS).count();
        for (k, ((group, optimizer), moves)) in groups.iter().zip(optimizers).zip(moving).enumerate() {
            if !*moves {
                recorded.push(None);
                continue;
            }
            let (columns, ranges, unit) = (group.columns, &group.ranges, group.unit);
            if group.name == POSITIONS {
                if let Some(normals) = on.record_guide(&mut r)? {
                    optimizer.record_guide(&mut r, normals)?;
                }
                recorded.push(Some(optimizer.record(&mut r, &on.welded, &on.d_welded, 0)?));
                constrain(&mut r, &on.welded, (0..group.rows, columns), ranges, unit)?;
                on.record_locked(&mut r)?;
            } else {
                let rows = on.texels_of(k - with_positions);
                let (texels, first) = (&on.maps.texels, rows.start * columns);
                recorded.push(Some(optimizer.record(&mut r, texels, &on.maps.gradient, first)?));
                constrain(&mut r, texels, (rows, columns), ranges, unit)?;
            }
        }
        if passes.map_gradients {
            on.maps.record_rebuild(&mut r)?;
        }
        let (moving, passes) = (moving.to_vec(), *passes);
        let recording = r.finish()?;
        let (loss, optimizers) = (compare, recorded);
        Ok(Self {
            recording,
            rooms,
            bands,
            moving,
            loss,
            passes,
            shading,
            places,
            optimizers,
            losses,
            collected,
        })
    }

    /// Whether it serves a batch: the same number of pictures that are compared alike and move the same groups, with masks
    /// that are cut or that fade, each at most as large and all together not much smaller.
    pub(super) fn serves(
        &self,
        rooms: &[Room],
        loss: PictureLoss,
        (moving, masks): (&[bool], Masks),
    ) -> bool {
        self.rooms_and(rooms).is_some_and(|both| both == self.rooms)
            && self.loss == loss
            && self.moving == moving
            && (self.passes.masks == Masks::Cut) == (masks == Masks::Cut)
    }

    /// The rooms for these pictures as well; none where their number is another or they would be half empty.
    pub(super) fn rooms_and(&self, rooms: &[Room]) -> Option<Vec<Room>> {
        let both: Vec<Room> = self.rooms.iter().zip(rooms).map(|(a, b)| a.and(*b)).collect();
        let pixels = |rooms: &[Room]| rooms.iter().map(|r| r.pixel_count()).sum::<usize>();
        (rooms.len() == self.rooms.len() && 2 * pixels(rooms) > pixels(&both)).then_some(both)
    }

    /// Submits a step of these pictures, the largest first; its loss goes to place `at` of the course.
    pub(super) fn run(
        &mut self,
        gpu: &Gpu,
        (on, skies, references, poses): (&Resident, &Skies, &mut References, Option<&Poses>),
        (shots, masks): (&[&Shot], Masks),
        (optimizers, rates): (&mut [DeviceOptimizer], &[Vec<f32>]),
        at: usize,
    ) -> Result<(), OptimError> {
        self.passes.masks = masks;
        let term = term(self.loss.loss, shots.len());
        // Of this batch alone: a fit that goes on has the same sums.
        let samples = |s: &&Shot| s.width * s.height * s.sampling.per_axis.pow(2);
        let scale = sum_scale(shots.iter().map(samples).sum());
        if let Some(slot) = self.collected {
            self.recording.set(slot, &on.maps.collected(scale));
        }
        references.begin();
        let bands = self.bands;
        let all = shots.iter().flat_map(|shot| bands.of(shot.height).map(move |band| (shot, band)));
        for (place, (shot, band)) in self.places.iter().zip(all) {
            let recording = &mut self.recording;
            if let (Some(pose), Some(poses)) = (place.pose, poses) {
                pose.set(recording, poses, shot.moment)?;
            }
            place.from.set(gpu, recording, references, shot, band.pixels(shot.width))?;
            let part = band.part(shot.width);
            place.loss.set(recording, &term, &part);
            if let Some(weights) = &place.weights {
                weights.set(recording, part.size);
            }
            aim(recording, &place.drawn, &self.shading, (on, skies), (shot, &band, scale), &self.passes);
        }
        for ((optimizer, rates), recorded) in optimizers.iter_mut().zip(rates).zip(&self.optimizers) {
            if let Some(recorded) = recorded {
                optimizer.prepare(&mut self.recording, recorded, rates)?;
            }
        }
        self.recording.set(self.losses, &[self.places.len() as u32, at as u32, 0, 0]);
        Ok(self.recording.run()?)
    }
}

impl Step {
    /// Makes the step of the last run once more, and tells the work of its kernels.
    pub(super) fn report(&mut self) -> Result<Vec<KernelReport>, GpuError> {
        self.recording.report()
    }
}

/// A band of a picture without gradients.
#[derive(Debug)]
pub(super) struct Forward {
    recording: Recording,
    bands: Bands,
    room: Room,
    passes: Passes,
    shading: MapShading,
    drawn: Drawn,
    pose: Option<FromPose>,
}

impl Forward {
    pub(super) fn new(
        gpu: &Gpu,
        on: &Resident,
        (stage, skies): (&Stage, &Skies),
        room: Room,
        (passes, posed): (&Passes, bool),
    ) -> Result<Self, GpuError> {
        let mut r = gpu.record("forward");
        let triangles = on.mesh.triangles();
        let mut shading = MapShading::new(gpu, on.maps.clone(), skies.tables.clone(), triangles, passes)?;
        let pose = posed.then(|| FromPose::record(&mut r, &on.mesh)).transpose()?;
        if !posed {
            on.record_vertices(&mut r)?;
        }
        let bands = stage.bands;
        let params = largest(on, bands.room(room), passes);
        let forward = render(&mut r, &on.mesh, &stage.picture, passes, &params, &mut shading)?;
        let drawn = Drawn { slots: vec![forward], shading: shading.take_slots() };
        Ok(Self { recording: r.finish()?, bands, room, passes: *passes, shading, drawn, pose })
    }

    /// Whether pictures of some size can be drawn.
    pub(super) fn serves(&self, room: Room) -> bool {
        self.room.and(room) == self.room
    }

    /// Draws a picture, band by band.
    pub(super) fn run(
        &mut self,
        gpu: &Gpu,
        (on, stage, skies, poses): (&Resident, &Stage, &Skies, Option<&Poses>),
        shot: &Shot,
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        let (background, mut picture) = (padded(&shot.background()), Vec::new());
        if let (Some(pose), Some(poses)) = (self.pose, poses) {
            pose.set(&mut self.recording, poses, shot.moment)?;
        }
        for band in self.bands.of(shot.height) {
            gpu.write(&stage.picture.background, &background[band.pixels(shot.width)])?;
            let (recording, of) = (&mut self.recording, (shot, &band, SUM_SCALE));
            aim(recording, &self.drawn, &self.shading, (on, skies), of, &self.passes);
            recording.run()?;
            let color = gpu.read(&stage.picture.color)?;
            let inside = band.inside();
            picture.extend_from_slice(&color[inside.start * shot.width..inside.end * shot.width]);
        }
        Ok(picture)
    }
}
