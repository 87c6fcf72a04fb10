//! `photofit gradient`: derivatives of a path-traced picture with respect to one parameter of its scene.

use crate::args::Gradient;
use crate::output::{self, print};
use crate::parameter_scene::{Cameras, FAINT, Key, Quantity, Subject, explained, tensor};
use crate::preflight::Places;
use crate::status::{Ending, Misuse};
use crate::threads;
use anyhow::{Result, anyhow, bail};
use photofit_fit::engine::not_finite_told;
use photofit_image::Image;
use photofit_pathtrace::{Adjoint, GradientSamples, Parameter, PathtraceError, RenderOptions, World};
use serde_json::{Value, json};
use std::time::Instant;

/// Share of a path's light that may be left over when it was replayed.
const RESIDUAL: f64 = 1e-6;
/// Events after which roulette may end paths whose light hardly counts, where their derivatives do.
const ALL_GO_ON: u32 = 16;

pub(crate) fn run(a: &Gradient) -> Result<Ending> {
    let places = Places::default()
        .reads("SCENE", Some(&a.scene.input))
        .reads("--weights", a.weights.as_deref())
        .reads("--env", a.scene.env.as_deref())
        .writes("--json", a.json.as_deref())
        .writes("--image", a.image.as_deref());
    places.check()?;
    threads::set(a.threads)?;
    let cameras = if a.list { Cameras::Others } else { Cameras::Own };
    let subject = Subject::load(&a.scene, cameras, &places)?;
    let Some(name) = &a.parameter else {
        return list(&subject.keys).map(|()| Ending::Done);
    };
    if a.scene.camera.len() > 1 {
        bail!(Misuse(format!("--camera: is given {} times; it must be given once", a.scene.camera.len())));
    }
    let key = subject.find(&a.scene, name)?.clone();
    let [slices, rows, columns, channels] = key.shape;
    if a.image.is_some() && (slices > 1 || rows * columns == 1) {
        let is = if slices > 1 { "a grid in space (--json has its values)" } else { "a single value" };
        bail!(Misuse(format!("--image: {name} is {is}; it must be a texture")));
    }
    let (loss, unit) = weights(a, &subject.options)?;
    let named = |e: &dyn std::fmt::Display| anyhow!("{}: {e}", a.scene.input.display());
    let mut world = World::with_options(subject.parts, subject.world).map_err(|e| named(&e))?;
    let lifted = lift(&mut world, &key, &subject.keys).map_err(|e| named(&e))?;
    let mut options = subject.options;
    if lifted > 0 && key.quantity == Quantity::Color {
        // Paths that hardly bring light bring the derivative.
        let all = options.path.max_depth.saturating_add(1).min(ALL_GO_ON);
        options.path.roulette_depth = options.path.roulette_depth.max(all);
    }
    let parameters = std::slice::from_ref(&key.parameter);
    let adjoint = Adjoint::new(&world, &subject.views[0], options.clone(), parameters)
        .map_err(|e| explained(&a.scene, &e))?;
    let began = Instant::now();
    let samples = GradientSamples { spp: a.spp, seed: Some(a.scene.seed) };
    let (gradient, error) = adjoint.render_vjp_with_error(&loss, samples).map_err(|e| named(&e))?;
    let seconds = began.elapsed().as_secs_f64();
    let exact = gradient.residual < RESIDUAL;
    if !exact {
        bail!(
            "{}: the replay left {:e} of the light of a path; it must be below {RESIDUAL:e}: radiances of the scene may be \
             too large for single precision",
            a.scene.input.display(),
            gradient.residual
        );
    }
    let values = [&gradient, &error]
        .map(|g| g.parameters[0].first_channels(channels).iter().map(|v| v * unit).collect::<Vec<f64>>());
    if let Some(file) = &a.image {
        let [value, error] = [&values[0], &values[1]].map(|v| picture(&key, v));
        let channels: &[&str] = &["R", "G", "B"];
        let layers = [("", &value, channels), ("standard_error", &error, channels)];
        photofit_image::write_exr_channels(file, &layers, &[("photofit/parameter", name.as_str())])?;
    }
    if let Some(file) = &a.json {
        let mut figures = to_json(a, &options, &key, &values);
        figures["lifted"] = json!(lifted);
        figures["roulette_depth"] = json!(options.path.roulette_depth);
        figures["spp"] = json!(samples.estimates().into_iter().product::<u32>());
        figures["residual"] = json!(gradient.residual);
        figures["not_finite"] = json!(gradient.not_finite);
        figures["seconds"] = json!(seconds);
        output::write_json(file, &figures)?;
    }
    print(&text(&key, &values))?;
    if gradient.not_finite > 0 {
        crate::progress::say(&not_finite_told(gradient.not_finite));
    }
    if lifted > 0 {
        let of = key.shape.iter().product::<usize>();
        let at = match key.quantity {
            Quantity::Color => format!("{FAINT}"),
            _ => "brighter ones, of which pictures are linear,".into(),
        };
        crate::progress::say(&format!(
            "{name}: {lifted} of {of} numbers are 0, where paths do not find their light; their derivatives are taken at {at} instead"
        ));
    }
    if values[0].iter().all(|v| *v == 0.0) {
        crate::progress::say(&format!(
            "warning: {name}: no path depends on it; it may be out of sight, the weights may be 0, or --max-depth may be too small"
        ));
    }
    Ok(Ending::Done)
}

