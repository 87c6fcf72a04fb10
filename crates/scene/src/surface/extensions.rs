//! Lookup of what material extensions add at a point.

use super::{Compiled, Reader, Slot, SurfaceLibrary, SurfaceSample, UvDerivatives, decode_normal};
use crate::{Extensions, TextureSlot};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3};
use photofit_shading::bsdf::{Energy, GltfParameters, TransportMode};

/// What the extensions of a material are at a point; [`Self::parameters`] joins them with a [`SurfaceSample`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtensionSample {
    /// Index of refraction.
    pub ior: f32,
    /// Strength of the dielectric's reflection.
    pub specular: f32,
    /// Its linear colour at normal incidence.
    pub specular_color: Vec3f,
    /// Part of the dielectric that lets light pass.
    pub transmission: f32,
    /// The surface bounds a volume: `KHR_materials_volume` with a positive thickness factor.
    pub volume: bool,
    /// Thickness of the volume, in the asset's units; for renderers that do not trace the inside.
    pub thickness: f32,
    /// Strength of the coat.
    pub clearcoat: f32,
    /// Perceptual roughness of the coat.
    pub clearcoat_roughness: f32,
    /// Unit normal of the coat in the tangent space of the geometry; +z without a normal map of its own.
    pub clearcoat_normal: Vec3f,
    /// Linear colour of the sheen.
    pub sheen_color: Vec3f,
    /// Perceptual roughness of the sheen.
    pub sheen_roughness: f32,
    /// Strength of the anisotropy.
    pub anisotropy: f32,
    /// Its direction: cosine and sine of the angle from the tangent to the bitangent.
    pub anisotropy_direction: [f32; 2],
}

impl Default for ExtensionSample {
    fn default() -> Self {
        Self {
            ior: Extensions::IOR,
            specular: 1.0,
            specular_color: Vec3f::splat(1.0),
            transmission: 0.0,
            volume: false,
            thickness: 0.0,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal: vec3(0.0, 0.0, 1.0),
            sheen_color: Vec3f::zero(),
            sheen_roughness: 0.0,
            anisotropy: 0.0,
            anisotropy_direction: [1.0, 0.0],
        }
    }
}

impl ExtensionSample {
    /// The numbers of the scattering function at this point. `clearcoat_normal` is the coat's normal in the frame of
    /// the shading normal, which the caller knows.
    pub fn parameters(
        &self,
        surface: &SurfaceSample,
        clearcoat_normal: Vec3f,
        energy: Energy,
        mode: TransportMode,
    ) -> GltfParameters<f32> {
        GltfParameters {
            base_color: surface.base_color,
            metallic: surface.metallic,
            roughness: surface.roughness,
            ior: self.ior,
            specular: self.specular,
            specular_color: self.specular_color,
            transmission: self.transmission,
            volume: self.volume,
            clearcoat: self.clearcoat,
            clearcoat_roughness: self.clearcoat_roughness,
            clearcoat_normal,
            sheen_color: self.sheen_color,
            sheen_roughness: self.sheen_roughness,
            anisotropy: self.anisotropy,
            anisotropy_direction: self.anisotropy_direction,
            energy,
            mode,
        }
    }
}

/// The extensions of a material with what does not depend on the point worked out.
#[derive(Clone, Debug)]
pub(super) struct CompiledExtensions {
    constant: ExtensionSample,
    normal_scale: f32,
    /// Whether any of the slots below is there.
    varies: bool,
    specular: Option<Slot>,
    specular_color: Option<Slot>,
    transmission: Option<Slot>,
    thickness: Option<Slot>,
    clearcoat: Option<Slot>,
    clearcoat_roughness: Option<Slot>,
    clearcoat_normal: Option<Slot>,
    sheen_color: Option<Slot>,
    sheen_roughness: Option<Slot>,
    anisotropy: Option<Slot>,
}

