//! Pictures with cameras in the world of a scene, whose own lights they show.

use super::posed::PosedPictures;
use crate::FitError;
use crate::engine::FitFrame;
use crate::engine::given::GivenPicture;
use crate::engine::views::{ViewCamera, ViewLights};
use photofit_image::Image;
use std::path::Path;

/// Reads the pictures of a folder, or of a `transforms.json`, with their cameras in the world of the file, all of one
/// size. Near and far of the cameras mean nothing; alpha is 1 where a file has none; the pictures name no lights.
///
/// # Errors
/// [`FitError::Pictures`] names file, frame and rule: no picture, pictures of several sizes, a missing or broken picture,
/// a matrix that is not rigid, a lens with distortion, a path that leaves the folder, too many pixels, lights (the scene
/// has its own).
pub fn world_pictures(path: &Path) -> Result<Vec<GivenPicture>, FitError> {
    let list = PosedPictures::open(path)?;
    let common = list.transforms.lights.is_some();
    if let Some(i) = list.transforms.frames.iter().position(|f| common || f.lights.is_some()) {
        let rule = "has lights; it must have none here, where light is that of a scene or is found";
        return Err(list.error_at(i, rule.into()));
    }
    pictures(list)
}

/// The same with the lights of the file, which are those of all pictures; none where it names none.
///
/// # Errors
/// As [`world_pictures`]; lights of a frame alone, lights that are not finite or darker than 0.
pub fn lit_world_pictures(path: &Path) -> Result<(Vec<GivenPicture>, ViewLights), FitError> {
    let list = PosedPictures::open(path)?;
    if let Some(i) = list.transforms.frames.iter().position(|f| f.lights.is_some()) {
        let rule =
            "has lights of its own; it must have none, those of the file are the same for all pictures";
        return Err(list.error_at(i, rule.into()));
    }
    let lights = list.common_lights(FitFrame::WORLD)?;
    Ok((pictures(list)?, lights))
}

fn pictures(list: PosedPictures) -> Result<Vec<GivenPicture>, FitError> {
    let list = list.read(1, usize::MAX)?;
    let size = |p: &Image| (p.width, p.height);
    for (i, picture) in list.pictures.iter().enumerate() {
        let (first, image) = (&list.pictures[0].image, &picture.image);
        if image.channels < 3 {
            let rule = format!("the picture has {} channels; it must have three or four", image.channels);
            return Err(list.error_at(i, rule));
        }
        if size(first) != size(image) {
            let [first, this] = [first, image].map(|p| format!("{} x {}", p.width, p.height));
            let rule = format!("the picture is {this}; it must be {first}, as the first one");
            return Err(list.error_at(i, rule));
        }
    }
    let cameras = (0..list.pictures.len()).map(|i| list.camera(i, FitFrame::WORLD));
    let cameras = cameras.collect::<Result<Vec<_>, _>>()?;
    let images = list.pictures.into_iter().map(|p| opaque(p.image));
    let picture = |(camera, image)| GivenPicture {
        camera: ViewCamera::from(camera),
        lights: ViewLights::default(),
        image,
    };
    Ok(cameras.into_iter().zip(images).map(picture).collect())
}

/// A picture with alpha, 1 where it has none.
fn opaque(image: Image) -> Image {
    if image.channels == 4 {
        return image;
    }
    let texel = |x: usize, y: usize, c: usize| if c < 3 { image.pixel(x, y)[c] } else { 1.0 };
    Image::from_fn(image.width, image.height, 4, texel)
}
