//! Maps of 16 channels on a device: mip chains, lookups, and their adjoints.
//!
//! The levels lie one after the other in one buffer ([`MipLayout`]), a texel in four vectors. Chains and their adjoints
//! ([`MipBuffers`]) are kernels of their own; lookups ([`LOOKUP`]) and texel gradients ([`SCATTER`]) are WGSL functions for
//! the kernels of a renderer. Texel gradients are fixed-point sums, the same for any order of their terms, until
//! [`MipBuffers::record_collect`] adds them to the gradients.

pub use crate::stored::gpu::{STORED, StoredTextures, sampler_bits};
use crate::{Level, MipAdjoint, MipLayout, MipRule, MipSizes, Pyramid, Texture, mip_levels};
use photofit_gpu::{Buffer, FIXED_READ, Gpu, GpuError, INDEX, Kernel, Recorder, Slot, fixed_words};

/// Channels of a texel.
pub const CHANNELS: usize = 16;
/// Levels that a [`MipTable`] has room for: sizes up to 32,768.
const LEVELS: usize = 16;
/// Units of sums over few samples, `1 / 2^-44`: gradients of 1e-9 keep four digits, and terms up to 1024 fit, as do sums of
/// large terms up to 262,144, of each sign and of 16 sums beside each other (`fixed.wgsl`).
pub const SUM_SCALE: f32 = (1_u64 << 44) as f32;
/// Logarithm of the number of samples that count as few, and the most by which units shrink.
const FEW_SAMPLES: u32 = 16;
const FINEST: u32 = 16;

/// Scale of the sums of the gradient of a mean over so many samples: a power of two that grows with them, as the terms
/// shrink. Terms keep their digits and their range for pictures of any size and number; sums of all terms in one texel,
/// which do not shrink, have room for 262,144 over the factor by which the scale grew (4 at the most samples).
///
/// ```
/// use photofit_texture::gpu::{SUM_SCALE, sum_scale};
/// assert_eq!(sum_scale(256 * 256), SUM_SCALE);
/// assert_eq!(sum_scale(8 * 2048 * 2048), 512.0 * SUM_SCALE);
/// ```
pub fn sum_scale(samples: usize) -> f32 {
    let more = samples.max(1).ilog2().saturating_sub(FEW_SAMPLES).min(FINEST);
    SUM_SCALE * (1_u32 << more) as f32
}

/// Level of detail, taps and lookups. Needs [`photofit_scalar::WGSL`] before it, a member `maps: MipTable` in the kernel's
/// parameters, and `var<storage, read> texels: array<vec4<f32>>`.
pub const LOOKUP: &str = concat!(
    include_str!("level.wgsl"),
    include_str!("taps.wgsl"),
    include_str!("texels.wgsl"),
    include_str!("lookup.wgsl")
);
/// Texel gradients of lookups. Needs [`LOOKUP`] and [`photofit_gpu::FIXED`], with `sums` of [`MipBuffers::sums`].
pub const SCATTER: &str = include_str!("scatter.wgsl");

const DOWNSAMPLE: Kernel =
    Kernel { name: "downsample", source: &[INDEX, include_str!("filter.wgsl")], entry: "downsample" };
const DOWNSAMPLE_VJP: Kernel = Kernel { name: "downsample_vjp", entry: "downsample_vjp", ..DOWNSAMPLE };
const COLLECT: Kernel = Kernel {
    name: "collect_texels",
    source: &[INDEX, FIXED_READ, include_str!("collect.wgsl")],
    entry: "collect_texels",
};

/// The kernels of this crate.
pub const KERNELS: &[Kernel] = &[DOWNSAMPLE, DOWNSAMPLE_VJP, COLLECT];

/// What lookups and their adjoints know of the levels: `MipTable` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct MipTable {
    levels: [[u32; 4]; LEVELS],
    slots: [u32; CHANNELS],
    count: u32,
    channels: u32,
    scale: f32,
    pad: u32,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct FilterParams {
    fine: [u32; 4],
    coarse: [u32; 4],
    coverage: u32,
    colors: u32,
    alpha: u32,
    upsampled: u32,
}

