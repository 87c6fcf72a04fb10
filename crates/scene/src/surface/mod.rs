//! Forward lookup of materials: what a surface is made of at a point.

mod address;
mod adjoint;
mod compile;
mod extensions;
#[cfg(feature = "gpu")]
pub mod gpu;
mod packet;
#[cfg(test)]
mod tests;

pub use adjoint::{SampleGradient, SampleSink};
pub use extensions::ExtensionSample;
pub use packet::SurfacePacket;

use crate::{AlphaMode, Scene};
use address::Address;
use compile::{Wanted, compile};
use extensions::CompiledExtensions;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3};
use photofit_shading::Sides;
use photofit_texture::{Lookup, MipTexture};

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

/// The textures of the metallic-roughness model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapKind {
    /// Base colour and alpha.
    BaseColor,
    /// Roughness in green, metalness in blue.
    MetallicRoughness,
    /// Tangent-space normal, 0 to 1.
    Normal,
    /// Emission.
    Emissive,
}

/// A texture of a material, and which of the material's addresses it is read at.
#[derive(Clone, Copy, Debug)]
struct Slot {
    texture: usize,
    address: usize,
}

/// A material with what does not depend on the point worked out.
#[derive(Clone, Debug)]
struct Compiled {
    constant: SurfaceSample,
    base_alpha: f32,
    alpha_mode: AlphaMode,
    sides: Sides,
    normal_scale: f32,
    /// Distinct ways to address the textures: mostly one.
    addresses: Vec<Address>,
    base_color: Option<Slot>,
    metallic_roughness: Option<Slot>,
    normal: Option<Slot>,
    emissive: Option<Slot>,
    /// With its strength.
    occlusion: Option<(Slot, f32)>,
    extensions: Option<Box<CompiledExtensions>>,
}

/// The materials of a scene, ready to be looked up from many threads.
///
/// Textures are kept in 8 bits, data in 16 where the file has them, with their mip chains (box filter, averaged in linear light where the slot is sRGB; by
/// alpha where the material is not opaque), or in floating point once [`Self::set_texels`] has replaced them; those
/// without a slot that is read, or whose factor is zero, are left out. Occlusion is not a property of the surface and is
/// read by [`Self::with_occlusion`] alone.
#[derive(Clone, Debug)]
pub struct SurfaceLibrary {
    textures: Vec<MipTexture>,
    materials: Vec<Compiled>,
}

impl SurfaceLibrary {
    /// Builds the mip chains and compiles the materials.
    ///
    /// # Panics
    /// If the scene is not valid (see [`Scene::validate`]).
    pub fn new(scene: &Scene) -> Self {
        Self::compiled(scene, false)
    }

    /// The same with occlusion maps, for [`Self::occlusion`].
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn with_occlusion(scene: &Scene) -> Self {
        Self::compiled(scene, true)
    }

    fn compiled(scene: &Scene, occlusion: bool) -> Self {
        let mut wanted = Wanted::default();
        let materials = scene.materials.iter().map(|m| compile(scene, m, occlusion, &mut wanted)).collect();
        Self { textures: wanted.build(scene), materials }
    }

