//! Appearance-driven simplification: the main job (Hasselgren et al. 2021), assembled from the parts of the engine.
//!
//! load -> normalise -> decimate -> shrink-wrap -> atlas -> bake -> fit by rendering -> bake again on the fitted shape -> fit
//! the maps -> export -> reload the file and compare it with the reference on views and lights that the fit never saw.

mod appearance;
mod backs;
mod by_outline;
mod byte_budget;
mod choice;
mod coverage;
mod effort;
mod finish;
mod init;
mod kept;
pub(crate) mod locks;
mod mips;
mod options;
pub(crate) mod outcome;
mod plain;
mod plan;
pub(crate) mod prepare;
mod reference;
mod rival;
pub(crate) mod shrink_wrap;
mod texture_space;
mod through_path;

#[cfg(test)]
mod tests;

pub use crate::engine::Normalised;
pub use crate::engine::classes::MaterialClass;
pub use crate::engine::device::Device;
pub use crate::engine::export::to_scene;
pub use crate::engine::judge::{JudgeRenderer, Judged, Quality, ReportView, ViewQuality};
pub use crate::engine::plan::Runs;
pub use crate::engine::trainer::HistoryPoint;
pub use appearance::Appearance;
pub use effort::Effort;
pub use init::Init;
pub use mips::Mips;
pub use options::{
    LARGEST_ENGINE_PICTURE, MILD_RATIO, MIN_TRIANGLES, MOST_REPLAYS, Resolved, SimplifyOptions,
};
pub use outcome::{Outcome, StageQuality, Written, too_large_path};
pub use plan::{FitPlan, Judgement};
pub use reference::ReferenceRenderer;
pub use through_path::{FitRenderer, TRACED_FOLDER};

use crate::bake;
use crate::candidate::Candidate;
use crate::engine::checkpoint;
use crate::engine::classes::apart_by_scale;
use crate::engine::device::train_on;
use crate::engine::fingerprint::Fingerprint;
use crate::engine::judge::Stage;
use crate::engine::loss;
use crate::engine::plan::SurfacePlan;
use crate::engine::surface::{
    POSITIONS, Surface, fade_over, group_of_level, rate_of_maps, rate_of_positions, samples_of,
};
use crate::engine::trainer::{self, Checkpointing, HeldOut, Job, Phase};
use crate::engine::views::Moment;
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use finish::Finished;
use outcome::Times;
use photofit_geometry::decimate::Target;
use photofit_scene::Scene;
use prepare::Start;
use rival::Rival;
use std::path::Path;
use std::time::Instant;

/// The stage of what was fitted, and that of the written file where it is another.
pub(crate) const FITTED: &str = "fitted";
pub(crate) const FILE: &str = "file";
/// The stage of the asset itself, which has all of its triangles.
pub(crate) const ORIGINAL: &str = "original";

/// Rate of the positions in the last phase, relative to the first.
const LAST_POSITION_RATE: f64 = 0.4;

/// Simplifies `scene` and writes the result to `output` (.glb).
///
/// When the user stops the fit, what has been reached is exported and reported like a finished fit. A file of more bytes than
/// [`SimplifyOptions::max_bytes`] replaces nothing: it is written to [`too_large_path`] instead ([`Outcome::file`]).
///
/// # Errors
/// See [`FitError`]; nothing is written then.
pub fn simplify(
    scene: &Scene,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    let began = Instant::now();
    resolved_since(began, scene, output, &options.resolved(scene)?, progress)
}

/// The same with options that were resolved for `scene` before, which encodes geometry where triangles follow from bytes.
///
/// # Errors
/// See [`FitError`]; nothing is written then.
pub fn simplify_resolved(
    scene: &Scene,
    output: &Path,
    options: &Resolved,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    resolved_since(Instant::now(), scene, output, options, progress)
}

fn resolved_since(
    began: Instant,
    scene: &Scene,
    output: &Path,
    Resolved { options, told }: &Resolved,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    locks::check(scene, options, progress)?;
    if let Checkpointing { checkpoint: Some(folder), resume: true, .. } = options.keeping()
        && options.fit_steps() > 0
    {
        checkpoint::check_options(&folder, &steering(options).option("steps", options.steps))?;
    }
    told.iter().for_each(|t| progress.warn(t));
    with_asset(scene, progress, |asset| simplify_asset(asset, None, output, options, began, progress))
}

