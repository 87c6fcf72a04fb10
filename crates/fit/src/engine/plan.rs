//! The plan: which passes a fit runs, which gradients flow, and why ("skip what a scene doesn't need").
//!
//! One value, filled in as facts become known: the asset, then the options, then the baked maps, then the phases. What
//! is printed says only what these facts say.

pub(crate) mod rows;

pub use rows::{Item, PlanRows, Runs};

use super::classes::transmits;
use super::judge::JudgeRenderer;
use super::loss::PictureLoss;
use super::reference::{ENERGY, ReferenceKind};
use super::surface::{coarse_rates, rates_of};
use super::trainer::Phase;
use super::views::Lighting;
use crate::bake::Occlusion;
use crate::candidate::Candidate;
use crate::simplify::{Surfacing, Written};
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::{CHANNELS, channel};
use photofit_scene::{AlphaMode, Material, Scene, TextureSlot};
use rows::{NO_STEPS, Work};
use std::collections::BTreeSet;
use std::fmt;

/// A sample that varies less than this over the baked maps is constant: one step of 8 bits.
const CONSTANT: f32 = 1.0 / 255.0;

/// What the asset says.
#[derive(Clone, Debug, PartialEq)]
struct Asset {
    /// Materials of something visible.
    materials: usize,
    masked: usize,
    blended: usize,
    transmitting: usize,
    /// Cut out, blended or transmitting.
    through: usize,
    normal_mapped: usize,
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

/// What the options say.
#[derive(Clone, Debug, PartialEq)]
struct Choices {
    /// Steps that are made at most.
    steps: u64,
    /// Positions move in them.
    positions: bool,
    /// What pictures of the reference are.
    reference: ReferenceKind,
    /// Views under an environment map: none, every other, all.
    environment: &'static str,
}

/// What the baked maps say.
#[derive(Clone, Debug, PartialEq)]
struct Maps {
    layers: usize,
    /// The outlines of masks are fitted: they fade in the steps.
    fades: bool,
    fitted: [bool; CHANNELS],
    /// Coarse mip levels have texels of their own.
    free_mips: bool,
}

/// Who draws the pictures of a judgement, why, and how many there are.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// All pictures are path traced.
    pub traced: bool,
    /// What the options ask for.
    pub renderer: JudgeRenderer,
    /// What pictures of the asset are in the fit.
    pub reference: ReferenceKind,
    /// A fit of the maps through the path tracer is asked for.
    pub traced_maps: bool,
    /// What of the asset's materials the rasterizer lacks.
    pub beyond: Vec<&'static str>,
    /// Pictures of all views, of the asset and of what is compared with it, at most.
    pub pictures: u64,
    /// Width and height of each where it is path traced, pixels.
    pub side: usize,
    /// Samples of a path traced pixel.
    pub spp: u32,
}

impl Judgement {
    /// Whether the path tracer draws, and why, with the samples that it takes at most.
    pub fn item(&self) -> Item {
        let Self { pictures, side, spp, .. } = self;
        let names = self.beyond.join(", ");
        let shadows = self.reference.indirect_light;
        let million = (pictures * (side * side) as u64 * u64::from(*spp)) as f64 / 1e6;
        let why = match (self.traced, self.renderer) {
            (true, JudgeRenderer::Path) if shadows => {
                "as asked; shadows that the fitted maps hold count twice".to_owned()
            }
            (true, JudgeRenderer::Path) => "as asked".to_owned(),
            (true, _) if self.traced_maps => "maps fitted through the path tracer are asked for".to_owned(),
            (true, _) => format!("the rasterizer does not draw {names}"),
            (false, JudgeRenderer::Raster) if self.traced_maps => {
                "as asked; shadows, which the path tracer fits maps to, are not in these pictures".to_owned()
            }
            (false, JudgeRenderer::Raster) if !self.beyond.is_empty() => {
                format!("as asked; {names} are not drawn")
            }
            (false, JudgeRenderer::Raster) => "as asked".to_owned(),
            (false, _) if shadows && !self.beyond.is_empty() => {
                format!(
                    "but for pictures of the asset, as in the fit, whose shadows the maps hold; {names} are not drawn"
                )
            }
            (false, _) if shadows => "but for pictures of the asset, as in the fit".to_owned(),
            (false, _) => "the rasterizer draws all materials".to_owned(),
        };
        let cost = format!(
            "at most {pictures} pictures of {side} x {side} pixels, {spp} samples each, {million:.0} million samples"
        );
        let cost = if self.traced { format!(": {cost}") } else { format!("; saved: {cost}") };
        Item { what: "path traced judgement", runs: self.traced.into(), why: why + &cost }
    }
}

