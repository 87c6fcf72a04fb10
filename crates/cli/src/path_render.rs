//! `photofit render --integrator path`: one picture of an asset with all its light.

use crate::args::{Render, RenderLight};
use crate::guided::{self, TRAINING_SHARE, guiding, training, trainings};
use crate::light::MEAN;
use crate::output::{self, print};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::status::{Ending, Misuse};
use crate::{camera, interrupt, render};
use anyhow::{Context, Result, anyhow, bail};
use photofit_fit::engine::not_finite_told;
use photofit_fit::guiding::{Guidance, Guiding, GuidingOptions};
use photofit_fit::{FitError, Progress as _};
use photofit_image::{Image, luminance, tone_map};
use photofit_pathtrace::{
    Aov, EnvironmentMap, LightSource, Parts, PathOptions, Progress, RenderOptions, Renderer, View, World,
};
use photofit_scene::{Scene, load_environment};
use photofit_shading::Light;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The benchmark that measures what the plan skips.
const SUITE: &str = "pathtrace";
/// Samples per pixel when nothing else ends the render.
pub(crate) const SPP: u32 = 64;
/// Scattering events of a path.
const DEPTH: u32 = 16;
/// Time between two saved states.
const SAVE_EVERY: Duration = Duration::from_secs(20);
/// Least of these, in which samples are made.
const SAVE_LEAST: Duration = Duration::from_millis(10);
/// Largest state of another picture that is read, bytes.
const OTHER_STATE: u64 = 1 << 30;
/// Why nothing was written.
const NO_SAMPLE: &str = "no sample was made within --time-limit; nothing is written";
/// Bound on the samples when noise or time ends it.
pub(crate) const SPP_MAX: u32 = 4096;

pub(crate) fn run(a: &Render, places: &Places) -> Result<Ending> {
    let aovs = auxiliary(a)?;
    let scene = render::posed(a)?;
    places.check_against("IN", &scene.files)?;
    let named = |e: &dyn std::fmt::Display| anyhow!("{}: {e}", a.input.display());
    scene.validate_for_fit().map_err(|e| named(&e))?;
    let view = view(a, &scene)?;
    let mut parts = Parts::from_scene(&scene);
    add_light(a, &scene, &mut parts)?;
    let key = fingerprint(a, &scene, &parts)?;
    drop(scene);
    let world = World::new(parts).map_err(|e| named(&e))?;
    let renderer = Renderer::new(&world, &view, options(a, aovs)).map_err(|e| named(&e))?;
    finish(a, renderer, &view, &key)
}

/// Renders, and writes the picture.
pub(crate) fn finish(a: &Render, mut renderer: Renderer<'_>, view: &View, key: &str) -> Result<Ending> {
    let began = Instant::now();
    let state = state_file(&a.output);
    if a.path.explain && guiding(a) == Guiding::Off {
        print(&format!("path tracing\n{}", renderer.plan()))?;
        output::name_suite(SUITE)?;
    }
    let mut keeper = Keeper { file: &state, scene: key, guide: None, refusal: String::new(), kept: false };
    let mut earlier = None;
    if a.path.resume {
        let trainings = trainings(a, renderer.options());
        let guides: Vec<String> = trainings.iter().map(|t| guide_key(a, t.as_ref())).collect();
        earlier = resume(&mut renderer, &state, key, &guides)?.map(|i| trainings[i]);
        keeper.kept = earlier.is_some();
    } else if let Some(kept) = photofit_image::set_aside(&state)? {
        say(&format!("an earlier render was not finished; its state is kept as {}", kept.display()));
    }
    interrupt::handle();
    let (finished, guidance) = match a.threads {
        None => work(a, &mut renderer, &mut keeper, earlier)?,
        Some(n) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(n)).build()?;
            pool.install(|| work(a, &mut renderer, &mut keeper, earlier))?
        }
    };
    if renderer.progress().samples == 0 {
        // What stands under the name of the output stays.
        let stopped = interrupt::is_stopping();
        bail!(if stopped { FitError::Interrupted.into() } else { anyhow!("{NO_SAMPLE}") });
    }
    write(a, &renderer)?;
    // A state of more samples than were asked for is worth more than this picture.
    let progress = renderer.progress();
    if progress.samples > progress.total {
        say(&format!("{}: has more samples than were asked for; it is kept", state.display()));
    } else if finished && state.is_file() {
        fs::remove_file(&state).with_context(|| format!("{}: cannot be removed", state.display()))?;
    }
    if let Some(file) = &a.json {
        let mut value = figures(a, &renderer, &guidance, finished, began);
        value["camera"] = camera::to_json(view, a.width(), a.height());
        output::write_json(file, &value)?;
    }
    print(&render::summary(a, per_pixel(a, &progress).round() as usize, began))?;
    if finished && !a.is_mitsuba() {
        render::warn_unseen(&a.input, &renderer.picture());
    }
    if progress.not_finite > 0 {
        say(&not_finite_told(progress.not_finite));
    }
    if progress.unsampled > 0 {
        say(&format!("{} of {} pixels have no sample", progress.unsampled, pixels(a)));
    }
    let stopped = !finished && interrupt::is_stopping();
    Ok(if stopped { Ending::Stopped } else { Ending::Done })
}

