//! The files that images could be, each in several sizes and encodings: their bytes, and what they lose.

use super::Made;
use super::allocation::{self, Variant};
use crate::simplify::SimplifyOptions;
use crate::simplify::plain::reduced;
use crate::{FitError, Progress};
use photofit_scene::{Scene, TextureEncoding, TextureImage};
use rayon::prelude::*;

/// Qualities of lossy encodings that are tried where exact textures are too large, best first.
const QUALITIES: [u8; 5] = [95, 90, 80, 65, 50];
/// Smallest side of a texture that is halved again.
const SMALLEST: usize = 32;
/// Halvings of an image whose loss in pictures is measured; that of more is extrapolated.
const HALVINGS: usize = 4;
/// Least loss that a halving is thought to have, and one that was not measured, decibels: few views do not see all.
const LEAST_LOSS: [f64; 2] = [0.01, 0.2];

/// An image in one size: its file in each encoding.
pub(super) struct Size {
    /// How many times the whole image is halved.
    halvings: usize,
    files: Vec<File>,
}

/// A file of an image.
pub(super) struct File {
    /// The image without texels: those of all files together may be more than fits in memory.
    image: TextureImage,
    bytes: u64,
    /// Mean squared difference from the texels that were encoded, of values in [0, 1].
    error: f64,
}

/// Which file of each image is taken: its size and its encoding.
pub(super) type Choice = Vec<[usize; 2]>;
/// One image replaced by one of its files.
pub(super) type Trial = Option<(usize, [usize; 2])>;

/// An asset and the files that its images could be.
pub(super) struct Files {
    /// The asset with its images in the first of their sizes.
    pub(super) light: Scene,
    pub(super) images: Vec<Vec<Size>>,
    /// Encodings that all sizes have; after them the first may have the file that was read.
    pub(super) encodings: usize,
}

/// The images of a scene without texels, with the files that they have where no budget binds them.
pub(super) fn as_asked(scene: &Scene) -> Result<Vec<TextureImage>, FitError> {
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
    pub(super) fn new(
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
        Ok(Self { light, images, encodings: encodings.len() })
    }

    /// The asset `bare` with these files.
    pub(super) fn with(&self, bare: &Scene, choice: &Choice) -> Result<Scene, FitError> {
        let images = choice.iter().zip(&self.images).map(|(file, sizes)| image(sizes, *file));
        Ok(Scene { images: images.collect::<Result<_, _>>()?, ..bare.clone() })
    }

    /// Bytes of some files.
    pub(super) fn bytes(&self, choice: &Choice) -> u64 {
        choice.iter().zip(&self.images).map(|([s, w], sizes)| sizes[*s].files[*w].bytes).sum()
    }

    /// The smallest file of every image.
    pub(super) fn smallest(&self) -> Choice {
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
    pub(super) fn alike(&self, room: u64) -> Vec<Choice> {
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
    pub(super) fn trials(&self) -> Vec<Trial> {
        let mut out = vec![None];
        for (k, sizes) in self.images.iter().enumerate() {
            let halved = (1..sizes.len().min(HALVINGS + 1)).map(|size| [size, 0]);
            out.extend([[0, coarsest(&sizes[0])]].into_iter().chain(halved).map(|file| Some((k, file))));
        }
        out
    }

    pub(super) fn trial(&self, trial: &Trial) -> Result<Scene, FitError> {
        let mut scene = self.light.clone();
        if let Some((k, file)) = *trial {
            scene.images[k] = image(&self.images[k], file)?;
        }
        Ok(scene)
    }

    /// What the files of each image cost and lose, by the scores of [`Self::trials`].
    pub(super) fn variants(&self, scores: &[f64]) -> Vec<Vec<Variant>> {
        let mut losses = scores[1..].iter().map(|s| (scores[0] - s).max(0.0));
        let one = |sizes: &Vec<Size>| {
            let own: Vec<f64> = losses.by_ref().take(sizes.len().min(HALVINGS + 1)).collect();
            variants(sizes, own[0], &own[1..])
        };
        self.images.iter().map(one).collect()
    }

    /// Each image in the size and encoding that together lose least within `room` bytes.
    pub(super) fn apart(&self, variants: &[Vec<Variant>], room: u64) -> Option<Choice> {
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
    pub(super) fn refined(&self, (choice, mut best): (&Choice, Made), most: u64) -> Result<Made, FitError> {
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
            let made = Made::new(scene, best.compression)?;
            if made.bytes() <= most {
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
