//! Reads `transforms.json` and the pictures that it names: one reader for all tasks.

use super::record::{self, Frame, Intrinsics, Rigid, Transforms};
use super::{not_finite, value_fault};
use crate::FitError;
use crate::engine::FitFrame;
use crate::engine::views::ViewLights;
use glam::{Mat4, Vec3};
use photofit_image::{Image, downsample};
use photofit_scene::Camera;
use serde::Deserialize;
use serde_json::Value;
use std::path::{Component, Path, PathBuf};

/// Name of the file that lists the pictures.
pub const FILE: &str = "transforms.json";
/// Most pixels of all pictures together, which are kept in memory: 16 bytes each.
const MOST_PIXELS: usize = 1 << 28;
/// Largest list of pictures, bytes.
const MOST_BYTES: u64 = 64 << 20;

/// The pictures of a file, with poses in the world of the file: a [`FitFrame`] makes cameras of them.
#[derive(Debug)]
pub(crate) struct PosedPictures {
    /// The file that lists them.
    pub(crate) file: PathBuf,
    pub(super) transforms: Transforms,
    /// From the world of the matrices to that of the asset.
    undo: Rigid,
    /// The pictures, one for each frame of the file once they are read.
    pub(crate) pictures: Vec<PosedPicture>,
}

/// A picture, and how it was taken.
#[derive(Debug)]
pub(crate) struct PosedPicture {
    /// Linear; premultiplied RGBA where the file has alpha, else the channels of the file.
    pub(crate) image: Image,
    /// By how much it is smaller than in the file.
    pub(crate) reduction: usize,
    /// Columns and rows of the file, and those of them, from the upper left corner, that the picture shows.
    size: [usize; 2],
    shown: [usize; 2],
    pose: Rigid,
}

impl PosedPicture {
    /// Whether the file has no alpha.
    pub(crate) fn is_opaque(&self) -> bool {
        self.image.channels < 4
    }
}

impl PosedPictures {
    /// Reads the list of a folder, or the list itself; no pictures yet.
    pub(crate) fn open(path: &Path) -> Result<Self, FitError> {
        let file = transforms_file(path);
        let transforms = read(&file)?;
        let undo = transforms.undo().map_err(|rule| FitError::Pictures { path: file.clone(), rule })?;
        Ok(Self { file, transforms, undo, pictures: Vec::new() })
    }

    /// Reads the pictures, `fewest` at least. One with more than `most_side` pixels along a side is reduced by a whole
    /// factor.
    pub(crate) fn read(mut self, fewest: usize, most_side: usize) -> Result<Self, FitError> {
        let found = self.transforms.frames.len();
        if found < fewest {
            return Err(self.error(format!("holds {found} frames; it must be at least {fewest}")));
        }
        let folder = folder_of(&self.file);
        // What the list says is checked for all before the first picture is decoded.
        let listed = |(i, frame): (usize, &Frame)| {
            let error = |rule| self.error_at(i, rule);
            let path = inside(folder, &frame.file_path).map_err(error)?;
            let pose =
                Rigid::new(&frame.transform_matrix).map_err(|r| error(format!("transform_matrix {r}")))?;
            Ok((path, pose))
        };
        let listed: Vec<(PathBuf, Rigid)> =
            self.transforms.frames.iter().enumerate().map(listed).collect::<Result<_, FitError>>()?;
        let mut pixels = 0;
        let mut pictures = Vec::new();
        for (i, (path, pose)) in listed.into_iter().enumerate() {
            let error = |rule| self.error_at(i, rule);
            let image = photofit_image::read(&path)?;
            let size = [image.width, image.height];
            let factor = size[0].max(size[1]).div_ceil(most_side).max(1);
            let [width, height] = size.map(|n| if n < factor { n } else { n - n % factor });
            pixels += width * height / (factor * factor);
            if pixels > MOST_PIXELS {
                return Err(error(format!(
                    "all pictures up to it have more than {MOST_PIXELS} pixels together"
                )));
            }
            if let Some(fault) = value_fault(&image) {
                return Err(error(fault));
            }
            let image = if image.channels < 4 { image } else { premultiplied(&path, &image) };
            let image = if factor > 1 { downsample(&image.crop(0, 0, width, height), factor) } else { image };
            pictures.push(PosedPicture { image, reduction: factor, size, shown: [width, height], pose });
        }
        self.pictures = pictures;
        Ok(self)
    }

