//! Textures and precisions of geometry that fit a file into a budget of bytes, with the least loss.
//!
//! Of every image the files of several sizes and encodings are made, from the largest size on of which one fits. What one of them
//! costs in pictures is estimated from few ([`files`]): rendered with that image halved or coarsely encoded, the others as they are.
//! The sizes and encodings of least loss within the budget ([`allocation`]) then meet those that treat all images alike, with
//! compressed geometry in each precision, in held-out views; what looks best gets the quality that the bytes leave, by bisection.
//! Assets that are made to fit meet as their files are read ([`Budget::best`]).

mod allocation;
mod files;
mod maps;
#[cfg(test)]
mod tests;
mod triangles;

pub(super) use maps::{compared, counted, planned};
pub(super) use triangles::{bytes_without_textures, fits, others, triangles_within};

use super::{Asset, SimplifyOptions};
use crate::engine::judge::{self, Stage};
use crate::engine::reference::Reference;
use crate::{FitError, Progress};
use allocation::Variant;
use files::{Choice, Files, as_asked};
use photofit_scene::{Compression, Precision, Scene, TextureEncoding, TextureImage, from_glb, to_glb_with};

/// Texels of the assets that are judged at once, 4 bytes each and a third for mips.
const TEXELS_AT_ONCE: usize = 1 << 27;
/// Assets of more images treat all alike.
const IMAGES_MAX: usize = 8;
/// Bytes of padding and JSON by which one encoding of an image may differ from another beside its own.
const AROUND: usize = 128;

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

    /// Adds the asset on another number of triangles, unless that shows other materials or is there.
    pub(super) fn add(&mut self, mut light: Scene) {
        let images = std::mem::take(&mut light.images);
        let new = self.bare.iter().all(|s| s.triangle_count() != light.triangle_count());
        if new && light.materials == self.bare[0].materials && images == self.images {
            self.bare.push(light);
        }
    }

    /// One of them.
    pub(super) fn scene(&self, k: usize) -> Scene {
        Scene { images: self.images.clone(), ..self.bare[k].clone() }
    }
}

/// An asset and its file.
pub(super) struct Made {
    pub(super) scene: Scene,
    pub(super) compression: Compression,
    file: Vec<u8>,
}

impl Made {
    /// # Errors
    /// If the file cannot be written.
    fn new(scene: Scene, compression: Compression) -> Result<Self, FitError> {
        Ok(Self { file: to_glb_with(&scene, compression)?, scene, compression })
    }

    pub(super) fn bytes(&self) -> u64 {
        self.file.len() as u64
    }
}

/// How geometry may be stored where a budget of bytes binds it, finest first: in coarser precisions than was asked for, too, which leave
/// more to triangles and textures.
fn compressions(asked: Compression) -> &'static [Compression] {
    const MESHOPT: [Compression; 3] = [
        Compression::Meshopt(Precision::Fine),
        Compression::Meshopt(Precision::Medium),
        Compression::Meshopt(Precision::Coarse),
    ];
    match asked {
        Compression::None => &[Compression::None],
        Compression::Meshopt(Precision::Fine) => &MESHOPT,
        Compression::Meshopt(Precision::Medium) => &MESHOPT[1..],
        Compression::Meshopt(Precision::Coarse) => &MESHOPT[2..],
    }
}

/// The one of [`compressions`] that takes fewest bytes.
fn coarsest(asked: Compression) -> Compression {
    compressions(asked)[compressions(asked).len() - 1]
}

