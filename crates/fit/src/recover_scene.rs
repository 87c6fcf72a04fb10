//! Recovering materials, textures, lights and media of a scene from pictures of it, through the path tracer. Assembled from the
//! parts of the engine.
//!
//! Pictures are compared in linear light, relative to what they should be and without clamping, in the steps and in the
//! evaluations that choose the best state alike. Of four pictures or more the last one is held out for these; fewer are
//! all fitted, and the evaluations are of the pictures that are fitted.

mod doubts;

use crate::engine::checkpoint::{Digest, check_options};
use crate::engine::cpu::Cpu;
use crate::engine::fingerprint::Fingerprint;
use crate::engine::given::{GivenPicture, GivenPictures, Order};
use crate::engine::loss;
use crate::engine::plan::{Item, PlanRows, rows};
use crate::engine::traced::{ComparedPixels, Smoothing, Traced, TracedParameter, WHOLE, filters};
use crate::engine::trainer::{Batch, Checkpointing, HeldOut, HistoryPoint, Job, Measure, Phase, train};
use crate::engine::views::{Sampling, ViewCamera, ViewLights};
use crate::pictures::value_fault;
use crate::{FitError, Progress};
use photofit_image::Image;
use photofit_pathtrace::{MaterialValue, MediumValue, Parameter, View};
use photofit_scene::MapKind;

pub use crate::engine::trainer::relative_error;

/// Fewest pictures of which one is held out.
pub const FEWEST_TO_HOLD_OUT: usize = 4;
/// Most pictures of a step.
const MOST_OF_A_STEP: usize = 4;
/// A mean below which the start of a radiance does not tell how large it is.
const FAINT: f64 = 1e-3;
/// What it is taken to be then, relative to the mean of the pictures: lamps are brighter than what they light.
const LAMP: f64 = 4.0;

/// Optical thickness across a medium, which its densities are taken to reach.
const OPAQUE: f64 = 8.0;

/// Options of [`recover_scene`].
#[derive(Clone, Debug)]
pub struct RecoverSceneOptions {
    /// Steps of the fit.
    pub steps: u64,
    /// Peak rate of the optimizer, relative to the mean of the start where values have no upper bound of 1; to four
    /// times the mean of the pictures where that start is dark, and of densities at least to one that is opaque
    /// across the whole medium.
    pub rate: f64,
    /// Seed of the order of views; that of pictures and gradients is [`Traced::options`]'.
    pub seed: u64,
    /// Checkpoints and limits.
    pub checkpointing: Checkpointing,
}

impl Default for RecoverSceneOptions {
    fn default() -> Self {
        Self { steps: 200, rate: 0.05, seed: 0, checkpointing: Checkpointing::default() }
    }
}

/// What was recovered.
#[derive(Debug)]
pub struct RecoveredScene {
    /// The world with the values of the best evaluation.
    pub model: Traced,
    /// The course of the fit; [`relative_error`] of an evaluation's quality is the error that the best state has least of.
    pub history: Vec<HistoryPoint>,
    /// The picture that was held out: nothing was fitted to it, and the evaluations are of it alone.
    pub held_out: Option<usize>,
    /// Steps made.
    pub steps: u64,
    /// Steps that were made before this run: those of its checkpoint.
    pub resumed: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// What ran and what was skipped.
    pub plan: PlanRows,
}

/// Fits the parameters of `model` to the light of `pictures` (linear), one for each of `views`. Their alpha is not looked
/// at, unless pixels that are covered alone are compared ([`ComparedPixels::Covered`]). Values outside of their ranges are
/// moved into them first.
///
/// # Errors
/// See [`FitError`]: pictures of another size or number than the model's, values that are not finite; lights, emission and maps of
/// emission of assets that are all 0 at the start, where they have no derivative (what a tree of BSDFs emits is not looked at, nor single values: ranges that begin
/// above 0 keep them from it); a step at which the scene has no light.
pub fn recover_scene(
    model: Traced,
    views: &[View],
    pictures: &[Image],
    options: &RecoverSceneOptions,
    progress: &dyn Progress,
) -> Result<RecoveredScene, FitError> {
    let _told = model.not_finite.told_at_the_end(progress);
    fit(model, views, pictures, options, progress)
}

