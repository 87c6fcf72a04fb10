//! `photofit recover scene`: parameters of a scene from path-traced pictures of it.

mod around;
mod found;
mod target;

use crate::args::RecoverScene;
use crate::fields::{RECOVER_SCENE, name_options};
use crate::parameter_scene::{Cameras, Key, Quantity, Subject, explained};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::simplify::CHECKPOINT_FILE;
use crate::status::{Ending, Misuse};
use crate::traced_report::{self_test_pictures, tell_course, tell_doubts};
use crate::{interrupt, threads};
use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use photofit_fit::FitError;
use photofit_fit::engine::traced::{Traced, TracedParameter};
use photofit_fit::engine::trainer::Checkpointing;
use photofit_fit::recover_scene::{RecoverSceneOptions, check_resume, recover_scene};
use photofit_image::Image;
use photofit_pathtrace::{View, World};
use std::time::Instant;
use target::Source;

/// Samples per pixel of the targets of a self-test.
const TARGET_SPP: u32 = 512;
/// Their seed, apart from those of the fit.
const TARGET_SEED: u64 = 0x7461_7267;

/// A model with what the command line says of it.
struct Task {
    model: Traced,
    /// The cameras.
    views: Vec<View>,
    /// Of each parameter.
    quantities: Vec<Quantity>,
    /// The boxes that files of grids name.
    boxes: Vec<[DVec3; 2]>,
    /// One for each view.
    targets: Vec<Image>,
    /// The values of each parameter, where they are known.
    truth: Option<Vec<Vec<f32>>>,
}

pub(crate) fn run(a: &RecoverScene) -> Result<Ending> {
    let source = Source::new(a)?;
    let files = found::files(a, source.count(a.scene.camera.len()))?;
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    let mut places = Places::default()
        .reads("SCENE", Some(&a.scene.input))
        .reads("--env", a.scene.env.as_deref())
        .fills("--output", Some(&a.output), &files)
        .fills("--checkpoint", a.checkpoint.as_deref(), &[CHECKPOINT_FILE]);
    for picture in &a.picture {
        places = places.reads("--picture", Some(picture));
    }
    places.check()?;
    places.check_against("--picture", &source.files())?;
    threads::set(a.threads)?;
    let scene = source.sized(&a.scene)?;
    let cameras = if matches!(source, Source::List(_)) { Cameras::Others } else { Cameras::Own };
    let mut task = task(a, Subject::load(&scene, cameras, &places)?, &source)?;
    begin(a, &mut task)?;
    let Task { model, views, quantities, boxes, targets, truth } = task;
    let first = truth.as_ref().map(|t| errors(&model, &quantities, t));
    let named = |e| anyhow!("{}: {}", a.scene.input.display(), name_options(RECOVER_SCENE, e));
    std::fs::create_dir_all(&a.output).with_context(|| a.output.display().to_string())?;
    let starts = found::starts(&model, &views)?;
    // A fit that goes on leaves the pictures of the one before until its checkpoint is taken.
    let goes_on = a.resume && a.checkpoint.as_ref().is_some_and(|c| c.join(CHECKPOINT_FILE).exists());
    if !goes_on {
        found::write_start(&a.output, &starts, &targets)?;
    }
    interrupt::handle();
    let progress = Terminal::new();
    let began = Instant::now();
    let r = recover_scene(model, &views, &targets, &fit_options(a), &progress).map_err(named)?;
    let seconds = began.elapsed().as_secs_f64();
    progress.finish();
    if goes_on {
        found::write_start(&a.output, &starts, &targets)?;
    }
    tell_course(r.stopped, a.explain.then_some(&r.plan))?;
    let last = truth.as_ref().map(|t| errors(&r.model, &quantities, t));
    found::write(a, &r, (&views, &targets), (&quantities, &boxes), first.zip(last), seconds)?;
    let stopped = r.stopped && interrupt::is_stopping();
    Ok(if stopped { Ending::Stopped } else { Ending::Done })
}

