//! A folder of pictures with cameras as a reference: `transforms.json` and the pictures that it names.
//!
//! The conventions of `transforms.json`: `transform_matrix` maps the camera's frame (y up, looking down -z) to the
//! world; focal lengths `fl_x`, `fl_y` and principal point `cx`, `cy` in pixels, or `camera_angle_x` in radians;
//! `applied_transform` is undone. PNG and JPEG are sRGB with straight alpha, OpenEXR is linear and premultiplied. The
//! list `lights` is our own (see the guide). Every 8th picture is held out.

mod doubts;
mod not_finite;
mod posed;
mod record;
mod world;

pub use posed::{FILE, named_files};
pub(crate) use posed::{PosedPicture, PosedPictures};
pub use world::{WorldPicture, lit_world_pictures, world_pictures};

use crate::bake;
use crate::engine::checkpoint::Digest;
use crate::engine::judge::{ReportView, Stage, rasterized_views};
use crate::engine::reference::{Picture, Reference, ReferenceKind, SUPERSAMPLE};
use crate::engine::trainer::{self, HeldOut, Measure};
use crate::engine::views::{Moment, Sampling, Set, Setup, Sphere, ViewLights, Views};
use crate::engine::{FitFrame, LightAsset};
use crate::{FitError, Progress};
use photofit_image::{Image, downsample};
use photofit_sampling::Rng;
use photofit_scene::Camera;
use std::path::Path;

/// Fewest pictures.
pub const FEWEST: usize = 8;
/// Every picture of this number is held out.
pub const HELD_OUT_EVERY: usize = 8;
/// Most pixels along a side of a picture that is fitted: what a step holds grows with the picture. Larger ones are reduced
/// by a whole factor.
pub(crate) const MOST_SIDE: usize = 2048;
/// Random stream of the order of the pictures.
const STREAM_ORDER: u64 = 8 << 32;

/// One picture with its camera and lights, in the normalised frame.
#[derive(Clone, Debug)]
pub struct Photo {
    /// Where it was taken from.
    pub camera: Camera,
    /// The light; empty where it is not known.
    pub lights: ViewLights,
    /// Linear RGBA, premultiplied.
    pub image: Image,
}

/// The pictures of a folder: a reference and its views.
#[derive(Clone, Debug)]
pub struct PictureFolder {
    photos: Vec<Photo>,
    train: Vec<usize>,
    held_out: Vec<usize>,
    seed: u64,
    /// Whether the light of the pictures is known.
    pub lit: bool,
    /// Pictures without alpha: the outline of the mesh stands in for it.
    pub without_alpha: usize,
    /// Frames whose camera does not see the asset.
    pub unseen: Vec<usize>,
    /// Frames whose pictures are reduced to at most 2048 pixels a side.
    pub reduced: Vec<usize>,
}

impl PictureFolder {
    /// Whether some picture holds colours that no screen shows: above 1.
    pub fn wide_range(&self) -> bool {
        self.photos.iter().any(|p| p.image.data.iter().any(|v| *v > 1.0))
    }

    /// Reads the pictures of a folder, or of a `transforms.json`, around an asset. Pictures without alpha get the
    /// coverage that `outline` draws of the asset for their camera: one sample per pixel.
    ///
    /// # Errors
    /// [`FitError::Pictures`] names file, frame and rule: fewer than [`FEWEST`] pictures, a missing or broken picture, a
    /// matrix that is not rigid, a lens with distortion, a path that leaves the folder, too many pixels, cameras of which
    /// none sees the asset.
    pub fn load(
        path: &Path,
        frame: FitFrame,
        seed: u64,
        outline: &dyn Fn(&Setup) -> Result<Image, FitError>,
    ) -> Result<Self, FitError> {
        let posed = PosedPictures::open(path)?.read(FEWEST, MOST_SIDE)?;
        let file = posed.file.clone();
        let mut out = Self::in_frame(posed, frame, seed)?;
        for (i, photo) in out.photos.iter_mut().enumerate() {
            let drawn = outline(&setup(photo, i))?;
            if drawn.data.chunks_exact(4).all(|p| p[3] <= 0.0) {
                out.unseen.push(i);
            }
            if photo.image.channels < 4 {
                photo.image = with_alpha(&photo.image, &drawn);
            }
        }
        if out.unseen.len() == out.photos.len() {
            let rule = "no camera sees the asset; transform_matrix must map the camera's frame (y up, looking down -z) to the \
                 world of the asset, in its units";
            return Err(FitError::Pictures { path: file, rule: rule.into() });
        }
        Ok(out)
    }

