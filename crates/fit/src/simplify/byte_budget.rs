//! Textures that fit a file into a budget of bytes, with the least loss.
//!
//! Of every image the files of several sizes and encodings are made, from the largest size on of which one fits. What one of them
//! costs in pictures is estimated from few: rendered with that image halved up to [`HALVINGS`] times or coarsely encoded, the others as
//! they are. The sizes and encodings of least loss within the budget ([`allocation`]) then meet those that treat all images alike, in
//! held-out views; what looks best gets the quality that the bytes leave, by bisection. Assets that are made to fit meet with the
//! textures that their files would have ([`Budget::best`]).

mod allocation;
#[cfg(test)]
mod tests;
mod triangles;

pub(super) use triangles::{bytes_without_textures, others, triangles_within};

use super::plain::reduced;
use super::{Asset, SimplifyOptions};
use crate::engine::judge::{self, Stage};
use crate::engine::reference::Reference;
use crate::{FitError, Progress};
use allocation::Variant;
use photofit_scene::{Compression, Scene, TextureEncoding, TextureImage, to_glb_with};
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
    /// How many times the whole image is halved.
    halvings: usize,
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

/// Which file of each image is taken: its size and its encoding.
type Choice = Vec<[usize; 2]>;
/// One image replaced by one of its files.
type Trial = Option<(usize, [usize; 2])>;

/// An asset and the files that its images could be.
struct Files {
    /// The asset with its images in the first of their sizes.
    light: Scene,
    images: Vec<Vec<Size>>,
    compression: Compression,
    /// Encodings that all sizes have; after them the first may have the file that was read.
    encodings: usize,
}

/// An asset on one or several numbers of triangles, with the same materials and images.
#[derive(Clone)]
pub(super) struct Shapes {
    images: Vec<TextureImage>,
    /// The asset without images.
    bare: Vec<Scene>,
}

impl Shapes {
    pub(super) fn new(mut light: Scene) -> Self {
        Self { images: std::mem::take(&mut light.images), bare: vec![light] }
    }

    /// Adds the asset on another number of triangles, unless that shows other materials.
    pub(super) fn add(&mut self, mut light: Scene) {
        let images = std::mem::take(&mut light.images);
        if light.materials == self.bare[0].materials && images == self.images {
            self.bare.push(light);
        }
    }

    /// One of them.
    pub(super) fn scene(&self, k: usize) -> Scene {
        Scene { images: self.images.clone(), ..self.bare[k].clone() }
    }
}

/// An asset and the bytes of its file.
pub(super) struct Made {
    pub(super) scene: Scene,
    bytes: u64,
}

impl Made {
    /// # Errors
    /// If the file cannot be written.
    fn new(scene: Scene, compression: Compression) -> Result<Self, FitError> {
        Ok(Self { bytes: to_glb_with(&scene, compression)?.len() as u64, scene })
    }
}

/// A budget of bytes, and what stands for looks within it.
#[derive(Clone, Copy)]
pub(super) struct Budget<'a> {
    pub(super) most: u64,
    pub(super) asset: Asset<'a>,
    pub(super) reference: &'a dyn Reference,
    pub(super) options: &'a SimplifyOptions,
    pub(super) progress: &'a dyn Progress,
}

