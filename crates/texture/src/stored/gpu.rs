//! Textures as files hold them on a device, many in one buffer, in the precision of their texels.

use super::{MipTexture, Texels};
use crate::{Filter, MipSizes, Sampler, Wrap};
use photofit_gpu::{Buffer, Gpu, GpuError};
use photofit_scalar::srgb_table;

/// Reading of [`StoredTextures`]. Needs [`photofit_scalar::WGSL`] and `var<storage, read> stored: array<u32>`; it holds level of
/// detail and taps, as [`crate::gpu::LOOKUP`] does: a kernel takes one of both.
pub const STORED: &str =
    concat!(include_str!("../level.wgsl"), include_str!("../taps.wgsl"), include_str!("stored.wgsl"));

/// Continuation along u and v and filter, as `taps.wgsl` numbers them.
pub(crate) fn sampler_codes(sampler: &Sampler) -> [u32; 3] {
    let wrap = |w: Wrap| match w {
        Wrap::Repeat => 0,
        Wrap::MirroredRepeat => 1,
        Wrap::ClampToEdge => 2,
    };
    let filter = match sampler.filter {
        Filter::Nearest => 0,
        Filter::Bilinear => 1,
        Filter::Trilinear => 2,
    };
    [wrap(sampler.wrap_u), wrap(sampler.wrap_v), filter]
}

/// A sampler as `stored_sampler` takes it.
pub fn sampler_bits(sampler: &Sampler) -> u32 {
    let [u, v, filter] = sampler_codes(sampler);
    u | v << 2 | filter << 4
}

/// Textures of a device.
#[derive(Clone, Debug)]
pub struct StoredTextures {
    /// The table of sRGB, then each texture: its description and its texels.
    pub words: Buffer<u32>,
    places: Vec<u32>,
}

impl StoredTextures {
    /// Uploads some textures.
    ///
    /// # Errors
    /// If the device cannot hold them in one buffer.
    pub fn new(gpu: &Gpu, textures: &[&MipTexture]) -> Result<Self, GpuError> {
        let table = srgb_table();
        let mut places = Vec::with_capacity(textures.len());
        let mut len = table.len();
        for texture in textures {
            places.push(u32::try_from(len).unwrap_or(u32::MAX));
            len += description(texture) + texture.texels().bytes().div_ceil(4);
        }
        if u32::try_from(len).is_err() {
            let (bytes, limit) = (4 * len as u64, 4 * u64::from(u32::MAX));
            let (device, which) = (gpu.report().name.clone(), "words that 32 bits count");
            return Err(GpuError::TooLarge { name: "textures".into(), bytes, limit, which, device });
        }
        // Refused before the words are put together.
        let buffer = gpu.zeros("textures", len)?;
        let mut words = Vec::with_capacity(len);
        words.extend(table.iter().map(|x| x.to_bits()));
        for texture in textures {
            append(&mut words, texture);
        }
        gpu.write(&buffer, &words)?;
        Ok(Self { words: buffer, places })
    }

    /// By which kernels know a texture.
    ///
    /// # Panics
    /// If there is no such texture.
    pub fn place(&self, texture: usize) -> u32 {
        self.places[texture]
    }
}

/// Words of a texture's description.
fn description(texture: &MipTexture) -> usize {
    2 + 3 * texture.layout().count()
}

fn append(words: &mut Vec<u32>, texture: &MipTexture) {
    let format = match texture.texels() {
        Texels::Srgb8(_) => 0,
        Texels::Unorm8(_) => 1,
        Texels::Unorm16(_) => 2,
        Texels::F32(_) => 3,
    };
    words.extend([(words.len() + description(texture)) as u32, format]);
    words.extend(texture.layout().levels().iter().flat_map(|l| [l.offset, l.width, l.height]));
    match texture.texels() {
        Texels::Srgb8(t) | Texels::Unorm8(t) => words.extend(t.iter().map(|t| u32::from_le_bytes(*t))),
        Texels::Unorm16(t) => {
            let pair = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
            words.extend(t.iter().flat_map(|[r, g, b, a]| [pair(*r, *g), pair(*b, *a)]));
        }
        Texels::F32(t) => words.extend(t.iter().flatten().map(|x| x.to_bits())),
    }
}
