//! `photofit denoise`: a clean picture from a noisy rendering and its feature layers.

use crate::aov::{Kind, Layers, Planes};
use crate::args::{Denoise, Device};
use crate::device::{self, Gpu};
use crate::output::{self, print};
use crate::preflight::Places;
use crate::progress::Terminal;
use crate::status::Misuse;
use crate::{sequence, threads};
use anyhow::{Result, anyhow, bail};
use photofit_denoise::DenoiseError;
#[cfg(feature = "gpu")]
use photofit_denoise::mc::denoise_on;
use photofit_denoise::mc::{Denoised, Frame, Guides, Sequence, Settings, Stage, Stages, denoise};
use photofit_fit::Progress;
use photofit_image::{
    DEFAULT_PIXELS_PER_DEGREE, ExrLayer, Image, flip, psnr_from_mse, rmse, ssim, to_display,
    write_exr_planes, write_png,
};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The files of one frame.
#[derive(Clone, Debug)]
pub(crate) struct Files {
    pub(crate) color: PathBuf,
    pub(crate) guides: Vec<(Kind, PathBuf)>,
    pub(crate) half: Option<PathBuf>,
}

/// The planes of one frame.
struct Loaded {
    width: usize,
    height: usize,
    color: Planes,
    half: Option<Planes>,
    guides: Vec<(Kind, Planes)>,
    sources: Vec<(Kind, String)>,
}

impl Loaded {
    fn frame(&self) -> Frame<'_> {
        let get = |kind: Kind| self.guides.iter().find(|(k, _)| *k == kind).map(|(_, v)| v.samples());
        let guides = Guides {
            albedo: get(Kind::Albedo),
            normal: get(Kind::Normal),
            depth: get(Kind::Depth),
            position: get(Kind::Position),
        };
        let mut frame = Frame::new(self.width, self.height, self.color.first_planes(3)).with_guides(guides);
        frame.half = self.half.as_ref().map(|half| half.first_planes(3));
        frame.variance = get(Kind::Variance);
        frame
    }
}