impl Budget<'_> {
    /// Index of the file that looks best in held-out views, drawn as the report draws them, of those within the budget; of the
    /// smallest where none is.
    ///
    /// # Errors
    /// If a picture cannot be made.
    ///
    /// # Panics
    /// If there is none.
    pub(super) fn best(&self, made: &[Made]) -> Result<usize, FitError> {
        let fit: Vec<usize> = (0..made.len()).filter(|k| made[*k].bytes <= self.most).collect();
        match fit[..] {
            [] => {
                let smallest = (0..made.len()).min_by_key(|k| made[*k].bytes);
                return Ok(smallest.expect("something to choose from"));
            }
            [one] => return Ok(one),
            // Who stopped the work does not wait for a comparison.
            [first, ..] if self.progress.is_cancelled() => return Ok(first),
            _ => {}
        }
        let Self { asset: Asset { scene, n, .. }, reference, options, progress, .. } = *self;
        let stages: Vec<Stage> = fit.iter().map(|k| Stage::new("", made[*k].scene.clone())).collect();
        let views = (options.choice_views(), options.smallest_picture());
        let judge = options.judge_of(scene, n, reference);
        let ranking = judge.ranking(&stages, views, options.choice_samples(), progress)?;
        Ok(fit[ranking.best()])
    }

    /// The file that was chosen; where it is too large the `whole` source as it is, if that fits. Also whether it is the source. Warns
    /// where neither fits.
    ///
    /// # Errors
    /// If a file cannot be encoded.
    pub(super) fn or_whole(&self, made: Made, whole: Option<&Scene>) -> Result<(Scene, bool), FitError> {
        if made.bytes <= self.most {
            return Ok((made.scene, false));
        }
        // Decimation splits vertices where attributes differ, so that all triangles may take more bytes than the source did.
        if let Some(whole) = whole {
            let whole = Made::new(whole.clone(), self.options.compression)?;
            if whole.bytes <= self.most {
                return Ok((whole.scene, true));
            }
        }
        let Made { scene, bytes } = made;
        let why = if scene.images.is_empty() {
            "the asset has no textures to reduce".to_owned()
        } else {
            format!("the smallest has {bytes}; fewer triangles or compressed geometry make it smaller")
        };
        self.progress.warn(&format!("no file of {} bytes can be made: {why}", self.most));
        Ok((scene, false))
    }

    /// Each of `shapes` with the textures that look best among those with which the file fits; where none does, the
    /// smallest file.
    ///
    /// # Errors
    /// If a file cannot be encoded or a picture not be made.
    pub(super) fn within(&self, shapes: &Shapes) -> Result<Vec<Made>, FitError> {
        let Self { most, asset, options, progress, .. } = *self;
        // Locked vertices move before bytes are counted: bounds of positions are text in the file.
        let bare: Vec<Scene> =
            shapes.bare.iter().map(|s| super::dressed(s.clone(), asset, options)).collect();
        let light = super::dressed(shapes.scene(0), asset, options);
        let asked = as_asked(&light)?;
        let mut out: Vec<Option<Made>> = Vec::new();
        for shape in &bare {
            let images = asked.iter().map(|i| i.clone().read_again()).collect::<Result<_, _>>()?;
            let made = Made::new(Scene { images, ..shape.clone() }, options.compression)?;
            out.push((made.bytes <= most || asked.is_empty()).then_some(made));
        }
        if out.iter().any(Option::is_none) {
            let large = bare.iter().zip(&out).filter(|(_, made)| made.is_none());
            let bytes = large.map(|(s, _)| Ok(triangles::geometry(s, options.compression)?[1] as u64));
            let least = bytes.collect::<Result<Vec<u64>, FitError>>()?.into_iter().min().unwrap_or(0);
            let files = Files::new(light, &asked, most.saturating_sub(least), options, progress)?;
            let variants = self.variants(&files)?;
            for (made, shape) in out.iter_mut().zip(&bare).filter(|(made, _)| made.is_none()) {
                *made = Some(self.fitted(&files, variants.as_deref(), shape)?);
            }
        }
        Ok(out.into_iter().flatten().collect())
    }

    /// What the files of each image cost and lose, where images are few and there is time to measure it.
    fn variants(&self, files: &Files) -> Result<Option<Vec<Vec<Variant>>>, FitError> {
        if !(2..=IMAGES_MAX).contains(&files.images.len()) || self.progress.is_cancelled() {
            return Ok(None);
        }
        let trials = files.trials();
        Ok(Some(files.variants(&self.rasterized(files, trials.len(), &|i| files.trial(&trials[i]))?)))
    }

    /// A shape with the textures that look best among those with which the file fits.
    fn fitted(
        &self,
        files: &Files,
        variants: Option<&[Vec<Variant>]>,
        bare: &Scene,
    ) -> Result<Made, FitError> {
        let made = |choice: &Choice| Made::new(files.with(bare, choice)?, files.compression);
        let smallest = files.smallest();
        let least = made(&smallest)?;
        let others = least.bytes.saturating_sub(files.bytes(&smallest)) + (AROUND * smallest.len()) as u64;
        let room = self.most.saturating_sub(others);
        let mut choices = files.alike(room);
        choices.extend(variants.and_then(|variants| files.apart(variants, room)));
        let fitting = choices.iter().map(|choice| Ok((choice, made(choice)?)));
        let mut fitting = fitting.collect::<Result<Vec<(&Choice, Made)>, FitError>>()?;
        fitting.retain(|(_, made)| made.bytes <= self.most);
        let best = match fitting.len() {
            0 => return Ok(least),
            1 => 0,
            _ if self.progress.is_cancelled() => 0,
            count => judge::highest(&self.rasterized(files, count, &|i| Ok(fitting[i].1.scene.clone()))?),
        };
        files.refined(fitting.swap_remove(best), self.most)
    }

    /// How good `count` assets look in held-out views, by the rasterizer, which draws what textures of cores lose: they differ in
    /// nothing else.
    fn rasterized(
        &self,
        files: &Files,
        count: usize,
        scene: &dyn Fn(usize) -> Result<Scene, FitError>,
    ) -> Result<Vec<f64>, FitError> {
        let Self { asset, reference, options, progress, .. } = *self;
        let views = options.orbit(options.resolution);
        let texels: usize = files.light.images.iter().map(|i| i.texels.len()).sum();
        let at_once = (TEXELS_AT_ONCE / texels.max(1)).max(1);
        let mut scores = Vec::new();
        for first in (0..count).step_by(at_once) {
            let some = (first..count.min(first + at_once)).map(|i| Ok(Stage::new("", scene(i)?)));
            let stages = some.collect::<Result<Vec<Stage>, FitError>>()?;
            scores.extend(judge::scores(
                &asset.n.light_asset,
                reference,
                &stages,
                &views,
                options.choice_views(),
                options.choice_samples(),
                progress,
            )?);
        }
        Ok(scores)
    }
}