/// The figures of a render as JSON; `spp` is the mean over the pixels, `variance` that of single samples over pixels and
/// channels.
fn figures(
    a: &Render,
    renderer: &Renderer<'_>,
    guidance: &Guidance,
    finished: bool,
    began: Instant,
) -> Value {
    let progress = renderer.progress();
    let variance = renderer.sample_variance();
    let variance = variance.data.iter().map(|v| f64::from(*v)).sum::<f64>() / variance.data.len() as f64;
    json!({
        "guiding": guiding(a).name(),
        "guide": guidance.report().map(guided::figures),
        "training_seconds": guidance.seconds(),
        "samples": progress.samples,
        "variance": variance.is_finite().then_some(variance),
        "input": a.input.display().to_string(),
        "output": a.output.display().to_string(),
        "integrator": "path",
        "width": a.width(),
        "height": a.height(),
        "spp": per_pixel(a, &progress),
        "noise": progress.noise.is_finite().then_some(progress.noise),
        "max_depth": a.path.max_depth.unwrap_or(DEPTH),
        "seed": a.path.seed.unwrap_or(0),
        "not_finite": progress.not_finite,
        "unsampled": progress.unsampled,
        "finished": finished,
        "seconds": began.elapsed().as_secs_f64(),
        "threads": a.threads.map_or_else(rayon::current_num_threads, usize::from),
    })
}

