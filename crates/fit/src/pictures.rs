//! A folder of pictures with cameras as a reference: `transforms.json` and the pictures that it names.
//!
//! The conventions of `transforms.json`: `transform_matrix` maps the camera's frame (y up, looking down -z) to the
//! world; focal lengths `fl_x`, `fl_y` and principal point `cx`, `cy` in pixels, or `camera_angle_x` in radians;
//! `applied_transform` is undone. PNG and JPEG are sRGB with straight alpha, OpenEXR is linear and premultiplied. The
//! list `lights` is our own (see the guide). Every 8th picture is held out.

mod doubts;
mod not_finite;
mod record;
mod world;

pub use world::{WorldPicture, lit_world_pictures, world_pictures};

use crate::bake;
use crate::engine::Normalised;
use crate::engine::checkpoint::Digest;
use crate::engine::judge::{ReportView, Stage, rasterized_views};
use crate::engine::reference::{Picture, Reference, ReferenceKind, SUPERSAMPLE};
use crate::engine::trainer::{self, HeldOut, Measure};
use crate::engine::views::{Moment, Sampling, Set, Setup, Sphere, ViewLights, Views};
use crate::{FitError, Progress};
use glam::{Mat4, Vec3};
use photofit_image::{Image, downsample};
use photofit_sampling::Rng;
use photofit_scene::Camera;
use record::{Intrinsics, Rigid, Transforms};
use std::path::{Component, Path, PathBuf};

/// Name of the file that lists the pictures.
pub const FILE: &str = "transforms.json";
/// Fewest pictures.
pub const FEWEST: usize = 8;
/// Every picture of this number is held out.
pub const HELD_OUT_EVERY: usize = 8;
/// Most pixels along a side of a picture that is fitted: what a step holds grows with the picture. Larger ones are reduced
/// by a whole factor.
const MOST_SIDE: usize = 2048;
/// Most pixels of all pictures together, which are kept in memory: 16 bytes each.
const MOST_PIXELS: usize = 1 << 28;
/// Largest list of pictures, bytes.
const MOST_BYTES: u64 = 64 << 20;
/// Random stream of the order of the pictures.
const STREAM_ORDER: u64 = 8 << 32;

/// One picture with its camera and lights, in the normalised frame.
#[derive(Clone, Debug)]
pub struct Photo {
    /// Its file.
    pub path: PathBuf,
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
        n: &Normalised,
        seed: u64,
        outline: &dyn Fn(&Setup) -> Result<Image, FitError>,
    ) -> Result<Self, FitError> {
        let file = transforms_file(path);
        let fail = |rule: String| FitError::Pictures { path: file.clone(), rule };
        let transforms = read(&file)?;
        if transforms.frames.len() < FEWEST {
            let found = transforms.frames.len();
            return Err(fail(format!("holds {found} frames; it must be at least {FEWEST}")));
        }
        let folder = folder_of(&file);
        let undo = transforms.undo().map_err(&fail)?;
        let mut out = Self::of(Vec::new(), seed, transforms.is_lit());
        let mut pixels = 0;
        for (i, frame) in transforms.frames.iter().enumerate() {
            let fail = |rule: String| fail(format!("frame {i} ({}): {rule}", frame.file_path));
            let picture = inside(folder, &frame.file_path).map_err(&fail)?;
            let image = photofit_image::read(&picture)?;
            let (factor, [width, height]) = reduction(&image);
            if factor > 1 {
                out.reduced.push(i);
            }
            pixels += width * height / (factor * factor);
            if pixels > MOST_PIXELS {
                return Err(fail(format!(
                    "all pictures up to it have more than {MOST_PIXELS} pixels together"
                )));
            }
            if !image.is_finite() {
                return Err(fail("the picture holds values that are not finite".into()));
            }
            let lens = frame.lens.or(&transforms.lens);
            let pose =
                Rigid::new(&frame.transform_matrix).map_err(|r| fail(format!("transform_matrix {r}")))?;
            let frame_of = (n.center.to_array().map(f64::from), f64::from(n.radius));
            let camera =
                camera(&lens, &undo.after(&pose), frame_of, &image, [width, height]).map_err(&fail)?;
            let lights = frame.lights.as_ref().or(transforms.lights.as_ref());
            let lights = lights
                .map_or(Ok(ViewLights::default()), |l| record::lights(l, &undo, (n.center, n.radius)))
                .map_err(&fail)?;
            let opaque = image.channels < 4;
            let image = if opaque { image } else { premultiplied(&picture, &image) };
            let image = if factor > 1 { downsample(&image.crop(0, 0, width, height), factor) } else { image };
            let mut photo = Photo { path: picture, camera, lights, image };
            let drawn = outline(&setup(&photo, i))?;
            if drawn.data.chunks_exact(4).all(|p| p[3] <= 0.0) {
                out.unseen.push(i);
            }
            if opaque {
                out.without_alpha += 1;
                photo.image = with_alpha(&photo.image, &drawn);
            }
            out.photos.push(photo);
            let set = if (i + 1).is_multiple_of(HELD_OUT_EVERY) { &mut out.held_out } else { &mut out.train };
            set.push(i);
        }
        if out.unseen.len() == out.photos.len() {
            return Err(fail(
                "no camera sees the asset; transform_matrix must map the camera's frame (y up, looking down -z) to the \
                 world of the asset, in its units"
                    .into(),
            ));
        }
        Ok(out)
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
        n: &Normalised,
        stages: &[Stage],
        progress: &dyn Progress,
    ) -> Result<Vec<ReportView>, FitError> {
        let count = self.held_out.len() as u64;
        rasterized_views(n, self, stages, self, Set::HeldOut, count, SUPERSAMPLE, progress)
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
        camera: photo.camera,
        rays: None,
        lights: photo.lights.clone(),
        moment: Moment::default(),
        width: photo.image.width,
        height: photo.image.height,
        picture: Some(at),
    }
}

