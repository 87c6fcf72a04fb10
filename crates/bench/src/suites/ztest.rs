//! Agreement with published pictures of other renderers: a z-test per pixel and channel.
//!
//! `PHOTOFIT_SCENES` names a folder. In it, `mitsuba/tests/scenes/*/*.xml` are scenes of the Mitsuba 3 tests with mean
//! and variance in `refs`, and `ignis/evaluation/mitsuba/*.xml` scenes with a mean of 4096 samples alone. Pictures of
//! both renders and of their difference land in `out/bench/ztest`.

use anyhow::{Context as _, Result, anyhow};
use photofit_image::{Image, contact_sheet, heatmap, write_png};
use photofit_pathtrace::{Parts, RenderOptions, Renderer, View, World, WorldOptions};
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};
use photofit_shading::bsdf::Energy;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::context::Context;
use crate::timing::Timing;

/// Samples of a picture, over all pixels.
const SAMPLES: usize = 2_000_000;
/// Smallest variance that is believed.
const VARIANCE_MIN: f64 = 1e-4;
/// Significance over a picture.
const SIGNIFICANCE: f64 = 0.01;
/// Share of pixel values that must not be rejected.
const ACCEPTED: f64 = 0.9975;
/// Samples of the references without a variance image, and of ours.
const IGNIS_REFERENCE: f64 = 4096.0;
const IGNIS_SPP: u32 = 256;

/// A scene with its reference.
struct Case {
    name: String,
    scene: PathBuf,
    mean: PathBuf,
    /// Variance of single samples, as an image; without it the noise is estimated from the pictures.
    variance: Option<PathBuf>,
}

/// What came of it.
struct Outcome {
    spp: u32,
    smallest_p: f64,
    accepted: f64,
    /// Mean of the difference over the mean of the reference.
    bias: f64,
    seconds: f64,
    ours: Image,
    reference: Image,
}

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let Ok(folder) = std::env::var("PHOTOFIT_SCENES") else {
        ctx.note("PHOTOFIT_SCENES does not name a folder of scenes: nothing was tested.");
        return Ok(());
    };
    let mut cases = mitsuba(Path::new(&folder))?;
    cases.extend(ignis(Path::new(&folder))?);
    if let Ok(only) = std::env::var("PHOTOFIT_ONLY") {
        cases.retain(|c| c.name.contains(&only));
    }
    let (mut passed, total) = (0, cases.len());
    for case in cases {
        match test(&case) {
            Ok(outcome) => {
                let passes = outcome.accepted >= ACCEPTED;
                passed += usize::from(passes);
                pictures(&case.name, &outcome)?;
                let timing = Timing { median: outcome.seconds, spread: 0.0, runs: 1 };
                let figures = vec![
                    ("rejected", 1.0 - outcome.accepted),
                    ("smallest p", outcome.smallest_p),
                    ("bias", outcome.bias),
                    ("passes", f64::from(u8::from(passes))),
                ];
                ctx.record("path", &case.name, outcome.spp as usize, timing, figures);
                println!(
                    "    {} rejected {:.4}% smallest p {:.1e} bias {:+.2e}",
                    if passes { "PASS" } else { "FAIL" },
                    100.0 * (1.0 - outcome.accepted),
                    outcome.smallest_p,
                    outcome.bias
                );
            }
            Err(e) => {
                println!("{:24} not rendered: {e:#}", case.name);
                ctx.note(format!("{}: not rendered: {e:#}", case.name));
            }
        }
    }
    ctx.note(format!(
        "{passed} of {total} pictures pass: at least 99.75% of the pixel values are not rejected at significance \
         0.01 per picture (Sidak). The size is samples per pixel."
    ));
    Ok(())
}

/// Files with an ending in the folders below, sorted.
fn files(folder: &Path, depth: usize) -> Vec<PathBuf> {
    let mut out: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    out.sort();
    if depth == 0 {
        out.retain(|p| p.extension().is_some_and(|e| e == "xml"));
        return out;
    }
    out.iter().filter(|p| p.is_dir()).flat_map(|p| files(p, depth - 1)).collect()
}