/// What runs; printable and comparable.
#[derive(Clone, Debug, PartialEq)]
pub struct FitPlan {
    asset: Asset,
    choices: Option<Choices>,
    maps: Option<Maps>,
    /// The loss with the noise of the pictures that it was chosen by.
    loss: Option<(PictureLoss, Option<f64>)>,
    phases: Vec<String>,
    judgement: Option<Judgement>,
    /// Where the fit runs, and why there.
    device: Option<String>,
    /// Where occlusion maps come from.
    occlusion: Occlusion,
    /// What the light asset has in place of the asset's surface.
    surfacing: Surfacing,
    /// Smallest and largest picture that mip levels with texels of their own are fitted to, pixels.
    mips: Option<[usize; 2]>,
    /// Shares of pixels and of views that show the backs of single-sided surfaces.
    backs: Option<(f64, f32)>,
    /// Whether outlines count in where triangles are.
    outline: Option<Item>,
    /// Triangles of the asset that nobody sees, and all.
    unseen: Option<[usize; 2]>,
    /// Whether maps are fitted through the path tracer, where that is asked for.
    traced_maps: Option<Item>,
    /// What came of it.
    result: Option<Ended>,
}

/// What a fit came to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ended {
    written: Written,
    /// Steps made.
    steps: u64,
}

/// What a light asset has of the asset's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Dress {
    /// Its own texture coordinates, materials and textures.
    Own,
    /// New maps.
    New,
    /// Colours of vertices.
    Colors,
    /// Its own or new maps: pictures decide.
    Open,
}

impl FitPlan {
    /// What the asset alone says.
    pub fn new(scene: &Scene) -> Self {
        Self {
            asset: Asset::new(scene),
            choices: None,
            maps: None,
            loss: None,
            phases: Vec::new(),
            judgement: None,
            device: None,
            occlusion: Occlusion::default(),
            surfacing: Surfacing::default(),
            mips: None,
            backs: None,
            outline: None,
            unseen: None,
            traced_maps: None,
            result: None,
        }
    }

    /// Adds the options: steps of the fit, what pictures of the reference are, and the light.
    #[must_use]
    pub fn with_options(self, steps: u64, reference: ReferenceKind, lighting: &Lighting) -> Self {
        let environment = match lighting {
            Lighting::Mixed => "every other view",
            Lighting::Point => "",
            Lighting::Environment(_) => "every view",
        };
        let positions = steps > 0;
        Self { choices: Some(Choices { steps, positions, reference, environment }), ..self }
    }

    /// The shape stays; only maps are fitted. After [`Self::with_options`].
    #[must_use]
    pub fn with_fixed_shape(mut self) -> Self {
        self.choices.iter_mut().for_each(|c| c.positions = false);
        self
    }