fn transforms_file(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE) } else { path.to_owned() }
}

fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new("."))
}

/// The file of a folder of pictures and the pictures that it names, as [`PictureFolder::load`] reads them. What cannot be
/// read is left out: loading tells it.
pub fn named_files(path: &Path) -> Vec<PathBuf> {
    let file = transforms_file(path);
    let frames = read(&file).map_or_else(|_| Vec::new(), |t| t.frames);
    let folder = folder_of(&file);
    let mut files: Vec<PathBuf> = frames.iter().filter_map(|f| inside(folder, &f.file_path).ok()).collect();
    files.push(file);
    files
}

fn read(file: &Path) -> Result<Transforms, FitError> {
    let fail = |rule| Err(FitError::Pictures { path: file.into(), rule });
    let bytes = photofit_image::file_bytes(file, MOST_BYTES)?;
    serde_json::from_slice(&bytes)
        .or_else(|e| fail(not_finite::place(&bytes).unwrap_or_else(|| e.to_string())))
}

/// The rule of `file_path`.
const OUTSIDE: &str =
    "file_path leaves the folder; it must be relative and stay inside of the folder, links followed";

/// The file of a picture, whose ending `.png` may be missing.
fn inside(folder: &Path, name: &str) -> Result<PathBuf, String> {
    let relative = Path::new(name);
    if name.is_empty() {
        return Err("file_path is empty; it must name a picture".into());
    }
    if !relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
        return Err(OUTSIDE.into());
    }
    let path = folder.join(relative);
    let png = folder.join(format!("{name}.png"));
    let Some(found) = [&path, &png].into_iter().find(|p| p.is_file()) else {
        return Err(format!("the picture {} does not exist", path.display()));
    };
    // What a link leads to counts.
    let real = |path: &Path| path.canonicalize().map_err(|e| format!("{}: {e}", path.display()));
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    if real(found)?.starts_with(real(folder)?) { Ok(found.clone()) } else { Err(OUTSIDE.into()) }
}

/// By how much a picture is reduced, and the part of it, from its upper left corner, that has whole blocks.
fn reduction(image: &Image) -> (usize, [usize; 2]) {
    let factor = image.width.max(image.height).div_ceil(MOST_SIDE).max(1);
    let whole = |n: usize| if n < factor { n } else { n - n % factor };
    (factor, [whole(image.width), whole(image.height)])
}

/// The camera of a picture in a frame whose origin is `center` and whose unit of length is `radius`; it shows the first
/// `width` x `height` pixels of it.
fn camera(
    lens: &Intrinsics,
    pose: &Rigid,
    (center, radius): ([f64; 3], f64),
    image: &Image,
    [width, height]: [usize; 2],
) -> Result<Camera, String> {
    let lens = lens.in_pixels(image.width as f64, image.height as f64)?;
    let (width, height) = (width as f64, height as f64);
    let eye = [0, 1, 2].map(|k| ((pose.translation[k] - center[k]) / radius) as f32);
    let eye = Vec3::from_array(eye);
    if !eye.is_finite() {
        return Err("the camera is too far away".into());
    }
    let axis = |k: usize| Vec3::from_array([0, 1, 2].map(|row| pose.rotation[row][k] as f32));
    let [x, y, z] = [0, 1, 2].map(axis);
    let view = Mat4::from_cols(
        glam::vec4(x.x, y.x, z.x, 0.0),
        glam::vec4(x.y, y.y, z.y, 0.0),
        glam::vec4(x.z, y.z, z.z, 0.0),
        glam::vec4(-x.dot(eye), -y.dot(eye), -z.dot(eye), 1.0),
    );
    let distance = eye.length();
    let near = (distance - 1.05).max(1e-3 * distance.max(1.0));
    Ok(Camera {
        eye,
        view,
        fov_y: (2.0 * (0.5 * height / lens.focal[1]).atan()) as f32,
        aspect: (lens.focal[1] / height * width / lens.focal[0]) as f32,
        principal: [
            (2.0 * lens.center[0] / width - 1.0) as f32,
            (1.0 - 2.0 * lens.center[1] / height) as f32,
        ],
        near,
        far: distance + 1.05,
    })
}

/// Linear premultiplied RGBA of a picture with alpha: straight in PNG, premultiplied in `OpenEXR`.
fn premultiplied(path: &Path, image: &Image) -> Image {
    let image = image.select(&[0, 1, 2, 3]);
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) {
        return image;
    }
    let data =
        image.data.chunks_exact(4).flat_map(|p| [p[0] * p[3], p[1] * p[3], p[2] * p[3], p[3]]).collect();
    Image::from_data(image.width, image.height, 4, data)
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