fn mitsuba(folder: &Path) -> Result<Vec<Case>> {
    let mut out = Vec::new();
    for scene in files(&folder.join("mitsuba/tests/scenes"), 1) {
        let stem = stem(&scene)?;
        let Some((name, _)) = stem.rsplit_once('_') else { continue };
        let at = |ending: &str| scene.with_file_name("refs").join(format!("{name}{ending}"));
        let (mean, variance) = (at("_ref_rgb.exr"), at("_ref_rgb_var.exr"));
        if mean.is_file() && variance.is_file() {
            let name = name.trim_start_matches("test_").to_owned();
            let name = if name == "scene" { "infinite_mirrors".into() } else { name };
            out.push(Case { name, scene, mean, variance: Some(variance) });
        }
    }
    Ok(out)
}

fn ignis(folder: &Path) -> Result<Vec<Case>> {
    let mut out = Vec::new();
    for scene in files(&folder.join("ignis/evaluation/mitsuba"), 0) {
        let name = stem(&scene)?;
        let references = folder.join("ignis/evaluation/references");
        let mut found = ["", "-d6"].map(|d| references.join(format!("ref-{name}{d}-4096.exr"))).into_iter();
        if let Some(mean) = found.find(|p| p.is_file()) {
            out.push(Case { name: format!("ignis {name}"), scene, mean, variance: None });
        }
    }
    Ok(out)
}

fn stem(path: &Path) -> Result<String> {
    let stem = path.file_stem().with_context(|| path.display().to_string())?;
    Ok(stem.to_string_lossy().into_owned())
}

fn test(case: &Case) -> Result<Outcome> {
    let options = MitsubaOptions { allow_parent_paths: true, ..MitsubaOptions::default() };
    let scene = load_mitsuba(&case.scene, &options)?;
    let mut options = RenderOptions::from_mitsuba(&scene);
    let pixels = options.width * options.height;
    options.spp = if case.variance.is_some() { (SAMPLES / pixels) as u32 } else { IGNIS_SPP };
    let spp = options.spp;
    let view = View::from_mitsuba(&scene.sensor);
    let parts = Parts::from_mitsuba(scene);
    let world =
        World::with_options(parts, WorldOptions { energy: Energy::Single, ..WorldOptions::default() })?;
    let mut renderer = Renderer::new(&world, &view, options)?;
    let began = Instant::now();
    renderer.finish();
    let seconds = began.elapsed().as_secs_f64();
    let ours = renderer.picture();
    let reference = photofit_image::read(&case.mean)?;
    if (reference.width, reference.height) != (ours.width, ours.height) {
        return Err(anyhow!("the reference has {} x {} pixels", reference.width, reference.height));
    }
    let variance = match &case.variance {
        Some(file) => photofit_image::read(file)?,
        None => noise(&ours, &reference),
    };
    let (mut smallest_p, mut accepted) = (1.0_f64, 0_usize);
    let alpha = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / pixels as f64);
    let (mut sum, mut level) = (0.0, 0.0);
    for i in 0..pixels {
        let pixel = |image: &Image| {
            let from = i * image.channels;
            [0, 1, 2].map(|c| f64::from(image.data[from + c]))
        };
        let (a, b) = (xyz(pixel(&ours)), xyz(pixel(&reference)));
        let v = match case.variance {
            Some(_) => xyz(pixel(&variance)),
            None => pixel(&variance),
        };
        for k in 0..3 {
            let v = v[k].max(VARIANCE_MIN);
            let error = match case.variance {
                Some(_) => v / f64::from(spp),
                // The reference is stored with eleven bits.
                None => v * (1.0 / f64::from(spp) + 1.0 / IGNIS_REFERENCE) + (b[k] / 2048.0).powi(2) / 3.0,
            };
            let z = (a[k] - b[k]).abs() / error.sqrt();
            let p = 2.0 * upper_tail(z);
            smallest_p = smallest_p.min(p);
            accepted += usize::from(p > alpha);
            sum += a[k] - b[k];
            level += b[k];
        }
    }
    Ok(Outcome {
        spp,
        smallest_p,
        accepted: accepted as f64 / (3 * pixels) as f64,
        bias: sum / level,
        seconds,
        ours,
        reference,
    })
}

