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

pub use doubts::doubts;
pub(crate) use posed::PosedPictures;
pub use posed::{FILE, named_files};
pub use world::{lit_world_pictures, world_pictures};

use crate::engine::checkpoint::Digest;
use crate::engine::given::{GivenPicture, GivenPictures, Order};
use crate::engine::judge::{ReportView, Stage, rasterized_views};
use crate::engine::reference::SUPERSAMPLE;
use crate::engine::trainer::{self, HeldOut, Measure};
use crate::engine::views::{Sampling, Set, Setup};
use crate::engine::{FitFrame, LightAsset};
use crate::{FitError, Progress};
use photofit_image::Image;
use std::path::Path;

/// Fewest pictures.
pub const MIN_PICTURES: usize = 8;
/// Every picture of this number is held out.
pub const HELD_OUT_EVERY: usize = 8;
/// Most pixels along a side of a picture that is fitted: what a step holds grows with the picture. Larger ones are reduced
/// by a whole factor.
pub(crate) const MOST_SIDE: usize = 2048;
/// Largest value of a picture: beyond, squares of differences leave single precision.
const BRIGHTEST: f32 = 1e15;

/// The first value of a picture that nothing can be fitted to, and the rule that it breaks.
pub fn value_fault(picture: &Image) -> Option<String> {
    let (x, y, value) = picture.find(|v| v.is_nan() || v.abs() > BRIGHTEST)?;
    Some(format!("pixel ({x}, {y}) is {value:e}; it must be finite and at most {BRIGHTEST:e}"))
}

/// Draws an asset for the camera of a view; alpha is its coverage.
pub type Outline<'a> = &'a dyn Fn(&Setup) -> Result<Image, FitError>;

/// The pictures of a folder, in the frame of a fit.
#[derive(Clone, Debug)]
pub struct PictureFolder {
    /// The pictures, a reference and its views.
    pub given: GivenPictures,
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
        self.given.pictures().iter().any(|p| p.image.data.iter().any(|v| *v > 1.0))
    }

    /// Reads the pictures of a folder, or of a `transforms.json`, around an asset. Pictures without alpha get the
    /// coverage that `outline` draws of the asset for their camera: one sample per pixel.
    ///
    /// # Errors
    /// [`FitError::Pictures`] names file, frame and rule: fewer than [`MIN_PICTURES`] pictures, a missing or broken picture, a
    /// matrix that is not rigid, a lens with distortion, a path that leaves the folder, too many pixels, cameras of which
    /// none sees the asset.
    pub fn load(path: &Path, frame: FitFrame, seed: u64, outline: Outline<'_>) -> Result<Self, FitError> {
        let posed = PosedPictures::open(path)?.read(MIN_PICTURES, MOST_SIDE)?;
        Self::in_frame(posed, frame, seed, Some(outline))
    }

    /// Pictures that were read, in a frame. Without an `outline` all of them must have alpha.
    pub(crate) fn in_frame(
        posed: PosedPictures,
        frame: FitFrame,
        seed: u64,
        outline: Option<Outline<'_>>,
    ) -> Result<Self, FitError> {
        let count = posed.pictures.len();
        let placed = (0..count).map(|i| Ok((posed.camera(i, frame)?, posed.lights(i, frame)?)));
        let placed = placed.collect::<Result<Vec<_>, FitError>>()?;
        let (file, lit) = (posed.file.clone(), posed.transforms.is_lit());
        let (mut pictures, mut unseen, mut reduced, mut without_alpha) = (vec![], vec![], vec![], 0);
        for (i, (posed, (camera, lights))) in posed.pictures.into_iter().zip(placed).enumerate() {
            if posed.reduction > 1 {
                reduced.push(i);
            }
            let opaque = posed.is_opaque();
            let mut picture = GivenPicture { camera: camera.into(), lights, image: posed.image };
            if let Some(outline) = outline {
                let drawn = outline(&picture.setup(i))?;
                if drawn.data.chunks_exact(4).all(|p| p[3] <= 0.0) {
                    unseen.push(i);
                }
                if opaque {
                    without_alpha += 1;
                    picture.image = with_alpha(&picture.image, &drawn);
                }
            }
            pictures.push(picture);
        }
        if unseen.len() == count {
            let rule = "no camera sees the asset; transform_matrix must map the camera's frame (y up, looking down -z) to the \
                 world of the asset, in its units";
            return Err(FitError::Pictures { path: file, rule: rule.into() });
        }
        Ok(Self { unseen, reduced, without_alpha, ..Self::of(pictures, seed, lit) })
    }

    /// These pictures, in the frame of a fit, with alpha and with lights where `lit`.
    pub(crate) fn of(pictures: Vec<GivenPicture>, seed: u64, lit: bool) -> Self {
        let is_held_out = |i: &usize| (i + 1).is_multiple_of(HELD_OUT_EVERY);
        let (held_out, train) = (0..pictures.len()).partition(is_held_out);
        let given = GivenPictures::new(pictures, train, held_out, Order::Shuffled(seed));
        Self { given, lit, without_alpha: 0, unseen: Vec::new(), reduced: Vec::new() }
    }

    /// What makes the pictures useless for a fit, one line each; none for sound ones.
    pub fn doubts(&self) -> Vec<String> {
        let pictures = self.given.pictures();
        let cameras: Vec<String> = pictures.iter().map(|p| format!("{:?}", p.camera)).collect();
        doubts(&pictures.iter().map(|p| &p.image).collect::<Vec<_>>(), &cameras)
    }

    /// All that a fit reads of the pictures.
    pub(crate) fn digest(&self) -> Digest {
        let mut digest = Digest::new();
        for photo in self.given.pictures() {
            digest.add_bytes(format!("{:?} {:?}", photo.camera.pinhole(), photo.lights).as_bytes());
            digest.add(&photo.image.data);
        }
        digest
    }

    /// The pictures that are held out, for the evaluations of a fit. What no screen shows counts, too.
    pub(crate) fn evaluation(&self, seed: u64) -> Result<HeldOut, FitError> {
        let held_out =
            HeldOut::new(&self.given, &self.given, Sampling::SUPERSAMPLED, trainer::HELD_OUT, seed)?;
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
        let (given, count) = (&self.given, self.given.held_out() as u64);
        rasterized_views(light, given, stages, given, Set::HeldOut, count, SUPERSAMPLE, progress)
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
