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

use crate::engine::FitFrame;
use crate::engine::chain::{FitChain, MOST_PARTS, OfPart};
use crate::engine::plan::{Item, PlanRows};
use crate::engine::reference::{ENERGY, MaterialFeatures, world};
use crate::engine::traced::{ComparedPixels, Smoothing, Traced, TracedParameter, WHOLE};
use crate::engine::trainer::{HistoryPoint, Keeping};
use crate::guiding::{Guidance, Guiding, GuidingOptions, GuidingReport};
use crate::recover::left_out;
use crate::recover_scene::{RecoverSceneOptions, recover_scene};
use crate::traced_maps::{Map, maps};
use crate::{FitError, Progress};
use photofit_geometry::atlas::dilate;
use photofit_image::Image;
use photofit_pathtrace::{EnvironmentMap, Parameter, PathOptions, RenderOptions, Renderer, View, World};
use photofit_sampling::hash;
use photofit_scene::Scene;
use std::sync::Mutex;

pub use known::{KnownMaterial, MaterialErrors, around, first_sky, second_sky};

/// Radiance of the environment relative to that of the start, lowest and highest.
const DECADES: [f32; 2] = [1e-3, 1e5];
/// Most views of which a guide learns, and which tell how bright the start is.
const MOST_VIEWS: usize = 8;
/// Samples and seed of the pictures that tell how bright the start is.
const START_SPP: u32 = 4;
/// Tells the numbers of guides from those of pictures.
const GUIDE: u64 = 0x6775_6964;

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
    pub keeping: Keeping,
}

impl Default for RecoverMaterialOptions {
    /// Without a guide; a guide learns on pictures of 32 pixels a side.
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
            spp: 16,
            gradient_spp: 4,
            max_depth: 4,
            smoothing: Smoothing::default(),
            seed: 0,
            keeping: Keeping::default(),
        }
    }
}