/// Variance of single samples of XYZ, for a reference that says nothing about its noise: half the mean square of how the
/// difference of the pictures changes from pixel to pixel around each. A bias that varies slowly does not count.
fn noise(ours: &Image, reference: &Image) -> Image {
    const REACH: usize = 4;
    let (w, h) = (ours.width, ours.height);
    let difference = Image::from_fn(w, h, 3, |x, y, c| {
        let at = |image: &Image| xyz([0, 1, 2].map(|c| f64::from(image.pixel(x, y)[c])))[c];
        (at(ours) - at(reference)) as f32
    });
    // The sum of both pictures' variances over their samples is measured; the test divides by the samples again.
    let samples = 1.0 / (1.0 / f64::from(IGNIS_SPP) + 1.0 / IGNIS_REFERENCE);
    Image::from_fn(w, h, 3, |x, y, c| {
        let (mut sum, mut count) = (0.0_f64, 0.0_f64);
        for v in y.saturating_sub(REACH)..(y + REACH + 1).min(h) {
            for u in x.saturating_sub(REACH)..(x + REACH).min(w - 1) {
                let step = difference.pixel(u + 1, v)[c] - difference.pixel(u, v)[c];
                sum += f64::from(step * step);
                count += 1.0;
            }
        }
        (0.5 * sum / count.max(1.0) * samples) as f32
    })
}

/// Linear Rec.709 to CIE XYZ.
fn xyz([r, g, b]: [f64; 3]) -> [f64; 3] {
    [
        0.412_453 * r + 0.357_580 * g + 0.180_423 * b,
        0.212_671 * r + 0.715_160 * g + 0.072_169 * b,
        0.019_334 * r + 0.119_193 * g + 0.950_227 * b,
    ]
}

/// Probability that a standard normal variable is larger than `z >= 0` (Abramowitz and Stegun 1964, 26.2.17).
fn upper_tail(z: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * z);
    let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let series = 1.330_274_429;
    let series = -1.821_255_978 + t * series;
    let series = 1.781_477_937 + t * series;
    let series = -0.356_563_782 + t * series;
    density * t * (0.319_381_530 + t * series)
}

/// Ours, the reference, and the difference, side by side.
fn pictures(name: &str, outcome: &Outcome) -> Result<()> {
    let folder = Path::new("out/bench/ztest");
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let level: f32 = outcome.reference.data.iter().sum::<f32>() / outcome.reference.data.len() as f32;
    let (w, h) = (outcome.ours.width, outcome.ours.height);
    let exposure = 0.4 / level.max(1e-6);
    let zoom = (256 / w.max(h)).max(1);
    let shown = |image: &Image| {
        Image::from_fn(w * zoom, h * zoom, 3, |x, y, c| {
            (image.pixel(x / zoom, y / zoom)[c] * exposure).clamp(0.0, 1.0)
        })
    };
    let difference = Image::from_fn(w * zoom, h * zoom, 1, |x, y, _| {
        let (a, b) = (outcome.ours.pixel(x / zoom, y / zoom), outcome.reference.pixel(x / zoom, y / zoom));
        let d = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
        (4.0 * d * exposure).min(1.0)
    });
    let all = [shown(&outcome.ours), shown(&outcome.reference), heatmap(&difference, 1.0)];
    let sheet = contact_sheet(&all.each_ref(), 3, 4);
    write_png(folder.join(format!("{}.png", name.replace(' ', "-"))), &sheet)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails() {
        for (z, p) in [(0.0, 0.5), (1.0, 0.158_655), (1.959_964, 0.025), (4.0, 3.167e-5)] {
            assert!((upper_tail(z) - p).abs() < 1e-6, "{z}: {}", upper_tail(z));
        }
    }
}
