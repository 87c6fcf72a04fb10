//! The model of reflection in WGSL, with the tables and lights that it reads.
//!
//! [`WGSL`] holds the functions of this crate that a rasterizer needs, with their adjoints, under their names here:
//! `shade`, `shade_vjp`, `perturb`, `face_viewer`, `view_direction` and what they are made of. [`ShadingTables`] is the
//! buffer of tables and prefiltered environments, [`Lights`] a member of a kernel's parameters.

use crate::energy::averages_table;
use crate::split_sum::table;
use crate::{Environment, Light};
use photofit_gpu::{Buffer, Gpu, GpuError};
use photofit_scalar::Vec3;

/// The functions. Needs [`photofit_scalar::WGSL`] before it, a member `lights: Lights` in the kernel's parameters, and
/// `var<storage, read> shading_tables: array<vec4<f32>>` ([`ShadingTables`]).
pub const WGSL: &str = concat!(
    include_str!("surface.wgsl"),
    include_str!("ggx.wgsl"),
    include_str!("split_sum.wgsl"),
    include_str!("energy.wgsl"),
    include_str!("eval.wgsl"),
    include_str!("normal_map.wgsl"),
    include_str!("environment.wgsl"),
    include_str!("light.wgsl"),
);

/// Lights that a kernel's parameters have room for, besides ambient ones.
pub const LIGHTS_MAX: usize = 64;
/// Numbers up to this are exact in the tables' `f32`.
const ENTRIES_MAX: usize = 1 << 24;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct Source {
    kind: u32,
    /// First entry of an environment.
    map: u32,
    pad: [u32; 2],
    a: [f32; 4],
    b: [f32; 4],
}

/// The lights of a picture: `Lights` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Lights {
    /// Point and directional lights, then environments.
    sources: [Source; LIGHTS_MAX],
    /// Radiance of all ambient lights.
    ambient: [f32; 4],
    punctual: u32,
    count: u32,
    pad: [u32; 2],
}

impl Default for Lights {
    /// None.
    fn default() -> Self {
        bytemuck::Zeroable::zeroed()
    }
}

/// The tables of reflectance and the environments of a device, in one buffer.
#[derive(Clone, Debug)]
pub struct ShadingTables {
    /// Pairs of neighbouring entries of the split-sum table and of its averages, then the environments.
    pub buffer: Buffer<[f32; 4]>,
    /// First entry of each environment.
    environments: Vec<u32>,
}

/// Pairs of neighbours: one read gives both ends of an interpolation.
fn pairs(row: &[[f32; 2]]) -> impl Iterator<Item = [f32; 4]> + '_ {
    let next = row.iter().skip(1).chain(row.last());
    row.iter().zip(next).map(|(a, b)| [a[0], a[1], b[0], b[1]])
}

impl ShadingTables {
    /// Uploads the tables and the environments that lights will name.
    ///
    /// # Errors
    /// If the device cannot hold them.
    pub fn new(gpu: &Gpu, environments: &[&Environment<f32>]) -> Result<Self, GpuError> {
        let (split_sum, columns) = table();
        let mut entries: Vec<[f32; 4]> = split_sum.chunks(columns).flat_map(pairs).collect();
        entries.extend(pairs(averages_table()));
        let mut firsts = Vec::with_capacity(environments.len());
        for map in environments {
            let images: Vec<_> = std::iter::once(&map.diffuse).chain(&map.specular).collect();
            firsts.push(entries.len() as u32);
            let mut first = entries.len() + images.len();
            for image in &images {
                entries.push([first as f32, image.size() as f32, 0.0, 0.0]);
                first += image.padded().len();
            }
            images.iter().for_each(|image| entries.extend_from_slice(image.padded()));
        }
        if entries.len() > ENTRIES_MAX {
            let (bytes, limit) = (16 * entries.len() as u64, 16 * ENTRIES_MAX as u64);
            let device = gpu.report().name.clone();
            let which = "numbers of entries that f32 holds";
            return Err(GpuError::TooLarge { name: "shading tables".into(), bytes, limit, which, device });
        }
        Ok(Self { buffer: gpu.upload("shading tables", &entries)?, environments: firsts })
    }

    /// The parameters of lights. `number` tells which of the uploaded environments a map is.
    ///
    /// # Panics
    /// If there are more than [`LIGHTS_MAX`] besides ambient ones, or a number is out of range.
    pub fn lights(&self, lights: &[Light<'_>], number: impl Fn(&Environment<f32>) -> usize) -> Lights {
        let of = |v: Vec3<f32>| [v.x, v.y, v.z, 0.0];
        let (mut punctual, mut environments, mut ambient) = (Vec::new(), Vec::new(), Vec3::zero());
        for light in lights {
            match *light {
                Light::Point { position, intensity } => {
                    punctual.push(Source { kind: 0, a: of(position), b: of(intensity), ..Source::default() });
                }
                Light::Directional { direction, irradiance } => {
                    punctual.push(Source {
                        kind: 1,
                        a: of(direction),
                        b: of(irradiance),
                        ..Source::default()
                    });
                }
                Light::Ambient { radiance } => ambient += radiance,
                Light::Environment { map, rotation, scale } => {
                    let [cosine, sine] = rotation.cosine_sine();
                    let map = self.environments[number(map)];
                    environments.push(Source { map, a: [cosine, sine, scale, 0.0], ..Source::default() });
                }
            }
        }
        let count = punctual.len() + environments.len();
        assert!(count <= LIGHTS_MAX, "{count} lights that are not ambient are more than {LIGHTS_MAX}");
        let mut out = Lights {
            ambient: of(ambient),
            punctual: punctual.len() as u32,
            count: count as u32,
            ..Lights::default()
        };
        out.sources.iter_mut().zip(punctual.into_iter().chain(environments)).for_each(|(o, s)| *o = s);
        out
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tolerances;