/// A guide for a round: four rounds of training and a rehearsal of 8 paths at 32 pixels a side.
pub fn guiding(guiding: Guiding) -> GuidingOptions {
    GuidingOptions { side: 32, rounds: 4, rehearsal: 8, ..GuidingOptions::new(guiding) }
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
    /// What ran in the last round, and what was skipped; the phases of all rounds.
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
    let (mut phases, mut guides) = (Vec::new(), Vec::new());
    let (mut made, mut resumed) = (0, 0);
    let mut chain = FitChain::new(&options.keeping, progress);
    let told = Mutex::default();
    for round in 0..options.rounds {
        let done = chain.steps();
        let end = options.steps * (round as u64 + 1) / options.rounds as u64;
        let name = format!("round {} of {}", round + 1, options.rounds);
        let shown = OfPart { progress, done, steps: options.steps, name, told: &told };
        let mut guide = None;
        let r = chain.fit(1, &shown, |keeping| {
            let mut model = task.model(values.as_deref())?;
            if round > 0 {
                model.guidance = task.guidance(&model, views, round, progress)?;
                guide = model.guidance.report().cloned();
            }
            let own = RecoverSceneOptions {
                steps: end - done,
                rate: options.rate,
                seed: options.seed,
                keeping: keeping.clone(),
            };
            recover_scene(model, views, pictures, &own, &shown)
        })?;
        if let Some(report) = guide {
            progress.note(&format!("round {}: {}", round + 1, report.sentence()));
            guides.push(report);
        }
        phases.extend(r.plan.phases.iter().map(|p| format!("round {}: {p}", round + 1)));
        chain.add(&r.history, end - done);
        (made, resumed) = (made + r.steps, resumed + r.resumed);
        if round + 1 < options.rounds && !r.stopped {
            values = Some((0..r.model.parameters.len()).map(|k| r.model.of(k).to_vec()).collect());
            continue;
        }
        let asset = task.asset(&r.model)?;
        let items = [r.plan.items, vec![task.guide_row(&guides), atlas_row(unwrapped)]].concat();
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

/// What all rounds share.
struct Task<'a> {
    blank: &'a Scene,
    options: &'a RecoverMaterialOptions,
    /// Columns and rows of the pictures.
    size: [usize; 2],
    /// The environment of the start.
    environment: Image,
}

impl Task<'_> {
    fn world(&self, environment: &Image) -> Result<World, FitError> {
        lit(self.blank, environment)
    }

    fn rendering(&self) -> RenderOptions {
        let [width, height] = self.size;
        let Self { options: o, .. } = self;
        let path =
            PathOptions { max_depth: o.max_depth, show_environment: o.background, ..PathOptions::default() };
        RenderOptions { width, height, spp: o.spp, seed: o.seed, path, ..RenderOptions::default() }
    }

    /// The environment of the start: the given one, or an even sky under which the blank mesh is as bright as the pictures.
    fn sky(&self, views: &[View], pictures: &[Image]) -> Result<Image, FitError> {
        if let Some(given) = &self.options.environment {
            return Ok(given.clone());
        }
        let rows = self.options.environment_size;
        let even = |v: f32| Image::from_fn(2 * rows, rows, 3, |_, _, _| v);
        let world = self.world(&even(1.0))?;
        let (mut given, mut seen, mut covered) = (0.0, 0.0, 0);
        for (view, picture) in views.iter().zip(pictures).take(MOST_VIEWS) {
            let mut renderer =
                Renderer::new(&world, view, RenderOptions { spp: START_SPP, ..self.rendering() })?;
            renderer.finish();
            let drawn = renderer.picture();
            if (drawn.width, drawn.height, 4) != (picture.width, picture.height, picture.channels) {
                // The fit tells which one it is.
                break;
            }
            for (d, p) in drawn.data.chunks_exact(4).zip(picture.data.chunks_exact(4)) {
                if d[3] >= WHOLE && p[3] >= WHOLE {
                    covered += 1;
                    given += p[..3].iter().map(|v| f64::from(v.max(0.0))).sum::<f64>();
                    seen += d[..3].iter().map(|v| f64::from(*v)).sum::<f64>();
                }
            }
        }
        if covered == 0 && !self.options.background {
            let rule = "show the mesh in no pixel whole; transform_matrix must map the camera's frame (y up, looking down -z) \
                        to the world of the mesh, in its units";
            return Err(FitError::Setting { field: "pictures", rule: rule.into() });
        }
        let level = given / seen;
        Ok(even(if level > 0.0 && level.is_finite() { level as f32 } else { 1.0 }))
    }

    /// The world with these values of its parameters, or with those of the start.
    fn model(&self, values: Option<&[Vec<f32>]>) -> Result<Traced, FitError> {
        let Self { blank, options: o, environment, .. } = self;
        let world = self.world(environment)?;
        let mut parameters: Vec<TracedParameter> =
            self.maps(&world).iter().map(|m| m.parameter(blank)).collect();
        let fits_environment = !o.keep_environment;
        if fits_environment {
            let mean = environment.data.iter().sum::<f32>() / environment.data.len() as f32;
            let [low, high] = DECADES.map(|d| (d * mean).clamp(f32::MIN_POSITIVE, 1e30));
            parameters.push(TracedParameter {
                name: "environment".into(),
                parameter: Parameter::Environment,
                shape: [1, environment.height, environment.width, 3],
                range: [low, high],
            });
        }
        let mut model = Traced::new(world, self.rendering(), parameters)?;
        model.gradient_spp = o.gradient_spp;
        model.smoothing = o.smoothing;
        if !o.background {
            model.compared = ComparedPixels::Covered;
        }
        if fits_environment {
            model.move_in_logarithms(model.parameters.len() - 1)?;
        }
        for (k, values) in values.unwrap_or_default().iter().enumerate() {
            model.replace(k, values)?;
        }
        Ok(model)
    }

    fn maps(&self, world: &World) -> Vec<Map> {
        maps(self.blank, world)
    }

    /// A guide that learned from paths of what is found so far.
    fn guidance(
        &self,
        model: &Traced,
        views: &[View],
        round: usize,
        progress: &dyn Progress,
    ) -> Result<Guidance, FitError> {
        let Self { options, .. } = self;
        if options.guiding.guiding == Guiding::Off {
            return Ok(Guidance::off());
        }
        progress.report("guide", 0, 1, "");
        let world = model.world();
        let count = views.len().min(MOST_VIEWS);
        let renderer = |k: usize| {
            let seed = hash(options.seed, GUIDE, (round * MOST_VIEWS + k) as u64);
            Renderer::new(&world, &views[k * views.len() / count], RenderOptions { seed, ..self.rendering() })
        };
        let renderers = (0..count).map(renderer).collect::<Result<Vec<_>, _>>()?;
        Guidance::train_over(&renderers, &options.guiding, || false)
    }

    /// The mesh with the maps of a model. Texels that no picture moved get the values of the nearest that one did.
    fn asset(&self, model: &Traced) -> Result<Scene, FitError> {
        let start = self.model(None)?;
        let mut scene = self.blank.clone();
        let world = model.world();
        for (k, map) in self.maps(&world).iter().enumerate() {
            let image = &mut scene.images[map.image];
            let mut moved = Vec::new();
            map.write(start.of(k), model.of(k), image, &mut moved);
            let valid: Vec<bool> = moved.iter().map(|m| *m > 0.0).collect();
            let mut texels: Vec<[f32; 4]> = image.texels.iter().map(|t| t.map(f32::from)).collect();
            dilate(&mut texels, &valid, image.width, image.height, None);
            image.texels = texels.iter().map(|t| t.map(|v| v as u8)).collect();
        }
        Ok(scene)
    }

    fn found_environment(&self, model: &Traced) -> Result<Image, FitError> {
        let data = model.world().parameter(&Parameter::Environment)?;
        let Image { width, height, .. } = self.environment;
        Ok(Image::from_data(width, height, 3, data))
    }

    fn guide_row(&self, guides: &[GuidingReport]) -> Item {
        let why_not = match (self.options.guiding.guiding, guides.last()) {
            (Guiding::Off, _) => "not asked for".into(),
            (_, Some(report)) => report.sentence(),
            (_, None) => "the first round has nothing to learn from".into(),
        };
        let why = guides.last().map(GuidingReport::sentence).unwrap_or_default();
        Item::of("guided paths", guides.iter().any(|g| g.used), why, why_not)
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
