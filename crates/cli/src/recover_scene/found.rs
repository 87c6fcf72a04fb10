//! What `photofit recover scene` writes: pictures before and after, textures, grids, `values.json`, `index.html`.

use crate::args::RecoverScene;
use crate::output::{self, Results};
use crate::parameter_scene::{Quantity, tensor};
use crate::status::Misuse;
use crate::traced_report::{Found, course, first_and_best, judged};
use anyhow::{Result, bail};
use glam::DVec3;
use photofit_fit::engine::traced::Traced;
use photofit_fit::engine::trainer::HistoryPoint;
use photofit_fit::recover_scene::{RecoveredScene, relative_error};
use photofit_fit::report::PAGE;
use photofit_image::{Image, PngCompression, encode_png, write_atomically};
use photofit_pathtrace::{Parameter, View};
use photofit_scene::mitsuba::encode_grid;
use serde_json::{Value, json};
use std::path::Path;

/// Samples per pixel of the pictures that are written, and their seed, apart from that of the fit.
const SHOWN_SPP: u32 = 128;
const SHOWN_SEED: u64 = 0x7368_6f77;

/// Files that a parameter may be written to: textures, grids.
const KINDS: [&str; 3] = ["exr", "png", "vol"];

/// The names of all files that are written for this number of views.
///
/// # Errors
/// If a parameter is given twice, or two would be written to one file.
pub(super) fn files(a: &RecoverScene, views: usize) -> Result<Vec<String>> {
    let mut out: Vec<String> =
        a.parameter.iter().flat_map(|k| KINDS.map(|e| format!("{}.{e}", file_name(k)))).collect();
    for (i, name) in out.iter().enumerate() {
        if let Some(j) = out[..i].iter().position(|t| t == name) {
            let [first, second] = [j, i].map(|k| &a.parameter[k / KINDS.len()]);
            if first == second {
                bail!(Misuse(format!("--parameter: {first} is given twice; once is enough")));
            }
            bail!(Misuse(format!(
                "--parameter: {first} and {second} would be written to one file, {name}; each must have its own"
            )));
        }
    }
    out.extend(["values.json", PAGE].map(String::from));
    for view in 0..views {
        let of = |(what, end)| of_view(what, view, end);
        out.extend(
            [("reference", "png"), ("start", "png"), ("recovered", "png"), ("recovered", "exr")].map(of),
        );
    }
    Ok(out)
}