/// Compiles the extensions; `slot` makes a slot of a texture that is sRGB or not. Textures whose factor is zero are
/// left out.
pub(super) fn compile(
    e: &Extensions,
    mut slot: impl FnMut(&Option<TextureSlot>, bool) -> Option<Slot>,
) -> CompiledExtensions {
    let mut c = ExtensionSample { ior: e.ior, ..ExtensionSample::default() };
    let mut read = |texture: &Option<TextureSlot>, srgb: bool, used: bool| {
        if used { slot(texture, srgb) } else { None }
    };
    let mut out = CompiledExtensions {
        constant: c,
        normal_scale: 1.0,
        varies: false,
        specular: None,
        specular_color: None,
        transmission: None,
        thickness: None,
        clearcoat: None,
        clearcoat_roughness: None,
        clearcoat_normal: None,
        sheen_color: None,
        sheen_roughness: None,
        anisotropy: None,
    };
    if let Some(s) = &e.specular {
        (c.specular, c.specular_color) = (s.factor, Vec3f::from_array(s.color));
        let used = s.factor > 0.0;
        out.specular = read(&s.texture, false, used);
        out.specular_color = read(&s.color_texture, true, used);
    }
    if let Some(t) = &e.transmission {
        c.transmission = t.factor;
        out.transmission = read(&t.texture, false, t.factor > 0.0);
    }
    if let Some(v) = &e.volume {
        (c.volume, c.thickness) = (v.thickness > 0.0, v.thickness);
        out.thickness = read(&v.thickness_texture, false, v.thickness > 0.0);
    }
    if let Some(l) = &e.clearcoat {
        (c.clearcoat, c.clearcoat_roughness) = (l.factor, l.roughness);
        let used = l.factor > 0.0;
        out.clearcoat = read(&l.texture, false, used);
        out.clearcoat_roughness = read(&l.roughness_texture, false, used && l.roughness > 0.0);
        out.clearcoat_normal = read(&l.normal_texture, false, used);
        out.normal_scale = l.normal_scale;
    }
    if let Some(s) = &e.sheen {
        (c.sheen_color, c.sheen_roughness) = (Vec3f::from_array(s.color), s.roughness);
        let used = s.color != [0.0; 3];
        out.sheen_color = read(&s.color_texture, true, used);
        out.sheen_roughness = read(&s.roughness_texture, false, used && s.roughness > 0.0);
    }
    if let Some(a) = &e.anisotropy {
        (c.anisotropy, c.anisotropy_direction) = (a.strength, [a.rotation.cos(), a.rotation.sin()]);
        out.anisotropy = read(&a.texture, false, a.strength > 0.0);
    }
    out.constant = c;
    out.varies = [
        out.specular,
        out.specular_color,
        out.transmission,
        out.thickness,
        out.clearcoat,
        out.clearcoat_roughness,
        out.clearcoat_normal,
        out.sheen_color,
        out.sheen_roughness,
        out.anisotropy,
    ]
    .iter()
    .any(Option::is_some);
    out
}

impl CompiledExtensions {
    fn read(&self, reader: &mut Reader<'_>) -> ExtensionSample {
        let mut s = self.constant;
        let mut at = |slot: Option<Slot>, f: &mut dyn FnMut(Vec4f)| {
            if let Some(slot) = slot {
                f(reader.read(slot));
            }
        };
        at(self.specular, &mut |t| s.specular *= t.w);
        at(self.specular_color, &mut |t| s.specular_color = s.specular_color.mul(t.xyz()));
        at(self.transmission, &mut |t| s.transmission *= t.x);
        at(self.thickness, &mut |t| s.thickness *= t.y);
        at(self.clearcoat, &mut |t| s.clearcoat *= t.x);
        at(self.clearcoat_roughness, &mut |t| s.clearcoat_roughness *= t.y);
        at(self.clearcoat_normal, &mut |t| s.clearcoat_normal = decode_normal(t, self.normal_scale));
        at(self.sheen_color, &mut |t| s.sheen_color = s.sheen_color.mul(t.xyz()));
        at(self.sheen_roughness, &mut |t| s.sheen_roughness *= t.w);
        at(self.anisotropy, &mut |t| {
            s.anisotropy *= t.z;
            s.anisotropy_direction = turned(s.anisotropy_direction, 2.0 * t.x - 1.0, 2.0 * t.y - 1.0);
        });
        s
    }
}

/// The direction of a texture, turned by the material's rotation.
fn turned([c, s]: [f32; 2], x: f32, y: f32) -> [f32; 2] {
    let length = x.hypot(y);
    if length > 1e-6 { [(c * x - s * y) / length, (s * x + c * y) / length] } else { [c, s] }
}

impl SurfaceLibrary {
    /// Whether a material has extensions that change how it scatters.
    ///
    /// # Panics
    /// If there is no such material.
    #[inline]
    pub fn has_extensions(&self, material: usize) -> bool {
        self.materials[material].extensions.is_some()
    }

    /// Whether some point of a material may let light pass.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn may_transmit(&self, material: usize) -> bool {
        let m = &self.materials[material];
        m.extensions.as_deref().is_some_and(|e| e.constant.transmission > 0.0)
    }

    /// Whether some point of a material may have an anisotropic lobe.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn may_be_anisotropic(&self, material: usize) -> bool {
        let m = &self.materials[material];
        m.extensions.as_deref().is_some_and(|e| e.constant.anisotropy > 0.0)
    }

    /// Whether some point of a material may have sheen.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn may_have_sheen(&self, material: usize) -> bool {
        let m = &self.materials[material];
        m.extensions.as_deref().is_some_and(|e| e.constant.sheen_color != Vec3f::zero())
    }

    /// What the extensions of a material are at texture coordinates; `None` at once for plain materials. Arguments are
    /// those of [`Self::lookup`].
    ///
    /// # Panics
    /// If there is no such material.
    #[inline]
    pub fn extensions(
        &self,
        material: usize,
        uv0: Vec2f,
        uv1: Vec2f,
        footprint: Option<&UvDerivatives>,
    ) -> Option<ExtensionSample> {
        let m: &Compiled = &self.materials[material];
        let extensions = m.extensions.as_deref()?;
        if !extensions.varies {
            return Some(extensions.constant);
        }
        let mut reader = Reader { library: self, material: m, uv: [uv0, uv1], footprint, last: None };
        Some(extensions.read(&mut reader))
    }
}
