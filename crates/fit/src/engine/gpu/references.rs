//! Pictures of the reference that stay on a device: a fit shows each of them several times, before other noise. Where
//! there is no room for all, those that were shown last stay.

use crate::engine::pool::window;
use crate::engine::trainer::Job;
use crate::engine::views::{BACKGROUND_MAX, Shot};
use photofit_gpu::{Buffer, CopySlot, Gpu, GpuError, INDEX, Kernel, Recorder, Recording};
use photofit_image::Image;
use photofit_sampling::Rng;
use std::fmt;
use std::ops::Range;
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
    first: u32,
    pad: u32,
}

impl Params {
    fn new(noise: &Rng, pixels: &Range<usize>) -> Self {
        let words = |key: u64| [key as u32, (key >> 32) as u32];
        let [first, second] = noise.keys().map(words);
        Self {
            keys: [first[0], first[1], second[0], second[1]],
            pixels: pixels.len() as u32,
            most: BACKGROUND_MAX,
            first: pixels.start as u32,
            pad: 0,
        }
    }
}

/// How many pictures a fit shows again, and how large they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// Pictures.
    pub pictures: usize,
    /// Pictures of a step.
    pub batch: usize,
    /// Columns and rows of the largest one.
    pub size: [usize; 2],
}

impl Shown {
    /// Those of a fit: its pictures are as large as those that it is judged by.
    pub(crate) fn by(job: &Job<'_>) -> Self {
        let largest = |[w, h]: [usize; 2], s: &Shot| [w.max(s.width), h.max(s.height)];
        let size = job.held_out.shots().iter().fold([0; 2], largest);
        // Where all pictures of a step are new none is shown again.
        let (batch, fresh) = (job.batch.pictures(), job.batch.fresh());
        let pictures = if fresh < batch { window(batch as u64, fresh as u64) as usize } else { batch };
        Self { pictures, batch, size }
    }

    fn pixels(self) -> usize {
        self.size[0] * self.size[1]
    }

    fn bytes(self, pictures: usize) -> u64 {
        (pictures as u64).saturating_mul((self.pixels() * size_of::<[f32; 4]>()) as u64)
    }
}

/// How many pictures stay on a device, and why not all.
#[derive(Clone, Debug, PartialEq)]
pub struct Residence {
    /// What the fit shows again.
    pub shown: Shown,
    /// Those that stay: the ones that were shown last.
    pub places: usize,
    /// What the device says to more; `None` where all stay or more would take too many bytes.
    pub refused: Option<GpuError>,
}

impl fmt::Display for Residence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { shown, places, refused } = self;
        let mb = |pictures| shown.bytes(pictures) as f64 * 1e-6;
        let [width, height] = shown.size;
        let all = *places >= shown.pictures;
        let of = if all { String::new() } else { format!("{places} of ") };
        write!(
            f,
            "{of}{} pictures of the reference of {width} x {height} pixels stay there, ",
            shown.pictures
        )?;
        write!(f, "{:.1} MB", mb(*places))?;
        match refused {
            _ if all => Ok(()),
            Some(e) => write!(f, "; the others are uploaded when they are shown: {e}"),
            None => write!(
                f,
                "; the others are uploaded when they are shown: all take {:.0} MB, more than the {:.0} MB for them; \
                 smaller pictures (`resolution`) would stay",
                mb(shown.pictures),
                BYTES_MAX as f64 * 1e-6
            ),
        }
    }
}

/// A picture on a device.
#[derive(Debug)]
pub(super) struct Held {
    /// Which one; a picture that the fit has dropped leaves its place to another.
    picture: Weak<Image>,
    /// The last batch that showed it.
    batch: u64,
    texels: Buffer<[f32; 4]>,
}

/// The pictures on a device.
#[derive(Debug, Default)]
pub(super) struct References {
    pub(super) held: Vec<Held>,
    /// Pixels of each place.
    pub(super) pixels: usize,
    /// Batches so far.
    batch: u64,
}

impl References {
    /// Room for what a fit shows again, as far as bytes go; at least for a step.
    ///
    /// # Errors
    /// If the device has no room for the pictures of a step.
    pub(super) fn new(gpu: &Gpu, shown: Shown) -> Result<(Self, Residence), GpuError> {
        let mut out = Self::default();
        out.make_room(gpu, shown.batch, shown.pixels())?;
        let most = (BYTES_MAX / shown.bytes(1).max(1)) as usize;
        let places = shown.pictures.min(most.max(shown.batch));
        let refused = out.make_room(gpu, places, shown.pixels()).err();
        let places = out.held.len();
        Ok((out, Residence { shown, places, refused }))
    }

    /// Makes room for so many pictures of at most so many pixels, where it is not there.
    pub(super) fn make_room(&mut self, gpu: &Gpu, places: usize, pixels: usize) -> Result<(), GpuError> {
        if pixels > self.pixels {
            (self.held, self.pixels) = (Vec::new(), pixels);
        }
        while self.held.len() < places {
            let texels = gpu.store("picture of the reference", self.pixels)?;
            self.held.push(Held { picture: Weak::new(), batch: 0, texels });
        }
        Ok(())
    }

    /// Gives back what is beyond the room for so many pictures; whether there was any.
    pub(super) fn give_back(&mut self, places: usize) -> bool {
        let more = self.held.len() > places;
        self.held.truncate(places);
        more
    }

    /// Begins a batch: what it shows stays until the next one begins.
    pub(super) fn begin(&mut self) {
        self.batch += 1;
    }

    /// The picture of a shot, uploaded where it is not there yet.
    fn texels(&mut self, gpu: &Gpu, shot: &Shot) -> Result<&Buffer<[f32; 4]>, GpuError> {
        let is = |h: &Held| std::ptr::eq(h.picture.as_ptr(), &raw const *shot.shown);
        let at = match self.held.iter().position(is) {
            Some(at) => at,
            None => {
                let free = self.held.iter().enumerate().filter(|(_, h)| h.batch != self.batch);
                let oldest = free.min_by_key(|(_, h)| (h.picture.strong_count() > 0, h.batch));
                let (at, h) = oldest.expect("no more pictures in a batch than places");
                gpu.write(&h.texels, bytemuck::cast_slice(&shot.shown.data))?;
                self.held[at].picture = std::sync::Arc::downgrade(&shot.shown);
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
    picture: CopySlot,
    noise: photofit_gpu::Slot,
}

impl FromHeld {
    /// Records that a picture of at most so many pixels is put over its noise: what [`Shot::over_noise`] does on the CPU.
    pub(super) fn record(
        r: &mut Recorder,
        reference: &Buffer<[f32; 4]>,
        background: &Buffer<[f32; 4]>,
        pixels: usize,
    ) -> Result<Self, GpuError> {
        let picture = r.copy_in(reference)?;
        let params = Params::new(&Rng::new(0, 0), &(0..pixels));
        let noise = r.dispatch(&OVER_NOISE, &params, &[reference.bind(), background.bind()], pixels)?;
        Ok(Self { picture, noise })
    }

    /// Names these pixels of the picture of a shot for the next run.
    pub(super) fn set(
        &self,
        gpu: &Gpu,
        recording: &mut Recording,
        references: &mut References,
        shot: &Shot,
        pixels: Range<usize>,
    ) -> Result<(), GpuError> {
        recording.set(self.noise, &Params::new(&shot.noise, &pixels));
        recording.set_source(self.picture, references.texels(gpu, shot)?, pixels)
    }
}