/// Moves values of 0 to where paths find the light that comes by them; gives how many numbers of the key. A black channel of a
/// reflectance ends what it would scatter, and lights that are black in all channels are not sampled, so that most of their derivative
/// would be left out. Pictures are linear in what lights emit: they become about as bright as others.
fn lift(world: &mut World, key: &Key, keys: &[Key]) -> Result<usize, PathtraceError> {
    let radiates = |k: &Key| k.quantity == Quantity::Radiance;
    if !radiates(key) && key.quantity != Quantity::Color {
        return Ok(0);
    }
    let mut values = world.parameter(&key.parameter)?;
    let channels = key.shape[3];
    let held = values.len() / (key.shape.iter().product::<usize>() / channels).max(1);
    let is_lifted = |cell: &[f32]| !radiates(key) || cell.iter().all(|v| *v == 0.0);
    let zeros = |cell: &[f32]| cell[..channels].iter().filter(|v| **v == 0.0).count();
    let cells = values.chunks_exact(held.max(1)).filter(|cell| is_lifted(cell));
    let lifted = cells.map(zeros).sum();
    if lifted == 0 {
        return Ok(0);
    }
    let to = if radiates(key) {
        let others =
            || keys.iter().filter(|k| radiates(k)).filter_map(|k| world.parameter(&k.parameter).ok());
        mean(&values).or_else(|| others().filter_map(|v| mean(&v)).reduce(f32::max)).unwrap_or(1.0)
    } else {
        FAINT
    };
    for cell in values.chunks_exact_mut(held.max(1)) {
        if is_lifted(cell) {
            cell.iter_mut().filter(|v| **v == 0.0).for_each(|v| *v = to);
        }
    }
    world.set_parameter(&key.parameter, &values)?;
    Ok(lifted)
}

/// Mean of the values above 0; `None` without any.
fn mean(values: &[f32]) -> Option<f32> {
    let (sum, count) =
        values.iter().filter(|v| **v > 0.0).fold((0.0, 0), |(s, n), v| (s + f64::from(*v), n + 1));
    (count > 0).then(|| (sum / f64::from(count)) as f32)
}

fn list(keys: &[Key]) -> Result<()> {
    let width = keys.iter().map(|k| k.name.len()).max().unwrap_or(0);
    let line = |k: &Key| {
        let single = k.shape[0] * k.shape[1] * k.shape[2] == 1;
        let size = if single { k.shape[3].to_string() } else { size(&k.shape) };
        format!("{:<width$}  {size}{}\n", k.name, k.zero())
    };
    print(&keys.iter().map(line).collect::<String>())
}

/// A shape for people: slices only where there are several.
fn size(shape: &[usize; 4]) -> String {
    tensor(shape).iter().map(usize::to_string).collect::<Vec<_>>().join(" x ")
}

/// The weights of the pixels, in a unit in which they are about 1: far from it, products with radiance leave single
/// precision.
fn weights(a: &Gradient, options: &RenderOptions) -> Result<(Image, f64)> {
    let (w, h) = (options.width, options.height);
    let Some(file) = &a.weights else { return Ok((Image::from_fn(w, h, 3, |_, _, _| 1.0), 1.0)) };
    let image = photofit_image::read(file)?;
    let name = file.display();
    if (image.width, image.height) != (w, h) {
        bail!("{name}: is {} x {} pixels; it must be {w} x {h}, as the picture", image.width, image.height);
    }
    if let Some((x, y, value)) = image.find(|v| !v.is_finite()) {
        bail!("{name}: pixel ({x}, {y}) is {value}; it must be finite");
    }
    // One channel weighs all three alike.
    let channel = |c: usize| if image.channels >= 3 { c } else { 0 };
    let most = image.data.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    // A power of two, which rounds nothing.
    let unit = if most > 0.0 { f64::from(most).log2().floor().exp2() } else { 1.0 };
    let weight = |x, y, c| (f64::from(image.pixel(x, y)[channel(c)]) / unit) as f32;
    Ok((Image::from_fn(w, h, 3, weight), unit))
}

/// Values as an image of three channels, as numbers of single precision.
fn picture(key: &Key, values: &[f64]) -> Image {
    let [_, h, w, channels] = key.shape;
    Image::from_fn(w, h, 3, |x, y, c| values[(y * w + x) * channels + c.min(channels - 1)] as f32)
}

fn text(key: &Key, [values, errors]: &[Vec<f64>; 2]) -> String {
    let [slices, h, w, channels] = key.shape;
    if slices * h * w == 1 {
        let each = values.iter().zip(errors).map(|(v, e)| format!("{v:.6e} +- {e:.1e}"));
        return format!("{}  {}\n", key.name, each.collect::<Vec<_>>().join("  "));
    }
    let sum = |c: usize| values.iter().skip(c).step_by(channels).sum::<f64>();
    let sums: Vec<String> = (0..channels).map(|c| format!("{:.6e}", sum(c))).collect();
    let what = if matches!(key.parameter, Parameter::Medium { .. }) { "voxels" } else { "texels" };
    format!("{}  {}, sum over all {what} {}\n", key.name, size(&key.shape), sums.join("  "))
}

fn to_json(a: &Gradient, options: &RenderOptions, key: &Key, [values, errors]: &[Vec<f64>; 2]) -> Value {
    json!({
        "input": a.scene.input.display().to_string(),
        "parameter": key.name,
        "weights": a.weights.as_ref().map(|w| w.display().to_string()),
        "shape": tensor(&key.shape),
        "gradient": values,
        "standard_error": errors,
        "width": options.width,
        "height": options.height,
        "max_depth": options.path.max_depth,
        "seed": a.scene.seed,
    })
}