    /// Adds what the baked maps of the start say.
    #[must_use]
    pub fn with_maps(self, candidate: &Candidate) -> Self {
        let shadows = self.holds_shadows();
        let base = &candidate.maps.levels[0].texels;
        let any = |c: usize, f: &dyn Fn(f32) -> bool| base.iter().any(|t| f(t[c]));
        let used = |mode: fn(&AlphaMode) -> bool| {
            candidate.class.iter().any(|c| mode(&candidate.classes[*c as usize].alpha))
        };
        let blend = used(|m| *m == AlphaMode::Blend);
        let mask = used(|m| matches!(m, AlphaMode::Mask { .. }));
        let varies = |c: usize| {
            let (lo, hi) = base.iter().fold((f32::MAX, f32::MIN), |(lo, hi), t| (lo.min(t[c]), hi.max(t[c])));
            hi - lo > CONSTANT
        };
        let metallic = any(channel::METALLIC, &|x| x > 0.02);
        let mut fitted = [false; CHANNELS];
        fitted[..3].fill(shadows || (0..3).any(varies));
        // Alpha of glass is drawn, but not written: it must not move.
        let glass = blend && self.asset.blended == 0;
        fitted[channel::ALPHA] = !glass && (blend || mask);
        let fades = mask && fitted[channel::ALPHA];
        fitted[channel::ROUGHNESS] = varies(channel::ROUGHNESS);
        fitted[channel::METALLIC] = metallic && varies(channel::METALLIC);
        let bent = (0..2).any(|k| any(channel::NORMAL + k, &|x| x.abs() > CONSTANT));
        // On a shape that moves, flat maps do not stay flat.
        let moves = self.choices.as_ref().is_none_or(|c| c.positions);
        fitted[channel::NORMAL..channel::NORMAL + 3].fill(bent || moves);
        let emissive = (0..3).any(|k| any(channel::EMISSIVE + k, &|x| x > 1e-4));
        fitted[channel::EMISSIVE..channel::EMISSIVE + 3].fill(emissive);
        let layers = if blend || mask { Passes::default().max_layers } else { 1 };
        let free_mips = candidate.fitted_levels() > 1;
        Self { maps: Some(Maps { layers, fades, fitted, free_mips }), ..self }
    }

    /// Adds how the result is judged.
    #[must_use]
    pub fn with_judgement(self, judgement: Judgement) -> Self {
        Self { judgement: Some(judgement), ..self }
    }

    /// Adds the loss and the noise that it was chosen by.
    #[must_use]
    pub fn with_loss(self, loss: PictureLoss, noise: Option<f64>) -> Self {
        Self { loss: Some((loss, noise)), ..self }
    }

    /// Adds where the fit runs and why; nothing is told without it.
    #[must_use]
    pub fn with_device(self, device: Option<String>) -> Self {
        Self { device, ..self }
    }

    /// Adds where occlusion maps come from; without it from those of the asset.
    #[must_use]
    pub fn with_occlusion(self, occlusion: Occlusion) -> Self {
        Self { occlusion, ..self }
    }

    /// Adds what the light asset has in place of the asset's surface; without it new maps.
    #[must_use]
    pub fn with_surfacing(self, surfacing: Surfacing) -> Self {
        Self { surfacing, ..self }
    }

    /// Adds the sizes that mip levels with texels of their own are fitted to; nothing is told without.
    #[must_use]
    pub fn with_mips(self, mips: Option<[usize; 2]>) -> Self {
        Self { mips, ..self }
    }

    /// Adds the share of the asset's pixels that the backs of single-sided surfaces change, where it is measured, and of the
    /// views that show them; nothing is told without.
    #[must_use]
    pub fn with_backs(self, seen: Option<f64>, share: f32) -> Self {
        Self { backs: seen.map(|seen| (seen, share)), ..self }
    }

    /// Adds whether outlines count in where triangles are; nothing is told without.
    #[must_use]
    pub(crate) fn with_outline(self, outline: Item) -> Self {
        Self { outline: Some(outline), ..self }
    }

    /// Adds how many triangles of the asset nobody sees, of all; nothing is told without.
    #[must_use]
    pub(crate) fn with_unseen(self, unseen: [usize; 2]) -> Self {
        Self { unseen: Some(unseen), ..self }
    }

    /// Adds whether maps are fitted through the path tracer; nothing is told without.
    #[must_use]
    pub(crate) fn with_traced_maps(self, row: Option<Item>) -> Self {
        Self { traced_maps: row, ..self }
    }