/// The same without telling what pictures and gradients leave out.
pub(crate) fn fit(
    mut model: Traced,
    views: &[View],
    pictures: &[Image],
    options: &RecoverSceneOptions,
    progress: &dyn Progress,
) -> Result<RecoveredScene, FitError> {
    let (w, h) = (model.options.width, model.options.height);
    let wrong = |rule: String| Err(FitError::Setting { field: "pictures", rule });
    if pictures.len() != views.len() || pictures.is_empty() {
        let views = views.len().max(1);
        return wrong(format!("are {}; they must be {views}, one per view", pictures.len()));
    }
    for p in pictures {
        if (p.width, p.height, p.channels) != (w, h, 4) {
            let found = format!("{} x {} with {} channels", p.width, p.height, p.channels);
            return wrong(format!("are {found}; they must be {w} x {h} with 4"));
        }
        if let Some(fault) = value_fault(p) {
            return wrong(format!("have a value that cannot be compared: {fault}"));
        }
    }
    // Alpha counts for nothing: a sky that is seen is light like any other, and nothing is put behind it.
    let opaque = |p: &Image| match model.compared {
        ComparedPixels::All => Image::from_fn(w, h, 4, |x, y, c| if c < 3 { p.pixel(x, y)[c] } else { 1.0 }),
        ComparedPixels::Covered => p.clone(),
    };
    let pictures: Vec<Image> = pictures.iter().map(opaque).collect();
    let bright = Brightness::of(&pictures);
    begin(&mut model)?;
    views.iter().try_for_each(|v| model.check(v))?;
    for (i, j) in doubts::swapped(&model, views, &pictures)? {
        progress.warn(&format!(
            "pictures {i} and {j} look like what cameras {j} and {i} see: they may have changed places"
        ));
    }
    let held_out = (pictures.len() >= FEWEST_TO_HOLD_OUT).then(|| pictures.len() - 1);
    let (fitted, judged) = match held_out {
        Some(last) => ((0..last).collect(), vec![last]),
        None => ((0..pictures.len()).collect(), (0..pictures.len()).collect()),
    };
    let whole = |p: &Image| p.data.chunks_exact(4).any(|p| p[3] >= WHOLE);
    if model.compared == ComparedPixels::Covered && !judged.iter().any(|i: &usize| whole(&pictures[*i])) {
        return wrong("that judge the fit (the last one) show the mesh in no pixel whole; one must".into());
    }
    let given = |(view, image): (&View, Image)| GivenPicture {
        camera: ViewCamera::Traced(*view),
        lights: ViewLights::default(),
        image,
    };
    let given = views.iter().zip(pictures).map(given).collect();
    let source = GivenPictures::new(given, fitted, judged, Order::InTurn);
    let evaluated = source.held_out() as u64;
    let evaluation = HeldOut::new(&source, &source, Sampling::SUPERSAMPLED, evaluated, options.seed)?;
    let evaluation = evaluation.measured_by(Measure::Relative);
    let mut seen = Digest::new();
    source.pictures().iter().for_each(|p| seen.add(&p.image.data));
    let ranges: Vec<_> = (0..model.parameters.len()).map(|k| model.ranges(k)).collect();
    seen.add_bytes(format!("{views:?} {:?} {ranges:?}", model.parameters).as_bytes());
    // What is not fitted has to be the same, too: a coarse picture of the start stands for it.
    seen.add(&model.picture(&views[0], 1, options.seed)?.data);
    let fingerprint = of_options(&model, options)
        .digest("scene, pictures, cameras or starting values", seen)
        .digest(filters::RULED, filters::rule());
    let job = Job {
        reference: &source,
        views: &source,
        held_out: &evaluation,
        sampling: Sampling::SUPERSAMPLED,
        loss: loss::choose(&evaluation),
        seed: options.seed,
        batch: Batch::half_new(source.fitted().min(MOST_OF_A_STEP)),
        steps: options.steps,
        rival: None,
        checkpointing: &options.checkpointing,
        fingerprint,
    };
    let rate = |k: usize| (model.parameters[k].name.clone().into(), options.rate * scale(&model, k, bright));
    let rates = (0..model.parameters.len()).map(rate).collect();
    let (steps, fade, reinitialised) = (options.steps, None, None);
    let phase = Phase { name: "parameters", first: 0, steps, shrink: 1, rates, fade, reinitialised };
    let phases = vec![phase];
    let plan = PlanRows::new(Vec::new(), &phases);
    let trained = train(Cpu::new(model)?, &job, |_| phases, progress)?;
    let mut items = items(&trained.model, held_out, trained.steps);
    items.push(rows::loss(job.loss, evaluation.noise, trained.steps > 0));
    items.push(rows::evaluation(evaluation.measure, "light has no upper bound"));
    let plan = PlanRows { items, ..plan }.ended(trained.reached());
    Ok(RecoveredScene {
        model: trained.model,
        history: trained.history,
        held_out,
        steps: trained.steps,
        resumed: trained.resumed,
        stopped: trained.stopped || progress.is_cancelled(),
        plan,
    })
}

