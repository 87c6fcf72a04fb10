//! Textures that fit a file into a budget of bytes, with the least loss.

use super::plain::reduced;
use super::{Normalised, SimplifyOptions};
use crate::engine::judge::{self, Stage};
use crate::engine::reference::Reference;
use crate::engine::views::Orbit;
use crate::{FitError, Progress};
use photofit_scene::{Scene, TextureEncoding, to_glb_with};
use std::path::Path;

/// Qualities of JPEG that are tried where exact textures are too large, best first.
const QUALITIES: [u8; 4] = [95, 90, 80, 65];
/// Smallest side of a texture that is halved again.
const SMALLEST: usize = 32;

/// The asset with the textures that look best among those with which the file has at most `most` bytes: of each size, by
/// halves, the most exact encoding that fits. Where none fits, the smallest file, with a warning.
///
/// # Errors
/// If a file cannot be encoded, or none can be written beside `output`.
pub(super) fn within(
    light: Scene,
    most: u64,
    (n, reference): (&Normalised, &dyn Reference),
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Scene, FitError> {
    let bytes = |scene: &Scene| Ok::<u64, FitError>(to_glb_with(scene, options.compression)?.len() as u64);
    let mut fitting: Vec<Scene> = Vec::new();
    let (mut scene, mut smallest) = (light, None::<(u64, Scene)>);
    loop {
        let jpeg = QUALITIES.map(|quality| TextureEncoding::Jpeg { quality });
        let mut exact = false;
        for encoding in [options.texture_encoding].into_iter().chain(jpeg) {
            scene.images.iter_mut().for_each(|i| i.encoding = encoding);
            let size = bytes(&scene)?;
            if size <= most {
                exact = encoding == options.texture_encoding;
                fitting.push(scene.clone());
                break;
            }
            if smallest.as_ref().is_none_or(|s| size < s.0) {
                smallest = Some((size, scene.clone()));
            }
        }
        let large = scene.images.iter().any(|i| i.width.max(i.height) > SMALLEST);
        // Fewer texels than those of a fitting exact file look no better.
        if exact || !large || progress.is_cancelled() && !fitting.is_empty() {
            break;
        }
        for k in 0..scene.images.len() {
            if scene.images[k].width.max(scene.images[k].height) > SMALLEST {
                scene.images[k] = reduced(&scene, k, 1);
            }
        }
    }
    if let (true, Some((size, smallest))) = (fitting.is_empty(), smallest) {
        progress.warn(&format!(
            "no file of {most} bytes can be made: the smallest has {size}; fewer triangles or compressed geometry make it smaller"
        ));
        return Ok(smallest);
    }
    if fitting.len() > 1 {
        let stages = fitting.iter().map(|s| Ok(Stage::new("", as_written(s, output, options)?)));
        let stages: Vec<Stage> = stages.collect::<Result<_, FitError>>()?;
        let views = Orbit::new(options.seed, &options.lighting, options.resolution);
        let (count, [_, samples]) = (options.choice_views(), options.judge_samples());
        let scores = judge::scores(n, reference, &stages, &views, count, samples, progress)?;
        let best = (0..scores.len()).fold(0, |b, k| if scores[k] > scores[b] { k } else { b });
        return Ok(fitting.swap_remove(best));
    }
    Ok(fitting.swap_remove(0))
}

/// A scene as it is read again: what is lost by encoding counts.
fn as_written(scene: &Scene, output: &Path, options: &SimplifyOptions) -> Result<Scene, FitError> {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    // Not `output` itself, which appears when it is complete.
    let trial = output.with_file_name(format!(".{name}.trial-{}.glb", std::process::id()));
    photofit_scene::save_glb_with(&trial, scene, options.compression)?;
    let read = photofit_scene::load(&trial);
    // Nothing more can be done about a file that refuses to go.
    let _ = std::fs::remove_file(&trial);
    Ok(read?)
}

/// How the textures of an asset are stored, for people.
pub(super) fn told(scene: &Scene) -> String {
    let one = |i: &photofit_scene::TextureImage| {
        let how = match i.encoding {
            TextureEncoding::Png => "PNG".into(),
            TextureEncoding::WebP => "WebP".into(),
            TextureEncoding::Jpeg { quality } => format!("JPEG of quality {quality}"),
        };
        format!("{} x {} as {how}", i.width, i.height)
    };
    let mut all: Vec<String> = scene.images.iter().map(one).collect();
    all.dedup();
    if all.is_empty() { "none".into() } else { all.join(", ") }
}