/// The [`compressions`] by whose bytes triangles are counted: the coarsest where textures share the bytes with them, so that it is open how
/// many triangles get; else each, since nothing else gives way.
pub(super) fn counted_in(asked: Compression, textured: bool) -> &'static [Compression] {
    let all = compressions(asked);
    if textured { &all[all.len() - 1..] } else { all }
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
        let fit: Vec<usize> = (0..made.len()).filter(|k| made[*k].bytes() <= self.most).collect();
        match fit[..] {
            [] => {
                let smallest = (0..made.len()).min_by_key(|k| made[*k].bytes());
                return Ok(smallest.expect("something to choose from"));
            }
            [one] => return Ok(one),
            // Who stopped the work does not wait for a comparison.
            [first, ..] if self.progress.is_cancelled() => return Ok(first),
            _ => {}
        }
        let Self { asset: Asset { scene, n, .. }, reference, options, progress, .. } = *self;
        let stages = fit.iter().map(|k| Ok(Stage::new("", from_glb(&made[*k].file)?)));
        let stages = stages.collect::<Result<Vec<Stage>, FitError>>()?;
        let views = (options.choice_views(), options.smallest_picture());
        let judge = options.judge_of(scene, n, reference);
        let ranking = judge.ranking(&stages, views, options.choice_samples(), progress)?;
        Ok(fit[ranking.best()])
    }

    /// The file that was chosen; where it is too large, or has fewer triangles, the `whole` source as it is, if that fits. Also whether it is
    /// the source. Warns where neither fits.
    ///
    /// # Errors
    /// If a file cannot be encoded.
    pub(super) fn or_whole(&self, made: Made, whole: Option<&Scene>) -> Result<(Made, bool), FitError> {
        let fits = made.bytes() <= self.most;
        // Decimation splits vertices where attributes differ and has no instances, so that all triangles may take more bytes than the
        // source did.
        let fewer = |whole: &&Scene| made.scene.triangle_count() < whole.triangle_count();
        if let Some(whole) = whole.filter(|whole| !fits || fewer(whole)) {
            for compression in compressions(self.options.compression) {
                let file = to_glb_with(whole, *compression)?;
                if file.len() as u64 <= self.most {
                    return Ok((Made { scene: whole.clone(), compression: *compression, file }, true));
                }
            }
        }
        if fits {
            return Ok((made, false));
        }
        let ways = match self.options.compression {
            Compression::None => "fewer triangles or compressed geometry make it smaller",
            Compression::Meshopt(_) => "fewer triangles make it smaller",
        };
        let textures = if made.scene.images.is_empty() { ", without textures" } else { "" };
        let why = format!("the lightest has {}{textures}; {ways}", made.bytes());
        self.progress.warn(&format!("no file of {} bytes was found: {why}", self.most));
        Ok((made, false))
    }

    /// Each of `shapes` with the textures and the precision of its geometry that look best among those with which the file fits; where
    /// none does, the smallest file.
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
            out.push(self.unreduced(Scene { images, ..shape.clone() })?);
        }
        if out.iter().any(Option::is_none) {
            let large = bare.iter().zip(&out).filter(|(_, made)| made.is_none());
            let coarsest = coarsest(options.compression);
            let bytes = large.map(|(s, _)| Ok(triangles::geometry(s, coarsest)?[1] as u64));
            let least = bytes.collect::<Result<Vec<u64>, FitError>>()?.into_iter().min().unwrap_or(0);
            let files = Files::new(light, &asked, most.saturating_sub(least), options, progress)?;
            let variants = self.variants(&files)?;
            for (made, shape) in out.iter_mut().zip(&bare).filter(|(made, _)| made.is_none()) {
                *made = Some(self.fitted((&files, &asked), variants.as_deref(), shape)?);
            }
        }
        Ok(out.into_iter().flatten().collect())
    }

    /// A shape with its textures as they are and the precision that was asked for, if its file fits. One without textures in the finest
    /// precision with which it fits, or the coarsest.
    fn unreduced(&self, shape: Scene) -> Result<Option<Made>, FitError> {
        let (all, textured) = (compressions(self.options.compression), !shape.images.is_empty());
        for (k, compression) in all[..if textured { 1 } else { all.len() }].iter().enumerate() {
            let file = to_glb_with(&shape, *compression)?;
            if file.len() as u64 <= self.most || (!textured && k + 1 == all.len()) {
                return Ok(Some(Made { scene: shape, compression: *compression, file }));
            }
        }
        Ok(None)
    }

    /// What the files of each image cost and lose, where images are few and there is time to measure it.
    fn variants(&self, files: &Files) -> Result<Option<Vec<Vec<Variant>>>, FitError> {
        if !(2..=IMAGES_MAX).contains(&files.images.len()) || self.progress.is_cancelled() {
            return Ok(None);
        }
        let trials = files.trials();
        Ok(Some(files.variants(&self.rasterized(files, trials.len(), &|i| files.trial(&trials[i]))?)))
    }

    /// A shape with the textures and the precision that look best among those with which the file fits; `asked` are the textures as they
    /// are.
    fn fitted(
        &self,
        (files, asked): (&Files, &[TextureImage]),
        variants: Option<&[Vec<Variant>]>,
        bare: &Scene,
    ) -> Result<Made, FitError> {
        let scene = |choice: &Option<Choice>| match choice {
            Some(choice) => files.with(bare, choice),
            None => {
                let images = asked.iter().map(|i| i.clone().read_again()).collect::<Result<_, _>>()?;
                Ok(Scene { images, ..bare.clone() })
            }
        };
        let (mut fitting, mut least) = (Vec::new(), None);
        let smallest = files.smallest();
        let images = files.bytes(&smallest);
        let smallest = Some(smallest);
        // The coarsest first: of files that look the same the one of fewest bytes is taken.
        for compression in compressions(self.options.compression).iter().rev() {
            let smallest_file = to_glb_with(&scene(&smallest)?, *compression)?;
            let others =
                (smallest_file.len() as u64).saturating_sub(images) + (AROUND * files.images.len()) as u64;
            least.get_or_insert((smallest.clone(), *compression, smallest_file));
            let room = self.most.saturating_sub(others);
            let mut choices: Vec<Option<Choice>> = files.alike(room).into_iter().map(Some).collect();
            choices.extend(variants.and_then(|variants| files.apart(variants, room)).map(Some));
            // As it was asked for, the file with all of the textures does not fit.
            choices.extend((*compression != self.options.compression).then_some(None));
            for choice in choices {
                let file = to_glb_with(&scene(&choice)?, *compression)?;
                fitting.extend((file.len() as u64 <= self.most).then_some((choice, *compression, file)));
            }
        }
        let best = match fitting.len() {
            0 => None,
            1 => Some(0),
            _ if self.progress.is_cancelled() => Some(0),
            count => Some(judge::highest(&self.rasterized(files, count, &|i| Ok(from_glb(&fitting[i].2)?))?)),
        };
        let found = best.map(|best| fitting.swap_remove(best)).or(least);
        let (choice, compression, file) = found.expect("geometry is stored in one way at least");
        let made = Made { scene: scene(&choice)?, compression, file };
        match choice.filter(|_| best.is_some()) {
            Some(choice) => files.refined((&choice, made), self.most),
            None => Ok(made),
        }
    }

    /// How good `count` assets look in held-out views, by the rasterizer, which draws what textures of cores and geometry lose: they
    /// differ in nothing else.
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

