//! Textures that fit a file into a budget of bytes, with the least loss.
//!
//! Of every image the files of several sizes and encodings are made. What one of them costs in pictures is estimated from
//! few: rendered with that image halved up to [`HALVINGS`] times or coarsely encoded, the others as they are. The sizes and encodings
//! of least loss within the budget ([`allocation`]) then meet those that treat all images alike, in held-out views.

mod allocation;
#[cfg(test)]
mod tests;

use super::options::FEWEST;
use super::plain::reduced;
use super::{Normalised, SimplifyOptions};
use crate::engine::judge::{self, Stage};
use crate::engine::reference::Reference;
use crate::{FitError, Progress};
use allocation::Way;
use photofit_scene::{Compression, Material, Scene, TextureEncoding, TextureImage, to_glb_with};
use rayon::prelude::*;

/// Qualities of lossy encodings that are tried where exact textures are too large, best first.
const QUALITIES: [u8; 5] = [95, 90, 80, 65, 50];
/// Smallest side of a texture that is halved again.
const SMALLEST: usize = 32;
/// Texels of the assets that are judged at once, 4 bytes each and a third for mips.
const TEXELS_AT_ONCE: usize = 1 << 27;
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

/// A file of an image.
struct File {
    /// The image without texels: those of all files together may be more than fits in memory.
    image: TextureImage,
    bytes: u64,
    /// Mean squared difference from the texels that were encoded, of values in [0, 1].
    error: f64,
}

/// Which file of each image is taken: its size by halvings, and its encoding.
type Choice = Vec<[usize; 2]>;
/// One image replaced by one of its files.
type Trial = Option<(usize, [usize; 2])>;

/// An asset and the files that its images could be.
struct Files {
    light: Scene,
    /// The asset without images.
    bare: Scene,
    images: Vec<Vec<Size>>,
    compression: Compression,
    encodings: usize,
}

/// An asset and the bytes of its file.
struct Made {
    scene: Scene,
    bytes: u64,
}

impl Made {
    /// # Errors
    /// If the file cannot be written.
    fn new(scene: Scene, compression: Compression) -> Result<Self, FitError> {
        Ok(Self { bytes: to_glb_with(&scene, compression)?.len() as u64, scene })
    }

    /// Tells that the file has more than `most` bytes, if it has.
    fn warn(&self, most: u64, progress: &dyn Progress) {
        let Self { scene, bytes } = self;
        if *bytes <= most {
            return;
        }
        let why = if scene.images.is_empty() {
            "the asset has no textures to reduce".to_owned()
        } else {
            format!("the smallest has {bytes}; fewer triangles or compressed geometry make it smaller")
        };
        progress.warn(&format!("no file of {most} bytes can be made: {why}"));
    }
}