/// The auxiliary images that are asked for.
pub(crate) fn auxiliary(a: &Render) -> Result<Vec<Aov>> {
    if a.path.aov.is_empty() {
        return Ok(Vec::new());
    }
    if !is_exr(&a.output) {
        let file = a.output.display();
        bail!(Misuse(format!("{file}: --aov writes layers; the output must end in .exr")));
    }
    let mut out = Vec::new();
    for name in &a.path.aov {
        match (name.trim(), Aov::named(name.trim())) {
            ("all", _) => out.extend(Aov::ALL.into_iter().filter(|a| *a != Aov::Motion)),
            (_, Some(Aov::Motion)) => {
                bail!(Misuse("--aov motion: a single picture has no previous camera".into()))
            }
            (_, Some(aov)) => out.push(aov),
            (other, None) => {
                let known: Vec<&str> =
                    Aov::ALL.into_iter().filter(|a| *a != Aov::Motion).map(Aov::name).collect();
                bail!(Misuse(format!("--aov {other}: must be of {}, or all", known.join(", "))))
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    Ok(out)
}

pub(crate) fn options(a: &Render, aovs: Vec<Aov>) -> RenderOptions {
    RenderOptions {
        width: a.width() as usize,
        height: a.height() as usize,
        spp: a.spp.unwrap_or(if a.path.is_open() { SPP_MAX } else { SPP }),
        noise: a.path.noise,
        seed: a.path.seed.unwrap_or(0),
        aovs,
        path: PathOptions {
            max_depth: a.path.max_depth.unwrap_or(DEPTH),
            show_environment: a.path.background,
            ..PathOptions::default()
        },
        ..RenderOptions::default()
    }
}

fn view(a: &Render, scene: &Scene) -> Result<View> {
    let Some(index) = a.camera else {
        let (center, radius) = render::extent(a, scene)?;
        return Ok(View::pinhole(&render::camera(a, center, radius)));
    };
    camera_view(&a.input, scene, index, [a.width() as usize, a.height() as usize])
}

/// What a camera of an asset sees in a picture of `width` x `height` pixels.
pub(crate) fn camera_view(
    input: &Path,
    scene: &Scene,
    index: usize,
    [width, height]: [usize; 2],
) -> Result<View> {
    let camera = scene.cameras.get(index).ok_or_else(|| render::no_camera(input, scene, index))?;
    let mut view = View::pinhole(camera);
    view.half[0] = view.half[1] * width as f32 / height as f32;
    Ok(view)
}

/// The lights that the rasterizer would use, beside those of the asset.
fn add_light(a: &Render, scene: &Scene, parts: &mut Parts) -> Result<()> {
    let (center, radius) = render::extent(a, scene)?;
    let camera = render::camera(a, center, radius);
    let lights = match (a.light, &a.env) {
        (RenderLight::Asset, _) => Vec::new(),
        (RenderLight::Env, Some(file)) => {
            parts.environment = Some(environment(file)?);
            Vec::new()
        }
        (RenderLight::Headlight, _) => render::headlight(&camera, center),
        _ => render::point_light(&camera, center, radius),
    };
    for light in lights {
        match light {
            Light::Point { .. } | Light::Directional { .. } => parts.lights.extend(LightSource::of(&light)),
            Light::Ambient { radiance } => parts.environment = Some(EnvironmentMap::constant(radiance)),
            Light::Environment { .. } => {}
        }
    }
    Ok(())
}

/// The map, as bright as the rasterizer makes it.
fn environment(file: &Path) -> Result<EnvironmentMap> {
    let mut map = EnvironmentMap::new(load_environment(file)?);
    let mean = luminance(map.mean().to_array());
    if mean > 0.0 && mean.is_finite() {
        map.scale = MEAN / mean;
        say(&format!(
            "{}: scaled by {:.4} to a mean radiance of {MEAN} (gradient and recover take it as bright as it is)",
            file.display(),
            map.scale
        ));
    }
    Ok(map)
}

/// Names everything that the pixels depend on and that the renderer does not know: files, lights, the moment.
fn fingerprint(a: &Render, scene: &Scene, parts: &Parts) -> Result<String> {
    let files = stamps(std::iter::once(&a.input).chain(&scene.files).chain(&a.env))?;
    let moment = a.animation.as_ref().map(|name| (name, a.time));
    Ok(format!("{files}|{:?}|{:?}|{moment:?}", a.light, parts.lights))
}

/// Names, sizes and times of files.
pub(crate) fn stamps<'a>(files: impl IntoIterator<Item = &'a PathBuf>) -> Result<String> {
    let stamps = files.into_iter().map(|f| stamp(f)).collect::<Result<Vec<String>>>()?;
    Ok(stamps.join("|"))
}

/// Name, size and time of a file.
fn stamp(path: &Path) -> Result<String> {
    let data = fs::metadata(path).with_context(|| path.display().to_string())?;
    let time = data.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    Ok(format!("{} {} {time:?}", path.display(), data.len()))
}

/// The state beside the output.
pub(crate) fn state_file(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_owned();
    name.push(".state");
    output.with_file_name(name)
}

/// Goes on from a state of the scene, if there is one; which of the guides is its own.
fn resume(
    renderer: &mut Renderer<'_>,
    state: &Path,
    scene: &str,
    guides: &[String],
) -> Result<Option<usize>> {
    if !state.try_exists().with_context(|| state.display().to_string())? {
        say(&format!("{}: no saved state, the render begins anew", state.display()));
        return Ok(None);
    }
    // One of this picture has as many bytes as it has now; that of another one is read, so that what differs is told.
    let most = (renderer.state_bytes() as u64).max(OTHER_STATE);
    let bytes = photofit_image::file_bytes(state, most)?;
    let found = renderer.resume(scene, guides, &bytes).map_err(|e| anyhow!("{}: {e}", state.display()))?;
    let Progress { samples, total, .. } = renderer.progress();
    say(&match samples {
        more if more > total => {
            format!("resuming at {more} samples, more than the {total} that are asked for")
        }
        _ => format!("resuming at {samples} of {}", output::counted(total as usize, "sample")),
    });
    Ok(Some(found))
}

/// How directions are chosen: a guide changes the paths, so that a state belongs to renders whose guide is trained in the same way.
fn guide_key(a: &Render, training: Option<&GuidingOptions>) -> String {
    match (guiding(a), training) {
        (Guiding::Off, _) => String::new(),
        (guide, None) => format!("{}: given up", guide.name()),
        (_, Some(training)) => format!("{training:?}"),
    }
}

/// The state of a render on its way to a file. A disk that refuses it does not end the render: the user is told, and the
/// next one is tried.
struct Keeper<'a> {
    file: &'a Path,
    /// What the scene is called.
    scene: &'a str,
    /// How the guide was trained, once that is known.
    guide: Option<String>,
    /// Why the last state is not there, as it was told; empty when it is.
    refusal: String,
    /// Whether the file holds a state that this render can go on from.
    kept: bool,
}

impl Keeper<'_> {
    fn save(&mut self, terminal: &Terminal, renderer: &Renderer<'_>) {
        // Before the first sample there is nothing to keep.
        let Some(guide) = self.guide.as_deref().filter(|_| renderer.progress().samples > 0) else { return };
        let state = renderer.save(self.scene, guide);
        let refusal = match photofit_image::write_atomically(self.file, &state) {
            Ok(()) => {
                (self.kept, self.refusal) = (true, String::new());
                return;
            }
            Err(e) => e.to_string(),
        };
        if refusal != self.refusal {
            terminal.warn(&format!("the state could not be saved, the render goes on: {refusal}"));
            self.refusal = refusal;
        }
    }

    /// What can be done with an unfinished render.
    fn told(&self) -> &'static str {
        match (self.refusal.is_empty(), self.kept && self.file.is_file()) {
            (true, true) => "--resume goes on",
            (true, false) => "there is nothing yet that --resume could go on from",
            (false, true) => "the state could not be saved; --resume goes on from the last one that could be",
            (false, false) => "the state could not be saved; --resume cannot go on",
        }
    }
}

