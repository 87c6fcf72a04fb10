//! The plan of the main job: which passes run, which gradients flow, what is written, and why.
//!
//! One value, filled in as facts become known: the asset, then the options, then the baked maps, then the phases, then the
//! result. What is printed says only what these facts say.

mod asset;
mod judgement;

pub(super) use asset::is_textured;
pub use judgement::Judgement;

use super::{Appearance, Written};
use crate::bake::Occlusion;
use crate::engine::judge::Certainty;
use crate::engine::loss::PictureLoss;
use crate::engine::plan::rows::{PhaseRow, Unseen};
use crate::engine::plan::{Item, PlanRows, Runs, SurfacePlan, rows};
use crate::engine::reference::ReferenceKind;
use crate::engine::trainer::Phase;
use crate::engine::views::Lighting;
use asset::{Asset, LightSurface};
use photofit_scene::{Compression, Scene};
use std::fmt;

/// What the options say.
#[derive(Clone, Debug, PartialEq)]
struct Choices {
    /// Steps that are made at most.
    steps: u64,
    /// Why none are made, where they were asked for.
    why_none: Option<&'static str>,
    /// What pictures of the reference are.
    reference: ReferenceKind,
    /// Views under an environment map: none, every other, all.
    environment: &'static str,
}

/// What runs; printable and comparable.
#[derive(Clone, Debug, PartialEq)]
pub struct FitPlan {
    asset: Asset,
    choices: Option<Choices>,
    maps: Option<SurfacePlan>,
    /// The loss with the noise of the pictures that it was chosen by.
    loss: Option<(PictureLoss, Option<f64>)>,
    phases: Vec<PhaseRow>,
    judgement: Option<Judgement>,
    /// Where the fit runs, and why there.
    device: Option<String>,
    /// Where occlusion maps come from.
    occlusion: Option<Occlusion>,
    /// What the light asset has in place of the asset's surface.
    appearance: Option<Appearance>,
    /// Whether the asset's own materials may be written.
    may_be_own: Option<bool>,
    /// Smallest and largest picture that mip levels with texels of their own are fitted to, pixels.
    mips: Option<[usize; 2]>,
    /// Shares of pixels and of views that show the backs of single-sided surfaces.
    backs: Option<(f64, f32)>,
    /// Whether outlines count in where triangles are.
    outline: Option<Item>,
    /// Triangles of the asset that nobody sees.
    unseen: Option<Unseen>,
    /// Whether maps are fitted through the path tracer, where that is asked for.
    traced_maps: Option<Item>,
    /// Triangles of the asset and of the written file.
    triangles: Option<[usize; 2]>,
    /// How the asset with its own surface was decimated, where that is written.
    decimation: Option<Item>,
    /// Bytes that the file may have, and what came of it.
    bytes: Option<Item>,
    /// How many triangles follow from bytes, where they do.
    counted: Option<Item>,
    /// Which vertices stayed where they are, where some were to.
    locked: Option<Item>,
    /// What came of it.
    result: Option<Ended>,
}