/// The images of a scene without texels, with the files that they have where no budget binds them.
fn as_asked(scene: &Scene) -> Result<Vec<TextureImage>, FitError> {
    let stored = (0..scene.images.len()).into_par_iter().map(|k| -> Result<TextureImage, FitError> {
        let image = &scene.images[k];
        let stored =
            if image.encoded.is_some() { image.clone() } else { scene.stored_as(k, image.encoding)? };
        Ok(TextureImage { texels: Vec::new(), texels16: Vec::new(), mips: Vec::new(), ..stored })
    });
    stored.collect()
}

/// The encoding that loses most: JPEG does not where it cannot hold alpha.
fn coarsest(size: &Size) -> usize {
    let errors = || size.files.iter().map(|f| f.error).enumerate();
    errors().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(k, _)| k)
}

/// An image as it is read from one of its files.
fn image(sizes: &[Size], [size, file]: [usize; 2]) -> Result<TextureImage, FitError> {
    Ok(sizes[size].files[file].image.clone().read_again()?)
}

impl Files {
    /// The files of the images of `light` from the largest size on of which one has at most `room` bytes; `asked` are those of the
    /// whole images.
    fn new(
        mut light: Scene,
        asked: &[TextureImage],
        room: u64,
        options: &SimplifyOptions,
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        let encodings = encodings(options.texture_encoding);
        let count = light.images.len();
        let mut images = Vec::new();
        for (k, asked) in asked.iter().enumerate() {
            progress.report("encode", k as u64, count as u64, "");
            let mut sizes = sizes(&mut light, k, &encodings, room)?;
            if let (true, Some(read)) = (sizes[0].halvings == 0, light.images[k].encoded.take()) {
                let bytes = read.len().next_multiple_of(4) as u64;
                let image = TextureImage { encoding: TextureEncoding::Png, ..asked.clone() };
                sizes[0].files.push(File { image, bytes, error: 0.0 });
            }
            images.push(sizes);
        }
        Ok(Self { light, images, compression: options.compression, encodings: encodings.len() })
    }