/// Refuses a checkpoint that was made with other options, before there are pictures to compare. What else is another one is told
/// by [`recover_scene`].
///
/// # Errors
/// [`FitError::OtherFit`].
pub fn check_resume(model: &Traced, options: &RecoverSceneOptions) -> Result<(), FitError> {
    let Checkpointing { checkpoint, resume, .. } = &options.checkpointing;
    match checkpoint {
        Some(folder) if *resume => check_options(folder, &of_options(model, options)),
        _ => Ok(()),
    }
}

/// What a fit that goes on from a checkpoint must share with it and users can name.
fn of_options(model: &Traced, options: &RecoverSceneOptions) -> Fingerprint {
    let names: Vec<&str> = model.parameters.iter().map(|p| p.name.as_str()).collect();
    let fingerprint = Fingerprint::default()
        .option("rate", options.rate)
        .option("spp", model.options.spp)
        .option("gradient_spp", model.gradient_spp)
        .option("smoothing", model.smoothing.name())
        .option("parameter", names.join(", "))
        .option("seed", model.options.seed)
        .option("max_depth", model.options.path.max_depth)
        .option("evaluation_spp", model.evaluation_spp);
    match model.guidance.report() {
        Some(r) if model.guidance.is_on() => fingerprint.option("guiding", r.guiding.name()),
        None if model.guidance.is_on() => fingerprint.option("guiding", "on"),
        _ => fingerprint,
    }
}

/// The rows of the plan that the model gives, of a fit that made so many steps.
fn items(model: &Traced, held_out: Option<usize>, steps: u64) -> Vec<Item> {
    const MATERIALS: &str = "material gradients";
    const TEXTURES: &str = "texture gradients";
    const LIGHTS: &str = "light gradients";
    const ENVIRONMENT: &str = "environment gradients";
    const MEDIA: &str = "medium gradients";
    let kind = |p: &TracedParameter| match p.parameter {
        Parameter::Texels { .. } | Parameter::Graph { .. } => TEXTURES,
        Parameter::Light { .. } => LIGHTS,
        Parameter::Environment => ENVIRONMENT,
        Parameter::Medium { .. } => MEDIA,
        _ => MATERIALS,
    };
    let mut items: Vec<Item> = [MATERIALS, TEXTURES, LIGHTS, ENVIRONMENT, MEDIA]
        .into_iter()
        .map(|what| {
            let of = model.parameters.iter().filter(|p| kind(p) == what);
            let names: Vec<&str> = of.map(|p| p.name.as_str()).collect();
            let why_not =
                if steps > 0 { "none is fitted: no derivative is followed" } else { rows::NO_STEPS };
            Item::of(what, steps > 0 && !names.is_empty(), names.join(", "), why_not)
        })
        .collect();
    items.push(smoothed(model, steps > 0));
    items.push(Item::of(
        "held-out picture",
        held_out.is_some(),
        "the last one: the fit is judged by it alone",
        format!("there are fewer than {FEWEST_TO_HOLD_OUT}: the fit is judged by what it is fitted to"),
    ));
    items
}

