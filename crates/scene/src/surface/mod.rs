//! Forward lookup of materials: what a surface is made of at a point.

mod extensions;
mod mip;
mod taps;
#[cfg(test)]
mod tests;

pub use extensions::ExtensionSample;

use crate::{AlphaMode, Filter, Material, Scene, TextureSlot};
use extensions::CompiledExtensions;
use mip::{Encoding, Levels, MipTexture};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use taps::{Address, Taps};

/// Derivatives of both sets of texture coordinates with respect to the pixel, `d(uv)/dX` and `d(uv)/dY`, per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UvDerivatives {
    /// Along X, for the sets 0 and 1.
    pub dx: [Vec2f; 2],
    /// Along Y, for the sets 0 and 1.
    pub dy: [Vec2f; 2],
}

impl UvDerivatives {
    /// The same derivatives for both sets.
    pub fn same(dx: Vec2f, dy: Vec2f) -> Self {
        Self { dx: [dx; 2], dy: [dy; 2] }
    }
}

/// A material at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Linear base colour, vertex colour multiplied in.
    pub base_color: Vec3f,
    /// Coverage: 1 for opaque materials, 0 or 1 for masked ones, the blend factor else.
    pub alpha: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Metalness.
    pub metallic: f32,
    /// Unit normal in tangent space; +z without a normal map.
    pub normal: Vec3f,
    /// Linear emitted radiance; zero for unlit materials.
    pub emissive: Vec3f,
    /// The base colour is shown as it is.
    pub unlit: bool,
}

/// A texture of a material, and which of the material's addresses it is read at.
#[derive(Clone, Copy, Debug)]
struct Slot {
    texture: usize,
    address: usize,
}

/// A material with what does not depend on the point worked out.
#[derive(Debug)]
struct Compiled {
    constant: SurfaceSample,
    base_alpha: f32,
    alpha_mode: AlphaMode,
    normal_scale: f32,
    /// Distinct ways to address the textures: mostly one.
    addresses: Vec<Address>,
    base_color: Option<Slot>,
    metallic_roughness: Option<Slot>,
    normal: Option<Slot>,
    emissive: Option<Slot>,
    extensions: Option<Box<CompiledExtensions>>,
}

/// The materials of a scene, ready to be looked up from many threads.
///
/// Textures are kept in 8 bits with their mip chains (box filter, averaged in linear light where the slot is sRGB; by
/// alpha where the material is not opaque); those without a slot that is read, or whose factor is zero, are left out.
/// Occlusion is not a property of the surface and is not read.
#[derive(Debug)]
pub struct SurfaceLibrary {
    textures: Vec<MipTexture>,
    materials: Vec<Compiled>,
    /// Bytes to linear light, of sRGB slots.
    decode: [f32; 256],
}

impl SurfaceLibrary {
    /// Builds the mip chains and compiles the materials.
    ///
    /// # Panics
    /// If the scene is not valid (see [`Scene::validate`]).
    pub fn new(scene: &Scene) -> Self {
        let mut plan = Plan::default();
        let materials = scene.materials.iter().map(|m| compile(scene, m, &mut plan)).collect();
        let textures = plan
            .textures
            .par_iter()
            .map(|want| {
                let image = &scene.images[want.image];
                let levels = if want.mips {
                    Levels::full(image.width, image.height)
                } else {
                    Levels::base(image.width, image.height)
                };
                mip::build(image, &levels, want.encoding)
            })
            .collect();
        let decode = std::array::from_fn(|i| photofit_image::srgb_u8_to_linear(i as u8));
        Self { textures, materials, decode }
    }

