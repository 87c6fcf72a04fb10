//! `photofit recover scene`: parameters of a scene from a path-traced picture of it.

use crate::args::{RecoverScene, TextureSmoothing};
use crate::output::{self, print};
use crate::parameter_scene::{Key, Subject};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::simplify::{CHECKPOINT_FILE, name_options};
use crate::status::{Ending, Misuse};
use crate::{interrupt, threads};
use anyhow::{Context, Result, anyhow, bail};
use photofit_fit::engine::traced::{Smoothing, Traced, TracedParameter};
use photofit_fit::engine::trainer::Keeping;
use photofit_fit::recover_scene::{RecoverSceneOptions, RecoveredScene, recover_scene};
use photofit_image::Image;
use photofit_pathtrace::{MaterialValue, Parameter, World};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// Files of the output folder that every run writes.
const FILES: [&str; 5] = ["reference.png", "start.png", "recovered.png", "recovered.exr", "values.json"];
/// Samples per pixel of the target of a self-test, and of the pictures that are written.
const TARGET_SPP: u32 = 512;
const SHOWN_SPP: u32 = 128;
/// Seeds of these pictures, apart from those of the fit.
const TARGET_SEED: u64 = 0x7461_7267;
const SHOWN_SEED: u64 = 0x7368_6f77;
/// Values without an upper bound of their own.
const MOST: f32 = 1e6;
/// Least radiance: what gives no light at all is not found by paths, and would stay dark.
const FAINT: f32 = 1e-4;

pub(crate) fn run(a: &RecoverScene) -> Result<Ending> {
    let textures: Vec<String> =
        a.parameter.iter().flat_map(|k| ["exr", "png"].map(|e| format!("{}.{e}", file_name(k)))).collect();
    for (i, name) in textures.iter().enumerate() {
        if let Some(j) = textures[..i].iter().position(|t| t == name) {
            bail!(Misuse(format!(
                "--parameter: {} and {} would be written to one file, {name}; each must have its own",
                a.parameter[j / 2],
                a.parameter[i / 2]
            )));
        }
    }
    let files: Vec<&str> = FILES.into_iter().chain(textures.iter().map(String::as_str)).collect();
    let places = Places::default()
        .reads("SCENE", Some(&a.scene.input))
        .reads("--env", a.scene.env.as_deref())
        .reads("--picture", a.picture.as_deref())
        .fills("--output", Some(&a.output), &files)
        .fills("--checkpoint", a.checkpoint.as_deref(), &[CHECKPOINT_FILE]);
    places.check()?;
    threads::set(a.threads)?;
    let subject = Subject::load(&a.scene, &places)?;
    let mut model = model(a, subject)?;
    let (target, truth) = match &a.picture {
        Some(file) => (read_target(file, &model)?, None),
        None => {
            let truth: Vec<Vec<f32>> = (0..model.parameters.len()).map(|k| model.of(k).to_vec()).collect();
            (model.picture(0, TARGET_SPP, TARGET_SEED)?, Some(truth))
        }
    };
    begin(a, &mut model)?;
    std::fs::create_dir_all(&a.output).with_context(|| a.output.display().to_string())?;
    photofit_image::write_png(a.output.join("reference.png"), &shown(&target))?;
    photofit_image::write_png(a.output.join("start.png"), &shown(&model.picture(0, SHOWN_SPP, SHOWN_SEED)?))?;
    let errors =
        |m: &Traced| truth.as_ref().map(|t| (0..t.len()).map(|k| rmse(m.of(k), &t[k])).collect::<Vec<f64>>());
    let first = errors(&model);
    let options = RecoverSceneOptions {
        steps: a.steps,
        rate: a.rate,
        seed: a.scene.seed,
        keeping: Keeping { checkpoint: a.checkpoint.clone(), resume: a.resume, time_limit: a.time_limit },
    };
    interrupt::handle();
    let progress = Terminal::new();
    let began = Instant::now();
    let r = recover_scene(model, &[target], &options, &progress).map_err(name_options)?;
    let seconds = began.elapsed().as_secs_f64();
    progress.finish();
    if r.stopped {
        say("the fit was ended early; what was reached is written");
    }
    let last = errors(&r.model);
    write(a, &r, first.zip(last), seconds)?;
    let stopped = r.stopped && interrupt::is_stopping();
    Ok(if stopped { Ending::Stopped } else { Ending::Done })
}

/// The parameters of the command line in the scene's world.
fn model(a: &RecoverScene, subject: Subject) -> Result<Traced> {
    let named = |e: &dyn std::fmt::Display| anyhow!("{}: {e}", a.scene.input.display());
    let mut parameters = Vec::new();
    for name in &a.parameter {
        let Key { name, parameter, shape } = subject.find(&a.scene, name)?.clone();
        let range = range(&parameter, &name);
        parameters.push(TracedParameter { name, parameter, shape, range });
    }
    let mut options = subject.options;
    options.spp = a.spp;
    let world = World::with_options(subject.parts, subject.world).map_err(|e| named(&e))?;
    let mut model = Traced::new(world, vec![subject.view], options, parameters).map_err(|e| named(&e))?;
    model.gradient_spp = a.gradient_spp;
    model.smoothing = match a.smoothing {
        TextureSmoothing::Adam => Smoothing::None,
        TextureSmoothing::Laplacian => Smoothing::Laplacian,
        TextureSmoothing::Bilateral => Smoothing::Bilateral,
    };
    Ok(model)
}