    /// Adds what the fit came to: what was written, the steps that were made, and whether maps were fitted through the path
    /// tracer.
    #[must_use]
    pub(crate) fn with_result(self, written: Written, steps: u64, traced_maps: Option<Item>) -> Self {
        Self { traced_maps, result: Some(Ended { written, steps }), ..self }
    }

    /// Adds the phases of the fit.
    #[must_use]
    pub fn with_phases<M>(self, phases: &[Phase<'_, M>]) -> Self {
        Self { phases: rows::phases(phases), ..self }
    }

    /// Whether each sample of a texel is fitted; one that is the same everywhere in the baked maps is not. None is
    /// before these are known.
    pub fn fitted(&self) -> [bool; CHANNELS] {
        self.maps.as_ref().map_or([false; CHANNELS], |m| m.fitted)
    }

    /// The passes of the renderer; everything that may run, before the maps are known.
    pub fn passes(&self) -> Passes {
        let positions = self.choices.as_ref().is_none_or(|c| c.positions);
        let steps = self.choices.as_ref().is_none_or(|c| c.steps > 0);
        let Some(m) = &self.maps else { return Passes::default() };
        Passes {
            masks: Masks::Cut,
            alpha_gradients: m.fitted[channel::ALPHA],
            normal_map: m.fitted[channel::NORMAL],
            emissive: m.fitted[channel::EMISSIVE],
            // Blended silhouettes are there for the gradients of positions.
            antialias: positions,
            max_layers: m.layers,
            position_gradients: positions,
            map_gradients: steps && m.fitted.contains(&true),
            energy: ENERGY,
        }
    }

    /// Whether the outlines of masks are fitted, so that masks fade in the steps.
    pub fn fades(&self) -> bool {
        self.maps.as_ref().is_some_and(|m| m.fades)
    }

    /// Whether shadows and light between surfaces go into the maps of what is fitted.
    pub(crate) fn holds_shadows(&self) -> bool {
        self.choices.as_ref().is_some_and(|c| c.reference.indirect_light)
    }

    /// Everything that runs, is skipped, or is not decided yet. Once the maps are known, what the fit does is told by its
    /// passes and rates.
    pub fn items(&self) -> Vec<Item> {
        let mut items = Vec::new();
        match self.surfacing {
            Surfacing::Maps => {}
            Surfacing::Kept => {
                let why =
                    "triangles alone are fewer; texture coordinates, materials and textures stay".to_owned();
                items.push(Item { what: "own surface", runs: Runs::Yes, why });
            }
            Surfacing::VertexColors => {
                let why = "fitted maps become colours of vertices and factors of materials; normal maps are left out".to_owned();
                items.push(Item { what: "colours of vertices", runs: Runs::Yes, why });
            }
        }
        if self.surfacing != Surfacing::Kept {
            items.extend(self.result.map(|r| written(r.written, r.steps)));
            let steps = self.choices.as_ref().zip(self.result).filter(|(c, _)| c.steps > 0);
            items.extend(steps.map(|(c, r)| rows::steps(r.steps, c.steps)));
            items.extend(self.unseen.map(rows::unseen));
            items.extend(self.surface_items());
        }
        self.asset.data_items(self.occlusion, self.dress(), &mut items);
        self.option_items(&mut items);
        items.extend(self.traced_maps.clone());
        items.extend(self.judgement.as_ref().map(Judgement::item));
        items.extend(self.backs.map(|(seen, share)| rows::backs(seen, share)));
        items.extend(self.outline.clone());
        items.extend(self.mips.map(rows::free_mips));
        items.extend(self.device.clone().map(rows::device));
        items
    }

    /// What the fit does with a surface: what the asset alone says, once the maps are known what its passes and rates say.
    fn surface_items(&self) -> Vec<Item> {
        let Some(maps) = &self.maps else {
            let mut items = Vec::new();
            self.asset_items(&mut items);
            return items;
        };
        let rates = rates_of(maps.fitted);
        let coarse = maps.free_mips.then(|| coarse_rates(rates));
        let moves = self.choices.as_ref().is_none_or(|c| c.positions);
        rows::surface(&Work { passes: self.passes(), rates, coarse, moves, steps: !self.is_still() })
    }

    /// What the light asset has of the asset's surface, as far as it is known.
    fn dress(&self) -> Dress {
        match (self.surfacing, self.result.map(|r| r.written)) {
            (Surfacing::Kept, _) | (_, Some(Written::Decimated | Written::Kept)) => Dress::Own,
            (Surfacing::VertexColors, _) => Dress::Colors,
            (Surfacing::Maps, Some(_)) => Dress::New,
            (Surfacing::Maps, None) => Dress::Open,
        }
    }

    /// Whether no steps are made: the options ask for none, or it came to none.
    fn is_still(&self) -> bool {
        self.choices.as_ref().is_some_and(|c| c.steps == 0) || self.result.is_some_and(|r| r.steps == 0)
    }

    /// What the asset alone says of the passes of a fit.
    fn asset_items(&self, items: &mut Vec<Item>) {
        let a = &self.asset;
        let mut item = |what, runs, why: String| items.push(Item { what, runs, why });
        items_of_alpha(a, self.is_still(), &mut item);
        let still = self.is_still().then_some((Runs::No, NO_STEPS.to_owned()));
        let (runs, why) = match &self.choices {
            _ if self.is_still() => (Runs::No, NO_STEPS.to_owned()),
            Some(c) if c.positions => (Runs::Yes, "the shape is fitted".into()),
            Some(_) => (Runs::No, "the shape stays".into()),
            None => (Runs::Open, "where the fit makes steps".into()),
        };
        item("position gradients", runs, why);
        item("normal map", Runs::Open, "decided on the baked maps: flat ones are left out".into());
        let (runs, why) = match a.metallic {
            0 => (Runs::No, "no material is metallic".into()),
            n => still.unwrap_or((Runs::Open, a.of(n, "may be metallic: decided on the baked maps"))),
        };
        item("metalness gradients", runs, why);
        let (runs, why) = match a.emitting + a.unlit {
            0 => (Runs::No, "nothing emits".into()),
            n => (Runs::Yes, a.of(n, "emit or are unlit")),
        };
        item("emission", runs, why);
    }

    fn option_items(&self, items: &mut Vec<Item>) {
        let mut item = |what, runs, why: String| items.push(Item { what, runs, why });
        match &self.choices {
            None => {
                item("environment light", Runs::Open, "as the options say".into());
                item("indirect light", Runs::Open, "where pictures of the reference are path traced".into());
            }
            Some(c) => {
                let (runs, why) = match c.environment {
                    "" => (Runs::No, "point lights and a constant surrounding"),
                    views => (Runs::Yes, views),
                };
                item("environment light", runs, why.into());
                let (mut runs, mut why) = (
                    c.reference.indirect_light,
                    format!("pictures of the reference are {}", c.reference.name),
                );
                if self.traced_maps.as_ref().is_some_and(|row| row.runs == Runs::Yes) {
                    (runs, why) = (true, why + "; those that the path tracer fits maps to are path traced");
                }
                item("indirect light", runs.into(), why);
            }
        }
        if let Some((loss, noise)) = self.loss {
            items.push(rows::loss(loss, noise));
        }
    }
}

impl Asset {
    fn new(scene: &Scene) -> Self {
        let used: BTreeSet<usize> =
            scene.instances.iter().map(|i| scene.primitives[i.primitive].material).collect();
        let materials: Vec<&Material> = used.iter().map(|m| &scene.materials[*m]).collect();
        let count = |f: &dyn Fn(&Material) -> bool| materials.iter().filter(|m| f(m)).count();
        let with = |m: &Material, name: &str| !m.unlit && names(m).contains(&name);
        let meshes = || scene.instances.iter().map(|i| &scene.primitives[i.primitive].mesh);
        // What lets light pass is drawn blended.
        let drawn = |m: &Material, name: &str| name == "transmission" && transmits(m);
        let lit = materials.iter().filter(|m| !m.unlit);
        let extensions: BTreeSet<&str> =
            lit.flat_map(|m| names(m).into_iter().filter(|n| !drawn(m, n))).collect();
        Self {
            materials: materials.len(),
            masked: count(&|m| matches!(m.alpha_mode, AlphaMode::Mask { .. })),
            blended: count(&|m| m.alpha_mode == AlphaMode::Blend),
            transmitting: count(&|m| transmits(m)),
            through: count(&|m| m.alpha_mode != AlphaMode::Opaque || transmits(m)),
            normal_mapped: count(&|m| m.normal_texture.is_some() && !m.unlit),
            metallic: count(&|m| m.metallic > 0.0 && !m.unlit),
            emitting: count(&|m| !m.unlit && m.emissive.iter().any(|e| *e > 0.0)),
            unlit: count(&|m| m.unlit),
            occluded: count(&|m| m.occlusion_texture.is_some()),
            volumes: count(&|m| with(m, "volume")),
            animations: scene.hierarchy.as_ref().map_or(0, |h| h.animations.len()),
            vertex_colors: meshes().any(|m| !m.colors.is_empty()),
            uvs: [meshes().any(|m| !m.uvs.is_empty()), meshes().any(|m| !m.uvs1.is_empty())],
            images: scene.images.len(),
            slots: materials.iter().flat_map(|m| slots(m)).collect(),
            extensions: extensions.into_iter().collect(),
        }
    }