/// Trains a guide if one is wanted, and renders until nothing is left to do, time is over or Ctrl-C; whether all is done.
///
/// A render that goes on trains as the `earlier` one did, or not at all if that had no guide.
fn work(
    a: &Render,
    renderer: &mut Renderer<'_>,
    keeper: &mut Keeper<'_>,
    earlier: Option<Option<GuidingOptions>>,
) -> Result<(bool, Guidance)> {
    let terminal = Terminal::new();
    let began = Instant::now();
    if earlier.is_some() && renderer.progress().done {
        return Ok((true, Guidance::off()));
    }
    let over = || a.path.time_limit.is_some_and(|limit| began.elapsed() >= limit);
    let options = earlier.unwrap_or_else(|| Some(training(a, renderer.options())));
    let guidance = match &options {
        Some(options) => Guidance::train(renderer, options, || terminal.is_cancelled() || over())?,
        None => Guidance::off(),
    };
    match guidance.report() {
        Some(report) => say(&report.sentence()),
        None if guiding(a) == Guiding::Off => {}
        None if guidance.has_diverged() => say("guiding is off: training diverged"),
        None if terminal.is_cancelled() => {
            terminal.finish();
            say("stopped while the guide learned; --resume begins that anew");
            return Ok((false, guidance));
        }
        None if earlier.flatten().is_some() => {
            say(
                "--time-limit was over before the guide had learned again what it knew; no sample was added, it must be longer",
            );
            return Ok((false, guidance));
        }
        None if options.is_none() => say("guiding is off, as it was before"),
        None => say(&format!(
            "guiding is off: training was given up after {:.1} s, {:.0} % of --time-limit",
            guidance.seconds(),
            100.0 * TRAINING_SHARE
        )),
    }
    let trained = options.zip(guidance.report()).map(|(options, r)| options.as_trained(r));
    keeper.guide = Some(guide_key(a, trained.as_ref()));
    if a.path.explain && guiding(a) != Guiding::Off {
        if guidance.report().is_some() {
            print(&format!("paths that a guide learns from\n{}", renderer.sampled_plan()))?;
        }
        match guidance.is_on() {
            true => print("guided path tracing\n  as these paths\n")?,
            false => print(&format!("path tracing, not guided\n{}", renderer.plan()))?,
        }
        output::name_suite(SUITE)?;
    }
    // The time of the samples counts from here, without that of training.
    report(&terminal, a, &renderer.progress(), began);
    let mut saved = Instant::now();
    let every = a.path.save_every.unwrap_or(SAVE_EVERY).max(SAVE_LEAST);
    loop {
        let due = || saved.elapsed() >= every;
        let progress = guidance.pass(renderer, || terminal.is_cancelled() || over() || due());
        report(&terminal, a, &progress, began);
        let stopped = terminal.is_cancelled() || over();
        if !progress.done && (due() || stopped) {
            keeper.save(&terminal, renderer);
            saved = Instant::now();
        }
        if progress.done || stopped {
            terminal.finish();
            if !progress.done {
                let share = 100.0 * progress.samples as f64 / progress.total as f64;
                say(&format!("stopped at {share:.1}% of the samples; {}", keeper.told()));
            }
            return Ok((progress.done, guidance));
        }
    }
}