    /// The asset `bare` with these files.
    fn with(&self, bare: &Scene, choice: &Choice) -> Result<Scene, FitError> {
        let images = choice.iter().zip(&self.images).map(|(file, sizes)| image(sizes, *file));
        Ok(Scene { images: images.collect::<Result<_, _>>()?, ..bare.clone() })
    }

    /// Bytes of some files.
    fn bytes(&self, choice: &Choice) -> u64 {
        choice.iter().zip(&self.images).map(|([s, w], sizes)| sizes[*s].files[*w].bytes).sum()
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

    /// All images alike: of each size, by halves, the encoding that loses least of those that have at most `room` bytes.
    fn alike(&self, room: u64) -> Vec<Choice> {
        let mut out: Vec<Choice> = Vec::new();
        let last = self.images.iter().flatten().map(|s| s.halvings).max().unwrap_or(0);
        for halvings in 0..=last {
            let choice = |file: usize| -> Choice {
                let at = |sizes: &Vec<Size>| halvings.saturating_sub(sizes[0].halvings).min(sizes.len() - 1);
                self.images.iter().map(|sizes| [at(sizes), file]).collect()
            };
            let error = |file: usize| {
                let each = choice(file).into_iter().zip(&self.images);
                each.map(|([s, w], sizes)| sizes[s].files[w].error).sum::<f64>()
            };
            let mut files: Vec<usize> = (0..self.encodings).collect();
            files.sort_by(|a, b| error(*a).total_cmp(&error(*b)));
            out.extend(files.into_iter().map(choice).find(|choice| self.bytes(choice) <= room));
        }
        out.dedup();
        out
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
    fn variants(&self, scores: &[f64]) -> Vec<Vec<Variant>> {
        let mut losses = scores[1..].iter().map(|s| (scores[0] - s).max(0.0));
        let one = |sizes: &Vec<Size>| {
            let own: Vec<f64> = losses.by_ref().take(sizes.len().min(HALVINGS + 1)).collect();
            variants(sizes, own[0], &own[1..])
        };
        self.images.iter().map(one).collect()
    }

    /// Each image in the size and encoding that together lose least within `room` bytes.
    fn apart(&self, variants: &[Vec<Variant>], room: u64) -> Option<Choice> {
        let choice = allocation::least_loss(variants, room)?;
        let file = |(variant, sizes): (&usize, &Vec<Size>)| {
            let mut files =
                sizes.iter().enumerate().flat_map(|(s, size)| (0..size.files.len()).map(move |w| [s, w]));
            files.nth(*variant).expect("a variant for each file")
        };
        Some(choice.iter().zip(&self.images).map(file).collect())
    }

    /// A file that fits with its lossy images of better quality, all by as much, as far as the bytes go: seven encodings of each at
    /// most.
    fn refined(&self, (choice, mut best): (&Choice, Made), most: u64) -> Result<Made, FitError> {
        let lossy = best.scene.images.iter().enumerate().filter_map(|(k, i)| Some((k, quality(i.encoding)?)));
        let lossy: Vec<(usize, u8)> = lossy.collect();
        let mut exact = best.scene.clone();
        for (k, [size, _]) in choice.iter().enumerate() {
            exact.images[k] = match size {
                0 => self.light.images[k].clone(),
                size => reduced(&self.light, k, *size),
            };
        }
        let (mut low, mut high) = (0, 100 - lossy.iter().map(|(_, q)| *q).min().unwrap_or(100));
        while low < high {
            let more = low + (high - low).div_ceil(2);
            let better = lossy.par_iter().map(|(k, q)| {
                let encoding = with_quality(best.scene.images[*k].encoding, (q + more).min(100));
                Ok((*k, exact.stored_as(*k, encoding)?))
            });
            let mut scene = best.scene.clone();
            for (k, image) in better.collect::<Result<Vec<_>, FitError>>()? {
                scene.images[k] = image;
            }
            let made = Made::new(scene, self.compression)?;
            if made.bytes <= most {
                (best, low) = (made, more);
            } else {
                high = more - 1;
            }
        }
        Ok(best)
    }
}

/// Quality of a lossy encoding.
fn quality(encoding: TextureEncoding) -> Option<u8> {
    match encoding {
        TextureEncoding::Jpeg { quality }
        | TextureEncoding::LossyWebP { quality }
        | TextureEncoding::Ktx2 { quality } => Some(quality),
        TextureEncoding::Png | TextureEncoding::WebP => None,
    }
}

/// The same encoding with another quality.
fn with_quality(encoding: TextureEncoding, quality: u8) -> TextureEncoding {
    match encoding {
        TextureEncoding::Jpeg { .. } => TextureEncoding::Jpeg { quality },
        TextureEncoding::LossyWebP { .. } => TextureEncoding::LossyWebP { quality },
        TextureEncoding::Ktx2 { .. } => TextureEncoding::Ktx2 { quality },
        TextureEncoding::Png | TextureEncoding::WebP => encoding,
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

/// Image `k` of a scene, by halves, in each encoding: from the largest size on of which a file has at most `room` bytes, in which the
/// scene is left with it; only the exact encoding and the coarsest ones tell of sizes before it.
fn sizes(
    scene: &mut Scene,
    k: usize,
    encodings: &[TextureEncoding],
    room: u64,
) -> Result<Vec<Size>, FitError> {
    let made = |scene: &Scene, which: &[TextureEncoding]| {
        which.par_iter().map(|e| File::new(scene, k, *e)).collect::<Result<Vec<File>, FitError>>()
    };
    let is_last = |scene: &Scene| scene.images[k].width.max(scene.images[k].height) <= SMALLEST;
    let lowest = encodings.iter().filter_map(|e| quality(*e)).min();
    let telling: Vec<TextureEncoding> =
        encodings.iter().copied().filter(|e| quality(*e).is_none_or(|q| Some(q) == lowest)).collect();
    let mut halvings = 0;
    let read_fits = |i: &TextureImage| i.encoded.as_ref().is_some_and(|b| b.len() as u64 <= room);
    while !is_last(scene)
        && !read_fits(&scene.images[k])
        && made(scene, &telling)?.iter().all(|f| f.bytes > room)
    {
        scene.images[k] = reduced(scene, k, 1);
        halvings += 1;
    }
    let (mut own, mut out) = (scene.clone(), Vec::new());
    loop {
        out.push(Size { halvings, files: made(&own, encodings)? });
        if is_last(&own) {
            return Ok(out);
        }
        own.images[k] = reduced(&own, k, 1);
        halvings += 1;
    }
}

impl File {
    /// Image `k` of a scene in an encoding.
    fn new(scene: &Scene, k: usize, encoding: TextureEncoding) -> Result<Self, FitError> {
        let (image, stored) = (&scene.images[k], scene.stored_as(k, encoding)?);
        let squares = image.texels.iter().flatten().zip(stored.texels.iter().flatten());
        let squares = squares.map(|(a, b)| (f64::from(a.abs_diff(*b)) / 255.0).powi(2));
        let mut error = squares.sum::<f64>() / (4 * image.texels.len()) as f64;
        if stored.texels16.len() != image.texels16.len() {
            // What rounding to 8 bits costs.
            error += 1.0 / (12.0 * 255.0 * 255.0);
        }
        let bytes = stored.encoded.as_ref().map_or(0, |b| b.len().next_multiple_of(4) as u64);
        Ok(Self {
            image: TextureImage { texels: Vec::new(), texels16: Vec::new(), mips: Vec::new(), ..stored },
            bytes,
            error,
        })
    }
}

/// What the files of an image cost and lose, size by size: decibels of pictures, of which `coarse` were measured for the
/// whole image in the coarsest encoding and `halved` for its halves.
fn variants(sizes: &[Size], coarse: f64, halved: &[f64]) -> Vec<Variant> {
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
        out.extend(size.files.iter().map(|f| Variant { bytes: f.bytes, loss: loss + weight * f.error }));
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