pub(crate) fn run(a: &Denoise) -> Result<()> {
    let places = Places::default()
        .reads("COLOR", Some(&a.input))
        .reads("--albedo", a.albedo.as_deref())
        .reads("--normal", a.normal.as_deref())
        .reads("--depth", a.depth.as_deref())
        .reads("--position", a.position.as_deref())
        .reads("--variance", a.variance.as_deref())
        .reads("--half", a.half.as_deref())
        .reads("--sequence", a.sequence.as_deref())
        .reads("--compare", a.compare.as_deref())
        .writes("--output", Some(&a.output))
        .writes("--json", a.json.as_deref());
    places.check()?;
    threads::set(a.threads)?;
    let model = a.model.model();
    let (gpu, why) = match a.device {
        // No driver is asked for what it is not needed for.
        Device::Auto if !model.has_kernels() => {
            (None, format!("there are no kernels for the model {}", a.model.name()))
        }
        _ => device::gpu(&a.device)?,
    };
    let gpu = gpu.as_ref();
    let files = Files {
        color: a.input.clone(),
        guides: [
            (Kind::Albedo, &a.albedo),
            (Kind::Normal, &a.normal),
            (Kind::Depth, &a.depth),
            (Kind::Position, &a.position),
            (Kind::Variance, &a.variance),
        ]
        .into_iter()
        .filter_map(|(kind, path)| Some((kind, path.clone()?)))
        .collect(),
        half: a.half.clone(),
    };
    let settings = Settings {
        model,
        device_required: matches!(a.device, Device::Gpu | Device::Named(_)),
        restore_mean: !a.keep_darkening,
        fireflies: !a.keep_fireflies,
        without: Stage::ALL.into_iter().filter(|s| a.without.iter().any(|name| name == s.name())).collect(),
        ..Settings::default()
    };
    let reference =
        a.compare.as_ref().map(|path| Ok::<_, anyhow::Error>((path, read_rgb(path)?))).transpose()?;
    // What cannot be compared is said before the work.
    let check = |loaded: &Loaded| match &reference {
        Some((path, image)) => {
            same_size((image.width, image.height), &path.display().to_string(), (loaded.width, loaded.height))
        }
        None => Ok(()),
    };
    let progress = Terminal::new();
    let (last, result, seconds) = match &a.sequence {
        Some(cameras) => over_sequence(a, gpu, &files, cameras, settings, &places, &progress, check)?,
        None => {
            let loaded = load(&files)?;
            check(&loaded)?;
            progress.report("denoise", 0, 1, "");
            let began = Instant::now();
            let result = one(gpu, &loaded.frame(), &settings).map_err(|e| failure(a, &a.input, &e))?;
            (loaded, result, began.elapsed().as_secs_f64())
        }
    };
    progress.finish();
    let mut text = String::new();
    if a.explain {
        text += &result.plan.to_string();
        for (kind, from) in &last.sources {
            let unused = if is_left_out(*kind, settings.without) { ", left out" } else { "" };
            text += &format!("{kind} from {from}{unused}\n");
        }
    }
    let told = told(gpu, &why, &result);
    if gpu.is_some() && !result.plan.runs("device") {
        progress.warn(&told);
    }
    if a.device != Device::Cpu {
        text += &format!("device: {told}\n");
    }
    let mut value = json_of(a, &last, settings.without, &result, seconds);
    value["device"] = json!(told);
    if let Some((_, reference)) = &reference {
        progress.report("compare", 0, 1, "");
        let clean = Image::from_planes(last.width, last.height, &result.color);
        text += &compare(&mut value, reference, &last.color.to_rgb(), &clean);
        progress.finish();
    }
    if result.holes > 0 {
        text += &format!("{} pixels with NaN or infinity were filled\n", output::count(result.holes));
    }
    write(&a.output, result.color, &last.color)?;
    if let Some(file) = &a.json {
        output::write_json(file, &value)?;
    }
    text += &format!(
        "wrote {} ({} x {}, {:.3} s without files)\n",
        a.output.display(),
        last.width,
        last.height,
        seconds
    );
    print(&text)
}

/// Denoises one picture.
fn one(gpu: Option<&Gpu>, frame: &Frame<'_>, settings: &Settings) -> Result<Denoised, DenoiseError> {
    match gpu {
        #[cfg(feature = "gpu")]
        Some(gpu) => denoise_on(gpu, frame, settings),
        #[cfg(not(feature = "gpu"))]
        Some(never) => match *never {},
        None => denoise(frame, settings),
    }
}

/// Denoises the last frame of a sequence.
fn last_of(gpu: Option<&Gpu>, history: &Sequence) -> Option<Result<Denoised, DenoiseError>> {
    match gpu {
        #[cfg(feature = "gpu")]
        Some(gpu) => history.denoise_on(gpu),
        #[cfg(not(feature = "gpu"))]
        Some(never) => match *never {},
        None => history.denoise(),
    }
}

/// Where it ran, and why.
fn told(gpu: Option<&Gpu>, why: &str, result: &Denoised) -> String {
    match result.plan.step("device").filter(|_| gpu.is_some()) {
        Some(step) => step.why.clone(),
        None => format!("CPU: {why}"),
    }
}

/// Why a frame was refused; where a GPU did that was asked for, with what to do.
fn failure(a: &Denoise, file: &Path, e: &DenoiseError) -> anyhow::Error {
    let file = file.display();
    #[cfg(feature = "gpu")]
    if matches!(e, DenoiseError::NotOnDevice { .. } | DenoiseError::Device(_)) {
        let (device, model) = (&a.device, a.model.name());
        return anyhow!(
            "{file}: --model {model} --device {device}: {e}; --device auto runs on the CPU what a GPU cannot do"
        );
    }
    #[cfg(not(feature = "gpu"))]
    let _ = a;
    anyhow!("{file}: {e}")
}

