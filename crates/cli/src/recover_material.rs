//! `photofit recover material`: the materials of a mesh and the light around it from pictures with cameras.

use crate::args::{RecoverMaterial, RenderGuiding};
use crate::fields::{RECOVER_MATERIAL, explain_error};
use crate::output::{self, Results};
use crate::preflight::Places;
use crate::progress::{Terminal, say_warnings};
use crate::status::{Ending, Misuse};
use crate::traced_report::{Found, course, first_and_best, judged, sheet, tell_course};
use crate::{guided, interrupt, memory, threads};
use anyhow::{Context, Result, anyhow, bail};
use photofit_fit::FitError;
use photofit_fit::engine::chain::checkpoint_files;
use photofit_fit::footprint::Task;
use photofit_fit::pictures::{named_files, world_pictures};
use photofit_fit::recover_material::{
    KnownMaterial, MaterialErrors, RecoverMaterialOptions, RecoveredMaterial, around, first_sky, guiding,
    recover_material,
};
use photofit_fit::report::PAGE;
use photofit_image::{Image, contact_sheet};
use photofit_pathtrace::View;
use photofit_scene::Scene;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// Samples per pixel of the pictures of a self-test.
const TARGET_SPP: u32 = 256;
/// Samples and seed of the pictures that are written.
const SHOWN_SPP: u32 = 128;
const SHOWN_SEED: u64 = 0x7368_6f77;
/// Files of the output.
const FILES: [&str; 6] = ["material.glb", "environment.exr", "views.png", "relit.png", "values.json", PAGE];

pub(crate) fn run(a: &RecoverMaterial) -> Result<Ending> {
    let checkpoints = checkpoint_files(a.rounds);
    let checkpoints: Vec<&str> = checkpoints.iter().map(String::as_str).collect();
    let places = Places::default()
        .reads("PICTURES", a.pictures.as_deref())
        .reads("--mesh", a.mesh.as_deref())
        .reads("--self-test", a.self_test.as_deref())
        .reads("--env", a.env.as_deref())
        .fills("--output", Some(&a.output), &FILES)
        .fills("--checkpoint", a.course.running.checkpoint.as_deref(), &checkpoints);
    places.check()?;
    if a.rounds < 2 && !matches!(a.guiding, RenderGuiding::Off) {
        bail!(Misuse("--guiding: the first round has no guide; --rounds must be at least 2".into()));
    }
    if let Some(pictures) = &a.pictures {
        places.check_against("PICTURES", &named_files(pictures))?;
    }
    threads::set(a.course.running.threads)?;
    let (option, file) = match (&a.mesh, &a.self_test) {
        (Some(mesh), _) => ("--mesh", mesh),
        (None, Some(asset)) => ("--self-test", asset),
        (None, None) => bail!("no mesh"),
    };
    let mesh = photofit_scene::load(file)?;
    places.check_against(option, &mesh.files)?;
    say_warnings(file, &mesh);
    memory::check_fit(Task::Recover, a.texture_size, file, &[&mesh])?;
    let named = |e: FitError| failed(a, file, e);
    mesh.validate_for_fit().map_err(|e| named(e.into()))?;
    let environment = a.env.as_ref().map(photofit_scene::load_environment).transpose()?;
    let (known, views, pictures) = seen(a, &mesh, environment.as_ref()).map_err(named)?;
    std::fs::create_dir_all(&a.output).with_context(|| a.output.display().to_string())?;
    interrupt::handle();
    let progress = Terminal::new();
    let began = Instant::now();
    let options = options(a, environment);
    let r = recover_material(&mesh, &views, &pictures, &options, &progress).map_err(named)?;
    let seconds = began.elapsed().as_secs_f64();
    progress.finish();
    tell_course(r.stopped, a.course.explain.then_some(&r.plan))?;
    let mut results = Results::default();
    let path = |name: &str| a.output.join(name);
    let written = photofit_scene::save_glb(path(FILES[0]), &r.asset).map_err(Into::into);
    // Errors of a self-test are those of what was written; the sheet and the page show the model, before it is rounded to 8 bits.
    let file_is_there = results.took(written);
    let asset = if file_is_there { photofit_scene::load(path(FILES[0]))? } else { r.asset.clone() };
    let layers = [("", &r.environment, &["R", "G", "B"][..])];
    results.took(photofit_image::write_exr(path(FILES[1]), &layers).map_err(Into::into));
    let errors = known.as_ref().map(|k| k.errors(&asset)).transpose()?;
    output::keep_json(&mut results, &path(FILES[4]), &figures(a, &r, errors.as_ref(), seconds))?;
    let targets: Vec<Image> =
        views.iter().zip(&pictures).map(|(v, p)| target(a, &r, v, p)).collect::<Result<_>>()?;
    let sheet = sheet(&r.model, &views, &targets, (SHOWN_SPP, SHOWN_SEED))?;
    results.took(photofit_image::write_png(path(FILES[2]), &sheet).map_err(Into::into));
    if let Some((known, errors)) = known.as_ref().zip(errors.as_ref()) {
        let pictures = known.under_another_sky(&asset, errors.albedo_scale)?;
        let columns = pictures[0].len().max(1);
        let images: Vec<Image> = pictures.iter().flatten().map(|p| p.select(&[0, 1, 2])).collect();
        let sheet = contact_sheet(&images.iter().collect::<Vec<_>>(), columns, 4);
        results.took(photofit_image::write_png(path(FILES[3]), &sheet).map_err(Into::into));
    }
    let judged = judged(r.held_out, views.len());
    let reached = output::traced_error(&judged, first_and_best(&r.history), (r.steps, seconds));
    let found = Found {
        title: format!("materials of {} from pictures", crate::simplify::name(file)),
        reached: &reached,
        model: &r.model,
        views: &views,
        targets: &targets,
        held_out: r.held_out,
        history: &r.history,
        plan: &r.plan,
        sampled: (SHOWN_SPP, SHOWN_SEED),
    };
    found.tell(&a.output, &told(file, &r, errors.as_ref()), results)?;
    let stopped = r.stopped && interrupt::is_stopping();
    Ok(if stopped { Ending::Stopped } else { Ending::Done })
}

