//! Poses of a surface that moves: vertices at moments of its animation, each uploaded once, and put in place of those of the
//! shape before a picture is drawn. They come from the CPU: nothing of them has a gradient.

use crate::candidate::Vertices;
use crate::engine::views::Moment;
use photofit_gpu::{Buffer, CopySlot, Gpu, GpuError, Recorder, Recording};
use photofit_raster::gpu::MeshBuffers;

/// Bytes of device memory that poses may take, unless those of a step take more.
const BYTES_MAX: u64 = 1 << 28;

/// A pose on a device.
#[derive(Debug)]
struct Pose {
    moment: Moment,
    /// The last batch that showed it.
    batch: u64,
    positions: Buffer<[f32; 3]>,
    normals: Buffer<[f32; 3]>,
    tangents: Buffer<[f32; 4]>,
}

impl Pose {
    fn new(gpu: &Gpu, moment: Moment, vertices: usize) -> Result<Self, GpuError> {
        Ok(Self {
            moment,
            batch: 0,
            positions: gpu.store("posed positions", vertices)?,
            normals: gpu.store("posed normals", vertices)?,
            tangents: gpu.store("posed tangents", vertices)?,
        })
    }

    fn bytes(&self) -> u64 {
        self.positions.bytes() + self.normals.bytes() + self.tangents.bytes()
    }

    fn write(&self, gpu: &Gpu, v: &Vertices) -> Result<(), GpuError> {
        gpu.write(&self.positions, bytemuck::cast_slice(&v.positions))?;
        gpu.write(&self.normals, bytemuck::cast_slice(&v.normals))?;
        gpu.write(&self.tangents, bytemuck::cast_slice(&v.tangents))
    }
}

/// The poses on a device.
#[derive(Debug, Default)]
pub(super) struct Poses {
    held: Vec<Pose>,
    batch: u64,
}

impl Poses {
    /// Begins a batch of pictures at these moments, whose poses stay until the next one begins; gives those that are not
    /// there.
    pub(super) fn begin(&mut self, moments: impl Iterator<Item = Moment>) -> Vec<Moment> {
        self.batch += 1;
        let mut missing = Vec::new();
        for moment in moments {
            match self.held.iter_mut().find(|p| p.moment == moment) {
                Some(pose) => pose.batch = self.batch,
                None if missing.contains(&moment) => {}
                None => missing.push(moment),
            }
        }
        missing
    }

    /// Uploads the pose of a moment of the batch, where it is not there.
    pub(super) fn put(&mut self, gpu: &Gpu, moment: Moment, vertices: &Vertices) -> Result<(), GpuError> {
        if self.held.iter().any(|p| p.moment == moment) {
            return Ok(());
        }
        let at = self.place(gpu, moment, vertices.positions.len())?;
        let pose = &mut self.held[at];
        (pose.moment, pose.batch) = (moment, self.batch);
        pose.write(gpu, vertices)
    }

    /// A place for a pose: a new one, or that of the pose that was shown longest ago.
    fn place(&mut self, gpu: &Gpu, moment: Moment, vertices: usize) -> Result<usize, GpuError> {
        let taken: u64 = self.held.iter().map(Pose::bytes).sum();
        let oldest = (0..self.held.len()).filter(|i| self.held[*i].batch != self.batch);
        let oldest = oldest.min_by_key(|i| self.held[*i].batch);
        match (oldest, Pose::new(gpu, moment, vertices)) {
            (None, made) => self.held.push(made?),
            (Some(_), Ok(made)) if taken + made.bytes() <= BYTES_MAX => self.held.push(made),
            (Some(at), _) => return Ok(at),
        }
        Ok(self.held.len() - 1)
    }
}

/// How the vertices of a picture come from [`Poses`].
#[derive(Clone, Copy, Debug)]
pub(super) struct FromPose([CopySlot; 3]);

impl FromPose {
    /// Records that a pose is put in place of the shape.
    pub(super) fn record(r: &mut Recorder, mesh: &MeshBuffers) -> Result<Self, GpuError> {
        Ok(Self([r.copy_in(&mesh.positions)?, r.copy_in(&mesh.normals)?, r.copy_in(&mesh.tangents)?]))
    }

    /// Names the pose of a moment for the next run.
    pub(super) fn set(
        self,
        recording: &mut Recording,
        poses: &Poses,
        moment: Moment,
    ) -> Result<(), GpuError> {
        let p = poses.held.iter().find(|p| p.moment == moment).expect("poses are put before they are drawn");
        let [positions, normals, tangents] = self.0;
        recording.set_source(positions, &p.positions, 0..p.positions.len())?;
        recording.set_source(normals, &p.normals, 0..p.normals.len())?;
        recording.set_source(tangents, &p.tangents, 0..p.tangents.len())
    }
}