/// What is known when sums are taken up: `Params` of its kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct CollectParams {
    slots: [u32; CHANNELS],
    texels: u32,
    channels: u32,
    scale: f32,
    pad: u32,
}

/// A pyramid and its gradient on a device.
#[derive(Clone, Debug)]
pub struct MipBuffers {
    layout: MipLayout,
    rule: MipRule,
    table: MipTable,
    /// Texels of all levels, the base first, four vectors each.
    pub texels: Buffer<[f32; 4]>,
    /// Gradient of the texels, laid out as they are.
    pub gradient: Buffer<[f32; 4]>,
    /// Fixed-point sums of the channels with gradients ([`photofit_gpu::FIXED`]).
    pub sums: Buffer<u32>,
    /// One word: not 0 once a term of a sum was not finite or terms were too many ([`photofit_gpu::FIXED_LOST`]), or a term
    /// counted as its limit ([`photofit_gpu::FIXED_LIMITED`]).
    pub status: Buffer<u32>,
}

impl MipBuffers {
    /// Uploads a pyramid. Gradients are summed for the channels in `fitted`.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    ///
    /// # Panics
    /// If the pyramid does not go down to 1 x 1 or has more than 16 levels.
    pub fn new(
        gpu: &Gpu,
        pyramid: &Pyramid<f32, CHANNELS>,
        fitted: [bool; CHANNELS],
    ) -> Result<Self, GpuError> {
        let base = &pyramid.levels[0];
        assert_eq!(pyramid.levels.len(), mip_levels(base.width, base.height), "all levels");
        assert!(pyramid.levels.len() <= LEVELS, "at most {LEVELS} levels");
        let layout = MipLayout::full(base.width, base.height);
        let mut table = MipTable {
            levels: [[0; 4]; LEVELS],
            slots: [u32::MAX; CHANNELS],
            count: layout.count() as u32,
            channels: 0,
            scale: SUM_SCALE,
            pad: 0,
        };
        for (out, l) in table.levels.iter_mut().zip(layout.levels()) {
            *out = [l.offset, l.width, l.height, 0];
        }
        for (slot, _) in table.slots.iter_mut().zip(fitted).filter(|(_, fitted)| *fitted) {
            *slot = table.channels;
            table.channels += 1;
        }
        let texels = layout.texels();
        let buffers = Self {
            texels: gpu.zeros("texels", 4 * texels)?,
            gradient: gpu.zeros("gradient of texels", 4 * texels)?,
            sums: gpu.zeros("sums of texels", fixed_words(texels * table.channels as usize))?,
            status: gpu.zeros("status of texel sums", 1)?,
            layout,
            rule: pyramid.rule,
            table,
        };
        buffers.write(gpu, pyramid)?;
        Ok(buffers)
    }

    /// Overwrites the texels of all levels.
    ///
    /// # Errors
    /// If the device is lost.
    ///
    /// # Panics
    /// If the pyramid has another size.
    pub fn write(&self, gpu: &Gpu, pyramid: &Pyramid<f32, CHANNELS>) -> Result<(), GpuError> {
        let flat: Vec<[f32; CHANNELS]> =
            pyramid.levels.iter().flat_map(|l| l.texels.iter().copied()).collect();
        assert_eq!(flat.len(), self.layout.texels(), "a pyramid of the same size");
        gpu.write(&self.texels, bytemuck::cast_slice(&flat))
    }

