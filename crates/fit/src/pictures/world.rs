//! Pictures with cameras in the world of a scene, whose own lights they show.

use super::record::{self, Frame, Rigid, Transforms};
use super::{MOST_PIXELS, camera, folder_of, inside, premultiplied, read, transforms_file};
use crate::FitError;
use crate::engine::views::ViewLights;
use photofit_image::Image;
use photofit_scalar::Vec3f;
use photofit_scene::Camera;
use std::path::{Path, PathBuf};

/// One picture with its camera.
#[derive(Clone, Debug)]
pub struct WorldPicture {
    /// Its file.
    pub path: PathBuf,
    /// Where it was taken from, in the units of the scene; near and far mean nothing.
    pub camera: Camera,
    /// Linear RGBA, premultiplied; alpha is 1 where the file has none.
    pub image: Image,
}

/// Reads the pictures of a folder, or of a `transforms.json`, with their cameras in the world of the file, all of one
/// size.
///
/// # Errors
/// [`FitError::Pictures`] names file, frame and rule: no picture, pictures of several sizes, a missing or broken picture,
/// a matrix that is not rigid, a lens with distortion, a path that leaves the folder, too many pixels, lights (the scene
/// has its own).
pub fn world_pictures(path: &Path) -> Result<Vec<WorldPicture>, FitError> {
    let file = transforms_file(path);
    let transforms = read(&file)?;
    let lit = |f: &Frame| f.lights.is_some() || transforms.lights.is_some();
    if let Some(i) = transforms.frames.iter().position(lit) {
        let rule = "has lights; it must have none, those of the scene count";
        return Err(of_frame(&file, &transforms, i, rule));
    }
    pictures(&file, &transforms)
}

/// The same with the lights of the file, which are those of all pictures; none where it names none.
///
/// # Errors
/// As [`world_pictures`]; lights of a frame alone, lights that are not finite or darker than 0.
pub fn lit_world_pictures(path: &Path) -> Result<(Vec<WorldPicture>, ViewLights), FitError> {
    let file = transforms_file(path);
    let transforms = read(&file)?;
    if let Some(i) = transforms.frames.iter().position(|f| f.lights.is_some()) {
        let rule =
            "has lights of its own; it must have none, those of the file are the same for all pictures";
        return Err(of_frame(&file, &transforms, i, rule));
    }
    let fail = |rule: String| FitError::Pictures { path: file.clone(), rule };
    let undo = transforms.undo().map_err(fail)?;
    let given = transforms.lights.as_deref().unwrap_or_default();
    let lights = record::lights(given, &undo, (Vec3f::zero(), 1.0)).map_err(fail)?;
    Ok((pictures(&file, &transforms)?, lights))
}

fn of_frame(file: &Path, transforms: &Transforms, i: usize, rule: &str) -> FitError {
    let rule = format!("frame {i} ({}): {rule}", transforms.frames[i].file_path);
    FitError::Pictures { path: file.to_owned(), rule }
}

fn pictures(file: &Path, transforms: &Transforms) -> Result<Vec<WorldPicture>, FitError> {
    let fail = |rule: String| FitError::Pictures { path: file.to_owned(), rule };
    if transforms.frames.is_empty() {
        return Err(fail("holds no frames; it must be at least one".into()));
    }
    let folder = folder_of(file);
    let undo = transforms.undo().map_err(&fail)?;
    let mut out: Vec<WorldPicture> = Vec::new();
    let mut pixels = 0;
    for (i, frame) in transforms.frames.iter().enumerate() {
        let fail = |rule: String| fail(format!("frame {i} ({}): {rule}", frame.file_path));
        let path = inside(folder, &frame.file_path).map_err(&fail)?;
        let image = photofit_image::read(&path)?;
        pixels += image.pixels();
        if pixels > MOST_PIXELS {
            return Err(fail(format!("all pictures up to it have more than {MOST_PIXELS} pixels together")));
        }
        if !image.is_finite() {
            return Err(fail("the picture holds values that are not finite".into()));
        }
        if image.channels < 3 {
            return Err(fail(format!(
                "the picture has {} channels; it must have three or four",
                image.channels
            )));
        }
        if let Some(first) =
            out.first().filter(|p| (p.image.width, p.image.height) != (image.width, image.height))
        {
            let [first, this] = [&first.image, &image].map(|p| format!("{} x {}", p.width, p.height));
            return Err(fail(format!("the picture is {this}; it must be {first}, as the first one")));
        }
        let pose = Rigid::new(&frame.transform_matrix).map_err(|r| fail(format!("transform_matrix {r}")))?;
        let lens = frame.lens.or(&transforms.lens);
        let camera = camera(&lens, &undo.after(&pose), ([0.0; 3], 1.0), &image, [image.width, image.height])
            .map_err(&fail)?;
        let image = if image.channels == 3 {
            Image::from_fn(
                image.width,
                image.height,
                4,
                |x, y, c| if c < 3 { image.pixel(x, y)[c] } else { 1.0 },
            )
        } else {
            premultiplied(&path, &image)
        };
        out.push(WorldPicture { path, camera, image });
    }
    Ok(out)
}