/// The error of a fit with the file that it is of.
fn failed(a: &RecoverMaterial, mesh: &Path, error: FitError) -> anyhow::Error {
    match (error, &a.pictures) {
        (FitError::Setting { field: "pictures", rule }, Some(pictures)) => {
            anyhow!("{}: the pictures {rule}", pictures.display())
        }
        (FitError::Scene(e), _) if !e.to_string().contains(&mesh.display().to_string()) => {
            anyhow!("{}: {e}", mesh.display())
        }
        (error, _) => explain_error(RECOVER_MATERIAL, mesh, error),
    }
}

fn options(a: &RecoverMaterial, environment: Option<Image>) -> RecoverMaterialOptions {
    // That of a self-test is to be found, unless it is known.
    let environment = match (&a.self_test, a.keep_environment) {
        (None, _) => environment,
        (Some(_), true) => Some(environment.unwrap_or_else(first_sky)),
        (Some(_), false) => None,
    };
    RecoverMaterialOptions {
        texture_size: a.texture_size,
        environment_size: a.environment_size,
        environment,
        keep_environment: a.keep_environment,
        unwrap: a.unwrap,
        normal_map: a.normal_map,
        background: a.background,
        guiding: guiding(a.guiding.into()),
        rounds: a.rounds,
        steps: a.traced.steps,
        rate: a.traced.rate,
        spp: a.traced.spp,
        gradient_spp: a.traced.gradient_spp,
        max_depth: a.max_depth,
        smoothing: a.traced.smoothing.unwrap_or(RecoverMaterialOptions::default().smoothing),
        seed: a.course.running.seed,
        checkpointing: a.course.checkpointing(),
    }
}