/// Pixels of the picture.
fn pixels(a: &Render) -> u64 {
    u64::from(a.width()) * u64::from(a.height())
}

/// Samples of a pixel, on average.
fn per_pixel(a: &Render, progress: &Progress) -> f64 {
    progress.samples as f64 / pixels(a) as f64
}

/// Progress against samples, or against time where that is what ends the render.
fn report(terminal: &Terminal, a: &Render, progress: &Progress, began: Instant) {
    let spp = per_pixel(a, progress);
    let note = if progress.noise.is_finite() {
        format!("{spp:.0} spp, noise {:.3}", progress.noise)
    } else {
        format!("{spp:.0} spp")
    };
    let (done, total) = match (a.path.time_limit, a.path.noise) {
        (Some(limit), _) => (began.elapsed().as_millis() as u64, limit.as_millis() as u64),
        // Noise falls with the square root of the samples.
        (None, Some(noise)) if progress.noise.is_finite() => {
            let needed = progress.samples as f64 * (progress.noise / f64::from(noise)).powi(2).max(1.0);
            (progress.samples, (needed as u64).min(progress.total))
        }
        _ => (progress.samples, progress.total),
    };
    terminal.report("path tracing", done.min(total), total, &note);
}

fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

fn write(a: &Render, renderer: &Renderer<'_>) -> Result<()> {
    let picture = renderer.picture();
    if !is_exr(&a.output) {
        photofit_image::write_png(&a.output, &display(a, &picture))?;
        return Ok(());
    }
    let images: Vec<(Aov, Image)> =
        Aov::ALL.into_iter().filter_map(|aov| Some((aov, renderer.aov(aov)?))).collect();
    let mut layers: Vec<(&str, &Image, &[&str])> = vec![("", &picture, &["R", "G", "B", "A"])];
    layers.extend(images.iter().map(|(aov, image)| (aov.name(), image, aov.channels())));
    let progress = renderer.progress();
    let spp = per_pixel(a, &progress);
    let (spp, noise) = (format!("{spp:.2}"), format!("{:.6}", progress.noise));
    let (seed, depth) = (a.path.seed.unwrap_or(0).to_string(), a.path.max_depth.unwrap_or(DEPTH).to_string());
    let metadata = [
        ("software", concat!("photofit ", env!("CARGO_PKG_VERSION"))),
        ("photofit/integrator", "path"),
        ("photofit/spp", spp.as_str()),
        ("photofit/noise", noise.as_str()),
        ("photofit/seed", seed.as_str()),
        ("photofit/max_depth", depth.as_str()),
    ];
    photofit_image::write_exr_channels(&a.output, &layers, &metadata)?;
    Ok(())
}

/// Straight alpha, exposed and tone mapped for a display.
fn display(a: &Render, picture: &Image) -> Image {
    let mut out = picture.clone();
    let factor = a.path.exposure.exp2();
    for p in out.data.chunks_exact_mut(4) {
        // Behind the asset the environment has no alpha, but is shown.
        if a.path.background {
            p[3] = 1.0;
        }
        let scale = if p[3] > 0.0 { factor / p[3] } else { factor };
        let color = [p[0] * scale, p[1] * scale, p[2] * scale];
        p[..3].copy_from_slice(&if a.path.tone_map { tone_map(color) } else { color });
    }
    out
}