/// Denoises the last of the frames that lead to it.
fn over_sequence(
    a: &Denoise,
    gpu: Option<&Gpu>,
    files: &Files,
    cameras: &Path,
    settings: Settings,
    places: &Places,
    progress: &Terminal,
    check: impl Fn(&Loaded) -> Result<()>,
) -> Result<(Loaded, Denoised, f64)> {
    if files.half.is_some() {
        let cameras = cameras.display();
        bail!(Misuse(format!("{cameras}: --half and --sequence do not go together; give one of them")));
    }
    let frames = sequence::frames(cameras, files)?;
    let guides = |f: &Files| f.guides.iter().map(|g| g.1.clone()).collect::<Vec<_>>();
    for frame in &frames {
        let guides = guides(&frame.files);
        places.check_against("--sequence", guides.iter().chain([&frame.files.color]))?;
    }
    let mut history = Sequence::new(settings);
    let mut last = None;
    let mut seconds = 0.0;
    for (k, frame) in frames.iter().enumerate() {
        let mut loaded = load(&frame.files)?;
        check(&loaded)?;
        progress.report("frames", k as u64, frames.len() as u64, "");
        let width = loaded.width;
        if let Some((_, depth)) =
            loaded.guides.iter_mut().find(|(kind, _)| frame.axial && *kind == Kind::Depth)
        {
            let rule = "world_to_pixel has no inverse";
            let near = |z: &f32| if *z < 1e9 { *z } else { 0.0 };
            let near: Vec<f32> = depth.samples().iter().map(near).collect();
            let distances = frame.camera.distances(&near, width);
            *depth = depth.with(distances.ok_or_else(|| anyhow!("{}: {rule}", cameras.display()))?);
        }
        let began = Instant::now();
        history
            .push(&loaded.frame(), frame.camera)
            .map_err(|e| anyhow!("{}: {e}", frame.files.color.display()))?;
        seconds += began.elapsed().as_secs_f64();
        last = Some(loaded);
    }
    progress.report("denoise", 0, 1, "");
    let began = Instant::now();
    let (Some(loaded), Some(result)) = (last, last_of(gpu, &history)) else {
        bail!("{}: no frame up to {}", cameras.display(), files.color.display());
    };
    let result = result.map_err(|e| failure(a, &files.color, &e))?;
    Ok((loaded, result, seconds + began.elapsed().as_secs_f64()))
}

/// Reads the files of a frame; guides that have no file of their own are looked for beside the colour.
fn load(files: &Files) -> Result<Loaded> {
    let layers = Layers::read_known(&files.color)?;
    let (name, color) = layers.color()?;
    let place = |path: &Path, layer: &str| match layer {
        "" => path.display().to_string(),
        _ => format!("{}, layer {layer}", path.display()),
    };
    let size = (color.width, color.height);
    let mut loaded = Loaded {
        width: color.width,
        height: color.height,
        color,
        half: None,
        guides: Vec::new(),
        sources: vec![(Kind::Color, place(&files.color, &name))],
    };
    if let Some(path) = &files.half {
        let (name, half) = Layers::read_known(path)?.color()?;
        same_size((half.width, half.height), &place(path, &name), size)?;
        let pairs = half.first_planes(3).iter().zip(loaded.color.first_planes(3));
        if pairs.into_iter().all(|(a, b)| a.to_bits() == b.to_bits()) {
            let place = place(path, &name);
            bail!(Misuse(format!(
                "{place}: --half holds the same picture; it must be one with samples of its own"
            )));
        }
        loaded.half = Some(half);
    }
    for kind in Kind::GUIDES {
        let found = match files.guides.iter().find(|(k, _)| *k == kind) {
            Some((_, path)) => {
                let (name, planes) = Layers::read(path)?.guide(kind)?;
                Some((place(path, &name), planes))
            }
            None => layers.find(kind).map(|(name, planes)| (place(&files.color, &name), planes)),
        };
        if let Some((from, planes)) = found {
            same_size((planes.width, planes.height), &from, size)?;
            loaded.guides.push((kind, planes));
            loaded.sources.push((kind, from));
        }
    }
    Ok(loaded)
}