/// What is known of a self-test, cameras and pictures.
type Seen<'a> = (Option<KnownMaterial<'a>>, Vec<View>, Vec<Image>);

fn seen<'a>(a: &RecoverMaterial, mesh: &'a Scene, environment: Option<&Image>) -> Result<Seen<'a>, FitError> {
    if let Some(list) = &a.pictures {
        let (views, pictures) = world_pictures(list)?.into_iter().map(|p| (p.camera.view(), p.image)).unzip();
        return Ok((None, views, pictures));
    }
    let sky = environment.cloned().unwrap_or_else(first_sky);
    let sampled = (a.resolution, TARGET_SPP);
    let known =
        KnownMaterial::new(mesh, &sky, around(mesh, a.views)?, sampled, a.background, a.course.running.seed)?;
    let (views, pictures) = (known.views.clone(), known.pictures.clone());
    Ok((Some(known), views, pictures))
}

/// A picture without what is behind the mesh, where that is not compared.
fn target(a: &RecoverMaterial, r: &RecoveredMaterial, view: &View, picture: &Image) -> Result<Image> {
    let is_cut_out = picture.data.chunks_exact(4).any(|p| p[3] < 1.0);
    if a.background || is_cut_out {
        return Ok(picture.clone());
    }
    let outline = r.model.picture(view, 4, SHOWN_SEED)?;
    Ok(Image::from_fn(picture.width, picture.height, 4, |x, y, c| {
        picture.pixel(x, y)[c] * outline.pixel(x, y)[3]
    }))
}

fn told(file: &Path, r: &RecoveredMaterial, errors: Option<&MaterialErrors>) -> String {
    let mut text = String::new();
    for line in &r.left_out {
        text += &format!("{}: left out: {line}\n", file.display());
    }
    if let Some(e) = errors {
        text += &format!(
            "mean error of base colour {:.4} ({:.4} after the best factor of each channel), roughness {:.4}, metalness {:.4}\n\
             under another environment: {:.2} dB ({:.2} after that factor)\n",
            e.albedo, e.scaled_albedo, e.roughness, e.metallic, e.relit, e.scaled_relit
        );
    }
    for (k, guide) in r.guides.iter().enumerate() {
        text += &format!("round {}: {}\n", k + 2, guide.sentence());
    }
    text
}

fn figures(
    a: &RecoverMaterial,
    r: &RecoveredMaterial,
    errors: Option<&MaterialErrors>,
    seconds: f64,
) -> Value {
    let path = |p: &Option<std::path::PathBuf>| p.as_ref().map(|p| p.display().to_string());
    let [first, best] = first_and_best(&r.history);
    let finite = |v: f64| v.is_finite().then_some(v);
    let known = |e: &MaterialErrors| {
        json!({
            "albedo": e.albedo, "scaled_albedo": e.scaled_albedo, "albedo_scale": e.albedo_scale,
            "roughness": e.roughness, "metallic": e.metallic, "relit_psnr": finite(e.relit),
            "scaled_relit_psnr": finite(e.scaled_relit),
        })
    };
    let own = r.steps.saturating_sub(r.resumed);
    json!({
        "pictures": path(&a.pictures),
        "mesh": path(&a.mesh),
        "self_test": path(&a.self_test),
        "unwrapped": r.unwrapped,
        "environment": [r.environment.width, r.environment.height],
        "guiding": r.guides.iter().map(guided::figures).collect::<Vec<_>>(),
        "errors": errors.map(known),
        "held_out": r.held_out,
        "steps": r.steps,
        "stopped": r.stopped,
        "seconds": seconds,
        "seconds_per_iteration": (own > 0).then(|| seconds / own as f64),
        "relative_error": { "first": first, "best": best },
        "left_out": r.left_out,
        "course": course(&r.history),
    })
}
