//! Materials of a scene on a device: tables and textures that kernels look up as [`SurfaceLibrary::lookup`] does.

use super::{Compiled, Slot, SurfaceLibrary};
use crate::AlphaMode;
use photofit_gpu::{Buffer, Gpu, GpuError};
use photofit_texture::MipSizes;
use photofit_texture::gpu::{StoredTextures, sampler_bits};

/// Looking up materials: `surface_at`. Needs [`photofit_texture::gpu::STORED`] and what that needs, and
/// `var<storage, read> materials: array<vec4<u32>>`.
pub const SURFACE: &str = include_str!("surface.wgsl");

/// Vectors of a material and of an address.
const MATERIAL: usize = 5;
const ADDRESS: usize = 2;
/// What stands for no texture.
const NO_TEXTURE: u32 = u32::MAX;
/// Bits of a material's flags above those of its alpha mode, and of an address above those of its sampler.
const UNLIT: u32 = 4;
const SECOND_SET: u32 = 64;
const AS_IT_IS: u32 = 128;

/// The materials of a library on a device.
#[derive(Clone, Debug)]
pub struct SurfaceBuffers {
    /// Materials, then addresses.
    pub materials: Buffer<[u32; 4]>,
    /// The textures of the metallic-roughness model.
    pub textures: StoredTextures,
}

impl SurfaceBuffers {
    /// Uploads what a library holds of the metallic-roughness model.
    ///
    /// # Errors
    /// If the device cannot hold it.
    pub fn new(gpu: &Gpu, library: &SurfaceLibrary) -> Result<Self, GpuError> {
        let mut used: Vec<usize> = library
            .materials
            .iter()
            .flat_map(|m| slots(m).into_iter().flatten())
            .map(|s| s.texture)
            .collect();
        used.sort_unstable();
        used.dedup();
        let textures: Vec<_> = used.iter().map(|t| &library.textures[*t]).collect();
        let textures = StoredTextures::new(gpu, &textures)?;
        // Those of a slot are among them.
        let place = |slot: Slot| textures.place(used.partition_point(|t| *t < slot.texture));
        let mut rows = Vec::new();
        let mut addresses = Vec::new();
        for m in &library.materials {
            let first = MATERIAL * library.materials.len() + addresses.len();
            rows.extend(material(m, first, place));
            addresses.extend(m.addresses.iter().flat_map(address));
        }
        rows.extend(addresses);
        Ok(Self { materials: gpu.upload("materials", &rows)?, textures })
    }

    /// By which kernels know a material.
    pub fn place(material: usize) -> u32 {
        (MATERIAL * material) as u32
    }
}

/// Base colour, roughness and metalness, normal, emission.
fn slots(m: &Compiled) -> [Option<Slot>; 4] {
    [m.base_color, m.metallic_roughness, m.normal, m.emissive]
}

/// A material whose addresses begin at place `first`.
fn material(m: &Compiled, first: usize, place: impl Fn(Slot) -> u32) -> [[u32; 4]; MATERIAL] {
    let bits = |x: [f32; 4]| x.map(f32::to_bits);
    let cutoff = if let AlphaMode::Mask { cutoff } = m.alpha_mode { cutoff } else { 0.0 };
    let c = &m.constant;
    let [r, g, b] = c.emissive.to_array().map(f32::to_bits);
    let address = |s: Slot| (first + ADDRESS * s.address) as u32;
    [
        bits([c.base_color.x, c.base_color.y, c.base_color.z, m.base_alpha]),
        bits([c.roughness, c.metallic, m.normal_scale, cutoff]),
        [r, g, b, m.alpha_mode.code() | if c.unlit { UNLIT } else { 0 }],
        slots(m).map(|s| s.map_or(NO_TEXTURE, &place)),
        slots(m).map(|s| s.map_or(NO_TEXTURE, address)),
    ]
}

fn address(a: &super::Address) -> [[u32; 4]; ADDRESS] {
    let [u, v] = a.transform.unwrap_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).map(|row| row.map(f32::to_bits));
    let bit = |set: bool, bit: u32| if set { bit } else { 0 };
    let how = sampler_bits(&a.sampler) | bit(a.set == 1, SECOND_SET) | bit(a.transform.is_none(), AS_IT_IS);
    [[how, a.layout.count() as u32, u[0], u[1]], [u[2], v[0], v[1], v[2]]]
}

#[cfg(test)]
mod tests;