/// The file of at most `most` bytes of an asset; where there is none, that of the asset with its `own` textures, and of the
/// `whole` source as it is. Also whether it is one of these. Warns if none fits, and gives the smallest.
///
/// # Errors
/// If a file cannot be encoded.
pub(super) fn best_within(
    light: Scene,
    (own, whole): (Option<Scene>, Option<&Scene>),
    most: u64,
    judged_by: (&Normalised, &dyn Reference),
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(Scene, bool), FitError> {
    let mut made = within(light, most, judged_by, options, progress)?;
    let mut is_other = false;
    // What looked best may take more bytes than the asset's own textures.
    if let Some(own) = own.filter(|_| made.bytes > most) {
        let own = within(own, most, judged_by, options, progress)?;
        if own.bytes < made.bytes {
            (made, is_other) = (own, true);
        }
    }
    // Decimation splits vertices where attributes differ, so that all triangles may take more bytes than the source did.
    if let Some(whole) = whole.filter(|_| made.bytes > most) {
        let whole = Made::new(whole.clone(), options.compression)?;
        if whole.bytes <= most {
            (made, is_other) = (whole, true);
        }
    }
    made.warn(most, progress);
    Ok((made.scene, is_other))
}

/// The asset with the textures that look best among those with which the file has at most `most` bytes. Where none fits, the
/// smallest file.
///
/// # Errors
/// If a file cannot be encoded.
fn within(
    light: Scene,
    most: u64,
    (n, reference): (&Normalised, &dyn Reference),
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Made, FitError> {
    let made = Made::new(light, options.compression)?;
    if made.bytes <= most || made.scene.images.is_empty() {
        return Ok(made);
    }
    let files = Files::new(made.scene, options, progress)?;
    let views = options.orbit(options.resolution);
    let (count, samples) = (options.choice_views(), options.choice_samples());
    let texels: usize = files.light.images.iter().map(|i| i.texels.len()).sum();
    let at_once = (TEXELS_AT_ONCE / texels.max(1)).max(1);
    let judged =
        |count_of: usize, scene: &dyn Fn(usize) -> Result<Scene, FitError>| -> Result<Vec<f64>, FitError> {
            let mut scores = Vec::new();
            for first in (0..count_of).step_by(at_once) {
                let some = (first..count_of.min(first + at_once)).map(|i| Ok(Stage::new("", scene(i)?)));
                let stages = some.collect::<Result<Vec<Stage>, FitError>>()?;
                scores.extend(judge::scores(
                    &n.light_asset,
                    reference,
                    &stages,
                    &views,
                    count,
                    samples,
                    progress,
                )?);
            }
            Ok(scores)
        };
    let mut fitting = files.alike(most)?;
    if (2..=IMAGES_MAX).contains(&files.images.len()) && !progress.is_cancelled() {
        let trials = files.trials();
        let ways = files.ways(&judged(trials.len(), &|i| files.trial(&trials[i]))?);
        fitting.extend(files.apart(&ways, most)?);
    }
    let scene = match fitting.len() {
        0 => files.with(&files.smallest())?,
        1 => fitting.swap_remove(0),
        _ => {
            let best = judge::highest(&judged(fitting.len(), &|i| Ok(fitting[i].clone()))?);
            fitting.swap_remove(best)
        }
    };
    Made::new(scene, options.compression)
}

/// Part of a file's bytes that geometry may take where the budget of triangles follows from bytes: a convention, which no
/// measurement chose.
const GEOMETRY: f64 = 0.5;

/// The triangles of an asset that a file of `most` bytes holds: all where the asset as it is fits, and otherwise as many as
/// take [`GEOMETRY`] of it. Bytes are taken to follow the number of triangles, each instance with its own.
///
/// # Errors
/// If the geometry cannot be written.
pub(super) fn triangles_within(
    scene: &Scene,
    most: u64,
    compression: Compression,
) -> Result<usize, FitError> {
    let all = scene.triangle_count().max(1);
    let mut bare = scene.clone();
    bare.materials.iter_mut().for_each(|m| *m = Material::default());
    bare.images.clear();
    let shared: usize = scene.primitives.iter().map(|p| p.mesh.triangles.len()).sum();
    let stored = to_glb_with(&bare, compression)?.len() as f64;
    let geometry = stored * (all as f64 / shared.max(1) as f64).max(1.0);
    let textures = to_glb_with(scene, compression)?.len() as f64 - stored;
    if geometry + textures <= most as f64 {
        return Ok(all);
    }
    Ok(((all as f64 * GEOMETRY * most as f64 / geometry) as usize).clamp(FEWEST.min(all), all))
}

/// The encoding that loses most: JPEG does not where it cannot hold alpha.
fn coarsest(size: &Size) -> usize {
    let errors = || size.files.iter().map(|f| f.error).enumerate();
    errors().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(k, _)| k)
}

/// An image as it is read from one of its files.
fn image(sizes: &[Size], [size, way]: [usize; 2]) -> Result<TextureImage, FitError> {
    Ok(sizes[size].files[way].image.clone().read_again()?)
}

impl Files {
    fn new(light: Scene, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Self, FitError> {
        let encodings = encodings(options.texture_encoding);
        let count = light.images.len();
        let sizes = |k: usize| {
            progress.report("encode", k as u64, count as u64, "");
            sizes(&light, k, &encodings)
        };
        let images = (0..count).map(sizes).collect::<Result<_, FitError>>()?;
        let mut bare = light.clone();
        bare.images.clear();
        Ok(Self { light, bare, images, compression: options.compression, encodings: encodings.len() })
    }

    /// The asset with these files.
    fn with(&self, choice: &Choice) -> Result<Scene, FitError> {
        let images = choice.iter().zip(&self.images).map(|(file, sizes)| image(sizes, *file));
        Ok(Scene { images: images.collect::<Result<_, _>>()?, ..self.bare.clone() })
    }

    /// Bytes of the whole file.
    fn bytes(&self, scene: &Scene) -> Result<u64, FitError> {
        Ok(to_glb_with(scene, self.compression)?.len() as u64)
    }

    /// The smallest file of every image.
    fn smallest(&self) -> Choice {
        let all = self.images.iter().map(|sizes| {
            let each = sizes
                .iter()
                .enumerate()
                .flat_map(|(s, size)| size.files.iter().enumerate().map(move |(w, f)| (f.bytes, [s, w])));
            each.min_by_key(|(bytes, _)| *bytes).map_or([0; 2], |(_, choice)| choice)
        });
        all.collect()
    }

    /// All images alike: of each size, by halves, the encoding that loses least of those that fit.
    fn alike(&self, most: u64) -> Result<Vec<Scene>, FitError> {
        let mut out = Vec::new();
        for size in 0..self.images.iter().map(Vec::len).max().unwrap_or(0) {
            let choice = |way: usize| -> Choice {
                self.images.iter().map(|sizes| [size.min(sizes.len() - 1), way]).collect()
            };
            let error = |way: usize| {
                let each = choice(way).into_iter().zip(&self.images);
                each.map(|([s, w], sizes)| sizes[s].files[w].error).sum::<f64>()
            };
            let mut ways: Vec<usize> = (0..self.encodings).collect();
            ways.sort_by(|a, b| error(*a).total_cmp(&error(*b)));
            for way in ways {
                let scene = self.with(&choice(way))?;
                if self.bytes(&scene)? <= most {
                    out.push(scene);
                    break;
                }
            }
        }
        Ok(out)
    }

    /// The asset as it is; then for each image, the others as they are, in its coarsest encoding and in smaller sizes.
    fn trials(&self) -> Vec<Trial> {
        let mut out = vec![None];
        for (k, sizes) in self.images.iter().enumerate() {
            let halved = (1..sizes.len().min(HALVINGS + 1)).map(|size| [size, 0]);
            out.extend([[0, coarsest(&sizes[0])]].into_iter().chain(halved).map(|file| Some((k, file))));
        }
        out
    }

    fn trial(&self, trial: &Trial) -> Result<Scene, FitError> {
        let mut scene = self.light.clone();
        if let Some((k, file)) = *trial {
            scene.images[k] = image(&self.images[k], file)?;
        }
        Ok(scene)
    }

    /// What the files of each image cost and lose, by the scores of [`Self::trials`].
    fn ways(&self, scores: &[f64]) -> Vec<Vec<Way>> {
        let mut losses = scores[1..].iter().map(|s| (scores[0] - s).max(0.0));
        let one = |sizes: &Vec<Size>| {
            let own: Vec<f64> = losses.by_ref().take(sizes.len().min(HALVINGS + 1)).collect();
            ways(sizes, own[0], &own[1..])
        };
        self.images.iter().map(one).collect()
    }

    /// Each image in the size and encoding that together lose least; none if that does not fit.
    fn apart(&self, ways: &[Vec<Way>], most: u64) -> Result<Option<Scene>, FitError> {
        let least = self.smallest();
        let own: u64 = least.iter().zip(&self.images).map(|([s, w], sizes)| sizes[*s].files[*w].bytes).sum();
        let rest = self.bytes(&self.with(&least)?)?.saturating_sub(own) + (AROUND * ways.len()) as u64;
        let Some(choice) = allocation::least_loss(ways, most.saturating_sub(rest)) else { return Ok(None) };
        let choice = choice.iter().map(|i| [i / self.encodings, i % self.encodings]).collect();
        let scene = self.with(&choice)?;
        Ok((self.bytes(&scene)? <= most).then_some(scene))
    }
}

/// What is tried for textures of one kind, best first of each format: where all readers are to read them, no WebP.
fn encodings(wanted: TextureEncoding) -> Vec<TextureEncoding> {
    let jpeg = QUALITIES.map(|quality| TextureEncoding::Jpeg { quality });
    let webp = QUALITIES.map(|quality| TextureEncoding::LossyWebP { quality });
    let ktx2 = |quality| TextureEncoding::Ktx2 { quality };
    match wanted {
        TextureEncoding::Png => [wanted].into_iter().chain(jpeg).collect(),
        TextureEncoding::Jpeg { .. } => jpeg.into(),
        // JPEG keeps chroma whole, which pays where there is room.
        TextureEncoding::WebP => [wanted].into_iter().chain(webp).chain(jpeg).collect(),
        TextureEncoding::LossyWebP { .. } => webp.into(),
        TextureEncoding::Ktx2 { .. } => [100].into_iter().chain(QUALITIES).map(ktx2).collect(),
    }
}

/// Image `k` of a scene, whole and by halves, in each encoding.
fn sizes(scene: &Scene, k: usize, encodings: &[TextureEncoding]) -> Result<Vec<Size>, FitError> {
    let (mut own, mut out) = (scene.clone(), Vec::new());
    loop {
        let files = encodings.par_iter().map(|e| File::new(&own, k, *e));
        out.push(Size { files: files.collect::<Result<_, FitError>>()? });
        let image = &own.images[k];
        if image.width.max(image.height) <= SMALLEST {
            return Ok(out);
        }
        own.images[k] = reduced(&own, k, 1);
    }
}

impl File {
    /// Image `k` of a scene in an encoding.
    fn new(scene: &Scene, k: usize, encoding: TextureEncoding) -> Result<Self, FitError> {
        let (image, stored) = (&scene.images[k], scene.stored_as(k, encoding)?);
        let squares = image.texels.iter().flatten().zip(stored.texels.iter().flatten());
        let squares = squares.map(|(a, b)| (f64::from(a.abs_diff(*b)) / 255.0).powi(2));
        let error = squares.sum::<f64>() / (4 * image.texels.len()) as f64;
        let bytes = stored.encoded.as_ref().map_or(0, |b| b.len().next_multiple_of(4) as u64);
        Ok(Self { image: TextureImage { texels: Vec::new(), mips: Vec::new(), ..stored }, bytes, error })
    }
}

/// What the files of an image cost and lose, size by size: decibels of pictures, of which `coarse` were measured for the
/// whole image in the coarsest encoding and `halved` for its halves.
fn ways(sizes: &[Size], coarse: f64, halved: &[f64]) -> Vec<Way> {
    // A texel's difference counts for as much in small images as in the whole one, and for something where no picture shows it.
    let error = sizes[0].files[coarsest(&sizes[0])].error.max(1e-12);
    let weight = coarse.max(LEAST_LOSS[1]) / error;
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
            // What was loaded says so, whatever it came from.
            TextureEncoding::Png => match i.encoded.as_deref() {
                Some([0xff, 0xd8, ..]) => "JPEG, as in the asset".into(),
                Some([b'R', b'I', b'F', b'F', ..]) => "WebP, as in the asset".into(),
                Some([0xab, b'K', b'T', b'X', ..]) => "KTX 2.0, as in the asset".into(),
                _ => "PNG".into(),
            },
            TextureEncoding::WebP => "WebP".into(),
            TextureEncoding::Jpeg { quality } => format!("JPEG of quality {quality}"),
            TextureEncoding::LossyWebP { quality } => format!("lossy WebP of quality {quality}"),
            TextureEncoding::Ktx2 { quality } => format!("KTX 2.0 of quality {quality}"),
        };
        format!("{} x {} as {how}", i.width, i.height)
    };
    let mut all: Vec<String> = scene.images.iter().map(one).collect();
    all.dedup();
    if all.is_empty() { "none".into() } else { all.join(", ") }
}
