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
use photofit_scene::MapKind;
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
    if key.dark {
        let file = a.scene.input.display();
        bail!(
            "{file}: {name} is 0, where it has no derivative; it must be more than 0 (recover scene lifts it)"
        );
    }
    let [slices, rows, columns, channels] = key.shape;
    if a.image.is_some() && (slices > 1 || rows * columns == 1) {
        let is = if slices > 1 { "a grid in space (--json has its values)" } else { "a single value" };
        bail!(Misuse(format!("--image: {name} is {is}; it must be a texture")));
    }
    let (loss, unit) = weights(a, &subject.options)?;
    let named = |e: &dyn std::fmt::Display| anyhow!("{}: {e}", a.scene.input.display());
    let mut world = World::with_options(subject.parts, subject.world).map_err(|e| named(&e))?;
    let lifted = lift(&mut world, &key).map_err(|e| named(&e))?;
    let mut options = subject.options;
    if let Some((_, Lift::Faint)) = lifted {
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
        figures["lifted"] = json!(lifted.map_or(0, |l| l.0));
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
    if let Some((zeros, lift)) = lifted {
        let of = key.shape.iter().product::<usize>();
        let at = match lift {
            Lift::Faint => format!("{FAINT}"),
            Lift::Linear => "other values, of which pictures are linear,".into(),
        };
        crate::progress::say(&format!(
            "{name}: {zeros} of {of} numbers are 0, where paths do not find their light; their derivatives are taken at {at} instead"
        ));
    }
    if values[0].iter().all(|v| *v == 0.0) {
        let reason = beyond(&world, &key).unwrap_or_else(|| {
            "no path depends on it; it may be out of sight, the weights may be 0, or --max-depth may be too small"
                .into()
        });
        crate::progress::say(&format!("warning: {name}: {reason}"));
    }
    Ok(Ending::Done)
}

/// Why pictures do not depend on a parameter of one channel whose values are all beyond those that count.
fn beyond(world: &World, key: &Key) -> Option<String> {
    let values = world.parameter(&key.parameter).ok().filter(|_| key.shape[3] == 1)?;
    let held = per_cell(&values, key);
    let [[low, high], ..] = world.effective_range(&key.parameter);
    let all = |is: &dyn Fn(f32) -> bool| values.iter().step_by(held).all(|v| is(*v));
    let (side, bound) = if all(&|v| v < low) {
        ("below", low)
    } else if all(&|v| v > high) {
        ("above", high)
    } else {
        return None;
    };
    Some(format!("all values are {side} {bound:.3}, beyond which pictures do not depend on them"))
}

/// Numbers that a world holds for each cell of a key, which may be more than its channels.
fn per_cell(values: &[f32], key: &Key) -> usize {
    let [slices, rows, columns, _] = key.shape;
    (values.len() / (slices * rows * columns).max(1)).max(1)
}

/// What values of 0 become, so that paths find the light that comes by them.
#[derive(Clone, Copy)]
enum Lift {
    /// [`FAINT`]: channels of reflectances.
    Faint,
    /// The mean of the others, of which pictures are linear: what lights emit.
    Linear,
}

/// Moves values of 0 to where paths find the light that comes by them; tells how many numbers of the key there are. A black channel of
/// a reflectance ends what it would scatter, and what emits in no channel is not sampled, so that most of their derivative would be
/// left out.
fn lift(world: &mut World, key: &Key) -> Result<Option<(usize, Lift)>, PathtraceError> {
    let lift = match key.quantity {
        Quantity::Color => Lift::Faint,
        // An image may be colour and emission in one.
        Quantity::Radiance if is_color(world, &key.parameter) => Lift::Faint,
        Quantity::Radiance => Lift::Linear,
        _ => return Ok(None),
    };
    let mut values = world.parameter(&key.parameter)?;
    let channels = key.shape[3];
    let held = per_cell(&values, key);
    let to = match lift {
        Lift::Faint => FAINT,
        Lift::Linear => mean(&values),
    };
    let mut zeros = 0;
    for cell in values.chunks_exact_mut(held) {
        if matches!(lift, Lift::Faint) || cell.iter().all(|v| *v == 0.0) {
            zeros += cell[..channels].iter().filter(|v| **v == 0.0).count();
            cell.iter_mut().filter(|v| **v == 0.0).for_each(|v| *v = to);
        }
    }
    if zeros == 0 {
        return Ok(None);
    }
    world.set_parameter(&key.parameter, &values)?;
    Ok(Some((zeros, lift)))
}

/// Whether a texture of an asset is the base colour of a material.
fn is_color(world: &World, parameter: &Parameter) -> bool {
    let (Parameter::Texels { texture }, Some(library)) = (parameter, world.library()) else { return false };
    library.readers(*texture, MapKind::BaseColor).next().is_some()
}

/// Mean of the values above 0; 1 without any.
fn mean(values: &[f32]) -> f32 {
    let lit = values.iter().filter(|v| **v > 0.0);
    let (sum, count) = lit.fold((0.0, 0_u32), |(s, n), v| (s + f64::from(*v), n + 1));
    if count > 0 { (sum / f64::from(count)) as f32 } else { 1.0 }
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