/// Names of textures that are told of those that are stored alike.
const MOST_NAMES: usize = 4;
/// Characters that are told of such a name: it comes from a file.
const LONGEST_NAME: usize = 40;

/// How the textures of an asset are stored, for people: which ones so, where not all are stored alike.
pub(super) fn told(scene: &Scene) -> String {
    let one = |k: usize| {
        let i = &scene.images[k];
        let how = match scene.stored_encoding(k) {
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
    // What reads an image says more than its name, where it reads no other one.
    let reader = |k: usize| {
        let mut all = scene.materials.iter().flat_map(|m| m.textures());
        all.find(|(_, slot)| slot.image == k).map(|(what, _)| what)
    };
    let readers: Vec<_> = (0..scene.images.len()).map(reader).collect();
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for (k, image) in scene.images.iter().enumerate() {
        let how = one(k);
        let name = match readers[k] {
            Some(what) if readers.iter().filter(|r| **r == Some(what)).count() == 1 => what.to_owned(),
            what if image.name.is_empty() => what.map_or(format!("image {k}"), |what| format!("{what} {k}")),
            _ => format!("{:?}", image.name.chars().take(LONGEST_NAME).collect::<String>()),
        };
        match groups.iter_mut().find(|g| g.0 == how) {
            Some(group) => group.1.push(name),
            None => groups.push((how, vec![name])),
        }
    }
    let named = |(how, names): &(String, Vec<String>)| match names.len().saturating_sub(MOST_NAMES) {
        0 => format!("{} {how}", names.join(", ")),
        more => format!("{} and {more} more {how}", names[..MOST_NAMES].join(", ")),
    };
    match &groups[..] {
        [] => "none".into(),
        [(how, _)] => how.clone(),
        groups => groups.iter().map(named).collect::<Vec<_>>().join("; "),
    }
}