/// An asset with what every fit of it needs.
#[derive(Clone, Copy)]
pub(crate) struct Asset<'a> {
    /// As it was given.
    pub(crate) given: &'a Scene,
    /// The same where glass of several scales has a material for each: [`apart_by_scale`].
    pub(crate) scene: &'a Scene,
    pub(crate) n: &'a Normalised,
    rays: &'a bake::ReferenceSurface<'a>,
    visibility: &'a Visibility,
}

/// Runs `work` with an asset prepared for fits.
pub(crate) fn with_asset<R>(
    scene: &Scene,
    progress: &dyn Progress,
    work: impl FnOnce(Asset<'_>) -> Result<R, FitError>,
) -> Result<R, FitError> {
    scene.validate_for_fit()?;
    let given = scene;
    let scene = &*apart_by_scale(scene);
    let (n, opposed) = Normalised::new(scene)?.with_opposed_normals();
    if opposed > 0 {
        let of = n.flat.mesh.triangles.len();
        progress.warn(&format!(
            "the vertex normals of {opposed} of {of} triangles point to their back, so that they are shaded dark: the \
             light asset is made to look the same"
        ));
    }
    let rays = n.surface()?;
    let visibility = prepare::visibility(&rays, progress)?;
    let _told = n.not_finite.told_at_the_end(progress);
    work(Asset { given, scene, n: &n, rays: &rays, visibility: &visibility })
}

/// One fit of an asset. Its shape starts from the asset, or from a candidate that was fitted to it before. `began` is when
/// the work began.
pub(crate) fn simplify_asset(
    asset: Asset<'_>,
    from: Option<&Candidate>,
    output: &Path,
    options: &SimplifyOptions,
    began: Instant,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    let Asset { given, scene, n, rays, visibility } = asset;
    mips::check_classes(options, &n.used_classes())?;
    if options.appearance == Appearance::Kept {
        return kept::simplify(asset, output, options, began, progress);
    }
    through_path::begin(options, progress);
    let (device, renderer) = (options.device_of_fit(progress), options.rasterized_against());
    let judged = &*renderer.reference(scene, n, options)?;
    let (own, (options, counted)) = (options, &byte_budget::counted(asset, judged, options, progress)?);
    let drawn = renderer.drawn_on(&device, n, options);
    let reference = drawn.as_deref().unwrap_or(judged);

    let (views, backs) = backs::views(n, reference, Moment::default(), options)?;
    let sampling = options.sampling();
    let held_out = HeldOut::new(reference, &views, sampling, options.held_out_views(), options.seed)?;
    let held_out = held_out.measured_by(options.mips.measure());
    held_out.warn_unseen(progress);
    let starts = by_outline::starts(n, rays, visibility, from, &held_out, options, progress)?;
    let (all, start) = (&starts.all, &starts.all[starts.best]);
    let loss = loss::choose(&held_out);
    let plan = options.plan(given, reference.kind()).with_backs(backs.seen, backs.share);
    let plan = plan.with_counted(counted.clone());
    let plan = plan.with_unseen(start.unseen.map(|dropped| prepare::unseen(rays, visibility, dropped)));
    let surface = SurfacePlan::new(&start.candidate, options.asked(reference.kind()));
    let plan = plan.with_loss(loss, held_out.noise).with_maps(surface.clone()).with_outline(starts.row);
    let keeping = through_path::keeping_before(options);
    let rival = Rival::new(asset, &start.candidate, (&held_out, &views, sampling), options, progress)?;
    let job = Job {
        reference,
        views: &views,
        held_out: &held_out,
        sampling,
        loss,
        seed: options.seed,
        batch: options.pictures_per_step(),
        fresh: options.batch.div_ceil(2),
        steps: options.steps,
        rival: rival.quality,
        keeping: &keeping,
        fingerprint: fingerprint(options, backs.share, &start.candidate),
    };
    let fit_began = Instant::now();
    let rebake = |s: &Surface| {
        let maps = choice::rebaked(rays, visibility, &s.candidate, options, progress)?;
        Ok(samples_of(&s.candidate, &maps))
    };
    let levels = start.candidate.fitted_levels();
    let mut plan_with_phases = None;
    let (trained, device) = train_on(
        &device,
        Surface::new(start.candidate.clone(), &surface),
        &job,
        |psnr| {
            let phases = phases(options, (start.distance, surface.fades), (psnr, levels), &rebake);
            plan_with_phases = Some(plan.clone().with_phases(&phases));
            phases
        },
        progress,
    )?;
    let plan = plan_with_phases.unwrap_or(plan).with_device(device.told());
    let chosen =
        choice::best(asset, trained, (&all[..], starts.best, rival), judged, (options, own), progress)?;
    let spent = fit_began.elapsed();
    let Finished {
        trained,
        light,
        compression,
        written,
        fitted,
        traced_maps,
        plain,
        certainty,
        decimation,
        cut,
    } = finish::finish(asset, chosen, spent, judged, options, progress)?;
    if options.appearance == Appearance::VertexColors && !written.has_own_surface() {
        outcome::tell_detail(&trained.model.candidate, n, progress);
    }
    if trained.behind.is_some() && written != Written::Decimated && plain.is_some() {
        progress.warn(
            "the fit ended early, far behind the asset's own materials on as many triangles, which yet look worse in the views of the \
             choice; without them as a choice (new maps) it makes all of its steps",
        );
    }
    prepare::tell_budget(options, [scene.triangle_count(), light.triangle_count()], progress);
    let textures = byte_budget::told(&light);
    let (path, bytes) = outcome::save(output, (&light, compression), options)?;
    let to_file = began.elapsed().as_secs_f64();
    let file = photofit_scene::load(&path)?;
    let triangles = [scene.triangle_count(), file.triangle_count()];
    let stages = stages(asset, plain, all, (fitted, written, file), options);
    let judge = options.judge_of(scene, n, judged);
    let pictures = judge.views(&stages, options.report_views, progress)?;
    let times = Times { all: began.elapsed().as_secs_f64(), to_file };
    let told = options.judgement(given).made(pictures.len(), stages_beside(&stages));
    let plan = plan.with_judgement(told).with_result(
        written,
        [trained.steps, trained.reached()],
        (traced_maps.row(), traced_maps.gained()),
    );
    let plan = plan.with_behind(trained.behind).with_choice(certainty).with_triangles(triangles);
    let plan = plan.with_decimation(decimation.filter(|_| written == Written::Decimated));
    let plan = plan.with_bytes(options.max_bytes, Some((bytes, &textures, compression)));
    let mut outcome =
        Outcome::new(triangles, trained, plan, &stages, pictures, judge.method(&stages), times, options);
    outcome.device = device.name();
    (outcome.file, outcome.bytes, outcome.written) = (path, bytes, written);
    (outcome.textures, outcome.compression) = (textures, compression);
    let light = &stages[stages.len() - 1].scene;
    (outcome.left_out, outcome.not_fitted) = (
        outcome::left_out(given, light, options.appearance),
        outcome::not_fitted(given, light, written.has_own_surface()),
    );
    outcome.stopped |= progress.is_cancelled();
    outcome.choice_cut = cut;
    outcome.add_traced_maps(traced_maps.course());
    Ok(outcome)
}

/// What is to be written, with what the asset has beside its surface, its textures encoded as asked and locked vertices where
/// they are in the asset.
fn dressed(mut light: Scene, asset: Asset<'_>, options: &SimplifyOptions) -> Scene {
    light.inherit(asset.scene);
    light.images.iter_mut().for_each(|i| i.encoding = options.texture_encoding);
    if options.locks() {
        locks::restore(&mut light, asset.scene, asset.n);
    }
    light
}

/// How many assets a report compares with the asset, which may stand among them as an engine draws it.
fn stages_beside(stages: &[Stage]) -> usize {
    stages.iter().filter(|s| s.name != ORIGINAL).count()
}

/// What the report compares, in this order: the asset itself where an engine draws it, the decimated one where something was
/// compared with it, the starts, what was fitted where something else was written, and the written file.
fn stages(
    Asset { scene, n, .. }: Asset<'_>,
    plain: Option<Stage>,
    starts: &[Start],
    (fitted, written, file): (Option<Scene>, Written, Scene),
    options: &SimplifyOptions,
) -> Vec<Stage> {
    let mut stages = Vec::new();
    // Path traced, the original would be the reference itself.
    if options.as_engine && !options.is_judged_by_path_tracing(scene) {
        stages.push(Stage::new(ORIGINAL, scene.clone()));
    }
    stages.extend(plain);
    let start = |s: &Start| Stage::new(s.made.name(), options.exported(&s.candidate, n));
    stages.extend(starts.iter().rev().map(start));
    let last = if written == Written::Fitted && fitted.is_none() { FITTED } else { FILE };
    stages.extend(fitted.map(|scene| Stage::new(FITTED, scene)));
    stages.push(Stage::new(last, file));
    stages
}

/// The options and the topology that steer a fit, a share of whose views shows backs.
fn fingerprint(o: &SimplifyOptions, backs: f32, start: &Candidate) -> Fingerprint {
    let mut digest = checkpoint::Digest::new();
    digest.add(start.triangles.as_flattened());
    digest.add(&start.uvs);
    let digest = format!("{:016x}", digest.value());
    steering(o).option("single-sided backs", backs).digest("shape that the fit starts from", digest)
}

/// The options that steer a fit.
fn steering(o: &SimplifyOptions) -> Fingerprint {
    let all = match o.target {
        // Triangles follow from them, and from the asset.
        _ if o.triangles_by_bytes => {
            Fingerprint::default().option("max_bytes", o.max_bytes.unwrap_or_default())
        }
        Target::Triangles(n) => Fingerprint::default().option("triangles", n),
        Target::Ratio(r) => Fingerprint::default().option("ratio", r),
        Target::Error(e) => Fingerprint::default().option("error", e),
        Target::ScreenSize(p) => Fingerprint::default().option("screen_size", p),
    };
    all.option("init", format!("{:?}", o.init).to_lowercase())
        .option("resolution", o.resolution)
        .option("as_engine", o.as_engine)
        .option("batch", o.batch)
        .option("texture_size", o.texture_size)
        .option("mips", o.mips.name())
        .option("smallest_size", if o.mips == Mips::Free { o.smallest_size } else { 0 })
        .option("lock_borders", o.lock_borders)
        .option("lock", o.lock.as_deref().unwrap_or_default())
        .option("effort", o.effort.name())
        .option("seed", o.seed)
        .option("lighting", o.lighting.name())
        .option("occlusion", o.occlusion.name())
        .option("reference", format!("{:?}", o.reference).to_lowercase())
}

/// Coarse to fine: half resolution (all sizes where mip levels are free), then, with maps baked anew on the moved shape, full
/// resolution. The maps have `levels` groups.
fn phases<'a>(
    options: &SimplifyOptions,
    (distance, fades): (f64, bool),
    (start_psnr, levels): (f64, usize),
    rebake: trainer::Initialiser<'a, Surface>,
) -> Vec<Phase<'a, Surface>> {
    let n = options.steps;
    let a = n * 4 / 10;
    let share = a as f32 / n.max(1) as f32;
    let rate = rate_of_positions(distance);
    let map_rate = rate_of_maps(start_psnr);
    let maps = || (0..levels).map(group_of_level);
    let rates = |positions: f64| {
        let moving = std::iter::once((POSITIONS.into(), positions));
        moving.chain(maps().map(|level| (level, map_rate))).collect()
    };
    let halved = options.resolution.is_multiple_of(2) && options.resolution >= 256;
    let shrink = if halved && options.mips == Mips::Classic { 2 } else { 1 };
    let coarse = Phase {
        name: "coarse",
        first: 0,
        steps: a,
        shrink,
        rates: rates(rate),
        fade: fade_over(fades, [0.0, share]),
        reinitialised: None,
    };
    let fine = Phase {
        name: "fine",
        first: a,
        steps: n - a,
        shrink: 1,
        rates: rates(LAST_POSITION_RATE * rate),
        fade: fade_over(fades, [share, 1.0]),
        reinitialised: Some((maps().collect(), rebake)),
    };
    vec![coarse, fine]
}