    /// The material at texture coordinates `uv0` and `uv1`.
    ///
    /// `vertex_color` is linear and multiplies the base colour and alpha (white where a mesh has none). Without a
    /// `footprint` the base level is read; with one, the level of the longer axis of its ellipse.
    ///
    /// # Panics
    /// If there is no such material.
    #[inline]
    pub fn lookup(
        &self,
        material: usize,
        uv0: Vec2f,
        uv1: Vec2f,
        vertex_color: Vec4f,
        footprint: Option<&UvDerivatives>,
    ) -> SurfaceSample {
        let m = &self.materials[material];
        let mut out = m.constant;
        let mut alpha = m.base_alpha * vertex_color.w;
        out.base_color = out.base_color.mul(vertex_color.xyz());
        if !m.addresses.is_empty() {
            let mut reader = Reader { library: self, material: m, uv: [uv0, uv1], footprint, last: None };
            if let Some(slot) = m.base_color {
                let t = reader.read(slot);
                out.base_color = out.base_color.mul(t.xyz());
                alpha *= t.w;
            }
            if let Some(slot) = m.metallic_roughness {
                let t = reader.read(slot);
                out.roughness *= t.y;
                out.metallic *= t.z;
            }
            if let Some(slot) = m.normal {
                out.normal = decode_normal(reader.read(slot), m.normal_scale);
            }
            if let Some(slot) = m.emissive {
                out.emissive = out.emissive.mul(reader.read(slot).xyz());
            }
        }
        out.alpha = coverage(m.alpha_mode, alpha);
        out
    }

    /// The coverage alone, on the base level: 1 at once for opaque materials. For rays that ask whether something is
    /// there.
    ///
    /// # Panics
    /// If there is no such material.
    #[inline]
    pub fn alpha(&self, material: usize, uv0: Vec2f, uv1: Vec2f, vertex_alpha: f32) -> f32 {
        let m = &self.materials[material];
        if m.alpha_mode == AlphaMode::Opaque {
            return 1.0;
        }
        let mut alpha = m.base_alpha * vertex_alpha;
        if let Some(slot) = m.base_color {
            let taps = m.addresses[slot.address].taps([uv0, uv1], None);
            let texels = &self.textures[slot.texture].texels;
            let sum: f32 =
                (0..taps.count).map(|k| taps.weight[k] * f32::from(texels[taps.index[k] as usize][3])).sum();
            alpha *= sum / 255.0;
        }
        coverage(m.alpha_mode, alpha)
    }

    /// Whether a material covers everything behind it at every point.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn is_opaque(&self, material: usize) -> bool {
        self.materials[material].alpha_mode == AlphaMode::Opaque
    }

    /// Whether no property of a material depends on texture coordinates.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn is_constant(&self, material: usize) -> bool {
        self.materials[material].addresses.is_empty()
    }

    /// Number of materials.
    pub fn materials(&self) -> usize {
        self.materials.len()
    }

    /// Whether some point of a material may emit.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn may_emit(&self, material: usize) -> bool {
        self.materials[material].constant.emissive != Vec3f::zero()
    }

    /// Whether a material has a normal map that is read.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn has_normal_map(&self, material: usize) -> bool {
        self.materials[material].normal.is_some()
    }

    /// Bytes of all texels, mip chains included.
    pub fn bytes(&self) -> usize {
        self.textures.iter().map(|t| size_of_val(t.texels.as_slice())).sum()
    }
}

/// Reads the textures of one point; slots at the same address share their taps.
struct Reader<'a> {
    library: &'a SurfaceLibrary,
    material: &'a Compiled,
    uv: [Vec2f; 2],
    footprint: Option<&'a UvDerivatives>,
    last: Option<(usize, Taps)>,
}

impl Reader<'_> {
    #[inline(always)]
    fn read(&mut self, slot: Slot) -> Vec4f {
        let taps = match &self.last {
            Some((address, taps)) if *address == slot.address => taps,
            _ => {
                let taps = self.material.addresses[slot.address].taps(self.uv, self.footprint);
                &self.last.insert((slot.address, taps)).1
            }
        };
        let texture = &self.library.textures[slot.texture];
        let mut sum = [0.0_f32; 4];
        let taps = taps.index.iter().zip(&taps.weight).take(taps.count);
        if texture.srgb {
            let decode = &self.library.decode;
            for (&i, &w) in taps {
                let [r, g, b, a] = texture.texels[i as usize];
                let color = [decode[r as usize], decode[g as usize], decode[b as usize], f32::from(a)];
                for c in 0..4 {
                    sum[c] += w * color[c];
                }
            }
            sum[3] *= 1.0 / 255.0;
        } else {
            for (&i, &w) in taps {
                let texel = texture.texels[i as usize];
                for c in 0..4 {
                    sum[c] += w * f32::from(texel[c]);
                }
            }
            sum = sum.map(|s| s * (1.0 / 255.0));
        }
        Vec4f::from_array(sum)
    }
}