/// Lowest and highest value of a parameter.
fn range(parameter: &Parameter, name: &str) -> [f32; 2] {
    match parameter {
        Parameter::Material { value, .. } => match value {
            MaterialValue::Alpha => [1e-3, 1.0],
            MaterialValue::Roughness => [0.03, 1.0],
            MaterialValue::Emission | MaterialValue::Emissive => [FAINT, MOST],
            MaterialValue::Absorption => [0.0, MOST],
            _ => [0.0, 1.0],
        },
        Parameter::Light { .. } | Parameter::Environment => [FAINT, MOST],
        _ if name.ends_with("emissive_texture") || name.contains(".radiance") => [FAINT, MOST],
        _ if name.contains(".alpha") => [1e-3, 1.0],
        _ => [0.0, 1.0],
    }
}

/// Sets the values that the fit starts from.
fn begin(a: &RecoverScene, model: &mut Traced) -> Result<()> {
    for k in 0..model.parameters.len() {
        let values = model.of(k);
        let [low, high] = model.parameters[k].range;
        let start = match a.start {
            Some(x) => x as f32,
            None if !a.self_test => continue,
            None if high <= 1.0 => 0.5 * (low + high),
            None => 2.0 * values.iter().sum::<f32>() / values.len().max(1) as f32,
        };
        let flat = vec![start.clamp(low, high); values.len()];
        model.replace(k, &flat)?;
    }
    Ok(())
}

fn read_target(file: &Path, model: &Traced) -> Result<Image> {
    let image = photofit_image::read(file)?;
    let (w, h) = (model.options.width, model.options.height);
    let name = file.display();
    if (image.width, image.height) != (w, h) {
        bail!("{name}: is {} x {} pixels; it must be {w} x {h}, as the picture", image.width, image.height);
    }
    if image.channels < 3 {
        bail!("{name}: has {} channels; it must have three or four", image.channels);
    }
    if let Some(i) = image.data.iter().position(|v| !v.is_finite()) {
        let pixel = i / image.channels;
        bail!("{name}: pixel ({}, {}) is {}; it must be finite", pixel % w, pixel / w, image.data[i]);
    }
    Ok(Image::from_fn(w, h, 4, |x, y, c| if c < image.channels { image.pixel(x, y)[c] } else { 1.0 }))
}

/// A picture for people: without alpha.
fn shown(picture: &Image) -> Image {
    Image::from_fn(picture.width, picture.height, 3, |x, y, c| picture.pixel(x, y)[c])
}

fn rmse(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

/// A key as the name of a file.
fn file_name(key: &str) -> String {
    key.chars().map(|c| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect()
}

fn write(
    a: &RecoverScene,
    r: &RecoveredScene,
    errors: Option<(Vec<f64>, Vec<f64>)>,
    seconds: f64,
) -> Result<()> {
    let picture = r.model.picture(0, SHOWN_SPP, SHOWN_SEED)?;
    photofit_image::write_png(a.output.join("recovered.png"), &shown(&picture))?;
    photofit_image::write_exr(a.output.join("recovered.exr"), &[("", &picture, &["R", "G", "B", "A"])])?;
    let mut list = Vec::new();
    let mut text = String::new();
    for (k, p) in r.model.parameters.iter().enumerate() {
        let ([h, w, channels], values) = (p.shape, r.model.of(k));
        let mut entry = json!({ "parameter": p.name, "shape": p.shape });
        if h * w == 1 {
            entry["value"] = json!(values);
            text += &format!(
                "{}  {}\n",
                p.name,
                values.iter().map(|v| format!("{v:.5}")).collect::<Vec<_>>().join("  ")
            );
        } else {
            let image =
                Image::from_fn(w, h, 3, |x, y, c| values[(y * w + x) * channels + c.min(channels - 1)]);
            let name = file_name(&p.name);
            photofit_image::write_exr(
                a.output.join(format!("{name}.exr")),
                &[("", &image, &["R", "G", "B"])],
            )?;
            photofit_image::write_png(a.output.join(format!("{name}.png")), &image)?;
            entry["file"] = json!(format!("{name}.exr"));
            text += &format!("{}  {h} x {w} texels in {name}.exr\n", p.name);
        }
        if let Some((first, last)) = &errors {
            entry["parameter_error"] = json!({ "first": first[k], "last": last[k] });
            text += &format!("    error {:.5} -> {:.5}\n", first[k], last[k]);
        }
        list.push(entry);
    }
    let told: Vec<_> = r.history.iter().filter(|h| h.loss > 0.0).collect();
    let end = |h: Option<&&photofit_fit::engine::trainer::HistoryPoint>| h.map(|h| h.loss);
    let psnr = |h: Option<&photofit_fit::engine::trainer::HistoryPoint>| h.map(|h| h.held_out_psnr);
    let best = r.history.iter().map(|h| h.held_out_psnr).fold(f64::NEG_INFINITY, f64::max);
    let figures: Value = json!({
        "input": a.scene.input.display().to_string(),
        "parameters": list,
        "steps": r.steps,
        "stopped": r.stopped,
        "seconds": seconds,
        "seconds_per_iteration": seconds / r.steps.max(1) as f64,
        "loss": { "first": end(told.first()), "last": end(told.last()) },
        "psnr": { "first": psnr(r.history.first()), "best": best },
        "course": r.history.iter().map(|h| json!({"step": h.step, "loss": h.loss, "psnr": h.held_out_psnr})).collect::<Vec<_>>(),
    });
    output::write_json(&a.output.join("values.json"), &figures)?;
    let start = psnr(r.history.first()).unwrap_or(best);
    text += &format!(
        "picture {start:.2} -> {best:.2} dB, {} steps, {seconds:.1} s\nwrote {}\n",
        r.steps,
        a.output.display()
    );
    print(&text)
}
