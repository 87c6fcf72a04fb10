//! Recovering the materials of a mesh and the light around it from pictures with cameras, through the path tracer: base
//! colour, roughness and metalness (and normals where asked for) on texture coordinates, radiance from all around.
//! Assembled from the parts of the engine.
//!
//! blank maps on the mesh -> an even sky as bright as the pictures -> rounds of fits of
//! [`recover_scene`](mod@crate::recover_scene) -> maps as images. From the second round on a guide, trained on paths of what
//! the rounds before found and frozen for the round, may choose the directions of paths.
//!
//! What pictures tell of base colour is its product with the light: highlights of what is no metal, whose strength is known,
//! and the bound 1 of base colours alone tell the two apart. What they leave open the start decides: a base colour of one half
//! under an even, colourless sky.

mod known;
mod surface;
mod task;

use crate::engine::chain::{FitChain, MOST_PARTS, OfPart};
use crate::engine::plan::{Item, PlanRows};
use crate::engine::reference::{ENERGY, MaterialFeatures, world};
use crate::engine::traced::{Smoothing, Traced};
use crate::engine::trainer::{Checkpointing, HistoryPoint};
use crate::engine::{FitFrame, NotFinite};
use crate::guiding::{Guiding, GuidingOptions, GuidingReport};
use crate::recover::left_out;
use crate::recover_scene::{self, RecoverSceneOptions, RecoveredScene};
use crate::{FitError, Progress};
use photofit_image::Image;
use photofit_pathtrace::{EnvironmentMap, View, World};
use photofit_sampling::hash;
use photofit_scene::Scene;
use std::sync::Mutex;
use task::Task;

pub use known::{KnownMaterial, MaterialErrors, around, first_sky, second_sky};

/// Tells the seeds of rounds from others.
const ROUND: u64 = 0x726f_756e;

/// Options of [`recover_material`].
#[derive(Clone, Debug)]
pub struct RecoverMaterialOptions {
    /// Width and height of the maps, 16 to 8192.
    pub texture_size: usize,
    /// Rows of the environment, 1 to 2048; twice as many columns.
    pub environment_size: usize,
    /// What the environment starts from, three channels of linear radiance; `None`: an even sky.
    pub environment: Option<Image>,
    /// The environment stays as it starts.
    pub keep_environment: bool,
    /// New texture coordinates, also where the mesh has some.
    pub unwrap: bool,
    /// Normals are fitted, too.
    pub normal_map: bool,
    /// Pictures show the environment behind the mesh, and it is compared; else pixels that the mesh covers whole alone are.
    pub background: bool,
    /// What chooses directions of paths from the second round on.
    pub guiding: GuidingOptions,
    /// Rounds, 1 to 8. All have equal shares of the steps.
    pub rounds: usize,
    /// Steps of all rounds together.
    pub steps: u64,
    /// Peak rate of the optimizer, more than 0 to 1: of maps, and of the logarithms of radiances.
    pub rate: f64,
    /// Samples per pixel of the pictures of a step.
    pub spp: u32,
    /// Samples per pixel of their gradients.
    pub gradient_spp: u32,
    /// Most scattering events of a path: 1 is direct light.
    pub max_depth: u32,
    /// How steps are smoothed.
    pub smoothing: Smoothing,
    /// Seed of all random choices.
    pub seed: u64,
    /// Checkpoints, one for each round ([`part_folder`](crate::engine::chain::part_folder)), and limits.
    pub checkpointing: Checkpointing,
}

impl Default for RecoverMaterialOptions {
    /// Without a guide; a guide learns on pictures of 32 pixels a side. Steps are smoothed by the low-pass filter, which
    /// relights best (`cargo xtask bench material-filters`).
    fn default() -> Self {
        Self {
            texture_size: 512,
            environment_size: 16,
            environment: None,
            keep_environment: false,
            unwrap: false,
            normal_map: false,
            background: false,
            guiding: guiding(Guiding::Off),
            rounds: 2,
            steps: 200,
            rate: 0.05,
            spp: 8,
            gradient_spp: 4,
            max_depth: 4,
            smoothing: Smoothing::Laplacian,
            seed: 0,
            checkpointing: Checkpointing::default(),
        }
    }
}

/// A guide for a round: four rounds of training and a pilot run of 8 paths at 32 pixels a side.
pub fn guiding(guiding: Guiding) -> GuidingOptions {
    let cost = guiding.single_cost();
    GuidingOptions { side: 32, rounds: 4, pilot: 8, cost, ..GuidingOptions::new(guiding) }
}

/// What was recovered.
#[derive(Debug)]
pub struct RecoveredMaterial {
    /// The world with the values of the best evaluation.
    pub model: Traced,
    /// The mesh with the maps, in the world of the cameras.
    pub asset: Scene,
    /// The environment: linear radiance, row 0 at +y.
    pub environment: Image,
    /// What the guides of the rounds came to.
    pub guides: Vec<GuidingReport>,
    /// Whether the mesh got new texture coordinates.
    pub unwrapped: bool,
    /// What `mesh` holds besides its surface and the asset does not, one line each.
    pub left_out: Vec<String>,
    /// The course over all rounds.
    pub history: Vec<HistoryPoint>,
    /// The picture that was held out.
    pub held_out: Option<usize>,
    /// Steps made.
    pub steps: u64,
    /// Steps that were made before this run.
    pub resumed: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// What ran in the last round that made steps, and what was skipped; the phases of all rounds.
    pub plan: PlanRows,
}