#[inline(always)]
fn coverage(mode: AlphaMode, alpha: f32) -> f32 {
    match mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask { cutoff } => f32::from(u8::from(alpha >= cutoff)),
        AlphaMode::Blend => alpha.clamp(0.0, 1.0),
    }
}

#[inline(always)]
fn decode_normal(t: Vec4f, scale: f32) -> Vec3f {
    let n = vec3((2.0 * t.x - 1.0) * scale, (2.0 * t.y - 1.0) * scale, 2.0 * t.z - 1.0);
    let unit = n.normalize_or_zero();
    if unit == Vec3f::zero() { vec3(0.0, 0.0, 1.0) } else { unit }
}

/// A texture to be built.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Want {
    image: usize,
    encoding: Encoding,
    mips: bool,
}

#[derive(Debug, Default)]
struct Plan {
    textures: Vec<Want>,
    known: HashMap<(usize, Encoding), usize>,
}

impl Plan {
    /// Index of the texture; one with more levels serves who needs fewer.
    fn texture(&mut self, want: Want) -> usize {
        let i = *self.known.entry((want.image, want.encoding)).or_insert_with(|| {
            self.textures.push(want);
            self.textures.len() - 1
        });
        self.textures[i].mips |= want.mips;
        i
    }
}

fn compile(scene: &Scene, m: &Material, plan: &mut Plan) -> Compiled {
    let mut addresses: Vec<Address> = Vec::new();
    let weighted = m.alpha_mode != AlphaMode::Opaque;
    let mut slot = |slot: &Option<TextureSlot>, srgb: bool, weighted: bool| {
        slot.as_ref().map(|s| {
            let image = &scene.images[s.image];
            let mips = s.sampler.filter == Filter::Trilinear;
            let texture = plan.texture(Want { image: s.image, encoding: Encoding { srgb, weighted }, mips });
            let identity = s.transform == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let levels = if mips { Levels::full } else { Levels::base };
            let address = Address {
                set: usize::from(s.tex_coord == 1),
                transform: (!identity).then_some(s.transform),
                sampler: s.sampler,
                levels: levels(image.width, image.height),
            };
            let known = addresses.iter().position(|a| *a == address);
            let address = known.unwrap_or_else(|| {
                addresses.push(address);
                addresses.len() - 1
            });
            Slot { texture, address }
        })
    };
    // What an unlit or black factor hides is not read.
    let lit = |s: &Option<TextureSlot>| if m.unlit { None } else { *s };
    let glows = m.emissive.iter().any(|&e| e > 0.0);
    let varies = m.roughness > 0.0 || m.metallic > 0.0;
    let base_color = slot(&m.base_color_texture, true, weighted);
    let metallic_roughness = slot(&lit(&m.metallic_roughness_texture).filter(|_| varies), false, false);
    let normal = slot(&lit(&m.normal_texture), false, false);
    let emissive = slot(&lit(&m.emissive_texture).filter(|_| glows), true, false);
    let extensions = m.extensions.as_ref().filter(|_| !m.unlit);
    let extensions =
        extensions.map(|e| Box::new(extensions::compile(e, |texture, srgb| slot(texture, srgb, false))));
    let [r, g, b, a] = m.base_color;
    Compiled {
        constant: SurfaceSample {
            base_color: vec3(r, g, b),
            alpha: 1.0,
            roughness: m.roughness,
            metallic: m.metallic,
            normal: vec3(0.0, 0.0, 1.0),
            emissive: if m.unlit { Vec3f::zero() } else { Vec3f::from_array(m.emissive) },
            unlit: m.unlit,
        },
        base_alpha: a,
        alpha_mode: m.alpha_mode,
        normal_scale: m.normal_scale,
        addresses,
        base_color,
        metallic_roughness,
        normal,
        emissive,
        extensions,
    }
}