/// The parameters of the command line in the scene's world, and the pictures.
fn task(a: &RecoverScene, mut subject: Subject, source: &Source<'_>) -> Result<Task> {
    let named = |e: &dyn std::fmt::Display| anyhow!("{}: {e}", a.scene.input.display());
    let lit = |e: FitError| match e {
        FitError::PathTrace(e) => explained(&a.scene, &e),
        e => named(&e),
    };
    let (mut parameters, mut quantities, mut boxes) = (Vec::<TracedParameter>::new(), Vec::new(), Vec::new());
    for name in &a.parameter {
        let Key { name, parameter, shape, bounds, quantity, .. } = subject.find(&a.scene, name)?.clone();
        if let Some(other) = parameters.iter().find(|p| p.parameter == parameter) {
            let rule = format!("--parameter: {} and {name} are the same; one of them must go", other.name);
            bail!(Misuse(rule));
        }
        parameters.push(TracedParameter { name, parameter, shape, range: quantity.range() });
        quantities.push(quantity);
        boxes.push(bounds);
    }
    check_starts(a, &parameters, &quantities)?;
    let given = match source {
        Source::Own { .. } => None,
        Source::Files(files) => {
            Some(files.iter().map(|f| target::read(f, &subject.options)).collect::<Result<Vec<_>>>()?)
        }
        Source::List(file) => {
            let (views, targets) = target::list(a, file, &mut subject.options)?;
            subject.views = views;
            Some(targets)
        }
    };
    let Subject { parts, views, mut options, world, .. } = subject;
    options.spp = a.traced.spp;
    let world = World::with_options(parts, world).map_err(|e| named(&e))?;
    let views = match source {
        Source::Own { views: count @ 2.. } => around::views(&views[0], &world, *count),
        _ => views,
    };
    let mut model = Traced::new(world, options, parameters).map_err(lit)?;
    views.iter().try_for_each(|v| model.check(v)).map_err(lit)?;
    model.gradient_spp = a.traced.gradient_spp;
    model.smoothing = a.traced.smoothing.unwrap_or_default();
    check_resume(&model, &fit_options(a)).map_err(|e| named(&name_options(RECOVER_SCENE, e)))?;
    if let Some(given) = &given {
        tell_doubts("--picture", &views, given);
    }
    let own = || self_test_pictures(&views, |v| model.picture(v, TARGET_SPP, TARGET_SEED));
    let truth = given.is_none().then(|| (0..quantities.len()).map(|k| model.of(k).to_vec()).collect());
    let targets = given.map_or_else(own, Ok).map_err(|e| named(&e))?;
    Ok(Task { model, views, quantities, boxes, targets, truth })
}

fn fit_options(a: &RecoverScene) -> RecoverSceneOptions {
    let checkpointing =
        Checkpointing { checkpoint: a.checkpoint.clone(), resume: a.resume, time_limit: a.time_limit };
    RecoverSceneOptions { steps: a.traced.steps, rate: a.traced.rate, seed: a.scene.seed, checkpointing }
}

/// The start of a parameter: its own counts more than one for all, the last of several more than those before.
fn given_start(a: &RecoverScene, name: &str) -> Option<f64> {
    let last = |of: Option<&str>| a.start.iter().rev().find(|s| s.0.as_deref() == of);
    last(Some(name)).or_else(|| last(None)).map(|s| s.1)
}

/// Refuses starts of what is not fitted, and those above what a parameter can be.
fn check_starts(a: &RecoverScene, parameters: &[TracedParameter], quantities: &[Quantity]) -> Result<()> {
    for name in a.start.iter().filter_map(|s| s.0.as_ref()) {
        if !a.parameter.contains(name) {
            bail!(Misuse(format!("--start: {name} is not fitted; it must be one of --parameter")));
        }
    }
    // Normal maps start without bumps, whatever is given.
    for (p, _) in parameters.iter().zip(quantities).filter(|(_, q)| **q != Quantity::Normal) {
        let most = p.range[1];
        if let Some(start) = given_start(a, &p.name).filter(|x| *x > f64::from(most)) {
            let own = if a.start.iter().any(|s| s.0.is_none()) { "; KEY=X gives each its own" } else { "" };
            bail!(Misuse(format!("--start: {start} for {}; it must be at most {most}{own}", p.name)));
        }
    }
    Ok(())
}

/// Sets the values that the fit starts from, and moves those of the scene into their ranges.
fn begin(a: &RecoverScene, task: &mut Task) -> Result<()> {
    for (k, quantity) in task.quantities.iter().enumerate() {
        let (values, p) = (task.model.of(k), &task.model.parameters[k]);
        let given = given_start(a, &p.name).map(|x| x as f32);
        let start = if given.is_some() || a.self_test {
            quantity.flat(values, p.channels(), given)
        } else {
            values.iter().map(|v| v.clamp(p.range[0], p.range[1])).collect()
        };
        let name = p.name.clone();
        task.model.replace(k, &start).map_err(|e| anyhow!("{}: {name}: {e}", a.scene.input.display()))?;
        if task.truth.as_ref().is_some_and(|t| t[k] == task.model.of(k)) {
            say(&format!(
                "warning: {name}: starts at its value in the scene, so that nothing of it is to be found; choose another with --start"
            ));
        }
    }
    Ok(())
}

/// Errors of all parameters.
fn errors(model: &Traced, quantities: &[Quantity], truth: &[Vec<f32>]) -> Vec<f64> {
    let error = |(k, q): (usize, &Quantity)| q.error(model.of(k), &truth[k], model.parameters[k].channels());
    quantities.iter().enumerate().map(error).collect()
}