/// Fits maps of `mesh` and the light around it to `pictures` (linear, premultiplied RGBA, all of one size, one for each of
/// `views`, in the world of the mesh). Materials, textures and lights of `mesh` are not read, and its materials become opaque;
/// the names and sides of materials stay.
///
/// # Errors
/// See [`FitError`]: options out of their ranges, a mesh without a surface or one that cannot be unwrapped, pictures of
/// other sizes or with values that are not finite, cameras of which none sees the mesh.
pub fn recover_material(
    mesh: &Scene,
    views: &[View],
    pictures: &[Image],
    options: &RecoverMaterialOptions,
    progress: &dyn Progress,
) -> Result<RecoveredMaterial, FitError> {
    options.check()?;
    let Some(first) = pictures.first().filter(|_| pictures.len() == views.len()) else {
        let rule = format!("are {}; they must be {}, one per view", pictures.len(), views.len().max(1));
        return Err(FitError::Setting { field: "pictures", rule });
    };
    let (blank, unwrapped) = surface::blank(mesh, options, progress)?;
    let mut task =
        Task { blank: &blank, options, size: [first.width, first.height], environment: Image::new(1, 1, 3) };
    task.environment = task.sky(views, pictures)?;
    let mut values: Option<Vec<Vec<f32>>> = None;
    let (mut items, mut phases, mut guides) = (Vec::new(), Vec::new(), Vec::new());
    let (mut made, mut resumed) = (0, 0);
    let mut chain = FitChain::new(&options.checkpointing, progress);
    let (told, not_finite) = (Mutex::default(), NotFinite::default());
    let _told = not_finite.told_at_the_end(progress);
    let mut before = None;
    for round in 0..options.rounds {
        let done = chain.steps();
        let end = options.steps * (round as u64 + 1) / options.rounds as u64;
        let name = format!("round {} of {}", round + 1, options.rounds);
        let shown = OfPart { progress, done, steps: options.steps, name, told: &told };
        let mut guide = None;
        let fitted = chain.fit(1, &shown, |checkpointing| {
            let mut model = task.model(values.as_deref())?;
            model.not_finite = not_finite.clone();
            // Rounds have noise of their own: values follow that of the round before.
            let seed = if round > 0 { hash(options.seed, ROUND, round as u64) } else { options.seed };
            model.options.seed = seed;
            if round > 0 {
                model.guidance = task.guidance(&model, views, round, progress)?;
                // A round that goes on later begins with the guide that it would have had.
                if progress.is_cancelled() {
                    return Err(FitError::Interrupted);
                }
                guide = model.guidance.report().cloned();
                if model.guidance.has_diverged() {
                    let round = round + 1;
                    progress.warn(&format!("round {round} has no guide: training diverged"));
                }
            }
            let own = RecoverSceneOptions {
                steps: end - done,
                rate: options.rate,
                seed,
                checkpointing: checkpointing.clone(),
            };
            recover_scene::fit(model, views, pictures, &own, &shown)
        });
        let r = match (fitted, before.take()) {
            // Stopped while the guide learned: the round before is what was reached.
            (Err(FitError::Interrupted), Some(last)) => RecoveredScene { stopped: true, ..last },
            (fitted, _) => {
                let r = fitted?;
                if let Some(report) = guide {
                    progress.note(&format!("round {}: {}", round + 1, report.sentence()));
                    guides.push(report);
                }
                phases.extend(r.plan.phases.iter().map(|p| p.of_part(&format!("round {}", round + 1))));
                if r.steps > 0 || items.is_empty() {
                    items.clone_from(&r.plan.items);
                }
                chain.add(&r.history, end - done);
                (made, resumed) = (made + r.steps, resumed + r.resumed);
                r
            }
        };
        if round + 1 < options.rounds && !r.stopped {
            values = Some((0..r.model.parameters.len()).map(|k| r.model.of(k).to_vec()).collect());
            before = Some(r);
            continue;
        }
        let asset = task.asset(&r.model)?;
        items.extend([task.guide_row(&guides), atlas_row(unwrapped)]);
        return Ok(RecoveredMaterial {
            environment: task.found_environment(&r.model)?,
            left_out: left_out(mesh, &asset),
            asset,
            guides,
            unwrapped,
            history: chain.into_history(),
            held_out: r.held_out,
            steps: made,
            resumed,
            stopped: r.stopped,
            plan: PlanRows { items, phases },
            model: r.model,
        });
    }
    unreachable!("there is a round")
}

impl RecoverMaterialOptions {
    fn check(&self) -> Result<(), FitError> {
        crate::error::in_ranges([
            ("texture_size", self.texture_size, 16..=8192),
            ("environment_size", self.environment_size, 1..=2048),
            ("rounds", self.rounds, 1..=MOST_PARTS),
            ("spp", self.spp as usize, 1..=65536),
            ("gradient_spp", self.gradient_spp as usize, 1..=65536),
        ])?;
        if self.rate > 0.0 && self.rate <= 1.0 {
            return Ok(());
        }
        let rule = format!("is {}; it must be above 0 and at most 1", self.rate);
        Err(FitError::Setting { field: "rate", rule })
    }
}

fn atlas_row(unwrapped: bool) -> Item {
    Item::of(
        "new texture coordinates",
        unwrapped,
        "the mesh has none, or they were asked for",
        "the mesh has its own",
    )
}

/// An asset in the world of its file, without lights of its own, under an environment.
fn lit(scene: &Scene, environment: &Image) -> Result<World, FitError> {
    let mut world = world(&MaterialFeatures::Core.of(scene), FitFrame::WORLD, ENERGY)?;
    world.relight(&[], Some(EnvironmentMap::new(environment.clone())))?;
    Ok(world)
}

#[cfg(test)]
mod tests;