    /// Pictures that were read, in a frame; those without alpha still lack it.
    pub(crate) fn in_frame(posed: PosedPictures, frame: FitFrame, seed: u64) -> Result<Self, FitError> {
        let count = posed.pictures.len();
        let placed = (0..count).map(|i| Ok((posed.camera(i, frame)?, posed.lights(i, frame)?)));
        let placed = placed.collect::<Result<Vec<_>, FitError>>()?;
        let reduced = (0..count).filter(|i| posed.pictures[*i].reduction > 1).collect();
        let without_alpha = posed.pictures.iter().filter(|p| p.is_opaque()).count();
        let lit = posed.transforms.is_lit();
        let photo = |(p, (camera, lights)): (PosedPicture, _)| Photo { camera, lights, image: p.image };
        let photos = posed.pictures.into_iter().zip(placed).map(photo).collect();
        Ok(Self { without_alpha, reduced, ..Self::of(photos, seed, lit) })
    }

    /// These pictures, in the normalised frame, with alpha and with lights where `lit`.
    pub(crate) fn of(photos: Vec<Photo>, seed: u64, lit: bool) -> Self {
        let is_held_out = |i: &usize| (i + 1).is_multiple_of(HELD_OUT_EVERY);
        let (held_out, train) = (0..photos.len()).partition(is_held_out);
        Self { photos, train, held_out, seed, lit, without_alpha: 0, unseen: Vec::new(), reduced: Vec::new() }
    }

    /// The pictures.
    pub fn photos(&self) -> &[Photo] {
        &self.photos
    }

    /// What makes the pictures useless for a fit, one line each; none for sound ones.
    pub fn doubts(&self) -> Vec<String> {
        doubts::of(&self.photos)
    }

    /// All that a fit reads of the pictures.
    pub(crate) fn digest(&self) -> Digest {
        let mut digest = Digest::new();
        for photo in &self.photos {
            digest.add_bytes(format!("{:?} {:?}", photo.camera, photo.lights).as_bytes());
            digest.add(&photo.image.data);
        }
        digest
    }

    /// The pictures that are held out, for the evaluations of a fit. What no screen shows counts, too.
    pub(crate) fn evaluation(&self, seed: u64) -> Result<HeldOut, FitError> {
        let held_out = HeldOut::new(self, self, Sampling::SUPERSAMPLED, trainer::HELD_OUT, seed)?;
        let measure = if self.wide_range() { Measure::Relative } else { Measure::Psnr };
        Ok(held_out.measured_by(measure))
    }

    /// The stages against all pictures that are held out.
    pub(crate) fn judge(
        &self,
        light: &LightAsset,
        stages: &[Stage],
        progress: &dyn Progress,
    ) -> Result<Vec<ReportView>, FitError> {
        let count = self.held_out.len() as u64;
        rasterized_views(light, self, stages, self, Set::HeldOut, count, SUPERSAMPLE, progress)
    }

    /// Number of pictures that are held out.
    pub fn held_out(&self) -> usize {
        self.held_out.len()
    }
}

impl Views for PictureFolder {
    fn setup(&self, set: Set, index: u64, count: u64) -> Setup {
        let at = match set {
            Set::Train => {
                // All pictures once in an order of their own, then again in another.
                let n = self.train.len() as u64;
                let mut order = self.train.clone();
                let mut rng = Rng::new(self.seed, STREAM_ORDER + index / n);
                for k in (1..order.len()).rev() {
                    order.swap(k, rng.next_u32() as usize % (k + 1));
                }
                order[(index % n) as usize]
            }
            Set::HeldOut | Set::Report => {
                let n = self.held_out.len() as u64;
                self.held_out[(index * n / count.max(1)).min(n - 1) as usize]
            }
        };
        setup(&self.photos[at], at)
    }
}

impl Reference for PictureFolder {
    fn kind(&self) -> ReferenceKind {
        ReferenceKind::GIVEN
    }

    /// The picture that the view belongs to; how noisy it is is not known.
    fn picture(&self, setup: &Setup) -> Result<Picture, FitError> {
        let image = &self.photos[setup.given_picture(self.photos.len())?].image;
        let factor = (image.width / setup.width.max(1)).max(1);
        let image = if factor > 1 {
            downsample(image, factor).crop(0, 0, setup.width, setup.height)
        } else {
            image.clone()
        };
        Ok(Picture { image, noise: None })
    }

    fn bounds(&self, _: Moment) -> Sphere {
        Sphere::UNIT
    }

    fn surface(&self, _: Moment) -> Option<&bake::Reference<'_>> {
        None
    }
}

fn setup(photo: &Photo, at: usize) -> Setup {
    Setup {
        camera: photo.camera.into(),
        lights: photo.lights.clone(),
        moment: Moment::default(),
        width: photo.image.width,
        height: photo.image.height,
        picture: Some(at),
    }
}

/// A picture without alpha, cut out by a coverage (the fourth channel of `outline`).
fn with_alpha(image: &Image, outline: &Image) -> Image {
    let channels: &[usize] = if image.channels < 3 { &[0, 0, 0] } else { &[0, 1, 2] };
    let rgb = image.select(channels);
    let pixels = rgb.data.chunks_exact(3).zip(outline.data.chunks_exact(4));
    let data = pixels.flat_map(|(p, o)| [p[0] * o[3], p[1] * o[3], p[2] * o[3], o[3]]).collect();
    Image::from_data(image.width, image.height, 4, data)
}

#[cfg(test)]
mod tests;
