//! What an asset alone says of a fit: the passes that its materials ask for, and what becomes of its data.

use crate::bake::Occlusion;
use crate::engine::classes::transmits;
use crate::engine::judge::visible_materials;
use crate::engine::plan::rows::{self, NO_STEPS};
use crate::engine::plan::{Item, Runs};
use photofit_scene::{AlphaMode, Material, Scene, TextureSlot};
use std::collections::BTreeSet;

/// What transparent materials are.
const THROUGH: &str = "are cut out, blended or let light pass";

/// What a light asset has of the asset's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LightSurface {
    /// Its own texture coordinates, materials and textures.
    Own,
    /// New maps.
    New,
    /// Colours of vertices.
    Colors,
    /// Its own or new maps: pictures decide.
    Open,
}

/// What the asset says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Asset {
    /// Materials of something visible.
    materials: usize,
    masked: usize,
    /// Blended, without those that let light pass.
    blended: usize,
    transmitting: usize,
    /// Cut out, blended or transmitting.
    through: usize,
    /// With directions of their own: a normal map, of a coat too, or anisotropy.
    directed: usize,
    metallic: usize,
    emitting: usize,
    unlit: usize,
    occluded: usize,
    volumes: usize,
    vertex_colors: bool,
    animations: usize,
    /// Whether there is each set of texture coordinates.
    uvs: [bool; 2],
    /// Images in the file.
    images: usize,
    /// Whether a material of something visible has a texture, whatever reads it.
    pub(super) textured: bool,
    /// The textures of all materials of something visible.
    slots: Vec<Slot>,
    /// Material extensions that are not fitted.
    extensions: Vec<&'static str>,
}

/// A texture of a material, and whether it is of occlusion.
#[derive(Clone, Debug, PartialEq)]
struct Slot {
    image: usize,
    set: u32,
    occlusion: bool,
}

impl Asset {
    pub(super) fn new(scene: &Scene) -> Self {
        let materials: Vec<&Material> =
            visible_materials(scene).into_iter().map(|m| &scene.materials[m]).collect();
        let count = |f: &dyn Fn(&Material) -> bool| materials.iter().filter(|m| f(m)).count();
        let with = |m: &Material, name: &str| !m.unlit && m.acting_extensions().contains(&name);
        let meshes = || scene.instances.iter().map(|i| &scene.primitives[i.primitive].mesh);
        // What lets light pass is drawn blended.
        let drawn = |m: &Material, name: &str| name == "transmission" && transmits(m);
        let lit = materials.iter().filter(|m| !m.unlit);
        let extensions: BTreeSet<&str> =
            lit.flat_map(|m| m.acting_extensions().into_iter().filter(|n| !drawn(m, n))).collect();
        Self {
            materials: materials.len(),
            masked: count(&|m| matches!(m.alpha_mode, AlphaMode::Mask { .. })),
            blended: count(&|m| m.alpha_mode == AlphaMode::Blend && !transmits(m)),
            transmitting: count(&|m| transmits(m)),
            through: count(&|m| m.alpha_mode != AlphaMode::Opaque || transmits(m)),
            directed: count(&Material::needs_tangents),
            metallic: count(&|m| m.metallic > 0.0 && !m.unlit),
            emitting: count(&|m| !m.unlit && m.emissive.iter().any(|e| *e > 0.0)),
            unlit: count(&|m| m.unlit),
            occluded: count(&|m| m.occlusion_texture.is_some()),
            volumes: count(&|m| with(m, "volume")),
            animations: scene.hierarchy.as_ref().map_or(0, |h| h.animations.len()),
            vertex_colors: meshes().any(|m| m.colors.iter().any(|c| c.to_array() != [1.0; 4])),
            uvs: [meshes().any(|m| !m.uvs.is_empty()), meshes().any(|m| !m.uvs1.is_empty())],
            images: scene.images.len(),
            textured: is_textured(scene),
            slots: materials.iter().flat_map(|m| slots(m)).collect(),
            extensions: extensions.into_iter().collect(),
        }
    }

    /// What the asset alone says of what a fit of so many steps does with a surface.
    pub(super) fn surface_items(&self, steps: Option<u64>, items: &mut Vec<Item>) {
        let mut item = |what, runs, why: String| items.push(Item { what, runs, why });
        self.alpha_items(steps, &mut item);
        let (runs, why) = match steps {
            None => (Runs::Open, "where the fit makes steps"),
            Some(0) => (Runs::No, NO_STEPS),
            Some(_) => (Runs::Yes, "the shape is fitted"),
        };
        item("position gradients", runs, why.into());
        let (runs, why) = match steps {
            None | Some(0) => (Runs::Open, "decided on the baked maps: flat ones are left out"),
            Some(_) => (Runs::Yes, "on a shape that moves, flat normals do not stay flat"),
        };
        item("normal map", runs, why.into());
        let (runs, why) = match self.metallic {
            0 => (Runs::No, "no material is metallic".into()),
            _ if steps == Some(0) => (Runs::No, NO_STEPS.into()),
            n => (Runs::Open, self.of(n, "may be metallic: decided on the baked maps")),
        };
        item("metalness gradients", runs, why);
        let (runs, why) = match self.emitting + self.unlit {
            0 => (Runs::No, "nothing emits".into()),
            n => (Runs::Open, self.of(n, "may emit or are unlit: decided on the baked maps")),
        };
        item("emission", runs, why);
    }