    /// Index of a texture of a material, for [`Self::set_texels`]; `None` where the map is not read. Maps that name one
    /// image in one encoding share a texture.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn texture_of(&self, material: usize, map: MapKind) -> Option<usize> {
        let m = &self.materials[material];
        let slot = match map {
            MapKind::BaseColor => m.base_color,
            MapKind::MetallicRoughness => m.metallic_roughness,
            MapKind::Normal => m.normal,
            MapKind::Emissive => m.emissive,
        };
        slot.map(|s| s.texture)
    }

    /// Materials whose map of this kind reads a texture.
    pub fn readers(&self, texture: usize, map: MapKind) -> impl Iterator<Item = usize> {
        (0..self.materials()).filter(move |m| self.texture_of(*m, map) == Some(texture))
    }

    /// Number of textures.
    pub fn textures(&self) -> usize {
        self.textures.len()
    }

    /// A texture by its index.
    ///
    /// # Panics
    /// If there is no such texture.
    pub fn texture(&self, index: usize) -> &MipTexture {
        &self.textures[index]
    }

    /// Replaces all texels of one texture (row 0 at v = 0, linear light, any range, kept in 32-bit floating point) and
    /// its mip chain; nothing else is built again.
    ///
    /// # Panics
    /// If there is no such texture, or it has another number of texels.
    pub fn set_texels(&mut self, index: usize, linear: &[[f32; 4]]) {
        self.textures[index].set_base(linear);
    }

    /// Exchanges one texture for another of the same size.
    ///
    /// # Panics
    /// If there is no such texture, or the other has another layout.
    pub fn exchange_texture(&mut self, index: usize, other: &mut MipTexture) {
        assert_eq!(self.textures[index].layout(), other.layout(), "a texture of the same size");
        std::mem::swap(&mut self.textures[index], other);
    }

    /// The factors of a material, which its textures multiply: base colour, roughness, metalness, emission.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn factors(&self, material: usize) -> SurfaceSample {
        self.materials[material].constant
    }

    /// Replaces base colour, roughness, metalness and emission of [`Self::factors`]; the rest stays. An emission that was black, or
    /// roughness and metalness that were both zero, when the library was built have lost their map, which nothing would
    /// have read: raised from there they are the same everywhere. Whoever wants the map builds the library with a small factor.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn set_factors(&mut self, material: usize, factors: &SurfaceSample) {
        let constant = &mut self.materials[material].constant;
        let SurfaceSample { base_color, roughness, metallic, emissive, .. } = *factors;
        *constant = SurfaceSample { base_color, roughness, metallic, emissive, ..*constant };
    }

    /// The material at texture coordinates `uv0` and `uv1`.
    ///
    /// `vertex_color` is linear and multiplies the base colour and alpha (white where a mesh has none). Without a
    /// `footprint` the base level is read; with one, the level of the longer axis of its ellipse.
    ///
    /// # Panics
    /// If there is no such material.
    #[inline(always)]
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
        out.alpha = m.alpha_mode.coverage(alpha);
        out
    }

    /// The share of indirect light that reaches the surface, in `[0, 1]`: 1 where a material has no occlusion map or the
    /// library was built without them. Takes what [`Self::lookup`] takes.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn occlusion(&self, material: usize, uv: [Vec2f; 2], footprint: Option<&UvDerivatives>) -> f32 {
        let m = &self.materials[material];
        let Some((slot, strength)) = m.occlusion else { return 1.0 };
        let red = Reader { library: self, material: m, uv, footprint, last: None }.read(slot).x;
        1.0 + strength * (red - 1.0)
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
            let at = m.addresses[slot.address].lookup([uv0, uv1], None);
            alpha *= self.textures[slot.texture].read_alpha(&at);
        }
        m.alpha_mode.coverage(alpha)
    }

    /// Whether a material covers everything behind it at every point.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn is_opaque(&self, material: usize) -> bool {
        self.materials[material].alpha_mode == AlphaMode::Opaque
    }

    /// The sides of a material that are seen.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn sides(&self, material: usize) -> Sides {
        self.materials[material].sides
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
        self.textures.iter().map(|t| t.texels().bytes()).sum()
    }
}

/// Reads the textures of one point; slots at the same address share their taps.
struct Reader<'a> {
    library: &'a SurfaceLibrary,
    material: &'a Compiled,
    uv: [Vec2f; 2],
    footprint: Option<&'a UvDerivatives>,
    last: Option<(usize, Lookup<f32>)>,
}

impl Reader<'_> {
    #[inline(always)]
    fn read(&mut self, slot: Slot) -> Vec4f {
        let at = match &self.last {
            Some((address, at)) if *address == slot.address => at,
            _ => {
                let at = self.material.addresses[slot.address].lookup(self.uv, self.footprint);
                &self.last.insert((slot.address, at)).1
            }
        };
        Vec4f::from_array(self.library.textures[slot.texture].read(at))
    }
}

#[inline(always)]
fn decode_normal(t: Vec4f, scale: f32) -> Vec3f {
    let n = vec3((2.0 * t.x - 1.0) * scale, (2.0 * t.y - 1.0) * scale, 2.0 * t.z - 1.0);
    let unit = n.normalize_or_zero();
    if unit == Vec3f::zero() { vec3(0.0, 0.0, 1.0) } else { unit }
}
