//! Pictures of the reference that stay on a device: a fit shows each of them several times, before other noise.

use crate::engine::pool::window;
use crate::engine::trainer::Job;
use crate::engine::views::{BACKGROUND_MAX, Shot, Source};
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Inlet, Kernel, Recorder, Recording};
use photofit_image::Image;
use std::fmt;
use std::sync::Weak;

/// Puts a picture over noise.
pub(super) const OVER_NOISE: Kernel = Kernel {
    name: "fit.over_noise",
    source: &[INDEX, photofit_sampling::WGSL, include_str!("over_noise.wgsl")],
    entry: "over_noise",
};

/// Bytes of device memory that pictures may take. A device does not tell how much it has.
const BYTES_MAX: u64 = 1 << 30;

/// As `over_noise.wgsl` has it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    keys: [u32; 4],
    pixels: u32,
    most: f32,
    pad: [u32; 2],
}

impl Params {
    fn new(source: Option<&Source>, pixels: usize) -> Self {
        let words = |key: u64| [key as u32, (key >> 32) as u32];
        let [first, second] = source.map_or([0; 2], |s| s.noise.keys()).map(words);
        Self {
            keys: [first[0], first[1], second[0], second[1]],
            pixels: pixels as u32,
            most: BACKGROUND_MAX,
            pad: [0; 2],
        }
    }
}

/// How many pictures a fit shows again, and how large they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// Pictures.
    pub pictures: usize,
    /// Columns and rows of the largest one.
    pub size: [usize; 2],
}

impl Shown {
    /// Those of a fit: its pictures are as large as those that it is judged by.
    pub(crate) fn by(job: &Job<'_>) -> Self {
        let largest = |[w, h]: [usize; 2], s: &Shot| [w.max(s.width), h.max(s.height)];
        let size = job.held_out.shots().iter().fold([0; 2], largest);
        // Where all pictures of a step are new none is shown again.
        let again = job.fresh < job.batch;
        let pictures = if again { window(job.batch as u64, job.fresh as u64) as usize } else { job.batch };
        Self { pictures, size }
    }

    fn pixels(self) -> usize {
        self.size[0] * self.size[1]
    }

    fn bytes(self) -> u64 {
        (self.pictures as u64).saturating_mul((self.pixels() * size_of::<[f32; 4]>()) as u64)
    }
}

/// Whether pictures stay on a device, and why not.
#[derive(Clone, Debug, PartialEq)]
pub enum Residence {
    /// They do.
    Kept(Shown),
    /// They take more bytes than pictures may.
    TooMany(Shown),
    /// The device cannot hold them.
    Refused(GpuError),
}

impl fmt::Display for Residence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mb = |bytes: u64| bytes as f64 * 1e-6;
        let uploaded = "the reference is uploaded in every step";
        match self {
            Self::Kept(s) => write!(
                f,
                "{} pictures of the reference of {} x {} pixels stay there, {:.1} MB",
                s.pictures,
                s.size[0],
                s.size[1],
                mb(s.bytes())
            ),
            Self::TooMany(s) => write!(
                f,
                "{uploaded}: {} pictures of {} x {} pixels take {:.0} MB, more than the {:.0} MB for them; smaller \
                 pictures (`resolution`) would stay",
                s.pictures,
                s.size[0],
                s.size[1],
                mb(s.bytes()),
                mb(BYTES_MAX)
            ),
            Self::Refused(e) => write!(f, "{uploaded}: {e}"),
        }
    }
}

/// A picture on a device.
#[derive(Debug)]
struct Held {
    /// Which one; a picture that the fit has dropped leaves its place to another.
    picture: Weak<Image>,
    /// The last batch that showed it.
    batch: u64,
    texels: Buffer<[f32; 4]>,
}

/// The pictures on a device.
#[derive(Debug, Default)]
pub(super) struct References {
    held: Vec<Held>,
    /// Pixels of each place.
    pixels: usize,
    /// Batches so far.
    batch: u64,
}

impl References {
    /// Room for what a fit shows again, all at once: a fit that goes on decides alike.
    pub(super) fn new(gpu: &Gpu, shown: Shown) -> (Self, Residence) {
        if shown.bytes() > BYTES_MAX {
            return (Self::default(), Residence::TooMany(shown));
        }
        let held = |_| {
            let texels = gpu.zeros("picture of the reference", shown.pixels())?;
            Ok(Held { picture: Weak::new(), batch: 0, texels })
        };
        match (0..shown.pictures).map(held).collect() {
            Ok(held) => (Self { held, pixels: shown.pixels(), batch: 0 }, Residence::Kept(shown)),
            Err(e) => (Self::default(), Residence::Refused(e)),
        }
    }

    /// Whether a batch of pictures of at most so many pixels is shown from here.
    pub(super) fn serves(&self, shots: &[Shot], pixels: usize) -> bool {
        shots.len() <= self.held.len() && pixels <= self.pixels && shots.iter().all(|s| s.source.is_some())
    }

    /// Begins a batch: what it shows stays until the next one begins.
    pub(super) fn begin(&mut self) {
        self.batch += 1;
    }

    /// The picture of a source, uploaded where it is not there yet.
    fn texels(&mut self, gpu: &Gpu, source: &Source) -> Result<&Buffer<[f32; 4]>, GpuError> {
        let is = |h: &Held| std::ptr::eq(h.picture.as_ptr(), &raw const *source.picture);
        let at = match self.held.iter().position(is) {
            Some(at) => at,
            None => {
                let free = self.held.iter().enumerate().filter(|(_, h)| h.batch != self.batch);
                let oldest = free.min_by_key(|(_, h)| (h.picture.strong_count() > 0, h.batch));
                let (at, h) = oldest.expect("no more pictures in a batch than places");
                gpu.write(&h.texels, bytemuck::cast_slice(&source.picture.data))?;
                self.held[at].picture = std::sync::Arc::downgrade(&source.picture);
                at
            }
        };
        self.held[at].batch = self.batch;
        Ok(&self.held[at].texels)
    }
}

/// How a picture of a batch comes from [`References`].
#[derive(Debug)]
pub(super) struct FromHeld {
    picture: Inlet,
    noise: photofit_gpu::Slot,
}

impl FromHeld {
    /// Records that a picture is put over its noise: what [`Shot::new`] does on the CPU.
    pub(super) fn record(
        r: &mut Recorder,
        reference: &Buffer<[f32; 4]>,
        background: &Buffer<[f32; 4]>,
    ) -> Result<Self, GpuError> {
        let picture = r.copy_in(reference)?;
        let params = Params::new(None, reference.len());
        let noise =
            r.dispatch(&OVER_NOISE, &params, &[reference.bind(), background.bind()], reference.len())?;
        Ok(Self { picture, noise })
    }

    /// Names the picture of a shot for the next run.
    pub(super) fn set(
        &self,
        gpu: &Gpu,
        recording: &mut Recording,
        references: &mut References,
        shot: &Shot,
    ) -> Result<(), GpuError> {
        let source = shot.source.as_ref().expect("a batch that is served from here has sources");
        recording.set(self.noise, &Params::new(Some(source), shot.width * shot.height));
        recording.set_source(self.picture, references.texels(gpu, source)?)
    }
}