    /// Which surfaces light passes.
    fn alpha_items(&self, steps: Option<u64>, item: &mut dyn FnMut(&'static str, Runs, String)) {
        // Small and hidden parts may go.
        let (runs, why) = match self.through {
            0 => (Runs::No, rows::opaque()),
            n if n == self.materials => (Runs::Yes, self.of(n, THROUGH)),
            n => (Runs::Open, self.of(n, &format!("{THROUGH}: where parts of them are left"))),
        };
        item("transparent layers", runs, why);
        let fades = "masks fade in the steps, so that their outline is fitted";
        let alike = match (self.masked, self.blended) {
            (0, 0) if self.transmitting > 0 => {
                "nothing but what lets light pass is cut out or blended".into()
            }
            (0, 0) => "nothing is cut out or blended".into(),
            (0, n) => self.of(n, "are blended"),
            (n, 0) => self.of(n, &format!("are cut out: {fades}")),
            (m, n) => self.of(m + n, &format!("are cut out or blended: {fades}")),
        };
        let (runs, why) = match (self.masked + self.blended, steps) {
            (0, _) => (Runs::No, alike),
            (_, Some(0)) => (Runs::No, NO_STEPS.into()),
            (n, Some(_)) if n == self.materials => (Runs::Yes, alike),
            (_, Some(_)) => (Runs::Open, format!("{alike}; where parts of them are left")),
            (_, None) => (Runs::Open, alike),
        };
        item("alpha gradients", runs, why);
    }

    fn of(&self, n: usize, what: &str) -> String {
        format!("{n} of {} materials {what}", self.materials)
    }

    /// What is read of the asset's data, and what becomes of it.
    /// `occlusion` says where occlusion maps come from, if it is known, `whole` whether the asset is written as it was given.
    pub(super) fn data_items(
        &self,
        occlusion: Option<Occlusion>,
        surface: LightSurface,
        whole: bool,
        items: &mut Vec<Item>,
    ) {
        let mut item = |what, runs: bool, why: String| items.push(Item { what, runs: runs.into(), why });
        let some = |n: usize, what: &str, none: &str| if n > 0 { self.of(n, what) } else { none.to_owned() };
        item("unlit surfaces", self.unlit > 0, self.of(self.unlit, "show their base colour as it is"));
        let why = some(
            self.directed,
            "have a normal map, of their coat too, or are anisotropic",
            "no material has a normal map or is anisotropic",
        );
        item("reference tangents", self.directed > 0, why);
        let why = match (self.vertex_colors, surface) {
            (false, _) => "none, or none that is not white",
            (true, LightSurface::Own) => "read, and kept",
            (true, LightSurface::New | LightSurface::Colors) => "read, and baked into the base colour",
            (true, LightSurface::Open) => "read; where maps are new, baked into the base colour",
        };
        item(
            "animation",
            false,
            match self.animations {
                0 => "none".into(),
                n if whole => format!("{n} of the asset, which are written as they are"),
                n => format!("{n} of the asset, left out: the light asset stands as the asset does"),
            },
        );
        item("vertex colours", self.vertex_colors, why.into());
        self.texture_items(occlusion, surface, items);
        let mut item = |what, runs: bool, why: String| items.push(Item { what, runs: runs.into(), why });
        let why = some(
            self.transmitting,
            "let light pass: drawn blended, their alpha is not fitted",
            "no material lets light pass",
        );
        item("transmission", self.transmitting > 0, why);
        let none = "no material encloses one";
        let thickness = match surface {
            LightSurface::Own => " as it is",
            LightSurface::New | LightSurface::Colors => ", a textured thickness as its mean",
            LightSurface::Open => ", where maps are new a textured thickness as its mean",
        };
        item(
            "volumes",
            false,
            some(self.volumes, &format!("enclose one: kept{thickness}, not drawn while fitting"), none),
        );
        let how = match surface {
            LightSurface::Own => "kept as they are; not drawn by the rasterizer",
            LightSurface::New | LightSurface::Colors => {
                "kept, their textures as mean values; not drawn while fitting"
            }
            LightSurface::Open => {
                "kept; where maps are new, their textures as mean values; not drawn while fitting"
            }
        };
        let why = match &self.extensions[..] {
            [] => "none that the rasterizer does not draw".into(),
            names => format!("{}: {how}", names.join(", ")),
        };
        item("material extensions", false, why);
    }
}

impl Asset {
    /// Whether something reads such a texture. Baked occlusion comes from rays, and is no map of the asset's.
    fn reads(&self, occlusion: Option<Occlusion>, such: impl Fn(&Slot) -> bool) -> Runs {
        let mut slots = self.slots.iter().filter(|s| such(s));
        match (slots.clone().any(|s| !s.occlusion), slots.next(), occlusion) {
            (true, _, _) => Runs::Yes,
            (false, Some(_), None) => Runs::Open,
            (false, Some(_), Some(Occlusion::Maps)) => Runs::Yes,
            _ => Runs::No,
        }
    }

