//! Textures that fit a file into a budget of bytes, with the least loss.
//!
//! Of every image the files of several sizes and encodings are made. What one of them costs in pictures is estimated from
//! few: rendered with that image halved up to [`HALVINGS`] times or coarsely encoded, the others as they are. The sizes and encodings
//! of least loss within the budget ([`allocation`]) then meet those that treat all images alike, in held-out views.

mod allocation;

use super::plain::reduced;
use super::{Normalised, SimplifyOptions};
use crate::engine::judge::{self, Stage};
use crate::engine::reference::Reference;
use crate::engine::views::Orbit;
use crate::{FitError, Progress};
use allocation::Way;
use photofit_scene::{Scene, TextureEncoding, TextureImage, to_glb_with};
use rayon::prelude::*;

/// Qualities of lossy encodings that are tried where exact textures are too large, best first.
const QUALITIES: [u8; 5] = [95, 90, 80, 65, 50];
/// Smallest side of a texture that is halved again.
const SMALLEST: usize = 32;
/// Assets of more images treat all alike.
const IMAGES_MAX: usize = 8;
/// Halvings of an image whose loss in pictures is measured; that of more is extrapolated.
const HALVINGS: usize = 4;
/// Least loss that a halving is thought to have, and one that was not measured, decibels: few views do not see all.
const LEAST_LOSS: [f64; 2] = [0.01, 0.2];
/// Bytes of padding and JSON by which one encoding of an image may differ from another beside its own.
const AROUND: usize = 128;

/// An image in one size: its file in each encoding.
struct Size {
    files: Vec<File>,
}

/// An image as it is read again from its file.
struct File {
    image: TextureImage,
    bytes: u64,
    /// Mean squared difference from the texels that were encoded, of values in [0, 1].
    error: f64,
}