/// A key as the name of a file.
fn file_name(key: &str) -> String {
    key.chars().map(|c| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect()
}

/// The file of a picture of a view: the first has no number.
fn of_view(what: &str, view: usize, end: &str) -> String {
    if view == 0 { format!("{what}.{end}") } else { format!("{what}_{view}.{end}") }
}

/// A picture for people: without alpha.
fn shown(picture: &Image) -> Image {
    Image::from_fn(picture.width, picture.height, 3, |x, y, c| picture.pixel(x, y)[c])
}

/// The pictures of the start, one for each view.
pub(super) fn starts(model: &Traced, views: &[View]) -> Result<Vec<Image>> {
    Ok(views.iter().map(|camera| model.picture(camera, SHOWN_SPP, SHOWN_SEED)).collect::<Result<_, _>>()?)
}

/// Writes the targets and the pictures of the start.
pub(super) fn write_start(folder: &Path, starts: &[Image], targets: &[Image]) -> Result<()> {
    for (view, (start, target)) in starts.iter().zip(targets).enumerate() {
        photofit_image::write_png(folder.join(of_view("reference", view, "png")), &shown(target))?;
        photofit_image::write_png(folder.join(of_view("start", view, "png")), &shown(start))?;
    }
    Ok(())
}

/// Share of the error before that the last evaluation is below while a fit improves.
const STILL: f64 = 0.97;

/// Writes what was found, with the errors of the parameters before and after where they are known.
pub(super) fn write(
    a: &RecoverScene,
    r: &RecoveredScene,
    (views, targets): (&[View], &[Image]),
    (quantities, boxes): (&[Quantity], &[[DVec3; 2]]),
    errors: Option<(Vec<f64>, Vec<f64>)>,
    seconds: f64,
) -> Result<()> {
    // Values come first: on a disk that is nearly full, pictures are what is missing.
    let mut results = Results::default();
    let mut list = Vec::new();
    let mut text = String::new();
    for (k, quantity) in quantities.iter().enumerate() {
        let (mut entry, mut line) = one(&a.output, &r.model, k, (*quantity, boxes[k]), &mut results);
        if let Some((first, last)) = &errors {
            entry["parameter_error"] = json!({ "first": first[k], "last": last[k] });
            line += &format!("    error {:.5} -> {:.5}\n", first[k], last[k]);
        }
        list.push(entry);
        text += &line;
    }
    let [first, best] = first_and_best(&r.history);
    let figures = figures(a, r, views.len(), list, [first, best], seconds);
    output::keep_json(&mut results, &a.output.join("values.json"), &figures)?;
    for (view, camera) in views.iter().enumerate() {
        let picture = r.model.picture(camera, SHOWN_SPP, SHOWN_SEED)?;
        let file = a.output.join(of_view("recovered", view, "png"));
        results.took(photofit_image::write_png(file, &shown(&picture)).map_err(Into::into));
        let file = a.output.join(of_view("recovered", view, "exr"));
        let layers = [("", &picture, &["R", "G", "B", "A"][..])];
        results.took(photofit_image::write_exr(file, &layers).map_err(Into::into));
    }
    let judged = judged(r.held_out, views.len());
    // The last of the evaluations was the best, and better than those before by more than their noise.
    let errors: Vec<f64> = r.history.iter().map(|h| relative_error(h.quality)).collect();
    if let ([.., before, last], true) = (&errors[..], r.steps >= a.traced.steps && !r.stopped)
        && *last < STILL * before
        && best == Some(*last)
    {
        text += "the error still fell when the steps were made: more of --steps may find more\n";
    }
    let reached = output::traced_error(&judged, [first, best], (r.steps, seconds));
    let found = Found {
        title: format!("{} from pictures", crate::simplify::name(&a.scene.input)),
        reached: &reached,
        model: &r.model,
        views,
        targets,
        held_out: r.held_out,
        history: &r.history,
        plan: &r.plan,
        sampled: (SHOWN_SPP, SHOWN_SEED),
    };
    found.tell(&a.output, &text, results)
}

/// Writes a parameter: its entry in the JSON and its line for people.
fn one(
    folder: &Path,
    model: &Traced,
    k: usize,
    (quantity, bounds): (Quantity, [DVec3; 2]),
    results: &mut Results,
) -> (Value, String) {
    let (p, values) = (&model.parameters[k], model.of(k));
    let [slices, h, w, channels] = p.shape;
    let mut entry = json!({ "parameter": p.name, "shape": tensor(&p.shape) });
    if p.cells() == 1 {
        entry["value"] = json!(values);
        let each: Vec<String> = values.iter().map(|v| format!("{v:.5}")).collect();
        return (entry, format!("{}  {}\n", p.name, each.join("  ")));
    }
    if matches!(p.parameter, Parameter::Medium { .. }) {
        let file = format!("{}.vol", file_name(&p.name));
        let bytes = encode_grid([w, h, slices], values, bounds);
        results.took(write_atomically(folder.join(&file).as_path(), &bytes).map_err(Into::into));
        entry["file"] = json!(file);
        return (entry, format!("{}  {slices} x {h} x {w} voxels in {file}\n", p.name));
    }
    let image = Image::from_fn(w, h, 3, |x, y, c| values[(y * w + x) * channels + c.min(channels - 1)]);
    let name = file_name(&p.name);
    let layers = [("", &image, &["R", "G", "B"][..])];
    results.took(photofit_image::write_exr(folder.join(format!("{name}.exr")), &layers).map_err(Into::into));
    results.took(write_texture(&folder.join(format!("{name}.png")), &image, quantity));
    entry["file"] = json!(format!("{name}.exr"));
    (entry, format!("{}  {h} x {w} texels in {name}.exr\n", p.name))
}

/// Writes a texture as files of assets hold it: colours as sRGB, numbers and normals as they are.
fn write_texture(path: &Path, image: &Image, quantity: Quantity) -> Result<()> {
    if !quantity.is_data() {
        return Ok(photofit_image::write_png(path, image)?);
    }
    let bytes: Vec<u8> = image.data.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    let png = encode_png(image.width, image.height, 3, &bytes, PngCompression::Fast)
        .map_err(|e| e.at(path.display().to_string()))?;
    Ok(write_atomically(path, &png)?)
}

fn figures(
    a: &RecoverScene,
    r: &RecoveredScene,
    views: usize,
    list: Vec<Value>,
    errors: [Option<f64>; 2],
    seconds: f64,
) -> Value {
    let told: Vec<&HistoryPoint> = r.history.iter().filter(|h| h.training_loss().is_some()).collect();
    let loss = |h: Option<&&HistoryPoint>| h.map(|h| h.loss);
    // The steps of this run, which took these seconds.
    let own = r.steps.saturating_sub(r.resumed);
    json!({
        "input": a.scene.input.display().to_string(),
        "parameters": list,
        "views": views,
        "held_out": r.held_out,
        "steps": r.steps,
        "stopped": r.stopped,
        "seconds": seconds,
        "seconds_per_iteration": (own > 0).then(|| seconds / own as f64),
        "loss": { "first": loss(told.first()), "last": loss(told.last()) },
        "relative_error": { "first": errors[0], "best": errors[1] },
        "course": course(&r.history),
    })
}