/// What steps are smoothed by, and of which parameters.
fn smoothed(model: &Traced, steps: bool) -> Item {
    let names = |which: &dyn Fn(usize) -> bool| {
        let of = (0..model.parameters.len()).filter(|k| which(*k));
        of.map(|k| model.parameters[k].name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let narrow = names(&|k| model.narrows(k));
    let wide = names(&|k| model.is_smoothed(k) && !model.narrows(k));
    let small = names(&|k| model.parameters[k].cells() > 1 && !model.is_smoothed(k));
    let how = match model.smoothing {
        Smoothing::Narrowing => Smoothing::Bilateral,
        other => other,
    };
    let rows =
        [(Smoothing::Narrowing.name(), narrow), (how.name(), wide), ("too few cells for a filter", small)];
    let told = rows.iter().filter(|(_, names)| !names.is_empty());
    let told: Vec<String> = told.map(|(how, names)| format!("{how}: {names}")).collect();
    let why_not = match model.smoothing {
        _ if !steps => rows::NO_STEPS,
        Smoothing::None => "not asked for",
        _ => {
            "all parameters are single values, textures or grids of fewer than 16 cells along the longest side, or skies of fewer than 16 rows"
        }
    };
    let any = (0..model.parameters.len()).any(|k| model.is_smoothed(k));
    Item::of("smoothed steps", steps && any, told.join("; "), why_not)
}

/// Moves the values into their ranges, so that what has no derivative at 0 starts above it.
fn begin(model: &mut Traced) -> Result<(), FitError> {
    for k in 0..model.parameters.len() {
        let values = model.within(k);
        let radiates = match &model.parameters[k].parameter {
            Parameter::Light { .. } | Parameter::Environment => true,
            Parameter::Material { value, .. } => {
                matches!(value, MaterialValue::Emission | MaterialValue::Emissive)
            }
            Parameter::Texels { texture } => {
                let world = model.world();
                world.library().is_some_and(|l| l.readers(*texture, MapKind::Emissive).next().is_some())
            }
            _ => false,
        };
        if radiates && values.iter().all(|v| *v == 0.0) {
            let name = &model.parameters[k].name;
            let rule = format!("of {name} are 0, where light has no derivative; they must start above it");
            return Err(FitError::Setting { field: "values", rule });
        }
        if values != model.of(k) {
            model.replace(k, &values)?;
        }
    }
    Ok(())
}

/// How bright pictures are.
#[derive(Clone, Copy)]
struct Brightness {
    /// Mean of all colours.
    mean: f64,
    /// Their mean weighted by themselves: of what is bright, where the rest is dark.
    of_bright: f64,
}

impl Brightness {
    fn of(pictures: &[Image]) -> Self {
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for v in pictures.iter().flat_map(|p| p.data.chunks_exact(4)).flat_map(|p| &p[..3]) {
            let v = f64::from(*v);
            (sum, squares, count) = (sum + v, squares + v * v, count + 1.0);
        }
        Self { mean: sum / f64::max(count, 1.0), of_bright: if sum > 0.0 { squares / sum } else { 0.0 } }
    }
}

/// What the rate of a parameter is relative to, for pictures of this brightness.
fn scale(model: &Traced, parameter: usize, bright: Brightness) -> f64 {
    if model.parameters[parameter].range[1] <= 1.0 || model.moves_in_logarithms(parameter) {
        return 1.0;
    }
    let values = model.of(parameter);
    let mean = values.iter().map(|v| f64::from(v.abs())).sum::<f64>() / values.len().max(1) as f64;
    if let Parameter::Medium { medium, value } = model.parameters[parameter].parameter {
        // For emission: several times what is bright in the pictures, from across the whole medium.
        let unit = match value {
            MediumValue::Emission => bright.of_bright / f64::from(model.world().length_across(medium)),
            _ => f64::from(model.world().unit_extinction(medium)),
        };
        return mean.max(OPAQUE * unit);
    }
    [mean, LAMP * bright.mean].into_iter().find(|m| *m > FAINT).unwrap_or(1.0)
}

#[cfg(test)]
mod tests;