    fn of(&self, n: usize, what: &str) -> String {
        format!("{n} of {} materials {what}", self.materials)
    }

    fn data_items(&self, occlusion: Occlusion, dress: Dress, items: &mut Vec<Item>) {
        let mut item = |what, runs: bool, why: String| items.push(Item { what, runs: runs.into(), why });
        let some = |n: usize, what: &str, none: &str| if n > 0 { self.of(n, what) } else { none.to_owned() };
        item("unlit surfaces", self.unlit > 0, self.of(self.unlit, "show their base colour as it is"));
        let why = some(self.normal_mapped, "have a normal map", "no material has a normal map");
        item("reference tangents", self.normal_mapped > 0, why);
        let why = match (self.vertex_colors, dress) {
            (false, _) => "none",
            (true, Dress::Own) => "read, and kept",
            (true, Dress::New | Dress::Colors) => "read, and baked into the base colour",
            (true, Dress::Open) => "read; where maps are new, baked into the base colour",
        };
        item(
            "animation",
            false,
            match self.animations {
                0 => "none".into(),
                n => format!("{n} of the asset: it is fitted as it stands"),
            },
        );
        item("vertex colours", self.vertex_colors, why.into());
        // Baked occlusion comes from rays, and is no map of the asset's.
        let read = || self.slots.iter().filter(|s| !s.occlusion || occlusion == Occlusion::Maps);
        let sets = [("texture coordinates 0", 0), ("texture coordinates 1", 1)];
        for ((what, set), there) in sets.into_iter().zip(self.uvs) {
            let read = read().any(|s| s.set == set);
            let why = match (there, read) {
                (true, true) => match dress {
                    Dress::Own => "read by textures, and kept",
                    Dress::New => "read by textures; an atlas has new ones",
                    Dress::Colors => "read by textures; colours of vertices need none",
                    Dress::Open => "read by textures; where maps are new, an atlas has new ones",
                },
                (true, false) => "no texture reads them",
                (false, true) => "missing though a texture reads them: the texel at (0, 0) is shown",
                (false, false) => "none",
            };
            item(what, there && read, why.into());
        }
        let images: BTreeSet<usize> = read().map(|s| s.image).collect();
        let why = match (images.len(), self.images) {
            (0, 0) => "none".into(),
            (0, n) => format!("none of {n} images is read"),
            (r, n) => format!("{r} of {n} images are read"),
        };
        item("textures", !images.is_empty(), why);
        let why = "have one: carried over, not drawn here, since they darken indirect light alone";
        let (runs, why) = match occlusion {
            Occlusion::Maps => (self.occluded > 0, some(self.occluded, why, "none")),
            Occlusion::Rays(r) => (true, format!("baked by {} rays a texel, not drawn here", r.rays)),
            Occlusion::Open => (false, "none, as asked".to_owned()),
        };
        item("occlusion textures", runs, why);
        let why = some(
            self.transmitting,
            "let light pass: drawn blended, their alpha is not fitted",
            "no material lets light pass",
        );
        item("transmission", self.transmitting > 0, why);
        let none = "no material encloses one";
        item(
            "volumes",
            false,
            some(self.volumes, "enclose one: kept as it is, not drawn while fitting", none),
        );
        let how = match dress {
            Dress::Own => "kept as they are; not drawn by the rasterizer",
            Dress::New | Dress::Colors => "kept, their textures as mean values; not drawn while fitting",
            Dress::Open => "kept; where maps are new, their textures as mean values; not drawn while fitting",
        };
        let why = match &self.extensions[..] {
            [] => "none".into(),
            names => format!("{}: {how}", names.join(", ")),
        };
        item("material extensions", false, why);
    }
}

/// The row of what is written, after so many steps.
fn written(written: Written, steps: u64) -> Item {
    let why = match written {
        Written::Fitted if steps == 0 => "what the fit was to start from",
        Written::Fitted => "what was fitted",
        Written::Rebaked => "the fitted shape, its maps baked anew",
        Written::Wrapped => "the start that was drawn onto the asset's surface",
        Written::Baked => "the decimated start with baked maps",
        Written::Decimated => "the decimated asset with its own materials",
        Written::Kept => "the asset's own surface on fewer triangles",
    };
    Item { what: "written asset", runs: Runs::Yes, why: why.into() }
}

/// Which surfaces light passes, as the asset says.
fn items_of_alpha(a: &Asset, still: bool, item: &mut dyn FnMut(&'static str, Runs, String)) {
    let why = match a.through {
        0 => rows::opaque(),
        n => a.of(n, "are cut out, blended or let light pass"),
    };
    item("transparent layers", (a.through > 0).into(), why);
    let fades = "masks fade in the steps, so that their outline is fitted";
    let why = match (a.masked, a.blended) {
        (0, 0) => "nothing is cut out or blended".into(),
        _ if still => NO_STEPS.into(),
        (_, 0) if a.transmitting > 0 => {
            "what lets light pass is drawn blended, and its alpha is not fitted".into()
        }
        (0, n) => a.of(n, "are blended"),
        (n, 0) => a.of(n, &format!("are cut out: {fades}")),
        (m, n) => a.of(m + n, &format!("are cut out or blended: {fades}")),
    };
    let runs = !still && a.masked + a.blended > 0 && (a.blended > 0 || a.transmitting == 0);
    item("alpha gradients", runs.into(), why);
}

/// Extensions of a material, without their prefix.
fn names(m: &Material) -> Vec<&'static str> {
    m.extensions.as_ref().map_or_else(Vec::new, |e| e.acting())
}

/// The textures of a material: the fit reads those of its core and of occlusion, and the mean values of those of extensions.
fn slots(m: &Material) -> Vec<Slot> {
    let of = |occlusion| move |s: &TextureSlot| Slot { image: s.image, set: s.tex_coord, occlusion };
    let lit = [&m.metallic_roughness_texture, &m.normal_texture, &m.emissive_texture];
    let lit = lit.into_iter().flatten().chain(m.extensions.iter().flat_map(|e| e.textures().map(|(_, s)| s)));
    let drawn = m.base_color_texture.iter().chain(lit.filter(|_| !m.unlit)).map(of(false));
    drawn.chain(m.occlusion_texture.iter().map(of(true))).collect()
}

impl From<&FitPlan> for PlanRows {
    fn from(plan: &FitPlan) -> Self {
        // Of a fit that came to no step no phase began.
        let ran = plan.result.is_none_or(|r| r.steps > 0);
        Self { items: plan.items(), phases: if ran { plan.phases.clone() } else { Vec::new() } }
    }
}

impl fmt::Display for FitPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&PlanRows::from(self), f)
    }
}

#[cfg(test)]
mod tests;