fn same_size((w, h): (usize, usize), from: &str, (width, height): (usize, usize)) -> Result<()> {
    if (w, h) != (width, height) {
        bail!("{from}: {w} x {h}, but the colour is {width} x {height}");
    }
    Ok(())
}

/// Linear RGB of a picture file.
fn read_rgb(path: &Path) -> Result<Image> {
    Ok(Layers::read_known(path)?.color()?.1.to_rgb())
}

/// Writes the picture with the alpha of the noisy one; a PNG is encoded for a display.
fn write(path: &Path, mut planes: Vec<f32>, noisy: &Planes) -> Result<()> {
    let Planes { width, height, .. } = *noisy;
    planes.extend_from_slice(noisy.alpha().unwrap_or_default());
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(write_png(path, &Image::from_planes(width, height, &planes))?);
    }
    let names = &["R", "G", "B", "A"][..planes.len() / (width * height)];
    let channels = names.iter().map(ToString::to_string).collect();
    Ok(write_exr_planes(path, &[ExrLayer { name: String::new(), width, height, channels, planes }])?)
}

/// Whether a layer is read and not used.
fn is_left_out(kind: Kind, without: Stages) -> bool {
    let input = match kind {
        Kind::Color => return false,
        Kind::Albedo => Stage::Albedo,
        Kind::Normal => Stage::Normal,
        Kind::Depth | Kind::Position => Stage::Position,
        Kind::Variance => Stage::Variance,
    };
    without.has(input)
}

fn json_of(a: &Denoise, last: &Loaded, without: Stages, result: &Denoised, seconds: f64) -> Value {
    let steps: Vec<Value> = result
        .plan
        .steps
        .iter()
        .map(|s| json!({ "name": s.name, "runs": s.runs, "why": s.why, "seconds": s.seconds }))
        .collect();
    let of = |left_out: bool| -> serde_json::Map<String, Value> {
        let some = last.sources.iter().filter(|(kind, _)| is_left_out(*kind, without) == left_out);
        some.map(|(kind, from)| (kind.to_string(), json!(from))).collect()
    };
    json!({
        "input": a.input.display().to_string(),
        "output": a.output.display().to_string(),
        "width": last.width,
        "height": last.height,
        "model": a.model.name(),
        "seconds": seconds,
        "holes": result.holes,
        "fireflies": result.fireflies,
        "strength": result.strength,
        "layers": of(false),
        "layers_left_out": of(true),
        "plan": steps,
    })
}

/// Figures of the noisy and the clean picture, as text and into the JSON.
fn compare(value: &mut Value, reference: &Image, noisy: &Image, clean: &Image) -> String {
    let shown = to_display(reference);
    let figures = |image: &Image| {
        let finite = image.map(|v| if v.is_finite() { v } else { 0.0 });
        let display = to_display(&finite);
        let display_rmse = rmse(&shown, &display);
        let psnr = psnr_from_mse(display_rmse * display_rmse);
        let flip = flip(&shown, &display, DEFAULT_PIXELS_PER_DEGREE).mean;
        (psnr, ssim(&shown, &display).mean, flip, display_rmse, rmse(reference, &finite))
    };
    let mut text = format!(
        "{:<10} {:>9} {:>8} {:>8} {:>8} {:>11}\n",
        "", "PSNR dB", "SSIM", "FLIP", "RMSE", "linear RMSE"
    );
    for (name, image) in [("noisy", noisy), ("denoised", clean)] {
        let (psnr, ssim, flip, rmse, linear) = figures(image);
        text += &format!("{name:<10} {psnr:>9.2} {ssim:>8.4} {flip:>8.4} {rmse:>8.4} {linear:>11.4}\n");
        let mut figures = json!({ "ssim": ssim, "flip": flip, "rmse": rmse, "linear_rmse": linear });
        output::write_psnr(&mut figures, psnr, false);
        if name == "noisy" {
            value["noisy"] = figures;
        } else if let (Some(all), Some(own)) = (value.as_object_mut(), figures.as_object()) {
            all.extend(own.clone());
        }
    }
    text
}