    /// Texture coordinates, textures and occlusion.
    fn texture_items(&self, occlusion: Option<Occlusion>, surface: LightSurface, items: &mut Vec<Item>) {
        const OCCLUSION: &str = "read where the options keep maps of occlusion";
        let mut item = |what, runs, why: String| items.push(Item { what, runs, why });
        let sets = [("texture coordinates 0", 0), ("texture coordinates 1", 1)];
        for ((what, set), there) in sets.into_iter().zip(self.uvs) {
            let read = self.reads(occlusion, |s| s.set == set);
            let why = match (there, read) {
                (true, Runs::Yes) => match surface {
                    LightSurface::Own => "read by textures, and kept",
                    LightSurface::New => "read by textures; an atlas has new ones",
                    LightSurface::Colors => "read by textures; colours of vertices need none",
                    LightSurface::Open => "read by textures; where maps are new, an atlas has new ones",
                },
                (true, Runs::Open) => OCCLUSION,
                (true, _) => "no texture reads them",
                (false, Runs::Yes) => "missing though a texture reads them: the texel at (0, 0) is shown",
                (false, _) => "none",
            };
            item(what, if there { read } else { Runs::No }, why.into());
        }
        let any = self.reads(occlusion, |_| true);
        let read = |image: &usize| self.reads(occlusion, |s| s.image == *image) == Runs::Yes;
        let why = match ((0..self.images).filter(read).count(), self.images) {
            (0, 0) => "none".into(),
            (0, _) if any == Runs::Open => OCCLUSION.into(),
            (0, n) => format!("none of {n} images is read"),
            (r, n) => {
                let kept = (0..n).filter(|i| self.reads(occlusion, |s| s.image == *i) == Runs::Open).count();
                let kept = if kept > 0 {
                    format!("; {kept} more where the options keep maps of occlusion")
                } else {
                    String::new()
                };
                format!("{r} of {n} images are read{kept}")
            }
        };
        item("textures", any, why);
        let some =
            |what: &str| if self.occluded > 0 { self.of(self.occluded, what) } else { "none".to_owned() };
        let carried = "have one: carried over, not drawn here, since they darken indirect light alone";
        let (runs, why) = match occlusion {
            None if self.occluded > 0 => {
                (Runs::Open, some("have one: carried over where the options keep them"))
            }
            None => (Runs::Open, "none; baked where the options say so".to_owned()),
            Some(Occlusion::Maps) if surface == LightSurface::Colors => {
                (Runs::No, some("have one: left out, colours of vertices hold none"))
            }
            Some(Occlusion::Maps) => ((self.occluded > 0).into(), some(carried)),
            Some(Occlusion::Rays(r)) => {
                (Runs::Yes, format!("baked by {} rays a texel, not drawn here", r.rays))
            }
            Some(Occlusion::None) => (Runs::No, "none, as asked".to_owned()),
        };
        item("occlusion textures", runs, why);
    }
}

/// Whether a material of something visible has a texture.
pub(in crate::simplify) fn is_textured(scene: &Scene) -> bool {
    visible_materials(scene).into_iter().any(|m| scene.materials[m].texture_slots().next().is_some())
}

/// The textures of a material: the fit reads those of its core and of occlusion, and the mean values of those of extensions.
fn slots(m: &Material) -> Vec<Slot> {
    let of = |occlusion| move |s: &TextureSlot| Slot { image: s.image, set: s.tex_coord, occlusion };
    let lit = [&m.metallic_roughness_texture, &m.normal_texture, &m.emissive_texture];
    let lit = lit.into_iter().flatten().chain(m.extensions.iter().flat_map(|e| e.textures().map(|(_, s)| s)));
    let drawn = m.base_color_texture.iter().chain(lit.filter(|_| !m.unlit)).map(of(false));
    drawn.chain(m.occlusion_texture.iter().map(of(true))).collect()
}
