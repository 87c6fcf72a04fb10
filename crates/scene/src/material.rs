//! Materials: the metallic-roughness model of glTF 2.0.

use crate::Extensions;
pub use photofit_texture::{AlphaMode, Filter, Sampler, Wrap};

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSlot {
    /// Index into [`crate::Scene::images`].
    pub image: usize,
    /// How it is read.
    pub sampler: Sampler,
    /// Set of texture coordinates: 0 or 1.
    pub tex_coord: u32,
    /// `KHR_texture_transform` as two rows of an affine map: `u' = m[0] . (u, v, 1)`, `v' = m[1] . (u, v, 1)`.
    pub transform: [[f32; 3]; 2],
}

impl TextureSlot {
    /// An image by the default sampler, at the first set of texture coordinates as they are.
    pub fn new(image: usize) -> Self {
        let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Self { image, sampler: Sampler::default(), tex_coord: 0, transform }
    }
}

/// A metallic-roughness material; factors multiply their textures.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Linear base colour and alpha.
    pub base_color: [f32; 4],
    /// sRGB base colour texture (alpha linear).
    pub base_color_texture: Option<TextureSlot>,
    /// Metalness factor.
    pub metallic: f32,
    /// Perceptual roughness factor (GGX alpha is its square).
    pub roughness: f32,
    /// Linear texture: green = roughness, blue = metalness.
    pub metallic_roughness_texture: Option<TextureSlot>,
    /// Tangent-space normal texture (linear).
    pub normal_texture: Option<TextureSlot>,
    /// Scale of the x and y of the normal texture.
    pub normal_scale: f32,
    /// Linear texture: red = occlusion.
    pub occlusion_texture: Option<TextureSlot>,
    /// Strength of the occlusion.
    pub occlusion_strength: f32,
    /// Linear emitted radiance (`KHR_materials_emissive_strength` multiplied in).
    pub emissive: [f32; 3],
    /// sRGB emission texture.
    pub emissive_texture: Option<TextureSlot>,
    /// What alpha means.
    pub alpha_mode: AlphaMode,
    /// Both sides are shaded.
    pub double_sided: bool,
    /// `KHR_materials_unlit`: the base colour is shown as it is.
    pub unlit: bool,
    /// What extensions add; `None` for plain materials. The rasterizer and fits leave it out.
    pub extensions: Option<Box<Extensions>>,
    /// Application data of the file.
    pub extras: Option<serde_json::Value>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: [1.0; 4],
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            occlusion_texture: None,
            occlusion_strength: 1.0,
            emissive: [0.0; 3],
            emissive_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            extensions: None,
            extras: None,
        }
    }
}

impl Material {
    /// The extensions that change how it looks, by name without prefix: none of an unlit material, those alone whose factors leave something
    /// of them, and none of dielectrics where all of it is metal.
    pub fn acting_extensions(&self) -> Vec<&'static str> {
        let extensions = self.extensions.as_ref().filter(|_| !self.unlit);
        let mut out = extensions.map_or_else(Vec::new, |e| e.acting());
        out.retain(|name| !(self.is_metal() && ["specular", "ior", "transmission", "volume"].contains(name)));
        out
    }

    /// Whether light passes through its surface: where none does, as in metal, a volume means nothing.
    pub fn transmits(&self) -> bool {
        !self.unlit && !self.is_metal() && self.extensions.as_ref().is_some_and(|e| e.transmits())
    }

    /// Whether all of it is metal.
    fn is_metal(&self) -> bool {
        self.metallic >= 1.0 && self.metallic_roughness_texture.is_none()
    }

    /// The grey dielectric given to assets without a material: base colour 0.5, roughness 0.5.
    pub fn clay() -> Self {
        Self {
            name: "clay".into(),
            base_color: [0.5, 0.5, 0.5, 1.0],
            metallic: 0.0,
            roughness: 0.5,
            ..Self::default()
        }
    }

    /// Whether the surface has directions of its own, so that its mesh needs tangents: it has a normal map, of its clear coat
    /// too, or is anisotropic.
    pub fn needs_tangents(&self) -> bool {
        let coat = |e: &Extensions| e.clearcoat.as_ref().is_some_and(|c| c.normal_texture.is_some());
        let added = self.extensions.as_deref().is_some_and(|e| e.anisotropy.is_some() || coat(e));
        !self.unlit && (self.normal_texture.is_some() || added)
    }
}