/// The asset with the textures that look best among those with which the file has at most `most` bytes. Where none fits, the
/// smallest file, with a warning.
///
/// # Errors
/// If a file cannot be encoded.
pub(super) fn within(
    light: Scene,
    most: u64,
    (n, reference): (&Normalised, &dyn Reference),
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Scene, FitError> {
    let bytes = |scene: &Scene| Ok::<u64, FitError>(to_glb_with(scene, options.compression)?.len() as u64);
    if bytes(&light)? <= most {
        return Ok(light);
    }
    let encodings = encodings(options.texture_encoding);
    let mut images: Vec<Vec<Size>> = Vec::new();
    for k in 0..light.images.len() {
        progress.report("encode", k as u64, light.images.len() as u64, "");
        images.push(sizes(&light, k, &encodings)?);
    }
    let with = |choice: &[[usize; 2]]| {
        let mut scene = light.clone();
        for (k, [size, way]) in choice.iter().enumerate() {
            scene.images[k] = images[k][*size].files[*way].image.clone();
        }
        scene
    };
    let largest = images.iter().map(Vec::len).max().unwrap_or(0);
    let alike = |size: usize, way: usize| -> Vec<[usize; 2]> {
        images.iter().map(|sizes| [size.min(sizes.len() - 1), way]).collect()
    };
    // Of each size, by halves, the most exact encoding that fits.
    let mut fitting: Vec<Scene> = Vec::new();
    let mut smallest = None::<(u64, Scene)>;
    for size in 0..largest {
        for way in 0..encodings.len() {
            let scene = with(&alike(size, way));
            let length = bytes(&scene)?;
            if length <= most {
                fitting.push(scene);
                break;
            }
            if smallest.as_ref().is_none_or(|s| length < s.0) {
                smallest = Some((length, scene));
            }
        }
    }
    let stages = |scenes: &[Scene]| scenes.iter().map(|s| Stage::new("", s.clone())).collect::<Vec<_>>();
    let views = Orbit::new(options.seed, &options.lighting, options.resolution);
    let (count, [_, samples]) = (options.choice_views(), options.judge_samples());
    let judged =
        |scenes: &[Scene]| judge::scores(n, reference, &stages(scenes), &views, count, samples, progress);
    if (2..=IMAGES_MAX).contains(&images.len()) && !progress.is_cancelled() {
        let coarsest = encodings.len() - 1;
        let mut trials = vec![light.clone()];
        for (k, sizes) in images.iter().enumerate() {
            let alone = |size: usize, way: usize| {
                let mut scene = light.clone();
                scene.images[k] = sizes[size].files[way].image.clone();
                scene
            };
            trials.push(alone(0, coarsest));
            trials.extend((1..sizes.len().min(HALVINGS + 1)).map(|size| alone(size, 0)));
        }
        let scores = judged(&trials)?;
        let mut losses = scores[1..].iter().map(|s| (scores[0] - s).max(0.0));
        let ways: Vec<Vec<Way>> = images
            .iter()
            .map(|sizes| {
                let own: Vec<f64> = losses.by_ref().take(sizes.len().min(HALVINGS + 1)).collect();
                ways(sizes, own[0], &own[1..])
            })
            .collect();
        let least = alike(largest - 1, coarsest);
        let files: u64 = least.iter().zip(&images).map(|([s, w], sizes)| sizes[*s].files[*w].bytes).sum();
        let rest = bytes(&with(&least))?.saturating_sub(files) + (AROUND * images.len()) as u64;
        let room = most.saturating_sub(rest);
        if let Some(choice) = allocation::least_loss(&ways, room) {
            let choice: Vec<[usize; 2]> =
                choice.iter().map(|i| [i / encodings.len(), i % encodings.len()]).collect();
            let scene = with(&choice);
            if bytes(&scene)? <= most {
                fitting.push(scene);
            }
        }
    }
    match (fitting.len(), smallest) {
        (0, Some((size, smallest))) => {
            progress.warn(&format!(
                "no file of {most} bytes can be made: the smallest has {size}; fewer triangles or compressed geometry make it \
                 smaller"
            ));
            Ok(smallest)
        }
        (0, None) => {
            progress
                .warn(&format!("no file of {most} bytes can be made: the asset has no textures to reduce"));
            Ok(light)
        }
        (1, _) => Ok(fitting.swap_remove(0)),
        _ => {
            let best = judge::highest(&judged(&fitting)?);
            Ok(fitting.swap_remove(best))
        }
    }
}

/// What is tried for textures of one kind, best first: a format that every reader knows stays one.
fn encodings(wanted: TextureEncoding) -> Vec<TextureEncoding> {
    let jpeg = QUALITIES.map(|quality| TextureEncoding::Jpeg { quality });
    let webp = QUALITIES.map(|quality| TextureEncoding::LossyWebP { quality });
    match wanted {
        TextureEncoding::Png => [wanted].into_iter().chain(jpeg).collect(),
        TextureEncoding::Jpeg { .. } => jpeg.into(),
        TextureEncoding::WebP => [wanted].into_iter().chain(webp).collect(),
        TextureEncoding::LossyWebP { .. } => webp.into(),
    }
}

/// Image `k` of a scene, whole and by halves, in each encoding.
fn sizes(scene: &Scene, k: usize, encodings: &[TextureEncoding]) -> Result<Vec<Size>, FitError> {
    let (mut own, mut out) = (scene.clone(), Vec::new());
    loop {
        let image = &own.images[k];
        let files = encodings.par_iter().map(|e| File::new(image, *e));
        out.push(Size { files: files.collect::<Result<_, FitError>>()? });
        if image.width.max(image.height) <= SMALLEST {
            return Ok(out);
        }
        own.images[k] = reduced(&own, k, 1);
    }
}

impl File {
    fn new(image: &TextureImage, encoding: TextureEncoding) -> Result<Self, FitError> {
        let stored = image.stored_as(encoding)?;
        let squares = image.texels.iter().flatten().zip(stored.texels.iter().flatten());
        let squares = squares.map(|(a, b)| (f64::from(a.abs_diff(*b)) / 255.0).powi(2));
        let error = squares.sum::<f64>() / (4 * image.texels.len()) as f64;
        let bytes = stored.encoded.as_ref().map_or(0, |b| b.len().next_multiple_of(4) as u64);
        Ok(Self { image: stored, bytes, error })
    }
}

/// What the files of an image cost and lose, size by size: decibels of pictures, of which `coarse` were measured for the
/// whole image in the coarsest encoding and `halved` for its halves.
fn ways(sizes: &[Size], coarse: f64, halved: &[f64]) -> Vec<Way> {
    // A texel's difference counts for as much in small images as in the whole one.
    let weight = coarse / sizes[0].files.last().map_or(1.0, |f| f.error.max(1e-12));
    let mut loss = 0.0_f64;
    let mut out = Vec::new();
    for (k, size) in sizes.iter().enumerate() {
        loss = match k.checked_sub(1) {
            None => 0.0,
            Some(k) => match halved.get(k) {
                Some(measured) => measured.max(loss + LEAST_LOSS[0]),
                None => 2.0 * loss + LEAST_LOSS[1],
            },
        };
        out.extend(size.files.iter().map(|f| Way { bytes: f.bytes, loss: loss + weight * f.error }));
    }
    out
}

/// How the textures of an asset are stored, for people.
pub(super) fn told(scene: &Scene) -> String {
    let one = |i: &TextureImage| {
        let how = match i.encoding {
            TextureEncoding::Png => "PNG".into(),
            TextureEncoding::WebP => "WebP".into(),
            TextureEncoding::Jpeg { quality } => format!("JPEG of quality {quality}"),
            TextureEncoding::LossyWebP { quality } => format!("lossy WebP of quality {quality}"),
        };
        format!("{} x {} as {how}", i.width, i.height)
    };
    let mut all: Vec<String> = scene.images.iter().map(one).collect();
    all.dedup();
    if all.is_empty() { "none".into() } else { all.join(", ") }
}
