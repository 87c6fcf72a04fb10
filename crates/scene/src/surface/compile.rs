//! Materials with what does not depend on the point worked out, and the textures that they need.

use super::address::Address;
use super::extensions;
use super::{Compiled, Slot, SurfaceSample};
use crate::{AlphaMode, Filter, Material, Scene, TextureImage, TextureSlot};
use photofit_scalar::{Vec3f, vec3};
use photofit_texture::{MipLayout, MipRule, MipTexture, Texels};
use rayon::prelude::*;
use std::collections::HashMap;

/// How the bytes of a texture are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Encoding {
    /// The colour is sRGB (alpha never is).
    srgb: bool,
    /// Alpha is coverage.
    weighted: bool,
}

/// A texture to be built.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Want {
    image: usize,
    encoding: Encoding,
    mips: bool,
}

/// The textures that materials ask for.
#[derive(Debug, Default)]
pub(super) struct Wanted {
    textures: Vec<Want>,
    known: HashMap<(usize, Encoding), usize>,
}

impl Wanted {
    /// Index of the texture; one with more levels serves who needs fewer.
    fn texture(&mut self, want: Want) -> usize {
        let i = *self.known.entry((want.image, want.encoding)).or_insert_with(|| {
            self.textures.push(want);
            self.textures.len() - 1
        });
        self.textures[i].mips |= want.mips;
        i
    }

    /// The textures, in the order of their indices.
    pub(super) fn build(&self, scene: &Scene) -> Vec<MipTexture> {
        let build = |want: &Want| {
            let image = &scene.images[want.image];
            let layout = layout(image, want.mips);
            let rule = if want.encoding.weighted { MipTexture::COVERAGE } else { MipRule::Area };
            if !want.encoding.srgb && !image.texels16.is_empty() {
                return MipTexture::new(Texels::Unorm16(image.texels16.clone()), layout, rule);
            }
            let encoded = if want.encoding.srgb { Texels::Srgb8 } else { Texels::Unorm8 };
            if !want.mips || image.mips.is_empty() {
                return MipTexture::new(encoded(image.texels.clone()), layout, rule);
            }
            let mut texels = image.texels.clone();
            image.mips.iter().for_each(|level| texels.extend(level));
            MipTexture::with_levels(encoded(texels), layout, rule)
        };
        self.textures.par_iter().map(build).collect()
    }
}

/// The levels that lookups read: those of the image, where it has some of its own, else all.
fn layout(image: &TextureImage, mips: bool) -> MipLayout {
    let (width, height) = (image.width, image.height);
    match (mips, image.mips.len()) {
        (false, _) => MipLayout::base(width, height),
        (true, 0) => MipLayout::full(width, height),
        (true, own) => MipLayout::first(width, height, own + 1),
    }
}

pub(super) fn compile(scene: &Scene, m: &Material, occlusion: bool, wanted: &mut Wanted) -> Compiled {
    let mut addresses: Vec<Address> = Vec::new();
    let weighted = m.alpha_mode != AlphaMode::Opaque;
    let mut slot = |slot: &Option<TextureSlot>, srgb: bool, weighted: bool| {
        slot.as_ref().map(|s| {
            let image = &scene.images[s.image];
            let mips = s.sampler.filter == Filter::Trilinear;
            let texture =
                wanted.texture(Want { image: s.image, encoding: Encoding { srgb, weighted }, mips });
            let identity = s.transform == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let address = Address {
                set: usize::from(s.tex_coord == 1),
                transform: (!identity).then_some(s.transform),
                sampler: s.sampler,
                layout: layout(image, mips),
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
    let occlusion = slot(&lit(&m.occlusion_texture).filter(|_| occlusion), false, false);
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
        sides: photofit_shading::Sides::of(m.double_sided),
        normal_scale: m.normal_scale,
        addresses,
        base_color,
        metallic_roughness,
        normal,
        emissive,
        occlusion: occlusion.map(|slot| (slot, m.occlusion_strength)),
        extensions,
    }
}
