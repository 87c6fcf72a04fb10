//! The assembly: reference, views, starts, loss, trainer, choice, file, judge.

use super::choice::Chosen;
use super::delivery::Delivery;
use super::finish::Finished;
use super::prepare::Start;
use super::rival::Rival;
use super::{
    Appearance, Asset, FITTED, Normalised, Outcome, SimplifyOptions, backs, by_outline, byte_budget, choice,
    finish, kept, mips, phases, prepare, rival, steering, through_path,
};
use crate::candidate::Candidate;
use crate::engine::device::train_on;
use crate::engine::judge::Stage;
use crate::engine::loss;
use crate::engine::plan::SurfacePlan;
use crate::engine::surface::{Surface, samples_of};
use crate::engine::trainer::{HeldOut, Job};
use crate::engine::views::Moment;
use crate::{FitError, Progress};
use photofit_scene::Scene;
use std::path::Path;
use std::time::Instant;

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
    let (device, renderer) = (&options.device, options.rasterized_against());
    let judged = &*renderer.reference(scene, n, options)?;
    let (own, (options, counted)) = (options, &byte_budget::counted(asset, judged, options, progress)?);
    let drawn = renderer.drawn_on(device, n, options);
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
    let surface = SurfacePlan::new(&start.candidate, options.fit_request(reference.kind()));
    let plan = plan.with_loss(loss, held_out.noise).with_maps(surface.clone()).with_outline(starts.row);
    let checkpointing = through_path::checkpointing_before(options);
    let rival = Rival::new(asset, &start.candidate, (&held_out, &views, sampling), options, progress)?;
    let job = Job {
        reference,
        views: &views,
        held_out: &held_out,
        sampling,
        loss,
        seed: options.seed,
        batch: options.batch_of_steps(),
        steps: options.steps,
        rival: rival.quality,
        checkpointing: &checkpointing,
        fingerprint: steering::of_fit(
            options,
            (backs.share, rival::is_told(asset, options)),
            &start.candidate,
        ),
    };
    let fit_began = Instant::now();
    let rebake = |s: &Surface| {
        let maps = choice::rebaked(rays, visibility, &s.candidate, options, progress)?;
        Ok(samples_of(&s.candidate, &maps))
    };
    let levels = start.candidate.fitted_levels();
    let mut plan_with_phases = None;
    let (trained, device) = train_on(
        device,
        Surface::new(start.candidate.clone(), &surface),
        &job,
        |psnr| {
            let phases = phases::phases(options, (start.distance, surface.fades), (psnr, levels), &rebake);
            plan_with_phases = Some(plan.clone().with_phases(&phases));
            phases
        },
        progress,
    )?;
    let plan = plan_with_phases.unwrap_or(plan).with_device(device.told());
    let chosen =
        choice::best(asset, trained, (&all[..], starts.best, rival), judged, (options, own), progress)?;
    let spent = fit_began.elapsed();
    let Finished { chosen, compression, traced_maps, cut } =
        finish::finish(asset, chosen, spent, judged, options, progress)?;
    chosen.warn(n, options, progress);
    let delivery = Delivery { asset, reference: judged, options, output, began, progress };
    let Chosen { trained, light, written, fitted, decimation, plain, certainty, .. } = chosen;
    let file = delivery.deliver((&light, compression), written, compared(plain, all, fitted, n, options))?;
    let plan = delivery.told(plan, &file).with_decimation(decimation);
    let steps = [trained.steps, trained.reached()];
    let plan = plan.with_result(written, steps, (traced_maps.row(), traced_maps.gained()));
    let plan = plan.with_behind(trained.behind).with_choice(certainty);
    let mut outcome = Outcome::new(&delivery, file, trained, plan);
    outcome.device = device.name();
    outcome.choice_cut = cut;
    outcome.add_traced_maps(traced_maps);
    Ok(outcome)
}

/// What the report compares with the file, in this order: the decimated asset where something was compared with it, the starts, and
/// what was fitted where something else was written.
fn compared(
    plain: Option<Stage>,
    starts: &[Start],
    fitted: Option<Scene>,
    n: &Normalised,
    options: &SimplifyOptions,
) -> Vec<Stage> {
    let start = |s: &Start| Stage::new(s.made.name(), options.exported(&s.candidate, n));
    let fitted = fitted.map(|scene| Stage::new(FITTED, scene));
    plain.into_iter().chain(starts.iter().rev().map(start)).chain(fitted).collect()
}