    /// The error of a rule that the file breaks.
    pub(crate) fn error(&self, rule: String) -> FitError {
        FitError::Pictures { path: self.file.clone(), rule }
    }

    /// The error of a rule that a frame of it breaks.
    pub(super) fn error_at(&self, i: usize, rule: String) -> FitError {
        self.error(format!("frame {i} ({}): {rule}", self.frame(i).file_path))
    }

    pub(super) fn frame(&self, i: usize) -> &Frame {
        &self.transforms.frames[i]
    }

    /// The camera of picture `i`. Near and far are those of the unit sphere of the frame.
    pub(crate) fn camera(&self, i: usize, frame: FitFrame) -> Result<Camera, FitError> {
        let PosedPicture { size, shown, pose, .. } = &self.pictures[i];
        let lens = self.frame(i).lens.or(&self.transforms.lens);
        camera(&lens, &self.undo.after(pose), frame, *size, *shown).map_err(|rule| self.error_at(i, rule))
    }

    /// The lights of picture `i`: its own, or those of the file.
    pub(super) fn lights(&self, i: usize, frame: FitFrame) -> Result<ViewLights, FitError> {
        let given = self.frame(i).lights.as_ref().or(self.transforms.lights.as_ref());
        let lights = given.map_or(Ok(ViewLights::default()), |l| record::lights(l, &self.undo, frame));
        lights.map_err(|rule| self.error_at(i, rule))
    }

    /// The lights of the file.
    pub(super) fn common_lights(&self, frame: FitFrame) -> Result<ViewLights, FitError> {
        let given = self.transforms.lights.as_deref().unwrap_or_default();
        record::lights(given, &self.undo, frame).map_err(|rule| self.error(rule))
    }
}

fn transforms_file(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE) } else { path.to_owned() }
}

fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new("."))
}

/// The file of a folder of pictures and the pictures that it names, as [`PictureFolder::load`](super::PictureFolder::load)
/// reads them. What cannot be read is left out: loading tells it.
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
    let place = || not_finite::place(&bytes).or_else(|| faulty_frame(&bytes));
    serde_json::from_slice(&bytes)
        .or_else(|e| fail(place().unwrap_or_else(|| format!("is not what transforms.json must be: {e}"))))
}

/// The first frame that cannot be read, and why; `None` where all can, or the text is no JSON.
fn faulty_frame(bytes: &[u8]) -> Option<String> {
    let file: Value = serde_json::from_slice(bytes).ok()?;
    let fault = |(i, frame): (usize, &Value)| {
        let why = Frame::deserialize(frame).err()?;
        let name = frame["file_path"].as_str().map_or_else(String::new, |name| format!(" ({name})"));
        Some(format!("frame {i}{name}: {why}"))
    };
    file["frames"].as_array()?.iter().enumerate().find_map(fault)
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

/// The camera of a picture of `size` pixels, of which the upper left `width` x `height` are shown.
fn camera(
    lens: &Intrinsics,
    pose: &Rigid,
    frame: FitFrame,
    size: [usize; 2],
    [width, height]: [usize; 2],
) -> Result<Camera, String> {
    let lens = lens.in_pixels(size[0] as f64, size[1] as f64)?;
    let (center, radius) = (frame.center.to_array().map(f64::from), f64::from(frame.radius));
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
    let camera = Camera {
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
    };
    if !camera.view_projection().is_finite() {
        return Err("the camera is too far away, or its focal length is too short or too long".into());
    }
    Ok(camera)
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