    /// Waits for the device and copies all levels back. In a browser, [`Self::fetch`] does.
    ///
    /// # Errors
    /// If the device is lost.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn read(&self, gpu: &Gpu) -> Result<Pyramid<f32, CHANNELS>, GpuError> {
        Ok(self.pyramid(&gpu.read(&self.texels)?))
    }

    /// [`Self::read`] as a future, as [`Gpu::fetch`] is one.
    ///
    /// # Errors
    /// If the device is lost.
    pub async fn fetch(&self, gpu: &Gpu) -> Result<Pyramid<f32, CHANNELS>, GpuError> {
        Ok(self.pyramid(&gpu.fetch(&self.texels).await?))
    }

    fn pyramid(&self, flat: &[[f32; 4]]) -> Pyramid<f32, CHANNELS> {
        let texels: &[[f32; CHANNELS]] = bytemuck::cast_slice(flat);
        let level = |l: &Level| {
            let (width, height) = (l.width as usize, l.height as usize);
            Texture { width, height, texels: texels[l.offset as usize..][..width * height].to_vec() }
        };
        Pyramid { levels: self.layout.levels().iter().map(level).collect(), rule: self.rule }
    }

    /// Places and sizes of the levels.
    pub fn layout(&self) -> &MipLayout {
        &self.layout
    }

    /// The parameters of lookups whose gradients are summed in units of `1 / scale` ([`sum_scale`]).
    ///
    /// # Panics
    /// If the scale is no power of two.
    pub fn table(&self, scale: f32) -> MipTable {
        let power = scale.is_normal() && scale > 0.0 && scale.to_bits().trailing_zeros() >= 23;
        assert!(power, "units of sums are powers of two");
        MipTable { scale, ..self.table }
    }

    /// Parameters of the filter from level `k - 1` to level `k`.
    fn filter(&self, k: usize, adjoint: MipAdjoint) -> FilterParams {
        let (coverage, colors, alpha) = match self.rule {
            MipRule::Coverage { colors, alpha } => (1, colors as u32, alpha as u32),
            MipRule::Area | MipRule::Free => (0, 0, 0),
        };
        FilterParams {
            fine: self.table.levels[k - 1],
            coarse: self.table.levels[k],
            coverage,
            colors,
            alpha,
            upsampled: u32::from(adjoint == MipAdjoint::Smooth),
        }
    }

    fn levels(&self) -> usize {
        if self.rule == MipRule::Free { 1 } else { self.layout.count() }
    }

    /// Records [`Pyramid::rebuild`].
    ///
    /// # Errors
    /// If a kernel does not fit the device.
    pub fn record_rebuild(&self, r: &mut Recorder) -> Result<(), GpuError> {
        for k in 1..self.levels() {
            let level = self.layout.level(k);
            let params = self.filter(k, MipAdjoint::Exact);
            r.dispatch(&DOWNSAMPLE, &params, &[self.texels.bind()], (level.width * level.height) as usize)?;
        }
        Ok(())
    }

    /// Records [`Pyramid::collapse_vjp`] of the gradient, in place.
    ///
    /// # Errors
    /// If a kernel does not fit the device.
    pub fn record_collapse_vjp(&self, r: &mut Recorder, adjoint: MipAdjoint) -> Result<(), GpuError> {
        for k in (1..self.levels()).rev() {
            let level = self.layout.level(k - 1);
            let params = self.filter(k, adjoint);
            let buffers = [self.texels.bind(), self.gradient.bind()];
            r.dispatch(&DOWNSAMPLE_VJP, &params, &buffers, (level.width * level.height) as usize)?;
        }
        Ok(())
    }

    /// Records that the sums become the gradient, which is zero in channels without sums, and are emptied. What did not fit is
    /// told by [`Self::status`]. The slot takes other [`Self::collected`].
    ///
    /// # Errors
    /// If the kernel does not fit the device.
    pub fn record_collect(&self, r: &mut Recorder, scale: f32) -> Result<Slot, GpuError> {
        let buffers = [self.sums.bind(), self.gradient.bind(), self.status.bind()];
        r.dispatch(&COLLECT, &self.collected(scale), &buffers, CHANNELS * self.layout.texels())
    }

    /// The parameters of [`Self::record_collect`] for sums in units of `1 / scale`.
    pub fn collected(&self, scale: f32) -> CollectParams {
        let MipTable { slots, channels, .. } = self.table;
        CollectParams { slots, texels: self.layout.texels() as u32, channels, scale, pad: 0 }
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tolerances;
