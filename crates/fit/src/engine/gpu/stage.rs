//! Where pictures of a surface are drawn on a device: buffers for the largest one, and the parameters of each.

use super::bands::{Band, Bands};
use super::resident::Resident;
use super::skies::Skies;
use crate::candidate::view;
use crate::engine::views::Shot;
use photofit_gpu::{Gpu, GpuError, Recording};
use photofit_raster::deferred::gpu::{MapShading, ShadeSlots};
use photofit_raster::deferred::{Passes, View};
use photofit_raster::gpu::{self as device, FrameParams, GradientBuffers, PictureBuffers, Slots};
use photofit_raster::loss::gpu::LossBuffers;
use photofit_raster::texture::gpu::SUM_SCALE;

/// Samples and pixels of the largest picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Room {
    /// Columns and rows of pixels.
    pub(super) pixels: [usize; 2],
    /// Samples per axis of a pixel.
    pub(super) side: usize,
}

impl Room {
    /// What some pictures need.
    pub(super) fn of(shots: &[Shot]) -> Self {
        shots.iter().fold(Self::default(), |room, s| {
            let [w, h] = room.pixels;
            Self { pixels: [w.max(s.width), h.max(s.height)], side: room.side.max(s.sampling.per_axis) }
        })
    }

    /// Room for both.
    pub(super) fn and(self, other: Self) -> Self {
        let larger = |k: usize| self.pixels[k].max(other.pixels[k]);
        Self { pixels: [larger(0), larger(1)], side: self.side.max(other.side) }
    }

    pub(super) fn pixel_count(self) -> usize {
        self.pixels[0] * self.pixels[1]
    }
}

/// Buffers that all pictures of a fit share.
#[derive(Debug)]
pub(super) struct Stage {
    /// The largest picture, and the bands that it is drawn in.
    pub(super) room: Room,
    pub(super) bands: Bands,
    pub(super) picture: PictureBuffers,
    pub(super) gradients: GradientBuffers,
    pub(super) loss: LossBuffers,
}

impl Stage {
    pub(super) fn new(
        gpu: &Gpu,
        on: &Resident,
        (room, bands): (Room, Bands),
        passes: &Passes,
        pictures: usize,
    ) -> Result<Self, GpuError> {
        let pixels = bands.room(room).pixel_count();
        let samples = pixels * room.side * room.side;
        let layers = on.mesh.layers(passes);
        Ok(Self {
            room,
            bands,
            picture: PictureBuffers::new(gpu, &on.mesh, samples, pixels, layers, passes.antialias)?,
            gradients: GradientBuffers::new(gpu, &on.mesh, samples, pixels)?,
            loss: LossBuffers::new(gpu, pixels, false, pictures * bands.count())?,
        })
    }
}

impl Stage {
    /// Pictures of a step that have room for their losses.
    pub(super) fn places(&self) -> usize {
        self.loss.values.len() / self.bands.count()
    }
}

/// The kernels of one band of a picture in a recording.
#[derive(Debug)]
pub(super) struct Drawn {
    pub(super) slots: Vec<Slots>,
    pub(super) shading: ShadeSlots,
}

/// Parameters of the largest band.
pub(super) fn largest(on: &Resident, room: Room, passes: &Passes) -> FrameParams {
    let shot = device::Shot {
        view_projection: [[0.0; 4]; 4],
        width: room.pixels[0] * room.side,
        height: room.pixels[1] * room.side,
        samples: room.side,
        scale: SUM_SCALE,
    };
    let fits_alpha = on.mesh.fits_alpha(passes);
    FrameParams::new(&shot, on.mesh.vertices(), on.mesh.triangles(), passes, fits_alpha)
}

/// Sets the parameters of a band of a picture for the next run; `scale` is that of the sums of
/// texels. Those of vertices keep theirs: their terms, next to slivers, do not shrink with the picture.
pub(super) fn aim(
    recording: &mut Recording,
    drawn: &Drawn,
    shading: &MapShading,
    (on, skies): (&Resident, &Skies),
    (shot, band, scale): (&Shot, &Band, f32),
    passes: &Passes,
) {
    let lights = shot.lights.lights();
    let whole = view(shot, &lights);
    let view = View {
        view_projection: band.projection(whole.view_projection),
        height: band.rows() * whole.samples,
        ..whole
    };
    let of = device::Shot {
        view_projection: view.view_projection,
        width: view.width,
        height: view.height,
        samples: view.samples,
        scale: SUM_SCALE,
    };
    let fits_alpha = on.mesh.fits_alpha(passes);
    let params = FrameParams {
        backs: u32::from(shot.backs),
        ..FrameParams::new(&of, on.mesh.vertices(), on.mesh.triangles(), passes, fits_alpha)
    };
    drawn.slots.iter().for_each(|slots| slots.set(recording, &params));
    let params = shading.params(&view, passes, [SUM_SCALE, scale], |map| skies.number(map));
    drawn.shading.set(recording, &params);
}

/// A background as the device takes it.
pub(super) fn padded(background: &[[f32; 3]]) -> Vec<[f32; 4]> {
    background.iter().map(|b| [b[0], b[1], b[2], 0.0]).collect()
}