/// What a fit came to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ended {
    written: Written,
    /// Whether its maps were fitted once more through the path tracer.
    traced: bool,
    /// Steps made.
    steps: u64,
    /// The step up to which it came.
    reached: u64,
    /// By how many dB it was behind the asset's own materials when it ended early for that.
    behind: Option<f64>,
    /// How sure the choice of what is written is.
    choice: Option<Certainty>,
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
            occlusion: None,
            appearance: None,
            may_be_own: None,
            mips: None,
            backs: None,
            outline: None,
            unseen: None,
            traced_maps: None,
            triangles: None,
            decimation: None,
            bytes: None,
            counted: None,
            locked: None,
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
        Self { choices: Some(Choices { steps, why_none: None, reference, environment }), ..self }
    }

    /// Adds to the options why no steps are made though some are asked for.
    #[must_use]
    pub(crate) fn without_steps(self, why_none: Option<&'static str>) -> Self {
        Self { choices: self.choices.map(|c| Choices { why_none, ..c }), ..self }
    }

    /// Adds what the baked maps of the start say.
    #[must_use]
    pub fn with_maps(self, maps: SurfacePlan) -> Self {
        Self { maps: Some(maps), ..self }
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

    /// Adds where occlusion maps come from; it is told once [`Self::with_appearance`] is known, too.
    #[must_use]
    pub fn with_occlusion(self, occlusion: Occlusion) -> Self {
        Self { occlusion: Some(occlusion), ..self }
    }

    /// Adds what the light asset has in place of the asset's surface.
    #[must_use]
    pub fn with_appearance(self, appearance: Appearance) -> Self {
        Self { appearance: Some(appearance), ..self }
    }

    /// Adds whether the asset's own materials may be written.
    #[must_use]
    pub(crate) fn with_own_materials(self, may: bool) -> Self {
        Self { may_be_own: Some(may), ..self }
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

    /// Adds how many triangles of the asset nobody sees, where the start is decimated from it.
    #[must_use]
    pub(crate) fn with_unseen(self, unseen: Option<Unseen>) -> Self {
        Self { unseen, ..self }
    }

    /// Adds whether maps are fitted through the path tracer; nothing is told without.
    #[must_use]
    pub(crate) fn with_traced_maps(self, row: Option<Item>) -> Self {
        Self { traced_maps: row, ..self }
    }

    /// Adds what the fit came to: what was written, the steps that were made, the step up to which it came ([`Trained::reached`]),
    /// and whether maps were fitted through the path tracer and are in what was written.
    ///
    /// [`Trained::reached`]: crate::engine::trainer::Trained::reached
    #[must_use]
    pub(crate) fn with_result(
        self,
        written: Written,
        [steps, reached]: [u64; 2],
        (traced_maps, traced): (Option<Item>, bool),
    ) -> Self {
        Self {
            traced_maps,
            result: Some(Ended { written, traced, steps, reached, behind: None, choice: None }),
            ..self
        }
    }

    /// Adds the triangles of the asset and of the written file.
    #[must_use]
    pub(crate) fn with_triangles(self, triangles: [usize; 2]) -> Self {
        Self { triangles: Some(triangles), ..self }
    }

    /// Adds how the asset with its own surface was decimated; nothing is told without.
    #[must_use]
    pub(crate) fn with_decimation(self, decimation: Option<Item>) -> Self {
        Self { decimation, ..self }
    }

    /// Adds how many triangles follow from bytes; nothing is told without.
    #[must_use]
    pub(crate) fn with_counted(self, counted: Option<Item>) -> Self {
        Self { counted, ..self }
    }

    /// Adds which vertices stayed where they are; nothing is told without.
    #[must_use]
    pub(crate) fn with_locked(self, locked: Option<Item>) -> Self {
        Self { locked, ..self }
    }

    /// Adds the bytes that the file may have and, once it is written, those that it has, how its textures and its geometry are stored;
    /// nothing is told without.
    #[must_use]
    pub(crate) fn with_bytes(self, most: Option<u64>, file: Option<(u64, &str, Compression)>) -> Self {
        Self { bytes: most.map(|most| rows::bytes(most, file)), ..self }
    }

    /// Adds to the result by how many dB the fit was behind the asset's own materials, where it ended early for that.
    #[must_use]
    pub(crate) fn with_behind(self, behind: Option<f64>) -> Self {
        Self { result: self.result.map(|r| Ended { behind, ..r }), ..self }
    }

    /// Adds to the result how sure its choice is.
    #[must_use]
    pub(crate) fn with_choice(self, choice: Option<Certainty>) -> Self {
        Self { result: self.result.map(|r| Ended { choice, ..r }), ..self }
    }

    /// Adds the phases of the fit.
    #[must_use]
    pub fn with_phases<M>(self, phases: &[Phase<'_, M>]) -> Self {
        Self { phases: rows::phases(phases), ..self }
    }

    /// Whether shadows and light between surfaces go into the maps of what is fitted.
    pub(crate) fn holds_shadows(&self) -> bool {
        self.choices.as_ref().is_some_and(|c| c.reference.indirect_light)
    }

    /// Everything that runs, is skipped, or is not decided yet. Once the maps are known, what the fit does is told by its
    /// passes and rates.
    pub fn items(&self) -> Vec<Item> {
        let mut items = Vec::new();
        match self.appearance {
            None | Some(Appearance::Maps) => {}
            Some(Appearance::Kept) => {
                let why = "texture coordinates, materials and textures stay; triangles may become fewer, and within a budget of \
                           bytes textures smaller";
                items.push(Item::note("own surface", why));
            }
            Some(Appearance::VertexColors) => {
                let fitted = "fitted maps become colours of vertices and factors of materials; normal maps are left out";
                let (runs, why) = match self.surface() {
                    LightSurface::Own => {
                        (Runs::No, "the asset's own materials are written, which have no textures".into())
                    }
                    LightSurface::Open => (
                        Runs::Open,
                        format!(
                            "unless the asset's own materials, which have no textures, look better: {fitted}"
                        ),
                    ),
                    LightSurface::New | LightSurface::Colors => (Runs::Yes, fitted.into()),
                };
                items.push(Item { what: "colours of vertices", runs, why });
            }
        }
        items.extend(self.result.map(|r| written(r, self.appearance, self.triangles)));
        let fewer = self.triangles.is_none_or(|[of, made]| made < of);
        items.extend(self.decimation.clone().filter(|_| fewer));
        items.extend(self.bytes.clone());
        items.extend(self.counted.clone());
        items.extend(self.locked.clone());
        if self.appearance != Some(Appearance::Kept) {
            let steps = self.choices.as_ref().zip(self.result).filter(|(c, _)| c.steps > 0);
            items.extend(steps.map(|(c, r)| rows::steps(r.steps, c.steps, r.behind)));
            let none = self.choices.as_ref().and_then(|c| c.why_none);
            items.extend(none.map(|why| Item { what: "steps", runs: Runs::No, why: why.into() }));
            items.extend(self.unseen.map(rows::unseen));
            match &self.maps {
                Some(maps) => items.extend(rows::surface(&maps.work(self.steps().unwrap_or(1)))),
                None => self.asset.surface_items(self.steps(), &mut items),
            }
        }
        let occlusion = self.occlusion.filter(|_| self.appearance.is_some());
        let whole = self.result.is_some_and(|r| r.written == Written::Whole);
        self.asset.data_items(occlusion, self.surface(), whole, &mut items);
        self.option_items(&mut items);
        items.extend(self.traced_maps.clone());
        items.extend(self.judgement.as_ref().map(Judgement::item));
        items.extend(self.backs.map(|(seen, share)| rows::backs(seen, share)));
        items.extend(self.outline.clone());
        let own = self.surface() == LightSurface::Own;
        items.extend(self.mips.map(|sizes| match own {
            false => rows::free_mips(sizes, self.makes_steps()),
            true => rows::own_mips(),
        }));
        items.extend(self.device.clone().map(rows::device));
        items
    }

    /// What the light asset has of the asset's surface, as far as it is known.
    fn surface(&self) -> LightSurface {
        let colors = self.appearance == Some(Appearance::VertexColors);
        let made = if colors { LightSurface::Colors } else { LightSurface::New };
        match (self.appearance, self.result.map(|r| r.written)) {
            (Some(Appearance::Kept), _) => LightSurface::Own,
            (_, Some(written)) if written.has_own_surface() => LightSurface::Own,
            (_, Some(_)) => made,
            // Textures of its own go with no colours of vertices.
            (_, None) if self.may_be_own.unwrap_or(!colors || !self.asset.textured) => LightSurface::Open,
            (_, None) => made,
        }
    }

    /// Steps that the options ask for, 0 where it came to none; `None` where nothing is known of them.
    fn steps(&self) -> Option<u64> {
        let none = self.result.filter(|r| r.steps == 0).map(|_| 0);
        none.or(self.choices.as_ref().map(|c| c.steps))
    }

    /// Whether steps are made, as far as it is known.
    fn makes_steps(&self) -> bool {
        self.steps() != Some(0)
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
            items.push(rows::loss(loss, noise, self.makes_steps()));
        }
    }
}

/// The row of what is written.
fn written(
    Ended { written, traced, choice, .. }: Ended,
    appearance: Option<Appearance>,
    triangles: Option<[usize; 2]>,
) -> Item {
    let maps = appearance.unwrap_or_default().in_words();
    let why = match written {
        Written::Fitted => "what was fitted".to_owned(),
        Written::Rebaked => format!("the fitted shape, its {maps} baked anew"),
        Written::ShrinkWrapped | Written::Baked | Written::Sphere => {
            format!("a start: {} with baked {maps}", written.start())
        }
        Written::Decimated => "the asset's own materials".to_owned(),
        Written::Kept => "the asset's own surface".to_owned(),
        Written::Whole => "the asset as it was given, which has few enough bytes".to_owned(),
    };
    let traced = if traced { ", whose maps were fitted once more through the path tracer" } else { "" };
    let on = triangles.map_or_else(String::new, |[of, made]| format!("; {made} of {of} triangles"));
    let chosen = match choice {
        Some(Certainty { views, close }) => {
            let views = crate::report::counted(views as usize, "view");
            format!(
                "; chosen in {views}{}",
                if close { ", and something else may be better yet" } else { "" }
            )
        }
        None => String::new(),
    };
    Item::note("written asset", why + traced + &on + &chosen)
}

impl From<&FitPlan> for PlanRows {
    fn from(plan: &FitPlan) -> Self {
        let reached = plan.result.map_or(u64::MAX, |r| r.reached);
        Self { items: plan.items(), phases: plan.phases.clone() }.ended(reached)
    }
}

impl fmt::Display for FitPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&PlanRows::from(self), f)
    }
}

#[cfg(test)]
mod tests;
